"""Motions that are hard to integrate, each with a reference that no integrator of this package had a part in.

A reference is a closed form (evaluated with mpmath), a published benchmark, or comes from "quadruple precision": equations written
down by hand in other coordinates than the scene's, integrated in binary128 by the extrapolated midpoint rule of order 16 to 24, all
shown digits the same with two step sizes.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, final

import casadi as ca
import mpmath
import numpy as np

import acausal as ac
from acausal.parts.force import AbstractLineForce
from acausal.simulate.trajectory import Trajectory
from components import (
    Fixed,
    Force,
    Free,
    NonlinearSpring,
    Particle,
    Prismatic,
    Revolute,
    RigidBody,
    RollingDisk,
    RollingEllipsoid,
    Spherical,
    Spring,
    SpringDamper,
    Universal,
    World,
)  # fmt: skip
from examples.andrews import REFERENCE, Andrews
from tests.scenes import DoublePendulum, PointPendulum, bennett_linkage

G = 9.81
Start = Mapping[Any, Any]


@dataclass(frozen=True)
class HardCase:
    """A scene, how it starts, and what must be `seen` (n,) of it at the `end` [s].

    `start` has every value that matters, velocities at rest too: its entries are nudged to find how the motion magnifies errors.
    """

    scene: ac.System
    start: Start
    end: float
    seen: Callable[[Trajectory], np.ndarray]
    reference: np.ndarray
    rough: Start = field(default_factory=dict)
    """Start values that only choose the branch of a loop."""
    atol: float = 1.0
    """Absolute tolerance, as a multiple of rtol."""
    nudge: float = 1e-9
    """Relative size of the perturbation in `magnification`."""
    known_magnification: float | None = None
    """From the closed form, where a run is not accurate enough to measure it."""

    @functools.cached_property
    def model(self) -> ac.Model:
        """The scene, reduced."""
        return ac.build(self.scene)

    def simulate(self, rtol: float, start: Start | None = None, t0: float = 0.0, **options: Any) -> Trajectory:
        """From `t0` to the end."""
        given = {**self.rough, **(self.start if start is None else start)}
        return self.model.simulate(self.end, given, rtol=rtol, atol=self.atol * rtol, t0=t0, samples=2, **options)

    def error(self, run: Trajectory) -> float:
        """Largest difference from the reference."""
        return float(np.max(np.abs(self.seen(run) - self.reference)))

    @functools.cached_property
    def magnification(self) -> float:
        """By how much an error made on the way, of the size of the tolerance, has grown or shrunk at the end.

        An error of the size of the tolerance is atol + rtol |value|. It is put on all entries of `start` at the
        beginning, at a third and at two thirds of the time, with four patterns of signs.
        """
        if self.known_magnification is not None:
            return self.known_magnification
        run = self.simulate(1e-13)
        largest = 0.0
        for part in range(3):
            t0 = self.end * part / 3
            there = run.at(t0)
            here = {key: there[key][0] for key in (*self.start, *self.rough)}
            rough = {key: ac.near(here.pop(key)) for key in self.rough}
            plain = self.seen(self.simulate(1e-13, {**rough, **here}, t0))
            for seed in range(4):
                signs = np.random.default_rng(seed)
                moved = {key: _nudged(value, self.nudge, self.atol, signs) for key, value in here.items()}
                change = np.max(np.abs(self.seen(self.simulate(1e-13, {**rough, **moved}, t0)) - plain))
                largest = max(largest, float(change) / self.nudge)
        return largest


def _nudged(value: np.ndarray, size: float, least: float, signs: np.random.Generator) -> np.ndarray:
    """The value with every entry moved by size * (least + largest entry), up or down; a leading quaternion stays one."""
    moved = value + size * (least + np.max(np.abs(value))) * signs.choice((-1.0, 1.0), np.shape(value))
    if np.size(value) in (4, 6, 7) and abs(np.linalg.norm(value[:4]) - 1) < 1e-9:
        moved[:4] /= np.linalg.norm(moved[:4])
    return moved


CASES: dict[str, Callable[[], HardCase]] = {}


def hard_case(make: Callable[[], HardCase]) -> Callable[[], HardCase]:
    """Enter a case in `CASES` under its function's name; it is made once."""
    cached = functools.cache(make)
    CASES[make.__name__] = cached
    return cached


