"""A walk over assembled configurations, along the freedom that the loops leave, in numbers without unit."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.loops.loop_groups import LoopGroup
from acausal.numerics.assembly import Residual, assemble, corrected
from acausal.numerics.bound import BoundFunction, Columns
from acausal.numerics.entries import entries, places
from acausal.numerics.independent import free_directions, inverse, rank_of
from acausal.numerics.sizes import FAINT, Drawn, Sizes, bent_size, curvature, positive, row_sizes, unknown_sizes
from acausal.numerics.terms import finite, rounded
from acausal.numerics.thresholds import CLOSED, DEPENDENT, FOLLOWS, RANK, ROUNDING

_CLOSED = 1e-8
_CLOSE_ENOUGH = 1e-11
_STRIDES = (0.35, 0.1, 0.03)
_DIRECTIONS = 4
_MOVED = 0.1
_PROBES = 3
_ALIKE = 1e-6
"""Domains that differ by less, of a size of 1, are the same."""
_TIMES = range(-20, 21)
"""Powers of 4 s."""


@dataclass(frozen=True)
class WalkFunctions:
    """What a walk asks of a group of loops at any time `t` and values of the `parameters`, as CasADi functions."""

    group: LoopGroup
    t: ca.SX
    parameters: ca.SX

    @functools.cached_property
    def _expressions(self) -> list[ca.SX]:
        """Closing residuals, their derivatives by q, rows in the velocities, N of q' = N v, and what time changes in the residuals."""
        group, closing = self.group, self.group.closing
        A, N = ca.jacobian(group.velocity, group.v), ca.jacobian(group.rates, group.v)
        return [closing, ca.jacobian(closing, group.q), A, N, ca.jacobian(closing, self.t)]

    @functools.cached_property
    def patterns(self) -> list[ca.Sparsity]:
        """Of the parts of `parts`."""
        return [part.sparsity() for part in self._expressions]

    @functools.cached_property
    def parts(self) -> ca.Function:
        """(q, t, p) -> the entries of all of these in a column."""
        return ca.Function("walk", [self.group.q, self.t, self.parameters], [entries(self._expressions)])

    @functools.cached_property
    def noise(self) -> ca.Function:
        """(q and t, p) -> sizes of the terms of the closing residuals."""
        argument = ca.vertcat(self.group.q, self.t)
        return ca.Function("noise", [argument, self.parameters], [ca.densify(rounded(self.group.closing))])

    @functools.cached_property
    def terms(self) -> ca.Function:
        """(q, v, t, p) -> sizes of the terms of the rows in the velocities."""
        group = self.group
        return ca.Function("terms", [group.q, group.v, self.t, self.parameters], [ca.densify(rounded(group.velocity))])

    @functools.cached_property
    def turned(self) -> ca.Function:
        """(q, t, p, weights of the rows in the velocities) -> how their sum (nv,) changes with q, (nv, nq)."""
        group, weights = self.group, ca.SX.sym("weights", self.group.velocity.numel())
        total = ca.gradient(ca.dot(weights, group.velocity), group.v)
        return ca.Function("turned", [group.q, self.t, self.parameters, weights], [ca.jacobian(total, group.q)])

    def bends(self, places: np.ndarray) -> ca.Function:
        """(q, t, p) -> second derivatives of the closing residuals by the coordinates at `places` (nq,)."""
        bent = curvature(self.group.closing, self.group.q, places)
        return ca.Function("bends", [self.group.q, self.t, self.parameters], [ca.densify(bent)])

    @functools.cached_property
    def influences(self) -> tuple[int, ...]:
        """Places of the parameters on which it depends where the group is closed, and where it is drawn."""
        group = self.group
        used = {s.element_hash() for s in ca.symvar(ca.vertcat(group.closing, group.velocity, group.domain, group.sketch))}
        return tuple(i for i in range(self.parameters.numel()) if self.parameters[i].element_hash() in used)

    @functools.cached_property
    def meant(self) -> ca.Function:
        """(q, t, p) -> what is positive on the branches that are meant: joints' domains, signs of hinges that close loops; and derivatives by q."""
        group = self.group
        known = {s.element_hash() for s in (*ca.vertsplit(group.q), self.t, *ca.vertsplit(self.parameters))}
        signs = [rows.sign for rows in group.loops if rows.sign is not None]
        signs = [sign for sign in signs if {s.element_hash() for s in ca.symvar(sign)} <= known]
        meant = ca.densify(ca.vertcat(group.domain, *signs))
        return ca.Function("meant", [group.q, self.t, self.parameters], [meant, ca.densify(ca.jacobian(meant, group.q))])

    def domain_bends(self, places: np.ndarray) -> ca.Function:
        """(q, t, p) -> second derivatives of the joints' domain by the coordinates at `places` (nq,)."""
        bends = ca.densify(curvature(self.group.domain, self.group.q, places))
        return ca.Function("domain_bends", [self.group.q, self.t, self.parameters], [bends])


