"""Diffrax on the equations by hand, in JAX with double precision."""

from __future__ import annotations

import functools
from typing import Any, ClassVar, final

import numpy as np

from benchmarks.peers.base import AbstractPeer, Prepared
from benchmarks.peers.equations import equations
from benchmarks.scenes import Built


@final
class Diffrax(AbstractPeer):
    """Explicit Runge-Kutta of order 5 and 8 and an ESDIRK of order 5, PID step control, compiled once for all tolerances."""

    name: ClassVar[str] = "diffrax"
    module: ClassVar[str] = "diffrax"

    def methods(self, scene: str) -> tuple[str, ...]:
        return ("Dopri5", "Dopri8", "Kvaerno5")

    def refusal(self, scene: str) -> str:
        return ""

    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        solve, start = _solver(built.scene.name, method, built.scene.end)

        def run() -> np.ndarray | None:
            y, success = solve(start, setting)
            return np.asarray(y) if bool(success) else None

        return Prepared(run, equations(built.scene.name, np.float64).observed)


@functools.cache
def _solver(name: str, method: str, end: float) -> tuple[Any, Any]:
    """(y0, tolerance) -> (y at the end, success), compiled; and y0."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    by_hand = equations(name, np.float64)
    term = diffrax.ODETerm(lambda t, y, args: by_hand.rate(y, jnp, jnp.linalg.solve))

    @jax.jit
    def solve(y0: Any, tolerance: Any) -> Any:
        solution = diffrax.diffeqsolve(
            term,
            getattr(diffrax, method)(),
            0.0,
            end,
            None,
            y0,
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            saveat=diffrax.SaveAt(t1=True),
            max_steps=100_000,
            adjoint=diffrax.ForwardMode(),
            throw=False,
        )
        return solution.ys[0], solution.result == diffrax.RESULTS.successful

    start = jnp.asarray(by_hand.start().astype(float))
    return solve.lower(start, 1e-3).compile(), start
