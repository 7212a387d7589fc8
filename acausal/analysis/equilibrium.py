"""Equilibria and steady motions near a start, with inputs and parameters found that hold them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from acausal.analysis.conditions import Steady, Unknowns, conditions, unknowns
from acausal.analysis.mode_at import mode_words
from acausal.analysis.nearest import NearestRoot, Root, largest_gaps
from acausal.analysis.point import Differentiable, OperatingPoint, operating_point
from acausal.analysis.resting import resting
from acausal.analysis.state_sizes import ROUNDING, UNCHANGED, Sizes, before_and_after, sizes_at
from acausal.errors import EquilibriumError, OptionError
from acausal.language.expression import Expression, Input, Parameter
from acausal.numerics.assembly import freedom
from acausal.numerics.one_thread import on_one_thread
from acausal.numerics.thresholds import EDGE
from acausal.outputs.functions import Functions
from acausal.outputs.infinite import forces_without_value, without_value
from acausal.reduce.reduce import ReducedSystem
from acausal.start.situation import Situation
from acausal.start.start_values import softened
from acausal.start.states import start_values
from acausal.wording import compact

if TYPE_CHECKING:
    from acausal.analysis.linearize import Linearization

_STARTS = 8
_STEP = 0.7
_SINK = 0.1
_SINKING = 200
_MOVED = 1e-9
_RANK = 1e-8


@dataclass(frozen=True, repr=False)
class Equilibrium:
    """States, inputs and parameters in which nothing moves, or what was asked for is steady.

    `functions`: of the states `x` of the model; `whole`: of all coordinates of the tree, which `point` has.

    `residual`: the largest rate that is left. `free`: variables along which there are more equilibria, to first order, and `dimension`
    of their family; this one is the nearest to the start. `lasting`: a steady motion stays as it is; otherwise the conditions hold
    at this instant only. `began`: the consistent states where the search began; `sizes`: of states, inputs and parameters, what is much for each.
    `steady`: expressions that are steady in a motion. `equilibrium[expression]` is the value of any
    expression, reactions included.
    """

    functions: Functions
    whole: Functions
    point: OperatingPoint
    began: OperatingPoint
    sizes: np.ndarray
    residual: float
    free: tuple[str, ...]
    dimension: int
    lasting: bool
    steady: ca.SX

    @property
    def x(self) -> np.ndarray:
        """States of the model (nx,)."""
        return self.functions.space.restricted(self.point.x)

    def __getitem__(self, wanted: Expression) -> np.ndarray:
        """Value of an expression; a number for a scalar, else an array of its shape."""
        at = self.point
        value = np.array(self.whole.output(wanted)(at.t, at.x, at.u, at.p))
        return value[0, 0] if value.size == 1 else value[:, 0] if value.shape[1] == 1 else value

    @property
    def start(self) -> dict[Expression, np.ndarray]:
        """Start values for `simulate`: all coordinates and velocities."""
        return start_values(self.whole, self.point.x)

    @property
    def inputs(self) -> dict[Input, float]:
        """Values of all inputs, for `simulate`."""
        return dict(zip(self.functions.outputs.system.flat.inputs, map(float, self.point.u), strict=True))

    @property
    def parameters(self) -> dict[Parameter, float]:
        """Values of all parameters, for `simulate`."""
        return dict(zip(self.functions.outputs.system.flat.parameters, map(float, self.point.p), strict=True))

    def linearize(self, *, states: Sequence[Expression] | None = None, outputs: Sequence[Expression] = ()) -> Linearization:
        """The linear system here; see `Model.linearize`."""
        from acausal.analysis.linearize import linearize

        named = self.whole.outputs.system.flat.symbols
        return linearize(self.functions, self.whole, self.point, named(states), named(outputs))

    @functools.cached_property
    def stability(self) -> str:
        """ "asymptotically stable", "unstable" or "neutral" in first order. Of a steady motion in all its states, the ignorable ones too; where
        their linear system changes on the way, "unstable" if what was asked to be steady is, and "undecided" otherwise.
        """
        try:
            whole = self.linearize()
        except OptionError:  # a loop in a singular position
            return "undecided"
        if whole.constant or not self.lasting or not self.steady.numel():
            return whole.stability
        return "unstable" if self.steady_stability == "unstable" else "undecided"

    @functools.cached_property
    def steady_stability(self) -> str:
        """The same of what was asked to be steady alone, and of the rates of it that it needs: a distance, an angle of lean, a speed. What else
        changes may do anything. "undecided" where nothing was asked for, or where four rates are not enough.
        """
        from acausal.analysis.linearize import linearize_invariants

        part = linearize_invariants(self.whole, self.point, self.steady) if self.steady.numel() else None
        return "undecided" if part is None else part.stability

    @property
    def moved(self) -> tuple[tuple[str, float, float], ...]:
        """Name, start and value of every state, input and parameter that is not where the search began."""
        flat, name = self.functions.outputs.system.flat, self.functions.outputs.name
        names = [*self.whole.state_names, *map(name, flat.inputs), *map(name, flat.parameters)]
        rows = zip(names, _all(self.began), _all(self.point), self.sizes, strict=True)
        return tuple((n, float(a), float(b)) for n, a, b, size in rows if abs(a - b) > _MOVED * max(size, abs(a)))

    def __repr__(self) -> str:
        return f"<Equilibrium of {self.functions.outputs.system.flat.name}, residual {self.residual:.2g}>"

    def __str__(self) -> str:
        kind = "steady motion" if self.steady.numel() else "equilibrium"
        if not self.lasting:
            kind += " at this instant only: it does not go on; name more variables in `steady`"
        words = self.stability
        if words == "undecided" and self.steady_stability != "undecided":
            words += f" in all its states, {self.steady_stability} in what is steady"
        rows = [f"{self.functions.outputs.system.flat.name}: {kind}; largest rate left {self.residual:.2g}; stability: {words}"]
        rows += [f"  {n:<28} {a:>14.8g} -> {b:.8g}" for n, a, b in self.moved[:40]]
        mode = mode_words(self.functions.outputs.system, self.point.u)
        rows += [f"  {mode}"] if mode else []
        speeds = {*_speeds(self.whole)} & {name for name, began, _ in self.moved if began}
        if speeds and not self.steady.numel():
            lost = compact(name for name in self.whole.state_names if name in speeds)
            rows.append(
                f"  at rest, so speeds of the start are not kept: {lost}; for a steady motion name what stays as it is: steady=[...]"
            )
        if self.dimension:
            rows.append(f"  one of a family of dimension {self.dimension}, along {', '.join(self.free[:8])}")
        return "\n".join(rows)


def _speeds(functions: Functions) -> list[str]:
    """Names of the states that are velocities of joints, or rates of others."""
    system = functions.outputs.system
    first, count = system.nq, system.tree_velocities
    rates = {rate.element_hash() for rate in ca.vertsplit(system.x_dot) if rate.is_symbolic()}
    return [
        name
        for k, (name, state) in enumerate(zip(functions.state_names, ca.vertsplit(system.x), strict=True))
        if k >= first and (k < first + count or state.element_hash() in rates)
    ]


def _all(at: OperatingPoint) -> np.ndarray:
    return np.concatenate([at.x, at.u, at.p])


@on_one_thread
@np.errstate(all="ignore")
def equilibrium(
    own: Functions, functions: Functions, at: Situation, free: Sequence[Input | Parameter], steady: Steady
) -> Equilibrium:
    """Of a model's `own` states, by `functions` of all coordinates of the tree; see `Model.equilibrium`."""
    # only what is held must be met where the search begins
    began = operating_point(functions, replace(at, start=softened(at.start)))

    def search(here: OperatingPoint) -> tuple[OperatingPoint, np.ndarray]:
        found = _found(own, functions, at, free, steady, here)
        return found.point, found.sizes[: here.x.size]

    if functions.outputs.system.modes is not None:
        began = resting(functions, began, search, bool(steady))
    return _found(own, functions, at, free, steady, began)


