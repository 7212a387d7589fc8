"""Optimal control: closed forms, problems transcribed by hand, loops, free geometry, and what is said where there is no optimum."""

import functools
import re
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.linalg import expm, null_space
from scipy.optimize import brentq

import acausal as ac
from acausal.errors import AccuracyWarning, OptimalControlError, OptionError
from acausal.optimal_control import attempts, solving
from acausal.optimal_control.guess import Guess
from acausal.optimal_control.lanes import Lanes, mapped, plainly
from acausal.optimal_control.mesh import Mesher
from acausal.optimal_control.near_by import NearBy
from acausal.optimal_control.search import search
from acausal.optimal_control.separable import COST, NOWHERE, Program, Term
from acausal.optimal_control.staged import staged
from acausal.optimal_control.whole import whole
from benchmarks.optimal_control import cart_pole
from components import (
    Fixed,
    Force,
    ForceSource,
    Particle,
    Planar,
    PositionSource,
    Prismatic,
    Revolute,
    RigidBody,
    Rod,
    RollingBall,
    Torque,
    TorqueSource,
    TranslationalDamper,
    TranslationalGround,
    TranslationalSpring,
    VelocitySource,
    World,
)
from tests.pairings import each_value
from tests.scenes import FourBar


class Sledge(ac.System):
    """1 kg on a rail, driven by a force."""

    def __init__(self) -> None:
        self.force = ac.Input("N")
        self.world, self.rail, self.body = World(), Prismatic("x"), Particle(1.0)
        self.motor = ForceSource(self.force)
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.body.point)
        self.connect(self.motor.flange, self.rail.flange)


class CartPole(ac.System):
    """A cart with a rod on a hinge; the force on the cart is an input."""

    def __init__(self) -> None:
        self.force = ac.Input("N")
        self.world, self.rail, self.hinge = World(gravity=(0, 0, -9.81)), Prismatic("x"), Revolute("y")
        self.cart, self.rod = RigidBody.box(1.0, (0.4, 0.2, 0.1)), RigidBody.rod(0.3, (0, 0, -0.6))
        self.motor = ForceSource(self.force)
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.cart.frame)
        self.connect(self.cart.frame, self.hinge.frame_a)
        self.connect(self.hinge.frame_b, self.rod.frame)
        self.connect(self.motor.flange, self.rail.flange)


class Pendulum(ac.System):
    """A particle on an arm of adjustable length, driven by a torque."""

    def __init__(self) -> None:
        self.torque, self.length = ac.Input("N m"), ac.Parameter(0.5, "m")
        self.world, self.hinge, self.arm = World(gravity=(0, 0, -9.81)), Revolute("y"), Fixed((0, 0, -self.length))
        self.bob, self.motor = Particle(1.0), TorqueSource(self.torque)
        self.connect(self.world.frame, self.hinge.frame_a)
        self.connect(self.hinge.frame_b, self.arm.frame_a)
        self.connect(self.arm.frame_b, self.bob.point)
        self.connect(self.motor.flange, self.hinge.flange)


class DrivenFourBar(FourBar):
    """With a torque on its crank."""

    def __init__(self) -> None:
        super().__init__()
        self.torque = ac.Input("N m")
        self.motor = TorqueSource(self.torque)
        self.connect(self.motor.flange, self.a.flange)


class Chain(ac.Component):
    """A line by its slope, which is an input."""

    y = ac.Variable("m", "height")

    def __init__(self, slope: ac.Input) -> None:
        self.slope = slope

    def equations(self) -> Iterator[ac.Equation]:
        yield ac.equal(ac.der(self.y), self.slope)


@pytest.mark.parametrize(("intervals", "size", "longer"), [(20, 1e-3, 4.0), (40, 1.0, 4.0), (16, 1e3, 3.2)])
def test_a_chain_hangs_as_a_catenary_and_points_alone_do_not_make_it_longer(intervals: int, size: float, longer: float) -> None:
    """Bernoulli's: from a height of 1 to one of 3, a unit apart; heavy chains of a given length hang as low as they can. A peak of the slope at one point of a coarse mesh seems to
    use up length, and does not.
    """
    scene = ac.System()
    scene.slope = ac.Input("")
    scene.chain = Chain(scene.slope)
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.chain.y: size})
    ocp.end({scene.chain.y: 3 * size})
    line = np.sqrt(size**2 + scene.slope**2)
    ocp.bound(ac.integral(line), longer * size, longer * size)
    ocp.minimise(ac.integral(scene.chain.y * line))
    best = ocp.solve(intervals)
    a = cast(float, brentq(lambda a: 2 * a * np.sinh(0.5 / a) - np.sqrt(longer**2 - 4), 0.05, 5))
    middle = 0.5 - a * np.arctanh(2 / longer)

    def of(x: float) -> float:  # integrals of cosh cosh
        return a / 2 * np.sinh(2 * (x - middle) / a) / 2 + x / 2

    down = 1 - a * np.cosh(-middle / a)
    exact = size**2 * (a * (of(1.0) - of(0.0)) + down * longer)
    assert abs(best.cost - exact) <= best.cost_error + 1e-12 * exact < 1e-5 * exact
    assert abs(best.true_cost - exact) < 1e-5 * exact
    assert best.violation < 1e-6 and max(best.violations.values()) < 1e-6 * longer * size
    if longer == 4.0 and size < 1:
        lie = ocp.solve(intervals, refinements=0)
        assert lie.violation > 1e-3 or lie.cost_error > abs(lie.cost - exact)
        assert lie.defect > 1e-3


def test_derivatives_of_separable_programs_are_those_of_casadi() -> None:
    rng, z, c = np.random.default_rng(0), ca.SX.sym("z", 3), ca.SX.sym("c")
    f = ca.Function("f", [z, c], [ca.vertcat(z[0] * ca.sin(z[1]) * c + z[2] ** 3, ca.sumsqr(z) * z[0])])
    rows = np.array([[NOWHERE, 1, 2, 0, COST], [COST, 3, COST, 1, 2]])
    drawn = [rng.normal(size=shape) for shape in ((3, 5), (1, 5), (2, 5))]
    term = Term(f, rng.integers(0, 8, (3, 5)), drawn[0], drawn[1], rows, drawn[2])  # some arguments are the same unknown
    linear = np.array([0, 1, 0]), np.array([2, 3, 2]), np.array([1.0, 2.0, 3.0])
    program = Program([term], linear, rng.normal(size=8), np.zeros((2, 4)), np.zeros((2, 8)), np.zeros(8))
    w, cost, of_rows = ca.MX.sym("w", 8), ca.MX.sym("cost"), ca.MX.sym("rows", 4)
    F, G = program.values(w)
    H = ca.triu(ca.hessian(cost * F + ca.dot(of_rows, G), w)[0])
    exact = ca.Function("exact", [w, cost, of_rows], [ca.gradient(F, w), ca.jacobian(G, w), H])
    at, factors = rng.normal(size=8), rng.normal(size=4)
    own = program.derivatives
    found = own["grad_f"](at, [])[1], own["jac_g"](at, [])[1], own["hess_lag"](at, [], 1.3, factors)
    for one, other in zip(found, exact(at, 1.3, factors), strict=True):
        assert np.allclose(np.array(one), np.array(other), rtol=1e-13, atol=1e-13)


def test_lanes_give_what_casadi_gives() -> None:
    """A long function at many places, by its first calls and by later ones."""
    z, c, count = ca.SX.sym("z", 3), ca.SX.sym("c"), 400
    value = ca.vertcat(z[0] * ca.sin(z[1]) * c, z[2])
    for _ in range(60):
        value = ca.vertcat(0.3 * ca.sin(value[1]) + 0.1 * value[0] * c, 0.3 * ca.cos(value[0]) - 0.1 * value[1])
    f, rng = ca.Function("f", [z, c], [value]), np.random.default_rng(0)
    at = rng.normal(size=(count, 3)), rng.normal(size=(count, 1))
    lanes, plain = mapped(f, count), plainly(f, count)
    assert isinstance(lanes, Lanes)
    for _ in range(4):
        assert np.allclose(np.array(lanes(*at)), np.array(plain(*at)), rtol=1e-12, atol=1e-12)


def test_lanes_of_a_long_cost_live_as_long_as_their_program() -> None:
    z, c, rng = ca.SX.sym("z", 2), ca.SX.sym("c"), np.random.default_rng(0)
    waves = ca.vertcat(*(ca.sin(k * z[0] * c) * ca.cos(k * z[1]) for k in range(1, 60)))
    f = ca.Function("f", [z, c], [ca.sum1(waves)])
    places, none = np.arange(800).reshape(2, 400), np.zeros(0, dtype=int)
    term = Term(f, places, np.ones((2, 400)), rng.normal(size=(1, 400)), np.full((1, 400), COST), np.ones((1, 400)))
    program = Program([term], (none, none, np.zeros(0)), np.zeros(800), np.zeros((2, 0)), np.zeros((2, 800)), np.zeros(800))
    w, at = ca.MX.sym("w", 800), rng.normal(size=800)
    exact = ca.Function("exact", [w], [ca.gradient(program.values(w)[0], w)])(at)
    for _ in range(4):
        assert np.allclose(np.array(program.derivatives["grad_f"](at, [])[1]), np.array(exact), rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_a_scene_that_best_rests_is_not_divided_for_what_rounding_makes_of_its_speed(size: float) -> None:
    scene = Sledge()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.end({scene.rail.q: size, scene.rail.v: 0.0})
    ocp.minimise(ac.integral(scene.force**2))
    best = ocp.solve(5)
    assert best.mesh.intervals == 5 and best.defect < 1e-6 and best.cost < 1e-12 * size**2


def test_a_point_is_differentiated_once_for_all_meshes() -> None:
    """And its lanes are made once: those of a delta robot cost more than the search."""
    scene = CartPole()
    ocp = ac.OptimalControl(ac.build(scene), ac.free(0.5, 5))
    ocp.start({scene.rail.q: 0.0})
    ocp.end({scene.rail.q: 1.0, scene.hinge.q: 0.0, scene.rail.v: 0.0, scene.hinge.v: 0.0})
    ocp.bound(3 * scene.force, -30, 30)
    ocp.minimise(ocp.duration)
    part = ocp.part(Mesher(4, 5, "free", "ipopt"))

    def point(mesh: Any) -> Any:
        return whole([replace(part, mesh=mesh)], []).program.terms[0].smooth

    loose = replace(part.mesh, loose=(2,))
    assert point(part.mesh) is point(part.mesh.refined(np.full(4, 2)))
    assert point(loose) is point(replace(loose, loose=(1, 3))) is not point(part.mesh)


def rest_to_rest(model: ac.Model, scene: Sledge, time: float | ac.free, size: float = 1.0) -> ac.OptimalControl:
    ocp = ac.OptimalControl(model, time)
    ocp.start({scene.rail.q: 0.0})
    ocp.end({scene.rail.q: size, scene.rail.v: 0.0})
    return ocp


def test_least_effort_from_rest_to_rest() -> None:
    """u = 6 - 12 t, cost 12 (Bryson and Ho)."""
    scene = Sledge()
    ocp = rest_to_rest(ac.build(scene), scene, 1.0)
    ocp.minimise(ac.integral(scene.force**2))
    best = ocp.solve(4)
    assert best.cost == pytest.approx(12.0, abs=1e-12)
    t = np.linspace(0, 1, 11)
    assert np.allclose(best.inputs[scene.force](t), 6 - 12 * t, atol=1e-11)
    assert best.replay_error < 1e-12
    assert best.growth == pytest.approx(
        np.linalg.norm([[1, best.x[1].max()], [0, 1]], 2), rel=0.3
    )  # of x' = v, over the whole time


@pytest.mark.parametrize(("intervals", "far", "time"), [(3, 1e-3, 0.1), (8, 0.7, 1.3), (5, 1e3, 40.0)])
def test_forces_that_are_lines_are_those_of_a_quadratic_program(intervals: int, far: float, time: float) -> None:
    """A mass is moved by forces that are straight between nodes: the least of their squares by the normal equations of hat functions, whose moments move it."""
    scene, h = Sledge(), time / intervals
    ocp = ac.OptimalControl(ac.build(scene), time)
    ocp.start({scene.rail.q: 0})
    ocp.end({scene.rail.q: far, scene.rail.v: 0.3 * far / time})
    ocp.minimise(ac.integral(scene.force**2))
    best = ocp.solve(intervals, controls="linear", refinements=0)
    t = np.linspace(0, time, intervals + 1)
    weight = np.where((t == 0) | (t == time), h / 2, h)
    G = np.diag(4 * weight) + h * (np.eye(intervals + 1, k=1) + np.eye(intervals + 1, k=-1))
    first = np.where(t == 0, h / 3, np.where(t == time, -h / 3, 0.0))  # from a node to the middle of its hat
    moments = np.array([weight, weight * (time - t - first)])
    u = np.linalg.solve(G, moments.T) @ np.linalg.solve(moments @ np.linalg.solve(G, moments.T), [0.3 * far / time, far])
    assert best.cost == pytest.approx(u @ G @ u / 6, rel=1e-9)
    assert np.allclose(best.inputs[scene.force](np.append(t[:-1], time * (1 - 1e-12))), u, rtol=0, atol=1e-8 * np.max(np.abs(u)))


def test_forces_that_are_lines_keep_their_bounds_from_the_start_on() -> None:
    """Least time comes to that of full force and full brake where nodes may move."""
    scene = Sledge()
    ocp = rest_to_rest(ac.build(scene), scene, ac.free(0.1, 10))
    ocp.bound(scene.force, -1, 1)
    ocp.minimise(ocp.duration)
    coarse, best = (ocp.solve(10, controls="linear", refinements=n) for n in (0, 8))
    force = best.inputs[scene.force](np.linspace(0, best.duration, 999))
    assert 2.0 < best.cost < 2.0 + 0.1 * (coarse.cost - 2.0)
    assert np.max(np.abs(force)) < 1 + 1e-8


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_least_time_with_bounded_force(size: float) -> None:
    """Full force, then full brake: 2 sqrt(distance / force), in any units."""
    scene = Sledge()
    ocp = rest_to_rest(ac.build(scene), scene, ac.free(0.5, 8), size)
    ocp.bound(scene.force, -size, size)
    ocp.minimise(ocp.duration)
    best = ocp.solve(10, controls="constant")
    assert best.duration == pytest.approx(2.0, abs=1e-8)
    assert np.allclose(np.abs(best.inputs[scene.force](best.t[:-1] + 1e-3)), size, rtol=1e-6)
    assert best.replay_error < 1e-8


@pytest.mark.parametrize("expression", [False, True])
def test_a_bounded_path(expression: bool) -> None:
    """Bryson and Denham's: out with speed 1 and back, not beyond 1/9: cost 4 / (9 * 1/9) = 4."""
    scene = Sledge()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.rail.q: 0.0, scene.rail.v: 1.0})
    ocp.end({scene.rail.q: 0.0, scene.rail.v: -1.0})
    if expression:
        ocp.bound(9 * scene.rail.q, upper=1)
    else:
        ocp.bound(scene.body.point.position, None, [1 / 9, None, None])
    ocp.minimise(0.5 * ac.integral(scene.force**2))
    best = ocp.solve(10, tolerance=1e-9, refinements=6)
    assert best.cost == pytest.approx(4.0, abs=1e-8)
    assert abs(best.cost - 4.0) < best.cost_error < 1e-7
    assert best.violation < 1e-8
    assert np.min(np.abs(best.mesh.nodes - 1 / 3)) < 1e-3  # where it arrives


