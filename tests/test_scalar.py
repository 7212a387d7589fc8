"""Scalar equations: aliases, index reduction, choice of states, blocks, nonlinear loops, coupling with joints, messages."""

from __future__ import annotations

import cProfile
import pstats
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import acausal as ac
from acausal import errors
from acausal.scalar.equations import EquationSet, ScalarEquation, Unknown
from acausal.scalar.index_reduction import differentiation_counts
from acausal.scalar.linear import SingularMatrixError, solve_linear
from acausal.scalar.matching import blocks, match, overdetermined, underdetermined
from acausal.scalar.reduction import reduce_equations
from acausal.scalar.tearing import tear
from components import (
    AngleSource,
    Capacitor,
    Constant,
    CurrentSource,
    Diode,
    ElectromotiveForce,
    Gain,
    Gear,
    Ground,
    IdealDiode,
    Inductor,
    Inertia,
    Integrator,
    PositionSource,
    Resistor,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalSpring,
    RotationSensor,
    SlidingMass,
    SpeedSource,
    Sum,
    Table,
    TimeFunction,
    TorqueSource,
    TranslationalDamper,
    TranslationalSpring,
    VelocitySource,
    VoltageSource,
)
from tests.scenes import FourBar, Pendulum
from tests.test_electrical import series

G = 9.81
HERE = "test_scalar.py:"


def worst_residual(model: ac.Model, x: np.ndarray, t: float = 0.3) -> float:
    """Largest violation of any component's equation at a state, by the outputs that a user would read."""
    found = 0.0
    for part in model.system.flat.parts:
        for equation in part.component.equations():
            value = model.functions.output(equation.residual)(t, x, model.system.u_defaults, model.system.p_values)
            found = max(found, float(ca.norm_inf(value)))
    return found


# --- single stages -----------------------------------------------------------------------------------------------------------------


def test_matching_and_what_is_left_over():
    """Two equations for one unknown, one for two, and a regular part, told apart."""
    incidence = [[0], [0], [1, 2], [3, 4], [4, 0]]
    owner = match(incidence, 5)
    assert sum(e >= 0 for e in owner) == 4
    over, under = overdetermined(incidence, owner), underdetermined(incidence, owner)
    assert over is not None
    assert under is not None
    assert (set(over.equations), set(over.unknowns), over.excess) == ({0, 1}, {0}, 1)
    assert (set(under.equations), set(under.unknowns), under.excess) == ({2}, {1, 2}, 1)


def test_matching_follows_long_paths():
    """A chain in which every assignment must move: no recursion, no quadratic search."""
    n = 20000
    incidence = [[k, k + 1] for k in range(n)] + [[0]]
    owner = match(incidence, n + 1)
    assert sorted(owner) == list(range(n + 1))


def test_blocks_come_in_the_order_of_solution():
    incidence = [[0, 1], [1, 2], [2, 1], [3, 0, 2]]
    assert blocks(incidence, match(incidence, 4)) == [[1, 2], [0], [3]]


def test_pantelides_on_the_pendulum():
    """x'' = -L x, y'' = -L y - g, x^2 + y^2 = 1: the constraint is differentiated twice (Pantelides 1988, example 4)."""
    offsets = differentiation_counts([{0: 2, 2: 0}, {1: 2, 2: 0}, {0: 0, 1: 0}], [0, 0, 0])
    assert offsets.equations == (0, 0, 2)
    assert offsets.unknowns == (2, 2, 0)


def test_tearing_leaves_one_unknown_of_a_ring():
    plan = tear([{0, 1}, {1, 2}, {2, 3}, {3, 0}], [{0, 1}, {1, 2}, {2, 3}, {3}])
    assert len(plan.torn) == 1
    assert len(plan.steps) == 3
    assert len(plan.residuals) == 1


@pytest.mark.parametrize("seed", range(5))
def test_linear_blocks_against_numbers(seed):
    """Random sparse matrices with some symbolic entries."""
    rng = np.random.default_rng(seed)
    n = 12
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.3) + np.diag(rng.normal(size=n) + 0.1)
    s = ca.SX.sym("s", 3)
    M = ca.sparsify(ca.SX(A))
    M[0, 0], M[3, 3], M[5, 1] = s[0], s[1], s[2]
    b = ca.SX.sym("b", n)
    constants = {s[0].element_hash()}
    x = solve_linear(
        M,
        b,
        lambda es: [float(f) for f in np.array(ca.Function("f", [s], [ca.vertcat(*es)])([0.7, 1.1, 0.9])).ravel()],
        constants,
    )
    point, right = np.array([0.3, 1.4, -0.8]), rng.normal(size=n)
    found = np.array(ca.Function("x", [s, b], [ca.vertcat(*x)])(point, right)).ravel()
    exact = np.linalg.solve(np.array(ca.DM(ca.Function("M", [s], [ca.densify(M)])(point))), right)
    print("seed", seed)
    assert np.max(np.abs(found - exact)) < 1e-9 * np.max(np.abs(exact)) * np.linalg.cond(A)


