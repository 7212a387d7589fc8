"""Electrical circuits: resistor, capacitor, inductor, diode, sources, ground, and the electromotive force that turns a shaft.

Potentials v [V] and currents i [A] into the component. A part with two pins has the voltage v = v_a - v_b and the current i from pin_a
to pin_b through it, so that v i is the power it takes up [W]. Every circuit needs a Ground, which says where the potential is zero.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import Any, final

import casadi as ca

import acausal.language.expression as language
from acausal.language.component import Component
from acausal.language.connector import Electrical, Rotational, Signal
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Expression, Scalar, Variable, scalar
from components.rotational import not_zero

_LOOSE = "A current needs a way in and a way out: connect both pins."
FLOATING = "A circuit without a Ground has no zero of potential, and parallel ideal sources share no definite current."


@final
class Ground(Component):
    """Potential zero: v = 0, whatever the current.

    scene.ground = Ground(); scene.connect(scene.source.pin_b, scene.ground.pin)
    """

    pin = Electrical.port(must_connect=True, if_unconnected="It grounds nothing: connect it to a pin of the circuit.")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.pin.v, 0.0)


class AbstractTwoPin(Component, ABC):
    """A part between two pins with voltage v = v_a - v_b and current i = i_a = -i_b. Must provide `law`, one equation of v and i."""

    pin_a = Electrical.port(must_connect=True, if_unconnected=_LOOSE)
    pin_b = Electrical.port(must_connect=True, if_unconnected=_LOOSE)
    v = Variable("V", "voltage from pin_b up to pin_a", if_undetermined=FLOATING)
    i = Variable("A", "current from pin_a to pin_b", if_undetermined=FLOATING)

    @abstractmethod
    def law(self) -> Equation:
        """What voltage and current have to do with one another."""

    @final
    def equations(self) -> Iterable[Equation]:
        yield equal(self.v, self.pin_a.v - self.pin_b.v)
        yield equal(self.pin_a.i, self.i)
        yield equal(self.pin_b.i, -self.i)
        yield self.law()


@final
class Resistor(AbstractTwoPin):
    """Ohm's law: v = resistance i. `resistance` [Ohm] >= 0; dissipates v i = resistance i^2.

    scene.load = Resistor(100.0)
    """

    def __init__(self, resistance: Scalar) -> None:
        self.resistance = scalar(resistance, "Resistor's resistance", non_negative=True, unit="Ohm")

    def law(self) -> Equation:
        return equal(self.v, self.resistance * self.i)

    def dissipated_power(self) -> Expression:
        return self.resistance * self.i * self.i


@final
class Capacitor(AbstractTwoPin):
    """capacitance der(v) = i. `capacitance` [F] > 0; stores capacitance v^2 / 2. Its state is v, where nothing else gives it.

    scene.filter = Capacitor(1e-6)
    """

    def __init__(self, capacitance: Scalar) -> None:
        self.capacitance = scalar(capacitance, "Capacitor's capacitance", positive=True, unit="F")

    def law(self) -> Equation:
        return equal(self.capacitance * der(self.v), self.i)

    def stored_energy(self) -> Expression:
        return 0.5 * self.capacitance * self.v * self.v


@final
class Inductor(AbstractTwoPin):
    """inductance der(i) = v. `inductance` [H] > 0; stores inductance i^2 / 2. Its state is i, where nothing else gives it.

    scene.winding = Inductor(1e-3)
    """

    def __init__(self, inductance: Scalar) -> None:
        self.inductance = scalar(inductance, "Inductor's inductance", positive=True, unit="H")

    def law(self) -> Equation:
        return equal(self.inductance * der(self.i), self.v)

    def stored_energy(self) -> Expression:
        return 0.5 * self.inductance * self.i * self.i


@final
class Diode(AbstractTwoPin):
    """Shockley's law: i = saturation_current (exp(v / thermal_voltage) - 1), conducting from pin_a to pin_b. [A] > 0, [V] > 0.

    Dissipates v i. W. Shockley, The theory of p-n junctions, Bell System Technical Journal 28 (1949), eq. 1.5.

    scene.rectifier = Diode()
    """

    def __init__(self, saturation_current: Scalar = 1e-9, thermal_voltage: Scalar = 0.025) -> None:
        self.saturation_current = scalar(saturation_current, "Diode's saturation_current", positive=True, unit="A")
        self.thermal_voltage = scalar(thermal_voltage, "Diode's thermal_voltage", positive=True, unit="V")

    def law(self) -> Equation:
        ratio = self.v / self.thermal_voltage
        return equal(self.i, self.saturation_current * (Expression(ca.exp(ratio.sx), ratio.leaves) - 1.0))

    def dissipated_power(self) -> Expression:
        return self.v * self.i


@final
class VoltageSource(AbstractTwoPin):
    """A given voltage: v = voltage, pin_a being the plus pole. Constant, parameter, input, or function of time [V].

    Supplies -v i: the current through it flows from minus to plus where it drives.

    scene.battery = VoltageSource(12.0)
    """

    def __init__(self, voltage: Scalar | Callable[[Any], Any]) -> None:
        self.voltage = scalar(language.of_time(voltage), "VoltageSource's voltage", unit="V")

    def law(self) -> Equation:
        return equal(self.v, self.voltage)

    def supplied_power(self) -> Expression:
        return -1.0 * self.v * self.i


@final
class CurrentSource(AbstractTwoPin):
    """A given current out of pin_a into the circuit: i = -current. Constant, parameter, input, or function of time [A].

    Supplies current v = -v i.

    scene.charger = CurrentSource(lambda t: 0.1 * np.sin(t))
    """

    def __init__(self, current: Scalar | Callable[[Any], Any]) -> None:
        self.current = scalar(language.of_time(current), "CurrentSource's current", unit="A")

    def law(self) -> Equation:
        return equal(self.i, -1.0 * self.current)

    def supplied_power(self) -> Expression:
        return -1.0 * self.v * self.i


@final
class SignalVoltage(AbstractTwoPin):
    """A voltage given by a signal: v = signal, pin_a being the plus pole [V]. Supplies -v i: an ideal amplifier.

    scene.amplifier = SignalVoltage(); scene.connect(scene.controller.output, scene.amplifier.signal)
    """

    signal = Signal.port(must_connect=True, if_unconnected="Connect the output of a signal part, e.g. a PID.")

    def law(self) -> Equation:
        return equal(self.v, self.signal.value)

    def supplied_power(self) -> Expression:
        return -1.0 * self.v * self.i


@final
class ElectromotiveForce(Component):
    """Ideal motor or generator: v = constant der(phi), tau = -constant i. `constant` [N*m/A = V*s/rad] is not zero.

    v = v_a - v_b, i from pin_a to pin_b, tau into the component at `flange`: a positive current drives the flange forward. What it takes up
    as electrical power v i it gives as mechanical power; nothing is stored or lost. Its housing stands still.

    scene.emf = ElectromotiveForce(0.05)
    """

    pin_a = Electrical.port(must_connect=True, if_unconnected=_LOOSE)
    pin_b = Electrical.port(must_connect=True, if_unconnected=_LOOSE)
    flange = Rotational.port(
        must_connect=True, if_unconnected="It drives nothing: connect it to an Inertia, a Gear or a joint's flange."
    )
    v = Variable("V", "voltage from pin_b up to pin_a", if_undetermined=FLOATING)
    i = Variable("A", "current from pin_a to pin_b", if_undetermined=FLOATING)

    def __init__(self, constant: Scalar) -> None:
        what = "ElectromotiveForce's constant"
        self.constant = not_zero(scalar(constant, what, unit="N*m/A"), what)

    def equations(self) -> Iterable[Equation]:
        yield equal(self.v, self.pin_a.v - self.pin_b.v)
        yield equal(self.pin_a.i, self.i)
        yield equal(self.pin_b.i, -self.i)
        yield equal(self.v, self.constant * der(self.flange.phi))
        yield equal(self.flange.tau, -1.0 * self.constant * self.i)
