"""The pages can be read without a network."""

from __future__ import annotations

import re
from pathlib import Path

_LOADED = re.compile(
    r"<(?:script|img|iframe|source)\b[^>]*\bsrc=\"(?:https?:)?//|<link\b[^>]*rel=\"(?:stylesheet|preload|icon)\"[^>]*href=\"(?:https?:)?//"
)


def check_offline(folder: Path) -> None:
    """Raises `RuntimeError` for a page that would load something from elsewhere."""
    for page in folder.rglob("*.html"):
        found = _LOADED.search(page.read_text(encoding="utf-8"))
        if found:
            raise RuntimeError(
                f"{page.relative_to(folder)} loads something from the network: {found[0]}. Keep it in docs/static."
            )
