"""The search for branches: many beginnings, clusters of where they end, and which of these are one branch."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from acausal.arguments import expressions, whole_number
from acausal.errors import OptionError
from acausal.language.expression import Expression
from acausal.numerics.assembly import Residual, assemble, freedom
from acausal.numerics.one_thread import on_one_thread
from acausal.numerics.sizes import Sizes, positive
from acausal.numerics.thresholds import RANK
from acausal.outputs.functions import Functions
from acausal.outputs.outputs import Outputs
from acausal.start.branches import Branch, Branches
from acausal.start.coordinates import Coordinates
from acausal.start.initial import Account, InitialState, finished, start_data
from acausal.start.same_branch import Walks
from acausal.start.situation import Situation
from acausal.start.start_problem import StartProblem
from acausal.start.start_search import Search
from acausal.start.unknowns import Found

_ENOUGH = 10
"""A search may end when each branch was found so often ..."""
_LEAST = 60
"""... and after so many beginnings."""
_SAME, _SAME_FREE = 1e-4, 1e-2
"""Largest distance of two that count as one: with no freedom left, and at the nearest points of a continuum."""
_TURNED = 1e-9
"""Gap, as part of a size, of a configuration whose angles lost full turns."""
_MET = 1e-5
_SKETCH = 1e-3
"""Weight of nearness to the sketch against near values."""


@on_one_thread
def branches(functions: Functions, at: Situation, by: Expression | Sequence[Expression], searches: int, seed: int) -> Branches:
    """Many searches from anywhere, then clusters; see `Model.branches`."""
    searches, seed = whole_number(searches, "branches: searches", 1), whole_number(seed, "branches: seed", 0)
    told = expressions([by] if isinstance(by, Expression) else by, "branches: `by`", "by=[scene.elbow.q]")
    first, u = at.initial(functions), at.u(functions)
    problem = first.account.problem
    weights, data = start_data(problem, at.start, at.t0, at.p, u)
    with problem.lock:
        seen = _seen(functions.outputs, told, at.t0, at.p, u, problem.positions, data) if told else None
        clusters, used, closed = _searched(first, seen, searches, seed)
        hunt = _Hunt(problem, clusters.coordinates, data, weights, np.random.default_rng(0))
        made, stopped = _branches(hunt, clusters, first)
    return Branches(tuple(made), used, closed, stopped)


def other_branches(state: InitialState, searches: int = 60) -> int:
    """How many other branches some searches find under the same start values."""
    problem = state.account.problem
    if problem.positions.settled or not problem.positions.closing_rows:
        return 0
    with problem.lock:
        return max(0, len(_searched(state, None, searches, 0)[0].all) - 1)


def _searched(first: InitialState, seen: ca.Function | None, searches: int, seed: int) -> tuple[_Clusters, int, int]:
    """Branches under the start values of `first`, how many searches there were, and how many of them closed."""
    problem, data = first.account.problem, first.account.data
    here = problem.measured(data)
    clusters = _Clusters(problem, here, data, seen)
    hunt = _Hunt(problem, here, data, first.account.weights, np.random.default_rng(seed))
    found = hunt.put_down(first.account.positions.y)
    if found is not None:
        clusters.add(*found)
    used = closed = 0
    for k in range(0 if problem.positions.settled else searches):
        used = k + 1
        found = hunt.search([c.y for c in clusters.all])
        if found is not None:
            closed += 1
            clusters.add(*found)
        if used >= _LEAST and min((c.count for c in clusters.all), default=0) >= _ENOUGH:
            break
    clusters.merge(hunt)
    return clusters, used, closed


@dataclass
class _Cluster:
    y: np.ndarray
    seen: np.ndarray
    much: np.ndarray
    freedoms: int
    count: int


@dataclass(frozen=True)
class _Clusters:
    """Configurations that are the same up to full turns and signs of quaternions, or where `seen` is the same."""

    problem: StartProblem
    coordinates: Coordinates
    data: np.ndarray
    seen: ca.Function | None
    all: list[_Cluster] = field(default_factory=list[_Cluster])

    def add(self, y: np.ndarray, freedoms: int) -> None:
        seen, much = (np.zeros(0),) * 2 if self.seen is None else (np.array(part).ravel() for part in self.seen(y))
        same = _SAME_FREE if freedoms else _SAME
        for c in self.all:
            if self.seen is None:
                apart = float(np.max(self.coordinates.differences(c.y, y), initial=0.0))
            else:
                apart = float(np.max(np.abs(c.seen - seen) / positive(np.maximum(c.much, much)), initial=0.0))
            if apart < same:
                c.count += 1
                return
        self.all.append(_Cluster(y, seen, much, freedoms, 1))

    def merge(self, hunt: _Hunt) -> None:
        """Those that one can move into another without taking it apart become one, the best near values and the nearest first.

        Not those that meet all near values.
        """
        if self.seen is not None or not any(c.freedoms for c in self.all):
            return
        walks = Walks(hunt.rows, self.coordinates, hunt.sizes)
        missed = {id(c): hunt.missed(c.y) for c in self.all}
        self.all.sort(key=lambda c: (round(missed[id(c)], 6), hunt.distance(c.y)))
        kept: list[tuple[_Cluster, list[np.ndarray]]] = []
        for c in self.all:
            rival = missed[id(c)] > _MET or not hunt.wishes
            host = next((k for k, points in kept if c.freedoms and rival and walks.leads(points, c.y)), None)
            if host is None:
                kept.append((c, walks.reachable(c.y) if c.freedoms else [c.y]))
            else:
                host.count += c.count
        self.all[:] = [c for c, _ in kept]


@dataclass(frozen=True)
class _Hunt:
    """Single searches, from anywhere or from where earlier ones ended."""

    problem: StartProblem
    coordinates: Coordinates
    data: np.ndarray
    weights: np.ndarray
    rng: np.random.Generator

    @functools.cached_property
    def sizes(self) -> Sizes:
        """What is much for coordinates and constraints."""
        return self._positions.sizes(self.data, self._positions.first(self.data))

    @functools.cached_property
    def apart(self) -> Residual:
        """How far joints are from the sketch, in parts of what is much."""
        return self._positions.apart(self.data, self._positions.first(self.data))

    def distance(self, y: np.ndarray) -> float:
        """From the sketch, root mean square."""
        away = self.apart(y)[0]
        return float(np.sqrt(np.mean(away**2))) if away.size else 0.0

    @property
    def _positions(self) -> Search:
        return self.problem.positions

    @property
    def wishes(self) -> bool:
        """Whether there are near values."""
        return bool(self._positions.wished)

    @property
    def rows(self) -> Residual:
        """The constraints."""
        return self._positions.rows(self.data, self._positions.first(self.data))

    def missed(self, y: np.ndarray) -> float:
        """By how much near values are missed, root of the weighted sum of squares."""
        soft = self._positions.wish_rows(self.data, self._positions.first(self.data), self.weights)
        return 0.0 if soft is None or not self.wishes else float(np.linalg.norm(soft(y)[0]))

    def search(self, known: list[np.ndarray]) -> tuple[np.ndarray, int] | None:
        """A configuration and its freedoms from one more beginning; None where nothing closes."""
        first = self._positions.first(self.data)
        guess = self._beginning(first, known)
        for i, k in self._positions.plain:
            guess[i] = self.data[k]
        found = assemble(self._positions.rows(self.data, first), guess, sizes=self.sizes, limit=60)
        return self.put_down(found.y) if found.converged else None

    def _beginning(self, first: np.ndarray, known: list[np.ndarray]) -> np.ndarray:
        """Anywhere; or a known configuration with some of its entries turned round about the sketch's or about zero."""
        if not known or self.rng.random() < 0.6:
            return self.coordinates.scattered(self.rng, first)
        y = known[int(self.rng.integers(len(known)))]
        about = first if self.rng.random() < 0.5 else np.zeros_like(y)
        turned = self.rng.random(y.size) < 0.5
        return np.where(turned, 2 * about - y, y) + 0.1 * self.rng.normal(size=y.size) * self.coordinates.scale

    def put_down(self, y: np.ndarray) -> tuple[np.ndarray, int] | None:
        """The same branch near the sketch in what is free: full turns taken off, then least near values and distance."""
        search = self._positions
        first = search.first(self.data)
        if search.settled:
            return y, 0
        hard = search.rows(self.data, first)
        y = self._with_angles_near(y, first, hard)
        J = self.sizes.scaled(hard(y)[1])
        if not np.isfinite(J).all():
            return None
        freedoms = freedom(J, max(RANK, self.sizes.dependent)).shape[1]
        if freedoms:
            soft = search.wish_rows(self.data, first, self.weights)
            # begun at a closed configuration; wishes then only lead along what is free
            found = assemble(hard, y, _nearest(soft, self.apart), sizes=self.sizes, limit=60, approach=False)
            if soft is not None:
                found = assemble(hard, found.y, soft, sizes=self.sizes, limit=60, approach=False)
            y = self._with_angles_near(found.y, first, hard)
        return (y, freedoms) if search.is_meant(y, self.data) else None

    def _with_angles_near(self, y: np.ndarray, first: np.ndarray, hard: Residual) -> np.ndarray:
        """Full turns taken off, unless start values count them."""
        turned = self.coordinates.canonical(y, first)
        gap = float(np.max(np.abs(hard(turned)[0]) / self.sizes.rows, initial=0.0))
        return turned if gap <= _TURNED * (1 + float(np.max(np.abs(turned / self.sizes.unknowns)))) else y


