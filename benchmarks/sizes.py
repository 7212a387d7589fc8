"""From a scene to its first simulated second: chains of links, nothing cached and cached, with time and memory."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

COUNTS = (2, 20, 100, 300, 1000)
_ONE = """
import resource, time
import acausal as ac
import casadi, numpy
from benchmarks.chains import chain
ac.build(chain(1)).simulate(0.1)  # imports
count = {count}
first = time.perf_counter()
scene = chain(count)
model = ac.build(scene)
built = time.perf_counter()
run = model.simulate(1.0, {{scene.joints[k].q: 0.1 * (k % 3) for k in range(count)}}, rtol=1e-6, samples=2)
done = time.perf_counter()
again = []
for _ in range(3):
    start = time.perf_counter()
    model.simulate(1.0, {{scene.joints[k].q: 0.1 * (k % 3) for k in range(count)}}, rtol=1e-6, samples=2)
    again.append(time.perf_counter() - start)
print(built - first, done - first, sorted(again)[1], resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, run.statistics.steps)
"""


def measure(count: int, cache: str, compiled: bool = True) -> list[float]:
    """Seconds to build, to the first second simulated, of the same again; megabytes; steps: in a process of its own."""
    code = _ONE.format(count=count)
    if not compiled:
        code = code.replace("rtol=1e-6", "rtol=1e-6, compiled=False")
    environment = os.environ | {"ACAUSAL_CACHE": cache}
    result = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parent.parent,
    )
    return [float(word) for word in result.stdout.split()]


def run(counts: tuple[int, ...] = COUNTS) -> None:
    """Print the table."""
    print("\nFrom scene to the first simulated second (imports apart), seconds")
    print(f"{'links':>6}{'build':>9}{'first':>9}{'cached':>9}{'machine':>9}{'again ms':>10}{'MB':>8}{'steps':>7}")
    with tempfile.TemporaryDirectory() as folder:
        measure(1, folder)  # the runtime itself, once for a machine
        for count in counts:
            fresh, cached = measure(count, folder), measure(count, folder)
            virtual = measure(count, folder, compiled=False) if count <= 100 else [0.0, float("nan")]
            print(
                f"{count:>6}{fresh[0]:>9.3f}{fresh[1]:>9.3f}{cached[1]:>9.3f}{virtual[1]:>9.3f}{1e3 * cached[2]:>10.2f}{fresh[3]:>8.0f}{int(fresh[4]):>7}",
                flush=True,
            )


if __name__ == "__main__":
    run()
