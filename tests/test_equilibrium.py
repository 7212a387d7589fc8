"""Equilibria and steady motions against statics, energy, and published closed forms."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy.optimize

import acausal as ac
from acausal.analysis.nearest import NearestRoot, Rows
from acausal.errors import EquilibriumError, OptionError, StartValueError, UnknownVariableError
from components import (
    AngleSource,
    Fixed,
    FlexibleBeam,
    ForceSource,
    ParametricCurve,
    Particle,
    PointOnCurve,
    Prismatic,
    Revolute,
    RigidBody,
    Rod,
    RollingBall,
    RollingDisk,
    RotationalGround,
    RotationalSpring,
    Section,
    SlidingMass,
    Spherical,
    Spring,
    SpringDamper,
    TorqueSource,
    TranslationalGround,
    TranslationalSpring,
    UniformField,
    World,
)
from examples.bicycle import Bicycle
from tests.analysis_scenes import Arm, Motor, Top
from tests.formulations import composed, script
from tests.pairings import each_value
from tests.random_sketches import random_sketch
from tests.scenes import DoublePendulum, FourBar, Pendulum, bennett_linkage

G = 9.81


@pytest.mark.parametrize(
    ("start", "end", "stability"), [(1.5, 0.0, "neutral"), (1.7, np.pi, "unstable"), (-3.0, -np.pi, "unstable")]
)
def test_a_pendulum_rests_below_or_above(start: float, end: float, stability: str):
    scene = Pendulum()
    found = ac.build(scene).equilibrium({scene.hinge.q: start})
    assert found[scene.hinge.q] == pytest.approx(end, abs=1e-12)
    assert found.stability == stability and found.residual < 1e-12 and found.dimension == 0 and found.lasting
    assert found.moved == (("hinge.q", start, pytest.approx(end, abs=1e-12)),)


def test_a_mass_sags_by_its_weight_and_the_anchor_carries_it():
    scene = ac.System()
    scene.world, scene.spring, scene.mass = World(), Spring(120.0, 0.5), Particle(2.0)
    scene.connect(scene.world.frame, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.mass.point)
    found = ac.build(scene).equilibrium({scene.mass.point.position: (0.02, 0.01, -0.6)})
    np.testing.assert_allclose(found[scene.mass.point.position], [0, 0, -0.5 - 2.0 * G / 120.0], atol=1e-12)
    np.testing.assert_allclose(found[scene.mass.point.force], [0, 0, 2.0 * G], atol=1e-10)
    assert found.stability == "neutral"


@pytest.mark.parametrize("make", [FourBar, bennett_linkage])
def test_a_loop_rests_where_its_energy_is_stationary(make):
    scene = make()
    model = ac.build(scene)
    found = model.equilibrium()
    slope = model.functions.potential_energy.jacobian()(0.0, found.x, [], [], 0.0)[1]
    along = np.array(slope) @ found.linearize().expand
    assert np.max(np.abs(along)) < 1e-11
    run = model.simulate(0.5, found.start, rtol=1e-10)
    assert np.max(np.abs(run.x - found.x[:, None])) < 1e-9


def test_a_four_bar_that_is_let_down_comes_to_rest_below():
    scene = FourBar()
    model = ac.build(scene)
    found = model.equilibrium()
    assert found.stability == "neutral"  # it swings about its lowest position
    heights = [model.functions.potential_energy(0.0, x, [], []) for x in (found.x, found.began.x)]
    assert float(heights[0]) < float(heights[1])


def test_a_loop_is_trimmed_by_the_angle_that_closes_it_up_to_full_turns():
    scene = FourBar()
    scene.torque = ac.Input("N*m")
    scene.motor = TorqueSource(scene.torque)
    scene.connect(scene.motor.flange, scene.a.flange)
    model = ac.build(scene)
    first = model.equilibrium({scene.a.q: 0.5}, free=[scene.torque])
    again = model.equilibrium({scene.b.q: first[scene.b.q], scene.c.q: first[scene.c.q] + 2 * np.pi}, free=[scene.torque])
    assert again[scene.a.q] == pytest.approx(0.5, abs=1e-9)
    assert again.inputs[scene.torque] == pytest.approx(first.inputs[scene.torque], rel=1e-9)


def test_an_arm_is_trimmed_where_it_was_put():
    scene = Arm()
    a, b = 0.4, -0.9
    found = ac.build(scene).equilibrium({scene.shoulder.q: a, scene.elbow.q: b}, free=scene.torques)
    outer = 1.0 * G * 0.25 * np.cos(a + b)
    inner = outer + 1.0 * G * 0.8 * np.cos(a) + 2.0 * G * 0.4 * np.cos(a)
    assert [found[scene.shoulder.q], found[scene.elbow.q]] == pytest.approx([a, b], abs=1e-12)
    assert [found.inputs[u] for u in scene.torques] == pytest.approx([-inner, -outer], rel=1e-11)
    assert found.dimension == 2  # two torques hold the arm anywhere


def test_one_torque_holds_the_arm_with_the_other_link_hanging():
    scene = Arm()
    found = ac.build(scene).equilibrium({scene.shoulder.q: ac.exactly(0.4), scene.elbow.q: 1.0}, free=[scene.torques[0]])
    assert found[scene.shoulder.q] == pytest.approx(0.4, abs=1e-13)
    assert found[scene.shoulder.q] + found[scene.elbow.q] == pytest.approx(np.pi / 2, abs=1e-12)


def test_a_counterweight_is_found_as_a_free_parameter():
    scene = ac.System()
    scene.mass = ac.Parameter(1.0, "kg")
    scene.world, scene.hinge = World(), Revolute("y")
    scene.left, scene.right = Fixed((-0.4, 0, 0)), Fixed((0.3, 0, 0.0))
    scene.load, scene.counter = Particle(2.5), Particle(scene.mass)
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    for part, weight in ((scene.left, scene.load), (scene.right, scene.counter)):
        scene.connect(scene.hinge.frame_b, part.frame_a)
        scene.connect(part.frame_b, weight.point)
    found = ac.build(scene).equilibrium({scene.hinge.q: ac.exactly(0.2)}, free=[scene.mass])
    assert found.parameters[scene.mass] == pytest.approx(2.5 * 0.4 / 0.3, rel=1e-12)


@pytest.mark.parametrize("root", [0, 1])
def test_a_heavy_top_precesses_at_its_slow_and_its_fast_rate(root: int):
    A, C, mass, height, theta, spin = 0.02, 0.01, 1.5, 0.1, 0.6, 110.0
    scene = Top(A, C, mass, height)
    # (C - A) cos(theta) w^2 + C spin w = m g h (Goldstein, Classical Mechanics, 5.7, with the spin relative to the line of nodes)
    exact = np.sort(np.roots([(A - C) * np.cos(theta), -C * spin, mass * G * height]).real)[root]
    model = ac.build(scene)
    begin = {scene.nutation.q: ac.exactly(theta), scene.spin.v: ac.exactly(spin), scene.precession.v: exact * 1.3 - 0.2}
    found = model.equilibrium(begin, steady={scene.nutation.q: 0.0, scene.precession.q: None, scene.spin.q: None})
    assert found[scene.precession.v] == pytest.approx(exact, rel=1e-10) and found.lasting
    assert [name for name, _, _ in found.moved] == ["precession.v"]  # angles that do not matter stay
    run = model.simulate(1.0, found.start, rtol=1e-11)
    assert np.max(np.abs(run[scene.nutation.q] - theta)) < 1e-9


class Governor(ac.System):
    """Porter's governor: two balls on equal massless arms, below them a sleeve on the spindle."""

    def __init__(self, arm: float, ball: float, sleeve: float) -> None:
        self.world, self.spindle, self.slide = World(), Revolute("z"), Prismatic("z")
        self.shaft, self.sleeve = RigidBody.box(1.0, (0.02, 0.02, 1.0)), RigidBody.box(sleeve, (0.05, 0.05, 0.05))
        self.connect(self.world.frame, self.spindle.frame_a)
        self.connect(self.spindle.frame_b, self.shaft.frame)
        self.connect(self.shaft.frame, self.slide.frame_a)
        self.connect(self.slide.frame_b, self.sleeve.frame)
        self.tops, self.knees, self.feet, self.balls = [], [], [], []
        self.uppers, self.lowers = [], []
        for _ in range(2):
            top, knee, foot, ball_ = Revolute("y"), Revolute("y"), Revolute("y"), Particle(ball)
            upper, lower = Fixed((0, 0, -arm)), Fixed((0, 0, -arm))
            for parts, part in zip(
                (self.tops, self.knees, self.feet, self.balls, self.uppers, self.lowers),
                (top, knee, foot, ball_, upper, lower),
                strict=True,
            ):
                parts.append(part)
            self.connect(self.shaft.frame, top.frame_a)
            self.connect(top.frame_b, upper.frame_a)
            self.connect(upper.frame_b, ball_.point)
            self.connect(upper.frame_b, knee.frame_a)
            self.connect(knee.frame_b, lower.frame_a)
            self.connect(lower.frame_b, foot.frame_a)
            self.connect(foot.frame_b, self.sleeve.frame)