@pytest.mark.parametrize("seed", range(6))
def test_pivots_of_linear_blocks_do_not_depend_on_units(seed):
    """Rows and unknowns in other units, by powers of four: the same bits."""
    rng = np.random.default_rng(seed)
    n, s = 9, ca.SX.sym("s")
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.3) + np.diag(rng.normal(size=n) + 0.1)
    right = rng.normal(size=n)
    found: list[np.ndarray] = []
    for power in (0, 8):
        rows, columns = (4.0 ** rng.integers(-power, power + 1, n) for _ in range(2))
        M = ca.sparsify(ca.SX(A * rows[:, None] * columns))
        M[2, 2] = s  # may be of any size
        x = solve_linear(M, ca.SX(rows * right), lambda es: np.array(ca.Function("f", [s], [ca.vertcat(*es)])(1.0)), set())
        found.append(np.array(ca.Function("x", [s], [ca.vertcat(*x)])(rows[2] * columns[2])).ravel() * columns)
    print("seed", seed)
    assert np.array_equal(found[0], found[1])


def test_singular_blocks_name_their_null_vectors():
    M = ca.SX(np.array([[1.0, 2.0, 0.0], [0.0, 1.0, 1.0], [2.0, 4.0, 0.0]]))
    with pytest.raises(SingularMatrixError) as caught:
        solve_linear(ca.sparsify(M), ca.SX.sym("b", 3), lambda es: [float(e) for e in es], set())
    assert caught.value.rows == [0, 2]


def ladder(count: int) -> EquationSet:
    """`count` cells of resistor, capacitor and node: four equations each."""
    equations: list[ScalarEquation] = []
    unknowns: list[Unknown] = []
    derivatives: list[tuple[ca.SX, ca.SX]] = []
    before, last = ca.SX(1), ca.SX(0)
    for k in range(count):
        v, i, c, dv = (ca.SX.sym(f"{name}{k}") for name in ("v", "i", "c", "der(v)"))
        for s in (v, i, c):
            unknowns.append(Unknown(s, str(s)))
        derivatives.append((dv, v))
        equations += [ScalarEquation(before - v - 2 * i, f"rail{k}"), ScalarEquation(3 * dv - c, f"cap{k}")]
        if k:
            equations.append(ScalarEquation(last - i - unknowns[-4].symbol, f"node{k}"))
        before, last = v, i
    equations.append(ScalarEquation(last - unknowns[-1].symbol, "end"))
    return EquationSet(tuple(equations), tuple(unknowns), tuple(derivatives))


def test_the_work_is_near_linear_in_the_number_of_equations():
    """Function calls counted, so that the machine's speed plays no part."""
    calls: dict[int, int] = {}
    for count in (50, 200):
        system = ladder(count)
        assert len(system.equations) == 3 * count
        with cProfile.Profile() as profile:
            reduced = reduce_equations(system)
        assert len(reduced.states) == count
        calls[count] = pstats.Stats(profile).total_calls
    assert calls[200] < 4.4 * calls[50]


def test_a_long_shaft_of_gears_builds_quickly():
    """200 inertias on 199 ideal gears are one freedom, two states; the effective inertia is a sum of squares."""
    n = 200
    rng = np.random.default_rng(0)
    ratios = rng.uniform(0.9, 1.1, n - 1)
    scene = ac.System()
    scene.rotors, scene.gears = [Inertia(0.01) for _ in range(n)], [Gear(r) for r in ratios]
    scene.motor = TorqueSource(1.0)
    scene.connect(scene.motor.flange, scene.rotors[0].flange_a)
    for k in range(n - 1):
        scene.connect(scene.rotors[k].flange_b, scene.gears[k].flange_a)
        scene.connect(scene.gears[k].flange_b, scene.rotors[k + 1].flange_a)
    model = ac.build(scene)
    assert len(model.state_names) == 2
    speeds = np.concatenate([[1.0], 1 / np.cumprod(ratios)])  # of each rotor, by that of the first
    a = float(model.functions.output(ac.der(scene.rotors[0].w))(0.0, [0.2, 0.1], [], []))
    assert abs(a - 1.0 / np.sum(0.01 * speeds**2)) < 1e-12


