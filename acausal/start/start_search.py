"""The search for consistent positions, or velocities, from start values of certain variables, whatever the values."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from acausal.numerics.assembly import Assembled, Residual, assemble
from acausal.numerics.bound import BoundFunction
from acausal.numerics.folding import folded_function
from acausal.numerics.sizes import Drawn, Sizes, bent_size, curvature, positive, row_sizes, unknown_sizes
from acausal.numerics.terms import finite, rounded
from acausal.numerics.thresholds import EDGE, STRIDE

_ATTEMPTS = 24
_PROBES = 3
_SLOW = 1e-4
_KEPT = 8
_SIZED = 8
"""Times that curved rows are measured anew where a search came to."""
_RIVALS = 3
"""Branches of which the nearest to the sketch is taken, where the search had to begin anew."""
_STAY = 1e-3
"""Weight of the orientation of free bodies, which rather stays, against values wished for."""


@dataclass(frozen=True)
class Target:
    """A variable or expression with a start value, column by column; `place`: of its value among all start values."""

    name: str
    unit: str
    expression: ca.SX
    exact: bool
    periodic: bool
    place: slice

    @property
    def size(self) -> int:
        """Number of values."""
        return self.place.stop - self.place.start


@dataclass(frozen=True)
class Closing:
    """Constraints that hold whatever the start values are: residuals (n, 1), and what each belongs to.

    `owners`: pairs of words and number of rows, in order. `signs` (k, 1): positive on the branch that is meant.
    """

    residual: ca.SX
    owners: tuple[tuple[str, int], ...]
    signs: ca.SX
    drawn: Drawn
    """How well the rows are known."""


@dataclass(frozen=True)
class Found:
    """What a search came to: `y` (n,), where it began, the largest residual left, and as part of its row's size, whether it is zero to
    rounding, steps and restarts.
    """

    y: np.ndarray
    first: np.ndarray
    gap: float
    part: float
    converged: bool
    iterations: int = 0
    restarts: int = 0


@dataclass(frozen=True)
class Unknowns:
    """Symbols of a search: `y` (n,), whose first entries are `turning` angles and quaternions or rates of these, and the `data`.

    `q`: places in the data of configurations on which rows that are linear in y depend; `scattered` (nq,): which of them turn.
    """

    y: ca.SX
    data: ca.SX
    turning: np.ndarray
    linear: bool = False
    """Whether y are velocities."""
    q: range = range(0)
    scattered: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def only(self, places: list[int]) -> Unknowns:
        """Some of y."""
        return replace(self, y=self.y[places, :], turning=self.turning[places])


@dataclass(frozen=True)
class Block:
    """Unknowns that constraints or wishes connect, and these rows: no other block has to do with them, so it is searched alone.

    Bound functions take y and the data with `first`. `places` in y; `rows` and `wished` among all rows. `alike` (rows of wishes,): those with
    the same number are weighed by the same size.
    """

    unknowns: Unknowns
    places: list[int]
    rows: list[int]
    wished: list[int]
    whole: ca.SX
    hard: ca.SX
    soft: ca.SX
    signs: ca.SX
    alike: np.ndarray
    drawn: Drawn
    known: dict[bytes, tuple[Sizes, np.ndarray]] = field(default_factory=dict[bytes, tuple[Sizes, np.ndarray]], compare=False)
    """Sizes of some calls before."""

    @functools.cached_property
    def constraints(self) -> BoundFunction:
        """Rows and their Jacobian, column by column."""
        return _with_jacobian(self.unknowns.y, self.whole, self.hard)

    @functools.cached_property
    def wishes(self) -> BoundFunction | None:
        """The same of wishes."""
        return _with_jacobian(self.unknowns.y, self.whole, self.soft) if self.wished else None

    @functools.cached_property
    def _curved(self) -> bool:
        """Whether some rows are not linear in y: among velocities, circuits may bring such."""
        return any(ca.which_depends(self.hard, self.unknowns.y, 2, False))

    @functools.cached_property
    def _rounded(self) -> BoundFunction:
        return BoundFunction.of(
            ca.Function("rounded", [ca.vertcat(self.unknowns.y, self.whole)], [ca.densify(rounded(self.hard))])
        )

    @functools.cached_property
    def _signs(self) -> BoundFunction:
        return BoundFunction.of(ca.Function("signs", [ca.vertcat(self.unknowns.y, self.whole)], [ca.densify(self.signs)]))

    def is_meant(self, y: np.ndarray, data: np.ndarray) -> bool:
        """Whether hinges that close loops turn the way that is meant, their axes not opposite, and wheels roll the right side up."""
        return not self.signs.numel() or bool((self._signs.at(np.concatenate([y, data])) > EDGE).all())

    def sizes(self, data: np.ndarray, first: np.ndarray, factors: np.ndarray) -> tuple[Sizes, np.ndarray]:
        """What is much for unknowns and constraints, and what wishes are divided by; `data` with `first` of all unknowns."""
        key = data.tobytes() + factors.tobytes()
        found = self.known.get(key)
        if found is None:
            if len(self.known) >= _KEPT:
                self.known.clear()
            found = self.known[key] = self._sizes(data, first, factors)
        return found

    @np.errstate(over="ignore", invalid="ignore")  # what is not finite counts as without size
    def _sizes(self, data: np.ndarray, first: np.ndarray, factors: np.ndarray) -> tuple[Sizes, np.ndarray]:
        of, y = self.unknowns, first[self.places]
        rows, wishes = _residual(self.constraints, y.size), None if self.wishes is None else _residual(self.wishes, y.size)
        points = [(y, data), *self._probes(y, data)]
        found = [rows(*point) for point in points]
        hard = _most([J for _, J in found], (len(self.rows), y.size))
        soft = np.zeros((len(self.wished), y.size))
        seen: list[tuple[np.ndarray, np.ndarray]] = []
        if wishes is not None:
            seen = [wishes(*point) for point in points]
            soft = _most([J for _, J in seen], soft.shape)

        together = np.vstack([hard, soft])
        unknowns = np.ones(y.size)
        if not of.turning.all():
            off = [np.nan_to_num(np.abs(found[0][0])) + self._rounding(y, data), np.abs(seen[0][0]) if seen else np.zeros(0)]
            unknowns = unknown_sizes(
                together, of.turning, np.concatenate(off), Drawn.joined([self.drawn, Drawn.exact(len(self.wished))])
            )
        # curved rows may be immense where unknowns are much, so that nothing met them any more
        terms = self._rounding(unknowns if of.linear and not self._curved else y, data) + self.drawn.sizes
        sizes, wanted = row_sizes(hard, unknowns, terms, self.drawn), row_sizes(soft, unknowns, np.zeros(len(self.wished)))
        drawn, dependent = self.drawn.terms(sizes), self.drawn.dependent(sizes)
        for k in set(self.alike.tolist()):
            wanted[self.alike == k] = np.max(wanted[self.alike == k])
        rate = 1.0
        if of.linear:  # the unit of time drops out: rates are measured by the largest that is asked for
            asked = [
                np.abs(y) / unknowns,
                np.abs(found[0][0]) / sizes,
                np.abs(seen[0][0]) * factors / wanted if seen else np.zeros(0),
            ]
            rate = float(positive(np.array([np.max(np.concatenate(asked), initial=0.0)]))[0])
            unknowns, sizes, wanted = unknowns * rate, sizes * rate, wanted * rate
        return Sizes(unknowns, sizes, lambda y: drawn * sizes + self._rounding(y, data), dependent, rate), wanted

    def _sizes_at(self, y: np.ndarray, data: np.ndarray, first: np.ndarray, factors: np.ndarray) -> Sizes:
        """What is much where a search came to: what is nothing beside the rows at its beginning may be much there."""
        first = first.copy()
        first[self.places] = y
        return self._sizes(np.concatenate([data, first]), first, factors)[0]

    def _rounding(self, y: np.ndarray, data: np.ndarray) -> np.ndarray:
        return finite(self._rounded.at(np.concatenate([y, data])))

    def _probes(self, y: np.ndarray, data: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Places about y that differ in what turns, and in what has no influence at first order."""
        of = self.unknowns
        if of.linear:
            places = np.arange(of.q.start, of.q.stop)[of.scattered]
            return [(y, _moved(data, places, change)) for change in _scatter(places.size)]
        reach = np.where(of.turning, 1.0, 0.0)
        if not of.turning.all() and self.rows:
            c, J = _residual(self.constraints, y.size)(y, data)
            silent = ~of.turning & ~np.any(np.nan_to_num(J), axis=0)
            if silent.any():
                bent = curvature(self.hard, of.y, silent)
                bends = np.array(ca.Function("bends", [ca.vertcat(of.y, self.whole)], [ca.densify(bent)])(np.concatenate([y, data])))
                terms = np.abs(c) + self._rounding(y, data)
                reach[silent] = bent_size(terms, bends)
        return [(y + reach * change, data) for change in _scatter(y.size)]

    def solve(self, data: np.ndarray, first: np.ndarray, factors: np.ndarray, fastest: float) -> Found:
        """y of the block near `first`; begins anew from up to 24 other places where that fails. `factors`: of the wishes.

        `fastest`: rate of all blocks, beside which much smaller ones are rounding errors.
        """
        whole = np.concatenate([data, first])
        sizes, wanted = self.sizes(whole, first, factors)
        sizes = sizes.faster(_SLOW * fastest)
        begun, unit = first[self.places], sizes.unknowns
        stride = np.inf if self.unknowns.linear else STRIDE
        rows = _residual(self.constraints, begun.size)
        wishes = None if self.wishes is None else _residual(self.wishes, begun.size)

        def hard(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return rows(y, whole)

        def soft(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            assert wishes is not None
            r, J = wishes(y, whole)
            return factors / wanted * r, (factors / wanted)[:, None] * J

        def search(guess: np.ndarray) -> tuple[Assembled, bool]:
            found, used = assemble(hard, guess, soft if wishes else None, sizes=sizes, stride=stride, nearest=begun), sizes
            for _ in range(_SIZED):
                there = self._sizes_at(found.y, data, first, factors).faster(_SLOW * fastest) if self._curved else used
                if not found.converged or not (there.rows < 0.5 * used.rows).any():
                    return found, found.converged and self.is_meant(found.y, whole)
                found, used = assemble(hard, found.y, sizes=there, stride=stride), there
            return replace(found, converged=False), False

        found, right = search(begun)
        if right:
            return Found(found.y, begun, found.gap, found.part, True, found.iterations)
        rng = np.random.default_rng(0)
        best, spent = found, found.iterations
        rivals: list[Assembled] = []
        begun_anew = 0
        for attempt in range(_ATTEMPTS):
            # a push out of the place where the search ended, then another beginning, farther and farther from the sketch
            from_best = attempt % 2 == 0 and not best.converged and best.part < np.inf
            size = 0.2 if from_best else min(0.1 * 1.25**attempt, 3.0)
            found, right = search((best.y if from_best else begun) + rng.normal(scale=size, size=begun.size) * unit)
            spent += found.iterations
            rivals += [found] if right else []
            begun_anew = attempt + 1
            if len(rivals) == _RIVALS or (rivals and self.unknowns.linear):
                break
            if found.part < best.part:
                best = found
        if rivals:
            near = min(rivals, key=lambda a: float(np.linalg.norm((a.y - begun) / unit)))
            return Found(near.y, begun, near.gap, near.part, True, spent, begun_anew)
        return Found(best.y, begun, best.gap, best.part, False, spent, _ATTEMPTS)


@functools.cache
def _scatter(size: int) -> tuple[np.ndarray, ...]:
    """The same random changes (size,) whenever they are needed."""
    return tuple(np.random.default_rng(3).uniform(-1, 1, (_PROBES, size)))


def _most(matrices: Sequence[np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    """Largest magnitudes, entry by entry."""
    return np.nan_to_num(np.max(np.abs(matrices), axis=0), posinf=0.0) if matrices else np.zeros(shape)


def _moved(data: np.ndarray, places: np.ndarray, change: np.ndarray) -> np.ndarray:
    result = data.copy()
    result[places] += change
    return result


@dataclass(frozen=True)
class Search:
    """Looks for y with `constraints(y, data)` = 0 that keeps to wishes and to the start `guess`.

    `plain`: pairs of a place in y and a place among the start values that is its value. `settled`: the values say it all.
    `data` are the start values, time, inputs, parameters, and q in the search for velocities.
    """

    what: str
    guess: np.ndarray
    plain: tuple[tuple[int, int], ...]
    exact: tuple[Target, ...] = ()
    wished: tuple[Target, ...] = ()
    closing: tuple[tuple[str, int], ...] = ()
    blocks: tuple[Block, ...] = ()
    whole: Block | None = None
    """All blocks as one."""
    residual: ca.Function | None = None
    """(y, data) -> all rows of the constraints: closing, then exact values."""
    wish: ca.Function | None = None
    """(y, data, first) -> all rows of the wishes: free orientations that stay, then near values."""
    side: ca.Function | None = None
    """(y, data) -> what is positive on the branch that is meant."""
    said: bool = False
    """Whether the values say it all, so that only the signs are left to look at."""

    @property
    def settled(self) -> bool:
        """Whether the values leave nothing to search."""
        return self.whole is None

    @property
    def places(self) -> list[int]:
        """Unknowns that constraints or wishes hold."""
        return [i for block in self.blocks for i in block.places]

    @property
    def stride(self) -> float:
        """Velocities enter linearly, so the search may go anywhere at once."""
        return np.inf if self.what == "velocity" else STRIDE

    @property
    def closing_rows(self) -> int:
        """Rows that hold whatever the start values are."""
        return sum(size for _, size in self.closing)

    def first(self, data: np.ndarray) -> np.ndarray:
        """Where the search begins: the guess, with the start values of coordinates put in."""
        first = self.guess.copy()
        for i, k in self.plain:
            first[i] = data[k]
        return first

    def solve(self, data: np.ndarray, weights: np.ndarray) -> Found:
        """y (n,) for the data and the weights of all start values, block by block."""
        first = self.first(data)
        if self.whole is None or (self.said and self.is_meant(first, data)):
            return Found(first, first, 0.0, 0.0, True)
        factors = self.wish_factors(weights)
        y = first.copy()
        parts: list[Found] = []
        whole = np.concatenate([data, first])
        rates = [block.sizes(whole, first, factors[block.wished])[0].rate for block in self.blocks if block.unknowns.linear]
        for block in self.blocks:
            found = block.solve(data, first, factors[block.wished], max(rates, default=0.0))
            y[block.places] = found.y
            parts.append(found)
        worst = max(parts, key=lambda f: (not f.converged, f.part))
        return Found(
            y, first, worst.gap, worst.part, worst.converged, sum(f.iterations for f in parts), sum(f.restarts for f in parts)
        )  # fmt: skip

    def sizes(self, data: np.ndarray, first: np.ndarray) -> Sizes:
        """What is much for all unknowns and constraints: for unknowns in no constraint 1."""
        assert self.whole is not None
        unknowns, rows = np.ones(first.size), np.ones(len(self.whole.rows))
        whole = np.concatenate([data, first])
        for block in self.blocks:
            found, _ = block.sizes(whole, first, np.ones(len(block.wished)))
            unknowns[block.places], rows[block.rows] = found.unknowns, found.rows
        found, _ = self.whole.sizes(whole, first, np.ones(len(self.whole.wished)))
        return replace(found, unknowns=unknowns, rows=rows)

    def rows(self, data: np.ndarray, first: np.ndarray, kept: Sequence[int] | None = None) -> Residual:
        """The constraints at `data`; only the rows `kept`, if given."""
        assert self.whole is not None
        residual, whole = _residual(self.whole.constraints, first.size), np.concatenate([data, first])

        def rows(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            c, J = residual(y, whole)
            return (c, J) if kept is None else (c[kept], J[kept])

        return rows

    def wish_rows(self, data: np.ndarray, first: np.ndarray, weights: np.ndarray) -> Residual | None:
        """The wishes at `data`, near values weighted, as parts of their sizes; None without any."""
        if self.whole is None or self.whole.wishes is None:
            return None
        residual, whole = _residual(self.whole.wishes, first.size), np.concatenate([data, first])
        factors = self.wish_weights(data, first, weights)

        def rows(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            r, J = residual(y, whole)
            return factors * r, factors[:, None] * J

        return rows

    def wish_factors(self, weights: np.ndarray) -> np.ndarray:
        """What each row of the wishes is multiplied by: roots of the weights."""
        near = np.concatenate([np.zeros(0), *(weights[t.place] for t in self.wished)])
        rows = 0 if self.whole is None else len(self.whole.wished)
        return np.concatenate([np.full(rows - near.size, _STAY), np.sqrt(near)])

    def wish_weights(self, data: np.ndarray, first: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """The same, divided by what is much in the row."""
        factors = self.wish_factors(weights)
        if self.whole is None:
            return factors
        return factors / self.whole.sizes(np.concatenate([data, first]), first, factors)[1]

    def is_meant(self, y: np.ndarray, data: np.ndarray) -> bool:
        """Whether hinges that close loops turn the way that is meant, their axes not opposite, and wheels roll the right side up."""
        return self.whole is None or self.whole.is_meant(y, np.concatenate([data, y]))

    def jacobian(self, y: np.ndarray, data: np.ndarray) -> np.ndarray:
        """d residual / dy, (m, n), for searches with constraints. Unlike `rows` for many threads at once."""
        assert self.residual is not None
        return np.array(self.residual.factory("J", ["y", "data"], ["jac:c:y"])(y, data)).reshape(-1, y.size)

    def wish_jacobian(self, y: np.ndarray, data: np.ndarray, first: np.ndarray) -> np.ndarray:
        """d wish / dy, (m, n), for searches with wishes, without weights."""
        assert self.wish is not None
        return np.array(self.wish.factory("J", ["y", "data", "first"], ["jac:r:y"])(y, data, first)).reshape(-1, y.size)

    def close(self, guess: np.ndarray, data: np.ndarray, kept: Sequence[int], sizes: Sizes) -> Assembled:
        """One search from `guess` that meets the rows `kept` of the constraints only."""
        return assemble(self.rows(data, guess, kept), guess, sizes=sizes.of(kept), stride=self.stride)

    def derivative(self, y: np.ndarray, data: np.ndarray, change: np.ndarray) -> np.ndarray:
        """dy (n, k) when the data change by the columns of `change` (size of data, k): the start values that y repeats, and then the
        least change that keeps the constraints.
        """
        first = np.zeros((y.size, change.shape[1]))
        for i, k in self.plain:
            first[i] = change[k]
        if self.residual is None:
            return first
        J, by_data = (
            np.array(part) for part in self.residual.factory("slopes", ["y", "data"], ["jac:c:y", "jac:c:data"])(y, data)
        )
        sizes = self.sizes(data, self.first(data))
        scaled = sizes.scaled(J)
        off = (J @ first + by_data @ change) / sizes.rows[:, None]
        return first - sizes.unknowns[:, None] * (np.linalg.pinv(scaled, rcond=sizes.dependent) @ off)


def start_search(
    what: str, unknowns: Unknowns, wanted: ca.SX, closing: Closing, targets: list[Target], guess: np.ndarray, kept: list[int]
) -> Search:
    """`kept`: entries of y that rather stay as they are than make up for others."""
    y, data = unknowns.y, unknowns.data
    exact = tuple(t for t in targets if t.exact)
    wished = tuple(t for t in targets if not t.exact)
    plain = tuple(_plain(y, wished + exact))
    entries = sum(t.size for t in exact)
    settled = not closing.residual.numel() and not wished and len({i for i, _ in plain}) == len(plain) == entries
    if y.numel() == 0 or (settled and not closing.signs.numel()):
        return Search(what, guess, plain, exact, wished)
    first = ca.SX.sym("first", y.numel())
    whole = ca.vertcat(data, first)
    hard = ca.vertcat(closing.residual, *(_difference(t, wanted) for t in exact))
    stay = y[kept] - first[kept] if kept and targets else ca.SX(0, 1)
    soft = ca.vertcat(stay, *(_difference(t, wanted) for t in wished))
    units = [t.unit or t.name for t in wished for _ in range(t.size)]
    names = ["", *dict.fromkeys(units)]
    alike = np.array([0] * stay.numel() + [names.index(unit) for unit in units], dtype=int)
    rest = hard.numel() - closing.residual.numel()
    drawn = Drawn.joined([closing.drawn, Drawn.exact(rest)])
    n, m, k = y.numel(), hard.numel(), soft.numel()
    everything = Block(unknowns, list(range(n)), list(range(m)), list(range(k)), whole, hard, soft, closing.signs, alike, drawn)
    side = ca.Function("side", [y, data], [ca.densify(closing.signs)]) if closing.signs.numel() else None
    return Search(
        what,
        guess,
        plain,
        exact,
        wished,
        closing.owners,
        _blocks(everything),
        everything,
        ca.Function("residual", [y, data], [hard], ["y", "data"], ["c"]),
        ca.Function("wishes", [y, data, first], [soft], ["y", "data", "first"], ["r"]) if soft.numel() else None,
        side,
        settled,
    )


def _blocks(whole: Block) -> tuple[Block, ...]:
    """Parts of y that no row connects, in the order of their first unknown; unknowns in no row are in none."""
    import networkx as nx

    y, graph = whole.unknowns.y, nx.Graph()
    for kind, rows in (("hard", whole.hard), ("soft", whole.soft), ("sign", whole.signs)):
        graph.add_nodes_from((kind, i) for i in range(rows.numel()))
        i, j = ca.jacobian_sparsity(rows, y).get_triplet() if rows.numel() else ([], [])
        graph.add_edges_from(((kind, a), ("y", b)) for a, b in zip(i, j, strict=True))
    lost = [node for node in graph if node[0] != "y" and not graph[node]]
    graph.remove_nodes_from(lost)
    parts = [sorted(part) for part in nx.connected_components(graph)]
    parts.sort(key=lambda part: min(k for kind, k in part if kind == "y"))
    if len(parts) <= 1:
        return (whole,)
    parts[0] = sorted([*parts[0], *lost])  # they hold or not, whatever y is
    found: list[Block] = []
    for part in parts:
        places, hard, soft, signs = ([k for kind, k in part if kind == wanted] for wanted in ("y", "hard", "soft", "sign"))
        found.append(
            Block(
                whole.unknowns.only(places), places, hard, soft, whole.whole, whole.hard[hard, :], whole.soft[soft, :],
                whole.signs[signs, :] if signs else ca.SX(0, 1), whole.alike[soft], whole.drawn.of(hard),
            )
        )  # fmt: skip
    return tuple(found)


def _plain(y: ca.SX, targets: Sequence[Target]) -> list[tuple[int, int]]:
    """Places in y and among the start values, of targets that are entries of y."""
    place = {y[i].element_hash(): i for i in range(y.numel())}
    pairs: list[tuple[int, int]] = []
    for target in targets:
        for k in range(target.size):
            entry = target.expression[k]
            if entry.is_symbolic() and entry.element_hash() in place:
                pairs.append((place[entry.element_hash()], target.place.start + k))
    return pairs


def _difference(t: Target, wanted: ca.SX) -> ca.SX:
    difference = t.expression - wanted[t.place]
    return ca.atan2(ca.sin(difference), ca.cos(difference)) if t.periodic else difference


def _with_jacobian(y: ca.SX, data: ca.SX, residual: ca.SX) -> BoundFunction:
    """(y, data) -> residual, and its Jacobian column by column, in one column."""
    both = ca.vertcat(ca.densify(residual), ca.vec(ca.densify(ca.jacobian(residual, y))))
    return BoundFunction.of(folded_function("residual", [ca.vertcat(y, data)], [both]))


def _residual(kernel: BoundFunction, n: int) -> Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """(y (n,), data) -> residual (m,) and Jacobian (m, n)."""
    m = kernel.result.size // (n + 1)

    def evaluate(y: np.ndarray, data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        both = kernel.at(np.concatenate([y, data])).copy()
        return both[:m], both[m:].reshape(n, m).T

    return evaluate
