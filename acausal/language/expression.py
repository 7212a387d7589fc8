"""Expressions: what a user computes with, a CasADi `SX` that remembers the declared symbols in it."""

from __future__ import annotations

import functools
import math
import operator
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self, cast, overload

import casadi as ca
import numpy as np

from acausal.errors import ExpressionError, ParameterError
from acausal.language.casadi_tables import Contents, is_no_number, without_calls
from acausal.language.identity import Atom
from acausal.language.interpolant import is_spline, of_spline
from acausal.language.no_numbers import symbols_say_that_they_are_no_numbers
from acausal.language.origin import asked_while_made, origin
from acausal.language.units import certainly_different

symbols_say_that_they_are_no_numbers()

_UFUNCS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b, "subtract": lambda a, b: a - b, "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b, "power": lambda a, b: a**b, "negative": lambda a: -a, "matmul": lambda a, b: a @ b,
    "sin": ca.sin, "cos": ca.cos, "tan": ca.tan, "arcsin": ca.asin, "arccos": ca.acos, "arctan": ca.atan,
    "arctan2": ca.atan2, "sinh": ca.sinh, "cosh": ca.cosh, "tanh": ca.tanh, "exp": ca.exp, "log": ca.log,
    "sqrt": ca.sqrt, "absolute": ca.fabs, "fabs": ca.fabs, "sign": ca.sign, "maximum": ca.fmax, "minimum": ca.fmin,
    "square": lambda a: a * a, "hypot": ca.hypot, "floor": ca.floor, "ceil": ca.ceil,
    "arcsinh": ca.asinh, "arccosh": ca.acosh, "arctanh": ca.atanh, "log1p": ca.log1p, "expm1": ca.expm1, "fmax": ca.fmax, "fmin": ca.fmin,
    "log10": lambda a: ca.log(a) / math.log(10.0), "log2": lambda a: ca.log(a) / math.log(2.0), "exp2": lambda a: ca.exp(a * math.log(2.0)),
    "reciprocal": lambda a: 1 / a, "positive": lambda a: a, "copysign": ca.copysign, "deg2rad": lambda a: a * (math.pi / 180), "radians": lambda a: a * (math.pi / 180),
    "rad2deg": lambda a: a * (180 / math.pi), "degrees": lambda a: a * (180 / math.pi), "fmod": ca.fmod, "remainder": lambda a, b: a - b * ca.floor(a / b),
    "floor_divide": lambda a, b: ca.floor(a / b), "heaviside": lambda a, b: ca.if_else(a > 0, 1, ca.if_else(a < 0, 0, b)),
    "equal": ca.eq, "not_equal": ca.ne, "logical_and": ca.logic_and, "logical_or": ca.logic_or, "logical_not": ca.logic_not,
    "less": ca.lt, "less_equal": ca.le, "greater": ca.gt, "greater_equal": ca.ge,
}  # fmt: skip


