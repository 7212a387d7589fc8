"""Switches that time alone decides, inside the functions of a model, and the times at which they come: there steps end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.switching import COMPARED, PERIODIC, WHOLE, switches

_DECIDED = (*COMPARED, ca.OP_EQ, ca.OP_NE)
_SIGNED = (ca.OP_SIGN, ca.OP_FABS)
_SWITCHES = (*_DECIDED, *_SIGNED, *WHOLE, *PERIODIC)
_SAMPLES = 1001
_MOST = 100_000
"""Regular switches between which samples are taken; where there are more, they are left out of account."""


@dataclass(frozen=True)
class Clocks:
    """Switches of a function of time: `signs` (t) -> (n,) values that switch where they are zero, `counts` (t) -> (m,) values that switch where they
    are whole; `lines` (values at t = 0, slope [1/s], whether it counts) of those that are linear in time, `others` (n + m,) tells which are not.
    """

    signs: ca.Function
    counts: ca.Function
    lines: tuple[tuple[float, float, int], ...]
    others: np.ndarray

    def times(self, t0: float, t1: float) -> np.ndarray:
        """Times [s] of switches between t0 and t1 that are not on lines.

        1001 samples are taken between the regular switches, and what changes sign twice between two samples is missed.
        """
        if not self.others.any():
            return np.zeros(0)
        regular: list[np.ndarray] = []
        for value, slope, counts in self.lines:
            first, last = sorted((value + slope * t0, value + slope * t1))
            if last - first <= _MOST:
                regular.append((np.arange(np.ceil(first), last + 1.0) if counts else np.zeros(1)) / slope - value / slope)
        return np.unique(self._sampled(np.concatenate([np.zeros(0), *regular]), t0, t1))

    def _sampled(self, known: np.ndarray, t0: float, t1: float) -> list[float]:
        """Where values that are not linear in time change their signs, or the whole numbers below them."""
        times = np.unique(np.concatenate([np.linspace(t0, t1, _SAMPLES), known[(known > t0) & (known < t1)]]))

        def state(t: np.ndarray) -> np.ndarray:
            signs, counts = (np.array(f(t[None, :])).reshape(-1, t.size) for f in (self.signs, self.counts))
            return np.vstack([signs > 0, np.floor(counts)])[self.others]

        states, found = state(times), list[float]()
        for k in np.flatnonzero(np.any(np.diff(states, axis=1) != 0, axis=0)):
            found.append(parted(lambda t: state(np.array([t]))[:, 0], float(times[k]), float(times[k + 1]))[1])
        return found


def clocks(function: ca.Function) -> Clocks | None:
    """Those of an SX function (t) -> a number; None without any."""
    codes = {function.instruction_id(k) for k in range(function.n_instructions())}
    if not codes.intersection(_SWITCHES):
        return None
    t = ca.SX.sym("t")
    signs, counts = list[ca.SX](), list[ca.SX]()
    for node in switches(ca.densify(function(t)), _SWITCHES):
        a, b = node.dep(0), node.dep(1) if node.n_dep() > 1 else ca.SX(1)
        value = a - b if node.op() in _DECIDED else a / b if node.op() in PERIODIC else a
        if ca.depends_on(value, t):
            (counts if node.op() in (*WHOLE, *PERIODIC) else signs).append(value)
    lines, others = list[tuple[float, float, int]](), list[bool]()
    for k, value in enumerate((*signs, *counts)):
        rate = ca.jtimes(value, t, ca.SX(1))
        line = not ca.depends_on(rate, t) and not switches(value, _SWITCHES)
        others.append(not line)
        if line and (slope := float(rate)) != 0:
            lines.append((float(ca.substitute(value, t, ca.SX(0))), slope, int(k >= len(signs))))
    if not others:
        return None
    signed, counted = (ca.Function("f", [t], [ca.densify(ca.vertcat(*of))]) for of in (signs, counts))
    return Clocks(signed, counted, tuple(line for line in lines if np.isfinite(line).all()), np.array(others))


def parted(state: Callable[[float], np.ndarray], before: float, after: float) -> tuple[float, float]:
    """Neighbouring numbers between two times, at the first of which the state is still that of `before`."""
    first = state(before)
    while before < (middle := 0.5 * (before + after)) < after:
        if np.array_equal(state(middle), first):
            before = middle
        else:
            after = middle
    return before, after
