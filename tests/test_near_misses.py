"""Loops that come close to singular positions and miss them: there the motion turns sharply onto the branch that nearly crosses its own.

Stored numbers: Taylor series of order 30 in quadruple precision for the points at the ends of the rods.
"""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.collocation.problem import StatusKind, Through
from acausal.errors import AccuracyWarning, SimulationError
from acausal.runtime.kernels import paired
from acausal.runtime.load import runtime
from acausal.simulate.trajectory import Trajectory
from components import Particle, Prismatic, Revolute, RigidBody, Rod, World
from tests.pairings import each_value
from tests.scenes import rotation
from tests.test_interpreter import kernel_values
from tests.test_singular_loops import connected, drawn, four_bar
from tests.test_singular_loops_in_space import LINKS, Plate, inversor

G = 9.81


def bound(rtol: float, missed: float) -> float:
    """What a tolerance allows, or rounding of states of size one beside a singular position that is `missed` by so much."""
    return 30 * rtol + 1e-13 / missed**0.5


@pytest.mark.parametrize(
    ("missed", "tips"),
    [
        (1e-3, [(0.29783315672950816, -0.2670120048846798), (-0.39674232719038444, -0.05094630325703695)]),
        (-1e-5, [(0.27096903331490524, 0.2942376301297742), (-0.38840931538511575, 0.09559395232997593)]),
        (1e-7, [(0.2665835786329193, -0.29821669236189), (-0.3855585168450391, 0.10651117353711634)]),
        (-1e-9, [(0.2662447358514096, 0.29851924666830637), (-0.3852062347341028, 0.10777827574226306)]),
        (1e-11, [(0.2662008397127695, -0.2985583911669817), (-0.38517622328764284, 0.10788548101513896)]),
        (-1e-13, [(0.26619744331096107, 0.29856141943444015), (-0.3851726717364283, 0.10789816007431126)]),
    ],
)
def test_a_four_bar_that_is_nearly_a_parallelogram_turns_where_it_nearly_folds(missed, tips):
    """Rocker longer or shorter than the crank by so many m."""
    lengths = 0.4, 1.0, 0.4 + missed
    scene = four_bar(1.0, lengths, (1.0, 2.0, 1.5))
    b, d = min((drawn(1.0, lengths, 0.9, side) for side in (1, -1)), key=lambda angles: abs(angles[1] - 0.9))
    start = {scene.a.q: 0.9, scene.a.v: 5.0, scene.b.q: ac.near(b), scene.d.q: ac.near(d)}
    model = ac.build(scene)
    for rtol in (1e-6, 1e-9, 1e-12):
        run = model.simulate(4.0, start, rtol=rtol, samples=3)
        assert np.max(np.abs(run[scene.crank.tip.position][1:, :2] - tips)) < bound(rtol, abs(missed))
        assert run.at(run.solution.t).energy_error() < bound(rtol, abs(missed))
        assert run.statistics.steps < 1000


@pytest.mark.parametrize(
    ("missed", "places"),
    [
        (1e-3, (0.5305061260532385, 0.3157449712875923)),
        (-1e-6, (0.5465535699199905, 0.33985788686305624)),
        (1e-9, (0.5499676039731082, 0.3450367714063612)),
        (-1e-11, (0.5499873966134344, 0.3450668365170236)),
    ],
)
def test_a_slider_crank_with_nearly_equal_bars_folds_away_or_turns_back(missed, places):
    """Where crank and rod together turn on the spot, or the slider comes back."""
    scene, rod = ac.System(), 0.5 + missed
    scene.world, scene.block = World((0, -G, 0)), RigidBody(0.7, (0.1, 0.1, 0.1))
    scene.crank, scene.rod = RigidBody.rod(1.0, (0.5, 0, 0)), RigidBody.rod(1.0, (rod, 0, 0))
    scene.pivot, scene.pin, scene.wrist, scene.slide = Revolute("z"), Revolute("z"), Revolute("z"), Prismatic("x")
    connected(scene, [(scene.pivot, scene.world.frame, scene.crank.frame), (scene.pin, scene.crank.tip, scene.rod.frame)])
    connected(scene, [(scene.slide, scene.world.frame, scene.block.frame), (scene.wrist, scene.rod.tip, scene.block.frame)])
    at = 0.5 * np.cos(0.6) + np.sqrt(rod**2 - (0.5 * np.sin(0.6)) ** 2)
    start = {scene.pivot.q: 0.6, scene.pivot.v: 3.0, scene.slide.q: ac.near(float(at))}
    model = ac.build(scene)
    for rtol in (1e-6, 1e-9, 1e-12):
        run = model.simulate(4.0, start, rtol=rtol, samples=3)
        assert np.max(np.abs(run[scene.slide.q][1:] - places)) < bound(rtol, abs(missed))
        assert run.at(run.solution.t).energy_error() < bound(rtol, abs(missed))


