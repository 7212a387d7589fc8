"""Derivatives of motions: against finite differences, closed forms and a second formulation."""

from __future__ import annotations

import re
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.errors import OptionError, SimulationError, SingularWarning, StartValueError
from acausal.runtime.native import Outcome, Run
from acausal.start import initial
from components import (
    Cable,
    Force,
    ForceSource,
    Particle,
    Prismatic,
    Revolute,
    RigidBody,
    SlidingMass,
    Spring,
    SpringDamper,
    World,
)
from tests.formulations import composed, script
from tests.hard_cases import CASES
from tests.pairings import each_value
from tests.random_sketches import random_sketch
from tests.scenes import Pendulum, SprungBody


class AdjustableFourBar(ac.System):
    """A four-bar whose coupler length, coupler mass and driving torque vary."""

    def __init__(self) -> None:
        self.world = World()
        self.length = ac.Parameter(1.2, "m")
        self.mass = ac.Parameter(2.0, "kg")
        self.crank = RigidBody.rod(1.0, (0.4, 0, 0))
        self.coupler = RigidBody(self.mass, (0.01, 0.24, 0.24), (0.6, 0, 0))
        self.rocker = RigidBody.rod(1.5, (0.8, 0, 0))
        self.a, self.b, self.c, self.d = (Revolute("y") for _ in range(4))
        self.connect(self.world.frame, self.a.frame_a)
        self.connect(self.a.frame_b, self.crank.frame)
        self.connect(self.crank.tip, self.b.frame_a)
        self.connect(self.b.frame_b, self.coupler.frame)
        self.connect(self.coupler.at((self.length, 0, 0)), self.c.frame_a)
        self.connect(self.c.frame_b, self.rocker.frame)
        self.connect(self.rocker.tip, self.d.frame_a)
        self.connect(self.d.frame_b, self.world.at((1.0, 0, 0)))


class Oscillator(ac.System):
    """A mass on a spring on a rail."""

    def __init__(self, damping: float = 0.0) -> None:
        self.world = World((0, 0, 0))
        self.stiffness = ac.Parameter(4.0, "N/m")
        self.mass = ac.Parameter(1.0, "kg")
        self.push = ac.Input("N")
        self.rail = Prismatic("x")
        self.body = Particle(self.mass)
        self.spring = SpringDamper(self.stiffness, 1.0, damping)
        self.force = Force((self.push, 0, 0))
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.body.point)
        self.connect(self.world.at((-1, 0, 0)), self.spring.point_a)
        self.connect(self.spring.point_b, self.body.point)
        self.connect(self.force.point, self.body.point)


TIMES = (0.0, 0.3, 0.7, 1.6)


@pytest.mark.parametrize("compiled", [True, False])
def test_oscillator_has_the_derivatives_of_its_closed_form(compiled):
    scene = Oscillator()
    model = ac.build(scene)
    t = np.array(TIMES)
    found = model.sensitivities(
        TIMES, [scene.stiffness, scene.mass, scene.push, scene.rail.q, scene.rail.v], {scene.rail.q: 0.3, scene.rail.v: 0.5},
        inputs={scene.push: 0.8}, rtol=1e-11, compiled=compiled,
    )  # fmt: skip
    k, m, F, x0, v0 = (ca.SX.sym(n) for n in ("k", "m", "F", "x0", "v0"))
    time = ca.SX.sym("t")
    w = ca.sqrt(k / m)
    x = F / k + (x0 - F / k) * ca.cos(w * time) + v0 / w * ca.sin(w * time)
    symbols = ca.vertcat(k, m, F, x0, v0)
    slope = ca.Function("slope", [time, symbols], [ca.jacobian(x, symbols)])
    expected = np.array([np.array(slope(s, [4.0, 1.0, 0.8, 0.3, 0.5])).ravel() for s in t])
    assert np.max(np.abs(found[scene.rail.q] - expected)) < 2e-10


def test_tighter_tolerance_gives_better_derivatives():
    scene = Oscillator()
    model = ac.build(scene)
    errors = []
    for rtol in (1e-4, 1e-7, 1e-10):
        found = model.sensitivities((0.0, 20.0), [scene.stiffness], {scene.rail.q: 0.3}, rtol=rtol)
        w, t = 2.0, 20.0
        errors.append(abs(found[scene.rail.q][-1, 0] + 0.3 * np.sin(w * t) * t / (2 * w)))
    assert errors[0] < 1e-2 and errors[1] < 1e-5 and errors[2] < 1e-8


