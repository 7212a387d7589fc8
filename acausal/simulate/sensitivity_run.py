"""Sensitivities of a run: from start values to derivatives that have been looked at."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from acausal.collocation.problem import Accuracy, StatusKind
from acausal.errors import OptionError, SimulationError, SingularWarning
from acausal.language.expression import Input
from acausal.outputs.functions import Functions
from acausal.outputs.infinite import without_value
from acausal.simulate.sensitivity import Sensitivities, Wanted, sensitivities
from acausal.simulate.simulation import problem_of
from acausal.simulate.transitions import laws_of
from acausal.simulate.trouble import check_inside_all, failure, raise_if_interrupted
from acausal.start.inputs import knots
from acausal.start.situation import Situation
from acausal.wording import callers_level


def sensitivity_run(
    functions: Functions, at: Situation, times: np.ndarray, wrt: Sequence[Wanted], accuracy: Accuracy, compiled: bool
) -> Sensitivities:
    """Derivatives of a motion. Raises `SimulationError` when it fails, and the errors of `simulate`."""
    for entry in wrt:
        if isinstance(entry, Input) and not np.isscalar(at.inputs.get(entry, 0.0)):
            raise OptionError(f"sensitivities: the input {functions.outputs.name(entry)} is a function of time, not a number.")
    signal = at.signal(functions)
    until = float(times[-1])
    problem = problem_of(functions, signal, at.p, knots(signal, at.t0, until), compiled, discretes=at.discretes(functions))
    found = sensitivities(functions, problem, at, times, wrt, accuracy)
    status = found.found.status
    raise_if_interrupted(status, None)
    if status.kind is not StatusKind.SUCCESS:
        words = failure(functions, status, float(found.t[-1]), None)
        if status.kind is StatusKind.NON_FINITE:
            words = f"{words} {without_value(functions, at.t0, found.x[:, 0], signal(np.array([at.t0]))[:, 0], at.p)}".rstrip()
        raise SimulationError(words, None)
    check_inside_all(functions, found.t, found.x, signal(found.t), at.p)
    if found.found.passages:
        warnings.warn(
            "sensitivities: the motion passes singular positions of loops. The motion is right there, but derivatives of its rates are huge next "
            "to them and lose digits, now and then all but two. Compare with another rtol, or with differences of motions.",
            SingularWarning, stacklevel=callers_level(),
        )  # fmt: skip
    _warn_of_one_sided(functions, found)
    return found


def _warn_of_one_sided(functions: Functions, run: Sensitivities) -> None:
    """Where derivatives to either side of these values are not the same."""
    modes = functions.modes
    if modes is None:
        return
    rows = [law.row for law in laws_of(functions.outputs)]
    for law, what in (
        (run.found.grazed, "only just comes to where it changes"),
        (run.found.coincides, "{} in the same instant as another, or in that of the start"),
    ):
        if law is not None:
            rubs = law < len(rows) and not rows[law].one_sided
            together = " Where several hold one another they give way together, at a time that depends on all of them, which is not known here: compare with differences of motions."
            warnings.warn(
                f"sensitivities: {modes.words[law]} {what.format('changes' if rubs else 'closes')}: a little off these values the motion goes on in another way to either side, and its derivatives "
                f"there are not the same; those that are given belong to one side at most. Move the values a little, to the side that is meant.{together if rubs and '{' in what else ''}",
                SingularWarning, stacklevel=callers_level() + 1,
            )  # fmt: skip
