"""Integrability in a scene: what its velocity constraints hide, also when parameters change."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from acausal.explain.integrability.classification import Integrability, integrability
from acausal.explain.integrability.frobenius import Growth, growth
from acausal.explain.integrability.integral import Integral, is_integral
from acausal.explain.integrability.pfaffian import PfaffianSystem
from acausal.explain.integrability.velocity_forms import VelocityRow, contact_rows, scalar_rows, velocity_system
from acausal.start.coordinates import coordinates

if TYPE_CHECKING:
    from acausal.reduce.reduce import ReducedSystem


def scene_integrability(system: ReducedSystem, exact: bool = True) -> Integrability:
    """Classifies all velocity constraints of a scene; see `integrability`."""
    whole = velocity_system(system)
    sizes = _sizes(system, whole)
    result = integrability(_measured(whole, sizes), exact)
    if not result.integrals or not system.p.numel():
        return result
    other = _measured(velocity_system(system, _other_values(system)), sizes)
    blocks = tuple(
        replace(block, integrals=_for_parameters(system, block.integrals, part))
        for block, (_, part) in zip(result.blocks, other.blocks(), strict=True)
    )
    return Integrability(blocks, result.vanishing)


def integrals(system: ReducedSystem, exact: bool = True) -> tuple[Integral, ...]:
    """Functions of tree.q, t and p that the velocity constraints keep constant, those that are found in closed form.

    `coefficients` of linear ones: (nq,), and one more for the time in a scene that depends on it. `exact` off: the linear ones only, without
    sympy. Costs nothing where nothing rolls and no source or gear holds velocities.
    """
    return scene_integrability(system, exact).integrals


def _sizes(system: ReducedSystem, forms: PfaffianSystem) -> np.ndarray:
    """Of the coordinates (nq,): 1 for angles; for lengths the radius of what rolls, or else the mechanism's reach. So roughly that scenes of a
    usual size keep their numbers.
    """
    if not system.nq:
        return np.zeros(0)
    known = coordinates(system.mechanics, system.p, system.p_values, system.constraints.q_start, system.scalar.position)
    turns = system.mechanics.tree.turning[0]
    rows = ca.Function("rows", [forms.y], [ca.densify(forms.forms)])
    W = np.abs(np.array(rows(forms.start + 0.25)).reshape(-1, forms.start.size))[:, : system.nq]
    by_angle, by_length = np.max(W[:, turns], axis=1, initial=0.0), np.max(W[:, ~turns], axis=1, initial=0.0)
    both = np.isfinite(by_angle) & np.isfinite(by_length) & (by_angle > 0) & (by_length > 0)
    length = (
        float(np.median(by_angle[both] / by_length[both]))
        if np.any(both)
        else float(np.max(known.scale[~turns], initial=0.0)) or 1.0
    )
    return np.where(turns, 1.0, _roughly(np.array(length)))


def _roughly(sizes: np.ndarray) -> np.ndarray:
    """The nearest powers of 1000: fractions stay short."""
    return 1000.0 ** np.round(np.log10(sizes) / 3)


def _measured(system: PfaffianSystem, sizes: np.ndarray) -> PfaffianSystem:
    """`sizes` of all coordinates but the time, which is measured by what the forms make of it beside the others."""
    if not system.timed:
        return system.measured(sizes)
    rows = ca.Function("rows", [system.y], [ca.densify(system.forms)])
    W = np.abs(np.array(rows(system.start)).reshape(-1, system.start.size)) * np.append(sizes, 1.0)
    others, own = float(np.max(W[:, :-1], initial=0.0)), float(np.max(W[:, -1], initial=0.0))
    known = 0 < others < np.inf and 0 < own < np.inf
    return system.measured(np.append(sizes, _roughly(np.array(others / own)) if known else 1.0))


def _other_values(system: ReducedSystem) -> np.ndarray:
    """Values of parameters that differ from the present ones."""
    return system.p_values * 1.125 + 0.0625 * (system.p_values == 0)


def _for_parameters(system: ReducedSystem, found: tuple[Integral, ...], other: PfaffianSystem) -> tuple[Integral, ...]:
    """Integrals with parameters in them where their row shows how these enter; or marked as ones for the present values.

    `other`: the same constraints for other values.
    """
    reference = growth(other) if found else None
    return tuple(_for_all(system, integral, other, reference) for integral in found if reference is not None)


def _for_all(system: ReducedSystem, integral: Integral, other: PfaffianSystem, reference: Growth) -> Integral:
    if is_integral(other, reference, other.seen_measured(integral.expression)):
        return integral
    rows: tuple[VelocityRow, ...] = (*contact_rows(system.mechanics, system.constraints.loops), *scalar_rows(system))
    own = [row for row in rows if row.name in integral.names]
    if len(own) == 1 and integral.coefficients is not None:
        # coefficients that do not change with q are those of any q
        y, at = ca.vertcat(system.mechanics.tree.q, system.t), np.append(system.constraints.q_start, 0.0)
        slopes = ca.substitute(ca.horzcat(own[0].form, own[0].drift), y, ca.SX(ca.DM(at)))
        scale = slopes[int(np.argmax(np.abs(integral.coefficients)))]
        expression = ca.mtimes(slopes, y) / scale
        present = ca.substitute(expression, system.p, ca.SX(ca.DM(_other_values(system))))
        if is_integral(other, reference, other.seen_measured(present)):
            return replace(integral, expression=expression)
    return replace(integral, fixed_parameters=True)
