"""States that users give as numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from acausal.errors import StartValueError
from acausal.outputs.functions import Functions

_CONSISTENT = 1e-6


def consistent_states(functions: Functions, x: Any, t: float, p: np.ndarray) -> np.ndarray:
    """All states (nx,) from anything like an array, at time t [s] and parameters p (np,).

    Raises `StartValueError` for another number of them, for what is not finite, and where the constraints are violated.
    """
    names = functions.state_names
    try:
        states = np.array(x, dtype=float).ravel()
    except (TypeError, ValueError):
        states = np.zeros(0)
    if states.size != len(names) or not np.isfinite(states).all():
        raise StartValueError(
            f"The states must be {len(names)} finite numbers, not {x!r}: {', '.join(names[:12])}. Or give start={{variable: value}}."
        )
    gap = (
        0.0 if functions.invariants is None else float(np.max(np.abs(np.array(functions.invariants(t, states, p))), initial=0.0))
    )
    if not gap <= _CONSISTENT:
        raise StartValueError(
            f"The states {states} violate the constraints by {gap:.3g} (loops, lengths of quaternions, or their rates). Take them from "
            "model.initial_state or a simulation, or give values of the independent variables, start={variable: value}: the others follow."
        )
    return states