class Expression:
    """A scalar, vector or matrix of symbols and numbers; wraps a CasADi `SX` and the declared symbols it is made of.

    Works with `+ - * / ** @ [] .T`, with numpy's elementary functions and, as `SX`, with every CasADi function.
    """

    __array_priority__ = 2000.0
    __slots__ = ("_called", "_leaves", "_sx")

    def __init__(self, sx: ca.SX, leaves: frozenset[Symbol], called: str = "") -> None:
        self._sx = sx
        self._leaves = leaves
        self._called = called

    @property
    def called(self) -> str:
        """What it is, as reports call it, with {} for what it is made of: "azimuth{}"; empty where its formula says it."""
        return self._called

    @property
    def sx(self) -> ca.SX:
        """The CasADi expression."""
        return self._sx

    @property
    def leaves(self) -> frozenset[Symbol]:
        """The declared symbols (variables, parameters, inputs, time) in it."""
        return self._leaves

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns; a scalar is (1, 1), a vector (n, 1)."""
        return self.sx.shape

    @property
    def T(self) -> Expression:
        """The transpose."""
        return Expression(self.sx.T, self.leaves)

    def __SX__(self) -> ca.SX:
        return self.sx

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **_: Any) -> Expression:
        operation = _UFUNCS.get(ufunc.__name__)
        if method != "__call__" or operation is None:
            raise ExpressionError(
                f"numpy.{ufunc.__name__} is not defined for symbolic expressions ({origin()}); CasADi's functions take them."
            )
        return _combined(operation, *inputs)

    def __array_function__(self, function: Any, _: Any, arguments: tuple[Any, ...], options: dict[str, Any]) -> Expression:
        from acausal.language.numpy_functions import applied

        return applied(function, arguments, options)

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        if self.sx.is_constant():
            return _numbers(self.sx)
        raise ExpressionError(
            f"{self!r} is symbolic and cannot become an array of numbers ({origin()}). Of numpy, elementary functions take it (np.sin, "
            "np.sqrt ...); otherwise use CasADi's, e.g. ca.norm_2(...), or ca.vertcat(...) to put entries together. A spline of scipy is given to an "
            "ac.Input as its course, inputs={scene.u: spline}, and looked up at an expression by ac.lookup(spline, scene.shaft.w)."
        )

    def __add__(self, other: Scalar) -> Expression:
        return _combined(operator.add, self, other)

    def __radd__(self, other: Scalar) -> Expression:
        return _combined(operator.add, other, self)

    def __sub__(self, other: Scalar) -> Expression:
        return _combined(operator.sub, self, other)

    def __rsub__(self, other: Scalar) -> Expression:
        return _combined(operator.sub, other, self)

    def __mul__(self, other: Scalar) -> Expression:
        return _combined(operator.mul, self, other)

    def __rmul__(self, other: Scalar) -> Expression:
        return _combined(operator.mul, other, self)

    def __truediv__(self, other: Scalar) -> Expression:
        return _combined(operator.truediv, self, other)

    def __rtruediv__(self, other: Scalar) -> Expression:
        return _combined(operator.truediv, other, self)

    def __pow__(self, other: Scalar) -> Expression:
        return _combined(operator.pow, self, other)

    def __rpow__(self, other: Scalar) -> Expression:
        return _combined(operator.pow, other, self)

    def __mod__(self, other: Scalar) -> Expression:
        return cast(Expression, np.remainder(cast(Any, self), other))

    def __floordiv__(self, other: Scalar) -> Expression:
        return cast(Expression, np.floor_divide(cast(Any, self), other))

    def __and__(self, other: Scalar) -> Expression:
        return _combined(ca.logic_and, self, other)

    def __or__(self, other: Scalar) -> Expression:
        return _combined(ca.logic_or, self, other)

    def __matmul__(self, other: Scalar) -> Expression:
        return _combined(operator.matmul, self, other)

    def __rmatmul__(self, other: Scalar) -> Expression:
        return _combined(operator.matmul, other, self)

    def __lt__(self, other: Scalar) -> Expression:
        return _combined(operator.lt, self, other)

    def __le__(self, other: Scalar) -> Expression:
        return _combined(operator.le, self, other)

    def __gt__(self, other: Scalar) -> Expression:
        return _combined(operator.gt, self, other)

    def __ge__(self, other: Scalar) -> Expression:
        return _combined(operator.ge, self, other)

    def __eq__(self, other: object) -> Any:
        """With numbers an expression, as for `<`; with others whether it is the same object, for dictionaries."""
        return _combined(operator.eq, self, cast("Any", other)) if isinstance(other, _NUMBERS) else self is other

    def __ne__(self, other: object) -> Any:
        return _combined(operator.ne, self, cast("Any", other)) if isinstance(other, _NUMBERS) else self is not other

    def __hash__(self) -> int:
        return id(self)

    def __neg__(self) -> Expression:
        return Expression(-self.sx, self.leaves)

    def __abs__(self) -> Expression:
        return Expression(ca.fabs(self.sx), self.leaves)

    def __getitem__(self, index: Any) -> Expression:
        try:
            return Expression(
                self.sx[index], self.leaves, f"{self.called}[{index}]" if self.called and isinstance(index, int) else ""
            )
        except (RuntimeError, NotImplementedError):
            raise ExpressionError(
                f"{self!r} has no entry [{index!r}] ({origin()}): its shape is {self.shape}. Entries are counted from 0."
            ) from None

    def __len__(self) -> int:
        return self.sx.shape[0]

    def __iter__(self) -> Iterator[Expression]:
        rows, columns = self.shape
        if rows == 1 == columns:
            raise ExpressionError(f"{self!r} is a scalar, and a list is needed here ({origin()}). Put it into one: [...].")
        return (self[i] if columns == 1 else self[i, :] for i in range(rows))

    def __float__(self) -> float:
        if self.sx.is_constant() and self.shape == (1, 1):
            return float(self.sx)
        raise ExpressionError(
            f"{self!r} is symbolic and has no number before a simulation ({origin()}). In expressions use functions of numpy or "
            "CasADi in place of those of math; numbers are read from a trajectory, run[...]."
        )

    def __bool__(self) -> bool:
        raise ExpressionError(
            f"{self!r} is symbolic and is neither true nor false ({origin()}). In place of Python's `if` write "
            "ca.if_else(condition, value, other value)."
        )

    def __repr__(self) -> str:
        return str(self.sx)


def _numbers(value: ca.SX) -> np.ndarray:
    """Of an expression of nothing but numbers."""
    return np.array(ca.DM(ca.evalf(ca.densify(value))))


_NUMBERS = (int, float, np.number, np.ndarray, ca.SX)

Scalar = Expression | ca.SX | float | np.ndarray | Sequence[Any]
"""Anything that can stand in an expression."""


def sx(value: Scalar) -> ca.SX:
    """`value` as CasADi `SX`; a sequence becomes a column."""
    if isinstance(value, Expression):
        return value.sx
    if isinstance(value, ca.SX):
        return value
    if isinstance(value, list | tuple):
        return ca.vertcat(*(sx(entry) for entry in value))
    try:
        return ca.SX(ca.DM(value)) if isinstance(value, np.ndarray) else ca.SX(value)
    except NotImplementedError:
        raise ExpressionError(
            f"{value!r} cannot stand in an expression ({origin()}). Use numbers, variables of parts, ac.time, or CasADi's SX."
        ) from None


_CODES: dict[Callable[..., Any], int] = {
    operator.add: ca.OP_ADD, operator.sub: ca.OP_SUB, operator.mul: ca.OP_MUL, operator.truediv: ca.OP_DIV,
}  # fmt: skip


def binary(operation: Callable[..., Any], a: ca.SX, b: ca.SX) -> ca.SX:
    """`operation`(a, b), one of those of `operator`: +, -, * and / without asking for any kind of number that CasADi knows whether they are of it, which takes ten times as
    long."""
    code = _CODES.get(operation)
    return operation(a, b) if code is None else ca.SX.binary(code, a, b)


def _combined(operation: Callable[..., Any], *values: Scalar) -> Expression:
    """The result of an operation. Raises `ExpressionError` for operands that do not fit."""
    operands = [sx(value) for value in values]
    try:
        result = binary(operation, *operands) if len(operands) == 2 else operation(*operands)
    except (RuntimeError, TypeError, NotImplementedError):
        shapes = " and ".join(str(operand.shape) for operand in operands)
        name = getattr(operation, "__name__", "")
        raise ExpressionError(
            f"{' and '.join(map(repr, values))} do not fit together{f' in {name!r}' if name.isidentifier() else ''} ({origin()}): their "
            f"shapes are {shapes}."
        ) from None
    return Expression(result, leaves(*values))


def leaves(*values: Any) -> frozenset[Symbol]:
    """The declared symbols in all of `values`, also inside lists and tuples, and in `SX` that CasADi's functions have made of them."""
    found: frozenset[Symbol] = frozenset()
    for value in values:
        if isinstance(value, Expression):
            found |= value.leaves
        elif isinstance(value, ca.SX):
            found |= declared_in(value)
        elif isinstance(value, list | tuple):
            found |= leaves(*value)
    return found


