"""Assembly as a CasADi function: the consistent start, or outputs of it, with exact derivatives of any order.

Around a reference that was found by search, the consistent states y are the zeros of a square, regular system:

    U' c(y, d) = 0        as many combinations of the constraints as are independent
    B' r(y, d) = 0        combinations of the near values that the freedom left can meet
    Z' (y - y0) = 0       what is then still free stays, so that y changes as little as it can
    y_k = y0_k            states of scalar parts that others follow from stay in any case

with the reference's left singular vectors U of dc/dy and B of dr/dy on its null space, and Z the rest. CasADi's `fast_newton` finds
them along a straight way from the reference's data d to those asked for, in steps as short as it takes, and gives derivatives by the
implicit function theorem.
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
from acausal.numerics.sizes import Drawn, row_sizes
from acausal.numerics.terms import rounded
from acausal.numerics.thresholds import DEPENDENT
from acausal.outputs.functions import Functions
from acausal.outputs.outputs import Outputs
from acausal.start.decided import check_decided
from acausal.start.initial import InitialState, Start
from acausal.start.situation import Situation
from acausal.start.start_problem import places_in_start
from acausal.start.start_search import Search
from acausal.start.unknowns import Found

_OPEN = 1e-9
"""Largest residual that counts as closed, where the derivatives of each row by y in its own units have length 1; of velocities, times theirs."""
_JUMP = 1.0
"""Largest turn [rad] in one step of the way; more may be another branch."""
_TRIALS = 200
_SHORTEST = 1e-5
"""Steps that are tried on the way, and the part of it that is too short to go on."""


def assembly_function(
    functions: Functions, at: Situation, result: Expression | ca.SX | None, wrt: Sequence[Expression], steps: int, name: str
) -> ca.Function:
    """The values of `wrt` (n,) -> `result` column by column; see `Model.assembly_function`."""
    steps, name = whole_number(steps, "assembly_function: steps", 1), function_name(name, "assembly_function: the name")
    if result is not None and not isinstance(result, Expression | ca.SX):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise OptionError(
            f"assembly_function: the outputs are {result!r}. Give a variable or an expression, or None for all states."
        )
    outputs, sizes = functions.outputs, (functions.outputs.system.u.numel(), at.p.size)
    reference = at.initial(functions)
    check_decided(outputs.system, at.t0, reference.x, at.p)
    result = functions.space.x if result is None else result
    places = _places(outputs, wrt, at.start)
    data = reference.account.data
    values = ca.MX.sym("values", len(places))
    asked = ca.MX(ca.DM(data)) + ca.mtimes(ca.DM(np.eye(data.size)[:, places]), values - ca.DM(data[places]))
    x = assembled(reference, asked, steps)
    r = outputs.system
    seen = folded_function("seen", [r.t, r.x, r.u, r.p], [ca.vec(ca.densify(outputs.resolve(result)))])
    _, t, u, p = ca.vertsplit(asked, np.cumsum([0, data.size - 1 - sum(sizes), 1, *sizes]).tolist())
    return ca.Function(name, [values], [seen(t, x, u, p)], ["values"], ["outputs"])


def assembled(reference: InitialState, asked: ca.MX, steps: int = 8) -> ca.MX:
    """The consistent states of the system at other data (start values, t0, u, p) than those of the reference; NaN where there are none.

    They are followed in steps that grow and shrink with how far they lead; the first is one of `steps`. One alone is not followed.
    """
    a = reference.account
    here, began = ca.MX(ca.DM(a.data)), ca.MX(ca.DM(a.positions.y))
    scale, scale_v = start_units(reference)
    positions = _stage(a.problem.positions, a.positions, a.data, a.weights, scale)
    moving = np.concatenate([a.data, a.positions.y])
    turns = np.zeros(a.positions.y.size)
    for c in a.problem.coordinates.all:
        turns[c.place] = float(c.turns)
    way = _Way(positions, ca.DM(turns))
    if steps > 1 and positions.solve is not None:
        began = way.travelled(began, here, asked, steps)
    q, right = way.step(began, asked)
    whole = ca.vertcat(asked, q)
    given = _untorn(reference, moving, whole, steps)
    velocities = _stage(a.problem.velocities, a.velocities, moving, a.weights, scale_v, list(given))
    v, good = velocities.step(ca.MX(ca.DM(a.velocities.y)), ca.vertcat(whole, *given.values()))
    return ca.if_else(
        ca.logic_and(right, good), ca.vertcat(q, v), ca.DM.nan(reference.account.positions.y.size + a.velocities.y.size)
    )


def _places(outputs: Outputs, wrt: Sequence[Expression], start: Start) -> list[int]:
    """Where the values of `wrt` are in the data (start values, t0, u, p). Raises `OptionError` for anything else."""
    flat = outputs.system.flat
    n = sum(outputs.resolve(key).numel() for key in start)
    places: list[int] = []
    for item in wrt:
        if isinstance(item, Parameter) and item in flat.parameters:
            places.append(n + 1 + len(flat.inputs) + flat.parameters.index(item))
        elif isinstance(item, Input) and item in flat.inputs:
            places.append(n + 1 + flat.inputs.index(item))
        elif found := places_in_start(item, start):
            places += found
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


def start_units(reference: InitialState) -> tuple[np.ndarray, np.ndarray]:
    """What is much for each entry of q, and the velocities that change q by as much in a second; scalar states as they are."""
    a = reference.account
    s = a.problem.outputs.system
    tree, scale = s.mechanics.tree, a.problem.measured(a.data).scale
    N = ca.Function("N", [s.t, tree.q, s.p], [ca.densify(ca.jacobian(tree.rates, tree.v))])
    first = a.data.size - s.p_values.size - s.u_defaults.size - 1
    n = tree.q.numel()
    change = np.abs(np.array(N(a.data[first], a.positions.y[:n], a.data[a.data.size - s.p_values.size :]))) / scale[:n, None]
    fastest = np.max(change, axis=0, initial=0.0)
    fastest[fastest == 0.0] = 1.0
    return scale, np.concatenate([1 / fastest, np.ones(a.velocities.y.size - fastest.size)])


def row_lengths(J: np.ndarray, search: Search) -> np.ndarray:
    """Of each row of J (m, n), (m,), the first ones of a search; where one vanishes that of the longest of its kind, shift or turn."""
    drawn = Drawn.exact(len(J)) if search.whole is None else search.whole.drawn.of(range(len(J)))
    size, none = np.linalg.norm(J, axis=1), np.zeros(len(J))
    usual = row_sizes(np.abs(J), np.ones(J.shape[1]), none, drawn)
    return np.where(size > DEPENDENT * usual, size, usual)


def _lengths(J: ca.SX, scale: np.ndarray, size: np.ndarray, known: np.ndarray) -> ca.SX:
    """Of each row of J(data), columns in units of `scale`, (m, 1): `size` at the reference; one that vanishes there grows with the longest."""
    if not known.any():
        return ca.SX(ca.DM(size))
    rows = [ca.norm_2(ca.densify(J[i, :]).T * ca.DM(scale)) for i in range(size.size)]
    most = int(np.argmax(np.where(known, size, 0.0)))
    return ca.vertcat(*(rows[i] if known[i] else float(size[i] / size[most]) * rows[most] for i in range(size.size)))


@dataclass(frozen=True)
class _Stage:
    """Positions or velocities: how y follows from the data (for velocities: and q) near the reference.

    `plain`: data -> y where start values say it all. Else `solve`: (y to begin with, data) -> y, and `open`: (y, data) -> what is
    negative where everything closes; `side`: (y, data) -> positive on the branch that is meant.
    """

    plain: ca.Function
    solve: ca.Function | None = None
    open: ca.Function | None = None
    side: ca.Function | None = None

    def step(self, y: ca.MX, data: ca.MX) -> tuple[ca.MX, ca.MX]:
        """y at the data, begun at another, and whether it is right; NaN is not."""
        if self.solve is None or self.open is None:
            return _called(self.plain, data), ca.MX(1)
        y = _called(self.solve, y, data)
        right = _called(self.open, y, data) <= 0
        if self.side is not None:
            right = ca.logic_and(right, ca.mmin(_called(self.side, y, data)) > 0)
        return y, right


def _called(function: ca.Function, *arguments: ca.MX) -> ca.MX:
    return function.call(list(arguments))[0]


def _stage(
    search: Search, found: Found, data: np.ndarray, weights: np.ndarray, scale: np.ndarray, given: Sequence[int] = ()
) -> _Stage:
    """From a search and what it found at the reference; values of those entries of y that are `given` stand behind the data. All that is decided or solved by numbers is without unit: y in units of `scale`,
    each row divided by the length of its derivatives at the reference, with the data that are asked for: they may have other dimensions.
    """
    y, d, values = (ca.SX.sym(name, n) for name, n in (("y", found.y.size), ("data", data.size), ("given", len(given))))
    first = ca.SX(ca.DM(found.first))
    for i, k in search.plain:
        first[i] = d[k]
    for k, i in enumerate(given):
        first[i] = values[k]
    whole = ca.vertcat(d, values)
    plain = ca.Function("plain", [whole], [first])
    if search.residual is None:
        return _Stage(plain)
    J = search.jacobian(found.y, data) * scale
    size = row_lengths(J, search)
    rows = search.residual(y, d)
    slopes = ca.substitute(ca.jacobian(rows, y), y, ca.SX(ca.DM(found.y)))
    c = rows / _lengths(slopes, scale, size, size == np.linalg.norm(J, axis=1))
    stays = [list(still) for still in search.staying if np.array_equal(found.y[list(still)], found.first[list(still)])]
    staying: list[int] = stays[0] if stays else []
    still = sorted({*staying, *given})
    follow = np.delete(np.arange(found.y.size), still)
    if given:  # what these follow from holds as it was written, which nested rows show less well
        by = ca.DM(ca.jacobian_sparsity(rows, y), 1).full() > 0
        met = np.flatnonzero(by[:, list(given)].any(axis=1) & ~by[:, follow].any(axis=1)).tolist()
        J[met], c[met, :] = 0.0, 0
    U, Z = range_and_null_space((J / size[:, None])[:, follow])
    Z = np.eye(found.y.size)[:, follow] @ Z
    square = [ca.mtimes(ca.DM(U.T), c), (y[still, :] - first[still, :]) / ca.DM(scale[still])]
    if search.wish is not None:
        r, factors = search.wish(y, d, first), search.wish_weights(data, found.first, weights)[:, None]
        wished = factors * search.wish_jacobian(found.y, data, found.first) * scale
        most = float(np.max(np.linalg.norm(wished, axis=1), initial=0.0)) or 1.0
        B, still = range_and_null_space(wished / most @ Z)
        square.append(ca.mtimes(ca.DM((factors / most * B).T), r))
        Z = Z @ still
    square.append(ca.mtimes(ca.DM(Z.T), (y - ca.DM(found.y)) / ca.DM(scale)))
    solve = _solver(ca.vertcat(*square), y, whole, ca.DM(scale))
    much = ca.sumsqr(y / ca.DM(scale)) if search.what == "velocity" else 1
    gap = folded_function("open", [y, whole], [ca.sumsqr(c) - _OPEN**2 * much])
    return _Stage(plain, solve, gap, search.side)


def _untorn(reference: InitialState, here: np.ndarray, asked: ca.MX, steps: int) -> dict[int, ca.MX]:
    """Entries of the velocities that follow from others by nonlinear blocks of scalar parts, as these were written; NaN where they cannot be found.

    `here`: data of velocities, and q, at the reference.
    """
    a = reference.account
    search, y = a.problem.velocities, a.velocities.y
    begun, given = ca.MX(ca.DM(y)), dict[int, ca.MX]()
    for i, k in search.plain:
        begun[i] = asked[k]
    for untorn in search.untorn:
        z = untorn.at(y, here)
        if z is None:
            continue
        block, known = untorn.block, np.concatenate([y, here])
        scale = np.maximum(np.abs(z), block.sizes(np.concatenate([known, z]), z, np.zeros(0))[0].unknowns)
        J = block.constraints(z, np.concatenate([known, z]))[1]
        size = np.linalg.norm(J * scale, axis=1)
        c = block.hard / ca.DM(np.where(size > 0, size, 1.0))
        off = ca.mmax(
            ca.fabs(block.hard) - _OPEN * rounded(block.hard)
        )  # of their terms: at the reference all of these may be zero
        gap = folded_function("open", [block.unknowns.y, block.unknowns.data], [off])
        stage = _Stage(gap, _solver(c, block.unknowns.y, block.unknowns.data, ca.DM(scale)), gap)
        way, there = _Way(stage, ca.DM(0, 1)), ca.vertcat(begun, asked)
        first = way.travelled(ca.MX(ca.DM(z)), ca.MX(ca.DM(known)), there, steps) if steps > 1 else ca.MX(ca.DM(z))
        found, right = stage.step(first, there)
        for k, place in untorn.torn:
            begun[place] = given[place] = ca.if_else(right, found[k], ca.DM.nan())
    return given


def _solver(rows: ca.SX, y: ca.SX, d: ca.SX, scale: ca.DM) -> ca.Function:
    """(y to begin with, data) -> y where all rows are zero: at once where they are linear, else by Newton's method in units of `scale`."""
    begun, data = ca.MX.sym("begun", y.numel()), ca.MX.sym("data", d.numel())
    unit = ca.SX.sym("unit", y.numel())
    square = ca.densify(ca.substitute(rows, y, scale * unit))
    J = ca.jacobian(square, unit)
    if not ca.depends_on(J, unit):
        linear = ca.Function(
            "linear", [d], [ca.densify(J), ca.substitute(square, unit, ca.SX.zeros(unit.numel()))], {"cse": True}
        )
        A, b = linear.call([data])
        return ca.Function("close", [begun, data], [scale * -ca.solve(A, b, "qr")])
    options: dict[str, Any] = {"abstol": 1e-14, "abstolStep": 1e-15, "max_iter": 30, "error_on_fail": False}
    newton = ca.rootfinder("newton", "fast_newton", ca.Function("square", [unit, d], [square], {"cse": True}), options)
    return ca.Function("close", [begun, data], [scale * _called(newton, begun / scale, data)])


