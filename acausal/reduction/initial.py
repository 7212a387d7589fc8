"""Initial values: consistent states from whatever the user says about the start."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NoReturn

import casadi as ca
import numpy as np

from acausal.errors import StartValueError
from acausal.integrators.problem import Directions
from acausal.integrators.rates import Kernel
from acausal.language.connector import Quantity
from acausal.language.expression import Derivative, Expression, Input, Parameter, Symbol, Time
from acausal.mechanics.free import FreeJoint
from acausal.reduction.coordinates import Coordinates, coordinates
from acausal.reduction.start_search import Closing, Found, Search, Target, start_search

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
    """A start value that is met as well as the constraints and the exact values allow.

    Where several cannot all be met, the sum of the squares of the differences, each times its `weight` > 0, is least nearby.
    """

    value: Value
    weight: float = 1.0


Start = Mapping[Expression, Value | exactly | near]


@dataclass(frozen=True)
class Met:
    """One start value: what was asked, what came out."""

    name: str
    wanted: np.ndarray
    got: np.ndarray
    exact: bool
    unit: str = ""
    periodic: bool = False

    @property
    def off(self) -> float:
        """Largest difference; for angles of loops the shortest way round."""
        difference = self.got - self.wanted
        if self.periodic:
            difference = np.remainder(difference + np.pi, 2 * np.pi) - np.pi
        return float(np.max(np.abs(difference), initial=0.0))


@dataclass(frozen=True)
class Account:
    """How a start was found: the search, its data, and what came out for positions and velocities."""

    problem: StartProblem
    data: np.ndarray
    weights: np.ndarray
    positions: Found
    velocities: Found


@dataclass(frozen=True)
class InitialState:
    """Consistent states `x` (nx,) at the start, and how the start values were `met`. Printing it tells how it was found:
    what is off, how far the coordinates moved from the sketch, which loops were closed, which values were not needed.
    """

    x: np.ndarray
    met: tuple[Met, ...]
    account: Account = field(repr=False, compare=False)

    def __str__(self) -> str:
        from acausal.reduction.start_report import start_report

        return start_report(self)


@dataclass(frozen=True)
class StartProblem:
    """Searches for positions, then velocities, from values of the `targets`; made once for their names, used often."""

    outputs: Outputs
    targets: tuple[Target, ...]
    positions: Search
    velocities: Search
    got: Kernel | None
    lock: threading.Lock = field(default_factory=threading.Lock)
    """Kernels serve one thread at a time."""

    @functools.cached_property
    def coordinates(self) -> Coordinates:
        """Kinds and names of the entries of q."""
        r = self.outputs.system
        return coordinates(r.mechanics, r.p, r.p_values, r.q_start, r.scalar.position)

    def scale(self) -> np.ndarray:
        """What is much for each entry of q."""
        return self.coordinates.scale


def initial_state(outputs: Outputs, start: Start, t0: float, p: np.ndarray, u: np.ndarray) -> InitialState:
    """Positions first, then velocities; unspecified velocities are zero where the constraints allow.

    Raises `StartValueError` for a start value that cannot be set or cannot be met, `AssemblyError` when a loop cannot close.
    """
    problem = start_problem(outputs, start)
    wanted, weights, data = start_data(problem, start, t0, p, u)
    with problem.lock:
        found = problem.positions.solve(data, weights, problem.scale)
        if not found.converged:
            _complain(problem.positions, found, data, problem.scale)
        data_v = np.concatenate([data, found.y])
        moving = problem.velocities.solve(data_v, weights)
        if not moving.converged:
            _complain(problem.velocities, moving, data_v, None)
        return finished(problem, wanted, weights, data, found, moving)


def _complain(search: Search, found: Found, data: np.ndarray, scale: Callable[[], np.ndarray] | None) -> NoReturn:
    from acausal.reduction.start_failure import complain

    complain(search, found, data, scale)


def finished(
    problem: StartProblem, wanted: list[np.ndarray], weights: np.ndarray, data: np.ndarray, found: Found, moving: Found
) -> InitialState:
    """The state of found positions and velocities, and what became of the start values; `problem.lock` must be held."""
    x = np.concatenate([found.y, moving.y])
    account = Account(problem, data, weights, found, moving)
    if problem.got is None:
        return InitialState(x, (), account)
    got = problem.got.at(np.concatenate([x, data])).copy()
    met = tuple(Met(t.name, w, got[t.place], t.exact, t.unit, t.periodic) for t, w in zip(problem.targets, wanted, strict=True))
    return InitialState(x, met, account)


def start_problem(outputs: Outputs, start: Start) -> StartProblem:
    """The searches for start values of these variables; made when first asked for. Raises `StartValueError`."""
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
    return problem


def start_data(
    problem: StartProblem, start: Start, t0: float, p: np.ndarray, u: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Start values one by one, the weights of all their entries, and what the searches take: values, t0, inputs, parameters."""
    wanted: list[np.ndarray] = []
    weights = np.ones(problem.targets[-1].place.stop if problem.targets else 0)
    for target, value in zip(problem.targets, start.values(), strict=True):
        wanted.append(_numbers(target, value))
        if isinstance(value, near):
            weights[target.place] = _weight(target, value.weight)
    return wanted, weights, np.concatenate([*wanted, [t0], u, p])


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
    problem = found.account.problem
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
    data = found.account.data
    dq = problem.positions.derivative(found.x[:nq], data, change)
    dv = problem.velocities.derivative(found.x[nq:], np.concatenate([data, found.x[:nq]]), np.vstack([change, dq]))
    return found.x, Directions(np.vstack([dq, dv]), du, dp)


