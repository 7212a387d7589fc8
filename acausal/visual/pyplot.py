"""matplotlib, imported when first needed and drawn without a screen."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from acausal.arguments import path_of


def new_figure(width: float, height: float) -> tuple[Any, Any]:
    """A figure and its axes [inches], not tied to any window. Raises `ImportError` with what to install."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ImportError("Plots and pictures need matplotlib: pip install 'acausal[plot]'") from None

    class Shown(Figure):
        """A figure that notebooks show, whichever backend they have."""

        def _repr_png_(self) -> bytes:
            buffer = io.BytesIO()
            self.savefig(buffer, format="png", dpi=110)
            return buffer.getvalue()

    figure = Shown(figsize=(width, height), layout="constrained")
    return figure, figure.add_subplot()


def plain(text: str) -> str:
    """Text as matplotlib shows it unchanged: no formulas between dollars, no hidden label for a leading underscore."""
    shown = text.replace("$", r"\$")
    return " " + shown if shown.startswith("_") else shown


def saved(figure: Any, path: str | Path | None) -> Any:
    """The figure, written to `path` if given."""
    if path is not None:
        target = path_of(path, "the picture's path")
        target.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(target, dpi=150)
    return figure