@each_value(
    (("controls", "intervals"), [("free", 7), ("constant", 10)]), (("size", "of"), [(1e-6, 1.0), (1e6, 1.0), (1e-6, 3.0)])
)
def test_nodes_move_to_where_a_force_switches(size: float, of: float, controls: str, intervals: int) -> None:
    """Full force, at most this speed, full brake: distance / speed + speed / force, with switches between the nodes of the first mesh. That says itself how
    far from it is; and is the same where expressions (`of` times a variable) are bounded.
    """
    scene = Sledge()
    ocp = rest_to_rest(ac.build(scene), scene, ac.free(0.5, 8), size)
    ocp.bound(scene.force if of == 1 else of * scene.force, -of * size, of * size)
    ocp.bound(scene.rail.v if of == 1 else of * scene.rail.v, upper=0.7 * of * size)
    ocp.minimise(ocp.duration)
    least = 1 / 0.7 + 0.7
    fixed, best = (ocp.solve(intervals, controls=controls, refinements=n, tolerance=1e-9) for n in (0, 4))
    assert 1e-4 < abs(fixed.cost - least) < fixed.cost_error < 0.1
    assert f"(to {fixed.cost_error:.0e})" in str(fixed)
    assert best.duration == pytest.approx(least, abs=1e-8)
    assert abs(best.duration - least) < best.cost_error < 1e-7
    assert best.violation < 1e-8
    for switch in (0.7, 1 / 0.7):
        assert np.min(np.abs(best.t - switch)) < 1e-6


class Oscillator(ac.System):
    """A mass on a spring and a damper of adjustable values, driven by a force."""

    def __init__(self) -> None:
        self.force = ac.Input("N")
        self.mass, self.stiffness, self.damping = (ac.Parameter(1.0, unit) for unit in ("kg", "N/m", "N s/m"))
        self.world, self.rail, self.body = World(), Prismatic("x"), Particle(self.mass)
        self.motor, self.ground = ForceSource(self.force), TranslationalGround()
        self.spring, self.damper = TranslationalSpring(self.stiffness), TranslationalDamper(self.damping)
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.body.point)
        self.connect(self.motor.flange, self.rail.flange)
        for part in (self.spring, self.damper):
            self.connect(self.ground.flange, part.flange_a)
            self.connect(part.flange_b, self.rail.flange)


def least_quadratic_cost(m: float, k: float, c: float, q: float, time: float, x: np.ndarray, end: np.ndarray) -> float:
    """Least integral of q position^2 + force^2 from the states x to the end: by the canonical equations (Bryson and Ho, section 5.2) in short pieces."""
    A, B = np.array([[0, 1], [-k / m, -c / m]]), np.array([[0], [1 / m]])
    H = np.block([[A, -B @ B.T], [-np.diag([q, 0.0]), -A.T]])
    unit = np.array([1, np.sqrt(k / m), max(k, np.sqrt(q)) ** 2, max(k, np.sqrt(q)) ** 2 * np.sqrt(m / k)])
    H = H / unit[:, None] * unit
    n = int(np.ceil(np.max(np.abs(np.linalg.eigvals(H))) * time)) + 1
    step, M = expm(H * time / n), np.eye(4 * (n + 1), k=2)
    for i in range(n):
        M[2 + 4 * i : 6 + 4 * i, 4 * i : 4 * i + 8] = np.hstack([step, -np.eye(4)])
    M[:2, :4], M[-2:, -4:] = np.eye(4)[:2], np.eye(4)[:2]
    z = np.linalg.solve(M, np.concatenate([x / unit[:2], np.zeros(4 * n), end / unit[:2]])).reshape(-1, 4) * unit
    return float(z[0, 2:] @ x - z[-1, 2:] @ end)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_an_optimum_does_not_understate_how_far_its_cost_is_from_the_least(size: float) -> None:
    """Of oscillators drawn at random, brought from one place to another at least quadratic cost, on coarse meshes and on fine ones."""
    scene, rng = Oscillator(), np.random.default_rng(3)
    model = ac.build(scene)
    for _ in range(10):
        m, k, c = np.exp(rng.normal(0, 1, 3)).tolist()
        time, q = rng.uniform(0.5, 12) * np.sqrt(m / k), k**2 * rng.choice([0.0, 1.0, 100.0])
        x, end = size * np.array([1.0, rng.choice([0.0, np.sqrt(k / m)])]), size * np.array([rng.choice([0.0, 0.5]), 0.0])
        ocp = ac.OptimalControl(model, time, parameters={scene.mass: m, scene.stiffness: k, scene.damping: c})
        ocp.start({scene.rail.q: x[0], scene.rail.v: x[1]})
        ocp.end({scene.rail.q: end[0], scene.rail.v: end[1]})
        ocp.minimise(ac.integral(scene.force**2 + q * scene.rail.q**2))
        best = ocp.solve(int(rng.choice([5, 10, 20])), order=int(rng.choice([3, 5, 7])), refinements=int(rng.choice([0, 4])))
        off = abs(best.cost - least_quadratic_cost(m, k, c, q, time, x, end)) / best.cost
        said = best.cost_error / best.cost
        assert off < said + 1e-13, (off, said)
        assert said < 30 * max(off, best.defect, 1e-12), (off, said)


@pytest.mark.parametrize(("order", "intervals", "size"), [(5, 20, 1e-6), (5, 40, 1.0), (7, 10, 1e6)])
def test_a_least_time_that_small_errors_change_much_says_so(order: int, intervals: int, size: float) -> None:
    """From four times as far as the force holds the spring it takes two half swings, pi/2 each, and nothing less or more: a millionth of the way off, and a time shorter by a
    thousandth would do.
    """
    scene = Oscillator()
    ocp = ac.OptimalControl(ac.build(scene), ac.free(0.1, 10), parameters={scene.stiffness: 4.0, scene.damping: 0.0})
    ocp.start({scene.rail.q: size})
    ocp.end({scene.rail.q: 0.0, scene.rail.v: 0.0})
    ocp.bound(scene.force, -size, size)
    ocp.minimise(ocp.duration)
    best = ocp.solve(intervals, order=order)
    assert abs(best.duration - np.pi) < best.cost_error < 5e-3
    assert best.defect < 1e-6 and best.violation < 1e-6


class Lag(ac.Component):
    """Follows an input by and by."""

    y = ac.Variable("K", "temperature")

    def __init__(self, wanted: ac.Input, time: float) -> None:
        self.wanted, self.time = wanted, time

    def equations(self) -> Iterator[ac.Equation]:
        yield ac.equal(self.time * ac.der(self.y), self.wanted - self.y)


@pytest.mark.parametrize(("time", "most"), [(0.01, 5.0), (0.02, 1.5), (0.003, 4.0)])
def test_a_mesh_that_misses_what_is_fast_says_what_its_cost_is_worth(time: float, most: float) -> None:
    """What follows an input comes to 1 by full power, and stays: the first points of a coarse mesh come later than that."""
    scene = ac.System()
    scene.wanted = ac.Input("K")
    scene.lag = Lag(scene.wanted, time)
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.lag.y: 0.0})
    ocp.bound(scene.wanted, -most, most)
    ocp.minimise(ac.integral((scene.lag.y - 1) ** 2))
    best = ocp.solve(10, refinements=0)
    off = np.log(most / (most - 1)), 1 / most  # in these times; what is left of the exponential then is 1 - 1 / most
    least = time * ((1 - most) ** 2 * off[0] + 2 * (1 - most) * most * off[1] + most**2 * (1 - (1 - 1 / most) ** 2) / 2)
    assert 1e-5 < abs(best.cost - least) < best.cost_error


def test_a_least_time_that_is_nearly_solved_says_how_far_it_is() -> None:
    """From six times as far as the force holds the spring: three half swings, where finer meshes are solved to fewer digits."""
    scene = Oscillator()
    ocp = ac.OptimalControl(ac.build(scene), ac.free(0.5, 30), parameters={scene.damping: 0.0})
    ocp.start({scene.rail.q: 6.0})
    ocp.end({scene.rail.q: 0.0, scene.rail.v: 0.0})
    ocp.bound(scene.force, -1, 1)
    ocp.minimise(ocp.duration)
    best = ocp.solve()
    assert abs(best.duration - 3 * np.pi) < best.cost_error < 2e-2


def least_time_of_a_swing(far: float) -> float:
    """From rest so far off to rest at zero, of a unit mass on a unit spring, by a force between -1 and 1: x + i v turns about the force; the first turn is about -1, the last one comes to
    zero, and between them are half turns (Pontryagin et al.: The Mathematical Theory of Optimal Processes, 1962, section 5).
    """
    for halves in range(20):
        center = (-1.0) ** halves

        def first_ends(last: float, center: float = center, halves: int = halves) -> complex:
            z = center - center * np.exp(1j * last)
            for k in range(halves):
                z = 2 * center * (-1.0) ** (k + 1) - z
            return z

        def off(last: float, ends: Callable[[float], complex] = first_ends) -> float:
            return abs(ends(last) + 1) - (far + 1)

        if off(0.0) * off(np.pi) <= 0:
            last = cast(float, brentq(off, 0.0, np.pi, xtol=1e-14))
            return float(-np.angle(first_ends(last) + 1) % (2 * np.pi)) + halves * np.pi + last
    raise AssertionError(far)


@pytest.mark.parametrize("far", [5.0, 6.5])
def test_least_times_are_found_that_are_longer_than_the_guess(far: float) -> None:
    """A swing against a force that holds it at a fifth of its width: nothing is as short as the guess."""
    scene = Oscillator()
    ocp = ac.OptimalControl(ac.build(scene), ac.free(0.5, 30), parameters={scene.damping: 0.0})
    ocp.start({scene.rail.q: far})
    ocp.end({scene.rail.q: 0.0, scene.rail.v: 0.0})
    ocp.bound(scene.force, -1, 1)
    ocp.minimise(ocp.duration)
    best = ocp.solve()
    assert best.duration == pytest.approx(least_time_of_a_swing(far), abs=1e-4)
    assert best.iterations < 700


def test_a_search_that_would_cost_too_much_gives_what_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    """And how good that is: full force and brake, with a switch between two nodes."""
    scene = Sledge()
    ocp = rest_to_rest(ac.build(scene), scene, ac.free(0.5, 8))
    ocp.bound(scene.force, -1, 2)
    ocp.minimise(ocp.duration)
    exact, whole_search = np.sqrt(3.0), ocp.solve(5)
    monkeypatch.setattr(solving, "_DEAR", 1)
    with pytest.warns(AccuracyWarning, match="Between the points of the mesh bounds are left: force by"):
        brief = ocp.solve(5)
    assert f"bounds are left by {brief.violation:.1e} between points" in str(brief)
    assert brief.iterations < whole_search.iterations
    assert abs(whole_search.duration - exact) < 1e-6 < abs(brief.duration - exact) < brief.cost_error < 0.1


def test_nodes_that_were_found_stay_found_on_finer_meshes() -> None:
    """A pole swings up in least time on a short rail, with many switches: two meshes come to the same time, within what they say."""
    scene = CartPole()
    ocp = ac.OptimalControl(ac.build(scene), ac.free(0.3, 6))
    ocp.start({scene.rail.q: 0, scene.hinge.q: 0})
    ocp.end({scene.rail.q: 0, scene.hinge.q: np.pi, scene.rail.v: 0, scene.hinge.v: 0})
    ocp.bound(scene.force, -15, 15)
    ocp.bound(scene.rail.q, -0.45, 0.45)
    ocp.minimise(ocp.duration)
    one, other = ocp.solve(22), ocp.solve(18)
    assert max(one.cost_error, other.cost_error) < 1e-4
    assert abs(one.cost - other.cost) < one.cost_error + other.cost_error


class Bead(ac.Component):
    """It slides down a wire whose slope is an input: three states, and no place of any body."""

    x, y, v = ac.Variable("m", "along"), ac.Variable("m", "down"), ac.Variable("m/s", "speed")

    def __init__(self, angle: ac.Input) -> None:
        self.angle = angle

    def equations(self) -> Iterator[ac.Equation]:
        yield ac.equal(ac.der(self.x), self.v * np.cos(self.angle))
        yield ac.equal(ac.der(self.y), self.v * np.sin(self.angle))
        yield ac.equal(ac.der(self.v), 9.81 * np.sin(self.angle))


