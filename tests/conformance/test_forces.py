"""What must hold for every force, also for those written later."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.parts.force import AbstractForce, AbstractLineForce, AbstractReactiveForce, Action
from acausal.parts.force_check import FreePlacement, unbalanced_power
from acausal.parts.pose import symbolic
from components import Ellipsoid, HuntCrossley, Particle, Plane, RigidBody, SmoothCoulomb, World
from components.fields import CentralField, MutualGravitation
from tests.conformance.catalogue import kinds, made

STIFF = np.random.default_rng(5).normal(size=(6, 6))
ARGUMENTS: dict[str, dict[str, object]] = {
    "Force": {"force": (1.0, 2.0, -0.5)}, "Torque": {"torque": (1.0, 2.0, -0.5)},
    "NonlinearSpring": {"potential": lambda length: 3 * length**4 - 1 / length},
    "NonlinearDamper": {"force": lambda length, rate: 3 * rate * ca.fabs(rate) / length},
    "Bushing": {"stiffness": STIFF @ STIFF.T, "damping": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)},
    "FieldForce": {"field": CentralField(3.0), "body": RigidBody(2.0, (0.2, 0.3, 0.4), (0.1, -0.2, 0.3))},
    "PairForce": {
        "field": MutualGravitation(2.0), "one": RigidBody(1.5, (0.2, 0.3, 0.4), (0.1, -0.2, 0.3)), "other": RigidBody(2.0, (0.3, 0.3, 0.4), (0, 0.1, 0)),
    },
    "Drag": {"linear": 0.3, "quadratic": 0.5, "wind": (1.0, -2.0, 0.5)},
    "MagnusForce": {"coefficient": 0.4, "wind": (1.0, -2.0, 0.5)}, "PitchingMoment": {"coefficient": 0.4},
    "ContactForce": {"shape": Ellipsoid((2.0, 3.0, 2.5)), "surface": Plane(), "law": HuntCrossley(30.0, 0.1, friction=SmoothCoulomb(0.3, 0.1))},
}  # fmt: skip
USUAL = {"stiffness": 30.0, "natural_length": 0.4, "damping": 2.0}
ALL = [
    cls(**ARGUMENTS[cls.__name__]) if cls.__name__ in ARGUMENTS else made(cls, USUAL)
    for cls in kinds(AbstractForce, (AbstractReactiveForce,))
]


class SideWind(AbstractForce):
    """Across the velocity: it does no work but rounding."""

    point = ac.Point.port()

    def __init__(self, strength: float) -> None:
        self.strength = strength

    def actions(self, placement):
        v = placement.velocity(self.point)
        return (Action(self.point, self.strength * ca.vertcat(-v[1], v[0], 0), ca.SX.zeros(3)),)

    def potential_energy(self, placement):
        return ca.SX(0)

    def power_loss(self, placement):
        return ca.SX(0)


SAMPLES = [force for force in ALL if isinstance(force, AbstractLineForce)]


@pytest.mark.parametrize("force", ALL, ids=lambda f: type(f).__name__)
def test_power_is_stored_or_lost(force):
    """Its forces at connectors that move freely do the work that its potential loses, and what it says is dissipated or supplied."""
    balance, _ = unbalanced_power(force)
    assert np.max(np.abs(balance.sum(axis=1))) < 1e-12 * (1 + np.max(np.abs(balance)))
    assert np.max(np.abs(balance)) > 0.1


@pytest.mark.parametrize("force", ALL, ids=lambda f: type(f).__name__)
def test_force_is_minus_the_slope_of_the_potential_where_nothing_moves(force):
    """At rest the potential's slope along every motion is the work of the forces, less that of forces from outside."""
    placement = FreePlacement()
    power = placement.power(force.actions(placement))
    stored = ca.SX(force.potential_energy(placement))
    gap = ca.jacobian(power + placement.rate(stored) + force.power_loss(placement), placement.y_dot)
    f = ca.Function("gap", [placement.y, placement.y_dot, placement.t], [ca.densify(gap)])
    y = np.random.default_rng(2).uniform(0.2, 1.0, placement.y.numel())
    assert np.max(np.abs(np.array(f(y, np.zeros(y.size), 0.3)))) < 1e-12