def _found(
    own: Functions, functions: Functions, at: Situation, free: Sequence[Input | Parameter], steady: Steady, began: OperatingPoint
) -> Equilibrium:
    """From where the search begins, in the mode that its masks are of."""
    given = unknowns(functions, began, free)
    wanted = conditions(functions, at.start, steady)
    s = functions.outputs.system
    hard, soft, x_dot = Differentiable(s, wanted.hard), Differentiable(s, wanted.soft), Differentiable(s, s.x_dot)
    search = _search(given, hard, soft, sizes_at(s, x_dot, began), s.nq)
    elsewhere = _Elsewhere(functions)

    def astray(found: Root) -> str:
        return elsewhere.words(given.at(found.z)) if found.converged else ""

    found = search(_moving_as_asked(s, given, wanted.motion, search) if steady else given.z)
    first = astray(found)
    if (not found.converged or first) and not steady:
        found = _better(search(_let_down(functions, given, search, x_dot)), found, astray)
    if not found.converged or astray(found):
        found = _from_several_starts(search, given.z, s.nq, found, astray)
    if not found.converged or astray(found):
        lost = without_value(functions, began.t, began.x, began.u, began.p)
        begun = f" Where the search begins: {lost}" if lost else ""
        raise EquilibriumError(_complaint(functions, wanted.names, found, astray(found) or first, bool(steady)) + begun)
    if found.free.shape[1]:  # of a family the nearest, whatever way led to it
        nearer = search(given.z, begin=found.z)
        found = nearer if nearer.converged and not astray(nearer) else found
    point = given.at(_settled(found.z, search.scale, s.nq, s.x.numel()))
    balance = Differentiable(s, wanted.balance)
    residual = float(np.max(np.abs(balance.value(point)), initial=0.0))
    lasting = _goes_on(x_dot, balance, point, sizes_at(s, x_dot, point))
    names = _free_names(functions, given, found.free / search.scale[:, None])
    return Equilibrium(
        own,
        functions,
        point,
        began,
        _all_sizes(given, search.scale),
        residual,
        names,
        found.free.shape[1],
        lasting,
        wanted.invariants,
    )


