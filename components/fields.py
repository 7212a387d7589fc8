"""Fields of force that act on all bodies and particles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import casadi as ca

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Scalar, leaves, of_time, scalar, sx, time, vector
from acausal.language.lookup import at_symbols
from acausal.language.origin import origin
from acausal.parts.field import AbstractField, AbstractMutualField


@final
class CentralField(AbstractField):
    """Newton's attraction by a mass at the origin of `frame`: potential -mu / r. `mu` = G M [m^3/s^2] > 0.

    Bodies feel its gradient too: forces and moments to second order in their size (MacCullagh). Leave `frame` free for a mass at rest in
    the world's origin, or connect it to the body that attracts, which is then attracted back.

        scene.earth = CentralField(mu=3.986004418e14)
    """

    has_no_sources = True

    def __init__(self, mu: Scalar) -> None:
        self.mu = scalar(mu, "CentralField's mu", positive=True, unit="m^3/s^2")

    def potential(self, p: ca.SX, t: ca.SX) -> ca.SX:
        return -sx(self.mu) / ca.norm_2(p)

    def spread_potential(self, p: ca.SX, R: ca.SX, spread: ca.SX, t: ca.SX) -> ca.SX:
        square, seen = ca.sumsqr(p), R.T @ p  # MacCullagh; without sources, the trace of `spread` is taken off
        return -1.5 * sx(self.mu) * ca.dot(seen, spread @ seen) / (square * square * ca.sqrt(square))


@final
class MutualGravitation(AbstractMutualField):
    """Newton's gravitation between all bodies and particles of the scene: potential -G m_1 m_2 / r of each pair.

    `constant` G [m^3/(kg*s^2)] > 0, 6.6743e-11 (CODATA 2018) unless said otherwise. Bodies feel the gradient too: forces and moments to second order in
    their sizes. Parts that touch one another at a rigid connection do not attract. Bodies that come together meet a singularity.

        scene.gravitation = MutualGravitation()
    """

    def __init__(self, constant: Scalar = 6.6743e-11) -> None:
        self.constant = scalar(constant, "MutualGravitation's constant", positive=True, unit="m^3/kg/s^2")

    def field_of(self, mass: ca.SX) -> CentralField:
        return CentralField(Expression(sx(self.constant) * mass, leaves(self.constant)))


@final
class UniformField(AbstractField):
    """The same `acceleration` (3,) [m/s^2] for every mass, in the axes of `frame`: constants, a function of time, or an input.

    Constant gravity of the world costs less as World(gravity=...).

        scene.tide = UniformField(lambda t: (0.1 * ca.cos(t), 0, 0))
    """

    has_no_sources = True

    def __init__(self, acceleration: Scalar | Callable[[Any], Any]) -> None:
        self.acceleration = vector(of_time(acceleration), "UniformField's acceleration", unit="m/s^2")

    def potential(self, p: ca.SX, t: ca.SX) -> ca.SX:
        return -ca.dot(sx(self.acceleration), p)


@final
class PotentialField(AbstractField):
    """Any field: `potential` (p, t) [m^2/s^2] of one kilogram at p (3, 1) [m] in the axes of `frame`, by numpy's or CasADi's functions.

    scene.well = PotentialField(lambda p, t: 50.0 * ca.sumsqr(p))
    """

    def __init__(self, potential: Callable[[ca.SX, ca.SX], Any]) -> None:
        self._place = ca.SX.sym("p", 3)
        self.law = _of_place(potential, self._place)

    def potential(self, p: ca.SX, t: ca.SX) -> ca.SX:
        return ca.substitute(self.law, self._place, p)


def _of_place(potential: Callable[[ca.SX, ca.SX], Any], p: ca.SX) -> ca.SX:
    found = at_symbols(potential, "PotentialField's potential", "p, t", p, time.sx)
    if found.shape != (1, 1):
        raise ParameterError(
            f"PotentialField's potential has the shape {found.shape} ({origin()}). It is one number, in m^2/s^2."
        )
    return found
