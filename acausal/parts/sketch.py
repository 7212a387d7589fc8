"""Placing joints in a rough sketch: a world point becomes a frame on each part."""

from __future__ import annotations

import numpy as np

from acausal.errors import IncompatibleError, ParameterError
from acausal.language.connector import Frame
from acausal.language.expression import Scalar, vector
from acausal.language.origin import origin
from acausal.parts.pose import Pose, pose
from acausal.parts.rigid import AbstractRigidPart
from acausal.parts.rotations import Rotation, rotation_matrix


def rough_pose(position: Scalar | None, rotation: Rotation, what: str) -> Pose | None:
    """Where a part is in a rough sketch; None where that is not said. Raises `ParameterError` for what is no number."""
    if position is None and rotation is None:
        return None
    found = pose(vector((0, 0, 0) if position is None else position, f"{what}'s position", unit="m"), rotation_matrix(rotation))
    if not (isinstance(found.position, np.ndarray) and isinstance(found.rotation, np.ndarray)):
        raise ParameterError(
            f"{what}'s place in the sketch depends on a parameter ({origin()}). A search for initial values begins there, whatever the parameters are: give "
            "numbers, and a start={scene.body.frame.position: ...} where that is to be met."
        )
    return found


def sketched_frame(end: AbstractRigidPart | Frame, at: Scalar | None) -> Frame:
    """A frame on a part, at the world point `at` (3,) [m] of the sketch and along the world's axes there.

    For a frame: at its own place, and only turned. Raises `ParameterError`, `IncompatibleError`.
    """
    part = end.owner if isinstance(end, Frame) else end
    if not isinstance(part, AbstractRigidPart):
        raise IncompatibleError(f"between() takes bodies or their frames, not {end!r} ({origin()}).")
    sketch = part.sketch_pose() or Pose.identity()
    if isinstance(end, Frame):
        position = next(a.pose.position for a in part.attachments() if a.connector is end)
        if not isinstance(position, np.ndarray):
            raise ParameterError(
                f"between(): the place of {end!r} depends on a parameter; connect its frames with connect() ({origin()})."
            )
    elif at is None:
        raise ParameterError(f"between() needs at=(x, y, z), or frames instead of bodies ({origin()}).")
    else:
        where = vector(at, "between: at")
        if not isinstance(where, np.ndarray):
            raise ParameterError(
                f"between(): `at` must be numbers ({origin()}); connect frames with connect() where parameters are needed."
            )
        if not part.can_hold(where):
            raise ParameterError(
                f"between(): {part!r} has a shape, but no place in the sketch, and at the world's origin none of its frames is at {tuple(where.tolist())} "
                f"({origin()}). Give it a place, position=(x, y, z), also where that is (0, 0, 0), or give one of its frames."
            )
        position = np.asarray(sketch.rotation).T @ (where - np.asarray(sketch.position))
    rotation = np.asarray(sketch.rotation).T
    return part.at(tuple(position), None if np.array_equal(rotation, np.eye(3)) else rotation)