def test_porters_governor_stands_at_the_height_of_its_formula():
    arm_, ball, sleeve, rate = 0.3, 0.5, 2.0, 15.0
    scene = Governor(arm_, ball, sleeve)
    start = {scene.tops[0].q: 0.8, scene.tops[1].q: -0.8, scene.knees[0].q: -1.6, scene.knees[1].q: 1.6}
    model = ac.build(scene)
    found = model.equilibrium(start, steady={scene.spindle.q: rate, scene.tops[0].q: 0.0, scene.tops[1].q: 0.0})
    height = (ball + sleeve) / ball * G / rate**2  # of the hinges above the balls
    assert arm_ * np.cos(found[scene.tops[0].q]) == pytest.approx(height, rel=1e-11)
    assert found[scene.slide.q] == pytest.approx(-2 * height, rel=1e-11)
    assert found.lasting


def test_a_steady_motion_that_does_not_last_is_called_so():
    scene = Top()
    begin = {scene.nutation.q: ac.exactly(0.6), scene.spin.v: ac.exactly(90.0), scene.precession.v: ac.exactly(5.0)}
    found = ac.build(scene).equilibrium(begin, steady=[scene.precession.v + scene.nutation.v])
    assert not found.lasting and "at this instant only" in str(found)


def test_a_disk_rolls_in_a_circle_for_good():
    scene = ac.System()
    scene.world, scene.contact = World(), RollingDisk(0.3, axis="y")
    scene.wheel = RigidBody.disk(2.0, 0.3, axis="y")
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.wheel.frame)
    model = ac.build(scene)
    axle = scene.wheel.frame.rotation[:, 1]
    turning, tilt, speed = np.arctan2(axle[1], axle[0]), axle[2], axle.T @ scene.wheel.frame.angular_velocity
    found = model.equilibrium({tilt: ac.exactly(0.3), speed: -10.0}, steady={tilt: 0.0, turning: 0.7, speed: 0.0})
    assert found.lasting
    # rate of the angular momentum = torque about the centre, for a thin disk with moments m r^2 / 2 and m r^2 / 4
    rate, lean = 0.7, np.arcsin(0.3)
    needed = (0.25 * rate**2 * np.sin(lean) * np.cos(lean) - G / 0.3 * np.sin(lean)) / (1.5 * rate * np.cos(lean))
    assert found[speed] == pytest.approx(needed, rel=1e-10)
    run = model.simulate(6.0, found.start, rtol=1e-11)
    assert np.max(np.abs(run[tilt] - 0.3)) < 1e-8
    place = run[scene.wheel.frame.position]
    around = np.column_stack([2 * place[:, :2], np.ones(len(place))])  # a circle through all places
    centre = np.linalg.lstsq(around, np.sum(place[:, :2] ** 2, axis=1), rcond=None)[0][:2]
    assert np.ptp(np.linalg.norm(place[:, :2] - centre, axis=1)) < 1e-8
    assert np.ptp(place[:, 2]) < 1e-8