def _text(given: str, what: str) -> str:
    if not isinstance(given, str):  # pyright: ignore[reportUnnecessaryIsInstance]  # users give anything
        raise ExpressionError(
            f'{what} is {given!r} ({origin()}). Give a text, as "m/s", and numbers by their names: default=, start=.'
        )
    return given


class Symbol(Expression):
    """A declared quantity. Two symbols are the same only if they are the same object.

    `unit`: shown wherever its values are, as a text; nothing is converted by it, or checked, and "kgg" is a unit like any other.
    """

    kind: ClassVar[str] = "symbol"

    def __init__(self, name: str, unit: str, description: str = "", shape: tuple[int, int] = (1, 1)) -> None:
        sx = ca.SX.sym(name, *shape)
        super().__init__(sx, frozenset((self,)))
        self._atom = Atom(name, sx)
        self.name = name
        self.unit = _text(unit, f"The unit of a symbol ({self.kind})")
        self.description = _text(description, f"The description of a symbol ({self.kind})")
        self._declare()

    @property
    def scalars(self) -> tuple[ca.SX, ...]:
        """Its entries, column by column."""
        return (self.sx,) if self.sx.is_scalar() else tuple(self.sx[k] for k in range(self.sx.numel()))

    def _declare(self) -> None:
        for scalar in self.scalars:
            _DECLARED[scalar.element_hash()] = self

    def __setstate__(self, state: tuple[dict[str, Any], dict[str, Any]]) -> None:
        for part in state:
            for name, value in part.items():
                setattr(self, name, value)
        self._declare()

    @property
    def is_angle(self) -> bool:
        """Whether it turns something, so that no length is needed to say how much of it is much: its unit says so."""
        return self.unit == "rad"

    def __repr__(self) -> str:
        return f"{type(self).__name__} {self.name}" + (f" [{self.unit}]" if self.unit else "")


