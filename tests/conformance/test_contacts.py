"""What must hold for every contact of the catalogue, also for those written later: as a joint of the tree and as a constraint alike."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.parts.contact import AbstractContact
from acausal.parts.force_check import FreePlacement
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, symbolic
from acausal.parts.turning import turning
from components import (
    Coulomb,
    Cylinder,
    Ellipsoid,
    Force,
    Hard,
    HardContact,
    HardPoint,
    HeightField,
    Plane,
    RigidBody,
    Sphere,
    Torus,
    World,
)  # fmt: skip
from components.contacts.hard_contact import AbstractHardContact
from components.orientation import rotation_about
from tests.conformance.catalogue import kinds, made
from tests.conformance.test_joints import ARGUMENTS, catalogue, composed, make, random_state


def contacts() -> list[type[AbstractJoint]]:
    return [cls for cls in catalogue() if issubclass(cls, AbstractContact)]


def on_planes() -> list[type[AbstractJoint]]:
    """Those that are constraints of the pose alone too."""
    return [cls for cls in contacts() if make(cls).closure(Pose(ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3)), ca.SX(0)) is not None]


def as_constraint(joint: AbstractJoint) -> tuple[ca.SX, ca.SX, ca.SX, Pose, Pose]:
    """Symbols q, v and t of the contact as a joint, its mounting, and the pose between its ends that its constraint is given."""
    q, v, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("v", joint.v.size), ca.SX.sym("t")
    M = Pose(joint.mounting(), np.zeros(3))
    return q, v, t, M, M.inverse() @ joint.pose(q, t) @ M


def test_contacts_are_found():
    assert len(contacts()) >= 5


@pytest.mark.parametrize("cls", on_planes(), ids=lambda c: c.__name__)
def test_motion_in_the_tree_keeps_the_touch_and_does_not_slip(cls):
    """What the contact asks as a constraint holds along its motion as a joint: no gap opens, and nothing slips."""
    joint, rng = make(cls), np.random.default_rng(1)
    q, v, t, M, X = as_constraint(joint)
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


@pytest.mark.parametrize("cls", on_planes(), ids=lambda c: c.__name__)
def test_rows_are_independent_and_their_wrenches_do_no_work(cls):
    """As a constraint: as many rows as velocities miss to six, none that follows from others, none with power in a motion of the contact."""
    joint, rng = make(cls), np.random.default_rng(3)
    q, v, t, M, X = as_constraint(joint)
    R, p = symbolic(X.rotation), symbolic(X.position)
    w, d = ca.SX.sym("w", 3), ca.SX.sym("d", 3)
    moved = joint.closure(Pose(R @ (ca.SX.eye(3) + ca.skew(w)), p + R @ d), t)
    assert moved is not None
    rows = ca.vertcat(moved, joint.closure_rates(X, w, d, t))
    basis = ca.substitute(ca.jacobian(rows, ca.vertcat(w, d)), ca.vertcat(w, d), ca.SX.zeros(6))
    turned = ca.diagcat(symbolic(M.rotation), symbolic(M.rotation)).T
    f = ca.Function("f", [q, v, t], [basis, turned @ ca.jacobian(composed(joint, q, v, t)[1], v)])
    for _ in range(5):
        wrenches, twists = (np.array(part) for part in f(*random_state(joint, rng), 0.3))
        assert wrenches.shape[0] == 6 - joint.v.size == np.linalg.matrix_rank(wrenches, 1e-3)
        assert np.max(np.abs(wrenches @ twists)) < 1e-14


def rates(cls, length: float = 1.0, place: Pose | None = None):
    """(q, v) -> x' of a body on the contact, all lengths `length` times as long, the whole scene at another `place` of the world."""
    place = place or Pose.identity()
    sizes: dict[str, object] = {name: length * np.array(ARGUMENTS[name]) for name in ("radius", "tube", "semi_axes")}
    sizes["surface"] = HeightField(lambda x, y: (0.2 * x * x - 0.1 * x * y) / length)
    joint = made(cls, sizes | {"shape": Ellipsoid(length * np.array((0.3, 0.2, 0.25)))})
    R, p = np.array(place.rotation), np.array(place.position)
    scene = ac.System()
    scene.world, scene.contact = World(R @ [0, 0, -9.81 * length]), joint
    scene.body = RigidBody(1.3, length**2 * np.array([0.02, 0.03, 0.025]), length * np.array([0.02, -0.01, 0.03]))
    scene.connect(scene.world.at(length * p, R), joint.frame_a)
    scene.connect(joint.frame_b, scene.body.frame)
    s = ac.build(scene).system
    return ca.Function("f", [s.t, s.x], [s.x_dot]), joint


@pytest.mark.parametrize("cls", contacts(), ids=lambda c: c.__name__)
def test_motion_does_not_know_where_in_the_world_it_is(cls):
    place = Pose(rotation_about(np.array([0.6, 0.0, 0.8]), 0.7), np.array([30.0, -4.0, 5.0]))
    (here, joint), (there, _) = rates(cls), rates(cls, place=place)
    rng = np.random.default_rng(4)
    for _ in range(3):
        x = np.concatenate(random_state(joint, rng))
        one, two = (np.array(f(0.0, x)).ravel() for f in (here, there))
        assert np.max(np.abs(one - two)) < 1e-11 * np.max(np.abs(one))


