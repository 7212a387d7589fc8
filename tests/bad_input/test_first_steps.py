"""What a beginner gets wrong: each message says what is wrong, where (part, line), with which values, what to try."""

from __future__ import annotations

import traceback
from collections.abc import Callable

import numpy as np
import pytest

import acausal as ac
from acausal import errors
from components import (
    Cone,
    Contact,
    Disk,
    Fixed,
    Force,
    Hard,
    Inertia,
    NonlinearSpring,
    Particle,
    Plane,
    Revolute,
    RigidBody,
    RollingCone,
    RollingDisk,
    RollingEllipsoid,
    RotatingEarth,
    RotationalGround,
    Sphere,
    Spherical,
    Spring,
    Torque,
    TorqueSource,
    Torus,
    Touching,
    Universal,
    World,
)  # fmt: skip
from tests.scenes import FourBar, Pendulum

HERE = "test_first_steps.py:"


def unconnected() -> None:
    scene = Pendulum()
    scene.extra = Revolute()
    scene.connect(scene.rod.tip, scene.extra.frame_a)
    ac.build(scene)


def frame_to_flange() -> None:
    scene = Pendulum()
    scene.rotor = Inertia(1.0)
    scene.connect(scene.rod.tip, scene.rotor.flange_a)


def point_for_frame() -> None:
    scene = Pendulum()
    scene.bob, scene.extra, scene.ball = Particle(1.0), Revolute(), RigidBody.ball(1.0, 0.1)
    scene.connect(scene.bob.point, scene.extra.frame_a)
    scene.connect(scene.extra.frame_b, scene.ball.frame)
    ac.build(scene)


def same_part_twice() -> None:
    scene = Pendulum()
    scene.again = scene.rod
    ac.build(scene)


def two_grounds() -> None:
    scene = Pendulum()
    scene.other = World(gravity=(0, 0, -1.6))
    ac.build(scene)


def grounds_in_a_loop() -> None:
    scene = Pendulum()
    scene.post = Fixed((0, 0, 1.0))
    scene.connect(scene.world.frame, scene.post.frame_a)
    scene.connect(scene.post.frame_b, scene.world.at((0, 0, 2.0)))
    ac.build(scene)


def no_ground() -> None:
    scene = ac.System()
    scene.rod = RigidBody.rod(1.0, (0, 0, -1))
    ac.build(scene)


def no_parts() -> None:
    ac.build(ac.System())


def nothing_moves() -> None:
    scene = ac.System()
    scene.world = World()
    ac.build(scene)


def rod_on_the_ground() -> None:
    scene = ac.System()
    scene.world, scene.rod = World(), RigidBody.rod(1.0, (0, 0, 1.0))
    scene.connect(scene.world.frame, scene.rod.frame)
    ac.build(scene)


def massless_end() -> None:
    scene = Pendulum()
    scene.extra, scene.stick = Revolute("y"), Fixed((0, 0, -1))
    scene.connect(scene.rod.tip, scene.extra.frame_a)
    scene.connect(scene.extra.frame_b, scene.stick.frame_a)
    ac.build(scene)


def thin_rod_about_itself() -> None:
    scene = Pendulum()
    scene.extra, scene.thin = Revolute("x"), RigidBody.rod(1.0, (1, 0, 0))
    scene.connect(scene.rod.tip, scene.extra.frame_a)
    scene.connect(scene.extra.frame_b, scene.thin.frame)
    ac.build(scene)


def massless_point() -> None:
    scene = Pendulum()
    scene.one, scene.two = Spring(1.0), Spring(1.0)
    scene.connect(scene.rod.tip, scene.one.point_a)
    scene.connect(scene.one.point_b, scene.two.point_a)
    scene.connect(scene.two.point_b, scene.world.frame)
    ac.build(scene)


