"""Guides that change their shape with time: against equations of motion by hand, and with the energy that the change brings in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal.errors import JumpWarning, ParameterError
from components import (
    AlongCurve,
    Cable,
    Circle,
    Cone,
    Contact,
    Coulomb,
    Hard,
    HeightField,
    HuntCrossley,
    ImplicitSurface,
    ParametricSurface,
    Particle,
    Plane,
    PointOnCurve,
    PointOnSurface,
    PrescribedMotion,
    RigidBody,
    Sliding,
    Sphere,
    World,
)

G = 9.81
SIZES = [1e-3, 1.0, 1e3]


def guided(guide: Any, body: Any, gravity: tuple[float, float, float]) -> Any:
    scene: Any = ac.System()
    scene.world, scene.guide, scene.body = World(gravity), guide, body
    scene.connect(scene.world.frame, guide.frame_a)
    scene.connect(guide.frame_b, body.point if isinstance(body, Particle) else body.frame)
    return scene


def ode(f: Callable[[float, Any], list[float]], begin: list[float], t: np.ndarray) -> np.ndarray:
    return solve_ivp(f, (0, t[-1]), begin, "DOP853", t, rtol=1e-13, atol=1e-14).y


@pytest.mark.parametrize("size", SIZES)
def test_a_bead_on_a_hoop_that_breathes_is_a_pendulum_of_changing_length(size: float) -> None:
    """l a'' + 2 l' a' + g sin(a) = 0."""
    k = np.sqrt(size)
    length = size * (1 + 0.2 * np.sin(3 * ac.time / k))
    scene = guided(PointOnCurve(Circle(length)), Particle(2.0), (0, -G, 0))
    run = ac.build(scene).simulate(4 * k, {scene.guide.q: 0.5 - np.pi / 2, scene.guide.v: 0.0}, rtol=1e-11)

    def fall(t: float, y: Any) -> list[float]:
        return [y[1], -(G * np.sin(y[0]) + 1.2 * np.cos(3 * t) * y[1]) / (1 + 0.2 * np.sin(3 * t))]

    exact = ode(fall, [0.5, 0.0], run.t / k)[0]
    assert np.max(np.abs(run[scene.guide.q].ravel() + np.pi / 2 - exact)) < 1e-9
    assert run.energy_error() < 1e-10


@pytest.mark.parametrize("size", SIZES)
def test_a_cone_that_opens_throws_its_particle_out(size: float) -> None:
    """By Lagrange: place (x, y, r / tan(A(t)))."""
    k = np.sqrt(size)
    angle = 0.5 + 0.1 * ac.time / k
    scene = guided(PointOnSurface(Cone(angle)), Particle(1.0), (0, 0, -G))
    begin = {scene.guide.q: (0.6 * size, 0.0), scene.guide.v: (0.0, 2.0 * k)}
    run = ac.build(scene).simulate(2 * k, begin, rtol=1e-11)
    x, y, vx, vy, t = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("vx"), ca.SX.sym("vy"), ca.SX.sym("t")
    q, v = ca.vertcat(x, y), ca.vertcat(vx, vy)
    z = ca.norm_2(q) / ca.tan(0.5 + 0.1 * t)
    z_dot = ca.jtimes(z, q, v) + ca.gradient(z, t)
    L = 0.5 * (ca.sumsqr(v) + z_dot**2) - G * z
    p = ca.gradient(L, v)
    M, rest = ca.jacobian(p, v), ca.jtimes(p, q, v) + ca.jtimes(p, t, ca.SX(1)) - ca.gradient(L, q)
    f = ca.Function("f", [t, ca.vertcat(q, v)], [ca.vertcat(v, -ca.solve(M, rest))])
    exact = ode(lambda s, w: np.array(f(s, w)).ravel().tolist(), [0.6, 0.0, 0.0, 2.0], run.t / k)
    assert np.max(np.abs(run[scene.guide.q] / size - exact[:2].T)) < 1e-9
    assert run.energy_error() < 1e-10


def test_a_sphere_that_grows_is_a_rope_that_is_let_out() -> None:
    """In space, two formulations: on the surface without multipliers, and held by a cable whose length is a function of time."""
    length = 1 + 0.3 * np.sin(2 * ac.time)
    place, velocity = np.array([0.6, 0, -0.8]), np.array([0, 2.0, 0]) + 0.6 * np.array([0.6, 0, -0.8])
    on = guided(PointOnSurface(Sphere(length)), Particle(1.0), (0, 0, -G))
    held: Any = ac.System()
    held.world, held.bob = World(), Particle(1.0)
    held.rope = Cable(1 + length, over=(held.world.frame,))
    held.connect(held.world.at((-1, 0, 0)), held.rope.frame_a)
    held.connect(held.rope.frame_b, held.bob.point)
    runs = [
        ac.build(scene).simulate(3.0, {point.position: place, point.velocity: ac.near(velocity)}, rtol=1e-11)
        for scene, point in ((on, on.body.point), (held, held.bob.point))
    ]
    assert np.max(np.abs(runs[0][on.body.point.position] - runs[1][held.bob.point.position])) < 1e-9
    assert max(run.energy_error() for run in runs) < 1e-10


def test_a_wave_that_runs_is_a_wave_that_is_carried() -> None:
    """A surface whose height is a function of x - c t, and the same at rest in a frame that moves on."""

    def height(x: Any, y: Any) -> Any:
        return 0.2 * ca.sin(3 * x) + 0.1 * y**2

    runs = guided(PointOnSurface(HeightField(lambda x, y: height(x - 0.5 * ac.time.sx, y))), Particle(1.0), (0, 0, -G))
    scene: Any = ac.System()
    scene.world, scene.cart, scene.guide, scene.body = (
        World(),
        PrescribedMotion((0.5 * ac.time, 0, 0)),
        PointOnSurface(HeightField(height)),
        Particle(1.0),
    )
    scene.connect(scene.world.frame, scene.cart.frame_a)
    scene.connect(scene.cart.frame_b, scene.guide.frame_a)
    scene.connect(scene.guide.frame_b, scene.body.point)
    found = [
        ac.build(one).simulate(2.0, {one.guide.q: (0.3, 0.2), one.guide.v: v}, rtol=1e-11)[one.body.point.position]
        for one, v in ((runs, (0.7, 0.1)), (scene, (0.2, 0.1)))
    ]
    assert np.max(np.abs(found[0] - found[1])) < 1e-9


def test_a_car_on_a_track_that_sways_keeps_its_energies() -> None:
    sway = 0.2 * np.sin(2 * ac.time)
    curve = Circle(1.0 + 0.1 * sway)
    scene = guided(AlongCurve(curve, side="z"), RigidBody.box(2.0, (0.3, 0.1, 0.1)), (0, -G, 0))
    run = ac.build(scene).simulate(3.0, {scene.guide.q: -1.0}, rtol=1e-11)
    assert run.energy_error() < 1e-10


def test_what_else_changes_a_guide_is_refused_and_jumps_are_told() -> None:
    radius = ac.Input("m")
    scene = guided(PointOnSurface(Sphere(radius)), Particle(1.0), (0, 0, -G))
    with pytest.raises(ParameterError, match=r"surface depends on the input .*constant"):
        ac.build(scene)
    with pytest.raises(ParameterError, match=r"law depends on the time .*test_changing_geometry\.py"):
        ImplicitSurface(lambda x, y, z: x**2 + y**2 + z**2 - (1 + ac.time.sx) ** 2, (1, 0, 0))
    with pytest.raises(ParameterError, match=r"touches depends on the time .*test_changing_geometry\.py"):
        Contact(Sphere(ac.time), Plane(), Sliding())
    scene = guided(PointOnCurve(Circle(ca.if_else(ac.time.sx < 0.5, 1.0, 1.3))), Particle(1.0), (0, -G, 0))
    with pytest.warns(JumpWarning, match="at t = 0.5 s"):
        ac.build(scene).simulate(1.0, {scene.guide.q: -1.0})


@pytest.mark.parametrize(("law", "size"), [("hard", 1e-3), ("rough", 1.0), ("soft", 1e3), ("soft", 1.0)])
def test_a_ball_on_a_ground_that_swells_bounces_as_on_a_table_that_is_lifted(law: str, size: float) -> None:
    """On top of a sphere of changing radius, and on a plane that is carried: the same impacts, pushes and work."""
    k = np.sqrt(size)
    lift = 0.1 * size * np.sin(4 * ac.time / k)
    laws = {"hard": Hard(0.9), "rough": Hard(0.9, Coulomb(0.3)), "soft": HuntCrossley(2e3 / size**1.5, damping=0.3 * k / size)}
    scenes: list[Any] = []
    for contact in (Contact(Sphere(0.1 * size), Sphere(size + lift), laws[law]), Contact(Sphere(0.1 * size), Plane(), laws[law])):
        scene: Any = ac.System()
        scene.world, scene.contact, scene.body = World((0, 0, -G)), contact, RigidBody.ball(2.0, 0.1 * size)
        ground = scene.world.frame
        if isinstance(contact.surface, Plane):
            scene.drive = PrescribedMotion((0, 0, size + lift))
            scene.connect(ground, scene.drive.frame_a)
            ground = scene.drive.frame_b
        scene.connect(ground, contact.frame_a)
        scene.connect(contact.frame_b, scene.body.frame)
        scenes.append(scene)
    runs = [ac.build(one).simulate(2 * k, {one.body.frame.position: (0, 0, 1.4 * size)}, rtol=1e-11) for one in scenes]
    places = [run[one.body.frame.position] / size for run, one in zip(runs, scenes, strict=True)]
    assert np.max(np.abs(places[0] - places[1])) < 1e-7
    assert len(runs[0].transitions) == len(runs[1].transitions) and (law == "soft" or len(runs[0].transitions) > 4)
    assert max(run.energy_error() for run in runs) < 1e-7


@pytest.mark.parametrize("kind", ["heights", "parametric"])
def test_a_particle_leaves_a_wave_that_runs_where_it_leaves_one_that_is_carried(kind: str) -> None:
    """Smooth: with its gap in closed form, and followed as a coordinate."""

    def height(x: Any, y: Any) -> Any:
        return 0.2 * ca.sin(3 * x) + 0.1 * y**2

    def surface(shift: Any) -> Any:
        if kind == "heights":
            return HeightField(lambda x, y: height(x - shift, y))
        return ParametricSurface(lambda a, b: (a, b, height(a - shift, b)), unit="m")

    found: list[np.ndarray] = []
    for shift in (0.5 * ac.time.sx, None):
        scene: Any = ac.System()
        scene.world, scene.guide, scene.body = (
            World(),
            PointOnSurface(surface(0.0 if shift is None else shift), unilateral=True),
            Particle(1.0),
        )
        ground = scene.world.frame
        if shift is None:
            scene.cart = PrescribedMotion((0.5 * ac.time, 0, 0))
            scene.connect(ground, scene.cart.frame_a)
            ground = scene.cart.frame_b
        scene.connect(ground, scene.guide.frame_a)
        scene.connect(scene.guide.frame_b, scene.body.point)
        point = scene.body.point
        run = ac.build(scene).simulate(1.5, {point.position: (0.3, 0.2, 0.4), point.velocity: (3.0, 0.1, 0.0)}, rtol=1e-11)
        assert len(run.transitions) > 1 and run.energy_error() < 1e-9
        found.append(run[point.position])
    assert np.max(np.abs(found[0] - found[1])) < 1e-8


def test_a_bead_that_a_swelling_hoop_throws_off() -> None:
    """Over a circle, with sideways held, and over a sphere: the same where it starts in the plane."""
    radius = 1 + 0.4 * np.sin(2 * ac.time)
    runs: list[Any] = []
    for guide, gravity in (
        (PointOnCurve(Circle(radius), unilateral=True, side="z"), (0, -G, 0)),
        (PointOnSurface(Sphere(radius), unilateral=True), (0, -G, 0)),
    ):
        scene = guided(guide, Particle(1.0), gravity)
        point = scene.body.point
        run = ac.build(scene).simulate(1.2, {point.position: (0.6, 0.8, 0), point.velocity: (0.5, 0.2, 0)}, rtol=1e-11)
        assert run.energy_error() < 1e-9
        runs.append(run[point.position])
    assert np.max(np.abs(runs[0] - runs[1])) < 1e-8
