"""Parts that mean something at some places only."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from acausal.language.expression import Expression


class AbstractBounded(ABC):
    """A force or a span that has no meaning everywhere; joints say the same by their `domain`. Must provide `inside`.

    A start outside is refused, runs tell where a motion has left it.
    """

    if_outside: ClassVar[str] = ""
    """Sentences for the user, why it must be inside and what to try."""

    @abstractmethod
    def inside(self) -> Expression:
        """Positive inside, (k, 1), an expression of places, without unit and of size 1 well inside. Empty where that is everywhere."""
