"""Other ways from start to end than the straight one: beside what stands in its way, with a swing on the way as the scene swings by itself, with any, and in other times."""

from __future__ import annotations

import functools
import itertools
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from acausal.numerics.folding import folded_function
from acausal.optimal_control.asked import Asked, Limits
from acausal.optimal_control.guess import Guess
from acausal.optimal_control.stage import Stage
from acausal.optimal_control.turning import FAR, short_way
from acausal.optimal_control.whole import Part

_FAR = 0.3
"""Of how far the straight path goes: by how much another one is beside it."""
_WIDTHS = (1.0, 0.3, 0.6, 1.5)
"""Times that: how wide the scene's own swings are, one width after the other."""
_STEP = 1e-5
"""Of what is much for a state: the difference by which slopes are taken."""
_POINTS = 3
"""Intervals in which a swing comes and goes, at least."""
_PLACES, _ROUNDING = 7, 1e-9
"""Points at which it is looked up how a cost is bent; of its largest curvature, what is none."""
_ANY = 2
"""How many other paths are tried where nothing was found."""
_WAVES = 3
"""How many waves any swing is made of."""
_OBSTACLES, _SIDES, _CLEAR, _STEPS = 4, 2, 1.2, np.geomspace(1 / 64, 4, 25)
"""How many things in the way are gone around, and along how many lines across it, both ways; how far, of what clears them; of how far the straight path goes, how far that is looked for."""
_LONGER = (2.0, 0.5, 4.0)
"""How much more time another path takes where nothing was found."""


Own = Callable[[Guess], Guess]
"""Another guess of a part, from what was found from the first one."""
Other = Callable[[Sequence[Guess]], list[Guess]]
"""The same of all parts."""


def other_guesses(parts: Sequence[Part], count: int) -> list[list[Other]]:
    """Of each part its own: the first ones together, then the second ones; a part that has not so many begins as it did."""
    rows = [_of_part(part, count) for part in parts]
    found = list[list[Other]]()
    for together in itertools.zip_longest(*rows, fillvalue=()):
        ways = itertools.zip_longest(*together)
        found.append(
            [functools.partial(_each, [own or _as_before(part) for own, part in zip(way, parts, strict=True)]) for way in ways]
        )
    return found


def _each(ways: Sequence[Own], found: Sequence[Guess]) -> list[Guess]:
    return [way(one) for way, one in zip(ways, found, strict=True)]


def _as_before(part: Part) -> Own:
    return lambda _: part.guess


def _of_part(part: Part, count: int) -> list[list[Own]]:
    """So many of each: those beside obstacles, and with swings of the scene's own; those with any, where these lead nowhere; then those in more time and less, where that is free. None where
    a motion was given; no swings where all is linear and the cost is bent upwards, or where nothing has a place.
    """
    bent, stage, first = part.bent, part.asked.stage, part.guess
    if bent is None or count == 0:
        return []
    least, most = part.asked.duration
    times = [factor * first.duration for factor in _LONGER if least <= factor * first.duration <= most][:count]
    others = [[_made(bent, 0.0, one) for one in times]]
    if stage.functions.space.nq == 0 or (part.asked.linear and not _bent_down(part.asked, first, part.units)):
        return [[], *others] if times else []
    if part.asked.linear:  # there are several best ones by what is minimised alone, one way and the other
        ways = [sign * one for one in _any(stage, first, part.units, _ANY) for sign in (1, -1)]
        return [[functools.partial(_mirrored, first), *(_made(bent, one, None) for one in ways)][:count], *others]
    beside = [_made(bent, one, None) for one in _beside(part.asked, first, part.units)]
    anyhow = [_made(bent, one, None) for one in _any(stage, first, part.units, min(count, _ANY))]
    slowly = most if first.duration < most and not part.asked.cost.per_second else None
    own = _natural(stage, first if slowly is None else replace(first, duration=slowly), part.units, part.mesh.intervals)
    natural = [_made(bent, one, slowly) for one in ([0.0, *own] if slowly is not None else own)]
    return [[*_the_long_way(bent, stage, first), *beside, *natural][:count], anyhow, *others]


