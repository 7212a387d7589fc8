"""Loops of rods in space with several freedoms: motions go straight through isolated singular positions, or are refused."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

import acausal as ac
from acausal.errors import AccuracyWarning, LockedError, SimulationError, StartValueError
from components import Particle, Prismatic, Revolute, Rod, Spherical, Universal, World
from components.bodies import RigidBody
from tests.exported import Library
from tests.scenes import rotation
from tests.test_near_fits import turned

G = 9.81
LINKS = ("OA", "OB", "CP", "AP", "BP", "AQ", "BQ")


def inversor(angle: float) -> dict[str, np.ndarray]:
    """Peaucellier's linkage in the plane, arms of 1 m, a rhombus of 0.4 m, a crank of 0.5 m at this angle."""
    C = np.array([0.5, 0, 0])
    P = C + 0.5 * np.array([np.cos(angle), np.sin(angle), 0])
    r = float(np.linalg.norm(P))
    along = P / r
    far = (1 - 0.16 + r * r) / (2 * r)
    aside = np.sqrt(1 - far**2) * np.array([-along[1], along[0], 0])
    return {"O": np.zeros(3), "C": C, "P": P, "A": far * along + aside, "B": far * along - aside, "Q": along * 0.84 / r}


class Inversor(ac.System):
    """The linkage of rods without mass between particles, which nothing but gravity holds in its plane; all turned by `R`."""

    def __init__(self, angle: float, R: np.ndarray, length: float = 1.0) -> None:
        places = {name: length * (R @ place) for name, place in inversor(angle).items()}
        self.world = World(tuple(R @ (0, -G, 0)))
        self.A, self.B, self.P, self.Q = (Particle(1.0, position=tuple(places[name])) for name in "ABPQ")
        points = {name: getattr(self, name).point for name in "ABPQ"} | {
            name: self.world.at(tuple(places[name])) for name in "OC"
        }
        self.rods = [Rod(float(np.linalg.norm(places[a] - places[b]))) for a, b in LINKS]
        for rod, (a, b) in zip(self.rods, LINKS, strict=True):
            self.connect(points[a], rod.frame_a)
            self.connect(rod.frame_b, points[b])


@pytest.mark.parametrize("R", [np.eye(3), rotation(3)], ids=["level", "turned"])
@pytest.mark.parametrize("angle", [1.22, 0.52])
def test_a_linkage_of_rods_goes_through_its_flat_position(angle: float, R: np.ndarray):
    """Where the rhombus is a line; with energy as the tolerance says, the straight line drawn, in steps as few as on other loops."""
    scene = Inversor(angle, R)
    model = ac.build(scene)
    assert model.system.constraints.singular
    assert model.degrees_of_freedom == 5
    for rtol, energy, steps in ((1e-6, 1e-5, 100), (1e-9, 1e-9, 250), (1e-12, 2e-10, 500)):
        with warnings.catch_warnings():
            if rtol == 1e-6:  # by less than that it may miss the position, which is told
                warnings.simplefilter("ignore", AccuracyWarning)
            run = model.simulate(3.0, rtol=rtol, samples=51)
        drawn = run[scene.Q.point.position] @ R
        assert np.min(np.linalg.norm(drawn - run[scene.P.point.position] @ R, axis=1)) < 0.2
        assert np.max(np.abs(drawn[:, 0] - 0.84)) < 1e-9
        assert run.at(run.solution.t).energy_error() < energy
        assert run.statistics.steps < steps


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
def test_rods_between_particles_in_a_plane_can_move_out_of_it(length: float):
    """Their heights change nothing to first order, and less in some rows than in others."""
    assert ac.build(Inversor(1.22, np.eye(3), length)).degrees_of_freedom == 5


