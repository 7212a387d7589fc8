"""Linkages whose mobility a count of freedoms gets wrong, against a reduction to one freedom that shares no code with the package."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import acausal as ac
from acausal.errors import AssemblyError, LockedError
from components import Revolute, RigidBody, World
from tests.formulations import Array, Body, Sketch, between, composed, mass_matrix, script, skew, turned

G = np.array([1.0, -2.0, -9.0])
SKEW = turned(np.array([1.0, 2.0, 3.0]), 1.1)


# loops of hinges ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Hinges:
    """Points (n, 3) [m] and directions (n, 3) of the hinges of a single loop at its start; the first and the last are at the world.

    `rate` [rad/s]: of the first hinge.
    """

    points: Array
    axes: Array
    rate: float = 1.5
    end: float = 2.0

    def sketch(self, seed: int = 0) -> Sketch:
        """Bars of random mass and inertia between the hinges, at angles zero."""
        rng = np.random.default_rng(seed)
        bodies = []
        for p, q in itertools.pairwise(self.points):
            mass, second = 10 ** rng.uniform(-0.5, 0.5), rng.uniform(0.02, 0.1, 3)
            turn = turned(rng.normal(size=3), 1.0)
            middle = (p + q) / 2 + 0.1 * rng.normal(size=3)
            bodies.append(Body((turn, p), mass, turn.T @ (middle - p), mass * np.diag(np.sum(second) - second)))
        sketch = Sketch(G, tuple(bodies), ())
        chain = [-1, *range(len(bodies)), -1]
        for (a, b), p, e in zip(itertools.pairwise(chain), self.points, self.axes, strict=True):
            joint = between("Revolute", sketch, a, b, (np.eye(3), p), np.zeros(1), axis=e)
            sketch = replace(sketch, joints=(*sketch.joints, joint))
        return sketch


def closed_chain(lengths, twists, offsets, angles, **motion: float) -> Hinges:
    """A loop by Denavit and Hartenberg's parameters: R_z(angle) T_z(offset) T_x(length) R_x(twist), n times.

    `angles`: near the ones looked for; the first is kept.
    """

    def frames(theta: Array) -> list[tuple[Array, Array]]:
        R, p, found = np.eye(3), np.zeros(3), []
        for a, alpha, d, angle in zip(lengths, twists, offsets, theta, strict=True):
            found.append((R, p))
            turn = R @ turned(np.array([0, 0, 1.0]), angle)
            p = p + turn @ np.array([a, 0, d])
            R = turn @ turned(np.array([1.0, 0, 0]), alpha)
        return [*found, (R, p)]

    def gap(rest: Array) -> Array:
        R, p = frames(np.array([angles[0], *rest]))[-1]
        return np.concatenate([p, (R - np.eye(3)).ravel()])

    found = least_squares(gap, angles[1:], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.max(np.abs(found.fun)) < 1e-14
    placed = frames(np.array([angles[0], *found.x]))[:-1]
    points, axes = (np.array([f[1] for f in placed]), np.array([f[0][:, 2] for f in placed]))
    return Hinges(points @ SKEW.T, axes @ SKEW.T, **motion)


def bennett() -> Hinges:
    """Four skewed hinges, sin(twist) / length the same in all links (Bennett, Engineering 76, 1903)."""
    a, b, alpha, beta = 1.0, np.sin(1.1) / np.sin(0.6), 0.6, 1.1
    return closed_chain((a, b, a, b), (alpha, beta, alpha, beta), np.zeros(4), (1.0, 2.786, -1.0, -2.786))


def goldberg() -> Hinges:
    """Five hinges: two of Bennett's linkages with a common link that is left out (Goldberg, Transactions of the ASME 65, 1943)."""
    a, b, c = np.sin([0.6, 1.1, 1.5]) / np.sin(0.6)
    return closed_chain((a, b + c, a, c, b), (0.6, 2.6, 0.6, 1.5, 1.1), np.zeros(5), (0.4, 3.008, 0.768, 2.741, -0.635))


def myard() -> Hinges:
    """Five hinges, symmetric to a plane: two of Bennett's linkages with right angles, mirrored (Myard, 1931)."""
    a, alpha = np.sin(0.6), 0.6
    lengths, twists = (a, 1, 0, 1, a), (alpha, np.pi / 2, np.pi - 2 * alpha, np.pi / 2, np.pi - alpha)
    return closed_chain(lengths, twists, np.zeros(5), (0.4, 1.996, 1.371, -1.771, -1.996))