class Walk:
    """Assembled configurations z of a group of loops one after the other, for parameters of these `values`, at the time `time`.

    z = q / `unit` (nq,): lengths are measured by the group's own lever arms; velocities of the size `rate` (nv,) change z by 1 in a second.
    A: the rows of the loops in the velocities, these and the rows divided by what is much for them.
    """

    def __init__(self, symbolic: WalkFunctions, values: np.ndarray, guess: np.ndarray, time: float = 0.0) -> None:
        group = symbolic.group
        self.symbolic, self.guess = symbolic, guess
        self.values = values
        self._parts = _Parts(symbolic.parts, symbolic.patterns, values)
        self._noise = _bound(symbolic.noise, guess.size, values)
        self.time = time
        self._drawn = np.zeros(symbolic.noise.numel_out(0))
        drawn = group.drawn
        at_guess = self._parts(guess, time)
        silent = ~group.turning & ~np.any(finite(np.abs(at_guess[1])), axis=0)
        reach = np.where(group.turning, 1.0, 0.0)
        if silent.any():
            bends = np.array(symbolic.bends(silent)(guess, time, values))
            reach[silent] = bent_size(np.abs(at_guess[0][:, 0]) + self._rounding(guess), bends, self._used[:, silent])
        own, bent = self._bent(at_guess[1])
        reach = np.where(bent > 0, bent, reach)
        rng = np.random.default_rng(3)
        probes = [guess, *(guess + reach * rng.uniform(-1, 1, guess.size) for _ in range(_PROBES))]
        found = [self._parts(q, time) for q in probes]
        c, J, A, N, _ = (np.max(finite(np.abs(part)), axis=0) for part in map(np.array, zip(*found, strict=True)))
        rates_drawn = Drawn.joined([rows.drawn for rows in group.loops])
        J = np.where(drawn.unsure(J) & group.turning, 0.0, J)  # lever arms that rounding of distances leaves where there are none
        A = np.where(rates_drawn.unsure(A) & np.any(N[group.turning] > 0, axis=0), 0.0, A)
        arms = _lengths_of_rates(self._heard(A, N, J, probes), N, group.turning)
        instead = np.maximum(np.maximum(bent, arms), self._inside())
        terms = c + self._rounding(guess)[:, None]
        terms = np.where((own[:, None] > 0) | drawn.unsure(terms), 0.0, terms)[:, 0]
        loudest = np.max([self._rounding(q) for q in probes], axis=0, initial=0.0) + c[:, 0]
        self.unit = unknown_sizes(J, group.turning, terms, drawn, instead, loudest)
        self.rate = 1.0 / positive(np.max(N / self.unit[:, None], axis=0, initial=0.0))
        self._rows = row_sizes(J, self.unit, self._rounding(guess) + drawn.sizes, drawn)
        self._drawn = drawn.terms(self._rows) * self._rows
        self.dependent, self.rank, self.follows = (drawn.dependent(self._rows, least) for least in (DEPENDENT, RANK, FOLLOWS))
        terms = [finite(np.array(symbolic.terms(q, self.rate, time, values)).ravel()) for q in probes]
        terms = np.max(terms, axis=0, initial=0.0) + rates_drawn.sizes
        self._velocity = _without_noise(A @ self.rate, terms)
        self.noise = ROUNDING * terms / self._velocity
        """What rounding makes of the rows in the velocities (m,), in parts of what is much for them."""
        one = np.ones(1)
        self._parts.scale((self._rows, one), (self._rows, self.unit), (self._velocity, self.rate), (self.unit, self.rate))

    @functools.cached_property
    def _used(self) -> np.ndarray:
        """Which unknowns stand in which closing residuals (n, nq)."""
        group = self.symbolic.group
        return ca.DM(ca.jacobian(group.closing, group.q).sparsity(), 1).full() > 0

    def _heard(self, A: np.ndarray, N: np.ndarray, J: np.ndarray, probes: list[np.ndarray]) -> np.ndarray:
        """The largest coefficients A (m, nv) of the rows in the velocities at these places, without those that are rounding errors: of velocities
        that no closing residual changes with.
        """
        turning, shifts = self.symbolic.group.turning, self.symbolic.group.drawn.shifts
        silent = ~np.any(np.where(shifts, CLOSED, 0.0)[:, None] < J, axis=0) & ~turning
        heard = A.copy()
        for k in np.flatnonzero(np.any(N[silent] > 0, axis=0) & ~np.any(N[~silent] > 0, axis=0)):
            alone = np.eye(A.shape[1])[k]
            terms = [finite(np.array(self.symbolic.terms(q, alone, self.time, self.values)).ravel()) for q in probes]
            heard[:, k] = np.where(A[:, k] > CLOSED * np.max(terms, axis=0, initial=0.0), A[:, k], 0.0)
        return heard

    def _bent(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lengths of rows (m,) without angles whose slope J at the guess changes with place, as a rod between particles has it, and of the
        unknowns (nq,) in them: how far these go until it is another one, wherever the origin is. Zero for others.
        """
        group, straight = self.symbolic.group, ~self.symbolic.group.turning
        if not (straight.any() and group.closing.numel()):
            return np.zeros(group.closing.numel()), np.zeros(self.guess.size)
        used = self._used
        bends = np.max(np.abs(np.array(self.symbolic.bends(straight)(self.guess, self.time, self.values))), axis=1)
        plain = (bends > 0) & np.isfinite(bends) & ~used[:, group.turning].any(axis=1)
        slopes = np.max(finite(np.abs(J)), axis=1, initial=0.0)
        own = np.divide(slopes, bends, out=np.zeros_like(slopes), where=plain)
        return own, np.max(own[:, None] * used, axis=0, initial=0.0)

    def _inside(self) -> np.ndarray:
        """How far coordinates (nq,) go until what joints say of their domain, which is 1 well inside, is another; zero where nothing is said."""
        group, at = self.symbolic.group, (self.guess, self.time, self.values)
        straight = ~group.turning & (ca.DM(ca.jacobian(group.domain, group.q).sparsity(), 1).full() > 0).any(axis=0)
        if not straight.any():
            return np.zeros(self.guess.size)
        domain, slopes = (np.array(part)[: group.domain.numel()] for part in self.symbolic.meant(*at))
        steepest = np.max(np.abs(np.nan_to_num(slopes)), axis=0, initial=0.0)
        found = np.divide(1.0, steepest, out=np.zeros(self.guess.size), where=straight & (steepest > 0))
        bends = np.array(self.symbolic.domain_bends(straight)(*at))
        found[straight] = np.where(steepest[straight] > 0, found[straight], bent_size(np.ones(len(bends)), bends))
        for k in np.flatnonzero(found):
            there = self.guess + found[k] * np.eye(found.size)[k]
            changes = np.abs(np.array(self.symbolic.meant(there, self.time, self.values)[0])[: len(domain)] - domain)
            if (changes < _ALIKE).all():  # its slope is what rounding leaves of none, as around a cylinder
                found[k] = 0.0
        return found

    def _rounding(self, q: np.ndarray) -> np.ndarray:
        return self._drawn + finite(self._noise.at(np.append(q, self.time)))

    @property
    def sizes_of_velocities(self) -> tuple[np.ndarray, np.ndarray]:
        """What is much for each velocity (nv,), and for each row in them (m,), infinite for rows of rounding errors."""
        return self.rate, self._velocity

    @property
    def row_sizes(self) -> np.ndarray:
        """What is much in each closing residual (n,)."""
        return self._rows

    @property
    def sizes(self) -> Sizes:
        """For `assemble`, of z and of residuals as `at` gives them."""
        ones = np.ones(self.unit.size), np.ones(self._rows.size)
        return Sizes(*ones, lambda z: self._rounding(z * self.unit) / self._rows, self.dependent)

    @property
    def length(self) -> float:
        """Of the loops [m], that shifts are measured by; where nothing is shifted the longest of the unknowns."""
        return float(np.max(self._rows[self.symbolic.group.drawn.shifts], initial=np.max(self.unit)))

    def differences(self, rows: ca.SX) -> Residual:
        """Some more rows (k, 1) in q, the time and the parameters: z -> the rows and their Jacobian, with units."""
        symbolic = self.symbolic
        q = symbolic.group.q
        J = ca.jacobian(rows, q)
        function = ca.Function("differences", [q, symbolic.t, symbolic.parameters], [entries([rows, J])])
        parts = _Parts(function, [rows.sparsity(), J.sparsity()], self.values)

        def evaluate(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            r, J = parts(z * self.unit, self.time)
            return r[:, 0], J * self.unit

        return evaluate

    @property
    def empty(self) -> np.ndarray:
        """(m,), rows in the velocities that only hold rounding errors."""
        return np.isinf(self._velocity)

    def gaps(self, z: np.ndarray) -> np.ndarray:
        """Closing residuals (n,) with their units."""
        return self._parts(z * self.unit, self.time)[0][:, 0]

    def terms(self, z: np.ndarray) -> np.ndarray:
        """Sizes of the terms of the closing residuals (n,), with their units."""
        return self._rounding(z * self.unit)

    def at(self, z: np.ndarray) -> list[np.ndarray]:
        """Closing residuals (n, 1), their Jacobian in z, A, and N with z' = N v."""
        return self._parts.scaled(z * self.unit, self.time, 4)

    def meant(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is positive where the group is meant to be (k, 1), and its derivatives by z: joints' domains first."""
        values, slopes = self.symbolic.meant(z * self.unit, self.time, self.values)
        return np.array(values), np.array(slopes) * self.unit

    def bent(self, z: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """How the sum of the rows A, with these `weights` (m,), changes with z: (nv, nq)."""
        turned = self._turned(z * self.unit, self.time, self.values, weights / self._velocity)
        return turned.reshape(self.symbolic.turned.size_out(0), order="F") * self.rate[:, None] * self.unit

    @functools.cached_property
    def _turned(self) -> Columns:
        return Columns(self.symbolic.turned)

    def rows(self, z: np.ndarray) -> np.ndarray:
        """A (m, nv) with the rows' own units."""
        return self._parts(z * self.unit, self.time)[2] * self.rate

    def closing(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Closing residuals (n,) and their Jacobian, for `assemble`."""
        c, J = self._parts.scaled(z * self.unit, self.time, 2)
        return c[:, 0], J

    @functools.cached_property
    def span(self) -> float:
        """Time [s] in which what is driven moves by about the size of the loops: at the start, or where it rests then as soon as it moves."""
        for time in (0.0, *(4.0**k for k in _TIMES)):
            slope = np.abs(self._parts(np.zeros(self.unit.size), time)[4][:, 0]) / self._rows
            fastest = float(np.max(np.nan_to_num(slope), initial=0.0))
            if fastest * time > _MOVED or (time == 0.0 and fastest > 0):
                return 1 / fastest
        return 1.0

    def later(self, z: np.ndarray, spans: float = 0.0) -> np.ndarray | None:
        """A configuration near z with closed loops at any time, which then is the walk's own; None where none is found.

        Looked for from so many `spans` of the motion that is given.
        """
        span = self.span

        def residual(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            self.time = span * float(y[-1])
            c, J = self.closing(y[:-1])
            by_time = self._parts(y[:-1] * self.unit, self.time)[4] * span / self._rows[:, None]
            return c, np.hstack([J, by_time])

        found = assemble(residual, np.append(z, spans), tolerance=_CLOSE_ENOUGH)
        self.time = span * float(found.y[-1])
        exact = assemble(self.closing, found.y[:-1], sizes=self.sizes) if found.converged else found
        return exact.y if exact.converged else None

    def closed(self, z: np.ndarray, tolerance: float = _CLOSED, rank: int | None = None) -> np.ndarray | None:
        """A configuration next to z with closed loops; None where Newton's method does not find one at once.

        `rank` of the Jacobian where loops are closed, if known: beside it, rows that are redundant there look independent, with
        singular values of the size of the gap, and steps along them go far astray.
        """

        def enough(c: np.ndarray, z: np.ndarray) -> bool:
            return bool(np.all(np.abs(c) < np.maximum(tolerance, ROUNDING * self._rounding(z * self.unit) / self._rows)))

        return corrected(self.closing, z, enough, self.dependent, rank)

    def samples(self, start: np.ndarray, count: int) -> list[np.ndarray]:
        """The assembled `start`, then up to `count` further configurations to either side, as far apart as the freedom allows; only the
        start where its parts have no room to move though the constraints' rank would allow it.
        """
        rng = np.random.default_rng(1)
        found = [start]
        ahead = rng.normal(size=self.rate.size)
        for sense in (1.0, -1.0):
            here, along = start, sense * ahead
            for _ in range(count):
                step = self._step(here, along, rng)
                if step is None:
                    break
                here, along = step
                found.append(here)
        return found

    def apart(self, z: np.ndarray, other: np.ndarray) -> np.ndarray:
        """How far configurations (..., nq) are from another one, but for whole turns."""
        turns = 2 * np.pi * self.symbolic.group.turning
        return z - other - turns * np.round((z - other) / np.where(turns > 0, turns, np.inf))

    def polished(self, z: np.ndarray) -> np.ndarray:
        """A closed configuration, closed to rounding; beside one where a part has no meaning."""
        c, J = self.closing(z)
        for _ in range(2):
            closer = z - inverse(J, self.dependent, rank_of(J, self.rank))(c)
            c, J = self.closing(closer)
            if not (np.isfinite(c).all() and np.isfinite(J).all()):
                break
            z = closer
        return z

    def _step(self, here: np.ndarray, ahead: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray] | None:
        """The next configuration and the direction that led there, first tried along `ahead`; None where nothing moves."""
        _, J, A, N = self.at(here)
        if not (np.isfinite(J).all() and np.isfinite(A).all()):
            return None
        free, freedoms = free_directions(A, self.rank)
        if freedoms == 0:
            return None
        rank = rank_of(J, self.rank)
        for stride in _STRIDES:
            for attempt in range(_DIRECTIONS):
                along = free(ahead if attempt == 0 else rng.normal(size=ahead.size))
                if not np.max(np.abs(along)) > 1e-6:
                    continue
                along = along / np.max(np.abs(along))
                ahead_of = here + N @ (stride * along)
                # from a singular position to others more rows may be independent: all, or some where others are redundant
                for kept in (rank, None, *range(rank + 1, min(J.shape))):
                    found = self.closed(ahead_of, _CLOSE_ENOUGH, kept)
                    if found is not None and np.max(np.abs(found - here)) > _MOVED * stride * np.max(np.abs(N @ along)):
                        return found, along
        return None


class _Parts:
    """Several matrices of q and t, functions of (q, t, p), in one call that gives their `entries`; and without units once `scale` is known."""

    def __init__(self, function: ca.Function, patterns: list[ca.Sparsity], values: np.ndarray) -> None:
        self._places = [places(pattern) for pattern in patterns]
        self._shapes = [pattern.shape for pattern in patterns]
        self._entries = np.cumsum([0, *(pattern.nnz() for pattern in patterns)]).tolist()
        self._ends = np.cumsum([0, *(pattern.numel() for pattern in patterns)]).tolist()
        self._where = np.concatenate(
            [end + i + shape[0] * j for end, shape, (i, j) in zip(self._ends[:-1], self._shapes, self._places, strict=True)]
        )
        self._above = self._below = np.zeros(0)
        self._q, self._t = np.empty(function.size1_in(0)), np.zeros(1)
        given = (self._q, self._t, np.array(values, dtype=float))
        self._bound = BoundFunction(function, given, np.empty(function.numel_out(0)))

    def scale(self, *sizes: tuple[np.ndarray, np.ndarray]) -> None:
        """What rows are divided by and columns multiplied with, for the first of the matrices."""
        own = list(zip(self._places, sizes, strict=False))
        self._above = np.concatenate([above[j] for (_, j), (_, above) in own])
        self._below = np.concatenate([below[i] for (i, _), (below, _) in own])

    def __call__(self, q: np.ndarray, t: float) -> list[np.ndarray]:
        """All matrices as they are."""
        self._q[:], self._t[0] = q, t
        return self._matrices(self._bound(), len(self._shapes))

    def scaled(self, q: np.ndarray, t: float, count: int) -> list[np.ndarray]:
        """So many of the first, without units."""
        self._q[:], self._t[0] = q, t
        own = slice(self._entries[count])
        return self._matrices(self._bound()[own] * self._above[own] / self._below[own], count)

    def _matrices(self, entries: np.ndarray, count: int) -> list[np.ndarray]:
        """So many of the first, column-major."""
        found = np.zeros(self._ends[count])
        found[self._where[: self._entries[count]]] = entries
        parts = zip(itertools.pairwise(self._ends), self._shapes[:count], strict=False)
        return [found[first:last].reshape(shape, order="F") for (first, last), shape in parts]


def _lengths_of_rates(A: np.ndarray, N: np.ndarray, turning: np.ndarray) -> np.ndarray:
    """Sizes (nq,) of coordinates that have arms in rows of the velocities only: where wheels of a cart stand. Zero where there are none."""
    turns = np.any(N[turning] > 0, axis=0)
    arms = np.max(A[:, turns], axis=1, initial=0.0)[:, None]
    heard = FAINT * np.max(A, axis=0, initial=0.0) < A
    speeds = np.where(turns, 1.0, np.max(np.divide(arms, A, out=np.zeros_like(A), where=heard), axis=0, initial=0.0))
    return np.max(N * speeds, axis=1, initial=0.0)


def _bound(function: ca.Function, size: int, values: np.ndarray) -> BoundFunction:
    """A function of (q and t, parameters) bound, with these values of the parameters."""
    return BoundFunction(function, (np.empty(size + 1), np.array(values, dtype=float)), np.empty(function.numel_out(0)))


def _without_noise(sizes: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Sizes (m,) of rows in the velocities; infinite where a row only holds rounding errors and so is no constraint."""
    return np.where(sizes > CLOSED * noise, positive(sizes), np.inf)
