"""What a model decided by numbers, as a table: at which values, and how far each decision is from being another one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from acausal.charts.independent import independent_entries
from acausal.errors import AcausalError
from acausal.explain.row_meaning import row_meanings
from acausal.language.expression import Expression
from acausal.loops.examined import Examined
from acausal.numerics.one_thread import on_one_thread
from acausal.numerics.thresholds import SINGULAR
from acausal.outputs.functions import Functions
from acausal.reduce.reduce import ReducedSystem
from acausal.scalar.decisions import linear_decisions
from acausal.start.branch_search import other_branches
from acausal.start.initial import initial_state
from acausal.wording import compact, counted, shortened

_MOST_NAMES = 6
_MOST_LINES = 30
_MOST_ROWS = 60
"""Rows of loops up to which branches are counted."""


@dataclass(frozen=True)
class Decision:
    """One decision.

    `about`: what it is about, in names. `decided`: what was found. `margin`: a number without unit by which it holds, and `limit`: where it would
    be another one; both None where nothing that may change decides it.
    """

    about: str
    decided: str
    margin: float | None = None
    limit: float | None = None

    @property
    def sure(self) -> float:
        """How many times the margin is away from the limit, above or below; infinite where nothing decides."""
        if self.margin is None or self.limit is None:
            return np.inf
        small, large = sorted((abs(self.margin), self.limit))
        return large / small if small > 0 else np.inf

    def __str__(self) -> str:
        if self.margin is None or self.limit is None:
            return f"{self.about}: {self.decided}"
        sign = ">" if self.margin >= self.limit else "<"
        return f"{self.about}: {self.decided} (by {self.margin:.2g} {sign} {self.limit:.0e})"


@dataclass(frozen=True, repr=False)
class DecisionTable:
    """`entries`, of a scene of this `name`, `values` of parameters by name at which they were taken, and the `time` [s].

    Each call looks at its own start, parameters and time again: by these margins, and anew where one of them has shrunk by much.
    """

    name: str
    entries: tuple[Decision, ...]
    values: dict[str, float]
    time: float

    def __iter__(self) -> Iterator[Decision]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    def __repr__(self) -> str:
        return f"<DecisionTable {self.name}: {counted(len(self), 'decision')}>"

    def __str__(self) -> str:
        given = [f"{name} = {value:g}" for name, value in self.values.items()]
        at = compact([*given, f"t = {self.time:g} s"], _MOST_NAMES)
        head = f"{self.name}: {counted(len(self), 'decision')} by numbers"
        if not self.entries:
            return f"{head}; the structure alone determines everything"
        return "\n".join([f"{head}, at {at}", *shortened([f"  {entry}" for entry in self.entries], _MOST_LINES)])


@on_one_thread
def decision_table(functions: Functions) -> DecisionTable:
    """Of a model. Costs a count of branches for each mechanism with loops."""
    s = functions.outputs.system
    entries: list[Decision] = []
    for part in s.constraints.examined:
        entries += _loops(functions, part)
    entries += [*_branches(functions), *_coordinates(functions), *_blocks(s), *_followers(s)]
    times = [part.walk.time for part in s.constraints.examined if part.walk is not None]
    values = dict(zip(functions.parameter_names, map(float, s.p_values), strict=False))
    return DecisionTable(s.flat.name, tuple(entries), values, times[0] if times else 0.0)


def _loops(functions: Functions, part: Examined) -> Iterator[Decision]:
    s = functions.outputs.system
    joints = compact((f"'{rows.edge.name}'" for rows in part.group.loops), _MOST_NAMES)
    loop = f"loop closed by {joints}" if len(part.group.loops) == 1 else f"loops closed by {joints}"
    margin = part.usual
    names = part.group.names
    yield Decision(
        loop, f"{margin.rank} of {counted(len(names), 'constraint')} independent, {counted(part.group.v.numel() - margin.rank, 'freedom')} left",
        margin.independent, SINGULAR,
    )  # fmt: skip
    kept = {names[k] for k in part.rank.kept}
    dropped = [name for name in names if name not in kept]
    if dropped:
        means = {name: text for rows in part.group.loops for name, text in row_meanings(s, rows).items()}
        words = compact((f"{name} ({means[name]})" for name in dropped), _MOST_NAMES)
        use = "used as well, since apart from closed positions they do not" if part.damped else "dropped"
        yield Decision(
            loop, f"{words} follow{'s' if len(dropped) == 1 else ''} from the others: {use}", margin.follows, margin.zero
        )
    if not part.trail:
        return
    if part.singular:
        smallest, q = min(part.trail, key=lambda found: found[0])
        where = compact(
            (f"{functions.tree_state_names[k]} = {_shown(v)}" for k, v in zip(part.group.q_places, q, strict=True)), _MOST_NAMES
        )
        yield Decision(loop, f"passes singular positions, one of them at {where}", abs(smallest), SINGULAR)
    else:
        seen = counted(len(part.trail), "position")
        yield Decision(loop, f"no singular position was met on a walk of {seen}", part.least, SINGULAR)


def _branches(functions: Functions) -> Iterator[Decision]:
    """How many ways there are to assemble the loops with their freedoms as at the start of the walk."""
    s = functions.outputs.system
    parts = s.constraints.examined
    crossing = any(part.rank.singular_at_start for part in parts)
    if not parts or crossing or sum(len(part.group.names) for part in parts) > _MOST_ROWS:
        return
    q, start = s.constraints.q_start, dict[Expression, np.ndarray]()
    for part in parts:
        for k in independent_entries(part.A[list(part.rank.kept)]).free:
            joint = next(j for j in s.tree_joints if j.v.start <= part.group.v_places[k] < j.v.stop)
            start[joint.edge.joint.q] = q[joint.q]
    held = ", ".join(f"{functions.outputs.name(key)} = {compact(map(_shown, value))}" for key, value in start.items())  # pyright: ignore[reportArgumentType]
    time = parts[0].walk.time if parts[0].walk is not None else 0.0
    try:
        others = other_branches(initial_state(functions.outputs, start, time, s.p_values, s.u_defaults))
    except AcausalError:
        return
    ways = f"of {others + 1} branches" if others else "the only branch found"
    yield Decision("assembly", f"{ways}{', that nearest to the sketch,' if others else ''} with {held or 'no freedom'}")


def _coordinates(functions: Functions) -> Iterator[Decision]:
    """Coordinates in closed form from others."""
    found, names = functions.space.elimination, functions.tree_state_names
    for place, pivot in zip(found.places, found.pivots, strict=True):
        yield Decision(names[place], "follows in closed form from other coordinates, divided by a coefficient", pivot, found.zero)


def _blocks(s: ReducedSystem) -> Iterator[Decision]:
    """Linear equations with parameters among their coefficients."""
    decisions = linear_decisions(s.scalar.blocks, s.p)
    for block, margin in zip(decisions.blocks, decisions.margins(s.p_values), strict=True):
        unknowns, of = (compact(items, 2) for items in ((u.name for u in block.unknowns), (e.label for e in block.sources)))
        yield Decision(unknowns, f"found from {of}", margin, decisions.zero)


def _followers(s: ReducedSystem) -> Iterator[Decision]:
    for held in s.scalar.redundant:
        yield Decision(held.name, "follows from other equations between positions: the smallest efforts are given")
    for held in s.scalar.looped:
        yield Decision(held.name, "holds joints that loops hold already, wherever these were looked at: it transmits nothing")


def _shown(value: float) -> str:
    return f"{round(float(value), 9) + 0.0:.4g}"
