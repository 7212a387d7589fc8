"""SUNDIALS through scikit-sundae on the model's compiled dynamics."""

from __future__ import annotations

from typing import Any, ClassVar, final

import numpy as np

from benchmarks.peers.base import AbstractPeer, Prepared
from benchmarks.peers.compiled import dynamics
from benchmarks.scenes import Built


@final
class Sundae(AbstractPeer):
    """CVODE (Adams without Jacobian, BDF with) and IDA on x' - f(t, x) = 0, with callbacks into compiled C through Python."""

    name: ClassVar[str] = "sundae"
    module: ClassVar[str] = "sksundae"

    def methods(self, scene: str) -> tuple[str, ...]:
        return ("CVODE Adams", "CVODE BDF", "IDA")

    def refusal(self, scene: str) -> str:
        return ""

    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        rate, slope = dynamics(built)
        x0 = built.model.initial_state(built.start).x
        span = np.array([0.0, built.scene.end / 2, built.scene.end])  # of two times, it would keep every step
        options = {"rtol": setting, "atol": setting, "max_num_steps": 50_000}
        solver = _ida(rate, slope, options) if method == "IDA" else _cvode(rate, slope, method.split()[1], options)
        start = (x0, rate(0.0, x0).copy()) if method == "IDA" else (x0,)

        def run() -> np.ndarray | None:
            solution = solver.solve(span, *start)
            return solution.y[-1] if solution.success else None

        return Prepared(run, built.observe)


def _cvode(rate: Any, slope: Any, method: str, options: dict[str, Any]) -> Any:
    from sksundae.cvode import CVODE

    def rhs(t: float, y: np.ndarray, yp: np.ndarray) -> None:
        yp[:] = rate(t, y)

    def jacobian(t: float, y: np.ndarray, yp: np.ndarray, J: np.ndarray) -> None:
        J[:, :] = slope(t, y)

    return CVODE(rhs, method=method, jacfn=jacobian if method == "BDF" else None, **options)


def _ida(rate: Any, slope: Any, options: dict[str, Any]) -> Any:
    from sksundae.ida import IDA

    def residual(t: float, y: np.ndarray, yp: np.ndarray, res: np.ndarray) -> None:
        np.subtract(yp, rate(t, y), out=res)

    def jacobian(t: float, y: np.ndarray, yp: np.ndarray, res: np.ndarray, cj: float, J: np.ndarray) -> None:
        J[:, :] = -slope(t, y)
        J.flat[:: J.shape[0] + 1] += cj

    return IDA(residual, jacfn=jacobian, **options)
