"""Classical systems of engineering dynamics from parts of the catalogue alone, each against a closed form or the equations of a textbook.

Chapters are those of O. M. O'Reilly, Intermediate Dynamics for Engineers (2nd ed.). Others of its systems are in the tests of guides, fields, wheels and
closed forms.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import acausal as ac
from acausal import curvilinear, errors, rotations
from acausal.language.expression import sx
from components import (
    AccelerationSource,
    Accelerometer,
    AngularAccelerationSource,
    Cable,
    CamFollower,
    CartesianTranslation,
    CentralField,
    DCMotor,
    Drag,
    Fixed,
    Force,
    Ground,
    Gyro,
    Inertia,
    Line,
    LineOfAction,
    MagnusForce,
    MutualGravitation,
    Particle,
    Planar,
    PointOnCurve,
    PointOnPlane,
    PointOnSurface,
    PrescribedAngularVelocity,
    PrescribedMotion,
    Prismatic,
    Revolute,
    RigidBody,
    Rod,
    RotatingEarth,
    SpeedSource,
    Sphere,
    Spherical,
    Spring,
    SteeredAxle,
    Torque,
    TranslationalGround,
    TranslationalSpring,
    VoltageSource,
    World,
)
from examples.classical.whirling_rotor import CRITICAL, OFF, Rotor

G = 9.81


def ode(rate, start, times) -> np.ndarray:
    """Values at the times, (n, m)."""
    return solve_ivp(rate, (times[0], times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13).y.T


# 1: coordinates of a particle


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e7])
def test_a_free_particle_is_told_in_cylindrical_and_spherical_coordinates(size):
    """In a straight line past the axis: r = sqrt(b^2 + v^2 t^2), phi = atan(v t / b), and their rates, also on the axis itself."""
    scene = ac.System()
    scene.world, scene.bob = World(None), Particle(1.0)
    p = scene.bob.point.position
    r, phi, z = curvilinear.cylindrical(p)
    R, azimuth, polar = curvilinear.spherical(p)
    start = {p: curvilinear.at_cylindrical(2 * size, 0.5, 0.3 * size), ac.der(r): size, ac.der(phi): -0.7, ac.der(z): 0.2 * size}
    run = ac.build(scene).simulate(3.0, start, rtol=1e-12)
    e = np.array([[np.cos(0.5), np.sin(0.5), 0], [-np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    velocity = size * (e[0] - 1.4 * e[1] + 0.2 * e[2])
    assert np.max(np.abs(run[scene.bob.point.velocity] - velocity)) < 1e-12 * size
    at = run[p]
    assert np.max(np.abs(run[r] - np.hypot(at[:, 0], at[:, 1]))) < 1e-12 * size
    assert np.max(np.abs(run[polar] - np.arccos(at[:, 2] / run[R]))) < 1e-9
    assert np.max(np.abs(run[azimuth] - run[phi])) < 1e-13
    along = curvilinear.base_vectors((r, phi, z), p)
    assert (
        np.max(
            np.abs(
                run[along.T @ scene.bob.point.velocity]
                - np.column_stack([run[ac.der(r)], run[r] * run[ac.der(phi)], run[ac.der(z)]])
            )
        )
        < 1e-11 * size
    )
    parabolic = curvilinear.chart(lambda p: (ca.sqrt(ca.norm_2(p) + p[2]), ca.sqrt(ca.norm_2(p) - p[2]), ca.atan2(p[1], p[0])), p)
    assert np.max(np.abs(run[parabolic[0]] * run[parabolic[1]] - run[r])) < 1e-9 * size


CHARTS: dict[str, Callable[[Any], Any]] = {
    "cylindrical": curvilinear.cylindrical,
    "spherical": curvilinear.spherical,
    "parabolic": lambda p: curvilinear.chart(lambda p: (ca.sqrt(ca.norm_2(p) + p[2]), ca.sqrt(ca.norm_2(p) - p[2]), np.arctan2(p[1], p[0])), p),
}  # fmt: skip


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("chart", CHARTS.values(), ids=CHARTS)
def test_starts_are_found_by_curvilinear_coordinates_from_the_place_where_these_have_no_value(chart, size):
    """All bodies are drawn in one place: there lengths have no slope, and angles are anything."""
    scene = ac.System()
    scene.world, scene.bob, scene.ship = World(gravity=(0, 0, 0)), Particle(0.7), RigidBody(2.0, (1.0, 1.5, 2.0))
    seen = scene.ship.frame.rotation.T @ (scene.bob.point.position - scene.ship.frame.position)
    x, rng = ca.SX.sym("x", 3), np.random.default_rng(7)
    place, velocity = rng.normal(size=(2, 3)) * size
    read = ca.Function("read", [x], [ca.vertcat(*(sx(q) for q in chart(x)))])
    values, rates = np.array(read(place)).ravel(), np.array(read.jacobian()(place, 0)) @ velocity
    q = chart(seen)
    start = dict(zip([*q, *map(ac.der, q)], [*values, *rates], strict=True))
    run = ac.build(scene).simulate(0.1 * size, start | {scene.ship.frame.angular_velocity: (0.3, -0.2, 0.1)}, samples=2)
    assert run[seen][0] / size == pytest.approx(place / size, abs=1e-11)
    assert run[ac.der(seen)][0] / size == pytest.approx(velocity / size, abs=1e-10)


def test_values_of_charts_and_rotations_are_called_by_name_where_they_cannot_be_met():
    scene = ac.System()
    scene.world, scene.body = World(), RigidBody(1.0, (1.0, 1.5, 2.0))
    R, azimuth, polar = curvilinear.spherical(scene.body.frame.position)
    angles = rotations.euler_angles(scene.body.frame.rotation, "intrinsic zxz")
    model = ac.build(scene)
    for start, said in (
        ({R: 1.0, azimuth: 0.3, polar: 4.0}, r"polar angle\(body\.frame\) = 4 "),
        ({angles: (0.1, -0.2, 0.3)}, r"intrinsic zxz\(body\.frame\) = \(0\.1, -0\.2, 0\.3\)"),
        ({ac.der(angles[1]): np.nan}, r"der\(intrinsic zxz\(body\.frame\)\[1\]\)"),
    ):
        with pytest.raises(errors.StartValueError, match=said):
            model.simulate(1.0, start)


def test_coordinates_do_not_end_a_motion_through_the_axis():
    scene = ac.System()
    scene.world, scene.bob = World(None), Particle(1.0)
    r, _, _ = curvilinear.cylindrical(scene.bob.point.position)
    run = ac.build(scene).simulate(2.0, {scene.bob.point.position: (1, 0, 0), scene.bob.point.velocity: (-1, 0, 0)}, samples=5)
    assert np.max(np.abs(run[r] - np.abs(1 - run.t))) < 1e-13


# 2: gravitation


def test_two_masses_circle_about_their_centre_as_kepler_says():
    """Distance a(1 - e^2) / (1 + e cos nu); the period 2 pi sqrt(a^3 / G(m + M))."""
    scene = ac.System()
    scene.world, scene.law, scene.one, scene.two = World(None), MutualGravitation(2.0), Particle(3.0), Particle(1.0)
    a, e, mu = 1.5, 0.6, 2.0 * 4.0
    speed = np.sqrt(mu / a * (1 + e) / (1 - e))
    start = {
        scene.one.point.position: (0, 0, 0), scene.two.point.position: (a * (1 - e), 0, 0),
        scene.one.point.velocity: (0, -speed / 4, 0), scene.two.point.velocity: (0, 3 * speed / 4, 0),
    }  # fmt: skip
    run = ac.build(scene).simulate(2 * np.pi * np.sqrt(a**3 / mu), start, rtol=1e-12)
    apart = run[scene.two.point.position] - run[scene.one.point.position]
    nu = np.arctan2(apart[:, 1], apart[:, 0])
    assert np.max(np.abs(np.linalg.norm(apart, axis=1) - a * (1 - e**2) / (1 + e * np.cos(nu)))) < 1e-10
    assert np.max(np.abs(apart[-1] - apart[0])) < 1e-9
    assert run.energy_error() < 1e-12


def test_three_masses_chase_one_another_along_an_eight():
    """A. Chenciner, R. Montgomery, Annals of Mathematics 152 (2000); digits by C. Simo."""
    scene = ac.System()
    scene.world, scene.law, scene.masses = World(None), MutualGravitation(1.0), [Particle(1.0) for _ in range(3)]
    p, v = np.array([0.97000436, -0.24308753, 0]), np.array([-0.93240737, -0.86473146, 0])
    places, speeds = (p, -p, 0 * p), (-v / 2, -v / 2, v)
    start = {m.point.position: x for m, x in zip(scene.masses, places, strict=True)}
    start |= {m.point.velocity: x for m, x in zip(scene.masses, speeds, strict=True)}
    period = 6.32591398
    run = ac.build(scene).simulate(period, start, rtol=1e-12, samples=4)
    order = [scene.masses[k] for k in (0, 2, 1)]
    for mass, x in zip(scene.masses, places, strict=True):
        assert np.max(np.abs(run[mass.point.position][-1] - x)) < 1e-7
    ends = {tuple(np.round(run[m.point.position][1], 5)) for m in order}  # a third later each is where another was
    assert ends == {tuple(np.round(x, 5) + 0.0) for x in (run[m.point.position][0] for m in order)}


def test_bodies_feel_each_other_s_shape():
    """Two bodies of general inertia: momentum, angular momentum and energy stay."""
    scene = ac.System()
    scene.world, scene.law = World(None), MutualGravitation(1.0)
    scene.one, scene.two = RigidBody(3.0, (0.02, 0.03, 0.04), (0.1, 0, 0)), RigidBody(2.0, (0.03, 0.03, 0.01))
    one, two = scene.one.frame, scene.two.frame
    start = {
        one.position: (0, 0, 0),
        two.position: (1, 0, 0.2),
        two.velocity: (0, 2.0, 0.3),
        one.angular_velocity: (0.1, 2.0, 0.5),
    }
    run = ac.build(scene).simulate(3.0, start, rtol=1e-11)
    total, moment = 0.0, 0.0
    for body, m in ((scene.one, 3.0), (scene.two, 2.0)):
        v, p = run[body.centre.velocity], run[body.centre.position]
        R, w = run[body.frame.rotation], run[body.frame.angular_velocity]
        total = total + m * v
        moment = moment + m * np.cross(p, v) + np.einsum("nij,jk,nlk,nl->ni", R, np.asarray(body.central_inertia), R, w)
    assert np.max(np.abs(total - total[0])) < 1e-11 and np.max(np.abs(moment - moment[0])) < 1e-10
    assert run.energy_error() < 1e-11


# 7: on surfaces


def test_a_spherical_pendulum_circles_at_constant_height():
    """Conical motion: w^2 = g / (l cos theta)."""
    scene = ac.System()
    scene.world, scene.bowl, scene.bob = World(), PointOnSurface(Sphere(2.0)), Particle(0.3)
    scene.connect(scene.world.frame, scene.bowl.frame_a)
    scene.connect(scene.bowl.frame_b, scene.bob.point)
    theta = 0.8
    rate = np.sqrt(G / (2.0 * np.cos(theta)))
    p = scene.bob.point.position
    _, azimuth, _ = curvilinear.spherical(p)
    start = {p: curvilinear.at_spherical(2.0, 0.0, np.pi - theta), scene.bob.point.velocity: (0, 2 * np.sin(theta) * rate, 0)}
    run = ac.build(scene).simulate(3.0, start, rtol=1e-12)
    assert np.max(np.abs(run[p][:, 2] + 2 * np.cos(theta))) < 1e-11
    assert np.max(np.abs(np.sin(run[azimuth] - rate * run.t))) < 1e-10


def test_a_bead_in_a_groove_of_a_spinning_cone_is_thrown_out():
    """Chapter 2.9: s'' = w^2 sin^2(a) s - g cos(a) along the groove, w the spin of the cone, a its half angle."""
    scene = ac.System()
    a, w = 0.4, 7.0
    scene.world, scene.spin = World(), PrescribedMotion(angle=w * ac.time)
    scene.groove, scene.bead = PointOnCurve(Line((np.sin(a), 0, np.cos(a)))), Particle(0.2)
    scene.connect(scene.world.frame, scene.spin.frame_a)
    scene.connect(scene.spin.frame_b, scene.groove.frame_a)
    scene.connect(scene.groove.frame_b, scene.bead.point)
    run = ac.build(scene).simulate(1.0, {scene.groove.q: 1.5}, rtol=1e-12)
    k, rest = w * np.sin(a), G * np.cos(a) / (w * np.sin(a)) ** 2
    assert np.max(np.abs(run[scene.groove.q] - rest - (1.5 - rest) * np.cosh(k * run.t))) < 1e-11
    assert run.energy_error() < 1e-12


# 19: balls in air


def test_a_baseball_that_spins_flies_as_a_linear_law_says():
    """Chapter 9.6: m v' = m g - c v + k w x v; the exponential of a matrix."""
    scene = ac.System()
    scene.world, scene.ball, scene.air, scene.lift = World(), RigidBody.ball(0.145, 0.0366), Drag(linear=0.05), MagnusForce(2e-4)
    for part in (scene.air.point, scene.lift.point):
        scene.connect(part, scene.ball.frame)
    w, v0 = np.array([20.0, 150.0, 60.0]), np.array([40.0, 1.0, 3.0])
    start = {scene.ball.frame.velocity: v0, scene.ball.frame.angular_velocity: w}
    run = ac.build(scene).simulate(2.0, start, rtol=1e-12)
    A = (2e-4 * np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]) - 0.05 * np.eye(3)) / 0.145
    steady = -np.linalg.solve(A, [0, 0, -G])
    for t, v in zip(run.t[::50], run[scene.ball.frame.velocity][::50], strict=True):
        assert np.max(np.abs(v - steady - expm(A * t) @ (v0 - steady))) < 1e-10


