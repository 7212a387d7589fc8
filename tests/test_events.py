"""Zeros of expressions along a motion: found by the C runtime and on the virtual machine, compared with closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import acausal as ac
from acausal.errors import AccuracyWarning, OptionError
from components import Particle, Prismatic, Revolute, RigidBody, Spring, World
from tests.scenes import FourBar

G = 9.81
BOTH = pytest.mark.parametrize("compiled", [True, False])


class Ball(ac.System):
    """A particle in the air."""

    def __init__(self) -> None:
        self.world = World()
        self.ball = Particle(1.0)

    @property
    def height(self) -> ac.Expression:
        return self.ball.point.position[2]


def thrown(speed: float, events, *, compiled: bool, end: float = 3.0, height: float = 0.0):
    scene = Ball()
    start = {scene.ball.point.position: (0, 0, height), scene.ball.point.velocity: (0, 0, speed)}
    return ac.build(scene).simulate(end, start, events=events(scene), compiled=compiled, rtol=1e-10)


@BOTH
def test_crossings_of_a_height_in_both_directions(compiled):
    run = thrown(
        10.0,
        lambda s: [ac.when(s.height - 2), ac.when(s.height - 2, "rising"), ac.when(s.height - 2, "falling")],
        compiled=compiled,
    )
    root = np.sqrt(100 - 4 * G)
    up, down = (10 - root) / G, (10 + root) / G
    assert [(e.direction, e.when.direction) for e in run.events] == [
        ("rising", "both"), ("rising", "rising"), ("falling", "both"), ("falling", "falling"),
    ]  # fmt: skip
    assert np.max(np.abs(np.array([e.time for e in run.events]) - [up, up, down, down])) < 1e-13
    assert all(abs(e.x[2] - 2) < 1e-12 for e in run.events)


@pytest.mark.parametrize("off", [2e-11, 1e-9, 1e-6])
def test_what_is_crossed_right_after_the_start_is_no_rounding(off: float):
    """A value that begins below zero by more than what the first step's values are rounded to."""
    run = thrown(10.0, lambda s: [ac.when(s.height - 0.3 - 10 * off, "rising")], compiled=True, end=1.0, height=0.3)
    assert [e.time for e in run.events] == pytest.approx([off], rel=1e-4)


@BOTH
def test_many_crossings_in_one_step_are_all_found(compiled):
    """The motion is a parabola, so steps are long; the guard swings sixteen times in each second."""
    run = thrown(1.0, lambda s: [ac.when(np.sin(100 * ac.time))], compiled=compiled, end=2.0)
    times = np.array([e.time for e in run.events])
    assert run.statistics.steps < 30
    assert np.max(np.abs(times - np.pi / 100 * np.arange(1, 64))) < 1e-13


@BOTH
@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_grazing_pair_is_found_however_close(compiled, gap):
    """Just below the top of the parabola: two crossings, 2 sqrt(2 gap / g) apart."""
    top = 10.0**2 / (2 * G)
    run = thrown(10.0, lambda s: [ac.when(s.height - (top - gap))], compiled=compiled)
    half = np.sqrt(2 * gap / G)
    assert [e.direction for e in run.events] == ["rising", "falling"]
    assert np.max(np.abs(np.array([e.time for e in run.events]) - (10 / G + np.array([-half, half])))) < 1e-14 / half + 1e-13


@BOTH
def test_touching_counts_once_and_missing_by_little_does_not(compiled):
    top = 10.0**2 / (2 * G)
    touch = thrown(10.0, lambda s: [ac.when(s.height - top, "falling")], compiled=compiled)
    assert len(touch.events) <= 2  # rounding decides between a touch and a pair that falls once
    assert all(abs(e.time - 10 / G) < 1e-6 for e in touch.events) and touch.events
    assert not thrown(10.0, lambda s: [ac.when(s.height - top - 1e-9)], compiled=compiled).events


