"""What a reader sees: lines that print, labels, pictures in notebooks, and where a warning points."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import acausal as ac
from acausal.errors import RoundingWarning
from acausal.start.start_problem import start_problem
from acausal.visual.scene import animation_of
from acausal.visual.shapes import Disk, Torus
from acausal.visual.shapes import Rod as Bar
from components import Particle, Prismatic, Revolute, RigidBody, Rod, World
from tests.scenes import DoublePendulum, FourBar, bennett_linkage
from tests.test_minimal import rolling_ball


def bead() -> ac.System:
    """A bead on two slides, held by a rod without mass."""
    scene = ac.System()
    scene.world, scene.x, scene.z = World(), Prismatic("x"), Prismatic("z")
    scene.bead, scene.rod = Particle(1.0), Rod(1.0)
    scene.connect(scene.world.frame, scene.x.frame_a, scene.rod.frame_a)
    scene.connect(scene.x.frame_b, scene.z.frame_a)
    scene.connect(scene.z.frame_b, scene.bead.point, scene.rod.frame_b)
    return scene


def test_a_model_says_which_rows_are_dropped_and_which_are_used_though_redundant():
    assert "2 constraints (3 redundant rows dropped)" in str(ac.build(FourBar()))
    linkage = str(ac.build(bennett_linkage()))
    assert "5 constraints, 3 of them redundant when assembled" in linkage and "dropped" not in linkage
    assert "no constraints" in str(ac.build(DoublePendulum()))


def test_labels_name_the_part_and_the_unit():
    scene = bead()
    run = ac.build(scene).simulate(0.1, {scene.x.q: 0.6, scene.z.q: 0.8})
    place = scene.bead.point.position
    assert [run.label(e) for e in (scene.x.q, place, place[2])] == [
        "x.q [m]",
        "bead.point.position [m]",
        "bead.point.position[2] [m]",
    ]
    assert run.label(2 * scene.x.q + scene.z.q) == "((2.*x.q)+z.q)"


def test_notebooks_show_runs_and_figures():
    scene = DoublePendulum()
    run = ac.build(scene).simulate(0.1, {scene.shoulder.q: 0.6})
    assert "SUCCESS" in repr(run) and run._repr_html_().startswith("<pre>DoublePendulum")
    assert run.plot(scene.shoulder.q)._repr_png_().startswith(b"\x89PNG")


def test_a_scene_without_a_name_is_called_by_its_bodies():
    scene = bead()
    run = ac.build(scene).simulate(0.1, {scene.x.q: 0.6, scene.z.q: 0.8})
    assert animation_of(run).title == "bead, rod"
    assert run.plot(scene.x.q).axes[0].get_title(loc="left") == ""


def test_a_rod_without_mass_is_drawn_between_its_ends():
    scene = bead()
    run = ac.build(scene).simulate(1.0, {scene.x.q: 0.6, scene.z.q: -0.8})
    seen = animation_of(run)
    rod = next(body for body in seen.bodies if body.name == "rod")
    (bar,) = rod.shapes
    assert isinstance(bar, Bar)
    w, x, y, z = rod.quaternions.T
    tip = rod.positions + bar.end[2] * np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x**2 + y**2)])
    np.testing.assert_allclose(tip, run.at(seen.times)[scene.bead.point.position], atol=1e-9)


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e5])
def test_arms_lead_to_joints_outside_of_shapes_and_to_none_within(size):
    """A pendulum's ball hangs on one from its centre, a link of three joints has one from its bar, a box that is hinged at its edge none."""
    scene = ac.System()
    scene.world, scene.hinges = World(), [Revolute("y") for _ in range(3)]
    scene.ball = RigidBody.ball(1.0, 0.1 * size)
    scene.bar = RigidBody.rod(1.0, (2.0 * size, 0, 0), radius=0.02 * size)
    scene.box = RigidBody.box(1.0, (0.4 * size, 0.2 * size, 0.3 * size))
    scene.connect(scene.world.frame, scene.hinges[0].frame_a)
    scene.connect(scene.hinges[0].frame_b, scene.bar.frame)
    scene.connect(scene.bar.at((0.5 * size, 0, 0.7 * size)), scene.hinges[1].frame_a)
    scene.connect(scene.hinges[1].frame_b, scene.ball.at((0, 0, size)))
    scene.connect(scene.bar.tip, scene.hinges[2].frame_a)
    scene.connect(scene.hinges[2].frame_b, scene.box.at((0.2 * size, 0.05 * size, -0.15 * size)))
    drawn = {body.name: body.shapes for body in animation_of(ac.build(scene).simulate(0.01)).bodies}
    for name, ends in (("ball", ((0, 0, 0), (0, 0, size))), ("bar", ((0.5 * size, 0, 0), (0.5 * size, 0, 0.7 * size)))):
        [_, arm] = drawn[name]
        assert isinstance(arm, Bar)
        np.testing.assert_allclose((arm.start, arm.end), ends, atol=1e-12 * size)
    assert len(drawn["box"]) == 1


def test_a_hoop_is_a_ring_and_a_disk_is_not():
    hoop, disk = RigidBody.disk(1.0, 0.3, "y", hoop=True), RigidBody.disk(1.0, 0.3, "y")
    assert isinstance(hoop.shapes()[0], Torus) and isinstance(disk.shapes()[0], Disk)
    assert hoop.shapes()[0].radius + hoop.shapes()[0].tube == pytest.approx(0.3)


def test_warnings_point_at_the_line_that_called():
    scene = DoublePendulum()
    model = ac.build(scene)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.simulate(0.1, rtol=1e-18)
    (found,) = [w for w in caught if w.category is RoundingWarning]
    assert found.filename == __file__


def test_a_start_that_is_written_anew_finds_the_search_made_for_it():
    scene = rolling_ball()
    outputs = ac.build(scene).functions.outputs
    R, w = (lambda: scene.ball.frame.rotation), (lambda: scene.ball.frame.angular_velocity)
    first = start_problem(outputs, {R()[:, 0]: (1, 0, 0), w(): (0, 0, 3)})
    assert start_problem(outputs, {R()[:, 0]: (0, 1, 0), w(): (0, 0, 2)}) is first
    others = [{R()[:, 1]: (1, 0, 0), w(): (0, 0, 3)}, {R()[0, :]: (1, 0, 0), w(): (0, 0, 3)}, {2 * R()[:, 0]: (2, 0, 0), w(): 0}]
    problems = [start_problem(outputs, other) for other in others]
    assert len({id(p) for p in (first, *problems)}) == 4


def test_what_is_handed_out_says_what_it_is() -> None:
    scene = DoublePendulum()
    model = ac.build(scene)
    run = model.sensitivities([0.0, 0.1], [scene.elbow.q], {scene.elbow.q: 1.0})
    assert repr(run) == "<Sensitivities of DoublePendulum: 4 states at 2 times by elbow.q>"
    assert repr(model.functions) == "<Functions of DoublePendulum: 4 states, 0 inputs, 0 parameters>"
