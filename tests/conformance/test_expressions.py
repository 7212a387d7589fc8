"""Every argument of every part that takes a number: an expression of time, of a state or of an input in its place moves, or is refused in words.

Found by discovery, so that parts written later are asked too. Nothing that builds fails afterwards in bare CasADi.
"""

from __future__ import annotations

import inspect
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import acausal as ac
from acausal import rotations
from acausal.errors import AcausalError
from acausal.parts.rigid import AbstractGround, AbstractRigidPart
from components import Constant, Ground, Inertia, Resistor, Revolute, RigidBody, SlidingMass, VoltageSource, World
from tests.bad_input.test_constructors import PARTS, arguments

KINDS = ("time", "position", "speed", "shaft", "input")


def scene_with(cls: type[ac.Component], name: str, kind: str) -> tuple[ac.System, Any]:
    """A scene with something of every domain, and the value of the argument times 1 + 0.1 of something in it."""
    scene = ac.System()
    scene.hinge, scene.rod, scene.other = (
        Revolute("y"),
        RigidBody(1.0, (0.1, 0.2, 0.25), (0.1, 0.2, -0.3)),
        RigidBody(2.0, (0.3, 0.2, 0.25)),
    )
    scene.shaft, scene.level = Inertia(0.7), ac.Input(default=0.3)
    more = {
        "time": ac.time, "position": scene.rod.centre.position[0], "speed": scene.hinge.v, "shaft": scene.shaft.w, "input": scene.level,
    }[kind]  # fmt: skip
    usual = arguments(cls).get(name, inspect.signature(cls).parameters[name].default)
    factor = 1.0 + 0.1 * more
    value = usual * factor if isinstance(usual, float) else (usual[0] + 0.1 * more, *usual[1:])
    return scene, value


def connected(scene: ac.System, part: ac.Component) -> None:
    """The part between what stands there; what has no other side gets one."""
    scene.part = part
    if not isinstance(part, AbstractGround):
        scene.world = World()
    world = part if isinstance(part, AbstractGround) else scene.world
    scene.connect(world.connectors()[0], scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.sides = []
    places = iter((scene.rod.at((0.1, 0.3, -0.5)), scene.other.frame, scene.other.at((0.1, 0, 0)), scene.rod.at((0, 0, 1.0))))
    for end in part.connectors():
        if isinstance(end, ac.Point):
            if not isinstance(part, AbstractGround) and (end.must_connect or isinstance(part, AbstractRigidPart)):
                scene.connect(end, next(places))
        elif isinstance(end, ac.Rotational):
            scene.sides.append(Inertia(1.0 + len(scene.sides)))
            scene.connect(end, scene.sides[-1].flange_a)
        elif isinstance(end, ac.Translational):
            scene.sides.append(SlidingMass(1.0 + len(scene.sides)))
            scene.connect(end, scene.sides[-1].flange_a)
        elif isinstance(end, ac.Electrical):
            load, source, ground = Resistor(1.0 + len(scene.sides)), VoltageSource(1.0), Ground()
            scene.sides += [load, source, ground]
            scene.connect(end, load.pin_a)
            scene.connect(load.pin_b, source.pin_a)
            scene.connect(source.pin_b, ground.pin)
        elif end.must_connect:
            scene.sides.append(Constant(0.3))
            scene.connect(end, scene.sides[-1].output)


def is_number(cls: type[ac.Component], name: str) -> bool:
    """Whether it is a number or a list of numbers."""
    usual = arguments(cls).get(name, inspect.signature(cls).parameters[name].default)
    return isinstance(usual, float) or (
        isinstance(usual, tuple) and bool(usual) and all(isinstance(entry, float) for entry in usual)
    )


CASES = [(cls, name) for cls in PARTS for name in inspect.signature(cls).parameters if is_number(cls, name)]


def moves(cls: type[ac.Component], name: str, kind: str) -> bool:
    """Whether its rates are known; False where it is refused in words. Any error but one of ours is raised."""
    scene, value = scene_with(cls, name, kind)
    try:
        connected(scene, cls(**{**arguments(cls), name: value}))
        model = ac.build(scene)
    except AcausalError as error:
        print(f"{cls.__name__}.{name} by {kind}: {error}")
        assert len(str(error)) < 1200
        return False
    s = model.system
    rate = model.functions.explicit_dynamics(0.1, np.concatenate([s.q_start, s.rate_start + 0.1]), s.u_defaults, s.p_values)
    assert rate.numel() == s.x.numel()
    return True


@pytest.mark.parametrize(("cls", "name"), CASES, ids=[f"{cls.__name__}-{name}" for cls, name in CASES])
def test_an_argument_that_takes_a_number_takes_an_expression_or_says_why_not(cls: type[ac.Component], name: str):
    """One kind of expression each, all kinds in turn; the test below asks for all kinds where they must be taken."""
    moves(cls, name, KINDS[CASES.index((cls, name)) % len(KINDS)])


def test_what_is_made_of_numbers_is_a_number_everywhere():
    """A length of a vector, an entry of a rotation, CasADi's own numbers: also where nothing may move."""
    for cls, name in CASES:
        usual = arguments(cls).get(name, inspect.signature(cls).parameters[name].default)
        for made in (ac.norm, lambda x: ca.sqrt(ca.SX(x) ** 2)):
            value = made(usual) if isinstance(usual, float) and usual > 0 else usual
            cls(**{**arguments(cls), name: value})
    turn, place = rotations.euler("intrinsic zxz", (0.3, 0.4, 0.5)), rotations.axis_angle("z", 0.3) @ np.array([1.0, 2.0, 3.0])
    exact = Rotation.from_euler("ZXZ", (0.3, 0.4, 0.5)).as_matrix()
    for rotation in (turn, rotations.quaternion_of(turn), ca.SX(turn.sx)):
        for position in (place, ca.DM(place.sx), place.sx):
            body = RigidBody(1.0, (0.1, 0.2, 0.25), position=position, rotation=rotation)
            assert np.max(np.abs(body.sketch_pose().rotation - exact)) < 1e-15
            assert np.max(np.abs(body.sketch_pose().position - np.asarray(place).ravel())) == 0
    assert float(ac.Parameter(ac.norm((3.0, 4.0, 0.0))).value) == 5.0


def test_forces_springs_dampers_and_sources_take_what_moves():
    taken = {
        ("Force", "force"), ("Torque", "torque"), ("Spring", "stiffness"), ("Spring", "natural_length"), ("Damper", "damping"), ("Bushing", "stiffness"),
        ("Drag", "linear"), ("UniformField", "acceleration"), ("TorqueSource", "torque"), ("ForceSource", "force"), ("RotationalSpring", "stiffness"),
        ("TranslationalDamper", "damping"), ("VoltageSource", "voltage"), ("Resistor", "resistance"), ("Constant", "value"), ("Gain", "factor"),
    }  # fmt: skip
    asked = [(cls, name) for cls, name in CASES if (cls.__name__, name) in taken]
    assert len(asked) == len(taken)
    for cls, name in asked:
        for kind in ("position", "shaft"):
            assert moves(cls, name, kind), (cls, name, kind)
