"""Elastic bodies: published motions, closed forms of beams, Lagrange's equations of their masses, conservation, reactions."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.errors import LockedError, MasslessError, ParameterError
from acausal.visual.scene import animation_of
from components import (
    FlexibleBeam,
    FlexibleBody,
    Force,
    Free,
    Prismatic,
    Revolute,
    RigidBody,
    Section,
    ShapeIntegrals,
    Spherical,
    World,
)  # fmt: skip
from tests.momentum import angular_momentum, linear_momentum
from tests.pairings import each_value
from tests.test_reduction import acceleration_operations

_SPEC = importlib.util.spec_from_file_location("crank", Path(__file__).parents[1] / "examples" / "flexible_slider_crank.py")
assert _SPEC is not None and _SPEC.loader is not None
crank = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(crank)

# Own solution of the equations of the IVP test set's "crank" (Simeon 1996; undamped, linear stiffness) in quadruple precision, Gragg's
# extrapolation, 24 digits; its end agrees with the published one (MEBDFI, 1e-14) to 2e-10 in the slider and 6e-12 in the amplitudes.
# Rod angle, slider, four amplitudes, and their rates at 0.01, 0.05 and 0.1 s.
CRANK_REFERENCE = np.array([
    [-0.5221639691885428043226194, 0.2706282471161275161236992, 0.0008319205130080009144675712, 0.00004738752652921801048606525,
     -0.000003497730782432978991253652, -0.000005662271471125995545115754, -6.126044599498846565037936, -23.36248862468131965390064,
     -0.2563746766272106281229147, 0.0009987172171376708008499459, -0.001475328271260265633883269, -0.00259201694698523297691114],
    [-0.488158117057644507333132, 0.3169547865126356788400825, 0.001273942652374460013266193, 0.00004208688675381360131518163,
     -0.0000001270513744675377648389475, 3.290771218049241901858479e-8, -29.44252498026975416980991, -25.25091788469589014490521,
     -0.246820724582069035722119, 0.004197479712893985034121462, -0.002095625876471395961835092, -0.003798971866940165166076215],
    [-0.331173498825644666885474, 0.1697373326399585495591797, 0.0001893192843020042631716763, 0.00002375751320488572357994091,
     -0.00000532389677819238227797433, -0.000008363313291666579287043979, 60.25346755129602744985461, -8.753116326727139648574679,
     -0.03005541170950680363642271, -0.00550043064592527821364422, 0.0004974111663674608016180663, 0.001105559971607857516138884],
])  # fmt: skip

SECTION = Section.rectangle(0.02, 0.03)
MODULUS, DENSITY, LENGTH = 1e9, 2700.0, 1.2
MASS = DENSITY * 6e-4 * LENGTH
ALONG_Y, ALONG_Z = MODULUS * 0.03 * 0.02**3 / 12, MODULUS * 0.02 * 0.03**3 / 12
"""Flexural rigidity against bending along y and along z."""


def beam(**options) -> FlexibleBeam:
    return FlexibleBeam(LENGTH, SECTION, **{"youngs_modulus": MODULUS, "density": DENSITY, **options})


def connected(parts: dict[str, object], *pairs: tuple[str, str]) -> ac.System:
    """A scene of named parts, its connections as ("part.connector", "part.connector")."""
    scene = ac.System()
    for name, part in parts.items():
        setattr(scene, name, part)
    for pair in pairs:
        scene.connect(*(getattr(getattr(scene, path.split(".")[0]), path.split(".")[1]) for path in pair))
    return scene


@pytest.mark.parametrize("method", ["gauss", "radau"])
def test_flexible_slider_crank_moves_as_published(method):
    scene = crank.SliderCrank(crank.published_rod())
    start = {scene.main.q: 0.0, scene.pin.q: 0.0, scene.rod.q: crank.START_Q, scene.rod.v: crank.START_V}
    model = ac.build(scene)
    assert (model.degrees_of_freedom, model.system.constraints.jacobian.shape[0]) == (4, 2)
    run = model.simulate(0.1, start, rtol=1e-10, method=method)
    at = run.at(np.array([0.01, 0.05, 0.1]))
    found = np.column_stack([
        at[scene.main.q] + at[scene.pin.q], at[scene.guide.q], at[scene.rod.q], at[scene.main.v] + at[scene.pin.v], at[scene.guide.v], at[scene.rod.v]
    ])  # fmt: skip
    assert np.max(np.abs(found - CRANK_REFERENCE) / np.max(np.abs(CRANK_REFERENCE), axis=0)) < 1e-8
    assert np.max(np.abs(found - CRANK_REFERENCE)[:, :6]) < 1e-13
    assert run.energy_error() < 1e-11


def test_a_beam_has_the_integrals_of_the_published_rod_but_for_its_axial_mass():
    published, own = crank.published_rod(), crank.beam_rod().body()
    for name in ("first", "first_shapes", "second", "mixed", "second_shapes"):
        ours, theirs = getattr(own.integrals, name), getattr(published.integrals, name).copy()
        if name == "second_shapes":
            theirs[0, 0] /= 15  # a factor that the published matrix lacks
        assert np.max(np.abs(ours - theirs)) < 3e-8  # pi = 3.1415927 there
    stiffness = np.array(ca.DM(own.stiffness))
    assert np.max(np.abs(stiffness - published.stiffness)) < 1e-7 * np.max(published.stiffness)
    assert np.array(ca.DM(own.turning_inertia))[2, 2] == pytest.approx(
        published.turning_inertia[2, 2], abs=5e-11
    )  # given to 1e-10


def lumps(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Twelve masses at random places with three random shapes."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0.1, 0.4, 12), rng.normal(size=(12, 3)), 0.5 * rng.normal(size=(12, 3, 3))


def lagrange_accelerations(
    points, masses: np.ndarray, potential, damping: np.ndarray, q: np.ndarray, v: np.ndarray
) -> np.ndarray:
    """q'' of point masses at `points(q)` (3, m), by differentiation of their energies."""
    a, b = ca.SX.sym("q", q.size), ca.SX.sym("v", q.size)
    p = points(a)
    rates = ca.reshape(ca.jtimes(ca.vec(p), a, b), 3, masses.size)
    T = 0.5 * ca.dot(ca.sum1(rates * rates).T, ca.DM(masses))
    height = ca.dot(p[2, :].T, ca.DM(masses))
    L = T - 9.81 * height - potential(a)
    momentum = ca.gradient(L, b)
    M = ca.jacobian(momentum, b)
    right = ca.gradient(L, a) - ca.jtimes(momentum, a, b) - ca.SX(ca.DM(damping)) @ b
    numbers = ca.Function("f", [a, b], [M, right])(q, v)
    return np.linalg.solve(np.array(numbers[0]), np.array(numbers[1])).ravel()


@pytest.mark.parametrize("backwards", [False, True], ids=["held at the frame", "held at the tip"])
def test_accelerations_are_those_of_lagrange_for_the_masses(backwards):
    """A lumped body with damping on a hinge, with a rigid body of four particles at its other end; the hinge's axis is askew."""
    masses, places, shapes = lumps(3)
    rng = np.random.default_rng(8)
    stiffness, damping = np.diag([30.0, 50.0, 80.0]), np.diag([0.3, 0.1, 0.2])
    tip, tip_shapes, tip_turns = rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    ends, weights = rng.normal(size=(4, 3)), rng.uniform(0.2, 0.5, 4)
    centre = weights @ ends / np.sum(weights)
    arms = ends - centre
    inertia = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(weights, arms, strict=True))
    axis = np.array([2.0, -1.0, 2.0]) / 3
    scene = connected(
        {
            "world": World((0, 0, -9.81)),
            "hinge": Revolute(tuple(axis)),
            "body": FlexibleBody.lumped(
                masses, places, shapes, stiffness, damping=damping, tip=tip, tip_shapes=tip_shapes, tip_turns=tip_turns
            ),
            "load": RigidBody(float(np.sum(weights)), inertia, tuple(centre)),
        },
        ("world.frame", "hinge.frame_a"),
        ("hinge.frame_b", "body.frame_b" if backwards else "body.frame_a"),
        ("body.frame_a" if backwards else "body.frame_b", "load.frame"),
    )

    def rotation(w: ca.SX, half_tangent: bool) -> ca.SX:
        size = ca.norm_2(w)
        angle = 2 * ca.atan(size / 2) if half_tangent else size
        K = ca.skew(w / size)
        return ca.SX.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * K @ K

    def points(q: ca.SX) -> ca.SX:
        hinge, amplitudes = rotation(q[0] * axis, False), q[1:]
        own = [ca.DM(r) + ca.SX(ca.DM(S)) @ amplitudes for r, S in zip(places, shapes, strict=True)]
        R, p = rotation(ca.SX(ca.DM(tip_turns)) @ amplitudes, True), ca.DM(tip) + ca.SX(ca.DM(tip_shapes)) @ amplitudes
        if backwards:
            return hinge @ ca.horzcat(*(R.T @ (r - p) for r in own), *(R.T @ (ca.DM(r) - p) for r in ends))
        return hinge @ ca.horzcat(*own, *(p + R @ ca.DM(r) for r in ends))

    model = ac.build(scene)
    assert model.system.x.numel() == 8
    for _ in range(3):
        q, v = rng.uniform(0.1, 0.6, 4), rng.normal(size=4)
        ours = np.array(model.functions.explicit_dynamics(0.0, np.concatenate([q, v]), [], [])).ravel()[4:]
        padded = np.zeros((4, 4))
        padded[1:, 1:] = damping
        theirs = lagrange_accelerations(
            points,
            np.concatenate([masses, weights]),
            lambda a: 0.5 * ca.dot(a[1:], ca.SX(ca.DM(stiffness)) @ a[1:]),
            padded,
            q,
            v,
        )
        assert np.max(np.abs(ours - theirs)) < 1e-11 * np.max(np.abs(theirs))