# 20: tops


def test_a_top_on_ice_nods_as_its_energy_says():
    """Poisson's top, chapter 10.9: its tip slides on a smooth plane, so that its centre only rises and falls.

    (I + m l^2 sin^2 u) u'' = -m l^2 sin u cos u u'^2 + (p_psi - p_phi cos u)(p_psi cos u - p_phi) / (-I sin^3 u) + m g l sin u.
    """
    m, arm, J, C = 0.5, 0.08, 8e-4, 5e-4
    scene = ac.System()
    scene.world, scene.tip, scene.top = World(), PointOnPlane(), RigidBody(m, (J, J, C), (0, 0, arm))
    scene.connect(scene.world.frame, scene.tip.frame_a)
    scene.connect(scene.tip.frame_b, scene.top.frame)
    angles = rotations.euler_angles(scene.top.frame.rotation, "intrinsic zxz")
    u0, precession, spin = 0.5, 3.0, 150.0
    start = {angles: (0.0, u0, 0.0), ac.der(angles): (precession, 0.0, spin), scene.top.centre.velocity[:2]: (0.3, 0.0)}
    run = ac.build(scene).simulate(1.0, start, rtol=1e-11)
    own = C * (precession * np.cos(u0) + spin)
    about = J * np.sin(u0) ** 2 * precession + own * np.cos(u0)

    def rate(_, y):
        u, du = y
        s, c = np.sin(u), np.cos(u)
        turn = (about - own * c) * (about * c - own) / (J * s**3)
        return [du, (turn - m * arm * arm * s * c * du * du + m * G * arm * s) / (J + m * arm * arm * s * s)]

    assert np.max(np.abs(run[angles[1]] - ode(rate, [u0, 0.0], run.t)[:, 0])) < 1e-8
    assert np.ptp(run[angles[1]]) > 0.02
    assert np.max(np.abs(run[scene.top.centre.velocity][:, :2] - (0.3, 0.0))) < 1e-10


