"""Scenes that several tests share."""

from __future__ import annotations

import numpy as np

import acausal as ac
from components import Fixed, Force, Particle, Prismatic, Revolute, RigidBody, World


class Pendulum(ac.System):
    """A rod on a hinge."""

    def __init__(self, length: float = 1.0, mass: float = 1.0, gravity=(0, 0, -9.81)) -> None:
        self.world = World(gravity)
        self.hinge = Revolute("y")
        self.rod = RigidBody.rod(mass, (0, 0, -length))
        self.connect(self.world.frame, self.hinge.frame_a)
        self.connect(self.hinge.frame_b, self.rod.frame)


class PointPendulum(ac.System):
    """A particle at the end of a massless rod."""

    def __init__(self, length: float = 1.0, mass: float = 1.0) -> None:
        self.world = World((0, 0, -9.81))
        self.hinge = Revolute("y")
        self.rod = Fixed((0, 0, -length))
        self.bob = Particle(mass)
        self.connect(self.world.frame, self.hinge.frame_a)
        self.connect(self.hinge.frame_b, self.rod.frame_a)
        self.connect(self.rod.frame_b, self.bob.point)


class SprungBody(ac.System):
    """A body on a rail, which a spring couples to a hand moving as sin t: q = a sin t + b cos w t, a = w^2 / (w^2 - 1), by its `rate` w."""

    def __init__(self) -> None:
        self.world, self.rail, self.body = World(), Prismatic("x"), RigidBody(1.0, np.eye(3))
        self.rate = ac.Parameter(10.0, "rad/s")
        self.pull = Force((-(self.rate**2) * (self.rail.q - np.sin(ac.time)), 0, 0))
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.body.frame)
        self.connect(self.pull.point, self.body.frame)


class DoublePendulum(ac.System):
    """Two uniform rods on two hinges."""

    def __init__(self, length: float = 1.0, mass: float = 1.0) -> None:
        self.world = World((0, 0, -9.81))
        self.shoulder, self.elbow = Revolute("y"), Revolute("y")
        self.upper = RigidBody.rod(mass, (0, 0, -length))
        self.lower = RigidBody.rod(mass, (0, 0, -length))
        self.connect(self.world.frame, self.shoulder.frame_a)
        self.connect(self.shoulder.frame_b, self.upper.frame)
        self.connect(self.upper.tip, self.elbow.frame_a)
        self.connect(self.elbow.frame_b, self.lower.frame)


class FourBar(ac.System):
    """Crank, coupler and rocker of exact lengths on four hinges, all turned by `R`."""

    a: Revolute
    b: Revolute
    c: Revolute
    d: Revolute

    def __init__(self, R: np.ndarray | None = None, coupler: float = 1.2, order: str = "abcd") -> None:
        R = np.eye(3) if R is None else R

        def turned(*v: float) -> tuple[float, ...]:
            return tuple(R @ np.array(v, dtype=float))

        self.world = World(turned(0, 0, -9.81))
        self.crank = RigidBody.rod(1.0, turned(0.4, 0, 0))
        self.coupler = RigidBody.rod(2.0, turned(coupler, 0, 0))
        self.rocker = RigidBody.rod(1.5, turned(0.8, 0, 0))
        for name in order:  # among equals, the graph cuts the joint that was named last
            setattr(self, name, Revolute(turned(0, 1, 0)))
        for joint, one, two in (
            (self.a, self.world.frame, self.crank.frame),
            (self.b, self.crank.tip, self.coupler.frame),
            (self.c, self.coupler.tip, self.rocker.tip),
            (self.d, self.world.at(turned(1.0, 0, 0)), self.rocker.frame),
        ):
            self.connect(one, joint.frame_a)
            self.connect(joint.frame_b, two)


def chain(count: int, joint=lambda k: Revolute("yx"[k % 2]), tip=(0.0, 0.0, -1.0), body=None) -> ac.System:
    """Bodies in a row; `joint(k)` and `body(k)` make the parts."""
    scene = ac.System()
    scene.world = World()
    scene.joints = [joint(k) for k in range(count)]
    scene.links = [body(k) if body else RigidBody(1.0, (0.1, 0.2, 0.25), np.array(tip) / 2) for k in range(count)]
    end = scene.world.frame
    for hinge, link in zip(scene.joints, scene.links, strict=True):
        scene.connect(end, hinge.frame_a)
        scene.connect(hinge.frame_b, link.frame)
        end = link.at(tip)
    return scene


def rotation(seed: int = 0) -> np.ndarray:
    """A random rotation matrix."""
    Q, R = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q if np.linalg.det(Q) > 0 else -Q


def bennett_linkage() -> ac.System:
    """Bars of 1 kg a metre and a square section of 5 cm along the sides of Bennett's linkage; three of its constraints are redundant."""
    points = np.array([(0, 0, 0), (0.5, np.sqrt(3) / 2, 0), (-1.2, 0, 0.6), (-2.0, 0, 0)])
    axes = np.array([(0, 0, 1), (np.sqrt(3) / 4, -0.25, np.sqrt(3) / 2), (-0.3, np.sqrt(3) / 2, 0.4), (0, 1, 0)])
    scene = ac.System()
    scene.world, scene.links, scene.joints = World(), [], []
    for k in range(3):
        length = np.linalg.norm(points[k + 1] - points[k])
        along = (points[k + 1] - points[k]) / length
        up = axes[k] - (axes[k] @ along) * along
        R = np.column_stack([along, np.cross(up / np.linalg.norm(up), along), up / np.linalg.norm(up)])
        moments = length / 12 * np.array([2 * 0.05**2, length**2 + 0.05**2, length**2 + 0.05**2])
        scene.links.append(RigidBody(length, R @ np.diag(moments) @ R.T, (points[k] + points[k + 1]) / 2))
    bodies = [scene.world, *scene.links, scene.world]
    for k in range(4):
        scene.joints.append(Revolute.between(bodies[k], bodies[k + 1], at=tuple(points[k]), axis=tuple(axes[k])))
    return scene
