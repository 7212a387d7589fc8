"""Small deviations from a consistent state in independent entries, where loops are closed and quaternions have unit length."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.analysis.point import Differentiable, OperatingPoint
from acausal.analysis.state_sizes import ROUNDING, Sizes, sizes_at
from acausal.charts.independent import independent_entries
from acausal.charts.rodrigues import ChartCoordinates
from acausal.charts.singular_state import singular_loops
from acausal.errors import OptionError
from acausal.outputs.functions import Functions
from acausal.parts.unit_quaternions import unit_quaternions
from acausal.reduce.reduce import ReducedSystem


@dataclass(frozen=True)
class Tangent:
    """Small changes at a point: dx = `expand` dy + `led` du (nx, k) and (nx, nu), dy = `pick` dx (k, nx), and the rate of `pick` along the motion."""

    expand: np.ndarray
    led: np.ndarray
    pick: np.ndarray
    pick_rate: np.ndarray


@dataclass(frozen=True)
class Deviations:
    """Changes dy (k,) of independent entries of the state, named `names`.

    In place of a unit quaternion stands the small rotation vector of frame_b, in frame_b, away from the point or the motion
    looked at: q = q0 * (1, rotation / 2), four times the Rodrigues parameters of `coordinates` to first order. It has no singular
    attitude. `sizes`: of the states at the point where the entries were chosen. `free`: which entries of the `coordinates` of x are independent.
    `felt` (m,): which of the `invariants` some entry changes there, by more than rounding. `led` (m,): in which of them inputs stand, which states follow at once.
    """

    system: ReducedSystem
    x_dot: Differentiable
    invariants: Differentiable
    sizes: Sizes
    coordinates: ChartCoordinates
    free: tuple[int, ...]
    names: tuple[str, ...]
    felt: np.ndarray
    led: np.ndarray

    @property
    def free_sizes(self) -> np.ndarray:
        """Of the independent entries (k,)."""
        return coordinate_sizes(self.coordinates, self.sizes.x)[list(self.free)]

    def tangent(self, at: OperatingPoint, x_dot: np.ndarray) -> Tangent:
        """For a motion through the point with the rates `x_dot` (nx,)."""
        turn, back = _turns(self.coordinates, at.x)
        back_rate = _turns(self.coordinates, x_dot)[1] - _turns(self.coordinates, 0 * at.x)[1]
        G = self.invariants.along(at, turn)
        free = list(self.free)
        own = set(free)
        dependent = [i for i in range(turn.shape[1]) if i not in own]
        change = np.zeros((turn.shape[1], len(free)))
        change[free, range(len(free))] = 1.0
        led = np.zeros((turn.shape[1], at.u.size))
        if dependent:
            size = coordinate_sizes(self.coordinates, self.sizes.x)
            exponents = _exponents(G, size)[self.felt, None]
            G = np.ldexp((G * size)[self.felt], -exponents)
            follow = np.linalg.lstsq(G[:, dependent], G[:, free], rcond=None)[0]
            change[dependent] = -size[dependent, None] * follow / size[free]
            if self.led.any():
                by_inputs = np.where(self.led[:, None], self.invariants.along(at, du=np.eye(at.u.size)), 0.0)[self.felt]
                led[dependent] = (
                    -size[dependent, None] * np.linalg.lstsq(G[:, dependent], np.ldexp(by_inputs, -exponents), rcond=None)[0]
                )
        return Tangent(turn @ change, turn @ led, back[free], back_rate[free])


def coordinate_sizes(coordinates: ChartCoordinates, sizes: np.ndarray) -> np.ndarray:
    """Of the coordinates (nz,), where the states have these sizes (nx,)."""
    return np.concatenate([np.zeros(0), *(np.ones(3) if size == 3 else sizes[[i]] for i, size in coordinates.places)])


def _scaled(G: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Rows G (m, n) for entries measured by their sizes (n,), each row divided by its largest entry, to a power of two."""
    return np.ldexp(G * sizes, -_exponents(G, sizes)[:, None])


