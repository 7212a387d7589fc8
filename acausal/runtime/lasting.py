"""Programs of modes that last (thin.h), compiled beside the runs that carry them out."""

from __future__ import annotations

import ctypes
import hashlib
import logging
import threading
from dataclasses import dataclass

import numpy as np

from acausal.emit.emit import Source
from acausal.emit.program import WIDTH
from acausal.emit.program_source import emit_program
from acausal.errors import ExportError
from acausal.runtime.kernels import WORTH, Compilation, check_lanes, compilation_cost
from acausal.runtime.load import Runtime

logger = logging.getLogger("acausal")
_STATEMENT = 2.5e-9
"""Seconds that the interpreter needs for one."""


class _Lasting(ctypes.Structure):
    """`struct Lasting` of runtime.h."""

    _fields_ = [("program", ctypes.c_void_p), ("length", ctypes.c_long), ("spent", ctypes.c_double)]


@dataclass(frozen=True)
class _Mode:
    """A program that lasts: its statements, for so many lanes."""

    statements: bytes
    lanes: int

    @property
    def key(self) -> str:
        """What it is told apart by."""
        return f"{self.lanes}\0{hashlib.sha256(self.statements).hexdigest()}"

    @property
    def name(self) -> str:
        """Of its function."""
        return f"mode_{hashlib.sha256(self.statements).hexdigest()[:16]}"

    def source(self) -> Source:
        """Its C."""
        program = np.frombuffer(self.statements, np.int32).reshape(-1, WIDTH)
        return Source(self.name, tuple(emit_program(program, self.name, self.lanes)), 0, 0, 0, 0)


class LastingModes:
    """Compiled programs of modes. Any thread may ask.

    Programs are compiled in the background when carrying them out has cost a part of what a compiler takes, as kernels are. Bits of a motion do not tell.
    `command`: the compiler; None: nothing is compiled.
    """

    def __init__(self, runtime: Runtime, command: tuple[str, ...] | None) -> None:
        self._runtime, self._command, self._lock = runtime, command, threading.Lock()
        self._compilations: list[tuple[Compilation, tuple[_Mode, ...]]] = []
        self._functions: dict[_Mode, int | None] = {}
        """None: it is not compiled yet, or cannot be."""
        self._alive: list[ctypes.CDLL] = []
        self.worth = WORTH
        """What carrying it out has cost, as a part of what a compiler takes, when one begins."""

    def look(self, programs: int) -> None:
        """Let programs (their address; they belong to the caller for now) use what is compiled, and have compiled what is worth it."""
        if self._command is None:
            return
        found, library, at, worth = _Lasting(), self._runtime.library, -1, dict[int, _Mode]()
        least = self.worth * compilation_cost(0) / _STATEMENT
        while (at := library.lasting_program(programs, at + 1, least, ctypes.byref(found))) >= 0:
            if found.spent * _STATEMENT >= self.worth * compilation_cost(found.length):
                worth[at] = _Mode(ctypes.string_at(found.program, 4 * WIDTH * (found.length + 1)), self._runtime.lanes)
        if not worth:
            return
        self._compile(self._command, [mode for mode in worth.values() if mode not in self._functions])
        for at, mode in worth.items():
            function = self._functions.get(mode)
            if function is not None:
                library.take_compiled(programs, at, function)

    @property
    def busy(self) -> bool:
        """Whether a compiler works in the background."""
        return any(compilation.busy for compilation, _ in self._compilations)

    def between(self, first: float, last: float) -> float:
        """Seconds of a stretch of time (`time.perf_counter`) in which a compiler has worked in the background."""
        return sum(compilation.between(first, last) for compilation, _ in self._compilations)

    def _compile(self, command: tuple[str, ...], modes: list[_Mode]) -> None:
        """Take what has been compiled; these are next, as soon as no compiler works any more."""
        with self._lock:
            for compilation, own in self._compilations:
                if compilation.succeeded and not compilation.spoilt and self._functions[own[0]] is None:
                    self._take(compilation, own)
            wanted = tuple(dict.fromkeys(modes))
            if not wanted or self.busy:
                return
            compilation = Compilation(wanted, command, self._runtime.options)
            self._compilations.append((compilation, wanted))
            self._functions |= dict.fromkeys(wanted)
            compilation.begin()

    def _take(self, compilation: Compilation, modes: tuple[_Mode, ...]) -> None:
        try:
            with compilation.opened() as library:
                check_lanes(library, self._runtime.lanes)
                found = {mode: ctypes.cast(getattr(library, mode.name), ctypes.c_void_p).value for mode in modes}
        except ExportError as error:  # the interpreter goes on
            logger.info("acausal: %s", error)
            compilation.spoilt = True
            return
        self._alive.append(library)
        self._functions |= found