@pytest.mark.parametrize("compiled", [True, False])
def test_loops_have_the_derivatives_of_finite_differences(compiled):
    """Also of the assembly: with another coupler the other angles and speeds of the start change too."""
    scene = AdjustableFourBar()
    model = ac.build(scene)
    start = {scene.a.q: 1.0, scene.a.v: 2.0}
    wrt = [scene.length, scene.mass, scene.a.q, scene.a.v]
    found = model.sensitivities(TIMES, wrt, start, rtol=1e-11, compiled=compiled)
    tip = scene.coupler.at((scene.length, 0, 0)).position[0]
    h = 1e-5

    def motion(length: float, mass: float, q: float, v: float) -> np.ndarray:
        run = model.simulate(
            TIMES[-1], {scene.a.q: q, scene.a.v: v}, rtol=1e-13, parameters={scene.length: length, scene.mass: mass}
        )
        at = run.at(TIMES)
        return np.array([at[scene.c.q], at[tip]])

    base = np.array([1.2, 2.0, 1.0, 2.0])
    for column in range(4):
        step = h * np.eye(4)[column]
        central = (
            8 * (motion(*(base + step)) - motion(*(base - step))) - (motion(*(base + 2 * step)) - motion(*(base - 2 * step)))
        ) / (12 * h)
        assert np.max(np.abs(found[scene.c.q][:, column] - central[0])) < 3e-7
        assert np.max(np.abs(found[tip][:, column] - central[1])) < 3e-7


def test_directions_stay_along_the_constraints():
    scene = AdjustableFourBar()
    model = ac.build(scene)
    found = model.sensitivities(TIMES, [scene.length, scene.a.v], {scene.a.q: 1.0, scene.a.v: 2.0}, rtol=1e-9)
    f = model.functions
    x, p = ca.SX.sym("x", found.x.shape[0]), ca.SX.sym("p", 2)
    slope = ca.Function("slope", [x, p], [ca.jacobian(f.invariants(0, x, [], p), ca.vertcat(x, p))])
    for k in range(len(TIMES)):
        J = np.array(slope(found.x[:, k], found.problem.parameters))
        change = np.vstack([found.S[k], found.directions.dp])
        assert np.max(np.abs(J @ change)) < 1e-12 * (1 + np.max(np.abs(change)))


def test_many_directions_fill_several_blocks_of_lanes():
    """Eleven directions, each the same as alone."""
    scene = AdjustableFourBar()
    model = ac.build(scene)
    start = {scene.a.q: 1.0, scene.a.v: 2.0}
    wrt = [scene.length, scene.mass, scene.a.q, scene.a.v] * 3
    together = model.sensitivities(TIMES, wrt[:11], start)
    for k, item in enumerate(wrt[:4]):
        alone = model.sensitivities(TIMES, [item], start)
        for column in range(k, 11, 4):
            assert np.max(np.abs(together.S[:, :, column] - alone.S[:, :, 0])) < 1e-9


