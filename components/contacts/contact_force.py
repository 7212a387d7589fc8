"""Forces between two bodies where they touch."""

from __future__ import annotations

from typing import Any, final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.connector import Frame
from acausal.language.expression import Expression, time
from acausal.language.origin import origin
from acausal.parts.bounded import AbstractBounded
from acausal.parts.force import AbstractForce, Action
from acausal.parts.placement import Placement
from acausal.parts.pose import Pose, symbolic
from acausal.parts.seen import AbstractSeenAlong
from components.contacts.laws import AbstractFriction, HuntCrossley
from components.contacts.nearness import MANY, Nearness, nearness, single
from components.contacts.touching import Touching
from components.geometry.net import net
from components.geometry.surfaces import AbstractSurface, checked_surface

_LOOSE = "A contact is between two bodies: connect both of its frames."


@final
class ContactForce(AbstractForce, AbstractBounded, AbstractSeenAlong):
    """What the body with the outside `shape` at frame_b and the `surface` of frame_a exert on one another by a law of forces: a part of `Contact`.

    `law`: HuntCrossley(...) where they may part, Viscous(...) or Creep(...) where a `joint`, Touching, lets them slide. The joint between the same
    frames knows where they are nearest; without one there is a closed form for the pair.
    """

    if_outside = MANY
    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(
        self,
        shape: AbstractSurface,
        surface: AbstractSurface,
        law: HuntCrossley | AbstractFriction,
        joint: Touching | None = None,
    ) -> None:
        self.shape, self.surface = checked_surface(shape, "ContactForce", "shape"), checked_surface(surface, "ContactForce")
        if not isinstance(law, HuntCrossley | AbstractFriction):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(
                f"ContactForce's law is {shown(law)} ({origin()}). Give HuntCrossley(...), Viscous(...) or Creep(...)."
            )
        if not (joint is None or isinstance(joint, Touching)):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(
                f"ContactForce's joint is {joint!r} ({origin()}). Give a Touching between the same frames, or none."
            )
        self.law, self.joint = law, joint

    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        if self.joint is not None:
            return (), ()  # which is seen itself
        return net(self.surface, places), net(self.shape, np.zeros((1, 3)), None)

    def inside(self) -> Expression:
        return single(self.shape, self.surface, self.frame_a, self.frame_b)

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        near, slip, rate, _ = self._seen(placement)
        R, p = symbolic(near.pose.rotation), symbolic(near.pose.position)
        force = self._push(near.gap, rate) * near.normal - self._resistance(near.gap, rate, slip) * slip
        own, arm = R.T @ force, R.T @ (near.point_b - p)
        return (Action(self.frame_a, -force, -ca.cross(near.point_b, force)), Action(self.frame_b, own, ca.cross(arm, own)))

    def potential_energy(self, placement: Placement) -> ca.SX:
        return self.law.energy(self._seen(placement)[0].gap) if isinstance(self.law, HuntCrossley) else ca.SX(0)

    def power_loss(self, placement: Placement) -> ca.SX:
        near, slip, rate, change = self._seen(placement)
        elastic, push = (self.law.slope(near.gap) if isinstance(self.law, HuntCrossley) else ca.SX(0)), self._push(near.gap, rate)
        # what changes its shape does work
        return self._resistance(near.gap, rate, slip) * ca.sumsqr(slip) + (elastic - push) * rate + push * change

    def _seen(self, placement: Placement) -> tuple[Nearness, ca.SX, ca.SX, ca.SX]:
        """Where the bodies are nearest; slip (3, 1) of frame_b's over frame_a's there, in frame_a, the rate of the gap, and what of that comes from a change
        of their shapes [m/s].
        """
        if self.joint is not None:
            near = self.joint.nearness()
            return near, *_parts(near, self.joint.velocity()), ca.SX(0)
        a, b = self.frame_a, self.frame_b
        X = placement.relative_pose(a, b)
        near = nearness(self.shape, self.surface, X)
        if near is None:
            raise ParameterError(
                f"ContactForce ({self.created_at}): the nearest points of {type(self.shape).__name__} and {type(self.surface).__name__} have no closed "
                "form. Use Contact(...), or give it joint=Touching(shape, surface, Apart()) between the same frames."
            )
        R, p, w_a = symbolic(X.rotation), symbolic(X.position), placement.angular_velocity(a)
        w, v = placement.angular_velocity(b) - R.T @ w_a, placement.velocity(b) - R.T @ (placement.velocity(a) + ca.cross(w_a, p))
        slip, rate = _parts(near, near.velocity(w, v))
        change = self._change(X)
        return near, slip, rate + change, change

    def _change(self, X: Pose) -> ca.SX:
        """Rate of the gap of bodies at rest at the pose X_ab, by their shapes [m/s]."""
        at = Pose(ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3))
        near = nearness(self.shape, self.surface, at)
        assert near is not None, "there is a closed form, see `_seen`"
        known = [ca.vec(symbolic(part)) for pose in (at, X) for part in (pose.rotation, pose.position)]
        return ca.substitute(ca.jtimes(near.gap, time.sx, ca.SX(1)), ca.vertcat(*known[:2]), ca.vertcat(*known[2:]))

    def _push(self, gap: ca.SX, rate: ca.SX) -> ca.SX:
        return self.law.push(gap, rate) if isinstance(self.law, HuntCrossley) else ca.SX(0)

    def _resistance(self, gap: ca.SX, rate: ca.SX, slip: ca.SX) -> ca.SX:
        """Force over slip [N*s/m]."""
        square = ca.sumsqr(slip)
        if isinstance(self.law, HuntCrossley):
            friction = self.law.friction
            return ca.SX(0) if friction is None else friction.resistance(square, self._push(gap, rate))
        return self.law.resistance(square)


def _parts(near: Nearness, velocity: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Slip (3, 1), and the rate of the gap [m/s]."""
    rate = ca.dot(near.normal, velocity)
    return velocity - rate * near.normal, rate
