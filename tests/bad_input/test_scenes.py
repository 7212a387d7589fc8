"""Scenes that cannot be: gears, sources, loops, wheels, massless parts, given motions."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal import errors
from components import (
    AngleSource,
    Constant,
    Fixed,
    Gear,
    Ground,
    Gyro,
    IdealDiode,
    Inertia,
    Integrator,
    NonlinearDamper,
    NonlinearSpring,
    Particle,
    PlanetaryGear,
    PointOnPlane,
    PrescribedMotion,
    Prismatic,
    RackAndPinion,
    Resistor,
    Revolute,
    RigidBody,
    Rod,
    RollingDisk,
    RotationalGround,
    RotationalSpring,
    Spherical,
    Table,
    TorqueSensor,
    TorqueSource,
    VoltageSource,
    World,
)  # fmt: skip
from tests.bad_input.messages import Wrong, four_bar, pendulum_with
from tests.scenes import Pendulum

HERE = "test_scenes.py:"


def steering(*racks: RackAndPinion) -> ac.System:
    """A turning column and a sliding rail, with racks between them."""
    scene = ac.System()
    scene.world, scene.column, scene.rail = World(), Revolute("z"), Prismatic("x")
    scene.wheel, scene.bar, scene.racks = RigidBody.ball(1.0, 0.1), RigidBody.ball(1.0, 0.1), list(racks)
    for joint, body in ((scene.column, scene.wheel), (scene.rail, scene.bar)):
        scene.connect(scene.world.frame, joint.frame_a)
        scene.connect(joint.frame_b, body.frame)
    for rack in racks:
        scene.connect(scene.column.flange, rack.pinion)
        scene.connect(scene.rail.flange, rack.rack)
    return scene


def rack_left_open() -> None:
    scene = steering()
    scene.rack = RackAndPinion(0.1)
    scene.connect(scene.column.flange, scene.rack.pinion)
    ac.build(scene)


def rack_turned_round() -> None:
    scene = steering()
    scene.connect(scene.rail.flange, RackAndPinion(0.1).pinion)


def gear_between_a_joint_and_itself() -> None:
    scene, gear = Pendulum(), Gear(2.0)
    scene.gear = gear
    scene.connect(scene.hinge.flange, gear.flange_a, gear.flange_b)
    ac.build(scene)


def shafts_with_two_ratios() -> ac.System:
    """Two rotors with two gears between them that want different things."""
    scene = ac.System()
    scene.rotors, scene.gears = [Inertia(0.3), Inertia(0.4)], [Gear(2.0), Gear(3.0)]
    for gear in scene.gears:
        scene.connect(gear.flange_a, scene.rotors[0].flange_b)
        scene.connect(gear.flange_b, scene.rotors[1].flange_a)
    return scene


def cart(height: float = 0.0) -> ac.System:
    """Four wheels on a plane, one axle higher than the others."""
    scene = ac.System()
    scene.world, scene.body = World(), RigidBody(10.0, (1, 2, 2.5))
    scene.axles, scene.wheels = [Revolute("y") for _ in range(4)], [RigidBody(1.0, (0.1, 0.15, 0.1)) for _ in range(4)]
    scene.contacts = [RollingDisk(0.3) for _ in range(4)]
    for k, (x, y) in enumerate(((1, 0.5), (1, -0.5), (-1, 0.5), (-1, -0.5))):
        scene.connect(scene.body.at((x, y, height if k == 3 else 0.0)), scene.axles[k].frame_a)
        scene.connect(scene.axles[k].frame_b, scene.wheels[k].frame)
        scene.connect(scene.world.frame, scene.contacts[k].frame_a)
        scene.connect(scene.contacts[k].frame_b, scene.wheels[k].frame)
    return scene


def wheel_on_an_axle(height: float) -> ac.System:
    """A wheel of radius 0.3 m on an axle at this height."""
    scene = ac.System()
    scene.world, scene.wheel, scene.contact, scene.axle = (
        World(),
        RigidBody(1.0, (0.1, 0.2, 0.1)),
        RollingDisk(0.3),
        Revolute("y"),
    )
    scene.connect(scene.world.at((0, 0, height)), scene.axle.frame_a)
    scene.connect(scene.axle.frame_b, scene.wheel.frame)
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.wheel.frame)
    return scene


def massless_loop() -> None:
    scene = ac.System()
    scene.world, scene.hinges = World(), [Revolute("y") for _ in range(4)]
    scene.bars = [Fixed((length, 0, 0)) for length in (0.4, 1.2, 0.8)]
    one, two, three = scene.bars
    ends = (
        scene.world.frame,
        one.frame_a,
        one.frame_b,
        two.frame_a,
        two.frame_b,
        three.frame_b,
        scene.world.at((1, 0, 0)),
        three.frame_a,
    )
    for k, hinge in enumerate(scene.hinges):
        scene.connect(ends[2 * k], hinge.frame_a)
        scene.connect(hinge.frame_b, ends[2 * k + 1])
    ac.build(scene)


def particle_on_a_ball_joint() -> None:
    scene = ac.System()
    scene.world, scene.joint, scene.bob = World(), Spherical(), Particle(1.0)
    scene.connect(scene.world.frame, scene.joint.frame_a)
    scene.connect(scene.joint.frame_b, scene.bob.point)
    ac.build(scene)


def rod_from(place: tuple[float, float, float], length: float) -> None:
    scene = Pendulum()
    scene.stay = Rod(length)
    scene.connect(scene.world.at(place), scene.stay.frame_a)
    scene.connect(scene.stay.frame_b, scene.rod.tip)
    ac.build(scene)


def second_hinge(axis: str) -> None:
    scene = Pendulum()
    scene.again = Revolute(axis)
    scene.connect(scene.world.frame, scene.again.frame_a)
    scene.connect(scene.again.frame_b, scene.rod.frame)
    ac.build(scene)


def carried_on(*positions: tuple[float, float, float]) -> None:
    scene = ac.System()
    scene.world, scene.tables, scene.plate = World(), [PrescribedMotion(p) for p in positions], RigidBody.ball(1.0, 0.1)
    for table in scene.tables:
        scene.connect(scene.world.frame, table.frame_a)
        scene.connect(table.frame_b, scene.plate.frame)
    ac.build(scene)


def two_signals_into_one() -> None:
    scene = ac.System()
    scene.one, scene.two, scene.sum = Constant(1.0), Constant(2.0), Integrator()
    scene.connect(scene.one.output, scene.two.output, scene.sum.input)
    ac.build(scene)


def rod_of_changing_length(by: str) -> None:
    scene = ac.System()
    scene.world, scene.hinge = World(), Revolute("y")
    scene.rod = RigidBody.rod(1.0, (0, 0, -1 - (ac.time if by == "time" else scene.hinge.q)))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    ac.build(scene)


def mass_from_outside() -> None:
    scene = Pendulum()
    scene.load = Particle(ac.Input("kg"))
    ac.build(scene)


def scene_in_itself() -> None:
    one, two = ac.System(), ac.System()
    one.two, two.one = two, one
    ac.build(one)


def part_replaced() -> None:
    scene = Pendulum()
    scene.rod = RigidBody.rod(2.0, (0, 0, -2))
    ac.build(scene)


def parts_in_lists_in_a_dictionary() -> None:
    scene = Pendulum()
    scene.balls = {"left": [RigidBody.ball(1.0, 0.1)]}
    ac.build(scene)


def led(course: object) -> None:
    """A pendulum whose angle is an input of this course."""
    angle = ac.Input("rad")
    ac.build(pendulum_with(AngleSource(angle))).simulate(1.0, inputs={angle: course})


def class_for_a_part() -> None:
    scene = Pendulum()
    scene.moon = RigidBody
    ac.build(scene)


def class_s_connector() -> None:
    scene = Pendulum()
    scene.connect(scene.rod.tip, Revolute.frame_a)


def gyro_on_a_particle(away: tuple[float, float, float]) -> None:
    scene = ac.System()
    scene.world, scene.bob, scene.arm, scene.gyro = World(), Particle(2.0), Fixed(away), Gyro()
    scene.connect(scene.gyro.frame, scene.arm.frame_a)
    scene.connect(scene.arm.frame_b, scene.bob.point)
    ac.build(scene)


def read_a_list() -> None:
    scene = Pendulum()
    ac.build(scene).simulate(0.1)[[1.5 * scene.rod.tip.position[k] ** 2 for k in range(3)]]


A_DEGREE = np.radians(1.0)

CASES = [
    Wrong("gear ratio of zero", lambda: Gear(0), errors.ParameterError, ("Gear's ratio is 0", HERE, "not zero")),
    Wrong("gear ratio of zero, adjustable", lambda: Gear(ac.Parameter(0.0)), errors.ParameterError, ("Gear's ratio is 0", HERE)),
    Wrong("gear ratio as text", lambda: PlanetaryGear("2:1"), errors.ParameterError, ("'2:1'", "number")),
    Wrong("planetary ratio of zero", lambda: PlanetaryGear(0), errors.ParameterError, ("PlanetaryGear's ratio is 0",)),
    Wrong("two different racks between the same joints", lambda: ac.build(steering(RackAndPinion(0.1), RackAndPinion(0.2))), errors.LockedError, ("2 freedoms", "racks[0].rack and racks[1].rack'. Remove",)),
    Wrong("two gears of different ratios between the same shafts", lambda: ac.build(shafts_with_two_ratios()), errors.LockedError, ("rotors[0...1].phi", "different ratios", "Remove one")),
    Wrong("rack connected at one end", rack_left_open, errors.UnconnectedError, ("rack.rack", HERE, "Connect all")),
    Wrong("pinion on a slider", rack_turned_round, errors.IncompatibleError, ("flange of Prismatic", "pinion of RackAndPinion", HERE)),
    Wrong("gear on one joint", gear_between_a_joint_and_itself, errors.LockedError, ("hinge.flange and gear.flange_a",)),
    Wrong("two sources on one joint", lambda: ac.build(pendulum_with(AngleSource(0.1), AngleSource(0.2))), errors.OverdeterminedError, ("extra[0].flange and extra[1].flange", "remove a source")),
    Wrong("angle from samples that bend", lambda: led(ac.samples([0, 0.5, 1], [0, 1, 3])), errors.ParameterError, ("extra[0].angle", "bend at t = 0.5 s", HERE, '"cubic"')),
    Wrong("angle from samples that jump", lambda: led(ac.samples([0, 0.5, 1], [0, 1, 3], "constant")), errors.ParameterError, ("jump at t = 0.5 s", "spring between")),
    Wrong("angle from a function of numbers", lambda: led(float), errors.ParameterError, ("der(extra[0].angle)", "a place or an angle", HERE, "function of its rate, function of its second rate")),
    Wrong("angle from too few rates", lambda: led((float, float)), errors.ParameterError, ("(<class 'float'>, <class 'float'>)", "function of its second rate")),
    Wrong("Python's if in a function of time", lambda: AngleSource(lambda t: 0.0 if t < 0.5 else 1.0), errors.ParameterError, ("function of time", HERE, "ca.if_else")),
    Wrong("math.sin in a function of time", lambda: AngleSource(float), errors.ParameterError, ("np.sin", "symbol ac.time")),
    Wrong("sensor connected at one end", lambda: ac.build(pendulum_with(TorqueSensor())), errors.UnconnectedError, ("extra[0].flange_b", "both ends")),
    Wrong("planetary gear with one shaft", lambda: ac.build(pendulum_with(PlanetaryGear(2.0))), errors.UnconnectedError, ("extra[0].carrier", "RotationalGround")),
    Wrong("shaft without inertia", lambda: Inertia(0.0), errors.ParameterError, ("inertia is 0", "positive")),
    Wrong("axis wrong by one degree", lambda: ac.build(four_bar(last_but_one=(np.sin(A_DEGREE), np.cos(A_DEGREE), 0))), errors.AssemblyError, ("'c'", "degrees askew", "axes")),
    Wrong("loop that cannot close", lambda: ac.build(four_bar(coupler=5.0)), errors.AssemblyError, ("'c'", "gap reached is 2.8", "Check lengths")),
    Wrong("four wheels not in one plane", lambda: ac.build(cart(0.01)), errors.AssemblyError, ("contacts[", "gap reached is 0.003", "offsets")),
    Wrong("wheel larger than its axle is high", lambda: ac.build(wheel_on_an_axle(0.25)), errors.AssemblyError, ("'contact'", "gap reached is 0.05")),
    Wrong("wheel that rolls on a fixed axle", lambda: ac.build(wheel_on_an_axle(0.3)), errors.LockedError, ("'contact'", "Remove a joint")),
    Wrong("gyro on a particle", lambda: gyro_on_a_particle((0, 0, 0)), errors.MasslessError, ("bob, arm, gyro", "in one point", "RigidBody")),
    Wrong("gyro beside a particle", lambda: gyro_on_a_particle((0.1, 0.7, -0.3)), errors.MasslessError, ("in one point", "RigidBody")),
    Wrong("a list is read", read_a_list, errors.UnknownVariableError, ("… is not a variable",)),
    Wrong("loop without mass", massless_loop, errors.MasslessError, ("hinges[1]", "bars[1]", "Connect a body with mass")),
    Wrong("particle on a ball joint", particle_on_a_ball_joint, errors.IncompatibleError, ("joint.frame_b", "'bob'", "point", "Fixed")),
    Wrong("rod too long", lambda: rod_from((0, 0, 0), 3.0), errors.AssemblyError, ("'stay'", "gap reached is 1.33")),
    Wrong("rod that locks", lambda: rod_from((1, 0, 0), 1.0), errors.LockedError, ("locked", "'stay'")),
    Wrong("rod of length zero", lambda: Rod(0), errors.ParameterError, ("length is 0", "positive")),
    Wrong("rod given as a vector", lambda: Rod((0, 0, 1)), errors.ParameterError, ("(0, 0, 1)", "number")),
    Wrong("second hinge across the first", lambda: second_hinge("x"), errors.LockedError, ("closing 'hinge'", "Remove a joint")),
    Wrong("carried to two places", lambda: carried_on((1, 0, 0), (0, 0, 1)), errors.AssemblyError, ("tables[1]", "gap reached is 1")),
    Wrong("nothing but a given motion", lambda: carried_on((1, 0, 0)), errors.LockedError, ("Nothing", "Add a joint")),
    Wrong("given position from a variable", lambda: PrescribedMotion((Pendulum().hinge.q, 0, 0)), errors.ParameterError, ("position", "variable", HERE, "source")),
    Wrong("given position with two entries", lambda: PrescribedMotion(lambda t: (0, t)), errors.ParameterError, ("three components", "(2, 1)")),
    Wrong("two signals into one", two_signals_into_one, errors.OverdeterminedError, ("one.output and two.output", "twice")),
    Wrong("potential that needs numbers", lambda: NonlinearSpring(lambda s: s.norm()), errors.ParameterError, ("(length)", HERE)),
    Wrong("damper's law with one argument", lambda: NonlinearDamper(lambda rate: rate), errors.ParameterError, ("length, rate", HERE)),
    Wrong("table of text", lambda: Table("ab", "cd"), errors.ParameterError, ("two lists",)),
    Wrong("rotation in degrees about three axes", lambda: Fixed((0, 0, 0), rotation=(0, 90, 0)), errors.ParameterError, ("(axis, angle)", "(0, 90, 0)")),
    Wrong("rotation as text", lambda: Fixed((0, 0, 0), rotation="x"), errors.ParameterError, ("'x'", "quaternion")),
    Wrong("gravity as a number", lambda: World(9.81), errors.ParameterError, ("gravity", "three numbers", "9.81")),
    Wrong("mass as text", lambda: Particle("1.0"), errors.ParameterError, ("'1.0'",)),
    Wrong("length that grows with time", lambda: rod_of_changing_length("time"), errors.ParameterError, ("rod (", HERE, "the time time", "constant", "Prismatic")),
    Wrong("length that follows a variable", lambda: rod_of_changing_length("q"), errors.ParameterError, ("rod (", "the variable q", "constant")),
    Wrong("mass from an input", mass_from_outside, errors.ParameterError, ("load (", "mass depends on the input", "constant")),
    Wrong("axis that turns with time", lambda: ac.build(four_bar(last_but_one=(0, 1, ac.time))), errors.ParameterError, ("c (", "axis", "time")),
    Wrong("scene in itself", scene_in_itself, errors.DuplicateError, ("scene itself", "two.one")),
    Wrong("part replaced after it was connected", part_replaced, errors.IncompatibleError, ("hinge.frame_b", "not a part", "another part afterwards")),
    Wrong("parts in lists in a dictionary", parts_in_lists_in_a_dictionary, errors.ModelError, ("balls", "dict", "flat list")),
    Wrong("class in place of a part", class_for_a_part, errors.ModelError, ("moon is the class RigidBody", "RigidBody(...)")),
    Wrong("connector of a class", class_s_connector, errors.IncompatibleError, ("belongs to a class", "instance")),
    Wrong("class in place of a scene", lambda: ac.build(Pendulum), errors.ModelError, ("the class Pendulum", "build(Pendulum())")),
    Wrong("nothing in place of a scene", lambda: ac.build(None), errors.ModelError, ("None", "ac.System()")),
    Wrong("one connector", lambda: Pendulum().connect(Particle(1.0).point), errors.IncompatibleError, ("two connectors or more", "given 1", HERE)),
    Wrong("list in place of a connector", lambda: Pendulum().connect([1], [2]), errors.IncompatibleError, ("takes connectors", "[1]")),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.title)
def test_message(case: Wrong):
    case.check()


def test_connectors_and_parts_answer_misspelt_names():
    scene = Pendulum()
    for read, words in (
        (lambda: scene.rod.frme, "Did you mean 'frame'"),
        (lambda: scene.rod.tip.postion, "Did you mean 'position'"),
        (lambda: scene.rod.tip.x, "It has: acceleration"),
        (lambda: Particle(1.0).point.rotation, "no orientation"),
        (lambda: RigidBody.ball(1.0, 0.1).tip, "only a RigidBody.rod"),
        (lambda: scene.arm, "It has: world, hinge, rod"),
    ):
        with pytest.raises(AttributeError, match=words):
            read()


def test_conditions_choose_in_functions_of_time():
    """A ramp with a switch, written as a newcomer would; CasADi's if_else takes comparisons of symbols."""
    source = AngleSource(lambda t: ca.if_else(t < 1, t**3, 3 * t - 2))
    scene = pendulum_with(source)
    scene.free = Revolute("y")
    scene.lower = RigidBody.rod(1.0, (0, 0, -1))
    scene.connect(scene.rod.tip, scene.free.frame_a)
    scene.connect(scene.free.frame_b, scene.lower.frame)
    run = ac.build(scene).simulate(0.9)
    assert np.allclose(run[scene.hinge.q], run.t**3, atol=1e-12)


