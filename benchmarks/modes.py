"""Scenes whose modes change: error against processor time beside other programs, and what events, candidates and rows cost.

python -m benchmarks.modes [scene ...]
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any
from unittest import mock

import numpy as np

import acausal as ac
from acausal.runtime.native import Outcome, Run
from benchmarks.mode_peers import Try, drake_tries, mujoco_tries, scipy_tries
from benchmarks.mode_scenes import ModeScene, billiards, carts, hovering, scenes
from benchmarks.timing import compiled

_SLOW = 20.0
"""Seconds, after which no finer setting of a program is tried."""
_MANY = 40
"""Runs of a scene within a second, of which the least counts: programs for modes that last are there only after some."""


def least_time(call: Callable[[], Any], repeats: int = 7) -> tuple[float, Any]:
    """Of so many runs, one where it is slow: seconds of the processor, and what it gave."""
    best, result = np.inf, None
    for k in range(repeats):
        began = time.process_time()
        result = call()
        best = min(best, time.process_time() - began)
        if best > 0.5 and k == 0:
            break
    return float(best), result


def own_tries(scene: ModeScene) -> Iterator[tuple[Try, ac.Model]]:
    """This package: the whole call."""
    system, start, seen = scene.make()
    model = ac.build(system)
    compiled(model)
    for rtol in (1e-6, 1e-9, 1e-12):

        def run(rtol: float = rtol) -> np.ndarray:
            found = model.simulate(scene.end, start, rtol=rtol, samples=2, progress=False)
            return np.asarray(found[seen][-1]).ravel()

        yield Try("acausal", f"{rtol:.0e}", run), model


def against_peers(names: list[str]) -> None:
    """A line for each setting of each program."""
    for scene in scenes():
        if names and scene.name not in names:
            continue
        print(f"\n{scene.title}; error: {scene.kind}")
        tries: list[Iterator[Try]] = [(t for t, _ in own_tries(scene)), scipy_tries(scene.name, scene.end)]
        for module, others in (("mujoco", mujoco_tries), ("pydrake", drake_tries)):
            if importlib.util.find_spec(module) is not None:
                tries.append(others(scene.name, scene.end))
        for some in tries:
            slow: set[str] = set()
            for one in some:
                if one.peer in slow:
                    continue
                try:
                    seconds, values = least_time(one.run)
                except Exception as error:  # others raise anything
                    print(f"  {one.peer:<16}{one.setting:>9}  gives up: {str(error).splitlines()[0][:60]}", flush=True)
                    continue
                off = np.inf if values is None else float(np.max(np.abs(values - scene.reference)))
                print(f"  {one.peer:<16}{one.setting:>9}{1e3 * seconds:12.2f} ms{off:12.1e}", flush=True)
                if seconds > 0.1 * _SLOW:
                    slow.add(one.peer)


def driver_of(model: ac.Model, end: float, start: dict[Any, Any], rtol: float = 1e-10) -> tuple[float, ac.Trajectory]:
    """Seconds of the processor of the steps alone, in C, with compiled kernels: least of some runs; and a run."""
    compiled(model, lambda: model.simulate(end, start, rtol=rtol, samples=2, progress=False))
    spent: list[float] = []
    advance = Run.advance

    def timed(self: Run, *given: Any) -> Outcome:
        began = time.thread_time()
        try:
            return advance(self, *given)
        finally:
            spent.append(time.thread_time() - began)

    run = model.simulate(end, start, rtol=rtol, samples=2, progress=False)
    with mock.patch.object(Run, "advance", timed):
        while len(spent) < 3 or (len(spent) < _MANY and sum(spent) < 1.0):
            run = model.simulate(end, start, rtol=rtol, samples=2, progress=False)
    return min(spent), run


def events() -> None:
    """Microseconds an event: steps alone, and whole calls."""
    print("\nsteps alone, in C        events   steps       ms   us/event   us/step")
    for scene in scenes():
        system, start, _ = scene.make()
        seconds, run = driver_of(ac.build(system), scene.end, start)
        modes = run.solution.modes
        assert modes is not None
        count, steps = modes.begins.size, run.statistics.steps
        print(
            f"  {scene.name:<20}{count:>10}{steps:>8}{1e3 * seconds:>10.3f}{1e6 * seconds / count:>10.1f}{1e6 * seconds / steps:>10.1f}"
        )


def untouched(counts: tuple[int, ...] = (0, 1, 2, 5, 10, 20)) -> None:
    """A scene with so many contacts that are declared, and never touched."""
    print("\ncontacts never touched     steps       ms   more ns a contact and step   more %")
    base = None
    for count in counts:
        system, start = hovering(count)
        seconds, run = driver_of(ac.build(system), 100.0, start)
        base = seconds if base is None else base
        more = 1e9 * (seconds - base) / (max(count, 1) * run.statistics.steps)
        print(
            f"  {count:>20}{run.statistics.steps:>10}{1e3 * seconds:>10.3f}{more:>20.0f}{100 * (seconds / base - 1):>18.0f}",
            flush=True,
        )


def held(counts: tuple[int, ...] = (1, 3, 10, 30)) -> None:
    """Carts in a row on a rough floor, joined by springs: what friction that holds, or slides, costs beside joints that hold."""
    print("\ncarts with friction   build s   first s     ms   us/step   the same, held: ms   us/step   ratio a step")
    for count in counts:
        times: list[float] = []
        for rough in (True, False):
            system, start = carts(count, rough)
            began = time.perf_counter()
            model = ac.build(system)
            built = time.perf_counter()
            model.simulate(2.0, start, rtol=1e-10, samples=2, progress=False)
            first = time.perf_counter()
            seconds, run = driver_of(model, 2.0, start)
            times += [built - began, first - built, 1e3 * seconds, 1e6 * seconds / run.statistics.steps]
        b, f, ms, us, _, _, other, per = times
        print(f"  {count:>18}{b:>10.2f}{f:>10.2f}{ms:>9.2f}{us:>9.1f}{other:>17.2f}{per:>12.1f}{us / per:>12.1f}", flush=True)


def collisions(counts: tuple[int, ...] = (2, 4, 6, 10)) -> None:
    """Balls on a round table: all pairs are candidates."""
    print("\nballs  candidates   build s   first s  collisions (own code)       ms   us/event   energy  overlap  apart at 3 s")
    for count in counts:
        scene = billiards(count)
        began = time.perf_counter()
        model = ac.build(scene.system)
        built = time.perf_counter()
        early = model.simulate(3.0, scene.start, rtol=1e-12, samples=2, progress=False)
        first = time.perf_counter()
        differs = float(np.max(np.abs(scene.places(early)[-1] - scene.by_events(3.0)[0])))
        seconds, run = driver_of(model, 100.0, scene.start)
        modes = run.solution.modes
        assert modes is not None
        events = modes.begins.size - 1
        looked = model.simulate(100.0, scene.start, rtol=1e-10, samples=5000, progress=False)
        print(
            f"{count:>5}{count * (count + 1) // 2:>12}{built - began:>10.2f}{first - built:>10.2f}{events:>12}{scene.by_events(100.0)[1]:>10}{1e3 * seconds:>11.2f}"
            f"{1e6 * seconds / max(1, events):>11.1f}{scene.energy_change(looked):>9.0e}{scene.overlap(looked):>9.0e}{differs:>17.0e}", flush=True,
        )  # fmt: skip


def main(names: list[str]) -> None:
    """All of it, or some scenes beside peers."""
    against_peers(names)
    if not names:
        events()
        untouched()
        held()
        collisions()


if __name__ == "__main__":
    main(sys.argv[1:])
