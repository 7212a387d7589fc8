"""Derivatives of motions through impacts, stops and slips: against closed forms, and differences of motions."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal.errors import SingularWarning
from acausal.language.mode_laws import ModeLaw
from acausal.parts.force import AbstractForce, Action
from acausal.parts.placement import Placement
from acausal.parts.pose import symbolic
from components import (
    Brake,
    Contact,
    Coulomb,
    Force,
    Hard,
    Inertia,
    Particle,
    Plane,
    PointOnPlane,
    PrescribedMotion,
    Prismatic,
    Revolute,
    RigidBody,
    Sphere,
    TorqueSource,
    World,
)
from components.translational import ForceSource, SlidingMass, TranslationalGround, TranslationalSpring
from tests.pairings import each_value
from tests.rough import Floor, Rub

EXACT = {"rtol": 1e-12}


class Ball(ac.System):
    """Falls, and bounces."""

    def __init__(self, restitution: float, mass: float = 2.0, gravity: float = 9.81) -> None:
        self.restitution, self.weight, self.height = (
            ac.Parameter(restitution),
            ac.Parameter(mass * gravity, "N"),
            ac.Parameter(0.0, "m"),
        )
        self.mass, self.floor, self.pull = SlidingMass(mass), Floor(self.restitution, self.height), ForceSource(-self.weight)
        self.connect(self.mass.flange_a, self.floor.flange)
        self.connect(self.mass.flange_b, self.pull.flange)


class Block(ac.System):
    """Slides on a belt, on a spring."""

    def __init__(self, sliding: float, holding: float, belt: float = 0.0, force: float = 0.0, stiffness: float = 0.0) -> None:
        self.sliding, self.holding = ac.Parameter(sliding, "N"), ac.Parameter(holding, "N")
        self.speed, self.force, self.stiffness = (
            ac.Parameter(belt, "m/s"),
            ac.Parameter(force, "N"),
            ac.Parameter(stiffness, "N/m"),
        )
        self.mass, self.rub, self.push = SlidingMass(1.0), Rub(self.sliding, self.holding, self.speed), ForceSource(self.force)
        self.connect(self.mass.flange_a, self.rub.flange, self.push.flange)
        self.wall, self.spring = TranslationalGround(), TranslationalSpring(self.stiffness, 0.0)
        self.connect(self.wall.flange, self.spring.flange_a)
        self.connect(self.spring.flange_b, self.mass.flange_b)


@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.4])
@pytest.mark.parametrize("size", [1.0, 1e-6])
def test_bounces_depend_on_restitution_start_gravity_and_floor_as_parabolas_do(restitution: float, size: float) -> None:
    scene = Ball(restitution, mass=2.0, gravity=9.81 * size)
    fall = np.sqrt(2 / 9.81)
    t = fall * (1 + 2 * restitution + restitution**2)
    wrt = [scene.restitution, scene.mass.s, scene.weight, scene.height]
    found = ac.build(scene).sensitivities([0.0, 0.3 * fall, t], wrt, {scene.mass.s: size, scene.mass.v: 0.0}, **EXACT)

    def motion(e: complex, h: complex, g: complex, floor: complex) -> np.ndarray:
        fall = np.sqrt(2 * (h - floor) / g)
        left, speed = t - fall * (1 + 2 * e), g * fall * e**2
        return np.array([floor + speed * left - g / 2 * left**2, speed - g * left])

    at = np.array([restitution, size, 9.81 * size, 0.0])
    steps = 1e-30 * np.array([1, size, size, size])
    exact = np.column_stack([motion(*(at + 1j * step)).imag / step.sum() for step in np.diag(steps)]) / [1, 1, 2.0, 1]
    scale = np.array([[size, 1, 1, 1]])
    assert found.S[-1] / scale == pytest.approx(exact / scale, rel=1e-9, abs=1e-9)


def test_where_a_block_stops_depends_on_friction_and_its_start() -> None:
    scene = Block(2.0, 2.0, force=-0.5)
    wrt = [scene.sliding, scene.mass.v, scene.mass.s, scene.holding, scene.force]
    found = ac.build(scene).sensitivities([0.0, 2.0], wrt, {scene.mass.s: 0.1, scene.mass.v: 3.0}, **EXACT)
    # s = s0 + v0^2 / (2 (f - F)), and no speed
    assert found.x[:, -1] == pytest.approx([0.1 + 9 / 5, 0.0], abs=1e-12)
    assert found.S[-1, 0] == pytest.approx([-9 / (2 * 2.5**2), 3 / 2.5, 1.0, 0.0, 9 / (2 * 2.5**2)], rel=1e-9, abs=1e-10)
    assert found.S[-1, 1] == pytest.approx(0.0, abs=1e-10)
    assert found[scene.rub.drag][-1] == pytest.approx([0, 0, 0, 0, -1.0], abs=1e-10)


def test_block_turns_back_where_friction_does_not_hold_it() -> None:
    scene = Block(2.0, 2.0, force=-3.0)
    found = ac.build(scene).sensitivities(
        [0.0, 2.0], [scene.sliding, scene.mass.v], {scene.mass.s: 0.0, scene.mass.v: 3.0}, **EXACT
    )
    stop = 3 / 5
    # s = v0^2 / (2 (f + 3)) - (3 - f) (2 - v0 / (f + 3))^2 / 2
    left = 2 - stop
    by_friction = -9 / 50 + left**2 / 2 - 1 * left * 3 / 25
    assert found.S[-1, 0] == pytest.approx([by_friction, 3 / 5 + left / 5], rel=1e-9)


@pytest.mark.parametrize("seed", [3, 8, 16, 18, 24, 26, 32])
def test_block_on_a_rough_incline_turns_back_as_its_closed_form_does_however_loosely_it_is_followed(seed: int) -> None:
    # what is across the slip is led back to zero faster the smaller that is: a hundred million times at first, a moment later hardly
    draw = np.random.default_rng(seed)
    slope = draw.uniform(0.2, 1.2)
    friction = draw.uniform(0.5, 0.97) * np.tan(slope)
    turned = np.linalg.qr(draw.normal(size=(3, 3)))[0]
    turned *= np.linalg.det(turned)
    scene = ac.System()
    scene.friction = ac.Parameter(friction)
    scene.world = World(tuple(turned @ [-9.81 * np.sin(slope), 0, -9.81 * np.cos(slope)]))
    scene.block, scene.foot = Particle(2.0), PointOnPlane(unilateral=True, friction=Coulomb(scene.friction))
    scene.connect(scene.world.at((0, 0, 0), rotation=turned), scene.foot.frame_a)
    scene.connect(scene.foot.frame_b, scene.block.point)
    place, press = scene.block.point, 9.81 * np.cos(slope)
    start = {place.position: (0, 0, 0), place.velocity: 3.0 * turned[:, 0]}
    up, down = press * (np.tan(slope) + friction), press * (np.tan(slope) - friction)
    stop = 3.0 / up
    # x = v0^2 / (2 up) - down (t - v0 / up)^2 / 2
    exact = -turned[:, 0] * press * down * stop**2 / up
    model = ac.build(scene)
    for rtol in (1e-4, 1e-5):
        found = model.sensitivities([0.0, 2 * stop], [scene.friction], start, rtol=rtol)[place.position][-1]
        assert np.ravel(found) == pytest.approx(exact, abs=rtol * abs(exact).max())


def test_block_on_a_belt_sticks_and_slips_later_as_its_parameters_say() -> None:
    scene = Block(2.0, 3.0, belt=0.5, stiffness=4.0)
    wrt = [scene.sliding, scene.holding, scene.stiffness]
    t = 9.0
    found = ac.build(scene).sensitivities([0.0, t], wrt, {scene.mass.s: 0.6, scene.mass.v: 0.5}, **EXACT)

    def motion(k: complex, h: complex, c: complex) -> np.ndarray:
        """Sticks at first where it is; slips from h / c with speed v, around k / c, until its speed is v again."""
        v = 0.5
        w = np.sqrt(c)
        begin, x = (h / c - 0.6) / v, h / c
        while True:
            away = (h - k) / c
            slip = 2 * (np.pi - np.arctan(w * away / v)) / w
            if (begin + slip).real > t:
                s = t - begin
                return np.array(
                    [k / c + away * np.cos(w * s) + v / w * np.sin(w * s), -w * away * np.sin(w * s) + v * np.cos(w * s)]
                )
            x = k / c - away
            begin = begin + slip
            rest = (h / c - x) / v
            if (begin + rest).real > t:
                return np.array([x + v * (t - begin), v])
            begin = begin + rest

    at = np.array([2.0, 3.0, 4.0], dtype=complex)
    assert found.x[:, -1] == pytest.approx(motion(*at).real, rel=1e-10)
    exact = np.column_stack([motion(*(at + 1e-30j * step)).imag / 1e-30 for step in np.eye(3)])
    assert found.S[-1] == pytest.approx(exact, rel=1e-9, abs=1e-9)


class Touch(AbstractForce):
    """A point above the plane z = height, with friction in its two directions."""

    point = ac.Point.port()

    def __init__(self, friction: ac.Scalar, restitution: ac.Scalar = 0.0, height: ac.Scalar = 0.0) -> None:
        self.push, self.rub = ac.Reaction("N"), (ac.Reaction("N"), ac.Reaction("N"))
        self.friction, self.restitution, self.height = friction, restitution, height

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        force = ca.vertcat(self.rub[0].sx, self.rub[1].sx, self.push.sx)
        return (Action(self.point, symbolic(placement.pose(self.point).rotation).T @ force, ca.SX.zeros(3)),)

    def potential_energy(self, placement: Placement) -> ca.SX:
        return ca.SX(0)

    def power_loss(self, placement: Placement) -> ca.SX:
        return ca.SX(0)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.OneSided(self.push, self.point.position[2] - self.height, self.restitution)
        yield ac.DryFriction(self.rub, self.point.velocity[:2], self.friction * self.push, self.friction * self.push)


class Tether(AbstractForce):
    """A string from the origin to a point, no longer than its length."""

    point = ac.Point.port()

    def __init__(self, length: ac.Scalar) -> None:
        self.pull, self.length = ac.Reaction("N"), length

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        pose = placement.pose(self.point)
        place = symbolic(pose.position)
        force = -self.pull.sx * place / ca.norm_2(place)
        return (Action(self.point, symbolic(pose.rotation).T @ force, ca.SX.zeros(3)),)

    def potential_energy(self, placement: Placement) -> ca.SX:
        return ca.SX(0)

    def power_loss(self, placement: Placement) -> ca.SX:
        return ca.SX(0)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.OneSided(self.pull, self.length - ac.norm(self.point.position), 0.0)


class FourBar(ac.System):
    """Falls on a corner of its coupler."""

    def __init__(self) -> None:
        self.floor = -0.62
        self.friction, self.restitution = ac.Parameter(0.3), ac.Parameter(0.5)
        self.length, self.height = ac.Parameter(1.2, "m"), ac.Parameter(self.floor, "m")
        self.world = World()
        self.crank, self.coupler, self.rocker = (
            RigidBody.rod(1.0, (0.4, 0, 0)),
            RigidBody(2.0, (0.01, 0.24, 0.24), (0.6, 0, 0)),
            RigidBody.rod(1.5, (0.8, 0, 0)),
        )
        self.a, self.b, self.c, self.d = (Revolute("y") for _ in range(4))
        self.touch = Touch(self.friction, self.restitution, self.height)
        self.connect(self.world.frame, self.a.frame_a)
        self.connect(self.a.frame_b, self.crank.frame)
        self.connect(self.crank.tip, self.b.frame_a)
        self.connect(self.b.frame_b, self.coupler.frame)
        self.connect(self.coupler.at((self.length, 0, 0)), self.c.frame_a)
        self.connect(self.c.frame_b, self.rocker.frame)
        self.connect(self.rocker.tip, self.d.frame_a)
        self.connect(self.d.frame_b, self.world.at((1.0, 0, 0)))
        self.connect(self.coupler.at((0.5, 0, -0.1)), self.touch.point)


def differences(
    model: ac.Model,
    end: float,
    start: dict[ac.Expression, float],
    wanted: list[ac.Expression],
    values: dict[ac.Expression, float],
    step: float,
) -> np.ndarray:
    """(outputs, parameters or start values): of motions to either side, to the fourth order."""
    columns = []
    for key, value in values.items():
        found = []
        for k in (-2, -1, 1, 2):
            moved = value + k * step
            parameters = {key: moved} if isinstance(key, ac.Parameter) else {}
            run = model.simulate(end, start if parameters else start | {key: moved}, parameters=parameters, rtol=1e-13)
            found.append(np.concatenate([np.atleast_1d(run[one][-1]) for one in wanted]))
        columns.append((found[0] - 8 * found[1] + 8 * found[2] - found[3]) / (12 * step))
    return np.column_stack(columns)


@pytest.mark.parametrize(("unit", "inertia"), [(1.0, 1.3), (1e-3, 0.7)])
def test_what_is_held_at_the_start_has_derivatives_that_are_nothing_but_rounding(unit: float, inertia: float) -> None:
    """A shaft stands still while its brake holds the torque that grows, each of which is derived: that its rates cancel to rounding makes no step shorter."""
    scene, grows, holds, t = ac.System(), 1.1 / unit, 0.9, 2 * unit
    scene.inertia, scene.rate = ac.Parameter(inertia * unit**2, "kg*m^2"), ac.Parameter(grows, "N*m")
    scene.capacity = ac.Parameter(holds, "N*m")
    scene.shaft, scene.drive = Inertia(scene.inertia), TorqueSource(scene.rate * ac.time)
    scene.brake = Brake(scene.shaft.flange_b, scene.capacity)
    scene.connect(scene.drive.flange, scene.shaft.flange_a)
    found = ac.build(scene).sensitivities([0.0, t], [scene.inertia, scene.rate, scene.capacity], **EXACT)
    left, J = t - holds / grows, inertia * unit**2  # phi = a (t - c / a)^3 / (6 J)
    by_start = grows * left**2 / (2 * J)
    exact = [-grows * left**3 / (6 * J * J), left**3 / (6 * J) + by_start * holds / grows**2, -by_start / grows]
    assert found[scene.shaft.phi][-1] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("velocity", [(1.0, 0.0), (1.0, 0.8), (-0.3, 2.0)])
def test_slide_in_a_plane_stops_where_friction_and_its_start_say(velocity: tuple[float, float]) -> None:
    scene = ac.System()
    scene.friction = ac.Parameter(0.5)
    scene.world, scene.particle, scene.touch = World(gravity=(0, 0, -9.81)), Particle(0.7), Touch(scene.friction)
    scene.connect(scene.particle.point, scene.touch.point)
    start = {scene.particle.point.position: np.zeros(3), scene.particle.point.velocity: np.array([*velocity, 0.0])}
    wrt = [scene.friction, scene.particle.point.velocity]
    found = ac.build(scene).sensitivities([0.0, 2.0], wrt, start, **EXACT)
    # x = v |v| / (2 mu g)
    v, speed, slow = np.array(velocity), np.hypot(*velocity), 2 * 0.5 * 9.81
    by_start = (np.outer(v, v) / speed + speed * np.eye(2)) / slow
    assert found[scene.particle.point.position][-1, :2, :3] == pytest.approx(
        np.column_stack([-v * speed / (slow * 0.5), by_start]), rel=1e-9, abs=1e-9
    )
    assert found[scene.particle.point.velocity][-1, :2] == pytest.approx(0.0, abs=1e-9)


SHARE, SWAY, OFTEN, LATE = 0.4, 0.3, 3.0, 1.0


def ball_on_a_shaken_table(mu: complex, turns: float, radius: float, start: np.ndarray) -> np.ndarray:
    """Places and velocities of its centre at LATE (4,); start: these and the angular velocity (7,), mu with an infinitesimal part that is imaginary.

    Slip by the logarithm of its size and its direction, in a time that goes as fast as it is large: it ends after infinitely much of that.
    """

    def table(t: complex, r: np.ndarray, v: np.ndarray) -> np.ndarray:
        rate, grows = turns + SWAY * OFTEN * np.cos(OFTEN * t), -SWAY * OFTEN**2 * np.sin(OFTEN * t)
        return np.array([-rate * v[1] - grows * r[1], rate * v[0] + grows * r[0]])

    def slides(_: float, y: np.ndarray) -> np.ndarray:
        t, log_size, angle, r, v = y[0], y[1], y[2], y[3:5], y[5:]
        size, along, moved = np.exp(log_size), np.array([np.cos(angle), np.sin(angle)]), table(t, r, v)
        slower = -(1 + 1 / SHARE) * mu * 9.81 - along @ moved
        return np.array([size, slower, along[1] * moved[0] - along[0] * moved[1], *(size * v), *(-mu * 9.81 * size * along)])

    def rolls(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([*y[2:], *(table(t, y[:2], y[2:]) / (1 + 1 / SHARE))])

    x, y, u, v, w_x, w_y, _ = start
    rate = turns + SWAY * OFTEN
    slip = np.array([u - radius * w_y + rate * y, v + radius * w_x - rate * x])
    first = np.array([0, np.log(np.linalg.norm(slip)), np.arctan2(slip[1], slip[0]), x, y, u, v], dtype=complex)
    exact = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}
    t, _, _, *at = solve_ivp(slides, (0, 60 / mu.real), first, **exact).y[:, -1]
    at = np.array(at) - 1j * t.imag * rolls(t.real, np.array(at))
    return solve_ivp(rolls, (t.real, LATE), at, **exact).y[:, -1]


@pytest.mark.parametrize(
    ("mu", "turns", "radius", "start"),
    [
        (0.31, 1.7, 0.1, (0.01, -0.02, -0.61, -2.1, -1.19, -3.27, -4.07)),
        (0.6, 1.4, 0.34, (0.42, 0.42, -1.21, -0.14, 4.05, -1.19, 0.57)),
    ],
)
def test_ball_whose_slip_turns_until_it_ends_depends_on_its_friction_as_a_complex_step_says(
    mu: float, turns: float, radius: float, start: tuple[float, ...]
) -> None:
    """On a turntable that sways. What is across the slip falls more slowly than that: how it changes is lost in rounding before the slip has ended."""
    scene, at = ac.System(), np.array(start)
    scene.friction = ac.Parameter(mu)
    scene.world = World(gravity=(0, 0, -9.81))
    scene.table = PrescribedMotion(angle=turns * ac.time + SWAY * np.sin(OFTEN * ac.time))
    scene.ball = RigidBody(1.0, SHARE * radius**2 * np.eye(3))
    scene.touch = Contact(Sphere(radius), Plane(), Hard(0.0, Coulomb(scene.friction)))
    scene.connect(scene.world.frame, scene.table.frame_a)
    scene.connect(scene.table.frame_b, scene.touch.frame_a)
    scene.connect(scene.touch.frame_b, scene.ball.frame)
    frame = scene.ball.frame
    begin = {frame.position: (*at[:2], radius), frame.velocity: (*at[2:4], 0)}
    begin |= {frame.rotation: np.eye(3), frame.angular_velocity: at[4:]}
    moved = ball_on_a_shaken_table(mu + 1e-30j, turns, radius, at)
    found = ac.build(scene).sensitivities([0.0, LATE], [scene.friction], begin, **EXACT)
    place, speed = found[frame.position][-1, :2, 0], found[frame.velocity][-1, :2, 0]
    assert np.concatenate([place, speed]) == pytest.approx(moved.imag / 1e-30, rel=1e-8, abs=1e-8)


def ball_in_a_bowl(mu: complex, start: np.ndarray, end: float) -> np.ndarray:
    """Place and velocity of its centre (6,), from these and its angular velocity (9,): on a sphere of radius 1 about the origin, on which it slides all the time."""

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        p, v, w = y[:3], y[3:6], y[6:]
        n = -p / np.sqrt(p @ p)
        slip = v - 0.1 * np.cross(w, n)
        push = v @ v + 9.81 * n[2]  # of 1 kg, on a circle of radius 1
        drag = -mu * push * slip / np.sqrt(slip @ slip)
        return np.array([*v, *(push * n + drag - np.array([0, 0, 9.81])), *(-np.cross(n, drag) / (0.4 * 0.1))])

    return solve_ivp(rate, (0, end), start.astype(complex), method="DOP853", rtol=1e-12, atol=1e-13).y[:6, -1]


@pytest.mark.parametrize("turn", [0.3, -2.0])
def test_ball_that_slides_round_a_bowl_depends_on_friction_as_a_complex_step_says_whatever_axes_its_slip_has(turn: float) -> None:
    """Its slip is told in two axes across the normal, which jump where that leans as much as the bowl's axis is avoided."""
    scene, mu, end = ac.System(), 0.1, 0.18
    scene.friction = ac.Parameter(mu)
    scene.world, scene.ball = World(gravity=(0, 0, -9.81)), RigidBody(1.0, 0.4 * 0.1**2 * np.eye(3))
    scene.bowl = Contact(Sphere(0.1), Sphere(1.1, inside_out=True), Hard(0.0, Coulomb(scene.friction)))
    scene.connect(scene.world.frame, scene.bowl.frame_a)
    scene.connect(scene.bowl.frame_b, scene.ball.frame)
    frame, model = scene.ball.frame, ac.build(scene)
    c, s = np.cos(turn), np.sin(turn)
    place, velocity, spin = (
        np.array([0.8 * c, 0.8 * s, -0.6]),
        np.array([6.0 * c - s, 6.0 * s + c, 8.0]),
        np.array([5.0, -9.0, 40.0]),
    )
    start = {frame.position: place, frame.rotation: np.eye(3), frame.velocity: velocity, frame.angular_velocity: spin}
    found = model.sensitivities([0.0, end], [scene.friction], start, **EXACT)
    exact = ball_in_a_bowl(mu + 1e-30j, np.concatenate([place, velocity, spin]), end).imag / 1e-30
    moved = np.concatenate([found[frame.position][-1, :, 0], found[frame.velocity][-1, :, 0]])
    assert moved == pytest.approx(exact, rel=1e-8, abs=1e-8)


