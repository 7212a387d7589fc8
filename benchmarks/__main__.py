"""Run all measurements on one core."""

import os

from benchmarks import chains, integrators

if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
chains.run()
integrators.run()
