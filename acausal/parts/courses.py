"""Inputs whose values and rates are coordinates: how a joint that moves as inputs say has the derivatives that its motion takes."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from acausal.language.equation import input_rates
from acausal.language.expression import Expression, Input


@dataclass(frozen=True)
class Courses:
    """The `inputs` that expressions contain. Coordinates: all values, and where `rates` is 2 all first rates behind them; then their rates are known."""

    inputs: tuple[Input, ...]
    rates: int

    @classmethod
    def of(cls, *given: object, rates: int) -> Courses:
        """Those in the expressions that are `given`."""
        found = {leaf for value in given if isinstance(value, Expression) for leaf in value.leaves if isinstance(leaf, Input)}
        return cls(tuple(sorted(found, key=lambda entry: str(entry.sx))), rates)

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.rates * len(self.inputs)

    @property
    def symbols(self) -> ca.SX:
        """What the coordinates follow (n, 1)."""
        return self._all[: self.size]

    @property
    def changes(self) -> ca.SX:
        """Rates of the coordinates (n, 1)."""
        return self._all[len(self.inputs) :]

    def put(self, value: ca.SX, q: ca.SX) -> ca.SX:
        """The expression by coordinates q (n, 1)."""
        return ca.substitute(value, self.symbols, q) if self.size else value

    @property
    def _all(self) -> ca.SX:
        chains = [(entry, *input_rates(entry))[: self.rates + 1] for entry in self.inputs]
        return ca.vertcat(ca.SX(0, 1), *(symbol.sx for order in zip(*chains, strict=True) for symbol in order))