# --- index -------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [5.0, ac.Parameter(5.0)], ids=["number", "parameter"])
def test_prescribed_angle_gives_its_torque(ratio):
    """Index 3: phi = f(t) on a geared inertia; the torque is J f''."""
    scene = ac.System()
    scene.crank, scene.rotor, scene.gear, scene.load = (
        AngleSource(lambda t: np.sin(2 * t)),
        Inertia(0.3),
        Gear(ratio),
        Inertia(4.0),
    )
    scene.other, scene.spring, scene.end = Inertia(1.0), RotationalSpring(10.0), Inertia(2.0)
    scene.connect(scene.crank.flange, scene.rotor.flange_a)
    scene.connect(scene.rotor.flange_b, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.load.flange_a)
    scene.connect(scene.other.flange_a, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.end.flange_a)
    model = ac.build(scene)
    assert len(model.state_names) == 4
    run = model.simulate(1.0, {scene.other.w: 1.0}, rtol=1e-10)
    f2 = -4 * np.sin(2 * run.t)
    assert np.max(np.abs(run[scene.crank.flange.tau] + (0.3 + 4.0 / 25) * f2)) < 1e-12
    assert np.max(np.abs(run[scene.load.w] - 0.4 * np.cos(2 * run.t))) < 1e-13
    assert run.energy_error() < 1e-9


def test_prescribed_position_and_velocity_along_a_line():
    scene = ac.System()
    scene.shaker, scene.spring, scene.mass = (
        PositionSource(lambda t: 0.1 * np.sin(3 * t)),
        TranslationalSpring(20.0),
        SlidingMass(2.0),
    )
    scene.belt, scene.damper = VelocitySource(0.5), TranslationalDamper(1.0)
    scene.connect(scene.shaker.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.mass.flange_a)
    scene.connect(scene.belt.flange, scene.damper.flange_a)
    scene.connect(scene.damper.flange_b, scene.mass.flange_b)
    model = ac.build(scene)
    run = model.simulate(3.0, rtol=1e-11)
    rhs = lambda t, y: [y[1], (20 * (0.1 * np.sin(3 * t) - y[0]) + 0.5 - y[1]) / 2]  # noqa: E731
    other = solve_ivp(rhs, (0, 3), [0, 0], "DOP853", run.t, rtol=1e-12, atol=1e-13)
    assert np.max(np.abs(run[scene.mass.s] - other.y[0])) < 1e-10
    assert run.energy_error() < 1e-9


class PlanarPendulum(ac.Component):
    """A point on a rod in Cartesian coordinates, index 3: x'' = -L x, y'' = -L y - g, x^2 + y^2 = 1."""

    x = ac.Variable("m", start=1.0)
    y = ac.Variable("m")
    vx = ac.Variable("m/s")
    vy = ac.Variable("m/s")
    L = ac.Variable("1/s^2")

    def equations(self):
        yield ac.equal(ac.der(self.x), self.vx)
        yield ac.equal(ac.der(self.y), self.vy)
        yield ac.equal(ac.der(self.vx), -self.L * self.x)
        yield ac.equal(ac.der(self.vy), -self.L * self.y - G)
        yield ac.equal(self.x * self.x + self.y * self.y, 1.0)

    def stored_energy(self):
        return 0.5 * (self.vx * self.vx + self.vy * self.vy) + G * self.y


def test_cartesian_pendulum_swings_through_every_position():
    """No choice of a coordinate lasts for a full turn: all stay states, the constraint and its rate are invariants."""
    scene = ac.System()
    scene.bob = PlanarPendulum()
    model = ac.build(scene)
    assert len(model.state_names) == 4
    run = model.simulate(5.0, {scene.bob.x: 0.6, scene.bob.y: -0.8, scene.bob.vx: 8.0}, rtol=1e-11)
    angle0 = np.arctan2(0.6, 0.8)
    w0 = np.hypot(8.0, run[scene.bob.vy][0])
    rhs = lambda t, y: [y[1], -G * np.sin(y[0])]  # noqa: E731
    other = solve_ivp(rhs, (0, 5), [angle0, w0], "DOP853", run.t, rtol=1e-13, atol=1e-13)
    assert other.y[0].max() > 2 * np.pi  # full turns
    assert np.max(np.abs(run[scene.bob.x] - np.sin(other.y[0]))) < 1e-7
    assert run.constraint_error() < 1e-13
    assert run.energy_error() < 1e-9


def test_joint_with_a_prescribed_angle():
    """A source on a joint's flange moves the arm and gives the torque that it takes."""
    scene = Pendulum()
    scene.crank = AngleSource(lambda t: 0.5 * np.sin(3 * t))
    scene.connect(scene.crank.flange, scene.hinge.flange)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 0
    run = model.simulate(2.0, rtol=1e-10)
    angle, rate2 = 0.5 * np.sin(3 * run.t), -4.5 * np.sin(3 * run.t)
    assert np.max(np.abs(run[scene.hinge.q] - angle)) < 1e-13
    assert np.max(np.abs(-run[scene.crank.flange.tau] - (rate2 / 3 + G / 2 * np.sin(angle)))) < 1e-11
    assert run.energy_error() < 1e-8


