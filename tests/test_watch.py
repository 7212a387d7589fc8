"""A run is looked at when it has ended: what is wrong is told, and what is right is left alone, in any unit and at any tolerance."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Sequence
from typing import Any, final

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

import acausal as ac
from acausal.errors import AccuracyWarning
from acausal.parts.force import AbstractForce, AbstractLineForce, Action
from acausal.parts.placement import Placement
from acausal.parts.pose import symbolic
from acausal.simulate import watch
from acausal.simulate.trajectory import Trajectory
from components import (
    CamFollower,
    Cylindrical,
    Damper,
    Diode,
    Free,
    Ground,
    Inertia,
    Particle,
    Prismatic,
    Resistor,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    Screw,
    Spherical,
    Spring,
    TorqueSource,
    Universal,
    VoltageSource,
    World,
)
from tests.scenes import bennett_linkage, rotation
from tests.test_singular_loops import FourBars

G = 9.81


@final
class Stiffer(AbstractLineForce):
    """A spring that is harder beyond a length, and whose potential energy does not know; right while `factor` is 0, as at build."""

    def __init__(self, rest: float) -> None:
        self.rest, self.factor = rest, ac.Parameter(0.0, "1")

    def tension(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        more = ca.fmax(length - 2 * self.rest, 0)
        return 40 * (length - self.rest) + self.factor.sx * 40 * more

    def potential(self, length: ca.SX) -> ca.SX:
        return 20 * (length - self.rest) ** 2


@final
class Shifted(AbstractForce):
    """A constant force until a time, and none afterwards; the potential energy jumps with it."""

    point = ac.Point.port()

    def __init__(self, force: float, until: float) -> None:
        self.force, self.until = force, until

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        push = ca.if_else(placement.t < self.until, self.force, 0.0)
        return (Action(self.point, symbolic(placement.pose(self.point).rotation).T @ ca.vertcat(push, 0, 0), ca.SX.zeros(3)),)

    def potential_energy(self, placement: Placement) -> ca.SX:
        return -ca.if_else(placement.t < self.until, self.force, 0.0) * symbolic(placement.pose(self.point).position)[0]

    def power_loss(self, placement: Placement) -> ca.SX:
        return ca.SX(0)


def on_a_spring(size: float, *, damped: bool = False) -> tuple[ac.System, dict[ac.Expression, object]]:
    """A particle drawn out to three times the length of a `Stiffer` spring of length `size`, and pushed off to the side."""
    scene = ac.System()
    scene.world, scene.ball = World((0, 0, -G * size)), Particle(0.5)
    scene.spring = Stiffer(size)
    scene.connect(scene.world.frame, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.ball.point)
    if damped:
        scene.damper = Damper(0.05)
        scene.connect(scene.world.at((0, size, 5 * size)), scene.damper.point_a)
        scene.connect(scene.damper.point_b, scene.ball.point)
    return scene, {scene.ball.point.position: (3 * size, 0, 0), scene.ball.point.velocity: (0, 2 * size, 0)}


def silent(model: ac.Model, *arguments: object, **options: object) -> Trajectory:
    """A run without any warning but those of tolerances that rounding forbids."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", ac.errors.RoundingWarning)
        return model.simulate(*arguments, **options)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("size", [1.0, 1e-9, 1e6])
def test_own_force_with_a_wrong_potential_is_told_by_its_name(size):
    scene, start = on_a_spring(size)
    model = ac.build(scene)
    silent(model, 3.0, start)
    with pytest.warns(AccuracyWarning, match=r"energy balance .* 'spring' \(") as told:
        model.simulate(3.0, start, parameters={scene.spring.factor: 0.2})
    assert told[0].filename == __file__


@pytest.mark.parametrize("size", [1.0, 1e-9, 1e6])
def test_a_tighter_tolerance_forgives_less(size):
    """A ten-millionth of the energy is nothing where a thousandth of that is asked for in a step, and much where a millionth is."""
    scene, start = on_a_spring(size)
    model, wrong = ac.build(scene), {scene.spring.factor: 1e-6}
    part = silent(model, 3.0, start, parameters=wrong, rtol=1e-9).energy_error()
    assert 3e-8 < part < 3e-7
    with pytest.warns(AccuracyWarning, match="energy balance"):
        model.simulate(3.0, start, parameters=wrong, rtol=1e-12)


