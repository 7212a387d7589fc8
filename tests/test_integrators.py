"""Integrators: order, tolerance, stiffness, invariants, the one-step function. Measured, not assumed."""

from __future__ import annotations

import math
import subprocess
import sys
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.collocation.problem import Accuracy, Problem, StatusKind
from acausal.collocation.tableau import gauss_legendre, radau_iia
from acausal.integrators.integrate import integrate
from components import Force, Particle, SlidingMass, Spring, TranslationalGround, TranslationalSpring, World
from tests.scenes import DoublePendulum, FourBar, bennett_linkage


def problem(rate, n: int, parameters: tuple[float, ...] = ()) -> Problem:
    t, x, u, p = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("u", 0), ca.SX.sym("p", len(parameters))
    return Problem(
        ca.Function("f", [t, x, u, p], [ca.vertcat(*rate(t, x))]),
        None,
        None,
        lambda times: np.zeros((0, times.size)),
        np.array(parameters),
    )


def kepler(eccentricity: float) -> tuple[Problem, np.ndarray, float]:
    r3 = lambda x: (x[0] ** 2 + x[1] ** 2) ** 1.5  # noqa: E731
    start = np.array([1 - eccentricity, 0, 0, np.sqrt((1 + eccentricity) / (1 - eccentricity))])
    return problem(lambda t, x: (x[2], x[3], -x[0] / r3(x), -x[1] / r3(x)), 4), start, 2 * np.pi


@pytest.mark.parametrize("stages", range(1, 9))
def test_tableaus_meet_the_order_conditions(stages):
    for tableau, simplifying in ((gauss_legendre(stages), 2 * stages), (radau_iia(stages), 2 * stages - 1)):
        for k in range(1, simplifying + 1):
            assert abs(tableau.b @ tableau.c ** (k - 1) - 1 / k) < 1e-14
        for k in range(1, stages + 1):
            assert np.max(np.abs(tableau.A @ tableau.c ** (k - 1) - tableau.c**k / k)) < 1e-14


@pytest.mark.parametrize(("order", "steps"), [(2, (200, 400)), (4, (40, 80)), (6, (16, 24)), (8, (12, 16))])
def test_order_with_fixed_steps(order, steps):
    scene = DoublePendulum()
    model = ac.build(scene)
    start = {scene.shoulder.q: 0.6, scene.elbow.q: 0.3}
    fine = model.simulate(1.0, start, rtol=1e-14, atol=1e-14).solution.x[:, -1]
    errors = [
        np.max(np.abs(model.simulate(1.0, start, method="gauss", order=order, step=1 / n).solution.x[:, -1] - fine))
        for n in steps
    ]
    assert abs(np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0]) - order) < 0.1


@pytest.mark.parametrize(("h", "options"), [(0.1, "adaptive"), (1 / 7, "fixed"), (0.3, "fixed"), (0.3, "adaptive")])
def test_a_hundred_thousand_steps_lose_no_time(h: float, options: str):
    """Neither sums of steps nor sums of what they change: what moves freely is where it should be to some roundings, what swings within a billionth of a millionth of its way."""
    scene = ac.System()
    scene.free, scene.bob, scene.spring, scene.ground = (
        SlidingMass(1.0),
        SlidingMass(1.0),
        TranslationalSpring(1.0),
        TranslationalGround(),
    )
    scene.connect(scene.ground.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.bob.flange_a)
    start = {scene.free.s: 1 / 7, scene.free.v: 0.7, scene.bob.s: 1.0}
    how = {"method": "gauss", "order": 16, "step": h} if options == "fixed" else {"rtol": 1e-14, "max_step": h}
    run = ac.build(scene).simulate(1e5 * h, start, samples=2, **how)
    exact = float(Fraction(1 / 7) + Fraction(0.7) * Fraction(float(run.t[-1])))
    assert abs(run[scene.free.s][-1] - exact) <= 16 * np.spacing(exact)
    assert abs(run[scene.bob.s][-1] - np.cos(run.t[-1])) < 1e-15 * run.t[-1]


