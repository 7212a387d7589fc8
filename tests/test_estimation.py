"""Estimation: closed forms, coverage of intervals, what data cannot tell, and what is said where recordings make no sense."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import binom, kstest
from scipy.stats import chi2 as stats_chi2

import acausal as ac
from acausal.errors import AccuracyWarning, OptionError
from acausal.simulate.trajectory import Trajectory
from components import (
    ElectromotiveForce,
    ForceSource,
    Ground,
    Inductor,
    Inertia,
    Particle,
    Prismatic,
    Resistor,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    SlidingMass,
    TranslationalGround,
    TranslationalSpring,
    VoltageSource,
    World,
)
from tests.scenes import FourBar
from tests.similar import Units
from tests.similar_mechanisms import bicycle
from tests.test_optimal_control import Pendulum


@pytest.fixture(scope="module")
def swung() -> tuple[Pendulum, ac.Model, Trajectory]:
    scene = Pendulum()
    model = ac.build(scene)
    return (
        scene,
        model,
        model.simulate(3.0, {scene.hinge.q: 1.0}, parameters={scene.length: 0.63}, inputs={scene.torque: 0.4}, rtol=1e-11),
    )


def test_estimates_are_exact_without_noise(swung: Any) -> None:
    scene, model, run = swung
    t = np.linspace(0.1, 3, 20)
    data = {
        scene.hinge.q: (t, run.at(t)[scene.hinge.q], 0.01),
        scene.bob.point.position: (t[:5], run.at(t[:5])[scene.bob.point.position], 0.01),
    }
    found = ac.estimate(model, data, [scene.length, "torque", scene.hinge.q], {scene.hinge.q: 0.9})
    assert np.allclose(found.values, [0.63, 0.4, 1.0], rtol=1e-8)
    assert found.chi2 < 1e-10
    assert "hinge.q = 1" in str(found)


def test_errors_and_correlation_of_a_straight_line_are_those_of_its_normal_equations() -> None:
    scene = ac.System()
    scene.mass = SlidingMass(2.0)
    model, t, sigma = ac.build(scene), np.array([0.3, 0.5, 1.1, 1.6, 2.4]), 0.02
    y = 0.7 - 1.3 * t + sigma * np.array([0.4, -1.1, 0.3, 0.9, -0.6])
    found = ac.estimate(
        model, {scene.mass.s: (t, y, sigma)}, [scene.mass.s, scene.mass.v], {scene.mass.s: 0.5, scene.mass.v: -1.0}
    )
    A = np.stack([np.ones_like(t), t], axis=1)
    assert found.values == pytest.approx(np.linalg.lstsq(A, y)[0], rel=1e-7)
    error, turned = np.sqrt(np.diag(np.linalg.inv(A.T @ A))), -np.mean(t) / np.sqrt(np.mean(t * t))
    assert [found.standard_error(k) for k in (scene.mass.s, scene.mass.v)] == pytest.approx(sigma * error, rel=1e-6)
    assert found.correlation == pytest.approx(np.array([[1.0, turned], [turned, 1.0]]), rel=1e-6)


@pytest.mark.parametrize(
    ("units", "said"), [((1.0, 1.0), (False, True)), ((1.0, 1e6), (False, False)), ((1e-6, 1.0), (True, False))]
)
def test_noise_that_nobody_said_is_that_of_restricted_maximum_likelihood(
    units: tuple[float, float], said: tuple[bool, bool]
) -> None:
    """Of a straight line, by its place and its speed, whose noises are unlike: their likelihood after the unknowns are integrated out is greatest, in any units."""
    scene = ac.System()
    scene.mass = SlidingMass(2.0)
    rng, sigma = np.random.default_rng(4), np.array([0.03, 0.4])
    t, A = np.sort(rng.uniform(0.1, 2, 15)), np.zeros((15, 2, 2))
    A[:, 0, 0], A[:, 0, 1], A[:, 1, 1] = 1, t, 1
    y = A @ [0.7, -1.3] + sigma * rng.normal(size=(15, 2))
    which: Any = (scene.mass.s, scene.mass.v)
    data = {
        unit * key: (t, unit * y[:, k], unit * sigma[k]) if said[k] else (t, unit * y[:, k])
        for k, (unit, key) in enumerate(zip(units, which, strict=True))
    }
    found = ac.estimate(ac.build(scene), data, which, {scene.mass.s: 0.0, scene.mass.v: 0.0})

    def fitted(noise: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        rows, right = (A / noise[:, None]).reshape(-1, 2), (y / noise).ravel()
        values = np.linalg.lstsq(rows, right)[0]
        off = right - rows @ values
        return values, rows.T @ rows, 15 * np.log(noise).sum() + 0.5 * (np.linalg.slogdet(rows.T @ rows)[1] + off @ off)

    open_ones = [k for k in range(2) if not said[k]]

    def noise(logs: np.ndarray) -> np.ndarray:
        own = sigma.copy()
        own[open_ones] = np.exp(logs)
        return own

    best = minimize(
        lambda logs: fitted(noise(logs))[2],
        np.log(sigma[open_ones]),
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-13},
    )
    values, normal, _ = fitted(noise(best.x))
    assert list(found.noise.values()) == pytest.approx((np.array(units) * noise(best.x))[open_ones], rel=1e-3)
    errors = np.sqrt(np.diag(np.linalg.inv(normal)))
    assert [found.standard_error(key) for key in which] == pytest.approx(errors, rel=1e-3)
    assert np.all(np.abs(found.values - values) < 1e-3 * errors)


def test_noise_that_no_value_is_left_to_tell_is_not_known() -> None:
    scene = ac.System()
    scene.mass = SlidingMass(2.0)
    model, unknowns, start = ac.build(scene), [scene.mass.s, scene.mass.v], {scene.mass.s: 0.5, scene.mass.v: 0.0}
    found = ac.estimate(model, {scene.mass.s: ([1.0, 3.0], [2.0, 8.0])}, unknowns, start)
    assert found.values == pytest.approx([-1.0, 3.0], rel=1e-6)
    assert np.isinf(found.standard_error(scene.mass.s)) and "give standard deviations" in str(found)
    with pytest.raises(OptionError, match=r"noise of mass\.s cannot be told: the unknowns use up all but .* of its 1 values"):
        ac.estimate(model, {scene.mass.s: ([1.0], [2.0]), scene.mass.v: ([1.0, 3.0, 4.0], [2.0, 2.1, 2.2], 0.1)}, unknowns, start)


def test_what_is_said_for_all_recordings_holds_where_they_say_nothing(swung: Any) -> None:
    """And noise may be told for each entry of a vector; data of the start alone tell the start."""
    scene, model, run = swung
    t = np.linspace(0.1, 3, 12)
    place = run.at(t)[scene.bob.point.position]
    given = {scene.bob.point.position: (t, place, [0.01, 1.0, 0.02])}
    for recordings in (given, ac.Recording(given), [given], [ac.Recording(given, {scene.hinge.q: 1.0}), given]):
        found = ac.estimate(model, recordings, scene.length, {scene.hinge.q: 1.0}, inputs={scene.torque: 0.4})
        assert found["length"] == pytest.approx(0.63, rel=1e-8)
    again = ac.estimate(
        model,
        {scene.hinge.q: ([0.0, 0.0], [0.7, 0.71], 0.01)},
        [scene.hinge.q, scene.hinge.v],
        {scene.hinge.q: 0.6, scene.hinge.v: 0.0},
    )
    assert again[scene.hinge.q] == pytest.approx(0.705) and again.standard_error(scene.hinge.q) == pytest.approx(0.01 / 2**0.5)
    assert "no data sees this change: +1 of hinge.v" in str(again)


def loaded_four_bar() -> tuple[Any, dict[Any, float], dict[Any, float], dict[Any, Any], dict[Any, Any]]:
    """Scene, unknowns with their true values, what is seen with its noise, start, inputs: here of a load on the coupler, and friction in a hinge."""
    s: Any = FourBar()
    s.mass, s.rub = ac.Parameter(2.0, "kg"), ac.Parameter(0.1, "N*m*s/rad")
    s.load, s.bearing, s.still = Particle(s.mass), RotationalDamper(s.rub), RotationalGround()
    s.connect(s.coupler.tip, s.load.point)
    s.connect(s.still.flange, s.bearing.flange_a)
    s.connect(s.bearing.flange_b, s.a.flange)
    return s, {s.mass: 1.7, s.rub: 0.2, s.a.v: 8.0}, {s.d.q: 1e-3}, {s.a.q: 0.3}, {}


def loaded_bicycle() -> tuple[Any, dict[Any, float], dict[Any, float], dict[Any, Any], dict[Any, Any]]:
    """A bag behind the saddle, and a damper in the steering."""
    s = bicycle(Units()).scene
    s.mass, s.rub = ac.Parameter(10.0, "kg"), ac.Parameter(0.5, "N*m*s/rad")
    s.bag, s.damper, s.still = Particle(s.mass), RotationalDamper(s.rub), RotationalGround()
    s.connect(s.frame.at((-0.1, 0, 1.0)), s.bag.point)
    s.connect(s.still.flange, s.damper.flange_a)
    s.connect(s.damper.flange_b, s.steer.flange)
    start = {s.contact.q: (0, 0, 0, 0, 0), s.contact.v: (0.4, 13.3, 0), s.steer.q: 0.0}
    return s, {s.mass: 12.0, s.rub: 0.4}, {s.steer.q: 1e-4, s.contact.q[1]: 1e-4}, start, {}


def motor() -> tuple[Any, dict[Any, float], dict[Any, float], dict[Any, Any], dict[Any, Any]]:
    """A winding and a rotor with friction, switched on."""
    s: Any = ac.System()
    s.voltage, s.R, s.L = ac.Input("V"), ac.Parameter(2.0, "Ohm"), ac.Parameter(0.05, "H")
    s.k, s.rub = ac.Parameter(0.8, "N*m/A"), ac.Parameter(0.1, "N*m*s/rad")
    s.source, s.resistor, s.coil, s.ground = VoltageSource(s.voltage), Resistor(s.R), Inductor(s.L), Ground()
    s.drive, s.rotor, s.bearing, s.still = ElectromotiveForce(s.k), Inertia(0.02), RotationalDamper(s.rub), RotationalGround()
    s.connect(s.source.pin_b, s.ground.pin)
    s.connect(s.source.pin_a, s.resistor.pin_a)
    s.connect(s.resistor.pin_b, s.coil.pin_a)
    s.connect(s.coil.pin_b, s.drive.pin_a)
    s.connect(s.drive.pin_b, s.ground.pin)
    s.connect(s.drive.flange, s.rotor.flange_a)
    s.connect(s.still.flange, s.bearing.flange_a)
    s.connect(s.bearing.flange_b, s.rotor.flange_a)
    true = {s.R: 1.7, s.L: 0.04, s.k: 0.75, s.rub: 0.12}
    return s, true, {s.coil.i: 0.05, s.rotor.w: 0.1}, {s.rotor.w: 0, s.coil.i: 0}, {s.voltage: 24.0}


@pytest.mark.parametrize("make", [loaded_four_bar, loaded_bicycle, motor])
def test_intervals_cover_the_truth_as_often_as_they_say(make: Callable[[], Any]) -> None:
    """Over 67 repetitions with noise, 201 in all: what is left has the distribution of chi squared, and so have errors by their covariance; 95 % intervals hold the truth as
    often as binomial numbers do.
    """
    scene, true, seen, start, inputs = make()
    model, rng, t = ac.build(scene), np.random.default_rng(1), np.linspace(0.04, 0.5, 13)
    parameters = {key: value for key, value in true.items() if isinstance(key, ac.Parameter)}
    start |= {key: value for key, value in true.items() if key not in parameters}
    run = model.simulate(0.5, start, parameters=parameters, inputs=inputs, rtol=1e-10).at(t)
    exact, values = {key: run[key] for key in seen}, np.array(list(true.values()))
    chi2, off, inside = list[float](), list[float](), list[np.ndarray]()
    for _ in range(67):
        data = {key: (t, exact[key] + sigma * rng.normal(size=t.size), sigma) for key, sigma in seen.items()}
        data[next(iter(seen))][1][rng.integers(0, t.size)] = np.nan  # missing
        found = ac.estimate(model, data, list(true), start, inputs=inputs, parameters=parameters, rtol=1e-7)
        chi2.append(found.chi2)
        off.append((found.values - values) @ np.linalg.solve(found.covariance, found.values - values))
        inside.append(np.abs(found.values - values) < 1.96 * np.array([found.standard_error(key) for key in true]))
    assert found.freedom == len(seen) * t.size - 1 - values.size
    assert kstest(chi2, stats_chi2(found.freedom).cdf).pvalue > 1e-3
    assert kstest(off, stats_chi2(values.size).cdf).pvalue > 1e-3
    assert np.all(np.sum(inside, axis=0) >= binom.ppf(1e-4, 67, 0.95))


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_no_motion_is_made_for_what_only_rounding_would_gain(swung: Any, unit: float) -> None:
    """Gauss and Newton's steps end as fast as they come nearer; least squares with a tenth of the step beside say the same values."""
    scene, model, run = swung
    rng, t = np.random.default_rng(5), np.linspace(0.1, 3, 40)
    y = run.at(t)[scene.hinge.q] + 0.01 * rng.normal(size=t.size)
    data = {unit * scene.hinge.q: (t, unit * y, 0.01 * unit)}
    found = ac.estimate(model, data, [scene.length, scene.torque, scene.hinge.q], {scene.hinge.q: 0.9})
    assert found.evaluations <= 7

    def chi2(length: float, torque: float, q: float) -> float:
        own = model.simulate(
            3.0, {scene.hinge.q: q}, parameters={scene.length: length}, inputs={scene.torque: torque}, rtol=1e-11
        )
        return float(np.sum(((own.at(t)[scene.hinge.q] - y) / 0.01) ** 2))

    errors = [found.standard_error(one) for one in found.unknowns]
    for k in range(3):  # a parabola through three values beside has its least one here
        low, high = (chi2(*(found.values + way * np.eye(3)[k] * errors[k])) for way in (-0.3, 0.3))
        assert abs(high - low) < 0.3 * (high + low - 2 * found.chi2) / 2


