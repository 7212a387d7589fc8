"""Bodies of any shape that touch surfaces of any shape, by any law: laws of mechanics at random states, closed forms, and what it costs."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import acausal as ac
from acausal import errors
from acausal.parts.pose import symbolic
from components import (
    Apart,
    Cone,
    Contact,
    ConvexShape,
    Coulomb,
    Cylinder,
    Disk,
    Ellipsoid,
    Force,
    Free,
    Hard,
    HeightField,
    HuntCrossley,
    ImplicitSurface,
    Parallel,
    ParametricSurface,
    Particle,
    Plane,
    PointOnSurface,
    PrescribedMotion,
    Revolution,
    RigidBody,
    Rolling,
    RollingBallOnSurface,
    RollingDisk,
    RollingEllipsoid,
    RollingWithoutPivoting,
    Sliding,
    Sphere,
    Spherical,
    Torque,
    Torus,
    Touching,
    World,
)
from components.contacts.nearness import nearness
from components.geometry.surfaces import AbstractSurface
from tests.pairings import each_value
from tests.test_guides import on

G = 9.81
SHAPES: dict[str, AbstractSurface] = {
    "ball": Sphere(0.1),
    "ellipsoid": Ellipsoid((0.15, 0.1, 0.08)),
    "disk": Disk(0.1),
    "tyre": Torus(0.1, 0.02),
    "egg": ConvexShape(lambda n: 0.02 * n[2] + 0.1 * ca.sqrt(n[0] ** 2 + n[1] ** 2 + 1.5 * n[2] ** 2) + 0.02 * ca.norm_2(n)),
    "cylinder": Cylinder(0.1),
    "cone": Cone(0.4, outside=True),
    "spindle": Revolution(lambda s: (0.1 - 0.2 * s**2, s)),
}
SURFACES: dict[str, AbstractSurface] = {
    "plane": Plane(),
    "ball": Sphere(1.0),
    "bowl": Sphere(1.0, inside_out=True),
    "ellipsoid": Ellipsoid((1.0, 1.5, 0.8)),
    "cylinder": Cylinder(0.8),
    "tube": Cylinder(0.8, inside_out=True),
    "cone": Cone(0.6, outside=True),
    "torus": Torus(1.0, 0.3),
    "heights": HeightField(lambda x, y: 0.1 * x * x - 0.05 * x * y - 0.2 * y * y),
    "bell": Revolution(lambda s: (1.0 + 0.3 * s * s, s)),
}
LAWS = (Rolling(), RollingWithoutPivoting(), Sliding(), Apart())
FIT = {
    "cylinder": ("ball", "ellipsoid", "cone", "ball"),
    "cone": ("ball", "ellipsoid", "torus", "ball"),
    "spindle": ("plane", "cylinder", "cone", "ball"),
}
"""Surfaces for shapes that touch others along a line, or are curved less in a direction."""
PAIRS = [
    (body, base, law)
    for k, body in enumerate(SHAPES)
    for j, (base, law) in enumerate(
        zip(FIT.get(body, [list(SURFACES)[(3 * k + j) % len(SURFACES)] for j in (0, 4, 5, 7)]), LAWS, strict=True)
    )
    if j != (k + 3) % len(LAWS)
]
"""Every shape by all laws but one, every law by many shapes, and every surface."""
SHAPES["pebble"] = ImplicitSurface(lambda x, y, z: 50 * x**2 + 90 * y**2 + 150 * z**2 + 900 * x**4 - 1, (0.0, 0.0, 0.1))
SURFACES["dune"] = ImplicitSurface(lambda x, y, z: z - 0.1 * x * x + 0.05 * x * y + 0.2 * y * y + 0.1 * z**3, (0.1, 0.1, 0.0))
PAIRS += [
    (body, base, law)
    for k, (body, base) in enumerate((("pebble", "plane"), ("ellipsoid", "dune"), ("pebble", "bowl"), ("pebble", "dune")))
    for law in LAWS[k % 2 :: 2]
]


def random_state(joint: Touching, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Near the start, on the joint's invariants, where the body fits."""
    q, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("t")
    rows = joint.invariants(q, t)
    step = ca.Function("step", [q], [q - ca.pinv(ca.jacobian(rows, q)) @ rows]) if rows.numel() else None
    off = ca.Function("off", [q], [ca.densify(ca.norm_inf(ca.vertcat(0, rows)))])
    inside = ca.Function("inside", [q], [ca.densify(joint.domain(q))])
    for _ in range(100):
        found = np.array(joint.start_q()) + rng.uniform(-0.5, 0.5, joint.q.size)
        for _ in range(8 if step else 0):
            found = np.array(step(found)).ravel()
        if np.all(np.array(inside(found)) > 0.05) and float(off(found)) < 1e-14:
            return found, rng.uniform(-1, 1, joint.v.size)
    raise AssertionError("no state fits")


