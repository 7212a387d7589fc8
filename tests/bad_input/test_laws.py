"""Forces and constraints of one's own, written wrongly; forces that read what they cannot know; quantities and files of another kind."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline, KroghInterpolator
from scipy.spatial.transform import Rotation

import acausal as ac
from acausal import errors
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.force import AbstractForce, AbstractLineForce, Action
from acausal.parts.inertia import Inertia
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, rotation_about_z, symbolic
from acausal.parts.rigid import AbstractRigidPart, Attachment
from components import (
    Fixed,
    Force,
    Free,
    NonlinearSpring,
    Particle,
    PointOnPlane,
    Prismatic,
    Revolute,
    RigidBody,
    RollingBall,
    RollingDisk,
    RotationalGround,
    Spherical,
    Spring,
    TorqueSensor,
    TorqueSource,
    World,
)  # fmt: skip
from components import (
    Inertia as Rotor,
)
from components.orientation import rotation_about
from tests.bad_input.messages import Wrong, pendulum_with
from tests.scenes import Pendulum

HERE = "test_laws.py:"
NONE = ca.SX.zeros(3)
MODEL, PARAMETER, UNKNOWN = errors.ModelError, errors.ParameterError, errors.UnknownVariableError


def held_by(part: Any) -> object:
    """Builds a ball that a joint or constraint holds to the world."""
    scene = ac.System()
    scene.world, scene.own, scene.ball = World(), part, RigidBody.ball(1.0, 0.1)
    scene.connect(scene.world.frame, scene.own.frame_a)
    scene.connect(scene.own.frame_b, scene.ball.frame)
    return ac.build(scene)


def constraint(closure: Callable[..., Any] | None = None, **more: Callable[..., Any]) -> Callable[[], object]:
    """Builds a ball that a constraint with these methods holds."""
    methods = {"closure": closure or (lambda self, X, t: symbolic(X.position)[2]), **more}
    return lambda: held_by(type("Own", (AbstractConstraint,), {**methods, "__module__": __name__})())


def on_rail(closure: Callable[..., Any]) -> Callable[[], object]:
    """Builds a ball that slides along x and that a constraint holds."""

    def call() -> object:
        scene = ac.System()
        scene.world, scene.rail, scene.ball = World(), Prismatic("x"), RigidBody.ball(1.0, 0.1)
        scene.own = type("Own", (AbstractConstraint,), {"closure": closure, "__module__": __name__})()
        scene.connect(scene.world.frame, scene.rail.frame_a, scene.own.frame_a)
        scene.connect(scene.rail.frame_b, scene.ball.frame, scene.own.frame_b)
        return ac.build(scene)

    return call


def joint(**methods: Callable[..., Any]) -> Callable[[], object]:
    """Builds a ball on a hinge of one's own with these methods."""

    class Own(AbstractJoint):
        q = ac.Variable("rad")
        v = ac.Variable("rad/s")

        def pose(self, q: ca.SX, t: ca.SX) -> Pose:
            return Pose(rotation_about_z(q), np.zeros(3))

    return lambda: held_by(type("Own", (Own,), {**methods, "__module__": __name__})())


def place(force: Any, placement: Any) -> ca.SX:
    return symbolic(placement.pose(force.point).position)


def attraction(force: Any, placement: Any) -> tuple[Action, ...]:
    """Three newtons a metre towards the origin."""
    return (Action(force.point, -3 * symbolic(placement.pose(force.point).rotation).T @ place(force, placement), NONE),)


def force(
    actions: Callable[..., Any] = attraction,
    potential_energy: Callable[..., Any] = lambda self, at: 1.5 * ca.sumsqr(place(self, at)),
    power_loss: Callable[..., Any] = lambda self, at: ca.SX(0),
) -> Callable[[], object]:
    """Builds a ball with a force of these methods."""

    def call() -> object:
        methods = {"actions": actions, "potential_energy": potential_energy, "power_loss": power_loss}
        own = type("Own", (AbstractForce,), {"point": ac.Point.port(), **methods, "__module__": __name__})
        scene = ac.System()
        scene.world, scene.ball, scene.own = World(), RigidBody.ball(1.0, 0.1), own()
        scene.connect(scene.own.point, scene.ball.frame)
        return ac.build(scene)

    return call


