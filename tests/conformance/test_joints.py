"""What must hold for every joint of the catalogue, also for those written later."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.dynamics.system import mechanical_system
from acausal.language.expression import time
from acausal.language.flatten import flatten
from acausal.outputs.outputs import Outputs
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.joint import AbstractJoint
from acausal.parts.motion import motion_from_pose, reversed_motion
from acausal.parts.pose import Pose, symbolic, vee
from acausal.parts.pose_check import LookedJoint
from acausal.reduce.reduce import reduce_system
from acausal.topology.build_mechanism import build_mechanism
from acausal.topology.mechanism import TreeEdge
from components import Free, Revolute, RigidBody, Section, ShapeIntegrals, World
from components.geometry.curves import Helix
from components.geometry.shapes import Ellipsoid
from components.geometry.surfaces import HeightField
from tests.conformance.catalogue import kinds, made

SHAPES = np.random.default_rng(0).normal(size=(8, 3, 2))
ARGUMENTS = {
    "radius": 0.3, "half_angle": 0.4, "tube": 0.05, "semi_axes": (0.3, 0.2, 0.1), "length": 0.5, "section": Section.circle(0.1), "youngs_modulus": 1e4,
    "angular_velocity": (0.3, -0.2, 0.5), "density": 100.0, "mass": 2.0, "stiffness": np.eye(2), "curve": Helix(0.4, 0.1), "surface": HeightField(lambda x, y: 0.2 * x * x - 0.1 * x * y), "shape": Ellipsoid((0.3, 0.2, 0.25)),
    "integrals": ShapeIntegrals.of_masses(np.ones(8), SHAPES[:, :, 0] + 0.3, SHAPES),
}  # fmt: skip


def catalogue() -> list[type[AbstractJoint]]:
    return kinds(AbstractJoint)


def make(cls: type[AbstractJoint]) -> AbstractJoint:
    return made(cls, ARGUMENTS)


def is_rigid(cls: type[AbstractJoint]) -> bool:
    """An elastic body keeps its coordinates and has inertia, so that it cannot be cut."""
    return not issubclass(cls, AbstractElasticBody)


def has_closed_form(cls: type[AbstractJoint]) -> bool:
    """Whether its coordinates follow from a pose; a joint without keeps them where it closes a loop."""
    return make(cls).coordinates(Pose(ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3))) is not None


def random_state(joint: AbstractJoint, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    q = rng.uniform(-1, 1, joint.q.size)
    if joint.q.start is not None:  # a unit quaternion comes first
        q[:4] = np.array(joint.start_q())[:4] + 0.4 * rng.uniform(-1, 1, 4)
        q[:4] /= np.linalg.norm(q[:4])
    return q, rng.uniform(-1, 1, joint.v.size)


def composed(joint: AbstractJoint, q: ca.SX, v: ca.SX, t: ca.SX, back: bool = False) -> tuple[Pose, ca.SX]:
    """Pose and twist (in frame_b) of the joint's chain of motions."""
    X, w, vel = Pose.identity(), ca.SX.zeros(3), ca.SX.zeros(3)
    motions = joint.motions(q, v, t)
    if back:
        motions = tuple(reversed_motion(m) for m in reversed(motions))
    for motion in motions:
        M = Pose(motion.mounting, np.zeros(3))
        at_rest, spin = ca.SX.zeros(6), Pose(motion.spin, np.zeros(3))
        for pose, twist in ((M, at_rest), (motion.pose, motion.twist), (spin, at_rest), (M.inverse(), at_rest)):
            R, p = symbolic(pose.rotation), symbolic(pose.position)
            vel = R.T @ (vel + ca.cross(w, p)) + twist[3:]
            w = R.T @ w + twist[:3]
            X = X @ pose
    return X, ca.vertcat(w, vel)


@pytest.mark.parametrize("cls", catalogue(), ids=lambda c: c.__name__)
def test_its_methods_agree_as_they_must_for_joints_of_ones_own(cls):
    looked = LookedJoint.at_random(make(cls))
    assert looked.at and not list(looked.faults())


@pytest.mark.parametrize("cls", catalogue(), ids=lambda c: c.__name__)
def test_twist_is_the_rate_of_the_pose(cls):
    joint, rng = make(cls), np.random.default_rng(1)
    q, v, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("v", joint.v.size), ca.SX.sym("t")
    reference = motion_from_pose(joint.pose, joint.rates, q, v, t)
    X, twist = composed(joint, q, v, t)
    f = ca.Function(
        "f",
        [q, v, t],
        [reference.twist - twist, symbolic(X.rotation) - reference.pose.rotation, symbolic(X.position) - reference.pose.position],
    )
    for _ in range(5):
        for gap in f(*random_state(joint, rng), 0.3):
            assert np.max(np.abs(np.array(gap))) < 1e-13


