"""Scalar domains and mechanics together: efforts at flanges become joint forces, joints' motion moves the flanges."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from acausal.dynamics.kernels import solve_positive
from acausal.dynamics.system import MechanicalSystem
from acausal.errors import LockedError
from acausal.language.connector import Connector
from acausal.language.expression import Symbol, Variable, time
from acausal.loops.loops import relative_pose
from acausal.parts.joint import AbstractJoint
from acausal.scalar.collection import Collection, Flange, collect, has_scalar_parts
from acausal.scalar.diagnosis import no_rate
from acausal.scalar.equations import ScalarEquation
from acausal.scalar.reduction import ReducedEquations, algebraic_rates, reduce_equations
from acausal.scalar.solution import AlgebraicBlock


@dataclass(frozen=True)
class Driven:
    """A connected flange of a joint: its coordinate and the rate of it in q, v, t; `row` (1, nv) turns velocities into the rate."""

    connector: Connector
    position: ca.SX
    velocity: ca.SX
    row: ca.SX
    name: str


@dataclass(frozen=True)
class ScalarPart:
    """What scalar domains add to a mechanical system, in t, q, v, the scalar states, u and p.

    `position` and `velocity`: invariants, those that hold for q alone and all others. `correction`: (dq, dv, dstates), one Newton
    step towards both. `tau` (nv, 1): joint forces. `holding`: the equations that hold joints' velocities, in words.
    """

    states: tuple[Symbol, ...]
    rates: ca.SX
    solved: dict[Symbol, ca.SX]
    tau: ca.SX
    position: ca.SX
    velocity: ca.SX
    correction: tuple[ca.SX, ca.SX, ca.SX] | None
    holding: tuple[str, ...] = ()
    names: dict[Symbol, str] = field(default_factory=dict)

    @property
    def rows(self) -> int:
        """Number of freedoms of the joints that scalar equations take."""
        return len(self.holding)

    @property
    def start(self) -> list[float]:
        """Where the search for the states begins; 0 unless the variable says otherwise."""
        found = [s.start if isinstance(s, Variable) else None for s in self.states]
        return [0.0 if s is None else float(s[0]) if isinstance(s, Sequence) else float(s) for s in found]


def add_scalar_domains(mechanics: MechanicalSystem, tau: ca.SX, v_dot: ca.SX) -> ScalarPart:
    """Reduces the scalar equations of a scene. `v_dot` (nv, 1) depends on the joint forces, whose symbol is `tau` (nv, 1).

    Where efforts depend on the joints' own accelerations (a rotor geared to a joint), they are affine in them, and the accelerations
    are affine in the efforts: both together are one linear block. Raises the errors of `reduce_equations`.
    """
    if not has_scalar_parts(mechanics.flat):
        none = ca.SX(0, 1)
        return ScalarPart((), none, {}, ca.SX.zeros(tau.numel()), none, none, None)
    driven = _driven(mechanics)
    collection = collect(mechanics.flat, [(d.connector, d.name) for d in driven])
    return _Coupling(mechanics, tau, v_dot, driven, collection, reduce_equations(collection.system)).result()


@dataclass(frozen=True)
class _Coupling:
    mechanics: MechanicalSystem
    tau: ca.SX
    v_dot: ca.SX
    driven: tuple[Driven, ...]
    collection: Collection
    reduced: ReducedEquations

    def result(self) -> ScalarPart:
        flanges, values = self.collection.flanges, self.reduced.values
        tau = self._joint_forces(self._resolved([values[f.effort.element_hash()] for f in flanges]))
        second = [(f.acceleration, _put([(self.tau, tau)], [self._second(d)])[0]) for f, d in self._pairs]
        residuals = [b.residual for b in self.reduced.algebraic]
        everything = _put(second, self._resolved([*self.reduced.rates, *values.values(), *residuals]))
        n, m = len(self.reduced.rates), len(values)
        rates, residuals = everything[:n], everything[n + m :]
        solved = dict(zip(values, everything[n : n + m], strict=True))
        invariants = self._invariants()
        states = [*self.reduced.states, *(u for b in self.reduced.algebraic for u in b.unknowns)]
        symbols = tuple(self.collection.symbol_of(u) for u in states)
        return ScalarPart(
            symbols, ca.vertcat(ca.SX(0, 1), *self._with_algebraic(rates, residuals, tau)), self._solved(solved), tau,
            ca.vertcat(ca.SX(0, 1), *(i.residual for i in invariants if i.by_q)),
            ca.vertcat(ca.SX(0, 1), *(i.residual for i in invariants if not i.by_q), *residuals),
            self._correction(symbols, invariants, residuals), tuple(str(i.source) for i in invariants if i.of_joints and not i.by_q), self.collection.names,
        )  # fmt: skip

    @property
    def _pairs(self) -> list[tuple[Flange, Driven]]:
        return list(zip(self.collection.flanges, self.driven, strict=True))

    @functools.cached_property
    def _motion(self) -> list[tuple[ca.SX, ca.SX]]:
        """Coordinates of flanges and their rates, by those of joints."""
        return [(f.position, d.position) for f, d in self._pairs] + [(f.velocity, d.velocity) for f, d in self._pairs]

    def _resolved(self, expressions: Sequence[ca.SX]) -> list[ca.SX]:
        """With the mechanics put in, but for accelerations that stay symbols."""
        used = {s.element_hash() for e in expressions for s in ca.symvar(e)}
        opaque = any(s.element_hash() in used for f in self.collection.flanges for s in (f.bias, *ca.vertsplit(f.flexibility.T)))
        return _put(self._motion + (self._response if opaque else []), expressions)

    def _joint_forces(self, efforts: Sequence[ca.SX]) -> ca.SX:
        if not efforts:
            return ca.SX.zeros(self.tau.numel())
        return ca.densify(ca.vertcat(*(d.row for d in self.driven)).T @ ca.vertcat(*efforts))

    def _second(self, driven: Driven) -> ca.SX:
        return self.mechanics.kinematics.rate(driven.velocity) + ca.jtimes(driven.velocity, self.mechanics.tree.v, self.v_dot)

    @functools.cached_property
    def _flexibility(self) -> ca.SX:
        """v' (nv, n) for a unit effort at each flange, loops kept closed."""
        return ca.jacobian(self.v_dot, self.tau) @ ca.vertcat(*(d.row for d in self.driven)).T

    @functools.cached_property
    def _response(self) -> list[tuple[ca.SX, ca.SX]]:
        """Bias and flexibility of the flanges' accelerations."""
        none = ca.SX.zeros(self.tau.numel())
        found: list[tuple[ca.SX, ca.SX]] = []
        for flange, driven in self._pairs:
            found.append((flange.bias, ca.substitute(self._second(driven), self.tau, none)))
            found.append((flange.flexibility, ca.densify(driven.row @ self._flexibility)))
        return found

    def _with_algebraic(self, rates: list[ca.SX], residuals: list[ca.SX], tau: ca.SX) -> list[ca.SX]:
        """Rates of scalar states, followed by those of the unknowns of nonlinear blocks."""
        tree = self.mechanics.tree
        if not residuals:
            return rates
        symbols = [time.sx, tree.q, tree.v, *(u.symbol for u in self.reduced.states)]
        known = [ca.SX(1), tree.rates, _put([(self.tau, tau)], [self.v_dot])[0], *rates]
        result = list(rates)
        inputs = {entry.sx.element_hash() for entry in self.mechanics.flat.inputs}
        for block, residual in zip(self.reduced.algebraic, residuals, strict=True):
            for symbol in ca.symvar(residual):
                if symbol.element_hash() in inputs:
                    raise no_rate(self.collection.system, symbol, block.sources[0])
            z_dot = algebraic_rates(AlgebraicBlock(block.unknowns, residual, block.sources), symbols, known)
            symbols += [u.symbol for u in block.unknowns]
            known += [z_dot[k] for k in range(len(block.unknowns))]
            result.append(z_dot)
        return result

    def _solved(self, values: dict[int, ca.SX]) -> dict[Symbol, ca.SX]:
        found: dict[Symbol, ca.SX] = {}
        for symbol, scalars in self.collection.elements.items():
            entries = [values[s.sx.element_hash()] for s in scalars if s.sx.element_hash() in values]
            if len(entries) == len(scalars):
                found[symbol] = ca.vertcat(*entries)
        return found

    def _invariants(self) -> list[_Kept]:
        found: list[_Kept] = []
        velocities = ca.vertcat(ca.SX(0, 1), *(f.velocity for f in self.collection.flanges))
        for invariant, residual in zip(
            self.reduced.invariants, self._resolved([i.residual for i in self.reduced.invariants]), strict=True
        ):
            by_q = invariant.outer and not _depends(residual, self.mechanics.tree.v)
            slope = self._resolved([ca.jacobian(invariant.residual, velocities)])[0]
            found.append(_Kept(residual, invariant.states, invariant.outer, by_q, slope, invariant.source))
        return found

    def _correction(
        self, states: Sequence[Symbol], invariants: Sequence[_Kept], residuals: Sequence[ca.SX]
    ) -> tuple[ca.SX, ca.SX, ca.SX] | None:
        """One Newton step: joints in the mass metric, scalar states by the least change, unknowns of nonlinear blocks as they must."""
        if not invariants and not residuals:
            return None
        dq, dv = self._joint_correction(invariants)
        step = ca.SX.zeros(len(states))
        place = {s.sx.element_hash(): k for k, s in enumerate(states)}
        groups = [([u.symbol for u in b.unknowns], [r]) for b, r in zip(self.reduced.algebraic, residuals, strict=True)]
        groups += _groups([(list(i.states), i.residual) for i in invariants if not i.of_joints])
        for symbols, rows in groups:
            h, y = ca.vertcat(*rows), ca.vertcat(*symbols)
            H = ca.densify(ca.jacobian(h, y))
            found = -(ca.solve(H, h) if h.numel() == y.numel() else H.T @ solve_positive(ca.densify(H @ H.T), h))
            for k, symbol in enumerate(symbols):
                step[place[symbol.element_hash()]] += found[k]
        return dq, dv, step

    def _joint_correction(self, invariants: Sequence[_Kept]) -> tuple[ca.SX, ca.SX]:
        """(dq, dv): W = M^-1 J', steps -W (J W)^-1 residual."""
        tree = self.mechanics.tree
        rates = [i for i in invariants if i.of_joints and not i.by_q]
        if not rates:
            return ca.SX.zeros(tree.q.numel()), ca.SX.zeros(tree.v.numel())
        C = ca.vertcat(*(i.slope for i in rates))
        W = self._flexibility @ C.T
        D = ca.densify(C @ ca.vertcat(*(d.row for d in self.driven)) @ W)
        if any(D[k, k].is_zero() for k in range(D.shape[0])):
            raise LockedError(
                f"The equations {', '.join(str(i.source) for i in rates[:4])} hold joints that loops hold already. Remove one of them."
            )
        dv = -(W @ solve_positive(D, ca.vertcat(*(i.residual for i in rates))))
        gaps = {id(i.source): i.residual for i in invariants if i.by_q}
        both = [k for k, i in enumerate(rates) if id(i.source) in gaps]
        if not both:
            return ca.SX.zeros(tree.q.numel()), dv
        W, D = W[:, both], D[both, both]
        moved = W @ solve_positive(D, ca.vertcat(*(gaps[id(rates[k].source)] for k in both)))
        return -(ca.jacobian(tree.rates, tree.v) @ moved), dv