@pytest.mark.parametrize(("body", "base", "law"), PAIRS, ids=str)
def test_points_meet_normals_are_opposite_and_what_the_law_forbids_is_zero(body, base, law):
    """By the pose alone and how it changes; closed forms of the motion are its derivatives."""
    shape, surface = SHAPES[body], SURFACES[base]
    joint = Touching(shape, surface, law)
    q, v, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("v", joint.v.size), ca.SX.sym("t")
    X = joint.pose(q, t)
    R, p = symbolic(X.rotation), symbolic(X.position)
    count = q.numel() - (0 if law.holds else 1)
    place, own = q[count - len(surface.start) : count], q[: count - len(surface.start) - 1]
    gap, opening = (ca.SX(0), ca.SX(0)) if law.holds else (q[-1], v[-1])
    normal, point = surface.normal(place), surface.point(place) + gap * surface.normal(place)
    arm = R.T @ (point - p)
    by_normal = shape.touching(-(R.T @ normal))
    expected, outwards = (by_normal, -(R.T @ normal)) if by_normal is not None else (shape.point(own), shape.normal(own))
    rate = lambda e: ca.reshape(ca.jtimes(ca.vec(e), q, joint.rates(q, v, t)), *e.shape)  # noqa: E731
    slip = rate(p) + rate(R) @ arm
    spin = rate(R) @ R.T
    pivot = ca.dot(ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0]), normal)
    glide = ca.dot(rate(point), normal) - opening
    (motion,) = joint.motions(q, v, t)
    twist = ca.vertcat(motion.twist[:3] - R.T @ ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0]), motion.twist[3:] - R.T @ rate(p))
    acceleration = ca.vertcat(motion.bias[:3] - rate(motion.twist[:3]), motion.bias[3:] - R.T @ rate(R @ motion.twist[3:]))
    away = ca.dot(slip, normal) - opening
    forbidden = {Rolling: slip, RollingWithoutPivoting: ca.vertcat(slip, pivot), Sliding: away, Apart: away}[type(law)]
    rows = ca.vertcat(arm - expected, R @ outwards + normal, ca.vec(R.T @ R - ca.SX.eye(3)), glide, forbidden)
    closed = nearness(shape, surface, X)  # of the pose alone, touching or not
    if closed is not None and (law.holds or base in ("plane", "ball", "bowl", "torus")):
        w = R.T @ ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
        same = ca.vertcat(closed.gap - gap, closed.point_b - point, closed.normal - normal, closed.point_a - surface.point(place))
        rows = ca.vertcat(
            rows,
            same,
            closed.velocity(w, R.T @ rate(p)) - slip,
            ca.vec(closed.tangents.T @ ca.horzcat(closed.tangents, normal))[[1, 4, 5]],
        )
    f = ca.Function("f", [q, v, t], [rows, ca.vertcat(twist, acceleration), motion.subspace @ v - motion.twist])
    x, rates = random_state(joint, np.random.default_rng(1))
    found = [np.max(np.abs(np.array(part))) for part in f(x, rates, 0.0)]
    assert found[0] < 1e-13 and found[1] < 1e-11 and found[2] < 1e-13


def maximal(shape: AbstractSurface, surface: AbstractSurface, pose, twist, places, body: RigidBody) -> np.ndarray:
    """Accelerations (6,) of a body's frame in world axes, in maximal coordinates: Newton's and Euler's laws, and three rows that keep the touching
    point of the body at rest. Where the touching point goes is found from the closest points of the body moved on, not by any formula of rolling.
    """
    (R, p), (w, u), (a0, b0) = pose, twist, places
    a, b = ca.SX.sym("a", len(surface.start)), ca.SX.sym("b", len(shape.start))
    Q, d = ca.SX.sym("Q", 3, 3), ca.SX.sym("d", 3)
    apart = Q @ shape.point(b) + d - surface.point(a)
    rows = [surface.slopes(a).T @ apart, surface.slopes(a).T @ (Q @ shape.normal(b))]
    rows += [surface.invariants(a), shape.invariants(b)] + [
        part[-1] - part0[-1] for part, part0 in ((a, a0), (b, b0)) if part.numel() in (4, 7)
    ]
    y, residual = ca.vertcat(a, b), ca.vertcat(*rows)
    skew = lambda x: np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])  # noqa: E731
    changes = ca.jtimes(residual, ca.vertcat(ca.vec(Q), d), ca.vertcat(ca.vec(ca.SX(ca.DM(skew(w) @ R))), *u))
    read = ca.Function("f", [y, Q, d], [ca.jacobian(residual, y), changes, surface.point(a), ca.jacobian(surface.point(a), y)])
    slope, change, point, along = (np.array(part) for part in read(np.concatenate([a0, b0]), R, p))
    moved = (along @ np.linalg.solve(slope, -change)).ravel()
    arm = point.ravel() - p
    A, right = np.hstack([-skew(arm), np.eye(3)]), -np.cross(w, moved - u)
    centre, m = R @ np.array(body.centre_of_mass), float(body.mass)
    J = R @ np.array(body.central_inertia) @ R.T
    M = np.block([[J - m * skew(centre) @ skew(centre), m * skew(centre)], [-m * skew(centre), m * np.eye(3)]])
    bias = np.concatenate(
        [np.cross(w, J @ w) + m * np.cross(centre, np.cross(w, np.cross(w, centre))), m * np.cross(w, np.cross(w, centre))]
    )
    weight = np.concatenate([np.cross(centre, [0, 0, -m * G]), [0, 0, -m * G]])
    whole = np.block([[M, A.T], [A, np.zeros((3, 3))]])
    return np.linalg.solve(whole, np.concatenate([weight - bias, right]))[:6]


