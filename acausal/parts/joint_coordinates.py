"""Coordinates of a joint by kind: which are angles, quaternions, lengths, and how far two values of one are apart."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.parts.joint import AbstractJoint, AbstractStepJoint
from acausal.parts.steps import Turn
from acausal.parts.turning import turning
from acausal.parts.unit_quaternions import unit_quaternions
from acausal.wording import entry_names

_TINY = 1e-150
"""Added to a sine, so that the direction of a turn by nothing has a derivative."""


@dataclass(frozen=True)
class Coordinate:
    """One freedom of a joint in q: an angle, a unit quaternion (4 entries) or any other number. `name`: e.g. `arm.elbow.q`."""

    name: str
    place: slice
    unit: str
    turns: bool
    """Whether it turns something: an angle or a unit quaternion, measured without a length."""
    periodic: bool
    """The same up to full turns."""

    @property
    def is_rotation(self) -> bool:
        """Whether it is a unit quaternion, the same up to its sign."""
        return self.place.stop - self.place.start == 4

    def distance(self, a: np.ndarray, b: np.ndarray) -> float:
        """How far apart two configurations are in it: [rad] for angles (shortest way) and quaternions, else in its unit."""
        if self.is_rotation:
            p, q = a[self.place] / np.linalg.norm(a[self.place]), b[self.place] / np.linalg.norm(b[self.place])
            return float(4 * np.arcsin(min(1.0, min(np.linalg.norm(p - q), np.linalg.norm(p + q)) / 2)))
        change = float(b[self.place.start] - a[self.place.start])
        return float(abs(np.remainder(change + np.pi, 2 * np.pi) - np.pi)) if self.periodic else abs(change)

    def difference(self, a: ca.SX, b: ca.SX) -> ca.SX:
        """From configuration a to b, (1, 1) or for quaternions the turn (3, 1) in frame_b; its length is the distance, and it has a derivative."""
        p, q = a[self.place, :], b[self.place, :]
        if not self.is_rotation:
            return ca.atan2(ca.sin(q - p), ca.cos(q - p)) if self.periodic else q - p
        cosine = ca.dot(p, q)
        turn = p[0] * q[1:, :] - q[0] * p[1:, :] - ca.cross(p[1:, :], q[1:, :])
        sine = ca.sqrt(ca.sumsqr(turn) + _TINY**2)
        return 2 * ca.if_else(cosine < 0, -1, 1) * turn * ca.atan2(sine, ca.fabs(cosine)) / sine

    def value(self, q: np.ndarray) -> str:
        """The value in words."""
        entry = q[self.place]
        return "(" + ", ".join(f"{x:.4g}" for x in entry) + ")" if self.is_rotation else f"{float(entry[0]):.5g}"


def joint_coordinates(name: str, joint: AbstractJoint, first: int = 0) -> list[Coordinate]:
    """Of a joint of this name, whose q begins at the place `first`."""
    size, q, t = joint.q.size, ca.SX.sym("q", joint.q.size), ca.SX.sym("t")
    names = entry_names(name, size)
    stepped = isinstance(joint, AbstractStepJoint)
    units = set(unit_quaternions(joint.invariants(q, t), q).values())
    angles = (
        {i for step in joint.steps() if isinstance(step, Turn) for i in range(step.q.start, step.q.stop)}
        if stepped
        else set[int]()
    )
    turns = turning(joint)
    result: list[Coordinate] = []
    i = 0
    while i < size:
        if i in units:
            result.append(
                Coordinate(f"{name}[{i}:{i + 4}]" if size > 4 else name, slice(first + i, first + i + 4), "rad", True, False)
            )
            i += 4
            continue
        unit = "rad" if turns[i] else joint.q.unit or ("m" if units or stepped else "")
        result.append(Coordinate(names[i], slice(first + i, first + i + 1), unit, bool(turns[i]), i in angles))
        i += 1
    return result