def _the_long_way(bent: Callable[..., Guess], stage: Stage, first: Guess) -> list[Own]:
    """Of each body by itself that turns far: what it has to turn is the same either way round, and what is best of it shows only then. The farthest first."""
    ways = [short_way(first.values[0, places], first.values[-1, places]) for places in stage.quaternions]
    far = sorted((k for k, angle in enumerate(ways) if angle > FAR), key=lambda k: -ways[k])
    return [functools.partial(_around, bent, k) for k in far]


def _around(bent: Callable[..., Guess], quaternion: int, _: Guess) -> Guess:
    return bent(0.0, None, quaternion)


def _made(bent: Callable[..., Guess], bend: np.ndarray | float, time: float | None) -> Own:
    """Whatever was found."""
    return lambda _: bent(bend, time)


def _mirrored(first: Guess, found: Guess) -> Guess:
    """As far from the guess as what was found, on its other side: what is linear is possible there, too."""
    values = 2 * first.at(found.times) - found.values
    return Guess(found.times, values, first.duration, first.free)


def _bent_down(asked: Asked, first: Guess, units: np.ndarray) -> bool:
    """Whether what is minimised is bent downwards by the unknowns of a point, at the guess or beside it."""
    stage, more = asked.stage, np.append(first.duration, first.free)
    z, rng = stage.unknowns[: stage.width], np.random.default_rng(0)
    for part in (asked.cost.integrals, asked.cost.averages, asked.cost.starts, asked.cost.ends):
        bend = ca.densify(ca.hessian(stage.put(part), z)[0])
        function = folded_function("bend", [stage.unknowns, stage.data], [bend])
        for at in np.linspace(0, len(first.values) - 1, _PLACES).astype(int):
            place = first.values[at] + units * rng.normal(size=units.size)
            found = np.array(function(np.append(place, more), [float(first.times[at]), 0.0])) * units * units[:, None]
            if np.isfinite(found).all() and np.min(np.linalg.eigvalsh(found)) < -_ROUNDING * np.max(np.abs(found)):
                return True
    return False


def _beside(asked: Asked, first: Guess, units: np.ndarray) -> list[np.ndarray]:
    """(times, nq) each, of positions: beside whatever keeps the straight path out, as obstacles do, one way and the other, and of several one this way and one that way. Nothing
    where it is free to go, or where what keeps it out is no bent function of places.
    """
    stage, T = asked.stage, first.times
    nq, more = stage.functions.space.nq, np.append(first.duration, first.free)
    way = np.gradient(first.values[:, :nq] / units[:nq], axis=0)
    far, met = _far(stage, first, units), list[tuple[int, list[np.ndarray]]]()
    for limits in asked.path:
        value, places = stage.put(limits.value), stage.unknowns[:nq]
        others = ca.vertcat(stage.unknowns[nq : stage.width])
        if not value.numel() or ca.depends_on(value, others) or not any(ca.which_depends(value, places, 2, True)):
            continue
        f = ca.Function("value", [stage.unknowns, stage.data], [value])

        def off(z: np.ndarray, when: np.ndarray, f: ca.Function = f, limits: Limits = limits) -> np.ndarray:
            points = np.hstack([z, np.tile(more, (len(z), 1))]).T
            return limits.excess(np.array(f(points, np.vstack([when, np.zeros(when.size)]))))

        outside = off(first.values, T)
        for r in np.flatnonzero(np.max(outside, axis=1) > 0):
            k = int(np.argmax(outside[r]))
            counts = np.array(ca.which_depends(value[int(r)], places, 1, False), dtype=bool)
            found = list[np.ndarray]()
            for side in _across(way[k] * counts, counts)[:_SIDES]:
                for sign in (1.0, -1.0):
                    moved = np.repeat(first.values[[k]], _STEPS.size, axis=0)
                    moved[:, :nq] += sign * far * _STEPS[:, None] * side * units[:nq]
                    clear = np.flatnonzero(off(moved, np.full(_STEPS.size, T[k]))[r] == 0)
                    found += [sign * _CLEAR * far * _STEPS[clear[0]] * side * units[:nq]] if clear.size else []
            met += [(k, found)] if found and 0 < T[k] < 1 else []
    met = met[:_OBSTACLES]
    bumps = np.array([np.sin(np.pi * T ** (np.log(0.5) / np.log(T[k]))) for k, _ in met]).reshape(len(met), T.size)
    heights = bumps[:, [k for k, _ in met]].T
    ways = sorted(itertools.product(*(range(len(found)) for _, found in met)), key=lambda chosen: len({*chosen})) if met else []
    sides = ([found[c] for (_, found), c in zip(met, chosen, strict=True)] for chosen in ways)
    return [bumps.T @ np.linalg.lstsq(heights, np.array(one), rcond=1e-3)[0] for one in sides]


