"""Switches that time alone decides, inside the functions of a model, and the times at which they come: there steps end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

_COMPARED = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_FMIN, ca.OP_FMAX)
_SIGNED = (ca.OP_SIGN, ca.OP_FABS)
_WHOLE = (ca.OP_FLOOR, ca.OP_CEIL)
_PERIODIC = (ca.OP_FMOD, ca.OP_REMAINDER)
SWITCHES = (*_COMPARED, *_SIGNED, *_WHOLE, *_PERIODIC)
"""Operations whose results jump or bend."""
_SAMPLES = 1001
_MOST = 100_000
"""Switches in one run that steps end at; where there are more, steps are as short as they anyway."""
_ASIDE = 2
"""Neighbouring numbers to either side of a switch that belong to no step: rounding decides there which side they are on."""


@dataclass(frozen=True)
class Clocks:
    """Switches of a function of time and parameters.

    `signs` (t, p) -> (n,) values that switch where they are zero, `counts` (t, p) -> (m,) values that switch where they are whole;
    `slopes` (p) -> (n + m,) their rates, and `steady` (n + m,) tells which rates do not change.
    """

    signs: ca.Function
    counts: ca.Function
    slopes: ca.Function
    steady: np.ndarray

    def times(self, t0: float, t1: float, p: np.ndarray) -> np.ndarray:
        """Times [s] of switches between t0 and t1.

        Values that are linear in time are solved for; of others 1001 samples are taken between those, and what changes sign twice between
        two samples is missed.
        """
        slopes = np.array(self.slopes(p)).ravel()
        n = self.signs.size1_out(0)
        values = np.concatenate([np.array(f(t0, p)).ravel() for f in (self.signs, self.counts)])
        found: list[float] = []
        for k in np.flatnonzero(self.steady & (slopes != 0) & np.isfinite(slopes) & np.isfinite(values)):
            first, last = sorted((values[k], values[k] + slopes[k] * (t1 - t0)))
            if k >= n and last - first > _MOST:
                continue
            wanted = np.zeros(1) if k < n else np.arange(np.ceil(first), last + 1.0)
            found += (t0 + (wanted - values[k]) / slopes[k]).tolist()
        if not self.steady.all():
            found += self._sampled(np.array(found), t0, t1, p)
        return np.unique(found)

    def _sampled(self, known: np.ndarray, t0: float, t1: float, p: np.ndarray) -> list[float]:
        """Where values that are not linear in time change their signs, or the whole numbers below them."""
        times = np.unique(np.concatenate([np.linspace(t0, t1, _SAMPLES), known[(known > t0) & (known < t1)]]))

        def state(t: np.ndarray) -> np.ndarray:
            many = np.repeat(p[:, None], t.size, axis=1)
            signs, counts = (np.array(f(t[None, :], many)).reshape(-1, t.size) for f in (self.signs, self.counts))
            return np.vstack([signs > 0, np.floor(counts)])[~self.steady]

        states, found = state(times), list[float]()
        for k in np.flatnonzero(np.any(np.diff(states, axis=1) != 0, axis=0)):
            found.append(parted(lambda t: state(np.array([t]))[:, 0], float(times[k]), float(times[k + 1]))[1])
        return found


def apart(times: np.ndarray, t0: float, t1: float) -> np.ndarray:
    """(n, 2) last and first times [s] before and after `times` from t0 to t1."""
    least = np.spacing(max(abs(t0), abs(t1)))
    found = np.unique(times[(times >= t0 - _ASIDE * least) & (times <= t1 + _ASIDE * least)])
    found = found[np.concatenate([[True], np.diff(found) > 4 * _ASIDE * least])] if found.size else found
    return found[:, None] + _ASIDE * least * np.array([-1.0, 1.0])


def clocks(function: ca.Function) -> Clocks | None:
    """Those of an SX function (t) or (t, x, u, p); None where no switch depends on time and not on x or u."""
    codes = {function.instruction_id(k) for k in range(function.n_instructions())}
    if not codes.intersection(SWITCHES):
        return None
    t, x, u, p = (ca.SX.sym(name, function.size1_in(i) if i < function.n_in() else 0) for i, name in enumerate("txup"))
    moving = ca.vertcat(x, u)
    signs, counts = list[ca.SX](), list[ca.SX]()
    for node in switches(ca.densify(function.call([t, x, u, p][: function.n_in()])[0])):
        a, b = node.dep(0), node.dep(1) if node.n_dep() > 1 else ca.SX(1)
        value = a - b if node.op() in _COMPARED else a / b if node.op() in _PERIODIC else a
        if ca.depends_on(value, t) and not ca.depends_on(value, moving):
            (counts if node.op() in (*_WHOLE, *_PERIODIC) else signs).append(value)
    if not signs and not counts:
        return None
    rates = [(value, ca.jtimes(value, t, ca.SX(1))) for value in (*signs, *counts)]
    steady = np.array([not ca.depends_on(rate, t) and not switches(value) for value, rate in rates])
    slopes = [rate if fixed else ca.SX(0) for (_, rate), fixed in zip(rates, steady, strict=True)]
    return Clocks(
        ca.Function("signs", [t, p], [ca.densify(ca.vertcat(*signs))]),
        ca.Function("counts", [t, p], [ca.densify(ca.vertcat(*counts))]),
        ca.Function("slopes", [p], [ca.densify(ca.vertcat(*slopes))]),
        steady,
    )


def switches(expression: ca.SX, operations: tuple[int, ...] = SWITCHES) -> list[ca.SX]:
    """Every operation of these kinds inside an expression."""
    stack, seen, found = [expression[i] for i in range(expression.numel())], set[int](), list[ca.SX]()
    while stack:
        node = stack.pop()
        if node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        if node.n_dep():
            if node.op() in operations:
                found.append(node)
            stack += [node.dep(i) for i in range(node.n_dep())]
    return found


def parted(state: Callable[[float], np.ndarray], before: float, after: float) -> tuple[float, float]:
    """Neighbouring numbers between two times, at the first of which the state is still that of `before`."""
    first = state(before)
    while before < (middle := 0.5 * (before + after)) < after:
        if np.array_equal(state(middle), first):
            before = middle
        else:
            after = middle
    return before, after
