"""Building makes hundreds of thousands of small objects that last, and no cycles worth a search: looking for some again and again would cost a third of its time."""

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
