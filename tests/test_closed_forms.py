"""Motions whose solution is known: closed forms, and numbers computed in quadruple precision by an independent program."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import acausal as ac
from components import (
    Particle,
    Revolute,
    RigidBody,
    RollingBall,
    RollingDisk,
    RollingEllipsoid,
    SlidingMass,
    Spherical,
    Spring,
    TranslationalGround,
    TranslationalSpring,
    World,
)
from tests.pairings import each_value
from tests.scenes import PointPendulum, rotation

G = 9.81


def test_pendulum_follows_elliptic_functions():
    scene = PointPendulum()
    model = ac.build(scene)
    amplitude = 2.5
    run = model.simulate(20.0, {scene.hinge.q: amplitude}, rtol=1e-13)
    k = np.sin(amplitude / 2) ** 2
    sn, _, _, _ = ellipj(ellipk(k) - np.sqrt(G) * run.t, k)
    assert np.max(np.abs(run[scene.hinge.q] - 2 * np.arcsin(np.sqrt(k) * sn))) < 1e-11


def test_pendulum_of_ten_seconds_in_cartesian_coordinates():
    """IFToMM benchmark A01, in quadruple precision."""
    scene = PointPendulum()
    run = ac.build(scene).simulate(10.0, {scene.hinge.q: np.pi / 2}, rtol=1e-13)
    at = run.at([1.0, 5.0, 10.0])[scene.bob.point.position]
    reference = [
        (0.98629175113187532688, -0.16501085312554112376),
        (-0.94230543504375722675, -0.33475433841400088689),
        (-0.27508746257611580151, -0.96141920509912536714),
    ]
    assert np.max(np.abs(at[:, [0, 2]] - reference)) < 1e-12


def test_symmetric_free_body_precesses_as_euler_found():
    scene = ac.System()
    scene.world, scene.body = World(None), RigidBody(1.0, (2.0, 2.0, 3.0))
    model = ac.build(scene)
    w = np.array([0.3, 0.0, 2.0])
    run = model.simulate(10.0, {scene.body.frame.angular_velocity: w}, rtol=1e-13)
    own = np.einsum("nji,nj->ni", run[scene.body.frame.rotation], run[scene.body.frame.angular_velocity])
    rate = (3.0 - 2.0) / 2.0 * w[2]
    exact = np.stack([0.3 * np.cos(rate * run.t), 0.3 * np.sin(rate * run.t), np.full(run.t.size, 2.0)], axis=1)
    assert np.max(np.abs(own - exact)) < 1e-12


def test_free_body_flips_about_its_middle_axis():
    """Dzhanibekov's body, 100 s with repeated flips; quadruple precision."""
    scene = ac.System()
    scene.world, scene.body = World(None), RigidBody(1.0, (1.0, 2.0, 3.0))
    run = ac.build(scene).simulate(100.0, {scene.body.frame.angular_velocity: (0.001, 5.0, 0.001)}, rtol=1e-13)
    at = run.at([50.0, 100.0])
    own = np.einsum("nji,nj->ni", at[scene.body.frame.rotation], at[scene.body.frame.angular_velocity])
    reference = [
        (4.74650758425484643565, 1.571835472500611898823, 2.740397553116991219398),
        (0.002427752750572381600162, -4.999999510601634257748, 0.001622136802483251771112),
    ]
    # in the middle of a flip (50 s) rounding errors have grown to 1e-7, whatever the step size; between flips (100 s) to 1e-10
    assert np.max(np.abs(own - reference), axis=1)[0] < 3e-7
    assert np.max(np.abs(own - reference), axis=1)[1] < 1e-9
    momentum = np.einsum(
        "nij,nj->ni",
        run[scene.body.frame.rotation],
        np.einsum("nji,nj->ni", run[scene.body.frame.rotation], run[scene.body.frame.angular_velocity]) * [1, 2, 3],
    )
    assert np.max(np.abs(momentum - momentum[0])) < 1e-12 * np.linalg.norm(momentum[0])


def top() -> ac.System:
    scene = ac.System()
    scene.world, scene.socket = World(), Spherical()
    scene.body = RigidBody(15.0, (0.234375, 0.46875, 0.234375), (0, 1, 0))
    scene.connect(scene.world.frame, scene.socket.frame_a)
    scene.connect(scene.socket.frame_b, scene.body.frame)
    return scene


