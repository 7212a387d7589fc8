"""Model only what the scene needs: states, constraints and operations; loops, redundancy, conservation on random trees."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.outputs.functions import operations
from components import (
    CartesianTranslation,
    Cylindrical,
    Fixed,
    Free,
    Gear,
    Inertia,
    Particle,
    Planar,
    Prismatic,
    Revolute,
    RigidBody,
    RollingBall,
    RollingDisk,
    Screw,
    Spherical,
    Spring,
    TorqueSource,
    Universal,
    World,
)  # fmt: skip
from components.orientation import rotation_about
from tests.scenes import DoublePendulum, FourBar, bennett_linkage, chain, rotation

SKEW = rotation_about(np.array([1.0, 2.0, 3.0]) / np.sqrt(14), 0.7)


def acceleration_operations(model: ac.Model) -> int:
    s = model.system
    return operations(ca.Function("a", [s.t, s.x, s.u, s.p], [s.v_dot], {"cse": True}))


def test_planar_double_pendulum_is_as_small_as_by_hand():
    model = ac.build(DoublePendulum())
    assert model.system.x.numel() == 4
    assert model.system.constraints.jacobian.shape[0] == 0
    assert acceleration_operations(model) <= 45


def test_lone_particle_has_six_states_and_nothing_to_compute():
    scene = ac.System()
    scene.world, scene.ball = World(), Particle(1.0)
    model = ac.build(scene)
    assert model.system.x.numel() == 6
    assert model.operations == 0


def test_lone_body_has_thirteen_states():
    scene = ac.System()
    scene.world, scene.body = World(), RigidBody(1.0, (1, 2, 2.5), (0.1, 0.2, 0.3))
    assert ac.build(scene).system.x.numel() == 13


def test_rolling_disk_has_three_velocities_and_no_multiplier():
    scene = ac.System()
    scene.world, scene.disk, scene.contact = World(), RigidBody.disk(1.0, 0.3, axis="y"), RollingDisk(0.3, "y")
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.disk.frame)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 3
    assert model.system.x.numel() == 8
    assert model.system.tree_velocities == 3
    assert model.system.constraints.jacobian.shape[0] == 0
    assert acceleration_operations(model) <= 40


@pytest.mark.parametrize("count", [10, 20, 40])
def test_aligned_chains_take_at_most_300_operations_a_link(count):
    assert acceleration_operations(ac.build(chain(count))) <= 300 * count


@pytest.mark.parametrize("count", [10, 20])
def test_askew_chains_take_at_most_700_operations_a_link(count):
    axes = ((1, 2, 3), (3, -1, 0.5), (0.3, 0.2, -1))
    scene = chain(count, lambda k: Revolute(axes[k % 3]), (0.3, 0.2, -1.0))
    assert acceleration_operations(ac.build(scene)) <= 700 * count


def test_an_output_that_nobody_asks_for_costs_nothing():
    scene = DoublePendulum()
    model = ac.build(scene)
    before = model.operations
    force = model.functions.output(scene.elbow.frame_b.force)
    assert operations(force) > 0
    assert ac.build(scene).operations == before


@pytest.mark.parametrize("R", [np.eye(3), SKEW, rotation(3)], ids=["x-z plane", "skewed plane", "random plane"])
def test_four_bar_of_plain_hinges(R):
    """Assembled from zero angles, planar whatever the plane, two of five rows kept, no drift."""
    scene = FourBar(R)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    assert model.system.constraints.jacobian.shape[0] == 2
    assert len(model.system.constraints.redundant) + len(model.system.constraints.vanishing) == 3
    report = model.report()
    assert "planar" in report
    assert "redundant" in report
    assert "a shift along the axis is redundant" in report
    assert "a, d, b, c               torque x, torque y, force z" in report
    run = model.simulate(10.0, {scene.a.q: -0.5, scene.a.v: 3.0}, rtol=1e-11)
    assert run.constraint_error() < 1e-13
    assert run.energy_error() < 1e-9
    gap = run[scene.coupler.tip.position] - run[scene.rocker.tip.position]
    assert np.max(np.abs(gap)) < 1e-13
    same = ac.build(FourBar())
    plain = FourBar()
    same = ac.build(plain).simulate(10.0, {plain.a.q: -0.5, plain.a.v: 3.0}, rtol=1e-11)
    assert np.max(np.abs(run[scene.c.q] - same[plain.c.q])) < 1e-7


def test_four_bar_from_a_rough_sketch_with_world_points():
    """Bodies roughly placed (off by some percent), joints by world points where they are given, exact lengths elsewhere."""
    scene = ac.System()
    scene.world = World()
    scene.crank = RigidBody.rod(1.0, (0.3, 0, 0), position=(0.01, 0, 0.0), rotation=("y", -1.0))
    scene.coupler = RigidBody.rod(1.0, (0.9, 0, 0), position=(0.17, 0, 0.24), rotation=("y", -0.3))
    scene.rocker = RigidBody.rod(1.0, (0.7, 0, 0), position=(1.02, 0, 0.01), rotation=("y", -1.7))
    scene.a = Revolute.between(scene.world, scene.crank.frame, at=(0, 0, 0), axis="y")
    scene.b = Revolute.between(scene.crank.tip, scene.coupler.frame, axis="y")
    scene.c = Revolute.between(scene.coupler.tip, scene.rocker.tip, axis="y")
    scene.d = Revolute.between(scene.world, scene.rocker.frame, at=(1.0, 0, 0), axis="y")
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(2.0, {}, rtol=1e-10)
    assert run.constraint_error() < 1e-13
    assert abs(np.linalg.norm(run[scene.coupler.tip.position][0] - run[scene.crank.tip.position][0]) - 0.9) < 1e-13
    assert run[scene.rocker.tip.position][0, 2] > 0.5  # the branch of the sketch, not the one below the ground


def test_joint_between_bodies_at_a_world_point():
    scene = ac.System()
    scene.world = World()
    scene.arm = RigidBody(1.0, (0.1, 0.2, 0.2), position=(0.5, 0, 1), rotation=("z", 0.4))
    scene.hinge = Revolute.between(scene.world, scene.arm, at=(0.2, 0.1, 1.0), axis="y")
    model = ac.build(scene)
    at_zero = model.functions.output(scene.arm.frame.position, scene.hinge.frame_b.position)(0.0, [0.0, 0.0], [], [])
    assert np.max(np.abs(np.array(at_zero[0]).ravel() - [0.5, 0, 1])) < 1e-15
    assert np.max(np.abs(np.array(at_zero[1]).ravel() - [0.2, 0.1, 1])) < 1e-15


def test_body_on_two_rolling_wheels():
    """A cart on two disks with parallel axles rolls straight: one contact in the tree, the other closes a loop."""
    scene = ac.System()
    scene.world, scene.frame = World((1.0, 0, -9.81)), RigidBody.box(5.0, (1.0, 0.4, 0.1))
    scene.wheels = [RigidBody.disk(1.0, 0.25, axis="y") for _ in range(2)]
    scene.axles = [Revolute("y") for _ in range(2)]
    scene.contacts = [RollingDisk(0.25, "y") for _ in range(2)]
    for x, wheel, axle, contact in zip((-0.5, 0.5), scene.wheels, scene.axles, scene.contacts, strict=True):
        scene.connect(scene.frame.at((x, 0, 0)), axle.frame_a)
        scene.connect(axle.frame_b, wheel.frame)
        scene.connect(scene.world.frame, contact.frame_a)
        scene.connect(contact.frame_b, wheel.frame)
    model = ac.build(scene)
    assert len(model.system.mechanics.mechanism.cuts) == 1
    run = model.simulate(
        2.0, {scene.frame.frame.velocity: ac.near((2.0, 0, 0)), scene.frame.frame.rotation: np.eye(3)}, rtol=1e-11
    )
    x = run[scene.frame.frame.position]
    # 5 + 2 kg are moved, and two disks of m r^2 / 2 turn: 8 kg of effective mass against a pull of 7 N
    expected = x[0, 0] + run[scene.frame.frame.velocity][0, 0] * run.t + 0.5 * 7 / 8 * run.t**2
    assert np.max(np.abs(x[:, 0] - expected)) < 1e-8
    assert np.max(np.abs(x[:, 1:] - x[0, 1:])) < 1e-8
    assert run.constraint_error() < 1e-12


def random_tree(seed: int, count: int = 6) -> ac.System:
    """Bodies on random joints of all kinds, each hung on a random earlier body; every second seed floats without ground contact."""
    rng = np.random.default_rng(seed)
    makers = [
        lambda: Revolute(rng.normal(size=3)), lambda: Prismatic(rng.normal(size=3)), lambda: Cylindrical(rng.normal(size=3)),
        lambda: Screw(rng.normal(size=3), rng.normal()), lambda: Universal("x", "z"), Spherical, lambda: Planar(rng.normal(size=3)),
        CartesianTranslation, Free,
    ]  # fmt: skip
    scene = ac.System()
    scene.world = World(None if seed % 2 else (0.3, -0.2, -9.81))
    scene.bodies, scene.joints, scene.welds = [], [], []
    for k in range(count):
        a = rng.uniform(0.1, 1, 3)
        body = RigidBody(rng.uniform(0.5, 2), tuple(a @ np.ones(3) - a), rng.normal(size=3) * 0.3)
        scene.bodies.append(body)
        if k == 0 and seed % 2:
            continue
        earlier = (
            scene.world.frame
            if k == 0
            else scene.bodies[rng.integers(k)].at(rng.normal(size=3), rotation(int(rng.integers(100))))
        )
        joint = makers[rng.integers(len(makers))]()
        scene.joints.append(joint)
        ends = (joint.frame_a, joint.frame_b) if rng.random() < 0.5 else (joint.frame_b, joint.frame_a)
        scene.connect(earlier, ends[0])
        scene.connect(ends[1], body.at(rng.normal(size=3), rotation(int(rng.integers(100)))))
    spring = scene.spring = Spring(20.0, 0.4)
    scene.connect(spring.point_a, scene.bodies[0].at((0.5, 0, 0)))
    scene.connect(spring.point_b, scene.bodies[-1].at((0, 0.5, 0)))
    return scene


@pytest.mark.parametrize("seed", range(12))
def test_energy_and_momentum_of_random_trees(seed):
    """dE/dt = 0 at random states; without gravity and ground also the momenta. Newton-Euler agrees with articulated bodies."""
    from tests.momentum import angular_momentum, linear_momentum

    model = ac.build(random_tree(seed))
    s, outputs, kin = model.system, model.functions.outputs, model.system.mechanics.kinematics
    energy = outputs.kinetic_energy + outputs.potential_energy
    held = ca.vertcat(linear_momentum(kin), angular_momentum(kin))
    f = ca.Function("f", [s.t, s.x], [ca.jtimes(energy, s.x, s.x_dot), energy, ca.jtimes(held, s.x, s.x_dot), held])
    rng = np.random.default_rng(100 + seed)
    x = rng.uniform(-1, 1, s.x.numel())
    for item in s.tree_joints:
        if item.edge.joint.q.start is not None:
            x[item.q.start : item.q.start + 4] /= np.linalg.norm(x[item.q.start : item.q.start + 4])
    rate, value, held_rate, held_value = (np.array(o).ravel() for o in f(0.0, x))
    print("seed", seed)
    assert abs(rate[0]) < 1e-11 * (1 + abs(value[0]))
    if seed % 2:
        assert np.max(np.abs(held_rate)) < 1e-11 * (1 + np.max(np.abs(held_value)))
    x_dot = model.functions.explicit_dynamics(0.0, x, [], [])
    residual = model.functions.residual_dynamics(0.0, x, x_dot, [], [], [])
    assert np.max(np.abs(np.array(residual))) < 1e-10 * (1 + np.max(np.abs(np.array(x_dot))))


def test_long_chains_of_ball_joints_keep_their_digits():
    """50 links: accelerations put into Newton-Euler leave no more than rounding."""
    model = ac.build(chain(50, lambda k: Spherical(), body=lambda k: RigidBody.rod(1.0, (0.0, 0.0, -1.0), 0.05)))
    rng = np.random.default_rng(0)
    q = rng.normal(size=(50, 4))
    x = np.concatenate([(q / np.linalg.norm(q, axis=1, keepdims=True)).ravel(), rng.normal(size=150)])
    x_dot = model.functions.explicit_dynamics(0.0, x, [], [])
    residual = np.array(model.functions.residual_dynamics(0.0, x, x_dot, [], [], []))
    assert np.max(np.abs(residual)) < 1e-11 * max(1.0, np.max(np.abs(np.array(x_dot))) / 1e3)


def test_welded_parts_become_one_body():
    scene = ac.System()
    scene.world, scene.hinge = World(), Revolute("y")
    scene.one, scene.two, scene.link = RigidBody.rod(1.0, (0, 0, -1)), RigidBody.ball(2.0, 0.1), Fixed((0, 0, -0.5))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.one.frame)
    scene.connect(scene.one.tip, scene.link.frame_a)
    scene.connect(scene.link.frame_b, scene.two.frame)
    model = ac.build(scene)
    a = float(model.functions.explicit_dynamics(0.0, [0.3, 0.0], [], [])[1])
    inertia = 1 / 3 + 2 * (1.5**2 + 0.4 * 0.01)
    assert abs(a + 9.81 * (0.5 + 2 * 1.5) * np.sin(0.3) / inertia) < 1e-13
    assert "two, one, link" in model.report()


def test_declaration_order_and_names_do_not_matter():
    def scene_in_order(order: list[int]) -> tuple[ac.System, list[RollingBall]]:
        scene = ac.System()
        scene.world = World((0.5, 0, -9.81))
        balls = [None] * 3
        for k in order:
            contact, ball = RollingBall(0.1 + 0.1 * k), RigidBody.ball(1.0 + k, 0.1 + 0.1 * k)
            setattr(scene, f"contact{order.index(k)}", contact)
            setattr(scene, f"ball{order.index(k)}", ball)
            scene.connect(scene.world.frame, contact.frame_a)
            scene.connect(contact.frame_b, ball.frame)
            balls[k] = contact
        return scene, balls

    results = []
    for order in ([0, 1, 2], [2, 0, 1]):
        scene, contacts = scene_in_order(order)
        run = ac.build(scene).simulate(1.0, {contacts[1].v: (1.0, 2.0, 3.0)}, rtol=1e-12)
        results.append(np.hstack([run[c.frame_b.position] for c in contacts]))
    assert np.max(np.abs(results[0] - results[1])) < 1e-12


def test_bennett_linkage_has_constraints_that_are_redundant_only_when_assembled():
    """Four hinges in space that a count of freedoms would lock; 10 s under gravity against quadruple precision."""
    scene = bennett_linkage()
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    assert len(model.system.constraints.redundant) == 3
    run = model.simulate(10.0, rtol=1e-12)
    assert run.energy_error() < 1e-11
    assert run.constraint_error() < 1e-13
    reference = [  # centres of mass at 10 s
        (0.0076167635158221903575, -0.49994198154740343944, 0.0),
        (-0.73671384625198859713, -0.49994198154740343722, -0.42968961227646673408),
        (-1.7443306097678104599, 0.0, -0.42968961227646683063),
    ]
    assert np.max(np.abs([run[link.centre.position][-1] for link in scene.links] - np.array(reference))) < 1e-11


def test_a_singular_position_of_a_loop_is_said():
    """A rhombus at rest with all its bars in one line, and one on another: either crank swings by itself, and the weight of both begins both."""
    scene = ac.System()
    scene.world = World((0, -9.81, 0))
    scene.left, scene.right, scene.bar = (
        RigidBody.rod(1.0, (0, 1, 0)),
        RigidBody.rod(1.0, (0, 1, 0)),
        RigidBody.rod(1.0, (1, 0, 0)),
    )
    scene.joints = [Revolute("z") for _ in range(4)]
    ends = [
        (scene.world.frame, scene.left.frame),
        (scene.world.at((1, 0, 0)), scene.right.frame),
        (scene.left.tip, scene.bar.frame),
        (scene.bar.tip, scene.right.tip),
    ]
    for joint, (a, b) in zip(scene.joints, ends, strict=True):
        scene.connect(a, joint.frame_a)
        scene.connect(joint.frame_b, b)
    model = ac.build(scene)
    upright = model.simulate(0.3, {scene.left.tip.velocity: (1, 0, 0)}, rtol=1e-10)
    assert upright.energy_error() < 1e-9
    with pytest.raises(ac.errors.StartValueError, match=r"'joints.*accelerates with from rest lies on none"):
        model.simulate(0.1, {scene.left.tip.position: (1, 0, 0), scene.left.tip.velocity: (0, 0, 0)}, rtol=1e-10)


def geared_arm(rotor: ac.Parameter | float = 1e-3) -> ac.System:
    """Six hinges, each driven through a gear by a motor with a rotor."""
    scene, ratios = ac.System(), (-100, -150, -100, 60, 80, 50)
    scene.world, scene.rotor = World(), rotor
    scene.joints, scene.links = (
        [Revolute(axis) for axis in "zyyxyx"],
        [RigidBody(1.0 + k, (0.1, 0.2, 0.25), (0.05, 0.02, 0.3)) for k in range(6)],
    )
    scene.gears, scene.rotors = [Gear(1 / ratio) for ratio in ratios], [Inertia(rotor * (k + 1)) for k in range(6)]
    scene.motors = [TorqueSource(ac.Input("N*m")) for _ in ratios]
    end = scene.world.frame
    for joint, link, gear, inertia, motor in zip(scene.joints, scene.links, scene.gears, scene.rotors, scene.motors, strict=True):
        scene.connect(end, joint.frame_a)
        scene.connect(joint.frame_b, link.frame)
        scene.connect(joint.flange, gear.flange_a)
        scene.connect(gear.flange_b, inertia.flange_a)
        scene.connect(inertia.flange_b, motor.flange)
        end = link.at((0, 0, 0.5))
    return scene


@pytest.mark.parametrize("rotor", [1e-3, ac.Parameter(1e-3, "kg*m^2")])
def test_rotors_on_gears_belong_to_the_inertias_of_the_links(rotor):
    """By the recursion of Newton and Euler, which takes accelerations as they come; at other inertias of rotors than at build, too."""
    model = ac.build(geared_arm(rotor))
    assert acceleration_operations(model) <= 1600
    f, rng = model.functions, np.random.default_rng(0)
    for size in (1e-3, 0.0, 2.0) if model.parameter_names else (1e-3,):
        p = [size] * len(model.parameter_names)
        for _ in range(5):
            x, u = rng.normal(size=12), rng.normal(size=6)
            x_dot = f.explicit_dynamics(0, x, u, p)
            terms = np.abs(np.array(f.residual_dynamics(0, x, 0 * x_dot, [], u, p))) + 1
            assert np.max(np.abs(np.array(f.residual_dynamics(0, x, x_dot, [], u, p))) / terms) < 1e-11
    start = {"joints[1].q": 0.5, "joints[3].v": 1.0}
    assert model.simulate(0.5, start, rtol=1e-10, samples=5).energy_error() < 1e-8
