"""How long a call takes."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

import acausal as ac
from acausal.runtime.kernels import How

_RUNS, _SECONDS = 100, 2.0
"""Runs, and seconds, after which modes that last have been met."""


def compiled(model: ac.Model, run: Callable[[], object] | None = None) -> None:
    """Wait for the compiled kernels of a model, and of the modes that last in a run."""
    native = model.functions.native(How.AUTO)
    assert native is not None
    native.kernels.spent(math.inf)
    while native.busy:
        time.sleep(0.05)
    native.kernels.spent(0.0)
    if run is not None:
        worth, native.lasting.worth, begun = native.lasting.worth, 0.01, time.perf_counter()
        for _ in range(_RUNS):
            run()
            if time.perf_counter() - begun > _SECONDS:
                break
        while native.busy:
            time.sleep(0.05)
        native.lasting.worth = worth
        run()


def median_time(call: Callable[[], object], budget: float = 0.2) -> float:
    """Median seconds of one call, over batches."""
    call()
    once = time.perf_counter()
    call()
    batch = max(1, int(0.01 / max(time.perf_counter() - once, 1e-7)))
    times: list[float] = []
    end = time.perf_counter() + budget
    while time.perf_counter() < end or len(times) < 3:
        start = time.perf_counter()
        for _ in range(batch):
            call()
        times.append((time.perf_counter() - start) / batch)
    return statistics.median(times)
