"""One search of the solver for the least cost of a program."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import OptionError
from acausal.optimal_control.separable import Program

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
    solvers: dict[Any, ca.Function] | None = None,
) -> Outcome:
    """Unknowns, cost, multipliers of the constraints, what the cost would be less by if each unknown and then each constraint came to the bound that it is
    pressed against, and what the solver says of its search. `begin` (n,): where it begins, if not at the program's guess; `bounds` (2, n): those of the unknowns, if not the program's; `solvers`: those that were made, which
    are used again.
    """
    made, key = {} if solvers is None else solvers, (program, warm, repr(sorted(options.items())))
    try:
        if key not in made:
            made[key] = program.solver(plugin, {**ipopt_options(warm=warm), **options, "error_on_fail": False})
        solver = made[key]
    except RuntimeError as refused:
        raise OptionError(f"solve: {plugin} does not take these options: {options}. {str(refused).splitlines()[-1]}") from None
    (least, most), (lower, upper) = program.bounds if bounds is None else bounds, program.limits
    found = solver(x0=np.clip(program.guess if begin is None else begin, least, most), lbx=least, ubx=most, lbg=lower, ubg=upper)
    w, g, of_bounds, of_rows = (np.array(found[name]).ravel() for name in ("x", "g", "lam_x", "lam_g"))
    pressed = np.append(of_bounds, of_rows)
    bound = np.where(pressed > 0, np.append(most, upper), np.append(least, lower))
    gaps = np.abs(np.where(np.isfinite(bound), pressed, 0.0) * np.where(np.isfinite(bound), bound - np.append(w, g), 0.0))
    return w, float(found["f"]) * program.unit, of_rows, gaps * program.unit, solver.stats()


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
