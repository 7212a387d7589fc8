"""Readable equations of motion for small scenes."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import casadi as ca

from acausal.dynamics.newton_euler import newton_euler
from acausal.errors import ExportError
from acausal.export.sympy_bridge import operations
from acausal.export.trigonometric_sums import Algebra, Sum, TooLarge
from acausal.numerics.folding import folded_function
from acausal.outputs.functions import Functions
from acausal.parts.unit_quaternions import unit_quaternions
from acausal.reduce.modes import refuse_modes
from acausal.reduce.reduce import ReducedSystem
from acausal.reduce.state_space import StateSpace

_BUDGET = 150_000
_SHOWN = 3_000
_LARGEST = 800
_ROUNDING = 1e-14


@dataclass(frozen=True)
class MatrixForm:
    """mass v' + coriolis v + potential = forces, as sympy matrices: (n, n), (n, n), (n, 1), (n, 1).

    `velocities` v, `forces`: what dampers, inputs, prescribed motions and the multipliers lambda of constraints give. Where v are the rates
    of coordinates, `coriolis` is made of Christoffel's symbols (mass' - 2 coriolis is skew).
    """

    mass: Any
    coriolis: Any
    potential: Any
    forces: Any
    velocities: Any


@dataclass(frozen=True)
class Equations:
    """sympy equations: `motion` (solved for the acceleration with one velocity, else balances of forces), `kinematics`: rates of coordinates
    where these are not velocities, `constraints`: coordinates that follow from others, positions of loops, rolling without slip.
    """

    motion: tuple[Any, ...]
    kinematics: tuple[Any, ...]
    constraints: tuple[Any, ...]
    balances: _Balances

    @functools.cached_property
    def matrices(self) -> MatrixForm:
        """The balances of forces as mass v' + coriolis v + potential = forces."""
        return _matrix_form(self.balances)

    @property
    def all(self) -> tuple[Any, ...]:
        """Motion, kinematics, constraints."""
        return (*self.motion, *self.kinematics, *self.constraints)

    def latex(self) -> str:
        """All equations as one LaTeX `align*` block."""
        import sympy

        rows = [f"{sympy.latex(e.lhs)} &= {sympy.latex(e.rhs)}" for e in self.all]
        return "\\begin{align*}\n" + " \\\\\n".join(rows) + "\n\\end{align*}"

    def _repr_latex_(self) -> str:
        return f"${self.latex()}$".replace("align*", "aligned")

    def __str__(self) -> str:
        return "\n".join(str(e) for e in self.all)


@dataclass(frozen=True, repr=False)
class _Balances:
    """`rows` (n) = 0, sums in `algebra`; `accelerations` v' and `velocities` v: atoms and sympy forms. `natural`: v are rates of coordinates
    of which M and the rows are functions, without constraints that were solved. `outer`: atoms of inputs, time and multipliers.
    """

    algebra: Algebra
    rows: tuple[Sum, ...]
    accelerations: tuple[int, ...]
    velocities: tuple[int, ...]
    coordinates: tuple[Any, ...]
    natural: bool
    outer: frozenset[int]


def equations(functions: Functions) -> Equations:
    """The equations of motion in coordinates q_<joint>(t) and their derivatives (or v_<joint>(t) where q' is not v).

    Coordinates that follow from others in closed form stand on the left of a relation and nowhere else. Products of sines and cosines are sums
    of waves from the beginning, so that nothing needs to be simplified. Symbols of parameters are positive where their values are, else real.
    Raises `ExportError` for scenes with more terms than one cares to read, `OptionError` for those with latches.
    """
    import sympy

    refuse_modes(functions.outputs.system.mechanics.locks, "equations")

    scene = _Scene(functions)
    if scene.size > _LARGEST:
        raise _too_large(functions)
    try:
        rows = scene.balances()
        motion = _solved(rows) if len(rows.rows) == 1 and not scene.held else None
        if motion is None:
            motion = tuple(sympy.Eq(rows.algebra.to_sympy(row), 0) for row in rows.rows)
        return Equations((*motion, *scene.scalar_rates()), scene.kinematics(), scene.constraints(), rows)
    except TooLarge as error:
        raise _too_large(functions) from error


def _too_large(functions: Functions) -> ExportError:
    return ExportError(
        f"The scene '{functions.outputs.system.flat.name}' is too large for readable equations; use model.functions."
    )


