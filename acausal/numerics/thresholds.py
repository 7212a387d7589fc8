"""Thresholds of all decisions that are taken by numbers. Each meets numbers without unit only: fractions of a size, sines, turns.

What a residual or a coefficient is compared with is said by `sizes` and `rounding`, from the rows and unknowns themselves.
"""

from __future__ import annotations

import numpy as np

ROUNDING = 64 * float(np.finfo(float).eps)
"""A row is zero where it is at most this times the sum of the sizes of its terms."""
CLOSED = 3e-13
"""... or at most this times the row's own size: constants are often typed with so many digits."""
GIVEN = 1e-6
"""States that users type meet the constraints to this part of the rows' sizes."""
DEPENDENT = 1e-9
"""Singular values below this, of rows and columns brought to size one, count as zero: steps do not go there."""
RANK = 1e-7
"""The same where rows are counted: configurations are closed to `CLOSED`, and 1e-7 above that no row is independent by accident."""
FOLLOWS = 1e-12
"""A row that follows from others does so to this part of its size wherever loops are closed: as lengths that fit to `CLOSED` make it."""
INDEPENDENT = 4e-6
"""Rows whose smallest singular value is below this wherever loops are closed are as good as dependent: nearer to `SINGULAR` they look like it."""
SINGULAR = 1e-6
"""A position is singular where the smallest of the singular values that are usual is below this: lengths that fit to about `CLOSED` do."""
CROSSING = 1e-6
"""The same where a state given is one: nearer to it no coordinates stand for the others."""
NEARLY = 3e-2
"""Rows that are independent by less than this are named when nothing can move: lengths or axes may be meant to fit."""
STRIDE = 0.7
"""Longest step of a search: rad, or fractions of the length that belongs to the coordinate."""
CORNER = 1e130
"""Derivatives beyond this are those of a corner, as of the length of a vector that is zero: `ac.norm` and angles round it off by 1e-150."""
EDGE = 1e-9
"""Cosine of a wheel's lean, or between a hinge's axes, that is zero but for rounding; what may be left, as part of them, of lengths that are to be
the same and of powers that are to cancel.
"""
