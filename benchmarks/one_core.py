"""One core for this process."""

from __future__ import annotations

import os


def one_core() -> None:
    """The first of those that it may use."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
