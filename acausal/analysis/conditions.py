"""What must vanish in an equilibrium or a steady motion, row by row, in states, free inputs and free parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.analysis.nearest import Rows
from acausal.analysis.point import Differentiable, OperatingPoint
from acausal.arguments import expressions, finite, listed
from acausal.errors import OptionError
from acausal.language.expression import Expression, Input, Parameter
from acausal.outputs.expression_names import labels
from acausal.outputs.functions import Functions
from acausal.start.initial import Start, exactly, near

Steady = Sequence[Expression] | Mapping[Expression, float | None]


@dataclass(frozen=True)
class Unknowns:
    """z = (x, free inputs, free parameters); `inputs` and `parameters` are places in u and p."""

    point: OperatingPoint
    inputs: tuple[int, ...]
    parameters: tuple[int, ...]

    @property
    def z(self) -> np.ndarray:
        """(n,)."""
        at = self.point
        return np.concatenate([at.x, at.u[list(self.inputs)], at.p[list(self.parameters)]])

    def at(self, z: np.ndarray) -> OperatingPoint:
        """The operating point for other values."""
        n, m = self.point.x.size, len(self.inputs)
        u, p = self.point.u.copy(), self.point.p.copy()
        u[list(self.inputs)], p[list(self.parameters)] = z[n : n + m], z[n + m :]
        return replace(self.point, x=z[:n], u=u, p=p)

    def rows(self, column: Differentiable) -> Rows:
        """(residual, Jacobian in z) of a column of expressions."""
        n, m, k = self.point.x.size, len(self.inputs), len(self.parameters)
        dx, du, dp = np.eye(n, n + m + k), np.zeros((self.point.u.size, n + m + k)), np.zeros((self.point.p.size, n + m + k))
        du[list(self.inputs), range(n, n + m)] = 1.0
        dp[list(self.parameters), range(n + m, n + m + k)] = 1.0

        return Rows(
            lambda z: column.value(self.at(z)),
            lambda z: column.along(self.at(z), dx, du=du, dp=dp),
            lambda z, sizes: column.rounding(self.at(z), sizes[:n]),
        )


def unknowns(functions: Functions, point: OperatingPoint, free: Sequence[Input | Parameter]) -> Unknowns:
    """Raises `OptionError` for something free that is no input or parameter of the scene."""
    flat = functions.outputs.system.flat
    inputs, parameters = [], []
    for item in listed(free, "equilibrium: `free`", "free=[scene.torque]"):
        if isinstance(item, Input) and item in flat.inputs:
            inputs.append(flat.inputs.index(item))
        elif isinstance(item, Parameter) and item in flat.parameters:
            parameters.append(flat.parameters.index(item))
        else:
            known = [functions.outputs.name(s) for s in (*flat.inputs, *flat.parameters)]
            raise OptionError(
                f"equilibrium: {item!r} in `free` is not an input or a parameter of '{flat.name}', which has: {', '.join(known) or 'none'}. "
                "States are always free."
            )
    return Unknowns(point, tuple(inputs), tuple(parameters))


@dataclass(frozen=True)
class Conditions:
    """Columns of expressions: `balance` vanishes in the equilibrium, `hard` are all conditions with `names`, `soft` the wishes.
    `motion`: those of the hard ones that ask for positions and rates, whatever the forces; `invariants`: what is asked to be constant.
    """

    hard: ca.SX
    names: tuple[str, ...]
    balance: ca.SX
    soft: ca.SX
    motion: ca.SX
    invariants: ca.SX


def conditions(functions: Functions, start: Start, steady: Steady) -> Conditions:
    """Closed loops, what `start` holds exactly, and no change of anything (or of what is `steady`).

    Raises `OptionError`, `UnknownVariableError`.
    """
    keys = expressions(steady, "equilibrium: `steady`", "steady=[scene.hinge.q], or a dictionary of rates")
    s = functions.outputs.system
    touching = ca.vertcat(ca.SX(0, 1), *(held.invariants for held in (s.locks, s.modes) if held is not None))
    closing = ca.vertcat(s.closing, s.velocity_closing, touching)
    balance, moving, about = _steady_rows(functions, steady) if keys else _static_rows(functions)
    held, wished, names = [], [], []
    for key, value in start.items():
        number = value.value if isinstance(value, exactly | near) else value
        gap = ca.vec(functions.outputs.resolve(key)) - ca.SX(ca.DM(np.asarray(number, dtype=float).ravel(order="F")))
        (held if isinstance(value, exactly) else wished).append(_turn(gap) if functions.outputs.is_angle(key) else gap)
        if isinstance(value, exactly):
            names += labels(functions.outputs, key)
    none = ca.SX(0, 1)
    hard = ca.vertcat(none, closing, *held, balance)
    loops = closing.numel() - touching.numel()
    about = (*("a loop" for _ in range(loops)), *("a contact" for _ in range(touching.numel())), *names, *about)
    constant = ca.vertcat(none, *_constant(functions, steady))
    return Conditions(hard, about, balance, ca.vertcat(none, *wished), ca.vertcat(none, closing, *held, moving), constant)


def _constant(functions: Functions, steady: Steady) -> Iterator[ca.SX]:
    """What is steady, or its rate where that is asked for."""
    outputs = functions.outputs
    rates: Mapping[Expression, float | None] = steady if isinstance(steady, Mapping) else dict.fromkeys(steady, 0.0)
    for key, rate in rates.items():
        value = ca.vec(outputs.resolve(key))
        yield value if rate == 0 else outputs.rate(value)


def _turn(angle: ca.SX) -> ca.SX:
    return ca.atan2(ca.sin(angle), ca.cos(angle))


def _static_rows(functions: Functions) -> tuple[ca.SX, ca.SX, list[str]]:
    return functions.outputs.system.x_dot, ca.SX(0, 1), [f"{name}'" for name in functions.state_names]


def _steady_rows(functions: Functions, steady: Steady) -> tuple[ca.SX, ca.SX, list[str]]:
    """e' = rate, and e'' = 0 where e depends on positions only; the former of these again."""
    outputs, s = functions.outputs, functions.outputs.system
    wanted: Mapping[Expression, float | None] = steady if isinstance(steady, Mapping) else dict.fromkeys(steady, 0.0)
    v = s.x[s.nq : s.nq + s.tree_velocities, :]
    rows, moving, names = [], [ca.SX(0, 1)], []
    for key, rate in wanted.items():
        if rate is not None:
            rate = finite(rate, f"equilibrium: the rate of {', '.join(labels(outputs, key))} (None for any)")
        value = ca.vec(outputs.resolve(key))
        if ca.depends_on(value, s.u):
            raise OptionError(
                f"equilibrium: {', '.join(labels(outputs, key))} depends on an input, which has no rate of its own."
            )
        first = outputs.rate(value)
        by_velocity = bool(v.numel()) and ca.depends_on(value, v)
        if rate is not None:
            rows.append(first - rate)
            moving += [] if ca.depends_on(value, s.x[s.nq :, :]) else [first - rate]
            names += [f"{n}'" for n in labels(outputs, key)]
        elif by_velocity:
            raise OptionError(
                f"equilibrium: {', '.join(labels(outputs, key))} is a velocity; a rate of None would say nothing of it."
            )
        if not by_velocity:
            rows.append(outputs.rate(first))
            names += [f"{n}''" for n in labels(outputs, key)]
    return ca.vertcat(*rows), ca.vertcat(*moving), names
