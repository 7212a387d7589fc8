"""Stiff scenes: `method="auto"` against Gauss and Radau at four tolerances, and how cost grows with size.

python -m benchmarks.stiff [name ...]      the ten scenes (or some of them): millions of operations, ms of processor time, steps, error
python -m benchmarks.stiff --large         chains and nets of 100 to 1000 states
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

import acausal as ac
from acausal.collocation.problem import Accuracy, Problem, Solution, StatusKind
from acausal.integrators.integrate import integrate
from components import (
    ElasticGear,
    ElectromotiveForce,
    Fixed,
    FlexibleBeam,
    Ground,
    Inductor,
    Inertia,
    Particle,
    Prismatic,
    Resistor,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    Section,
    SlidingMass,
    SpringDamper,
    TorqueSource,
    TranslationalDamper,
    TranslationalGround,
    TranslationalSpring,
    VoltageSource,
    World,
)
from examples.andrews import Andrews
from examples.robot_r3 import Robot

TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
METHODS = ("auto", "gauss", "radau")
Made = tuple[Any, Mapping[Any, Any], float]
SCENES: dict[str, Callable[[], Made]] = {}


def stiff(make: Callable[[], Made]) -> Callable[[], Made]:
    """A scene, its start, and how long it is simulated [s]."""
    SCENES[make.__name__] = make
    return make


def hold(scene: Any, name: str, joint: Any, damping: float, stiffness: float = 0.0) -> None:
    """A damper, and a spring, across a joint, as the part `name` of a scene."""
    linear = isinstance(joint, Prismatic)
    ground, spring, damper = (
        (TranslationalGround, TranslationalSpring, TranslationalDamper)
        if linear
        else (RotationalGround, RotationalSpring, RotationalDamper)
    )
    parts = [damper(damping)] + ([spring(stiffness)] if stiffness else [])
    holder = ac.System()
    holder.ground, holder.elements = ground(), parts
    setattr(scene, name, holder)
    for part in parts:
        scene.connect(holder.ground.flange, part.flange_a)
        scene.connect(part.flange_b, joint.flange)


def chain_of_rods(count: int, damping: float, stiffness: float) -> tuple[Any, list[Revolute]]:
    """Rods one below the other, their hinges held."""
    scene = ac.System()
    scene.world = World()
    scene.hinges = [Revolute("y") for _ in range(count)]
    scene.rods = [RigidBody.rod(1.0, (0, 0, -1.0)) for _ in range(count)]
    frame = scene.world.frame
    for k, (hinge, rod) in enumerate(zip(scene.hinges, scene.rods, strict=True)):
        scene.connect(frame, hinge.frame_a)
        scene.connect(hinge.frame_b, rod.frame)
        frame = rod.tip
        if k:
            hold(scene, f"hold_{k}", hinge, damping, stiffness)
    return scene, scene.hinges


@stiff
def damped_chain() -> Made:
    """Ten rods; all hinges but the first have springs of 1e5 N m/rad and heavy dampers."""
    scene, hinges = chain_of_rods(10, 1e3, 1e5)
    return scene, {hinges[0].q: 1.0}, 5.0


@stiff
def motor() -> Made:
    """A motor with an electrical time constant of 1 us that swings a rod."""
    scene: Any = ac.System()
    scene.world, scene.hinge, scene.rod = World(), Revolute("y"), RigidBody.rod(1.0, (0, 0, -0.5))
    scene.ground, scene.source, scene.resistor = Ground(), VoltageSource(lambda t: 12 * np.sin(3 * t)), Resistor(1.0)
    scene.inductor, scene.emf = Inductor(1e-6), ElectromotiveForce(0.3)
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.source.pin_b, scene.ground.pin)
    scene.connect(scene.source.pin_a, scene.resistor.pin_a)
    scene.connect(scene.resistor.pin_b, scene.inductor.pin_a)
    scene.connect(scene.inductor.pin_b, scene.emf.pin_a)
    scene.connect(scene.emf.pin_b, scene.ground.pin)
    scene.connect(scene.emf.flange, scene.hinge.flange)
    return scene, {scene.hinge.q: 0.5}, 5.0


@stiff
def sledge() -> Made:
    """A pendulum on a sledge that a spring of 1e8 N/m and a damper hold."""
    scene: Any = ac.System()
    scene.world, scene.rail, scene.hinge = World(), Prismatic("x"), Revolute("y")
    scene.sledge, scene.rod = RigidBody.box(2.0, (0.2, 0.2, 0.2)), RigidBody.rod(1.0, (0, 0, -1.0))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.sledge.frame)
    scene.connect(scene.sledge.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    hold(scene, "hold", scene.rail, 1e4, 1e8)
    return scene, {scene.hinge.q: 1.5}, 5.0


@stiff
def andrews() -> Made:
    """Andrews' squeezer with dampers in its cranks."""
    scene = Andrews()
    for name in ("F", "G", "H"):
        hold(scene, f"hold_{name}", getattr(scene, name), 0.02)
    return scene, scene.start(), 0.03


