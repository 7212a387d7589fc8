"""Contacts by law: bodies that roll, slide with friction, or yield and part; closed forms, and what is told."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import beta

import acausal as ac
from acausal import errors
from acausal.parts.contact import AbstractContact
from components import (
    Apart,
    Cone,
    Contact,
    ContactForce,
    ConvexShape,
    Creep,
    Cylinder,
    Disk,
    Ellipsoid,
    HeightField,
    HuntCrossley,
    Parallel,
    Plane,
    Revolute,
    RigidBody,
    RollingCone,
    RollingCylinder,
    RollingDisk,
    Sliding,
    SmoothCoulomb,
    Sphere,
    Torus,
    Touching,
    Viscous,
    World,
)
from components.geometry.surfaces import AbstractSurface
from tests.test_guides import on

G = 9.81


def test_a_ball_meets_a_plane_as_hertz_says():
    """Depth (5 m v^2 / (4 k))^(2/5), and a time of contact of 4/5 B(2/5, 1/2) depth / v = 2.943 depth / v."""
    m, speed, law = 2.0, 0.7, HuntCrossley.hertz(modulus=1e9, radius=0.1)
    scene = on(Contact(Sphere(0.1), Plane(), law), RigidBody.ball(m, 0.1), (0, 0, 0))
    k = 4 / 3 * 1e9 * np.sqrt(0.1)
    depth = (5 * m * speed**2 / (4 * k)) ** 0.4
    time = 4 / 5 * beta(2 / 5, 1 / 2) * depth / speed
    frame = scene.body.frame
    run = ac.build(scene).simulate(
        1.5 * time, {frame.position: (0, 0, 0.1), frame.velocity: (0, 0, -speed)}, rtol=1e-12, atol=1e-15
    )
    assert abs(-run[scene.guide.gap].min() / depth - 1) < 1e-3  # of samples
    assert abs((run.t[-1] - run[scene.guide.gap][-1].item() / speed) / time - 1) < 1e-9
    assert abs(run[frame.velocity][-1, 2] / speed - 1) < 1e-9


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("ground", [Plane(), HeightField(lambda x, y: 0.0 * x)], ids=["closed form", "followed"])
def test_what_just_touches_begins_whatever_the_length_of_the_run(ground: AbstractSurface, size: float):
    """A ball with its mass beside its middle, laid down on a ground that yields, against Newton's and Euler's laws: 1.5 of a depth is a law that ends there."""
    m, r, k = 2.0, 0.1 * size, 2.0 * G / (1e-3 * size) ** 1.5
    J, c, seconds = (
        size**2 * np.array([0.01, 0.015, 0.02]),
        size * np.array([0.01, -0.02, -0.03]),
        np.geomspace(5e-3, 0.5, 20) * np.sqrt(size),
    )

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        height, R, speed, w = y[0], y[1:10].reshape(3, 3), y[10], y[11:]
        push = k * max((R @ c)[2] - height, 0.0) ** 1.5  # of the centre of mass over where the middle was
        turn = np.cross(R, w)  # each row of R times the matrix of w
        return np.hstack([speed, turn.ravel(), push / m - G, (np.cross(-c, push * R[2]) - np.cross(w, J * w)) / J])

    begin = np.hstack([c[2], np.eye(3).ravel(), np.zeros(4)])
    exact = solve_ivp(rate, (0, seconds[-1]), begin, "DOP853", seconds, rtol=1e-12, atol=1e-15)
    scene = on(Contact(Sphere(r), ground, HuntCrossley(k)), RigidBody(m, np.diag(J), c), (0, 0, -G))
    model, frame = ac.build(scene), scene.body.frame
    for n, time in enumerate(seconds):
        run = model.simulate(time, {frame.position: (0, 0, r), frame.rotation: np.eye(3)}, rtol=1e-9)
        assert run[scene.body.centre.position][-1, 2] - r == pytest.approx(exact.y[0, n], abs=1e-8 * size)
        assert run[frame.rotation][-1].ravel() == pytest.approx(exact.y[1:10, n], abs=1e-8)


def test_a_damped_impact_loses_what_its_law_says():
    """1 + c v' of the rate: v' - ln(1 + c v') / c at the end is what it was at the beginning."""
    c, speed = 0.8, 0.5
    scene = on(Contact(Sphere(0.1), Plane(), HuntCrossley(1e6, damping=c, exponent=1.0)), RigidBody.ball(1.0, 0.1), (0, 0, 0))
    frame = scene.body.frame
    run = ac.build(scene).simulate(0.02, {frame.position: (0, 0, 0.1), frame.velocity: (0, 0, -speed)}, rtol=1e-12, atol=1e-15)
    after = run[frame.velocity][-1, 2]
    keeps = lambda rate: rate - np.log(1 + c * rate) / c  # noqa: E731
    assert 0 < after < speed and abs(keeps(speed) - keeps(-after)) < 1e-9
    assert run.energy_error() < 1e-9


@pytest.mark.parametrize(
    "surface", [Plane(), Sphere(2.0), HeightField(lambda x, y: 0.1 * x * x)], ids=["plane", "ball", "heights"]
)
def test_a_ball_that_slides_in_oil_begins_to_roll(surface):
    """On the level: its slip decays with 7 c / (2 m), and its speed tends to 5/7."""
    m, c, r, speed = 1.0, 2.0, 0.1, 1.0
    scene = on(Contact(Sphere(r), surface, Viscous(c)), RigidBody.ball(m, r))
    frame, contact = scene.body.frame, scene.guide
    start = {contact.q[4:]: [0.0] * (contact.q.size - 4), contact.v: (0, 0, 0, speed, 0)} if surface.start == (0.0, 0.0) else {frame.angular_velocity: (0, 0, 0), contact.slip[0]: speed}  # fmt: skip
    run = ac.build(scene).simulate(1.0, start, rtol=1e-11)
    assert run.energy_error() < 1e-11
    assert np.max(np.abs(run[contact.friction_force] + c * run[contact.slip])) < 1e-13
    if isinstance(surface, Plane):
        slip = np.linalg.norm(run[contact.slip], axis=1)
        assert np.max(np.abs(slip - speed * np.exp(-3.5 * c / m * run.t))) < 1e-11
        assert np.max(np.abs(run[frame.velocity][:, 0] - speed * (5 + 2 * np.exp(-3.5 * c / m * run.t)) / 7)) < 1e-11
        assert np.max(np.abs(run[contact.normal_force] - m * G)) < 1e-11


def test_creep_is_linear_where_it_is_small_and_ends_at_its_limit():
    law = Creep(stiffness=4e4, limit=3e3, speed=20.0)
    s = ca.SX.sym("s")
    force = ca.Function("force", [s], [law.resistance(s**2) * s])
    assert abs(float(force(1e-6)) / (4e4 * 1e-6 / 20) - 1) < 1e-9
    assert abs(float(force(1e3)) / 3e3 - 1) < 1e-5
    scene = on(Contact(Torus(0.3, 0.05), Plane(), law), RigidBody(20.0, (0.9, 0.9, 1.6)))
    frame, contact = scene.body.frame, scene.guide
    upright = {frame.rotation: ((1, 0, 0), (0, 0, 1), (0, -1, 0)), frame.angular_velocity: (0, -20 / 0.35, 0)}
    run = ac.build(scene).simulate(0.2, upright | {frame.velocity: (15.0, 0, 0), frame.position[:2]: (0.0, 0.0)}, rtol=1e-10)
    assert run.energy_error() < 1e-10
    assert np.max(np.abs(np.linalg.norm(run[contact.friction_force], axis=1))) < 3e3
    assert np.linalg.norm(run[contact.slip], axis=1)[-1] < 1e-3


def test_a_ball_thrown_on_the_floor_slides_bounces_and_rolls():
    """Whatever happens between: angular momentum about the line that it slides along is kept, so that it ends with 5/7 of its speed."""
    scene = on(Contact(Sphere(0.1), Plane(), HuntCrossley(1e6, 0.5, friction=SmoothCoulomb(0.3, 1e-2))), RigidBody.ball(1.0, 0.1))
    frame = scene.body.frame
    start = {frame.position: (0, 0, 0.15), frame.velocity: (1.0, 0, 0), frame.angular_velocity: (0, 0, 0)}
    run = ac.build(scene).simulate(2.0, start, rtol=1e-9)
    slip = np.linalg.norm(run[scene.guide.slip], axis=1)
    push, across = run[scene.guide.normal_force].ravel(), np.linalg.norm(run[scene.guide.friction_force], axis=1)
    assert push.min() == 0 and np.all(across <= 0.3 * push * (1 + 1e-12))
    assert slip[-1] < 1e-4 and abs(run[frame.velocity][-1, 0] - 5 / 7) < 1e-4
    assert run.energy_error() < 1e-6


@pytest.mark.filterwarnings("ignore::acausal.errors.AccuracyWarning")
@pytest.mark.parametrize("mu", [2e7, 3e7, 3.1e7, 3.4e7])
def test_a_flight_is_as_accurate_as_ever_after_a_friction_that_was_nothing_but_rounding(mu: float):
    """What rounding made of the rates in the contact forgives nothing in the air, where turns of many radians must not be taken in one step."""
    scene = on(Contact(Sphere(0.1), Plane(), HuntCrossley(1e6, 0.3, friction=SmoothCoulomb(mu, 1e-2))), RigidBody.ball(1.0, 0.1))
    frame = scene.body.frame
    run = ac.build(scene).simulate(1.5, {frame.position: (0, 0, 0.5), frame.velocity: (1.0, 0, 0)})
    assert run.constraint_error() < 1e-12


def test_nearest_points_are_followed_where_they_have_no_closed_form():
    """An egg dropped into a bowl of any shape bounces without a loss; over a plane the followed points give the motion that the closed form does."""
    ends = []
    stone = {"mass": 1.0, "inertia": (0.002, 0.003, 0.004)}
    for contact in (Contact(Ellipsoid((0.15, 0.1, 0.08)), Plane(), HuntCrossley(1e4)), Contact(Ellipsoid((0.15, 0.1, 0.08)), HeightField(lambda x, y: 0.0 * x), HuntCrossley(1e4))):  # fmt: skip
        scene = on(contact, RigidBody(**stone))
        frame = scene.body.frame
        start = {
            frame.position: (0, 0, 0.15),
            frame.rotation: np.eye(3),
            frame.velocity: (0.1, 0, 0),
            frame.angular_velocity: (1.0, 2.0, 0),
        }
        run = ac.build(scene).simulate(0.5, start, rtol=1e-11)
        assert run.energy_error() < 1e-9
        ends.append(np.concatenate([run[frame.position][-1], run[frame.rotation][-1].ravel(), run[contact.force][-1] / G]))
    assert np.max(np.abs(ends[0] - ends[1])) < 1e-7
    assert ac.build(scene).degrees_of_freedom == 6


def test_a_disk_rolls_on_its_edge_as_eulers_disk_does():
    """Its centre at rest, it turns around the vertical with W^2 = 4 g / (r sin(a)), a: its angle with the ground. Contacts of a pair made for it are used."""
    r, tilt = 0.1, 0.2
    scene = on(Contact(Disk(r), Plane()), RigidBody.disk(1.0, r, axis="z"))
    assert isinstance(scene.guide.joint, RollingDisk)
    W = np.sqrt(4 * G / (r * np.sin(tilt)))
    axle = np.array([np.sin(tilt), 0, np.cos(tilt)])
    rotation = np.column_stack([np.cross([0, 1, 0], axle), [0, 1, 0], axle])
    frame = scene.body.frame
    lowest = r * np.array([np.cos(tilt), 0, -np.sin(tilt)])  # the contact runs around, the disk rolls: its material there rests
    spin = -W * np.cos(tilt)
    omega = np.array([0, 0, W]) + spin * axle
    assert abs(np.cross(omega, lowest)[1]) < 1e-12
    run = ac.build(scene).simulate(
        2.0, {frame.rotation: rotation, frame.angular_velocity: omega, frame.position[:2]: (0.0, 0.0)}, rtol=1e-12
    )
    p = run[frame.position]
    assert np.max(np.abs(p - p[0])) < 1e-10
    along = run[frame.rotation][:, :, 2] @ [1, 1j, 0]
    assert np.max(np.abs(along - np.sin(tilt) * np.exp(1j * W * run.t))) < 1e-8


def test_a_ball_on_a_ball_leaves_it_where_it_would_pull():
    """From rest at the top it leaves at cos = 10 / 17; held beyond, the run says so by part and line."""
    scene = on(Contact(Sphere(0.1), Sphere(1.0)), RigidBody.ball(2.0, 0.1))
    frame = scene.body.frame
    with pytest.warns(errors.ContactWarning, match=r"guide.*test_contact_laws.py:\d+.* pulls"):
        run = ac.build(scene).simulate(
            1.9, {frame.position: (1.1 * np.sin(1e-3), 0, 1.1 * np.cos(1e-3)), frame.velocity[0]: 0.05}, rtol=1e-11
        )
    push, height = run[scene.guide.normal_force].ravel(), run[frame.position][:, 2] / 1.1
    energy = 0.7 * 0.05**2 / (G * 1.1)  # 7/10 v^2 + g h is kept, m v^2 / R = m g cos - N
    leaves = 10 / 17 * (height[0] + energy)
    assert abs(float(np.interp(leaves, height[::-1], push[::-1]))) < 2e-2
    expected = 2.0 * G * (height - 10 / 7 * (height[0] + energy - height))
    assert np.max(np.abs(push - expected)) < 1e-8


def test_a_ball_on_a_ball_on_a_table():
    """Three in a row, all that touch roll: as Lagrange says in a plane, with the table's ball free."""
    scene = ac.System()
    scene.world, scene.low, scene.high = World(), RigidBody.ball(2.0, 0.2), RigidBody.ball(1.0, 0.1)
    scene.table, scene.top = Contact(Sphere(0.2), Plane()), Contact(Sphere(0.1), Sphere(0.2))
    for a, contact, b in ((scene.world, scene.table, scene.low), (scene.low, scene.top, scene.high)):
        scene.connect(a.frame, contact.frame_a)
        scene.connect(contact.frame_b, b.frame)
    p = scene.high.frame.position
    run = ac.build(scene).simulate(
        0.4, {p: (0.3 * np.sin(0.2), 0, 0.2 + 0.3 * np.cos(0.2)), scene.low.frame.position[:2]: (0.0, 0.0)}, rtol=1e-12
    )

    def rates(t, y):
        """Place of the lower ball and angle of the line of centres from the vertical, with their rates: T by Lagrange."""
        _, a, u, w = y
        M, m, R, r = 2.0, 1.0, 0.2, 0.1
        L = R + r
        # where the balls touch both move alike: the upper turns by (L w - u) / r
        A = np.array(
            [[1.4 * M + m + 0.4 * m, m * L * np.cos(a) - 0.4 * m * L], [m * L * np.cos(a) - 0.4 * m * L, 1.4 * m * L * L]]
        )
        b = np.array([m * L * w * w * np.sin(a), m * G * L * np.sin(a)])
        return [u, w, *np.linalg.solve(A, b)]

    found = solve_ivp(rates, (0, 0.4), [0, 0.2, 0, 0], method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    assert abs(run[scene.low.frame.position][-1, 0] - found[0]) < 1e-11
    assert abs(run[p][-1, 0] - found[0] - 0.3 * np.sin(found[1])) < 1e-11


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Contact(Sphere(0.1), Plane(), SmoothCoulomb(0.3, 1e-3)), "law is"),
        (lambda: Contact(Sphere(0.1), Plane(), 0.3), "law is 0.3"),
        (lambda: Contact(0.1, Plane()), "shape is 0.1"),
        (lambda: Contact(Sphere(0.1), 0.1), "surface is 0.1"),
        (lambda: HuntCrossley(1e6, friction=Viscous(2.0)), "SmoothCoulomb"),
        (lambda: HuntCrossley(1e6, exponent=0.5), "at least 1"),
        (lambda: Touching(Sphere(0.1), Plane(), Viscous(1.0)), "go to Contact"),
        (lambda: Parallel(0.1, 0.1), "surface is 0.1"),
        (lambda: ContactForce(Sphere(0.1), Plane(), Sliding()), "law is"),
    ],
)
def test_what_is_no_law_is_refused_with_the_line(make, words):
    with pytest.raises(errors.ParameterError, match=rf"{words}.*"):
        make()


