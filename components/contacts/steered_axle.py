"""An axle of a single-track car: no slip across its wheels, which may be steered."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

from acausal.language.component import System
from acausal.language.connector import Frame
from acausal.language.expression import Expression, Scalar, of_time, scalar
from components.contacts.knife_edge import KnifeEdge
from components.joints.prescribed_motion import PrescribedMotion

_LOOSE = "An axle carries a car over a road: connect both."


@final
class SteeredAxle(System):
    """The wheels of an axle do not slip sideways: 0 = y_wheel . v, the velocity of the origin of `chassis` over `road`, where x of the wheels is
    x of `chassis` turned about its z by the `steer` angle [rad], a number or a function of time, positive to the left.

    Takes one velocity and no position. z of `road` points upwards; Planar or PointOnPlane hold the chassis on it. To steer by a torque put a Revolute and a
    KnifeEdge in its place. The kinematic single-track model: R. Rajamani, Vehicle Dynamics and Control (2012), 2.2.

        scene.front = SteeredAxle(steer=lambda t: 0.2 * np.sin(t))
    """

    road = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    chassis = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, steer: Scalar | Callable[[Any], Any] = 0.0) -> None:
        self.wheels = KnifeEdge()
        self.connect(self.road, self.wheels.frame_a)
        angle = scalar(of_time(steer), "SteeredAxle's steer", unit="rad")
        if not isinstance(angle, Expression) and angle == 0.0:
            self.connect(self.chassis, self.wheels.frame_b)
            return
        self.steering = PrescribedMotion(angle=angle, axis="z")
        self.connect(self.chassis, self.steering.frame_a)
        self.connect(self.steering.frame_b, self.wheels.frame_b)