def test_string_that_goes_taut_passes_on_what_is_across_it() -> None:
    scene = ac.System()
    scene.length = ac.Parameter(1.25, "m")
    scene.world, scene.particle, scene.tether = World(gravity=(0, 0, 0)), Particle(0.7), Tether(scene.length)
    scene.connect(scene.particle.point, scene.tether.point)
    start = {scene.particle.point.position: np.array([0.75, 0.0, 0.0]), scene.particle.point.velocity: np.array([0.0, 2.0, 0.0])}
    found = ac.build(scene).sensitivities([0.0, 1.5], [scene.length], start, **EXACT)

    def motion(length: complex) -> np.ndarray:
        taut = np.sqrt(length**2 - 0.75**2) / 2
        angle = np.arctan(2 * taut / 0.75) + 2.0 * 0.75 / length * (1.5 - taut) / length
        return length * np.array([np.cos(angle), np.sin(angle)])

    place = scene.particle.point.position
    assert found[place][-1, :2, 0] == pytest.approx(motion(1.25 + 1e-30j).imag / 1e-30, rel=1e-9)


def test_impacts_of_a_loop_with_friction_have_the_derivatives_that_differences_show() -> None:
    scene = FourBar()
    model, start = ac.build(scene), {scene.a.q: 0.9, scene.a.v: 0.0}
    wrt = [scene.friction, scene.restitution, scene.length, scene.height, scene.a.q]
    values = dict(zip(wrt, (0.3, 0.5, 1.2, scene.floor, 0.9), strict=True))
    for end in (0.2, 0.22, 1.0):  # bounces, slides back, rests
        found = model.sensitivities([0.0, end], wrt, start, **EXACT)
        shown = differences(model, end, start, [scene.a.q, scene.a.v], values, 1e-4)
        mine = np.vstack([found[scene.a.q][-1], found[scene.a.v][-1]])
        assert mine == pytest.approx(shown, rel=1e-8, abs=1e-8)


