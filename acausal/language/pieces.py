"""Functions of time in pieces: samples, and functions that say where they jump or bend."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acausal.errors import ParameterError
from acausal.language.origin import origin

_KINDS = ("constant", "linear", "cubic")
_JUMP = 1e-9
"""Difference of the values before and after a knot, of the largest value at knots, above which it is a jump and no rounding."""


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """A function of time [s] that is a polynomial between knots.

    Piece k, from `begins`[k] on, has the `coefficients` (n, terms), highest power first, of the time since then; the first one holds before it
    too, and the last one for ever. With a `period` [s], 0: none, the pieces from `first` to first + period repeat.
    """

    begins: np.ndarray
    coefficients: np.ndarray
    first: float = 0.0
    period: float = 0.0

    def __call__(self, times: np.ndarray | float) -> Any:
        """Values at times; at a knot that of the piece which begins there."""
        t = np.asarray(times, dtype=float)
        at = t - self.period * np.floor((t - self.first) / self.period) if self.period else t
        k = np.maximum(0, np.searchsorted(self.begins, at, side="right") - 1)
        value, s = self.coefficients[k, 0], at - self.begins[k]
        for column in self.coefficients.T[1:]:
            value = value * s + column[k]
        return value

    def jump(self, t0: float, t1: float) -> float | None:
        """The first time between t0 and t1 [s], but for these, at which the value jumps; None where it does not."""
        at = self.begins[1:] if not self.period else np.append(self.begins[1:], self.first + self.period)
        ends, last = self.coefficients[:, 0], np.append(self.begins[1:], self.first + self.period) - self.begins
        for column in self.coefficients.T[1:]:
            ends = ends * last + column
        before, after = ends[: at.size], self(at)
        jumping = at[np.abs(after - before) > _JUMP * np.max(np.abs(after), initial=np.max(np.abs(before), initial=0.0))]
        if self.period:
            first = jumping + self.period * (np.floor((t0 - jumping) / self.period) + 1)
            return min((float(t) for t in first if t < t1), default=None)
        return min((float(t) for t in jumping if t0 < t < t1), default=None)

    def derivative(self) -> PiecewisePolynomial:
        """Its rate; what it jumps by at knots is not in it."""
        terms = self.coefficients.shape[1]
        if terms == 1:
            return PiecewisePolynomial(self.begins, np.zeros_like(self.coefficients), self.first, self.period)
        return PiecewisePolynomial(self.begins, self.coefficients[:, :-1] * np.arange(terms - 1, 0, -1), self.first, self.period)


def samples(
    times: Sequence[float] | np.ndarray, values: Sequence[float] | np.ndarray, kind: str = "linear"
) -> PiecewisePolynomial:
    """What was sampled, as a function of time: `values` (n,) at ascending `times` (n,) [s].

    `kind`: "constant" holds each value until the next time (zero-order hold), "linear" joins them by straight lines, "cubic" by a cubic spline
    (not-a-knot). Before the first and after the last time their values hold. Steps of a run end at all times. Raises `ParameterError`.

        model.simulate(10.0, inputs={scene.torque: ac.samples([0, 1, 2], [0.0, 3.0, -1.0], "constant")})
    """
    if kind not in _KINDS:
        raise ParameterError(f"samples: there is no kind {kind!r} ({origin()}). Use {', '.join(map(repr, _KINDS))}.")
    t, y = _column(times, "times"), _column(values, "values")
    if t.size != y.size or t.size < 1:
        raise ParameterError(f"samples: {t.size} times and {y.size} values ({origin()}). Give one value for each time.")
    if np.any(np.diff(t) <= 0):
        k = int(np.argmax(np.diff(t) <= 0))
        raise ParameterError(f"samples: times must ascend, not {t[k]:g}, then {t[k + 1]:g} s ({origin()}).")
    begins = np.append(t[:1], t)
    if t.size == 1 or kind == "constant":
        return PiecewisePolynomial(begins[1:], y[:, None])
    if kind == "linear":
        inner = np.column_stack([np.diff(y) / np.diff(t), y[:-1]])
    else:
        from scipy.interpolate import CubicSpline

        inner = np.asarray(CubicSpline(t, y).c).T
    begins[-1] = np.nextafter(t[-1], np.inf)  # the last time itself still has the slope that leads there
    first, last = np.zeros((2, 1, inner.shape[1]))
    first[0, -1], last[0, -1] = y[0], y[-1]
    return PiecewisePolynomial(begins, np.vstack([first, inner, last]))


def _column(values: Any, what: str) -> np.ndarray:
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"samples: the {what} are no numbers ({origin()}). Give a list of numbers.") from None
    if found.ndim != 1:
        raise ParameterError(f"samples: the {what} must be numbers in one row, not of shape {found.shape} ({origin()}).")
    if not np.isfinite(found).all():
        k = int(np.argmin(np.isfinite(found)))
        raise ParameterError(f"samples: entry {k} of the {what} is {found[k]} ({origin()}). Give finite numbers.")
    return found


@dataclass(frozen=True, eq=False)
class WithKnots:
    """A function of time, and the times at which it jumps or bends."""

    function: Callable[[float], float]
    times: np.ndarray

    def __call__(self, t: float) -> float:
        """The function's value."""
        return self.function(t)

    def knots(self, t0: float, t1: float) -> np.ndarray:
        """Those from t0 to t1 [s]."""
        return self.times[(self.times >= t0) & (self.times <= t1)]


def with_knots(function: Callable[[float], float], knots: Sequence[float] | np.ndarray) -> WithKnots:
    """A plain function of time for `inputs`, with the times [s] at which it jumps or bends: there steps end, so that nothing is stepped over.

    model.simulate(10.0, inputs={scene.torque: ac.with_knots(lambda t: 10.0 if 3 <= t < 3.001 else 0.0, [3, 3.001])})
    """
    if not callable(function):
        raise ParameterError(
            f"with_knots: {function!r} is no function ({origin()}). Give a function of time, and the list of its knots [s]."
        )
    return WithKnots(function, np.unique(_column(knots, "knots")))
