"""Wheels and balls that roll: alone, in pairs, under carts, between plates; against closed forms."""

import copy

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.errors import ContactWarning, SimulationError, StartValueError
from acausal.language.expression import sx
from acausal.parts.pose import symbolic
from components import (
    AngleSource,
    Cylindrical,
    Planar,
    PointOnPlane,
    Prismatic,
    Revolute,
    RigidBody,
    RollingBall,
    RollingDisk,
    RollingTorus,
    Screw,
    SpeedSource,
    TorqueSource,
    Universal,
    World,
)
from components.orientation import rotation_about
from tests.scenes import rotation

G = 9.81
R, M = 0.25, 1.0  # radius [m] and mass [kg] of the wheels of carts
A, C = M * R**2 / 4, M * R**2 / 2  # their moments of inertia about a diameter and the axle


def rolling(scene: ac.System, contact, wheel: ac.Frame, ground: ac.Frame | None = None) -> None:
    scene.connect(scene.world.frame if ground is None else ground, contact.frame_a)
    scene.connect(contact.frame_b, wheel)


def lone(contact, body: RigidBody, gravity: tuple[float, float, float] = (0, 0, -G)) -> ac.System:
    scene = ac.System()
    scene.world, scene.body, scene.contact = World(gravity), body, contact
    rolling(scene, contact, body.frame)
    return scene


class Cart(ac.System):
    """Wheels in pairs, `width` to either side of axle centres at x, each axle turned by an angle about the vertical."""

    def __init__(self, axles: dict[float, float], gravity=(0, 0, -G), width=0.4, mass=5.0, centre=(0.0, 0.0, 0.0)) -> None:
        self.world = World(gravity)
        self.frame = RigidBody(mass, (0.1, 0.4, 0.5), centre, position=(0, 0, R))
        self.wheels, self.hubs, self.contacts = [], [], []
        for x, turn in axles.items():
            Q = rotation_about(np.array([0.0, 0.0, 1.0]), turn)
            for y in (width, -width):
                self.add_wheel(self.frame.at(tuple(np.array([x, 0, 0]) + Q @ [0, y, 0]), rotation=Q))

    def add_wheel(self, place: ac.Frame) -> None:
        wheel, hub, contact = RigidBody.disk(M, R, axis="y", position=(0, 0, R)), Revolute("y"), RollingDisk(R)
        self.wheels, self.hubs, self.contacts = [*self.wheels, wheel], [*self.hubs, hub], [*self.contacts, contact]
        self.connect(place, hub.frame_a)
        self.connect(hub.frame_b, wheel.frame)
        rolling(self, contact, wheel.frame)


def heading(run, frame: ac.Frame) -> np.ndarray:
    """Angle of a frame's x about the vertical."""
    Q = run[frame.rotation]
    return np.unwrap(np.arctan2(Q[:, 1, 0], Q[:, 0, 0]))


def local(run, frame: ac.Frame) -> tuple[np.ndarray, np.ndarray]:
    """Forward and sideways velocity of a level frame."""
    v, Q = run[frame.velocity], run[frame.rotation]
    return np.sum(v * Q[:, :, 0], axis=1), np.sum(v * Q[:, :, 1], axis=1)


# one wheel


@pytest.mark.parametrize("axis", ["x", "y", "z", "-y", "-z", (1, 2, 3), (0.1, -3, 0.2)])
def test_wheel_stands_upright_at_zero_and_its_signs_are_those_of_the_text(axis):
    contact = RollingDisk(0.3, axis)
    q = ca.SX.sym("q", 5)
    pose = contact.pose(q, ca.SX.sym("t"))
    f = ca.Function("f", [q], [symbolic(pose.rotation), symbolic(pose.position)])
    e = np.array(ca.DM(sx(contact.axis))).ravel()
    yaw, lean, spin = 0.2, 0.3, 0.4
    for values, axle, height in (
        ((0, 0, spin, 1, 2), (0, 1, 0), 0.3),
        ((yaw, 0, 0, 1, 2), (-np.sin(yaw), np.cos(yaw), 0), 0.3),
        ((0, lean, spin, 1, 2), (0, np.cos(lean), np.sin(lean)), 0.3 * np.cos(lean)),
    ):
        Q, p = (np.array(part) for part in f(np.array(values)))
        assert np.max(np.abs(Q @ e - axle)) < 1e-15
        assert np.max(np.abs(p.ravel() - [1, 2, height])) < 1e-15
    Q0, Q1 = (np.array(f(np.array([0, 0, s, 0, 0]))[0]) for s in (0.0, spin))
    forward = np.array([[np.cos(spin), 0, np.sin(spin)], [0, 1, 0], [-np.sin(spin), 0, np.cos(spin)]])
    assert np.max(np.abs(Q1 - forward @ Q0)) < 1e-15
    if axis == "y":
        assert np.array_equal(Q0, np.eye(3))