def test_what_has_come_to_rest_by_impacts_without_end_depends_on_the_floor_alone() -> None:
    scene = Ball(0.3)
    wrt = [scene.restitution, scene.mass.s, scene.weight, scene.height]
    found = ac.build(scene).sensitivities([0.0, 2.0], wrt, {scene.mass.s: 1.0, scene.mass.v: 0.0}, **EXACT)
    assert found.S[-1] == pytest.approx(np.array([[0, 0, 0, 1], [0, 0, 0, 0]]), abs=1e-12)


def test_impacts_without_end_with_friction_are_refused() -> None:
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(1.0, 0.1)
    scene.contact = Contact(Sphere(0.1), Plane(), Hard(0.5, Coulomb(0.01)))
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    frame = scene.ball.frame
    start = {frame.position: (0, 0, 0.3), frame.velocity: (1, 0, 0)}
    with pytest.raises(ac.errors.SimulationError, match=r"contact .* impacts without end, with friction"):
        ac.build(scene).sensitivities([0.0, 2.0], [frame.velocity], start)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (Hard(ac.Newton(0.8), Coulomb(0.3)), "strikes by another law than Poisson's"),
        (Hard(0.8, Coulomb(0.3, restitution=0.5)), r"brings slips back when it strikes \(restitution of Coulomb\)"),
    ],
)
def test_impacts_whose_derivatives_are_not_known_say_why(law: Hard, words: str) -> None:
    scene = ac.System()
    scene.world, scene.ball, scene.contact = World(), RigidBody.ball(1.0, 0.1), Contact(Sphere(0.1), Plane(), law)
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    frame = scene.ball.frame
    start = {frame.position: (0, 0, 0.5), frame.velocity: (1, 0, 0), frame.angular_velocity: (0, -60, 0)}
    with pytest.raises(ac.errors.SimulationError, match="contact.* " + words):
        ac.build(scene).sensitivities([0.0, 0.5], [frame.velocity], start)


