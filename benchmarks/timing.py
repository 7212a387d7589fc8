"""How long a call takes."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable


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
