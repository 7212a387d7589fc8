"""Programs are made of hundreds of thousands of small objects, and no cycles worth a search: looking for some again and again would take a third of the time."""

from __future__ import annotations

import gc

from acausal.numerics.within import Within


class _Collector:
    """Off, and afterwards as before."""

    def __init__(self) -> None:
        self._before = True

    def begin(self) -> None:
        self._before = gc.isenabled()
        gc.disable()

    def end(self) -> None:
        if self._before:
            gc.enable()


_own = _Collector()
uncollected = Within(_own.begin, _own.end)
"""Around functions, or in `with`; may be nested."""
