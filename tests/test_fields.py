"""Fields on all bodies, what a medium does, and elastic mounts: closed forms and independent sums over points of mass."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal import errors
from components import (
    Bushing,
    CentralField,
    Drag,
    MagnusForce,
    MutualGravitation,
    Particle,
    PitchingMoment,
    PotentialField,
    Revolute,
    RigidBody,
    Rod,
    Torque,
    UniformField,
    World,
)
from tests.pairings import each_value


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation about an axis of length one."""
    K = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(angle) * K + 2 * np.sin(angle / 2) ** 2 * K @ K


def free(body, *parts, gravity=None) -> ac.System:
    """One body held by nothing, and further parts."""
    scene = ac.System()
    scene.world, scene.body, scene.others = World(gravity), body, list(parts)
    return scene


@each_value(("eccentricity", [0.0, 0.5, 0.9]), ("size", [1e-3, 1.0, 1e8]))
def test_an_orbit_closes(eccentricity, size):
    """After one period of Kepler's third law, from the farthest point; 18 operations."""
    scene = free(Particle(2.0), CentralField(4 * np.pi**2 * size**3))
    model = ac.build(scene)
    assert model.operations <= 18
    point = scene.body.point
    away = size * (1 + eccentricity)
    speed = 2 * np.pi * size * np.sqrt((1 - eccentricity) / (1 + eccentricity))
    run = model.simulate(1.0, {point.position: (away, 0, 0), point.velocity: (0, speed, 0)}, rtol=1e-12)
    assert np.max(np.abs(run[point.position][-1] - [away, 0, 0])) < 1e-11 * size
    assert run.energy_error() < 1e-12


def points_of(body: RigidBody) -> tuple[np.ndarray, np.ndarray]:
    """Six equal masses on the principal axes with the same centre and moments: places (6, 3) in the body, and masses (6,)."""
    moments = np.diag(np.asarray(body.central_inertia))
    second = np.sum(moments) / 2 - moments
    arms = np.sqrt(3 * second / float(body.mass))
    places = np.vstack([np.diag(arms), -np.diag(arms)]) + np.asarray(body.centre_of_mass)
    return places, np.full(6, float(body.mass) / 6)


def test_the_gradient_turns_a_satellite_as_its_points_of_mass_say():
    """Force and moment on a body of general inertia against the sum over points, which differs by the fourth power of size over distance."""
    body = RigidBody(3.0, (0.3e-6, 0.2e-6, 0.25e-6), (1e-4, 2e-4, -1e-4))
    scene = free(body, CentralField(2.0))
    model = ac.build(scene)
    frame = body.frame
    seen = [frame.position, frame.rotation, frame.acceleration, frame.angular_acceleration]
    f = ca.Function("f", [model.system.x], [model.functions.outputs.resolve(e) for e in seen])
    rng = np.random.default_rng(2)
    places, masses = points_of(body)
    for _ in range(5):
        state = rng.normal(size=model.system.x.numel())
        state[:4] /= np.linalg.norm(state[:4])
        state[7:] = 0
        p, R, a, alpha = (np.array(part) for part in f(state))
        arms = places @ R.T
        pulls = -2.0 * masses[:, None] * (p.T + arms) / np.linalg.norm(p.T + arms, axis=1)[:, None] ** 3
        centre = R @ np.asarray(body.centre_of_mass)
        moment = np.sum(np.cross(arms - centre, pulls), axis=0)
        J = R @ np.asarray(body.central_inertia) @ R.T
        size = 1e-4 / np.linalg.norm(p)
        assert np.max(np.abs(J @ alpha.ravel() - moment)) < 30 * size**3 * np.linalg.norm(p) * np.linalg.norm(pulls)
        assert (
            np.max(np.abs(a.ravel() + np.cross(alpha.ravel(), centre) - pulls.sum(axis=0) / 3.0)) < 1e-12 / np.linalg.norm(p) ** 2
        )
    assert (
        ac.build(scene).simulate(2.0, {frame.position: (1.0, 0, 0), frame.velocity: (0, 1.4, 0.1)}, rtol=1e-12).energy_error()
        < 1e-13
    )


