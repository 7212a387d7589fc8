"""The runtime's library in this process: one that came with the package and fits the processor, or one that a compiler makes."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import warnings
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

from acausal.emit.compiler import NATIVE, cached_library, compiler, folder_of_process
from acausal.emit.library import BUILT, Variant, sources, sources_hash, variants
from acausal.errors import CacheError, ExportError, NoCompilerWarning
from acausal.wording import callers_level

_PATIENCE = 900.0
"""Seconds that a compiler may take for the integrators."""


@dataclass(frozen=True)
class Runtime:
    """The integrators. `options`: what a compiler of kernels for them must be told, so that both have as many `lanes`."""

    library: ctypes.CDLL
    lanes: int
    options: tuple[str, ...]


@functools.cache
def runtime() -> Runtime | None:
    """The widest library of the package that this processor can run; one compiled and cached where there is none; None without a compiler.

    Raises `ExportError` where a compiler fails.
    """
    command = compiler()
    built = _built(command or ())
    if built is not None or command is None:
        return built
    found = _tried(command)
    if isinstance(found, ExportError):
        raise found
    return found


@functools.cache
def _tried(command: tuple[str, ...]) -> Runtime | ExportError:
    """What comes of `compiled_runtime`, failures too: one try is enough for a process."""
    try:
        return compiled_runtime(command)
    except ExportError as error:
        return error


@functools.cache
def compiled_runtime(command: tuple[str, ...]) -> Runtime:
    """The integrators compiled by `command` for this processor, or found in the cache. Where it cannot be written, that is said, and they are
    compiled for this process alone. Raises `ExportError`.
    """
    key, parts = sources_hash(), [sources()["runtime.c"].decode()]
    try:
        path = cached_library(key, parts, command=command, patience=_PATIENCE)
    except CacheError as error:
        path = cached_library(key, parts, command=command, patience=_PATIENCE, folder=folder_of_process())
        warnings.warn(f"{error} Until then each process compiles its own.", NoCompilerWarning, stacklevel=callers_level())
    assert path is not None
    return _runtime(path, (NATIVE,))


def _built(command: tuple[str, ...]) -> Runtime | None:
    known = [variant for variant in variants() if variant.file.exists()]
    if not known:
        return None
    try:
        found = _of(known[0], command)
        widest = found.library.widest()
        fitting = [variant for variant in known if variant.lanes <= widest]
        return _of(fitting[-1], command) if fitting and fitting[-1] is not known[0] else found
    except ExportError:  # built for another system: a compiler may know better
        return None


def _of(variant: Variant, command: tuple[str, ...]) -> Runtime:
    return _runtime(variant.file, (*variant.flags(command), f"-DLANES={variant.lanes}"))


def _runtime(path: Path, options: tuple[str, ...]) -> Runtime:
    pointer, number = ctypes.c_void_p, ctypes.c_long
    with usable(path) as library:
        library.begin.argtypes = library.advance.argtypes = library.finish.argtypes = library.forget_programs.argtypes = [pointer]
        library.exchange.argtypes = [pointer, number, pointer]
        library.dense.argtypes = [pointer, number, pointer, pointer]
        library.project_states.argtypes = [pointer, number, number, number, pointer, number, pointer, pointer, pointer]
        library.make_program.argtypes = [pointer] * 4
        library.columns.argtypes = [pointer, number, number, number, pointer, number, pointer, pointer, pointer, pointer]
        library.lasting_program.argtypes = [pointer, number, ctypes.c_double, pointer]
        library.take_compiled.argtypes = [pointer, number, pointer]
        library.take_compiled.restype = None
        library.lasting_program.restype = library.lanes.restype = library.widest.restype = library.integrator_size.restype = (
            number
        )
        library.make_program.restype = number
        library.finish.restype = library.forget_programs.restype = None
        return Runtime(library, library.lanes(), options)


@contextlib.contextmanager
def usable(path: Path) -> Generator[ctypes.CDLL]:
    """A library of compiled code. Where it cannot be loaded, or something in it is missed, it is removed from the cache, and `ExportError` raised."""
    try:
        yield ctypes.CDLL(str(path))
    except (OSError, AttributeError, ValueError) as error:
        if path.parent != BUILT:
            with contextlib.suppress(OSError):
                path.unlink()
        raise ExportError(f"The compiled code in '{path}' cannot be used: {error}. It is made anew the next time.") from error
