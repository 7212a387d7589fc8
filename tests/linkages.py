"""Linkages in a plane, from points of a sketch with closed loops: all hinges are at zero in it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

import acausal as ac
from components import Prismatic, Revolute, RigidBody, World

Points = dict[str, np.ndarray]


def polar(center: np.ndarray, radius: float, angle: float) -> np.ndarray:
    return center + radius * np.array([np.cos(angle), np.sin(angle)])


def meeting(a: np.ndarray, b: np.ndarray, one: float, other: float) -> np.ndarray:
    """The point to the left of the way from a to b that is so far from them."""
    way = b - a
    part = (one**2 - other**2 + way @ way) / (2 * (way @ way))
    return a + part * way + np.sqrt(max(one**2 / (way @ way) - part**2, 0.0)) * np.array([-way[1], way[0]])


class Linkage(ac.System):
    """`bars`: mass and points of each; a point of several is a hinge. `ground`: fixed points; `slides`: number of a bar, direction and point in which it is
    led along the ground. Lengths times `length`, all turned by `R` and shifted.
    """

    def __init__(
        self, points: Points, bars: Sequence[tuple[float, Sequence[str]]], ground: Sequence[str], slides: Sequence[tuple[int, tuple[float, float], str]] = (),
        length: float = 1.0, R: np.ndarray | None = None, shift: Sequence[float] = (0, 0, 0), gravity: float = 9.81, order: Sequence[int] | None = None,
    ) -> None:  # fmt: skip
        turn = np.eye(3) if R is None else R

        def placed(v: np.ndarray) -> tuple[float, ...]:
            return tuple(turn @ np.append(v, 0.0) * length)

        def led(v: tuple[float, float]) -> tuple[float, ...]:
            return tuple(turn @ np.append(v, 0.0))

        self.world = World(tuple(turn @ (0, -gravity * length, 0)))
        holders = {p: [self.world.at(tuple(np.array(placed(points[p])) + shift))] for p in ground}
        middles = [np.mean([points[p] for p in names], axis=0) for _, names in bars]
        made: dict[int, RigidBody] = {}
        for k in order if order is not None else range(len(bars)):
            mass, names = bars[k]
            long = max(float(np.linalg.norm(points[p] - points[q])) for p in names for q in names) or 0.3
            inertia = turn @ np.diag([0.1, 1, 1]) @ turn.T * mass * (long * length) ** 2 / 12
            made[k] = RigidBody(mass, inertia, position=tuple(np.array(placed(middles[k])) + shift))
            for p in names:
                holders.setdefault(p, []).append(made[k].at(placed(points[p] - middles[k])))
        self.bars = [made[k] for k in range(len(bars))]
        pairs = [(p, a, b) for p, ends in holders.items() for a, b in itertools.pairwise(ends)]
        self.at = [p for p, _, _ in pairs]
        self.hinges = [Revolute(tuple(turn[:, 2])) for _ in pairs]
        for hinge, (_, a, b) in zip(self.hinges, pairs, strict=True):
            self.connect(a, hinge.frame_a)
            self.connect(hinge.frame_b, b)
        self.slides = [Prismatic(led(way)) for _, way, _ in slides]
        for slide, (k, _, p) in zip(self.slides, slides, strict=True):
            self.connect(self.world.at(tuple(np.array(placed(points[p])) + shift)), slide.frame_a)
            self.connect(slide.frame_b, self.bars[k].at(placed(points[p] - middles[k])))

    def hinge(self, point: str) -> Revolute:
        return self.hinges[self.at.index(point)]


def peaucellier(angle: float = 1.22, **how: object) -> Linkage:
    """Arms of 1 m, a rhombus of 0.4 m, a crank of 0.5 m: the rhombus goes through a line."""
    o, c = np.zeros(2), np.array([0.5, 0.0])
    p = polar(c, 0.5, angle)
    a, b = meeting(o, p, 1.0, 0.4), meeting(p, o, 0.4, 1.0)
    points = {"O": o, "C": c, "P": p, "A": a, "B": b, "Q": p * 0.84 / (p @ p)}
    bars = [(1.0, "OA"), (1.0, "OB"), (1.0, "CP"), (0.5, "AP"), (0.5, "BP"), (0.5, "AQ"), (0.5, "BQ")]
    return Linkage(points, bars, "OC", **how)  # pyright: ignore[reportArgumentType]


def hart(**how: object) -> Linkage:
    """An antiparallelogram with a point of one bar fixed, another led round a circle, so that a third draws a line."""
    short, diagonal, part = 0.5, 1.0, 0.45
    long = (diagonal**2 - 0.36) / short
    high = np.sqrt(diagonal**2 - ((short + long) / 2) ** 2)
    a, c = np.array([-short / 2, 0]), np.array([short / 2, 0])
    d, b = np.array([-long / 2, high]), np.array([long / 2, high])
    o, p, q = a + part * (b - a), a + part * (d - a), c + part * (b - c)
    aside = np.array([-(p - o)[1], (p - o)[0]]) / np.linalg.norm(p - o)
    points = {"A": a, "B": b, "C": c, "D": d, "O": o, "P": p, "Q": q, "E": (o + p) / 2 + 0.3 * aside}
    return Linkage(points, [(1.0, "ABO"), (1.0, "CD"), (0.7, "BCQ"), (0.7, "DAP"), (0.5, "EP")], "OE", **how)  # pyright: ignore[reportArgumentType]


def scissors(cells: int, angle: float = 0.7, half: float = 0.3, **how: object) -> Linkage:
    """A chain of crossed bars between a fixed hinge and a slide: all cells are flat at once."""
    along, high = half * np.array([np.cos(angle), np.sin(angle)])
    points: Points = {"slide": np.array([0, 2 * high])}
    bars: list[tuple[float, Sequence[str]]] = []
    for k in range(cells + 1):
        points |= {f"l{k}": np.array([2 * k * along, 0.0]), f"u{k}": np.array([2 * k * along, 2 * high])}
    for k in range(cells):
        points[f"m{k}"] = np.array([(2 * k + 1) * along, high])
        bars += [(1.0, (f"l{k}", f"m{k}", f"u{k + 1}")), (1.0, (f"u{k}", f"m{k}", f"l{k + 1}"))]
    bars.append((0.5, ("u0", "slide")))
    return Linkage(points, bars, ["l0"], [(2 * cells, (0, 1), "slide")], **how)  # pyright: ignore[reportArgumentType]