def last(*variables: ac.Expression) -> Callable[[Trajectory], np.ndarray]:
    """The last values of variables, one after the other."""
    return lambda run: np.concatenate([np.ravel(run[v][-1]) for v in variables])


def digits(*numbers: str | float) -> np.ndarray:
    """Numbers, rounded once."""
    return np.array([float(n) for n in numbers])


@hard_case
def simple_pendulum() -> HardCase:
    """IFToMM benchmark A01, 10 s; quadruple precision."""
    scene = PointPendulum()
    return HardCase(
        scene, {scene.hinge.q: np.pi / 2, scene.hinge.v: 0.0}, 10.0, last(scene.bob.point.position),
        digits("-0.27508746257611580151", 0, "-0.96141920509912536714"),
    )  # fmt: skip


@hard_case
def pendulum_through_upright() -> HardCase:
    """Goes over the top so slowly that it nearly stays there, four times in 10 s; elliptic functions."""
    scene = PointPendulum()
    speed, end = 2 * np.sqrt(G) * (1 + 1e-6), 10.0
    with mpmath.workdps(40):
        modulus = 4 * mpmath.mpf(G) / mpmath.mpf(speed) ** 2
        argument = mpmath.mpf(speed) * end / 2
        sn, cn = (mpmath.ellipfun(kind, argument, m=modulus) for kind in ("sn", "cn"))
        x, z = -2 * sn * cn, 2 * sn**2 - 1
        # sin(angle / 2) = sn; cn carries the sign of cos(angle / 2), so this holds over all turns
    return HardCase(
        scene, {scene.hinge.q: 0.0, scene.hinge.v: speed}, end, last(scene.bob.point.position), digits(float(x), 0, float(z))
    )


@hard_case
def andrews() -> HardCase:
    """Andrews' squeezing mechanism, 0.03 s: the seven angles; quadruple precision (the test set's digits end at 1.4e-9)."""
    scene = Andrews()
    start = scene.start()
    joints = [getattr(scene, name) for name in REFERENCE]
    rough = {joint.q: start[joint.q] for joint in joints[1:]} | {joint.v: ac.near(0.0) for joint in joints[1:]}
    exact = {scene.O.q: start[scene.O.q], scene.O.v: 0.0}
    return HardCase(scene, exact, 0.03, last(*(joint.q for joint in joints)), digits(*REFERENCE.values()), rough)


@hard_case
def heavy_top() -> HardCase:
    """Lie-group benchmark of Bruls, Cardona and Arnold, 150 rad/s, 2 s; quadruple precision."""
    scene = ac.System()
    scene.world, scene.socket = World(), Spherical()
    scene.body = RigidBody(15.0, (0.234375, 0.46875, 0.234375), (0, 1, 0))
    scene.connect(scene.world.frame, scene.socket.frame_a)
    scene.connect(scene.socket.frame_b, scene.body.frame)
    start = {scene.socket.q: (1.0, 0, 0, 0), scene.socket.v: (0, 150.0, -4.61538)}
    return HardCase(
        scene, start, 2.0, last(scene.body.centre.position),
        digits("-0.1504168227456418402816", "-0.7241655916368957529361", "-0.6730222695604439681124"),
    )  # fmt: skip


@hard_case
def fast_top() -> HardCase:
    """A symmetric top at 1e4 rad/s, let go at rest; position of a point off its axis after 0.2 s; elliptic functions."""
    mass, arm, side, along, tilt, spin, end = 2.0, 0.3, 0.05, 0.03, 0.6, 1e4, 0.2
    scene = ac.System()
    scene.world, scene.socket = World(), Spherical()
    scene.body = RigidBody(mass, (side, side, along), (0, 0, arm))
    scene.connect(scene.world.frame, scene.socket.frame_a)
    scene.connect(scene.socket.frame_b, scene.body.frame)
    q = (np.cos(tilt / 2), np.sin(tilt / 2), 0, 0)
    rim = (0.1, 0.0, 0.3)
    return HardCase(
        scene, {scene.socket.q: q, scene.socket.v: (0, 0, spin)}, end, last(scene.body.at(rim).position),
        _lagrange_top(mass, arm, side, along, q, spin, end, rim),
    )  # fmt: skip


