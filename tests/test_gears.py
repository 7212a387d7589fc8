"""Gears between joints: freedoms, motion, reactions on what carries the joints, energy, messages."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal.errors import ParameterError, StartValueError
from components import (
    AngleSource,
    Gear,
    Inertia,
    Prismatic,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    SlidingMass,
    Torque,
    TorqueSource,
    World,
)
from components.gears import ElasticGear, PlanetaryGear, RackAndPinion
from examples.engine import steel_cylinder
from examples.gyroscopic import SpinningRotor
from tests import modelica_scenes as scenes
from tests.modelica_scenes import join


def crossed(w: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) of w x."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def turned(R0: np.ndarray, times: np.ndarray, w0: np.ndarray, rate) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (n, 3, 3) and angular velocities (n, 3) of Euler's equations w' = rate(R, w), in body axes."""

    def derivative(t, y):
        R, w = y[:9].reshape(3, 3), y[9:]
        return np.concatenate([(R @ crossed(w)).ravel(), rate(R, w)])

    y = solve_ivp(
        derivative, (times[0], times[-1]), np.concatenate([R0.ravel(), w0]), method="DOP853", rtol=1e-12, atol=1e-13, t_eval=times
    ).y
    return y[:9].T.reshape(-1, 3, 3), y[9:].T


def about(body: RigidBody, centre: np.ndarray) -> np.ndarray:
    """Inertia of a body about a point at -centre from its centre of mass."""
    return body.central_inertia + body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))


def test_gyroscopic_effects_as_a_gyrostat():
    """A body about a fixed point with a rotor on it: (I - J n n') w' = m c x g - w x L, L = I w + n J spin, J (n.w + spin) constant."""
    scene = SpinningRotor()
    times = np.linspace(0, 5, 26)
    run = ac.build(scene).simulate(5.0, {scene.spin.v: 10.0}, rtol=1e-11, samples=26)
    bar, rotor = scene.bar, scene.rotor
    T = np.array([[1, 0, 1], [0, np.sqrt(2), 0], [-1, 0, 1]]) / np.sqrt(2)
    n, arm = T[:, 0], np.array([0.25, 0, 0])
    J = rotor.central_inertia[0, 0]
    I_rotor = T @ rotor.central_inertia @ T.T + rotor.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    I_all = about(bar, bar.centre_of_mass) + I_rotor
    moment = bar.mass * bar.centre_of_mass + rotor.mass * arm
    p = J * 10.0

    def rate(R, w):
        L = I_all @ w + n * (p - J * n @ w)
        return np.linalg.solve(I_all - J * np.outer(n, n), np.cross(moment, R.T @ np.array(scenes.DOWN)) - np.cross(w, L))

    R, w = turned(np.eye(3), times, np.zeros(3), rate)
    np.testing.assert_allclose(run[scene.bar.frame.rotation], R, atol=2e-8)
    np.testing.assert_allclose(run[scene.spin.v], 10.0 - w @ n, atol=1e-7)
    assert run.energy_error() < 1e-10
    acceleration = np.array(
        [R_ @ (np.cross(rate(R_, w_), moment) + np.cross(w_, np.cross(w_, moment))) for R_, w_ in zip(R, w, strict=True)]
    )
    pull = (bar.mass + rotor.mass) * np.array(scenes.DOWN) - acceleration
    np.testing.assert_allclose(run[scene.ball.frame_a.force], -pull, atol=1e-5)