class _Scene:
    """The symbols of a scene, its rows as `SX`, and the sums that they become."""

    def __init__(self, functions: Functions) -> None:
        import sympy

        self.system, self.space = functions.outputs.system, functions.space
        system, space = self.system, self.space
        tree, nq = system.mechanics.tree, system.nq
        self.coordinates, self.velocities = _symbols(system)
        self.kept = [i for i in space.places if nq <= i < nq + tree.v.numel()]
        self.v_dot = ca.SX.sym("v_dot", len(self.kept))
        v = space.put(tree.v)
        L = ca.jacobian(v, system.x[self.kept])
        A = system.constraints.jacobian
        self.held = [k for k in range(A.shape[0]) if not space.put(A[k, :] @ L).is_zero()]
        forces = [sympy.Symbol(f"lambda_{k + 1}") for k in range(len(self.held))]
        multipliers = ca.SX.sym("lambda", len(forces))
        accelerations = L @ self.v_dot + ca.jtimes(v, system.t, ca.SX(1))
        needed = newton_euler(system.mechanics.kinematics, accelerations, list(system.mechanics.wrenches)).tau
        balance = needed - system.forces_at(accelerations)
        self.rows = space.put(L.T @ (balance - A[self.held, :].T @ multipliers if forces else balance))
        self.time = sympy.Symbol("t")
        t = self.time
        parameters = [_parameter(_identifier(functions.outputs.name(p)), p.value) for p in system.flat.parameters]
        constants = [sympy.Symbol(f"c_{k + 1}") for k in range(space.elimination.constants.numel())]
        self.scalar = [sympy.Function(_identifier(functions.outputs.name(s)))(t) for s in system.scalar_states]
        accelerated = [self.velocities[i - nq].diff(t) for i in self.kept]
        inputs = [sympy.Function(_identifier(functions.outputs.name(u)))(t) for u in system.flat.inputs]
        self.groups: list[tuple[ca.SX, list[Any]]] = [
            (tree.q, self.coordinates), (tree.v, self.velocities), (system.x[nq + tree.v.numel() :], self.scalar),
            (system.t, [t]), (space.p, [*parameters, *constants]), (system.u, inputs), (self.v_dot, accelerated), (multipliers, forces),
        ]  # fmt: skip
        self.algebra = Algebra(_BUDGET, _SHOWN)
        for item in system.tree_joints:
            rows = item.edge.joint.invariants(tree.q[item.q], system.t)
            for first in unit_quaternions(rows, tree.q[item.q]).values():
                own = self.coordinates[item.q.start + first : item.q.start + first + 4]
                self.algebra.unit([self.algebra.symbol(name) for name in own])
        self.outer = frozenset(self._place(name) for name in (t, *inputs, *forces, *self.scalar))

    @property
    def size(self) -> int:
        """Instructions of all rows."""
        return ca.Function("size", [column for column, _ in self.groups], [self.rows]).n_instructions()

    def _place(self, name: Any) -> int:
        """The atom of a symbol."""
        ((powers, _, _),) = self.algebra.symbol(name)
        return powers[0][0]

    def sums(self, column: ca.SX) -> list[Sum]:
        """The entries of a column of expressions."""
        if not column.numel():
            return []
        values = [[self.algebra.symbol(name) for name in names] for _, names in self.groups]
        return [_meant(row) for row in _sums(self.algebra, column, [group for group, _ in self.groups], values)]

    def balances(self) -> _Balances:
        """Rows of forces."""
        nq = self.system.nq
        accelerations = tuple(self._place(self.velocities[i - nq].diff(self.time)) for i in self.kept)
        velocities = tuple(self._place(self.velocities[i - nq]) for i in self.kept)
        rates = {c.diff(self.time): c for c in self.coordinates}
        own = [self.velocities[i - nq] for i in self.kept]
        natural = all(v in rates for v in own) and not self.space.elimination.symbols
        rows = _cleaned(self.sums(self.rows), accelerations)
        coordinates = tuple(rates.get(v) for v in own)
        return _Balances(self.algebra, rows, accelerations, velocities, coordinates, natural, self.outer)

    def scalar_rates(self) -> tuple[Any, ...]:
        """Of states that no joint has: currents, speeds of rotors."""
        import sympy

        s = self.system
        found = self.sums(self.space.put(s.x_dot[s.nq + s.tree_velocities :]))
        return tuple(sympy.Eq(x.diff(self.time), self.algebra.to_sympy(r)) for x, r in zip(self.scalar, found, strict=True))

    def kinematics(self) -> tuple[Any, ...]:
        """q' = N v of joints whose velocities are not rates of coordinates."""
        import sympy

        s, kept = self.system, set(self.space.places)
        places = [
            i
            for item in s.tree_joints
            if item.edge.joint.q.size != item.edge.joint.v.size
            for i in range(item.q.start, item.q.stop)
            if i in kept
        ]
        found = self.sums(self.space.put(s.mechanics.tree.rates[places]) if places else ca.SX(0, 1))
        return tuple(
            sympy.Eq(self.coordinates[i].diff(self.time), self.algebra.to_sympy(r)) for i, r in zip(places, found, strict=True)
        )

    def constraints(self) -> tuple[Any, ...]:
        """Coordinates in the others, then what vanishes."""
        import sympy

        system, space = self.system, self.space
        follows = self.sums(_followers(space))
        zero = self.sums(space.constraints(ca.vertcat(system.constraints.position, system.scalar.position, _slips(system))))
        pairs = zip(space.elimination.places, follows, strict=True)
        return (
            *(sympy.Eq(self.coordinates[k], self.algebra.to_sympy(r)) for k, r in pairs),
            *(sympy.Eq(self.algebra.to_sympy(r), 0) for r in zero),
        )


