"""C compilers: found on the machine, run once for each content, results kept in a cache folder.

The name of a cached library is a hash of everything that it depends on: sources, flags, compiler and processor. It is written under
a name of its own and then renamed, so that parallel processes, or a crash in the middle, never show half a file.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from acausal.emit.library import FLAGS, SOURCES, compiler_at_hand, suffix
from acausal.errors import ExportError

NATIVE = "-march=native"
"""For the processor at hand."""


@functools.cache
def compiler() -> tuple[str, ...] | None:
    """The C compiler that is used: $CC, cc, gcc, clang, or ziglang from PyPI; None if there is none. Looked for once."""
    return compiler_at_hand()


def cache_folder() -> Path:
    """$ACAUSAL_CACHE, or `acausal` in the user's cache folder. May be deleted at any time."""
    given = os.environ.get("ACAUSAL_CACHE")
    if given:
        return Path(given).expanduser().absolute()
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(base) if base else Path.home() / ".cache") / "acausal"


def cached_library(
    key: str, sources: Sequence[str] | None, *, command: tuple[str, ...], options: tuple[str, ...] = (NATIVE,)
) -> Path | None:
    """A shared library of C sources, compiled where the cache has none for `key`; None when it has none and `sources` is None.

    `key`: a hash of what the sources are made from. Raises `ExportError` when the compiler fails, or the cache cannot be written.
    """
    name = hashlib.sha256("\0".join((key, *command, *FLAGS, *options, _machine(command))).encode()).hexdigest()[:32]
    target = cache_folder() / (name + suffix())
    if target.exists():
        return target
    if sources is None:
        return None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target.parent) as folder:
            try:
                made = _build(sources, Path(folder), command, options)
            except ExportError:
                if options != (NATIVE,) or _knows_processor(Path(folder), command):
                    raise
                made = _build(sources, Path(folder), command, ())
            os.replace(made, target)
    except OSError as error:
        raise ExportError(
            f"Compiled code cannot be kept in '{target.parent}': {error}. "
            "Set the environment variable ACAUSAL_CACHE to a folder that can be written."
        ) from error
    return target


def _build(sources: Sequence[str], folder: Path, command: tuple[str, ...], options: tuple[str, ...]) -> Path:
    flags = [*options, *FLAGS, "-I", str(SOURCES)]
    made = folder / ("library" + suffix())
    files = [folder / f"part{k}.c" for k in range(len(sources))]
    for file, text in zip(files, sources, strict=True):
        file.write_text(text, encoding="utf-8")
    if len(files) == 1:
        run_compiler([*command, *flags, "-shared", "-o", str(made), str(files[0]), "-lm"])
        return made
    objects = [file.with_suffix(".o") for file in files]
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        jobs = [[*command, *flags, "-c", "-o", str(o), str(f)] for o, f in zip(objects, files, strict=True)]
        list(pool.map(run_compiler, jobs))
    run_compiler([*command, "-shared", "-o", str(made), *(str(o) for o in objects), "-lm"])
    return made


def _knows_processor(folder: Path, command: tuple[str, ...]) -> bool:
    """Whether the compiler has -march=native. Without it lanes are fewer: all libraries of a machine must be alike in this."""
    try:
        _build(["int nothing;\n"], folder, command, (NATIVE,))
    except ExportError:
        return False
    return True


def run_compiler(command: Sequence[str]) -> None:
    """Run a compiler. Raises `ExportError` with what it printed when it fails."""
    try:
        result = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    except OSError as error:
        raise ExportError(f"The C compiler cannot be run: {' '.join(command)}\n{error}") from error
    if result.returncode != 0:
        raise ExportError(f"The C compiler failed: {' '.join(command)}\n{result.stderr.strip()[-2000:]}")


@functools.cache
def _machine(command: tuple[str, ...]) -> str:
    """What compiled code depends on beside sources and flags: compiler, processor, operating system."""
    path = Path(shutil.which(command[0]) or command[0]).resolve()
    facts = [str(path), str(path.stat().st_mtime_ns), platform.platform(), platform.machine(), platform.processor()]
    if "ziglang" in command:
        facts.append(importlib.metadata.version("ziglang"))
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        facts.append(next((line for line in lines if line.startswith(("flags", "Features"))), ""))
    except OSError:
        pass
    return "\0".join(facts)
