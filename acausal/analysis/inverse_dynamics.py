"""Inverse dynamics: the forces that make a mechanism move as prescribed, and the whole motion with them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import casadi as ca
import numpy as np

from acausal.analysis.actuation import Actuation, Unknown, actuated
from acausal.analysis.arguments import expressions, start_mapping
from acausal.analysis.conditions import Unknowns
from acausal.analysis.nearest import NearestRoot, Rows
from acausal.analysis.point import Differentiable, OperatingPoint, labels, operating_point, start_values
from acausal.analysis.prescribed import Course, Given, courses
from acausal.codegen.lower import Functions
from acausal.errors import MotionError, OptionError, UnknownVariableError
from acausal.language.expression import Expression, Input, Parameter
from acausal.reduction.initial import Start, exactly, near
from acausal.reduction.outputs import Outputs
from acausal.simulation import InputValue, input_signal

_HIGHEST = 4
_MET = 1e-8
_RANK = 1e-11
_ROUNDS = 20
_STRIDE = 0.2
_MOST_STEPS = 50
_STUCK = 300


@dataclass(frozen=True, repr=False)
class InverseDynamics:
    """A prescribed motion at times `t` (m,) [s]: states `x` (nx, m), all inputs `u` (nu, m) with the forces found, named `names`.

    `result.force(unknown)` is the series of one unknown (m,), or (m, n) for a joint of several freedoms; `result[expression]` that of
    any other expression, reactions included. `free`: states that the motions leave open; they move by their own dynamics.
    """

    actuation: Actuation
    t: np.ndarray
    x: np.ndarray
    u: np.ndarray
    p: np.ndarray
    free: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the forces, in the order of `forces`."""
        return self.actuation.names

    @property
    def forces(self) -> np.ndarray:
        """All forces found, (n, m)."""
        return self.u[self.actuation.entries]

    def force(self, unknown: Unknown) -> np.ndarray:
        """Of one unknown. Raises `UnknownVariableError` for what was not asked for."""
        places = self.actuation.places.get(unknown)
        if places is None:
            raise UnknownVariableError(f"{unknown!r} is not among the unknowns {', '.join(self.names)}.")
        return self.u[places[0]] if len(places) == 1 else self.u[list(places)].T

    def __getitem__(self, wanted: Expression) -> np.ndarray:
        """Series of an expression: (m,), (m, n) or (m, rows, columns)."""
        function = self.actuation.functions.output(wanted)
        p = np.repeat(self.p[:, None], self.t.size, axis=1)
        rows, columns = function.size_out(0)
        values = np.array(function(self.t[None, :], self.x, self.u, p)).reshape(rows, self.t.size, columns).transpose(1, 0, 2)
        return values[:, 0, 0] if rows == columns == 1 else values[:, :, 0] if columns == 1 else values

    @property
    def start(self) -> dict[Expression, np.ndarray]:
        """Start values for `simulate`."""
        return start_values(self.actuation.functions, self.x[:, 0])

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
            f"{scene}: {self.t[0]:g} s to {self.t[-1]:g} s, {self.t.size} times",
            f"  {'force':<28} {'least':>12} {'largest':>12}",
        ]
        rows += [f"  {n:<28} {np.min(f):>12.6g} {np.max(f):>12.6g}" for n, f in zip(self.names, self.forces, strict=True)]
        if self.free:
            rows.append(f"  not prescribed, moving by their own dynamics: {', '.join(self.free)}")
        return "\n".join(rows)


def inverse_dynamics(
    functions: Functions,
    times: Sequence[float] | np.ndarray,
    motions: Mapping[Expression, Given],
    unknowns: Sequence[Unknown],
    start: Start | None,
    inputs: Mapping[Input, InputValue] | None,
    parameters: Mapping[Parameter, float] | None,
) -> InverseDynamics:
    """See `Model.inverse_dynamics`."""
    try:
        t = np.asarray(times, dtype=float).ravel()
    except (TypeError, ValueError):
        t = np.zeros(0)
    if not t.size or not np.isfinite(t).all() or np.any(np.diff(t) <= 0):
        raise OptionError(f"inverse_dynamics: give finite, ascending times [s], not {times!r}.")
    actuation = actuated(functions, unknowns)
    functions = actuation.functions
    p = operating_point(functions, None, float(t[0]), None, parameters).p
    wanted = courses(functions, motions, t, p)
    guess = {k: v if isinstance(v, exactly | near) else near(v) for k, v in start_mapping(start).items()}
    first = np.array([c(float(t[0]), 0) for c in wanted])
    sizes = np.cumsum([0, *(functions.outputs.resolve(key).numel() for key in motions)])
    guess |= {key: near(first[i:j]) for key, i, j in zip(motions, sizes, sizes[1:], strict=False)}
    began = operating_point(functions, guess, float(t[0]), inputs, parameters)
    return _Servo(actuation, wanted, began, input_signal(functions, inputs or {})).run(t)