def _lagrange_top(m: float, arm: float, side: float, along: float, q: Any, spin: float, t: float, point: Any) -> np.ndarray:
    """Where `point` of a symmetric top is at `t`; at the start its axis rests at the quaternion q = (cos, sin, 0, 0) of half the tilt.

    With u = cos(tilt): u'^2 = (u0 - u) (beta (1 - u^2) - a^2 (u0 - u)), whose cubic has the roots low < u0 < high.
    """
    with mpmath.workdps(30):
        c, s = mpmath.mpf(float(q[0])), mpmath.mpf(float(q[1]))
        u0 = (c * c - s * s) / (c * c + s * s)
        A = mpmath.mpf(side) + mpmath.mpf(m) * mpmath.mpf(arm) ** 2
        a, beta = mpmath.mpf(along) * spin / A, 2 * mpmath.mpf(m) * mpmath.mpf(G) * mpmath.mpf(arm) / A
        # beta u^2 - a^2 u + a^2 u0 - beta = 0, the small root without cancellation
        high = (a**2 + mpmath.sqrt(a**4 - 4 * beta * (a**2 * u0 - beta))) / (2 * beta)
        low = (a**2 * u0 - beta) / (beta * high)
        pace, k = mpmath.sqrt(beta * (high - low)) / 2, (u0 - low) / (high - low)

        def u(time: Any) -> Any:
            cn, dn = (mpmath.ellipfun(kind, pace * time, m=k) for kind in ("cn", "dn"))
            return low + (u0 - low) * (cn / dn) ** 2

        def total(f: Callable[[Any], Any]) -> Any:
            """Integral of f(u) from 0 to t: whole periods, by the trapezoidal rule, and the rest."""
            period = 2 * mpmath.ellipk(k) / pace
            whole = mpmath.floor(t / period)
            one = sum(f(u(period * j / 16)) for j in range(16)) * period / 16
            return whole * one + mpmath.quad(lambda time: f(u(time)), [whole * period, t])

        turned = total(lambda v: a * (u0 - v) / (1 - v * v))
        own = spin * t - total(lambda v: v * a * (u0 - v) / (1 - v * v))
        tilt = mpmath.acos(u(t))
        x, y, z = (mpmath.mpf(p) for p in point)
        x, y = x * mpmath.cos(own) - y * mpmath.sin(own), x * mpmath.sin(own) + y * mpmath.cos(own)
        y, z = y * mpmath.cos(tilt) - z * mpmath.sin(tilt), y * mpmath.sin(tilt) + z * mpmath.cos(tilt)
        x, y = x * mpmath.cos(turned) - y * mpmath.sin(turned), x * mpmath.sin(turned) + y * mpmath.cos(turned)
        return np.array([float(x), float(y), float(z)])


def free_body(end: float, seen: Callable[[Any], Callable[[Trajectory], np.ndarray]], reference: np.ndarray) -> HardCase:
    """Dzhanibekov's body: turns about its middle axis, nearly; `seen` gets the scene."""
    scene = ac.System()
    scene.world, scene.free, scene.body = World(None), Free(), RigidBody(1.0, (1.0, 2.0, 3.0))
    scene.connect(scene.world.frame, scene.free.frame_a)
    scene.connect(scene.free.frame_b, scene.body.frame)
    start = {scene.free.q: (1.0, 0, 0, 0, 0, 0, 0), scene.free.v: (0.001, 5.0, 0.001, 0, 0, 0)}
    return HardCase(scene, start, end, seen(scene), reference)


@hard_case
def dzhanibekov() -> HardCase:
    """A free body that flips about its middle axis, 100 s: its axes in the world; quadruple precision."""
    w, x, y, z = digits(
        "-0.0004230317082643683070071", "0.970525493439945903027", "0.00004679345608832376899997", "-0.2409981025603641390415"
    )
    R = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return free_body(100.0, lambda scene: last(scene.body.frame.rotation), np.ravel(R))


