"""Calls of a model with what makes no sense, and runs that must fail."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import acausal as ac
from acausal import errors
from components import (
    AngleSource,
    Diode,
    Gear,
    Ground,
    Inertia,
    PrescribedMotion,
    Resistor,
    Revolute,
    RigidBody,
    RollingDisk,
    Spring,
    TorqueSource,
    VoltageSource,
    World,
)  # fmt: skip
from tests.bad_input.messages import Wrong, double, four_bar, pendulum_with
from tests.bad_input.test_scenes import steering
from tests.pairings import each_value
from tests.scenes import DoublePendulum, Pendulum

HERE = "test_calls.py:"


def asked(call: Callable[[Any, Any], object]) -> Callable[[], object]:
    """The call with a double pendulum and its model."""
    return lambda: call(*double())


def simulated(**options: Any) -> Callable[[], object]:
    """A simulation of a double pendulum with these options."""
    return lambda: double()[1].simulate(**{"end": 1.0, **options})


def driven(torque: Any) -> Callable[[], object]:
    """A pendulum whose input is given as `torque`."""

    def call() -> object:
        motor = TorqueSource(ac.Input("N*m"))
        return ac.build(pendulum_with(motor)).simulate(1.0, inputs={motor.torque: torque})

    return call


def rectified(call: Callable[[Any, ac.Model], object]) -> Callable[[], object]:
    """The call with a diode behind a resistor at a voltage that is an input, and its model."""

    def called() -> object:
        scene: Any = ac.System()
        scene.volt = ac.Input("V")
        scene.ground, scene.source, scene.wire, scene.diode = Ground(), VoltageSource(scene.volt), Resistor(100.0), Diode()
        scene.connect(scene.source.pin_a, scene.wire.pin_a)
        scene.connect(scene.wire.pin_b, scene.diode.pin_a)
        scene.connect(scene.diode.pin_b, scene.source.pin_b, scene.ground.pin)
        return call(scene, ac.build(scene))

    return called


class Adjustable(Pendulum):
    """A pendulum with a mass, a spring and a gear that stay adjustable."""

    def __init__(self) -> None:
        self.m, self.k, self.ratio = ac.Parameter(1.0, "kg"), ac.Parameter(5.0, "N/m"), ac.Parameter(2.0)
        super().__init__(mass=self.m)
        self.spring, self.gear, self.rotor = Spring(self.k), Gear(self.ratio), Inertia(0.1)
        self.connect(self.rod.tip, self.spring.point_a)
        self.connect(self.spring.point_b, self.world.at((1, 0, 0)))
        self.connect(self.hinge.flange, self.gear.flange_a)
        self.connect(self.gear.flange_b, self.rotor.flange_a)


def adjusted(values: Callable[[Adjustable], Any], **more: Any) -> Callable[[], object]:
    """A simulation with other parameters."""

    def call() -> object:
        scene = Adjustable()
        return ac.build(scene).simulate(1.0, parameters=values(scene), **more)

    return call


def wheel(**start: Any) -> Callable[[], object]:
    """A rolling disk with a start value of its contact's q or its centre's position."""

    def call() -> object:
        scene = ac.System()
        scene.world, scene.contact, scene.disk = World(), RollingDisk(0.3), RigidBody(1.0, (0.1, 0.2, 0.1))
        scene.connect(scene.world.frame, scene.contact.frame_a)
        scene.connect(scene.contact.frame_b, scene.disk.frame)
        keys = {"q": scene.contact.q, "position": scene.disk.frame.position}
        return ac.build(scene).simulate(1.0, {keys[k]: value for k, value in start.items()})

    return call


def torn(course: Any = lambda t: 0.5 * t) -> ac.System:
    """A table that drives away with two rods whose end is held."""
    scene = ac.System()
    given = course if isinstance(course, ac.Input) else course(ac.time)
    scene.world, scene.table, scene.plate = World(), PrescribedMotion((given, 0, 0)), RigidBody.ball(1.0, 0.1)
    scene.rods, scene.hinges = [RigidBody.rod(1.0, (0, 0, -1)) for _ in range(2)], [Revolute("y") for _ in range(3)]
    scene.connect(scene.world.frame, scene.table.frame_a)
    scene.connect(scene.table.frame_b, scene.plate.frame)
    one, two = scene.rods
    ends = (scene.plate.frame, one.frame, one.tip, two.frame, two.tip, scene.world.at((0.3, 0, -1.2)))
    for k, hinge in enumerate(scene.hinges):
        scene.connect(ends[2 * k], hinge.frame_a)
        scene.connect(hinge.frame_b, ends[2 * k + 1])
    return scene


@pytest.mark.filterwarnings("ignore::acausal.errors.SingularWarning")
def test_a_given_motion_that_tears_a_loop_is_told_with_the_time():
    """Two rods of 1 m reach from the table to (0.3, 0, -1.2) until 0.5 t - 0.3 = sqrt(4 - 1.44) = 1.6, so until t = 3.8 s."""
    with pytest.raises(errors.SimulationError, match=r"leads out of reach\. At t = 3\.8.*'hinges\[0\]'") as caught:
        ac.build(torn()).simulate(10.0)
    assert abs(caught.value.trajectory.t[-1] - 3.8) < 1e-6


@pytest.mark.filterwarnings("ignore::acausal.errors.SingularWarning")
@each_value(
    ("pace", [0.5, 50.0]),
    ("form", [lambda pace: pace * ac.time, lambda pace: CubicSpline(T := np.linspace(0, 5 / pace, 9), pace * T)]),
)
def test_an_input_that_tears_a_loop_is_told_with_the_time(form: Callable[[float], Any], pace: float):
    """At the same place, whatever the motion is given as: 0.3 + 1.6 from where the table begins."""
    course = ac.Input("m")
    scene, end = torn(course), 1.9 / pace
    with pytest.raises(errors.SimulationError, match=r"leads out of reach\. At t = .*'hinges\[0\]'") as caught:
        ac.build(scene).simulate(5 / pace, inputs={course: form(pace)})
    assert abs(caught.value.trajectory.t[-1] - end) < 1e-6 * end


def four_bar_driven_too_far() -> object:
    scene = four_bar(coupler=0.5, rocker=0.5)
    scene.motor = AngleSource(lambda t: t)
    scene.connect(scene.a.flange, scene.motor.flange)
    return ac.build(scene).simulate(10.0)


def hung_from(position: Callable[[Any], Any]) -> ac.System:
    """A rod that hangs from a point with a given motion along x."""
    scene = ac.System()
    scene.world, scene.trolley, scene.hinge = World(), PrescribedMotion(lambda t: (position(t), 0, 0)), Revolute("y")
    scene.rod = RigidBody.rod(1.0, (0, 0, -1))
    scene.connect(scene.world.frame, scene.trolley.frame_a)
    scene.connect(scene.trolley.frame_b, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    return scene


@pytest.mark.parametrize(
    ("position", "words"),
    [
        (lambda t: ca.if_else(t < 0.5, 0.0, 1.0), "trolley .* position or angle by 1 at once, at t = 0.5 s"),
        (lambda t: ca.if_else(t < 0.5, 0.0, 2 * t - 1), "speed by 2 at once, at t = 0.5 s"),
        (lambda t: ca.floor(3 * t + 0.1), "by 1 at once, at t = 0.3 s"),
    ],
    ids=["step", "ramp", "floor"],
)
def test_jumps_of_given_motions_are_told(position, words):
    with pytest.warns(errors.JumpWarning, match=words):
        ac.build(hung_from(position)).simulate(1.0)


def test_smooth_switches_of_given_motions_are_no_jumps():
    """A ramp that begins with t^3 has two derivatives; warnings are errors here."""
    run = ac.build(hung_from(lambda t: ca.if_else(t < 0.5, 0.0, (t - 0.5) ** 3))).simulate(1.0, rtol=1e-8)
    assert run.energy_error() < 1e-6


def test_errors_of_a_user_s_own_function_of_time_say_where_they_came_from():
    with pytest.raises(ZeroDivisionError) as caught:
        driven(lambda t: 1 / t)()
    assert caught.value.__notes__ == ["In the function of time of the input extra[0].torque, called with t = 0 s."]


def both(scene: ac.System, first: ac.Expression, second: ac.Expression) -> object:
    return ac.build(scene).simulate(1.0, {first: 1.0, second: 0.5})


def geared(position: bool) -> object:
    from components import RackAndPinion

    scene = steering(RackAndPinion(0.1))
    joints = (scene.column, scene.rail)
    return both(scene, *((j.q for j in joints) if position else (j.v for j in joints)))


def flat(call: Callable[[ac.Model, dict[Any, float]], object]) -> Callable[[], object]:
    """A parallelogram that lies flat."""

    def made() -> object:
        scene = four_bar(crank=0.5, coupler=1.0, rocker=0.5, base=1.0)
        return call(ac.build(scene), {scene.a.q: 0.0})

    return made


def reached(angle: float, call: Callable[[ac.Model, dict[Any, float]], object]) -> Callable[[], object]:
    """A four-bar whose crank cannot turn so far."""

    def made() -> object:
        scene = four_bar(coupler=0.5, rocker=0.5)
        return call(ac.build(scene), {scene.a.q: angle})

    return made


def inverse(
    motions: Callable[[DoublePendulum], Any], unknowns: Callable[[DoublePendulum], Any], times: Any = (0.0, 0.5, 1.0)
) -> Callable[[], object]:
    return asked(lambda s, m: m.inverse_dynamics(times, motions(s), unknowns(s)))


def free_fall() -> object:
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(1.0, 0.1)
    return ac.build(scene).equilibrium()


OPTION, START, UNKNOWN = errors.OptionError, errors.StartValueError, errors.UnknownVariableError

CASES = [
    Wrong("voltage at a diode from a function of numbers", rectified(lambda s, m: m.simulate(1.0, inputs={s.volt: float})), errors.ParameterError, ("der(volt)", "stands in nonlinear equations", "(function, function of its rate)")),
    Wrong("minimal with an input at a diode", rectified(lambda s, m: m.minimal()), OPTION, ("inputs stand, volt", "Use the model itself")),
    Wrong("optimal voltage at a diode", rectified(lambda s, m: ac.OptimalControl(m, 1.0)), OPTION, ("input volt stands in nonlinear equations", "signals.Integrator")),
    Wrong("end as text", simulated(end="long"), OPTION, ("end [s]", "'long'")),
    Wrong("no end", simulated(end=None), OPTION, ("end [s]", "None")),
    Wrong("interval in place of an end", simulated(end=(0, 10)), OPTION, ("(0, 10)",)),
    Wrong("endless", simulated(end=np.inf), OPTION, ("end [s]", "inf")),
    Wrong("start time as text", simulated(t0="now"), OPTION, ("t0 [s]", "'now'")),
    Wrong("tolerance as text", simulated(rtol="1e-8"), OPTION, ("rtol", "'1e-8'")),
    Wrong("negative tolerance", simulated(atol=-1.0), OPTION, ("atol=-1",)),
    Wrong("order as text", simulated(order="high"), OPTION, ("order", "'high'")),
    Wrong("order that is not there", simulated(order=7), OPTION, ("even orders", "7")),
    Wrong("step of zero", simulated(step=0.0), OPTION, ("step=0",)),
    Wrong("step as text", simulated(step="small"), OPTION, ("step", "'small'")),
    Wrong("no samples", simulated(samples=0), OPTION, ("samples is 0", "at least 2")),
    Wrong("samples after the end", simulated(samples=[0.0, 2.0]), OPTION, ("from 0 s to 2 s", "to 1 s")),
    Wrong("samples that fall", simulated(samples=[0.5, 0.2]), OPTION, ("samples", "ascending")),
    Wrong("samples as text", simulated(samples="all"), OPTION, ("samples is 'all'",)),
    Wrong("part of a sample", simulated(samples=10.5), OPTION, ("samples is 10.5", "whole")),
    Wrong("no steps", simulated(max_steps=0), OPTION, ("max_steps is 0",)),
    Wrong("truth as text", simulated(compiled="no"), OPTION, ("compiled is 'no'", "True or False")),
    Wrong("progress as text", simulated(progress="yes"), OPTION, ("progress is 'yes'",)),
    Wrong("event without a list", asked(lambda s, m: m.simulate(1.0, events=ac.when(s.elbow.q))), OPTION, ("`events` must be a list",)),
    Wrong("variable as an event", asked(lambda s, m: m.simulate(1.0, events=[s.elbow.q])), OPTION, ("`events`", "ac.when(")),
    Wrong("event of a vector", asked(lambda s, m: m.simulate(1.0, events=[ac.when(s.lower.tip.position)])), OPTION, ("not a scalar",)),
    Wrong("start of a frame", asked(lambda s, m: m.simulate(1.0, {s.lower.tip: (0, 0, 1)})), START, ("Frame tip", ".position, .velocity")),
    Wrong("start of a joint", asked(lambda s, m: m.simulate(1.0, {s.elbow: 0.1})), START, ("Revolute", ".q, .v")),
    Wrong("samples with a gap", lambda: ac.samples([0, 1, 2], [0, np.nan, 1]), errors.ParameterError, ("entry 1 of the values is nan",)),
    Wrong("start as a list", simulated(start=[0.1, 0.0]), START, ("[0.1, 0.0]", "dictionary")),
    Wrong("start of nothing", asked(lambda s, m: m.simulate(1.0, {s.elbow.q: None})), START, ("elbow.q",)),
    Wrong("start of a part", asked(lambda s, m: m.simulate(1.0, {s.elbow: 1.0})), START, ("Revolute", "scene.hinge.q")),
    Wrong("start value that is a symbol", asked(lambda s, m: m.simulate(1.0, {s.elbow.q: ac.Parameter(1.0)})), START, ("elbow.q", "Parameter", "not a number")),
    Wrong("starts of a geared pair that contradict", lambda: geared(True), START, ("rail.q = 0.5 m", "column.q = 1 rad", "would be 0.1", "ac.near")),
    Wrong("speeds of a geared pair that contradict", lambda: geared(False), START, ("rail.v = 0.5 m/s", "Leave out")),
    Wrong("crank where the loop cannot follow", reached(2.0, lambda m, s: m.simulate(1.0, s)), START, ("a.q = 2 rad", "'c'", "would be 1.2")),
    Wrong("branches where the loop cannot follow", reached(2.5, lambda m, s: m.branches(s)), START, ("a.q = 2.5 rad", "Leave out a.q")),
    Wrong("crank driven where the loop cannot follow", four_bar_driven_too_far, errors.SimulationError, ("t = 1.369", "leads out of reach", "'c'", "trajectory")),
    Wrong("wheel below its plane", wheel(position=(0, 0, -0.3)), START, ("'contact'", HERE, "outside its domain", "disk.frame.position")),
    Wrong("wheel above its plane", wheel(position=(0, 0, 1.3)), START, ("off by 1", "(0, 0, 0.3)")),
    Wrong("wheel that lies flat", wheel(q=(0, np.pi / 2, 0, 0, 0)), START, ("outside its domain", "does not roll on its rim", "contact.q")),
    Wrong("wheel with three of five coordinates", wheel(q=(0, 0, 0)), START, ("contact.q needs 5 numbers",)),
    Wrong("given motion without a value", lambda: ac.build(hung_from(lambda t: ca.log(t - 1))).simulate(1.0), errors.ParameterError, ("trolley", HERE, "t = 0 s", "t0=")),
    Wrong("given motion without a rate", lambda: ac.build(hung_from(lambda t: ca.sqrt(t))).simulate(1.0), errors.ParameterError, ("no finite rate", "trolley")),
    Wrong("negative mass", adjusted(lambda s: {s.m: -1.0}), errors.ParameterError, ("m = -1", "mass is -1", HERE, "positive")),
    Wrong("negative stiffness", adjusted(lambda s: {s.k: -5.0}), errors.ParameterError, ("k = -5", "Spring's stiffness is -5")),
    Wrong("ratio set to zero", adjusted(lambda s: {s.ratio: 0.0}), errors.ParameterError, ("ratio = 0", "Gear's ratio is 0")),
    Wrong("parameter with a unit as text", adjusted(lambda s: {s.k: "5 N/m"}), errors.ParameterError, ("k must be a number", "'5 N/m'")),
    Wrong("parameter with two values", adjusted(lambda s: {s.k: [1, 2]}), errors.ParameterError, ("k must be a number", "[1, 2]")),
    Wrong("parameters as a list", adjusted(lambda s: [1.0]), OPTION, ("parameters is [1.0]", "dictionary")),
    Wrong("parameter by a wrong name", adjusted(lambda s: {"ration": 1.0}), UNKNOWN, ("'ration' is not a parameter", "m, k, ratio", "Did you mean 'ratio'?")),
    Wrong("parameter given twice", adjusted(lambda s: {"k": 1.0, s.k: 2.0}), OPTION, ("parameters: something is given twice", "'k'")),
    Wrong("variable in place of a parameter", adjusted(lambda s: {"sled.q": 1.0}), UNKNOWN, ("'sled.q' is not a parameter",)),
    Wrong("parameter of another scene", adjusted(lambda s: {Adjustable().k: 1.0}), UNKNOWN, ("not a parameter of this scene",)),
    Wrong("parameter as an input", adjusted(lambda s: {}, inputs={ac.Parameter(1.0): 1.0}), UNKNOWN, ("not an input",)),
    Wrong("inputs as a list", simulated(inputs=[1.0]), OPTION, ("inputs is [1.0]", "dictionary")),
    Wrong("input as an array", driven(np.zeros(501)), errors.ParameterError, ("extra[0].torque", "ac.samples")),
    Wrong("input that depends on another", driven(ac.time * ac.Input("N*m")), errors.ParameterError, ("extra[0].torque", "only ac.time stands")),
    Wrong("input function without argument", driven(lambda: 1.0), errors.ParameterError, ("extra[0].torque", "called with one number")),
    Wrong("input function that returns nothing", driven(lambda t: None), errors.ParameterError, ("t = 0 s", "return one number")),
    Wrong("input that becomes NaN", driven(lambda t: 1.0 if t < 0.5 else np.nan), errors.SimulationError, ("t = 0.5 s", "input extra[0].torque is nan", "numbers")),
    Wrong("variable by a wrong name", asked(lambda s, m: m.simulate(1.0)["elbow.qq"]), UNKNOWN, ("no 'elbow.qq'", "Did you mean 'elbow.q'")),
    Wrong("variable by its last name", asked(lambda s, m: m.simulate(1.0)["q"]), UNKNOWN, ("Did you mean 'shoulder.q' or 'elbow.q'?",)),
    Wrong("quantity of a frame by a wrong name", asked(lambda s, m: m.simulate(1.0)["upper.tip.posistion"]), UNKNOWN, ("no 'upper.tip.posistion'", "Did you mean 'upper.tip.position'")),
    Wrong("quantity of a flange by a wrong name", asked(lambda s, m: m.simulate(1.0)["elbow.flange.ph"]), UNKNOWN, ("Did you mean 'elbow.flange.phi'",)),
    Wrong("entry that a quantity has not", asked(lambda s, m: m.simulate(1.0)["upper.tip.position[3]"]), UNKNOWN, ("upper.tip.position is (3, 1)", "counted from 0")),
    Wrong("entry that a variable has not", asked(lambda s, m: m.simulate(1.0)["elbow.q[1]"]), UNKNOWN, ("no 'elbow.q[1]'", "elbow.q")),
    Wrong("variable as a number", asked(lambda s, m: m.simulate(1.0)[3]), UNKNOWN, ("3 is not a variable", "scene.hinge.q")),
    Wrong("part in place of a variable", asked(lambda s, m: m.simulate(1.0)[s.elbow]), UNKNOWN, ("Revolute", "scene.hinge.q")),
    Wrong("connector in place of a variable", asked(lambda s, m: m.simulate(1.0)[s.lower.tip]), UNKNOWN, ("Frame tip", "position")),
    Wrong("time as text", asked(lambda s, m: m.simulate(1.0).at("now")), OPTION, ("'now'",)),
    Wrong("state of another scene in linearize", asked(lambda s, m: m.linearize(states=[Pendulum().hinge.q])), UNKNOWN, ("'q'", "shoulder.q, elbow.q")),
    Wrong("dependent states in linearize", asked(lambda s, m: m.linearize(states=[s.elbow.q, s.elbow.q, s.shoulder.q, s.elbow.v])), OPTION, ("depend on one another", "4 independent")),
    Wrong("too few states in linearize", asked(lambda s, m: m.linearize(states=[s.elbow.q])), OPTION, ("elbow.v", "leave open")),
    Wrong("inputs as a list in linearize", asked(lambda s, m: m.linearize(inputs=[1.0])), OPTION, ("inputs is [1.0]",)),
    Wrong("linearize where a parallelogram lies flat", flat(lambda m, s: m.linearize(s)), OPTION, ("singular position", "'c'", "beside")),
    Wrong("minimal where a parallelogram lies flat", flat(lambda m, s: m.minimal(s)), START, ("singular", "'c'", "beside this position")),
    Wrong("end as text in minimal", asked(lambda s, m: m.minimal().simulate("long")), OPTION, ("'long'",)),
    Wrong("preference of another scene", asked(lambda s, m: m.minimal(prefer=[Pendulum().hinge.q])), UNKNOWN, ("'q'",)),
    Wrong("start time as text in minimal", asked(lambda s, m: m.minimal(t0="x")), OPTION, ("t0 [s]", "'x'")),
    Wrong("start time as text in a start", asked(lambda s, m: m.initial_state(t0="x")), OPTION, ("t0 [s]", "'x'")),
    Wrong("tolerance as text in minimal", asked(lambda s, m: m.minimal().simulate(1.0, rtol="x")), OPTION, ("rtol", "'x'")),
    Wrong("negative tolerance of sensitivities", asked(lambda s, m: m.sensitivities([0, 1], [s.elbow.q], {s.elbow.q: 0.1}, rtol=-1.0)), OPTION, ("rtol=-1",)),
    Wrong("seed as text", asked(lambda s, m: m.branches(seed="x")), OPTION, ("seed is 'x'",)),
    Wrong("no searches", asked(lambda s, m: m.branches(searches=0)), OPTION, ("searches is 0",)),
    Wrong("function's name with a space", asked(lambda s, m: m.assembly_function(None, [s.elbow.q], {s.elbow.q: 0.1}, name="my function")), OPTION, ("'my function'", "letters")),
    Wrong("assembly with respect to a value that was not given", asked(lambda s, m: m.assembly_function(None, [s.elbow.q])), OPTION, ("elbow", "`start`") [1:]),
    Wrong("too few forces", inverse(lambda s: {s.shoulder.q: ac.time, s.elbow.q: 0.0}, lambda s: [s.shoulder]), errors.MotionError, ("shoulder.force", "2 motions, 1 force.", "actuator")),
    Wrong("body as a force", inverse(lambda s: {s.shoulder.q: 0.0}, lambda s: [s.upper]), OPTION, ("RigidBody", "a joint or an expression")),
    Wrong("motion as text", inverse(lambda s: {s.shoulder.q: "up"}, lambda s: [s.shoulder]), OPTION, ("shoulder.q is 'up'",)),
    Wrong("times that fall", inverse(lambda s: {s.shoulder.q: 0.0}, lambda s: [s.shoulder], [1.0, 0.0]), OPTION, ("ascending",)),
    Wrong("too few samples of a motion", inverse(lambda s: {s.shoulder.q: [1.0, 2.0]}, lambda s: [s.shoulder]), OPTION, ("shoulder.q", "2 entries")),
    Wrong("equilibrium in free fall", free_fall, errors.EquilibriumError, ("ball.free.v[5]", "-9.81", "free=[...]")),
    Wrong("state among the free quantities", asked(lambda s, m: m.equilibrium(free=[s.elbow.q])), OPTION, ("States are always free",)),
    Wrong("equilibrium's start as a list", asked(lambda s, m: m.equilibrium([0, 0])), START, ("[0, 0]", "dictionary")),
    Wrong("sensitivities with respect to a single thing", lambda: ac.build(Adjustable()).sensitivities([0, 1], ac.Parameter(1.0)), OPTION, ("`wrt` must be a list",)),
    Wrong("sensitivities with respect to what has no value", asked(lambda s, m: m.sensitivities([0, 1], [s.elbow.q])), OPTION, ("elbow.q", "Give it one, start=")),
    Wrong("sensitivities at all times", asked(lambda s, m: m.sensitivities("all", [s.elbow.q])), OPTION, ("ascending times",)),
    Wrong("output of a trajectory function by a wrong name", asked(lambda s, m: m.trajectory_function([0, 1], "x", [s.elbow.q], {s.elbow.q: 0.1})), UNKNOWN, ("'x'", "It has: ", "shoulder.q")),
    Wrong("step's order as text", asked(lambda s, m: m.step("gauss", "4")), OPTION, ("order is '4'",)),
    Wrong("step of length zero", asked(lambda s, m: m.step("gauss", 4, h=0.0)), OPTION, ("h is 0.0",)),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.title)
def test_message(case: Wrong):
    case.check()
