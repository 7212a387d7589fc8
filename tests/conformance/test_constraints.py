"""What must hold for every constraint without coordinates, also for those written later."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.loops.loops import loop_rows
from acausal.parts import weld
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, symbolic
from acausal.parts.pose_check import one_sided_rows
from components import CartesianTranslation, Force, Planar, Prismatic, Pulley, Revolute, RigidBody, World
from tests.conformance.catalogue import kinds, made

PULLEY = Pulley(World().frame, 0.05)
ARGUMENTS = {"length": 0.7, "pulley": PULLEY, "pulley_a": PULLEY, "pulley_b": PULLEY}
assert weld  # found among the subclasses


def catalogue() -> list[type[AbstractConstraint]]:
    return kinds(AbstractConstraint, other_than=AbstractJoint)


def scene_with(cls: type[AbstractConstraint]) -> ac.System:
    """A body on a hinge, and a free one that the constraint holds to it."""
    scene = ac.System()
    scene.world, scene.hinge, scene.held = World(), Revolute((1, 2, 0.5)), made(cls, ARGUMENTS)
    scene.one, scene.two = RigidBody(1.0, (0.1, 0.2, 0.25), (0.1, 0.2, 0.3)), RigidBody(1.5, (0.2, 0.2, 0.25), (0.1, -0.2, 0.3))
    scene.push = Force((1.0, 2.0, -0.5))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.one.frame)
    scene.connect(scene.one.at((0.3, 0.2, -0.5)), scene.held.frame_a)
    scene.connect(scene.held.frame_b, scene.two.frame)
    scene.connect(scene.two.centre, scene.push.point)
    return scene


@pytest.mark.parametrize("cls", catalogue(), ids=lambda c: c.__name__)
def test_rows_in_velocities_are_the_rates_of_those_in_positions(cls):
    s = ac.build(scene_with(cls)).system
    (rows,) = (loop_rows(edge, s.mechanics.placement) for edge in s.mechanics.mechanism.cuts)
    tree, count = s.mechanics.tree, rows.position.numel()
    gap = s.mechanics.kinematics.rate(rows.position) - rows.velocity[:count, :]
    f = ca.Function("f", [tree.q, tree.v, tree.t], [gap])
    rng = np.random.default_rng(1)
    q = rng.uniform(-1, 1, tree.q.numel())
    for item in tree.joints:
        if item.q.stop - item.q.start == 7:
            q[item.q.start : item.q.start + 4] /= np.linalg.norm(q[item.q.start : item.q.start + 4])
    assert np.max(np.abs(np.array(f(q, rng.uniform(-1, 1, tree.v.numel()), 0.3))), initial=0.0) < 1e-13


@pytest.mark.parametrize("cls", catalogue(), ids=lambda c: c.__name__)
def test_its_rows_pass_through_zero(cls):
    assert not one_sided_rows(made(cls, ARGUMENTS))


@pytest.mark.parametrize("cls", catalogue(), ids=lambda c: c.__name__)
def test_it_takes_its_rows_of_freedom_and_does_no_work(cls):
    scene = scene_with(cls)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 7 - len(model.system.constraints.kept)
    run = model.simulate(0.5, {scene.hinge.v: 1.3}, rtol=1e-11)
    assert run.energy_error() < 1e-10
    assert run.constraint_error() < 1e-12


@pytest.mark.parametrize("cls", catalogue(), ids=lambda c: c.__name__)
def test_its_reaction_moves_the_body_behind_it(cls):
    """Newton's and Euler's laws for the free body: what flows out of the constraint, the push and gravity make its acceleration."""
    scene = scene_with(cls)
    run = ac.build(scene).simulate(0.5, {scene.hinge.v: 1.3}, rtol=1e-11)
    force = -run[scene.held.frame_b.force] + [1.0, 2.0, -0.5] + 1.5 * np.array([0, 0, -9.81])
    assert np.max(np.abs(force - 1.5 * run[scene.two.centre.acceleration])) < 1e-9
    arm = run[scene.two.frame.position] - run[scene.two.centre.position]
    torque = -run[scene.held.frame_b.torque] + np.cross(arm, -run[scene.held.frame_b.force])
    R, w, w_dot = (run[getattr(scene.two.frame, n)] for n in ("rotation", "angular_velocity", "angular_acceleration"))
    inertia = R @ np.diag([0.2, 0.2, 0.25]) @ R.transpose(0, 2, 1)
    spin = (inertia @ w_dot[:, :, None])[:, :, 0] + np.cross(w, (inertia @ w[:, :, None])[:, :, 0])
    assert np.max(np.abs(torque - spin)) < 1e-9


HIDDEN = {
    "distance": lambda p, R, L: ca.norm_2(p) - L,
    "power of a square": lambda p, R, L: ca.sumsqr(p) ** 0.5 - L,
    "distance from a line": lambda p, R, L: ca.sqrt(p[0] ** 2 + p[1] ** 2) - L,
    "direction": lambda p, R, L: ca.atan2(p[1], p[0]) - 0.4,
    "angle": lambda p, R, L: ca.acos(R[2, 2]) - 0.3,
    "growing distance": lambda p, R, L: ca.norm_2(p) - L * (1 + 0.2 * ac.time.sx),
}


@pytest.mark.parametrize(
    ("law", "size"), [(law, (1e-3, 1.0, 1e4)[k % 3]) for k, law in enumerate(HIDDEN.values())], ids=HIDDEN.keys()
)
def test_rows_without_a_slope_in_the_sketch_are_held_all_the_same(law, size):
    """The body lies where the row has no derivative: at the origin, which all bodies without a place have in the sketch."""

    class Own(AbstractConstraint):
        def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
            return law(symbolic(X_ab.position), symbolic(X_ab.rotation), size)

    scene = ac.System()
    scene.world, scene.own, scene.body = (
        World((0, 0, -9.81 * size)),
        Own(),
        RigidBody.box(1.0, (0.1 * size, 0.2 * size, 0.3 * size)),
    )
    scene.connect(scene.world.frame, scene.own.frame_a)
    scene.connect(scene.own.frame_b, scene.body.frame)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 5
    body = scene.body.frame
    run = model.simulate(0.5, rtol=1e-9)
    row = law(body.position.sx, body.rotation.sx, size)
    assert np.max(np.abs(run[ac.Expression(row, frozenset((body.position, body.rotation, ac.time)))])) < 1e-9 * max(1.0, size)
    assert run.energy_error() < 1e-7


MOVING = {
    "lift": (lambda X, t: X.position[2] - ca.sin(3 * t), None),
    "rope that is paid out": (lambda X, t: ca.sumsqr(X.position) - (1 + 0.3 * t) ** 2, None),
    "tilting table": (lambda X, t: X.rotation[2, 0] - 0.9 * ca.sin(2 * t), None),
    "belt": (lambda X, t: ca.SX(0, 1), lambda X, w, v, t: (X.rotation @ v)[2] - ca.cos(t)),
}


@pytest.mark.parametrize(("closure", "rates"), MOVING.values(), ids=MOVING.keys())
def test_what_constraints_that_move_by_themselves_bring_in_is_known(closure, rates):
    class Own(AbstractConstraint):
        def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
            return closure(X_ab, t)

        def closure_rates(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> ca.SX:
            return ca.SX(0, 1) if rates is None else rates(X_ab, w_ab_b, v_ab_b, t)

    scene = ac.System()
    scene.world, scene.own, scene.body = (
        World((1.0, 0.5, -9.81)),
        Own(),
        RigidBody.box(1.3, (0.1, 0.2, 0.3), position=(0.3, 0, 1)),
    )
    scene.connect(scene.world.frame, scene.own.frame_a)
    scene.connect(scene.own.frame_b, scene.body.frame)
    run = ac.build(scene).simulate(0.7)  # warnings are errors
    assert run.energy_error() < 1e-8 and np.ptp(run.energy) > 1e-3


def upright(slips: bool) -> AbstractConstraint:
    """Asks with entries of the pose as they are given, of which joints may leave nothing but numbers: x of frame_b stays level, or its origin does not go along x."""

    class Own(AbstractConstraint):
        def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
            return ca.SX(0, 1) if slips else X_ab.rotation[2, 0]

        def closure_rates(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> ca.SX:
            return (X_ab.rotation @ v_ab_b)[:1] if slips else ca.SX(0, 1)

    return Own()


@pytest.mark.parametrize(
    ("joint", "level", "held"),
    [
        (CartesianTranslation, 3, 2),
        (lambda: Prismatic("y"), 1, 1),
        (lambda: Planar("z"), 3, 2),
        (lambda: Revolute("z"), 1, 1),
        (lambda: Revolute("y"), None, 1),
    ],
)
def test_methods_of_parts_are_given_symbols_where_joints_leave_numbers(joint, level: int | None, held: int):
    """Freedoms that are left, by hand."""
    for slips, expected in ((False, level), (True, held)):
        scene = ac.System()
        scene.world, scene.joint, scene.own, scene.body = (
            World(gravity=None),
            joint(),
            upright(slips),
            RigidBody(1.0, 0.1 * np.eye(3)),
        )
        scene.connect(scene.world.frame, scene.joint.frame_a, scene.own.frame_a)
        scene.connect(scene.joint.frame_b, scene.body.frame, scene.own.frame_b)
        if expected is not None:
            assert ac.build(scene).degrees_of_freedom == expected