def line_force(tension: Callable[..., Any], potential: Callable[..., Any]) -> Callable[[], object]:
    """Builds a ball that is pulled with this tension."""

    def call() -> object:
        own = type("Own", (AbstractLineForce,), {"tension": tension, "potential": potential, "__module__": __name__})
        scene = ac.System()
        scene.world, scene.ball, scene.own = World(), RigidBody.ball(1.0, 0.1), own()
        scene.connect(scene.own.point_a, scene.world.frame)
        scene.connect(scene.own.point_b, scene.ball.frame)
        return ac.build(scene)

    return call


def test_the_parts_that_are_changed_here_are_right_without_changes():
    for call in (constraint(), joint(), force(), line_force(lambda self, s, r: 3 * s + r, lambda self, s: 1.5 * s**2)):
        call()


def body(
    inertia: Any, attachments: Callable[[Any], Any] = lambda self: (Attachment(self.frame, Pose.identity()),)
) -> Callable[[], object]:
    """Builds a body of one's own."""

    def call() -> object:
        methods = {"inertia": lambda self: inertia, "attachments": attachments}
        scene = ac.System()
        scene.world = World()
        scene.own = type("Own", (AbstractRigidPart,), {"frame": ac.Frame.port(), **methods, "__module__": __name__})()
        return ac.build(scene)

    return call


def pushed(reading: Callable[[Any], Any], kind: Callable[[Any], Any] = Force) -> Callable[[], object]:
    """Builds a pendulum with a torque sensor, and with a force that reads something."""

    def call() -> object:
        scene = Pendulum()
        scene.rotor, scene.sensor = Rotor(1.0), TorqueSensor()
        scene.connect(scene.hinge.flange, scene.sensor.flange_a)
        scene.connect(scene.sensor.flange_b, scene.rotor.flange_a)
        scene.push = kind(reading(scene))
        scene.connect(scene.rod.tip, scene.push.connectors()[0])
        return ac.build(scene)

    return call


def thin_rod(tip: tuple[float, float, float], *, held: bool) -> Callable[[], object]:
    def call() -> object:
        scene = ac.System()
        scene.world, scene.rod = World(), RigidBody.rod(1.0, tip)
        if held:
            scene.ball = Spherical()
            scene.connect(scene.world.frame, scene.ball.frame_a)
            scene.connect(scene.ball.frame_b, scene.rod.frame)
        return ac.build(scene)

    return call


def turned_round(contact: Any, what: RigidBody) -> Callable[[], object]:
    def call() -> object:
        scene = ac.System()
        scene.world, scene.contact, scene.wheel = World(), contact, what
        scene.connect(scene.world.frame, scene.contact.frame_b)
        scene.connect(scene.contact.frame_a, scene.wheel.frame)
        return ac.build(scene)

    return call


def hidden_formula() -> Any:
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    root, y = ca.rootfinder("root", "newton", {"x": x, "p": p, "g": x**3 + x - p}), ca.MX.sym("y")
    return ca.Function("torque", [y], [root(0, y)])


