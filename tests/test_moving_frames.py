"""Constraints against frames that move: particles, loops and rolling balls on frames that are shifted, turned, or driven by inputs.

Against Lagrange's equations in one coordinate u with positions p(u, t) of particles, made by CasADi and integrated by SciPy.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from components import (
    Contact,
    Free,
    PointOnPlane,
    PrescribedMotion,
    Prismatic,
    Revolute,
    RigidBody,
    Rod,
    RollingBall,
    Sphere,
    VelocitySource,
    World,
)

G = 9.81
MOVES: dict[str, tuple[Callable, Callable]] = {
    "shifted": (lambda t: (0.2 * ca.sin(3 * t), 0.0, 0.1 * t * t), lambda t: 0.0),
    "turned": (lambda t: (0.0, 0.0, 0.0), lambda t: 0.4 * ca.sin(2 * t)),
    "both": (lambda t: (0.3 * ca.cos(2 * t), 0.0, 0.1 * ca.sin(5 * t)), lambda t: 0.3 + 0.2 * ca.sin(3 * t)),
}


def motion(
    points: Callable[[ca.SX, ca.SX], list[ca.SX]], masses: list[float], start: float, rate: float, times: np.ndarray
) -> np.ndarray:
    """u at the times, of particles at `points`(u, t) in gravity along -z."""
    u, v, t = (ca.SX.sym(name) for name in "uvt")
    at = points(u, t)
    speeds = [ca.jacobian(p, u) * v + ca.jacobian(p, t) for p in at]
    T = sum(0.5 * m * ca.sumsqr(speed) for m, speed in zip(masses, speeds, strict=True))
    V = sum(m * G * p[2] for m, p in zip(masses, at, strict=True))
    push = ca.jacobian(T, v)
    known = ca.jacobian(push, u) * v + ca.jacobian(push, t)
    law = ca.Function("law", [t, u, v], [(ca.jacobian(T - V, u) - known) / ca.jacobian(push, v)])
    return solve_ivp(
        lambda t, y: [y[1], float(law(t, *y))], (0, times[-1]), [start, rate], "DOP853", times, rtol=1e-12, atol=1e-12
    ).y[0]


def turned(angle: ca.SX, x: ca.SX, z: ca.SX) -> ca.SX:
    """(x, 0, z) turned about y."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(c * x + s * z, 0, -s * x + c * z)


def carried(move: str) -> tuple[ac.System, Callable[[ca.SX, ca.SX, ca.SX], ca.SX]]:
    """A world with a moving frame, `scene.table.frame_b`, and where points of that frame are."""
    shift, angle = MOVES[move]
    scene = ac.System()
    scene.world, scene.table = World(), PrescribedMotion(shift, angle, axis="y")
    scene.connect(scene.world.frame, scene.table.frame_a)
    return scene, lambda x, z, t: ca.vertcat(*shift(t)) + turned(angle(t), x, z)


def on_slides(scene: ac.System, mass: float) -> ac.Connector:
    """The frame of a particle that moves along x and z of the world."""
    scene.along, scene.up, scene.bead = Prismatic("x"), Prismatic("z"), RigidBody.ball(mass, 0.01)
    scene.connect(scene.world.frame, scene.along.frame_a)
    scene.connect(scene.along.frame_b, scene.up.frame_a)
    scene.connect(scene.up.frame_b, scene.bead.frame)
    return scene.bead.frame


def check(
    scene: ac.System, start: dict, found: list[ac.Expression], exact: Callable[[np.ndarray], np.ndarray], end: float = 1.5
) -> None:
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(end, start, rtol=1e-11)
    for entry, values in zip(found, np.atleast_2d(exact(run.t)), strict=True):
        np.testing.assert_allclose(run[entry], values, atol=2e-9)
    assert run.constraint_error() < 1e-12
    assert run.energy_error() < 1e-8


def along(p: Callable[[ca.SX, ca.SX], ca.SX], u: np.ndarray, times: np.ndarray) -> np.ndarray:
    """x and z of a point p(u, t)."""
    a, b = ca.SX.sym("u"), ca.SX.sym("t")
    return np.array(ca.Function("p", [a, b], [p(a, b)])(u[None, :], times[None, :]))[[0, 2]]


