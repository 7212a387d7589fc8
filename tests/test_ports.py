"""Connectors of systems: what is read there, what starts there, and what laws read there."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import acausal as ac
from acausal.errors import UnconnectedError, UnknownVariableError
from components import (
    Contact,
    Coulomb,
    Gear,
    Hard,
    Inertia,
    Plane,
    Revolute,
    RigidBody,
    RotationalGround,
    RotationalSpring,
    Sphere,
    TorqueSource,
    World,
)

EXACT = {"rtol": 1e-12}
G = 9.81


class Arm(ac.System):
    """A thin rod on a hinge, whose shaft comes out at `axis`; at its tip one may hold it in two places."""

    base = ac.Frame.port()
    tip = ac.Frame.port()
    mark = ac.Frame.port()
    lone = ac.Frame.port()
    axis = ac.Rotational.port()

    def __init__(self, mass: float = 1.0, axis: str = "y") -> None:
        self.hinge, self.rod = Revolute(axis), RigidBody.rod(mass, (0.0, 0.0, -0.7))
        self.connect(self.base, self.hinge.frame_a)
        self.connect(self.hinge.frame_b, self.rod.frame)
        self.connect(self.rod.tip, self.tip, self.mark)
        self.connect(self.axis, self.hinge.flange)


class Pair(ac.System):
    """Two arms: a system of systems."""

    base = ac.Frame.port()
    tip = ac.Frame.port()

    def __init__(self) -> None:
        self.near, self.far = Arm(2.0), Arm(0.5, "x")
        self.connect(self.base, self.near.base)
        self.connect(self.near.tip, self.far.base)
        self.connect(self.far.tip, self.tip)


class Arms(ac.System):
    """Three arms in a row."""

    def __init__(self) -> None:
        self.world, self.pair, self.last = World((0, 0, -G)), Pair(), Arm(0.3)
        self.connect(self.world.frame, self.pair.base)
        self.connect(self.last.base, self.pair.tip)


class Drive(ac.System):
    """A rotor behind a gear."""

    flange = ac.Rotational.port()

    def __init__(self) -> None:
        self.rotor, self.gear = Inertia(0.1), Gear(3.0)
        self.connect(self.rotor.flange_b, self.gear.flange_a)
        self.connect(self.gear.flange_b, self.flange)


class Between(ac.System):
    """Connectors and nothing behind them."""

    base = ac.Frame.port()
    tip = ac.Frame.port()
    axis = ac.Rotational.port()


START = {"pair.near.hinge.q": 0.8, "pair.far.hinge.q": 0.5, "last.hinge.v": -2.0}


def _energy(run: ac.Trajectory, arm: Arm, mass: float) -> np.ndarray:
    """Of a thin rod, by its ends."""
    a, b = run[arm.rod.frame.velocity], run[arm.rod.tip.velocity]
    height = run[arm.rod.frame.position][:, 2] + run[arm.rod.tip.position][:, 2]
    return mass / 6 * np.sum(a * a + a * b + b * b, axis=1) + mass * G * height / 2


def test_what_flows_in_at_connectors_is_what_a_system_gains() -> None:
    """Powers at all connectors of a system are the rate of its energy, by differences."""
    scene = Arms()
    run = ac.build(scene).simulate(1.0, START, **EXACT)
    t, h = 0.5, 1e-3
    around, now = run.at([t - 2 * h, t - h, t + h, t + 2 * h]), run.at(t)
    near, far = (scene.pair.near, 2.0), (scene.pair.far, 0.5)
    for system, arms in ((scene.pair, (near, far)), (scene.pair.far, (far,)), (scene.last, ((scene.last, 0.3),))):
        rate = sum(_energy(around, *arm) @ [1, -8, 8, -1] for arm in arms) / (12 * h)
        ends = (system.base, system.tip)
        power = sum(np.sum(now[c.force] * now[c.velocity] + now[c.torque] * now[c.angular_velocity]) for c in ends)
        assert abs(power - rate) < 1e-9 * abs(rate), type(system)
    assert not now[scene.last.tip.force].any()  # nothing touches there
    assert np.array_equal(now["pair.tip.rotation"], now[scene.pair.far.rod.tip.rotation])


def test_scalar_connectors_of_systems_are_those_of_parts() -> None:
    scene = ac.System()
    scene.drive, scene.spring, scene.ground = Drive(), RotationalSpring(5.0), RotationalGround()
    scene.connect(scene.drive.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.ground.flange)
    model = pickle.loads(pickle.dumps(ac.build(scene)))
    run = model.simulate(2.0, {"drive.flange.phi": 1.0}, **EXACT)
    phi = np.cos(np.sqrt(5.0 / 0.9) * run.t)  # 0.1 * 3^2
    assert np.max(np.abs(run["drive.flange.phi"] - phi)) < 1e-11
    assert np.max(np.abs(run["drive.flange.tau"] + 5.0 * phi)) < 5e-11


def _sprung(through_ports: bool) -> tuple[Arms, ac.Trajectory]:
    """Arms with a spring at a joint that another one moves, a start and an event, which read connectors of systems or of parts."""
    scene = Arms()
    near, last = scene.pair.near, scene.last
    axes = [near.axis, last.axis] if through_ports else [near.hinge.flange, last.hinge.flange]
    scene.motor = TorqueSource(-3.0 * axes[0].phi - 0.2 * ac.der(axes[0].phi))
    scene.connect(scene.motor.flange, last.axis)
    end = scene.pair.tip if through_ports else scene.pair.far.rod.tip
    model = ac.build(scene)
    run = model.simulate(
        1.0, {near.hinge.q: 0.4, end.velocity[1]: 0.7}, events=[ac.when(end.position[0] + 0.1, "rising")], **EXACT
    )
    return scene, run


def test_laws_and_starts_read_what_systems_show() -> None:
    """Also where no shaft is connected."""
    (scene, run), (_, other) = _sprung(True), _sprung(False)
    assert np.array_equal(run.x, other.x)
    assert [e.time for e in run.events] == [e.time for e in other.events] != []
    near, last, end = scene.pair.near, scene.last, scene.pair.tip
    assert abs(run.at(0.0)[end.velocity][0, 1] - 0.7) < 1e-12
    twist = run[scene.motor.flange.tau] + (-3.0 * run[near.hinge.q] - 0.2 * run[near.hinge.v])
    assert np.max(np.abs(twist)) < 1e-13
    assert np.max(np.abs(run[near.axis.phi] - run[near.hinge.q])) == 0 and not run[near.axis.tau].any()
    assert np.max(np.abs(run[last.axis.tau] + run[scene.motor.flange.tau])) < 1e-14


def test_a_contact_tells_what_flows_in_at_its_frames() -> None:
    scene = ac.System()
    scene.world, scene.ball = World((0, 0, -G)), RigidBody.ball(2.0, 0.1)
    scene.contact = Contact(Sphere(0.1), Plane(), Hard(0.5, Coulomb(0.3)))
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    frame = scene.ball.frame
    run = ac.build(scene).simulate(0.08, {frame.position: (0, 0, 0.1), frame.velocity: (1, 0, 0)}, samples=3)
    on_ball = -run[scene.contact.frame_b.force]
    assert np.max(np.abs(on_ball - 2.0 * G * np.array([-0.3, 0, 1]))) < 1e-12 * G
    assert np.max(np.abs(run[scene.contact.frame_a.force] - on_ball)) < 1e-12 * G


def test_what_is_not_known_at_a_connector_of_a_system_is_said() -> None:
    scene = Arms()
    scene.load, scene.other = RigidBody.ball(0.1, 0.05), RigidBody.ball(0.2, 0.05)
    scene.connect(scene.last.tip, scene.load.frame)
    scene.connect(scene.last.mark, scene.other.frame)
    run = ac.build(scene).simulate(0.1, START)
    with pytest.raises(UnknownVariableError, match=r"last\.lone touches no part"):
        run[scene.last.lone.position]
    with pytest.raises(UnknownVariableError, match=r"last\.tip and last\.mark are one place"):
        run[scene.last.tip.force]
    assert run[scene.last.mark.position].shape == (501, 3)


def test_parts_connected_to_where_nothing_is_inside_are_told_by_the_way() -> None:
    """A motor on a shaft that its system does not connect, an arm behind a system without parts."""
    arms = Arms()
    arms.between, arms.lost = Between(), Arm()
    arms.connect(arms.pair.tip, arms.between.base)
    arms.connect(arms.between.tip, arms.lost.base)
    driven = Arms()
    driven.drive, driven.between = TorqueSource(1.0), Between()
    driven.connect(driven.drive.flange, driven.between.axis)
    ways = (
        (arms, r"lost\.hinge\.frame_a .* no other part: at between\.tip, lost\.base nothing"),
        (driven, r"at between\.axis nothing"),
    )
    for scene, words in ways:
        with pytest.raises(UnconnectedError, match=words):
            ac.build(scene)
