"""Wrong arguments of every part of the catalogue, found by discovery: words that name the part and the user's line, never a bare error of Python."""

from __future__ import annotations

import copy
import inspect
import math
import pickle
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import acausal as ac
import components
from acausal.errors import AcausalError, ParameterError
from acausal.parts.field import FieldForce, PairForce
from components import (
    Coulomb,
    Cylinder,
    Damper,
    Ellipsoid,
    Hard,
    Helix,
    HuntCrossley,
    Plane,
    PointOnSurface,
    Pulley,
    Revolute,
    RigidBody,
    Section,
    ShapeIntegrals,
    Sliding,
    SlidingMass,
    Sphere,
    Spring,
    Sum,
    Touching,
    World,
)
from tests.bad_input.messages import Wrong
from tests.conformance.catalogue import kinds

HERE = "test_constructors.py:"
SHAPES = np.random.default_rng(0).normal(size=(8, 3, 2))
USUAL: dict[str, Any] = {
    "section": Section.circle(0.1), "integrals": ShapeIntegrals.of_masses(np.ones(8), SHAPES[:, :, 0] + 0.3, SHAPES), "semi_axes": (0.3, 0.2, 0.1),
    "potential": lambda s: s**2, "points": (0.0, 1.0), "values": (0.0, 1.0),
    "RigidBody.inertia": (0.1, 0.2, 0.25), "NonlinearDamper.force": lambda s, r: r, "FlexibleBody.stiffness": np.eye(2), "Force.force": (1.0, 2.0, -0.5),
    "Torque.torque": (1.0, 2.0, -0.5), "curve": Helix(0.4, 0.1), "surface": Cylinder(0.5), "shape": Ellipsoid((0.3, 0.2, 0.1)), "ContactForce.law": HuntCrossley(1e3), "place": Cylinder(0.5), "HardContact.law": Hard(), "HardPoint.law": Hard(), "OneSidedPoint.law": Hard(), "law": Coulomb(0.2),
    "JointFriction.joint": Revolute(), "TouchFriction.joint": Touching(Sphere(0.1), Plane(), Sliding()), "JointFriction": {"radius": 0.1}, "joint": PointOnSurface(Cylinder(0.5)),
    "LimitedSum.number": 2, "Relay.lower": 0.0, "Thermostat.lower": 0.0, "PotentialField.potential": lambda p, t: p[2],
    "flange": SlidingMass(1.0).flange_a, "flange_a": SlidingMass(1.0).flange_a, "flange_b": SlidingMass(1.0).flange_a, "EndStop": {"lower": -0.1},
    "pulley": Pulley(World().frame, 0.1), "pulley_a": Pulley(World().frame, 0.1), "pulley_b": Pulley(World().frame, 0.1), "RopeOverWheels.sections": (1, 2), "RopeOverWheels.radii": (0.1,),
    "pulleys": (Pulley(World().frame, 0.1, wheel=RigidBody.disk(1.0, 0.1)), Pulley(World().at((1, 0, 0)), 0.1)), "radii": (0.1, 0.2, 0.3), "sections": (1, 1, 1),
    "description": '<robot name="r"><link name="a"><inertial><mass value="1"/></inertial></link></robot>', "ConstantSum.number": 2, "TotalLength.number": 2, "ElasticStop.law": HuntCrossley(1e3), "ElasticBacklash.law": HuntCrossley(1e3), "ElasticStop": {"lower": -0.1}, "CamFollower.lift": lambda phi: 0.1 * np.sin(phi), "PrescribedAngularVelocity.angular_velocity": (1.0, 2.0, -0.5), "Bushing.stiffness": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), "UniformField.acceleration": (1.0, 2.0, -0.5),
}  # fmt: skip
POSITIVE = {"mass", "inertia", "radius", "half_angle", "tube", "semi_axes", "length", "density", "youngs_modulus", "stiffness", "damping", "natural_length",
            "resistance", "capacitance", "inductance", "saturation_current", "thermal_voltage", "filter_time", "mu", "width", "capacity", "holding", "leakage", "restitution", "linear", "quadratic", "collar"}  # fmt: skip
