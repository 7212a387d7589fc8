"""What the graph makes of parts: massless links, rods, prescribed frames, joints that keep their coordinates, reactions in loops."""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np
import pytest
import scipy.special

import acausal as ac
from acausal.loops.self_stress import undetermined_reactions
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, rotation_about_z
from components import (
    CartesianTranslation,
    Fixed,
    Force,
    Particle,
    PrescribedMotion,
    Prismatic,
    Revolute,
    RigidBody,
    Rod,
    RotationalGround,
    RotationalSpring,
    Spherical,
    TranslationalGround,
    TranslationalSpring,
    Universal,
    World,
)
from tests.pairings import each_value
from tests.scenes import FourBar, bennett_linkage, rotation
from tests.similar import SCENES, Units


class Helix(AbstractJoint):
    """frame_b slides down a helix of frame_a and turns with it; nothing but its pose is given."""

    q = ac.Variable("rad", "angle")
    v = ac.Variable("rad/s", "angular velocity")

    def pose(self, q, t):
        return Pose(rotation_about_z(q), ca.vertcat(0.1 * ca.cos(q), 0.1 * ca.sin(q), 0.02 * q))


def joined(scene: ac.System, *chain) -> None:
    """Connect frame, joint, frame; frame, joint, frame; ..."""
    for a, joint, b in zip(chain[0::3], chain[1::3], chain[2::3], strict=True):
        scene.connect(a, joint.frame_a)
        scene.connect(joint.frame_b, b)


def pendulum_angle(amplitude: float, rate: float, t: np.ndarray) -> np.ndarray:
    """Angle of a simple pendulum let go at `amplitude`, rate = sqrt(g / l): Jacobi's elliptic functions."""
    k2 = np.sin(amplitude / 2) ** 2
    _, cn, dn, _ = scipy.special.ellipj(rate * t, k2)
    return 2 * np.arcsin(np.sin(amplitude / 2) * cn / dn)


def parallelogram(coupler: RigidBody, crank=lambda: Fixed((0, 0, -0.5))) -> ac.System:
    scene = ac.System()
    scene.world, scene.coupler, scene.left, scene.right = World(), coupler, crank(), crank()
    scene.joints = [Revolute("y") for _ in range(4)]
    joined(
        scene,
        *(scene.world.frame, scene.joints[0], scene.left.frame_a),
        *(scene.left.frame_b, scene.joints[1], scene.coupler.frame),
        *(scene.coupler.tip, scene.joints[2], scene.right.frame_b),
        *(scene.world.at((1, 0, 0)), scene.joints[3], scene.right.frame_a),
    )
    return scene


def test_a_bar_on_two_massless_cranks_swings_as_a_simple_pendulum():
    scene = parallelogram(RigidBody.rod(2.0, (1, 0, 0)))
    model = ac.build(scene)
    assert model.system.x.numel() == 6 and model.degrees_of_freedom == 1
    run = model.simulate(5.0, {scene.joints[0].q: 1.1}, rtol=1e-11)
    expected = pendulum_angle(1.1, np.sqrt(9.81 / 0.5), run.t)
    assert np.max(np.abs(run[scene.joints[0].q] - expected)) < 1e-8
    pull = run[scene.joints[0].frame_b.force] @ np.array([0, 1.0, 0])
    assert np.max(np.abs(pull)) < 1e-12
    # a massless crank carries no torque and no force across itself
    along = np.stack([-np.sin(run[scene.joints[0].q]), 0 * run.t, -np.cos(run[scene.joints[0].q])], axis=1)
    force = run[scene.joints[0].frame_b.force]
    assert np.max(np.abs(np.cross(along, force))) < 1e-9 * np.max(np.abs(force))


