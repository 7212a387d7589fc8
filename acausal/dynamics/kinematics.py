"""Kinematics of a tree: poses, velocities and biases of links, each computed when first asked for."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.dynamics import formulas
from acausal.dynamics.tree import Tree
from acausal.parts.pose import Pose, symbolic


class Kinematics:
    """Symbolic kinematics of `tree`. Link -1 is the ground, whose frame may be turned (`tree.world`). Results are kept; asking twice costs nothing."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self._poses: dict[int, Pose] = {-1: Pose(tree.world, np.zeros(3))}
        self._velocities: dict[int, tuple[ca.SX, ca.SX]] = {}
        self._linear: dict[int, ca.SX] = {-1: ca.SX.zeros(3)}
        self._relative: dict[tuple[int, int], Pose] = {}

    def pose(self, link: int) -> Pose:
        """X_WB of a link's frame."""
        for i in reversed(self._missing(link, self._poses)):
            item = self.tree.links[i]
            self._poses[i] = self._poses[item.parent] @ item.offset @ item.motion.pose
        return self._poses[link]

    def relative_pose(self, a: int, b: int) -> Pose:
        """X_AB between two links, along the shortest way through the tree."""
        found = self._relative.get((a, b))
        if found is None:
            ancestors_a, ancestors_b = self._ancestors(a), self._ancestors(b)
            common = next(link for link in ancestors_b if link in set(ancestors_a))
            found = self._from_ancestor(common, a).inverse() @ self._from_ancestor(common, b)
            self._relative[a, b] = found
        return found

    def angular_velocity(self, link: int) -> ca.SX:
        """w_WB in B (3, 1) [rad/s]."""
        return ca.SX.zeros(3) if link < 0 else self._velocity(link)[0]

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
        while link >= 0 and link not in known:
            missing.append(link)
            link = self.tree.links[link].parent
        return missing

    def _velocity(self, link: int) -> tuple[ca.SX, ca.SX]:
        for i in reversed(self._missing(link, self._velocities)):
            item = self.tree.links[i]
            w_A = ca.SX.zeros(3) if item.parent < 0 else self._velocities[item.parent][0]
            motion = item.motion
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

    def _from_ancestor(self, ancestor: int, link: int) -> Pose:
        chain: list[int] = []
        while link != ancestor and (ancestor, link) not in self._relative:
            chain.append(link)
            link = self.tree.links[link].parent
        X = Pose.identity() if link == ancestor else self._relative[ancestor, link]
        for i in reversed(chain):
            item = self.tree.links[i]
            X = self._relative[ancestor, i] = X @ item.offset @ item.motion.pose
        return X
