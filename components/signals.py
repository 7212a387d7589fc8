"""Signals: numbers that flow from outputs to inputs, without power. Sources, blocks of control, sensors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, final

import casadi as ca
import numpy as np

import acausal.language.expression as language
from acausal.errors import ParameterError
from acausal.language.component import Component
from acausal.language.connector import Rotational, Signal, Translational
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Expression, Scalar, Variable, scalar
from acausal.language.origin import origin

_UNFED = "An input needs a value: connect it to an output, e.g. of a Constant."
_NOTHING = "It measures nothing: connect it to a flange."


@final
class Constant(Component):
    """output = value, a number, parameter or input.

    scene.target = Constant(0.5)
    """

    output = Signal.port()

    def __init__(self, value: Scalar) -> None:
        self.value = scalar(value, "Constant's value")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.output.value, self.value)


@final
class TimeFunction(Component):
    """output = function(t), t in seconds; with numpy's or CasADi's functions.

    scene.target = TimeFunction(lambda t: 0.5 * np.sin(2 * t))
    """

    output = Signal.port()

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.value = scalar(language.of_time(function), "TimeFunction's function")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.output.value, self.value)


@final
class Table(Component):
    """output = the value for this input, on straight lines between `points` (n,), which rise, with `values` (n,); the outer lines go on.

    Raises `ParameterError` for fewer than two points, points that do not rise, or as many values.

    scene.clock, scene.plan = TimeFunction(lambda t: t), Table((0.0, 1.0, 2.0), (0.0, 0.5, 0.5))
    """

    input = Signal.port(must_connect=True, if_unconnected=_UNFED)
    output = Signal.port()

    def __init__(self, points: Sequence[float], values: Sequence[float]) -> None:
        try:
            self.points, self.values = np.asarray(points, dtype=float), np.asarray(values, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(f"Table takes two lists of numbers, not {points!r} and {values!r} ({origin()}).") from None
        if self.points.ndim != 1 or self.points.size < 2 or self.points.shape != self.values.shape:
            raise ParameterError(
                f"Table needs two or more points and as many values, not {self.points.size} and {self.values.size} ({origin()})."
            )
        if not np.isfinite([self.points, self.values]).all() or np.any(np.diff(self.points) <= 0):
            raise ParameterError(
                f"Table's points must rise and all be finite, not {self.points} with {self.values} ({origin()})."
            )

    def equations(self) -> Iterable[Equation]:
        value = ca.pw_lin(self.input.value.sx, ca.DM(self.points), ca.DM(self.values))
        yield equal(self.output.value, Expression(value, self.input.value.leaves))


@final
class Gain(Component):
    """output = factor input.

    scene.amplifier = Gain(10.0)
    """

    input = Signal.port(must_connect=True, if_unconnected=_UNFED)
    output = Signal.port()

    def __init__(self, factor: Scalar) -> None:
        self.factor = scalar(factor, "Gain's factor")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.output.value, self.factor * self.input.value)


@final
class Sum(Component):
    """output = weights[0] inputs[0] + weights[1] inputs[1] + ...; a difference has the weights 1, -1.

    scene.error = Sum(1.0, -1.0); scene.connect(scene.target.output, scene.error.inputs[0])
    """

    output = Signal.port()

    def __init__(self, *weights: Scalar) -> None:
        if not weights:
            raise ParameterError(f"Sum needs a weight for each input, e.g. Sum(1.0, -1.0) ({origin()}).")
        self.weights = [scalar(weight, "Sum's weight") for weight in weights]
        inputs: list[Signal] = []
        for k in range(len(weights)):
            port = Signal(self, f"input_{k}", must_connect=True, if_unconnected=_UNFED)
            setattr(self, port.name, port)
            inputs.append(port)
        self.inputs = tuple(inputs)

    def equations(self) -> Iterable[Equation]:
        total: Scalar = 0.0
        for weight, port in zip(self.weights, self.inputs, strict=True):
            total = total + weight * port.value
        yield equal(self.output.value, total)


@final
class Integrator(Component):
    """der(x) = factor input, output = x; `x.start` is the value at the start unless told otherwise.

    scene.position = Integrator()
    """

    input = Signal.port(must_connect=True, if_unconnected=_UNFED)
    output = Signal.port()
    x = Variable("", "integral")

    def __init__(self, factor: Scalar = 1.0) -> None:
        self.factor = scalar(factor, "Integrator's factor")

    def equations(self) -> Iterable[Equation]:
        yield equal(der(self.x), self.factor * self.input.value)
        yield equal(self.output.value, self.x)


@final
class PID(Component):
    """Controller: output = proportional e + integral x + derivative (e - f) / filter_time, with the error e = setpoint - measurement.

    der(x) = e; der(f) = (e - f) / filter_time, so that the derivative acts below the frequency 1 / filter_time [s] > 0. Terms that are plain
    zeros need no state. K. J. Astrom & T. Hagglund, PID Controllers (1995), eq. 3.16 (with filter_time = T_d / N).

    scene.controller = PID(proportional=20.0, integral=5.0, derivative=1.0)
    """

    setpoint = Signal.port(must_connect=True, if_unconnected=_UNFED)
    measurement = Signal.port(must_connect=True, if_unconnected=_UNFED)
    output = Signal.port()
    x = Variable("", "integral of the error")
    f = Variable("", "error, smoothed")

    def __init__(
        self, proportional: Scalar, integral: Scalar = 0.0, derivative: Scalar = 0.0, *, filter_time: Scalar = 0.01
    ) -> None:
        self.proportional = scalar(proportional, "PID's proportional gain")
        self.integral = scalar(integral, "PID's integral gain")
        self.derivative = scalar(derivative, "PID's derivative gain")
        self.filter_time = scalar(filter_time, "PID's filter_time", positive=True, unit="s")

    def equations(self) -> Iterable[Equation]:
        error = self.setpoint.value - self.measurement.value
        yield equal(der(self.x), error) if not _zero(self.integral) else equal(self.x, 0.0)
        yield equal(self.filter_time * der(self.f), error - self.f) if not _zero(self.derivative) else equal(self.f, 0.0)
        output = self.proportional * error + self.integral * self.x
        if not _zero(self.derivative):
            output = output + self.derivative / self.filter_time * (error - self.f)
        yield equal(self.output.value, output)


def _zero(value: float | Expression) -> bool:
    return not isinstance(value, Expression) and value == 0.0


@final
class RotationSensor(Component):
    """Measures a shaft without a torque: angle = phi [rad], speed = der(phi) [rad/s].

    scene.encoder = RotationSensor(); scene.connect(scene.hinge.flange, scene.encoder.flange)
    """

    flange = Rotational.port(must_connect=True, if_unconnected=_NOTHING)
    angle = Signal.port()
    speed = Signal.port()

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.tau, 0.0)
        yield equal(self.angle.value, self.flange.phi)
        yield equal(self.speed.value, der(self.flange.phi))


@final
class TranslationSensor(Component):
    """Measures a slider without a force: position = s [m], speed = der(s) [m/s].

    scene.scale = TranslationSensor(); scene.connect(scene.rail.flange, scene.scale.flange)
    """

    flange = Translational.port(must_connect=True, if_unconnected=_NOTHING)
    position = Signal.port()
    speed = Signal.port()

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.f, 0.0)
        yield equal(self.position.value, self.flange.s)
        yield equal(self.speed.value, der(self.flange.s))


@final
class SignalTorque(Component):
    """A torque given by a signal: tau = -signal, so that a positive one [N*m] drives the flange forward. Supplies signal der(phi).

    scene.drive = SignalTorque(); scene.connect(scene.controller.output, scene.drive.signal)
    """

    flange = Rotational.port(must_connect=True, if_unconnected="It drives nothing: connect it to a joint's flange or an inertia.")
    signal = Signal.port(must_connect=True, if_unconnected=_UNFED)

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.tau, -self.signal.value)

    def supplied_power(self) -> Expression:
        return self.signal.value * der(self.flange.phi)


@final
class SignalForce(Component):
    """A force given by a signal: f = -signal, so that a positive one [N] drives the flange forward. Supplies signal der(s).

    scene.drive = SignalForce(); scene.connect(scene.controller.output, scene.drive.signal)
    """

    flange = Translational.port(must_connect=True, if_unconnected="It drives nothing: connect it to a joint's flange or a mass.")
    signal = Signal.port(must_connect=True, if_unconnected=_UNFED)

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.f, -self.signal.value)

    def supplied_power(self) -> Expression:
        return self.signal.value * der(self.flange.s)
