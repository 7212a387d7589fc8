"""Linear systems for small deviations from a state or a motion, with all constraints respected and exact derivatives."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.analysis.deviations import Deviations, Tangent, deviations_at
from acausal.analysis.mode_at import mode_words
from acausal.analysis.modes import Mode, Modes, modes_of
from acausal.analysis.point import Differentiable, OperatingPoint
from acausal.analysis.state_sizes import ROUNDING, UNCHANGED, before_and_after, power_of_two
from acausal.arguments import expressions
from acausal.errors import OptionError, StartValueError
from acausal.language.expression import Expression
from acausal.numerics.one_thread import on_one_thread
from acausal.outputs.expression_names import labels
from acausal.outputs.functions import Functions
from acausal.outputs.infinite import without_value
from acausal.wording import compact

_LED = "linearize: a state must not depend on an input. Choose variables that keep their value when an input jumps."
_CLOSED = 1e-8
_STEADY = 1e-9
_STILL = 1e-12
_RANK = 1e-13
_MOST_RATES = 4


@dataclass(frozen=True, repr=False)
class Linearization:
    """dy' = A dy + B du, outputs C dy + D du, for small deviations dy of `states` (k) and du of `inputs` from `point`.

    `expand` (nx, k): the change of all states, dx = expand dy. `rates` (k,): of the states at the point itself, `sizes` (k,): what is much for each. `steady`: they vanish,
    so that the point is an equilibrium or a steady motion. `constant`: A stays the same along the motion through the point, so that its
    eigenvalues say what deviations from this motion do; otherwise they belong to the system frozen at this instant.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    expand: np.ndarray
    rates: np.ndarray
    sizes: np.ndarray
    point: OperatingPoint
    steady: bool
    constant: bool
    scene: str
    mode: str = ""

    @property
    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(A, B, C, D), as python-control's `ss(*result.matrices)` and scipy take them."""
        return self.A, self.B, self.C, self.D

    def to_scipy(self) -> Any:
        """As `scipy.signal.StateSpace`. Raises `OptionError` without inputs, which scipy asks for."""
        import scipy.signal

        if not self.inputs:
            raise OptionError(f"to_scipy: the scene '{self.scene}' has no ac.Input, and scipy needs one. Use .A and .C.")
        return scipy.signal.StateSpace(*self.matrices)

    @functools.cached_property
    def eigenvalues(self) -> np.ndarray:
        """Of A, (k,) complex [1/s], by size."""
        both = [[m.eigenvalue] if not m.eigenvalue.imag else [m.eigenvalue, m.eigenvalue.conjugate()] for m in self.modes()]
        return np.array([value for pair in both for value in pair], dtype=complex)

    @property
    def oscillations(self) -> tuple[Mode, ...]:
        """The modes that oscillate, slowest first."""
        return tuple(m for m in self.modes() if m.eigenvalue.imag)

    @property
    def frequencies(self) -> np.ndarray:
        """Of the oscillations [Hz], slowest first; rad/s and damping ratios are in `modes()`."""
        return np.array([m.frequency for m in self.oscillations])

    def modes(self) -> Modes:
        """Eigenvalues with frequencies, damping ratios and shapes; prints as a table."""
        return self._modes

    @functools.cached_property
    def _modes(self) -> Modes:
        return modes_of(self.A, self.states, self.sizes)

    @property
    def stability(self) -> str:
        """ "asymptotically stable", "unstable", or "neutral": some eigenvalue has no real part, and first order does not decide. "undecided"
        where the linear system changes along the motion: eigenvalues at one instant say nothing about it.
        """
        if not self.constant:
            return "undecided"
        real = [m.eigenvalue.real for m in self.modes()]
        if any(r > 0 for r in real):
            return "unstable"
        return "asymptotically stable" if all(r < 0 for r in real) else "neutral"

    def __repr__(self) -> str:
        return (
            f"<Linearization of {self.scene}: {len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs>"
        )

    def __str__(self) -> str:
        head = f"{self.scene}, linear in {', '.join(self.states) or 'no state'}"
        if self.inputs:
            head += f"; inputs {', '.join(self.inputs)}"
        if self.mode:
            head += f"; as long as this mode lasts: {self.mode}"
        return "\n".join([head, f"{self._about()}; {self.stability}", str(self.modes())])

    def _about(self) -> str:
        if self.steady:
            return "steady: the states stay as they are" + ("" if self.constant else ", but the system changes with time")
        moving = [f"{n}' = {r:.4g}" for n, r in zip(self.states, self.rates, strict=True) if r][:4]
        if self.constant:
            return f"a motion ({', '.join(moving)}) along which the linear system stays the same"
        return f"not an equilibrium ({', '.join(moving)}): eigenvalues are those of the system frozen at this instant"


