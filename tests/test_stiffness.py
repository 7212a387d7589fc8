"""Stiffness: which way the default goes, that it comes back, and that large stiff systems stay affordable."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy.linalg

import acausal as ac
from acausal.collocation.problem import Accuracy, Newton, Problem, StatusKind
from acausal.collocation.tableau import gauss_legendre
from acausal.integrators.base import native
from acausal.integrators.gauss import Gauss
from acausal.integrators.integrate import integrate
from acausal.runtime.native import Choice
from acausal.runtime.pattern import jacobian_pattern
from benchmarks.stiff import SCENES, Made, row_of_masses
from components import (
    Inertia,
    Prismatic,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    TorqueSource,
    TranslationalDamper,
    TranslationalGround,
    TranslationalSpring,
    World,
)  # fmt: skip
from tests.hard_cases import CASES
from tests.pairings import each_value


def linear(J: np.ndarray) -> Problem:
    """x' = J x."""
    n = J.shape[0]
    t, x, u, p = (ca.SX.sym(name, k) for name, k in (("t", 1), ("x", n), ("u", 0), ("p", 0)))
    matrix = ca.sparsify(ca.DM(J))
    rhs = ca.Function("rhs", [t, x, u, p], [ca.densify(ca.SX(matrix) @ x)])
    return Problem(rhs, None, None, lambda times: np.zeros((0, times.size)), np.zeros(0))


def heat(n: int) -> np.ndarray:
    """Second differences on n points of a rod of length one, ends at zero."""
    return (n + 1) ** 2 * (np.diag(-2.0 * np.ones(n)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1))


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_heat_in_five_hundred_points_takes_few_steps(rtol):
    """Eigenvalues up to -1e6 [1/s]: a sine of one half wave decays as its own, and nothing else shows."""
    n = 500
    shape = np.sin(np.pi * np.arange(1, n + 1) / (n + 1))
    solution = integrate(linear(heat(n)), shape, 0.0, 0.3, Accuracy(rtol, 0.0))
    slow = -4 * (n + 1) ** 2 * np.sin(np.pi / (2 * (n + 1))) ** 2
    assert solution.status.kind is StatusKind.SUCCESS and solution.statistics.steps < 150
    assert "radau" in solution.statistics.method
    assert np.max(np.abs(solution.x[:, -1] - np.exp(0.3 * slow) * shape)) < 3 * rtol


def test_elimination_fills_little_and_colours_are_few():
    pattern = jacobian_pattern(linear(heat(200)).rhs)
    assert pattern.colours == 3 and pattern.fill < 3 * 200
    starts, rows = pattern.start, pattern.row
    for colour in range(pattern.colours):
        of = np.concatenate([rows[starts[j] : starts[j + 1]] for j in np.flatnonzero(pattern.colour == colour)])
        assert np.unique(of).size == of.size


@pytest.mark.parametrize("method", ["radau", "gauss", "auto"])
@pytest.mark.parametrize("scale", [1.0, 2.0**40])
def test_sparse_systems_that_need_pivots_are_solved(method, scale):
    """Pairs without diagonal entries, coupled at random and damped: exact by the matrix exponential; half the states in other units."""
    rng = np.random.default_rng(5)
    n = 60
    J = np.zeros((n, n))
    for k in range(0, n, 2):
        J[k, k + 1] = 1.0
        J[k + 1, k] = -(10 ** rng.uniform(0, 6))
        J[k + 1, k + 1] = -(10 ** rng.uniform(1, 4))
        J[k + 1, rng.integers(0, n)] += rng.uniform(-1, 1)
    units = np.where(np.arange(n) % 4 < 2, 1.0, scale)
    x0 = rng.standard_normal(n)
    exact = scipy.linalg.expm(J) @ x0
    solution = integrate(linear(J * units[:, None] / units), x0 * units, 0.0, 1.0, Accuracy(1e-9, 0.0), method=method)
    assert np.max(np.abs(solution.x[:, -1] / units - exact)) < 1e-7 * np.max(np.abs(x0))


