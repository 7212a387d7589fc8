"""What is read of a motion: the same numbers whoever evaluates, and whatever else is asked for with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.errors import OptionError
from acausal.outputs.functions import Functions
from acausal.parts.joint import AbstractJoint
from acausal.runtime import kernels
from acausal.runtime.series import Series
from components import AngleSource, Brake, Gear, Inertia, Revolute, RigidBody, World
from tests.scenes import DoublePendulum, FourBar, bennett_linkage

SCENES: dict[str, Callable[[], Any]] = {"double_pendulum": DoublePendulum, "four_bar": FourBar, "bennett": bennett_linkage}


def _parts(scene: Any) -> Iterator[Any]:
    for value in vars(scene).values():
        yield from value if isinstance(value, list) else [value]


def _expressions(scene: Any) -> list[Any]:
    """Positions, rates, accelerations and reactions of some bodies and joints of a scene."""
    frames = [p.frame for p in _parts(scene) if isinstance(p, RigidBody)][-2:]
    joints = [p for p in _parts(scene) if isinstance(p, AbstractJoint)]
    found: list[Any] = [quantity for f in frames for quantity in (f.position, f.rotation, 2 * f.velocity[0] * ac.time)]
    found += [quantity for f in frames for quantity in (f.acceleration, f.angular_acceleration)]
    found += [quantity for j in (joints[0], joints[-1]) for quantity in (j.frame_a.force, j.frame_b.torque)]
    return [*found, ac.der(joints[0].v)]


@pytest.fixture(scope="module", params=SCENES)
def read(request: pytest.FixtureRequest) -> tuple[Any, ac.Trajectory]:
    """A scene and a run of it."""
    scene = SCENES[request.param]()
    joint = next(p for p in _parts(scene) if isinstance(p, AbstractJoint))
    return scene, ac.build(scene).simulate(0.3, start={joint.v: 0.7}, samples=13)


def test_series_are_what_functions_of_the_states_give(read: tuple[Any, ac.Trajectory]) -> None:
    scene, run = read
    f = run.functions
    for expression in _expressions(scene):
        series, output = run[expression], f.output(expression)
        for k in (0, 7, 12):
            wanted = np.array(output(run.t[k], run.x[:, k], run.u[:, k], run.problem.parameters))
            difference = np.abs(series[k] - wanted.reshape(series[k].shape))
            assert np.max(difference) <= 1e-9 * max(1.0, float(np.max(np.abs(series)))), expression


def test_a_time_reads_alike_whichever_others_are_read_with_it(read: tuple[Any, ac.Trajectory]) -> None:
    scene, run = read
    for expression in _expressions(scene):
        whole = run[expression]
        alone = [run.at(run.t[k])[expression][0] for k in (3, 12)]
        assert np.array_equal(whole[[3, 12]], alone), expression
        assert np.array_equal(run.at(run.t[::-1])[expression][::-1], whole), expression


def test_energies_and_samples_do_not_depend_on_who_evaluates() -> None:
    scene = FourBar()
    model = ac.build(scene)
    ours, casadi = (model.simulate(1.0, start={scene.a.v: 3.0}, compiled=compiled) for compiled in (True, False))
    for one, other in ((ours.energy, casadi.energy), (ours[scene.b.frame_a.force], casadi[scene.b.frame_a.force])):
        assert np.max(np.abs(one - other)) < 1e-7 * np.max(np.abs(one))


def test_what_is_read_again_and_again_is_compiled_with_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where that has cost a part of what a compiler takes; nobody asks one before."""
    begun: list[object] = []
    monkeypatch.setattr(kernels, "in_background", lambda work, _: (begun.append(work), work()))
    scene = FourBar()
    run, force = ac.build(scene).simulate(1.0, start={scene.a.v: 3.0}), scene.b.frame_a.force
    before = run[force]
    assert not begun
    monkeypatch.setattr(kernels, "WORTH", 0.0)
    times = np.linspace(0, 1, run.t.size)
    assert np.array_equal(run.at(times)[force], before)
    count = len(begun)
    assert count and np.array_equal(run.at(run.t)[force], before) and len(begun) == count