def inverse_dynamics_function(functions: Functions, variables: Sequence[Expression], unknowns: Sequence[Unknown]) -> ca.Function:
    """See `Model.inverse_dynamics_function`."""
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
    top = ca.vertcat(*(_derivatives(outputs, values[k], w, names[k])[-1] for k in range(len(names))))
    B = ca.densify(ca.jacobian(top, w))
    if ca.depends_on(B, w):
        raise OptionError(
            f"inverse_dynamics_function: {', '.join(names)} is not linear in {', '.join(actuation.names)}; use inverse_dynamics."
        )
    a = ca.SX.sym("a", len(names))
    gap = a - ca.substitute(top, w, ca.SX.zeros(w.numel()))
    force = ca.solve(B, gap) if B.shape[0] == B.shape[1] else B.T @ ca.solve(B @ B.T, gap)
    u = ca.vertcat(ca.SX(0, 1), *(entry.sx for entry in inputs))
    return ca.Function(
        "inverse_dynamics", [s.t, s.x, a, u, s.p], [ca.densify(force)], ["t", "x", "a", "u", "p"], ["force"], {"cse": True}
    )


def _derivatives(outputs: Outputs, value: ca.SX, w: ca.SX, name: str) -> list[ca.SX]:
    """The expression and its time derivatives, up to the first one on which the forces w act (its relative degree: Isidori, Nonlinear
    Control Systems, 4.1).
    """
    chain = [value]
    while not ca.depends_on(chain[-1], w):
        if len(chain) > _HIGHEST:
            raise MotionError(
                f"inverse_dynamics: none of the forces acts on {name}, or on its first {_HIGHEST} derivatives. Name an actuator that moves it."
            )
        chain.append(outputs.rate(chain[-1]))
    if len(chain) == 1:
        raise OptionError(f"inverse_dynamics: {name} itself depends on a force; prescribe positions or velocities.")
    return chain


