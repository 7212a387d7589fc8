"""Transitions: instants of a motion at which parts open, close, begin to slide, stick or strike, read from the run."""

from __future__ import annotations

import functools
import html
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, overload

import casadi as ca
import numpy as np

from acausal.collocation.modes import ModesMet
from acausal.collocation.problem import Problem, Solution
from acausal.dynamics.mode_rows import ModeRow
from acausal.errors import OptionError
from acausal.language.component import Component, System
from acausal.language.expression import Expression, Reaction
from acausal.outputs.functions import Functions
from acausal.outputs.outputs import Outputs
from acausal.wording import compact, shortened

_SHOWN = 40
_COLUMNS = 1000
"""Places in a picture at which blows can be told apart."""
_NOTHING = 1e-13
"""Of the largest impulse in an instant: what is no blow but rounding."""
_BRIDGE = -2
"""The row of a change that ends impacts without end."""
_OFF, _STICKS, _SLIDES_UP, _SLIDES_DOWN, _SLIDES = range(5)
_FRICTION = ("off", "sticks", "slides +", "slides -", "slides")
_ONE_SIDED = ("open", "closed")
_TURNED = ("closed", "open")
_LOCK = ("free", "held")
_IMPULSES = {"N": "N*s", "N*m": "N*m*s"}


class Run(Protocol):
    """What is needed of a `Trajectory`."""

    @property
    def functions(self) -> Functions: ...
    @property
    def outputs(self) -> Outputs: ...
    @property
    def problem(self) -> Problem: ...
    @property
    def solution(self) -> Solution: ...
    @property
    def energy(self) -> np.ndarray: ...
    def given(self, t: np.ndarray, x: np.ndarray, u: np.ndarray) -> Run: ...
    def __getitem__(self, wanted: Expression | ca.SX | str) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class Law:
    """One law of a part in a run: which of the `reactions` and of the masks belong to it; `name`: of its part, or of its reaction where the part has several."""

    row: ModeRow
    name: str
    reactions: slice
    masks: slice
    needs: tuple[int, ...] = ()
    """Masks of one-sided laws, one of which must be closed for there to be any friction; none where it has a limit of its own."""

    @property
    def words(self) -> tuple[str, ...]:
        """What it may be doing, by number."""
        return _FRICTION if not self.row.one_sided else _TURNED if self.row.turned else _ONE_SIDED

    def holds(self, word: str) -> bool:
        """Whether its row holds where the part is so: closed, or open where the law is turned round, or where friction sticks."""
        return word == ("sticks" if not self.row.one_sided else "open" if self.row.turned else "closed")

    def numbers(self, masks: np.ndarray) -> np.ndarray:
        """Which of the words (n,) are true, by all masks (masks, n)."""
        own = masks[self.masks]
        if self.row.one_sided:
            return (own[0] == 1).astype(int)
        plane = self.row.size > 1
        slides = np.any(own[1:3] != 0, axis=0) if plane else own[1]
        sign = (
            np.where(slides != 0, _SLIDES, _OFF)
            if plane
            else np.choose((slides + 1).astype(int), (_SLIDES_DOWN, _OFF, _SLIDES_UP))
        )
        found = np.where(own[0] == 1, _STICKS, sign)
        return np.where(masks[list(self.needs)].any(axis=0), found, _OFF) if self.needs else found


def laws_of(outputs: Outputs) -> tuple[Law, ...]:
    """All of a scene, in the order of its reactions and masks; none where every part always holds."""
    modes = outputs.system.modes
    if modes is None:
        return ()
    paths = [row.part.path for row in modes.rows]
    found: list[Law] = []
    reaction = mask = 0
    for row, needed in zip(modes.rows, modes.needed, strict=True):
        size = row.size
        width = row.masks
        name = row.part.path if paths.count(row.part.path) == 1 else outputs.name(row.reaction).removesuffix("[0]")
        found.append(
            Law(
                row,
                name,
                slice(reaction, reaction + size),
                slice(mask, mask + width),
                needed,
            )
        )
        reaction, mask = reaction + size, mask + width
    return tuple(found)


@dataclass(frozen=True)
class Moment:
    """Values just before or after an instant: `moment[expression]`, a number, or an array for what is a vector or a matrix. `x` (nx,): all states."""

    run: Run
    x: np.ndarray

    def __getitem__(self, wanted: Expression | ca.SX | str) -> float | np.ndarray:
        value = self.run[wanted][0]
        return value if isinstance(value, np.ndarray) else float(value)


