"""A mechanism that is led: states on prescribed courses, and the inputs that keep them there."""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import casadi as ca
import numpy as np

from acausal.analysis.actuation import Actuation
from acausal.analysis.conditions import Unknowns
from acausal.analysis.demands import led_in_its_mode
from acausal.analysis.mode_at import mode_words
from acausal.analysis.nearest import NearestRoot, Rows, largest_gaps
from acausal.analysis.point import Differentiable, OperatingPoint
from acausal.analysis.prescribed import Course
from acausal.analysis.slips import Slips
from acausal.analysis.state_sizes import power_of_two, sizes_at
from acausal.errors import MotionError, OptionError
from acausal.numerics.terms import rounded
from acausal.numerics.thresholds import ROUNDING
from acausal.outputs.outputs import Outputs
from acausal.start.coordinates import turning_states
from acausal.wording import counted

_HIGHEST = 4
_MET = 1e-8
_RANK = 1e-11
_ROUNDS = 20
_STRIDE = 0.2
_STEP = 0.7
_MOST_STEPS = 50
_STUCK = 300


@dataclass(frozen=True)
class Followed:
    """States (nx, m) and inputs (nu, m) on the courses, and names of states that these leave open."""

    x: np.ndarray
    u: np.ndarray
    free: tuple[str, ...]


def input_output_derivatives(outputs: Outputs, value: ca.SX, w: ca.SX, name: str) -> list[ca.SX]:
    """The expression and its time derivatives, up to the first one on which the forces w act (its relative degree: Isidori, Nonlinear
    Control Systems, 4.1).
    """
    chain = [value]
    while not ca.depends_on(chain[-1], w):
        if len(chain) > _HIGHEST:
            raise MotionError(
                f"inverse_dynamics: none of the forces acts on {name}, or on its first {_HIGHEST} derivatives. Name an actuator that moves it."
            )
        chain.append(outputs.rate(chain[-1]))
    if len(chain) == 1:
        raise OptionError(f"inverse_dynamics: {name} itself depends on a force; prescribe positions or velocities.")
    return chain


