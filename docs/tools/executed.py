"""Code that is run while a page is made."""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import tempfile
import warnings
from pathlib import Path
from typing import Any


def executed(
    code: str, space: dict[str, Any], drawn: str | None = None, picture: Path | None = None, raises: str | None = None
) -> str:
    """What the code prints, in an empty folder and with the names of `space`; its file `drawn` is kept as `picture`. Warnings are errors.

    `raises`: the kind of error that it must end with, whose message is printed.
    """
    printed, here = io.StringIO(), Path.cwd()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(), contextlib.redirect_stdout(printed):
        warnings.simplefilter("error")
        os.chdir(folder)
        try:
            exec(compile(code, "scene.py", "exec"), space)
        except Exception as error:
            if type(error).__name__ != raises:
                raise
            print(f"{type(error).__name__}: {error}")
        else:
            if raises is not None:
                raise RuntimeError(f"This block raises no {raises}:\n{code}")
        finally:
            os.chdir(here)
        if drawn is not None and picture is not None:
            shutil.copy(Path(folder) / drawn, picture)
    return printed.getvalue().rstrip()