@dataclass(frozen=True, eq=False)
class Change:
    """What one part did: from `old` to `new` ("open", "closed", "sticks", "slides +" along its slip, "slides -", "off"; "free", "held"), struck by `impulse` (one number, or
    two) [`unit`], in which `energy_lost` became heat [J]; of several struck at once their sum did, and each has
    its share by the mean of its speeds before and after. Or what was set: a variable in place of the part, from number to number."""

    part: str
    old: str
    new: str
    impulse: float | np.ndarray
    unit: str
    energy_lost: float

    def __str__(self) -> str:
        struck = "" if not np.any(self.impulse) else f"{np.linalg.norm(self.impulse):.4g} {self.unit}"
        lost = f"{self.energy_lost:.4g} J" if struck else ""
        return f"{self.part:<24} {self.old + ' -> ' + self.new:<22} {struck:<18} {lost}".rstrip()


@dataclass(frozen=True, eq=False)
class Transition:
    """All that changes in one instant `time` [s]: `changes` of parts, and values just `before` and `after`: `transition.before[expression]`."""

    time: float
    changes: tuple[Change, ...]
    before: Moment
    after: Moment

    @property
    def parts(self) -> tuple[str, ...]:
        """Whose mode changes, or which are struck."""
        return tuple(change.part for change in self.changes)

    @property
    def energy_lost(self) -> float:
        """In impacts of all parts [J]."""
        return sum(change.energy_lost for change in self.changes)

    def __str__(self) -> str:
        return "\n".join(f"{f'{self.time:.9g}' if k == 0 else '':<14} {change}" for k, change in enumerate(self.changes))

    def __repr__(self) -> str:
        return f"<Transition {self}>"