def test_a_motor_runs_at_the_speed_where_friction_takes_its_torque():
    V, R, k, d = 12.0, 1.5, 0.04, 2e-4
    scene = Motor(V, R, 2e-3, k, 1e-4, d)
    found = ac.build(scene).equilibrium(steady=[scene.rotor.w, scene.inductor.i])
    assert found[scene.rotor.w] == pytest.approx(k * V / (R * d + k**2), rel=1e-11)
    assert found[scene.inductor.i] == pytest.approx(d * V / (R * d + k**2), rel=1e-11)
    assert found.linearize(states=[scene.rotor.w, scene.inductor.i]).stability == "asymptotically stable"


def test_a_ball_on_a_plane_rests_anywhere():
    scene = ac.System()
    scene.world, scene.contact, scene.ball = World(), RollingBall(0.1), RigidBody.ball(0.5, 0.1)
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    found = ac.build(scene).equilibrium()
    assert found.dimension == 5 and not found.moved and "family of dimension 5" in str(found)


def test_a_ball_joint_lets_a_body_hang():
    scene = ac.System()
    scene.world, scene.socket, scene.body = World(), Spherical(), RigidBody(1.0, (0.1, 0.12, 0.15), (0.2, -0.1, 0.3))
    scene.connect(scene.world.frame, scene.socket.frame_a)
    scene.connect(scene.socket.frame_b, scene.body.frame)
    found = ac.build(scene).equilibrium({scene.socket.q: (0.3, 0.8, -0.5, 0.1)})
    down = found[scene.body.frame.rotation] @ np.array([0.2, -0.1, 0.3])
    np.testing.assert_allclose(down[:2], 0.0, atol=1e-12)
    assert found.dimension == 1 and np.linalg.norm(found[scene.socket.q]) == pytest.approx(1.0, abs=1e-13)


