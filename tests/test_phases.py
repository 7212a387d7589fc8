"""Optimal control in phases: contact and flight, impacts, releases, motions that repeat themselves, scenes that follow one another."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.errors import OptimalControlError, OptionError
from acausal.optimal_control import attempts
from acausal.optimal_control.whole import whole
from components import (
    Coulomb,
    EndStop,
    Fixed,
    ForceSource,
    JointFriction,
    Particle,
    PointOnPlane,
    Prismatic,
    Revolute,
    RigidBody,
    TorqueSource,
    TranslationalDamper,
    TranslationalGround,
    World,
)
from examples.control import compass_gait
from tests.pairings import each_value
from tests.similar import Units, four_bar_scene, slider_crank


class Hopper(ac.System):
    """A body on a leg that pushes, above the ground; its lengths, masses and times are so many times those of one."""

    def __init__(self, restitution: float = 0.0, length: float = 1.0, mass: float = 1.0, time: float = 1.0) -> None:
        self.force = ac.Input("N")
        self.world, self.rail, self.leg = World(gravity=(0, 0, -9.81 * length / time**2)), Prismatic("z"), Prismatic("z")
        self.body, self.foot = Particle(2.0 * mass), Particle(0.2 * mass)
        self.motor, self.ground = ForceSource(self.force), PointOnPlane(unilateral=True, restitution=restitution)
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.foot.point)
        self.connect(self.rail.frame_b, self.leg.frame_a)
        self.connect(self.leg.frame_b, self.body.point)
        self.connect(self.motor.flange, self.leg.flange)
        self.connect(self.world.frame, self.ground.frame_a)
        self.connect(self.ground.frame_b, self.foot.point)


class Ball(ac.System):
    """Above the ground, on a rail."""

    def __init__(self, restitution: float) -> None:
        self.world, self.rail, self.body = World(gravity=(0, 0, -9.81)), Prismatic("z"), Particle(0.3)
        self.ground = PointOnPlane(unilateral=True, restitution=restitution)
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.body.point)
        self.connect(self.world.frame, self.ground.frame_a)
        self.connect(self.ground.frame_b, self.body.point)


class Arm(ac.System):
    """Holds a ball at its end."""

    def __init__(self, length: float, mass: float) -> None:
        self.torque = ac.Input("N m")
        self.world, self.shoulder, self.motor = World(gravity=(0, 0, -9.81)), Revolute("y"), TorqueSource(self.torque)
        self.rod, self.reach, self.ball = RigidBody.rod(1.0, (length, 0, 0)), Fixed((length, 0, 0)), Particle(mass)
        self.connect(self.world.frame, self.shoulder.frame_a)
        self.connect(self.shoulder.frame_b, self.rod.frame)
        self.connect(self.rod.frame, self.reach.frame_a)
        self.connect(self.reach.frame_b, self.ball.point)
        self.connect(self.motor.flange, self.shoulder.flange)


class Flying(ac.System):
    """A ball in the air."""

    def __init__(self, mass: float) -> None:
        self.world, self.ball = World(gravity=(0, 0, -9.81)), Particle(mass)


class Block(ac.System):
    """On a floor, pushed along it."""

    def __init__(self) -> None:
        self.force = ac.Input("N")
        self.world, self.x, self.z = World(gravity=(0, 0, -9.81)), Prismatic("x"), Prismatic("z")
        self.body, self.motor = Particle(1.5), ForceSource(self.force)
        self.ground = PointOnPlane(unilateral=True, friction=Coulomb(0.4))
        self.connect(self.world.frame, self.x.frame_a)
        self.connect(self.x.frame_b, self.z.frame_a)
        self.connect(self.z.frame_b, self.body.point)
        self.connect(self.motor.flange, self.x.flange)
        self.connect(self.world.frame, self.ground.frame_a)
        self.connect(self.ground.frame_b, self.body.point)


def test_a_hopper_hops_and_lands_as_it_began() -> None:
    """The plan, repeated, is simulated over two hops: the model itself finds the releases and impacts where the plan has them."""
    scene = Hopper()
    model = ac.build(scene)
    stance = ac.OptimalControl(model, ac.free(0.1, 1), modes={scene.ground: "closed"})
    flight = ac.OptimalControl(model, ac.free(0.1, 1))
    for phase in (stance, flight):
        phase.bound(scene.force, -10, 200)
        phase.bound(scene.leg.q, 0.4, 0.8)
        phase.minimise(ac.integral(scene.force**2))
    stance.start({scene.rail.q: 0, scene.leg.q: ac.free(0.4, 0.8, 0.5), scene.leg.v: ac.free(-5, 5, 0)})
    flight.at(0.5, {scene.rail.q: 0.3})
    hop = ac.phases(stance, flight)
    hop.link(flight, stance)
    best = hop.solve(8)
    assert best.replay_error < 1e-8 and best.defect < 1e-8
    below = best[1].unknowns.copy()
    below[0] = -1e-30  # the foot still touches, but for rounding
    assert best[1].again(below, best[1].cost, 0, best[1].factors).replay_error < 1e-8
    period = best.duration
    push = best.run.u[0]
    assert np.max(push) < 200 * (1 + 1e-9)
    start: Any = {scene.rail.q: 0.0, scene.leg.q: best[0].x[1, 0], scene.leg.v: best[0].x[3, 0]}
    twice = model.simulate(1.9 * period, start, inputs={scene.force: repeated(best, scene.force)})
    assert [round(one.time / period, 6) for one in twice.transitions][1] == 1.0
    before, after = best[1].x[:, -1], best[0].x[:, 0]  # the foot stops, and the leg's motor does not act in no time
    speed = before[2] + before[3]
    assert after[2:] == pytest.approx([0, speed], abs=1e-7)
    assert twice.transitions[1].after[scene.leg.v] == pytest.approx(speed, abs=1e-6)


def repeated(best: Any, entry: ac.Input) -> Any:
    """Its input, over and over."""
    pieces = [one.inputs[entry] for one in best.phases]
    begins = np.concatenate([pieces[0].begins, pieces[1].begins + best[0].duration])
    coefficients = np.vstack([one.coefficients for one in pieces])
    return type(pieces[0])(begins, coefficients, 0.0, best.duration)


@pytest.mark.parametrize("restitution", [0.4, 0.9])
def test_a_ball_bounces_with_its_restitution(restitution: float) -> None:
    """From a height h to e^2 h."""
    scene = Ball(restitution)
    model = ac.build(scene)
    fall, rise = ac.OptimalControl(model, ac.free(0.01, 2)), ac.OptimalControl(model, ac.free(0.01, 2))
    fall.start({scene.rail.q: 0.8})
    fall.end({scene.rail.q: 0})
    rise.end({scene.rail.v: 0})
    bounce = ac.phases(fall, rise)
    bounce.link(fall, rise, impact={scene.ground: "bounces"})
    best = bounce.solve(2)
    assert best[1].x[0, -1] == pytest.approx(restitution**2 * 0.8, rel=1e-8)
    assert best.duration == pytest.approx((1 + restitution) * np.sqrt(2 * 0.8 / 9.81), rel=1e-8)
    assert best.replay_error < 1e-7


@pytest.mark.parametrize(("restitution", "height"), [(0.27, 0.09), (0.84, 2.1), (0.51, 67.0)])
def test_what_strikes_where_a_phase_ends_is_no_error_of_its_last_interval(restitution: float, height: float) -> None:
    """A fall is a parabola: two intervals are exact, wherever the last digits of the search put the strike, and no finer mesh is asked for."""
    scene, T = Ball(restitution), np.sqrt(height / 5)
    model = ac.build(scene)
    fall, rise = ac.OptimalControl(model, ac.free(0.1 * T, 10 * T)), ac.OptimalControl(model, ac.free(0.1 * T, 10 * T))
    fall.start({scene.rail.q: height})
    fall.end({scene.rail.q: 0})
    rise.end({scene.rail.v: 0})
    bounce = ac.phases(fall, rise)
    bounce.link(fall, rise, impact={scene.ground: "bounces"})
    best = bounce.solve(2)
    assert best.defect < 1e-7 and [one.t.size for one in best.phases] == [3, 3]
    assert best[1].x[0, -1] == pytest.approx(restitution**2 * height, rel=1e-7)


@pytest.mark.parametrize(("restitution", "height", "rate"), [(0.6, 1.0, 2.0), (0.3, 400.0, 0.1), (0.9, 1e-3, 40.0)])
def test_a_mesh_that_is_coarse_where_something_strikes_is_off_by_no_more_than_it_is(
    restitution: float, height: float, rate: float
) -> None:
    """A fall through what resists by its speed ends at -g t / c + (g / c^2) (1 - e^(-c t)): points lie about that, and it strikes beside the end, a bit before or after."""
    scene = Ball(restitution)
    scene.air, scene.wall = TranslationalDamper(0.3 * rate), TranslationalGround()
    scene.connect(scene.air.flange_a, scene.rail.flange)
    scene.connect(scene.air.flange_b, scene.wall.flange)
    model, T, off = ac.build(scene), (height / 5) ** 0.5 + height * rate / 9.81, []
    for intervals in (1, 3):
        fall, rise = (ac.OptimalControl(model, ac.free(0.1 * T, 10 * T)) for _ in range(2))
        fall.start({scene.rail.q: height})
        fall.end({scene.rail.q: 0})
        rise.end({scene.rail.v: 0})
        bounce = ac.phases(fall, rise)
        bounce.link(fall, rise, impact={scene.ground: "bounces"})
        first = bounce.solve(intervals, order=3, refinements=0)[0]
        t = first.duration
        place = height - 9.81 / rate * t - 9.81 / rate**2 * np.expm1(-rate * t)
        off.append(abs(place) / height)
        assert first.defect < 30 * off[-1]
    assert off[0] > 1e-4


def test_a_throw_over_a_wall_goes_on_in_another_scene() -> None:
    """Flight is a parabola, just over the wall, from where and how fast the hand let go; the least effort is that of textbooks' equations from several guesses."""
    hold, air = Arm(0.8, 0.5), Flying(0.5)
    swing = ac.OptimalControl(ac.build(hold), ac.free(0.2, 1.5))
    swing.start({hold.shoulder.q: -3.5})
    swing.bound(hold.torque, -40, 40)
    swing.end({hold.shoulder.q: (-2.9, -1.6)})
    swing.minimise(ac.integral(hold.torque**2))
    model, position = ac.build(air), air.ball.point.position
    up, down = ac.OptimalControl(model, ac.free(0.1, 3)), ac.OptimalControl(model, ac.free(0.1, 3))
    up.end({position[0]: 2.0, position[2]: (1.5, 5.0)})
    down.end({position[0]: 4.0, position[2]: -0.5})
    throw, hand = ac.phases(swing, up, down), hold.reach.frame_b
    throw.link(swing, up, {position: hand.position, air.ball.point.velocity: hand.velocity})
    best = throw.solve([12, 3, 3], tolerance=1e-8)
    assert best.replay_error < 1e-6
    released = best[0].run.at(best[0].t[-1])
    p, v, t = (
        released[hand.position][0],
        released[hand.velocity][0],
        (4.0 - released[hand.position][0, 0]) / released[hand.velocity][0, 0],
    )
    assert t == pytest.approx(best[1].duration + best[2].duration, abs=1e-6)
    assert p[2] + v[2] * t - 9.81 / 2 * t**2 == pytest.approx(-0.5, abs=1e-5)
    over = (2.0 - p[0]) / v[0]
    assert p[2] + v[2] * over - 9.81 / 2 * over**2 == pytest.approx(1.5, abs=1e-5)
    assert best.cost == pytest.approx(min(throw_by_hand(0.3, 0.0), throw_by_hand(1.5, 1.5)), rel=1e-5)


