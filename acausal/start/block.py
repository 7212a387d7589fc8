"""A block of a search: unknowns that constraints or wishes connect, and what is much for them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from acausal.loops.joint_distance import Differences
from acausal.numerics.assembly import Residual
from acausal.numerics.bound import BoundFunction
from acausal.numerics.sizes import Drawn, Sizes, bent_size, curvature, positive, row_sizes, unknown_sizes
from acausal.numerics.terms import finite, rounded
from acausal.numerics.thresholds import EDGE, ROUNDING
from acausal.start.apart import Apart, Moving
from acausal.start.rows import Rows
from acausal.start.unknowns import Unknowns

_PROBES = 3
_KEPT = 8
_PACES = ("rad/s", "m/s")
_NONE = np.zeros(0)


def alternatives(leading: Sequence[int], elastic: Sequence[int]) -> tuple[tuple[int, ...], ...]:
    """What may stay as it is, the most first; none where there is nothing."""
    return tuple(dict.fromkeys(still for still in ((*leading, *elastic), tuple(elastic), tuple(leading)) if still))


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
    apart: Apart | Moving | None = None
    """How far positions are from the sketch, velocities from rest; None where unknowns say that by themselves."""
    leading: tuple[int, ...] = ()
    """Those of the unknowns that are states of scalar parts by which nonlinear equations give others in the block."""
    elastic: tuple[int, ...] = ()
    """Those of the unknowns that deform bodies, or are rates of that: they stay as they are where others suffice."""
    winding: tuple[int, ...] = ()
    """Those of the rows that come to zero again in each full turn of a screw, which closes a loop."""
    units: tuple[str, ...] = ()
    """Among velocities: of the unknowns, and then of the rows, "" of those that are no start values."""
    known: dict[bytes, tuple[Sizes, np.ndarray]] = field(default_factory=dict[bytes, tuple[Sizes, np.ndarray]], compare=False)
    """Sizes of some calls before."""

    @functools.cached_property
    def constraints(self) -> Rows:
        """Rows that must be zero."""
        return Rows.of(self.unknowns.y, self.whole, self.hard)

    @functools.cached_property
    def wishes(self) -> Rows | None:
        """Rows that are to be small."""
        return Rows.of(self.unknowns.y, self.whole, self.soft) if self.wished else None

    @property
    def staying(self) -> tuple[tuple[int, ...], ...]:
        """Unknowns that stay where the others suffice: what others follow from and what deforms bodies, or else some of these."""
        return alternatives(self.leading, self.elastic)

    def paces(self, sizes: Sizes) -> np.ndarray:
        """Among velocities, the fastest that turns [rad/s] and that does not [m/s] at its own rate; 0 where there is none."""
        found = np.concatenate([sizes.unknowns, sizes.rows])
        return np.array([np.max(found[np.array(self.units) == unit], initial=0.0) for unit in _PACES])

    @functools.cached_property
    def curved(self) -> bool:
        """Whether some rows are not linear in y: among velocities, circuits may bring such."""
        return any(ca.which_depends(self.hard, self.unknowns.y, 2, False))

    @functools.cached_property
    def _apart(self) -> tuple[Rows, Differences]:
        assert self.apart is not None
        all, own = self.apart.all, {e.element_hash() for e in ca.vertsplit(self.unknowns.y)}
        others = [k for k in range(self.apart.y.numel()) if self.apart.y[k].element_hash() not in own]
        here = all.of(self.unknowns.y)
        rows = ca.substitute(here.rows, self.apart.y[others], self.apart.first[others]) if others else here.rows
        return Rows.of(self.unknowns.y, ca.vertcat(self.whole, self.apart.drawn), rows), here

    def apart_at(self, data: np.ndarray, sizes: Sizes) -> Residual | None:
        """How far positions are from the sketch, y -> (k,) and its Jacobian, in parts of what is much; `data` with `first`."""
        if self.apart is None:
            return None
        rows, differences = self._apart
        unknowns, own = np.ones(self.apart.y.numel()), sizes.unknowns.copy()
        longest = np.max(own[~self.unknowns.turning], initial=0.0)
        if not self.unknowns.linear:  # lengths count alike, whichever way they lead
            own[~self.unknowns.turning] = np.min(own[~self.unknowns.turning], initial=np.inf)
        unknowns[self.places] = own
        loop = float(positive(np.array([np.max(sizes.rows[self.drawn.shifts], initial=longest)]))[0])
        scale = differences.sizes(unknowns, loop, sizes.rate)
        data = np.concatenate([data, self.apart.closed(data[: data.size - self.apart.first.numel()])])

        def apart(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            r, J = rows(y, data)
            return r / scale, J / scale[:, None]

        return apart

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

    def sizes_at(self, y: np.ndarray, data: np.ndarray, first: np.ndarray, factors: np.ndarray) -> Sizes:
        """What is much where a search came to: what is nothing beside the rows at its beginning may be much there."""
        first = first.copy()
        first[self.places] = y
        return self._sizes(np.concatenate([data, first]), first, factors)[0]

    @np.errstate(over="ignore", invalid="ignore")  # what is not finite counts as without size
    def _sizes(self, data: np.ndarray, first: np.ndarray, factors: np.ndarray) -> tuple[Sizes, np.ndarray]:
        of, y = self.unknowns, first[self.places]
        points = [(y, data), *self._probes(y, data)]
        found = [self.constraints(*point) for point in points]
        seen = [] if self.wishes is None else [self.wishes(*point) for point in points]
        hard, soft = _most(found, (len(self.rows), y.size)), _most(seen, (len(self.wished), y.size))
        off, missed = np.abs(found[0][0]), np.abs(seen[0][0]) if seen else _NONE
        unknowns = self._unknown_sizes(np.vstack([hard, soft]), off, missed, self._rounding(y, data))
        # curved rows may be immense where unknowns are much, so that nothing met them any more
        terms = self._rounding(unknowns if of.linear and not self.curved else y, data) + self.drawn.sizes
        sizes, wanted = row_sizes(hard, unknowns, terms, self.drawn), row_sizes(soft, unknowns, np.zeros(len(self.wished)))
        drawn, dependent = self.drawn.terms(sizes), self.drawn.dependent(sizes)
        for k in set(self.alike.tolist()):
            wanted[self.alike == k] = np.max(wanted[self.alike == k])
        rate = 1.0
        if of.linear:  # the unit of time drops out: rates are measured by the largest that is asked for
            heard = np.where(off > ROUNDING * self._rounding(y, data), off, 0.0)  # what is met but for rounding asks for nothing
            asked = np.concatenate([np.abs(y) / unknowns, heard / sizes, missed * factors / wanted if seen else _NONE])
            rate = float(positive(np.array([np.max(asked, initial=0.0)]))[0])
            unknowns, sizes, wanted = unknowns * rate, sizes * rate, wanted * rate
        return Sizes(unknowns, sizes, lambda y: drawn * sizes + self._rounding(y, data), dependent, rate), wanted

    def _unknown_sizes(self, slopes: np.ndarray, off: np.ndarray, missed: np.ndarray, rounding: np.ndarray) -> np.ndarray:
        """What is much for each unknown, from derivatives of all rows, and what is left of constraints and wishes."""
        if self.unknowns.turning.all():
            return np.ones(slopes.shape[1])
        drawn = Drawn.joined([self.drawn, Drawn.exact(missed.size)])
        return unknown_sizes(slopes, self.unknowns.turning, np.concatenate([np.nan_to_num(off) + rounding, missed]), drawn)

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
            c, J = self.constraints(y, data)
            silent = ~of.turning & ~np.any(finite(np.abs(J)), axis=0)
            if silent.any():
                bent = curvature(self.hard, of.y, silent)
                bends = np.array(
                    ca.Function("bends", [ca.vertcat(of.y, self.whole)], [ca.densify(bent)])(np.concatenate([y, data]))
                )
                used = ca.DM(ca.jacobian(self.hard, of.y).sparsity(), 1).full()[:, silent] > 0
                reach[silent] = bent_size(np.abs(c) + self._rounding(y, data), bends, used)
        return [(y + reach * change, data) for change in _scatter(y.size)]


@functools.cache
def _scatter(size: int) -> tuple[np.ndarray, ...]:
    """The same random changes (size,) whenever they are needed."""
    return tuple(np.random.default_rng(3).uniform(-1, 1, (_PROBES, size)))


def _most(found: Sequence[tuple[np.ndarray, np.ndarray]], shape: tuple[int, int]) -> np.ndarray:
    """Largest magnitudes of the Jacobians, entry by entry."""
    return np.max([finite(np.abs(J)) for _, J in found], axis=0) if found else np.zeros(shape)


def _moved(data: np.ndarray, places: np.ndarray, change: np.ndarray) -> np.ndarray:
    result = data.copy()
    result[places] += change
    return result
