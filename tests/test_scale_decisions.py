"""Decisions about loops and starts: the same in any units, far away, in any order of declaration, and right for other parameters."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal import errors
from acausal.numerics.terms import rounded
from acausal.start.situation import situation
from components import Particle, Planar, Prismatic, Revolute, RigidBody, Screw, World
from tests.assembly_scenes import closed, two_rods_to_a_driven_pivot
from tests.scenes import FourBar
from tests.similar import SCENES, Units

LOOPS = ("four_bar", "slider_crank", "equal_slider_crank", "screw_press", "rods_in_space", "bennett_linkage", "spherical_linkage")


def decisions(of: Units, name: str) -> tuple[object, np.ndarray]:
    """What was decided about the loops, and the start without units."""
    similar = SCENES[name](of)
    model = ac.build(similar.scene)
    c, found = model.system.constraints, situation(model.functions.outputs, similar.start).initial(model.functions)
    r = model.system
    seen = ca.vertcat(*(ca.vec(ca.densify(model.functions.outputs.resolve(e))) / unit for e, unit in similar.seen))
    values = ca.Function("seen", [r.t, r.x, r.u, r.p], [seen])(0, found.x, r.u_defaults, r.p_values)
    return (c.kept, c.redundant, c.vanishing, c.rank, c.damped, c.singular), np.array(values).ravel()


@pytest.mark.parametrize("name", LOOPS)
def test_loops_are_decided_alike_in_any_units_and_places(name):
    want, start = decisions(Units(), name)
    for k in (-15, 15):
        got, bits = decisions(Units(length=4.0**k, time=4.0**-k), name)
        assert got == want and np.array_equal(bits, start)
    for of in (Units(length=1e-9), Units(length=1e9), Units(place=(np.eye(3), np.array([1e6, -7e5, 4e5])))):
        got, near = decisions(of, name)
        assert got == want and np.max(np.abs(near - start)) < 1e-8


def test_the_order_of_declaration_decides_nothing():
    """All orders of a four-bar's hinges, from a sketch that lies flat: the same states, branch and bits."""
    found: set[tuple[object, ...]] = set()
    for order in itertools.permutations("abcd"):
        scene = FourBar(order="".join(order))
        model = ac.build(scene)
        starts = [model.initial_state({scene.a.q: angle}).x.tobytes() for angle in (-2.0, 0.6, 2.0)]
        found.add((model.state_names, model.system.constraints.kept, *starts))
    assert len(found) == 1


def drawn_flat(lengths: tuple[float | ac.Parameter, ...]) -> tuple[ac.System, list[Revolute]]:
    """A four-bar all of whose bars lie on one line in the sketch, so that it closes as well to either side."""
    crank, coupler, rocker, ground = lengths
    scene = ac.System()
    scene.lengths, scene.world = list(lengths), World((0, 0, -9.81))
    scene.bars = [RigidBody(m, (0.01, 0.02, 0.02), (x, 0, z)) for m, x, z in ((1.0, 0.1, 0), (1.0, 0.3, 0.1), (1.5, 0.2, 0))]
    scene.hinges = [Revolute("y") for _ in range(4)]
    ends = [
        (scene.world.frame, scene.bars[0].frame),
        (scene.bars[0].at((crank, 0, 0)), scene.bars[1].frame),
        (scene.bars[1].at((coupler, 0, 0)), scene.bars[2].at((rocker, 0, 0))),
        (scene.world.at((ground, 0, 0)), scene.bars[2].frame),
    ]
    closed(scene, *((a, hinge, b) for hinge, (a, b) in zip(scene.hinges, ends, strict=True)))
    return scene, scene.hinges


def test_of_mirror_images_the_same_is_taken_whichever_lengths_are_parameters():
    """Joints are told apart by numbers where there are some, so that others are cut: what is as near to the sketch is told apart by all of them together."""
    lengths, angles = (0.3, 0.9, 0.6, 0.8), list[np.ndarray]()
    for adjustable in itertools.product([False, True], repeat=4):
        chosen = [ac.Parameter(x, "m") if free else x for free, x in zip(adjustable, lengths, strict=True)]
        scene, hinges = drawn_flat(tuple(chosen))
        found = ac.build(scene).simulate(1e-9, {hinges[0].q: 0.9}, samples=2)
        angles.append(np.array([found[hinge.q][0] for hinge in hinges]))
    assert np.ptp(np.sin(angles), axis=0).max() < 1e-9