def pendulum(backwards: bool, **options) -> ac.System:
    """A beam that bends both ways on a ball joint in the world's origin, with a body at its other end."""
    return connected(
        {"world": World((0, 0, -9.81)), "ball": Spherical(), "beam": beam(**options), "load": RigidBody(0.5, (0.1, 0.2, 0.15), (0.1, 0.2, 0.3))},
        ("world.frame", "ball.frame_a"),
        ("ball.frame_b", "beam.frame_b" if backwards else "beam.frame_a"),
        ("beam.frame_a" if backwards else "beam.frame_b", "load.frame"),
    )  # fmt: skip


def random_state(model: ac.Model, seed: int) -> np.ndarray:
    rng, s = np.random.default_rng(seed), model.system
    start = np.array(s.q_start) + 0.05 * rng.normal(size=s.nq)
    return np.concatenate([start, rng.normal(size=s.tree_velocities)])


@each_value(("backwards", [False, True]), ("modes", ["pinned", "craig-bampton"]))
def test_explicit_and_residual_form_agree(backwards, modes):
    for scene in (pendulum(backwards, modes=modes, axial=1), four_bar("abcd", modes), four_bar("dcba", modes)):
        model = ac.build(scene)
        x = random_state(model, 1)
        x_dot, multipliers = model.functions.explicit_dynamics(0.0, x, [], []), model.functions.multipliers(0.0, x, [], [])
        residual = np.array(model.functions.residual_dynamics(0.0, x, x_dot, multipliers, [], []))
        assert np.max(np.abs(residual)) < 1e-10 * np.max(np.abs(np.array(x_dot)))