@pytest.mark.parametrize("damping", [0.0, 0.3, 2e3])
def test_derivatives_are_as_exact_at_many_times_as_at_a_few(damping):
    """Inside of steps as at their ends, of which there are no more for being asked often: of a closed form, in explicit steps and implicit ones."""
    scene, draw = Oscillator(damping), np.random.default_rng(8)
    model = ac.build(scene)
    time, k, m, F, x0, v0 = (ca.SX.sym(n) for n in ("t", "k", "m", "F", "x0", "v0"))
    wanted = [scene.stiffness, scene.mass, scene.push, scene.rail.q, scene.rail.v]
    symbols, middle = ca.vertcat(k, m, F, x0, v0), F / k
    if damping > 100:
        root = ca.sqrt((damping / (2 * m)) ** 2 - k / m)
        fast, slow = -damping / (2 * m) - root, -(k / m) / (damping / (2 * m) + root)
        a = (v0 - slow * (x0 - middle)) / (fast - slow)
        x = middle + a * ca.exp(fast * time) + (x0 - middle - a) * ca.exp(slow * time)
    else:
        half, w = damping / (2 * m), ca.sqrt(k / m - (damping / (2 * m)) ** 2)
        x = middle + ca.exp(-half * time) * (
            (x0 - middle) * ca.cos(w * time) + (v0 + half * (x0 - middle)) / w * ca.sin(w * time)
        )
    slope = ca.Function("slope", [time, symbols], [ca.jacobian(x, symbols)]).map(300)
    for rtol in (1e-5, 1e-8, 1e-11):
        at = [draw.uniform(1, 9), draw.uniform(0.3, 3), 0.8, 0.3, 0.5]
        end = 20 * np.sqrt(at[1] / at[0])
        times = np.sort([0.0, *draw.uniform(0, end, 298), end])
        found = model.sensitivities(
            times, wanted, {scene.rail.q: at[3], scene.rail.v: at[4]}, inputs={scene.push: at[2]}, rtol=rtol,
            parameters={scene.stiffness: at[0], scene.mass: at[1]},
        )  # fmt: skip
        exact = np.array(slope(times[None], np.repeat(np.array(at)[:, None], 300, axis=1))).reshape(300, 5)
        assert np.all(np.abs(found[scene.rail.q] - exact) < (10 * rtol + 1e-12) * np.max(np.abs(exact), axis=0))


def test_loops_stay_closed_by_their_derivatives_at_however_many_times_these_are_asked_for():
    """And these are the same as where the motion ends at each."""
    scene = AdjustableFourBar()
    model, times = ac.build(scene), np.linspace(0.0, 2.0, 161)
    start, wanted = {scene.a.q: 1.0, scene.a.v: 2.0}, [scene.length, scene.mass, scene.a.v]
    found = model.sensitivities(times, wanted, start, rtol=1e-10)
    f = model.functions
    x, p = ca.SX.sym("x", found.x.shape[0]), ca.SX.sym("p", 2)
    slope = ca.Function("slope", [x, p], [ca.jacobian(f.invariants(0, x, [], p), ca.vertcat(x, p))])
    for k in range(0, 161, 10):
        change = np.vstack([found.S[k], found.directions.dp])
        assert np.max(np.abs(np.array(slope(found.x[:, k], found.problem.parameters)) @ change)) < 1e-12 * (
            1 + np.max(np.abs(change))
        )
    for k in (3, 50, 77, 131):
        alone = model.sensitivities([0.0, times[k]], wanted, start, rtol=1e-10).S[1]
        assert np.max(np.abs(found.S[k] - alone)) < 1e-8 * np.max(np.abs(alone))


@pytest.mark.parametrize("make", [Oscillator, AdjustableFourBar])
def test_asking_often_makes_no_step_more(make, monkeypatch):
    scene, steps = make(), list[int]()
    model, advance = ac.build(scene), Run.advance

    def counted(run: Run, end: float) -> Outcome:
        found = advance(run, end)
        steps.append(run.core.steps)
        return found

    monkeypatch.setattr(Run, "advance", counted)
    start = {scene.rail.q: 0.3, scene.rail.v: 0.5} if make is Oscillator else {scene.a.q: 1.0, scene.a.v: 2.0}
    for times in ([0.0, 5.0], np.linspace(0, 5, 500)):
        model.sensitivities(times, [scene.mass, *start], start, rtol=1e-9)
    few, many = steps  # one call for all times
    assert 10 < many == few


def test_stiff_motion_goes_on_with_radau():
    scene = Oscillator(damping=2e5)
    model = ac.build(scene)
    found = model.sensitivities((0.0, 1.0, 1e4), [scene.stiffness, scene.rail.q], {scene.rail.q: 0.3}, rtol=1e-9)
    k, c = 4.0, 2e5
    rate = 2 * k / (c + np.sqrt(c**2 - 4 * k))
    x = 0.3 * np.exp(-rate * 1e4)
    assert abs(found[scene.rail.q][-1, 0] + x * 1e4 / c) < 1e-8
    assert abs(found[scene.rail.q][-1, 1] - x / 0.3) < 1e-8


