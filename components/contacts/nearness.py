"""Where two bodies are nearest to one another, whether they touch or not: what forces between them, and rows, are made of."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from acausal.parts.pose import Pose, rotation_to_axis_symbolic, symbolic
from components.geometry.surfaces import AbstractSurface, Plane, Sphere


@dataclass(frozen=True)
class Nearness:
    """Two bodies A and B where they are nearest, in A's axes and from its origin.

    `pose`: X_ab; `gap` [m], negative where they overlap; `point_b` (3, 1) [m], the point of B; `normal` (3, 1) of A, towards B.
    """

    pose: Pose
    gap: ca.SX
    point_b: ca.SX
    normal: ca.SX

    @property
    def point_a(self) -> ca.SX:
        """The point of A (3, 1) [m]."""
        return self.point_b - self.gap * self.normal

    @property
    def tangents(self) -> ca.SX:
        """Two unit vectors (3, 2) across the normal and one another. They jump where the normal turns through the plane z = 0 of A."""
        return rotation_to_axis_symbolic(self.normal)[:, :2]

    def velocity(self, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        """Of B's material point over A (3, 1) [m/s], by angular velocity and velocity of B's frame against A's, in B. Along the normal it is gap'."""
        R, p = symbolic(self.pose.rotation), symbolic(self.pose.position)
        return R @ (v_ab_b + ca.cross(w_ab_b, R.T @ (self.point_b - p)))


def nearness(shape: AbstractSurface, surface: AbstractSurface, pose: Pose) -> Nearness | None:
    """Of a body with this outside at the pose X_ab to the surface of A, where that has a closed form: a shape that is known by its point for each normal
    over a plane, a ball over a surface whose nearest point is known, and the other way round. Else None: see the law `Apart` of `Touching`.
    """
    R, p = symbolic(pose.rotation), symbolic(pose.position)
    if isinstance(surface, Plane):
        arm = shape.touching(-R[2, :].T)
        if arm is None:
            return None
        point = p + R @ arm
        return Nearness(pose, point[2], point, ca.SX([0, 0, 1]))
    if isinstance(shape, Sphere):
        arm, found = shape.touching(ca.SX([0, 0, 1])), surface.nearest(p)
        if arm is None or found is None:
            return None
        point = p - arm[2] * found[1]
        return Nearness(pose, ca.dot(found[1], point - found[0]), point, found[1])
    if isinstance(surface, Sphere):
        back = nearness(surface, shape, pose.inverse())
        return None if back is None else Nearness(pose, back.gap, p + R @ back.point_a, -(R @ back.normal))
    return None
