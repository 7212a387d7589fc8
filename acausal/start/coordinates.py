"""Coordinates of the tree's joints by kind: which are angles, quaternions, lengths; distances between configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.dynamics.slopes import slopes_of_places
from acausal.dynamics.system import MechanicalSystem
from acausal.parts.joint_coordinates import Coordinate, joint_coordinates
from acausal.parts.pose import symbolic
from acausal.reduce.reduce import ReducedSystem


@dataclass(frozen=True)
class Coordinates:
    """All of them, in the order of q (nq,), and what is much for each entry of q: 1 for angles and quaternions, a length for lengths. `size`: of the mechanism [m], 0 where no link
    or coordinate tells it.
    """

    all: tuple[Coordinate, ...]
    scale: np.ndarray
    size: float = 0.0

    @property
    def turning(self) -> np.ndarray:
        """(nq,), True for entries of angles and quaternions."""
        return np.concatenate([np.zeros(0, dtype=bool), *(np.full(c.place.stop - c.place.start, c.turns) for c in self.all)])

    def measured(self, sizes: np.ndarray, places: Sequence[int]) -> Coordinates:
        """The same where these entries (nq,) at `places` are much."""
        scale = self.scale.copy()
        scale[places] = sizes[places]
        return replace(self, scale=scale)

    def differences(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Distance of two configurations in each coordinate, as part of what is much for it."""
        return np.array([c.distance(a, b) / self.scale[c.place.start] for c in self.all])

    def canonical(self, q: np.ndarray, near: np.ndarray) -> np.ndarray:
        """The same configuration with angles within half a turn of `near`, quaternions of the nearer sign."""
        result = q.copy()
        for c in self.all:
            if c.is_rotation:
                result[c.place] *= 1.0 if result[c.place] @ near[c.place] >= 0 else -1.0
            elif c.periodic:
                i = c.place.start
                result[i] -= 2 * np.pi * np.round((result[i] - near[i]) / (2 * np.pi))
        return result

    def scattered(self, rng: np.random.Generator, near: np.ndarray) -> np.ndarray:
        """A configuration anywhere: angles and rotations uniform, others about `near` within the mechanism's size."""
        result = near + self.scale * rng.normal(size=near.size)
        for c in self.all:
            if c.is_rotation:
                p = rng.normal(size=4)
                result[c.place] = p / np.linalg.norm(p)
            elif c.periodic:
                result[c.place] = rng.uniform(-np.pi, np.pi)
        return result


def coordinates(system: MechanicalSystem, p: ca.SX, values: np.ndarray, q: np.ndarray, coupled: ca.SX) -> Coordinates:
    """Of the tree's joints; the mechanism's size is taken at `q`. Turns are counted for angles in the equations `coupled` (gears)."""
    tree = system.tree
    found: list[Coordinate] = []
    counted = {s.element_hash() for s in ca.symvar(coupled)}
    for item in tree.joints:
        for c in joint_coordinates(f"{item.edge.name}.q", item.edge.joint, item.q.start):
            found.append(replace(c, periodic=c.periodic and tree.q[c.place.start].element_hash() not in counted))
    all = tuple(found)
    slopes = slopes_of_places(tree, p, q, values)
    size = reach(system, p, values, q, all)
    known = size if 0 < size < np.inf else 0.0
    return Coordinates(all, np.where(Coordinates(all, np.zeros(0)).turning, 1.0, (known or 1.0) / slopes), known)


def turning_states(r: ReducedSystem) -> tuple[np.ndarray, np.ndarray]:
    """Which entries of q are angles and quaternions, and which of the velocities and scalar states are rates of these."""
    turns, rates = r.mechanics.tree.turning
    scalars = [s.is_angle for s in r.scalar_states[: r.scalar.positions]]
    return np.append(turns, np.array(scalars, dtype=bool)), np.append(rates, np.zeros(r.rate_start.size - rates.size, dtype=bool))


def reach(system: MechanicalSystem, p: ca.SX, values: np.ndarray, q: np.ndarray, all: tuple[Coordinate, ...]) -> float:
    """The greatest offset of any link or coordinate at q [m]; 0 where there is none."""
    tree, slopes = system.tree, slopes_of_places(system.tree, p, q, values)
    offsets = [ca.norm_2(symbolic(link.offset.position)) for link in tree.links]
    offsets += [ca.norm_2(symbolic(pose.position)) for _, pose in tree.places]
    offsets += [ca.norm_2(symbolic(x.position)) for e in system.mechanism.cuts for x in (e.pose_a, e.pose_b)]
    size = ca.Function("size", [tree.q, tree.t, p], [ca.vertcat(ca.SX(0, 1), *offsets)])
    lengths = [float(abs(q[i]) * slopes[i]) for i in (c.place.start for c in all if not c.turns)]
    return float(np.max(np.array(size(q, 0.0, values)), initial=max(lengths, default=0.0)))