def test_gear_between_two_joints():
    """Two arms on a common gear: one freedom; against the equation by hand."""
    scene = Pendulum()
    scene.pivot, scene.arm, scene.gear = Revolute("y"), RigidBody.rod(2.0, (0, 0, -0.5)), Gear(-2.0)
    scene.connect(scene.world.at((1, 0, 0)), scene.pivot.frame_a)
    scene.connect(scene.pivot.frame_b, scene.arm.frame)
    scene.connect(scene.hinge.flange, scene.gear.flange_a)
    scene.connect(scene.pivot.flange, scene.gear.flange_b)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(3.0, {scene.hinge.q: 1.0}, rtol=1e-11)
    I1, I2 = 1 / 3, 2 * 0.25 / 3

    def rhs(t, y):
        q2 = -y[0] / 2
        return [y[1], (-G / 2 * np.sin(y[0]) + 2 * G * 0.25 * np.sin(q2) / 2) / (I1 + I2 / 4)]

    other = solve_ivp(rhs, (0, 3), [1.0, 0.0], "DOP853", run.t, rtol=1e-12, atol=1e-13)
    assert np.max(np.abs(run[scene.hinge.q] - other.y[0])) < 1e-9
    assert np.max(np.abs(run[scene.hinge.q] + 2 * run[scene.pivot.q])) < 1e-13
    assert run.energy_error() < 1e-9


def test_rotor_on_a_loop_and_a_source_on_its_cut_joint():
    """A four-bar driven at the joint that closes it, against the same at the crank's joint: power in is energy gained."""
    for where in ("a", "c"):
        scene = FourBar()
        scene.motor, scene.rotor = TorqueSource(2.0), Inertia(0.05)
        scene.connect(scene.motor.flange, scene.rotor.flange_a)
        scene.connect(scene.rotor.flange_b, getattr(scene, where).flange)
        run = ac.build(scene).simulate(0.5, {scene.a.q: -0.5, scene.a.v: 3.0}, rtol=1e-11)
        assert run.energy_error() < 1e-9
        assert run.constraint_error() < 1e-12


# --- blocks ------------------------------------------------------------------------------------------------------------------------


class Turbulent(ac.Component):
    """Two unknowns in a nonlinear loop: a + b = x, a = 2 b + b^3, and x' = -a."""

    x = ac.Variable("", start=1.0)
    a = ac.Variable("")
    b = ac.Variable("")

    def equations(self):
        yield ac.equal(self.a + self.b, self.x)
        yield ac.equal(self.a, 2 * self.b + self.b * self.b * self.b)
        yield ac.equal(ac.der(self.x), -self.a)


def test_nonlinear_loop_becomes_a_state_with_an_invariant():
    scene = ac.System()
    scene.pipe = Turbulent()
    model = ac.build(scene)
    assert model.system.x.numel() == 2
    run = model.simulate(2.0, {scene.pipe.x: 5.0}, rtol=1e-10)
    b = lambda x: brentq(lambda b: 3 * b + b**3 - x, -10, 10, xtol=1e-15)  # noqa: E731
    other = solve_ivp(lambda t, y: [b(y[0]) - y[0]], (0, 2), [5.0], "DOP853", run.t, rtol=1e-11, atol=1e-12)
    assert np.max(np.abs(run[scene.pipe.x] - other.y[0])) < 1e-8
    assert np.max(np.abs(run[scene.pipe.b] - [b(x) for x in run[scene.pipe.x]])) < 1e-12
    assert run.constraint_error() < 1e-13


def test_states_begin_where_they_say_and_what_follows_is_found():
    """x stays at its start of 1; b, which a nonlinear equation gives by it, does not move it. A start of b does."""
    scene = ac.System()
    scene.pipe = Turbulent()
    model = ac.build(scene)
    run = model.simulate(0.1)
    assert run[scene.pipe.x][0] == 1.0
    assert abs(run[scene.pipe.b][0] - brentq(lambda b: 3 * b + b**3 - 1, 0, 1, xtol=1e-15)) < 1e-14
    assert abs(model.simulate(0.1, {scene.pipe.b: 2.0})[scene.pipe.x][0] - 14) < 1e-13


class Network(ac.Component):
    """Columns of unknowns: M y = x, x' = A y."""

    x = ac.Variable("V", size=3, start=(1.0, 2.0, 3.0))
    y = ac.Variable("V", size=3)

    def __init__(self, M: np.ndarray, A: np.ndarray) -> None:
        self.M, self.A = M, A

    def equations(self):
        yield ac.equal(self.M @ self.y, self.x)
        yield ac.equal(ac.der(self.x), self.A @ self.y)


