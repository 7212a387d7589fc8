"""Programs are made of hundreds of thousands of small objects, and no cycles worth a search: looking for some again and again would take a third of the time."""

from __future__ import annotations

import gc
from collections.abc import Callable

from acausal.numerics.within import Within


def _off() -> Callable[[], None]:
    """Off, and what puts it back as before."""
    before = gc.isenabled()
    gc.disable()
    return gc.enable if before else lambda: None


uncollected = Within(_off)
"""Around functions, or in `with`; may be nested."""
