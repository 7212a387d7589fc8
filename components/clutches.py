"""Clutches, brakes and freewheels: what holds two flanges together, or one still, as hard as it can."""

from __future__ import annotations

import functools
from abc import ABC
from collections.abc import Callable, Iterable
from typing import Any, final

import numpy as np

import acausal.language.expression as language
from acausal.errors import ParameterError
from acausal.language.equation import Equation
from acausal.language.expression import Expression, Parameter, Reaction, Scalar, scalar
from acausal.language.mode_laws import DryFriction, ModeLaw, OneWay
from acausal.language.origin import origin
from components.flanges import AbstractOnFlanges, Flange, asked, gate_of

Capacity = Scalar | Callable[[Any], Any]


class AbstractGrip(AbstractOnFlanges, ABC):
    """Dry friction against `speed`, as hard as it has to be, and at most so hard as it can.

    `grip` [N or N*m]: what it drives the flange forward with, flange_b where there are two.
    """

    def _hold(self, capacity: Capacity, holding: Capacity | None) -> None:
        name = type(self).__name__
        self.capacity = _limit(capacity, f"{name}'s capacity", self.effort_unit)
        self.holding = self.capacity if holding is None else _limit(holding, f"{name}'s holding", self.effort_unit)
        self.grip = Reaction(self.effort_unit, "what it drives forward with")
        if holding is not None:
            _not_below(self.holding, self.capacity, name)
            if not _adjustable_only(self.capacity):  # what it slips with may be nothing while it can hold still
                self.capacity = np.maximum(self.capacity, 0.0)  # pyright: ignore[reportAttributeAccessIssue]  # an expression for an expression

    @final
    def equations(self) -> Iterable[Equation]:
        yield from self._exerts(1.0 * self.grip)

    @final
    def laws(self) -> Iterable[ModeLaw]:
        yield DryFriction(self.grip, self.speed, self.capacity, self.holding)

    @final
    def dissipated_power(self) -> Expression:
        return -1.0 * self.grip * self.speed


@final
class Clutch(AbstractGrip):
    """Two flanges that rub on each other: held together by at most `holding`, slipping with `capacity` against the slip [N or N*m].

    `capacity` >= 0: constant, parameter, input (which may jump), function of time, or an expression of the scene; zero, or less by an input, is open.
    `holding` >= `capacity`, which it is unless given: what it takes to make it slip. `grip` drives flange_b forward and flange_a back. Dissipates
    capacity |speed_b - speed_a| while it slips, nothing while it holds.

        scene.pressure = ac.Input("Pa")
        scene.clutch = Clutch(scene.motor.flange_b, scene.load.flange_a, capacity=3e-4 * scene.pressure)
    """

    def __init__(self, flange_a: Flange, flange_b: Flange, capacity: Capacity, holding: Capacity | None = None) -> None:
        self._take(flange_a=flange_a, flange_b=flange_b)
        self._hold(capacity, holding)


@final
class Brake(AbstractGrip):
    """Dry friction at one flange, against what carries it: a joint's other part, or the ground. It holds with at most `holding`, and
    brakes with `capacity` [N or N*m], both as of a `Clutch`. `grip` drives the flange forward: against its speed.

        scene.brake = Brake(scene.wheel.flange, capacity=ac.Input("N*m"))
        scene.bearing = Brake(scene.hinge.flange, capacity=0.02, holding=0.03)
    """

    def __init__(self, flange: Flange, capacity: Capacity, holding: Capacity | None = None) -> None:
        self._take(flange=flange)
        self._hold(capacity, holding)


def _limit(value: Capacity, what: str, unit: str) -> float | Expression:
    """Checked; below zero is refused of numbers and parameters, and of others is as good as zero."""
    return scalar(language.of_time(value), what, non_negative=True, unit=unit)


def _adjustable_only(value: float | Expression) -> bool:
    """Whether its sign has been asked for: of numbers, and expressions of parameters."""
    return not isinstance(value, Expression) or all(isinstance(leaf, Parameter) for leaf in value.leaves)


def _not_below(holding: float | Expression, sliding: float | Expression, name: str) -> None:
    """Raises `ParameterError` where it holds with less than it slides with, also by the values of parameters."""
    asked(holding - sliding, functools.partial(_check_holding, name=name))


def _check_holding(more: float, name: str) -> None:
    if not more >= 0:
        raise ParameterError(
            f"{name}'s holding is {-more:g} below its capacity ({origin()}). What it takes to make it slip is at least what it slips with."
        )


@final
class Freewheel(AbstractOnFlanges):
    """flange_a drives flange_b forward and lets it run ahead: speed_b >= speed_a, and no torque while it is greater.

    `grip` >= 0 [N or N*m] drives flange_b forward and flange_a back. To engage at equal speeds is no impact. Where others strike, it takes part in the impact
    without bouncing, and so it does at the start where flange_b is slower. It loses no energy, except in impacts.

    `gate`: an input, or an expression of positions, velocities and time, that must be positive for it to engage, as a pawl; what holds goes on holding.

        scene.hub = Freewheel(scene.sprocket.flange_b, scene.wheel.flange_a)
    """

    def __init__(self, flange_a: Flange, flange_b: Flange, gate: Capacity | None = None) -> None:
        self._take(flange_a=flange_a, flange_b=flange_b)
        self.gate = None if gate is None else gate_of(gate, "Freewheel's gate")
        self.grip = Reaction(self.effort_unit, "what it drives flange_b forward with")

    def equations(self) -> Iterable[Equation]:
        yield from self._exerts(1.0 * self.grip)

    def laws(self) -> Iterable[ModeLaw]:
        yield OneWay(self.grip, self.speed, self.gate)
