"""Inputs that are plain functions of time, looked at between the instants that steps look at: a pulse that falls between these moves nothing.

Of such a function nothing is known but its values. So it is asked at some more instants, spread over the run; where it is something else there than steps
can have seen around them, that is told. What is shorter than a thousandth of the run may still be missed.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from acausal.collocation.inputs import Inputs
from acausal.errors import AccuracyWarning
from acausal.language.pieces import WithKnots
from acausal.outputs.functions import Functions
from acausal.simulate.trajectory import Trajectory
from acausal.wording import callers_level

_LOOKS = 1000
"""Instants at which a function is asked once more."""
_PLACES = (np.polynomial.legendre.leggauss(8)[0] + 1) / 2
"""Of a step's stages, at most, as parts of it."""
_UNLIKE = 1e-3
"""Part of all that is met of an input by which it has to leave what steps saw of it."""
_GOLDEN = (np.sqrt(5) - 1) / 2


def warn_of_unseen_inputs(functions: Functions, run: Trajectory) -> bool:
    """Say so when an input that is a plain function of time does something between the instants that steps look at; whether one does."""
    inputs, t = run.problem.inputs, run.steps.t
    if not isinstance(inputs, Inputs) or t.size < 2 or not t[-1] > t[0]:
        return False
    plain = [(i, f) for i, f in inputs.functions if not isinstance(getattr(f, "function", f), WithKnots)]
    for place, function in plain:
        found = _unseen(function, np.unique(t))
        if found is not None:
            at, value, low, high = found
            seen = f"{low:.6g}" if low == high else f"between {low:.6g} and {high:.6g}"
            warnings.warn(
                f"The input {functions.outputs.name(functions.outputs.system.flat.inputs[place])} is {value:.6g} at t = {at:.6g} s, and {seen} wherever the step "
                "around was looked at: what a plain function does for a shorter time than a step is not seen, and the motion knows nothing of it. Say when it "
                "changes, ac.with_knots(function, times), give ac.samples(times, values) or an expression of ac.time, or bound the steps with max_step.",
                AccuracyWarning, stacklevel=callers_level(),
            )  # fmt: skip
            return True
    return False


def _unseen(function: Callable[[float], float], t: np.ndarray) -> tuple[float, float, float, float] | None:
    """An instant at which the function is something else than around, its value there, and the least and the largest value around: at the stages of the
    step from one of the times t to the next, and at the nearest ones before and after."""
    looks = t[0] + (t[-1] - t[0]) * ((np.arange(_LOOKS) + np.arange(_LOOKS) * _GOLDEN % 1.0) / _LOOKS)
    values = np.array([function(float(one)) for one in looks])
    if not np.isfinite(values).all() or values.min() == values.max():
        return None
    least = _UNLIKE * (values.max() - values.min())
    steps = np.clip(np.searchsorted(t, looks, side="right") - 1, 0, t.size - 2)
    for step in np.unique(steps):
        mine = steps == step
        around = _around(t, int(step))
        if values[mine].min() == values[mine].max() == function(float(around[0])):
            continue
        seen = np.array([function(float(one)) for one in around])
        low, high = float(seen.min()), float(seen.max())
        beyond = np.maximum(values[mine] - high, low - values[mine])
        k = int(np.argmax(beyond))
        if beyond[k] > max(least, high - low):
            return float(looks[mine][k]), float(values[mine][k]), low, high
    return None


def _around(t: np.ndarray, step: int) -> np.ndarray:
    """Instants of the stages of a step, and the nearest ones of the steps beside it."""
    begin, end = t[step], t[step + 1]
    inside = begin + (end - begin) * _PLACES
    before = begin - (begin - t[step - 1]) * _PLACES[0] if step > 0 else begin
    after = end + (t[step + 2] - end) * _PLACES[0] if step + 2 < t.size else end
    return np.array([before, *inside, after])