@pytest.mark.parametrize(
    ("body", "base"),
    [("ellipsoid", "plane"), ("ellipsoid", "bowl"), ("egg", "heights"), ("ball", "torus"), ("cylinder", "ball"), ("cone", "ellipsoid"), ("spindle", "cone"), ("ellipsoid", "tube"), ("pebble", "plane"), ("ellipsoid", "dune")],
)  # fmt: skip
def test_rolling_is_that_of_maximal_coordinates(body, base):
    shape, surface = SHAPES[body], SURFACES[base]
    joint = Touching(shape, surface)
    scene = on(joint, RigidBody(2.0, (0.01, 0.015, 0.02), (0.01, -0.02, 0.03)))
    model = ac.build(scene)
    frame = scene.body.frame
    seen = [
        frame.rotation,
        frame.position,
        frame.angular_velocity,
        frame.velocity,
        frame.angular_acceleration,
        frame.acceleration,
    ]
    read = model.functions.output(*seen)
    q, v = random_state(joint, np.random.default_rng(3))
    R, p, w, u, *found = (np.array(part) for part in read(0.0, np.concatenate([q, 3 * v]), [], []))
    own, place = q[: -len(surface.start)], q[-len(surface.start) :]
    if shape.touching(ca.SX.sym("n", 3)) is None:
        at = own[:-1]
    else:  # coordinates of the shape with its normal opposite to the surface's
        n = np.array(ca.DM(ca.evalf(ca.densify(surface.normal(ca.SX(ca.DM(place))))))).ravel()
        m = -R.T @ n
        at = np.array([1 + m[2], -m[1], m[0], 0.0])
        at /= np.linalg.norm(at)
    expected = maximal(shape, surface, (R, p.ravel()), (w.ravel(), u.ravel()), (place, at), scene.body)
    assert np.max(np.abs(np.concatenate(found).ravel() - expected)) < 1e-12 * np.max(np.abs(expected))


def same_motion(one: ac.System, two: ac.System, start, seconds: float = 1.0) -> float:
    """Largest difference of places and orientations of two bodies at the end; `start` makes a start from a frame."""
    ends = []
    for scene in (one, two):
        frame = scene.body.frame
        run = ac.build(scene).simulate(seconds, start(frame), rtol=1e-12)
        ends.append(np.concatenate([run[frame.position][-1], run[frame.rotation][-1].ravel()]))
    return float(np.max(np.abs(ends[0] - ends[1])))


def test_an_ellipsoid_on_a_plane_rolls_as_the_rattleback_does():
    axes, stone = (0.2, 0.03, 0.02), {"mass": 1.0, "inertia": ((2e-3, -5e-4, 0), (-5e-4, 1.6e-2, 0), (0, 0, 1.7e-2))}
    one, two = (on(contact, RigidBody(**stone)) for contact in (Touching(Ellipsoid(axes), Plane()), RollingEllipsoid(axes)))
    start = lambda frame: {frame.angular_velocity: (0.01, -0.01, -2.0), frame.rotation: np.eye(3), frame.position[:2]: (0, 0)}  # noqa: E731
    assert same_motion(one, two, start) < 1e-11
    for scene in (one, two):
        assert len(ac.build(scene).state_names) == 9


def test_a_disk_on_a_plane_rolls_as_the_wheel_does():
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # it stands on its edge
    one, two = (on(c, RigidBody.disk(1.0, 0.3, axis="z")) for c in (Touching(Disk(0.3), Plane()), RollingDisk(0.3, "z")))
    start = lambda frame: {frame.rotation: turn.T, frame.angular_velocity: (0.3, 2.0, 0.5), frame.position[:2]: (0, 0)}  # noqa: E731
    assert same_motion(one, two, start) < 1e-10