def test_no_tolerance_and_no_rounding_of_rates_forgives_a_fifth_of_the_energy(monkeypatch):
    """However loose the one is, and however large the other, as where a loop is all but singular."""
    scene, start = on_a_spring(1.0)
    model, rounding = ac.build(scene), vars(watch)["_rounding"]
    with pytest.warns(AccuracyWarning, match="energy balance"):
        model.simulate(3.0, start, parameters={scene.spring.factor: 1.0}, rtol=1e-3)

    def large(*given: object) -> np.ndarray:
        return rounding(*given) * (1e300 if given[-1] else 1.0)

    monkeypatch.setattr(watch, "_rounding", large)
    with pytest.warns(AccuracyWarning, match="energy balance"):
        model.simulate(3.0, start, parameters={scene.spring.factor: 1.0})


def sprung_linkage(name: str) -> tuple[ac.System, dict[ac.Expression, object]]:
    """With a `Stiffer` spring: Bennett's, whose rows depend on one another when assembled; a parallelogram, which passes through singular positions."""
    scene = bennett_linkage() if name == "Bennett" else FourBars((1.0, 1.0), (1.0,))
    scene.spring = Stiffer(0.3)
    if name == "Bennett":
        ends, start = (scene.world.at((3, 0, 0)), scene.links[1].at((0.5, 0.866, 0))), {scene.joints[0].v: 3.0}
    else:
        ends, start = (scene.world.at((0, -1.5, 0)), scene.cranks[0].tip), {scene.feet[0].q: 0.1, scene.feet[0].v: -1.0}
    for point, end in zip((scene.spring.point_a, scene.spring.point_b), ends, strict=True):
        scene.connect(point, end)
    return scene, start


@pytest.mark.parametrize("name", ["Bennett", "parallelogram"])
def test_loops_that_may_lose_energy_are_forgiven_less(name):
    """Half a hundredth of the energy at a tolerance of 1e-5."""
    scene, start = sprung_linkage(name)
    model = ac.build(scene)
    silent(model, 2.0, start, rtol=1e-5)
    with pytest.warns(AccuracyWarning, match="energy balance") as told:
        model.simulate(2.0, start, parameters={scene.spring.factor: 0.01}, rtol=1e-5)
    assert 4e-3 < float(re.search(r"J, (\S+) of", str(told[0].message))[1]) < 8e-3  # type: ignore[index]


def test_own_force_with_a_wrong_potential_is_told_where_energy_is_lost_besides():
    scene, start = on_a_spring(1.0, damped=True)
    model = ac.build(scene)
    silent(model, 3.0, start)
    with pytest.warns(AccuracyWarning, match="'spring'"):
        model.simulate(3.0, start, parameters={scene.spring.factor: 0.2})


def test_the_same_is_off_by_the_same_in_every_unit():
    parts: list[str] = []
    for size in (1.0, 1e-3, 1e3):
        scene, start = on_a_spring(size)
        with pytest.warns(AccuracyWarning) as told:
            ac.build(scene).simulate(3.0, start, parameters={scene.spring.factor: 1.0})
        parts += re.findall(r"J, (\S+) of", str(told[0].message))
    assert len(parts) == 3
    assert len(set(parts)) == 1


@pytest.mark.parametrize("size", [1.0, 1e-9])
def test_energy_that_jumps_is_told_with_its_time(size):
    scene = ac.System()
    scene.world, scene.ball, scene.push = World(None), Particle(1.0), Shifted(size, 0.7)
    scene.connect(scene.push.point, scene.ball.point)
    with pytest.warns(AccuracyWarning, match="in one step: a law or an input may jump") as told:
        ac.build(scene).simulate(2.0, {scene.ball.point.velocity: (size, 0, 0)})
    assert abs(float(re.search(r"t = (\S+) s", str(told[0].message))[1]) - 0.7) < 0.3  # type: ignore[index]


def four_bar(size: float) -> tuple[ac.System, dict[ac.Expression, object]]:
    """Crank, coupler and rocker of lengths 1, 3 and 2 times `size` under similar gravity."""
    scene = ac.System()
    scene.world = World((0, 0, -G * size))
    scene.crank, scene.coupler, scene.rocker = (RigidBody.rod(1.0, (x * size, 0, 0)) for x in (1, 3, 2))
    scene.hinges = [Revolute("y") for _ in range(4)]
    ends = [
        (scene.world.frame, scene.crank.frame), (scene.crank.tip, scene.coupler.frame), (scene.coupler.tip, scene.rocker.tip),
        (scene.world.at((2.8 * size, 0, 0)), scene.rocker.frame),
    ]  # fmt: skip
    for hinge, (one, two) in zip(scene.hinges, ends, strict=True):
        scene.connect(one, hinge.frame_a)
        scene.connect(hinge.frame_b, two)
    return scene, {scene.hinges[0].q: ac.near(-1.0), scene.hinges[0].v: 3.0}