# 23: satellites


def test_roll_and_yaw_of_a_satellite_are_coupled_by_its_orbit():
    """Small librations on a circular orbit, P. Hughes, Spacecraft Attitude Dynamics (1986), 9.2: with k1 = (I2 - I3) / I1 and k3 = (I2 - I1) / I3
    for axes forward, across the orbit and down, roll'' + 4 n^2 k1 roll = n (1 - k1) yaw', yaw'' + n^2 k3 yaw = -n (1 - k3) roll'."""
    scene = ac.System()
    J = np.array([0.9, 1.0, 0.4]) * 1e-12
    scene.world, scene.earth, scene.body = World(None), CentralField(1.0), RigidBody(1.0, tuple(J))
    k1, k3 = (J[1] - J[2]) / J[0], (J[1] - J[0]) / J[2]
    size = 1e-5
    # forward +y, down -x, so across -z, at the start
    level = np.column_stack([(0, 1, 0), (0, 0, -1), (-1, 0, 0)])
    first = level @ Rotation.from_euler("ZYX", (0.7 * size, 0.0, size)).as_matrix()
    start = {
        scene.body.frame.position: (1, 0, 0), scene.body.frame.velocity: (0, 1, 0), scene.body.frame.rotation: first,
        scene.body.frame.angular_velocity: (0, 0, 1.0),
    }  # fmt: skip
    run = ac.build(scene).simulate(8.0, start, rtol=1e-12)
    c, s, z = np.cos(run.t), np.sin(run.t), 0 * run.t
    orbital = np.stack([np.stack([-s, c, z], 1), np.stack([z, z, z - 1], 1), np.stack([-c, -s, z], 1)], 2)
    yaw, _, roll = Rotation.from_matrix(orbital.transpose(0, 2, 1) @ run[scene.body.frame.rotation]).as_euler("ZYX").T
    # at rest against the orbital frame: rates of the angles are zero
    exact = ode(
        lambda t, y: [y[2], y[3], -4 * k1 * y[0] + (1 - k1) * y[3], -k3 * y[1] - (1 - k3) * y[2]], [size, 0.7 * size, 0, 0], run.t
    )
    assert np.max(np.abs(np.column_stack([roll, yaw]) - exact[:, :2])) < 50 * size**2


