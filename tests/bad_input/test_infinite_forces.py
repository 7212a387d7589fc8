"""Forces that are infinite or no numbers are named, with what to do, whatever is asked of the model."""

import re
from functools import partial

import numpy as np
import pytest

import acausal as ac
from acausal.errors import AcausalError, AccuracyWarning, EquilibriumError, SimulationError, StartValueError
from components import (
    CentralField,
    DCMotor,
    Force,
    MutualGravitation,
    Particle,
    Revolute,
    RigidBody,
    Rope,
    Spring,
    TorqueSource,
    World,
)
from tests.pairings import each_value


def _with_mass(mass: float):
    scene = ac.System()
    scene.mass = ac.Parameter(mass, "kg")
    return scene


def _on_a_spring(size: float):
    scene = _with_mass(1.0)
    scene.world, scene.ball, scene.spiral = World((0, 0, -9.81 * size)), Particle(scene.mass), Spring(100.0, 0.1 * size)
    scene.connect(scene.world.frame, scene.spiral.point_a)
    scene.connect(scene.spiral.point_b, scene.ball.point)
    return scene, {scene.ball.point.position: (0, 0, 0)}, "'spiral'", "apart"


def _in_the_centre(size: float):
    scene = _with_mass(1.0)
    scene.world, scene.ball, scene.sun = World((0, 0, 0)), Particle(scene.mass), CentralField(size**3)
    return scene, {}, "'sun[ball]'", "beside"


def _in_one_place(size: float):
    scene = _with_mass(size)
    scene.world, scene.ball, scene.other, scene.pull = (
        World((0, 0, 0)),
        Particle(scene.mass),
        Particle(2 * size),
        MutualGravitation(),
    )
    return scene, {}, "'pull[ball, other]'", "apart"


@each_value(("make", [_on_a_spring, _in_the_centre, _in_one_place]), ("size", [1e-4, 1.0, 3e4]))
def test_a_force_without_a_value_is_named(make, size: float) -> None:
    scene, start, name, advice = make(size)
    model = ac.build(scene)
    for asked in (
        lambda: model.simulate(1.0, start),
        lambda: model.linearize(start),
        lambda: model.sensitivities([0.0, 1.0], [scene.mass], start=start),
        lambda: model.minimal(start).simulate(1.0),
        lambda: model.minimal(start).linearize(),
    ):
        with pytest.raises((SimulationError, StartValueError)) as told:
            asked()
        assert name in str(told.value) and advice in str(told.value) and ".py:" in str(told.value)


@pytest.mark.parametrize(("mu", "radius", "speed"), [(3.986e14, 7e6, 0.0), (1e-9, 1e-3, 1.0), (2.0, 0.0, 0.0)])
def test_what_has_no_equilibrium_is_told_in_numbers(mu: float, radius: float, speed: float) -> None:
    scene = ac.System()
    scene.world, scene.moon, scene.sun = World((0, 0, 0)), Particle(10.0), CentralField(mu)
    at = scene.moon.point
    circling = {at.velocity: (0, speed * np.sqrt(mu / radius), 0)} if speed else {}
    with pytest.raises(EquilibriumError) as told:
        ac.build(scene).equilibrium({at.position: (radius, 0, 0)} | circling)
    gaps = re.findall(r"\(off by ([^)]*)\)", str(told.value))
    assert gaps and np.isfinite(np.array(gaps, float)).all() and "steady" in str(told.value)
    assert ("'sun[moon]'" in str(told.value)) == (radius == 0)


def test_where_a_law_ends_on_the_way_it_is_named() -> None:
    """A force of sqrt(q - 0.2): begun in its domain, at its root, and outside of it."""
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World(), Revolute("y"), RigidBody.rod(1.0, (0, 0, -1.0))
    scene.root = Force((np.sqrt(scene.hinge.q - 0.2), 0, 0))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.rod.tip, scene.root.point)
    model = ac.build(scene)
    for angle in (0.5, 0.1):
        with pytest.raises(SimulationError, match="'root'"):
            model.simulate(1.0, {scene.hinge.q: angle})
    for angle in (0.5, 0.2, 0.1):  # a slope that is infinite is no reason to crash
        try:
            found = model.equilibrium({scene.hinge.q: angle})
        except AcausalError:
            continue
        assert (
            abs(0.5 * 9.81 * np.sin(found[scene.hinge.q]) + np.sqrt(found[scene.hinge.q] - 0.2) * np.cos(found[scene.hinge.q]))
            < 1e-12
        )
    with pytest.raises(StartValueError, match=r"no derivative by hinge\.q"):
        model.linearize({scene.hinge.q: 0.2})


