"""From a flat scene to scalar equations: those of components, of connections, and of joints whose flanges are connected."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import casadi as ca
import numpy as np

from acausal.dynamics.readings import Readings
from acausal.errors import ModelError, UnknownVariableError
from acausal.language.connector import FLOWS, Connector, Point, Quantity, Rotational, Translational
from acausal.language.equation import Equation, der, input_rates
from acausal.language.expression import Derivative, Expression, Input, Parameter, Symbol, Time, Variable, declared, time
from acausal.language.flatten import FlatSystem, Part
from acausal.language.mode_laws import OneWay
from acausal.scalar.canonical import canonical_parts
from acausal.scalar.equations import EquationSet, ScalarEquation, Unknown, symbols_in

_FAR = 1e6
"""A parameter may become so many times larger or smaller."""


@dataclass(frozen=True)
class Flange:
    """A joint's connected flange as the scalar equations see it.

    Its potential, the rates of it (`velocity`, `acceleration`) and the effort on the joint are symbols; mechanics say
    acceleration = bias + flexibility (1, n) efforts of all flanges.
    """

    connector: Connector
    position: ca.SX
    velocity: ca.SX
    acceleration: ca.SX
    effort: ca.SX
    bias: ca.SX
    flexibility: ca.SX


@dataclass(frozen=True)
class Collection:
    """Equations, and the declared symbols behind their scalars."""

    system: EquationSet
    flanges: tuple[Flange, ...]
    names: dict[Symbol, str]
    """Full names of all symbols in the equations."""
    elements: dict[Symbol, tuple[Symbol, ...]]
    """Scalars of each declared symbol in the equations; itself where it is one."""
    efforts: dict[int, ca.SX]
    """Of mechanical flanges: hash of the position -> the effort."""
    positions: set[int]
    """Hashes of mechanical flanges' positions, and of the variables of parts that are no derivatives."""
    declared: dict[int, int]
    """Hash of a scalar -> place of its part in the order of declaration."""

    @functools.cached_property
    def _symbols(self) -> dict[int, Symbol]:
        return {s.sx.element_hash(): s for scalars in self.elements.values() for s in scalars}

    def symbol_of(self, unknown: Unknown) -> Symbol:
        """The declared symbol of a scalar."""
        return self._symbols[unknown.symbol.element_hash()]


def has_scalar_parts(flat: FlatSystem) -> bool:
    """Whether any part has equations of its own or any joint's flange is connected."""
    return any(True for part in flat.parts for _ in _written(part)) or any(
        len(group) > 1 and not isinstance(group[0], Point) for group in flat.connection_sets
    )


def _written(part: Part) -> Iterable[Equation]:
    """The equations of a part. Raises `ModelError` for anything else that `equations` gives."""
    found: Any = part.component.equations()
    name = f"equations() of {part.where}"
    if not isinstance(found, Iterable):
        raise ModelError(f"{name} gives {found!r}. Give every equation by itself: yield ac.equal(left, right).")
    for k, entry in enumerate(cast("Iterable[Any]", found), start=1):
        if not isinstance(entry, Equation):
            hint = " '==' compares and gives no equation." if isinstance(entry, bool | Expression) else ""
            raise ModelError(f"Equation {k} of {part.where} is {entry!r}.{hint} Write yield ac.equal(left, right).")
        yield entry
    for law in part.laws:
        if isinstance(law, OneWay):
            yield from law.equations


def collect(flat: FlatSystem, driven: Sequence[tuple[Connector, str]], values: np.ndarray, readings: Readings) -> Collection:
    """All scalar equations of a scene; `driven` are connected flanges of joints, with the joints' names; `values` (np,) of the parameters.

    What equations read of mechanics is a known function of time, coordinates and velocities of joints, accelerations and reactions (`readings`).
    """
    return _Collector(flat, driven, values, readings).run()