class Slide(ac.System):
    """A bead, and the slope of its wire."""

    def __init__(self) -> None:
        self.angle = ac.Input("rad")
        self.bead = Bead(self.angle)


@each_value((("along", "down"), [(3.0, 1.2), (1.0, 2.0)]), ("bounded", [True, False]))
def test_a_bead_slides_down_in_least_time_where_all_states_are_scalars(along: float, down: float, bounded: bool) -> None:
    """The cycloid of Johann Bernoulli: radius (angle - sin angle, 1 - cos angle), in the time angle sqrt(radius / g). Angles of points that are whole turns
    apart are the same slopes, but not between the points.
    """
    scene = Slide()
    ocp = ac.OptimalControl(ac.build(scene), ac.free(0.1, 10))
    ocp.start({scene.bead.x: 0, scene.bead.y: 0, scene.bead.v: 0})
    ocp.end({scene.bead.x: along, scene.bead.y: down})
    if bounded:
        ocp.bound(scene.angle, -np.pi / 2, np.pi / 2)
    ocp.minimise(ocp.duration)
    best = ocp.solve()
    assert best.mesh.intervals == 20
    angle = cast(float, brentq(lambda a: (a - np.sin(a)) / (1 - np.cos(a)) - along / down, 0.1, 6.2))
    exact = angle * np.sqrt(down / (1 - np.cos(angle)) / 9.81)
    assert abs(best.duration - exact) < best.cost_error < 1e-8
    assert np.max(np.abs(np.diff(best.motion.values[:, -1]))) < 0.5
    assert best.replay_error < 1e-8


class Rocket(ac.Component):
    """Straight up through air that thins out: three states of scalars, thousands of metres and tens of kilograms."""

    h, v, m = ac.Variable("m", "height"), ac.Variable("m/s", "speed"), ac.Variable("kg", "mass")

    def __init__(self, thrust: ac.Input) -> None:
        self.thrust = thrust

    def equations(self) -> Iterator[ac.Equation]:
        drag = 0.01 * self.v**2 * np.exp(-self.h / 8000)
        yield ac.equal(ac.der(self.h), self.v)
        yield ac.equal(self.m * ac.der(self.v), self.thrust - drag - 9.81 * self.m)
        yield ac.equal(ac.der(self.m), -self.thrust / 1500)


class Launch(ac.System):
    """A rocket and its thrust."""

    def __init__(self) -> None:
        self.thrust = ac.Input("N")
        self.rocket = Rocket(self.thrust)


@pytest.mark.parametrize(("size", "far", "up"), [(1.0, 8.0, 0.0), (1e-3, 3.0, 2.0), (1e3, 5.0, -4.0)])
def test_a_ball_is_thrown_as_slowly_as_can_be(size: float, far: float, up: float) -> None:
    """v^2 = g (h + sqrt(h^2 + d^2)) (Torricelli); all entries of its first velocity are free at once, and nothing drives it."""
    scene: Any = ac.System()
    scene.world, scene.ball = World((0, 0, -9.81)), Particle(0.4)
    place, speed, far, up = scene.ball.point.position, scene.ball.point.velocity, far * size, up * size
    least, fast = 9.81 * (up + np.hypot(far, up)), (9.81 * size) ** 0.5
    ocp = ac.OptimalControl(ac.build(scene), ac.free(0.1 * (size / 9.81) ** 0.5, 20 * (size / 9.81) ** 0.5))
    ocp.start({place: (0, 0, 0), speed: ac.free(-9 * fast, 9 * fast)})
    ocp.end({place: (0.6 * far, 0.8 * far, up)})
    ocp.minimise(ac.at_start(speed[0] ** 2 + speed[1] ** 2 + speed[2] ** 2))
    assert ocp.solve(4).cost == pytest.approx(least, rel=1e-9)


def test_a_rocket_climbs_along_a_singular_arc() -> None:
    """Goddard's: full thrust, then so much that drag (1 + speed / exhaust speed) = weight, then none. Bryson and Ho (1975), section 8.4."""
    scene = Launch()
    r = scene.rocket
    ocp = ac.OptimalControl(ac.build(scene), ac.free(5, 200))
    ocp.start({r.h: 0, r.v: 0, r.m: 100})
    ocp.end({r.m: 40, r.v: (0, 1000)})
    ocp.bound(scene.thrust, 0, 3000)
    ocp.bound(r.m, 40, 100)
    ocp.minimise(-ac.at_end(r.h))
    best = ocp.solve(30, refinements=2)
    h, v, m = best.x
    arc = (m > 50) & (m < 70)
    assert np.count_nonzero(arc) > 20
    assert np.max(np.abs(0.01 * v**2 * np.exp(-h / 8000) * (1 + v / 1500) / (9.81 * m) - 1)[arc]) < 0.01
    assert best.replay_error < 1e-3


def test_the_largest_cost_of_all_is_no_least_one() -> None:
    """At rest the slopes of minus the squared speed vanish; elsewhere it falls for ever."""
    scene = Sledge()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.rail.q: 0})
    ocp.minimise(-ac.integral(scene.rail.v**2))
    with pytest.raises(OptimalControlError, match=r"no least value.*ran away"):
        ocp.solve(5)


@each_value(
    (
        ("size", "least", "most", "speed", "controls"),
        [
            (1.0, -0.8, 0.5, 0.0, "free"),
            (4e-6, -0.2, 0.9, -0.2, "constant"),
            (6e5, -0.2, 0.9, 0.0, "constant"),
            (1e-6, -0.5, 0.9, 0.0, "free"),
        ],
    ),
    ("kind", [0, 1, 2]),
)
def test_a_cost_that_is_bent_downwards_is_least_at_one_of_its_ends(
    size: float, least: float, most: float, speed: float, controls: str, kind: int
) -> None:
    """Minus the square of where it is or of how fast, all the time or at the end: full force one way, and not the other, though that is best, too, near by; at rest the cost is the
    largest of all, and stationary.
    """
    scene, T = Sledge(), 2.2
    ocp = ac.OptimalControl(ac.build(scene), T)
    ocp.start({scene.rail.q: 0, scene.rail.v: speed * size})
    ocp.bound(scene.force, least * size, most * size)
    place, rate = scene.rail.q, scene.rail.v
    ocp.minimise((-ac.integral(place**2), -ac.integral(rate**2), -ac.at_end(place**2))[kind])

    def square(u: float) -> float:
        v = speed
        squares = v * v * T**3 / 3 + v * u * T**4 / 4 + u * u * T**5 / 20, v * v * T + v * u * T * T + u * u * T**3 / 3
        return (*squares, (v * T + u * T * T / 2) ** 2)[kind]

    best = ocp.solve(6, controls=controls)
    exact = -max(square(least), square(most)) * size**2
    assert abs(best.cost - exact) <= best.cost_error + 1e-12 * abs(exact) < 1e-6 * abs(exact)


@pytest.mark.parametrize(("time", "intervals"), [(4.456, 11), (2.206, 14)])
def test_forces_that_are_best_at_their_bounds_say_what_a_mesh_leaves_of_them(time: float, intervals: int) -> None:
    """The largest mean square is that of any that switch: of polynomials that do so in many intervals much is left, and told."""
    scene, most = Sledge(), float(np.sqrt(20 / time))
    ocp = ac.OptimalControl(ac.build(scene), time)
    ocp.start({scene.rail.q: 0})
    ocp.bound(scene.force, -most, most)
    ocp.minimise(-ac.integral(scene.force**2))
    free, held = ocp.solve(intervals), ocp.solve(intervals, controls="constant")
    assert abs(free.cost + 20) < free.cost_error and free.violation < 1e-6
    assert abs(held.cost + 20) < held.cost_error < 1e-6


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_search_that_begins_at_what_was_found_ends_soon(size: float) -> None:
    """On the same mesh, where forces and a speed are at their bounds: within a few steps, and at the same cost."""
    scene = Sledge()
    ocp = rest_to_rest(ac.build(scene), scene, ac.free(0.1, 10), size)
    ocp.bound(scene.force, -size, size)
    ocp.bound(scene.rail.v, -0.7 * size, 0.7 * size)
    ocp.minimise(ocp.duration)
    best = ocp.solve(15)
    assert best.cost == pytest.approx(1 / 0.7 + 0.7, rel=1e-9)
    assert best.sharper is not None
    before = best.sharper.parts[0]
    part = replace(before, mesh=replace(best.mesh, loose=before.mesh.loose), guess=best.motion)
    _, cost, *_, stats = search(whole([part], []).program, "ipopt", {}, warm=True)
    assert stats["success"]
    assert stats["iter_count"] < 10
    assert cost == pytest.approx(best.cost, rel=1e-9)


