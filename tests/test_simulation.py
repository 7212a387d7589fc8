"""What a user does with a model: start values, parameters, inputs, results, statistics, interruption."""

from __future__ import annotations

import subprocess
import sys

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from components import (
    Damper,
    Force,
    Gear,
    Inertia,
    Particle,
    Prismatic,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    Spherical,
    Spring,
    SpringDamper,
    Torque,
    TorqueSource,
    TranslationalGround,
    TranslationalSpring,
    World,
)  # fmt: skip
from tests.scenes import DoublePendulum, FourBar, Pendulum, PointPendulum

G = 9.81


def test_results_by_attribute_and_by_expression():
    scene = DoublePendulum()
    run = ac.build(scene).simulate(2.0, {scene.shoulder.q: 0.6, scene.elbow.q: 0.2}, samples=101)
    angle = run[scene.shoulder.q + scene.elbow.q]
    tip = run[scene.lower.tip.position]
    assert angle.shape == (101,)
    assert tip.shape == (101, 3)
    assert run[scene.upper.frame.rotation].shape == (101, 3, 3)
    assert np.max(np.abs(tip[:, 0] + np.sin(run[scene.shoulder.q]) + np.sin(angle))) < 1e-14
    assert np.max(np.abs(run[np.sin(scene.shoulder.q)] - np.sin(run[scene.shoulder.q]))) < 1e-15
    assert np.max(np.abs(run[ca.sin(scene.shoulder.q)] - np.sin(run[scene.shoulder.q]))) < 1e-15
    assert np.max(np.abs(run[ac.der(scene.shoulder.q)] - run[scene.shoulder.v])) == 0
    speed = run[scene.lower.tip.velocity]
    fine = run.at(run.t[50] + np.array([-1e-5, 1e-5]))[scene.lower.tip.position]
    assert np.max(np.abs((fine[1] - fine[0]) / 2e-5 - speed[50])) < 1e-8


def test_velocity_and_acceleration_are_rates():
    scene = FourBar()
    run = ac.build(scene).simulate(1.0, {scene.a.q: -0.5, scene.a.v: 3.0}, rtol=1e-12)
    h = 1e-4
    at = run.at(0.5 + h * np.array([-1, 0, 1]))
    x, v, a = (at[q] for q in (scene.coupler.tip.position, scene.coupler.tip.velocity, scene.coupler.tip.acceleration))
    assert np.max(np.abs((x[2] - x[0]) / (2 * h) - v[1])) < 1e-6
    assert np.max(np.abs((v[2] - v[0]) / (2 * h) - a[1])) < 1e-5
    assert np.max(np.abs(run[scene.coupler.tip.acceleration] - run[scene.rocker.tip.acceleration])) < 1e-9


