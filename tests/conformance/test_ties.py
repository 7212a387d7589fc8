"""Random relations between positions or velocities of joints and scalar parts, without losses, against Lagrange's equations with multipliers.

Slides, hinges, sliding masses and inertias, tied by sums of any functions of them, of products and of the time: what each relation says of
positions, or only of velocities, in any order of declaration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from components import Inertia, Prismatic, Revolute, RigidBody, SlidingMass, World

G, ARM, END = 9.81, 0.5, 0.6
LAWS: dict[str, tuple[Callable, Callable]] = {
    "line": (lambda x, m: x, lambda x, m: 1.0),
    "sine": (lambda x, m: x + 0.4 * m.sin(x), lambda x, m: 1 + 0.4 * m.cos(x)),
    "square": (lambda x, m: x + 0.2 * x * x, lambda x, m: 1 + 0.4 * x),
    "growth": (lambda x, m: m.exp(0.5 * x), lambda x, m: 0.5 * m.exp(0.5 * x)),
}
KINDS = {"slide": "s", "hinge": "phi", "mass": "s", "inertia": "phi"}


@dataclass(frozen=True)
class Tie:
    """sum a f(x) + b x_0 x_1 + w sin 2 t, as at the start; or only its rate."""

    which: tuple[int, ...]
    a: tuple[float, ...]
    laws: tuple[str, ...]
    b: float
    w: float
    positions: bool

    def value(self, x: Sequence[Any], t: Any, m: Any) -> Any:
        """`m`: where the functions are from."""
        total = sum(a * LAWS[law][0](entry, m) for a, law, entry in zip(self.a, self.laws, x, strict=True))
        return total + self.b * x[0] * x[1] + self.w * m.sin(2 * t)

    def slopes(self, x: Sequence[Any], m: Any) -> list[Any]:
        """By x."""
        own = [a * LAWS[law][1](entry, m) for a, law, entry in zip(self.a, self.laws, x, strict=True)]
        return [own[0] + self.b * x[1], own[1] + self.b * x[0], *own[2:]]

    def part(self, kinds: Sequence[str], start: np.ndarray) -> ac.Component:
        """With a port p0, p1, ... for each."""
        tie, first = self, float(self.value([float(start[i]) for i in self.which], 0.0, np))

        def equations(part: Any):
            ports = [getattr(part, f"p{k}") for k in range(len(kinds))]
            x = [getattr(port, kind) for port, kind in zip(ports, kinds, strict=True)]
            slopes = tie.slopes(x, np)
            if tie.positions:
                yield ac.equal(tie.value(x, ac.time, np), first)
            else:
                yield ac.equal(
                    sum(s * ac.der(entry) for s, entry in zip(slopes, x, strict=True)) + 2 * tie.w * np.cos(2 * ac.time), 0.0
                )
            for port, kind, slope in zip(ports, kinds, slopes, strict=True):
                yield ac.equal(port.f if kind == "s" else port.tau, part.pull * slope)

        ports = {f"p{k}": (ac.Translational if kind == "s" else ac.Rotational).port() for k, kind in enumerate(kinds)}
        return type("TiePart", (ac.Component,), {**ports, "pull": ac.Variable("N"), "equations": equations})()


def sketch(rng: np.random.Generator) -> tuple[list[tuple[str, float]], list[Tie]]:
    """Kinds and inertias of two to four parts, and fewer ties than these, two at most."""
    n = int(rng.integers(2, 5))
    nodes = [(str(rng.choice(list(KINDS))), float(rng.uniform(0.3, 2))) for _ in range(n)]
    ties: list[Tie] = []
    for _ in range(int(rng.integers(1, min(n, 3)))):
        k = int(rng.integers(2, n + 1))
        which = tuple(sorted(int(i) for i in rng.choice(n, k, replace=False)))
        a = rng.uniform(0.3, 1.5, k) * rng.choice([-1, 1], k)
        b, w = rng.choice([0, 1], 2) * rng.uniform(0.1, 0.4, 2)
        ties.append(
            Tie(
                which,
                tuple(a.tolist()),
                tuple(str(law) for law in rng.choice(list(LAWS), k)),
                float(b),
                float(w),
                bool(rng.uniform() < 0.6),
            )
        )
    return nodes, ties


def scene_of(nodes: Sequence[tuple[str, float]], ties: Sequence[Tie], x0: np.ndarray) -> tuple[ac.System, list[Any], list[Any]]:
    """The scene, its positions and velocities."""
    scene, flanges = ac.System(), []
    scene.world, scene.nodes, scene.bodies, scene.ties = World(), [], [], []
    for kind, m in nodes:
        node = {
            "slide": lambda: Prismatic("z"),
            "hinge": lambda: Revolute("y"),
            "mass": lambda m=m: SlidingMass(m),
            "inertia": lambda m=m: Inertia(m),
        }[kind]()
        scene.nodes.append(node)
        flanges.append(node.flange if kind in ("slide", "hinge") else node.flange_a)
        if kind in ("slide", "hinge"):
            scene.bodies.append(RigidBody(m, (m, m, m), (0, 0, -ARM if kind == "hinge" else 0.0)))
            scene.connect(scene.world.frame, node.frame_a)
            scene.connect(node.frame_b, scene.bodies[-1].frame)
    for tie in ties:
        scene.ties.append(tie.part([KINDS[nodes[i][0]] for i in tie.which], x0))
        for k, i in enumerate(tie.which):
            scene.connect(flanges[i], getattr(scene.ties[-1], f"p{k}"))
    names = {"slide": ("q", "v"), "hinge": ("q", "v"), "mass": ("s", "v"), "inertia": ("phi", "w")}
    pairs = [[getattr(node, name) for name in names[kind]] for node, (kind, _) in zip(scene.nodes, nodes, strict=True)]
    return scene, [q for q, _ in pairs], [v for _, v in pairs]


def moved(
    nodes: Sequence[tuple[str, float]], ties: Sequence[Tie], x0: np.ndarray, wish: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Velocities at the start that the ties allow, near the wish, and positions and velocities at the end."""
    n = len(nodes)
    x, v, t = ca.SX.sym("x", n), ca.SX.sym("v", n), ca.SX.sym("t")
    M = np.array([m * (1 + ARM**2) if kind == "hinge" else m for kind, m in nodes])
    weights = [m * G * {"slide": x[i], "hinge": -ARM * ca.cos(x[i])}.get(kind, 0) for i, (kind, m) in enumerate(nodes)]
    g = ca.vertcat(*(tie.value([x[i] for i in tie.which], t, ca) for tie in ties))
    A, left = ca.jacobian(g, x), ca.jacobian(g, t)
    bias = ca.jtimes(A @ v + left, ca.vertcat(x, t), ca.vertcat(v, 1))
    parts = ca.Function("parts", [x, v, t], [ca.gradient(sum(weights), x), ca.densify(A), bias, ca.densify(left)])

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        force, A, bias, _ = (np.array(part) for part in parts(y[:n], y[n:], t))
        free = -force[:, 0] / M
        pull = np.linalg.solve(A @ (A / M).T, -bias[:, 0] - A @ free)
        return np.concatenate([y[n:], free + A.T @ pull / M])

    _, A, _, left = (np.array(part) for part in parts(x0, wish, 0.0))
    v0 = wish - np.linalg.pinv(A) @ (A @ wish + left[:, 0])
    return v0, solve_ivp(rate, (0, END), np.concatenate([x0, v0]), "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]


@pytest.mark.parametrize("seed", range(10))
def test_parts_that_are_tied_in_any_way_move_as_lagrange_says(seed):
    rng = np.random.default_rng(seed)
    nodes, ties = sketch(rng)
    x0 = rng.uniform(-0.5, 0.5, len(nodes))
    v0, exact = moved(nodes, ties, x0, rng.uniform(-1, 1, len(nodes)))
    scene, positions, velocities = scene_of(nodes, [ties[k] for k in rng.permutation(len(ties))], x0)
    model = ac.build(scene)
    start = dict(zip([*positions, *velocities], [*x0.tolist(), *v0.tolist()], strict=True))
    run = model.simulate(END, start, rtol=1e-10, samples=3)
    found = np.array([run[entry][-1] for entry in (*positions, *velocities)])
    np.testing.assert_allclose(found, exact, atol=1e-7 * max(1.0, float(np.max(np.abs(exact)))))
    if not any(tie.w for tie in ties):
        assert run.energy_error() < 1e-8
    # each relation takes a velocity, and one between positions a position too
    small = model.minimal(start)
    assert len(small.state_names) == 2 * len(nodes) - sum(1 + tie.positions for tie in ties)
    again = small.simulate(END, rtol=1e-10, samples=3)
    np.testing.assert_allclose(
        [again[entry][-1] for entry in positions], found[: len(nodes)], atol=1e-7 * max(1.0, float(np.max(np.abs(exact))))
    )
