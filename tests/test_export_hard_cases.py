"""Whoever carries a motion out, and on however many lanes, the bits are the same: interpreter, compiled kernels, exported simulators."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import acausal as ac
from acausal.runtime.kernels import How
from acausal.runtime.native import native_problem
from tests.exported import AUTO, RADAU, SUCCESS, Library
from tests.hard_cases import CASES, HardCase

NAMES = (
    "spring_1e4",  # a coordinate is nothing but rounding
    "four_bars_through_singularity",
    "nearly_folding",  # twice as many digits where that is near
    "overdamped",  # Radau's from its beginning on
    "switched_force",
)
METHODS = {"auto": AUTO, "radau": RADAU}


def ran(case: HardCase, how: How, rtol: float, method: str, monkeypatch: pytest.MonkeyPatch) -> ac.Trajectory:
    functions = case.model.functions
    with monkeypatch.context() as patch:
        patch.setitem(functions._native._kept, How.AUTO, native_problem(functions.integrand, how))
        run = case.model.simulate(case.end, {**case.rough, **case.start}, rtol=rtol, method=method)
    assert run.statistics.kernels == how.value
    return run


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_all_ways_to_carry_out_a_motion_give_the_same_bits(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = CASES[name]()
    folder = case.model.export_simulator(tmp_path, {**case.rough, **case.start})
    libraries = [Library(folder), Library(folder, lanes=2)]
    times = np.linspace(0, case.end, 5)
    for rtol, method in ((1e-6, "auto"), (1e-12, "auto"), (1e-9, "radau")):
        run = ran(case, How.INTERPRETED, rtol, method, monkeypatch)
        x = run.at(times).x
        for library in libraries:
            report, found = library.simulate(times, options=library.options(rtol=rtol, method=METHODS[method]))
            assert (report.status, report.steps) == (SUCCESS, run.statistics.steps)
            assert np.array_equal(found, x)
        assert np.array_equal(ran(case, How.COMPILED, rtol, method, monkeypatch).at(times).x, x)