def throw_by_hand(time: float, back: float) -> float:
    """The least effort of the same throw near one that takes so long, and swings back so far before: a rod with a ball at its end, then parabolas over the wall and to the aim."""
    opti, n, length, inertia, weight = ca.Opti(), 40, 0.8, 0.8**2 / 3 + 0.5 * 0.8**2, 9.81 * (0.4 + 0.5 * 0.8)
    q, w, u = opti.variable(1, 2 * n + 1), opti.variable(1, 2 * n + 1), opti.variable(1, 2 * n + 1)
    T, up, down = opti.variable(), opti.variable(), opti.variable()
    rate, h = (u + weight * ca.cos(q)) / inertia, T / n  # the angle grows downwards
    for x, slope in ((q, w), (w, rate)):  # Hermite and Simpson
        a, m, b = slope[0:-1:2], slope[1::2], slope[2::2]
        opti.subject_to(x[2::2] - x[0:-1:2] == h / 6 * (a + 4 * m + b))
        opti.subject_to(x[1::2] - (x[0:-1:2] + x[2::2]) / 2 == h / 8 * (a - b))
    x, z = length * ca.cos(q[-1]), -length * ca.sin(q[-1])
    vx, vz = -length * ca.sin(q[-1]) * w[-1], -length * ca.cos(q[-1]) * w[-1]
    both = up + down
    opti.subject_to(
        [q[0] == -3.5, w[0] == 0, opti.bounded(-2.9, q[-1], -1.6), opti.bounded(-40, u, 40), opti.bounded(0.2, T, 1.5)]
    )
    opti.subject_to([opti.bounded(0.1, up, 3), opti.bounded(0.1, down, 3), x + vx * up == 2.0, x + vx * both == 4.0])
    opti.subject_to([z + vz * up - 9.81 / 2 * up**2 >= 1.5, z + vz * both - 9.81 / 2 * both**2 == -0.5])
    opti.minimize(h / 6 * (ca.sumsqr(u[0:-1:2]) + 4 * ca.sumsqr(u[1::2]) + ca.sumsqr(u[2::2])))
    s = np.linspace(0, 1, 2 * n + 1)
    opti.set_initial(q, -3.5 + 1.2 * s + back * np.sin(np.pi * s))
    for unknown, first in ((T, time), (up, 0.5), (down, 0.5)):
        opti.set_initial(unknown, first)
    opti.solver("ipopt", {"print_time": False, "error_on_fail": False}, {"print_level": 0, "sb": "yes"})
    try:
        return float(opti.solve().value(opti.f))
    except RuntimeError:
        return np.inf