@pytest.mark.parametrize("seed", range(3))
def test_columns_of_unknowns_are_begun_and_read_by_the_names_of_their_entries_in_all_kinds_of_states(
    seed: int, tmp_path: Path
) -> None:
    rng = np.random.default_rng(seed)
    M, A = np.eye(3) + 0.3 * rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    scene = ac.System()
    scene.net = Network(M, A)
    model = ac.build(scene)
    assert model.state_names == ("net.x[0]", "net.x[1]", "net.x[2]")
    K = np.linalg.inv(M)
    for first in ([1.0, 2.0, 3.0], rng.normal(size=3)):
        named = {} if first[0] == 1.0 else dict(zip(model.state_names, first, strict=True))
        x = expm(2.0 * A @ K) @ first
        for run in (model.simulate(2.0, named, rtol=1e-11), model.minimal(named).simulate(2.0, rtol=1e-11)):
            assert run[scene.net.x][-1] == pytest.approx(x, rel=1e-9, abs=1e-9)
            assert [run[name][-1] for name in model.state_names] == pytest.approx(x, rel=1e-9, abs=1e-9)
            assert run["net.y[1]"][-1] == pytest.approx((K @ x)[1], rel=1e-9, abs=1e-9)
    model.export_simulator(tmp_path, outputs={"x": scene.net.x, "y": scene.net.y})


class Governor(ac.Component):
    """A rotor whose inertia depends on the angle: (0.2 + phi^2) w' + phi w^2 = tau; coefficients of joints' accelerations change."""

    flange = ac.Rotational.port()
    w = ac.Variable("rad/s")

    def equations(self):
        yield ac.equal(ac.der(self.flange.phi), self.w)
        yield ac.equal(self._inertia() * ac.der(self.w) + self.flange.phi * self.w * self.w, self.flange.tau)

    def stored_energy(self):
        return 0.5 * self._inertia() * self.w * self.w

    def _inertia(self):
        return 0.2 + self.flange.phi * self.flange.phi


def test_inertia_that_changes_with_the_angle():
    scene = Pendulum()
    scene.governor = Governor()
    scene.connect(scene.governor.flange, scene.hinge.flange)
    model = ac.build(scene)
    assert model.state_names == ("hinge.q", "hinge.v")
    run = model.simulate(3.0, {scene.hinge.q: 1.0}, rtol=1e-10)
    assert run.energy_error() < 1e-9


class Soft(ac.Component):
    """A torque f that is a nonlinear function of the acceleration itself: f + f^3 / 10 = 0.3 phi''."""

    flange = ac.Rotational.port()
    f = ac.Variable("N*m")

    def equations(self):
        yield ac.equal(self.flange.tau, self.f)
        yield ac.equal(self.f + 0.1 * self.f * self.f * self.f, 0.3 * ac.der(ac.der(self.flange.phi)))


def test_nonlinear_loop_through_the_acceleration_of_a_joint():
    scene = Pendulum()
    scene.soft = Soft()
    scene.connect(scene.soft.flange, scene.hinge.flange)
    run = ac.build(scene).simulate(3.0, {scene.hinge.q: 1.0}, rtol=1e-10)
    f, a = run[scene.soft.f], run[ac.der(scene.hinge.v)]
    assert np.max(np.abs(f + 0.1 * f**3 - 0.3 * a)) < 1e-13
    assert np.max(np.abs(a / 3 + G / 2 * np.sin(run[scene.hinge.q]) + f)) < 1e-13


class Planetary(ac.Component):
    """Ideal planetary gear: 3 phi_carrier = phi_sun + 2 phi_ring; tau_ring = 2 tau_sun, all torques sum to zero."""

    sun = ac.Rotational.port()
    ring = ac.Rotational.port()
    carrier = ac.Rotational.port()

    def equations(self):
        yield ac.equal(3.0 * self.carrier.phi, self.sun.phi + 2.0 * self.ring.phi)
        yield ac.equal(self.ring.tau, 2.0 * self.sun.tau)
        yield ac.equal(self.sun.tau + self.ring.tau + self.carrier.tau, 0.0)


def test_planetary_gear_on_a_joint():
    """Three inertias with one relation: two freedoms, the joint's and one more; accelerations by Lagrange's equations."""
    scene = Pendulum()
    scene.gear, scene.sun, scene.ring, scene.motor = Planetary(), Inertia(0.1), Inertia(0.2), TorqueSource(0.5)
    scene.connect(scene.gear.sun, scene.sun.flange_a)
    scene.connect(scene.gear.ring, scene.ring.flange_a)
    scene.connect(scene.gear.carrier, scene.hinge.flange)
    scene.connect(scene.motor.flange, scene.sun.flange_b)
    model = ac.build(scene)
    assert len(model.state_names) == 4
    assert model.state_names[:2] == ("hinge.q", "hinge.v")
    run = model.simulate(2.0, {scene.hinge.q: 1.0}, rtol=1e-10)
    assert np.max(np.abs(3 * run[scene.hinge.v] - run[scene.sun.w] - 2 * run[scene.ring.w])) < 1e-12
    # sun s, carrier c, ring r = (3 c - s) / 2: kinetic energy 0.05 s'^2 + 0.1 r'^2 + c'^2 / 6
    M = np.array([[0.1 + 0.2 / 4, -0.2 * 3 / 4], [-0.2 * 3 / 4, 1 / 3 + 0.2 * 9 / 4]])
    a = np.linalg.solve(M, np.array([0.5 * np.ones_like(run.t), -G / 2 * np.sin(run[scene.hinge.q])]))
    assert np.max(np.abs(run[ac.der(scene.sun.w)] - a[0])) < 1e-10
    assert np.max(np.abs(run[ac.der(scene.hinge.v)] - a[1])) < 1e-10
    assert run.energy_error() < 1e-9


