"""How the package is built: with what compilers there are, and without."""

from __future__ import annotations

import importlib.util
import platform
import sys
import types
from pathlib import Path
from typing import Any

import pytest

from acausal.emit import library

SOURCE = Path(library.__file__).with_name("build_backend.py")


@pytest.fixture
def backend(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """As a build sees it, with a folder of libraries of its own; whichever setuptools is there."""
    wheel = types.ModuleType("setuptools.command.bdist_wheel")
    wheel.bdist_wheel = type("bdist_wheel", (), {"finalize_options": lambda _: None, "get_tag": lambda _: ("cp", "cp", "any")})  # type: ignore[attr-defined]
    monkeypatch.setattr(library, "BUILT", tmp_path / "built")
    monkeypatch.setitem(sys.modules, "setuptools.command.bdist_wheel", wheel)
    monkeypatch.setitem(sys.modules, "library", library)
    spec = importlib.util.spec_from_file_location("build_backend_under_test", SOURCE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def compiler(path: Path, line: str) -> str:
    path.write_text(f"#!/bin/sh\n{line}\n")
    path.chmod(0o755)
    return str(path)


def wheel(backend: Any) -> tuple[bool, tuple[str, str, str]]:
    made = backend.PlatformWheel()
    made.finalize_options()
    return made.root_is_pure, made.get_tag()


MAKES = 'while [ "$1" != -o ]; do shift; done; echo library > "$2"'


def test_each_kind_of_processor_gets_a_library_and_old_ones_go(
    backend: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "built").mkdir()
    (tmp_path / "built" / "of-other-sources.so").touch()
    monkeypatch.setenv("CC", compiler(tmp_path / "cc", f'echo "$*" >> {tmp_path}/log; {MAKES}'))
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    backend.build_libraries()
    assert {file.name for file in (tmp_path / "built").iterdir()} == {variant.file.name for variant in library.variants()}
    log = (tmp_path / "log").read_text()
    assert all(f"-march=x86-64-v{k} " in log and f"-DLANES={2 ** (k - 1)} " in log for k in (2, 3, 4))
    assert wheel(backend) == (False, ("py3", "none", "any"))


def test_other_processors_get_one_of_two_lanes(backend: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", compiler(tmp_path / "cc", f'echo "$*" >> {tmp_path}/log; {MAKES}'))
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    backend.build_libraries()
    (made,) = (tmp_path / "built").iterdir()
    assert made.stem.endswith("-any-2") and "-march" not in (tmp_path / "log").read_text()


@pytest.mark.parametrize("line", ["", "echo no >&2; exit 1"])
def test_without_a_compiler_that_works_the_wheel_is_one_for_all(
    backend: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], line: str
) -> None:
    if line:
        monkeypatch.setenv("CC", compiler(tmp_path / "cc", line))
    else:
        monkeypatch.delenv("CC", raising=False)
        monkeypatch.setenv("PATH", str(tmp_path))
        monkeypatch.setitem(sys.modules, "ziglang", None)
        assert backend._compiler_from_pypi() == ["ziglang>=0.13"]
    backend.build_libraries()
    assert ("cannot be built" if line else "no C compiler was found") in capsys.readouterr().err
    assert wheel(backend) == (True, ("py3", "none", "any"))