def _exponents(G: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Of the powers of two that these entries are divided by (m,)."""
    return np.frexp(np.max(np.abs(G * sizes), axis=1, initial=0.0))[1]


def deviations_at(functions: Functions, at: OperatingPoint, x_dot: Differentiable | None = None) -> Deviations:
    """In the independent entries that move the others least violently at a point: first positions, then their rates and scalar states.

    `x_dot`: the rates of all states, where they have been made. Raises `OptionError` where a loop is in a singular position.
    """
    s = functions.outputs.system
    singular = singular_loops(functions, at.t, at.x, at.p)
    if singular:
        raise OptionError(f"{singular} Choose a point beside it.")
    lengths = unit_quaternions(s.position_invariants, s.x[: s.nq, :])  # which turns do not change
    units = tuple(sorted(lengths.values()))
    coordinates = ChartCoordinates(s.x.numel(), units)
    names = coordinates.names(functions.state_names, "rotation")
    every, speeds = held_by(s)
    places = every[[k for k in range(every.numel()) if k not in lengths], :]
    invariants = Differentiable(s, ca.vertcat(places, speeds))
    x_dot = Differentiable(s, s.x_dot) if x_dot is None else x_dot
    sizes = sizes_at(s, x_dot, at)
    G, size = invariants.along(at, _turns(coordinates, at.x)[0]), coordinate_sizes(coordinates, sizes.places)
    followers = [s.scalar_places[k] for k in sorted(s.scalar.followers)]
    moved = np.concatenate([at.x[: s.nq], np.maximum(np.abs(at.x), sizes.places)[s.nq :]])
    moved[followers] = at.x[followers]  # elsewhere their laws may be of any size
    moving = replace(at, x=moved)
    rounding = ROUNDING * np.finfo(float).eps * invariants.terms(moving)
    felt = ~(
        np.max(np.abs(G * size), axis=1, initial=0.0) <= rounding
    )  # what quaternions of length 1 make constant has slopes of rounding errors
    G[~felt] = 0.0
    rows, nq = places.numel(), s.nq - len(units)
    joints = s.position_invariants.numel() - len(lengths)
    positions = independent_entries(_scaled(G[:rows, :nq], size[:nq])).free
    scalar = [k for k in range(joints, rows) if not G[k, :nq].any()]  # gaps of scalar parts, whose positions come later
    later = [*scalar, *range(rows, G.shape[0])]
    led = np.array([ca.depends_on(row, s.u) for row in ca.vertsplit(s.velocity_invariants)], dtype=bool)
    preferred = [_matching(s, coordinates, positions)]
    if led.any():  # what follows inputs is no state of its own
        preferred.insert(0, [i for i in range(size.size - nq) if i + s.nq not in followers])
    rates = independent_entries(_scaled(G[later, nq:], size[nq:]), *preferred).free
    free = (*positions, *(nq + i for i in rates))
    led = np.concatenate([np.zeros(rows, dtype=bool), led, np.zeros(G.shape[0] - rows - led.size, dtype=bool)])
    return Deviations(s, x_dot, invariants, sizes, coordinates, free, tuple(names[i] for i in free), felt, led)


def held_by(s: ReducedSystem) -> tuple[ca.SX, ca.SX]:
    """Columns of positions and of velocities that stay zero: of loops, and of what is closed or sticks in the mode that the masks are of."""
    places, speeds = [s.position_invariants], [s.velocity_invariants]
    for held in (s.locks, s.modes):
        places += [] if held is None else [held.held_places]
        speeds += [] if held is None else [held.held_speeds]
    return ca.vertcat(*places), ca.vertcat(*speeds)


def _turns(coordinates: ChartCoordinates, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """dx = turn dz (n, nz) and dz = back dx (nz, n), z with a rotation vector in frame_b in place of each quaternion."""
    turn, back = np.zeros((x.size, coordinates.count)), np.zeros((coordinates.count, x.size))
    k = 0
    for i, size in coordinates.places:
        if size == 3:
            a, b, c, d = x[i : i + 4]
            L = np.array([[-b, -c, -d], [a, -d, c], [d, a, -b], [-c, b, a]])
            turn[i : i + 4, k : k + 3], back[k : k + 3, i : i + 4] = 0.5 * L, 2.0 * L.T
        else:
            turn[i, k] = back[k, i] = 1.0
        k += size
    return turn, back


def _matching(s: ReducedSystem, coordinates: ChartCoordinates, positions: tuple[int, ...]) -> list[int]:
    """The velocities that belong to independent positions, where joints have as many of one as of the other."""
    chosen = set(positions)
    wanted: list[int] = []
    for joint in s.tree_joints:
        own = [i for begin in range(joint.q.start, joint.q.stop) for i in coordinates.entries(begin)]
        own = list(dict.fromkeys(own))
        if len(own) == joint.v.stop - joint.v.start:
            wanted += [joint.v.start + k for k, i in enumerate(own) if i in chosen]
    return wanted
