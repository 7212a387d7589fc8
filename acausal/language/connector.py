"""Connectors: where parts touch. Potentials of connected connectors are equal, flows sum to zero.

Flow is positive into the component. A `Frame` has a pose and a wrench, a `Point` a position and a force; the scalar
domains are pairs of one potential and one flow.
"""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING, Any, ClassVar, Self, overload

from acausal.language.expression import Symbol, Variable


class Quantity(Symbol):
    """Something that can be read at a connector, e.g. `rod.tip.position`; found from the states by the model."""

    kind = "quantity"

    def __init__(self, connector: Connector, name: str, unit: str, shape: tuple[int, int]) -> None:
        super().__init__(name, unit, shape=shape)
        self.connector = connector

    def __repr__(self) -> str:
        return f"{self.name} of {self.connector!r}"


class Connector:
    """A place where a part can be connected; belongs to one component, its `owner`.

    Declared in a component class by `frame_a = Frame.port()`; each component instance has its own copy.
    `must_connect`: leaving it free is an error, whose message ends with the sentence `if_unconnected`.
    """

    domain: ClassVar[str] = "abstract"

    def __init__(self, owner: Any = None, name: str = "", *, must_connect: bool = False, if_unconnected: str = "") -> None:
        self.owner = owner
        self.name = name
        self.must_connect = must_connect
        self.if_unconnected = if_unconnected

    @classmethod
    def port(cls, *, must_connect: bool = False, if_unconnected: str = "") -> Self:
        """Declare this connector in a component class."""
        return cls(must_connect=must_connect, if_unconnected=if_unconnected)

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> Self: ...
    def __get__(self, instance: object | None, owner: type) -> Self:
        if instance is None:
            return self
        own = instance.__dict__.get(self.name)
        if own is None:
            own = type(self)(instance, self.name, must_connect=self.must_connect, if_unconnected=self.if_unconnected)
            instance.__dict__[self.name] = own
        return own

    @property
    def quantities(self) -> tuple[Symbol, ...]:
        """The quantities asked for so far."""
        return tuple(value for value in self.__dict__.values() if isinstance(value, Symbol))

    @classmethod
    def readable(cls) -> list[str]:
        """Names of all that can be read of it."""
        return [name for name in dir(cls) if not name.startswith("_") and name not in _NOT_READ]

    if not TYPE_CHECKING:  # a type checker finds misspelt names by itself; this is for people without one

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_"):
                raise AttributeError(name)
            known = self.readable()
            similar = difflib.get_close_matches(name, known, n=1)
            hint = f"Did you mean '{similar[0]}'?" if similar else f"It has: {', '.join(known)}."
            if name in ("rotation", "torque", "angular_velocity", "angular_acceleration"):
                hint = "A point has a position and no orientation; only frames have one."
            raise AttributeError(f"{self!r} has no '{name}'. {hint}", name=None, obj=None)  # Python adds no hint

    def __repr__(self) -> str:
        kind = type(self).__name__
        return f"{kind} {self.name} of {type(self.owner).__name__}" if self.owner is not None else f"{kind} {self.name}"


_NOT_READ = ("domain", "port", "quantities", "quantity", "readable")


class Point(Connector):
    """A material point: position and force, no orientation and no torque. Everything is resolved in the world frame."""

    domain = "mechanical"

    def quantity(self, name: str, unit: str, shape: tuple[int, int] = (3, 1)) -> Quantity:
        """The quantity called `name`, created when first asked for."""
        found = self.__dict__.get("_" + name)
        if found is None:
            found = self.__dict__["_" + name] = Quantity(self, name, unit, shape)
        return found

    @property
    def position(self) -> Quantity:
        """From the world's origin, in the world frame [m], shape (3, 1)."""
        return self.quantity("position", "m")

    @property
    def velocity(self) -> Quantity:
        """Rate of `position` [m/s], shape (3, 1)."""
        return self.quantity("velocity", "m/s")

    @property
    def acceleration(self) -> Quantity:
        """Rate of `velocity` [m/s^2], shape (3, 1); gravity is not subtracted."""
        return self.quantity("acceleration", "m/s^2")

    @property
    def specific_force(self) -> Quantity:
        """What an accelerometer feels there [m/s^2], in the world frame, shape (3, 1): `acceleration` less the gravity of the world and of all fields."""
        return self.quantity("specific_force", "m/s^2")

    @property
    def force(self) -> Quantity:
        """Force that flows into the component here, in the world frame [N], shape (3, 1)."""
        return self.quantity("force", "N")


class Frame(Point):
    """A coordinate frame fixed in a part: pose and wrench. Everything is resolved in the world frame."""

    @property
    def rotation(self) -> Quantity:
        """R_WF, whose columns are the frame's axes in the world frame, shape (3, 3)."""
        return self.quantity("rotation", "", (3, 3))

    @property
    def angular_velocity(self) -> Quantity:
        """Of the frame relative to the world, in the world frame [rad/s], shape (3, 1)."""
        return self.quantity("angular_velocity", "rad/s")

    @property
    def angular_acceleration(self) -> Quantity:
        """Rate of `angular_velocity` [rad/s^2], shape (3, 1)."""
        return self.quantity("angular_acceleration", "rad/s^2")

    @property
    def torque(self) -> Quantity:
        """Torque that flows into the component here, about the frame's origin, in the world frame [N*m], shape (3, 1)."""
        return self.quantity("torque", "N*m")


class Rotational(Connector):
    """A shaft's end: angle `phi` [rad], torque `tau` [N*m] into the component."""

    domain = "rotational"
    phi = Variable("rad", "angle")
    tau = Variable("N*m", "torque into the component")


class Translational(Connector):
    """A rod's end: position `s` [m], force `f` [N] into the component."""

    domain = "translational"
    s = Variable("m", "position")
    f = Variable("N", "force into the component")


class Electrical(Connector):
    """A pin: electric potential `v` [V], current `i` [A] into the component."""

    domain = "electrical"
    v = Variable("V", "potential", if_undetermined="A circuit without a Ground has no zero of potential: connect one to it.")
    i = Variable(
        "A",
        "current into the component",
        if_undetermined="Ideal sources, or Grounds, side by side leave open which share of a current each takes: keep one of them.",
    )


class Signal(Connector):
    """A signal: one `value`, equal at all connected ends, without flow."""

    domain = "signal"
    value = Variable("", "signal")


FLOWS: dict[type[Connector], tuple[str, str]] = {
    Rotational: ("phi", "tau"),
    Translational: ("s", "f"),
    Electrical: ("v", "i"),
}
"""Potential and flow of each scalar domain."""
