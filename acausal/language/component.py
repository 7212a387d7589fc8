"""Components and systems: parts with connectors, and parts made of parts."""

from __future__ import annotations

import difflib
import inspect
from abc import ABCMeta
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

from acausal.errors import DuplicateError, IncompatibleError, ModelError, ParameterError
from acausal.language.conditions import asked_by
from acausal.language.connector import FLOWS, Connector, Electrical, Point
from acausal.language.construction import check_arguments, check_makers
from acausal.language.equation import Equation, der
from acausal.language.expression import Expression, Parameter, Variable, leaves
from acausal.language.mode_laws import ModeLaw
from acausal.language.origin import ASKED, is_ingredient, origin


@dataclass(frozen=True)
class Connection:
    """Two connectors that touch, and where this was said."""

    a: Connector
    b: Connector
    origin: str


class PartClass(ABCMeta):
    """The class of classes of parts: `help` and `dir` of one that can be used leave out what it owes to `Component` and to abstract parts."""

    for_users: tuple[str, ...] = ()
    """Methods of an abstract part that are not for authors only."""

    def __dir__(cls) -> Iterable[str]:
        names = super().__dir__()
        if inspect.isabstract(cls) or cls is Component:
            return names
        bases = [base for base in cls.__mro__[1:] if base is Component or inspect.isabstract(base)]
        owed = {name for base in bases for name in vars(base)} - {*cls.for_users}
        return [n for n in names if not n.startswith("__") and (n not in owed or _is_read(getattr(cls, n)))]

    @property
    def __signature__(cls) -> inspect.Signature | None:
        """Of a part that takes no arguments; None where it is as Python finds it."""
        return inspect.Signature() if cls.__init__ is object.__init__ and cls.__new__ is Component.__new__ else None


def _is_read(member: object) -> bool:
    """What is declared or follows, and class methods, which make a part."""
    return isinstance(member, Variable | Connector | property) or inspect.ismethod(member)