CASES = [
    Wrong("closure that gives a number", constraint(lambda self, X, t: 0), MODEL, ("own (", HERE, "Own.closure(X_ab, t) gives 0", "ca.vertcat")),
    Wrong("closure that gives nothing", constraint(lambda self, X, t: None), MODEL, ("gives None",)),
    Wrong("closure that gives a list", constraint(lambda self, X, t: [symbolic(X.position)[2]]), MODEL, ("column",)),
    Wrong("closure that forgets the time", constraint(lambda self, X: symbolic(X.position)[2]), MODEL, (HERE, "closure(X_ab, t) fails", "2 positional")),
    Wrong("closure with a misspelt name", constraint(lambda self, X, t: X.positoin), MODEL, (f"fails at tests/bad_input/{HERE}", "positoin")),
    Wrong("closure by Python's max", constraint(lambda self, X, t: max(X.position[2], X.position[1])), MODEL, (f"fails at tests/bad_input/{HERE}", "truth value", "ca.fmax")),
    Wrong("closure with a misspelt attribute", constraint(lambda self, X, t: X.position[2] - self.radius), MODEL, (f"fails at tests/bad_input/{HERE}", "has no 'radius'")),
    Wrong("closure that is a square where it begins", on_rail(lambda self, X, t: X.position[2] - ca.sumsqr(X.position[:2])), errors.LockedError, ("'own'", "locked")),
    Wrong("closure that forbids nothing", constraint(lambda self, X, t: ca.vertcat(symbolic(X.position)[2], 1)), MODEL, ("row 1", "forbids nothing")),
    Wrong("closure with a matrix", constraint(lambda self, X, t: symbolic(X.rotation)), MODEL, ("(3, 3)", "column")),
    Wrong("closure with a lost parameter", constraint(lambda self, X, t: symbolic(X.position)[2] - ac.Parameter(0.1, "m").sx), MODEL, ("own (", "closure")),
    Wrong("closure with another joint's angle", constraint(lambda self, X, t: symbolic(X.position)[2] - Revolute().q.sx), MODEL, ("own (", "closure")),
    Wrong("closure without values", constraint(lambda self, X, t: ca.log(-1 - ca.sumsqr(symbolic(X.position)))), errors.AssemblyError, ("'own'", "Own", "no finite number", "position=")),
    Wrong("slip quadratic in velocities", constraint(closure_rates=lambda self, X, w, v, t: v[0] ** 2), MODEL, ("closure_rates", "not linear")),
    Wrong("slip that forgets the time", constraint(closure_rates=lambda self, X, w, v: v[0]), MODEL, ("closure_rates", "fails")),
    Wrong("branch by a vector", constraint(closure_sign=lambda self, X: symbolic(X.position)), MODEL, ("closure_sign", "(3, 1)")),
    Wrong("pose that forgets the time", joint(pose=lambda self, q: Pose(rotation_about_z(q), np.zeros(3))), MODEL, ("Own.pose(q, t) fails", "2 positional")),
    Wrong("pose with a hidden parameter", joint(pose=lambda self, q, t: Pose(rotation_about_z(q * ac.Parameter(2.0).sx), np.zeros(3))), MODEL, ("pose(q, t)",)),
    Wrong("pose of an expression", joint(pose=lambda self, q, t: Pose(rotation_about_z(q), ac.Parameter(1.0) * np.ones(3))), MODEL, ("position", ".sx")),
    Wrong("pose without a slope", joint(pose=lambda self, q, t: Pose(rotation_about_z(ca.sqrt(q * q + q**4)), np.zeros(3))), MODEL, ("no two derivatives", "[0.0]", "start=")),
    Wrong("rates quadratic in velocities", joint(rates=lambda self, q, v, t: v**2), MODEL, ("rates(q, v, t)", "not linear")),
    Wrong("invariant that is a number", joint(invariants=lambda self, q, t: 0), MODEL, ("invariants(q, t) gives 0",)),
    Wrong("coordinates of another size", joint(coordinates=lambda self, X: ca.SX.zeros(2)), MODEL, ("coordinates(X_ab)", "column of 1")),
    Wrong("one action without a tuple", force(lambda self, at: attraction(self, at)[0]), MODEL, ("Own.actions(placement)", "comma")),
    Wrong("no actions", force(lambda self, at: None), MODEL, ("gives None", "return (Action")),
    Wrong("actions without the placement", force(lambda self: ()), MODEL, ("actions(placement) fails",)),
    Wrong("action with one number", force(lambda self, at: (Action(self.point, ca.SX(1), NONE),)), MODEL, ("the force is SX(1)", HERE, "ca.vertcat")),
    Wrong("action on another part", force(lambda self, at: (Action(RigidBody.ball(1, 1).frame, NONE, NONE),)), MODEL, ("own (", "no connector of its own")),
    Wrong("force with a wrong potential", force(potential_energy=lambda self, at: 3 * ca.sumsqr(place(self, at))), MODEL, ("own (", HERE, "contradict", "-3.466 W", "6.932 W")),
    Wrong("force with a forgotten potential", force(potential_energy=lambda self, at: ca.SX(0)), MODEL, ("contradict", "0 W", "minus the slope")),
    Wrong("power that is not lost", force(power_loss=lambda self, at: ca.SX(1)), MODEL, ("contradict", "loses 1 W")),
    Wrong("energy that is a vector", force(potential_energy=lambda self, at: NONE), MODEL, ("potential_energy(placement)", "one number")),
    Wrong("tension against its potential", line_force(lambda self, s, r: 3 * s, lambda self, s: 3 * s**2), MODEL, ("own (", "tension and potential", "contradict")),
    Wrong("tension without the rate", line_force(lambda self, s: 3 * s, lambda self, s: 1.5 * s**2), MODEL, ("tension(length, rate) fails",)),
    Wrong("body without inertia", body(None), MODEL, ("inertia() gives None", "Inertia.zero()")),
    Wrong("body of negative mass", body(Inertia(-1.0, np.zeros(3), np.eye(3))), PARAMETER, ("own (", "-1.0 kg")),
    Wrong("body of no number", body(Inertia(1.0, np.zeros(3), np.full((3, 3), np.nan))), PARAMETER, ("own (", "finite")),
    Wrong("body whose frame is nowhere", body(Inertia(1.0, np.zeros(3), np.eye(3)), lambda self: ()), MODEL, ("attachments()", "frame")),
    Wrong("one attachment without a tuple", body(Inertia.zero(), lambda self: Attachment(self.frame, Pose.identity())), MODEL, ("attachments()", "tuple")),
    Wrong("force that follows the rate of a measured torque", pushed(lambda s: (ac.der(s.sensor.torque.value), 0, 0)), MODEL, ("push (", "sensor.torque.value", "accelerations", "Integrator")),
    Wrong("force that follows another scene", pushed(lambda s: (Pendulum().hinge.q, 0, 0)), UNKNOWN, ("push (", "'q' [rad]", "no part of the scene")),
    Wrong("force that follows a point elsewhere", pushed(lambda s: Pendulum().rod.tip.position), UNKNOWN, ("push (", "position", "Assign its part")),
    Wrong("force of an undeclared symbol", pushed(lambda s: (ca.SX.sym("a"), 0, 0)), MODEL, ("push (", "'a'", "declared nowhere", "ac.Parameter")),
    Wrong("thin rod on a ball joint", thin_rod((0, 0, -1), held=True), errors.MasslessError, ("'ball'", HERE, "rod", "thin", "radius=")),
    Wrong("thin rod on a ball joint, askew", thin_rod((1, 1, 1), held=True), errors.MasslessError, ("'ball'", "thin", "Universal")),
    Wrong("thin rod that flies", thin_rod((1, 0.3, 0), held=False), errors.MasslessError, ("rod", "thin", "radius=")),
    Wrong("disk connected the wrong way round", turned_round(RollingDisk(0.3), RigidBody.disk(1.0, 0.3, "y")), errors.IncompatibleError, ("contact (", HERE, "wrong way round", "Exchange")),
    Wrong("ball connected the wrong way round", turned_round(RollingBall(0.3), RigidBody.ball(1.0, 0.3)), errors.IncompatibleError, ("contact (", "frame_b is on the ground", "wheel")),
    Wrong("normal of a plane", lambda: PointOnPlane(normal="x"), PARAMETER, ("PointOnPlane(normal='x')", "no argument 'normal'", HERE, "frame_a")),
    Wrong("axis of a ball joint", lambda: Spherical(axis="z"), PARAMETER, ("axis='z'", "no axis")),
    Wrong("angle of a ground", lambda: RotationalGround(3), PARAMETER, ("given 3", HERE)),
    Wrong("parts given to a system", lambda: ac.System(World()), PARAMETER, ("System() takes no arguments", "by name")),
    Wrong("mass as a stiffness", lambda: Spring(ac.Parameter(1.0, "kg")), PARAMETER, ("stiffness", "in kg", HERE, "N/m")),
    Wrong("length as a mass", lambda: Particle(ac.Parameter(1.0, "mm")), PARAMETER, ("mass", "in mm", "kg")),
    Wrong("torque as a force", lambda: Force((0, ac.Input("N*m"), 0)), PARAMETER, ("Force", "N*m")),
    Wrong("array of four numbers as a rotation", lambda: Fixed((0, 0, 0), rotation=np.array([0, 0, 0.6, 0.8])), PARAMETER, ("first", "last", "Rotation.from_quat", HERE)),
    Wrong("joint at a point of a ball that is nowhere", lambda: Revolute.between(World(), RigidBody.ball(1.0, 0.1), at=(1, 0, 0)), PARAMETER, ("no place", "(1.0, 0.0, 0.0)", "position=", HERE)),
    Wrong("film", lambda: ac.build(Pendulum()).simulate(0.1).animate("film.mp4"), errors.OptionError, ("'film.mp4'", "'.mp4'", "page", "motion.html")),
    Wrong("picture as a page", lambda: ac.build(Pendulum()).simulate(0.1).picture("view.html"), errors.OptionError, ("'view.html'", "picture.png")),
    Wrong("root that CasADi searches", lambda: TorqueSource(hidden_formula()), PARAMETER, ("TorqueSource's torque", "hidden", "CubicSpline", HERE)),
    Wrong("root that CasADi searches in an expression", lambda: Force((2 * hidden_formula()(ac.time.sx), 0, 0)), PARAMETER, ("Force's value", "hidden")),
    Wrong("spline of scipy that is called", lambda: TorqueSource(lambda t: CubicSpline((0, 1, 2), (0, 1, 0))(t)), PARAMETER, ("itself, not called", HERE)),
    Wrong("interpolation of scipy without pieces", lambda: TorqueSource(KroghInterpolator((0, 1, 2), (0, 1, 0))), PARAMETER, ("KroghInterpolator", "CubicSpline", HERE)),
    Wrong("law of a lost symbol", lambda: ac.build(sprung(lambda s: ca.SX.sym("k") * s**2)), MODEL, ("spring (", "'k'", "declared nowhere")),
]  # fmt: skip


