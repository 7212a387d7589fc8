"""What every integrator keeps to, found by discovery: accuracy follows the tolerance, orders are measured, invariants hold, events are found,
an interruption keeps the motion so far.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import acausal as ac
from acausal.collocation.problem import Accuracy, StatusKind
from acausal.errors import OptionError
from acausal.integrators.base import integrator, integrators
from acausal.integrators.integrate import integrate
from components import Ground, Particle, Prismatic, Resistor, Revolute, Spring, VoltageSource, World
from tests.scenes import DoublePendulum, FourBar

NAMES = sorted(integrators())
ORDERED = [name for name in NAMES if {"order", "step"} <= {f.name for f in dataclasses.fields(integrators()[name])}]  # type: ignore[arg-type]
COUNTS = {1: (4000, 8000), 2: (200, 400), 3: (80, 160), 4: (40, 80), 5: (20, 40), 6: (14, 24)}
"""Of steps in a second, where the order shows: neither the next power of the step nor rounding is seen."""


def offered(name: str) -> list[int]:
    """Low orders that a method has: it refuses the others."""
    found: list[int] = []
    for order in COUNTS:
        try:
            integrator(name, order=order)
        except OptionError:
            continue
        found.append(order)
    return found


def oscillator() -> ac.System:
    """cos t."""
    scene = ac.System()
    scene.world, scene.slide, scene.load, scene.spring = World(None), Prismatic("z"), Particle(1.0), Spring(1.0, 0.0)
    scene.connect(scene.world.frame, scene.slide.frame_a, scene.spring.point_a)
    scene.connect(scene.slide.frame_b, scene.load.point, scene.spring.point_b)
    return scene


def orbit() -> ac.System:
    """A particle on a spring in a plane: a conic section about the centre, 2 cos t and sin t."""
    scene = ac.System()
    scene.world, scene.load, scene.spring = World(None), Particle(1.0), Spring(1.0, 0.0)
    scene.connect(scene.world.frame, scene.spring.point_a)
    scene.connect(scene.load.point, scene.spring.point_b)
    return scene


@pytest.mark.parametrize("name", NAMES)
def test_the_error_falls_with_the_tolerance(name: str):
    scene = orbit()
    model = ac.build(scene)
    place, velocity = scene.load.point.position, scene.load.point.velocity
    errors: list[float] = []
    for rtol in (1e-4, 1e-7, 1e-10):
        run = model.simulate(3.0, {place: (2.0, 0, 0), velocity: (0, 1.0, 0)}, method=name, rtol=rtol, samples=41)
        exact = np.column_stack([2 * np.cos(run.t), np.sin(run.t), 0 * run.t])
        errors.append(float(np.max(np.abs(run[place] - exact))))
        assert errors[-1] < 3000 * rtol, (rtol, errors)
    assert errors[-1] < max(1e-3 * errors[0], 1e-10)


@pytest.mark.parametrize(("name", "order"), [(name, order) for name in ORDERED for order in offered(name)])
def test_the_order_with_fixed_steps_is_the_order(name: str, order: int):
    scene = DoublePendulum()
    model = ac.build(scene)
    start = {scene.shoulder.q: 0.6, scene.elbow.q: 0.3}
    fine = model.simulate(1.0, start, rtol=1e-13).x[:, -1]
    counts = COUNTS[order]
    errors = [np.max(np.abs(model.simulate(1.0, start, method=name, order=order, step=1 / n).x[:, -1] - fine)) for n in counts]
    assert abs(np.log(errors[0] / errors[1]) / np.log(counts[1] / counts[0]) - order) < 0.3


@pytest.mark.parametrize("name", NAMES)
def test_a_loop_stays_closed_and_energy_is_kept_to_the_tolerance(name: str):
    scene = FourBar()
    run = ac.build(scene).simulate(1.0, {scene.a.q: 0.5, scene.a.v: 1.0}, method=name, rtol=1e-8)
    assert run.status.kind is StatusKind.SUCCESS
    assert run.constraint_error() < 1e-12 and run.energy_error() < 1e-5


@pytest.mark.parametrize("name", NAMES)
def test_events_are_found_where_they_are_and_stop_the_motion(name: str):
    scene = oscillator()
    model = ac.build(scene)
    events = [ac.when(scene.slide.q, "falling"), ac.when(scene.slide.q + 0.9, "falling", stop=True)]
    run = model.simulate(5.0, {scene.slide.q: 1.0}, method=name, rtol=1e-9, events=events)
    assert [event.time for event in run.events] == pytest.approx([np.pi / 2, np.arccos(-0.9)], abs=1e-6)
    assert run.t[-1] == pytest.approx(np.arccos(-0.9), abs=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_an_interruption_keeps_the_motion_so_far(name: str):
    scene = oscillator()
    model = ac.build(scene)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    run = model.simulate(2000.0, {scene.slide.q: 1.0}, method=name, rtol=1e-6, progress=stop, raise_on_failure=False)
    assert run.status.kind in (StatusKind.INTERRUPTED, StatusKind.SUCCESS)
    if run.status.kind is StatusKind.INTERRUPTED:
        assert run.t[-1] < 2000.0
    assert np.max(np.abs(run[scene.slide.q] - np.cos(run.t))) < 0.3


@pytest.mark.parametrize("name", NAMES)
def test_a_progress_that_is_interrupted_keeps_the_motion_so_far(name: str):
    """Told at each chance: without the pauses that a user's display has."""
    scene = oscillator()
    made = ac.build(scene).simulate(0.1, {scene.slide.q: 1.0})
    told: list[float] = []

    def stop(fraction: float) -> None:
        told.append(fraction)
        raise KeyboardInterrupt

    solution = integrate(made.problem, made.initial.x, 0.0, 2000.0, Accuracy(1e-6, 1e-6), method=name, progress=stop)
    if told:
        assert solution.status.kind is StatusKind.INTERRUPTED and 0 < solution.t[-1] <= 2000.0
        assert np.max(np.abs(solution.x[0] - np.cos(solution.t))) < 0.3