class Component(metaclass=PartClass):
    """A part: connectors and variables declared in the class, and equations between them.

    A subclass declares `flange_a = Rotational.port()`, `w = Variable("rad/s")`, takes its numbers in `__init__`, and
    yields its `equations()`. Mechanical parts give bodies, joints or forces instead (see `acausal.parts`).
    """

    if_given_arguments: ClassVar[str] = "Leave them out."
    """What is said to who gives arguments to a part that takes none."""
    if_overlaps: ClassVar[str] = "Move what it keeps apart, or turn its normal round."
    """What is said where a gap of its laws is negative at the start."""
    if_undecided: ClassVar[str] = ""
    """What is said where no mode obeys its laws and those of others."""
    created_at: str
    """Where in the user's code it was made, `file:line`."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        check_makers(cls)

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        if cls.__init__ is object.__init__ and (args or kwargs):
            given = ", ".join([*(repr(a) for a in args), *(f"{name}={value!r}" for name, value in kwargs.items())])
            raise ParameterError(
                f"{cls.__name__}() takes no arguments; it was given {given} ({origin()}). {cls.if_given_arguments}"
            )
        check_arguments(cls, args, kwargs)
        if lacking := sorted(cls.__abstractmethods__):
            raise ModelError(
                f"{cls.__name__} does not say its {', '.join(f'{name}()' for name in lacking)} ({origin()}). Write it in the class."
            )
        self = super().__new__(cls)
        vars(self)["created_at"] = origin()
        if given := [c for value in (*args, *kwargs.values()) if is_ingredient(value) for c in asked_by(value)]:
            vars(self)[ASKED] = given
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Copied and unpickled as it is, and not made again."""
        return object.__new__, (type(self),), self.__dict__

    def equations(self) -> Iterable[Equation]:
        """Equations that hold at all times, between variables and scalar connectors; none by default."""
        return ()

    def stored_energy(self) -> Expression | float:
        """Energy held by the part [J], from its variables; 0 by default."""
        return 0.0

    def dissipated_power(self) -> Expression | float:
        """Power turned into heat by the part [W], from its variables.

        By default 0; but of a part of one's own that says nothing of its energies everything that flows in through scalar connectors.
        """
        return inflow(self) if _says_nothing_of_energy(type(self)) else 0.0

    def supplied_power(self) -> Expression | float:
        """Power brought in from outside by the part [W], from its variables; 0 by default."""
        return 0.0

    def given_motions(self) -> tuple[Expression, ...]:
        """Positions and angles that the part prescribes as functions of time: they need two derivatives. None by default."""
        return ()

    def laws(self) -> Iterable[ModeLaw]:
        """How its reactions (`ac.Reaction`) hold: `ac.OneSided`, `ac.OneWay`, `ac.DryFriction`, `ac.Lock`; and what is set when: `ac.when(..., set=...)`; none by default."""
        return ()

    def connections(self) -> tuple[Connection, ...]:
        """Connections made in this part: by `connect` in a system, or by the way a joint was placed."""
        return tuple(self.__dict__.get("_connections", ()))

    def variables(self) -> tuple[Variable, ...]:
        """The declared variables, those of its connectors not included."""
        return tuple(getattr(self, name) for name in declared(type(self), Variable))

    def connectors(self) -> tuple[Connector, ...]:
        """All connectors, declared ones first, then those made on request."""
        ports = [getattr(self, name) for name in declared(type(self), Connector)]
        known = set(ports)
        ports += [v for v in self.__dict__.values() if isinstance(v, Connector) and v.owner is self and v not in known]
        return tuple(ports)

    def __setattr__(self, name: str, value: object) -> None:
        if isinstance(getattr(type(self), name, None), Variable | Connector):
            raise DuplicateError(
                f"'{name}' is a {type(getattr(type(self), name)).__name__.lower()} of {self!r} and cannot be replaced ({origin()}). "
                "Start values are given to simulate(start={...}), parameters to the part when it is made."
            )
        if callable(getattr(type(self), name, None)):
            raise DuplicateError(
                f"'{name}' is a method of {type(self).__name__} and cannot be a part's name ({origin()}). Choose another name."
            )
        if (isinstance(value, Connector) and value.owner is None) or (type(value) is Variable and value.name == "variable"):
            kind = type(value).__name__
            how = "Variable(...)" if kind == "Variable" else f"{kind}.port()"
            raise ModelError(
                f"'{name}' of {self!r} is a {kind} made while the part was made ({origin()}), so the part does not own it. Declare it in the "
                f"body of the class: {name} = ac.{how}, outside of __init__."
            )
        super().__setattr__(name, value)

    if not TYPE_CHECKING:  # a type checker finds misspelt names by itself; this is for people without one

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_"):
                raise AttributeError(name)
            explained = getattr(type(self), name, None)
            if isinstance(explained, property) and explained.fget is not None:
                return explained.fget(self)  # says itself why it has no value
            own = [n for n in self.__dict__ if not n.startswith("_") and n != "created_at"]
            known = [n for n in dir(type(self)) if not n.startswith("_")] + own
            similar = difflib.get_close_matches(name, known, n=1)
            declarations = [*declared(type(self), Connector), *declared(type(self), Variable)]
            has = ", ".join(dict.fromkeys([*declarations, *own])) or "nothing yet; assign parts first: self.name = ..."
            hint = f" Did you mean '{similar[0]}'?" if similar else ""
            raise AttributeError(f"{self!r} has no '{name}'.{hint} It has: {has}.", name=None, obj=None)  # Python adds no hint

    def __repr__(self) -> str:
        return f"{type(self).__name__} (made at {self.created_at})" if self.created_at else type(self).__name__


def is_own(cls: type[Component]) -> bool:
    """Whether it is a user's class, and not one of the library's."""
    return cls.__module__.split(".")[0] not in ("acausal", "components")


def _says_nothing_of_energy(cls: type[Component]) -> bool:
    said = (cls.stored_energy, cls.dissipated_power, cls.supplied_power)
    return is_own(cls) and said == (Component.stored_energy, Component.dissipated_power, Component.supplied_power)


def energy_unknown(part: Component) -> bool:
    """Whether a part has equations of its own, and does not say what energy it stores, loses or brings in."""
    return type(part).equations is not Component.equations and _says_nothing_of_energy(type(part))


def inflow(part: Component) -> Expression | float:
    """Power that flows into a part through its scalar connectors [W]; joints and bodies pass it on."""
    ends = part.connectors()
    if any(is_mechanical(end) for end in ends):
        return 0.0
    total: Expression | float = 0.0
    for end in ends:
        if type(end) in FLOWS:
            potential, flow = (getattr(end, name) for name in FLOWS[type(end)])
            total = flow * (potential if isinstance(end, Electrical) else der(potential)) + total
    return total