class Plate(ac.System):
    """A plate on parallel rods of 1 m, drawn at an angle from hanging straight down."""

    def __init__(self, angle: float, azimuth: float, count: int = 3) -> None:
        self.side = np.array([np.cos(azimuth), np.sin(azimuth), 0])
        self.world = World(None)
        self.plate = RigidBody(1.0, (0.25, 0.3, 0.5), position=tuple(self.place(np.array([angle]))[0]))
        self.rods = [Rod(1.0) for _ in range(count)]
        for k, rod in enumerate(self.rods):
            corner = (np.cos(0.2 + 2 * np.pi * k / count), np.sin(0.2 + 2 * np.pi * k / count), 0)
            self.connect(self.world.at(corner), rod.frame_a)
            self.connect(rod.frame_b, self.plate.at(corner))

    def place(self, angle: np.ndarray) -> np.ndarray:
        return np.sin(angle)[:, None] * self.side - np.cos(angle)[:, None] * np.array([0, 0, 1.0])


@pytest.mark.parametrize(("count", "end"), [(2, 2.0), (3, 10.0)])
def test_a_plate_on_rods_goes_through_its_flat_position(count: int, end: float):
    """Where all rods lie in the plate, while it goes round evenly: fifteen times in 10 s. On two rods this is unstable:
    disturbances grow a thousand times in half a second.
    """
    scene = Plate(0.6, 0.3, count)
    model = ac.build(scene)
    v = 5.0 * (np.cos(0.6) * scene.side + np.array([0, 0, np.sin(0.6)]))
    start = {scene.plate.frame.velocity[k]: float(v[k]) for k in range(3)}
    if count == 2:
        start |= {scene.plate.frame.angular_velocity[k]: 0.0 for k in range(3)}
    for rtol, error in ((1e-6, 1e-5), (1e-9, 1e-8), (1e-12, 1e-10)):
        run = model.simulate(end, start, rtol=rtol, samples=51)
        assert np.max(np.abs(run[scene.plate.frame.position] - scene.place(0.6 + 5.0 * run.t))) < error
        assert run.energy_error() < error
        assert run.statistics.steps < 200


def test_isolated_singular_positions_are_found_wherever_the_sketch_is():
    rng = np.random.default_rng(0)
    for _ in range(6):
        angle, azimuth = rng.uniform(0.05, 1.5), rng.uniform(0, 6)
        assert ac.build(Plate(angle, azimuth)).system.constraints.singular, (angle, azimuth)


@pytest.mark.parametrize("seed", range(3))
def test_any_tolerance_speed_and_end_leads_straight_through(seed: int):
    """The plate's turns are nothing but rounding: no steps are made for these, and they do not lead it past its flat positions."""
    rng = np.random.default_rng(seed)
    angle, azimuth = rng.uniform(0.2, 1.3), rng.uniform(0, 6)
    scene = Plate(angle, azimuth)
    model = ac.build(scene)
    for _ in range(6):
        rate, turned, rtol = rng.choice([-1, 1]) * rng.uniform(1, 8), rng.uniform(2, 30), 10 ** rng.uniform(-12, -4)
        v = rate * (np.cos(angle) * scene.side + np.array([0, 0, np.sin(angle)]))
        start = {scene.plate.frame.velocity[k]: float(v[k]) for k in range(3)}
        run = model.simulate(turned / abs(rate), start, rtol=rtol, samples=21)
        assert np.max(np.abs(run[scene.plate.frame.position] - scene.place(angle + rate * run.t))) < 10 * max(rtol, 1e-13), (
            rate,
            turned,
            rtol,
        )
        assert run.statistics.steps < 80, (rate, turned, rtol)


def test_rods_that_are_one_too_many_all_along_are_told():
    """Beside a plate that only shifts on four parallel rods it could turn, to first order, wherever it is."""
    scene = Plate(0.6, 0.3, 4)
    v = 5.0 * (np.cos(0.6) * scene.side + np.array([0, 0, np.sin(0.6)]))
    model = ac.build(scene)
    for end in (0.15, 1.0, 10.0):
        with pytest.raises(StartValueError, match="and so are all those that it leads to"):
            model.simulate(end, {scene.plate.frame.velocity[k]: float(v[k]) for k in range(3)})


