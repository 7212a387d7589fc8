"""Reference values of the scenes, in extended precision: extrapolated midpoint rule on the equations by hand.

    python -m benchmarks.peers.reference [scene ...]

prints what `benchmarks/scenes.py` holds, and how far two step sizes differ.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.peers.equations import Equations, equations, gauss

COLUMNS = 8
_STEPS = {  # numbers of steps: coarse, and fine
    "double_pendulum": (150, 200), "top": (1400, 1800), "chain": (150, 200), "four_bar": (2400, 3200), "andrews": (250, 350),
    "disk": (600, 800), "spring_pendulum": (900, 1200),
}  # fmt: skip


def extrapolated_step(by_hand: Equations, y: np.ndarray, h: np.longdouble) -> np.ndarray:
    """One step of the explicit midpoint rule with 2, 4 ... 2 COLUMNS substeps, extrapolated to order 2 COLUMNS (Gragg)."""

    def rate(z: np.ndarray) -> np.ndarray:
        return by_hand.rate(z, np, gauss)

    first = rate(y)
    counts = [2 * (j + 1) for j in range(COLUMNS)]
    table: list[np.ndarray] = []
    for n in counts:
        s = h / n
        before, now = y, y + s * first
        for _ in range(n - 1):
            before, now = now, before + 2 * s * rate(now)
        table.append((before + now + s * rate(now)) / 2)
    for k in range(1, COLUMNS):
        for j in range(COLUMNS - 1, k - 1, -1):
            table[j] = table[j] + (table[j] - table[j - 1]) / ((np.longdouble(counts[j]) / counts[j - k]) ** 2 - 1)
    return table[-1]


def solution(by_hand: Equations, end: float, steps: int) -> np.ndarray:
    """The state at `end`, in longdouble."""
    y = by_hand.start()
    h = np.longdouble(str(end)) / steps
    for _ in range(steps):
        y = extrapolated_step(by_hand, y, h)
    return y


def main(names: list[str]) -> None:
    """Print the observed values of the scenes."""
    from benchmarks.scenes import SCENES

    for scene in SCENES:
        if names and scene.name not in names:
            continue
        by_hand = equations(scene.name)
        coarse, fine = (by_hand.observed(solution(by_hand, scene.end, n)) for n in _STEPS[scene.name])
        print(f"{scene.name}: two step sizes differ by {np.max(np.abs(fine - coarse)):.1e}")
        print("    " + ", ".join(np.format_float_positional(v, unique=False, precision=19) for v in fine))


if __name__ == "__main__":
    main(sys.argv[1:])