@pytest.mark.parametrize("axis", ["y", "z", (1, 2, 3)])
def test_balanced_wheel_depends_neither_on_spin_nor_on_heading_nor_on_place(axis):
    system = ac.build(lone(RollingDisk(0.3, axis), RigidBody.disk(1.0, 0.3, axis=axis))).system
    assert not ca.depends_on(system.v_dot, system.x[[0, 2, 3, 4]])
    unbalanced = ac.build(lone(RollingDisk(0.3, axis), RigidBody(1.0, (0.1, 0.2, 0.25)))).system
    assert ca.depends_on(unbalanced.v_dot, unbalanced.x[2])


def test_wheel_of_parameters_is_balanced_too_and_its_axis_may_be_one():
    radius, mass, angle = ac.Parameter(0.3, "m"), ac.Parameter(1.0, "kg"), ac.Parameter(0.0)
    scene = lone(RollingTorus(radius, 0.02, "y"), RigidBody.disk(mass, radius, axis="y"))
    scene.radius, scene.mass = radius, mass
    system = ac.build(scene).system
    assert not ca.depends_on(system.v_dot, system.x[[0, 2, 3, 4]])
    scene = lone(RollingDisk(0.3, (ca.sin(angle), ca.cos(angle), 0.0)), RigidBody(1.0, (0.1, 0.2, 0.25)))
    scene.angle = angle
    model = ac.build(scene)
    turned = lone(RollingDisk(0.3, (np.sin(0.5), np.cos(0.5), 0.0)), RigidBody(1.0, (0.1, 0.2, 0.25)))
    other = ac.build(turned)

    def start(s: ac.System) -> dict:
        turn = rotation_about(np.array([1.0, 0, 0]), 0.2)
        return {s.body.frame.rotation: turn, s.body.frame.angular_velocity: (0, 5, 1)}

    one = model.simulate(1.0, start(scene), parameters={angle: 0.5}, rtol=1e-12)
    two = other.simulate(1.0, start(turned), rtol=1e-12)
    assert np.max(np.abs(one[scene.body.frame.position] - two[turned.body.frame.position])) < 1e-10
    assert np.max(np.abs(one[scene.body.frame.rotation] - two[turned.body.frame.rotation])) < 1e-10


@pytest.mark.parametrize("seed", range(4))
def test_start_may_be_an_orientation(seed):
    scene = lone(RollingDisk(0.3), RigidBody.disk(1.0, 0.3, axis="y"))
    Q, w = rotation(seed), np.array([0.3, -2.0, 1.0])
    run = ac.build(scene).simulate(
        0.1, {scene.body.frame.rotation: Q, scene.body.frame.angular_velocity: w, scene.body.frame.position[:2]: (1.0, 2.0)}
    )
    assert np.max(np.abs(run[scene.body.frame.rotation][0] - Q)) < 1e-12
    assert np.max(np.abs(run[scene.body.frame.angular_velocity][0] - w)) < 1e-12
    height = 0.3 * np.sqrt(1 - Q[2, 1] ** 2)
    assert np.max(np.abs(run[scene.body.frame.position][0] - [1, 2, height])) < 1e-12


def test_wheel_upside_down_is_no_start():
    scene = lone(RollingDisk(0.3), RigidBody.disk(1.0, 0.3, axis="y"))
    with pytest.raises(StartValueError, match=r"contact.*outside its domain.*does not roll on its rim"):
        ac.build(scene).simulate(1.0, {scene.contact.q: (0, 2.0, 0, 0, 0)})


@pytest.mark.filterwarnings("ignore::acausal.errors.ContactWarning")  # before it lies flat, the contact would have pulled
def test_wheel_that_falls_flat_is_told():
    scene = lone(RollingDisk(0.3), RigidBody.disk(1.0, 0.3, axis="y"))
    model = ac.build(scene)
    with pytest.raises(SimulationError, match=r"'contact'.*fallen through its plane"):
        model.simulate(1.0, {scene.contact.q: (0, 0.5, 0, 0, 0)})
    flat = ac.when(scene.contact.q[1] - 1.5, "rising", stop=True)
    assert model.simulate(1.0, {scene.contact.q: (0, 0.5, 0, 0, 0)}, events=[flat]).t[-1] < 0.5


@pytest.mark.parametrize("tube", [0.02, 0.2])
def test_torus_rolls_in_a_steady_circle(tube):
    """Leaning by b, around with rate W: moments about the centre, with the arm (a, h) of the contact along the axle and up in the
    wheel's plane, give W^2 A sin b cos b - W C w cos b = a (m g cos b - m W u sin b) - h (m W u cos b + m g sin b), u = a W cos b - h w;
    after O'Reilly 10.8 and Routh, Advanced Rigid Dynamics (1905), art. 244."""
    m, r, lean, W = 1.0, 0.3, 0.4, 0.9
    inertia, spinning = m * r * r / 4, m * r * r / 2
    sin, cos = np.sin(lean), np.cos(lean)
    a, h = -tube * sin, -r - tube * cos

    def excess(w: float) -> float:
        u = a * W * cos - h * w
        left = W * W * inertia * sin * cos - W * spinning * w * cos
        return left - a * (m * G * cos - m * W * u * sin) + h * (m * W * u * cos + m * G * sin)

    w = -excess(0.0) / (excess(1.0) - excess(0.0))  # it is linear in w
    scene = lone(RollingTorus(r, tube), RigidBody.disk(m, r, axis="y"))
    run = ac.build(scene).simulate(5.0, {scene.contact.q: (0, lean, 0, 0, 0), scene.contact.v: (0.0, w, W * cos)}, rtol=1e-12)
    u = a * W * cos - h * w
    assert np.max(np.abs(run[scene.contact.v] - [0, w, W * cos])) < 1e-10
    circle = u / W * np.stack([np.sin(W * run.t), 1 - np.cos(W * run.t)], axis=1)
    assert np.max(np.abs(run[scene.body.frame.position] - np.column_stack([circle, np.full(run.t.size, r * cos + tube)]))) < 1e-10


