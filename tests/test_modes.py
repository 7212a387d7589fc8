"""Reactions that hold as long as they can, against closed forms: one-sided stops, dry friction, impacts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.collocation.problem import StatusKind
from acausal.errors import AcausalError
from acausal.language.mode_laws import ModeLaw
from acausal.parts.force import AbstractForce, Action
from acausal.parts.placement import Placement
from acausal.parts.pose import symbolic
from components import Clutch, Inertia, Particle, RigidBody, VelocitySource, World
from components.translational import ForceSource, SlidingMass, TranslationalGround, TranslationalSpring
from tests.pairings import each_value
from tests.rough import Floor, Rub
from tests.scenes import Pendulum


def bouncing(restitution: float, mass: float = 2.0, gravity: float = 9.81) -> ac.System:
    scene = ac.System()
    scene.mass, scene.floor, scene.weight = SlidingMass(mass), Floor(restitution), ForceSource(-mass * gravity)
    scene.connect(scene.mass.flange_a, scene.floor.flange)
    scene.connect(scene.mass.flange_b, scene.weight.flange)
    return scene


def rubbing(
    mass: float, sliding: float, holding: float, belt: float = 0.0, force: float = 0.0, stiffness: float = 0.0
) -> ac.System:
    scene = ac.System()
    scene.mass, scene.rub, scene.push = SlidingMass(mass), Rub(sliding, holding, belt), ForceSource(force)
    scene.connect(scene.mass.flange_a, scene.rub.flange, scene.push.flange)
    if stiffness:
        scene.wall, scene.spring = TranslationalGround(), TranslationalSpring(stiffness, 0.0)
        scene.connect(scene.wall.flange, scene.spring.flange_a)
        scene.connect(scene.spring.flange_b, scene.mass.flange_b)
    return scene


def changes(run: object) -> list[float]:
    """Times of changes of mode after the start."""
    met = run.solution.modes  # pyright: ignore[reportAttributeAccessIssue]
    return [change.time for change in met.changes if change.row >= 0]


@each_value(("restitution", [1.0, 0.9, 0.5, 0.1]), ("size", [1.0, 1e-9, 1e6]))
def test_ball_bounces_as_parabolas_do(restitution: float, size: float) -> None:
    scene = bouncing(restitution, mass=3e-4, gravity=9.81 * size)
    fall = np.sqrt(2 / 9.81)
    end = fall * (1 + 2 * restitution + 2 * restitution**2) - 1e-3
    run = ac.build(scene).simulate(end, {scene.mass.s: size, scene.mass.v: 0.0}, rtol=1e-12)
    met = [fall, fall * (1 + 2 * restitution)]
    assert changes(run) == pytest.approx(met, rel=1e-13)
    left = end - met[1]
    speed = 9.81 * fall * restitution**2
    assert run[scene.mass.v][-1] == pytest.approx(size * (speed - 9.81 * left), rel=1e-11, abs=1e-12 * size)
    assert run[scene.mass.s][-1] == pytest.approx(size * (speed * left - 9.81 / 2 * left**2), abs=1e-12 * size)
    assert run.solution.modes is not None
    assert run.solution.modes.changes[1].impulses == pytest.approx([3e-4 * size * 9.81 * fall * (1 + restitution)], rel=1e-12)


def instants(run: Any) -> list[float]:
    return [transition.time for transition in run.transitions]


class Step(ac.Component):
    """Keeps a flange above a floor that is so high [m]; rubs with `friction` where another flange, that of what goes along it, is given."""

    above, along = ac.Translational.port(), ac.Translational.port()

    def __init__(self, height: Any, restitution: float = 0.0, friction: float = 0.0) -> None:
        self.push, self.drag, self.height = ac.Reaction("N"), ac.Reaction("N"), height
        self.restitution, self.friction = restitution, friction

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.above.f, -self.push)
        yield ac.equal(self.along.f, -self.drag)

    def laws(self) -> Iterable[ModeLaw]:
        height = self.height(self.along.s) if callable(self.height) else self.height
        yield ac.OneSided(self.push, self.above.s - height, self.restitution)
        yield ac.DryFriction(self.drag, ac.der(self.along.s), self.friction * self.push)


def stepping(height: Any, size: float, gravity: float = 10.0, **laws: float) -> ac.System:
    """A block of two masses, one for each direction."""
    scene = ac.System()
    scene.up, scene.side, scene.weight = SlidingMass(2.0), SlidingMass(2.0), ForceSource(-2.0 * gravity * size)
    scene.floor = Step(height, **laws)
    scene.connect(scene.up.flange_a, scene.floor.above)
    scene.connect(scene.side.flange_a, scene.floor.along)
    scene.connect(scene.up.flange_b, scene.weight.flange)
    return scene


def heights(course: str, by: float) -> tuple[Any, dict[ac.Input, Any]]:
    """A floor that changes its height at 0.5 s, by time in the scene, or by an input."""
    late = {"after": ac.time > 0.5, "from": ac.time >= 0.5, "bent": ac.time**2 > 0.25}[course.removeprefix("input ")]
    value = np.where(late, by, 0.0) + 0.0 * ac.time
    place = ac.Input("m")
    return (place, {place: value}) if course.startswith("input") else (value, {})


COURSES = ["after", "from", "bent", "input after", "input from", "input bent"]


@each_value(("course", COURSES), ("size", [1.0, 1e-7]))
def test_floor_that_drops_at_once_lets_fall_what_stood_on_it(course: str, size: float) -> None:
    height, inputs = heights(course, -0.05 * size)
    scene = stepping(height, size)
    scene.given = next(iter(inputs), ac.Parameter(0.0, "m"))
    run = ac.build(scene).simulate(0.8, {scene.up.s: 0.0, scene.side.s: 0.0}, inputs=inputs, rtol=1e-12)
    assert instants(run) == pytest.approx([0.5, 0.6], rel=1e-12)
    assert run.transitions[1].energy_lost == pytest.approx(size**2, rel=1e-12)
    assert run[scene.up.s][-1] == pytest.approx(-0.05 * size, rel=1e-13)


@pytest.mark.parametrize("seed", range(12))
def test_floor_that_drops_is_seen_to_drop_whenever_it_does(seed: int) -> None:
    """Also where the step before ends right at the instant at which the comparison is not true yet, and block and floor are at zero."""
    rng = np.random.default_rng(seed)
    any_time, size, gravity = float(rng.uniform(0.05, 0.9)), 10 ** rng.uniform(-3, 3), 10 ** rng.uniform(-1, 2)
    drop = size * 10 ** rng.uniform(-3, -1)
    fall = np.sqrt(2 * drop / (gravity * size))
    for late in (any_time, np.ceil(64 * any_time) / 64):
        scene = stepping(np.where(ac.time > late, -drop, 0.0) + 0.0 * ac.time, size, gravity)
        run = ac.build(scene).simulate(late + 1.3 * fall, {scene.up.s: 0.0, scene.side.s: 0.0}, rtol=1e-12)
        assert instants(run) == pytest.approx([late, late + fall], rel=1e-12)


CONDITIONS: dict[str, Callable[[float], Any]] = {
    "after": lambda late: ac.time > late,
    "bent": lambda late: ac.time**2 > late**2,
    "of a choice": lambda late: np.where(ac.time < late, 0, 1) > 0.5,
    "of a maximum": lambda late: np.maximum(ac.time - late, 0) > 0,
    "of choices": lambda late: np.where(np.where(ac.time < late, 3, 1) > 2, 5, 7) > 6,
}
"""True from then on, said in other ways."""


@each_value(("condition", CONDITIONS), ("seed", range(4)))
def test_floor_begins_to_rise_however_it_is_said_when(condition: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    late, size, gravity, restitution = (
        rng.integers(4, 60) / 64,
        10 ** rng.uniform(-3, 3),
        10 ** rng.uniform(-1, 2),
        rng.uniform(0, 1),
    )
    speed = size * rng.uniform(0.2, 3)
    height = np.where(CONDITIONS[condition](late), speed * (ac.time - late), 0.0)
    scene = stepping(height, size, gravity, restitution=restitution)
    end = late + min(0.5, restitution * speed / (gravity * size))
    run = ac.build(scene).simulate(end, {scene.up.s: 0.0, scene.side.s: 0.0}, rtol=1e-12)
    assert instants(run) == pytest.approx([late], rel=1e-13)
    assert run.transitions[0].energy_lost == pytest.approx(speed**2 * (1 - restitution**2), rel=1e-11)
    assert run[scene.up.v][-1] == pytest.approx((1 + restitution) * speed - gravity * size * (end - late), abs=1e-11 * speed)


@each_value(("condition", CONDITIONS), ("seed", range(4)))
def test_belt_begins_to_run_however_it_is_said_when(condition: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    late, speed, mass = rng.integers(4, 60) / 64, 10 ** rng.uniform(-3, 3), 10 ** rng.uniform(-3, 3)
    drag = mass * speed * rng.uniform(0.1, 3)
    scene = ac.System()
    scene.mass, scene.belt = SlidingMass(mass), VelocitySource(np.where(CONDITIONS[condition](late), speed, 0.0) + 0.0 * ac.time)
    scene.rub = Clutch(scene.belt.flange, scene.mass.flange_a, capacity=drag, holding=rng.uniform(1, 2) * drag)
    sticks = late + speed * mass / drag
    run = ac.build(scene).simulate(1.2 * sticks, {scene.mass.s: 0.0, scene.mass.v: 0.0, scene.belt.flange.s: 0.0}, rtol=1e-12)
    assert run.solution.modes is not None
    assert run.solution.modes.changes[-1].time == pytest.approx(sticks, rel=1e-12)
    there = speed**2 * mass / drag / 2 + speed * 0.2 * sticks
    assert run[scene.mass.s][-1] == pytest.approx(there, rel=1e-11)


@each_value(("course", COURSES), ("size", [1.0, 1e-7]))
def test_floor_that_jumps_into_what_stands_on_it_is_refused_by_part_and_line(course: str, size: float) -> None:
    height, inputs = heights(course, 0.01 * size)
    scene = stepping(height, size)
    scene.given = next(iter(inputs), ac.Parameter(0.0, "m"))
    with pytest.raises(
        ac.errors.SimulationError,
        match=r"floor \(.*test_modes.py:\d+\).*after a jump|floor \(.*test_modes.py:\d+\).* at t = 0.5 s, where it jumps",
    ) as told:
        ac.build(scene).simulate(0.8, {scene.up.s: 0.0, scene.side.s: 0.0}, inputs=inputs, rtol=1e-12)
    assert told.value.trajectory.status.kind is StatusKind.OVERLAPS
    assert told.value.trajectory.t[-1] == pytest.approx(0.5, rel=1e-14)


@pytest.mark.parametrize("course", COURSES)
def test_floor_that_begins_to_rise_at_once_strikes_what_stands_on_it(course: str) -> None:
    height, inputs = heights(course, 2.0 * (ac.time - 0.5))
    scene = stepping(height, 1.0, restitution=0.5)
    scene.given = next(iter(inputs), ac.Parameter(0.0, "m"))
    run = ac.build(scene).simulate(0.6, {scene.up.s: 0.0, scene.side.s: 0.0}, inputs=inputs, rtol=1e-12)
    assert instants(run) == pytest.approx([0.5], rel=1e-13)
    assert run.transitions[0].energy_lost == pytest.approx(3.0, rel=1e-12)
    assert run[scene.up.v][-1] == pytest.approx(2.0, rel=1e-11)


def test_input_that_jumps_and_does_not_say_so_is_seen_at_the_gap_that_it_moves() -> None:
    place = ac.Input("m")
    scene = stepping(place, 1.0)
    scene.place = place
    course = (lambda t: 0.1 if t > 0.5 else 0.0, lambda _: 0.0, lambda _: 0.0)
    with pytest.warns(ac.errors.JumpWarning, match="missed by 0.1: the gap of floor"):
        ac.build(scene).simulate(1.0, {scene.up.s: 0.0, scene.side.s: 0.0}, inputs={place: course})


@pytest.mark.parametrize("speed", [2.0, 0.9])
@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_block_slides_off_a_step_or_stops_before_it(speed: float, size: float) -> None:
    """A step of 5 cm at 10 cm: falls 0.1 s, at the speed that friction has left."""
    scene = stepping(lambda s: np.where(s > 0.1 * size, -0.05 * size, 0.0), size, friction=0.5)
    start = {scene.up.s: 0.0, scene.side.s: 0.0, scene.side.v: speed * size}
    run = ac.build(scene).simulate(0.6, start, rtol=1e-12)
    left = speed**2 - 2 * 5.0 * 0.1
    if left < 0:
        assert changes(run) == pytest.approx([speed / 5], rel=1e-12)
        assert run[scene.side.s][-1] == pytest.approx(speed**2 / 10 * size, rel=1e-12)
        return
    edge = (speed - left**0.5) / 5
    after = left**0.5 - 0.5 * 1.0  # friction in the impact, by mu times the impulse of 2 kg at 1 m/s
    assert instants(run)[:2] == pytest.approx([edge, edge + 0.1], rel=1e-11)
    stopped = 0.1 + 0.1 * left**0.5 + after**2 / 10
    assert run[scene.side.s][-1] == pytest.approx(stopped * size, rel=1e-11)


def test_block_that_slides_against_a_step_is_refused_by_part_and_line() -> None:
    scene = stepping(lambda s: np.where(s > 0.1, 0.05, 0.0), 1.0)
    start = {scene.up.s: 0.0, scene.side.s: 0.0, scene.side.v: 1.0}
    with pytest.raises(
        ac.errors.SimulationError, match=r"gap of floor \(.*test_modes.py:\d+\) is negative at t = 0.1 s, where it jumps"
    ):
        ac.build(scene).simulate(0.6, start, rtol=1e-12)


@pytest.mark.parametrize("force", [-1.5, -2.5, -1.999])
def test_pushed_block_stops_and_stays_where_friction_holds_it_and_turns_back_where_not(force: float) -> None:
    scene = rubbing(1.0, 2.0, 2.0, force=force)
    run = ac.build(scene).simulate(3.0, {scene.mass.s: 0.0, scene.mass.v: 3.0}, rtol=1e-12)
    stop = 3.0 / (2.0 - force)
    back = max(-force - 2.0, 0.0)
    assert changes(run) == pytest.approx([stop], rel=1e-13)
    assert run[scene.mass.s][-1] == pytest.approx(1.5 * stop - back / 2 * (3.0 - stop) ** 2, abs=1e-13)
    assert run[scene.rub.drag][-1] == pytest.approx(min(-force, 2.0), rel=1e-12)


def test_block_on_a_belt_sticks_and_slips_with_its_period() -> None:
    scene = rubbing(1.0, 2.0, 3.0, belt=0.5, stiffness=4.0)
    run = ac.build(scene).simulate(60.0, {scene.mass.s: 0.0, scene.mass.v: 0.0}, rtol=1e-12)
    # slips from s = 3/4 around 1/2 with 2 rad/s: v returns to 1/2 after (2 pi - 2 atan 1) / 2
    slip = np.pi - np.pi / 4
    period = slip + 1.0
    slipping = changes(run)[1::2]
    assert len(slipping) > 15
    assert np.diff(slipping) == pytest.approx(period, rel=1e-12)
    assert run.energy_error() < 1e-10


def test_stuck_block_creeps_by_nothing() -> None:
    scene = rubbing(1.0, 2.0, 2.0, force=1.7)
    run = ac.build(scene).simulate(1e4, {scene.mass.s: 0.0, scene.mass.v: 0.0}, rtol=1e-6)
    assert np.all(run[scene.mass.s] == 0)
    assert run[scene.rub.drag] == pytest.approx(-1.7)


def test_start_below_the_floor_is_refused_with_its_name() -> None:
    scene = bouncing(0.5)
    with pytest.raises(
        ac.errors.SimulationError, match=r"The gap of floor \(.*test_modes.py:\d+\) is negative at the start \(-0.1 m\)"
    ) as refused:
        ac.build(scene).simulate(1.0, {scene.mass.s: -0.1, scene.mass.v: 0.0})
    run = refused.value.trajectory
    assert run is not None and run.status.kind is StatusKind.OVERLAPS


def test_gap_of_velocities_is_refused() -> None:
    class Wrong(Floor):
        """A floor for speeds."""

        def laws(self) -> Iterable[ModeLaw]:
            yield ac.OneSided(self.push, ac.der(self.flange.s), 0.0)

    scene = ac.System()
    scene.mass, scene.wrong = SlidingMass(1.0), Wrong(0.0)
    scene.connect(scene.mass.flange_a, scene.wrong.flange)
    with pytest.raises(ac.errors.ModelError, match=r"The gap of wrong .* is no expression of positions"):
        ac.build(scene)


def test_reaction_without_a_law_is_refused() -> None:
    class Lawless(Floor):
        """A push that nothing rules."""

        def laws(self) -> Iterable[ModeLaw]:
            return ()

    scene = ac.System()
    scene.mass, scene.lawless = SlidingMass(1.0), Lawless(0.0)
    scene.connect(scene.mass.flange_a, scene.lawless.flange)
    with pytest.raises(ac.errors.ModelError, match=r"lawless\.push has no law"):
        ac.build(scene)


def test_restitution_that_gains_energy_is_refused() -> None:
    push = ac.Reaction("N")
    with pytest.raises(ac.errors.ParameterError, match=r"restitution is 1\.2"):
        ac.OneSided(push, ac.Expression(ca.SX(1), frozenset()), 1.2)


@pytest.mark.parametrize("restitution", [0.99, 0.9, 0.5, 0.1])
@pytest.mark.parametrize("size", [1.0, 1e-7])
def test_ball_comes_to_rest_after_impacts_without_end(restitution: float, size: float) -> None:
    scene = bouncing(restitution, gravity=9.81 * size)
    rest = np.sqrt(2 / 9.81) * (1 + 2 * restitution / (1 - restitution))
    run = ac.build(scene).simulate(1.2 * rest, {scene.mass.s: size, scene.mass.v: 0.0}, rtol=1e-12)
    assert changes(run)[-1] <= rest
    met = run.solution.modes
    assert met is not None
    assert met.changes[-1].time == pytest.approx(rest, rel=1e-11)
    left = rest - np.array([change.time for change in met.changes[:-1] if change.row >= 0])
    assert left[-1] <= 1e-6 * left[0] < left[-2]  # what is bridged is the last millionth
    assert run[scene.mass.s][-1] == 0
    assert run[scene.mass.v][-1] == 0
    assert run[scene.floor.push][-1] == pytest.approx(2.0 * 9.81 * size)


class Touch(AbstractForce):
    """A point above the plane z = 0, with friction in its two directions."""

    point = ac.Point.port()

    def __init__(self, friction: float, holding: float | None = None, restitution: float = 0.0) -> None:
        self.push, self.rub = ac.Reaction("N"), (ac.Reaction("N"), ac.Reaction("N"))
        self.friction, self.holding, self.restitution = friction, friction if holding is None else holding, restitution

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        force = ca.vertcat(self.rub[0].sx, self.rub[1].sx, self.push.sx)
        return (Action(self.point, symbolic(placement.pose(self.point).rotation).T @ force, ca.SX.zeros(3)),)

    def potential_energy(self, placement: Placement) -> ca.SX:
        return ca.SX(0)

    def power_loss(self, placement: Placement) -> ca.SX:
        return ca.SX(0)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.OneSided(self.push, self.point.position[2], self.restitution)
        yield ac.DryFriction(self.rub, self.point.velocity[:2], self.friction * self.push, self.holding * self.push)


def sliding(friction: float, slope: float) -> ac.System:
    scene = ac.System()
    scene.world = World(gravity=(9.81 * np.sin(slope), 0.0, -9.81 * np.cos(slope)))
    scene.particle, scene.touch = Particle(0.7), Touch(friction)
    scene.connect(scene.particle.point, scene.touch.point)
    return scene


@each_value(
    ("friction", [0.37, 0.5, 1.0, 3.0, 10.0]), ("velocity", [(1.0, 0.8), (0.3, 2.0), (-1.0, 0.1), (1.0, 0.0), (0.0, -1.0)])
)
def test_oblique_slide_on_an_incline_stops_when_it_should(friction: float, velocity: tuple[float, float]) -> None:
    scene = sliding(friction, 0.3)
    start = {scene.particle.point.position: np.zeros(3), scene.particle.point.velocity: np.array([*velocity, 0.0])}
    run = ac.build(scene).simulate(4.0, start, rtol=1e-12)
    # with pull b down the slope and friction k: d/dt (b v_x + k |v|) = b^2 - k^2
    b, k = 9.81 * np.sin(0.3), 9.81 * friction * np.cos(0.3)
    stop = (b * velocity[0] + k * np.hypot(*velocity)) / (k**2 - b**2)
    assert changes(run)[-1] == pytest.approx(stop, rel=1e-11)
    assert np.all(run[scene.particle.point.velocity][-1] == 0)
    assert run[scene.touch.rub[0]][-1] == pytest.approx(-0.7 * b, rel=1e-12)
    assert run.energy_error() < 1e-11


def table(order: tuple[int, ...], restitution: float = 0.0) -> tuple[ac.System, dict[int, Touch]]:
    scene = ac.System()
    scene.world = World(gravity=(0.0, 0.0, -9.81))
    scene.box = RigidBody(mass=2.0, inertia=(0.1, 0.12, 0.08))
    feet: dict[int, Touch] = {}
    for k in order:
        feet[k] = Touch(0.3, restitution=restitution)
        setattr(scene, f"foot{k}", feet[k])
        x, y = ((0.4, 0.3), (0.4, -0.3), (-0.4, 0.3), (-0.4, -0.3))[k]
        scene.connect(scene.box.at((x, y, -0.5)), feet[k].point)
    return scene, feet


def test_box_on_four_feet_slides_and_stops_with_forces_that_no_order_of_feet_changes() -> None:
    found: list[np.ndarray] = []
    for order in ((0, 1, 2, 3), (3, 1, 0, 2)):
        scene, feet = table(order)
        start = {scene.box.frame.position: (0.0, 0.0, 0.5), scene.box.frame.velocity: (1.0, 0.3, 0.0)}
        run = ac.build(scene).simulate(1.0, start, rtol=1e-10)
        speed = np.hypot(1.0, 0.3)
        assert changes(run)[-1] == pytest.approx(speed / (0.3 * 9.81), rel=1e-11)
        assert run[scene.box.frame.position][-1] == pytest.approx(
            np.array([1.0, 0.3, 0.0]) * speed / (0.6 * 9.81) + [0, 0, 0.5], abs=1e-11
        )
        pushes = np.array([run[feet[k].push] for k in range(4)])
        assert pushes.sum(axis=0) == pytest.approx(2.0 * 9.81, rel=1e-11)
        # while it slides friction tips it: moments about the centre, and of all such forces those of least squares
        tip = 0.5 * 0.3 * 2.0 * 9.81 * np.array([1.0, 0.3]) / speed
        corners = np.array([(0.4, 0.3), (0.4, -0.3), (-0.4, 0.3), (-0.4, -0.3)])
        assert corners.T @ pushes[:, 1] == pytest.approx(tip, rel=1e-10)
        assert pushes[0, 1] + pushes[3, 1] == pytest.approx(pushes[1, 1] + pushes[2, 1], rel=1e-9)
        found.append(pushes)
    assert found[0][:, :30] == pytest.approx(found[1][:, :30], rel=1e-9)


def test_box_that_is_dropped_on_four_feet_comes_to_rest_and_never_goes_through_the_floor() -> None:
    scene, feet = table((0, 1, 2, 3), restitution=0.3)
    start = {
        scene.box.frame.position: (0.0, 0.0, 1.0), scene.box.frame.velocity: (1.0, 0.3, 0.0), scene.box.frame.angular_velocity: (0.5, 0.2, 1.0),
    }  # fmt: skip
    run = ac.build(scene).simulate(1.0, start, rtol=1e-9, samples=1000)
    for foot in feet.values():
        assert np.min(run[foot.point.position][:, 2]) > -1e-9
        assert np.min(run[foot.push]) >= 0
    assert np.all(np.abs(run[scene.box.frame.velocity][-1]) < 1e-12)
    assert sum(run[foot.push][-1] for foot in feet.values()) == pytest.approx(2.0 * 9.81, rel=1e-10)


class Rubs(ac.Component):
    """A law of friction, however wrong, on a shaft."""

    shaft = ac.Rotational.port()

    def __init__(self, law: Any) -> None:
        self.drag, self.law = ac.Reaction("N*m"), law

    def equations(self):
        yield ac.equal(self.shaft.tau, -self.drag)

    def laws(self):
        yield self.law(self.drag, self.shaft.phi)


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (lambda drag, phi: ac.DryFriction(drag, phi, 1.0), "Give a velocity"),
        (lambda drag, phi: ac.DryFriction(drag, np.sin(phi), 1.0 + ac.time), "Give a velocity"),
        (lambda drag, phi: ac.DryFriction(drag, ac.der(phi), -0.5), "sliding is -0.5"),
        (lambda drag, phi: ac.DryFriction(drag, ac.der(phi), ac.Parameter(-0.5)), "sliding is -0.5"),
        (lambda drag, phi: ac.DryFriction(drag, ac.der(phi), np.nan), "sliding is nan"),
        (lambda drag, phi: ac.DryFriction(drag, ac.der(phi), 2.0, np.inf), "holding is inf"),
        (lambda drag, phi: ac.DryFriction(drag, ac.der(phi), 2.0, 1.0), "holding is 1, below its sliding of 2"),
    ],
)
@pytest.mark.parametrize("place", ["hinge", "shaft"])
def test_friction_that_cannot_be_is_refused(law: Any, said: str, place: str):
    """What is no velocity is not moved by the reaction, which would be left out without a word."""
    scene = Pendulum() if place == "hinge" else ac.System()
    with pytest.raises(AcausalError, match=said):
        scene.rub = Rubs(law)
        if place == "shaft":
            scene.rotor = Inertia(0.3)
        scene.connect(scene.rub.shaft, scene.rotor.flange_a if place == "shaft" else scene.hinge.flange)
        ac.build(scene).simulate(0.1)


class LiftedFloor(ac.Component):
    """Keeps a flange above a floor, which is half a metre higher at once after a second."""

    flange = ac.Translational.port()

    def __init__(self) -> None:
        self.push = ac.Reaction("N")

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.flange.f, -self.push)

    def laws(self) -> Iterable[Any]:
        yield ac.OneSided(self.push, self.flange.s - np.where(ac.time > 1.0, 0.5, 0.0), 0.5)  # pyright: ignore[reportArgumentType, reportCallIssue]


def test_what_is_on_the_wrong_side_of_a_floor_ends_the_run_by_name() -> None:
    scene = ac.System()
    scene.mass, scene.floor = SlidingMass(2.0), LiftedFloor()
    scene.connect(scene.mass.flange_a, scene.floor.flange)
    run = ac.build(scene).simulate(3.0, {scene.mass.s: 0.3, scene.mass.v: -0.1}, raise_on_failure=False)
    assert run.status.kind is StatusKind.OVERLAPS
    assert run.t[-1] == pytest.approx(1.0, abs=1e-9)
    assert "floor" in run.status.message