@pytest.mark.filterwarnings("ignore:.*pulls:acausal.errors.ContactWarning")  # held on both sides
@pytest.mark.parametrize("surface", [Sphere(1.0, inside_out=True), Torus(1.0, 0.3), HeightField(lambda x, y: 0.2 * x * x)])
def test_a_ball_rolls_as_its_centre_glides_on_the_parallel_surface(surface):
    ball = {"mass": 2.0, "inertia": (0.005, 0.006, 0.007), "centre_of_mass": (0.01, 0, 0.02)}
    one, two = on(Touching(Sphere(0.1), surface), RigidBody(**ball)), on(RollingBallOnSurface(0.1, surface), RigidBody(**ball))
    X = one.guide.pose(ca.SX(ca.DM(one.guide.start_q())), ca.SX(0))
    R, p = (np.array(ca.evalf(ca.densify(symbolic(e)))) for e in (X.rotation, X.position))
    start = lambda frame: {frame.rotation: R, frame.position: p.ravel(), frame.angular_velocity: (1.0, 0.5, -2)}  # noqa: E731
    assert same_motion(one, two, start) < 1e-10


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_disk_rolls_steadily_around_in_a_cone_at_any_lean(size):
    """O'Reilly, 10.8: the slope of what it rolls on does not enter, as nothing slips along it."""
    a, reach, lean, half_angle = 0.1 * size, 0.5 * size, 0.6, 0.9
    scene = on(Touching(Disk(a), Cone(half_angle)), RigidBody.disk(2.0, a, axis="z"), (0, 0, -G * size))
    # the contact at (reach, 0); the disk's centre towards the cone's axis and up; its axle in the plane y = 0
    up = np.array([-np.sin(lean), 0.0, np.cos(lean)])
    axle = np.array([np.cos(lean), 0.0, np.sin(lean)])
    contact = np.array([reach, 0.0, reach / np.tan(half_angle)])
    centre = contact + a * up

    def turning(W: float) -> np.ndarray:
        """Angular velocity around z with rate W, the touching point of the disk at rest."""
        return np.array([0, 0, W]) + W * np.cross([0, 0, 1], contact)[1] / np.cross(axle, a * up)[1] * axle

    def missing(W: float) -> float:
        spin = 2.0 * a * a * 0.25 * (np.eye(3) + np.outer(axle, axle)) @ turning(W)
        torque = np.cross(-a * up, 2.0 * np.array([-(W**2) * centre[0], 0, G * size]))
        return float((np.cross([0, 0, W], spin) - torque)[1] / size**2)

    W = brentq(missing, 0.1, 30.0, xtol=1e-15)
    frame = scene.body.frame
    rotation = np.column_stack([up, np.cross(axle, up), axle])
    start = {frame.position: centre, frame.rotation: rotation, frame.angular_velocity: turning(W)}
    run = ac.build(scene).simulate(5.0, start, rtol=1e-12)
    p = run[frame.position]
    assert np.max(np.abs(p[:, 2] - centre[2])) < 1e-10 * size
    assert np.max(np.abs(np.hypot(p[:, 0], p[:, 1]) - centre[0])) < 1e-10 * size
    assert abs(np.unwrap(np.arctan2(p[:, 1], p[:, 0]))[-1] - 5.0 * W) < 1e-9


def test_chaplygins_ball_keeps_its_angular_momentum_about_the_point_that_touches():
    """Uneven, its centre of mass in the middle: the momentum about the contact rests in space. Chaplygin (1903)."""
    m, r, inertia = 2.0, 0.3, np.array([0.05, 0.07, 0.09])
    scene = on(Touching(Sphere(r), Plane()), RigidBody(m, tuple(inertia)))
    frame = scene.body.frame
    run = ac.build(scene).simulate(5.0, {frame.angular_velocity: (1.0, 2.0, -0.5)}, rtol=1e-12)
    R, w = run[frame.rotation], run[frame.angular_velocity]
    own = np.einsum("nij,j,nkj,nk->ni", R, inertia, R, w)
    about = own + m * r * np.cross([0, 0, 1.0], run[frame.velocity])
    assert np.max(np.abs(about - about[0])) < 1e-12


def test_a_ball_on_a_turntable_runs_around_circles_with_two_sevenths_of_its_rate():
    scene = ac.System()
    scene.world, scene.drive, scene.table = (
        World(),
        PrescribedMotion(axis="z", angle=3.0 * ac.time),
        RigidBody.disk(5.0, 1.0, "z"),
    )
    scene.contact, scene.body = Touching(Sphere(0.1), Plane()), RigidBody.ball(1.0, 0.1)
    scene.connect(scene.world.frame, scene.drive.frame_a)
    scene.connect(scene.drive.frame_b, scene.table.frame)
    scene.connect(scene.table.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.body.frame)
    frame = scene.body.frame
    run = ac.build(scene).simulate(4.0, {frame.position[:2]: (0.3, 0.0), frame.velocity[:2]: (0.0, 0.2)}, rtol=1e-12)
    rate = 3.0 * 2 / 7
    z = (run[frame.position] @ [1, 1j, 0]).ravel()
    centre = 0.3 - 0.2 / rate
    assert np.max(np.abs(z - centre - 0.2 / rate * np.exp(1j * rate * run.t))) < 1e-11


@pytest.mark.parametrize(("law", "share"), [(Rolling(), 5 / 7), (RollingWithoutPivoting(), 5 / 7), (Sliding(), 1.0)], ids=str)
def test_a_ball_runs_down_a_ball_as_a_pendulum_upside_down(law, share):
    """theta'' = 5/7 g / (R + r) sin(theta) in a plane, by any law that does not slip; smooth, it slides with g / (R + r)."""
    scene = on(Touching(Sphere(0.1), Sphere(1.0), law), RigidBody.ball(2.0, 0.1))
    frame, rate = scene.body.frame, share * G / 1.1
    start = {frame.position: (1.1 * np.sin(0.3), 0, 1.1 * np.cos(0.3)), scene.guide.v: [0.0] * law.freedoms}
    run = ac.build(scene).simulate(0.5, start, rtol=1e-12)
    exact = solve_ivp(lambda t, y: [y[1], rate * np.sin(y[0])], (0, 0.5), [0.3, 0], method="DOP853", rtol=1e-13, atol=1e-14)
    assert abs(run[frame.position][-1, 0] - 1.1 * np.sin(exact.y[0, -1])) < 1e-11