def table(places: np.ndarray, joints: str, tilt: float, size: float) -> ac.System:
    """A plate on equal parallel legs at these `places` (n, 3), massive ones on ball and universal joints ("US" from below) or rods without mass ("")."""
    d, scene = np.array([np.sin(tilt), 0, np.cos(tilt)]) * size, ac.System()
    scene.world = World((0, 0, G * size))
    scene.plate = RigidBody(2.0, np.diag([0.2, 0.3, 0.4]) * size**2, (0.1 * size, 0, 0), position=tuple(d))
    scene.legs = [RigidBody(0.1, 0.01 * size**2 * np.eye(3), tuple(d / 2)) if joints else Rod(size) for _ in places]
    scene.joints = [Spherical() if joint == "S" else Universal("x", "y") for _ in places for joint in joints]
    for k, (place, leg) in enumerate(zip(places * size, scene.legs, strict=True)):
        ends = scene.joints[len(joints) * k : len(joints) * (k + 1)]
        below, above = scene.world.at(tuple(place)), scene.plate.at(tuple(place))
        foot, head = (leg.frame_a, leg.frame_b) if isinstance(leg, Rod) else (leg.frame, leg.at(tuple(d)))
        for joint, (a, b) in zip(ends, ((below, foot), (head, above)), strict=False):
            scene.connect(a, joint.frame_a)
            scene.connect(joint.frame_b, b)
        if not ends:
            scene.connect(below, foot)
            scene.connect(head, above)
    return scene


