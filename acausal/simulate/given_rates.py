"""Inputs that prescribe places, angles or speeds, and their rates: what is prescribed is met at once, what is moved by rates follows these."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np

from acausal.errors import JumpWarning
from acausal.language.expression import InputRate
from acausal.outputs.functions import Functions
from acausal.simulate.trajectory import Trajectory
from acausal.wording import callers_level, compact

_MISSED = 1e-4
"""Of the largest value of an input, by which its rate leaves it."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Of a step's integral."""


def warn_of_unlike_rates(functions: Functions, run: Trajectory) -> bool:
    """Say so when an input that prescribes something jumps, or has a rate of its own that is not its rate; whether one does."""
    system, t = functions.outputs.system, run.steps.t
    held = [h for h in system.scalar.held if h.of_inputs]
    if not held or t.size < 2 or not t[-1] > t[0]:
        return False
    place = {entry: k for k, entry in enumerate(system.flat.inputs)}
    pairs = [(place[entry.of], place[entry], entry.of) for entry in place if isinstance(entry, InputRate)]
    values = run.problem.inputs(t)
    h, integrals = np.diff(t), np.zeros((values.shape[0], t.size))
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        integrals[:, 1:] += weight * h / 2 * run.problem.inputs(t[:-1] + h * (1 + node) / 2)
    integrals = np.cumsum(integrals, axis=1)
    for own, rate, entry in pairs:
        names = [h.name for h in held if ca.depends_on(h.residual, entry.sx)]
        gap = np.abs(values[own] - values[own, 0] - integrals[rate])
        missed = np.flatnonzero(gap > _MISSED * np.max(np.abs(values[own])))
        if names and missed.size:
            k = int(missed[0])
            warnings.warn(
                f"By t = {t[k]:.6g} s the input {functions.outputs.name(entry)} is off by {gap[k]:.3g} of what its rate says; it prescribes: {compact(dict.fromkeys(names))}. "
                "What moves jumps with it, and no force can do that to something with inertia: the blow is left out, and energies do not balance. Give a smooth "
                "course, and a rate of its own that belongs to the value.",
                JumpWarning, stacklevel=callers_level(),
            )  # fmt: skip
            return True
    return False
