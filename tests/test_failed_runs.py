"""A run that fails keeps the motion until where it is right, and nothing after it."""

import re
import warnings
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import interp1d

import acausal as ac
from acausal.errors import SimulationError, StartValueError
from components import (
    AngleSource,
    Contact,
    Force,
    HeightField,
    ParametricCurve,
    Particle,
    PointOnCurve,
    PointOnSurface,
    Revolute,
    Revolution,
    RigidBody,
    Rolling,
    Sphere,
    World,
)
from tests.pairings import each_value

SPEED, BEGIN = 3.0, 0.9


def driven(size: float, lengths: np.ndarray) -> ac.System:
    """A four-bar on a base of this size, with links of these lengths times it, whose crank turns evenly."""
    scene = ac.System()
    scene.world = World((0, -9.81 * size, 0))
    scene.crank, scene.coupler, scene.rocker = (RigidBody.rod(1.0, (float(x) * size, 0, 0)) for x in lengths)
    scene.a, scene.b, scene.c, scene.d = (Revolute("z") for _ in range(4))
    scene.motor = AngleSource(BEGIN + SPEED * ac.time)
    scene.connect(scene.world.frame, scene.a.frame_a)
    scene.connect(scene.a.frame_b, scene.crank.frame)
    scene.connect(scene.crank.tip, scene.b.frame_a)
    scene.connect(scene.b.frame_b, scene.coupler.frame)
    scene.connect(scene.coupler.tip, scene.c.frame_a)
    scene.connect(scene.c.frame_b, scene.rocker.tip)
    scene.connect(scene.world.at((size, 0, 0)), scene.d.frame_a)
    scene.connect(scene.d.frame_b, scene.rocker.frame)
    scene.connect(scene.motor.flange, scene.a.flange)
    return scene


def dead_time(lengths: np.ndarray) -> float:
    """When the crank, which turns evenly, comes to where coupler and rocker lie in one line."""
    crank, coupler, rocker = lengths
    reaches = [(1 + crank**2 - r**2) / (2 * crank) for r in (coupler + rocker, abs(coupler - rocker))]
    angles = [sign * np.arccos(c) + 2 * np.pi * turn for c in reaches if abs(c) < 1 for sign in (1, -1) for turn in (0, 1)]
    return (min(angle for angle in angles if angle > BEGIN) - BEGIN) / SPEED


@each_value(("size", [3e-3, 75.0]), ("number", range(2)))
def test_what_is_driven_out_of_reach_is_kept_until_there(size: float, number: int) -> None:
    rng = np.random.default_rng(number)
    lengths = np.array([0.8, 0.7, 0.6]) * rng.uniform(0.9, 1.1, 3)
    scene = driven(size, lengths)
    model = ac.build(scene)
    for rtol in (1e-8, 1e-12):
        with pytest.raises(SimulationError) as told:
            model.simulate(5.0, rtol=rtol)
        run = told.value.trajectory
        run = run.at(run.steps.t)
        assert abs(run.t[-1] - dead_time(lengths)) < 1e-6
        a, b, d = (run[hinge.q] for hinge in (scene.a, scene.b, scene.d))
        c = run[scene.c.q]
        turns = np.exp(1j * a), np.exp(1j * (a + b)), np.exp(1j * d)
        gap = lengths[0] * turns[0] + lengths[1] * turns[1] - 1 - lengths[2] * turns[2]
        assert np.max(np.abs(gap)) < 1e-7
        assert np.max(np.abs(np.exp(1j * (a + b + c)) - turns[2])) < 1e-7
        assert np.max(np.abs(a - BEGIN - SPEED * run.t)) < 1e-7
        va, vb, vd = (run[hinge.v] for hinge in (scene.a, scene.b, scene.d))
        rate = 1j * (lengths[0] * turns[0] * va + lengths[1] * turns[1] * (va + vb) - lengths[2] * turns[2] * vd)
        assert np.max(np.abs(rate) / (np.abs(va) + np.abs(vb) + np.abs(vd))) < 1e-6
        assert np.isfinite(run.energy).all()


