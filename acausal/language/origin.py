"""Where in the user's own code something was written, as `file:line`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import casadi
import numpy

_LIBRARY = (
    *(str(Path(__file__).resolve().parents[k]) + os.sep + tail for k, tail in ((1, ""), (2, "components" + os.sep))),
    *(str(Path(package.__file__ or "").parent) + os.sep for package in (casadi, numpy)),
    str(Path(numpy.__file__ or "").parents[1] / "scipy") + os.sep,
)


def origin() -> str:
    """The innermost line outside acausal, components, CasADi, numpy and scipy that led here, e.g. `examples/arm.py:17`; "" if there is none."""
    frame = sys._getframe(1)  # pyright: ignore[reportPrivateUsage]  # inspect.stack reads source files: 1000 times slower
    while frame is not None:
        name = frame.f_code.co_filename
        made_by_python = name.startswith("<frozen") or (name == "<string>" and frame.f_code.co_name == "__init__")  # a dataclass
        if not name.startswith(_LIBRARY) and not made_by_python:
            return f"{shortened(name)}:{frame.f_lineno}"
        frame = frame.f_back
    return ""


def line_of_new_part() -> str:
    """`origin()` while a part of the catalogue is being made there; "" at other times. Such a part remembers the same line."""
    catalogue, frame = _LIBRARY[1], sys._getframe(1)  # pyright: ignore[reportPrivateUsage]  # see above
    while frame is not None and frame.f_code.co_filename.startswith(_LIBRARY):
        if frame.f_code.co_filename.startswith(catalogue) and frame.f_code.co_name != "at":  # a frame is made later than its body
            return origin()
        frame = frame.f_back
    return ""


def shortened(name: str) -> str:
    """The path relative to the working directory where that is shorter."""
    try:
        relative = os.path.relpath(name)
    except (ValueError, OSError):  # another drive on Windows; a working directory that is gone
        return name
    return name if relative.startswith("..") else relative
