"""Scalar domains and mechanics together: efforts at flanges become joint forces, joints' motion moves the flanges."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from acausal.dynamics.system import MechanicalSystem
from acausal.language.connector import Connector
from acausal.language.equation import input_rates
from acausal.language.expression import Mode, Reaction, Symbol, Variable, time
from acausal.loops.loops import relative_pose
from acausal.numerics.elimination import solved_by_qr
from acausal.parts.joint import AbstractJoint
from acausal.parts.span import AbstractSpan
from acausal.scalar.collection import Collection as Collected
from acausal.scalar.collection import Flange, collect, has_scalar_parts
from acausal.scalar.diagnosis import no_rate
from acausal.scalar.equations import EquationSet, ScalarEquation, symbols_in
from acausal.scalar.reduction import Invariant, ReducedEquations, algebraic_rates, reduce_equations
from acausal.scalar.redundancy import needed, without_efforts
from acausal.scalar.solution import LinearBlock


@dataclass(frozen=True)
class Driven:
    """A connected flange of a joint: its coordinate and the rate of it in q, v, t; `row` (1, nv) turns velocities into the rate."""

    connector: Connector
    position: ca.SX
    velocity: ca.SX
    row: ca.SX
    name: str


@dataclass(frozen=True)
class Held:
    """One scalar equation, or a derivative of it, that is kept as an invariant: its `residual` in t, x and p, and what it is called.

    `depth`: 1 among velocities, 2 and more among positions. `number`: of the equation, below -1 of what joints of the tree say; its derivatives share it. `of_joints`: without
    scalar states. `of_inputs`: with inputs. `equation`: its place among the scene's scalar equations.
    """

    residual: ca.SX
    depth: int
    number: int
    of_joints: bool
    of_inputs: bool
    name: str
    equation: int = -1

    @property
    def is_coordinate(self) -> bool:
        """Whether a joint of the tree says so of a coordinate of its own that is the value of an input, or its rate."""
        return self.number < -1


@dataclass(frozen=True)
class Untorn:
    """A nonlinear block as it was written: 0 = `rows` (n, 1) in its `unknowns` (n, 1), t, q, v, the scalar states, u and p.

    `start` (n,): where a search for them begins. `torn`: places among the unknowns of those that are states, and among the scalar states.
    """

    unknowns: ca.SX
    rows: ca.SX
    start: tuple[float, ...]
    torn: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class ScalarPart:
    """What scalar domains add to a mechanical system, in t, q, v, the scalar states, u and p.

    `states`: first the `positions` that equations tie to coordinates of joints or to one another, without velocities. `held`: the invariants, those
    of positions first; `residuals`: of nonlinear blocks. `correction`: (dq, dv, dstates), one Newton step towards them. `tau` (nv, 1): joint
    forces. `blocks`: the linear blocks that were solved.
    `redundant`: equations between positions that follow from others. `looped`: those that follow from closed loops of joints, where these are
    assembled as the equations say; what they would transmit is zero.
    """

    states: tuple[Symbol, ...]
    positions: int
    rates: ca.SX
    solved: dict[Symbol, ca.SX]
    tau: ca.SX
    held: tuple[Held, ...] = ()
    residuals: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    correction: tuple[ca.SX, ca.SX, ca.SX] | None = None
    blocks: tuple[LinearBlock, ...] = ()
    redundant: tuple[Held, ...] = ()
    looped: tuple[Held, ...] = ()
    names: dict[Symbol, str] = field(default_factory=dict)
    led: Callable[[ca.SX], ca.SX] | None = None
    """Joint forces by accelerations (nv, 1), where these are known and nothing has to yield; not finite where efforts follow from what yields."""
    followers: frozenset[int] = frozenset()
    """Places of the states that nonlinear equations give by the others."""
    untorn: tuple[Untorn, ...] = ()
    """The blocks of these equations."""
    yielding: frozenset[Symbol] = frozenset()
    """Those of `solved` that follow from what the mechanics yield: efforts that accelerations depend on, and accelerations. Their values are as long as the dynamics."""

    @property
    def position(self) -> ca.SX:
        """Invariants of coordinates and scalar positions (n, 1)."""
        return ca.vertcat(ca.SX(0, 1), *(h.residual for h in self.held if h.depth > 1))

    @property
    def closing(self) -> ca.SX:
        """What is met when positions are assembled (n, 1): invariants, and equations that loops hold from there on."""
        return ca.vertcat(self.position, *(h.residual for h in self.looped))

    @property
    def velocity(self) -> ca.SX:
        """All other invariants (n, 1)."""
        return ca.vertcat(ca.SX(0, 1), *(h.residual for h in self.held if h.depth == 1), self.residuals)

    @property
    def of_inputs(self) -> bool:
        """Whether inputs prescribe something."""
        return any(h.of_inputs for h in self.held)

    @property
    def start(self) -> list[float]:
        """Where the search for the states begins; 0 unless the variable says otherwise."""
        found = [s.start if isinstance(s, Variable) else None for s in self.states]
        return [0.0 if s is None else float(s[0]) if isinstance(s, Sequence) else float(s) for s in found]


def add_scalar_domains(
    mechanics: MechanicalSystem,
    tau: ca.SX,
    v_dot: ca.SX,
    values: np.ndarray,
    closing: tuple[ca.SX, ca.SX] | None = None,
    looped: Collection[int] = (),
) -> ScalarPart:
    """Reduces the scalar equations of a scene. `v_dot` (nv, 1) depends on the joint forces, whose symbol is `tau` (nv, 1). `values` (np,): of the
    parameters, by which pivots are chosen.

    `closing`: (dq, dv), one step towards closed loops. `looped`: places of equations that loops hold already. Where efforts depend on the joints' own accelerations (a rotor geared to a joint), they
    are affine in them, and the accelerations are affine in the efforts: both together are one linear block. Raises the errors of
    `reduce_equations`.
    """
    if not has_scalar_parts(mechanics.flat):
        return ScalarPart((), 0, ca.SX(0, 1), {}, ca.SX.zeros(tau.numel()))
    driven = _driven(mechanics)
    collection = collect(mechanics.flat, [(d.connector, d.name) for d in driven], values, mechanics.readings)
    kept = needed(collection.system, collection.efforts, collection.positions)
    free = without_efforts(kept.system, looped, collection.efforts)
    reduced, dropped = reduce_equations(free), tuple(kept.system.equations[k] for k in looped)
    return _Coupling(mechanics, tau, v_dot, closing, driven, collection, free, reduced, kept.redundant, dropped).result()


@dataclass(frozen=True)
class _Coupling:
    mechanics: MechanicalSystem
    tau: ca.SX
    v_dot: ca.SX
    closing: tuple[ca.SX, ca.SX] | None
    driven: tuple[Driven, ...]
    collection: Collected
    system: EquationSet
    reduced: ReducedEquations
    redundant: tuple[ScalarEquation, ...]
    looped: tuple[ScalarEquation, ...]

    def result(self) -> ScalarPart:
        values, blocks = self.reduced.values, self.reduced.algebraic
        tau = self._joint_forces(self._at_rest(self._efforts))
        second = [(f.acceleration, _put([(self.tau, tau)], [self._second(d)])[0]) for f, d in self._pairs]
        everything = _put(
            second,
            self._at_rest(
                self._resolved([*self.reduced.rates, *values.values(), *(b.residual for b in blocks), *(b.rows for b in blocks)])
            ),
        )
        n, m = len(self.reduced.rates), len(values)
        rates, residuals = everything[:n], everything[n + m : n + m + len(blocks)]
        solved = dict(zip(values, everything[n : n + m], strict=True))
        held = self._held()
        states = [*self.reduced.states, *(u for b in blocks for u in b.unknowns)]
        symbols = [self.collection.symbol_of(u) for u in states]
        rated = ca.vertcat(ca.SX(0, 1), *self._with_algebraic(rates, residuals, tau))
        dq, dv, step = self._correction([one for _, one in held], residuals, second)
        tied = {s.element_hash() for invariant, one in held if one.depth > 1 for s in invariant.states}
        place, n_states = self.collection.declared, len(self.reduced.states)
        keys = [u.symbol.element_hash() for u in states]
        order = sorted(range(len(states)), key=lambda k: (keys[k] not in tied, k >= n_states, place.get(keys[k], len(place))))
        return ScalarPart(
            tuple(symbols[k] for k in order), len(tied), rated[order], self._solved(solved), tau,
            tuple(sorted((one for _, one in held), key=lambda one: one.depth == 1)), ca.vertcat(ca.SX(0, 1), *residuals),
            (dq, dv, step[order]) if held or residuals else None, self.reduced.blocks, self._followers(self.redundant),
            self._followers(self.looped), self.collection.names, self._led,
            frozenset(place for place, k in enumerate(order) if k >= n_states),
            self._untorn(everything[n + m + len(blocks) :], {keys[k]: place for place, k in enumerate(order)}),
            self._yielding(),
        )  # fmt: skip

    def _yielding(self) -> frozenset[Symbol]:
        told = [s for f in self.collection.flanges for s in (f.acceleration, f.bias, *ca.vertsplit(f.flexibility.T))]
        if not told:
            return frozenset()
        symbols, values = ca.vertcat(*told), self.reduced.values
        found = {key for key, value in values.items() if ca.depends_on(value, symbols)}
        return frozenset(
            symbol for symbol, scalars in self.collection.elements.items() if found & {s.sx.element_hash() for s in scalars}
        )

    def _untorn(self, rows: Sequence[ca.SX], places: Mapping[int, int]) -> tuple[Untorn, ...]:
        """`places`: of scalar states, by element hash."""
        found: list[Untorn] = []
        for block, written in zip(self.reduced.algebraic, rows, strict=True):
            symbols = [u.symbol for u in block.whole]
            torn = {u.symbol.element_hash() for u in block.unknowns}
            pairs = [(k, places[s.element_hash()]) for k, s in enumerate(symbols) if s.element_hash() in torn]
            start = tuple(0.0 if u.start is None else u.start for u in block.whole)
            found.append(Untorn(ca.vertcat(*symbols), written, start, tuple(pairs)))
        return tuple(found)

    @property
    def _pairs(self) -> list[tuple[Flange, Driven]]:
        return list(zip(self.collection.flanges, self.driven, strict=True))

    @functools.cached_property
    def _motion(self) -> list[tuple[ca.SX, ca.SX]]:
        """Coordinates of flanges and their rates, by those of joints."""
        return [(f.position, d.position) for f, d in self._pairs] + [(f.velocity, d.velocity) for f, d in self._pairs]

    @functools.cached_property
    def _efforts(self) -> list[ca.SX]:
        """At the flanges; pushes of the invariants are in them."""
        return self._resolved(self._opaque_efforts)

    @property
    def _opaque_efforts(self) -> list[ca.SX]:
        return [self.reduced.values[f.effort.element_hash()] for f in self.collection.flanges]

    @functools.cached_property
    def _pushes(self) -> ca.SX:
        """One for each constraint that has invariants."""
        found = {i.push.element_hash(): i.push for i in self.reduced.invariants}
        return ca.vertcat(ca.SX(0, 1), *found.values())

    def _at_rest(self, expressions: Sequence[ca.SX]) -> list[ca.SX]:
        """Without pushes, as in a motion."""
        return _put([(self._pushes, ca.SX.zeros(self._pushes.numel()))], expressions)

    def _resolved(self, expressions: Sequence[ca.SX]) -> list[ca.SX]:
        """With the mechanics put in, but for accelerations that stay symbols."""
        used = symbols_in(expressions)
        opaque = any(s.element_hash() in used for f in self.collection.flanges for s in (f.bias, *ca.vertsplit(f.flexibility.T)))
        return _put(self._motion + (self._response if opaque else []), expressions)

    def _joint_forces(self, efforts: Sequence[ca.SX]) -> ca.SX:
        if not efforts:
            return ca.SX.zeros(self.tau.numel())
        return ca.densify(ca.vertcat(*(d.row for d in self.driven)).T @ ca.vertcat(*efforts))

    def _led(self, v_dot: ca.SX) -> ca.SX:
        """Nothing yields to efforts where accelerations are given: each flange has that which it is given, and no flexibility."""
        known = [pair for f, d in self._pairs for pair in ((f.bias, self._second(d, v_dot)), (f.flexibility, 0 * f.flexibility))]
        return self._joint_forces(self._at_rest(_put(self._motion + known, self._opaque_efforts)))

    def _second(self, driven: Driven, v_dot: ca.SX | None = None) -> ca.SX:
        along = self.v_dot if v_dot is None else v_dot
        return self.mechanics.kinematics.rate(driven.velocity) + ca.jtimes(driven.velocity, self.mechanics.tree.v, along)

    @functools.cached_property
    def _flexibility(self) -> ca.SX:
        """v' (nv, n) for a unit effort at each flange, loops kept closed."""
        if not self.driven:
            return ca.SX(self.v_dot.numel(), 0)
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
        used = symbols_in(residuals)
        chains = [(entry, *input_rates(entry)) for entry in self.mechanics.flat.inputs if not isinstance(entry, Reaction | Mode)]
        led = [(s.sx, rate.sx) for chain in chains for s, rate in itertools.pairwise(chain) if s.sx.element_hash() in used]
        symbols = [time.sx, tree.q, tree.v, *(u.symbol for u in self.reduced.states), *(s for s, _ in led)]
        known = [ca.SX(1), tree.rates, _put([(self.tau, tau)], [self.v_dot])[0], *rates, *(rate for _, rate in led)]
        result = list(rates)
        unrated = {entry.sx.element_hash() for entry in self.mechanics.flat.inputs if isinstance(entry, Reaction | Mode)}
        unrated |= {rate.sx.element_hash() for *_, rate in chains}
        unrated |= {s.element_hash() for read in self.mechanics.readings.implicit for s in ca.symvar(read.sx)}
        for block, residual in zip(self.reduced.algebraic, residuals, strict=True):
            for symbol in ca.symvar(residual):
                if symbol.element_hash() in unrated:
                    raise no_rate(self.collection.system, symbol, block.sources[0])
            z_dot = algebraic_rates(replace(block, residual=residual), symbols, known)
            symbols += [u.symbol for u in block.unknowns]
            known += [z_dot[k] for k in range(len(block.unknowns))]
            result.append(z_dot)
        return result

    def _solved(self, values: dict[int, ca.SX]) -> dict[Symbol, ca.SX]:
        """Of variables, and of the entries of those that are columns, by which states are called."""
        found: dict[Symbol, ca.SX] = {}
        for symbol, scalars in self.collection.elements.items():
            entries = {s: values[s.sx.element_hash()] for s in scalars if s.sx.element_hash() in values}
            if len(entries) == len(scalars):
                found.update(entries)
                found[symbol] = ca.vertcat(*entries.values())
        return found

    def _held(self) -> list[tuple[Invariant, Held]]:
        residuals = self._resolved([i.residual for i in self.reduced.invariants])
        place = {push.element_hash(): k for k, push in enumerate(ca.vertsplit(self._pushes))} if residuals else {}
        return [
            (i, self._held_as(i, residual, place[i.push.element_hash()]))
            for i, residual in zip(self.reduced.invariants, residuals, strict=True)
        ]

    def _followers(self, equations: Sequence[ScalarEquation]) -> tuple[Held, ...]:
        """Equations that follow from others, in states."""
        residuals = [equation.residual for equation in equations]
        values = [(s, self.reduced.values[key]) for key, s in symbols_in(residuals).items() if key in self.reduced.values]
        found = self._at_rest(self._resolved(_put(values, residuals)))
        return tuple(Held(r, 2, -1, True, False, str(e)) for r, e in zip(found, equations, strict=True))

    def _held_as(self, i: Invariant, residual: ca.SX, number: int) -> Held:
        inputs = {s.sx.element_hash() for entry in self.mechanics.flat.inputs for s in (entry, *input_rates(entry))}
        of_inputs = any(s.element_hash() in inputs for s in ca.symvar(residual))
        return Held(residual, i.depth, number, not i.states, of_inputs, str(i.source), self._places[id(i.source)])

    @functools.cached_property
    def _places(self) -> dict[int, int]:
        return {id(equation): k for k, equation in enumerate(self.system.equations)}

    def _correction(
        self, held: Sequence[Held], residuals: Sequence[ca.SX], second: list[tuple[ca.SX, ca.SX]]
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        """One Newton step towards the invariants and to the unknowns of nonlinear blocks as they must be.

        The dynamics themselves say how: a push p on the right-hand side of a constraint's highest form, g'' = p, changes accelerations by R p
        along the forces that keep the constraint. With the same R, positions change by -R g and velocities by -R g', all other constraints
        and loops kept: no metric is chosen, and none depends on units.
        """
        tree, reduced = self.mechanics.tree, self.reduced
        dq, dv = self.closing or (ca.SX.zeros(tree.q.numel()), ca.SX.zeros(tree.v.numel()))
        moved = ca.vertcat(tree.q, tree.v), ca.vertcat(dq, dv)
        # loops are closed in the same step, which moves what scalar equations see of the joints
        gaps = [h.residual + ca.jtimes(h.residual, *moved) if self.closing else h.residual for h in held]
        of_v, of_states = self._pushed(second)

        def step(response: ca.SX, depth: int) -> ca.SX:
            found = [(h.number, gap) for h, gap in zip(held, gaps, strict=True) if h.depth == depth]
            return -(response[:, [k for k, _ in found]] @ ca.vertcat(ca.SX(0, 1), *(gap for _, gap in found)))

        change_q = ca.jacobian(tree.rates, tree.v) @ step(of_v, 2)
        change_v = step(of_v, 1)
        states = [u.symbol for u in reduced.states]
        changes = [step(of_states[k, :], depth) for k, depth in enumerate(reduced.depths)]
        known, changed = [tree.q, tree.v, *states], [dq + change_q, dv + change_v, *changes]
        for block, residual in zip(reduced.algebraic, residuals, strict=True):
            z = ca.vertcat(*(u.symbol for u in block.unknowns))
            left = residual + ca.jtimes(residual, ca.vertcat(*known), ca.vertcat(*changed))
            dz = -solved_by_qr(ca.densify(ca.jacobian(residual, z)), left)
            known, changed, changes = [*known, z], [*changed, dz], [*changes, dz]
        return ca.densify(change_q), ca.densify(change_v), ca.densify(ca.vertcat(ca.SX(0, 1), *changes))

    def _pushed(self, second: list[tuple[ca.SX, ca.SX]]) -> tuple[ca.SX, ca.SX]:
        """Changes of v' (nv, m) and of the states' highest derivatives (n, m) for unit pushes."""
        reduced, p = self.reduced, self._pushes
        flanges = self.collection.flanges
        accelerations = ca.vertcat(ca.SX(0, 1), *(f.acceleration for f in flanges))
        rows = ca.vertcat(ca.SX(0, self.mechanics.tree.v.numel()), *(d.row for d in self.driven))
        tops = ca.vertcat(ca.SX(0, 1), *self._resolved(reduced.tops))
        efforts = ca.vertcat(ca.SX(0, 1), *self._efforts)
        blocks = self._resolved([b.residual for b in reduced.algebraic])
        of_v = ca.SX(self.mechanics.tree.v.numel(), p.numel())
        z: list[tuple[ca.SX, ca.SX]] = []

        def response(expression: ca.SX) -> ca.SX:
            found = ca.jacobian(expression, p) + ca.jacobian(expression, accelerations) @ (rows @ of_v)
            for symbols, of_symbols in z:
                found += ca.jacobian(expression, symbols) @ of_symbols
            return found

        for _ in range(2 if blocks and p.numel() else 1):
            z.clear()
            for block, residual in zip(reduced.algebraic, blocks if p.numel() else [], strict=False):
                symbols = ca.vertcat(*(u.symbol for u in block.unknowns))
                z.append((symbols, -solved_by_qr(ca.densify(ca.jacobian(residual, symbols)), ca.densify(response(residual)))))
            of_v = self._flexibility @ response(efforts)
        found = _put(second, self._at_rest([of_v, response(tops)]))
        return found[0], found[1]


def _put(pairs: Sequence[tuple[ca.SX, ca.SX]], expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """Expressions with values put in for symbols."""
    pairs = [pair for pair in pairs if pair[0].numel()]
    if not pairs or not expressions:
        return list(expressions)
    return ca.substitute(list(expressions), [s for s, _ in pairs], [value for _, value in pairs])


def _driven(mechanics: MechanicalSystem) -> tuple[Driven, ...]:
    """Connected flanges of joints."""
    connected = {c for group in mechanics.flat.connection_sets if len(group) > 1 for c in group}
    found: list[Driven] = []
    tree = mechanics.tree
    held: list[tuple[str, AbstractJoint, ca.SX, ca.SX]] = [
        (item.edge.name, item.edge.joint, tree.q[item.q], tree.v[item.v]) for item in tree.joints
    ]
    for cut in mechanics.mechanism.cuts:
        if isinstance(cut.joint, AbstractJoint) and not connected.isdisjoint(cut.joint.flanges):
            q = cut.joint.coordinates(relative_pose(cut, mechanics.placement))
            assert q is not None
            held.append((cut.name, cut.joint, q, mechanics.kinematics.rate(q)))
    for cut in mechanics.mechanism.cuts:
        if isinstance(cut.joint, AbstractSpan) and cut.joint.flange in connected:
            q = cut.joint.coordinate(relative_pose(cut, mechanics.placement))
            v = mechanics.kinematics.rate(q)
            found.append(Driven(cut.joint.flange, q, v, ca.jacobian(v, tree.v), cut.name))
    for name, joint, q, v in held:
        found += [Driven(flange, q, v, ca.jacobian(v, tree.v), name) for flange in joint.flanges if flange in connected]
    return tuple(found)
