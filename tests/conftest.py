"""Workers of pytest have a core each: threads of linear algebra in each would wait for one another. What is there before the first test stays."""

import gc
import os
import signal

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when numpy is first imported

signal.signal(
    signal.SIGINT, signal.default_int_handler
)  # shells have what runs in the background ignore it; tests interrupt themselves


def pytest_collection_finish() -> None:
    """Modules and tests are no garbage, and need not be looked at again and again, nor each scene while it is built: that takes a tenth of all time.

    Where workers take all processors there is none on which a compiler would work beside a run: it begins once it saves more than it takes.
    """
    from acausal.runtime import kernels

    kernels.WORTH = 2.0
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 10, 10)