@pytest.mark.parametrize("size", [1.0, 1e-9])
def test_loop_that_opens_is_told(size):
    """Nothing brings the motion back to its loop, and the rates lead away from it by one part in a hundred."""
    scene, start = four_bar(size)
    model = ac.build(scene)
    functions = model.functions
    symbols = [functions.space.arguments[i] for i in range(4)]
    wrong = functions.explicit_dynamics(*symbols) * ca.DM([1.01, *[1.0] * (len(model.state_names) - 1)])
    functions.__dict__["explicit_dynamics"] = ca.Function("wrong", symbols, [wrong])
    functions.__dict__["projection"] = None
    with pytest.warns(AccuracyWarning, match=r"leaves its constraints: the condition between hinges\[0"):
        model.simulate(2.0, start, compiled=False)


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("size", [1.0, 1e-9])
class TestRightMotionsAreLeftAlone:
    def test_chaotic(self, size, rtol):
        scene = ac.System()
        scene.world = World((0, 0, -G * size))
        scene.upper, scene.lower = (RigidBody.rod(1.0, (0, 0, -size)) for _ in range(2))
        scene.shoulder, scene.elbow = Revolute("y"), Revolute("y")
        scene.connect(scene.world.frame, scene.shoulder.frame_a)
        scene.connect(scene.shoulder.frame_b, scene.upper.frame)
        scene.connect(scene.upper.tip, scene.elbow.frame_a)
        scene.connect(scene.elbow.frame_b, scene.lower.frame)
        model = ac.build(scene)
        silent(model, 30.0, {scene.shoulder.q: 2.5, scene.elbow.q: 1.0}, rtol=rtol)
        silent(model, 5.0, {scene.shoulder.q: 1e-7, scene.elbow.q: 0.0}, rtol=rtol)
        silent(model, 5.0, {scene.shoulder.q: 0.0, scene.elbow.q: 0.0}, rtol=rtol)
        silent(model, 5.0, {scene.shoulder.q: np.pi, scene.elbow.q: 0.0}, rtol=rtol)
        silent(model, 5.0, {scene.shoulder.q: 2.5}, rtol=rtol, events=[ac.when(scene.elbow.q - 0.5, stop=True)])

    def test_loop(self, size, rtol):
        scene, start = four_bar(size)
        model = ac.build(scene)
        silent(model, 10.0, start, rtol=rtol)
        for rest in (0.0, 1e-9):
            silent(model, 10.0, {scene.hinges[0].q: ac.near(-1.0), scene.hinges[0].v: rest}, rtol=rtol)

    def test_dissipative_and_stiff(self, size, rtol):
        scene = ac.System()
        scene.world, scene.ball = World((0, 0, -G * size)), Particle(0.5)
        scene.soft, scene.hard, scene.damper = Spring(50.0, size), Spring(1e7, 2 * size), Damper(30.0)
        for force, x in ((scene.soft, 1.0), (scene.hard, -2.0), (scene.damper, 1.0)):
            scene.connect(scene.world.at((x * size, 0, 0)), force.point_a)
            scene.connect(force.point_b, scene.ball.point)
        model = ac.build(scene)
        start = {scene.ball.point.position: (0, 0, 1e-2 * size), scene.ball.point.velocity: (0, 2 * size, 0)}
        silent(model, 2.0, start, rtol=rtol)

    def test_driven(self, size, rtol):
        scene = ac.System()
        scene.world, scene.hinge, scene.rod = World((0, 0, -G * size)), Revolute("y"), RigidBody.rod(1.0, (size, 0, 0))
        scene.torque = ac.Input("N*m")
        scene.drive, scene.friction = TorqueSource(scene.torque), RotationalDamper(0.05 * size**2)
        scene.ground = RotationalGround()
        scene.connect(scene.ground.flange, scene.friction.flange_a)
        scene.connect(scene.world.frame, scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.rod.frame)
        scene.connect(scene.hinge.flange, scene.drive.flange, scene.friction.flange_b)
        model = ac.build(scene)
        for signal in (lambda t: 5 * size**2 * np.sin(3 * t), lambda t: 8 * size**2 * (t > 0.7)):
            silent(model, 5.0, {scene.hinge.q: 0.1}, rtol=rtol, inputs={scene.torque: signal})

    def test_tumbling(self, size, rtol):
        scene = ac.System()
        scene.world, scene.joint = World((0, 0, -G * size)), Free()
        scene.body = RigidBody(1.0, (0.02 * size**2, 0.04 * size**2, 0.025 * size**2))
        scene.connect(scene.world.frame, scene.joint.frame_a)
        scene.connect(scene.joint.frame_b, scene.body.frame)
        start = {scene.body.frame.angular_velocity: (0.01, 5.0, 0.0), scene.body.frame.velocity: (size, 0, 3 * size)}
        silent(ac.build(scene), 20.0, start, rtol=rtol)