def _start_problem(outputs: Outputs, what: tuple[tuple[Expression, bool], ...]) -> StartProblem:
    r = outputs.system
    q, v = r.x[: r.nq, :], r.x[r.nq :, :]
    targets = _targets(outputs, what)
    size = sum(t.size for t in targets)
    moving = [bool(v.numel()) and ca.depends_on(t.expression, v) for t in targets]
    for target, at_velocity in zip(targets, moving, strict=True):
        if not at_velocity and not (q.numel() and ca.depends_on(target.expression, q)):
            raise StartValueError(f"{target.name} does not depend on the state: it is not free, so it cannot have a start value.")
    wanted = ca.SX.sym("wanted", size)
    data = ca.vertcat(wanted, r.t, r.u, r.p)
    free_q, free_v = _free_orientations(outputs)
    at_q, at_v = ([t for t, m in zip(targets, moving, strict=True) if m is kind] for kind in (False, True))
    position, velocity = _closing(outputs)
    positions = start_search("position", q, data, wanted, position, at_q, r.q_start, free_q)
    velocities = start_search("velocity", v, ca.vertcat(data, q), wanted, velocity, at_v, r.rate_start, free_v)
    got = None
    if targets:
        results = ca.densify(ca.vertcat(*(t.expression for t in targets)))
        got = Kernel.of(ca.Function("got", [ca.vertcat(r.x, data)], [results], {"cse": True}))
    return StartProblem(outputs, tuple(targets), positions, velocities, got)


def _targets(outputs: Outputs, what: tuple[tuple[Expression, bool], ...]) -> list[Target]:
    targets: list[Target] = []
    size = 0
    for key, exact in what:
        for leaf in key.leaves:
            _check_settable(leaf)
        expression = ca.vec(outputs.resolve(key))
        name, unit = (outputs.name(key), key.unit) if isinstance(key, Symbol) else (_named(outputs, key), "")
        targets.append(Target(name, unit, expression, exact, outputs.is_angle(key), slice(size, size + expression.numel())))
        size += expression.numel()
    return targets


def _named(outputs: Outputs, key: Expression) -> str:
    """The expression as CasADi prints it, with the full names of the variables in it."""
    text = key.sx
    for leaf in sorted(key.leaves, key=lambda leaf: leaf.name):
        name, (rows, columns) = outputs.name(leaf), leaf.shape
        places = (
            [""]
            if rows * columns == 1
            else [f"[{i}]" if columns == 1 else f"[{i},{j}]" for j in range(columns) for i in range(rows)]
        )
        text = ca.substitute(text, leaf.sx, ca.reshape(ca.vertcat(*(ca.SX.sym(name + place) for place in places)), rows, columns))
    text = str(text)
    return text if len(text) < 80 else text[:76] + " ..."


def _closing(outputs: Outputs) -> tuple[Closing, Closing]:
    """What positions and velocities must meet in any case: joints' invariants, loops, scalar equations; in the order of `closing`."""
    r = outputs.system
    loops = r.constraints.loops
    joints = [(f"the loop closed by joint '{rows.edge.name}' ({rows.edge.joint.created_at})", rows) for rows in loops]
    free = {s.element_hash() for s in ca.symvar(ca.vertcat(r.x[: r.nq, :], r.t, r.u, r.p))}
    signs = [rows.sign for rows in loops if rows.sign is not None and not rows.sign.is_constant()]
    signs = [s for s in signs if {a.element_hash() for a in ca.symvar(s)} <= free]
    signs += [item.edge.joint.domain(r.x[item.q, :]) for item in r.tree_joints]
    position = (
        ("the joints' own conditions (lengths of quaternions, contacts)", r.constraints.joint_invariants.numel()),
        *((words, rows.position.numel()) for words, rows in joints),
        ("the equations of gears and sources", r.scalar.position.numel()),
    )
    velocity = (
        *((words, rows.velocity.numel()) for words, rows in joints),
        ("the equations of scalar parts", r.scalar.velocity.numel()),
    )
    none = ca.SX(0, 1)
    return Closing(r.closing, position, ca.vertcat(none, *signs)), Closing(r.velocity_closing, velocity, none)


def _free_orientations(outputs: Outputs) -> tuple[list[int], list[int]]:
    """Entries of q and v that are quaternions and angular velocities of free bodies: a body told where to be need not turn."""
    q: list[int] = []
    v: list[int] = []
    for item in outputs.system.tree_joints:
        if isinstance(item.edge.joint, FreeJoint):
            q += range(item.q.start, item.q.start + 4)
            v += range(item.v.start, item.v.start + 3)
    return q, v


def _numbers(target: Target, value: Value | exactly | near) -> np.ndarray:
    number = value.value if isinstance(value, exactly | near) else value
    try:
        wanted = np.asarray(number, dtype=float).ravel(order="F")
    except (TypeError, ValueError):
        raise StartValueError(f"start value of {target.name} is {number!r}, not a number.") from None
    if wanted.size != target.size:
        raise StartValueError(
            f"start value of {target.name} needs {target.size} numbers, not {'one' if wanted.size == 1 else wanted.size}."
        )
    if not np.isfinite(wanted).all():
        raise StartValueError(f"start value of {target.name} is {wanted}. Give finite numbers.")
    return wanted


def _weight(target: Target, weight: object) -> float:
    try:
        number = float(weight)  # pyright: ignore[reportArgumentType]  # users pass anything
    except (TypeError, ValueError):
        number = float("nan")
    if not 0 < number < np.inf:
        raise StartValueError(
            f"start value of {target.name}: the weight is {weight!r}. Give a finite positive number, 1 for no preference."
        )
    return number


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