def test_heavy_top():
    """Lie-group benchmark of Bruls, Cardona and Arnold; quadruple precision."""
    scene = top()
    run = ac.build(scene).simulate(2.0, {scene.socket.v: (0, 150.0, -4.61538)}, rtol=1e-13)
    at = run.at([1.0, 2.0])[scene.body.centre.position]
    reference = [
        (0.1733439640983860268465, 0.6400885920705687175556, -0.7484907911335813689771),
        (-0.1504168227456418402816, -0.7241655916368957529361, -0.6730222695604439681124),
    ]
    assert np.max(np.abs(at - reference)) < 1e-11


def test_top_precesses_steadily():
    """Steady precession: (A cos) W^2 - C s W + m g l = 0 with A about the fixed point; tilt from the vertical stays."""
    scene = ac.System()
    scene.world, scene.socket = World(), Spherical()
    m, length, A0, C, tilt, spin = 2.0, 0.3, 0.05, 0.03, 0.6, 200.0
    scene.body = RigidBody(m, (A0, A0, C), (0, 0, length))
    scene.connect(scene.world.frame, scene.socket.frame_a)
    scene.connect(scene.socket.frame_b, scene.body.frame)
    A = A0 + m * length**2
    c = np.cos(tilt)
    a, b, d = (A - C) * c, -C * spin, m * G * length  # spin: rate about the axis relative to the precessing frame
    precession = (-b - np.sqrt(b * b - 4 * a * d)) / (2 * a)
    q = (np.cos(tilt / 2), np.sin(tilt / 2), 0, 0)
    w = (0.0, precession * np.sin(tilt), spin + precession * c)
    run = ac.build(scene).simulate(3.0, {scene.socket.q: q, scene.socket.v: w}, rtol=1e-12)
    centre = run[scene.body.centre.position]
    assert np.max(np.abs(centre[:, 2] - length * c)) < 1e-9
    turned = np.unwrap(np.arctan2(centre[:, 1], centre[:, 0]))
    assert abs((turned[-1] - turned[0]) / 3.0 - precession) < 1e-8


def test_ball_rolls_down_an_incline():
    scene = ac.System()
    slope = 0.3
    scene.world = World((G * np.sin(slope), 0, -G * np.cos(slope)))
    scene.ball, scene.contact = RigidBody.ball(2.0, 0.1), RollingBall(0.1)
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    run = ac.build(scene).simulate(2.0, {scene.contact.v: (0.0, 2.0, 3.0)}, rtol=1e-12)
    x = run[scene.ball.frame.position]
    assert np.max(np.abs(x[:, 0] - (0.2 * run.t + 5 / 14 * G * np.sin(slope) * run.t**2))) < 1e-10
    assert np.max(np.abs(x[:, 1:] - [0, 0.1])) < 1e-10
    force = run[scene.contact.frame_b.force]  # friction holds back 2/7 of the weight's part along the slope
    assert np.max(np.abs(-force[:, 0] + 2 / 7 * 2.0 * G * np.sin(slope))) < 1e-8


def test_disk_rolls_in_a_steady_circle():
    """O'Reilly 10.8: a disk that leans by b rolls around with rate W and spin s when the moments about the contact balance:
    (C + m r^2) (s + W sin b) W cos b = A W^2 sin b cos b - m g r sin b."""
    m, r, lean, W = 1.0, 0.3, 0.4, 1.0
    A, C = m * r * r / 4, m * r * r / 2
    sin, cos = np.sin(lean), np.cos(lean)
    scene = ac.System()
    scene.world, scene.disk, scene.contact = World(), RigidBody.disk(m, r, axis="y"), RollingDisk(r, "y")
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.disk.frame)
    along = (A * W * W * sin * cos - m * G * r * sin) / ((C + m * r * r) * W * cos)
    start = {scene.contact.q: (0, lean, 0, 0, 0), scene.contact.v: (0.0, along, W * cos)}
    model = ac.build(scene)
    run = model.simulate(5.0, start, rtol=1e-12)
    q, spin = run[scene.contact.q], along - W * sin
    # what rounding makes of a wobble that nothing brings back is a matter of luck in one run, not in many
    runs = [model.simulate(5.0, start, rtol=float(rtol)) for rtol in np.geomspace(1e-9, 1e-13, 15)]
    wobbles = [np.max(np.abs(one[scene.contact.v] - [0, along, W * cos])) for one in runs]
    assert np.median(wobbles) < 7e-13 and max(wobbles) < 1e-12 * abs(along)
    assert np.max(np.abs(q[:, 0] - W * run.t)) < 1e-12
    assert np.max(np.abs(q[:, 1] - lean)) < 1e-12
    assert np.max(np.abs(q[:, 2] - spin * run.t)) < 1e-11
    assert np.max(np.abs(q[:, 3:] - r * along / W * np.stack([np.sin(W * run.t), 1 - np.cos(W * run.t)], axis=1))) < 1e-12
    assert np.max(np.abs(run[scene.disk.frame.position][:, 2] - r * cos)) < 1e-13


