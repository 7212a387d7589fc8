"""What has a name is the same by its name: in start values, parameters, inputs, and wherever a variable is asked for."""

from __future__ import annotations

import inspect
import json
import pydoc
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import acausal as ac
import components
from acausal.errors import UnknownVariableError
from acausal.export import fmu
from acausal.language.connector import Connector
from acausal.parts.joint import AbstractJoint
from components import (
    Circle,
    Contact,
    Coulomb,
    Hard,
    HeightField,
    Line,
    Particle,
    Plane,
    PointOnCurve,
    PointOnPlane,
    RigidBody,
    Rolling,
    RoughContact,
    Sphere,
    Spherical,
    Spring,
    TorqueSource,
    World,
)
from tests.scenes import FourBar, Pendulum, chain


class Driven(Pendulum):
    """A pendulum with a mass that stays adjustable, and a motor."""

    def __init__(self) -> None:
        self.mass, self.push = ac.Parameter(1.0, "kg"), ac.Input("N*m")
        super().__init__(mass=self.mass)
        self.motor = TorqueSource(self.push)
        self.connect(self.motor.flange, self.hinge.flange)


def ball() -> ac.System:
    """A chain on ball joints."""
    return chain(2, lambda _: Spherical())


def loose() -> ac.System:
    """A body off its centre and a particle that no joint holds, tied by a spring."""
    scene = ac.System()
    scene.world, scene.body, scene.bob = World(), RigidBody(2.0, (1, 2, 2.5), (0.1, 0.2, 0)), Particle(0.5, position=(1, 0, 0.5))
    scene.spring = Spring(40.0, 0.8)
    scene.connect(scene.body.at((0.3, 0, 0)), scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.bob.point)
    return scene


@pytest.mark.parametrize("make", [Driven, FourBar, ball, loose])
def test_states_are_read_and_set_by_their_names(make):
    model = ac.build(make())
    speeds = [n for n in model.state_names if ".v" in n][:1]
    begun = model.initial_state(dict.fromkeys(speeds, 0.3))
    again = model.initial_state(json.loads(json.dumps(dict(zip(model.state_names, begun.x.tolist(), strict=True)))))
    assert np.max(np.abs(again.x - begun.x)) < 1e-12
    run = model.simulate(0.1, dict.fromkeys(speeds, 0.3), samples=5)
    for name, row in zip(model.state_names, run.x, strict=True):
        assert np.array_equal(run[name], row)


def given(scene: Driven) -> dict[str, Any]:
    """What is asked by symbols, by what it is called."""
    q, tip = scene.hinge.q, scene.rod.tip.position
    return {
        "start": {q: 0.4}, "parameters": {scene.mass: 2.0}, "inputs": {scene.push: 0.3}, "wrt": [scene.mass, q], "by": [q], "states": [q, scene.hinge.v],
        "outputs": [tip], "free": [scene.push], "steady": [q], "prefer": [q], "motions": {q: 0.1 * ac.time + 0.4}, "unknowns": [scene.push],
        "variables": [q], "events": [ac.when(scene.hinge.v)],
    }  # fmt: skip


END, TIMES = 1.0, [0.0, 1.0]
METHODS: dict[str, tuple[dict[str, Any], Callable[[Any], Any]]] = {
    "initial_state": ({}, lambda found: found.x),
    "simulate": ({"end": END}, lambda run: [*run["hinge.q"], *(event.time for event in run.events)]),
    "sensitivities": ({"times": TIMES}, lambda found: found["rod.tip.position"]),
    "trajectory_function": ({"times": TIMES}, lambda f: np.array(f([2.0, 0.4]))),
    "linearize": ({}, lambda found: [*found.A.ravel(), *found.C.ravel()]),
    "equilibrium": ({}, lambda found: [*found.x, found["push"]]),
    "inverse_dynamics": ({"times": TIMES}, lambda found: found.force("push")),
    "inverse_dynamics_function": ({}, lambda f: np.array(f(0, [0.4, 0.1], 1.0, 0, 2.0))),
    "minimal": ({}, lambda found: found.start),
    "branches": ({"searches": 5}, lambda found: np.concatenate([state.x for state in found])),
    "assembly_function": ({}, lambda f: np.array(f([2.0, 0.3]))),
    "export_simulator": ({}, lambda folder: list((folder / "model.json").read_bytes())),
    "export_fmu": ({}, lambda unit: list(unit.read_bytes())),
}
"""With what else they are asked, and how an answer is read."""