def test_circuits_that_leave_something_open_are_told_what():
    def ring(grounds: int) -> ac.System:
        scene = ac.System()
        scene.source, scene.load, scene.grounds = VoltageSource(1.0), Resistor(1.0), [Ground() for _ in range(grounds)]
        scene.connect(scene.source.pin_a, scene.load.pin_a)
        scene.connect(scene.source.pin_b, scene.load.pin_b, *(ground.pin for ground in scene.grounds))
        return scene

    with pytest.raises(errors.UnderdeterminedError, match=r"potential: connect one"):
        ac.build(ring(0))
    with pytest.raises(errors.UnderdeterminedError, match=r"grounds.*Grounds, side by side.*keep one"):
        ac.build(ring(2))


@pytest.mark.parametrize("valves", [1, 2])
def test_what_holds_nothing_that_moves_is_told_so(valves: int):
    scene = ac.System()
    scene.world, scene.body, scene.foot = World(), RigidBody.ball(1.0, 0.1), PointOnPlane(unilateral=True)
    scene.connect(scene.foot.frame_a, scene.body.frame)
    scene.connect(scene.foot.frame_b, scene.body.frame)
    with pytest.raises(errors.ModelError, match=rf"foot \(.*{HERE}.*Both its ends may be on one body"):
        ac.build(scene)
    circuit = ac.System()
    circuit.source, circuit.ground, circuit.diodes = (
        VoltageSource(np.sin(ac.time)),
        Ground(),
        [IdealDiode() for _ in range(valves)],
    )
    for diode in circuit.diodes:
        circuit.connect(circuit.source.pin_a, diode.pin_a)
        circuit.connect(
            diode.pin_b, *([circuit.source.pin_b, circuit.ground.pin] if diode is circuit.diodes[0] else [circuit.ground.pin])
        )
    with pytest.raises(errors.ModelError, match=rf"diodes\[0\] \(.*{HERE}.*small resistance"):
        ac.build(circuit)


def test_springs_without_inertia_are_told_what_is_missing():
    scene = ac.System()
    scene.wall, scene.spring, scene.push = RotationalGround(), RotationalSpring(1.0), TorqueSource(1.0)
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.push.flange)
    with pytest.raises(errors.LockedError, match=r"spring.*add an Inertia"):
        ac.build(scene)
