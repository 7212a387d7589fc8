"""What a scene is asked about: start values, time, inputs and parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arguments import dictionary, finite
from acausal.collocation.inputs import Inputs
from acausal.errors import OptionError, StartValueError, UnknownVariableError
from acausal.language.component import Component
from acausal.language.expression import Discrete, Expression, Input, InputRate, Mode, Parameter, Symbol, leaves, number
from acausal.language.flatten import FlatSystem
from acausal.outputs.functions import Functions
from acausal.outputs.outputs import Outputs
from acausal.start.initial import InitialState, initial_state
from acausal.start.inputs import INPUTS, InputValue, input_signal
from acausal.start.start_values import Start, Value, entry_by_entry, exactly, near, start_mapping
from acausal.wording import nearest

StartValue = Value | exactly | near
StartValues = Mapping[Expression, StartValue] | Mapping[str, StartValue] | Mapping[Expression | str, StartValue]
InputValues = Mapping[Input, InputValue] | Mapping[str, InputValue] | Mapping[Input | str, InputValue]
ParameterValues = Mapping[Parameter, float] | Mapping[str, float] | Mapping[Parameter | str, float]
"""What users give, by symbols or their names."""


@dataclass(frozen=True, eq=False)
class Situation:
    """`start` values of expressions, the time `t0` [s] at which they hold, what `inputs` are given as, and values of all parameters `p` (np,)."""

    start: Start
    t0: float
    inputs: Mapping[Input, InputValue]
    p: np.ndarray

    def signal(self, functions: Functions) -> Inputs:
        """times (n,) -> inputs (nu, n)."""
        return input_signal(functions, self.inputs)

    def discretes(self, functions: Functions) -> np.ndarray | None:
        """(n,): values that what parts remember was given; no number where it was given none."""
        known = functions.outputs.system.flat.discretes
        return np.array([float(self.inputs.get(one, np.nan)) for one in known]) if known else None  # pyright: ignore[reportArgumentType]  # of these only numbers

    def u(self, functions: Functions) -> np.ndarray:
        """Inputs (nu,) at t0."""
        return self.signal(functions)(np.array([self.t0]))[:, 0]

    def initial(self, functions: Functions, u: np.ndarray | None = None) -> InitialState:
        """Consistent states, in all coordinates of the tree; `u`: inputs at t0 where they are known. Errors as for `initial_state`."""
        return initial_state(functions.outputs, self.start, self.t0, self.p, self.u(functions) if u is None else u)


def situation(
    outputs: Outputs, start: Any = None, t0: Any = 0.0, inputs: Any = None, parameters: Any = None, *, clock: str = "start t0"
) -> Situation:
    """Of what a user gives, symbols or their names. `clock`: what the time is called.

    Raises `StartValueError`, `OptionError`, `UnknownVariableError`, `ParameterError`.
    """
    system = outputs.system
    flat = system.flat
    values = system.p_values.copy()
    given = dictionary({} if parameters is None else parameters, "parameters", "{scene.mass: 2.0}")
    if given:
        known = {k: i for i, k in enumerate(flat.parameters)}
        for parameter, value in _by_symbol(flat, given, "parameter", known).items():
            values[known[parameter]] = number(value, outputs.name(parameter))
        flat.conditions.check(values[: len(known)])
    driven = dictionary({} if inputs is None else inputs, "inputs", INPUTS)
    own = (k for k in flat.inputs if not isinstance(k, InputRate | Mode))
    given_start, remembered = _parted(named_start(flat, start), outputs)
    driving = _by_symbol(flat, driven, "input", own) | remembered
    return Situation(given_start, finite(t0, f"The {clock} [s]"), driving, values)


def _parted(start: Start, outputs: Outputs) -> tuple[Start, dict[Any, float]]:
    """Start values of variables, and those of what parts remember, which are numbers. Raises `StartValueError`."""
    found: dict[Any, float] = {}
    for key, given in start.items():
        if not isinstance(key, Discrete):
            continue
        value = given.value if isinstance(given, exactly) else given
        if key not in outputs.system.flat.discretes or isinstance(value, near) or not np.isscalar(value):
            raise StartValueError(
                f"start value of {outputs.name(key)} is {given!r}. Give a number, to a discrete value of this scene."
            )
        found[key] = number(value, f"start value of {outputs.name(key)}")
    return {key: value for key, value in start.items() if key not in found}, found


def named_start(flat: FlatSystem, start: Any) -> Start:
    """Start values, by symbols also where they are given by name. Raises `StartValueError`, `UnknownVariableError`."""
    given = {
        Expression(key, leaves(key)) if isinstance(key, ca.SX) else key: value for key, value in start_mapping(start).items()
    }
    return entry_by_entry(_each_once(flat.symbols(given), given, "start"))


def _by_symbol(flat: FlatSystem, given: Mapping[Any, Any], kind: str, known: Iterable[Symbol]) -> dict[Any, Any]:
    """Values by symbol. Raises `UnknownVariableError` for what is not among those `known`, `OptionError` for one that is given twice."""
    if not given:
        return {}
    names = {flat.names[k]: k for k in known}
    found = {names.get(key, key) if isinstance(key, str) else key: value for key, value in given.items()}
    for key in found:
        if key not in names.values():
            raise UnknownVariableError(unknown_symbol(key, kind, list(names)))
    return _each_once(found, given, f"{kind}s")


def _each_once(found: dict[Any, Any], given: Mapping[Any, Any], what: str) -> dict[Any, Any]:
    if len(found) < len(given):
        raise OptionError(f"{what}: something is given twice, by itself and by its name, among {', '.join(map(repr, given))}.")
    return found


def unknown_symbol(symbol: Any, kind: str, known: list[str]) -> str:
    """Words for a `kind` of symbol that the scene has not."""
    article = "an" if kind == "input" else "a"
    held = vars(symbol).values() if isinstance(symbol, Component) else ()
    own = [value.name for value in held if isinstance(value, Input if kind == "input" else Parameter)]
    hint = f" Name the {kind} itself: {', '.join(f'scene.{name}' for name in own)}." if own else ""
    if isinstance(symbol, str):
        hint = nearest(symbol, known)
    return f"{symbol!r} is not {article} {kind} of this scene. It has: {', '.join(known) or 'none'}.{hint}"
