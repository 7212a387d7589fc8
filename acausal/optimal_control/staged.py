"""The same program in stages, one for each interval, for solvers that eliminate one after the other.

Vanroye, Sathya, De Schutter, Decre: Fatrop, a fast constrained optimal control problem solver for robot trajectory optimization and control (2023).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.optimal_control.separable import Program, Stages


@dataclass(frozen=True, eq=False)
class Staged:
    """A `program` of stages: of each the unknowns where an interval begins, those that count all the time, then all of its points; rows that carry the first two on, then its own. `sources`: of each of its
    unknowns the one that it is in the program it is made of, and which of them are `copies`; `places`, `rows`: where unknowns and rows of that one stand; `sizes`: of stages, as CasADi takes them.
    """

    program: Program
    sources: np.ndarray
    copies: np.ndarray
    places: np.ndarray
    rows: np.ndarray
    sizes: dict[str, Any]

    def arguments(self, given: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Of a solver of this, by those of one of the program it is made of."""
        found = {"x0": given["x0"][self.sources]}
        for name, open_end in (("lb", -np.inf), ("ub", np.inf)):
            found[f"{name}x"] = np.where(self.copies, open_end, given[f"{name}x"][self.sources])
            found[f"{name}g"] = np.zeros(self.program.rows)
            found[f"{name}g"][self.rows] = given[f"{name}g"]
        return found

    def results(self, found: dict[str, ca.DM]) -> dict[str, Any]:
        """Of a solver of the program it is made of."""
        own = {name: np.array(value).ravel() for name, value in found.items()}
        return {
            "x": own["x"][self.places], "lam_x": own["lam_x"][self.places], "f": own["f"][0],
            "g": own["g"][self.rows], "lam_g": own["lam_g"][self.rows],
        }  # fmt: skip


def staged(program: Program, stages: Stages) -> Staged | None:
    """None where something reaches farther than from one interval to the next one: a sum over all, an end that depends on the start."""
    ends, tail = stages
    K, nx = ends.shape
    more = program.size - tail
    first, inside = nx + more, (tail - nx) // K
    width = first + inside
    interval, state = np.zeros(program.size, dtype=int), np.full(program.size, -1)
    interval[nx:tail], state[ends] = np.repeat(np.arange(K), inside), np.arange(nx)
    places = np.concatenate(
        [np.arange(nx), (np.arange(K)[:, None] * width + first + np.arange(inside)).ravel(), nx + np.arange(more)]
    )
    always = np.arange(program.size) >= tail
    i, j, values = program.linear
    stage = np.zeros(program.rows + 2, dtype=int)  # those of NOWHERE and COST are last
    np.maximum.at(stage, i, interval[j])
    for term in program.terms:
        np.maximum.at(stage, term.rows.ravel(), np.tile(interval[term.places].max(axis=0, initial=0), len(term.rows)))
    used: list[tuple[np.ndarray, np.ndarray]] = [(j, stage[i])]
    for term in program.terms:
        of_rows = np.where(term.rows >= 0, stage[term.rows], interval[term.places].max(axis=0, initial=0))
        if np.any(of_rows != of_rows.max(axis=0)):
            return None
        used.append((term.places, np.broadcast_to(of_rows.max(axis=0), term.places.shape)))
    moved = list[np.ndarray]()
    for own, at in used:
        before = (interval[own] < at) & ~always[own]
        if np.any(before & ((interval[own] < at - 1) | (own < nx) | (state[own] < 0))):
            return None
        carried = np.where(always[own], nx + own - tail, state[own])
        moved.append(np.where(before | always[own], at * width + carried, places[own]))
    order = np.argsort(np.append(stage[:-2], np.repeat(np.arange(K) - 0.5, first)), kind="stable")
    number = np.argsort(order)
    k, m = np.indices((K, first)).reshape(2, -1)
    begun = np.where(m < nx, places[ends[k, np.minimum(m, nx - 1)]], k * width + m)
    linear = (
        np.concatenate([number[i], number[program.rows :], number[program.rows :]]),
        np.concatenate([moved[0], (k + 1) * width + m, begun]),
        np.concatenate([values, np.ones(k.size), -np.ones(k.size)]),
    )
    sources = np.empty(K * width + first, dtype=int)
    copies = np.ones(sources.size, dtype=bool)
    sources[(k + 1) * width + m] = np.where(m < nx, ends[k, np.minimum(m, nx - 1)], tail + m - nx)
    sources[places], copies[places] = np.arange(program.size), False
    cost = np.zeros(sources.size)
    cost[places] = program.cost
    bounds = np.where(copies, [[-np.inf], [np.inf]], program.bounds[:, sources])
    limits = np.zeros((2, number.size))
    limits[:, number[: program.rows]] = program.limits
    terms = [
        replace(term, places=own, rows=np.where(term.rows >= 0, number[term.rows], term.rows))
        for term, own in zip(program.terms, moved[1:], strict=True)
    ]
    changed = Program(terms, linear, cost, limits, bounds, program.guess[sources], program.unit)
    sizes = {"N": K, "nx": [first] * (K + 1), "nu": [inside] * K + [0], "ng": [*np.bincount(stage[:-2], minlength=K).tolist(), 0]}
    return Staged(changed, sources, copies, places, number[: program.rows], {"structure_detection": "manual", **sizes})
