"""Readable equations of motion for small scenes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from acausal.errors import ExportError
from acausal.export.sympy_bridge import to_sympy
from acausal.mechanics.newton_euler import newton_euler
from acausal.reduction.reduce import ReducedSystem

_LARGEST = 600


@dataclass(frozen=True)
class Equations:
    """sympy equations: `motion` (solved for the acceleration with one freedom, else balances of forces), `constraints` = 0."""

    motion: tuple[Any, ...]
    constraints: tuple[Any, ...]

    def latex(self) -> str:
        """All equations as one LaTeX `align*` block."""
        import sympy

        rows = [f"{sympy.latex(e.lhs)} &= {sympy.latex(e.rhs)}" for e in (*self.motion, *self.constraints)]
        return "\\begin{align*}\n" + " \\\\\n".join(rows) + "\n\\end{align*}"

    def __str__(self) -> str:
        return "\n".join(str(e) for e in (*self.motion, *self.constraints))


def equations(system: ReducedSystem) -> Equations:
    """The equations of motion in coordinates q_<joint>(t) and their derivatives (or v_<joint>(t) where q' is not v).

    Raises `ExportError` for scenes with more operations than one cares to read.
    """
    import sympy

    tree = system.mechanics.tree
    t = sympy.Symbol("t")
    coordinates: list[Any] = []
    velocities: list[Any] = []
    for item in tree.joints:
        name, joint = item.edge.name.replace(".", "_"), item.edge.joint
        own = [sympy.Function(_indexed(f"q_{name}", i, joint.q.size))(t) for i in range(joint.q.size)]
        coordinates += own
        same = joint.q.size == joint.v.size
        velocities += [
            own[i].diff(t) if same else sympy.Function(_indexed(f"v_{name}", i, joint.v.size))(t) for i in range(joint.v.size)
        ]
    parameters = [sympy.Symbol(p.name.replace(".", "_"), positive=True) for p in system.flat.parameters]
    inputs = [sympy.Function(u.name.replace(".", "_"))(t) for u in system.flat.inputs]
    v_dot = ca.SX.sym("v_dot", tree.v.numel())
    forces = [sympy.Symbol(f"lambda_{k + 1}") for k in range(system.constraints.jacobian.shape[0])]
    multipliers = ca.SX.sym("lambda", len(forces))
    symbols = [
        (tree.q, coordinates), (tree.v, velocities), (system.t, [t]), (system.p, parameters), (system.u, inputs),
        (v_dot, [v.diff(t) for v in velocities]), (multipliers, forces),
    ]  # fmt: skip
    if len(velocities) == 1 and not forces:
        rows = system.v_dot
    else:
        rows = newton_euler(system.mechanics.kinematics, v_dot, list(system.mechanics.wrenches)).tau - system.tau
        if forces:
            rows = rows - system.constraints.jacobian.T @ multipliers
    if ca.Function("size", [ca.vertcat(*(column for column, _ in symbols))], [rows]).n_instructions() > _LARGEST:
        raise ExportError(f"The scene '{system.flat.name}' is too large for readable equations; use model.functions.")
    found = [sympy.simplify(row) for row in to_sympy(rows, symbols)]
    if len(velocities) == 1 and not forces:
        motion = (sympy.Eq(velocities[0].diff(t), found[0]),)
    else:
        motion = tuple(sympy.Eq(sympy.expand(row), 0) for row in found)
    constraints = to_sympy(system.constraints.position, symbols) if system.constraints.position.numel() else []
    return Equations(motion, tuple(sympy.Eq(sympy.simplify(row), 0) for row in constraints))


def _indexed(name: str, i: int, count: int) -> str:
    return name if count == 1 else f"{name}_{i + 1}"