def test_expressions_that_are_written_alike_are_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = DoublePendulum()
    run = ac.build(scene).simulate(0.1, start={scene.elbow.v: 1.0})
    before = run[2 * scene.elbow.q + 1], run[scene.lower.tip.position], run[scene.elbow.frame_b.force]
    made: list[str] = []

    def refused(*_: object) -> None:
        made.append("again")

    monkeypatch.setattr(Functions, "_reading", refused)
    monkeypatch.setattr(Series, "__init__", refused)
    after = run[2 * scene.elbow.q + 1], run[scene.lower.tip.position], run.at(run.t)[scene.elbow.frame_b.force]
    assert not made
    for one, other in zip(before, after, strict=True):
        assert np.array_equal(one, other)
    monkeypatch.undo()
    assert not np.array_equal(run[2 * scene.elbow.q + 2], before[0])
    assert not np.array_equal(run[2 * scene.shoulder.q + 1], before[0])


@pytest.mark.parametrize("end", [44.63759275900515, 3.0, 4.8655e12, 1.3e-7])
def test_times_that_are_off_by_their_rounding_are_of_the_motion(end: float) -> None:
    """The last of times that are computed by logarithms is often a little later than the end that they were computed from."""
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World((0, 0, 0)), Revolute("z"), RigidBody.rod(1.0, (1, 0, 0))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    times = np.append(np.logspace(np.log10(end) - 3, np.log10(end), 6)[:-1], end * (1 + 1e-14))
    model = ac.build(scene)
    run = model.simulate(end, start={scene.hinge.v: 1 / end}, samples=times)
    assert run.t[-1] == end
    assert np.array_equal(run.at(times).t, run.t)
    with pytest.raises(OptionError, match="`samples` are from"):
        model.simulate(end, samples=end * np.array([0.5, 1 + 1e-9]))


@pytest.mark.parametrize("rough", [False, True])
def test_what_drives_bear_is_read_of_the_dynamics_once(rough: bool) -> None:
    """Efforts that accelerations depend on hold the dynamics whole: these are evaluated for all of them together."""
    scene = DoublePendulum()
    scene.drive = AngleSource(lambda t: 0.3 * ca.sin(3 * t))
    scene.gear, scene.rotor, scene.other = Gear(5.0), Inertia(0.01), Revolute(axis="x")
    scene.tool = RigidBody.rod(0.2, (0.0, 0.0, -0.3))
    scene.connect(scene.shoulder.flange, scene.drive.flange)
    scene.connect(scene.elbow.flange, scene.gear.flange_b)
    scene.connect(scene.gear.flange_a, scene.rotor.flange_a)
    scene.connect(scene.lower.tip, scene.other.frame_a)
    scene.connect(scene.other.frame_b, scene.tool.frame)
    if rough:
        scene.brake = Brake(scene.other.flange, 0.05)
    run = ac.build(scene).simulate(0.5, {scene.elbow.q: 0.4, scene.other.v: 2.0}, samples=7)
    f = run.functions
    for wanted in (
        scene.drive.flange.tau,
        scene.gear.flange_b.tau,
        ac.der(scene.rotor.w),
        2 * scene.gear.flange_a.tau + scene.elbow.v,
    ):
        output, series = f.output(wanted), run[wanted]
        closed = [float(output(run.t[k], run.x[:, k], run.u[:, k], run.problem.parameters)) for k in range(7)]
        assert np.max(np.abs(series - closed)) < 1e-12 * np.max(np.abs(closed))
        core = f.reading(wanted).series.function
        assert isinstance(core, ca.Function) and core.n_instructions() < 10 < output.n_instructions()