def test_what_cannot_rest_is_said():
    scene = ac.System()
    scene.world, scene.stone = World(), Particle(1.0)
    with pytest.raises(EquilibriumError, match=r"stone\.free\.v\[2\]' \(off by -9\.81\)"):
        ac.build(scene).equilibrium()
    driven = Pendulum()
    driven.source = AngleSource(lambda t: 2.0 * t)
    driven.connect(driven.source.flange, driven.hinge.flange)
    with pytest.raises(EquilibriumError, match="a source that drives"):
        ac.build(driven).equilibrium()
    scene = DoublePendulum()
    with pytest.raises(EquilibriumError, match=r"shoulder\.q"):
        ac.build(scene).equilibrium({scene.shoulder.q: ac.exactly(0.5)})


def test_wrong_questions_are_answered_in_words():
    scene = DoublePendulum()
    model = ac.build(scene)
    with pytest.raises(OptionError, match="not an input or a parameter"):
        model.equilibrium(free=[scene.shoulder.q])  # type: ignore[list-item]
    with pytest.raises(OptionError, match="must be a list"):
        model.equilibrium(steady=scene.shoulder.q)  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="must be a list"):
        model.equilibrium(free=ac.Input())  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="is a velocity"):
        model.equilibrium(steady={scene.shoulder.v: None})
    with pytest.raises(OptionError, match="finite"):
        model.equilibrium(steady={scene.shoulder.q: float("inf")})
    with pytest.raises(OptionError, match="not a variable"):
        model.equilibrium(steady=[3])  # type: ignore[list-item]
    with pytest.raises(UnknownVariableError):
        model.equilibrium(steady=[Pendulum().hinge.q])
    for start in ("home", 3):
        with pytest.raises(StartValueError, match="Give a dictionary"):
            model.equilibrium(start)  # type: ignore[arg-type]
    with pytest.raises(StartValueError, match="not a number"):
        model.equilibrium({scene.shoulder.q: "up"})  # type: ignore[dict-item]


def test_a_bicycle_without_hands_goes_round_in_a_circle():
    scene = Bicycle()
    model = ac.build(scene)
    lean, contact = scene.rear_contact.q[1], scene.rear_contact
    start = {key: ac.near(value) for key, value in scene.start(5.0).items()} | {scene.steering.q: ac.exactly(0.05)}
    found = model.equilibrium(start, steady={lean: 0.0, scene.steering.q: 0.0, contact.q[0]: None, contact.v[1]: 0.0})
    assert found.lasting
    run = model.simulate(2.0, found.start, rtol=1e-11)
    for variable in (lean, scene.steering.q, contact.v[1]):
        assert np.ptp(run[variable]) < 1e-9
    states = [lean, scene.steering.q, contact.v[0], scene.steering.v, contact.v[1]]
    assert found.linearize(states=states).steady