@dataclass(frozen=True)
class _Way:
    """Positions on the way from the reference; `turns` (nq,): 1 for angles and quaternions, whose change in a step is watched."""

    positions: _Stage
    turns: ca.DM

    def step(self, q: ca.MX, data: ca.MX) -> tuple[ca.MX, ca.MX]:
        """q at the data, begun at another, and whether it is right."""
        moved, right = self.positions.step(q, data)
        if not self.turns.numel():  # scalar states only
            return moved, right
        return moved, ca.logic_and(right, ca.mmax(ca.fabs(self.turns * (moved - q))) < _JUMP)

    def travelled(self, q0: ca.MX, here: ca.MX, asked: ca.MX, steps: int) -> ca.MX:
        """q near the data that are asked for: as far as steps lead that are doubled after each one that is right, and quartered after others.
        It has no derivatives: it is only where the last step begins.
        """
        n, m = q0.numel(), asked.numel()
        state = ca.MX.sym("state", n + 2 + m)
        q, s, h, to = ca.vertsplit(state, [0, n, n + 1, n + 2, n + 2 + m])
        there = ca.fmin(1, s + h)
        moved, right = self.step(q, here + there * (to - here))
        tried = ca.vertcat(ca.if_else(right, moved, q), ca.if_else(right, there, s), ca.if_else(right, 2 * h, h / 4), to)
        trial = ca.Function("trial", [state], [tried])
        going = ca.logic_and(s < 1, h > _SHORTEST)
        one = ca.Function("one", [state], [ca.if_else(going, _called(trial, state), state, True)])
        end = ca.MX.sym("end", m)
        ended = _called(one.fold(_TRIALS), ca.vertcat(q0, 0, 1 / steps, end))
        whole = ca.Function("way", [end], [ended[:n]], {"is_diff_in": [False]})
        return _called(whole, asked)
