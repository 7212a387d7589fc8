"""Each example runs and returns a number that is as small as its text says."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
LIMITS = {
    "andrews": 1e-11,
    "bicycle": 1e-11,
    "double_pendulum": 1e-9,
    "rolling_disk": 1e-12,
    "cart_swing_up": 2e-2,
    "four_bar": 1e-13,
    "flexible_slider_crank": 1e-12,
    "engine": 1e-13,
    "gyroscopic": 1e-12,
    "robot_r3": 1e-4,
}


@pytest.mark.parametrize("name", sorted(path.stem for path in EXAMPLES.glob("*.py")))
def test_example(name, tmp_path, capsys):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.main(str(tmp_path)) < LIMITS[name]
    assert len(capsys.readouterr().out.splitlines()) >= 3
    pages = list(tmp_path.glob("*.html"))
    assert pages
    assert all(page.stat().st_size > 100_000 for page in pages)