def line_symmetric() -> Hinges:
    """Bricard's six hinges of which opposite ones are mirrored by a line: links and offsets repeat after three (Bricard, 1897)."""
    angles = (1.0, 0.314, 2.614, 1.0, 0.314, 2.614)
    return closed_chain((0.5, 0.8, 0.6) * 2, (0.7, 1.2, -0.9) * 2, (0.1, -0.2, 0.3) * 2, angles)


def orthogonal() -> Hinges:
    """Bricard's six hinges at right angles: the alternating sum of the lengths' squares is zero."""
    lengths = (1.0, 0.8, 0.9, 1.1, 0.7, np.sqrt(1.0 - 0.64 + 0.81 - 1.21 + 0.49))
    return closed_chain(lengths, (np.pi / 2, -np.pi / 2) * 3, np.zeros(6), (1.0, -1.868, 1.086, -1.995, 1.081, -1.861))


def schatz() -> Hinges:
    """The invertible cube's six hinges, as in the Turbula mixer: Schatz, German patent 589 452 (1933); Phillips, Freedom in Machinery."""
    lengths, twists = (0, 1, 1, 1, 0, np.sqrt(3)), (*[np.pi / 2] * 5, 0)
    return closed_chain(lengths, twists, (0.3, 0, 0, 0, 0, -0.3), (1.3, 1.805, -2.062, -0.468, -0.54, 3.004))


def sarrus() -> Hinges:
    """Two legs of three parallel hinges, turned against each other: the plate between rises straight."""
    leg = np.array([(1.0, 0, 0), (1.6, 0, 0.5), (1.2, 0, 1.1)])
    turn = turned(np.array([0, 0, 1.0]), 1.2)
    other = np.array([(0.8, 0, 1.1), (1.5, 0, 0.7), (0.9, 0, 0)]) @ turn.T
    axes = np.array([(0, 1.0, 0)] * 3 + [turn[:, 1]] * 3)
    return Hinges(np.vstack([leg, other]) @ SKEW.T, axes @ SKEW.T, rate=0.8, end=0.7)


def planar() -> Hinges:
    """Crank and rocker with parallel hinges in a skewed plane, bars at different heights."""
    points = np.array([(0, 0, 0.1), (0.4, 0.1, -0.2), (1.5, 0.5, 0.3), (1.1, 0, 0)])
    return Hinges(points @ SKEW.T, np.tile(SKEW[:, 2], (4, 1)), rate=4.0)


def spherical() -> Hinges:
    """Four hinges whose axes meet in a point."""
    axes = np.array([(0, 0, 1.0), (0.3, 0.1, 1), (1, 0.6, 0.7), (1, -0.1, 0.5)])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return Hinges((np.array([0.2, 0.1, -0.3]) + axes * [[0.5], [1], [0.7], [0.4]]) @ SKEW.T, axes @ SKEW.T, rate=3.0)


def seven() -> Hinges:
    """Seven hinges anywhere: nothing is redundant."""
    rng = np.random.default_rng(5)
    axes = rng.normal(size=(7, 3))
    return Hinges(rng.normal(size=(7, 3)), axes / np.linalg.norm(axes, axis=1)[:, None], rate=0.5, end=1.0)


LINKAGES = [seven, bennett, goldberg, myard, line_symmetric, orthogonal, schatz, sarrus, planar, spherical]


# one freedom ----------------------------------------------------------------------------------------------------------


