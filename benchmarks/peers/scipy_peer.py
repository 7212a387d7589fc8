"""SciPy's integrators on the model's compiled dynamics."""

from __future__ import annotations

from typing import ClassVar, final

import numpy as np

from benchmarks.peers.base import AbstractPeer, Prepared
from benchmarks.peers.compiled import dynamics
from benchmarks.scenes import Built


@final
class Scipy(AbstractPeer):
    """`scipy.integrate.solve_ivp`; the implicit methods get the exact Jacobian. Loops drift: nothing is projected."""

    name: ClassVar[str] = "scipy"
    module: ClassVar[str] = "scipy"

    def methods(self, scene: str) -> tuple[str, ...]:
        return ("DOP853", "LSODA", "Radau")

    def refusal(self, scene: str) -> str:
        return ""

    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        from scipy.integrate import solve_ivp

        rate, slope = dynamics(built)
        x0 = built.model.initial_state(built.start).x
        rtol = max(setting, 3e-14)  # less is refused
        options = {"method": method, "rtol": rtol, "atol": setting, "t_eval": [built.scene.end]}
        if method != "DOP853":
            options["jac"] = lambda t, x: slope(t, x).copy()

        def run() -> np.ndarray | None:
            solution = solve_ivp(lambda t, x: rate(t, x).copy(), (0.0, built.scene.end), x0, **options)
            return solution.y[:, -1] if solution.success else None

        return Prepared(run, built.observe)
