"""Fields: what acts on every mass of a scene, wherever it is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, final

import casadi as ca
import numpy as np

from acausal.language.component import Component
from acausal.language.connector import Frame, Point
from acausal.parts.inertia import Inertia, is_zero, scaled
from acausal.parts.pose import Matrix, Pose, cleaned_vector, symbolic
from acausal.parts.potential import AbstractPotential
from acausal.parts.rigid import AbstractRigidPart, Attachment


class AbstractField(Component, ABC):
    """A field of force that acts on all bodies and particles of the scene. Must provide `potential`.

    A body feels it to second order in its size: with mass m, centre c and second moments P of mass about it (3, 3) its energy is
    m U(c) + tr(U''(c) P) / 2. Force, moment and what acts back on `frame` follow by virtual work. Of a field with sources within the bodies
    this is the field of all others. Connect `frame` to the part that carries the field (a planet); where it is left free, the field stands in the world.
    """

    frame = Frame.port()
    has_no_sources: ClassVar[bool] = False
    """Whether Laplace's equation holds where bodies are, as around a planet: a body whose moments of inertia are all equal is then a point."""

    @abstractmethod
    def potential(self, p: ca.SX, t: ca.SX) -> ca.SX:
        """Potential energy of one kilogram [m^2/s^2], scalar, at the place p (3, 1) [m] in the axes of `frame`, at time t [s]."""

    def spread_potential(self, p: ca.SX, R: ca.SX, spread: ca.SX, t: ca.SX) -> ca.SX:
        """What the second moments of mass `spread` (3, 3) [kg m^2] about the centre p, in axes turned by R (3, 3), add to a body's energy [J].

        By differentiation of `potential`; a closed form is an offer of speed. Where the field `has_no_sources`, their trace is taken off before.
        """
        c = ca.SX.sym("c", 3)
        curvature = ca.substitute(ca.hessian(ca.SX(self.potential(c, t)), c)[0], c, p)
        return 0.5 * ca.trace(curvature @ R @ spread @ R.T)


@final
class FieldForce(AbstractPotential):
    """What a field does to one body: frame_a stands where the field does, frame_b on the body."""

    if_infinite = "A field has no value in some places, as in the centre that attracts: begin beside them."

    def __init__(self, field: AbstractField, body: AbstractRigidPart) -> None:
        self.field, self.body = field, body
        self.created_at = field.created_at

    @property
    def seat(self) -> Point:
        """The connector of the body that frame_b is connected to."""
        return _seat(self.body).connector

    def inertia(self) -> Inertia:
        """Of the body, about and in frame_b."""
        return _seated_inertia(self.body)

    def potential(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        inertia, R = self.inertia(), symbolic(X_ab.rotation)
        centre = symbolic(X_ab.position)
        if not is_zero(inertia.moment):
            centre = centre + R @ _centre(inertia)
        energy = ca.SX(inertia.mass) * ca.SX(self.field.potential(centre, t))
        spread = _spread(inertia, self.field.has_no_sources)
        return energy if is_zero(spread) else energy + self.field.spread_potential(centre, R, symbolic(spread), t)


class AbstractMutualField(Component, ABC):
    """What every mass of a scene does to every other. Must provide `field_of`; action and reaction are equal by construction."""

    @abstractmethod
    def field_of(self, mass: ca.SX) -> AbstractField:
        """The field of a mass [kg] in one point."""


@final
class PairForce(AbstractPotential):
    """What two bodies do to one another by a mutual field, to second order in their sizes: frame_a on one, frame_b on the other."""

    if_infinite = "Bodies that attract one another are in one place: begin with them apart."

    def __init__(self, field: AbstractMutualField, one: AbstractRigidPart, other: AbstractRigidPart) -> None:
        self.field, self.one, self.other = field, one, other
        self.created_at = field.created_at

    @property
    def seats(self) -> tuple[Point, Point]:
        """The connectors of the bodies that frame_a and frame_b are connected to."""
        return _seat(self.one).connector, _seat(self.other).connector

    def potential(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        a, b = _seated_inertia(self.one), _seated_inertia(self.other)
        R = symbolic(X_ab.rotation)
        p = symbolic(X_ab.position) + R @ _centre(b) - _centre(a)
        field = self.field.field_of(ca.SX(a.mass))
        energy = ca.SX(b.mass) * ca.SX(field.potential(p, t))
        for inertia, by, place, turn in ((b, field, p, R), (a, self.field.field_of(ca.SX(b.mass)), -p, ca.SX.eye(3))):
            spread = _spread(inertia, by.has_no_sources)
            energy += 0 if is_zero(spread) else by.spread_potential(place, turn, symbolic(spread), t)
        return energy


def _seat(body: AbstractRigidPart) -> Attachment:
    """Where a force takes hold of a body."""
    return body.attachments()[0]


def _seated_inertia(body: AbstractRigidPart) -> Inertia:
    return body.inertia().seen_from(_seat(body).pose.inverse())


def _centre(inertia: Inertia) -> ca.SX:
    return ca.SX.zeros(3) if is_zero(inertia.moment) else symbolic(scaled(1 / inertia.mass, inertia.moment))


def _spread(inertia: Inertia, traceless: bool) -> Matrix:
    """Second moments of mass about the centre (3, 3) [kg m^2]; `traceless`: less their mean, which a field without sources does not feel."""
    second = inertia.central
    if isinstance(second, np.ndarray):
        return cleaned_vector((1 / 3 if traceless else 1 / 2) * np.trace(second) * np.eye(3) - second)
    return ca.sparsify((1 / 3 if traceless else 1 / 2) * ca.trace(second) * ca.SX.eye(3) - second)
