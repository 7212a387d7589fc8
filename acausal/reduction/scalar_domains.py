"""Scalar domains: equations of components and connections become states, rates and solved variables.

Variables are eliminated one by one: aliases, equations linear in an unknown with a constant factor, and constraints
between differentiated variables, which lower the index because the derivatives of the eliminated variable go with it.
What is left is linear in derivatives and algebraic unknowns and is solved as one block.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from acausal.errors import OverdeterminedError, UnderdeterminedError
from acausal.language.connector import FLOWS, Connector, Point
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Derivative, Expression, Input, Parameter, Symbol, Time, Variable
from acausal.language.flatten import FlatSystem


@dataclass(frozen=True)
class Driven:
    """A scalar connector moved by a joint: its potential (joint coordinate), the two rates of it, and its effort on the joint.

    `acceleration` is a symbol that stands for the second rate.
    """

    connector: Connector
    position: ca.SX
    velocity: ca.SX
    acceleration: ca.SX
    name: str


@dataclass(frozen=True)
class ScalarReduction:
    """States and their rates, all solved variables, and the efforts on joints; in states, q, v, t, u, p.

    All may hold the symbols of `Driven.acceleration`, linearly: then the mechanics and they are solved together.
    """

    states: tuple[Symbol, ...]
    rates: tuple[ca.SX, ...]
    solved: dict[Symbol, ca.SX]
    efforts: tuple[ca.SX, ...]


@dataclass
class _System:
    """The equations while they shrink."""

    flat: FlatSystem
    residuals: list[ca.SX]
    origins: list[str]
    unknowns: dict[int, Symbol] = field(default_factory=dict)
    """By element hash of their symbol: everything not yet solved, derivatives included."""
    chain: dict[int, Symbol] = field(default_factory=dict)
    """Hash of a symbol -> its derivative symbol."""
    driven_rates: list[tuple[ca.SX, ca.SX]] = field(default_factory=list)
    solved: list[tuple[Symbol, ca.SX]] = field(default_factory=list)


def has_scalar_parts(flat: FlatSystem) -> bool:
    """Whether any part has equations of its own or any joint's flange is connected."""
    return any(True for part in flat.parts for _ in part.component.equations()) or any(
        len(group) > 1 and not isinstance(group[0], Point) for group in flat.connection_sets
    )


def reduce_scalar(flat: FlatSystem, driven: tuple[Driven, ...]) -> ScalarReduction:
    """Reduce all scalar equations of a scene. Raises `UnderdeterminedError`, `OverdeterminedError` with names and lines."""
    system = _collect(flat, driven)
    count = (len(system.residuals), len(system.unknowns))
    while _eliminate_one(system):
        pass
    states = _states(system)
    _solve_rest(system, states, count)
    return _finished(system, states, driven)


def _collect(flat: FlatSystem, driven: tuple[Driven, ...]) -> _System:
    equations: list[Equation] = []
    for part in flat.parts:
        equations += [Equation(e.residual, e.origin or part.where) for e in part.component.equations()]
    for group in flat.connection_sets:
        if not isinstance(group[0], Point):
            equations += _connection_equations(flat, group)
    moved = {id(d.connector): d for d in driven}
    symbols: set[Symbol] = set()
    for e in equations:
        symbols |= e.residual.leaves
    system = _System(flat, [], [])
    for d in driven:  # the effort at a joint's flange is an unknown of the scalar equations
        symbols.add(getattr(d.connector, FLOWS[type(d.connector)][1]))
    for e in equations:
        for i in range(e.residual.sx.numel()):
            system.residuals.append(e.residual.sx[i])
            system.origins.append(e.origin)
    potentials = {id(getattr(d.connector, FLOWS[type(d.connector)][0])) for d in driven}
    pairs: list[tuple[ca.SX, ca.SX]] = []
    for d in moved.values():
        potential = getattr(d.connector, FLOWS[type(d.connector)][0])
        pairs.append((potential.sx, d.position))
        first = der(potential)
        second = der(first)
        pairs += [(first.sx, d.velocity), (second.sx, d.acceleration)]
        system.driven_rates += [(d.position, d.velocity), (d.velocity, d.acceleration)]
        system.solved += [(potential, d.position)]
    for old, new in pairs:
        system.residuals = _substituted(system.residuals, old, new)
    for symbol in sorted(symbols, key=lambda s: s.name):
        if isinstance(symbol, Time | Parameter | Input) or id(symbol) in potentials:
            continue
        if isinstance(symbol, Derivative) and (
            id(symbol.of) in potentials or (isinstance(symbol.of, Derivative) and id(symbol.of.of) in potentials)
        ):
            continue
        _add_unknown(system, symbol)
    return system


