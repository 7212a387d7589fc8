"""Mechanics of a mechanism in symbols: tree, kinematics, forces on links, energies. Constraints come later."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca

from acausal.dynamics import formulas
from acausal.dynamics.energy import gravity_potential, kinetic_energy
from acausal.dynamics.forward_dynamics import Wrench, zero_wrenches
from acausal.dynamics.kinematics import Kinematics
from acausal.dynamics.mode_rows import LockRows, ModeRow, lock_rows, mode_rows
from acausal.dynamics.placement import TreePlacement
from acausal.dynamics.readings import ReadingPlacement, Readings
from acausal.dynamics.tree import Tree, build_tree
from acausal.language.flatten import FlatSystem
from acausal.parts.force import AbstractForce, Action
from acausal.parts.force_check import symbols_read
from acausal.parts.pose import symbolic
from acausal.topology.mechanism import Mechanism


@dataclass(frozen=True, repr=False)
class MechanicalSystem:
    """Tree with kinematics, what all force components do to the links, and energies [J].

    `actions`: of each force component. `wrenches`: of all of them together on each link, in its frame. Variables of scalar domains
    that forces read (`readings.borrowed`) stand in both until `with_values` puts their values in. `laws`: symbols (n, 1) that stand there for what
    depends on accelerations and reactions (`readings.implicit`), and what they stand for.
    """

    mechanism: Mechanism
    tree: Tree
    kinematics: Kinematics
    placement: TreePlacement
    actions: tuple[tuple[Action, ...], ...]
    wrenches: tuple[Wrench, ...]
    readings: Readings
    laws: tuple[ca.SX, ca.SX]
    modes: tuple[ModeRow, ...] = ()
    """Of reactions that hold as long as they can."""
    locks: tuple[LockRows, ...] = ()
    """What is imposed and released."""
    unsolved: MechanicalSystem | None = None
    """The same with reactions as symbols, where their values have been put in."""

    @property
    def flat(self) -> FlatSystem:
        """The flat scene."""
        return self.mechanism.flat

    @property
    def forces(self) -> tuple[AbstractForce, ...]:
        """The force components."""
        return tuple(p.component for p in self.mechanism.forces if isinstance(p.component, AbstractForce))

    def kinetic_energy(self) -> ca.SX:
        """[J]."""
        return kinetic_energy(self.kinematics)

    def potential_energy(self) -> ca.SX:
        """Of gravity and of all force components [J]."""
        return sum((stored for stored, _ in self._balances), gravity_potential(self.kinematics))

    def stored_energies(self) -> tuple[ca.SX, ...]:
        """Of each force component [J], in their order."""
        return tuple(stored for stored, _ in self._balances)

    def power_loss(self) -> ca.SX:
        """Power dissipated less power supplied by force components [W]."""
        return sum((lost for _, lost in self._balances), ca.SX(0))

    @functools.cached_property
    def _balances(self) -> list[tuple[ca.SX, ca.SX]]:
        """Stored energy [J] and lost power [W] of each force component.

        As it says itself where its law holds its own connectors, time and parameters only. Where it reads more, whoever makes the law
        change does work that the component cannot know of: then what is lost is what it does not give. It stores nothing where
        its potential changes in a way that has no known rate (inputs, velocities, signals).
        """
        found: list[tuple[ca.SX, ca.SX]] = []
        for part, actions in zip(self.mechanism.forces, self.actions, strict=True):
            assert isinstance(part.component, AbstractForce)
            given = ReadingPlacement(self.placement, self.readings, part)
            stored = ca.SX(part.component.potential_energy(given))
            if part.laws or symbols_read(part.component):
                stored = self.readings.resolved(stored, part)
                unsteady = ca.vertcat(self.tree.v, *(entry.sx for entry in self.flat.inputs), *self.readings.foreign(stored))
                if unsteady.numel() and ca.depends_on(stored, unsteady):
                    stored = ca.SX(0)
                found.append((stored, -self.power(actions) - self.kinematics.rate(stored)))
            else:
                found.append((stored, ca.SX(part.component.power_loss(given))))
        return found

    def power(self, actions: tuple[Action, ...]) -> ca.SX:
        """Of a component's forces and torques on what they act on [W]."""
        power = ca.SX(0)
        for action in actions:
            power += ca.dot(action.force, self.placement.velocity(action.connector))
            power += ca.dot(action.torque, self.placement.angular_velocity(action.connector))
        return power

    def with_reactions(self, reactions: ca.SX, found: ca.SX) -> MechanicalSystem:
        """With values of reactions put in, but for their laws."""
        return replace(self.with_values([(reactions, found)]), modes=self.modes, unsolved=self)

    def with_values(self, values: Sequence[tuple[ca.SX, ca.SX]]) -> MechanicalSystem:
        """With values put in for symbols."""
        symbols, new = [s for s, _ in values], [value for _, value in values]

        def put(*columns: ca.SX) -> list[ca.SX]:
            return ca.substitute(list(columns), symbols, new)

        actions = tuple(tuple(Action(a.connector, *put(a.force, a.torque)) for a in own) for own in self.actions)
        wrenches = tuple((pair[0], pair[1]) for pair in (put(*wrench) for wrench in self.wrenches))
        modes = tuple(row.put(symbols, new) for row in self.modes)
        locks = tuple(row.put(symbols, new) for row in self.locks)
        return replace(
            self, actions=actions, wrenches=wrenches, laws=(self.laws[0], put(self.laws[1])[0]), modes=modes, locks=locks
        )


