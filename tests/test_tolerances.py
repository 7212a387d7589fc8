"""What states are measured by: no unit, nothing of other scenes in the same system, and nothing that is only rounding."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from benchmarks.chains import chain
from components import (
    Apart,
    Cone,
    ConvexShape,
    Force,
    Particle,
    Prismatic,
    Revolute,
    RigidBody,
    Rod,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    Spring,
    Touching,
    World,
)
from tests.pairings import each_value

BOTH = pytest.mark.parametrize("compiled", [True, False])


def add_pendulum(scene: ac.System, name: str, length: float, mass: float, time: float) -> tuple[Revolute, Revolute]:
    """A double pendulum of this length and mass, with a spring that gives it this time."""
    parts = {
        "a": Revolute("y"), "b": Revolute("y"), "upper": RigidBody.rod(mass, (0, 0, -length)), "lower": RigidBody.rod(mass, (0, 0, -length)),
        "spring": RotationalSpring(mass * length**2 / time**2), "ground": RotationalGround(),
    }  # fmt: skip
    for key, part in parts.items():
        setattr(scene, name + key, part)
    a, b, upper, lower = (getattr(scene, name + key) for key in ("a", "b", "upper", "lower"))
    scene.connect(scene.world.frame, a.frame_a)
    scene.connect(a.frame_b, upper.frame)
    scene.connect(upper.tip, b.frame_a)
    scene.connect(b.frame_b, lower.frame)
    scene.connect(parts["ground"].flange, parts["spring"].flange_a)
    scene.connect(a.flange, parts["spring"].flange_b)
    return a, b


@BOTH
@each_value(("power", [-15, 0, 15]), ("of", ["length", "mass", "time"]))
def test_similar_scenes_take_the_same_steps_to_the_same_bits(compiled, power, of):
    sizes = {"length": 1.0, "mass": 1.0, "time": 1.0}

    def run(**sizes: float):
        scene = ac.System()
        scene.world = World(None)
        a, b = add_pendulum(scene, "", **sizes)
        end = 8.0 * sizes["time"]
        found = ac.build(scene).simulate(end, {a.q: 0.9, b.v: 2.0 / sizes["time"]}, compiled=compiled, samples=5)
        return found, np.array([found[a.q], found[b.q], found[b.v] * sizes["time"]])

    (one, x), (two, y) = run(**sizes), run(**(sizes | {of: 4.0**power}))
    assert one.statistics.steps == two.statistics.steps
    assert np.array_equal(x, y)


@BOTH
def test_copies_of_different_size_in_one_system_move_as_each_alone(compiled):
    small, large = (1e-3, 1e-9, 0.1), (1e3, 1e9, 0.1)

    def run(*sizes: tuple[float, float, float]):
        scene = ac.System()
        scene.world = World(None)
        joints = [add_pendulum(scene, f"p{k}_", *size) for k, size in enumerate(sizes)]
        start = {joint: value for a, b in joints for joint, value in ((a.q, 0.9), (b.q, -0.4))}
        found = ac.build(scene).simulate(1.0, start, compiled=compiled, samples=11, rtol=1e-9)
        return [np.array([found[a.q], found[b.q]]) for a, b in joints]

    together, alone = run(small, large), [*run(small), *run(large)]
    assert all(np.max(np.abs(a - b)) < 1e-7 for a, b in zip(together, alone, strict=True))


@BOTH
@each_value(("amplitude", [1e-9, 1e-3, 1e6]), ("hanging", [False, True]))
def test_an_oscillation_of_any_size_is_as_accurate(compiled, amplitude, hanging):
    """x = a cos t, also about the position in which a weight hangs on its spring."""
    scene = ac.System()
    g = 1.0 if hanging else 0.0
    scene.world, scene.rail, scene.mass, scene.spring = World((0, 0, -g)), Prismatic("z"), Particle(1.0), Spring(1.0, 0.0)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.mass.point)
    scene.connect(scene.world.at((0, 0, 2.0 if hanging else 0.0)), scene.spring.point_a)
    scene.connect(scene.mass.point, scene.spring.point_b)
    rest = 1.0 if hanging else 0.0
    if hanging and amplitude > 1:
        return  # the spring has no direction where its ends meet
    run = ac.build(scene).simulate(10.0, {scene.rail.q: rest + amplitude}, compiled=compiled, rtol=1e-8)
    error = np.max(np.abs(run[scene.rail.q] - rest - ((rest + amplitude) - rest) * np.cos(run.t)))
    assert error < 1e-6 * amplitude + (1e-14 if hanging else 0.0)
    assert run.statistics.steps < 60


@BOTH
def test_what_rests_takes_few_steps(compiled):
    """At rest in every sense: exactly at zero, in equilibrium but for rounding, and next to what moves."""
    scene = ac.System()
    scene.world, scene.still = World(), Revolute((0.36, 0.48, 0.8))
    scene.weight = RigidBody.rod(1.0, (0.0, 0.0, -1.0))
    scene.moving, scene.swinging = Revolute("y"), RigidBody.rod(1.0, (0.0, 0.0, -1.0))
    scene.connect(scene.world.frame, scene.still.frame_a)
    scene.connect(scene.still.frame_b, scene.weight.frame)
    scene.connect(scene.world.frame, scene.moving.frame_a)
    scene.connect(scene.moving.frame_b, scene.swinging.frame)
    model = ac.build(scene)
    at_rest = model.simulate(10.0, compiled=compiled)
    assert at_rest.statistics.steps < 200 and np.max(np.abs(at_rest.x)) < 1e-12
    moved = model.simulate(10.0, {scene.moving.q: 1.0}, compiled=compiled)
    assert moved.statistics.steps < 200 and np.max(np.abs(moved[scene.still.q])) < 1e-12
    assert moved.energy_error() < 1e-7


@BOTH
@pytest.mark.parametrize("aside", [6e-17, 1e-14, 1e-12])
def test_what_is_only_rounding_of_a_start_takes_few_steps(compiled, aside):
    """A body that spins on a rod: rates of places are sums, by its own axes, whose rounding is no kink."""
    scene = ac.System()
    scene.world, scene.body, scene.rod = World((0, 0, -9.81)), RigidBody.box(1.0, (0.1, 0.2, 0.3)), Rod(1.0)
    scene.connect(scene.world.frame, scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, scene.body.frame)
    frame = scene.body.frame
    start = {frame.position: (aside, 1.0, -20 * aside), frame.angular_velocity: (0.3, 0.4, 0.5)}
    run = ac.build(scene).simulate(0.5, start, compiled=compiled, max_steps=200)
    assert run.statistics.steps < 100
    assert run.energy_error() < 1e-9


@BOTH
def test_many_turns_do_not_loosen_what_turns(compiled):
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World(), Revolute("y"), RigidBody.rod(1.0, (0, 0, -1.0))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    model = ac.build(scene)
    turned = 2 * np.pi * 1.5e5
    runs = [
        model.simulate(1.0, {scene.hinge.q: q, scene.hinge.v: 20.0}, compiled=compiled, rtol=1e-10) for q in (0.3, 0.3 + turned)
    ]
    assert np.max(np.abs(runs[1][scene.hinge.v] - runs[0][scene.hinge.v])) < 1e-3
    assert runs[1].energy_error() < 1e-3


@BOTH
def test_fast_decay_is_left_to_radau(compiled):
    """A stiff damped elbow: the default takes about the steps of Radau."""
    scene = ac.System()
    scene.world, scene.a, scene.b = World(), Revolute("y"), Revolute("y")
    scene.upper, scene.lower = RigidBody.rod(1.0, (0, 0, -1.0)), RigidBody.rod(1.0, (0, 0, -1.0))
    scene.damper, scene.spring, scene.ground = RotationalDamper(100.0), RotationalSpring(1e6), RotationalGround()
    scene.connect(scene.world.frame, scene.a.frame_a)
    scene.connect(scene.a.frame_b, scene.upper.frame)
    scene.connect(scene.upper.tip, scene.b.frame_a)
    scene.connect(scene.b.frame_b, scene.lower.frame)
    for part in (scene.damper, scene.spring):
        scene.connect(scene.ground.flange, part.flange_a)
        scene.connect(scene.b.flange, part.flange_b)
    model = ac.build(scene)
    auto, radau = (model.simulate(5.0, {scene.a.q: 1.0}, rtol=1e-6, method=m, compiled=compiled) for m in ("auto", "radau"))
    assert "radau" in auto.statistics.method
    assert auto.statistics.steps < 1.5 * radau.statistics.steps


@BOTH
@each_value(("jump", [0.0, 1.0, 3.0]), ("size", [1e-6, 1.0, 1e6]))
def test_a_force_that_begins_at_once_moves_what_rests(compiled, jump, size):
    """Nothing has a size until the jump: v = F (t - jump)."""
    scene = ac.System()
    scene.world, scene.rail, scene.mass = World(None), Prismatic("x"), Particle(1.0)
    scene.push = Force((size * (ac.time > jump), 0, 0))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.mass.point)
    scene.connect(scene.push.point, scene.mass.point)
    run = ac.build(scene).simulate(10.0, compiled=compiled, rtol=1e-9)
    assert abs(run[scene.rail.v][-1] - size * (10.0 - jump)) < 1e-7 * size
    assert run.statistics.steps < 100


@pytest.mark.slow
def test_rounding_of_a_long_chain_is_looked_at_without_an_evaluation_for_each_state():
    """All states move one another: factors of a full matrix would take the memory and the time of the square and the cube of their number."""
    scene = chain(120)
    model = ac.build(scene)
    start = {joint.q: 0.1 * (k % 3) for k, joint in enumerate(scene.joints)}
    at_rounding = model.simulate(0.3, start, rtol=1e-15, atol=3e-22, samples=2)
    assert np.max(np.abs(at_rounding.x - model.simulate(0.3, start, rtol=1e-12, samples=2).x)) < 1e-13
    assert at_rounding.statistics.rejected < 30
    assert at_rounding.statistics.evaluations < 55 * at_rounding.statistics.steps


@pytest.mark.parametrize("rates", [(4e-17, -3e-18, 7e-17), (0.0, 1.5e-16, 1e-14), (1e-17, 2e-17, 5e-18)])
def test_rates_of_rounding_take_no_steps(rates):
    """A body falls with an angular velocity that its own rounding errors are as large as, beside another one that is followed over it: it takes no steps of its own."""
    egg = ConvexShape(lambda n: 0.02 * n[2] + 0.1 * ca.sqrt(n[0] ** 2 + n[1] ** 2 + 1.5 * n[2] ** 2) + 0.02 * ca.norm_2(n))
    scene = ac.System()
    scene.world, scene.other = World((1, 2, -9.81)), RigidBody(3.0, (1.2, 1.5, 1.0), (0.02, 0.0, 0.01))
    scene.body = RigidBody(2.0, (0.012, 0.015, 0.02), (0.01, -0.01, 0.012))
    scene.contact = Touching(egg, Cone(0.6, outside=True), Apart())
    scene.connect(scene.contact.frame_b, scene.body.frame)
    scene.connect(scene.other.frame, scene.contact.frame_a)
    turning = {scene.body.frame.angular_velocity: (0.2, 0.4, -0.8), scene.other.frame.angular_velocity: rates}
    model = ac.build(scene)
    for end in (0.01, 0.03, 0.1, 1.0):
        assert model.simulate(end, {**turning, scene.contact.gap: 1e-3}, rtol=1e-10).statistics.steps < 60
