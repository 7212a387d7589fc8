"""Mechanics of a mechanism in symbols: tree, kinematics, forces on links, energies. Constraints come later."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from acausal.dynamics import kernels
from acausal.dynamics.energy import gravity_potential, kinetic_energy
from acausal.dynamics.forward_dynamics import Wrench, zero_wrenches
from acausal.dynamics.kinematics import Kinematics
from acausal.dynamics.placement import TreePlacement
from acausal.dynamics.tree import Tree, build_tree
from acausal.language.flatten import FlatSystem
from acausal.parts.force import AbstractForce
from acausal.parts.pose import symbolic
from acausal.topology.mechanism import Mechanism


@dataclass(frozen=True, repr=False)
class MechanicalSystem:
    """Tree with kinematics, the wrenches of all force components on each link (in its frame), and energies [J]."""

    mechanism: Mechanism
    tree: Tree
    kinematics: Kinematics
    placement: TreePlacement
    wrenches: tuple[Wrench, ...]

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
        energy = gravity_potential(self.kinematics)
        for force in self.forces:
            energy += force.potential_energy(self.placement)
        return energy

    def power_loss(self) -> ca.SX:
        """Power dissipated less power supplied by force components [W]."""
        power = ca.SX(0)
        for force in self.forces:
            power += force.power_loss(self.placement)
        return power


def mechanical_system(mechanism: Mechanism, t: ca.SX) -> MechanicalSystem:
    """Symbols and forces of a mechanism."""
    tree = build_tree(mechanism, t)
    kinematics = Kinematics(tree)
    placement = TreePlacement(kinematics)
    wrenches = zero_wrenches(tree)
    for part in mechanism.forces:
        assert isinstance(part.component, AbstractForce)
        for action in part.component.actions(placement):
            link, pose = placement.place(action.connector)
            if link >= 0:
                moved = kernels.move_wrench(symbolic(pose.rotation), symbolic(pose.position), action.torque, action.force)
                wrenches[link] = (wrenches[link][0] + moved[0], wrenches[link][1] + moved[1])
    return MechanicalSystem(mechanism, tree, kinematics, placement, tuple(wrenches))
