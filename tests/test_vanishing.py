"""Is this zero, whatever its symbols are? Yes, no, or unknown."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from acausal.numerics.vanishing import Vanishing, vanish, vanishing

x, y, r = (ca.SX.sym(name) for name in "xyr")
c, s = ca.cos(x), ca.sin(x)

ZERO = [
    c**2 + s**2 - 1, (x + y) * (x - y) - x**2 + y**2, ca.exp(x) * ca.exp(-x) - 1, ca.sin(x + y) - s * ca.cos(y) - c * ca.sin(y),
    ca.sqrt(x**2) - ca.fabs(x), ca.log(x * y) - ca.log(x) - ca.log(y), ca.if_else(x > 0, x, -x) - ca.fabs(x), (0.1 + y) * 3 - 0.3 - 3 * y,
]  # fmt: skip
OTHER = [
    c**2 + s**2 - 1 + 1e-9, x - y, ca.fabs(x) - x, ca.sqrt(x) - y, x * 1e-20, x**2 + 1e-12 * y, x - x * (1 + 1e-12), ca.sin(x) - ca.sin(x + 1e-9),
]  # fmt: skip
NOWHERE = [ca.sqrt(-(x**2) - 1), ca.log(-ca.fabs(y)), ca.acos(2 + x**2) - y]


@pytest.mark.parametrize("unit", [1e-9, 4.0**-15, 1.0, 1e9])
def test_answers_do_not_depend_on_the_unit(unit: float):
    """Neither on that of the rows nor on that of their symbols."""
    for rows, answer in ((ZERO, Vanishing.YES), (OTHER, Vanishing.NO), (NOWHERE, Vanishing.UNKNOWN)):
        column = unit * ca.vertcat(*rows)
        assert vanishing(column) == (answer,) * len(rows)
    lengths = ca.substitute(ca.vertcat(x - r * y - (x - y * r), r * y - x), ca.vertcat(x, r), unit * ca.vertcat(x, r))
    assert vanishing(lengths) == (Vanishing.YES, Vanishing.NO)


def test_what_has_no_value_at_some_places_is_looked_at_elsewhere():
    assert vanish(ca.sqrt(x) ** 2 - x) and vanish(ca.log(x * y * r) - ca.log(x * y) - ca.log(r))
    assert vanishing(ca.sqrt(x * y * r) - x) == (Vanishing.NO,)


def test_fixed_symbols_keep_their_values():
    assert vanish(x * (r - 2), r, np.array([2.0]))
    assert not vanish(x * (r - 2), r, np.array([2.0 + 1e-12]))
    assert not vanish(x * (r - 2))
    assert vanish(ca.SX(0, 1))
