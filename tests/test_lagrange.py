"""Accelerations agree with Lagrange's equations, derived by sympy from the scene's energies and nothing of ours."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import acausal as ac
from components import CartesianTranslation, Particle, Prismatic, Revolute, RigidBody, Screw, Spring, World
from tests.scenes import DoublePendulum

t = sp.Symbol("t")


def accelerations(L: sp.Expr, q: list[sp.Function], values: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """q'' at one state, from d/dt dL/dq' = dL/dq."""
    v = [c.diff(t) for c in q]
    qs, vs = sp.symbols(f"q0:{len(q)}"), sp.symbols(f"v0:{len(q)}")
    M, h = sp.zeros(len(q), len(q)), sp.zeros(len(q), 1)
    flat = L.subs(dict(zip(v, vs, strict=True))).subs(dict(zip(q, qs, strict=True)))
    for i in range(len(q)):
        momentum = sp.diff(flat, vs[i])
        h[i] = sp.diff(flat, qs[i]) - sum(sp.diff(momentum, qs[j]) * vs[j] for j in range(len(q)))
        for j in range(len(q)):
            M[i, j] = sp.diff(momentum, vs[j])
    f = sp.lambdify([*qs, *vs], [M, h], "numpy")
    numbers, right = f(*values, *rates)
    return np.linalg.solve(np.array(numbers, dtype=float), np.array(right, dtype=float)).ravel()


def check(scene: ac.System, L: sp.Expr, q: list, order: list[int] | None = None) -> None:
    model = ac.build(scene)
    n = len(q)
    assert model.system.x.numel() == 2 * n
    rng = np.random.default_rng(7)
    for _ in range(5):
        values, rates = rng.uniform(-1.2, 1.2, n) + 0.1, rng.uniform(-2, 2, n)
        ours = np.array(model.functions.explicit_dynamics(0.0, np.concatenate([values, rates]), [], [])).ravel()[n:]
        reference = accelerations(L, q, values, rates)
        assert np.max(np.abs(ours - reference)) < 1e-12 * (1 + np.max(np.abs(reference)))


def test_planar_double_pendulum():
    a, b = sp.Function("a")(t), sp.Function("b")(t)
    g, up = sp.Rational(981, 100), sp.Matrix([0, 1])

    def rod(start, angle):
        along = sp.Matrix([-sp.sin(angle), -sp.cos(angle)])
        centre = start + along / 2
        v = centre.diff(t)
        return v.dot(v) / 2 + angle.diff(t) ** 2 / 24 - g * centre.dot(up), start + along

    one, tip = rod(sp.Matrix([0, 0]), a)
    two, _ = rod(tip, a + b)
    check(DoublePendulum(), one + two, [a, b])


def test_cart_with_a_spring_and_a_pendulum():
    x, a = sp.Function("x")(t), sp.Function("a")(t)
    g = sp.Rational(981, 100)
    scene = ac.System()
    scene.world, scene.rail, scene.hinge = World(), Prismatic("x"), Revolute("y")
    scene.cart, scene.rod = RigidBody.box(2.0, (0.3, 0.2, 0.1)), RigidBody.rod(1.0, (0, 0, -1))
    scene.spring = Spring(30.0, 0.5)
    for one, two in (
        (scene.world.frame, scene.rail.frame_a),
        (scene.rail.frame_b, scene.cart.frame),
        (scene.cart.frame, scene.hinge.frame_a),
        (scene.hinge.frame_b, scene.rod.frame),
        (scene.spring.point_a, scene.world.at((-2, 0, 0.5))),
        (scene.spring.point_b, scene.cart.frame),
    ):
        scene.connect(one, two)
    centre = sp.Matrix([x - sp.sin(a) / 2, -sp.cos(a) / 2])
    v = centre.diff(t)
    length = sp.sqrt((x + 2) ** 2 + sp.Rational(1, 4))
    L = x.diff(t) ** 2 + v.dot(v) / 2 + a.diff(t) ** 2 / 24 - g * centre[1] - 15 * (length - sp.Rational(1, 2)) ** 2
    check(scene, L, [x, a])