@stiff
def beam() -> Made:
    """A pendulum of steel that bends and stretches, with material damping."""
    scene: Any = ac.System()
    scene.world, scene.hinge = World(), Revolute("y")
    scene.rod = FlexibleBeam(
        1.0,
        Section.rectangle(0.01, 0.01),
        youngs_modulus=2e11,
        density=7870.0,
        bending=(0, 4),
        axial=2,
        modes="cantilever",
        damping=1e-4,
    )
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame_a)
    return scene, {scene.hinge.q: -0.5}, 2.0


@stiff
def geared_drives() -> Made:
    """Two links on hinges, each driven through an elastic gear with damping."""
    scene: Any = ac.System()
    scene.world, scene.shoulder, scene.elbow = World(), Revolute("y"), Revolute("y")
    scene.upper, scene.lower = RigidBody.rod(2.0, (0, 0, -0.5)), RigidBody.rod(1.0, (0, 0, -0.5))
    scene.connect(scene.world.frame, scene.shoulder.frame_a)
    scene.connect(scene.shoulder.frame_b, scene.upper.frame)
    scene.connect(scene.upper.tip, scene.elbow.frame_a)
    scene.connect(scene.elbow.frame_b, scene.lower.frame)
    scene.motors = [TorqueSource(lambda t: 0.2 * np.sin(4 * t)), TorqueSource(lambda t: 0.1 * np.cos(5 * t))]
    scene.rotors, scene.gears = [Inertia(1e-4), Inertia(1e-4)], [ElasticGear(50, 200.0, 0.3), ElasticGear(30, 200.0, 0.3)]
    for motor_, rotor, gear, joint in zip(scene.motors, scene.rotors, scene.gears, (scene.shoulder, scene.elbow), strict=True):
        scene.connect(motor_.flange, rotor.flange_a)
        scene.connect(rotor.flange_b, gear.flange_a)
        scene.connect(gear.flange_b, joint.flange)
    return scene, {scene.shoulder.q: 0.0, scene.elbow.q: 0.0}, 5.0


@stiff
def robot() -> Made:
    """The robot r3 with its drives and controllers, its move and a rest."""
    scene = Robot()
    return scene, scene.start(), 2.0


@stiff
def governor() -> Made:
    """Porter's governor with a stiff spring and a damper below its sleeve."""
    scene: Any = ac.System()
    scene.world, scene.spindle, scene.slide = World(), Revolute("z"), Prismatic("z")
    scene.shaft, scene.sleeve = RigidBody.box(1.0, (0.02, 0.02, 1.0)), RigidBody.box(2.0, (0.05, 0.05, 0.05))
    scene.connect(scene.world.frame, scene.spindle.frame_a)
    scene.connect(scene.spindle.frame_b, scene.shaft.frame)
    scene.connect(scene.shaft.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.sleeve.frame)
    scene.tops, scene.knees, scene.feet = ([Revolute("y"), Revolute("y")] for _ in range(3))
    scene.balls = [Particle(0.5), Particle(0.5)]
    scene.uppers, scene.lowers = ([Fixed((0, 0, -0.3)), Fixed((0, 0, -0.3))] for _ in range(2))
    for top, knee, foot, ball, upper, lower in zip(
        scene.tops, scene.knees, scene.feet, scene.balls, scene.uppers, scene.lowers, strict=True
    ):
        scene.connect(scene.shaft.frame, top.frame_a)
        scene.connect(top.frame_b, upper.frame_a)
        scene.connect(upper.frame_b, ball.point)
        scene.connect(upper.frame_b, knee.frame_a)
        scene.connect(knee.frame_b, lower.frame_a)
        scene.connect(lower.frame_b, foot.frame_a)
        scene.connect(foot.frame_b, scene.sleeve.frame)
    hold(scene, "hold", scene.slide, 2e4)
    start = {scene.tops[0].q: 0.8, scene.tops[1].q: -0.8, scene.knees[0].q: -1.6, scene.knees[1].q: 1.6, scene.spindle.v: 25.0}
    return scene, start, 3.0