@pytest.mark.parametrize("cls", catalogue(), ids=lambda c: c.__name__)
def test_twist_is_a_difference_of_poses(cls):
    """In numbers, without derivatives: poses a little later and a little earlier along q' = N v, to the order of the step squared."""
    joint, rng = make(cls), np.random.default_rng(7)
    q, v, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("v", joint.v.size), ca.SX.sym("t")
    X, (_, twist) = joint.pose(q, t), composed(joint, q, v, t)
    at = ca.Function("pose", [q, t], [symbolic(X.rotation), symbolic(X.position)])
    rates = ca.Function("rates", [q, v, t], [joint.rates(q, v, t)])
    found = ca.Function("twist", [q, v, t], [twist])
    q0, v0 = random_state(joint, rng)
    # along the straight line, off the unit quaternions by h^2 |q'|^2 / 2
    q_dot = np.array(rates(q0, v0, 0.3)).ravel()
    gaps = []
    for h in (1e-2, 1e-3):
        (R0, p0), (R1, p1) = (tuple(np.array(part) for part in at(q0 + s * h * q_dot, 0.3 + s * h)) for s in (-1, 1))
        R = np.array(at(q0, 0.3)[0])
        W = R.T @ (R1 - R0) / (2 * h)
        w = 0.5 * np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]])
        difference = np.concatenate([w, (R.T @ (p1 - p0) / (2 * h)).ravel()])
        gaps.append(np.max(np.abs(difference - np.array(found(q0, v0, 0.3)).ravel())))
    assert gaps[1] < 2e-2 * gaps[0] + 1e-11


@pytest.mark.parametrize("cls", catalogue(), ids=lambda c: c.__name__)
def test_reversed_motion_is_the_inverse_with_its_rate(cls):
    joint, rng = make(cls), np.random.default_rng(2)
    q, v, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("v", joint.v.size), ca.SX.sym("t")
    X, _ = composed(joint, q, v, t)
    Y, twist = composed(joint, q, v, t, back=True)
    R = symbolic(Y.rotation)
    rates = joint.rates(q, v, t)
    rate = lambda e: ca.reshape(ca.jtimes(ca.vec(e), q, rates), *e.shape)  # noqa: E731
    expected = ca.vertcat(vee(R.T @ rate(R)), R.T @ rate(symbolic(Y.position)))
    f = ca.Function("f", [q, v], [symbolic((X @ Y).rotation) - ca.SX.eye(3), symbolic((X @ Y).position), twist - expected])
    for gap in f(*random_state(joint, rng)):
        assert np.max(np.abs(np.array(gap))) < 1e-13


@pytest.mark.parametrize("cls", [c for c in catalogue() if is_rigid(c) and has_closed_form(c)], ids=lambda c: c.__name__)
def test_closure_vanishes_and_coordinates_return(cls):
    joint, rng = make(cls), np.random.default_rng(3)
    q, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("t")
    M = Pose(joint.mounting(), np.zeros(3))
    X = M.inverse() @ joint.pose(q, t) @ M
    closure = joint.closure(X, t)
    found = joint.coordinates(X)
    assert found is not None
    start, _ = random_state(joint, rng)
    back = np.array(ca.Function("f", [q, t], [found])(start, 0.0)).ravel()
    if joint.q.start is not None and back[:4] @ start[:4] < 0:
        back[:4] *= -1
    assert np.max(np.abs(back - start), initial=0.0) < 1e-14
    if closure is not None:
        assert np.max(np.abs(np.array(ca.Function("f", [q, t], [closure])(start, 0.0))), initial=0.0) < 1e-15
        assert closure.numel() + joint.closure_rates(X, ca.SX.zeros(3), ca.SX.zeros(3), t).numel() == 6 - joint.v.size


@pytest.mark.parametrize(
    "cls",
    [
        c
        for c in catalogue()
        if is_rigid(c) and has_closed_form(c) and c.__name__ not in ("FreePoint", "FreeJoint", "PrescribedMotion")
    ],
    ids=lambda c: c.__name__,
)
def test_joint_cut_or_in_the_tree_gives_the_same_motion(cls):
    """A body on one joint: as a tree joint, and as a free body with the joint as a constraint."""
    joint, rng = make(cls), np.random.default_rng(4)
    scene = ac.System()
    scene.world, scene.body, scene.joint, scene.free = World(), RigidBody(1.3, (0.1, 0.2, 0.25), (0.2, -0.1, 0.3)), joint, Free()
    for one in (scene.joint, scene.free):
        scene.connect(scene.world.frame, one.frame_a)
        scene.connect(one.frame_b, scene.body.frame)
    mechanism = build_mechanism(flatten(scene))
    tree_edge, cut_edge = mechanism.tree[0].edge, mechanism.cuts[0]
    assert tree_edge.joint is joint
    swapped = replace(mechanism, tree=(TreeEdge(cut_edge, 0, 1),), cuts=(tree_edge,))
    by_tree = Outputs(reduce_system(mechanical_system(mechanism, time.sx)))
    by_cut = Outputs(reduce_system(mechanical_system(swapped, time.sx)))
    q, v = random_state(joint, rng)
    x = np.concatenate([q, v])
    seen = [
        scene.free.q,
        scene.free.v,
        scene.body.frame.acceleration,
        scene.body.frame.angular_acceleration,
        joint.frame_b.force,
        joint.frame_b.torque,
    ]

    def evaluate(outputs: Outputs, state: np.ndarray, what) -> list[np.ndarray]:
        s = outputs.system
        return [np.array(o) for o in ca.Function("f", [s.t, s.x], [outputs.resolve(e) for e in what])(0.0, state)]

    free_q, free_v, *first = evaluate(by_tree, x, seen)
    second = evaluate(by_cut, np.concatenate([free_q.ravel(), free_v.ravel()]), seen[2:])
    for a, b in zip(first, second, strict=True):
        assert np.max(np.abs(a - b)) < 1e-10 * (1 + np.max(np.abs(a)))
    assert by_cut.system.degrees_of_freedom == joint.v.size


