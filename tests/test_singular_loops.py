"""Loops that pass singular positions, where branches of the motion cross: each motion goes on along its own branch."""

from __future__ import annotations

import functools
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal.errors import SingularWarning, StartValueError
from acausal.outputs.functions import operations
from components import Prismatic, Revolute, RigidBody, Rod, RotationalDamper, RotationalGround, Screw, World
from tests.formulations import composed, script
from tests.hard_cases import CASES
from tests.linkages import hart, peaucellier, scissors
from tests.pairings import each_value
from tests.scenes import FourBar, rotation
from tests.similar import SCENES, Units
from tests.test_formulations import bennett, line_symmetric, orthogonal

G = 9.81


def connected(scene, ends):
    """Connect hinges: (joint, one connector, the other)."""
    for joint, a, b in ends:
        scene.connect(a, joint.frame_a)
        scene.connect(joint.frame_b, b)


def drift(run) -> float:
    """Energy error at the ends of all steps."""
    return run.at(run.solution.t).energy_error()


class FourBars(ac.System):
    """Cranks side by side, 1 m apart, whose tips are joined by level bars: IFToMM benchmark A02 with any masses."""

    def __init__(self, cranks=(1.0, 1.0, 1.0), bars=(1.0, 1.0), length=1.0, damping=0.0) -> None:
        n = len(bars)
        self.world = World((0, -G, 0))
        self.cranks = [RigidBody.rod(m, (0, length, 0)) for m in cranks]
        self.bars = [RigidBody.rod(m, (1, 0, 0)) for m in bars]
        self.feet, self.heads = [Revolute("z") for _ in cranks], [Revolute("z") for _ in range(2 * n)]
        connected(self, [(self.feet[k], self.world.at((k, 0, 0)), self.cranks[k].frame) for k in range(n + 1)])
        for k in range(n):
            one, bar, other = self.cranks[k].tip, self.bars[k], self.cranks[k + 1].tip
            connected(self, [(self.heads[2 * k], one, bar.frame), (self.heads[2 * k + 1], bar.tip, other)])
        if damping:
            self.damper, self.ground = RotationalDamper(damping), RotationalGround()
            self.connect(self.ground.flange, self.damper.flange_a)
            self.connect(self.damper.flange_b, self.feet[0].flange)

    def spread(self, run) -> float:
        """Largest difference between angles of the cranks [rad]."""
        return float(np.max(np.ptp([run[foot.q] for foot in self.feet], axis=0)))