def test_cranks_without_mass_are_the_limit_of_light_ones():
    light = parallelogram(RigidBody.rod(2.0, (1, 0, 0)))
    heavy = dusty(1e-7)
    for scene in (light, heavy):
        scene.push = Force((0.0, 0.0, 3.0))
        scene.connect(scene.coupler.tip, scene.push.point)
    a, b = (ac.build(s).simulate(1.0, {s.joints[0].q: 0.4}, rtol=1e-11) for s in (light, heavy))
    assert np.max(np.abs(a[light.joints[0].q] - b[heavy.joints[0].q])) < 1e-6
    for one, two in zip(light.joints, heavy.joints, strict=True):
        assert np.max(np.abs(a[one.frame_b.force] - b[two.frame_b.force])) < 1e-4


def dusty(dust: float) -> ac.System:
    """A bar on two cranks of which only the ends have a mass."""
    scene = parallelogram(RigidBody.rod(2.0, (1, 0, 0)))
    scene.dust = [Particle(dust), Particle(dust)]
    scene.connect(scene.left.frame_b, scene.dust[0].point)
    scene.connect(scene.right.frame_b, scene.dust[1].point)
    return scene


@each_value(("rate", [0.0, 9.0]), ("dust", [1e-1, 1e-4, 1e-6, 1e-8, 1e-9, 1e-12, 1e-20]))
def test_light_cranks_swing_and_whirl_as_those_without_mass(dust, rate):
    """At any tolerance, for any mass: the bar turns with its cranks as a point does; the whirling ones pass the position with all bars in one line."""
    light, heavy = parallelogram(RigidBody.rod(2.0, (1, 0, 0))), dusty(dust)
    wanted = ac.build(light).simulate(1.0, {light.joints[0].q: 0.4, light.joints[0].v: rate}, rtol=1e-12)[light.joints[0].q]
    model = ac.build(heavy)
    for rtol in (1e-8, 1e-10, 1e-12):
        run = model.simulate(1.0, {heavy.joints[0].q: 0.4, heavy.joints[0].v: rate}, rtol=rtol)
        assert np.max(np.abs(run[heavy.joints[0].q] - wanted)) < max(10 * rtol, 1e-11)
        assert run.energy_error() < max(0.1 * rtol, 1e-12)
        assert run.statistics.steps < 30 and run.statistics.rejected < 15


@pytest.mark.parametrize("dust", [1e-5, 1e-8, 1e-11, 1e-14, 1e-20, 1e-30])
def test_light_links_of_a_loop_cost_no_digits(dust):
    """A four-bar whose motion differs from that with massless cranks by as much as the dust weighs, in as many steps."""
    runs = []
    for weight in (0.0, dust):
        other = ac.System()
        other.world, other.coupler = World(), RigidBody.rod(2.0, (1, 0, 0))
        other.left, other.right = Fixed((0, 0, -0.5)), Fixed((0, 0, -0.7))
        other.joints = [Revolute("y") for _ in range(4)]
        joined(
            other,
            *(other.world.frame, other.joints[0], other.left.frame_a, other.left.frame_b, other.joints[1], other.coupler.frame),
            *(other.coupler.tip, other.joints[2], other.right.frame_b),
            *(other.world.at((1.1, 0, 0)), other.joints[3], other.right.frame_a),
        )
        if weight:
            other.dust = [Particle(weight), Particle(weight)]
            other.connect(other.left.frame_b, other.dust[0].point)
            other.connect(other.right.frame_b, other.dust[1].point)
        run = ac.build(other).simulate(1.0, {other.joints[0].q: 0.4, other.joints[0].v: 3.0}, rtol=1e-10, samples=11)
        runs.append((run[other.joints[0].q], run.statistics.steps))
    assert np.max(np.abs(runs[1][0] - runs[0][0])) < 1 * dust + 1e-12
    assert runs[1][1] <= runs[0][1] + 2


