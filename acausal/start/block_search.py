"""The search of one block: down from the sketch, from elsewhere where that fails, and for what is nearer where the sketch was rough."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from acausal.numerics.assembly import Assembled, Residual, assemble, brought_near, held
from acausal.numerics.rivals import Candidate, nearest_rival
from acausal.numerics.sizes import Sizes
from acausal.numerics.thresholds import CLOSED, STRIDE
from acausal.start.block import Block
from acausal.start.unknowns import Found

_ATTEMPTS = 24
_PATIENCE = 30
"""Steps of a search for what is nearer: it begins no farther from the sketch than what was found."""
_STEEP, _HALVINGS = 100, 12
"""Searches down an exponential, where sizes shrink on the way, and times that a beginning on it is halved."""
_NOTHING = 1e-3 * float(np.finfo(float).eps)
"""Part of an unknown that no row of its loops feels."""
_SAME = 4 * float(np.finfo(float).eps)
"""What is left of a number that was divided by a size and multiplied by it again is the same but for this part."""
_MISSED, _LESS = 1e-6, 1e-3
"""Misses of what is wished for that are none, and by what part less another one must miss it."""
_SIZED = 8
"""Times that curved rows are measured anew where a search came to."""


def solve_block(
    block: Block,
    data: np.ndarray,
    first: np.ndarray,
    closer: np.ndarray,
    factors: np.ndarray,
    fastest: float,
    informed: np.ndarray | None = None,
) -> Found:
    """y of the block nearest to `first`, with `factors` of the wishes; begins where it is likely to close, `informed`, if that is known, and anew
    where nothing closes from there: `closer`, where loops are closed unless start values open them, and from up to 24 other places.

    `fastest`: the rate that the block would have beside the fastest of all, beside which much smaller ones are rounding errors.
    """
    whole = np.concatenate([data, first])
    sizes, wanted = block.sizes(whole, first, factors)
    search = _Search(block, data, first, factors, whole, sizes.beside(fastest), wanted, fastest)
    if informed is not None and not np.array_equal(informed, search.begun):
        there = replace(search, still=block.leading, sizes=block.sizes_at(informed, data, first, factors).beside(fastest))
        found, right = there.descend(informed)  # what is given by others is found beside them, where they may stay
        if right:
            y = _without_noise(found.y, search.begun, there.sizes.unknowns)
            return Found(y, search.begun, found.gap, found.part, True, found.iterations)
    begun = search.before_winding() if block.winding else None
    found, right, keeping = None, False, search
    if begun is not None:
        found, right = search.descend(begun, approach=False)
    for still in block.staying if begun is None else ():
        staying = replace(search, still=still)
        found, right = staying.descend(staying.beginning())
        kept = block.elastic if {*block.elastic} <= {*still} else ()
        if right and (not kept or staying.meets_wishes(found.y)):
            keeping = replace(search, still=kept)
            break
        right = False
    if found is None or not right:
        found, right = search.descend(search.beginning())
    spent, restarts = found.iterations, 0
    if not right:
        found, right, more, restarts = search.begin_anew(found, closer)
        spent += more
    best = Found(found.y, search.begun, found.gap, found.part, right, spent, restarts)
    if right and spent and not block.unknowns.linear:
        best = keeping.nearest(found, spent, restarts)
    if right and block.unknowns.linear and _is_noise(search, best.y, sizes):
        return replace(best, y=np.zeros(best.y.size))
    return replace(best, y=_without_noise(best.y, search.begun, sizes.unknowns))


def _is_noise(search: _Search, y: np.ndarray, sizes: Sizes) -> bool:
    """Whether velocities miss rows by what is much for themselves, and nothing but rounding of the fastest: then rest meets these as well."""
    most = CLOSED * search.fastest / sizes.rate * sizes.rows
    missed, at_rest = (np.abs(search.block.constraints(v, search.whole)[0]) for v in (y, np.zeros(y.size)))
    return bool((missed > _MISSED * sizes.rows).any() and (at_rest <= most).all())


def _without_noise(y: np.ndarray, begun: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Zeros where the search went elsewhere and rounding is all that is left: an integrator would follow such a number with all its digits."""
    went = np.abs(y - begun) > _SAME * np.abs(begun)
    return np.where(went & (np.abs(y) < _NOTHING * sizes), 0.0, y)


