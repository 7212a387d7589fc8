"""Entries of sparse matrices: kernels give these only, and they are put where they belong."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np


def entries(matrices: Sequence[ca.SX]) -> ca.SX:
    """Of all matrices, column by column, one after the other (k, 1)."""
    return ca.vertcat(ca.SX(0, 1), *(ca.vec(matrix.nz[:]) for matrix in matrices if matrix.nnz()))


def places(pattern: ca.Sparsity) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the entries of a matrix."""
    rows, columns = pattern.get_triplet()
    return np.array(rows, dtype=int), np.array(columns, dtype=int)


def placed(values: np.ndarray, rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The whole matrix, column-major."""
    whole = np.zeros(shape, order="F")
    whole[rows, columns] = values
    return whole
