"""Initial values: consistent states from whatever the user says about the start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.errors import StartValueError
from acausal.language.connector import Quantity
from acausal.language.expression import Derivative, Expression, Input, Parameter, Symbol, Time
from acausal.mechanics.free import FreeJoint
from acausal.reduction.assembly import Residual, assemble
from acausal.reduction.outputs import Outputs

Value = float | Sequence[float] | np.ndarray


@dataclass(frozen=True)
class exactly:
    """A start value that must be met; a plain number means the same."""

    value: Value


@dataclass(frozen=True)
class near:
    """A start value that is met as well as the constraints and the exact values allow."""

    value: Value


Start = Mapping[Expression, Value | exactly | near]


@dataclass(frozen=True)
class Met:
    """One start value: what was asked, what came out."""

    name: str
    wanted: np.ndarray
    got: np.ndarray
    exact: bool


@dataclass(frozen=True)
class InitialState:
    """Consistent states at the start, and how the start values were met."""

    x: np.ndarray
    met: tuple[Met, ...]

    def __str__(self) -> str:
        rows = [f"  {m.name:<24} {'exactly' if m.exact else 'near':<8} wanted {m.wanted}  got {m.got}" for m in self.met]
        return "\n".join(["start:", *rows])


@dataclass(frozen=True)
class _Target:
    name: str
    expression: ca.SX
    wanted: np.ndarray
    exact: bool
    periodic: bool


def initial_state(outputs: Outputs, start: Start, t0: float, p: np.ndarray, u: np.ndarray) -> InitialState:
    """Positions first, then velocities; unspecified velocities are zero where the constraints allow.

    Raises `StartValueError` for a start value that cannot be set or cannot be met, `AssemblyError` when a loop cannot close.
    """
    r = outputs.system
    nq = r.nq
    q, v = r.x[:nq], r.x[nq:]
    targets = [_target(outputs, key, value) for key, value in start.items()]
    at_velocity = [ca.depends_on(t.expression, v) if v.numel() else False for t in targets]
    for target, moving in zip(targets, at_velocity, strict=True):
        if not moving and not (nq and ca.depends_on(target.expression, q)):
            raise StartValueError(f"{target.name} does not depend on the state: it is not free, so it cannot have a start value.")
    positions = [t for t, moving in zip(targets, at_velocity, strict=True) if not moving]
    velocities = [t for t, moving in zip(targets, at_velocity, strict=True) if moving]
    fixed = ca.vertcat(r.t, r.u, r.p)
    values = np.concatenate([[t0], u, p])
    free_q, free_v = _free_orientations(outputs)
    q0 = _solve(q, fixed, values, r.closing, positions, r.q_start, "position", free_q)
    v0 = _solve(
        v, ca.vertcat(fixed, q), np.concatenate([values, q0]), r.velocity_closing, velocities, r.rate_start, "velocity", free_v
    )
    x = np.concatenate([q0, v0])
    return InitialState(x, tuple(_met(t, r.t, r.x, r.u, r.p, t0, x, u, p) for t in targets))


def _free_orientations(outputs: Outputs) -> tuple[list[int], list[int]]:
    """Entries of q and v that are quaternions and angular velocities of free bodies: a body told where to be need not turn."""
    q: list[int] = []
    v: list[int] = []
    for item in outputs.system.tree_joints:
        if isinstance(item.edge.joint, FreeJoint):
            q += range(item.q.start, item.q.start + 4)
            v += range(item.v.start, item.v.start + 3)
    return q, v


def _target(outputs: Outputs, key: Expression, value: Value | exactly | near) -> _Target:
    if not isinstance(key, Expression):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass names and indices
        raise StartValueError(
            f"start: the key {key!r} is not a variable. Use the variable itself, e.g. start={{scene.hinge.q: 0.3}}."
        )
    for leaf in key.leaves:
        _check_settable(leaf)
    exact = not isinstance(value, near)
    number = value.value if isinstance(value, exactly | near) else value
    try:
        wanted = np.asarray(number, dtype=float).ravel(order="F")
    except (TypeError, ValueError):
        raise StartValueError(f"start value of {_name(outputs, key)} is {number!r}, not a number.") from None
    expression = ca.vec(outputs.resolve(key))
    if wanted.size == 1 and expression.numel() > 1:
        raise StartValueError(f"start value of {_name(outputs, key)} needs {expression.numel()} numbers, not one.")
    if wanted.size != expression.numel():
        raise StartValueError(f"start value of {_name(outputs, key)} needs {expression.numel()} numbers, not {wanted.size}.")
    if not np.all(np.isfinite(wanted)):
        raise StartValueError(f"start value of {_name(outputs, key)} is {wanted}. Give finite numbers.")
    return _Target(_name(outputs, key), expression, wanted, exact, outputs.is_angle(key))


def _check_settable(leaf: Symbol) -> None:
    if isinstance(leaf, Parameter):
        raise StartValueError(f"{leaf.name} is a parameter, not a state: give it by parameters={{...}}.")
    if isinstance(leaf, Input):
        raise StartValueError(f"{leaf.name} is an input, not a state: give it by inputs={{...}}.")
    if isinstance(leaf, Time):
        raise StartValueError("time cannot have a start value; give t0.")
    if isinstance(leaf, Derivative) or (
        isinstance(leaf, Quantity) and leaf.name in ("force", "torque", "acceleration", "angular_acceleration")
    ):
        raise StartValueError(f"{leaf.name} follows from the equations of motion and is not free: it cannot have a start value.")


def _name(outputs: Outputs, key: Expression) -> str:
    return outputs.name(key) if isinstance(key, Symbol) else repr(key)


def _solve(
    y: ca.SX,
    fixed: ca.SX,
    values: np.ndarray,
    closing: ca.SX,
    targets: list[_Target],
    guess: np.ndarray,
    what: str,
    kept: list[int],
) -> np.ndarray:
    """`kept`: entries of y that rather stay as they are than make up for others."""
    exact = [t for t in targets if t.exact]
    wished = [t for t in targets if not t.exact]
    if y.numel() == 0:
        return guess
    first = _with_plain_values(y, exact + wished, guess)
    hard = _residual(y, fixed, values, ca.vertcat(closing, *(_difference(t) for t in exact)))
    stay = y[kept] - ca.DM(first[kept]) if kept and targets else ca.SX(0, 1)
    soft = _residual(y, fixed, values, ca.vertcat(stay, *(_difference(t) for t in wished))) if wished or stay.numel() else None
    found = assemble(hard, first, soft)
    rng = np.random.default_rng(0)
    for attempt in range(8):
        if found.converged:
            return found.y
        trial = assemble(hard, first + rng.normal(scale=0.1 * 1.5**attempt, size=first.size), soft)
        found = trial if trial.converged or trial.gap < found.gap else found
    residual = hard(found.y)[0]
    n = closing.numel()
    gaps: list[str] = []
    for target in exact:
        gap = float(np.max(np.abs(residual[n : n + target.wanted.size])))
        gaps.append(f"{target.name} = {target.wanted} (off by {gap:.3g})")
        n += target.wanted.size
    raise StartValueError(
        f"The {what} start values contradict each other or the constraints: {'; '.join(gaps) or 'none was given'}; the constraints are open "
        f"by {float(np.max(np.abs(residual[: closing.numel()]), initial=0.0)):.3g}. Give fewer exact values, or soften some with ac.near(...)."
    )


def _difference(target: _Target) -> ca.SX:
    difference = target.expression - ca.DM(target.wanted)
    return ca.atan2(ca.sin(difference), ca.cos(difference)) if target.periodic else difference


def _residual(y: ca.SX, fixed: ca.SX, values: np.ndarray, residual: ca.SX) -> Residual:
    function = ca.Function("residual", [y, fixed], [ca.densify(residual), ca.densify(ca.jacobian(residual, y))])

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, J = function.call([ca.DM(point), ca.DM(values)])
        return np.array(c).ravel(), np.array(J)

    return evaluate


def _with_plain_values(y: ca.SX, targets: list[_Target], guess: np.ndarray) -> np.ndarray:
    """Targets that are coordinates themselves go straight into the guess, so that large angles need no search."""
    place = {y[i].element_hash(): i for i in range(y.numel())}
    first = guess.copy()
    for target in targets:
        for k in range(target.expression.numel()):
            entry = target.expression[k]
            if entry.is_symbolic() and entry.element_hash() in place:
                first[place[entry.element_hash()]] = target.wanted[k]
    return first


def _met(
    target: _Target, t: ca.SX, x: ca.SX, u: ca.SX, p: ca.SX, t0: float, x0: np.ndarray, u0: np.ndarray, p0: np.ndarray
) -> Met:
    got = ca.Function("got", [t, x, u, p], [ca.densify(target.expression)])(t0, x0, u0, p0)
    return Met(target.name, target.wanted, np.array(got).ravel(), target.exact)