@on_one_thread
def linearize(
    functions: Functions,
    whole: Functions,
    point: OperatingPoint,
    states: Sequence[Expression] | None,
    outputs: Sequence[Expression],
) -> Linearization:
    """Of `functions`, at a point of all coordinates of the tree; see `Model.linearize`. Raises `OptionError`, `UnknownVariableError`."""
    own = functions.space.coordinates
    usual = None if own is None else Column(own.column, own.names)
    chosen = usual if states is None else column_of(whole, "states", states)
    return _linearization(whole, point, chosen, column_of(whole, "outputs", outputs))


def linearize_invariants(functions: Functions, point: OperatingPoint, steady: ca.SX) -> Linearization | None:
    """The linear system of quantities `steady` (n, 1) that a motion through the point keeps, and of as many of their time derivatives as it
    needs; None where four are not enough. What is left out may do anything.
    """
    deviations = deviations_at(functions, point)
    kept, rows, last = ca.SX(0, 1), np.zeros((0, len(deviations.free))), steady
    expand = deviations.tangent(point, deviations.x_dot.value(point)).expand * deviations.free_sizes
    for _ in range(_MOST_RATES):
        slopes = Differentiable(deviations.system, last).along(point, expand)
        fresh: list[int] = []
        for i, row in enumerate(slopes):
            more = np.vstack([rows, row / (np.max(np.abs(row)) or 1.0)])
            if np.linalg.matrix_rank(more, tol=_CLOSED) > len(rows):
                rows, fresh = more, [*fresh, i]
        if not fresh:
            break
        kept, last = ca.vertcat(kept, last[fresh]), functions.outputs.rate(last[fresh])
    try:
        names = tuple(f"steady[{i}]" for i in range(kept.numel()))
        return _linearization(functions, point, Column(kept, names), Column.none()) if names else None
    except OptionError:
        return None


def linear_around(functions: Functions, at: OperatingPoint, outputs: Sequence[Expression]) -> Linear:
    """The linear system of deviations from a motion through a point, at any point of it near that one; deviations are in axes that go along with it."""
    wanted = column_of(functions, "outputs", outputs)
    deviations = deviations_at(functions, at)
    return Linear(deviations, Wanted(functions, Column.none(), wanted, False), deviations.names, wanted.names)


@dataclass(frozen=True)
class Column:
    """Expressions (n, 1) with a name for each."""

    values: ca.SX
    names: tuple[str, ...]

    @staticmethod
    def none() -> Column:
        """Nothing."""
        return Column(ca.SX(0, 1), ())


def column_of(functions: Functions, what: str, wanted: Sequence[Expression]) -> Column:
    entries = expressions(wanted, f"linearize: `{what}`", f"{what}=[scene.hinge.q, scene.hinge.v]")
    values = ca.vertcat(ca.SX(0, 1), *(ca.vec(functions.outputs.resolve(e)) for e in entries))
    return Column(values, tuple(name for e in entries for name in labels(functions.outputs, e)))


def _linearization(functions: Functions, point: OperatingPoint, states: Column | None, outputs: Column) -> Linearization:
    s = functions.outputs.system
    x_dot = Differentiable(s, s.x_dot)
    _check_numbers(functions, x_dot, point)
    deviations = deviations_at(functions, point, x_dot)
    wanted = Wanted(functions, Column.none() if states is None else states, outputs, states is not None)
    chosen = deviations.names if states is None else states.names
    linear = Linear(deviations, wanted, chosen, outputs.names)
    found = linear.at(point, check=True)
    noise = ROUNDING * linear.rounding(point)
    still = np.abs(found.rates) <= _STEADY * np.abs(found.A) @ found.sizes + noise
    own = len(s.flat.inputs) - len(s.flat.modes)  # nobody gives masks
    inputs = tuple(functions.outputs.name(entry) for entry in s.flat.inputs[:own])
    return Linearization(
        chosen, inputs, outputs.names or chosen, found.A, found.B[:, :own], found.C, found.D[:, :own], found.expand, np.where(still, 0.0, found.rates),
        found.sizes, point, bool(np.all(still)), linear.is_constant(point, found, noise), s.flat.name,
        mode_words(s, point.u),
    )  # fmt: skip