def test_a_model_that_is_not_near_its_data_is_said(swung: Any) -> None:
    """Here nobody said that a torque acts: the fit is the best there is, and worth nothing."""
    scene, model, run = swung
    t = np.linspace(0.1, 3, 30)
    with pytest.warns(AccuracyWarning, match="not near the data"):
        ac.estimate(model, {scene.hinge.q: (t, run.at(t)[scene.hinge.q], 0.01)}, [scene.length], {scene.hinge.q: 1.0})


@pytest.mark.parametrize(("size", "said", "seed"), [(1.0, True, 0), (1e-3, True, 1), (1e3, False, 2)])
def test_what_magnifies_errors_is_followed_from_its_beginning_on(size: float, said: bool, seed: int) -> None:
    """A double pendulum turns over for longer than its start says where it will be: from values that are half as much again, all of it at once leads nowhere."""
    scene: Any = ac.System()
    scene.mass, scene.drag = ac.Parameter(1.0, "kg"), ac.Parameter(0.05 * size**1.5, "N*m*s/rad")
    scene.world, scene.ground = World(gravity=(0, 0, -9.81)), RotationalGround()
    scene.shoulder, scene.elbow = Revolute("y"), Revolute("y")
    scene.upper, scene.lower = RigidBody.rod(1.0, (0, 0, -0.5 * size)), RigidBody.rod(scene.mass, (0, 0, -0.4 * size))
    scene.bearing = RotationalDamper(scene.drag)
    scene.connect(scene.world.frame, scene.shoulder.frame_a)
    scene.connect(scene.shoulder.frame_b, scene.upper.frame)
    scene.connect(scene.upper.tip, scene.elbow.frame_a)
    scene.connect(scene.elbow.frame_b, scene.lower.frame)
    scene.connect(scene.bearing.flange_a, scene.ground.flange)
    scene.connect(scene.bearing.flange_b, scene.shoulder.flange)
    model, rng = ac.build(scene), np.random.default_rng(seed)
    a, b = scene.shoulder.q, scene.elbow.q
    start, true = {a: 2.5, b: 1.0}, {scene.mass: 0.7, scene.drag: 0.02 * size**1.5}
    t = np.linspace(0.02, 8, 400) * np.sqrt(size)
    run = model.simulate(t[-1], start, parameters=true, rtol=1e-11).at(t)
    noise = (0.01,) if said else ()
    data = {one: (t, run[one] + 0.01 * rng.normal(size=t.size), *noise) for one in (a, b)}
    found = ac.estimate(model, data, [scene.mass, scene.drag, a, b], start)
    off = (found.values - [0.7, 0.02 * size**1.5, 2.5, 1.0]) / np.sqrt(np.diag(found.covariance))
    assert np.max(np.abs(off)) < 4 and not len(found.unseen)
    assert found.freedom == 796 and abs(found.chi2 - 796) < 5 * np.sqrt(2 * 796)
    assert said or all(one == pytest.approx(0.01, rel=0.2) for one in found.noise.values())


