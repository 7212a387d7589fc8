"""Programs of modes that last (thin.h), compiled beside the runs that carry them out."""

from __future__ import annotations

import ctypes
import hashlib
import logging
import threading
import time
from dataclasses import dataclass, field

import numpy as np

from acausal.emit.compiler import cached_library, in_background
from acausal.emit.emit import Source, translation_units
from acausal.emit.program import WIDTH
from acausal.emit.program_source import emit_program
from acausal.errors import ExportError
from acausal.runtime.kernels import WORTH, compilation_cost, made_with
from acausal.runtime.load import Runtime, usable

logger = logging.getLogger("acausal")
_STATEMENT = 2.5e-9
"""Seconds that the interpreter needs for one."""
_NAME = "of_mode"


class _Lasting(ctypes.Structure):
    """`struct Lasting` of runtime.h."""

    _fields_ = [("program", ctypes.c_void_p), ("length", ctypes.c_long), ("spent", ctypes.c_double)]


@dataclass
class _Job:
    """A program, and its function once it is compiled, in a library that is kept as long as the function is used."""

    program: np.ndarray
    function: int | None = None
    library: ctypes.CDLL | None = None


@dataclass
class _Work:
    """What a compiler has done and has to do."""

    jobs: dict[bytes, _Job] = field(default_factory=dict[bytes, _Job])
    waiting: list[_Job] = field(default_factory=list[_Job])
    times: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    begun: float | None = None
    """When it began with what it works on now."""


class LastingModes:
    """Compiled programs of modes. Any thread may ask.

    A program is compiled in the background when carrying it out has cost a part of what a compiler takes, as kernels are. Bits of a motion do not tell.
    `command`: the compiler; None: nothing is compiled.
    """

    def __init__(self, runtime: Runtime, command: tuple[str, ...] | None) -> None:
        self._runtime, self._command = runtime, command
        self._work, self._lock = _Work(), threading.Lock()
        self.worth = WORTH
        """What carrying it out has cost, as a part of what a compiler takes, when one begins."""

    def look(self, programs: int) -> None:
        """Let programs (their address; they belong to the caller for now) use what is compiled, and have compiled what is worth it."""
        if self._command is None:
            return
        found, library, at = _Lasting(), self._runtime.library, -1
        least = self.worth * compilation_cost(0) / _STATEMENT
        while (at := library.lasting_program(programs, at + 1, least, ctypes.byref(found))) >= 0:
            if found.spent * _STATEMENT >= self.worth * compilation_cost(found.length):
                function = self._job(ctypes.string_at(found.program, 4 * WIDTH * (found.length + 1))).function
                if function is not None:
                    library.take_compiled(programs, at, function)

    @property
    def busy(self) -> bool:
        """Whether a compiler works in the background."""
        return self._work.begun is not None

    def between(self, first: float, last: float) -> float:
        """Seconds of a stretch of time (`time.perf_counter`) in which a compiler has worked in the background."""
        with self._lock:
            begun = self._work.begun
            times = self._work.times if begun is None else [*self._work.times, (begun, last)]
            return sum(max(0.0, min(last, end) - max(first, begin)) for begin, end in times)

    def _job(self, text: bytes) -> _Job:
        """What comes of a program; it waits for the compiler, if it is new."""
        with self._lock:
            known = self._work.jobs.get(text)
            if known is not None:
                return known
            job = self._work.jobs[text] = _Job(np.frombuffer(text, np.int32).reshape(-1, WIDTH))
            self._work.waiting.append(job)
            idle = self._work.begun is None
            if idle:
                self._work.begun = time.perf_counter()
        if idle:
            logger.info("acausal compiles kernels of a mode in the background; the run goes on meanwhile.")
            in_background(self._compile, "compiler of modes")
        return job

    def _compile(self) -> None:
        """All that waits, one after the other."""
        while True:
            with self._lock:
                if not self._work.waiting:
                    assert self._work.begun is not None
                    self._work.times.append((self._work.begun, time.perf_counter()))
                    self._work.begun = None
                    return
                job = self._work.waiting.pop(0)
            try:
                job.library, job.function = self._compiled(job.program)
            except ExportError as error:  # the interpreter goes on
                logger.info("acausal: %s", error)

    def _compiled(self, program: np.ndarray) -> tuple[ctypes.CDLL, int | None]:
        assert self._command is not None
        lanes = self._runtime.lanes
        key = hashlib.sha256(b"\0".join((made_with().encode(), str(lanes).encode(), program.tobytes()))).hexdigest()
        source = Source(_NAME, tuple(emit_program(program, _NAME, lanes)), 0, 0, 0, 0)
        path = cached_library(key, translation_units([source], 1), command=self._command, options=self._runtime.options)
        assert path is not None
        with usable(path) as library:
            made_for = ctypes.c_long.in_dll(library, "kernel_lanes").value
            if made_for != lanes:
                raise ExportError(
                    f"A mode was compiled for {made_for} lanes and the runtime for {lanes}; was the compiler changed?"
                )
            return library, ctypes.cast(getattr(library, _NAME), ctypes.c_void_p).value
