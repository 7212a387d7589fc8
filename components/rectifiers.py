"""Valves of circuits: what lets current flow one way only, without any loss."""

from __future__ import annotations

from collections.abc import Iterable
from typing import final

from acausal.language.equation import Equation, equal
from acausal.language.expression import Expression, Reaction, Scalar, scalar
from acausal.language.mode_laws import ModeLaw, OneWay
from components.electrical import AbstractTwoPin


@final
class IdealDiode(AbstractTwoPin):
    """Conducts from pin_a to pin_b without any voltage, and blocks the other way: 0 <= current, v <= 0, one of them zero.

    i = current + leakage v. `leakage` [A/V] >= 0: conducts while it blocks; a circuit needs one in which something else decides the current, such as an
    inductor in series, or nothing the potential between several diodes that block.

        scene.rectifier = IdealDiode()
    """

    def __init__(self, leakage: Scalar = 0.0) -> None:
        self.leakage = scalar(leakage, "IdealDiode's leakage", non_negative=True, unit="A/V")
        self.current = Reaction("A", "what flows while it conducts")

    def law(self) -> Equation:
        return equal(self.i, self.current + self.leakage * self.v)

    def laws(self) -> Iterable[ModeLaw]:
        yield OneWay(self.current, -1.0 * self.v)

    def dissipated_power(self) -> Expression:
        return self.v * self.i