@pytest.mark.parametrize(
    ("joints", "count", "tilt", "size"),
    [("US", 4, 0.3, 1.0), ("SS", 4, 0.2, 1e-3), ("SU", 4, 0.3, 1e3), ("", 4, 0.1, 1.0), ("", 5, 0.3, 1e3), ("", 6, 0.3, 1e-3)],
)
def test_legs_that_are_one_too_many_are_told_at_rest_too(joints: str, count: int, tilt: float, size: float):
    """Wren's platform: it shifts, and its turn about the legs is stopped to second order only, wherever it is. It is not locked."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        angles = rng.uniform(0, 2 * np.pi, count)
        places = [np.column_stack([0.3 + np.cos(angles), np.sin(angles), 0 * angles]), rng.uniform(-1, 1, (count, 3))][seed]
        with pytest.raises((StartValueError, LockedError), match="second order only, by forces that nothing determines"):
            ac.build(table(places, joints, tilt, size)).simulate(0.5)
        if seed:
            assert ac.build(table(places[:3], joints, tilt, size)).simulate(0.05).energy_error() < 1e-9


@pytest.mark.parametrize("size", [1.0, 1e3])
def test_plates_on_rods_begin_at_rest_whatever_their_size(size: float):
    """They swing as a pendulum. A first try that rounding ends says nothing of singular positions, however little it would have moved the plate."""
    rng = np.random.default_rng(1)
    rng.uniform(0, 2 * np.pi, 5)
    places = rng.uniform(-1, 1, (5, 3))[:3]
    scene = table(places, "", 0.3, size)
    run = ac.build(scene).simulate(0.5, rtol=1e-11, samples=11)
    swing = solve_ivp(lambda t, y: (y[1], -G * np.sin(y[0])), (0, 0.5), [0.3, 0.0], t_eval=run.t, rtol=1e-12, atol=1e-14).y[0]
    drawn = run[scene.plate.frame.position] / size
    assert np.max(np.abs(drawn - np.column_stack([np.sin(swing), 0 * swing, np.cos(swing)]))) < 1e-10


def lift(height: float, length: float, legs: int = 2, storeys: int = 1, R: np.ndarray | None = None) -> ac.System:
    """Chains of two bars on three parallel hinges, each across the next one, bear a plate that rises and sinks (Sarrus), on which the next storey stands;
    the bars, of 1 m but for `length`, lie flat but for this part of it. All turned by `R`."""
    scene, turned = ac.System(), np.eye(3) if R is None else R

    def placed(v: np.ndarray) -> tuple[float, ...]:
        return tuple(turned @ v * length)

    up, foot = np.array([0, 0, height]), 0.3
    scene.world = World(placed(np.array([0, 0, -G])))
    scene.plates = [
        RigidBody(1.0, 0.05 * length**2 * np.eye(3), position=placed(2 * up * (storey + 1))) for storey in range(storeys)
    ]
    scene.hinges, scene.bars = [], []
    for storey, (below, plate) in enumerate(zip([scene.world, *scene.plates], scene.plates, strict=False)):
        for turn in np.arange(legs) * np.pi / 2:
            out, axis = np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0])
            lower, upper = np.sqrt(1 - height**2) * out + up, up - np.sqrt(1 - height**2) * out
            middles = [2 * storey * up + foot * out + way for way in (lower / 2, lower + upper / 2)]
            bars = [RigidBody(0.5, 0.04 * length**2 * np.eye(3), position=placed(middle)) for middle in middles]
            hinges = [Revolute(tuple(turned @ axis)) for _ in range(3)]
            ends = [
                (below.at(placed(foot * out)), bars[0].at(placed(-lower / 2))),
                (bars[0].at(placed(lower / 2)), bars[1].at(placed(-upper / 2))),
                (bars[1].at(placed(upper / 2)), plate.at(placed(foot * out))),
            ]
            scene.hinges, scene.bars = [*scene.hinges, *hinges], [*scene.bars, *bars]
            for hinge, (a, b) in zip(hinges, ends, strict=True):
                scene.connect(a, hinge.frame_a)
                scene.connect(hinge.frame_b, b)
    return scene


@pytest.mark.parametrize(("length", "speed"), [(1.0, 1.5), (1.0, 1.0), (3.0, 1.5), (1e-3, 3.0)])
def test_rows_that_take_turns_in_being_redundant_go_through_as_others_do(length: float, speed: float):
    """A lift that is nearly folded, and folds: which of its rows follow from the others is another there than elsewhere."""
    scene = lift(0.05, length)
    run = ac.build(scene).simulate(5.0, {scene.hinges[0].q: 0, scene.hinges[0].v: speed}, rtol=1e-12, samples=50)
    assert run.energy_error() < 2e-11
    assert run.statistics.steps < 250


@pytest.mark.parametrize(
    ("legs", "storeys", "angle", "length"),
    [
        (3, 1, 0.0, 1.0),
        (3, 1, 1e-9, 1.0),
        (3, 1, 1e-3, 1e-3),
        (3, 1, 1.0, 1.0),
        (2, 2, 1e-9, 1e3),
        (2, 2, 1e-3, 1.0),
        (3, 2, 0.0, 1.0),
    ],
)
def test_lifts_keep_their_energy_however_their_axes_lie(legs: int, storeys: int, angle: float, length: float):
    """Rows that are nothing along the axes are little beside them, and which of them follow from the others is another from place to place: where all bars
    of a storey lie flat or stand upright, other eigenvalues become nothing than those that always are."""
    scene = lift(0.6, length, legs, storeys, turned(np.array([1.0, 2, 3]), angle))
    start = {scene.hinges[3 * legs * k].q: 0.0 for k in range(storeys)}
    start |= {scene.hinges[3 * legs * k].v: 0.5 * (1 + k) for k in range(storeys)}
    model = ac.build(scene)
    assert model.degrees_of_freedom == storeys
    run = model.simulate(3.0, start, rtol=1e-12, samples=50)
    assert run.energy_error() < 2e-10
    assert run.statistics.steps < 75 * storeys


LEGS = ((-0.5, 0.3), (0.6, 0.4), (0.1, -0.7))


def table_on_universal_legs(length: float, back: bool, legs: Sequence[tuple[float, float]] = LEGS) -> ac.System:
    """A plate on parallel legs, at the ends of each of which the outer axes are x and y: all turn together about x, or about y, and upright about both."""
    scene = ac.System()
    scene.world = World((0, 0, 9.81 * length))
    along = length * np.array([0.23, 0.19, 0.95])
    scene.plate = RigidBody(2.0, np.diag([0.2, 0.3, 0.4]) * length**2, position=tuple(along))
    scene.low, scene.top, scene.legs = [], [], []
    for x, y in reversed(legs) if back else legs:
        foot = (x * length, y * length, 0.0)
        leg = RigidBody(0.1, 0.01 * length**2 * np.eye(3), centre_of_mass=tuple(along / 2))
        low, top = Universal("x", "y"), Universal("x", "y")
        scene.low, scene.top, scene.legs = [*scene.low, low], [*scene.top, top], [*scene.legs, leg]
        scene.connect(scene.world.at(foot), low.frame_a)
        scene.connect(low.frame_b, leg.frame)
        scene.connect(leg.at(tuple(along)), top.frame_a)
        scene.connect(top.frame_b, scene.plate.at(foot))
    return scene


@pytest.mark.parametrize(("length", "back"), [(1.0, False), (1e-3, True), (1e3, False)])
def test_a_motion_ends_in_words_where_its_branches_touch(length: float, back: bool):
    """Upright the two motions of the table have the same forces in their loops to second order, not to first: no rates are told from beside."""
    scene = table_on_universal_legs(length, back)
    low, model = scene.low[0], ac.build(scene)
    with pytest.raises(SimulationError, match="branches touch"):
        model.simulate(1.0, {low.q[0]: 0.0, low.q[1]: 0.0, low.v[0]: 0.0, low.v[1]: 0.5})
    with pytest.raises(SimulationError, match="branches touch") as told:  # nothing but rounding turns the table about y
        model.simulate(1.0, {low.q[0]: -0.4, low.q[1]: 0.0, low.v[0]: ac.near(2.0), low.v[1]: ac.near(0.0)})
    assert told.value.trajectory.statistics.steps < 30


@pytest.mark.parametrize("length", [1e-3, 1e3])
def test_a_motion_on_no_branch_of_loops_with_rows_that_depend_on_one_another_is_ended_in_words(length: float):
    """Upright and at rest, where motions about x and y meet: with a fourth leg rows are kept that depend on one another on either of them, and on both not."""
    scene = table_on_universal_legs(length, False, (*LEGS, (-0.6, -0.5)))
    with pytest.raises(SimulationError, match="branches touch") as told:
        ac.build(scene).simulate(0.2)
    assert told.value.trajectory.energy_error() < 0.05


def crank_on_rods_that_spin(rods: int, size: float, backwards: bool) -> ac.System:
    """A slider-crank with parallel rods, each on a Cardan joint whose outer axis is the rod itself: there they spin while nothing else moves, or swing together."""
    scene, tilt = ac.System(), np.arcsin(0.4 * np.sin(1.0))
    along, y = np.array([np.cos(tilt), 0, -np.sin(tilt)]), np.array([0, 1.0, 0])
    knee = 0.4 * np.array([np.cos(1.0), 0, np.sin(1.0)])
    scene.world = World((-G * size, 0, 0))
    scene.crank = RigidBody.rod(1.0, tuple(size * knee), position=(0, 0, 0))
    scene.slider = RigidBody(2.0, 0.1 * size**2 * np.eye(3), position=tuple(size * (knee + along)))
    scene.hinge = Revolute.between(scene.world, scene.crank, at=(0, 0, 0), axis="y")
    scene.guide = Prismatic.between(scene.world, scene.slider, at=tuple(size * (knee + along)), axis="x")
    scene.rods, scene.low, scene.top = [], [], []
    for k in sorted(range(rods), reverse=backwards):
        place, inertia = size * (knee + 0.1 * k * y), np.diag([0.002, 0.04, 0.04]) * size**2
        rod = RigidBody(
            0.5, inertia, (size / 2, 0, 0), position=tuple(place), rotation=np.column_stack([along, y, np.cross(along, y)])
        )
        scene.rods.append(rod)
        scene.low.append(Universal.between(scene.crank, rod, at=tuple(place), axis_a=along, axis_b="y"))
        scene.top.append(Spherical.between(rod, scene.slider, at=tuple(place + size * along)))
    return scene


def turn_of_the_crank(times: np.ndarray, rate: float, rods: int) -> np.ndarray:
    """By Lagrange's equation of the angle u between crank and guide, for 1 m."""
    u = ca.SX.sym("u")
    lean = ca.asin(0.4 * ca.sin(u))
    slide, middle = (
        0.4 * ca.cos(u) + ca.cos(lean),
        ca.vertcat(0.4 * ca.cos(u) + ca.cos(lean) / 2, 0.4 * ca.sin(u) - ca.sin(lean) / 2),
    )
    fast = [ca.sumsqr(ca.jacobian(part, u)) for part in (slide, middle, lean)]
    m = 0.4**2 / 3 + 2 * fast[0] + rods * (0.5 * fast[1] + 0.04 * fast[2])
    V = G * (0.2 * ca.cos(u) + 2 * slide + 0.5 * rods * middle[0])
    terms = ca.Function("terms", [u], [m, ca.jacobian(m, u), ca.jacobian(V, u)])

    def rates(_: float, y: np.ndarray) -> list[float]:
        m, dm, dV = (float(term) for term in terms(y[0]))
        return [y[1], -(0.5 * dm * y[1] ** 2 + dV) / m]

    return solve_ivp(rates, (0, times[-1]), [1.0, rate], "DOP853", times, rtol=1e-12, atol=1e-12).y[0]


