"""What must hold for every contact of the catalogue, also for those written later: as a joint of the tree and as a constraint alike."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, symbolic
from components import Force, RigidBody, World
from tests.conformance.test_joints import catalogue, composed, make, random_state


def contacts() -> list[type[AbstractJoint]]:
    return [cls for cls in catalogue() if cls.__module__.startswith("components.contacts")]


def test_contacts_are_found():
    assert len(contacts()) >= 5


@pytest.mark.parametrize("cls", contacts(), ids=lambda c: c.__name__)
def test_motion_in_the_tree_keeps_the_touch_and_does_not_slip(cls):
    """What the contact asks as a constraint holds along its motion as a joint: no gap opens, and nothing slips."""
    joint, rng = make(cls), np.random.default_rng(1)
    q, v, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("v", joint.v.size), ca.SX.sym("t")
    M = Pose(joint.mounting(), np.zeros(3))
    X = M.inverse() @ joint.pose(q, t) @ M
    _, twist = composed(joint, q, v, t)
    turned = symbolic(M.rotation).T
    gap = joint.closure(X, t)
    assert gap is not None
    opening = ca.jtimes(gap, q, joint.rates(q, v, t))
    slip = joint.closure_rates(X, turned @ twist[:3], turned @ twist[3:], t)
    f = ca.Function("f", [q, v, t], [ca.vertcat(gap, opening, slip)])
    for _ in range(5):
        assert np.max(np.abs(np.array(f(*random_state(joint, rng), 0.3)))) < 1e-14


@pytest.mark.parametrize("cls", contacts(), ids=lambda c: c.__name__)
@pytest.mark.parametrize("pushed", [False, True], ids=["free", "pushed"])
def test_force_of_the_contact_does_no_work(cls, pushed):
    """On a body with its centre elsewhere, at random states: the wrench at frame_b has no power, and energy changes by the push alone."""
    joint, rng = make(cls), np.random.default_rng(2)
    scene = ac.System()
    scene.world, scene.contact, scene.body = World(), joint, RigidBody(1.3, (0.02, 0.03, 0.025), (0.02, -0.01, 0.03))
    scene.connect(scene.world.frame, joint.frame_a)
    scene.connect(joint.frame_b, scene.body.frame)
    push = (3.0, -2.0, 1.0) if pushed else (0.0, 0.0, 0.0)
    scene.push = Force(push)
    scene.connect(scene.push.point, scene.body.at((0.1, 0.2, 0.3)))
    model = ac.build(scene)
    s, outputs = model.system, model.functions.outputs
    end = joint.frame_b
    wrench = [outputs.resolve(e) for e in (end.force, end.torque, end.velocity, end.angular_velocity)]
    work = ca.dot(wrench[0], wrench[2]) + ca.dot(wrench[1], wrench[3])
    energy = outputs.kinetic_energy + outputs.potential_energy
    f = ca.Function("f", [s.t, s.x], [work, ca.jtimes(energy, s.x, s.x_dot) + outputs.power_loss, ca.norm_2(wrench[0])])
    for _ in range(3):
        q, v = random_state(joint, rng)
        done, gap, size = (float(part) for part in f(0.0, np.concatenate([q, v])))
        assert abs(done) < 1e-12 * (1 + size)
        assert abs(gap) < 1e-11
        assert size > 1e-3


@pytest.mark.parametrize("cls", contacts(), ids=lambda c: c.__name__)
def test_contact_bears_the_weight_at_rest(cls):
    """The force through the contact is the weight, upwards, whatever rolls lies still on it: the body's centre is at the contact's."""
    joint = make(cls)
    scene = ac.System()
    scene.world, scene.contact, scene.body = World(), joint, RigidBody(1.3, (0.02, 0.03, 0.025))
    scene.connect(scene.world.frame, joint.frame_a)
    scene.connect(joint.frame_b, scene.body.frame)
    model = ac.build(scene)
    q = np.array(joint.start_q())
    force = np.array(
        model.functions.output(joint.frame_b.force)(0.0, np.concatenate([q, np.zeros(joint.v.size)]), [], [])
    ).ravel()
    assert np.max(np.abs(force - [0, 0, -1.3 * 9.81])) < 1e-12  # into the joint, that is downwards
