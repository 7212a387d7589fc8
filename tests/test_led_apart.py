"""What holds the same as others do, until one of them is led away smoothly, in less than a jump of speed: which of them gives way is seen where it begins, however slowly. Against closed forms."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import acausal as ac
from acausal.errors import AccuracyWarning, SimulationError
from components import (
    AngleSource,
    Clutch,
    Coulomb,
    Inertia,
    Particle,
    PointOnPlane,
    PrescribedMotion,
    RigidBody,
    Rope,
    RotationalGround,
    World,
)
from tests.drawn import SEEDS, Drawn

STATE, INSTANT = 1e-10, 1e-11
POWERS = (2, 3, 5)


class Led:
    """At rest until `begins` [s], then led by `most` [m] times a power of the time, until `end` [s]."""

    def __init__(self, drawn: Drawn, power: int, most: float) -> None:
        self.begins, self.lasts = drawn.T * drawn.within(0.2, 0.8), drawn.T * drawn.within(0.3, 1)
        self.power, self.most, self.end = power, most, self.begins + self.lasts

    @property
    def written(self) -> Any:
        return self.most * np.where(ac.time < self.begins, 0, (ac.time - self.begins) / self.lasts) ** self.power

    def at(self, t: np.ndarray) -> np.ndarray:
        return self.most * (np.maximum(t - self.begins, 0) / self.lasts) ** self.power

    def rates(self) -> tuple[Any, ...]:
        """Itself and two rates, as plain functions of time."""
        scale = [self.most / self.lasts**self.power * np.prod(range(self.power - k + 1, self.power + 1)) for k in range(3)]
        return tuple(lambda t, k=k: scale[k] * max(t - self.begins, 0.0) ** (self.power - k) for k in range(3))


def connect(scene: ac.System, drawn: Drawn, pairs: list[tuple[Any, Any]]) -> None:
    for k in drawn.order(len(pairs)):
        scene.connect(*pairs[k][:: (1, -1)[drawn.rng.integers(2)]])


def hung(drawn: Drawn, height: Any) -> ac.System:
    """A mass that stands on a floor, and hangs on a taut rope that is drawn up to a height."""
    scene = ac.System()
    parts = {
        "world": World((0, 0, -drawn.g)), "mass": Particle(drawn.M), "floor": PointOnPlane(unilateral=True),
        "rope": Rope(drawn.L), "winch": PrescribedMotion(position=(0, 0, drawn.L + height)),
    }  # fmt: skip
    for k in drawn.order(len(parts)):
        setattr(scene, *list(parts.items())[k])
    connect(scene, drawn, [
        (scene.world.frame, scene.floor.frame_a), (scene.world.frame, scene.winch.frame_a), (scene.floor.frame_b, scene.mass.point),
        (scene.rope.frame_a, scene.mass.point), (scene.rope.frame_b, scene.winch.frame_b),
    ])  # fmt: skip
    return scene


@pytest.mark.parametrize(("power", "seed"), list(zip(POWERS, SEEDS, strict=True)))
def test_a_mass_that_stands_and_hangs_is_drawn_up_by_its_rope(power: int, seed: int) -> None:
    drawn = Drawn(seed)
    led = Led(drawn, power, 0.3 * drawn.L)
    scene = hung(drawn, led.written)
    run = ac.build(scene).simulate(led.end, {scene.mass.point.position: (0, 0, 0)}, rtol=1e-12)
    first = run.transitions[0]
    assert first.time == pytest.approx(led.begins, abs=INSTANT * drawn.T) and len(run.transitions) == 1
    assert run[scene.mass.point.position][:, 2] == pytest.approx(led.at(run.t), abs=1e-13 * drawn.L)
    bears = drawn.M * (drawn.g + led.rates()[2](led.end))
    assert run[scene.rope.tension][-1] == pytest.approx(bears, rel=STATE) and run[scene.floor.normal_force][-1] == 0


@pytest.mark.parametrize("step", [0.0, 0.02])
@pytest.mark.parametrize("power", [3, 4])
def test_nor_need_be_known_when_what_leads_it_begins_to(power: int, step: float) -> None:
    """By plain functions of time, with and without steps of one size."""
    drawn = Drawn(power)
    led = Led(drawn, power, 0.3 * drawn.L)
    height = ac.Input("m")
    scene = hung(drawn, height)
    start, options = {scene.mass.point.position: (0, 0, 0)}, {"step": step * drawn.T} if step else {"rtol": 1e-10}
    run = ac.build(scene).simulate(led.end, start, inputs={height: led.rates()}, **options)
    assert run[scene.mass.point.position][-1] == pytest.approx([0, 0, led.most], abs=STATE * drawn.L)
    assert run[scene.floor.normal_force][-1] == 0


@pytest.mark.parametrize("power", POWERS)
def test_derivatives_are_those_of_what_is_left(power: int) -> None:
    drawn = Drawn(power)
    led = Led(drawn, power, 1.0)
    far = ac.Parameter(0.3 * drawn.L)
    scene = hung(drawn, far * led.written)
    scene.far = far
    model, start = ac.build(scene), {scene.mass.point.position: (0, 0, 0)}
    found = model.sensitivities([0.0, led.begins, led.end], [far], start, rtol=1e-10)[scene.mass.point.position]
    assert found[:, :, 0] == pytest.approx(np.outer([0, 0, 1], [0, 0, 1]), abs=1e-9)


@pytest.mark.parametrize(("power", "seed"), [(2, 0), (3, 1), (5, 1), (3, 2), (5, 2)])
def test_a_box_is_lifted_off_four_feet_or_tipped_about_two_of_them(power: int, seed: int) -> None:
    """Tipped about the edge where feet stick: its turn is where the rope is as long as it is."""
    drawn = Drawn(seed)
    led, off = Led(drawn, power, 0.04 * drawn.L), 0.3 * drawn.L * (seed % 2)
    wide, deep, high, rope = 0.5 * drawn.L, 0.3 * drawn.L, 0.2 * drawn.L, drawn.L
    scene = ac.System()
    scene.world, scene.winch = World((0, 0, -drawn.g)), PrescribedMotion(position=(off, 0, 2 * high + rope + led.written))
    scene.box = RigidBody(mass=drawn.M, inertia=tuple(drawn.M * drawn.L**2 * np.array((0.05, 0.06, 0.07))))
    scene.rope = Rope(rope)
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(0.5)) for _ in range(4)]
    corners = list(itertools.product((-wide, wide), (-deep, deep)))
    connect(scene, drawn, [
        (scene.world.frame, scene.winch.frame_a), (scene.winch.frame_b, scene.rope.frame_b),
        (scene.box.at((off, 0, high)), scene.rope.frame_a), *((scene.world.frame, foot.frame_a) for foot in scene.feet),
        *((scene.box.at((x, y, -high)), foot.frame_b) for foot, (x, y) in zip(scene.feet, corners, strict=True)),
    ])  # fmt: skip
    run = ac.build(scene).simulate(led.end, {scene.box.frame.position: (0, 0, high)}, rtol=1e-12)
    assert run.transitions[0].time == pytest.approx(led.begins, abs=INSTANT * drawn.T)
    opened = {str(change.part) for change in run.transitions[0].changes if change.new == "open"}
    assert len(opened) == (2 if off else 4)
    found, rises = run[scene.box.frame.position], led.at(run.t)
    expected = np.stack([np.zeros_like(rises), np.zeros_like(rises), high + rises], axis=1)
    for k, rise in enumerate(rises if off else []):

        def turned(angle: float) -> np.ndarray:
            c, s = np.cos(angle), np.sin(angle)
            return np.array([[c, s], [-s, c]])  # from the edge to places of the box, nose up where x is largest

        def longer(angle: float, rise: float = rise) -> float:
            hook = np.array([-wide, 0.0]) + np.array([wide + off, 2 * high]) @ turned(angle)
            return float(np.linalg.norm(hook - (off, 2 * high + rope + rise)) - rope)

        angle = brentq(longer, -1e-6, 0.5, xtol=1e-15, rtol=1e-14)
        x, z = np.array([-wide, 0.0]) + np.array([wide, high]) @ turned(angle)
        expected[k] = x, 0.0, z
    assert found == pytest.approx(expected, abs=STATE * drawn.L)


@pytest.mark.parametrize("seed", SEEDS)
def test_of_three_ropes_from_above_the_one_that_is_drawn_up_takes_the_mass_along(seed: int) -> None:
    drawn = Drawn(seed)
    led, wide, high = Led(drawn, POWERS[seed], 0.2 * drawn.L), 0.8 * drawn.L, 0.6 * drawn.L
    scene = ac.System()
    scene.world, scene.mass = World((0, 0, -drawn.g)), Particle(drawn.M)
    scene.ropes = [Rope(float(np.hypot(x, high))) for x in (-wide, 0, wide)]
    scene.ends = [PrescribedMotion(position=(x, 0, high + (led.written if x == 0 else 0))) for x in (-wide, 0, wide)]
    connect(scene, drawn, [
        pair for rope, end in zip(scene.ropes, scene.ends, strict=True)
        for pair in ((scene.world.frame, end.frame_a), (end.frame_b, rope.frame_a), (rope.frame_b, scene.mass.point))
    ])  # fmt: skip
    run = ac.build(scene).simulate(led.end, {scene.mass.point.position: (0, 0, 0)}, rtol=1e-12)
    assert run[scene.mass.point.position] == pytest.approx(np.outer(led.at(run.t), (0, 0, 1)), abs=STATE * drawn.L)
    assert run[scene.ropes[0].tension][-1] == run[scene.ropes[2].tension][-1] == 0


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("shift", [-0.2, 0.2])
def test_feet_on_two_tiles_slide_on_the_one_that_bears_less(shift: float, seed: int) -> None:
    """A box stands with two feet on a floor, and with two on a tile that begins to move: it stays, or goes along."""
    drawn = Drawn(seed)
    led, wide, deep, high = Led(drawn, POWERS[seed], 0.05 * drawn.L), 0.5 * drawn.L, 0.3 * drawn.L, 0.1 * drawn.L
    mu = 0.5 + 0.04 * led.rates()[2](led.end) / drawn.g
    scene = ac.System()
    scene.world, scene.tile = World((0, 0, -drawn.g)), PrescribedMotion(position=(led.written, 0, 0))
    scene.box = RigidBody(mass=drawn.M, inertia=tuple(drawn.M * drawn.L**2 * np.array((0.05, 0.06, 0.07))))
    corners = list(itertools.product((-wide, wide), (-deep, deep)))
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in corners]
    moved = shift * drawn.L
    connect(scene, drawn, [
        (scene.world.frame, scene.tile.frame_a),
        *((scene.tile.frame_b if x > 0 else scene.world.frame, foot.frame_a) for foot, (x, y) in zip(scene.feet, corners, strict=True)),
        *((scene.box.at((x - moved, y, -high)), foot.frame_b) for foot, (x, y) in zip(scene.feet, corners, strict=True)),
    ])  # fmt: skip
    run = ac.build(scene).simulate(led.end, {scene.box.frame.position: (moved, 0, high)}, rtol=1e-12)
    along = run[scene.box.frame.position] - (moved, 0, high)
    assert along == pytest.approx(np.outer(led.at(run.t) if shift > 0 else 0 * run.t, (1, 0, 0)), abs=STATE * drawn.L)
    words = [run.modes(foot).words[-1] for foot in scene.feet]
    assert [word.endswith("sticks") for word in words] == [(x > 0) == (shift > 0) for x, _ in corners]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("stronger", [0, 1])
def test_of_two_clutches_the_stronger_one_leads(stronger: int, seed: int) -> None:
    drawn = Drawn(seed)
    led, inertia = Led(drawn, POWERS[seed], 2.0), drawn.M * drawn.L**2
    weak = inertia / drawn.T**2
    holds = weak + 2 * inertia * led.rates()[2](led.end)
    scene = ac.System()
    scene.ground, scene.shaft, scene.motor = RotationalGround(), Inertia(inertia), AngleSource(led.written)
    scene.still = Clutch(scene.ground.flange, scene.shaft.flange_a, capacity=weak if stronger else holds)
    scene.driven = Clutch(scene.motor.flange, scene.shaft.flange_b, capacity=holds if stronger else weak)
    run = ac.build(scene).simulate(led.end, rtol=1e-12)
    assert run[scene.shaft.flange_a.phi] == pytest.approx(stronger * led.at(run.t), abs=STATE)
    assert run.transitions[0].time == pytest.approx(led.begins, abs=INSTANT * drawn.T)


@pytest.mark.parametrize("power", POWERS)
def test_what_is_pressed_between_a_floor_and_a_ceiling_that_comes_down_has_no_motion(power: int) -> None:
    drawn = Drawn(power)
    led = Led(drawn, power, -0.1 * drawn.L)
    scene = ac.System()
    scene.world, scene.mass = World((0, 0, -drawn.g)), Particle(drawn.M)
    scene.floor, scene.ceiling = PointOnPlane(unilateral=True), PointOnPlane(unilateral=True)
    scene.press = PrescribedMotion(position=(0, 0, led.written), rotation=np.diag((1.0, -1.0, -1.0)))
    scene.connect(scene.world.frame, scene.floor.frame_a, scene.press.frame_a)
    scene.connect(scene.press.frame_b, scene.ceiling.frame_a)
    scene.connect(scene.mass.point, scene.floor.frame_b, scene.ceiling.frame_b)
    with pytest.raises(SimulationError, match=r"ceiling|floor") as error:
        ac.build(scene).simulate(led.end, {scene.mass.point.position: (0, 0, 0)})
    assert error.value.trajectory.t[-1] == pytest.approx(led.begins, abs=2e-3 * drawn.T)


def test_what_begins_more_slowly_than_forces_are_known_is_told() -> None:
    """By a part in 1e12 of what gravity accelerates: that both cannot be closed, is seen by where it is in the end."""
    drawn = Drawn(0)
    led = Led(drawn, 2, 1e-6 * drawn.L)
    led.lasts *= np.sqrt(1e-6 / 0.5e-12) * np.sqrt(drawn.L / drawn.g) / led.lasts
    led.end = led.begins + led.lasts
    scene = hung(drawn, led.written)
    with pytest.warns(AccuracyWarning, match="its gap is .* all of them cannot be closed"):
        ac.build(scene).simulate(led.end, {scene.mass.point.position: (0, 0, 0)}, rtol=1e-10)