@pytest.mark.parametrize("force", [f for f in ALL if len(f.connectors()) > 1], ids=lambda f: type(f).__name__)
def test_between_parts_action_is_reaction_and_nothing_is_supplied(force):
    placement = FreePlacement()
    total, moment = ca.SX.zeros(3), ca.SX.zeros(3)
    for action in force.actions(placement):
        X = placement.pose(action.connector)
        push = symbolic(X.rotation) @ action.force
        total += push
        moment += ca.cross(symbolic(X.position), push) + symbolic(X.rotation) @ action.torque
    f = ca.Function("f", [placement.y, placement.y_dot], [total, moment, ca.SX(force.power_loss(placement))])
    rng = np.random.default_rng(3)
    for _ in range(3):
        total_, moment_, lost = (
            np.array(part) for part in f(rng.uniform(0.2, 1.0, placement.y.numel()), rng.normal(size=placement.y.numel()))
        )
        assert np.max(np.abs(total_)) < 1e-12 and np.max(np.abs(moment_)) < 1e-12
        assert lost.item() >= 0


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


@pytest.mark.parametrize("strength", [1e-12, 0.1, 3.0, 1e9])
def test_force_of_ones_own_without_power_is_taken(strength):
    """Once around a circle in the time 2 pi mass / strength."""
    scene = ac.System()
    scene.world, scene.wind, scene.leaf = World(None), SideWind(strength), Particle(1.0)
    scene.connect(scene.wind.point, scene.leaf.point)
    run = ac.build(scene).simulate(2 * np.pi / strength, {scene.leaf.point.velocity: (strength, 0, 0)}, rtol=1e-11)
    assert np.max(np.abs(run[scene.leaf.point.position][-1])) < 1e-9


class Swirl(AbstractForce):
    """Drags and turns a body by its velocities, and says nothing of energies."""

    frame = ac.Frame.port()

    def actions(self, placement):
        v, w = placement.velocity(self.frame), placement.angular_velocity(self.frame)
        return (Action(self.frame, 0.3 * ca.cross(w, v) - 0.2 * v, ca.cross(v, ca.vertcat(0, 0, 1)) - 0.1 * w),)


class Spring(Swirl):
    """A potential of the place, and nothing else."""

    def __init__(self, factor: float = 1.0) -> None:
        self.factor = factor

    def actions(self, placement):
        X = placement.pose(self.frame)
        return (Action(self.frame, -3.0 * symbolic(X.rotation).T @ symbolic(X.position), ca.SX.zeros(3)),)

    def potential_energy(self, placement):
        return 1.5 * self.factor * ca.sumsqr(symbolic(placement.pose(self.frame).position))


@pytest.mark.parametrize(("make", "loses"), [(Swirl, True), (Spring, False)])
def test_a_force_that_says_nothing_of_its_energies_is_accounted_for(make, loses):
    scene = ac.System()
    scene.world, scene.body, scene.law = World(), RigidBody(2.0, (0.2, 0.3, 0.4), (0.1, -0.2, 0.3)), make()
    scene.connect(scene.law.frame, scene.body.frame)
    start = {
        scene.body.frame.velocity: (1.0, -0.5, 2.0),
        scene.body.frame.angular_velocity: (0.4, 0.8, -0.6),
        scene.body.frame.position: (1, 0, 0),
    }
    run = ac.build(scene).simulate(2.0, start, rtol=1e-10)
    assert run.energy_error() < 1e-9
    assert (np.max(np.abs(run[scene.law.dissipated_power()])) > 0.1) == loses


def test_a_potential_by_itself_is_compared_with_its_force():
    scene = ac.System()
    scene.world, scene.body, scene.law = World(), RigidBody(2.0, (0.2, 0.3, 0.4)), Spring(0.9)
    scene.connect(scene.law.frame, scene.body.frame)
    with pytest.raises(ac.errors.ModelError, match="contradict each other"):
        ac.build(scene)