def test_rattleback_reverses_its_spin():
    """Ellipsoid of Kane, Levinson and Kuypers: first 10 s; quadruple precision."""
    scene = ac.System()
    scene.world = World()
    tilt = 0.1  # principal axes of inertia are turned against those of the ellipsoid by delta about the vertical
    c, s = np.cos(tilt), np.sin(tilt)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    inertia = R @ np.diag([0.0002, 0.0016, 0.0017]) @ R.T
    scene.contact = RollingEllipsoid((0.2, 0.03, 0.02))
    scene.stone = RigidBody(1.0, inertia, (0, 0, -0.001))
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.stone.frame)
    run = ac.build(scene).simulate(5.0, {scene.contact.v: (0.01, -0.02, -2.0)}, rtol=1e-12)
    assert run.energy_error() < 1e-10
    spin = run.at(np.linspace(0, 5, 5001))[scene.contact.v][:, 2]
    crossing = np.flatnonzero(np.diff(np.sign(spin)))[0]
    first = np.interp(0.0, [spin[crossing], spin[crossing + 1]], [crossing * 1e-3, (crossing + 1) * 1e-3])
    assert abs(first - 1.14629001) < 2e-6


def test_stiff_spring_pendulum():
    """k = 1e4 N/m, undamped; quadruple precision."""
    scene = ac.System()
    scene.world, scene.bob, scene.spring = World(), Particle(1.0), Spring(1e4, 1.0)
    scene.connect(scene.world.frame, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.bob.point)
    run = ac.build(scene).simulate(10.0, {scene.bob.point.position: (1, 0, 0)}, rtol=1e-12)
    assert (
        np.max(np.abs(run.at(10.0)[scene.bob.point.position][0] - [0.3442353236548982647, 0.0, -0.94182182549807786119])) < 1e-8
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_motion_does_not_depend_on_the_choice_of_axes(seed):
    """The same spatial double pendulum in two world frames."""
    R = rotation(seed)

    def scene_in(turn: np.ndarray) -> tuple[ac.System, dict]:
        vec = lambda *v: tuple(turn @ np.array(v, dtype=float))  # noqa: E731
        scene = ac.System()
        scene.world, scene.one, scene.two = World(vec(0, 0, -G)), Revolute(vec(1, 0.2, 0)), Revolute(vec(0, 1, 0.3))
        scene.upper, scene.lower = RigidBody.rod(1.0, vec(0.1, 0, -1)), RigidBody.rod(1.5, vec(0, 0.2, -0.7))
        scene.connect(scene.world.frame, scene.one.frame_a)
        scene.connect(scene.one.frame_b, scene.upper.frame)
        scene.connect(scene.upper.tip, scene.two.frame_a)
        scene.connect(scene.two.frame_b, scene.lower.frame)
        return scene, {scene.one.q: 0.8, scene.two.q: -0.4, scene.two.v: 1.0}

    plain, start = scene_in(np.eye(3))
    turned, turned_start = scene_in(R)
    a = ac.build(plain).simulate(2.0, start, rtol=1e-12)[plain.lower.tip.position]
    b = ac.build(turned).simulate(2.0, turned_start, rtol=1e-12)[turned.lower.tip.position]
    assert np.max(np.abs(a @ R.T - b)) < 1e-10


@each_value(("count", [8, 10, 25]), (("rtol", "length"), [(1e-6, 1.0), (1e-12, 1e-9)]))
def test_a_row_of_oscillators_plucked_at_rest_is_the_sum_of_its_modes(count, rtol, length):
    """The far ones begin as high a power of time as there are springs between: no step resolves a part of that."""
    scene = ac.System()
    scene.walls, scene.masses = [TranslationalGround(), TranslationalGround()], [SlidingMass(0.1) for _ in range(count)]
    scene.springs = [TranslationalSpring(40.0) for _ in range(count + 1)]
    before = [scene.walls[0].flange, *(mass.flange_b for mass in scene.masses)]
    behind = [*(mass.flange_a for mass in scene.masses), scene.walls[1].flange]
    for spring, a, b in zip(scene.springs, before, behind, strict=True):
        scene.connect(a, spring.flange_a)
        scene.connect(spring.flange_b, b)
    run = ac.build(scene).simulate(4.0, {scene.masses[2].s: length}, rtol=rtol)
    n = np.arange(1, count + 1)
    rates = 2 * np.sqrt(40.0 / 0.1) * np.sin(n * np.pi / (2 * count + 2))
    shapes = np.sqrt(2 / (count + 1)) * np.sin(np.outer(n, n) * np.pi / (count + 1))
    exact = (shapes[2] * length * np.cos(run.t[:, None] * rates)) @ shapes
    found = np.stack([run[mass.s] for mass in scene.masses], axis=1)
    assert np.max(np.abs(found - exact)) < max(rtol, 1e-13) * length


def ball_points() -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and weights (n,) of a cubature of the unit ball that is exact for squares."""
    r, w = np.polynomial.legendre.leggauss(4)
    radii, directions = (r + 1) / 2, np.concatenate([np.eye(3), -np.eye(3)])
    weights = np.repeat(w / 2 * 3 * radii**2, 6) / 6
    return (radii[:, None, None] * directions).reshape(-1, 3), weights


def disk_points() -> tuple[np.ndarray, np.ndarray]:
    """The same of a cylinder of radius 1 about z from -1 to 1."""
    r, w = np.polynomial.legendre.leggauss(4)
    radii, turns = (r + 1) / 2, np.arange(8) * np.pi / 4
    points = np.array([(a * np.cos(b), a * np.sin(b), c) for a in radii for b in turns for c in r])
    weights = np.array([u * a * v / 8 / 2 for u, a in zip(w, radii, strict=True) for _ in turns for v in w])
    return points, weights


def box_points() -> tuple[np.ndarray, np.ndarray]:
    """The same of a cube from -1 to 1."""
    r, w = np.polynomial.legendre.leggauss(3)
    points = np.array([(a, b, c) for a in r for b in r for c in r])
    return points, np.array([a * b * c / 8 for a in w for b in w for c in w])


@pytest.mark.parametrize(
    ("body", "points", "sizes"),
    [
        (RigidBody.ellipsoid(1.5, (0.2, 0.3, 0.5)), ball_points, (0.2, 0.3, 0.5)),
        (RigidBody.ball(1.5, 0.4), ball_points, (0.4, 0.4, 0.4)),
        (RigidBody.box(1.5, (0.2, 0.3, 0.5)), box_points, (0.1, 0.15, 0.25)),
        (RigidBody.cylinder(1.5, 0.2, 0.7), disk_points, (0.2, 0.2, 0.35)),
        (RigidBody.disk(1.5, 0.2), disk_points, (0.2, 0.2, 0.0)),
        (RigidBody.rod(1.5, (0, 0, 0.7), radius=0.2), disk_points, (0.2, 0.2, 0.35)),
    ],
    ids=["ellipsoid", "ball", "box", "cylinder", "disk", "rod"],
)
def test_shapes_have_the_moments_of_inertia_of_what_fills_them(body, points, sizes):
    """About their centres, by cubature of all that fills them, to a few roundings."""
    places, weights = points()
    places = places * np.array(sizes)
    filled = 1.5 * (np.sum(weights * np.sum(places**2, axis=1)) * np.eye(3) - places.T @ (weights[:, None] * places))
    assert np.sum(weights) == pytest.approx(1.0, rel=1e-14)
    np.testing.assert_allclose(body.central_inertia, filled, rtol=0, atol=1e-14)
