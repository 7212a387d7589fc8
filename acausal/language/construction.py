"""Arguments with which a part is made: what fits its constructor, and what is said where they do not."""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from acausal.errors import ParameterError
from acausal.language.origin import ASKED, origin

T = TypeVar("T")


def check_arguments(cls: type, args: Sequence[Any], kwargs: Mapping[str, Any]) -> None:
    """Raise `ParameterError` where `cls(*args, **kwargs)` names, misses or repeats arguments; it names the nearest one that there is."""
    _check(cls, cls.__name__, cls.__init__, None, args, kwargs)


def check_makers(cls: type) -> None:
    """Lets the class methods of a class, such as `RigidBody.rod`, raise `ParameterError` in the same way."""
    for name, made in list(vars(cls).items()):
        if isinstance(made, classmethod) and not name.startswith("_"):
            setattr(cls, name, classmethod(_checked(made.__func__)))


def checked_arguments(cls: type[T]) -> type[T]:
    """A class that is no part, with the same words for wrong arguments of its constructors."""
    made: Callable[..., None] = _without_arguments if cls.__init__ is object.__init__ else cls.__init__

    @functools.wraps(made)
    def __init__(self: Any, *args: Any, **kwargs: Any) -> None:
        _check(cls, cls.__name__, made, None, args, kwargs)
        made(self, *args, **kwargs)

    cls.__init__ = __init__
    check_makers(cls)
    return cls


def _without_arguments(_: object) -> None:
    """Of a class without a constructor."""


def checked_new(maker: Callable[..., Any]) -> Callable[..., Any]:
    """`__new__` of a part that is a part of another kind for some arguments, with the same words for wrong ones."""

    @functools.wraps(maker)
    def make(cls: type, *args: Any, **kwargs: Any) -> Any:
        _check(cls, cls.__name__, maker, cls, args, kwargs)
        return maker(cls, *args, **kwargs)

    return make


def _checked(maker: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(maker)
    def make_by_method(cls: type, *args: Any, **kwargs: Any) -> Any:
        _check(cls, f"{cls.__name__}.{maker.__name__}", maker, cls, args, kwargs)
        _asked: list[Any] = []  # by the method, see `asked_while_made`
        made = maker(cls, *args, **kwargs)
        if _asked:
            vars(made).setdefault(ASKED, [])[:0] = _asked  # it was asked first
        return made

    return make_by_method


@functools.cache
def _signature(maker: Callable[..., Any]) -> inspect.Signature:
    return inspect.signature(maker)


def _check(cls: type, name: str, maker: Callable[..., Any], first: Any, args: Sequence[Any], kwargs: Mapping[str, Any]) -> None:
    taken = _signature(maker)
    try:
        taken.bind(first, *args, **kwargs)
    except TypeError as error:
        parameters = [*taken.parameters.values()][1:]
        unknown = [key for key in kwargs if key not in taken.parameters]
        reason = f"it has no argument '{unknown[0]}'" if unknown else f"{error}"
        shown = ", ".join(_declared(p) for p in parameters)
        given = _given((), {key: kwargs[key] for key in unknown}) if unknown else _given(args, kwargs)
        hint = vars(cls).get("if_given_arguments", "")
        raise ParameterError(
            f"{name}({given}) ({origin()}): {reason}.{_nearest(cls, unknown)} It takes {name}({shown}).{hint and ' ' + hint}"
        ) from None


def _declared(p: inspect.Parameter) -> str:
    """As it stands in the definition, without its type."""
    return str(p.replace(annotation=p.empty)).replace(" = ", "=")


def _given(args: Sequence[Any], kwargs: Mapping[str, Any], most: int = 80) -> str:
    text = ", ".join([*(repr(a) for a in args), *(f"{name}={value!r}" for name, value in kwargs.items())])
    text = " ".join(text.split())
    return text if len(text) <= most else text[: most - 2] + " …"


def _nearest(cls: type, unknown: Sequence[str]) -> str:
    """The argument that is spelt most like an unknown one, in words: of its constructor, or of a named one such as `RigidBody.rod`."""
    for maker in (cls, *(m for name, m in inspect.getmembers(cls, inspect.ismethod) if not name.startswith("_"))):
        similar = difflib.get_close_matches(unknown[0], [*inspect.signature(maker).parameters], n=1) if unknown else []
        if similar:
            return f" Did you mean '{similar[0]}'?"
    return ""
