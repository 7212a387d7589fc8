"""Many loops that hang together: what a call takes besides the driver, and how building and assembling grow with the size.

python -m benchmarks.loops
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import acausal as ac
from benchmarks.growth import four_bars
from benchmarks.timing import compiled
from tests.large_scenes import CrankRow, RodNet

_REPEAT = 7

Made = tuple[ac.System, Callable[[float], Mapping[Any, Any]], float]
"""A scene, its start for a number, and how long it runs [s]."""


def _cranks(count: int) -> Made:
    scene = CrankRow(count)
    return scene, lambda by: {scene.feet[0].q: 0.5 + 0.01 * by}, 10.0


def _net(count: int) -> Made:
    scene = RodNet(count)
    return scene, lambda by: {scene.knots[-1].point.velocity: ac.near((0, 0.3 + 0.01 * by, 0))}, 0.2


def _apart(count: int) -> Made:
    scene: Any = four_bars(count)
    return scene, lambda by: {hinge.v: 1.0 + 0.01 * (by + k) for k, hinge in enumerate(scene.hinges[::4])}, 10.0


FAMILIES: tuple[tuple[str, Callable[[int], Made], tuple[int, ...]], ...] = (
    ("four-bars in a row", _cranks, (5, 10, 20, 40, 80)),
    ("net of rods", _net, (4, 6, 8, 10)),
    ("four-bars apart", _apart, (10, 40)),
)


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What it gives, and the seconds of the processor that this thread took."""
    begin = time.thread_time()
    return call(), time.thread_time() - begin


def both(call: Callable[[], Any]) -> tuple[float, float]:
    """Seconds of a call, and of its driver, by the clock."""
    begin = time.perf_counter()
    run = call()
    return time.perf_counter() - begin, run.statistics.seconds


def row(make: Callable[[int], Made], count: int) -> str:
    """Cells of the table."""
    scene, start, end = make(count)
    model, build = timed(lambda: ac.build(scene))
    _, first = timed(lambda: model.initial_state(start(0)))
    _, other = timed(lambda: model.initial_state(start(1)))
    _, again = timed(lambda: model.initial_state(start(1)))
    _, call = timed(lambda: model.simulate(end, start(1), progress=False))
    compiled(model)
    best, driver = min(both(lambda: model.simulate(end, start(1), progress=False)) for _ in range(_REPEAT))
    rows = model.system.closing.numel()
    starts = "".join(f"{1e3 * t:>9.1f}" for t in (first, other, again))
    return f"{count:>6}{rows:>6}{build:>9.2f}{starts}{call:>9.2f}{1e3 * best:>9.1f}{1e3 * driver:>9.1f}{best / driver:>7.2f}"


def run() -> None:
    """Print the table."""
    print("\nLoops that hang together: seconds to build, ms for a first start, one with other values, the same again;")
    print("seconds of a first run, ms of the same run again and of its driver")
    print(
        f"{'':20}{'count':>6}{'rows':>6}{'build':>9}{'first':>9}{'other':>9}{'again':>9}{'run 1':>9}{'call':>9}{'driver':>9}{'ratio':>7}"
    )
    ac.build(CrankRow(1)).simulate(0.1, progress=False)  # imports, the runtime
    for name, make, counts in FAMILIES:
        for count in counts:
            print(f"{name:20}{row(make, count)}", flush=True)


if __name__ == "__main__":
    run()
