"""How far a run is, in one line of a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TextIO

from acausal.collocation.problem import Progress


def shown_progress(wanted: bool | Progress, busy: Callable[[], bool]) -> Line | Progress | None:
    """What is told how far a run is: the given function, or a line where a person looks at the terminal, or nothing."""
    if callable(wanted):
        return wanted
    return Line(busy, sys.stderr) if wanted and sys.stderr.isatty() else None


@dataclass
class Line:
    """` 42.0 %, 3 s, 4 s left`, written over and over; it disappears when the run has ended. `busy`: whether a compiler works besides."""

    busy: Callable[[], bool]
    terminal: TextIO
    begun: float = field(default_factory=time.monotonic)
    length: int = 0

    def __call__(self, fraction: float) -> None:
        spent = time.monotonic() - self.begun
        left = f", {duration(spent * (1 - fraction) / fraction)} left" if fraction > 0 else ""
        compiling = "; a compiler works in the background" if self.busy() else ""
        self._write(f"{100 * fraction:5.1f} %, {duration(spent)}{left}{compiling}")

    def close(self) -> None:
        """Take the line away, if there is one."""
        if self.length:
            self._write("")
            self.terminal.write("\r")
            self.terminal.flush()

    def _write(self, text: str) -> None:
        self.terminal.write("\r" + text + " " * (self.length - len(text)))
        self.terminal.flush()
        self.length = len(text)


def duration(seconds: float) -> str:
    """`0.4 s`, `12 s`, `3 min 20 s`, `2 h 5 min`."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 120:
        return f"{whole} s"
    if whole < 7200:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