def test_the_gap_of_a_joint_is_its_last_coordinate():
    joint = Touching(Ellipsoid((0.15, 0.1, 0.08)), Parallel(Torus(1.0, 0.2), 0.1), Apart())
    assert joint.q.size == 7 and joint.v.size == 6
    with pytest.raises(AttributeError, match="no 'q': its bodies may part"):
        Contact(Sphere(0.1), Plane(), HuntCrossley(1e6)).q


def rocker() -> ac.System:
    """A ball between a dome on the ground and a rocker, a cylinder along y on a hinge above: a loop through two contacts."""
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody(1.0, (4e-3, 4.5e-3, 5e-3), (0.01, 0, 0.005))
    scene.low, scene.high = Touching(Sphere(0.1), Sphere(0.5)), Touching(Sphere(0.1), Cylinder(0.2))
    scene.hinge, scene.rocker = Revolute("y"), RigidBody(2.0, (0.05, 0.05, 0.05), (0.0, 0, -0.1))
    scene.connect(scene.world.frame, scene.low.frame_a)
    scene.connect(scene.low.frame_b, scene.ball.frame)
    scene.connect(scene.world.at((0.5, 0, 0.9)), scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rocker.frame)
    scene.connect(scene.rocker.at((-0.5, 0, 0.0), ("x", np.pi / 2)), scene.high.frame_a)
    scene.connect(scene.high.frame_b, scene.ball.frame)
    return scene