def test_a_dual_spin_satellite_moves_as_a_gyrostat():
    """Chapter 11: J w' = -w x (J w + h), h the spin of a rotor that its motor keeps at constant speed against the body."""
    scene = ac.System()
    scene.world, scene.body, scene.shaft, scene.rotor = (
        World(None),
        RigidBody(10.0, (2.0, 3.0, 2.5)),
        Revolute("y"),
        RigidBody.disk(1.0, 0.5, "y"),
    )
    scene.motor = SpeedSource(40.0)
    scene.connect(scene.body.frame, scene.shaft.frame_a)
    scene.connect(scene.shaft.frame_b, scene.rotor.frame)
    scene.connect(scene.motor.flange, scene.shaft.flange)
    w0 = np.array([0.3, 0.8, -0.2])
    run = ac.build(scene).simulate(10.0, {scene.body.frame.angular_velocity: w0}, rtol=1e-12)
    J = np.diag([2.0, 3.0, 2.5]) + np.asarray(scene.rotor.central_inertia)
    h = np.array([0, 40.0 * np.asarray(scene.rotor.central_inertia)[1, 1], 0])
    exact = ode(lambda t, w: np.linalg.solve(J, -np.cross(w, J @ w + h)), w0, run.t)
    R = run[scene.body.frame.rotation]
    assert np.max(np.abs(np.einsum("nji,nj->ni", R, run[scene.body.frame.angular_velocity]) - exact)) < 1e-9
    momentum = np.einsum("nij,nj->ni", R, exact @ J.T + h)
    assert np.max(np.abs(momentum - momentum[0])) < 1e-9


@pytest.mark.parametrize("ratio", [0.5, 2.0])
def test_an_unbalanced_rotor_whirls(ratio):
    """Chapter 11: on a shaft of stiffness k at the speed r sqrt(k / m) its centre runs along a circle of radius e r^2 / (1 - r^2)."""
    scene, w = Rotor(), ratio * CRITICAL
    radius = OFF * ratio**2 / (1 - ratio**2)
    run = ac.build(scene).simulate(2.0, {scene.x.q: radius, scene.y.v: radius * w}, parameters={scene.speed: w}, rtol=1e-12)
    assert np.max(np.abs(run[scene.x.q] - radius * np.cos(w * run.t))) < 1e-11
    assert run.energy_error() < 1e-9