def random_circuit(seed: int) -> ac.System:
    """Resistors, capacitors, inductors and sources between random nodes, all nodes reached by resistors."""
    rng = np.random.default_rng(seed)
    nodes = 6
    scene = ac.System()
    scene.ground = Ground()
    makers = [
        lambda: Resistor(rng.uniform(0.5, 2)),
        lambda: Capacitor(rng.uniform(0.5, 2)),
        lambda: Inductor(rng.uniform(0.5, 2)),
    ]
    scene.parts_ = [Resistor(rng.uniform(0.5, 2)) for _ in range(nodes - 1)]
    pairs = [(k, int(rng.integers(k))) for k in range(1, nodes)]
    for _ in range(10):
        scene.parts_.append(makers[rng.integers(3)]())
        pairs.append(tuple(int(k) for k in rng.choice(nodes, 2, replace=False)))
    scene.parts_.append(CurrentSource(lambda t: np.sin(t)))
    pairs.append((1, 3))
    pins: list[list] = [[] for _ in range(nodes)]
    pins[0].append(scene.ground.pin)
    for part, (a, b) in zip(scene.parts_, pairs, strict=True):
        pins[a].append(part.pin_a)
        pins[b].append(part.pin_b)
    for group in pins:
        scene.connect(*group)
    return scene


@pytest.mark.parametrize("seed", range(8))
def test_every_equation_holds_in_random_circuits(seed):
    scene = random_circuit(seed)
    model = ac.build(scene)
    x = np.random.default_rng(seed).normal(size=model.system.x.numel())
    print("seed", seed, model.state_names)
    assert worst_residual(model, x) < 1e-10
    assert model.simulate(1.0, rtol=1e-9).energy_error() < 1e-7


@pytest.mark.parametrize("seed", range(6))
def test_every_equation_holds_in_random_drive_trains(seed):
    """Inertias, springs, dampers and gears in random trees on a pendulum's flange."""
    rng = np.random.default_rng(seed)
    scene = Pendulum()
    scene.rotors = [Inertia(rng.uniform(0.1, 1)) for _ in range(4)]
    ends = [scene.hinge.flange, *(rotor.flange_a for rotor in scene.rotors)]
    scene.links = []
    for k in range(1, 5):
        kind = rng.integers(3)
        link = (
            Gear(rng.uniform(-3, -1))
            if kind == 0
            else RotationalSpring(rng.uniform(1, 5))
            if kind == 1
            else RotationalDamper(0.3)
        )
        scene.links.append(link)
        scene.connect(ends[rng.integers(k)], link.flange_a)
        scene.connect(link.flange_b, ends[k])
    scene.sensor, scene.gain = RotationSensor(), Gain(2.0)
    scene.connect(scene.sensor.flange, scene.rotors[2].flange_b)
    scene.connect(scene.sensor.speed, scene.gain.input)
    model = ac.build(scene)
    print("seed", seed, model.state_names)
    assert model.functions.invariants is None
    assert worst_residual(model, rng.normal(size=model.system.x.numel())) < 1e-11
    assert model.simulate(1.0, {scene.hinge.q: 1.0}, rtol=1e-9).energy_error() < 1e-7


def test_signals():
    scene = ac.System()
    scene.clock, scene.table = TimeFunction(lambda t: t), Table((0.0, 1.0, 2.0), (0.0, 1.0, 0.0))
    scene.two, scene.sum, scene.integral = Constant(2.0), Sum(1.0, -3.0), Integrator(0.5)
    scene.connect(scene.clock.output, scene.table.input)
    scene.connect(scene.table.output, scene.sum.inputs[0])
    scene.connect(scene.two.output, scene.sum.inputs[1])
    scene.connect(scene.sum.output, scene.integral.input)
    run = ac.build(scene).simulate(2.0, {scene.integral.x: 1.0}, rtol=1e-9)
    tent = np.where(run.t < 1, run.t**2 / 2, 2 * run.t - run.t**2 / 2 - 1)
    assert np.max(np.abs(run[scene.integral.output.value] - (1 + 0.5 * (tent - 6 * run.t)))) < 1e-6


def test_residual_form_of_a_scene_with_one_scalar_state():
    scene = series(VoltageSource(5.0), resistor=Resistor(2e3), capacitor=Capacitor(1e-3))
    model = ac.build(scene)
    x_dot = model.functions.explicit_dynamics(0.0, [1.0], [], [])
    assert float(ca.norm_inf(model.functions.residual_dynamics(0.0, [1.0], x_dot, [], [], []))) < 1e-15