def test_a_free_beam_keeps_energy_and_momenta():
    scene = connected({"world": World((0, 0, 0)), "beam": beam(bending=(2, 2), axial=1)})
    model = ac.build(scene)
    assert model.degrees_of_freedom == 11
    start = {
        scene.beam.v: (1.0, 0.5, 0.3, 0.2, 0.3),
        scene.beam.frame_a.angular_velocity: (1, 2, 3),
        scene.beam.frame_a.velocity: (1, 0, 2),
    }
    run = model.simulate(1.0, start, rtol=1e-11)
    assert run.energy_error() < 1e-12
    kinematics = model.system.mechanics.kinematics
    for momentum in (run[linear_momentum(kinematics)], run[angular_momentum(kinematics)]):
        assert np.max(np.ptp(momentum, axis=0)) < 1e-11 * np.max(np.abs(momentum))
    assert np.max(np.ptp(run[scene.beam.q], axis=0)) > 1e-3


@pytest.mark.parametrize("backwards", [False, True])
def test_energy_and_dissipation_balance(backwards):
    scene = pendulum(backwards, bending=(1, 1), axial=1, modes="craig-bampton", damping=1e-3)
    run = ac.build(scene).simulate(2.0, {scene.ball.v: (1.0, 2.0, 3.0)}, rtol=1e-10)
    assert run.energy_error() < 1e-9
    assert run.energy[-1] < run.energy[0] - 1e-3


def test_a_beam_at_one_end_is_carried_as_at_the_other():
    """Two bodies joined by a beam: the free joint is at the one or the other, so that the tree passes the beam either way."""
    motions = []
    for first in ("one", "two"):
        loads = {name: RigidBody(0.5, (0.1, 0.2, 0.15), (0.1, 0.2, 0.3)) for name in ("one", "two")}
        scene = connected(
            {"world": World((0, 0, 0)), **loads, "free": Free(), "beam": beam(bending=(2, 1), axial=1, modes="cantilever")},
            ("world.frame", "free.frame_a"),
            ("free.frame_b", f"{first}.frame"),
            ("one.frame", "beam.frame_a"),
            ("beam.frame_b", "two.frame"),
        )
        model = ac.build(scene)
        assert model.system.mechanics.tree.joints[-1].reversed == (first == "two")
        start = {
            scene.beam.q: (0.01, 0.003, 0.02, 0.001), scene.beam.v: np.zeros(4), scene.one.frame.position: np.zeros(3),
            scene.one.frame.rotation: np.eye(3), scene.one.frame.velocity: np.zeros(3), scene.one.frame.angular_velocity: (1.0, 2.0, 3.0),
        }  # fmt: skip
        run = model.simulate(0.5, start, rtol=1e-12)
        motions.append(np.hstack([run[scene.beam.q], run[scene.two.frame.position], run[scene.beam.frame_a.force] / 1e3]))
    assert np.max(np.abs(motions[0] - motions[1])) < 1e-10


