"""Arguments with which a part is made: what fits its constructor, and what is said where they do not."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Mapping, Sequence
from typing import Any

from acausal.errors import ParameterError
from acausal.language.origin import origin


def check_arguments(cls: type, args: Sequence[Any], kwargs: Mapping[str, Any]) -> None:
    """Raise `ParameterError` where `cls(*args, **kwargs)` names, misses or repeats arguments; it names the nearest one that there is."""
    taken = inspect.signature(cls.__init__)
    try:
        taken.bind(None, *args, **kwargs)
    except TypeError as error:
        parameters = [*taken.parameters.values()][1:]
        unknown = [name for name in kwargs if name not in taken.parameters]
        reason = f"it has no argument '{unknown[0]}'" if unknown else f"{error}"
        shown = ", ".join(p.name if p.default is p.empty else f"{p.name}={p.default!r}" for p in parameters)
        given = _given((), {name: kwargs[name] for name in unknown}) if unknown else _given(args, kwargs)
        raise ParameterError(
            f"{cls.__name__}({given}) ({origin()}): {reason}.{_nearest(cls, unknown)} It takes {cls.__name__}({shown})."
        ) from None


def _given(args: Sequence[Any], kwargs: Mapping[str, Any], most: int = 80) -> str:
    text = ", ".join([*(repr(a) for a in args), *(f"{name}={value!r}" for name, value in kwargs.items())])
    text = " ".join(text.split())
    return text if len(text) <= most else text[: most - 2] + " …"


def _nearest(cls: type, unknown: Sequence[str]) -> str:
    """The argument that is spelt most like an unknown one, in words: of its constructor, or of a named one such as `RigidBody.rod`."""
    for maker in (cls.__init__, *(m for name, m in inspect.getmembers(cls, inspect.ismethod) if not name.startswith("_"))):
        similar = difflib.get_close_matches(unknown[0], [*inspect.signature(maker).parameters], n=1) if unknown else []
        if similar:
            return f" Did you mean '{similar[0]}'?"
    return ""