def rocker_pair(link: bool) -> ac.System:
    """Two thin rods on hinges, joined by a massless link with a universal and a ball joint, or by a `Rod`."""
    scene = ac.System()
    scene.world = World()
    scene.one, scene.two = RigidBody.rod(1.0, (0, 0, 0.4)), RigidBody.rod(1.0, (0, 0, 0.8))
    scene.a, scene.b = Revolute("y"), Revolute("y")
    joined(scene, scene.world.frame, scene.a, scene.one.frame, scene.world.at((1.0, 0.1, 0)), scene.b, scene.two.frame)
    if link:
        scene.link, scene.cross, scene.ball = Fixed((0.9, 0, 0)), Universal("y", "z"), Spherical()
        joined(scene, scene.one.tip, scene.cross, scene.link.frame_a, scene.link.frame_b, scene.ball, scene.two.tip)
    else:
        scene.link = Rod(0.9)
        scene.connect(scene.one.tip, scene.link.frame_a)
        scene.connect(scene.link.frame_b, scene.two.tip)
    return scene


def test_a_massless_link_in_space_moves_as_a_rod_does():
    """In the tree the thin rod behind the ball joint may spin without inertia; only the closed loop forbids it."""
    one, two = rocker_pair(True), rocker_pair(False)
    runs = [ac.build(s).simulate(2.0, {s.a.q: 0.3, s.two.tip.position: ac.near((1.3, 0.1, 0.7))}, rtol=1e-11) for s in (one, two)]
    assert np.max(np.abs(runs[0][one.two.tip.position] - runs[1][two.two.tip.position])) < 1e-8
    assert np.max(np.abs(runs[0][one.cross.frame_a.force] - runs[1][two.link.frame_a.force])) < 1e-7
    assert ac.build(two).system.x.numel() == 4


def test_a_massless_link_between_two_ball_joints_is_refused_with_advice():
    scene = rocker_pair(True)
    scene.extra = Spherical()
    other = ac.System()
    other.world, other.link, other.balls = World(), Fixed((0.9, 0, 0)), [Spherical(), Spherical()]
    other.bars, other.hinges = [RigidBody.rod(1.0, (0, 0, 0.4)), RigidBody.rod(1.0, (0, 0, 0.8))], [Revolute("y"), Revolute("y")]
    joined(
        other,
        *(other.world.frame, other.hinges[0], other.bars[0].frame),
        *(other.bars[0].tip, other.balls[0], other.link.frame_a),
        *(other.link.frame_b, other.balls[1], other.bars[1].tip),
        *(other.world.at((1.0, 0.1, 0)), other.hinges[1], other.bars[1].frame),
    )
    with pytest.raises(ac.errors.MasslessError, match=r"balls\[.*Rod\(length\)"):
        ac.build(other)


def test_a_dumbbell_turns_evenly_and_its_rod_pulls():
    scene = ac.System()
    scene.world, scene.one, scene.two, scene.rod = World(None), Particle(1.0), Particle(2.0), Rod(0.7)
    scene.connect(scene.one.point, scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, scene.two.point)
    model = ac.build(scene)
    assert (model.system.x.numel(), model.degrees_of_freedom) == (12, 5)
    start = {scene.one.point.position: (0, 0, 0), scene.two.point.position: (0.7, 0, 0), scene.two.point.velocity: (0, 1.4, 0)}
    run = model.simulate(3.0, start | {scene.one.point.velocity: (0, 0, 0)}, rtol=1e-11)
    along = (run[scene.two.point.position] - run[scene.one.point.position]) / 0.7
    assert np.max(np.abs(along[:, 0] - np.cos(2.0 * run.t))) < 1e-9
    tension = 2.0 / 3.0 * 0.7 * 2.0**2  # reduced mass, length, rate
    assert (
        np.max(
            np.abs(
                run[scene.rod.frame_a.force] + tension * along  # into the rod
            )
        )
        < 1e-9
    )