def test_trajectory_function_is_differentiable_both_ways():
    scene = AdjustableFourBar()
    model = ac.build(scene)
    f = model.trajectory_function(
        (0.0, 0.5, 1.0), scene.c.q, [scene.length, scene.a.v], {scene.a.q: 1.0, scene.a.v: 2.0}, rtol=1e-11
    )
    w = ca.MX.sym("w", 2)
    at = [1.2, 2.0]
    assert f(at).shape == (1, 3)
    J = np.array(ca.Function("J", [w], [ca.jacobian(f(w), w)])(at))
    forward = np.array(ca.Function("fwd", [w], [ca.jtimes(ca.vec(f(w)), w, ca.DM([1, -2]))])(at)).ravel()
    reverse = np.array(ca.Function("rev", [w], [ca.gradient(ca.sumsqr(f(w)), w)])(at)).ravel()
    value = np.array(f(at)).ravel()
    h = 1e-5
    central = (np.array(f([1.2 + h, 2.0])) - np.array(f([1.2 - h, 2.0]))).ravel() / (2 * h)
    assert np.max(np.abs(J[:, 0] - central)) < 1e-7
    assert np.allclose(forward, J @ [1, -2], atol=1e-12)
    assert np.allclose(reverse, 2 * J.T @ value, atol=1e-11)


def test_trajectory_function_is_nan_exactly_where_the_start_cannot_close():
    """Crank tip and rocker's pivot are less far apart than coupler and rocker together, and farther than their difference."""
    scene = AdjustableFourBar()
    model = ac.build(scene)
    f = model.trajectory_function((0.0, 0.01), scene.c.q, [scene.length, scene.a.q], {scene.a.q: 1.0}, rtol=1e-6)
    J = f.jacobian()
    for length, angle in ((1.2, 1.0), (3.0, 1.0), (0.05, 1.0), (0.6, -2.0), (0.5, -2.0), (1.2, np.nan)):
        far = np.hypot(1 - 0.4 * np.cos(angle), 0.4 * np.sin(angle))
        closes = abs(length - 0.8) < far < length + 0.8
        value = f([length, angle])
        assert (np.isfinite(np.array(value)).all(), np.isnan(np.array(value)).all()) == (closes, not closes)
        assert np.isfinite(np.array(J([length, angle], value))).all() == closes
        assert ("not finite: [1.2, nan]" in f.failure) == np.isnan(angle)
        assert bool(f.failure) != closes
    with pytest.raises(StartValueError):  # what no values can mend is told at once
        model.trajectory_function((0.0, 1.0), scene.c.q, [scene.length], {ac.time: 1.0})
    with pytest.raises(OptionError, match="not a parameter"):
        model.trajectory_function((0.0, 1.0), scene.c.q, [Oscillator().mass])


def test_an_optimiser_finds_the_start_speed_that_reaches_a_point():
    """A ball thrown up on a spring-free rail: the speed at which it is at height h after one second is known."""
    scene = ac.System()
    scene.world = World()
    scene.ball = Particle(1.0)
    model = ac.build(scene)
    z, v = scene.ball.point.position, scene.ball.point.velocity
    f = model.trajectory_function((0.0, 1.0), z[2], [v], {z: (0, 0, 0), v: (0, 0, 1.0)}, rtol=1e-10)
    w = ca.MX.sym("w", 3)
    problem = {"x": w, "f": ca.sumsqr(w), "g": f(w)[1]}
    options = {"ipopt.hessian_approximation": "limited-memory", "ipopt.print_level": 0, "print_time": False, "ipopt.tol": 1e-10}
    result = ca.nlpsol("reach", "ipopt", problem, options)(x0=[0.1, 0.2, 1.0], lbg=2.0, ubg=2.0)
    assert np.max(np.abs(np.array(result["x"]).ravel() - [0, 0, 2 + 9.81 / 2])) < 1e-6


