"""Start values: exactly, or as near as can be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acausal.errors import ParameterError, StartValueError
from acausal.language.connector import Quantity
from acausal.language.expression import Derivative, Expression, Input, Parameter, Symbol, Time
from acausal.parts.rotations import Rotation, rotation_matrix
from acausal.start.unknowns import Target

_UNEVEN = 1e-6
"""By which products of columns of a matrix are off that is no rotation, however it was rounded."""

Value = float | Sequence[float] | np.ndarray | Rotation


@dataclass(frozen=True)
class exactly:
    """A start value that must be met; a plain number means the same."""

    value: Value


@dataclass(frozen=True)
class near:
    """A start value that is met as well as the constraints and the exact values allow; also an entry of a vector's: (1.0, ac.near(0.0), 0.3).

    Where several cannot all be met, the sum of the squares of the differences, each times its `weight` > 0, is least nearby.
    """

    value: Value
    weight: float = 1.0


Start = Mapping[Expression, Value | exactly | near]


def start_mapping(value: Any) -> Start:
    """Start values. Raises `StartValueError` for what is no dictionary."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise StartValueError(f"start is {value!r}. Give a dictionary of variables and values, start={{scene.hinge.q: 0.3}}.")
    return value


def entry_by_entry(start: Start) -> Start:
    """The same with each entry by itself where some of a vector are near values: (1.0, ac.near(0.0), 0.3)."""
    found: dict[Expression, Any] = {}
    for key, value in start.items():
        entries: Sequence[Any] = value if isinstance(value, list | tuple) else ()
        if not any(isinstance(entry, exactly | near) for entry in entries):
            found[key] = value
        elif key.shape != (len(entries), 1):
            raise StartValueError(f"start value of {key!r}: {len(entries)} values are given for the shape {key.shape}.")
        else:
            found |= {key[k]: entry for k, entry in enumerate(entries)}
    return found


def softened(start: Start) -> dict[Expression, Value | exactly | near]:
    """Plain values as near ones; those that say how they are meant stay."""
    return {key: value if isinstance(value, exactly | near) else near(value) for key, value in start.items()}


def start_numbers(target: Target, value: Value | exactly | near) -> np.ndarray:
    """The value (size,), column by column; of nine, a rotation in any of the ways in which these are given. Raises `StartValueError` for another
    size and for what is no finite number.
    """
    number: Any = value.value if isinstance(value, exactly | near) else value
    if target.size == 9 and (hasattr(number, "as_matrix") or (isinstance(number, tuple) and len(number) in (2, 4))):
        try:
            number = rotation_matrix(number)
        except ParameterError as error:
            raise StartValueError(f"start value of {target.name}: {error}") from None
    try:
        raw = np.asarray(number)
        wanted = raw.astype(float).ravel(order="F") if raw.dtype.kind in "biuf" else None
    except (TypeError, ValueError, OverflowError):  # rows of different lengths
        wanted = None
    if wanted is None:
        raise StartValueError(f"start value of {target.name} is {number!r}, not a number.")
    if wanted.size != target.size:
        raise StartValueError(
            f"start value of {target.name} needs {target.size} numbers, not {'one' if wanted.size == 1 else wanted.size}."
        )
    if not np.isfinite(wanted).all():
        raise StartValueError(f"start value of {target.name} is {wanted}. Give finite numbers.")
    if target.size == 9 and target.exact and target.name.endswith(".rotation"):
        _check_rotation(target, wanted.reshape(3, 3).T)
    return wanted


def _check_rotation(target: Target, matrix: np.ndarray) -> None:
    """Raises `StartValueError` for a matrix that no body can be turned by."""
    off = float(np.max(np.abs(matrix.T @ matrix - np.eye(3))))
    if off > _UNEVEN:
        raise StartValueError(
            f"start value of {target.name} is no rotation: its columns are not of length 1 and at right angles (off by {off:.3g}). Give a rotation, e.g. "
            '("z", 0.3) or scipy\'s Rotation, or soften it with ac.near(...).'
        )
    if np.linalg.det(matrix) < 0:
        raise StartValueError(
            f"start value of {target.name} is a matrix that mirrors: its determinant is -1, and no body can be turned so. Let one of its columns, the axes, point "
            "the other way."
        )


def start_weight(target: Target, weight: object) -> float:
    """The weight of a near value, a float. Raises `StartValueError` unless it is finite and positive."""
    try:
        number = float(weight)  # pyright: ignore[reportArgumentType]  # users pass anything
    except (TypeError, ValueError, OverflowError):
        number = float("nan")
    if not 0 < number < np.inf:
        raise StartValueError(
            f"start value of {target.name}: the weight is {weight!r}. Give a finite positive number, 1 for no preference."
        )
    return number


def check_settable(leaf: Symbol) -> None:
    """Raises `StartValueError` for a variable that no state determines: parameters, inputs, time, forces and accelerations."""
    if isinstance(leaf, Parameter):
        raise StartValueError(f"{leaf.name} is a parameter, not a state: give it by parameters={{...}}.")
    if isinstance(leaf, Input):
        raise StartValueError(f"{leaf.name} is an input, not a state: give it by inputs={{...}}.")
    if isinstance(leaf, Time):
        raise StartValueError("time cannot have a start value; give t0.")
    if isinstance(leaf, Derivative) or (
        isinstance(leaf, Quantity) and leaf.name in ("force", "torque", "acceleration", "angular_acceleration", "specific_force")
    ):
        raise StartValueError(f"{leaf.name} follows from the equations of motion and is not free: it cannot have a start value.")
