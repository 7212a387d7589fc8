"""Forces by a potential of the pose between two frames: wrenches follow by virtual work."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import final

import casadi as ca

from acausal.language.connector import Frame
from acausal.parts.force import AbstractForce, Action
from acausal.parts.placement import Placement
from acausal.parts.pose import Pose, symbolic, symbols, vee

_UNCONNECTED = "It acts between two parts: connect both of its frames."


class AbstractPotential(AbstractForce, ABC):
    """Acts between two frames as the gradient of an energy of their relative pose. Must provide `potential`.

    Forces, moments and what acts back on frame_a follow by virtual work, so the energy is right by construction; what is lost on the way
    is `damping`.
    """

    frame_a = Frame.port(must_connect=True, if_unconnected=_UNCONNECTED)
    frame_b = Frame.port(must_connect=True, if_unconnected=_UNCONNECTED)

    @abstractmethod
    def potential(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        """Energy stored [J], scalar, when frame_b has the pose X_ab in frame_a at time t [s]. Smooth in all nine numbers of the rotation."""

    def damping(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Torque [N*m] and force [N] on frame_b, in its axes, (3, 1) each, that the potential does not give; none by default.

        w_ab_b [rad/s] and v_ab_b [m/s]: angular velocity and velocity of the origin of frame_b against frame_a, in frame_b.
        """
        return ca.SX(3, 1), ca.SX(3, 1)

    @final
    def actions(self, placement: Placement) -> tuple[Action, ...]:
        X = symbols(placement.relative_pose(self.frame_a, self.frame_b))
        R, p = symbolic(X.rotation), symbolic(X.position)
        wrench = _at_pose(X, lambda R, p: self._virtual_work(R, p, placement.t))
        torque, force = self.damping(X, *_relative_twist(self, placement), placement.t)
        torque, force = wrench[:3] + ca.SX(torque), wrench[3:] + ca.SX(force)
        push = R @ force
        return (Action(self.frame_a, -push, -(R @ torque + ca.cross(p, push))), Action(self.frame_b, force, torque))

    def _virtual_work(self, R: ca.SX, p: ca.SX, t: ca.SX) -> ca.SX:
        """Torque and force (6, 1) on frame_b, in its axes, whose work is what the potential loses."""
        energy = ca.SX(self.potential(Pose(R, p), t))
        slope = ca.reshape(ca.gradient(energy, ca.vec(R)), 3, 3)
        return ca.vertcat(-2 * vee(R.T @ slope), -(R.T @ ca.gradient(energy, p)))

    @final
    def potential_energy(self, placement: Placement) -> ca.SX:
        return ca.SX(self.potential(symbols(placement.relative_pose(self.frame_a, self.frame_b)), placement.t))

    @final
    def power_loss(self, placement: Placement) -> ca.SX:
        X, twist = symbols(placement.relative_pose(self.frame_a, self.frame_b)), _relative_twist(self, placement)
        torque, force = self.damping(X, *twist, placement.t)
        t = placement.t
        supplied = _at_pose(X, lambda R, p: ca.jtimes(ca.SX(self.potential(Pose(R, p), t)), t, ca.SX(1)))
        return -ca.dot(ca.SX(torque), twist[0]) - ca.dot(ca.SX(force), twist[1]) - supplied


def _at_pose(X: Pose, of: Callable[[ca.SX, ca.SX], ca.SX]) -> ca.SX:
    """What `of` makes of symbols for a rotation (3, 3) and a position (3, 1), with those of X put in: derivatives by a pose."""
    R, p = ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3)
    return ca.substitute(ca.densify(of(R, p)), ca.veccat(R, p), ca.veccat(symbolic(X.rotation), symbolic(X.position)))


def _relative_twist(part: AbstractPotential, placement: Placement) -> tuple[ca.SX, ca.SX]:
    """Of frame_b against frame_a, in frame_b."""
    a, b = part.frame_a, part.frame_b
    X = placement.relative_pose(a, b)
    R, p = symbolic(X.rotation), symbolic(X.position)
    w_a = placement.angular_velocity(a)
    w = placement.angular_velocity(b) - R.T @ w_a
    return w, placement.velocity(b) - R.T @ (placement.velocity(a) + ca.cross(w_a, p))