@pytest.mark.parametrize("case", ["kepler", "pendulum"])
def test_error_follows_the_tolerance(case):
    """The error at the end, relative to how the problem magnifies a perturbation of the tolerance's size, over nine decades."""
    if case == "kepler":
        p, x0, end = kepler(0.6)
        exact = lambda x: x  # noqa: E731
    else:
        scene = DoublePendulum()
        model = ac.build(scene)
        run = model.simulate(5.0, {scene.shoulder.q: 0.6, scene.elbow.q: 0.3}, rtol=1e-14, atol=1e-14)
        p, x0, end = run.problem, run.initial.x, 5.0
        final = run.solution.x[:, -1]
        exact = lambda _: final  # noqa: E731
    nudged = integrate(p, x0 * (1 + 1e-7), 0, end, Accuracy(1e-14, 1e-14), method="gauss").x[:, -1]
    magnification = np.max(np.abs(nudged - exact(x0))) / 1e-7
    ratios = []
    for rtol in 10.0 ** -np.arange(4, 14):
        error = np.max(np.abs(integrate(p, x0, 0, end, Accuracy(rtol, rtol), method="gauss").x[:, -1] - exact(x0)))
        ratios.append(error / (rtol * magnification))
    print(case, "magnification", magnification, "error / (rtol * magnification):", np.array(ratios))
    assert max(ratios[:-1]) < 10  # the last decade is near rounding
    assert max(ratios) < 100


def test_dense_output_is_as_accurate_as_the_steps():
    p, x0, period = kepler(0.6)
    times = np.linspace(0, period, 777)
    solution = integrate(p, x0, 0, period, Accuracy(1e-11, 1e-11), method="gauss")
    E = times.copy()  # Kepler's equation by Newton
    for _ in range(60):
        E -= (E - 0.6 * np.sin(E) - times) / (1 - 0.6 * np.cos(E))
    assert np.max(np.abs(solution.dense(times)[0] - (np.cos(E) - 0.6))) < 1e-9
    assert solution.t.size < 120


@pytest.mark.slow
def test_long_run_with_fixed_steps_has_no_energy_trend():
    """2,000 s of the double pendulum: Gauss is symplectic, and the sum is compensated."""
    scene = DoublePendulum()
    run = ac.build(scene).simulate(
        2000.0, {scene.shoulder.q: 0.6, scene.elbow.q: 0.3}, step=0.05, method="gauss", order=12, samples=2
    )
    energy = run.at(run.solution.t[::100]).energy
    assert np.max(np.abs(energy - energy[0])) < 1e-12 * abs(energy[0])


@pytest.mark.parametrize("order", [4, 6])
def test_projection_keeps_the_order_and_the_loop(order):
    """A four-bar with fixed steps: the error falls with the method's order, the loop stays closed to rounding."""
    scene = FourBar()
    model = ac.build(scene)
    start = {scene.a.q: 0.5, scene.a.v: 1.0}
    fine = model.simulate(0.4, start, rtol=1e-14, atol=1e-14).solution.x[:, -1]
    errors = []
    for n in (24, 32):
        run = model.simulate(0.4, start, method="gauss", order=order, step=0.4 / n)
        errors.append(np.max(np.abs(run.solution.x[:, -1] - fine)))
        gaps = np.array(model.functions.constraint_position(0.0, run.solution.x, ca.DM(0, n + 1), ca.DM(0, n + 1)))
        assert np.max(np.abs(gaps)) < 1e-15
    assert abs(np.log(errors[0] / errors[1]) / np.log(32 / 24) - order) < 0.1


def test_quaternions_stay_unit():
    from components import RigidBody

    scene = ac.System()
    scene.world, scene.body = World(None), RigidBody(1.0, (1, 2, 3))
    run = ac.build(scene).simulate(50.0, {scene.body.frame.angular_velocity: (0.1, 5, 0.2)})
    norms = np.linalg.norm(run.solution.x[:4], axis=0)
    assert np.max(np.abs(norms - 1)) < 1e-15


def test_stiff_relaxation_switches_to_radau():
    p = problem(lambda t, x: (-1e6 * (x[0] - ca.cos(t)),), 1)
    solution = integrate(p, np.array([0.0]), 0, 10.0, Accuracy(1e-8, 1e-8))
    lag = 1e-6  # x = (cos t + lag sin t) / (1 + lag^2) after the boundary layer
    assert "radau" in solution.statistics.method
    assert abs(solution.x[0, -1] - (np.cos(10) + lag * np.sin(10))) < 2e-8  # atol + rtol |x|
    assert solution.statistics.steps < 500


def test_van_der_pol_against_scipy():
    from scipy.integrate import solve_ivp

    mu = 1e3
    p = problem(lambda t, x: (x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]), 2)
    solution = integrate(p, np.array([2.0, 0.0]), 0, 1500.0, Accuracy(1e-9, 1e-9))
    rate = lambda t, x: [x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]]  # noqa: E731
    reference = solve_ivp(rate, (0, 1500), [2.0, 0.0], method="Radau", rtol=1e-10, atol=1e-12).y[0, -1]
    assert solution.status.kind is StatusKind.SUCCESS
    assert abs(solution.x[0, -1] - reference) < 1e-6