@pytest.mark.parametrize("shape", [0.1, 0.9])
def test_a_satellite_swings_about_the_vertical(shape):
    """Pitch on a circular orbit: theta'' = -3/2 n^2 (I_x - I_y) / I_z sin(2 theta), Beletsky's equation of a circle."""
    body = RigidBody(1.0, (1e-12 * 1.0, 1e-12 * (1.0 + shape), 1e-12 * 1.95))
    scene = free(body, CentralField(1.0))
    frame = body.frame
    start = {frame.position: (1, 0, 0), frame.velocity: (0, 1, 0), frame.angular_velocity: (0, 0, 1.3), frame.rotation[0, 0]: 1.0}
    run = ac.build(scene).simulate(6.0, start, rtol=1e-12)
    R = run[frame.rotation][-1]
    rate = 1.5 * shape / 1.95
    pitch = solve_ivp(
        lambda t, y: [y[1], -rate * np.sin(2 * y[0])], (0, 6.0), [0, 0.3], method="DOP853", rtol=1e-12, atol=1e-13
    ).y[0, -1]
    found = np.arctan2(R[1, 0], R[0, 0]) - 6.0 - pitch
    assert abs(np.sin(found)) < 1e-10


def test_a_dumbbell_of_two_particles_feels_the_gradient_by_itself():
    """A rod between two particles turns about its centre as a body with their moments does, to the square of its length."""
    scene = ac.System()
    scene.world, scene.earth, scene.one, scene.two, scene.rod = (
        World(None),
        CentralField(1.0),
        Particle(2.0),
        Particle(2.0),
        Rod(4e-4),
    )
    scene.connect(scene.one.point, scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, scene.two.point)
    start = {
        scene.one.point.position: (1.0 - 2e-4, 0, 0), scene.two.point.position: (1.0 + 2e-4, 0, 0),
        scene.one.point.velocity: (0, 1.0 - 2e-4 * 1.3, 0), scene.two.point.velocity: (0, 1.0 + 2e-4 * 1.3, 0),
    }  # fmt: skip
    run = ac.build(scene).simulate(3.0, start, rtol=1e-12)
    arm = run[scene.two.point.position][-1] - run[scene.one.point.position][-1]
    pitch = solve_ivp(
        lambda t, y: [y[1], -1.5 * np.sin(2 * y[0])], (0, 3.0), [0, 0.3], method="DOP853", rtol=1e-12, atol=1e-13
    ).y[0, -1]
    assert abs(np.sin(np.arctan2(arm[1], arm[0]) - 3.0 - pitch)) < 1e-6
    assert run.energy_error() < 1e-12


def test_what_attracts_is_attracted():
    """A planet that carries its field: momentum of both, and their orbit about one another."""
    scene = ac.System()
    scene.world, scene.planet, scene.field, scene.moon = World(None), Particle(3.0), CentralField(3.0), RigidBody.ball(1.0, 0.1)
    scene.connect(scene.field.frame, scene.planet.point)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 9
    speed = np.sqrt(4.0)  # at distance 1 with mass ratio 3: mu (1 + 1 / 3)
    run = model.simulate(
        2.0,
        {
            scene.planet.point.position: (0, 0, 0), scene.moon.frame.position: (1, 0, 0),
            scene.planet.point.velocity: (0, -speed / 4, 0), scene.moon.frame.velocity: (0, 3 * speed / 4, 0),
        },
        rtol=1e-12,
    )  # fmt: skip
    total = 3.0 * run[scene.planet.point.velocity] + run[scene.moon.frame.velocity]
    assert np.max(np.abs(total)) < 1e-12
    distance = np.linalg.norm(run[scene.moon.frame.position] - run[scene.planet.point.position], axis=1)
    assert np.max(np.abs(distance - 1)) < 1e-11


