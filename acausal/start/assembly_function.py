"""Assembly as a CasADi function: the consistent start, or outputs of it, with exact derivatives of any order.

Around a reference that was found by search, the consistent states y are the zeros of a square, regular system:

    U' c(y, d) = 0        as many combinations of the constraints as are independent
    B' r(y, d) = 0        combinations of the near values that the freedom left can meet
    Z' (y - y0) = 0       what is then still free stays, so that y changes as little as it can

with the reference's left singular vectors U of dc/dy and B of dr/dy on its null space, and Z the rest. CasADi's `fast_newton` finds
them along a straight way from the reference's data d to those asked for, and gives derivatives by the implicit function theorem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arguments import function_name, whole_number
from acausal.errors import OptionError
from acausal.language.expression import Expression, Input, Parameter, Symbol
from acausal.numerics.assembly import range_and_null_space
from acausal.numerics.folding import folded_function
from acausal.outputs.outputs import Outputs
from acausal.start.initial import InitialState, Start, initial_state
from acausal.start.start_search import Found, Search

_OPEN = 1e-9
"""Largest residual that counts as closed, times the largest entry of the Jacobian where that is above 1."""
_JUMP = 1.0
"""Largest turn [rad] in one step of the way; more may be another branch."""


def assembly_function(
    outputs: Outputs,
    result: Expression | ca.SX | None,
    wrt: Expression | Sequence[Expression],
    start: Start,
    t0: float,
    p: np.ndarray,
    u: np.ndarray,
    steps: int,
    name: str,
) -> ca.Function:
    """The values of `wrt` (n,) -> `result` column by column; see `Model.assembly_function`."""
    steps, name = whole_number(steps, "assembly_function: steps", 1), function_name(name, "assembly_function: the name")
    if result is not None and not isinstance(result, Expression | ca.SX):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise OptionError(
            f"assembly_function: the outputs are {result!r}. Give a variable or an expression, or None for all states."
        )
    reference = initial_state(outputs, start, t0, p, u)
    places = _places(outputs, (wrt,) if isinstance(wrt, Expression) else wrt, start)
    data = reference.account.data
    values = ca.MX.sym("values", len(places))
    way = _way(reference)
    here = ca.MX(ca.DM(data))
    asked = here + ca.mtimes(ca.DM(np.eye(data.size)[:, places]), values - ca.DM(data[places]))
    q0, v0 = ca.MX(ca.DM(reference.account.positions.y)), ca.MX(ca.DM(reference.account.velocities.y))
    q, v, right = q0, v0, ca.MX(1)
    for k in range(1, steps):
        q, v, right = way.step(q, v, here + (k / steps) * (asked - here), right)
    if steps > 1:
        # only the last step has derivatives: where Newton's method begins does not matter
        begun = ca.Function("way", [values], [q, v, right], {"is_diff_in": [False]})
        q, v, right = begun.call([values])
    q, v, right = way.step(q, v, asked, right)
    x = ca.if_else(right, ca.vertcat(q, v), ca.DM.nan(reference.x.size))
    if result is None:
        return ca.Function(name, [values], [x], ["values"], ["x"])
    r = outputs.system
    seen = folded_function("seen", [r.t, r.x, r.u, r.p], [ca.vec(ca.densify(outputs.resolve(result)))])
    n = data.size - 1 - u.size - p.size
    return ca.Function(
        name, [values], [seen(asked[n], x, asked[n + 1 : n + 1 + u.size], asked[n + 1 + u.size :])], ["values"], ["outputs"]
    )


def _places(outputs: Outputs, wrt: Sequence[Expression], start: Start) -> list[int]:
    """Where the values of `wrt` are in the data (start values, t0, u, p). Raises `OptionError` for anything else."""
    flat = outputs.system.flat
    offset: dict[Expression, tuple[int, int]] = {}
    n = 0
    for key in start:
        size = outputs.resolve(key).numel()
        offset[key] = (n, size)
        n += size
    places: list[int] = []
    for item in wrt:
        if isinstance(item, Parameter) and item in flat.parameters:
            places.append(n + 1 + len(flat.inputs) + flat.parameters.index(item))
        elif isinstance(item, Input) and item in flat.inputs:
            places.append(n + 1 + flat.inputs.index(item))
        elif isinstance(item, Expression) and item in offset:  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass names
            places += range(offset[item][0], sum(offset[item]))
        else:
            known = [*flat.parameters, *flat.inputs, *start]
            names = [outputs.name(k) if isinstance(k, Symbol) else repr(k) for k in known]
            raise OptionError(
                f"assembly_function: {item!r} in wrt is neither a parameter nor an input of the scene, nor has it a value in `start`. "
                f"There are: {', '.join(names) or 'none'}."
            )
    if not places:
        raise OptionError("assembly_function: wrt is empty. Give parameters, inputs or variables that have a value in `start`.")
    if len(set(places)) < len(places):
        raise OptionError("assembly_function: something stands twice in wrt.")
    return places


@dataclass(frozen=True)
class _Stage:
    """Positions or velocities: how y follows from the data (for velocities: and q) near the reference.

    `plain`: data -> y where start values say it all. Else `solve`: (y to begin with, data) -> y, and `gap`: (y, data) -> sum of the
    squares of everything that must close, at most `enough`; `side`: (y, data) -> positive on the branch that is meant.
    """

    plain: ca.Function
    solve: ca.Function | None = None
    gap: ca.Function | None = None
    enough: float = 0.0
    side: ca.Function | None = None

    def step(self, y: ca.MX, data: ca.MX) -> tuple[ca.MX, ca.MX]:
        """y at the data, begun at another, and whether it is right; NaN is not."""
        if self.solve is None or self.gap is None:
            return _called(self.plain, data), ca.MX(1)
        y = _called(self.solve, y, data)
        right = _called(self.gap, y, data) <= self.enough
        if self.side is not None:
            right = ca.logic_and(right, ca.mmin(_called(self.side, y, data)) > 0)
        return y, right


def _called(function: ca.Function, *arguments: ca.MX) -> ca.MX:
    return function.call(list(arguments))[0]


def _stage(search: Search, found: Found, data: np.ndarray, weights: np.ndarray) -> _Stage:
    """From a search and what it found at the reference."""
    y, d = ca.SX.sym("y", found.y.size), ca.SX.sym("data", data.size)
    first = ca.SX(ca.DM(found.first))
    for i, k in search.plain:
        first[i] = d[k]
    plain = ca.Function("plain", [d], [first])
    if search.residual is None:
        return _Stage(plain)
    c = search.residual(y, d)
    J = search.jacobian(found.y, data)
    U, Z = range_and_null_space(J)
    rows = [ca.mtimes(ca.DM(U.T), c)]
    if search.wish is not None:
        r = search.wish(y, d, first)
        factors = search.wish_factors(weights)[:, None]
        B, still = range_and_null_space(factors * search.wish_jacobian(found.y, data, found.first) @ Z)
        rows.append(ca.mtimes(ca.DM((factors * B).T), r))
        Z = Z @ still
    rows.append(ca.mtimes(ca.DM(Z.T), y - ca.DM(found.y)))
    size = max(1.0, float(np.max(np.abs(J), initial=0.0)))
    square = folded_function("square", [y, d], [ca.densify(ca.vertcat(*rows))])
    options: dict[str, Any] = {"abstol": 1e-14 * size, "abstolStep": 1e-15, "max_iter": 30, "error_on_fail": False}
    solve = ca.rootfinder("close", "fast_newton", square, options)
    gap = folded_function("gap", [y, d], [ca.sumsqr(c)])
    return _Stage(plain, solve, gap, (_OPEN * size) ** 2, search.side)


@dataclass(frozen=True)
class _Way:
    """Steps from the reference; `turns` (nq,): 1 for angles and quaternions, whose change in a step is watched."""

    positions: _Stage
    velocities: _Stage
    turns: np.ndarray

    def step(self, q: ca.MX, v: ca.MX, data: ca.MX, right: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """q and v at the data, and whether everything was right on the way."""
        moved, good = self.positions.step(q, data)
        right = ca.logic_and(right, good)
        if self.turns.any():
            right = ca.logic_and(right, ca.mmax(ca.fabs(ca.DM(self.turns) * (moved - q))) < _JUMP)
        v, good = self.velocities.step(v, ca.vertcat(data, moved))
        return moved, v, ca.logic_and(right, good)


def _way(reference: InitialState) -> _Way:
    a = reference.account
    moving = np.concatenate([a.data, a.positions.y])
    turns = np.zeros(a.positions.y.size)
    for c in a.problem.coordinates.all:
        turns[c.place] = float(c.unit == "rad")
    return _Way(
        _stage(a.problem.positions, a.positions, a.data, a.weights),
        _stage(a.problem.velocities, a.velocities, moving, a.weights),
        turns,
    )
