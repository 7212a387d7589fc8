"""Workers of pytest have a core each: threads of linear algebra in each would wait for one another."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when numpy is first imported