_DECLARED: weakref.WeakValueDictionary[int, Symbol] = weakref.WeakValueDictionary()
"""Each living symbol by its scalars, which CasADi's functions keep while they drop the `Expression` around them."""


def declared(scalar: ca.SX) -> Symbol | None:
    """The declared symbol that a scalar symbol belongs to; None for one that nobody declared, or nobody kept."""
    return _DECLARED.get(scalar.element_hash())


def declared_in(value: ca.SX) -> frozenset[Symbol]:
    """All declared symbols in an `SX`."""
    return frozenset(symbol for scalar in ca.symvar(value) if (symbol := declared(scalar)) is not None)


class Variable(Symbol):
    """An unknown of the scene, declared in a component class: `w = ac.Variable("rad/s", "angular velocity")`.

    `size` > 1 makes a column. `start` is where a search for initial values begins.
    `if_undetermined` is said to the user when nothing determines the variable.
    Each component instance has its own copy.
    """

    kind = "variable"

    def __init__(
        self,
        unit: str = "",
        description: str = "",
        *,
        size: int = 1,
        start: float | Sequence[float] | None = None,
        if_undetermined: str = "",
        name: str = "variable",
    ) -> None:
        super().__init__(name, unit, description, (size, 1))
        self.size = size
        self.start = start
        self.if_undetermined = if_undetermined

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> Self: ...
    def __get__(self, instance: object | None, owner: type) -> Self:
        if instance is None:
            return self
        own = instance.__dict__.get(self.name)
        if own is None:
            own = type(self)(
                self.unit,
                self.description,
                size=self.size,
                start=self.start,
                if_undetermined=self.if_undetermined,
                name=self.name,
            )
            instance.__dict__[self.name] = own
        return own


class Derivative(Symbol):
    """The time derivative of a symbol."""

    kind = "derivative"

    def __init__(self, of: Symbol) -> None:
        super().__init__(f"der({of.name})", f"{of.unit}/s" if of.unit else "1/s", shape=of.shape)
        self.of = of


class Parameter(Symbol):
    """A number that stays adjustable after the build, and differentiable: `ac.Parameter(1.0, "kg")`."""

    kind = "parameter"

    def __init__(self, value: float, unit: str = "", description: str = "") -> None:
        super().__init__("parameter", unit, description)
        self.value = number(value, "a Parameter's value")
        self.conditions: list[Condition] = []
        """What is asked of values that are made of it, but for what parts of the catalogue ask, who know it themselves."""


