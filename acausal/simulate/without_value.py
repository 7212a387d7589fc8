"""Events whose expressions have no value at any end of a step, as the root of what is negative all along: they cannot happen, which looks as if they had not."""

from __future__ import annotations

import warnings

import numpy as np

from acausal.errors import AccuracyWarning
from acausal.outputs.functions import Functions
from acausal.simulate.looks import at_steps, spread
from acausal.simulate.trajectory import Trajectory
from acausal.wording import callers_level


def warn_of_events_without_value(functions: Functions, run: Trajectory) -> None:
    """Say so when the expression of an event is no number in a whole run."""
    n, t, guards = len(run.watched), run.steps.t, run.problem.guards
    if not n or guards is None or t.size < 2:
        return
    lost = np.zeros(0, dtype=bool)
    for some in (np.arange(1), spread(t.size)):  # at the start all have values, but for few runs
        lost = np.asarray(np.isnan(at_steps(functions, run, guards.function, some)[:n]).all(axis=1))
        if not lost.any():
            return
    words = ", ".join(f"{event.expression!r} ({event.line})" for event, off in zip(run.watched, lost, strict=True) if off)
    warnings.warn(
        f"when: {words} is not a number at any step from {t[0]:.6g} s to {t[-1]:.6g} s, and passes through zero nowhere: a root or a logarithm of what is "
        "negative, or zero by zero. Give an expression that has a value on both sides of its zero.",
        AccuracyWarning, stacklevel=callers_level(),
    )  # fmt: skip
