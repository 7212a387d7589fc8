"""Regulators and filters: closed forms, and what closed loops of the whole scene then cost."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

import acausal as ac
from acausal.errors import OptionError
from components import ForceSource, Particle, Prismatic, World
from tests.pairings import each_value
from tests.test_optimal_control import CartPole, DrivenFourBar, Sledge


def test_regulator_of_a_mass_is_that_of_textbooks() -> None:
    """x'' = u: K = (sqrt(q1 / r), sqrt(q2 / r + 2 sqrt(q1 / r))) (Bryson and Ho)."""
    scene = Sledge()
    found = ac.lqr(ac.build(scene).linearize({scene.rail.q: 0.7}), [4.0, 3.0], 0.25)
    assert found.gain() == pytest.approx(np.array([[4.0, np.sqrt(12 + 2 * 4.0)]]), rel=1e-12)
    assert found([0.8, 0.1]) == pytest.approx([-(0.1 * 4 + 0.1 * np.sqrt(20))])
    assert repr(found) == f"<Regulator: 1 input from 2 states, errors decay by {np.sqrt(5) - 1:.4g} / s at least>"


@each_value(("size", [1e-12, 1.0, 1e12]), ("seen", [(1.0, 3.0), (0.1, 0.7), (1e-3, 0.3), (1e3, 0.7)]))
def test_what_one_sum_of_states_costs_is_weighed_in_any_unit(seen: tuple[float, float], size: float) -> None:
    """(c x)^2 + r u^2: the product of both states costs nothing in the end."""
    scene, (a, b) = Sledge(), seen
    found = ac.lqr(ac.build(scene).linearize({scene.rail.q: 0.7}), size * np.outer(seen, seen), 0.25 * size)
    assert found.gain() == pytest.approx(np.array([[2 * a, np.sqrt(4 * b**2 + 4 * a)]]), rel=1e-9)


def test_filter_of_a_mass_is_that_of_textbooks() -> None:
    """x'' = w of intensity q, x seen with noise r: L = (sqrt(2) (q / r)^1/4, (q / r)^1/2)."""
    scene = Sledge()
    found = ac.kalman(ac.build(scene).linearize(outputs=[scene.rail.q]), None, 3.0, 0.02)
    ratio = 3.0 / 0.02
    assert found.gain()[:, 0] == pytest.approx([np.sqrt(2) * ratio**0.25, ratio**0.5], rel=1e-10)


def test_regulator_along_a_motion_is_that_of_the_hamiltonian_matrix() -> None:
    scene = Sledge()
    run = ac.build(scene).simulate(1.5, {scene.rail.v: 0.4})
    found = ac.lqr(run, {scene.rail.q: 4.0, scene.rail.v: 3.0}, {scene.force: 0.25}, end={scene.rail.q: 50.0})
    A, B = np.array([[0.0, 1], [0, 0]]), np.array([[0.0], [1]])
    H = np.block([[A, -B @ B.T / 0.25], [-np.diag([4.0, 3]), -A.T]])
    for t in (0.0, 0.9):
        back = scipy.linalg.expm(-H * (1.5 - t)) @ np.vstack([np.eye(2), np.diag([50.0, 0])])
        P = back[2:] @ np.linalg.inv(back[:2])
        assert found.gain(t) == pytest.approx(B.T @ P / 0.25, rel=1e-5)


def test_filter_along_a_motion_becomes_steady() -> None:
    scene = Sledge()
    model = ac.build(scene)
    found = ac.kalman(model.simulate(6.0, {scene.rail.v: 0.4}), [scene.rail.q], 3.0, 0.02, start=0.5)
    steady = ac.kalman(model.linearize(outputs=[scene.rail.q]), None, 3.0, 0.02)
    assert found.gain(6.0) == pytest.approx(steady.gain(), rel=1e-5)
    assert found.covariances[0] == pytest.approx(0.5 * np.eye(2))
    assert repr(found) == "<Filter: 2 states from 1 measurement, from 0 to 6 s>"


def closed_loop(
    model: ac.Model, regulator: Any, x: np.ndarray, end: float, pay: Any, rtol: float = 1e-8
) -> tuple[np.ndarray, float]:
    """States at the end, and what was paid, of the scene itself."""
    f = model.functions

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        u = regulator(y[:-1], t)
        return np.append(np.array(f.explicit_dynamics(t, y[:-1], u, f.space.p_values)).ravel(), pay(t, y[:-1], u))

    found = scipy.integrate.solve_ivp(rate, (0, end), np.append(x, 0.0), rtol=rtol, atol=1e-12)
    return found.y[:-1, -1], float(found.y[-1, -1])


def test_a_pole_is_held_up_at_the_cost_foretold() -> None:
    scene = CartPole()
    model = ac.build(scene)
    hold = ac.lqr(model.linearize({scene.hinge.q: np.pi}), [10.0, 50, 1, 1], 0.1)
    assert hold.eigenvalues is not None and np.max(np.real(hold.eigenvalues)) < -1
    up = np.array([0, np.pi, 0, 0])
    weights = np.array([10.0, 50, 1, 1])
    first = up + np.array([0.001, 0.002, 0, 0.001])
    last, paid = closed_loop(model, hold, first, 8.0, lambda t, x, u: weights @ (x - up) ** 2 + 0.1 * u[0] ** 2)
    assert np.allclose(last, up, atol=1e-6)
    assert paid == pytest.approx(hold.cost(first), rel=1e-3)
    far, _ = closed_loop(model, hold, up + np.array([0.2, 0.3, 0, 0]), 8.0, lambda t, x, u: 0.0)
    assert np.allclose(far, up, atol=1e-3)


def test_a_four_bar_follows_its_motion_at_the_cost_foretold() -> None:
    """One independent deviation of six states; its coordinates change on the way."""
    scene = DrivenFourBar()
    model = ac.build(scene)
    run = model.simulate(0.3, {scene.a.q: 0.3, scene.a.v: 12.0})
    follow = ac.lqr(run, {scene.a.q: 900.0, scene.a.v: 1.0}, {scene.torque: 0.02})
    a, v = model.state_names.index("a.q"), model.state_names.index("a.v")

    def pay(t: float, x: np.ndarray, u: np.ndarray) -> float:
        there = run.at(min(t, 0.3)).x[:, 0]
        return 900 * (x[a] - there[a]) ** 2 + (x[v] - there[v]) ** 2 + 0.02 * u[0] ** 2

    first = np.array(model.initial_state({scene.a.q: 0.3001, scene.a.v: 12.0}).x)
    last, paid = closed_loop(model, follow, first, 0.3, pay, 1e-6)
    there = run.x[:, -1]
    paid += 900 * (last[a] - there[a]) ** 2 + (last[v] - there[v]) ** 2
    assert paid == pytest.approx(follow.cost(first), rel=0.01)
    assert np.max(np.abs(last - there)[: model.functions.space.nq]) < 1e-5


def test_a_filter_along_a_loop_is_that_of_its_one_equation() -> None:
    """A four-bar whose crank is shaken and whose rocker is measured: the textbook's equation for the angle of the crank with its Riccati equation, and what these say of all states."""
    scene, disturbed, noise = DrivenFourBar(), 3.0, 1e-5
    model = ac.build(scene)
    found = ac.kalman(model.simulate(0.5, {scene.a.q: 0.3, scene.a.v: 12.0}), [scene.d.q], disturbed, noise)
    q, v, torque, g = ca.SX.sym("q"), ca.SX.sym("v"), ca.SX.sym("torque"), 9.81
    A, D = 0.4 * ca.vertcat(ca.cos(q), ca.sin(q)), ca.vertcat(1.0, 0.0)  # angles turn about y, from x to -z
    far = ca.norm_2(D - A)
    along = (far**2 + 1.2**2 - 0.8**2) / (2 * far)
    way = (D - A) / far
    C = A + along * way - ca.sqrt(1.2**2 - along**2) * ca.vertcat(-way[1], way[0])
    coupler, rocker = (ca.atan2(one[1], one[0]) for one in (C - A, C - D))
    M = 0.4**2 / 3 + 2.0 * ca.sumsqr(ca.jacobian((A + C) / 2, q)) + 2.0 * 1.2**2 / 12 * ca.jacobian(coupler, q) ** 2
    M += 1.5 * 0.8**2 / 3 * ca.jacobian(rocker, q) ** 2
    height = -g * (1.0 * A[1] / 2 + 2.0 * (A + C)[1] / 2 + 1.5 * C[1] / 2)
    x = ca.vertcat(q, v)
    f = ca.vertcat(v, (torque - ca.jacobian(M, q) * v**2 / 2 - ca.jacobian(height, q)) / M)
    angles = {"a.q": q, "b.q": coupler - q, "c.q": rocker - coupler, "d.q": rocker}
    angles |= {name.replace("q", "v"): ca.jacobian(angle, q) * v for name, angle in angles.items()}
    seen = ca.vertcat(*(angles[name] for name in model.state_names))
    textbook = ca.Function(
        "textbook", [x], [ca.substitute(f, torque, 0), *(ca.substitute(ca.jacobian(f, z), torque, 0) for z in (x, torque)), ca.jacobian(rocker, x), ca.jacobian(seen, x)]
    )  # fmt: skip

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        own, A, B, C, _ = (np.array(one) for one in textbook(z[:2]))
        P = z[2:].reshape(2, 2)
        return np.append(own, A @ P + P @ A.T + disturbed * B @ B.T - P @ C.T @ C @ P / noise)

    first = [0.3, 12.0, *np.zeros(4)]
    y = scipy.integrate.solve_ivp(rate, (0, 0.5), first, rtol=1e-10, atol=1e-14, t_eval=found.times).y.T
    for k in (20, 80, 160):
        *_, C, E = (np.array(one) for one in textbook(y[k, :2]))
        spread = E @ y[k, 2:].reshape(2, 2) @ E.T
        gain = E @ y[k, 2:].reshape(2, 2) @ C.T / noise
        assert np.max(np.abs(found.covariances[k] - spread)) < 1e-5 * np.max(spread)
        assert np.max(np.abs(found.gains[k] - gain)) < 1e-5 * np.max(np.abs(gain))


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_a_filter_that_forgets_at_once_is_steady_in_any_unit(size: float) -> None:
    """Seen with hardly any noise: errors decay in a fraction of a millisecond, along motions of a second. Units of forces and lengths have no say in it."""
    scene: Any = ac.System()
    scene.force, scene.world, scene.rail, scene.body = ac.Input("N"), World(), Prismatic("x"), Particle(2.0 / size)
    scene.motor = ForceSource(scene.force)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.body.point)
    scene.connect(scene.motor.flange, scene.rail.flange)
    found = ac.kalman(ac.build(scene).simulate(1.0, {scene.rail.v: 0.4 * size}), [scene.rail.q], 4.0, 1e-14 * size**2)
    assert found.gain(1.0)[:, 0] == pytest.approx([2**0.5 * 10**3.5, 1e7], rel=1e-7)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda s, m: ac.lqr(m, 1.0, 1.0), "give a linearization"),
        (lambda s, m: ac.lqr(m.linearize(), [1.0, 2.0, 3.0], 1.0), "must be a number, 2 numbers"),
        (lambda s, m: ac.lqr(m.linearize(), -1.0, 1.0), "must not be negative"),
        (lambda s, m: ac.lqr(m.linearize(), 1.0, 0.0), "must be positive"),
        (lambda s, m: ac.lqr(m.linearize(), [[2e-10, 1e-10], [0.0, 2e-10]], 1e-10), "symmetric"),
        (
            lambda s, m: ac.kalman(m.linearize(outputs=[s.rail.q, s.rail.v]), None, 1.0, np.outer([1, 3e-3], [1, 3e-3])),
            "must be positive",
        ),
        (lambda s, m: ac.lqr(m.simulate(1.0), 1.0, 1.0), "say what is weighed"),
        (lambda s, m: ac.lqr(m.simulate(1.0), {s.rail.q: 1.0}, {}), "says nothing of force"),
        (lambda s, m: ac.kalman(m.linearize(outputs=[s.rail.v]), None, 1.0, 1.0), "no output sees rail.q"),
    ],
)
def test_regulators_that_make_no_sense_are_refused_in_words(ask: Any, words: str) -> None:
    scene = Sledge()
    with pytest.raises(OptionError, match=words):
        ask(scene, ac.build(scene))
