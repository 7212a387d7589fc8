"""Switches that time alone decides end steps: short pulses, kinks and sawteeth are integrated as their closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from components import Force, Integrator, Particle, Prismatic, Relay, SampleAndHold, TimeFunction, World
from tests.pairings import each_value

T = ac.time.sx


def _speed(force: ca.SX, end: float, t0: float = 0.0, **options: object) -> tuple[float, int]:
    """Of a particle of 1 kg that is pushed along a rail, and how many steps that took."""
    scene = ac.System()
    scene.world, scene.rail, scene.push, scene.bead = World((0, 0, 0)), Prismatic("x"), Force((force, 0, 0)), Particle(1.0)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.bead.point, scene.push.point)
    run = ac.build(scene).simulate(end, {}, t0=t0, samples=3, **options)
    return float(run[scene.rail.v][-1]), run.statistics.steps


@pytest.mark.parametrize("width", [1e-1, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("method", ["auto", "radau"])
def test_pulses_are_never_stepped_over(width: float, method: str) -> None:
    """10 N between 3 s and a little later, in 100 s."""
    pulse = ca.if_else(ca.logic_and(T > 3, 3 + width > T), 10, 0)
    speed, steps = _speed(pulse, 100.0, method=method)
    assert abs(speed - 10 * width) < 1e-12
    assert steps < 60


def test_a_pulse_that_lasts_as_long_as_a_parameter_says() -> None:
    scene = ac.System()
    scene.width = ac.Parameter(0.1, "s")
    scene.world, scene.rail, scene.bead = World((0, 0, 0)), Prismatic("x"), Particle(1.0)
    scene.push = Force((ca.if_else(scene.width.sx > T, 10, 0), 0, 0))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.bead.point, scene.push.point)
    model = ac.build(scene)
    for width in (0.1, 1e-4, 7.3):
        run = model.simulate(10.0, parameters={scene.width: width}, samples=2)
        assert abs(run[scene.rail.v][-1] - 10 * width) < 1e-12


@pytest.mark.parametrize(
    ("force", "exact", "most"),
    [
        (ca.fabs(T - 2), 2.0 + 4.5, 20),
        (ca.fmin(ca.fmax(T - 1, 0), 1), 0.5 + 3.0, 25),
        (ca.if_else(ca.fmod(T, 0.1) < 0.05, 1.0, -1.0), 0.0, 120),
        (ca.floor(T), 10.0, 40),
        (ca.fabs(ca.sin(np.pi * T)), 10 / np.pi, 60),
        (ca.if_else(T**2 > 7, 1.0, 0.0), 5 - np.sqrt(7), 20),
        (ca.sign(T - 4.0), 1.0 - 4.0, 15),
    ],
    ids=["modulus", "ramp", "square", "stairs", "rectified", "late", "sign"],
)
def test_kinks_and_jumps_end_steps(force: ca.SX, exact: float, most: int) -> None:
    speed, steps = _speed(force, 5.0, rtol=1e-12)
    assert abs(speed - exact) < 1e-12
    assert steps <= most


def test_numbers_are_compared_as_anywhere() -> None:
    """`==` and `!=` of an expression and a number are expressions, as `<` is: neither is decided when it is written."""
    third = np.floor(ac.time / 0.7) == 2
    assert _speed(5 * third.sx, 5.0)[0] == pytest.approx(3.5, abs=1e-13)
    assert _speed((np.sign(ac.time - 1.5) != 1).sx, 5.0)[0] == pytest.approx(1.5, abs=1e-13)
    scene, kind = ac.System(), ac.Parameter(0.0)
    scene.kind = kind
    scene.world, scene.rail, scene.bead = World(None), Prismatic("x"), Particle(1.0)
    scene.push = Force((ca.if_else(kind == 1, 2.0, ca.if_else(kind == np.float64(3), 7.0, 0.5)), 0, 0))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.bead.point, scene.push.point)
    model = ac.build(scene)
    for value, speed in ((0, 0.5), (1, 2.0), (3, 7.0)):
        assert model.simulate(1.0, parameters={kind: value}, samples=2)[scene.rail.v][-1] == pytest.approx(speed, abs=1e-13)


def test_switches_before_the_start_do_not_matter() -> None:
    speed, _ = _speed(ca.if_else(T > 3, 1.0, 5.0), 5.0, t0=3.5, rtol=1e-12)
    assert abs(speed - 1.5) < 1e-13


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4])
def test_samples_are_taken_at_every_period_at_any_tolerance(rtol: float) -> None:
    """The integral of what is held is a sum of samples: time is known to rounding, whatever the tolerance of states is."""
    for period, end, speed in ((0.01, 2.995, 3.0), (0.07, 20.0, 0.4)):
        scene = ac.System()
        scene.source, scene.sum = TimeFunction(lambda t, speed=speed: np.sin(speed * t)), Integrator()
        scene.sampler = SampleAndHold(period)
        scene.connect(scene.source.output, scene.sampler.input)
        scene.connect(scene.sampler.output, scene.sum.input)
        run = ac.build(scene).simulate(end, rtol=rtol, samples=2)
        begins = period * np.arange(np.ceil(end / period))
        exact = np.sum(np.sin(speed * begins) * np.diff([*begins, end]))
        assert run[scene.sum.x][-1] == pytest.approx(exact, abs=1e-11)


@each_value(("rtol", [1e-2, 1e-3, 1e-5, 1e-9, 1e-13]), (("period", "count"), [(0.1, 3), (1 / 3, 10), (7e-6, 7), (4e5, 2)]))
def test_the_sample_at_the_last_instant_is_taken_at_any_tolerance(period: float, count: int, rtol: float) -> None:
    scene = ac.System()
    scene.source, scene.sampler, scene.sum = TimeFunction(lambda t: np.cos(t / period)), SampleAndHold(period), Integrator()
    scene.connect(scene.source.output, scene.sampler.input)
    scene.connect(scene.sampler.output, scene.sum.input)
    run = ac.build(scene).simulate(count * period, rtol=rtol, atol=rtol * period)
    assert [transition.time for transition in run.transitions] == pytest.approx(period * np.arange(1, count + 1), rel=1e-14)
    assert run[scene.sampler.output.value][-1] == pytest.approx(np.cos(count), abs=1e-13)


@pytest.mark.parametrize("options", [{}, {"method": "radau"}, {"step": 0.05}, {"compiled": False}])
def test_what_time_alone_moves_switches_where_nothing_has_a_state(options: dict[str, object]) -> None:
    """A relay of a sine, samples of it, and an event of a run: as where something is integrated beside them."""
    speed, period, end = 7.0, 0.13, 2.0
    scene = ac.System()
    scene.source, scene.relay, scene.sampler = TimeFunction(lambda t: np.sin(speed * t)), Relay(-0.5, 0.5), SampleAndHold(period)
    scene.connect(scene.source.output, scene.relay.input, scene.sampler.input)
    model = ac.build(scene)
    assert not model.state_names
    run = model.simulate(end, events=[ac.when(scene.source.output.value)], samples=[0.0, 1.0, end], **options)
    up, down = np.arcsin(0.5) + 2 * np.pi * np.arange(9), np.arcsin(0.5) + np.pi * (2 * np.arange(9) + 1)
    flips = np.concatenate([up, down]) / speed
    changes = np.sort(np.concatenate([flips[flips < end], period * np.arange(1, int(end / period) + 1)]))
    assert [transition.time for transition in run.transitions] == pytest.approx(changes, rel=1e-12)
    assert [event.time for event in run.events] == pytest.approx(
        np.pi / speed * np.arange(1, int(end * speed / np.pi) + 1), rel=1e-12
    )
    last = period * np.floor(run.t / period)
    assert run[scene.sampler.output.value] == pytest.approx(np.sin(speed * last), abs=1e-12)
    assert run[scene.relay.output.value] == pytest.approx([0, 1, 1])
    stopped = model.simulate(end, events=[ac.when(scene.source.output.value, stop=True)], **options)
    assert stopped.t[-1] == pytest.approx(np.pi / speed, rel=1e-12)