def test_speeds_of_the_start_that_are_none_of_rest_are_named():
    scene = DoublePendulum()
    model = ac.build(scene)
    said = str(model.equilibrium({scene.shoulder.q: 0.2, scene.elbow.v: 8.0}))
    assert "speeds of the start are not kept: elbow.v; for a steady motion" in said
    assert "steady=" not in str(model.equilibrium({scene.shoulder.q: 0.2}))


def test_places_of_sliders_and_charges_are_no_speeds():
    """They are moved as all places are; the speed of a mass is one."""
    scene = ac.System()
    scene.ground, scene.spring, scene.mass = TranslationalGround(), TranslationalSpring(10.0, 0.3), SlidingMass(2.0)
    scene.connect(scene.ground.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.mass.flange_a)
    model = ac.build(scene)
    assert "not kept" not in str(model.equilibrium({scene.mass.s: 1.0}))
    assert "speeds of the start are not kept: mass.v;" in str(model.equilibrium({scene.mass.s: 1.0, scene.mass.v: 2.0}))


def test_no_equilibrium_is_where_a_part_has_no_meaning():
    """A spring pulls a bead along a parabola z = x^2 / 5 to the nearest place of the curve; where the curve has ended before, there is none."""
    for anchor, rests in ((0.5, True), (3.0, False)):
        scene = ac.System()
        scene.world, scene.bead, scene.spring = World((0, 0, 0)), Particle(1.0), SpringDamper(10.0, 0.0, 1.0)
        scene.guide = PointOnCurve(ParametricCurve(lambda s: (s, 0, s**2 / 5), ends=(-1.0, 1.0)))
        scene.connect(scene.world.frame, scene.guide.frame_a)
        scene.connect(scene.guide.frame_b, scene.bead.point)
        scene.connect(scene.world.at((anchor, 0, 0)), scene.spring.point_a)
        scene.connect(scene.bead.point, scene.spring.point_b)
        model = ac.build(scene)
        if rests:
            x = model.equilibrium()[scene.bead.point.position][0]
            assert x + 2 * x**3 / 25 == pytest.approx(anchor, rel=1e-12)
        else:
            with pytest.raises(EquilibriumError, match=r"'guide' .* has no meaning. The curve ends there"):
                model.equilibrium()
    scene = ac.System()  # a pushed wheel that may only lie flat, where it does not roll on its rim
    scene.world, scene.wheel, scene.body = World((0, 0, 0)), RollingDisk(0.2), RigidBody(1.2, (0.01, 0.02, 0.01))
    scene.push = UniformField((1.0, 0, 0))
    scene.connect(scene.world.frame, scene.wheel.frame_a)
    scene.connect(scene.wheel.frame_b, scene.body.frame)
    with pytest.raises(EquilibriumError, match=r"'wheel' .* has no meaning. The wheel has fallen"):
        ac.build(scene).equilibrium()


@pytest.mark.parametrize(
    "drawn",
    [
        (["RollingDisk"], ["spherical"], 1, False, 37),
        (["RollingDisk", "Spherical"], [], 3, False, 56),
        (["RollingBall"], ["spherical", "weld"], 2, False, 564),
    ],
)
def test_an_equilibrium_is_one_of_the_scene_as_it_is_put_together(drawn):
    """Wheels have not fallen through, hinges point the way they do: a motion may begin there; where none of these was found, there is none."""
    model = ac.build(composed(script(random_sketch(*drawn))))
    try:
        found = model.equilibrium()
    except EquilibriumError as error:
        assert re.search("has no meaning|put together otherwise", str(error))
    else:
        assert model.initial_state(found.start).x == pytest.approx(found.x, rel=1e-9, abs=1e-9)