@pytest.mark.parametrize("speed", [0.7, 3.0, 5.0])
def test_straight_rolling_has_the_eigenvalues_of_a_disk(speed):
    """lean'' (A + m r^2) = m g r lean - (C + m r^2) w yaw', A yaw'' = C w lean' (O'Reilly 10.8): straight rolling is stable from
    w^2 = A m g r / (C (C + m r^2)), the first speed is below and the others are above."""
    m, r = 1.0, 0.3
    inertia, spinning, w = m * r * r / 4, m * r * r / 2, speed / r
    square = (m * G * r - spinning * (spinning + m * r * r) * w * w / inertia) / (inertia + m * r * r)
    assert (square > 0) == (speed < 1)
    scene = lone(RollingDisk(r), RigidBody.disk(m, r, axis="y"))
    system = ac.build(scene).system
    x = np.array([0.3, 0, 0.7, 1, 2, 0, w, 0])
    matrix = np.array(ca.Function("A", [system.t, system.x], [ca.jacobian(system.x_dot, system.x)])(0.0, x))
    moving = matrix[np.ix_([1, 5, 7], [1, 5, 7])]  # lean, its rate, yaw's rate
    assert np.max(np.abs(np.sort(np.linalg.eigvals(moving @ moving).real) - np.sort([0, square, square]))) < 1e-11


@pytest.mark.parametrize("contact", [RollingDisk(0.3), RollingTorus(0.28, 0.02)])
def test_tumbling_wheel_keeps_its_energy_and_touches_without_slipping(contact):
    scene = lone(contact, RigidBody(1.0, (0.02, 0.04, 0.025), (0.01, 0.003, -0.02)))
    run = ac.build(scene).simulate(10.0, {scene.contact.q: (0, 0.4, 0, 0, 0), scene.contact.v: (0.5, 6.0, 1.0)}, rtol=1e-13)
    assert run.energy_error() < 1e-12
    p, Q = run[scene.body.frame.position], run[scene.body.frame.rotation]
    axle = Q[:, :, 1]
    down = -np.array([0, 0, 1.0]) + axle * axle[:, 2:]
    radius, tube = (0.3, 0.0) if isinstance(contact, RollingDisk) else (0.28, 0.02)
    arm = radius * down / np.linalg.norm(down, axis=1, keepdims=True) - [0, 0, tube]
    assert np.max(np.abs((p + arm)[:, 2])) < 1e-14
    slip = run[scene.body.frame.velocity] + np.cross(run[scene.body.frame.angular_velocity], arm)
    assert np.max(np.abs(slip)) < 1e-13


def test_plank_rocks_on_a_fixed_wheel():
    """The wheel is the ground and the plane moves: (k^2 + r^2 b^2) b'^2 / 2 + g r (cos b + b sin b) is constant at the tilt b, and the
    centre is at r (sin b - b cos b, cos b + b sin b)."""
    m, r = 2.0, 0.5
    scene = ac.System()
    scene.world, scene.plank, scene.contact = World(), RigidBody(m, (0.02, 0.3, 0.3)), RollingDisk(r)
    scene.connect(scene.plank.at((0, 0, 0), rotation=("x", np.pi)), scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.world.frame)
    model = ac.build(scene)
    assert model.system.tree_joints[0].reversed
    run = model.simulate(2.0, {scene.plank.frame.rotation: np.eye(3), scene.plank.frame.angular_velocity: (0, 1.2, 0),
                               scene.plank.frame.position[:2]: (0, 0)}, rtol=1e-12)  # fmt: skip
    p, Q, w = run[scene.plank.frame.position], run[scene.plank.frame.rotation], run[scene.plank.frame.angular_velocity][:, 1]
    tilt = np.arctan2(Q[:, 0, 2], Q[:, 2, 2])
    where = r * np.stack([np.sin(tilt) - tilt * np.cos(tilt), np.zeros_like(tilt), np.cos(tilt) + tilt * np.sin(tilt)], axis=1)
    assert np.max(tilt) > 0.2
    assert np.max(np.abs(p - where)) < 1e-9
    energy = 0.5 * (0.3 / m + r * r * tilt**2) * w**2 + G * r * (np.cos(tilt) + tilt * np.sin(tilt))
    assert np.max(np.abs(energy - energy[0])) < 1e-9 * energy[0]


# two wheels


