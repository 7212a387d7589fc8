"""Linkages whose axes all meet in one point, wherever that is and wherever their bodies' frames are: of lever arms there is nothing but rounding."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import acausal as ac
from acausal.errors import LockedError
from components import Cylindrical, Revolute, RigidBody, Spherical, World
from tests.formulations import skew

JOINED = ((-1, 0), (0, 1), (1, 2), (2, 3), (3, -1), (0, 4), (4, 2))
"""Bodies of a ring of five hinges, and of a sixth body between two of them: one freedom is left."""
G, TIMES = np.array([0.3, -9.0, 2.0]), np.linspace(0, 0.1, 3)


class Linkage(ac.System):
    """Bodies anywhere, on hinges about axes through a point; some of these are sleeves, which the others keep from sliding."""

    def __init__(
        self, seed: int, size: float, sleeves: tuple[int, ...] = (), joined: tuple[tuple[int, int], ...] = JOINED
    ) -> None:
        g = np.random.default_rng(seed)
        self.centre, self.axes = g.normal(size=3), [u / np.linalg.norm(u) for u in g.normal(size=(len(joined), 3))]
        self.drawn = []
        for _ in range(1 + max(b for pair in joined for b in pair)):
            R, m, c = Rotation.random(random_state=int(g.integers(1000))).as_matrix(), g.uniform(0.5, 2), 0.3 * g.normal(size=3)
            self.drawn.append((R, g.normal(size=3), m, c, 0.02 * m * np.diag(g.uniform(0.8, 1.2, 3))))
        self.world = World(tuple(size * G))
        self.bodies = [
            RigidBody(m, size**2 * inertia, tuple(size * c), position=tuple(size * p), rotation=R)
            for R, p, m, c, inertia in self.drawn
        ]
        self.joints = [
            (Cylindrical if k in sleeves else Revolute).between(
                *(self.world if n < 0 else self.bodies[n] for n in pair), at=tuple(size * self.centre), axis=tuple(axis)
            )
            for k, (pair, axis) in enumerate(zip(joined, self.axes, strict=True))
        ]


def turned(linkage: Linkage, w: np.ndarray) -> np.ndarray:
    """Places (times, bodies, 3) of the bodies' frames: of rotations about the centre alone, in the bodies' own, hinges by null space."""
    n = len(linkage.drawn)
    arms = [R.T @ (p - linkage.centre) for R, p, *_ in linkage.drawn]
    own = [
        inertia + m * ((c + a) @ (c + a) * np.eye(3) - np.outer(c + a, c + a))
        for (*_, m, c, inertia), a in zip(linkage.drawn, arms, strict=True)
    ]
    start = [R for R, *_ in linkage.drawn]
    across = [np.linalg.svd(axis[None])[2][1:] for axis in linkage.axes]

    def law(_: float, y: np.ndarray) -> np.ndarray:
        R, w = y[: 9 * n].reshape(n, 3, 3), y[9 * n :].reshape(n, 3)
        rows, right = np.zeros((2 * len(JOINED), 3 * n)), np.zeros(2 * len(JOINED))
        for k, (a, b) in enumerate(JOINED):
            normals = across[k] if a < 0 else across[k] @ start[a] @ R[a].T
            w_a, w_b = (np.zeros(3) if i < 0 else w[i] for i in (a, b))
            for i, sign in ((a, -1), (b, 1)):
                if i >= 0:
                    rows[2 * k : 2 * k + 2, 3 * i : 3 * i + 3] = sign * normals
            right[2 * k : 2 * k + 2] = -np.cross(w_a, normals) @ (w_b - w_a)
        M, f = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
        for i, (*_, m, c, _) in enumerate(linkage.drawn):
            inertia, at = R[i] @ own[i] @ R[i].T, slice(3 * i, 3 * i + 3)
            M[at, at], f[at] = inertia, np.cross(R[i] @ (c + arms[i]), m * G) - np.cross(w[i], inertia @ w[i])
        _, s, Vt = np.linalg.svd(rows)
        Z = Vt[int(np.sum(s > 1e-6 * s[0])) :].T
        a0 = np.linalg.lstsq(rows, right, rcond=1e-6)[0]
        rates = a0 + Z @ np.linalg.solve(Z.T @ M @ Z, Z.T @ (f - M @ a0))
        return np.concatenate([*((skew(x) @ Q).ravel() for x, Q in zip(w, R, strict=True)), rates])

    y = solve_ivp(law, (0, TIMES[-1]), np.concatenate([np.ravel(start), w.ravel()]), "DOP853", TIMES, rtol=1e-11, atol=1e-12).y
    found = y[: 9 * n].T.reshape(-1, n, 3, 3) @ np.array(arms)[None, :, :, None]
    return found[..., 0] + linkage.centre


@pytest.mark.parametrize(
    ("seed", "size", "sleeves"), [(0, 1e-3, (0, 6)), (1, 1.0, ()), (1, 1.0, (2, 4)), (3, 1e3, (0, 6))],
    ids=["millimetres", "hinges", "sleeves", "kilometres"],
)  # fmt: skip
def test_axes_that_meet_in_a_point_move_as_rotations_about_it(seed: int, size: float, sleeves: tuple[int, ...]):
    scene = Linkage(seed, size, sleeves)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    joint = scene.joints[1]
    run = model.simulate(TIMES[-1], {joint.v: 1.0}, rtol=1e-10, samples=TIMES.size)
    w = np.array([run[body.frame.angular_velocity][0].ravel() for body in scene.bodies])
    exact = turned(scene, w)
    for k, body in enumerate(scene.bodies):
        np.testing.assert_allclose(run[body.frame.position] / size, exact[:, k], atol=1e-8)
    assert run.energy_error() < 1e-9


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_sleeves_that_slide_along_axes_of_different_directions_are_locked(size: float):
    """A ring of four, of which three of the axes slide: hinges turn no more behind a second body between two of them."""
    with pytest.raises(LockedError, match="locked: 5 freedoms of its joints and 5 independent"):
        ac.build(Linkage(25, size, (0, 2, 5), ((-1, 0), (0, 1), (1, 2), (2, -1), (3, 1), (3, 2))))


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_two_bodies_on_one_ball_and_a_sleeve_through_it_keep_their_energy_and_nothing_warns(size: float):
    """What holds to rounding of the places of joints in bodies holds; the sleeve does not slide, so both turn as one, but about its axis."""
    for seed in range(3):
        g = np.random.default_rng(seed)
        scene, (centre, *places), along = ac.System(), size * g.normal(size=(3, 3)), g.normal(size=3)
        scene.world = World(tuple(size * G))
        turned = Rotation.random(2, random_state=seed).as_matrix()
        scene.bodies = [
            RigidBody.box(1.0, (size,) * 3, position=tuple(p), rotation=R) for p, R in zip(places, turned, strict=True)
        ]
        scene.balls = [Spherical.between(body, scene.world, at=tuple(centre)) for body in scene.bodies]
        scene.sleeve = Cylindrical.between(*scene.bodies, at=tuple(centre), axis=tuple(along))
        model = ac.build(scene)
        assert model.degrees_of_freedom == 4
        run = model.simulate(0.3, rtol=1e-10)
        assert run.energy_error() < 1e-9
        assert np.max(np.abs(run[scene.sleeve.q[1]])) < 1e-12 * size < np.max(np.abs(run[scene.sleeve.q[0]])) * size