def test_a_block_is_pushed_till_it_slides_and_comes_to_rest() -> None:
    """Rest, slide, stick: with friction mu m g against the slip, and below it where it sticks."""
    scene = Block()
    model = ac.build(scene)
    slide = ac.OptimalControl(model, ac.free(0.3, 2), modes={scene.ground: "slides +"})
    rest = ac.OptimalControl(model, 0.2, modes={scene.ground: "sticks"})
    slide.start({scene.x.q: 0.0, scene.z.q: 0.0, scene.x.v: 1.0})
    slide.end({scene.x.q: 1.2, scene.x.v: 0.0})
    for phase in (slide, rest):
        phase.bound(scene.force, -20, 20)
        phase.minimise(ac.integral(scene.force**2))
    best = ac.phases(slide, rest).solve(8)
    limit = 0.4 * 1.5 * 9.81
    middle = slide_by_hand(best[0].duration, limit / 1.5)
    assert best[0].inputs[scene.force](0.0) == pytest.approx(1.5 * middle(0.0), abs=1e-5)
    assert np.allclose(best[1].run[scene.ground.force_part.drag[0]], 0, atol=1e-6)  # nothing pushes, nothing holds
    with pytest.raises(OptimalControlError, match=r"ground.* sticks .*could not|could not be met: .*ground"):
        pulled = ac.OptimalControl(model, 0.2, modes={scene.ground: "sticks"}, inputs={scene.force: 1.1 * limit})
        pulled.start({scene.x.q: 0.0, scene.z.q: 0.0})
        pulled.solve(4)


