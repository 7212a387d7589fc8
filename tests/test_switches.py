"""Comparisons, signs, minima and steps of states end steps: motions are those of the pieces, however they follow one another."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import acausal as ac
from acausal.errors import SimulationError
from components import AngleSource, Force, Particle, Prismatic, Revolute, RigidBody, World
from tests.pairings import each_value

METHODS = ["auto", "radau"]


class Law(ac.Component):
    """A force along a rail as a function of place, speed and time."""

    flange = ac.Translational.port()
    v = ac.Variable("m/s")

    def __init__(self, force: Callable[[ca.SX, ca.SX, ca.SX], Any]) -> None:
        self.force = force

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(ac.der(self.flange.s), self.v)
        yield ac.equal(self.flange.f, -1.0 * self.force(self.flange.s.sx, self.v.sx, ac.time.sx))


def bead(force: Callable[[ca.SX, ca.SX, ca.SX], Any], **parts: Any) -> tuple[Any, Any]:
    """1 kg on a rail."""
    scene: Any = ac.System()
    for name, part in parts.items():
        setattr(scene, name, part)
    scene.world, scene.rail, scene.mass, scene.law = World((0, 0, 0)), Prismatic("x"), Particle(1.0), Law(force)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.mass.point)
    scene.connect(scene.rail.flange, scene.law.flange)
    return scene, ac.build(scene)


def moved(law: Callable[..., Any], q: float, v: float, end: float, **options: Any) -> Any:
    scene, model = bead(law)
    run = model.simulate(end, {scene.rail.q: q, scene.rail.v: v}, samples=401, **options)
    return run[scene.rail.q], run[scene.rail.v], run


def relay(t: np.ndarray, q0: float) -> np.ndarray:
    """q'' = -sign q from rest: parabolas of duration 2 sqrt(2 q0), up and down in turn."""
    half = 2 * np.sqrt(2 * q0)
    since = (t + half / 2) % half - half / 2
    side = np.where(np.round(t / half) % 2 == 0, 1.0, -1.0)
    return side * (q0 - since**2 / 2)


@each_value(("method", METHODS), ("rtol", [1e-4, 1e-8, 1e-12]))
def test_parabolas_between_jumps_of_the_force_are_exact(method: str, rtol: float) -> None:
    for law in (
        lambda q, v, t: -ca.sign(q),
        lambda q, v, t: ca.if_else(q > 0, -1, 1),
        lambda q, v, t: 2 * ca.if_else(q <= 0, 1, 0) - 1,
    ):
        q, _, run = moved(law, 0.5, 0.0, 30.0, rtol=rtol, method=method)
        assert np.max(np.abs(q - relay(run.t, 0.5))) < 1e-10
        assert run.statistics.steps < 60


@pytest.mark.parametrize("method", METHODS)
def test_springs_in_pieces_swing_by_their_closed_forms(method: str) -> None:
    soft, hard = np.sqrt(10.0), np.sqrt(1000.0)
    period = np.pi / soft + np.pi / hard
    for law in (
        lambda q, v, t: ca.if_else(q > 0, -10 * q, -1000 * q),
        lambda q, v, t: -10 * ca.fmax(q, 0) - 1000 * ca.fmin(q, 0),
        lambda q, v, t: -505 * q + 495 * ca.fabs(q),
    ):
        q, _, run = moved(law, 1.0, 0.0, 7.7, rtol=1e-11, method=method)
        phase = (run.t + np.pi / soft / 2) % period
        exact = np.where(phase < np.pi / soft, np.sin(soft * phase), -soft / hard * np.sin(hard * (phase - np.pi / soft)))
        assert np.max(np.abs(q - exact)) < 1e-9


def test_errors_at_bends_follow_the_tolerance() -> None:
    """Backlash: free between two springs; the energy is kept."""

    def energy(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return v**2 / 2 + 500 * np.maximum(0, np.abs(q) - 0.1) ** 2

    for rtol in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        q, v, run = moved(lambda q, v, t: -1e3 * (ca.fmax(0, q - 0.1) + ca.fmin(0, q + 0.1)), 0.0, 1.0, 10.0, rtol=rtol)
        assert np.max(np.abs(energy(q, v) - 0.5)) < 100 * rtol + 1e-12
        assert run.statistics.steps + run.statistics.rejected < 250


@pytest.mark.parametrize("method", METHODS)
def test_laws_that_end_where_they_switch_are_taken_to_their_end(method: str) -> None:
    """Hertz's contact, which has no value without contact; square roots that have none on the other side."""
    for law in (
        lambda q, v, t: -9.81 + 1e5 * ca.if_else(q < 0, (-q) ** 1.5, 0),
        lambda q, v, t: -9.81 + 1e5 * ca.fmax(0, -q) ** 1.5,
    ):
        q, v, _ = moved(law, 0.5, 0.0, 3.0, rtol=1e-10, method=method)
        energy = v**2 / 2 + 9.81 * q + 4e4 * np.maximum(0, -q) ** 2.5
        assert np.max(np.abs(energy - 9.81 * 0.5)) < 1e-7


