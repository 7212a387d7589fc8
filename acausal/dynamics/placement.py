"""Where connectors are and how they move: what a force needs to know, in symbols."""

from __future__ import annotations

import casadi as ca

from acausal.dynamics.kinematics import Kinematics, Place
from acausal.dynamics.tree import Tree, place_of
from acausal.errors import UnknownVariableError
from acausal.language.connector import Point
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose, symbolic
from acausal.parts.rigid import AbstractRigidPart
from acausal.topology.mechanism import Edge


class TreePlacement:
    """A `Placement` over a `Kinematics`; 3-vectors are (3, 1), rotations (3, 3), SI units."""

    def __init__(self, kinematics: Kinematics) -> None:
        self.kinematics = kinematics
        self._places: dict[Point, Place] = {}
        tree: Tree = kinematics.tree
        for (link, place), group in zip(tree.places, tree.mechanism.groups, strict=True):
            for connector, pose in group.poses.items():
                self._places[connector] = (link, place @ pose)

    @property
    def t(self) -> ca.SX:
        """Time [s]."""
        return self.kinematics.tree.t

    def place(self, connector: Point) -> Place:
        """Link (-1: the ground) and the connector's pose in its frame; also for frames made after the build.

        Raises `UnknownVariableError` for a connector of a part that is not in the scene.
        """
        found = self._places.get(connector)
        if found is None:
            found = self._places[connector] = self._place_on_part(connector)
        return found

    def ends(self, edge: Edge[AbstractConstraint]) -> tuple[Place, Place]:
        """Where a joint's frame_a and frame_b sit; of a joint that ends on half of a split body, on that half."""
        tree = self.kinematics.tree
        return place_of(tree, edge.a, edge.pose_a), place_of(tree, edge.b, edge.pose_b)

    def _place_on_part(self, connector: Point) -> Place:
        tree = self.kinematics.tree
        for (link, place), group in zip(tree.places, tree.mechanism.groups, strict=True):
            for part, part_pose in zip(group.parts, group.part_poses, strict=True):
                if part.component is connector.owner and isinstance(part.component, AbstractRigidPart):
                    pose = next(a.pose for a in part.component.attachments() if a.connector is connector)
                    return link, place @ part_pose @ pose
        raise UnknownVariableError(f"{connector!r} is not part of the scene '{tree.mechanism.flat.name}'.")

    def pose(self, connector: Point) -> Pose:
        """X_WC: the connector's frame in the world."""
        link, place = self.place(connector)
        return self.kinematics.pose(link) @ place

    def relative_pose(self, a: Point, b: Point) -> Pose:
        """X_ab: the frame of b in the frame of a, by the shortest way through the tree."""
        return self.between(self.place(a), self.place(b))

    def between(self, a: Place, b: Place) -> Pose:
        """The same for two places."""
        return self.kinematics.between(a, b)

    def velocity(self, connector: Point) -> ca.SX:
        """Of the connector's origin against the world, in the connector's own axes [m/s]."""
        return self.twist(self.place(connector))[1]

    def angular_velocity(self, connector: Point) -> ca.SX:
        """Against the world, in the connector's own axes [rad/s]."""
        return self.twist(self.place(connector))[0]

    def twist(self, place: Place, observer: int = -1) -> tuple[ca.SX, ca.SX]:
        """Angular velocity and velocity of a place against a link, or against the world, in its own axes."""
        link, pose = place
        kinematics = self.kinematics.seen_from(observer)
        R, p = symbolic(pose.rotation), symbolic(pose.position)
        w = kinematics.angular_velocity(link)
        return R.T @ w, R.T @ (kinematics.linear_velocity(link) + ca.cross(w, p))

    def rate(self, expression: ca.SX) -> ca.SX:
        """Time derivative of an expression in poses and time."""
        return self.kinematics.rate(expression)