@dataclass(frozen=True, eq=False)
class Transitions(Sequence[Transition]):
    """Of a run, in order of time: a table that prints itself, of `Transition`s that are made when they are asked for.

    `times` (n,) [s]; `rows` (n,): ends of steps before each; `jumped` (n,): whether the state jumps, over a step of no length; `bridged` (n,): whether it
    ends impacts without end, over a step whose friction has impulses. `old`, `new` (laws, n): numbers of words;
    `impulses` (n, reactions), `heat` (n, reactions) of those that are passed at once, and what each of them `lost` (n, reactions) as heat, and
    `lost_in_balance` (n,): less what drives brought in [J]. Where nothing changes but to which law a force is due there is no transition; the start's decision is none, unless something strikes there.
    """

    run: Run
    laws: tuple[Law, ...]
    times: np.ndarray
    rows: np.ndarray
    jumped: np.ndarray
    bridged: np.ndarray
    masks: tuple[np.ndarray, np.ndarray]
    old: np.ndarray
    new: np.ndarray
    impulses: np.ndarray
    heat: np.ndarray
    targets: tuple[tuple[int, ...], ...]
    """What was set in each, by numbers of states, and nx or more of discrete values; none where nothing was."""
    words: dict[int, str]
    """What each of them is called."""

    @functools.cached_property
    def _losses(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, reactions), (n,): half the rate before and after, times the impulse (Thomson and Tait): of what the laws hold, and of what the energy balance sees."""
        lost, n = np.zeros(self.impulses.shape), self.impulses.shape[1]
        in_balance = np.zeros(self.times.size)
        some = np.flatnonzero(self.jumped | self.bridged)
        if not some.size or (function := self.run.functions.impacts) is None:
            return lost, in_balance
        t, x = self.run.solution.beside(self.times[some], 1), self.run.solution.x
        states = np.hstack([x[:, self.rows[some] - self.bridged[some]], x[:, self.rows[some] + self.jumped[some]]])
        u = np.hstack([self._inputs(k, some, strikes=True) for k in range(2)])
        series = self.run.functions.series(function)
        before, after = np.split(series.glance(np.concatenate([t, t]), states, u, self.run.problem.parameters), 2, axis=1)
        modes = self.run.outputs.system.modes
        assert modes is not None
        pushes = np.arange(n) < modes.one_sided
        # of small bounces the work on what moves is of first order, and what they lose of second
        over = np.outer(pushes, self.bridged[some])
        rates, seen = (
            np.where(over, late, (early + late) / 2).T for early, late in ((before[:n], after[:n]), (before[n:], after[n:]))
        )
        lost[some] = self.heat[some] - self.impulses[some] * rates
        in_balance[some] = (self.heat[some] + self.impulses[some] * seen).sum(axis=1)
        return lost, in_balance

    @functools.cached_property
    def _taken(self) -> dict[int, float]:
        """By number of the transition, where something is set: what the scene has less after it [J]."""
        held = self.run.outputs.system.locks is not None
        some = np.flatnonzero(np.array([bool(own) for own in self.targets], dtype=bool) | (self.jumped & held))
        if not some.size:
            return {}
        before, after = (self.run.given(self.times[some], *self.beside(some, k)).energy for k in range(2))
        return dict(zip(some.tolist(), (before - after).tolist(), strict=True))

    @property
    def energy_lost(self) -> np.ndarray:
        """As heat in each (n,) [J]."""
        return self._losses[0].sum(axis=1)

    @property
    def lost_in_balance(self) -> np.ndarray:
        """The same less what moving surfaces, belts and drives brought in, and what is set (n,) [J]."""
        found = self._losses[1].copy()
        for k, taken in self._taken.items():
            found[k] = taken
        return found

    def lost_at_ends(self, count: int) -> np.ndarray:
        """The sum of these so far (n,) [J], at so many ends of steps: not yet at the end before an impact."""
        lost = np.zeros(count)
        struck = self.jumped | self.bridged
        np.add.at(lost, (self.rows + self.jumped)[struck], self.lost_in_balance[struck])
        return np.cumsum(lost)

    def _inputs(self, after: int, some: np.ndarray, strikes: bool = False) -> np.ndarray:
        """(nu, n): before or after these transitions; `strikes`: by what has jumped by then, in any case."""
        u = self.run.problem.inputs(self.run.solution.beside(self.times[some], 1 if after or strikes else -1))
        masks = self.masks[after][:, some]
        u[u.shape[0] - masks.shape[0] :] = masks
        return u

    def beside(self, some: np.ndarray, after: int) -> tuple[np.ndarray, np.ndarray]:
        """States (nx, n) and inputs (nu, n) before or after these transitions."""
        x = self.run.solution.x[:, self.rows[some] + after * self.jumped[some]]
        return x, self._inputs(after, some)

    def _moment(self, k: int, after: int) -> Moment:
        x, u = self.beside(np.array([k]), after)
        return Moment(self.run.given(self.times[[k]], x, u), x[:, 0])

    def _one(self, k: int) -> Transition:
        changes: list[Change] = []
        sizes = {law.row.reaction.unit: 0.0 for law in self.laws}
        for law in self.laws:
            sizes[law.row.reaction.unit] = max(sizes[law.row.reaction.unit], float(np.abs(self.impulses[k, law.reactions]).max()))
        for i, law in enumerate(self.laws):
            old, new, impulse = self.old[i, k], self.new[i, k], self.impulses[k, law.reactions]
            if self.bridged[k]:
                struck = np.abs(self.heat[k, law.reactions]).max() > _NOTHING * np.abs(self.heat[k]).max()
            else:
                struck = np.abs(impulse).max() > _NOTHING * sizes[law.row.reaction.unit]
            if old == new and not struck:
                continue
            unit = _IMPULSES.get(law.row.reaction.unit, f"{law.row.reaction.unit}*s")
            lost = float(self._losses[0][k, law.reactions].sum())
            given = float(impulse[0]) if impulse.size == 1 else impulse.copy()
            changes.append(Change(law.name, law.words[old], law.words[new], given, unit, lost))
        before, after = self._moment(k, 0), self._moment(k, 1)
        locks, holding = self._locks(k)
        changes += locks
        for target in self.targets[k]:
            if target in holding:
                continue
            old, new = (f"{self._value(target, k, side):.6g}" for side in range(2))
            changes.append(Change(self.words[target], old, new, 0.0, "", 0.0))
        return Transition(float(self.times[k]), tuple(changes), before, after)

    def _locks(self, k: int) -> tuple[list[Change], set[int]]:
        """What is fastened or let go, and targets that say no more than that."""
        system = self.run.outputs.system
        if system.locks is None:
            return [], set()
        some, changes, holding = np.array([k]), list[Change](), set[int]()
        x, _ = self.beside(some, 0)
        sides = [self.run.given(self.times[some], x, self._inputs(after, some)) for after in range(2)]
        impulses, rates = (np.ravel(sides[1][column]) for column in (system.locks.impulses, system.locks.held_speeds))
        first = 0
        for row in system.locks.rows:
            own = slice(first, first + len(row.reactions))
            first = own.stop
            old, new = (int(np.ravel(side[row.held])[0]) for side in sides)
            if old == new:
                continue
            holding |= {x.shape[0] + i for i, d in enumerate(system.flat.discretes) if ca.depends_on(row.held, d.sx)}
            units = [reaction.unit for reaction in row.reactions]
            for unit in dict.fromkeys(units):
                same = [own.start + i for i, entry in enumerate(units) if entry == unit]
                impulse = new * impulses[same]
                lost = -float(impulse @ rates[same]) / 2
                if not np.any(impulse) and unit != units[0]:
                    continue
                changes.append(Change(row.part.path, _LOCK[old], _LOCK[new], impulse, _IMPULSES.get(unit, f"{unit}*s"), lost))
        return changes, holding

    def _value(self, target: int, k: int, after: int) -> float:
        """Of a target just before or after."""
        x, u = self.beside(np.array([k]), after)
        first = u.shape[0] - len(self.run.outputs.system.flat.discretes)
        return float(x[target, 0] if target < x.shape[0] else u[first + target - x.shape[0], 0])

    @overload
    def __getitem__(self, index: int) -> Transition: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Transition, ...]: ...
    def __getitem__(self, index: int | slice) -> Transition | tuple[Transition, ...]:
        found = range(len(self))[index]
        return tuple(self._one(k) for k in found) if isinstance(found, range) else self._one(found)

    def __len__(self) -> int:
        return self.times.size

    def __iter__(self) -> Iterator[Transition]:
        return (self._one(k) for k in range(len(self)))

    def __str__(self) -> str:
        if not len(self):
            return "No transitions."
        head = f"{'time [s]':<14} {'part':<24} {'from -> to':<22} {'impulse':<18} energy lost"
        first, last = self[: _SHOWN // 2], self[max(_SHOWN // 2, len(self) - _SHOWN // 2) :]
        between = len(self) - len(first) - len(last)
        return "\n".join([head, *map(str, first), *([f"... {between} more ..."] if between else []), *map(str, last)])

    def __repr__(self) -> str:
        return f"<{len(self)} transitions>\n{self}"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


def transitions_of(run: Run) -> Transitions:
    """Of a run; none where its parts always hold."""
    laws, met = laws_of(run.outputs), run.solution.modes
    if met is None:
        none, words, struck = np.zeros(0), np.zeros((0, 0), dtype=int), np.zeros((0, 0))
        at, never = none.astype(int), none.astype(bool)
        return Transitions(run, laws, none, at, never, never, (words, words), words, words, struck, struck, (), {})
    last = np.append(np.diff(met.steps) > 0, True)  # of those at the same end of a step
    first = np.insert(last[:-1], 0, True)
    begin, end = np.flatnonzero(first), np.flatnonzero(last)
    impulses, heat = (np.add.reduceat(part, begin, axis=0) for part in (met.impulses, met.heat))
    jumped, bridged = (np.logical_or.reduceat(flags, begin) for flags in (met.jumped, met.rows == _BRIDGE))
    # others are put where all that holds is closed
    struck = jumped & (impulses.any(axis=1) | (run.outputs.system.locks is not None))
    after = met.masks[:, end]
    before = np.hstack([after[:, :1] if not struck[0] else np.zeros((after.shape[0], 1)), after[:, :-1]])
    old, new = (
        np.array([law.numbers(masks) for law in laws]).reshape(len(laws), begin.size).astype(int) for masks in (before, after)
    )
    targets, words = _targets(run, met, begin, end)
    some = np.flatnonzero(struck | bridged | (old != new).any(axis=0) | np.array([bool(own) for own in targets]))
    return Transitions(
        run, laws, met.begins[end][some], met.steps[end][some], jumped[some], bridged[some], (before[:, some], after[:, some]), old[:, some], new[:, some], impulses[some], heat[some],
        tuple(targets[k] for k in some), words,
    )  # fmt: skip


def _targets(run: Run, met: ModesMet, begin: np.ndarray, end: np.ndarray) -> tuple[list[tuple[int, ...]], dict[int, str]]:
    """What is set in each instant, and what all that is called."""
    modes = run.functions.modes
    found = None if modes is None else modes.set
    if modes is None or found is None:
        return [()] * begin.size, {}
    first = modes.guards.size1_out(0)
    of = [found.targets[a:b] for a, b in zip(found.first, found.first[1:], strict=False)]
    targets: list[tuple[int, ...]] = []
    for a, b in zip(begin, end, strict=True):
        fired = [of[row - first] for row in met.rows[a : b + 1].tolist() if row >= first]
        targets.append(tuple(dict.fromkeys(target for own in fired for target in own)))
    return targets, dict(zip(found.targets, found.target_words, strict=True))


@dataclass(frozen=True, eq=False)
class ModesOfPart:
    """What a part, or one law of it, was doing: `words` (n,) from each of the `times` (n,) [s] on, until `end`. It prints itself, and gives pairs (time, word)."""

    name: str
    times: np.ndarray
    words: tuple[str, ...]
    end: float

    def at(self, time: float) -> str:
        """At a time [s]; where it changes, after that. Raises `OptionError` outside of the run."""
        if not self.times[0] <= time <= self.end:
            raise OptionError(
                f"run.modes({self.name}).at({time:g}): the motion is known from {self.times[0]:g} s to {self.end:g} s."
            )
        return self.words[int(np.searchsorted(self.times, time, side="right")) - 1]

    def __iter__(self) -> Iterator[tuple[float, str]]:
        return zip(self.times.tolist(), self.words, strict=True)

    def __len__(self) -> int:
        return self.times.size

    def __str__(self) -> str:
        lines = [f"from {time:.9g} s {word}" for time, word in self]
        return "\n".join([f"{self.name}, until {self.end:g} s:", *shortened(lines, _SHOWN)])

    def __repr__(self) -> str:
        return f"<{self}>"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


def modes_of_part(run: Run, of: Component | Reaction | str) -> ModesOfPart:
    """Of a part, all of its laws together, or of one reaction. Raises `OptionError` for what has no laws."""
    laws = laws_of(run.outputs)
    some = [law for law in laws if _belongs(run, law, of)]
    met = run.solution.modes
    if not some or met is None:
        known = compact(dict.fromkeys(law.name for law in laws)) if laws else "no part of this scene does"
        raise OptionError(f"run.modes({of!r}): that has no laws by which it opens, sticks or slides; these have: {known}.")
    last = np.append(np.diff(met.begins) > 0, True)  # of those in one instant the last one counts
    times, numbers = met.begins[last], np.array([law.numbers(met.masks[:, last]) for law in some])
    kept = np.insert(np.any(numbers[:, 1:] != numbers[:, :-1], axis=0), 0, True).nonzero()[0]
    words = tuple(", ".join(law.words[n] for law, n in zip(some, numbers[:, k], strict=True)) for k in kept)
    name = of if isinstance(of, str) else some[0].row.part.path if isinstance(of, Component) else run.outputs.name(of)
    return ModesOfPart(name, times[kept], words, float(run.solution.t[-1]))


def strips_of(run: Run, begin: float, end: float) -> list[tuple[str, np.ndarray, tuple[str, ...], np.ndarray]]:
    """What each law of a run was doing between two times [s], to be drawn: its name, words from each of some times on, and when it was struck."""
    met, laws = run.solution.modes, laws_of(run.outputs)
    if met is None:
        return []
    found: list[tuple[str, np.ndarray, tuple[str, ...], np.ndarray]] = []
    for law in laws:
        numbers = law.numbers(met.masks)
        changes = np.insert(np.diff(numbers) != 0, 0, [True])
        words = tuple(law.words[n] for n in numbers[changes])
        struck = met.begins[np.any(met.impulses[:, law.reactions] != 0, axis=1)]
        struck = struck[(struck >= begin) & (struck <= end)]
        _, apart = np.unique(np.round(_COLUMNS * (struck - begin) / (end - begin or 1.0)), return_index=True)
        found.append((law.name, np.clip(met.begins[changes], begin, end), words, struck[apart]))
    return found


def _belongs(run: Run, law: Law, of: Component | Reaction | str) -> bool:
    part = law.row.part
    if isinstance(of, str):
        return of in (part.path, law.name, run.outputs.name(law.row.reaction)) or part.path.startswith(f"{of}.")
    if isinstance(of, Reaction):
        return of is law.row.reaction
    return part.component is of or (isinstance(of, System) and any(part.component is inner for inner in _inside(of)))


def _inside(system: System) -> Iterator[Component]:
    for _, part in system.parts():
        yield part
        if isinstance(part, System):
            yield from _inside(part)