def words_of(run: Callable[[], object]) -> str:
    """What warnings, or the error that it ends with, say."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            run()
        except SimulationError as error:
            return str(error)
    return "".join(str(one.message) for one in told)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("begin", [0.3, 0.5, 0.8])
def test_a_wire_that_turns_where_its_parameter_ends_is_told(size: float, begin: float) -> None:
    # (u, 0, sqrt(u)): the lower half of the parabola has no u, and what comes to its apex is thrown back up; beside it states have no energy
    scene = ac.System()
    scene.world, scene.bead = World(), Particle(1.0)
    scene.wire = PointOnCurve(ParametricCurve(lambda u: (u, 0, ca.sqrt(u * size))))
    scene.connect(scene.world.frame, scene.wire.frame_a)
    scene.connect(scene.wire.frame_b, scene.bead.point)
    model = ac.build(scene)
    words = words_of(lambda: model.simulate(np.sqrt(size), {scene.wire.q: begin * size, scene.wire.v: -3.5 * np.sqrt(size)}))
    assert re.search("'wire' .* (was|has come to) where it has no meaning.*slope is infinite", words)


@pytest.mark.parametrize(("law", "speed"), [
    (lambda u: (u, 0, ca.sqrt(ca.fmax(u, 0))), -3.5), (lambda u: (u, 0, u ** (2 / 3)), -3.5), (lambda u: (ca.acos(u - 0.2), 0, -u), 3.5),
])  # fmt: skip
def test_a_wire_ends_where_its_slope_is_infinite(law, speed: float) -> None:
    scene = ac.System()
    scene.world, scene.bead, scene.wire = World(), Particle(1.0), PointOnCurve(ParametricCurve(law))
    scene.connect(scene.world.frame, scene.wire.frame_a)
    scene.connect(scene.wire.frame_b, scene.bead.point)
    with pytest.raises(SimulationError, match=r"'wire' .* at wire\.q = .*its slope is infinite"):
        ac.build(scene).simulate(1.0, {scene.wire.q: 0.5, scene.wire.v: speed})


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_wire_that_bends_at_once_is_told_and_one_that_curves_at_once_is_not(size: float) -> None:
    # a valley of two slopes, by an absolute value, a choice and a table; its parabola within a width, and a track whose curvature alone begins at once
    table = interp1d([-2 * size, -0.1 * size, 2 * size], [0.95 * size, 0, 2.1 * size])
    laws = [
        (lambda u: (u, 0, abs(u)), 0.0),
        (lambda u: (u, 0, ca.if_else(u < 0.2 * size, 0, 0.7 * (u - 0.2 * size))), 0.2),
        (lambda u: (u, 0, ac.lookup(table, u)), -0.1),
        (lambda u: (u, 0, ca.if_else(ca.fabs(u) < 0.1 * size, (u**2 / size + 0.01 * size) / 0.2, ca.fabs(u))), None),
        (lambda u: (u, 0, 0.5 * ca.fmax(u, 0) ** 2 / size), None),
    ]
    for law, corner in laws:
        scene = ac.System()
        scene.world, scene.bead, scene.wire = World(), Particle(1.0), PointOnCurve(ParametricCurve(law))
        scene.connect(scene.world.frame, scene.wire.frame_a)
        scene.connect(scene.wire.frame_b, scene.bead.point)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            ac.build(scene).simulate(np.sqrt(size), {scene.wire.q: -0.4 * size, scene.wire.v: 1.5 * np.sqrt(size)})
        if corner is None:
            assert not told
        else:
            (words,) = (str(one.message) for one in told)
            assert "'wire'" in words and "passes a corner" in words
            assert float(words.split("wire.q = ")[1].split(":")[0]) == pytest.approx(corner * size, abs=1e-8 * size)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_bead_that_turns_round_near_the_end_of_a_step_passes_no_corner(size: float) -> None:
    # a load begins, and a step ends, just after half a period, where 2e-4 of the speed is there
    half = np.pi * np.sqrt(size / 9.81)
    scene = ac.System()
    height = lambda u: ca.if_else(u > -size, u * u / (2 * size), -u - size / 2)  # noqa: E731
    scene.world, scene.bead, scene.wire = World(), Particle(1.0), PointOnCurve(ParametricCurve(lambda u: (u, 0, height(u))))
    scene.load = Force(lambda t: (ca.if_else(t < 1.00006 * half, 0, 0.1), 0, 0))
    scene.connect(scene.world.frame, scene.wire.frame_a)
    scene.connect(scene.wire.frame_b, scene.bead.point)
    scene.connect(scene.load.point, scene.bead.point)
    run = ac.build(scene).simulate(2 * half, {scene.wire.q: -0.01 * size})
    assert np.min(np.abs(run.steps.t - 1.00006 * half)) < 1e-12 * half


@pytest.mark.parametrize("law", [lambda x, y: x * y / (x**2 + y**2), lambda x, y: ca.sqrt(x - 0.5), lambda x, y: ca.log(y) + x])
def test_a_ground_without_a_value_where_a_motion_begins_is_told_with_its_line(law) -> None:
    scene = ac.System()
    scene.world, scene.bead, scene.ground = World(), Particle(1.0), PointOnSurface(HeightField(law))
    scene.connect(scene.world.frame, scene.ground.frame_a)
    scene.connect(scene.ground.frame_b, scene.bead.point)
    with pytest.raises(StartValueError, match=r"'ground' .*no meaning at the start.*not a number there"):
        ac.build(scene).simulate(0.1, {scene.ground.q: (0.0, 0.0)})


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("rolls", [False, True])
@pytest.mark.filterwarnings("ignore::acausal.errors.ContactWarning")  # at its rim a dome holds what would leave it
def test_the_rim_of_a_dome_where_it_is_upright_is_told_with_its_place(rolls: bool, size: float) -> None:
    """A bead and a ball on z = 0.1 sqrt(1 - r^2 / 4), whose rim is at r = 2 and upright."""
    dome = HeightField(lambda x, y: 0.1 * ca.sqrt(size**2 - 0.25 * (x**2 + y**2)))
    scene = ac.System()
    scene.world, scene.body = World(), RigidBody.ball(1.0, 0.05 * size) if rolls else Particle(1.0)
    scene.ground = Contact(Sphere(0.05 * size), dome, Rolling()) if rolls else PointOnSurface(dome)
    scene.connect(scene.world.frame, scene.ground.frame_a)
    scene.connect(scene.ground.frame_b, scene.body.frame if rolls else scene.body.point)
    end = scene.body.frame if rolls else scene.body.point
    start = {end.position[0]: -1.0 * size, end.position[1]: 0.3 * size, end.velocity[0]: 2.0 * np.sqrt(size)}
    words = words_of(lambda: ac.build(scene).simulate(3 * np.sqrt(size), start))
    assert re.search("'ground' .*slope is infinite", words) and "inertia" not in words
    if "Integration stopped" not in words:  # it may be thrown back
        return
    name = "ground.frame_b.position" if rolls else "ground.q"
    place = [float(words.split(f"{name}[{k}] = ")[1].split(",")[0].split(". ")[0]) / size for k in (0, 1)]
    assert np.hypot(*place) == pytest.approx(2.05 if rolls else 2.0, abs=1e-3)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_bead_straight_onto_a_rim_ends_or_is_told_and_one_close_to_a_pole_is_neither(size: float) -> None:
    """Of the dome z = 0.1 sqrt(1 - r^2 / 4): the distance to its rim is smooth in time where the bead comes there, and would be thrown back; of a bowl
    by polar coordinates, which a bead passes at a thousandth and less of its width.
    """
    dome = HeightField(lambda x, y: 0.1 * ca.sqrt(size**2 - 0.25 * (x**2 + y**2)))
    for surface, aside, speeds in (
        (dome, 0.0, (1.0, 2.0, 5.0)),
        (Revolution(lambda s: (s, s**2 / size), start=size), 1e-3, (1.0,)),
        (Revolution(lambda s: (s, s**2 / size), start=size), 1e-5, (1.0,)),
    ):
        scene = ac.System()
        scene.world, scene.ground, scene.bead = World(), PointOnSurface(surface), Particle(1.0)
        scene.connect(scene.world.frame, scene.ground.frame_a)
        scene.connect(scene.ground.frame_b, scene.bead.point)
        model, place = ac.build(scene), scene.bead.point
        for speed in speeds:
            start = {place.position[:2]: (-size, aside * size), place.velocity[:2]: (speed * np.sqrt(size), 0.0)}
            words = words_of(lambda: model.simulate(6 / speed * np.sqrt(size), start))  # noqa: B023
            assert re.search("'ground' .*slope is infinite", words) if surface is dome else not words, (words, speed)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_bead_that_comes_to_where_a_slope_is_a_logarithm_is_told_the_place(size: float) -> None:
    """On z = 0.1 x log(r / size), whose slope in the origin is infinite, but nowhere near by large."""
    ground = HeightField(lambda x, y: 0.1 * x * ca.log(ca.sqrt(x * x + y * y) / size))
    scene = ac.System()
    scene.world, scene.ground, scene.bead = World(), PointOnSurface(ground), Particle(1.0)
    scene.connect(scene.world.frame, scene.ground.frame_a)
    scene.connect(scene.ground.frame_b, scene.bead.point)
    start = {scene.bead.point.position[:2]: (-size, 0.0), scene.bead.point.velocity[0]: np.sqrt(size)}
    words = r"'ground' .*has no meaning, at ground\.q\[0\] = 0, ground\.q\[1\] = 0\. .*its slope, is infinite"
    with pytest.raises(SimulationError, match=words):
        ac.build(scene).simulate(4 * np.sqrt(size), start)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("rtol", [1e-6, 1e-11, 1e-12])
def test_what_diverges_at_the_start_is_not_taken_for_rounding(rtol: float, size: float) -> None:
    """A horizontal chain of beads that is let go: link n begins to turn as t^(2 n), and its rounding as what rounding makes of those before. Lagrange's equations
    by numpy say where the third one is after the first steps; then the run goes on.
    """
    scene = ac.System()
    scene.world, link = World(), 0.1 * size
    scene.pins = [Revolute("y") for _ in range(12)]
    scene.links = [RigidBody(0.05, (0, 0, 0), centre_of_mass=(0, 0, -link)) for _ in scene.pins]
    end = scene.world.frame
    for pin, body in zip(scene.pins, scene.links, strict=True):
        scene.connect(end, pin.frame_a)
        scene.connect(pin.frame_b, body.frame)
        end = body.at((0, 0, -link))
    model, start = ac.build(scene), {scene.pins[0].q: -0.5 * np.pi}
    run = model.simulate(2.0 * np.sqrt(size), start, rtol=rtol)
    early = 0.0166 * np.sqrt(size)
    mass = np.minimum.outer(np.arange(12, 0, -1), np.arange(12, 0, -1))

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        apart = y[:12, None] - y[:12]  # angles from downwards
        pull = -(mass * np.sin(apart)) @ y[12:] ** 2 - 9.81 / link * np.arange(12, 0, -1) * np.sin(y[:12])
        return np.concatenate([y[12:], np.linalg.solve(mass * np.cos(apart), pull)])

    begin = np.repeat([0.5 * np.pi, 0.0], 12)
    exact = solve_ivp(rate, (0, early), begin, "DOP853", rtol=1e-13, atol=1e-16).y[12:, -1]
    third = run.at(np.array([early]))[scene.pins[2].v][0]
    assert third == pytest.approx(exact[1] - exact[2], rel=max(100 * rtol, 1e-8))  # the hinge turns the other way
    assert run.energy_error() < 0.1 * rtol