@pytest.mark.parametrize(
    ("rods", "rate", "size", "backwards"),
    [
        (2, 6.0, 1e-3, True),
        (2, 0.0, 1.0, True),
        (3, 6.0, 1e3, True),
        (3, 0.0, 1e-3, False),
    ],
)
@pytest.mark.filterwarnings("ignore::acausal.errors.SingularWarning")
def test_a_start_where_motions_of_other_freedoms_meet_goes_on_as_its_velocities_or_forces_say(
    rods: int, rate: float, size: float, backwards: bool
):
    """The sketch leaves all rods free to spin, which is what is found from there; a crank that turns leaves one freedom."""
    scene = crank_on_rods_that_spin(rods, size, backwards)
    model = ac.build(scene)
    assert model.degrees_of_freedom == rods
    run = model.simulate(1.5, {scene.hinge.v: -rate} if rate else {}, rtol=1e-10, samples=16)
    assert np.max(np.abs(1.0 - run[scene.hinge.q] - turn_of_the_crank(run.t, rate, rods))) < 1e-9
    assert run.energy_error() < 1e-10
    spun = model.simulate(1.0, {low.v[0]: 1.0 + k for k, low in enumerate(scene.low)} | {scene.hinge.v: 0.0}, samples=2)
    assert np.allclose([spun[low.q[0]][-1] for low in scene.low], [1.0 + scene.low.index(low) for low in scene.low], atol=1e-9)
    assert np.max(np.abs(spun[scene.hinge.q])) < 1e-9


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
def test_what_creeps_next_to_a_singular_position_is_ended_in_words(length: float):
    """A crank would fall at once, but for rods that spin by a billionth of a turn: steps are as short as rounding says, and lead nowhere."""
    scene = crank_on_rods_that_spin(2, length, False)
    with pytest.raises(SimulationError, match="comes to a singular position of loops") as told:
        ac.build(scene).simulate(10.0, {low.v[0]: 1e-9 for low in scene.low} | {scene.hinge.v: 0.0})
    assert told.value.trajectory.statistics.steps < 400


