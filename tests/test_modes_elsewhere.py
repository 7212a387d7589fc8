"""Scenes that strike, rub and conduct: pickled, in other processes, in threads beside others, and interrupted, they move by the same bits."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from typing import Any

import numpy as np
import pytest

import acausal as ac
from components import (
    Capacitor,
    Coulomb,
    Ground,
    IdealDiode,
    Inductor,
    Inertia,
    PointOnPlane,
    Prismatic,
    Resistor,
    RigidBody,
    Spring,
    TorqueSource,
    VoltageSource,
    World,
)


def box(restitution: float = 0.5) -> tuple[Any, dict[Any, Any]]:
    """A box that is thrown on a rough floor, on two feet, and its start."""
    scene = ac.System()
    scene.world, scene.box = World(), RigidBody.box(2.0, (0.4, 0.3, 0.2))
    scene.feet = [PointOnPlane(unilateral=True, restitution=restitution, friction=Coulomb(0.3)) for _ in range(2)]
    for x, foot in zip((-0.2, 0.2), scene.feet, strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x, 0, -0.1)))
    frame = scene.box.frame
    return scene, {frame.position: (0, 0, 0.3), frame.velocity: (1, 0.3, 0), frame.angular_velocity: (0.1, 2, 0)}


def rectifier() -> tuple[Any, dict[Any, Any]]:
    scene = ac.System()
    scene.ground, scene.mains, scene.diode = Ground(), VoltageSource(-np.sin(60 * ac.time)), IdealDiode(1e-6, 1e-3)
    scene.store, scene.load = Capacitor(0.01), Resistor(2.0)
    scene.connect(scene.ground.pin, scene.mains.pin_a, scene.store.pin_b, scene.load.pin_b)
    scene.connect(scene.mains.pin_b, scene.diode.pin_a)
    scene.connect(scene.diode.pin_b, scene.store.pin_a, scene.load.pin_a)
    return scene, {}


def chopper() -> tuple[Any, dict[Any, Any]]:
    """A coil whose current goes over from one diode to the other: its modes have different indices."""
    scene = ac.System()
    scene.ground, scene.mains, scene.diode, scene.free = Ground(), VoltageSource(np.sin(60 * ac.time)), IdealDiode(), IdealDiode()
    scene.coil, scene.load = Inductor(0.02), Resistor(2.0)
    scene.connect(scene.ground.pin, scene.mains.pin_b, scene.free.pin_a, scene.load.pin_b)
    scene.connect(scene.mains.pin_a, scene.diode.pin_a)
    scene.connect(scene.diode.pin_b, scene.free.pin_b, scene.coil.pin_a)
    scene.connect(scene.coil.pin_b, scene.load.pin_a)
    return scene, {scene.coil.i: 0.0}


def told(run: Any) -> tuple[bytes, str]:
    assert len(run.transitions) > 3
    return run.x.tobytes(), str(run.transitions).replace(os.path.dirname(__file__), "")


def simulated(packed: bytes) -> tuple[bytes, str]:
    scene, model, start = pickle.loads(packed)
    return told((model or ac.build(scene)).simulate(0.4, start, samples=20))


@pytest.mark.parametrize("make", [box, rectifier, chopper])
def test_modes_are_the_same_in_other_processes(make: Any) -> None:
    scene, start = make()
    model = ac.build(scene)
    run = model.simulate(0.4, start, samples=20)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.map_async(simulated, [pickle.dumps((scene, one, start)) for one in (model, None)]).get(60)
    assert found == [told(run), told(run)]
    again, its_run = pickle.loads(pickle.dumps((scene, run)))
    part, its_part = (one.feet[1] if make is box else one.diode for one in (scene, again))
    assert told(its_run) == told(run)
    assert its_run.modes(its_part).words == run.modes(part).words
    read = (part.normal_force, its_part.normal_force) if make is box else (part.current, its_part.current)
    assert np.array_equal(run[read[0]], its_run[read[1]])


def test_modes_are_the_same_in_threads_beside_others() -> None:
    made = [box(), chopper(), rectifier()]
    models = [ac.build(scene) for scene, _ in made]
    alone = [told(model.simulate(0.4, start, samples=20)) for model, (_, start) in zip(models, made, strict=True)]
    found: dict[int, Any] = {}

    def move(k: int) -> None:
        found[k] = told(models[k % 3].simulate(0.4, made[k % 3][1], samples=20))

    threads = [threading.Thread(target=move, args=(k,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [found[k] for k in range(6)] == [*alone, *alone]


def test_what_has_been_interrupted_keeps_its_transitions() -> None:
    """By a torque that asks for it when it has been asked for so often that the box has struck some times."""
    scene, start = box(0.999)
    asked: list[float] = []

    def ask(t: float) -> float:
        asked.append(t)
        if len(asked) == 5000:
            os.kill(os.getpid(), signal.SIGINT)
        return 0.0

    scene.shaft, scene.drive = Inertia(1.0), TorqueSource(ac.Input("N*m"))
    scene.connect(scene.drive.flange, scene.shaft.flange_a)
    with pytest.raises(KeyboardInterrupt, match="Interrupted at t = ") as caught:
        ac.build(scene).simulate(1e6, start, inputs={scene.drive.torque: ask}, progress=False)
    run: Any = caught.value.run  # pyright: ignore[reportAttributeAccessIssue]  # it is given there
    assert run.status.kind.name == "INTERRUPTED" and 0 < run.t[-1] < 1e6
    assert len(run.transitions) > 3
    assert run.transitions.times[-1] <= run.t[-1]


@pytest.mark.parametrize("heights", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.3), (0.0, 0.2, 0.0)])
def test_of_several_contacts_those_are_closed_in_equilibrium_that_have_to_carry(heights: tuple[float, ...]) -> None:
    """Three masses on springs that push up the first and the last, and pull the one between down to the floor."""
    scene, g = ac.System(), 9.81
    scene.world, scene.slides = World((0, 0, -g)), [Prismatic("z") for _ in range(3)]
    scene.bodies = [RigidBody.ball(1.0 + k, 0.1) for k in range(3)]
    scene.feet = [PointOnPlane(unilateral=True) for _ in range(3)]
    scene.springs = [Spring(1000.0, rest) for rest in (0.5, 0.1, 0.5)]
    for slide, body, foot, spring in zip(scene.slides, scene.bodies, scene.feet, scene.springs, strict=True):
        scene.connect(scene.world.frame, slide.frame_a, foot.frame_a)
        scene.connect(slide.frame_b, body.frame, foot.frame_b, spring.point_b)
        scene.connect(scene.world.at((0, 0, -0.3)), spring.point_a)
    found = ac.build(scene).equilibrium({s.q: h for s, h in zip(scene.slides, heights, strict=True)})
    assert [float(found[s.q]) for s in scene.slides] == pytest.approx([0.2 - g / 1000, 0.0, 0.2 - 3 * g / 1000], abs=1e-12)
    assert [float(found[f.normal_force]) for f in scene.feet] == pytest.approx([0.0, 200.0 + 2 * g, 0.0], abs=1e-10)