def test_what_the_data_cannot_tell_is_said() -> None:
    """Of a spring and the mass on it only the ratio shows."""
    scene: Any = ac.System()
    scene.mass, scene.stiffness = ac.Parameter(1.0, "kg"), ac.Parameter(50.0, "N/m")
    scene.world, scene.rail, scene.body = World(gravity=(0, 0, 0)), Prismatic("x"), Particle(scene.mass)
    scene.spring, scene.fixed = TranslationalSpring(scene.stiffness), TranslationalGround()
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.body.point)
    scene.connect(scene.fixed.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.rail.flange)
    model = ac.build(scene)
    run = model.simulate(2.0, {scene.rail.q: 0.1}, parameters={scene.mass: 1.2})
    found = ac.estimate(
        model, {scene.rail.q: (run.t, run[scene.rail.q], 1e-3)}, [scene.mass, scene.stiffness], {scene.rail.q: 0.1}
    )
    assert found["stiffness"] / found["mass"] == pytest.approx(50 / 1.2, rel=1e-6)
    assert np.isinf(found.standard_error(scene.mass))
    assert "no data sees this change: +0.71 of mass, +0.71 of stiffness" in str(found).replace("-0.71", "+0.71")


def test_what_moves_nothing_leaves_the_errors_of_others_as_they_are() -> None:
    """The mass of a rod on a hinge, which swings alike with any."""
    scene: Any = ac.System()
    scene.mass, scene.world, scene.hinge = ac.Parameter(1.0, "kg"), World(gravity=(0, 0, -9.81)), Revolute("y")
    scene.rod = RigidBody.rod(scene.mass, (0, 0, -0.5))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    model, q, t = ac.build(scene), scene.hinge.q, np.linspace(0, 1, 20)
    data = {q: (t, model.simulate(1.0, {q: 0.5}, rtol=1e-11).at(t)[q], 0.01)}
    alone = ac.estimate(model, data, [q], {q: 0.4})
    found = ac.estimate(model, data, [scene.mass, q], {q: 0.4})
    assert np.isinf(found.standard_error(scene.mass)) and found.freedom == alone.freedom == 19
    assert found.standard_error(q) == pytest.approx(alone.standard_error(q), rel=1e-6)