def parallelogram_between_balls(length: float) -> ac.System:
    """Its coupler is free to spin."""
    scene = ac.System()
    scene.world = World((0, 0, -G * length))
    left, right = (RigidBody.rod(1.0, (length, 0, 0), position=(x, 0, 0)) for x in (0.0, 2 * length))
    scene.left, scene.right = left, right
    scene.coupler = RigidBody(1.0, length**2 * np.diag([0.01, 0.4, 0.4]), (length, 0, 0), position=(length, 0, 0))
    scene.crank = Revolute.between(scene.world, left, at=(0, 0, 0), axis="y")
    scene.other = Revolute.between(scene.world, right, at=(2 * length, 0, 0), axis="y")
    scene.ball = Spherical.between(left, scene.coupler, at=(length, 0, 0))
    scene.far = Spherical.between(right, scene.coupler, at=(3 * length, 0, 0))
    return scene


def swing_of_the_cranks(times: np.ndarray, rate: float) -> np.ndarray:
    """As one pendulum."""
    return solve_ivp(
        lambda _, y: [y[1], 1.2 * G * np.cos(y[0])], (0, times[-1]), [0, rate], "DOP853", times, rtol=1e-12, atol=1e-14
    ).y[0]


@pytest.mark.parametrize(("length", "rate"), [(1e-3, 1.0), (1.0, -0.5), (1e3, 2.0)])
def test_a_parallelogram_whose_coupler_spins_between_balls_begins_flat(length: float, rate: float):
    """The spin is free and stays so; two other motions cross, which no force holds to second order: the cranks swing as one pendulum, and the coupler spins on."""
    scene = parallelogram_between_balls(length)
    start = {scene.crank.v: rate, scene.other.v: rate, scene.ball.v[0]: 3.0}
    run = ac.build(scene).simulate(0.4, start, rtol=1e-10, samples=5)
    assert np.max(np.abs(run[scene.crank.q] - swing_of_the_cranks(run.t, rate))) < 5e-9
    assert np.max(np.abs(run[scene.coupler.frame.angular_velocity] - [3, 0, 0])) < 1e-7


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
def test_what_turns_back_next_to_a_flat_position_is_as_exact_as_what_goes_through(length: float):
    """Cranks that are thrown up by less than a thousandth of a turn, while the coupler spins on: where they turn, nothing leads away from the flat position, and rates are not continued
    from where the spin will have led."""
    scene = parallelogram_between_balls(length)
    model = ac.build(scene)
    for rtol in (1e-8, 1e-10, 1e-11):
        run = model.simulate(0.08, {scene.crank.v: -0.1, scene.other.v: -0.1, scene.ball.v[0]: 0.3}, rtol=rtol, samples=9)
        assert np.max(np.abs(run[scene.crank.q] - swing_of_the_cranks(run.t, -0.1))) < 1e-11, rtol
        assert run.energy_error() < 1e-11 and run.statistics.steps <= 20


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
def test_what_accelerates_from_rest_on_no_branch_is_told(length: float):
    """A frame in two crosses that coincide swings about one axis or the other: its weight begins both, from rest, and a turn about either goes on as a pendulum."""
    scene = ac.System()
    scene.world = World((0, 0, -G * length))
    scene.frame = RigidBody(1.0, 0.1 * length**2 * np.eye(3), (0.6 * length, 0.8 * length, 0), position=(0, 0, 0))
    scene.cross = Universal.between(scene.world, scene.frame, at=(0, 0, 0), axis_a="x", axis_b="y")
    scene.back = Universal.between(scene.frame, scene.world, at=(0, 0, 0), axis_a="x", axis_b="y")
    model = ac.build(scene)
    for rounding in (0.0, 1e-17):
        with pytest.raises(StartValueError, match="accelerates with from rest lies on none of them"):
            model.simulate(1.0, {scene.cross.v[0]: rounding, scene.cross.v[1]: -rounding})
    with pytest.raises(StartValueError, match="the velocities lie on none of them"):
        model.simulate(1.0, {scene.cross.v[0]: 2.0, scene.cross.v[1]: 2e-4})
    for rate in (2.0, 1e-3):  # slow, but on one of them
        run = model.simulate(0.5, {scene.cross.v[0]: rate, scene.cross.v[1]: 0.0}, rtol=1e-10, samples=5)
        swing = solve_ivp(
            lambda _, y: [y[1], -0.8 * G * np.cos(y[0]) / 0.74], (0, 0.5), [0, rate], "DOP853", run.t, rtol=1e-12, atol=1e-12
        )
        assert np.max(np.abs(run[scene.cross.q[0]] - swing.y[0])) < 1e-8


