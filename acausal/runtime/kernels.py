"""CasADi functions as kernels of the C runtime: interpreted, compiled for lanes, or evaluated by CasADi."""

from __future__ import annotations

import contextlib
import ctypes
import enum
import functools
import hashlib
import logging
import math
import os
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import casadi as ca
import numpy as np

from acausal.emit.compiler import NATIVE, cached_library, compiler, in_background
from acausal.emit.emit import EMITTER, Source, emit, translation_units
from acausal.emit.library import sources
from acausal.emit.program import Program
from acausal.errors import ExportError
from acausal.numerics.bound import BoundFunction, arguments
from acausal.numerics.instructions import written
from acausal.numerics.staged import Function, plain, systems_of
from acausal.runtime.load import Runtime, usable
from acausal.runtime.program import program

logger = logging.getLogger("acausal")
WORTH = 0.5
"""Of what a compiler takes: when kernels have cost as much, one begins beside the run."""
EvaluateFunction = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


def compilation_cost(statements: int) -> float:
    """Seconds that a compiler takes, about."""
    return 0.15 + 3e-4 * statements


class Kernel(ctypes.Structure):
    """`Kernel` of runtime.h."""

    _fields_ = [
        ("run", ctypes.c_void_p),
        ("prepare", ctypes.c_void_p),
        ("program", ctypes.c_void_p),
        ("preparation", ctypes.c_void_p),
        ("evaluate", EvaluateFunction),
        ("function", ctypes.c_void_p),
        ("arguments", ctypes.c_void_p),
        ("results", ctypes.c_void_p),
        *((name, ctypes.c_long) for name in ("inputs", "outputs", "constants", "work", "twofold")),
    ]


@dataclass(frozen=True)
class Wanted:
    """A function that is to become a kernel, and the numbers of its arguments that seldom change."""

    name: str
    function: Function
    parameters: tuple[int, ...] = ()

    @property
    def key(self) -> str:
        """What it is told apart by."""
        function, systems = systems_of(self.function)
        return f"{self.name}\0{self.parameters}\0{systems}\0{written(function)}"

    def source(self) -> Source:
        """Its C. Raises `ExportError` where it has none."""
        return emit(self.function, self.name, parameters=self.parameters)


class Compilable(Protocol):
    """What C can be made of: a function of this name, and what it is told apart by."""

    @property
    def name(self) -> str: ...

    @property
    def key(self) -> str: ...

    def source(self) -> Source: ...


class How(enum.Enum):
    """Who carries kernels out: the interpreter until a compiler has done its work where that pays; one of both; CasADi's virtual machine."""

    AUTO = "auto"
    COMPILED = "compiled"
    INTERPRETED = "interpreted"
    CASADI = "casadi"


class Kernels:
    """Kernels of some functions, in the order in which they are wanted: `current`.

    With `AUTO` they are interpreted at first, unless compiled ones are in the cache. `spent` says what they have cost: when that is a part of what a
    compiler would take, one begins in the background, and `current` changes when it is done. `version` counts such changes. Without `look` nobody looks
    into the cache before that: for what may be asked once.
    Raises `ExportError` for functions that have no C.
    """

    def __init__(self, wanted: Sequence[Wanted], runtime: Runtime, how: How, *, look: bool = True) -> None:
        begun = time.perf_counter()
        self.version, self._spent, self._cost, self._lanes = 0, 0.0, math.inf, runtime.lanes
        self.stopped: list[BaseException] = []  # what was raised where C cannot pass it on
        self._alive: list[object] = []  # what the kernels, also former ones, need in memory
        command = compiler() if how in (How.AUTO, How.COMPILED) else None
        self._compilation = None if command is None else Compilation(tuple(wanted), command, runtime.options)
        self.kind = "interpreted"
        if how is How.COMPILED and self._compilation is not None:
            self._take_compiled()
        elif look and self._compilation is not None and self._compilation.cached() and self._took_compiled():
            pass
        elif how is How.CASADI:
            self.current = [_evaluated(plain(w.function), self._alive, self.stopped) for w in wanted]
            self.kind = "CasADi's"
        else:
            programs = [program(w.function, w.name, runtime.lanes, parameters=w.parameters) for w in wanted]
            self._alive += programs
            self.current = [_interpreted(p) for p in programs]
            self._cost = compilation_cost(sum(p.run.shape[0] for p in programs))
        self._made = begun, time.perf_counter()

    def made_between(self, first: float, last: float) -> float:
        """Seconds of a stretch of time (`time.perf_counter`) in which these kernels were made, and their user waited for it."""
        return max(0.0, min(last, self._made[1]) - max(first, self._made[0]))

    def compiled_between(self, first: float, last: float) -> float:
        """The same, in which a compiler worked in the background."""
        return 0.0 if self._compilation is None else self._compilation.between(first, last)

    @property
    def busy(self) -> bool:
        """Whether a compiler works on them in the background."""
        return self._compilation is not None and self._compilation.busy

    def spent(self, seconds: float) -> None:
        """The kernels have taken so much more of a processor: not of time that passes while it has other work."""
        if self._compilation is None or self._compilation.spoilt or self.version:
            return
        self._spent += seconds
        if self._spent > WORTH * self._cost:
            self._compilation.begin()
        if self._compilation.succeeded and self._took_compiled():
            self.version = 1

    def _took_compiled(self) -> bool:
        """Whether there are compiled kernels that can be loaded; where a compiler makes others, nobody asks it again."""
        assert self._compilation is not None
        try:
            self._take_compiled()
        except ExportError as error:
            logger.info("acausal: %s", error)
            self._compilation.spoilt = True
            return False
        return True

    def _take_compiled(self) -> None:
        assert self._compilation is not None
        library, found = self._compilation.result()
        check_lanes(library, self._lanes)
        self._alive.append(library)
        self.current, self.kind = found, "compiled"


