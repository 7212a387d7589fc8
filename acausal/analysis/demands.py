"""What a prescribed motion asks of parts that hold as long as they can: of contacts that they push, of friction that it holds."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.analysis.mode_at import in_its_mode, with_masks
from acausal.analysis.point import Differentiable, OperatingPoint
from acausal.analysis.resting import touching
from acausal.numerics import patches
from acausal.outputs.functions import Functions
from acausal.reduce.modes import DAMPING
from acausal.simulate.transitions import Law, laws_of

_EXCESS = 1e-9
"""Of a limit: what is beyond it by rounding."""


@dataclass(frozen=True, eq=False)
class Demand:
    """What a motion at times `t` (m,) [s] asks of a part that is `word` all along: "closed" or "open", "sticks", "slides" or "off".

    `force` (m, n): its reaction [N, N*m], what presses for one-sided parts, n being 1, 2 or 3. `margin` (m,): by how much the part stays what it is, negative where it
    cannot: the force that presses where it is closed, the gap where it is open, what friction has left where it sticks, its slip where it slides. `share` (m,): of its limit,
    what friction that sticks has to bear, more than 1 where it would slip: the coefficient that is needed is this times that of its law; None for others. `shared`: whether
    parts may depend on one another in what they bear, as the legs of a table do: then all this is as least squares share it out, and together they may bear more.
    """

    t: np.ndarray
    word: str
    force: np.ndarray
    margin: np.ndarray
    share: np.ndarray | None
    shared: bool

    @property
    def lasts(self) -> bool:
        """Whether the part can do that at all times; of what is `shared`, whether least squares ask no more."""
        if self.share is not None:
            return bool((self.share <= 1 + _EXCESS).all())
        size = np.abs(self.margin).max(initial=0.0)
        return bool((self.margin >= -_EXCESS * size).all())

    def __str__(self) -> str:
        if self.share is not None:
            worst = int(np.argmax(self.share))
            told = f"needs {100 * self.share[worst]:.4g} % of its limit at t = {self.t[worst]:.4g} s"
            return f"{self.word}, {told}{'' if self.lasts else self._beyond(': it would slip')}"
        worst = int(np.argmin(self.margin))
        at = f"at t = {self.t[worst]:.4g} s"
        if self.word == "closed":
            return (
                f"closed, presses with {self.margin[worst]:.4g} or more ({at})"
                if self.lasts
                else f"closed: it would have to pull with {-self.margin[worst]:.4g} {at}{self._beyond('')}"
            )
        if self.word == "open":
            return f"open, {'clear by' if self.lasts else 'but overlaps by'} {abs(self.margin[worst]):.4g} {at}"
        return self.word if self.lasts else f"{self.word}, but not any more {at}"

    def _beyond(self, otherwise: str) -> str:
        return ", as least squares share it out; others may bear more" if self.shared else otherwise


def led_in_its_mode(functions: Functions, at: OperatingPoint, sizes: np.ndarray) -> OperatingPoint:
    """In a scene with modes, with the masks of a motion that is prescribed: what touches and does not part is closed, what does not slip sticks, whatever forces that takes. `sizes` (nx,) of states.
    Raises `OptionError` where something strikes or overlaps."""
    system = functions.outputs.system
    modes = system.modes
    assert modes is not None
    decided = in_its_mode(functions, at, "inverse_dynamics")
    count = len(modes.masks)
    masks = decided.u[decided.u.size - count :].copy()
    gap, rate = Differentiable(system, modes.gaps), Differentiable(system, modes.rate)
    slips = rate.value(at)
    touches, still = np.abs(gap.value(at)) <= touching(gap, at, sizes), np.abs(slips) <= touching(rate, at, sizes)
    if modes.damped is not None:
        masks[modes.damped] = DAMPING
    row = 0
    for law in laws_of(functions.outputs):
        own = masks[law.masks]
        if law.row.one_sided:
            if not law.row.one_way:
                own[0] = touches[row] and still[law.reactions].all()
            row += 1
            continue
        if law.needs and not masks[list(law.needs)].any():
            own[:] = 0
        elif still[law.reactions].all():
            own[:] = 0
            own[0] = 1
        elif own[0] or not own.any():
            own[:] = 0
            own[1] = np.sign(slips[law.reactions.start]) if law.row.size == 1 else 1
    return with_masks(at, masks)


def demands(functions: Functions, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> dict[str, Demand]:
    """By names of parts, for states (nx, m) and inputs (nu, m) at times (m,), all in one mode."""
    system, lasting = functions.outputs.system, functions.modes
    modes = system.modes
    if modes is None or lasting is None:
        return {}
    given = functions.series(functions.given_by_dynamics)(t, x, u, p)
    first = system.x_dot.numel() + system.multipliers.numel()
    forces = given[first : first + modes.reactions.numel()]
    guards = functions.series(lasting.guards)(t, x, u, p)
    found: dict[str, Demand] = {}
    first = 0
    for law in laws_of(functions.outputs):
        force = forces[law.reactions]
        margin = guards[first : first + (1 if law.row.one_sided else 2)]
        first += margin.shape[0]
        word = law.words[int(law.numbers(u[u.shape[0] - len(modes.masks) :, :1])[0])]
        found[law.name] = Demand(
            t, word.split()[0], force.T, np.min(margin, axis=0), _share(law, word, force, margin), modes.redundant
        )
    return found


def _share(law: Law, word: str, force: np.ndarray, margin: np.ndarray) -> np.ndarray | None:
    """What friction that sticks has to bear, of its limit."""
    if word != "sticks":
        return None
    if law.row.size == 1:
        size, limit = np.abs(force[0]), margin.sum(axis=0) / 2
    elif law.row.pressure is None:
        size = np.linalg.norm(force, axis=0)
        limit = margin[0] + size
    else:
        one = ca.SX.sym("force", 3)
        size = np.array(ca.Function("size", [one], [patches.size(law.row.pressure, one, 0)])(force))[0]
        size[~force.any(axis=0)] = 0.0
        limit = margin[0] + size
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(size > 0, np.where(limit > 0, size / limit, np.inf), 0.0)
