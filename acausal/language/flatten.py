"""Flatten: a tree of systems becomes a list of leaf parts, their variables and the sets of connectors that touch."""

from __future__ import annotations

import functools
import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import Any, cast

import casadi as ca

from acausal.errors import DuplicateError, IncompatibleError, ModelError, UnconnectedError, UnknownVariableError
from acausal.graphs import Graph
from acausal.language.component import Component, Connection, System
from acausal.language.conditions import ParameterConditions, asked_by
from acausal.language.connector import Connector
from acausal.language.expression import (
    Condition,
    Discrete,
    Expression,
    Input,
    Mode,
    Parameter,
    Reaction,
    Symbol,
    Variable,
    leaves,
)
from acausal.language.mode_laws import ModeLaw, OneWay
from acausal.language.ports import Ports, ports_of
from acausal.wording import compact, grouped, nearest, shortened

_ENTRY = re.compile(r"(.*)\[(\d+(?:,\d+)?)\]")


@dataclass(frozen=True)
class Part:
    """A leaf component and its path in the scene."""

    path: str
    component: Component
    turned: bool = False
    """Whether its laws are those of their other reactions, see `OneWay`."""

    @property
    def where(self) -> str:
        """Path and line, for messages."""
        return f"{self.path} ({self.component.created_at})" if self.component.created_at else self.path

    @functools.cached_property
    def laws(self) -> tuple[ModeLaw, ...]:
        """Of its reactions, and what it sets when."""
        found: Any = self.component.laws()
        if not isinstance(found, Iterable):
            raise ModelError(
                f"{self.where}: laws() of {type(self.component).__name__} gives {found!r}. Yield laws, such as ac.OneSided(...), or give a list of them."
            )
        return tuple((law.turned() or law) if self.turned and isinstance(law, OneWay) else law for law in found)

    def __reduce__(self) -> tuple[Any, ...]:
        """Laws are asked for again."""
        return Part, (self.path, self.component, self.turned)