def moved(place: np.ndarray, *by: float) -> tuple[float, ...]:
    return tuple(place + np.array(by))


def drawn_where_it_stands(place: np.ndarray, mass: float | ac.Parameter) -> np.ndarray:
    """Angles of a double pendulum after 3 s, frames of whose bodies lie at the world's origin, their centres where they stand; the second are two bodies."""
    scene = ac.System()
    scene.mass, scene.world = mass, World((0, 0, -9.81))
    scene.upper = RigidBody(mass, (0.05, 0.02, 0.06), moved(place, 0.4, 0.1, 0.0))
    scene.lower = RigidBody(0.7, (0.03, 0.02, 0.04), moved(place, 1.2, 0.1, -0.3))
    scene.other = RigidBody(mass, (0.02, 0.02, 0.01), moved(place, 1.3, 0.3, -0.5))
    scene.connect(scene.lower.frame, scene.other.frame)
    scene.shoulder = Revolute.between(scene.world, scene.upper, at=tuple(place), axis=(0, 1, 0.2))
    scene.elbow = Revolute.between(scene.upper, scene.lower, at=moved(place, 0.9, 0.2, 0), axis=(0.1, 1, 0))
    run = ac.build(scene).simulate(3.0, {scene.shoulder.v: 0.5}, rtol=1e-12)
    return np.array([run[joint.q][-1] for joint in (scene.shoulder, scene.elbow)])


@pytest.mark.parametrize("adjustable", [False, True])
def test_bodies_keep_their_inertia_however_far_from_the_origin_of_their_frames_they_are(adjustable):
    """About that origin the second moment is m d^2, of which rounding at 1e7 m is a hundredth of what the body has itself."""

    def mass() -> float | ac.Parameter:
        return ac.Parameter(1.3, "kg") if adjustable else 1.3

    near = drawn_where_it_stands(np.zeros(3), mass())
    for far in (1e3, 1e7):
        place = 2.0 ** np.round(np.log2(far)) * np.array([1.0, -0.5, 0.25])
        assert np.max(np.abs(drawn_where_it_stands(place, mass()) - near)) < 1e-13 * far


def coupled(coupler: float) -> ac.System:
    """Cranks of 0.4 m, 0.9 m apart, joined by a bar of adjustable length: a parallelogram where that is 0.9 m."""
    scene = ac.System()
    scene.length, scene.world = ac.Parameter(coupler, "m"), World((0, 0, -9.81))
    scene.crank, scene.bar, scene.rocker = (RigidBody.rod(m, (x, 0, 0)) for m, x in ((1.0, 0.4), (2.0, scene.length), (1.5, 0.4)))
    scene.a, scene.b, scene.c, scene.d = (Revolute("y") for _ in range(4))
    return closed(
        scene,
        (scene.world.frame, scene.a, scene.crank.frame),
        (scene.crank.tip, scene.b, scene.bar.frame),
        (scene.bar.tip, scene.c, scene.rocker.tip),
        (scene.world.at((0.9, 0, 0)), scene.d, scene.rocker.frame),
    )


def test_other_parameters_are_a_build_with_them():
    """A bar that makes a parallelogram passes singular positions, whatever length the model was built with."""
    ends = []
    for built in (0.9, 0.95, 0.7):
        scene = coupled(built)
        start = {scene.a.q: -0.6, scene.a.v: 8.0, scene.d.q: ac.near(-0.6)}
        run = ac.build(scene).simulate(2.0, start, parameters={scene.length: 0.9}, rtol=1e-10, compiled=False, samples=5)
        assert run.energy_error() < 1e-6
        ends.append(run[scene.a.q][-1])
    assert np.ptp(ends) < 1e-9


def test_a_nut_is_found_far_along_its_screw():
    scene = ac.System()
    scene.world, scene.screw, scene.nut = World(None), Screw("z", 0.01), RigidBody.box(1.0, (0.1, 0.1, 0.1))
    closed(scene, (scene.world.frame, scene.screw, scene.nut.frame))
    state = ac.build(scene).initial_state({scene.nut.frame.position[2]: 1000.0})
    assert np.isclose(state.x[0], 2 * np.pi * 1e5, rtol=1e-14)