def slide_by_hand(T: float, friction: float) -> Any:
    """The force per mass that moves 1.2 m from 1 m/s to rest in T, least in its square, less friction."""
    # x'' = a + b t with v(T) = 0, x(T) = 1.2
    a, b = np.linalg.solve([[T, T**2 / 2], [T**2 / 2, T**3 / 6]], [-1.0, 1.2 - T])
    return lambda t: a + b * t + friction


def standing(scene: Hopper, model: ac.Model, start: Any) -> ac.OptimalControl:
    """On its foot, all the time."""
    ocp = ac.OptimalControl(model, 1.0, modes={scene.ground: "closed"})
    ocp.start({scene.leg.q: 0.5, **start})
    return ocp


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda s, m: ac.phases(), "give problems"),
        (lambda s, m: ac.OptimalControl(m, 1.0, modes={s.leg: "closed"}), "has no laws by which it opens"),
        (lambda s, m: ac.OptimalControl(m, 1.0, modes={s.ground: "shut"}), "cannot be 'shut'"),
        (
            lambda s, m: ac.phases(ac.OptimalControl(m, 1.0)).link(ac.OptimalControl(m, 1.0), ac.OptimalControl(m, 1.0)),
            "two phases that follow",
        ),
        (
            lambda s, m: ac.phases(ac.OptimalControl(m, 1.0), ac.OptimalControl(ac.build(Flying(1.0)), 1.0)).solve(2),
            "different models",
        ),
        (lambda s, m: standing(s, m, {s.rail.q: 1e-4}).solve(2), r"rail.q is to be 0.0001 at the start, .* it is 0"),
        (lambda s, m: standing(s, m, {s.rail.v: -2.0}).solve(2), r"rail.v is to be -2 at the start, .* closed .* it is 0"),
        (
            lambda s, m: ac.phases(ac.OptimalControl(m, 1.0), ac.OptimalControl(m, 1.0)).solve([1, 2, 3]),
            "3 numbers of intervals for 2 phases",
        ),
    ],
)
def test_phases_that_make_no_sense_are_refused_in_words(ask: Any, words: str) -> None:
    scene = Hopper()
    with pytest.raises(OptionError, match=words):
        ask(scene, ac.build(scene))


