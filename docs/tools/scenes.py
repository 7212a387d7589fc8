"""A short script for each kind of part: what its page shows and runs.

A file in `docs/scenes` whose first line says "# Shows A, B" is the script of the parts A and B. Without one it is made from the line of code in
the docstring, by the connectors that the part has. Scripts write their picture to `picture.png`.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path

from tools.catalogue import Kind

import components
from acausal.language.component import declared
from acausal.language.connector import Connector, Electrical, Frame, Point, Rotational, Signal, Translational
from acausal.parts.contact import AbstractContact
from acausal.parts.field import AbstractField
from acausal.parts.joint import AbstractJoint
from acausal.parts.potential import AbstractPotential
from components.contacts.laws import AbstractTouchingLaw
from components.geometry.curves import AbstractCurve
from components.geometry.shapes import AbstractShape
from components.geometry.surfaces import AbstractSurface

FOLDER = Path(__file__).parents[1] / "scenes"


def script_of(kind: Kind) -> str:
    """The complete script, imports included; none for what is no part. Raises `LookupError` for a part of which no template suits: write a file."""
    own = own_script(kind)
    body = "" if own else _body(kind)
    return own or (complete(body) if body else "")


def own_script(kind: Kind) -> str:
    """What `docs/scenes` has for it; empty where it has none."""
    for path in sorted(FOLDER.glob("*.py")):
        first, script = path.read_text(encoding="utf-8").split("\n", 1)
        if kind.name in re.split(r"\W+", first.removeprefix("# Shows")):
            return script.strip() + "\n"
    return ""


def complete(body: str) -> str:
    """A script with the imports that its names ask for."""
    names = [n for n in components.__all__ if re.search(rf"\b{n}\(|\b{n}\.", body)]
    lines = [f"import {long} as {short}" for long, short in (("casadi", "ca"), ("numpy", "np")) if f"{short}." in body]
    lines += [""] * bool(lines) + ["import acausal as ac", f"from components import {', '.join(sorted(names))}"]
    return "\n".join(lines) + "\n\n" + body.strip() + "\n"


def _body(kind: Kind) -> str:
    cls, line = kind.cls, kind.example.splitlines()[0].split(";")[0] if kind.example else f"{kind.name}()"
    for base, template in _OF_A_PART.items():
        if issubclass(cls, base):
            return "scene = ac.System()\n" + template.replace("VALUE", line.split("  #")[0])
    if not kind.is_part:
        return ""
    if not line.startswith("scene."):
        line = f"scene.part = {line}"
    name = line.split(" =")[0].removeprefix("scene.")
    connectors = {name: type(getattr(cls, name)) for name in declared(cls, Connector)}
    for fits, template in _TEMPLATES:
        if fits(cls, connectors):
            start = _velocity(cls) if issubclass(cls, AbstractJoint) else ""
            inputs = (
                f", inputs={{scene.{name}.{next(iter(inspect.signature(cls).parameters))}: 0.1}}" if "ac.Input(" in line else ""
            )
            text = template.replace("START", f", {{scene.PART.v: {start}}}" if start else "").replace("INPUTS", inputs)
            return "scene = ac.System()\n" + text.replace("PART", name).replace("LINE", line)
    raise LookupError(f"{kind.name} has the connectors {sorted(connectors)}: write a file in docs/scenes that shows it.")


def _velocity(cls: type[AbstractJoint]) -> str:
    values = [(0.5, -0.4, 0.3, 0.2, -0.1, 0.1)[k % 6] for k in range(cls.v.size)]
    return repr(values[0]) if len(values) == 1 else repr(tuple(values)) if values else ""


def _only(*names: str, of: type) -> Callable[[type, dict[str, type]], bool]:
    return lambda cls, kinds: set(kinds) == set(names) and all(k is of for k in kinds.values())


_JOINT = """
scene.world = World()
LINE
scene.body = RigidBody.box(mass=1.0, size=(0.4, 0.2, 0.1))
scene.connect(scene.world.frame, scene.PART.frame_a)
scene.connect(scene.PART.frame_b, scene.body.at((-0.2, 0.1, 0.1)))

model = ac.build(scene)
print(model)
run = model.simulate(2.0START)
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0))
"""
_CONTACT = """
scene.world = World()
LINE
scene.body = RigidBody.box(mass=1.0, size=(0.1, 0.1, 0.1))
scene.connect(scene.world.frame, scene.PART.frame_a)
scene.connect(scene.PART.frame_b, scene.body.frame)

model = ac.build(scene)
print(model)
run = model.simulate(1.0START)
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0))
"""
_CONSTRAINT = """
scene.world = World()
scene.free = Planar(normal="z")
scene.body = RigidBody.box(mass=1.0, size=(0.4, 0.2, 0.1))
LINE
scene.connect(scene.world.frame, scene.free.frame_a, scene.PART.frame_a)
scene.connect(scene.free.frame_b, scene.body.frame, scene.PART.frame_b)