def test_steps_and_sawteeth_of_states() -> None:
    """q'' = -(floor q) - 1/2 is a spring in stairs, and keeps its energy; q mod 1 a row of slopes."""
    q, v, _ = moved(lambda q, v, t: -ca.floor(q) - 0.5, 2.3, 0.0, 20.0, rtol=1e-10)
    n = np.floor(q)
    assert np.ptp(v**2 / 2 + (n + 0.5) * (q - n) + n**2 / 2) < 1e-11
    q, v, _ = moved(lambda q, v, t: 0.5 - ca.fmod(q, 1.0), 0.2, 3.0, 10.0, rtol=1e-10)
    assert np.ptp(v**2 / 2 + (q % 1.0) ** 2 / 2 - (q % 1.0) / 2) < 1e-8
    q, v, _ = moved(lambda q, v, t: ca.ceil(-q) - 0.5, 2.3, 0.0, 20.0, rtol=1e-10)
    n = np.floor(q)
    assert np.ptp(v**2 / 2 + (n + 0.5) * (q - n) + n**2 / 2) < 1e-11


def test_rest_at_a_switch_is_rest() -> None:
    for law in (lambda q, v, t: -ca.sign(v), lambda q, v, t: -q * ca.fabs(q), lambda q, v, t: ca.fmax(0, -q) - ca.fmax(0, q)):
        q, v, run = moved(law, 0.0, 0.0, 5.0)
        assert not np.any(q) and not np.any(v)
        assert run.statistics.steps < 10


def test_friction_that_is_overcome_is_exact_and_friction_that_sticks_is_told() -> None:
    q, _, run = moved(lambda q, v, t: 5 * ca.sin(t) - 0.8 * ca.sign(v), 0.0, 1.0, 30.0, rtol=1e-10)
    assert run.statistics.steps < 60
    again, _, _ = moved(lambda q, v, t: 5 * ca.sin(t) - 0.8 * ca.sign(v), 0.0, 1.0, 30.0, rtol=1e-13)
    assert np.max(np.abs(q - again)) < 1e-9
    began = time.perf_counter()
    for method in METHODS:
        with pytest.raises(
            SimulationError, match=r"slides along a switch of the rates, rail\.v: from both sides .* Dry friction that sticks"
        ):
            moved(lambda q, v, t: 0.5 * ca.sin(t) - 0.8 * ca.sign(v), 0.0, 1.0, 5.0, method=method)
    assert time.perf_counter() - began < 5.0


@pytest.mark.parametrize("compiled", [True, False])
def test_switches_of_states_and_knots_of_inputs_work_together(compiled: bool) -> None:
    """A pulse throws a bead against a wall of jumps."""
    scene: Any = ac.System()
    scene.force = ac.Input("N")
    scene.world, scene.rail, scene.mass, scene.push = World((0, 0, 0)), Prismatic("x"), Particle(1.0), Force((scene.force, 0, 0))
    scene.law = Law(lambda q, v, t: ca.if_else(q > 1, -1, 0))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.mass.point, scene.push.point)
    scene.connect(scene.rail.flange, scene.law.flange)
    pulse = ac.samples([0, 2, 2.001], [0, 1000, 0], "constant")  # 1 m/s from 2.0005 s on, as it were
    run = ac.build(scene).simulate(
        20.0, {scene.rail.q: 0.0, scene.rail.v: 0.0}, inputs={scene.force: pulse}, samples=2, compiled=compiled
    )
    assert abs(run[scene.rail.v][-1] + 1.0) < 1e-10
    assert abs(run[scene.rail.q][-1] - (1.0 - (20.0 - (2.0005 + 1.0 + 2.0)))) < 1e-9
    assert run.statistics.steps < 80