def test_equal_wheels_on_one_shaft_roll_straight():
    scene = ac.System()
    scene.world, scene.shaft = World(), RigidBody(2.0, (0.1, 0.05, 0.1))
    scene.left, scene.right = RollingDisk(0.3), RollingDisk(0.3)
    rolling(scene, scene.left, scene.shaft.at((0, 0.5, 0)))
    rolling(scene, scene.right, scene.shaft.at((0, -0.5, 0)))
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    assert model.system.constraints.redundant == ("right.rolling[1]",)  # across: the other wheel forbids it already
    run = model.simulate(2.0, {scene.left.q: (0.3, 0, 0, 0, 0), scene.left.v: ac.near((0, 2.0, 0))}, rtol=1e-12)
    p = run[scene.shaft.frame.position]
    assert np.max(np.abs(p - p[0] - 0.3 * run[scene.left.q][:, 2:3] * [np.cos(0.3), np.sin(0.3), 0])) < 1e-12
    assert abs(run[scene.left.q][-1, 2] - 4.0) < 1e-9


def test_unequal_wheels_on_one_shaft_roll_around_the_apex_of_their_cone():
    big, small, half = 0.3, 0.2, 0.5
    scene = ac.System()
    scene.world, scene.shaft = World(), RigidBody(2.0, (0.1, 0.05, 0.1))
    scene.left, scene.right = RollingDisk(small), RollingDisk(big)
    rolling(scene, scene.left, scene.shaft.at((0, half, 0)))
    rolling(scene, scene.right, scene.shaft.at((0, -half, 0)))
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(9.0, {scene.left.v: ac.near((0, 2.0, 0))}, rtol=1e-13)
    opening = np.arctan((big - small) / (2 * half))
    assert np.max(np.abs(run[scene.left.q][:, 1] + opening)) < 1e-13
    axle = run[scene.shaft.frame.rotation][:, :, 1]
    apex = run[scene.shaft.frame.position] + axle * (half + small * 2 * half / (big - small))
    assert np.max(np.abs(apex - [*apex[0, :2], 0])) < 1e-11
    w = run[scene.shaft.frame.angular_velocity]  # along the line of contact, from the apex to both rims, at a constant rate
    assert np.max(np.abs(w[:, 2])) < 1e-12
    assert np.max(np.abs(np.linalg.norm(w, axis=1) - np.linalg.norm(w[0]))) < 1e-11
    turned = np.unwrap(np.arctan2(axle[:, 1], axle[:, 0]))
    assert abs(turned[-1] - turned[0]) > 1
    assert np.max(np.abs(np.abs(turned - turned[0]) - np.linalg.norm(w[0]) * np.tan(opening) * run.t)) < 1e-10


def test_wheels_that_turn_freely_on_one_axle_roll_around_a_circle():
    """Modelica's RollingWheelSet: yaw rate and speed of a balanced axle stay what they are."""
    scene = Cart({0.0: 0.0})
    model = ac.build(scene)
    assert model.degrees_of_freedom == 3  # forward, yaw, and the frame about the axle
    assert model.system.constraints.redundant == ("contacts[1].rolling[1]",)
    W, u = 2.0, 1.0
    start = {scene.contacts[0].v: (0, u / R - 0.4 * W / R, W), scene.contacts[0].q: (0, 0, 0, 0, 0.4), scene.hubs[1].v: u / R + 0.4 * W / R,
             scene.frame.frame.angular_velocity[1]: 0.0}  # fmt: skip
    run = model.simulate(4.0, start, rtol=1e-12)
    circle = u / W * np.stack([np.sin(W * run.t), 1 - np.cos(W * run.t), np.full(run.t.size, R * W / u)], axis=1)
    assert np.max(np.abs(run[scene.frame.frame.position] - circle)) < 1e-11
    assert np.max(np.abs(heading(run, scene.frame.frame) - W * run.t)) < 1e-11
    assert run.energy_error() < 1e-12


def test_sleigh_on_two_wheels_turns_until_it_runs_straight():
    """Chaplygin's sleigh, its blade made of two wheels, its frame kept level by a planar joint: with the centre of mass at c ahead of
    the axle, M u' = m c W^2 and J W' = -m c u W, so that u = U tanh(k t), W = (U sqrt(M / J)) / cosh(k t), k = m c U / J."""
    c, m, width = 0.3, 5.0, 0.4
    scene = Cart({0.0: 0.0}, mass=m, centre=(c, 0.0, 0.0), width=width)
    scene.table = Planar("z")
    scene.connect(scene.world.at((0, 0, R)), scene.table.frame_a)
    scene.connect(scene.table.frame_b, scene.frame.frame)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 2
    rows = model.system.constraints
    assert (
        len(rows.redundant) + len(rows.vanishing) == 3
    )  # two wheels touch a plane above which the frame is kept; one may slip across
    mass = m + 2 * M + 2 * C / R**2
    J = 0.5 + m * c * c + 2 * (A + (M + C / R**2) * width**2)
    U, t0 = 1.5, -1.0
    k = m * c * U / J
    W = lambda t: U * np.sqrt(mass / J) / np.cosh(k * (t + t0))  # noqa: E731
    start = {scene.table.q: (0, 0, 0), scene.table.v: ac.near((U * np.tanh(k * t0), 0, W(0.0)))}
    run = model.simulate(4.0, start, rtol=1e-12)
    u, side = local(run, scene.frame.frame)
    assert np.max(np.abs(side)) < 1e-12
    assert np.max(np.abs(u - U * np.tanh(k * (run.t + t0)))) < 1e-10
    assert np.max(np.abs(run[scene.table.v][:, 2] - W(run.t))) < 1e-10


