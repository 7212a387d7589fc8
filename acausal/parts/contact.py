"""Contacts: bodies that touch, and what can be read of them."""

from __future__ import annotations

from abc import ABC, abstractmethod

import casadi as ca

from acausal.language.connector import Frame, Point
from acausal.language.expression import Expression, declared_in
from acausal.parts.constraint import AbstractConstraint


class AbstractTouch(ABC):
    """Something between two frames that touches in one point, and what is read of it, all in the world frame. Must provide `ends`, `touch`
    and `pushed`."""

    @abstractmethod
    def ends(self) -> tuple[Frame, Point]:
        """Frames of the two bodies, a and b; b may be a point alone."""

    @abstractmethod
    def touch(self) -> tuple[Expression, Expression]:
        """The point of frame_b's body that touches, or is nearest (3, 1) [m], and the unit normal (3, 1) from frame_a's body to it."""

    @abstractmethod
    def pushed(self) -> tuple[Point, ...]:
        """Connectors of parts through which frame_b's body is held or pushed."""

    @property
    def gap(self) -> Expression:
        """Distance of the bodies [m], negative where they overlap; zero where they are held together."""
        return Expression(ca.SX(0), frozenset())

    @property
    def roughness(self) -> Expression | float | None:
        """Coefficient of dry friction up to which it holds; None where it has none."""
        return None

    @property
    def normal(self) -> Expression:
        """Unit normal (3, 1) from frame_a's body to frame_b's."""
        return self.touch()[1]

    @property
    def point_b(self) -> Expression:
        """The point of frame_b's body that touches or is nearest (3, 1) [m]."""
        return self.touch()[0]

    @property
    def point_a(self) -> Expression:
        """The point of frame_a's body that touches or is nearest (3, 1) [m]."""
        point, normal = self.touch()
        return point - self.gap * normal

    @property
    def force(self) -> Expression:
        """What frame_a's body exerts on frame_b's (3, 1) [N]."""
        first, *others = self.pushed()
        total = -first.force
        for other in others:
            total = total - other.force
        return total

    @property
    def normal_force(self) -> Expression:
        """How much the bodies push one another [N], negative where they pull."""
        return self.normal.T @ self.force

    @property
    def friction_force(self) -> Expression:
        """The part of `force` across the normal (3, 1) [N]."""
        normal, force = self.normal, self.force
        return force - normal @ (normal.T @ force)

    @property
    def slip(self) -> Expression:
        """Velocity of frame_b's body where it touches, against frame_a's, across the normal (3, 1) [m/s]."""
        (point, normal), (a, b) = self.touch(), self.ends()
        relative = _carried(b, point) - _carried(a, point)
        return relative - normal @ (normal.T @ relative)

    @property
    def pivoting(self) -> Expression:
        """Angular velocity of frame_b's body against frame_a's about the normal [rad/s]."""
        a, b = self.ends()
        turning = b.angular_velocity if isinstance(b, Frame) else Expression(ca.SX(3, 1), frozenset())
        return self.normal.T @ (turning - a.angular_velocity)


class AbstractContact(AbstractConstraint, AbstractTouch, ABC):
    """A constraint by which bodies touch, and that could only push in nature: nothing stops it from pulling, and runs tell where it does.

    Mostly a joint. Its residual, if it has a closed form, is the gap; where it rolls, `closure_rates` are the sliding velocities of the point that
    touches; its rows are independent and all of them are 6 - nv. `tests/conformance` finds every contact of the catalogue and holds it to this.
    """

    @property
    def holds(self) -> bool:
        """Whether it holds the bodies together, so that it might pull."""
        return True

    def ends(self) -> tuple[Frame, Frame]:
        return self.frame_a, self.frame_b

    def pushed(self) -> tuple[Frame, ...]:
        return (self.frame_b,)


def read(formula: ca.SX) -> Expression:
    """A formula of declared symbols."""
    return Expression(formula, declared_in(formula))


def _carried(end: Point, point: Expression) -> Expression:
    """Velocity (3, 1) at a place in the world that moves along with what is at `end`."""
    if not isinstance(end, Frame):
        return end.velocity
    return end.velocity + read(ca.cross(end.angular_velocity.sx, (point - end.position).sx))
