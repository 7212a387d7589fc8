"""Elastic beams."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Scalar, evaluated, number, scalar, sx
from acausal.language.origin import origin
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.modal_inertia import ElasticBody
from acausal.visual import shapes as drawn
from components.beam_shapes import AXIAL_MOST, BENDING_MOST, BeamShapes

Number = float | Expression


@dataclass(frozen=True, init=False)
class Section:
    """Cross section of a beam along x: `area` [m^2], second moments of area `about_y` and `about_z` [m^4] through its centroid, all > 0.

    Bending along y is resisted by `about_z`. y and z are principal axes. Raises `ParameterError`.
    """

    area: Number
    about_y: Number
    about_z: Number

    def __init__(self, area: Scalar, about_y: Scalar, about_z: Scalar) -> None:
        for name, value in (("area", area), ("about_y", about_y), ("about_z", about_z)):
            object.__setattr__(self, name, scalar(value, f"Section's {name}", positive=True))

    @classmethod
    def rectangle(cls, width: Scalar, height: Scalar) -> Section:
        """`width` along y, `height` along z [m] > 0."""
        y, z = (
            scalar(width, "rectangle's width", positive=True, unit="m"),
            scalar(height, "rectangle's height", positive=True, unit="m"),
        )
        return cls(y * z, y * z * z * z / 12, z * y * y * y / 12)

    @classmethod
    def circle(cls, radius: Scalar, inner: Scalar = 0.0) -> Section:
        """Solid, or a tube with an `inner` radius [m] less than `radius` [m]."""
        r, i = (
            scalar(radius, "circle's radius", positive=True, unit="m"),
            scalar(inner, "circle's inner radius", non_negative=True, unit="m"),
        )
        scalar(r - i, "circle's wall, radius - inner,", positive=True)
        moment = np.pi / 4 * (r * r * r * r - i * i * i * i)
        return cls(np.pi * (r * r - i * i), moment, moment)


@final
class FlexibleBeam(AbstractElasticBody):
    """A straight uniform Euler-Bernoulli beam along x of frame_a, from frame_a to frame_b, that bends and stretches a little.

    Displacement at s = x / length: sum of shapes times amplitudes q [m], first `bending[0]` along y, then `bending[1]` along z, then `axial`
    along x. Bending shapes by `modes`: "pinned", sin(k pi s): frame_a and frame_b stay on the chord, as between hinges. The others are clamped
    at frame_a: "cantilever", with a free tip, 1 there; "craig-bampton", exact for loads at the tip: its displacement and its slope times
    length, as cubic polynomials, then modes clamped at both ends (Craig and Bampton, AIAA Journal 6, 1968).
    Axial shapes: polynomials of degree `axial`, each 1 at one of x = length k / axial and 0 at the others and at frame_a; for two
    4 s (1 - s) and s (2 s - 1).
    `youngs_modulus` [N/m^2], `density` [kg/m^3], `length` [m] > 0; `damping` [s] >= 0: stress = youngs_modulus (strain + damping strain').
    Sections turn with frame_a. Stores q' k q / 2, dissipates damping v' k v. No torsion, no shear, no stiffening by tension.
    Simeon, Mathematical Modelling of Systems 2 (1996). Raises `ParameterError`.

        scene.rod = FlexibleBeam(0.3, Section.rectangle(0.008, 0.008), youngs_modulus=2e11, density=7870.0, bending=(2, 0))
    """

    def __init__(
        self,
        length: Scalar,
        section: Section,
        *,
        youngs_modulus: Scalar,
        density: Scalar,
        bending: tuple[int, int] = (2, 2),
        axial: int = 0,
        modes: str = "pinned",
        damping: Scalar = 0.0,
    ) -> None:
        if not isinstance(section, Section):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
            raise ParameterError(f"FlexibleBeam's section is {section!r} ({origin()}). Give e.g. Section.rectangle(0.01, 0.02).")
        self.length = scalar(length, "FlexibleBeam's length", positive=True, unit="m")
        self.section = section
        self.youngs_modulus = scalar(youngs_modulus, "FlexibleBeam's youngs_modulus", positive=True, unit="Pa")
        self.density = scalar(density, "FlexibleBeam's density", positive=True, unit="kg/m^3")
        self.damping = scalar(damping, "FlexibleBeam's damping", non_negative=True, unit="s")
        self._shapes = _checked_shapes(bending, axial, modes)
        self._set_count(self._shapes.count)

    @property
    def mass(self) -> Number:
        """[kg]."""
        return self.density * self.section.area * self.length

    def deflection(self, s: float) -> Expression:
        """Displacement (3, 1) [m] of the point at s = x / length in [0, 1], in frame_a."""
        at = number(s, "deflection's s")
        if not 0 <= at <= 1:
            raise ParameterError(f"deflection's s is {at:g} ({origin()}). It is x / length, between 0 and 1.")
        return Expression(sx(self._shapes.at(np.array([at]))[0]) @ self.q.sx, frozenset({self.q}))

    def shapes(self) -> tuple[Any, ...]:
        length, area = _present(self.length), _present(self.section.area)
        return (drawn.Rod((0.0, 0.0, 0.0), (length, 0.0, 0.0), (area / np.pi) ** 0.5),)

    def body(self) -> ElasticBody:
        L, section = sx(self.length), self.section
        y, z, E = sx(section.about_y), sx(section.about_z), sx(self.youngs_modulus)
        along_y, along_z, axial = (sx(k) for k in self._shapes.stiffness())
        stiffness = E / L**3 * (z * along_y + y * along_z) + E * sx(section.area) / L * axial
        mass = self.mass
        return ElasticBody(
            self._shapes.integrals(), mass.sx if isinstance(mass, Expression) else mass, L, sx(self.density) * L * ca.diag(ca.vertcat(y + z, y, z)),
            stiffness, sx(self.damping) * stiffness, L * sx([1.0, 0.0, 0.0]), sx(self._shapes.at(np.ones(1))[0]), sx(self._shapes.tip_turns()) / L,
        )  # fmt: skip


def _present(value: Number) -> float:
    """For drawing: the present value of an expression."""
    current = evaluated(value) if isinstance(value, Expression) else np.array([[value]])
    return 0.1 if current is None else float(current[0, 0])


def _checked_shapes(bending: Any, axial: Any, modes: Any) -> BeamShapes:
    where = f"({origin()})"
    if not isinstance(modes, str) or modes not in ("pinned", "cantilever", "craig-bampton"):
        raise ParameterError(f"FlexibleBeam's modes are {modes!r} {where}. Use 'pinned', 'cantilever' or 'craig-bampton'.")
    counts = tuple(bending) if isinstance(bending, list | tuple) else (bending,)
    if len(counts) != 2 or not all(_is_count(k, BENDING_MOST) for k in counts):
        raise ParameterError(
            f"FlexibleBeam's bending is {bending!r} {where}. Give the numbers of shapes along y and along z, each from 0 to {BENDING_MOST}: (2, 0)."
        )
    if not _is_count(axial, AXIAL_MOST):
        raise ParameterError(
            f"FlexibleBeam's axial is {axial!r} {where}. Give the number of axial shapes, from 0 to {AXIAL_MOST}."
        )
    if not sum(counts) + axial:
        raise ParameterError(
            f"FlexibleBeam has no shape {where}: bending=(0, 0) and axial=0. A beam that does not deform is a RigidBody.rod."
        )
    return BeamShapes(counts[0], counts[1], axial, modes)


def _is_count(value: Any, most: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= most