@final
class Brake(ac.Component):
    """A torque against the speed of a shaft, of which nothing is said about energy."""

    flange = ac.Rotational.port()

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.flange.tau, 0.3 * ac.der(self.flange.phi))


def test_parts_that_say_nothing_of_energy_are_not_judged():
    scene = ac.System()
    scene.world, scene.hinge, scene.rod, scene.brake = World((0, 0, -G)), Revolute("y"), RigidBody.rod(1.0, (1, 0, 0)), Brake()
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.hinge.flange, scene.brake.flange)
    model = ac.build(scene)
    assert not model.functions.energy_told
    silent(model, 5.0)


def test_what_is_right_is_looked_at_closely_nowhere(monkeypatch: pytest.MonkeyPatch):
    """The cheap look is enough: nothing is evaluated at all steps, and no rounding is measured."""
    scene, start = four_bar(1.0)
    model = ac.build(scene)
    for name in ("_balance", "_rounding"):
        monkeypatch.setattr(watch, name, None)
    for rtol in (1e-6, 1e-9, 1e-12):
        silent(model, 10.0, start, rtol=rtol)


class Stiffening(ac.Component):
    """f = stiffness s^3, whose energy is told as `SX`, without a declaration, or as an expression; `share` of it."""

    flange = ac.Translational.port()

    def __init__(self, share: float, plain: bool) -> None:
        self.share, self.plain = share, plain

    def equations(self):
        yield ac.equal(self.flange.f, 5.0 * self.flange.s**3)

    def stored_energy(self):
        s = self.flange.s.sx if self.plain else self.flange.s
        return self.share * 1.25 * s**4


@pytest.mark.parametrize("plain", [True, False])
def test_energies_that_are_told_wrongly_are_named_however_they_are_written(plain):
    for share in (1.0, 1.01, 0.0):
        scene = ac.System()
        scene.world, scene.rail, scene.mass, scene.law = World(None), Prismatic("x"), Particle(2.0), Stiffening(share, plain)
        scene.connect(scene.world.frame, scene.rail.frame_a)
        scene.connect(scene.rail.frame_b, scene.mass.point)
        scene.connect(scene.rail.flange, scene.law.flange)
        model = ac.build(scene)
        if share == 1.0:
            assert model.simulate(3.0, {scene.rail.q: 1.0}).energy_error() < 1e-7
            continue
        with pytest.warns(AccuracyWarning, match="The energies that 'law' .* tells do not match the forces"):
            model.simulate(3.0, {scene.rail.q: 1.0})


def _excess(i: float, voltage: float, R: float, V: float, saturation: float) -> float:
    return voltage - R * i - V * np.log1p(i / saturation)


def test_runs_that_miss_the_law_of_a_part_say_so_and_no_others() -> None:
    """A diode that begins without a current of its own: v = R i + V log(i / (rate t) + 1) jumps at the start, too fast for any step where the source is strong."""
    wrong = dict[float, bool]()
    for voltage, V, R, rate in (
        (0.5, 0.025, 50.0, 1e-6),
        (2.0, 0.025, 1.0, 1.0),
        (5.0, 0.025, 1.0, 1.0),
        (5e3, 25.0, 1.0, 1e3),
        (6e-6, 2.5e-8, 3.0, 2e-7),
    ):
        scene = ac.System()
        scene.ground, scene.source, scene.wire, scene.diode = (
            Ground(),
            VoltageSource(voltage),
            Resistor(R),
            Diode(rate * ac.time, V),
        )
        scene.connect(scene.source.pin_a, scene.wire.pin_a)
        scene.connect(scene.wire.pin_b, scene.diode.pin_a)
        scene.connect(scene.diode.pin_b, scene.source.pin_b, scene.ground.pin)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            run = ac.build(scene).simulate(1.0)
            run = run.at(run.steps.t)
        true = [brentq(_excess, 0.0, voltage / R, (voltage, R, V, rate * t), xtol=1e-300) for t in run.t[1:]]
        wrong[voltage] = not np.allclose(run[scene.diode.i][1:], true, rtol=1e-4)
        assert wrong[voltage] == any(
            "leaves its constraints" in str(one.message) and "diode" in str(one.message) for one in said
        ), voltage
    assert 0 < sum(wrong.values()) < len(wrong), wrong