# carts


@pytest.mark.parametrize("axles", [(-0.5, 0.5), (-0.5, 0.0, 0.7)])
def test_parallel_axles_leave_one_freedom(axles):
    scene, wheels = Cart(dict.fromkeys(axles, 0.0)), 2 * len(axles)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    assert len(model.system.constraints.redundant) == 3 * (wheels - 1) - (wheels + 2)


def test_cart_rolls_straight_down_an_incline():
    """One freedom; x'' = m g sin(slope) / (m + sum C / r^2)."""
    slope, mass = 0.2, 5.0 + 4 * M
    scene = Cart({-0.5: 0.0, 0.5: 0.0}, gravity=(G * np.sin(slope), 0, -G * np.cos(slope)))
    run = ac.build(scene).simulate(2.0, rtol=1e-12)
    p = run[scene.frame.frame.position]
    expected = 0.5 * mass * G * np.sin(slope) / (mass + 4 * C / R**2) * run.t**2
    assert np.max(np.abs(p - p[0] - expected[:, None] * [1, 0, 0])) < 1e-11
    assert run.energy_error() < 1e-12
    assert run.constraint_error() < 1e-13


def test_cart_with_a_turned_axle_rolls_around_the_point_where_its_axles_meet():
    base, turn = 1.0, 0.3
    scene = Cart({0.0: 0.0, base: turn})
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    start = {scene.contacts[0].q: (0, 0, 0, 0, 0.4), scene.hubs[0].v: ac.near(3.0)}
    run = model.simulate(4.0, start, rtol=1e-12)
    radius = base / np.tan(turn)
    rate = run[scene.hubs[0].v][0] * R / (radius - 0.4)
    circle = radius * np.stack([np.sin(rate * run.t), 1 - np.cos(rate * run.t), np.full(run.t.size, R / radius)], axis=1)
    assert rate > 0.1
    assert np.max(np.abs(run[scene.frame.frame.position] - circle)) < 1e-11


class DrawbarCart(Cart):
    """A rear axle on the frame, a front axle that turns under it about the vertical through its middle."""

    def __init__(self, base: float) -> None:
        super().__init__({0.0: 0.0})
        self.bogie, self.pivot = RigidBody(2.0, (0.1, 0.05, 0.12), position=(base, 0, R)), Revolute("z")
        self.connect(self.frame.at((base, 0, 0)), self.pivot.frame_a)
        self.connect(self.pivot.frame_b, self.bogie.frame)
        for y in (0.3, -0.3):
            self.add_wheel(self.bogie.at((0, y, 0)))


def test_cart_with_a_drawbar_turns_as_its_front_axle_says():
    """Two freedoms; the yaw rate is u tan(steering) / base whatever the forces are."""
    base = 1.2
    scene = DrawbarCart(base)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 2
    run = model.simulate(3.0, {scene.pivot.q: 0.2, scene.pivot.v: 0.3, scene.hubs[0].v: 5.0}, rtol=1e-12)
    u, side = local(run, scene.frame.frame)
    rate = run[scene.frame.frame.angular_velocity][:, 2]
    assert np.max(np.abs(side)) < 1e-12
    assert np.max(np.abs(rate - u * np.tan(run[scene.pivot.q].ravel()) / base)) < 1e-11
    assert np.ptp(run[scene.pivot.q]) > 0.1
    assert run.energy_error() < 1e-11


def test_cart_steered_by_a_given_angle_keeps_its_speed_on_a_circle():
    base, angle = 1.2, 0.25
    scene = DrawbarCart(base)
    scene.steering = AngleSource(angle)
    scene.connect(scene.steering.flange, scene.pivot.flange)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(3.0, {scene.contacts[0].q: (0, 0, 0, 0, 0.4), scene.hubs[0].v: ac.near(4.0)}, rtol=1e-12)
    radius = base / np.tan(angle)
    rate = run[scene.frame.frame.angular_velocity][0, 2]
    circle = radius * np.stack([np.sin(rate * run.t), 1 - np.cos(rate * run.t), np.full(run.t.size, R / radius)], axis=1)
    assert abs(rate) > 0.1
    assert np.max(np.abs(run[scene.frame.frame.position] - circle)) < 1e-10


