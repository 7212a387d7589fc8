"""Inputs as numbers, expressions, samples and functions: nothing short is stepped over, and what is a table needs no Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import Akima1DInterpolator, CubicSpline, PchipInterpolator, PPoly, interp1d, make_interp_spline

import acausal as ac
from acausal.errors import AccuracyWarning, JumpWarning, OptionError, ParameterError
from components import Force, Particle, Prismatic, VelocitySource, World

RNG = np.random.default_rng(7)
TIMES = np.cumsum(RNG.uniform(0.05, 0.5, 30))
VALUES = RNG.uniform(-2, 2, 30)


def pushed() -> tuple[Any, Any]:
    """A particle of 1 kg on a rail, pushed by an input."""
    scene: Any = ac.System()
    scene.force = ac.Input("N")
    scene.world, scene.rail, scene.push, scene.bead = World((0, 0, 0)), Prismatic("x"), Force((scene.force, 0, 0)), Particle(1.0)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.bead.point, scene.push.point)
    return scene, ac.build(scene)


SCENE, MODEL = pushed()


def final_speed(force: Any, end: float, **options: Any) -> tuple[float, int]:
    run = MODEL.simulate(end, inputs={SCENE.force: force}, samples=3, **options)
    return float(run[SCENE.rail.v][-1]), run.statistics.steps


def pulses(width: float) -> dict[str, Any]:
    """10 N from 3 s on for some time."""
    t = ac.time
    return {
        "samples": ac.samples([0, 3, 3 + width], [0, 10, 0], "constant"),
        "expression": ca.if_else(ca.logic_and(t.sx >= 3, t.sx < 3 + width), 10, 0),
        "known knots": ac.with_knots(lambda t: 10.0 if 3 <= t < 3 + width else 0.0, [3, 3 + width]),
        "scipy": PPoly([[0.0, 10.0, 0.0]], [0.0, 3.0, 3 + width, 200.0]),
        "interp1d": interp1d([0.0, 3.0, 3 + width, 200.0], [0.0, 10.0, 0.0, 0.0], kind="previous"),
    }


@pytest.mark.parametrize("method", ["auto", "radau"])
@pytest.mark.parametrize("form", list(pulses(1.0)))
def test_pulses_of_inputs_are_never_stepped_over(form: str, method: str) -> None:
    for width in (1e-1, 1e-3, 1e-6):
        speed, steps = final_speed(pulses(width)[form], 100.0, method=method)
        assert abs(speed - 10 * width) < 1e-12
        assert steps < 80


@pytest.mark.parametrize("unit", [1.0, 1e-6, 1e6])
@pytest.mark.parametrize("ground", [lambda t: 0.0, lambda t: 3.0 + np.sin(t)], ids=["still", "moving"])
def test_a_pulse_of_a_plain_function_between_stages_is_told(ground: Callable[[float], float], unit: float) -> None:
    """Two thousandths of the run, in steps that are much longer; where steps are bounded, or end at knots, it is in the motion."""
    begin, width = 0.731 * 10, 0.02

    def pulse(t: float) -> float:
        return unit * (ground(t) + (50.0 if begin <= t < begin + width else 0.0))

    with pytest.warns(AccuracyWarning, match="'?force'? is .* plain function .* ac.with_knots") as told:
        final_speed(pulse, 10.0)
    assert told[0].filename == __file__
    without, _ = final_speed(lambda t: unit * ground(t), 10.0)
    for force, options in ((ac.with_knots(pulse, [begin, begin + width]), {}), (pulse, {"max_step": 0.5 * width})):
        speed, _ = final_speed(force, 10.0, **options)
        assert abs(speed - without - 50 * width * unit) < 1e-6 * unit


@pytest.mark.parametrize(
    "force",
    [
        lambda t: np.sin(300 * t),
        lambda t: 1e3 * float(t > 0.123),
        lambda t: float(np.interp(t, TIMES, VALUES)),
        lambda t: 1e-9 * np.exp(5 * t),
        lambda t: 1.0 + 1e-13 * np.sin(1e5 * t),
        lambda t: float(np.floor(7 * t)),
    ],
    ids=["fast", "step", "table", "growing", "rounding", "stairs"],
)
@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_what_steps_have_seen_of_a_plain_function_is_not_told(force: Callable[[float], float], rtol: float) -> None:
    for end in (1.0, 5.0):
        assert np.isfinite(final_speed(force, end, rtol=rtol)[0])


def exact(spline: Callable[[np.ndarray], Any], end: float, start: float = 0.0) -> float:
    """The integral, by Gauss's rule between all knots and ends."""
    at, weights = np.polynomial.legendre.leggauss(8)
    edges = np.unique(np.concatenate([[start, end], TIMES[(start < TIMES) & (end > TIMES)]]))
    half = np.diff(edges) / 2
    return float(np.sum(half * (np.asarray(spline(edges[:-1, None] + half[:, None] * (1 + at))) @ weights)))


