"""Closed loops: rows, groups, redundancy, mobility, singular positions, forces."""