@pytest.mark.parametrize("method", ["radau", "cvodes", "idas", "rosenbrock"])
def test_other_methods_agree_with_gauss(method):
    scene = DoublePendulum()
    model = ac.build(scene)
    start = {scene.shoulder.q: 0.6, scene.elbow.q: 0.3}
    fine = model.simulate(2.0, start, rtol=1e-12)
    other = model.simulate(2.0, start, rtol=1e-9, method=method, samples=11)
    assert np.max(np.abs(other[scene.elbow.q] - fine.at(other.t)[scene.elbow.q])) < 3e-6
    assert method in other.statistics.method


def test_builtin_method_keeps_a_loop_closed():
    scene = FourBar()
    run = ac.build(scene).simulate(2.0, {scene.a.q: -0.5, scene.a.v: 3.0}, rtol=1e-8, method="idas", samples=21)
    assert run.constraint_error() < 1e-12
    assert run.energy_error() < 1e-5


def test_failures_are_data():
    blow_up = problem(lambda t, x: (x[0] ** 2,), 1)
    solution = integrate(blow_up, np.array([1.0]), 0, 2.0, Accuracy(1e-8, 1e-8))
    assert solution.status.kind in (StatusKind.STEP_UNDERFLOW, StatusKind.NON_FINITE, StatusKind.NOT_CONVERGED)
    assert abs(solution.t[-1] - 1.0) < 1e-3
    few = integrate(kepler(0.5)[0], kepler(0.5)[1], 0, 100.0, Accuracy(1e-8, 1e-8, max_steps=10))
    assert few.status.kind is StatusKind.MAX_STEPS
    nan = integrate(blow_up, np.array([np.nan]), 0, 1.0, Accuracy(1e-8, 1e-8))
    assert nan.status.kind is StatusKind.NON_FINITE


@pytest.mark.parametrize(
    ("method", "order"), [("gauss", 2), ("gauss", 4), ("gauss", 6), ("radau", 1), ("radau", 3), ("radau", 5)]
)
def test_step_function_has_its_order(method, order):
    scene = DoublePendulum()
    model = ac.build(scene)
    step = model.step(method, order)
    x0 = np.array([0.6, 0.3, 0.0, 0.0])
    fine = model.simulate(1.0, {scene.shoulder.q: 0.6, scene.elbow.q: 0.3}, rtol=1e-13).solution.x[:, -1]
    errors = []
    counts = {1: (400, 800), 2: (200, 400), 3: (160, 320)}.get(order, (40, 80))
    for n in counts:
        x = x0
        for k in range(n):
            x, residual = step(k / n, x, [], [], 1 / n)
            assert float(residual) < 1e-10
        errors.append(np.max(np.abs(np.array(x).ravel() - fine)))
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.1


@pytest.mark.parametrize(("make", "velocity"), [(FourBar, lambda s: s.a.v), (bennett_linkage, lambda s: s.joints[0].v)])
def test_steps_keep_loops_closed(make, velocity):
    """As in `simulate`; hundreds of coarse steps would open them by millimetres."""
    scene = make()
    model = ac.build(scene)
    step = model.step("gauss", 4, 0.005)
    y = ca.MX.sym("y", len(model.state_names))
    one = ca.Function("one", [y], [step(0.0, y, [], [])[0]])
    states = np.array(one.mapaccum(600)(model.initial_state({velocity(scene): 3.0}).x))
    gaps = np.array(model.functions.invariants(0, states, [], []))
    assert np.isfinite(states).all() and np.ptp(states[0]) > 0.5
    assert np.max(np.abs(gaps)) < 1e-12