def _add_unknown(system: _System, symbol: Symbol) -> None:
    key = symbol.sx.element_hash()
    if key in system.unknowns:
        return
    system.unknowns[key] = symbol
    if isinstance(symbol, Derivative):
        of = symbol.of
        system.chain[of.sx.element_hash()] = symbol
        _add_unknown(system, of)


def _connection_equations(flat: FlatSystem, group: tuple[Connector, ...]) -> list[Equation]:
    kind = type(group[0])
    where = flat.connector_paths[group[0]]
    if kind in FLOWS:
        potential, flow = FLOWS[kind]
        result = [equal(getattr(group[0], potential), getattr(c, potential)) for c in group[1:]]
        total = Expression(ca.SX(0), frozenset())
        for c in group:
            total = total + getattr(c, flow)
        result.append(equal(total, 0.0))
    else:
        result = [equal(group[0].value, c.value) for c in group[1:]]  # pyright: ignore[reportAttributeAccessIssue]
    return [Equation(e.residual, f"connection at {where}") for e in result]


def _substituted(residuals: list[ca.SX], old: ca.SX, new: ca.SX) -> list[ca.SX]:
    key = old.element_hash()
    return [ca.substitute(r, old, new) if any(s.element_hash() == key for s in ca.symvar(r)) else r for r in residuals]


def _eliminate_one(system: _System) -> bool:
    """Solve one equation for one unknown, if any is linear with a constant factor; constraints between states come first."""
    best: tuple[int, int, Symbol, ca.SX] | None = None
    for i, residual in enumerate(system.residuals):
        present = [s for s in ca.symvar(residual) if s.element_hash() in system.unknowns]
        if not present:
            _check_empty(system, i)
            del system.residuals[i], system.origins[i]
            return True
        found = _candidate(system, residual, present)
        if found is not None and (best is None or found[0] < best[0]):
            best = (found[0], i, found[1], found[2])
            if best[0] == 0:
                break
    if best is None:
        return False
    _, i, symbol, value = best
    del system.residuals[i], system.origins[i]
    _replace(system, symbol, value)
    return True


def _candidate(system: _System, residual: ca.SX, present: list[ca.SX]) -> tuple[int, Symbol, ca.SX] | None:
    """(rank, unknown, its value): an algebraic unknown, or a state where only states are in the equation."""
    kinds = [_kind(system, s) for s in present]
    only_states = all(k == "state" for k in kinds)
    if not only_states and not any(k == "algebraic" for k in kinds):
        return None
    order = sorted(
        range(len(present)), key=lambda k: (kinds[k] != "algebraic", system.unknowns[present[k].element_hash()].name.count("."))
    )
    for k in order:
        if kinds[k] == "rate" or (kinds[k] == "state" and not only_states):
            continue
        factor = ca.simplify(ca.jacobian(residual, present[k]))
        if factor.is_constant() and abs(float(factor)) > 1e-12:
            value = ca.substitute(residual, present[k], ca.SX(0)) / (-factor)
            return (len(present) - 1 if only_states else 2 + len(present)), system.unknowns[present[k].element_hash()], value
    return None


def _kind(system: _System, symbol: ca.SX) -> str:
    """'rate' (a highest derivative), 'state' (its derivative occurs), or 'algebraic'."""
    key = symbol.element_hash()
    if key in system.chain and system.chain[key].sx.element_hash() in system.unknowns:
        return "state"
    return "rate" if isinstance(system.unknowns[key], Derivative) else "algebraic"


def _replace(system: _System, symbol: Symbol, value: ca.SX) -> None:
    """Put `value` for `symbol`, and the rates of `value` for its derivatives."""
    while True:
        system.residuals = _substituted(system.residuals, symbol.sx, value)
        system.solved.append((symbol, value))
        key = symbol.sx.element_hash()
        del system.unknowns[key]
        rate = system.chain.pop(key, None)
        if rate is None or rate.sx.element_hash() not in system.unknowns:
            return
        symbol, value = rate, _rate(system, value)