class OneFreedom:
    """A loop of hinges by its angles alone, which turn as the null vector n of their screws J lets them: theta' = n s.

    theta'' = n s' - J^+ J' theta', and s' from the power of all inertia and gravity along n. Twists are at the world's origin.
    """

    def __init__(self, hinges: Hinges, sketch: Sketch) -> None:
        self.axes, self.moments = hinges.axes, np.cross(hinges.points, hinges.axes)
        self.count = len(hinges.axes)
        self.about = []  # each hinge's turn: 1 + sin K + (1 - cos) K^2, in homogeneous coordinates
        for e, r in zip(hinges.axes, hinges.points, strict=True):
            K = np.zeros((4, 4))
            K[:3, :3], K[:3, 3] = skew(e), -np.cross(e, r)
            self.about.append((K, K @ K))
        own = mass_matrix(replace(sketch, twists=np.zeros((len(sketch.bodies), 6))))
        at_origin = []
        for k, body in enumerate(sketch.bodies):
            X = np.block([[np.eye(3), np.zeros((3, 3))], [-skew(body.place[1]), np.eye(3)]])  # to the twist at the body's frame
            at_origin.append(X.T @ own[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] @ X)
        self.inertias = np.array(at_origin)

    def rates(self, y: Array) -> Array:
        """theta', theta'' of y = theta, theta'."""
        n, theta, rate = self.count, y[: self.count], y[self.count :]
        X = np.empty((n + 1, 4, 4))
        X[0] = np.eye(4)
        for k, (K, square) in enumerate(self.about):
            X[k + 1] = X[k] @ (X[0] + np.sin(theta[k]) * K + (1 - np.cos(theta[k])) * square)
        R, p = X[:-1, :3, :3], X[:-1, :3, 3]
        e = np.einsum("kij,kj->ki", R, self.axes)
        J = np.hstack([e, np.einsum("kij,kj->ki", R, self.moments) + np.cross(p, e)])
        U, s, Vt = np.linalg.svd(J.T)
        unit, rank = Vt[n - 1], n - 1
        rate = unit * (unit @ rate)
        V = np.cumsum(J * rate[:, None], axis=0)
        changes = commutator(np.vstack([np.zeros(6), V[:-1]]), J) * rate[:, None]
        held = -Vt[:rank].T @ ((U[:, :rank].T @ np.sum(changes, axis=0)) / s[:rank])
        A = np.cumsum(J * held[:, None] + changes, axis=0)
        A[:, 3:] -= G
        u = np.cumsum(J * unit[:, None], axis=0)
        R, p = X[1:-1, :3, :3], X[1:-1, :3, 3]
        V, A, u = (_in_bodies(R, p, twists[:-1]) for twists in (V, A, u))
        inertia = np.einsum("ki,kij,kj", u, self.inertias, u)
        power = np.einsum("ki,kij,kj", commutator(V, u), self.inertias, V) - np.einsum("ki,kij,kj", u, self.inertias, A)
        return np.concatenate([rate, unit * power / inertia + held])

    def motion(self, rate: float, times: Array) -> Array:
        """Angles at times, (times, n), from zero with this rate of the first."""
        n = np.linalg.svd(np.hstack([self.axes, self.moments]).T)[2][self.count - 1]
        start = np.concatenate([np.zeros(self.count), n * rate / n[0]])
        return (
            solve_ivp(lambda _t, y: self.rates(y), (0, times[-1]), start, "DOP853", t_eval=times, rtol=3e-13, atol=1e-13)
            .y[: self.count]
            .T
        )


def commutator(V: Array, W: Array) -> Array:
    """Rates (n, 6) of twists W that move along with V."""
    w, v = V[:, :3], V[:, 3:]
    return np.hstack([np.cross(w, W[:, :3]), np.cross(v, W[:, :3]) + np.cross(w, W[:, 3:])])


def _in_bodies(R: Array, p: Array, V: Array) -> Array:
    """Twists (n, 6) at the world's origin in frames that went along with the bodies from there."""
    w, v = V[:, :3], V[:, 3:] + np.cross(V[:, :3], p)
    return np.hstack([np.einsum("kji,kj->ki", R, w), np.einsum("kji,kj->ki", R, v)])


@pytest.mark.parametrize("make", LINKAGES, ids=lambda make: make.__name__)
def test_linkages_with_more_mobility_than_a_count_of_freedoms_gives(make):
    hinges = make()
    sketch, n = hinges.sketch(), len(hinges.axes)
    scene = composed(script(sketch))
    model = ac.build(scene)
    c = model.system.constraints
    assert model.degrees_of_freedom == 1
    assert len(c.redundant) + len(c.vanishing) == 7 - n
    run = model.simulate(hinges.end, {scene.j0.q: 0.0, scene.j0.v: hinges.rate}, rtol=1e-12, samples=21, progress=False)
    assert run.energy_error() < 1e-11
    assert run.constraint_error() < 1e-13
    angles = np.array([run[getattr(scene, f"j{k}").q] for k in range(n)]).T
    want = OneFreedom(hinges, sketch).motion(hinges.rate, run.t)
    off = angles - want
    assert np.ptp(want[:, 0]) > 0.5
    assert np.max(np.abs(off - 2 * np.pi * np.round(off / (2 * np.pi)))) < 1e-9