def started(p: Callable[[ca.SX, ca.SX], ca.SX], u: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """x and z of a point p(u, t) at t = 0, and their rates."""
    a, b = ca.SX.sym("u"), ca.SX.sym("t")
    value = ca.Function("p", [a, b], [p(a, b), ca.jacobian(p(a, b), a) * rate + ca.jacobian(p(a, b), b)])(u, 0.0)
    return np.array(value[0])[[0, 2], 0], np.array(value[1])[[0, 2], 0]


@pytest.mark.parametrize("move", MOVES)
def test_a_bead_on_a_moving_plane(move):
    scene, place = carried(move)
    scene.contact = PointOnPlane()
    scene.connect(scene.table.frame_b, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, on_slides(scene, 2.0))
    point = lambda u, t: place(u, ca.SX(0), t)  # noqa: E731
    (x, _), (v, _) = started(point, 0.2, 0.5)
    check(
        scene,
        {scene.along.q: x, scene.along.v: v},
        [scene.along.q, scene.up.q],
        lambda times: along(point, motion(lambda u, t: [point(u, t)], [2.0], 0.2, 0.5, times), times),
        0.6,
    )


@pytest.mark.parametrize("move", MOVES)
def test_a_particle_on_a_rod_from_a_moving_point(move):
    scene, place = carried(move)
    scene.rod, scene.mount = Rod(0.7), RigidBody.ball(1.0, 0.01)
    scene.arm = scene.table.frame_b
    scene.connect(scene.table.frame_b, scene.mount.frame)
    scene.connect(scene.mount.at((0.1, 0, 0.2)), scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, on_slides(scene, 2.0))
    point = lambda u, t: place(ca.SX(0.1), ca.SX(0.2), t) + 0.7 * ca.vertcat(ca.sin(u), 0, -ca.cos(u))  # noqa: E731
    at, speed = started(point, 0.4, 0.3)
    check(
        scene,
        {scene.along.q: at[0], scene.up.q: ac.near(at[1]), scene.along.v: speed[0]},
        [scene.along.q, scene.up.q],
        lambda times: along(point, motion(lambda u, t: [point(u, t)], [2.0], 0.4, 0.3, times), times),
    )


@pytest.mark.parametrize(("move", "joint"), [("shifted", "rod"), ("turned", "rod"), ("both", "revolute")])
def test_a_loop_of_two_links_between_the_world_and_a_moving_plane(move, joint):
    """A crank in the world, a coupler to a slider on the moving plane: the crank's angle follows from nothing but the motion and inertia."""
    scene, place = carried(move)
    scene.crank, scene.hinge, scene.slide, scene.sledge = (
        RigidBody(1.0, (1e-9, 1e-9, 1e-9), (0, 0, -0.8)),
        Revolute("y"),
        Prismatic("x"),
        RigidBody.ball(0.5, 0.01),
    )
    scene.connect(scene.world.at((0.1, 0, 1.0)), scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.crank.frame)
    scene.connect(scene.table.frame_b, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.sledge.frame)
    tip = lambda u: ca.vertcat(0.1 - 0.8 * ca.sin(u), 0, 1.0 - 0.8 * ca.cos(u))  # noqa: E731
    if joint == "rod":
        scene.coupler = Rod(1.5)
        scene.connect(scene.crank.at((0, 0, -0.8)), scene.coupler.frame_a)
        scene.connect(scene.coupler.frame_b, scene.sledge.frame)
    else:
        scene.bar, scene.pins = RigidBody(1e-9, (1e-12, 1e-12, 1e-12)), [Revolute("y"), Revolute("y")]
        scene.connect(scene.crank.at((0, 0, -0.8)), scene.pins[0].frame_a)
        scene.connect(scene.pins[0].frame_b, scene.bar.frame)
        scene.connect(scene.bar.at((1.5, 0, 0)), scene.pins[1].frame_a)
        scene.connect(scene.pins[1].frame_b, scene.sledge.frame)

    def points(u: ca.SX, t: ca.SX) -> list[ca.SX]:
        origin, direction = place(ca.SX(0), ca.SX(0), t), place(ca.SX(1), ca.SX(0), t) - place(ca.SX(0), ca.SX(0), t)
        d = tip(u) - origin
        shadow = ca.dot(d, direction)
        return [tip(u), origin + (shadow + ca.sqrt(1.5**2 - ca.sumsqr(d) + shadow**2)) * direction]

    check(
        scene,
        {scene.hinge.q: 0.3, scene.hinge.v: 0.2, scene.slide.q: ac.near(1.5)}
        | ({scene.pins[0].q: ac.near(0.0)} if joint == "revolute" else {}),
        [scene.hinge.q],
        lambda times: motion(points, [1.0, 0.5], 0.3, 0.2, times),
        1.0,
    )


@pytest.mark.parametrize("tied", ["rod", "plane"])
def test_a_frame_that_an_input_drives(tied):
    """A carriage at the velocity of an input, and a pendulum or an incline on it."""
    scene = ac.System()
    scene.world, scene.rail, scene.carriage, scene.speed = World(), Prismatic("x"), RigidBody.ball(3.0, 0.1), ac.Input("m/s")
    scene.drive = VelocitySource(scene.speed)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.carriage.frame)
    scene.connect(scene.drive.flange, scene.rail.flange)
    frame = on_slides(scene, 2.0)
    if tied == "rod":
        scene.tie = Rod(0.7)
        scene.connect(scene.carriage.frame, scene.tie.frame_a)
        point = lambda u, t: ca.vertcat(0.2 * (1 - ca.cos(3 * t)), 0, 0) + 0.7 * ca.vertcat(ca.sin(u), 0, -ca.cos(u))  # noqa: E731
    else:
        scene.tie = PointOnPlane()
        scene.connect(scene.carriage.at((0, 0, 0), rotation=("y", 0.5)), scene.tie.frame_a)
        point = lambda u, t: ca.vertcat(0.2 * (1 - ca.cos(3 * t)), 0, 0) + turned(ca.SX(0.5), u, ca.SX(0))  # noqa: E731
    scene.connect(scene.tie.frame_b, frame)
    at, speed = started(point, 0.4, 0.3)
    model = ac.build(scene)
    start = {scene.rail.q: 0.0, scene.along.q: at[0], scene.up.q: ac.near(at[1]), scene.along.v: speed[0]}
    run = model.simulate(1.0, start, inputs={scene.speed: lambda t: 0.6 * np.sin(3 * t)}, rtol=1e-11)
    exact = along(point, motion(lambda u, t: [point(u, t)], [2.0], 0.4, 0.3, run.t), run.t)
    np.testing.assert_allclose(run[scene.along.q], exact[0], atol=2e-9)
    np.testing.assert_allclose(run[scene.up.q], exact[1], atol=2e-9)
    assert run.constraint_error() < 1e-12