def test_reactions_balance_every_body():
    """Newton for the coupler, from the reactions of both its hinges, one of which closes the loop."""
    scene = FourBar()
    run = ac.build(scene).simulate(1.0, {scene.a.q: -0.5, scene.a.v: 3.0}, rtol=1e-12)
    forces = run[scene.coupler.frame.force] + run[scene.coupler.tip.force]
    assert np.max(np.abs(forces - 2.0 * (run[scene.coupler.centre.acceleration] - [0, 0, -G]))) < 1e-9
    assert np.max(np.abs(run[scene.c.frame_a.force] + run[scene.coupler.tip.force])) < 1e-9
    assert np.max(np.abs(run[scene.c.frame_a.force] + run[scene.c.frame_b.force])) < 1e-9
    assert np.max(np.abs(run[scene.a.frame_a.force] + run[scene.world.frame.force])) < 1e-9


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -G), (1.0, -2.0, 3.0)])
def test_the_ground_bears_the_weight_of_what_is_fixed_to_it(gravity):
    scene, mass, centre = ac.System(), 3.0, np.array([0.4, -0.1, 0.7])
    scene.world, scene.hinge, scene.rod = (
        World(gravity),
        Revolute((0.6, 0.0, 0.8)),
        RigidBody.rod(2.0, (0.0, 1.0, -1.0), radius=0.1),
    )
    scene.base = RigidBody(mass, (0.1, 0.2, 0.25), tuple(centre))
    scene.connect(scene.world.at((0.3, 0.2, 0.1), rotation=("x", 0.4)), scene.base.frame)
    scene.connect(scene.base.at((0.5, 0.5, 1.0)), scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    run = ac.build(scene).simulate(1.0, {scene.hinge.q: 0.7}, samples=5)
    frame, pull = scene.base.frame, run[scene.hinge.frame_a.force]
    weight, begin = mass * np.array(gravity), run[frame.position]
    arm, far = run[frame.rotation] @ centre, run[scene.hinge.frame_a.position] - begin
    assert np.allclose(run[frame.force], pull - weight, atol=1e-12)
    wanted = run[scene.hinge.frame_a.torque] + np.cross(far, pull) - np.cross(arm, weight)
    assert np.allclose(run[frame.torque], wanted, atol=1e-12)


def test_hanging_rod_pulls_with_its_weight():
    scene = Pendulum(mass=2.0)
    run = ac.build(scene).simulate(1.0)
    assert np.max(np.abs(run[scene.world.frame.force] - [0, 0, -2.0 * G])) < 1e-12
    assert np.max(np.abs(run[scene.rod.frame.force] - [0, 0, 2.0 * G])) < 1e-12


def test_parameters_stay_adjustable_and_differentiable():
    """Length, mass, axis and stiffness as parameters; one build, the closed form at every value."""
    scene = ac.System()
    scene.length, scene.mass = ac.Parameter(1.0, "m"), ac.Parameter(1.0, "kg")
    scene.world, scene.hinge = World(), Revolute("y")
    scene.rod = RigidBody.rod(scene.mass, (0, 0, -scene.length))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    model = ac.build(scene)
    assert model.parameter_names == ("length", "mass")
    f = model.functions.explicit_dynamics
    for length in (0.5, 2.0):
        assert abs(float(f(0, [0.3, 0], [], [length, 3.0])[1]) + 1.5 * G / length * np.sin(0.3)) < 1e-13
    p = ca.SX.sym("p", 2)
    slope = ca.Function("slope", [p], [ca.jacobian(f(0, [0.3, 0], [], p)[1], p)])(ca.DM([0.5, 3.0]))
    assert abs(float(slope[0]) - 1.5 * G / 0.25 * np.sin(0.3)) < 1e-12
    assert abs(float(slope[1])) < 1e-12
    short = model.simulate(1.0, {scene.hinge.q: 0.1}, parameters={scene.length: 0.25})
    assert short[scene.hinge.q][-1] != model.simulate(1.0, {scene.hinge.q: 0.1})[scene.hinge.q][-1]
    assert np.max(np.abs(np.linalg.norm(short[scene.rod.tip.position], axis=1) - 0.25)) < 1e-14


def test_parameter_that_stands_only_in_an_expression():
    scene = ac.System()
    scene.world, scene.hinge = World(), Revolute("y")
    scene.rod = RigidBody.rod(ac.Parameter(1.0, "kg"), (0, 0, -2 * ac.Parameter(0.5, "m")))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    model = ac.build(scene)
    assert len(model.parameter_names) == 2
    assert (
        abs(float(model.functions.explicit_dynamics(0, [0.3, 0], [], model.system.p_values)[1]) + 1.5 * G * np.sin(0.3)) < 1e-13
    )


def test_inputs_as_numbers_and_functions():
    scene = ac.System()
    scene.push = ac.Input("N")
    scene.world, scene.rail, scene.cart, scene.force = (
        World(),
        Prismatic("x"),
        RigidBody.box(2.0, (1, 1, 1)),
        Force((scene.push, 0, 0)),
    )
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.cart.frame)
    scene.connect(scene.force.point, scene.cart.frame)
    model = ac.build(scene)
    assert model.input_names == ("push",)
    assert abs(model.simulate(2.0, inputs={scene.push: 3.0})[scene.rail.q][-1] - 3.0) < 1e-12
    run = model.simulate(2.0, inputs={scene.push: np.cos}, rtol=1e-12)
    assert np.max(np.abs(run[scene.rail.q] - (1 - np.cos(run.t)) / 2)) < 1e-11
    assert run.energy_error() < 1e-10


def test_forces_as_functions_of_time_in_world_and_body():
    scene = ac.System()
    scene.world, scene.body = World(None), RigidBody(1.0, (2.0, 2.0, 2.0))
    scene.force = Force(lambda t: (ca.sin(t), 0, 0))
    scene.torque = Torque((0, 0, 1.0), resolved_in="body")
    scene.connect(scene.force.point, scene.body.frame)
    scene.connect(scene.torque.frame, scene.body.frame)
    run = ac.build(scene).simulate(3.0, rtol=1e-12)
    assert np.max(np.abs(run[scene.body.frame.velocity][:, 0] - (1 - np.cos(run.t)))) < 1e-11
    assert np.max(np.abs(run[scene.body.frame.angular_velocity][:, 2] - run.t / 2)) < 1e-11
    assert run.energy_error() < 1e-10


