"""What a peer is: a program or library that can run some of the scenes by itself."""

from __future__ import annotations

import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from benchmarks.scenes import Built

TOLERANCES = tuple(10.0**-k for k in (2, 3.5, 5, 6.5, 8, 9.5, 11, 12.5, 13.5))


@dataclass(frozen=True)
class Prepared:
    """`run()`: one whole run from the start to the end, what is timed; None if the integrator gave up. `values(result)`: the
    compared values."""

    run: Callable[[], Any]
    values: Callable[[Any], np.ndarray]


class AbstractPeer(ABC):
    """Must provide `methods`, `settings` and `prepare`; `name` and `module` (what must be importable)."""

    name: ClassVar[str]
    module: ClassVar[str]

    def available(self) -> bool:
        """Whether it is installed."""
        return importlib.util.find_spec(self.module) is not None

    @abstractmethod
    def methods(self, scene: str) -> tuple[str, ...]:
        """Its methods for the scene of this name; empty if it cannot do it."""

    @abstractmethod
    def refusal(self, scene: str) -> str:
        """Why it cannot do a scene; empty if it can."""

    def settings(self, scene: str, method: str) -> Sequence[float]:
        """Tolerances (relative and absolute) or steps [s], loosest first."""
        return TOLERANCES

    @abstractmethod
    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        """All that is done once: building, compiling."""