@pytest.mark.filterwarnings("ignore:.*pulls:acausal.errors.ContactWarning")  # held on both sides
def test_an_egg_rolls_on_a_free_potato_without_any_ground():
    """Two free bodies that touch: both momenta and the energy are kept."""
    scene = ac.System()
    scene.world, scene.potato = World((0, 0, 0)), RigidBody(3.0, (0.5, 0.6, 0.7), (0.02, 0, 0.01))
    scene.contact, scene.egg = (
        Touching(SHAPES["egg"], Ellipsoid((0.5, 0.4, 0.3))),
        RigidBody(1.0, (0.01, 0.012, 0.015), (0, 0, 0.01)),
    )
    scene.connect(scene.potato.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.egg.frame)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 9
    w = scene.potato.frame
    run = model.simulate(0.5, {w.angular_velocity: (0.3, 0.2, -0.4), scene.contact.v: (1.0, -2.0, 0.5)}, rtol=1e-12)
    assert run.energy_error() < 1e-12
    momentum, spin = np.zeros((run.t.size, 3)), np.zeros((run.t.size, 3))
    for body, inertia in ((scene.potato, (0.5, 0.6, 0.7)), (scene.egg, (0.01, 0.012, 0.015))):
        m, R = float(body.mass), run[body.frame.rotation]
        momentum += m * run[body.centre.velocity]
        spin += np.cross(run[body.centre.position], m * run[body.centre.velocity])
        spin += np.einsum("nij,j,nkj,nk->ni", R, np.array(inertia), R, run[body.frame.angular_velocity])
    assert np.max(np.abs(momentum - momentum[0])) < 1e-12
    assert np.max(np.abs(spin - spin[0])) < 1e-12


def test_what_it_costs():
    """States and operations of right sides, for bodies without symmetry."""
    body = {"mass": 2.0, "inertia": (0.01, 0.015, 0.02)}
    for shape, base, law, states, most in (
        ("ellipsoid", "plane", Rolling(), 9, 263), ("disk", "plane", Rolling(), 9, 185), ("disk", "bowl", Rolling(), 11, 309),
        ("disk", "heights", Rolling(), 9, 359), ("cylinder", "ball", Rolling(), 10, 322), ("ellipsoid", "plane", Sliding(), 11, 503),
    ):  # fmt: skip
        model = ac.build(on(Touching(SHAPES[shape], SURFACES[base], law), RigidBody(**body)))
        assert len(model.state_names) == states
        assert int(str(model).split(" operations")[0].split()[-1]) <= most


@pytest.mark.parametrize(("body", "base"), [("ball", Sphere(0.09, inside_out=True)), ("cylinder", Plane()), ("spindle", Sphere(1.0, inside_out=True)), ("cone", Plane())])  # fmt: skip
def test_what_touches_in_more_than_one_point_or_does_not_fit_is_named(body, base):
    scene = on(Touching(SHAPES[body], base), RigidBody.ball(2.0, 0.2))
    with pytest.raises(errors.AssemblyError, match=r"guide.*test_touching.py:\d+.*curved less than the hollow") as told:
        ac.build(scene)
    assert ("RollingCylinder" in str(told.value)) == (body != "ball") and "convex" not in str(told.value)


@pytest.mark.parametrize(
    ("body", "base", "law"),
    [
        ("cone", "torus", Hard()),
        ("cylinder", "cylinder", Sliding()),
        ("spindle", "tube", HuntCrossley(1e4)),
        ("fat", "bowl", Hard()),
    ],
)
def test_a_search_for_a_start_begins_at_the_same_place_at_any_size(body, base, law):
    """Well inside of where the body fits, whichever way it must be turned: a spindle lies along a tube, cylinders cross."""
    found = []
    for size in (1.0, 3e-5):
        shape = {"cone": Cone(0.4, outside=True), "cylinder": Cylinder(0.1 * size), "spindle": Revolution(lambda s, size=size: (0.1 * size - 0.2 * s**2 / size, s)), "fat": Parallel(Ellipsoid((0.1 * size, 0.05 * size, 0.05 * size)), 0.03 * size)}[body]  # fmt: skip
        surface = {"torus": Torus(size, 0.3 * size), "cylinder": Cylinder(0.8 * size), "tube": Cylinder(0.8 * size, inside_out=True), "bowl": Sphere(size, inside_out=True)}[base]  # fmt: skip
        scene = on(Contact(shape, surface, law), RigidBody(2.0, size**2 * np.array([0.01, 0.015, 0.02])), (0, 0, -G * size))
        model = ac.build(scene)
        x = model.initial_state({scene.guide.gap: 1e-3 * size} if isinstance(law, Hard | HuntCrossley) else {}).x
        assert np.min(np.array(model.functions.output(model.functions.borders[0].values)(0.0, x, [], []))) > 0.05
        found.append(np.where(scene.guide.joint.turns(), 1.0, 1 / size) * x[: scene.guide.q.size])
    assert np.max(np.abs(found[1] - found[0])) < 1e-9