def test_wheels_steered_on_their_own_roll_only_by_the_rule_of_ackermann():
    """Two front wheels on pivots of their own: they turn on the spot, and roll where cot(left) - cot(right) = -track / base."""
    base, half = 1.0, 0.4
    scene = Cart({0.0: 0.0}, width=half)
    scene.pivots, scene.knuckles = [Revolute("z"), Revolute("z")], [RigidBody(0.5, (0.01, 0.01, 0.01)) for _ in range(2)]
    for pivot, knuckle, y in zip(scene.pivots, scene.knuckles, (half, -half), strict=True):
        scene.connect(scene.frame.at((base, y, 0)), pivot.frame_a)
        scene.connect(pivot.frame_b, knuckle.frame)
        scene.add_wheel(knuckle.frame)
    model = ac.build(scene)
    left, right = scene.pivots
    steered = 0.3
    rule = float(np.arctan(1 / (1 / np.tan(steered) + 2 * half / base)))
    start = {left.q: steered, right.q: rule, left.v: 0.0, right.v: 0.0, scene.hubs[0].v: 3.0}
    x = model.initial_state(start).x
    rates = model.functions.explicit_dynamics(0.0, x, [], [])
    assert np.max(np.abs(np.array(rates)[model.system.nq :])) < 1e-9  # on around the circle
    with pytest.raises(StartValueError, match="contradict"):
        model.initial_state(start | {right.q: 0.1})
    model.initial_state(start | {right.q: 0.1, scene.hubs[0].v: 0.0, left.v: 1.0})


def test_castor_follows_the_tractrix():
    """A castor of trail d whose pivot runs along a line: tan(b / 2) = tan(b0 / 2) exp(-s / d) after the way s, whatever the forces."""
    trail = 0.15
    scene = ac.System()
    scene.world, scene.rail, scene.pivot, scene.hub = World(), Prismatic("x"), Revolute("z"), Revolute("y")
    scene.carriage, scene.fork = RigidBody(3.0, (0.1, 0.1, 0.1)), RigidBody(0.5, (0.01, 0.02, 0.02), (-0.05, 0, 0.1))
    scene.wheel, scene.contact = RigidBody.disk(0.4, 0.1, axis="y"), RollingDisk(0.1)
    scene.connect(scene.world.at((0, 0, 0.1)), scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.carriage.frame)
    scene.connect(scene.carriage.frame, scene.pivot.frame_a)
    scene.connect(scene.pivot.frame_b, scene.fork.frame)
    scene.connect(scene.fork.at((-trail, 0, 0)), scene.hub.frame_a)
    scene.connect(scene.hub.frame_b, scene.wheel.frame)
    rolling(scene, scene.contact, scene.wheel.frame)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    assert model.system.constraints.vanishing == ("contact[0]",)  # the rail holds the castor at its height
    run = model.simulate(1.0, {scene.pivot.q: 2.5, scene.rail.q: 0.0, scene.rail.v: 1.0}, rtol=1e-12)
    expected = 2 * np.arctan(np.tan(1.25) * np.exp(-run[scene.rail.q].ravel() / trail))
    assert np.max(np.abs(run[scene.pivot.q].ravel() - expected)) < 1e-10
    assert expected[-1] < 0.1


# balls


class PlateOnBalls(ac.System):
    """A plate of mass m on n balls of mass b and radius r, on a slope."""

    def __init__(self, n: int, slope: float, r: float, m: float, b: float) -> None:
        self.world = World((G * np.sin(slope), 0, -G * np.cos(slope)))
        self.plate = RigidBody.box(m, (1.0, 1.0, 0.1), position=(0, 0, 2 * r + 0.05))
        angles = 2 * np.pi * np.arange(n) / n
        self.balls = [RigidBody.ball(b, r, position=(0.4 * np.cos(a), 0.4 * np.sin(a), r)) for a in angles]
        self.below, self.above = [RollingBall(r) for _ in range(n)], [RollingBall(r) for _ in range(n)]
        under = self.plate.at((0, 0, -0.05), rotation=("x", np.pi))
        for ball, below, above in zip(self.balls, self.below, self.above, strict=True):
            rolling(self, below, ball.frame)
            rolling(self, above, ball.frame, under)


@pytest.mark.parametrize("balls", [3, 4])
def test_plate_moves_in_its_plane_and_each_ball_may_spin(balls):
    model = ac.build(PlateOnBalls(balls, 0.2, 0.1, 4.0, 0.5))
    assert model.degrees_of_freedom == 3 + balls
    assert len(model.system.constraints.redundant) == balls - 3


def test_plate_on_balls_runs_twice_as_fast_as_they():
    """On a slope x'' = (m + n b / 2) g sin(slope) / (m + n (b + 2 b / 5) / 4) for a plate of mass m on n balls of mass b."""
    slope, r, m, b = 0.2, 0.1, 4.0, 0.5
    scene = PlateOnBalls(3, slope, r, m, b)
    with pytest.warns(ContactWarning, match=r"'above\["):  # the plate runs ahead of its balls and would tip over
        run = ac.build(scene).simulate(
            1.5, {k.frame.position: ac.near(k.sketch_pose().position) for k in scene.balls}, rtol=1e-12
        )
    plate = run[scene.plate.frame.position]
    expected = 0.5 * (m + 1.5 * b) * G * np.sin(slope) / (m + 1.05 * b) * run.t**2
    assert np.max(np.abs(plate - plate[0] - expected[:, None] * [1, 0, 0])) < 1e-10
    for ball in scene.balls:
        p = run[ball.frame.position]
        assert np.max(np.abs(2 * (p - p[0]) - (plate - plate[0]))) < 1e-10
        assert np.max(np.abs(p[:, 2] - r)) < 1e-13
    assert run.constraint_error() < 1e-12