def test_what_a_search_near_by_loses_is_searched_from_afar(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a finer mesh it may run off to where the cost is much more."""
    scene = Sledge()
    ocp = rest_to_rest(ac.build(scene), scene, ac.free(0.5, 8))
    ocp.bound(scene.force, -1, 2)
    ocp.minimise(ocp.duration)
    search = attempts.search

    def astray(program: Any, plugin: str, options: Any, *, warm: bool, **named: Any) -> Any:
        w, cost, *rest = search(program, plugin, options, warm=warm, **named)
        return w, 3 * cost if warm else cost, *rest

    monkeypatch.setattr(attempts, "search", astray)
    assert ocp.solve(5).cost == pytest.approx(np.sqrt(3.0), abs=1e-6)


def test_what_stands_in_the_way_is_named_with_when() -> None:
    """Too weak for so far in so short a time: the force pulls one way, then the other, to stand at the end."""
    scene = Sledge()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.rail.q: 0})
    ocp.end({scene.rail.q: 1, scene.rail.v: 0})
    ocp.bound(scene.force, -1, 1)
    with pytest.raises(OptimalControlError) as failed:
        ocp.solve(8, guesses=0)
    said = str(failed.value)
    assert "rail.q at 1 s" in said or "rail.q is" in said
    assert "At its limits came: force between 0" in said and "1 s." in said


def test_what_nothing_moves_yet_may_run_away() -> None:
    """At rest, nothing pushed: units of forces come from what inertia resists, and a cost without a least value is said to have none."""
    scene = Sledge()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.rail.q: 0.3})
    ocp.minimise(ac.at_end(-scene.rail.v))
    with pytest.raises(OptimalControlError, match="no least value, or bounds are missing"):
        ocp.solve(6)


def test_bounds_are_named_by_what_stands_in_them() -> None:
    scene = Sledge()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.rail.q: 0.3})
    ocp.bound(scene.force, 1, 2)
    ocp.bound(scene.force + scene.rail.v, -2, -1)
    ocp.minimise(ac.integral(scene.force**2))
    with pytest.raises(OptimalControlError, match=r"could not be met: .*\(force\+rail\.v\)"):
        ocp.solve(6)


@pytest.mark.parametrize("solver", ["ipopt", "piqp"])
def test_a_cart_pole_swings_up_as_its_textbook_equations_say(solver: str) -> None:
    """The same collocation of the equations of textbooks, written by hand for `ca.Opti`."""
    ocp = cart_pole()
    best = ocp.solve(30, solver=solver, refinements=0)
    assert best.cost == pytest.approx(cart_pole_by_hand(30, best), rel=1e-8)
    fine = ocp.solve(30, solver=solver, tolerance=1e-8)
    assert fine.defect < 1e-8
    assert fine.replay_error < 10 * fine.growth * fine.mesh.intervals * 1e-8
    assert fine.cost == pytest.approx(best.cost, rel=1e-4)  # of a mesh of 30 intervals


def cart_pole_by_hand(intervals: int, best: Any) -> float:
    """The least cost near a motion: thin rod of 0.3 kg and 0.6 m on a cart of 1 kg, angle from hanging."""
    m, half, g, end, c = 0.3, 0.3, 9.81, 2.0, np.array([0, *ca.collocation_points(3, "radau")])
    opti = ca.Opti()
    X = opti.variable(4, 3 * intervals + 1)
    U = opti.variable(1, 3 * intervals)
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    s, k = ca.sin(x[1]), ca.cos(x[1])
    # the rod's tip is at -half (sin, cos) from the cart, with inertia 4/3 m half^2 about the hinge
    M = ca.vertcat(ca.horzcat(1 + m, -m * half * k), ca.horzcat(-m * half * k, 4 / 3 * m * half**2))
    f = ca.vertcat(u - m * half * s * x[3] ** 2, -m * g * half * s)
    rate = ca.Function("rate", [x, u], [ca.vertcat(x[2:], ca.solve(M, f))])
    C, _, b = ca.collocation_coeff(c[1:].tolist())
    h, cost = end / intervals, 0
    for i in range(intervals):
        block, own = X[:, 3 * i : 3 * i + 4], U[3 * i : 3 * i + 3]
        for j in range(3):
            opti.subject_to(block @ C[:, j] == h * rate(block[:, j + 1], own[j]))
            cost += h * b[j] * own[j] ** 2
    opti.subject_to(X[:, 0] == 0)
    opti.subject_to(X[:, -1] == ca.DM([0, np.pi, 0, 0]))
    opti.subject_to(opti.bounded(-20, U, 20))
    opti.minimize(cost)
    tau = np.append(0, (np.arange(intervals)[:, None] + c[1:]).ravel() / intervals)
    opti.set_initial(X, best.run.at(2 * tau).x)
    opti.set_initial(U, np.array([v(2 * tau[1:] - 1e-9) for v in best.inputs.values()]))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-10})
    return float(opti.solve().value(opti.f))


def shot(model: ac.Model, begin: Any, end: dict[int, float], time: float, best: Any) -> float:
    """The least integral of the square of one force, held in each interval, by multiple shooting with `model.step` in Opti, from a motion that was found. `end`: by numbers of states."""
    n, step = best.mesh.intervals, model.step("radau", 5, time / best.mesh.intervals)
    opti = ca.Opti()
    X, U = opti.variable(len(best.x), n + 1), opti.variable(1, n)
    for k in range(n):
        opti.subject_to(X[:, k + 1] == step(0, X[:, k], U[k], model.functions.space.p_values)[0])
    opti.subject_to(X[:, 0] == ca.DM(begin))
    opti.subject_to(X[list(end), n] == ca.DM(list(end.values())))
    opti.subject_to(opti.bounded(-20, U, 20))
    opti.minimize(ca.sumsqr(U) * time / n)
    opti.set_initial(X, best.x + 1e-3 * np.random.default_rng(0).normal(size=best.x.shape))
    (force,) = best.inputs.values()
    opti.set_initial(U, force((np.arange(n) + 0.5) * time / n))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-11, "bound_relax_factor": 0.0})
    return float(opti.solve().value(opti.f))


@pytest.mark.parametrize(("intervals", "far", "time"), [(4, 0.02, 0.1), (9, 3.0, 1.3)])
def test_shooting_by_steps_is_collocation_with_its_points_inside(intervals: int, far: float, time: float) -> None:
    """Held forces from rest to rest: 12 m^2 d^2 / (T^3 (1 - 1 / n^2))."""
    scene = Sledge()
    model = ac.build(scene)
    ocp = rest_to_rest(model, scene, time, far)
    ocp.minimise(ac.integral(scene.force**2))
    best = ocp.solve(intervals, controls="constant", refinements=0)
    least = 12 * far**2 / time**3 / (1 - intervals**-2)
    assert best.cost == pytest.approx(least, rel=1e-9)
    assert shot(model, [0, 0], {0: far, 1: 0}, time, best) == pytest.approx(least, rel=1e-9)


def test_shooting_by_steps_swings_a_cart_pole_up_as_collocation_does() -> None:
    """The same optimum, to what the solvers leave."""
    ocp = cart_pole()
    best = ocp.solve(25, controls="constant", refinements=0, guesses=0)
    assert shot(ocp.model, np.zeros(4), dict(enumerate([0, np.pi, 0, 0])), 2.0, best) == pytest.approx(best.cost, rel=1e-11)


def test_what_was_found_is_read_by_its_polynomials() -> None:
    """States to the power of the points, others to one less, in intervals that differ."""
    mesh = Mesher(3, 5, "free", "ipopt").mesh([0.4])
    times = np.append(0.0, mesh.points.ravel())
    values = np.column_stack([2 - times + 4 * times**3, 1 - 3 * times**2])
    found, at = Guess(times, values, 1.0, np.zeros(0), mesh, 1), np.append(np.linspace(0, 1, 23), mesh.nodes)
    assert np.allclose(found.at(at), np.column_stack([2 - at + 4 * at**3, 1 - 3 * at**2]), rtol=1e-13, atol=1e-13)


def stand_up(time: float, *, driven: bool) -> ac.OptimalControl:
    """Two rods, from hanging; the elbow has a torque, the shoulder has one where it is `driven`."""
    scene: Any = ac.System()
    scene.torque = ac.Input("N m")
    scene.world, scene.shoulder, scene.elbow = World(gravity=(0, 0, -9.81)), Revolute("y"), Revolute("y")
    scene.upper, scene.lower = RigidBody.rod(1.0, (0, 0, -1.0)), RigidBody.rod(1.0, (0, 0, -1.0))
    scene.motor = TorqueSource(scene.torque)
    scene.connect(scene.world.frame, scene.shoulder.frame_a)
    scene.connect(scene.shoulder.frame_b, scene.upper.frame)
    scene.connect(scene.upper.tip, scene.elbow.frame_a)
    scene.connect(scene.elbow.frame_b, scene.lower.frame)
    scene.connect(scene.motor.flange, scene.elbow.flange)
    cost = scene.torque**2
    if driven:
        scene.other = ac.Input("N m")
        scene.second = TorqueSource(scene.other)
        scene.connect(scene.second.flange, scene.shoulder.flange)
        cost = cost + scene.other**2
    ocp = ac.OptimalControl(ac.build(scene), time)
    ocp.start({scene.shoulder.q: 0, scene.elbow.q: 0})
    ocp.end({scene.shoulder.q: np.pi, scene.elbow.q: 0, scene.shoulder.v: 0, scene.elbow.v: 0})
    ocp.minimise(ac.integral(cost))
    return ocp


def test_swings_of_its_own_are_tried_on_the_way() -> None:
    """Near the straight path two driven rods stand up at 36.8; near that with a swing of their own, at 20.9. What is found on a mesh is not left where that is made finer."""
    ocp = stand_up(3.0, driven=True)
    straight, best = ocp.solve(30, guesses=0), ocp.solve(30)
    assert straight.cost == pytest.approx(ocp.solve(60, order=7, guesses=0).cost, rel=1e-3)
    assert best.cost < 0.6 * straight.cost
    assert best.defect < 1e-6


def test_a_torque_that_is_held_makes_an_acrobot_stand_up_as_a_free_one() -> None:
    """At a cost that is no less, and little more: near 22.4. On the mesh that was asked for, and on one of half its lengths, nothing is true; what is found there
    leads to three times that.
    """
    ocp = stand_up(4.0, driven=False)
    ocp.bound("torque", -40, 40)
    free, held = ocp.solve(20), ocp.solve(20, controls="constant")
    assert 0 < held.cost / free.cost - 1 < 0.01 and held.cost < 23
    assert max(free.defect, held.defect) < 1e-6


def test_wheels_whose_torques_are_held_turn_a_satellite_in_least_time() -> None:
    """Alike about all axes: about the one through its corners all wheels pull all the time, for 2 sqrt(angle J / torque) together; other ways are little faster. J: of the
    body with wheels across.
    """
    scene: Any = ac.System()
    scene.world, scene.body = World(gravity=None), RigidBody(100.0, (25.0, 25.0, 25.0))
    scene.torques = [ac.Input("N m") for _ in range(3)]
    scene.wheels = [RigidBody.disk(4.0, 0.25, axis) for axis in "xyz"]
    scene.bearings = [Revolute(axis) for axis in "xyz"]
    scene.motors = [TorqueSource(torque) for torque in scene.torques]
    for wheel, bearing, motor in zip(scene.wheels, scene.bearings, scene.motors, strict=True):
        scene.connect(scene.body.frame, bearing.frame_a)
        scene.connect(bearing.frame_b, wheel.frame)
        scene.connect(motor.flange, bearing.flange)
    frame, turn = scene.body.frame, 2 * np.pi / 3
    ocp = ac.OptimalControl(ac.build(scene), ac.free(5, 300))
    ocp.start(
        {frame.position: (0, 0, 0), frame.velocity: (0, 0, 0), frame.rotation: np.eye(3), frame.angular_velocity: (0, 0, 0)}
    )
    ocp.end({frame.rotation: ac.rotations.axis_angle((1, 1, 1), turn), frame.angular_velocity: (0, 0, 0)})
    for torque in scene.torques:
        ocp.bound(torque, -0.5, 0.5)
    ocp.minimise(ocp.duration)
    best = ocp.solve(10, controls="constant")
    straight = 2 * np.sqrt(turn * (25.0 + 2 * 4.0 * 0.25**2 / 4) / (np.sqrt(3) * 0.5))
    assert 0.95 * straight < best.duration < straight * (1 + 1e-6)
    assert best.defect < 1e-6


class Delta(ac.System):
    """A plate on three pairs of rods of equal length, each on an arm that a torque turns."""

    def __init__(self) -> None:
        self.world, self.plate = World(gravity=(0, 0, -9.81)), RigidBody(0.3, (1e-4, 1e-4, 2e-4))
        self.torques = [ac.Input("N m") for _ in range(3)]
        self.ways = [np.array((np.cos(a), np.sin(a), 0.0)) for a in 2 * np.pi / 3 * np.arange(3)]
        across = [np.array((-y, x, 0.0)) for x, y, _ in self.ways]
        self.hips = [Revolute(tuple(one)) for one in across]
        self.arms = [RigidBody.rod(0.3, tuple(0.25 * one)) for one in self.ways]
        self.motors, self.rods = [TorqueSource(one) for one in self.torques], [Rod(0.5) for _ in range(6)]
        for k, way in enumerate(self.ways):
            self.connect(self.world.at(tuple(0.2 * way)), self.hips[k].frame_a)
            self.connect(self.hips[k].frame_b, self.arms[k].frame)
            self.connect(self.motors[k].flange, self.hips[k].flange)
            for side, rod in ((-0.04, self.rods[2 * k]), (0.04, self.rods[2 * k + 1])):
                self.connect(self.arms[k].at(tuple(0.25 * way + side * across[k])), rod.frame_a)
                self.connect(self.plate.at(tuple(0.05 * way + side * across[k])), rod.frame_b)


@pytest.fixture(scope="module")
def pick_and_place() -> tuple[Delta, ac.OptimalControl]:
    """Up over something, and down again elsewhere."""
    scene = Delta()
    place, speed = scene.plate.frame.position, scene.plate.frame.velocity
    ocp = ac.OptimalControl(ac.build(scene), 0.5)
    ocp.start({place: (-0.1, 0, -0.4)})
    ocp.at(0.5, {place[2]: (-0.33, np.inf)})
    ocp.end({place: (0.1, 0.05, -0.4), speed: (0, 0, 0)})
    ocp.minimise(ac.integral(sum(one**2 for one in scene.torques)))
    return scene, ocp


def test_what_a_loop_keeps_from_turning_is_not_asked_to_turn(pick_and_place: Any) -> None:
    """As the plate of a delta robot: no row of its program follows from the others."""
    _, ocp = pick_and_place
    program = whole([ocp.part(Mesher(2, 5, "free", "ipopt"))], []).program
    beside = program.guess + 0.01 * np.random.default_rng(0).normal(size=program.size)
    J = np.array(program.derivatives["jac_g"](beside, [])[1])[:, program.bounds[0] < program.bounds[1]]
    assert np.linalg.matrix_rank(J, 1e-9 * np.linalg.norm(J, 2)) == program.rows


def test_a_delta_robot_picks_and_places_as_its_plate_alone_says(pick_and_place: Any) -> None:
    """Lagrange's equations for the place of the plate, by which the angles of the arms are known in closed form, transcribed by hand for Opti."""
    (scene, ocp), n, s = pick_and_place, 6, 5
    best = ocp.solve(n, order=2 * s - 1, refinements=0, guesses=0)
    p, v, torques, g = ca.SX.sym("p", 3), ca.SX.sym("v", 3), ca.SX.sym("torques", 3), 9.81
    angles = list[ca.SX]()
    for way in scene.ways:
        r = p + 0.05 * way - 0.2 * way
        a, b, c = ca.dot(r, way), -r[2], (ca.sumsqr(r) + 0.25**2 - 0.5**2) / 0.5  # a cos + b sin = c
        angles.append(ca.atan2(b, a) - ca.acos(c / ca.sqrt(a**2 + b**2)))
    hips = ca.vertcat(*angles)
    inertia, J = 0.3 * 0.25**2 / 3, ca.jacobian(hips, p)
    height = 0.3 * g * p[2] - 0.3 * g * 0.125 * ca.sum1(ca.sin(hips))
    forces = J.T @ (torques - inertia * ca.jtimes(J @ v, p, v)) - ca.jacobian(height, p).T
    rate = ca.Function(
        "rate", [ca.vertcat(p, v), torques], [ca.vertcat(v, ca.solve(0.3 * ca.SX.eye(3) + inertia * J.T @ J, forces))]
    )
    C, _, weights = ca.collocation_coeff(ca.collocation_points(s, "radau"))
    opti, h = ca.Opti(), 0.5 / n
    X, U, cost = opti.variable(6, s * n + 1), opti.variable(3, s * n), 0
    for i in range(n):
        block, own = X[:, s * i : s * (i + 1) + 1], U[:, s * i : s * (i + 1)]
        opti.subject_to(ca.vec(block @ C - h * rate.map(s)(block[:, 1:], own)) == 0)
        cost += h * ca.sum1(own**2) @ weights
    opti.subject_to(X[:, 0] == ca.DM([-0.1, 0, -0.4, 0, 0, 0]))
    opti.subject_to(X[2, s * (n // 2)] >= -0.33)
    opti.subject_to(X[:, -1] == ca.DM([0.1, 0.05, -0.4, 0, 0, 0]))
    opti.minimize(cost)
    times = np.append(0.0, best.mesh.points.ravel())
    opti.set_initial(X[:3, :], np.array([-0.1, 0, -0.4])[:, None] + np.outer([0.2, 0.05, 0.0], times))
    opti.solver(
        "ipopt", {"print_time": False, "expand": True}, {"print_level": 0, "sb": "yes", "tol": 1e-10, "bound_relax_factor": 0.0}
    )
    solved = opti.solve()
    assert best.cost == pytest.approx(float(solved.value(cost)), rel=1e-8)
    assert best.run[scene.plate.frame.position][-1] == pytest.approx([0.1, 0.05, -0.4], abs=1e-5)


def test_a_four_bar_stays_closed_and_turns_at_least_cost() -> None:
    """Loops are closed to rounding at every node; the cost is that of the same motion in one coordinate."""
    scene = DrivenFourBar()
    model = ac.build(scene)
    ocp = ac.OptimalControl(model, 1.0)
    ocp.start({scene.a.q: 0.3})
    ocp.end({scene.a.q: 0.3 + 2 * np.pi, scene.a.v: 0.0})
    ocp.minimise(ac.integral(scene.torque**2))
    best = ocp.solve(30)
    invariants = model.functions.invariants
    assert invariants is not None
    gaps = [np.max(np.abs(np.array(invariants(t, x, 0, [])))) for t, x in zip(best.t, best.x.T, strict=True)]
    assert max(gaps) < 1e-12
    assert best.defect < 1e-6
    assert best.run[scene.a.q][-1] == pytest.approx(0.3 + 2 * np.pi, abs=1e-4)
    work = best.run.kinetic_energy + best.run.potential_energy + best.run.energy_loss
    assert np.ptp(work) < 1e-8 * np.max(best.run.kinetic_energy)


class Press(ac.System):
    """A slider-crank that is turned by a torque, against a damper at its slider."""

    def __init__(self) -> None:
        self.torque = ac.Input("N m")
        self.world = World(gravity=(0, 0, -9.81))
        self.crank, self.pin, self.wrist, self.guide = Revolute("y"), Revolute("y"), Revolute("y"), Prismatic("x")
        self.arm, self.rod = RigidBody.rod(1.0, (0.15, 0, 0)), RigidBody.rod(1.0, (0.5, 0, 0))
        self.slider = RigidBody.box(2.0, (0.1, 0.1, 0.08))
        self.motor, self.work, self.ground = TorqueSource(self.torque), TranslationalDamper(40.0), TranslationalGround()
        self.connect(self.world.frame, self.crank.frame_a, self.guide.frame_a)
        self.connect(self.crank.frame_b, self.arm.frame)
        self.connect(self.arm.tip, self.pin.frame_a)
        self.connect(self.pin.frame_b, self.rod.frame)
        self.connect(self.rod.tip, self.wrist.frame_a)
        self.connect(self.wrist.frame_b, self.slider.frame)
        self.connect(self.guide.frame_b, self.slider.frame)
        self.connect(self.motor.flange, self.crank.flange)
        self.connect(self.ground.flange, self.work.flange_a)
        self.connect(self.work.flange_b, self.guide.flange)


def test_a_slider_crank_turns_as_in_one_coordinate() -> None:
    """A cycle of least effort, loops closed to rounding, and the cost is that of the textbook's one equation for the angle of the crank."""
    scene = Press()
    model = ac.build(scene)
    turn = ac.OptimalControl(model, 0.5)
    turn.start({scene.crank.q: 0.0, scene.crank.v: ac.free(2, 40, 12)})
    turn.periodic(turns={scene.crank.q: 1})
    turn.minimise(ac.integral(scene.torque**2))
    best = turn.solve(32, order=13, refinements=0, guesses=0)
    assert model.functions.invariants is not None
    gaps = [np.max(np.abs(np.array(model.functions.invariants(t, x, 0, [])))) for t, x in zip(best.t, best.x.T, strict=True)]
    assert max(gaps) < 1e-12
    assert best.cost == pytest.approx(press_by_hand(32, 7, best), rel=1e-8)


def press_by_hand(intervals: int, stages: int, best: Any) -> float:
    """The least cost near a motion: kinetic energy M(q) q'^2 / 2, height of gravity and the slider's way by the crank's angle alone."""
    r, rod, g, x, u = 0.15, 0.5, 9.81, ca.SX.sym("x", 2), ca.SX.sym("u")
    q, v = x[0], x[1]
    lean = ca.asin(r / rod * ca.sin(q))
    way = r * ca.cos(q) + rod * ca.cos(lean)
    middle = ca.vertcat((r * ca.cos(q) + way) / 2, r * ca.sin(q) / 2)
    M = r**2 / 3 + ca.sumsqr(ca.jacobian(middle, q)) + rod**2 / 12 * ca.jacobian(lean, q) ** 2 + 2.0 * ca.jacobian(way, q) ** 2
    height = -g * r * ca.sin(q)
    force = u - 0.5 * ca.jacobian(M, q) * v**2 - ca.jacobian(height, q) - 40.0 * ca.jacobian(way, q) ** 2 * v
    rate = ca.Function("rate", [x, u], [ca.vertcat(v, force / M)])
    C, _, b = ca.collocation_coeff(ca.collocation_points(stages, "radau"))
    opti, h = ca.Opti(), 0.5 / intervals
    X, U, cost = opti.variable(2, stages * intervals + 1), opti.variable(1, stages * intervals), 0
    for i in range(intervals):
        block, own = X[:, stages * i : stages * (i + 1) + 1], U[:, stages * i : stages * (i + 1)]
        opti.subject_to(ca.vec(block @ C - h * rate.map(stages)(block[:, 1:], own)) == 0)
        cost += h * own**2 @ b
    opti.subject_to(X[0, 0] == 0)
    opti.subject_to(X[:, -1] - X[:, 0] == ca.DM([2 * np.pi, 0]))
    opti.minimize(cost)
    at = best.motion.at(np.append(0.0, best.mesh.points.ravel()))
    names = list(best.model.state_names)
    opti.set_initial(X, at[:, [names.index("crank.q"), names.index("crank.v")]].T)
    opti.set_initial(U, at[1:, -1:].T)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-10})
    return float(opti.solve().value(opti.f))


def test_reactions_are_bounded_by_name() -> None:
    scene = Pendulum()
    model = ac.build(scene)

    def swing(limit: float) -> ac.OptimalControl:
        ocp = ac.OptimalControl(model, 1.5)
        ocp.start({scene.hinge.q: 0.0})
        ocp.end({scene.hinge.q: np.pi, scene.hinge.v: 0.0})
        ocp.bound(scene.hinge.frame_b.force[2], -limit, limit)
        ocp.minimise(ac.integral(scene.torque**2))
        return ocp

    free, bounded = swing(100.0).solve(20), swing(14.0).solve(20)
    assert np.max(np.abs(free.run[scene.hinge.frame_b.force[2]])) > 25
    assert np.max(np.abs(bounded.run[scene.hinge.frame_b.force[2]])) < 14.2
    assert bounded.cost > free.cost
    with pytest.raises(OptimalControlError, match=r"No optimum was found.*could not be met") as failed:
        swing(2.0).solve(10, guesses=1)
    assert failed.value.best.x.shape == (2, 11)


def up_with_bounded_reactions() -> ac.OptimalControl:
    """A pendulum whose hinge bears 14 N along the arm."""
    scene = Pendulum()
    ocp = ac.OptimalControl(ac.build(scene), 1.5)
    ocp.start({scene.hinge.q: 0.0})
    ocp.end({scene.hinge.q: np.pi, scene.hinge.v: 0.0})
    ocp.bound(scene.hinge.frame_b.force[2], -14.0, 14.0)
    ocp.minimise(ac.integral(scene.torque**2))
    return ocp


def a_turn_of_a_four_bar() -> ac.OptimalControl:
    """From rest, in a second."""
    scene = DrivenFourBar()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.a.q: 0.3})
    ocp.end({scene.a.q: 0.3 + 2 * np.pi, scene.a.v: 0.0})
    ocp.minimise(ac.integral(scene.torque**2))
    return ocp