# --- messages ----------------------------------------------------------------------------------------------------------------------


def floating() -> ac.System:
    scene = ac.System()
    scene.battery, scene.load, scene.filter, scene.other = VoltageSource(1.0), Resistor(1.0), Capacitor(1.0), Resistor(2.0)
    scene.connect(scene.battery.pin_a, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.filter.pin_a, scene.other.pin_a)
    scene.connect(scene.filter.pin_b, scene.battery.pin_b, scene.other.pin_b)
    return scene


def parallel_sources(second: float) -> ac.System:
    scene = series(VoltageSource(1.0), load=Resistor(1.0), filter=Capacitor(1.0))
    scene.spare = VoltageSource(second)
    scene.connect(scene.spare.pin_a, scene.part0.pin_a)
    scene.connect(scene.spare.pin_b, scene.part0.pin_b)
    return scene


def currents_in_series() -> ac.System:
    return series(CurrentSource(1.0), pump=CurrentSource(2.0), coil=Inductor(1.0))


def two_grounds() -> ac.System:
    scene = series(VoltageSource(1.0), load=Resistor(1.0), filter=Capacitor(1.0))
    scene.again = Ground()
    scene.connect(scene.again.pin, scene.ground.pin)
    return scene


class Jerk(ac.Component):
    """Third rate of an angle."""

    flange = ac.Rotational.port()
    j = ac.Variable("rad/s^3")

    def equations(self):
        yield ac.equal(self.flange.tau, 0.0)
        yield ac.equal(self.j, ac.der(ac.der(ac.der(self.flange.phi))))


def jerk_of_an_input() -> ac.System:
    scene = ac.System()
    scene.wish = ac.Input("rad")
    scene.crank, scene.rotor, scene.jerk = AngleSource(scene.wish), Inertia(1.0), Jerk()
    scene.connect(scene.crank.flange, scene.rotor.flange_a, scene.jerk.flange)
    return scene


def two_outputs() -> ac.System:
    scene = ac.System()
    scene.one, scene.two, scene.integral = Constant(1.0), Constant(2.0), Integrator()
    scene.connect(scene.one.output, scene.integral.input, scene.two.output)
    return scene


def loose_input() -> ac.System:
    scene = ac.System()
    scene.integral = Integrator()
    return scene


class Forgetful(ac.Component):
    """x' = -x + y, and nothing about y; z is never mentioned."""

    x = ac.Variable("m")
    y = ac.Variable("N", if_undetermined="Give y a law of its own.")
    z = ac.Variable("kg")

    def equations(self):
        yield ac.equal(ac.der(self.x), -self.x + ca_sin(self.y))


def ca_sin(value: ac.Expression) -> ac.Expression:
    return np.sin(value)


class Insistent(ac.Component):
    """Three laws for two unknowns."""

    x = ac.Variable("m")
    y = ac.Variable("m")

    def equations(self):
        yield ac.equal(ac.der(self.x), -self.x)
        yield ac.equal(np.sin(self.y), self.x)
        yield ac.equal(np.cos(self.y), self.x)


class Repeated(ac.Component):
    """Two equations that are the same for every value of the parameter."""

    x = ac.Variable("m")
    y = ac.Variable("m")
    w = ac.Variable("m")

    def __init__(self):
        self.k = ac.Parameter(2.0)

    def equations(self):
        yield ac.equal(ac.der(self.w), -self.w)
        yield ac.equal(self.k * self.x + self.y, self.w)
        yield ac.equal(2 * self.k * self.x + 2 * self.y, 3 * self.w)


class Peeping(ac.Component):
    """Uses a quantity of 3-D mechanics."""

    x = ac.Variable("m")

    def __init__(self, height):
        self.height = height

    def equations(self):
        yield ac.equal(ac.der(self.x), self.height)


def of_component(part: ac.Component) -> ac.System:
    scene = ac.System()
    scene.thing = part
    return scene


def of_another_scene() -> ac.System:
    rotor = Inertia(1.0)
    return of_component(Peeping(rotor.w))


def loose_parameter() -> ac.System:
    class Hidden(ac.Component):
        x = ac.Variable("m")

        def equations(self):
            yield ac.equal(ac.der(self.x), ac.Parameter(1.0) * self.x)

    return of_component(Hidden())


def valve_before_a_diode() -> ac.System:
    return series(VoltageSource(5.0), load=Resistor(1.0), valve=IdealDiode(), diode=Diode())


def jerk_of_a_joint() -> ac.System:
    scene = Pendulum()
    scene.jerk = Jerk()
    scene.connect(scene.jerk.flange, scene.hinge.flange)
    return scene


def two_cranks() -> ac.System:
    scene = Pendulum()
    scene.one, scene.two = AngleSource(lambda t: np.sin(t)), SpeedSource(1.0)
    scene.connect(scene.one.flange, scene.two.flange, scene.hinge.flange)
    return scene