@pytest.mark.parametrize(
    ("lengths", "missed", "tips"),
    [
        ((1.0, 1.0007, 0.9998, 1.0003), 3e-4, [(-0.34402611629699215, 0.938960079718839), (-0.6840076596349058, 0.7294748258581504)]),
        ((1.0, 1.000003, 0.999995, 1.000002), 2e-6, [(-0.4736300100871629, 0.8807239144844621), (-0.8994284398229873, 0.43706805149494404)]),
        ((1.0, 1.000000003, 0.999999995, 1.000000002), 2e-9, [(-0.48432356919219616, 0.8748889531391582), (-0.9135137715206594, 0.4068078038117024)]),
    ],
)  # fmt: skip
def test_several_nearly_equal_cranks_stay_near_one_fold_while_they_pass_another(lengths, missed, tips):
    """One crank goes round while its neighbours hang nearly still: next to one singular position steps could leap past others."""
    scene, n = ac.System(), len(lengths) - 1
    scene.world = World((0, -G, 0))
    scene.cranks, scene.bars = [RigidBody.rod(1.0, (0, x, 0)) for x in lengths], [RigidBody.rod(1.0, (1, 0, 0)) for _ in range(n)]
    scene.feet, scene.heads = [Revolute("z") for _ in lengths], [Revolute("z") for _ in range(2 * n)]
    connected(scene, [(scene.feet[k], scene.world.at((k, 0, 0)), scene.cranks[k].frame) for k in range(n + 1)])
    for k in range(n):
        one, bar, other = scene.cranks[k].tip, scene.bars[k], scene.cranks[k + 1].tip
        connected(scene, [(scene.heads[2 * k], one, bar.frame), (scene.heads[2 * k + 1], bar.tip, other)])
    start = {scene.feet[0].q: 0.0, scene.feet[0].v: -3.0} | {foot.q: ac.near(0.0) for foot in scene.feet[1:]}
    model = ac.build(scene)
    for rtol in (1e-6, 1e-11):
        run = model.simulate(4.0, start, rtol=rtol, samples=3)
        assert np.max(np.abs(run[scene.cranks[0].tip.position][1:, :2] - tips)) < 10 * bound(rtol, missed)
        assert run.at(run.solution.t).energy_error() < bound(rtol, missed)


class Inversor(ac.System):
    """Peaucellier's linkage of rods whose lengths are round numbers, between particles; its plane is no constraint."""

    def __init__(self, angle: float = 1.22) -> None:
        places = inversor(angle)
        self.world = World((0, -G, 0))
        self.A, self.B, self.P, self.Q = (Particle(1.0, position=tuple(places[name])) for name in "ABPQ")
        points = {name: getattr(self, name).point for name in "ABPQ"}
        points |= {name: self.world.at(tuple(places[name])) for name in "OC"}
        self.rods = [Rod({"O": 1.0, "C": 0.5}.get(a, 0.4)) for a, _ in LINKS]
        for rod, (a, b) in zip(self.rods, LINKS, strict=True):
            self.connect(points[a], rod.frame_a)
            self.connect(rod.frame_b, points[b])