def _rate(system: _System, value: ca.SX) -> ca.SX:
    """Time derivative through the derivative symbols (made where missing), joint rates and time."""
    rate = ca.SX(0)
    joint_rates = {old.element_hash(): new for old, new in system.driven_rates if old.is_symbolic()}
    for s in ca.symvar(value):
        key = s.element_hash()
        slope = ca.gradient(value, s)
        if key in joint_rates:
            rate += slope * joint_rates[key]
        elif key in system.unknowns:
            symbol = system.unknowns[key]
            derivative = der(symbol)
            assert isinstance(derivative, Symbol)
            _add_unknown(system, derivative)
            rate += slope * derivative.sx
        elif s.element_hash() == _time_hash():
            rate += slope
        elif any(s.element_hash() == u.sx.element_hash() for u in system.flat.inputs):
            raise OverdeterminedError(
                f"The input '{s.name()}' would have to be differentiated. Give its rate as an input too, or put a stiff element between."
            )
    return rate


def _time_hash() -> int:
    from acausal.language.expression import time

    return time.sx.element_hash()


def _check_empty(system: _System, i: int) -> None:
    residual = ca.simplify(system.residuals[i])
    if residual.is_constant() and abs(float(residual)) < 1e-12:
        return
    raise OverdeterminedError(
        f"An equation ({system.origins[i]}) holds no unknown any more but is not zero: 0 = {residual}. "
        "It contradicts the others: a motion or a value is given twice. Remove one source or connection."
    )


def _states(system: _System) -> list[Symbol]:
    return [symbol for symbol in system.unknowns.values() if _kind(system, symbol.sx) == "state"]


def _solve_rest(system: _System, states: list[Symbol], count: tuple[int, int]) -> None:
    """What is left, solved as a linear system for rates and algebraic unknowns."""
    unknowns = [s for s in system.unknowns.values() if s not in states]
    if len(unknowns) > len(system.residuals):
        related = unknowns + [symbol for symbol, value in system.solved if any(ca.depends_on(value, s.sx) for s in unknowns)]
        names = ", ".join(_told(system, s) for s in related[:4])
        hints = " ".join(dict.fromkeys(s.if_undetermined for s in related if isinstance(s, Variable) and s.if_undetermined))
        missing = len(unknowns) - len(system.residuals)
        raise UnderdeterminedError(
            f"{missing} variable{'s have' if missing > 1 else ' has'} no equation, among: {names}. {hints} {count[0]} equations, {count[1]} unknowns. "
            "A component or a connection may be missing."
        )
    if len(unknowns) < len(system.residuals):
        raise OverdeterminedError(
            f"{len(system.residuals) - len(unknowns)} equations too many, among those from: {', '.join(dict.fromkeys(system.origins))}. "
            f"{count[0]} equations, {count[1]} unknowns. A motion or a value may be given twice."
        )
    if not unknowns:
        return
    residual = ca.vertcat(*system.residuals)
    column = ca.vertcat(*(s.sx for s in unknowns))
    matrix = ca.jacobian(residual, column)
    if ca.depends_on(matrix, column):
        raise UnderdeterminedError(
            f"The equations for {', '.join(_told(system, s) for s in unknowns[:4])} form a nonlinear loop, which cannot be solved symbolically. "
            "Write them with a state (a small inertia, capacity or stiffness) between."
        )
    constant = ca.substitute(residual, column, ca.SX.zeros(column.numel()))
    values = ca.solve(ca.densify(matrix), -constant) if len(unknowns) > 1 else -constant / matrix
    for k, symbol in enumerate(unknowns):
        system.solved.append((symbol, values[k]))


def _told(system: _System, symbol: Symbol) -> str:
    name = system.flat.names.get(symbol, symbol.name)
    return f"{name} [{symbol.unit}]"


def _finished(system: _System, states: list[Symbol], driven: tuple[Driven, ...]) -> ScalarReduction:
    """Solved values by states alone: substitute from the last solved to the first."""
    final: dict[int, tuple[Symbol, ca.SX]] = {}
    for symbol, value in reversed(system.solved):
        for s in ca.symvar(value):
            known = final.get(s.element_hash())
            if known is not None:
                value = ca.substitute(value, s, known[1])
        final[symbol.sx.element_hash()] = (symbol, value)
    rates = tuple(final[der(s).sx.element_hash()][1] for s in states)
    efforts = tuple(final[getattr(d.connector, FLOWS[type(d.connector)][1]).sx.element_hash()][1] for d in driven)
    solved = dict(final.values())
    solved.update({s: s.sx for s in states})
    return ScalarReduction(tuple(states), rates, solved, efforts)