@pytest.mark.parametrize("problem", [up_with_bounded_reactions, a_turn_of_a_four_bar, cart_pole])
def test_other_solvers_find_what_ipopt_finds(problem: Callable[[], ac.OptimalControl]) -> None:
    """On a mesh twice as fine, whether steps of quadratic programs lead there or it has to be ipopt; and from that on another one, in few steps."""
    ocp = problem()
    near, most = ocp.solve(12, refinements=0), {"fatrop": 40, "piqp": 10}
    for intervals in (24, 31):
        ocp.guess(near)
        near, *found = (ocp.solve(intervals, solver=solver, refinements=0) for solver in ("ipopt", *most))
        for best in found:
            assert best.cost == pytest.approx(near.cost, rel=1e-7)
            assert np.allclose(best.x, near.x, rtol=0, atol=1e-4 * np.ptp(near.x))
    assert all(best.iterations < least for best, least in zip(found, most.values(), strict=True))


@each_value(
    ("problem", [up_with_bounded_reactions, a_turn_of_a_four_bar, cart_pole]),
    (("intervals", "controls"), [(5, "free"), (8, "constant")]),
)
def test_a_program_in_stages_is_the_same_program(problem: Callable[[], ac.OptimalControl], intervals: int, controls: str) -> None:
    """The same cost and constraints anywhere, rows that carry on what intervals begin with are met, and each stage knows its own and that before alone."""
    program = whole([problem().part(Mesher(intervals, 5, controls, "fatrop"))], []).program
    assert program.stages is not None
    found = staged(program, program.stages)
    assert found is not None
    w = program.guess + np.random.default_rng(0).normal(size=program.size)
    (cost, rows), (own, all_rows) = program.values(w), found.program.values(w[found.sources])
    assert float(own) == pytest.approx(float(cost), rel=1e-12)
    more = np.array(all_rows).ravel()
    assert np.allclose(more[found.rows], np.array(rows).ravel(), rtol=1e-12, atol=1e-12)
    assert np.allclose(np.delete(more, found.rows), 0.0, atol=1e-12)
    width, sizes = found.sizes["nx"][0] + found.sizes["nu"][0], found.sizes
    count = np.add(sizes["ng"], [*sizes["nx"][1:], 0])
    i, j = (np.array(part) for part in found.program.derivatives["jac_g"].sparsity_out(1).get_triplet())
    at, ahead = np.repeat(np.arange(count.size), count)[i], j // width
    carried = np.isin(i, found.rows, invert=True)
    assert np.all((ahead == at) | (carried & (ahead == at + 1) & (j % width < sizes["nx"][0])))


def test_what_reaches_over_all_intervals_is_left_to_ipopt() -> None:
    """The mean of a torque."""
    scene = Pendulum()
    ocp = ac.OptimalControl(ac.build(scene), 1.5)
    ocp.start({scene.hinge.q: 0.0})
    ocp.end({scene.hinge.q: 1.0, scene.hinge.v: 0.0})
    ocp.bound(ac.integral(scene.torque), upper=2.0)
    ocp.minimise(ac.integral(scene.torque**2))
    program = whole([ocp.part(Mesher(6, 5, "free", "fatrop"))], []).program
    assert program.stages is not None and staged(program, program.stages) is None
    ipopt, other = (ocp.solve(6, solver=solver, refinements=0) for solver in ("ipopt", "fatrop"))
    assert other.cost == ipopt.cost and other.iterations == ipopt.iterations


def quadratic_program(H: np.ndarray, slope: np.ndarray, J: np.ndarray, limits: np.ndarray, bounds: np.ndarray) -> Program:
    """Least w' H w / 2 + slope' w."""
    n = slope.size
    z, none = ca.SX.sym("z", n), ca.SX.sym("none", 0)
    term = Term(
        ca.Function("square", [z, none], [ca.bilin(ca.DM(H), z, z) / 2]), np.arange(n)[:, None], np.ones((n, 1)), np.zeros((0, 1)),
        np.array([[COST]]), np.ones((1, 1)),
    )  # fmt: skip
    i, j = np.indices(J.shape).reshape(2, -1)
    return Program([term], (i, j, J.ravel()), slope, limits, bounds, np.zeros(n))


@pytest.mark.parametrize("seed", range(20))
def test_a_least_cost_near_by_is_met_with_all_that_presses_and_no_other(seed: int) -> None:
    """Convex quadratic programs drawn at random, from the solution of another one beside: what is found meets the conditions of Karush, Kuhn and Tucker, which make it the least. Bent
    downwards, or with bounds that contradict rows, nothing is said to be a least cost.
    """
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(3, 15)), int(rng.integers(1, 4))
    A, J, slope = rng.normal(size=(n, n)), rng.normal(size=(m, n)), 3 * rng.normal(size=n)
    H, inside = A @ A.T + 0.5 * np.eye(n), rng.uniform(-1, 1, n)
    bounds = inside + np.array([-rng.uniform(0.1, 2, n), rng.uniform(0.1, 2, n)])
    bounds[:, 0], bounds[1, rng.uniform(size=n) < 0.3] = inside[0], np.inf
    limits = J @ inside + np.array([-rng.uniform(0, 1, m), rng.uniform(0, 1, m)]) * (np.arange(m) > 0)
    beside = quadratic_program(H, slope + 0.1 * rng.normal(size=n), J, limits, bounds)
    w, _, factors, *_ = search(beside, "ipopt", {}, warm=False)
    z = -(H @ w + beside.cost + J.T @ factors)
    found = NearBy(quadratic_program(H, slope, J, limits, bounds))(w, z, factors, bounds)
    assert found is not None
    w, z, factors, _ = found
    assert np.max(np.abs(H @ w + slope + J.T @ factors + z)) < 1e-8
    for value, pull, (lower, upper) in ((w, z, bounds), (J @ w, factors, limits)):
        assert np.all((value > lower - 1e-9) & (value < upper + 1e-9))
        open_ones, side = lower < upper, np.where(value - lower < upper - value, -1, 1)
        inner = open_ones & (value > lower + 1e-8) & (value < upper - 1e-8)
        assert np.all(np.abs(pull[inner]) < 1e-8) and np.all((pull * side)[open_ones] > -1e-8)
    none, wide = (np.zeros(n), np.zeros(m)), np.repeat([[-np.inf], [np.inf]], n, axis=1)
    bent = H - 1.5 * np.linalg.eigvalsh(H)[-1] * np.eye(n)
    assert NearBy(quadratic_program(bent, slope, J, limits, wide))(inside, *none, wide) is None
    tight = np.array([inside - 1e-3, inside + 1e-3])
    assert NearBy(quadratic_program(H, slope, J, limits + 100, tight))(inside, *none, tight) is None


@pytest.mark.parametrize("seed", range(20))
def test_a_least_cost_is_told_from_a_saddle_by_inertia(seed: int) -> None:
    """Of quadratic programs drawn at random: as the curvature along what constraints and bounds leave."""
    rng = np.random.default_rng(seed)
    n, rows = int(rng.integers(3, 12)), int(rng.integers(0, 3))
    A, J = rng.normal(size=(n, n)), rng.normal(size=(rows, n))
    H = A + A.T + 2 * np.sqrt(n) * rng.uniform(0, 2) * np.eye(n)
    limits, bounds = np.zeros((2, rows)), np.repeat([[-np.inf], [np.inf]], n, axis=1)
    program = quadratic_program(H, np.zeros(n), J, limits, bounds)
    loose = np.append(rng.uniform(size=n) < 0.8, rng.uniform(size=rows) < 0.3)
    free, held = np.flatnonzero(loose[:n]), J[~loose[n:]]
    along = np.eye(n)[:, free] @ null_space(held[:, free]) if held.size else np.eye(n)[:, free]
    curvature = np.linalg.eigvalsh(along.T @ H @ along) if along.shape[1] else np.ones(1)
    assert program.bent_downwards(np.zeros(n), np.zeros(rows), loose) == (curvature[0] < 0)