@each_value(("size", [1e-3, 1.0, 1e3]), ("radius", [0.7, 0.9, 1.1]))
def test_a_body_whose_normal_points_inwards_where_its_search_begins_is_turned_and_not_carried_away(radius, size):
    """By some radians. How well it fits does not change around a tube but by rounding, which is no way to go."""
    axes, scene = np.array([0.2, 0.15, 0.1]) * size, ac.System()
    inwards = ParametricSurface(
        lambda a, b: (axes[0] * ca.cos(a) * ca.cos(b), axes[1] * ca.cos(a) * ca.sin(b), axes[2] * ca.sin(a)),
        "rad",
        start=(-1.0, 0.3),
    )
    scene.world, scene.body = World((0, 0, -10.0 * size)), RigidBody(1.0, size**2 * np.array([0.02, 0.03, 0.04]))
    scene.contact = Contact(inwards, Cylinder(radius * size, inside_out=True))
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.body.frame)
    found = ac.build(scene).initial_state({}).x
    assert np.max(np.abs(found[:5] / [1, 1, 1, size, size])) < 10.0


@pytest.mark.parametrize(("rtol", "size"), [(1e-9, 1e-3), (1e-6, 1e3)])
def test_a_disk_in_flight_that_would_lie_flat_ends_there_and_never_changes_its_energy(rtol, size):
    """What is nearest of its edge jumps to the other side there. Thrown beside a torus, of which it misses that place or not."""
    ended = 0
    scene = ac.System()
    scene.world, scene.body = World((0, 0, -3.0 * size)), RigidBody(1.0, size**2 * np.array([0.02, 0.03, 0.04]))
    scene.contact = Contact(Disk(0.15 * size), Torus(2.0 * size, 0.5 * size), Hard(1.0))
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.body.frame)
    model = ac.build(scene)
    for seed in (12, 22, 38):
        start = {
            scene.body.frame.angular_velocity: 2 * np.random.default_rng(seed).normal(size=3),
            scene.contact.gap: 0.05 * size,
        }
        run = model.simulate(1.5, start, rtol=rtol, raise_on_failure=False, samples=2)
        assert run.energy_error() < 10 * rtol
        ended += run.status.kind.name == "OUTSIDE"
    assert ended == 2


def test_what_comes_to_where_it_fits_no_more_is_told_by_part_and_line():
    """A disk rolls down into a funnel; a disk lies flat over the ground; a spindle is too long for its bowl; a table ends. Only what is the cause is said."""
    scene = on(Touching(Disk(0.1), Cone(0.9)), RigidBody(2.0, (0.012, 0.015, 0.02), (0.01, -0.01, 0.012)), (1.0, 2.0, -G))
    with pytest.raises(
        errors.SimulationError, match=r"'guide' \(.*test_touching.py:\d+\) has come to where it has no meaning.*curved less than"
    ) as told:
        ac.build(scene).simulate(2.0)
    assert not re.search("several|points|convex|ends|Cylinder", str(told.value).split("meaning")[1])
    table = ParametricSurface(lambda u, v: (u, v, 0.02 * u * u), ends=((-0.3, 0.3), (-0.5, 0.5)))
    rolls = on(Contact(SHAPES["egg"], table), RigidBody.ball(2.0, 0.1), (1.0, 0.0, -G))
    with pytest.raises(errors.SimulationError, match="The surface ends") as told:
        ac.build(rolls).simulate(5.0)
    assert not re.search("curved|convex|points|Cylinder", str(told.value).split("meaning")[1])
    flat = on(Contact(Disk(0.1), Plane(), HuntCrossley(1e4)), RigidBody.disk(1.0, 0.1, axis="z"))
    with pytest.raises(errors.StartValueError, match=r"'guide' \(.*test_touching.py:\d+\).* lies flat"):
        ac.build(flat).simulate(1.0, {flat.body.frame.position[2]: 0.1})
    long = on(Contact(SHAPES["spindle"], Sphere(1.0, inside_out=True), Hard()), RigidBody.ball(1.0, 0.1))
    with pytest.raises(errors.AssemblyError, match=r"joint 'guide' \(.*test_touching.py:\d+\).*inside its domain.*curved less"):
        ac.build(long).initial_state({long.guide.gap: 1e-3})


def test_a_shape_that_is_not_convex_is_refused_where_it_is_made_and_where_it_touches():
    """h = (r + b z^2) for normals of length 1 has the radii of curvature r + 2 b and r at its equator, r - b at its poles."""

    def egg(b) -> ConvexShape:
        return ConvexShape(lambda n: 0.1 * ca.norm_2(n) + b * n[2] ** 2 / ca.norm_2(n))

    for wrong, words in (
        (lambda: egg(-0.06), "of no convex shape"),
        (lambda: egg(0.11), "of no convex shape"),
        (lambda: ConvexShape(lambda n: 0.1 * ca.sumsqr(n)), "m for 2 n"),
    ):
        with pytest.raises(errors.ParameterError, match=rf"{words}.*test_touching.py:\d+"):
            wrong()
    egg(-0.049), egg(0.099)
    for law, surface in ((Rolling(), Plane()), (Sliding(), Sphere(1.0)), (Hard(), Plane())):
        bend = ac.Parameter(0.0, "m")
        scene = on(Contact(egg(bend.sx), surface, law), RigidBody(2.0, (0.01, 0.015, 0.02)), (0, 0, -G))
        model = ac.build(scene)
        height = {scene.body.frame.position[2]: 0.3 + (not isinstance(surface, Plane))} if isinstance(law, Hard) else {}
        start = {scene.body.frame.rotation: np.eye(3), scene.body.frame.position[:2]: (0.0, 0.0), **height}
        model.simulate(0.05, start, parameters={bend: 0.09})
        with pytest.raises((errors.SimulationError, errors.StartValueError, errors.AssemblyError), match="not convex there"):
            model.simulate(1.0, start, parameters={bend: 0.12})


