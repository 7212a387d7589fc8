"""Components and joints of one's own, written wrongly; arithmetic with symbols that has no meaning."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal import errors
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.field import AbstractField
from acausal.parts.inertia import Inertia
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose
from acausal.parts.potential import AbstractPotential
from acausal.parts.rigid import AbstractRigidPart, Attachment
from components import HeightField, Particle, PotentialField, Prismatic, RigidBody, World
from tests.bad_input.messages import Wrong
from tests.scenes import Pendulum

HERE = "test_own_parts.py:"


def with_equations(write: Callable[[Any], Any], size: int = 1) -> Callable[[], object]:
    """Builds a scene with one part, a variable `level`, and these equations."""

    class Tank(ac.Component):
        level = ac.Variable("m", size=size)

        def __init__(self) -> None:
            self.rate = ac.Input("m/s")

        def equations(self) -> Any:
            return write(self)

    def call() -> object:
        scene = ac.System()
        scene.tank = Tank()
        return ac.build(scene)

    return call


def with_energy(method: str, given: object) -> Callable[[], object]:
    """Builds a scene with one part that says this of its energy."""

    def equations(self: Any) -> Any:
        yield ac.equal(ac.der(self.level), 1.0)

    members = {"level": ac.Variable("m"), "equations": equations, method: lambda self: given, "__module__": __name__}

    def call() -> object:
        scene = ac.System()
        scene.tank = type("Tank", (ac.Component,), members)()
        return ac.build(scene)

    return call


class VariableInInit(ac.Component):
    def __init__(self) -> None:
        self.level = ac.Variable("m")


class ConnectorInInit(ac.Component):
    def __init__(self) -> None:
        self.flange = ac.Rotational.port()


class VariableWithoutBrackets(ac.Component):
    level = ac.Variable

    def equations(self) -> Any:
        yield ac.equal(ac.der(self.level), 1.0)


def variable_without_brackets() -> None:
    scene = ac.System()
    scene.tank = VariableWithoutBrackets()
    ac.build(scene)


def joint(pose: Callable[[ca.SX], Any], nq: int = 1, nv: int = 1, *, declare: bool = True) -> Callable[[], object]:
    """Builds a ball on a joint with this pose."""

    class Own(AbstractJoint):
        if declare:
            q = ac.Variable("rad", size=nq)
            v = ac.Variable("rad/s", size=nv)

        def pose(self, q: ca.SX, t: ca.SX) -> Any:
            return pose(q)

    def call() -> object:
        scene = ac.System()
        scene.world, scene.own, scene.ball = World(), Own(), RigidBody.ball(1.0, 0.1)
        scene.connect(scene.world.frame, scene.own.frame_a)
        scene.connect(scene.own.frame_b, scene.ball.frame)
        return ac.build(scene)

    return call


def joint_with(**methods: Callable[..., Any]) -> Callable[[], object]:
    """Builds a slide along x with some of its methods replaced, as one of the hands that hold a body on another slide."""
    slide = {"pose": lambda self, q, t: Pose(np.eye(3), ca.vertcat(q, 0, 0))}
    Own = type("Own", (AbstractJoint,), {"q": ac.Variable("m"), "v": ac.Variable("m/s"), **slide, **methods})

    def call() -> object:
        scene = ac.System()
        scene.world, scene.own, scene.slide, scene.ball = World(), Own(), Prismatic("x"), RigidBody.ball(1.0, 0.1)
        for one in (scene.own, scene.slide):
            scene.connect(scene.world.frame, one.frame_a)
            scene.connect(one.frame_b, scene.ball.frame)
        return ac.build(scene)

    return call


def part_between(base: type[Any], **methods: Callable[..., Any]) -> Callable[[], object]:
    """Builds a ball that a part with these methods connects to the ground."""
    Own = type("Own", (base,), methods)

    def call() -> object:
        scene = ac.System()
        scene.world, scene.own, scene.ball = World(), Own(), RigidBody.ball(1.0, 0.1, position=(0.3, 0, 0))
        ends = [end for end in scene.own.connectors() if end.name != "frame"]
        for end, other in zip(ends, (scene.world.frame, scene.ball.frame), strict=False):
            scene.connect(end, other)
        return ac.build(scene)

    return call


def row_on_a_particle(closure: Callable[[Pose], Any]) -> Callable[[], object]:
    """Builds a particle that a constraint connects to the ground."""
    Own = type("Own", (AbstractConstraint,), {"closure": lambda self, X, t: closure(X), "between_points": True})

    def call() -> object:
        scene = ac.System()
        scene.world, scene.own, scene.bob = World(), Own(), Particle(1.0, position=(0.3, 0, 0))
        scene.connect(scene.world.frame, scene.own.frame_a)
        scene.connect(scene.own.frame_b, scene.bob.point)
        return ac.build(scene)

    return call


def row(closure: Callable[[Pose], Any]) -> Callable[[], object]:
    return part_between(AbstractConstraint, closure=lambda self, X, t: closure(X))


def potential(law: Callable[[Pose], Any], **methods: Callable[..., Any]) -> Callable[[], object]:
    return part_between(AbstractPotential, potential=lambda self, X, t: law(X), **methods)


def body(mass: float, moment: Any, second: Any, sketch: Any = None) -> Callable[[], object]:
    methods: dict[str, Any] = {
        "frame": ac.Frame.port(), "inertia": lambda self: Inertia(mass, moment, second), "sketch_pose": lambda self: sketch,
        "attachments": lambda self: (Attachment(self.frame, Pose.identity()),),
    }  # fmt: skip
    Own = type("Own", (AbstractRigidPart,), methods)

    def call() -> object:
        scene = ac.System()
        scene.world, scene.own = World(), Own()
        return ac.build(scene)

    return call


def foreign_variable(other: ac.Expression) -> Callable[[], object]:
    return with_equations(lambda s: [ac.equal(ac.der(s.level), other)])


EYE, ZERO = np.eye(3), np.zeros(3)

CASES = [
    Wrong("== in place of equal", with_equations(lambda s: [s.level == 1.0]), errors.ModelError, ("Equation 1 of tank", HERE, "'==' compares", "yield ac.equal")),
    Wrong("expression in place of an equation", with_equations(lambda s: [s.level + 1]), errors.ModelError, ("Equation 1 of tank", "yield ac.equal")),
    Wrong("return in place of yield", with_equations(lambda s: ac.equal(s.level, 1.0)), errors.ModelError, ("equations() of tank", "yield ac.equal")),
    Wrong("yield forgotten", with_equations(lambda s: None), errors.ModelError, ("gives None", "yield ac.equal")),
    Wrong("sides of different shapes", with_equations(lambda s: [ac.equal(ac.der(s.level), (1.0, 2.0))], 3), errors.ExpressionError, ("(3, 1)", "(2, 1)", HERE)),
    Wrong("text in an equation", with_equations(lambda s: [ac.equal(s.level, "full")]), errors.ExpressionError, ("'full'", HERE)),
    Wrong("derivative of a number", with_equations(lambda s: [ac.equal(ac.der(1.0), s.level)]), errors.ExpressionError, ("der(...)", "1.0", HERE)),
    Wrong("derivative of an input", with_equations(lambda s: [ac.equal(ac.der(s.rate), s.level)]), errors.ExpressionError, ("tank.rate", "second input")),
    Wrong("variable without brackets", variable_without_brackets, errors.ExpressionError, ("der(...)", "brackets", "ac.Variable(...)")),
    Wrong("variable made in __init__", VariableInInit, errors.ModelError, ("'level'", HERE, "body of the class", "ac.Variable(...)")),
    Wrong("connector made in __init__", ConnectorInInit, errors.ModelError, ("'flange'", HERE, "ac.Rotational.port()")),
    Wrong("equations that contradict", with_equations(lambda s: [ac.equal(s.level, 1.0), ac.equal(s.level, 2.0)]), errors.OverdeterminedError, ("equation 2 of tank", HERE, "0 = -1", "tank.level")),
    Wrong("equation without variables", with_equations(lambda s: [ac.equal(ac.der(s.level), 1.0), ac.equal(1.0, 2.0)]), errors.OverdeterminedError, ("equation 2 of tank' (", "contradicts", "0 = -1")),
    Wrong("no equation for a variable", with_equations(lambda s: []), errors.ModelError, ()),
    Wrong("variable of another scene", foreign_variable(Pendulum().hinge.q), errors.UnknownVariableError, ("equation 1 of tank", "'q' [rad]", "no part of the scene")),
    Wrong("joint without q", joint(lambda q: Pose(EYE, ZERO), declare=False), errors.ModelError, ("own", HERE, "configuration", "ac.Variable")),
    Wrong("joint whose pose is a matrix", joint(lambda q: EYE), errors.ModelError, ("Own.pose", "Return Pose(rotation, position)")),
    Wrong("joint that cannot move", joint(lambda q: Pose(EYE, ZERO)), errors.ModelError, ("does not depend on q",)),
    Wrong("joint with more q than v", joint(lambda q: Pose(EYE, q), 3, 2), errors.ModelError, ("3 configuration", "v has 2")),
    Wrong("joint with a matrix that is no rotation", joint(lambda q: Pose(2 * ca.SX.eye(3), ca.vertcat(q, 0, 0))), errors.ModelError, ("no rotation", "rotation_about_z")),
    Wrong("joint whose closure is that of another", joint_with(closure=lambda s, X, t: ca.vertcat(X.position[0], X.position[2], X.rotation[0, 1], X.rotation[0, 2], X.rotation[1, 2])), errors.ModelError, ("closure(X_ab, t)", "does not vanish", HERE)),
    Wrong("joint whose closure forbids too little", joint_with(closure=lambda s, X, t: ca.vertcat(X.position[1], X.position[2])), errors.ModelError, ("forbid 2 motions", "5 to forbid", HERE)),
    Wrong("joint whose coordinates are not those of the pose", joint_with(coordinates=lambda s, X: 2 * X.position[0]), errors.ModelError, ("coordinates(X_ab)", "inverse of `pose`", HERE)),
    Wrong("joint whose rates are zero", joint_with(rates=lambda s, q, v, t: 0 * v), errors.ModelError, ("0 ways with the 1 velocities", HERE)),
    Wrong("joint with velocities that move the same", joint(lambda q: Pose(EYE, ca.vertcat(q[0] + q[1], 0, 0)), 2, 2), errors.ModelError, ("1 ways with the 2 velocities", HERE)),
    Wrong("joint with invariants that are none", joint_with(invariants=lambda s, q, t: q - 1), errors.ModelError, ("do not stay zero along", HERE)),
    Wrong("joint with an invariant that is a number", joint_with(invariants=lambda s, q, t: ca.SX(1)), errors.ModelError, ("row 0 that does not depend on q", HERE)),
    Wrong("joint with motions of another", joint_with(motions=lambda s, q, v, t: Prismatic("y").motions(q, v, t)), errors.ModelError, ("another pose, or twist", HERE)),
    Wrong("joint without motions", joint_with(motions=lambda s, q, v, t: ()), errors.ModelError, ("motions(q, v, t)", "0 velocities", HERE)),
    Wrong("joint with a number for turns", joint_with(turns=lambda s: 3), errors.ModelError, ("turns()", "tuple of 1", HERE)),
    Wrong("joint with too many turns", joint_with(turns=lambda s: (True, True)), errors.ModelError, ("turns()", "tuple of 1", HERE)),
    Wrong("joint with a number for its start", joint_with(start_q=lambda s: 3), errors.ModelError, ("start_q()", "1 finite", HERE)),
    Wrong("joint with too many starts", joint_with(start_q=lambda s: (1.0, 2.0)), errors.ModelError, ("start_q()", "1 finite", HERE)),
    Wrong("joint with no number for its start", joint_with(start_q=lambda s: (float("nan"),)), errors.ModelError, ("start_q()", "1 finite", HERE)),
    Wrong("joint mounted by what is no rotation", joint_with(mounting=lambda s: np.ones((3, 3))), errors.ModelError, ("mounting()", "no rotation", HERE)),
    Wrong("joint whose pose is an array of objects", joint(lambda q: Pose(EYE, np.array([q, 0, 0], dtype=object))), errors.ModelError, ("pose(q, t)", "as position", HERE)),
    Wrong("row that is a square", row(lambda X: X.position[2] ** 2), errors.ModelError, ("row 0 that does not pass through zero", HERE)),
    Wrong("row that is a distance", row(lambda X: ca.norm_2(X.position)), errors.ModelError, ("row 0 that does not pass through zero", HERE)),
    Wrong("row that is an absolute value", row(lambda X: ca.vertcat(X.position[1], ca.fabs(X.position[2] - 0.3))), errors.ModelError, ("row 1 that does not pass through zero", HERE)),
    Wrong("row that is a cube", row(lambda X: X.position[2] ** 3), errors.ModelError, ("row 0 that does not pass through zero", HERE)),
    Wrong("row of one side", row(lambda X: ca.fmax(X.position[2], 0)), errors.ModelError, ("row 0 that does not pass through zero", HERE)),
    Wrong("row that is a truth", row(lambda X: X.position[2] > 0), errors.ModelError, ("row 0 that does not pass through zero", HERE)),
    Wrong("potential that is nothing", potential(lambda X: None), errors.ModelError, ("potential(X_ab, t) gives None", HERE)),
    Wrong("potential that is a vector", potential(lambda X: X.position), errors.ModelError, ("potential(X_ab, t)", "one number", HERE)),
    Wrong("potential of a symbol of one's own", potential(lambda X: ca.SX.sym("k") * ca.sumsqr(X.position)), errors.ModelError, ("symbol 'k'", "declared nowhere", HERE)),
    Wrong("damping that is one column", potential(lambda X: ca.sumsqr(X.position), damping=lambda s, X, w, v, t: -v), errors.ModelError, ("damping(X_ab, w_ab_b, v_ab_b, t)", "torque and the force", HERE)),
    Wrong("field of a parameter of nobody", part_between(AbstractField, potential=lambda s, p, t: ac.Parameter(3.0) * ac.Expression(p[2], frozenset())), errors.ModelError, ("potential(p, t)", "belongs to no part", HERE)),
    Wrong("body whose moments no mass has", body(1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0])), errors.ParameterError, ("no distribution of mass", HERE)),
    Wrong("body whose moments are about another point", body(2.0, np.array([5.0, 0, 0]), np.eye(3)), errors.ParameterError, ("no distribution of mass", HERE)),
    Wrong("store of two numbers", with_energy("stored_energy", (1.0, 2.0)), errors.ModelError, ("tank", "Tank.stored_energy() gives (1.0, 2.0)", "one number", HERE)),
    Wrong("loss that is text", with_energy("dissipated_power", "much"), errors.ModelError, ("Tank.dissipated_power() gives 'much'", HERE)),
    Wrong("supply that is nothing", with_energy("supplied_power", None), errors.ModelError, ("Tank.supplied_power() gives None", HERE)),
    Wrong("equation of no number", with_equations(lambda s: [ac.equal(ac.der(s.level), float("nan") * s.level)]), errors.ParameterError, ("nan", "module math", HERE)),
    Wrong("row that reads a particle's rotation", row_on_a_particle(lambda X: ca.vertcat(X.position[2], X.rotation[0, 1] - 0.1)), errors.ModelError, ("'own'", "row 1 of Own.closure(X_ab, t) follows X_ab.rotation", "no orientation", HERE)),
    Wrong("row by a function of math", row(lambda X: X.position[2] - math.sin(X.position[0])), errors.ParameterError, ("closure(X_ab, t)", "nan", "module math", HERE)),
    Wrong("potential by a function of math", potential(lambda X: ca.sumsqr(X.position) + math.cosh(X.position[0])), errors.ParameterError, ("potential(X_ab, t)", "nan", HERE)),
    Wrong("surface by a function of math", lambda: HeightField(lambda x, y: x + math.sin(y)), errors.ParameterError, ("HeightField", "no number before", "numpy or CasADi in place of those of math", HERE)),
    Wrong("field by a function of math", lambda: PotentialField(lambda p, t: math.sqrt(p[0])), errors.ParameterError, ("PotentialField's potential", "no number before", HERE)),
    Wrong("field by Python's if", lambda: PotentialField(lambda p, t: 1.0 if p[0] > 0 else 2.0), errors.ParameterError, ("PotentialField's potential", "true nor false", "ca.if_else", HERE)),
    Wrong("chart by Python's if", lambda: ac.curvilinear.chart(lambda p: (p[0], p[1], 1.0 if p[2] > 0 else 2.0), Pendulum().rod.tip.position), errors.ParameterError, ("The chart", "true nor false", "ca.if_else", HERE)),
    Wrong("surface by an attribute that is not there", lambda: HeightField(lambda x, y: x.real), errors.ParameterError, ("HeightField", "real", HERE)),
    Wrong("constraint that says nothing", part_between(AbstractConstraint), errors.ModelError, ("Own does not say its closure()", HERE)),
    Wrong("body with moments of two entries", body(1.0, np.zeros(2), np.eye(3)), errors.ModelError, ("first moment", "(3,)", HERE)),
    Wrong("body with a number for its sketch", body(1.0, np.zeros(3), np.eye(3), 3), errors.ModelError, ("sketch_pose()", HERE)),
    Wrong("vectors of different lengths", lambda: Pendulum().rod.tip.position + np.ones(2), errors.ExpressionError, ("(3, 1) and (2, 1)", HERE)),
    Wrong("text added to a variable", lambda: Pendulum().hinge.q + "1", errors.ExpressionError, ("'1'", HERE)),
    Wrong("entry that is not there", lambda: Pendulum().rod.tip.position[3], errors.ExpressionError, ("[3]", "(3, 1)", HERE)),
    Wrong("entry by name", lambda: Pendulum().rod.tip.position["z"], errors.ExpressionError, ("['z']", "counted from 0")),
    Wrong("variable as a truth", lambda: 1 if Pendulum().hinge.q > 0 else 2, errors.ExpressionError, ("true nor false", "ca.if_else", HERE)),
    Wrong("variable as a number", lambda: float(Pendulum().hinge.q), errors.ExpressionError, ("no number before", "run[...]", HERE)),
    Wrong("numpy's singular values of symbols", lambda: np.linalg.svd(Pendulum().rod.tip.rotation), errors.ExpressionError, ("ac.norm", HERE)),
    Wrong("numpy's function that is not there", lambda: np.nextafter(Pendulum().hinge.q, 0.5), errors.ExpressionError, ("nextafter", HERE)),
    Wrong("condition as an event", lambda: ac.when(Pendulum().hinge.q > 1.0), errors.OptionError, ("condition", "a - b", "rising")),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.title)
def test_message(case: Wrong):
    case.check()


def test_a_vector_can_be_taken_apart():
    x, y, z = Pendulum().rod.tip.position
    assert [str(e.sx) for e in (x, y, z)] == ["position_0", "position_1", "position_2"]


@pytest.mark.parametrize(("flanges", "size"), [(2, 1), (1, 2)])
def test_a_joint_with_flanges_that_nothing_tells_apart_is_refused(flanges: int, size: int):
    def pose(self: Any, q: ca.SX, t: ca.SX) -> Pose:
        return Pose(np.eye(3), ca.vertcat(q, ca.SX.zeros(3 - size)))

    ends = {f"end_{k}": ac.Translational.port() for k in range(flanges)}
    members = {"q": ac.Variable("m", size=size), "v": ac.Variable("m/s", size=size), "pose": pose, "__module__": __name__, **ends}
    scene = ac.System()
    scene.world, scene.slide, scene.ball = World(), type("Slide", (AbstractJoint,), members)(), RigidBody.ball(1.0, 0.1)
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.ball.frame)
    Wrong("flanges of a joint", lambda: ac.build(scene), errors.ModelError, ("slide (", HERE, "end_0", "one coordinate")).check()


@pytest.mark.parametrize(
    ("make", "given"),
    [(ac.Discrete, (0.0,)), (ac.Input, (3.0,)), (ac.Parameter, (1.0, 2.0)), (ac.Reaction, (None,)), (ac.Input, ("m", 1.0))],
)
def test_a_number_in_place_of_a_unit_is_refused_where_it_is_said(make: Callable[..., object], given: tuple[Any, ...]) -> None:
    with pytest.raises(
        ac.errors.ExpressionError, match=r"(unit|description) of .* is .* \(.*test_own_parts.py:\d+\)\. Give a text"
    ):
        make(*given)