# 26: cars, drives


def test_a_single_track_car_drives_in_a_circle():
    """Its rear axle runs at v: the heading turns at v tan(steer) / wheelbase."""
    scene = ac.System()
    scene.world, scene.road, scene.car = World(None), Planar(), RigidBody(1000.0, (1e3, 1e3, 1.5e3))
    scene.front, scene.rear = SteeredAxle(lambda t: 0.1 + 0.05 * ca.sin(t)), SteeredAxle()
    scene.connect(scene.world.frame, scene.road.frame_a, scene.front.road, scene.rear.road)
    scene.connect(scene.road.frame_b, scene.car.frame)
    scene.connect(scene.car.at((1.2, 0, 0)), scene.front.chassis)
    scene.connect(scene.car.at((-1.3, 0, 0)), scene.rear.chassis)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(5.0, {scene.car.at((-1.3, 0, 0)).velocity[0]: 10.0}, rtol=1e-11)
    axle = scene.car.at((-1.3, 0, 0))
    rear = np.einsum("ni,nij->nj", run[axle.velocity], run[axle.rotation])
    assert np.max(np.abs(rear[:, 1])) < 1e-9
    assert (
        np.max(np.abs(run[scene.car.frame.angular_velocity][:, 2] - rear[:, 0] * np.tan(0.1 + 0.05 * np.sin(run.t)) / 2.5)) < 1e-9
    )


def test_a_motor_reaches_the_speed_that_its_losses_allow():
    """w = V k / (k^2 + R d) / ratio; all that the battery gives is stored or lost."""
    scene = ac.System()
    scene.battery, scene.ground, scene.motor, scene.load = (
        VoltageSource(12.0),
        Ground(),
        DCMotor(0.05, 1.2, 1e-3, 2e-5, 50, 1e-5),
        Inertia(0.1),
    )
    scene.connect(scene.battery.pin_a, scene.motor.pin_a)
    scene.connect(scene.battery.pin_b, scene.motor.pin_b, scene.ground.pin)
    scene.connect(scene.motor.flange, scene.load.flange_a)
    model = ac.build(scene)
    assert len(model.state_names) == 3
    run = model.simulate(20.0, rtol=1e-10)
    assert abs(run[scene.load.w][-1] - 12 * 0.05 / (0.05**2 + 1.2e-5) / 50) < 1e-9
    assert run.energy_error() < 1e-8


@pytest.mark.parametrize("turning", [True, False])
def test_accelerations_are_given_by_functions_and_inputs(turning):
    for given in (lambda t: np.sin(t), ac.Input()):
        scene = ac.System()
        scene.world = World()
        scene.joint, scene.drive = (
            (Revolute("y"), AngularAccelerationSource(given)) if turning else (Prismatic("z"), AccelerationSource(given))
        )
        scene.body = RigidBody(2.0, (0.1, 0.2, 0.3), (0.1, 0, 0.2))
        scene.connect(scene.world.frame, scene.joint.frame_a)
        scene.connect(scene.joint.frame_b, scene.body.frame)
        scene.connect(scene.joint.flange, scene.drive.flange)
        inputs = {given: lambda t: np.sin(t)} if isinstance(given, ac.Input) else {}
        run = ac.build(scene).simulate(2.0, {scene.joint.v: 0.4}, inputs=inputs, rtol=1e-11)
        assert np.max(np.abs(run[scene.joint.q] - 1.4 * run.t + np.sin(run.t))) < 1e-10
        assert run.energy_error() < 1e-10


# cables


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e5])
def test_two_weights_on_a_cable_fall_as_atwood_says(size):
    """a = g (m - M) / (m + M), tension 2 g m M / (m + M), and what an eyelet feels."""
    scene = ac.System()
    scene.world, scene.one, scene.two = World((0, 0, -G * size)), Particle(2.0), Particle(1.0)
    scene.rope = Cable(3.0 * size, over=(scene.world.at((-0.2 * size, 0, 0)), scene.world.at((0.2 * size, 0, 0))))
    scene.connect(scene.rope.frame_a, scene.one.point)
    scene.connect(scene.rope.frame_b, scene.two.point)
    start = {scene.one.point.position: (-0.2 * size, 0, -size), scene.two.point.position: (0.2 * size, 0, -1.6 * size)}
    run = ac.build(scene).simulate(0.5, start, rtol=1e-10)
    assert np.max(np.abs(run[scene.one.point.acceleration] - (0, 0, -G * size / 3))) < 1e-10 * size
    assert np.max(np.abs(run[scene.rope.tension] - 4 / 3 * G * size)) < 1e-10 * size
    first, second = scene.rope.pieces[:2]
    felt = -run[first.frame_b.force] - run[second.frame_a.force]
    assert np.max(np.abs(felt - np.array((4, 0, -4)) / 3 * G * size)) < 1e-10 * size
    assert run.energy_error() < 1e-12 and run.constraint_error() < 1e-12 * max(size, 1.0)