def mechanical_system(mechanism: Mechanism, t: ca.SX) -> MechanicalSystem:
    """Symbols and forces of a mechanism. Raises `ModelError` and `UnknownVariableError` for forces that cannot be known."""
    tree = build_tree(mechanism, t)
    kinematics = Kinematics(tree)
    placement = TreePlacement(kinematics)
    readings = Readings(mechanism.flat, placement)
    actions, laws = _without_laws(_actions(mechanism, placement, readings), readings)
    wrenches = zero_wrenches(tree)
    for own in actions:
        for action in own:
            link, pose = placement.place(action.connector)
            if link >= 0:
                moved = formulas.move_wrench(symbolic(pose.rotation), symbolic(pose.position), action.torque, action.force)
                wrenches[link] = (wrenches[link][0] + moved[0], wrenches[link][1] + moved[1])
    modes = mode_rows(mechanism.flat, readings) if mechanism.flat.reactions else ()
    locks = lock_rows(mechanism.flat, readings) if mechanism.flat.reactions else ()
    return MechanicalSystem(mechanism, tree, kinematics, placement, actions, tuple(wrenches), readings, laws, modes, locks)


def _without_laws(
    actions: tuple[tuple[Action, ...], ...], readings: Readings
) -> tuple[tuple[tuple[Action, ...], ...], tuple[ca.SX, ca.SX]]:
    """With a symbol for each entry that depends on accelerations or reactions; the symbols and the entries."""
    symbols, laws = ca.SX(0, 1), ca.SX(0, 1)
    if not readings.implicit:
        return actions, (symbols, laws)
    read = ca.veccat(*(s.sx for s in readings.implicit))

    def opened(column: ca.SX) -> ca.SX:
        nonlocal symbols, laws
        entries = ca.vertsplit(ca.densify(column))
        for k, entry in enumerate(entries):
            if ca.depends_on(entry, read):
                entries[k] = ca.SX.sym("law")
                symbols, laws = ca.vertcat(symbols, entries[k]), ca.vertcat(laws, entry)
        return ca.vertcat(*entries)

    found = tuple(tuple(Action(a.connector, opened(a.force), opened(a.torque)) for a in own) for own in actions)
    return found, (symbols, laws)


def _actions(mechanism: Mechanism, placement: TreePlacement, readings: Readings) -> tuple[tuple[Action, ...], ...]:
    """Of each force component, what it reads put in."""
    found: list[tuple[Action, ...]] = []
    for part in mechanism.forces:
        assert isinstance(part.component, AbstractForce)
        found.append(tuple(part.component.actions(ReadingPlacement(placement, readings, part))))
    everything = ca.vertcat(ca.SX(0, 1), *(column for own in found for a in own for column in (a.force, a.torque)))
    if not readings.foreign(everything):  # asked of all at once, since nearly always there is nothing
        return tuple(found)
    return tuple(
        tuple(Action(a.connector, readings.resolved(a.force, part), readings.resolved(a.torque, part)) for a in own)
        for part, own in zip(mechanism.forces, found, strict=True)
    )