def _check_numbers(functions: Functions, x_dot: Differentiable, at: OperatingPoint) -> None:
    """Raises `StartValueError` where rates, or their derivatives by states, are infinite or not numbers."""
    names = functions.state_names
    lost = np.flatnonzero(~np.isfinite(x_dot.value(at)))
    if lost.size:
        words = without_value(functions, at.t, at.x, at.u, at.p) or "Begin elsewhere: start={...}, or states of a motion."
        raise StartValueError(
            f"linearize: the rate of {compact(names[k] for k in lost)} is infinite or not a number here. {words}"
        )
    rows, columns = np.nonzero(~np.isfinite(x_dot.along(at, np.eye(at.x.size))))
    if rows.size:
        raise StartValueError(
            f"linearize: the rate of {names[rows[0]]} has no derivative by {names[columns[0]]} here: a law has a corner or a root there. "
            "Begin elsewhere, or give a law that is smooth there."
        )


class Wanted:
    """What was asked for, as columns: states h and their rates, outputs."""

    def __init__(self, functions: Functions, states: Column, outputs: Column, given: bool) -> None:
        s = functions.outputs.system
        column = states.values
        if given and not column.numel():
            raise OptionError("linearize: `states` is empty. Leave it out, or name expressions such as scene.hinge.q.")
        if ca.depends_on(column, s.u):
            raise OptionError(_LED)
        self.given = given
        self.states = Differentiable(s, column)
        self.rates = Differentiable(s, functions.outputs.rate(column))
        self.outputs = Differentiable(s, outputs.values) if outputs.names else None