# parallelograms -------------------------------------------------------------------------------------------------------


def along(angle: float) -> Array:
    """A direction in the skewed plane."""
    return SKEW @ np.array([np.cos(angle), np.sin(angle), 0])


def hinged(scene: ac.System, *hinges: tuple) -> list[Revolute]:
    """Hinges between (part, part, point), normal to the skewed plane."""
    scene.hinges = [Revolute.between(a, b, at=tuple(p), axis=tuple(SKEW[:, 2])) for a, b, p in hinges]
    return scene.hinges


@dataclass(frozen=True)
class Parallelogram:
    """`cranks` cranks of different masses [kg] and the same length side by side in a skewed plane, on one bar of `bar` [kg]."""

    cranks: tuple[float, ...] = (1.0, 0.6, 1.4, 0.3)
    bar: float = 2.0
    length: float = 0.7
    start: float = 0.6
    """Angle of the cranks to the line of their feet, of four feet at `feet` along it [m]."""
    feet: tuple[float, ...] = (0.0, 0.4, 0.9, 1.5)

    def scene(self) -> tuple[ac.System, list[Revolute]]:
        scene, arm = ac.System(), self.length * along(self.start)
        points = [x * SKEW[:, 0] for x in self.feet]
        scene.world = World(tuple(G))
        scene.bar = RigidBody.rod(self.bar, tuple(points[-1]), position=tuple(arm))
        scene.cranks = [RigidBody.rod(m, tuple(arm), position=tuple(p)) for m, p in zip(self.cranks, points, strict=True)]
        feet = [(scene.world, crank, p) for crank, p in zip(scene.cranks, points, strict=True)]
        heads = [(crank, scene.bar, p + arm) for crank, p in zip(scene.cranks, points, strict=True)]
        return scene, hinged(scene, *feet, *heads)

    def turn(self, rate: float, times: Array) -> Array:
        """What each crank has turned by: a pendulum."""
        inertia = (sum(self.cranks) / 3 + self.bar) * self.length**2
        weight = (sum(self.cranks) / 2 + self.bar) * self.length

        def right(_t: float, y: Array) -> list[float]:
            return [y[1], weight * float(G @ along(y[0] + self.start + np.pi / 2)) / inertia]

        return solve_ivp(right, (0, times[-1]), [0.0, rate], "DOP853", t_eval=times, rtol=1e-13, atol=1e-14).y[0]


@pytest.mark.parametrize(
    ("start", "rate", "angle", "energy", "gap"),
    [(-2.2, 0.2, 1e-9, 1e-11, 1e-13), (0.6, 9.0, 1e-7, 1e-9, 1e-9)],
    ids=["swings", "passes its change points"],
)
def test_a_parallelogram_with_extra_cranks_has_one_freedom(start, rate, angle, energy, gap):
    """Three loops, eight hinges: 15 constraints, 11 of them redundant. With all bars in line the cranks might turn apart."""
    case = Parallelogram(start=start)
    scene, hinges = case.scene()
    model = ac.build(scene)
    c = model.system.constraints
    assert model.degrees_of_freedom == 1
    assert len(c.redundant) + len(c.vanishing) == 11
    run = model.simulate(3.0, {hinges[0].q: 0.0, hinges[0].v: rate}, rtol=1e-12, samples=31, progress=False)
    want = case.turn(rate, run.t)
    assert np.ptp(want) > (2 * np.pi if rate > 1 else 1.0)
    for hinge in hinges[:4]:
        off = run[hinge.q] - want
        assert np.max(np.abs(off - 2 * np.pi * np.round(off / (2 * np.pi)))) < angle
    assert run.energy_error() < energy
    assert run.constraint_error() < gap