@dataclass(frozen=True, repr=False)
class FlatSystem:
    """The scene without hierarchy: parts, symbols with full names, and sets of connectors that touch one another."""

    name: str
    parts: tuple[Part, ...]
    names: dict[Symbol, str]
    connector_paths: dict[Connector, str]
    connection_sets: tuple[tuple[Connector, ...], ...]
    """Leaf connectors only; a connector that touches nothing is a set of its own."""
    modes: tuple[Mode, ...] = ()
    """The last inputs, which nobody gives: which way parts behave that hold as long as they can, known as soon as their reactions are solved, and then in their
    place; and what parts remember (`Discrete`)."""
    solved: bool = False
    """Whether reactions are."""
    asked: tuple[Condition, ...] = ()
    """What parts ask of parameters."""
    systems: dict[str, System] = field(default_factory=dict[str, System])
    """Of which the parts are parts, by path, the scene first."""
    idle: dict[Reaction, str] = field(default_factory=dict[Reaction, str])
    """Reactions of laws that would hold if they were turned round, see `OneWay`, and their names."""
    free: dict[Symbol, str] = field(default_factory=dict[Symbol, str])
    """Coordinates and velocities of bodies that no joint of the scene holds, and their names."""

    def __reduce__(self) -> tuple[Any, ...]:
        return FlatSystem, (
            self.name,
            self.parts,
            self.names,
            self.connector_paths,
            self.connection_sets,
            self.modes,
            self.solved,
            self.asked,
            self.systems,
            self.idle,
            self.free,
        )

    @functools.cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All adjustable numbers, in the order in which they are met."""
        return tuple(symbol for symbol in self.names if isinstance(symbol, Parameter))

    @functools.cached_property
    def conditions(self) -> ParameterConditions:
        """What the parameters must fulfil, whatever values they are given."""
        return ParameterConditions(self.parameters, self.asked)

    @functools.cached_property
    def inputs(self) -> tuple[Input, ...]:
        """All inputs, in the order in which they are met, modes last; reactions among them as long as they are not solved."""
        left = (Mode, Reaction) if self.solved else (Mode,)
        return tuple(s for s in self.names if isinstance(s, Input) and not isinstance(s, left)) + self.modes

    @property
    def discretes(self) -> tuple[Discrete, ...]:
        """What parts remember: the last of the modes."""
        return tuple(mode for mode in self.modes if isinstance(mode, Discrete))

    @property
    def reactions(self) -> tuple[Reaction, ...]:
        """Of parts that hold as long as they can, in the order in which they are met."""
        return tuple(symbol for symbol in self.names if isinstance(symbol, Reaction))

    def with_turned(self, reaction: Reaction) -> FlatSystem | None:
        """With the laws of the part of this reaction turned round, see `OneWay`; None where they cannot be."""
        owners = [p for p in self.parts if any(isinstance(law, OneWay) and law.reaction is reaction for law in p.laws)]
        if not owners:
            return None
        part = owners[0]
        if part.turned or not all(isinstance(law, OneWay) and law.turned() for law in part.laws):
            return None
        other = Part(part.path, part.component, turned=True)
        others: dict[Symbol, Reaction] = {
            law.reaction: law.other for law in part.laws if isinstance(law, OneWay) and law.other is not None
        }
        names = {others.get(s, s): self.idle[others[s]] if s in others else name for s, name in self.names.items()}
        idle = {s: name for s, name in self.idle.items() if s not in others.values()}
        idle |= {law.reaction: self.names[law.reaction] for law in part.laws if isinstance(law, OneWay)}
        parts = tuple(other if one is part else one for one in self.parts)
        return replace(self, parts=parts, names=names, idle=idle)

    def named(self, name: str) -> Expression:
        """The variable, parameter, input or quantity of a connector that a name stands for, or an entry of it: `arm.elbow.q`, `ball.q[2]`,
        `rod.tip.position`. Raises `UnknownVariableError` with the names that are nearest.
        """
        found = self._found.get(name)
        if found is None:
            whole, entry = match.groups() if (match := _ENTRY.fullmatch(name)) else (name, None)
            found = self._found[whole] if whole in self._found else self._quantity(whole)
            if found is not None and entry is not None:
                row, *column = map(int, entry.split(","))
                inside = row < found.shape[0] and all(c < found.shape[1] for c in column)
                found = (found[row, column[0]] if column else found[row]) if inside else None
            if found is None:
                hint = self._hint(name)
                raise UnknownVariableError(f"There is no '{name}' in the scene '{self.name}'.{hint}")
            self._found[name] = found
        return found

    def _hint(self, name: str) -> str:
        whole, entry = name.rpartition("[")[::2]
        found = (self._found[whole] if whole in self._found else self._quantity(whole)) if entry else None
        if found is not None:
            counted = f" The shape of {whole} is {found.shape}: entries are counted from 0."
            return counted if found.shape != (1, 1) else f" Did you mean '{whole}'?"
        read = [f"{path}.{quantity}" for c, path in self.connector_paths.items() for quantity in c.readable()]
        all = compact(self.names.values() or self.connector_paths.values())
        return nearest(name, [*self.names.values(), *self.free.values(), *read]) or f" It has: {all}."

    def symbols(self, given: Any) -> Any:
        """What a user gives, one, a list, or a dictionary's keys, with names replaced by what they stand for."""
        if isinstance(given, Expression):
            return given
        if isinstance(given, str):
            return self.named(given)
        if isinstance(given, list | tuple):
            return [self.symbols(entry) for entry in cast(list[Any], given)]
        if isinstance(given, Mapping):
            return {self.symbols(key): value for key, value in cast(Mapping[Any, Any], given).items()}
        return given

    def connector(self, path: str) -> Connector | None:
        """With this path; None where there is none."""
        return next((connector for connector, own in self.connector_paths.items() if own == path), None)

    def _quantity(self, name: str) -> Expression | None:
        """`path.of.connector.quantity`, or `path.of.part.reading`, of a system too."""
        path, _, last = name.rpartition(".")
        if not last.isidentifier() or last[0] == "_":
            return None
        owners = (self.connector(path), self.systems.get(path), *(part.component for part in self.parts if part.path == path))
        found = (getattr(owner, last, None) for owner in owners if owner is not None)
        return next((one for one in found if isinstance(one, Expression)), None)

    @functools.cached_property
    def _found(self) -> dict[str, Expression]:
        """By name: all symbols, and what else has been asked for."""
        return {name: symbol for symbol, name in (self.free | self.names).items()}

    def at_parts(self, symbol: Symbol) -> Expression | None:
        """What a quantity or variable at a connector of a system is of the parts that touch there; None for any other symbol.

        Raises `UnknownVariableError` where nothing touches, and for a flow that is not told apart from another one.
        """
        return self._ports.at_parts(symbol)

    def inside(self, value: Expression) -> Expression:
        """An expression with what stands at connectors of systems as the parts there have it."""
        known = {leaf: found for leaf in value.leaves if (found := self.at_parts(leaf)) is not None}
        if not known:
            return value
        sx = ca.substitute([value.sx], [leaf.sx for leaf in known], [found.sx for found in known.values()])[0]
        return Expression(sx, value.leaves.difference(known).union(*(found.leaves for found in known.values())))

    @functools.cached_property
    def _ports(self) -> Ports:
        return ports_of(tuple(self.systems.values()), self.connector_paths)

    def part_of(self, connector: Connector) -> Part:
        """The leaf part that a connector belongs to."""
        return next(part for part in self.parts if part.component is connector.owner)

    def __str__(self) -> str:
        rows = [f"{self.name}: {len(self.parts)} parts, {len(self.connection_sets)} connection sets"]
        rows += grouped([(p.path, f"{type(p.component).__name__:<20} {p.component.created_at}") for p in self.parts])
        rows += shortened(
            [
                f"  {compact(dict.fromkeys(self.connector_paths[c] for c in group))} touch"
                for group in self.connection_sets
                if len(group) > 1
            ]
        )
        rows += grouped([(name, f"{symbol.kind} [{symbol.unit}]") for symbol, name in self.names.items()])
        return "\n".join(rows)


