"""Exported simulators take the steps of the package, in scenes that are hard to integrate: to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.exported import SUCCESS, Library
from tests.hard_cases import CASES

NAMES = (
    "spring_1e4",  # a coordinate is nothing but rounding
    "rattleback_first",
    "four_bars_through_singularity",
)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_exported_simulators_take_the_steps_of_the_package(name: str, tmp_path: Path) -> None:
    case = CASES[name]()
    start = {**case.rough, **case.start}
    library = Library(case.model.export_simulator(tmp_path, start))
    times = np.linspace(0, case.end, 5)
    for rtol in (1e-6, 1e-9, 1e-12):
        report, x = library.simulate(times, options=library.options(rtol=rtol))
        run = case.model.simulate(case.end, start, rtol=rtol, method="gauss")
        assert (report.status, report.steps) == (SUCCESS, run.statistics.steps)
        assert np.array_equal(x, run.at(times).x)