class _Servo:
    """States that follow the courses, and the forces that keep them there."""

    def __init__(
        self, actuation: Actuation, wanted: tuple[Course, ...], began: OperatingPoint, signal: Callable[[np.ndarray], np.ndarray]
    ) -> None:
        outputs = actuation.functions.outputs
        s = outputs.system
        self._actuation, self._wanted, self._began, self._signal = actuation, wanted, began, signal
        chains = [_derivatives(outputs, c.value, s.u[actuation.entries], c.name) for c in wanted]
        self._orders = [len(chain) - 1 for chain in chains]
        closing = ca.vertcat(s.closing, s.velocity_closing)
        self._closing = closing.numel()
        self._hard = Differentiable(s, ca.vertcat(closing, *(e for chain in chains for e in chain[:-1])))
        self._top = Differentiable(s, ca.vertcat(*(chain[-1] for chain in chains)))
        self._x_dot = Differentiable(s, s.x_dot)
        self._limit = np.concatenate([np.full(s.nq, 0.7), np.full(s.x.numel() - s.nq, np.inf)])

    def run(self, t: np.ndarray) -> InverseDynamics:
        """Where nothing is left open the motion is found time by time, otherwise by integration."""
        x0, free = self._follow(float(t[0]), self._began.x)
        self._forces(float(t[0]), x0)
        names = self._actuation.functions.state_names
        share = np.sum(free**2, axis=1)
        x = self._integrated(t, x0) if free.shape[1] else self._stepped(t, x0)
        u = np.column_stack([self._forces(float(at), x[:, k]) for k, at in enumerate(t)])
        return InverseDynamics(
            self._actuation, t, x, u, self._began.p, tuple(n for n, c in zip(names, share, strict=True) if c > 1e-6)
        )

    def _stepped(self, t: np.ndarray, x0: np.ndarray) -> np.ndarray:
        x, found = x0, [x0]
        for before, after in pairwise(t):
            here = before
            while here < after:
                last, rate = here, self._rate(here, x)
                fastest = max(1e-300, float(np.max(np.abs(rate[self._limit < np.inf]), initial=0.0)))
                h = max(_STRIDE / fastest, (after - before) / _MOST_STEPS)  # rates are huge where the mechanism can go no farther
                here = after if here + 1.001 * h > after else here + h
                x = self._follow(here, x + (here - last) * rate)[0]
            found.append(x)
        return np.column_stack(found)

    def _integrated(self, t: np.ndarray, x0: np.ndarray) -> np.ndarray:
        from scipy.integrate import solve_ivp

        if t.size == 1:
            return x0[:, None]
        recent: deque[float] = deque(maxlen=_STUCK)

        def rates(at: float, x: np.ndarray) -> np.ndarray:
            recent.append(at)
            if len(recent) == _STUCK and max(recent) - min(recent) < 1e-4 * (t[-1] - t[0]):
                raise MotionError(
                    f"inverse_dynamics: near t = {at:.6g} s rates grow without a bound, and the motion cannot go on: what is prescribed leads "
                    "out of reach, or to where its forces no longer act on it."
                )
            return self._rate(at, self._follow(at, x)[0])

        found = solve_ivp(rates, (t[0], t[-1]), x0, method="DOP853", t_eval=t, rtol=1e-10, atol=1e-12)
        if not found.success:
            raise MotionError(f"inverse_dynamics: the motion that is not prescribed could not be integrated: {found.message}")
        return np.column_stack([self._follow(float(at), x)[0] for at, x in zip(t, found.y.T, strict=True)])

    def _at(self, t: float, x: np.ndarray) -> OperatingPoint:
        u = self._signal(np.array([t]))[:, 0]
        u[self._actuation.entries] = 0.0
        return replace(self._began, t=t, x=x, u=u)

    def _follow(self, t: float, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nearest consistent states on the courses, and the directions that these leave open."""
        target = np.concatenate(
            [np.zeros(self._closing), *([c(t, k) for k in range(n)] for c, n in zip(self._wanted, self._orders, strict=True))]
        )
        unknown = Unknowns(self._at(t, guess), (), ())
        rows = unknown.rows(self._hard)

        gap = Rows(lambda x: rows.residual(x) - target, rows.jacobian)
        found = NearestRoot(gap, None, np.ones(guess.size), self._limit)(guess)
        if not found.converged:
            names = ["a loop"] * self._closing
            names += [c.name + "'" * k for c, n in zip(self._wanted, self._orders, strict=True) for k in range(n)]
            worst = [
                i for i in np.argsort(-np.abs(found.residual)) if abs(found.residual[i]) > 1e-3 * np.max(np.abs(found.residual))
            ][:4]
            raise MotionError(
                f"inverse_dynamics: at t = {t:.6g} s the mechanism cannot follow: "
                f"{', '.join(f'{names[i]} (off by {found.residual[i]:.3g})' for i in worst)}. The motions contradict each other or the "
                "constraints, or lead out of reach."
            )
        return found.z, found.free

    def _rate(self, t: float, x: np.ndarray) -> np.ndarray:
        return self._x_dot.value(replace(self._at(t, x), u=self._forces(t, x)))

    def _forces(self, t: float, x: np.ndarray) -> np.ndarray:
        """All inputs (nu,): the least forces (by the sum of squares) that give the wanted highest derivatives."""
        at, entries = self._at(t, x), self._actuation.entries
        by_force = np.zeros((at.u.size, len(entries)))
        by_force[entries, range(len(entries))] = 1.0
        target = np.array([c(t, n) for c, n in zip(self._wanted, self._orders, strict=True)])
        size = gap = np.zeros(0)
        for _ in range(_ROUNDS):  # once where derivatives are linear in the forces
            value = self._top.value(at)
            gap, B = target - value, self._top.along(at, du=by_force)
            size = 1.0 + np.abs(target) + np.abs(value) + np.abs(B) @ np.abs(at.u[entries])
            if np.all(np.abs(gap) <= 1e-13 * size) or not np.isfinite(B).all():
                break
            scale = np.maximum(np.max(np.abs(B), axis=1), 1e-300)
            change = np.linalg.lstsq(B / scale[:, None], gap / scale, rcond=_RANK)[0]
            u = at.u.copy()
            u[entries] += change
            at = replace(at, u=u)
        if not np.all(np.abs(gap) <= _MET * size):
            off = [
                f"{c.name} (off by {g:.3g})" for c, g, s in zip(self._wanted, gap, size, strict=True) if not abs(g) <= _MET * s
            ][:4]
            raise MotionError(
                f"inverse_dynamics: at t = {t:.6g} s the forces {', '.join(self._actuation.names)} cannot accelerate {', '.join(off)} as asked: "
                f"{len(self._wanted)} motions, {len(entries)} forces. Add an actuator to `unknowns`, or prescribe fewer motions."
            )
        return at.u