def test_the_default_comes_back_when_stiffness_ends():
    """Twenty-four oscillators, of which friction that is switched off smoothly holds half."""
    n = 24

    def rates(t, x):
        friction = 1e5 * (1 - ca.tanh(20 * (t - 1))) / 2
        q, v = ca.vertsplit(x[:n]), ca.vertsplit(x[n:])
        return ca.vertcat(
            *v, *(-(4.0 + k) * q[k] - (friction if k % 2 else 0.0) * (v[k] - v[k - 1]) - ca.sin(q[(k + 1) % n]) for k in range(n))
        )

    symbols = [ca.SX.sym(name, k) for name, k in (("t", 1), ("x", 2 * n), ("u", 0), ("p", 0))]
    rhs = ca.Function("rhs", symbols, [rates(symbols[0], symbols[1])])
    given = Problem(rhs, None, None, lambda times: np.zeros((0, times.size)), np.zeros(0))
    x0 = np.concatenate([np.linspace(0.1, 1, n), np.zeros(n)])
    auto, radau = (integrate(given, x0, 0.0, 20.0, Accuracy(1e-8, 0.0), method=method) for method in ("auto", "radau"))
    assert "in turns" in auto.statistics.method
    assert np.max(np.abs(auto.x[:, -1] - radau.x[:, -1])) < 1e-5


def work(problem: Problem, x0: np.ndarray, end: float, accuracy: Accuracy, method: str) -> float:
    """Operations on lanes; infinite where it fails."""
    solution = integrate(problem, x0, 0.0, end, accuracy, method=method)
    return solution.statistics.work if solution.status.kind is StatusKind.SUCCESS else np.inf


def no_dearer_than_the_better(problem: Problem, x0: np.ndarray, end: float, atol: float) -> None:
    """The default needs no more than 1.3 times what the better of both methods does, and some 25 us to find out which one that is."""
    for rtol in (1e-3, 1e-6, 1e-9, 1e-12):
        accuracy = Accuracy(rtol, atol * rtol, max_steps=200_000)
        auto, gauss, radau = (work(problem, x0, end, accuracy, method) for method in ("auto", "gauss", "radau"))
        assert auto < 1.3 * min(gauss, radau) + 5e4, (rtol, auto, gauss, radau)


SLOW = ("beam", "robot", "stiff_net")


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in SCENES])
def test_stiff_scenes_cost_the_default_little_more_than_the_better_method(name):
    scene, start, end = SCENES[name]()
    run = ac.build(scene).simulate(end, start, rtol=1e-3, samples=2, method="radau")
    no_dearer_than_the_better(run.problem, run.solution.x[:, 0], end / 2 if name == "stiff_net" else end, 0.0)


