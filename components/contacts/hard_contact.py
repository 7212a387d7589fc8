"""Contacts that open and close, of what does not yield: a push as long as bodies touch, and dry friction."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.connector import Frame, Point
from acausal.language.expression import Expression, Reaction, sx
from acausal.language.mode_laws import DryFriction, ModeLaw, OneSided, together
from acausal.language.origin import origin
from acausal.parts.bounded import AbstractBounded
from acausal.parts.contact import AbstractTouch, read
from acausal.parts.force import AbstractReactiveForce, Action
from acausal.parts.placement import Placement
from acausal.parts.pose import Pose, pose_between, symbolic
from acausal.parts.seen import AbstractSeenAlong
from components.contacts.laws import Hard
from components.contacts.nearness import MANY, Nearness, nearness, single
from components.contacts.point_over import AbstractPointOver
from components.contacts.touching import Touching
from components.geometry.net import net
from components.geometry.surfaces import AbstractSurface, checked_surface

_LOOSE = "A contact is between two bodies: connect both of its frames."


class AbstractHardContact(AbstractReactiveForce, AbstractTouch, ABC):
    """What pushes as long as it touches, with friction, by a `Hard` law. Must call `_react`, and provide `ends`, `follows`, `near` and
    `seen`.

    `push` [N] along the normal on b's body, `drag` [N] on it along each tangent, and of a patch about the normal, at its edge; against them on a's.
    """

    law: Hard
    push: Reaction
    drag: tuple[Reaction, ...]

    def _react(self, law: object, directions: int = 2) -> None:
        """What the contact acts with; `directions`: of friction. Raises `ParameterError` for what is no such law."""
        if not isinstance(law, Hard):
            raise ParameterError(f"{type(self).__name__}'s law is {shown(law)} ({origin()}). Give Hard(...).")
        self.law = law
        self.push = Reaction("N", "push along the normal")
        count = 0 if law.friction is None else directions
        if law.friction is not None and law.friction.patch is not None:
            if not isinstance(self, HardContact):
                raise ParameterError(
                    f"{type(self).__name__}'s friction has a patch, and a point has none ({origin()}). Leave it out, or let bodies touch: Contact(...)."
                )
            count = 3
        self.drag = tuple(Reaction("N", "friction along a tangent") for _ in range(count))

    @property
    @abstractmethod
    def follows(self) -> bool:
        """Whether a joint follows the nearest places, with the gap as a coordinate."""

    @abstractmethod
    def near(self, X_ab: Pose) -> Nearness:
        """Where the bodies are nearest at a pose of frame_b in frame_a."""

    @abstractmethod
    def seen(self) -> Pose:
        """X_ab, as read of the frames."""

    def pushed(self) -> tuple[Point, ...]:
        return (self.ends()[1],)

    @property
    def roughness(self) -> Expression | float | None:
        return None if self.law.friction is None else self.law.friction.static

    @property
    def gap(self) -> Expression:
        return read(self.near(self.seen()).distance)

    def touch(self) -> tuple[Expression, Expression]:
        near, (a, _) = self.near(self.seen()), self.ends()
        return a.position + a.rotation @ read(near.point_b), a.rotation @ read(near.normal)

    def laws(self) -> Iterable[ModeLaw]:
        near, friction = self.near(self.seen()), self.law.friction
        # where the gap is a coordinate it is known as well as the places that it was found from, not to its own last digit
        gap = ca.dot(near.normal, near.point_b) - ca.dot(near.normal, near.point_a) if self.follows else near.gap
        yield OneSided(self.push, read(near.kept(gap)), self.law.restitution)
        if friction is not None:
            slip = read(near.tangents).T @ (self.ends()[0].rotation.T @ self.slip)
            pressure = None
            if friction.patch is not None:
                a, b = self.ends()
                assert isinstance(b, Frame)
                spin = read(near.normal).T @ (a.rotation.T @ (b.angular_velocity - a.angular_velocity))
                slip, pressure = read(ca.vertcat(slip.sx, sx(friction.patch.radius) * spin.sx)), friction.patch.pressure
            yield DryFriction(
                together(self.drag), slip, friction.mu * self.push, friction.static * self.push, friction.restitution, pressure
            )

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        a, b = self.ends()
        near = self.near(placement.relative_pose(a, b))
        force = near.normal * self.push.sx
        for k, drag in enumerate(self.drag[:2]):
            force += near.tangents[:, k] * drag.sx
        R, p = symbolic(near.pose.rotation), symbolic(near.pose.position)
        about = ca.cross(near.point_b - p, force)  # where they are along one another this is zero by itself
        twist = ca.SX.zeros(3)
        if self.law.friction is not None and self.law.friction.patch is not None:
            twist = near.normal * sx(self.law.friction.patch.radius) * self.drag[2].sx
        return (Action(a, -force, -ca.cross(near.point_b, force) - twist), Action(b, R.T @ force, R.T @ (about + twist)))


@final
class HardContact(AbstractHardContact, AbstractBounded, AbstractSeenAlong):
    """The body with the outside `shape` at frame_b and the `surface` of frame_a, which push and rub one another by a `law`, Hard(...): a part of `Contact`.

    The `joint` between the same frames, Touching, knows where they are nearest; without one there is a closed form for the pair.

        scene.push = HardContact(Sphere(0.1), Plane(), Hard(restitution=0.5))
    """

    if_outside = MANY
    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, shape: AbstractSurface, surface: AbstractSurface, law: Hard, joint: Touching | None = None) -> None:
        self.shape, self.surface = checked_surface(shape, "HardContact", "shape"), checked_surface(surface, "HardContact")
        if not (joint is None or isinstance(joint, Touching)):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(
                f"HardContact's joint is {joint!r} ({origin()}). Give a Touching between the same frames, or none."
            )
        self.joint = joint
        self._react(law)

    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        if self.joint is not None:
            return (), ()  # which is seen itself
        return net(self.surface, places), net(self.shape, np.zeros((1, 3)), None)

    def ends(self) -> tuple[Frame, Frame]:
        return self.frame_a, self.frame_b

    @property
    def follows(self) -> bool:
        return self.joint is not None

    def near(self, X_ab: Pose) -> Nearness:
        if self.joint is not None:
            return self.joint.nearness()
        near = nearness(self.shape, self.surface, X_ab)
        if near is None:
            raise ParameterError(
                f"HardContact ({self.created_at}): the nearest points of {type(self.shape).__name__} and {type(self.surface).__name__} have no closed form. "
                "Use Contact(...), or give it joint=Touching(shape, surface, Apart()) between the same frames."
            )
        return near

    def inside(self) -> Expression:
        return single(self.shape, self.surface, self.frame_a, self.frame_b)

    def seen(self) -> Pose:
        return pose_between(self.frame_a, self.frame_b)


@final
class HardPoint(AbstractHardContact, AbstractSeenAlong):
    """The origin of frame_b and a `surface` or `curve` of frame_a, which it stays on one side of, by a `law`, Hard(...): a part of `OneSidedPoint`.

    `place`: a surface whose clearance is known in closed form, or the joint between the same frames that has the gap as a coordinate.

        scene.push = HardPoint(Plane(), Hard(restitution=0.5))
    """

    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Point.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, place: AbstractSurface | AbstractPointOver, law: Hard) -> None:
        self.place = place if isinstance(place, AbstractPointOver) else checked_surface(place, "HardPoint")
        self._react(law, place.directions if isinstance(place, AbstractPointOver) else 2)

    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return (() if isinstance(self.place, AbstractPointOver) else net(self.place, places)), ()

    def ends(self) -> tuple[Frame, Point]:
        return self.frame_a, self.frame_b

    @property
    def follows(self) -> bool:
        return isinstance(self.place, AbstractPointOver)

    def near(self, X_ab: Pose) -> Nearness:
        if isinstance(self.place, AbstractPointOver):  # which knows where the point is, not how its body is turned
            near = self.place.nearness()
            return replace(near, pose=Pose(X_ab.rotation, near.pose.position))
        p = symbolic(X_ab.position)
        found = self.place.clearance(p)
        if found is None:
            raise ParameterError(
                f"HardPoint ({self.created_at}): how far a point is off a {type(self.place).__name__} has no closed form. Use PointOnSurface(surface, unilateral=True)."
            )
        return Nearness(X_ab, found[0], p, found[1], self.place.across(found[1]))

    def seen(self) -> Pose:
        a, b = self.frame_a, self.frame_b
        return Pose(np.eye(3), (a.rotation.T @ (b.position - a.position)).sx)