def test_a_particle_on_a_rod_is_a_spherical_pendulum():
    """Conical motion: w^2 = g / (l cos a), tension m g / cos a."""
    scene, a = ac.System(), 0.5
    scene.world, scene.bob, scene.rod = World(), Particle(1.5), Rod(0.7)
    scene.connect(scene.world.frame, scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, scene.bob.point)
    rate = np.sqrt(9.81 / (0.7 * np.cos(a)))
    place = 0.7 * np.array([np.sin(a), 0, -np.cos(a)])
    run = ac.build(scene).simulate(
        4.0, {scene.bob.point.position: place, scene.bob.point.velocity: (0, rate * place[0], 0)}, rtol=1e-11
    )
    assert np.max(np.abs(run[scene.bob.point.position][:, 2] - place[2])) < 1e-9
    assert np.max(np.abs(np.linalg.norm(run[scene.rod.frame_a.force], axis=1) - 1.5 * 9.81 / np.cos(a))) < 1e-8


def test_a_pendulum_on_an_accelerated_pivot_hangs_askew():
    scene = ac.System()
    scene.world, scene.cart, scene.hinge = World(), PrescribedMotion(position=lambda t: (1.5 * t**2, 0, 0)), Revolute("y")
    scene.rod = RigidBody.rod(1.0, (0, 0, -1.0))
    joined(scene, scene.world.frame, scene.cart, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    model = ac.build(scene)
    assert model.system.x.numel() == 2
    tilt = np.arctan2(3.0, 9.81)
    run = model.simulate(3.0, {scene.hinge.q: tilt}, rtol=1e-11)
    assert np.max(np.abs(run[scene.hinge.q] - tilt)) < 1e-10
    assert np.max(np.abs(run[scene.cart.frame_a.force] - np.array([3.0, 0, 9.81]))) < 1e-9  # m (a - g), into the cart
    assert run.energy_error() < 1e-11  # with what the cart supplies


def test_a_bead_on_a_turning_hoop_keeps_its_place():
    """cos a = g / (w^2 r); the drive supplies no power then, and does when the bead swings."""
    scene, rate, radius = ac.System(), 6.0, 0.5
    scene.world, scene.hoop, scene.hinge = World(), PrescribedMotion(angle=rate * ac.time, axis="z"), Revolute("y")
    scene.spoke, scene.bead = Fixed((0, 0, -radius)), Particle(0.2)
    joined(scene, scene.world.frame, scene.hoop, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.spoke.frame_a)
    scene.connect(scene.spoke.frame_b, scene.bead.point)
    model = ac.build(scene)
    rest = np.arccos(9.81 / (rate**2 * radius))
    for rtol, compiled in ((1e-6, True), (1e-8, True), (1e-11, True), (1e-11, False)):
        still = model.simulate(2.0, {scene.hinge.q: rest}, rtol=rtol, compiled=compiled)
        assert np.max(np.abs(still[scene.hinge.q] - rest)) < 1e-8
        assert still.statistics.steps < 40  # its velocity is nothing but rounding, which asks for no small steps
    swinging = model.simulate(2.0, {scene.hinge.q: 0.3}, rtol=1e-11)
    # in the turning frame the energy with the centrifugal potential is constant
    a, w = swinging[scene.hinge.q], swinging[scene.hinge.v]
    jacobi = 0.5 * radius**2 * w**2 - 9.81 * radius * np.cos(a) - 0.5 * (rate * radius * np.sin(a)) ** 2
    assert np.ptp(jacobi) < 1e-9
    assert np.ptp(swinging.energy) > 0.1 and swinging.energy_error() < 1e-10


def test_a_prescribed_frame_may_close_a_loop():
    """A slider that is carried along drives the crank behind it as the closed form says."""
    scene = ac.System()
    scene.world, scene.carried = World(), PrescribedMotion(position=lambda t: (1.2 + 0.2 * ca.sin(3 * t), 0, 0))
    scene.crank, scene.bar, scene.hinges = (
        RigidBody.rod(1.0, (0.5, 0, 0)),
        RigidBody.rod(1.0, (1.0, 0, 0)),
        [Revolute("y") for _ in range(3)],
    )
    joined(
        scene,
        *(scene.world.frame, scene.hinges[0], scene.crank.frame),
        *(scene.crank.tip, scene.hinges[1], scene.bar.frame),
    )
    joined(scene, scene.world.frame, scene.carried, scene.hinges[2].frame_a)
    scene.connect(scene.hinges[2].frame_b, scene.bar.tip)
    run = ac.build(scene).simulate(2.0, {scene.hinges[0].q: ac.near(-0.7)}, rtol=1e-11)
    s = 1.2 + 0.2 * np.sin(3 * run.t)
    expected = np.arccos((s**2 + 0.5**2 - 1.0) / (2 * s * 0.5))
    assert np.max(np.abs(np.abs(run[scene.hinges[0].q]) - expected)) < 1e-8
    assert run.energy_error() < 1e-9


def test_what_has_no_known_rate_cannot_be_prescribed():
    with pytest.raises(ac.errors.ParameterError, match="depends on the variable"):
        PrescribedMotion(position=(Revolute("x").q, 0.0, 0.0))


def test_a_joint_of_ones_own_may_close_a_loop():
    """A body on a helix and on a carriage that follows it: as if the carriage's mass sat on the body."""
    scene, alone = ac.System(), ac.System()
    for s in (scene, alone):
        s.world, s.helix, s.body = World((1.0, 0, -9.81)), Helix(), RigidBody(1.0, (0.01, 0.02, 0.025), (0.05, 0, 0))
        joined(s, s.world.frame, s.helix, s.body.frame)
    scene.carriage, scene.ball, scene.load = CartesianTranslation(), Spherical(), RigidBody.ball(0.1, 0.05)
    joined(scene, scene.world.frame, scene.carriage, scene.load.frame, scene.load.frame, scene.ball, scene.body.frame)
    alone.load = Particle(0.1)
    alone.connect(alone.body.frame, alone.load.point)
    a, b = (ac.build(s).simulate(2.0, {s.helix.v: 2.0}, rtol=1e-11) for s in (scene, alone))
    assert np.max(np.abs(a[scene.helix.q] - b[alone.helix.q])) < 1e-9
    assert np.max(np.abs(a[scene.carriage.q] - a[scene.body.frame.position])) < 1e-10


@pytest.mark.parametrize("massless", [False, True])
def test_two_joints_that_both_keep_their_coordinates_may_close_a_loop(massless):
    doubled, single = ac.System(), ac.System()
    for s in (doubled, single):
        s.world, s.helix, s.hinge = World((1.0, 0, -9.81)), Helix(), Revolute("y")
        s.arm = Fixed((0.05, 0, 0)) if massless else RigidBody.rod(1.0, (0.05, 0, 0))
        s.body = RigidBody.rod(1.0, (0, 0, -1.0))
        own, tip = (s.arm.frame_a, s.arm.frame_b) if massless else (s.arm.frame, s.arm.tip)
        joined(s, s.world.frame, s.helix, own, tip, s.hinge, s.body.frame)
    doubled.second = Helix()
    joined(doubled, doubled.world.frame, doubled.second, doubled.arm.frame_a if massless else doubled.arm.frame)
    a, b = (ac.build(s).simulate(1.0, {s.helix.v: 2.0}, rtol=1e-11) for s in (doubled, single))
    assert np.max(np.abs(a[doubled.helix.q] - b[single.helix.q])) < 1e-9
    assert np.max(np.abs(a[doubled.second.q] - a[doubled.helix.q])) < 1e-10


def test_springs_on_all_hinges_of_a_loop_remember_full_turns():
    """A crank turned several times winds its spring up, wherever the graph cuts the loop."""
    scene = ac.System()
    scene.world = World(None)
    scene.hinges = [Revolute("y") for _ in range(4)]
    scene.bars = [RigidBody.rod(1.0, (0.3, 0, 0)), RigidBody.rod(1.0, (1.0, 0, 0)), RigidBody.rod(1.0, (0.8, 0, 0))]
    scene.springs, scene.walls = [RotationalSpring(0.02) for _ in range(4)], [RotationalGround() for _ in range(4)]
    crank, coupler, rocker = scene.bars
    joined(
        scene,
        *(scene.world.frame, scene.hinges[0], crank.frame, crank.tip, scene.hinges[1], coupler.frame),
        *(coupler.tip, scene.hinges[2], rocker.tip, scene.world.at((0.9, 0, 0)), scene.hinges[3], rocker.frame),
    )
    for hinge, spring, wall in zip(scene.hinges, scene.springs, scene.walls, strict=True):
        scene.connect(hinge.flange, spring.flange_a)
        scene.connect(spring.flange_b, wall.flange)
    run = ac.build(scene).simulate(5.0, {scene.hinges[0].v: 12.0}, rtol=1e-10)
    angles = np.array([run[hinge.q] for hinge in scene.hinges])
    assert np.ptp(angles[0]) > 2 * np.pi
    assert np.max(np.abs(run.potential_energy - 0.01 * np.sum(angles**2, axis=0))) < 1e-9
    assert run.energy_error() < 1e-8


def test_a_spring_on_the_slider_of_a_loop_is_stretched_by_it():
    scene = ac.System()
    scene.world, scene.slider, scene.hinges = World(None), Prismatic("x"), [Revolute("y") for _ in range(3)]
    scene.crank, scene.bar, scene.block = (
        RigidBody.rod(1.0, (0.3, 0, 0)),
        RigidBody.rod(1.0, (1.0, 0, 0)),
        RigidBody.ball(0.5, 0.1),
    )
    scene.spring, scene.wall = TranslationalSpring(40.0, 0.2), TranslationalGround()
    joined(
        scene,
        *(scene.world.frame, scene.hinges[0], scene.crank.frame, scene.crank.tip, scene.hinges[1], scene.bar.frame),
        *(scene.bar.tip, scene.hinges[2], scene.block.frame, scene.world.frame, scene.slider, scene.block.frame),
    )
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.slider.flange)
    run = ac.build(scene).simulate(2.0, {scene.hinges[0].q: 0.4, scene.hinges[0].v: 8.0}, rtol=1e-10)
    s = run[scene.slider.q]
    assert np.max(np.abs(run.potential_energy - 20.0 * (s - 0.2) ** 2)) < 1e-9
    assert run.energy_error() < 1e-9


