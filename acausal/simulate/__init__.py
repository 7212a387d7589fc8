"""Runs: from start values to a trajectory, events, sensitivities, and what went wrong."""