def questions() -> Iterator[tuple[str, str]]:
    """All methods with all their arguments that mean something of the scene."""
    known = given(Driven())
    for name, method in inspect.getmembers(ac.Model, inspect.isfunction):
        yield from ((name, argument) for argument in inspect.signature(method).parameters if argument in known and name[0] != "_")


@pytest.mark.parametrize(("method", "argument"), list(questions()))
def test_names_give_the_bits_of_what_they_name(method, argument, tmp_path, monkeypatch):
    monkeypatch.setattr(fmu, "_compiled", lambda sources, name: sources / "model.json")
    scene = Driven()
    model, more = ac.build(scene), METHODS[method][0]
    taken = inspect.signature(getattr(model, method)).parameters
    by_symbol = {key: value for key, value in given(scene).items() if key in taken}
    if method in ("trajectory_function", "assembly_function"):
        by_symbol["outputs"] = scene.rod.tip.position
    if method in ("export_simulator", "export_fmu"):
        by_symbol["outputs"] = {"tip": scene.rod.tip.position}
    by_name = by_symbol | {argument: named(model, by_symbol[argument])}
    answers: list[np.ndarray] = []
    for k, asked in enumerate((by_symbol, by_name)):
        (tmp_path / str(k)).mkdir()
        folder = {"folder": tmp_path / str(k), "path": tmp_path / str(k) / "unit.fmu"}
        folder = {name: place for name, place in folder.items() if name in taken}
        answers.append(np.array(METHODS[method][1](getattr(model, method)(**asked, **more, **folder))))
    assert answers[0].size and np.array_equal(*answers)


def named(model: ac.Model, value: Any) -> Any:
    """Names in place of symbols."""
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        return {key: named(model, one) for key, one in value.items()}
    if isinstance(value, dict):
        return {named(model, key): one for key, one in value.items()}
    if isinstance(value, list):
        return [named(model, one) for one in value]
    if isinstance(value, ac.when):
        return ac.when("hinge.v")
    return model.system.flat.names.get(value, "rod.tip.position")


def test_answers_are_read_by_names():
    scene = Driven()
    model, start = ac.build(scene), {"hinge.q": 0.4}
    tip = scene.rod.tip.position
    placed = model.functions.frame_kinematics("rod.tip"), model.functions.frame_kinematics(scene.rod.tip)
    assert np.array_equal(*(np.array(f(0, [0.3, 0], 0, 1)[0]) for f in placed))
    with pytest.raises(UnknownVariableError, match=r"Did you mean 'rod\.tip'"):
        model.functions.frame_kinematics("rod.tp")
    for answer in (
        model.simulate(0.1, start, samples=3), model.minimal(start).simulate(0.1, samples=3), model.equilibrium(start),
        model.sensitivities(TIMES, ["mass"], start), model.inverse_dynamics(TIMES, {"hinge.q": 0.1}, ["push"]),
    ):  # fmt: skip
        assert np.array_equal(answer["rod.tip.position"], answer[tip])


def test_joints_are_unknowns_by_their_paths():
    scene = Driven()
    model = ac.build(scene)
    times, motion = np.linspace(0, 1, 4), {"hinge.q": 0.1 * ac.time}
    assert np.array_equal(
        model.inverse_dynamics(times, motion, ["hinge"]).force("hinge"),
        model.inverse_dynamics(times, motion, [scene.hinge]).force(scene.hinge),
    )


