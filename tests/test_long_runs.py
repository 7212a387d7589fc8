"""Runs that are longer than memory is kept for: polynomials of steps that nobody reads are dropped, and made again where they are read after all."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.collocation.problem import Accuracy, Problem
from acausal.errors import OptionError, SimulationError
from acausal.integrators.integrate import integrate
from acausal.runtime import native
from acausal.runtime.native import Run
from components import Revolute, RigidBody, RotationalDamper, RotationalGround, TorqueSource, World
from tests.scenes import DoublePendulum, FourBar


def _pendulum(**event: Any) -> Callable[[], ac.Trajectory]:
    scene = DoublePendulum()
    model = ac.build(scene)
    return lambda: model.simulate(3.0, {scene.shoulder.q: 2.0}, events=[ac.when(scene.elbow.v, **event)])


def _four_bar() -> Callable[[], ac.Trajectory]:
    scene = FourBar()
    model = ac.build(scene)
    return lambda: model.simulate(1.0, {scene.a.v: 3.0}, rtol=1e-5)


def _driven(push: Callable[[float], float] = lambda t: 3 * np.sin(t) ** 3, samples: int = 501) -> Callable[[], ac.Trajectory]:
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World(), Revolute("y"), RigidBody.rod(1.0, (0, 0, -1))
    scene.push = ac.Input("N*m")
    scene.motor = TorqueSource(scene.push)
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.motor.flange, scene.hinge.flange)
    model = ac.build(scene)
    return lambda: model.simulate(3.0, inputs={scene.push: push}, samples=samples)


SCENES = {
    "pendulum": _pendulum,
    "stopped": lambda: _pendulum(direction="falling", stop=True),
    "four_bar": _four_bar,
    "driven": _driven,
}


def _kept(run: ac.Trajectory) -> int:
    """Steps whose polynomials are in memory."""
    core = getattr(run.solution.dense, "__self__").core  # noqa: B009  # a bound method of `Run`
    return int(np.count_nonzero(np.ctypeslib.as_array(core.offset, (core.steps - core.first,)) >= 0))


@pytest.mark.parametrize("name", SCENES)
def test_runs_read_alike_whatever_is_kept(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    simulate = SCENES[name]()
    whole = simulate()
    made: list[Run] = []
    begin = Run.__init__

    def counted(run: Run, *arguments: Any, **more: Any) -> None:
        made.append(run)
        begin(run, *arguments, **more)

    monkeypatch.setattr(Run, "__init__", counted)
    for budget in (2000, 1):
        monkeypatch.setattr(native, "BUDGET", budget)
        made.clear()
        short = simulate()
        own = np.isin(whole.solution.t, short.solution.t)
        assert np.array_equal(short.solution.t, whole.solution.t[own]) and np.array_equal(
            short.solution.x, whole.solution.x[:, own]
        )
        assert np.array_equal(short.x, whole.x) or short.solution.stopped
        assert len(made) == 1 or short.solution.stopped  # samples are known beforehand, but not where an event ends the run
        times = np.sort(np.random.default_rng(1).uniform(0, whole.t[-1], 7))
        assert np.array_equal(short.at(times).x, whole.at(times).x)
        assert np.array_equal(short.at(times[::-1]).x, whole.at(times[::-1]).x)
        assert np.array_equal(short.x, whole.x) and np.array_equal(short.energy_loss, whole.energy_loss)
        assert [(e.time, e.direction, *e.x) for e in short.events] == [(e.time, e.direction, *e.x) for e in whole.events]
    assert _kept(whole) == whole.solution.t.size - 1


def test_memory_does_not_grow_with_steps_that_nobody_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = DoublePendulum()
    model = ac.build(scene)
    monkeypatch.setattr(native, "BUDGET", 4000)
    runs = [model.simulate(end, {scene.shoulder.q: 2.0}, samples=11) for end in (50.0, 100.0, 400.0)]
    assert max(map(_kept, runs)) <= 11
    assert max(run.solution.t.size for run in runs) <= 256 < 0.1 * runs[-1].statistics.steps


def test_times_that_are_read_are_kept_and_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = DoublePendulum()
    model, times = ac.build(scene), [0.3, 7.0, 7.1, 59.0]
    start, event = {scene.shoulder.q: 2.0}, ac.when(scene.elbow.v - 3.0, "rising")
    whole = model.simulate(60.0, start, samples=times, events=[event])
    monkeypatch.setattr(native, "BUDGET", 1)
    short = model.simulate(60.0, start, samples=times, events=[event])
    assert np.array_equal(short.t, times) and np.array_equal(short.x, whole.x)
    assert _kept(short) <= len(times) + len(short.events) + 1 and short.solution.t.size < 0.5 * short.statistics.steps
    there = pickle.loads(pickle.dumps(short))
    assert len(pickle.dumps(short)) < 0.5 * len(pickle.dumps(whole))
    assert np.array_equal(there.x, short.x) and [e.time for e in there.events] == [e.time for e in whole.events]
    np.testing.assert_allclose(there.at(times).x, whole.x, rtol=1e-9, atol=1e-9)
    with pytest.raises(OptionError, match="not in this copy"):
        _ = there.at(23.456).x


def test_what_is_lost_by_friction_is_found_of_what_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = DoublePendulum()
    scene.brake, scene.ground = RotationalDamper(0.02), RotationalGround()
    scene.connect(scene.shoulder.flange, scene.brake.flange_a)
    scene.connect(scene.brake.flange_b, scene.ground.flange)
    model = ac.build(scene)
    whole = model.simulate(60.0, {scene.shoulder.q: 2.0}, samples=5)
    monkeypatch.setattr(native, "BUDGET", 4000)
    short = model.simulate(60.0, {scene.shoulder.q: 2.0}, samples=5)
    assert short.solution.t.size < 0.5 * whole.solution.t.size
    np.testing.assert_allclose(short.energy_loss, whole.energy_loss, rtol=1e-6)
    assert short.energy_error() < 1e-6


def test_derivatives_of_long_motions_take_no_memory_for_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = DoublePendulum()
    model, made = ac.build(scene), list[Run]()
    begin = Run.__init__

    def counted(run: Run, *arguments: Any, **more: Any) -> None:
        made.append(run)
        begin(run, *arguments, **more)

    monkeypatch.setattr(Run, "__init__", counted)
    answers: list[np.ndarray] = []
    for budget in (native.BUDGET, 1):
        monkeypatch.setattr(native, "BUDGET", budget)
        answers.append(model.sensitivities([0.0, 30.0], [scene.shoulder.q], {scene.shoulder.q: 2.0}).S)
    assert np.array_equal(*answers)
    assert [run.core.steps - run.core.first < 256 for run in made] == [False, True]


def test_stiff_runs_that_change_their_method_are_repeated_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    t, x = ca.SX.sym("t"), ca.SX.sym("x", 2)
    rate = ca.vertcat(x[1], 1e3 * (1 - x[0] ** 2) * x[1] - x[0])
    rhs = ca.Function("rhs", [t, x, ca.SX.sym("u", 0), ca.SX.sym("p", 0)], [rate])
    van_der_pol = Problem(rhs, None, None, lambda times: np.zeros((0, times.size)), np.zeros(0))
    times = np.linspace(0.0, 900.0, 23)

    def states(method: str) -> np.ndarray:
        solution = integrate(van_der_pol, np.array([2.0, 0.0]), 0.0, 900.0, Accuracy(1e-7, 1e-7), method=method)
        assert "radau" in solution.statistics.method
        return solution.dense(times)

    whole = [states(method) for method in ("auto", "radau")]
    monkeypatch.setattr(native, "BUDGET", 500)
    for one, other in zip(whole, [states(method) for method in ("auto", "radau")], strict=True):
        assert np.array_equal(one, other)


def test_run_that_cannot_be_repeated_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "BUDGET", 500)
    bias = [0.0]
    run = _driven(lambda t: np.sin(t) + bias[0], samples=2)()
    bias[0] = 0.3
    assert np.isfinite(run.x).all()  # the samples are kept
    with pytest.raises(SimulationError, match="another one now by t = "):
        _ = run.at(0.1234).x
