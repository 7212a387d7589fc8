"""What a row of a cut joint forbids, in words, from the wrench that it exerts."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.mechanics.constraint import AbstractConstraint
from acausal.reduction.loops import LoopRows
from acausal.reduction.reduce import ReducedSystem


def row_meanings(system: ReducedSystem, rows: LoopRows) -> dict[str, str]:
    """For each row's name, e.g. "a shift along the axis"; the directions are those at the start."""
    both = ca.densify(ca.horzcat(rows.wrench_basis, rows.dropped_basis))
    function = ca.Function("basis", [system.mechanics.tree.q, system.t, system.p], [both])
    basis = np.array(function(system.q_start, 0.0, system.p_values))
    has_axis = type(rows.edge.joint).mounting is not AbstractConstraint.mounting
    return {
        name: "slip" if ".rolling[" in name else _meaning(wrench[:3], wrench[3:], has_axis)
        for name, wrench in zip((*rows.names, *rows.dropped), basis.T, strict=True)
    }


def _meaning(torque: np.ndarray, force: np.ndarray, has_axis: bool) -> str:
    size = float(np.linalg.norm([*torque, *force]))
    if np.linalg.norm(torque) < 1e-9 * size:
        return f"a shift {_direction(force, has_axis, 'along the axis', 'across the axis')}"
    if np.linalg.norm(force) < 1e-9 * size:
        along, across = ("about the axis", "that tilts the axis")
        return f"a turn {_direction(torque, has_axis, along, across)}"
    return "a shift and a turn together"


def _direction(vector: np.ndarray, has_axis: bool, along: str, across: str) -> str:
    unit = vector / np.linalg.norm(vector)
    if has_axis and abs(unit[2]) > 1 - 1e-9:
        return along
    if has_axis and abs(unit[2]) < 1e-9:
        return across
    k = int(np.argmax(np.abs(unit)))
    if not has_axis and abs(unit[k]) > 1 - 1e-9:
        return f"along {'xyz'[k]} of frame_b"
    return "across frames"