def test_start_values_of_expressions_are_found_however_they_are_written():
    scene = Pendulum()
    model, place, t = ac.build(scene), 0.3, [0.0, 0.4]
    start = {scene.rod.tip.position[0]: place, -scene.rod.tip.velocity[2]: 0.2}
    wrt = [scene.rod.tip.position[0], -scene.rod.tip.velocity[2]]
    found = model.sensitivities(t, wrt, start, rtol=1e-11)[scene.hinge.q][:, :]
    reach = model.trajectory_function(t, scene.hinge.q, wrt, start, rtol=1e-11)
    assembled = model.assembly_function(scene.hinge.q, scene.rod.tip.position[0], start)
    slope = 1 / np.sqrt(1 - place**2)
    assert abs(found[0, 0]) == pytest.approx(slope, rel=1e-12)
    assert abs(float(assembled.jacobian()(place, 0.0))) == pytest.approx(slope, rel=1e-9)
    h = 1e-6
    for k, change in enumerate(np.eye(2) * h):
        one, other = (np.array(reach(np.array([place, 0.2]) + sign * change)).ravel() for sign in (1, -1))
        assert np.allclose(found[:, k], (one - other) / (2 * h), atol=1e-8)


def test_wrong_requests_are_explained():
    scene = Oscillator()
    model = ac.build(scene)
    with pytest.raises(OptionError, match="ascending"):
        model.sensitivities((0.0, 0.0), [scene.mass])
    with pytest.raises(OptionError, match="start"):
        model.sensitivities(TIMES, [scene.rail.q])
    with pytest.raises(OptionError, match="only near"):
        model.sensitivities(TIMES, [scene.rail.q], {scene.rail.q: ac.near(0.1)})
    with pytest.raises(OptionError, match="function of time"):
        model.sensitivities(TIMES, [scene.push], inputs={scene.push: lambda t: t})
    with pytest.raises(SimulationError):
        model.sensitivities((0.0, 1.0), [scene.mass], {scene.rail.q: 0.1}, max_steps=1)
    weak = Spring(1.0)
    with pytest.raises(OptionError, match="not a parameter"):
        model.sensitivities(TIMES, [weak.point_a.position])


def test_derivatives_through_a_singular_position_are_told_to_lose_digits():
    case = CASES["four_bars_through_singularity"]()
    speed = list(case.start)[-1]
    with pytest.warns(SingularWarning, match="lose digits"):
        case.model.sensitivities([0.0, case.end], [speed], case.start)