@pytest.mark.parametrize("length", [1e-3, 64.0])
@pytest.mark.parametrize("cls", contacts(), ids=lambda c: c.__name__)
def test_similar_contacts_move_alike(cls, length: float):
    """All lengths and gravity k times as large: angles and their rates as before, lengths and theirs k times."""
    (f, joint), (g, _) = rates(cls), rates(cls, length)
    q, v, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("v", joint.v.size), ca.SX.sym("t")
    spin = ca.jacobian(composed(joint, q, v, t)[1][:3], v)
    turns = np.concatenate([turning(joint), [not spin[:, k].is_zero() for k in range(joint.v.size)]])
    size = np.where(turns, 1.0, length)
    rng = np.random.default_rng(5)
    for _ in range(3):
        x = np.concatenate(random_state(joint, rng))
        one, two = np.array(f(0.0, x)).ravel(), np.array(g(0.0, size * x)).ravel()
        assert np.max(np.abs(two / size - one)) < 1e-11 * np.max(np.abs(one))


@pytest.mark.parametrize("cls", contacts(), ids=lambda c: c.__name__)
def test_what_is_read_of_a_contact_is_what_it_does(cls):
    """At random states: the force is along the normal and across it, the points are where the bodies are, nothing slips that does not slide."""
    joint, rng = make(cls), np.random.default_rng(6)
    assert isinstance(joint, AbstractContact)
    scene = ac.System()
    scene.world, scene.contact, scene.body = World(), joint, RigidBody(1.3, (0.02, 0.03, 0.025), (0.02, -0.01, 0.03))
    scene.connect(scene.world.at((0.1, 0.2, 0.3), ("x", 0.4)), joint.frame_a)
    scene.connect(joint.frame_b, scene.body.frame)
    model = ac.build(scene)
    read = model.functions.output(
        joint.point_a, joint.point_b, joint.normal, joint.force, joint.normal_force, joint.friction_force, joint.slip, joint.pivoting,
        scene.body.frame.angular_velocity, scene.body.frame.torque, scene.body.frame.position, scene.body.frame.force,
    )  # fmt: skip
    q, v = random_state(joint, rng)
    a, b, n, force, push, across, slip, pivot, w, torque, p, own = (
        np.array(x).ravel() for x in read(0.0, np.concatenate([q, v]), [], [])
    )
    assert np.max(np.abs(a - b)) < 1e-15 and abs(n @ n - 1) < 1e-15
    assert np.max(np.abs(force - push * n - across)) < 1e-13 and abs(n @ across) < 1e-13
    assert np.max(np.abs(force - own)) < 1e-12 and np.max(np.abs(np.cross(b - p, force) - torque)) < 1e-12
    assert abs(pivot - n @ w) < 1e-14
    assert np.max(np.abs(slip)) < 1e-14 if v.size == 3 else np.max(np.abs(across)) < 1e-12


def moving_freely(part: AbstractHardContact) -> tuple[FreePlacement, list[ca.SX], list[ca.SX]]:
    """A placement whose ends move freely; what the part reads of them, and what it reads there."""
    placement = FreePlacement()
    old: list[ca.SX] = []
    new: list[ca.SX] = []
    for end in part.connectors():
        X = placement.pose(end)
        R = symbolic(X.rotation)
        old += [end.position.sx, end.velocity.sx]
        new += [symbolic(X.position), R @ placement.velocity(end)]
        if isinstance(end, ac.Frame):
            old += [end.rotation.sx, end.angular_velocity.sx]
            new += [R, R @ placement.angular_velocity(end)]
    return placement, old, new


HARD = [
    HardContact(Sphere(0.3), Plane(), Hard(friction=Coulomb(0.3))), HardContact(Ellipsoid((0.3, 0.2, 0.25)), Plane(), Hard(friction=Coulomb(0.3))),
    HardContact(Sphere(0.3), Sphere(0.5), Hard(friction=Coulomb(0.3))), HardContact(Sphere(0.3), Torus(0.5, 0.1), Hard(friction=Coulomb(0.3))),
    HardPoint(Plane(), Hard(friction=Coulomb(0.3))), HardPoint(Cylinder(0.3), Hard(friction=Coulomb(0.3))),
]  # fmt: skip


def test_all_hard_contacts_are_held_to_this():
    assert {type(part) for part in HARD} == set(kinds(AbstractHardContact))


@pytest.mark.parametrize(
    "part", HARD, ids=lambda part: f"{type(part).__name__}-{type(getattr(part, 'surface', None) or part.place).__name__}"
)
def test_power_of_a_hard_contact_is_what_its_reactions_do_along_their_rows(part: AbstractHardContact):
    """Between bodies that move freely, near or far: pushes by the rate of the gap, friction by the slip; and what acts on one end acts back on the other."""
    placement, old, new = moving_freely(part)
    one, two = part.laws()
    assert isinstance(one, ac.OneSided) and isinstance(two, ac.DryFriction)
    gap, slip = (ca.substitute([law.sx], old, new)[0] for law in (one.gap, two.slip))
    rows = part.push.sx * placement.rate(gap) + ca.dot(ca.vertcat(*(drag.sx for drag in two.reactions)), slip)
    total, moment = ca.SX.zeros(3), ca.SX.zeros(3)
    for action in part.actions(placement):
        X = placement.pose(action.connector)
        push = symbolic(X.rotation) @ action.force
        total += push
        moment += ca.cross(symbolic(X.position), push) + symbolic(X.rotation) @ action.torque
    r = ca.vertcat(part.push.sx, *(drag.sx for drag in two.reactions))
    power = placement.power(part.actions(placement))
    f = ca.Function("f", [placement.y, placement.y_dot, r], [power - rows, total, moment, power + part.power_loss(placement)])
    rng = np.random.default_rng(3)
    for _ in range(3):
        for left in f(rng.uniform(0.2, 1.0, placement.y.numel()), rng.normal(size=placement.y.numel()), rng.normal(size=3)):
            assert np.max(np.abs(np.array(left))) < 1e-13
