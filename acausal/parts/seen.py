"""What is seen of parts that things move along."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np


class AbstractSeenAlong(ABC):
    """A part with something to move along, seen as far as a motion comes. It has two connectors, frame_a and frame_b. Must provide `seen_along`."""

    @abstractmethod
    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Shapes fixed in frame_a, and shapes fixed in frame_b, where frame_b's origin comes to `places` (n, 3) [m] of frame_a."""