def test_hard_contacts_are_decided_alike_at_any_size():
    """What may push, and by what: looked at in places that are as far apart as bodies, tracks and ground are large."""
    for size in (4.0**-8, 1.0, 4.0**7):
        ground = Revolution(lambda s, size=size: (size + 0.3 * s * (s / size), s))
        rolls = on(Contact(Cylinder(0.1 * size), ground, Hard(0.5)), RigidBody(2.0, size**2 * np.array([0.012, 0.015, 0.02])))
        bumps = HeightField(lambda x, y, size=size: 0.1 * size * ca.cos(3 * x / size) + (y / size) ** 2 * size)
        hops = on(PointOnSurface(bumps, unilateral=True, friction=Coulomb(0.3)), Particle(1.0))
        for scene in (rolls, hops):
            modes = ac.build(scene).system.modes
            assert modes is not None and len(modes.rows) == 1 + (scene is hops)


def test_a_wheel_of_a_free_body_may_close_a_loop():
    """Held by a free joint as well, its coordinates stay and the motion is the same."""
    shape, surface = SHAPES["ellipsoid"], SURFACES["heights"]
    one = on(Touching(shape, surface), RigidBody(2.0, (0.01, 0.015, 0.02)))
    two = on(Touching(shape, surface), RigidBody(2.0, (0.01, 0.015, 0.02)))
    two.free = Free()
    two.connect(two.world.frame, two.free.frame_a)
    two.connect(two.free.frame_b, two.body.frame)
    start = lambda frame: {frame.rotation: np.eye(3), frame.position[:2]: (0.0, 0.0), frame.angular_velocity: (1.0, 0.5, -2)}  # noqa: E731
    assert same_motion(one, two, start, 0.5) < 1e-9


@pytest.mark.parametrize(
    ("body", "base", "law"),
    [
        ("ellipsoid", "bowl", RollingWithoutPivoting()),
        ("spindle", "cone", Rolling()),
        ("cylinder", "ball", Sliding()),
        ("disk", "heights", Rolling()),
    ],
    ids=str,
)
def test_what_holds_bodies_together_moves_bodies_apart_alike(body, base, law):
    """The force of the contact at its point, and its torque about the normal, put on a body that nothing holds: the same accelerations, and none of the gap."""
    stone = {"mass": 2.0, "inertia": (0.01, 0.015, 0.02), "centre_of_mass": (0.01, -0.02, 0.03)}
    scene = on(Touching(SHAPES[body], SURFACES[base], law), RigidBody(**stone))
    q, v = random_state(scene.guide, np.random.default_rng(5))
    contact, frame = scene.guide, scene.body.frame
    seen = (contact.point_b, contact.force, frame.rotation, frame.position, contact.axes(contact.q.sx), frame.torque, frame.angular_velocity, contact.slip, frame.angular_acceleration, frame.acceleration)  # fmt: skip
    read = ac.build(scene).functions.output(
        *(e if isinstance(e, ac.Expression) else ac.Expression(e, frozenset({contact.q})) for e in seen)
    )
    point, force, R, p, axes, torque, w, slip, *expected = (np.array(x) for x in read(0.0, np.concatenate([q, v]), [], []))
    loose = on(Touching(SHAPES[body], SURFACES[base], Apart()), RigidBody(**stone))
    loose.push, loose.twist = (
        Force(tuple(force.ravel())),
        Torque(tuple(torque.ravel() - np.cross((point - p).ravel(), force.ravel()))),
    )
    loose.connect(loose.push.point, loose.body.at(tuple((R.T @ (point - p)).ravel())))
    loose.connect(loose.twist.frame, loose.body.frame)
    rates = np.concatenate([(R.T @ w).ravel(), (axes[:, :2].T @ slip).ravel(), [0.0]])
    frame, gap = loose.body.frame, loose.guide.v[5]
    read = ac.build(loose).functions.output(frame.angular_acceleration, frame.acceleration, ac.der(gap))
    *found, opening = (np.array(x) for x in read(0.0, np.concatenate([q, [0.0], rates]), [], []))
    size = np.max(np.abs(np.concatenate(expected)))
    assert np.max(np.abs(np.concatenate(found) - np.concatenate(expected))) < 1e-12 * size
    assert abs(opening.item()) < 1e-12 * size