def test_two_parallelograms_one_on_the_other_have_two_freedoms():
    """Bars only shift, so both pairs of cranks move like a double pendulum with two masses on each rod."""
    l1, l2, d1, d2, c1, c2, b1, b2 = 0.6, 0.5, 0.8, 0.4, 0.7, 0.3, 1.2, 2.0
    start = np.array([0.5, 1.4])
    scene = ac.System()
    scene.world = World(tuple(G))
    base, x, u1, u2 = np.array([0.1, 0.2, 0.3]), SKEW[:, 0], l1 * along(start[0]), l2 * along(start[1])
    low = [base, base + d1 * x]
    high = [base + u1 + 0.2 * x, base + u1 + (0.2 + d2) * x]
    scene.first = [RigidBody.rod(c1, tuple(u1), position=tuple(p)) for p in low]
    scene.second = [RigidBody.rod(c2, tuple(u2), position=tuple(p)) for p in high]
    scene.bar = RigidBody.rod(b1, tuple(d1 * x), position=tuple(low[0] + u1))
    scene.top = RigidBody.rod(b2, tuple(d2 * x), position=tuple(high[0] + u2))
    hinges = hinged(
        scene,
        *((scene.world, crank, p) for crank, p in zip(scene.first, low, strict=True)),
        *((crank, scene.bar, p + u1) for crank, p in zip(scene.first, low, strict=True)),
        *((scene.bar, crank, p) for crank, p in zip(scene.second, high, strict=True)),
        *((crank, scene.top, p + u2) for crank, p in zip(scene.second, high, strict=True)),
    )
    h = (c2 + b2) * l1 * l2

    def right(_t: float, y: Array) -> Array:
        s, c = np.sin(y[0] - y[1]), np.cos(y[0] - y[1])
        M = np.array([[(2 * c1 / 3 + b1 + 2 * c2 + b2) * l1**2, h * c], [h * c, (2 * c2 / 3 + b2) * l2**2]])
        pulls = [(c1 + b1 + 2 * c2 + b2) * l1, (c2 + b2) * l2] * np.array([G @ along(angle + np.pi / 2) for angle in y[:2]])
        return np.concatenate([y[2:], np.linalg.solve(M, pulls + h * s * np.array([-(y[3] ** 2), y[2] ** 2]))])

    model = ac.build(scene)
    assert model.degrees_of_freedom == 2
    run = model.simulate(1.0, {hinges[0].v: 0.4, hinges[4].v: -0.3}, rtol=1e-12, samples=11, progress=False)
    want = solve_ivp(right, (0, 1.0), [*start, 0.4, -0.3], "DOP853", t_eval=run.t, rtol=1e-13, atol=1e-13).y[:2]
    assert np.max(np.abs(run[hinges[0].q] + start[0] - want[0])) < 1e-9
    assert np.max(np.abs(run[hinges[4].q] + start[1] - want[1])) < 1e-9
    assert run.energy_error() < 1e-11
    assert run.constraint_error() < 1e-13


# what cannot move, or not be put together -----------------------------------------------------------------------------


def random_hinges(count: int, seed: int, parallel: bool = False) -> Hinges:
    """Anywhere."""
    rng = np.random.default_rng(seed)
    axes = np.tile(SKEW[:, 2], (count, 1)) if parallel else rng.normal(size=(count, 3))
    return Hinges(rng.normal(size=(count, 3)), axes / np.linalg.norm(axes, axis=1)[:, None])


@pytest.mark.parametrize(("count", "parallel"), [(6, False), (5, False), (4, False), (3, True), (3, False)])
def test_loops_of_too_few_hinges_are_locked(count, parallel):
    for seed in range(3):
        print("seed", seed)
        with pytest.raises(LockedError, match="locked"):
            ac.build(composed(script(random_hinges(count, seed, parallel).sketch())))


def test_a_linkage_that_is_bent_a_little_is_locked():
    """Bennett's linkage with one hinge turned by half a degree still closes, and no longer moves."""
    good = bennett()
    axes = good.axes.copy()
    axes[2] = turned(good.points[2] - good.points[0], 0.01) @ axes[2]
    with pytest.raises(LockedError, match="locked"):
        ac.build(composed(script(replace(good, axes=axes).sketch())))


def test_a_loop_whose_bars_are_too_short_cannot_close():
    """Parallel hinges 10 m apart on the ground, three bars of about 1 m between."""
    sketch = planar().sketch()
    last = sketch.joints[-1]
    far = (last.frame_b[0], last.frame_b[1] + 10 * SKEW[:, 0])
    with pytest.raises(AssemblyError, match=r"cannot close: the smallest gap reached is \d"):
        ac.build(composed(script(replace(sketch, joints=(*sketch.joints[:-1], replace(last, frame_b=far))))))
