"""What happens where two bodies touch: what the contact lets them do, and which forces it exerts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self, final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.expression import Expression, Scalar, scalar, sx
from acausal.language.impact_laws import AbstractImpactLaw, Restitution, checked_below, impact_law
from acausal.language.mode_laws import Pressure
from acausal.language.origin import origin
from acausal.parts.pose import symbolic
from components.contacts.nearness import Nearness


class AbstractTouchingLaw(ABC):
    """What bodies may do against one another at their touching point. Must provide `turning` and `slipping`: what velocities v (freedoms, 1) are."""

    freedoms: ClassVar[int]
    unit: ClassVar[str] = "rad/s"
    holds: ClassVar[bool] = True
    """Whether they touch at all times; if not, the gap is a coordinate."""

    @abstractmethod
    def turning(self, tangents: ca.SX) -> ca.SX:
        """(3, freedoms): angular velocity in frame_b by v. `tangents` (3, 2): of the surface, at right angles, in frame_b."""

    @abstractmethod
    def slipping(self) -> ca.SX:
        """(3, freedoms), numbers: velocity of the body's point over the surface along both tangents and the normal [m/s], by v."""

    @abstractmethod
    def forbidden(self, near: Nearness, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        """Velocities (n, 1) that are zero besides the gap's rate, of bodies with these angular velocity and velocity of B against A, in B."""


@final
@dataclass(frozen=True)
class Rolling(AbstractTouchingLaw):
    """Nothing slips; the body may pivot about the normal. v: angular velocity of frame_b against frame_a, in frame_b (3)."""

    freedoms = 3

    def turning(self, tangents: ca.SX) -> ca.SX:
        return ca.SX.eye(3)

    def slipping(self) -> ca.SX:
        return ca.SX(3, 3)

    def forbidden(self, near: Nearness, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        return near.tangents.T @ near.velocity(w_ab_b, v_ab_b)


@final
@dataclass(frozen=True)
class RollingWithoutPivoting(AbstractTouchingLaw):
    """Nothing slips and nothing pivots, as of rough rubber. v: angular velocity along the surface's tangents (2)."""

    freedoms = 2

    def turning(self, tangents: ca.SX) -> ca.SX:
        return tangents

    def slipping(self) -> ca.SX:
        return ca.SX(3, 2)

    def forbidden(self, near: Nearness, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        slip = near.tangents.T @ near.velocity(w_ab_b, v_ab_b)
        return ca.vertcat(slip, ca.dot(symbolic(near.pose.rotation).T @ near.normal, w_ab_b))


@final
@dataclass(frozen=True)
class Sliding(AbstractTouchingLaw):
    """Smooth: no friction. v: angular velocity of frame_b against frame_a, in frame_b (3) [rad/s], and the velocity of the body's point over the
    surface along the surface's tangents (2) [m/s].
    """

    freedoms = 5
    unit = ""

    def turning(self, tangents: ca.SX) -> ca.SX:
        return ca.horzcat(ca.SX.eye(3), ca.SX(3, 2))

    def slipping(self) -> ca.SX:
        return ca.horzcat(ca.SX(3, 3), ca.SX.eye(3)[:, :2])

    def forbidden(self, near: Nearness, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        return ca.SX(0, 1)


@final
@dataclass(frozen=True)
class Apart(AbstractTouchingLaw):
    """Free of one another: nothing is held, and the gap between the nearest points is the last coordinate [m]. v: as of Sliding, and the gap's rate."""

    freedoms = 6
    unit = ""
    holds = False

    def turning(self, tangents: ca.SX) -> ca.SX:
        return ca.horzcat(ca.SX.eye(3), ca.SX(3, 3))

    def slipping(self) -> ca.SX:
        return ca.horzcat(ca.SX(3, 3), ca.SX.eye(3))

    def forbidden(self, near: Nearness, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        return ca.SX(0, 1)


class AbstractFriction(ABC):
    """A force against slip, of bodies that touch at all times. Must provide `resistance`."""

    @abstractmethod
    def resistance(self, square: ca.SX) -> ca.SX:
        """Force over slip [N*s/m] at the `square` of the slip [m^2/s^2]."""


@final
class Viscous(AbstractFriction):
    """Force = `coefficient` [N*s/m] >= 0 times slip: a film of oil.

    Contact(Sphere(0.1), Plane(), Viscous(2.0))
    """

    def __init__(self, coefficient: Scalar) -> None:
        self.coefficient = scalar(coefficient, "Viscous's coefficient", non_negative=True, unit="N*s/m")

    def resistance(self, square: ca.SX) -> ca.SX:
        return sx(self.coefficient)


@final
class Creep(AbstractFriction):
    """A tyre or a railway wheel: force = `stiffness` [N] times slip / `speed`, for small slip, bending towards `limit` [N].

    F = F0 / sqrt(1 + (F0 / limit)^2) with F0 = stiffness slip / speed; `speed` [m/s]: that of the vehicle.

        Contact(Torus(0.3, 0.05), Plane(), Creep(stiffness=4e4, limit=3e3, speed=20.0))
    """

    def __init__(self, stiffness: Scalar, limit: Scalar, speed: Scalar) -> None:
        self.stiffness = scalar(stiffness, "Creep's stiffness", positive=True, unit="N")
        self.limit = scalar(limit, "Creep's limit", positive=True, unit="N")
        self.speed = scalar(speed, "Creep's speed", positive=True, unit="m/s")

    def resistance(self, square: ca.SX) -> ca.SX:
        slope = sx(self.stiffness) / sx(self.speed)
        return slope / ca.sqrt(1 + slope**2 * square / sx(self.limit) ** 2)


@final
class SmoothCoulomb:
    """`mu` >= 0 times the normal force where slip is well above `speed` [m/s] > 0, viscous below: it creeps where Coulomb's friction would hold.

    F = mu N slip / sqrt(slip^2 + speed^2); of bodies that yield, whose normal force is known.

        Contact(Sphere(0.1), Plane(), HuntCrossley(1e6, friction=SmoothCoulomb(0.3, speed=1e-3)))
    """

    def __init__(self, mu: Scalar, speed: Scalar) -> None:
        self.mu = scalar(mu, "SmoothCoulomb's mu", non_negative=True)
        self.speed = scalar(speed, "SmoothCoulomb's speed", positive=True, unit="m/s")

    def resistance(self, square: ca.SX, load: ca.SX) -> ca.SX:
        """Force over slip [N*s/m] at the `square` of the slip [m^2/s^2] and the normal force `load` [N]."""
        return sx(self.mu) * load / ca.sqrt(square + sx(self.speed) ** 2)


@final
class HuntCrossley:
    """Bodies yield where they overlap: push = `stiffness` depth^exponent (1 + `damping` depth'), never a pull; and `friction`, if any.

    stiffness [N/m^exponent] > 0, damping [s/m] >= 0 (about 1.5 (1 - e) / speed for a restitution e near 1), exponent >= 1: 1.5 is Hertz's of bodies that
    touch in a point. Energy stored: stiffness depth^(exponent + 1) / (exponent + 1). K. H. Hunt and F. R. E. Crossley, J. Applied Mechanics 42 (1975).

        Contact(Sphere(0.1), Plane(), HuntCrossley(1e6, damping=0.2))
    """

    def __init__(
        self, stiffness: Scalar, damping: Scalar = 0.0, exponent: float = 1.5, friction: SmoothCoulomb | None = None
    ) -> None:
        self.stiffness = scalar(stiffness, "HuntCrossley's stiffness", positive=True)
        self.damping = scalar(damping, "HuntCrossley's damping", non_negative=True, unit="s/m")
        checked = scalar(exponent, "HuntCrossley's exponent", positive=True)
        if isinstance(checked, Expression) or checked < 1:
            raise ParameterError(f"HuntCrossley's exponent is {exponent!r} ({origin()}). Give a number of at least 1.")
        self.exponent = checked
        if not (friction is None or isinstance(friction, SmoothCoulomb)):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(
                f"HuntCrossley's friction is {friction!r} ({origin()}). Bodies that part need one that vanishes with the normal force: SmoothCoulomb(0.3, 1e-3)."
            )
        self.friction = friction

    @classmethod
    def hertz(cls, modulus: Scalar, radius: Scalar, damping: Scalar = 0.0, friction: SmoothCoulomb | None = None) -> Self:
        """Of balls: `modulus` [N/m^2]: 1 / E* = (1 - nu_a^2) / E_a + (1 - nu_b^2) / E_b; `radius` [m]: 1 / R = 1 / R_a + 1 / R_b."""
        E = scalar(modulus, "HuntCrossley's modulus", positive=True, unit="N/m^2")
        R = scalar(radius, "HuntCrossley's radius", positive=True, unit="m")
        return cls(4 / 3 * E * R**0.5, damping, 1.5, friction)

    def push(self, gap: ca.SX, rate: ca.SX) -> ca.SX:
        """[N] at a gap [m] and its rate [m/s]."""
        return self.slope(gap) * ca.fmax(1 - sx(self.damping) * rate, 0)

    def slope(self, gap: ca.SX) -> ca.SX:
        """The part of the push that comes from `energy` [N]."""
        return sx(self.stiffness) * ca.fmax(-gap, 0) ** self.exponent

    def energy(self, gap: ca.SX) -> ca.SX:
        """Stored [J]."""
        return sx(self.stiffness) * ca.fmax(-gap, 0) ** (self.exponent + 1) / (self.exponent + 1)


@final
class Patch:
    """A round patch of `radius` [m] > 0 that slides and spins at once, each point rubbing against its own slip; `pressure`: UNIFORM, HERTZ (of balls), or RING (all
    at the edge).

        Hard(friction=Coulomb(0.3, patch=Patch(0.01)))
    """

    def __init__(self, radius: Scalar, pressure: Pressure = Pressure.UNIFORM) -> None:
        self.radius = scalar(radius, "Patch's radius", positive=True, unit="m")
        if not isinstance(pressure, Pressure):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(f"Patch's pressure is {pressure!r} ({origin()}). Give ac.Pressure.UNIFORM, HERTZ or RING.")
        self.pressure = pressure


@final
class Coulomb:
    """Dry friction: where it slips `mu` >= 0 times the normal force against the slip, where it sticks as much as it needs, up to `static` >= mu times it.

    `static`: mu unless given. In both directions along the surface alike. It holds without creeping. `restitution` from 0 to 1: how much of the slip comes back in
    an impact, as far as friction can, such as of a ball of rubber. `patch`: Patch(radius) where the spin rubs too; with a point it does not.

        Hard(restitution=0.5, friction=Coulomb(0.3, static=0.4))
    """

    def __init__(self, mu: Scalar, static: Scalar | None = None, restitution: Scalar = 0.0, patch: Patch | None = None) -> None:
        self.mu = scalar(mu, "Coulomb's mu", non_negative=True, unit="1")
        self.static = self.mu if static is None else scalar(static, "Coulomb's static", non_negative=True, unit="1")

        self.restitution = checked_restitution(restitution, "Coulomb").restitution
        if not (patch is None or isinstance(patch, Patch)):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(f"Coulomb's patch is {patch!r} ({origin()}). Give Patch(radius), or None for a point.")
        self.patch = patch
        checked_below(self.static, self.mu, _check_static)


@final
class Hard:
    """Bodies that do not yield: 0 <= gap, 0 <= push, one of them zero. They part and strike; `restitution` from 0 (no bounce) to 1 (no loss), by
    Poisson: the impulse while they part is `restitution` times that while they meet, and without friction so are the speeds. Or by another law: ac.Newton(...),
    ac.Energetic(...), each also in sequence.

    `friction`: Coulomb(...), None is smooth. Everything that touches at one instant is decided together.

        Contact(Sphere(0.1), Plane(), Hard(restitution=0.8, friction=Coulomb(0.3, static=0.4)))
    """

    def __init__(self, restitution: Restitution = 0.0, friction: Coulomb | None = None) -> None:
        self.restitution = checked_restitution(restitution, "Hard")
        if not (friction is None or isinstance(friction, Coulomb)):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(f"Hard's friction is {friction!r} ({origin()}). Give Coulomb(0.3), or None where it is smooth.")
        self.friction = friction


def _check_static(more: np.ndarray) -> None:
    if more.item() < 0:
        raise ParameterError(
            f"Coulomb's static is less than its mu, by {-more.item():g} ({origin()}). What sticks holds at least as well as what slips: "
            "Coulomb(0.3, static=0.4), or one number for both."
        )


def checked_restitution(restitution: Restitution, part: str) -> AbstractImpactLaw:
    """Raises `ParameterError` for what is not from 0 to 1."""
    return impact_law(restitution, f"{part}'s restitution")


Law = AbstractTouchingLaw | AbstractFriction | HuntCrossley | Hard


def checked_law(law: object, part: str) -> Law:
    """Raises `ParameterError` for anything else."""
    if not isinstance(law, AbstractTouchingLaw | AbstractFriction | HuntCrossley | Hard):
        raise ParameterError(
            f"{part}'s law is {shown(law)} ({origin()}). Give what the bodies do where they touch: Rolling(), RollingWithoutPivoting(), Sliding(), "
            "Viscous(...), Creep(...), HuntCrossley(...), or Hard(...). Dry friction: Hard(friction=Coulomb(...)) where bodies may part, RoughContact(...) where not."
        )
    return law


def checked_touching(law: object, part: str) -> AbstractTouchingLaw:
    """Raises `ParameterError` for anything else, laws of forces included."""
    if not isinstance(law, AbstractTouchingLaw):
        raise ParameterError(
            f"{part}'s law is {shown(law)} ({origin()}). Give Rolling(), RollingWithoutPivoting(), Sliding() or Apart(); laws of forces go to Contact(...)."
        )
    return law