class _Elsewhere:
    """Where equations hold, and the scene is not what it was built as."""

    def __init__(self, functions: Functions) -> None:
        self._functions = functions
        self._hinges = [rows for rows in functions.outputs.system.constraints.loops if rows.sign is not None]

    def words(self, at: OperatingPoint) -> str:
        """What is wrong there; empty where nothing is."""
        beyond = self._functions.beyond(at.t, at.x, at.u, at.p, EDGE)
        if beyond is not None:
            border, values = beyond
            return f"where {border.who} has no meaning. {border.told(values)}"
        for rows, sign in zip(self._hinges, self._signs([at.t, at.x, at.u, at.p]) if self._hinges else (), strict=True):
            if not np.all(np.array(sign) > EDGE):
                return (
                    f"where the loop closed by '{rows.edge.name}' ({rows.edge.joint.created_at}) is put together otherwise, with axes of this "
                    "joint that point against one another."
                )
        lost = forces_without_value(self._functions, at.t, at.x, at.u, at.p)
        return f"in a singular place. {lost}" if lost else ""

    @functools.cached_property
    def _signs(self) -> Callable[..., Any]:
        return self._functions.output(*(rows.sign for rows in self._hinges if rows.sign is not None), name="signs").call


def _settled(z: np.ndarray, scale: np.ndarray, first: int, last: int) -> np.ndarray:
    """Unknowns in which velocities, from `first` to before `last`, that are rounding errors are zero."""
    rates = np.arange(z.size)
    noise = (first <= rates) & (rates < last) & (np.abs(z) < ROUNDING * np.finfo(float).eps * scale)
    return np.where(noise, 0.0, z)


