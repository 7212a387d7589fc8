"""One search of the solver for the least cost of a program."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import OptionError
from acausal.optimal_control.interrupts import noticed
from acausal.optimal_control.separable import FATROP, IPOPT, Program
from acausal.optimal_control.staged import staged

CONVERGED = "Solve_Succeeded"
"""What ipopt says where all holds to its tolerance; what is nearly as good is a success, too."""
INTERRUPTED = "NonIpopt_Exception_Thrown"
"""What ipopt says of Ctrl-C: none of our functions raises anything else."""
NEARLY = 1e-6
"""Of the program in units of its own: what ipopt takes for nearly as good."""
_TOLERANCE = 1e-9
"""Of the program in units of its own."""
_PRESSED = 1e-12
"""How far off its bound something is, times what it presses: each that presses leaves the cost off by so much."""
_NEAR = 300
"""Iterations for what is near: who needs more was not."""
_INSIDE = 1e-3
"""How far inside its bounds what is near begins."""
_STEPS = 20
"""Quadratic programs that are solved: who needs more is not led to a least cost by them."""
_NEARLY_FLAT = 1e-8
"""In units of the program: slopes that steps of quadratic programs leave."""
_QP_OPTIONS = {"piqp": {"piqp": {"eps_abs": 1e-10, "eps_rel": 1e-11, "max_iter": 40}}}
"""Much nearer than that, and no more iterations than a program takes that has a solution."""
_PRESSES = 1e-7
"""In units of the program: what is pressed against a bound by more does not leave it."""

Outcome = tuple[np.ndarray, float, np.ndarray, np.ndarray, dict[str, Any]]
"""Of a search; see there."""


def search(
    program: Program,
    plugin: str,
    options: dict[str, Any],
    *,
    warm: bool,
    begin: np.ndarray | None = None,
    bounds: np.ndarray | None = None,
    solvers: dict[Any, Any] | None = None,
) -> Outcome:
    """Unknowns, cost, multipliers of the constraints, what the cost would be less by if each unknown and then each constraint came to the bound that it is
    pressed against, and what the solver says of its search. `begin` (n,): where it begins, if not at the program's guess; `bounds` (2, n): those of the unknowns, if not the program's; `solvers`: those that were made, which
    are used again. Where `plugin` solves quadratic programs, and these lead to no least cost, ipopt with the `options` searches for it.
    """
    made, steps, key = {} if solvers is None else solvers, 0, (program, warm, repr(sorted(options.items())))
    (least, most), (lower, upper) = program.bounds if bounds is None else bounds, program.limits
    given = {"x0": np.clip(program.guess if begin is None else begin, least, most)}
    given |= {"lbx": least, "ubx": most, "lbg": lower, "ubg": upper}
    try:
        if key not in made:
            made[key] = program.solver(IPOPT, {**ipopt_options(warm=warm), **options, "error_on_fail": False})
    except RuntimeError as refused:
        raise OptionError(f"solve: {IPOPT} does not take these options: {options}. {str(refused).splitlines()[-1]}") from None
    if plugin != IPOPT:
        found, least_cost = _otherwise(program, plugin, given, made)
        if least_cost or found[-1]["return_status"] == INTERRUPTED:
            return found
        steps = int(found[-1]["iter_count"])
    w, cost, factors, gaps, stats = _found(program, made[key], given)[0]
    if stats["return_status"] == INTERRUPTED:
        cost = float(program.values(w)[0]) * program.unit  # which ipopt says is nothing
    return w, cost, factors, gaps, {**stats, "iter_count": stats["iter_count"] + steps}


def _otherwise(program: Program, plugin: str, given: dict[str, np.ndarray], made: dict[Any, Any]) -> tuple[Outcome, bool]:
    """By stages, or one quadratic program after the other; and whether that is a least cost."""
    if (program, plugin) not in made:
        made[program, plugin] = _InStages(program) if plugin == FATROP else _InSteps(program, plugin)
    solver = made[program, plugin]
    try:
        found, loose = _found(program, solver, given)
    except RuntimeError as stopped:
        status = INTERRUPTED if solver.interrupted or "KeyboardInterrupt" in str(stopped) else str(stopped)
        w, count = solver.last(given["x0"])
        cost = float(program.values(w)[0]) * program.unit
        stats = {"success": False, "return_status": status, "iter_count": count}
        return (w, cost, np.zeros(program.rows), np.zeros(w.size + program.rows), stats), False
    w, _, factors, gaps, stats = found  # what presses from the wrong side still counts as success there
    meets = stats["success"] and np.max(gaps, initial=0.0) < NEARLY * program.unit
    return found, meets and not program.bent_downwards(w, factors, loose)


class _Iterates(ca.Callback):
    """Keeps unknowns at which a solver of a program has come, the first of which are where it began."""

    def __init__(self, program: Program) -> None:
        ca.Callback.__init__(self)
        n, m = program.size, program.rows
        self._sizes = {"x": n, "lam_x": n, "g": m, "lam_g": m, "f": 1}
        self.count, self.last = -1, np.zeros(0)
        self.construct("iterates", {})  # pyright: ignore[reportUnknownMemberType]

    def get_n_in(self) -> int:
        return ca.nlpsol_n_out()

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes.get(ca.nlpsol_out(i), 0), 1)

    def eval(self, arg: Any) -> list[int]:
        """Goes on."""
        self.count, self.last = self.count + 1, np.array(arg[0]).ravel()
        return [0]


class _InSteps:
    """A solver of a program by one quadratic program after the other."""

    interrupted = False
    """It says so itself."""

    def __init__(self, program: Program, plugin: str) -> None:
        self._iterates = _Iterates(program)
        self._solver = program.solver("sqpmethod", {**_sqp_options(plugin), "iteration_callback": self._iterates})
        self.stats = self._solver.stats

    def __call__(self, **given: np.ndarray) -> dict[str, Any]:
        self._iterates.count = -1
        return self._solver(**given)

    def last(self, begin: np.ndarray) -> tuple[np.ndarray, int]:
        """Unknowns where it came last, and after how many steps."""
        return (self._iterates.last, self._iterates.count) if self._iterates.count >= 0 else (begin, 0)


class _InStages:
    """A solver of a program that eliminates one stage after the other. Raises `RuntimeError` where it has none."""

    def __init__(self, program: Program) -> None:
        self._staged, self._told = None if program.stages is None else staged(program, program.stages), list[int]()
        if self._staged is None:
            return
        options = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False, "inputs_check": False}
        inside = {"print_level": 0, "max_iter": _NEAR, "tolerance": _TOLERANCE}
        self._solver = self._staged.program.solver(FATROP, {**options, **self._staged.sizes, "fatrop": inside})

    def __call__(self, **given: np.ndarray) -> dict[str, Any]:
        if self._staged is None:
            raise RuntimeError("no stages")
        with noticed() as self._told:
            found = self._solver(**self._staged.arguments(given))
        return self._staged.results(found)

    @property
    def interrupted(self) -> bool:
        """Whether somebody asked it to end."""
        return bool(self._told)

    def last(self, begin: np.ndarray) -> tuple[np.ndarray, int]:
        """Where it was to begin."""
        return begin, 0

    def stats(self) -> dict[str, Any]:
        """In words of ipopt."""
        said = self._solver.stats()
        status = INTERRUPTED if self._told else CONVERGED if said["success"] else "Search_Direction_Becomes_Too_Small"
        return {"success": said["success"] and not self._told, "return_status": status, "iter_count": said["iter_count"]}


def _found(program: Program, solver: Any, given: dict[str, np.ndarray]) -> tuple[Outcome, np.ndarray]:
    """And which unknowns and then which constraints may move."""
    found = solver(**given)
    w, g, of_bounds, of_rows = (np.array(found[name]).ravel() for name in ("x", "g", "lam_x", "lam_g"))
    lower, upper = (np.append(given[f"{side}x"], given[f"{side}g"]) for side in ("lb", "ub"))
    pressed = np.append(of_bounds, of_rows)
    bound = np.where(pressed > 0, upper, lower)
    with np.errstate(over="ignore", invalid="ignore"):  # of what ran away
        gaps = np.abs(np.where(np.isfinite(bound), pressed, 0.0) * np.where(np.isfinite(bound), bound - np.append(w, g), 0.0))
    loose = (np.abs(pressed) < _PRESSES) & (lower < upper)
    return (w, float(found["f"]) * program.unit, of_rows, gaps * program.unit, solver.stats()), loose


def _sqp_options(plugin: str) -> dict[str, Any]:
    """Quiet, and by the exact curvature: where that is not convex, ipopt goes on."""
    quiet = (
        "print_time",
        "print_header",
        "print_iteration",
        "print_status",
        "show_eval_warnings",
        "inputs_check",
        "error_on_fail",
    )
    inside = {**_QP_OPTIONS[plugin], "error_on_fail": False}
    steps = {"qpsol": plugin, "qpsol_options": inside, "max_iter": _STEPS, "tol_pr": _TOLERANCE, "tol_du": _NEARLY_FLAT}
    return {**dict.fromkeys(quiet, False), **steps}


def ipopt_options(*, warm: bool, known: bool = False) -> dict[str, Any]:
    """Quiet, in the units of the program; `warm`: where a solution is near; `known`: its multipliers, too."""
    options = {
        "print_time": False, "show_eval_warnings": False, "ipopt.print_level": 0, "ipopt.sb": "yes",
        "inputs_check": False,  # that inputs are held by their bounds is no news of CasADi's; bounds that cross are refused before
        "ipopt.tol": _TOLERANCE, "ipopt.nlp_scaling_method": "none",
        "ipopt.max_iter": 1000, "ipopt.bound_relax_factor": 0.0, "ipopt.compl_inf_tol": _TOLERANCE if known else _PRESSED, "ipopt.mu_strategy": "adaptive",
        "ipopt.mumps_pivot_order": 0,  # minimum degree: bands as narrow as these need no graph to be cut
        "ipopt.mumps_permuting_scaling": 0,  # along singular arcs a matching of what is small puts pivots off until all is dense
    }  # fmt: skip
    if known:
        pushes = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")
        options |= {
            "ipopt.max_iter": _NEAR,
            "ipopt.warm_start_init_point": "yes",
            "ipopt.mu_init": 1e-4,
            "ipopt.mu_oracle": "probing",
        }
        options |= {f"ipopt.warm_start_{one}": 1e-7 for one in pushes}
        options |= {"ipopt.fast_step_computation": "yes", "ipopt.min_refinement_steps": 0}
    elif warm:
        options |= {"ipopt.max_iter": _NEAR, "ipopt.bound_mult_init_method": "mu-based", "ipopt.mu_init": 1e-4}
        options |= {f"ipopt.{one}": _INSIDE for one in ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")}
    return options
