"""Time series as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from acausal.visual.animation import PALETTE
from acausal.visual.pyplot import new_figure, saved


def plot_series(
    times: np.ndarray, series: Sequence[tuple[str, np.ndarray]], *, path: str | Path | None = None, title: str = ""
) -> Any:
    """Series (n,) or (n, k), each with a label, over times (n,) [s]; returns the matplotlib figure."""
    figure, axes = new_figure(8.0, 4.5)
    colour = 0
    for label, values in series:
        columns = np.asarray(values).reshape(len(times), -1)
        for k in range(columns.shape[1]):
            name = label if columns.shape[1] == 1 else f"{label} {'xyz'[k] if columns.shape[1] == 3 else k}"
            axes.plot(times, columns[:, k], label=name, color=PALETTE[colour % len(PALETTE)], linewidth=1.6)
            colour += 1
    axes.set_xlabel("time [s]")
    axes.set_title(title, loc="left", fontsize=11)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0)
    if series:
        axes.legend(frameon=False)
    return saved(figure, path)
