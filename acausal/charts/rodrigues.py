"""Coordinates of configurations without redundancy: three numbers in place of each unit quaternion.

A unit quaternion q near a reference r is q = r * (1 - s, 2 sigma) / (1 + s) with s = sigma . sigma: the stereographic projection of
the sphere from the point opposite to r. sigma = axis * tan(angle / 4) of the rotation from r to q are modified Rodrigues parameters;
they are exact and rational, and meet infinity only after a full turn. Schaub and Junkins, Journal of the Astronautical Sciences 44 (1996).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class ChartCoordinates:
    """c (nc,) for configurations q (`size`,): the entries of q, but three numbers for every unit quaternion.

    `units`: where unit quaternions begin in q.
    """

    size: int
    units: tuple[int, ...]

    @property
    def count(self) -> int:
        """nc."""
        return self.size - len(self.units)

    @functools.cached_property
    def places(self) -> tuple[tuple[int, int], ...]:
        """For each part: where it begins in q, and its size in c: 3 for a unit quaternion, 1 for any other entry."""
        units = set(self.units)
        found: list[tuple[int, int]] = []
        k = 0
        while k < self.size:
            found.append((k, 3 if k in units else 1))
            k += 4 if k in units else 1
        return tuple(found)

    @functools.cached_property
    def _entries(self) -> tuple[range, ...]:
        found: list[range] = []
        first = 0
        for _, size in self.places:
            found += [range(first, first + size)] * (4 if size == 3 else 1)
            first += size
        return tuple(found)

    def entries(self, i: int) -> range:
        """Entries of c for entry `i` of q: all three for one of a unit quaternion."""
        return self._entries[i]

    def orientations(self, c: ca.SX) -> list[ca.SX]:
        """sigma (3, 1) of each unit quaternion."""
        return [c[list(self.entries(k))] for k in self.units]

    def configuration(self, c: ca.SX, reference: ca.SX) -> ca.SX:
        """q (size, 1) from c (nc, 1), near the configuration `reference`."""
        parts: list[ca.SX] = []
        first = 0
        for begin, size in self.places:
            own = c[first : first + size]
            parts.append(_on_sphere(own, reference[begin : begin + 4]) if size == 3 else own)
            first += size
        return ca.vertcat(ca.SX(0, 1), *parts)

    def coordinates(self, q: ca.SX, reference: ca.SX) -> ca.SX:
        """c (nc, 1) from q (size, 1), near the configuration `reference`."""
        parts: list[ca.SX] = []
        for begin, size in self.places:
            whole = slice(begin, begin + 4)
            parts.append(_projected(q[whole], reference[whole]) if size == 3 else q[begin])
        return ca.vertcat(ca.SX(0, 1), *parts)

    def names(self, states: Sequence[str], turn: str = "rodrigues") -> tuple[str, ...]:
        """Names of c from those of q, e.g. `ball.rodrigues[0]` for `ball.q[0]` ... `ball.q[3]`; `turn`: of the three numbers."""
        found: list[str] = []
        for begin, size in self.places:
            joint = states[begin].rpartition(".q")[0]
            found += [f"{joint}.{turn}[{i}]" for i in range(3)] if size == 3 else [states[begin]]
        return tuple(found)


def _on_sphere(sigma: ca.SX, reference: ca.SX) -> ca.SX:
    s = ca.sumsqr(sigma)
    return _times(reference, ca.vertcat(1 - s, 2 * sigma) / (1 + s))


def _projected(q: ca.SX, reference: ca.SX) -> ca.SX:
    away = _times(ca.vertcat(reference[0], -reference[1:]), q)
    return away[1:] / (1 + away[0])


def _times(a: ca.SX, b: ca.SX) -> ca.SX:
    """The product of two quaternions, scalar first."""
    return ca.vertcat(a[0] * b[0] - ca.dot(a[1:], b[1:]), a[0] * b[1:] + b[0] * a[1:] + ca.cross(a[1:], b[1:]))
