"""Why a motion is off: the part whose energies do not match its forces, a singular position, a jump."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.dynamics.readings import ReadingPlacement
from acausal.language.component import Component, inflow, is_own
from acausal.language.flatten import Part
from acausal.outputs.functions import Functions
from acausal.parts.force import AbstractForce
from acausal.parts.force_check import symbols_read
from acausal.simulate.looks import at_steps, least_spectrum, matrices_at_steps, spread
from acausal.simulate.trajectory import Trajectory
from acausal.wording import compact

_CONTRADICTION = 1e-4
"""Of the powers of a part, what they may be off together."""
_CLOSE, _LOOKS = 0.03, 65
"""Of what is zero where a part has no meaning, as it usually is, in a step that loses energy; how often this is looked at."""
_NEAR = 1e-5
"""Smallest eigenvalue of a loop's matrix against the largest, near a singular position."""


def condition(functions: Functions, row: int) -> str:
    """An invariant, or a loop row that follows from others, by the states that it holds together."""
    rows, columns = functions.watched.jac_sparsity(0, 1).get_triplet()
    states = [functions.state_names[c] for r, c in zip(rows, columns, strict=True) if r == row + 2]
    return f"the condition between {compact(states)}"


def energy_cause(functions: Functions, run: Trajectory, begin: int, sudden: bool) -> str:
    """A sentence on why the energy goes off between steps `begin` - 1 and `begin`; `sudden`: most of it there."""
    parts = _contradicting(functions, run)
    if parts:
        named = ", ".join(f"'{part.path}' ({part.component.created_at})" for part in parts)
        return f"The energies that {named} tells do not match the forces: along this motion the powers do not add up to zero."
    border = _border(functions, run, begin)
    if border:
        return border
    if functions.outputs.system.constraints.damped:
        return "Some rows of the loops depend on one another only where they are assembled exactly."
    near = _singular(functions, run)
    if near is not None:
        return f"At t = {near:.6g} s a loop comes near to a singular position."
    tied = "what gears, cables, cams or sources hold may have come to a singular position, which only loops of joints pass; "
    held = tied if functions.outputs.system.scalar.held else ""
    if sudden:
        return (
            f"Most of it is lost in one step: {held}a law or an input may jump there, or more than one motion go on from there."
        )
    return f"It grows along the motion: {held}a law may jump again and again, or the tolerance be too coarse for this motion."


def _border(functions: Functions, run: Trajectory, begin: int) -> str:
    """A sentence on the part that came close to where it has no meaning between steps `begin` - 1 and `begin`; empty where none did."""
    times = np.linspace(run.steps.t[max(begin - 1, 0)], run.steps.t[begin], _LOOKS)
    for border in () if times[0] == times[-1] else functions.borders:
        usual, here = (np.abs(run.at(at)[border.values]).reshape(border.values.numel(), -1) for at in (run.steps.t, times))
        usual, here = np.median(usual, axis=1), np.min(here, axis=1)
        close = np.flatnonzero(here < _CLOSE * usual)
        if close.size:
            return f"{border.who} was close to where it has no meaning then. {border.whys[close[0]]}"
    return ""


def _contradicting(functions: Functions, run: Trajectory) -> list[Part]:
    """Own parts whose powers do not add up to zero at the steps of the run."""
    balances = [(part, _powers(functions, part)) for part in functions.outputs.system.flat.parts if is_own(type(part.component))]
    known = [(part, powers) for part, powers in balances if powers is not None]
    if not known:
        return []
    function = functions.output(ca.vertcat(*(powers for _, powers in known)), name="powers")
    steps = spread(run.steps.t.size)
    values = at_steps(functions, run, function, steps).reshape(len(known), -1, steps.size)
    total, size = np.abs(values.sum(axis=1)).max(axis=1), np.abs(values).sum(axis=1).max(axis=1)
    return [part for (part, _), gap, all_of in zip(known, total, size, strict=True) if gap > _CONTRADICTION * all_of]


def _powers(functions: Functions, part: Part) -> ca.SX | None:
    """Powers (4, 1) of a part [W] that add up to zero: what it gives, less what comes in, goes to its store, and is lost."""
    outputs, component = functions.outputs, part.component
    mechanics = outputs.system.mechanics
    if isinstance(component, AbstractForce):
        if symbols_read(component):
            return None
        given = ReadingPlacement(mechanics.placement, mechanics.readings, part)
        actions = mechanics.actions[[p.component for p in mechanics.mechanism.forces].index(component)]
        stored = ca.SX(component.potential_energy(given))
        lost = ca.SX(component.power_loss(given))
        return ca.vertcat(mechanics.power(actions), mechanics.kinematics.rate(stored), lost, 0)
    if type(component).equations is Component.equations:
        return None
    values = (inflow(component), component.stored_energy(), component.dissipated_power(), component.supplied_power())
    come, stored, lost, supplied = map(outputs.said, values)
    return ca.vertcat(-come, outputs.rate(stored), lost, -supplied)


def _singular(functions: Functions, run: Trajectory) -> float | None:
    """The time at which a loop is nearest to a singular position, if it is near."""
    m = functions.outputs.system.constraints.jacobian.shape[0]
    if not m:
        return None
    steps = spread(run.steps.t.size)
    matrices = matrices_at_steps(functions, run, functions.loop_matrix, steps)
    scale = np.sqrt(np.maximum(np.max(np.diagonal(matrices, axis1=1, axis2=2), axis=0), np.finfo(float).tiny))
    smallest = least_spectrum(matrices / scale[:, None] / scale, _NEAR)
    worst = int(np.argmin(smallest))
    return float(run.steps.t[steps[worst]]) if smallest[worst] < _NEAR else None