def drawn_joints(
    rng: np.random.Generator, size: float, joints: Sequence[tuple[Any, int, int, np.ndarray]], W: np.ndarray
) -> ac.System:
    """`joints` between bodies, of which 0 is the world, at places with frames along W (3, 3); bodies lie anyhow, so that what is meant to coincide is rounded."""
    scene = ac.System()
    scene.world = World(tuple(9 * size * rng.normal(size=3)))
    count, frames = max(b for _, *ends, _ in joints for b in ends), [(np.eye(3), np.zeros(3))]
    frames += [(rotation(int(rng.integers(2**31))), size * rng.normal(size=3)) for _ in range(count)]
    scene.bodies = [
        RigidBody.box(1.0, (size, 2 * size, (k + 1) * size), position=tuple(p), rotation=R) for k, (R, p) in enumerate(frames[1:])
    ]
    scene.joints = [joint for joint, *_ in joints]
    for joint, *ends, place in joints:
        for end, frame in zip(ends, (joint.frame_a, joint.frame_b), strict=True):
            R, p = frames[end]
            scene.connect([scene.world, *scene.bodies][end].at(tuple(R.T @ (place - p)), R.T @ W), frame)
    return scene


@pytest.mark.parametrize(("seed", "size"), [(0, 1.0), (1, 1e-3), (2, 1e3)])
def test_a_rotor_that_a_cam_holds_at_rest_accuses_nobody(seed: int, size: float):
    """A slide that a ball far away holds is known to rounding of how far, and so is what a flat cam makes of it: a rotor stands by 1e-12 rad elsewhere."""
    rng = np.random.default_rng(seed)
    W, place, far = rotation(seed), size * rng.normal(size=3), 3 * size * rng.normal(size=3)
    shafts = [Cylindrical("z"), Universal("z", "x"), Cylindrical("z")]
    ends = [(0, 2), (2, 3), (3, 0)]
    scene = drawn_joints(rng, size, [
        (Prismatic("x"), 0, 1, place), (Spherical(), 1, 0, far), *((j, a, b, place) for j, (a, b) in zip(shafts, ends, strict=True)),
    ], W)  # fmt: skip
    scene.rotor, scene.cam = Inertia(0.1 * size**2), CamFollower(lambda angle: 1e-3 * size * (angle + 0.3 * np.sin(angle)))
    scene.connect(scene.cam.shaft, scene.rotor.flange_a)
    scene.connect(scene.cam.follower, scene.joints[0].flange)
    with warnings.catch_warnings():
        warnings.simplefilter("error", AccuracyWarning)
        run = ac.build(scene).simulate(0.4, rtol=1e-10, samples=5)
    assert np.max(np.abs(run[scene.rotor.phi])) < 1e-10
    assert run.energy_error() < 1e-12


@pytest.mark.parametrize(("seed", "size"), [(3, 1.0), (4, 1e-3), (6, 1e3)])
def test_bodies_on_joints_that_meet_in_a_point_begin_at_rest(seed: int, size: float):
    """Their constraints are made of arms that are nothing but rounding, and are known to no more: none is broken by a motion that has just begun."""
    rng = np.random.default_rng(seed)
    place = size * rng.normal(size=3)
    joints = [(Spherical(), 1, 0), (Spherical(), 2, 1), (Revolute("z"), 0, 2), (Universal("z", "x"), 2, 3)]
    screw = (Screw("z", pitch=0.7 * size), 1, 3)
    scene = drawn_joints(rng, size, [(*one, place) for one in (*joints, screw)], rotation(seed))
    run = ac.build(scene).simulate(0.4, rtol=1e-10, samples=5)
    assert run.energy_error() < 1e-12
