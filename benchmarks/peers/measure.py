"""Error against time: points of a sweep, and the time at equal error."""

from __future__ import annotations

import gc
import itertools
import math
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.peers.base import AbstractPeer, Prepared
from benchmarks.scenes import Built

ERRORS = (1e-3, 1e-6, 1e-9, 1e-12)


@dataclass(frozen=True)
class Budget:
    """How long to measure: each run at least `repeats` times and up to 25 times in `short` [s], but once if it takes longer than
    `slow` [s], which also ends a sweep; no further setting after `sweep` [s] of runs (building and compiling are not counted)."""

    repeats: int = 5
    short: float = 0.1
    slow: float = 0.5
    sweep: float = 2.5


@dataclass(frozen=True)
class Point:
    """One setting: median processor time of a run [ms], error at the end (infinite if the integrator gave up), and how many runs."""

    scene: str
    peer: str
    method: str
    setting: float
    milliseconds: float
    error: float
    repeats: int


def sweep(peer: AbstractPeer, built: Built, method: str, budget: Budget) -> list[Point]:
    """Points of one method, loosest first, until the error is at rounding, a run is slow, or the time is used up."""
    points: list[Point] = []
    spent = 0.0
    for setting in peer.settings(built.scene.name, method):
        prepared = peer.prepare(built, method, setting)
        milliseconds, error, repeats = measured(built, prepared, budget)
        points.append(Point(built.scene.name, peer.name, method, setting, milliseconds, error, repeats))
        if error < 1e-14:
            break
        if math.isfinite(error):  # a loose tolerance may fail, and take long, where a tighter one does not
            spent += 1e-3 * milliseconds * (repeats + 1)
            if milliseconds > 1e3 * budget.slow or spent > budget.sweep:
                break
    return points


def measured(built: Built, prepared: Prepared, budget: Budget) -> tuple[float, float, int]:
    """Milliseconds (median), error and repeats; after one run to warm up, unless that was slow or failed."""
    first, result = _timed(prepared)
    repeats = max(budget.repeats, min(25, int(budget.short / max(first, 1e-6))))
    again = result is not None and first < budget.slow
    gc.collect()
    gc.disable()  # as timeit does: what other programs have left in this process is looked through otherwise
    try:
        seconds = [_timed(prepared)[0] for _ in range(repeats)] if again else [first]
    finally:
        gc.enable()
    error = math.inf if result is None else built.scene.error(prepared.values(result))
    return 1e3 * statistics.median(seconds), error if np.isfinite(error) else math.inf, len(seconds)


def _timed(prepared: Prepared) -> tuple[float, object]:
    """Seconds of the processor, all threads together: on an idle core the same as by the clock, and less disturbed on a shared one."""
    began = time.process_time()
    result = prepared.run()
    return time.process_time() - began, result


def time_at_error(points: Sequence[Point], error: float) -> float | None:
    """Milliseconds for an error, between neighbouring settings by a straight line in logarithms; None if it was not reached.

    The cheapest way counts: a crossing of the line, or any point that is more accurate than asked.
    """
    found = [p.milliseconds for p in points if p.error <= error]
    for a, b in itertools.pairwise(points):
        if a.error > error >= b.error > 0 and math.isfinite(a.error):
            share = math.log(a.error / error) / math.log(a.error / b.error)
            found.append(a.milliseconds ** (1 - share) * b.milliseconds**share)
    return min(found, default=None)