def test_a_quadratic_field_is_felt_exactly():
    """U = p.K p / 2: a body is as its points of mass are, at any size."""
    K = np.diag([3.0, 1.0, 2.0])
    body = RigidBody(3.0, (0.3, 0.2, 0.25), (0.1, 0.2, -0.1))
    scene = free(body, PotentialField(lambda p, t: 0.5 * ca.dot(p, ca.SX(ca.DM(K)) @ p)))
    model = ac.build(scene)
    rng = np.random.default_rng(3)
    places, masses = points_of(body)
    outputs = model.functions.outputs
    f = ca.Function(
        "f",
        [model.system.x],
        [outputs.potential_energy, outputs.resolve(body.frame.position), outputs.resolve(body.frame.rotation)],
    )
    state = rng.normal(size=13)
    state[:4] /= np.linalg.norm(state[:4])
    energy, p, R = (np.array(part) for part in f(state))
    at = p.T + places @ R.T
    assert abs(energy.item() - 0.5 * np.sum(masses * np.einsum("ni,ij,nj->n", at, K, at))) < 1e-13
    assert (
        model.simulate(5.0, {body.frame.position: (1, 0, 0), body.frame.angular_velocity: (1, 2, 3)}, rtol=1e-12).energy_error()
        < 1e-12
    )


def test_a_field_that_changes_with_time_or_an_input_does_work():
    tide = ac.Input("m/s^2")
    scene = free(Particle(2.0), UniformField(lambda t: (ca.cos(t), 0, 0)))
    scene.tide = tide
    scene.second = UniformField((0, tide, 0))
    point = scene.body.point
    run = ac.build(scene).simulate(2.0, inputs={tide: 0.3}, rtol=1e-12)
    assert np.allclose(run[point.velocity][-1], [np.sin(2.0), 0.6, 0], atol=1e-13)
    assert run.energy_error() < 1e-12


def test_a_pendulum_in_a_uniform_field_swings_as_under_gravity():
    ends: list[np.ndarray] = []
    for gravity, fields in (((0, 0, -9.81), []), (None, [UniformField((0, 0, -9.81))])):
        scene = ac.System()
        scene.world, scene.hinge, scene.rod, scene.fields = (
            World(gravity),
            Revolute("y"),
            RigidBody.rod(1.0, (0.3, 0, -1.0)),
            fields,
        )
        scene.connect(scene.world.frame, scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.rod.frame)
        run = ac.build(scene).simulate(3.0, {scene.hinge.q: 1.0}, rtol=1e-12)
        ends.append(run[scene.hinge.q][-1])
        ends.append(run[scene.hinge.frame_b.force][-1])
    assert np.allclose(ends[0], ends[2], atol=1e-12)
    assert np.allclose(ends[1], ends[3], atol=1e-11)


@pytest.mark.parametrize("linear, quadratic", [(0.4, 0.0), (0.0, 0.3)])
def test_a_body_falls_through_air_as_the_closed_forms_say(linear, quadratic):
    scene = free(Particle(0.5), Drag(linear=linear, quadratic=quadratic), gravity=(0, 0, -9.81))
    scene.connect(scene.others[0].point, scene.body.point)
    run = ac.build(scene).simulate(3.0, rtol=1e-13)
    if linear:
        expected = -0.5 * 9.81 / linear * (1 - np.exp(-linear / 0.5 * run.t))
    else:
        final = np.sqrt(0.5 * 9.81 / quadratic)
        expected = -final * np.tanh(9.81 * run.t / final)
    assert np.max(np.abs(run[scene.body.point.velocity][:, 2] - expected)) < 1e-12
    assert run.energy_error() < 1e-12


def test_wind_carries_what_it_drags():
    scene = free(Particle(0.5), Drag(linear=0.4, wind=lambda t: (ca.sin(t), 0, 0)))
    scene.connect(scene.others[0].point, scene.body.point)
    run = ac.build(scene).simulate(3.0, rtol=1e-12)
    k = 0.8
    expected = k * (k * np.sin(run.t) - np.cos(run.t) + np.exp(-k * run.t)) / (1 + k * k)
    assert np.max(np.abs(run[scene.body.point.velocity][:, 0] - expected)) < 1e-12