@pytest.mark.filterwarnings("ignore:.*pulls:acausal.errors.ContactWarning")  # held on both sides
def test_a_contact_that_closes_a_loop_is_rows_or_coordinates(monkeypatch):
    """Rows of the pose where the nearest points have a closed form; with the contact's own coordinates kept, the motion is the same."""
    ends = []
    for rows in (True, False):
        if not rows:
            monkeypatch.setattr(Touching, "closure", lambda self, X_ab, t: None)
        scene = rocker()
        model = ac.build(scene)
        assert model.degrees_of_freedom == 1
        frame = scene.ball.frame
        start = {
            frame.position[:2]: (0.12, 0.05),
            frame.rotation: np.eye(3),
            scene.hinge.q: ac.near(0.0),
            frame.angular_velocity[1]: 0.2,
        }
        run = model.simulate(0.2, start, rtol=1e-11)
        assert run.energy_error() < 1e-11 and run.constraint_error() < 1e-12
        seen = (frame.position, scene.hinge.q, scene.high.normal_force, scene.high.point_b)
        ends.append(np.concatenate([np.ravel(run[expression][-1]) for expression in seen]))
    assert np.max(np.abs(ends[0] - ends[1])) < 1e-8


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_cylinder_rolls_in_a_cylinder_as_a_longer_pendulum(size):
    """theta'' = -2/3 g / (R - r) sin(theta); outside of it the other way; on a slope it runs down with 2/3 g sin."""
    r, R = 0.1 * size, 0.5 * size
    for side, surface in ((-1, Cylinder(R, inside_out=True)), (1, Cylinder(R))):
        scene = ac.System()
        scene.world, scene.body, scene.roll = (
            World((0, -G * size, 0)),
            RigidBody.cylinder(2.0, r, 0.3 * size),
            RollingCylinder(r, surface),
        )
        scene.connect(scene.world.frame, scene.roll.frame_a)
        scene.connect(scene.roll.frame_b, scene.body.frame)
        model = ac.build(scene)
        assert len(model.state_names) == 2
        begin = 0.9 * side
        run = model.simulate(1.0, {scene.roll.q: R * begin}, rtol=1e-12)
        rate = -2 / 3 * G * size / (R + side * r)
        exact = solve_ivp(
            lambda t, y, k=rate: [y[1], k * np.cos(y[0])], (0, 1.0), [begin, 0], method="DOP853", rtol=1e-13, atol=1e-14
        )
        assert abs(run[scene.roll.q][-1].item() / R - exact.y[0, -1]) < 1e-11
    slope = ac.System()
    slope.world, slope.body, slope.roll = World((G * size, 0, 0)), RigidBody.cylinder(2.0, r, 0.3 * size), RollingCylinder(r)
    slope.connect(slope.world.frame, slope.roll.frame_a)
    slope.connect(slope.roll.frame_b, slope.body.frame)
    run = ac.build(slope).simulate(1.0, {slope.roll.q: 0.0}, rtol=1e-12)
    assert abs(run[slope.roll.q][-1].item() - G * size / 3) < 1e-12 * size
    forward = run[slope.body.frame.angular_velocity][-1]
    assert np.max(np.abs(forward - [0, run[slope.roll.v][-1].item() / r, 0])) < 1e-11


