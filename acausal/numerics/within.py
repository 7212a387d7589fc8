"""What holds as long as anybody is within: around functions, or in `with`; may be nested, in whatever threads."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from types import TracebackType
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class Within:
    """`begin` when the first one enters, and what that has given when the last one leaves."""

    def __init__(self, begin: Callable[[], Callable[[], object]]) -> None:
        self._lock, self._within, self._begin = threading.Lock(), 0, begin
        self._end: Callable[[], object]

    def __call__(self, function: Callable[P, T]) -> Callable[P, T]:
        """The function, within."""

        @functools.wraps(function)
        def within(*given: P.args, **named: P.kwargs) -> T:
            with self:
                return function(*given, **named)

        return within

    def __enter__(self) -> None:
        with self._lock:
            self._within += 1
            if self._within == 1:
                self._end = self._begin()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        with self._lock:
            self._within -= 1
            if not self._within:
                self._end()
