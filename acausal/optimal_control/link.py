"""Where one phase ends and another begins: what goes on as it was, what is reset, and what impacts change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.numerics.folding import folded_function
from acausal.optimal_control.asked import GIVEN, ROOM, Limits
from acausal.optimal_control.conditions import given_rows
from acausal.optimal_control.mode import PhaseMode
from acausal.optimal_control.separable import Program, Term
from acausal.optimal_control.stage import Stage, independent_rows
from acausal.optimal_control.transcription import Transcribed


@dataclass(frozen=True, eq=False)
class Link:
    """The end of the phase `before` is the start of the phase `after` (numbers).

    `values`: pairs of columns (n, 1), of the unknowns of the stage after and of that before, and what they are called; None: all states go on, but for those of
    the numbers `drift`. `impact`: what holds when it strikes, before what is reset; None without one. `strictly`: rows that follow from others where both meet are asked all the same, unless
    they do beside that, too: what follows near by may be another thing farther on, as the side to which a leg leans from the height of its hip.
    """

    before: int
    after: int
    values: Sequence[tuple[ca.SX, ca.SX, str]] | None
    drift: Sequence[int]
    impact: PhaseMode | None
    strictly: bool = False


@dataclass(frozen=True, eq=False)
class Impact:
    """States x (nx, 1) of a stage just after a blow by `impulses` (n, 1): all velocities change by what these do, positions stay.

    `rows`: what is zero, and its name, an entry for each impulse; `bounds`: what must not be negative.
    """

    impulses: ca.SX
    after: ca.SX
    rows: list[tuple[ca.SX, str]]
    bounds: list[tuple[ca.SX, str]]


def impact_of(stage: Stage, struck: PhaseMode) -> Impact:
    """At the end of a stage. What is closed then comes to rest there, what bounces returns with its restitution times its speed (Newton), friction
    sticks, or slides with its limit. Forces that have limits of their own do nothing in no time.
    """
    space, system = stage.functions.space, stage.functions.outputs.system
    modes = system.modes
    assert modes is not None
    R = ca.SX.sym("impulse", modes.reactions.numel())
    after = space.x + space.put(ca.horzcat(*(space.kept(modes.response[:, k]) for k in range(R.numel())))) @ R

    def then(value: ca.SX) -> ca.SX:
        return ca.substitute(space.put(value), space.x, after)

    def limit(value: ca.SX) -> ca.SX:
        return space.put(ca.jacobian(value, modes.reactions)) @ R

    rows: list[tuple[ca.SX, str]] = []
    bounds: list[tuple[ca.SX, str]] = []
    for law, was in zip(stage.mode.laws, stage.mode.words, strict=True):
        own, word = R[law.reactions], struck.word(law)
        rate, row, name = struck.rate(law), law.row, f"the impact of {law.name}"
        if row.restitution is not None:
            if word == "bounces":
                rows.append((then(rate) + space.put(row.restitution * rate), name))
            else:
                rows.append((then(rate) if law.holds(word) else own, name))
            if word == "bounces" or law.holds(word):
                bounds.append((own, name))
            elif law.holds(was):
                bounds.append((then(rate), f"{law.name} opens in the impact"))
            continue
        assert row.sliding is not None and row.holding is not None
        if word == "sticks" and law.needs:
            rows.append((then(rate), name))
            most = limit(row.holding)
            bounds.append((ca.vertcat(most - own, most + own) if row.size == 1 else most**2 - ca.sumsqr(own), name))
        elif word.startswith("slides") and law.needs:
            slip = then(rate)
            along = {"slides +": ca.SX(1), "slides -": ca.SX(-1)}.get(word, slip / ca.norm_2(slip))
            rows.append((own + limit(row.sliding) * along, name))
            if row.size == 1:
                bounds.append((slip * along, f"{law.name} slides after the impact"))
        else:
            rows.append((own, name))
    return Impact(R, after, rows, bounds)


@dataclass(frozen=True, eq=False)
class _Ends:
    """Where one phase ends and another begins: `symbols` (n, 1) of the point before, of that after, and of impulses, with the `places` (n,) where they stand
    (-1: nowhere), their `units` (n,) and guesses `at` (n,).
    """

    old: Transcribed
    new: Transcribed
    symbols: ca.SX
    places: np.ndarray
    units: np.ndarray
    at: np.ndarray

    @staticmethod
    def of(old: Transcribed, new: Transcribed, begins: tuple[int, int], impulses: ca.SX, first: int) -> _Ends:
        """`begins`: where the unknowns of both phases begin; `first`: that of the impulses."""
        ends = (old, old.mesh.intervals, begins[0]), (new, 0, begins[1])
        own = [part.layout.node(k) for part, k, _ in ends]
        places = [np.where(node >= 0, node + begin, -1) for node, (_, _, begin) in zip(own, ends, strict=True)]
        units = [np.where(node >= 0, part.units[node], 1.0) for node, (part, _, _) in zip(own, ends, strict=True)]
        at = [
            np.where(node >= 0, part.program.guess[node] * part.units[node], 0.0)
            for node, (part, _, _) in zip(own, ends, strict=True)
        ]
        n = impulses.numel()
        return _Ends(
            old, new, ca.vertcat(old.asked.stage.unknowns, ca.SX.sym("after", new.asked.stage.unknowns.numel()), impulses),
            np.concatenate([*places, first + np.arange(n)]), np.concatenate([*units, np.ones(n)]), np.concatenate([*at, np.zeros(n)]),
        )  # fmt: skip

    def before(self, column: ca.SX) -> ca.SX:
        """An expression of the stage before, at its end."""
        stage = self.old.asked.stage
        return ca.substitute(stage.put(column), stage.data, ca.SX(ca.DM([1.0, 0.0])))

    def after(self, column: ca.SX) -> ca.SX:
        """An expression of the stage after, at its start."""
        stage, n = self.new.asked.stage, self.old.asked.stage.unknowns.numel()
        there = ca.substitute(stage.put(column), stage.data, ca.SX(ca.DM([0.0, 0.0])))
        return ca.substitute(there, stage.unknowns, self.symbols[n : n + stage.unknowns.numel()])

    def number(self, column: ca.SX, at: np.ndarray | None = None) -> np.ndarray:
        """At the guess."""
        return np.array(ca.Function("number", [self.symbols], [ca.densify(column)])(self.at if at is None else at))


def linked(program: Program, link: Link, parts: Sequence[Transcribed], begins: Sequence[int]) -> tuple[Program, list[str]]:
    """With rows, and unknowns for impulses; and names of the rows."""
    old, new = parts[link.before], parts[link.after]
    a = old.asked.stage
    blow = None if link.impact is None else impact_of(a, link.impact)
    R = ca.SX(0, 1) if blow is None else blow.impulses
    ends = _Ends.of(old, new, (begins[link.before], begins[link.after]), R, program.size)
    rows: list[tuple[ca.SX, float, str]] = []  # value, upper limit, name
    impulses, idle, much = np.zeros(R.numel()), np.zeros(0, dtype=int), np.zeros(R.numel())
    if blow is not None:
        struck = ends.before(ca.vertcat(*(value for value, _ in blow.rows)))
        impulses, kept = _impulses(ends, struck, R)
        much = _blows(ends, blow, impulses)
        names = [name for value, name in blow.rows for _ in range(value.numel())]
        rows += [(struck[int(r)], 0.0, names[int(r)]) for r in kept]
        idle = np.setdiff1d(np.arange(R.numel()), kept)
        rows += [(ends.before(value)[r], np.inf, name) for value, name in blow.bounds for r in range(value.numel())]
    states = a.functions.space.x
    values = link.values if link.values is not None else _unchanged(old, new, link.drift)
    then = states if blow is None else blow.after
    pairs = [(mine[r], ca.substitute(its, states, then)[r], name) for mine, its, name in values for r in range(mine.numel())]
    slopes = _Slopes(ends, link)
    chosen = slopes.adding(ca.vertcat(*(mine for mine, _, _ in pairs)), ca.vertcat(*(its for _, its, _ in _entries(values))))
    rows += [(ends.after(pairs[r][0]) - ends.before(pairs[r][1]), 0.0, pairs[r][2]) for r in chosen]
    return _with_rows(program, ends, rows, impulses, idle, much)


def torn(link: Link, parts: Sequence[Transcribed], found: Sequence[np.ndarray]) -> list[str]:
    """What does not go on in motions that were found, by the unknowns of the programs of all phases, in words: rows that were left out since they follow from others are among it. Velocities that an
    impact changes are not.
    """
    old, new = parts[link.before], parts[link.after]
    states = old.asked.stage.functions.space.x
    ends, begins = old.motion(found[link.before]), new.motion(found[link.after])
    nx = new.asked.stage.sizes[0]
    before = np.concatenate([ends.values[-1], [ends.duration], ends.free])
    after = np.concatenate([begins.values[0, :nx], np.zeros(new.asked.stage.width - nx), [begins.duration], begins.free])
    changed = ca.SX() if link.impact is None else states[old.asked.stage.functions.space.nq :, :]
    said = list[str]()
    for mine, its, name in link.values if link.values is not None else _unchanged(old, new, link.drift):
        if changed.numel() and ca.depends_on(its, changed):
            continue
        first, first_slopes = _valued(old, its, before, 1.0)
        second, second_slopes = _valued(new, mine, after, 0.0)
        much = np.maximum(first_slopes @ old.units[: first_slopes.shape[1]], second_slopes @ new.units[:nx])
        room = ROOM * np.maximum(much, np.maximum(np.abs(first), np.abs(second)))
        said += [
            f"{name}: it is {first[r]:.6g} where phase {link.before + 1} ends, and {second[r]:.6g} where phase {link.after + 1} begins"
            for r in np.flatnonzero(np.abs(first - second) > 10 * room)
        ]
    return said


def _valued(part: Transcribed, column: ca.SX, z: np.ndarray, at: float) -> tuple[np.ndarray, np.ndarray]:
    """A column at a point, and its absolute slopes by states."""
    value, slopes = part.asked.stage.slopes(part.asked.stage.put(column))(z, [at, 0.0])
    return np.array(value).ravel(), np.abs(np.array(slopes)).reshape(column.numel(), -1)


def _entries(values: Sequence[tuple[ca.SX, ca.SX, str]]) -> list[tuple[ca.SX, ca.SX, str]]:
    return [(mine[r], its[r], name) for mine, its, name in values for r in range(mine.numel())]


def _unchanged(old: Transcribed, new: Transcribed, drift: Sequence[int]) -> list[tuple[ca.SX, ca.SX, str]]:
    x, names = old.asked.stage.functions.space.x, old.asked.stage.functions.state_names
    return [(x[i], x[i], f"{names[i]} goes on") for i in range(x.numel()) if i not in drift]


def _impulses(ends: _Ends, rows: ca.SX, R: ca.SX) -> tuple[np.ndarray, np.ndarray]:
    """Those of the guess (n,), and which rows do not follow from others."""
    slopes, off = ends.number(ca.jacobian(rows, R)), ends.number(rows).ravel()
    if not (np.isfinite(slopes).all() and np.isfinite(off).all()):
        return np.zeros(off.size), np.arange(off.size)
    size = np.linalg.norm(slopes, axis=1)
    kept = np.array(independent_rows(slopes / np.where(size > 0, size, 1.0)[:, None]), dtype=int)
    found = np.zeros(off.size)
    found[kept] = np.linalg.lstsq(slopes[np.ix_(kept, kept)], -off[kept], rcond=1e-10)[0]
    return found, kept


def _blows(ends: _Ends, blow: Impact, impulses: np.ndarray) -> np.ndarray:
    """What is much for each impulse (n,): the largest of the guess; where there is none what changes a velocity by what is much for that."""
    largest = float(np.max(np.abs(impulses), initial=0.0))
    if largest > 0:
        return np.full(impulses.size, largest)
    nx = ends.old.asked.stage.sizes[0]
    changes = np.abs(ends.number(ca.jacobian(ends.before(blow.after), blow.impulses))) / ends.units[:nx, None]
    most = np.max(np.where(np.isfinite(changes), changes, 0.0), axis=0, initial=0.0)
    return 1 / np.where(most > 0, most, 1.0)


@dataclass(frozen=True, eq=False)
class _Slopes:
    """What is known of the states before and after, to first order beside the guess and in units of their sizes."""

    ends: _Ends
    link: Link

    def adding(self, mine: ca.SX, its: ca.SX) -> list[int]:
        """Numbers of the rows mine (after) - its (before) that do not follow from what is known, as well conditioned as they can be."""
        there = self if self.link.strictly else replace(self, ends=replace(self.ends, at=self._meeting(mine, its)))
        return there._adding(mine, its)

    def _adding(self, mine: ca.SX, its: ca.SX) -> list[int]:
        old, new = self.ends.old, self.ends.new
        a, b = old.asked.stage, new.asked.stage
        before, after = self._of(a, its, end=True), self._of(b, mine, end=False)
        free = self._free()
        known, known_after = self._of(a, self._known_before(), end=True), self._of(b, self._known_after(), end=False)
        rows = np.block([
            [known, np.zeros((len(known), int(free.sum())))],
            [np.zeros((len(known_after), before.shape[1])), known_after[:, free]],
        ])  # fmt: skip
        wanted = np.hstack([-before, after[:, free]])
        size = np.linalg.norm(wanted, axis=1)
        wanted = wanted / np.where(size > 0, size, 1.0)[:, None]
        size = np.linalg.norm(rows, axis=1)
        rows = rows[size > 0] / size[size > 0][:, None]
        if len(rows):
            wanted = wanted - wanted @ np.linalg.pinv(rows, rcond=_RANK) @ rows
        return [int(r) for r in independent_rows(wanted)]

    def _meeting(self, mine: ca.SX, its: ca.SX) -> np.ndarray:
        """Where both phases meet, near the guess: rows that follow from others are seen where all of them hold, and not beside. The guess, where no such point is found."""
        ends, free = self.ends, self._free()
        nx, n = ends.old.asked.stage.sizes[0], ends.old.asked.stage.unknowns.numel()
        places = np.append(np.arange(nx), n + np.flatnonzero(free))
        column = ca.vertcat(
            ends.before(self._known_before()), ends.after(self._known_after()), ends.after(mine) - ends.before(its)
        )
        slopes = ca.densify(ca.jacobian(column, ends.symbols[places.tolist()]))
        f = ca.Function("meeting", [ends.symbols], [ca.densify(column), slopes])
        units, at = ends.units[places], ends.at.copy()
        at[places] += _ASIDE * units * np.random.default_rng(0).uniform(-1, 1, places.size)
        for _ in range(_STEPS):
            off, J = (np.array(part) for part in f(at))
            J = J * units
            size = np.linalg.norm(J, axis=1, keepdims=True)
            size[size == 0] = 1.0
            if not (np.isfinite(off).all() and np.isfinite(J).all()):
                break
            if np.max(np.abs(off / size), initial=0.0) <= _MET:
                return at
            at[places] -= units * np.linalg.lstsq(J / size, off[:, 0] / size[:, 0], rcond=_CLEAR)[0]
        return ends.at

    def _of(self, stage: Stage, column: ca.SX, *, end: bool) -> np.ndarray:
        """Slopes of a column of a stage by its states, times their units."""
        x = stage.functions.space.x
        nx, n = x.numel(), self.ends.old.asked.stage.unknowns.numel()
        first = 0 if end else n
        inside = (self.ends.before if end else self.ends.after)(ca.jacobian(column, x))
        found = self.ends.number(inside).reshape(column.numel(), nx)
        return np.nan_to_num(found * self.ends.units[first : first + nx])

    def _free(self) -> np.ndarray:
        start = self.ends.new.asked.start
        nx = self.ends.new.asked.stage.sizes[0]
        return np.ones(nx, dtype=bool) if start is None else ~np.isfinite(start)

    def _known_before(self) -> ca.SX:
        """What is zero at the end, after an impact."""
        asked = self.ends.old.asked
        stage = asked.stage
        given = [limits for at, limits in asked.here if at == 1.0]
        rows = [one for limits in given for one in _held(limits, range(limits.value.numel()))]
        if self.link.impact is None:
            rows.append(stage.invariants[0])
        else:
            struck = replace(stage, mode=self.link.impact)
            positions = stage.invariants[1]
            moving = set(range(stage.functions.space.nq, stage.sizes[0]))
            rows = [row for row in rows if not moving & set(ca.jacobian(row, stage.functions.space.x).sparsity().get_col())]
            rows += [stage.invariants[0][:positions, :], struck.invariants[0][struck.invariants[1] :, :]]
        return ca.vertcat(ca.SX(0, 1), *rows)

    def _known_after(self) -> ca.SX:
        """What is zero at the start."""
        asked = self.ends.new.asked
        rows = [asked.stage.invariants[0]]
        for at, limits in asked.here:
            if at == 0.0:
                own = list(range(limits.value.numel()))
                if limits.name == GIVEN:  # what else stands there is as at the guess only where nothing is said of it
                    own = given_rows(
                        limits, self._of(asked.stage, limits.value, end=False), self._of(asked.stage, rows[0], end=False)
                    )
                rows += _held(limits, own)
        return ca.vertcat(ca.SX(0, 1), *rows)


def _held(limits: Limits, entries: Sequence[int]) -> list[ca.SX]:
    """Of these entries those with one value, less this."""
    return [limits.value[r] - float(limits.lower[r]) for r in entries if limits.lower[r] == limits.upper[r]]


_RANK = 1e-9
_ASIDE, _CLEAR, _MET, _STEPS = 1e-2, 1e-6, 1e-11, 30
"""In units of the states: how far beside the guess phases are brought together, what slopes tell, how near they come, and in how many steps."""


def _with_rows(
    program: Program,
    ends: _Ends,
    rows: Sequence[tuple[ca.SX, float, str]],
    impulses: np.ndarray,
    idle: np.ndarray,
    much: np.ndarray,
) -> tuple[Program, list[str]]:
    if not rows and not impulses.size:
        return program, []
    column = ca.densify(ca.vertcat(ca.SX(0, 1), *(value for value, _, _ in rows)))
    inside = {s.element_hash() for s in ca.symvar(column)}
    used = np.array([k for k in range(ends.symbols.numel()) if ends.symbols[k].element_hash() in inside], dtype=int)
    units = ends.units.copy()
    units[units.size - impulses.size :] = much
    n = len(rows)
    term = Term(
        folded_function("link", [ends.symbols[used.tolist()], ca.SX.sym("none", 0)], [column]),
        ends.places[used][:, None], units[used][:, None], np.zeros((0, 1)), program.rows + np.arange(n)[:, None], np.ones((n, 1)),
    )  # fmt: skip
    bounds = np.repeat([[-np.inf], [np.inf]], impulses.size, axis=1)
    bounds[:, idle] = 0.0
    limits = np.array([np.zeros(n), [upper for _, upper, _ in rows]])
    return program.extended(impulses / much, bounds, term, limits), [name for _, _, name in rows]