@hard_case
def dzhanibekov_in_a_flip() -> HardCase:
    """The same body in the middle of a flip, 50 s: its angular velocity in its own axes; quadruple precision."""
    reference = digits("4.74650758425484643565", "1.571835472500611898823", "2.740397553116991219398")
    return free_body(50.0, lambda scene: lambda run: run[scene.free.v][-1, :3], reference)


def rattleback(end: float, reference: np.ndarray) -> HardCase:
    """The angular velocity of the stone of Kane and Levinson, in the size of Kuypers."""
    scene, contact = rattleback_scene()
    return HardCase(scene, {contact.q: (1.0, 0, 0, 0, 0, 0), contact.v: (0.01, -0.02, -2.0)}, end, last(contact.v), reference)


@hard_case
def rattleback_first() -> HardCase:
    """Rattleback after its first reversal, 10 s: angular velocity; quadruple precision."""
    return rattleback(10.0, digits("-0.0756757740541897868", "-0.00303516540791327876", "1.99955962290572809"))


@hard_case
def rattleback_late() -> HardCase:
    """Rattleback after five reversals and much wobbling, 40 s: angular velocity; quadruple precision."""
    return rattleback(40.0, digits("-2.74876649932372565", "0.057979221672436821", "0.60382339282694925"))


REVERSALS = (1.14629001, 31.0143285, 31.07414082, 31.12775914, 36.33654042, 41.62965833)
"""Times [s] at which the rattleback's spin changes sign; quadruple precision, interpolated to about 3e-8."""


def rattleback_scene() -> tuple[ac.System, RollingEllipsoid]:
    """An ellipsoid whose principal axes of inertia are turned by 0.1 about the vertical."""
    scene = ac.System()
    scene.world = World()
    c, s = np.cos(0.1), np.sin(0.1)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    contact = scene.contact = RollingEllipsoid((0.2, 0.03, 0.02))
    scene.stone = RigidBody(1.0, R @ np.diag([0.0002, 0.0016, 0.0017]) @ R.T, (0, 0, -0.001))
    scene.connect(scene.world.frame, contact.frame_a)
    scene.connect(contact.frame_b, scene.stone.frame)
    return scene, contact


@hard_case
def disk_nearly_flat() -> HardCase:
    """A disk falls, rolls at a tilt of 0.0019 rad, rises, five times in 1 s: its centre and its axis; quadruple precision."""
    scene = ac.System()
    scene.world, scene.disk, scene.contact = World(), RigidBody.disk(1.0, 0.3, axis="y"), RollingDisk(0.3, "y")
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.disk.frame)
    start = {scene.contact.q: (0, 2 * np.arcsin(0.6), 0, 0, 0), scene.contact.v: (0, 0.2, 0)}

    def seen(run: Trajectory) -> np.ndarray:
        return np.append(run[scene.disk.frame.position][-1, :2], run[scene.disk.frame.rotation][-1, [0, 2], 1])

    return HardCase(
        scene, start, 1.0, seen,
        digits("0.01591507038573584320", "-0.05601049957916021121", "0.11359019839151283268", "0.98870997664405165879"),
    )  # fmt: skip


@hard_case
def bennett() -> HardCase:
    """Bennett's linkage, three redundant constraints, 10 s: the centres of mass; quadruple precision."""
    scene = bennett_linkage()
    reference = digits(
        "0.0076167635158221903575", "-0.49994198154740343944", 0, "-0.73671384625198859713", "-0.49994198154740343722",
        "-0.42968961227646673408", "-1.7443306097678104599", 0, "-0.42968961227646683063",
    )  # fmt: skip
    first = scene.joints[0]
    return HardCase(scene, {first.q: 0.0, first.v: 0.0}, 10.0, last(*(link.centre.position for link in scene.links)), reference)


