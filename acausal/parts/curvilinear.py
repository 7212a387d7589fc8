"""Curvilinear coordinates of a place: cylindrical, spherical, or any others; as outputs and start values, and with their rates.

A free particle keeps its three Cartesian states, which are singular nowhere; a chart is what is read of them, and `ac.der` gives its rates, which may be
start values too. A place is told by `at_cylindrical` and `at_spherical`. O. M. O'Reilly, Intermediate Dynamics for Engineers (2nd ed.), 3.4, 3.5.

    r, phi, z = curvilinear.cylindrical(scene.bob.point.position)
    run = model.simulate(1.0, {scene.bob.point.position: curvilinear.at_cylindrical(1.0, 0.5, 0.0), ac.der(phi): 2.0})
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.expression import Expression, Scalar, leaves, sx
from acausal.language.lookup import at_symbols
from acausal.language.origin import origin
from acausal.language.vectors import norm

Three = tuple[Expression, Expression, Expression]


def cylindrical(position: Scalar) -> Three:
    """r [m] >= 0 from the z axis, angle [rad] from x about z in (-pi, pi], and z [m], of a place (3,). On the axis the angle has no value."""
    x, y, z = _entries(position)
    found = leaves(position)
    return (
        Expression(norm(Expression(ca.vertcat(x, y), found)).sx, found, "r{}"),
        Expression(ca.atan2(y, x), found, "angle{}"),
        Expression(z, found, "z{}"),
    )


def spherical(position: Scalar) -> Three:
    """R [m] >= 0 from the origin, azimuth [rad] from x about z in (-pi, pi], and the polar angle [rad] from z in [0, pi], of a place (3,)."""
    x, y, z = _entries(position)
    found = leaves(position)
    across = norm(Expression(ca.vertcat(x, y), found))
    return (
        Expression(norm(Expression(ca.vertcat(x, y, z), found)).sx, found, "R{}"),
        Expression(ca.atan2(y, x), found, "azimuth{}"),
        Expression(ca.atan2(across.sx, z), found, "polar angle{}"),
    )


def at_cylindrical(r: float, angle: float, z: float) -> tuple[float, float, float]:
    """The place (3,) [m] with these cylindrical coordinates."""
    return r * math.cos(angle), r * math.sin(angle), z


def at_spherical(R: float, azimuth: float, polar: float) -> tuple[float, float, float]:
    """The place (3,) [m] with these spherical coordinates."""
    return R * math.sin(polar) * math.cos(azimuth), R * math.sin(polar) * math.sin(azimuth), R * math.cos(polar)


def chart(coordinates: Callable[[Any], Any], position: Scalar) -> Three:
    """Any three coordinates of a place: `coordinates` is a function of p (3, 1) [m] in numpy's or CasADi's functions, and gives three numbers.

    parabolic = lambda p: (ca.sqrt(ca.norm_2(p) + p[2]), ca.sqrt(ca.norm_2(p) - p[2]), ca.atan2(p[1], p[0]))
    """
    found = at_symbols(coordinates, "The chart", "p", ca.vertcat(*_entries(position)))
    if found.shape != (3, 1):
        raise ParameterError(f"The chart gives something of shape {found.shape} ({origin()}). It must give three coordinates.")
    q = [Expression(found[k], leaves(position), f"chart{{}}[{k}]") for k in range(3)]
    return q[0], q[1], q[2]


def base_vectors(coordinates: Three, position: Scalar) -> Expression:
    """Unit vectors along the coordinate curves, the columns of a matrix (3, 3) in the axes of `position`: e_r, e_phi, e_z of cylindrical coordinates.

    velocity components along them: base_vectors(...).T @ velocity.
    """
    p, values = ca.SX.sym("p", 3), _entries(position)
    at = ca.vertcat(*values)
    if not all(ca.symvar(value) for value in values) or any(not value.is_symbolic() for value in values):
        raise ParameterError(
            f"Base vectors are those of a place itself, e.g. scene.bob.point.position, not of {shown(position)} ({origin()})."
        )
    slopes = ca.jacobian(ca.substitute(ca.vertcat(*(c.sx for c in coordinates)), at, p), p)
    curves = ca.substitute(ca.densify(ca.inv(slopes)), p, at)
    lengths = [ca.norm_2(curves[:, k]) for k in range(3)]
    return Expression(ca.horzcat(*(curves[:, k] / lengths[k] for k in range(3))), leaves(position))


def _entries(position: Scalar) -> list[ca.SX]:
    value = sx(position)
    if value.numel() != 3:
        raise ParameterError(f"A place has three coordinates, not shape {value.shape} ({origin()}).")
    return [value[k] for k in range(3)]