def test_bevel_gear_on_a_free_carrier_as_a_gyrostat():
    """Two rotors at right angles, one freedom between them: (I - N N'/J) w' = -w x L, N = ratio n1 J1 + n2 J2, J = ratio^2 J1 + J2."""
    ratio = 3.0
    scene = scenes.bevel_gear(ratio)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 7
    times, w0, spin = np.linspace(0, 4, 21), np.array([0.4, -0.3, 0.5]), 2.0
    start = {scene.carrier.frame.angular_velocity: w0, scene.second.v: spin}
    run = model.simulate(4.0, start, rtol=1e-11, samples=21)
    bodies = [(scene.carrier, np.zeros(3)), (scene.pinion, np.array([0.2, 0, 0.1])), (scene.wheel, np.array([0, 0.3, -0.1]))]
    centre = sum(body.mass * place for body, place in bodies) / sum(body.mass for body, _ in bodies)
    I_all = sum(about(body, place - centre) for body, place in bodies)
    N, J = np.array([ratio * 0.11, 1.7, 0]), ratio**2 * 0.11 + 1.7
    p = N @ w0 + J * spin

    def rate(R, w):
        return np.linalg.solve(I_all - np.outer(N, N) / J, -np.cross(w, I_all @ w + N * (p - N @ w) / J))

    R, w = turned(np.eye(3), times, w0, rate)
    np.testing.assert_allclose(run[scene.carrier.frame.rotation], R, atol=1e-8)
    np.testing.assert_allclose(run[scene.second.v], (p - w @ N) / J, atol=1e-8)
    np.testing.assert_allclose(run[scene.first.v], ratio * run[scene.second.v], atol=1e-12)
    assert run.energy_error() < 1e-10


def test_gear_between_shafts_in_the_world_and_what_holds_them():
    """Rotational3DEffects.GearConstraint: (J1 ratio^2 + J2) w2' = ratio tau; the bearings give (J1 ratio + J2) w2' - tau about the axis."""
    scene = ac.System()
    scene.world, scene.first, scene.second, scene.gear = World(gravity=None), Revolute("x"), Revolute("x"), Gear(10.0)
    scene.pinion, scene.wheel = steel_cylinder((0.4, 0, 0), 0.1), steel_cylinder((0.4, 0, 0), 0.2)
    scene.drive = Torque(lambda t: (2 * ca.sin(2 * ca.pi * t), 0, 0))
    join(scene, scene.world.frame, scene.first, scene.pinion.frame)
    join(scene, scene.world.at((1, 0, 0)), scene.second, scene.wheel.frame)
    scene.connect(scene.first.flange, scene.gear.flange_a)
    scene.connect(scene.second.flange, scene.gear.flange_b)
    scene.connect(scene.drive.frame, scene.pinion.tip)
    run = ac.build(scene).simulate(5.0, rtol=1e-11, samples=51)
    J1, J2 = scene.pinion.central_inertia[0, 0], scene.wheel.central_inertia[0, 0]
    tau = 2 * np.sin(2 * np.pi * run.t)
    rate = 10 * tau / (100 * J1 + J2)
    np.testing.assert_allclose(run[scene.second.v], 10 / (100 * J1 + J2) * (1 - np.cos(2 * np.pi * run.t)) / np.pi, atol=1e-10)
    held = (run[scene.first.frame_a.torque] + run[scene.second.frame_a.torque])[:, 0]
    np.testing.assert_allclose(held, (10 * J1 + J2) * rate - tau, atol=1e-10)
    assert run.energy_error() < 1e-10


def angular_momentum(run, bodies) -> np.ndarray:
    """About the origin (n, 3)."""
    total = np.zeros((run.t.size, 3))
    for body in bodies:
        R, w = run[body.frame.rotation], run[body.frame.angular_velocity]
        total += np.einsum("nij,jk,nlk,nl->ni", R, body.central_inertia, R, w)
        total += body.mass * np.cross(run[body.frame.position], run[body.frame.velocity])
    return total


def test_motor_and_bevel_gear_inside_a_free_body_leave_its_angular_momentum():
    """What the gear's teeth do to the shafts comes back on their carrier, about both axes: it turns, the total does not."""
    scene = scenes.bevel_gear(-4.0)
    scene.motor = TorqueSource(lambda t: 2 * np.sin(3 * t))
    scene.connect(scene.motor.flange, scene.first.flange)
    run = ac.build(scene).simulate(3.0, {scene.carrier.frame.angular_velocity: (0.1, 0.2, -0.1)}, rtol=1e-11, samples=31)
    L = angular_momentum(run, (scene.carrier, scene.pinion, scene.wheel))
    np.testing.assert_allclose(L - L[0], 0, atol=1e-10)
    assert np.ptp(run[scene.carrier.frame.angular_velocity], axis=0).min() > 0.1
    assert run.energy_error() < 1e-10


