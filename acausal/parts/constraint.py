"""Constraints: what two frames may not do against one another. A joint is one that also has coordinates."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Self, final

import casadi as ca
import numpy as np

from acausal.language.component import Component, add_connection
from acausal.language.connector import Frame
from acausal.language.expression import Expression, Scalar, time
from acausal.parts.inertia import Inertia
from acausal.parts.pose import Matrix, Pose
from acausal.parts.rigid import AbstractRigidPart
from acausal.parts.sketch import sketched_frame

_LOOSE = "A joint holds two parts: connect both of its frames."


class AbstractConstraint(Component, ABC):
    """Two frames, and residuals in the pose of one in the other that vanish at all times.

    Must provide `closure`. Such a part brings no coordinates: the parts at its ends keep theirs.
    `tests/conformance` finds every constraint, joint and contact of the catalogue and holds it to this.
    """

    between_points: ClassVar[bool] = False
    """Whether only the origins of its frames matter, so that a point will do at its ends."""
    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    @classmethod
    def between(
        cls, a: AbstractRigidPart | Frame, b: AbstractRigidPart | Frame, *, at: Scalar | None = None, **options: Any
    ) -> Self:
        """The joint at the world point `at` (3,) [m] of a rough sketch, its frames along the world's axes there; already connected.

        `a`, `b`: parts, or frames of parts; a frame keeps its own place, and needs no `at`. Bodies are where their `position` and `rotation` say, else at the
        origin. `options` go to the joint, axes as world axes. Raises `ParameterError` where no place is given, or a body with a shape has none.
        """
        joint = cls(**options)
        for own, other in ((joint.frame_a, a), (joint.frame_b, b)):
            add_connection(joint, own, sketched_frame(other, at))
        return joint

    def mounting(self) -> Matrix:
        """R (3, 3), a rotation of numbers and parameters, not of q or t, the same in frame_a and frame_b. A joint with an axis has it as
        the third column.

        `closure`, `closure_sign`, `closure_rates` and `coordinates` see the pose R' X_ab R, so that they are written for an axis along z;
        `pose` gives X_ab itself.
        """
        return np.eye(3)

    @abstractmethod
    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX | None:
        """Residuals (n, 1) that vanish when frame_b may have the pose X_ab in frame_a.

        X_ab is of the frames turned by `mounting`, and may be any pose: write them smooth in it, and with independent slopes wherever they
        vanish. A row is a length [m] or a number that turns; one that vanishes for structural reasons, as in a plane, is dropped.
        """

    def closure_sign(self, X_ab: Pose) -> ca.SX | None:
        """Positive on the branch of `closure` that is meant (a hinge's axes point the same way, not opposite); None: one branch.

        One number without unit, of size 1 well inside, asked where `closure` vanishes; zero only where branches meet.
        """
        return None

    def closure_rates(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> ca.SX:
        """Further residuals in the velocities that are not rates of `closure` (rolling). (n, 1), linear in them, empty by default.

        w_ab_b and v_ab_b: angular velocity [rad/s] and velocity of the origin [m/s] of frame_b against frame_a, in frame_b.
        """
        return ca.SX(0, 1)

    @property
    def moves_by_itself(self) -> bool:
        """Whether what it holds changes with time."""
        X, w, v, t = Pose(ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3)), ca.SX.sym("w", 3), ca.SX.sym("v", 3), time.sx
        rates = self.closure_rates(X, w, v, t)
        at_rest = ca.substitute(rates, ca.vertcat(w, v), ca.SX.zeros(6))
        position = self.closure(X, t)
        rows = rates if position is None else ca.vertcat(position, rates)
        return ca.depends_on(rows, t) or not at_rest.is_zero()

    @final
    def supplied_power(self) -> Expression | float:
        """What it gives to its ends where it moves by itself [W]: less the wrenches into it times their twists."""
        if not self.moves_by_itself:
            return 0.0
        power = Expression(ca.SX(0), frozenset())
        for frame in (self.frame_a, self.frame_b):
            flows = [(frame.force, frame.velocity), (frame.torque, frame.angular_velocity)]
            for effort, flow in flows[: 1 if self.between_points else 2]:
                power = power - Expression(ca.dot(effort.sx, flow.sx), frozenset((effort, flow)))
        return power

    def looks_turned_round(self, behind_a: Inertia) -> bool:
        """Whether, with frame_b on the ground, this inertia about and in frame_a is one that belongs to frame_b; False where ends are alike."""
        return False

    def shapes(self) -> tuple[Any, ...]:
        """What to draw at frame_a; see `acausal.visual.shapes`."""
        return ()
