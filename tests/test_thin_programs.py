"""Programs that are made for modes which last, and those compiled: the same bits as what serves all modes."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import acausal as ac
from acausal.emit.compiler import compiler
from acausal.runtime import kernels, lasting
from acausal.runtime import native as natives
from acausal.runtime.kernels import How
from acausal.runtime.native import native_problem
from components import Coulomb, Particle, Planar, PointOnPlane, PrescribedMotion, RigidBody, World

Start = dict[ac.Expression, object]


def _rocking() -> tuple[ac.System, Start, float]:
    scene = ac.System()
    scene.world, scene.box, scene.plane = World(), RigidBody.box(2.0, (0.2, 0.1, 0.6)), Planar("y")
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(0.8)) for _ in range(2)]
    scene.connect(scene.world.frame, scene.plane.frame_a)
    scene.connect(scene.plane.frame_b, scene.box.frame)
    for foot, x in zip(scene.feet, (0.1, -0.1), strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x, 0, -0.3)))
    lifted = 0.1 * np.sin(0.2) + 0.3 * np.cos(0.2)
    return scene, {scene.plane.q: (lifted, 0, 0.2), scene.plane.v: (0, 0.3, 0)}, 2.0


def _sliding() -> tuple[ac.System, Start, float]:
    """Four feet, of which the box comes down on one after the other; it turns and slides, and stops."""
    scene = ac.System()
    scene.world, scene.box = World(), RigidBody.box(2.0, (0.4, 0.3, 0.2))
    scene.feet = [PointOnPlane(unilateral=True, restitution=0.3, friction=Coulomb(0.3)) for _ in range(4)]
    for foot, x, y in zip(scene.feet, (0.2, 0.2, -0.2, -0.2), (0.15, -0.15, 0.15, -0.15), strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x, y, -0.1)))
    frame = scene.box.frame
    return scene, {frame.position: (0, 0, 0.2), frame.velocity: (1, 0, 0), frame.angular_velocity: (0.5, 0.2, 1)}, 0.7


def _falling() -> tuple[ac.System, Start, float]:
    """A box that turns, and never comes down."""
    scene, start, _ = _sliding()
    return scene, start | {scene.box.frame.position: (0, 0, 1e4)}, 40.0


@pytest.mark.slow
@pytest.mark.parametrize("make", [_rocking, _sliding])
def test_programs_for_a_mode_give_the_bits_of_those_for_all(
    make: Callable[[], tuple[ac.System, Start, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Interpreted kernels are made thin where modes last; compiled ones not in so short a time."""
    scene, start, end = make()
    model = ac.build(scene)
    found: list[ac.Trajectory] = []
    for how in (How.INTERPRETED, How.COMPILED):
        with monkeypatch.context() as patch:
            functions = model.functions
            patch.setitem(functions._native._kept, How.AUTO, native_problem(functions.integrand, how))
            found.append(model.simulate(end, start, rtol=1e-9))
        assert found[-1].statistics.kernels == how.value
    assert np.array_equal(found[0].solution.t, found[1].solution.t)
    assert np.array_equal(found[0].solution.x, found[1].solution.x)
    between = np.linspace(0, end, 301)  # steps are refined there, in the modes that they had
    assert np.array_equal(found[0].solution.dense(between), found[1].solution.dense(between))