def test_spatial_arm_of_three_joints():
    """A turntable, a tilting arm of general inertia and a telescope."""
    a, b, s = (sp.Function(n)(t) for n in "abs")
    scene = ac.System()
    scene.world, scene.table, scene.tilt, scene.slide = World(), Revolute("z"), Revolute("y"), Prismatic("x")
    I = sp.Matrix([[0.3, 0.02, -0.03], [0.02, 0.4, 0.05], [-0.03, 0.05, 0.5]])  # noqa: E741
    scene.arm = RigidBody(2.0, tuple(tuple(float(v) for v in I.row(i)) for i in range(3)), (0.4, 0.1, -0.2))
    scene.hand = Particle(0.7)
    for one, two in (
        (scene.world.frame, scene.table.frame_a),
        (scene.table.frame_b, scene.tilt.frame_a),
        (scene.tilt.frame_b, scene.arm.frame),
        (scene.arm.at((0.5, 0, 0.1)), scene.slide.frame_a),
        (scene.slide.frame_b, scene.hand.point),
    ):
        scene.connect(one, two)
    Rz = sp.Matrix([[sp.cos(a), -sp.sin(a), 0], [sp.sin(a), sp.cos(a), 0], [0, 0, 1]])
    Ry = sp.Matrix([[sp.cos(b), 0, sp.sin(b)], [0, 1, 0], [-sp.sin(b), 0, sp.cos(b)]])
    R = Rz * Ry
    w = R.T * R.diff(t)
    w = sp.Matrix([w[2, 1], w[0, 2], w[1, 0]])
    c, p = R * sp.Matrix([0.4, 0.1, -0.2]), R * sp.Matrix([0.5 + s, 0, 0.1])
    T = c.diff(t).dot(c.diff(t)) + (w.T * I * w)[0] / 2 + 0.35 * p.diff(t).dot(p.diff(t))
    check(scene, T - 9.81 * (2 * c[2] + 0.7 * p[2]), [a, b, s])


def test_two_particles_on_a_spring_in_space():
    q = [sp.Function(f"q{i}")(t) for i in range(6)]
    scene = ac.System()
    scene.world, scene.one, scene.two, scene.spring = World(), Particle(1.2), Particle(0.8), Spring(40.0, 0.7)
    scene.connect(scene.spring.point_a, scene.one.point)
    scene.connect(scene.spring.point_b, scene.two.point)
    if not ac.build(scene).state_names[0].startswith("one"):  # their masses decide which comes first
        q = q[3:] + q[:3]
    r1, r2 = sp.Matrix(q[:3]), sp.Matrix(q[3:])
    length = sp.sqrt((r2 - r1).dot(r2 - r1))
    T = 0.6 * r1.diff(t).dot(r1.diff(t)) + 0.4 * r2.diff(t).dot(r2.diff(t))
    check(scene, T - 9.81 * (1.2 * r1[2] + 0.8 * r2[2]) - 20 * (length - 0.7) ** 2, sorted(q, key=str))


@pytest.mark.parametrize("pitch", [0.5, -0.2])
def test_screw_and_gantry(pitch):
    q = [sp.Function(f"q{i}")(t) for i in range(4)]
    scene = ac.System()
    scene.world, scene.gantry, scene.screw = World(), CartesianTranslation(), Screw("x", pitch)
    scene.frame, scene.nut = RigidBody.box(3.0, (1, 1, 1)), RigidBody(1.5, (0.2, 0.3, 0.4), (0.0, 0.2, 0.1))
    for one, two in (
        (scene.world.frame, scene.gantry.frame_a),
        (scene.gantry.frame_b, scene.frame.frame),
        (scene.frame.frame, scene.screw.frame_a),
        (scene.screw.frame_b, scene.nut.frame),
    ):
        scene.connect(one, two)
    a, lead = q[3], pitch / (2 * sp.pi)
    base = sp.Matrix(q[:3])
    c = base + sp.Matrix([lead * a, 0.2 * sp.cos(a) - 0.1 * sp.sin(a), 0.2 * sp.sin(a) + 0.1 * sp.cos(a)])
    T = 1.5 * base.diff(t).dot(base.diff(t)) + 0.75 * c.diff(t).dot(c.diff(t)) + 0.1 * a.diff(t) ** 2
    check(scene, T - 9.81 * (3 * q[2] + 1.5 * c[2]), q)
