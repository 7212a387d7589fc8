"""Friction that leaves a motion no acceleration, or several (Painleve's paradox): from which coefficient on."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.outputs.functions import Functions
from acausal.reduce.modes import Modes
from acausal.simulate.trajectory import Trajectory

_NEARLY = 1e-2
"""Of the critical coefficient: so near to it forces grow beyond bounds in no time."""


@dataclass(frozen=True)
class _Place:
    """Of all rows (n): rates, compliances (n, n) and whether they hold; limits of sliding by reactions (frictions, n), and by magnitudes (frictions, m), whose forces
    (3 each) change by reactions (3 m, n)."""

    rate: np.ndarray
    W: np.ndarray
    holds: np.ndarray
    by_reaction: np.ndarray
    by_magnitude: np.ndarray
    force: np.ndarray


def paradox(functions: Functions, run: Trajectory) -> str:
    """Which friction is beyond its critical coefficient where a run ends; empty if none is."""
    modes = functions.outputs.system.modes
    if modes is None:
        return ""
    at = _place(functions, run, modes)
    rows, first = list(modes.rows), 0
    for k, row in enumerate(rows):
        own = np.arange(first, first + row.size)
        first += row.size
        if row.one_sided:
            continue
        mu, part = _worst(at, own, k - modes.one_sided)
        if part >= 1 - _NEARLY:
            return (
                f"{row.part.where} slips with a coefficient of {mu:.6g}, and there the critical one is {mu / part:.6g}: from that on its friction makes what presses grow "
                "by as much as it is itself, so that no acceleration obeys all laws, or several do (Painleve's paradox). Lower the coefficient, make what slips less slender, or let bodies yield there."
            )
    return ""


def _place(functions: Functions, run: Trajectory, modes: Modes) -> _Place:
    n, unknown = modes.reactions.numel(), modes.magnitudes.symbols
    sliding = ca.vertcat(ca.SX(0, 1), *(row.sliding for row in modes.frictions if row.sliding is not None))
    forces = ca.vertcat(ca.SX(0, 1), *(ca.vertcat(size.of, ca.SX.zeros(3 - size.of.numel())) for size in modes.magnitudes.sizes))
    wanted = [
        modes.rate,
        modes.compliance,
        ca.jacobian(sliding, modes.reactions),
        ca.jacobian(sliding, unknown),
        ca.jacobian(forces, modes.reactions),
    ]
    t, x = run.steps.t[-1], run.steps.x[:, -1]
    u = run.problem.inputs(np.array([t]))[:, 0]
    flat = ca.vertcat(*(ca.densify(ca.vec(entry)) for entry in wanted))
    values = np.array(functions.output(flat, name="paradox")(t, x, u, run.problem.parameters)).ravel()
    found: list[np.ndarray] = []
    for entry in wanted:
        found.append(values[: entry.numel()].reshape(entry.shape, order="F"))
        values = values[entry.numel() :]
    masks = u[u.size - len(modes.masks) :]
    holds, mask, row_of = np.zeros(n, dtype=bool), 0, 0
    for row in modes.rows:
        holds[row_of : row_of + row.size] = masks[mask] == 1
        row_of, mask = row_of + row.size, mask + row.masks
    return _Place(found[0].ravel(), found[1], holds, found[2], found[3], found[4])


def _worst(at: _Place, own: np.ndarray, friction: int) -> tuple[float, float]:
    """Of one friction: the coefficient by which something presses, and its part of the critical one, the largest."""
    slip, found = at.rate[own], (0.0, 0.0)
    along = [slip / np.linalg.norm(slip)] if np.linalg.norm(slip) > 0 else []
    for gap in np.flatnonzero(at.by_reaction[friction]):
        W = _held(at, np.concatenate([[gap], own]))
        for e in (*along, W[0, 1:] / (np.linalg.norm(W[0, 1:]) or 1.0))[:1]:
            found = max(
                found,
                (at.by_reaction[friction, gap], at.by_reaction[friction, gap] * (W[0, 1:] @ e) / W[0, 0]),
                key=lambda pair: pair[1],
            )
    sizes, part = np.flatnonzero(at.by_magnitude[friction]), 0.0
    for size in sizes:
        force = at.force[3 * size : 3 * size + 3]
        change = force[:, own] + force[:, at.holds] @ _answer(at, own)
        e = along[0] if along else np.linalg.svd(change)[2][0]
        part += at.by_magnitude[friction, size] * float(np.linalg.norm(change @ e))
    return max(found, (float(at.by_magnitude[friction, sizes[0]]) if sizes.size else 0.0, part), key=lambda pair: pair[1])


def _others(at: _Place, own: np.ndarray) -> np.ndarray:
    held = at.holds.copy()
    held[own] = False
    return np.flatnonzero(held)


def _held(at: _Place, rows: np.ndarray) -> np.ndarray:
    """Compliances of some rows, while all others hold that do."""
    others = _others(at, rows)
    return at.W[rows][:, rows] + at.W[rows][:, others] @ _answers(at, others, rows)


def _answer(at: _Place, own: np.ndarray) -> np.ndarray:
    """Reactions of all that holds, by those of some rows."""
    others, found = _others(at, own), np.zeros((at.W.shape[0], own.size))
    found[others] = _answers(at, others, own)
    return found[at.holds]


def _answers(at: _Place, others: np.ndarray, own: np.ndarray) -> np.ndarray:
    return -np.linalg.lstsq(at.W[others][:, others], at.W[others][:, own], rcond=None)[0]