@pytest.mark.parametrize("aside", [0.1, 1e-3, 1e-5])
def test_a_linkage_of_rods_that_misses_its_flat_position_moves_alike_at_each_tolerance(aside):
    """Pushed out of its plane by so many m/s, it goes through singular positions of rods that coincide, nearly where several are at once."""
    scene = Inversor()
    model = ac.build(scene)
    start = {scene.P.point.velocity[2]: aside}
    runs = [model.simulate(1.5, start, rtol=rtol, samples=16) for rtol in (1e-6, 1e-8, 1e-10)]
    for run in runs:
        assert run.energy_error() < 1e-7
        assert run.statistics.steps < 500
    for run, error in zip(runs, (1e-4, 1e-5), strict=False):
        assert np.max(np.abs(run[scene.Q.point.position] - runs[-1][scene.Q.point.position])) < error * (1e-3 / min(aside, 1e-3))


@pytest.mark.parametrize(("rtol", "allowed"), [(1e-6, 1e-7), (1e-8, 1e-8), (1e-10, 1e-8)])
def test_however_little_it_misses_that_position_by_its_energy_is_kept(rtol, allowed):
    """What rounding makes of rates beside a singular position is forgiven there, and nowhere else; where a motion gets lost all the same, it says so."""
    scene = Inversor()
    model = ac.build(scene)
    lost = 0
    for k in range(10):
        run, silent = followed(model, 1.5, {scene.P.point.velocity[2]: 1e-5 * (1 + 0.077 * k)}, rtol)
        assert run.energy_error() < allowed or not silent
        lost += not silent
    assert lost <= 1