@pytest.mark.parametrize(("make", "how", "runs"), [(_rocking, How.INTERPRETED, 2), (_falling, How.COMPILED, 4)])
def test_compiled_programs_of_modes_take_over_unseen(
    make: Callable[[], tuple[ac.System, Start, float]], how: How, runs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the middle of a run, and from one run to the next: not a bit changes, whoever carries out what serves all modes."""
    scene, start, end = make()
    model = ac.build(scene)
    native = native_problem(model.functions.integrand, how)
    assert native is not None
    monkeypatch.setitem(model.functions._native._kept, How.AUTO, native)
    alone = model.simulate(end, start, rtol=1e-9, max_step=0.02)
    monkeypatch.setattr(natives, "_SLICE", 1e-4)
    monkeypatch.setattr(kernels, "in_background", lambda work, _: work())
    native.template.cache_clear()  # slices stand in it
    native.lasting = lasting.LastingModes(native.runtime, compiler())
    native.lasting.worth = 1e-4
    for _ in range(runs):
        run = model.simulate(end, start, rtol=1e-9, max_step=0.02)
        assert np.array_equal(run.solution.t, alone.solution.t)
        assert np.array_equal(run.solution.x, alone.solution.x)
    functions = native.lasting._functions.values()
    assert functions and all(function is not None for function in functions)
    assert native.compiling(0.0, math.inf) > 0 and not native.busy


def test_programs_of_one_mode_leave_the_numbers_of_others_alone() -> None:
    """A block is thrown across an inclined belt that takes it along: numbers that depend on its mass are one where that is, and anything else otherwise."""
    scene = ac.System()
    scene.world, scene.mass, scene.belt = World(), ac.Parameter(1.0, "kg"), PrescribedMotion(position=(ac.time, 0, 0))
    scene.floor, scene.block = PointOnPlane(unilateral=True, friction=Coulomb(0.5)), Particle(scene.mass)
    scene.connect(scene.world.at((0, 0, 0), rotation=("y", 0.3)), scene.belt.frame_a)
    scene.connect(scene.belt.frame_b, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.block.point)
    point, model = scene.block.point, ac.build(scene)
    runs = [
        model.simulate(2.0, {point.position: (0, 0, 0), point.velocity: (0, 0.8, 0)}, parameters={scene.mass: m})
        for m in (1.0, 4.0)
    ]
    assert np.allclose(runs[0][point.velocity][-1], (np.cos(0.3), 0, -np.sin(0.3)), atol=1e-12)
    assert np.array_equal(runs[0][point.position], runs[1][point.position])


def test_programs_are_handed_on_to_runs_with_the_same_parameters_only() -> None:
    """Run after run, side by side, and read between its steps while others go on, each motion is that of a model that has not run before."""

    def thrown() -> tuple[ac.System, Start]:
        scene = ac.System()
        scene.world, scene.mass, scene.slope, scene.plane = World(), ac.Parameter(1.0, "kg"), ac.Parameter(0.2, ""), Planar("y")
        scene.box = RigidBody(scene.mass, inertia=(0.1, 0.1, 0.1))
        scene.feet = [PointOnPlane(unilateral=True, restitution=0.3, friction=Coulomb(scene.slope)) for _ in range(2)]
        scene.connect(scene.world.frame, scene.plane.frame_a)
        scene.connect(scene.plane.frame_b, scene.box.frame)
        for foot, x in zip(scene.feet, (0.3, -0.3), strict=True):
            scene.connect(scene.world.frame, foot.frame_a)
            scene.connect(foot.frame_b, scene.box.at((x, 0, -0.2)))
        return scene, {scene.plane.q: (0.5, 0, 0.1), scene.plane.v: (0, 1, 0)}

    values = [(m, mu) for m in (1.0, 2.0) for mu in (0.0, 0.3)]

    def run(model: ac.Model, scene: ac.System, start: Start, k: int) -> ac.Trajectory:
        mass, slope = values[k % len(values)]
        return model.simulate(1.5, start, parameters={scene.mass: mass, scene.slope: slope}, rtol=1e-9)

    scene, start = thrown()
    model, times = ac.build(scene), np.linspace(0, 1.5, 77)
    one_by_one = [run(model, scene, start, k) for k in range(3 * len(values))]
    with ThreadPoolExecutor(4) as pool:
        side_by_side = list(pool.map(lambda k: run(model, scene, start, k), range(3 * len(values))))
    for k in range(len(values)):
        other, begin = thrown()
        first = run(ac.build(other), other, begin, k)
        for found in (*one_by_one[k :: len(values)], *side_by_side[k :: len(values)]):
            assert np.array_equal(found.solution.x, first.solution.x)
            assert np.array_equal(found.solution.dense(times), first.solution.dense(times))
