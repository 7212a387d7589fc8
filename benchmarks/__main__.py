"""Run all measurements: sizes on all cores, the rest on one. Writes out/speed.json and out/speed.png.

python -m benchmarks
"""

from __future__ import annotations

import os
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):  # read when numpy is imported
    os.environ[_name] = "1"
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.environ["JAX_PLATFORMS"] = "cpu"

from benchmarks import calls, compiler_flags, dynamics, growth, loops, plot, scene_sizes, sizes  # noqa: E402
from benchmarks.peers.table import main  # noqa: E402

sizes.run()
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
dynamics.run()
scene_sizes.run()
compiler_flags.main()
growth.run()
loops.run()
calls.run()
out = Path("out")
out.mkdir(exist_ok=True)
main(["--out", str(out / "speed.json")])
points = plot.read(out / "speed.json")
plot.draw(points, out / "speed.png")
print(plot.table(points))