def law_changes(part: Component) -> bool:
    """Whether a part of equations is made with what changes by itself (time, inputs, variables of other parts): then who makes it change does work
    that the part cannot know of, and what comes in and is not stored is what is lost.
    """
    if type(part).equations is Component.equations or any(is_mechanical(end) for end in part.connectors()):
        return False
    own = {*part.variables(), *(v for end in part.connectors() for v in vars(end).values() if isinstance(v, Variable))}
    given = (
        value for name, value in vars(part).items() if not name.startswith("_") and not isinstance(value, Connector | Variable)
    )
    return any(not isinstance(leaf, Parameter) and leaf not in own for value in given for leaf in leaves(value))


def declared(cls: type, kind: type) -> list[str]:
    """Names of the class attributes of this kind, base classes first, in the order of declaration."""
    names = [name for base in reversed(cls.__mro__) for name, value in vars(base).items() if isinstance(value, kind)]
    return list(dict.fromkeys(names))


class System(Component):
    """Parts and connections. A part's name is the attribute that it was assigned to; lists of parts are numbered, dictionaries of parts named.

    As a class: assign parts and `connect` them in `__init__`. As a script: `scene = System()`, `scene.rod = ...`.
    A system with connectors of its own is a component of a larger one.
    """

    if_given_arguments = "Assign parts by name: scene.world = World(), scene.rod = RigidBody.rod(...)."
    namesakes: ClassVar[tuple[str, ...]] = ()
    """Attributes whose parts have the system's own name: what it is one way to say."""

    def connect(self, *connectors: Connector) -> None:
        """Join two or more connectors. Raises `IncompatibleError` for kinds that do not fit or fewer, `DuplicateError` when repeated."""
        if len(connectors) < 2:
            raise IncompatibleError(f"connect joins two connectors or more, and is given {len(connectors)} ({origin()}).")
        a, *others = connectors
        for other in others:
            check_compatible(a, other)
            if any({id(a), id(other)} == {id(old.a), id(old.b)} for old in self.connections()):
                raise DuplicateError(f"{a!r} and {other!r} are already connected ({origin()}). Remove one of the two calls.")
            add_connection(self, a, other)

    def parts(self) -> Iterator[tuple[str, Component]]:
        """Name and part, in the order of assignment; `legs[0]`, `legs[1]` for a list, `legs.left` for a dictionary."""
        for name, value in self.__dict__.items():
            if name.startswith("_"):
                continue
            if isinstance(value, Component):
                yield name, value
            elif isinstance(value, list | tuple):
                yield from ((f"{name}[{i}]", part) for i, part in enumerate(value) if isinstance(part, Component))
            elif isinstance(value, dict):
                yield from ((f"{name}.{key}", part) for key, part in value.items() if isinstance(part, Component))


def add_connection(part: Component, a: Connector, b: Connector) -> None:
    """Note in `part` that two connectors touch."""
    vars(part).setdefault("_connections", []).append(Connection(a, b, origin()))


def check_compatible(a: object, b: object) -> None:
    """Raise `IncompatibleError` unless a and b are connectors of one domain, and different."""
    for end in (a, b):
        if not isinstance(end, Connector):
            hint = (
                " Connect one of its connectors: " + ", ".join(dict.fromkeys(c.name for c in end.connectors())) + "."
                if isinstance(end, Component)
                else ""
            )
            raise IncompatibleError(f"connect() takes connectors, not {end!r} ({origin()}).{hint}")
        if end.owner is None:
            raise IncompatibleError(
                f"{type(end).__name__} '{end.name}' belongs to a class, not to a part ({origin()}). Make an instance of the part first."
            )
    assert isinstance(a, Connector) and isinstance(b, Connector)
    if a is b:
        raise IncompatibleError(f"{a!r} cannot be connected to itself ({origin()}).")
    if a.domain != b.domain or (a.domain != "mechanical" and type(a) is not type(b)):
        raise IncompatibleError(
            f"{a!r} ({a.domain}) does not fit {b!r} ({b.domain}) ({origin()}). Connect frames and points with each other, and "
            f"{'a ' + a.domain if a.domain != 'mechanical' else 'a ' + b.domain} connector with its own kind."
        )


def is_mechanical(connector: Connector) -> bool:
    """Whether it is a `Frame` or a `Point`."""
    return isinstance(connector, Point)