def _across(way: np.ndarray, counts: np.ndarray) -> list[np.ndarray]:
    """Unit vectors (nq,) across a way, of the entries that count."""
    kept = np.eye(way.size)[counts]
    length = np.linalg.norm(way)
    if length > 0:
        kept = kept - np.outer(kept @ way, way) / length**2
    _, s, V = np.linalg.svd(kept, full_matrices=False)
    return [row * np.sign(row[np.argmax(np.abs(row))]) for row in V[s > 1e-6]]


def _natural(stage: Stage, first: Guess, units: np.ndarray, intervals: int) -> list[np.ndarray]:
    """(times, nq) each, of positions: the fastest and the slowest swing about the start that this motion has time for and the mesh has points for, out one way and the
    other, first of one width and then of others. With its own swings a pendulum goes up at a fraction of the effort.
    """
    nx, nq, T = stage.sizes[0], stage.functions.space.nq, first.duration
    A = _slope(stage, first, units)
    if not np.isfinite(A).all():
        return []
    values, vectors = np.linalg.eig(A)
    turning = np.imag(values) * T
    ways = [
        k
        for k in range(nx)
        if abs(np.real(values[k])) < np.imag(values[k]) and np.pi <= turning[k] <= 2 * np.pi * intervals / _POINTS
    ]
    ways.sort(key=lambda k: -turning[k])
    found = list[np.ndarray]()
    for k in dict.fromkeys([*ways[:1], *ways[-1:]]):
        shape = vectors[:nq, k]
        shape = np.real(shape / shape[np.argmax(np.abs(shape))])
        found.append((np.sin(np.pi * first.times) * np.sin(turning[k] * first.times))[:, None] * shape)
    far = _FAR * _far(stage, first, units) * units[:nq]
    return [width * sign * far * one for width in _WIDTHS for sign in (1, -1) for one in found]


def _any(stage: Stage, first: Guess, units: np.ndarray, count: int) -> list[np.ndarray]:
    """(times, nq) each: some waves, the later the wider; drawn by names, so that the order of states does not matter."""
    nq, k = stage.functions.space.nq, np.arange(1, _WAVES + 1)
    waves = np.sin(np.pi * first.times[:, None] * k) / k
    seeds = [zlib.crc32(name.encode()) for name in stage.functions.state_names[:nq]]
    drawn = np.array([np.random.default_rng(seed).normal(size=(count, _WAVES)) for seed in seeds])
    wide = _FAR * _far(stage, first, units) * np.linspace(1, 1 / _FAR, count)
    return [wide[n] * waves @ drawn[:, n].T * units[:nq] for n in range(count)]


def _far(stage: Stage, first: Guess, units: np.ndarray) -> float:
    """How far it goes, in units of positions."""
    nq = stage.functions.space.nq
    return float(np.max(np.ptp(first.values[:, :nq], axis=0) / units[:nq], initial=0.0)) or 1.0


def _slope(stage: Stage, first: Guess, units: np.ndarray) -> np.ndarray:
    """(nx, nx), in units of the states [1/s]: of their rates at the start, by themselves."""
    f, nx = stage.functions, stage.sizes[0]
    z, step = first.values[0], _STEP * units[:nx]
    u = stage.told(z[stage.width - stage.sizes[3] :])
    x = np.hstack([z[:nx, None] + np.diag(step), z[:nx, None] - np.diag(step)])
    rates = np.array(f.explicit_dynamics(stage.t0, x, u, stage.p))
    return (rates[:, :nx] - rates[:, nx:]) / (2 * step) * units[:nx] / units[:nx, None]
