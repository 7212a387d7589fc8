"""Equilibria with parts that open, close and stick: in a mode that lasts there."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from acausal.analysis.mode_at import in_its_mode, mode_words, with_masks
from acausal.analysis.point import Differentiable, OperatingPoint
from acausal.errors import EquilibriumError, OptionError
from acausal.numerics.thresholds import ROUNDING
from acausal.outputs.functions import Functions
from acausal.reduce.modes import DAMPING
from acausal.reduce.reduce import ReducedSystem
from acausal.simulate.transitions import Law, laws_of
from acausal.wording import compact

TOUCH = 1e-9
"""Of its terms: what a gap or a force may be on the wrong side of zero."""

Found = tuple[OperatingPoint, np.ndarray]
"""A point, and sizes of its states (nx,)."""


def resting(
    functions: Functions, began: OperatingPoint, search: Callable[[OperatingPoint], Found], steady: bool
) -> OperatingPoint:
    """The point from which `search` finds an equilibrium whose mode, which it keeps, is the true one there.

    First in the mode of the start; then with all contacts closed. Gaps that would become negative close, contacts that would pull open, friction that
    cannot hold gives way, and the search goes on. A steady motion keeps the mode of its start. Raises `EquilibriumError`.
    """
    system, modes, laws = functions.outputs.system, functions.outputs.system.modes, laws_of(functions.outputs)
    assert modes is not None
    refused: EquilibriumError | None = None
    for at in _begun(functions, began, laws, steady):
        seen: set[bytes] = set()
        while at.u.tobytes() not in seen:
            seen.add(at.u.tobytes())
            try:
                found, sizes = search(at)
            except EquilibriumError as error:
                refused = refused or error
                break
            wrong = _wrong(system, found, sizes)
            if not wrong.any():
                return at
            if steady:
                names = compact(law.name for law, off in zip(laws, _by_law(laws, wrong)[:-1], strict=True) if off.any())
                raise EquilibriumError(
                    f"The steady motion would ask more of {names} than it can do, in the mode of its start: {mode_words(system, found.u)}. Start in another mode."
                )
            at = _changed(at, len(modes.masks), laws, wrong)
    if refused is not None:
        raise refused
    raise EquilibriumError(
        f"No mode lasts in an equilibrium of '{system.flat.name}': what {compact(law.name for law in laws)} hold, they cannot hold all together. Begin nearer "
        "with start={...}."
    )


def _begun(functions: Functions, began: OperatingPoint, laws: Sequence[Law], steady: bool) -> Iterator[OperatingPoint]:
    """Points with masks to begin with."""
    modes = functions.outputs.system.modes
    assert modes is not None
    still = began.x.copy()
    if not steady:
        still[[i for i in range(still.size) if not modes.response[i, :].is_zero()]] = 0.0
    at = OperatingPoint(began.t, still, began.u, began.p)
    try:
        decided = in_its_mode(functions, at, "equilibrium")
    except OptionError:
        if steady:
            raise
        decided = at
    count = len(modes.masks)
    masks = decided.u[decided.u.size - count :].copy()
    if steady:
        yield with_masks(began, masks)
        return
    for closed in (False, True):
        for law in laws:
            if law.row.one_sided and closed:
                masks[law.masks] = 1
        if modes.damped is not None and masks[modes.damped] == 0:
            masks[modes.damped] = DAMPING  # that of the start's mode was of other rows
        for law in laws:
            if not law.row.one_sided:
                masks[law.masks] = 0
                masks[law.masks.start] = not law.needs or masks[list(law.needs)].any()
        yield with_masks(began, masks)


def _wrong(system: ReducedSystem, at: OperatingPoint, sizes: np.ndarray) -> np.ndarray:
    """Which guards of masks are negative (n,)."""
    assert system.modes is not None
    guards = Differentiable(system, system.modes.systems.unrolled(system.modes.guards))
    return guards.value(at) < -touching(guards, at, sizes)


def touching(column: Differentiable, at: OperatingPoint, sizes: np.ndarray) -> np.ndarray:
    """Up to which size gaps, slips and forces (n,) are none, by their terms. `sizes` (nx,) of states."""
    return TOUCH * np.abs(column.along(at, np.eye(at.x.size))) @ sizes + ROUNDING * column.rounding(at, sizes)


def _by_law(laws: Sequence[Law], wrong: np.ndarray) -> list[np.ndarray]:
    """Guards of each law, and then those of magnitudes."""
    return np.split(wrong, np.cumsum([1 if law.row.one_sided else 2 for law in laws]))


def _changed(at: OperatingPoint, count: int, laws: Sequence[Law], wrong: np.ndarray) -> OperatingPoint:
    """In the mode that these guards lead to. `count`: how many inputs, the last ones, say in which mode it is."""
    first, u = at.u.size - count, at.u.copy()
    *by_law, sizes = _by_law(laws, wrong)
    behind = first + max(law.masks.stop for law in laws)
    turned = np.flatnonzero(sizes[::2])
    for k in turned:
        u[behind + 3 * k : behind + 3 * k + 3] *= -1
    if turned.size:  # what limits grow with has been another force: what they hold is not known yet
        return OperatingPoint(at.t, at.x, u, at.p)
    for law, off in zip(laws, by_law, strict=True):
        masks = u[first + law.masks.start : first + law.masks.stop]
        if not off.any():
            continue
        if law.row.one_sided:
            masks[0] = 1 - masks[0]
        elif masks[0] == 1:
            if masks.size > 2:
                raise EquilibriumError(
                    f"The friction of {law.name} cannot hold what it would have to in this equilibrium. Begin nearer to another one."
                )
            masks[:] = 0, -1 if off[0] else 1  # against what is too much for it
        else:
            masks[:] = 0
            masks[0] = 1
    closed = u[first:]
    for law in laws:
        if law.needs and not closed[list(law.needs)].any():
            closed[law.masks] = 0
        elif law.needs and not closed[law.masks].any():
            closed[law.masks.start] = 1
    return OperatingPoint(at.t, at.x, u, at.p)
