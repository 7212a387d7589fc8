"""Exported simulators take the steps of the package, in scenes that are hard to integrate: to the last bit."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

import acausal as ac
from acausal.emit.compiler import compiler
from tests.hard_cases import CASES
from tests.scenes import DoublePendulum

FLAGS = ("-O0", "-march=native", "-ffp-contract=off", "-fno-math-errno", "-Wno-psabi")
"""Compiled in a hurry: optimisation does not change bits."""
NAMES = (
    "spring_1e4",  # a coordinate is nothing but rounding
    "rattleback_first",
    "four_bars_through_singularity",
)


@pytest.fixture(scope="module")
def runtime(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The integrators as an object file."""
    folder = ac.build(DoublePendulum()).export_simulator(tmp_path_factory.mktemp("runtime"))
    subprocess.run([*_compiler(), *FLAGS, "-c", "runtime.c"], cwd=folder, check=True)
    return folder / "runtime.o"


def _compiler() -> tuple[str, ...]:
    command = compiler()
    assert command is not None
    return command


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_exported_simulators_take_the_steps_of_the_package(name: str, runtime: Path, tmp_path: Path) -> None:
    case = CASES[name]()
    start = {**case.rough, **case.start}
    case.model.export_simulator(tmp_path, start)
    words = ("main.c", "simulator.c", "model.c", str(runtime), "-lm")
    subprocess.run([*_compiler(), *FLAGS, "-o", "simulator", *words], cwd=tmp_path, check=True)
    for rtol in (1e-6, 1e-9, 1e-12):
        call = [str(tmp_path / "simulator"), repr(case.end), "5", repr(rtol)]
        printed = subprocess.run(call, env={}, capture_output=True, text=True, check=True).stdout.splitlines()[1:]
        table = np.array([row.split(",") for row in printed], dtype=float)
        run = case.model.simulate(case.end, start, rtol=rtol, method="gauss")
        assert np.array_equal(table[:, 1:].T, run.at(table[:, 0]).x)
