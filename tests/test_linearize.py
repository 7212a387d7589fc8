"""Linear systems against closed forms, finite differences of the dynamics, and sympy's linearizer."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import acausal as ac
from acausal.analysis.point import Differentiable, OperatingPoint
from acausal.errors import OptionError, StartValueError, UnknownVariableError
from components import (
    Capacitor,
    Fixed,
    Force,
    Ground,
    Inductor,
    Particle,
    Prismatic,
    Resistor,
    Revolute,
    RigidBody,
    RollingBall,
    SlidingMass,
    Spherical,
    TranslationalGround,
    TranslationalSpring,
    VoltageSource,
    World,
)
from examples.bicycle import Bicycle
from tests.analysis_scenes import Motor, Top
from tests.pairings import each_value
from tests.scenes import DoublePendulum, FourBar, Pendulum, bennett_linkage
from tests.similar import SCENES, Units

G = 9.81


def mass_chain(count: int, mass: float, stiffness: float) -> ac.System:
    """Equal masses in a row between two walls, a spring at either side of each."""
    scene = ac.System()
    scene.walls = [TranslationalGround(), TranslationalGround()]
    scene.masses = [SlidingMass(mass) for _ in range(count)]
    scene.springs = [TranslationalSpring(stiffness) for _ in range(count + 1)]
    ends = [scene.walls[0].flange, *(m.flange_a for m in scene.masses), scene.walls[1].flange]
    for spring, (one, two) in zip(scene.springs, pairwise(ends), strict=True):
        scene.connect(one, spring.flange_a)
        scene.connect(spring.flange_b, two)
    return scene


@pytest.mark.parametrize("near", [1e-3, 1e-7])
def test_states_may_hardly_differ_and_hardly_change(near: float):
    """Sums that nearly are the other state, of which some stand next to a large constant."""
    scene = mass_chain(2, 0.3, 50.0)
    one, other = scene.masses
    states = [one.s, 1e6 + one.s + near * other.s, one.v, one.v + near * other.v]
    found = ac.build(scene).linearize(states=states)
    T, K = np.kron(np.eye(2), [[1.0, 0.0], [1.0, near]]), 50.0 / 0.3 * np.array([[-2.0, 1.0], [1.0, -2.0]])
    A = T @ np.block([[np.zeros((2, 2)), np.eye(2)], [K, np.zeros((2, 2))]]) @ np.linalg.inv(T)
    assert np.max(np.abs(found.A - A)) < 1e-14 / near * np.max(np.abs(A))


def test_a_chain_of_masses_has_the_frequencies_of_the_discrete_string():
    n, m, k = 12, 0.3, 50.0
    found = ac.build(mass_chain(n, m, k)).linearize()
    exact = 2 * np.sqrt(k / m) * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    np.testing.assert_allclose(found.frequencies * 2 * np.pi, exact, rtol=1e-12)
    assert found.stability == "neutral" and found.steady and found.constant


def test_the_shapes_of_a_chain_are_sines():
    scene = mass_chain(5, 1.0, 100.0)
    found = ac.build(scene).linearize(states=[e for m in scene.masses for e in (m.flange_a.s, m.v)])
    for j, mode in enumerate(found.oscillations, start=1):
        shape = np.array([mode[f"masses[{i}].v"] for i in range(5)])
        sine = np.sin(j * np.pi * np.arange(1, 6) / 6)
        np.testing.assert_allclose(shape / shape[0], sine / sine[0], atol=1e-10)


def test_the_hanging_double_pendulum_has_its_two_closed_frequencies():
    found = ac.build(DoublePendulum(length=0.7, mass=1.3)).linearize()
    M, K = np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]]), G / 0.7 * np.diag([3 / 2, 1 / 2])
    exact = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real))
    np.testing.assert_allclose([m.angular_frequency for m in found.modes()], exact, rtol=1e-12)
    # absolute angles of the slow mode: from (K - w^2 M) a = 0
    slow = found.oscillations[0]
    a = slow["shoulder.q"], slow["shoulder.q"] + slow["elbow.q"]
    expected = -(K[0, 0] - exact[0] ** 2 * M[0, 0]) / (-(exact[0] ** 2) * M[0, 1])
    assert a[1] / a[0] == pytest.approx(expected, rel=1e-10)


def parallelogram(length: float = 0.8, base: float = 0.5) -> ac.System:
    """Two hanging bars and a coupler that stays level."""
    scene = ac.System()
    scene.world = World()
    scene.left, scene.right = RigidBody.rod(1.0, (0, 0, -length)), RigidBody.rod(1.0, (0, 0, -length))
    scene.coupler = RigidBody.rod(3.0, (base, 0, 0))
    scene.a, scene.b, scene.c, scene.d = (Revolute("y") for _ in range(4))
    scene.connect(scene.world.frame, scene.a.frame_a)
    scene.connect(scene.a.frame_b, scene.left.frame)
    scene.connect(scene.left.tip, scene.b.frame_a)
    scene.connect(scene.b.frame_b, scene.coupler.frame)
    scene.connect(scene.coupler.tip, scene.c.frame_a)
    scene.connect(scene.c.frame_b, scene.right.tip)
    scene.connect(scene.world.at((base, 0, 0)), scene.d.frame_a)
    scene.connect(scene.d.frame_b, scene.right.frame)
    return scene


def test_a_hanging_parallelogram_swings_as_its_energy_says():
    length, bar, coupler = 0.8, 1.0, 3.0
    scene = parallelogram(length)
    found = ac.build(scene).linearize({scene.a.q: 0.0, scene.d.q: 0.0, scene.b.q: 0.0})
    exact = G * (bar + coupler) / ((2 / 3 * bar + coupler) * length)
    assert len(found.states) == 2
    np.testing.assert_allclose(found.eigenvalues, [1j * np.sqrt(exact), -1j * np.sqrt(exact)], rtol=1e-12, atol=1e-12)


def differences(model: ac.Model, found, h: float = 1e-5) -> np.ndarray:
    """A by central differences: independent states are displaced, the others follow from closed loops."""
    names = [model.state_names.index(n) for n in found.states]
    point = found.point

    def rates(k: int, step: float) -> np.ndarray:
        x = point.x + step * found.expand[:, k]
        for _ in range(8):
            g = np.array(model.functions.invariants(point.t, x, point.u, point.p)).ravel()
            J = np.array(ca.DM(model.functions.invariants.jacobian()(point.t, x, point.u, point.p, g)[1]))
            J = np.vstack([J, np.eye(x.size)[names]])
            x = x - np.linalg.pinv(J, rcond=1e-8) @ np.concatenate([g, (x - point.x)[names] - step * np.eye(len(names))[k]])
        return np.array(model.functions.explicit_dynamics(point.t, x, point.u, point.p)).ravel()[names]

    return np.column_stack([(rates(k, h) - rates(k, -h)) / (2 * h) for k in range(len(names))])


def test_a_moving_four_bar_agrees_with_finite_differences():
    scene = FourBar()
    model = ac.build(scene)
    found = model.linearize({scene.a.q: 0.9, scene.a.v: 2.0})
    assert len(found.states) == 2 and not found.steady and not found.constant
    np.testing.assert_allclose(found.A, differences(model, found), rtol=1e-6, atol=1e-6)


def test_a_loop_with_redundant_constraints_agrees_with_finite_differences():
    scene = bennett_linkage()
    model = ac.build(scene)
    found = model.linearize({scene.joints[0].v: 1.5})
    assert len(found.states) == 2
    np.testing.assert_allclose(found.A, differences(model, found), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(("spin", "unstable"), [((3.0, 0, 0), False), ((0, 3.0, 0), True), ((0, 0, 3.0), False)])
def test_a_free_body_turns_stably_about_its_extreme_axes_only(spin: tuple[float, ...], unstable: bool):
    inertia = np.array([0.1, 0.2, 0.25])
    scene = ac.System()
    scene.world = World(gravity=(0, 0, 0))
    scene.body = RigidBody(2.0, tuple(inertia))
    turned = np.array([0.5, -0.5, 0.1, 0.7])
    turned /= np.linalg.norm(turned)
    found = ac.build(scene).linearize([*turned, 1, 2, 3, *spin, 0, 0, 0])
    assert found.states[0].endswith("rotation[0]") and len(found.states) == 12
    assert found.constant and not found.steady
    i = int(np.argmax(spin))
    j, k = (i + 1) % 3, (i + 2) % 3
    square = (inertia[i] - inertia[j]) * (inertia[k] - inertia[i]) / (inertia[j] * inertia[k]) * 9.0
    assert (found.stability == "unstable") == unstable == (square > 0)
    for value in (np.sqrt(complex(square)), 3j):  # Euler's equations; the attitude error seen in the turning body
        assert np.min(np.abs(found.eigenvalues - value)) < 1e-10


def steady_top(theta: float, spin_momentum: float, A: float, weight: float) -> float:
    """The slow precession rate: A cos(theta) w^2 - L w + m g h = 0."""
    return min(np.roots([A * np.cos(theta), -spin_momentum, weight]).real)


def test_a_precessing_top_nods_at_the_closed_frequency():
    A, C, mass, height, theta, momentum = 0.02, 0.01, 1.5, 0.1, 0.6, 1.1
    rate = steady_top(theta, momentum, A, mass * G * height)
    scene = Top(A, C, mass, height)
    found = ac.build(scene).linearize(
        {
            scene.nutation.q: theta,
            scene.precession.v: rate,
            scene.spin.v: momentum / C - rate * np.cos(theta),
        },
        states=[scene.nutation.q, scene.nutation.v, scene.precession.v, scene.spin.v],
    )
    assert found.steady and found.constant
    # reduced potential (p - L cos)^2 / (2 A sin^2) + m g h cos, p and L the two momenta; its curvature by complex steps
    p = A * rate * np.sin(theta) ** 2 + momentum * np.cos(theta)

    def slope(angle: complex) -> complex:
        s, c = np.sin(angle), np.cos(angle)
        lifted = p - momentum * c
        return lifted * momentum * s / (A * s**2) - lifted**2 * c / (A * s**3) - mass * G * height * s

    curvature = slope(theta + 1e-30j).imag / 1e-30
    assert found.oscillations[0].angular_frequency == pytest.approx(np.sqrt(curvature / A), rel=1e-10)
    assert sum(m.eigenvalue == 0 for m in found.modes()) == 2  # the two momenta


def test_a_sleeping_top_is_stable_above_the_critical_spin():
    A, C, mass, height = 0.02, 0.01, 1.5, 0.1
    scene = ac.System()
    scene.world, scene.socket = World(), Spherical()
    scene.rotor = RigidBody(mass, (A - mass * height**2,) * 2 + (C,), (0, 0, height))
    scene.connect(scene.world.frame, scene.socket.frame_a)
    scene.connect(scene.socket.frame_b, scene.rotor.frame)
    model = ac.build(scene)
    critical = np.sqrt(4 * A * mass * G * height) / C
    fast, slow = (model.linearize([1, 0, 0, 0, 0, 0, f * critical]) for f in (1.0001, 0.9999))
    assert fast.stability == "neutral" and slow.stability == "unstable" and fast.constant


def test_a_pendulum_on_a_cart_has_the_textbook_matrices():
    M, m, length = 2.0, 0.4, 0.6
    scene = ac.System()
    scene.world, scene.rail, scene.hinge = World(), Prismatic("x"), Revolute("y")
    scene.cart, scene.push = RigidBody.box(M, (0.3, 0.2, 0.1)), ac.Input("N")
    scene.pole, scene.bob = Fixed((0, 0, length)), Particle(m)
    scene.force = Force((scene.push, 0, 0))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.hinge.frame_a)
    scene.connect(scene.rail.frame_b, scene.cart.frame)
    scene.connect(scene.force.point, scene.cart.frame)
    scene.connect(scene.hinge.frame_b, scene.pole.frame_a)
    scene.connect(scene.pole.frame_b, scene.bob.point)
    found = ac.build(scene).linearize(
        states=[scene.rail.q, scene.rail.v, scene.hinge.q, scene.hinge.v], outputs=[scene.bob.point.position[0], scene.push]
    )
    A = [[0, 1, 0, 0], [0, 0, -m * G / M, 0], [0, 0, 0, 1], [0, 0, (M + m) * G / (M * length), 0]]
    np.testing.assert_allclose(found.A, A, atol=1e-12)
    np.testing.assert_allclose(found.B, [[0], [1 / M], [0], [-1 / (M * length)]], atol=1e-12)
    np.testing.assert_allclose(found.C, [[1, 0, length, 0], [0, 0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(found.D, [[0], [1]], atol=1e-12)
    assert found.stability == "unstable" and found.inputs == ("push",)
    assert found.to_scipy().A.shape == (4, 4)


def circuit(R: float, L: float, Cap: float) -> ac.System:
    scene = ac.System()
    scene.voltage = ac.Input("V")
    scene.ground, scene.source = Ground(), VoltageSource(scene.voltage)
    scene.resistor, scene.inductor, scene.capacitor = Resistor(R), Inductor(L), Capacitor(Cap)
    ring = [scene.source, scene.resistor, scene.inductor, scene.capacitor]
    scene.connect(scene.source.pin_b, scene.ground.pin)
    scene.connect(scene.source.pin_a, scene.resistor.pin_a)
    for one, two in pairwise(ring[1:]):
        scene.connect(one.pin_b, two.pin_a)
    scene.connect(scene.capacitor.pin_b, scene.ground.pin)
    return scene


def test_a_series_circuit_has_its_closed_eigenvalues_and_gain():
    R, L, Cap = 3.0, 2e-3, 5e-6
    scene = circuit(R, L, Cap)
    found = ac.build(scene).linearize(outputs=[scene.capacitor.v])
    exact = np.roots([L * Cap, R * Cap, 1.0])
    np.testing.assert_allclose(np.sort_complex(found.eigenvalues), np.sort_complex(exact), rtol=1e-12)
    mode = found.oscillations[0]
    assert mode.damping_ratio == pytest.approx(R / 2 * np.sqrt(Cap / L), rel=1e-12)
    at_rest = found.D - found.C @ np.linalg.solve(found.A, found.B)
    np.testing.assert_allclose(at_rest, [[1.0]], rtol=1e-12)


def test_a_geared_motor_has_the_poles_of_its_characteristic_polynomial():
    R, L, k, J, load, d, ratio = 1.2, 3e-3, 0.05, 2e-5, 4e-3, 1e-3, 8.0
    scene = Motor(ac.Input("V"), R, L, k, J, d, (ratio, load))
    found = ac.build(scene).linearize(states=[scene.inductor.i, scene.load.w], outputs=[scene.load.w])
    total = load + ratio**2 * J
    exact = np.roots([L * total, R * total + L * d, R * d + (ratio * k) ** 2])
    np.testing.assert_allclose(np.sort_complex(found.eigenvalues), np.sort_complex(exact), rtol=1e-11)
    gain = (found.D - found.C @ np.linalg.solve(found.A, found.B)).item()
    assert gain == pytest.approx(ratio * k / (R * d + (ratio * k) ** 2), rel=1e-11)


def test_a_rolling_ball_goes_on_in_any_direction():
    scene = ac.System()
    scene.world, scene.contact, scene.ball = World(), RollingBall(0.1), RigidBody.ball(0.5, 0.1)
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    found = ac.build(scene).linearize()
    assert len(found.states) == 8  # three turns, two places, three rates: two rates of places are not free
    assert found.steady and np.all(found.eigenvalues == 0)


def test_sympys_linearizer_gives_the_same_matrices():
    sympy = pytest.importorskip("sympy")
    from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

    a, b = dynamicsymbols("a b")
    ad, bd, t = a.diff(), b.diff(), dynamicsymbols._t
    m, length = sympy.Rational(3, 2), sympy.Rational(4, 5)
    x = [length * sympy.sin(a), length * (sympy.sin(a) + sympy.sin(a + b))]
    z = [-length * sympy.cos(a), -length * (sympy.cos(a) + sympy.cos(a + b))]
    T = sum(m / 2 * (p.diff(t) ** 2 + q.diff(t) ** 2) for p, q in zip(x, z, strict=True))
    method = LagrangesMethod(T - sum(m * sympy.Float(G) * q for q in z), [a, b])
    method.form_lagranges_equations()
    at = {a: 0.4, b: -0.7, ad: 1.1, bd: 0.3}
    M, f = (np.array(part.subs(at), float) for part in (method.mass_matrix, method.forcing))
    at |= dict(zip([ad.diff(t), bd.diff(t)], np.linalg.solve(M, f).ravel(), strict=True))  # accelerations are held
    expected = np.array(method.linearize(q_ind=[a, b], qd_ind=[ad, bd], A_and_B=True, op_point=at)[0], float)
    scene = ac.System()
    scene.world, scene.upper, scene.lower = World(), Revolute("y"), Revolute("y")
    scene.rods = [Fixed((0, 0, -0.8)), Fixed((0, 0, -0.8))]
    scene.bobs = [Particle(1.5), Particle(1.5)]
    scene.connect(scene.world.frame, scene.upper.frame_a)
    scene.connect(scene.upper.frame_b, scene.rods[0].frame_a)
    scene.connect(scene.rods[0].frame_b, scene.bobs[0].point)
    scene.connect(scene.rods[0].frame_b, scene.lower.frame_a)
    scene.connect(scene.lower.frame_b, scene.rods[1].frame_a)
    scene.connect(scene.rods[1].frame_b, scene.bobs[1].point)
    start = {scene.upper.q: 0.4, scene.lower.q: -0.7, scene.upper.v: 1.1, scene.lower.v: 0.3}
    found = ac.build(scene).linearize(start)
    np.testing.assert_allclose(found.A, expected, atol=1e-10)


def test_a_conical_pendulum_has_a_constant_linear_system():
    scene = ac.System()
    length, theta = 0.9, 0.7
    scene.world, scene.turn, scene.tilt = World(), Revolute("z"), Revolute("y")
    scene.rod, scene.bob = Fixed((0, 0, -length)), Particle(0.3)
    scene.connect(scene.world.frame, scene.turn.frame_a)
    scene.connect(scene.turn.frame_b, scene.tilt.frame_a)
    scene.connect(scene.tilt.frame_b, scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, scene.bob.point)
    start = {scene.tilt.q: theta, scene.turn.v: np.sqrt(G / (length * np.cos(theta)))}
    model = ac.build(scene)
    found = model.linearize(start, states=[scene.tilt.q, scene.tilt.v, scene.turn.v])
    assert found.steady and found.constant
    exact = np.sqrt(G / length * (1 + 3 * np.cos(theta) ** 2) / np.cos(theta))
    assert found.oscillations[0].angular_frequency == pytest.approx(exact, rel=1e-11)
    whole = model.linearize(start)
    assert whole.constant and not whole.steady and "stays the same" in str(whole)
    with pytest.raises(OptionError, match=r"the rate of tilt\.v also depends on turn\.v"):
        model.linearize(start, states=[scene.tilt.q, scene.tilt.v])
    with pytest.raises(OptionError, match=r"output turn\.q also depends"):
        model.linearize(start, states=[scene.tilt.q, scene.tilt.v, scene.turn.v], outputs=[scene.turn.q])


def test_a_swinging_pendulum_is_frozen_even_where_gravity_is_stationary():
    scene = Pendulum()
    found = ac.build(scene).linearize({scene.hinge.v: 0.3})
    assert not found.steady and not found.constant and "frozen" in str(found)


def test_parameters_change_the_linear_system_without_a_new_build():
    scene = ac.System()
    scene.g = ac.Parameter(9.81)
    scene.world, scene.hinge, scene.rod = World((0, 0, -1.0 * scene.g)), Revolute("y"), RigidBody.rod(1.0, (0, 0, -1.0))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    model = ac.build(scene)
    for g in (9.81, 1.62):
        found = model.linearize(parameters={scene.g: g})
        assert found.oscillations[0].angular_frequency == pytest.approx(np.sqrt(1.5 * g), rel=1e-12)


def test_the_linear_system_predicts_the_nonlinear_motion():
    scene = DoublePendulum()
    model = ac.build(scene)
    found = model.linearize()
    import scipy.linalg

    start = np.array([1e-5, -2e-5, 0.0, 1e-5])
    run = model.simulate(
        1.0, dict(zip([scene.shoulder.q, scene.elbow.q, scene.shoulder.v, scene.elbow.v], start, strict=True)), rtol=1e-12
    )
    np.testing.assert_allclose(scipy.linalg.expm(found.A) @ start, run.x[:, -1], atol=1e-13)


def test_wrong_questions_are_answered_in_words():
    scene = DoublePendulum()
    model = ac.build(scene)
    with pytest.raises(OptionError, match="must be a list"):
        model.linearize(states=scene.shoulder.q)
    with pytest.raises(OptionError, match="not a variable"):
        model.linearize(states=[3])  # type: ignore[list-item]
    with pytest.raises(OptionError, match="empty"):
        model.linearize(states=[])
    with pytest.raises(OptionError, match="depend on one another"):
        model.linearize(states=[scene.shoulder.q, 2 * scene.shoulder.q])
    with pytest.raises(OptionError, match="cannot change"):
        model.linearize(states=[scene.lower.tip.position[1]])
    with pytest.raises(StartValueError, match="4 finite numbers"):
        model.linearize([0.0, 1.0])
    with pytest.raises(UnknownVariableError):
        model.linearize(states=[Pendulum().hinge.q])
    with pytest.raises(OptionError, match=r"no ac\.Input"):
        model.linearize().to_scipy()
    for t in (float("nan"), "now"):
        with pytest.raises(OptionError, match="time"):
            model.linearize(t=t)  # type: ignore[arg-type]
    with pytest.raises(StartValueError, match="not 'home'"):
        model.linearize("home")  # type: ignore[arg-type]


@each_value(("length", [1e-9, 1e-3, 1.0, 1e3, 1e9]), ("time", [1e-9, 1.0, 1e9]))
def test_a_state_that_opens_a_loop_is_refused_in_any_unit(length: float, time: float):
    """What is rounded to eight digits is taken, what is off in the fourth is not: in positions and in velocities."""
    similar = SCENES["slider_crank"](Units(length=length, time=time))
    model = ac.build(similar.scene)
    x = model.initial_state(similar.start).x
    model.linearize(np.array([float(f"{value:.8e}") for value in x]))
    for k in np.flatnonzero(x):
        off = x.copy()
        off[k] *= 1 + 1e-4
        with pytest.raises(StartValueError, match="violate the constraints"):
            model.linearize(off)


def test_a_flat_parallelogram_is_singular_and_says_so():
    scene = parallelogram()
    with pytest.raises(OptionError, match="singular position"):
        ac.build(scene).linearize({scene.a.q: np.pi / 2, scene.d.q: np.pi / 2})


# Meijaard, Papadopoulos, Ruina and Schwab, Proceedings of the Royal Society A 463 (2007), table 2, and the two speeds given there
BICYCLE = {
    0: (3.131643247906, -3.131643247906, 5.530943717654, -5.530943717654),
    1: (3.526961709901 + 0.807740275199j, 3.526961709901 - 0.807740275199j, -3.134231250666, -7.110080146374),
    2: (2.682345175127 + 1.680662965907j, 2.682345175127 - 1.680662965907j, -3.071586456415, -8.673879848317),
    3: (1.706756056640 + 2.315824473843j, 1.706756056640 - 2.315824473843j, -2.633661372537, -10.351014672459),
    4: (0.413253315211 + 3.079108186032j, 0.413253315211 - 3.079108186032j, -1.429444273613, -12.158614265764),
    5: (-0.775341882196 + 4.464867713788j, -0.775341882196 - 4.464867713788j, -0.322866429004, -14.078389692798),
    6: (-1.526444865841 + 5.876730605987j, -1.526444865841 - 5.876730605987j, -0.004066900770, -16.085371230980),
    7: (-2.138756442584 + 7.195259133298j, -2.138756442584 - 7.195259133298j, 0.102681705748, -18.157884661252),
    8: (-2.693486835811 + 8.460379713969j, -2.693486835811 - 8.460379713969j, 0.143278797657, -20.279408943945),
    9: (-3.216754022525 + 9.693773515318j, -3.216754022525 - 9.693773515318j, 0.157901840309, -22.437885590408),
    10: (-3.720168404373 + 10.906811394763j, -3.720168404373 - 10.906811394763j, 0.161053386532, -24.624596350174),
}
WEAVE, CAPSIZE = 4.29238253634111, 6.02426201538837


@pytest.fixture(scope="module")
def rolling_bicycle():
    """speed [m/s] -> the linear system in lean, steer and their rates; speed, place, heading are ignorable."""
    scene = Bicycle()
    model = ac.build(scene)
    states = [scene.rear_contact.q[1], scene.steering.q, scene.rear_contact.v[0], scene.steering.v]
    return lambda speed: model.linearize(scene.start(speed), states=states)


def test_a_bicycle_has_the_published_eigenvalues_in_lean_and_steer(rolling_bicycle):
    for speed, exact in BICYCLE.items():
        found = rolling_bicycle(speed)
        assert found.A.shape == (4, 4) and found.steady and found.constant
        np.testing.assert_allclose(np.sort_complex(found.eigenvalues), np.sort_complex(np.array(exact)), atol=1e-10, rtol=0)


def test_a_bicycle_is_stable_between_weave_and_capsize_speed(rolling_bicycle):
    weave = brentq(lambda v: rolling_bicycle(v).oscillations[0].eigenvalue.real, 4.0, 5.0, xtol=1e-14, rtol=1e-14)
    capsize = brentq(lambda v: np.linalg.det(rolling_bicycle(v).A), 5.5, 6.5, xtol=1e-14, rtol=1e-14)
    assert weave == pytest.approx(WEAVE, abs=1e-11) and capsize == pytest.approx(CAPSIZE, abs=1e-11)
    assert [rolling_bicycle(v).stability for v in (4.2, 5.0, 6.1)] == ["unstable", "asymptotically stable", "unstable"]


@pytest.mark.parametrize("seed", range(6))
def test_a_body_on_a_ball_joint_swings_the_same_whatever_the_attitudes_of_frames(seed):
    """Moments of weight against inertia about the point of suspension; the four numbers of an attitude have no freedom less than three."""
    rng = np.random.default_rng(seed)
    (principal, placed, at_body, at_world), down = Rotation.random(4, rng).as_matrix(), np.array([0, 0, -rng.uniform(0.2, 2.0)])
    mass, weight = rng.uniform(0.1, 10.0, 2)
    own = mass * (down @ down) * principal @ np.diag(rng.uniform(0.5, 0.7, 3)) @ principal.T
    scene = ac.System()
    scene.world = World((0, 0, -weight / mass))
    scene.body = RigidBody(mass, placed.T @ own @ placed, tuple(placed.T @ down), rotation=placed)
    scene.joint = Spherical()
    scene.connect(scene.world.at((0, 0, 0), at_world), scene.joint.frame_a)
    scene.connect(scene.joint.frame_b, scene.body.at((0, 0, 0), at_body))
    about = own + mass * (down @ down * np.eye(3) - np.outer(down, down))
    square = np.linalg.eigvals(np.linalg.solve(about, -weight * down[2] * np.diag([1.0, 1.0, 0.0]))).real
    linear = ac.build(scene).linearize()
    assert linear.stability == "neutral"
    expected = np.sqrt(np.sort(square)[1:])
    assert np.sort(np.abs(linear.eigenvalues.imag)) == pytest.approx(
        np.repeat([0, *expected], 2), rel=1e-7, abs=1e-6 * expected[0]
    )


def test_directions_side_by_side_have_the_bits_of_each_alone():
    """Derivatives of a double pendulum's rates along all directions, and along one at a time."""
    scene = DoublePendulum()
    functions = ac.build(scene).functions
    s = functions.outputs.system
    rates, rng = Differentiable(s, s.x_dot), np.random.default_rng(3)
    at = OperatingPoint(0.0, rng.normal(size=s.x.numel()), np.zeros(s.u.numel()), np.array(s.p_values))
    directions = rng.normal(size=(s.x.numel(), 5))
    together = rates.along(at, directions, dt=0.3)
    alone = [rates.along(at, directions[:, [k]], dt=0.3)[:, 0] for k in range(5)]
    assert np.array_equal(together, np.column_stack(alone))