class Compilation:
    """The compilation of some functions, in the background or waited for."""

    def __init__(self, wanted: tuple[Compilable, ...], command: tuple[str, ...], options: tuple[str, ...] = (NATIVE,)) -> None:
        self._wanted, self._command, self._options = wanted, command, options
        self._begun: float | None = None
        self._ended: float | None = None
        self.succeeded = self.spoilt = False

    @functools.cached_property
    def _key(self) -> str:
        return hashlib.sha256("\0".join([made_with(), *(w.key for w in self._wanted)]).encode()).hexdigest()

    def cached(self) -> bool:
        """Whether this has been compiled before, by whatever process."""
        try:
            return self._library(None) is not None
        except ExportError:  # there is no cache
            return False

    def result(self) -> tuple[ctypes.CDLL, list[Kernel]]:
        """The library, which must be kept as long as the kernels are used, and the kernels. Raises `ExportError`."""
        with self.opened() as library:
            return library, [_kernel(library, w.name) for w in self._wanted]

    @contextlib.contextmanager
    def opened(self) -> Generator[ctypes.CDLL]:
        """The library. Raises `ExportError`, also where something in it is missed."""
        with usable(self._library(None) or self._compiled()) as library:
            yield library

    def begin(self) -> None:
        """Compile in the background, unless that has begun."""
        if self._begun is None:
            self._begun = time.perf_counter()
            names = ", ".join(w.name for w in self._wanted)
            logger.info("acausal compiles kernels in the background (%s); the run goes on meanwhile.", names)
            in_background(self._work, "compiler of kernels")

    def between(self, first: float, last: float) -> float:
        """Seconds of a stretch of time (`time.perf_counter`) in which a compiler has run in the background."""
        if self._begun is None:
            return 0.0
        return max(0.0, min(last, self._ended or last) - max(first, self._begun))

    @property
    def busy(self) -> bool:
        """Whether it goes on in the background."""
        return self._begun is not None and self._ended is None

    def _compiled(self) -> Path:
        path = self._library(translation_units([w.source() for w in self._wanted], os.cpu_count() or 1))
        assert path is not None
        return path

    def _library(self, sources: Sequence[str] | None) -> Path | None:
        return cached_library(self._key, sources, command=self._command, options=self._options)

    def _work(self) -> None:
        try:
            self._compiled()
            self.succeeded = True
        except ExportError as error:  # the interpreter goes on
            logger.info("acausal: %s", error)
        finally:
            self._ended = time.perf_counter()


def check_lanes(library: ctypes.CDLL, lanes: int) -> None:
    """Raises `ExportError` for a library whose functions take other values than those of so many lanes."""
    made_for = ctypes.c_long.in_dll(library, "kernel_lanes").value
    if made_for != lanes:
        raise ExportError(f"Kernels were compiled for {made_for} lanes and the runtime for {lanes}; was the compiler changed?")


@dataclass(frozen=True)
class Interpreted:
    """A function as a program, and a kernel that runs it."""

    kernel: Kernel
    program: Program


def interpreted(function: Function, name: str, lanes: int, *, parameters: tuple[int, ...]) -> Interpreted:
    """Raises `ExportError` for functions that cannot be expanded to `SX`."""
    made = program(function, name, lanes, parameters=parameters)
    return Interpreted(_interpreted(made), made)


def paired(function: Function, name: str, lanes: int, *, parameters: tuple[int, ...]) -> Interpreted:
    """A program whose values take the room of two, for twofold.h or rounding.h. Raises `ExportError` for functions that cannot be expanded to `SX`."""
    made = interpreted(plain(function), name, 2 * lanes, parameters=parameters)
    made.kernel.constants, made.kernel.twofold = 2 * made.kernel.constants, True
    return made


def _interpreted(p: Program) -> Kernel:
    return Kernel(
        program=p.run.ctypes.data, preparation=p.preparation.ctypes.data, inputs=p.inputs, outputs=p.outputs, constants=p.frame
    )


def _evaluated(function: ca.Function, alive: list[object], stopped: list[BaseException]) -> Kernel:
    """A kernel that CasADi evaluates; what is not to be forgotten goes to `alive`, what is raised to `stopped`, and the result is no number then."""
    symbols = arguments(function)
    stacked = ca.Function("stacked", [ca.vertcat(*map(ca.vec, symbols))], [ca.vertcat(*map(ca.vec, function.call(symbols)))])
    found = BoundFunction.of(stacked)

    def evaluate(_: int | None) -> None:
        try:
            found()
        except BaseException as error:
            stopped.append(error)
            found.result.fill(np.nan)

    callback = EvaluateFunction(evaluate)
    alive += [found, callback]
    x, y = found.arguments[0], found.result
    return Kernel(evaluate=callback, arguments=x.ctypes.data, results=y.ctypes.data, inputs=x.size, outputs=y.size)


def _kernel(library: ctypes.CDLL, name: str) -> Kernel:
    sizes = (ctypes.c_long * 4).in_dll(library, f"{name}_sizes")
    run, prepare = (ctypes.cast(getattr(library, n), ctypes.c_void_p).value for n in (name, f"{name}_prepare"))
    inputs, outputs, constants, work = sizes
    return Kernel(run=run, prepare=prepare, inputs=inputs, outputs=outputs, constants=constants, work=work)


@functools.cache
def made_with() -> str:
    """A hash of everything that generated code is made with, this package's emitter included."""
    headers = [sources()[name] for name in ("names.h", "lanes.h", "systems.h", "vector_math.h")]
    return hashlib.sha256(b"\0".join([*headers, *(file.read_bytes() for file in EMITTER)])).hexdigest()