def locked() -> None:
    scene = ac.System()
    scene.world = World()
    scene.hinges = [Revolute("y") for _ in range(3)]
    scene.rods = [RigidBody.rod(1.0, (1, 0, 0)) for _ in range(2)]
    ends = [
        scene.world.frame,
        scene.rods[0].frame,
        scene.rods[0].tip,
        scene.rods[1].frame,
        scene.rods[1].tip,
        scene.world.at((1, 0, 0)),
    ]
    for k, hinge in enumerate(scene.hinges):
        scene.connect(ends[2 * k], hinge.frame_a)
        scene.connect(hinge.frame_b, ends[2 * k + 1])
    ac.build(scene)


def joint_on_one_body() -> None:
    scene = Pendulum()
    scene.extra = Revolute("y")
    scene.connect(scene.rod.tip, scene.extra.frame_a)
    scene.connect(scene.extra.frame_b, scene.rod.frame)
    ac.build(scene)


def part_not_in_scene() -> None:
    scene = Pendulum()
    extra, ball = Revolute(), RigidBody.ball(1.0, 0.1)
    scene.connect(scene.rod.tip, extra.frame_a)
    scene.connect(extra.frame_b, ball.frame)
    ac.build(scene)


def connected_twice() -> None:
    scene = Pendulum()
    scene.connect(scene.world.frame, scene.hinge.frame_a)


def connected_to_itself() -> None:
    scene = Pendulum()
    scene.connect(scene.rod.tip, scene.rod.tip)


def part_for_connector() -> None:
    scene = Pendulum()
    scene.connect(scene.rod, scene.hinge.frame_b)  # pyright: ignore


def variable_replaced() -> None:
    Pendulum().hinge.q = 0.3  # pyright: ignore


def part_named_like_a_method() -> None:
    scene = ac.System()
    scene.parts = [RigidBody.ball(1.0, 0.1)]  # pyright: ignore


class Idle(ac.Component):
    """Two angles that are equal, and nothing else."""

    a = ac.Variable("rad", if_undetermined="Connect a spring to it.")
    b = ac.Variable("rad")

    def equations(self):
        yield ac.equal(self.a, self.b)


def underdetermined() -> None:
    scene = ac.System()
    scene.idle = Idle()
    ac.build(scene)


def torque_on_a_held_shaft() -> None:
    scene = ac.System()
    scene.rotor, scene.one, scene.two = Inertia(1.0), RotationalGround(), RotationalGround()
    scene.connect(scene.rotor.flange_a, scene.one.flange)
    scene.connect(scene.rotor.flange_b, scene.two.flange)
    ac.build(scene)


def run(start=None, **options) -> Callable[[], None]:
    def call() -> None:
        scene = Pendulum()
        other = Pendulum()
        model = ac.build(scene)
        model.simulate(1.0, start(scene, other) if start else {}, **options)

    return call


def read_of_another_scene() -> None:
    _ = ac.build(Pendulum()).simulate(1.0)[Pendulum().hinge.q]


def time_outside() -> None:
    ac.build(Pendulum()).simulate(1.0).at(2.0)


def ball_joint_from(quaternion: tuple[float, ...]) -> Callable[[], object]:
    def call() -> object:
        scene = ac.System()
        scene.world, scene.ball, scene.box = World(), Spherical(), RigidBody.box(1.0, (0.1, 0.2, 0.3))
        scene.connect(scene.world.frame, scene.ball.frame_a)
        scene.connect(scene.ball.frame_b, scene.box.frame)
        return ac.build(scene).simulate(0.1, {scene.ball.q: quaternion})

    return call


