"""Magnitudes of forces that depend on one another, s = |a + B s|: drawn such that the sizes are known beforehand."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from acausal.dynamics.mode_rows import Size
from acausal.language.expression import Magnitude, Mode
from acausal.reduce.magnitudes import Magnitudes
from tests.pairings import each_value


class Drawn:
    """Forces a_i + B_i s (3 components each) of known sizes s, which differ by up to a thousand; `most`: the largest eigenvalue of the matrix of |B_ij|."""

    def __init__(self, count: int, most: float, seed: int) -> None:
        rng = np.random.default_rng(seed)
        B = rng.normal(size=(count, 3, count)) * 10 ** np.array([0.0, -2.0, -1.0])[:, None]
        self.B = B * most / np.max(np.abs(np.linalg.eigvals(np.linalg.norm(B, axis=1))))
        self.s = 10 ** rng.uniform(-3, 0, count)
        direction = rng.normal(size=(count, 3)) * [1.0, 0.1, 1e-3]
        self.force = direction * (self.s / np.linalg.norm(direction, axis=1))[:, None]
        self.a = self.force - self.B @ self.s
        # each force is taken along the first axis
        axes = tuple(tuple(Mode("along", "") for _ in range(3)) for _ in range(count))
        self.along = ca.vertcat(*(mask.sx for own in axes for mask in own))
        self.magnitudes = Magnitudes(tuple(Size(Magnitude([1.0, 1.0, 1.0]), ca.SX.ones(3)) for _ in range(count)), axes)

    def solved(self) -> np.ndarray:
        return np.array(ca.evalf(self.magnitudes.solved(*self._rows()))).ravel()

    def guards(self, s: np.ndarray) -> np.ndarray:
        """(count, 2)."""
        force = [ca.SX(own) for own in self.force]
        found = self.magnitudes.guards(force, *self._rows(), ca.SX(s))
        return np.array(ca.evalf(ca.substitute(found, self.along, ca.DM([1.0, 0.0, 0.0] * self.s.size)))).reshape(-1, 2)

    def _rows(self) -> tuple[list[ca.SX], list[ca.SX]]:
        return [ca.SX(own) for own in self.a], [ca.SX(own) for own in self.B]


@each_value(("count", [2, 3, 4]), ("most", [0.5, 0.95]))
def test_sizes_that_depend_on_one_another_are_found_to_rounding(count: int, most: float) -> None:
    for seed in range(6):
        drawn = Drawn(count, most, seed)
        assert drawn.solved() == pytest.approx(drawn.s, rel=1e-11), seed


@pytest.mark.parametrize("count", [1, 2, 3])
def test_guards_of_sizes_are_positive_where_there_is_one_solution_and_it_has_been_found(count: int) -> None:
    for seed in range(4):
        one, more = Drawn(count, 0.99, seed), Drawn(count, 1.01, seed)
        assert one.guards(one.s)[:, 0] == pytest.approx(one.force[:, 0])
        assert np.min(one.guards(one.s)[:, 1]) > 0
        assert np.min(more.guards(more.s)[:, 1]) < 0
        # equations that are open by 1e-10 are met, by 1e-7 are not, whatever depends on what
        for part, met in ((1e-10, True), (1e-7, False)):
            drawn = Drawn(count, 0.5, seed)
            by = np.linalg.solve(np.eye(count) - np.einsum("ic,icj->ij", drawn.force / drawn.s[:, None], drawn.B), part * drawn.s)
            assert (np.min(drawn.guards(drawn.s - by)[:, 1]) > 0) == met, (seed, part)