@pytest.mark.parametrize("R", [np.eye(3), rotation(1)], ids=["plane", "skew"])
def test_reactions_in_a_loop_do_not_depend_on_where_it_is_cut(R):
    """A force out of the plane is carried by rows that the motion does not determine: the smallest set of reactions is one."""
    found: list[list[np.ndarray]] = []
    for order in ("abcd", "dcba", "bcda"):
        scene = FourBar(R, order=order)
        scene.push = Force(tuple(R @ np.array((1.0, 5.0, 2.0))))
        scene.connect(scene.coupler.centre, scene.push.point)
        model = ac.build(scene)
        run = model.simulate(0.5, {scene.a.q: 0.3, scene.rocker.tip.position: ac.near(R @ np.array([1.4, 0, -0.7]))}, rtol=1e-11)
        joints = [getattr(scene, name) for name in "abcd"]
        found.append([R.T @ w for j in joints for w in (run[j.frame_b.force][-1], run[j.frame_b.torque][-1])])
        across = sum((run[j.frame_b.force][-1] for j in (scene.a, scene.d)), np.zeros(3))
        assert abs(R.T[1] @ across - 5.0) < 1e-9  # together the two ground hinges carry the push across the plane
        s = model.system
        loose = undetermined_reactions(s.mechanics, s.constraints, s.p, s.p_values)
        # force along the axis and torques across it, at every hinge
        assert loose == dict.fromkeys("abcd", (True, True, False, False, False, True))
    assert np.max(np.abs(np.array(found) - np.array(found[0]))) < 1e-10