def test_derivatives_jump_where_switches_go_over() -> None:
    """With respect to how long a pulse lasts, and to where a bead under a relay starts."""
    scene, model = bead(lambda q, v, t: ca.if_else(t < scene_width.sx, 10, 0), width=(scene_width := ac.Parameter(0.1, "s")))
    found = model.sensitivities([0.0, 5.0], [scene.width], {scene.rail.q: 0.0, scene.rail.v: 0.0})
    assert np.allclose(found[scene.rail.v].ravel(), [0, 10], rtol=0, atol=1e-9)
    assert abs(found[scene.rail.q].ravel()[-1] - 10 * (5 - 0.1)) < 1e-8
    scene, model = bead(lambda q, v, t: -ca.sign(q))
    times = np.array([0.0, 0.5, 1.5, 3.3, 5.2, 9.1])
    found = model.sensitivities(times, [scene.rail.q], {scene.rail.q: 0.5, scene.rail.v: 0.0}, rtol=1e-10)
    exact = (relay(times, 0.5 + 1e-6) - relay(times, 0.5 - 1e-6)) / 2e-6
    assert np.allclose(found[scene.rail.q].ravel(), exact, rtol=0, atol=1e-6)


def test_fixed_steps_end_at_switches_too() -> None:
    q, _, run = moved(lambda q, v, t: -ca.sign(q), 0.5, 0.0, 10.0, step=0.3, method="gauss", order=4)
    assert np.max(np.abs(q - relay(run.t, 0.5))) < 1e-10


def test_motion_is_alike_in_any_units() -> None:
    runs = [moved(lambda q, v, t, s=s: -s * ca.sign(q), 0.5 * s, 0.0, 10.0)[0] / s for s in (1.0, 2.0**-40, 2.0**40)]
    assert np.array_equal(runs[0], runs[1])
    assert np.array_equal(runs[0], runs[2])


@pytest.mark.parametrize("constant", [True, False])
def test_switch_that_an_input_moves_goes_over_where_it_is(constant: bool) -> None:
    """Held at one value an input counts as one that is a function of time."""
    scene: Any = ac.System()
    scene.place = ac.Input("m")
    scene, model = bead(lambda q, v, t: ca.if_else(q > scene.place.sx, -1, 0), place=scene.place)
    place = 0.3 if constant else ac.samples([0.0, 1.0], [0.3, 0.3])
    run = model.simulate(1.0, {scene.rail.q: 0.0, scene.rail.v: 1.0}, inputs={scene.place: place})
    assert abs(run[scene.rail.v][-1] - 0.3) < 1e-12


@pytest.mark.parametrize("course", [(0, 1, 0), (1, 0, 1), (1, -1, 0), (-1, 1, 0)])
@pytest.mark.parametrize("at_zero", [1, -1])
def test_input_that_jumps_right_to_where_a_switch_goes_over_is_compared_as_said(course: tuple[int, ...], at_zero: int) -> None:
    scene: Any = ac.System()
    scene.level = ac.Input("1")
    above = scene.level >= 0 if at_zero > 0 else scene.level > 0
    scene, model = bead(lambda q, v, t: ca.if_else(above.sx, 1, -1), level=scene.level)
    inputs = {scene.level: ac.samples([0, 1, 2], course, kind="constant")}
    run = model.simulate(3.0, {scene.rail.q: 0.0, scene.rail.v: 0.0}, inputs=inputs)
    assert abs(run[scene.rail.v][-1] - sum(np.sign(level) if level else at_zero for level in course)) < 1e-12


@each_value(("end", [2.0, 0.7, 1e-3]), ("kind", ["casadi", "scipy", "formula"]))
def test_a_table_that_ends_with_the_run_is_not_left_there(kind, end):
    """A given angle, whose table is zero, or nothing, as soon as it has ended."""
    knots = np.linspace(0, end, 11)
    spline = CubicSpline(knots, np.sin(3 * knots / end), extrapolate=False)
    table = ca.interpolant("table", "bspline", [knots], np.sin(3 * knots / end))
    course: dict[str, Any] = {"casadi": table(ac.time), "scipy": spline}
    course["formula"] = ca.if_else(ac.time.sx <= end, ca.sin(3 * ac.time.sx / end), 5.0)
    scene = ac.System()
    scene.world, scene.hinge, scene.drive = World((0, 0, 0)), Revolute("y"), AngleSource(course[kind])
    scene.rod = RigidBody.rod(1.0, (0, 0, -1.0))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.drive.flange, scene.hinge.flange)
    run = ac.build(scene).simulate(end, samples=2)
    rate = float(spline(end, 1)) if kind != "formula" else 3 * np.cos(3) / end
    np.testing.assert_allclose(run.x[:, -1], [np.sin(3), rate], rtol=1e-9)
    np.testing.assert_allclose(run[scene.hinge.q][-1], np.sin(3), rtol=1e-12)
