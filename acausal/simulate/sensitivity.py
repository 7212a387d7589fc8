"""Derivatives of motions: with respect to parameters, inputs and start values, and motions as differentiable CasADi functions."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.arguments import function_name
from acausal.collocation.problem import Accuracy, Directions, Problem
from acausal.errors import AssemblyError, OptionError, ParameterError, SimulationError, StartValueError
from acausal.integrators.sensitivity import Sensitive, integrate_sensitivities
from acausal.language.expression import Expression, Input, Parameter
from acausal.outputs.expression_names import expression_name
from acausal.outputs.functions import Functions
from acausal.reduce.modes import refuse_modes
from acausal.start.decided import check_decided
from acausal.start.initial import Start, initial_derivatives, near
from acausal.start.situation import Situation
from acausal.start.start_problem import places_in_start, start_problem, with_numbers
from acausal.wording import counted

Wanted = Parameter | Input | Expression
_NO_MOTION = (SimulationError, AssemblyError, StartValueError, ParameterError)
"""What values can do to a motion: wrong requests are told by other errors, or before."""


@dataclass(frozen=True, repr=False)
class Sensitivities:
    """States `x` (nx, m) at times `t` (m,) [s] and their derivatives `S` (m, nx, n).

    The n columns belong to `names`: parameters, inputs held constant, and start values, each entry of a vector for itself.
    `result[expression]` is the derivative of any expression along the motion, (m, size, n), without the middle axis for a scalar.
    """

    functions: Functions
    problem: Problem
    t: np.ndarray
    names: tuple[str, ...]
    directions: Directions
    found: Sensitive

    def __repr__(self) -> str:
        scene, (states, times) = self.functions.outputs.system.flat.name, self.x.shape
        return f"<Sensitivities of {scene}: {counted(states, 'state')} at {counted(times, 'time')} by {', '.join(self.names)}>"

    @property
    def x(self) -> np.ndarray:
        """States (nx, m)."""
        return self.found.x

    @property
    def S(self) -> np.ndarray:
        """Derivatives of the states (m, nx, n)."""
        return self.found.S

    def __getitem__(self, wanted: Expression | ca.SX) -> np.ndarray:
        value, total = self.total_derivative(wanted)
        return total[:, 0] if value.shape[0] == 1 else total

    def total_derivative(self, wanted: Expression | ca.SX) -> tuple[np.ndarray, np.ndarray]:
        """(size, m) values of an expression, and (m, size, n) total derivatives."""
        _, x, u, p = self.functions.space.arguments
        at = ca.vertcat(x, u, p)
        both = self.functions.value_and_slopes(wanted)
        size, m = both.numel_out(0), self.t.size
        parameters = np.repeat(self.problem.parameters[:, None], m, axis=1)
        values, slopes = both(self.t[None, :], self.x, self.problem.inputs(self.t), parameters)
        rows = np.array(slopes).reshape(size, m, at.numel()).transpose(1, 0, 2)
        d = self.directions
        outer = np.repeat(np.vstack([d.du, d.dp])[None], m, axis=0)
        if self.found.discrete is not None:  # the last ones of the inputs
            outer[:, u.numel() - self.found.discrete.shape[1] : u.numel()] = self.found.discrete
        return np.array(values).reshape(size, m), rows[:, :, : x.numel()] @ self.S + rows[:, :, x.numel() :] @ outer


def sensitivities(
    functions: Functions, problem: Problem, at: Situation, t: np.ndarray, wrt: Sequence[Wanted], accuracy: Accuracy
) -> Sensitivities:
    """Derivatives of a motion at times t (m,) from start values; see `Model.sensitivities`. Raises `OptionError` for what is imposed and released."""
    refuse_modes(functions.outputs.system.mechanics.locks, "sensitivities")
    what = _columns(functions, wrt, at.start)
    space, p, t0 = functions.space, at.p, at.t0
    x0, directions = initial_derivatives(
        functions.outputs, at.start, t0, p, at.u(functions), [c.start for c in what], [c.input for c in what], [c.parameter for c in what]
    )  # fmt: skip
    check_decided(functions.outputs.system, t0, x0, p)
    if space.elimination.symbols:
        problem = replace(problem, parameters=space.extended(t0, x0, p))
        dp = space.extended_change(t0, x0, p, directions.dx, directions.dp)
        directions = replace(directions, dx=space.restricted_change(x0, directions.dx), dp=dp)
        x0 = space.restricted(x0)
    found = integrate_sensitivities(problem, x0, t, directions, accuracy)
    return Sensitivities(functions, problem.with_modes(found.modes), t, tuple(c.name for c in what), directions, found)


@dataclass(frozen=True)
class _Column:
    """One direction: an entry among the start values, the inputs or the parameters."""

    name: str
    start: int | None = None
    input: int | None = None
    parameter: int | None = None


def _columns(functions: Functions, wrt: Sequence[Wanted], start: Start) -> list[_Column]:
    flat = functions.outputs.system.flat
    columns: list[_Column] = []
    keys = [key for key in start for _ in range(functions.outputs.resolve(key).numel())]
    for item in wrt:
        if isinstance(item, Parameter) and item in flat.parameters:
            columns.append(_Column(functions.outputs.name(item), parameter=flat.parameters.index(item)))
        elif isinstance(item, Input) and item in flat.inputs:
            columns.append(_Column(functions.outputs.name(item), input=flat.inputs.index(item)))
        elif places := places_in_start(item, start):
            if any(isinstance(start[keys[at]], near) for at in places):
                raise OptionError(f"sensitivities: the start value of {item!r} is only near; give it exactly.")
            name = expression_name(functions.outputs, item)
            columns += [_Column(name + (f"[{k}]" if len(places) > 1 else ""), start=at) for k, at in enumerate(places)]
        else:
            raise OptionError(
                f"sensitivities: {expression_name(functions.outputs, item)} is not a parameter or an input of this scene, and has no start value in `start`. "
                "Give it one, start={variable: value}, or build with ac.Parameter for what is to vary."
            )
    return columns


class TrajectoryFunction(ca.Callback):
    """values of `wrt` (n,) -> outputs at all times, one column a time: a CasADi function with exact first derivatives.

    Values and derivatives come from the same integration, which is not repeated for the same argument. Second derivatives do not
    exist: use a limited-memory Hessian in optimisers. Where the values are not finite, a start cannot be assembled or a motion fails,
    the result is NaN, since a CasADi function cannot say more, and `failure` says why. Keep a reference as long as it is used.
    """

    def __init__(self, name: str, motion: Motion) -> None:
        super().__init__()
        name = function_name(name, "trajectory_function: the name")
        # CasADi loses errors of its callbacks, and errors of values become NaN: what is asked is looked at before
        motion.functions.outputs.resolve(motion.outputs)
        start_problem(motion.functions.outputs, motion.at.start)
        _columns(motion.functions, motion.wrt, motion.at.start)
        self._name, self._motion = name, motion
        self._derivatives: list[ca.Callback] = []
        self.construct(name, {})

    @property
    def failure(self) -> str:
        """Why there is no motion of the values that it was asked for last; empty if there is one."""
        return self._motion.failure

    def __reduce__(self) -> tuple[Any, ...]:
        return TrajectoryFunction, (self._name, self._motion)

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> TrajectoryFunction:
        m = self._motion
        alone = copy.deepcopy(m.functions, memo) is m.functions
        return TrajectoryFunction(self._name, m if alone else copy.deepcopy(m, memo))

    def get_n_in(self) -> int:
        """One."""
        return 1

    def get_n_out(self) -> int:
        """One."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """(n,)"""
        return ca.Sparsity.dense(self._motion.size_in, 1)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """(size of outputs, times)"""
        return ca.Sparsity.dense(*self._motion.shape_out)

    def eval(self, arg: Sequence[Any]) -> list[Any]:
        """Outputs for one argument."""
        return [ca.DM(self._motion(np.array(arg[0]).ravel())[0])]

    def has_jacobian(self) -> bool:
        """Yes."""
        return True

    def get_jacobian(self, name: str, inames: Sequence[str], onames: Sequence[str], opts: Mapping[str, Any]) -> ca.Function:
        """(argument, result) -> derivative of the result, column by column."""
        made = _TrajectoryJacobian(name, self._motion, opts)
        self._derivatives.append(made)
        return made


class _TrajectoryJacobian(ca.Callback):
    def __init__(self, name: str, motion: Motion, opts: Mapping[str, Any]) -> None:
        super().__init__()
        self._motion = motion
        self.construct(name, dict(opts))

    def get_n_in(self) -> int:
        return 2

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._motion.size_in, 1) if i == 0 else ca.Sparsity.dense(*self._motion.shape_out)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        rows, columns = self._motion.shape_out
        return ca.Sparsity.dense(rows * columns, self._motion.size_in)

    def eval(self, arg: Sequence[Any]) -> list[Any]:
        return [ca.DM(self._motion(np.array(arg[0]).ravel())[1])]


@dataclass(frozen=True, eq=False)
class Motion:
    """Outputs (size, m) at fixed times and their derivatives (size * m, n), as a function of the values of `wrt`.

    `sensitivities`: of a motion, by its situation, which is `at` where `wrt` does not say otherwise.
    """

    functions: Functions
    sensitivities: Callable[[Situation], Sensitivities]
    at: Situation
    times: np.ndarray
    outputs: Expression | ca.SX
    wrt: tuple[Wanted, ...]

    @functools.cached_property
    def size_in(self) -> int:
        """Entries of `wrt`."""
        return sum(map(self._size, self.wrt))

    def _size(self, item: Wanted) -> int:
        return 1 if isinstance(item, Parameter | Input) else self.functions.outputs.resolve(item).numel()

    @functools.cached_property
    def shape_out(self) -> tuple[int, int]:
        """Size of the outputs, number of times."""
        return self.functions.outputs.resolve(self.outputs).numel(), self.times.size

    @functools.cached_property
    def _last(self) -> dict[bytes, tuple[np.ndarray, np.ndarray, str]]:
        return {}

    @property
    def failure(self) -> str:
        """Why there is no motion of the last values; empty if there is one."""
        return next((why for _, _, why in self._last.values()), "")

    def __call__(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (size, m) and derivatives (size * m, n); NaN where there is no such motion."""
        key = values.tobytes()
        if key not in self._last:
            self._last.clear()
            self._last[key] = self._evaluate(values)
        return self._last[key][:2]

    def _evaluate(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, str]:
        flat = self.functions.outputs.system.flat
        start, inputs, p = self.at.start, dict(self.at.inputs), self.at.p.copy()
        at = 0
        for item in self.wrt:
            size = self._size(item)
            if isinstance(item, Parameter):
                p[flat.parameters.index(item)] = values[at]
            elif isinstance(item, Input):
                inputs[item] = float(values[at])
            else:
                start = with_numbers(self.functions.outputs, start, places_in_start(item, start), values[at : at + size])
            at += size
        rows, m = self.shape_out
        try:
            if not np.isfinite(values).all():
                raise ParameterError(f"No motion belongs to values that are not finite: {values.tolist()}.")
            flat.conditions.check(p[: len(flat.parameters)])
            found = self.sensitivities(replace(self.at, start=start, inputs=inputs, p=p))
        except _NO_MOTION as error:
            return np.full((rows, m), np.nan), np.full((rows * m, values.size), np.nan), str(error)
        value, slopes = found.total_derivative(self.outputs)
        return value, slopes.reshape(m * rows, values.size), ""