def _nearest(soft: Residual | None, apart: Residual) -> Residual:
    """Near values, and with less weight the distance from the sketch."""

    def wishes(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        away, slopes = apart(y)
        if soft is None:
            return _SKETCH * away, _SKETCH * slopes
        r, J = soft(y)
        return np.concatenate([r, _SKETCH * away]), np.vstack([J, _SKETCH * slopes])

    return wishes


def _seen(
    outputs: Outputs, by: Sequence[Expression], t0: float, p: np.ndarray, u: np.ndarray, search: Search, data: np.ndarray
) -> ca.Function:
    """q -> the expressions that tell branches apart, and what the sizes of coordinates make of each. Raises `OptionError` where they depend on velocities."""
    r = outputs.system
    values = ca.vertcat(*(ca.vec(ca.densify(outputs.resolve(item))) for item in by))
    q, v = r.x[: r.nq, :], r.x[r.nq :, :]
    if v.numel() and ca.depends_on(values, v):
        raise OptionError("branches: `by` must be positions, not velocities or forces.")
    fixed = ca.Function("seen", [q, r.t, r.u, r.p], [values])
    free = ca.SX.sym("q", q.numel())
    told = fixed(free, t0, u, p)
    sizes = np.zeros(q.numel()) if search.settled else search.sizes(data, search.first(data)).unknowns
    return ca.Function("seen", [free], [told, ca.fabs(ca.jacobian(told, free)) @ sizes])


def _branches(hunt: _Hunt, clusters: _Clusters, first: InitialState) -> tuple[list[Branch], int]:
    problem, data, weights = hunt.problem, hunt.data, hunt.weights
    ordered: list[tuple[float, float, _Cluster, Found]] = []
    for c in clusters.all:
        moving = problem.velocities.solve(np.concatenate([data, c.y]), weights)
        if moving.converged:
            ordered.append((round(hunt.missed(c.y), 6), hunt.distance(c.y), c, moving))
    ordered.sort(key=lambda item: item[:2])
    result: list[Branch] = []
    for _, distance, c, moving in ordered:
        position = Found(c.y, problem.positions.first(data), first.account.positions.gap, first.account.positions.part, True)
        state = finished(Account(problem, data, weights, position, moving))
        words = _words(clusters.coordinates, ordered[0][2].y, c.y) if result else "(nearest to the sketch)"
        result.append(Branch(state, distance, c.count, c.freedoms, words))
    return result, len(clusters.all) - len(ordered)


def _words(coordinates: Coordinates, one: np.ndarray, other: np.ndarray) -> str:
    far = coordinates.differences(one, other)
    order = [int(i) for i in np.argsort(-far, kind="stable")[:3] if far[i] > _SAME]
    all = coordinates.all
    return ", ".join(f"{all[i].name} {all[i].value(other)} for {all[i].value(one)}" for i in order)