@pytest.mark.parametrize("kind", ["constant", "linear", "cubic"])
def test_samples_integrate_as_their_closed_forms(kind: str) -> None:
    force = ac.samples(TIMES, VALUES, kind)
    for start, end in ((0.0, 4.0), (1.3, 20.0), (TIMES[3], TIMES[9])):
        speed, steps = final_speed(force, end, t0=start)
        assert abs(speed - exact(force, end, start)) < 1e-13
        assert steps < 120
    inside = np.linspace(TIMES[0], TIMES[-1], 1000)
    wanted = {
        "constant": interp1d(TIMES, VALUES, kind="previous"),
        "linear": interp1d(TIMES, VALUES),
        "cubic": CubicSpline(TIMES, VALUES),
    }
    assert np.allclose(force(inside), wanted[kind](inside), rtol=0, atol=1e-12)
    assert force(TIMES[0] - 1) == VALUES[0]
    assert force(TIMES[-1] + 1) == VALUES[-1]


@pytest.mark.parametrize(
    "spline",
    [
        CubicSpline(TIMES, VALUES), PchipInterpolator(TIMES, VALUES), Akima1DInterpolator(TIMES, VALUES), make_interp_spline(TIMES, VALUES, k=3),
        CubicSpline(TIMES, np.append(VALUES[:-1], VALUES[0]), bc_type="periodic"), interp1d(TIMES, VALUES), interp1d(TIMES, VALUES, kind="nearest"),
        interp1d(TIMES, VALUES, kind="next"),
    ],
    ids=["cubic", "pchip", "akima", "b-spline", "periodic", "linear", "nearest", "next"],
)  # fmt: skip
def test_splines_of_scipy_are_inputs(spline: Any) -> None:
    at = np.linspace(TIMES[0], TIMES[-1], 100)
    periodic = getattr(spline, "extrapolate", None) == "periodic"
    end = float(TIMES[-1]) + (10.0 if periodic else 0.0)
    run = MODEL.simulate(end, inputs={SCENE.force: spline}, t0=float(TIMES[0]), rtol=1e-10).at(at)
    assert np.allclose(run[SCENE.force], spline(at), rtol=0, atol=1e-12)
    if hasattr(spline, "integrate"):
        whole = spline.integrate(TIMES[0], end)
        assert abs(float(MODEL.simulate(end, inputs={SCENE.force: spline}, t0=float(TIMES[0])).x[1, -1]) - whole) < 1e-10


def test_tables_and_formulas_are_evaluated_without_python(monkeypatch: pytest.MonkeyPatch) -> None:
    from acausal.runtime.native import Run

    calls: list[float] = []
    monkeypatch.setattr(Run, "_input", lambda self, t, u: calls.append(t) or 1)
    final_speed(ac.samples(TIMES, VALUES), 10.0)
    final_speed(np.sin(ac.time), 10.0)
    assert not calls


@pytest.mark.parametrize("compiled", [True, False])
def test_expressions_of_time_are_inputs(compiled: bool) -> None:
    speed, steps = final_speed(2 * np.cos(ac.time) + np.abs(ac.time - 2), 5.0, rtol=1e-12, compiled=compiled)
    assert abs(speed - 2 * np.sin(5.0) - 2.0 - 4.5) < 1e-12
    assert steps < 30


