"""Outputs: any expression of a scene's variables and connectors, expressed by t, x, u and p. Nothing is computed unasked."""

from __future__ import annotations

import copy
import functools
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, replace
from inspect import ismethod
from typing import Any

import casadi as ca

from acausal.arguments import shown  # pyright: ignore[reportUnusedImport]  # users pass anything
from acausal.errors import ExpressionError, UnknownVariableError
from acausal.language.component import inflow, law_changes
from acausal.language.connector import Point, Quantity
from acausal.language.equation import input_rate
from acausal.language.expression import Derivative, Expression, Input, InputRate, Mode, Parameter, Reaction, Symbol, Time, sx
from acausal.loops.loops import relative_twist
from acausal.loops.reactions import Reactions
from acausal.parts.force import AbstractForce
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import symbolic
from acausal.reduce.motion import inputs_in
from acausal.reduce.reduce import ReducedSystem


@dataclass(frozen=True)
class Outputs:
    """Translates a user's expressions for one reduced system."""

    system: ReducedSystem

    def __reduce__(self) -> tuple[Any, ...]:
        return Outputs, (self.system,)

    def __deepcopy__(self, memo: dict[int, Any]) -> Outputs:
        system = copy.deepcopy(self.system, memo)
        return self if system is self.system else Outputs(system)

    @functools.cached_property
    def start_problems(self) -> dict[Hashable, Any]:
        """Searches for start values that have been made (see `acausal.start`), by variables and whether they are met exactly."""
        return {}

    @functools.cached_property
    def reactions(self) -> Reactions:
        """Flows at connectors, in symbols for what the dynamics and loops give."""
        return replace(self._reactions, borne=self.borne if self.borne.numel() else None)

    @functools.cached_property
    def _reactions(self) -> Reactions:
        r = self._open
        v_dot = self._rates[r.nq : r.nq + r.tree_velocities, :]
        return Reactions(r.mechanics, r.constraints, v_dot, self._multipliers, r.solved | self._by_yielding)

    @functools.cached_property
    def unmasked(self) -> Outputs:
        """Of the system in which reactions that hold as long as they can are symbols still; itself where there are none."""
        unmasked = self.system.unmasked
        return self if self.system.modes is None or unmasked is None else Outputs(unmasked)

    @property
    def _open(self) -> ReducedSystem:
        return self.unmasked.system

    @functools.cached_property
    def by_modes(self) -> tuple[ca.SX, ca.SX]:
        """Symbols (n, 1) of these, and what they stand for."""
        modes = self.system.modes
        if modes is None:
            return ca.SX(0, 1), ca.SX(0, 1)
        return modes.symbols, modes.with_dead(modes.found)

    @functools.cached_property
    def borne(self) -> ca.SX:
        """Symbols (n, 1) that may stand in what `shared` gives, for multipliers of all rows of loops with redundant constraints."""
        constraints = self.system.constraints
        several = constraints.redundant or constraints.vanishing
        return ca.SX.sym("borne", self._reactions.all_multipliers.numel() if several else 0)

    @functools.cached_property
    def given_by_loops(self) -> ca.SX:
        """What these stand for, in t, x, u, p, and symbols for what the dynamics give."""
        return ca.densify(self._reactions.balanced)

    @functools.cached_property
    def _rates(self) -> ca.SX:
        return ca.SX.sym("x_dot", self.system.x_dot.numel())

    @functools.cached_property
    def _multipliers(self) -> ca.SX:
        return ca.SX.sym("multipliers", self.system.multipliers.numel())

    @functools.cached_property
    def given_by_dynamics(self) -> tuple[ca.SX, ca.SX]:
        """Symbols (n, 1) that may stand in what `shared` gives, for rates of the states, multipliers of loops, reactions that hold as long as they can, and
        variables of scalar parts that follow from accelerations; and what they stand for."""
        s, (reactions, found) = self.system, self.by_modes
        symbols = ca.vertcat(self.rates_and_multipliers, reactions, self._yielding_symbols)
        return symbols, ca.densify(ca.vertcat(s.x_dot, s.multipliers, found, self.yielding))

    @property
    def rates_and_multipliers(self) -> ca.SX:
        """Those of these symbols that may stand in what `opened` gives, but for reactions that hold as long as they can."""
        return ca.vertcat(self._rates, self._multipliers)

    @functools.cached_property
    def _by_yielding(self) -> dict[Symbol, ca.SX]:
        """Symbols for variables of scalar parts that follow from what the mechanics yield."""
        solved, yielding = self.system.solved, self.system.scalar.yielding
        return {
            s: ca.SX.sym(self.name(s), *value.shape)
            for s, value in solved.items()
            if s in yielding and not isinstance(s, Reaction)
        }

    @property
    def yielding(self) -> ca.SX:
        """(n, 1): these."""
        return _column(self.system.solved[s] for s in self._by_yielding)

    @property
    def _yielding_symbols(self) -> ca.SX:
        return _column(self._by_yielding.values())

    def _solved(self, symbol: Symbol) -> ca.SX | None:
        """A variable that scalar equations give, None where they do not: in t, x, u, p, or a symbol for it."""
        return self._by_yielding.get(symbol, self._open.solved.get(symbol))

    def closed(self, expression: ca.SX) -> ca.SX:
        """An opened or shared expression in t, x, u and p."""
        symbols, values = self.given_by_dynamics
        expression = self._without_borne(expression)
        return ca.substitute(expression, symbols, values) if ca.depends_on(expression, symbols) else expression

    @functools.cached_property
    def _joint_symbols(self) -> dict[Symbol, tuple[AbstractJoint, str]]:
        """q and v of every joint, those of implicit joints included."""
        mechanics = self.system.mechanics
        cuts = [cut.joint for cut in mechanics.mechanism.cuts]
        joints = [item.edge.joint for item in mechanics.tree.joints] + [j for j in cuts if isinstance(j, AbstractJoint)]
        return {s: (j, kind) for j in joints for s, kind in ((j.q, "q"), (j.v, "v"))}

    def resolve(self, value: Expression | ca.SX | str) -> ca.SX:
        """The expression, or what a name stands for, in t, x, u and p. Raises `UnknownVariableError` for a variable of another scene."""
        return self.closed(self.shared(self.system.flat.named(value) if isinstance(value, str) else value))

    def opened(self, value: Expression | ca.SX) -> ca.SX:
        """The expression in t, x, u, p, and symbols for rates, multipliers and reactions. Raises `UnknownVariableError`."""
        found, symbols = self._without_borne(self.shared(value)), self._yielding_symbols
        if not symbols.numel() or not ca.depends_on(found, symbols):
            return found
        return ca.substitute(found, symbols, _column(self._open.solved[s] for s in self._by_yielding))

    def _without_borne(self, expression: ca.SX) -> ca.SX:
        if not self.borne.numel() or not ca.depends_on(expression, self.borne):
            return expression
        return ca.substitute(expression, self.borne, self.given_by_loops)

    def shared(self, value: Expression | ca.SX) -> ca.SX:
        """The expression in t, x, u, p, and symbols for what many expressions share (see `given_by_dynamics`), and what redundant loops bear.

        Raises `UnknownVariableError` for a variable of another scene.
        """
        if isinstance(value, ca.SX):
            return self._opened_raw(value)
        if not isinstance(value, Expression):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
            said = (
                f"The method '{value.__name__}' of {value.__self__!r} is not a variable. Of springs and dampers read scene.spring.pull and .distance, of"
                " other parts"
                if ismethod(value)
                else f"{shown(value)} is not a variable or an expression of variables. Use"
            )
            raise UnknownVariableError(
                f"{said} the scene's own, e.g. scene.hinge.q, scene.rod.tip.position, or 2 * scene.hinge.v."
            )
        if isinstance(value, Symbol):
            return self.symbol(value)
        found = [(leaf.sx, self.symbol(leaf)) for leaf in sorted(value.leaves, key=lambda s: s.name)]
        other = [(symbol, meant) for symbol, meant in found if meant is not symbol]
        return ca.substitute([value.sx], *map(list, zip(*other, strict=True)))[0] if other else value.sx

    @functools.cached_property
    def kinetic_energy(self) -> ca.SX:
        """Of all bodies [J]."""
        return self.system.mechanics.kinetic_energy()

    @functools.cached_property
    def potential_energy(self) -> ca.SX:
        """Of gravity, force components, and what scalar components store (also in rotors) [J]."""
        return sum((stored for stored, _, _ in self._balances), self.system.mechanics.potential_energy())

    @functools.cached_property
    def _balances(self) -> list[tuple[ca.SX, ca.SX, ca.SX]]:
        """What each scalar part stores [J], dissipates and supplies [W]; as it says itself, where its law does not change by itself."""
        found: list[tuple[ca.SX, ca.SX, ca.SX]] = []
        unsteady = self.system.u
        for part in (p.component for p in self.system.flat.parts):
            if isinstance(part, AbstractForce):  # of mechanics
                continue
            stored = self.said(part.stored_energy())
            if law_changes(part):
                stored = ca.SX(0) if unsteady.numel() and ca.depends_on(stored, unsteady) else stored
                found.append((stored, self._power(inflow(part)) - self.rate(stored), ca.SX(0)))
            else:
                found.append((stored, self._power(part.dissipated_power()), self._power(part.supplied_power())))
        return found

    def _power(self, value: Expression | ca.SX | float) -> ca.SX:
        """What a part says of its power; nothing where it is not known."""
        if self.knows_powers:
            return self.said(value)
        try:
            return self.said(value)
        except ExpressionError:
            return ca.SX(0)

    @functools.cached_property
    def power_flows(self) -> ca.SX:
        """What the mechanism loses, and what each scalar part dissipates and supplies [W], in a column."""
        return ca.vertcat(self._lost_by_forces, *(power for _, *powers in self._balances for power in powers))

    @functools.cached_property
    def power_loss(self) -> ca.SX:
        """Dissipated less supplied power [W]."""
        return sum((lost - supplied for _, lost, supplied in self._balances), self._lost_by_forces)

    @functools.cached_property
    def _lost_by_forces(self) -> ca.SX:
        return self.closed(self.system.mechanics.power_loss())

    @functools.cached_property
    def loss_by_reactions(self) -> ca.SX:
        """(n, 1): what `power_loss` grows by with each reaction that holds as long as it can [W/N or W/(N*m)]: in an impact, what is lost by its impulse."""
        modes = self.system.modes
        if modes is None:
            return ca.SX(0, 1)
        r = modes.reactions
        return ca.substitute(ca.jacobian(self.unmasked.power_loss, r).T, r, ca.SX.zeros(r.numel()))

    def said(self, value: Expression | ca.SX | float) -> ca.SX:
        """What a part says of itself, in states, inputs and parameters."""
        return self.resolve(value) if isinstance(value, Expression | ca.SX) else ca.SX(value)

    def name(self, symbol: Symbol) -> str:
        """Full name of a declared symbol, e.g. `arm.elbow.q`."""
        flat = self.system.flat
        found = flat.names.get(symbol) or flat.free.get(symbol)
        if found is not None:
            return found
        if isinstance(symbol, Quantity):
            return f"{self.system.flat.connector_paths.get(symbol.connector, '?')}.{symbol.name}"
        at = next(
            (path for end, path in self.system.flat.connector_paths.items() if any(symbol is own for own in vars(end).values())),
            None,
        )
        return symbol.name if at is None else f"{at}.{symbol.name}"  # at a connector of a system

    def is_angle(self, value: Expression) -> bool:
        """Whether it is the angle of a cut joint, which a relative pose gives only up to full turns."""
        if not isinstance(value, Symbol) or value not in self._joint_symbols:
            return False
        return self._joint_symbols[value][1] == "q" and value.is_angle and self.symbol(value) is not value.sx

    def _opened_raw(self, value: ca.SX) -> ca.SX:
        """For plain `SX`: look its symbols up among those of the scene."""
        declared, own = self._by_hash
        used: dict[int, Symbol] = {}
        for entry in ca.symvar(value):
            found = declared.get(entry.element_hash())
            if found is None and entry.element_hash() not in own:
                raise UnknownVariableError(f"'{entry.name()}' is not a variable of the scene '{self.system.flat.name}'.")
            if found is not None:
                used[id(found)] = found
        return self.shared(Expression(value, frozenset(used.values())))

    @functools.cached_property
    def _by_hash(self) -> tuple[dict[int, Symbol], set[int]]:
        """What is declared in the scene, by its entries; and the entries of x, t, u and p."""
        declared = [*self.system.flat.names, *self._joint_symbols, *self._quantities()]
        own = ca.symvar(ca.vertcat(self.system.x, self.system.t, self.system.u, self.system.p))
        return {e.element_hash(): s for s in declared for e in s.scalars}, {e.element_hash() for e in own}

    def _quantities(self) -> list[Symbol]:
        return [q for connector in self.system.flat.connector_paths for q in connector.quantities]

    def symbol(self, symbol: Symbol) -> ca.SX:
        """One declared symbol in t, x, u, p, and symbols for what the dynamics give."""
        at_parts = self.system.flat.at_parts(symbol)
        if at_parts is not None:
            return self.shared(at_parts)
        if isinstance(symbol, Reaction) and symbol in self.system.solved:
            return self._open.solved.get(symbol, symbol.sx if self.system.modes is not None else self.system.solved[symbol])
        if isinstance(symbol, Time | Parameter | Input):
            self._check_known(symbol)
            return symbol.sx
        if isinstance(symbol, Quantity):
            return self._quantity(symbol)
        if isinstance(symbol, Derivative):
            return self._derivative(symbol)
        if symbol in self._joint_symbols:
            return self._joint_symbol(symbol)
        solved = self._solved(symbol)
        if solved is not None:
            return solved
        free = self.system.mechanics.readings.free_flanges
        if symbol in free:
            return free[symbol]
        raise UnknownVariableError(self._foreign(symbol))

    def _check_known(self, symbol: Symbol) -> None:
        if not isinstance(symbol, Time) and symbol not in self.system.flat.names:
            raise UnknownVariableError(self._foreign(symbol))

    def _foreign(self, symbol: Symbol) -> str:
        names = [name for name in self.system.flat.names.values() if name.split(".")[-1] == symbol.name.split(".")[-1]]
        hint = f" It has: {', '.join(names[:5])}." if names else ""
        return (
            f"'{symbol.name}' [{symbol.unit}] is not a variable of the scene '{self.system.flat.name}'; "
            f"it may belong to another scene, or to a part that was never assigned.{hint}"
        )

    def _joint_symbol(self, symbol: Symbol) -> ca.SX:
        joint, kind = self._joint_symbols[symbol]
        mechanics = self.system.mechanics
        if any(item.edge.joint is joint for item in mechanics.tree.joints):
            return symbol.sx
        placement = mechanics.placement
        rows = next(rows for rows in self.system.constraints.loops if rows.edge.joint is joint)
        q = joint.coordinates(rows.pose)
        if q is None:
            raise UnknownVariableError(
                f"{rows.edge.name}.{kind} closes a loop and has no closed form in {type(joint).__name__}.coordinates."
            )
        if kind == "q":
            return q
        if joint.v.size == joint.q.size:
            return placement.rate(q)
        return joint.velocities(rows.pose, *relative_twist(rows.edge, placement, rows.pose))

    def _derivative(self, symbol: Derivative) -> ca.SX:
        """By the chain rule through the dynamics, where scalar equations do not give it."""
        solved = self._solved(symbol)
        if solved is not None:
            return solved
        value = self.closed(self.symbol(symbol.of))
        held = [entry for entry in self._held_inputs if ca.depends_on(value, entry.sx)]
        if held:
            raise ExpressionError(
                f"{self.name(symbol)} depends on the rate of the input {self.name(held[0])}, which is not known here, since nothing with inertia follows it. Read what it drives, "
                "or give it by a function of time."
            )
        return self._opened_rate(value)

    @functools.cached_property
    def _led(self) -> tuple[Input, ...]:
        """Inputs whose rates are inputs, too."""
        known = set(self.system.flat.inputs)
        return tuple(entry for entry in self.system.flat.inputs if not isinstance(entry, Mode) and input_rate(entry) in known)

    @functools.cached_property
    def _held_inputs(self) -> tuple[Input, ...]:
        """Inputs by which parts prescribe places and angles, and whose rates nobody knows."""
        given = [sx(e) for part in self.system.flat.parts for e in part.component.given_motions()]
        return tuple(
            e for e in inputs_in(ca.veccat(ca.SX(0, 1), *given)) if e not in {*self._led} and not isinstance(e, InputRate)
        )

    @property
    def knows_powers(self) -> bool:
        """Whether it is known what all parts bring in: that of a place that an input prescribes follows from its rate."""
        return not self._held_inputs

    def rate(self, value: ca.SX) -> ca.SX:
        """Time derivative of an expression in t and x, inputs held whose rates are not known."""
        return self.closed(self._opened_rate(value))

    def _opened_rate(self, value: ca.SX) -> ca.SX:
        s = self.system
        rate = ca.jtimes(ca.vec(value), s.t, ca.SX(1))
        if s.x.numel():
            rate += ca.jtimes(ca.vec(value), s.x, self._rates)
        for entry in self._led:
            rate += ca.jtimes(ca.vec(value), entry.sx, input_rate(entry).sx)
        return ca.reshape(rate, *value.shape)

    def _quantity(self, symbol: Quantity) -> ca.SX:
        connector = symbol.connector
        mechanics = self.system.mechanics
        if not isinstance(connector, Point):
            raise UnknownVariableError(self._foreign(symbol))
        link, place = mechanics.placement.place(connector)
        name = symbol.name
        if name not in ("position", "rotation", "velocity", "angular_velocity"):
            return self.reactions.quantity(symbol)
        X = mechanics.kinematics.pose(link)
        R_link = symbolic(X.rotation)
        p = symbolic(place.position)
        w = mechanics.kinematics.angular_velocity(link)
        if name == "position":
            return symbolic((X @ place).position)
        if name == "rotation":
            return symbolic((X @ place).rotation)
        if name == "angular_velocity":
            return R_link @ w
        return R_link @ (mechanics.kinematics.linear_velocity(link) + ca.cross(w, p))


def _column(values: Iterable[ca.SX]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *map(ca.vec, values))
