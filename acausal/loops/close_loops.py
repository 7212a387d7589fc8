"""Closing loops in numbers: from the sketch to a configuration with every joint in place."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np

from acausal.errors import AssemblyError
from acausal.loops.loop_groups import LoopGroup
from acausal.loops.loops import LoopRows
from acausal.loops.mobility import nearly_redundant
from acausal.loops.nearest_loops import nearest_closed
from acausal.loops.walk import Walk
from acausal.numerics.assembly import Residual, assemble, brought_near, held
from acausal.numerics.thresholds import EDGE, STRIDE

_ATTEMPTS = 12
_NEARLY = 1e-3
"""Gaps, as parts of the sizes of rows, at which dimensions may be meant to fit."""
_INSIDE, _INSIDE_STEPS = 0.5, 8
"""Of a joint's domain, which is 1 well inside."""


def close_loops(walk: Walk, guess: np.ndarray, drawn: Callable[[], Residual]) -> np.ndarray:
    """The configuration z of the group's coordinates nearest to the `guess` q with all its loops closed on the branch meant.

    `drawn`: makes the measure of how far one is from the sketch. Elastic bodies are as they are drawn, where joints alone close the loops.
    Loops that are driven may close at another time only: the walk is then at that time.
    Raises `AssemblyError` with the smallest gap.
    """
    group, t = walk.symbolic.group, walk.symbolic.t

    def is_meant(z: np.ndarray) -> bool:
        return bool(np.all(walk.meant(z)[0] > EDGE))

    rng, time = np.random.default_rng(0), walk.time
    sketch = guess / walk.unit
    if group.elastic:
        found = assemble(held(walk.closing, group.elastic), sketch, sizes=walk.sizes)
        if found.converged and is_meant(found.y):
            return nearest_closed(walk, drawn(), sketch, found.y, is_meant, group.elastic) if found.iterations else found.y
    smallest, where = np.inf, sketch
    for first in _beginnings(group, walk, _brought_inside(walk, sketch), sketch, rng):
        if not all(np.isfinite(part).all() for part in walk.at(first)):  # a wheel that lies flat, the tip of a cone: beside it
            continue
        found = assemble(walk.closing, first, sizes=walk.sizes)
        right_branch = is_meant(found.y)
        if found.converged and right_branch:
            if not found.iterations:
                return found.y
            return nearest_closed(walk, drawn(), sketch, found.y, is_meant)
        if found.gap < smallest and right_branch:
            smallest, where = found.gap, found.y
    if not np.isfinite(smallest) and not all(np.isfinite(part).all() for part in walk.at(where)):
        raise _without_slope(group, walk.at(where)) if group.loops else _nowhere(group, walk.meant(where)[0])
    if ca.depends_on(group.closing, t):
        for attempt in range(_ATTEMPTS):
            first = where if attempt == 0 else sketch + rng.normal(scale=0.1 * 1.35**attempt, size=guess.size)
            z = walk.later(first, (attempt + 1) // 2 * (-1.0) ** (attempt + 1))
            if z is not None and is_meant(z):
                return z
        walk.time = time
    if not group.loops:
        raise _nowhere(group, walk.meant(where)[0])
    gaps = np.abs(walk.gaps(where))
    worst, own = _worst_loop(group.loops, gaps)
    raise AssemblyError(
        f"The loop closed by joint '{worst.edge.name}' ({worst.edge.joint.created_at}) cannot close: the smallest gap reached is "
        f"{float(np.max(gaps)):.3g} (m, or sine of an angle){_in_words(worst, own)}."
        f"{nearly_redundant(group.loops, walk.rows(where)) if np.max(gaps / walk.row_sizes) < _NEARLY else ''} "
        "Check lengths, axes and offsets along the loop, or begin nearer to an assembled position: give joints a start or bodies a rough position."
    )


def _brought_inside(walk: Walk, sketch: np.ndarray) -> np.ndarray:
    """The sketch, where joints that are outside of their domain are brought well inside, by Newton's method."""
    z = sketch
    for _ in range(_INSIDE_STEPS):
        d, D = (part[: walk.symbolic.group.domain.numel()] for part in walk.meant(z))
        outside = ~(d[:, 0] > EDGE)
        if not outside.any() or not (np.isfinite(d).all() and np.isfinite(D).all()):
            break
        step = np.linalg.lstsq(D[outside], _INSIDE - d[outside, 0])[0]
        turns = np.abs(step[walk.symbolic.group.turning])
        z = z + step / max(1.0, float(np.max(turns, initial=0.0)) / STRIDE)
    return z


def _beginnings(
    group: LoopGroup, walk: Walk, inside: np.ndarray, sketch: np.ndarray, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """The sketch, with joints brought `inside` of their domain, shifted to where it nearly closes, and about these, farther and farther away."""
    yield sketch
    near = inside
    if near is not sketch:
        yield near
    if not group.turning.all():
        near = brought_near(walk.closing, near, group.turning, walk.sizes)
        yield near
    for attempt in range(1, _ATTEMPTS):
        yield (near if attempt % 2 else sketch) + rng.normal(scale=0.1 * 1.35**attempt, size=sketch.size)


def _without_slope(group: LoopGroup, parts: list[np.ndarray]) -> AssemblyError:
    """A loop whose closure, or the derivative of it, is no number where the search begins, nor beside it."""
    bad = np.flatnonzero(~np.isfinite(np.hstack(parts[:2])).all(axis=1))
    rows, _ = _worst_loop(group.loops, np.isin(np.arange(parts[0].shape[0]), bad).astype(float))
    return AssemblyError(
        f"The loop closed by joint '{rows.edge.name}' ({rows.edge.joint.created_at}): what {type(rows.edge.joint).__name__} asks of the pose, or the "
        "derivative of that, is no finite number where the search for an assembled position begins, nor near it. Begin elsewhere: give bodies a rough "
        "position=(x, y, z) or joints a start; in a closure of your own, avoid sqrt(0), division by zero and the like."
    )


def _nowhere(group: LoopGroup, domain: np.ndarray) -> AssemblyError:
    """A joint by itself that has no place inside its own domain, whose values are these where the search ended."""
    joint = group.joints[0].edge
    why = (
        joint.joint.why_outside(domain.size)[int(np.argmin(domain))]
        or "Check its dimensions, or begin elsewhere: give its coordinates a start, or bodies a rough position."
    )
    return AssemblyError(
        f"No position of joint '{joint.name}' ({joint.joint.created_at}) was found that is inside its domain. {why}"
    )


def _worst_loop(loops: tuple[LoopRows, ...], residual: np.ndarray) -> tuple[LoopRows, np.ndarray]:
    """The loop with the largest residual, and its residuals; those of loops come last."""
    first = residual.size - sum(rows.position.numel() for rows in loops)
    gaps: list[np.ndarray] = []
    for rows in loops:
        gaps.append(residual[first : first + rows.position.numel()])
        first += rows.position.numel()
    worst = int(np.argmax([np.max(gap, initial=0.0) for gap in gaps]))
    return loops[worst], gaps[worst]


def _in_words(rows: LoopRows, gaps: np.ndarray) -> str:
    """How far the joint's two ends are apart, and how far turned against one another; empty where there is but one of these."""
    turns = np.array([rows.wrench_basis[3:, k].is_zero() for k in range(gaps.size)])
    if not turns.any() or turns.all():
        return ""
    angle = np.degrees(np.arcsin(min(1.0, float(np.max(gaps[turns])))))
    return f": the joint's ends are {float(np.max(gaps[~turns])):.2g} m apart and {angle:.2g} degrees askew"
