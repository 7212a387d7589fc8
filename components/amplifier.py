"""The ideal operational amplifier."""

from __future__ import annotations

from collections.abc import Iterable
from typing import final

from acausal.language.component import Component
from acausal.language.connector import Electrical
from acausal.language.equation import Equation, equal
from acausal.language.expression import Expression

_LOOSE = "Connect all three pins; what the output does follows from the feedback to `minus`."


@final
class OperationalAmplifier(Component):
    """Ideal amplifier of infinite gain: v_plus = v_minus, no current into either; its output gives whatever current that takes.

    It makes sense only with feedback from `output` to `minus`. Its supply, which is not shown, gives -v_output i_output against ground.
    B. D. H. Tellegen, On nullators and norators, IEEE Trans. Circuit Theory 13 (1966).

    scene.amplifier = OperationalAmplifier(); scene.connect(scene.amplifier.output, scene.feedback.pin_a)
    """

    plus = Electrical.port(must_connect=True, if_unconnected=_LOOSE)
    minus = Electrical.port(must_connect=True, if_unconnected=_LOOSE)
    output = Electrical.port(must_connect=True, if_unconnected=_LOOSE)

    def equations(self) -> Iterable[Equation]:
        yield equal(self.plus.v, self.minus.v)
        yield equal(self.plus.i, 0.0)
        yield equal(self.minus.i, 0.0)

    def supplied_power(self) -> Expression:
        return -1.0 * self.output.v * self.output.i
