"""Elastic parts on flanges of either kind: stops and play that yield, and couplings by any law."""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Iterable
from typing import Any, final

import casadi as ca

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.equation import Equation, equal
from acausal.language.expression import Expression, Scalar, Variable, scalar
from acausal.language.origin import origin
from acausal.parts.contact import read
from components.contacts.laws import HuntCrossley
from components.flanges import AbstractOnFlanges, Flange
from components.forces.spring import tried
from components.stops import above


class AbstractElasticLimits(AbstractOnFlanges, ABC):
    """Pushes back by a `law` beyond lower <= moved <= upper, where either may be None.

    `at_lower`, `at_upper` [N or N*m] >= 0: how hard it pushes there, forward and back. `effort`: the first less the second.
    """

    law: HuntCrossley
    at_lower = Variable("N", "how hard it pushes forward")
    at_upper = Variable("N", "how hard it pushes back")

    def _yield(self, lower: Scalar | None, upper: Scalar | None, law: object) -> None:
        name, unit = type(self).__name__, "rad" if self.rotates else "m"
        if not isinstance(law, HuntCrossley):
            raise ParameterError(f"{name}'s law is {shown(law)} ({origin()}). Give HuntCrossley(stiffness, damping, exponent=1).")
        if law.friction is not None:
            raise ParameterError(f"{name}'s law has friction ({origin()}), and a flange has no way to slip. Leave it out.")
        self.law = law
        for end in ("at_lower", "at_upper"):
            vars(self)[end] = Variable(self.effort_unit, getattr(type(self), end).description, name=end)
        self._lower = None if lower is None else scalar(lower, f"{name}'s lower", unit=unit)
        self._upper = None if upper is None else scalar(upper, f"{name}'s upper", unit=unit)

    def _gaps(self) -> list[tuple[Expression, Expression]]:
        """To both ends, and their rates; of one that is not there it is open."""
        far: Expression = read(ca.SX(1))
        below = (far, 0.0 * far) if self._lower is None else (self.moved - self._lower, self.speed)
        above = (far, 0.0 * far) if self._upper is None else (self._upper - self.moved, -self.speed)
        return [below, above]

    @property
    def effort(self) -> Expression:
        """What drives the flange forward, flange_b where there are two [N or N*m]."""
        return self.at_lower - self.at_upper

    @final
    def equations(self) -> Iterable[Equation]:
        for push, (gap, rate) in zip((self.at_lower, self.at_upper), self._gaps(), strict=True):
            yield equal(push, read(self.law.push(gap.sx, rate.sx)))
        yield from self._exerts(self.effort)

    @final
    def stored_energy(self) -> Expression:
        below, above = self._gaps()
        return read(self.law.energy(below[0].sx) + self.law.energy(above[0].sx))

    @final
    def dissipated_power(self) -> Expression:
        lost = [(self.law.slope(gap.sx) - self.law.push(gap.sx, rate.sx)) * rate.sx for gap, rate in self._gaps()]
        return read(lost[0] + lost[1])


@final
class ElasticStop(AbstractElasticLimits):
    """Ends that yield for a flange, a gap with a spring behind it: nothing between `lower` and `upper` [m or rad], either may be left out, and beyond
    them the push of a `law`, HuntCrossley(stiffness, damping, exponent), never a pull.

    `at_lower` and `at_upper` [N or N*m], both >= 0, are how hard the ends push. The law's stiffness is in N/m^exponent or N*m/rad^exponent; with the
    exponent 1 it is that of a spring. Stores what the law stores, dissipates stiffness depth^exponent damping depth'^2. One that does not yield is an EndStop.

        scene.bumper = ElasticStop(scene.slide.flange, lower=0.0, law=HuntCrossley(1e5, damping=0.3, exponent=1))
    """

    def __init__(self, flange: Flange, lower: Scalar | None = None, upper: Scalar | None = None, *, law: HuntCrossley) -> None:
        self._take(flange=flange)
        if lower is None and upper is None:
            raise ParameterError(f"ElasticStop has neither 'lower' nor 'upper' ({origin()}). Give one of its ends, or both.")
        self._yield(lower, upper, law)
        if self._lower is not None and self._upper is not None:
            above(self._upper, self._lower, "ElasticStop")


@final
class ElasticBacklash(AbstractElasticLimits):
    """Play between two flanges, and springs behind it: nothing as long as |s_b - s_a| <= width / 2 (phi on shafts), beyond it the push of a `law`,
    HuntCrossley(stiffness, damping, exponent), as of an `ElasticStop`. `width` [m or rad] > 0.

    `at_lower` drives flange_b forward where it is behind, `at_upper` back where it is ahead [N or N*m]; a Gear beside it adds a ratio. Teeth that do not
    yield are a Backlash.

        scene.teeth = ElasticBacklash(scene.motor.flange_b, scene.load.flange_a, width=0.01, law=HuntCrossley(2e4, 0.1, exponent=1))
    """

    def __init__(self, flange_a: Flange, flange_b: Flange, width: Scalar, law: HuntCrossley) -> None:
        self._take(flange_a=flange_a, flange_b=flange_b)
        self.width = scalar(width, "ElasticBacklash's width", positive=True, unit="rad" if self.rotates else "m")
        self._yield(-0.5 * self.width, 0.5 * self.width, law)


@final
class ElasticCoupling(AbstractOnFlanges):
    """Any conservative law between two flanges of either kind, or of one, by its `potential(x)` [J], a function of x = s_b - s_a (phi on shafts) in CasADi's
    operations; and a `damping` >= 0 [N*s/m or N*m*s/rad] beside it.

    flow_b = d potential / d x + damping x' = -flow_a; of one flange x is its position, against what carries it. Stores the potential, dissipates damping
    x'^2. Of a measured course of the torque, the potential is ac.lookup(spline.antiderivative(), x). Raises `ParameterError` for a potential
    that does not depend on x.

        scene.damper = ElasticCoupling(scene.engine.flange_b, scene.gearbox.flange_a, lambda x: 400 * x**2 + 6e3 * x**4, damping=2.0)
    """

    def __init__(self, flange_a: Flange, flange_b: Flange | None, potential: Callable[[Any], Any], damping: Scalar = 0.0) -> None:
        if flange_b is None:
            self._take(flange=flange_a)
        else:
            self._take(flange_a=flange_a, flange_b=flange_b)
        self._x = ca.SX.sym("x")
        self.law = tried(potential, "ElasticCoupling's potential", "x", self._x)
        if not ca.depends_on(self.law.sx, self._x):
            raise ParameterError(f"ElasticCoupling's potential must be a function of x ({origin()}).")
        self.damping = scalar(
            damping, "ElasticCoupling's damping", non_negative=True, unit="N*m*s/rad" if self.rotates else "N*s/m"
        )

    def equations(self) -> Iterable[Equation]:
        pull = self._at_place(ca.gradient(self.law.sx, self._x)) + self.damping * self.speed
        yield from self._exerts(-1.0 * pull)

    def stored_energy(self) -> Expression:
        return self._at_place(self.law.sx)

    def dissipated_power(self) -> Expression:
        return self.damping * self.speed * self.speed

    def _at_place(self, value: ca.SX) -> Expression:
        return Expression(ca.substitute(value, self._x, self.moved.sx), self.law.leaves | self.moved.leaves)
