"""The search for consistent positions, or velocities, from start values of certain variables, whatever the values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.assembly import Assembled, Residual, assemble
from acausal.numerics.folding import folded_function
from acausal.numerics.kernel import Kernel

_EDGE = 1e-9
"""Cosine of a wheel's lean, or between a hinge's axes, that is zero but for rounding."""
_ATTEMPTS = 24
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


@dataclass(frozen=True)
class Found:
    """What a search came to: `y` (n,), where it began, the largest residual left, whether it is zero, steps and restarts."""

    y: np.ndarray
    first: np.ndarray
    gap: float
    converged: bool
    iterations: int = 0
    restarts: int = 0


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
    constraints: Kernel | None = None
    wishes: Kernel | None = None
    signs: Kernel | None = None
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
        return self.constraints is None

    @property
    def stride(self) -> float:
        """Velocities enter linearly, so the search may go anywhere at once."""
        return np.inf if self.what == "velocity" else 0.7

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

    def solve(self, data: np.ndarray, weights: np.ndarray, scale: Callable[[], np.ndarray] | None = None) -> Found:
        """y (n,) for the data and the weights of all start values; begins anew from up to 24 other places where that fails.

        `scale`: gives what is much for each entry of y (n,); 1 unless given.
        """
        first = self.first(data)
        if self.constraints is None or (self.said and self.is_meant(first, data)):
            return Found(first, first, 0.0, True)
        hard, soft = self.rows(data, first), self.wish_rows(data, first, weights)
        found = assemble(hard, first, soft, stride=self.stride, nearest=first)
        if found.converged and self.is_meant(found.y, data):
            return Found(found.y, first, found.gap, True, found.iterations)
        rng = np.random.default_rng(0)
        best, spent = found, found.iterations
        for attempt in range(_ATTEMPTS):
            # a push out of the place where the search ended, then another beginning, farther and farther from the sketch
            from_best = attempt % 2 == 0 and not best.converged
            size = 0.2 if from_best else min(0.1 * 1.25**attempt, 3.0)
            kick = rng.normal(scale=size, size=first.size) * (1.0 if scale is None else scale())
            found = assemble(hard, (best.y if from_best else first) + kick, soft, stride=self.stride, nearest=first)
            spent += found.iterations
            if found.converged and self.is_meant(found.y, data):
                return Found(found.y, first, found.gap, True, spent, attempt + 1)
            if found.gap < best.gap:
                best = found
        return Found(best.y, first, best.gap, False, spent, _ATTEMPTS)

    def rows(self, data: np.ndarray, first: np.ndarray, kept: Sequence[int] | None = None) -> Residual:
        """The constraints at `data`; only the rows `kept`, if given."""
        assert self.constraints is not None
        return _residual(self.constraints, first.size, np.concatenate([data, first]), None, kept)

    def wish_rows(self, data: np.ndarray, first: np.ndarray, weights: np.ndarray) -> Residual | None:
        """The wishes at `data`, near values weighted; None without any."""
        if self.wishes is None:
            return None
        factors = self.wish_factors(weights)
        return _residual(self.wishes, first.size, np.concatenate([data, first]), factors)

    def wish_factors(self, weights: np.ndarray) -> np.ndarray:
        """What each row of the wishes is multiplied by: roots of the weights."""
        near = np.concatenate([np.zeros(0), *(weights[t.place] for t in self.wished)])
        rows = 0 if self.wishes is None else self.wishes.result.size // (self.guess.size + 1)
        return np.concatenate([np.full(rows - near.size, _STAY), np.sqrt(near)])

    def is_meant(self, y: np.ndarray, data: np.ndarray) -> bool:
        """Whether hinges that close loops turn the way that is meant, their axes not opposite, and wheels roll the right side up."""
        return self.signs is None or bool((self.signs.at(np.concatenate([y, data])) > _EDGE).all())

    def jacobian(self, y: np.ndarray, data: np.ndarray) -> np.ndarray:
        """d residual / dy, (m, n), for searches with constraints. Unlike `rows` for many threads at once."""
        assert self.residual is not None
        return np.array(self.residual.factory("J", ["y", "data"], ["jac:c:y"])(y, data)).reshape(-1, y.size)

    def wish_jacobian(self, y: np.ndarray, data: np.ndarray, first: np.ndarray) -> np.ndarray:
        """d wish / dy, (m, n), for searches with wishes, without weights."""
        assert self.wish is not None
        return np.array(self.wish.factory("J", ["y", "data", "first"], ["jac:r:y"])(y, data, first)).reshape(-1, y.size)

    def close(self, guess: np.ndarray, data: np.ndarray, kept: Sequence[int]) -> Assembled:
        """One search from `guess` that meets the rows `kept` of the constraints only."""
        return assemble(self.rows(data, guess, kept), guess, stride=self.stride)

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
        return first - np.linalg.pinv(J, rcond=1e-9) @ (J @ first + by_data @ change)


def start_search(
    what: str, y: ca.SX, data: ca.SX, wanted: ca.SX, closing: Closing, targets: list[Target], guess: np.ndarray, kept: list[int]
) -> Search:
    """`kept`: entries of y that rather stay as they are than make up for others."""
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
    side = ca.Function("side", [y, data], [ca.densify(closing.signs)]) if closing.signs.numel() else None
    return Search(
        what,
        guess,
        plain,
        exact,
        wished,
        closing.owners,
        _with_jacobian(y, whole, hard),
        _with_jacobian(y, whole, soft) if soft.numel() else None,
        Kernel.of(ca.Function("signs", [ca.vertcat(y, data)], [side(y, data)])) if side is not None else None,
        ca.Function("residual", [y, data], [hard], ["y", "data"], ["c"]),
        ca.Function("wishes", [y, data, first], [soft], ["y", "data", "first"], ["r"]) if soft.numel() else None,
        side,
        settled,
    )


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


def _with_jacobian(y: ca.SX, data: ca.SX, residual: ca.SX) -> Kernel:
    """(y, data) -> residual, and its Jacobian column by column, in one column."""
    both = ca.vertcat(ca.densify(residual), ca.vec(ca.densify(ca.jacobian(residual, y))))
    return Kernel.of(folded_function("residual", [ca.vertcat(y, data)], [both]))


def _residual(
    kernel: Kernel, n: int, data: np.ndarray, factors: np.ndarray | None = None, kept: Sequence[int] | None = None
) -> Residual:
    m = kernel.result.size // (n + 1)

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        both = kernel.at(np.concatenate([point, data])).copy()
        c, J = both[:m], both[m:].reshape(n, m).T
        if factors is not None:
            return factors * c, factors[:, None] * J
        return (c, J) if kept is None else (c[kept], J[kept])

    return evaluate
