"""Modes of a reduced system as functions of numbers, in the states that are integrated."""

from __future__ import annotations

import casadi as ca

from acausal.collocation.modes import ModeFunctions
from acausal.numerics.staged import Function, Staged, Systems
from acausal.reduce.modes import Modes
from acausal.reduce.reduce import ReducedSystem
from acausal.reduce.state_space import StateSpace

_NO_GAP = 8
"""With others: of a speed that must not be negative, as `runtime/complementary.h` has it."""

_NO_TERMS = -1
"""Of what has no gap; those of a gap may be zero where it is."""
_LEAST = 1e-300
"""Of what is not zero."""


def mode_functions(
    m: Modes | None, system: ReducedSystem, space: StateSpace, invariants: ca.Function | None, projection: ca.Function | None
) -> ModeFunctions:
    """`invariants` and `projection`: of what holds in all modes. Without `m` there is only what parts remember."""
    t, x, u, p = space.arguments
    rows = ca.SX(0, 1) if invariants is None else invariants(t, x, u, p)
    step = x if projection is None else projection(t, x, u, p)
    if system.locks is not None:
        rows, step = ca.vertcat(rows, space.put(system.locks.invariants)), step + space.put(space.kept(system.locks.correction))
    if m is not None:
        rows, step = ca.vertcat(rows, space.put(m.invariants)), step + space.put(space.kept(m.correction))

    def function(name: str, result: ca.SX) -> ca.Function:
        return ca.Function(name, [t, x, u, p], [ca.densify(space.put(result))], ["t", "x", "u", "p"], [name])

    systems = Systems() if m is None else m.systems.with_operands(space.put)

    def masked(name: str, result: ca.SX) -> Function:
        return Staged.of(name, [t, x, u, p], [ca.densify(result)], systems, fold=False)

    def invariants_of(name: str, result: ca.SX) -> ca.Function:
        return ca.Function(name, [t, x, u, p], [ca.densify(result)], [*"txup"], [name])

    discretes = len(system.flat.discretes)
    if m is None:
        none = ca.SX(0, 1)
        return ModeFunctions(
            0, 0, 0, 0, 0, False, function("mode_guards", none), function("decision", none), function("terms", none), invariants_of("mode_invariants", rows),
            masked("mode_projection", step), (), discretes,
        )  # fmt: skip
    size = [row.size for row in m.frictions]
    terms = ca.vertcat(ca.SX(0, 1), *(_NO_TERMS if row.one_way else row.terms for row in m.rows if row.one_sided))
    if m.index is not None:
        terms = ca.vertcat(-ca.fmax(m.index.terms, _LEAST), terms[m.valves :, :])  # of no gaps
    decided = ca.vertcat(_decided_by(m, space), system.mechanics.kinetic_energy(), _magnitudes(m), _pressures(m), _index(m))
    coming = Systems() if m.index is None else m.index.systems.with_operands(space.put)
    return ModeFunctions(
        m.one_sided, size.count(1), size.count(2), size.count(3), len(m.magnitudes.sizes), m.redundant,
        Staged.of("mode_guards", [t, x, u, p], [ca.densify(space.put(m.guards))], systems, fold=False),
        Staged.of("decision", [t, x, u, p], [ca.densify(space.put(decided))], coming, fold=False),
        function("terms", terms),
        invariants_of("mode_invariants", rows), masked("mode_projection", step), tuple(row.part.where for row in m.rows), discretes, valves=m.valves,
    )  # fmt: skip


def _decided_by(m: Modes, space: StateSpace) -> ca.SX:
    """The column that modes.h reads."""
    limits = [part for limit in _limits(m) for part in _linear(m, limit)]
    bounce = ca.vertcat(ca.SX(0, 1), *(row.restitution for row in m.rows if row.restitution is not None))
    response = ca.horzcat(*(space.kept(m.response[:, k]) for k in range(m.reactions.numel())))
    _, response = _linear(m, response @ m.reactions)
    kind = ca.SX([row.impact + (_NO_GAP if row.one_way and k >= m.valves else 0) for k, row in enumerate(m.rows[: m.one_sided])])
    back = ca.vertcat(ca.SX(0, 1), *(row.back for row in m.frictions))
    free, compliance = _linear(m, (m.free + m.compliance @ m.reactions)[m.valves :, :])
    if m.index is not None:
        free, compliance = ca.vertcat(m.index.free, free), ca.vertcat(ca.vec(m.index.compliance.T), compliance)
    parts = [m.gaps, m.rate, free, compliance, response, *limits, kind, back, bounce]
    return ca.vertcat(*(ca.densify(part) for part in parts))


def _linear(m: Modes, value: ca.SX) -> tuple[ca.SX, ca.SX]:
    """What is linear in reactions and magnitudes, without any, and by reactions, row by row; with those of valves as the others ask for them in the mode."""
    if m.index is not None:
        value = ca.substitute(value, m.reactions[: m.valves, :], m.index.solved)
    unknown = ca.vertcat(m.reactions, m.magnitudes.symbols)
    return ca.substitute(value, unknown, ca.SX.zeros(unknown.numel())), ca.vec(ca.jacobian(value, m.reactions).T)


def _limits(m: Modes) -> tuple[ca.SX, ca.SX]:
    """Of sticking and of sliding."""
    columns = ([row.holding for row in m.frictions], [row.sliding for row in m.frictions])
    holding, sliding = (ca.vertcat(ca.SX(0, 1), *(entry for entry in column if entry is not None)) for column in columns)
    return holding, sliding


def _magnitudes(m: Modes) -> ca.SX:
    """The rest of that column: forces (3 each), without reactions and by them, and limits by magnitudes."""
    if not m.magnitudes.sizes:
        return ca.SX(0, 1)
    forces = ca.vertcat(*(ca.vertcat(size.of, ca.SX.zeros(3 - size.of.numel())) for size in m.magnitudes.sizes))
    parts = [*_linear(m, forces)]
    parts += [ca.vec(ca.jacobian(limit, m.magnitudes.symbols).T) for limit in _limits(m)]
    return ca.vertcat(*(ca.densify(part) for part in parts))


def _index(m: Modes) -> ca.SX:
    """What holds by reactions, and its rates; see runtime/index.h."""
    return ca.SX(0, 1) if m.index is None else ca.vertcat(ca.vec(m.index.values.T), ca.vec(m.index.rates.T))


def _pressures(m: Modes) -> ca.SX:
    """What patches press with, by number."""
    return ca.vertcat(ca.SX(0, 1), *(row.pressure.value for row in m.frictions if row.pressure is not None))
