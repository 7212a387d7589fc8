"""A cam and its follower, by the lift."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, final

import casadi as ca

from acausal.errors import ParameterError
from acausal.language.component import Component
from acausal.language.connector import Rotational, Translational
from acausal.language.equation import Equation, equal
from acausal.language.expression import Expression, formula, leaves, sx
from acausal.language.interpolant import is_spline, of_spline
from acausal.language.origin import origin

_HELD = "Connect both: the cam's shaft, and the follower's slide."


@final
class CamFollower(Component):
    """A follower that a cam lifts: s = lift(phi), tau + lift'(phi) f = 0. It holds on both sides, as in a groove.

    `lift`: a function of the angle phi [rad] that gives s [m], by functions of numpy or CasADi, or a spline of scipy (periodic ones too). No mass,
    no friction. For a cam by its outline, on which a point or a roller runs in space, see PointOnCurve.

        scene.cam = CamFollower(lambda phi: 0.01 * (1 - np.cos(phi)))
    """

    shaft = Rotational.port(must_connect=True, if_unconnected=_HELD)
    follower = Translational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, lift: Callable[[Any], Any]) -> None:
        phi = self.shaft.phi
        try:
            found: Any = of_spline(lift, phi.sx) if is_spline(lift) else lift(phi)
            value = formula(sx(found), "CamFollower's lift")
        except (TypeError, AttributeError, ValueError, ArithmeticError, NotImplementedError) as error:
            raise ParameterError(
                f"CamFollower's lift cannot be used ({origin()}): {str(error).rstrip('.')}. Give a function of the angle by functions of numpy or CasADi, "
                "lambda phi: 0.01 * np.sin(phi), or a spline of scipy."
            ) from error
        if value.shape != (1, 1) or not ca.depends_on(value, phi.sx):
            raise ParameterError(f"CamFollower's lift must be one number that depends on the angle ({origin()}).")
        self.lift = Expression(value, leaves(value) | leaves(found))

    def equations(self) -> Iterable[Equation]:
        slope = Expression(ca.jacobian(self.lift.sx, self.shaft.phi.sx), self.lift.leaves)
        yield equal(self.follower.s, self.lift)
        yield equal(self.shaft.tau + slope * self.follower.f, 0.0)
