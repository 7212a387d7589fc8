"""Forces: a law on one side, where it acts on the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, final

import casadi as ca

from acausal.arguments import shown
from acausal.errors import ModelError
from acausal.language.component import Component
from acausal.language.connector import Point
from acausal.language.equation import der
from acausal.language.expression import Expression, sx
from acausal.language.origin import origin
from acausal.parts.as_read import AsRead, as_read
from acausal.parts.placement import Placement
from acausal.parts.pose import symbolic


@dataclass(frozen=True)
class Action:
    """Force [N] and torque [N*m] about the connector's origin, (3, 1) each, on what is connected there, in its axes."""

    connector: Point
    force: ca.SX
    torque: ca.SX

    def __post_init__(self) -> None:
        for name in ("force", "torque"):
            given = getattr(self, name)
            if not isinstance(given, ca.SX):
                object.__setattr__(self, name, sx(given))
            if getattr(self, name).shape != (3, 1):
                raise ModelError(
                    f"Action: the {name} is {shown(given)} ({origin()}). Give a column of three, e.g. ca.vertcat(fx, fy, fz)."
                )


class AbstractForce(Component, ABC):
    """Acts on the parts that its connectors touch. Must provide `actions`.

    In every motion the power of its actions is - d(potential_energy)/dt - power_loss: a trial motion checks it when the scene is built. One that says nothing of its energies
    stores none, and all that its actions take is lost; one that gives its potential and nothing else loses nothing.
    Placements give symbols: a law is written by CasADi's functions, without `if`.
    """

    if_infinite: ClassVar[str] = "Begin where its law is a number, or give it one there."
    """What is said where an action is infinite or not a number."""
    turns: ClassVar[bool] = False
    """Whether all its ends must be turned in space, as a particle is not."""

    @abstractmethod
    def actions(self, placement: Placement) -> tuple[Action, ...]:
        """What it does to the parts at its connectors."""

    def potential_energy(self, placement: Placement) -> ca.SX:
        """Energy stored [J], scalar; zero unless said otherwise."""
        return ca.SX(0)

    def power_loss(self, placement: Placement) -> ca.SX:
        """Power that leaves the mechanical energy [W], scalar: dissipated minus supplied. Unless said otherwise what the actions take, or nothing where there is a potential."""
        given = ca.SX(0)
        if not ca.SX(self.potential_energy(placement)).is_zero():
            return given
        for action in self.actions(placement):
            given += ca.dot(action.force, placement.velocity(action.connector))
            if not action.torque.is_zero():  # points do not turn
                given += ca.dot(action.torque, placement.angular_velocity(action.connector))
        return -given

    @final
    def stored_energy(self) -> Expression:
        """Its potential energy [J], to be read of a run."""
        return as_read(ca.SX(self.potential_energy(AsRead())))

    @final
    def dissipated_power(self) -> Expression:
        """Its `power_loss` [W], to be read of a run: less than zero where it drives."""
        return as_read(ca.SX(self.power_loss(AsRead())))

    def shapes(self) -> tuple[Any, ...]:
        """What to draw; see `acausal.visual.shapes`."""
        return ()


class AbstractReactiveForce(AbstractForce, ABC):
    """Acts by reactions, which laws of the part hold: it stores nothing, and loses what its actions take. Must provide `actions`, and `laws`."""


def at_ends(placement: Placement, a: Point, b: Point, force: ca.SX, torque: ca.SX) -> tuple[Action, ...]:
    """What drives b by a force [N] and a torque [N*m] about its origin, (3, 1) each in the axes of a, and a against it."""
    X = placement.relative_pose(a, b)
    R, p = symbolic(X.rotation), symbolic(X.position)
    return (Action(a, -force, -ca.cross(p, force) - torque), Action(b, R.T @ force, R.T @ torque))


class AbstractLineForce(AbstractForce, ABC):
    """Acts along the line between two points. Must provide `tension` and `potential`.

    The points pull each other with `tension(length, rate)` [N]; `rate` is that of the length [m/s].
    Both ends must lie apart: at length 0 the line has no direction.
    """

    if_infinite = "Points that lie on one another have no line between them: begin with them apart. At other distances its law must be a number."

    point_a = Point.port(must_connect=True, if_unconnected="A force between two points needs both.")
    point_b = Point.port(must_connect=True, if_unconnected="A force between two points needs both.")

    @abstractmethod
    def tension(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        """Pull [N] from the length [m] and its rate [m/s]; negative when it pushes."""

    @abstractmethod
    def potential(self, length: ca.SX) -> ca.SX:
        """Energy stored [J] at a length [m]; the part of `tension` without `rate` is its derivative."""

    @property
    def distance(self) -> Expression:
        """Of its ends [m]."""
        return as_read(self.length(AsRead()))

    @property
    def pull(self) -> Expression:
        """With which its ends pull each other [N], negative when it pushes."""
        far = self.distance
        return as_read(ca.SX(self.tension(far.sx, der(far).sx)))

    @final
    def length(self, placement: Placement) -> ca.SX:
        """Distance of the points [m]."""
        return ca.norm_2(symbolic(placement.relative_pose(self.point_a, self.point_b).position))

    @final
    def actions(self, placement: Placement) -> tuple[Action, ...]:
        X_ab = placement.relative_pose(self.point_a, self.point_b)
        p_ab = symbolic(X_ab.position)
        length = ca.norm_2(p_ab)
        symbol = ca.SX.sym("length")
        # dividing before the length is put in lets k * length / length fold to k
        per_length = ca.SX(self.tension(symbol, placement.rate(length))) / symbol
        pull = ca.substitute(per_length, symbol, length) * p_ab
        none = ca.SX.zeros(3)
        return (Action(self.point_a, pull, none), Action(self.point_b, -(symbolic(X_ab.rotation).T @ pull), none))

    @final
    def potential_energy(self, placement: Placement) -> ca.SX:
        return ca.SX(self.potential(self.length(placement)))

    @final
    def power_loss(self, placement: Placement) -> ca.SX:
        length, symbol = self.length(placement), ca.SX.sym("length")
        rate = placement.rate(length)
        elastic = ca.SX(self.tension(length, ca.SX(0)))
        # what a law that changes with time brings in
        supplied = ca.jtimes(ca.SX(self.potential(symbol)), placement.t, ca.SX(1))
        return (ca.SX(self.tension(length, rate)) - elastic) * rate - ca.substitute(supplied, symbol, length)
