"""Which unknowns constraints with constant coefficients determine: as many as are independent, well, and the same in any units of the unknowns and the equations."""

from __future__ import annotations

import numpy as np
import pytest

from acausal.scalar.state_choice import choose_dummies


def chosen(A: np.ndarray) -> dict[int, int]:
    """Unknowns with high numbers are rather determined."""
    rows = {i: {j: float(a) for j, a in enumerate(row) if a != 0} for i, row in enumerate(A)}
    return choose_dummies(rows, [2] * len(A), set(), lambda j: (float(j),))


@pytest.mark.parametrize("seed", range(6))
def test_as_many_unknowns_are_determined_as_equations_are_independent_in_any_units(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = np.where(rng.random((5, 9)) < 0.6, rng.uniform(0.5, 2.0, (5, 9)) * rng.choice([-1.0, 1.0], (5, 9)), 0.0)
    A = np.vstack([A, A[0] - 2 * A[1] / 3, (A[2] + A[3] + A[4]) / 7])
    found = chosen(A)
    assert len(found) == len(set(found.values())) == np.linalg.matrix_rank(A)
    square = A[np.ix_(list(found), list(found.values()))]
    assert np.linalg.cond(square) < 1e4
    rows, units = 2.0 ** rng.integers(-20, 20, 7), 2.0 ** rng.integers(-20, 20, 9)
    assert chosen(A * rows[:, None] * units) == found


def test_of_unknowns_with_coefficients_of_like_size_the_preferred_one_is_determined() -> None:
    A = np.array([[1.0, 0.5, 0.002], [1.0, 1.0, 1.0]])
    assert chosen(A)[0] == 1