def test_a_spinning_ball_flies_in_circles_and_a_finned_rod_swings():
    """Magnus' force turns the velocity at coefficient w / m; a fin's moment makes a rod swing about the wind."""
    ball = RigidBody.ball(0.5, 0.1)
    scene = free(ball, MagnusForce(0.25))
    scene.connect(scene.others[0].point, ball.frame)
    start = {ball.frame.angular_velocity: (0, 0, 4.0), ball.frame.velocity: (3.0, 0, 0)}
    run = ac.build(scene).simulate(3.0, start, rtol=1e-12)
    assert np.allclose(run[ball.frame.velocity][-1], 3.0 * np.array([np.cos(6.0), np.sin(6.0), 0]), atol=1e-11)
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World(None), Revolute("y"), RigidBody.box(2.0, (1.0, 0.1, 0.1))
    scene.fin = PitchingMoment(-0.4, axis="x", wind=(-5.0, 0, 0))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.fin.frame, scene.rod.frame)
    run = ac.build(scene).simulate(2.0, {scene.hinge.q: 0.5}, rtol=1e-12)
    inertia = float(np.asarray(scene.rod.central_inertia)[1, 1])
    angle = solve_ivp(
        lambda t, y: [y[1], -0.4 * 25 * np.sin(y[0]) / inertia], (0, 2.0), [0.5, 0], method="DOP853", rtol=1e-12, atol=1e-13
    ).y[0, -1]
    assert abs(run[scene.hinge.q][-1].item() - angle) < 1e-10


def test_a_mount_has_the_frequencies_of_its_stiffness():
    """Six modes of a block on one mount at its centre."""
    block = RigidBody(2.0, (0.02, 0.03, 0.04))
    scene = free(block)
    scene.mount = Bushing((5.0, 6.0, 7.0, 100.0, 200.0, 300.0), (0, 0, 0, 1.0, 1.0, 1.0))
    scene.connect(scene.world.frame, scene.mount.frame_a)
    scene.connect(scene.mount.frame_b, block.frame)
    model = ac.build(scene)
    found = np.sort(np.abs(model.linearize().eigenvalues))[::2]
    assert np.allclose(found, np.sort(np.sqrt([5 / 0.02, 6 / 0.03, 7 / 0.04, 50, 100, 150])), rtol=1e-12)
    run = model.simulate(2.0, {block.frame.angular_velocity: (8, 9, 7), block.frame.velocity: (1, 2, 3)}, rtol=1e-12)
    assert run.energy_error() < 1e-12


@pytest.mark.parametrize("angle", [1e-6, 3.0, np.pi])
def test_a_mount_turns_on_beyond_half_a_turn_as_a_pendulum(angle):
    """Its moment about any axis is stiffness sin(angle), as far as it turns; energies of small turns are known as well as their squares."""
    axis, k, J = np.array([2.0, -1.0, 2.0]) / 3, 5.0, 0.02
    block = RigidBody(2.0, (J, J, J))
    scene = free(block)
    scene.mount = Bushing((k, k, k, 100.0, 200.0, 300.0))
    scene.connect(scene.world.frame, scene.mount.frame_a)
    scene.connect(scene.mount.frame_b, block.frame)
    rate = 0.0 if angle < 1 else 20.0
    start = {block.frame.rotation: turned(axis, angle), block.frame.angular_velocity: rate * axis}
    run = ac.build(scene).simulate(2.0, start, rtol=1e-12, samples=21)
    expected = solve_ivp(
        lambda t, y: [y[1], -k / J * np.sin(y[0])], (0, 2.0), [angle, rate], "DOP853", run.t, rtol=1e-13, atol=1e-18
    )
    assert run.energy_error() < 1e-11
    for R, turn in zip(run[block.frame.rotation], expected.y[0], strict=True):
        assert np.max(np.abs(R - turned(axis, turn))) < 1e-9 * min(angle, 1)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: CentralField(-1.0), "mu"),
        (lambda: PotentialField(lambda p, t: p), "one number"),
        (lambda: PotentialField(3.0), "lambda p, t"),
        (lambda: PotentialField(lambda p: p[0]), "called with symbols"),
        (lambda: Bushing((1, 2, 3)), "six numbers"),
        (lambda: Bushing((1, 2, 3, 4, 5, -6)), "negative direction"),
        (lambda: Drag(quadratic=-1.0), "quadratic"),
    ],
)
def test_wrong_fields_and_forces_are_refused_with_the_line(make, words):
    with pytest.raises(errors.ParameterError, match=words) as found:
        make()
    assert "test_fields.py:" in str(found.value)


