"""What is read of motions with modes: transitions, energies, values at impacts, events, copies, long runs."""

from __future__ import annotations

import copy
import functools
import pickle
from collections.abc import Callable, Iterable

import numpy as np
import pytest

import acausal as ac
from acausal.errors import AccuracyWarning, OptionError
from acausal.runtime import native
from acausal.visual.scene import animation_of
from components import Revolute, RigidBody, World
from components.translational import ForceSource, SlidingMass
from tests.rough import Apart, Floor, Ground, bouncing, dragged, juggled, rubbing, thrown

FALL = float(np.sqrt(2 / 9.81))


def _ball(restitution: float = 0.7, end: float = 1.5, **options: object) -> tuple[ac.System, ac.Trajectory]:
    scene = bouncing(restitution)
    return scene, ac.build(scene).simulate(end, {scene.mass.s: 1.0, scene.mass.v: 0.0}, rtol=1e-11, **options)  # pyright: ignore[reportArgumentType]


def _chain() -> ac.Trajectory:
    """Three balls in a row over a floor."""
    scene = ac.System()
    scene.balls = [SlidingMass(m) for m in (3.0, 1.0, 0.2)]
    scene.floor, scene.gaps = Floor(0.9), [Apart(0.8), Apart(0.5)]
    scene.connect(scene.floor.flange, scene.balls[0].flange_a)
    for low, gap, high in zip(scene.balls, scene.gaps, scene.balls[1:], strict=False):
        scene.connect(low.flange_a, gap.flange_a)
        scene.connect(gap.flange_b, high.flange_a)
    start = {ball.s: 0.5 + 0.1 * k for k, ball in enumerate(scene.balls)} | {ball.v: -2.0 for ball in scene.balls}
    return ac.build(scene).simulate(0.4, start, rtol=1e-11)


def _pendulum() -> ac.Trajectory:
    """Two links, the lower one of which strikes the ground and rubs there."""
    scene = ac.System()
    scene.world, scene.hinges = World(gravity=(0, 0, -9.81)), [Revolute("y"), Revolute("y")]
    scene.rods = [RigidBody.rod(1.0, (0.4, 0, -0.3)), RigidBody.rod(0.7, (0.5, 0, 0.1))]
    scene.ground = Ground(0.4, 0.3, -0.6)
    scene.connect(scene.world.frame, scene.hinges[0].frame_a)
    scene.connect(scene.hinges[0].frame_b, scene.rods[0].frame)
    scene.connect(scene.rods[0].tip, scene.hinges[1].frame_a)
    scene.connect(scene.hinges[1].frame_b, scene.rods[1].frame)
    scene.connect(scene.rods[1].tip, scene.ground.point)
    return ac.build(scene).simulate(0.4, {scene.hinges[0].q: 0.2}, rtol=1e-11)


def _thrown() -> ac.Trajectory:
    scene = thrown(0.6, 0.3)
    return ac.build(scene).simulate(0.6, {scene.rod.frame.position: (0, 0, 1.0)}, rtol=1e-11)


def _lifted() -> ac.Trajectory:
    """The same over ground that comes up."""
    scene = thrown(0.6, 0.3, 0.4 * ac.time**2)
    return ac.build(scene).simulate(0.55, {scene.rod.frame.position: (0, 0, 1.0)}, rtol=1e-11)


def _juggled() -> ac.Trajectory:
    scene = juggled(0.7, rate=20.0)
    return ac.build(scene).simulate(3.0, {scene.mass.s: 1.0, scene.mass.v: 0.0}, rtol=1e-11)


def _belt() -> ac.Trajectory:
    scene = rubbing(1.0, 2.0, 3.0, belt=0.5, stiffness=4.0)
    return ac.build(scene).simulate(20.0, {scene.mass.s: 0.0, scene.mass.v: 0.0}, rtol=1e-11)


SCENES: dict[str, Callable[[], ac.Trajectory]] = {
    "ball": lambda: _ball()[1],
    "chain": _chain,
    "pendulum": _pendulum,
    "thrown": _thrown,
    "lifted": _lifted,
    "juggled": _juggled,
    "belt": _belt,
}


@functools.cache
def _run(name: str) -> ac.Trajectory:
    return SCENES[name]()


@pytest.mark.parametrize("name", SCENES)
def test_energy_balance_closes_to_rounding_through_every_impact(name: str) -> None:
    run = _run(name)
    assert len(run.transitions) >= 2
    assert run.energy_error() < 1e-11
    assert run.constraint_error() < 1e-11


@pytest.mark.parametrize("name", SCENES)
def test_values_before_and_after_a_transition_are_those_of_the_motion_next_to_it(name: str) -> None:
    run = _run(name)
    for transition in run.transitions:
        before, there, after = run.at([transition.time - 1e-9, transition.time, transition.time + 1e-9]).x.T
        assert transition.before.x == pytest.approx(before, abs=1e-6)
        assert transition.after.x == pytest.approx(there, rel=1e-12, abs=1e-14)
        assert transition.after.x == pytest.approx(after, abs=1e-6)


