"""Receding horizon: the same problem again and again from where the system is, each beginning at the solution before."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import OptimalControlError, OptionError
from acausal.optimal_control.guess import Guess
from acausal.optimal_control.mesh import through
from acausal.optimal_control.optimum import Optimum
from acausal.optimal_control.solving import ipopt_options


class Controller:
    """States x (nx,) -> inputs u (nu,): the first inputs of the best motion from x on, which replaces the rest of the one before.

    `best`: the motion planned last; `rate` [s]: the time between two calls, by which plans are shifted. Made by `OptimalControl.controller`.
    """

    def __init__(self, best: Optimum, rate: float, options: dict[str, Any]) -> None:
        transcribed = best.transcribed
        if transcribed.asked.start is None:
            raise OptionError(
                "controller: the problem must say its start (ocp.start), without anything free: the state takes its place."
            )
        self.best, self.rate = best, rate
        self._program = transcribed.program.balanced()
        self._solver = self._program.solver("ipopt", {**ipopt_options(warm=True), **options, "error_on_fail": False})
        self._multipliers: tuple[ca.DM, ca.DM] | None = None

    def __call__(self, x: Any) -> np.ndarray:
        """Raises `OptimalControlError` where no motion is found."""
        transcribed = self.best.transcribed
        program, nx = self._program, transcribed.asked.stage.sizes[0]
        state = np.asarray(x, dtype=float).ravel()
        if state.size != nx or not np.all(np.isfinite(state)):
            raise OptionError(f"controller: give {nx} finite states, not {x!r}.")
        bounds = program.bounds.copy()
        bounds[:, :nx] = state / transcribed.units[:nx]
        guess = transcribed.unknowns(self._shifted(state))
        (least, most), (lower, upper) = bounds, program.limits
        more: dict[str, Any] = {}
        if self._multipliers is not None:
            more = {"lam_x0": self._multipliers[0], "lam_g0": self._multipliers[1]}
        found = self._solver(x0=np.clip(guess, least, most), lbx=least, ubx=most, lbg=lower, ubg=upper, **more)
        stats = self._solver.stats()
        w = np.array(found["x"]).ravel()
        best = self.best.again(w, float(found["f"]) * program.unit, int(stats["iter_count"]))
        if not stats["success"]:
            raise OptimalControlError(f"No motion was found from the states {state}: {stats['return_status']}.", best)
        self.best, self._multipliers = best, (found["lam_x"], found["lam_g"])
        stage, mesh = transcribed.asked.stage, transcribed.mesh
        nu = stage.sizes[3]
        first = best.motion.values[1 : 1 + mesh.tableau.stages, stage.width - nu :]
        return through(mesh.tableau.c, first)[-1]  # its value at the beginning

    def _shifted(self, state: np.ndarray) -> Guess:
        """The plan before, later by the rate, and with its end held."""
        motion = self.best.motion
        values = motion.at(np.clip(motion.times + self.rate / motion.duration, 0.0, 1.0))
        values[0, : state.size] = state
        return Guess(motion.times, values, motion.duration, motion.free)
