"""What the compiler's flags cost on the machine at hand: the C driver alone, built with the flags of the package and with others.

python -m benchmarks.compiler_flags

The flags of the package should be within noise of the best row; where another row wins by half, `acausal.emit.compiler` is to change.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

from benchmarks.one_core import one_core

_SETS = ("-O1", "-O1 -fexpensive-optimizations", "-O2", "-O3")
_SCENES = ("double_pendulum", "top", "disk", "four_bar")


def main() -> None:
    """Print milliseconds of the driver at 1e-9, least of many, and seconds to compile a chain of 100 links, for each set of flags."""
    print(
        "| flags | "
        + " | ".join(f"{name} ms" for name in _SCENES)
        + " | compiling 100 links s |\n|"
        + "---|" * (len(_SCENES) + 2)
    )
    for flags in (None, *_SETS):
        row = subprocess.run(
            [sys.executable, "-m", "benchmarks.compiler_flags", "measure", flags or ""],
            capture_output=True,
            text=True,
            check=True,
        )
        print(f"| {flags or 'as shipped'} | {row.stdout.strip()} |", flush=True)


def measure(flags: str) -> None:
    """One row, in a process of its own with an empty cache."""
    import tempfile

    from acausal.emit import compiler

    one_core()
    if flags:
        compiler.FLAGS = (*flags.split(), *(flag for flag in compiler.FLAGS if not flag.startswith(("-O", "-fexpensive"))))
    with tempfile.TemporaryDirectory() as cache:
        os.environ["ACAUSAL_CACHE"] = cache
        row = [f"{driver_time(name):.3f}" for name in _SCENES] + [f"{compile_time(100):.1f}"]
    print(" | ".join(row))


def driver_time(name: str) -> float:
    """Milliseconds at 1e-9, least of many."""
    from benchmarks.peers.acausal_peer import Acausal
    from benchmarks.scenes import SCENES

    built = next(scene for scene in SCENES if scene.name == name).build()
    run = Acausal().prepare(built, "driver", 1e-9).run
    times: list[float] = []
    end = time.perf_counter() + 0.5
    while time.perf_counter() < end:
        begun = time.process_time_ns()
        run()
        times.append(1e-6 * (time.process_time_ns() - begun))
    return min(times)


def compile_time(links: int) -> float:
    """Seconds."""
    import acausal as ac
    from acausal.runtime.kernels import How
    from benchmarks.chains import chain

    functions = ac.build(chain(links)).functions
    begun = time.perf_counter()
    assert functions.native(How.COMPILED) is not None
    return time.perf_counter() - begun


if __name__ == "__main__":
    measure(sys.argv[2]) if sys.argv[1:2] == ["measure"] else main()
