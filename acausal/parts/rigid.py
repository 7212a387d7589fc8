"""Rigid parts: what is fixed to one another, with or without mass."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from acausal.errors import IncompatibleError
from acausal.language.component import Component
from acausal.language.connector import Frame, Point
from acausal.language.expression import Scalar
from acausal.language.origin import origin
from acausal.parts.inertia import Inertia
from acausal.parts.pose import Pose


@dataclass(frozen=True)
class Attachment:
    """A connector and its pose in the part's own frame."""

    connector: Point
    pose: Pose


class AbstractRigidPart(Component, ABC):
    """A part whose connectors keep their places in it: a body, a particle, a rigid link.

    Must provide `attachments()` and `inertia()`. Shapes for drawing are given by `shapes()`.
    """

    for_users = ("at",)

    @abstractmethod
    def attachments(self) -> tuple[Attachment, ...]:
        """All its connectors, with their poses in the part's own frame."""

    @abstractmethod
    def inertia(self) -> Inertia:
        """About and in the part's own frame."""

    def at(self, position: Scalar, rotation: Any = None) -> Frame:
        """A new frame fixed in the part, at `position` (3,) [m] and turned by `rotation`; not every part can have one."""
        raise IncompatibleError(f"{self!r} has no frames to connect to at a point; use its connectors ({origin()}).")

    def shapes(self) -> tuple[Any, ...]:
        """What to draw, in the part's own frame; see `acausal.visual.shapes`."""
        return ()

    def sketch_pose(self) -> Pose | None:
        """Rough pose in the world, where a search for initial values begins; None if not known."""
        return None

    def can_hold(self, at: np.ndarray) -> bool:
        """Whether a joint at this world point (3,) [m] of the sketch may be meant, as far as the part knows."""
        return True


class AbstractGround(AbstractRigidPart, ABC):
    """A part that does not move: the inertial frame. Must provide `gravity()`."""

    @abstractmethod
    def gravity(self) -> np.ndarray | Any:
        """Uniform acceleration of gravity in the world frame [m/s^2], shape (3,)."""