def test_damped_oscillator_and_its_energy_balance():
    scene = ac.System()
    scene.world, scene.bob, scene.strut = World(None), Particle(2.0), SpringDamper(50.0, 1.0, 3.0)
    scene.connect(scene.world.frame, scene.strut.point_a)
    scene.connect(scene.strut.point_b, scene.bob.point)
    run = ac.build(scene).simulate(3.0, {scene.bob.point.position: (1.2, 0, 0)}, rtol=1e-12)
    d, w = 3.0 / 4, np.sqrt(25 - (3.0 / 4) ** 2)
    exact = 1 + 0.2 * np.exp(-d * run.t) * (np.cos(w * run.t) + d / w * np.sin(w * run.t))
    assert np.max(np.abs(run[scene.bob.point.position][:, 0] - exact)) < 1e-11
    assert run.energy[-1] < 0.1 * run.energy[0]
    assert run.energy_error() < 1e-10


def test_spring_of_length_zero_may_pass_through_its_anchor():
    scene = ac.System()
    scene.world, scene.bob, scene.spring = World(None), Particle(1.0), Spring(4.0)
    scene.connect(scene.world.frame, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.bob.point)
    run = ac.build(scene).simulate(5.0, {scene.bob.point.position: (1, 0, 0)}, rtol=1e-12)
    assert np.max(np.abs(run[scene.bob.point.position][:, 0] - np.cos(2 * run.t))) < 1e-10


def test_torsion_spring_damper_and_source_on_a_joint():
    scene = Pendulum(gravity=None)
    scene.ground, scene.spring, scene.damper = RotationalGround(), RotationalSpring(3.0, 0.2), RotationalDamper(0.1)
    scene.connect(scene.ground.flange, scene.spring.flange_a, scene.damper.flange_a)
    scene.connect(scene.spring.flange_b, scene.hinge.flange)
    scene.connect(scene.damper.flange_b, scene.hinge.flange)
    model = ac.build(scene)
    assert model.system.x.numel() == 2
    run = model.simulate(2.0, {scene.hinge.q: 1.0}, rtol=1e-12)
    d, w = 0.1 * 3 / 2, np.sqrt(9 - (0.15) ** 2)
    exact = 0.2 + 0.8 * np.exp(-d * run.t) * (np.cos(w * run.t) + d / w * np.sin(w * run.t))
    assert np.max(np.abs(run[scene.hinge.q] - exact)) < 1e-10
    assert np.max(np.abs(run[scene.spring.flange_b.tau] - 3 * (run[scene.hinge.q] - 0.2))) < 1e-13
    assert run.energy_error() < 1e-10


def test_linear_spring_on_a_slider_of_a_loop():
    """A spring on whichever joint closes the loop acts as on a joint of the tree."""
    results = []
    for where in ("a", "c"):
        scene = FourBar()
        scene.ground, scene.spring = RotationalGround(), RotationalSpring(5.0)
        scene.connect(scene.ground.flange, scene.spring.flange_a)
        scene.connect(scene.spring.flange_b, getattr(scene, where).flange)
        run = ac.build(scene).simulate(1.0, {scene.a.q: -0.5, scene.a.v: 3.0}, rtol=1e-12)
        results.append(run.energy_error())
    assert max(results) < 1e-10


def test_slider_on_a_spring():
    scene = ac.System()
    scene.world, scene.rail, scene.cart = World(), Prismatic("z"), RigidBody.box(2.0, (1, 1, 1))
    scene.ground, scene.spring = TranslationalGround(), TranslationalSpring(50.0)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.cart.frame)
    scene.connect(scene.ground.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.rail.flange)
    run = ac.build(scene).simulate(2.0, rtol=1e-12)
    assert np.max(np.abs(run[scene.rail.q] + 2 * G / 50 * (1 - np.cos(5 * run.t)))) < 1e-11