def test_a_length_is_found_with_the_motion() -> None:
    """Held out at an angle the torque is m g l sin(angle): least where the arm is shortest, and the bound holds to rounding."""
    scene = Pendulum()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.hinge.q: 0.0})
    ocp.end({scene.hinge.q: np.pi, scene.hinge.v: 0.0})
    ocp.optimise(scene.length, 0.2, 0.8)
    ocp.minimise(ac.integral(scene.torque**2))
    best = ocp.solve(15)
    assert best.parameters[scene.length] == pytest.approx(0.2, abs=1e-9)
    assert best.replay_error < 1e-3


def test_what_is_given_at_the_start_holds_where_coordinates_are_free() -> None:
    """Also where the free ones are as many as there are coordinates."""
    scene = Pendulum()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.bob.point.position[0]: 0.3, scene.hinge.q: ac.free(-1.5, 1.5, -0.5)})
    ocp.end({scene.hinge.q: 0.0})
    ocp.minimise(ac.integral(scene.torque**2))
    assert np.sin(ocp.solve(4, refinements=0).x[0, 0]) == pytest.approx(-0.3 / 0.5, abs=1e-9)


def test_a_periodic_motion_ends_as_it_began() -> None:
    scene = DrivenFourBar()
    ocp = ac.OptimalControl(ac.build(scene), ac.free(0.3, 3))
    ocp.start({scene.a.q: 0.3, scene.a.v: ac.free(0.0, 30.0)})
    ocp.periodic(turns={scene.a.q: 1})
    ocp.bound(scene.torque, -60, 60)
    ocp.minimise(ocp.duration + 0.001 * ac.integral(scene.torque**2))
    best = ocp.solve(20)
    names = ac.build(scene).state_names
    change = dict(zip(names, best.x[:, -1] - best.x[:, 0], strict=True))
    assert change["a.q"] == pytest.approx(2 * np.pi, abs=1e-9)
    assert max(abs(change[name]) for name in names if name.endswith(".v")) < 1e-8 * np.max(np.abs(best.x))


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda s, m: ac.OptimalControl(m, 0.0), "must be positive"),
        (lambda s, m: ac.OptimalControl(m, ac.free(2, 1)), "lower bound must be below"),
        (lambda s, m: ac.OptimalControl(m, 1.0).bound(s.force, 3, -3), "which cross"),
        (lambda s, m: ac.OptimalControl(m, 1.0).bound(s.body.point.position, (0, 0, 0), (1, 1)), "position: .* does not fit"),
        (
            lambda s, m: ac.OptimalControl(m, 1.0).minimise(s.force**2),
            r"minimise: .*force.* says not when it counts. Write ac.integral\(.*force",
        ),
        (lambda s, m: ac.OptimalControl(m, ac.free(cast(Any, "a"), 1)), "give numbers, ac.free"),
        (lambda s, m: ac.integral(cast(Any, "force")), r"integral: 'force' is no expression\. Write it .* ac\.integral\(scene"),
        (lambda s, m: ac.at_end(cast(Any, None)), "at_end: None is no expression"),
        (lambda s, m: ac.average(cast(Any, ac.integral(1.0))), "is no expression"),
        (lambda s, m: ac.integral(s.force) ** 2, "no function of them"),
        (lambda s, m: ac.integral(s.force) + cast(Any, "a"), "must be a finite number, not 'a'"),
        (lambda s, m: ac.OptimalControl(m, 1.0).optimise(s.force, 0, 1), "is no parameter"),
        (lambda s, m: ac.OptimalControl(m, 1.0).at(1.5, {s.rail.q: 0}), "between 0 and 1"),
        (lambda s, m: ac.OptimalControl(m, 1.0).solve(solver="snopt"), "no solver 'snopt'. Use 'ipopt', 'fatrop', 'piqp'."),
        (lambda s, m: ac.OptimalControl(m, 1.0).solve(order=4), "odd order"),
        (lambda s, m: ac.OptimalControl(m, 1.0).solve(order=1, controls="linear"), "a line needs two"),
        (lambda s, m: ac.OptimalControl(m, 1.0).solve(controls="spline"), "'free', 'constant' or 'linear'"),
        (lambda s, m: ac.OptimalControl(m, 1.0).solve(tolerance=np.nan), "tolerance must be a finite"),
        (lambda s, m: ac.OptimalControl(m, 1.0).solve(refinements=-1), "refinements is -1"),
        (lambda s, m: ac.OptimalControl(m, 1.0).solve(options={"ipopt.bliss": 1}), "No such IPOPT option: bliss"),
        (lambda s, m: ac.OptimalControl(s, 1.0), "is no model"),
        (lambda s, m: ac.OptimalControl(m, 1.0).bound(s.force, np.inf, np.inf), "numbers in order"),
        (lambda s, m: ac.OptimalControl(m, 1.0).periodic(turns={s.rail.q: 1}), r"rail.q \[m\] makes no turns"),
        (lambda s, m: ac.OptimalControl(m, 1.0).guess(cast(Any, 3)), "no motion of this model"),
        (lambda s, m: ac.OptimalControl(m, 1.0).controller(-0.1), "rate must be positive"),
        (lambda s, m: ac.OptimalControl(m, 1.0).controller(0.1), "everything is free at the start"),
        (
            lambda s, m: ac.OptimalControl(m, 1.0).bound(ac.average(2 * s.rail.q), 2, 1),
            r"the average of \(2\.\*rail\.q\) is to stay above 2",
        ),
    ],
)
def test_problems_that_make_no_sense_are_refused_in_words(ask: Callable[[Any, Any], Any], words: str) -> None:
    scene = Sledge()
    with pytest.raises(OptionError, match=words):
        ask(scene, ac.build(scene))


@pytest.mark.parametrize(
    ("ask", "error", "words"),
    [
        (lambda o, s: o.bound(s.rail.q, 0.5, 2.0), OptionError, "rail.q is 0 at the start, but is bounded to between 0.5 and 2"),
        (lambda o, s: o.bound(s.rail.q, upper=0.8), OptionError, "rail.q is to be 1 at the end, but is bounded to at most 0.8"),
        (lambda o, s: o.optimise(s.unused, 0.0, 1.0), OptionError, "nothing in the problem depends on unused"),
        (
            lambda o, s: o.bound(s.force, 1, 2) or o.bound(s.force, -2, -1),
            OptionError,
            "force is to be between 1 and 2 all the time",
        ),
        (lambda o, s: o.bound(s.rail.v, 0.5, 2.0), OptionError, "rail.v is to be 0 at the end, but is bounded"),
        (lambda o, s: o.end({s.body.point.position: (1, 0.3, 0)}), OptionError, r"position\[1\] is 0 however the scene moves"),
        (lambda o, s: o.end({s.unused: 0.1}), OptionError, "unused is 0.5 however the scene moves"),
        (lambda o, s: o.end({s.rail.q: np.inf}), OptionError, "numbers in order"),
        (lambda o, s: o.at(0.0, {s.force: 0.0}), OptionError, "At the start only positions"),
        (lambda o, s: o.end({2 * s.rail.q: 3.0}), OptionError, r"rail\.q\) is to be 3 at the end, and rail\.q 1, too"),
        (lambda o, s: o.end({s.rail.q: 2.0}), OptionError, "rail.q is to be 2 at the end, and 1, too, which cannot both be"),
        (lambda o, s: o.end({s.rail.q: (0.2, 0.5)}), OptionError, "rail.q is to be between 0.2 and 0.5 at the end, and 1, too"),
        (lambda o, s: o.at(0.0, {s.rail.q: 0.3}), OptionError, "rail.q is to be 0 at the start, and 0.3, too"),
        (
            lambda o, s: o.end({s.body.point.position: (2, 0, 0)}),
            OptionError,
            r"position\[0\] is to be 2 at the end, and rail.q 1, too",
        ),
        (
            lambda o, s: o.bound(1e3 * s.rail.q - 5.0, upper=500.0),
            OptionError,
            r"rail.q is to be 1 at the end, but .*rail.q.* is bounded to at most 500 all the time, which cannot both be",
        ),
        (lambda o, s: o.end({s.rail.q**3: 8.0}), OptimalControlError, "contradicts itself: .* is 1 and not 8"),
        (
            lambda o, s: o.minimise(ac.integral(s.force**2 * float("nan"))),
            OptimalControlError,
            "slope have: what is minimised",
        ),
        (lambda o, s: o.bound(s.rail.v, upper=0.5), OptimalControlError, r"could not be met: .*rail\.q"),
        (lambda o, s: o.minimise(-ac.integral(s.force**2)), OptimalControlError, "no least value|too many"),
        (lambda o, s: o.periodic(), OptionError, r"rail.q \(as at the start\) is to be 0 at the end, and rail.q 1, too"),
        (lambda o, s: o.minimise(ac.integral(np.abs(s.force))), OptimalControlError, r"what is minimised \(an absolute value\)"),
        (lambda o, s: o.bound(s.force, -1, 1), OptimalControlError, "rail.q .*At its limits came: force"),
        (
            lambda o, s: o.bound(ac.integral(s.force**2), upper=3.0),
            OptimalControlError,
            r"limits came: the integral of sq\(force\)",
        ),
        (lambda o, s: o.minimise(-ac.integral(s.force**2)), OptimalControlError, "ran away: force came to .* at .* s"),
    ],
)
def test_what_cannot_be_is_said_by_part(ask: Any, error: type[Exception], words: str) -> None:
    scene = Sledge()
    scene.unused = ac.Parameter(0.5, "m")
    ocp = rest_to_rest(ac.build(scene), scene, 1.0)
    ocp.minimise(ac.integral(scene.force**2))
    ask(ocp, scene)
    with pytest.raises(error, match=words):
        ocp.solve(4, options={"ipopt.max_iter": 200})


def test_a_bound_holds_at_a_start_that_is_free() -> None:
    """Also for expressions, whose first point on the mesh comes later."""
    scene = Sledge()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.rail.q: ac.free(-5, 5, 0), scene.rail.v: ac.free(-5, 5, 0)})
    ocp.bound(scene.rail.q**2, upper=1.0)
    ocp.bound(scene.force, -50, 50)
    ocp.end({scene.rail.q: 0.0})
    ocp.minimise(-ac.at_start(scene.rail.q))
    assert ocp.solve(5).x[0, 0] == pytest.approx(1.0, abs=1e-8)


def test_numbers_and_sums_of_costs_are_costs() -> None:
    scene = Sledge()
    ocp = rest_to_rest(ac.build(scene), scene, 2.0)
    ocp.minimise(3 - (2 - sum([ac.integral(scene.force**2), ac.at_end(2 * scene.rail.q), 1.5])))
    assert ocp.solve(4).cost == pytest.approx(3 - 2 + 12 / 2**3 + 2 + 1.5, rel=1e-8)


@pytest.mark.parametrize("more", [0.0, 5.0, -2.0])
def test_what_is_the_same_for_all_motions_counts_in_costs_and_bounds(more: float) -> None:
    """A number, and a parameter that is known, beside the effort 12 / T^3 from rest to rest, and 3 (x - v T + v^2 T^2 / 3) / T^3 times 4 to a speed v at the end."""
    scene = Sledge()
    scene.price = ac.Parameter(1.0)
    model = ac.build(scene)
    ocp = rest_to_rest(model, scene, 2.0)
    ocp.minimise(ac.integral(scene.force**2) + ac.at_end(scene.price) + more)
    best = ocp.solve(4)
    assert best.cost == pytest.approx(1.5 + 1 + more, rel=1e-9) == best.true_cost
    assert best.cost_error < 1e-9
    slow = ac.OptimalControl(model, 2.0, parameters={scene.price: more})
    slow.start({scene.rail.q: 0})
    slow.end({scene.rail.q: 1})
    slow.minimise(ac.integral(scene.force**2))
    slow.bound(ac.integral(scene.force) + ac.at_end(scene.price), upper=0.4 + more)
    assert slow.solve(4).cost == pytest.approx(4 * 3 * (1 - 0.4 * 2 + 0.4**2 * 2**2 / 3) / 2**3, rel=1e-6)


def test_an_input_that_moves_nothing_may_be_given() -> None:
    scene = Sledge()
    scene.idle = ac.Input("N")
    model = ac.build(scene)
    ocp = ac.OptimalControl(model, 1.0, inputs={scene.idle: 0.3})
    ocp.start({scene.rail.q: 0})
    ocp.end({scene.rail.q: 1, scene.rail.v: 0})
    ocp.minimise(ac.integral(scene.force**2))
    assert ocp.solve(4).cost == pytest.approx(12.0, rel=1e-9)


@pytest.mark.parametrize(("source", "unit"), [(PositionSource, "m"), (VelocitySource, "m/s")])
def test_places_that_inputs_prescribe_are_refused_by_name(source: Any, unit: str) -> None:
    """Their rates move the scene, too, and are no inputs to be found beside them. Accelerations are found."""
    scene: Any = ac.System()
    scene.place, scene.world, scene.rail, scene.body = ac.Input(unit), World(), Prismatic("x"), Particle(1.0)
    scene.source = source(scene.place)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.body.point)
    scene.connect(scene.source.flange, scene.rail.flange)
    with pytest.raises(OptionError, match=r"the input place prescribes a place.*AccelerationSource"):
        ac.OptimalControl(ac.build(scene), 1.0)