CASES: list[tuple[str, Callable[[], object], type[Exception], tuple[str, ...]]] = [
    ("unconnected", unconnected, errors.UnconnectedError, ("extra.frame_b", HERE, "connect both")),
    ("frame to flange", frame_to_flange, errors.IncompatibleError, ("tip of RigidBody", "flange_a of Inertia", HERE)),
    ("point where a frame is needed", point_for_frame, errors.IncompatibleError, ("extra.frame_a", "'bob'", "point", HERE, "Fixed")),
    ("same part twice", same_part_twice, errors.DuplicateError, ("'rod' and as 'again'", "Make two")),
    ("two grounds", two_grounds, errors.GroundError, ("other", "-1.6", "Keep one")),
    ("ground loop does not fit", grounds_in_a_loop, errors.GroundError, ("gap of 1 m", "post", HERE)),
    ("no ground", no_ground, errors.GroundError, ("no ground", "World()")),
    ("no parts", no_parts, errors.ModelError, ("no parts",)),
    ("nothing moves", nothing_moves, errors.LockedError, ("world", "Add a joint")),
    ("rod on the ground", rod_on_the_ground, errors.LockedError, ("rod", "Add a joint")),
    ("massless end", massless_end, errors.MasslessError, ("'extra'", HERE, "stick", "Connect a body with mass")),
    ("thin rod about itself", thin_rod_about_itself, errors.MasslessError, ("'extra'", "thin")),
    ("massless point between springs", massless_point, errors.MasslessError, ("one.point_b",)),
    ("locked", locked, errors.LockedError, ("locked", "hinges[", "Remove a joint")),
    ("joint on one body", joint_on_one_body, errors.LockedError, ("extra", "rod", HERE)),
    ("loop cannot close", lambda: ac.build(FourBar(coupler=5.0)), errors.AssemblyError, ("'c'", "gap reached is 2.8", "lengths")),
    ("part not in the scene", part_not_in_scene, errors.IncompatibleError, ("frame_a", "scene.name = Revolute", HERE)),
    ("connected twice", connected_twice, errors.DuplicateError, ("already connected", HERE)),
    ("connected to itself", connected_to_itself, errors.IncompatibleError, ("itself",)),
    ("part for connector", part_for_connector, errors.IncompatibleError, ("takes connectors", "frame, tip")),
    ("variable replaced", variable_replaced, errors.DuplicateError, ("'q'", "start={")),
    ("part named like a method", part_named_like_a_method, errors.DuplicateError, ("'parts'", "another name")),
    ("underdetermined", underdetermined, errors.UnderdeterminedError, ("idle.", "[rad]", "Connect a spring", "1 equations, 2 unknowns")),
    ("held shaft", torque_on_a_held_shaft, errors.AcausalError, ()),
    ("triangle inequality", lambda: RigidBody(1.0, (1, 1, 3)), errors.ParameterError, ("1, 1, 3", HERE, "sum of")),
    ("asymmetric inertia", lambda: RigidBody(1.0, ((1, 0.5, 0), (0, 1, 0), (0, 0, 1))), errors.ParameterError, ("symmetric",)),
    ("negative moment", lambda: RigidBody(1.0, (-1, 1, 1)), errors.ParameterError, ("-1",)),
    ("cone wider than a plane", lambda: Cone(45), errors.ParameterError, ("45 rad", HERE, "np.radians")),
    ("rolling cone wider than a plane", lambda: RollingCone(ac.Parameter(2.0, "rad")), errors.ParameterError, ("2 rad", HERE, "np.radians")),
    ("torus without a hole", lambda: Torus(0.1, 0.2), errors.ParameterError, ("0.2 m", "0.1 m", HERE)),
    ("latitude in degrees", lambda: RotatingEarth().level(48.0, 0.0), errors.ParameterError, ("48 rad", HERE, "np.radians")),
    ("law of forces in a joint", lambda: Touching(Sphere(0.1), Plane(), Hard()), errors.ParameterError, ("law is Hard(...)", HERE)),  # pyright: ignore
    ("zero axis", lambda: Revolute((0, 0, 0)), errors.ParameterError, ("length zero", HERE)),
    ("unknown axis", lambda: Revolute("w"), errors.ParameterError, ("'w'", "'x'")),
    ("axes not perpendicular", lambda: Universal("x", (1, 1, 0)), errors.ParameterError, ("perpendicular",)),
    ("NaN", lambda: RigidBody(float("nan"), (1, 1, 1)), errors.ParameterError, ("mass is nan", HERE)),
    ("infinite", lambda: Spring(float("inf")), errors.ParameterError, ("stiffness is inf",)),
    ("NaN in a vector", lambda: World((0, 0, float("nan"))), errors.ParameterError, ("gravity", "nan")),
    ("two numbers for a vector", lambda: RigidBody.rod(1.0, (1, 0)), errors.ParameterError, ("three numbers",)),
    ("negative radius", lambda: RigidBody.ball(1.0, -0.1), errors.ParameterError, ("radius is -0.1", "positive")),
    ("zero wheel", lambda: RollingDisk(0.0), errors.ParameterError, ("radius is 0",)),
    ("flat ellipsoid", lambda: RollingEllipsoid((1, 1, 0)), errors.ParameterError, ("positive",)),
    ("zero mass", lambda: Particle(0.0), errors.ParameterError, ("mass is 0", HERE)),
    ("negative parameter", lambda: Particle(ac.Parameter(-1.0, "kg")), errors.ParameterError, ("mass is -1",)),
    ("text for a number", lambda: Particle("heavy"), errors.ParameterError, ("'heavy'",)),
    ("rod of length zero", lambda: RigidBody.rod(1.0, (0, 0, 0)), errors.ParameterError, ("length zero",)),
    ("not a rotation", lambda: Fixed((0, 0, 1), rotation=2 * np.eye(3)), errors.ParameterError, ("orthogonal",)),
    ("force in no axes", lambda: Force((1, 0, 0), resolved_in="ground"), errors.ParameterError, ("'world' or 'body'",)),
    ("constant potential", lambda: NonlinearSpring(lambda length: 3.0), errors.ParameterError, ("function of the length",)),
    ("start of a fixed point", run(lambda s, o: {s.rod.frame.position: (0, 0, 0)}), errors.StartValueError, ("rod.frame.position", "not free")),
    ("start of a force", run(lambda s, o: {s.hinge.frame_b.force: (0, 0, 0)}), errors.StartValueError, ("force", "not free")),
    ("start of another scene", run(lambda s, o: {o.hinge.q: 1.0}), errors.UnknownVariableError, ("another scene", "hinge.q")),
    ("start by a wrong name", run(lambda s, o: {"hinges.q": 1.0}), errors.UnknownVariableError, ("'hinges.q'", "Did you mean 'hinge.q'")),
    ("start NaN", run(lambda s, o: {s.hinge.q: float("nan")}), errors.StartValueError, ("hinge.q", "nan")),
    ("start of wrong size", run(lambda s, o: {s.rod.tip.position: 1.0}), errors.StartValueError, ("rod.tip.position", "needs 3")),
    ("contradicting starts", run(lambda s, o: {s.hinge.q: 1.0, s.rod.tip.position: (0, 0, -1)}), errors.StartValueError, ("hinge.q", "off by", "ac.near")),
    ("negative duration", run(t0=2.0), errors.OptionError, ("before the start",)),
    ("unknown method", run(method="euler"), errors.OptionError, ("'euler'", "gauss")),
    ("tolerance zero", run(rtol=0.0), errors.OptionError, ("rtol",)),
    ("input of another scene", run(inputs={ac.Input("N"): 1.0}), errors.UnknownVariableError, ("input",)),
    ("reading another scene", read_of_another_scene, errors.UnknownVariableError, ("another scene",)),
    ("time outside", time_outside, errors.OptionError, ("from 0 s to 1 s",)),
    ("torque on nothing", lambda: _alone(Torque((0, 0, 1))), errors.UnconnectedError, ("torque.frame", "acts on nothing")),
    ("source on nothing", lambda: _alone(TorqueSource(1.0)), errors.UnconnectedError, ("drives nothing",)),
    ("step of odd order", lambda: ac.build(Pendulum()).step("gauss", 3), errors.OptionError, ("order 3",)),
    ("joint between particles", lambda: Spherical.between(Particle(1.0), Particle(1.0), at=(0, 0, 0)), errors.IncompatibleError, ("Particle",)),
    ("no unit quaternion", ball_joint_from((1.0, 1.0, 0.0, 0.0)), errors.StartValueError, ("ball.q", "length 1.41421", "rotation has 1", "frame_b.rotation")),
    ("quaternion of few digits", ball_joint_from((0.707, 0.707, 0.0, 0.0)), errors.StartValueError, ("ball.q", "length 0.999849")),
    ("damping of a joint", lambda: Revolute("y", damping=0.1), errors.ParameterError, ("no argument 'damping'", "connected to its flange", HERE)),  # pyright: ignore
    ("rolling on an edge", lambda: Contact(Plane(), Disk(0.1)), errors.ParameterError, ("Disk has edges", "exchange shape and surface", HERE)),
    ("Modelica's name of an angle", lambda: Revolute("y").phi, AttributeError, ("no 'phi'", "It has: ", "q, v")),  # pyright: ignore
    ("joint placed nowhere", lambda: Revolute.between(World(), RigidBody.ball(1.0, 0.1), axis="y"), errors.ParameterError, ("at=",)),
]  # fmt: skip


