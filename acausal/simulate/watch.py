"""A run looked at when it has ended: whether its invariants and its energy are what its tolerance promises.

Small errors grow in chaotic motions, but not these: the energy and the invariants of a wrong motion are off by what the steps have
added to them. What is forgiven is measured, not assumed: as much as a disturbance of the states by many tolerances makes of them.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np

from acausal.errors import AccuracyWarning
from acausal.numerics.rounding import Rounding
from acausal.numerics.thresholds import ROUNDING
from acausal.outputs.borders import Border
from acausal.outputs.functions import Functions
from acausal.outputs.infinite import without_value
from acausal.simulate.blame import condition, energy_cause
from acausal.simulate.looks import at_steps, beside_others, inputs_at_steps
from acausal.simulate.trajectory import Trajectory, moving_energy
from acausal.wording import callers_level

_EPS = float(np.finfo(float).eps)
_LOOKS = 8
"""Steps at which a run is looked at; an error that stays is seen at the later ones."""
_FORGIVEN, _A_STEP = 1e3, 10.0
"""Tolerances of disturbance that are forgiven: at once, and for each step besides."""
_STRICT, _ASSEMBLED = 1e-2, 0.1
"""Parts of these where loops have singular positions, or rows that depend on one another only where they are assembled exactly: a motion that misses
one closely, and is taken through it, loses no more energy, nor one whose lengths are rounded."""
_LEAST, _MOST = 1e-8, 0.1
"""Relative disturbances: what is forgiven at least, and at most."""
_LOOSE, _START = 10.0, 1e-5
"""Invariants are forgiven more, and as much as starts may be off."""
_NOISE = 1e3
"""Times what rounding makes of an energy; of what it makes of rates, up to a part `_MOST` of the energy that moves, where any does: more is no motion to rely on."""
_OUTLIER = 1e3
"""Times as large as at all looks: a state that is looked at, too."""
_FEW = 4
"""Steps that tell how a power goes on."""
_CHEAP, _SHARE = 1e4, 1 / 20
"""Operations for the power at all steps that never matter, and their share in those of the motion; these run as C, many times faster."""
_SIGNS = np.random.default_rng(0).uniform(0.5, 1.0, 509) * np.random.default_rng(1).choice([-1.0, 1.0], 509)
"""Directions of disturbances."""
_FOURTHS, _PARTS = np.arange(_LOOKS // 2), (np.arange(1, _LOOKS // 2 + 1) - 0.5) / (_LOOKS // 2)
_NO_PLACE = 1e-14
"""Of what is zero in singular places, as it usually is: no motion passes one so closely by chance."""
_NEAR, _STRIDE, _MINIMA, _ZOOMS = 1e-4, 1e-3, 16, 6
"""Of what is zero in singular places, as it usually is, where it is looked for inside of steps; of its value at their ends, what it is there if they do not see it; how often at
most, and in which detail."""
_NIL = (64 * _EPS) ** 2
"""Of the energy that all would have by what acts on it, what is nothing but rounding of velocities."""


@dataclass(frozen=True)
class Sizes:
    """Largest magnitudes `met` (nx,) of states, and disturbances `forgiven` (nx,) of them; `part`: of a whole, what is forgiven."""

    met: np.ndarray
    forgiven: np.ndarray
    part: float


def warn_if_inaccurate(functions: Functions, run: Trajectory, rtol: float, atol: float) -> None:
    """Say so when invariants or the energy balance of a run are off by far more than its tolerance explains."""
    loops = functions.outputs.system.constraints
    forgiven = (_FORGIVEN + _A_STEP * run.statistics.steps) * (_STRICT if loops.singular else _ASSEMBLED if loops.damped else 1.0)
    part = min(max(forgiven * rtol, _LEAST), _MOST)
    if run.steps.t.size < 2 or not functions.space.x.numel():
        return
    x = run.steps.x
    met = np.maximum.reduce(np.abs(x), axis=1)
    if functions.quaternion_states:
        met[functions.quaternion_states] = 1.0
    sizes = Sizes(met, part * met + forgiven * atol, part)
    some = _with_outlier(_looks(run.steps.t), x, met)
    values = _values(functions, run, some, sizes)
    as_found = values[:, :_LOOKS]
    with np.errstate(invalid="ignore"):
        changes = np.abs(values[:, _LOOKS:] - as_found)
    if not np.isfinite(as_found[2:]).all() and np.isfinite(run.steps.x[:, some]).all():
        _has_no_constraints(functions, run)
        return
    if functions.energy_told and not np.isfinite(as_found[:2]).all() and np.isfinite(x[:, some]).all():
        _has_no_energy(functions, run)
    if any(not border.sized for border in functions.borders) and _passes_singular_place(functions, run):
        return
    if not math.isfinite(np.add.reduce(as_found, axis=None)):
        return
    changes[~np.isfinite(changes)] = np.inf  # beside an end of what has a value all is forgiven, and not elsewhere
    doubtful = (np.abs(as_found[2:]) > _LOOSE * changes[2:]).any()
    if not (doubtful and _leaves_constraints(functions, run, sizes)) and functions.energy_told:
        _look_at_energy(functions, run, sizes, some, as_found[0], as_found[1], changes[0] + changes[1])


def _passes_singular_place(functions: Functions, run: Trajectory) -> bool:
    """Warn that a part has come to where it has no meaning, and gone on: states that are smooth there may be thrown back where what they stand for is not; whether it has."""
    values, row = at_steps(functions, run, functions.inside), 0
    for border in functions.borders:
        own = values[row : row + border.values.numel()]
        row += border.values.numel()
        usual = np.array([_median(values, run.steps.t) for values in own])[:, None]
        at = np.argwhere((own < _NO_PLACE * usual) & np.isfinite(usual))
        if not border.sized and not at.size:
            at = _strides_over(run, border, own, usual)
        if not border.sized and at.size:
            warnings.warn(
                f"At t = {run.steps.t[at[0, 1]]:.6g} s {border.who} was where it has no meaning, and went on. {border.whys[at[0, 0]]} The motion is not reliable from there on.",
                AccuracyWarning, stacklevel=callers_level(),
            )  # fmt: skip
            return True
    return False


def _strides_over(run: Trajectory, border: Border, own: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """Row and step (1, 2) where what is positive beside singular places, `own` (rows, steps), comes to zero inside of a step; (0, 2) where none does.

    Steps that pass such a place closely are as short there as it is near. Those of a motion that is smooth in time through it, as a bead's that a rim throws back, are not.
    """
    here = own[:, 1:-1]
    lowest = np.argwhere((here <= own[:, :-2]) & (here <= own[:, 2:]) & (here < _NEAR * usual))[:_MINIMA]
    for row, before in lowest:
        k, values = int(before) + 1, own[row, before + 1 : before + 2]
        begin, end = run.steps.t[k - 1], run.steps.t[k + 1]
        for _ in range(_ZOOMS):
            times = np.linspace(begin, end, 33)
            values = np.nan_to_num(run.at(times)[border.values[int(row)]])
            least = int(np.argmin(values))
            begin, end = times[max(least - 1, 0)], times[min(least + 1, 32)]
        if np.min(values) < min(_STRIDE * own[row, k], _NEAR**2 * usual[row, 0]):
            return np.array([[row, k]])
    return np.zeros((0, 2), dtype=int)


def _median(values: np.ndarray, t: np.ndarray) -> float:
    """That of `values` (n,) at times t (n,) which half of the time are below."""
    order, lasts = np.argsort(values), np.gradient(t)
    until = np.cumsum(lasts[order])
    return float(values[order[np.searchsorted(until, 0.5 * until[-1])]])


def _has_no_constraints(functions: Functions, run: Trajectory) -> None:
    """Warn that invariants are no numbers: nobody knows then whether they hold."""
    off = ~np.isfinite(at_steps(functions, run, functions.watched)[2:])
    row, begin = int(np.argmax(off.any(axis=1))), int(np.argmax(off.any(axis=0)))
    warnings.warn(
        f"From t = {run.steps.t[begin]:.6g} s on nothing says whether the motion keeps its constraints: {condition(functions, row)} is no number there. "
        "What nonlinear equations give may have jumped with a source or a law. The motion from there on is not reliable; give jumps a short time to rise, "
        "or look at run.constraint_error().",
        AccuracyWarning, stacklevel=callers_level(),
    )  # fmt: skip


def _has_no_energy(functions: Functions, run: Trajectory) -> None:
    """Warn that an energy is no number: no balance says then whether the motion can be relied on."""
    begin = int(np.argmin(np.isfinite(at_steps(functions, run, functions.watched)[:2]).all(axis=0)))
    t = float(run.steps.t[begin])
    words = without_value(
        functions, t, run.steps.x[:, begin], inputs_at_steps(run, np.array([begin]))[:, 0], run.problem.parameters
    )
    warnings.warn(
        f"At t = {t:.6g} s the energy of the motion is infinite or not a number, and nothing says whether its balance holds. {words or 'A law may divide by zero there.'}",
        AccuracyWarning, stacklevel=callers_level(),
    )  # fmt: skip


def _looks(t: np.ndarray) -> np.ndarray:
    """Steps at which a run is looked at, (8,): half of them equally far apart among the steps, half in time: steps crowd where little can
    be judged, in a stiff contact, say. The last one is among them.
    """
    n = t.size
    by_time = t.searchsorted(t[0] + (t[-1] - t[0]) * _PARTS)
    return np.sort(np.concatenate((_FOURTHS * (n - 1) // (_LOOKS // 2 - 1), np.minimum(by_time, n - 1))))


def _with_outlier(some: np.ndarray, x: np.ndarray, met: np.ndarray) -> np.ndarray:
    """Looks (8,) of which the nearest is moved to the step where a state is far larger than at all of them, as one that a singular place has thrown out."""
    far = met > _OUTLIER * np.maximum.reduce(np.abs(x[:, some]), axis=1)
    if not far.any():
        return some
    step = int(np.argmax(np.abs(x[int(np.argmax(far))])))
    some = some.copy()
    some[np.argmin(np.abs(some - step))] = step
    return np.sort(some)


def _values(functions: Functions, run: Trajectory, some: np.ndarray, sizes: Sizes) -> np.ndarray:
    """Energies and invariants (rows, 16) at eight steps, as they are and then with the states disturbed."""
    times, n = run.steps.t[some], sizes.met.size
    x = np.empty((n, 2 * _LOOKS))
    x[:, :_LOOKS] = x[:, _LOOKS:] = run.steps.x[:, some]
    signs = _SIGNS if n * _LOOKS <= _SIGNS.size else np.resize(_SIGNS, n * _LOOKS)
    x[:, _LOOKS:] += sizes.forgiven[:, None] * signs[: n * _LOOKS].reshape(_LOOKS, n).T
    u, p = inputs_at_steps(run, some), run.problem.parameters
    return functions.series(functions.watched).glance(np.concatenate((times, times)), x, np.concatenate((u, u), axis=1), p)


def _leaves_constraints(functions: Functions, run: Trajectory, sizes: Sizes) -> bool:
    """Warn if the invariants are off by more than what is forgiven of the terms that they are the sums of; whether they are."""
    gaps = np.abs(at_steps(functions, run, functions.watched)[2:])
    worst = int(np.argmax(np.max(gaps, axis=0)))
    terms = _rounding(functions, run, worst, sizes, _longest(run, worst))[2:] / _EPS
    allowed = _LOOSE * max(sizes.part, _START)
    off = gaps > allowed * terms[:, None]
    for k in np.flatnonzero(off.any(axis=1)):  # each row at the step where it is off most
        most = int(np.argmax(gaps[k]))
        terms[k] = np.maximum(terms[k], _rounding(functions, run, most, sizes, _longest(run, most))[2 + k] / _EPS)
        # what is nothing by symmetry drifts by what is nothing too
        least = allowed * terms[k] + _rounding_beside(functions, run, most, sizes.met)[2 + k]
        off[k] = gaps[k] > least if terms[k] > 0 else False
    off[~np.isfinite(terms)] = False
    if not off.any():
        return False
    row = int(np.argmax(np.where(off, gaps, 0.0).max(axis=1) / np.maximum(terms, np.finfo(float).tiny)))
    begin = int(np.argmax(off[row]))
    t, size = run.steps.t, float(gaps[row].max())
    if row >= functions.kept_invariants:
        cause = "It followed from the others where the loop was examined, and does not here: other constraints may be redundant, or none."
    elif functions.outputs.system.constraints.damped:
        cause = "Some rows of these loops depend on one another only where they are assembled exactly."
    elif begin == 0:
        cause = "The start itself is assembled no better than that: lengths of very different sizes may stand in one loop."
    else:
        cause = "The correction after each step fails: a singular position may be near, or a law or an input jumps."
    warnings.warn(
        f"From t = {t[begin]:.6g} s on the motion leaves its constraints: {condition(functions, row)} is off by {size:.3g}, "
        f"{size / terms[row]:.2g} of its terms, where the tolerance allows {allowed:.2g}. {cause} "
        "The motion from there on is not reliable; look at run.constraint_error(), start elsewhere, or try another tolerance.",
        AccuracyWarning, stacklevel=callers_level(),
    )  # fmt: skip
    return True


def _longest(run: Trajectory, k: int) -> float:
    """The longest step [s] that leads to step k; where none of these takes time, of all."""
    h = np.diff(run.steps.t)
    return float(h[: max(k, 1)].max() or h.max())


def _rounding(functions: Functions, run: Trajectory, k: int, sizes: Sizes, h: float) -> np.ndarray:
    """What rounding makes of energies and invariants at step k; also by what it makes of rates in a time h [s].

    A state at rest has the size of what the terms of its rate would make of it in a step: the terms of a balance are there though
    their sum is nothing.
    """
    t, x, p = float(run.steps.t[k]), run.steps.x[:, k], run.problem.parameters
    u = inputs_at_steps(run, np.array([k]))[:, 0]
    rates, spread = Rounding(functions.explicit_dynamics), _EPS * sizes.met
    for _ in range(2 if h > 0 else 0):  # of velocities, then of positions
        spread = np.maximum(spread, h * np.nan_to_num(rates(t, x, u, p, spread=spread)))
    return Rounding(functions.watched)(t, x, u, p, spread=spread)


def _energy_if_nothing_held(functions: Functions, run: Trajectory) -> float:
    """The kinetic energy at the end of a run in which each term of the rates at the start had acted alone [J]."""
    t, x, p = run.steps.t[:1], run.steps.x[:, :1], run.problem.parameters
    u = inputs_at_steps(run, np.array([0]))
    terms = Rounding(functions.explicit_dynamics)(float(t[0]), x[:, 0], u[:, 0], p) / _EPS
    free = x + float(run.steps.t[-1] - t[0]) * np.nan_to_num(terms)[:, None]
    return float(np.nan_to_num(functions.series(functions.watched)(t, free, u, p)[0, 0]))


def energy_terms(run: Trajectory) -> float:
    """The terms that energies are the sums of, where the most moves [J]: there also where heights are counted from what rests."""
    functions, energies = run.functions, at_steps(run.functions, run, run.functions.watched)[:2]
    most = int(np.argmax(np.sum(np.abs(energies - energies[:, :1]), axis=0)))
    longest = _longest(run, run.steps.t.size)
    # usual states, and the start, too: where a singular place has thrown a motion out terms are beyond all bounds
    met = Sizes(np.median(np.abs(run.steps.x), axis=1), np.zeros(run.steps.x.shape[0]), 0.0)
    terms = [float(np.sum(_rounding(functions, run, k, met, longest)[:2])) for k in {0, most}]
    return min(terms) / _EPS


def _rounding_beside(functions: Functions, run: Trajectory, k: int, met: np.ndarray) -> np.ndarray:
    """What energies and invariants at step k change by where states are rounded as what is much beside others, and constants as what met in them."""
    t, x, p = float(run.steps.t[k]), run.steps.x[:, k], run.problem.parameters
    u = inputs_at_steps(run, np.array([k]))[:, 0]
    sizes, drawn = beside_others(functions, run, met)
    found = Rounding(functions.watched)(t, x, u, p, spread=_EPS * sizes)
    return ROUNDING * (np.nan_to_num(found) / _EPS + drawn)


def _look_at_energy(
    functions: Functions, run: Trajectory, sizes: Sizes, some: np.ndarray, T: np.ndarray, V: np.ndarray, spreads: np.ndarray
) -> None:
    """Warn if the energy balance is off by more than what is forgiven, and by more than rounding makes of it."""
    balance = T + V - T[0] - V[0]
    if run.solution.modes is not None:
        balance += run.transitions.lost_at_ends(run.steps.t.size)[some]
    swing = float(V.max() - V.min())
    if functions.outputs.power_loss.is_zero():
        scale = moving_energy(float(T.max()), float(T[0]), swing)
        doubtful = bool((np.abs(balance) > np.maximum(sizes.part * scale, spreads)).any())
    else:
        scale = max(float(T.max()), swing)
        doubtful = _loss_doubtful(functions, run, some, balance, np.maximum(sizes.part * scale, spreads))
    if not doubtful:
        return
    every = _balance(functions, run)
    least = np.maximum(sizes.part * every.scale, spreads)
    look = int(np.argmax(np.abs(every.gap[some]) / np.maximum(least, np.finfo(float).tiny)))
    worst = int(some[look])
    plain, noise = (
        _NOISE * sum(float(np.sum(_rounding(functions, run, k, sizes, h)[:2])) for k in (0, worst))
        for h in (0.0, _longest(run, run.steps.t.size))
    )
    # what rests is held by forces whose rounding is all that works
    moves = float(T.max()) > max(plain, _NIL * _energy_if_nothing_held(functions, run))
    allowed = max(float(least[look]), plain, min(noise, _MOST * every.scale) if moves else noise)
    if not np.abs(every.gap[worst]) > allowed:
        return
    size = float(np.max(np.abs(every.gap)))
    t = run.steps.t
    begin = int(np.argmax(np.abs(every.gap) > 0.1 * (min(size, every.scale) or size)))
    sudden = bool(np.max(np.abs(np.diff(every.gap))) > 0.5 * size)
    off = f"{size / every.scale:.2g} of the largest energy that moves" if every.scale > 0 else "and nothing moves"
    warnings.warn(
        f"The energy balance of the motion is off by {size:.3g} J, {off}, where the tolerance allows {sizes.part:.2g}; it goes off at "
        f"t = {t[max(begin - 1, 0)]:.6g} s. {energy_cause(functions, run, begin, sudden)} The motion is not reliable unless the energies are told "
        "wrongly; look at run.energy_error() and run.energy.",
        AccuracyWarning, stacklevel=callers_level(),
    )  # fmt: skip


def _loss_doubtful(functions: Functions, run: Trajectory, some: np.ndarray, balance: np.ndarray, allowed: np.ndarray) -> bool:
    """Whether the balance, with what is lost by quadrature over the steps' ends, is off by more than such a quadrature can be.

    Trapezoidal rule with slopes at the ends (Hermite's cubic); what the slopes bring in is taken for its error. Not judged where the
    power takes much arithmetic against the motion itself.
    """
    steps = run.steps.t.size
    if steps < _FEW:
        return False
    of_power, of_rates = functions.operations_of_power_and_rates
    if of_power * steps > max(_CHEAP, _SHARE * of_rates * run.statistics.evaluations):
        return False
    begin, end = _power_at_ends(functions, run)
    h = np.diff(run.steps.t)
    moves = h > 0
    number, h, begin, end = (
        np.insert(np.cumsum(moves), 0, 0),
        h[moves],
        begin[moves],
        end[moves],
    )  # steps without length are jumps
    if h.size < _FEW:
        return False
    secant = (end - begin) / h
    inside = (secant[:-1] * h[1:] + secant[1:] * h[:-1]) / (h[1:] + h[:-1])
    slope = np.concatenate((secant[:1], inside, secant[-1:]))
    bend = h * h * (slope[:-1] - slope[1:]) / 12
    lost, unsure = np.zeros(h.size + 1), np.zeros(h.size + 1)
    np.cumsum(h * (begin + end) / 2 + bend, out=lost[1:])
    np.cumsum(np.abs(bend), out=unsure[1:])
    looked = number[some]
    nothing_brought = min(float(begin.min()), float(end.min())) >= 0
    grows = nothing_brought and bool((balance > allowed).any())
    return grows or bool((np.abs(balance + lost[looked]) > allowed + unsure[looked]).any())


def _power_at_ends(functions: Functions, run: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Power that is lost at the start and at the end of each step, (steps,) each, in the mode that the step is in."""
    power, met = at_steps(functions, run, functions.power_loss)[0], run.solution.modes
    if met is None:
        return power[:-1], power[1:]
    ends, masks = power[1:].copy(), met.at_ends(run.steps.t.size)
    changed = np.flatnonzero((masks[:, 1:] != masks[:, :-1]).any(axis=0))
    if changed.size:  # a mode lasts until the end of the step
        u = inputs_at_steps(run, changed + 1)
        u[u.shape[0] - masks.shape[0] :] = masks[:, changed]
        at = run.steps.t[changed + 1], run.steps.x[:, changed + 1]
        ends[changed] = functions.series(functions.power_loss).glance(*at, u, run.problem.parameters)[0]
    return power[:-1], ends


def _passed(functions: Functions, run: Trajectory) -> float:
    """Energy that passes through parts besides what is lost or gained: what goes in and comes out at the same time."""
    at = run.at(run.steps.t)
    net, flows = at[functions.outputs.power_loss], at[functions.outputs.power_flows].reshape(run.steps.t.size, -1)
    through = np.maximum(np.sum(np.abs(flows), axis=1) - np.abs(net).ravel(), 0.0)
    return float(np.sum(np.diff(run.steps.t) * (through[1:] + through[:-1])) / 2)


@dataclass(frozen=True)
class Balance:
    """Energy that is missing at each step, and the largest energy that moves [J]."""

    gap: np.ndarray
    scale: float


def _balance(functions: Functions, run: Trajectory) -> Balance:
    """With what is lost by Gauss quadrature."""
    T, V = at_steps(functions, run, functions.watched)[:2]
    t = run.steps.t
    lost = run.at(t).lost_by_power + run.transitions.lost_at_ends(t.size)
    gap = T + V - T[0] - V[0] + lost
    passed = 0.0 if functions.outputs.power_loss.is_zero() else _passed(functions, run)
    swing, gone = float(np.max(np.abs(V - V[0]))), float(np.max(np.abs(lost)))
    moves = moving_energy(max(float(np.max(T)), gone), float(T[0]), swing, -float(np.min(lost)))
    return Balance(gap, max(moves, passed))