def test_a_phase_that_begins_where_the_one_before_cannot_end_is_refused() -> None:
    """All states of the second are given, as is where the first ends: nothing is left to find, and the two do not meet."""
    scene = Block()
    model = ac.build(scene)
    first, second = (ac.OptimalControl(model, 1.0, modes={scene.ground: "slides +"}) for _ in range(2))
    first.start({scene.x.q: 0.0, scene.z.q: 0.0, scene.x.v: 1.0})
    first.end({scene.x.q: 1.2, scene.x.v: 0.5})
    second.start({scene.x.q: 3.0, scene.z.q: 0.0, scene.x.v: 0.5})
    for phase in (first, second):
        phase.minimise(ac.integral(scene.force**2))
    with pytest.raises(OptimalControlError, match=r"x.q goes on: it is 1.2 where phase 1 ends, and 3 where phase 2 begins"):
        ac.phases(first, second).solve(3)


class Barge(ac.System):
    """What is aboard is a parameter, driven by a force."""

    def __init__(self) -> None:
        self.force, self.mass = ac.Input("N"), ac.Parameter(2.0, "kg")
        self.world, self.x, self.body, self.motor = World(), Prismatic("x"), Particle(self.mass), ForceSource(self.force)
        self.connect(self.world.frame, self.x.frame_a)
        self.connect(self.x.frame_b, self.body.point)
        self.connect(self.motor.flange, self.x.flange)


@pytest.mark.parametrize(("force", "masses"), [(2.0, (3.0, 0.25)), (5e-3, (1e-3, 4.0))])
def test_phases_may_have_other_parameters_and_are_replayed_by_them(force: float, masses: tuple[float, float]) -> None:
    """One metre with all aboard, then two with the rest, from rest to rest in least time."""
    scene = Barge()
    model = ac.build(scene)
    loaded, light = (ac.OptimalControl(model, ac.free(0.1, 1000), parameters={scene.mass: mass}) for mass in masses)
    loaded.start({scene.x.q: 0})
    loaded.end({scene.x.q: 1.0})
    light.end({scene.x.q: 3.0, scene.x.v: 0})
    for phase in (loaded, light):
        phase.bound(scene.force, -force, force)
        phase.minimise(phase.duration)
    best = ac.phases(loaded, light).solve(6)
    a, b = force / masses[0], force / masses[1]
    # speeds: v after the first metre, where the switch may be in it, w where the force turns
    if 2 * a <= 4 * b:
        v, w = np.sqrt(2 * a), np.sqrt((2 * a + 4 * b) / 2)
        exact = v / a + (w - v) / b + w / b
    else:
        v = np.sqrt(4 * b)
        w = np.sqrt((2 * a + v**2) / 2)
        exact = w / a + (w - v) / a + v / b
    assert best.duration == pytest.approx(exact, rel=1e-6)
    assert best.replay_error < 1e-6
    with pytest.raises(OptionError, match="different models or parameters"):
        _ = best.run


def test_a_parameter_that_phases_find_has_one_value() -> None:
    """The effort is A m^2, and 3 / m^2 is paid: 2 sqrt(3 A)."""
    scene = Barge()
    model = ac.build(scene)

    def asked(mass: float | None) -> tuple[ac.OptimalControl, ac.OptimalControl]:
        given = None if mass is None else {scene.mass: mass}
        first, second = (ac.OptimalControl(model, time, parameters=given) for time in (1.0, 2.0))
        first.start({scene.x.q: 0})
        first.end({scene.x.q: 1.0})
        second.end({scene.x.q: 2.0, scene.x.v: 0})
        first.minimise(ac.integral(scene.force**2))
        second.minimise(ac.integral(scene.force**2) + 3 * ac.at_end(scene.mass**-2))
        return first, second

    first, second = asked(None)
    first.optimise(scene.mass, 0.5, 5)
    with pytest.raises(OptionError, match="mass is found in phase 1, and phase 2 of the same model says nothing of it"):
        ac.phases(first, second).solve(4)
    second.optimise(scene.mass, 0.4, 6)
    best = ac.phases(first, second).solve(4)
    A = ac.phases(*asked(1.0)).solve(4).cost - 3
    # to x = 1 with the speed v: 4 (3 - 3 v + v^2); from there to rest: 4 (3 - 3 (2 v) + (2 v)^2) / 2^3; together least at v = 1.25
    assert pytest.approx(4.125, rel=1e-9) == A
    assert best.cost == pytest.approx(2 * np.sqrt(3 * A), rel=1e-9)
    assert best[0].parameters == pytest.approx(best[1].parameters)
    assert best.replay_error < 1e-9


