"""Valves of circuits: what lets current flow one way only, without any loss."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, final

from acausal.language.equation import Equation, equal
from acausal.language.expression import Expression, Reaction, Scalar, scalar
from acausal.language.mode_laws import ModeLaw, OneWay
from components.electrical import AbstractTwoPin
from components.flanges import gate_of


class AbstractValve(AbstractTwoPin):
    """Conducts from pin_a to pin_b without any voltage, and blocks the other way. `current` [A] >= 0: what flows while it conducts."""

    current: Reaction

    def _leaks(self, leakage: Scalar) -> None:
        self.leakage = scalar(leakage, f"{type(self).__name__}'s leakage", non_negative=True, unit="A/V")
        self.current = Reaction("A", "what flows while it conducts")

    @property
    def gate(self) -> Expression | None:
        """What must be positive for it to begin to conduct; None where nothing must."""
        return None

    def law(self) -> Equation:
        return equal(self.i, self.current + self.leakage * self.v)

    def laws(self) -> Iterable[ModeLaw]:
        yield OneWay(self.current, -1.0 * self.v, self.gate)

    def dissipated_power(self) -> Expression:
        return self.v * self.i


@final
class IdealDiode(AbstractValve):
    """Conducts from pin_a to pin_b without any voltage, and blocks the other way: 0 <= current, v <= 0, one of them zero.

    i = current + leakage v. `leakage` [A/V] >= 0: conducts while it blocks; a circuit needs one in which something else decides the current, such as an
    inductor in series, or nothing the potential between several diodes that block.

        scene.rectifier = IdealDiode()
    """

    def __init__(self, leakage: Scalar = 0.0) -> None:
        self._leaks(leakage)


@final
class Thyristor(AbstractValve):
    """An ideal diode that begins to conduct only where its `gate` is positive, and goes on until its current has fallen to zero.

    `gate`: an input, a function of time, or an expression of the scene. `leakage` [A/V] as of an IdealDiode, in either direction while it blocks.

        scene.dimmer = Thyristor(gate=ac.Input("V"))
    """

    def __init__(self, gate: Scalar | Callable[[Any], Any], leakage: Scalar = 0.0) -> None:
        self._leaks(leakage)
        self.fires = gate_of(gate, "Thyristor's gate")

    @property
    def gate(self) -> Expression:
        return self.fires