@pytest.mark.parametrize(
    ("data", "unknowns", "words"),
    [
        (lambda s: {s.hinge.q: [1, 2]}, ["length"], r"must be \(times, values\)"),
        (lambda s: {s.hinge.q: ([1, 2], [1])}, ["length"], "2 times need 2 values"),
        (lambda s: {s.hinge.q: ([-1, 2], [1, 2])}, ["length"], "before the start"),
        (lambda s: {s.hinge.q: ([1, 2], [1, 2], 0.0)}, ["length"], "must be positive"),
        (lambda s: {s.hinge.q: ([1, 2], [1, 2], np.inf)}, ["length"], "must be positive and finite"),
        (lambda s: {s.hinge.q: ([1, 2], [1, np.inf])}, ["length"], "are infinite somewhere"),
        (lambda s: {s.hinge.q: ([1, 2], [np.nan, np.nan])}, ["length"], "hold no finite value"),
        (lambda s: {}, ["length"], "hold no finite value"),
        (
            lambda s: {s.hinge.q: ([1, 2, 3, 1e9], [1, 2, 3, 4])},
            ["length"],
            "hinge.q come 1 s apart, but then 1e.09 s, after 3 s",
        ),
        (lambda s: {s.hinge.q: ([1, 2], [1, 2])}, ["length", "length"], "unknown twice"),
        (lambda s: {s.hinge.q: ([1, 2], [1, 2])}, [], "nothing is unknown"),
        (lambda s: {s.hinge.q: ([1, 2], [1, 2], [0.1, 0.2, 0.3])}, ["length"], r"an array \(3,\)\. Give a number"),
        (lambda s: {s.bob.point.position: ([1, 2], np.zeros((3, 2)))}, ["length"], r"not \(3, 2\)\. They stand in columns"),
        (lambda s: [1.0], ["length"], "1.0 is no recording"),
        (lambda s: None, ["length"], "recordings must be a list"),
        (lambda s: {s.hinge.q: ([1, 2], [1, 2])}, ["hinge.q"], "no single start value"),
    ],
)
def test_recordings_that_make_no_sense_are_refused_in_words(swung: Any, data: Any, unknowns: list[str], words: str) -> None:
    scene, model, _ = swung
    with pytest.raises(OptionError, match=words):
        ac.estimate(model, data(scene), unknowns)