def test_torques_of_the_hinges_move_the_carrier():
    """Euler's equation of the carrier alone: what its two hinges report is what turns it, and along the axes that is the gear's."""
    scene = scenes.bevel_gear(-4.0)
    scene.motor = TorqueSource(1.5)
    scene.connect(scene.motor.flange, scene.first.flange)
    run = ac.build(scene).simulate(1.0, {scene.carrier.frame.angular_velocity: (0.3, 0.2, -0.5)}, rtol=1e-11, samples=11)
    R = run[scene.carrier.frame.rotation]
    inertia = np.einsum("nij,jk,nlk->nil", R, scene.carrier.central_inertia, R)
    w, dw = run[scene.carrier.frame.angular_velocity], run[scene.carrier.frame.angular_acceleration]
    needed = np.einsum("nij,nj->ni", inertia, dw) + np.cross(w, np.einsum("nij,nj->ni", inertia, w))
    given = np.zeros_like(needed)
    for hinge in (scene.first, scene.second):
        arm = run[hinge.frame_a.position] - run[scene.carrier.frame.position]
        given -= run[hinge.frame_a.torque] + np.cross(arm, run[hinge.frame_a.force])
    np.testing.assert_allclose(given, needed, atol=1e-11)
    along_x = np.einsum("ni,ni->n", run[scene.first.frame_a.torque], R[:, :, 0])
    along_y = np.einsum("ni,ni->n", run[scene.second.frame_a.torque], R[:, :, 1])
    np.testing.assert_allclose(along_x, 1.5 - run[scene.gear.flange_a.tau], atol=1e-11)
    np.testing.assert_allclose(along_y, -run[scene.gear.flange_b.tau], atol=1e-11)


def rack_and_pinion(radius: float = 0.3) -> ac.System:
    """A wheel with its mass off its axle on a hinge, a cart on a rail, and a rack between them."""
    scene = ac.System()
    scene.world, scene.hinge, scene.rail = World(), Revolute("y"), Prismatic("x")
    scene.wheel, scene.cart, scene.rack = (
        RigidBody(2.0, (0.1, 0.2, 0.1), (0.1, 0, -0.05)),
        RigidBody(1.5, (0.1, 0.1, 0.1)),
        RackAndPinion(radius),
    )
    join(scene, scene.world.frame, scene.hinge, scene.wheel.frame)
    join(scene, scene.world.at((0, 0, -0.3)), scene.rail, scene.cart.frame)
    scene.connect(scene.hinge.flange, scene.rack.pinion)
    scene.connect(scene.rail.flange, scene.rack.rack)
    return scene


