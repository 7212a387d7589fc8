"""Phases and links together as one nonlinear program."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.optimal_control.asked import Asked
from acausal.optimal_control.guess import Guess
from acausal.optimal_control.link import Link, linked
from acausal.optimal_control.mesh import Mesh
from acausal.optimal_control.separable import Program
from acausal.optimal_control.transcription import Transcribed, transcribe

_SAME = 1e-9
"""Of the program in units of its own, as the solver knows it: by how much rows may differ that say the same."""


@dataclass(frozen=True, eq=False)
class Part:
    """A phase as it is `asked` of a `model`, on a mesh, with a guess. `units` (width,): what is much for each unknown of a point; `given`: arguments of
    `simulate`; `bent`: the guess with its positions off by so much (times, nq), in so much time [s] (None: as the guess), this quaternion the long way round; None where a
    motion was given.
    """

    model: Any
    asked: Asked
    mesh: Mesh
    guess: Guess
    units: np.ndarray
    given: Mapping[str, Any]
    bent: Callable[..., Guess] | None


@dataclass(frozen=True, eq=False)
class Whole:
    """The `program` of all phases `parts` and the `links` between them, whose unknowns begin at `begins` and constraints at `rows`; those of links come last. `labels`: of each row what it is, in which
    phase and when: a part of its duration.
    """

    parts: tuple[Transcribed, ...]
    links: Sequence[Link]
    program: Program
    begins: tuple[int, ...]
    rows: tuple[int, ...]
    labels: list[tuple[str, int, float]]

    def factors(self, multipliers: np.ndarray, k: int) -> np.ndarray:
        """Of the constraints of a phase."""
        own = multipliers * self.program.sizes * self.program.unit
        return own[self.rows[k] : self.rows[k + 1]]

    def unknowns(self, w: np.ndarray, k: int) -> np.ndarray:
        """Of a phase."""
        return w[self.begins[k] : self.begins[k] + self.parts[k].program.size]

    def unwound(self, w: np.ndarray) -> np.ndarray:
        """The same, with angles among inputs that do not jump by full turns from point to point where no row, bound or cost tells these from none: between the points
        a polynomial goes through them.
        """
        least, most = self.program.bounds
        for begin, part in zip(self.begins, self.parts, strict=True):
            for places in part.angles:
                angles, told = w[begin + places] * part.units[places], w.copy()
                straight = np.unwrap(angles) - 2 * np.pi * np.round(angles[0] / (2 * np.pi))
                told[begin + places] = straight / part.units[places]
                if np.max(np.abs(straight - angles)) < np.pi or np.any((told < least) | (told > most)):
                    continue
                before, after = (np.array(ca.vertcat(*self.program.values(one))) for one in (w, told))
                w = told if np.max(np.abs(after - before)) <= _SAME else w
        return w

    def gap(self, gaps: np.ndarray, k: int) -> float:
        """Of a phase, of those of the unknowns and then of the constraints."""
        rows = gaps[self.program.size :]
        return float(np.sum(self.unknowns(gaps, k)) + np.sum(rows[self.rows[k] : self.rows[k + 1]]))

    def own_cost(self, w: np.ndarray, k: int) -> float:
        """What a phase adds to the cost."""
        return float(self.parts[k].program.values(self.unknowns(w, k))[0])


def whole(parts: Sequence[Part], links: Sequence[Link]) -> Whole:
    """The program of phases and links, rows and cost in balance."""
    made = tuple(transcribe(part.asked, part.mesh, part.guess, part.units) for part in parts)
    begins = tuple(np.cumsum([0, *(one.program.size for one in made)]).tolist())
    rows = np.cumsum([0, *(one.program.rows for one in made)]).tolist()
    program = Program.joined([one.program for one in made])
    labels = [(name, k, at) for k, one in enumerate(made) for name, at in one.labels]
    for link in links:
        program, added = linked(program, link, made, begins)
        labels += [(name, link.after, 0.0) for name in added]
    program, added = _one_value(program, made, begins)
    labels += added
    assert len(labels) == program.rows >= rows[-1]
    return Whole(made, links, program.balanced(), begins[:-1], tuple(rows), labels)


def _one_value(
    program: Program, made: Sequence[Transcribed], begins: Sequence[int]
) -> tuple[Program, list[tuple[str, int, float]]]:
    """Parameters that several phases find have one value; and labels of the rows that say so."""
    known: dict[Any, tuple[int, float]] = {}
    entries: list[tuple[int, int, float]] = []
    labels: list[tuple[str, int, float]] = []
    for k, (one, begin) in enumerate(zip(made, begins, strict=False)):
        for parameter, place in zip(one.asked.stage.free, one.layout.extra[1:].tolist(), strict=True):
            own = begin + place, float(one.units[place])
            if parameter in known:
                row = len(labels)
                entries += [(row, own[0], 1.0), (row, known[parameter][0], -known[parameter][1] / own[1])]
                labels.append((f"one {parameter.name}", k, 0.0))
            known[parameter] = own
    if not labels:
        return program, labels
    row, column, value = (np.array(part) for part in zip(*entries, strict=True))
    return program.tied(row, column, value), labels