def test_ball_on_a_turntable_runs_around_circles():
    """On a plane that turns with W the centre of a homogeneous ball goes around a circle with 2 W / 7 (Milne 1948)."""
    W, r = 3.0, 0.1
    scene = ac.System()
    scene.world, scene.bearing, scene.table, scene.motor = World(), Revolute("z"), RigidBody(10.0, (1, 1, 2)), SpeedSource(W)
    scene.connect(scene.world.frame, scene.bearing.frame_a)
    scene.connect(scene.bearing.frame_b, scene.table.frame)
    scene.connect(scene.motor.flange, scene.bearing.flange)
    scene.ball, scene.contact = RigidBody.ball(2.0, r), RollingBall(r)
    rolling(scene, scene.contact, scene.ball.frame, scene.table.frame)
    start = {scene.ball.frame.position[:2]: (0.5, 0.0), scene.ball.frame.velocity[:2]: (0.1, 0.2)}
    run = ac.build(scene).simulate(6.0, start, rtol=1e-12)
    p = run[scene.ball.frame.position]
    rate, z, v = 2 * W / 7, p[:, 0] + 1j * p[:, 1], 0.1 + 0.2j
    assert np.max(np.abs(z - (z[0] + v / (1j * rate) * (np.exp(1j * rate * run.t) - 1)))) < 1e-10


# points that slide


@pytest.mark.parametrize("legs", [3, 4])
def test_table_slides_down_a_smooth_slope(legs):
    slope = 0.3
    scene = ac.System()
    scene.world = World((G * np.sin(slope), 0, -G * np.cos(slope)))
    scene.table, scene.feet = RigidBody(3.0, (0.3, 0.4, 0.5), (0, 0, 0.7)), [PointOnPlane() for _ in range(legs)]
    for k, foot in enumerate(scene.feet):
        angle = 2 * np.pi * k / legs
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.table.at((0.5 * np.cos(angle), 0.5 * np.sin(angle), 0)))
    model = ac.build(scene)
    assert model.degrees_of_freedom == 3
    assert len(model.system.constraints.redundant) == legs - 3
    start = {scene.table.frame.position: (0, 0, 0), scene.table.frame.rotation: ac.near(np.eye(3)),
             scene.table.frame.velocity: (0, 1.0, 0), scene.table.frame.angular_velocity[2]: 2.0}  # fmt: skip
    run = model.simulate(2.0, start, rtol=1e-12)
    expected = np.stack([0.5 * G * np.sin(slope) * run.t**2, run.t, np.zeros_like(run.t)], axis=1)
    assert np.max(np.abs(run[scene.table.frame.position] - expected)) < 1e-10
    assert np.max(np.abs(heading(run, scene.table.frame) - 2.0 * run.t)) < 1e-10


def test_ladder_slides_down_a_smooth_wall():
    """A uniform ladder of length L between floor and wall: b'^2 = 3 g / L (cos b0 - cos b) at the angle b from the wall.

    In truth it leaves the wall where cos b = 2/3 cos b0; here it stays, and that the wall pulls is told.
    """
    length, lean = 4.0, 0.3
    scene = ac.System()
    scene.world, scene.floor, scene.wall = World(), PointOnPlane(), PointOnPlane()
    scene.ladder = RigidBody.rod(10.0, (0, 0, length), radius=0.02)
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ladder.frame)
    scene.connect(scene.world.at((0, 0, 0), rotation=("y", np.pi / 2)), scene.wall.frame_a)
    scene.connect(scene.wall.frame_b, scene.ladder.tip)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 4
    start = {scene.ladder.frame.position: (length * np.sin(lean), 0, 0), scene.ladder.tip.position: (0, 0, length * np.cos(lean))}
    with pytest.warns(ContactWarning, match=r"'wall' \(.*\) pulls, with .* N at t = 1 s"):
        run = model.simulate(1.0, start, rtol=1e-12)
    assert run[scene.ladder.frame.position][-1, 0] > length * np.sin(np.arccos(2 / 3 * np.cos(lean)))
    foot, top = run[scene.ladder.frame.position], run[scene.ladder.tip.position]
    angle = np.arctan2(foot[:, 0], top[:, 2])
    rate = run[scene.ladder.frame.velocity][:, 0] / (length * np.cos(angle))
    inertia = (
        1 / 3 + (0.02 / (2 * length)) ** 2
    )  # about the middle and its way, by m L^2: 1/12 + 1/4, and a little for the thickness
    assert angle[-1] > 0.6
    assert np.max(np.abs(inertia * rate**2 - G / length * (np.cos(lean) - np.cos(angle)))) < 1e-11
    assert np.max(np.abs(top[:, :2])) < 1e-12


