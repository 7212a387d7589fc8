"""Given motions: positions and angles that parts prescribe as functions of time must have values, and rates without jumps."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np

from acausal.codegen.lower import Functions
from acausal.errors import JumpWarning, ParameterError
from acausal.language.expression import Expression
from acausal.language.flatten import Part

_SWITCHES = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_SIGN, ca.OP_FLOOR, ca.OP_CEIL)
_SAMPLES = 1001
_JUMP = 1e-6
"""Change of a value across one instant, relative to its largest value, above which it is a jump."""


def check_given_motions(functions: Functions, t0: float, t1: float, p: np.ndarray, stacklevel: int) -> None:
    """Raises `ParameterError` for a given motion without a value at t0 [s]; warns (`JumpWarning`) of jumps from t0 to t1.

    Switches (comparisons, signs, steps) are sampled and bisected to neighbouring numbers: a jump is what is left there.
    """
    system = functions.outputs.system
    for part in system.flat.parts:
        for given in part.component.given_motions():
            value = ca.vec(functions.outputs.resolve(given))
            if not ca.depends_on(value, system.t):
                continue
            rate = ca.jtimes(value, system.t, ca.SX(1))
            course = ca.Function("course", [system.t, system.p], [ca.densify(ca.vertcat(value, rate))])
            _check_value(part, given, np.array(course(t0, p)).ravel(), value.numel(), t0)
            switches = _switches(ca.vertcat(value, rate))
            if switches and t1 > t0:
                _warn_of_jump(
                    part,
                    course,
                    ca.Function("switches", [system.t, system.p], [ca.vertcat(*switches)]),
                    t0,
                    t1,
                    p,
                    stacklevel + 1,
                )


def _check_value(part: Part, given: Expression, found: np.ndarray, n: int, t0: float) -> None:
    if not np.isfinite(found).all():
        what = "value" if not np.isfinite(found[:n]).all() else "rate"
        raise ParameterError(
            f"The motion that {part.where} prescribes, {given!r}, has no finite {what} at the start, t = {t0:g} s. Give a function that is "
            "smooth from the start on, or start later with t0=..."
        )


def _switches(expression: ca.SX) -> list[ca.SX]:
    """Every comparison, sign and step inside the expression."""
    stack, seen, found = [expression[i] for i in range(expression.numel())], set[int](), list[ca.SX]()
    while stack:
        node = stack.pop()
        if node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        if node.n_dep():
            if node.op() in _SWITCHES:
                found.append(node)
            stack += [node.dep(i) for i in range(node.n_dep())]
    return found


def _warn_of_jump(
    part: Part, course: ca.Function, switches: ca.Function, t0: float, t1: float, p: np.ndarray, stacklevel: int
) -> None:
    times = np.linspace(t0, t1, _SAMPLES)
    states = np.array(switches(times[None, :], np.repeat(p[:, None], times.size, axis=1)))
    size = np.maximum(
        1e-9, np.max(np.abs(np.nan_to_num(np.array(course(times[None, :], np.repeat(p[:, None], times.size, axis=1))))), axis=1)
    )
    for k in np.flatnonzero(np.any(np.diff(states, axis=1) != 0, axis=0)):
        before, after = float(times[k]), float(times[k + 1])
        state = states[:, k]
        while before < (middle := 0.5 * (before + after)) < after:
            if np.array_equal(np.array(switches(middle, p)).ravel(), state):
                before = middle
            else:
                after = middle
        jump = np.abs(np.array(course(after, p)) - np.array(course(before, p))).ravel()
        if np.any(jump > _JUMP * size):
            n = jump.size // 2
            which, by = (
                ("position or angle", np.max(jump[:n])) if np.any(jump[:n] > _JUMP * size[:n]) else ("speed", np.max(jump[n:]))
            )
            warnings.warn(
                f"The motion that {part.where} prescribes changes its {which} by {by:.4g} at once, at t = {after:.6g} s. No force can do that: "
                "the blow to what moves with it is left out, and energies do not balance. Give a smooth course (two derivatives), e.g. a "
                "polynomial ramp or tanh, or let it pull by a spring.",
                JumpWarning, stacklevel=stacklevel,
            )  # fmt: skip
            return
