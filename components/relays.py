"""Parts that remember: relays, thermostats, samplers, ratchets; and limiters. What they remember is constant until an event sets it."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.component import Component
from acausal.language.connector import Signal
from acausal.language.equation import Equation, equal
from acausal.language.expression import Discrete, Expression, Reaction, Scalar, flag, leaves, scalar, sx, time
from acausal.language.mode_laws import ModeLaw, OneSided
from acausal.language.origin import origin
from acausal.language.when import when
from components.contacts.laws import checked_restitution
from components.flanges import AbstractOnFlanges, Flange, asked

_UNFED = "An input needs a value: connect it to an output, e.g. of a sensor."


def _above(upper: float | Expression, lower: float | Expression, name: str) -> None:
    asked(upper - lower, functools.partial(_check_play, name=name))


def _check_play(play: float, name: str) -> None:
    if not play > 0:
        raise ParameterError(
            f"{name}'s upper bound is {play:g} above the lower one ({origin()}). Give lower < upper: without play it would chatter."
        )


def _check_order(play: float) -> None:
    if not play >= 0:
        raise ParameterError(f"Limiter's upper bound is {-play:g} below the lower one ({origin()}). Give lower <= upper.")


@final
class Relay(Component):
    """output = `on` from where the input rises above `upper` until it falls below `lower`, else `off`: a switch with hysteresis.

    `closed`: 1 while it is on, else 0. At the start by the input; between the bounds as `start` says (False: off). `lower` < `upper`.

        scene.relay = Relay(-0.1, 0.1, off=5.0, on=-5.0)
    """

    input = Signal.port(must_connect=True, if_unconnected=_UNFED)
    output = Signal.port()

    def __init__(self, lower: Scalar, upper: Scalar, *, off: Scalar = 0.0, on: Scalar = 1.0, start: bool = False) -> None:
        self.lower, self.upper = scalar(lower, "Relay's lower"), scalar(upper, "Relay's upper")
        self.off, self.on = scalar(off, "Relay's off"), scalar(on, "Relay's on")
        _above(self.upper, self.lower, "Relay")
        self.closed = Discrete(
            "", "1 while it is on", start=_step(self.input.value, self.lower, self.upper, float(flag(start, "Relay's start")))
        )

    def equations(self) -> Iterable[Equation]:
        yield equal(self.output.value, self.off + self.closed * (self.on - self.off))

    def laws(self) -> Iterable[ModeLaw]:
        yield when(self.input.value - self.upper, "rising", set={self.closed: 1.0})
        yield when(self.input.value - self.lower, "falling", set={self.closed: 0.0})


@final
class Thermostat(Component):
    """output = `power` from where the input falls below `lower` until it rises above `upper`, else 0.

    `heats`: 1 while it is on, else 0. At the start by the input; between the bounds as `start` says (True: on). `lower` < `upper`.

        scene.thermostat = Thermostat(292.0, 295.0, power=2e3)
    """

    input = Signal.port(must_connect=True, if_unconnected=_UNFED)
    output = Signal.port()

    def __init__(self, lower: Scalar, upper: Scalar, power: Scalar = 1.0, *, start: bool = True) -> None:
        self.lower, self.upper = scalar(lower, "Thermostat's lower"), scalar(upper, "Thermostat's upper")
        self.power = scalar(power, "Thermostat's power")
        _above(self.upper, self.lower, "Thermostat")
        self.heats = Discrete(
            "",
            "1 while it is on",
            start=1.0 - _step(self.input.value, self.lower, self.upper, 1.0 - float(flag(start, "Thermostat's start"))),
        )

    def equations(self) -> Iterable[Equation]:
        yield equal(self.output.value, self.power * self.heats)

    def laws(self) -> Iterable[ModeLaw]:
        yield when(self.input.value - self.lower, "falling", set={self.heats: 1.0})
        yield when(self.input.value - self.upper, "rising", set={self.heats: 0.0})


@final
class Limiter(Component):
    """output = input, as far as it lies between `lower` and `upper`, else the bound that is nearer: saturation.

    scene.limiter = Limiter(-10.0, 10.0)
    """

    input = Signal.port(must_connect=True, if_unconnected=_UNFED)
    output = Signal.port()

    def __init__(self, lower: Scalar, upper: Scalar) -> None:
        self.lower, self.upper = scalar(lower, "Limiter's lower"), scalar(upper, "Limiter's upper")
        asked(self.upper - self.lower, _check_order)

    def equations(self) -> Iterable[Equation]:
        value = ca.fmin(ca.fmax(self.input.value.sx, sx(self.lower)), sx(self.upper))
        yield equal(self.output.value, Expression(value, leaves(self.input.value, self.lower, self.upper)))


@final
class SampleAndHold(Component):
    """output = what the input was at the last of the times 0, `period`, 2 `period`, ... [s] and at the start: a zero-order hold.

    `held`: the value; `count`: of periods that are over. Samples are taken just before anything changes in that instant.

        scene.sampler = SampleAndHold(0.01)
    """

    input = Signal.port(must_connect=True, if_unconnected=_UNFED)
    output = Signal.port()

    def __init__(self, period: Scalar) -> None:
        self.period = scalar(period, "SampleAndHold's period", positive=True, unit="s")
        self.held = Discrete("", "the last sample", start=1.0 * self.input.value)
        self.count = Discrete("", "periods that are over", start=np.floor(time / self.period))  # pyright: ignore[reportArgumentType]  # an expression

    def equations(self) -> Iterable[Equation]:
        yield equal(self.output.value, self.held)

    def laws(self) -> Iterable[ModeLaw]:
        yield when(
            time - (self.count + 1.0) * self.period, "rising", set={self.held: self.input.value, self.count: self.count + 1.0}
        )


@final
class Ratchet(AbstractOnFlanges):
    """flange_b moves forward against flange_a, and back no further than to the last tooth that it has passed; teeth are `pitch` apart [m or rad] > 0.

    `tooth`: its number; `push` [N or N*m] >= 0 drives flange_b forward and flange_a back. What falls back on a tooth strikes it with `restitution` (0 ... 1).

        scene.ratchet = Ratchet(scene.base.flange, scene.drum.flange_a, pitch=0.1)
    """

    def __init__(self, flange_a: Flange, flange_b: Flange, pitch: Scalar, restitution: Scalar = 0.0) -> None:
        self._take(flange_a=flange_a, flange_b=flange_b)
        self.pitch = scalar(pitch, "Ratchet's pitch", positive=True, unit="rad" if self.rotates else "m")
        self.restitution = checked_restitution(restitution, "Ratchet")
        self.push = Reaction(self.effort_unit, "what it drives flange_b forward with")
        self.tooth = Discrete("", "number of the last tooth", start=np.floor(self.moved / self.pitch))  # pyright: ignore[reportArgumentType]  # an expression

    def equations(self) -> Iterable[Equation]:
        yield from self._exerts(1.0 * self.push)

    def laws(self) -> Iterable[ModeLaw]:
        yield OneSided(self.push, self.moved - self.pitch * self.tooth, self.restitution)
        yield when(self.moved - self.pitch * (self.tooth + 1.0), "rising", set={self.tooth: self.tooth + 1.0})


def _step(value: Expression, lower: float | Expression, upper: float | Expression, between: float) -> Expression:
    """1 above, 0 below."""
    found = ca.if_else(value.sx >= sx(upper), 1.0, ca.if_else(value.sx <= sx(lower), 0.0, between))
    return Expression(found, leaves(value, lower, upper))