def _search(given: Unknowns, hard: Differentiable, soft: Differentiable, sizes: Sizes, nq: int) -> NearestRoot:
    """Coordinates change by at most 0.7 of their sizes at a time, parameters by half, other unknowns without a limit."""
    z = given.z
    n, m = given.point.x.size, len(given.inputs)
    rows = given.rows(hard)
    scale, limit = np.ones(z.size), np.full(z.size, np.inf)
    scale[:n], limit[:nq] = sizes.x, _STEP * sizes.x[:nq]
    J = np.abs(rows.jacobian(z))
    slope = np.max(J[:, :n] * scale[:n], axis=1, initial=0.0)
    weight = 1.0 / np.where(slope > 0, slope, 1.0)
    effect = np.max(weight[:, None] * J[:, n:], axis=0, initial=0.0)
    scale[n:] = 1.0 / np.where(effect > 0, effect, 1.0)
    for k in range(n + m, z.size):  # parameters enter nonlinearly, and most have a sign
        scale[k] = abs(z[k]) or scale[k]
        limit[k] = 0.5 * scale[k]
    return NearestRoot(rows, given.rows(soft) if soft.size else None, scale, limit)


def _moving_as_asked(s: ReducedSystem, given: Unknowns, motion: ca.SX, search: NearestRoot) -> np.ndarray:
    """The nearest place with the rates asked for, whatever forces that needs: forces are linear in rates no farther than nearby."""
    rows = given.rows(Differentiable(s, motion))
    found = NearestRoot(rows, None, search.scale, search.limit)(given.z)
    return found.z if found.converged else given.z


def _let_down(functions: Functions, given: Unknowns, search: NearestRoot, x_dot: Differentiable) -> np.ndarray:
    """Where the scene sinks from its start through honey: along the accelerations from rest, in steps that what is stiff does not shorten.

    Linearly implicit Euler, longer and longer where it goes on as it went, with slopes that push away taken as if they held back, so that it never climbs:
    C. T. Kelley, D. E. Keyes, Convergence analysis of pseudo-transient continuation, SIAM J. Numer. Anal. 35 (1998). The start itself, where it is pushed
    more and more, as into the centre of a field.
    """
    s = functions.outputs.system
    q, v = slice(0, s.nq), slice(s.nq, s.nq + s.tree_velocities)
    closing = Differentiable(s, s.closing)
    closed = NearestRoot(given.rows(closing), None, search.scale, search.limit)
    rates = Differentiable(s, ca.densify(s.mechanics.tree.rates))
    z, stride, before, longer, sizes = given.z.copy(), _SINK, np.zeros(s.tree_velocities), 1.0, search.scale[v]
    z[v] = 0.0
    start, pushes = z.copy(), list[float]()
    moving = np.zeros((s.x.numel(), s.tree_velocities))
    moving[v] = np.diag(sizes)
    for _ in range(_SINKING):
        at = given.at(z)
        push = x_dot.value(at)[v] / sizes
        pushes.append(float(np.linalg.norm(push)))
        if not np.isfinite(push).all():
            break
        turned = push @ before < 0
        stride, longer, before = (0.5 * stride, 0.1 * longer, push) if turned else (min(1.2 * stride, _SINK), 2.0 * longer, push)
        turn = np.zeros_like(moving)
        turn[q] = rates.along(at, moving)  # positions by velocities in their sizes
        A = closing.along(at, turn)
        most = np.max(np.abs(A), axis=1, initial=0.0, keepdims=True)
        free = freedom(A / np.where(most > 0, most, 1.0), _RANK)
        usual = float(np.max(np.abs(turn[q] @ push) / search.scale[q], initial=0.0))
        if not 0 < usual < np.inf or stride < 1e-3 * _SINK:
            break
        slope = free.T @ (x_dot.along(at, turn @ free)[v] / sizes[:, None])
        dq = turn[q] @ (free @ _held_back(slope, free.T @ push, longer * stride / usual))
        largest = float(np.max(np.abs(dq) / search.scale[q], initial=0.0))
        if not _MOVED < largest < np.inf:
            break
        moved = z.copy()
        moved[q] += min(stride / largest, 1.0) * dq
        found = closed(moved)
        if not found.converged:
            break
        z[q] = found.z[q]
    return z if len(pushes) < 2 or pushes[-1] < max(pushes[:-1]) else start


