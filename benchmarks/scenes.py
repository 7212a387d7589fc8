"""Scenes for error against time, each with a reference that no integrator of `acausal` had a part in.

The error of a run is the largest error of the observed values at the end: positions [m] and direction cosines, which every
simulator can give. The references are equations by hand integrated in extended precision (`benchmarks/peers/reference.py`), except
for Andrews' mechanism and the spring pendulum: those come from an independent program in quadruple precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import acausal as ac
from components import Particle, Revolute, RigidBody, RollingDisk, Spherical, Spring, World
from examples.andrews import Andrews


@dataclass(frozen=True, eq=False)
class Scene:
    """`system()`: a fresh scene. `start(system)`: its start values. `observed(system)`: variables, and which of their entries (in
    rows) are compared with `reference` (no,) at `end` [s]. `error_kind`: what the error means."""

    name: str
    title: str
    end: float
    error_kind: str
    system: Callable[[], Any]
    start: Callable[[Any], Mapping[Any, Any]]
    observed: Callable[[Any], list[tuple[Any, tuple[int, ...]]]]
    reference: np.ndarray

    def error(self, values: np.ndarray) -> float:
        """Largest difference from the reference."""
        return float(np.max(np.abs(np.asarray(values) - self.reference)))

    def build(self) -> Built:
        """The model, its start and the function that observes a state."""
        system = self.system()
        model = ac.build(system)
        wanted = self.observed(system)
        output = model.functions.output(*(variable for variable, _ in wanted))

        def observe(x: np.ndarray) -> np.ndarray:
            values = output.call([self.end, x, [], model.system.p_values])
            return np.concatenate([np.array(v).ravel()[list(rows)] for v, (_, rows) in zip(values, wanted, strict=True)])

        return Built(self, system, model, dict(self.start(system)), observe)


@dataclass(frozen=True, eq=False)
class Built:
    """A scene's model. `start` goes into `model.simulate`; `observe(x)` gives the compared values of a state."""

    scene: Scene
    system: Any
    model: ac.Model
    start: dict[Any, Any]
    observe: Callable[[np.ndarray], np.ndarray]

    def error(self, x: np.ndarray) -> float:
        """Error of a state at the end."""
        return self.scene.error(self.observe(x))


_IN_PLANE = (0, 2)
_ALL = tuple(range(9))


def _double_pendulum() -> ac.System:
    scene = ac.System()
    scene.world, scene.shoulder, scene.elbow = World(), Revolute("y"), Revolute("y")
    scene.upper, scene.lower = RigidBody.rod(1.0, (0, 0, -1)), RigidBody.rod(1.0, (0, 0, -1))
    scene.connect(scene.world.frame, scene.shoulder.frame_a)
    scene.connect(scene.shoulder.frame_b, scene.upper.frame)
    scene.connect(scene.upper.tip, scene.elbow.frame_a)
    scene.connect(scene.elbow.frame_b, scene.lower.frame)
    return scene


def _top() -> ac.System:
    scene = ac.System()
    scene.world, scene.socket = World(), Spherical()
    scene.top = RigidBody(0.5, (8e-4, 8e-4, 1e-3), (0, 0, 0.05))
    scene.connect(scene.world.frame, scene.socket.frame_a)
    scene.connect(scene.socket.frame_b, scene.top.frame)
    return scene


def _chain() -> ac.System:
    scene = ac.System()
    scene.world = World()
    scene.joints = [Revolute("yx"[k % 2]) for k in range(10)]
    scene.links = [RigidBody(1.0, (0.1, 0.2, 0.25), (0, 0, -0.5)) for _ in range(10)]
    ends = [scene.world.frame, *(link.at((0, 0, -1)) for link in scene.links)]
    for joint, end, link in zip(scene.joints, ends, scene.links, strict=False):
        scene.connect(end, joint.frame_a)
        scene.connect(joint.frame_b, link.frame)
    scene.middle, scene.tip = ends[5], ends[10]
    return scene


def _four_bar() -> ac.System:
    scene = ac.System()
    scene.world = World()
    scene.crank, scene.coupler, scene.rocker = (
        RigidBody.rod(mass, (length, 0, 0)) for mass, length in ((1.0, 0.4), (2.0, 1.2), (1.5, 0.8))
    )
    scene.a, scene.b, scene.c, scene.d = (Revolute("y") for _ in range(4))
    for joint, one, two in (
        (scene.a, scene.world.frame, scene.crank.frame),
        (scene.b, scene.crank.tip, scene.coupler.frame),
        (scene.c, scene.coupler.tip, scene.rocker.tip),
        (scene.d, scene.world.at((1.0, 0, 0)), scene.rocker.frame),
    ):
        scene.connect(one, joint.frame_a)
        scene.connect(joint.frame_b, two)
    return scene


def _disk() -> ac.System:
    scene = ac.System()
    scene.table, scene.contact = World(), RollingDisk(radius=0.05, axis="y")
    scene.coin = RigidBody.disk(mass=0.01, radius=0.05, axis="y")
    scene.connect(scene.table.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.coin.frame)
    return scene


def _spring_pendulum() -> ac.System:
    scene = ac.System()
    scene.world, scene.bob, scene.spring = World(), Particle(1.0), Spring(stiffness=10000.0, natural_length=1.0)
    scene.connect(scene.spring.point_a, scene.world.frame)
    scene.connect(scene.spring.point_b, scene.bob.point)
    return scene