model = ac.build(scene)
print(model)
run = model.simulate(2.0, {scene.free.v: (0.5, 0.0, 1.0)})
print(run)
run.picture("picture.png", times=(0.0, 0.5, 1.0))
"""
_LINE_FORCE = """
scene.world = World()
scene.hinge = Revolute(axis="y")
scene.arm = RigidBody.rod(mass=1.0, tip=(0.8, 0, 0))
LINE
scene.connect(scene.world.frame, scene.hinge.frame_a)
scene.connect(scene.hinge.frame_b, scene.arm.frame)
scene.connect(scene.world.at((0, 0, 0.6)), scene.PART.point_a)
scene.connect(scene.PART.point_b, scene.arm.tip)

model = ac.build(scene)
print(model)
run = model.simulate(2.0)
print(run)
print(f"energy accounted for to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.3, 0.6))
"""
_POTENTIAL = """
scene.world = World()
LINE
scene.body = RigidBody.box(mass=20.0, size=(0.4, 0.2, 0.1))
scene.connect(scene.world.frame, scene.PART.frame_a)
scene.connect(scene.PART.frame_b, scene.body.at((-0.2, 0, 0.05)))

model = ac.build(scene)
print(model)
run = model.simulate(0.5)
print(run)
print(f"energy accounted for to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5))
"""
_ON_A_BODY = """
scene.world = World()
scene.body = RigidBody.ellipsoid(mass=0.5, semi_axes=(0.15, 0.08, 0.08))
LINE
scene.connect(scene.PART.CONNECTOR, scene.body.frame)

model = ac.build(scene)
print(model)
run = model.simulate(0.8, {scene.body.frame.velocity: (8.0, 0.0, 3.0), scene.body.frame.angular_velocity: (0.0, 6.0, 0.0)})
print(run)
print(f"energy accounted for to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.2, 0.4, 0.6, 0.8))
"""
_FIELD = """
scene.world = World(gravity=None)
LINE
scene.body = RigidBody.box(mass=1.0, size=(0.3, 0.2, 0.1))

model = ac.build(scene)
print(model)
run = model.simulate(2.0, {scene.body.frame.position: (1.0, 0.0, 0.0), scene.body.frame.velocity: (0.0, 1.0, 0.0)})
print(run)
print(f"energy accounted for to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0))
"""
_SHAFT = """
scene.motor = TorqueSource(lambda t: 0.02 * np.sin(3 * t))
scene.rotor, scene.load = Inertia(0.01), Inertia(0.02)
LINE
scene.connect(scene.motor.flange, scene.rotor.flange_a)
scene.connect(scene.rotor.flange_b, scene.PART.flange_a)
scene.connect(scene.PART.flange_b, scene.load.flange_a)

model = ac.build(scene)
print(model)
run = model.simulate(5.0)
print(run)
run.plot(scene.rotor.w, scene.load.w, path="picture.png")
"""
_SHAFT_END = """
scene.rotor, scene.bearing, scene.housing = Inertia(0.01), RotationalDamper(damping=0.05), RotationalGround()
LINE
scene.connect(scene.PART.flange, scene.rotor.flange_a)
scene.connect(scene.rotor.flange_b, scene.bearing.flange_a)
scene.connect(scene.bearing.flange_b, scene.housing.flange)

model = ac.build(scene)
print(model)
run = model.simulate(2.0INPUTS)
print(run)
run.plot(scene.rotor.flange_a.phi, scene.rotor.w, path="picture.png")
"""
_LINE = """
scene.push = ForceSource(lambda t: 0.5 * np.sin(3 * t))
scene.cart, scene.load = SlidingMass(1.0), SlidingMass(2.0)
LINE
scene.connect(scene.push.flange, scene.cart.flange_a)
scene.connect(scene.cart.flange_b, scene.PART.flange_a)
scene.connect(scene.PART.flange_b, scene.load.flange_a)

model = ac.build(scene)
print(model)
run = model.simulate(5.0)
print(run)
run.plot(scene.cart.v, scene.load.v, path="picture.png")
"""
_LINE_END = """
scene.cart, scene.friction, scene.wall = SlidingMass(1.0), TranslationalDamper(damping=5.0), TranslationalGround()
LINE
scene.connect(scene.PART.flange, scene.cart.flange_a)
scene.connect(scene.cart.flange_b, scene.friction.flange_a)
scene.connect(scene.friction.flange_b, scene.wall.flange)

model = ac.build(scene)
print(model)
run = model.simulate(2.0INPUTS)
print(run)
run.plot(scene.cart.flange_a.s, scene.cart.v, path="picture.png")
"""
_TWO_PINS = """
scene.battery, scene.series, scene.store, scene.ground = VoltageSource(5.0), Resistor(50.0), Capacitor(1e-4), Ground()
LINE
scene.connect(scene.battery.pin_a, scene.series.pin_a)
scene.connect(scene.series.pin_b, scene.PART.pin_a)
scene.connect(scene.PART.pin_b, scene.store.pin_a)
scene.connect(scene.store.pin_b, scene.battery.pin_b, scene.ground.pin)

model = ac.build(scene)
print(model)
run = model.simulate(0.05)
print(run)
run.plot(scene.store.v, path="picture.png")
"""
_SIGNAL_OUT = """
scene.sum = Integrator()
LINE
scene.connect(scene.PART.output, scene.sum.input)

model = ac.build(scene)
print(model)
run = model.simulate(3.0)
print(run)
run.plot(scene.PART.output.value, scene.sum.x, path="picture.png")
"""
_SIGNAL_THROUGH = """
scene.source, scene.sum = TimeFunction(lambda t: np.sin(3 * t)), Integrator()
LINE
scene.connect(scene.source.output, scene.PART.input)
scene.connect(scene.PART.output, scene.sum.input)

model = ac.build(scene)
print(model)
run = model.simulate(3.0)
print(run)
run.plot(scene.source.output.value, scene.PART.output.value, path="picture.png")
"""


_CURVE = """
scene.world = World()
scene.wire = PointOnCurve(VALUE)
scene.bead = Particle(mass=0.1)
scene.connect(scene.world.at((0, 0, 0), rotation=("x", np.pi / 3)), scene.wire.frame_a)
scene.connect(scene.wire.frame_b, scene.bead.point)

model = ac.build(scene)
print(model)
run = model.simulate(1.0, {scene.wire.v: 0.5})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0))
"""
_SURFACE = """
scene.world = World()
scene.slope = PointOnSurface(VALUE)
scene.bead = Particle(mass=0.1)
scene.connect(scene.world.frame, scene.slope.frame_a)
scene.connect(scene.slope.frame_b, scene.bead.point)

model = ac.build(scene)
print(model)
run = model.simulate(1.0, {scene.bead.point.position: ac.near((0.3, 0.1, 0.2)), scene.slope.v: (0.5, -0.4)})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0))
"""
_SHAPE = """
scene.world = World()
scene.contact = Touching(VALUE, Plane())
scene.body = RigidBody(mass=1.0, inertia=(0.02, 0.03, 0.03), rotation=("x", 1.2))
scene.connect(scene.world.frame, scene.contact.frame_a)
scene.connect(scene.contact.frame_b, scene.body.frame)

