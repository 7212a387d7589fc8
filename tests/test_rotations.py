"""Rotations as people give and read them, against scipy, as outputs, start values and arguments."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import acausal as ac
from acausal import errors, rotations
from acausal.parts.rotations import axis_vector
from components import Fixed, Particle, Revolute, RigidBody, Spherical, World

ORDERS = ["".join(o) for o in itertools.product("xyz", repeat=3) if o[0] != o[1] != o[2]]
NAMES = [f"{kind} {order}" for kind in ("intrinsic", "extrinsic") for order in ORDERS]


def tumbling() -> ac.System:
    """A free body without forces."""
    scene = ac.System()
    scene.world, scene.body = World(None), RigidBody(1.0, (0.1, 0.2, 0.25))
    return scene


def scipys(name: str) -> str:
    kind, order = name.split()
    return order.upper() if kind == "intrinsic" else order


@pytest.mark.parametrize("name", NAMES)
def test_euler_angles_are_what_scipy_calls_so_both_ways(name):
    rng = np.random.default_rng(NAMES.index(name))
    angles = np.array([rng.uniform(-3, 3), rng.uniform(0.1, 1.4), rng.uniform(-3, 3)])
    R = rotations.rotation_matrix((name, angles))
    assert isinstance(R, np.ndarray)
    assert np.max(np.abs(R - Rotation.from_euler(scipys(name), angles).as_matrix())) < 1e-14
    symbols = ca.SX.sym("R", 3, 3)
    read = ca.Function("read", [symbols], [rotations.euler_angles(symbols, name).sx])
    assert np.max(np.abs(np.array(read(R)).ravel() - angles)) < 1e-13


@pytest.mark.parametrize("name", NAMES)
def test_angles_tell_the_rotation_also_where_two_turn_about_one_axis(name):
    """No turn is three times 0; and one of any angle about the outer axis, or the second angle at an end of its range, is told by some of its angles."""
    rng, order = np.random.default_rng(NAMES.index(name)), name.split()[1]
    symbols = ca.SX.sym("R", 3, 3)
    read = ca.Function("read", [symbols], [rotations.euler_angles(symbols, name).sx])
    assert np.max(np.abs(np.array(read(np.eye(3))))) < 1e-15
    for end in (0, np.pi) if order[0] == order[2] else (-np.pi / 2, np.pi / 2):
        for first, third in [(0, 0), (1.0, 0), (0, -2.0), *rng.uniform(-3, 3, (20, 2))]:
            R = Rotation.from_euler(scipys(name), (first, end, third)).as_matrix()
            angles = np.array(read(R)).ravel()
            assert np.max(np.abs(Rotation.from_euler(scipys(name), angles).as_matrix() - R)) < 1e-14


def test_there_are_twelve_orders():
    assert len(ORDERS) == 12


def test_all_ways_to_say_a_turn_say_the_same():
    rng = np.random.default_rng(3)
    for _ in range(10):
        turn = Rotation.from_rotvec(rng.normal(size=3))
        q, v = turn.as_quat(), turn.as_rotvec()
        angle = np.linalg.norm(v)
        axis = v / angle
        ways = [
            turn, ("quaternion xyzw", q), ("quaternion wxyz", np.roll(q, 1)), tuple(np.roll(q, 1).tolist()), (tuple(axis.tolist()), float(angle)),
            ("rodrigues", axis * np.tan(angle / 2)), ("modified rodrigues", axis * np.tan(angle / 4)), ("rotation vector", v),
            turn.as_matrix().tolist(),
        ]  # fmt: skip
        for way in ways:
            assert np.max(np.abs(rotations.rotation_matrix(way) - turn.as_matrix())) < 1e-14, way


def test_what_is_read_of_a_tumbling_body_is_what_scipy_reads():
    scene = tumbling()
    R = rotations.seen_from(scene.world.at((0, 0, 0), rotation=("x", 0.7)), scene.body.frame)
    run = ac.build(scene).simulate(3.0, {scene.body.frame.angular_velocity: (1.0, 2.0, -0.5)}, rtol=1e-9)
    turns = Rotation.from_matrix(run[R])
    for name in ("intrinsic zxz", "extrinsic xyz", "intrinsic yxz"):
        assert np.max(np.abs(np.sin(run[rotations.euler_angles(R, name)] - turns.as_euler(scipys(name))))) < 1e-9
    q = run[rotations.quaternion_of(R, "xyzw")]
    assert np.max(np.abs(np.abs(np.sum(q * turns.as_quat(), axis=1)) - 1)) < 1e-12
    assert np.max(np.abs(run[rotations.rotation_vector_of(R)] - turns.as_rotvec())) < 1e-9
    assert np.max(np.abs(run[rotations.angle_of(R)] - turns.magnitude())) < 1e-9
    assert np.max(np.abs(run[rotations.axis_of(R)] * turns.magnitude()[:, None] - turns.as_rotvec())) < 1e-9
    assert np.max(np.abs(run[rotations.modified_rodrigues_of(R)] - turns.as_mrp())) < 1e-9
    assert np.max(np.abs(np.tan(turns.magnitude() / 2) - np.linalg.norm(run[rotations.rodrigues_of(R)], axis=1))[:50]) < 1e-6


@pytest.mark.parametrize(
    "way",
    [
        ("intrinsic zxz", (0.3, 0.4, 0.5)), Rotation.from_euler("ZXZ", (0.3, 0.4, 0.5)), ("rodrigues", (0.1, 0.4, 0.2)),
        rotations.axis_angle((1, 2, 0), 0.4) @ rotations.euler("intrinsic zxz", (0.3, 0.4, 0.5)),
    ],
)  # fmt: skip
def test_a_start_takes_a_rotation_in_any_way(way):
    scene = tumbling()
    model = ac.build(scene)
    run = model.simulate(1e-3, {scene.body.frame.rotation: way})
    assert np.max(np.abs(run[scene.body.frame.rotation][0] - rotations.rotation_matrix(way))) < 1e-12


@pytest.mark.parametrize("name", ["intrinsic zxz", "intrinsic zyx", "extrinsic xyz"])
def test_a_start_takes_euler_angles_and_their_rates(name):
    """Angular velocity from the rates of the angles, against differences of matrices."""
    scene = tumbling()
    R = scene.body.frame.rotation
    angles = rotations.euler_angles(R, name)
    run = ac.build(scene).simulate(1e-3, {angles: (0.4, 0.7, -0.3), ac.der(angles): (1.0, -2.0, 0.5)})
    assert np.max(np.abs(run[angles][0] - (0.4, 0.7, -0.3))) < 1e-12
    ahead, behind = (
        rotations.rotation_matrix((name, np.array((0.4, 0.7, -0.3)) + h * np.array((1.0, -2.0, 0.5)))) for h in (1e-5, -1e-5)
    )
    W = (ahead - behind) / 2e-5 @ run[R][0].T
    assert np.max(np.abs(run[scene.body.frame.angular_velocity][0] - (W[2, 1], W[0, 2], W[1, 0]))) < 1e-8


def test_a_ball_joint_starts_by_euler_angles():
    scene = ac.System()
    scene.world, scene.ball, scene.top = World(), Spherical(), RigidBody(1.0, (0.02, 0.02, 0.01), (0, 0, 0.1))
    scene.connect(scene.world.frame, scene.ball.frame_a)
    scene.connect(scene.ball.frame_b, scene.top.frame)
    angles = rotations.euler_angles(scene.top.frame.rotation, "intrinsic zxz")
    start = {angles: (0.0, 0.5, 0.0), ac.der(angles): (0.3, 0.0, 50.0)}
    run = ac.build(scene).simulate(0.5, start, rtol=1e-10)
    assert np.max(np.abs(run[angles][0] - (0, 0.5, 0))) < 1e-12
    assert np.ptp(run[angles[1]]) > 1e-3
    assert run.energy_error() < 1e-9


def test_a_rotation_made_of_parameters_stays_adjustable():
    scene = ac.System()
    scene.tilt = ac.Parameter(0.2, "rad")
    scene.world, scene.hinge, scene.rod = World(), Revolute("z"), RigidBody.rod(1.0, (1, 0, 0))
    scene.mount = Fixed(rotation=("intrinsic xyz", (scene.tilt, 0, 0)))
    scene.connect(scene.world.frame, scene.mount.frame_a)
    scene.connect(scene.mount.frame_b, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    model = ac.build(scene)
    for tilt in (0.2, 1.1):
        run = model.simulate(1.0, {scene.hinge.q: 0.3}, parameters={scene.tilt: tilt}, rtol=1e-11)
        other = ac.System()
        other.world, other.hinge, other.rod = World(), Revolute("z"), RigidBody.rod(1.0, (1, 0, 0))
        other.connect(other.world.at((0, 0, 0), rotation=("x", tilt)), other.hinge.frame_a)
        other.connect(other.hinge.frame_b, other.rod.frame)
        wanted = ac.build(other).simulate(1.0, {other.hinge.q: 0.3}, rtol=1e-11)
        assert np.max(np.abs(run[scene.hinge.q] - wanted[other.hinge.q])) < 1e-10


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_knee_bends_as_grood_and_suntay_say(side):
    """One turn at a time: backwards, to the middle, outwards; and all at once, the turns in the order of their axes."""
    out = 1 if side == "right" else -1
    for flexion, adduction, external in [(0.5, 0, 0), (0, 0.3, 0), (0, 0, 0.2), (0.9, -0.2, 0.3)]:
        scene = ac.System()
        scene.world, scene.shank = World(None), RigidBody(1.0, (0.1, 0.1, 0.1))
        R = Rotation.from_euler("XYZ", (-flexion, out * adduction, -out * external))
        knee = rotations.anatomical_joint(scene.world.frame, scene.shank.frame, side)
        run = ac.build(scene).simulate(1e-3, {scene.shank.frame.rotation: R, scene.shank.frame.position: (0.01, 0.02, -0.4)})
        found = [run[value][0] for value in (knee.flexion, knee.adduction, knee.external_rotation)]
        assert np.max(np.abs(np.array(found) - (flexion, adduction, external))) < 1e-12
        long_axis = R.as_matrix()[:, 2]
        assert abs(run[knee.shifts][0] @ (1, 0, 0) - 0.01) < 1e-12
        assert abs(run[knee.shifts][0] @ (0, 0, 1) + np.dot(long_axis, (0.01, 0.02, -0.4))) < 1e-12
        down = -long_axis  # where the foot goes
        assert (flexion <= 0 or down[1] < 0) and (adduction <= 0 or down[0] * out < 0)


def test_products_of_vectors_are_those_of_numpy():
    scene = tumbling()
    scene.mass = Particle(1.0)
    a, b = scene.body.frame.angular_velocity, scene.mass.point.velocity
    start = {a: (1.0, 2.0, 3.0), b: (-1.0, 0.5, 2.0)}
    run = ac.build(scene).simulate(0.5, start)
    assert np.allclose(run[ac.dot(a, b)], np.sum(run[a] * run[b], axis=1), atol=1e-14)
    assert np.allclose(run[ac.cross(a, (0, 0, 1.0))], np.cross(run[a], (0, 0, 1.0)), atol=1e-14)
    assert np.allclose(run[ac.norm(b)], np.linalg.norm(run[b], axis=1), atol=1e-14)
    assert np.allclose(run[ac.der(ac.norm(b))], 0.0)


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: Fixed(rotation=("zxz", (1, 2, 3))), "intrinsic zxz"),
        (lambda: Fixed(rotation=("intrinsic zzx", (1, 2, 3))), "no axis twice in a row"),
        (lambda: Fixed(rotation=("intrinsic zxz", (1, 2))), "Euler angles"),
        (lambda: Fixed(rotation=("quaternion", (1, 0, 0, 0))), "scalar first"),
        (lambda: Fixed(rotation=("quaternion xyzw", (1, 0, 0, 1))), "length 1.41421"),
        (lambda: Fixed(rotation=("rodriguez", (1, 0, 0))), "'rodrigues'"),
        (lambda: Fixed(rotation=np.array([1.0, 0, 0, 0])), "quaternion wxyz"),
        (lambda: rotations.euler_angles(np.eye(3), "zxz"), "intrinsic"),
        (lambda: rotations.seen_from(World().frame, Particle(1.0).point), "no orientation"),
        (lambda: ac.cross((1, 2), (3, 4)), "vectors of three"),
        (lambda: ac.dot((1, 2), (3, 4, 5)), "one length"),
        (lambda: rotations.anatomical_joint(World().frame, World().frame, "both"), "'left'"),
    ],
)
def test_what_is_no_rotation_is_refused_with_the_line(call, words):
    with pytest.raises((errors.ParameterError, errors.ExpressionError), match=words) as found:
        call()
    assert "test_rotations.py:" in str(found.value)


@pytest.mark.parametrize("size", [1e-300, 1e-20, 1e200, 1e300])
def test_axes_have_no_size(size):
    """Directions are differences of points in any unit."""
    want = axis_vector((1.0, 2.0, -2.0), "an axis")
    assert np.max(np.abs(axis_vector((size, 2 * size, -2 * size), "an axis") - want)) < 1e-15
    assert np.array_equal(axis_vector((2.0**900, 2.0**901, -(2.0**901)), "an axis"), want)


@pytest.mark.parametrize(("spoilt", "words"), [
    (np.diag([1, -1, 1]), "mirrors"), (-np.eye(3), "mirrors"), (np.diag([1, 1, 1 + 1e-3]), "right angles"), (np.outer([1, 0, 0], [1, 1, 1]), "right angles"),
])  # fmt: skip
def test_a_start_at_a_matrix_that_is_no_rotation_says_so(spoilt, words):
    scene = tumbling()
    model, R = ac.build(scene), Rotation.random(random_state=4).as_matrix()
    with pytest.raises(errors.StartValueError, match=f"body.frame.rotation .*{words}"):
        model.simulate(0.1, {scene.body.frame.rotation: R @ spoilt})
    rough = model.simulate(0.1, {scene.body.frame.rotation: ac.near(R @ np.diag([1, 1, 1 + 1e-3]))})
    assert np.max(np.abs(rough[scene.body.frame.rotation][0] - R)) < 1e-3
