"""Inverse dynamics: the forces that make a mechanism move as prescribed, and the whole motion with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.analysis.actuation import Actuation, Unknown, actuated, named
from acausal.analysis.demands import Demand, demands
from acausal.analysis.point import operating_point
from acausal.analysis.prescribed import Course, Given, courses
from acausal.analysis.servo import Servo, input_output_derivatives
from acausal.arguments import expressions
from acausal.dynamics.newton_euler import newton_euler
from acausal.errors import OptionError, StartValueError, UnknownVariableError
from acausal.language.equation import der
from acausal.language.expression import Expression, Input
from acausal.numerics.elimination import solved_by_qr
from acausal.numerics.folding import folded_function
from acausal.numerics.one_thread import on_one_thread
from acausal.outputs.expression_names import labels
from acausal.outputs.functions import Functions
from acausal.reduce.modes import refuse_modes
from acausal.reduce.reduce import ReducedSystem
from acausal.start.decided import check_decided
from acausal.start.inputs import InputValue
from acausal.start.situation import Situation
from acausal.start.start_values import Start, softened
from acausal.start.states import start_values
from acausal.wording import counted


@dataclass(frozen=True, repr=False)
class InverseDynamics:
    """A prescribed motion at times `t` (m,) [s]: states `x` (nx, m), all inputs `u` (nu, m) with the forces found, named `names`.

    `result.force(unknown)` is the series of one unknown (m,), or (m, n) for a joint of several freedoms; `result[expression]` that of
    any other expression, reactions included. `demands`: what the motion asks of each contact and friction, by name: they are closed, or stick, all along where they
    are so at the start, whatever force that takes. `free`: states that the motions leave open; they move by their own dynamics. `functions`: of
    the states; `whole` (n, m): all coordinates of the tree.
    """

    functions: Functions
    actuation: Actuation
    t: np.ndarray
    whole: np.ndarray
    u: np.ndarray
    p: np.ndarray
    free: tuple[str, ...]
    demands: Mapping[str, Demand]

    @property
    def x(self) -> np.ndarray:
        """States of the model (nx, m)."""
        return self.functions.space.restricted(self.whole)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the forces, in the order of `forces`."""
        return self.actuation.names

    @property
    def forces(self) -> np.ndarray:
        """All forces found, (n, m): rows of `u`, with a column for each time as there. `series` is the same as other series are."""
        return self.u[self.actuation.entries]

    @property
    def series(self) -> np.ndarray:
        """All forces found, (m, n): a row for each time, as `result[...]` and `run[...]` have it; named `names`."""
        return self.forces.T

    def force(self, unknown: Unknown) -> np.ndarray:
        """Of one unknown. Raises `UnknownVariableError` for what was not asked for."""
        unknown = named(self.actuation.functions.outputs.system.flat, unknown)
        places = self.actuation.places.get(unknown)
        if places is None:
            raise UnknownVariableError(f"{unknown!r} is not among the unknowns {', '.join(self.names)}.")
        return self.u[places[0]] if len(places) == 1 else self.u[list(places)].T

    def __getitem__(self, wanted: Expression) -> np.ndarray:
        """Series of an expression: (m,), (m, n) or (m, rows, columns)."""
        function = self.actuation.functions.output(wanted)
        p = np.repeat(self.p[:, None], self.t.size, axis=1)
        rows, columns = function.size_out(0)
        values = np.array(function(self.t[None, :], self.whole, self.u, p)).reshape(rows, self.t.size, columns).transpose(1, 0, 2)
        return values[:, 0, 0] if rows == columns == 1 else values[:, :, 0] if columns == 1 else values

    @property
    def start(self) -> dict[Expression, np.ndarray]:
        """Start values for `simulate`."""
        return start_values(self.actuation.functions, self.whole[:, 0])

    @property
    def inputs(self) -> dict[Input, InputValue]:
        """The inputs that were found, as functions of time for `simulate`: splines of degree 5 through the samples."""
        from scipy.interpolate import make_interp_spline

        degree = min(5, (self.t.size - 1) // 2 * 2 - 1) if self.t.size > 2 else 1
        found: dict[Input, InputValue] = {}
        for unknown, places in self.actuation.places.items():
            if isinstance(unknown, Input):
                spline = make_interp_spline(self.t, self.u[places[0]], k=max(1, degree))
                found[unknown] = lambda t, spline=spline: float(spline(t))
        return found

    def __repr__(self) -> str:
        return f"<InverseDynamics of {self.actuation.functions.outputs.system.flat.name}: {', '.join(self.names)}>"

    def __str__(self) -> str:
        scene = self.actuation.functions.outputs.system.flat.name
        rows = [
            f"{scene}: {self.t[0]:g} s to {self.t[-1]:g} s, {counted(self.t.size, 'time')}",
            f"  {'force':<28} {'least':>12} {'largest':>12}",
        ]
        rows += [f"  {n:<28} {np.min(f):>12.6g} {np.max(f):>12.6g}" for n, f in zip(self.names, self.forces, strict=True)]
        if self.free:
            rows.append(f"  not prescribed, moving by their own dynamics: {', '.join(self.free)}")
        rows += [f"  {name}: {demand}" for name, demand in self.demands.items()]
        return "\n".join(rows)


@on_one_thread
def inverse_dynamics(
    own: Functions,
    functions: Functions,
    at: Situation,
    t: np.ndarray,
    motions: Mapping[Expression, Given],
    unknowns: Sequence[Unknown],
) -> InverseDynamics:
    """At times t (m,), with a model's `own` states, by functions of all coordinates of the tree; see `Model.inverse_dynamics`."""
    mechanics = functions.outputs.system.mechanics
    refuse_modes(mechanics.locks, "inverse_dynamics")
    actuation = actuated(functions, unknowns)
    functions = actuation.functions
    wanted = courses(functions, motions, t, at.p)
    led = _led(functions, at.start, motions, wanted, at.t0)
    try:
        began = operating_point(functions, replace(at, start=led))
    except StartValueError:  # what is said of others only selects a branch
        began = operating_point(functions, replace(at, start=softened(led)))
    check_decided(functions.outputs.system, began.t, began.x, at.p)
    found = Servo(actuation, wanted, began, at.signal(functions)).run(t)
    return InverseDynamics(own, actuation, t, found.x, found.u, at.p, found.free, demands(functions, t, found.x, found.u, at.p))


def _led(
    functions: Functions, start: Start, motions: Mapping[Expression, Given], wanted: Sequence[Course], t0: float
) -> dict[Expression, Any]:
    """Start values with those of the motions, and with the rates of motions of places, in their stead."""
    s, guess, first = functions.outputs.system, dict(start), 0
    speeds = ca.vertcat(s.x[s.nq :], s.u)
    for key in motions:
        value = ca.densify(ca.vec(functions.outputs.resolve(key)))
        courses, first = wanted[first : first + value.numel()], first + value.numel()
        guess[key] = np.array([c(t0, 0) for c in courses])
        if ca.depends_on(value, s.x[: s.nq]) and not ca.depends_on(value, speeds):
            rate = der(key)
            rates = functions.outputs.resolve(rate)
            same = [k for k in guess if k.shape == rate.shape and ca.is_equal(functions.outputs.resolve(k), rates)]
            guess = {k: v for k, v in guess.items() if k not in same} | {rate: np.array([c(t0, 1) for c in courses])}
    return guess


def times_of(value: Any) -> np.ndarray:
    """Ascending times (m,) [s]. Raises `OptionError`."""
    try:
        t = np.asarray(value, dtype=float).ravel()
    except (TypeError, ValueError, OverflowError):
        t = np.zeros(0)
    if not t.size or not np.isfinite(t).all() or np.any(np.diff(t) <= 0):
        raise OptionError(f"inverse_dynamics: give finite, ascending times [s], not {value!r}.")
    return t


def inverse_dynamics_function(
    own: Functions, functions: Functions, variables: Sequence[Expression], unknowns: Sequence[Unknown]
) -> ca.Function:
    """Of the states of `own` functions, by those of all coordinates of the tree; see `Model.inverse_dynamics_function`."""
    mechanics = functions.outputs.system.mechanics
    refuse_modes((*mechanics.modes, *mechanics.locks), "inverse_dynamics_function")
    inputs = functions.outputs.system.flat.inputs
    actuation = actuated(functions, unknowns)
    outputs = actuation.functions.outputs
    s = outputs.system
    w = s.u[actuation.entries]
    variables = expressions(variables, "inverse_dynamics_function: `variables`", "[scene.shoulder.q, scene.elbow.q]")
    names = tuple(n for e in variables for n in labels(outputs, e))
    values = ca.vertcat(ca.SX(0, 1), *(ca.vec(outputs.resolve(e)) for e in variables))
    if not 0 < len(names) <= w.numel():
        raise OptionError(
            f"inverse_dynamics_function: {w.numel()} forces ({', '.join(actuation.names)}) make at least one motion and at most as many, not "
            f"{len(names)} ({', '.join(names)})."
        )
    a = ca.SX.sym("a", len(names))
    gap = _balance(s, values, a)
    if gap is None:
        gap = ca.vertcat(*(input_output_derivatives(outputs, values[k], w, names[k])[-1] for k in range(len(names)))) - a
    B = ca.densify(ca.jacobian(gap, w))
    if ca.depends_on(B, w):
        raise OptionError(
            f"inverse_dynamics_function: {', '.join(names)} is not linear in {', '.join(actuation.names)}; use inverse_dynamics."
        )
    missing = -ca.substitute(gap, w, ca.SX.zeros(w.numel()))
    force = solved_by_qr(B, missing) if B.shape[0] == B.shape[1] else B.T @ ca.solve(B @ B.T, missing)
    if actuation.functions.holds is not None:
        force = ca.if_else(actuation.functions.holds(s.t, s.x, s.u, s.p) >= 0, force, np.nan)
    u = ca.vertcat(ca.SX(0, 1), *(entry.sx for entry in inputs))
    found = folded_function("whole", [s.t, s.x, a, u, s.p], [ca.densify(force)])
    space = own.space
    t, x, u, p = space.arguments
    seen = found(t, space.put(space.system.x), a, u, p[: s.p.numel()])
    return folded_function("inverse_dynamics", [t, x, a, u, p], [seen], ["t", "x", "a", "u", "p"], ["force"])


def _balance(s: ReducedSystem, values: ca.SX, a: ca.SX) -> ca.SX | None:
    """Forces that the joints of a tree lack for accelerations a of `values`, by Newton and Euler; None where there are loops, scalar states
    or gears, or other values than freedoms: then forward dynamics has to be inverted.
    """
    tree = s.mechanics.tree
    if (
        s.mechanics.readings.implicit
        or values.numel() != tree.v.numel()
        or s.constraints.jacobian.shape[0]
        or s.scalar.states
        or s.scalar.held
    ):
        return None
    at_rate = [values[k] if ca.depends_on(values[k], tree.v) else _change(s, values[k]) for k in range(values.numel())]
    rate = ca.vertcat(*at_rate)
    J = ca.jacobian(rate, tree.v)
    if ca.depends_on(rate, s.u) or ca.sprank(J) < tree.v.numel():
        return None
    v_dot = solved_by_qr(J, a - _change(s, rate))
    return newton_euler(s.mechanics.kinematics, v_dot, list(s.mechanics.wrenches)).tau - s.forces_at(v_dot)


def _change(s: ReducedSystem, value: ca.SX) -> ca.SX:
    """Rate of a value with all velocities held."""
    return ca.jtimes(value, ca.vertcat(s.mechanics.tree.q, s.t), ca.vertcat(s.mechanics.tree.rates, 1))
