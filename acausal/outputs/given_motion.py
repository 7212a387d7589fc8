"""Given motions: positions and angles that parts prescribe as functions of time must have values, and rates without jumps."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.errors import JumpWarning, ParameterError
from acausal.language.expression import Expression
from acausal.language.flatten import Part
from acausal.numerics.switching import switches
from acausal.outputs.clocks import parted
from acausal.outputs.outputs import Outputs
from acausal.wording import callers_level

_JUMPING = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_SIGN, ca.OP_FLOOR, ca.OP_CEIL)
_SAMPLES = 1001
_JUMP = 1e-6
"""Change of a value across one instant, relative to its largest value, above which it is a jump."""


@dataclass(frozen=True)
class GivenMotion:
    """A position or angle that a part prescribes: `course`, (t, p) -> its value (n,) [m or rad] and its rate (n,), one after the other.

    `switches`: (t, p) -> every comparison, sign and step inside; None where there is none.
    """

    part: Part
    given: Expression
    course: ca.Function
    switches: ca.Function | None


def given_motions(outputs: Outputs) -> tuple[GivenMotion, ...]:
    """All of a scene that are functions of time and parameters only."""
    system, found = outputs.system, list[GivenMotion]()
    for part in system.flat.parts:
        for given in part.component.given_motions():
            value = ca.vec(outputs.resolve(given))
            if not ca.depends_on(value, system.t) or ca.depends_on(value, ca.vertcat(system.x, system.u)):
                continue
            column = ca.densify(ca.vertcat(value, ca.jtimes(value, system.t, ca.SX(1))))
            course = ca.Function("course", [system.t, system.p], [column])
            nodes = switches(column, _JUMPING)
            decided = ca.Function("switches", [system.t, system.p], [ca.vertcat(*nodes)]) if nodes else None
            found.append(GivenMotion(part, given, course, decided))
    return tuple(found)


def check_given_motions(motions: tuple[GivenMotion, ...], t0: float, t1: float, p: np.ndarray) -> bool:
    """Whether a given motion jumps from t0 to t1, which is warned of (`JumpWarning`). Raises `ParameterError` for one without a value at t0 [s].

    Switches are sampled and bisected to neighbouring numbers: a jump is what is left there.
    """
    jumps = False
    for motion in motions:
        _check_value(motion, np.array(motion.course(t0, p)).ravel(), t0)
        if motion.switches is not None and t1 > t0:
            jumps |= _warn_of_jump(motion, motion.switches, t0, t1, p)
    return jumps


def _check_value(motion: GivenMotion, found: np.ndarray, t0: float) -> None:
    if not np.isfinite(found).all():
        what = "value" if not np.isfinite(found[: found.size // 2]).all() else "rate"
        raise ParameterError(
            f"The motion that {motion.part.where} prescribes, {motion.given!r}, has no finite {what} at the start, t = {t0:g} s. Give a "
            "function that is smooth from the start on, or start later with t0=..."
        )


def _warn_of_jump(motion: GivenMotion, decided: ca.Function, t0: float, t1: float, p: np.ndarray) -> bool:
    course = motion.course
    times = np.linspace(t0, t1, _SAMPLES)
    states = np.array(decided(times[None, :], np.repeat(p[:, None], times.size, axis=1)))
    size = np.maximum(
        np.finfo(float).tiny,
        np.max(np.abs(np.nan_to_num(np.array(course(times[None, :], np.repeat(p[:, None], times.size, axis=1))))), axis=1),
    )
    for k in np.flatnonzero(np.any(np.diff(states, axis=1) != 0, axis=0)):
        before, after = parted(lambda t: np.array(decided(t, p)), float(times[k]), float(times[k + 1]))
        jump = np.abs(np.array(course(after, p)) - np.array(course(before, p))).ravel()
        if np.any(jump > _JUMP * size):
            n = jump.size // 2
            which, by = (
                ("position or angle", np.max(jump[:n])) if np.any(jump[:n] > _JUMP * size[:n]) else ("speed", np.max(jump[n:]))
            )
            warnings.warn(
                f"The motion that {motion.part.where} prescribes changes its {which} by {by:.4g} at once, at t = {after:.6g} s. No force can do that to "
                "something with inertia: the blow is left out, and energies do not balance. Give a smooth course (two derivatives), e.g. a "
                "polynomial ramp or tanh.",
                JumpWarning, stacklevel=callers_level(),
            )  # fmt: skip
            return True
    return False