def hung_ball(size: float):
    """A ball on the floor that a spring holds by its rim; it may roll and turn about. Nothing but coordinates has a length."""
    scene = ac.System()
    scene.world, scene.floor, scene.ball = World((0, 0, -9.81 * size)), RollingBall(0.1 * size), RigidBody.ball(1.3, 0.1 * size)
    scene.spring = Spring(25.0, 0.4 * size)
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame)
    scene.connect(scene.world.at((-0.9 * size, -0.7 * size, 0.6 * size)), scene.spring.point_a)
    scene.connect(scene.ball.at((0.05 * size, -0.03 * size, 0.06 * size)), scene.spring.point_b)
    return scene, scene.ball


@pytest.mark.parametrize("size", [3.0, 0.3, 1e-3])
def test_of_a_family_of_equilibria_the_same_is_found_in_any_unit(size):
    places: list[np.ndarray] = []
    for of in (1.0, size):
        scene, body = hung_ball(of)
        found = ac.build(scene).equilibrium()
        assert found.dimension
        places.append(np.concatenate([found[body.frame.position] / of, found[body.frame.rotation].ravel()]))
    assert np.max(np.abs(places[0] - places[1])) < 1e-6


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e5])
def test_a_root_that_is_as_near_as_its_unknowns_are_rounded_is_found(size):
    """Rows with more rounding than their arguments tell of; with a gap that is more than rounding there is none."""
    for number, (noise, gap) in enumerate(((3e-15, 0.0), (6e-15, 0.0), (3e-15, 1e-9), (0.0, 1e-12))):
        target = size * np.random.default_rng(number).normal(size=2)

        def residual(z, target=target, noise=noise, gap=gap):
            y = (z - target) / size
            return np.append(y, y[0] + y[1] + gap) + noise * np.sin(1e15 * z / size @ [1.0, 2.0] + np.arange(3))

        rows = Rows(residual, lambda z: np.array([[1, 0], [0, 1], [1, 1]]) / size, lambda z, sizes: np.full(3, 1e-20))
        found = NearestRoot(rows, None, np.full(2, size), np.full(2, np.inf))(np.zeros(2))
        assert found.converged == (gap == 0), (noise, gap)
        assert gap or np.max(np.abs(found.z - target)) < 1e-12 * size


class SpringyDelta(ac.System):
    """A plate on three hips with springs, by pairs of equal rods, in units of a length; the springs are up to 1e4 times stiffer than the weight."""

    def __init__(self, size: float, stiffness: np.ndarray, natural: np.ndarray) -> None:
        self.size, self.stiffness, self.natural = size, stiffness, natural
        self.ways = np.array([(np.cos(a), np.sin(a), 0.0) for a in 2 * np.pi / 3 * np.arange(3)])
        self.world, self.plate = World((0, 0, -G)), RigidBody(0.3, (1e-3 * size**2, 1e-3 * size**2, 2e-3 * size**2))
        across = [np.array((-y, x, 0.0)) for x, y, _ in self.ways]
        self.hips, self.rods = [Revolute(tuple(one)) for one in across], [Rod(0.5 * size) for _ in range(6)]
        self.arms = [RigidBody.rod(0.3, tuple(0.25 * size * one)) for one in self.ways]
        self.springs = [RotationalSpring(k * size, angle) for k, angle in zip(stiffness, natural, strict=True)]
        self.grounds = [RotationalGround() for _ in range(3)]
        for k, way in enumerate(self.ways):
            self.connect(self.world.at(tuple(0.2 * size * way)), self.hips[k].frame_a)
            self.connect(self.hips[k].frame_b, self.arms[k].frame)
            self.connect(self.grounds[k].flange, self.springs[k].flange_a)
            self.connect(self.springs[k].flange_b, self.hips[k].flange)
            for side, rod in ((-0.04, self.rods[2 * k]), (0.04, self.rods[2 * k + 1])):
                self.connect(self.arms[k].at(tuple(size * (0.25 * way + side * across[k]))), rod.frame_a)
                self.connect(self.plate.at(tuple(size * (0.05 * way + side * across[k]))), rod.frame_b)

    def lowest(self, start: np.ndarray) -> np.ndarray:
        """Angles of the hips and place of the plate where the energy is least, by scipy, without this package."""
        down = np.array([0.0, 0.0, 1.0])

        def energy(x: np.ndarray) -> float:
            weights = 0.3 * G * (x[5] - 0.125 * np.sum(np.sin(x[:3])))
            return weights + 0.5 * np.sum(self.stiffness * (x[:3] - self.natural) ** 2)

        def gaps(x: np.ndarray) -> np.ndarray:
            arms = 0.25 * (self.ways * np.cos(x[:3])[:, None] - down * np.sin(x[:3])[:, None])
            return np.sum((x[3:] + 0.05 * self.ways - 0.2 * self.ways - arms) ** 2, axis=1) - 0.25

        options = {"maxiter": 1000, "ftol": 1e-15}
        return scipy.optimize.minimize(energy, start, method="SLSQP", constraints={"type": "eq", "fun": gaps}, options=options).x