def test_what_a_mode_or_a_load_of_a_joint_does_not_go_with_is_said_by_name() -> None:
    """A place behind a stop that is not touched; friction by how hard a joint is loaded."""
    stopped, rubbed = Barge(), Barge()
    stopped.stop = EndStop(stopped.x.flange, upper=0.8)
    ocp = ac.OptimalControl(ac.build(stopped), 1.0)
    ocp.start({stopped.x.q: 0})
    ocp.end({stopped.x.q: 1.0})
    with pytest.raises(OptionError, match=r"x.q is to be 1 at the end, but in its mode stop.* stays apart all the time"):
        ocp.solve(3)
    rubbed.friction = JointFriction(rubbed.x, Coulomb(0.1))
    with pytest.raises(OptionError, match=r"friction.* rubs by how hard its joint is loaded"):
        ac.OptimalControl(ac.build(rubbed), 1.0, modes={rubbed.friction: "slides +"})


def test_what_swaps_begins_where_the_other_ended() -> None:
    """Also where it is told at the end, and all is free at the start."""
    scene = ac.System()
    scene.world = World()
    for name in "ab":
        one = ac.System()
        one.force, one.rail, one.body = ac.Input("N"), Prismatic("x"), Particle(1.5)
        one.motor = ForceSource(one.force)
        one.connect(one.rail.frame_b, one.body.point)
        one.connect(one.motor.flange, one.rail.flange)
        setattr(scene, name, one)
        scene.connect(scene.world.frame, one.rail.frame_a)
    a, b = scene.a, scene.b
    step = ac.OptimalControl(ac.build(scene), 0.8)
    step.start({a.rail.q: ac.free(-1, 2, 0.2), b.rail.q: ac.free(-1, 2, 0.4), a.rail.v: ac.free(-5, 5), b.rail.v: ac.free(-5, 5)})
    step.end({b.rail.q: 1.0})
    step.at(0.5, {a.rail.q: 0.3})
    step.minimise(ac.integral(a.force**2 + b.force**2))
    over = ac.phases(step)
    swapped = {a.rail.q: b.rail.q, b.rail.q: a.rail.q, a.rail.v: b.rail.v, b.rail.v: a.rail.v}
    over.link(step, step, swapped)
    x = over.solve(4)[0].x
    assert x[:, 0] == pytest.approx(x[[1, 0, 3, 2], -1], abs=1e-8)


def on_a_rod(length: float, mass: float, time: float) -> ac.System:
    """A body on a vertical rail, a rod below it, its tip on the ground: all lengths, masses and times are so many times those of one."""
    scene = ac.System()
    scene.torque = ac.Input("N m")
    scene.world, scene.rail, scene.hinge = World(gravity=(0, 0, -9.81 * length / time**2)), Prismatic("z"), Revolute("y")
    scene.body, scene.rod = RigidBody.ball(2.0 * mass, 0.09 * length), RigidBody.rod(mass, (0, 0, -0.9 * length))
    scene.motor, scene.ground = TorqueSource(scene.torque), PointOnPlane(unilateral=True)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.body.frame)
    scene.connect(scene.rail.frame_b, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.motor.flange, scene.hinge.flange)
    scene.connect(scene.world.frame, scene.ground.frame_a)
    scene.connect(scene.ground.frame_b, scene.rod.tip)
    return scene


def rod_that_swings_over(length: float, mass: float, time: float) -> ac.Phases:
    """To the other side, over and over."""
    scene = on_a_rod(length, mass, time)
    over = ac.OptimalControl(ac.build(scene), 0.7 * time, modes={scene.ground: "closed"})
    over.start({scene.hinge.q: ac.free(0.4, 0.6, 0.48), scene.hinge.v: ac.free()})
    over.minimise(ac.integral(scene.torque**2))
    swings, q, v = ac.phases(over), scene.hinge.q, scene.hinge.v
    swings.link(over, over, {scene.rail.q: scene.rail.q, scene.rail.v: scene.rail.v, q: -q, v: -v})
    return swings