def free_motor() -> ac.System:
    scene = series(VoltageSource(1.0), load=Resistor(1.0), filter=Capacitor(1.0))
    scene.emf, scene.gear, scene.shaft = ElectromotiveForce(0.1), Gear(3.0), Gear(2.0)
    scene.connect(scene.emf.pin_a, scene.part0.pin_a)
    scene.connect(scene.emf.pin_b, scene.part0.pin_b)
    scene.connect(scene.emf.flange, scene.gear.flange_a, scene.shaft.flange_a)
    scene.connect(scene.gear.flange_b, scene.shaft.flange_b)
    return scene


def gear_in_a_four_bar() -> ac.System:
    scene = FourBar()
    scene.gear = Gear(2.0)
    scene.connect(scene.a.flange, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.d.flange)
    return scene


MESSAGES: list[tuple[str, Callable[[], ac.System], type[Exception], tuple[str, ...]]] = [
    ("no ground", floating, errors.UnderdeterminedError, ("1 variable has no equation", "[V]", HERE, "without a Ground")),
    ("two sources that differ", lambda: parallel_sources(2.0), errors.OverdeterminedError, ("spare.v [V]", HERE, "0 = ", "given twice")),
    ("two sources that agree", lambda: parallel_sources(1.0), errors.UnderdeterminedError, ("[A]", "spare", "parallel ideal sources")),
    ("currents in series", currents_in_series, errors.OverdeterminedError, ("0 = ", "given twice")),
    ("two grounds in a node", two_grounds, errors.UnderdeterminedError, ("ground.pin.i", "again.pin.i", "Say nothing new")),
    ("jerk of an input", jerk_of_an_input, errors.OverdeterminedError, ("'wish'", "crank", "differentiated three times", "third rate", "spring")),
    ("two outputs", two_outputs, errors.OverdeterminedError, ("0 = ", "given twice", "equations")),
    ("loose input", loose_input, errors.UnconnectedError, ("integral.input", "Constant")),
    ("a law is missing", lambda: of_component(Forgetful()), errors.UnderdeterminedError, ("thing.y [N]", "thing.z [kg]", HERE, "law of its own", "1 equations, 3 unknowns")),
    ("a law too many", lambda: of_component(Insistent()), errors.OverdeterminedError, ("1 equation is too many", "equation 2 of thing", "equation 3 of thing", HERE)),
    ("laws that repeat", lambda: of_component(Repeated()), errors.UnderdeterminedError, ("depend on one another", "equation 3 of thing", "thing.x [m]")),
    ("a variable of another scene", of_another_scene, errors.UnknownVariableError, ("'w' [rad/s]", "scene.name = ")),
    ("a parameter that nobody keeps", loose_parameter, errors.UnknownVariableError, ("Parameter", "attribute")),
    ("an ideal diode in a nonlinear loop", valve_before_a_diode, errors.OverdeterminedError, ("'valve.passing'", "differentiated", "capacitor")),
    ("jerk of a joint", jerk_of_a_joint, errors.OverdeterminedError, ("jerk.j", "differentiated", "hinge")),
    ("two sources on a joint", two_cranks, errors.OverdeterminedError, ("1 equation is too many", "of two", "hinge.flange.phi [rad]", "one.flange.tau [N*m]")),
    ("a gear in a four-bar", gear_in_a_four_bar, errors.LockedError, ("gear.flange_b", "3 freedoms", "2 constraints of loops")),
    ("gears in a loop", free_motor, errors.OverdeterminedError, ("0 = ", "given twice")),
]  # fmt: skip


@pytest.mark.parametrize(("make", "kind", "words"), [case[1:] for case in MESSAGES], ids=[case[0] for case in MESSAGES])
def test_message(make, kind, words):
    with pytest.raises(kind) as caught:
        ac.build(make())
    message = str(caught.value)
    print(f"{type(caught.value).__name__}: {message}")
    for word in words:
        assert word in message
    assert len(message) < 700


def test_report_counts_what_sources_and_gears_hold():
    scene = FourBar()
    scene.drive, scene.battery, scene.load, scene.filter, scene.ground = (
        AngleSource(lambda t: -0.5 + t), VoltageSource(1.0), Resistor(1.0), Capacitor(1.0), Ground(),
    )  # fmt: skip
    scene.connect(scene.drive.flange, scene.a.flange)
    scene.connect(scene.battery.pin_a, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.filter.pin_a)
    scene.connect(scene.filter.pin_b, scene.battery.pin_b, scene.ground.pin)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 0
    assert "and 1 by sources or gears" in model.report()
    run = model.simulate(1.0, rtol=1e-10)
    assert np.max(np.abs(run[scene.a.q] - (run.t - 0.5))) < 1e-12
    assert run.constraint_error() < 1e-12