def loads(name: str, of: Units) -> np.ndarray:
    """Forces and torques at the hinges of a scene in other units, without units."""
    similar = SCENES[name](of)
    run = ac.build(similar.scene).simulate(0.1 * of.time, similar.start, rtol=1e-11, samples=3)
    joints = [part for part in vars(similar.scene).values() if isinstance(part, Revolute)]
    force = of.torque / of.length
    return np.array([[run[j.frame_b.force] / force, run[j.frame_b.torque] / of.torque] for j in joints])


@functools.cache
def plain_loads(name: str) -> np.ndarray:
    """In metres, kilograms and seconds."""
    return loads(name, Units())


@each_value(
    ("name", ["four_bar", "bennett_linkage"]),
    ("of", [Units(length=1e-9), Units(length=1e6, mass=1e-6), Units(length=1e3, time=1e3), Units(mass=1e9)]),
)
def test_the_smallest_reactions_are_the_same_in_any_unit(name: str, of: Units):
    """Also those that rigid bodies do not determine: torques count beside forces by lengths of the loop, not by metres."""

    plain = plain_loads(name)
    assert np.max(np.abs(loads(name, of) - plain)) < 1e-7 * np.max(np.abs(plain))


def test_balanced_reactions_of_a_skew_loop_balance_every_body():
    """Force and torque on each bar of Bennett's linkage, whose three redundant rows leave reactions open, make its momentum."""
    scene = bennett_linkage()
    model = ac.build(scene)
    run = model.simulate(0.5, rtol=1e-11)
    for k, link in enumerate(scene.links):
        before, after = scene.joints[k], scene.joints[k + 1]
        force = run[before.frame_b.force] + run[after.frame_a.force]  # into the joints
        needed = link.mass * (run[link.centre.acceleration] + np.array([0, 0, 9.81]))
        assert np.max(np.abs(force + needed)) < 1e-9 * np.max(np.abs(needed))
    s = model.system
    loose = undetermined_reactions(s.mechanics, s.constraints, s.p, s.p_values)
    assert set(loose) == {f"joints[{k}]" for k in range(4)} and not any(row[2] for row in loose.values())