@pytest.mark.parametrize("where", ["tree", "loop"])
def test_a_ball_rolls_on_a_turntable_and_on_a_shaken_plate(where):
    """On a turntable the centre runs around a circle at 2/7 of its rate, whatever the start; on a plate it follows 2/7 of the shift."""
    W, a = 3.0, 0.2

    def rolled(table: PrescribedMotion) -> tuple[ac.System, ac.Model]:
        scene = ac.System()
        scene.world, scene.table, scene.contact, scene.ball = World(), table, RollingBall(0.1), RigidBody.ball(2.0, 0.1)
        scene.connect(scene.world.frame, scene.table.frame_a)
        scene.connect(scene.table.frame_b, scene.contact.frame_a)
        scene.connect(scene.contact.frame_b, scene.ball.frame)
        if where == "loop":
            scene.free = Free()
            scene.connect(scene.world.frame, scene.free.frame_a)
            scene.connect(scene.free.frame_b, scene.ball.frame)
        return scene, ac.build(scene)

    scene, model = rolled(PrescribedMotion(angle=W * ac.time, axis="z"))
    place = scene.ball.frame.position
    rate = scene.ball.frame.velocity
    run = model.simulate(4.0, {place[0]: 0.3, place[1]: 0.0, rate[0]: 0.1, rate[1]: 0.2}, rtol=1e-11)
    w = 2 / 7 * W
    x, y = (
        0.3 + (0.1 * np.sin(w * run.t) - 0.2 * (1 - np.cos(w * run.t))) / w,
        (0.1 * (1 - np.cos(w * run.t)) + 0.2 * np.sin(w * run.t)) / w,
    )
    np.testing.assert_allclose(run[place], np.stack([x, y, 0.1 + 0 * x], axis=1), atol=1e-9)
    scene, model = rolled(PrescribedMotion(position=lambda t: (a * (1 - ca.cos(4 * t)), 0.0, 0.0)))
    run = model.simulate(
        2.0,
        {
            scene.ball.frame.velocity[0]: 0.0,
            scene.ball.frame.velocity[1]: 0.3,
            scene.ball.frame.position[0]: 0.0,
            scene.ball.frame.position[1]: 0.0,
        },
        rtol=1e-11,
    )
    shift = 2 / 7 * a * (1 - np.cos(4 * run.t))
    np.testing.assert_allclose(run[scene.ball.frame.position], np.stack([shift, 0.3 * run.t, 0.1 + 0 * shift], axis=1), atol=1e-9)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_a_ball_begins_at_rest_in_a_shaken_bowl(angle, size):
    """With the bowl's own velocity, which the start says to the last bit or not; then 7/5 (R - r) angle'' = -g sin(angle) - X'' cos(angle)."""
    R, r, slow = size, 0.1 * size, 1 / np.sqrt(size)
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(1.0, r)
    scene.shaker = PrescribedMotion(lambda t: (0.05 * size * np.sin(3 * slow * t), 0, 0))
    scene.bowl = Contact(Sphere(r), Sphere(R, inside_out=True))
    scene.connect(scene.world.frame, scene.shaker.frame_a)
    scene.connect(scene.shaker.frame_b, scene.bowl.frame_a)
    scene.connect(scene.bowl.frame_b, scene.ball.frame)
    frame, place = scene.ball.frame, (R - r) * np.array([np.sin(angle), 0, -np.cos(angle)])
    start = {frame.position: place, frame.velocity: (0.15 * size * slow, 0, 0), frame.angular_velocity: (0, 0, 0)}
    run = ac.build(scene).simulate(2 / slow, start, rtol=1e-10)

    def rate(t, y):
        shaken = -0.45 * size * slow**2 * np.sin(3 * slow * t)
        return [y[1], -(9.81 * np.sin(y[0]) + shaken * np.cos(y[0])) / (1.4 * (R - r))]

    exact = solve_ivp(rate, (0, 2 / slow), [angle, 0], "DOP853", run.t, rtol=1e-11, atol=1e-12).y[0]
    moved = run[frame.position][:, 0] - 0.05 * size * np.sin(3 * slow * run.t)
    assert moved == pytest.approx((R - r) * np.sin(exact), abs=1e-7 * size)
