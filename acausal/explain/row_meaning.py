"""What a row of a cut joint forbids, in words, from the wrench that it exerts."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.loops.loops import LoopRows
from acausal.numerics.thresholds import EDGE
from acausal.parts.constraint import AbstractConstraint
from acausal.reduce.reduce import ReducedSystem
from acausal.start.coordinates import coordinates, reach


def row_meanings(system: ReducedSystem, rows: LoopRows) -> dict[str, str]:
    """For each row's name, e.g. "a shift along the axis". Against the joint's axis directions are those at the start; joints without an
    axis are told directions in frame_b where these stay the same.
    """
    both = ca.densify(ca.horzcat(rows.wrench_basis, rows.dropped_basis))
    function = ca.Function("basis", [system.mechanics.tree.q, system.t, system.p], [both])
    wrenches = np.array(function(system.constraints.q_start, 0.0, system.p_values)).T
    place = coordinates(system.mechanics, system.p, system.p_values, system.constraints.q_start, system.scalar.position)
    length = reach(system.mechanics, system.p, system.p_values, system.constraints.q_start, place.all) or 1.0
    has_axis = type(rows.edge.joint).mounting is not AbstractConstraint.mounting
    found: dict[str, str] = {}
    for k, row in enumerate((*rows.rows, *rows.dropped_rows)):
        steady = has_axis or both[:, k].is_constant()
        found[row.name] = "slip" if row.rolls else _meaning(wrenches[k, :3] / length, wrenches[k, 3:], has_axis, steady)
    return found


def _meaning(torque: np.ndarray, force: np.ndarray, has_axis: bool, steady: bool) -> str:
    """`torque` as the forces that make it at the ends of the mechanism."""
    size = float(np.linalg.norm([*torque, *force]))
    if np.linalg.norm(torque) < EDGE * size:
        return f"a shift{_direction(force, has_axis, 'along the axis', 'across the axis') if steady else ''}"
    if np.linalg.norm(force) < EDGE * size:
        return f"a turn{_direction(torque, has_axis, 'about the axis', 'that tilts the axis') if steady else ''}"
    return "a shift and a turn together"


def _direction(vector: np.ndarray, has_axis: bool, along: str, across: str) -> str:
    unit = vector / np.linalg.norm(vector)
    if has_axis:
        return f" {along}" if abs(unit[2]) > 1 - EDGE else f" {across}" if abs(unit[2]) < EDGE else " across frames"
    k = int(np.argmax(np.abs(unit)))
    return f" along {'xyz'[k]} of frame_b" if abs(unit[k]) > 1 - EDGE else " across frames"
