"""States that users give as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import StartValueError
from acausal.language.expression import Expression
from acausal.numerics.rounding import Rounding
from acausal.numerics.sizes import Drawn, unknown_sizes
from acausal.numerics.thresholds import CLOSED, GIVEN, ROUNDING
from acausal.outputs.functions import Functions
from acausal.start.coordinates import turning_states


def finite_states(names: Sequence[str], x: Any) -> np.ndarray:
    """States (nx,) with these names from anything like an array. Raises `StartValueError` for another number of them, and for what is not finite."""
    try:
        states = np.array(x, dtype=float).ravel()
    except (TypeError, ValueError, OverflowError):
        states = np.zeros(0)
    if states.size != len(names) or not np.isfinite(states).all():
        raise StartValueError(
            f"The states must be {len(names)} finite numbers, not {x!r}: {', '.join(names[:12])}. Or give start={{variable: value}}."
        )
    return states


def consistent_states(functions: Functions, x: Any, t: float, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """All states (nx,) from anything like an array, at time t [s], inputs u (nu,) and parameters p (np,).

    Raises `StartValueError` for another number of them, for what is not finite, and where the constraints are violated.
    """
    states = finite_states(functions.state_names, x)
    gaps = np.zeros(0) if functions.invariants is None else np.array(functions.invariants(t, states, u, p)).ravel()
    off = np.flatnonzero(~(np.abs(gaps) <= _allowed(functions, t, states, u, p))) if gaps.any() else np.zeros(0, dtype=int)
    if off.size:
        raise StartValueError(
            f"The states {states} violate the constraints by {np.max(np.abs(gaps[off])):.3g} (loops, lengths of quaternions, or their rates). Take them "
            "from model.initial_state or a simulation, or give values of the independent variables, start={variable: value}: the others follow."
        )
    return states


def _allowed(functions: Functions, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """For each invariant (n,) a small part of what turns by 1, lengths by as much as these move, and the velocities make of it; and less of what
    all velocities would make of it if they were as fast as the fastest.
    """
    rows, space = functions.invariants, functions.space
    assert rows is not None
    symbols = rows.sx_in()
    slopes = ca.Function("slopes", symbols, [ca.densify(ca.jacobian(rows(*symbols), symbols[1]))])
    J, nq = np.abs(np.nan_to_num(np.array(slopes(t, x, u, p)))), space.nq
    turns, turn_rates = turning_states(space.system)
    turns = np.concatenate([turns, turn_rates])[list(space.places)]
    own, exact = J @ np.abs(x), Drawn.exact(J.shape[0])
    lengths, speeds = (unknown_sizes(J[:, of], turns[of], own, exact) for of in (slice(nq), slice(nq, None)))
    fastest = np.max(np.abs(x[nq:]) / speeds, initial=0.0)
    noise = CLOSED * fastest * (J[:, nq:] @ speeds) + ROUNDING / np.finfo(float).eps * np.nan_to_num(Rounding(rows)(t, x, u, p))
    return GIVEN * (J[:, :nq] @ lengths + J[:, nq:] @ np.abs(x[nq:])) + noise


def start_values(functions: Functions, x: np.ndarray) -> dict[Expression, np.ndarray]:
    """All coordinates, velocities and scalar states of the states x (nx,), as start values of a simulation."""
    s = functions.outputs.system
    rates = x[s.nq : s.nq + s.tree_velocities]
    values: dict[Expression, np.ndarray] = {joint.edge.joint.q: x[joint.q] for joint in s.tree_joints}
    values |= {joint.edge.joint.v: rates[joint.v] for joint in s.tree_joints}
    values |= {state: x[[i]] for i, state in zip(s.scalar_places, s.scalar_states, strict=True)}
    return {key: value for key, value in values.items() if value.size}