# bodies that spin


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize(
    "hub",
    [Revolute("y"), Revolute("-y"), Revolute((0.2, 1, 0.3)), Cylindrical("y"), Screw("y", 0.1), Universal("y", "x")],
    ids=repr,
)
def test_balanced_wheels_are_a_limit_of_unbalanced_ones(hub, backwards):
    """Where a wheel is balanced its spin is left out of the equations; a little out of balance it is not. Both must agree."""
    unbalance = 1e-9

    def accelerations(excess: float) -> np.ndarray:
        joint = copy.deepcopy(hub)
        scene = ac.System()
        scene.world, scene.contact, scene.hub, scene.axle = World(), RollingDisk(0.3), joint, Revolute("z")
        scene.wheel, scene.frame = RigidBody(1.0, (0.02 + excess, 0.04, 0.02)), RigidBody(2.0, (0.1, 0.2, 0.25), (0.1, 0.2, 0.3))
        scene.rotor = RigidBody(0.5, (0.01 + excess, 0.01, 0.015), (0, 0, 0.1))
        rolling(scene, scene.contact, scene.wheel.frame)
        a, b = (joint.frame_b, joint.frame_a) if backwards else (joint.frame_a, joint.frame_b)
        scene.connect(scene.wheel.at((0, 0.1, 0)), a)
        scene.connect(b, scene.frame.frame)
        scene.connect(scene.frame.at((0.2, 0, 0.3), rotation=("x", 0.4)), scene.axle.frame_a)
        scene.connect(scene.axle.frame_b, scene.rotor.frame)
        system = (model := ac.build(scene)).system
        x = np.random.default_rng(4).uniform(-0.9, 0.9, system.x.numel())
        seen = [scene.rotor.at((0.1, 0.2, 0)).acceleration, joint.frame_a.torque, joint.frame_b.force, scene.contact.frame_b.force,
                scene.axle.frame_a.torque, scene.wheel.frame.angular_acceleration]  # fmt: skip
        outputs = [model.functions.output(entry)(0.0, x, [], []) for entry in seen]
        return np.concatenate([np.array(o).ravel() for o in (*outputs, model.functions.explicit_dynamics(0.0, x, [], []))])

    exact, near = accelerations(0.0), accelerations(unbalance)
    assert np.max(np.abs(exact - near)) < 200 * unbalance
    assert np.max(np.abs(exact - near)) > 0


@pytest.mark.parametrize(("size", "torque"), [(1e-3, 0.05), (1.0, 0.1), (1e3, 1.0)])
def test_a_robot_on_two_driven_wheels_and_a_skid_runs_straight_and_turns_in_tens_of_steps(size: float, torque: float) -> None:
    """By both torques it goes ahead, by their difference it turns; straight on, rates of turning are nothing but rounding, which no tolerance is to follow."""
    r, half, Iw = 0.1, 0.2, 0.5 * 0.5 * 0.1**2
    scene = ac.System()
    scene.world, scene.skid = World((0, 0, -G * size)), PointOnPlane()
    scene.body = RigidBody(5.0, (0.1 * size**2, 0.1 * size**2, 0.2 * size**2))
    scene.wheels = [RigidBody.disk(0.5, r * size, axis="y") for _ in range(2)]
    scene.axles, scene.torques = [Revolute("y"), Revolute("y")], [ac.Input("N*m"), ac.Input("N*m")]
    scene.motors, scene.touches = [TorqueSource(u) for u in scene.torques], [RollingDisk(r * size) for _ in range(2)]
    for wheel, axle, motor, touch, y in zip(scene.wheels, scene.axles, scene.motors, scene.touches, (half, -half), strict=True):
        scene.connect(scene.body.at((0, y * size, 0)), axle.frame_a)
        scene.connect(axle.frame_b, wheel.frame)
        scene.connect(motor.flange, axle.flange)
        rolling(scene, touch, wheel.frame)
    rolling(scene, scene.skid, scene.body.at((-0.2 * size, 0, -r * size)))
    model, frame, (left, right) = ac.build(scene), scene.body.frame, scene.torques
    start, unit = {frame.position: (0, 0, r * size)}, size**2
    for rtol in (1e-3, 1e-4, 1e-5, 1e-7, 1e-10):
        run = model.simulate(1.0, start, inputs={left: torque * unit, right: torque * unit}, rtol=rtol)
        assert run.statistics.steps < 100
        ahead = 2 * torque / r / (6.0 + 2 * Iw / r**2)
        assert np.linalg.norm(run[frame.velocity][-1]) / size == pytest.approx(ahead, rel=1e-9)
    run = model.simulate(1.0, start, inputs={left: lambda t: torque * unit * np.sin(2 * t), right: 0.1 * unit}, rtol=1e-10)
    turned = 0.1 - torque * (1 - np.cos(2.0)) / 2  # integral of the difference
    J = 0.2 + 2 * (0.5 * (r**2 / 4 + half**2)) + 2 * Iw * (half / r) ** 2
    assert run[frame.angular_velocity][-1, 2] == pytest.approx(turned * half / r / J, rel=1e-8)
