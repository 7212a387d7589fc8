"""An operating point of a model, and exact directional derivatives of expressions there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.errors import StartValueError
from acausal.numerics.bound import Columns
from acausal.numerics.rounding import Rounding
from acausal.outputs.functions import Functions
from acausal.reduce.reduce import ReducedSystem
from acausal.start.situation import Situation
from acausal.start.states import consistent_states

_SAMPLES = 8


@dataclass(frozen=True)
class OperatingPoint:
    """Time `t` [s], states `x` (nx,), inputs `u` (nu,) and parameters `p` (np,) of a model."""

    t: float
    x: np.ndarray
    u: np.ndarray
    p: np.ndarray


def operating_point(functions: Functions, at: Situation, states: Sequence[float] | np.ndarray | None = None) -> OperatingPoint:
    """Consistent states from start values as for a simulation, or all `states` (nx,).

    Raises `StartValueError` when these have another length, or violate the constraints, and where what parts remember begins with no number.
    """
    u, given, modes = at.u(functions), at.discretes(functions), functions.modes
    x = at.initial(functions).x if states is None else consistent_states(functions, states, at.t0, u, at.p)
    if given is not None and given.size:
        assert modes is not None and modes.set is not None
        remembered = u[u.size - given.size :]
        for _ in range(given.size):  # what parts remember may be said by what others do
            begun = np.array(modes.set.values(at.t0, x, u, at.p)).ravel()[: given.size]
            remembered[:] = np.where(np.isnan(given), begun, given)
        lost = np.flatnonzero(~np.isfinite(remembered))
        if lost.size:
            raise StartValueError(modes.set.no_beginning(int(lost[0])))
    return OperatingPoint(at.t0, x, u, at.p)


class Differentiable:
    """A column of `SX` in t, x, u and p: its values and its derivatives along given directions, by forward differentiation."""

    def __init__(self, system: ReducedSystem, column: ca.SX) -> None:
        self.size = column.numel()
        arguments = [system.t, system.x, system.u, system.p]
        function = ca.Function("column", arguments, [ca.densify(column)]) if self.size else None  # seen too seldom to be folded
        self._values = None if function is None else Columns(function)
        self._rounding = None if function is None else Rounding(function)
        self._forward = None if function is None else Columns(function.forward(1))

    def value(self, at: OperatingPoint) -> np.ndarray:
        """(size,)."""
        return np.zeros(0) if self._values is None else self._values(at.t, at.x, at.u, at.p)

    def rounding(self, at: OperatingPoint, sizes: np.ndarray) -> np.ndarray:
        """What rounding makes of the values (size,): how they change when all arguments do by their rounding, that of states by the rounding
        of their `sizes` (nx,). By samples (More and Wild, *Estimating computational noise*, 2011).
        """
        if self._values is None:
            return np.zeros(0)
        x, u, p = (np.repeat(part[:, None], _SAMPLES, axis=1) for part in (at.x, at.u, at.p))
        shake, eps = np.random.default_rng(0), np.finfo(float).eps
        for part, size in ((x, np.maximum(np.abs(at.x), sizes)), (u, np.abs(at.u)), (p, np.abs(at.p))):
            part += eps * size[:, None] * shake.uniform(-2.0, 2.0, part.shape)
        t = at.t * (1 + eps * shake.uniform(-2.0, 2.0, (1, _SAMPLES)))
        values, here = self._values.at_once(t, x, u, p), self.value(at)
        found = np.max(np.abs(values - here[:, None]), axis=1)
        stays = (found == 0) & (here != 0)  # by arguments alone: what nothing moves may be rounding of its terms
        return np.where(stays, np.finfo(float).eps * self.terms(at), found) if stays.any() else found

    def terms(self, at: OperatingPoint) -> np.ndarray:
        """How large the terms are that the values are the sums of (size,), also where they cancel."""
        if self._values is None:
            return np.zeros(0)
        assert self._rounding is not None
        return self._rounding(at.t, at.x, at.u, at.p) / np.finfo(float).eps

    def along(
        self,
        at: OperatingPoint,
        dx: np.ndarray | None = None,
        *,
        dt: float = 0.0,
        du: np.ndarray | None = None,
        dp: np.ndarray | None = None,
    ) -> np.ndarray:
        """(size, k) for k changes: dx (nx, k), du (nu, k), dp (np, k), zero where not given; all together with the same `dt`."""
        k = next((d.shape[1] for d in (dx, du, dp) if d is not None), 1)
        if self._forward is None or k == 0:
            return np.zeros((self.size, k))
        point = (np.repeat(part[:, None], k, axis=1) for part in (np.array([at.t]), at.x, at.u, at.p, np.zeros(self.size)))
        seeds = (np.zeros((n.size, k)) if d is None else d for n, d in ((at.x, dx), (at.u, du), (at.p, dp)))
        return self._forward.at_once(*point, np.full((1, k), dt), *seeds)