def parallel_motion(cranks, bars, length, damping, rate, end):
    """Angle and rate of all cranks, from the upright, while they stay parallel."""
    inertia = (sum(cranks) / 3 + sum(bars)) * length**2
    weight = (sum(cranks) / 2 + sum(bars)) * G * length

    def right(_t, y):
        return [y[1], (weight * np.sin(y[0]) - damping * y[1]) / inertia]

    return solve_ivp(right, (0, end), [0.0, rate], "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]


@pytest.mark.parametrize(
    ("rtol", "error", "energy", "steps"),
    [(1e-6, 1e-5, 1e-6, 10), (1e-8, 2e-7, 1e-9, 10), (1e-10, 2e-9, 2e-11, 15), (1e-12, 1e-10, 2e-12, 20)],
)
def test_four_bars_of_the_benchmark(rtol, error, energy, steps):
    """Ten passes in 20 s; the tip of the first crank after 10 s and 20 s: quadruple precision, all cranks staying parallel."""
    scene = FourBars()
    model = ac.build(scene)
    tips = {
        10.0: (0.3284581115408154981985, 0.9445185381786009205888),
        20.0: (0.8397465743068438589933, 0.5429785363528843783684),
    }
    for end, (x, y) in tips.items():
        run = model.simulate(end, {scene.feet[0].q: 0.0, scene.feet[0].v: -1.0}, rtol=rtol, samples=50)
        assert np.max(np.abs(run[scene.cranks[0].tip.position][-1] - (x, y, 0))) < error * end / 10
        assert drift(run) < energy
        assert scene.spread(run) < 1e-6
        assert run.statistics.steps < steps * end


@pytest.mark.parametrize(
    ("make", "point", "steps"), [(peaucellier, "C", 220), (hart, "E", 400), (functools.partial(scissors, 4), "l0", 240)]
)
def test_linkages_of_several_loops_pass_to_the_tolerance(make, point, steps):
    """Their loops let go of one another nearer to a singular position, or in shorter times, than a single one does: what rates there are continued
    from is as near as the motion asks for. Tighter tolerances are better ones.
    """
    scene = make()
    model = ac.build(scene)
    assert model.system.constraints.singular
    hinge, ends = scene.hinge(point), list[np.ndarray]()
    for rtol, energy in ((1e-12, 1e-10), (1e-9, 1e-9), (1e-6, 1e-6), (1e-3, 1e-3)):
        runs = [model.simulate(6.0, {hinge.q: 0.0, hinge.v: 3.0}, rtol=part * rtol, samples=7) for part in (0.8, 1.25, 1.0)]
        run = runs[-1]
        ends.append(np.array([run[h.q][-1] for h in scene.hinges]))
        assert np.median([drift(one) for one in runs]) < energy
        assert max(drift(one) for one in runs) < 3 * energy
        assert np.max(np.abs(ends[-1] - ends[0])) < 300 * energy
        assert run.statistics.steps < steps


@pytest.mark.parametrize(("make", "point"), [(peaucellier, "C"), (hart, "E"), (functools.partial(scissors, 3), "l0")])
def test_linkages_of_several_loops_pass_in_fixed_steps(make, point):
    scene = make()
    hinge = scene.hinge(point)
    assert drift(ac.build(scene).simulate(2.0, {hinge.q: 0.0, hinge.v: 3.0}, step=0.01)) < 1e-9


def test_angles_of_cut_hinges_count_their_turns_however_few_times_are_read():
    scene = scissors(3)
    hinge = scene.hinge("l0")
    run = ac.build(scene).simulate(4.0, {hinge.q: 0.0, hinge.v: 3.0}, rtol=1e-9, samples=2)
    many = run.at(np.linspace(0, 4, 201))
    assert max(abs(run[h.q][-1]) for h in scene.hinges) > 4 * np.pi
    for h in scene.hinges:
        assert abs(run[h.q][-1] - many[h.q][-1]) < 1e-9
        assert abs(run.at(4.0)[h.q][0] - many[h.q][-1]) < 1e-9


def test_derivatives_through_linkages_of_several_loops_are_those_of_differences():
    """To fewer digits than elsewhere, and without steps for digits that are not there."""
    scene = peaucellier()
    model, hinge, change = ac.build(scene), scene.hinge("C"), 1e-5
    start = {hinge.q: 0.0, hinge.v: 3.0}
    after, before = (model.simulate(3.0, start | {hinge.v: 3.0 + d}, rtol=1e-12, samples=2) for d in (change, -change))
    differences = [(after[h.q][-1] - before[h.q][-1]) / (2 * change) for h in scene.hinges]
    for rtol in (1e-9, 1e-12):
        off = []
        for part in (0.7, 1.0, 1.5):
            with pytest.warns(SingularWarning, match="sensitivities"):
                found = model.sensitivities([0.0, 3.0], [hinge.v], start, rtol=part * rtol)
            off.append(np.max(np.abs([found[h.q][-1, 0] for h in scene.hinges] - np.array(differences))))
        assert np.max(off) < 1e-2
        assert np.median(off) < 1e-4


def test_four_bars_in_the_virtual_machine():
    scene = FourBars()
    run = ac.build(scene).simulate(10.0, {scene.feet[0].q: 0.0, scene.feet[0].v: -1.0}, rtol=1e-9, compiled=False)
    assert np.max(np.abs(run[scene.cranks[0].tip.position][-1] - (0.3284581115408155, 0.9445185381786009, 0))) < 1e-7
    assert drift(run) < 2e-8


@pytest.mark.slow
def test_forty_four_bars_pass_as_two_do():
    """The benchmark's full size: 162 states, 80 of 200 rows used; five passes, all cranks at once."""
    count = 40
    scene = FourBars((1.0,) * (count + 1), (1.0,) * count)
    model = ac.build(scene)
    assert model.system.constraints.jacobian.shape == (80, 81)
    assert model.operations < 900 * count  # linear: the loops' factors stay sparse
    run = model.simulate(10.0, {scene.feet[0].q: 0.0, scene.feet[0].v: -1.0}, rtol=1e-10, samples=50)
    angle, rate = parallel_motion((1.0,) * (count + 1), (1.0,) * count, 1.0, 0.0, -1.0, 10.0)
    assert abs(run[scene.feet[0].q][-1] - angle) < 1e-9
    assert abs(run[scene.feet[0].v][-1] - rate) < 1e-8
    assert scene.spread(run) < 1e-11
    assert drift(run) < 1e-10
    assert run.statistics.steps < 120


@pytest.mark.parametrize("method", ["gauss", "radau"])
def test_four_bars_with_each_method(method):
    scene = FourBars()
    run = ac.build(scene).simulate(3.0, {scene.feet[0].q: 0.0, scene.feet[0].v: -1.0}, rtol=1e-9, method=method)
    assert drift(run) < 1e-7
    assert scene.spread(run) < 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_four_bars_of_unequal_masses_and_with_friction(seed):
    """Bars now carry forces that grow without bound towards the singular positions."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    cranks, bars = 10 ** rng.uniform(-1, 1, n + 1), 10 ** rng.uniform(-1, 1, n)
    length, rate, damping = rng.uniform(0.3, 1.5), -rng.uniform(1.0, 5.0), (0.0, 0.3)[seed // 2]
    scene = FourBars(cranks, bars, length, damping)
    model = ac.build(scene)
    angle, _ = parallel_motion(cranks, bars, length, damping, rate, 5.0)
    for rtol, error in ((1e-6, 3e-6), (1e-9, 1e-8), (1e-12, 1e-10)):
        run = model.simulate(5.0, {scene.feet[0].q: 0.0, scene.feet[0].v: rate}, rtol=rtol)
        tip = length * np.array([-np.sin(angle), np.cos(angle), 0])
        assert np.max(np.abs(run[scene.cranks[0].tip.position][-1] - tip)) < error
        assert drift(run) < 0.1 * error
        assert scene.spread(run) < 1e-6


class Parallelogram(ac.System):
    """Four hinged bars of 0.4 m, 1 m, 0.4 m and the ground, turned by `R`, without gravity."""

    def __init__(self, R: np.ndarray) -> None:
        def turned(*v: float) -> tuple[float, ...]:
            return tuple(R @ np.array(v, dtype=float))

        self.world = World(None)
        self.crank, self.coupler, self.rocker = (RigidBody.rod(m, turned(x, 0, 0)) for m, x in ((1, 0.4), (2, 1.0), (1.5, 0.4)))
        self.a, self.b, self.c, self.d = (Revolute(turned(0, 0, 1)) for _ in range(4))
        connected(self, [(self.a, self.world.frame, self.crank.frame), (self.b, self.crank.tip, self.coupler.frame)])
        connected(
            self, [(self.c, self.coupler.tip, self.rocker.tip), (self.d, self.world.at(turned(1, 0, 0)), self.rocker.frame)]
        )


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("R", [np.eye(3), rotation(3)], ids=["plane", "skew"])
def test_a_parallelogram_keeps_its_cranks_parallel_or_crossed(R, rtol):
    """Both branches meet where all bars are in line; parallel cranks turn evenly, crossed ones with tan(a / 2) / tan(d / 2) fixed."""
    scene = Parallelogram(R)
    model = ac.build(scene)
    parallel = model.simulate(4.0, {scene.a.q: 0.9, scene.a.v: 5.0, scene.d.q: ac.near(0.9), scene.b.q: ac.near(-0.9)}, rtol=rtol)
    a, d = parallel[scene.a.q], parallel[scene.d.q]
    bound = max(10 * rtol, 1e-10)
    assert np.max(np.abs(a - 0.9 - 5.0 * parallel.t)) < bound
    assert np.max(np.abs(a - d)) < 1e-6
    crossed = model.simulate(4.0, {scene.a.q: 0.9, scene.a.v: 5.0, scene.d.q: ac.near(-0.4), scene.b.q: ac.near(-1.5)}, rtol=rtol)
    a, d = crossed[scene.a.q], crossed[scene.d.q]
    assert np.ptp(a) > 4 * np.pi
    fixed = np.tan(a[0] / 2) / np.tan(d[0] / 2)
    assert abs(fixed) > 1.01 or abs(fixed) < 0.99
    assert np.max(np.abs(np.sin(a / 2) * np.cos(d / 2) - fixed * np.sin(d / 2) * np.cos(a / 2))) < 1e-6
    assert drift(crossed) < bound


@pytest.mark.parametrize(
    ("method", "order", "step"), [("gauss", None, 0.05), ("gauss", None, 0.01), ("gauss", 4, 0.002), ("radau", None, 0.03)]
)
def test_four_bars_with_fixed_steps(method, order, step):
    """Stages land wherever they do, next to the singular positions too."""
    scene = FourBars()
    model = ac.build(scene)
    run = model.simulate(10.0, {scene.feet[0].q: 0.0, scene.feet[0].v: -1.0}, method=method, order=order, step=step)
    bound = 1e-10 if order is None else 1e-9
    assert np.max(np.abs(run[scene.cranks[0].tip.position][-1] - (0.3284581115408154981985, 0.9445185381786009205888, 0))) < bound
    assert drift(run) < 0.1 * bound


class Cranks(ac.System):
    """One bar on many parallel cranks, all but two redundant, without gravity."""

    def __init__(self, count: int, crank: tuple[float, float, float] = (0.32, 0.24, 0.0)) -> None:
        self.world, self.bar = World(None), RigidBody.rod(2.0, (1, 0, 0))
        self.cranks = [RigidBody.rod(1 + 0.3 * k, crank) for k in range(count)]
        self.feet, self.heads = [Revolute("z") for _ in range(count)], [Revolute("z") for _ in range(count)]
        for k, (foot, head, crank) in enumerate(zip(self.feet, self.heads, self.cranks, strict=True)):
            at = (k / (count - 1), 0, 0)
            connected(self, [(foot, self.world.at(at), crank.frame), (head, crank.tip, self.bar.at(at))])


@each_value(("rtol", [1e-6, 1e-9, 1e-12]), ("count", [2, 4]))
def test_a_bar_on_many_cranks_turns_evenly(count, rtol):
    """A hundred and sixty passes in 100 s, in long steps."""
    scene = Cranks(count)
    start = {foot.q: ac.near(0.9) for foot in scene.feet} | {scene.feet[0].q: 0.9, scene.feet[0].v: 5.0}
    run = ac.build(scene).simulate(100.0, start, rtol=rtol)
    assert np.max(np.abs(run[scene.feet[0].q] - 0.9 - 5.0 * run.t)) < max(0.1 * rtol, 5e-9)
    assert max(np.max(np.abs(run[foot.q] - run[scene.feet[0].q])) for foot in scene.feet) < 1e-11
    assert drift(run) < max(1e-3 * rtol, 3e-11)
    assert run.statistics.steps < 1500


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_bar_on_cranks_that_are_sketched_flat(count):
    """From the singular position itself, with the velocities of the branch of parallel cranks; others belong to no motion."""
    scene = Cranks(count, crank=(0.4, 0.0, 0.0))
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(10.0, {scene.feet[0].q: 0.0} | {foot.v: 5.0 for foot in scene.feet}, rtol=1e-10)
    assert np.max(np.abs(run[scene.feet[0].q] - 5.0 * run.t)) < 1e-9
    assert drift(run) < 1e-10
    with pytest.raises(StartValueError, match="branches of the motion cross"):
        model.simulate(10.0, {scene.feet[0].q: 0.0, scene.feet[0].v: 5.0, scene.feet[1].v: -3.0})


@pytest.mark.parametrize("count", [2, 4])
def test_fixed_steps_of_any_size_pass(count):
    scene = Cranks(count)
    model = ac.build(scene)
    start = {foot.q: ac.near(0.9) for foot in scene.feet} | {scene.feet[0].q: 0.9, scene.feet[0].v: 5.0}
    for step in np.linspace(0.03, 0.11, 5):
        run = model.simulate(50.0, start, step=float(step))
        assert np.max(np.abs(run[scene.feet[0].q] - 0.9 - 5.0 * run.t)) < 5e-11


def four_bar(ground, lengths, masses=(1.0, 1.0, 1.0)):
    """Without gravity, in a plane."""
    scene = ac.System()
    scene.world = World(None)
    scene.crank, scene.coupler, scene.rocker = (RigidBody.rod(m, (x, 0, 0)) for m, x in zip(masses, lengths, strict=True))
    scene.a, scene.b, scene.c, scene.d = (Revolute("z") for _ in range(4))
    connected(scene, [(scene.a, scene.world.frame, scene.crank.frame), (scene.b, scene.crank.tip, scene.coupler.frame)])
    ends = (scene.coupler.tip, scene.rocker.tip), (scene.world.at((ground, 0, 0)), scene.rocker.frame)
    connected(scene, [(scene.c, *ends[0]), (scene.d, *ends[1])])
    return scene


def drawn(ground, lengths, crank, side):
    """Angles of the coupler against the crank, and of the rocker."""
    a, b, c = lengths
    tip = a * np.array([np.cos(crank), np.sin(crank)])
    to = np.array([ground, 0.0]) - tip
    far = np.hypot(*to)
    along = (far**2 + b**2 - c**2) / (2 * far)
    head = tip + (along * to + side * np.sqrt(b**2 - along**2) * np.array([-to[1], to[0]])) / far
    return np.arctan2(*(head - tip)[::-1]) - crank, np.arctan2(head[1], head[0] - ground)


KITES = [(1, (0.6, 0.6, 1)), (0.6, (0.6, 1, 1)), (1, (1, 0.6, 0.6)), (1, (0.3, 0.3, 1))]
CHANGE_POINTS = [(1, (0.5, 0.9, 0.6)), (0.5, (0.6, 1, 0.9)), (0.9, (0.5, 1, 0.6)), (1, (0.9, 0.5, 0.6)), (1, (0.2, 0.7, 0.5))]


@each_value(("side", [1, -1]), (("ground", "lengths"), KITES + CHANGE_POINTS))
def test_each_four_bar_with_a_change_point_goes_on_along_its_branch(ground, lengths, side):
    """Energy to the tolerance, and the same motion at each."""
    scene = four_bar(ground, lengths)
    model = ac.build(scene)
    b, d = drawn(ground, lengths, 0.8, side)
    start = {scene.a.q: 0.8, scene.a.v: 3.0, scene.b.q: ac.near(b), scene.d.q: ac.near(d)}
    runs = [model.simulate(6.0, start, rtol=rtol, samples=21) for rtol in (1e-12, 1e-8)]
    assert runs[0].energy_error() < 1e-12
    assert runs[1].energy_error() < 1e-8
    assert max(np.max(np.abs(runs[0][q] - runs[1][q])) for q in (scene.a.q, scene.d.q)) < 1e-6


@each_value(("off", [0.0, 1e-9, 1e-4]), (("ground", "lengths"), [KITES[2], CHANGE_POINTS[2]]))
def test_minimal_coordinates_go_through_and_past_as_all_coordinates_do(ground, lengths, off):
    """A chart that is followed through a change point, or closely past one, comes out on any branch."""
    ground *= 1 + off
    scene = four_bar(ground, lengths)
    model = ac.build(scene)
    b, d = drawn(ground, lengths, 0.8, 1)
    start = {scene.a.q: 0.8, scene.a.v: 3.0, scene.b.q: ac.near(b), scene.d.q: ac.near(d)}
    minimal, own = model.minimal(start), model.simulate(6.0, start, rtol=1e-12, samples=21)
    for rtol in (1e-12, 1e-9, 1e-6):
        run = minimal.simulate(6.0, rtol=rtol, samples=21)
        assert run.energy_error() < max(rtol, 1e-8)
        assert np.max(np.abs(run[scene.d.q] - own[scene.d.q])) < max(100 * rtol, 1e-7)


@pytest.mark.parametrize(
    ("bars", "turn", "crank", "side"),
    [
        ((71.54918848612698, 101.08425252475395, 136.39434102638631, 36.239099984494615), 97, 2.7818864434829127, -1),
        ((0.6071014199880979, 1.209834104265757, 7.325037905507203, 7.9277705897848625), 667, 0.37486830527971327, 1),
    ],
)
def test_steps_that_are_refused_at_a_pass_leave_nothing_behind(bars, turn, crank, side):
    """Each tolerance gives its energy error, also after the pass."""
    R = rotation(turn)
    turned = [tuple(float(x) * R[:, 0]) for x in bars]
    scene = ac.System()
    scene.world = World(None)
    scene.crank, scene.coupler, scene.rocker = (RigidBody.rod(m, tip) for m, tip in zip((1, 1.5, 0.7), turned[1:], strict=True))
    scene.a, scene.b, scene.c, scene.d = (Revolute(tuple(R[:, 2])) for _ in range(4))
    connected(scene, [(scene.a, scene.world.frame, scene.crank.frame), (scene.b, scene.crank.tip, scene.coupler.frame)])
    ends = (scene.coupler.tip, scene.rocker.tip), (scene.world.at(turned[0]), scene.rocker.frame)
    connected(scene, [(scene.c, *ends[0]), (scene.d, *ends[1])])
    model = ac.build(scene)
    assert model.system.constraints.singular
    b, d = drawn(bars[0], bars[1:], crank, side)
    start = {scene.a.q: crank, scene.a.v: 3.0, scene.b.q: ac.near(b), scene.d.q: ac.near(d)}
    for rtol in (1e-10, 1e-11, 1e-12):
        assert drift(model.simulate(6.0, start, rtol=rtol, samples=2)) < 1e-11


@pytest.mark.parametrize("masses", [(1, 1, 1e-9), (1e-9, 1, 1e-9), (1e9, 1, 1), (1, 1e-12, 1), (1, 1e-3, 1e-6)])
def test_change_points_are_passed_with_any_masses(masses):
    """Where the steps fall beside a change point decides how much of the energy is rounded there: of sixty starts the worst lost 1.7e-11, at any tolerance below."""
    for ground, lengths, rate in ((1, (0.4, 1, 0.4), 5.0), (1, (0.6, 0.6, 1), 3.0)):
        scene = four_bar(ground, lengths, masses)
        model = ac.build(scene)
        for crank in (0.9, 0.9045):
            b, d = drawn(ground, lengths, crank, 1)
            start = {scene.a.q: crank, scene.a.v: rate, scene.b.q: ac.near(b), scene.d.q: ac.near(d)}
            run = model.simulate(5.0, start, rtol=1e-11, samples=21)
            assert run.energy_error() < 3e-11
            if rate == 5.0:
                assert np.max(np.abs(run[scene.a.q] - crank - rate * run.t)) < 1e-10


def test_change_points_are_found_wherever_a_walk_begins():
    """The shortest and the longest bar are together as long as the other two, each in each place; nearly so, they are no change points."""
    rng = np.random.default_rng(0)
    for _ in range(6):
        p, q = rng.uniform(0.4, 1.2, 2)
        longest = rng.uniform(max(p, q), p + q - 0.1)
        bars = rng.permutation([longest, p + q - longest, p, q])
        assert ac.build(four_bar(bars[0], bars[1:])).system.constraints.singular, bars
        assert not ac.build(four_bar(1.003 * bars[0], bars[1:])).system.constraints.singular, bars


def test_a_rod_between_equal_cranks_in_space_is_one_row_that_vanishes():
    scene = ac.System()
    scene.world, scene.rod = World(None), Rod(1.0)
    scene.one, scene.two = RigidBody.rod(1.0, (0.4, 0, 0)), RigidBody.rod(1.0, (0.4, 0, 0))
    scene.a, scene.d = Revolute("z"), Revolute("z")
    connected(scene, [(scene.a, scene.world.frame, scene.one.frame), (scene.d, scene.world.at((1, 0, 0)), scene.two.frame)])
    scene.connect(scene.one.tip, scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, scene.two.tip)
    model = ac.build(scene)
    for rtol in (1e-8, 1e-12):
        run = model.simulate(10.0, {scene.a.q: 0.9, scene.d.q: ac.near(0.9), scene.a.v: 5.0}, rtol=rtol)
        assert np.max(np.abs(run[scene.a.q] - 0.9 - 5.0 * run.t)) < 1e-11


@pytest.mark.parametrize("scene", [FourBars(), Cranks(4)], ids=["level bars", "one bar"])
def test_starts_at_a_singular_position(scene):
    """All bars in one line: velocities of parallel cranks lead on; others, which close the loops to first order only, belong to no motion."""
    tips = [crank.tip.position for crank in scene.cranks]
    model = ac.build(scene)
    flat = {tip[1]: 0.0 for tip in tips} | {scene.feet[0].q: ac.near(-0.6)}
    with pytest.raises(StartValueError, match=r"branches of the motion cross.*feet\[0\]\.v = 5"):
        model.simulate(1.0, flat | {scene.feet[0].v: 5.0})
    run = model.simulate(1.0, flat | {foot.v: 5.0 for foot in scene.feet}, rtol=1e-11)
    apart = np.max([np.abs(run[foot.v] - run[scene.feet[0].v]) for foot in scene.feet], axis=0)
    height = run[scene.cranks[0].tip.position][:, 1]
    with np.errstate(divide="ignore"):  # what rounding of positions makes of velocities beside a singular position
        known = 10 * np.finfo(float).eps * np.abs(run[scene.feet[0].v]) / height**2
    assert np.all(apart < 3e-11 + np.where(np.abs(height) < 0.01, known, 0.0))
    assert drift(run) < 1e-11


@pytest.mark.parametrize("length", [1.0, 3e-5, 7e4])
def test_a_crank_that_is_told_to_lie_flat_lies_flat_to_all_digits(length):
    """There the other angles are double roots, known to half of the digits from how the loop closes, and velocities of both branches are met."""
    scene, crank, speed = four_bar(length, (0.4 * length, length, 0.4 * length)), 0.4, 5.0
    model, rough = ac.build(scene), {scene.a.q: 0.0, scene.b.q: ac.near(0.7), scene.d.q: ac.near(-0.6)}
    for share in (1.0, -(1 + crank) / (1 - crank)):
        run = model.simulate(1.0, rough | {scene.a.v: speed, scene.d.v: share * speed}, rtol=1e-11, samples=21)
        assert run.energy_error() < 1e-11
        assert abs(run[scene.d.q][0]) < 1e-13
        if share == 1.0:
            assert np.allclose(run[scene.a.q], speed * run.t, atol=1e-10)
            assert np.allclose(run[scene.d.q], speed * run.t, atol=1e-10)
        else:
            assert run[scene.d.q][1] < 3 * share * run[scene.a.q][1] / 4


def test_a_slider_crank_with_equal_bars_does_not_fold_away():
    """The slider goes through the crank's pivot, where crank and rod could also turn together on the spot."""
    scene = ac.System()
    scene.world, scene.block = World((0, -G, 0)), RigidBody(0.7, (0.1, 0.1, 0.1))
    scene.crank, scene.rod = RigidBody.rod(1.0, (0.5, 0, 0)), RigidBody.rod(1.0, (0.5, 0, 0))
    scene.pivot, scene.pin, scene.wrist, scene.slide = Revolute("z"), Revolute("z"), Revolute("z"), Prismatic("x")
    connected(scene, [(scene.pivot, scene.world.frame, scene.crank.frame), (scene.pin, scene.crank.tip, scene.rod.frame)])
    connected(scene, [(scene.slide, scene.world.frame, scene.block.frame), (scene.wrist, scene.rod.tip, scene.block.frame)])
    run = ac.build(scene).simulate(5.0, {scene.pivot.q: 0.6, scene.pivot.v: 3.0, scene.slide.q: ac.near(0.8)}, rtol=1e-10)
    assert np.max(np.abs(run[scene.slide.q] - np.cos(run[scene.pivot.q]))) < 1e-9
    assert np.min(run[scene.slide.q]) < -0.5
    assert drift(run) < 1e-9


class ScrewDriven(ac.System):
    """A slider-crank with bars of one length, whose slider does not turn, but the shaft in it does: 1 kg, 2 kg, 0.5 kg, and 1e-3 kg m^2."""

    def __init__(self, pitch: float, length: float = 0.3) -> None:
        self.world, self.length, self.lead = World(None), length, pitch / (2 * np.pi)
        self.crank, self.rod = RigidBody.rod(1.0, (length, 0, 0)), RigidBody.rod(2.0, (length, 0, 0))
        self.block, self.shaft = RigidBody.box(0.5, (0.1, 0.1, 0.1)), RigidBody(1.0, (1e-3, 1e-3, 1e-3))
        self.a, self.b, self.c = (Revolute("y") for _ in range(3))
        self.nut, self.bearing = Screw("x", pitch), Revolute("x")
        connected(
            self,
            [
                (self.a, self.world.frame, self.crank.frame),
                (self.b, self.crank.tip, self.rod.frame),
                (self.c, self.rod.tip, self.block.frame),
                (self.nut, self.block.frame, self.shaft.frame),
                (self.bearing, self.world.frame, self.shaft.frame),
            ],
        )

    def mass(self, angle: np.ndarray) -> np.ndarray:
        """What resists the crank at an angle [kg m^2]."""
        sine, cosine = np.sin(angle) ** 2, np.cos(angle) ** 2
        rod = 2.0 * (1 / 12 + 2.25 * sine + 0.25 * cosine)
        return self.length**2 * (1 / 3 + rod + 4 * (0.5 + 1e-3 / self.lead**2) * sine)


@pytest.mark.parametrize("pitch", [0.08, -0.005])
def test_a_screw_that_has_turned_once_is_not_back_where_it_began(pitch):
    """After many turns of it the bars fold, and go on with their energy."""
    scene, angle = ScrewDriven(pitch), 1.2
    model = ac.build(scene)
    assert model.system.constraints.singular
    run = model.simulate(0.5, {scene.a.q: -angle, scene.a.v: -4.0, scene.b.q: 2 * angle}, rtol=1e-10)
    turned = -run[scene.a.q]
    assert turned[-1] > np.pi / 2 + 0.1
    assert np.allclose(run[scene.block.frame.position][:, 0], 2 * scene.length * np.cos(turned), atol=1e-9)
    assert np.allclose(-run[scene.a.v], 4.0 * np.sqrt(scene.mass(angle) / scene.mass(turned)), rtol=1e-7)


@pytest.mark.parametrize("pitch", [0.003, 0.02])
def test_a_slider_on_a_screw_starts_where_it_is_told_however_many_turns_away(pitch):
    scene = ScrewDriven(pitch)
    model = ac.build(scene)
    for angle in (0.3, 1.2):
        run = model.simulate(1e-6, {scene.a.q: -angle, scene.b.q: ac.near(2.0)}, samples=2)
        x, q, turn = (np.ravel(run[part])[0] for part in (scene.block.frame.position[0], scene.a.q, scene.bearing.q))
        assert q == pytest.approx(-angle, abs=1e-12)
        assert x == pytest.approx(2 * scene.length * np.cos(angle), rel=1e-11)
        assert np.sin(turn + x / scene.lead) == pytest.approx(0.0, abs=1e-8)
        assert np.cos(turn + x / scene.lead) > 0.99


@pytest.mark.parametrize("offset", [0.1, 0.05])
def test_rates_beside_a_branch_are_those_on_it(offset):
    """Near a singular position rates would otherwise depend on the distance from closed loops by more than 1 / offset."""
    scene = FourBars((1.0, 3.0, 0.5), (1.0, 2.0))
    functions = ac.build(scene).functions
    angle, rate, system = -np.pi / 2 + offset, -3.0, functions.outputs.system
    # a bar turns against the crank that it hangs on, a crank with itself against the bar
    sign = np.array([-1.0 if name[:8] in ("heads[0]", "heads[2]") else 1.0 for name in functions.state_names[: system.nq]])
    on = np.concatenate([angle * sign, rate * sign])
    want = np.array(functions.explicit_dynamics(0, on, [], system.p_values)).ravel()
    inertia, weight = 4.5 / 3 + 3.0, (4.5 / 2 + 3.0) * G
    assert np.max(np.abs(want[system.nq :] - weight * np.sin(angle) / inertia * sign)) < 1e-8
    rng = np.random.default_rng(1)
    for _ in range(5):
        beside = on + 1e-7 * np.concatenate([rng.normal(size=system.nq), np.zeros(system.nq)])
        got = np.array(functions.explicit_dynamics(0, beside, [], system.p_values)).ravel()
        assert np.max(np.abs(got - want)[system.nq :]) < 1e-5


def test_only_loops_with_singular_positions_are_treated():
    """A loop that misses one by a millionth of its size, and others, are reduced as ever."""
    for scene in (FourBar(), CASES["nearly_folding"]().scene, CASES["andrews"]().scene, CASES["bennett"]().scene):
        assert not ac.build(scene).system.constraints.singular
    assert ac.build(FourBars()).system.constraints.singular
    treated, plain = ac.build(Parallelogram(np.eye(3))).functions, CASES["nearly_folding"]().model.functions
    assert operations(plain.explicit_dynamics) < 0.6 * operations(treated.explicit_dynamics)


def test_unequal_masses_are_no_singularity():
    with warnings.catch_warnings():
        warnings.simplefilter("error", SingularWarning)
        case = CASES["massless_coupler"]()
        assert case.error(case.simulate(1e-9)) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize(("make", "light"), [(orthogonal, 2), (bennett, 2), (line_symmetric, 3)])
def test_rows_that_depend_on_one_another_bear_any_ratio_of_masses(make, light):
    """A bar of a hundred millionth of the others' mass beside the joint that is cut."""
    hinges = make()
    sketch = hinges.sketch()
    bodies = tuple(
        replace(body, mass=1e-8 * body.mass, inertia=1e-8 * body.inertia) if k == light else body
        for k, body in enumerate(sketch.bodies)
    )
    scene = composed(script(replace(sketch, bodies=bodies)))
    run = ac.build(scene).simulate(hinges.end, {scene.j0.q: 0.0, scene.j0.v: hinges.rate}, rtol=1e-10, samples=5)
    assert run.energy_error() < 1e-10
    assert run.statistics.steps < 60


@pytest.mark.parametrize("power", [-3, 2])
def test_damping_of_dependent_rows_has_no_unit(power):
    """Bricard's linkage in other lengths: rows mix 1 / kg and 1 / (kg m^2), and rates are the same to the bit."""
    rates: list[np.ndarray] = []
    for length in (1.0, 4.0**power):
        similar = SCENES["orthogonal_linkage"](Units(length=length))
        model = ac.build(similar.scene)
        functions = model.functions
        assert model.system.constraints.damped
        if not rates:
            x = model.initial_state(similar.start).x
        rates.append(np.array(functions.explicit_dynamics(0, x, [], functions.space.p_values)))
    assert np.array_equal(*rates)