def four_bar(order: str, modes: str = "pinned") -> ac.System:
    """Crank 0.4 m, elastic coupler 1.2 m, rocker 0.8 m; the joint that was named last is cut."""
    scene = ac.System()
    scene.world = World((0, 0, -9.81))
    scene.crank, scene.rocker = RigidBody.rod(1.0, (0.4, 0, 0)), RigidBody.rod(1.5, (0.8, 0, 0))
    scene.coupler = beam(bending=(0, 2), axial=1, modes=modes)
    for name in order:
        setattr(scene, name, Revolute("y"))
    for joint, one, two in (
        (scene.a, scene.world.frame, scene.crank.frame),
        (scene.b, scene.crank.tip, scene.coupler.frame_a),
        (scene.c, scene.coupler.frame_b, scene.rocker.tip),
        (scene.d, scene.world.at((1.0, 0, 0)), scene.rocker.frame),
    ):
        scene.connect(one, joint.frame_a)
        scene.connect(joint.frame_b, two)
    return scene


def test_an_elastic_coupler_moves_the_same_wherever_its_loop_is_cut():
    motions = []
    for order in ("abcd", "dcba", "bcda"):
        scene = four_bar(order)
        start = {
            scene.a.q: -0.5,
            scene.a.v: 3.0,
            scene.d.q: ac.near(-1.0),
            scene.coupler.q: np.zeros(3),
            scene.coupler.v: np.zeros(3),
        }
        run = ac.build(scene).simulate(0.3, start, rtol=1e-11)
        assert run.energy_error() < 1e-10
        assert run.constraint_error() < 1e-12
        motions.append(
            np.column_stack([run[scene.coupler.q], run[scene.coupler.frame_b.position], run[scene.coupler.frame_a.force] / 1e3])
        )
    for other in motions[1:]:
        assert np.max(np.abs(motions[0] - other)) < 1e-8


@pytest.mark.parametrize("backwards", [False, True])
def test_reactions_at_both_ends_are_what_momenta_ask_for(backwards):
    """A hinge askew in the world's origin, a beam, a load: the rates of all momenta at the hinge, those of the load at the load."""
    central, centre, mass = np.diag([0.1, 0.2, 0.15]), np.array([0.1, 0.2, 0.3]), 0.5
    scene = connected(
        {"world": World((0, 0, 0)), "hinge": Revolute((1, 2, 3)), "beam": beam(axial=1, modes="cantilever"), "load": RigidBody(mass, central, tuple(centre))},
        ("world.frame", "hinge.frame_a"),
        ("hinge.frame_b", "beam.frame_b" if backwards else "beam.frame_a"),
        ("beam.frame_a" if backwards else "beam.frame_b", "load.frame"),
    )  # fmt: skip
    model = ac.build(scene)
    system, outputs = model.system, model.functions.outputs
    near, far = (scene.beam.frame_b, scene.beam.frame_a) if backwards else (scene.beam.frame_a, scene.beam.frame_b)
    R, w, a = (
        outputs.resolve(q) for q in (scene.load.frame.rotation, scene.load.frame.angular_velocity, scene.load.centre.acceleration)
    )
    push = mass * a
    turn = outputs.rate(R @ ca.DM(central) @ R.T @ w) + ca.cross(R @ ca.DM(centre), push)
    all_of_them = system.mechanics.kinematics
    pairs = (
        (near.force, outputs.rate(linear_momentum(all_of_them))),
        (near.torque, outputs.rate(angular_momentum(all_of_them))),
        (far.force, -push),
        (far.torque, -turn),
    )
    f = ca.Function(
        "f", [system.x], [ca.horzcat(*(outputs.resolve(given) for given, _ in pairs)), ca.horzcat(*(w for _, w in pairs))]
    )
    for seed in range(3):
        given, wanted = (np.array(part) for part in f(random_state(model, seed)))
        assert np.max(np.abs(given - wanted)) < 1e-12 * np.max(np.abs(wanted))
        assert np.min(np.max(np.abs(wanted), axis=0)) > 1.0


def test_cantilevers_have_the_frequencies_of_euler_and_bernoulli():
    """cos b cosh b = -1: b = 1.8751, 4.6941, 7.8548 (Blevins, Formulas for Natural Frequency and Mode Shape, table 8-1)."""
    roots = np.array([1.87510407, 4.69409113, 7.85475744])
    wanted = np.sort([b**2 * np.sqrt(EI * LENGTH / MASS) / LENGTH**2 for b in roots for EI in (ALONG_Y, ALONG_Z)]) / (2 * np.pi)
    for modes, count, accuracy in (("cantilever", 3, 1e-8), ("craig-bampton", 8, 3e-4)):
        scene = connected(
            {"world": World((0, 0, 0)), "beam": beam(bending=(count, count), modes=modes)}, ("world.frame", "beam.frame_a")
        )
        model = ac.build(scene)
        assert model.linearize().frequencies[:6] == pytest.approx(wanted, rel=accuracy)
    assert model.system.tree_velocities == 16


