"""Surfaces where a function is zero: the same motions as on their parametric forms, whatever the function's size and the surface's."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.errors import ParameterError
from components import (
    Cylinder,
    Ellipsoid,
    HeightField,
    ImplicitSurface,
    Particle,
    PointOnSurface,
    RigidBody,
    Rolling,
    Sphere,
    Spherical,
    Torus,
    Touching,
    World,
)
from tests.pairings import each_value

G = 9.81
SIZES = [1e-3, 1.0, 1e3]


def bead(surface: Any, place: Any, velocity: Any, seconds: float) -> tuple[ac.Model, ac.Trajectory, np.ndarray]:
    scene: Any = ac.System()
    scene.world, scene.guide, scene.bead = World((0, 0, -G)), PointOnSurface(surface), Particle(2.0)
    scene.connect(scene.world.frame, scene.guide.frame_a)
    scene.connect(scene.guide.frame_b, scene.bead.point)
    model = ac.build(scene)
    run = model.simulate(seconds, {scene.bead.point.position: place, scene.bead.point.velocity: ac.near(velocity)}, rtol=1e-11)
    return model, run, run[scene.bead.point.position]


def pairs(L: float) -> dict[str, tuple[Any, Any, Any, Any]]:
    """Parametric and implicit form, a place and a velocity of O(1) on a surface of size 1."""
    return {
        "sphere": (Sphere(L), lambda x, y, z: x**2 + y**2 + z**2 - L**2, (0.6, 0, -0.8), (0, 2, 0)),
        "through the poles": (Sphere(L), lambda x, y, z: ca.norm_2(ca.vertcat(x, y, z)) - L, (0.6, 0, -0.8), (5.6, 0, 4.2)),
        "cylinder": (Cylinder(L), lambda x, y, z: x**2 + y**2 - L**2, (1, 0, 0.5), (0, 2, 1)),
        "torus": (Torus(L, 0.3 * L), lambda x, y, z: (ca.sqrt(x**2 + y**2) - L) ** 2 + z**2 - 0.09 * L**2, (1.3, 0, 0), (0, 2, 1)),
        "torus as a quartic": (Torus(L, 0.3 * L), lambda x, y, z: (x**2 + y**2 + z**2 + 0.91 * L**2) ** 2 - 4 * L**2 * (x**2 + y**2), (1.3, 0, 0), (0, 2, 1)),
        "bowl": (HeightField(lambda x, y: (x**2 + 2 * y**2) / L), lambda x, y, z: z * L - x**2 - 2 * y**2, (0.6, 0, 0.36), (0, 2, 0)),
        "ellipsoid": (Ellipsoid((L, 1.5 * L, 0.8 * L)), lambda x, y, z: x**2 + y**2 / 2.25 + z**2 / 0.64 - L**2, (0, 0, -0.8), (1, 2, 0)),
    }  # fmt: skip


@each_value(("size", SIZES), ("name", pairs(1.0)))
def test_a_bead_moves_as_on_the_parametric_form(name: str, size: float) -> None:
    parametric, law, place, velocity = pairs(size)[name]
    k = np.sqrt(size)
    at, along = size * np.array(place), k * np.array(velocity)
    model, run, found = bead(ImplicitSurface(law, at * 1.1 + 0.03 * size), at, along, 2 * k)
    _, _, wanted = bead(parametric, at, along, 2 * k)
    assert np.max(np.abs(found - wanted)) < 1e-9 * size
    assert run.energy_error() < 1e-11
    assert model.degrees_of_freedom == 2 and len(model.state_names) == 9 and model.system.constraints.jacobian.shape[0] == 0


@pytest.mark.parametrize("factor", [1e-9, -3.0, 1e9])
def test_a_law_of_any_size_and_sign_names_the_same_surface(factor: float) -> None:
    def motion(c: float) -> np.ndarray:
        surface = ImplicitSurface(lambda x, y, z: c * (x**2 + 2 * y**2 + z**4 - 1), (1, 0, 0.1), flipped=c < 0)
        return bead(surface, (1, 0, 0), (0, 1, 1), 2.0)[2]

    assert np.max(np.abs(motion(1.0) - motion(factor))) < 1e-10


def test_a_parameter_of_the_law_is_as_good_as_a_number() -> None:
    radius = ac.Parameter(1.0, "m")
    scene: Any = ac.System()
    scene.world, scene.bead = World((0, 0, -G)), Particle(1.0)
    scene.guide = PointOnSurface(ImplicitSurface(lambda x, y, z: x**2 + y**2 + z**2 - radius.sx**2, (0, 0.2, -1)))
    scene.connect(scene.world.frame, scene.guide.frame_a)
    scene.connect(scene.guide.frame_b, scene.bead.point)
    model = ac.build(scene)
    for value in (1.0, 2.5):
        start = {scene.bead.point.position: (0.6 * value, 0, -0.8 * value), scene.bead.point.velocity: ac.near((0, 1, 0))}
        run = model.simulate(2.0, start, parameters={radius: value}, rtol=1e-11)
        wanted = bead(Sphere(value), (0.6 * value, 0, -0.8 * value), (0, 1, 0), 2.0)[2]
        assert np.max(np.abs(run[scene.bead.point.position] - wanted)) < 1e-9


@pytest.mark.parametrize("size", SIZES)
def test_a_rod_with_both_ends_on_a_sphere_is_a_pendulum(size: float) -> None:
    """In a vertical plane: a rod of 1.2 R whose middle is 0.8 R from the centre. A loop, with the surfaces' coordinates."""
    scene: Any = ac.System()
    scene.world, scene.rod = World((0, 0, -G)), RigidBody.rod(1.0, (1.2 * size, 0, 0), radius=0.01 * size)
    scene.guides = [
        PointOnSurface(ImplicitSurface(lambda x, y, z: x**2 + y**2 + z**2 - size**2, (sign * 0.5 * size, 0, -size)))
        for sign in (-1, 1)
    ]
    scene.balls = [Spherical(), Spherical()]
    for guide, ball, end in zip(scene.guides, scene.balls, (scene.rod.frame, scene.rod.tip), strict=True):
        scene.connect(scene.world.frame, guide.frame_a)
        scene.connect(guide.frame_b, ball.frame_a)
        scene.connect(ball.frame_b, end)
    a = 0.4
    along = size * np.array([np.cos(a), 0, np.sin(a)])
    middle = 0.8 * size * np.array([np.sin(a), 0, -np.cos(a)])
    ends = {scene.rod.frame.position: middle - 0.6 * along, scene.rod.tip.position: middle + 0.6 * along}
    run = ac.build(scene).simulate(2 * np.sqrt(size), ends, rtol=1e-11)
    found = 0.5 * (run[scene.rod.frame.position] + run[scene.rod.tip.position]) / size
    from scipy.integrate import solve_ivp

    inertia = 0.64 + 1.44 / 12 + 0.01**2 / 4
    exact = solve_ivp(
        lambda t, y: [y[1], -G * 0.8 / inertia * np.sin(y[0])],
        (0, 2),
        [a, 0],
        "DOP853",
        run.t / np.sqrt(size),
        rtol=1e-12,
        atol=1e-13,
    )
    assert np.max(np.abs(found[:, 0] - 0.8 * np.sin(exact.y[0]))) < 1e-8
    assert run.energy_error() < 1e-10