def flatten(scene: System) -> FlatSystem:
    """The leaf parts of a scene. Raises `DuplicateError`, `IncompatibleError` or `UnconnectedError`. Linear in its size."""
    parts: list[Part] = []
    owners: dict[int, str] = {id(scene): ""}
    names: dict[Symbol, str] = {}
    connector_paths: dict[Connector, str] = {}
    connections: list[Connection] = []
    asked: list[Condition] = []
    systems: dict[str, System] = {}
    queue: deque[tuple[str, Component]] = deque([("", scene)])
    while queue:
        path, component = queue.popleft()
        prefix, part = path + "." if path else "", Part(path, component)
        _name_symbols(part, prefix, names)
        for connector in component.connectors():
            connector_paths[connector] = prefix + connector.name
        connections += component.connections()
        asked += asked_by(component)
        if not isinstance(component, System):
            parts.append(part)
            continue
        systems[path] = component
        namesakes = {id(part) for name in component.namesakes if isinstance(part := vars(component).get(name), Component)}
        for name, child in component.parts():
            if id(child) in owners:
                first = f"as '{owners[id(child)]}'" if owners[id(child)] else "as the scene itself"
                raise DuplicateError(
                    f"The same {child!r} stands in the scene twice, {first} and as '{prefix + name}'. Make two parts."
                )
            owners[id(child)] = prefix + name
            queue.append((path if id(child) in namesakes else prefix + name, child))
    for path, system in systems.items():
        _check_attributes(system, path + "." if path else "", owners)
    _name_hidden_symbols(parts, names)
    others = [law.other for part in parts for law in part.laws if isinstance(law, OneWay) and law.other is not None]
    idle = {other: names.pop(other) for other in others if other in names}
    for connection in connections:
        _check_member(connection, connector_paths)
    sets = _connection_sets(connections, connector_paths)
    _check_connected(sets, connections, connector_paths)
    discretes = tuple(symbol for symbol in names if isinstance(symbol, Discrete))
    return FlatSystem(
        type(scene).__name__,
        tuple(parts),
        names,
        connector_paths,
        sets,
        discretes,
        asked=tuple(asked),
        systems=systems,
        idle=idle,
    )


def _check_attributes(system: System, prefix: str, owners: dict[int, str]) -> None:
    """Raise `ModelError` for a class in place of a part, and for parts that `System.parts` does not see."""
    for name, value in system.__dict__.items():
        if name.startswith("_"):
            continue
        if isinstance(value, type) and issubclass(value, Component):
            raise ModelError(
                f"{prefix}{name} is the class {value.__name__}, not a part. Make a part of it: {value.__name__}(...)."
            )
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
        for entry in inner:
            lost = entry if isinstance(entry, list | tuple) else entry.values() if isinstance(entry, dict) else ()
            for part in lost:
                if isinstance(part, Component) and id(part) not in owners:
                    raise ModelError(
                        f"{prefix}{name} holds {part!r} inside a {type(value).__name__} where parts are not looked for. Assign parts by name, "
                        "or as one flat list or dictionary: scene.legs = [Leg(), Leg()]."
                    )


