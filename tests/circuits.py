"""Circuits whose parts stand between numbered nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import acausal as ac
from components import Capacitor, ElectromotiveForce, Ground, IdealDiode, Inductor, Resistor, VoltageSource


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


def element(kind: str, value: float, phase: float, V: float, R: float, T: float) -> Any:
    """One of a drawn circuit, by its letter (V, D, R, C, L or M: a machine), which has voltages, resistances and times of these sizes; about one of these is its `value`."""
    if kind == "V":
        return VoltageSource(V * value * np.sin(5 / T * ac.time + phase))
    if kind == "D":
        return IdealDiode(resistance=1e-3 * R * value)
    if kind == "M":
        return ElectromotiveForce(0.7 * V * T * value)
    if kind == "R":
        return Resistor(R * value)
    return Capacitor(0.3 * value * T / R) if kind == "C" else Inductor(0.3 * value * T * R)


def check_diodes(run: Any, elements: Sequence[Any], V: float, known: float = 1e-12) -> float:
    """Nothing flows backwards through those among them, and nothing is lost forwards but by their resistance, but for what is `known` of currents. The largest of these."""
    most = max(np.abs(run[one.i]).max() for one in elements)
    for diode in (one for one in elements if isinstance(one, IdealDiode)):
        current, over = run[diode.current], run[diode.v] - diode.resistance * run[diode.current]
        volts = max(V, float(np.abs(run[diode.v]).max()))
        assert current.min() >= -known * most
        assert over.max() <= 1e-12 * volts
        assert np.abs(current * over).max() <= known * most * volts
    return float(most)
