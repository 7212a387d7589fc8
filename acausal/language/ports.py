"""Connectors of systems: what is read there is what the parts have that touch there, inside and outside."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from acausal.errors import UnknownVariableError
from acausal.graphs import Graph
from acausal.language.component import Component, Connection, System
from acausal.language.connector import FLOWS, Connector, Frame, Point, Quantity
from acausal.language.equation import der
from acausal.language.expression import Derivative, Expression, Symbol

_FLOWS = ("force", "torque", *(flow for _, flow in FLOWS.values()))
_OF_FRAMES = ("rotation", "angular_velocity", "angular_acceleration", "torque")


@dataclass(frozen=True)
class Port:
    """A connector of a system, called `path`. `touching`: connectors of parts there. `inside`: those of them through which all flows that flows into the system
    here; `shared`: another connector of the system through which it may flow as well.
    """

    path: str
    touching: tuple[Connector, ...]
    inside: tuple[Connector, ...]
    shared: str

    def quantity(self, name: str) -> Expression:
        """What `name` is of the parts there. Raises `UnknownVariableError` where nothing touches, and for a flow that is not told apart from another one."""
        like = next((c for c in self.touching if isinstance(c, Frame) or name not in _OF_FRAMES), None)
        if like is None:
            what = "frame of a part" if self.touching else "part"
            raise UnknownVariableError(f"{self.path}.{name} is not known: {self.path} touches no {what}.")
        if name not in _FLOWS:
            return getattr(like, name)
        if self.shared:
            raise UnknownVariableError(
                f"{self.path}.{name} is not known: inside, {self.path} and {self.shared} are one place, and what flows in at one is not told apart from what "
                "flows in at the other. Read it at the parts that are connected."
            )
        flows = [getattr(c, name) for c in self.inside if name != "torque" or isinstance(c, Frame)]
        total: Expression = 0 * getattr(like, name)
        for flow in flows:
            total = total + flow
        return total


@dataclass(frozen=True)
class Ports:
    """Of a scene."""

    of: Mapping[Connector, Port]

    def at_parts(self, symbol: Symbol) -> Expression | None:
        """What a quantity or variable at a connector of a system is of the parts there; None for any other symbol. Raises as `Port.quantity`."""
        if isinstance(symbol, Derivative):
            inner = self.at_parts(symbol.of)
            return None if inner is None else der(inner)
        if isinstance(symbol, Quantity):
            port = self.of.get(symbol.connector)
            return None if port is None else port.quantity(symbol.name)
        found = ((self.of[end], name) for end in self._scalar for name, value in vars(end).items() if value is symbol)
        return next((port.quantity(name) for port, name in found), None)

    @functools.cached_property
    def _scalar(self) -> list[Connector]:
        return [end for end in self.of if not isinstance(end, Point)]


def ports_of(systems: Sequence[System], paths: Mapping[Connector, str]) -> Ports:
    """All of the `systems` of a scene, the scene first. `paths`: of all connectors, in order."""
    own = [system for system in systems if system.connectors()]
    if not own:
        return Ports({})
    everywhere = [connection for part in _within(systems[0]) for connection in part.connections()]
    degree = _degree(everywhere)
    order = {connector: k for k, connector in enumerate(paths)}
    touching = _groups(everywhere, order)
    found: dict[Connector, Port] = {}
    for system in own:
        connections = [connection for part in _within(system) for connection in part.connections()]
        groups, inner = _groups(connections, order), _degree(connections)
        for end in system.connectors():
            group = groups.get(end, [end]) if degree[end] > inner[end] else []  # nothing flows in where nothing touches outside
            shared = next((paths[c] for c in group if c is not end and c.owner is system and degree[c] > inner[c]), "")
            found[end] = Port(paths[end], _of_parts(touching.get(end, [])), _of_parts(group), shared)
    return Ports(found)


def _within(part: Component) -> Iterator[Component]:
    """A part and all that it is made of."""
    yield part
    if isinstance(part, System):
        for _, inner in part.parts():
            yield from _within(inner)


def _degree(connections: Sequence[Connection]) -> Counter[Connector]:
    return Counter(end for c in connections for end in (c.a, c.b))


def _groups(connections: Sequence[Connection], order: Mapping[Connector, int]) -> dict[Connector, list[Connector]]:
    """connector -> all that touch it by these connections, in order."""
    groups = (sorted(group, key=order.__getitem__) for group in Graph[Connector]((), ((c.a, c.b) for c in connections)).parts())
    return {end: group for group in groups for end in group}


def _of_parts(connectors: Sequence[Connector]) -> tuple[Connector, ...]:
    return tuple(c for c in connectors if not isinstance(c.owner, System))
