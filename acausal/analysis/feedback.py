"""Linear-quadratic regulators and Kalman filters: at an equilibrium, and along a motion.

Bryson and Ho: Applied Optimal Control (1975), chapters 5 and 12.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from acausal.analysis.linearize import Linearization, Matrices, linear_around
from acausal.analysis.point import OperatingPoint
from acausal.errors import OptionError
from acausal.language.expression import Expression, Mode
from acausal.numerics.one_thread import on_one_thread
from acausal.numerics.thresholds import EDGE, ROUNDING
from acausal.outputs.expression_names import labels
from acausal.outputs.functions import Functions
from acausal.wording import counted

if TYPE_CHECKING:
    from acausal.simulate.trajectory import Trajectory

Weights = Mapping[Any, Any] | Sequence[Any] | np.ndarray | float
"""{expression: weight}, or a number, a column or a matrix of weights for states or inputs."""

_PIECES, _SAMPLES = 4, 41
"""Pieces of a motion with independent coordinates of their own, and samples of the gain in each."""
_GAUSS = 0.5 - 3**0.5 / 6, 0.5 + 3**0.5 / 6
"""Of each step."""
_HIDDEN = 1e-9
"""Of the largest singular value: a mode that inputs do not move, or outputs do not see."""


@dataclass(frozen=True, eq=False, repr=False)
class Regulator:
    """u = u0 - K (x - x0): inputs that keep a motion, or an equilibrium, at the least integral of y' Q y + du' R du for small deviations.

    `times` (n,) [s]: one where it does not change. `gains` (n, nu, nx), for all states of the model; `costs` (n, k, k): what is left to pay, by the deviations that
    `expand` (n, nx, k) turns into states. `states` (n, nx), `inputs` (n, nu): of the motion at these times, and `motion` (t) -> both, in between. `eigenvalues` (k,) of the
    closed loop, where it does not change.
    """

    times: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    motion: Callable[[float], tuple[np.ndarray, np.ndarray]]
    gains: np.ndarray
    costs: np.ndarray
    expand: np.ndarray
    eigenvalues: np.ndarray | None

    def __call__(self, x: Any, t: float = 0.0) -> np.ndarray:
        """Inputs (nu,) for states x (nx,) at a time [s]."""
        there, given = self.motion(t)
        return given - self.gain(t) @ (np.asarray(x, dtype=float) - there)

    def gain(self, t: float = 0.0) -> np.ndarray:
        """K (nu, nx) at a time [s]."""
        return self._gains(t)

    @functools.cached_property
    def _gains(self) -> Callable[[float], np.ndarray]:
        return _between(self.times, self.gains)

    def __repr__(self) -> str:
        return f"<Regulator: {counted(self.gains.shape[1], 'input')} from {counted(self.gains.shape[2], 'state')}, {_when(self.times, self.eigenvalues)}>"

    def cost(self, x: Any, k: int = 0) -> float:
        """What is left to pay from states x (nx,) on, at the sample k."""
        away = np.linalg.lstsq(self.expand[k], np.asarray(x, dtype=float) - self.states[k], rcond=None)[0]
        return float(away @ self.costs[k] @ away)


@dataclass(frozen=True, eq=False, repr=False)
class Filter:
    """dx^ = f(x^, u) + L (y - y^): the states most likely by what has been measured, for small deviations from a motion or an equilibrium.

    `times` (n,) [s]; `gains` (n, nx, ny); `covariances` (n, nx, nx) of the error of the states. `eigenvalues` (k,) of the error, where it does not change.
    """

    times: np.ndarray
    gains: np.ndarray
    covariances: np.ndarray
    eigenvalues: np.ndarray | None

    def gain(self, t: float = 0.0) -> np.ndarray:
        """L (nx, ny) at a time [s]."""
        return self._gains(t)

    def __repr__(self) -> str:
        return f"<Filter: {counted(self.gains.shape[1], 'state')} from {counted(self.gains.shape[2], 'measurement')}, {_when(self.times, self.eigenvalues)}>"

    @functools.cached_property
    def _gains(self) -> Callable[[float], np.ndarray]:
        return _between(self.times, self.gains)


def _when(times: np.ndarray, eigenvalues: np.ndarray | None) -> str:
    """In words: how fast errors decay, or along what."""
    if eigenvalues is None:
        return f"from {times[0]:g} to {times[-1]:g} s"
    return f"errors decay by {-np.max(np.real(eigenvalues), initial=-np.inf):.4g} / s at least"


def _between(times: np.ndarray, values: np.ndarray) -> Callable[[float], np.ndarray]:
    """A cubic spline, which stays as it ends."""
    import scipy.interpolate

    if times.size == 1:
        return lambda t: values[0]
    spline: Any = scipy.interpolate.CubicSpline(times, values)
    return lambda t: spline(np.clip(t, times[0], times[-1]))


def lqr(of: Any, Q: Weights, R: Weights, *, end: Weights | None = None) -> Regulator:
    """The regulator of a `Linearization`, or along a `Trajectory` (or what has one as `run`).

    `Q`: weights of states, of the linearization's own or, with a dictionary, of the expressions that a trajectory can read; none negative. `R`: of inputs, all
    positive. Along a trajectory `end` weighs what is left at its end, `Q` unless given. Raises `OptionError` where inputs cannot steady what is weighed.

        hold = ac.lqr(model.linearize({s.hinge.q: np.pi}), Q=[10, 50, 1, 1], R=0.1)
        follow = ac.lqr(best.run, {s.hinge.q: 50, s.rail.q: 10}, {s.force: 0.01})
    """
    if isinstance(of, Linearization):
        return _steady_regulator(of, Q, R)
    along = _Along(_trajectory(of, "lqr"), "lqr")
    weighed, weights = along.weighed(Q, "Q")
    left, final = (weighed, weights) if end is None else along.weighed(end, "end")
    S = along.of_inputs(R, "R")

    def hamiltonian(m: Matrices) -> np.ndarray:
        C, B = along.rows(m, weighed), m.B[:, : len(S)]
        return np.block([[m.A, -B @ np.linalg.solve(S, B.T)], [-C.T @ weights @ C, -m.A.T]])

    def last(m: Matrices) -> np.ndarray:
        C = along.rows(m, left)
        return C.T @ final @ C

    pieces = along.solved(hamiltonian, last, [*weighed, *left], backward=True)
    gains = [np.linalg.solve(S, m.B[:, : len(S)].T @ P) @ np.linalg.pinv(along.expand(m, at)) for at, m, P in pieces]
    points = [at for at, _, _ in pieces]
    expand = np.array([along.expand(m, at) for at, m, _ in pieces])
    return Regulator(
        np.array([at.t for at in points]), np.array([along.x(at) for at in points]), np.array([at.u[: len(S)] for at in points]), along.motion,
        np.array(gains), np.array([P for _, _, P in pieces]), expand, None,
    )  # fmt: skip


def kalman(
    of: Any, outputs: Sequence[Expression] | None, disturbance: Weights, noise: Weights, *, start: np.ndarray | float = 0.0
) -> Filter:
    """The filter of a `Linearization`, whose outputs are measured (`outputs` None), or of `outputs` measured along a `Trajectory`.

    `disturbance`: intensities of white noise on the inputs [unit^2 s]; `noise`: of what is measured. `start`: covariance of the deviations at the start of
    the trajectory, or their variance. Raises `OptionError` where the outputs cannot see what drifts.
    """
    if isinstance(of, Linearization):
        return _steady_filter(of, disturbance, noise)
    along = _Along(_trajectory(of, "kalman"), "kalman")
    seen = list(outputs or ())
    if not seen:
        raise OptionError("kalman: say what is measured along the trajectory: kalman(run, [scene.hinge.q], ...).")
    W = along.of_inputs(disturbance, "disturbance")
    size = sum(along.functions.outputs.resolve(one).numel() for one in seen)
    V = _matrix(noise, size, "kalman: noise", positive=True)

    def hamiltonian(m: Matrices) -> np.ndarray:
        C, B = along.rows(m, seen), m.B[:, : len(W)]
        return np.block([[-m.A.T, C.T @ np.linalg.solve(V, C)], [B @ W @ B.T, m.A]])

    def first(m: Matrices) -> np.ndarray:
        given = np.asarray(start, dtype=float)
        return given * np.eye(len(m.A)) if given.ndim == 0 else given

    pieces = along.solved(hamiltonian, first, seen, backward=False)
    gains: list[np.ndarray] = []
    spread: list[np.ndarray] = []
    for at, m, P in pieces:
        E = along.expand(m, at)
        gains.append(E @ P @ along.rows(m, seen).T @ np.linalg.inv(V))
        spread.append(E @ P @ E.T)
    return Filter(np.array([at.t for at, _, _ in pieces]), np.array(gains), np.array(spread), None)


def _steady_regulator(of: Linearization, Q: Weights, R: Weights) -> Regulator:
    import scipy.linalg

    _check_steady(of, "lqr")
    weights = _matrix(Q, len(of.states), "lqr: Q", positive=False)
    S = _matrix(R, len(of.inputs), "lqr: R", positive=True)
    _check_moved(of.A, of.B, of.states, "lqr: no input moves")
    try:
        P = scipy.linalg.solve_continuous_are(of.A, of.B, weights, S, balanced=True)
    except np.linalg.LinAlgError:
        raise OptionError(
            "lqr: there is no regulator: a mode that neither grows nor decays is not weighed. Give all states a weight in Q."
        ) from None
    K = np.linalg.solve(S, of.B.T @ P)
    gains = K @ np.linalg.pinv(of.expand)
    here = of.point.x, of.point.u[: len(S)]
    return Regulator(
        np.array([of.point.t]), here[0][None], here[1][None], lambda t: here, gains[None], P[None], of.expand[None], np.linalg.eigvals(of.A - of.B @ K)
    )  # fmt: skip


def _steady_filter(of: Linearization, disturbance: Weights, noise: Weights) -> Filter:
    import scipy.linalg

    _check_steady(of, "kalman")
    W = _matrix(disturbance, len(of.inputs), "kalman: disturbance", positive=False)
    V = _matrix(noise, len(of.outputs), "kalman: noise", positive=True)
    _check_moved(of.A.T, of.C.T, of.states, "kalman: no output sees")
    try:
        P = scipy.linalg.solve_continuous_are(of.A.T, of.C.T, of.B @ W @ of.B.T, V, balanced=True)
    except np.linalg.LinAlgError:
        raise OptionError(
            "kalman: there is no filter: a mode that neither grows nor decays is not disturbed. Give all inputs a disturbance, or add one where it acts."
        ) from None
    L = P @ of.C.T @ np.linalg.inv(V)
    return Filter(
        np.array([of.point.t]), (of.expand @ L)[None], (of.expand @ P @ of.expand.T)[None], np.linalg.eigvals(of.A - L @ of.C)
    )


def _check_steady(of: Linearization, what: str) -> None:
    if not of.constant:
        raise OptionError(
            f"{what}: the linear system changes along the motion through this point. Give a trajectory, {what}(run, ...), or an equilibrium: model.equilibrium(...)."
        )


def _check_moved(A: np.ndarray, B: np.ndarray, names: Sequence[str], what: str) -> None:
    """Raises `OptionError` for what does not decay by itself and is not moved by B (Hautus)."""
    for value in np.linalg.eigvals(A):
        if value.real < -_HIDDEN * np.linalg.norm(A):
            continue
        both = np.hstack([A - value * np.eye(len(A)), B])
        size = np.linalg.norm(both, axis=1)
        U, s, _ = np.linalg.svd(both / np.where(size > 0, size, 1.0)[:, None])
        if s[-1] < _HIDDEN * s[0]:
            shares = np.abs(U[:, -1])
            parts = [name for name, share in zip(names, shares, strict=True) if share > 0.1 * shares.max()]
            raise OptionError(f"{what} {', '.join(parts)} together, which does not decay by itself (eigenvalue {value:.3g} 1/s).")


def _matrix(given: Any, size: int, what: str, *, positive: bool) -> np.ndarray:
    """(size, size) from a number, a column, or itself. Raises `OptionError`."""
    try:
        value = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise OptionError(f"{what} is {given!r}: give numbers.") from None
    if value.ndim == 0:
        value = np.full(size, float(value))
    value = np.diag(value) if value.ndim == 1 else value
    wrong = OptionError(
        f"{what} must be a number, {size} numbers, or a symmetric matrix ({size}, {size}), not of shape {value.shape}."
    )
    if value.shape != (size, size) or not np.isfinite(value).all():
        raise wrong
    own = np.sqrt(np.abs(np.diag(value)))  # rows may have any unit
    parts = np.divide(value, np.outer(own, own), out=np.sign(value), where=np.outer(own, own) > 0)
    if np.max(np.abs(parts - parts.T), initial=0.0) > EDGE:
        raise wrong
    least = float(np.min(np.linalg.eigvalsh(parts), initial=np.inf))
    if least < -EDGE or (positive and least <= ROUNDING):
        least = float(np.min(np.linalg.eigvalsh(value)))
        raise OptionError(f"{what} must {'be positive' if positive else 'not be negative'}; its least eigenvalue is {least:.3g}.")
    return value


def _trajectory(of: Any, what: str) -> Trajectory:
    run = getattr(of, "run", of)
    if not hasattr(run, "solution"):
        raise OptionError(
            f"{what}: give a linearization, model.linearize(...), or a trajectory, model.simulate(...), not {of!r}."
        )
    return run


@on_one_thread
def _riccati(times: np.ndarray, hamiltonians: np.ndarray, P: np.ndarray) -> np.ndarray:
    """P (k, k) at the first of the times (n,), which may go back -> at all of them (n, k, k): P = Y X^-1, where (X, Y)' = H (X, Y) with H (n, 2 k, 2 k) at the times, and between
    them by cubic splines. Davison and Maki: The numerical solution of the matrix Riccati differential equation (1973); exponentials of Magnus' fourth order.
    """
    import scipy.interpolate
    import scipy.linalg

    k = len(P)
    lapack: Any = scipy.linalg.lapack
    size = lapack.dgebal(np.max(np.abs(hamiltonians), axis=0), scale=1, permute=0)[3]
    H = hamiltonians * size / size[:, None]
    fastest = float(np.max(np.abs(np.linalg.eigvals(H))))
    parts = 1 + int(fastest * np.max(np.abs(np.diff(times))))
    along = np.sign(times[-1] - times[0])
    at: Any = scipy.interpolate.CubicSpline(along * times, H)
    nodes = np.interp(np.arange(parts * (times.size - 1) + 1) / parts, np.arange(times.size), times)
    h = np.diff(nodes)[:, None, None]
    one, two = (at(along * (nodes[:-1] + c * h.ravel())) for c in _GAUSS)
    steps = scipy.linalg.expm(h / 2 * (one + two) + 3**0.5 / 12 * h**2 * (two @ one - one @ two))
    found, now = [P], P * size[:k] / size[k:, None]
    for count, step in enumerate(steps, 1):
        X, Y = np.vsplit(step @ np.vstack([np.eye(k), now]), 2)
        now = np.linalg.solve(X.T, Y.T).T
        if count % parts == 0:
            there = now * size[k:, None] / size[:k]
            found.append((there + there.T) / 2)
    return np.array(found)


class _Along:
    """The linear systems of deviations from a run."""

    def __init__(self, run: Trajectory, what: str) -> None:
        from acausal.reduce.state_space import whole_state_space

        self.run, self.what, self.functions = run, what, run.functions
        self.whole = Functions(self.functions.outputs, whole_state_space(self.functions.outputs.system))
        self._wanted: list[Expression] = []

    @functools.cached_property
    def inputs(self) -> list[Any]:
        """Those that users give."""
        return [i for i in self.functions.outputs.system.flat.inputs if not isinstance(i, Mode)]

    def of_inputs(self, given: Weights, name: str) -> np.ndarray:
        """Weights (nu, nu)."""
        value: Any = given
        if isinstance(given, Mapping):
            known = dict(self.functions.outputs.system.flat.symbols(given))
            lacking = [self.functions.outputs.name(i) for i in self.inputs if i not in known]
            if lacking:
                raise OptionError(f"{self.what}: {name} says nothing of {', '.join(lacking)}.")
            value = [float(known[i]) for i in self.inputs]
        return _matrix(value, len(self.inputs), f"{self.what}: {name}", positive=name == "R")

    def weighed(self, given: Weights, name: str) -> tuple[list[Expression], np.ndarray]:
        """Expressions, and weights of their entries; none: of the deviations themselves."""
        if not isinstance(given, Mapping):
            raise OptionError(
                f"{self.what}: along a trajectory say what is weighed, {name}={{scene.hinge.q: 10.0}}: coordinates may change on the way."
            )
        known = dict(self.functions.outputs.system.flat.symbols(given))
        sizes = [len(labels(self.functions.outputs, key)) for key in known]
        weights = np.concatenate(
            [np.broadcast_to(np.asarray(v, dtype=float), (n,)) for v, n in zip(known.values(), sizes, strict=True)]
        )
        return list(known), _matrix(weights, weights.size, f"{self.what}: {name}", positive=False)

    def motion(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """States of the model, and inputs."""
        there = self.run.at(float(np.clip(t, self.run.t[0], self.run.t[-1])))
        return there.x[:, 0], there.u[: len(self.inputs), 0]

    def at(self, t: float) -> OperatingPoint:
        """Of the run, all states of the tree."""
        there = self.run.at(t)
        p, space = self.run.problem.parameters, self.functions.space
        x = space.expanded(t, there.x[:, 0], p)
        own = self.functions.outputs.system.p_values.size
        return OperatingPoint(t, x, there.u[:, 0], p[:own])

    def x(self, at: OperatingPoint) -> np.ndarray:
        """States of the model."""
        return self.functions.space.restricted(at.x)

    def expand(self, m: Matrices, at: OperatingPoint) -> np.ndarray:
        """States of the model (nx, k) by deviations."""
        return self.functions.space.restricted_change(at.x, m.expand)

    def rows(self, m: Matrices, wanted: Sequence[Expression]) -> np.ndarray:
        """Outputs of some expressions by deviations, out of all that were asked for."""
        first = np.cumsum([0, *(len(labels(self.functions.outputs, one)) for one in self._wanted)])
        place = {id(one): k for k, one in enumerate(self._wanted)}
        return np.vstack([m.C[first[k] : first[k + 1]] for k in (place[id(one)] for one in wanted)])

    def solved(
        self,
        hamiltonian: Callable[[Matrices], np.ndarray],
        begin: Callable[[Matrices], np.ndarray],
        wanted: Sequence[Expression],
        *,
        backward: bool,
    ) -> list[tuple[OperatingPoint, Matrices, np.ndarray]]:
        """The Riccati equation along the run in pieces with independent coordinates of their own: points in order of time, with its solution."""
        self._wanted = list({id(one): one for one in wanted}.values())
        ends = np.linspace(self.run.t[0], self.run.t[-1], _PIECES + 1)
        found: list[tuple[OperatingPoint, Matrices, np.ndarray]] = []
        P, before = np.zeros((0, 0)), np.zeros((0, 0))
        for k in reversed(range(_PIECES)) if backward else range(_PIECES):
            a, b = (ends[k + 1], ends[k]) if backward else (ends[k], ends[k + 1])
            linear = linear_around(self.whole, self.at((a + b) / 2), self._wanted)
            times = np.linspace(a, b, _SAMPLES)
            here = [self.at(float(t)) for t in times]
            own = [linear.at(at) for at in here]
            if not P.size:
                P = begin(own[0])
            elif backward:
                T = np.linalg.lstsq(before, own[0].expand, rcond=None)[0]
                P = T.T @ P @ T
            else:
                T = np.linalg.lstsq(own[0].expand, before, rcond=None)[0]
                P = T @ P @ T.T
            values = _riccati(times, np.array([hamiltonian(m) for m in own]), P)
            found += list(zip(here, own, values, strict=True))[: None if k == (0 if backward else _PIECES - 1) else -1]
            P, before = values[-1], own[-1].expand
        return found[::-1] if backward else found
