"""Modes of a reduced system as functions of numbers, in the states that are integrated."""

from __future__ import annotations

import casadi as ca

from acausal.collocation.modes import ModeFunctions
from acausal.numerics.folding import folded_function
from acausal.reduce.modes import Modes
from acausal.reduce.reduce import ReducedSystem
from acausal.reduce.state_space import StateSpace


def mode_functions(
    m: Modes, system: ReducedSystem, space: StateSpace, invariants: ca.Function | None, projection: ca.Function | None
) -> ModeFunctions:
    """`invariants` and `projection`: of what holds in all modes."""
    t, x, u, p = space.arguments
    masks = ca.vertcat(*(mask.sx for mask in m.masks))
    rows = ca.SX(0, 1) if invariants is None else invariants(t, x, p)
    step = x if projection is None else projection(t, x, p)
    rows, step = ca.vertcat(rows, space.put(m.invariants)), step + space.put(space.kept(m.correction))

    def function(name: str, result: ca.SX) -> ca.Function:
        return folded_function(name, [t, x, u, p], [ca.densify(space.put(result))], ["t", "x", "u", "p"], [name])

    def masked(name: str, result: ca.SX) -> ca.Function:
        return folded_function(name, [t, x, masks, p], [ca.densify(result)], ["t", "x", "masks", "p"], [name])

    size = [row.size for row in m.frictions]
    return ModeFunctions(
        m.one_sided, size.count(1), size.count(2), m.redundant, function("mode_guards", m.guards), function("decision", ca.vertcat(_decided_by(m, space), system.mechanics.kinetic_energy())),
        masked("mode_invariants", rows), masked("mode_projection", step), tuple(row.part.where for row in m.rows),
    )  # fmt: skip


def _decided_by(m: Modes, space: StateSpace) -> ca.SX:
    """The column that modes.h reads."""
    n = m.reactions.numel()
    none = ca.SX.zeros(n)
    limits: list[ca.SX] = []
    for column in ([row.holding for row in m.frictions], [row.sliding for row in m.frictions]):
        limit = ca.vertcat(ca.SX(0, 1), *(entry for entry in column if entry is not None))
        limits += [ca.substitute(limit, m.reactions, none), ca.vec(ca.jacobian(limit, m.reactions).T)]
    bounce = ca.vertcat(ca.SX(0, 1), *(row.restitution for row in m.rows if row.restitution is not None))
    response = ca.horzcat(*(space.kept(m.response[:, k]) for k in range(n)))
    parts = [m.gaps, m.rate, m.free, ca.vec(m.compliance.T), ca.vec(response.T), *limits, bounce]
    return ca.vertcat(*(ca.densify(part) for part in parts))
