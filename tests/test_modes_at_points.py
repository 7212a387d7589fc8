"""Questions about a point of a scene with parts that open, stick and strike: linear systems, equilibria, reports."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

import acausal as ac
from acausal.errors import EquilibriumError, OptionError
from acausal.language.mode_laws import ModeLaw
from components import (
    Coulomb,
    JointFriction,
    Particle,
    PointOnPlane,
    Prismatic,
    Relay,
    RigidBody,
    SlidingMass,
    TranslationalGround,
    TranslationalSpring,
    TranslationSensor,
    World,
)
from tests.pairings import each_value
from tests.rough import bouncing, dragged, rubbing


@pytest.mark.parametrize(
    ("height", "states", "mode"), [(1.0, ("mass.s", "mass.v"), "floor.push open"), (0.0, (), "floor.push closed")]
)
def test_linear_system_is_that_of_the_mode_at_the_point(height: float, states: tuple[str, ...], mode: str) -> None:
    scene = bouncing(0.5)
    found = ac.build(scene).linearize({scene.mass.s: height, scene.mass.v: 0.0})
    assert (found.states, found.inputs, found.mode) == (states, (), mode)


def test_linear_system_of_a_block_that_slides_swings_and_of_one_that_sticks_does_not() -> None:
    scene = rubbing(1.0, 2.0, 3.0, stiffness=4.0)
    model = ac.build(scene)
    slides = model.linearize({scene.mass.s: 0.2, scene.mass.v: 1.0})
    assert np.linalg.eigvals(slides.A) == pytest.approx([2j, -2j]) and slides.mode == "rub.drag slides +"
    sticks = model.linearize({scene.mass.s: 0.2, scene.mass.v: 0.0})
    assert (sticks.states, sticks.mode) == (("mass.s",), "rub.drag sticks") and sticks.A == 0


def test_linear_system_where_something_strikes_is_refused() -> None:
    scene = bouncing(0.5)
    with pytest.raises(OptionError, match="linearize: floor closes with speed at this point"):
        ac.build(scene).linearize({scene.mass.s: 0.0, scene.mass.v: -1.0})
    with pytest.raises(OptionError, match=r"The gap of floor \(.*\) is negative"):
        ac.build(scene).linearize({scene.mass.s: -1.0, scene.mass.v: 0.0})


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e4])
def test_what_falls_comes_to_rest_on_the_ground(size: float) -> None:
    scene = bouncing(0.5, gravity=9.81 * size)
    found = ac.build(scene).equilibrium({scene.mass.s: size})
    assert found.point.x == pytest.approx([0, 0], abs=1e-12 * size)
    assert "floor.push closed" in str(found)


@pytest.mark.parametrize(("start", "rest"), [(0.5, 0.5), (-0.74, -0.74), (1.5, 0.5), (-3.0, -0.5)])
def test_block_rests_where_friction_holds_it_or_just_holds_it_no_more(start: float, rest: float) -> None:
    scene = rubbing(1.0, 2.0, 3.0, stiffness=4.0)  # holds up to 3 N, and 2 N where it has slid
    assert ac.build(scene).equilibrium({scene.mass.s: start}).point.x == pytest.approx([rest, 0], abs=1e-12)


@each_value(("size", [1e-3, 1.0]), (("start", "rest"), [(0.5, 0.5), (-0.9, -0.9), (3.0, 1.0), (-1.01, -1.0)]))
def test_block_on_a_slide_rests_by_what_that_bears_though_something_is_remembered_too(
    start: float, rest: float, size: float
) -> None:
    """What says in which mode it is has more behind it than that of frictions."""
    m, k, g, mu = 0.5, 20.0, 9.81 * size, 0.3
    scene = ac.System()
    scene.world, scene.slide, scene.block = World((0, 0, -g)), Prismatic("x"), Particle(m)
    scene.rub, scene.wall, scene.spring = JointFriction(scene.slide, Coulomb(mu)), TranslationalGround(), TranslationalSpring(k)
    scene.where, scene.switch = TranslationSensor(), Relay(-size, size)
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.block.point)
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.slide.flange, scene.where.flange)
    scene.connect(scene.where.position, scene.switch.input)
    edge = mu * m * g / k
    found = ac.build(scene).equilibrium({scene.slide.q: start * edge})
    assert found.point.x == pytest.approx([rest * edge, 0], abs=1e-12 * size)


class Pinched(ac.Component):
    """Rubs by the modulus of a force that grows with its place, and turns round at s = `turns`."""

    flange = ac.Translational.port()

    def __init__(self, slope: float, turns: float) -> None:
        self.drag, self.slope, self.turns = ac.Reaction("N"), slope, turns

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.flange.f, -1.0 * self.drag)

    def laws(self) -> Iterable[ModeLaw]:
        limit = ac.Magnitude(self.slope * (self.flange.s - self.turns))
        yield ac.DryFriction(self.drag, ac.der(self.flange.s), 1.0 * limit, 1.0 * limit)


@pytest.mark.parametrize(("start", "side"), [(3.0, 1), (1.0, 1), (0.4, 1), (-2.5, -1), (-5.0, -1)])
def test_block_rests_where_what_presses_has_turned_round(start: float, side: int) -> None:
    """k (length - s) = side slope (turns - s)."""
    k, length, slope, turns = 10.0, -2.0, 1.2, 0.5
    scene = ac.System()
    scene.mass, scene.rub, scene.wall, scene.spring = (
        SlidingMass(1.0),
        Pinched(slope, turns),
        TranslationalGround(),
        TranslationalSpring(k, length),
    )
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.mass.flange_a)
    scene.connect(scene.mass.flange_b, scene.rub.flange)
    found = ac.build(scene).equilibrium({scene.mass.s: start})
    assert found.point.x == pytest.approx([(k * length + side * slope * turns) / (k + side * slope), 0], abs=1e-12)


def test_block_on_the_ground_rests_where_it_is_put() -> None:
    scene = dragged()
    found = ac.build(scene).equilibrium({scene.z.q: 0.4, scene.x.q: 0.2})
    assert found.point.x == pytest.approx([0.2, 0.05, 0, 0], abs=1e-12) and found.free == ("x.q",)


@pytest.mark.parametrize("height", [0.0, 0.5, -2.0])
def test_body_on_two_feet_rests_on_a_slope_where_it_stands(height: float) -> None:
    """The mode is that of the place where it is put, velocities alone being taken from it."""
    scene = ac.System()
    scene.world, scene.body = World(gravity=(9.81 * np.sin(0.3), 0, -9.81 * np.cos(0.3))), RigidBody.ball(1.0, 0.1)
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(0.5)) for _ in range(2)]
    for foot, x in zip(scene.feet, (0.0, 0.3), strict=True):
        scene.connect(scene.world.at((0, 0, height)), foot.frame_a)
        scene.connect(foot.frame_b, scene.body.at((x, 0, 0)))
    found = ac.build(scene).equilibrium({scene.body.frame.position: (1, 2, height)})
    assert np.ravel(found[scene.body.frame.position]) == pytest.approx([1, 2, height], abs=1e-12)
    assert np.ravel(found[scene.feet[0].normal_force]) == pytest.approx([9.81 * np.cos(0.3)])


def test_no_equilibrium_is_said_where_nothing_holds() -> None:
    scene = bouncing(0.5, gravity=-9.81)
    with pytest.raises(EquilibriumError):
        ac.build(scene).equilibrium({scene.mass.s: 1.0})


def test_masks_are_no_inputs_of_a_user() -> None:
    scene = dragged()
    model = ac.build(scene)
    assert "0 inputs, 0 parameters, 1 part with modes" in str(model)
    assert "ground                   one-sided, dry friction" in model.report()
    refused = "does not go with parts that open, slip, strike or are let go yet: ground"
    with pytest.raises(OptionError, match=f"inverse_dynamics_function {refused}"):
        model.inverse_dynamics_function([scene.x.q], [scene.x])


def test_a_step_stays_in_the_mode_of_its_masks() -> None:
    scene = dragged()
    model = ac.build(scene)
    run = model.simulate(1e-3, {scene.x.q: 0.2, scene.z.q: 0.05, scene.x.v: 1.0}, rtol=1e-12)
    met = run.solution.modes
    assert met is not None and met.begins.size == 1
    x, residual = model.step("gauss", 8)(0.0, run.solution.x[:, 0], met.masks[:, 0], [], 1e-3)
    assert float(residual) < 1e-9
    assert np.array(x).ravel() == pytest.approx(run.solution.x[:, -1], abs=1e-13)