def test_a_loop_that_closes_later_can_be_built():
    """Two rods of 1.3 m together reach a driven pivot, 3 m away at first, after 3.4 s."""
    model = ac.build(two_rods_to_a_driven_pivot(3.0 - 0.5 * ac.time))
    assert model.simulate(5.2, t0=5.0, compiled=False, samples=3).constraint_error() < 1e-12
    with pytest.raises(errors.AssemblyError, match="cannot close"):
        model.initial_state()


@pytest.mark.parametrize("distance", [1e-9, 1.0, 1e9])
def test_a_start_without_derivative_is_left(distance):
    """The distance from an origin at which the sketch lies has no derivative there."""
    scene = ac.System()
    scene.world, scene.x, scene.y, scene.point = World(None), Prismatic("x"), Prismatic("y"), Particle(1.0)
    scene.connect(scene.world.frame, scene.x.frame_a)
    closed(scene, (scene.x.frame_b, scene.y, scene.point.point))
    state = ac.build(scene).initial_state({np.sqrt(scene.x.q**2 + scene.y.q**2): distance})
    assert np.isclose(np.hypot(*state.x[:2]), distance, rtol=1e-12)


def test_a_start_slightly_off_is_explained_by_its_values():
    scene = FourBar()
    model = ac.build(scene)
    state = model.initial_state({scene.a.q: 0.3})
    b = float(state.x[model.state_names.index("b.q")])
    with pytest.raises(errors.StartValueError, match=r"contradict.*a\.q.*b\.q|contradict.*b\.q.*a\.q"):
        model.initial_state({scene.a.q: 0.3, scene.b.q: b + 1e-9})


def test_the_report_counts_other_branches():
    scene = FourBar()
    assert "1 other branch meets" in str(ac.build(scene).initial_state({scene.a.q: 0.5}))


def test_rounding_errors_stay_below_the_terms():
    """Terms of a difference, of a product, and of functions, against sixteen more digits."""
    x = ca.SX.sym("x", 3)
    rows = ca.vertcat(1e6 * x[0] - 1e6 * x[1], x[0] * x[1] * ca.sin(1e3 * x[2]), ca.sqrt(x[0] ** 2 + x[1] ** 2) - x[2] / x[0])
    values = np.array([1 / 3, 1 / 7, 0.9])
    both = ca.Function("both", [x], [rows, rounded(rows)])
    got, terms = (np.array(part, dtype=np.longdouble).ravel() for part in both(values))
    a, b, c = values.astype(np.longdouble)
    million, thousand = np.longdouble(1e6), np.longdouble(1e3)
    exact = np.array([million * a - million * b, a * b * np.sin(thousand * c), np.sqrt(a * a + b * b) - c / a])
    assert np.all(np.abs(got - exact) <= 4 * np.finfo(float).eps * terms)
    assert np.all(terms > 0)


@pytest.mark.parametrize(("slope", "size"), [((0, -1, 1), 1.0), ((0, -1, 1), 1e-4), ((1, -1, 0), 1.0), ((3, -4, 1), 1e4)])
def test_what_two_planes_guide_falls_along_their_line(slope: tuple[float, float, float], size: float) -> None:
    scene, gravity = ac.System(), size * np.array([3.0, -1.0, -9.0])
    scene.world, scene.body = World(tuple(gravity)), RigidBody(1.0, size**2 * np.diag([0.2, 0.3, 0.4]), position=(0, size, -size))
    normals, scene.planes = [np.array([0.0, 1.0, 0.0]), np.array(slope) / np.linalg.norm(slope)], [Planar("z"), Planar("z")]
    line = np.cross(*normals) / np.linalg.norm(np.cross(*normals))
    for plane, normal, at in zip(scene.planes, normals, [(1, -1, 0), (0, 1, -1)], strict=True):
        R = np.column_stack([line, np.cross(normal, line), normal])
        scene.connect(scene.world.at(tuple(size * np.array(at)), rotation=R), plane.frame_a)
        scene.connect(plane.frame_b, scene.body.at(tuple(size * (np.array(at) - (0, 1, -1))), rotation=R))
    model = ac.build(scene)
    run = model.simulate(1.0, samples=5)
    fallen = run[scene.body.frame.position] - run[scene.body.frame.position][0]
    assert np.abs(fallen - run.t[:, None] ** 2 / 2 * (gravity @ line) * line).max() < 1e-12 * size
    assert model.degrees_of_freedom == 1