@pytest.mark.parametrize("base", [None, Cone(1.1), Cone(0.5, outside=True)], ids=["plane", "inside", "outside"])
def test_a_cone_rolls_about_the_line_that_touches(base):
    """Its angular velocity is along that line; under a gravity across it swings as a pendulum of the inertia about the line."""
    half, m, along, across, far = 0.3, 2.0, 0.01, 0.05, 0.4
    scene = ac.System()
    scene.world, scene.body = World((G, 0, 0)), RigidBody(m, (across, across, along), (0, 0, far))
    scene.roll = RollingCone(half, base)
    scene.connect(scene.world.frame, scene.roll.frame_a)
    scene.connect(scene.roll.frame_b, scene.body.frame)
    run = ac.build(scene).simulate(1.0, {scene.roll.q: 0.7}, rtol=1e-12)
    alpha, side = (np.pi / 2, 1.0) if base is None else (base.half_angle, base.side)
    q, rate = run[scene.roll.q].ravel(), run[scene.roll.v].ravel()
    line = np.stack([np.sin(alpha) * np.cos(q), np.sin(alpha) * np.sin(q), np.full(q.size, np.cos(alpha))], axis=1)
    turning = rate * np.sin(alpha - side * half) / np.sin(-side * half)
    assert np.max(np.abs(run[scene.body.frame.angular_velocity] - turning[:, None] * line)) < 1e-11
    inertia = (along * np.cos(half) ** 2 + (across + m * far**2) * np.sin(half) ** 2) * (
        np.sin(alpha - side * half) / np.sin(half)
    ) ** 2
    pull = m * G * far * np.sin(alpha - side * half)
    exact = solve_ivp(
        lambda t, y: [y[1], -pull / inertia * np.sin(y[0])], (0, 1.0), [0.7, 0], method="DOP853", rtol=1e-13, atol=1e-14
    )
    assert abs(q[-1] - exact.y[0, -1]) < 1e-10