def hopper(length: float, mass: float, time: float) -> ac.Phases:
    """Over and over, likewise."""
    scene, force = Hopper(0.0, length, mass, time), mass * length / time**2
    model = ac.build(scene)
    stance = ac.OptimalControl(model, ac.free(0.1 * time, time), modes={scene.ground: "closed"})
    flight = ac.OptimalControl(model, ac.free(0.1 * time, time))
    for phase in (stance, flight):
        phase.bound(scene.force, -10 * force, 200 * force)
        phase.bound(scene.leg.q, 0.4 * length, 0.8 * length)
        phase.minimise(ac.integral(scene.force**2))
    fast = 5 * length / time
    stance.start({scene.rail.q: 0, scene.leg.q: ac.free(0.4 * length, 0.8 * length), scene.leg.v: ac.free(-fast, fast)})
    flight.at(0.5, {scene.rail.q: 0.3 * length})
    hop = ac.phases(stance, flight)
    hop.link(flight, stance)
    return hop


@each_value(
    (("length", "mass", "time"), [(4.0**-5, 4.0**-4, 2.0**-5), (256.0, 64.0, 4.0)]),
    (("problem", "intervals"), [(rod_that_swings_over, 6), (hopper, 5)]),
)
def test_similar_scenes_are_searched_alike(problem: Any, intervals: int, length: float, mass: float, time: float) -> None:
    """In metres, millimetres and kilometres, in grams and tons, slow and fast: powers of two change no digit on the way."""
    one, other = (problem(*sizes).solve(intervals, refinements=0) for sizes in ((1.0, 1.0, 1.0), (length, mass, time)))
    unit = mass * length ** (2 if problem is rod_that_swings_over else 1) / time**2  # of what is driven
    assert other.iterations == one.iterations
    assert other.cost == pytest.approx(one.cost * unit**2 * time, rel=1e-12)
    for mine, its in zip(one.phases, other.phases, strict=True):
        assert its.defects == pytest.approx(mine.defects, rel=1e-3, abs=1e-9)


def turning_crank(kind: str, of: Units) -> tuple[Any, ac.OptimalControl]:
    """The crank of a four-bar, or of a slider-crank, and its turn over and over at least effort."""
    scene = four_bar_scene(of) if kind == "four-bar" else slider_crank(of).scene
    scene.torque = ac.Input("N m")
    scene.motor = TorqueSource(scene.torque)
    scene.connect(scene.motor.flange, scene.a.flange)
    turn = ac.OptimalControl(ac.build(scene), of.time)
    turn.start({scene.a.q: 0.3, scene.a.v: ac.free(of.rate, 40 * of.rate, 6 * of.rate)})
    turn.periodic(turns={scene.a.q: 1})
    turn.minimise(ac.integral((scene.torque + 3 * of.torque) ** 2))
    return scene, turn


@pytest.mark.parametrize("kind", ["four-bar", "slider-crank"])
def test_similar_loops_are_searched_and_estimated_alike(kind: str) -> None:
    """In metres, millimetres and kilometres and any other unit: as many iterations, the same optimum to rounding; as many motions, the same values of a recording."""
    found: list[tuple[Any, ...]] = []
    for of in (Units(), Units(1e-3), Units(1e3, 20.0, 0.03)):
        scene, turn = turning_crank(kind, of)
        best = turn.solve(8, refinements=0, guesses=0)
        at, start = np.linspace(0.05, 0.4, 8), {scene.a.q: 0.3, scene.a.v: 5 * of.rate}
        run = turn.model.simulate(0.4 * of.time, start, inputs={scene.torque: 2.0 * of.torque}, rtol=1e-10)
        data = run.at(at * of.time)[scene.c.q] + 0.01 * np.sin(40 * at)
        told = ac.estimate(turn.model, {scene.c.q: (at * of.time, data, 0.01)}, [scene.torque, scene.a.v], start)
        values, units = (told.values, [told.standard_error(key) for key in told.unknowns]), np.array([of.torque, of.rate])
        found.append(
            (
                best.iterations,
                told.evaluations,
                best.cost / of.torque**2 / of.time,
                best.defects,
                *(np.divide(one, units) for one in values),
            )
        )
    for iterations, evaluations, cost, defects, values, errors in found[1:]:
        assert (iterations, evaluations) == found[0][:2]
        assert cost == pytest.approx(found[0][2], rel=1e-12) and defects == pytest.approx(found[0][3], rel=1e-6)
        assert values == pytest.approx(found[0][4], rel=1e-7) and errors == pytest.approx(found[0][5], rel=1e-6)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_how_high_who_stands_begins_follows_from_where_it_stands(size: float) -> None:
    """A body on a rod that leans: its height is length cos(lean), said or not; the sketch has it below the ground."""
    scene = on_a_rod(size, 1.0, 1.0)
    model, found = ac.build(scene), list[float]()
    for said in ({}, {scene.rail.q: 0.9 * size * np.cos(0.5)}):
        over = ac.OptimalControl(model, 0.7, modes={scene.ground: "closed"})
        over.start({scene.hinge.q: 0.5, scene.hinge.v: -1.0, **said})
        over.end({scene.hinge.q: -0.5, scene.hinge.v: -1.0})
        over.minimise(ac.integral(scene.torque**2))
        best = over.solve(4, refinements=0, guesses=0)
        assert best.x[:2, 0] == pytest.approx([0.9 * size * np.cos(0.5), 0.5], rel=1e-12)
        found.append(best.cost)
    assert found[0] == pytest.approx(found[1], rel=1e-9)