def sprung(potential: Callable[[ca.SX], Any]) -> ac.System:
    scene = ac.System()
    scene.world, scene.bob, scene.spring = World(), Particle(1.0), NonlinearSpring(potential)
    scene.connect(scene.world.frame, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.bob.point)
    return scene


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.title)
def test_message(case: Wrong):
    case.check()


def test_nothing_is_written_under_a_wrong_name(tmp_path: Path):
    run = ac.build(Pendulum()).simulate(0.1)
    with pytest.raises(errors.OptionError):
        run.animate(tmp_path / "film.gif")
    assert not list(tmp_path.iterdir())


def test_units_of_the_same_kind_and_words_are_no_mistake():
    """Scales are the user's own; a unit that nobody knows says nothing; what arithmetic makes of units is not known."""
    kg = ac.Parameter(2.0, "kg")
    for stiffness in (ac.Parameter(1.0, unit) for unit in ("N/m", "kN/mm", "kg/s^2", "kg*s**-2", "J/m^2", "", "lbf/in", "stiff")):
        Spring(stiffness)
    Spring(kg * 3.0)
    Particle(ac.Parameter(1.0, "g"), position=(1, 0, 0))


def test_a_particle_begins_where_its_sketch_is():
    class Cone(AbstractConstraint):
        """z = sqrt(x^2 + y^2), with a tip at the origin."""

        between_points = True

        def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
            x, y, z = ca.vertsplit(symbolic(X_ab.position))
            return z - ca.sqrt(x**2 + y**2)

    for position in ((0.3, 0.4, 0.5), None):
        scene = ac.System()
        scene.world, scene.cone, scene.bob = World(), Cone(), Particle(1.0, position=position)
        scene.connect(scene.world.frame, scene.cone.frame_a)
        scene.connect(scene.cone.frame_b, scene.bob.point)
        run = ac.build(scene).simulate(0.05, {} if position else {scene.bob.point.position: (0.3, 0.4, 0.5)})
        assert np.max(np.abs(run[scene.bob.point.position][0] - [0.3, 0.4, 0.5])) < 1e-12
        assert run.energy_error() < 1e-9