@hard_case
def four_bars_through_singularity() -> HardCase:
    """IFToMM benchmark A02 with two cells, 10 s: the tip of the first crank; quadruple precision, all cranks staying parallel."""
    scene = ac.System()
    scene.world = World((0, -G, 0))
    scene.cranks = [RigidBody.rod(1.0, (0, 1, 0)) for _ in range(3)]
    scene.bars = [RigidBody.rod(1.0, (1, 0, 0)) for _ in range(2)]
    scene.feet, scene.heads = [Revolute("z") for _ in range(3)], [Revolute("z") for _ in range(4)]
    ends = [(scene.feet[k], scene.world.at((k, 0, 0)), scene.cranks[k].frame) for k in range(3)]
    for k in range(2):
        ends += [
            (scene.heads[2 * k], scene.cranks[k].tip, scene.bars[k].frame),
            (scene.heads[2 * k + 1], scene.bars[k].tip, scene.cranks[k + 1].tip),
        ]
    for joint, a, b in ends:
        scene.connect(a, joint.frame_a)
        scene.connect(joint.frame_b, b)
    reference = digits("0.3284581115408154981985", "0.9445185381786009205888", 0)
    rough = {foot.q: ac.near(0.0) for foot in scene.feet[1:]}  # folded cells close, too
    start = {scene.feet[0].q: 0.0, scene.feet[0].v: -1.0}
    return HardCase(scene, start, 10.0, last(scene.cranks[0].tip.position), reference, rough)


def spring_pendulum(stiffness: float, length: float, end: float, reference: np.ndarray, natural: float = 1.0) -> HardCase:
    """A particle of 1 kg on a spring, let go at a height of 0; its position in natural lengths of the spring."""
    scene = ac.System()
    scene.world, scene.bob, scene.spring = World(), Particle(1.0), Spring(stiffness, natural)
    scene.connect(scene.world.frame, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.bob.point)
    start = {scene.bob.point.position: (length, 0, 0), scene.bob.point.velocity: (0.0, 0, 0)}
    return HardCase(scene, start, end, lambda run: run[scene.bob.point.position][-1] / natural, reference, atol=min(1.0, natural))


@hard_case
def spring_1e4() -> HardCase:
    """Spring pendulum of 1e4 N/m, undamped, 10 s; quadruple precision."""
    return spring_pendulum(1e4, 1.0, 10.0, digits("0.3442353236548982647", 0, "-0.94182182549807786119"))


@hard_case
def spring_1e8() -> HardCase:
    """Spring pendulum of 1e8 N/m, stretched by 1 mm, 1600 oscillations in 1 s; quadruple precision."""
    return spring_pendulum(1e8, 1.001, 1.0, digits("-0.98535335081936486443", 0, "-0.16485273210904126502"))


@hard_case
def micrometres() -> HardCase:
    """The spring pendulum of 1e4 N/m a million times smaller, by similarity 1e10 N/m and 10 ms; atol = 1e-6 rtol."""
    return spring_pendulum(1e10, 1e-6, 0.01, digits("0.3442353236548982647", 0, "-0.94182182549807786119"), 1e-6)


def hanging_chain(masses: list[float], length: float, angles: list[float], end: float, reference: np.ndarray) -> HardCase:
    """Thin rods on hinges, let go at angles from the vertical (as differences, from the top); the ends of some of them are seen."""
    scene = ac.System()
    scene.world, scene.hinges = World(), [Revolute("y") for _ in masses]
    scene.rods = [RigidBody.rod(m, (0, 0, -length)) for m in masses]
    above = scene.world.frame
    for hinge, rod in zip(scene.hinges, scene.rods, strict=True):
        scene.connect(above, hinge.frame_a)
        scene.connect(hinge.frame_b, rod.frame)
        above = rod.tip
    start = {h.q: q for h, q in zip(scene.hinges, angles, strict=True)} | {h.v: 0.0 for h in scene.hinges}
    chosen = scene.rods if len(masses) < 5 else scene.rods[24::25]
    return HardCase(scene, start, end, lambda run: np.ravel([run[rod.tip.position][-1, [0, 2]] for rod in chosen]), reference)


@hard_case
def heavy_below_light() -> HardCase:
    """Double pendulum, 1 kg above 1e6 kg, 5 s; quadruple precision."""
    reference = digits(
        "-0.0671659694637690597312", "-0.9977418165768096352264", "-0.4107140122065308585075", "-1.9368769199179729572026"
    )
    return hanging_chain([1.0, 1e6], 1.0, [1.0, 1.0], 5.0, reference)