@BOTH
@pytest.mark.parametrize(("speed", "direction"), [(1.0, "rising"), (-1.0, "falling"), (0.0, "falling")])
def test_a_start_at_zero_counts_in_the_direction_in_which_it_is_left(compiled, speed, direction):
    events = lambda s: [ac.when(s.height, "rising"), ac.when(s.height, "falling"), ac.when(s.height)]  # noqa: E731
    run = thrown(speed, events, compiled=compiled, end=0.1)
    assert [(e.time, e.when.direction) for e in run.events] == [(0.0, direction)]


@BOTH
def test_a_ball_that_starts_on_the_floor_does_not_fall_through(compiled):
    run = thrown(0.0, lambda s: [ac.when(s.height, "falling", stop=True)], compiled=compiled)
    assert run.solution.stopped and run.solution.t[-1] == 0.0


@BOTH
def test_a_stopping_event_ends_the_motion_there(compiled):
    run = thrown(10.0, lambda s: [ac.when(s.height - 2), ac.when(s.height, "falling", stop=True)], compiled=compiled, end=5.0)
    landing = 2 * 10 / G
    assert run.solution.stopped and len(run.events) == 3
    assert abs(run.t[-1] - landing) < 1e-13
    assert abs(run.x[2, -1]) < 1e-12
    at = run.at([0.3, landing - 1e-3, run.t[-1]])
    assert np.max(np.abs(at.x[2] - (10 * at.t - G / 2 * at.t**2))) < 1e-11


@BOTH
def test_a_motion_goes_on_from_where_it_stopped(compiled):
    """Bounces with restitution 0.8, each a new run: the times of the first five impacts."""
    scene = Ball()
    model = ac.build(scene)
    position, velocity = scene.ball.point.position, scene.ball.point.velocity
    landing = ac.when(scene.height, "falling", stop=True)
    t, z, v, impacts = 0.0, 1.0, 0.0, []
    for _ in range(5):
        run = model.simulate(
            t + 5.0, {position: (0, 0, z), velocity: (0, 0, v)}, t0=t, events=[landing], compiled=compiled, rtol=1e-11
        )
        t, z, v = run.t[-1], run.x[2, -1], -0.8 * run.x[5, -1]
        impacts.append(t)
    fall = np.sqrt(2 / G)
    expected = fall + 2 * fall * np.array([sum(0.8**k for k in range(1, n + 1)) for n in range(5)])
    assert np.max(np.abs(np.array(impacts) - expected)) < 1e-11


@BOTH
def test_turning_points_of_a_four_bar_agree_with_its_speed(compiled):
    """The crank's speed is zero there: guards on states of a loop, with projection."""
    scene = FourBar()
    run = ac.build(scene).simulate(5.0, events=[ac.when(scene.a.v)], compiled=compiled, rtol=1e-11)
    assert run.events
    at = run.at([e.time for e in run.events])
    assert np.max(np.abs(at[scene.a.v])) < 1e-10
    dense = run.at(np.linspace(1e-4, 5, 20001))[scene.a.v]  # it starts at rest
    assert np.sum(np.diff(np.sign(dense)) != 0) == len(run.events)


def test_both_backends_agree_on_a_damped_mixture():
    scene = ac.System()
    scene.world, scene.hinge = World(), Revolute("y")
    scene.rod = RigidBody.rod(1.0, (0, 0, -1.0))
    scene.rail, scene.mass, scene.spring = Prismatic("x"), Particle(0.5), Spring(30.0, 0.5)
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.world.at((1, 0, -1)), scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.mass.point)
    scene.connect(scene.rod.tip, scene.spring.point_a)
    scene.connect(scene.mass.point, scene.spring.point_b)
    model = ac.build(scene)
    events = [ac.when(scene.hinge.q), ac.when(scene.rail.v, "rising"), ac.when(scene.rail.q * scene.hinge.q - 0.05)]
    one, two = (model.simulate(6.0, {scene.hinge.q: 0.7}, events=events, compiled=c, rtol=1e-11) for c in (True, False))
    assert len(one.events) == len(two.events) > 8
    assert all(
        a.when is b.when and a.direction == b.direction and abs(a.time - b.time) < 1e-9
        for a, b in zip(one.events, two.events, strict=True)
    )


