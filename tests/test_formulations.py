"""Linkages whose mobility a count of freedoms gets wrong, against a reduction to one freedom that shares no code with the package."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import acausal as ac
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
    return Hinges(np.vstack([leg, other]) @ SKEW.T, axes @ SKEW.T, rate=0.8)


def planar() -> Hinges:
    """Crank and rocker with parallel hinges in a skewed plane, bars at different heights."""
    points = np.array([(0, 0, 0.1), (0.4, 0.1, -0.2), (1.5, 0.5, 0.3), (1.1, 0, 0)])
    return Hinges(points @ SKEW.T, np.tile(SKEW[:, 2], (4, 1)), rate=4.0)


def spherical() -> Hinges:
    """Four hinges whose axes meet in a point."""
    axes = np.array([(0, 0, 1.0), (0.3, 0.1, 1), (1, 0.6, 0.7), (1, -0.1, 0.5)])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return Hinges((np.array([0.2, 0.1, -0.3]) + axes * [[0.5], [1], [0.7], [0.4]]) @ SKEW.T, axes @ SKEW.T, rate=3.0)


LINKAGES = [bennett, goldberg, myard, line_symmetric, orthogonal, schatz, sarrus, planar, spherical]


# one freedom ----------------------------------------------------------------------------------------------------------


class OneFreedom:
    """A loop of hinges by its angles alone, which turn as the null vector n of their screws J lets them: theta' = n s.

    theta'' = n s' - J^+ J' theta', and s' from the power of all inertia and gravity along n. Twists are at the world's origin.
    """

    def __init__(self, hinges: Hinges, sketch: Sketch) -> None:
        self.screws = np.hstack([hinges.axes, np.cross(hinges.points, hinges.axes)])
        self.count = len(hinges.axes)
        still = replace(sketch, twists=np.zeros((len(sketch.bodies), 6)))
        own = mass_matrix(still)
        self.inertias = []
        for k, body in enumerate(sketch.bodies):  # from body's to the world's origin
            shift = np.eye(6)
            shift[3:, :3] = -skew(body.place[1])
            self.inertias.append(self.moved_inertia(own[6 * k : 6 * k + 6, 6 * k : 6 * k + 6], body.place[1]))

    @staticmethod
    def moved_inertia(own: Array, p: Array) -> Array:
        """From the origin of a frame at p to the world's origin."""
        X = np.block([[np.eye(3), np.zeros((3, 3))], [-skew(p), np.eye(3)]])  # twist at the origin to twist at p
        return X.T @ own @ X

    def rates(self, y: Array) -> Array:
        """theta', theta'' of y = theta, theta'."""
        theta, rate = y[: self.count], y[self.count :]
        R, p = np.eye(3), np.zeros(3)
        J, transforms = [], []
        for (e, m), angle in zip(((s[:3], s[3:]) for s in self.screws), theta, strict=True):
            J.append(np.concatenate([R @ e, R @ m + np.cross(p, R @ e)]))
            turn, point = turned(e, angle), np.cross(e, m)  # the point of the axis next to the origin
            R, p = R @ turn, p + R @ (point - turn @ point)
            transforms.append((R, p))
        J = np.array(J).T
        U, s, Vt = np.linalg.svd(J)
        n = Vt[self.count - 1]
        rank = self.count - 1
        rate = n * (n @ rate)
        twists = np.cumsum(J * rate, axis=1)
        bias = np.array([commutator(twists[:, i - 1], J[:, i]) if i else np.zeros(6) for i in range(self.count)]).T @ rate
        held = -Vt[:rank].T @ ((U[:, :rank].T @ bias) / s[:rank])
        changes = np.array([commutator(twists[:, i - 1], J[:, i]) * rate[i] if i else np.zeros(6) for i in range(self.count)]).T
        accelerations = np.cumsum(J * held + changes, axis=1)
        units = np.cumsum(J * n, axis=1)
        inertia = power = 0.0
        for k, (own, (R, p)) in enumerate(zip(self.inertias, transforms[:-1], strict=True)):
            back = np.block([[R.T, np.zeros((3, 3))], [-R.T @ skew(p), R.T]])  # twist to the body as it was at the start
            M = back.T @ own @ back
            V, A, u = twists[:, k], accelerations[:, k].copy(), units[:, k]
            A[3:] -= G
            h = M @ V
            inertia += u @ M @ u
            power -= u @ (M @ A) - commutator(V, u) @ h
        return np.concatenate([rate, n * power / inertia + held])

    def motion(self, rate: float, times: Array) -> Array:
        """Angles at times, (times, n), from zero with this rate of the first."""
        zero = np.zeros(self.count)
        n = np.linalg.svd(self.screws.T)[2][self.count - 1]
        start = np.concatenate([zero, n * rate / n[0]])
        return (
            solve_ivp(lambda _t, y: self.rates(y), (0, times[-1]), start, "DOP853", t_eval=times, rtol=3e-13, atol=1e-13)
            .y[: self.count]
            .T
        )


def commutator(V: Array, W: Array) -> Array:
    """Rate of a twist W that moves along with V."""
    return np.concatenate([np.cross(V[:3], W[:3]), np.cross(V[3:], W[:3]) + np.cross(V[:3], W[3:])])


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
