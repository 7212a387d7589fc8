"""Units as users write them, read as far as is certain: of what kind a quantity is, whatever its scale."""

from __future__ import annotations

import functools
import re

Dimension = tuple[float, float, float, float]
"""Exponents of mass, length, time and electric current."""

_KINDS: dict[str, Dimension] = {
    "kg": (1, 0, 0, 0), "g": (1, 0, 0, 0), "t": (1, 0, 0, 0), "m": (0, 1, 0, 0), "s": (0, 0, 1, 0), "min": (0, 0, 1, 0), "h": (0, 0, 1, 0),
    "A": (0, 0, 0, 1), "N": (1, 1, -2, 0), "J": (1, 2, -2, 0), "W": (1, 2, -3, 0), "Pa": (1, -1, -2, 0), "Hz": (0, 0, -1, 0),
    "V": (1, 2, -3, -1), "Ohm": (1, 2, -3, -2), "ohm": (1, 2, -3, -2), "F": (-1, -2, 4, 2), "H": (1, 2, -2, -2), "C": (0, 0, 1, 1),
    "rad": (0, 0, 0, 0), "deg": (0, 0, 0, 0), "1": (0, 0, 0, 0),
}  # fmt: skip
_PREFIXES = ("", "k", "M", "G", "c", "d", "m", "u", "µ", "n", "p")
_SYMBOL = re.compile(r"([A-Za-zµ]+|1)(?:\^?\(?(-?\d+)\)?)?$")


@functools.cache
def dimension(unit: str) -> Dimension | None:
    """Of what kind a unit like "N*m/rad" or "kg m^2" is; None where it is not certain: "" or a word that is no unit."""
    total = [0.0, 0.0, 0.0, 0.0]
    sign = 1
    pieces = re.split(r"([*/·])|\s+", unit.strip().replace("**", "^"))
    for piece in (p for p in pieces if p):
        if piece in "*/·":
            sign = -1 if piece == "/" else 1
            continue
        found = _SYMBOL.match(piece)
        kind = None if found is None else _kind(found[1])
        if found is None or kind is None or (found[1] == "ms" and found[2]):  # "ms^-1": milliseconds, or metres and seconds?
            return None
        power = sign * int(found[2] or 1)
        total = [a + power * b for a, b in zip(total, kind, strict=True)]
        sign = 1
    return (total[0], total[1], total[2], total[3]) if unit.strip() else None


def _kind(name: str) -> Dimension | None:
    for prefix in _PREFIXES:
        if name.startswith(prefix) and name[len(prefix) :] in _KINDS:
            return _KINDS[name[len(prefix) :]]
    return None


def certainly_different(unit: str, other: str) -> bool:
    """Whether no number of units makes one into the other; False where one of them is not understood. Angles count as numbers."""
    one, two = dimension(unit), dimension(other)
    return one is not None and two is not None and one != two
