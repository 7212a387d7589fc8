"""What Pontryagin's principle says of motions of least cost: costates that follow from textbook equations along the motion make the Hamiltonian stationary in
what is free, and it keeps its value, zero where the time is free.

L. S. Pontryagin et al., The Mathematical Theory of Optimal Processes (1962); for the signs A. E. Bryson and Y. C. Ho, Applied Optimal Control (1975), 2.3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal.optimal_control.mesh import Mesher
from benchmarks.optimal_control import Textbook, by_hand, cart_pole, cart_pole_by_hand
from components import Revolute, RigidBody, TorqueSource, World

G, MASS, LENGTH = 9.81, 1.3, 0.7


def arm_by_hand(size: float) -> ca.Function:
    """Two thin rods in a plane, angles from hanging and between them, torques at both hinges."""
    length = size * LENGTH
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    a, b = x[0], x[0] + x[1]
    wa, wb = x[2], x[2] + x[3]
    half, inertia = length / 2, MASS * length**2 / 12
    first = half * ca.vertcat(ca.sin(a), -ca.cos(a))
    second = 2 * first + half * ca.vertcat(ca.sin(b), -ca.cos(b))
    speeds = [ca.jtimes(place, x[:2], x[2:]) for place in (first, second)]
    kinetic = sum(0.5 * MASS * ca.sumsqr(v) for v in speeds) + 0.5 * inertia * (wa**2 + wb**2)
    potential = MASS * G * (first[1] + second[1])
    momenta = ca.gradient(kinetic, x[2:])
    forces = ca.gradient(kinetic - potential, x[:2]) + u - ca.jtimes(momenta, x[:2], x[2:])
    return ca.Function("rate", [x, u], [ca.vertcat(x[2:], ca.solve(ca.jacobian(momenta, x[2:]), forces))])


def arm(time: Any, size: float) -> tuple[ac.OptimalControl, list[Any]]:
    """Swings up."""
    scene = ac.System()
    scene.torques = [ac.Input("N*m") for _ in range(2)]
    scene.world, scene.hinges = World(gravity=(0, 0, -G)), [Revolute("-y") for _ in range(2)]
    scene.rods = [RigidBody.rod(MASS, (0, 0, -size * LENGTH)) for _ in range(2)]
    scene.motors = [TorqueSource(torque) for torque in scene.torques]
    before = scene.world.frame
    for hinge, rod, motor in zip(scene.hinges, scene.rods, scene.motors, strict=True):
        scene.connect(before, hinge.frame_a)
        scene.connect(hinge.frame_b, rod.frame)
        scene.connect(motor.flange, hinge.flange)
        before = rod.tip
    ocp = ac.OptimalControl(ac.build(scene), time)
    ocp.start({hinge.q: 0 for hinge in scene.hinges})
    ocp.end({scene.hinges[0].q: np.pi, scene.hinges[1].q: 0.0} | {hinge.v: 0 for hinge in scene.hinges})
    return ocp, scene.torques


def costates(best: ac.Optimum, rate: ca.Function, running: Callable[[Any, Any], Any], most: float) -> tuple[float, np.ndarray]:
    """Of the costates that make it most nearly so: by how much the Hamiltonian is not stationary where no bound presses, of how much inputs change it; and the Hamiltonian, in
    units of what it is made of.

    Costates at the end are unknown, and those before follow from them linearly.
    """
    n, nu = rate.size1_in(0), rate.size1_in(1)
    x, u = ca.SX.sym("x", n), ca.SX.sym("u", nu)
    f = rate(x, u)
    cost = running(x, u)
    adjoint = -ca.jacobian(f, x).T
    ahead = ca.Function("ahead", [x, u], [ca.densify(f), ca.densify(adjoint), ca.densify(-ca.gradient(cost, x))])
    slopes = ca.Function("slopes", [x, u], [ca.densify(ca.jacobian(f, u)), ca.densify(ca.gradient(cost, u)), cost, f])
    inputs = list(best.inputs.values())

    def given(t: float) -> np.ndarray:
        return np.array([float(np.asarray(one(np.array([t]))).ravel()[0]) for one in inputs])

    def back(t: float, y: np.ndarray) -> np.ndarray:
        rates, matrix, own = (np.array(one) for one in ahead(y[:n], given(t)))
        P = y[n:].reshape(n, n + 1)
        moved = matrix @ P
        moved[:, -1] += own.ravel()
        return np.append(rates.ravel(), moved)

    rows, asked, places = list[np.ndarray](), list[np.ndarray](), list[tuple[np.ndarray, ...]]()
    P = np.eye(n, n + 1)
    for k in range(best.t.size - 1, 0, -1):
        span = (best.t[k], best.t[k - 1])
        found = solve_ivp(
            back, span, np.append(best.x[:, k], P), "DOP853", rtol=1e-10, atol=1e-12, t_eval=[0.5 * sum(span), span[1]]
        )
        inside, P = (column[n:].reshape(n, n + 1) for column in found.y.T)
        here, now = found.y[:n, 0], given(found.t[0])
        B, own, running_cost, rates = (np.array(one) for one in slopes(here, now))
        free = np.abs(now) < most * (1 - 1e-3)
        rows.append((B.T @ inside[:, :n])[free])
        asked.append(-(own.ravel() + B.T @ inside[:, n])[free])
        places.append((inside, rates.ravel(), running_cost.ravel()))
    A, b = np.vstack(rows), np.concatenate(asked)
    end = np.linalg.lstsq(A, b, rcond=None)[0]
    terms = [(c[0], rates @ (inside @ np.append(end, 1.0))) for inside, rates, c in places]
    unit = max(abs(one) for pair in terms for one in pair)
    return float(np.max(np.abs(A @ end - b)) / np.max(np.abs(b))), np.array([sum(pair) for pair in terms]) / unit


def test_a_cart_pole_swings_up_with_a_hamiltonian_that_lasts() -> None:
    best = cart_pole().solve(40, order=9)
    off, hamiltonian = costates(best, cart_pole_by_hand().rate, lambda x, u: ca.sumsqr(u), 20.0)
    assert off < 1e-4 and np.ptp(hamiltonian) < 1e-5


@pytest.mark.parametrize("size", [1e-3, 1.0])
def test_where_the_time_is_free_the_hamiltonian_is_none(size: float) -> None:
    """Two rods swing up, with bounded torques, in a time that costs, too."""
    ocp, torques = arm(ac.free(0.5 * np.sqrt(size), 4 * np.sqrt(size)), size)
    unit, most = size, 20.0 * size
    price = 300.0
    ocp.minimise(ac.integral(sum((torque / unit) ** 2 for torque in torques)) + ac.integral(price))
    for torque in torques:
        ocp.bound(torque, -most, most)
    best = ocp.solve(40, order=9)
    off, hamiltonian = costates(best, arm_by_hand(size), lambda x, u: ca.sumsqr(u / unit) + price, most)
    assert off < 1e-4 and np.max(np.abs(hamiltonian)) < 1e-5


def test_two_rods_swing_up_as_their_textbook_equations_say() -> None:
    """The same collocation by hand, in Opti."""
    ocp, torques = arm(1.2, 1.0)
    ocp.minimise(ac.integral(sum(torque**2 for torque in torques)))
    for torque in torques:
        ocp.bound(torque, -15, 15)
    best = ocp.solve(25, refinements=0)
    assert np.max(np.abs(best.x[2:])) > 3  # it turns
    end, none = np.array([np.pi, 0, 0, 0]), np.full(4, np.inf)
    textbook = Textbook(arm_by_hand(1.0), 1.2, np.zeros(4), end, np.full(2, 15.0), none, np.ones(2))
    part = replace(ocp.part(Mesher(25, 5, "free", "ipopt")), guess=best.motion)
    assert by_hand(textbook, part, 0.0).cost == pytest.approx(best.cost, rel=1e-8)
