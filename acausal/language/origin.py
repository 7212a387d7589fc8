"""Where in the user's own code something was written, as `file:line`."""

from __future__ import annotations

import functools
import os
import sys
from pathlib import Path
from typing import Any

import casadi
import numpy

_LIBRARY = (
    *(str(Path(__file__).resolve().parents[k]) + os.sep + tail for k, tail in ((1, ""), (2, "components" + os.sep))),
    *(str(Path(package.__file__ or "").parent) + os.sep for package in (casadi, numpy)),
    str(Path(numpy.__file__ or "").parents[1] / "scipy") + os.sep,
)


ASKED, MAKER = "_asked", "make_by_method"
"""Where it is noted what a part asks of parameters, and what runs while a class method makes one."""


def origin() -> str:
    """The innermost line outside acausal, components, CasADi, numpy and scipy that led here, e.g. `examples/arm.py:17`; "" if there is none."""
    frame = sys._getframe(1)  # pyright: ignore[reportPrivateUsage]  # inspect.stack reads source files: 1000 times slower
    while frame is not None:
        name = frame.f_code.co_filename
        made_by_python = name == "<string>" and frame.f_code.co_name == "__init__"  # a dataclass
        if is_users(name) and not made_by_python:
            return f"{shortened(name)}:{frame.f_lineno}"
        frame = frame.f_back
    return ""


def is_users(name: str) -> bool:
    """Whether a file belongs to none of acausal, components, CasADi, numpy and scipy, nor to Python's own."""
    return not name.startswith((*_LIBRARY, "<frozen"))


def asked_while_made() -> list[list[Any]]:
    """What is asked by parts of the catalogue and what they are made of, as far as they are being made right now: lists of them, to be added to.

    What has no constructor of its own running, such as a frame that is asked of a body later, is not among them.
    """
    catalogue, frame, found = _LIBRARY[1], sys._getframe(1), list[list[Any]]()  # pyright: ignore[reportPrivateUsage]  # see above
    while frame is not None and frame.f_code.co_filename.startswith(_LIBRARY):
        name = frame.f_code.co_name
        if name in ("__init__", "__post_init__") and frame.f_code.co_filename.startswith(catalogue):
            found.append(vars(frame.f_locals["self"]).setdefault(ASKED, []))
        elif name == MAKER and ASKED in frame.f_locals:
            found.append(frame.f_locals[ASKED])
        frame = frame.f_back
    return found


def is_ingredient(value: object) -> bool:
    """Whether it is something of the catalogue that parts are made of, such as a law or a curve, and no part."""
    return type(value).__module__.startswith("components.") and hasattr(value, "__dict__") and not hasattr(value, "created_at")


def shortened(name: str) -> str:
    """The path relative to the working directory where that is shorter."""
    try:
        return _relative(name, os.getcwd())
    except (ValueError, OSError):  # another drive on Windows; a working directory that is gone
        return name


@functools.lru_cache(maxsize=64)
def _relative(name: str, folder: str) -> str:
    relative = os.path.relpath(name, folder)
    return name if relative.startswith("..") else relative