class Servo:
    """States that follow the courses, and the forces that keep them there."""

    def __init__(
        self, actuation: Actuation, wanted: tuple[Course, ...], began: OperatingPoint, signal: Callable[[np.ndarray], np.ndarray]
    ) -> None:
        outputs = actuation.functions.outputs
        s = outputs.system
        self._actuation, self._wanted, self._began, self._signal = actuation, wanted, began, signal
        chains = [input_output_derivatives(outputs, c.value, s.u[actuation.entries], c.name) for c in wanted]
        self._orders = [len(chain) - 1 for chain in chains]
        closing = ca.vertcat(s.closing, s.velocity_closing)
        self._closing, self._masks = closing.numel(), len(s.flat.modes)
        held = ca.SX(0, 1) if s.modes is None else s.modes.invariants
        self._held = held.numel()
        self._hard = Differentiable(s, ca.vertcat(closing, held, *(e for chain in chains for e in chain[:-1])))
        self._highest = ca.vertcat(*(chain[-1] for chain in chains))
        self._top = Differentiable(s, self._highest)
        self._x_dot = Differentiable(s, s.x_dot)
        self._usual: np.ndarray | None = None
        self._slips: Slips | None = None
        self._sizes, self._nq = sizes_at(s, self._x_dot, began), s.nq

    def run(self, t: np.ndarray) -> Followed:
        """Where nothing is left open the motion is found time by time, otherwise by integration."""
        self._sizes = replace(self._sizes, x=np.maximum(self._sizes.x, self._asked(t)))
        self._limit = np.append(_STEP * self._sizes.x[: self._nq], np.full(self._sizes.x.size - self._nq, np.inf))
        x0, free = self._follow(float(t[0]), self._began.x)
        if self._held:
            at, slips = self._at(float(t[0]), x0), Slips(self._actuation.functions, self._sizes.x)
            slips.look(at, float(t[min(1, t.size - 1)]), self._follow_in_mode)
            self._began, self._slips = slips.put(led_in_its_mode(self._actuation.functions, at, self._sizes.x)), slips
            self._usual = None
            x0, free = self._follow(float(t[0]), x0)
        self._forces(float(t[0]), x0)
        names = self._actuation.functions.state_names
        share = np.sum((free / self._sizes.x[:, None]) ** 2, axis=1)
        x = self._integrated(t, x0) if free.shape[1] else self._stepped(t, x0)
        if self._slips is not None:
            self._slips.begin_again()
        u = np.column_stack([self._forces(float(at), x[:, k]) for k, at in enumerate(t)])
        return Followed(x, u, tuple(n for n, c in zip(names, share, strict=True) if c > 1e-6))

    def _asked(self, t: np.ndarray) -> np.ndarray:
        """How far the courses lead states (nx,) all in all, each of them alone; 0 for angles, whose size is known."""
        size, s = self._sizes.x, self._actuation.functions.outputs.system
        along = self._hard.along(self._began, np.diag(size))[self._closing + self._held :]
        orders = [(c, k) for c, n in zip(self._wanted, self._orders, strict=True) for k in range(n)]
        far = np.array([np.ptp([c(float(at), k) for at in t]) for c, k in orders])
        square = np.sum(along**2, axis=1)
        found = np.max(np.abs(along) * np.divide(far, square, out=np.zeros(far.size), where=square > 0)[:, None], axis=0) * size
        found[: s.nq][turning_states(s)[0]] = 0.0
        return np.exp2(np.ceil(np.log2(found, out=np.full(found.size, -np.inf), where=found > 0)))

    def _stepped(self, t: np.ndarray, x0: np.ndarray) -> np.ndarray:
        x, found = x0, [x0]
        for before, after in pairwise(t):
            here = before
            while here < after:
                last, rate = here, self._rate(here, x)
                # rates are huge where the mechanism can go no farther
                fastest = float(np.max(np.abs(rate) / self._limit, initial=0.0)) * _STEP
                h = (after - before) / _MOST_STEPS if not np.isfinite(fastest) else after - before
                h = max(_STRIDE / fastest, (after - before) / _MOST_STEPS) if 0 < fastest < np.inf else h
                here = after if here + 1.001 * h > after else here + h
                x = self._follow(here, x + (here - last) * rate)[0]
            found.append(x)
        return np.column_stack(found)

    def _integrated(self, t: np.ndarray, x0: np.ndarray) -> np.ndarray:
        from scipy.integrate import solve_ivp

        if t.size == 1:
            return x0[:, None]
        recent: deque[float] = deque(maxlen=_STUCK)
        # in the scene's own time and sizes, since the first step is chosen in whatever unit there is
        pace, size = float(power_of_two(np.array([self._sizes.fastest]))[0]), self._sizes.x
        own = (t - t[0]) * pace

        def rates(at: float, y: np.ndarray) -> np.ndarray:
            now = float(t[0]) + at / pace
            recent.append(at)
            if len(recent) == _STUCK and max(recent) - min(recent) < 1e-4 * own[-1]:
                raise MotionError(
                    f"inverse_dynamics: near t = {now:.6g} s rates grow without a bound, and the motion cannot go on: what is prescribed leads "
                    "out of reach, or to where its forces no longer act on it."
                )
            return self._rate(now, self._follow(now, y * size)[0]) / size / pace

        found = solve_ivp(rates, (0.0, own[-1]), x0 / size, method="DOP853", t_eval=own, rtol=1e-10, atol=1e-12)
        if not found.success:
            raise MotionError(f"inverse_dynamics: the motion that is not prescribed could not be integrated: {found.message}")
        return np.column_stack([self._follow(float(at), y * size)[0] for at, y in zip(t, found.y.T, strict=True)])

    def _at(self, t: float, x: np.ndarray) -> OperatingPoint:
        u = self._signal(np.array([t]))[:, 0]
        u[self._actuation.entries] = 0.0
        masks = self._masks
        u[u.size - masks :] = self._began.u[u.size - masks :]
        return replace(self._began, t=t, x=x, u=u)

    def _follow_in_mode(self, at: OperatingPoint) -> tuple[np.ndarray, np.ndarray]:
        """`_follow` in the mode of a point."""
        self._began, self._usual = replace(self._began, u=at.u), None
        return self._follow(at.t, at.x)

    def _follow(self, t: float, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nearest consistent states on the courses, and the directions that these leave open."""
        target = np.concatenate(
            [
                np.zeros(self._closing + self._held),
                *([c(t, k) for k in range(n)] for c, n in zip(self._wanted, self._orders, strict=True)),
            ]
        )
        unknown = Unknowns(self._at(t, guess), (), ())
        rows = unknown.rows(self._hard)

        gap = Rows(
            lambda x: rows.residual(x) - target,
            rows.jacobian,
            lambda x, sizes: rows.rounding(x, sizes) + np.finfo(float).eps * np.abs(target),
        )
        search = NearestRoot(gap, None, self._sizes.x, self._limit)
        self._usual = search.usual(guess) if self._usual is None else self._usual
        found = search(guess, self._usual)
        if not found.converged:
            names = ["a loop"] * self._closing + ["what is closed, or sticks, from the start on"] * self._held
            names += [c.name + "'" * k for c, n in zip(self._wanted, self._orders, strict=True) for k in range(n)]
            raise MotionError(
                f"inverse_dynamics: at t = {t:.6g} s the mechanism cannot follow: "
                f"{largest_gaps(names, found.residual, found.parts)}. The motions contradict each other or the "
                f"constraints, or lead out of reach.{self._kept}"
            )
        return found.z, found.free

    def _rate(self, t: float, x: np.ndarray) -> np.ndarray:
        return self._x_dot.value(replace(self._at(t, x), u=self._forces(t, x)))

    def _forces(self, t: float, x: np.ndarray) -> np.ndarray:
        """All inputs (nu,): the least forces (by the sum of squares) that give the wanted highest derivatives."""
        at, entries = self._at(t, x), self._actuation.entries
        at = at if self._slips is None else self._slips.put(at)
        by_force = np.zeros((at.u.size, len(entries)))
        by_force[entries, range(len(entries))] = 1.0
        target = np.array([c(t, n) for c, n in zip(self._wanted, self._orders, strict=True)])
        size = gap = np.zeros(0)
        terms = np.abs(self._top.along(at, np.eye(at.x.size))) @ self._sizes.x
        for _ in range(_ROUNDS):  # once where derivatives are linear in the forces
            value = self._top.value(at)
            gap, B = target - value, self._top.along(at, du=by_force)
            size = np.abs(target) + np.abs(value) + np.abs(B) @ np.abs(at.u[entries]) + terms
            if np.all(np.abs(gap) <= 1e-13 * size) or not np.isfinite(B).all():
                break
            scale = np.max(np.abs(B), axis=1)
            scale = np.where(scale > 0, scale, 1.0)
            change = np.linalg.lstsq(B / scale[:, None], gap / scale, rcond=_RANK)[0]
            u = at.u.copy()
            u[entries] += change
            at = replace(at, u=u)
        met = np.abs(gap) <= _MET * size
        if not met.all():  # what is held anyway may be nothing but rounding
            met |= np.abs(gap) <= ROUNDING * self._terms.value(at)
        if not met.all():
            unmet = np.where(met, 0.0, gap)
            off = largest_gaps([c.name for c in self._wanted], unmet, unmet / np.where(size > 0, size, 1.0))
            raise MotionError(
                f"inverse_dynamics: at t = {t:.6g} s the forces {', '.join(self._actuation.names)} cannot accelerate {off} as asked: "
                f"{counted(len(self._wanted), 'motion')}, {counted(len(entries), 'force')}. Add an actuator to `unknowns`, or prescribe fewer motions.{self._kept}"
            )
        return at.u

    @functools.cached_property
    def _terms(self) -> Differentiable:
        """Sizes of the terms of the highest derivatives."""
        return Differentiable(self._actuation.functions.outputs.system, rounded(self._highest))

    @property
    def _kept(self) -> str:
        """What the mode of the start adds to that."""
        words = mode_words(self._actuation.functions.outputs.system, self._began.u)
        return (
            f" The mode of the start is kept ({words}): where a motion leaves it at once, begin a little later." if words else ""
        )
