"""Time series as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acausal.errors import OptionError
from acausal.visual.animation import PALETTE
from acausal.visual.pyplot import new_figure, plain, saved

_MOST_LABELS = 14
_MOST_STRIPS = 8
_WORDS = {
    "open": "#dfe4ea", "off": "#dfe4ea", "closed": "#4C78A8", "sticks": "#54A24B", "slides +": "#F58518", "slides -": "#EECA3B", "slides": "#F58518"
}  # fmt: skip


@dataclass(frozen=True)
class Strip:
    """What a part was doing: `words` (n,) from each of the times `begins` (n,) [s] on; at `blows` (m,) it was struck."""

    name: str
    begins: np.ndarray
    words: tuple[str, ...]
    blows: np.ndarray


def plot_series(
    times: np.ndarray,
    series: Sequence[tuple[str, np.ndarray]],
    *,
    path: str | Path | None = None,
    title: str | None = None,
    strips: Sequence[Strip] = (),
) -> Any:
    """Series (n,) or (n, k), each with a label, over times (n,) [s], above the first of the `strips`; returns the matplotlib figure, written to `path` if given.

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
    lowest = _draw_strips(figure, axes, strips[:_MOST_STRIPS], float(times[-1])) if strips else axes
    lowest.set_xlabel("time [s]")
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


def _draw_strips(figure: Any, axes: Any, strips: Sequence[Strip], end: float) -> Any:
    """Under the axes, a row for each; returns their axes."""
    grid = figure.add_gridspec(2, 1, height_ratios=(1.0, 0.05 + 0.055 * len(strips)), hspace=0.02)
    axes.set_subplotspec(grid[0])
    axes.tick_params(labelbottom=False)
    below = figure.add_subplot(grid[1], sharex=axes)
    shown: dict[str, Any] = {}
    for k, strip in enumerate(strips):
        ends = np.append(strip.begins[1:], end)
        for word in dict.fromkeys(strip.words):
            some = [j for j, own in enumerate(strip.words) if own == word]
            spans = [(strip.begins[j], ends[j] - strip.begins[j]) for j in some]
            shown[word] = below.broken_barh(spans, (k - 0.38, 0.76), facecolors=_WORDS[word], linewidth=0)
        below.vlines(strip.blows, k - 0.38, k + 0.38, colors="#d1495b", linewidth=0.9)
    below.set_yticks(range(len(strips)), [plain(strip.name) for strip in strips], fontsize=8)
    below.set_ylim(len(strips) - 0.5, -0.5)
    below.tick_params(axis="y", length=0)
    below.spines[["top", "right", "left"]].set_visible(False)
    below.legend(
        shown.values(), shown.keys(), frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), handlelength=1.0
    )
    return below
