"""The ground."""

from __future__ import annotations

from typing import final

import numpy as np

from acausal.language.connector import Frame
from acausal.language.expression import Expression, Scalar, vector
from acausal.parts.inertia import Inertia
from acausal.parts.pose import Pose, pose
from acausal.parts.rigid import AbstractGround, Attachment
from components.orientation import Rotation, rotation_matrix


@final
class World(AbstractGround):
    """The inertial frame, and uniform gravity.

    `gravity`: acceleration in the world frame [m/s^2], (0, 0, -9.81) unless said otherwise; None turns it off.
    Further frames fixed in the world: `world.at((x, y, z), rotation=...)`.
    Raises `ParameterError` for anything but three finite numbers.

        scene.world = World(gravity=(0, 0, -9.81))
    """

    frame = Frame.port()

    def __init__(self, gravity: Scalar | None = (0.0, 0.0, -9.81)) -> None:
        self._gravity = np.zeros(3) if gravity is None else vector(gravity, "World's gravity", unit="m/s^2")
        self._frames: list[tuple[Frame, Pose]] = []
        self.places: list[object] = []  # of further frames, where their parameters are found

    def at(self, position: Scalar, rotation: Rotation = None) -> Frame:
        """A frame at `position` (3,) [m] and turned by `rotation`, fixed in the world."""
        frame = Frame(self, f"at({_short(position)})")
        setattr(self, f"_frame{len(self._frames)}", frame)
        self.places.append(vector(position, "World.at: position", unit="m"))
        self._frames.append((frame, pose(vector(position, "World.at: position", unit="m"), rotation_matrix(rotation))))
        return frame

    def attachments(self) -> tuple[Attachment, ...]:
        return (Attachment(self.frame, Pose.identity()), *(Attachment(f, X) for f, X in self._frames))

    def inertia(self) -> Inertia:
        return Inertia.zero()

    def gravity(self) -> np.ndarray | Expression:
        return self._gravity


def _short(position: object) -> str:
    return (
        ", ".join(f"{p:g}" if isinstance(p, int | float) else str(p) for p in position)
        if isinstance(position, list | tuple)
        else str(position)
    )
