"""The runtime's library in this process: one that came with the package and fits the processor, or one that a compiler makes."""

from __future__ import annotations

import ctypes
import functools
from dataclasses import dataclass
from pathlib import Path

from acausal.emit.compiler import NATIVE, cached_library, compiler
from acausal.emit.library import SOURCES, Variant, sources_hash, variants
from acausal.errors import ExportError


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
    return _built(command or ()) or (None if command is None else compiled_runtime(command))


@functools.cache
def compiled_runtime(command: tuple[str, ...]) -> Runtime:
    """The integrators compiled by `command` for this processor, or found in the cache. Raises `ExportError`."""
    path = cached_library(sources_hash(), [(SOURCES / "runtime.c").read_text(encoding="utf-8")], command=command)
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
    library = loaded(path)
    pointer, number = ctypes.c_void_p, ctypes.c_long
    library.begin.argtypes = library.advance.argtypes = library.finish.argtypes = library.use_newton.argtypes = [pointer]
    library.exchange.argtypes = [pointer, number, pointer]
    library.dense.argtypes = [pointer, number, pointer, pointer]
    library.project_states.argtypes = [pointer, number, number, pointer, number, pointer, pointer]
    library.columns.argtypes = [pointer, number, number, number, pointer, number, pointer, pointer, pointer, pointer]
    library.lanes.restype = library.widest.restype = number
    library.finish.restype = library.use_newton.restype = None
    return Runtime(library, library.lanes(), options)


def loaded(path: Path) -> ctypes.CDLL:
    """A library of compiled code. Raises `ExportError` where it cannot be loaded."""
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        raise ExportError(
            f"The compiled code in '{path}' cannot be loaded: {error}. "
            "Delete this file, or set the environment variable ACAUSAL_CACHE to another folder."
        ) from error
