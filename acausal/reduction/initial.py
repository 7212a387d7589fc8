"""Initial values: consistent states from whatever the user says about the start."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from acausal.errors import StartValueError
from acausal.integrators.problem import Directions
from acausal.integrators.rates import Kernel
from acausal.language.connector import Quantity
from acausal.language.expression import Derivative, Expression, Input, Parameter, Symbol, Time
from acausal.mechanics.free import FreeJoint
from acausal.reduction.assembly import Residual, assemble

if TYPE_CHECKING:
    from acausal.reduction.outputs import Outputs

_KEPT = 64
Value = float | Sequence[float] | np.ndarray


@dataclass(frozen=True)
class exactly:
    """A start value that must be met; a plain number means the same."""

    value: Value


@dataclass(frozen=True)
class near:
    """A start value that is met as well as the constraints and the exact values allow."""

    value: Value


Start = Mapping[Expression, Value | exactly | near]


@dataclass(frozen=True)
class Met:
    """One start value: what was asked, what came out."""

    name: str
    wanted: np.ndarray
    got: np.ndarray
    exact: bool


@dataclass(frozen=True)
class InitialState:
    """Consistent states at the start, and how the start values were met."""

    x: np.ndarray
    met: tuple[Met, ...]

    def __str__(self) -> str:
        rows = [f"  {m.name:<24} {'exactly' if m.exact else 'near':<8} wanted {m.wanted}  got {m.got}" for m in self.met]
        return "\n".join(["start:", *rows])


@dataclass(frozen=True)
class _Target:
    """A variable or expression with a start value, column by column; `place`: of its value among all start values."""

    name: str
    expression: ca.SX
    exact: bool
    periodic: bool
    place: slice


@dataclass(frozen=True)
class StartProblem:
    """The search for consistent states from start values of certain variables, whatever the values; made once, used often."""

    targets: tuple[_Target, ...]
    positions: _Search
    velocities: _Search
    got: Kernel | None
    lock: threading.Lock = field(default_factory=threading.Lock)
    """Kernels serve one thread at a time."""


def initial_state(outputs: Outputs, start: Start, t0: float, p: np.ndarray, u: np.ndarray) -> InitialState:
    """Positions first, then velocities; unspecified velocities are zero where the constraints allow.

    Raises `StartValueError` for a start value that cannot be set or cannot be met, `AssemblyError` when a loop cannot close.
    """
    for key in start:
        if not isinstance(key, Expression):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass names and indices
            raise StartValueError(
                f"start: the key {key!r} is not a variable. Use the variable itself, e.g. start={{scene.hinge.q: 0.3}}."
            )
    known = outputs.start_problems
    what = tuple((key, not isinstance(value, near)) for key, value in start.items())
    problem = known.get(what)
    if problem is None:
        if len(known) >= _KEPT:
            known.clear()
        problem = known[what] = _start_problem(outputs, what)
    wanted = [_numbers(target, value) for target, value in zip(problem.targets, start.values(), strict=True)]
    flat = np.concatenate([*wanted, [t0], u, p])
    with problem.lock:
        q0 = problem.positions.solve(flat)
        v0 = problem.velocities.solve(np.concatenate([flat, q0]))
        x = np.concatenate([q0, v0])
        if problem.got is None:
            return InitialState(x, ())
        got = problem.got.at(np.concatenate([x, flat])).copy()
    return InitialState(x, tuple(Met(t.name, w, got[t.place], t.exact) for t, w in zip(problem.targets, wanted, strict=True)))


def initial_derivatives(
    outputs: Outputs,
    start: Start,
    t0: float,
    p: np.ndarray,
    u: np.ndarray,
    starts: Sequence[int | None],
    inputs: Sequence[int | None],
    parameters: Sequence[int | None],
) -> tuple[np.ndarray, Directions]:
    """The consistent start x (nx,), and its derivatives: a column for each entry of the three lists, which have the same length and
    name one place each: among the start values, the inputs, the parameters.

    States that start values do not determine change as little as the constraints allow. Errors as for `initial_state`.
    """
    found = initial_state(outputs, start, t0, p, u)
    problem = outputs.start_problems[tuple((key, not isinstance(value, near)) for key, value in start.items())]
    n = sum(met.wanted.size for met in found.met)
    count = len(starts)
    du, dp, change = np.zeros((u.size, count)), np.zeros((p.size, count)), np.zeros((n + 1 + u.size + p.size, count))
    for k, (at, i, j) in enumerate(zip(starts, inputs, parameters, strict=True)):
        if at is not None:
            change[at, k] = 1.0
        if i is not None:
            du[i, k] = change[n + 1 + i, k] = 1.0
        if j is not None:
            dp[j, k] = change[n + 1 + u.size + j, k] = 1.0
    nq = outputs.system.nq
    data = np.concatenate([*(met.wanted for met in found.met), [t0], u, p])
    dq = problem.positions.derivative(found.x[:nq], data, change)
    dv = problem.velocities.derivative(found.x[nq:], np.concatenate([data, found.x[:nq]]), np.vstack([change, dq]))
    return found.x, Directions(np.vstack([dq, dv]), du, dp)


def _start_problem(outputs: Outputs, what: tuple[tuple[Expression, bool], ...]) -> StartProblem:
    r = outputs.system
    q, v = r.x[: r.nq, :], r.x[r.nq :, :]
    targets: list[_Target] = []
    size = 0
    for key, exact in what:
        for leaf in key.leaves:
            _check_settable(leaf)
        expression = ca.vec(outputs.resolve(key))
        name = outputs.name(key) if isinstance(key, Symbol) else repr(key)
        targets.append(_Target(name, expression, exact, outputs.is_angle(key), slice(size, size + expression.numel())))
        size += expression.numel()
    moving = [bool(v.numel()) and ca.depends_on(t.expression, v) for t in targets]
    for target, at_velocity in zip(targets, moving, strict=True):
        if not at_velocity and not (q.numel() and ca.depends_on(target.expression, q)):
            raise StartValueError(f"{target.name} does not depend on the state: it is not free, so it cannot have a start value.")
    wanted = ca.SX.sym("wanted", size)
    data = ca.vertcat(wanted, r.t, r.u, r.p)
    free_q, free_v = _free_orientations(outputs)
    at_q, at_v = ([t for t, m in zip(targets, moving, strict=True) if m is kind] for kind in (False, True))
    positions = _search(q, data, wanted, r.closing, at_q, r.q_start, "position", free_q)
    velocities = _search(v, ca.vertcat(data, q), wanted, r.velocity_closing, at_v, r.rate_start, "velocity", free_v)
    got = None
    if targets:
        results = ca.densify(ca.vertcat(*(t.expression for t in targets)))
        got = Kernel.of(ca.Function("got", [ca.vertcat(r.x, data)], [results], {"cse": True}))
    return StartProblem(tuple(targets), positions, velocities, got)


def _free_orientations(outputs: Outputs) -> tuple[list[int], list[int]]:
    """Entries of q and v that are quaternions and angular velocities of free bodies: a body told where to be need not turn."""
    q: list[int] = []
    v: list[int] = []
    for item in outputs.system.tree_joints:
        if isinstance(item.edge.joint, FreeJoint):
            q += range(item.q.start, item.q.start + 4)
            v += range(item.v.start, item.v.start + 3)
    return q, v


def _numbers(target: _Target, value: Value | exactly | near) -> np.ndarray:
    number = value.value if isinstance(value, exactly | near) else value
    size = target.place.stop - target.place.start
    try:
        wanted = np.asarray(number, dtype=float).ravel(order="F")
    except (TypeError, ValueError):
        raise StartValueError(f"start value of {target.name} is {number!r}, not a number.") from None
    if wanted.size != size:
        raise StartValueError(
            f"start value of {target.name} needs {size} numbers, not {'one' if wanted.size == 1 else wanted.size}."
        )
    if not np.isfinite(wanted).all():
        raise StartValueError(f"start value of {target.name} is {wanted}. Give finite numbers.")
    return wanted


def _check_settable(leaf: Symbol) -> None:
    if isinstance(leaf, Parameter):
        raise StartValueError(f"{leaf.name} is a parameter, not a state: give it by parameters={{...}}.")
    if isinstance(leaf, Input):
        raise StartValueError(f"{leaf.name} is an input, not a state: give it by inputs={{...}}.")
    if isinstance(leaf, Time):
        raise StartValueError("time cannot have a start value; give t0.")
    if isinstance(leaf, Derivative) or (
        isinstance(leaf, Quantity) and leaf.name in ("force", "torque", "acceleration", "angular_acceleration")
    ):
        raise StartValueError(f"{leaf.name} follows from the equations of motion and is not free: it cannot have a start value.")


@dataclass(frozen=True)
class _Search:
    """Looks for y with `constraints(y, data)` = 0 that keeps to wishes and to the start `guess`.

    `plain`: pairs of a place in y and a place among the start values that is its value. `settled`: the values say it all.
    """

    constraints: Kernel | None
    wishes: Kernel | None
    closing: int
    exact: tuple[_Target, ...]
    guess: np.ndarray
    plain: tuple[tuple[int, int], ...]
    settled: bool
    what: str
    residual: ca.Function | None = None

    @property
    def stride(self) -> float:
        """Velocities enter linearly, so the search may go anywhere at once."""
        return np.inf if self.what == "velocity" else 0.7

    def solve(self, data: np.ndarray) -> np.ndarray:
        """y (n,) for start values, time, inputs and parameters `data`."""
        first = self.guess.copy()
        for i, k in self.plain:
            first[i] = data[k]
        if self.settled or self.constraints is None:
            return first
        data = np.concatenate([data, first])
        hard = _residual(self.constraints, first.size, data)
        soft = None if self.wishes is None else _residual(self.wishes, first.size, data)
        found = assemble(hard, first, soft, stride=self.stride)
        rng = np.random.default_rng(0)
        for attempt in range(8):
            if found.converged:
                return found.y
            trial = assemble(hard, first + rng.normal(scale=0.1 * 1.5**attempt, size=first.size), soft, stride=self.stride)
            found = trial if trial.converged or trial.gap < found.gap else found
        raise StartValueError(self._complaint(hard(found.y)[0], data))

    def derivative(self, y: np.ndarray, data: np.ndarray, change: np.ndarray) -> np.ndarray:
        """dy (n, k) when the data change by the columns of `change` (size of data, k): the start values that y repeats, and then the
        least change that keeps the constraints.
        """
        first = np.zeros((y.size, change.shape[1]))
        for i, k in self.plain:
            first[i] = change[k]
        if self.settled or self.residual is None:
            return first
        J, by_data = (
            np.array(part) for part in self.residual.factory("slopes", ["y", "data"], ["jac:c:y", "jac:c:data"])(y, data)
        )
        return first - np.linalg.pinv(J, rcond=1e-9) @ (J @ first + by_data @ change)

    def _complaint(self, residual: np.ndarray, data: np.ndarray) -> str:
        n = self.closing
        gaps: list[str] = []
        for target in self.exact:
            size = target.place.stop - target.place.start
            gap = float(np.max(np.abs(residual[n : n + size])))
            gaps.append(f"{target.name} = {data[target.place]} (off by {gap:.3g})")
            n += size
        return (
            f"The {self.what} start values contradict each other or the constraints: {'; '.join(gaps) or 'none was given'}; the constraints are "
            f"open by {float(np.max(np.abs(residual[: self.closing]), initial=0.0)):.3g}. Give fewer exact values, or soften some with ac.near(...)."
        )


def _search(
    y: ca.SX,
    data: ca.SX,
    wanted: ca.SX,
    closing: ca.SX,
    targets: list[_Target],
    guess: np.ndarray,
    what: str,
    kept: list[int],
) -> _Search:
    """`kept`: entries of y that rather stay as they are than make up for others."""
    exact = [t for t in targets if t.exact]
    wished = [t for t in targets if not t.exact]
    place = {y[i].element_hash(): i for i in range(y.numel())}
    plain: list[tuple[int, int]] = []
    for target in exact + wished:
        for k in range(target.expression.numel()):
            entry = target.expression[k]
            if entry.is_symbolic() and entry.element_hash() in place:
                plain.append((place[entry.element_hash()], target.place.start + k))
    entries = sum(t.expression.numel() for t in exact)
    settled = not closing.numel() and not wished and len({i for i, _ in plain}) == len(plain) == entries
    if y.numel() == 0 or settled:
        return _Search(None, None, 0, (), guess, tuple(plain), True, what)
    first = ca.SX.sym("first", y.numel())
    data = ca.vertcat(data, first)
    hard = ca.vertcat(closing, *(_difference(t, wanted) for t in exact))
    stay = y[kept] - first[kept] if kept and targets else ca.SX(0, 1)
    soft = ca.vertcat(stay, *(_difference(t, wanted) for t in wished))
    wishes = _with_jacobian(y, data, soft) if soft.numel() else None
    residual = ca.Function("residual", [y, data[: data.numel() - y.numel()]], [hard], ["y", "data"], ["c"])
    return _Search(
        _with_jacobian(y, data, hard), wishes, closing.numel(), tuple(exact), guess, tuple(plain), False, what, residual
    )


def _difference(target: _Target, wanted: ca.SX) -> ca.SX:
    difference = target.expression - wanted[target.place]
    return ca.atan2(ca.sin(difference), ca.cos(difference)) if target.periodic else difference


def _with_jacobian(y: ca.SX, data: ca.SX, residual: ca.SX) -> Kernel:
    """(y, data) -> residual, and its Jacobian column by column, in one column."""
    both = ca.vertcat(ca.densify(residual), ca.vec(ca.densify(ca.jacobian(residual, y))))
    return Kernel.of(ca.Function("residual", [ca.vertcat(y, data)], [both], {"cse": True}))


def _residual(kernel: Kernel, n: int, data: np.ndarray) -> Residual:
    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        both = kernel.at(np.concatenate([point, data])).copy()
        m = both.size // (n + 1)
        return both[:m], both[m:].reshape(n, m).T

    return evaluate
