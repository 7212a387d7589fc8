"""C compilers: found on the machine, run once for each content, results kept in a cache folder.

The name of a cached library is a hash of everything that it depends on: sources, flags, compiler and processor; its last bytes are a hash of
the others. It is written under a name of its own and then renamed, so that parallel processes, or a crash in the middle, never show half a
file; where a disk has lost some of it all the same, it is made anew.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import os
import platform
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import weakref
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

from acausal.emit.library import FLAGS, compiler_at_hand, sources, suffix
from acausal.errors import CacheError, ExportError

NATIVE = "-march=native"
"""For the processor at hand."""
_PATIENCE = 5.0
"""Seconds that a process which ends waits for its threads to remove files."""
_LONGEST = 1800.0
"""Seconds after which a compiler is taken to hang."""
_DAY = 86400.0
_BUILD = "build-"
"""What names of folders in the cache begin with, in which compilers are at work."""


@functools.cache
def compiler() -> tuple[str, ...] | None:
    """The C compiler that is used: $CC, cc, gcc, clang, or ziglang from PyPI; None if there is none. Looked for once."""
    return compiler_at_hand()


def cache_folder() -> Path:
    """$ACAUSAL_CACHE, or `acausal` in the user's cache folder. May be deleted at any time. Raises `CacheError` for users without a home."""
    given = os.environ.get("ACAUSAL_CACHE")
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    try:
        return Path(given).expanduser().absolute() if given else (Path(base) if base else Path.home() / ".cache") / "acausal"
    except RuntimeError as error:
        raise CacheError(_unkept("a cache folder", error)) from error


@functools.cache
def folder_of_process() -> Path:
    """A folder that is deleted when this process ends."""
    return Path(_kept_until_exit().name)


@functools.cache
def _kept_until_exit() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="acausal-")


def cached_library(
    key: str,
    parts: Sequence[str] | None,
    *,
    command: tuple[str, ...],
    options: tuple[str, ...] = (NATIVE,),
    folder: Path | None = None,
    patience: float = _LONGEST,
) -> Path | None:
    """A shared library of C sources, compiled where the cache has none for `key`; None when it has none and `parts` is None.

    `key`: a hash of what the sources are made from. `folder`: the cache. `patience`: seconds that a compiler may take. Raises `ExportError`
    when the compiler fails, and `CacheError` when the cache cannot be written.
    """
    name = hashlib.sha256("\0".join((key, *command, *FLAGS, *options, machine(command))).encode()).hexdigest()[:32]
    target = (folder or cache_folder()) / (name + suffix())
    if _is_whole(target):
        return target
    if parts is None:
        return None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _sweep(target.parent)
        with _scratch(target.parent) as scratch:
            try:
                made = _build(parts, scratch, command, options, patience)
            except ExportError:
                if options != (NATIVE,) or _knows_processor(scratch, command, patience):
                    raise
                made = _build(parts, scratch, command, (), patience)
            _seal(made)
            os.replace(made, target)
    except OSError as error:
        raise CacheError(_unkept(f"'{target.parent}'", error)) from error
    return target


@contextlib.contextmanager
def _scratch(folder: Path) -> Generator[Path]:
    """A folder within for the time being. Python's own would be removed at exit before the compiler in it is ended, with a warning."""
    made = Path(tempfile.mkdtemp(dir=folder, prefix=_BUILD))
    try:
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _unkept(place: str, error: Exception) -> str:
    return f"Compiled code cannot be kept in {place}: {error}. Set the environment variable ACAUSAL_CACHE to a folder that can be written."


def _seal(library: Path) -> None:
    """Appends a hash of the library, which loaders do not look at."""
    content = library.read_bytes()
    with library.open("ab") as file:
        file.write(hashlib.sha256(content).digest())


def _is_whole(library: Path) -> bool:
    try:
        content = library.read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-32]).digest() == content[-32:]


def _sweep(folder: Path) -> None:
    """Removes what processes that were killed have left, a day later."""
    for old in folder.glob(f"{_BUILD}*"):
        with contextlib.suppress(OSError):
            if time.time() - old.stat().st_mtime > _DAY:
                shutil.rmtree(old, ignore_errors=True)


def _build(parts: Sequence[str], folder: Path, command: tuple[str, ...], options: tuple[str, ...], patience: float) -> Path:
    headers = folder / "headers"
    headers.mkdir(exist_ok=True)
    for name, content in sources().items():
        (headers / name).write_bytes(content)
    flags = [*options, *FLAGS, "-I", str(headers)]
    made = folder / ("library" + suffix())
    files = [folder / f"part{k}.c" for k in range(len(parts))]
    for file, text in zip(files, parts, strict=True):
        file.write_text(text, encoding="utf-8")
    if len(files) == 1:
        run_compiler([*command, *flags, "-shared", "-o", str(made), str(files[0]), "-lm"], patience)
        return made
    objects = [file.with_suffix(".o") for file in files]
    run_compilers([[*command, *flags, "-c", "-o", str(o), str(f)] for o, f in zip(objects, files, strict=True)], patience)
    run_compiler([*command, "-shared", "-o", str(made), *(str(o) for o in objects), "-lm"], patience)
    return made


def _knows_processor(folder: Path, command: tuple[str, ...], patience: float) -> bool:
    """Whether the compiler has -march=native. Without it lanes are fewer: all libraries of a machine must be alike in this."""
    try:
        _build(["int nothing;\n"], folder, command, (NATIVE,), patience)
    except ExportError:
        return False
    return True


def run_compiler(command: Sequence[str], patience: float = _LONGEST) -> None:
    """Run a compiler, `-o` and the file to make among its arguments: what it writes on the way lies beside that, and stays there when it is killed.

    Raises `ExportError` with what it printed when it fails, or when it has not ended after `patience` seconds.
    """
    run_compilers([command], patience)


def run_compilers(commands: Sequence[Sequence[str]], patience: float = _LONGEST) -> None:
    """Run compilers side by side (see `run_compiler`). Raises `ExportError` with what one printed when it fails; none goes on when this is left."""
    begun: list[subprocess.Popen[str]] = []
    try:
        for command in commands:
            begun.append(_begun(command))
        for command, process in zip(commands, begun, strict=True):
            try:
                _, told = process.communicate(timeout=patience)
            except subprocess.TimeoutExpired:
                raise ExportError(f"The C compiler has not ended after {patience:g} s: {' '.join(command)}") from None
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
    beside = str(Path(command[command.index("-o") + 1]).absolute().parent)
    environment = os.environ | dict.fromkeys(("TMPDIR", "TMP", "TEMP"), beside)
    with _lock:
        if _ending.is_set():
            raise ExportError("The process ends: nothing is compiled any more.")
        try:
            # a group of its own: it ends with its helpers
            process = subprocess.Popen(
                command,
                stdin=quiet,
                stdout=quiet,
                stderr=pipe,
                text=True,
                errors="replace",
                env=environment,
                start_new_session=True,
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
def machine(command: tuple[str, ...]) -> str:
    """What compiled code depends on beside sources and flags: compiler, processor, operating system."""
    path = Path(shutil.which(command[0]) or command[0]).resolve()
    facts = [str(path), str(path.stat().st_mtime_ns), platform.platform(), platform.machine(), platform.processor()]
    if "ziglang" in command:
        import importlib.metadata  # takes longer than all of this module

        facts.append(importlib.metadata.version("ziglang"))
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        facts.append(next((line for line in lines if line.startswith(("flags", "Features"))), ""))
    except OSError:
        pass
    return "\0".join(facts)
