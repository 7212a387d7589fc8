"""Axes and rotations as a user writes them."""

from __future__ import annotations

import numpy as np

from acausal.language.expression import Expression
from acausal.parts.pose import Matrix, rotation_to_axis, rotation_to_axis_symbolic
from acausal.parts.rotations import Axis, Rotation, axis_vector, rotation_about, rotation_matrix

__all__ = ["Axis", "Rotation", "axis_vector", "mounting", "rotation_about", "rotation_matrix"]


def mounting(axis: np.ndarray | Expression) -> Matrix:
    """A rotation (3, 3) whose third axis is `axis`."""
    return rotation_to_axis_symbolic(axis.sx) if isinstance(axis, Expression) else rotation_to_axis(axis)
