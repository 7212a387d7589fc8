"""Magnitudes of what joints bear, where these depend on frictions that are limited by them: s = |a + B s|, entry by entry.

One solution for every load as long as the matrix of |B_ij| has no eigenvalue of one or more. Magnitudes that depend on one another are solved together: those of one
component, whose sign is held, as linear equations; a single one of more components by its quadratic equation; more of them by Newton's iteration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from acausal.dynamics.mode_rows import Size
from acausal.graphs import Graph
from acausal.language.expression import Mode
from acausal.numerics.elimination import eliminated

_STEPS = 7
"""Of Newton's iteration: to rounding while the largest eigenvalue is below 0.95, and nearly so up to 0.99."""
_LEAST, _TINY = 1e-280, 1e-130
"""Added below roots, and to what is divided by: they change nothing, and leave a value and a derivative where all is zero."""
_OPEN = 1e-8
"""Part of a magnitude by which its equation may be open: beyond it Newton's iteration has not come to a solution."""


@dataclass(frozen=True)
class Magnitudes:
    """`sizes`, and masks `along` (3 each): directions, fixed while a mode lasts, that each force has a positive component along; where that vanishes, the magnitude
    may have a kink, and the direction is taken anew.
    """

    sizes: tuple[Size, ...]
    along: tuple[tuple[Mode, ...], ...]

    @property
    def symbols(self) -> ca.SX:
        """(m, 1)."""
        return ca.vertcat(ca.SX(0, 1), *(size.symbol.sx for size in self.sizes))

    @property
    def masks(self) -> tuple[Mode, ...]:
        """All, in the order of the inputs."""
        return tuple(mask for own in self.along for mask in own)

    def components(self, reactions: ca.SX, values: ca.SX) -> list[ca.SX]:
        """Of each size (c, 1), by values of the reactions."""
        return [ca.substitute(size.of, reactions, ca.densify(values)) for size in self.sizes]

    def solved(self, a: Sequence[ca.SX], B: Sequence[ca.SX]) -> ca.SX:
        """s (m, 1), with a_i (c, 1) and B_i (c, m)."""
        found = ca.SX.zeros(len(self.sizes))
        linked = [(i, j) for i, by in enumerate(B) for j in range(by.shape[1]) if i != j and not by[:, j].is_zero()]
        for group in Graph(range(len(self.sizes)), linked).parts():
            own = sorted(group)
            plain = [i for i in own if a[i].numel() == 1]
            rest = [i for i in own if i not in plain]
            # those whose sign is held, by the others: e + E s
            signs = [self.along[i][0].sx for i in plain]
            A = ca.SX.eye(len(plain)) - ca.vertcat(
                ca.SX(0, len(plain)), *(sign * B[i][:, plain] for sign, i in zip(signs, plain, strict=True))
            )
            right = [ca.horzcat(sign * a[i], sign * B[i][:, rest]) for sign, i in zip(signs, plain, strict=True)]
            by = eliminated(ca.densify(A), ca.vertcat(ca.SX(0, 1 + len(rest)), *right))
            e, E = by[:, 0], by[:, 1:]
            s = _solved([a[i] + B[i][:, plain] @ e for i in rest], [B[i][:, rest] + B[i][:, plain] @ E for i in rest])
            found[rest] = s
            found[plain] = e + E @ s
        return found

    def guards(self, forces: Sequence[ca.SX], a: Sequence[ca.SX], B: Sequence[ca.SX], s: ca.SX) -> ca.SX:
        """Two each: how far a force goes along its direction, and how far it is from where there is another solution, or none, or none is found."""
        m = len(self.sizes)
        A = ca.SX.eye(m) - ca.vertcat(
            ca.SX(0, m), *(ca.horzcat(*(_norm(by[:, j]) if not by[:, j].is_zero() else ca.SX(0) for j in range(m))) for by in B)
        )
        found: list[ca.SX] = []
        for k, (force, along) in enumerate(zip(forces, self.along, strict=True)):
            for i in range(k + 1, m):
                if not A[i, k].is_zero():
                    A[i, k + 1 :] -= A[i, k] / A[k, k] * A[k, k + 1 :]
            size = _norm(a[k] + B[k] @ s)
            gap = (size - s[k]) / (_OPEN * (size + _TINY)) if force.numel() > 1 else 0
            found += [ca.dot(ca.vertcat(*(mask.sx for mask in along[: force.numel()])), force), A[k, k] - gap * gap]
        return ca.vertcat(ca.SX(0, 1), *found)


def _norm(force: ca.SX) -> ca.SX:
    return ca.sqrt(ca.sumsqr(force) + _LEAST)


def _alone(a: ca.SX, b: ca.SX) -> ca.SX:
    """s = |a + b s|."""
    ab, rest = ca.dot(a, b), 1 - ca.sumsqr(b)
    return (ab + ca.sqrt(ab * ab + rest * ca.sumsqr(a) + _LEAST)) / rest


def _solved(a: Sequence[ca.SX], B: Sequence[ca.SX]) -> ca.SX:
    """s_i = |a_i + B_i s|."""
    m = len(a)
    s = ca.vertcat(ca.SX(0, 1), *map(_norm, a))
    first = [_alone(a[i] + B[i] @ s - B[i][:, i] * s[i], B[i][:, i]) for i in range(m)]
    s = ca.vertcat(ca.SX(0, 1), *first)
    for _ in range(_STEPS if m > 1 else 0):
        along = [force / _norm(force) for force in (a[i] + B[i] @ s for i in range(m))]
        slope = ca.vertcat(*(e.T @ by for e, by in zip(along, B, strict=True)))
        s = eliminated(ca.densify(ca.SX.eye(m) - slope), ca.vertcat(*(ca.dot(e, own) for e, own in zip(along, a, strict=True))))
    return s