@pytest.mark.parametrize(
    "make", [lambda: Torque((0, 0, 1.0)), lambda: MagnusForce(1.0), lambda: PitchingMoment(1.0), lambda: Bushing((1,) * 6)]
)
def test_what_turns_a_body_does_not_turn_a_particle(make):
    """Which has no turn: until a body is there nothing would come of it, or a torque on the other end alone."""
    scene = ac.System()
    scene.world, scene.bob, scene.part = World(), Particle(1.0), make()
    *others, end = scene.part.connectors()
    scene.connect(end, scene.bob.point)
    for other in others:
        scene.connect(other, scene.world.frame)
    with pytest.raises(
        errors.IncompatibleError, match=r"part\.\w+ .*test_fields\.py.* needs a frame, but 'bob' .* Connect it to a body"
    ):
        ac.build(scene)


def test_a_field_without_a_ground_to_stand_on_is_refused():
    scene = ac.System()
    scene.body, scene.field = Particle(1.0), CentralField(1.0)
    with pytest.raises(errors.GroundError, match="field"):
        ac.build(scene)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_what_a_field_does_to_a_body_is_no_reaction_of_what_holds_it(size):
    """As of gravity: a rod and a box on it swing under the world's gravity and in a uniform field, and all that is read at their frames is the same."""
    read = []
    for gravity in (True, False):
        scene = ac.System()
        scene.world, scene.hinge = World((0, 0, -9.81) if gravity else None), Revolute("y")
        scene.rod, scene.box = (
            RigidBody.rod(1.0, (0.3 * size, 0, -size)),
            RigidBody.box(2.0, (0.3 * size, 0.2 * size, 0.1 * size)),
        )
        if not gravity:
            scene.field = UniformField((0, 0, -9.81))
        scene.connect(scene.world.frame, scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.rod.frame)
        scene.connect(scene.rod.tip, scene.box.at((0.1 * size, 0, 0.05 * size)))
        run = ac.build(scene).simulate(np.sqrt(size), {scene.hinge.q: 0.7}, rtol=1e-10)
        frames = scene.world.frame, scene.hinge.frame_a, scene.hinge.frame_b, scene.rod.frame, scene.rod.tip, scene.box.frame
        read.append(np.hstack([np.hstack([run[frame.force][[0, -1]], run[frame.torque][[0, -1]] / size]) for frame in frames]))
    assert np.max(np.abs(read[0] - read[1])) < 1e-8
    assert np.max(np.abs(read[0][:, 18:21])) > 1.0


def test_the_pull_in_a_tether_is_read_at_either_end():
    """Two masses in orbit on a massless rod along the vertical: 10 (w^2 r - mu / r^2) N at the outer one; the field's pull is no part of it. And of two that attract each other."""
    mu, r, length = 3.986e14, 7e6, 1e4
    scene = ac.System()
    scene.world, scene.earth, scene.rod = World(None), CentralField(mu), Rod(length)
    scene.ends = [Particle(10.0), Particle(10.0)]
    inner, outer = r - length / 2, r + length / 2
    rate = np.sqrt((mu / inner**2 + mu / outer**2) / (2 * r))
    start = {}
    for end, away, port in zip(scene.ends, (inner, outer), (scene.rod.frame_a, scene.rod.frame_b), strict=True):
        scene.connect(port, end.point)
        start |= {end.point.position: (away, 0, 0), end.point.velocity: (0, rate * away, 0)}
    run = ac.build(scene).simulate(100.0, start, rtol=1e-11)
    pull = 10 * (rate**2 * outer - mu / outer**2)
    for end in scene.ends:
        assert np.linalg.norm(run[end.point.force], axis=1) == pytest.approx(pull, rel=1e-5)
    pair = ac.System()
    pair.world, pair.field, pair.one, pair.other, pair.rod = (
        World(None),
        MutualGravitation(4.0),
        Particle(2.0),
        Particle(3.0),
        Rod(2.0),
    )
    pair.connect(pair.rod.frame_a, pair.one.point)
    pair.connect(pair.rod.frame_b, pair.other.point)
    rest = ac.build(pair).simulate(1.0, {pair.one.point.position: (0, 0, 0), pair.other.point.position: (2.0, 0, 0)})
    assert rest[pair.one.point.force][-1] == pytest.approx((-4.0 * 2.0 * 3.0 / 4.0, 0, 0))