def test_a_torque_without_a_value_at_the_start_says_so_and_nothing_else_does() -> None:
    """1 / q at q = 0: an equilibrium that there is beside it, q sin q = 1 / (m g s), is found from there, without a word of numpy's."""
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World((0, 0, -9.81)), Revolute("y"), RigidBody.rod(1.0, (0, 0, -1.0))
    scene.motor = TorqueSource(1 / scene.hinge.q)
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.motor.flange, scene.hinge.flange)
    model = ac.build(scene)
    with pytest.raises(SimulationError, match="hinge"):
        model.simulate(1.0)
    q = float(model.equilibrium()[scene.hinge.q])
    assert q * np.sin(q) == pytest.approx(1 / (9.81 * 0.5))


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_what_is_held_in_the_centre_of_a_field_is_told_of_though_nothing_moves_it(size: float) -> None:
    """By symmetry the field does nothing there to a body on a hinge: neither an equilibrium nor a balance of energies has a meaning. Beside it both have."""
    for offset in (0.0, 0.3 * size):
        scene = ac.System()
        scene.world, scene.hinge, scene.wheel = (
            World((0, 0, 0)),
            Revolute("y"),
            RigidBody(2.0, inertia=np.array([1, 2, 2.5]) * size**2),
        )
        scene.sun = CentralField(size**3)
        scene.connect(scene.world.at((0.0, offset, 0.0)), scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.wheel.frame)
        model = ac.build(scene)
        if offset:
            assert model.equilibrium().residual < 1e-9
            model.simulate(0.1, {scene.hinge.v: 1.0})
            continue
        with pytest.raises(EquilibriumError, match=r"but one in a singular place\. The energy of 'sun\[wheel\]' \(.*\.py:\d+\)"):
            model.equilibrium()
        with pytest.warns(
            AccuracyWarning, match=r"energy of the motion is infinite .* The energy of 'sun\[wheel\]' \(.*\.py:\d+\)"
        ):
            model.simulate(0.1, {scene.hinge.v: 1.0})


def test_the_part_is_named_whose_own_law_has_no_value() -> None:
    """And not those that take over what another one gives."""
    laws = (
        lambda s: 1 / s.hinge.q,
        lambda s: 1 / ac.time,
        lambda s: lambda t: 1 / t,
        lambda s: np.sqrt(s.hinge.q - 1),
        lambda s: 2 / s.hinge.v,
    )
    for law in laws:
        scene = ac.System()
        scene.world, scene.hinge, scene.rod = World((0, 0, -9.81)), Revolute("y"), RigidBody.rod(1.0, (0, 0, -1.0))
        scene.motor = TorqueSource(law(scene))
        scene.brake = TorqueSource(0.1 * ac.der(scene.hinge.v))
        scene.connect(scene.world.frame, scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.rod.frame)
        scene.connect(scene.motor.flange, scene.hinge.flange, scene.brake.flange)
        model = ac.build(scene)
        for ask in (partial(model.simulate, 1.0), model.linearize):
            with pytest.raises(
                (SimulationError, StartValueError), match=r"What 'motor' \(.*\.py:\d+\) is given is infinite or not a number"
            ):
                ask()


def test_ropes_whose_ends_lie_on_one_another_are_named():
    scene = ac.System()
    scene.world, scene.left, scene.right, scene.rope = World(), Particle(1.0), Particle(2.0), Rope(1.5)
    scene.connect(scene.rope.frame_a, scene.left.point)
    scene.connect(scene.rope.frame_b, scene.right.point)
    with pytest.raises(
        SimulationError, match=r"The ends of 'rope\.pieces\[0\]' \(.*\.py:\d+\) lie on one another, .* begin with them apart"
    ):
        ac.build(scene).simulate(1.0)


def test_a_motor_is_named_by_its_own_numbers():
    for wrong, said in (
        ({"constant": 0.0}, "constant is 0"),
        ({"resistance": -1.0}, "resistance is -1"),
        ({"ratio": 0.0}, "ratio is 0"),
    ):
        with pytest.raises(AcausalError, match=f"DCMotor's {said}"):
            DCMotor(**({"constant": 0.1, "resistance": 1.0} | wrong))
