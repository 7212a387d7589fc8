"""What leaves the package computes what the model computes: every function of every exported scene, found in what was exported."""

from __future__ import annotations

import inspect
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import acausal as ac
from tests.analysis_scenes import Motor, Top
from tests.exported import compile_quickly
from tests.scenes import DoublePendulum, FourBar
from tests.test_elimination import upright_disk
from tests.test_minimal import geared_motor, rolling_ball


def driven_motor() -> ac.System:
    return Motor(ac.Input("V"), 1.5, 2e-3, 0.04, 1e-4, 2e-4)


SCENES = [DoublePendulum, FourBar, Top, upright_disk, rolling_ball, geared_motor, driven_motor]


@pytest.mark.parametrize("make", SCENES)
def test_each_function_in_c_gives_what_it_gives_here(make: Callable[[], ac.System], tmp_path: Path):
    model = ac.build(make())
    loaded = ac.load_c(model.export_c(tmp_path))
    assert "explicit_dynamics" in loaded.names and loaded.states == model.state_names
    for name in loaded.names:
        own, theirs, rng = getattr(model.functions, name), loaded[name], np.random.default_rng(1)
        assert own.n_in() == theirs.n_in() and own.n_out() == theirs.n_out()
        for _ in range(3):
            given = [rng.normal(size=own.size_in(i)) for i in range(own.n_in())]
            for here, there in zip(own.call(given), theirs.call(given), strict=True):
                one, two = np.array(here), np.array(there)
                np.testing.assert_allclose(two, one, rtol=1e-11, atol=1e-11 * np.max(np.abs(one), initial=0.0), err_msg=name)


@pytest.mark.parametrize("make", [DoublePendulum, FourBar])
def test_each_exporter_writes_what_its_text_names(make: Callable[[], ac.System], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Every method of a model that exports: it returns a folder, whose README names files that are there; or a file, which is such a folder."""
    compile_quickly(monkeypatch)
    model = ac.build(make())
    exporters = [name for name, _ in inspect.getmembers(type(model), inspect.isfunction) if name.startswith("export_")]
    assert {"export_c", "export_simulator", "export_fmu"} <= set(exporters)
    for name in exporters:
        folder = getattr(model, name)(tmp_path / name)
        if folder.is_file():
            shutil.unpack_archive(folder, tmp_path / f"{name}_unpacked", "zip")
            text = (tmp_path / f"{name}_unpacked" / "modelDescription.xml").read_text(encoding="utf-8")
            folder = tmp_path / f"{name}_unpacked" / "sources"
        else:
            text = (folder / "README.txt").read_text(encoding="utf-8")
        named = set(re.findall(r"\b[a-z0-9_]+\.(?:c|h|json)\b", text))
        assert named and all((folder / file).exists() for file in named), named