class Input(Symbol):
    """A quantity given from outside at every instant: `ac.Input("N*m")`. `default` is used where none is given."""

    kind = "input"

    def __init__(self, unit: str = "", description: str = "", *, default: float = 0.0) -> None:
        super().__init__("input", unit, description)
        self.default = number(default, "an Input's default")


class InputRate(Input):
    """The rate of an input, an input of its own, where a part needs it: it follows from what the input is given as."""

    def __init__(self, of: Input) -> None:
        super().__init__(f"{of.unit}/s" if of.unit else "1/s", f"rate of {of.name}")
        self.name = f"der({of.name})"
        self.of = of


class Reaction(Input):
    """How hard a part pushes that holds only as hard as it must, and no harder than it can: `ac.Reaction("N")`. Its `laws()` say how."""

    kind = "reaction"

    def __init__(self, unit: str = "", description: str = "") -> None:
        super().__init__(unit, description)
        self.name = "reaction"


class Magnitude(Symbol):
    """How large a force or torque of one to three components is, as limits of friction need it: mu times `ac.Magnitude(hinge.frame_a.force)`. It may depend on
    reactions, those of joints and of the friction that it limits too.
    """

    kind = "magnitude"

    def __init__(self, of: Expression | ca.SX | Sequence[Any], unit: str = "N") -> None:
        super().__init__("magnitude", unit)
        column = ca.vec(sx(of))
        if not 1 <= column.numel() <= 3:
            raise ExpressionError(
                f"A Magnitude is of one to three components, and was given {column.numel()} ({origin()}). Give those of one force or torque."
            )
        self.of = Expression(column, leaves(of))


class Mode(Input):
    """An input that nobody gives: which of its ways of behaving a part is in, see `acausal.modes`."""

    def __init__(self, name: str, description: str) -> None:
        super().__init__("", description)
        self.name = name


class Discrete(Mode):
    """A number that a part remembers, constant until an event sets it: `self.count = ac.Discrete(start=0)`, with `ac.when(..., set={self.count: ...})`.

    `start`: a number, or an expression of the scene whose value at the start it takes, unless it is given a start value.
    """

    kind = "discrete"

    def __init__(self, unit: str = "", description: str = "", *, start: Scalar = 0.0) -> None:
        super().__init__("discrete", description)
        self.unit = _text(unit, "The unit of a Discrete")
        self.start = scalar(float(start) if isinstance(start, bool | np.bool_) else start, "A Discrete's start")
        self.default = 0.0 if isinstance(self.start, Expression) else self.start


class Time(Symbol):
    """Time in seconds."""

    kind = "time"

    def __init__(self) -> None:
        super().__init__("time", "s")
        self._atom = Atom("time", self.sx, lasting="time")

    def __reduce__(self) -> str:
        return "time"

    def __repr__(self) -> str:
        return "ac.time [s]"


time = Time()
"""The one time of every scene [s]."""


_MOST = 1e150
"""Quantities of parts are no larger, of whatever unit: energies and inertias are products of them."""


def number(value: Any, what: str) -> float:
    """`value` as a finite float; raises `ParameterError` naming `what` and the user's line, also for True and False, which Python takes for 1 and 0."""
    try:
        result = float("no number" if isinstance(value, str) or is_truth(value) else value)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        text = " ".join(repr(value).split())
        text = text if len(text) <= 80 else text[:78] + " …"
        raise ParameterError(f"{what} must be a number, not {text} ({origin()}).") from None
    if not math.isfinite(result):
        raise ParameterError(f"{what} is {result} ({origin()}). Give a finite number.")
    return result


def is_truth(value: Any) -> bool:
    """Whether it is True or False, or holds one of them: no number, though Python takes it for 1 or 0."""
    return (
        isinstance(value, bool | np.bool_)
        or (isinstance(value, np.ndarray) and value.dtype == bool)
        or (isinstance(value, list | tuple) and any(is_truth(one) for one in value))
    )