@pytest.mark.parametrize("size", SIZES)
def test_bodies_roll_on_implicit_surfaces_and_with_them_as_on_parametric_ones(size: float) -> None:
    """A ball down a ball, either of them given by a function: a pendulum upside down."""

    def ball(radius: float, at: float) -> ImplicitSurface:
        return ImplicitSurface(lambda x, y, z: x**2 + y**2 + z**2 - radius**2, (0, 0, at))

    heights: list[np.ndarray] = []
    for shape, ground in (
        (Sphere(0.1 * size), Sphere(size)),
        (Sphere(0.1 * size), ball(size, size)),
        (ball(0.1 * size, -0.1 * size), Sphere(size)),
    ):
        scene: Any = ac.System()
        scene.world, scene.contact, scene.ball = (
            World((0, 0, -G)),
            Touching(shape, ground, Rolling()),
            RigidBody.ball(2.0, 0.1 * size),
        )
        scene.connect(scene.world.frame, scene.contact.frame_a)
        scene.connect(scene.contact.frame_b, scene.ball.frame)
        place = {scene.ball.frame.position: (1.1 * size * np.sin(0.3), 0, 1.1 * size * np.cos(0.3))}
        run = ac.build(scene).simulate(0.5 * np.sqrt(size), {**place, scene.ball.frame.angular_velocity: (0, 0, 0)}, rtol=1e-11)
        heights.append(run[scene.ball.frame.position][:, 2] / size)
        assert run.energy_error() < 1e-11
    assert np.ptp(heights, axis=0).max() < 1e-10


def cone(x: Any, y: Any, z: Any) -> Any:
    return x**2 + y**2 - z**2


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ImplicitSurface(lambda x, y, z: x**2 + y**2 + z**2 + 1, (1, 0, 0)), ("no place is found", "start next to the surface")),
        (lambda: ImplicitSurface(cone, (0, 0, 0)), ("[0. 0. 0.]", "has a slope", "apex")),
        (lambda: ImplicitSurface(lambda x, y, z: x**2 + y**2 + z**2 - 1, (0, 0, 0)), ("no place is found",)),
        (lambda: ImplicitSurface(lambda x, y, z: (x, y), (0, 0, 1)), ("Return one number",)),
        (lambda: ImplicitSurface(3.0, (0, 0, 1)), ("3.0", "Give a function")),  # type: ignore[arg-type]
        (lambda: ImplicitSurface(cone, (0, 1)), ("start", "three numbers")),
        (lambda: ImplicitSurface(cone, (ac.Parameter(1.0, "m"), 0, 1)), ("start", "Give three numbers")),
    ],
)  # fmt: skip
def test_what_is_no_surface_is_refused_in_words(make: Any, words: tuple[str, ...]) -> None:
    with pytest.raises(ParameterError) as caught:
        make()
    assert all(word in str(caught.value) for word in words), caught.value
    assert "test_implicit_surfaces.py" in str(caught.value)
