"""Springs and dampers between two points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import casadi as ca

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Scalar, declared_in, scalar, sx
from acausal.language.lookup import at_symbols
from acausal.language.origin import origin
from acausal.parts.force import AbstractLineForce


@final
class Spring(AbstractLineForce):
    """Linear spring between two points: tension = stiffness (length - natural_length).

    `stiffness` [N/m] >= 0, `natural_length` [m] >= 0. Stores stiffness (length - natural_length)^2 / 2. `pull` [N] and `distance` [m] are read of it.
    The ends must not coincide unless natural_length is 0.

        scene.spring = Spring(stiffness=100.0, natural_length=0.5)
    """

    def __init__(self, stiffness: Scalar, natural_length: Scalar = 0.0) -> None:
        self.stiffness = scalar(stiffness, "Spring's stiffness", non_negative=True, unit="N/m")
        self.natural_length = scalar(natural_length, "Spring's natural_length", non_negative=True, unit="m")

    def tension(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        return sx(self.stiffness) * length - sx(self.stiffness) * sx(self.natural_length)

    def potential(self, length: ca.SX) -> ca.SX:
        return 0.5 * sx(self.stiffness) * (length - sx(self.natural_length)) ** 2


@final
class Damper(AbstractLineForce):
    """Linear damper between two points: tension = damping * rate of the length. `damping` [N*s/m] >= 0; dissipates damping rate^2.

    scene.damper = Damper(damping=2.0)
    """

    def __init__(self, damping: Scalar) -> None:
        self.damping = scalar(damping, "Damper's damping", non_negative=True, unit="N*s/m")

    def tension(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        return sx(self.damping) * rate

    def potential(self, length: ca.SX) -> ca.SX:
        return ca.SX(0)


@final
class SpringDamper(AbstractLineForce):
    """Spring and damper side by side between two points; parameters as in `Spring` and `Damper`.

    scene.strut = SpringDamper(stiffness=2e4, natural_length=0.4, damping=1e3)
    """

    def __init__(self, stiffness: Scalar, natural_length: Scalar, damping: Scalar) -> None:
        self.stiffness = scalar(stiffness, "SpringDamper's stiffness", non_negative=True, unit="N/m")
        self.natural_length = scalar(natural_length, "SpringDamper's natural_length", non_negative=True, unit="m")
        self.damping = scalar(damping, "SpringDamper's damping", non_negative=True, unit="N*s/m")

    def tension(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        return sx(self.stiffness) * (length - sx(self.natural_length)) + sx(self.damping) * rate

    def potential(self, length: ca.SX) -> ca.SX:
        return 0.5 * sx(self.stiffness) * (length - sx(self.natural_length)) ** 2


@final
class NonlinearSpring(AbstractLineForce):
    """Any conservative law between two points, by its `potential(length)` [J], a function of the length [m] in numpy's or CasADi's functions.

    tension = d potential / d length, by automatic differentiation.
    Raises `ParameterError` for a potential that does not depend on the length.

        scene.spring = NonlinearSpring(lambda length: 50 * (length - 1) ** 2 + 20 * (length - 1) ** 4)
    """

    def __init__(self, potential: Callable[[ca.SX], ca.SX]) -> None:
        length = ca.SX.sym("length")
        self.law = tried(potential, "NonlinearSpring's potential", "length", length)
        if not ca.depends_on(self.law.sx, length):
            raise ParameterError(f"NonlinearSpring's potential must be a function of the length ({origin()}).")
        self._potential = potential

    def tension(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        symbol = ca.SX.sym("length")
        return ca.substitute(ca.gradient(self.potential(symbol), symbol), symbol, length)

    def potential(self, length: ca.SX) -> ca.SX:
        return at_symbols(self._potential, "NonlinearSpring's potential", "length", length)


@final
class NonlinearDamper(AbstractLineForce):
    """Any dissipative law between two points: `force(length, rate)` [N], pull positive, in numpy's or CasADi's functions; zero at rate 0.

    scene.damper = NonlinearDamper(lambda length, rate: 3.0 * rate * ca.fabs(rate))
    """

    def __init__(self, force: Callable[[ca.SX, ca.SX], ca.SX]) -> None:
        self.law = tried(force, "NonlinearDamper's force", "length, rate", ca.SX.sym("length"), ca.SX.sym("rate"))
        self._force = force

    def tension(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        return at_symbols(self._force, "NonlinearDamper's force", "length, rate", length, rate)

    def potential(self, length: ca.SX) -> ca.SX:
        return ca.SX(0)


def tried(law: Callable[..., Any], what: str, arguments: str, *values: ca.SX) -> Expression:
    """The law of symbols, with the parameters in it. Raises `ParameterError` for what is no function, or none of these symbols, or gives no scalar."""
    result = at_symbols(law, what, arguments, *values)
    if not result.is_scalar():
        raise ParameterError(f"{what} must give one number, not {result.shape} ({origin()}).")
    return Expression(result, declared_in(result))
