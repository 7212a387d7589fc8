"""Inertial sensors: what an accelerometer and a gyro fixed in a body measure."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import final

from acausal.language.connector import Frame
from acausal.language.expression import Expression, Scalar, vector
from acausal.parts.inertia import Inertia
from acausal.parts.pose import Pose
from acausal.parts.rigid import AbstractRigidPart, Attachment

_LOOSE = "It measures nothing: connect it to a frame of a body, body.at(place, rotation=...)."


class AbstractInertialSensor(AbstractRigidPart, ABC):
    """A sensor without mass at a frame. Must provide `reading`."""

    frame = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    @property
    @abstractmethod
    def reading(self) -> Expression:
        """(3, 1), in the axes of `frame`."""

    def attachments(self) -> tuple[Attachment, ...]:
        return (Attachment(self.frame, Pose.identity()),)

    def inertia(self) -> Inertia:
        return Inertia.zero()


@final
class Accelerometer(AbstractInertialSensor):
    """Three accelerometers along the axes of `frame`: `reading` (3, 1) [m/s^2] = R' (a - g) + `bias`, the specific force at the origin.

    At rest under gravity g it reads g upwards; in free fall, under the gravity of the world and of all fields, nothing. `bias` (3,): numbers, or any expression
    of the scene. The reading is an expression like any other: of a run, in forces, in signals (Constant).

        scene.box = Accelerometer(); run[scene.box.reading]
    """

    def __init__(self, bias: Scalar = (0.0, 0.0, 0.0)) -> None:
        self._bias = vector(bias, "Accelerometer's bias", unit="m/s^2")

    @property
    def reading(self) -> Expression:
        """(3, 1) [m/s^2], in the axes of `frame`."""
        return self.frame.rotation.T @ self.frame.specific_force + self._bias


@final
class Gyro(AbstractInertialSensor):
    """Three gyros along the axes of `frame`: `reading` (3, 1) [rad/s] = R' w + `bias`, the angular velocity against the world. `bias` as for `Accelerometer`.

    scene.gyro = Gyro(); run[scene.gyro.reading]
    """

    def __init__(self, bias: Scalar = (0.0, 0.0, 0.0)) -> None:
        self._bias = vector(bias, "Gyro's bias", unit="rad/s")

    @property
    def reading(self) -> Expression:
        """(3, 1) [rad/s], in the axes of `frame`."""
        return self.frame.rotation.T @ self.frame.angular_velocity + self._bias