def followed(model: ac.Model, end: float, start: dict[ac.Expression, float | ac.near], rtol: float) -> tuple[Trajectory, bool]:
    """A motion, and whether it came to its end without a word."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", AccuracyWarning)
        run = model.simulate(end, start, rtol=rtol, samples=3, raise_on_failure=False)
    return run, run.status.kind is StatusKind.SUCCESS and not told


def test_nearer_than_the_digits_of_rates_a_motion_is_told_to_miss():
    """Pushed out of its plane by so many m/s, a flat linkage of rods turns aside at its flat position; its rates do not show it."""
    scene = Inversor()
    model = ac.build(scene)
    for aside, silent in ((1e-7, False), (1e-9, False), (1e-11, False), (5e-13, False), (1e-14, True), (0.0, True)):
        for rtol in (1e-6, 1e-9, 1e-12):
            run, alone = followed(model, 0.8, {scene.P.point.velocity[2]: aside}, rtol)
            assert alone is silent, (aside, rtol)
            assert run.statistics.steps < 500


def test_a_plate_on_rods_that_turns_a_little_is_told_to_miss_its_flat_position():
    """Given a rate about its own axis, in rad/s."""
    scene = Plate(1.0, 4.0)
    v = 4.0 * (np.cos(1.0) * scene.side + np.array([0, 0, np.sin(1.0)]))
    start = {scene.plate.frame.velocity[k]: float(v[k]) for k in range(3)}
    model = ac.build(scene)
    for rate, silent in ((1e-8, False), (1e-10, False), (1e-11, False), (1e-13, True), (0.0, True)):
        assert followed(model, 0.4, {**start, scene.plate.frame.angular_velocity[2]: rate}, 1e-9)[1] is silent, rate


@pytest.mark.parametrize("off", [1e-9, 1e-12, 1e-13, 2e-14])
def test_of_two_flat_positions_one_may_fit_and_one_miss(off: float):
    """The motion goes straight through the one and turns at the other, or it is told that it did not."""
    lengths = 0.4 + off, 1.0, 0.4
    scene = four_bar(1.0 + off, lengths, (1.0, 2.0, 1.5))
    b, d = min((drawn(1.0 + off, lengths, 0.9, side) for side in (1, -1)), key=lambda angles: abs(angles[1] - 0.9))
    model = ac.build(scene)
    assert model.system.constraints.singular and model.system.constraints.narrow
    for rtol in (1e-6, 1e-9, 1e-12):
        start = {scene.a.q: 0.9, scene.a.v: 5.0, scene.b.q: ac.near(b), scene.d.q: ac.near(d)}
        run, alone = followed(model, 4.0, start, rtol)
        turned = np.array([-0.4, -3.2e-4 + 7.3 * off**0.5])  # by the motions at off = 1e-8 ... 1e-13 and rtol = 1e-12
        right = np.max(np.abs(run[scene.crank.tip.position][-1, :2] - turned)) < 1e-5 + 1e-13 / off**0.5
        assert right or not alone, rtol


@each_value(
    (
        ("bars", "off"),
        [
            ((1.0, 1.0, 0.6, 0.6), (0.0, 4.4e-8, -4.4e-8, 0.0)),
            ((1.0, 1.0, 0.6, 0.6), (0.0, 1e-3, -1e-3, 0.0)),
            ((1.0, 0.6, 0.6, 1.0), (0.0, 0.0, 1.2e-12, -1.2e-12)),
            ((1.0, 0.2, 0.7, 0.5), (2.5e-13, 0.0, -2.5e-13, 0.0)),
            ((1.0, 0.5, 0.9, 0.6), (4.6e-7, 0.0, 4.6e-7, 0.0)),
        ],
    ),
    ("side", [1, -1]),
)
def test_wherever_else_a_four_bar_is_flat_it_fits_or_misses_on_its_own(bars, off, side):
    """Ground, crank, coupler and rocker, all drawn flat, where they fit or not."""
    lengths = np.add(bars, off)
    scene = four_bar(lengths[0], tuple(lengths[1:]), (1.0, 2.0, 1.5))
    b, d = drawn(lengths[0], lengths[1:], 0.8, side)
    start = {scene.a.q: 0.8, scene.a.v: 3.0, scene.b.q: ac.near(b), scene.d.q: ac.near(d)}
    model = ac.build(scene)
    runs = [model.simulate(4.0, start, rtol=rtol, samples=3) for rtol in (1e-6, 1e-10)]
    tips = [run[scene.crank.tip.position] for run in runs]
    assert np.max(np.abs(tips[0] - tips[1])) < 3e-5
    assert all(run.at(run.solution.t).energy_error() < bound for run, bound in zip(runs, (3e-5, 1e-8), strict=True))


def test_lengths_that_fit_to_rounding_are_a_crossing_and_others_are_none():
    """With a few operations behind them they are off by 1e-15; from there on what is typed is what is meant."""
    for missed, singular in ((0.0, True), (1e-15, True), (1e-13, False), (3e-12, False), (-1e-10, False)):
        model = ac.build(four_bar(1.0, (0.4, 1.0, 0.4 + missed)))
        assert model.system.constraints.singular is singular, missed
        exact = model.functions.exact
        assert exact is not None
        assert (exact.through is Through.ALWAYS) is singular


@each_value(("turn", [0, 3]), ("built", [0.36, 0.45, 0.4]))
def test_functions_tell_lengths_that_come_to_fit_and_to_miss(built, turn):
    """A step of a four-bar that was built with another rocker is refused where the loop now passes a crossing, or misses one that it passed."""
    R = rotation(turn) if turn else np.eye(3)
    scene = ac.System()
    scene.world, scene.length = World(None), ac.Parameter(built, "m")
    scene.crank, scene.coupler = RigidBody.rod(1.0, tuple(0.4 * R[:, 0])), RigidBody.rod(2.0, tuple(R[:, 0]))
    scene.rocker = RigidBody.rod(1.5, tuple(scene.length * float(x) for x in R[:, 0]))
    scene.a, scene.b, scene.c, scene.d = (Revolute(tuple(R[:, 2])) for _ in range(4))
    connected(scene, [(scene.a, scene.world.frame, scene.crank.frame), (scene.b, scene.crank.tip, scene.coupler.frame)])
    ends = (scene.coupler.tip, scene.rocker.tip), (scene.world.at(tuple(R[:, 0])), scene.rocker.frame)
    connected(scene, [(scene.c, *ends[0]), (scene.d, *ends[1])])
    model = ac.build(scene)
    step = model.step("gauss", order=4, h=0.01)
    for length in (0.35, 0.4 - 1e-9, 0.4, 0.4 + 1e-12, 0.46):
        b, d = drawn(1.0, (0.4, 1.0, length), 0.9, 1)
        start = {scene.a.q: 0.9, scene.a.v: 5.0, scene.b.q: ac.near(b), scene.d.q: ac.near(d)}
        x = model.functions.space.restricted(model.initial_state(start, parameters={scene.length: length}).x)
        fits = {0.4: built == 0.4}.get(length, abs(length - 0.4) > 1e-3)
        assert np.isfinite(float(step(0, x, [], [length])[1])) == fits, length


@pytest.mark.parametrize("step", [0.05, 0.02])
def test_fixed_steps_do_not_leap_onto_another_branch(step):
    """They follow the motion or are refused."""
    lengths = 0.4, 1.0, 0.4 + 1e-8
    scene = four_bar(1.0, lengths, (1.0, 2.0, 1.5))
    b, d = min((drawn(1.0, lengths, 0.9, side) for side in (1, -1)), key=lambda angles: abs(angles[1] - 0.9))
    start = {scene.a.q: 0.9, scene.a.v: 5.0, scene.b.q: ac.near(b), scene.d.q: ac.near(d)}
    with pytest.raises(SimulationError, match="smaller step"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ac.build(scene).simulate(4.0, start, step=step)


def test_twofold_precision_has_thirty_digits():
    """Of what geometry is made of: differences that are zero in exact arithmetic."""
    library = runtime()
    assert library is not None
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    zeros = [
        (x + 1e-17) - x - 1e-17, (x * y) / y - x, ca.sqrt(x) ** 2 - x, ca.sin(x) ** 2 + ca.cos(x) ** 2 - 1, ca.sin(2 * x) - 2 * ca.sin(x) * ca.cos(x),
        ca.cos(x + y) - (ca.cos(x) * ca.cos(y) - ca.sin(x) * ca.sin(y)), ca.tan(ca.atan2(x, y)) * y - x, ca.hypot(x, y) ** 2 - x**2 - y**2,
        ca.sin(ca.asin(x / 10)) - x / 10, ca.cos(ca.acos(x / 10)) - x / 10, ca.fmax(x, y) + ca.fmin(x, y) - x - y, 1 / (1 / x) - x,
    ]  # fmt: skip
    t, none = ca.SX.sym("t"), ca.SX(0, 1)
    rates = ca.Function("f", [t, ca.vertcat(x, y), none, none], [ca.vertcat(*zeros)])
    points = np.random.default_rng(0).uniform(0.1, 9.0, (3, 64))
    made = paired(rates, "zeros", library.lanes, parameters=(3,))
    assert np.max(np.abs(kernel_values(made.kernel, points, library))) < 3e-29
    plain = np.array(rates(points[:1], points[1:], ca.DM(0, 1), ca.DM(0, 1)))
    assert np.max(np.abs(plain)) > 1e-17


def test_functions_for_twice_as_many_digits_are_made_only_where_a_motion_comes_near():
    lengths = 0.4, 1.0, 0.4 + 1e-7
    scene = four_bar(1.0, lengths, (1.0, 2.0, 1.5))
    b, d = min((drawn(1.0, lengths, 0.9, side) for side in (1, -1)), key=lambda angles: abs(angles[1] - 0.9))
    start = {scene.a.q: 0.9, scene.a.v: 5.0, scene.b.q: ac.near(b), scene.d.q: ac.near(d)}
    model = ac.build(scene)
    made: list[bool] = []
    for end in (0.01, 4.0):
        model.simulate(end, start, samples=3)
        made.append("_exact_dynamics" in vars(model.functions))
    assert made == [False, True]
