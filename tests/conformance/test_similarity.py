"""What holds in metres holds in millimetres: scenes in other units, elsewhere and turned move as their originals do.

Factors that are powers of four are exact in binary numbers, and so are their square roots: then every bit is the same, unless a
number with a unit is compared somewhere with one without.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

import acausal as ac
from components import Prismatic, RigidBody
from tests.scenes import rotation
from tests.similar import SCENES, Similar, Units
from tests.similar_mechanisms import MORE

RTOL = 1e-10


@functools.cache
def original(name: str) -> tuple[Similar, ac.Model, np.ndarray]:
    """A scene in metres, kilograms and seconds, and what is seen of its motion."""
    return _moved(name, Units())


def _moved(name: str, of: Units) -> tuple[Similar, ac.Model, np.ndarray]:
    similar = (SCENES | MORE)[name](of)
    model = ac.build(similar.scene)
    run = model.simulate(similar.end, similar.start, rtol=RTOL, samples=7, progress=False, compiled=name in SCENES)
    return similar, model, similar.numbers(run)


def _same_decisions(one: ac.Model, other: ac.Model) -> None:
    a, b = one.system.constraints, other.system.constraints
    assert one.degrees_of_freedom == other.degrees_of_freedom
    assert one.state_names == other.state_names
    assert (a.redundant, a.vanishing, a.jacobian.shape) == (b.redundant, b.vanishing, b.jacobian.shape)


POWERS = (-15, -11, -7, -4, -2, -1, 1, 2, 4, 7, 11, 15)


def power(name: str, quantity: int) -> float:
    """Each scene has its own power of four for each unit; over all scenes all powers occur."""
    k = list(SCENES | MORE).index(name)
    return 4.0 ** POWERS[(k, 5 * k + 3, 7 * k + 8)[quantity] % len(POWERS)]


@pytest.mark.parametrize("name", SCENES | MORE)
def test_same_bits_in_units_of_powers_of_four(name: str) -> None:
    """All three units are others: what is compared with a number without unit may have any dimension."""
    _, model, numbers = original(name)
    _, scaled, found = _moved(name, Units(*(power(name, quantity) for quantity in range(3))))
    _same_decisions(model, scaled)
    assert np.array_equal(found, numbers), np.max(np.abs(found - numbers))


TURNED, FAR = (rotation(7), np.array([3.0, -2.0, 1.0])), (np.eye(3), 1e6 * np.array([1.0, 0.2, -0.3]))
OTHER = [
    Units(1e-9, 1e9, 1.0),
    Units(3e4, 1.0, 1e-3),
    Units(1e-3, 1e-6, 10.0),
    Units(1e9, 1e-9, 3e5),
]


@pytest.mark.parametrize("name", SCENES | MORE)
def test_other_units_move_alike_turned_and_far_away(name: str) -> None:
    """To rounding, turned or far away, which is a million of their sizes from the origin: places are rounded to 1e-10 of the size there, of which loops that close only
    since their lengths fit make 1e4 times as much, and nothing else is lost."""
    similar, model, numbers = original(name)
    k = list(SCENES | MORE).index(name)
    of = replace(OTHER[k % 4], place=FAR if (k // 4 + k) % 2 else TURNED)
    _, other, found = _moved(name, of)
    _same_decisions(model, other)
    places = 1e6 * np.finfo(float).eps if of.place is FAR else 0.0
    assert np.max(np.abs(found - numbers)) < (
        min(1e2 * similar.growth, 2e4 if "bennett" in name else 3e3) if places else 1e2 * similar.growth
    ) * (RTOL + places)


SMALL = Units(length=4.0**-10, mass=4.0**-7, time=4.0**-5)
"""A millionth of the size, a ten thousandth of the mass, and a thousandth of the time: the same gravity."""
PAIRS = [
    ("double_pendulum", "double_pendulum"),
    ("four_bar", "stewart_platform"),
    ("stewart_platform", "four_bar"),
    ("rolling_disk", "rods_in_space"),
    ("geared_pendulums", "screw_press"),
    ("two_four_bars", "slider_crank"),
    ("slider_crank", "two_four_bars"),
    ("orthogonal_linkage", "sarrus_linkage"),
    ("bennett_linkage", "bennett_linkage"),
]


@pytest.mark.parametrize(("big", "small"), PAIRS)
def test_scenes_of_different_size_in_one_system_move_as_each_alone(big: str, small: str) -> None:
    one, other = SCENES[big](Units()), SCENES[small](SMALL)
    scene = ac.System()
    scene.big, scene.small = one.scene, other.scene
    model = ac.build(scene)
    end = min(one.end, other.end)
    run = model.simulate(end, {**one.start, **other.start}, rtol=RTOL, samples=5, progress=False)
    freedoms = 0
    for similar, make, of in ((one, SCENES[big], Units()), (other, SCENES[small], SMALL)):
        alone = make(of)
        apart = ac.build(alone.scene)
        freedoms += apart.degrees_of_freedom
        expected = alone.numbers(apart.simulate(end, alone.start, rtol=RTOL, samples=5, progress=False))
        assert np.max(np.abs(similar.numbers(run) - expected)) < 1e2 * similar.growth * RTOL
    assert model.degrees_of_freedom == freedoms


@pytest.mark.parametrize("name", ["slider_crank", "bennett_linkage", "planar_linkage"])
def test_a_slide_beside_a_loop_decides_nothing_about_its_start_however_fast_it_is(name: str) -> None:
    """By the same bits: a speed in a small unit of length is no large rate."""
    found: list[np.ndarray] = []
    for length in (1.0, 4.0**12):
        loop, scene = SCENES[name](Units(length)), ac.System()
        scene.loop, scene.rail, scene.block = loop.scene, Prismatic("x"), RigidBody(1.0, (1.0, 1.0, 1.0))
        scene.connect(loop.scene.world.frame, scene.rail.frame_a)
        scene.connect(scene.rail.frame_b, scene.block.frame)
        wishes = {key: ac.near(value) for key, value in loop.start.items() if not isinstance(value, ac.near)}
        model = ac.build(scene)
        states = zip(model.state_names, model.initial_state({**wishes, scene.rail.v: ac.near(0.7 * length)}).x, strict=True)
        found.append(np.array([np.frexp(value)[0] for state, value in states if not state.startswith("rail")]))
    assert np.array_equal(*found)


CRITICAL = {
    "motor_drive": Units(time=4.0),
    "controlled_arm": Units(time=4.0**7),
    "planetary_drive": Units(mass=4.0**7),
    "rolling_ball_in_a_plate": Units(mass=4.0**-11),
}
"""Units in which pivots of implicit steps and of scalar equations, and what stands in for inertia, would be other ones if sizes were compared as they are."""


@pytest.mark.parametrize("name", CRITICAL)
def test_pivots_are_the_same_in_any_units(name: str) -> None:
    assert np.array_equal(_moved(name, CRITICAL[name])[2], original(name)[2])