def test_ball_tells_when_it_strikes_how_hard_and_what_is_lost() -> None:
    scene, run = _ball(0.5, 1.2)
    met, speed = run.transitions, 9.81 * FALL
    assert [len(t.changes) for t in met] == [1, 1, 1]
    for k, transition in enumerate(met):
        (change,) = transition.changes
        fast, slow = speed * 0.5**k, speed * 0.5 ** (k + 1)
        assert (change.part, change.old, change.new, change.unit) == ("floor", "open", "open", "N*s")
        assert transition.before[scene.mass.v] == pytest.approx(-fast, rel=1e-12)
        assert transition.after[scene.mass.v] == pytest.approx(slow, rel=1e-12)
        assert change.impulse == pytest.approx(2.0 * (fast + slow), rel=1e-12)
        assert change.energy_lost == pytest.approx(fast**2 - slow**2, rel=1e-12)
    assert met.energy_lost == pytest.approx(met.lost_in_balance, rel=1e-13)
    assert "open -> open" in str(met) and f"{met[0].changes[0].energy_lost:.4g} J" in str(met)


def test_modes_of_a_part_are_told_by_words() -> None:
    scene = rubbing(1.0, 2.0, 3.0, belt=0.5, stiffness=4.0)
    run = ac.build(scene).simulate(4.5, {scene.mass.s: 0.0, scene.mass.v: 0.0})
    assert [(t.changes[0].old, t.changes[0].new) for t in run.transitions] == [
        ("slides -", "sticks"), ("sticks", "slides -"), ("slides -", "sticks"),
    ]  # fmt: skip
    told = run.modes(scene.rub)
    assert told.words == run.modes(scene.rub.drag).words == run.modes("rub").words == ("slides -", "sticks", "slides -", "sticks")
    assert told.times[1:].tolist() == [t.time for t in run.transitions]
    assert told.at(1.0) == "sticks"
    with pytest.raises(OptionError, match="no laws by which it opens, sticks or slides; these have: rub"):
        run.modes(scene.mass)


def test_scene_without_modes_has_no_transitions() -> None:
    scene = ac.System()
    scene.world, scene.joint, scene.body = World(), Revolute("y"), RigidBody.rod(1.0, (1, 0, 0))
    scene.connect(scene.world.frame, scene.joint.frame_a)
    scene.connect(scene.joint.frame_b, scene.body.frame)
    run = ac.build(scene).simulate(0.1)
    assert len(run.transitions) == 0 and str(run.transitions) == "No transitions."


def test_samples_exactly_at_an_impact_are_read_after_it() -> None:
    scene, run = _ball()
    times = run.transitions.times
    assert run.at(times)[scene.mass.v].tolist() == [t.after[scene.mass.v] for t in run.transitions]
    again = ac.build(scene).simulate(1.5, {scene.mass.s: 1.0, scene.mass.v: 0.0}, rtol=1e-11, samples=[0.0, *times, 1.5])
    assert again[scene.mass.v][1:-1].tolist() == [t.after[scene.mass.v] for t in run.transitions]
    assert again.energy_error() < 1e-12


def test_run_that_ends_at_an_impact_ends_after_or_before_it_but_not_between() -> None:
    first = _ball()[1].transitions[0].time
    for end in (first, float(np.nextafter(first, 0)), float(np.nextafter(first, 1)), FALL):
        scene, run = _ball(end=end)
        assert abs(run[scene.mass.v][-1]) == pytest.approx(9.81 * FALL * (0.7 if len(run.transitions) else 1.0), rel=1e-12)
        assert run.energy_error() < 1e-12
        assert pickle.loads(pickle.dumps(run)).at([end])["mass.v"] == run[scene.mass.v][-1]


def test_impact_at_the_start_is_a_transition() -> None:
    scene = bouncing(0.5)
    run = ac.build(scene).simulate(0.3, {scene.mass.s: 0.0, scene.mass.v: -2.0}, rtol=1e-11)
    assert run.transitions[0].time == 0 and run.transitions[0].before[scene.mass.v] == -2 and run[scene.mass.v][0] == 1
    assert run.energy_error() < 1e-12


def test_steps_without_length_do_not_count() -> None:
    _, run = _ball()
    assert run.statistics.steps == int((np.diff(run.steps.t) > 0).sum()) == run.steps.t.size - 1 - len(run.transitions)


