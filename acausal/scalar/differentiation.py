"""Time derivatives of residuals: the chain rule through the symbols of levels, known rates and time."""

from __future__ import annotations

import casadi as ca

from acausal.scalar.diagnosis import no_rate
from acausal.scalar.equations import EquationSet, ScalarEquation
from acausal.scalar.naming import Names


class Differentiation:
    """Differentiates expressions in symbols of levels and known symbols."""

    def __init__(self, system: EquationSet, names: Names) -> None:
        self._system = system
        self._names = names
        self._known = {symbol.element_hash(): rate for symbol, rate in system.known_rates}

    def of(self, residual: ca.SX, source: ScalarEquation) -> ca.SX:
        """d/dt of a scalar. Raises OverdeterminedError when an input is in it, or another symbol without a rate."""
        symbols = ca.symvar(residual)
        if not symbols:
            return ca.SX(0)
        rates: list[ca.SX] = []
        for symbol in symbols:
            key = symbol.element_hash()
            if key in self._names.levels:
                rates.append(self._names.rate(self._names.levels[key]))
            elif key in self._known:
                rates.append(self._known[key])
            else:
                raise no_rate(self._system, symbol, source)
        return ca.jtimes(residual, ca.vertcat(*symbols), ca.vertcat(*rates))
