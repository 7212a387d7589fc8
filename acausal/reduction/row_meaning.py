"""What a row of a cut joint forbids, in words, from the wrench that it exerts."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.mechanics.constraint import AbstractConstraint
from acausal.mechanics.system import MechanicalSystem
from acausal.reduction.loops import LoopRows


def row_meanings(
    system: MechanicalSystem, rows: LoopRows, parameters: ca.SX, values: np.ndarray, q: np.ndarray
) -> dict[str, str]:
    """For each row's name, e.g. "a shift along the axis"; the directions are those at configuration `q` (nq,)."""
    both = ca.densify(ca.horzcat(rows.wrench_basis, rows.dropped_basis))
    basis = np.array(ca.Function("basis", [system.tree.q, system.tree.t, parameters], [both])(q, 0.0, values))
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