@dataclass(frozen=True)
class _Search:
    """With these data, `whole` of them with `first`, and sizes."""

    block: Block
    data: np.ndarray
    first: np.ndarray
    factors: np.ndarray
    whole: np.ndarray
    sizes: Sizes
    wanted: np.ndarray
    fastest: float
    still: tuple[int, ...] = ()
    """Unknowns that stay as they are."""

    @property
    def begun(self) -> np.ndarray:
        return self.first[self.block.places]

    @property
    def _stride(self) -> float:
        return np.inf if self.block.unknowns.linear else STRIDE

    @property
    def _steep(self) -> bool:
        """Whether rows of scalar variables may be exponentials, as of diodes."""
        return self.block.unknowns.linear and self.block.curved

    @property
    def _hard(self) -> Residual:
        return self.block.constraints.at(self.whole)

    @functools.cached_property
    def _soft(self) -> Residual | None:
        if self.block.wishes is None:
            return None
        wishes, weights = self.block.wishes.at(self.whole), self.factors / self.wanted

        def soft(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            r, J = wishes(y)
            return weights * r, weights[:, None] * J

        return soft

    @functools.cached_property
    def _known_apart(self) -> Residual | None:
        return self.block.apart_at(self.whole, self.sizes)

    def _apart(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far from the sketch, in parts of what is much."""
        if self._known_apart is not None:
            return self._known_apart(y)
        unit = self.sizes.unknowns
        return (y - self.begun) / unit, np.diag(1 / unit)

    def beginning(self) -> np.ndarray:
        """The sketch; of scalar variables halved until the rows are finite: a diode's exponential is not far beyond its voltage."""
        guess = self.begun
        if self._steep:
            for part in 0.5 ** np.arange(_HALVINGS):
                begun = part * self.begun
                begun[list(self.still)] = self.begun[list(self.still)]
                if np.isfinite(self._hard(begun)[1]).all():
                    return begun
        return guess

    def before_winding(self) -> np.ndarray | None:
        """Where everything closes but screws, which wait for the turns that are left; None where nothing does."""
        rest = [k for k in range(len(self.block.rows)) if k not in self.block.winding]
        hard = self._hard

        def others(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            c, J = hard(y)
            return c[rest], J[rest]

        found = assemble(others, self.begun, self._soft, sizes=self.sizes.of(rest), stride=self._stride, nearest=self._apart)
        return found.y if found.converged else None

    def descend(self, guess: np.ndarray, approach: bool = True, limit: int = 100) -> tuple[Assembled, bool]:
        """One search, and whether it closed on the side that is meant. `approach`: wishes choose the branch too."""
        of = self.sizes
        found = self._assembled(guess, self._soft, of, limit=limit, nearest=self._apart, approach=approach)
        for _ in range(_STEEP if self._steep else _SIZED):
            there = of
            if self.block.curved:
                # what rounding left beside zero is no size of anything
                found = replace(found, y=_without_noise(found.y, self.begun, of.unknowns))
                there = self.block.sizes_at(found.y, self.data, self.first, self.factors).beside(self.fastest)
            if not (found.converged or self._steep) or not (there.rows < 0.5 * of.rows).any():
                return found, found.converged and self.block.is_meant(found.y, self.whole)
            on = self._assembled(found.y, None if found.converged else self._soft, there, approach=False)
            found, of = replace(on, iterations=found.iterations + on.iterations), there
        return replace(found, converged=False), False

    def _assembled(
        self,
        guess: np.ndarray,
        soft: Residual | None,
        of: Sizes,
        *,
        nearest: Residual | None = None,
        limit: int = 100,
        approach: bool,
    ) -> Assembled:
        """One search of what does not stay as it is."""
        moving = np.array([k for k in range(guess.size) if k not in self.still], dtype=int)

        def whole(part: np.ndarray) -> np.ndarray:
            y = guess.copy()
            y[moving] = part
            return y

        def only(residual: Residual | None) -> Residual | None:
            if residual is None or not self.still:
                return residual

            def rows(part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                r, J = residual(whole(part))
                return r, J[:, moving]

            return rows

        hard, sizes = only(self._hard), of.only(moving, whole)
        assert hard is not None
        found = assemble(
            hard,
            guess[moving],
            only(soft),
            sizes=sizes,
            limit=limit,
            stride=self._stride,
            nearest=only(nearest),
            approach=approach,
        )
        return replace(found, y=whole(found.y))

    def begin_anew(self, best: Assembled, closer: np.ndarray) -> tuple[Assembled, bool, int, int]:
        """What closes first, or else came nearest to that, and whether it closed; the steps it took, and beginnings."""
        rng, spent = np.random.default_rng(0), 0
        for begin in self._nearer(closer):
            found, right = self.descend(begin, approach=begin is not closer)
            if right:
                return found, True, found.iterations, 1
        for attempt in range(_ATTEMPTS):
            # a push out of the place where the search ended, then another beginning, farther and farther from the sketch
            from_best = attempt % 2 == 0 and not best.converged and best.part < np.inf
            size = 0.2 if from_best else min(0.1 * 1.25**attempt, 3.0)
            kick = rng.normal(scale=size, size=self.begun.size) * self.sizes.unknowns
            found, right = self.descend((best.y if from_best else self.begun) + kick)
            spent += found.iterations
            if right:
                return found, True, spent, attempt + 1
            if found.part < best.part:
                best = found
        return best, False, spent, _ATTEMPTS

    def _nearer(self, closer: np.ndarray) -> Iterator[np.ndarray]:
        """Other places that are likely to close: the sketch shifted, and without what is wished for."""
        turning = self.block.unknowns.turning
        if self.block.unknowns.linear:
            return
        if not turning.all():
            yield brought_near(self._hard, self.begun, turning, self.sizes)
        if not np.array_equal(closer, self.begun):
            yield closer

    def _wished_for(self) -> np.ndarray:
        """Where constraints and wishes, which weigh the same, are met as well as can be on the way down from the sketch."""
        hard, soft = self._hard, self._soft
        assert soft is not None

        def both(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            (c, J), (r, Jw) = hard(y), soft(y)
            return np.concatenate([c, r]), np.vstack([J, Jw])

        sizes = replace(self.sizes, rows=np.concatenate([self.sizes.rows, np.ones(len(self.block.wished))]), rounding=None)
        return assemble(held(both, self.still), self.begun, sizes=sizes, stride=self._stride).y

    def meets_wishes(self, y: np.ndarray) -> bool:
        """Whether everything is met that start values wish for."""
        if self._soft is None:
            return True
        return bool(np.all(np.abs(self._soft(y)[0][self.block.alike > 0]) <= _MISSED))

    def nearest(self, found: Assembled, spent: int, restarts: int) -> Found:
        """The best of what was found and of its rivals."""
        unit, hard, still = self.sizes.unknowns, self._hard, list(self.still)

        def candidate(y: np.ndarray) -> Candidate:
            missed = 0.0 if self._soft is None else float(np.linalg.norm(self._soft(y)[0]))
            return Candidate(y / unit, missed, self._apart(y)[0])

        def close(z: np.ndarray) -> Candidate | None:
            guess = z * unit
            guess[still] = found.y[still]
            rival, right = self.descend(guess, False, _PATIENCE)
            return candidate(rival.y) if right else None

        def slopes(z: np.ndarray) -> np.ndarray:
            return self.sizes.scaled(held(hard, still)(z * unit)[1])

        first = candidate(found.y)
        best = nearest_rival(first, self.begun / unit, close, slopes, self.sizes.dependent, wished=self._soft is not None)
        if best.missed > _MISSED:
            rival = close(self._wished_for() / unit)
            best = rival if rival is not None and rival.missed < (1 - _LESS) * best.missed else best
        if best is first:
            return Found(found.y, self.begun, found.gap, found.part, True, spent, restarts)
        left = np.abs(hard(best.z * unit)[0])
        return Found(best.z * unit, self.begun, np.max(left), np.max(left / self.sizes.rows), True, spent, restarts)