BESIDE = np.sort(np.concatenate([[0.0], *np.outer([-1, 1], 10.0 ** np.arange(-9, -1.9, 0.5))]))
"""Times [s] from a singular position at which states are read."""


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
def test_what_is_read_next_to_a_flat_position_is_not_thrown_off_by_closing_loops_there(length: float, tmp_path: Path):
    """Cranks of a parallelogram swing through it: their speeds and accelerations, and those of the bar, which stays level, are those of one pendulum, and each bears
    half of the bar, there as elsewhere. In exports too.
    """
    scene = ac.System()
    scene.world = World((0, 0, -G * length))
    left, right = (RigidBody.rod(1.0, (length, 0, 0), position=(x, 0, 0)) for x in (0.0, 2 * length))
    bar = RigidBody.rod(1.0, (2 * length, 0, 0), position=(length, 0, 0))
    scene.left, scene.right, scene.bar = left, right, bar
    pins = [(scene.world, left, 0.0), (scene.world, right, 2.0), (left, bar, 1.0), (right, bar, 3.0)]
    scene.pins = [Revolute.between(a, b, at=(x * length, 0, 0), axis="y") for a, b, x in pins]
    start = {scene.pins[0].q: -0.5, scene.pins[1].q: -0.5, scene.pins[0].v: 0.0}

    def swings(t: float, y: np.ndarray) -> list[float]:
        return [y[1], 1.2 * G * np.cos(y[0])]

    swing = solve_ivp(swings, (0, 0.6), [-0.5, 0], "DOP853", dense_output=True, rtol=1e-13, atol=1e-15).sol
    flat = brentq(lambda t: swing(t)[0], 0.1, 0.5, xtol=1e-15)
    times, model = flat + BESIDE, ac.build(scene)
    runs = [model.simulate(0.6, start, rtol=rtol, samples=2) for rtol in (0.7e-11, 1.4e-11, 1e-11)]
    (q, v), faster = swing(times), 1.2 * G * np.cos(swing(times)[0])
    for pin, sense in zip(scene.pins[:3], (1, 1, -1), strict=True):
        off = np.abs([run.at(times)[pin.v] - sense * v for run in runs])
        assert np.quantile(off, 0.9) < 2e-11
        assert np.max(off) < 2e-10
    read = runs[-1].at(times)
    for pin, sense in zip(scene.pins[:3], (1, 1, -1), strict=True):
        assert np.max(np.abs(read[ac.der(pin.v)] - sense * faster)) < 2e-8
    forward = np.stack([-np.cos(q) * v**2 - np.sin(q) * faster, 0 * q, np.sin(q) * v**2 - np.cos(q) * faster + G], axis=1)
    for pin in scene.pins[2:]:
        assert np.max(np.abs(read[pin.frame_b.force] / length + forward / 2)) < 1e-6
    if length == 1.0:
        library = Library(model.export_simulator(tmp_path, start))
        found = library.simulate([*times, 0.6], options=library.options(rtol=1e-11))[1][:, :-1]
        assert np.quantile(np.abs(np.abs(found[-3:]) - v), 0.9) < 2e-11
        assert np.max(np.abs(np.abs(found[-3:]) - v)) < 2e-10