@pytest.mark.parametrize(("slope", "time", "far"), [(0.0, 0.55, 0.45), (0.08, 0.55, 0.45), (-0.05, 0.7, 0.35), (0.0, 0.8, 0.45)])
def test_gaits_on_slopes_are_found_soon_and_walk_as_planned(slope: float, time: float, far: float) -> None:
    """A guess of a step ends where the next one begins, with legs swapped; and the leg that stands leans one way and then the other below the hip, whose height goes with both: it does not leap
    between them, so what holds it gives the height.
    """
    walker = compass_gait.Walker((9.81 * np.sin(slope), 0, -9.81 * np.cos(slope)))
    gait = compass_gait.steps(walker, time, far)
    made: list[Any] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(attempts, "whole", lambda *given: made.append(whole(*given)) or made[-1])
        best = gait.solve(14, refinements=0)
    assert best[0].iterations < 100 and best.defect < 1e-4
    assert best.run[walker.left.place][0] == pytest.approx([0, 0, 0], abs=1e-9)
    program, labels = made[0].program, made[0].labels
    missed = np.array(program.values(program.guess)[1]).ravel() - program.limits[0]
    places = [
        abs(missed[row])
        for row, (name, _, _) in enumerate(labels)
        if name in {f"{joint}.q goes on" for joint in ("lean", "hip", "up")}
    ]
    assert len(places) >= 2 and max(places) < 0.1


@pytest.mark.parametrize(("length", "lean", "time"), [(0.9, 0.4, 0.7), (0.02, 0.5, 0.1)])
def test_rows_that_follow_where_phases_meet_are_not_asked_twice(
    length: float, lean: float, time: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rod whose tip stays on the ground swings over and mirrored again: that its tip is there where it begins anew follows, wherever the search begins; and no row depends on others."""
    scene = ac.System()
    scene.torque = ac.Input("N m")
    scene.world, scene.rail, scene.hinge = World(gravity=(0, 0, -9.81)), Prismatic("z"), Revolute("y")
    scene.body, scene.rod = RigidBody.ball(2.0, 0.1 * length), RigidBody.rod(1.0, (0, 0, -length))
    scene.motor, scene.ground = TorqueSource(scene.torque), PointOnPlane(unilateral=True)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.body.frame)
    scene.connect(scene.rail.frame_b, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.motor.flange, scene.hinge.flange)
    scene.connect(scene.world.frame, scene.ground.frame_a)
    scene.connect(scene.ground.frame_b, scene.rod.tip)
    over = ac.OptimalControl(ac.build(scene), time, modes={scene.ground: "closed"})
    over.start({scene.hinge.q: ac.free(*sorted((lean, 1.5 * lean)), 1.2 * lean), scene.hinge.v: ac.free()})
    over.minimise(ac.integral(scene.torque**2))
    swings = ac.phases(over)
    q, v = scene.hinge.q, scene.hinge.v
    swings.link(over, over, {scene.rail.q: scene.rail.q, scene.rail.v: scene.rail.v, q: -q, v: -v})
    made: list[Any] = []
    monkeypatch.setattr(attempts, "whole", lambda *given: made.append(whole(*given)) or made[-1])
    best = swings.solve(12, refinements=0)
    program, names = made[0].program, [name for name, _, _ in made[0].labels]
    assert sum(name.endswith("goes on") for name in names) == 2
    slopes = np.array(program.derivatives["jac_g"](best[0].unknowns, [])[1])[program.limits[0] == program.limits[1]]
    assert np.linalg.svd(slopes, compute_uv=False)[-1] > 1e-9
    assert best[0].x[1, -1] == pytest.approx(-best[0].x[1, 0], abs=1e-9) and best.defect < 1e-3