def _name_symbols(part: Part, prefix: str, names: dict[Symbol, str]) -> None:
    component, _ = part.component, part.laws  # what stands only there is made when it is asked for
    for variable in component.variables():
        names.setdefault(variable, prefix + variable.name)
    for name, value in component.__dict__.items():
        if isinstance(value, Parameter | Input):
            names.setdefault(value, prefix + name)
            if value.name in ("parameter", "input", "reaction", "discrete"):
                value.name = prefix + name
        for i, entry in enumerate(cast(tuple[object, ...], value) if isinstance(value, tuple) else ()):
            if isinstance(entry, Reaction | Discrete):
                entry.name = names.setdefault(entry, f"{prefix}{name}[{i}]")
    for connector in component.connectors():
        for name, value in connector.__dict__.items():
            if isinstance(value, Variable):
                names.setdefault(value, f"{prefix}{connector.name}.{name}")


def _name_hidden_symbols(parts: list[Part], names: dict[Symbol, str]) -> None:
    """Parameters and inputs that stand only inside expressions get the name of the attribute that holds them."""
    for part in parts:
        for name, value in part.component.__dict__.items():
            for leaf in leaves_inside(value):
                if isinstance(leaf, Parameter | Input) and leaf not in names:
                    path = f"{part.path}.{name}"
                    taken = sum(other == path or other.startswith(path + "#") for other in names.values())
                    names[leaf] = path if not taken else f"{path}#{taken + 1}"
                    leaf.name = names[leaf]


def leaves_inside(value: object, within: tuple[object, ...] = ()) -> Iterator[Symbol]:
    """Declared symbols in an expression, or in those inside lists, tuples and values such as sections, curves and surfaces."""
    if isinstance(value, Expression | ca.SX):
        yield from sorted(leaves(value), key=lambda leaf: leaf.name)
    elif not isinstance(value, Component | Connector | Condition | type | ModuleType) and not any(
        value is outer for outer in within
    ):
        inner = value if isinstance(value, list | tuple) else getattr(value, "__dict__", {}).values()
        for entry in list(cast(Iterable[object], inner)):
            yield from leaves_inside(entry, (*within, value))


def _check_member(connection: Connection, paths: dict[Connector, str]) -> None:
    for end, other in ((connection.a, connection.b), (connection.b, connection.a)):
        if end not in paths:
            raise IncompatibleError(
                f"{paths.get(other, repr(other))} is connected ({connection.origin}) to '{end.name}' of {end.owner!r}, which is "
                f"not a part of the scene. Assign the part to the scene first: scene.name = {type(end.owner).__name__}(...). If its name was given to "
                "another part afterwards, connect that one."
            )


def _connection_sets(connections: list[Connection], paths: dict[Connector, str]) -> tuple[tuple[Connector, ...], ...]:
    order = {connector: i for i, connector in enumerate(paths)}
    leaf_sets: list[tuple[Connector, ...]] = []
    for group in Graph(paths, ((c.a, c.b) for c in connections)).parts():
        members = sorted((c for c in group if not isinstance(c.owner, System)), key=order.__getitem__)
        if members:
            leaf_sets.append(tuple(members))
    return tuple(sorted(leaf_sets, key=lambda members: order[members[0]]))


def _check_connected(sets: tuple[tuple[Connector, ...], ...], connections: list[Connection], paths: dict[Connector, str]) -> None:
    for group in sets:
        connector = group[0]
        if len(group) == 1 and connector.must_connect:
            owner = connector.owner
            line = f" ({owner.created_at})" if owner is not None else ""
            touched = next(part for part in Graph(paths, ((c.a, c.b) for c in connections)).parts() if connector in part)
            ports = ", ".join(sorted(paths[end] for end in touched if end is not connector))
            nothing = f"no other part: at {ports} nothing else is connected" if ports else "nothing"
            raise UnconnectedError(f"{paths[connector]}{line} is connected to {nothing}. {connector.if_unconnected}".rstrip())
