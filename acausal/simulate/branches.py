"""A start where branches of the motion cross: whether its velocities lie on one of them."""

from __future__ import annotations

import numpy as np

from acausal.collocation.problem import Problem
from acausal.errors import StartValueError
from acausal.integrators.passage import passage_of
from acausal.outputs.functions import Functions

_OFF = 1e-6
_SHOWN = 6


def check_branch(functions: Functions, problem: Problem, t0: float, t1: float, x: np.ndarray) -> None:
    """Raise `StartValueError` where the velocities of a start x (nx,) at a singular position belong to no motion that goes on from there.

    A little ahead and back along the velocities the loops are closed; the motion through these places has the velocities that are asked
    for, or others.
    """
    passage = passage_of(problem)
    if passage is None or not t1 > t0 or not passage.is_crossing(t0, x):
        return
    found = passage.between(t0, x, t1 - t0)
    if found is None:
        return
    n = problem.positions
    off, here = (_energy(functions, problem, t0, x, v) for v in (found[n:] - x[n:], x[n:]))
    if off <= _OFF**2 * here:
        return
    joints = ", ".join(f"'{rows.edge.name}'" for rows in functions.outputs.system.constraints.loops)
    names = functions.state_names[n:]
    largest = np.argsort(-np.abs(found[n:] - x[n:]), kind="stable")[:_SHOWN]
    told = ", ".join(f"{names[i]} = {x[n + i]:.4g} (near by: {found[n + i]:.4g})" for i in sorted(int(i) for i in largest))
    raise StartValueError(
        f"The start is a singular position of the loops closed by {joints}: branches of the motion cross there, and the velocities lie on none "
        f"of them: {told}. Give velocities of more joints, such that they are those of one branch, or start a little beside the position."
    )


def _energy(functions: Functions, problem: Problem, t: float, x: np.ndarray, v: np.ndarray) -> float:
    """Kinetic energy of velocities v, also where some are prescribed."""
    n, u, p = problem.positions, problem.inputs(np.array([t]))[:, 0], problem.parameters
    one, other, rest = (float(functions.kinetic_energy(t, np.concatenate([x[:n], f * v]), u, p)) for f in (1.0, -1.0, 0.0))
    return 0.5 * (one + other) - rest