_REFERENCES: dict[str, tuple[float, ...]] = {
    "double_pendulum": (
        -0.1549710002853186109, -0.9879190194902453537, -0.5692552798136840297, -1.8980665546380713656,
    ),
    "top": (
        -0.9749640724317695355, 0.1665553553048805278, -0.1473240343139036250, -0.2192843148594467056, -0.8300228406428806421,
        0.5128123177808292542, -0.0368706756634901894, 0.5322794356636260025, 0.8457654258987710237,
    ),
    "chain": (
        -2.1686610982730475030, 1.8594995036673927478, -3.8673999998329063586, -6.3526109685157746035, 3.6076503833986012322,
        -5.7938625151674442758,
    ),
    "four_bar": (
        0.2935635161915390242, -0.2716992122941470825, 0.8579597852770525564, 0.7872893860591916962,
    ),
    "disk": (
        -0.0770991427552550480, -0.1957365437322305650, 0.0476605392349651447, 0.5048534462328297425, -0.7006008569372016255,
        0.5042632616854950194, -0.1496050821849969490, -0.6463507092329361080, -0.7482306329324540495, 0.8501419394496754250,
        0.3023064669055877522, -0.4311258318122508191,
    ),
    "andrews": (
        -0.74407210318524877872, 0.97075598992699029092, 0.99357766481333595181, 0.99302161554212574616, 0.86479194639229257233,
        0.10584241019061750776, 0.49157191485557178102, 0.66809932290152823821, 0.24006834031348057961, 0.11315221599278660723,
        0.1179324852027913755, 0.50213035105939390904, 0.99438291628780563395, 0.8708369838983795062,
    ),
    "spring_pendulum": (
        0.3442353236548982647, -0.94182182549807786119,
    ),
}  # fmt: skip


def _quaternion(axis: int, angle: float) -> tuple[float, ...]:
    """Of a turn about a coordinate axis, scalar first."""
    turn = [math.cos(angle / 2), 0.0, 0.0, 0.0]
    turn[1 + axis] = math.sin(angle / 2)
    return tuple(turn)


SCENES = (
    Scene(
        "double_pendulum",
        "Planar double pendulum of two rods, 10 s",
        10.0,
        "position of elbow and tip [m]",
        _double_pendulum,
        lambda s: {s.shoulder.q: 0.6, s.elbow.q: 0.0},
        lambda s: [(s.upper.tip.position, _IN_PLANE), (s.lower.tip.position, _IN_PLANE)],
        np.array(_REFERENCES["double_pendulum"]),
    ),
    Scene(
        "top",
        "Lagrange's top, 60 rad/s, 10 s",
        10.0,
        "orientation (direction cosines)",
        _top,
        lambda s: {s.socket.q: _quaternion(0, 0.4), s.socket.v: (0.0, 0.0, 60.0)},
        lambda s: [(s.top.frame.rotation, _ALL)],
        np.array(_REFERENCES["top"]),
    ),
    Scene(
        "chain",
        "Chain of ten links, hinges about y and x in turn, 5 s",
        5.0,
        "position of the middle and the end [m]",
        _chain,
        lambda s: {joint.q: 0.3 for joint in s.joints},
        lambda s: [(s.middle.position, (0, 1, 2)), (s.tip.position, (0, 1, 2))],
        np.array(_REFERENCES["chain"]),
    ),
    Scene(
        "four_bar",
        "Four-bar with a turning crank, 10 s",
        10.0,
        "position of the tips of crank and rocker [m]",
        _four_bar,
        lambda s: {s.a.q: -0.5, s.a.v: 3.0, s.d.q: ac.near(-1.0)},
        lambda s: [(s.crank.tip.position, _IN_PLANE), (s.rocker.tip.position, _IN_PLANE)],
        np.array(_REFERENCES["four_bar"]),
    ),
    Scene(
        "andrews",
        "Andrews' squeezing mechanism, 0.05 s",
        0.05,
        "orientation of the seven bodies (direction cosines)",
        Andrews,
        lambda s: s.start(),
        lambda s: [
            *((body.frame.rotation, (0,)) for body in (s.K1, s.K2, s.K3, s.K4, s.K5, s.K6, s.K7)),
            *((body.frame.rotation, (3,)) for body in (s.K1, s.K2, s.K3, s.K4, s.K5, s.K6, s.K7)),
        ],
        np.array(_REFERENCES["andrews"]),
    ),
    Scene(
        "disk",
        "Coin rolling without slipping, 10 s",
        10.0,
        "position of the centre [m] and orientation (direction cosines)",
        _disk,
        lambda s: {s.contact.q: (0.0, 0.3, 0.0, 0.0, 0.0), s.contact.v: (0.2, 12.0, 0.5)},
        lambda s: [(s.coin.frame.position, (0, 1, 2)), (s.coin.frame.rotation, _ALL)],
        np.array(_REFERENCES["disk"]),
    ),
    Scene(
        "spring_pendulum",
        "Pendulum on a stiff spring (10 kN/m, 1 kg, 1 m), 10 s",
        10.0,
        "position [m]",
        _spring_pendulum,
        lambda s: {s.bob.point.position: (1.0, 0.0, 0.0)},
        lambda s: [(s.bob.point.position, _IN_PLANE)],
        np.array(_REFERENCES["spring_pendulum"]),
    ),
)