@pytest.mark.parametrize("order", [("rail", "guide"), ("guide", "rail")])
@pytest.mark.parametrize("back", [False, True])
def test_a_bead_on_two_rods_moves_where_they_cross(order, back):
    """A particle has no orientation: a slider that closes a loop on it asks nothing of one. x = h tan a; T + V by hand."""
    scene, h = ac.System(), 0.5
    scene.world, scene.hinge, scene.arm, scene.bead = World(), Revolute("y"), RigidBody(1.0, (0.02, 0.03, 0.02)), Particle(0.4)
    for name in order:
        setattr(scene, name, Prismatic("-z" if name == "rail" else "x"))
    joined(scene, scene.world.frame, scene.hinge, scene.arm.frame)
    for joint, holder in ((scene.rail, scene.arm.frame), (scene.guide, scene.world.at((0, 0, -h)))):
        ends = (joint.frame_b, joint.frame_a) if back else (joint.frame_a, joint.frame_b)
        scene.connect(holder, ends[0])
        scene.connect(ends[1], scene.bead.point)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(1.0, {scene.hinge.q: 0.4, scene.hinge.v: -1.5}, rtol=1e-11)
    a, w = run[scene.hinge.q], run[scene.hinge.v]
    place = np.stack([-h * np.tan(a), 0 * a, -h + 0 * a], axis=1)
    assert np.max(np.abs(run[scene.bead.point.position] - place)) < 1e-10
    energy = 0.5 * 0.03 * w**2 + 0.5 * 0.4 * (h * w / np.cos(a) ** 2) ** 2
    assert np.ptp(energy) < 1e-9 * energy[0]
    across = np.stack([np.cos(a), 0 * a, -np.sin(a)], axis=1)
    push = run[scene.rail.frame_a.force]
    assert np.max(np.abs(push - across * np.sum(push * across, axis=1)[:, None])) < 1e-9  # the rail is smooth
    assert np.max(np.abs(run[scene.guide.frame_b.force][:, 0])) < 1e-9
    lever = np.sum(push * across, axis=1) * h / np.cos(a)
    assert np.max(np.abs(0.03 * run[scene.arm.frame.angular_acceleration][:, 1] - (-lever if back else lever))) < 1e-8


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_a_weld_carries_what_the_body_behind_it_needs(size: float):
    """Newton and Euler for a body whose centre of mass is off its weld, which itself is on a body that tumbles about a ball joint."""
    scene, mass, moments = ac.System(), 2.0, np.array([0.3, 0.2, 0.25]) * size**2
    centre, g = np.array([0.2, -0.3, 0.5]) * size, np.array([0, 0, -9.81]) * size
    scene.world, scene.joint = World(gravity=tuple(g)), Spherical()
    scene.near = RigidBody(1.0, tuple(np.array([0.1, 0.2, 0.15]) * size**2), (0.1 * size, 0, 0.2 * size))
    scene.bracket, scene.far = (
        Fixed((0.3 * size, 0.2 * size, -0.1 * size), rotation=("x", 0.4)),
        RigidBody(mass, tuple(moments), tuple(centre)),
    )
    scene.connect(scene.world.frame, scene.joint.frame_a)
    scene.connect(scene.joint.frame_b, scene.near.frame)
    scene.connect(scene.near.at((0.1 * size, 0.2 * size, 0.3 * size)), scene.bracket.frame_a)
    scene.connect(scene.bracket.frame_b, scene.far.frame)
    run = ac.build(scene).simulate(1.0, {scene.near.frame.angular_velocity: (1.0, 2.0, -1.5)}, samples=5)
    end = scene.far.frame
    for k in range(5):
        R = run[end.rotation][k]
        w, w_dot, a = (
            R.T @ run[end.angular_velocity][k],
            R.T @ run[end.angular_acceleration][k],
            R.T @ (run[end.acceleration][k] - g),
        )
        force = mass * (a + np.cross(w_dot, centre) + np.cross(w, np.cross(w, centre)))
        torque = moments * w_dot + np.cross(w, moments * w) + np.cross(centre, force)
        np.testing.assert_allclose(R.T @ run[end.force][k], force, atol=1e-12 * size)
        np.testing.assert_allclose(R.T @ run[end.torque][k], torque, atol=1e-12 * size**2)


