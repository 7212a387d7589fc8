"""Readable equations of motion for small scenes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from acausal.dynamics.newton_euler import newton_euler
from acausal.errors import ExportError
from acausal.export.sympy_bridge import to_sympy
from acausal.outputs.functions import Functions
from acausal.reduce.reduce import ReducedSystem
from acausal.reduce.state_space import StateSpace

_LARGEST = 600


@dataclass(frozen=True)
class Equations:
    """sympy equations: `motion` (solved for the acceleration with one velocity, else balances of forces), `constraints`: coordinates
    that follow from others, positions of loops, rolling without slip.
    """

    motion: tuple[Any, ...]
    constraints: tuple[Any, ...]

    def latex(self) -> str:
        """All equations as one LaTeX `align*` block."""
        import sympy

        rows = [f"{sympy.latex(e.lhs)} &= {sympy.latex(e.rhs)}" for e in (*self.motion, *self.constraints)]
        return "\\begin{align*}\n" + " \\\\\n".join(rows) + "\n\\end{align*}"

    def __str__(self) -> str:
        return "\n".join(str(e) for e in (*self.motion, *self.constraints))


def equations(functions: Functions) -> Equations:
    """The equations of motion in coordinates q_<joint>(t) and their derivatives (or v_<joint>(t) where q' is not v).

    Coordinates that follow from others in closed form stand on the left of a relation and nowhere else. Raises `ExportError` for
    scenes with more operations than one cares to read.
    """
    import sympy

    system, space = functions.outputs.system, functions.space
    tree, nq = system.mechanics.tree, system.nq
    coordinates, velocities = _symbols(system)
    kept = [i for i in space.places if nq <= i < nq + tree.v.numel()]
    v_dot = ca.SX.sym("v_dot", len(kept))
    v = space.put(tree.v)
    L = ca.jacobian(v, system.x[kept])
    A = system.constraints.jacobian
    held = [k for k in range(A.shape[0]) if not space.put(A[k, :] @ L).is_zero()]
    forces = [sympy.Symbol(f"lambda_{k + 1}") for k in range(len(held))]
    multipliers = ca.SX.sym("lambda", len(forces))
    alone = len(kept) == 1 and not forces
    if alone:
        rows = system.v_dot[kept[0] - nq]
    else:
        accelerations = L @ v_dot + ca.jtimes(v, system.t, ca.SX(1))
        balance = newton_euler(system.mechanics.kinematics, accelerations, list(system.mechanics.wrenches)).tau - system.tau
        rows = L.T @ (balance - A[held, :].T @ multipliers if forces else balance)
    parameters = [sympy.Symbol(p.name.replace(".", "_"), positive=True) for p in system.flat.parameters]
    constants = space.elimination.constants
    parameters += [sympy.Symbol(f"c_{k + 1}") for k in range(constants.numel())]
    symbols = [
        (tree.q, coordinates), (tree.v, velocities), (system.t, [sympy.Symbol("t")]), (space.p, parameters),
        (system.u, [sympy.Function(u.name.replace(".", "_"))(sympy.Symbol("t")) for u in system.flat.inputs]),
        (v_dot, [velocities[i - nq].diff(sympy.Symbol("t")) for i in kept]), (multipliers, forces),
    ]  # fmt: skip
    rows = space.put(rows)
    if ca.Function("size", [ca.vertcat(*(column for column, _ in symbols))], [rows]).n_instructions() > _LARGEST:
        raise ExportError(f"The scene '{system.flat.name}' is too large for readable equations; use model.functions.")
    found = [sympy.simplify(row) for row in to_sympy(rows, symbols)]
    if alone:
        motion = (sympy.Eq(velocities[kept[0] - nq].diff(sympy.Symbol("t")), found[0]),)
    else:
        motion = tuple(sympy.Eq(sympy.expand(row), 0) for row in found)
    follows = [
        sympy.Eq(coordinates[k], r) for k, r in zip(space.elimination.places, _sympy(_followers(space), symbols), strict=True)
    ]
    zero = space.constraints(ca.vertcat(system.constraints.position, system.scalar.position, _slips(system)))
    return Equations(motion, (*follows, *(sympy.Eq(sympy.simplify(row), 0) for row in _sympy(zero, symbols))))


def _symbols(system: ReducedSystem) -> tuple[list[Any], list[Any]]:
    """Coordinates and velocities of the joints as functions of time."""
    import sympy

    t = sympy.Symbol("t")
    coordinates: list[Any] = []
    velocities: list[Any] = []
    for item in system.mechanics.tree.joints:
        name, joint = item.edge.name.replace(".", "_"), item.edge.joint
        own = [sympy.Function(_indexed(f"q_{name}", i, joint.q.size))(t) for i in range(joint.q.size)]
        coordinates += own
        same = joint.q.size == joint.v.size
        velocities += [
            own[i].diff(t) if same else sympy.Function(_indexed(f"v_{name}", i, joint.v.size))(t) for i in range(joint.v.size)
        ]
    return coordinates, velocities


def _followers(space: StateSpace) -> ca.SX:
    """The eliminated coordinates in the others."""
    return ca.vertcat(ca.SX(0, 1), *space.elimination.values[: len(space.elimination.places)])


def _slips(system: ReducedSystem) -> ca.SX:
    """Velocity constraints that are not rates of position constraints."""
    c = system.constraints
    return ca.vertcat(ca.SX(0, 1), *(c.velocity[k] for k in c.slips))


def _sympy(rows: ca.SX, symbols: list[tuple[ca.SX, list[Any]]]) -> list[Any]:
    return list(to_sympy(rows, symbols)) if rows.numel() else []


def _indexed(name: str, i: int, count: int) -> str:
    return name if count == 1 else f"{name}_{i + 1}"