@pytest.mark.parametrize("cls", [c for c in catalogue() if c.__name__ != "FreePoint"], ids=lambda c: c.__name__)
@pytest.mark.parametrize("backwards", [False, True])
def test_reactions_do_no_work_between_two_bodies(cls, backwards):
    """Energy of two bodies on a hinge and the joint is constant at random states but for what drives supply, so the joint's reaction does no work."""
    joint = make(cls)
    scene = ac.System()
    scene.world, scene.hinge, scene.joint = World(), Revolute((1, 2, 0.5)), joint
    scene.one, scene.two = RigidBody(1.0, (0.1, 0.2, 0.25), (0.1, 0.2, 0.3)), RigidBody(1.5, (0.2, 0.2, 0.25), (0.1, -0.2, 0.3))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.one.frame)
    ends = (joint.frame_b, joint.frame_a) if backwards else (joint.frame_a, joint.frame_b)
    scene.connect(scene.one.at((0.3, 0.2, -0.5)), ends[0])
    scene.connect(ends[1], scene.two.frame)
    model = ac.build(scene)
    s, outputs = model.system, model.functions.outputs
    energy = outputs.kinetic_energy + outputs.potential_energy
    f = ca.Function("f", [s.t, s.x], [ca.jtimes(energy, s.x, s.x_dot) + outputs.power_loss, energy])
    rng = np.random.default_rng(5)
    chain = [("joint", *random_state(joint, rng))]
    if joint.socket is not None:  # by which a body turns at its point
        chain.insert(0 if backwards else 1, ("joint.socket", *random_state(joint.socket, rng)))
    names = ["hinge", *(name for name, q, _ in chain if q.size)]
    assert list(dict.fromkeys(name.rpartition(".")[0] for name in model.state_names)) == names
    x = np.concatenate([[0.4], *(q for _, q, _ in chain), [0.7], *(v for _, _, v in chain)])
    rate, value = f(0.0, x)
    assert abs(float(rate)) < 1e-12 * (1 + abs(float(value)))


def test_step_joints_of_parameters_turn_with_them():
    angle = ac.Parameter(0.0)
    scene = ac.System()
    scene.angle = angle
    scene.world, scene.hinge, scene.rod = World(), Revolute((ca.sin(angle), ca.cos(angle), 0.0)), RigidBody.rod(1.0, (0, 0, -1))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    model = ac.build(scene)
    axis = model.functions.output(scene.hinge.frame_b.angular_velocity)(0.0, [0.3, 1.0], [], [0.5])
    assert np.max(np.abs(np.array(axis).ravel() - [np.sin(0.5), np.cos(0.5), 0])) < 1e-15


@pytest.mark.parametrize("cls", [c for c in catalogue() if is_rigid(c)], ids=lambda c: c.__name__)
def test_mounting_branch_and_domain_are_what_they_oblige_to(cls):
    """A rotation without q and t; on the poses of the joint itself its branch and domain are the right ones, numbers of size one."""
    joint, rng = make(cls), np.random.default_rng(6)
    q, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("t")
    M = symbolic(joint.mounting())
    assert not ca.depends_on(M, ca.vertcat(q, t))
    assert np.max(np.abs(np.array(ca.DM(M.T @ M)) - np.eye(3))) < 1e-15 and float(ca.DM(ca.det(M))) > 0
    turned = Pose(M, np.zeros(3))
    sign = joint.closure_sign(turned.inverse() @ joint.pose(q, t) @ turned)
    f = ca.Function("f", [q, t], [ca.vertcat(joint.domain(q), ca.SX(0, 1) if sign is None else sign)])
    for start in (np.array(joint.start_q()), *(random_state(joint, rng)[0] for _ in range(5))):
        inside = np.array(f(start, 0.3))
        assert np.all(inside > 0.1) and np.all(inside < 10)