def test_a_weight_under_a_table_draws_a_puck_towards_its_hole():
    """(m + M) r'' = m h^2 / r^3 - M g, h = r^2 phi'."""
    scene = ac.System()
    scene.world, scene.x, scene.y, scene.puck, scene.rail, scene.weight = (
        World(),
        Prismatic("x"),
        Prismatic("y"),
        Particle(1.0),
        Prismatic("z"),
        Particle(0.5),
    )
    scene.rope = Cable(2.0, over=(scene.world.frame,))
    scene.connect(scene.world.frame, scene.x.frame_a, scene.rail.frame_a)
    scene.connect(scene.x.frame_b, scene.y.frame_a)
    scene.connect(scene.y.frame_b, scene.puck.point, scene.rope.frame_a)
    scene.connect(scene.rail.frame_b, scene.weight.point, scene.rope.frame_b)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 2
    run = model.simulate(3.0, {scene.x.q: 1.0, scene.y.q: 0.0, scene.rail.q: ac.near(-1.0), scene.y.v: 3.0}, rtol=1e-11)
    r, _, _ = curvilinear.cylindrical(scene.puck.point.position)
    exact = ode(lambda t, y: [y[1], (9.0 / y[0] ** 3 - 0.5 * G) / 1.5], [1.0, 0.0], run.t)
    assert np.max(np.abs(run[r] - exact[:, 0])) < 1e-8
    assert run.energy_error() < 1e-10


def test_a_hoist_with_a_moving_pulley_carries_twice_its_pull():
    """Ground, loose pulley, fixed pulley, counterweight: the load hangs on two pieces; by Lagrange (M + 4 m) x'' = (2 m - M) g upwards."""
    scene = ac.System()
    M, m = 3.0, 1.0
    scene.world, scene.load, scene.weight, scene.rails = (
        World(),
        RigidBody.ball(M, 0.1),
        Particle(m),
        [Prismatic("z") for _ in range(2)],
    )
    scene.rope = Cable(5.0, over=(scene.load.frame, scene.world.at((0, 0, 2.0))))
    scene.connect(scene.world.at((0, 0, 2.0)), scene.rope.frame_a)
    scene.connect(scene.world.frame, scene.rails[0].frame_a, scene.rails[1].frame_a)
    scene.connect(scene.rails[0].frame_b, scene.load.frame)
    scene.connect(scene.rails[1].frame_b, scene.weight.point, scene.rope.frame_b)
    run = ac.build(scene).simulate(0.5, {scene.rails[0].q: 0.3, scene.rails[1].q: ac.near(0.4)}, rtol=1e-11)
    assert np.max(np.abs(run[scene.rails[0].q] - 0.3 - 0.5 * (2 * m - M) * G / (M + 4 * m) * run.t**2)) < 1e-11
    assert np.max(np.abs(run[scene.rope.tension] - m * (G - 2 * (2 * m - M) * G / (M + 4 * m)))) < 1e-9
    assert run.energy_error() < 1e-11


def test_a_spring_on_a_line_of_action_is_a_spring_between_points():
    ends = []
    for by_line in (False, True):
        scene = ac.System()
        scene.world, scene.ball, scene.rod = World(), Spherical(), RigidBody.rod(1.0, (0, 0, -1), radius=0.1)
        scene.connect(scene.world.frame, scene.ball.frame_a)
        scene.connect(scene.ball.frame_b, scene.rod.frame)
        if by_line:
            scene.line, scene.spring, scene.foot = LineOfAction(), TranslationalSpring(30.0, 0.4), TranslationalGround()
            scene.connect(scene.spring.flange_a, scene.foot.flange)
            scene.connect(scene.line.flange, scene.spring.flange_b)
        else:
            scene.line = Spring(30.0, 0.4)
        a, b = (scene.line.frame_a, scene.line.frame_b) if by_line else (scene.line.point_a, scene.line.point_b)
        scene.connect(scene.world.at((1, 0.2, 0)), a)
        scene.connect(scene.rod.tip, b)
        scene.bob, scene.way, scene.tie = Particle(0.5), CartesianTranslation(), Rod(0.7)  # the only row of all loops
        scene.connect(scene.world.frame, scene.way.frame_a)
        scene.connect(scene.way.frame_b, scene.bob.point)
        scene.connect(scene.world.at((3, 0, 0)), scene.tie.frame_a)
        scene.connect(scene.tie.frame_b, scene.bob.point)
        run = ac.build(scene).simulate(1.0, {scene.ball.v: (1.0, 2.0, 3.0), scene.way.q: (3.0, 0, -0.7)}, rtol=1e-10)
        assert run.energy_error() < 1e-9
        ends.append((run[scene.rod.tip.position], run[b.force], run[scene.ball.frame_b.force]))
    for one, two in zip(*ends, strict=True):
        assert np.max(np.abs(one - two)) < 1e-7


# 27: navigation


