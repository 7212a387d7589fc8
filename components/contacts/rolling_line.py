"""Bodies that touch along a line and roll: cylinders on planes and cylinders, cones on planes and cones."""

from __future__ import annotations

from typing import Any, final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.expression import Scalar, Variable, scalar, sx
from acausal.language.origin import origin
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, rotation_about_z, rotation_to_axis
from acausal.parts.seen import AbstractSeenAlong
from components.geometry.net import net
from components.geometry.surfaces import Cone, Cylinder, Plane, sharp

_TO_Y = rotation_to_axis(np.array([0.0, 1.0, 0.0]))


@final
class RollingCylinder(AbstractJoint, AbstractSeenAlong):
    """A cylinder of `radius` [m] > 0 about z of frame_b rolls on a `surface` of frame_a and touches it along a line. One freedom, no slip.

    On Cylinder(...), outside or `inside_out`, both axes are along z, and frame_b stays in the plane z = 0; on Plane(), the default, the axis is along y,
    frame_b above y = 0. q: how far the line has moved over the surface, from x or from x = 0, to the left about z or along x [m]; at zero the axes of
    both frames are parallel, but on a plane, where x and y of frame_b are z and x of frame_a. The contact can pull, and keeps the cylinder flat.

        scene.contact = RollingCylinder(0.1, Cylinder(0.5, inside_out=True))
    """

    q = Variable("m", "way of the line over the surface")
    v = Variable("m/s", "its rate")

    def __init__(self, radius: Scalar, surface: Cylinder | Plane | None = None) -> None:
        self.radius = scalar(radius, "RollingCylinder's radius", positive=True, unit="m")
        self.surface = Plane() if surface is None else surface
        if not isinstance(self.surface, Cylinder | Plane):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(f"RollingCylinder's surface is {shown(surface)} ({origin()}). Give Plane() or Cylinder(radius).")
        both = (self.radius, self.surface.radius) if isinstance(self.surface, Cylinder) and self.surface.side < 0 else ()
        if both and all(isinstance(r, float) for r in both) and both[0] >= both[1]:
            raise ParameterError(
                f"RollingCylinder of the radius {both[0]} m does not fit into the one of {both[1]} m ({origin()})."
            )

    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return net(self.surface, places), ()

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        turn = q / sx(self.radius)
        if isinstance(self.surface, Plane):
            return Pose(ca.SX(ca.DM(_TO_Y)) @ rotation_about_z(turn), ca.vertcat(q, 0, sx(self.radius)))
        side, R = self.surface.side, sx(self.surface.radius)
        reach, angle = R + side * sx(self.radius), q / R
        return Pose(rotation_about_z(angle + side * turn), ca.vertcat(reach * ca.cos(angle), reach * ca.sin(angle), 0))


@final
class RollingCone(AbstractJoint, AbstractSeenAlong):
    """A cone with `half_angle` [rad] about z of frame_b, its apex at frame_b, rolls on a `surface` of frame_a with its apex at rest at frame_a's origin.

    On Cone(...), inside or `outside`, or on Plane(), the default: z = 0. It touches along a line. One freedom, no slip. q: the angle of that line from x
    around z of frame_a [rad]. At zero y of frame_b is along y of frame_a, and its x is where y x z is. The contact can pull, and holds the apex.

        scene.contact = RollingCone(half_angle=0.4)
    """

    q = Variable("rad", "angle of the line that touches")
    v = Variable("rad/s", "its rate")

    def __init__(self, half_angle: Scalar, surface: Cone | Plane | None = None) -> None:
        self.half_angle = sharp(half_angle, "RollingCone's half_angle")
        self.surface = Plane() if surface is None else surface
        if not isinstance(self.surface, Cone | Plane):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(f"RollingCone's surface is {shown(surface)} ({origin()}). Give Plane() or Cone(half_angle).")

    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return net(self.surface, places), ()

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        own, cone = sx(self.half_angle), self.surface
        base, side = (ca.SX(np.pi / 2), 1.0) if isinstance(cone, Plane) else (sx(cone.half_angle), cone.side)
        # the axis leans off the line by its own half angle; q' z and the spin about the axis add to a turn about the line
        lean = base - side * own
        c, s = ca.cos(lean), ca.sin(lean)
        leaning = ca.blockcat([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        return Pose(rotation_about_z(q) @ leaning @ rotation_about_z(-side * ca.sin(base) / ca.sin(own) * q), np.zeros(3))