def flag(value: Any, what: str) -> bool:
    """True or False; raises `ParameterError` naming `what` and the user's line for anything else, such as "no", which Python takes for true."""
    if not isinstance(value, bool | np.bool_):
        raise ParameterError(f"{what} is {value!r} ({origin()}). Give True or False.")
    return bool(value)


def scalar(value: Scalar, what: str, *, positive: bool = False, non_negative: bool = False, unit: str = "") -> float | Expression:
    """A checked scalar: a finite float, or an expression whose parameters are checked by their values.

    Raises `ParameterError` naming `what` and the user's line when not finite, not of the sign asked for, or a parameter or input
    declared with a unit of another kind than `unit`.
    """
    check_unit(value, what, unit)
    if isinstance(value, Expression | ca.SX):
        expression = value if isinstance(value, Expression) else Expression(value, leaves(value))
        if expression.shape != (1, 1):
            raise ParameterError(f"{what} must be a scalar, not of shape {expression.shape} ({origin()}).")
        if not expression.sx.is_constant():
            expression = _shown(expression, what)
            return checked(expression, functools.partial(_check_sign, what=what, positive=positive, non_negative=non_negative))
    result = number(value, what)
    _check_sign(np.array(result), what, positive, non_negative)
    return result


def _check_sign(found: np.ndarray, what: str, positive: bool, non_negative: bool) -> None:
    value = found.item()
    if not math.isfinite(value) or (positive and value <= 0) or (non_negative and value < 0):
        needed = "positive" if positive else "zero or positive" if non_negative else "finite"
        raise ParameterError(f"{what} is {value:g} ({origin()}). It must be {needed}.")
    _check_size(found, what)


@dataclass(frozen=True, eq=False)
class Condition:
    """`check` raises `ParameterError` for a numerical value that `value`, made of parameters, must not have."""

    value: Expression
    check: Callable[[np.ndarray], None]


def checked(value: Expression, check: Callable[[np.ndarray], None]) -> Expression:
    """The same expression; where only parameters are in it, `check` is asked now, and again for other values of the parameters."""
    current = evaluated(value)
    if current is not None:
        try:
            check(current)
        except ParameterError as error:
            names = ", ".join(sorted({f"ac.Parameter({leaf.value:g})" for leaf in value.leaves if isinstance(leaf, Parameter)}))
            hint = (
                f" A model is built with the parameters' own values: give {names} one that is allowed, and others to each call."
            )
            raise ParameterError(f"{error}{hint if names else ''}") from None
        condition = Condition(value, check)
        asked = asked_while_made() or [leaf.conditions for leaf in value.leaves if isinstance(leaf, Parameter)]
        for conditions in asked:
            conditions.append(condition)
    return value


def evaluated(expression: Expression) -> np.ndarray | None:
    """The value with every parameter at its present value; None if something else than parameters is in it."""
    parameters = [leaf for leaf in expression.leaves if isinstance(leaf, Parameter)]
    if len(parameters) < len(expression.leaves) or len(ca.symvar(expression.sx)) > len(parameters):
        return None
    function = ca.Function("value", [leaf.sx for leaf in parameters], [ca.densify(expression.sx)])
    return np.array(function.call([ca.DM(leaf.value) for leaf in parameters])[0])


def check_unit(value: Any, what: str, unit: str) -> None:
    """Of a parameter or input that stands alone, or as an entry of a list: what arithmetic makes of units is not known."""
    if isinstance(value, list | tuple):
        for entry in value:
            check_unit(entry, what, unit)
    elif isinstance(value, Parameter | Input) and certainly_different(value.unit, unit):
        raise ParameterError(
            f"{what} is given as an ac.{type(value).__name__} in {value.unit} ({origin()}), but it is a quantity in {unit}. Another one may be meant, or its unit is wrong."
        )


