"""Valves of circuits: what lets current flow one way only."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, final

from acausal.language.equation import Equation, equal
from acausal.language.expression import Expression, Reaction, Scalar, Variable, scalar
from acausal.language.mode_laws import ModeLaw, OneWay
from components.electrical import FLOATING, AbstractTwoPin
from components.flanges import gate_of


class AbstractValve(AbstractTwoPin):
    """Conducts from pin_a to pin_b, and blocks the other way. `current` [A] >= 0: what flows while it conducts, with the voltage `resistance` times that."""

    if_undecided = (
        "Where a source or a capacitor drives current through valves alone, nothing limits it, and where several of them meet, nothing may say how they share it: "
        "give them a small resistance. Where several of them block in a row, nothing says how they share the voltage: give them a leakage. One below a ten-millionth of what "
        "else conducts is lost in rounding: then give them a larger one."
    )
    current = Variable("A", "what flows while it conducts", if_undetermined=FLOATING)

    def _conducts(self, leakage: Scalar, resistance: Scalar) -> None:
        name = type(self).__name__
        self.leakage = scalar(leakage, f"{name}'s leakage", non_negative=True, unit="A/V")
        self.resistance = scalar(resistance, f"{name}'s resistance", non_negative=True, unit="Ohm")
        self.passing = Reaction("A", "what flows while it conducts")
        self.blocking = Reaction("V", "what it holds back while it blocks")

    @property
    def gate(self) -> Expression | None:
        """What must be positive for it to begin to conduct; None where nothing must."""
        return None

    def law(self) -> Equation:
        return equal(self.i, self.current + self.leakage * self.v)

    def laws(self) -> Iterable[ModeLaw]:
        yield OneWay(self.passing, self.resistance * self.current - self.v, self.gate, self.current, self.blocking)

    def dissipated_power(self) -> Expression:
        return self.v * self.i


@final
class IdealDiode(AbstractValve):
    """Conducts from pin_a to pin_b, and blocks the other way: 0 <= current, v <= resistance current, one of them with equality.

    i = current + leakage v. `leakage` [A/V] >= 0: conducts while it blocks; a circuit needs one in which nothing decides the potential between several
    diodes that block. `resistance` [Ohm] >= 0: while it conducts; a circuit needs one in which nothing else limits the current, or several diodes share it,
    such as a bridge right at a source and a capacitor. With both any circuit has one motion; it is found where the leakage is not below 1e-7 of what else
    conducts. Behind an inductor, which decides the current while it conducts, it needs neither; there a leakage makes motions stiff.

        scene.rectifier = IdealDiode()
    """

    def __init__(self, leakage: Scalar = 0.0, resistance: Scalar = 0.0) -> None:
        self._conducts(leakage, resistance)


@final
class Thyristor(AbstractValve):
    """An ideal diode that begins to conduct only where its `gate` is positive, and goes on until its current has fallen to zero.

    `gate`: an input, a function of time, or an expression of the scene. `leakage` [A/V] and `resistance` [Ohm] as of an IdealDiode; it leaks in either
    direction while it blocks.

        scene.dimmer = Thyristor(gate=ac.Input("V"))
    """

    def __init__(self, gate: Scalar | Callable[[Any], Any], leakage: Scalar = 0.0, resistance: Scalar = 0.0) -> None:
        self._conducts(leakage, resistance)
        self.fires = gate_of(gate, "Thyristor's gate")

    @property
    def gate(self) -> Expression:
        return self.fires
