"""Unit quaternions among coordinates: found in any joint that has one, and nothing else taken for one."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import acausal as ac
from acausal.charts.rodrigues import ChartCoordinates
from acausal.parts.joint_coordinates import Coordinate
from acausal.parts.unit_quaternions import unit_quaternions
from components import RigidBody, RollingBall, Spherical, World

q = ca.SX.sym("q", 6)
a, b, c, d = (q[i] for i in range(1, 5))
UNIT = ca.sumsqr(q[1:5]) - 1


@pytest.mark.parametrize("factor", [0.5, 1.0, -3.0])
def test_a_unit_quaternion_is_found_whatever_its_row_is_multiplied_by(factor: float):
    assert unit_quaternions(ca.vertcat(q[0] - q[5], factor * UNIT), q) == {1: 1}


@pytest.mark.parametrize(
    "row",
    [
        UNIT - 1,  # of length sqrt(2)
        UNIT + a,  # about another centre
        a**2 + b**2 + c**2 + 2 * d**2 - 1,
        a**2 + b**2 + c**2 + q[5] ** 2 - 1,  # no neighbours
        a**2 + b**2 + c**2 - 1,
        ca.sumsqr(q[1:5]) ** 2 - 1,
        UNIT + ca.SX.sym("t"),
    ],
)
def test_what_only_resembles_one_is_none(row: ca.SX):
    assert unit_quaternions(row, q) == {}


def test_joints_with_quaternions_are_seen_by_what_they_say():
    scene = ac.System()
    scene.world, scene.ball, scene.contact = World(), RigidBody.ball(1.0, 0.1), RollingBall(0.1)
    scene.joint, scene.arm = Spherical(), RigidBody.box(1.0, (0.3, 0.2, 0.1))
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    scene.connect(scene.ball.at((0, 0, 0.2)), scene.joint.frame_a)
    scene.connect(scene.joint.frame_b, scene.arm.frame)
    system = ac.build(scene).system
    found = unit_quaternions(system.position_invariants, system.x[: system.nq, :])
    joints = {item.edge.name: item.q.start for item in system.tree_joints}
    assert sorted(found.values()) == sorted([joints["contact"], joints["joint"]])


def test_places_and_names_of_coordinates_with_quaternions_between_others():
    coordinates = ChartCoordinates(11, (1, 6))
    assert coordinates.count == 9
    assert coordinates.places == ((0, 1), (1, 3), (5, 1), (6, 3), (10, 1))
    assert [list(coordinates.entries(i)) for i in (0, 1, 4, 5, 9, 10)] == [[0], [1, 2, 3], [1, 2, 3], [4], [5, 6, 7], [8]]
    states = ["x.q", *(f"ball.q[{i}]" for i in range(4)), "y.q", *(f"body.q[{i}]" for i in range(5))]
    names = coordinates.names(states, "rotation")
    assert names == (
        "x.q", "ball.rotation[0]", "ball.rotation[1]", "ball.rotation[2]", "y.q", "body.rotation[0]", "body.rotation[1]", "body.rotation[2]", "body.q[4]",
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(6))
def test_attitudes_are_as_far_apart_as_the_turn_between_them_whatever_the_signs_and_lengths(seed: int):
    g = np.random.default_rng(seed)
    first, second = Rotation.random(2, random_state=seed)
    both = [np.concatenate([[5.0], g.choice([-1, 1]) * g.uniform(0.5, 2) * one.as_quat()]) for one in (first, second)]
    coordinate = Coordinate("ball.q", slice(1, 5), "", turns=True, periodic=False)
    assert coordinate.distance(both[0], both[1]) == pytest.approx((first.inv() * second).magnitude(), abs=1e-12)
    assert coordinate.distance(both[0], -both[0]) == pytest.approx(0.0, abs=1e-12)
