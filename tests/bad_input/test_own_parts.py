"""Components and joints of one's own, written wrongly; arithmetic with symbols that has no meaning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal import errors
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose
from components import RigidBody, World
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
