"""What a call of `simulate` costs beside the driver in C, and what reading a run costs.

python -m benchmarks.calls
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import acausal as ac
from acausal.collocation.problem import Accuracy
from acausal.simulate.simulation import look_at
from benchmarks.growth import four_bars
from benchmarks.scenes import SCENES
from benchmarks.timing import compiled
from components import Particle, Revolute, RigidBody, Rod, World
from tests.assembly_scenes import stewart_platform

RTOLS = (1e-6, 1e-9, 1e-12)


@dataclass(frozen=True)
class Case:
    """A scene, its start, the end of its run [s], and expressions that are read."""

    name: str
    make: Callable[[], ac.System]
    start: Callable[[Any], dict[Any, Any]]
    end: float
    read: Callable[[Any], list[Any]]


def ladder(count: int) -> ac.System:
    """Rockers in a row, hanging from the world, couplers between their tips: `count` four-bar loops, one freedom."""
    scene = ac.System()
    scene.world = World()
    scene.rockers = [RigidBody.rod(1.0, (0, 0, -0.4 - 0.02 * (k % 3))) for k in range(count + 1)]
    scene.couplers = [RigidBody.rod(0.5, (0.5, 0, 0)) for _ in range(count)]
    scene.hinges = [Revolute("y") for _ in range(count + 1)]
    scene.starts, scene.ends = [Revolute("y") for _ in range(count)], [Revolute("y") for _ in range(count)]
    for k, (hinge, rocker) in enumerate(zip(scene.hinges, scene.rockers, strict=True)):
        scene.connect(scene.world.at((0.5 * k, 0, 0)), hinge.frame_a)
        scene.connect(hinge.frame_b, rocker.frame)
    for k, coupler in enumerate(scene.couplers):
        scene.connect(scene.rockers[k].tip, scene.starts[k].frame_a)
        scene.connect(scene.starts[k].frame_b, coupler.frame)
        scene.connect(coupler.tip, scene.ends[k].frame_a)
        scene.connect(scene.ends[k].frame_b, scene.rockers[k + 1].tip)
    return scene


def net(count: int) -> ac.System:
    """Particles in `count` rows and columns, held in the first row, with rods between neighbours; it is not flat."""
    scene = ac.System()
    scene.world = World()
    places = [[(0.1 * j, 0.04 * math.sin(2.0 * i + 1.1 * j), -0.1 * i) for j in range(count)] for i in range(count)]
    scene.knots = [Particle(0.1, position=place) for row in places[1:] for place in row]
    points = [scene.world.at(place) for place in places[0]] + [knot.point for knot in scene.knots]
    ends = [(k, k + count) for k in range(count * (count - 1))]
    ends += [(k, k + 1) for k in range(count, count * count) if (k + 1) % count]
    flat = [place for row in places for place in row]
    scene.rods = [Rod(math.dist(flat[a], flat[b])) for a, b in ends]
    for rod, (a, b) in zip(scene.rods, ends, strict=True):
        scene.connect(points[a], rod.frame_a)
        scene.connect(points[b], rod.frame_b)
    return scene


def _bars() -> Case:
    def start(s: Any) -> dict[Any, Any]:
        return {s.hinges[4 * k].q: -0.5 for k in range(40)} | {s.hinges[4 * k].v: 1.0 + 0.02 * k for k in range(40)}

    return Case("forty four-bars", lambda: four_bars(40), start, 2.0, lambda s: [s.bars[0].tip.position])


def _known(name: str, read: Callable[[Any], list[Any]]) -> Case:
    scene = next(scene for scene in SCENES if scene.name == name)
    return Case(name, scene.system, lambda s: dict(scene.start(s)), scene.end, read)


CASES = (
    _known("double_pendulum", lambda s: [s.lower.tip.position, s.elbow.q, s.shoulder.frame_b.force]),
    _known("four_bar", lambda s: [s.coupler.tip.position, s.d.q, s.b.frame_b.force]),
    _known("top", lambda s: [s.top.frame.rotation, s.top.frame.angular_velocity, s.socket.frame_b.force]),
    _known("disk", lambda s: [s.coin.frame.position, s.contact.v, s.contact.frame_b.force]),
    Case("stewart", stewart_platform, lambda s: {s.slide[k].v: 0.2 * (-1) ** (k // 2) for k in range(6)}, 1.0, lambda s: [s.platform.frame.position, s.slide[3].q, s.ball[2].frame_b.force]),
    Case("ladder of 20", lambda: ladder(20), lambda s: {s.hinges[0].q: 0.4}, 2.0, lambda s: [s.couplers[-1].tip.position, s.hinges[14].q, s.starts[9].frame_b.force]),
    Case("ladder of 40", lambda: ladder(40), lambda s: {s.hinges[0].q: 0.4}, 2.0, lambda s: [s.couplers[-1].tip.position, s.hinges[14].q, s.starts[9].frame_b.force]),
    Case("net of 10 x 10", lambda: net(10), lambda s: {}, 1.0, lambda s: [s.knots[-1].point.position, s.knots[34].point.velocity, s.rods[40].frame_b.force]),
    _bars(),
)  # fmt: skip


def least(call: Callable[[], object], budget: float = 0.3) -> float:
    """Least milliseconds of a call: other load on the machine only adds to it."""
    times: list[float] = []
    end = time.perf_counter() + budget
    while len(times) < 3 or time.perf_counter() < end:
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return 1e3 * min(times)


def row(case: Case, scene: Any, model: ac.Model, rtol: float) -> str:
    """One line of the table."""
    start, seconds = case.start(scene), list[float]()

    def simulate() -> ac.Trajectory:
        run = model.simulate(case.end, start=start, rtol=rtol)
        seconds.append(run.statistics.seconds)
        return run

    run = simulate()
    call = least(simulate)
    driver, looks = 1e3 * min(seconds), least(lambda: look_at(model.functions, run, Accuracy(rtol)), 0.1)
    samples, wanted = least(lambda: run.at(run.t).x, 0.1), case.read(scene)
    reading = [least(lambda e=e: run[e], 0.05) for e in wanted]
    ten = least(lambda: [read[wanted[k % len(wanted)]] for read in (run.at(run.t),) for k in range(10)], 0.1)
    shown = "".join(f"{value:>9.3f}" for value in (driver, call, looks, samples, max(reading), ten))
    return f"{case.name:18}{rtol:>7.0e}{run.statistics.steps:>7}{shown}{call / driver:>8.2f}{ten / call:>8.2f}"


def run(names: tuple[str, ...] = (), rtols: tuple[float, ...] = RTOLS) -> None:
    """Print the table."""
    print("\nMilliseconds. ten: ten expressions at 501 other times; reading: the slowest expression, once samples are known")
    titles = ("driver", "call", "looks", "samples", "reading", "ten")
    print(f"{'':18}{'rtol':>7}{'steps':>7}" + "".join(f"{t:>9}" for t in titles) + f"{'call/d.':>8}{'ten/c.':>8}")
    for case in CASES:
        if names and case.name not in names:
            continue
        scene = case.make()
        model = ac.build(scene)
        compiled(model)
        for rtol in rtols:
            print(row(case, scene, model, rtol), flush=True)


if __name__ == "__main__":
    run(tuple(sys.argv[1:]))
