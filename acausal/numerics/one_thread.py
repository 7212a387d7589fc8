"""Linear algebra on one thread. Matrices of mechanisms are small: on several threads BLAS waits longer than it works, many times as long where other
processes are busy, and what a sum comes to in its last bits would depend on the number of processors.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from collections.abc import Callable

from acausal.numerics.within import Within

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


def _one() -> Callable[[], None]:
    """One, and what puts back as many as before."""
    found = _threads()
    if found is None:
        return lambda: None
    get, change = found
    before = get()
    change(1)
    return lambda: change(before)


on_one_thread = Within(_one)
"""Around functions, or in `with`; may be nested."""