@pytest.mark.parametrize("name", NAMES)
def test_options_that_a_method_lacks_are_refused(name: str):
    scene = oscillator()
    model = ac.build(scene)
    known = {f.name for f in dataclasses.fields(integrators()[name])}  # type: ignore[arg-type]
    for option, value in (("order", 4), ("step", 0.01)):
        if option not in known:
            with pytest.raises(OptionError, match=f"no option '{option}'"):
                model.simulate(1.0, {scene.slide.q: 1.0}, method=name, **{option: value})


@pytest.mark.parametrize("name", NAMES)
def test_time_may_begin_anywhere_and_not_pass_at_all(name: str):
    scene = oscillator()
    model = ac.build(scene)
    later = model.simulate(102.0, {scene.slide.q: 1.0}, t0=100.0, method=name, rtol=1e-8)
    assert later[scene.slide.q][-1] == pytest.approx(np.cos(2.0), abs=1e-5)
    still = model.simulate(0.0, {scene.slide.q: 1.0}, method=name)
    assert np.all(still[scene.slide.q] == 1.0)


@pytest.mark.parametrize("name", NAMES)
def test_what_has_no_state_follows_its_source(name: str):
    scene = ac.System()
    scene.source, scene.load, scene.ground = VoltageSource(np.sin(3 * ac.time)), Resistor(4.0), Ground()
    scene.connect(scene.source.pin_a, scene.load.pin_a)
    scene.connect(scene.source.pin_b, scene.load.pin_b, scene.ground.pin)
    run = ac.build(scene).simulate(2.0, method=name, samples=7)
    assert np.max(np.abs(4.0 * run[scene.load.pin_a.i] - np.sin(3 * run.t))) < 1e-15


def test_a_revolving_hinge_is_the_same_for_all():
    """All methods agree with one another on a motion without a closed form."""
    scene = DoublePendulum()
    model = ac.build(scene)
    ends = [model.simulate(1.5, {scene.shoulder.q: 2.0, scene.elbow.q: 0.3}, method=n, rtol=1e-10).x[:, -1] for n in NAMES]
    assert np.max(np.ptp(np.array(ends), axis=0)) < 1e-6
    assert isinstance(scene.shoulder, Revolute)