SIGNED = {"TranslationalSpring.natural_length", "RackAndPinion.radius"}
"""A rod that pushes and pulls may be shorter than nothing; a rack may lie on the other side."""
PLAIN = {"Constant.value", "TimeFunction.function", "Gain.factor", "Integrator.factor", "PID.proportional", "PID.integral",
         "PID.derivative", "Table.points", "Table.values", "Freewheel.gate", "Thyristor.gate",
         *(f"{part}.{name}" for part in ("Relay", "Thermostat", "Limiter") for name in ("lower", "upper", "off", "on", "power", "start")),
         *(f"{part}.{name}" for part in ("Latch", "PointLatch", "Gripper") for name in ("closes", "opens"))}  # fmt: skip
"""What signals carry has any unit, and what tells by its sign."""
FLAGS = {"held", "unilateral", "Relay.start", "Thermostat.start", "Robot.friction"}
DIRECTIONS = {"axis", "axis_a", "axis_b", "normal", "rotation", "tip_turns", "side"}


class _Nothing:
    """No number, no text, no list."""


def arguments(cls: type[ac.Component]) -> dict[str, Any]:
    """Right values for what has no default."""
    taken = inspect.signature(cls).parameters.values()
    return {
        p.name: USUAL.get(f"{cls.__name__}.{p.name}", USUAL.get(p.name, 1.0))
        for p in taken
        if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    } | USUAL.get(cls.__name__, {})


def names(cls: type[ac.Component]) -> list[str]:
    """Arguments of its constructor."""
    return [n for n, p in inspect.signature(cls).parameters.items() if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]


PARTS = [
    cls for cls in kinds(ac.Component) if cls not in (Sum, FieldForce, PairForce)
]  # any number of weights; made by `build` only
TAKEN = [(cls, name) for cls in PARTS for name in names(cls)]
IDS = [f"{cls.__name__}-{name}" for cls, name in TAKEN]


def message(cls: type[ac.Component], given: dict[str, Any]) -> str | None:
    """What is said to who makes the part so; None if it is made. Anything but an error of ours fails the test."""
    try:
        cls(**given)
    except AcausalError as error:
        said = str(error)
        assert HERE in said and len(said) < 750, said
        return said
    return None


@pytest.mark.parametrize("cls", PARTS, ids=lambda cls: cls.__name__)
def test_an_argument_that_does_not_exist_is_named(cls: type[ac.Component]):
    given = arguments(cls)
    assert message(cls, given) is None
    said = message(cls, {**given, "colour_of_the_sea": 3})
    assert said and cls.__name__ in said and "colour_of_the_sea" in said
    for name in names(cls):
        misspelt = name[:-1] + name[-1] * 2
        said = message(cls, {**given, misspelt: 1.0})
        assert said and f"Did you mean '{name}'?" in said


@pytest.mark.parametrize("cls", PARTS, ids=lambda cls: cls.__name__)
def test_arguments_that_miss_or_come_twice_are_named(cls: type[ac.Component]):
    given = arguments(cls)
    for name in given:
        said = message(cls, {k: v for k, v in given.items() if k != name})
        assert said and cls.__name__ in said and f"'{name}'" in said
    with pytest.raises(ParameterError, match=cls.__name__):
        cls(*[1.0] * 20)


MAKERS = [
    (cls, name)
    for cls in (*PARTS, Section)
    for name, maker in inspect.getmembers(cls, inspect.ismethod)
    if not name.startswith("_")
    and any(p.default is p.empty for p in [*inspect.signature(maker).parameters.values()] if p.kind is not p.VAR_KEYWORD)
]


OTHERS = [
    (cls, "")
    for cls in map(vars(components).__getitem__, components.__all__)
    if not issubclass(cls, ac.Component) and any(p.default is p.empty for p in inspect.signature(cls).parameters.values())
]


def test_what_has_no_arguments_takes_none():
    for cls in (components.Plane, Sliding):
        assert cls() is not None
        with pytest.raises(ParameterError, match=rf"{cls.__name__}\(3\) .*{HERE}.*too many"):
            cls(3)


@pytest.mark.parametrize(("cls", "name"), [*MAKERS, *OTHERS], ids=lambda part: getattr(part, "__name__", part))
def test_named_constructors_tell_what_is_missing_too(cls: type[Any], name: str):
    make = getattr(cls, name) if name else cls
    called = f"{cls.__name__}.{name}" if name else cls.__name__
    wanted = next(iter(inspect.signature(make).parameters))
    with pytest.raises(ParameterError, match=rf"{called}\(\) \(.*{HERE}.*'{wanted}'.* It takes {called}\({wanted}"):
        make()
    with pytest.raises(ParameterError, match="too many"):
        make(*[1.0] * 20)