def test_events_that_jump_through_zero_in_an_impact_are_found_once() -> None:
    scene, run = _ball(events=[ac.when("mass.v"), ac.when("mass.s")])
    speeds = [e for e in run.events if e.when is run.watched[0]]
    assert [e.direction for e in speeds] == ["rising", "falling"] * 2 + ["rising"] * (len(speeds) % 2)
    assert [e.time for e in speeds[::2]] == run.transitions.times.tolist()
    touches = [e for e in run.events if e.when is run.watched[1]]
    assert [e.direction for e in touches] == ["touching"] * len(run.transitions)
    assert [e.time for e in touches] == pytest.approx(run.transitions.times, rel=1e-14)
    assert scene.mass is not None


@pytest.mark.parametrize("what", ["mass.v", "mass.s"])
def test_motion_can_be_stopped_at_an_impact(what: str) -> None:
    scene, run = _ball(events=[ac.when(what, stop=True)])
    assert run.t[-1] == pytest.approx(FALL, rel=1e-13)
    assert run[scene.mass.v][-1] == pytest.approx(0.7 * 9.81 * FALL, rel=1e-12)
    assert len(run.transitions) == 1 and run.energy_error() < 1e-12


@pytest.mark.parametrize("name", SCENES)
def test_copies_of_runs_are_the_same(name: str) -> None:
    run = _run(name)
    between = np.linspace(run.t[0], run.t[-1], 97)
    for other in (copy.deepcopy(run), pickle.loads(pickle.dumps(run))):
        assert np.array_equal(other.x, run.x)
        assert other.at(between).x == pytest.approx(run.at(between).x, rel=1e-9, abs=1e-9)
        assert str(other.transitions) == str(run.transitions)
        assert other.energy_error() < 1e-11


def test_long_runs_keep_both_sides_of_every_impact(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = bouncing(1.0)
    model = ac.build(scene)

    def run(samples: object) -> ac.Trajectory:
        return model.simulate(400.0, {scene.mass.s: 1.0, scene.mass.v: 0.0}, samples=samples, rtol=1e-11)  # pyright: ignore[reportArgumentType]

    whole = run(11)
    monkeypatch.setattr(native, "BUDGET", 1)
    thinned = run(11)
    assert np.array_equal(whole.transitions.times, thinned.transitions.times)
    assert str(whole.transitions) == str(thinned.transitions) and len(whole.transitions) > 400
    assert np.array_equal(whole.at(whole.transitions.times).x, thinned.at(whole.transitions.times).x)
    assert np.array_equal(whole.at(np.linspace(1, 399, 7)).x, thinned.at(np.linspace(1, 399, 7)).x)
    assert thinned.energy_error() < 1e-10


def test_run_that_loses_energy_which_no_part_tells_of_is_still_seen() -> None:
    class Lying(ac.Component):
        """A damper that says it loses nothing."""

        flange = ac.Translational.port()

        def equations(self) -> Iterable[ac.Equation]:
            yield ac.equal(self.flange.f, 0.5 * ac.der(self.flange.s))

        def dissipated_power(self) -> float:
            return 0.0

    scene = ac.System()
    scene.mass, scene.floor, scene.weight, scene.lying = SlidingMass(2.0), _Told(0.7), ForceSource(-20.0), Lying()
    scene.connect(scene.mass.flange_a, scene.floor.flange, scene.weight.flange)
    scene.connect(scene.mass.flange_a, scene.lying.flange)
    with pytest.warns(AccuracyWarning, match="lying"):
        ac.build(scene).simulate(1.5, {scene.mass.s: 1.0, scene.mass.v: 0.0})


class _Told(Floor):
    """A floor that says that it loses nothing but in impacts."""

    def dissipated_power(self) -> float:
        return 0.0


def test_plots_show_jumps_as_jumps_and_what_parts_do_below() -> None:
    scene = dragged()
    run = ac.build(scene).simulate(1.2, {scene.x.v: 2.0, scene.z.q: 0.35}, rtol=1e-11, samples=7)
    above, below = run.plot(scene.z.v, scene.ground.push).axes
    times, speed = above.lines[0].get_data()
    there = times == run.transitions[0].time
    assert speed[there].tolist() == [run.transitions[0].before[scene.z.v], run.transitions[0].after[scene.z.v]]
    assert [label.get_text() for label in below.get_yticklabels()] == ["ground.push", "ground.drag"]
    assert {text.get_text() for text in below.get_legend().get_texts()} == {"open", "closed", "off", "slides +", "sticks"}
    assert run.energy_error() < 1e-12


def test_forces_are_drawn_while_contacts_push() -> None:
    scene = dragged()
    run = ac.build(scene).simulate(1.2, {scene.x.v: 2.0, scene.z.q: 0.35})
    (arrow,) = animation_of(run).links
    length = np.linalg.norm(arrow.ends - arrow.starts, axis=1)
    closed = np.linspace(0, 1.2, length.size) >= run.transitions[0].time
    assert np.all((length > 0) == closed)
