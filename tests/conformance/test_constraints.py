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
from components import Force, Pulley, Revolute, RigidBody, World
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