def test_beams_in_a_row_are_finite_elements():
    """Each with the displacement and slope of its tip: the frequencies of a cantilever of two cubic beam elements, assembled here."""
    thin = Section(6e-4, 1e-16, 1e-16)  # sections without inertia of their own
    half, rigidity = LENGTH / 2, MODULUS * 1e-16

    def element() -> FlexibleBeam:
        return FlexibleBeam(half, thin, youngs_modulus=MODULUS, density=DENSITY, bending=(2, 0), modes="craig-bampton")

    scene = connected(
        {"world": World((0, 0, 0)), "one": element(), "two": element()},
        ("world.frame", "one.frame_a"),
        ("one.frame_b", "two.frame_a"),
    )
    L, mass = half, MASS / 2
    m = mass / 420 * np.array([
        [156, 22 * L, 54, -13 * L], [22 * L, 4 * L**2, 13 * L, -3 * L**2], [54, 13 * L, 156, -22 * L], [-13 * L, -3 * L**2, -22 * L, 4 * L**2]
    ])  # fmt: skip
    k = rigidity / L**3 * np.array([
        [12, 6 * L, -12, 6 * L], [6 * L, 4 * L**2, -6 * L, 2 * L**2], [-12, -6 * L, 12, -6 * L], [6 * L, 2 * L**2, -6 * L, 4 * L**2]
    ])  # fmt: skip
    M, K = np.zeros((6, 6)), np.zeros((6, 6))
    for first in (0, 2):
        M[first : first + 4, first : first + 4] += m
        K[first : first + 4, first : first + 4] += k
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(M[2:, 2:], K[2:, 2:])).real)
    assert ac.build(scene).linearize().frequencies == pytest.approx(np.sqrt(squares) / (2 * np.pi), rel=1e-7)


@pytest.mark.parametrize("length", [1.2e-3, 0.3, 1.2, 1.7, 1.2e3])
def test_a_beam_between_hinges_has_the_frequencies_of_sines(length):
    """Nothing turns the row along the beam: the slide has a size all the same."""
    section = Section.rectangle(length / 60, length / 40)
    scene = connected(
        {
            "world": World((0, 0, 0)),
            "beam": FlexibleBeam(length, section, youngs_modulus=MODULUS, density=DENSITY, bending=(3, 0)),
            "a": Revolute("z"),
            "b": Revolute("z"),
            "slide": Prismatic("x"),
        },
        ("world.frame", "a.frame_a"),
        ("a.frame_b", "beam.frame_a"),
        ("beam.frame_b", "b.frame_a"),
        ("b.frame_b", "slide.frame_b"),
        ("slide.frame_a", "world.frame"),
    )
    wanted = np.arange(1, 4) ** 2 * np.pi / 2 * np.sqrt(MODULUS / DENSITY / 12) / (60 * length)
    assert ac.build(scene).linearize().frequencies == pytest.approx(wanted, rel=1e-9)


def test_a_beam_held_at_both_ends_has_the_frequencies_of_clamped_ones():
    """cos b cosh b = 1: b = 4.7300407, 7.8532046; the ends are welded to one body."""
    scene = connected(
        {"world": World((0, 0, 0)), "beam": beam(bending=(5, 0), modes="craig-bampton")}, ("world.frame", "beam.frame_a")
    )
    scene.connect(scene.beam.frame_b, scene.world.at((LENGTH, 0, 0)))
    model = ac.build(scene)
    assert model.degrees_of_freedom == 3
    wanted = np.array([4.73004074, 7.85320462]) ** 2 * np.sqrt(ALONG_Y * LENGTH / MASS) / LENGTH**2 / (2 * np.pi)
    assert model.linearize().frequencies[:2] == pytest.approx(wanted, rel=1e-8)


def test_axial_shapes_have_the_frequencies_of_a_bar():
    """Fixed and free: (k - 1/2) pi c / L with c^2 = E / rho; polynomials of degree 6 give the first two to 1e-5."""
    scene = connected({"world": World((0, 0, 0)), "beam": beam(bending=(0, 0), axial=6)}, ("world.frame", "beam.frame_a"))
    wanted = (np.arange(2) + 0.5) / 2 * np.sqrt(MODULUS / DENSITY) / LENGTH
    assert ac.build(scene).linearize().frequencies[:2] == pytest.approx(wanted, rel=1e-5)