@each_value(
    ("rtol", [1e-4, 1e-8, 1e-12]),
    (
        ("kinds", "seed"),
        [(["RollingTorus", "Universal", "RollingBall"], 104), (["CartesianTranslation", "RollingDisk", "Planar"], 342)],
    ),
)
def test_what_falls_freely_together_does_not_depend_on_its_masses(kinds, seed, rtol):
    """All that depends on a mass cancels, and what is left of it, rounding alone, is followed by no step."""
    source = script(random_sketch(kinds, [], 1, True, seed)).replace(
        "scene = ac.System()", "scene = ac.System()\nscene.mass = ac.Parameter(1.0)", 1
    )
    scene = composed(re.sub(r"RigidBody\(([^,]+),", r"RigidBody(\1 * scene.mass,", source, count=1))
    found = ac.build(scene).sensitivities([0.0, 0.3], [scene.mass], rtol=rtol)
    assert np.max(np.abs(found.S)) < 1e-13


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_what_start_values_leave_open_has_the_derivatives_of_the_start_that_is_found(size):
    """Of the two freedoms of a five-bar one is given; the other is where the sketch, over all joints, is nearest, and has the least velocities."""
    scene = ac.System()
    scene.world, scene.length = World((0, 0, -9.81 * size)), ac.Parameter(0.9 * size, "m")
    scene.hinges = [Revolute("y") for _ in range(5)]
    scene.bars = [RigidBody.rod(1.0, (x * size, 0, z * size)) for x, z in ((0.1, 0.6), (0.4, 0.5), (0.6, -0.4))]
    scene.last = RigidBody(1.0, tuple(0.1 * size**2 * np.ones(3)), (0.2 * size, 0, 0))
    frame = scene.world.frame
    for hinge, bar in zip(scene.hinges, scene.bars, strict=False):
        scene.connect(frame, hinge.frame_a)
        scene.connect(hinge.frame_b, bar.frame)
        frame = bar.tip
    scene.connect(frame, scene.hinges[3].frame_a)
    scene.connect(scene.hinges[3].frame_b, scene.last.frame)
    scene.connect(scene.last.at((scene.length, 0, 0)), scene.hinges[4].frame_a)
    scene.connect(scene.hinges[4].frame_b, scene.world.at((1.4 * size, 0, 0)))
    model, first = ac.build(scene), scene.hinges[0]
    start = {first.q: 0.2, first.v: 1.3}
    found = model.sensitivities([0.0, 0.3], [first.q, first.v, scene.length], start, rtol=1e-10)

    def states(q: float, v: float, length: float, end: float) -> np.ndarray:
        values = {"start": {first.q: q, first.v: v}, "parameters": {scene.length: length}}
        return model.initial_state(**values).x if not end else model.simulate(end, rtol=1e-12, samples=2, **values).x[:, -1]

    point, step = np.array([0.2, 1.3, 0.9 * size]), 1e-3 * np.diag([1.0, 1.0, size])
    for k, end in enumerate((0.0, 0.3)):
        around = [[states(*(point + s * h), end) for s in (-2, -1, 1, 2)] for h in step]
        expected = np.array([(a - 8 * b + 8 * c - d) / 12e-3 for a, b, c, d in around]).T
        assert np.max(np.abs(expected)) > 0.5
        assert found.S[k] * [1.0, 1.0, size] == pytest.approx(expected, abs=1e-6 * np.max(np.abs(expected)))


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_derivatives_of_a_start_that_bends_far_below_the_size_of_its_coordinates_are_as_good(size):
    """A weight on a cable over an eyelet on a cart: by central differences of the start, whose error falls with the fourth power of their step."""
    scene = ac.System()
    scene.world, scene.length = World((0, 0, -9.81 * size)), ac.Parameter(2.4 * size, "m")
    scene.slide, scene.cart, scene.weight = (
        Prismatic("x"),
        RigidBody.box(3.0, (0.2 * size,) * 3),
        Particle(1.0, position=(0.5 * size, 0, -size)),
    )
    scene.cable = Cable(scene.length, over=[scene.cart.at((0.1 * size, 0, 0))])
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.cart.frame)
    scene.connect(scene.world.at((-size, 0, 0.5 * size)), scene.cable.frame_a)
    scene.connect(scene.cable.frame_b, scene.weight.point)
    model, start = ac.build(scene), {scene.slide.q: 0.2 * size, scene.weight.point.position[1]: 0.1 * size}
    found = model.sensitivities([0.0], [scene.length], start).S[0, :, 0]
    step = 2e-4 * size
    a, b, c, d = (model.initial_state(start, parameters={scene.length: 2.4 * size + k * step}).x for k in (-2, -1, 1, 2))
    assert found == pytest.approx((a - 8 * b + 8 * c - d) / (12 * step), abs=1e-9)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
def test_derivatives_of_a_swing_are_the_same_beside_what_moves_far(rtol):
    """A spring pulled by a force swings about force / stiffness, which a mass far away is pushed by, too, and a million times as hard, or more."""
    found = []
    for hard in (1e6, 1e12, 1e18):
        scene, stretch = Oscillator(), 0.3
        scene.pull = ac.Parameter(0.5)
        scene.near, scene.far = ForceSource(1.0 * scene.pull), ForceSource(hard * scene.pull)
        scene.stone = SlidingMass(1.0)
        scene.connect(scene.near.flange, scene.rail.flange)
        scene.connect(scene.far.flange, scene.stone.flange_a)
        start = {scene.rail.q: stretch, scene.rail.v: 0.0, scene.stone.s: 0.0, scene.stone.v: 0.0}
        S = ac.build(scene).sensitivities([0.0, 7.3], [scene.pull], start, inputs={scene.push: 0.0}, rtol=rtol)
        found.append(S[scene.rail.q].ravel()[-1])
        assert S[scene.stone.s].ravel()[-1] == pytest.approx(hard * 7.3**2 / 2, rel=1e-9)
    assert found == pytest.approx([(1 - np.cos(2 * 7.3)) / 4] * 3, rel=10 * rtol, abs=1e-12)