def _alone(part: ac.Component) -> None:
    scene = Pendulum()
    scene.torque = part
    ac.build(scene)


@pytest.mark.parametrize(("call", "kind", "words"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_message(call, kind, words):
    with pytest.raises(kind) as caught:
        call()
    message = str(caught.value)
    print(f"{type(caught.value).__name__}: {message}")
    for word in words:
        assert word in message
    assert len(message) < 700


@pytest.mark.parametrize(
    ("of", "name", "words"),
    [
        (Pendulum, "hinges", "Did you mean 'hinge'?"),
        (lambda: Pendulum().hinge, "frame_c", "Did you mean 'frame_b'?"),
        (lambda: Pendulum().hinge.frame_b, "positon", "Did you mean 'position'?"),
        (lambda: ac, "Sytem", "Did you mean 'System'"),
    ],
)
def test_misspelt_names_are_answered_with_the_right_one_once(of: Callable[[], object], name: str, words: str) -> None:
    with pytest.raises(AttributeError) as caught:
        getattr(of(), name)
    shown = "".join(traceback.format_exception(caught.value))  # where Python adds its own guess
    assert words in shown and shown.count("Did you mean") == 1


@pytest.mark.parametrize(("name", "words"), [("sin", "np.sin"), ("vertcat", "'vertcat'.")])
def test_names_that_the_package_lacks_are_answered(name: str, words: str) -> None:
    with pytest.raises(AttributeError, match=words):
        getattr(ac, name)


def test_failed_integration_keeps_what_was_computed():
    """A particle falls into the centre of an attraction: the time of the collision is known."""
    scene = ac.System()
    scene.world, scene.bob, scene.pull = World(None), Particle(1.0), NonlinearSpring(lambda length: -1 / length)
    scene.connect(scene.world.frame, scene.pull.point_a)
    scene.connect(scene.pull.point_b, scene.bob.point)
    model = ac.build(scene)
    with pytest.raises(errors.SimulationError, match="bob") as caught:
        model.simulate(10.0, {scene.bob.point.position: (1, 0, 0)})
    run = caught.value.trajectory
    assert abs(run.t[-1] - np.pi / (2 * np.sqrt(2))) < 1e-4
    assert run.status.kind.name in ("STEP_UNDERFLOW", "NON_FINITE")
    quiet = model.simulate(10.0, {scene.bob.point.position: (1, 0, 0)}, raise_on_failure=False)
    assert quiet.t[-1] == run.t[-1]
    assert np.isfinite(quiet[scene.bob.point.position]).all()
