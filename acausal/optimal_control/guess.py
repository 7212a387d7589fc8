"""Where the search for an optimal motion begins: a smooth path that keeps the loops closed, and what drives it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acausal.optimal_control.mesh import Mesh
from acausal.optimal_control.stage import Stage
from acausal.optimal_control.turning import product, spins, turning_path

if TYPE_CHECKING:
    from acausal.simulate.trajectory import Trajectory

HELD = 1e-3
"""How easily coordinates move that are told how to."""
_CLOSINGS = 20
"""Newton steps for each point of the path, at most."""
_SPEEDS = 2.5
"""Times the mean speed from stop to stop: with more than that at an end a smooth path goes back on its way."""
_EASILY = 3.0
"""How much more multipliers and inputs do than accelerations change, where one moves the scene as the other."""


@dataclass(frozen=True, eq=False)
class Guess:
    """The `duration` [s], at `times` (n,), parts of it, all unknowns of points `values` (n, width), and those of free parameters (k,).

    What was found has a `mesh`, whose points these are; the first `states` of the unknowns are known where an interval begins, too.
    """

    times: np.ndarray
    values: np.ndarray
    duration: float
    free: np.ndarray
    mesh: Mesh | None = None
    states: int = 0

    def at(self, times: np.ndarray) -> np.ndarray:
        """(m, width): between, by the polynomials of the mesh; by straight lines where there is none."""
        if self.mesh is None:
            return np.column_stack([np.interp(times, self.times, column) for column in self.values.T])
        s = self.mesh.tableau.stages
        k, of_states, of_others = self.mesh.between(times)
        there = self.values[s * k[:, None] + np.arange(s + 1)]
        states = np.einsum("mj,mjx->mx", of_states, there[:, :, : self.states])
        return np.hstack([states, np.einsum("mj,mjx->mx", of_others, there[:, 1:, self.states :])])


def path_guess(
    stage: Stage,
    stops: list[tuple[float, np.ndarray]],
    times: np.ndarray,
    duration: float,
    free: np.ndarray,
    units: np.ndarray,
    *,
    turned: np.ndarray,
    sought: np.ndarray,
    bend: np.ndarray | float = 0.0,
    around: int = -1,
) -> Guess:
    """Smoothly from stop to stop: (part of the duration, states (nx,)), positions as of least jerk, or at constant speed where some are
    `turned` (nx,) and others follow; what moves at stops, and on whose place nothing depends, with the speeds that it has there, or at constant speed where these do not go with the way; where it rolls, those that are `sought` (nx,) lead; driven as inverse dynamics says. Where there is one way only, bodies turn on
    from the spin that they have. `units` (width,): what is much for each unknown of a point. `bend` (times, nq): by how much
    positions are off that path; `around`: number of the quaternion that turns the long way.
    """
    nq, steady = stage.functions.space.nq, bool(turned.any())
    where = np.array([at for at, _ in stops])
    wanted = np.array([x for _, x in stops])
    k = np.clip(np.searchsorted(where, times, side="right") - 1, 0, max(0, where.size - 2))
    if where.size > 1:
        s = np.clip((times - where[k]) / (where[k + 1] - where[k]), 0, 1)
        blend = s if steady else s**3 * (10 - 15 * s + 6 * s * s)
        x = wanted[k] + (wanted[k + 1] - wanted[k]) * blend[:, None]
        if not steady:
            _go_on(stage, x, stops, k, s, np.append(duration, free))
    else:
        x = np.repeat(wanted, times.size, axis=0)
    if where.size == 2 and not steady and not _rolls(stage):
        _turn(stage, x, times, duration, free, sought, around)
    x[:, :nq] += bend
    much = units[: x.shape[1]]
    x[:, :nq] = closed(stage, x, times, duration, free, np.where(turned, HELD, 1.0) * much)[:, :nq]
    t = times * duration
    x = _moving(stage, x, t, free, duration, sought, much, steady=steady)
    x = closed(stage, x, times, duration, free, much, fresh=False)
    return Guess(times, _driven(stage, x, times, duration, free, units), duration, free)


def _rolls(stage: Stage) -> bool:
    """Whether positions cannot go all ways."""
    return stage.functions.space.velocities < stage.functions.space.nq - len(stage.quaternions)


def _go_on(
    stage: Stage, x: np.ndarray, stops: list[tuple[float, np.ndarray]], after: np.ndarray, s: np.ndarray, more: np.ndarray
) -> None:
    """Puts places into states (n, nx) that go on from the speeds at the stops, where nothing depends on them; `after` (n,): the stop behind each, and what part of the way to the
    next one has passed, `s` (n,).
    """
    where, wanted = np.array([at for at, _ in stops]), np.array([one for _, one in stops])
    speeds = np.array([stage.drift(one, at, more) for at, one in stops]) * stage.indifferent
    for place in np.flatnonzero(speeds.any(axis=0)):
        way, time = np.diff(wanted[:, place])[after], np.diff(where)[after] * more[0]
        first, last = speeds[:-1, place][after] * time, speeds[1:, place][after] * time
        far = _SPEEDS * np.abs(way)
        forward = (np.minimum(first * way, last * way) >= 0) & (np.maximum(np.abs(first), np.abs(last)) <= far)
        first, last = (np.where(forward, one, way) for one in (first, last))
        moved = first * s + (10 * way - 6 * first - 4 * last) * s**3 + (8 * first + 7 * last - 15 * way) * s**4
        moved += (6 * way - 3 * first - 3 * last) * s**5
        x[:, place] = wanted[after, place] + moved


def _turn(
    stage: Stage, x: np.ndarray, times: np.ndarray, duration: float, free: np.ndarray, sought: np.ndarray, around: int
) -> None:
    """Puts quaternions into states (n, nx) that turn on from their spins at both ends, or the long way."""
    rates = [stage.drift(x[k], times[k], np.append(duration, free)) for k in (0, -1)]
    for n, places in enumerate(stage.quaternions):
        first, last = x[0, places], x[-1, places]
        w0, w1 = (2 * product(x[k, places] * [1, -1, -1, -1], rates[k][places])[1:] for k in (0, -1))
        if n == around or spins(w0, duration) or spins(w1, duration):
            told = bool(sought[places].any())
            x[:, places] = turning_path((first, last), (w0, w1), duration, times, told=told, around=n == around)


def _arguments(stage: Stage, x: np.ndarray, duration: float, free: np.ndarray) -> np.ndarray:
    rest = np.zeros(stage.width - x.size)
    return np.concatenate([x, rest, [duration], free])


def closed(
    stage: Stage, x: np.ndarray, times: np.ndarray, duration: float, free: np.ndarray, easy: np.ndarray, *, fresh: bool = True
) -> np.ndarray:
    """States (n, nx) with their loops closed, those rather that are `easy` (nx,) to move, in units of each; each goes on from the one before where it is `fresh`."""
    rows, positions = stage.invariants
    if not rows.numel():
        return x
    nx = x.shape[1]
    found = x.copy()
    nq = stage.functions.space.nq
    for k in range(len(found)):
        if fresh and k:
            found[k, :nq] = found[k - 1, :nq] + x[k, :nq] - x[k - 1, :nq]
        before, gap, slope = found[k].copy(), np.zeros((0, 1)), np.zeros((0, nx))
        for _ in range(_CLOSINGS):
            gap, slope = (np.array(part) for part in stage.closing(_arguments(stage, found[k], duration, free), [times[k], 0.0]))
            change = np.zeros(nx)
            change[:nq] = _least(slope[:positions, :nq], -gap[:positions, 0], easy[:nq])
            change[nq:] = _least(slope[positions:, nq:], -gap[positions:, 0] - slope[positions:, :nq] @ change[:nq], easy[nq:])
            found[k] += change
            if np.max(np.abs(change / easy)) <= 1e-12 * np.max(np.abs(found[k] / easy)):
                break
        room = 1e-6 * (np.abs(slope) @ (np.abs(found[k]) + easy))
        if not np.all(np.isfinite(found[k])) or np.any(np.abs(gap[:, 0]) > room):
            found[k] = found[k - 1] if fresh and k else before
    return found


def _least(slopes: np.ndarray, wanted: np.ndarray, much: np.ndarray) -> np.ndarray:
    """The least x (n,), in units of what is `much`, with slopes x = wanted (m,), each row in units of its own."""
    own = slopes * much
    row = np.linalg.norm(own, axis=1)
    row = np.where(row > 0, row, 1.0)
    return much * np.linalg.lstsq(own / row[:, None], wanted / row, rcond=1e-10)[0]


def _moving(
    stage: Stage,
    x: np.ndarray,
    t: np.ndarray,
    free: np.ndarray,
    duration: float,
    sought: np.ndarray,
    much: np.ndarray,
    *,
    steady: bool,
) -> np.ndarray:
    """With velocities (n, nv) that go with the positions, measured by what is `much` (nx,); at both ends as they are, unless it is `steady`. Where positions cannot go all ways (what rolls),
    those that are not `sought` (nx,) follow from the others.
    """
    nq, nv = stage.functions.space.nq, stage.functions.space.velocities
    slope = np.gradient(x[:, :nq], t, axis=0) if t.size > 1 else np.zeros((1, nq))
    rolls = _rolls(stage)
    weight = np.where(sought[:nq] | (not rolls), 1.0, HELD) / much[:nq]
    fast = much[nq : nq + nv]
    found = x.copy()

    def rates(k: int) -> np.ndarray:
        """Of positions, with velocities put in their place."""
        found[k, nq : nq + nv] = 0.0
        arguments = _arguments(stage, found[k], duration, free)
        drift, matrix = (np.array(part) for part in stage.moving(arguments, [t[k] / duration, 0.0]))
        v = fast * np.linalg.lstsq(matrix * weight[:, None] * fast, (slope[k] - drift[:, 0]) * weight, rcond=None)[0]
        found[k, nq : nq + nv] = v
        return drift[:, 0] + matrix @ v

    before = rates(0)
    for k in range(1, len(x)):
        if rolls:
            found[k, :nq] = found[k - 1, :nq] + (t[k] - t[k - 1]) * before
            found[k, :nq] = found[k - 1, :nq] + 0.5 * (t[k] - t[k - 1]) * (before + rates(k))
        before = rates(k)
    if not steady:
        found[[0, -1], nq : nq + nv] = x[[0, -1], nq : nq + nv]
    return found


def _driven(stage: Stage, x: np.ndarray, times: np.ndarray, duration: float, free: np.ndarray, units: np.ndarray) -> np.ndarray:
    """(n, width): accelerations near those of the path, and the least inputs that meet the equations of motion; those whose unit is 0 are measured by what inertia resists."""
    nx, nv, _, _ = stage.sizes
    nq = stage.functions.space.nq
    values = np.column_stack([x, np.zeros((len(x), stage.width - nx))])
    values[:, nx : nx + nv] = np.gradient(x[:, nq : nq + nv], times * duration, axis=0) if len(x) > 1 else 0.0
    told = [stage.driving(np.concatenate([z, [duration], free]), [at, 0.0]) for z, at in zip(values, times, strict=True)]
    gaps, slopes = (np.array([np.array(part) for part in parts]) for parts in zip(*told, strict=True))
    known = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(gaps).all(axis=(1, 2))
    size = units[nx:].copy()
    pushes = _resisted(np.abs(slopes[known]), size[:nv])
    size[nv:] = np.where(size[nv:] > 0, size[nv:], _EASILY * pushes)
    for k in np.flatnonzero(known):
        own = slopes[k] * size
        row = np.max(np.abs(own), axis=1, initial=0.0)
        row = np.where(row > 0, row, 1.0)
        values[k, nx:] -= size * np.linalg.lstsq(own / row[:, None], gaps[k, :, 0] / row, rcond=1e-12)[0]
    return values


def _resisted(slopes: np.ndarray, accelerations: np.ndarray) -> np.ndarray:
    """(m - nv,): how much of each multiplier and input does what these `accelerations` (nv,) change, by absolute slopes (n, rows, m) of equations of motion at some points; 1 where none does
    anything.
    """
    nv, largest = accelerations.size, np.max(slopes, axis=0, initial=0.0)
    inertia = np.max(largest[:, :nv] * accelerations, axis=1, initial=0.0)
    moving = inertia > 0
    acting = np.max(largest[moving, nv:] / inertia[moving, None], axis=0, initial=0.0)
    return np.where(acting > 0, 1 / np.where(acting > 0, acting, 1.0), 1.0)


def run_guess(stage: Stage, run: Trajectory, geometry: np.ndarray, times: np.ndarray) -> Guess:
    """From a motion that was simulated, at `times` (n,), parts of its duration."""
    first, last = run.t[0], run.t[-1]
    there = run.at(first + times * (last - first))
    values = points_of(stage, there.t, there.x, there.u, run.problem.parameters)
    return Guess(times, values, float(last - first), geometry)


def points_of(stage: Stage, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """(n, width): all unknowns of points, by times (n,), states (nx, n), inputs of the model (nu, n) and parameters (np,)."""
    _, nv, _, inputs = stage.sizes
    f, nq = stage.functions, stage.functions.space.nq
    given = t[None, :], x, u, np.repeat(p[:, None], t.size, axis=1)
    modes = f.outputs.system.modes
    found = [x, np.array(f.explicit_dynamics(*given))[nq : nq + nv], np.array(f.multipliers(*given))]
    found += [] if modes is None else [np.array(f.output(modes.found)(*given))]
    return np.vstack([*found, np.zeros((len(stage.quaternions), t.size)), u[:inputs]]).T
