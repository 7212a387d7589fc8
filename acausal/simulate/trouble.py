"""What went wrong in a run, in terms of parts: singular loops, motions without inertia, wheels through their plane."""

from __future__ import annotations

import itertools
import re
import warnings
from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from acausal.collocation.problem import Problem, Solution, Status, StatusKind
from acausal.errors import (
    AcausalError,
    AccuracyWarning,
    AssemblyError,
    ContactWarning,
    JumpWarning,
    SimulationError,
    SingularWarning,
    StartValueError,
)
from acausal.language.expression import InputRate
from acausal.numerics.rounding import Rounding
from acausal.numerics.thresholds import CLOSED
from acausal.outputs.borders import Border
from acausal.outputs.functions import Functions
from acausal.outputs.infinite import without_value
from acausal.simulate.looks import MOST, at_steps, inputs_at_steps, least_spectrum, matrices_at_steps, spread
from acausal.simulate.paradox import paradox
from acausal.simulate.trajectory import Trajectory
from acausal.start.initial import initial_state
from acausal.wording import callers_level, compact

_SINGULAR = 1e-9
_INVISIBLE = 1e-13
_MASSLESS = 1e-12
_MISSED = 1e-4
_BORDER = 1e-3
"""Of what is positive inside, against the most that it was in a run, that is at its border."""
_BESIDE = 1e-6
"""Of the most that a state was in a run, what is all but zero."""
_ENDLESS = 1e4
"""Times the median over a run, from which on an energy is infinite."""
_AHEAD = 1e-4
"""Of the time since the start, a little while: what a motion comes to is there."""
_CUT = 0.2
_SHOWN = 4


def combination(weights: np.ndarray, names: Sequence[str]) -> str:
    """A vector over names in words, largest entry 1: `hinge.v - 0.5 arm.v`. Entries below 0.05 are left out, at most four are shown."""
    scaled = weights / weights[int(np.argmax(np.abs(weights)))]
    order = [int(i) for i in np.argsort(-np.abs(scaled)) if abs(scaled[i]) > 0.05]
    text = ""
    for i in order[:_SHOWN]:
        size = f"{abs(scaled[i]):.2g} " if abs(abs(scaled[i]) - 1) > 5e-3 else ""
        text += (" - " if scaled[i] < 0 else " + " if text else "") + size + names[i]
    return text.strip() + (" ..." if len(order) > _SHOWN else "")


