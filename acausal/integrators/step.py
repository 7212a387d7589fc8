"""One implicit step as a differentiable CasADi function, for shooting, sensitivities and export."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.arguments import finite, shown, whole_number
from acausal.collocation.tableau import gauss_legendre, radau_iia
from acausal.errors import OptionError
from acausal.language.expression import InputRate
from acausal.numerics.staged import plain
from acausal.outputs.functions import Functions

_MET, _JUMPED, _CORRECTIONS = 1e-12, 1e-9, 1000
"""Of its size, what the last correction of what jumps with inputs changes, and what may be left of it; how many there are at most."""
_PROJECTIONS = 3
"""Moving positions opens the rows of velocities a little; the next projection closes them."""


def step_of(functions: Functions, method: str, order: int, h: float | None) -> ca.Function:
    """Of a model's states, which are brought onto its invariants; see `Model.step`. Where parts open, slip or strike: within the mode that the masks tell, which are
    the last of the inputs."""
    f = functions
    project = f.projection if f.modes is None else plain(f.modes.projection)
    entries = f.outputs.system.flat.inputs
    place = {entry.of: k for k, entry in enumerate(entries) if isinstance(entry, InputRate)}
    rates = [place.get(entry, -1) for entry in entries]
    return step_function(f.explicit_dynamics, project, method=method, order=order, h=h, holds=f.holds, jump=_jump(f), rates=rates)


def _jump(f: Functions) -> ca.Function | None:
    """(t, x, u, p) -> x with what nonlinear equations give by inputs as these say, and how far off that is, of its size; None where they give nothing."""
    s, space = f.outputs.system, f.space
    if not s.led or f.projection is None:
        return None
    places = list(f.integrand.followers)
    z = space.x[places]
    y, size = ca.SX.sym("y", len(places)), ca.SX.sym("size", len(places))
    rows = ca.substitute(space.put(s.scalar.residuals), z, size * y)
    left = ca.Function("left", [y, *space.arguments, size], [ca.densify(rows)], {"cse": True})
    options = {"abstol": 0.0, "abstolStep": _MET, "max_iter": _CORRECTIONS, "error_on_fail": False}
    solver = ca.rootfinder("jump", "fast_newton", left, options)
    t, x, u, p = (ca.MX.sym(n, k.numel()) for n, k in zip("txup", space.arguments, strict=True))

    def off(state: ca.MX) -> ca.MX:
        return f.projection(t, state, u, p)[places] - state[places]  # pyright: ignore[reportOptionalCall]  # looked at above

    much = ca.fabs(x[places]) + ca.fabs(off(x))
    much = ca.if_else(ca.logic_and(much > 0, much < np.inf), much, 1)
    after = ca.MX(x)
    after[places] = much * solver(x[places] / much, t, x, u, p, much)
    return ca.Function("jump", [t, x, u, p], [after, ca.mmax(ca.fabs(off(after)) / much)])


def _later(u: Any, h: Any, rates: Sequence[int]) -> Any:
    """Inputs so much later; `rates`: the place of each one's rate among them, or -1."""
    found = u
    for k, rate in enumerate(rates):
        if rate >= 0:
            second = rates[rate]
            found = type(u)(found)
            found[k] = u[k] + h * (u[rate] + (h / 2 * u[second] if second >= 0 else 0))
    return found


