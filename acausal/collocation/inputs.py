"""Inputs of an integration as functions of time."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.language.pieces import PiecewisePolynomial


@dataclass(frozen=True)
class Formula:
    """A CasADi function of time alone, (t) -> a number, that jumps or bends where one of `clocks`, (value at t = 0, slope [1/s], whether it counts), is
    zero, or whole where it counts."""

    function: ca.Function
    clocks: tuple[tuple[float, float, int], ...] = ()

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """Values (n,) at times (n,)."""
        return np.array(self.function(times[None, :])).ravel()


Course = float | PiecewisePolynomial | Formula | Callable[[float], float]
"""What an input is: a number, a table or a formula, which the runtime knows, or a function of one number."""


@dataclass(frozen=True)
class Copied:
    """A function of time as what it was in the steps of a motion: for copies and files, which cannot have the function."""

    values: Callable[[np.ndarray], np.ndarray]

    def __call__(self, t: float) -> float:
        return float(self.values(np.array([t]))[0, 0])


@dataclass(frozen=True, eq=False)
class Inputs:
    """times (n,) -> inputs (nu, n)."""

    courses: tuple[Course, ...]

    def copied(self, through: Callable[[Callable[[np.ndarray], np.ndarray]], Callable[[np.ndarray], np.ndarray]]) -> Inputs:
        """The same for files, with what goes `through` the values of a function in place of one that cannot be pickled."""
        lost = {i: f for i, f in self.functions if not _can_be_pickled(f)}
        if not lost:
            return self
        made = {i: Copied(through(lambda t, f=f: np.array([[f(float(one)) for one in t]]))) for i, f in lost.items()}
        return Inputs(tuple(made.get(i, course) for i, course in enumerate(self.courses)))

    def __call__(self, times: np.ndarray) -> np.ndarray:
        result = np.empty((len(self.courses), times.size))
        for i, course in enumerate(self.courses):
            if isinstance(course, PiecewisePolynomial | Formula):
                result[i] = course(times)
            else:
                result[i] = [course(float(t)) for t in times] if callable(course) else course
        return result

    @property
    def numbers(self) -> np.ndarray:
        """(nu,) those that do not change, 0 for others."""
        return np.array([0.0 if callable(course) else course for course in self.courses])

    @property
    def constant(self) -> np.ndarray | None:
        """(nu,) where none changes."""
        return None if any(callable(course) for course in self.courses) else self.numbers

    @property
    def tables(self) -> list[tuple[int, PiecewisePolynomial]]:
        """Those that are tables."""
        return [(i, course) for i, course in enumerate(self.courses) if isinstance(course, PiecewisePolynomial)]

    @property
    def formulas(self) -> list[tuple[int, Formula]]:
        """Those that are formulas."""
        return [(i, course) for i, course in enumerate(self.courses) if isinstance(course, Formula)]

    @property
    def clocks(self) -> list[tuple[float, float, int]]:
        """Those of all formulas."""
        return [clock for _, formula in self.formulas for clock in formula.clocks]

    @property
    def functions(self) -> list[tuple[int, Callable[[float], float]]]:
        """Those that are functions of numbers."""
        known = (PiecewisePolynomial, Formula)
        return [(i, course) for i, course in enumerate(self.courses) if callable(course) and not isinstance(course, known)]

    @functools.cached_property
    def formula(self) -> ca.Function:
        """(t) -> all formulas."""
        t = ca.SX.sym("t")
        return ca.Function("formula", [t], [ca.vertcat(*(course.function(t) for _, course in self.formulas))], {"cse": True})


def _can_be_pickled(function: Callable[[float], float]) -> bool:
    try:
        pickle.dumps(function)
    except Exception:  # of any kind: whoever wrote the function has his own
        return False
    return True