def vector(value: Scalar, what: str, *, unit: str = "") -> np.ndarray | Expression:
    """A checked 3-vector: a float array of shape (3,), or an expression of shape (3, 1). Raises `ParameterError`; units as in `scalar`.

    Without a unit it is a direction, which has no size.
    """
    check_unit(value, what, unit)
    check = _check_quantity if unit else _check_finite
    if isinstance(value, Expression | ca.SX) or (
        isinstance(value, list | tuple) and any(isinstance(v, Expression | ca.SX) for v in value)
    ):
        expression = Expression(sx(value), leaves(value))
        if expression.shape != (3, 1):
            raise ParameterError(f"{what} must have three components, not shape {expression.shape} ({origin()}).")
        if not expression.sx.is_constant():
            expression = _shown(expression, what)
            return checked(expression, functools.partial(check, what=what))
        value = _numbers(expression.sx).ravel()
    try:
        array = np.asarray("no numbers" if is_truth(value) else value, dtype=float)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise ParameterError(f"{what} must be three numbers, not {value!r} ({origin()}).") from None
    if array.shape == (3, 1):  # as CasADi's columns are
        array = array.ravel()
    if array.shape != (3,):
        raise ParameterError(f"{what} must be three numbers, not {value!r} ({origin()}).")
    check(array, what)
    return array


def _check_finite(array: np.ndarray, what: str) -> None:
    if not np.all(np.isfinite(array)):
        raise ParameterError(f"{what} is {array.ravel()} ({origin()}). Give finite numbers.")


def _check_quantity(array: np.ndarray, what: str) -> None:
    _check_finite(array, what)
    _check_size(array, what)


def _check_size(array: np.ndarray, what: str) -> None:
    if np.max(np.abs(array)) > _MOST:
        shown = f"{array.item():g}" if array.size == 1 else f"{array.ravel()}"
        raise ParameterError(
            f"{what} is {shown} ({origin()}), of which the square is no number any more. Choose other units, or leave the part out where it is to be rigid or without end."
        )


def of_time(value: Scalar | Callable[[Any], Any]) -> Scalar:
    """A function of time becomes an expression in `ac.time`, scipy's splines too; anything else stays.

    Raises `ParameterError` for a function that needs numbers.
    """
    if not callable(value) or isinstance(value, Expression):
        return value  # pyright: ignore[reportReturnType]
    if is_spline(value):
        found = of_spline(value, time.sx)
        return [Expression(entry, frozenset((time,))) for entry in found] if isinstance(found, list) else found
    try:
        return value(time)
    except Exception as error:  # whatever the user's function raises
        hint = (
            " A spline of scipy is given itself, not called: TorqueSource(CubicSpline(times, values))."
            if "array of numbers" in str(error)
            else ""
        )
        raise ParameterError(
            f"The function of time cannot be used ({origin()}): {str(error).rstrip('.')}. It is called once, with the symbol ac.time: write it with one "
            f"argument and with functions of numpy or CasADi, e.g. lambda t: 0.1 * np.sin(3 * t).{hint}"
        ) from error


def formula(value: ca.SX, what: str) -> ca.SX:
    """The same with CasADi's interpolants as formulas. Raises `ParameterError` where another function is called, and for nan whatever stands in it."""
    contents = Contents.of(value)
    if contents.nan and is_no_number(value):
        raise ParameterError(
            f"{what} gives nan, which is no number, whatever stands in it ({origin()}). Functions of the module math make nan of CasADi's symbols: use those "
            "of numpy or CasADi."
        )
    if not contents.calls:
        return value
    found = without_calls(value)
    if found is None:
        raise ParameterError(
            f"{what} calls a function of CasADi whose formula is hidden ({origin()}): it cannot be differentiated exactly nor be written as C. Interpolants "
            "and functions of SX can be called; or give a spline of scipy itself, e.g. CubicSpline(times, values), a Table, or an expression."
        )
    return found


def _shown(expression: Expression, what: str) -> Expression:
    """The same, itself where it calls nothing."""
    found = formula(expression.sx, what)
    return expression if found is expression.sx else Expression(found, expression.leaves)


def check_formula(value: ca.SX, what: str) -> None:
    """Raises `ParameterError` where `formula` does."""
    formula(value, what)


def stacked(values: Iterable[ca.SX]) -> ca.SX:
    """One column from many; an empty column (0, 1) from none."""
    entries = list(values)
    return ca.vertcat(*entries) if entries else ca.SX(0, 1)
