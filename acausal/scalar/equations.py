"""What goes into the scalar reduction: symbols and residuals with names and origins, nothing of components."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from acausal.errors import ModelError


@dataclass(frozen=True)
class Unknown:
    """A scalar to be determined as a function of time; `hint` helps the person who forgot an equation for it. `shared`: at a connector."""

    symbol: ca.SX
    name: str
    unit: str = ""
    origin: str = ""
    start: float | None = None
    hint: str = ""
    shared: bool = False

    def __str__(self) -> str:
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{self.name}{unit}" + (f" ({self.origin})" if self.origin else "")


@dataclass(frozen=True)
class ScalarEquation:
    """`residual` = 0, one row."""

    residual: ca.SX
    label: str
    origin: str = ""

    def __str__(self) -> str:
        return f"'{self.label}'" + (f" ({self.origin})" if self.origin else "")


@dataclass(frozen=True)
class EquationSet:
    """Equations, unknowns, and what is known about time derivatives.

    `derivatives` pairs a symbol with the unknown it is the time derivative of; derivatives of derivatives by chaining. A
    derivative symbol may, but need not, be listed in `unknowns`.
    `known` are time, parameters, inputs and opaque coefficients. `known_rates` gives their time derivatives where there is
    one: time 1, a parameter 0 (rate zero is what makes it a constant, so a pivot). `values`: present values of parameters; `limits` (k, n): others
    that are allowed, one parameter at its limits at a time. `names` of known symbols, where they are not the symbols' own.
    `outer`: coordinates of an outer block, which keeps them and their derivatives but for the highest as its states; the highest
    counts as an unknown, and the outer block's equations for them stand last among `equations`.
    `rate_symbol` makes the symbol for the derivative of an unknown where a further one is needed.
    """

    equations: tuple[ScalarEquation, ...]
    unknowns: tuple[Unknown, ...]
    derivatives: tuple[tuple[ca.SX, ca.SX], ...] = ()
    known: tuple[ca.SX, ...] = ()
    known_rates: tuple[tuple[ca.SX, ca.SX], ...] = ()
    values: tuple[tuple[ca.SX, float], ...] = ()
    limits: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    names: tuple[tuple[ca.SX, str], ...] = ()
    outer: tuple[Unknown, ...] = ()
    rate_symbol: Callable[[ca.SX], ca.SX] | None = None

    def __str__(self) -> str:
        lines = [f"{self.totals} {len(self.derivatives)} derivatives."]
        lines += [f"  0 = {equation.residual}    {equation}" for equation in self.equations]
        lines += [f"  {unknown}" for unknown in self.unknowns]
        return "\n".join(lines)

    @property
    def count(self) -> int:
        """Number of unknowns, not counting derivatives of unknowns."""
        rates = {rate.element_hash() for rate, _ in self.derivatives}
        return len(self.outer) + sum(unknown.symbol.element_hash() not in rates for unknown in self.unknowns)

    def name(self, symbol: ca.SX) -> str:
        """Name of a known symbol."""
        found = {s.element_hash(): name for s, name in self.names}
        return found.get(symbol.element_hash(), symbol.name())

    @property
    def of_outer(self) -> tuple[ScalarEquation, ...]:
        """The outer block's equations for the highest derivatives of its coordinates."""
        return self.equations[len(self.equations) - len(self.outer) :]

    @property
    def totals(self) -> str:
        """Both numbers, for messages; the outer block's equations and unknowns are left out."""
        return f"{len(self.equations) - len(self.outer)} equations, {self.count - len(self.outer)} unknowns."


def check(system: EquationSet) -> None:
    """Raises ModelError for a symbol declared twice, a residual that is not one row, or a symbol that nobody declared."""
    declared: dict[int, str] = {}
    for unknown in (*system.unknowns, *system.outer):
        key = unknown.symbol.element_hash()
        if key in declared:
            raise ModelError(
                f"{unknown} is listed twice as an unknown, first as {declared[key]}. Give each variable its own symbol."
            )
        declared[key] = unknown.name
    for symbol in system.known:
        if symbol.element_hash() in declared:
            raise ModelError(f"{declared[symbol.element_hash()]} is an unknown and known at once; list it only once.")
    declared |= {s.element_hash(): str(s) for s in (*system.known, *(rate for rate, _ in system.derivatives))}
    for equation in system.equations:
        if equation.residual.numel() != 1:
            raise ModelError(f"Equation {equation} has {equation.residual.numel()} rows; give one scalar equation each.")
    if not declared.keys() >= symbols_in(equation.residual for equation in system.equations).keys():
        for equation in system.equations:
            _all_declared(ca.symvar(equation.residual), declared, f"Equation {equation}")


def symbols_in(expressions: Iterable[ca.SX]) -> dict[int, ca.SX]:
    """Symbols by their hashes, looked for in all expressions at once: for each by itself that takes much longer."""
    return {s.element_hash(): s for s in ca.symvar(ca.veccat(ca.SX(0, 1), *expressions))}


def _all_declared(symbols: Iterable[ca.SX], declared: dict[int, str], where: str) -> None:
    for symbol in symbols:
        if symbol.element_hash() not in declared:
            raise ModelError(f"{where} contains '{symbol}', which is neither unknown nor known. Is its part in the scene?")