@pytest.mark.parametrize("noise", [1e-3, 1e-9])
@pytest.mark.parametrize("unit", [1.0, 1e-9])
def test_an_offset_that_is_nothing_is_known_as_well_as_the_data_say(noise, unit):
    """A constant force beside a spring, which is zero: its standard error is that of linear least squares, x = f (1 - cos wt) / k."""
    scene = ac.System()
    scene.world, scene.rail, scene.box = World((0, 0, 0)), Prismatic("x"), RigidBody.box(1.0 * unit, (0.1, 0.1, 0.1))
    scene.force, scene.k = ac.Input("N"), ac.Parameter(30.0 * unit, "N/m")
    scene.push, scene.spring, scene.ground = ForceSource(scene.force), TranslationalSpring(scene.k), TranslationalGround()
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.box.frame)
    scene.connect(scene.push.flange, scene.rail.flange)
    scene.connect(scene.ground.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.rail.flange)
    model, t, w = ac.build(scene), np.linspace(0, 2, 101), np.sqrt(30.0)
    data = 0.1 * np.cos(w * t) + noise * np.random.default_rng(3).normal(size=t.size)
    data[[4, 40]] = np.nan
    found = ac.estimate(model, {scene.rail.q: (t, data, noise)}, [scene.k, scene.force], {scene.rail.q: 0.1})
    assert found.missing == 2 and "2 values of 101 missing" in str(found) and not found.unseen.size
    kept = np.isfinite(data)
    slopes = np.column_stack([-0.1 * np.sin(w * t) * t / (2 * w), (1 - np.cos(w * t)) / 30.0])[kept] / noise
    errors = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    assert found.standard_error(scene.k) == pytest.approx(errors[0] * unit, rel=0.1)
    assert found.standard_error(scene.force) == pytest.approx(errors[1] * unit, rel=0.1)
    assert abs(found[scene.force]) < 4 * errors[1] * unit
