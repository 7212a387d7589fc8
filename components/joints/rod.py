"""A rigid link without mass."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.language.expression import Scalar, scalar, sx
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose, symbolic


@final
class Rod(AbstractConstraint):
    """A rigid rod without mass, of `length` [m] > 0, with ball joints at both ends: it keeps two points apart. Takes one freedom.

    0 = (|p_ab|^2 - length^2) / (2 length). Its force acts along the line between the points; it pulls and pushes. The ends may
    be particles. Raises `ParameterError` for a length that is not positive.

        scene.link = Rod(length=0.5)
    """

    between_points = True

    def __init__(self, length: Scalar) -> None:
        self.length = scalar(length, "Rod's length", positive=True, unit="m")

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        length = sx(self.length)
        return 0.5 * (ca.sumsqr(symbolic(X_ab.position)) / length - length)