def test_a_wheel_may_lie_flat_in_the_sketch():
    """There the heading has no derivative; the search begins beside it, and the wheel starts as it is told."""
    scene = ac.System()
    scene.world, scene.contact, scene.free = World(), RollingDisk(0.3), Free()
    scene.disk = RigidBody.disk(1.0, 0.3, "y", rotation=("x", np.pi / 2))
    for one in (scene.contact, scene.free):
        scene.connect(scene.world.frame, one.frame_a)
        scene.connect(one.frame_b, scene.disk.frame)
    run = ac.build(scene).simulate(0.2, {scene.disk.frame.rotation: rotation_about(np.array([1.0, 0, 0]), 0.3)}, rtol=1e-10)
    assert abs(run[scene.disk.frame.position][0, 2] - 0.3 * np.cos(0.3)) < 1e-12
    assert run.energy_error() < 1e-9


def test_rotations_of_scipy_are_taken():
    turn = Rotation.from_euler("xyz", (0.1, -0.4, 0.3))
    matrices = [
        Fixed((0, 0, 0), rotation=r).attachments()[1].pose.rotation
        for r in (turn, turn.as_matrix(), turn.as_quat()[[3, 0, 1, 2]].tolist())
    ]
    for matrix in matrices:
        assert np.max(np.abs(matrix - turn.as_matrix())) < 1e-15