def test_rack_and_pinion_swings_as_one_pendulum():
    """(J + m r^2) phi'' = m g d sin(...): the cart is an inertia of its mass times the radius squared."""
    radius = 0.3
    scene = rack_and_pinion(radius)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    times = np.linspace(0, 3, 31)
    run = model.simulate(3.0, {scene.hinge.q: 1.0}, rtol=1e-12, samples=31)
    J = 0.2 + 2.0 * (0.1**2 + 0.05**2) + 1.5 * radius**2

    def derivative(t, y):  # about +y, x turns towards -z: the height of the mass is -0.1 sin q - 0.05 cos q
        return [y[1], 2.0 * 9.81 * (0.1 * np.cos(y[0]) - 0.05 * np.sin(y[0])) / J]

    exact = solve_ivp(derivative, (0, 3), [1.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-13, t_eval=times).y
    np.testing.assert_allclose(run[scene.hinge.q], exact[0], atol=1e-9)
    np.testing.assert_allclose(run[scene.rail.q], radius * run[scene.hinge.q], atol=1e-15)
    acceleration = np.array([derivative(0, y)[1] for y in exact.T])
    np.testing.assert_allclose(run[scene.rack.rack.f], -1.5 * radius * acceleration, atol=1e-8)
    np.testing.assert_allclose(run[scene.rack.pinion.tau], 1.5 * radius**2 * acceleration, atol=1e-8)
    assert run.energy_error() < 1e-11


def test_rack_and_pinion_closes_a_loop_of_bodies():
    """A pinion on a cart that slides on a rail, its rack the rail: the rolling wheel, J phi'' + m r^2 phi'' = tau."""
    scene = ac.System()
    scene.world, scene.rail, scene.axle = World(), Prismatic("x"), Revolute("y")
    scene.cart, scene.wheel = RigidBody(2.0, (0.1, 0.1, 0.1)), RigidBody.disk(1.0, 0.2, axis="y")
    scene.rack, scene.motor = RackAndPinion(0.2), TorqueSource(0.5)
    join(scene, scene.world.frame, scene.rail, scene.cart.frame)
    join(scene, scene.cart.frame, scene.axle, scene.wheel.frame)
    scene.connect(scene.axle.flange, scene.rack.pinion, scene.motor.flange)
    scene.connect(scene.rail.flange, scene.rack.rack)
    run = ac.build(scene).simulate(2.0, rtol=1e-11, samples=5)
    inertia = 0.5 * 0.2**2 + 3.0 * 0.2**2
    np.testing.assert_allclose(run[scene.axle.q], 0.5 * 0.5 / inertia * run.t**2, rtol=1e-11)
    np.testing.assert_allclose(run[scene.rail.q], 0.2 * run[scene.axle.q], atol=1e-14)


@pytest.mark.parametrize("sine", [np.sin, ca.sin])
def test_a_given_angle_drives_the_rack(sine):
    """phi = sin 2t by numpy's or CasADi's function: the cart's acceleration and the rack's force are known, nothing is free."""
    scene = rack_and_pinion()
    scene.drive = AngleSource(lambda t: sine(2 * t))
    scene.connect(scene.drive.flange, scene.hinge.flange)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 0
    run = model.simulate(2.0, rtol=1e-11, samples=11)
    np.testing.assert_allclose(run[scene.rail.q], 0.3 * np.sin(2 * run.t), atol=1e-10)
    np.testing.assert_allclose(run[scene.rack.rack.f], 1.5 * 0.3 * 4 * np.sin(2 * run.t), atol=1e-9)
    assert run.energy_error() < 1e-10


def test_start_values_against_the_gear_are_named():
    scene = rack_and_pinion()
    model = ac.build(scene)
    with pytest.raises(StartValueError, match=r"hinge\.q.*rail\.q"):
        model.simulate(1.0, {scene.hinge.q: 0.3, scene.rail.q: 1.0})
    with pytest.raises(StartValueError, match=r"rail\.v"):
        model.simulate(1.0, {scene.hinge.q: 0.0, scene.rail.v: 1.0, scene.hinge.v: 0.0})


@pytest.mark.parametrize("ratio", [2.0, -2.6, -1.0])
def test_planetary_gear_shares_its_freedoms(ratio):
    """Three inertias, a torque on the sun: two freedoms, by the equations of Willis and the lever of the carrier."""
    J = np.array([0.1, 0.4, 0.3])  # sun, carrier, ring
    scene = ac.System()
    scene.gear, scene.motor = PlanetaryGear(ratio), TorqueSource(0.7)
    scene.inertias = [Inertia(j) for j in J]
    for inertia, flange in zip(scene.inertias, (scene.gear.sun, scene.gear.carrier, scene.gear.ring), strict=True):
        scene.connect(inertia.flange_a, flange)
    scene.connect(scene.motor.flange, scene.inertias[0].flange_b)
    run = ac.build(scene).simulate(1.0, rtol=1e-11, samples=3)
    a = np.array([1.0, -(1 + ratio), ratio])  # a . phi = 0, and the gear's torques on the inertias are -tau a
    KKT = np.block([[np.diag(J), a[:, None]], [a[None, :], np.zeros((1, 1))]])
    rates = np.linalg.solve(KKT, [0.7, 0, 0, 0])
    for inertia, rate in zip(scene.inertias, rates[:3], strict=True):
        np.testing.assert_allclose(run[inertia.w], rate * run.t, atol=1e-12)
    np.testing.assert_allclose(run[scene.gear.sun.tau], rates[3], atol=1e-12)
    power = sum(
        run[f.tau] * run[i.w] for f, i in zip((scene.gear.sun, scene.gear.carrier, scene.gear.ring), scene.inertias, strict=True)
    )
    np.testing.assert_allclose(power, 0, atol=1e-13)
    assert run.energy_error() < 1e-11


def test_planetary_gear_with_its_ring_held_is_a_gear():
    scene = ac.System()
    scene.gear, scene.motor, scene.ground = PlanetaryGear(3.0), TorqueSource(1.0), RotationalGround()
    scene.sun, scene.arm = Inertia(0.1), Inertia(2.0)
    scene.connect(scene.gear.ring, scene.ground.flange)
    scene.connect(scene.gear.sun, scene.sun.flange_a)
    scene.connect(scene.gear.carrier, scene.arm.flange_a)
    scene.connect(scene.motor.flange, scene.sun.flange_b)
    model = ac.build(scene)
    run = model.simulate(1.0, rtol=1e-11, samples=3)
    np.testing.assert_allclose(run[scene.sun.w], 4 * run[scene.arm.w], atol=1e-12)
    np.testing.assert_allclose(run[scene.sun.w], run.t / (0.1 + 2.0 / 16), atol=1e-11)


def test_rotors_on_an_elastic_gear_swing_at_their_frequency():
    """Twist of two rotors a, b: w^2 = stiffness (1 / Ja + ratio^2 / Jb), dying with damping (1 / Ja + ratio^2 / Jb) / 2."""
    ratio, stiffness, damping, Ja, Jb = -5.0, 40.0, 0.02, 0.01, 0.8
    scene = ac.System()
    scene.a, scene.b, scene.gear = Inertia(Ja), Inertia(Jb), ElasticGear(ratio, stiffness, damping)
    scene.connect(scene.a.flange_b, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.b.flange_a)
    run = ac.build(scene).simulate(1.0, {scene.a.phi: 0.2, scene.b.phi: 0.0}, rtol=1e-11, samples=101)
    twist = run[scene.a.phi] - ratio * run[scene.b.phi]
    both = 1 / Ja + ratio**2 / Jb
    decay = damping * both / 2
    w = np.sqrt(stiffness * both - decay**2)
    exact = 0.2 * np.exp(-decay * run.t) * (np.cos(w * run.t) + decay / w * np.sin(w * run.t))
    np.testing.assert_allclose(twist, exact, atol=1e-10)
    np.testing.assert_allclose(ratio * Ja * run[scene.a.w] + Jb * run[scene.b.w], 0, atol=1e-11)
    assert run.energy_error() < 1e-10


@pytest.mark.parametrize(("make", "said"), [
    (lambda: RackAndPinion(0.0), "radius is 0"),
    (lambda: Gear(0.0), "ratio is 0"), (lambda: RackAndPinion(float("nan")), "finite"), (lambda: RackAndPinion((1, 2)), "number|scalar"),
    (lambda: PlanetaryGear(0.0), "ratio is 0"), (lambda: PlanetaryGear("big"), "number"),
])  # fmt: skip
def test_nonsense_is_refused(make, said):
    with pytest.raises(ParameterError, match=said):
        make()


@pytest.mark.parametrize("seed", [7, 19, 93, 230])
def test_a_train_of_gears_swings_as_one_inertia_whichever_of_its_parts_that_is(seed):
    """Ratios from 1e-6 to 1e6: of the inertias, as felt at one shaft, one may be all and another nothing. x'' + x' / 10 + x = 0."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    ratios = rng.choice([-1, 1], n - 1) * 10 ** rng.uniform(-6, 6, n - 1)
    inertias, turns = 10 ** rng.uniform(-3, 3, n), np.append(1.0, np.cumprod(1 / ratios))
    felt = float(inertias @ turns**2)
    scene = ac.System()
    scene.ground, scene.spring, scene.damper = RotationalGround(), RotationalSpring(felt), RotationalDamper(0.1 * felt)
    scene.shafts, scene.gears = [Inertia(float(J)) for J in inertias], [Gear(float(r)) for r in ratios]
    for k in rng.permutation(n - 1):
        scene.connect(scene.shafts[k].flange_b, scene.gears[k].flange_a)
        scene.connect(scene.gears[k].flange_b, scene.shafts[k + 1].flange_a)
    scene.connect(scene.ground.flange, scene.spring.flange_a, scene.damper.flange_a)
    scene.connect(scene.spring.flange_b, scene.damper.flange_b, scene.shafts[0].flange_a)
    run = ac.build(scene).simulate(5.0, {scene.shafts[0].phi: 0.3}, rtol=1e-11, samples=21)
    w = np.sqrt(1 - 0.05**2)
    wanted = 0.3 * np.exp(-0.05 * run.t) * (np.cos(w * run.t) + 0.05 / w * np.sin(w * run.t))
    for shaft, turn in zip(scene.shafts, turns, strict=True):
        assert np.abs(run[shaft.phi] / turn - wanted).max() < 1e-10
    assert run.energy_error() < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_gears_that_close_a_train_hold_with_ratios_that_fit_only_and_exported_models_know_it_wherever_they_stand(seed):
    """A train and one gear beside it, two racks beside each other: r_1 r_2 ... = r, whatever the ratios are, to rounding. At angles of zero all would fit."""
    rng = np.random.default_rng(seed)
    draw = lambda: rng.choice([-1, 1], 2) * 10 ** rng.uniform(-3, 3, 2)  # noqa: E731
    scene, train, radius = ac.System(), draw(), 10 ** rng.uniform(-3, 3)
    scene.ratios, scene.radii = [ac.Parameter(r) for r in (*train, train.prod())], [ac.Parameter(radius, "m") for _ in range(2)]
    scene.shafts, scene.gears = [Inertia(1.0) for _ in range(3)], [Gear(r) for r in scene.ratios]
    scene.mass, scene.racks = SlidingMass(1.0), [RackAndPinion(r) for r in scene.radii]
    for gear, a, b in zip(scene.gears, (0, 1, 0), (1, 2, 2), strict=True):
        scene.connect(scene.shafts[a].flange_b, gear.flange_a)
        scene.connect(gear.flange_b, scene.shafts[b].flange_a)
    for rack in scene.racks:
        scene.connect(scene.shafts[2].flange_b, rack.pinion)
        scene.connect(rack.rack, scene.mass.flange_a)
    model = ac.build(scene)
    holds, values = (
        model.functions.holds,
        lambda: np.concatenate([(one := draw()), [one.prod()], np.repeat(10 ** rng.uniform(-3, 3), 2)]),
    )
    assert holds is not None and len(model.state_names) == 2
    for _ in range(4):
        fit, place = values(), int(rng.integers(5))
        named = dict(zip((*scene.ratios, *scene.radii), fit, strict=True))
        parameter = list(named)[place]
        for x in (np.zeros(2), rng.normal(size=2)):
            assert holds(0, x, [], fit) >= 0
            for off in (1e-12, 3e-9, 1.0):
                assert holds(0, x, [], fit * (1 + off * (np.arange(5) == place))) < 0
        model.initial_state(parameters=named)
        with pytest.raises(ParameterError, match="follow"):
            model.initial_state(parameters=named | {parameter: fit[place] * (1 + 1e-11)})