def test_a_force_at_the_tip_bends_turns_and_stretches_as_in_books():
    """F L^3 / 3 EI, F L^2 / 2 EI and F L / EA, and the moment F L at the clamp."""
    scene = connected(
        {
            "world": World((0, 0, 0)),
            "beam": beam(bending=(3, 2), axial=1, modes="craig-bampton"),
            "push": Force((2.0, 0.1, -0.2)),
        },
        ("world.frame", "beam.frame_a"),
        ("push.point", "beam.frame_b"),
    )
    found = ac.build(scene).equilibrium()
    y, z, x = 0.1 * LENGTH**3 / (3 * ALONG_Y), -0.2 * LENGTH**3 / (3 * ALONG_Z), 2.0 * LENGTH / (MODULUS * 6e-4)
    assert found[scene.beam.frame_b.position] == pytest.approx([LENGTH + x, y, z], rel=1e-8)
    assert found[scene.beam.deflection(1.0)] == pytest.approx([x, y, z], rel=1e-5)
    slope = found[scene.beam.frame_b.rotation].reshape(3, 3)[1:, 0]
    assert slope == pytest.approx([1.5 * y / LENGTH, 1.5 * z / LENGTH], rel=1e-3)
    assert found[scene.beam.frame_a.force] == pytest.approx([-2.0, -0.1, 0.2], rel=1e-8)
    assert found[scene.beam.frame_a.torque] == pytest.approx(
        [0.1 * z + 0.2 * y, -0.2 * (LENGTH + x) - 2 * z, 2 * y - 0.1 * (LENGTH + x)], abs=1e-8
    )


def test_damping_is_that_of_the_material():
    """Stress E (strain + d strain'): each frequency w decays by d w^2 / 2."""
    scene = connected(
        {"world": World((0, 0, 0)), "beam": beam(bending=(3, 0), modes="cantilever", damping=1e-4)},
        ("world.frame", "beam.frame_a"),
    )
    for value in ac.build(scene).linearize().eigenvalues:
        assert value.real == pytest.approx(-0.5e-4 * abs(value) ** 2, rel=1e-9)


def test_a_stiff_beam_swings_as_a_rigid_rod():
    """What is left to the rigid motion falls in proportion to 1 / E."""

    def swing(part: FlexibleBeam | RigidBody, end: str) -> np.ndarray:
        scene = connected({"world": World((0, 0, -9.81)), "hinge": Revolute("y"), "part": part}, ("world.frame", "hinge.frame_a"))
        scene.connect(scene.hinge.frame_b, getattr(part, end))
        return ac.build(scene).simulate(1.0, {scene.hinge.q: 0.0}, rtol=1e-11)[scene.hinge.q]

    about = MASS * 0.02**2 / 12, MASS * 0.03**2 / 12
    centre = (MASS * 25e-4 / 12, MASS * LENGTH**2 / 12 + about[1], MASS * LENGTH**2 / 12 + about[0])
    rigid = swing(RigidBody(MASS, centre, (LENGTH / 2, 0, 0)), "frame")
    gaps = []
    for modulus in (1e11, 1e12):
        options = {"youngs_modulus": modulus, "bending": (0, 1), "modes": "cantilever"}
        gaps.append(np.max(np.abs(swing(beam(**options), "frame_a") - rigid)))
    assert gaps[1] < gaps[0] / 8 < 1e-4


def test_cost_does_not_depend_on_the_number_of_masses():
    counts = []
    for m in (20, 2000):
        x = np.linspace(0, 1, m)
        shapes = np.zeros((m, 3, 2))
        shapes[:, 1, 0], shapes[:, 2, 1] = np.sin(np.pi * x), x * x
        body = FlexibleBody.lumped(np.full(m, 1 / m), np.outer(x, [1.0, 0, 0]), shapes, np.diag([9.0, 3.0]))
        scene = connected(
            {"world": World(), "hinge": Revolute("y"), "body": body},
            ("world.frame", "hinge.frame_a"),
            ("hinge.frame_b", "body.frame_a"),
        )
        counts.append(acceleration_operations(ac.build(scene)))
    assert counts[0] == counts[1] < 200


def test_a_held_cantilever_is_a_linear_oscillator():
    """Nothing moves its frame, so that no more than stiffness times amplitudes is computed: its mass matrix is constant."""
    scene = connected({"world": World(), "beam": beam(bending=(3, 0), modes="cantilever")}, ("world.frame", "beam.frame_a"))
    assert acceleration_operations(ac.build(scene)) <= 6