def test_an_integral_is_bounded() -> None:
    """The effort 12 / T^3 from rest to rest is 3 where T^3 = 4."""
    scene = Sledge()
    ocp = rest_to_rest(ac.build(scene), scene, ac.free(0.1, 10))
    ocp.bound(ac.integral(scene.force**2), upper=3.0)
    ocp.minimise(ocp.duration)
    assert ocp.solve(4).duration == pytest.approx(4 ** (1 / 3), rel=1e-8)


@pytest.mark.parametrize("wanted", [lambda p: {p[2]: 0.5}, lambda p: {p: (0, 0, 0.5)}])
def test_what_hangs_is_brought_straight_up(wanted: Any) -> None:
    """Where it hangs, its height changes with nothing, and straight up neither."""
    scene = Pendulum()
    ocp = ac.OptimalControl(ac.build(scene), 1.5)
    ocp.start({scene.hinge.q: 0})
    ocp.end(wanted(scene.bob.point.position))
    ocp.minimise(ac.integral(scene.torque**2))
    assert abs(ocp.solve(8, refinements=0).x[0, -1]) == pytest.approx(np.pi, abs=1e-4)


def test_a_place_beyond_reach_is_said() -> None:
    scene = Pendulum()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.hinge.q: 0})
    ocp.end({scene.bob.point.position[2]: 0.9})
    ocp.minimise(ac.integral(scene.torque**2))
    with pytest.raises(OptimalControlError, match=r"bob.point.position\[2\] is 0.5 and not 0.9 at the end"):
        ocp.solve(6, guesses=1)


def test_loops_that_cannot_be_as_asked_for_are_said() -> None:
    """Of a four-bar one angle follows from the other."""
    scene = DrivenFourBar()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.a.q: 0.3})
    ocp.end({scene.a.q: 1.3})
    ocp.end({scene.b.q: 5.0})
    ocp.minimise(ac.integral(scene.torque**2))
    with pytest.raises(OptimalControlError, match=r"b\.q is .* and not 5"):
        ocp.solve(5)


class Ball(ac.System):
    """Rolls on a table by two torques."""

    def __init__(self) -> None:
        self.torques = [ac.Input("N m") for _ in range(2)]
        self.table, self.contact, self.ball = World(), RollingBall(0.1), RigidBody.ball(1.0, 0.1)
        self.motor = Torque((*self.torques, 0))
        self.connect(self.table.frame, self.contact.frame_a)
        self.connect(self.contact.frame_b, self.ball.frame)
        self.connect(self.motor.frame, self.ball.frame)


def test_a_ball_rolls_through_places_and_all_that_is_said_of_its_end_is_not_asked_twice() -> None:
    """The least effort is that of cubic splines; the ball turns by ten radians, so that no entry of its quaternion follows from the others on all of its way.
    Its height, its rising, its turning and the spin that nothing drives follow from the rest.
    """
    scene = Ball()
    frame = scene.ball.frame
    ocp = ac.OptimalControl(ac.build(scene), 3.0)
    ocp.start(
        {frame.position: (0, 0, 0.1), frame.velocity: (0, 0, 0), frame.rotation: np.eye(3), frame.angular_velocity: (0, 0, 0)}
    )
    ocp.at(1 / 3, {frame.position[0]: 0.3, frame.position[1]: 0.2})
    ocp.at(2 / 3, {frame.position[0]: 0.6, frame.position[1]: -0.2})
    ocp.end({frame.position: (1.0, 0, 0.1), frame.velocity: (0, 0, 0), frame.angular_velocity: (0, 0, 0)})
    ocp.minimise(ac.integral(scene.torques[0] ** 2 + scene.torques[1] ** 2))
    best, cost = ocp.solve(30, refinements=0), 0.0
    for places in ([0, 0.3, 0.6, 1], [0, 0.2, -0.2, 0]):
        bend = CubicSpline([0, 1, 2, 3], places, bc_type="clamped")([0, 1, 2, 3], 2)
        cost += float(np.sum(bend[:-1] ** 2 + bend[:-1] * bend[1:] + bend[1:] ** 2)) / 3 * (1.4 * 0.1) ** 2
    assert best.cost == pytest.approx(cost, rel=3e-6)
    assert np.ptp(best.x[:4], axis=1).max() > 1


@pytest.mark.parametrize(("spin", "angle", "time"), [(1.7, 0.5, 6.0), (-0.9, 2.2, 5.0), (0.0, 4.0, 3.0)])
def test_a_body_that_spins_comes_to_rest_by_as_many_turns_as_are_best(spin: float, angle: float, time: float) -> None:
    """A ball about an axis: least effort I^2 (w^2 / T + 12 (phi - w T / 2)^2 / T^3), of all angles phi that are the same attitude."""
    scene, axis = ac.System(), np.array([2.0, -1.0, 2.0]) / 3
    scene.torques = [ac.Input("N m") for _ in range(3)]
    scene.world, scene.body, scene.motor = World(gravity=None), RigidBody(1.0, (2.0, 2.0, 2.0)), Torque(tuple(scene.torques))
    scene.connect(scene.motor.frame, scene.body.frame)
    frame: Any = scene.body.frame
    ocp = ac.OptimalControl(ac.build(scene), time)
    still = {frame.position: (0, 0, 0), frame.velocity: (0, 0, 0)}
    ocp.start({**still, frame.rotation: np.eye(3), frame.angular_velocity: spin * axis})
    ocp.end({frame.rotation: ac.rotations.axis_angle(axis, angle), frame.angular_velocity: (0, 0, 0)})
    ocp.minimise(ac.integral(sum(torque**2 for torque in scene.torques)))
    turns = angle + 2 * np.pi * np.arange(-5, 6) - spin * time / 2
    assert ocp.solve(12).cost == pytest.approx(4 * (spin**2 / time + 12 * np.min(turns**2) / time**3), rel=1e-5)


def test_an_input_without_effect_is_said() -> None:
    scene = Sledge()
    scene.idle = ac.Input("N")
    with pytest.raises(OptionError, match="The input idle has no effect on the motion"):
        rest_to_rest(ac.build(scene), scene, 1.0).solve(4)


class Interrupting(ca.Callback):
    """x -> 0, and Ctrl-C the n-th time."""

    def __init__(self, at: int) -> None:
        ca.Callback.__init__(self)
        self.left = at
        self.construct("interrupting", {})

    def eval(self, arg: Any) -> list[float]:
        self.left -= 1
        if not self.left:
            signal.raise_signal(signal.SIGINT)
        return [0.0]


