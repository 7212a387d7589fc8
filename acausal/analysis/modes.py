"""Modes of a linear system x' = A x: eigenvalues with their accuracy, frequencies, damping ratios, shapes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np

_MARGIN = 100.0
_LARGEST = 1e-4
_SAME = 1e-9
_LARGE = 0.25
"""Part of the largest amplitude from which on one is large: sizes are powers of two."""
_SEEN, _SHOWN = 1e-6, 6


@dataclass(frozen=True)
class Mode:
    """exp(eigenvalue t) shape; a conjugate pair is one mode, with a positive imaginary part.

    `shape` (n,): amplitudes of `states`, complex where they are out of phase, scaled so that the first large one is 1. `parts` (n,): their
    magnitudes beside what is much for each state, the largest 1. `accuracy`: how far rounding may have moved the eigenvalue; parts
    below it are zero.
    """

    eigenvalue: complex
    shape: np.ndarray
    parts: np.ndarray
    states: tuple[str, ...]
    accuracy: float

    @property
    def angular_frequency(self) -> float:
        """Of the undamped oscillation, |eigenvalue| [rad/s]."""
        return abs(self.eigenvalue)

    @property
    def frequency(self) -> float:
        """Of the oscillation as it is seen [Hz]; 0 where there is none."""
        return abs(self.eigenvalue.imag) / (2 * np.pi)

    @property
    def damping_ratio(self) -> float:
        """-Re / |eigenvalue|: 0 undamped, 1 from critical damping on, negative where it grows; NaN for eigenvalue zero."""
        size = abs(self.eigenvalue)
        return 0.0 - self.eigenvalue.real / size if size else float("nan")

    def __getitem__(self, state: str) -> complex:
        """Amplitude of one state, by its name."""
        return complex(self.shape[self.states.index(state)])

    def __str__(self) -> str:
        largest = [int(i) for i in np.argsort(-self.parts, kind="stable")[:_SHOWN] if self.parts[i] > _SEEN]
        shape = ", ".join(f"{self.states[i]} {_number(self.shape[i])}" for i in largest)
        damping = f"{self.damping_ratio:>9.4f}" if self.eigenvalue else f"{'-':>9}"
        return f"  {_number(self.eigenvalue):<26} {self.angular_frequency:>12.6g} {self.frequency:>12.6g} {damping}   {shape}"


@dataclass(frozen=True)
class Modes:
    """All modes, slowest first; prints as a table."""

    modes: tuple[Mode, ...]

    def __iter__(self) -> Iterator[Mode]:
        return iter(self.modes)

    def __len__(self) -> int:
        return len(self.modes)

    def __getitem__(self, index: int) -> Mode:
        return self.modes[index]

    def __str__(self) -> str:
        head = f"  {'eigenvalue [1/s]':<26} {'size [rad/s]':>12} {'seen [Hz]':>12} {'damping':>9}   shape"
        return "\n".join([head, *map(str, self.modes)])


def modes_of(A: np.ndarray, states: tuple[str, ...], sizes: np.ndarray) -> Modes:
    """By LAPACK's eigenvalues of the balanced matrix, for states measured by their `sizes` (n,); of parts that do not touch one another each
    alone.

    The accuracy of an eigenvalue is the rounding of the matrix over the product of its left and right vector (Golub and Van Loan,
    *Matrix Computations*, 7.2.2): multiple eigenvalues that lack a vector, such as the two zeros of a free motion, are known to half the
    digits only.
    """
    from scipy.sparse.csgraph import connected_components

    if not A.size:
        return Modes(())
    A = A * sizes / sizes[:, None]
    # what is far below rounding couples nothing
    A = np.where(np.abs(A) < np.finfo(float).eps ** 2 * np.max(np.abs(A)), 0.0, A)
    count, part = connected_components(A != 0, directed=False)
    found: list[Mode] = []
    for k in range(count):
        own = np.flatnonzero(part == k)
        found += _modes(A[np.ix_(own, own)], own, states, sizes)
    return Modes(tuple(_slowest_first(found)))


def _slowest_first(modes: list[Mode]) -> list[Mode]:
    """By size; those of the same size, to rounding, from the fastest decaying to the fastest growing."""
    found: list[Mode] = []
    level: list[Mode] = []
    for mode in sorted(modes, key=lambda m: abs(m.eigenvalue)):
        if level and abs(mode.eigenvalue) > (1 + _SAME) * abs(level[0].eigenvalue):
            found, level = found + sorted(level, key=lambda m: m.eigenvalue.real), []
        level.append(mode)
    return found + sorted(level, key=lambda m: m.eigenvalue.real)


def _modes(A: np.ndarray, own: np.ndarray, states: tuple[str, ...], sizes: np.ndarray) -> list[Mode]:
    """Of one part, the states `own`."""
    import scipy.linalg

    with np.errstate(invalid="ignore"):  # scipy makes integers of what it has not set, too
        balanced, back = cast(tuple[np.ndarray, np.ndarray], scipy.linalg.matrix_balance(A))
    values, left, right = cast(tuple[np.ndarray, np.ndarray, np.ndarray], scipy.linalg.eig(balanced, left=True, right=True))
    size = float(np.linalg.norm(balanced))
    overlap = np.abs(np.sum(left.conj() * right, axis=0))
    accuracy = np.minimum(_MARGIN * np.finfo(float).eps * size / np.maximum(overlap, np.finfo(float).tiny), _LARGEST * size)
    found: list[Mode] = []
    for value, vector, error in zip(values, right.T, accuracy, strict=True):
        real = value.real if abs(value.real) > error else 0.0
        imaginary = value.imag if abs(value.imag) > error else 0.0
        if imaginary < 0:
            continue
        shape = np.zeros(sizes.size, dtype=vector.dtype)
        shape[own] = back @ vector
        parts = np.abs(shape) / np.max(np.abs(shape))
        shape = sizes * shape
        first = int(np.argmax(parts >= _LARGE))
        shape = shape / shape[first]
        shape[first] = 1.0
        found.append(Mode(complex(real, imaginary), shape, parts, states, float(error)))
    return found


def _number(value: complex) -> str:
    """Without the parts that are zero."""
    size = abs(value)
    real = value.real if abs(value.real) > 1e-9 * size else 0.0
    imaginary = value.imag if abs(value.imag) > 1e-9 * size else 0.0
    return f"{real:.6g}" if not imaginary else f"{imaginary:.6g}j" if not real else f"{real:.6g}{imaginary:+.6g}j"
