"""Words for tables and messages: names of many parts in little room."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

_LAST = re.compile(r"^(.*)\[(\d+)\](.*?)$")
_FIRST = re.compile(r"^(.*?)\[(\d+)\](.*)$")


def compact(names: Iterable[str], most: int = 6) -> str:
    """Names in one line: `a, legs[0...5].knee, b and 12 more`. Runs of numbers are drawn together; at most `most` entries are shown."""
    entries = _drawn_together(_drawn_together(names, _LAST), _FIRST)
    rest = len(entries) - most
    return ", ".join(entries) if rest <= 0 else f"{', '.join(entries[:most])} and {rest} more"


def _drawn_together(names: Iterable[str], number: re.Pattern[str]) -> list[str]:
    """Names that differ in this number only share an entry, where the first of them stood."""
    entries: dict[tuple[str, str] | str, list[int]] = {}
    for name in names:
        found = number.match(name)
        if found:
            entries.setdefault((found[1], found[3]), []).append(int(found[2]))
        else:
            entries[name] = []
    return [
        text
        for key, numbers in entries.items()
        for text in ([key] if isinstance(key, str) else [f"{key[0]}[{run}]{key[1]}" for run in _runs(numbers)])
    ]


def _runs(numbers: Sequence[int]) -> list[str]:
    runs: list[list[int]] = []
    for n in sorted(set(numbers)):
        if runs and n == runs[-1][-1] + 1:
            runs[-1].append(n)
        else:
            runs.append([n])
    return [str(run[0]) if len(run) == 1 else f"{run[0]}...{run[-1]}" for run in runs]


def entry_names(name: str, rows: int, columns: int = 1) -> tuple[str, ...]:
    """Names of the entries of a vector or matrix, column by column: `q` for one, `q[0]`, `q[1]` ..., `R[0,0]`, `R[1,0]` ..."""
    if rows * columns == 1:
        return (name,)
    return tuple(f"{name}[{i}]" if columns == 1 else f"{name}[{i},{j}]" for j in range(columns) for i in range(rows))


def nearest(name: str, known: Iterable[str]) -> str:
    """` Did you mean 'elbow.q'?`, or nothing where no known name is like it."""
    import difflib

    known = list(known)
    last = [k for k in known if k.rpartition(".")[2] == name]
    similar = last or difflib.get_close_matches(name, known, n=3)
    return f" Did you mean {' or '.join(repr(k) for k in similar[:3])}?" if similar else ""


def numbers(values: Sequence[float] | np.ndarray, most: int) -> str:
    """`0.3`, or `(0.3, 0, -1)`; of more than `most` the first ones."""
    shown = ", ".join(f"{v:.6g}" for v in values[:most])
    return shown if len(values) == 1 else f"({shown}{', …' if len(values) > most else ''})"


def counted(count: int, word: str) -> str:
    """`1 state`, `2 states`."""
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def grouped(rows: Sequence[tuple[str, str]], width: int = 24) -> list[str]:
    """Lines `name   text` of a table; rows with the same text are drawn together, in the order of their first names."""
    by_text: dict[str, list[str]] = {}
    for name, text in rows:
        by_text.setdefault(text, []).append(name)
    return [
        f"  {compact(names):<{width}} {text}" + (f" (each of {len(names)})" if len(names) > 1 else "")
        for text, names in by_text.items()
    ]


def shortened(lines: Sequence[str], most: int = 20) -> list[str]:
    """The first `most` lines, and how many follow."""
    return list(lines[:most]) + ([f"  and {len(lines) - most} more"] if len(lines) > most else [])


def callers_level() -> int:
    """The `stacklevel` at which `warnings.warn`, called by the caller of this, points at the first line outside of this package and of the catalogue."""
    frame, level = sys._getframe(1), 1  # pyright: ignore[reportPrivateUsage]  # the documented way to walk the stack
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] in (__package__, "components", "functools"):
        frame, level = frame.f_back, level + 1
    return level