class _Collector:
    def __init__(self, flat: FlatSystem, driven: Sequence[tuple[Connector, str]], values: np.ndarray, readings: Readings) -> None:
        self.flat = flat
        self.driven = driven
        self.readings = readings
        self.read: dict[int, ca.SX] = {}
        owners = [part.component for part in flat.parts if any(isinstance(c, Point) for c in part.component.connectors())]
        self.mechanical = {variable for owner in owners for variable in owner.variables()}
        self.values = dict(zip(flat.parameters, values.tolist(), strict=True))
        self.elements: dict[Symbol, tuple[Symbol, ...]] = {}
        self.names: dict[Symbol, str] = {}
        self.owners: dict[Symbol, Part] = {}
        self.scalars: dict[int, Symbol] = {}
        self.known: dict[Symbol, ca.SX] = {}
        written = [list(_written(part)) for part in flat.parts]
        order = canonical_parts(flat, [[e.residual.sx for e in own] for own in written])
        self.parts = [flat.parts[k] for k in order]
        self.written = [written[k] for k in order]
        rank = {part.component: k for k, part in enumerate(self.parts)}
        self.rank = {c: (rank[c.owner], flat.connector_paths[c]) for c in flat.connector_paths if c.owner in rank}

    def run(self) -> Collection:
        equations = [e for part, own in zip(self.parts, self.written, strict=True) for e in self._of_part(part, own)]
        groups = [group for group in self.flat.connection_sets if not isinstance(group[0], Point)]
        for group in sorted(groups, key=lambda group: min(self.rank[c] for c in group)):
            equations += self._of_connection(group)
        flanges = tuple(self._flange(k) for k in range(len(self.driven)))
        self._register_names()
        result: list[ScalarEquation] = []
        for residual, leaves, label, origin in equations:
            for symbol in sorted(leaves, key=lambda s: s.name):
                self._register(symbol, label)
            column = self._by_elements(residual, leaves)
            for i in range(column.numel()):
                result.append(ScalarEquation(column[i], label, origin))
        self._add_unused()
        result += [
            ScalarEquation(f.acceleration - f.bias - ca.dot(f.flexibility, ca.vertcat(*(g.effort for g in flanges)).T), f"mechanics of {name}")
            for f, (_, name) in zip(flanges, self.driven, strict=True)
        ]  # fmt: skip
        efforts = self._efforts()
        outside = self._outside
        own = {
            s.sx.element_hash()
            for symbol, scalars in self.elements.items()
            if isinstance(symbol, Variable) and not isinstance(symbol, Quantity) and symbol not in outside
            for s in scalars
        }
        return Collection(
            self._system(result, flanges), flanges, self.names, self.elements, efforts, own.union(efforts), self._declared()
        )

    def _declared(self) -> dict[int, int]:
        place = {part.component: k for k, part in enumerate(self.flat.parts)}
        return {key: place[self.owners[_base(s)].component] for key, s in self.scalars.items() if _base(s) in self.owners}

    def _efforts(self) -> dict[int, ca.SX]:
        found: dict[int, ca.SX] = {}
        for connector in self.flat.connector_paths:
            if type(connector) in (Rotational, Translational):
                potential, flow = FLOWS[type(connector)]
                position, effort = getattr(connector, potential), getattr(connector, flow)
                if position in self.elements and effort in self.elements:
                    found[position.sx.element_hash()] = effort.sx
        return found

    def _of_part(self, part: Part, written: Sequence[Equation]) -> Iterable[tuple[ca.SX, frozenset[Symbol], str, str]]:
        own = type(part.component).__module__.split(".")[0] not in ("acausal", "components")
        for k, e in enumerate(written, start=1):
            # a line of the user's own component says more than where the part was made
            origin = e.origin if own and e.origin else part.component.created_at
            yield *self._known_by_mechanics(e.residual, part), f"equation {k} of {part.path}", origin

    def _known_by_mechanics(self, residual: Expression, part: Part) -> tuple[ca.SX, frozenset[Symbol]]:
        """A residual and its symbols, with values put in for those of mechanics."""
        residual = self.flat.inside(residual)
        free = self.readings.free_flanges
        symbols = [
            s for s in residual.leaves if isinstance(_base(s), Quantity) or _base(s) in self.mechanical or _base(s) in free
        ]
        if not symbols:
            return residual.sx, residual.leaves
        symbols.sort(key=lambda s: s.name)
        values = [self.readings.resolved(s.sx, part) for s in symbols]
        found = symbols_in(values)
        given = {key: known for key, s in found.items() if isinstance(known := declared(s), Parameter | Input | Time)}
        self.read |= {key: s for key, s in found.items() if key not in given}
        changed = ca.substitute([residual.sx], [s.sx for s in symbols], values)[0]
        return changed, residual.leaves.difference(symbols).union(given.values())

    def _of_connection(self, group: tuple[Connector, ...]) -> list[tuple[ca.SX, frozenset[Symbol], str, str]]:
        kind, paths = type(group[0]), [self.flat.connector_paths[c] for c in group]
        group = tuple(sorted(group, key=lambda c: self.rank[c]))
        label = f"connection of {' and '.join(paths[:3])}" + (f" and {len(paths) - 3} more" if len(paths) > 3 else "")
        potential, flow = FLOWS.get(kind, ("value", ""))
        symbols: list[Variable] = [getattr(c, potential) for c in group]
        found: list[tuple[ca.SX, frozenset[Symbol], str, str]] = [
            (symbols[0].sx - s.sx, frozenset((symbols[0], s)), label, "") for s in symbols[1:]
        ]
        if flow:
            flows: list[Variable] = [getattr(c, flow) for c in group]
            total = ca.SX(0)
            for s in flows:
                total = total + s.sx
            found.append((total, frozenset(flows), label, ""))
        return found

    def _flange(self, k: int) -> Flange:
        connector, name = self.driven[k]
        potential, flow = FLOWS[type(connector)]
        position: Variable = getattr(connector, potential)
        velocity = der(position)
        acceleration = der(velocity)
        effort: Variable = getattr(connector, flow)
        bias = ca.SX.sym(f"free acceleration of {name}")
        flexibility = ca.SX.sym(f"flexibility of {name}", 1, len(self.driven))
        return Flange(connector, position.sx, velocity.sx, acceleration.sx, effort.sx, bias, flexibility)

    def _register_names(self) -> None:
        for part in self.parts:
            for variable in part.component.variables():
                self.owners[variable] = part
            for connector in part.component.connectors():
                for name, value in list(connector.__dict__.items()):
                    if isinstance(value, Variable):
                        self.names[value] = f"{self.flat.connector_paths[connector]}.{name}"
                        self.owners[value] = part
        self.names.update(self.flat.names)
        for connector, _ in self.driven:
            potential, flow = FLOWS[type(connector)]
            for symbol in (getattr(connector, potential), getattr(connector, flow)):
                self._register(symbol, "")
            self._register(der(der(getattr(connector, potential))), "")  # pyright: ignore[reportArgumentType]  # of a symbol: a symbol

    def _register(self, symbol: Symbol, where: str) -> None:
        if symbol in self.elements or symbol in self.known:
            return
        if isinstance(symbol, Time | Parameter | Input):
            if symbol not in self.flat.names and not isinstance(symbol, Time):
                raise UnknownVariableError(
                    f"The {where} contains {symbol!r}, which belongs to no part of the scene. Keep it as an attribute: scene.name = ..."
                )
            self.known[symbol] = ca.SX(0) if isinstance(symbol, Parameter) else ca.SX(1)
            return
        if isinstance(symbol, Derivative):
            self._register(symbol.of, where)
            self.names[symbol] = f"der({self.names[symbol.of]})"
            rates = tuple(der(s) for s in self.elements[symbol.of])
            self.elements[symbol] = rates if symbol.sx.numel() > 1 else (symbol,)  # pyright: ignore[reportArgumentType]
        else:
            self._check_scalar(symbol, where)
            self.elements[symbol] = (symbol,) if symbol.sx.numel() == 1 else self._split(symbol)
        for scalar in self.elements[symbol]:
            self.scalars[scalar.sx.element_hash()] = scalar

    def _split(self, symbol: Symbol) -> tuple[Symbol, ...]:
        """A variable for each entry."""
        start = symbol.start if isinstance(symbol, Variable) else None
        hint = symbol.if_undetermined if isinstance(symbol, Variable) else ""
        found: list[Symbol] = []
        for i in range(symbol.sx.numel()):
            own = None if start is None else float(start[i]) if isinstance(start, Sequence) else float(start)
            entry = Variable(symbol.unit, start=own, if_undetermined=hint, name=f"{symbol.name}[{i}]")
            self.names[entry] = f"{self.names[symbol]}[{i}]"
            self.owners[entry] = self.owners[symbol]
            found.append(entry)
        return tuple(found)

    def _check_scalar(self, symbol: Symbol, where: str) -> None:
        if symbol in self.owners and symbol not in self.mechanical:
            return
        raise UnknownVariableError(
            f"The {where} contains '{symbol.name}' [{symbol.unit}], which belongs to no part of the scene. Assign its part: scene.name = ..."
        )

    def _by_elements(self, residual: ca.SX, leaves: frozenset[Symbol]) -> ca.SX:
        large = [s for s in leaves if s in self.elements and s.sx.numel() > 1]
        if not large:
            return residual
        return ca.substitute([residual], [s.sx for s in large], [ca.vertcat(*(e.sx for e in self.elements[s])) for s in large])[0]

    def _add_unused(self) -> None:
        """Variables that a part with equations declares and never uses: nothing determines them."""
        for part in self.parts:
            component = part.component
            if any(isinstance(c, Point) for c in component.connectors()) or not any(True for _ in component.equations()):
                continue
            for variable in component.variables():
                self._register(variable, f"part {part.path}")

    def _system(self, equations: Sequence[ScalarEquation], flanges: Sequence[Flange]) -> EquationSet:
        outer = {f.position.element_hash() for f in flanges}
        unknowns = {s.sx.element_hash(): self._unknown(s) for s in self._all_scalars()}
        derivatives = [(s.sx, s.of.sx) for s in self._all_scalars() if isinstance(s, Derivative)]
        opaque = [symbol for f in flanges for symbol in (f.bias, *ca.vertsplit(f.flexibility.T))]
        chains = [(s, *input_rates(s)) for s in self.known if isinstance(s, Input)]
        rates = [rate for _, *both in chains for rate in both]
        rated = [(s.sx, rate) for s, rate in self.known.items() if not isinstance(s, Input)]
        rated += [(s.sx, rate.sx) for chain in chains for s, rate in itertools.pairwise(chain)]
        parameters = [s for s in self.known if isinstance(s, Parameter)]
        read, moving = self._read_of_mechanics()
        return EquationSet(
            tuple(equations), tuple(u for key, u in unknowns.items() if key not in outer), tuple(derivatives),
            (*(s.sx for s in self.known), *(s.sx for s in rates), *opaque, *(() if time in self.known else (time.sx,)), *read), (*rated, *moving),
            tuple((s.sx, self.values[s]) for s in parameters), self._limits(parameters),
            tuple((s.sx, self.flat.names.get(s, s.name)) for s in self.known) + tuple((s.sx, self.flat.names.get(of, of.name)) for of, *both in chains for s in both)
            + tuple((s, read_name(self.flat, s)) for s in read),
            tuple(unknowns[f.position.element_hash()] for f in flanges), self._rate_symbol,
        )  # fmt: skip

    def _read_of_mechanics(self) -> tuple[list[ca.SX], list[tuple[ca.SX, ca.SX]]]:
        """What is read, and the rates of what has known ones: coordinates of joints."""
        if not self.read:
            return [], []
        tree = self.readings.placement.kinematics.tree
        own = [*ca.vertsplit(tree.q), *ca.vertsplit(tree.v)]
        known = {s.element_hash() for s in own}
        return own + [s for key, s in self.read.items() if key not in known], [
            (tree.q[k], tree.rates[k]) for k in range(tree.q.numel())
        ]

    def _limits(self, parameters: Sequence[Parameter]) -> np.ndarray:
        """Values (k, n) of these parameters: one of them 0, large or small, the others as usual; without those that parts refuse."""
        present = np.array(list(self.values.values()))
        places = [self.flat.parameters.index(s) for s in parameters]
        found: list[np.ndarray] = []
        usual = np.where(present != 0, present, np.median(np.abs(present[present != 0])) if present.any() else 1.0)
        usual = usual if self.flat.conditions.allow(usual) else present

        for k in places:
            for value in (0.0, _FAR * usual[k], usual[k] / _FAR):
                at = usual.copy()
                at[k] = value
                if self.flat.conditions.allow(at):
                    found.append(at[places])
        return np.array(found).reshape(len(found), len(places))

    def _all_scalars(self) -> list[Symbol]:
        """Scalars of all symbols and what they are derivatives of, in the order of parts."""
        found: dict[Symbol, None] = {}
        for scalars in list(self.elements.values()):
            for scalar in scalars:
                chain = [scalar]
                while isinstance(chain[-1], Derivative):
                    chain.append(chain[-1].of)
                found |= dict.fromkeys(reversed(chain))
        place = {symbol: i for i, symbol in enumerate(self.owners)}
        return sorted(found, key=lambda s: (place.get(_base(s), len(place)), s.name.count("der(")))

    @functools.cached_property
    def _outside(self) -> set[Variable]:
        """Variables of connectors."""
        return {v for c in self.flat.connector_paths for v in c.__dict__.values() if isinstance(v, Variable)}

    def _unknown(self, symbol: Symbol) -> Unknown:
        base = _base(symbol)
        self.scalars[symbol.sx.element_hash()] = symbol
        own = base if isinstance(base, Variable) else None
        start = symbol.start if isinstance(symbol, Variable) and symbol.start is not None else None
        where = self.owners[base].component.created_at if base in self.owners else ""
        name = self.names.setdefault(symbol, f"der({self.names[symbol.of]})" if isinstance(symbol, Derivative) else symbol.name)
        number = None if start is None else float(start[0]) if isinstance(start, Sequence) else float(start)
        return Unknown(
            symbol.sx, name, symbol.unit, where, number, "" if own is None else own.if_undetermined, base in self._outside
        )

    def _rate_symbol(self, symbol: ca.SX) -> ca.SX:
        """The derivative of a declared symbol, declared when first asked for."""
        of = self.scalars[symbol.element_hash()]
        rate = der(of)
        if not isinstance(rate, Symbol):
            raise ModelError(f"{of!r} has no derivative.")
        self.names[rate] = f"der({self.names[of]})"
        self.scalars[rate.sx.element_hash()] = rate
        self.elements.setdefault(rate, (rate,))
        return rate.sx


def read_name(flat: FlatSystem, scalar: ca.SX) -> str:
    """Of something of mechanics."""
    symbol = declared(scalar)
    if isinstance(symbol, Quantity):
        return f"{flat.connector_paths.get(symbol.connector, '?')}.{symbol.name}"
    return scalar.name() if symbol is None else flat.names.get(symbol, symbol.name)


def _base(symbol: Symbol) -> Symbol:
    while isinstance(symbol, Derivative):
        symbol = symbol.of
    return symbol