def test_a_cylinder_too_large_for_the_other_is_refused():
    with pytest.raises(errors.ParameterError, match="does not fit"):
        RollingCylinder(0.5, Cylinder(0.4, inside_out=True))


class Skid(AbstractContact):
    """A point on a plane, by one of one's own; where it touches is what `told` gives."""

    def __init__(self, told) -> None:
        self.told = told

    def closure(self, X_ab, t):
        return X_ab.position[2]

    def touch(self):
        return self.told(self)


@pytest.mark.parametrize("told", [lambda s: None, lambda s: s.frame_b.position, lambda s: (s.frame_b.position, 3.0), lambda s: (s.frame_b.position, s.frame_a.rotation)])  # fmt: skip
def test_a_contact_of_ones_own_that_does_not_say_where_it_touches_is_told(told):
    scene = ac.System()
    scene.world, scene.skid, scene.body = World(), Skid(told), RigidBody.box(1.0, (0.1, 0.1, 0.1))
    scene.connect(scene.world.frame, scene.skid.frame_a)
    scene.connect(scene.skid.frame_b, scene.body.frame)
    with pytest.raises(errors.ModelError, match=r"skid.*touch\(\).*Return the point and the normal"):
        ac.build(scene)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_what_falls_along_a_wall_that_it_touches_does_not_pull(size: float) -> None:
    """Its force is nothing but rounding, which changes little with the states where it comes of what was folded."""
    egg = ConvexShape(lambda n: 0.02 * size * n[2] + 0.1 * size * ca.sqrt(n[0] ** 2 + n[1] ** 2 + 1.5 * n[2] ** 2))
    body = {
        "mass": 2.0,
        "inertia": size**2 * np.array([0.01, 0.015, 0.02]),
        "centre_of_mass": size * np.array([0.01, -0.02, 0.03]),
    }
    for shape in (egg, Ellipsoid((0.15 * size, 0.1 * size, 0.08 * size)), Disk(0.1 * size)):
        scene = on(Contact(shape, Cylinder(0.8 * size), Sliding()), RigidBody(**body), (0, 0, -G))
        run = ac.build(scene).simulate(0.1 * np.sqrt(size))  # warnings are errors
        assert np.max(np.abs(run[scene.guide.normal_force])) < 1e-11


def test_a_contact_of_ones_own_that_pulls_is_told():
    scene = ac.System()
    scene.world, scene.skid = World((0, 0, G)), Skid(lambda s: (s.frame_b.position, s.frame_a.rotation[:, 2]))
    scene.body = RigidBody.box(1.0, (0.1, 0.1, 0.1))
    scene.connect(scene.world.frame, scene.skid.frame_a)
    scene.connect(scene.skid.frame_b, scene.body.frame)
    with pytest.warns(errors.ContactWarning, match=r"'skid' \(tests/test_contact_laws.py:\d+\) pulls, with 9.81 N"):
        run = ac.build(scene).simulate(0.1, rtol=1e-10)
    assert abs(run[scene.skid.normal_force][-1].item() + G) < 1e-12