def test_parameters_of_a_beam_stay_adjustable_and_differentiable():
    scene = ac.System()
    scene.world, scene.hinge = World((0, 0, -9.81)), Revolute("y")
    modulus, length, width = ac.Parameter(1e9, "N/m^2"), ac.Parameter(1.2, "m"), ac.Parameter(0.02, "m")
    section = Section.rectangle(width, 0.03)
    scene.beam = FlexibleBeam(
        length, section, youngs_modulus=modulus, density=DENSITY, bending=(0, 2), modes="craig-bampton", damping=1e-3
    )
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.beam.frame_a)
    model = ac.build(scene)
    change = model.sensitivities([0.0, 0.5], wrt=[length, modulus])
    wanted = change[scene.hinge.q][-1]

    def angle(**values: float) -> float:
        given = {"length": 1.2, "modulus": 1e9, **values}
        run = model.simulate(0.5, parameters={length: given["length"], modulus: given["modulus"]}, rtol=1e-12)
        return float(run[scene.hinge.q][-1])

    differences = (angle(length=1.2001) - angle(length=1.1999)) / 2e-4, (angle(modulus=1.001e9) - angle(modulus=0.999e9)) / 2e6
    assert np.ravel(wanted) == pytest.approx(differences, rel=1e-5)


def test_an_elastic_body_is_drawn():
    scene = pendulum(False)
    names = [body.name for body in animation_of(ac.build(scene).simulate(0.1)).bodies]
    assert names == ["load", "beam"]


def test_a_thin_free_body_has_no_inertia_about_its_axis():
    x = np.linspace(0, 1, 20)
    shapes = np.zeros((20, 3, 1))
    shapes[:, 1, 0] = np.sin(np.pi * x)
    scene = connected({"world": World(), "body": FlexibleBody.lumped(np.ones(20), np.outer(x, [1.0, 0, 0]), shapes, [[100.0]])})
    with pytest.raises(MasslessError, match="Nothing with inertia resists the motion of joint 'body"):
        ac.build(scene)


def test_a_shape_that_a_joint_has_already_leaves_it_without_inertia():
    """Masses on a line through a hinge, displaced in proportion to their distance from it: the shape turns them as the hinge does."""
    x = np.linspace(0, 1, 5)
    shapes = np.zeros((5, 3, 1))
    shapes[:, 1, 0] = x
    scene = connected(
        {
            "world": World(),
            "hinge": Revolute("z"),
            "body": FlexibleBody.lumped(np.ones(5), np.outer(x, [1.0, 0, 0]), shapes, [[1.0]]),
        },
        ("world.frame", "hinge.frame_a"),
        ("hinge.frame_b", "body.frame_a"),
    )
    with pytest.raises(MasslessError, match="joint 'hinge'"):
        ac.build(scene)


def test_a_rigid_joint_between_two_places_of_a_body_is_still_an_error():
    scene = connected({"world": World(), "hinge": Revolute()}, ("world.frame", "hinge.frame_a"))
    scene.connect(scene.hinge.frame_b, scene.world.at((1, 0, 0)))
    with pytest.raises(LockedError, match="same rigid group"):
        ac.build(scene)


ONE, PLACES, UP = [1.0, 2.0], [[0, 0, 0], [1, 0, 0]], [[[0], [1], [0]], [[0], [2], [0]]]


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: beam(modes="free"), "'pinned', 'cantilever' or 'craig-bampton'"),
        (lambda: beam(bending=3), "along y and along z"),
        (lambda: beam(bending=(2, -1)), "along y and along z"),
        (lambda: beam(bending=(13, 0)), "from 0 to 12"),
        (lambda: beam(bending=(0, 0)), "RigidBody.rod"),
        (lambda: beam(axial=7), "from 0 to 6"),
        (lambda: beam(axial=True), "from 0 to 6"),
        (lambda: beam(damping=-1.0), "zero or positive"),
        (lambda: beam(youngs_modulus=0.0), "must be positive"),
        (lambda: FlexibleBeam(1.0, 0.01, youngs_modulus=1.0, density=1.0), "Section.rectangle"),
        (lambda: Section.circle(0.01, 0.02), "wall"),
        (lambda: Section(1.0, -1.0, 1.0), "about_y is -1"),
        (lambda: beam().deflection(1.5), "between 0 and 1"),
        (lambda: FlexibleBody.lumped([1, -2], PLACES, UP, [[1]]), "not be negative"),
        (lambda: FlexibleBody.lumped("a", PLACES, UP, [[1]]), "masses must be numbers"),
        (lambda: FlexibleBody.lumped(ONE, PLACES, [[0, 1, 0], [0, 2, 0]], [[1]]), r"must be \(2, 3, n\)"),
        (lambda: FlexibleBody.lumped(ONE, PLACES, [[[0], [1, 2]]], [[1]]), "different lengths"),
        (lambda: FlexibleBody.lumped(ONE, [[0, 0, 0]], UP, [[1]]), "places has the shape"),
        (lambda: FlexibleBody.lumped(ONE, PLACES, np.zeros((2, 3, 1)), [[1]]), "not independent"),
        (lambda: FlexibleBody.lumped(ONE, PLACES, UP, [[1, 2], [2, 1]]), "stiffness has the shape"),
        (lambda: FlexibleBody.lumped(ONE, PLACES, UP, [[-1]]), "negative eigenvalue"),
        (lambda: FlexibleBody.lumped(ONE, PLACES, np.repeat(UP, 2, axis=2) * [1, np.nan], np.eye(2)), "not finite"),
        (lambda: FlexibleBody.lumped(ONE, PLACES, UP, [[1]], tip_turns=[1, 2, 3]), "tip_turns has the shape"),
        (lambda: FlexibleBody(3, 1.0, [[1]]), "FlexibleBody.lumped"),
        (lambda: FlexibleBody(integrals(first=10.0), 1.0, [[1]]), "belong to no masses"),
        (lambda: FlexibleBody(integrals(), ac.Parameter(1.0), [[1]]), "takes parameters"),
        (lambda: FlexibleBody(integrals(), 1.0, [[1]], damping=[[0, 1]]), "damping has the shape"),
    ],
)  # fmt: skip
def test_nonsense_is_answered_in_words(make, text):
    with pytest.raises(ParameterError, match=text) as caught:
        make()
    assert "test_flexible.py:" in str(caught.value)