def test_belt_whose_speed_jumps_in_a_comparison_has_no_derivatives_and_says_so() -> None:
    scene = ac.System()
    scene.sliding, scene.mass = ac.Parameter(0.5, "N"), SlidingMass(1.0)
    scene.rub = Rub(scene.sliding, 1.0, ca.if_else(ac.time > 0.5, -0.3, 0.3))
    scene.connect(scene.mass.flange_a, scene.rub.flange)
    start = {scene.mass.s: 0.0, scene.mass.v: 0.3}
    with pytest.raises(ac.errors.SimulationError, match=r"rub .*meets what jumps here"):
        ac.build(scene).sensitivities([0.0, 1.0], [scene.sliding], start)


def test_impacts_of_bodies_that_fall_together_are_named() -> None:
    scene = ac.System()
    scene.one, scene.other = Ball(0.5), Ball(0.5)
    start = {part.mass.s: 1.0 for part in (scene.one, scene.other)} | {part.mass.v: 0.0 for part in (scene.one, scene.other)}
    with pytest.warns(SingularWarning, match="closes in the same instant as another"):
        ac.build(scene).sensitivities([0.0, 0.6], [scene.one.mass.s], start)


def test_ball_that_only_touches_is_named() -> None:
    scene = Ball(0.5, gravity=-8.0)
    with pytest.warns(SingularWarning, match="only just comes to where it changes"):
        ac.build(scene).sensitivities([0.0, 1.0], [scene.mass.s], {scene.mass.s: 1.0, scene.mass.v: -4.0 * (1 + 1e-12)})