@each_value((("which", "at"), [("_gradient", 3), ("_jacobian", 4), ("_hessian", 6)]), ("solver", ["ipopt", "piqp", "fatrop"]))
def test_an_interrupted_search_hands_over_its_iterate(solver: str, at: int, which: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wherever Ctrl-C comes among evaluations; where there are steps already, what they have come to."""
    made, interrupting = getattr(Program, which).func, Interrupting(at)

    def interrupted(program: Program) -> ca.Function:
        function = made(program)
        given = [function.mx_in(k) for k in range(function.n_in())]
        told = function.call([given[0] + interrupting(given[0][0]), *given[1:]])
        return ca.Function(function.name(), given, told, function.name_in(), function.name_out())

    again = functools.cached_property(interrupted)
    again.__set_name__(Program, which)
    monkeypatch.setattr(Program, which, again)
    ocp = cart_pole()
    with pytest.raises(KeyboardInterrupt, match="last iterate") as stopped:
        ocp.solve(10, solver=solver, refinements=0, guesses=0)
    best = getattr(stopped.value, "best")  # noqa: B009  # nobody declared it
    assert best.x.shape == (4, 11) and best.cost > 0
    begun = whole([ocp.part(Mesher(10, 5, "free", solver))], []).program.guess
    assert (best.iterations > 0) == (np.max(np.abs(best.unknowns - begun)) > 1e-3)
    assert best.iterations > 0 or which != "_hessian"
    monkeypatch.undo()
    ocp.guess(best)
    assert ocp.solve(10, refinements=0).defect < 0.02


@pytest.mark.parametrize("solver", ["ipopt", "piqp"])
def test_a_controller_holds_the_pole_up(solver: str) -> None:
    """Receding horizon from 0.2 rad beside upright: after two seconds the pole stands and the cart is on its way back."""
    scene = CartPole()
    model = ac.build(scene)
    ocp = ac.OptimalControl(model, 1.0)
    ocp.start({scene.rail.q: 0.3, scene.hinge.q: np.pi - 0.2})
    ocp.bound(scene.force, -30, 30)
    upright = scene.hinge.q - np.pi
    ocp.minimise(ac.integral(10 * scene.rail.q**2 + 50 * upright**2 + 0.01 * scene.force**2 + 0.1 * scene.rail.v**2))
    control = ocp.controller(0.05, 15, controls="constant", solver=solver)
    names = (scene.rail.q, scene.hinge.q, scene.rail.v, scene.hinge.v)
    x = np.array([0.3, np.pi - 0.2, 0.0, 0.0])
    for k in range(40):
        u = control(x)
        run = model.simulate(
            0.05 * (k + 1), dict(zip(names, x, strict=True)), t0=0.05 * k, inputs={scene.force: float(u[0])}, samples=2
        )
        x = run.x[:, -1]
    assert abs(x[1] - np.pi) < 0.02
    assert abs(x[0]) < 0.1
    assert control.best.iterations < 12
    with pytest.raises(OptionError, match="give 4 finite states"):
        control([0.0, np.nan, 0.0, 0.0])


def test_a_controller_brings_a_loop_to_its_place_and_holds_it_there_after_a_blow() -> None:
    """A four-bar, by one step of quadratic programming for each call, whose torque is held; its place is near that of least cost, and a blow on the way changes nothing of that."""
    scene = DrivenFourBar()
    model = ac.build(scene)
    ocp = ac.OptimalControl(model, 0.6)
    ocp.start({scene.a.q: 0.3})
    ocp.bound(scene.torque, -40, 40)
    ocp.minimise(ac.integral(200 * (scene.a.q - 1.2) ** 2 + 5 * scene.a.v**2 + 1e-3 * scene.torque**2))
    control, x, ends = ocp.controller(0.05, 12, solver="piqp"), model.initial_state({scene.a.q: 0.3}).x, list[float]()
    for blow in (0.0, -2.0):
        speed = x[list(model.state_names).index("a.v")] + blow
        x = model.initial_state({scene.a.q: x[list(model.state_names).index("a.q")], scene.a.v: speed}).x
        for _ in range(22):
            run = model.simulate(
                0.05, dict(zip(model.state_names, x, strict=True)), inputs={scene.torque: float(control(x)[0])}, samples=2
            )
            x = run.x[:, -1]
        ends.append(float(run[scene.a.q][-1]))
    assert ends == pytest.approx([1.2, 1.2], abs=5e-3)
    assert model.functions.invariants is not None
    assert np.max(np.abs(np.array(model.functions.invariants(0.0, x, 0, [])))) < 1e-12


def test_who_may_take_more_time_swings_up_at_no_more_effort() -> None:
    """Standing costs nothing: the best time that is free is the longest, and costs no more than that one when it is given."""
    scene = Pendulum()
    model = ac.build(scene)
    costs = list[float]()
    for time in (ac.free(0.5, 5.0), 5.0):
        ocp = ac.OptimalControl(model, time)
        ocp.start({scene.hinge.q: 0.0})
        ocp.end({scene.hinge.q: np.pi, scene.hinge.v: 0.0})
        ocp.bound(scene.torque, -2, 2)
        ocp.minimise(ac.integral(scene.torque**2))
        costs.append(ocp.solve(30, tolerance=1e-5).cost)
    assert costs[0] < costs[1] * (1 + 1e-4)


@pytest.mark.parametrize(("mass", "length", "bound"), [(1.0, 0.6, 15.0), (1e-3, 0.01, 0.01), (100.0, 0.6, 2000.0)])
def test_what_begins_where_it_is_to_stay_stays(mass: float, length: float, bound: float) -> None:
    """A pole that stands, but for what rounding makes of half a turn: that is not what costs are measured by."""
    scene: Any = ac.System()
    scene.force, scene.world, scene.rail, scene.hinge = ac.Input("N"), World(gravity=(0, 0, -9.81)), Prismatic("x"), Revolute("y")
    scene.cart, scene.rod = RigidBody.box(mass, (0.3, 0.2, 0.1)), RigidBody.rod(0.3 * mass, (0, 0, -length))
    scene.motor = ForceSource(scene.force)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.cart.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.motor.flange, scene.rail.flange)
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.hinge.q: np.pi})
    ocp.bound(scene.force, -bound, bound)
    ocp.minimise(ac.integral(10 * scene.rail.q**2 + 50 * (scene.hinge.q - np.pi) ** 2 + 2 * (scene.force / bound) ** 2))
    best = ocp.solve(6)
    assert best.cost < 1e-20
    assert best.iterations < 50
    assert np.max(np.abs(best.inputs[scene.force](best.t))) < 1e-6 * bound


@pytest.mark.parametrize("solver", ["ipopt", "piqp", "qpoases"])
def test_a_controller_says_which_state_is_beyond_its_bounds_and_goes_on(solver: str) -> None:
    """From states from which there is no motion; the plan before is not lost then."""
    scene = Sledge()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.rail.q: 0.3})
    ocp.bound(scene.force, -5, 5)
    ocp.bound(scene.rail.q, -0.5, 0.5)
    ocp.minimise(ac.integral(scene.rail.q**2 + 0.01 * scene.force**2))
    control, fresh = (ocp.controller(0.05, 6, solver=solver) for _ in range(2))
    assert control([0.3, 0.0]) == pytest.approx(fresh([0.3, 0.0]))
    with pytest.raises(
        OptimalControlError, match=r"rail\.q is 0\.6 at the start, but is bounded to between -0\.5 and 0\.5 .* let the cost"
    ):
        control([0.6, 0.0])
    assert control([0.29, -0.1]) == pytest.approx(fresh([0.29, -0.1]), rel=1e-5)


def test_one_step_at_a_time_comes_to_what_is_best() -> None:
    """Called again and again from where its own plan leads; and refused for what is not convex. Newton's steps on the bounds that press, to which the other one begins each time, find what
    an interior point finds, which takes the steps of someone with options of his own.
    """
    scene = CartPole()
    model = ac.build(scene)
    ocp = ac.OptimalControl(model, 0.6)
    ocp.start({scene.rail.q: 0.1, scene.hinge.q: np.pi - 0.1})
    ocp.bound(scene.force, -3, 3)
    ocp.minimise(ac.integral(scene.rail.q**2 + 10 * (scene.hinge.q - np.pi) ** 2 + 0.01 * scene.force**2))
    quick, exact = (ocp.controller(0.05, 12, controls="constant", solver=one) for one in ("piqp", "ipopt"))
    inner = ocp.controller(0.05, 12, controls="constant", options={"ipopt.max_iter": 400})
    x, pressed = np.array([0.1, np.pi - 0.1, 0.0, 0.0]), 0
    for _ in range(6):
        assert quick(x) == pytest.approx(exact(x), abs=0.06 * 3)
        assert inner(x) == pytest.approx(exact(x), abs=1e-6)
        pressed += bool(abs(exact.best.inputs[scene.force](0.0)) > 3 - 1e-9)
        x = exact.best.x[:, 1]
    assert pressed
    assert quick(x) == pytest.approx(exact(x), abs=1e-3)
    ocp.minimise(ac.integral(scene.force**2 - 50 * scene.rail.q**2))
    with pytest.raises(OptionError, match="not convex"):
        ocp.controller(0.05, 4, solver="piqp")


def test_a_motion_with_quaternions_is_a_guess() -> None:
    """All that stands at a point is read from it: what stretches quaternions is nothing then."""
    scene = Ball()
    model = ac.build(scene)
    run = model.simulate(0.5, {scene.ball.frame.position: (0, 0, 0.1)}, inputs=dict.fromkeys(scene.torques, 0.1))
    ocp = ac.OptimalControl(model, 0.5)
    ocp.guess(run)
    part = ocp.part(Mesher(4, 5, "free", "ipopt"))
    assert part.guess.values.shape == (13, part.asked.stage.width)


@pytest.mark.parametrize(("value", "reached"), [(0.0, 0.0), (1.5, 0.75), (-2.0, -1.0)])
def test_an_input_that_is_held_leaves_its_own_motion_and_nothing_is_said_beside(
    value: float, reached: float, capfd: pytest.CaptureFixture[str]
) -> None:
    """A force of one value moves a mass of 1 kg by half of it in 1 s: that is found; elsewhere the message says what is held."""
    scene = Sledge()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.rail.q: 0})
    ocp.bound(scene.force, value, value)
    ocp.end({scene.rail.q: reached})
    ocp.minimise(ac.integral(scene.force**2))
    best = ocp.solve(5)
    assert best.cost == pytest.approx(value**2, abs=1e-9)
    assert len(repr([best])) < 100
    ocp.end({scene.rail.v: 7.0})
    with pytest.raises(OptimalControlError, match=f"What could not be met.*Held all the time is: force at {value:g}"):
        ocp.solve(5)
    assert not "".join(capfd.readouterr())


@each_value(
    ("unit", [1e-6, 1.0, 1e3]),
    (
        ("place", "speed", "words"),
        [
            (ac.free(3, 4), 0.0, "rail.q is to be between 3 and 4 at the start, but is bounded to between -1 and 2"),
            (5.0, ac.free(-1, 1), "rail.q is to be 5 at the start, but is bounded to between -1 and 2"),
            (1.0, ac.free(1.5, 4), "rail.v is to be between 1.5 and 4 at the start, but is bounded to between -1 and 1"),
            (ac.free(1, 4), ac.free(0, 4), None),
        ],
    ),
)
def test_a_start_beside_its_bounds_is_refused_by_name_where_something_of_it_is_free(
    unit: float, place: float | ac.free, speed: float | ac.free, words: str | None
) -> None:
    """Before any search; bounds that have something in common with what is free are met there."""
    scene = Sledge()
    place, speed = (
        ac.free(unit * one.lower, unit * one.upper) if isinstance(one, ac.free) else unit * one for one in (place, speed)
    )
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.rail.q: place, scene.rail.v: speed})
    ocp.bound(scene.rail.q, -unit, 2 * unit)
    ocp.bound(scene.rail.v, -unit, unit)
    ocp.minimise(ac.integral(scene.force**2) / unit**2 - ac.at_start(scene.rail.q) / unit)
    if words is None:
        assert ocp.solve(5, guesses=0).x[:, 0] / unit == pytest.approx([2.0, 0.0], abs=1e-6)
        return
    numbers = re.sub(r"-?\d+(\.\d+)?", lambda number: f"{unit * float(number[0]):g}", words)
    with pytest.raises(OptionError, match=re.escape(numbers)):
        ocp.solve(5)


@pytest.mark.parametrize(("mass", "time"), [(1e6, 1e-3), (3e-7, 2e4), (1.0, 1e-7)])
def test_forces_of_any_size_are_found(mass: float, time: float) -> None:
    """From rest to rest over 1 m: 12 m^2 / T^3, where nothing says how much a force is."""
    scene: Any = ac.System()
    scene.force, scene.world, scene.rail, scene.body = ac.Input("N"), World(), Prismatic("x"), Particle(mass)
    scene.motor = ForceSource(scene.force)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.body.point)
    scene.connect(scene.motor.flange, scene.rail.flange)
    ocp = rest_to_rest(ac.build(scene), scene, time)
    ocp.minimise(ac.integral(scene.force**2))
    assert ocp.solve(5).cost == pytest.approx(12 * mass**2 / time**3, rel=1e-9)


class SingleTrack(ac.System):
    """A car in the plane on two tyres in line, which push aside by their slip; the front one is steered, the rear one drives."""

    def __init__(self, mass: float, inertia: float, front: float, rear: float, stiff: float) -> None:
        self.steer, self.drive = ac.Input("rad"), ac.Input("N")
        self.world, self.plane = World(gravity=None), Planar("z")
        self.body = RigidBody(mass, (inertia, inertia, inertia))
        self.connect(self.world.frame, self.plane.frame_a)
        self.connect(self.plane.frame_b, self.body.frame)
        axles = self.body.at((front, 0, 0)), self.body.at((-rear, 0, 0))
        along, aside = self.body.frame.rotation[:, 0], self.body.frame.rotation[:, 1]
        c, s = np.cos(self.steer), np.sin(self.steer)
        self.turned = c * along + s * aside, c * aside - s * along
        slips = [
            axle.velocity.T @ y / (axle.velocity.T @ x) for axle, (x, y) in zip(axles, (self.turned, (along, aside)), strict=True)
        ]
        self.tyres = Force(-stiff * slips[0] * self.turned[1]), Force(-stiff * slips[1] * aside + self.drive * along)
        for tyre, axle in zip(self.tyres, axles, strict=True):
            self.connect(tyre.point, axle)


@pytest.mark.parametrize(("quick", "speed", "aside"), [(False, 25.0, 3.5), (True, 17.0, -2.0)])
def test_what_drives_goes_on_while_it_changes_lanes(quick: bool, speed: float, aside: float) -> None:
    """Tyres push by slips, which are nothing where it stands; as the textbook's single-track car does, transcribed by hand for Opti. How far it drives is left open, or how long."""
    m, J, a, b, C, n = 1500.0, 2500.0, 1.2, 1.5, 8e4, 12
    car = SingleTrack(m, J, a, b, C)
    ocp = ac.OptimalControl(ac.build(car), ac.free(1, 8) if quick else 3.0)
    frame = car.body.frame
    ocp.start(
        {frame.position: (0, 0, 0), frame.rotation: np.eye(3), frame.velocity: (speed, 0, 0), frame.angular_velocity: (0, 0, 0)}
    )
    end: dict[Any, Any] = {frame.position[1]: aside, car.plane.q[2]: 0, frame.velocity[1]: 0, frame.angular_velocity[2]: 0}
    ocp.end(end | ({frame.position[0]: 50} if quick else {}))
    ocp.bound(car.steer, -0.2, 0.2)
    ocp.bound(car.drive, -6000, 3000)
    effort = 100 * car.steer**2 + (car.drive / 1e4) ** 2
    ocp.minimise(ac.integral(effort) + (ocp.duration if quick else 0))
    best = ocp.solve(n, refinements=0)

    opti, tau = ca.Opti(), ca.collocation_points(3, "radau")
    slopes, _, weights = ca.collocation_coeff(tau)
    x, u, T = opti.variable(6, 3 * n + 1), opti.variable(2, 3 * n), opti.variable()
    cost = T if quick else 0
    for k in range(3 * n):
        psi, vx, vy, r = (x[i, k + 1] for i in range(2, 6))
        d, drive, w = 0.1 * u[0, k], 1e4 * u[1, k], vy + a * r
        front = -C * (ca.cos(d) * w - ca.sin(d) * vx) / (ca.cos(d) * vx + ca.sin(d) * w)
        rear = -C * (vy - b * r) / vx
        places = vx * ca.cos(psi) - vy * ca.sin(psi), vx * ca.sin(psi) + vy * ca.cos(psi), r
        speeds = (drive - front * ca.sin(d)) / m + vy * r, (front * ca.cos(d) + rear) / m - vx * r
        rates = ca.vertcat(*places, *speeds, (a * front * ca.cos(d) - b * rear) / J)
        first, j = k // 3 * 3, k % 3
        opti.subject_to(x[:, first : first + 4] @ slopes[:, j] == T / n * rates)
        cost += T / n * weights[j] * (100 * d**2 + (drive / 1e4) ** 2)
    opti.subject_to(x[:, 0] == ca.DM([0, 0, 0, speed, 0, 0]))
    opti.subject_to(x[[1, 2, 4, 5], -1] == ca.DM([aside, 0, 0, 0]))
    opti.subject_to(x[0, -1] == 50 if quick else T == 3)
    opti.subject_to(opti.bounded(-2, u[0, :], 2))
    opti.subject_to(opti.bounded(-0.6, u[1, :], 0.3))
    opti.set_initial(x[3, :], speed)
    opti.set_initial(T, 3)
    opti.minimize(cost)
    opti.solver("ipopt", {"print_time": False, "expand": True, "ipopt.print_level": 0, "ipopt.sb": "yes"})
    solved = opti.solve()
    assert best.cost == pytest.approx(float(solved.value(cost)), rel=1e-6)
    assert best.duration == pytest.approx(float(solved.value(T)), rel=1e-6)
    assert best.run[car.plane.v][-1] == pytest.approx(solved.value(x)[3:, -1], abs=1e-2)


@pytest.mark.parametrize(
    ("size", "discs"),
    [
        (1.0, [(1.0, 0.1, 0.5), (2.2, -0.5, 0.7)]),
        (3e-4, [(1.2, -0.15, 0.6), (2.9, 0.6, 0.75)]),
        (5e3, [(2.0, 0.3, 0.5), (2.0, -1.1, 0.6)]),
    ],
)
def test_obstacles_are_passed_on_the_better_side(size: float, discs: list[tuple[float, float, float]]) -> None:
    """From rest to rest beside discs in a plane, where nothing swings: the least of what Opti finds from guesses on all sides of them, by the same collocation."""
    scene = ac.System()
    scene.force = ac.Input("N"), ac.Input("N")
    scene.world, scene.along, scene.aside, scene.body = World(gravity=None), Prismatic("x"), Prismatic("y"), Particle(1.0)
    scene.push = Force((*scene.force, 0))
    scene.connect(scene.world.frame, scene.along.frame_a)
    scene.connect(scene.along.frame_b, scene.aside.frame_a)
    scene.connect(scene.aside.frame_b, scene.body.point)
    scene.connect(scene.push.point, scene.body.point)
    ocp, places, n = ac.OptimalControl(ac.build(scene), 2.0), (scene.along.q, scene.aside.q), 8
    ocp.start(dict.fromkeys(places, 0))
    ocp.end({scene.along.q: 4 * size, scene.aside.q: 0, scene.along.v: 0, scene.aside.v: 0})
    for x, y, r in discs:
        ocp.bound((places[0] - x * size) ** 2 + (places[1] - y * size) ** 2, lower=(r * size) ** 2)
    ocp.minimise(ac.integral(sum(force**2 for force in scene.force)))
    best = ocp.solve(n, refinements=0)

    tau = ca.collocation_points(3, "radau")
    slopes, _, weights = ca.collocation_coeff(tau)
    times = np.append(0, (np.arange(n)[:, None] + tau).ravel() / n)
    found = list[float]()
    for sides in np.array(np.meshgrid(*[(-1, 1)] * 2)).reshape(2, -1).T:
        opti = ca.Opti()
        x, u = opti.variable(4, 3 * n + 1), opti.variable(2, 3 * n)
        cost = 0
        for k in range(3 * n):
            first = k // 3 * 3
            opti.subject_to(x[:, first : first + 4] @ slopes[:, k % 3] == 2 / n * ca.vertcat(x[2:, k + 1], u[:, k]))
            cost += 2 / n * weights[k % 3] * ca.sumsqr(u[:, k])
            for px, py, r in discs:
                opti.subject_to((x[0, k + 1] - px) ** 2 + (x[1, k + 1] - py) ** 2 >= r**2)
        opti.subject_to(x[:, 0] == 0)
        opti.subject_to(x[:, -1] == ca.DM([4, 0, 0, 0]))
        bend = np.interp(
            times,
            [0, *(px / 4 for px, _, _ in discs), 1],
            [0, *(py + s * r for (_, py, r), s in zip(discs, sides, strict=True)), 0],
        )
        opti.set_initial(x[:2, :], np.vstack([4 * times, bend]))
        opti.minimize(cost)
        opti.solver("ipopt", {"print_time": False, "expand": True, "ipopt.print_level": 0, "ipopt.sb": "yes"})
        found.append(float(opti.solve().value(cost)))
    assert best.cost <= min(found) * size**2 * (1 + 1e-3)
