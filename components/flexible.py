"""Elastic bodies whose shapes come from finite elements."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import is_truth, scalar
from acausal.language.origin import origin
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.modal_inertia import ElasticBody, ShapeIntegrals
from acausal.visual import shapes as drawn


@final
class FlexibleBody(AbstractElasticBody):
    """An elastic body given by its shape integrals, `mass` [kg], modal `stiffness` and `damping` (n, n), symmetric and not negative.

    `integrals`: averages over the mass of places divided by `length` [m], and of shapes, see `ShapeIntegrals`; in frame_a, the floating
    frame of reference. `turning_inertia` (3, 3) [kg m^2]: further inertia that turns with frame_a. frame_b is at `tip` (3,) [m] plus
    `tip_shapes` (3, n) q, turned by the small angles `tip_turns` (3, n) q [rad]. Both matrices are zero by default.
    Units of q are those of displacement / shape. Shabana, Dynamics of Multibody Systems, chapter 5. Raises `ParameterError`.

        scene.arm = FlexibleBody.lumped(masses, places, shapes, stiffness, tip=places[-1], tip_shapes=shapes[-1])
    """

    def __init__(
        self,
        integrals: ShapeIntegrals,
        mass: float,
        stiffness: Any,
        *,
        length: float = 1.0,
        damping: Any = None,
        turning_inertia: Any = None,
        tip: Any = (0.0, 0.0, 0.0),
        tip_shapes: Any = None,
        tip_turns: Any = None,
    ) -> None:
        n = _checked_integrals(integrals)
        self.integrals = integrals
        self.mass = _positive(mass, "FlexibleBody's mass")
        self.length = _positive(length, "FlexibleBody's length")
        self.stiffness = _not_negative(stiffness, n, "FlexibleBody's stiffness")
        self.damping = _not_negative(np.zeros((n, n)) if damping is None else damping, n, "FlexibleBody's damping")
        self.turning_inertia = _not_negative(
            np.zeros((3, 3)) if turning_inertia is None else turning_inertia, 3, "FlexibleBody's turning_inertia"
        )
        self.tip = _array(tip, (3,), "FlexibleBody's tip")
        self.tip_shapes = _array(np.zeros((3, n)) if tip_shapes is None else tip_shapes, (3, n), "FlexibleBody's tip_shapes")
        self.tip_turns = _array(np.zeros((3, n)) if tip_turns is None else tip_turns, (3, n), "FlexibleBody's tip_turns")
        self._set_count(n)

    @classmethod
    def lumped(cls, masses: Any, places: Any, shapes: Any, stiffness: Any, **options: Any) -> Self:
        """From finite elements with lumped masses: `masses` (m,) [kg] at `places` (m, 3) [m] in frame_a, displaced by `shapes` (m, 3, n) q."""
        weights = _array(masses, _form(masses, "FlexibleBody's masses")[:1], "FlexibleBody's masses")
        m = weights.size
        if np.ndim(weights) != 1 or np.min(weights, initial=0.0) < 0 or np.sum(weights) <= 0:
            raise ParameterError(
                f"FlexibleBody's masses are {weights} ({origin()}). They must not be negative, and not all zero."
            )
        form = _form(shapes, "FlexibleBody's shapes")
        if len(form) != 3 or form[:2] != (m, 3):
            raise ParameterError(
                f"FlexibleBody's shapes have the shape {form} ({origin()}). For {m} masses it must be ({m}, 3, n)."
            )
        found = ShapeIntegrals.of_masses(
            weights, _array(places, (m, 3), "FlexibleBody's places"), _array(shapes, (m, 3, form[2]), "FlexibleBody's shapes")
        )
        return cls(found, float(np.sum(weights)), stiffness, **options)

    def shapes(self) -> tuple[Any, ...]:
        x, y, z = (float(entry) for entry in self.tip)
        return (drawn.Rod((0.0, 0.0, 0.0), (x, y, z)),) if np.any(self.tip) else ()

    def body(self) -> ElasticBody:
        return ElasticBody(
            self.integrals, self.mass, self.length, self.turning_inertia, self.stiffness, self.damping, self.tip, self.tip_shapes, self.tip_turns
        )  # fmt: skip


def _positive(value: Any, what: str) -> float:
    result = scalar(value, what, positive=True)
    if not isinstance(result, float):
        raise ParameterError(f"{what} is an expression ({origin()}). Give a number; a FlexibleBeam takes parameters.")
    return result


def _form(value: Any, what: str) -> tuple[int, ...]:
    try:
        return np.shape(value)
    except ValueError:
        raise ParameterError(f"{what} are rows of different lengths ({origin()}): {value!r}.") from None


def _array(value: Any, shape: tuple[int, ...], what: str) -> np.ndarray:
    try:
        array = np.asarray("no numbers" if is_truth(value) else value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"{what} must be numbers of shape {shape}, not {value!r} ({origin()}).") from None
    if array.shape != shape:
        raise ParameterError(f"{what} has the shape {array.shape} ({origin()}). It must be {shape}.")
    if not np.all(np.isfinite(array)):
        raise ParameterError(f"{what} has entries that are not finite ({origin()}): {array}.")
    return array


def _not_negative(value: Any, n: int, what: str) -> np.ndarray:
    matrix = _array(value, (n, n), what)
    size = float(np.max(np.abs(matrix), initial=0.0))
    if np.max(np.abs(matrix - matrix.T), initial=0.0) > 1e-9 * size:
        raise ParameterError(f"{what} is not symmetric ({origin()}): {matrix.tolist()}.")
    least = float(np.linalg.eigvalsh(matrix)[0])
    if least < -1e-9 * size:
        raise ParameterError(f"{what} has a negative eigenvalue {least:g} ({origin()}): {matrix.tolist()}.")
    return 0.5 * (matrix + matrix.T)


def _checked_integrals(integrals: Any) -> int:
    """The number of shapes. Raises `ParameterError` where no masses have such averages."""
    if not isinstance(integrals, ShapeIntegrals):
        raise ParameterError(
            f"FlexibleBody's integrals are {integrals!r} ({origin()}). Give ShapeIntegrals, or use FlexibleBody.lumped."
        )
    form = _form(integrals.first_shapes, "ShapeIntegrals' first_shapes")
    n = form[1] if len(form) == 2 else 0
    if not n:
        raise ParameterError(
            f"FlexibleBody's first_shapes have the shape {form} ({origin()}). It must be (3, n) with at least one shape."
        )
    for name, shape in (
        ("first", (3,)),
        ("first_shapes", (3, n)),
        ("second", (3, 3)),
        ("mixed", (3, 3, n)),
        ("second_shapes", (3, 3, n, n)),
    ):
        _array(getattr(integrals, name), shape, f"ShapeIntegrals' {name}")
    both = integrals.second_shapes
    if not np.allclose(both, both.transpose(1, 0, 3, 2), rtol=1e-9, atol=1e-12 * float(np.max(np.abs(both)))):
        raise ParameterError(f"ShapeIntegrals' second_shapes ({origin()}) must stay the same when a, i and b, j are exchanged.")
    masses = np.linalg.eigvalsh(integrals.modal_mass)
    if masses[0] <= 1e-12 * masses[-1]:
        raise ParameterError(
            f"FlexibleBody's {n} shapes are not independent ({origin()}): their mass matrix has the eigenvalues {masses}. Leave out shapes that "
            "are zero or sums of others."
        )
    levels = np.linalg.eigvalsh(integrals.mass_matrix())
    if levels[0] < -1e-9 * levels[-1]:
        raise ParameterError(
            f"FlexibleBody's integrals ({origin()}) belong to no masses: a motion would have negative kinetic energy (eigenvalue {levels[0]:g}). Check "
            "that all are divided by the same mass and length."
        )
    return n
