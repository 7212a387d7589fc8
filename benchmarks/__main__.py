"""Run all measurements: sizes on all cores, the rest on one. Writes out/speed.json and out/speed.png.

python -m benchmarks
"""

from __future__ import annotations

from pathlib import Path

from benchmarks import calls, compiler_flags, dynamics, growth, loops, plot, scene_sizes, sizes
from benchmarks.one_core import one_core
from benchmarks.peers import table


def main() -> None:
    """All of it."""
    sizes.run()
    one_core()
    dynamics.run()
    scene_sizes.run()
    compiler_flags.main()
    growth.run()
    loops.run()
    calls.run()
    out = Path("out")
    out.mkdir(exist_ok=True)
    table.main(["--out", str(out / "speed.json")])
    points = plot.read(out / "speed.json")
    plot.draw(points, out / "speed.png")
    print(plot.table(points))


if __name__ == "__main__":
    main()
