"""docs/messages.md: the most instructive messages, as users get them. `python -m tests.bad_input.catalogue` writes it."""

from __future__ import annotations

import re
from pathlib import Path

from tests.bad_input import test_calls, test_laws, test_own_parts, test_scenes
from tests.bad_input.messages import Wrong

PAGE = Path(__file__).resolve().parents[2] / "docs" / "messages.md"

_INTRODUCTION = """# Messages

What some mistakes are answered with, to search for. Each message says what is wrong, where (the part's path in the scene, and the line
in which it was made), with which values, and what to try. All kinds of errors are listed in `acausal/errors.py`; every one of them is an
`ac.errors.AcausalError`. The tests of `tests/bad_input` make these messages and some 250 others; one of them checks this page, which
`python -m tests.bad_input.catalogue` writes.
"""

_TITLES = (
    "particle on a ball joint", "rack connected at one end", "part replaced after it was connected", "axis wrong by one degree",
    "wheel larger than its axle is high", "rod that locks", "loop without mass", "thin rod on a ball joint",
    "disk connected the wrong way round", "mass as a stiffness", "root that CasADi searches", "two different racks between the same joints",
    "two sources on one joint", "angle from samples that bend", "angle from a function of numbers", "voltage at a diode from a function of numbers", "optimal voltage at a diode", "math.sin in a function of time", "== in place of equal", "variable made in __init__",
    "closure that forgets the time", "force with a wrong potential", "force that follows the rate of a measured torque", "equations that contradict", "vectors of different lengths", "variable as a truth", "start as a list",
    "starts of a geared pair that contradict", "crank where the loop cannot follow", "crank driven where the loop cannot follow",
    "wheel that lies flat", "negative mass", "input as an array", "variable by a wrong name", "too few states in linearize",
    "minimal where a parallelogram lies flat", "too few forces", "equilibrium in free fall",
)  # fmt: skip


def cases() -> tuple[Wrong, ...]:
    """Everything wrong that is tested, in the order of this page."""
    found = {case.title: case for module in (test_scenes, test_own_parts, test_laws, test_calls) for case in module.CASES}
    return tuple(found[title] for title in _TITLES)


def page() -> str:
    """The page; places in the code are shown as `scene.py:12`."""
    parts = [_INTRODUCTION]
    for case in cases():
        message = re.sub(r"[\w./-]+\.py:\d+", "scene.py:12", case.message())
        parts.append(f"## {case.title[0].upper()}{case.title[1:]}\n\n    {case.kind.__name__}: {message}\n")
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page())