def test_wrong_events_are_explained():
    scene = Ball()
    with pytest.raises(OptionError, match="rising"):
        ac.when(scene.height, "up")
    with pytest.raises(OptionError, match="not an expression"):
        ac.when(1.0)  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="not a scalar"):
        ac.build(scene).simulate(1.0, events=[ac.when(scene.ball.point.position)])


@BOTH
def test_an_expression_without_a_value_hides_no_other(compiled):
    """sqrt(z + 1) ends at z = -1; the ball falls on, to z = -5."""
    run = thrown(
        0.0,
        lambda s: [ac.when(np.sqrt(s.height + 1) - 1.5), ac.when(s.height + 5, "falling", stop=True)],
        compiled=compiled,
    )
    assert run.solution.stopped and abs(run.t[-1] - np.sqrt(10 / G)) < 1e-12


@BOTH
def test_a_part_of_a_step_without_values_hides_no_zero_in_the_rest(compiled):
    run = thrown(0.0, lambda s: [ac.when(np.sqrt(s.height + 1) - 0.5, "falling")], compiled=compiled)
    assert [round(e.time, 9) for e in run.events] == [round(float(np.sqrt(1.5 / G)), 9)]


@BOTH
@pytest.mark.parametrize("power", [2, 3, 4, 5])
def test_flat_zeros_are_crossed_or_touched_by_their_power(compiled, power):
    run = thrown(0.0, lambda s: [ac.when((ac.time - 0.1) ** power)], compiled=compiled, end=1.0)
    assert [e.direction for e in run.events] == ["rising" if power % 2 else "touching"]
    assert abs(run.events[0].time - 0.1) < 1e-4
    assert not thrown(0.0, lambda s: [ac.when((ac.time - 0.1) ** 3, "falling", stop=True)], compiled=compiled).solution.stopped


@BOTH
def test_expressions_that_stay_at_rounding_or_zero_are_no_events(compiled):
    """A hinge askew: its tip stays in a plane; what never leaves the ground; what is zero for a while."""
    n = np.array([0.3, 0.8, 0.2]) / np.linalg.norm([0.3, 0.8, 0.2])
    scene = ac.System()
    scene.world, scene.hinge = World(), Revolute(tuple(n))
    scene.rod = RigidBody.rod(1.0, tuple(np.cross(n, (0.3, 0.5, -1.0))))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    tip = scene.rod.tip.position
    run = ac.build(scene).simulate(
        10.0, {scene.hinge.q: 0.5}, events=[ac.when(tip[0] * n[0] + tip[1] * n[1] + tip[2] * n[2])], compiled=compiled
    )
    assert not run.events
    flat = thrown(
        3.0,
        lambda s: [ac.when(s.ball.point.position[0]), ac.when(abs(s.height - 0.2) + s.height - 0.2), ac.when(s.height - 0.2)],
        compiled=compiled,
        end=1.0,
    )
    assert [e.direction for e in flat.events] == ["rising", "falling"]


@BOTH
def test_a_motion_that_goes_on_in_the_same_direction_does_not_stop_again(compiled):
    scene = Ball()
    model = ac.build(scene)
    position, velocity = scene.ball.point.position, scene.ball.point.velocity
    events = [ac.when(scene.height - 1, "falling", stop=True)]
    run = model.simulate(5.0, {position: (0, 0, 0), velocity: (0, 0, 10.0)}, events=events, compiled=compiled)
    assert run.solution.stopped
    on = model.simulate(5.0, {position: run.x[:3, -1], velocity: run.x[3:, -1]}, t0=run.t[-1], events=events, compiled=compiled)
    assert not on.solution.stopped and on.t[-1] == 5.0