def test_geared_rotor_adds_its_inertia_and_no_state():
    scene = Pendulum()
    scene.torque = ac.Input("N*m")
    scene.motor, scene.rotor, scene.gear = TorqueSource(scene.torque), Inertia(1e-3), Gear(20.0)
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    scene.connect(scene.rotor.flange_b, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.hinge.flange)
    model = ac.build(scene)
    assert model.state_names == ("hinge.q", "hinge.v")
    a = float(model.functions.explicit_dynamics(0, [0.3, 0], [0.1], [])[1])
    assert abs(a - (-G / 2 * np.sin(0.3) + 2.0) / (1 / 3 + 0.4)) < 1e-12
    run = model.simulate(1.0, {scene.hinge.q: 0.3}, inputs={scene.torque: 0.1}, rtol=1e-11)
    assert np.max(np.abs(run[scene.rotor.w] - 20 * run[scene.hinge.v])) < 1e-12
    assert run.energy_error() < 1e-10


def test_component_of_ones_own_and_a_scene_without_mechanics():
    """DESIGN's example of a component; two rotors on a torsion spring swing against each other."""

    class Rotor(ac.Component):
        flange_a = ac.Rotational.port()
        flange_b = ac.Rotational.port()
        w = ac.Variable("rad/s", "angular velocity")

        def __init__(self, J):
            self.J = J

        def equations(self):
            yield ac.equal(self.flange_a.phi, self.flange_b.phi)
            yield ac.equal(ac.der(self.flange_a.phi), self.w)
            yield ac.equal(self.J * ac.der(self.w), self.flange_a.tau + self.flange_b.tau)

    scene = ac.System()
    scene.one, scene.two, scene.spring = Rotor(1.0), Rotor(2.0), RotationalSpring(3.0)
    scene.connect(scene.one.flange_b, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.two.flange_a)
    model = ac.build(scene)
    assert model.system.x.numel() == 4
    run = model.simulate(5.0, {scene.one.flange_a.phi: 1.0}, rtol=1e-11)
    assert np.max(np.abs(run[scene.one.flange_a.phi] - (1 / 3 + 2 / 3 * np.cos(np.sqrt(4.5) * run.t)))) < 1e-10


def test_a_thin_rod_on_the_ground_may_stand_beside_shafts():
    scene = ac.System()
    scene.world, scene.rod, scene.bob = World(), RigidBody.rod(1.0, (0, 0, 1.0)), Particle(2.0)
    scene.rotor, scene.spring, scene.wall = Inertia(2.0), RotationalSpring(8.0), RotationalGround()
    scene.connect(scene.world.frame, scene.rod.frame)
    scene.connect(scene.bob.point, scene.rod.tip)
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.rotor.flange_a)
    run = ac.build(scene).simulate(1.0, {scene.rotor.flange_a.phi: 0.3}, rtol=1e-11)
    assert np.allclose(run[scene.rotor.flange_a.phi], 0.3 * np.cos(2.0 * run.t), atol=1e-11)
    assert np.allclose(run[scene.rod.frame.force][-1], (0, 0, 3.0 * G))


def test_hierarchy_with_connectors_of_its_own():
    class Leg(ac.System):
        hip = ac.Frame.port()

        def __init__(self, length):
            self.joint, self.shank = Revolute("y"), RigidBody.rod(1.0, (0, 0, -length))
            self.connect(self.hip, self.joint.frame_a)
            self.connect(self.joint.frame_b, self.shank.frame)

    scene = ac.System()
    scene.world, scene.rail, scene.torso = World(), Prismatic("x"), RigidBody.box(5.0, (0.5, 0.3, 0.2))
    scene.legs = [Leg(0.5), Leg(0.6)]
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.torso.frame)
    for leg in scene.legs:
        scene.connect(scene.torso.frame, leg.hip)
    model = ac.build(scene)
    assert "legs[1].joint.q" in model.state_names
    run = model.simulate(1.0, {scene.legs[0].joint.q: 0.5}, rtol=1e-10)
    assert run.energy_error() < 1e-9