@pytest.mark.parametrize("z", [1.0, -1.0])
@pytest.mark.parametrize("aside", [0.0, 1e-9, 0.7])
def test_an_axis_of_parameters_may_point_anywhere(z: float, aside: float):
    """The same fall as with numbers, also where the axis is z, or next to -z."""
    given = ac.Parameter(z)
    swings = []
    for axis in ((aside, 0.0, given), (aside, 0.0, z)):
        scene = ac.System()
        scene.given = given
        scene.world, scene.hinge, scene.rod = World((0, -9.81, 0)), Revolute(axis), RigidBody.rod(1.0, (1, 0, 0), radius=0.1)
        scene.connect(scene.world.frame, scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.rod.frame)
        swings.append(ac.build(scene).simulate(1.0, rtol=1e-10)[scene.hinge.q])
    assert np.max(np.abs(swings[0] - swings[1])) < 1e-8
    assert np.ptp(swings[0]) > 1


def test_declared_symbols_survive_CasADi_s_functions_in_equations():
    class Tank(ac.Component):
        level = ac.Variable("m")

        def __init__(self) -> None:
            self.gain = ac.Parameter(2.0)

        def equations(self):
            yield ac.equal(ac.der(self.level), ca.if_else(self.level > 0.5, -self.gain, 0.0))

    scene = ac.System()
    scene.tank = Tank()
    run = ac.build(scene).simulate(0.2, {scene.tank.level: 1.0}, parameters={scene.tank.gain: 1.0})
    assert abs(run[scene.tank.level][-1] - 0.8) < 1e-12


def test_a_part_that_was_thrown_away_asks_nothing_of_parameters():
    """What parts in the scene ask counts, however they are made; what others once asked does not."""
    kept = (
        lambda p: Particle(p, position=(1, 0, 0)),
        lambda p: RigidBody.ball(1.0, p),
        lambda p: RigidBody(
            inertia=(1.0, 1.0, 1.0),
            mass=p,
        ),
    )
    for make in kept:
        p = ac.Parameter(1.0)
        Particle(p)
        RigidBody.ball(1.0, p)
        for part, refused in ((make(p), True), (Particle(2.0), False)):
            scene = ac.System()
            scene.p, scene.world, scene.part, scene.push = p, World(), part, Force((p, 0, 0))
            scene.connect(scene.push.point, part.connectors()[0])
            model = ac.build(scene)
            if refused:
                with pytest.raises(errors.ParameterError, match="must be positive"):
                    model.simulate(0.1, parameters={p: -1.0})
            else:
                assert model.simulate(0.1, parameters={p: -1.0})[part.connectors()[0].acceleration][-1, 0] == -0.5


def test_a_part_of_one_s_own_that_does_nothing_wrong_is_taken():
    class Idle(ac.Component):
        flange = ac.Rotational.port()

        def equations(self):
            yield ac.equal(self.flange.tau, 0.0)

    ac.build(pendulum_with(Idle()))
