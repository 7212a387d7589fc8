"""What prescribed motions ask of contacts and of friction, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import acausal as ac
from acausal.analysis.inverse_dynamics import InverseDynamics
from acausal.errors import MotionError, OptionError
from components import (
    Brake,
    Coulomb,
    Force,
    ForceSource,
    JointFriction,
    Particle,
    PointOnPlane,
    Prismatic,
    Revolute,
    RigidBody,
    TorqueSource,
    World,
)
from tests.pairings import each_value
from tests.rough import dragged, thrown

TIMES = np.linspace(0.0, 2.0, 9)


def carried(size: float, mu: float, order: int = 1) -> ac.System:
    """A crate on a wagon, which it may tip on: on two feet, a rough one behind, a smooth one in front."""
    scene = ac.System()
    scene.world, scene.rail = World(gravity=(0, 0, -9.81 * size)), Prismatic("x")
    scene.wagon = RigidBody.box(100.0, (2 * size, size, 0.2 * size))
    scene.crate = RigidBody.box(10.0, (0.4 * size, 0.4 * size, 0.6 * size))
    scene.x, scene.z, scene.turn = Prismatic("x"), Prismatic("z"), Revolute("y")
    feet = {"behind": PointOnPlane(unilateral=True, friction=Coulomb(mu)), "front": PointOnPlane(unilateral=True)}
    for name in [*feet][::order]:
        setattr(scene, name, feet[name])
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.wagon.frame)
    scene.connect(scene.world.frame, scene.x.frame_a)
    scene.connect(scene.x.frame_b, scene.z.frame_a)
    scene.connect(scene.z.frame_b, scene.turn.frame_a)
    scene.connect(scene.turn.frame_b, scene.crate.frame)
    for name, x in (("behind", -0.2), ("front", 0.2)):
        scene.connect(scene.wagon.at((0, 0, 0.1 * size)), feet[name].frame_a)
        scene.connect(scene.crate.at((x * size, 0, -0.3 * size)), feet[name].frame_b)
    return scene


def hurried(size: float, mu: float, order: int = 1) -> tuple[ac.System, InverseDynamics]:
    """The wagon gains speed, more and more, up to 3.6 of the size a second squared."""
    scene = carried(size, mu, order)
    found = ac.build(scene).inverse_dynamics(
        TIMES, {scene.rail.q: 0.3 * size * ac.time**3}, [scene.rail], {scene.z.q: 0.4 * size}
    )
    return scene, found


@each_value(("order", [1, -1]), ("size", [1e-6, 1.0, 1e4]))
def test_crate_on_a_wagon_needs_the_friction_that_carries_it_along(size: float, order: int) -> None:
    scene, found = hurried(size, 0.5, order)
    a = 1.8 * TIMES
    behind, front = 5 * (9.81 + 1.5 * a), 5 * (9.81 - 1.5 * a)  # of 10 kg, the middle is 0.3 high and 0.2 from each foot
    push, rub = found.demands["behind.push"], found.demands["behind.drag"]
    assert push.force[:, 0] == pytest.approx(behind * size, rel=1e-11)
    assert found.demands["front"].margin == pytest.approx(front * size, rel=1e-10)
    assert rub.word == "sticks" and rub.share == pytest.approx(10 * a / (0.5 * behind), abs=1e-11)
    assert all(demand.lasts for demand in found.demands.values())
    assert found.force(scene.rail) == pytest.approx(110 * a * size, rel=1e-11, abs=1e-11 * size)
    assert "needs 94.67 % of its limit at t = 2 s" in str(found)


def test_crate_that_would_slip_or_tip_is_told() -> None:
    _, slips = hurried(1.0, 0.4)
    rub = slips.demands["behind.drag"]
    assert not rub.lasts and "118.3 % of its limit at t = 2 s: it would slip" in str(rub)
    scene = carried(1.0, 5.0)
    tips = ac.build(scene).inverse_dynamics([0.0, 1.0], {scene.rail.q: 4.0 * ac.time**2}, [scene.rail], {scene.z.q: 0.4})
    front = tips.demands["front"]
    assert not front.lasts and "it would have to pull with 10.95" in str(front)


def test_what_a_motion_begins_with_is_what_a_simulation_with_these_forces_does() -> None:
    _, found = hurried(1.0, 0.5)
    run = ac.build(carried_by_force()).simulate(2.0, {"z.q": 0.4}, rtol=1e-12, samples=9)
    assert run["x.q"] == pytest.approx(0.3 * TIMES**3, abs=1e-10)
    assert run["rail.q"] == pytest.approx(found.whole[0], abs=1e-10)


def carried_by_force() -> ac.System:
    """The same, driven by the force that was found."""
    scene = carried(1.0, 0.5)
    scene.drive = Force((198.0 * ac.time, 0, 0))
    scene.connect(scene.wagon.frame, scene.drive.point)
    return scene


def test_what_a_contact_holds_may_be_prescribed_too() -> None:
    scene = dragged()
    found = ac.build(scene).inverse_dynamics(TIMES, {scene.x.q: 0.1, scene.z.q: 0.05}, [scene.x, scene.z])
    assert found.forces == pytest.approx(0, abs=1e-12)  # the least
    assert found.demands["ground.push"].force == pytest.approx(1.5 * 9.81)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_block_that_is_dragged_slides_against_its_friction(way: float) -> None:
    scene = dragged(0.3)
    found = ac.build(scene).inverse_dynamics(TIMES, {scene.x.q: way * (0.5 * ac.time + ac.time**2)}, [scene.x], {scene.z.q: 0.05})
    assert found.force(scene.x) == pytest.approx(way * 1.5 * (2.0 + 0.3 * 9.81), rel=1e-12)
    rub = found.demands["ground.drag"]
    assert rub.word == "slides" and rub.lasts and rub.share is None and "slides" in str(rub)


def test_what_is_lifted_is_open_and_told_where_it_would_pass() -> None:
    scene = dragged()
    model = ac.build(scene)
    z = 0.05 + 0.3 * ac.time - 0.2 * ac.time**2
    found = model.inverse_dynamics(TIMES, {scene.x.q: 0.1, scene.z.q: z}, [scene.x, scene.z], {scene.z.v: 0.3})
    push = found.demands["ground.push"]
    assert push.word == "open" and not push.lasts and "overlaps by 0.2 at t = 2 s" in str(push)
    assert found.force(scene.z) == pytest.approx(1.5 * (9.81 - 0.4), rel=1e-11)


def test_motions_that_contradict_what_is_closed_are_refused() -> None:
    scene = dragged()
    model, unknowns = ac.build(scene), [scene.x, scene.z]
    with pytest.raises(
        MotionError, match=r"mode of the start is kept \(ground.push closed, ground.drag sticks\).*begin a little later"
    ):
        model.inverse_dynamics(TIMES, {scene.x.q: 0.1, scene.z.q: 0.05 + ac.time**2}, unknowns)
    with pytest.raises(MotionError, match="closed, or sticks, from the start on"):
        model.inverse_dynamics(TIMES, {scene.x.q: 0.1, scene.z.q: 0.05 + ac.time**4}, unknowns)


def test_start_that_strikes_is_refused() -> None:
    scene = thrown(0.5, 0.3)
    with pytest.raises(OptionError, match="closes with speed"):
        ac.build(scene).inverse_dynamics(
            TIMES, {scene.rod.tip.position[2]: -ac.time}, [scene.rod.tip.position[2]], {scene.rod.tip.position: (0, 0, 0)}
        )


@pytest.mark.parametrize("legs", [2, 3, 5])
def test_box_on_many_feet_needs_of_all_together_what_one_would(legs: int) -> None:
    scene = ac.System()
    scene.world, scene.rail, scene.wagon = World(), Prismatic("x"), RigidBody.box(3.0, (2.0, 1.0, 0.2))
    scene.box, scene.feet = (
        RigidBody.box(2.0, (0.4, 0.4, 0.2)),
        [PointOnPlane(unilateral=True, friction=Coulomb(0.6)) for _ in range(2 * legs)],
    )
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.wagon.frame)
    for k, foot in enumerate(scene.feet):
        scene.connect(scene.wagon.at((0, 0, 0.1)), foot.frame_a)
        scene.connect(scene.box.at((0.2 * np.cos(np.pi * k / legs), 0.2 * np.sin(np.pi * k / legs), -0.1)), foot.frame_b)
    found = ac.build(scene).inverse_dynamics(
        [0.0, 1.0], {scene.rail.q: 0.5 * ac.time**2}, [scene.rail], {scene.box.frame.position: (0, 0, 0.2)}
    )
    pushes = sum(d.force[:, 0] for d in found.demands.values() if d.word == "closed")
    rubs = sum(d.force for d in found.demands.values() if d.word == "sticks")
    assert pushes == pytest.approx(2 * 9.81, rel=1e-9)
    assert np.linalg.norm(rubs, axis=1) == pytest.approx(2.0, rel=1e-9)
    assert found.force(scene.rail) == pytest.approx(5.0, rel=1e-9)
    assert all(demand.shared for demand in found.demands.values())


THERE_AND_BACK = np.linspace(0.0, 4.0, 17)


@each_value(("size", [1e-3, 1.0, 1e4]), ("part", ["slide", "hinge", "plane"]))
def test_friction_acts_against_a_slip_that_is_prescribed_whichever_way_it_goes(part: str, size: float) -> None:
    """From rest to rest, there and back again and again, x = (1 - cos(pi t)) / 2: what it takes besides inertia and weight is the limit along x'; where it stands, along the way that it went."""
    t, scene = THERE_AND_BACK, ac.System()
    x, v, a = 0.5 - 0.5 * np.cos(np.pi * t), np.sin(np.pi * t), np.pi**2 / 2 * np.cos(np.pi * t)
    way = np.where(t == 0, 1.0, np.where(np.abs(v) < 1e-9, np.sign(np.sin(np.pi * (t - 0.1))), np.sign(v)))
    course = size * (0.5 - 0.5 * np.cos(np.pi * ac.time))
    scene.world, scene.one, scene.other = World((0, 0, -9.81 * size)), ac.Input("N"), ac.Input("N")
    if part == "plane":
        scene.block, scene.floor = Particle(2.0), PointOnPlane(unilateral=True, friction=Coulomb(0.4))
        scene.push = Force((scene.one, scene.other, 0))
        scene.connect(scene.world.frame, scene.floor.frame_a)
        scene.connect(scene.floor.frame_b, scene.block.point, scene.push.point)
        at = scene.block.point.position
        motions, forces = {at[0]: 3 * course, at[1]: -4 * course}, (scene.one, scene.other)
        wanted = [2 * 9.81 * 0.4 * way * k / 5 + 2 * a * k for k in (3, -4)]
    elif part == "slide":
        scene.slide, scene.block, scene.push = Prismatic("x"), RigidBody(2.0, inertia=(size**2,) * 3), ForceSource(scene.one)
        scene.rub = JointFriction(scene.slide, Coulomb(0.4))
        scene.connect(scene.world.at((0, 0, 0), rotation=("y", -0.3)), scene.slide.frame_a)
        scene.connect(scene.slide.frame_b, scene.block.frame)
        scene.connect(scene.slide.flange, scene.push.flange)
        motions, forces = {scene.slide.q: course}, (scene.one,)
        wanted = [2 * a + 2 * 9.81 * (np.sin(0.3) + 0.4 * np.cos(0.3) * way)]
    else:
        scene.hinge, scene.rod, scene.motor = Revolute("y"), RigidBody.rod(2.0, (0, 0, -size)), TorqueSource(size * scene.one)
        scene.brake = Brake(scene.hinge.flange, 3.0 * size**2)
        scene.connect(scene.world.frame, scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.rod.frame)
        scene.connect(scene.hinge.flange, scene.motor.flange)
        motions, forces = {scene.hinge.q: course / size}, (scene.one,)
        wanted = [2 / 3 * a + 9.81 * np.sin(x) + 3 * way]
    found = ac.build(scene).inverse_dynamics(t, motions, forces)
    for force, one in zip(forces, wanted, strict=True):
        assert found[force] == pytest.approx(one * size, rel=1e-10, abs=1e-9 * size)
    assert found.demands[{"plane": "floor.drag", "slide": "rub", "hinge": "brake"}[part]].word == "slides"
