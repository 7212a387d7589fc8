"""Linear algebra on one thread. Matrices of mechanisms are small: on several threads BLAS waits longer than it works, many times as long where other
processes are busy, and what a sum comes to in its last bits would depend on the number of processors.
"""

from __future__ import annotations

import ctypes
import functools
import sys
import threading
from collections.abc import Callable
from types import TracebackType
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_NAMES = ("scipy_openblas_{}_num_threads64_", "openblas_{}_num_threads64_", "openblas_{}_num_threads")
"""Of OpenBLAS in numpy's wheels since 2.0, in those before, and elsewhere."""


@functools.cache
def _threads() -> tuple[Callable[[], int], Callable[[int], None]] | None:
    """How many threads numpy's BLAS uses, and what changes it; None where it is not known how."""
    path = getattr(sys.modules.get("numpy.linalg._umath_linalg"), "__file__", None)
    try:
        library = ctypes.CDLL(path) if path else None
    except OSError:
        return None
    for name in _NAMES:
        get, change = (getattr(library, name.format(what), None) for what in ("get", "set"))
        if get is not None and change is not None:
            get.restype, get.argtypes, change.restype, change.argtypes = ctypes.c_int, [], None, [ctypes.c_int]
            return get, change
    return None


class _OneThread:
    """As long as anybody is within, in whatever thread."""

    def __init__(self) -> None:
        self._lock, self._within, self._before = threading.Lock(), 0, 1

    def __call__(self, function: Callable[P, T]) -> Callable[P, T]:
        """The function, within."""

        @functools.wraps(function)
        def within(*given: P.args, **named: P.kwargs) -> T:
            with self:
                return function(*given, **named)

        return within

    def __enter__(self) -> None:
        found = _threads()
        with self._lock:
            self._within += 1
            if self._within == 1 and found is not None:
                self._before = found[0]()
                found[1](1)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        found = _threads()
        with self._lock:
            self._within -= 1
            if not self._within and found is not None:
                found[1](self._before)


on_one_thread = _OneThread()
"""Around functions, or in `with`; may be nested."""