def _sums(algebra: Algebra, column: ca.SX, arguments: Sequence[ca.SX], values: Sequence[Sequence[Sum]]) -> list[Sum]:
    """Instruction by instruction."""
    function = folded_function("rows", list(arguments), [ca.densify(column)])
    results: list[Sum] = [{} for _ in range(column.numel())]
    work: dict[int, Sum] = {}
    waves: dict[int, tuple[Sum, Sum, Sum]] = {}
    table = operations()
    for k in range(function.n_instructions()):
        operation, out, inputs = function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)
        if operation == ca.OP_INPUT:
            work[out[0]] = values[inputs[0]][inputs[1]]
            continue
        if operation == ca.OP_OUTPUT:
            results[out[1]] = work[inputs[0]]
            continue
        if operation == ca.OP_CONST:
            work[out[0]] = algebra.number(function.instruction_constant(k))
            continue
        a = [work[i] for i in inputs]
        if operation in (ca.OP_SIN, ca.OP_COS):
            key = id(a[0])
            if key not in waves:
                waves[key] = (a[0], *algebra.sine_cosine(a[0]))
            work[out[0]] = waves[key][1 if operation == ca.OP_SIN else 2]
        else:
            work[out[0]] = _combined(algebra, operation, a, table)
    return results


def _combined(algebra: Algebra, operation: int, a: list[Sum], table: dict[int, Any]) -> Sum:
    if operation in (ca.OP_ADD, ca.OP_SUB):
        return algebra.add(a[0], a[1], 1.0 if operation == ca.OP_ADD else -1.0)
    if operation == ca.OP_MUL:
        return algebra.multiply(a[0], a[1])
    if operation == ca.OP_DIV:
        return algebra.multiply(a[0], algebra.power(a[1], Fraction(-1)))
    simple = {ca.OP_NEG: -1.0, ca.OP_TWICE: 2.0, ca.OP_ASSIGN: 1.0}
    if operation in simple:
        return algebra.scale(a[0], simple[operation])
    exponents = {ca.OP_SQ: Fraction(2), ca.OP_INV: Fraction(-1), ca.OP_SQRT: Fraction(1, 2)}
    if operation in exponents:
        return algebra.power(a[0], exponents[operation]) if a[0] or exponents[operation] > 0 else {}
    if operation in (ca.OP_POW, ca.OP_CONSTPOW):
        exponent = algebra.to_sympy(a[1])
        if exponent.is_Rational:
            return algebra.power(a[0], Fraction(int(exponent.p), int(exponent.q)))
    if operation not in table:
        raise ExportError(f"An operation (CasADi number {operation}) has no sympy form.")
    return algebra.function(table[operation], *a)


def _meant(row: Sum) -> Sum:
    """Without terms far below others in the same symbols: rounding errors of numbers that were folded before."""
    largest: dict[Any, float] = {}
    for (powers, _, _), (value, _) in row.items():
        largest[powers] = max(largest.get(powers, 0.0), abs(value))
    return {term: value for term, value in row.items() if abs(value[0]) > _ROUNDING * largest[term[0]]}


def _cleaned(rows: list[Sum], accelerations: Sequence[int]) -> tuple[Sum, ...]:
    """Without terms that are rounding errors of numbers that were folded before: far below terms in the same symbols, in this row or another,
    each row measured by the inertia of its own velocity.
    """
    inertia = [
        max((abs(v) for (p, _, _), (v, _) in row.items() if p == ((a, Fraction(1)),)), default=0.0)
        for row, a in zip(rows, accelerations, strict=True)
    ]
    size = [math.sqrt(m) if m > 0 else 1.0 for m in inertia]
    largest: dict[Any, float] = {}
    for row, scale in zip(rows, size, strict=True):
        for (powers, _, _), (value, _) in row.items():
            largest[powers] = max(largest.get(powers, 0.0), abs(value) / scale)
    place = {((a, Fraction(1)),): k for k, a in enumerate(accelerations)}

    def meant(k: int, powers: Any, value: float) -> bool:
        limit = largest[powers] * size[k]
        if powers in place:
            limit = max(limit, size[k] * size[place[powers]])
        return abs(value) > _ROUNDING * limit

    return tuple({term: value for term, value in row.items() if meant(k, term[0], value[0])} for k, row in enumerate(rows))


