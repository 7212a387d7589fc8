"""Laws that read accelerations or reactions, which follow from all forces, these laws too: solved for what they read."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from acausal.dynamics.system import MechanicalSystem
from acausal.errors import ModelError
from acausal.language.connector import Quantity
from acausal.language.expression import Derivative, Symbol
from acausal.language.flatten import Part
from acausal.loops.constraints import Constraints
from acausal.loops.reactions import Reactions
from acausal.numerics.elimination import solved_by_qr
from acausal.numerics.terms import squares_of_terms
from acausal.scalar.coupling import ScalarPart

_STEPS = 7
"""Of Newton's iteration, which begins without these laws; each doubles the digits."""
_CLOSED = 1e-9
"""Part of the terms of a reading that may be left open: beyond it Newton's iteration has not come to a solution."""


_LOST = 64 * float(np.finfo(float).eps)
"""Times the sizes of all that a reading is made of, what rounding may leave open of it: its slopes in the readings are of the order of one where Newton's
iteration ends."""


def with_reactions(
    mechanics: MechanicalSystem,
    constraints: Constraints,
    v_dot: ca.SX,
    multipliers: ca.SX,
    scalar: ScalarPart,
    variables: Mapping[Symbol, Part],
) -> tuple[MechanicalSystem, ScalarPart, list[tuple[ca.SX, ca.SX]]]:
    """Without symbols of accelerations and reactions; and what to put into any expression for those of laws and readings. `variables`: those of scalar domains
    that follow from accelerations and from forces that read them, with these readers.

    With the laws phi(y) of readings y, accelerations and reactions are affine in phi: y = r + R phi(y), one linear system where the laws
    are linear in y, else solved by Newton's iteration from y = r, where they do nothing. Rates are NaN where that finds no solution.
    Raises `ModelError` where a constraint reads one, `UnknownVariableError` for reactions that are not determined.
    """
    readers = {**mechanics.readings.implicit, **variables}
    used = {
        s.element_hash()
        for s in ca.symvar(
            ca.veccat(
                *mechanics.laws[1:],
                scalar.tau,
                scalar.rates,
                *scalar.solved.values(),
                *(size.of for row in mechanics.modes for size in row.sizes),
                *((v_dot, multipliers) if variables else ()),
            )
        )
    }
    symbols = [s for s in readers if any(e.element_hash() in used for e in ca.vertsplit(ca.vec(s.sx)))]
    if not symbols:
        return mechanics, scalar, []
    kept = ca.vertcat(scalar.position, scalar.velocity, scalar.residuals, *(scalar.correction or ()))
    for symbol in symbols:
        if ca.depends_on(kept, ca.vec(symbol.sx)):
            raise ModelError(
                f"{readers[symbol].where} holds something by {_name(mechanics, symbol)}, which follows from all forces, also from the one that holds. Let a "
                "force or a torque depend on it, or put a delay between (a signal behind an Integrator is a state)."
            )
    phi, laws = mechanics.laws
    values = _values(mechanics, constraints, symbols, v_dot, multipliers, scalar.solved)
    entries = [
        (s, value)
        for symbol, read in zip(symbols, values, strict=True)
        for s, value in _scalars(symbol, read)
        if s.element_hash() in used
    ]
    y, read = (ca.vertcat(ca.SX(0, 1), *column) for column in zip(*entries, strict=True))
    found = _solved(y, read, phi, laws)
    pairs = [(y, found), (phi, ca.substitute(laws, y, found))]

    def put(value: ca.SX) -> ca.SX:
        return ca.substitute([value], *map(list, zip(*pairs, strict=True)))[0]

    solved = {symbol: put(value) for symbol, value in scalar.solved.items()}
    done = dataclasses.replace(scalar, rates=put(scalar.rates), solved=solved, tau=put(scalar.tau), led=None)
    return mechanics.with_values(pairs), done, pairs


_LEAST, _NOTHING = 1e-280, 1e-300
"""Added where they change nothing."""


def _scalars(symbol: Symbol, value: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
    """Entries of a symbol and of its value."""
    return list(zip(ca.vertsplit(ca.vec(symbol.sx)), ca.vertsplit(ca.densify(ca.vec(value))), strict=True))


def _values(
    mechanics: MechanicalSystem,
    constraints: Constraints,
    symbols: Sequence[Symbol],
    v_dot: ca.SX,
    multipliers: ca.SX,
    solved: Mapping[Symbol, ca.SX],
) -> list[ca.SX]:
    """What each of the symbols stands for, by laws and readings."""
    tree = mechanics.tree
    V, forces = ca.SX.sym("v_dot", v_dot.numel()), ca.SX.sym("multipliers", multipliers.numel())
    reactions = Reactions(mechanics, constraints, V, forces, solved)
    found: list[ca.SX] = []
    for symbol in symbols:
        if isinstance(symbol, Quantity):
            value = reactions.quantity(symbol)
        elif symbol in solved:
            value = solved[symbol]
        else:
            assert isinstance(symbol, Derivative)
            of = mechanics.readings.resolved(symbol.of.sx, mechanics.readings.implicit[symbol])
            value = mechanics.kinematics.rate(of) + ca.jtimes(of, tree.v, V)
        found.append(value)
    return ca.substitute(found, [V, forces], [v_dot, multipliers])


def _solved(y: ca.SX, read: ca.SX, phi: ca.SX, laws: ca.SX) -> ca.SX:
    """y = read(phi, y) with phi = laws(y), where read is affine in phi."""
    none = ca.SX.zeros(phi.numel())
    R, first = ca.jacobian(read, phi), ca.substitute(read, phi, none)
    slope = ca.densify(ca.SX.eye(y.numel()) - ca.jacobian(first, y) - R @ ca.jacobian(laws, y))
    value = first + R @ laws
    step = y - solved_by_qr(slope, y - value)
    start = ca.substitute(first, y, ca.SX.zeros(y.numel()))
    if not ca.depends_on(slope, y):
        return ca.substitute(step, y, start)
    found = start
    for _ in range(_STEPS):
        found = ca.substitute(step, y, found)
    squares = y * y + first * first + (R * R) @ (laws * laws)
    lost = squares_of_terms(value)  # a reading may pass through zero where the terms of it do not
    gap, squares = ca.substitute([y - value, _CLOSED**2 * squares + _LOST**2 * lost], [y], [found])
    # a root and no comparison, which would be a switch at which steps end
    open_ones = ca.sum1(ca.sqrt(squares + _LEAST - gap * gap))
    return found * (1 + _NOTHING * open_ones)


def _name(mechanics: MechanicalSystem, symbol: Symbol) -> str:
    if isinstance(symbol, Quantity):
        return f"{mechanics.flat.connector_paths.get(symbol.connector, '?')}.{symbol.name}"
    return f"der({mechanics.flat.names.get(symbol.of, symbol.of.name)})" if isinstance(symbol, Derivative) else symbol.name