@pytest.mark.parametrize("name", ["rattleback_first", "spring_1e4", "fast_top", "kepler_10_turns"])
def test_scenes_that_are_not_stiff_do_not_pay_for_the_choice(name):
    """What fixed-point iteration alone needs, and little more; less where Newton's is better even there."""
    case = CASES[name]()
    run = case.simulate(1e-3)
    problem, x0 = run.problem, run.solution.x[:, 0]
    for rtol in (1e-3, 1e-6, 1e-9, 1e-12):
        accuracy = Accuracy(rtol, case.atol * rtol)
        plain = Choice((gauss_legendre(Gauss.order // 2),), Newton.NEVER)
        alone = native(problem).integrate(problem, x0, 0.0, case.end, accuracy, plain)
        assert work(problem, x0, case.end, accuracy, "auto") < 1.3 * alone.statistics.work + 2e4


def sledge(damping: float) -> tuple[ac.Model, dict[ac.Expression, float]]:
    """A pendulum on a sledge that a spring of 1e8 N/m holds, with or without a damper."""
    scene = ac.System()
    scene.world, scene.rail, scene.hinge = World(), Prismatic("x"), Revolute("y")
    scene.sledge, scene.rod = RigidBody.box(2.0, (0.2, 0.2, 0.2)), RigidBody.rod(1.0, (0, 0, -1.0))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.sledge.frame)
    scene.connect(scene.sledge.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.spring, scene.damper, scene.ground = TranslationalSpring(1e8), TranslationalDamper(damping), TranslationalGround()
    for part in (scene.spring, scene.damper):
        scene.connect(scene.ground.flange, part.flange_a)
        scene.connect(part.flange_b, scene.rail.flange)
    return ac.build(scene), {scene.hinge.q: 1.0}


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_the_default_goes_as_the_better_method(rtol):
    model, start = sledge(1e4)
    auto, radau = (model.simulate(3.0, start, rtol=rtol, method=method) for method in ("auto", "radau"))
    fine = model.simulate(3.0, start, rtol=1e-12, method="gauss")
    assert auto.statistics.steps < 1.3 * radau.statistics.steps + 5
    hinge = next(iter(start))
    assert abs(auto[hinge][-1] - fine[hinge][-1]) < 20 * rtol
    inside = np.linspace(0, 3, 301)
    assert np.max(np.abs(auto.at(inside)[hinge] - fine.at(inside)[hinge])) < 20 * rtol


def test_a_fast_oscillation_without_damping_stays_with_gauss():
    model, start = sledge(0.0)
    run = model.simulate(0.5, start, rtol=1e-6)
    assert "radau" not in run.statistics.method
    assert run.energy_error() < 1e-5


class StiffElbow(ac.System):
    """A double pendulum whose elbow a spring [N m/rad] and a damper [N m s/rad] hold straight."""

    def __init__(self, stiffness: float, damping: float) -> None:
        self.world, self.shoulder, self.elbow = World((0, 0, -9.81)), Revolute("y"), Revolute("y")
        self.upper, self.lower = RigidBody.rod(1.0, (0, 0, -0.7)), RigidBody.rod(2.0, (0, 0, -0.4))
        self.spring, self.damper, self.ground = RotationalSpring(stiffness), RotationalDamper(damping), RotationalGround()
        self.connect(self.world.frame, self.shoulder.frame_a)
        self.connect(self.shoulder.frame_b, self.upper.frame)
        self.connect(self.upper.tip, self.elbow.frame_a)
        self.connect(self.elbow.frame_b, self.lower.frame)
        self.connect(self.ground.flange, self.spring.flange_a, self.damper.flange_a)
        self.connect(self.spring.flange_b, self.damper.flange_b, self.elbow.flange)


@functools.cache
def swung_as_one() -> float:
    """Angle of the double pendulum after 2 s, its elbow rigid."""
    scene = ac.System()
    scene.world, scene.hinge = World((0, 0, -9.81)), Revolute("y")
    scene.upper, scene.lower = RigidBody.rod(1.0, (0, 0, -0.7)), RigidBody.rod(2.0, (0, 0, -0.4))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.upper.frame)
    scene.connect(scene.upper.tip, scene.lower.frame)
    return ac.build(scene).simulate(2.0, {scene.hinge.q: 1.0}, rtol=1e-12)[scene.hinge.q][-1]


@each_value(("damping", [0.0, 1e2, 3e4, 3e6]), ("stiffness", [1e6, 1e8, 1e10]))
def test_a_start_at_rest_in_what_is_stiff_is_no_rounding(stiffness: float, damping: float) -> None:
    """The first steps are far too long for fixed-point iteration, whose divergence must not be taken for rounding: the pendulum is that of one rigid rod."""
    exact, elbow = swung_as_one(), StiffElbow(stiffness, damping)
    model = ac.build(elbow)
    for rtol in (1e-5, 1e-7, 1e-10):
        end = 2.0 if damping else 0.02
        run = model.simulate(end, {elbow.shoulder.q: 1.0}, rtol=rtol)
        if damping:
            assert run[elbow.shoulder.q][-1] == pytest.approx(exact, abs=100 / stiffness + 100 * rtol)
        assert run.energy_error() < 1e3 * rtol


@pytest.mark.parametrize("stiffness", [1e6, 5e7, 3e9, 1e12])
def test_what_is_stiff_moves_as_one_between_the_ends_of_steps_too(stiffness: float) -> None:
    """Two rotors on a shaft that hardly twists, turned by a torque A sin(k t): in all samples both have the speed A (1 - cos(k t)) / (k (J + J'))."""
    rng = np.random.default_rng(int(stiffness) % 97)
    J, other, most, k = rng.uniform(0.01, 0.03), rng.uniform(0.01, 0.03), rng.uniform(0.01, 0.05), rng.uniform(2.0, 4.0)
    scene = ac.System()
    scene.rotor, scene.load, scene.shaft = Inertia(J), Inertia(other), RotationalSpring(stiffness)
    scene.motor = TorqueSource(lambda t: most * np.sin(k * t))
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    scene.connect(scene.rotor.flange_b, scene.shaft.flange_a)
    scene.connect(scene.shaft.flange_b, scene.load.flange_a)
    run = ac.build(scene).simulate(5.0)
    exact = most * (1 - np.cos(k * run.t)) / (k * (J + other))
    for rotor in (scene.rotor, scene.load):
        assert run[rotor.w] == pytest.approx(exact, abs=1e-6)
    assert run.energy_error() < 1e-7


@functools.cache
def built(make: Callable[[], Made]) -> tuple[ac.Model, Mapping[Any, Any], float]:
    """The model of a scene, its start, and how long it is simulated [s]."""
    scene, start, end = make()
    return ac.build(scene), start, end


@each_value(("method", ["auto", "gauss", "radau"]), ("rtol", [1e-13, 1e-10]))
def test_a_net_at_rest_in_its_plane_starts_at_any_tolerance(rtol: float, method: str) -> None:
    """Its threads begin at rounding; a first try that is off by a hundred times its tolerance still tells what rounding is there."""
    model, start, _ = built(SCENES["stiff_net"])
    run = model.simulate(0.02, start, rtol=rtol, method=method, samples=2)
    assert run.energy_error() < 1e-9


def hundred_masses() -> Made:
    """In a row, with stiff springs and dampers."""
    return row_of_masses(100, 1e5, 1e3)


@pytest.mark.parametrize("method", ["auto", "gauss", "radau"])
def test_two_hundred_states_at_rest_start_where_one_is_pulled(method: str) -> None:
    """Looking for what rounding does comes before steps are nothing, however many states there are."""
    model, start, end = built(hundred_masses)
    run = model.simulate(end, start, rtol=1e-3, method=method, samples=2)
    assert run.statistics.steps < 100


def rows_of_masses(count: int, damping: float, spread: float, seed: int) -> np.ndarray:
    """(2 n, 2 n) for places and speeds of masses of 10 g in a row, the first one tied to a wall: springs of 1e5 N/m, dampers in parallel, both times `spread` more or less."""
    rng = np.random.default_rng(seed)
    J = np.zeros((2 * count, 2 * count))
    places = np.arange(count)
    J[places, count + places] = 1.0
    for k in range(count):
        for of, size in ((0, 1e5), (count, damping)):
            force = 100 * size * spread ** rng.uniform(-1, 1)
            J[count + k, of + k] -= force
            if k:
                J[count + k, of + k - 1] += force
                J[count + k - 1, of + k] += force
                J[count + k - 1, of + k - 1] -= force
    return J


@functools.cache
def pulled(count: int, damping: float, spread: float) -> tuple[Problem, np.ndarray, np.ndarray]:
    """Such a row, its start with the last mass pulled, and its states 20 ms later by the matrix exponential."""
    J, start = rows_of_masses(count, damping, spread, seed=count), np.zeros(2 * count)
    start[count - 1] = 0.1
    return linear(J), start, scipy.linalg.expm(0.02 * J) @ start


@each_value(("row", [(40, 1e4, 1.0), (150, 1e3, 3.0), (300, 1e3, 1.0)]), ("method", ["auto", "gauss", "radau"]))
def test_however_many_states_are_at_rest_behind_what_is_stiff_the_motion_is_exact(
    row: tuple[int, float, float], method: str
) -> None:
    """What states far away may be off by does not grow from neighbour to neighbour, nor must all of them be found from nothing."""
    problem, start, exact = pulled(*row)
    for rtol in (1e-3, 1e-7):
        solution = integrate(problem, start, 0.0, 0.02, Accuracy(rtol, max_steps=2000), method=method)
        assert solution.status.kind is StatusKind.SUCCESS and solution.statistics.steps < 500
        for off, whole in zip(np.split(solution.x[:, -1] - exact, 2), np.split(exact, 2), strict=True):
            assert np.max(np.abs(off)) < 30 * rtol * np.max(np.abs(whole))
