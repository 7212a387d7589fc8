"""The pages that teach: what they need is there, and what they show runs. `make docs` runs the rest of it."""

from __future__ import annotations

import inspect
import re
import runpy
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
sys.path.append(str(DOCS))

from tools import systems  # noqa: E402
from tools.catalogue import catalogue  # noqa: E402
from tools.executed import executed  # noqa: E402
from tools.scenes import FOLDER, script_of  # noqa: E402


@pytest.mark.parametrize("kind", catalogue(), ids=lambda kind: kind.name)
def test_each_part_has_a_text_of_less_than_a_screen_and_a_script_for_its_page(kind):
    assert kind.text
    assert len(kind.text.splitlines()) < 25 and max(map(len, kind.text.splitlines())) < 160, (
        "help() of it does not fit on a screen"
    )
    assert "model = ac.build(scene)" in script_of(kind) or not kind.is_part
    assert "*args" not in str(inspect.signature(kind.cls)), "help() of it does not say what it takes"


def test_scripts_name_parts_that_exist():
    known = {kind.name for kind in catalogue()}
    for path in FOLDER.glob("*.py"):
        first = path.read_text(encoding="utf-8").split("\n")[0]
        assert first.startswith("# Shows ")
        assert set(re.split(r"\W+", first.removeprefix("# Shows "))) <= known, path.name


@pytest.mark.parametrize("path", sorted((DOCS / "own").glob("*.py")), ids=lambda path: path.stem)
def test_each_part_of_ones_own_does_what_its_page_says(path):
    space = runpy.run_path(str(path))
    assert space["main"]() < space["LIMIT"]


@pytest.mark.parametrize("path", sorted((DOCS.parent / "examples").glob("*/*.py")), ids=lambda path: path.stem)
def test_each_machine_of_the_gallery_has_a_title_and_a_bound(path):
    space = runpy.run_path(str(path))
    assert 5 < len(space["__doc__"].split(": ")[0]) < 60
    assert callable(space["main"]) and 0 < space["LIMIT"] < 0.1


def test_each_system_is_shown_by_scripts_and_tests_that_exist():
    """And each script of the classical ones by a system."""
    shown = {name for row in systems.ROWS for name in row.examples}
    for row in systems.ROWS:
        assert row.examples or row.tests, row.system
        assert all(systems.script_of(name).exists() for name in row.examples)
        assert all(systems.function_of(test).body for test in row.tests)
    assert {path.stem for path in (DOCS.parent / "examples" / "classical").glob("*.py")} <= shown


def test_pages_name_files_that_exist():
    """Sources, tests and folders between backticks: from the repository's root, or of the package."""
    root = DOCS.parent
    for page in (root / "README.md", *DOCS.glob("*.md")):
        for name in re.findall(r"`((?:\w+/)+(?:\w+\.(?:py|h))?)`", page.read_text(encoding="utf-8")):
            made = name.startswith("out/")
            assert made or (root / name).exists() or (root / "acausal" / name).exists(), f"{page.name}: {name}"


@pytest.mark.parametrize("page", ["tutorial", "concepts", "expressions", "guides"])
def test_code_on_pages_runs(page, tmp_path):
    blocks = re.findall(r"```{run}\n(.*?)```", (DOCS / f"{page}.md").read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) > 3
    space: dict[str, object] = {}
    for block in blocks:
        options = dict(re.findall(r"^:(\w+): ?(.*)$", block, re.MULTILINE))
        code = re.sub(r"^:\w+:.*\n", "", block, flags=re.MULTILINE)
        executed(code, space, options.get("picture"), tmp_path / "picture.png", options.get("raises"))
