"""A motion through charts, as a value."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.charts.chart import Chart
from acausal.language.expression import Expression
from acausal.simulate.trajectory import Trajectory


@dataclass(frozen=True, repr=False)
class MinimalMotion:
    """A motion in the states x of the model, and the `charts` it ran through, which tell when each began.

    `motion[variable]` reads the `trajectory`.
    """

    trajectory: Trajectory
    charts: tuple[Chart, ...]

    @property
    def t(self) -> np.ndarray:
        """Times (n,) [s]."""
        return self.trajectory.t

    @property
    def x(self) -> np.ndarray:
        """States of the model (nx, n)."""
        return self.trajectory.x

    def __getitem__(self, wanted: Expression | ca.SX) -> np.ndarray:
        return self.trajectory[wanted]

    def __str__(self) -> str:
        return "\n".join([str(self.trajectory), *(f"  {chart}" for chart in self.charts)])
