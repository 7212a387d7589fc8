"""Small parts that open, stick and strike, and scenes of them, for tests."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np

import acausal as ac
from acausal.language.mode_laws import ModeLaw
from acausal.parts.force import AbstractForce, Action
from acausal.parts.placement import Placement
from acausal.parts.pose import symbolic
from components import Prismatic, RigidBody, World
from components.translational import ForceSource, PositionSource, SlidingMass, TranslationalGround, TranslationalSpring


class Floor(ac.Component):
    """Keeps s >= height."""

    flange = ac.Translational.port()

    def __init__(self, restitution: ac.Scalar, height: ac.Scalar = 0.0) -> None:
        self.push, self.restitution, self.height = ac.Reaction("N"), restitution, height

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.flange.f, -self.push)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.OneSided(self.push, self.flange.s - self.height, self.restitution)


class Apart(ac.Component):
    """Keeps s_b - s_a >= 0."""

    flange_a = ac.Translational.port()
    flange_b = ac.Translational.port()

    def __init__(self, restitution: float) -> None:
        self.push, self.restitution = ac.Reaction("N"), restitution

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.flange_b.f, -self.push)
        yield ac.equal(self.flange_a.f, self.push)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.OneSided(self.push, self.flange_b.s - self.flange_a.s, self.restitution)


class Rub(ac.Component):
    """Dry friction on a belt."""

    flange = ac.Translational.port()

    def __init__(self, sliding: ac.Scalar, holding: ac.Scalar, belt: ac.Scalar = 0.0) -> None:
        self.drag, self.sliding, self.holding, self.belt = ac.Reaction("N"), sliding, holding, belt

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.flange.f, -self.drag)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.DryFriction(self.drag, ac.der(self.flange.s) - self.belt, self.sliding, self.holding)

    def dissipated_power(self) -> ac.Expression:
        return -self.drag * ac.der(self.flange.s)


class Ground(AbstractForce):
    """Keeps a point at z >= height, with friction along x."""

    point = ac.Point.port()

    def __init__(self, restitution: float, mu: float, height: ac.Scalar = 0.0) -> None:
        self.push, self.drag = ac.Reaction("N"), ac.Reaction("N")
        self.restitution, self.mu, self.height = restitution, mu, height

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.OneSided(self.push, self.point.position[2] - self.height, self.restitution)
        yield ac.DryFriction(self.drag, self.point.velocity[0], self.mu * self.push, 1.2 * self.mu * self.push)

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        force = ca.vertcat(self.drag.sx, 0, self.push.sx)
        return (Action(self.point, symbolic(placement.pose(self.point).rotation).T @ force, ca.SX.zeros(3)),)

    def potential_energy(self, placement: Placement) -> ca.SX:
        return ca.SX(0)

    def power_loss(self, placement: Placement) -> ca.SX:
        return ca.SX(0)


def bouncing(restitution: ac.Scalar, mass: float = 2.0, gravity: float = 9.81) -> ac.System:
    """A ball under gravity over a floor at zero."""
    scene = ac.System()
    scene.mass, scene.floor, scene.weight = SlidingMass(mass), Floor(restitution), ForceSource(-mass * gravity)
    scene.connect(scene.mass.flange_a, scene.floor.flange)
    scene.connect(scene.mass.flange_b, scene.weight.flange)
    return scene


def rubbing(
    mass: float, sliding: float, holding: float, belt: ac.Scalar = 0.0, force: float = 0.0, stiffness: float = 0.0
) -> ac.System:
    """A block on a belt, pushed or on a spring."""
    scene = ac.System()
    scene.mass, scene.rub, scene.push = SlidingMass(mass), Rub(sliding, holding, belt), ForceSource(force)
    scene.connect(scene.mass.flange_a, scene.rub.flange, scene.push.flange)
    if stiffness:
        scene.wall, scene.spring = TranslationalGround(), TranslationalSpring(stiffness, 0.0)
        scene.connect(scene.wall.flange, scene.spring.flange_a)
        scene.connect(scene.spring.flange_b, scene.mass.flange_b)
    return scene


def juggled(restitution: float, mass: float = 2.0, gravity: float = 9.81, swing: float = 0.1, rate: float = 9.0) -> ac.System:
    """A ball over a racket that is moved up and down."""
    scene = ac.System()
    scene.mass, scene.racket, scene.weight = SlidingMass(mass), Apart(restitution), ForceSource(-mass * gravity)
    scene.hand = PositionSource(swing * np.sin(rate * ac.time))
    scene.connect(scene.hand.flange, scene.racket.flange_a)
    scene.connect(scene.mass.flange_a, scene.racket.flange_b)
    scene.connect(scene.mass.flange_b, scene.weight.flange)
    return scene


def dragged(mu: float = 0.3) -> ac.System:
    """A block on the ground: it is held by a slide, pushed along it, and rests on one point."""
    scene = ac.System()
    scene.world, scene.x, scene.z = World(gravity=(0, 0, -9.81)), Prismatic("x"), Prismatic("z")
    scene.block, scene.ground = RigidBody.box(1.5, (0.3, 0.2, 0.1)), Ground(0.0, mu)
    scene.connect(scene.world.frame, scene.x.frame_a)
    scene.connect(scene.x.frame_b, scene.z.frame_a)
    scene.connect(scene.z.frame_b, scene.block.frame)
    scene.connect(scene.block.at((0, 0, -0.05)), scene.ground.point)
    return scene


def thrown(restitution: float, mu: float, height: ac.Scalar = 0.0) -> ac.System:
    """A rod in space that falls on one of its ends."""
    scene = ac.System()
    scene.world = World(gravity=(0, 0, -9.81))
    scene.rod = RigidBody.rod(mass=1.5, tip=(0.6, 0, 0), radius=0.03)
    scene.ground = Ground(restitution, mu, height)
    scene.connect(scene.rod.tip, scene.ground.point)
    return scene