@dataclass(frozen=True)
class Matrices:
    """Of deviations at one point, see `Linearization`."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    expand: np.ndarray
    sizes: np.ndarray
    rates: np.ndarray


class Linear:
    """The matrices at any point, in the same deviations."""

    def __init__(self, deviations: Deviations, wanted: Wanted, chosen: tuple[str, ...], output_names: tuple[str, ...]) -> None:
        self._deviations, self._wanted, self._chosen, self._output_names = deviations, wanted, chosen, output_names
        self._x_dot = deviations.x_dot
        self._sizes = deviations.free_sizes

    def at(self, at: OperatingPoint, *, check: bool = False) -> Matrices:
        """Raises `OptionError` where a `check` finds states that do not tell all."""
        x_dot = self._x_dot.value(at)
        tangent = self._deviations.tangent(at, x_dot)
        by_input = np.eye(at.u.size)
        if not self._wanted.given:
            # deviations are seen in axes that go along with the motion, hence the rate of `pick`
            A = tangent.pick @ self._x_dot.along(at, tangent.expand) + tangent.pick_rate @ tangent.expand
            B = tangent.pick @ self._x_dot.along(at, tangent.led, du=by_input)
            expand, sizes, rates = tangent.expand, self._sizes, tangent.pick @ x_dot
        else:
            A, B, expand, sizes = self._chosen_states(at, tangent, by_input, check)
            rates = self._wanted.rates.value(at)
        if self._wanted.outputs is None:
            return Matrices(A, B, np.eye(len(A)), np.zeros_like(B), expand, sizes, rates)
        C_all = self._wanted.outputs.along(at, tangent.expand)
        D = self._wanted.outputs.along(at, tangent.led, du=by_input)
        if check:
            H = self._wanted.states.along(at, tangent.expand) if self._wanted.given else np.eye(len(A))
            noise = self._wanted.outputs.rounding(at, self._deviations.sizes.x)
            self._check_closed(C_all * self._sizes, H * self._sizes, noise, self._output_names, "the output {0} also depends")
        return Matrices(A, B, self._wanted.outputs.along(at, expand), D, expand, sizes, rates)

    def _chosen_states(
        self, at: OperatingPoint, tangent: Tangent, by_input: np.ndarray, check: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A, B, dx/dy and sizes for states h(x): with dh = H dy and dh' = R dy, A = R H^+ where R vanishes along H dy = 0."""
        H = self._wanted.states.along(at, tangent.expand) * self._sizes
        R = self._wanted.rates.along(at, tangent.expand) * self._sizes
        if check:
            if np.any(self._wanted.states.along(at, tangent.led)):
                raise OptionError(_LED)
            self._check_independent(H, self._wanted.states.rounding(at, self._deviations.sizes.x) / np.finfo(float).eps)
            noise = self._wanted.rates.rounding(at, self._deviations.sizes.x)
            self._check_closed(R, H, noise, self._chosen, "the rate of {0} also depends")
        size = power_of_two(np.max(np.abs(H), axis=1, initial=0.0))
        inverse = np.linalg.pinv(H / size[:, None], rcond=_RANK) / size
        expand = tangent.expand @ (self._sizes[:, None] * inverse)
        return R @ inverse, self._wanted.rates.along(at, tangent.led, du=by_input), expand, size

    def _check_independent(self, H: np.ndarray, terms: np.ndarray) -> None:
        """`terms` (k,): what the values of the states are made of."""
        size = np.linalg.norm(H, axis=1)
        still = [n for n, length, own in zip(self._chosen, size, terms, strict=True) if length <= _STILL * own]
        if still:
            raise OptionError(f"linearize: {', '.join(still)} cannot change in first order here, so it cannot be a state.")
        U, values, _ = np.linalg.svd(H / size[:, None])
        if len(H) > H.shape[1] or values[-1] < 1e-9:
            together = [n for n, part in zip(self._chosen, U[:, -1], strict=True) if abs(part) > 1e-6]
            raise OptionError(
                f"linearize: the states {', '.join(together)} depend on one another here. There are {H.shape[1]} independent ones, "
                f"for example {', '.join(self._deviations.names[:12])}."
            )

    def _check_closed(self, R: np.ndarray, H: np.ndarray, noise: np.ndarray, names: tuple[str, ...], what: str) -> None:
        """Rows of R must vanish along all changes that leave the chosen states alone; both for changes by the sizes of the entries."""
        H = H / np.max(np.abs(H), axis=1, keepdims=True)
        rest = R - R @ np.linalg.pinv(H, rcond=_RANK) @ H
        worst = np.max(np.abs(rest), axis=1, initial=0.0)
        allowed = _CLOSED * np.max(np.abs(R), axis=1, initial=0.0) + ROUNDING * noise
        if np.all(worst <= allowed):
            return
        i = int(np.argmax(worst / np.where(allowed > 0, allowed, 1.0)))
        on = [self._deviations.names[k] for k in np.argsort(-np.abs(rest[i])) if abs(rest[i, k]) > 0.1 * worst[i]][:4]
        raise OptionError(
            f"linearize: {what.format(names[i])} on {', '.join(on)} (by {worst[i]:.3g}), which the {len(H)} chosen states leave open. "
            f"Add such a quantity to `states`, or leave `states` out to keep all {H.shape[1]}."
        )

    def rounding(self, at: OperatingPoint) -> np.ndarray:
        """Of the rates of the states (k,)."""
        sizes = self._deviations.sizes.x
        if self._wanted.given:
            return self._wanted.rates.rounding(at, sizes)
        pick = self._deviations.tangent(at, self._x_dot.value(at)).pick
        return np.abs(pick) @ self._x_dot.rounding(at, sizes)

    def is_constant(self, at: OperatingPoint, found: Matrices, noise: np.ndarray) -> bool:
        """Whether A is the same a little before and after, on the motion through the point, in first and second order."""
        pace, beside = before_and_after(self._x_dot, at, self._deviations.sizes)
        whole = np.max(np.abs(found.A) * found.sizes, axis=1, initial=0.0) + pace * found.sizes
        allowed = (UNCHANGED * whole + noise)[:, None]
        return all(bool(np.all(np.abs(self.at(m).A - found.A) * found.sizes <= allowed)) for m in beside)
