"""Parameters of tests that are tried side by side."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

Names = str | tuple[str, ...]


def each_value(*parameters: tuple[Names, Iterable[Any]]) -> pytest.MarkDecorator:
    """Each value of each parameter (its name, or names, and values), beside changing ones of the others: as many tests as the longest list has values, and not all of their combinations."""
    names = [name for some, _ in parameters for name in (some.replace(" ", "").split(",") if isinstance(some, str) else some)]
    rows, lists = list[list[Any]](), [(some, list(values)) for some, values in parameters]
    for k in range(max(len(v) for _, v in lists)):
        own = [(some, v[(k + j * (k // len(v))) % len(v)]) for j, (some, v) in enumerate(lists)]
        rows.append([one for some, value in own for one in (value if isinstance(some, tuple) or "," in some else [value])])
    return pytest.mark.parametrize(names, rows)