def test_an_accelerometer_feels_what_is_not_gravity():
    """At rest on a tilted table it reads g upwards; in a free fall about the earth nothing; on an arm that turns the centripetal acceleration."""
    scene = ac.System()
    scene.world, scene.box = World(), Accelerometer(bias=(0.01, 0, 0))
    scene.connect(scene.world.at((0, 0, 1), rotation=("x", 0.3)), scene.box.frame)
    scene.arm, scene.spin, scene.end, scene.gyro = (
        RigidBody.rod(1.0, (2.0, 0, 0)),
        PrescribedMotion(angle=3.0 * ac.time),
        Accelerometer(),
        Gyro(),
    )
    scene.connect(scene.world.frame, scene.spin.frame_a)
    scene.connect(scene.spin.frame_b, scene.arm.frame)
    scene.connect(scene.arm.tip, scene.end.frame, scene.gyro.frame)
    run = ac.build(scene).simulate(1.0)
    assert np.max(np.abs(run[scene.box.reading] - (0.01, G * np.sin(0.3), G * np.cos(0.3)))) < 1e-13
    assert np.max(np.abs(run[scene.end.reading] - (-18.0, 0, G))) < 1e-12
    assert np.max(np.abs(run[scene.gyro.reading] - (0, 0, 3.0))) < 1e-13
    orbit = ac.System()
    orbit.world, orbit.field, orbit.body, orbit.box = World(None), CentralField(1.0), RigidBody.ball(1.0, 1e-9), Accelerometer()
    orbit.connect(orbit.body.frame, orbit.box.frame)
    run = ac.build(orbit).simulate(1.0, {orbit.body.frame.position: (1, 0, 0), orbit.body.frame.velocity: (0, 1.1, 0)})
    assert np.max(np.abs(run[orbit.box.reading])) < 1e-13


def test_navigation_equations_follow_an_aircraft():
    """Latitude, longitude, height and velocities north, east and down integrated from what accelerometer and gyro read, as an inertial navigator does.

    v' = f + g - (2 w_earth + w_transport) x v - w_earth x (w_earth x r), P. Savage, Strapdown Analytics (2000); against the simulated motion.
    """
    scene = ac.System()
    scene.earth, scene.plane, scene.box, scene.gyro = RotatingEarth(), RigidBody(2.0, (0.1, 0.2, 0.25)), Accelerometer(), Gyro()
    scene.connect(scene.plane.frame, scene.box.frame, scene.gyro.frame)
    scene.push, scene.turn = (
        Force((3.0, 1.0, -19.0), resolved_in="body"),
        Torque(lambda t: (0, 0.01 * ca.sin(t), 0), resolved_in="body"),
    )
    scene.connect(scene.push.point, scene.plane.frame)
    scene.connect(scene.turn.frame, scene.plane.frame)
    where = scene.earth.whereabouts(scene.plane.frame)
    R0, mu, rate = 6371000.0, 3.986004418e14, 7.292115e-5
    start = {
        scene.plane.frame.position: scene.earth.place(0.5, 0.3, 1e4), where.velocity: (150.0, 80.0, -3.0), scene.plane.frame.angular_velocity: (0, 1e-3, 2e-3),
    }  # fmt: skip
    run = ac.build(scene).simulate(20.0, start, rtol=1e-12, samples=2001)
    level = where.axes.T @ scene.earth.fixed.rotation.T @ scene.plane.frame.rotation
    f, w = (CubicSpline(run.t, run[sensor.reading]) for sensor in (scene.box, scene.gyro))

    def navigator(t, y):
        lat, h, v, C = y[0], y[2], y[3:6], y[6:].reshape(3, 3)
        r = R0 + h
        earth = rate * np.array([np.cos(lat), 0, -np.sin(lat)])
        along = np.array([v[1] / r, -v[0] / r, -v[1] * np.tan(lat) / r])
        down = np.array([0, 0, mu / r**2]) - np.cross(earth, np.cross(earth, (0, 0, -r)))
        W = lambda a: np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])  # noqa: E731
        turn = C @ W(w(t)) - W(earth + along) @ C
        return [v[0] / r, v[1] / (r * np.cos(lat)), -v[2], *(C @ f(t) + down - np.cross(2 * earth + along, v)), *turn.ravel()]

    y0 = [0.5, 0.3, 1e4, 150.0, 80.0, -3.0, *run[level][0].ravel()]
    found = ode(navigator, y0, np.array([0.0, 20.0]))[-1]
    assert np.max(np.abs(found[:2] - (run[where.latitude][-1], run[where.longitude][-1]))) < 1e-10
    assert abs(found[2] - run[where.height][-1]) < 1e-4
    assert np.max(np.abs(found[3:6] - run[where.velocity][-1])) < 1e-5
    assert np.max(np.abs(found[6:] - run[level][-1].ravel())) < 1e-8