@pytest.mark.parametrize(
    ("size", "stiffness", "natural"),
    [
        (1.2, (0.5, 3e4, 5.0), (-0.15, 0.66, -0.18)),
        (5e-3, (2.7e4, 0.12, 160.0), (-0.25, 0.6, -0.65)),
    ],
)
def test_springs_of_all_stiffnesses_on_loops_come_to_rest_where_the_energy_is_least(size, stiffness, natural):
    """Down a valley that is steep on both sides, from far up."""
    scene = SpringyDelta(size, np.array(stiffness), np.array(natural))
    found = ac.build(scene).equilibrium({scene.plate.frame.position: (0, 0, -0.4 * size)})
    place = np.array([*(found[hip.q] for hip in scene.hips), *(found[scene.plate.frame.position] / size)])
    assert place == pytest.approx(scene.lowest(place + 0.01 * np.random.default_rng(0).normal(size=6)), abs=1e-5)
    assert found.stability == "neutral"


@each_value(("size", [1e-3, 1.0, 1e3]), ("modes", [2, 4, 7]))
def test_a_beam_sags_by_the_formula_of_books_however_many_shapes_it_has(size, modes):
    """rho A g L^4 / (8 E I), far more than what each shape would yield alone; a scene that nothing but this gives a size."""
    length, side, modulus, density = 0.8 * size, 0.01 * size, 7e10 * size, 2700.0
    scene = ac.System()
    scene.world, section = World(gravity=(0, 0, -G)), Section.rectangle(side, side)
    scene.beam = FlexibleBeam(length, section, youngs_modulus=modulus, density=density, bending=(0, modes), modes="craig-bampton")
    scene.connect(scene.world.at((0, 0, 0), rotation=("x", 0.3)), scene.beam.frame_a)
    sag = ac.build(scene).equilibrium()[scene.beam.frame_b.position]
    bent = density * side**2 * G * np.cos(0.3) * length**4 / (8 * modulus * side**4 / 12)
    assert sag / size == pytest.approx(np.array([length, bent * np.sin(0.3), -bent * np.cos(0.3)]) / size, rel=1e-10, abs=1e-13)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_truss_that_snaps_through_is_held_at_its_middle_alone_though_its_weight_is_carried_to_rounding(size):
    # Von Mises' truss, whose springs are shortest in the middle: weights and what carries them leave nothing, or a rounding
    rng = np.random.default_rng(3)
    for mass in rng.uniform(0.1, 3.0, 6):
        scene = ac.System()
        scene.world, scene.slide, scene.stage, scene.bob = World(), Prismatic("z"), Fixed(), Particle(mass)
        scene.springs = [Spring(stiffness=rng.uniform(50, 900) / size, natural_length=0.52 * size) for _ in range(2)]
        scene.connect(scene.world.frame, scene.slide.frame_a)
        scene.connect(scene.slide.frame_b, scene.stage.frame_a)
        scene.connect(scene.stage.frame_b, scene.bob.point)
        for spring, x in zip(scene.springs, (-0.5, 0.5), strict=True):
            scene.connect(scene.world.at((x * size, 0, 0)), spring.point_a)
            scene.connect(spring.point_b, scene.bob.point)
        scene.carried = ForceSource(mass * (G / 0.7) * 0.7)
        scene.connect(scene.carried.flange, scene.slide.flange)
        found = ac.build(scene).equilibrium({scene.slide.q: 0.0})
        assert (found.dimension, found.stability) == (0, "unstable")
        assert abs(found[scene.slide.q]) < 1e-12 * size