@BOTH
@pytest.mark.parametrize("seed", range(4))
def test_what_is_zero_by_geometry_is_no_event_however_it_is_written(seed, compiled):
    """Along a hinge's axis nothing moves: speeds from rest on, whose terms vanish at the start and rounding with them, in any units; small guards that are
    none of rounding are found as others are."""
    rng = np.random.default_rng(seed)
    n = rng.normal(size=3)
    scene = ac.System()
    scene.world, scene.hinge = World((0, 0, -9.81)), Revolute(tuple(n))
    scene.rod = RigidBody.rod(1.0, tuple(rng.normal(size=3)))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    n /= np.linalg.norm(n)
    tip, frame = scene.rod.tip, scene.rod.frame
    across = np.cross(n, rng.normal(size=3))
    zeros = [
        tip.velocity.T @ n,
        1e9 * (tip.velocity.T @ n),
        frame.angular_velocity.T @ across,
        1e-12 * (tip.velocity.T @ n) * (tip.position.T @ across),
    ]
    model = ac.build(scene)
    start = {scene.hinge.q: model.equilibrium({scene.hinge.q: 0.0}).point.x[0] + 0.4}
    small = ac.when(1e-20 * scene.hinge.v, "rising")
    run = model.simulate(10.0, start, events=[*map(ac.when, zeros), small], compiled=compiled)
    turning = np.flatnonzero((run[scene.hinge.v][1:-1] < 0) & (run[scene.hinge.v][2:] >= 0)).size
    assert all(event.when is small for event in run.events)
    assert turning > 0
    assert len(run.events) - turning in (0, 1)  # at rest at the start


@BOTH
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])
def test_what_is_conserved_crosses_nothing_however_its_errors_wander(rtol, compiled):
    """Beside a zero that is crossed, of a body in free rotation: its angular momentum and energy against their values at the start."""
    scene = ac.System()
    scene.world, scene.body = World(None), RigidBody(1.0, (1.0, 2.0, 3.0))
    inertia, w0 = np.diag([1.0, 2.0, 3.0]), np.array([0.1, 1.0, 0.2])
    R, w = scene.body.frame.rotation, scene.body.frame.angular_velocity
    momentum = R @ inertia @ R.T @ w
    conserved = [ac.when(momentum[k] - (inertia @ w0)[k]) for k in range(3)]
    conserved += [ac.when(w.T @ momentum - w0 @ inertia @ w0, "rising"), ac.when(w.T @ momentum - w0 @ inertia @ w0, "falling")]
    crossed = ac.when((R.T @ w)[0])
    run = ac.build(scene).simulate(20.0, {w: tuple(w0)}, rtol=rtol, events=[*conserved, crossed], compiled=compiled)
    assert len(run.events) == np.sum(np.diff(np.sign((run[R.T @ w])[:, 0])) != 0) > 2


@BOTH
@pytest.mark.parametrize("law", [lambda h: np.sqrt(h - 1e3), lambda h: np.log(h - 7e2) + 1, lambda h: np.sqrt(h**2 - h**2 - 1)])
def test_an_event_without_a_value_is_told(compiled, law):
    """What is a number nowhere passes through zero nowhere; what is one in part of the motion, or has its zero, is not told of."""
    with pytest.warns(
        AccuracyWarning, match=r"when: .*test_events\.py:\d+\) is not a number at any step from 0 s to 3 s"
    ) as told:
        run = thrown(10.0, lambda s: [ac.when(s.height - 2), ac.when(law(s.height))], compiled=compiled)
    assert len(told) == 1 and str(told[0].message).count("test_events.py") == 1
    assert len(run.events) == 2


@BOTH
def test_an_event_with_a_value_in_part_of_the_motion_is_found(compiled):
    run = thrown(10.0, lambda s: [ac.when(np.sqrt(s.height - 1) - 1)], compiled=compiled)
    assert [event.time for event in run.events] == pytest.approx([(10 + k * np.sqrt(100 - 4 * G)) / G for k in (-1, 1)], rel=1e-9)
