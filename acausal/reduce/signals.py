"""Forces that read variables of scalar domains: once these are solved, their values are put into the equations of motion."""

from __future__ import annotations

import dataclasses

import casadi as ca

from acausal.dynamics.system import MechanicalSystem
from acausal.errors import ModelError, UnknownVariableError
from acausal.language.expression import Derivative, Symbol
from acausal.language.flatten import Part
from acausal.scalar.coupling import ScalarPart


def with_signals(
    mechanics: MechanicalSystem, scalar: ScalarPart
) -> tuple[MechanicalSystem, ScalarPart, list[tuple[ca.SX, ca.SX]], dict[Symbol, Part]]:
    """The same without symbols of other parts' variables; what to put in for these; and those, with their readers, that stay since they depend on the force
    that reads them. Raises `ModelError` for rates of these, and where more than forces would depend on any.
    """
    states = {symbol.sx.element_hash() for symbol in scalar.states}
    wanted = {s: part for s, part in mechanics.readings.borrowed.items() if s.sx.numel() > 1 or s.sx.element_hash() not in states}
    values: dict[Symbol, ca.SX] = {}
    for symbol, part in wanted.items():
        values[symbol] = _value(mechanics, scalar, symbol, part)
    values, left = _without_each_other(values)
    rates = {symbol for symbol in left if symbol not in scalar.solved}
    if rates:
        raise _loop(mechanics, wanted, rates)
    symbols, new = [s.sx for s in values], list(values.values())

    def put(expression: ca.SX) -> ca.SX:
        return ca.substitute([expression], symbols, new)[0] if symbols else expression

    borrowed = ca.vertcat(ca.SX(0, 1), *(ca.vec(s) for s in symbols))
    kept = ca.vertcat(scalar.position, scalar.velocity, *(scalar.correction or ()))
    if borrowed.numel() and kept.numel() and ca.depends_on(kept, borrowed):
        raise _loop(mechanics, wanted, set(wanted))
    solved = (
        dict(zip(scalar.solved, ca.substitute([*scalar.solved.values()], symbols, new), strict=True))
        if symbols
        else scalar.solved
    )
    done = dataclasses.replace(scalar, rates=put(scalar.rates), solved=solved, tau=put(scalar.tau), led=None)
    pairs = list(zip(symbols, new, strict=True))
    return mechanics.with_values(pairs), done, pairs, {symbol: wanted[symbol] for symbol in left}


def _value(mechanics: MechanicalSystem, scalar: ScalarPart, symbol: Symbol, part: Part) -> ca.SX:
    """By t, x, u and p; of a derivative that no equation holds, by the chain rule."""
    if symbol in scalar.solved:
        return scalar.solved[symbol]
    if not isinstance(symbol, Derivative):
        raise UnknownVariableError(
            f"{part.where} depends on {_name(mechanics, symbol)} [{symbol.unit}], which no equation determines. Connect its part, or leave it out."
        )
    tree, inputs = mechanics.tree, [entry.sx for entry in mechanics.flat.inputs]
    of = _value(mechanics, scalar, symbol.of, part)
    if any(ca.depends_on(of, s) for s in (tree.v, *inputs) if s.numel()):
        raise _loop(mechanics, {symbol: part}, {symbol})
    rate = mechanics.kinematics.rate(of)
    states = ca.vertcat(ca.SX(0, 1), *(s.sx for s in scalar.states))
    return rate + ca.jtimes(of, states, scalar.rates) if states.numel() else rate


def _without_each_other(values: dict[Symbol, ca.SX]) -> tuple[dict[Symbol, ca.SX], list[Symbol]]:
    """Values in which no borrowed symbol is left: those that hold none first, then those that hold only these; and symbols whose values hold themselves."""
    done: dict[Symbol, ca.SX] = {}
    open_ones = dict(values)
    while open_ones:
        left = ca.vertcat(*(ca.vec(s.sx) for s in open_ones))
        ready = [s for s, value in open_ones.items() if not ca.depends_on(value, left)]
        if not ready:
            break
        for symbol in ready:
            done[symbol] = open_ones.pop(symbol)
        for symbol, value in open_ones.items():
            open_ones[symbol] = ca.substitute([value], [s.sx for s in ready], [done[s] for s in ready])[0]
    return done, list(open_ones)


def _loop(mechanics: MechanicalSystem, readers: dict[Symbol, Part], symbols: set[Symbol]) -> ModelError:
    symbol = next(s for s in readers if s in symbols)
    return ModelError(
        f"{readers[symbol].where} depends on {_name(mechanics, symbol)} [{symbol.unit}], which follows from accelerations or from rates of inputs; accelerations "
        "depend on this force itself. Put a delay between (a signal behind an Integrator is a state), or read positions and velocities."
    )


def _name(mechanics: MechanicalSystem, symbol: Symbol) -> str:
    if isinstance(symbol, Derivative):
        return f"der({_name(mechanics, symbol.of)})"
    return mechanics.flat.names.get(symbol, symbol.name)
