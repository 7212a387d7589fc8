"""Equations of motion over the tree: kinematics forward, forces backward, energies."""
