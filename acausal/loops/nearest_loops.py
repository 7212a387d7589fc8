"""Of all ways to close loops that are found, the one nearest to the sketch."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from acausal.dynamics.system import MechanicalSystem
from acausal.loops.joint_distance import Differences, at_cut, in_tree
from acausal.loops.loop_groups import LoopGroup
from acausal.loops.sketch import sketched
from acausal.loops.walk import Walk
from acausal.numerics.assembly import Residual, assemble, held
from acausal.numerics.rivals import Candidate, nearest_rival
from acausal.parts.joint import AbstractJoint
from acausal.parts.joint_coordinates import joint_coordinates

_PATIENCE = 30
"""Steps of one search."""


def nearest_closed(
    walk: Walk,
    drawn: Residual,
    sketch: np.ndarray,
    found: np.ndarray,
    is_meant: Callable[[np.ndarray], bool],
    still: Sequence[int] = (),
) -> np.ndarray:
    """The closed configuration z nearest to the `sketch`, as `drawn` measures it; `found`: a closed one.

    `is_meant`: whether one is on the branch that is meant. `still`: coordinates that stay as they are drawn.
    """
    still = list(still)
    closing, drawn = held(walk.closing, still), held(drawn, still)

    def close(z: np.ndarray) -> Candidate | None:
        z = z.copy()
        z[still] = sketch[still]
        trial = assemble(closing, z, sizes=walk.sizes, limit=_PATIENCE, nearest=drawn)
        return Candidate(trial.y, 0.0, drawn(trial.y)[0]) if trial.converged and is_meant(trial.y) else None

    first = assemble(closing, found, sizes=walk.sizes, wishes=drawn, limit=_PATIENCE, approach=False)
    z = first.y if first.converged and is_meant(first.y) else found
    return nearest_rival(Candidate(z, 0.0, drawn(z)[0]), sketch, close, lambda z: closing(z)[1], walk.dependent).z


def distance_from_sketch(system: MechanicalSystem, group: LoopGroup, walk: Walk, sketch: np.ndarray) -> Residual:
    """z -> how far all joints of a group of loops are from the sketch q (nq,) of the tree, in parts of what is much, and the Jacobian."""
    drawn, first = ca.SX(ca.DM(sketch[list(group.q_places)])), 0
    found: list[Differences] = []
    for item in group.joints:
        found.append(in_tree(joint_coordinates(item.edge.name, item.edge.joint, first), group.q, drawn))
        first += item.q.stop - item.q.start
    for loop in group.loops:
        if isinstance(loop.edge.joint, AbstractJoint):
            at = ca.SX(
                ca.DM(sketched(loop.edge, loop.edge.joint, system.mechanism.groups, walk.symbolic.parameters, walk.values))
            )
            found.append(at_cut(loop, at, group.q, drawn))
    all, q = Differences.joined(found), system.tree.q
    others = [k for k in range(q.numel()) if k not in group.q_places]
    rows = ca.substitute(all.rows, q[others], ca.DM(sketch[others])) if others else all.rows
    residual, sizes = walk.differences(rows), all.sizes(walk.unit, walk.length)

    def apart(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, J = residual(z)
        return r / sizes, J / sizes[:, None]

    return apart
