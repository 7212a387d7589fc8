"""Receding horizon: the same problem again and again from where the system is, each beginning at the solution before."""

from __future__ import annotations

import functools
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import OptimalControlError, OptionError
from acausal.optimal_control.checks import outside_at_start
from acausal.optimal_control.failing import REASONS
from acausal.optimal_control.guess import Guess
from acausal.optimal_control.mesh import through
from acausal.optimal_control.near_by import NearBy
from acausal.optimal_control.optimum import Optimum
from acausal.optimal_control.real_time import RealTime
from acausal.optimal_control.search import ipopt_options


class Controller:
    """States x (nx,) -> inputs u (nu,): the first inputs of the best motion from x on, which replaces the rest of the one before.

    `best`: the motion planned last; `rate` [s]: the time between two calls, by which plans are shifted; `solver`: "ipopt" finds the best motion in each call, where Newton's steps from
    the plan before do not lead to it; a solver of quadratic programs makes one step towards it. Made by `OptimalControl.controller`.
    """

    def __init__(self, best: Optimum, rate: float, solver: str, options: dict[str, Any]) -> None:
        transcribed = best.transcribed
        if transcribed.asked.start is None:
            raise OptionError(
                "controller: the problem must say its start (ocp.start), without anything free: the state takes its place."
            )
        self._planned, self.rate, self._w, self._iterations = best, rate, best.unknowns, best.iterations
        self._program = transcribed.program.balanced()
        self._multipliers: tuple[np.ndarray, np.ndarray] | None = None
        self._options = options
        self._step = None if solver == "ipopt" else RealTime(best, self._program, rate, solver, options)

    @property
    def best(self) -> Optimum:
        """The motion planned last."""
        if self._planned.unknowns is not self._w:
            cost = float(self._program.values(self._w)[0]) * self._program.unit
            self._planned = self._planned.again(self._w, cost, self._iterations, np.full(self._program.rows, np.nan))
        return self._planned

    def __call__(self, x: Any) -> np.ndarray:
        """Raises `OptimalControlError` where no motion is found."""
        transcribed = self._planned.transcribed
        nx = transcribed.asked.stage.sizes[0]
        state = np.asarray(x, dtype=float).ravel()
        if state.size != nx or not np.all(np.isfinite(state)):
            raise OptionError(f"controller: give {nx} finite states, not {x!r}.")
        found = None if self._step is None else self._step(self._w, state)
        if found is None:  # also where a step leads nowhere
            self._solved(state)
        else:
            self._w, self._iterations = found, 1
        stage, mesh = transcribed.asked.stage, transcribed.mesh
        places = transcribed.places[0, :, stage.width - stage.sizes[3] :]
        return self._beginning @ (self._w * transcribed.units)[places] if mesh.tableau.stages else np.zeros(0)

    @functools.cached_property
    def _beginning(self) -> np.ndarray:
        """(stages,): a polynomial's value at the beginning of an interval, by its values at the points."""
        c = self._planned.mesh.tableau.c
        return through(c, np.eye(c.size))[-1]

    @functools.cached_property
    def _near(self) -> NearBy:
        return NearBy(self._program)

    @functools.cached_property
    def _first(self) -> ca.Function:
        return self._solver(known=False)

    @functools.cached_property
    def _again(self) -> ca.Function:
        return self._solver(known=True)

    def _solver(self, *, known: bool) -> ca.Function:
        own = {} if self._step is not None else self._options
        return self._program.solver("ipopt", {**ipopt_options(warm=True, known=known), **own, "error_on_fail": False})

    def _solved(self, state: np.ndarray) -> None:
        """All the way."""
        program, transcribed = self._program, self._planned.transcribed
        bounds = program.bounds.copy()
        bounds[:, : state.size] = state / transcribed.units[: state.size]
        guess = transcribed.unknowns(self._shifted(state))
        (least, most), (lower, upper) = bounds, program.limits
        more: dict[str, Any] = {}
        solver = self._first
        near = (
            None
            if self._multipliers is None or self._options
            else self._near(np.clip(guess, least, most), *self._multipliers, bounds)
        )
        if near is not None:
            self._w, *multipliers, self._iterations = near
            self._multipliers = multipliers[0], multipliers[1]
            return
        if self._multipliers is not None:
            solver, more = self._again, {"lam_x0": self._multipliers[0], "lam_g0": self._multipliers[1]}
        given: dict[str, Any] = {"x0": np.clip(guess, least, most), "lbx": least, "ubx": most, "lbg": lower, "ubg": upper}
        found, stats = solver(**given, **more), solver.stats()
        if not stats["success"] and self._multipliers is not None:  # what pressed before says nothing here
            found, solver = self._first(**given), self._first
            stats = solver.stats()
        w, iterations = np.array(found["x"]).ravel(), int(stats["iter_count"])
        if not stats["success"]:  # the plan before goes on
            self._multipliers = None
            failed = self._planned.again(w, float(found["f"]) * program.unit, iterations, np.full(program.rows, np.nan))
            raise OptimalControlError(self._failure(state, stats["return_status"]), failed)
        of_bounds, of_rows = (np.array(found[name]).ravel() for name in ("lam_x", "lam_g"))
        self._w, self._iterations, self._multipliers = w, iterations, (of_bounds, of_rows)

    def _failure(self, state: np.ndarray, status: str) -> str:
        asked, motion = self._planned.transcribed.asked, self._planned.motion
        beyond = [words for limits in asked.path for words in outside_at_start(asked, limits, state, motion)]
        return (
            f"No motion was found from the states {state}: {REASONS.get(status, status)}. {' '.join(beyond)}{' ' if beyond else ''}"
            "Where disturbances may carry states beyond their bounds, let the cost keep them inside: ac.integral(1e3 * scene.rail.q**2); and ask for less at the end, or in more time."
        )

    def _shifted(self, state: np.ndarray) -> Guess:
        """The plan before, later by the rate, and with its end held."""
        motion = self.best.motion
        values = motion.at(np.clip(motion.times + self.rate / motion.duration, 0.0, 1.0))
        values[0, : state.size] = state
        return Guess(motion.times, values, motion.duration, motion.free)