def integrals(first: float = 0.5) -> ShapeIntegrals:
    """Of two equal masses, one of them moved by the shape; `first` other than 0.5 belongs to no masses."""
    found = ShapeIntegrals.of_masses(np.ones(2), np.array(PLACES, dtype=float), np.array(UP, dtype=float))
    return ShapeIntegrals(np.array([first, 0, 0]), found.first_shapes, found.second, found.mixed, found.second_shapes)


@pytest.mark.parametrize(("modes", "size"), [("craig-bampton", 1e-6), ("cantilever", 1.0), ("craig-bampton", 1e4)])
def test_loops_close_by_their_joints_and_not_by_bending_a_beam(modes, size):
    """Law: a start leaves elastic bodies as they were made where joints alone close the loops, in rest and in motion; by cosines for the crank's angle."""
    part = Section.rectangle(0.02 * size, 0.02 * size)
    coupler = FlexibleBeam(size, part, youngs_modulus=2e9, density=2700.0, bending=(0, 2), axial=1, modes=modes)
    crank, rocker = (RigidBody.rod(1.0, (length * size, 0, 0), radius=0.02 * size) for length in (0.3, 0.7))
    parts = {"world": World(), "crank": crank, "coupler": coupler, "rocker": rocker, **{name: Revolute("y") for name in "abcd"}}
    scene = connected(parts)
    foot = scene.world.at((0.9 * size, 0, -0.3 * size))
    for joint, one, other in (
        (scene.a, scene.world.frame, crank.frame),
        (scene.b, crank.tip, coupler.frame_a),
        (scene.c, coupler.frame_b, rocker.tip),
        (scene.d, foot, rocker.frame),
    ):
        scene.connect(one, joint.frame_a)
        scene.connect(joint.frame_b, other)
    run = ac.build(scene).simulate(1e-6 * size, {scene.a.q: 0.4, scene.a.v: 1.0}, samples=2)
    assert np.max(np.abs([run[coupler.q][0], run[coupler.v][0]])) < 1e-14 * size
    p, c, d = (run[at.position][0] / size for at in (crank.tip, rocker.tip, foot))
    apart = np.linalg.norm(d - p)
    cosine = (1 + apart**2 - 0.7**2) / (2 * apart)
    np.testing.assert_allclose((c - p) @ (d - p) / apart, cosine, rtol=1e-12)


def test_a_beam_bends_at_the_start_where_joints_do_not_suffice():
    """Between walls that are too far apart it is stretched by the gap, and a tip that is asked for is where it is wished."""
    beam = FlexibleBeam(2.0, SECTION, youngs_modulus=MODULUS, density=DENSITY, bending=(0, 2), axial=1, modes="craig-bampton")
    scene = connected({"world": World(), "beam": beam, "hinge": Revolute("y")})
    scene.connect(scene.world.frame, beam.frame_a)
    scene.connect(beam.frame_b, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.world.at((2.002, 0, 0)))
    np.testing.assert_allclose(ac.build(scene).initial_state().x[:3], (0, 0, 0.002), rtol=1e-12, atol=1e-15)
    alone = ac.System()
    alone.world, alone.beam = (
        World(),
        FlexibleBeam(2.0, SECTION, youngs_modulus=MODULUS, density=DENSITY, bending=(0, 2), modes="craig-bampton"),
    )
    alone.connect(alone.world.frame, alone.beam.frame_a)
    start = ac.build(alone).initial_state({alone.beam.frame_b.position[2]: ac.near(-0.1)})
    np.testing.assert_allclose(start.x[0], -0.1, rtol=1e-9)