def test_start_values_of_any_kind():
    scene = FourBar()
    model = ac.build(scene)
    by_height = model.simulate(
        0.1, {scene.coupler.tip.position[2]: 0.75, scene.a.q: ac.near(-0.3), scene.coupler.tip.velocity[0]: 1.0}
    )
    assert abs(by_height[scene.coupler.tip.position][0, 2] - 0.75) < 1e-13
    assert abs(by_height[scene.coupler.tip.velocity][0, 0] - 1.0) < 1e-13
    by_closing_joint = model.simulate(0.1, {scene.c.q: -0.6})
    assert abs(by_closing_joint[scene.c.q][0] + 0.6) < 1e-12
    told = model.initial_state({scene.a.q: 0.5, scene.d.q: ac.near(3.0)})
    assert "near" in str(told)
    free = ac.System()
    free.world, free.body = World(None), RigidBody(1.0, (1, 2, 2.5), (0.1, 0, 0.2))
    c, s = np.cos(0.4), np.sin(0.4)
    start = {
        free.body.frame.position: (1, 2, 3),
        free.body.frame.rotation: [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        free.body.frame.velocity: (1, 0, 0),
    }
    run = ac.build(free).simulate(1.0, start)
    assert np.max(np.abs(run[free.body.frame.position] - np.stack([1 + run.t, 2 + 0 * run.t, 3 + 0 * run.t], axis=1))) < 1e-12
    assert np.max(np.abs(run[free.body.frame.rotation][-1] - [[c, -s, 0], [s, c, 0], [0, 0, 1]])) < 1e-12


def test_closing_angles_are_followed_through_full_turns():
    """A crank goes round and round: a joint that closes the loop counts turns like one of the tree."""
    angles = []
    for order in ("abcd", "acdb"):
        scene = FourBar(order=order)
        model = ac.build(scene)
        assert model.system.mechanics.mechanism.cuts[0].name == "c"
        run = model.simulate(3.0, {scene.a.q: -0.5, scene.a.v: 30.0, scene.d.q: ac.near(-0.96)}, rtol=1e-11)
        angles.append(run[scene.b.q] - run[scene.b.q][0])
    assert abs(angles[0][-1]) > 40
    assert np.max(np.abs(angles[0] - angles[1])) < 1e-7


def test_interruption_keeps_the_motion_so_far():
    scene = DoublePendulum()
    calls = []

    def stop(fraction: float) -> None:
        calls.append(fraction)
        raise KeyboardInterrupt

    model = ac.build(scene)
    run = model.simulate(1e5, {scene.shoulder.q: 2.0}, progress=stop, raise_on_failure=False)
    assert run.status.kind.name == "INTERRUPTED"
    assert 0 < calls[0] < 1
    assert 0 < run.t[-1] < 1e5
    assert np.isfinite(run[scene.elbow.q]).all()


@pytest.mark.parametrize("end", [1.0, 1e-6, 1e7])
@pytest.mark.parametrize("part", [1e-9, 1e-5, 0.5])
def test_forces_without_values_after_the_start_end_a_motion_in_words_however_early_it_is(part, end):
    scene = Pendulum()
    scene.push = Torque((0, ca.sqrt(part * end - ac.time.sx), 0))
    scene.connect(scene.push.frame, scene.rod.frame)
    with pytest.raises(ac.errors.SimulationError, match="step size fell to rounding"):
        ac.build(scene).simulate(end, t0=part * end)


def test_statistics_and_texts():
    scene = PointPendulum()
    model = ac.build(scene)
    run = model.simulate(1.0, {scene.hinge.q: 1.0})
    assert run.statistics.steps > 0
    assert run.statistics.evaluations > 0
    assert "SUCCESS" in str(run)
    assert str(model).startswith("PointPendulum: 1 degree of freedom, 2 states, no constraints")
    for stage in (model.system.flat, model.system.mechanics.mechanism, model.system.mechanics.tree, model.system):
        assert "hinge" in str(stage)


def test_dampers_lose_what_they_should():
    scene = ac.System()
    scene.world, scene.bob, scene.damper, scene.socket = World(None), RigidBody.ball(1.0, 0.1), Damper(0.7), Spherical()
    scene.connect(scene.world.frame, scene.damper.point_a)
    scene.connect(scene.damper.point_b, scene.bob.frame)
    del scene.socket
    run = ac.build(scene).simulate(2.0, {scene.bob.frame.position: (1, 0, 0), scene.bob.frame.velocity: (1, 0, 0)}, rtol=1e-12)
    assert np.max(np.abs(run[scene.bob.frame.velocity][:, 0] - np.exp(-0.7 * run.t))) < 1e-11


@pytest.mark.slow
def test_import_is_quick_and_lazy():
    code = "import sys, acausal; print([m for m in ('sympy', 'scipy', 'matplotlib', 'networkx') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