model = ac.build(scene)
print(model)
run = model.simulate(1.0, {scene.body.frame.angular_velocity: ac.near((0.5, 0.4, 2.0))})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.3, 0.6))
"""
_LAW = _SHAPE.replace("Touching(VALUE, Plane())", "Touching(Ellipsoid((0.2, 0.15, 0.1)), Plane(), VALUE)").replace(
    'RigidBody(mass=1.0, inertia=(0.02, 0.03, 0.03), rotation=("x", 1.2))',
    'RigidBody.ellipsoid(mass=1.0, semi_axes=(0.2, 0.15, 0.1), rotation=("x", 1.2))',
)
_OF_A_PART: dict[type, str] = {AbstractShape: _SHAPE, AbstractTouchingLaw: _LAW, AbstractCurve: _CURVE, AbstractSurface: _SURFACE}


def _two_frames(cls: type, kinds: dict[str, type]) -> bool:
    return {n for n, k in kinds.items() if issubclass(k, Frame)} == {"frame_a", "frame_b"}


_TEMPLATES: tuple[tuple[Callable[[type, dict[str, type]], bool], str], ...] = (
    (lambda cls, kinds: issubclass(cls, AbstractPotential), _POTENTIAL),
    (lambda cls, kinds: issubclass(cls, AbstractField), _FIELD),
    (lambda cls, kinds: issubclass(cls, AbstractJoint) and issubclass(cls, AbstractContact), _CONTACT),
    (lambda cls, kinds: issubclass(cls, AbstractJoint) and _two_frames(cls, kinds), _JOINT),
    (_two_frames, _CONSTRAINT),
    (_only("point_a", "point_b", of=Point), _LINE_FORCE),
    (_only("point", of=Point), _ON_A_BODY.replace("CONNECTOR", "point")),
    (_only("point", of=Frame), _ON_A_BODY.replace("CONNECTOR", "point")),
    (_only("frame", of=Frame), _ON_A_BODY.replace("CONNECTOR", "frame")),
    (_only("flange_a", "flange_b", of=Rotational), _SHAFT),
    (_only("flange", of=Rotational), _SHAFT_END),
    (_only("flange_a", "flange_b", of=Translational), _LINE),
    (_only("flange", of=Translational), _LINE_END),
    (_only("pin_a", "pin_b", of=Electrical), _TWO_PINS),
    (_only("output", of=Signal), _SIGNAL_OUT),
    (_only("input", "output", of=Signal), _SIGNAL_THROUGH),
)
