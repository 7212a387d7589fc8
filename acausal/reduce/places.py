"""Places at which what a motion depends on is looked at: here and there, by as much as the scene is large."""

from __future__ import annotations

from typing import Any, Protocol

import casadi as ca
import numpy as np

from acausal.dynamics.tree import JointSymbols
from acausal.numerics.sizes import positive
from acausal.parts.pose import symbolic
from acausal.reduce.holding import Reduced

_NEARER = 4
"""Steps of Newton's that bring coordinates drawn at random back to where quaternions have the length 1 and loops close."""
_CLOSED = 1e-6
"""What may be left of that: where loops are open reactions may move what they hold in any sense."""


class Placed(Reduced, Protocol):
    """What is asked of a reduced system."""

    @property
    def tree_joints(self) -> tuple[JointSymbols, ...]: ...
    @property
    def q_start(self) -> np.ndarray: ...


def places(system: Placed) -> tuple[tuple[Any, ...], ...]:
    """Values of t, x, u and p at some configurations, here and there where joints have coordinates, and with velocities at random."""
    rng = np.random.default_rng(8)
    own, q = (
        ca.vertcat(system.constraints.joint_invariants, *(rows.position for rows in system.constraints.loops)),
        system.x[: system.nq, :],
    )
    known = [system.t, system.x, system.u, system.p]
    off = ca.Function("off", known, [ca.densify(own), ca.densify(ca.jacobian(own, q))])
    domain = ca.vertcat(ca.SX(1), *(item.edge.joint.domain(system.x[item.q, :]) for item in system.tree_joints))
    inside = ca.Function("inside", known, [ca.mmin(domain)])
    reach, speed = _sizes(system)
    found: list[tuple[Any, ...]] = []
    for spread in (0.0, 0.3, 1.0):
        for sample in system.samples[:2]:
            rates = system.rate_start + spread * speed * rng.uniform(-1, 1, speed.size)
            place = sample + spread * reach * rng.uniform(-1, 1, reach.size)
            for _ in range(_NEARER if own.numel() else 0):
                c, J = (np.array(part) for part in off(0.0, np.concatenate([place, rates]), system.u_defaults, system.p_values))
                place = place - np.linalg.lstsq(J, c[:, 0])[0] if np.isfinite(J).all() else place
            values = 0.0, np.concatenate([place, rates]), system.u_defaults, system.p_values
            left = np.abs(np.array(off(*values)[0])).max(initial=0.0) if own.numel() and spread else 0.0
            if float(inside(*values)) > 0 and not left > _CLOSED:
                found.append(values)
    return tuple(found)


def _sizes(system: Placed) -> tuple[np.ndarray, np.ndarray]:
    """How far coordinates (nq,) go until something is another, and by how much velocities (n,) change them so in a second.

    A length is measured by the radius of gyration of what it moves; of what has none by the lever arms of angles on the links that it moves; where there are
    none, by how far they go until gaps have other slopes; what none of these knows by the shortest of the others. Angles by 1.
    """
    tree = system.mechanics.tree
    nq, straight = tree.q.numel(), ~tree.turning[0]
    reach, speed = np.ones(system.samples[0].size), np.ones(system.rate_start.size)
    reach[:nq][straight] = 0.0
    for joint in tree.joints:
        inertia = tree.links[joint.link].inertia
        square = np.trace(_at_start(system, ca.SX(inertia.second_moment))) / max(
            _at_start(system, ca.SX(inertia.mass)).item(), np.finfo(float).tiny
        )
        own = np.arange(joint.q.start, joint.q.stop)
        reach[own[straight[own]]] = np.sqrt(square) if np.isfinite(square) else 0.0
    if not reach.all():
        slopes = ca.jacobian(
            ca.vertcat(*(symbolic(system.mechanics.kinematics.pose(k).position) for k in range(len(tree.links)))), tree.q
        )
        lengths = np.linalg.norm(_at_start(system, slopes).reshape(-1, 3, nq), axis=1)
        arms = np.max(np.where(straight, 0.0, lengths), axis=1)
        reach[:nq] = np.where(reach[:nq] > 0, reach[:nq], np.max(np.where(lengths > 0, arms[:, None], 0.0), axis=0))
    missing = np.flatnonzero(reach == 0)
    if missing.size:
        gaps = ca.vertcat(ca.SX(0, 1), *(row.gap for row in system.mechanics.modes if row.one_sided))
        slopes = ca.vec(ca.jacobian(gaps, tree.q[[int(i) for i in np.flatnonzero(straight)]]))
        bends = np.abs(_at_start(system, ca.jacobian(slopes, tree.q[[int(i) for i in missing]])))
        steepest, most = np.max(np.abs(_at_start(system, slopes)), initial=0.0), np.max(bends, axis=0, initial=0.0)
        reach[missing] = np.divide(steepest, most, out=np.zeros(missing.size), where=most > 0)
    lengths = reach[:nq][straight & np.isfinite(reach[:nq]) & (reach[:nq] > 0)]
    reach = np.where(np.isfinite(reach) & (reach > 0), reach, np.min(lengths, initial=np.inf) if lengths.size else 1.0)
    N = np.abs(_at_start(system, ca.jacobian(tree.rates, tree.v)))
    most = np.max(N / reach[:nq, None], axis=0, initial=0.0)
    speed[: most.size] = 1 / positive(most)
    return reach, speed


def _at_start(system: Placed, value: ca.SX) -> np.ndarray:
    """Numbers of an expression, without modes, where searches begin."""
    x = np.concatenate([system.q_start, system.rate_start])
    known = [system.t, system.x, system.u, system.p]
    free = ca.Function("value", known, [value], {"allow_free": True}).free_sx()  # what only dynamics or modes know
    function = ca.Function("value", [*known, *free], [ca.densify(value)])
    return np.array(function(0.0, x, system.u_defaults, system.p_values, *(0.0 for _ in free)))