@hard_case
def light_below_heavy() -> HardCase:
    """Double pendulum, 1e6 kg above 1 kg, 5 s; quadruple precision."""
    reference = digits(
        "-0.6120963139783576758949", "-0.7907832208728936969982", "-1.6113284784543158002058", "-0.8299633367059507850410"
    )
    return hanging_chain([1e6, 1.0], 1.0, [1.0, 1.0], 5.0, reference)


@hard_case
def massless_link() -> HardCase:
    """Triple pendulum with a link of 1e-9 kg between two of 1 kg, 5 s; quadruple precision."""
    reference = digits(
        "0.6480594161932413084282655", "-0.7615897800543775974682234", "1.5476231786976573130943786", "-0.32480031453477668065734881",
        "2.4287455027404807047819463", "-0.79768872639678639635376671",
    )  # fmt: skip
    return hanging_chain([1.0, 1e-9, 1.0], 1.0, [1.0, 1.0, -1.5], 5.0, reference)


@hard_case
def chain_of_50() -> HardCase:
    """Fifty links of 0.1 m, straight and nearly level, fall for 1 s: ends of the 25th and the last; quadruple precision."""
    reference = digits("0.314728823743461730873", "-2.48007447842774608774", "0.466912191850070375", "-4.97171550712409851573")
    return hanging_chain([0.1] * 50, 0.1, [-1.5] + [0.0] * 49, 1.0, reference)


@hard_case
def spherical_pendulum_near_pole() -> HardCase:
    """A Cardan joint carries a spherical pendulum past its first axis at 1.4e-3 rad, over and over, 3 s; quadruple precision."""
    scene = ac.System()
    scene.world, scene.joint, scene.rod, scene.bob = World(), Universal("x", "y"), Fixed((0, 0, -1.0)), Particle(1.0)
    scene.connect(scene.world.frame, scene.joint.frame_a)
    scene.connect(scene.joint.frame_b, scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, scene.bob.point)
    return HardCase(
        scene, {scene.joint.q: (0.0, 0.0), scene.joint.v: (0.01, 7.0)}, 3.0, last(scene.bob.point.position),
        digits("-0.69587923432683196655", "0.00099411319189547425863", "0.71815813228819165564"),
    )  # fmt: skip


def four_bar(
    lengths: tuple[float, ...], masses: tuple[float, ...], g: float, angle: float, rate: float, end: float, tip: np.ndarray
) -> HardCase:
    """Crank, coupler, rocker and ground in the plane of x and z; the joint of coupler and rocker starts above the ground and is seen."""
    a, b, c, d = lengths
    scene = ac.System()
    scene.world = World((0, 0, -g))
    scene.crank, scene.coupler, scene.rocker = (RigidBody.rod(m, (x, 0, 0)) for m, x in zip(masses, (a, b, c), strict=True))
    scene.hinges = [Revolute("y") for _ in range(4)]
    ends = [
        (scene.world.frame, scene.crank.frame), (scene.crank.tip, scene.coupler.frame), (scene.coupler.tip, scene.rocker.tip),
        (scene.world.at((d, 0, 0)), scene.rocker.frame),
    ]  # fmt: skip
    for hinge, (one, two) in zip(scene.hinges, ends, strict=True):
        scene.connect(one, hinge.frame_a)
        scene.connect(hinge.frame_b, two)
    first, rest = scene.hinges[0], scene.hinges[1:]
    rough = {rest[2].q: ac.near(-1.0)} | {hinge.v: ac.near(0.0) for hinge in rest}
    return HardCase(
        scene, {first.q: -angle, first.v: -rate}, end, lambda run: run[scene.coupler.tip.position][-1, [0, 2]], tip, rough
    )


@hard_case
def massless_coupler() -> HardCase:
    """Four-bar with a coupler of 1e-9 kg, six turns in 5 s: the coupler's end; integral of the energy, 30 digits."""
    tip = digits("0.5358132958922147236861", "0.6515602072944230000008")
    return four_bar((0.4, 1.2, 0.8, 1.0), (1.0, 1e-9, 1.5), G, 0.5, 12.0, 5.0, tip)


@hard_case
def nearly_folding() -> HardCase:
    """Four-bar that misses a parallelogram by 1e-6 m and so its singular positions, 5 times in 3 s; integral of the energy, 30 digits."""
    tip = digits("0.6821793945714556672656", "0.2428803466030825907458")
    return four_bar((0.4, 1.0, 0.4 + 1e-6, 1.0), (1.0, 2.0, 1.5), 0.0, 1.0, 5.0, 3.0, tip)


