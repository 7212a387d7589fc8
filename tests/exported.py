"""Exported simulators, compiled without a warning and called through ctypes."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acausal as ac
from acausal.emit.compiler import cache_folder, compiler, machine
from acausal.export import fmu
from tests.scenes import DoublePendulum

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Wno-psabi", "-Werror")
FLAGS = ("-O1", "-march=native", "-ffp-contract=off", "-fno-math-errno", "-fPIC")
"""Compiled in a hurry: optimisation does not change bits."""
KEPT = cache_folder()
"""As it is before tests take others."""
SUCCESS, AT_EVENT, STOPPED, STEP_UNDERFLOW, NON_FINITE, NOT_CONVERGED, MAX_STEPS, FAILED_INPUT = range(8)
OUT_OF_MEMORY, BAD_ARGUMENT, OPEN_START, OTHER_MODEL, SLIDES, OVERLAPS, NO_MODE, CHATTERS = range(8, 16)
STATE, INPUT, PARAMETER, CONDITION, OUTPUT, EVENT = range(6)
GAUSS, RADAU, AUTO = range(3)


def command() -> tuple[str, ...]:
    found = compiler()
    assert found is not None
    return found


def compiled(folder: Path, *words: str | Path) -> None:
    """Runs the compiler, which is to say nothing."""
    made = subprocess.run([*command(), *WARNINGS, *FLAGS, *map(str, words)], cwd=folder, capture_output=True, text=True)
    assert made.returncode == 0 and not made.stderr, made.stderr


@functools.cache
def runtime(name: str = "simulator", lanes: tuple[str, ...] = ()) -> Path:
    """The integrators as an object file: the same for all models, and the longest to compile."""
    folder = Path(_scratch().name) / "".join([name, *lanes])
    ac.build(DoublePendulum()).export_simulator(folder, name=name)
    sources = [file.read_bytes() for file in sorted(folder.glob("*.[ch]"))]
    return made_once(sources, lambda made: compiled(folder, "-c", "-o", made, *lanes, "runtime.c"), *WARNINGS, *FLAGS, *lanes)


def made_once(sources: Iterable[bytes], make: Callable[[Path], None], *words: str) -> Path:
    """What the compiler makes of sources with these words, kept in the cache for other workers and other days."""
    key = b"\0".join([*sources, *map(str.encode, (*words, *command(), machine(command())))])
    KEPT.mkdir(parents=True, exist_ok=True)
    kept = KEPT / f"{hashlib.sha256(key).hexdigest()[:32]}.o"
    if not kept.exists():
        with tempfile.TemporaryDirectory(dir=KEPT) as scratch:
            make(made := Path(scratch) / kept.name)
            os.replace(made, kept)
    return kept


@functools.cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory()


def program(folder: Path, main: str = "main.c", *flags: str) -> Path:
    """The program of an exported folder, or another one around its instances."""
    made = folder / Path(main).stem
    compiled(folder, "-o", made, *flags, main, "simulator.c", "model.c", runtime(), "-lm")
    return made


def printed(made: Path, *words: object) -> tuple[list[str], np.ndarray]:
    """Header and values of a run in an empty environment."""
    line = [str(made), *map(str, words)]
    text = subprocess.run(line, cwd="/", env={}, capture_output=True, text=True, check=True).stdout
    head, *rows = text.splitlines()
    return head.split(","), np.array([row.split(",") for row in rows], dtype=float)


InputFunction = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.POINTER(ctypes.c_double))


class Options(ctypes.Structure):
    """`simulator_options`."""

    _fields_ = [
        ("method", ctypes.c_int),
        ("order", ctypes.c_long),
        ("rtol", ctypes.c_double),
        ("atol", ctypes.c_double),
        ("step", ctypes.c_double),
        ("max_step", ctypes.c_double),
        ("max_steps", ctypes.c_long),
        ("input", InputFunction),
        ("user", ctypes.c_void_p),
    ]


class Crossing(ctypes.Structure):
    """`simulator_crossing`."""

    _fields_ = [("event", ctypes.c_long), ("direction", ctypes.c_int), ("time", ctypes.c_double)]


class Change(ctypes.Structure):
    """`simulator_transition`."""

    _fields_ = [("count", ctypes.c_long), ("part", ctypes.c_char_p), ("time", ctypes.c_double)]


class Report(ctypes.Structure):
    """`simulator_report`."""

    _fields_ = [
        ("status", ctypes.c_int),
        ("message", ctypes.c_char * 240),
        ("time", ctypes.c_double),
        ("reached", ctypes.c_double),
        ("failed_state", ctypes.c_char_p),
        *((name, ctypes.c_long) for name in ("steps", "rejected", "newton_steps", "radau_steps", "evaluations", "factorisations", "order", "samples")),
    ]  # fmt: skip


class Library:
    """The shared library of an exported model; `lanes`: how many, where that is not left to the processor."""

    def __init__(self, folder: Path, name: str = "simulator", lanes: int | None = None) -> None:
        flags = () if lanes is None else (f"-DLANES={lanes}",)
        made = folder / f"lib{name}{lanes or ''}.so"
        if not made.exists():
            compiled(folder, "-shared", "-o", made, *flags, f"{name}.c", "model.c", runtime(name, flags), "-lm")
        self.library, self.name, self.path = ctypes.CDLL(str(made), mode=ctypes.RTLD_GLOBAL), name, made
        pointer, number, real, status = ctypes.c_void_p, ctypes.c_long, ctypes.c_double, ctypes.c_int
        for function, result, *arguments in (
            ("defaults", Options), ("size", ctypes.c_size_t, pointer), ("create", pointer, pointer, pointer, ctypes.c_size_t),
            ("copy", pointer, pointer, pointer, ctypes.c_size_t), ("restore", status, pointer, pointer), ("reset", None, pointer),
            ("free", None, pointer), ("set", status, pointer, status, number, real), ("set_all", status, pointer, status, pointer),
            ("get", real, pointer, status, number), ("get_all", status, pointer, status, pointer), ("start", status, pointer, real),
            ("start_at", status, pointer, real, pointer), ("set_end", status, pointer, real), ("advance", status, pointer, real),
            ("step", status, pointer, real), ("renew", status, pointer), ("time", real, pointer), ("event", Crossing, pointer),
            ("change", Change, pointer),
            ("message", ctypes.c_char_p, pointer), ("summary", Report, pointer), ("index", number, status, ctypes.c_char_p),
            ("name", ctypes.c_char_p, status, number), ("unit", ctypes.c_char_p, status, number), ("count", number, status),
            ("exported", real, status, number), ("mistake", ctypes.c_char_p, pointer), ("title", ctypes.c_char_p),
            ("version", ctypes.c_char_p), ("simulate", status, pointer, real, *[pointer] * 3, number, *[pointer] * 3),
        ):  # fmt: skip
            found = getattr(self.library, f"{name}_{function}")
            found.restype, found.argtypes = result, list(arguments)
            setattr(self, f"c_{function}", found)

    def options(self, **values: Any) -> Options:
        """Defaults with some values changed."""
        found = self.c_defaults()
        for key, value in values.items():
            setattr(found, key, value)
        return found

    def names(self, kind: int) -> list[str]:
        return [self.c_name(kind, i).decode() for i in range(self.c_count(kind))]

    def units(self, kind: int) -> list[str]:
        return [self.c_unit(kind, i).decode() for i in range(self.c_count(kind))]

    def simulate(
        self,
        times: Sequence[float],
        t0: float = 0.0,
        x0: Any = None,
        u: Any = None,
        p: Any = None,
        options: Options | None = None,
    ) -> tuple[Report, np.ndarray]:
        """Report and states (nx, times) of a whole motion."""
        kept = [None if v is None else np.array(v, dtype=float) for v in (x0, u, p, times)]
        x, u, p, t = (None if v is None else v.ctypes.data for v in kept)
        found, report = np.full((len(times), self.c_count(STATE)), np.nan), Report()
        chosen = None if options is None else ctypes.addressof(options)
        status = self.c_simulate(chosen, t0, x, u, p, len(times), t, found.ctypes.data, ctypes.addressof(report))
        assert status == report.status
        return report, found.T

    def instance(self, options: Options | None = None) -> Instance:
        """A new instance in memory of this process."""
        size = self.c_size(None if options is None else ctypes.addressof(options))
        memory = ctypes.create_string_buffer(size)
        made = self.c_create(None if options is None else ctypes.addressof(options), ctypes.addressof(memory), size)
        assert made
        return Instance(self, made, memory, options)


class Instance:
    """One motion. Methods are the functions of simulator.h: `instance.advance(1.0)`."""

    def __init__(
        self, library: Library, address: int, memory: ctypes.Array[ctypes.c_char], options: Options | None = None
    ) -> None:
        self.library, self.address, self.memory, self.options = library, address, memory, options

    def __getattr__(self, name: str) -> Any:
        function = getattr(self.library, f"c_{name}")
        return lambda *arguments: function(self.address, *arguments)

    @property
    def x(self) -> np.ndarray:
        """States at the present time."""
        return self.all(STATE)

    def all(self, kind: int) -> np.ndarray:
        values = np.empty(self.library.c_count(kind))
        assert self.get_all(kind, values.ctypes.data) == SUCCESS
        return values

    def set_values(self, kind: int, values: Any) -> int:
        kept = np.array(values, dtype=float)
        return self.set_all(kind, kept.ctypes.data)

    def started(self, t: float = 0.0, x: Any = None) -> int:
        if x is None:
            return self.start(t)
        kept = np.array(x, dtype=float)
        return self.start_at(t, kept.ctypes.data)

    def copied(self) -> Instance:
        memory = ctypes.create_string_buffer(len(self.memory))
        made = self.library.c_copy(self.address, ctypes.addressof(memory), len(memory))
        assert made
        return Instance(self.library, made, memory, self.options)

    def words(self) -> str:
        return self.message().decode()

    def events(self, t: float) -> Iterator[Crossing]:
        """Those on the way to time t."""
        while (status := self.advance(t)) in (AT_EVENT, STOPPED):
            yield self.event()
            if status == STOPPED:
                return
        assert status == SUCCESS, self.words()


def compile_quickly(patch: pytest.MonkeyPatch) -> None:
    """Units, in a third of the time and without a warning: they give the same bits."""
    patch.setattr(fmu, "FLAGS", [*WARNINGS, *(flag.replace("-O2", "-O0") for flag in fmu.FLAGS)])
