"""The mode that a scene is in at a point: which parts are closed, stick or slide there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acausal.analysis.point import OperatingPoint
from acausal.collocation.problem import Accuracy, Newton, Problem, StatusKind
from acausal.collocation.tableau import gauss_legendre
from acausal.errors import OptionError
from acausal.outputs.functions import Functions
from acausal.reduce.reduce import ReducedSystem
from acausal.runtime.kernels import How
from acausal.runtime.native import Choice
from acausal.wording import compact


def in_its_mode(functions: Functions, at: OperatingPoint, what: str) -> OperatingPoint:
    """With the masks that a motion from there begins with. `what` asks; raises `OptionError` where something strikes, overlaps, or no mode fits."""
    system, native = functions.outputs.system, functions.native(How.AUTO)
    if system.modes is None:
        return at
    if native is None:
        raise OptionError(f"{what}: which parts hold is decided by the integrators in C, which could not be loaded.")
    problem = Problem(
        functions.explicit_dynamics, functions.invariants, functions.projection, lambda times: np.repeat(at.u[:, None], times.size, axis=1), at.p, at.u, native,
        discretes=at.u[at.u.size - len(system.flat.discretes) :],
    )  # fmt: skip
    found = native.integrate(problem, at.x, at.t, at.t, Accuracy(1e-8), Choice((gauss_legendre(2),), Newton.NEVER))
    met = found.modes
    if met is None or found.status.kind is not StatusKind.SUCCESS:
        raise OptionError(f"{what}: {found.status.message or 'no mode could be decided there.'}")
    if met.jumped.any():
        struck = (row.part.path for row, impulse in zip(system.modes.rows, met.impulses[-1], strict=True) if impulse)
        raise OptionError(
            f"{what}: {compact(dict.fromkeys(struck))} closes with speed at this point, so that velocities jump there. Choose velocities that do not."
        )
    return with_masks(at, met.masks[:, -1])


def with_masks(at: OperatingPoint, masks: np.ndarray) -> OperatingPoint:
    """With these masks (masks,) as last inputs."""
    u = at.u.copy()
    u[u.size - masks.size :] = masks
    return replace(at, u=u)


def mode_words(system: ReducedSystem, u: np.ndarray) -> str:
    """What each part does in the mode of inputs u (nu,), `floor closed, rub sticks`; empty for scenes without modes."""
    modes = system.modes
    if modes is None:
        return ""
    masks, told = u[u.size - len(modes.masks) :], list[str]()
    for mask, value in zip(modes.masks, masks, strict=True):
        name, _, kind = mask.name.rpartition(".")
        if kind in ("closed", "open"):
            told.append(f"{name} {'closed' if (kind == 'closed') == bool(value) else 'open'}")
        elif kind in ("sticks", "slides") and value:
            told.append(f"{name} {kind}{'' if kind == 'sticks' else ' +' if value > 0 else ' -'}")
    return ", ".join(told)
