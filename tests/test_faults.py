"""Whatever happens to compilers, caches and disks, a run gives its answer; where something is missing, it says what."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from acausal.emit import compiler
from acausal.errors import CacheError

ROOT = Path(__file__).resolve().parent.parent
FAULTS = {
    "fails": "echo broken >&2; exit 1",
    "lies": 'echo nonsense > "$out"; exit 0',
    "makes nothing": "exit 0",
    "is killed": "kill -9 $$",
    "makes another library": 'echo "int nothing;" > "$out.c"; set -- -shared -o "$out" "$out.c"',
}
COMPILER = """#!/bin/sh
# in a hurry, and with a fault for all but the runtime
out= ; of_runtime=
for word; do
    shift
    [ "$word" = -O2 ] && word=-O0
    case "$word" in */part0.c) grep -q runtime.h "$word" && of_runtime=yes;; */library.*) out="$word";; esac
    set -- "$@" "$word"
done
if [ ! "$of_runtime" ]; then case "$FAULT" in
{faults}
esac; fi
exec {real} "$@"
"""
RUN = """
import os, pathlib, sys, warnings
import acausal as ac
from acausal.emit import library
from acausal.runtime import kernels, load
from tests.scenes import FourBar

library.BUILT = load.BUILT = pathlib.Path("/nowhere")  # as if no library had come with the package
kernels.Compilation.begin = kernels.Compilation._work  # at once, not in the background
spent = kernels.Kernels.spent
kernels.Kernels.spent = lambda own, seconds: spent(own, 1e9 if len(own.current) > 1 else 0.0)  # not what is read
for os.environ["FAULT"] in sys.argv[1:]:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scene = FourBar()
        model = ac.build(scene)
        run = model.simulate(2.0, {scene.a.q: -0.5, scene.a.v: 3.0}, rtol=1e-9)
    native = model.functions.native(kernels.How.AUTO)
    compiled = native is not None and bool(native.kernels.current[0].run)
    told = [w.category.__name__ + ": " + str(w.message).replace(chr(10), " ") for w in said]
    print(run.x.tobytes().hex()[-400:], run.statistics.method, compiled, *told, sep=";")
"""


class Told(NamedTuple):
    """Last states of a run in a process of its own, its method, whether its kernels were compiled, and warnings."""

    x: str
    method: str
    compiled: bool
    words: tuple[str, ...]


@pytest.fixture(scope="module")
def cc(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A compiler whose faults are chosen by $FAULT."""
    path = tmp_path_factory.mktemp("compiler") / "cc"
    faults = "\n".join(f'"{name}") {line};;' for name, line in FAULTS.items())
    path.write_text(COMPILER.format(real=shlex.join(compiler.compiler() or ()), faults=faults))
    path.chmod(0o755)
    return path


def ran(cc: Path, cache: Path, *faults: str, before: str = "true") -> list[Told]:
    """A run with each of the faults, one after the other in one process."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "ACAUSAL_CACHE": str(cache), "CC": str(cc)}
    line = ["sh", "-c", f'{before}; exec "$@"', "sh", sys.executable, "-c", RUN, *(faults or ("none",))]
    done = subprocess.run(line, env=environment, capture_output=True, text=True, timeout=300, cwd="/")
    assert done.returncode == 0, done.stderr
    rows = [line.split(";") for line in done.stdout.splitlines()]
    return [Told(x, method, compiled == "True", tuple(words)) for x, method, compiled, *words in rows]


@pytest.fixture(scope="module")
def good(cc: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Told]:
    """A cache with the runtime and the kernels of a run, and what it told."""
    cache = tmp_path_factory.mktemp("cache")
    (told,) = ran(cc, cache)
    assert told[1:] == ("gauss", True, ()) and len(list(cache.iterdir())) == 2
    return cache, told


@pytest.mark.slow
def test_a_compiler_that_breaks_is_not_missed(cc: Path, good: tuple[Path, Told], tmp_path: Path) -> None:
    """The interpreter goes on, with the same bits; nothing of what went wrong is kept, and libraries that were cut off are made anew."""
    cache, told = good
    small, large = sorted(cache.iterdir(), key=lambda file: file.stat().st_size)
    for file, size in ((small, 5000), (large, None)):
        (tmp_path / file.name).write_bytes(file.read_bytes()[:size])
    assert ran(cc, tmp_path, *FAULTS) == [told._replace(compiled=False)] * len(FAULTS)
    assert ran(cc, tmp_path) == [told]
    assert {file.name for file in tmp_path.iterdir()} == {small.name, large.name}
    assert (tmp_path / small.name).stat().st_size == small.stat().st_size


@pytest.mark.slow
def test_a_cache_that_cannot_be_written_is_told_and_read_all_the_same(cc: Path, good: tuple[Path, Told], tmp_path: Path) -> None:
    """The runtime is then compiled for one process."""
    (tmp_path / "file").touch()
    (found,) = ran(cc, tmp_path / "file" / "below")
    assert found[:3] == (good[1].x, "gauss", False)
    (words,) = found.words
    assert words.startswith("NoCompilerWarning") and "ACAUSAL_CACHE" in words and "each process compiles its own" in words
    copy = shutil.copytree(good[0], tmp_path / "cache")
    copy.chmod(0o555)
    assert ran(cc, copy) == [good[1]]


@pytest.mark.slow
def test_a_full_disk_is_told_and_casadi_integrates(cc: Path, tmp_path: Path) -> None:
    """Files may not grow beyond a few kilobytes."""
    (found,) = ran(cc, tmp_path / "cache", before="ulimit -f 8")
    (words,) = found.words
    assert found.method == "cvodes" and words.startswith("NoCompilerWarning")
    assert not list((tmp_path / "cache").iterdir())


def test_a_user_without_a_home_is_told_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in ("ACAUSAL_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", nobody)
    with pytest.raises(CacheError, match=r"home directory.*ACAUSAL_CACHE"):
        compiler.cached_library("key", ["int nothing;"], command=compiler.compiler() or ())
