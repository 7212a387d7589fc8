"""CasADi functions compiled for lanes, ready for the C runtime."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca

from acausal.emit.compiler import RUNTIME, cached_library, compiler
from acausal.emit.emit import EMITTER, emit, translation_units
from acausal.emit.program import Program, program
from acausal.errors import ExportError


class Kernel(ctypes.Structure):
    """`Kernel` of runtime.h."""

    _fields_ = [
        ("run", ctypes.c_void_p),
        ("prepare", ctypes.c_void_p),
        ("program", ctypes.c_void_p),
        ("preparation", ctypes.c_void_p),
        ("inputs", ctypes.c_long),
        ("outputs", ctypes.c_long),
        ("constants", ctypes.c_long),
        ("work", ctypes.c_long),
    ]


@dataclass(frozen=True)
class Wanted:
    """A function to be compiled, and the numbers of its arguments that seldom change."""

    name: str
    function: ca.Function
    parameters: tuple[int, ...] = ()


def compiled_kernels(wanted: Sequence[Wanted], command: tuple[str, ...] | None = None) -> tuple[ctypes.CDLL, list[Kernel]] | None:
    """The functions in lanes, compiled together or found in the cache; None without a compiler.

    The library must be kept as long as the kernels are used. Raises `ExportError` for functions that have no C, and where
    they cannot be compiled, kept or loaded.
    """
    command = command or compiler()
    if command is None:
        return None
    parts = [f"{w.name}\0{w.parameters}\0{w.function.serialize()}" for w in wanted]
    key = hashlib.sha256("\0".join([_sources(), *parts]).encode()).hexdigest()
    path = cached_library(key, None, command=command)
    if path is None:
        units = translation_units([emit(w.function, w.name, parameters=w.parameters) for w in wanted], os.cpu_count() or 1)
        path = cached_library(key, units, command=command)
    library = _load(path)
    return library, [_kernel(library, w.name) for w in wanted]


def interpreted_kernels(wanted: Sequence[Wanted], lanes: int) -> tuple[list[Program], list[Kernel]]:
    """The functions as programs for the runtime's interpreter. The programs must be kept as long as the kernels are used."""
    programs = [program(w.function, w.name, lanes, parameters=w.parameters) for w in wanted]
    return programs, [
        Kernel(None, None, p.run.ctypes.data, p.preparation.ctypes.data, p.inputs, p.outputs, p.frame, 0) for p in programs
    ]


def _load(path: Path | None) -> ctypes.CDLL:
    assert path is not None
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        raise ExportError(
            f"The compiled code in '{path}' cannot be loaded: {error}. "
            "Delete this file, or set the environment variable ACAUSAL_CACHE to another folder."
        ) from error


def _kernel(library: ctypes.CDLL, name: str) -> Kernel:
    sizes = (ctypes.c_long * 4).in_dll(library, f"{name}_sizes")
    run, prepare = (ctypes.cast(getattr(library, n), ctypes.c_void_p).value for n in (name, f"{name}_prepare"))
    return Kernel(run, prepare, None, None, *sizes)


@functools.cache
def _sources() -> str:
    """A hash of everything that generated code is made with, this package's emitter included."""
    files = [RUNTIME / "names.h", RUNTIME / "lanes.h", RUNTIME / "vector_math.h", EMITTER]
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


@functools.cache
def runtime(command: tuple[str, ...]) -> ctypes.CDLL:
    """The integrators, compiled by `command` or found in the cache."""
    files = sorted(RUNTIME.glob("*.[ch]"))
    key = hashlib.sha256(b"\0".join(file.name.encode() + file.read_bytes() for file in files)).hexdigest()
    text = (RUNTIME / "runtime.c").read_text(encoding="utf-8")
    library = _load(cached_library(key, [text], command=command))
    pointer, number = ctypes.c_void_p, ctypes.c_long
    library.begin.argtypes = library.advance.argtypes = library.finish.argtypes = library.use_newton.argtypes = [pointer]
    library.dense.argtypes = [pointer, number, pointer, pointer]
    library.project_states.argtypes = [pointer, number, number, pointer, number, pointer, pointer]
    library.lanes.restype = number
    library.finish.restype = library.use_newton.restype = None
    return library
