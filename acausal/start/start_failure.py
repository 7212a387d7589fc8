"""Why a start cannot be found: the loop that does not close, or the start values that fight with it and with one another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np

from acausal.errors import AssemblyError, StartValueError
from acausal.numerics.assembly import Assembled
from acausal.numerics.sizes import Sizes
from acausal.start.start_search import Search
from acausal.start.unknowns import Found, Target
from acausal.wording import numbers

_TRIED = 6
"""Start values of the largest influence that are left out in turn."""
_TRIES = 6
_SHUT = 1e-9
"""Gap, as part of its row's size, that does not deserve words."""
_NUMBERS = 9
"""Entries of a start value that are shown."""


@dataclass(frozen=True)
class _Fighter:
    """An exact start value where the squares of all gaps together are least.

    `off`: how far it is then missed. `pull`: length of the gradient of its share of the squares, which the others balance.
    `instead`: its value when everything else is met, None where leaving it out does not help or was not tried.
    """

    target: Target
    off: float
    pull: float
    instead: np.ndarray | None


def complain(search: Search, found: Found, data: np.ndarray) -> NoReturn:
    """Raise `AssemblyError` when loops cannot close whatever the start values are, else `StartValueError` with those that fight."""
    sizes = search.sizes(data, search.first(data))
    n = search.closing_rows
    loops = _closed(search, found, data, list(range(n)), sizes) if n else None
    if loops is not None and not loops.converged:
        outside = search.outside(loops.y, data) if loops.part <= _SHUT else None
        if outside is not None:
            raise AssemblyError(f"No position of {outside[0]} was found that is inside its domain. {outside[1]}")
        raise AssemblyError(_open_loop(search, loops, data))
    if found.part <= _SHUT and not search.is_meant(found.y, data):
        values = "; ".join(f"{t.name} = {numbers(data[t.place], _NUMBERS)}" for t in search.exact)
        outside = search.outside(found.y, data)
        only = (
            "with hinge axes that point against one another" if outside is None else f"where {outside[0]} is outside its domain"
        )
        why = f" {outside[1]}" if outside else ""
        raise StartValueError(
            f"The {search.what} start values can be met only {only}: {values or 'none was given'}.{why} Change them, or soften some with ac.near(...)."
        )
    everything, J = search.rows(data, found.y)(found.y)
    left = np.abs(everything[:n]) / sizes.rows[:n]
    words = _culprits(search, left, n)
    fighters = _fighters(search, found, data, sizes, everything, J)
    told = "; ".join(_told(f, data) for f in fighters[:_TRIED])
    if len(fighters) > _TRIED:
        told += f"; … and {len(fighters) - _TRIED} more"
    helpful = [f.target.name for f in fighters if f.instead is not None]
    advice = f"Leave out {' or '.join(helpful[:3])}" if helpful else "Give fewer exact values"
    closed = (
        f"; a gap of {np.max(np.abs(everything[:n])):.3g} is then left in {words}" if np.max(left, initial=0.0) > _SHUT else ""
    )
    raise StartValueError(
        f"The {search.what} start values contradict each other or the constraints. Nearest to all of them, with the largest "
        f"influence first: {told or 'none was given'}{closed}. {advice}, or soften some with ac.near(...)."
    )


def _told(f: _Fighter, data: np.ndarray) -> str:
    wanted = data[f.target.place]
    unit = f" {f.target.unit}" if f.target.unit else ""
    text = f"{f.target.name} = {numbers(wanted, _NUMBERS)}{unit} (off by {f.off:.3g})"
    return text if f.instead is None else f"{text}, without which the rest is met and it would be {numbers(f.instead, _NUMBERS)}"


def _open_loop(search: Search, loops: Assembled, data: np.ndarray) -> str:
    residual = search.rows(data, loops.y)(loops.y)[0] / search.sizes(data, search.first(data)).rows
    rates = "the rates of " if search.what == "velocity" else ""
    return (
        f"With these parameters, inputs and this time, {rates}{_culprits(search, residual, search.closing_rows)} cannot close, whatever the "
        f"start values: the smallest gap reached is {loops.gap:.3g} (m, or sine of an angle). "
        "Check lengths, axes and offsets along the loop, and the parameters given to this call."
    )


def _culprits(search: Search, residual: np.ndarray, n: int) -> str:
    """What the largest of the first n residuals belongs to."""
    if not n:
        return "nothing"
    worst = int(np.argmax(np.abs(residual[:n])))
    for words, size in search.closing:
        if worst < size:
            return words
        worst -= size
    raise AssertionError("owners do not cover the rows")


def _closed(search: Search, found: Found, data: np.ndarray, kept: list[int], sizes: Sizes) -> Assembled:
    """The best of several searches that meet the rows `kept`, from where the search ended and from its beginning."""
    rng = np.random.default_rng(0)
    best: Assembled | None = None
    for k in range(2 + 2 * _TRIES):
        guess = found.y if k % 2 == 0 else found.first
        kick = rng.normal(size=guess.size) * sizes.unknowns * (0.0 if k < 2 else 0.1 * 1.5**k)
        trial = search.close(guess + kick, data, kept, sizes)
        if trial.converged and search.is_meant(trial.y, data):
            return trial
        if best is None or trial.part < best.part:
            best = trial
    assert best is not None
    return replace(best, converged=False)


def _fighters(
    search: Search, found: Found, data: np.ndarray, sizes: Sizes, residual: np.ndarray, J: np.ndarray
) -> list[_Fighter]:
    """Exact start values by influence, at the point where the search ended."""
    scaled, parts = sizes.scaled(J), residual / sizes.rows
    place, fighters = search.closing_rows, list[tuple[_Fighter, list[int]]]()
    for target in search.exact:
        own = list(range(place, place + target.size))
        place += target.size
        off = float(np.max(np.abs(residual[own])))
        fighters.append((_Fighter(target, off, float(np.linalg.norm(scaled[own].T @ parts[own])), None), own))
    fighters.sort(key=lambda pair: -pair[0].pull)
    result: list[_Fighter] = []
    for k, (f, own) in enumerate(fighters):
        instead = None
        if k < _TRIED:
            others = [i for i in range(residual.size) if i not in own]
            trial = _closed(search, found, data, others, sizes) if others else Assembled(found.y, np.zeros(0), 0.0, 0.0, True, 0)
            if trial.converged:
                instead = data[f.target.place] + search.rows(data, trial.y)(trial.y)[0][own]
        result.append(_Fighter(f.target, f.off, f.pull, instead))
    return result
