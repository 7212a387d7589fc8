"""Each example runs, returns a number that is as small as it says itself, and draws."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


def imported(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", sorted(path.stem for path in EXAMPLES.glob("*.py")))
def test_example(name, tmp_path, capsys):
    module = imported(EXAMPLES / f"{name}.py")
    assert module.main(str(tmp_path)) < module.LIMIT
    assert len(capsys.readouterr().out.splitlines()) >= 3
    assert (tmp_path / f"{name}.png").exists()
    pages = list(tmp_path.glob("*.html"))
    assert pages
    assert all(page.stat().st_size > 100_000 for page in pages)


@pytest.mark.parametrize("path", sorted((EXAMPLES / "machines").glob("*.py")), ids=lambda path: path.stem)
def test_machine(path, tmp_path):
    assert imported(path).main(str(tmp_path)) < 1e-6
