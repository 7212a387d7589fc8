"""C compilers: found on the machine, run once for each content, results kept in a cache folder.

The name of a cached library is a hash of everything that it depends on: sources, flags, compiler and processor. It is written under
a name of its own and then renamed, so that parallel processes, or a crash in the middle, never show half a file.
"""

from __future__ import annotations

import atexit
import functools
import hashlib
import importlib.metadata
import os
import platform
import shutil
import signal
import subprocess
import tempfile
import threading
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path

from acausal.emit.library import FLAGS, SOURCES, compiler_at_hand, suffix
from acausal.errors import ExportError

NATIVE = "-march=native"
"""For the processor at hand."""
_PATIENCE = 5.0
"""Seconds that a process which ends waits for its threads to remove files."""


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
    run_compilers([[*command, *flags, "-c", "-o", str(o), str(f)] for o, f in zip(objects, files, strict=True)])
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
    run_compilers([command])


def run_compilers(commands: Sequence[Sequence[str]]) -> None:
    """Run compilers side by side. Raises `ExportError` with what one printed when it fails; none goes on when this is left."""
    begun: list[subprocess.Popen[str]] = []
    try:
        for command in commands:
            begun.append(_begun(command))
        for command, process in zip(commands, begun, strict=True):
            _, told = process.communicate()
            if process.returncode != 0:
                raise ExportError(f"The C compiler failed: {' '.join(command)}\n{told.strip()[-2000:]}")
    finally:
        for process in begun:
            _end(process)


_running: set[subprocess.Popen[str]] = set()
_ending = threading.Event()
_lock = threading.Lock()


def _begun(command: Sequence[str]) -> subprocess.Popen[str]:
    quiet, pipe = subprocess.DEVNULL, subprocess.PIPE
    with _lock:
        if _ending.is_set():
            raise ExportError("The process ends: nothing is compiled any more.")
        try:
            # a group of its own: it ends with its helpers
            process = subprocess.Popen(
                command, stdin=quiet, stdout=quiet, stderr=pipe, text=True, errors="replace", start_new_session=True
            )
        except OSError as error:
            raise ExportError(f"The C compiler cannot be run: {' '.join(command)}\n{error}") from error
        _running.add(process)
    return process


def _end(process: subprocess.Popen[str]) -> None:
    """End a compiler, if it has not ended, and those that it has called."""
    with _lock:
        _running.discard(process)
    if process.poll() is None:
        _kill(process)
        process.communicate()


def _kill(process: subprocess.Popen[str]) -> None:
    try:
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    except OSError:  # it has ended meanwhile
        pass


_threads: weakref.WeakSet[threading.Thread] = weakref.WeakSet()


def in_background(work: Callable[[], None], name: str) -> threading.Thread:
    """Work that ends with the process: its compilers are ended then, and what they have left behind is removed."""
    thread = threading.Thread(target=work, name=name, daemon=True)
    _threads.add(thread)
    thread.start()
    return thread


@atexit.register
def _stop() -> None:
    with _lock:
        _ending.set()
        running = tuple(_running)
    for process in running:
        _kill(process)
    for thread in tuple(_threads):
        thread.join(_PATIENCE)


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
