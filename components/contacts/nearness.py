"""Where two bodies are nearest to one another, whether they touch or not: what forces between them, and rows, are made of."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from acausal.language.connector import Frame
from acausal.language.expression import Expression
from acausal.parts.contact import read
from acausal.parts.pose import Pose, pose_between, symbolic
from components.geometry.surfaces import AbstractSurface, Plane, Sphere

MANY = "It lies flat, or is like it, or is not convex there: more places than one are nearest. Give the body a rotation that is not this one; what comes to lie flat needs feet, PointOnPlane(unilateral=True) at points of its edge."
"""Said where more places of two bodies than one are nearest."""


@dataclass(frozen=True)
class End:
    """Of what a point is over: whether it is `behind` it, from there to the point (3, 1) [m], and a `size` [m] of what ends."""

    behind: ca.SX
    far: ca.SX
    size: ca.SX


@dataclass(frozen=True)
class Nearness:
    """Two bodies A and B where they are nearest, in A's axes and from its origin.

    `pose`: X_ab; `gap` [m], negative where they overlap; `point_b` (3, 1) [m], the point of B; `normal` (3, 1) of A, towards B; `tangents`:
    two unit vectors (3, 2) across the normal and one another. They may jump where A is a ball, see `AbstractSurface.across`. `single`: see `AbstractSurface.single`.
    `end`: of A, if it has one that B may be behind.
    """

    pose: Pose
    gap: ca.SX
    point_b: ca.SX
    normal: ca.SX
    tangents: ca.SX
    single: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    end: End | None = None

    @property
    def point_a(self) -> ca.SX:
        """The point of A (3, 1) [m]."""
        return self.point_b - self.gap * self.normal

    @property
    def distance(self) -> ca.SX:
        """The gap, or behind an end how far that is [m]."""
        return self.gap if self.end is None else ca.if_else(self.end.behind, ca.norm_2(self.end.far), self.gap)

    def kept(self, gap: ca.SX) -> ca.SX:
        """What a push keeps from being negative [m]: this gap, and behind an end what grows with it and always is positive, so that nothing pushes."""
        if self.end is None:
            return gap
        return ca.if_else(self.end.behind, (gap + ca.sqrt(gap**2 + self.end.size**2)) / 2, gap)

    def velocity(self, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        """Of B's material point over A (3, 1) [m/s], by angular velocity and velocity of B's frame against A's, in B. Along the normal it is gap'."""
        R, p = symbolic(self.pose.rotation), symbolic(self.pose.position)
        return R @ (v_ab_b + ca.cross(w_ab_b, R.T @ (self.point_b - p)))


def nearness(shape: AbstractSurface, surface: AbstractSurface, pose: Pose) -> Nearness | None:
    """Of a body with this outside at the pose X_ab to the surface of A, where that has a closed form: a shape that is known by its point for each normal
    over a plane, a ball over a surface whose nearest point is known, and the other way round. Else None: see the law `Apart` of `Touching`.
    """
    R, p = symbolic(pose.rotation), symbolic(pose.position)
    if isinstance(shape, Sphere):  # first, also over planes: what does not depend on how it is turned
        arm, found = shape.touching(ca.SX([0, 0, 1])), surface.nearest(p)
        if arm is not None and found is not None:
            point = p - arm[2] * found[1]
            return Nearness(pose, ca.dot(found[1], point - found[0]), point, found[1], surface.across(found[1]))
    if isinstance(surface, Plane):
        arm = shape.touching(-R[2, :].T)
        if arm is None:
            return None
        point = p + R @ arm
        normal = ca.SX([0, 0, 1])
        return Nearness(pose, point[2], point, normal, surface.across(normal), shape.single(-R[2, :].T))
    if isinstance(surface, Sphere):
        back = nearness(surface, shape, pose.inverse())
        if back is not None:
            return Nearness(pose, back.gap, p + R @ back.point_a, -(R @ back.normal), R @ back.tangents, back.single)
    return None


def single(shape: AbstractSurface, surface: AbstractSurface, a: Frame, b: Frame) -> Expression:
    """Positive where only one place of the bodies of two frames is nearest, see `Nearness`; empty without a closed form."""
    near = nearness_of_frames(shape, surface, a, b)
    return read(ca.SX(0, 1) if near is None else near.single)


def touched(shape: AbstractSurface, surface: AbstractSurface, a: Frame, b: Frame) -> tuple[Expression, Expression] | None:
    """The nearest point of the body of a frame and the normal, in the world frame, as read of both frames; None without a closed form."""
    near = nearness_of_frames(shape, surface, a, b)
    return None if near is None else (a.position + a.rotation @ read(near.point_b), a.rotation @ read(near.normal))


def nearness_of_frames(shape: AbstractSurface, surface: AbstractSurface, a: Frame, b: Frame) -> Nearness | None:
    """Of the bodies of two frames, as read of these."""
    return nearness(shape, surface, pose_between(a, b))
