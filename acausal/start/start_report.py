"""The report on a start: what was asked and met, what moved from the sketch, which loops closed, what was not needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from acausal.loops.sketch import sketch_configuration
from acausal.numerics.assembly import freedom
from acausal.numerics.sizes import positive
from acausal.numerics.thresholds import DEPENDENT
from acausal.start.start_search import Search
from acausal.start.unknowns import Found, Target
from acausal.wording import compact, numbers, shortened

if TYPE_CHECKING:
    from acausal.start.initial import Account, InitialState, Met

_SHOWN = 10
_MET = 1e-9


def start_report(state: InitialState) -> str:
    """About as many lines as there are start values, and at most ten each for what moved and for the loops."""
    account = state.account
    missed = _missed(state)
    lines = [_headline(state, missed), *_asked(state.met, missed), *_moved(account), *_loops(account)]
    lines += [*_needless(account), *_others(state)]
    return "\n".join(lines)


def _others(state: InitialState) -> list[str]:
    """That other branches meet the same values, where there are some."""
    from acausal.start.branch_search import other_branches

    count = other_branches(state)
    if not count:
        return []
    words = "1 other branch meets" if count == 1 else f"{count} other branches meet"
    return [f"{words} the same values; this one is reached from the sketch: see model.branches(...)"]


def _missed(state: InitialState) -> set[str]:
    """Names of near values that are not met, beside what the unknowns make of them."""
    off, missed = {m.name: m.off for m in state.met}, set[str]()
    for search, found, data in _searches(state.account):
        if search.wish is None:
            continue
        slopes = np.abs(search.wish_jacobian(found.y, data, found.first)) * search.sizes(data, found.first).unknowns
        row = len(slopes) - sum(t.size for t in search.wished)
        for target in search.wished:
            if off[target.name] > _MET * float(np.max(slopes[row : row + target.size], initial=0.0)):
                missed.add(target.name)
            row += target.size
    return missed


def _searches(a: Account) -> tuple[tuple[Search, Found, np.ndarray], ...]:
    """For positions, then velocities: the search, what it came to, and its data."""
    return (a.problem.positions, a.positions, a.data), (
        a.problem.velocities,
        a.velocities,
        np.concatenate([a.data, a.positions.y]),
    )


def _headline(state: InitialState, unmet: set[str]) -> str:
    a = state.account
    exact = sum(m.exact for m in state.met)
    asked = f"{exact} exact and {len(state.met) - exact} near values" if state.met else "no start values"
    met = "" if not state.met else ", all met" if not unmet else f", {len(unmet)} not met"
    begun = a.positions.restarts + a.velocities.restarts
    restarts = f", {begun} restarts" if begun else ""
    return f"start: {asked}{met}; {a.positions.iterations} iterations for positions, {a.velocities.iterations} for velocities{restarts}"


def _asked(met: Sequence[Met], missed: set[str]) -> list[str]:
    if not met:
        return []
    rows = [("asked", "", "wanted", "got", "off by")]
    ordered = sorted(met, key=lambda m: -m.off) if len(met) > 3 * _SHOWN else list(met)
    for m in ordered:
        off = f"{m.off:.3g} {m.unit}".rstrip() + ("  not met" if m.name in missed and not m.exact else "")
        rows.append((m.name, "exactly" if m.exact else "near", numbers(m.wanted, 3), numbers(m.got, 3), off))
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    lines = ["  " + "  ".join([f"{cell:<{w}}" for cell, w in zip(row[:4], widths, strict=True)] + [row[4]]) for row in rows]
    return shortened(lines, 1 + 3 * _SHOWN)


def _moved(a: Account) -> list[str]:
    """Coordinates by how far they are from the sketch, largest first; lengths are compared with the mechanism's size."""
    system = a.problem.outputs.system
    coordinates = a.problem.measured(a.data)
    if not coordinates.all:
        return []
    sketch = system.q_start.copy()
    joints = sketch_configuration(system.mechanics, system.p, a.data[a.data.size - system.p_values.size :])
    sketch[: joints.size] = joints
    q = coordinates.canonical(a.positions.y, sketch)
    far = coordinates.differences(sketch, q)
    order = [int(i) for i in np.argsort(-far, kind="stable") if far[i] > _MET]
    if not order:
        return ["nothing moved from the sketch"]
    lines = ["moved from the sketch, farthest first:"]
    for i in order:
        c = coordinates.all[i]
        lines.append(f"  {c.name:<24} by {c.distance(sketch, q):.4g} {c.unit}, from {c.value(sketch)} to {c.value(q)}")
    return shortened(lines, 1 + _SHOWN)


def _loops(a: Account) -> list[str]:
    """Gap of each loop, largest first."""
    search = a.problem.positions
    if search.residual is None or search.closing_rows == 0:
        return []
    residual = np.abs(np.array(search.residual(a.positions.y, a.data)).ravel())
    gaps: list[tuple[float, str]] = []
    first = 0
    for words, size in search.closing:
        if size:
            gaps.append((float(np.max(residual[first : first + size])), words))
        first += size
    gaps.sort(key=lambda gap: -gap[0])
    lines = ["closed, with the gap that is left (m, or sine of an angle):"]
    return shortened(lines + [f"  {gap:<8.1e} {words}" for gap, words in gaps], 1 + _SHOWN)


def _needless(a: Account) -> list[str]:
    lines: list[str] = []
    for search, found, data in _searches(a):
        follows, powerless = _unneeded(search, found, data)
        if follows:
            lines.append(f"not needed, since each follows from the rest: {compact(follows, _SHOWN)}")
        if powerless:
            lines.append(f"without influence, since exact values and loops leave no choice: {compact(powerless, _SHOWN)}")
    return lines


def _unneeded(search: Search, found: Found, data: np.ndarray) -> tuple[list[str], list[str]]:
    """Exact values whose rows depend on the others', and near values that nothing free can change."""
    if search.residual is None:
        return [], []
    sizes = search.sizes(data, found.first)
    J = sizes.scaled(search.jacobian(found.y, data))
    if not np.isfinite(J).all():
        return [], []
    free = freedom(J, sizes.dependent)
    follows: list[str] = []
    place = search.closing_rows
    for target in search.exact:
        others = np.delete(J, range(place, place + target.size), axis=0)
        place += target.size
        if others.size and int(np.linalg.matrix_rank(others, tol=sizes.dependent)) == J.shape[1] - free.shape[1]:
            follows.append(target.name)
    if search.wish is None or not search.wished:
        return follows, []
    Jw = search.wish_jacobian(found.y, data, found.first) * sizes.unknowns
    Jw = Jw / positive(np.linalg.norm(Jw, axis=1))[:, None]
    return follows, _powerless(search.wished, Jw, Jw @ free)


def _powerless(wished: Sequence[Target], Jw: np.ndarray, along: np.ndarray) -> list[str]:
    names: list[str] = []
    row = Jw.shape[0] - sum(t.size for t in wished)
    for target in wished:
        if float(np.max(np.abs(along[row : row + target.size]), initial=0.0)) <= DEPENDENT:
            names.append(target.name)
        row += target.size
    return names