def joints_as_drawn(drawn: tuple[float, float], gravity: float, names: str, first: int) -> list[tuple[str, int]]:
    """Joints of two alike double pendulums, the upper ones drawn at these angles, in the order of the states: which joint, of which pendulum."""
    scene, place = ac.System(), dict[str, tuple[str, int]]()
    scene.world = World(gravity=(0, 0, gravity))
    for k in (first, 1 - first):
        name, angle, foot = names[k], drawn[k], np.array([float(k), 0.0, 0.0])
        knee = foot - np.array([np.sin(angle), 0, np.cos(angle)])
        upper = RigidBody(1.0, (1, 1, 1), position=foot, rotation=("y", angle))
        lower = RigidBody(1.0, (1, 1, 1), position=knee)
        hip, joint = Revolute("y"), Revolute("y")
        for kind, part in (("upper", upper), ("lower", lower), ("hip", hip), ("knee", joint)):
            setattr(scene, f"{kind}_{name}", part)
        joined(scene, scene.world.at(foot), hip, upper.frame, upper.at((0, 0, -1)), joint, lower.frame)
        place |= {f"{kind}_{name}.q": (kind, k) for kind in ("hip", "knee")}
    return [place[name] for name in ac.build(scene).state_names if name in place]


@pytest.mark.parametrize(
    ("drawn", "gravity"),
    [((0.9, 0.2), 0.0), ((0.3, np.pi + 0.3), -9.81)],
    ids=["by distances", "by heights, at a centre of symmetry"],
)
def test_alike_joints_are_told_apart_by_where_they_are_drawn_not_by_their_names(drawn, gravity):
    orders = [joints_as_drawn(drawn, gravity, names, first) for names in ("ab", "ba") for first in (0, 1)]
    assert orders[0] == orders[1] == orders[2] == orders[3]