@settings(max_examples=5, deadline=None, derandomize=True)
@given(
    st.sampled_from(["ellipsoid", "tyre", "ball", "spindle"]), st.sampled_from(LAWS[:3]), st.integers(-6, 6),
    st.tuples(*[st.floats(-1, 1)] * 3), st.integers(0, 2**31),
)  # fmt: skip
def test_random_bodies_on_random_ground_keep_their_energy(kind, law, decade, bends, seed):
    """Any size: what the contact exerts does no work, and its point neither slips nor parts where the law forbids it."""
    length, rng = 10.0**decade, np.random.default_rng(seed)
    a, b, c = rng.uniform(0.05, 0.3, 3) * length
    shape = {
        "ellipsoid": Ellipsoid((a, b, c)), "tyre": Torus(max(a, b), min(a, b)), "ball": Sphere(a), "spindle": Revolution(lambda s: (a - s**2 / (2 * length), s)),
    }[kind]  # fmt: skip
    ground = HeightField(lambda x, y: (bends[0] * x * x + bends[1] * x * y + bends[2] * y * y) / (3 * length))
    joint = Touching(shape, ground, law)
    scene = on(
        joint, RigidBody(1.3, length**2 * np.array([0.02, 0.03, 0.025]), length * np.array([0.02, -0.01, 0.03])), (1.0, 2.0, -G)
    )
    model = ac.build(scene)
    s, outputs, frame = model.system, model.functions.outputs, scene.body.frame
    force, torque, velocity, turning = (
        outputs.resolve(e) for e in (frame.force, frame.torque, frame.velocity, frame.angular_velocity)
    )
    powers = ca.vertcat(ca.vec(force * velocity), ca.vec(torque * turning))
    energy = outputs.kinetic_energy + outputs.potential_energy
    change = ca.jacobian(energy, s.x).T * s.x_dot
    slip, across = outputs.resolve(joint.slip), outputs.resolve(joint.friction_force)
    f = ca.Function("f", [s.t, s.x], [powers, change, slip, across, force])
    own = np.array(joint.start_q())
    unit = np.where(joint.turns(), 1.0, length)
    for k in range(3):
        q = own + unit * rng.uniform(-0.1, 0.1, own.size)
        if own.size == 6 and kind != "spindle":
            q[:4] /= np.linalg.norm(q[:4])
        v = rng.uniform(-1, 1, joint.v.size) * np.where(np.arange(joint.v.size) < 3, 1.0, length)
        powers, change, slip, across, force = (np.array(part).ravel() for part in f(0.0, np.concatenate([q, v])))
        assert abs(np.sum(powers)) < 1e-11 * np.sum(np.abs(powers)), k
        assert abs(np.sum(change)) < 1e-11 * np.sum(np.abs(change)), k
        assert (
            np.max(np.abs(slip)) < 1e-13 * length if law.freedoms < 5 else np.max(np.abs(across)) < 1e-11 * np.max(np.abs(force))
        )


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_cube_by_its_support_turns_about_its_corner_until_an_edge_lies_down(size: float) -> None:
    """As on a ball joint in that corner; a support that switches where its point does not jump is passed."""
    half, time = 0.1 * size, np.sqrt(size)
    spin = np.array([0.8, -0.5, 0.3]) / time
    turned = Rotation.from_rotvec((0.35, -0.5, 0.1)).as_matrix()
    scene = on(
        Contact(ConvexShape(lambda n: half * (ca.fabs(n[0]) + ca.fabs(n[1]) + ca.fabs(n[2]))), Plane()),
        RigidBody.box(2.0, (2 * half,) * 3),
    )
    start = {scene.body.frame.rotation: turned, scene.body.frame.angular_velocity: spin}
    other = ac.System()
    other.world, other.joint, other.body = World(), Spherical(), RigidBody.box(2.0, (2 * half,) * 3)
    corner = -half * np.sign(turned[2])
    other.connect(other.world.frame, other.joint.frame_a)
    other.connect(other.joint.frame_b, other.body.at(corner))
    lies = [ac.when(other.body.frame.rotation[2, k], stop=True) for k in range(3)]
    pivots = ac.build(other).simulate(
        3 * time, {other.body.frame.rotation: turned, other.body.frame.angular_velocity: spin}, rtol=1e-11, events=lies
    )
    with pytest.raises(errors.SimulationError, match=r"'guide' .*touches in more than one point") as told:
        ac.build(scene).simulate(3 * time, start, rtol=1e-11)
    run = told.value.trajectory
    assert (
        run.t[-1] == pytest.approx(pivots.t[-1], rel=1e-5) and 0.1 * time < run.t[-1]
    )  # where the normal is within 1e-6 of a face
    times = np.linspace(0, 0.99 * run.t[-1], 20)
    assert run.at(times)[scene.body.frame.rotation] == pytest.approx(pivots.at(times)[other.body.frame.rotation], abs=1e-9)
    bulge = on(
        Contact(ConvexShape(lambda n: half * (ca.norm_2(n) + ca.fmax(n[0], 0) ** 2 / ca.norm_2(n))), Plane()),
        RigidBody.ball(2.0, half),
    )
    run = ac.build(bulge).simulate(3 * time, {bulge.body.frame.angular_velocity: (0, 3.0 / time, 0)}, rtol=1e-10)
    assert run.energy_error() < 1e-8 and np.ptp(np.sign(run[bulge.body.frame.rotation[2, 0]])) == 2
