"""Error against time of other programs on the benchmark scenes, on one core.

python -m benchmarks.peers [scene ...] [--peer name ...] [--out points.json]
"""

from benchmarks.one_core import one_core
from benchmarks.peers.table import main

if __name__ == "__main__":
    one_core()
    main()
