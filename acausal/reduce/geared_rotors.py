"""Rotors that turn with joints: what they resist belongs to the articulated inertias of the links, not to a linear block beside them."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.dynamics.tree import Tree
from acausal.scalar.coupling import ScalarPart


@dataclass(frozen=True)
class GearedRotors:
    """Joint forces (nv, 1) are `forces` less `resistance` (nv, 1) times accelerations; `rotors`: the same resistances by links."""

    forces: ca.SX
    resistance: ca.SX
    rotors: dict[int, ca.SX]


def geared_rotors(scalar: ScalarPart, tree: Tree, p: ca.SX, values: np.ndarray) -> GearedRotors | None:
    """Of scalar domains in which each joint's force depends on its own acceleration by numbers and parameters alone. None where there is no such
    force, where something else decides about forces, or a resistance is not positive at these values of parameters (np,).
    """
    if scalar.led is None or scalar.held or scalar.residuals.numel():
        return None
    a = ca.SX.sym("a", tree.v.numel())
    led = scalar.led(a)
    slopes = -ca.jacobian(led, a)
    rows, columns = slopes.sparsity().get_triplet()
    if (
        not rows
        or rows != columns
        or ca.depends_on(slopes, ca.veccat(a, *(s for s in ca.symvar(slopes) if not ca.depends_on(p, s))))
    ):
        return None
    forces, resistance = ca.densify(ca.substitute(led, a, ca.SX.zeros(a.numel()))), ca.densify(ca.diag(slopes))
    unknown = [s for s in ca.symvar(forces) if not ca.depends_on(p, s)]
    points = np.random.default_rng(0).normal(size=len(unknown))
    found = ca.Function("geared", [ca.veccat(*unknown), p], [forces, resistance])(points, values)
    if not np.isfinite(np.array(ca.vertcat(*found))).all() or not np.all(np.array(found[1]) >= 0):
        return None
    by_entry = {link.v.start: (i, link) for i, link in enumerate(tree.links) if link.motion.nv}
    moved = [by_entry.get(row) for row in rows]
    if any(one is None or one[1].motion.nv != 1 or one[1].modal is not None for one in moved):
        return None
    return GearedRotors(
        forces, resistance, {one[0]: slopes[row, row] for one, row in zip(moved, rows, strict=True) if one is not None}
    )