def test_energies_are_the_same_however_near_to_flat_positions_they_are_read():
    """Of a linkage of rods, which a motion passes straight through or, by little, turns aside from."""
    scene = Inversor(1.22, np.eye(3))
    run = ac.build(scene).simulate(1.3, rtol=1e-12, samples=2)
    sides = [scene.A.point.position, scene.P.point.position, scene.B.point.position]
    looks = run.at(np.linspace(0, 1.3, 400))
    A, P, B = (looks[side] for side in sides)
    wide = np.linalg.norm(np.cross(P - A, B - A), axis=1)
    flat = [k for k in range(1, 399) if wide[k] <= min(wide[k - 1], wide[k + 1])]
    assert len(flat) == 5

    def squashed(t: float) -> float:
        A, P, B = (run.at([t])[side][0] for side in sides)
        return float(np.linalg.norm(np.cross(P - A, B - A)))

    for k in flat:
        near = minimize_scalar(squashed, bounds=looks.t[[k - 1, k + 1]], method="bounded", options={"xatol": 1e-13}).x
        read = run.at(near + BESIDE)
        assert np.max(np.abs(read.energy - run.energy[0])) < 5e-10 * np.max(read.kinetic_energy)
        if k == flat[0]:  # there rods pull across one another without end
            times = np.array([3e-3, 1e-3, 3e-4])
            before, after = (run.at(near + sense * times)[scene.rods[3].frame_a.force][:, 1] for sense in (-1, 1))
            assert (before - after) * times == pytest.approx(2 * before[0] * times[0], rel=0.1)