@pytest.mark.parametrize(
    "part", [part for part in vars(components).values() if inspect.isclass(part) and issubclass(part, ac.Component)]
)
def test_what_a_part_lists_is_what_its_users_read(part: type[ac.Component]) -> None:
    """Connectors, variables, what follows from them, and ways to make one: not what it owes to the library, which would fill screens of `help`."""
    listed, of_all = set(dir(part)), {name for base in part.__mro__ for name in vars(base)}
    declared = {name for name in of_all if isinstance(getattr(part, name), ac.Variable | Connector | property)}
    assert declared <= listed
    assert not listed & {"equations", "stored_energy", "pose", "closure", "motions", "inertia", "actions", "__reduce__"}
    assert len(pydoc.render_doc(part).splitlines()) <= 100


def test_parts_list_what_is_made_from_them_and_abstract_ones_what_authors_give() -> None:
    assert {"at", "rod", "frame", "tip"} <= set(dir(RigidBody)) and "between" in dir(components.Revolute)
    assert {"pose", "rates", "domain"} <= set(dir(AbstractJoint)) and "equations" in dir(ac.Component)


def test_what_is_read_of_contacts_is_told_by_its_name_and_not_by_its_formula() -> None:
    scene: Any = ac.System()
    scene.world, scene.box, scene.foot = (
        World(),
        RigidBody.box(2.0, (0.4, 0.3, 0.2)),
        PointOnPlane(unilateral=True, friction=Coulomb(0.3)),
    )
    scene.connect(scene.world.frame, scene.foot.frame_a)
    scene.connect(scene.foot.frame_b, scene.box.at((0, 0, -0.1)))
    run = ac.build(scene).simulate(0.1, {scene.box.frame.position[2]: 0.2})
    foot = scene.foot
    told = [run.label(reading) for reading in (foot.gap, foot.normal_force, foot.slip[1], foot.point_a)]
    assert told == [f"foot.{name}" for name in ("gap", "normal_force", "slip[1]", "point_a")]
    for label, reading in zip(told, (foot.gap, foot.normal_force, foot.slip[1], foot.point_a), strict=True):
        assert np.array_equal(run[label], run[reading])


@pytest.mark.parametrize(
    ("make", "read"),
    [
        (lambda: Contact(Sphere(0.1), HeightField(lambda x, y: 0.1 * x * y), Rolling()), ("q", "v", "gap", "slip", "normal_force")),
        (lambda: Contact(Sphere(0.1), Plane(), Hard(0.5)), ("gap", "normal_force", "force")),
        (lambda: Contact(Sphere(0.1), HeightField(lambda x, y: 0.1 * x * y), Hard(0.5)), ("q", "v", "gap", "normal_force")),
        (lambda: PointOnCurve(Circle(0.5), friction=Coulomb(0.3)), ("q", "v", "normal_force")),
        (lambda: PointOnCurve(Line((1, 0, 0.1)), unilateral=True), ("q", "v", "gap", "normal_force")),
        (lambda: RoughContact(Sphere(0.1), Plane(), Coulomb(0.2)), ("q", "v", "gap", "slip", "normal_force")),
    ],
)  # fmt: skip
def test_parts_made_of_parts_are_called_as_users_call_them(make: Callable[[], Any], read: tuple[str, ...]) -> None:
    scene: Any = ac.System()
    scene.world, scene.ball, scene.inner = World(), RigidBody.ball(1.0, 0.1), ac.System()
    scene.inner.guide = guide = make()
    scene.connect(scene.world.frame, guide.frame_a)
    scene.connect(guide.frame_b, scene.ball.frame)
    model = ac.build(scene)
    run = model.simulate(0.01, {"ball.frame.position": (0.3, 0.4, 0.11)} if "q" not in read else {}, samples=3)
    for name in read:
        assert np.array_equal(run[f"inner.guide.{name}"], run[getattr(guide, name)]), name
        assert not run.label(getattr(guide, name)).startswith("inner.guide.joint")
    assert not any("joint" in name for name in model.state_names)
