"""A run looked at: functions at the ends of its steps."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.numerics.staged import Function
from acausal.outputs.functions import Functions
from acausal.simulate.trajectory import Trajectory
from acausal.start.coordinates import turning_states

MOST = 256
"""Steps at which a run is looked at where a look costs about as much as a step."""


def at_steps(functions: Functions, run: Trajectory, function: Function, some: np.ndarray | None = None) -> np.ndarray:
    """(rows, n): a function (t, x, u, p) at the ends of `some` steps, or of all."""
    t, x = run.steps.t, run.steps.x
    if some is not None:
        t, x = t[some], x[:, some]
    return functions.series(function).glance(t, x, inputs_at_steps(run, some), run.problem.parameters)


def inputs_at_steps(run: Trajectory, some: np.ndarray | None = None) -> np.ndarray:
    """(nu, n): inputs at the ends of `some` steps, or of all; with modes those before what happens there, also where inputs jump."""
    t, met = run.steps.t, run.solution.modes
    some = np.arange(t.size) if some is None else some
    u = run.problem.inputs(t[some] if met is None else run.solution.beside(t[some], -1))
    if met is not None:
        masks = met.at_ends(t.size)[:, some]
        u[u.shape[0] - masks.shape[0] :] = masks
    return u


def matrices_at_steps(functions: Functions, run: Trajectory, function: ca.Function, some: np.ndarray) -> np.ndarray:
    """(n, m, m): a matrix (t, x, u, p) at the ends of some steps; zero where it is not finite."""
    values = np.nan_to_num(at_steps(functions, run, function, some))
    m = function.size1_out(0)
    return values.T.reshape(-1, m, m).transpose(0, 2, 1)


def spread(count: int, most: int = MOST) -> np.ndarray:
    """At most so many of `count` numbers, far apart, the first and the last one among them."""
    return np.arange(count) if count <= most else np.arange(most) * (count - 1) // (most - 1)


def least_spectrum(matrices: np.ndarray, enough: float) -> np.ndarray:
    """Smallest eigenvalue over the largest one (n,) of symmetric matrices (n, m, m); 1 where it is certainly more than `enough`."""
    found = np.ones(matrices.shape[0])
    for k, matrix in enumerate(matrices):
        largest = np.abs(matrix).sum(axis=1).max(initial=0.0)  # no eigenvalue is larger
        try:
            np.linalg.cholesky(matrix - enough * largest * np.eye(matrix.shape[0]))
        except np.linalg.LinAlgError:
            spectrum = np.linalg.eigvalsh(matrix)
            found[k] = spectrum[0] / max(spectrum[-1], np.finfo(float).tiny)
    return found


def beside_others(functions: Functions, run: Trajectory, met: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sizes (nx,) of states that were as large as `met`: angles are as large as a radian, and what loops hold as much as it is beside others, so fast as
    the fastest of it, or as what moves it by rounding in the whole run. And
    sizes (rows,) of what met in constants of what is watched, at that speed.
    """
    turns, rates = turning_states(functions.space.system)
    places = np.array(functions.space.places)
    much, turning = functions.much[places], np.append(turns, np.zeros(rates.size))[places]
    moving = (places >= turns.size) & (much > 0)
    slowest = np.finfo(float).eps / max(run.steps.t[-1] - run.steps.t[0], np.finfo(float).tiny)
    speed = np.max(met[moving] / much[moving], initial=slowest)
    sizes = np.maximum.reduce([met, turning, np.where(moving, speed, 1.0) * much])
    places_known, rates_known = functions.drawn
    return sizes, places_known + speed * rates_known