@dataclass(frozen=True)
class _Kept:
    """An invariant in t, q, v, scalar states, p. `slope` (1, n): by the flanges' velocities; `by_q`: without velocities."""

    residual: ca.SX
    states: tuple[ca.SX, ...]
    of_joints: bool
    by_q: bool
    slope: ca.SX
    source: ScalarEquation


def _has(residual: ca.SX, symbols: Sequence[ca.SX]) -> bool:
    keys = {s.element_hash() for s in symbols}
    return any(s.element_hash() in keys for s in ca.symvar(residual))


def _depends(expression: ca.SX, column: ca.SX) -> bool:
    return _has(expression, [column[i] for i in range(column.numel())])


def _put(pairs: Sequence[tuple[ca.SX, ca.SX]], expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """Expressions with values put in for symbols."""
    pairs = [pair for pair in pairs if pair[0].numel()]
    if not pairs or not expressions:
        return list(expressions)
    return ca.substitute(list(expressions), [s for s, _ in pairs], [value for _, value in pairs])


def _groups(rows: Sequence[tuple[list[ca.SX], ca.SX]]) -> list[tuple[list[ca.SX], list[ca.SX]]]:
    """Rows that share symbols, together."""
    import networkx as nx

    graph: nx.Graph[tuple[str, int]] = nx.Graph()
    symbols: dict[int, ca.SX] = {}
    for k, (own, _) in enumerate(rows):
        graph.add_node(("row", k))
        for symbol in own:
            symbols[symbol.element_hash()] = symbol
            graph.add_edge(("row", k), ("symbol", symbol.element_hash()))
    found: list[tuple[list[ca.SX], list[ca.SX]]] = []
    for group in nx.connected_components(graph):
        own = [symbol for key, symbol in symbols.items() if ("symbol", key) in group]
        found.append((own, [row for k, (_, row) in enumerate(rows) if ("row", k) in group]))
    return found


def _driven(mechanics: MechanicalSystem) -> tuple[Driven, ...]:
    """Connected flanges of joints."""
    connected = {c for group in mechanics.flat.connection_sets if len(group) > 1 for c in group}
    found: list[Driven] = []
    tree = mechanics.tree
    held: list[tuple[str, AbstractJoint, ca.SX, ca.SX]] = [
        (item.edge.name, item.edge.joint, tree.q[item.q], tree.v[item.v]) for item in tree.joints
    ]
    for cut in mechanics.mechanism.cuts:
        if isinstance(cut.joint, AbstractJoint) and getattr(cut.joint, "flange", None) in connected:
            q = cut.joint.coordinates(relative_pose(cut, mechanics.placement))
            assert q is not None
            held.append((cut.name, cut.joint, q, mechanics.kinematics.rate(q)))
    for name, joint, q, v in held:
        flange = getattr(joint, "flange", None)
        if flange is not None and flange in connected:
            found.append(Driven(flange, q, v, ca.jacobian(v, tree.v), name))
    return tuple(found)