def test_what_falls_on_a_turning_earth_comes_down_to_the_east():
    """Dropped from a tower of height h at latitude phi: rate g cos(phi) t^3 / 3 to the east, to first order, g less the centrifugal part; exactly as Coriolis' law says."""
    latitude, rate, R0, mu = 0.6, 1e-3, 1e6, G * 1e12
    scene = ac.System()
    scene.earth = RotatingEarth(mu=mu, radius=R0, rate=rate)
    top, scene.stone = scene.earth.level(latitude, 0.2, 500.0), Particle(1.0)
    where = scene.earth.whereabouts(scene.stone.point)
    start = {scene.stone.point.position: scene.earth.place(latitude, 0.2, 500.0), where.velocity: (0, 0, 0)}
    run = ac.build(scene).simulate(8.0, start, rtol=1e-12, samples=3)
    fallen = run[top.rotation.T @ (scene.stone.point.position - top.position)]
    turn = np.array([0, 0, rate])

    def rate_of(_, y):
        r, v = y[:3], y[3:]
        return [*v, *(-mu * r / np.linalg.norm(r) ** 3 - 2 * np.cross(turn, v) - np.cross(turn, np.cross(turn, r)))]

    first = (R0 + 500) * np.array([np.cos(latitude) * np.cos(0.2), np.cos(latitude) * np.sin(0.2), np.sin(latitude)])
    last = ode(rate_of, [*first, 0, 0, 0], np.array([0.0, 8.0]))[-1]
    east = np.array([-np.sin(0.2), np.cos(0.2), 0])
    assert abs(fallen[-1, 1] - east @ (last[:3] - first)) < 1e-7
    assert abs(fallen[-1, 1] / (rate * (G - rate**2 * R0 * np.cos(latitude) ** 2) * np.cos(latitude) * 8.0**3 / 3) - 1) < 0.05


# drives in space


def test_a_frame_is_turned_as_told_by_angles_samples_and_angular_velocities():
    """Euler angles of time, a spline of quaternions, and the angular velocity of the first: one motion of a pendulum on that frame."""
    t = np.linspace(0, 2.0, 15)
    angles = lambda t: (0.3 * t, 0.2 * ca.sin(t), 0.1 * ca.cos(t) - 0.1)  # noqa: E731
    quaternions = Rotation.from_euler("ZYX", np.column_stack([0.3 * t, 0.2 * np.sin(t), 0.1 * np.cos(t) - 0.1])).as_quat()
    s = ac.time
    R = rotations.euler("intrinsic zyx", angles(s))
    W = R.T @ ac.der(R)
    drives = [
        PrescribedMotion(rotation=("intrinsic zyx", angles)), PrescribedMotion(rotation=lambda t: rotations.euler("intrinsic zyx", angles(t))),
        PrescribedMotion(rotation=("quaternion xyzw", CubicSpline(t, quaternions))), PrescribedAngularVelocity((W[2, 1], W[0, 2], W[1, 0])),
    ]  # fmt: skip
    ends = []
    for drive in drives:
        scene = ac.System()
        scene.world, scene.drive, scene.arm, scene.hinge, scene.rod = (
            World(),
            drive,
            Fixed((1, 0, 0)),
            Revolute("y"),
            RigidBody.rod(1.0, (0, 0, -1)),
        )
        scene.connect(scene.world.frame, scene.drive.frame_a)
        scene.connect(scene.drive.frame_b, scene.arm.frame_a)
        scene.connect(scene.arm.frame_b, scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.rod.frame)
        run = ac.build(scene).simulate(2.0, rtol=1e-11)
        assert run.energy_error() < 1e-10
        ends.append(run[scene.rod.tip.position])
    assert np.max(np.abs(ends[1] - ends[0])) < 1e-11
    assert np.max(np.abs(ends[2] - ends[0])) < 1e-4  # samples
    assert np.max(np.abs(ends[3] - ends[0])) < 1e-9


@pytest.mark.parametrize(
    "make, words",
    [
        (
            lambda: PrescribedMotion(rotation=lambda t: (1 + t) * rotations.euler("intrinsic zyx", (t, 0, 0))),
            "orthogonal matrix at t = ",
        ),
        (lambda: PrescribedAngularVelocity((Revolute("x").q, 0, 0)), "rate is not known"),
        (lambda: CamFollower(lambda phi: 0.1), "depends on the angle"),
        (lambda: DCMotor(0.05, 1.0, inductance=-1.0), "inductance"),
        (lambda: SteeredAxle((1, 2)), "steer"),
        (lambda: Cable(1.0, over=World()), "points or frames"),
        (lambda: Cable(-1.0), "length"),
        (lambda: curvilinear.cylindrical((1, 2)), "three coordinates"),
        (lambda: curvilinear.base_vectors(curvilinear.cylindrical((1, 2, 3)), (1, 2, 3)), "place itself"),
    ],
)
def test_wrong_drives_and_coordinates_are_refused_with_the_line(make, words):
    with pytest.raises((errors.ParameterError, errors.ExpressionError), match=words) as found:
        make()
    assert "test_systems.py:" in str(found.value)


def test_specific_force_beside_masses_that_attract_each_other_is_refused_in_words():
    scene = ac.System()
    scene.world, scene.law, scene.one, scene.two = World(None), MutualGravitation(), Particle(1.0), Particle(1.0)
    with pytest.raises(errors.UnknownVariableError, match="itself a source"):
        run = ac.build(scene).simulate(1.0, {scene.one.point.position: (1, 0, 0)})
        run[scene.one.point.specific_force]
