"""What must hold for every force between two points."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.parts.force import AbstractLineForce
from components import Damper, NonlinearDamper, NonlinearSpring, RigidBody, Spring, SpringDamper, World

SAMPLES = [
    Spring(30.0, 0.4), Spring(30.0), Damper(2.0), SpringDamper(30.0, 0.4, 2.0), NonlinearSpring(lambda length: 3 * length**4 - 1 / length),
    NonlinearDamper(lambda length, rate: 3 * rate * ca.fabs(rate) / length),
]  # fmt: skip


def test_no_line_force_is_left_out():
    names = {cls.__name__ for cls in AbstractLineForce.__subclasses__() if cls.__module__.startswith("components")}
    assert names == {type(sample).__name__ for sample in SAMPLES}


@pytest.mark.parametrize("force", SAMPLES, ids=lambda f: type(f).__name__)
def test_force_is_minus_the_slope_of_its_potential_and_loses_what_it_dissipates(force):
    length, rate = ca.SX.sym("length"), ca.SX.sym("rate")
    f = ca.Function(
        "f",
        [length, rate],
        [
            force.tension(length, ca.SX(0)) - ca.gradient(force.potential(length), length),
            (force.tension(length, rate) - force.tension(length, ca.SX(0))) * rate,
        ],
    )
    for l0, r0 in ((0.7, 0.3), (1.4, -2.0)):
        gap, loss = f(l0, r0)
        assert abs(float(gap)) < 1e-13
        assert float(loss) >= 0


@pytest.mark.parametrize("force", SAMPLES, ids=lambda f: type(f).__name__)
def test_action_is_reaction_and_energy_balances(force):
    """Between two tumbling bodies: forces cancel, torques cancel about one point, the power lost is what the force says."""
    scene = ac.System()
    scene.world, scene.force = World(None), force
    scene.one, scene.two = RigidBody(1.0, (0.1, 0.2, 0.25)), RigidBody(2.0, (0.3, 0.2, 0.25), (0.1, 0, 0))
    scene.connect(force.point_a, scene.one.at((0.2, 0.1, 0)))
    scene.connect(force.point_b, scene.two.at((0, 0.3, -0.1)))
    model = ac.build(scene)
    s, outputs = model.system, model.functions.outputs
    energy = outputs.kinetic_energy + outputs.potential_energy
    fa, fb = outputs.resolve(force.point_a.force), outputs.resolve(force.point_b.force)
    ra, rb = outputs.resolve(force.point_a.position), outputs.resolve(force.point_b.position)
    balance = ca.jtimes(energy, s.x, s.x_dot) + outputs.power_loss
    f = ca.Function("f", [s.t, s.x], [fa + fb, ca.cross(ra, fa) + ca.cross(rb, fb), balance])
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, s.x.numel())
    for item in s.tree_joints:
        x[item.q.start : item.q.start + 4] /= np.linalg.norm(x[item.q.start : item.q.start + 4])
    x[s.tree_joints[1].q.start + 4] += 2.0
    for gap in f(0.0, x):
        assert np.max(np.abs(np.array(gap))) < 1e-11