def net(rows: int, columns: int, stiffness: float, damping: float) -> tuple[Any, list[Particle]]:
    """Particles in a rectangle, held at two corners, springs with dampers between neighbours."""
    scene: Any = ac.System()
    scene.world = World()
    scene.knots = [Particle(0.01) for _ in range(rows * columns)]
    scene.threads = []

    def tie(one: Any, other: Any) -> None:
        scene.threads.append(SpringDamper(stiffness, 0.08, damping))
        scene.connect(scene.threads[-1].point_a, one)
        scene.connect(scene.threads[-1].point_b, other)

    for i in range(rows):
        for j in range(columns):
            if j:
                tie(scene.knots[i * columns + j - 1].point, scene.knots[i * columns + j].point)
            if i:
                tie(scene.knots[(i - 1) * columns + j].point, scene.knots[i * columns + j].point)
    for i in range(rows):
        tie(scene.world.at((-0.1, 0.1 * i, 0)), scene.knots[i * columns].point)
        tie(scene.world.at((0.1 * columns, 0.1 * i, 0)), scene.knots[(i + 1) * columns - 1].point)
    return scene, scene.knots


def flat(knots: list[Particle], columns: int) -> dict[Any, Any]:
    """A net's start: knots in a plane."""
    return {knot.point.position: (0.1 * (k % columns), 0.1 * (k // columns), 0.0) for k, knot in enumerate(knots)}


@stiff
def stiff_net() -> Made:
    """Three by four particles between stiff threads with damping."""
    scene, knots = net(3, 4, 1e5, 100.0)
    return scene, flat(knots, 4), 2.0


@stiff
def overdamped_joint() -> Made:
    """A double pendulum whose elbow hardly gives way."""
    scene, hinges = chain_of_rods(2, 1e5, 0.0)
    return scene, {hinges[0].q: 1.0, hinges[1].q: 0.5}, 5.0


def row_of_masses(count: int, stiffness: float, damping: float) -> Made:
    """Masses in a row with springs and dampers between, the first one pulled."""
    scene: Any = ac.System()
    scene.wall = TranslationalGround()
    scene.masses = [SlidingMass(0.01) for _ in range(count)]
    scene.springs, scene.dampers = (
        [kind(value) for _ in range(count)] for kind, value in ((TranslationalSpring, stiffness), (TranslationalDamper, damping))
    )
    for spring, damper, (one, other) in zip(
        scene.springs, scene.dampers, pairwise([scene.wall.flange, *(m.flange_a for m in scene.masses)]), strict=True
    ):
        for part in (spring, damper):
            scene.connect(one, part.flange_a)
            scene.connect(part.flange_b, other)
    return scene, {scene.masses[-1].s: 0.1}, 1.0


def large() -> dict[str, Callable[[], Made]]:
    """Scenes of 100 to 1000 states."""

    def net_of(side: int) -> Made:
        scene, knots = net(side, side, 1e4, 10.0)
        return scene, flat(knots, side), 0.5

    def chain_of(count: int) -> Made:
        scene, hinges = chain_of_rods(count, 1e3, 1e5)
        return scene, {hinges[0].q: 0.5}, 1.0

    scenes: dict[str, Callable[[], Made]] = {}
    for n in (50, 100, 200, 500):
        scenes[f"masses, damped, {2 * n} states"] = lambda n=n: row_of_masses(n, 1e5, 1e3)
        scenes[f"masses, {2 * n} states"] = lambda n=n: row_of_masses(n, 1e5, 0.0)
    for side in (4, 6, 8, 10, 13):
        scenes[f"net, damped, {6 * side * side} states"] = lambda side=side: net_of(side)
    for count in (50, 100):
        scenes[f"rods, damped, {2 * count} states"] = lambda count=count: chain_of(count)
    return scenes


@dataclass(frozen=True)
class Measured:
    """Best processor time [s] of a run, and what came out."""

    seconds: float
    solution: Solution


def measured(problem: Problem, x0: np.ndarray, end: float, rtol: float, method: str, budget: float) -> Measured:
    """The best of several runs."""
    best, begun, found, runs = math.inf, time.perf_counter(), None, 0
    while runs < 2 or (time.perf_counter() - begun < budget and runs < 50):
        start = time.process_time()
        found = integrate(problem, x0, 0.0, end, Accuracy(rtol, max_steps=200_000), method=method)
        best = min(best, time.process_time() - start)
        runs += 1
        if time.perf_counter() - begun > 20 * budget:
            break
    assert found is not None
    return Measured(best, found)


def prepared(made: Made) -> tuple[Problem, np.ndarray, float]:
    """A problem with its compiled kernels, its start and end."""
    scene, start, end = made
    model = ac.build(scene)
    run = model.simulate(end, start, rtol=1e-3, samples=2, method="radau")
    from acausal.runtime.kernels import How

    problem = run.problem
    object.__setattr__(problem, "native", model.functions.native(How.COMPILED))
    return problem, run.solution.x[:, 0], end


def compare(name: str, made: Made, tolerances: tuple[float, ...], budget: float, reference: bool) -> list[float]:
    """Prints a line for each tolerance; auto's work over that of the better of the others."""
    problem, x0, end = prepared(made)
    ratios: list[float] = []
    exact, size = None, np.ones(x0.size)
    if reference:
        fine = [integrate(problem, x0, 0.0, end, Accuracy(1e-13), method=m) for m in ("radau", "gauss")]
        exact = fine[0].x[:, -1]
        size = np.maximum(np.max(np.abs(fine[0].x), axis=1), 1e-300)
        apart = np.max(np.abs(exact - fine[1].x[:, -1]) / size)
        print(f"{name}: {x0.size} states, {end:g} s; references agree to {apart:.0e}")
    else:
        print(f"{name}: {x0.size} states, {end:g} s")
    for rtol in tolerances:
        found = {m: measured(problem, x0, end, rtol, m, budget) for m in METHODS}
        cells: list[str] = []
        for m in METHODS:
            s = found[m].solution
            error = np.nan if exact is None else np.max(np.abs(s.x[:, -1] - exact) / size)
            ok = "" if s.status.kind is StatusKind.SUCCESS else "!"
            work = 1e-6 * s.statistics.work
            cells.append(f"{m} {work:8.3f} M {1e3 * found[m].seconds:9.2f} ms {s.statistics.steps:6d} steps {error:8.1e}{ok}")
        work_of = {m: found[m].solution.statistics.work for m in METHODS}
        ratio = work_of["auto"] / min(work_of["gauss"], work_of["radau"])
        ratios.append(ratio)
        print(f"  {rtol:5.0e}  {ratio:5.2f}  " + " | ".join(cells) + "  " + found["auto"].solution.statistics.method, flush=True)
    return ratios


def main(words: list[str]) -> None:
    """See the module."""
    if "--large" in words:
        wanted = [w for w in words if not w.startswith("--")]
        for name, make in large().items():
            if not wanted or any(w in name for w in wanted):
                compare(name, make(), (1e-3, 1e-6), 0.0, False)
        return
    ratios = {name: compare(name, make(), TOLERANCES, 0.3, True) for name, make in SCENES.items() if not words or name in words}
    worst = {name: max(found) for name, found in ratios.items()}
    print("worst ratios:", ", ".join(f"{name} {value:.2f}" for name, value in worst.items()))


if __name__ == "__main__":
    main(sys.argv[1:])
