"""Initial values: consistent states from whatever the user says about the start."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NoReturn

import casadi as ca
import numpy as np

from acausal.collocation.problem import Directions
from acausal.errors import StartValueError
from acausal.numerics.one_thread import on_one_thread
from acausal.numerics.thresholds import EDGE
from acausal.parts.unit_quaternions import unit_quaternions
from acausal.start.open_derivatives import by_search
from acausal.start.start_problem import StartProblem, start_problem
from acausal.start.start_search import Search
from acausal.start.start_values import Start, near, start_numbers, start_weight
from acausal.start.start_values import exactly as exactly
from acausal.start.unknowns import Found

if TYPE_CHECKING:
    from acausal.outputs.outputs import Outputs

_PLAIN = {float, int, np.float64}
"""Types of start values in which nothing can be wrong but that they are not finite."""


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

    @property
    def x(self) -> np.ndarray:
        """All states of the tree and of scalar parts (nx,)."""
        return np.concatenate([self.positions.y, self.velocities.y])

    def met(self) -> tuple[Met, ...]:
        """One by one."""
        problem, data = self.problem, self.data
        if problem.got is None:
            return ()
        with problem.lock:
            got = problem.got.at(np.concatenate([self.x, data])).copy()
        return tuple(Met(t.name, data[t.place], got[t.place], t.exact, t.unit, t.periodic) for t in problem.targets)


@dataclass(frozen=True)
class InitialState:
    """Consistent states `x` (nx,) at the start, parameters `p` (np,), and how the start values were `met`. Printing it tells how it was found:
    what is off, how far the coordinates moved from the sketch, which loops were closed, which values were not needed.
    """

    x: np.ndarray
    p: np.ndarray
    account: Account = field(repr=False, compare=False)

    @functools.cached_property
    def met(self) -> tuple[Met, ...]:
        """What became of the start values."""
        return self.account.met()

    def __str__(self) -> str:
        from acausal.start.start_report import start_report

        return start_report(self)


@on_one_thread
def initial_state(outputs: Outputs, start: Start, t0: float, p: np.ndarray, u: np.ndarray) -> InitialState:
    """Positions first, then velocities. Of several ways to close loops the one nearest to the sketch, over all joints; unspecified velocities are
    zero where the constraints allow, else least over all joints. What locks hold at the start is closed, too, and moves along, where the start values allow it.

    Raises `StartValueError` for a start value that cannot be set or cannot be met, `AssemblyError` when a loop cannot close.
    """
    held = outputs.system.locks_at_start(u, p)
    found = (_account(outputs, start, t0, p, u, held) if held else None) or _account(outputs, start, t0, p, u)
    assert found is not None
    return finished(found)


def _account(
    outputs: Outputs, start: Start, t0: float, p: np.ndarray, u: np.ndarray, held: tuple[int, ...] = ()
) -> Account | None:
    """Of the search, with these locks closed: None where that is not found with any, an error without."""
    problem = start_problem(outputs, start, held)
    weights, data = start_data(problem, start, t0, p, u)
    with problem.lock:
        found, moving = _searched(problem, data, weights)
        if moving is not None and moving.converged:
            return Account(problem, data, weights, found, moving)
        if not held:
            if moving is None:
                _check_lengths(problem, data)
                _complain(problem.positions, found, data)
            _complain(problem.velocities, moving, np.concatenate([data, found.y]))
    return None


def _searched(problem: StartProblem, data: np.ndarray, weights: np.ndarray) -> tuple[Found, Found | None]:
    """Positions, and velocities where these were found: if not next to a place where branches of the motion cross, then there."""
    found = problem.positions.solve(data, weights)
    if not found.converged:
        return found, None
    moving = problem.velocities.solve(np.concatenate([data, found.y]), weights)
    there = None if moving.converged else problem.positions.at_meeting(found, data)
    if there is not None:
        crossing = problem.velocities.solve(np.concatenate([data, there.y]), weights)
        if crossing.converged:
            return there, crossing
    return found, moving


def _check_lengths(problem: StartProblem, data: np.ndarray) -> None:
    """Raises `StartValueError` for a quaternion that is given, and that no rotation has."""
    r = problem.outputs.system
    q = r.x[: r.nq, :]
    for at in unit_quaternions(r.constraints.joint_invariants, q).values():
        for target in problem.targets:
            own = target.expression[:4, :] if target.expression.numel() >= 4 else ca.SX(0, 1)
            length = float(np.linalg.norm(data[target.place][:4]))
            if target.exact and own.numel() and ca.is_equal(own, q[at : at + 4, :]) and abs(length - 1) > EDGE:
                raise StartValueError(
                    f"start value of {target.name}: its quaternion {np.array2string(data[target.place][:4], separator=', ')} has the length {length:.6g}, and that of "
                    "a rotation has 1. Divide it by that, or say how frame_b.rotation is in another way."
                )


def _complain(search: Search, found: Found, data: np.ndarray) -> NoReturn:
    from acausal.start.start_failure import complain

    complain(search, found, data)


def finished(account: Account) -> InitialState:
    """The state of found positions and velocities."""
    problem, data = account.problem, account.data
    return InitialState(account.x, data[data.size - problem.outputs.system.p_values.size :], account)


def start_data(problem: StartProblem, start: Start, t0: float, p: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The weights of all entries of the start values, and what the searches take: these values, t0, inputs, parameters."""
    values, weights = start.values(), np.ones(problem.size)
    if problem.scalars and _PLAIN.issuperset(map(type, values)) and np.isfinite(numbers := np.array(list(values), float)).all():
        return weights, np.concatenate([numbers, [t0], u, p])
    wanted: list[np.ndarray] = []
    for target, value in zip(problem.targets, values, strict=True):
        wanted.append(start_numbers(target, value))
        if isinstance(value, near):
            weights[target.place] = start_weight(target, value.weight)
    return weights, np.concatenate([*wanted, [t0], u, p])


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

    What start values do not determine changes as the start that is found does, to about 1e-8. Errors as for `initial_state`.
    """
    found = initial_state(outputs, start, t0, p, u)
    problem = found.account.problem
    n = problem.size
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
    with_q = np.concatenate([data, found.x[:nq]])
    dq = problem.positions.derivative(found.x[:nq], data, change)
    dv = problem.velocities.derivative(found.x[nq:], with_q, np.vstack([change, dq]))
    open_q, sizes_q = problem.positions.left_open(found.x[:nq], data)
    open_v, sizes_v = problem.velocities.left_open(found.x[nq:], with_q)

    def again(data: np.ndarray) -> np.ndarray | None:
        with problem.lock:
            positions, velocities = _searched(problem, data, found.account.weights)
        return np.concatenate([positions.y, velocities.y]) if velocities is not None and velocities.converged else None

    def moving(with_q: np.ndarray) -> np.ndarray | None:
        """Where positions are determined: these follow, and only velocities are searched for."""
        with problem.lock:
            velocities = problem.velocities.solve(with_q, found.account.weights)
        return np.concatenate([with_q[data.size :], velocities.y]) if velocities.converged else None

    given = [i for i, _ in problem.positions.plain] + [nq + i for i, _ in problem.velocities.plain]
    for k in range(count if open_q.size or open_v.size else 0):
        least = np.concatenate([dq[:, k], dv[:, k]])
        if not np.delete(least, given).any():
            continue  # nothing else has to move
        sizes = np.concatenate([sizes_q, sizes_v])
        if open_q.size:
            searched = by_search(again, data, change[:, k], least, sizes)
        else:
            searched = by_search(moving, with_q, np.append(change[:, k], dq[:, k]), least, sizes)
        if searched is not None:
            dq[:, k] += open_q @ (np.linalg.pinv(open_q) @ (searched[:nq] - dq[:, k]))
            both = np.concatenate([change[:, k], dq[:, k]])[:, None]
            dv[:, k] = problem.velocities.derivative(found.x[nq:], with_q, both)[:, 0]
            dv[:, k] += open_v @ (np.linalg.pinv(open_v) @ (searched[nq:] - dv[:, k]))
    return found.x, Directions(np.vstack([dq, dv]), du, dp)
