"""Where connectors are and how they move: what a force needs to know, in symbols."""

from __future__ import annotations

import casadi as ca

from acausal.language.connector import Point
from acausal.mechanics.kinematics import Kinematics
from acausal.mechanics.pose import Pose, symbolic
from acausal.mechanics.tree import Tree


class Placement:
    """Poses and velocities of connectors over a `Kinematics`; 3-vectors are (3, 1), rotations (3, 3), SI units."""

    def __init__(self, kinematics: Kinematics) -> None:
        self.kinematics = kinematics
        self._places: dict[Point, tuple[int, Pose]] = {}
        tree: Tree = kinematics.tree
        for (link, place), group in zip(tree.places, tree.mechanism.groups, strict=True):
            for connector, pose in group.poses.items():
                self._places[connector] = (link, place @ pose)

    @property
    def t(self) -> ca.SX:
        """Time [s]."""
        return self.kinematics.tree.t

    def place(self, connector: Point) -> tuple[int, Pose]:
        """Index of the link (-1: world) and the connector's pose in that link's frame."""
        return self._places[connector]

    def pose(self, connector: Point) -> Pose:
        """X_WC: the connector's frame in the world."""
        link, place = self._places[connector]
        return self.kinematics.pose(link) @ place

    def relative_pose(self, a: Point, b: Point) -> Pose:
        """X_ab: the frame of b in the frame of a, by the shortest way through the tree."""
        (link_a, place_a), (link_b, place_b) = self._places[a], self._places[b]
        return place_a.inverse() @ self.kinematics.relative_pose(link_a, link_b) @ place_b

    def velocity(self, connector: Point) -> ca.SX:
        """Of the connector's origin against the world, in the connector's own axes [m/s]."""
        link, place = self._places[connector]
        R, p = symbolic(place.rotation), symbolic(place.position)
        return R.T @ (self.kinematics.linear_velocity(link) + ca.cross(self.kinematics.angular_velocity(link), p))

    def angular_velocity(self, connector: Point) -> ca.SX:
        """Against the world, in the connector's own axes [rad/s]."""
        link, place = self._places[connector]
        return symbolic(place.rotation).T @ self.kinematics.angular_velocity(link)

    def rate(self, expression: ca.SX) -> ca.SX:
        """Time derivative of an expression in poses and time."""
        return self.kinematics.rate(expression)
