"""Run all measurements on one core."""

import os

from benchmarks import dynamics, integrators

if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
dynamics.run()
integrators.run()