def test_entries_of_start_values_are_found_however_they_are_written():
    scene = ac.System()
    scene.world, scene.stone = World((0, 0, -9.81)), Particle(1.0)
    place = scene.stone.point
    scene.push = Force((0, 0, 0))
    scene.connect(scene.push.point, place)
    model, t = ac.build(scene), 0.7
    whole = {place.position: (0, 0, 1), place.velocity: (1, 0, 2)}
    parts = {place.position[k]: float(k == 2) for k in range(3)} | {place.velocity[k]: (1.0, 0.0, 2.0)[k] for k in range(3)}
    for start in (whole, parts):
        found = model.sensitivities([0.0, t], [place.position[2], place.velocity[2], place.velocity], start)
        assert found[place.position][-1] == pytest.approx(
            np.array([[0, 0, t, 0, 0], [0, 0, 0, t, 0], [1, t, 0, 0, t]]), abs=1e-12
        )
        thrown = model.trajectory_function([0.0, t], place.position, [place.velocity[2]], start)
        assert np.array(thrown(3.0))[:, 1] == pytest.approx([t, 0, 1 + 3.0 * t - 9.81 / 2 * t**2], abs=1e-12)
        assert np.array(model.assembly_function(place.velocity, [place.velocity[2]], start)(3.0)).ravel().tolist() == [1, 0, 3]
    with pytest.raises(OptionError, match=r"has no start value in `start`"):
        model.sensitivities([0.0, t], [place.position[2] + place.position[1]], whole)


def test_derivatives_follow_the_tolerance_where_the_motion_is_slow_and_they_are_not():
    """It follows the hand alone, in long steps; a little off this start, and with another spring, it oscillates."""
    scene = SprungBody()
    model, draw, end = ac.build(scene), np.random.default_rng(5), 5.0
    for _ in range(12):
        w, rtol = 10 ** draw.uniform(1, 2.7), 10 ** draw.uniform(-12, -6)
        a, slope = w**2 / (w**2 - 1), -2 * w / (w**2 - 1) ** 2
        start = {scene.rail.q: 0.0, scene.rail.v: a}
        run = model.sensitivities([0.0, end], [*start, scene.rate], start, parameters={scene.rate: w}, rtol=rtol)
        fast = np.sin(w * end)
        exact = np.array([np.cos(w * end), fast / w, slope * (np.sin(end) - fast / w)])
        bound = (3 * rtol + 1e-14 * w * end) * np.array([1.0, 1 / w, 1 / w])
        assert np.all(np.abs(np.ravel(run[scene.rail.q][-1]) - exact) < bound), (w, rtol)


@pytest.mark.parametrize(("angle", "length", "push"), [(0.4, 0.9, 0.0), (2.3, 0.8, 1.7)])
def test_where_a_start_leaves_only_speeds_open_its_places_are_not_searched_for_again(
    angle: float, length: float, push: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A four-bar whose crank is told, and of whose speeds some sum is near a value: its motion changes with the length of its coupler as by differences of whole simulations."""
    scene: Any = ac.System()
    scene.length, scene.world = ac.Parameter(length, "m"), World(gravity=(0, 0, -9.81))
    scene.hinges = [Revolute("y") for _ in range(4)]
    scene.crank, scene.coupler = RigidBody.rod(1.0, (0, 0, 0.3)), RigidBody.rod(1.0, (scene.length, 0, 0))
    scene.rocker = RigidBody.rod(1.0, (0, 0, 0.6))
    a, b, c, d = scene.hinges
    pairs = [
        (scene.world.frame, a.frame_a),
        (a.frame_b, scene.crank.frame),
        (scene.crank.tip, b.frame_a),
        (b.frame_b, scene.coupler.frame),
    ]
    pairs += [
        (scene.coupler.tip, c.frame_a),
        (c.frame_b, scene.rocker.tip),
        (scene.world.at((0.9, 0, 0)), d.frame_a),
        (d.frame_b, scene.rocker.frame),
    ]
    for one, other in pairs:
        scene.connect(one, other)
    model, times = ac.build(scene), np.array([0.0, 0.1, 0.3])
    start = {a.q: angle, b.v + d.v: ac.near(push)}
    h = 1e-4
    runs = [model.simulate(0.3, start, parameters={scene.length: length + s * h}, rtol=1e-12).at(times)[d.q] for s in (1, -1)]
    searches: list[Any] = []
    searched = initial._searched
    monkeypatch.setattr(initial, "_searched", lambda *given: searches.append(given) or searched(*given))
    found = model.sensitivities(times, [scene.length], start)[d.q]
    assert np.ravel(found) == pytest.approx((runs[0] - runs[1]) / (2 * h), rel=1e-5, abs=1e-7)
    assert len(searches) <= 1
