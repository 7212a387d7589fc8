"""What an integrator is, and how integrators are found: every module of this package may define one."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import inspect
import pkgutil
from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

import numpy as np

from acausal.collocation.problem import Accuracy, Problem, Progress, Solution
from acausal.errors import ExportError, NoRuntimeError, OptionError
from acausal.numerics.switching import switching
from acausal.runtime.integrand import Integrand
from acausal.runtime.native import NativeProblem, native_problem


class AbstractIntegrator(ABC):
    """A method for initial value problems. A concrete one is a frozen dataclass whose fields are its options.

    A new method is one new class, in a file of this package or anywhere: it is found by its `name`. Two options have a meaning for all methods that have
    them: `order` (`OptionError` when made with one that it has not) and `step` (fixed size [s]; None:
    adaptive). It obliges itself to: errors that fall with `rtol`; the order that it is asked for, at a fixed step; invariants of the problem
    kept to rounding by `project` after each step; guards located; what was computed until an interruption.
    `tests/conformance` finds and measures it.
    """

    name: ClassVar[str]
    """What users call it."""

    @abstractmethod
    def integrate(
        self, problem: Problem, x0: np.ndarray, t0: float, t1: float, accuracy: Accuracy, progress: Progress | None = None
    ) -> Solution:
        """Integrate from t0 to t1 >= t0, x0 (nx,). Numerical trouble is the `Status` of the result, and is not raised."""


def integrators() -> dict[str, type[AbstractIntegrator]]:
    """All integrators by name: those of this package, and others whose class exists."""
    _import_modules()
    found: dict[str, type[AbstractIntegrator]] = {}
    queue: list[type[AbstractIntegrator]] = [AbstractIntegrator]
    while queue:
        cls = queue.pop(0)
        queue += cls.__subclasses__()
        if not inspect.isabstract(cls):
            found[cls.name] = cls
    return found


@functools.cache
def _import_modules() -> None:
    for module in pkgutil.iter_modules([str(Path(__file__).parent)], __name__.rpartition(".")[0] + "."):
        importlib.import_module(module.name)


def integrator(name: str, order: int | None = None, step: float | None = None) -> AbstractIntegrator:
    """The integrator of a name, with its options. Raises `OptionError` for a name or an option that does not exist."""
    known = integrators()
    if not isinstance(name, str) or name not in known:  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
        raise OptionError(f"simulate: unknown method '{name}'. Use {', '.join(sorted(known))}.")
    given = {key: value for key, value in (("order", order), ("step", step)) if value is not None}
    options = [field.name for field in dataclasses.fields(known[name])]  # type: ignore[arg-type]  # all are dataclasses
    for key in given:
        if key not in options:
            raise OptionError(f"simulate: method '{name}' has no option '{key}'. It has: {', '.join(options) or 'none'}.")
    return known[name](**given)


def native(problem: Problem) -> NativeProblem:
    """The problem's kernels, made here where it has none. Raises `NoRuntimeError` where there is no runtime: neither built nor to be compiled."""
    try:
        p = problem
        found = problem.native or native_problem(
            Integrand(p.rhs, p.invariants, p.project, p.clearance, p.exact, p.positions, switching(p.rhs))
        )
        why = "no C compiler was found to build it now (cc, gcc, clang, or ziglang from PyPI; `pip install ziglang` is enough)"
    except ExportError as error:
        found, why = None, f"it cannot be built now. {error}"
    if found is None:
        raise NoRuntimeError(
            f"The integrators in C were not built with this installation, and {why}. Until then, method='cvodes' and 'idas' are there."
        )
    return found