def along_z(force: Any, z: float, end: float, reference: Any, g: float = G, magnification: float | None = None) -> HardCase:
    """A particle of 1 kg that slides on the z axis, with a force to the world's origin or from outside; its height is seen."""
    scene = ac.System()
    scene.world, scene.slide, scene.bob, scene.force = World((0, 0, -g)), Prismatic("z"), Particle(1.0), force
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.bob.point)
    if isinstance(force, Force):
        scene.connect(force.point, scene.bob.point)
    else:
        scene.connect(scene.world.frame, force.point_a)
        scene.connect(force.point_b, scene.bob.point)
    start = {scene.slide.q: z, scene.slide.v: 0.0}
    return HardCase(scene, start, end, last(scene.slide.q), digits(float(reference)), known_magnification=magnification)


@hard_case
def overdamped() -> HardCase:
    """A mass on a spring of 1e4 N/m and a damper of 1e4 N s/m creeps for 2 s after a jump of 1e-4 s; exponentials."""
    with mpmath.workdps(40):
        k = c = mpmath.mpf(10000)
        slow = -2 * k / (c + mpmath.sqrt(c * c - 4 * k))
        fast = -c - slow
        rest = 1 + mpmath.mpf(G) / k
        away = 1.5 - rest
        length = rest + away * (fast * mpmath.exp(2 * slow) - slow * mpmath.exp(2 * fast)) / (fast - slow)
    return along_z(SpringDamper(1e4, 1.0, 1e4), -1.5, 2.0, -length)


@hard_case
def bounces() -> HardCase:
    """A mass falls 0.5 m on a one-sided spring of 1e6 N/m, seven times in 5 s; parabolas and sines."""
    stiffness, fall, end = 1e6, 0.5, 5.0

    def height(fall: Any) -> Any:
        g, w = mpmath.mpf(G), mpmath.sqrt(mpmath.mpf(stiffness))
        down = mpmath.sqrt(2 * fall / g)
        touching = (mpmath.pi + 2 * mpmath.atan(g / w / (g * down))) / w
        time = mpmath.fmod(end + down, 2 * down + touching) - down  # since the highest point
        return 1 + fall - g * time**2 / 2  # in flight

    with mpmath.workdps(40):
        reference, slope = height(mpmath.mpf(fall)), mpmath.diff(height, fall)
    spring = NonlinearSpring(lambda length: stiffness / 2 * ca.fmax(0, 1 - length) ** 2)
    return along_z(spring, 1.0 + fall, end, reference, magnification=float(abs(slope) * (2 + fall)))


@hard_case
def switched_force() -> HardCase:
    """A force of 1 N on 1 kg that changes its sign every pi / 5 s, for 3 s; parabolas."""
    with mpmath.workdps(40):
        left, z, v, sign, half = mpmath.mpf(3), mpmath.mpf(0), mpmath.mpf(0), 1, mpmath.pi / 5
        while left > 0:
            step = min(left, half)
            z, v, sign, left = z + v * step + sign * step**2 / 2, v + sign * step, -sign, left - step
    return along_z(Force(lambda t: (0.0, 0.0, ca.if_else(ca.sin(5 * t) > 0, 1.0, -1.0))), 0.0, 3.0, z, 0.0, 5.0)


