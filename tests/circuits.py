"""Circuits whose parts stand between numbered nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import acausal as ac
from components import Ground


def between_nodes(parts: Sequence[Any], ends: Sequence[Any], nodes: int, order: np.random.Generator | None) -> Any:
    """Each part with its pins at its two `ends`; node 0 is grounded. `order`: in which they are declared, as they are given unless drawn."""
    scene: Any = ac.System()
    scene.ground = Ground()
    scene.elements = list(parts) if order is None else [parts[k] for k in order.permutation(len(parts))]
    for node in range(nodes):
        pins = [
            pin
            for part, pair in zip(parts, ends, strict=True)
            for pin, end in zip((part.pin_a, part.pin_b), pair, strict=True)
            if end == node
        ]
        scene.connect(*([scene.ground.pin] if node == 0 else []), *pins)
    return scene