def warn_if_singular(functions: Functions, run: Trajectory) -> bool:
    """Say so when a step came so near to a singular position of a loop that the motion after it cannot be relied upon; whether it did.

    Rows of the loop's matrix are scaled to the largest diagonal that they meet, and looked at where `_suspicious`. Where the reduction knows of singular positions,
    momentum leads through them; the motion is only in doubt where there is none.
    """
    system = functions.outputs.system
    if not system.constraints.jacobian.shape[0] or system.constraints.damped:
        return False
    suspicious = _suspicious(functions, run)
    if not suspicious.size:
        return False
    last = run.steps.t.size - 1
    steps = np.union1d(suspicious, (0, (last + 1) // 2, last))  # what is usual is seen there
    values = matrices_at_steps(functions, run, functions.loop_matrix, steps)
    scale = np.sqrt(np.maximum(np.max(np.diagonal(values, axis1=1, axis2=2), axis=0), np.finfo(float).tiny))
    smallest = least_spectrum(values / scale[:, None] / scale, _SINGULAR)
    if system.constraints.narrow:
        smallest[smallest > _INVISIBLE] = np.inf  # what is nearer is known to as many digits as elsewhere
    if system.constraints.singular:
        smallest[~np.isin(steps, suspicious)] = np.inf
    worst = int(np.argmin(smallest))
    if smallest[worst] < _SINGULAR:
        joints = ", ".join(f"'{rows.edge.name}'" for rows in system.constraints.loops)
        warnings.warn(
            f"At t = {run.steps.t[steps[worst]]:.6g} s a loop closed by {joints} is singular: its constraints depend on one another "
            f"({_dependent_rows(functions, run, int(steps[worst]), scale)}), and more than one "
            "motion may go on from there. The motion after it is not reliable; check run.energy_error(), or start elsewhere.",
            SingularWarning, stacklevel=callers_level(),
        )  # fmt: skip
    return bool(smallest[worst] < _SINGULAR)


def _suspicious(functions: Functions, run: Trajectory) -> np.ndarray:
    """Numbers of steps, at most `MOST`, at whose ends a look at the loops' matrix is worth its cost: where nothing moves, or, where no
    singular position is known, steps were cut, and not by an end of the run. How rows stand at the start is known (see `check_decided`).
    """
    t = run.steps.t
    if functions.outputs.system.constraints.singular:
        kinetic = at_steps(functions, run, functions.kinetic_energy)[0]
        some = np.flatnonzero(kinetic <= _SINGULAR * np.max(kinetic))
        return some[spread(some.size)]
    h = np.diff(t)
    h[h == 0] = h.max(initial=0.0)  # over these the state jumps
    if h.size < 2:
        return np.arange(h.size)
    h[0] = max(h[:2])
    if run.status.kind is StatusKind.SUCCESS:
        h[-1] = max(h[-2:])
    least = _CUT * np.partition(h, h.size // 2)[h.size // 2]
    if h.min() >= least:
        return np.zeros(0, dtype=int)
    usual = np.minimum(np.append(h, np.inf), np.insert(h, 0, np.inf))
    some = np.flatnonzero(~(usual >= least))
    return some if some.size <= MOST else np.sort(some[np.argsort(usual[some], kind="stable")[:MOST]])


def _dependent_rows(functions: Functions, run: Trajectory, k: int, scale: np.ndarray) -> str:
    """Which rows depend on one another at step k, and which velocities they leave open there and not elsewhere."""
    system = functions.outputs.system
    space = functions.space
    function = ca.Function("A", [system.t, space.x, space.p], [space.put(system.constraints.jacobian)])
    A = np.array(function(run.steps.t[k], run.steps.x[:, k], run.problem.parameters)) / scale[:, None]
    names = [name for rows in system.constraints.loops for name in rows.names]
    U, _, Vt = np.linalg.svd(A)
    opened = Vt[A.shape[0] - 1]
    velocities = functions.tree_state_names[system.nq : system.nq + system.tree_velocities]
    rows = combination(U[:, -1], [names[i] for i in system.constraints.kept_index])
    return f"rows {rows}; free besides: {combination(opened, velocities)}"


def check_inside(functions: Functions, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> None:
    """Raises `StartValueError` for a part that begins where it has no meaning."""
    found = functions.beyond(t, x, u, p)
    if found is not None:
        border, values = found
        raise StartValueError(
            f"{border.who} has no meaning at the start{_at(functions, border, t, x, u, p)}. {border.told(values)}"
        )


def check_inside_all(functions: Functions, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> None:
    """Raises `SimulationError` for states (nx, n) at times (n,) some of which are beyond a border."""
    if functions.inside.size1_out(0) == 0:
        return
    given = np.zeros((functions.inside.size1_in(2), t.size))
    given[: u.shape[0]] = u
    outside = np.argwhere(
        (np.array(functions.inside.map(t.size)(t[None, :], x, given, np.repeat(p[:, None], t.size, axis=1))) < 0).T
    )
    if outside.size:
        k, row = outside[0]
        border, why = functions.border_of(int(row))
        raise SimulationError(f"By t = {t[k]:.6g} s {border.who} has left where it has a meaning. {why}", None)


def ended_inside(functions: Functions, problem: Problem, solution: Solution, events: int) -> Solution:
    """A motion that a border ended, which follows so many `events` among the guards: with a status that says so."""
    if not (solution.stopped and solution.crossings[-1].guard >= events):
        return solution
    (border, why), t, x = functions.border_of(solution.crossings[-1].guard - events), float(solution.t[-1]), solution.x[:, -1]
    u = problem.with_modes(solution.modes).inputs(solution.t[-1:])[:, 0]
    message = f"{border.who} has come to where it has no meaning{_at(functions, border, t, x, u, problem.parameters)}. {why}"
    crossings = tuple(crossing for crossing in solution.crossings if crossing.guard < events)
    return replace(solution, status=Status(StatusKind.OUTSIDE, t, message), crossings=crossings, stopped=False)


def _rows(functions: Functions) -> list[int]:
    """Where the values of each border begin, and where those of the last one end."""
    return [0, *itertools.accumulate(border.values.numel() for border in functions.borders)]


def _at(functions: Functions, border: Border, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> str:
    """The place of a part in its coordinates, in words; empty without any."""
    place = functions.output(border.coordinates, name="coordinates")
    values = np.array(place(t, x, np.append(u, np.zeros(place.size1_in(2) - u.size)), p))[:, 0]
    told = ", ".join(f"{name} = {value:.6g}" for name, value in zip(border.names, values, strict=True))
    return f", at {told}" if told else ""


def warn_if_not_followed(functions: Functions, run: Trajectory) -> None:
    """Say so when a contact did not keep to the speed that an input prescribes: it follows by the input's rate, which jumps are not in.

    And when loops left what a gear says that they were to hold.
    """
    looped, closed = functions.followed
    scalar, modes = functions.outputs.system.scalar, functions.outputs.system.modes
    off = _first_missed(functions, run, closed if run.status.kind is StatusKind.SUCCESS else None)
    if off:
        assert modes is not None
        warnings.warn(
            f"By t = {off[0]:.6g} s what an input prescribes is missed by {off[1]:.3g}: {compact(modes.followed)}. The motion follows the input's rate; a jump is not "
            "in it, and a rate of its own must belong to the value. Give a smooth course.",
            JumpWarning, stacklevel=callers_level(),
        )  # fmt: skip
    left = _first_missed(functions, run, looped)
    if left:
        warnings.warn(
            f"By t = {left[0]:.6g} s loops have left what {compact(h.name for h in scalar.looped)} say, by {left[1]:.3g}: the motion went on to another "
            "branch of a singular position, which they do not allow. The motion from there on is not reliable.",
            AccuracyWarning, stacklevel=callers_level(),
        )  # fmt: skip


def _first_missed(functions: Functions, run: Trajectory, rows: ca.Function | None) -> tuple[float, float] | None:
    """When and by how much a run first missed one of these rows, by more than a part of its terms and than rounding; None if it did not."""
    if rows is None:
        return None
    gap, sizes, rounding = np.split(np.abs(at_steps(functions, run, rows)), 3)
    size = np.max(sizes, axis=1, keepdims=True, initial=0.0)
    missed = (gap > _MISSED * size) & (gap > CLOSED * rounding) & (size > 0)
    if not missed.any():
        return None
    k = int(np.flatnonzero(missed.any(axis=0))[0])
    return float(run.steps.t[k]), float(np.max(gap[:, k]))


_LOOKS = 16
"""Number of states of a run at which contacts are looked at: finding their forces costs as much as many steps."""
_PULL = 1e-6
"""Of the largest force of the contacts, what counts as a pull."""
_NOISE = 1e3
"""Times what rounding makes of a force, what is none."""


def warn_if_pulled(functions: Functions, run: Trajectory) -> None:
    """Say so when a contact pulls at one of some states of the run; not where redundant constraints leave open which of them bears what."""
    parts, pushes = functions.contacts
    if pushes is None or functions.outputs.system.constraints.redundant:
        return
    some = spread(run.steps.t.size, _LOOKS)
    t, values = run.steps.t[some], at_steps(functions, run, pushes, some)
    if not np.isfinite(values).all() or not np.min(values, initial=0.0) < -_PULL * np.max(np.abs(values)):
        return
    k, i = np.unravel_index(int(np.argmin(values)), values.shape)
    u = inputs_at_steps(run, some[[i]])[:, 0]
    if -values[k, i] <= _NOISE * Rounding(pushes)(t[i], run.steps.x[:, some[i]], u, run.problem.parameters)[k]:
        return
    warnings.warn(
        f"'{parts[k].path}' ({parts[k].component.created_at}) pulls, with {-values[k, i]:.4g} N at t = {t[i]:.6g} s: a contact can only push, so what "
        "it holds would have left it. Motions go on as if it were held; look for the time with an event on its normal_force.",
        ContactWarning, stacklevel=callers_level(),
    )  # fmt: skip


def raise_if_interrupted(status: Status, run: Trajectory | None) -> None:
    """Raise the `KeyboardInterrupt` that ended a run; `run` of the exception is the motion until then."""
    if status.kind is StatusKind.INTERRUPTED:
        interrupt = KeyboardInterrupt(
            f"Interrupted at t = {status.time:.6g} s; the motion until then is in this exception's `run`."
        )
        interrupt.run = run  # type: ignore[attr-defined]  # the one thing that is added to it
        raise interrupt


@np.errstate(all="ignore")
def failure(functions: Functions, status: Status, t1: float, run: Trajectory | None) -> str:
    """Why a run ended early: the status, the state that failed first, and what has no inertia there."""
    worst, message = "", status.message
    if status.kind is StatusKind.SLIDES:
        message = re.sub(r"\b([txup])_(\d+)\b", lambda found: _argument(functions, found[1], int(found[2])), message)
        worst = " Dry friction that sticks is like that: a law that is steep and smooth there, such as tanh(v / 1e-3) in place of sign(v), has a motion."
    if run is not None and status.kind is StatusKind.OVERLAPS:
        message = _overlap(functions, run) or message
    if run is not None and status.kind in (
        StatusKind.NO_MODE,
        StatusKind.NON_FINITE,
        StatusKind.STEP_UNDERFLOW,
        StatusKind.NOT_CONVERGED,
    ):
        message = paradox(functions, run) or message
    if status.kind in (StatusKind.NO_MODE, StatusKind.CHATTERS):
        message = _undecided(functions, message)
    if status.worst is not None:
        worst = f" The state that failed first: {functions.state_names[status.worst]}."
    if run is not None:
        worst += _lost_input(functions, run, t1)
    if run is not None and status.kind is StatusKind.MAX_STEPS:
        worst += _at_a_border(functions, run)
    if run is not None and status.kind in (StatusKind.NON_FINITE, StatusKind.STEP_UNDERFLOW):
        worst += (
            _infinite(functions, run)
            or _at_a_border(functions, run)
            or _endless(functions, run)
            or _without_inertia(functions, run)
            or _out_of_reach(functions, run, t1)
        )
    kept = "" if run is None else " The motion until then is in this error's `trajectory`."
    return f"{message} Integration stopped at t = {status.time:.6g} s of {t1:g} s ({status.kind.name.lower()}).{worst}{kept}"


def _overlap(functions: Functions, run: Trajectory) -> str:
    """Which gap is the most negative one where a run begins, or where it has jumped; empty if none is seen."""
    modes, t = functions.outputs.system.modes, run.steps.t[-1:]
    assert modes is not None
    u = run.problem.inputs(t)[:, 0]
    gaps = np.array(functions.output(modes.gaps, name="gaps")(t[0], run.steps.x[:, -1], u, run.problem.parameters)).ravel()
    if not gaps.min() < 0:
        return ""
    when = "at the start" if run.steps.t.size == 1 else f"at t = {t[0]:g} s, where it jumps"
    row = [row for row in modes.rows if row.one_sided][int(np.argmin(gaps))]
    unit = "rad" if row.reactions[0].unit == "N*m" else "m"
    return f"The gap of {row.part.where} is negative {when} ({gaps.min():.3g} {unit}). {row.part.component.if_overlaps}"


def _undecided(functions: Functions, message: str) -> str:
    """The message with what parts say of it; where there is no friction, it is not told of."""
    modes = functions.outputs.system.modes
    if modes is None:
        return message
    said = {row.part.where: row.part.component.if_undecided for row in modes.rows if row.part.component.if_undecided}
    if not said:
        return message
    if not modes.frictions:
        message = f"No mode of {compact(said, 4)} obeys their laws."
    return " ".join((message, *dict.fromkeys(said.values())))


def _argument(functions: Functions, kind: str, k: int) -> str:
    names = {"x": functions.state_names, "u": functions.input_names, "p": functions.parameter_names}
    return "t" if kind == "t" else names[kind][k]


def _lost_input(functions: Functions, run: Trajectory, t1: float) -> str:
    """An input that is no number at the last state or a little later; empty if all are."""
    t = run.steps.t[-1]
    values = run.problem.inputs(np.array([t, t + 1e-9 * (abs(t) or t1)]))
    lost = np.flatnonzero(~np.all(np.isfinite(values), axis=1))
    if not lost.size:
        return ""
    name = functions.outputs.name(functions.outputs.system.flat.inputs[lost[0]])
    return (
        f" The input {name} is {values[lost[0]][~np.isfinite(values[lost[0]])][0]} there: its function of time must give numbers."
    )


def _out_of_reach(functions: Functions, run: Trajectory, t1: float) -> str:
    """Why the scene cannot be assembled a little later, where functions of time pull loops apart; empty if it can."""
    system, outputs = functions.outputs.system, functions.outputs
    led = any(isinstance(one, InputRate) for one in system.flat.inputs)
    if not (led or ca.depends_on(system.closing, system.t)):
        return ""
    t0, t = run.steps.t[0], run.steps.t[-1]
    later = t + max(0.01 * (t - t0), 1e-3 * (t1 - t0))
    p = run.problem.parameters[: system.p_values.size]
    try:
        initial_state(outputs, {}, later, p, run.problem.inputs(np.array([later]))[:, 0])
    except AssemblyError as error:
        return f" A motion that is given leads out of reach. At t = {later:.6g} s: {error}"
    except AcausalError:
        return ""
    return ""


def _at_a_border(functions: Functions, run: Trajectory) -> str:
    """Which part has come to the border of where it has a meaning; empty if none has."""
    values, rows = at_steps(functions, run, functions.inside), _rows(functions)
    for border, begin, until in zip(functions.borders, rows[:-1], rows[1:], strict=True):
        most = np.max(values[begin:until], axis=1)
        if not np.all(values[begin:until, -1] > _BORDER * (np.clip(most, 0.0, 1.0) if border.sized else most)):
            t, x = run.steps.t[-1], run.steps.x[:, -1]
            where = _at(functions, border, t, x, run.problem.inputs(run.steps.t[-1:])[:, 0], run.problem.parameters)
            return f" {border.who} has come to where it has no meaning{where}. {border.told(values[begin:until, -1])}"
    # slopes that grow as a logarithm are not large before it is too late: what is all but zero is looked at in zero
    t, x, u = run.steps.t[-1], run.steps.x[:, -1], run.problem.inputs(run.steps.t[-1:])[:, 0]
    beside = np.where(np.abs(x) < _BESIDE * np.max(np.abs(run.steps.x), axis=1), 0.0, x)
    found = functions.beyond(t, beside, u, run.problem.parameters) if np.any(beside != x) else None
    if found is not None:
        where = _at(functions, found[0], t, beside, u, run.problem.parameters)
        return f" {found[0].who} has come beside where it has no meaning{where}. {found[0].told(found[1])}"
    return ""


def _infinite(functions: Functions, run: Trajectory) -> str:
    """Which forces have no value at the last state, or where it leads in a little while; empty if all have."""
    t, x, p = float(run.steps.t[-1]), run.steps.x[:, -1], run.problem.parameters
    u = run.problem.inputs(run.steps.t[-1:])[:, 0]
    words = without_value(functions, t, x, u, p)
    if not words and functions.modes is None:
        ahead = _AHEAD * (t - float(run.steps.t[0]))
        words = without_value(functions, t + ahead, x + ahead * np.array(functions.explicit_dynamics(t, x, u, p)).ravel(), u, p)
    return f" {words}" if words else ""


def _endless(functions: Functions, run: Trajectory) -> str:
    """A force whose energy has grown beyond all that it was before; empty if there is none."""
    mechanics = functions.outputs.system.mechanics
    if not mechanics.forces:
        return ""
    stored = functions.output(ca.vertcat(*map(functions.outputs.resolve, mechanics.stored_energies())), name="stored_energies")
    values = np.abs(at_steps(functions, run, stored))
    growth = values[:, -1] / np.maximum(np.median(values, axis=1), np.finfo(float).tiny)
    k = int(np.argmax(growth))
    if not growth[k] > _ENDLESS:
        return ""
    part = mechanics.mechanism.forces[k]
    return (
        f" The energy of '{part.path}' ({part.component.created_at}) grows without end: bodies come together in its centre, where its law is infinite. "
        "Let them pass beside it, or end the motion before by an event."
    )


def _without_inertia(functions: Functions, run: Trajectory) -> str:
    """A motion of the tree that meets no inertia at the last state; empty if there is none, or if loops forbid it."""
    system = functions.outputs.system
    t, x = run.steps.t[-1], run.steps.x[:, -1]
    if not system.tree_velocities or system.constraints.loops:
        return ""
    M = np.array(functions.mass_matrix(t, x, run.problem.inputs(np.array([t]))[:, 0], run.problem.parameters))
    if not np.all(np.isfinite(M)):
        return ""
    levels, axes = np.linalg.eigh(M)
    if levels[0] > _MASSLESS * levels[-1]:
        return ""
    velocities = functions.tree_state_names[system.nq : system.nq + system.tree_velocities]
    return (
        f" Nothing with inertia resists the motion {combination(axes[:, 0], velocities)} there: add mass or a moment of inertia."
    )