def wrong_values(cls: type[ac.Component], name: str) -> Iterator[tuple[str, Any]]:
    """What no argument of this name can be, and in which way."""
    yield from (
        ("NaN", math.nan),
        ("infinite", math.inf),
        ("too large to be squared", 1e300),
        ("a word", "nonsense"),
        ("nothing known", _Nothing()),
        ("a matrix", np.ones((2, 3))),
    )
    yield from (("NaN in a vector", (math.nan, 0.0, 0.0)), ("NaN in a pair", (0.0, math.nan)))
    if name not in ("points", "values"):
        yield "a pair", (1.0, 2.0)
    full = f"{cls.__name__}.{name}"
    if name in POSITIVE and full not in SIGNED:
        yield from (("negative", -1.0), ("a negative parameter", ac.Parameter(-1.0)), ("negative in a vector", (1.0, -1.0, 1.0)))
    if not {name, full} & FLAGS:
        yield from (
            ("true", True),
            ("false", np.False_),
            ("true in a vector", (True, 0.0, 0.0)),
            ("all true", np.array([True] * 3)),
        )
    if full not in PLAIN and name not in DIRECTIONS:
        unit = ac.Parameter(1.0, "kg^3*A")
        yield from (("of another unit", unit), ("a vector of another unit", (unit, 1.0, 1.0)))


@pytest.mark.parametrize(("cls", "name"), TAKEN, ids=IDS)
def test_values_that_cannot_be_are_refused_in_words(cls: type[ac.Component], name: str):
    for how, value in wrong_values(cls, name):
        said = message(cls, {**arguments(cls), name: value})
        assert said, f"{cls.__name__}({name}={value!r}), {how}, is taken"
        assert cls.__name__ in said or name in said, said


@pytest.mark.parametrize(("cls", "name"), TAKEN, ids=IDS)
def test_what_can_be_is_no_mistake(cls: type[ac.Component], name: str):
    """The right value itself, and its copy, are taken: the refusals above are not of everything."""
    given = arguments(cls)
    if name in given:
        assert message(cls, {**given, name: copy.deepcopy(given[name])}) is None


CASES = [
    Wrong("argument of a named constructor", lambda: RigidBody.rod(1.0, (1, 0, 0), raduis=0.1), ParameterError, ("RigidBody(raduis=0.1)", HERE, "'radius'")),
    Wrong("argument of a joint that is placed", lambda: Revolute.between(World(), RigidBody.ball(1, 1, position=(1, 0, 0)), at=(1, 0, 0), axes="y"), ParameterError, ("Revolute(axes='y')", HERE, "'axis'")),
    Wrong("one too many", lambda: Damper(1.0, 2.0), ParameterError, ("Damper(1.0, 2.0)", HERE, "too many", "Damper(damping)")),
    Wrong("a weight by name", lambda: Sum(1.0, weight=2.0), ParameterError, ("Sum(weight=2.0)", HERE, "'weights'")),  # type: ignore[call-arg]
    Wrong("a weight that is none", lambda: Sum(1.0, math.nan), ParameterError, ("Sum's weight", "nan", HERE)),
    Wrong("twice", lambda: Spring(1.0, stiffness=2.0), ParameterError, ("Spring(", "multiple values for argument 'stiffness'")),
    Wrong("shapes that are none", lambda: RigidBody(1.0, (1, 1, 1), shapes=("ball",)), ParameterError, ("RigidBody's shapes", "'ball'", HERE)),  # type: ignore[arg-type]
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.title)
def test_message(case: Wrong):
    case.check()


def test_a_part_of_one_s_own_is_told_as_one_of_the_catalogue():
    class Tank(ac.Component):
        def __init__(self, area: float, *, height: float = 1.0) -> None:
            self.area, self.height = area, height

    Wrong("own", lambda: Tank(1.0, hieght=2.0), ParameterError, ("Tank(hieght=2.0)", HERE, "'height'", "height=1.0")).check()  # type: ignore[call-arg]


def test_a_part_is_copied_and_pickled_without_being_made_again():
    made = Revolute("y")
    for other in (copy.copy(made), copy.deepcopy(made), pickle.loads(pickle.dumps(made))):
        assert other is not made and other.created_at == made.created_at and np.array_equal(other.axis, made.axis)
