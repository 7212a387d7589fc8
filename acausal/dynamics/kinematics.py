"""Kinematics of a tree: poses, velocities and biases of links, each computed when first asked for."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.dynamics import formulas
from acausal.dynamics.tree import Tree
from acausal.parts.pose import Matrix, Pose, symbolic, total

Place = tuple[int, Pose]
"""A link (-1: the ground) and a pose in its frame."""


class Kinematics:
    """Symbolic kinematics of `tree`, its velocities against the link `observer`, a forefather of what is asked for. Link -1 is the ground, whose
    frame may be turned (`tree.world`). Results are kept; asking twice costs nothing.
    """

    def __init__(self, tree: Tree, observer: int = -1) -> None:
        self.tree = tree
        self._poses: dict[int, Pose] = {-1: Pose(tree.world, np.zeros(3))}
        self._velocities: dict[int, tuple[ca.SX, ca.SX]] = {observer: (ca.SX.zeros(3), ca.SX.zeros(6))}
        self._linear: dict[int, ca.SX] = {observer: ca.SX.zeros(3)}
        self._forth: dict[tuple[int, int], Pose] = {}
        self._back: dict[tuple[int, int], Pose] = {}
        self._observers: dict[int, Kinematics] = {observer: self}

    def pose(self, link: int) -> Pose:
        """X_WB of a link's frame."""
        for i in reversed(self._missing(link, self._poses)):
            item = self.tree.links[i]
            self._poses[i] = self._poses[item.parent] @ item.offset @ item.motion.pose
        return self._poses[link]

    def relative_pose(self, a: int, b: int) -> Pose:
        """X_AB between two links, along the shortest way through the tree."""
        return self.between((a, Pose.identity()), (b, Pose.identity()))

    def between(self, a: Place, b: Place) -> Pose:
        """X_ab of two places, along the shortest way. How far both ways begin from the frame that they share does not enter: only the
        distance between them does, so that nothing is lost far from an origin.
        """
        common = self.common(a[0], b[0])
        p_a, p_b = self._begin(common, a), self._begin(common, b)
        there = Pose(np.eye(3), total(-p_a, p_b)) @ self._seen(common, b[0]) @ self._own(common, b)
        return self._own(common, a).inverse() @ self._seen_back(common, a[0]) @ there

    def common(self, a: int, b: int) -> int:
        """The last link that both hang on."""
        chain = set(self._ancestors(a))
        return next(link for link in self._ancestors(b) if link in chain)

    def seen_from(self, observer: int) -> Kinematics:
        """Velocities against a link."""
        found = self._observers.get(observer)
        if found is None:
            found = self._observers[observer] = Kinematics(self.tree, observer)
        return found

    def angular_velocity(self, link: int) -> ca.SX:
        """w_WB in B (3, 1) [rad/s]."""
        return self._velocity(link)[0]

    def bias(self, link: int) -> ca.SX:
        """Acceleration (6, 1) of link B against its parent when w_A', a_A and v' are zero, in B."""
        return self._velocity(link)[1]

    def linear_velocity(self, link: int) -> ca.SX:
        """Velocity of B's origin in B (3, 1) [m/s]."""
        for i in reversed(self._missing(link, self._linear)):
            item = self.tree.links[i]
            (self._linear[i],) = formulas.linear_velocity(
                symbolic(item.offset.rotation), symbolic(item.offset.position),
                symbolic(item.motion.pose.rotation), symbolic(item.motion.pose.position),
                self.angular_velocity(item.parent), self._linear[item.parent], item.motion.twist[3:], item.motion.twist[:3],
            )  # fmt: skip
        return self._linear[link]

    def rate(self, expression: ca.SX) -> ca.SX:
        """Time derivative of an expression in q and t along q' = N v."""
        tree = self.tree
        column = ca.vec(expression)
        change = ca.jtimes(column, tree.t, ca.SX(1))
        if tree.q.numel():
            change += ca.jtimes(column, tree.q, tree.rates)
        return ca.reshape(change, *expression.shape)

    def _missing(self, link: int, known: dict[int, Pose] | dict[int, ca.SX] | dict[int, tuple[ca.SX, ca.SX]]) -> list[int]:
        missing: list[int] = []
        while link not in known:
            missing.append(link)
            link = self.tree.links[link].parent
        return missing

    def _velocity(self, link: int) -> tuple[ca.SX, ca.SX]:
        for i in reversed(self._missing(link, self._velocities)):
            item = self.tree.links[i]
            w_A, motion = self._velocities[item.parent][0], item.motion
            w, gamma_w, gamma_v = formulas.velocity(
                symbolic(item.offset.rotation), symbolic(item.offset.position),
                symbolic(motion.pose.rotation), symbolic(motion.pose.position),
                w_A, motion.twist[:3], motion.twist[3:], motion.bias[:3], motion.bias[3:],
            )  # fmt: skip
            self._velocities[i] = (w, ca.vertcat(gamma_w, gamma_v))
        return self._velocities[link]

    def _ancestors(self, link: int) -> list[int]:
        chain = [link]
        while link >= 0:
            link = self.tree.links[link].parent
            chain.append(link)
        return chain

    def _begin(self, ancestor: int, place: Place) -> Matrix:
        """Where the way from an ancestor to a place begins, in the ancestor's frame."""
        link, pose = place
        if link == ancestor:
            return pose.position
        while self.tree.links[link].parent != ancestor:
            link = self.tree.links[link].parent
        return self.tree.links[link].offset.position

    @staticmethod
    def _own(ancestor: int, place: Place) -> Pose:
        """A place's pose in its link, less what `_begin` says."""
        return Pose(place[1].rotation, np.zeros(3)) if place[0] == ancestor else place[1]

    def _seen(self, ancestor: int, link: int) -> Pose:
        """A link seen from where the way to it begins, with the ancestor's axes."""
        for i in self._steps(ancestor, link, self._forth):
            base, motion = self._base(ancestor, i)
            self._forth[ancestor, i] = self._forth.get((ancestor, self.tree.links[i].parent), Pose.identity()) @ base @ motion
        return self._forth.get((ancestor, link), Pose.identity())

    def _seen_back(self, ancestor: int, link: int) -> Pose:
        """The inverse, step by step: no turn meets itself."""
        for i in self._steps(ancestor, link, self._back):
            base, motion = self._base(ancestor, i)
            before = self._back.get((ancestor, self.tree.links[i].parent), Pose.identity())
            self._back[ancestor, i] = motion.inverse() @ base.inverse() @ before
        return self._back.get((ancestor, link), Pose.identity())

    def _base(self, ancestor: int, i: int) -> tuple[Pose, Pose]:
        link = self.tree.links[i]
        offset = Pose(link.offset.rotation, np.zeros(3)) if link.parent == ancestor else link.offset
        return offset, link.motion.pose

    def _steps(self, ancestor: int, link: int, known: dict[tuple[int, int], Pose]) -> list[int]:
        """Links on the way from an ancestor that are not known yet."""
        missing: list[int] = []
        while link != ancestor and (ancestor, link) not in known:
            missing.append(link)
            link = self.tree.links[link].parent
        return missing[::-1]