def _held_back(slope: np.ndarray, push: np.ndarray, time: float) -> np.ndarray:
    """(1 / time + |slope|)^-1 push, the size of a matrix being that of its eigenvalues; push alone where it has none."""
    if not np.isfinite(slope).all():
        return time * push
    values, vectors = np.linalg.eig(slope)
    try:
        return (vectors @ (np.linalg.solve(vectors, push) / (1 / time + np.abs(values)))).real
    except np.linalg.LinAlgError:
        return time * push


def _from_several_starts(search: NearestRoot, guess: np.ndarray, nq: int, found: Root, astray: Callable[[Root], str]) -> Root:
    """From places farther and farther away; the best of failures, `found` among them: what is `astray` is one."""
    rng = np.random.default_rng(0)
    for attempt in range(_STARTS):
        if found.converged and not astray(found):
            break
        trial = guess.copy()
        trial[:nq] += search.scale[:nq] * rng.normal(scale=0.1 * 1.5**attempt, size=nq)
        found = _better(search(trial), found, astray)
    return found


def _better(one: Root, other: Root, astray: Callable[[Root], str]) -> Root:
    """The one that is a root of the scene; of failures the one that misses by less, the other where both do: what is no number misses by most."""
    if one.converged != other.converged:
        return one if one.converged else other
    if one.converged:
        return other if astray(one) and not astray(other) else one
    miss, others = np.linalg.norm(one.parts), np.linalg.norm(other.parts)
    return one if miss < others or not np.isfinite(others) else other


def _goes_on(x_dot: Differentiable, balance: Differentiable, at: OperatingPoint, sizes: Sizes) -> bool:
    """Whether the conditions hold a little before and after, too: in first and second order of time."""
    size = np.max(np.abs(balance.along(at, np.eye(at.x.size))) * sizes.x, axis=1, initial=0.0)
    allowed = UNCHANGED * size + ROUNDING * balance.rounding(at, sizes.x)
    _, beside = before_and_after(x_dot, at, sizes)
    return all(bool(np.all(np.abs(balance.value(moved)) <= allowed)) for moved in beside)


def _all_sizes(given: Unknowns, scale: np.ndarray) -> np.ndarray:
    """Of states, all inputs and all parameters."""
    at, n, m = given.point, given.point.x.size, len(given.inputs)
    u, p = np.abs(at.u), np.abs(at.p)
    u[list(given.inputs)], p[list(given.parameters)] = scale[n : n + m], scale[n + m :]
    return np.concatenate([scale[:n], u, p])


def _free_names(functions: Functions, given: Unknowns, directions: np.ndarray) -> tuple[str, ...]:
    """Unknowns with a share in the free directions, largest first."""
    flat, name = functions.outputs.system.flat, functions.outputs.name
    names = [
        *functions.state_names,
        *(name(flat.inputs[i]) for i in given.inputs),
        *(name(flat.parameters[i]) for i in given.parameters),
    ]
    share = np.sum(directions**2, axis=1)
    return tuple(names[i] for i in np.argsort(-share, kind="stable") if share[i] > 1e-3)


def _complaint(functions: Functions, names: tuple[str, ...], found: Root, astray: str, steady: bool) -> str:
    what, scene = f"{'steady motion' if steady else 'equilibrium'}", functions.outputs.system.flat.name
    if astray:
        return f"No {what} of '{scene}' was found but one {astray} Begin nearer to another with start={{...}}."
    advice = (
        "The rates asked for may be impossible; begin nearer with start={...}, give None for a rate that is to be found, or free an input."
        if steady
        else "Something may push without an end (a body in free fall, a source that drives): hold it, give the inputs or parameters that are "
        "to balance it in free=[...], look for a motion with steady={...}, or begin nearer with start={...}."
    )
    return f"No {what} of '{scene}' was found. What cannot vanish: {largest_gaps(names, found.residual, found.parts)}. {advice}"
