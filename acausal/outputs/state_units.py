"""Units of the states of a model, as joints and other parts declare them."""

from __future__ import annotations

from acausal.outputs.functions import Functions
from acausal.parts.joint import AbstractJoint
from acausal.parts.joint_coordinates import joint_coordinates
from acausal.reduce.reduce import ReducedSystem


def state_units(functions: Functions) -> tuple[str, ...]:
    """Of the states in x, e.g. "rad", "m/s"; "1" for entries of unit quaternions, "" where it is not known."""
    units, space = (*_position_units(functions.outputs.system), *rate_units(functions.outputs.system)), functions.space
    return tuple(units[i] for i in (space.places if space.coordinates is None else space.coordinates.places))


def rate_units(system: ReducedSystem) -> tuple[str, ...]:
    """Of the velocities and scalar states that are no positions, in the order of x."""
    joints = [unit for item in system.mechanics.tree.joints for unit in _velocity_units(item.edge.joint)]
    return *joints, *(s.unit for s in system.scalar_states[system.scalar.positions :])


def _position_units(system: ReducedSystem) -> tuple[str, ...]:
    joints = [unit for item in system.mechanics.tree.joints for unit in _coordinate_units(item.edge.joint)]
    return *joints, *(s.unit for s in system.scalar_states[: system.scalar.positions])


def _coordinate_units(joint: AbstractJoint) -> list[str]:
    return [
        "1" if coordinate.is_rotation else coordinate.unit
        for coordinate in joint_coordinates("", joint)
        for _ in range(coordinate.place.start, coordinate.place.stop)
    ]


def _velocity_units(joint: AbstractJoint) -> list[str]:
    """Where q' = v, those of the rates of q; angular before linear where a joint has six."""
    size = joint.v.size
    if joint.v.unit:
        return [joint.v.unit] * size
    rates = [f"{unit}/s" if unit else "" for unit in _coordinate_units(joint)]
    return rates if joint.q.size == size else ["rad/s"] * 3 + ["m/s"] * 3 if size == 6 else [""] * size