def test_start_at_rest_on_the_floor_is_named_where_it_is_to_be_raised() -> None:
    scene = Ball(0.0)
    with pytest.warns(SingularWarning, match="closes in the same instant"):
        ac.build(scene).sensitivities([0.0, 1.0], [scene.mass.s], {scene.mass.s: 0.0, scene.mass.v: 0.0})


def ball_on_floor(friction: float, restitution: float, gravity: float, static: float | None = None) -> ac.System:
    scene = ac.System()
    scene.friction, scene.restitution = ac.Parameter(friction), ac.Parameter(restitution)
    scene.world, scene.ball = World((0, 0, -gravity) if gravity else None), RigidBody.ball(0.7, 0.1)
    scene.floor = Contact(Sphere(0.1), Plane(), Hard(scene.restitution, Coulomb(scene.friction, static=static)))
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame)
    return scene


def by_complex_step(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    return np.column_stack([function(at + 1e-30j * unit).imag / 1e-30 for unit in np.eye(at.size)])


def test_instant_at_which_a_ball_begins_to_roll_moves_what_follows() -> None:
    scene = ball_on_floor(0.2, 0.0, 9.81, static=0.3)
    frame, velocity, spin = scene.ball.frame, np.array([1.2, 1.6, 0.0]), np.array([0.0, 3.0, 0.0])
    start = {frame.position: (0, 0, 0.1), frame.velocity: velocity, frame.angular_velocity: spin, frame.rotation: np.eye(3)}
    found = ac.build(scene).sensitivities([0.0, 2.0], [scene.friction, frame.velocity, frame.angular_velocity], start, **EXACT)

    def motion(at: np.ndarray) -> np.ndarray:
        mu, v, w = at[0], at[1:3], at[4:6]
        slip = v - 0.1 * np.array([w[1], -w[0]])
        speed = np.sqrt(slip @ slip)
        rolls, slow = 2 * speed / (7 * mu * 9.81), mu * 9.81 * slip / speed
        end = v - slow * rolls
        return np.concatenate([v * rolls - slow * rolls**2 / 2 + end * (2.0 - rolls), end])

    exact = by_complex_step(motion, np.array([0.2, *velocity[:2], 0.0, *spin]))
    columns = [0, 1, 2, 4, 5]
    mine = np.vstack([found[frame.position][-1, :2], found[frame.velocity][-1, :2]])
    assert mine[:, columns] == pytest.approx(exact[:, columns], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("friction", [0.05, 2.0])
def test_impact_of_a_ball_askew_is_differentiated_with_its_slip(friction: float) -> None:
    """See the impact itself in test_hard_contacts.py."""
    scene = ball_on_floor(friction, 0.8, 0.0)
    frame, velocity, spin = scene.ball.frame, np.array([1.0, 2.0, -3.0]), np.array([5.0, 8.0, 7.0])
    start = {frame.position: (0, 0, 0.4), frame.velocity: velocity, frame.angular_velocity: spin, frame.rotation: np.eye(3)}
    wrt = [scene.friction, scene.restitution, frame.velocity, frame.angular_velocity]
    found = ac.build(scene).sensitivities([0.0, 0.25], wrt, start, **EXACT)

    def motion(at: np.ndarray) -> np.ndarray:
        mu, e, v, w = at[0], at[1], at[2:5], at[5:8]
        slip = np.array([v[0] - 0.1 * w[1], v[1] + 0.1 * w[0], 0])
        speed, push, strikes = np.sqrt(slip @ slip), -(1 + e) * v[2], -0.3 / v[2]
        after = v - slip * (mu * push / speed if friction < 1 else 2 / 7) + np.array([0, 0, push])
        return np.concatenate([np.array([0, 0, 0.4]) + v * strikes + after * (0.25 - strikes), after])

    exact = by_complex_step(motion, np.array([friction, 0.8, *velocity, *spin]))
    mine = np.vstack([found[frame.position][-1], found[frame.velocity][-1]])
    assert mine == pytest.approx(exact, rel=1e-9, abs=1e-9)


def test_bounces_on_a_floor_that_shakes_have_the_derivatives_that_differences_show() -> None:
    scene = ac.System()
    scene.restitution, scene.far, scene.often = ac.Parameter(0.6), ac.Parameter(0.05, "m"), ac.Parameter(20.0, "1/s")
    scene.mass, scene.pull = SlidingMass(2.0), ForceSource(-19.62)
    scene.floor = Floor(scene.restitution, scene.far * np.sin(scene.often * ac.time))
    scene.connect(scene.mass.flange_a, scene.floor.flange)
    scene.connect(scene.mass.flange_b, scene.pull.flange)
    start, values = (
        {scene.mass.s: 1.0, scene.mass.v: 0.0},
        {scene.restitution: 0.6, scene.far: 0.05, scene.often: 20.0, scene.mass.s: 1.0},
    )
    model = ac.build(scene)
    found = model.sensitivities([0.0, 1.1], list(values), start, **EXACT)
    shown = differences(model, 1.1, start, [scene.mass.s, scene.mass.v], values, 1e-5)
    assert found.S[-1] == pytest.approx(shown, rel=1e-8, abs=1e-8)


def test_box_that_falls_on_one_of_its_feet_and_then_another() -> None:
    scene = ac.System()
    scene.friction, scene.restitution = ac.Parameter(0.3), ac.Parameter(0.4)
    scene.world, scene.box = World(), RigidBody(mass=2.0, inertia=(0.1, 0.12, 0.08))
    for k, (x, y) in enumerate(((0.4, 0.3), (0.4, -0.3), (-0.4, 0.3), (-0.4, -0.3))):
        foot = Touch(scene.friction, scene.restitution)
        setattr(scene, f"foot{k}", foot)
        scene.connect(scene.box.at((x, y, -0.5)), foot.point)
    frame, model = scene.box.frame, ac.build(scene)
    start = {frame.position: (0, 0, 0.6), frame.velocity: (1.0, 0.3, 0), frame.angular_velocity: (0.5, 0.2, 1.0)}
    values, wanted = {scene.friction: 0.3, scene.restitution: 0.4}, [frame.position, frame.velocity, frame.angular_velocity]
    found = model.sensitivities([0.0, 0.2], list(values), start, **EXACT)
    shown = differences(model, 0.2, start, wanted, values, 1e-5)
    assert np.vstack([found[one][-1] for one in wanted]) == pytest.approx(shown, rel=1e-7, abs=1e-7)


def test_impacts_on_a_floor_that_an_input_moves():
    """s = s0 + v0 t meets a floor at c t^2 / 2 - 1 and leaves it with v = w - e (v0 - w), w = c t*: a closed form, and so are its derivatives."""
    scene, e, c, end = ac.System(), 0.6, 0.8, 2.0
    scene.course = ac.Input("m")
    scene.mass, scene.floor = SlidingMass(2.0), Floor(e, scene.course)
    scene.connect(scene.mass.flange_a, scene.floor.flange)

    def at(s0: float, v0: float) -> float:
        hit = (v0 + np.sqrt(v0**2 + 2 * c * (s0 + 1))) / c
        w = c * hit
        return s0 + v0 * hit + (w - e * (v0 - w)) * (end - hit)

    s0, v0, h = 0.5, -1.2, 1e-6
    course = 0.5 * c * ac.time**2 - 1
    start = {scene.mass.s: s0, scene.mass.v: v0}
    found = ac.build(scene).sensitivities([0.0, end], [scene.mass.s, scene.mass.v], start, inputs={scene.course: course}, **EXACT)
    exact = [(at(s0 + h, v0) - at(s0 - h, v0)) / (2 * h), (at(s0, v0 + h) - at(s0, v0 - h)) / (2 * h)]
    np.testing.assert_allclose(np.ravel(found[scene.mass.s][-1]), exact, rtol=1e-7)


def test_derivatives_that_fail_promise_no_motion() -> None:
    scene = Ball(0.8)
    with pytest.raises(ac.errors.SimulationError, match="max_steps") as failed:
        ac.build(scene).sensitivities([0.0, 3.0], [scene.height], {scene.mass.s: 1.0, scene.mass.v: 0.0}, max_steps=2)
    assert failed.value.trajectory is None and "trajectory" not in str(failed.value)


@each_value(
    ("size", [1.0, 1e-3, 1e4]),
    (("mu", "mass", "growth", "angle"), [(0.3, 2.0, 9.0, 0.0), (0.5, 2.0, 5.1, 2.0), (0.12, 1.7, 7.3, -0.7)]),
)
def test_what_a_growing_push_sets_in_motion_has_the_derivatives_of_its_closed_form(mu, mass, growth, angle, size):
    """|x| = F / (6 m) (t - mu m g / F)^3 along the push F t: slip begins as slowly as its square, in a direction that then no longer is held, and of nothing is told that it only just happens.
    As long as it is held its derivative is none: that of the angle is off by what comes of these some 1e-4 s."""
    scene = ac.System()
    scene.world, scene.mass, scene.mu = World((0, 0, -9.81 * size)), ac.Parameter(mass, "kg"), ac.Parameter(mu, "1")
    scene.growth, scene.angle = ac.Parameter(growth * size, "N/s"), ac.Parameter(angle, "rad")
    scene.ball, scene.floor = Particle(scene.mass), PointOnPlane(unilateral=True, friction=Coulomb(scene.mu))
    push = scene.growth * ac.time
    scene.push = Force((push * np.cos(scene.angle), push * np.sin(scene.angle), 0))
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.point, scene.push.point)
    at, end = scene.ball.point, 3.0
    wrt = [scene.mu, scene.mass, scene.growth, scene.angle]
    found = ac.build(scene).sensitivities([0, end], wrt, {at.position: (0, 0, 0), at.velocity: (0, 0, 0)}, rtol=1e-11)
    F, later = growth * size, end - mu * mass * 9.81 / growth
    x, by_later = F / (6 * mass) * later**3, F / (2 * mass) * later**2
    # each: of the way, and of its angle
    way = [
        -by_later * mass * 9.81 * size / F,
        -x / mass - by_later * mu * 9.81 * size / F,
        x / F + by_later * mu * mass * 9.81 * size / F**2,
        0.0,
    ]
    along, across = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
    for k, turned in enumerate((0.0, 0.0, 0.0, x)):
        most = (1e-7 if turned else 1e-9) * max(abs(way[k]), turned)
        assert found[at.position][-1][:, k] == pytest.approx(way[k] * along + turned * across, rel=0, abs=most)


class LeaningRod:
    """Of mass 1 and length L, on a rough floor and against a rough wall, at `angle` from upright; its foot is drawn away from the wall by F t / T. In the plane; p: mu, that at the wall, F / L [1/s^2]."""

    def __init__(self, angle: float, size: float, p: np.ndarray) -> None:
        self.angle, self.L, self.T, self.p = angle, size, np.sqrt(size / 9.81), p

    def forces(self, angle: float, rate: float, t: float, p: np.ndarray, way: float) -> np.ndarray:
        """Angular acceleration in 1/T^2, pushes of floor and wall in weights, where friction pushes the foot to the wall, the head along it by `way`; t in T."""
        s, c, (mu, high, F) = np.sin(angle), np.cos(angle), p
        A = np.array([[-c / 2, -mu, 1], [-s / 2, -1, -way * high], [1 / 12, c / 2 * mu - s / 2, c / 2 + way * high * s / 2]])
        b = np.array([-F * self.T**2 * t - s / 2 * rate**2, -1 + c / 2 * rate**2, c / 2 * F * self.T**2 * t])
        return np.linalg.solve(A, b)

    def gives_way(self, p: np.ndarray) -> float:
        """Until when, in T, any forces hold it: at a limit at both ends there, whichever way lasts longer."""
        found: list[float] = []
        for way in (-1.0, 1.0):
            at = [self.forces(self.angle, 0, t, p, way) for t in (0.0, 1.0)]
            t = at[0][0] / (at[0][0] - at[1][0])
            if t > 0 and np.all(at[0][1:] + t * (at[1][1:] - at[0][1:]) > 0):
                found.append(t)
        return max(found)

    def angle_at(self, t: float, p: np.ndarray) -> float:
        """[rad] at t [T], while it slides at both ends."""
        slope = lambda t, y: (y[1], self.forces(y[0], y[1], t, p, 1.0)[0])  # noqa: E731
        way = solve_ivp(slope, (self.gives_way(p), t), (self.angle, 0.0), "DOP853", rtol=1e-13, atol=1e-15)
        assert np.all(self.forces(way.y[0, -1], way.y[1, -1], t, p, 1.0)[1:] > 0)
        return float(way.y[0, -1])


@pytest.mark.parametrize(("angle", "mu", "high", "size"), [(0.4, 0.5, 0.4, 1.0), (0.5, 0.6, 0.3, 1e-3)])
def test_what_holds_itself_between_floor_and_wall_gives_way_when_its_parameters_say(
    angle: float, mu: float, high: float, size: float
) -> None:
    """It does where no forces within both limits hold it, and then begins to slide with an acceleration that jumps: friction at the wall, which pushed it down, turns round."""
    p = np.array([mu, high, 4.0 * 9.81 / size])
    rod = LeaningRod(angle, size, p)
    scene, given = ac.System(), [ac.Parameter(mu), ac.Parameter(high), ac.Parameter(p[2] * size, "N")]
    scene.push, scene.world, scene.rod = (
        Force((-given[2] * ac.time / rod.T, 0, 0)),
        World((0, 0, -9.81)),
        RigidBody.rod(1.0, (0, 0, size)),
    )
    scene.x, scene.z, scene.turn = Prismatic("x"), Prismatic("z"), Revolute("y")
    scene.foot, scene.head = (PointOnPlane(unilateral=True, friction=Coulomb(k)) for k in given[:2])
    for a, b in (
        (scene.world.frame, scene.x.frame_a), (scene.x.frame_b, scene.z.frame_a), (scene.z.frame_b, scene.turn.frame_a), (scene.turn.frame_b, scene.rod.frame),
        (scene.world.frame, scene.foot.frame_a), (scene.foot.frame_b, scene.rod.frame), (scene.push.point, scene.rod.frame), (scene.head.frame_b, scene.rod.tip),
        (scene.world.at((size * np.sin(angle), 0, 0), rotation=((0, 1, 0), -np.pi / 2)), scene.head.frame_a),
    ):  # fmt: skip
        scene.connect(a, b)
    end = rod.gives_way(p) + 0.1
    with warnings.catch_warnings():
        warnings.simplefilter("error", SingularWarning)
        found = ac.build(scene).sensitivities(
            [0.0, end * rod.T], given, {scene.x.q: 0, scene.z.q: 0, scene.turn.q: angle}, rtol=1e-12
        )
    for k, steps in enumerate(np.diag(1e-4 * p)):
        differences = [
            (rod.angle_at(end, p + part * steps) - rod.angle_at(end, p - part * steps)) / (2e-4 * part) for part in (1, 0.5)
        ]
        right = differences[1] + (differences[1] - differences[0]) / 3
        assert found[scene.turn.q][-1].ravel()[k] * given[k].value == pytest.approx(right, rel=1e-7)
