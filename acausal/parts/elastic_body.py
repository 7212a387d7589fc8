"""Elastic bodies: a joint with inertia, whose coordinates are modal amplitudes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import final

import casadi as ca
import numpy as np

from acausal.language.connector import Frame
from acausal.language.expression import Expression, Variable
from acausal.parts.joint import AbstractJoint
from acausal.parts.modal_inertia import ElasticBody
from acausal.parts.motion import Motion
from acausal.parts.pose import Pose, symbolic


class AbstractElasticBody(AbstractJoint, ABC):
    """A body that deforms in n given shapes: frame_a is its floating frame of reference, frame_b its tip. Both may be left free.

    q: modal amplitudes, v = q'. Must provide `body()`, and call `_set_count` when it is made. Displacements are small against the body's
    size; the tip's small angles are taken as Rodrigues parameters, twice the tangent of half the angle, so that it turns rigidly.
    """

    frame_a = Frame.port()
    frame_b = Frame.port()
    q = Variable("", "modal amplitudes")
    v = Variable("1/s", "rates of the modal amplitudes")

    @abstractmethod
    def body(self) -> ElasticBody:
        """Inertia, stiffness, damping and the tip's motion."""

    def _set_count(self, count: int) -> None:
        """Give q and v as many entries as there are shapes."""
        for name, declared in (("q", type(self).q), ("v", type(self).v)):
            self._declare(name, declared.unit, count)

    @final
    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        body = self.body()
        return Pose(_turned(_half_angles(body, q)), symbolic(body.tip) + symbolic(body.tip_shapes) @ q)

    @final
    def motions(self, q: ca.SX, v: ca.SX, t: ca.SX) -> tuple[Motion, ...]:
        """Nothing up to the floating frame, where the inertia is, and the tip's motion in it."""
        none = ca.SX(0, 1)
        still = Motion(Pose.identity(), none, ca.SX(6, 0), ca.SX.zeros(6), ca.SX.zeros(6), none)
        X, g = self.pose(q, t), _half_angles(self.body(), q)
        R = symbolic(X.rotation)
        turns = 0.5 * symbolic(self.body().tip_turns)
        slope = 2 / (1 + ca.sumsqr(g))
        S_w = slope * (turns - ca.skew(g) @ turns)
        S_v = R.T @ symbolic(self.body().tip_shapes)
        w = S_w @ v
        bias = ca.vertcat(-slope * ca.dot(g, turns @ v) * w, ca.SX.zeros(3))
        subspace = ca.sparsify(ca.vertcat(S_w, S_v))
        return still, replace(still, pose=X, rates=v, subspace=subspace, twist=ca.vertcat(w, S_v @ v), bias=bias, v=v)

    @final
    def stored_energy(self) -> Expression:
        """q' stiffness q / 2."""
        q = self.q.sx
        return Expression(0.5 * ca.dot(q, symbolic(self.body().stiffness) @ q), frozenset({self.q}))

    @final
    def dissipated_power(self) -> Expression:
        """v' damping v."""
        v = self.v.sx
        return Expression(ca.dot(v, symbolic(self.body().damping) @ v), frozenset({self.v}))


def _half_angles(body: ElasticBody, q: ca.SX) -> ca.SX:
    """Rodrigues parameters of the tip (3, 1)."""
    return 0.5 * symbolic(body.tip_turns) @ q


def _turned(g: ca.SX) -> ca.SX | np.ndarray:
    """Rotation (3, 3) by Rodrigues parameters."""
    if g.is_zero():
        return np.eye(3)
    G = ca.skew(g)
    return ca.SX.eye(3) + 2 / (1 + ca.sumsqr(g)) * (G + G @ G)