def test_step_function_is_differentiable_and_makes_c(tmp_path):
    """Its Jacobian agrees with central differences; its C, compiled by a plain C compiler, gives the same numbers."""
    from acausal.export.c_source import compiler

    model = ac.build(DoublePendulum())
    step = model.step("gauss", 4)
    x0 = np.array([0.6, 0.3, 0.4, -0.2])
    x = ca.MX.sym("x", 4)
    jacobian = np.array(ca.Function("J", [x], [ca.jacobian(step(0, x, [], [], 0.05)[0], x)])(x0))
    h = 1e-6
    central = np.stack(
        [
            (np.array(step(0, x0 + d, [], [], 0.05)[0]) - np.array(step(0, x0 - d, [], [], 0.05)[0])).ravel() / (2 * h)
            for d in h * np.eye(4)
        ],
        axis=1,
    )
    assert np.max(np.abs(jacobian - central)) < 1e-8
    fixed = model.step("gauss", 4, 0.05)
    assert fixed.n_in() == 4
    assert np.array_equal(np.array(fixed(0, x0, [], [])[0]), np.array(step(0, x0, [], [], 0.05)[0]))
    found = compiler()
    assert found is not None
    code = f"import os; os.chdir({str(tmp_path)!r})\nimport casadi as ca\nca.Function.load('step.casadi').generate('step.c')"
    step.save(str(tmp_path / "step.casadi"))
    subprocess.run([sys.executable, "-c", code], check=True)
    subprocess.run(
        [*found, "-O1", "-fPIC", "-shared", "-o", str(tmp_path / "step.so"), str(tmp_path / "step.c"), "-lm"], check=True
    )
    compiled = ca.external("gauss4_step", str(tmp_path / "step.so"))
    again = np.array(compiled(0, x0, ca.DM(0, 1), ca.DM(0, 1), 0.05)[0])
    assert np.max(np.abs(again - np.array(step(0, x0, [], [], 0.05)[0]))) < 1e-13


def test_steps_drop_into_opti():
    """The velocity that brings a spring pendulum to a point in half a second, by shooting through implicit steps."""
    scene = ac.System()
    scene.world, scene.bob, scene.spring = World(), Particle(1.0), Spring(40.0, 0.5)
    scene.connect(scene.world.frame, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.bob.point)
    model = ac.build(scene)
    step = model.step("gauss", 6)
    opti = ca.Opti()
    v = opti.variable(3)
    x = ca.vertcat(ca.DM([0.8, 0, 0]), v)
    for _ in range(25):
        x = step(0, x, [], [], 0.02)[0]
    opti.subject_to(x[:3] == ca.DM([0.0, 0.3, -0.6]))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    found = opti.solve().value(v)
    run = model.simulate(0.5, {scene.bob.point.position: (0.8, 0, 0), scene.bob.point.velocity: found}, rtol=1e-10)
    assert np.max(np.abs(run[scene.bob.point.position][-1] - [0.0, 0.3, -0.6])) < 1e-6


@pytest.mark.parametrize(("method", "order"), [("gauss", 4), ("radau", 3)])
def test_step_function_has_its_order_where_time_drives(method, order):
    """x'' = cos 3 t."""
    scene = ac.System()
    scene.world, scene.body = World(None), Particle(1.0)
    scene.push = Force((np.cos(3 * ac.time), 0, 0))
    scene.connect(scene.push.point, scene.body.point)
    model = ac.build(scene)
    step = model.step(method, order)
    errors = []
    for n in (20, 40):
        x = model.initial_state().x
        for k in range(n):
            x, _ = step(k / n, x, [], [], 1 / n)
        errors.append(abs(float(x[0]) - (1 - np.cos(3)) / 9))
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.1


@pytest.mark.parametrize("stages", [3, 4, 5, 6, 8, 10, 12])
def test_what_a_step_leaves_of_its_rates_is_carried_on_as_fast_motions_do(stages):
    """The integral over a step of exp(z (1 - t)) P_s(t) is s! / (2 s + 1)! z^s / Q(z) for small z, Q the product of 1 - lambda z over the eigenvalues of A; of large ones,
    with the part of (1 - gamma z)^-1 that is real, gamma the most real eigenvalue, it is not much more."""
    eigenvalues = np.linalg.eigvals(gauss_legendre(stages).A)
    gamma = eigenvalues[np.argmin(np.abs(eigenvalues.imag))]
    nodes, weights = np.polynomial.legendre.leggauss(200)
    P = np.polynomial.legendre.legval(nodes, [0] * stages + [1])
    first = math.factorial(stages) / math.factorial(2 * stages + 1)
    for size in 1.2 * stages * np.array([0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 6.0]):
        for z in (1j * size, -size):
            exact = abs(np.sum(weights / 2 * np.exp(z * (1 - nodes) / 2) * P))
            plain = first * abs(z**stages / np.prod(1 - eigenvalues * z))
            forgotten = abs(0.5 / (1 - gamma * z) + 0.5 / (1 - np.conj(gamma) * z))
            assert size > 0.4 * stages or plain == pytest.approx(exact, rel=0.02)
            assert exact < 7 * plain * forgotten
