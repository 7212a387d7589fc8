"""Time series as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from acausal.errors import OptionError
from acausal.visual.animation import PALETTE
from acausal.visual.pyplot import new_figure, plain, saved

_MOST_LABELS = 14


def plot_series(
    times: np.ndarray, series: Sequence[tuple[str, np.ndarray]], *, path: str | Path | None = None, title: str | None = None
) -> Any:
    """Series (n,) or (n, k), each with a label, over times (n,) [s]; returns the matplotlib figure, written to `path` if given.

    Raises `OptionError` for a series of another length than `times`, `ImportError` without matplotlib.
    """
    curves: list[tuple[str, np.ndarray]] = []
    for label, values in series:
        array = np.asarray(values)
        if array.ndim not in (1, 2) or len(array) != len(times):
            raise OptionError(
                f"Series '{label}' has shape {array.shape}; expected ({len(times)},) or ({len(times)}, k): one row per time."
            )
        columns = array.reshape(len(times), -1).T
        names = [label] if len(columns) == 1 else [f"{label} {'xyz'[k] if len(columns) == 3 else k}" for k in range(len(columns))]
        curves += zip(names, columns, strict=True)
    figure, axes = new_figure(8.0, 4.5)
    for k, (label, values) in enumerate(curves):
        style = ("-", "--", ":")[k // len(PALETTE) % 3]
        axes.plot(times, values, label=plain(label), color=PALETTE[k % len(PALETTE)], linewidth=1.6, linestyle=style)
    axes.set_xlabel("time [s]")
    if len(curves) == 1:
        axes.set_ylabel(plain(curves[0][0]))
    axes.set_title(plain(title or ""), loc="left", fontsize=11)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0)
    if 1 < len(curves) <= _MOST_LABELS:
        axes.legend(frameon=False)
    elif len(curves) > 1:
        axes.legend(frameon=False, fontsize=7, ncols=1 + len(curves) // 25, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return saved(figure, path)