@pytest.mark.parametrize("kind", ["constant", "linear", "cubic"])
def test_all_forms_of_one_course_move_a_scene_alike(kind: str) -> None:
    table = ac.samples(TIMES, VALUES, kind)
    forms = [table, ac.with_knots(lambda t: float(table(t)), TIMES), table]
    speeds = [final_speed(form, 7.0)[0] for form in forms]
    speeds.append(float(MODEL.simulate(7.0, inputs={SCENE.force: table}, compiled=False).x[1, -1]))
    assert np.ptp(speeds) < 1e-13


def driven() -> tuple[Any, Any]:
    """A speed that is prescribed by an input."""
    scene: Any = ac.System()
    scene.speed = ac.Input("m/s")
    scene.world, scene.rail, scene.bead, scene.source = (
        World((0, 0, 0)),
        Prismatic("x"),
        Particle(2.0),
        VelocitySource(scene.speed),
    )
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.bead.point)
    scene.connect(scene.source.flange, scene.rail.flange)
    return scene, ac.build(scene)


def test_rates_of_samples_are_known_where_a_speed_is_prescribed() -> None:
    scene, model = driven()
    course = ac.samples([0, 1, 2, 3], [0.0, 1.0, 1.0, -1.0], "linear")
    run = model.simulate(4.0, inputs={scene.speed: course})
    assert abs(run[scene.rail.q][-1] - (0.5 + 1.0 + 0.0 - 1.0)) < 1e-12
    assert np.allclose(run[scene.rail.v], course(run.t), rtol=0, atol=1e-12)
    assert np.allclose(run[scene.source.flange.f], -2.0 * course.derivative()(run.t), rtol=0, atol=1e-9)
    with pytest.warns(JumpWarning, match="input speed is off by 2 of what its rate says"):
        model.simulate(2.0, inputs={scene.speed: ac.samples([0, 1], [0.0, 2.0], "constant")})


def test_no_step_is_longer_than_asked_for() -> None:
    def rare(t: float) -> float:
        return 10.0 if 3 <= t < 3.01 else 0.0

    for method in ("auto", "radau"):
        run = MODEL.simulate(10.0, inputs={SCENE.force: rare}, max_step=0.005, method=method)
        assert np.max(np.diff(run.solution.t)) <= 0.005 * (1 + 1e-9)
        assert abs(run[SCENE.rail.v][-1] - 0.1) < 1e-6
    run = MODEL.simulate(10.0, inputs={SCENE.force: rare}, max_step=0.005, method="cvodes", compiled=False)
    for wrong in ({"max_step": 0.0}, {"max_step": -1.0}, {"max_step": 0.1, "step": 0.1}):
        with pytest.raises(OptionError, match="max_step"):
            MODEL.simulate(1.0, **wrong)


def test_samples_that_make_no_sense_are_refused() -> None:
    for wrong, word in (
        (lambda: ac.samples([0, 0], [1, 2]), "ascend"),
        (lambda: ac.samples([0, 1], [1, 2, 3]), "one value for each"),
        (lambda: ac.samples([0, 1], [1, np.nan]), "finite"),
        (lambda: ac.samples([0, 1], [1, 2], "quintic"), "'constant', 'linear', 'cubic'"),
        (lambda: ac.samples(["a"], [1]), "no numbers"),
        (lambda: ac.with_knots(3.0, [1.0]), "no function"),  # type: ignore[arg-type]
        (lambda: final_speed([0, 1, 2], 1.0), "ac.samples"),
        (lambda: final_speed(ac.time * SCENE.rail.q, 1.0), "only ac.time"),
    ):
        with pytest.raises(ParameterError, match=word):
            wrong()


def test_motions_with_sampled_inputs_have_derivatives() -> None:
    scene: Any = ac.System()
    scene.mass, scene.force = ac.Parameter(1.0, "kg"), ac.Input("N")
    scene.world, scene.rail, scene.push, scene.bead = (
        World((0, 0, 0)),
        Prismatic("x"),
        Force((scene.force, 0, 0)),
        Particle(scene.mass),
    )
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.bead.point, scene.push.point)
    pulse = ac.samples([0, 3, 3.001], [0, 10, 0], "constant")
    found = ac.build(scene).sensitivities(
        [0.0, 10.0], [scene.mass], {scene.rail.q: 0.0, scene.rail.v: 0.0}, inputs={scene.force: pulse}
    )
    assert np.allclose(found[scene.rail.v], [[0.0], [-0.01]], rtol=0, atol=1e-12)