@final
class Attraction(AbstractLineForce):
    """Two points attract each other with strength / length^2."""

    def __init__(self, strength: float) -> None:
        self.strength = strength

    def tension(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        return self.strength / length**2

    def potential(self, length: ca.SX) -> ca.SX:
        return -self.strength / length


def kepler(revolutions: float, near: float = 0.1) -> HardCase:
    """A particle on an ellipse with half axis 1 and eccentricity 1 - near, from its nearest point; Kepler's equation."""
    scene = ac.System()
    scene.world, scene.planet, scene.sun = World(None), Particle(1.0), Attraction(1.0)
    scene.connect(scene.world.frame, scene.sun.point_a)
    scene.connect(scene.sun.point_b, scene.planet.point)
    speed, end = float(np.sqrt((2 - near) / near)), float(2 * np.pi * revolutions)
    start = {scene.planet.point.position: (near, 0, 0), scene.planet.point.velocity: (0, speed, 0)}
    return HardCase(scene, start, end, last(scene.planet.point.position), ellipse(near, speed, end))


def ellipse(near: float, speed: float, t: float) -> np.ndarray:
    """Position at `t` on a Kepler ellipse with attraction 1, from the nearest point."""
    with mpmath.workdps(40):
        r, v = mpmath.mpf(near), mpmath.mpf(speed)
        a = 1 / (2 / r - v * v)
        e = 1 - r / a
        mean = mpmath.fmod(t * a ** mpmath.mpf(-1.5), 2 * mpmath.pi)
        E = mean + e * mpmath.sin(mean)
        for _ in range(200):
            E -= (E - e * mpmath.sin(E) - mean) / (1 - e * mpmath.cos(E))
        return np.array([float(a * (mpmath.cos(E) - e)), float(a * mpmath.sqrt(1 - e * e) * mpmath.sin(E)), 0.0])


@hard_case
def kepler_10_turns() -> HardCase:
    """Orbit of eccentricity 0.9 about a user's own inverse-square force, 10.3 revolutions; Kepler's equation."""
    return kepler(10.3)


@hard_case
def kepler_1000_turns() -> HardCase:
    """The same orbit after 1000.3 revolutions; Kepler's equation."""
    return kepler(1000.3)


@dataclass(frozen=True)
class Drift:
    """How the energy of a long run went: largest change, and change per run of a straight line through it, both relative."""

    largest: float
    trend: float
    scatter: float
    """Root mean square about the line."""
    steps: int
    seconds: float


def spin_reversals(run: Trajectory, spin: ac.Expression | ca.SX) -> np.ndarray:
    """Times of the sign changes of `spin`, by bisection on the interpolant."""
    times = np.arange(run.solution.t[0], run.solution.t[-1], 1e-3)
    signs = np.sign(run.at(times)[spin])
    changes = np.flatnonzero(np.diff(signs))
    low, high, sign = times[changes], times[changes + 1], signs[changes]
    for _ in range(40):
        middle = (low + high) / 2
        before = np.sign(run.at(middle)[spin]) == sign
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return low


def there_and_back(case: HardCase, run: Trajectory, rtol: float) -> float:
    """Largest difference from the start, after the motion `run` was turned around at its end and run back."""

    def turned(run: Trajectory) -> dict[Any, Any]:
        return {key: run[key][-1] * (-1 if getattr(key, "name", "") == "v" else 1) for key in case.start}

    back = turned(case.simulate(rtol, turned(run)))
    return max(float(np.max(np.abs(back[key] - value))) for key, value in case.start.items())


def drift(run: Trajectory, scale: float, samples: int = 2000) -> Drift:
    """From the energy at about `samples` step points."""
    t = run.solution.t[:: max(1, run.solution.t.size // samples)]
    change = (run.at(t).energy - run.at(t[:1]).energy[0]) / scale
    slope, offset = np.polyfit(t / t[-1], change, 1)
    rest = change - slope * t / t[-1] - offset
    s = run.statistics
    return Drift(float(np.max(np.abs(change))), float(slope), float(np.sqrt(np.mean(rest**2))), s.steps, s.seconds)


def long_double_pendulum(duration: float = 1e4, step: float = 0.05, order: int = 12) -> Drift:
    """Fixed steps of Gauss's method; relative to the energy at the start."""
    scene = DoublePendulum()
    run = ac.build(scene).simulate(
        duration, {scene.shoulder.q: 0.6, scene.elbow.q: 0.3}, step=step, method="gauss", order=order, samples=2
    )
    return drift(run, abs(float(run.at(0.0).energy[0])))


def long_kepler(revolutions: float = 1000, per_turn: int = 400, order: int = 16) -> tuple[HardCase, Trajectory, Drift]:
    """Eccentricity 0.9 with fixed steps; relative to the energy of the orbit."""
    case = kepler(revolutions)
    run = case.simulate(1e-13, step=2 * np.pi / per_turn, method="gauss", order=order)
    return case, run, drift(run, 0.5)