def step_function(
    rhs: ca.Function,
    project: ca.Function | None = None,
    *,
    method: str = "gauss",
    order: int = 4,
    h: float | None = None,
    holds: ca.Function | None = None,
    jump: ca.Function | None = None,
    rates: Sequence[int] = (),
) -> ca.Function:
    """(t, x, u, p, h) -> (x_next, residual), without the last argument for a fixed `h`: one step of Gauss (even order) or Radau IIA (odd order) collocation.

    The stage rates are found by CasADi's `fast_newton`, which generates C and has exact derivatives, but may return NaN as
    success: `residual` is the largest error of the stage equations (NaN counts), and must be checked where it matters.
    `project`: (t, x, u, p) -> x nearer to the invariants, where there are any; x_next is brought onto them, as in `simulate`.
    `holds`: (t, x, u, p) -> margin; where it is negative at the beginning, the residual is infinite. `jump`: (t, x, u, p) -> (x as inputs make it at once,
    how far off that is, of its size), where they do; the residual is infinite where that is not found.
    The inputs u are held over the step, but for those that have rates among them, `rates`: the place of each one's, or -1; these go on with what is held of their rates. Raises `OptionError` for an order that the method does not have.
    """
    order = whole_number(order, "step: the order", 1, 99)
    if h is not None and not (h := finite(h, "step: h [s]")) > 0:
        raise OptionError(f"step: h is {h!r} s. Give a positive number, or leave it out to have it as an argument.")
    if not isinstance(method, str):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
        raise OptionError(f"step: the method is {shown(method)}. Give 'gauss' or 'radau'.")
    if method == "gauss" and order >= 2 and order % 2 == 0:
        tableau = gauss_legendre(order // 2)
    elif method == "radau" and order >= 1 and order % 2 == 1:
        tableau = radau_iia((order + 1) // 2)
    else:
        raise OptionError(
            f"step: there is no method '{method}' of order {order}; gauss has even orders from 2, radau odd ones from 1."
        )
    nx, s = rhs.size1_in(1), tableau.stages
    K, t, x, u, p, width = (
        ca.SX.sym(n, k) for n, k in (("K", nx * s), ("t", 1), ("x", nx), ("u", rhs.size1_in(2)), ("p", rhs.size1_in(3)), ("h", 1))
    )
    stages = ca.reshape(K, nx, s)
    residual: list[ca.SX] = []
    for i in range(s):
        state = x + width * (stages @ ca.DM(tableau.A[i]))
        residual.append(
            stages[:, i] - rhs(t + float(tableau.c[i]) * width, state, _later(u, float(tableau.c[i]) * width, rates), p)
        )
    system = ca.Function("stages", [K, t, x, u, p, width], [ca.vertcat(*residual)], {"cse": True})
    options = {"abstol": 1e-13, "abstolStep": 1e-13, "max_iter": 30, "error_on_fail": False}
    solver = ca.rootfinder("solve", "fast_newton", system, options)
    tm, xm, um, pm, hm = (
        ca.MX.sym(n, k) for n, k in (("t", 1), ("x", nx), ("u", rhs.size1_in(2)), ("p", rhs.size1_in(3)), ("h", 1))
    )
    begun, missed = (xm, ca.MX(0)) if jump is None else jump(tm, xm, um, pm)
    guess = ca.repmat(rhs(tm, begun, um, pm), s, 1)
    found = solver(guess, tm, begun, um, pm, hm)
    after = begun + hm * (ca.reshape(found, nx, s) @ ca.DM(tableau.b))
    for _ in range(_PROJECTIONS if project is not None and nx else 0):
        assert project is not None
        after = project(tm + hm, after, _later(um, hm, rates), pm)
    left = ca.mmax(ca.fabs(system(found, tm, begun, um, pm, hm))) if nx else ca.MX(0)
    nan_safe = ca.if_else(ca.sum1(found) == ca.sum1(found), left, np.inf) if nx else left
    nan_safe = nan_safe if jump is None else ca.if_else(missed <= _JUMPED, nan_safe, np.inf)
    nan_safe = nan_safe if holds is None else ca.if_else(holds(tm, xm, um, pm) >= 0, nan_safe, np.inf)
    name, arguments, results = f"{method}{order}_step", [tm, xm, um, pm, hm], [after, nan_safe]
    free = ca.Function(name, arguments, results, ["t", "x", "u", "p", "h"], ["x_next", "residual"])
    if h is None:
        return free
    return ca.Function(name, arguments[:4], free.call([*arguments[:4], ca.MX(h)]), ["t", "x", "u", "p"], ["x_next", "residual"])