def _solved(b: _Balances) -> tuple[Any, ...] | None:
    """The one acceleration, if that takes a division at most; None where it does not occur."""
    import sympy

    mass, rest = _split(b.rows[0], b.accelerations[0])
    if not mass:
        return None
    try:
        right = b.algebra.scale(b.algebra.multiply(rest, b.algebra.power(mass, Fraction(-1))), -1.0)
    except TooLarge:
        return None
    form = b.algebra.to_sympy
    value = form(right) if len(mass) == 1 else -form(rest) / form(mass)
    return (sympy.Eq(b.algebra.atoms[b.accelerations[0]], value),)


def _split(row: Sum, atom: int) -> tuple[Sum, Sum]:
    """The factor of an atom that stands alone, and the rest."""
    one = (atom, Fraction(1))
    factor = {
        (tuple(pair for pair in p if pair != one), kind, angle): value for (p, kind, angle), value in row.items() if one in p
    }
    return factor, {term: value for term, value in row.items() if one not in term[0]}


def _matrix_form(b: _Balances) -> MatrixForm:
    import sympy

    n = len(b.rows)
    form = b.algebra.to_sympy
    mass = sympy.zeros(n, n)
    half = sympy.zeros(n, n)
    potential, forces = sympy.zeros(n, 1), sympy.zeros(n, 1)
    velocities = [b.algebra.atoms[k] for k in b.velocities]
    for i, row in enumerate(b.rows):
        rest = row
        for j, atom in enumerate(b.accelerations):
            factor, rest = _split(rest, atom)
            mass[i, j] = form(factor)
        quadratic, still, other = _by_velocity(rest, set(b.velocities), b.outer)
        potential[i], forces[i] = form(still), -form(other)
        for j, atom in enumerate(() if b.natural else b.velocities):
            half[i, j] = form(_half_slope(quadratic, atom))
    coriolis = _christoffel(mass, b.coordinates, velocities) if b.natural else half
    return MatrixForm(mass, coriolis, potential, forces, sympy.Matrix(n, 1, velocities))


def _half_slope(row: Sum, atom: int) -> Sum:
    """Half the derivative by an atom that stands in powers only."""
    found: Sum = {}
    for (powers, kind, angle), (value, error) in row.items():
        n = dict(powers).get(atom, Fraction(0))
        if n:
            left = tuple((i, m - 1 if i == atom else m) for i, m in powers if i != atom or m != 1)
            found[left, kind, angle] = (0.5 * float(n) * value, 0.5 * float(n) * error)
    return found


def _by_velocity(row: Sum, velocities: set[int], outer: frozenset[int]) -> tuple[Sum, Sum, Sum]:
    """Terms quadratic in velocities, terms of positions alone, and all others."""
    parts: tuple[Sum, Sum, Sum] = ({}, {}, {})
    for term, value in row.items():
        atoms = dict(term[0])
        order = sum((n for i, n in atoms.items() if i in velocities), Fraction(0))
        strange = outer & set(atoms) or outer & {i for i, _ in term[2]}
        parts[0 if order == 2 and not strange else 1 if order == 0 and not strange else 2][term] = value
    return parts


def _christoffel(mass: Any, q: Sequence[Any], v: Sequence[Any]) -> Any:
    """C with C_ij = sum over k of (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) v_k / 2."""
    import sympy

    n = mass.rows
    slope = [[[mass[i, j].diff(q[k]) for k in range(n)] for j in range(n)] for i in range(n)]

    def entry(i: int, j: int) -> Any:
        return sympy.expand(sum((slope[i][j][k] + slope[i][k][j] - slope[j][k][i]) * v[k] / 2 for k in range(n)))

    return sympy.Matrix(n, n, entry)


def _symbols(system: ReducedSystem) -> tuple[list[Any], list[Any]]:
    """Coordinates and velocities of the joints as functions of time."""
    import sympy

    t = sympy.Symbol("t")
    coordinates: list[Any] = []
    velocities: list[Any] = []
    for item in system.mechanics.tree.joints:
        name, joint = _identifier(item.edge.name), item.edge.joint
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


def _parameter(name: str, value: float) -> Any:
    """Its symbol, which says that it is positive where it is now: sympy then takes it for its own size."""
    import sympy

    return sympy.Symbol(name, positive=True) if value > 0 else sympy.Symbol(name, real=True)


def _identifier(path: str) -> str:
    """A component path as a name that LaTeX and Python take: `motors[0].torque` is `motors_0_torque`."""
    return re.sub(r"\W+", "_", path).strip("_")


def _indexed(name: str, i: int, count: int) -> str:
    return name if count == 1 else f"{name}_{i + 1}"
