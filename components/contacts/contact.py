"""A body of any shape on a surface of any shape, by any law."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.language.component import System
from acausal.language.connector import Frame
from acausal.language.expression import Expression, Variable
from acausal.parts.contact import AbstractTouch, read
from acausal.parts.pose import Pose
from components.contacts.ball_on_surface import RollingBallOnSurface
from components.contacts.contact_force import ContactForce
from components.contacts.hard_contact import HardContact
from components.contacts.laws import AbstractFriction, AbstractTouchingLaw, Apart, Hard, Law, Rolling, Sliding, checked_law
from components.contacts.nearness import nearness, nearness_of_frames, touched
from components.contacts.rolling_body import RollingBall, RollingEllipsoid
from components.contacts.rolling_wheel import RollingDisk, RollingTorus
from components.contacts.touching import Touching
from components.geometry.shapes import Disk, Ellipsoid
from components.geometry.surfaces import AbstractSurface, Plane, Sphere, Torus, checked_surface

_LOOSE = "A contact is between two bodies: connect both of its frames."
Joint = Touching | RollingBall | RollingBallOnSurface | RollingEllipsoid | RollingDisk | RollingTorus


@final
class Contact(System, AbstractTouch):
    """A body with the outside `shape`, fixed in frame_b, on the side of the normal of a `surface` fixed in frame_a.

    `law`: Rolling(), RollingWithoutPivoting(), Sliding(): they touch at all times, by a joint in least velocities (`Touching`, or a part made for
    this pair), and without a multiplier; Viscous(...), Creep(...): they slide, with a force against the slip; HuntCrossley(...): they yield, and
    part; Hard(...): they do not yield, part and strike, stick and slip. What it is made of: `joint` and `force`, either may be None; `q` and `v` are
    the joint's. Where the nearest points of two bodies that may part have no closed form, a joint of six freedoms follows them:
    Touching(shape, surface, Apart()).

        scene.contact = Contact(Disk(0.3), HeightField(lambda x, y: 0.1 * x**2))
        scene.bump = Contact(Sphere(0.1), Sphere(0.2), HuntCrossley(1e6))
        scene.floor = Contact(Sphere(0.1), Plane(), Hard(restitution=0.8, friction=Coulomb(0.3)))
    """

    namesakes = ("joint", "force_part")
    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, shape: AbstractSurface, surface: AbstractSurface, law: Law | None = None) -> None:
        self.shape, self.surface = checked_surface(shape, "Contact", "shape"), checked_surface(surface, "Contact")
        self.law = checked_law(Rolling() if law is None else law, "Contact")
        self.joint, self.force_part = _parts(shape, surface, self.law)
        for part in (self.joint, self.force_part):
            if part is not None:
                self.connect(self.frame_a, part.frame_a)
                self.connect(self.frame_b, part.frame_b)

    @property
    def q(self) -> Variable:
        """The joint's coordinates."""
        return self._joint("q").q

    @property
    def v(self) -> Variable:
        """The joint's velocities."""
        return self._joint("v").v

    @property
    def gap(self) -> Expression:
        if self.joint is not None:
            return self.joint.gap
        near = nearness_of_frames(self.shape, self.surface, *self.ends())
        assert near is not None, "there is a closed form, see `_parts`"
        return read(near.gap)

    def touch(self) -> tuple[Expression, Expression]:
        if self.joint is not None:
            return self.joint.touch()
        found = touched(self.shape, self.surface, *self.ends())
        assert found is not None, "there is a closed form, see `_parts`"
        return found

    def ends(self) -> tuple[Frame, Frame]:
        part = self.joint or self.force_part
        assert part is not None
        return part.frame_a, part.frame_b

    def pushed(self) -> tuple[Frame, ...]:
        return tuple(part.frame_b for part in (self.joint, self.force_part) if part is not None)

    def _joint(self, name: str) -> Joint:
        if self.joint is None:
            raise AttributeError(
                f"{self!r} has no '{name}': its bodies may part, and keep their own coordinates. Look at its gap, force or slip."
            )
        return self.joint


def _parts(shape: AbstractSurface, surface: AbstractSurface, law: Law) -> tuple[Joint | None, ContactForce | HardContact | None]:
    """Joint and force of a contact."""
    if isinstance(law, AbstractTouchingLaw):
        return (_folded(shape, surface) if isinstance(law, Rolling) else None) or Touching(shape, surface, law), None
    if isinstance(law, AbstractFriction):
        joint = Touching(shape, surface, Sliding())
    else:
        free = Pose(ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3))
        joint = None if nearness(shape, surface, free) is not None else Touching(shape, surface, Apart())
    return joint, HardContact(shape, surface, law, joint) if isinstance(law, Hard) else ContactForce(shape, surface, law, joint)


def _folded(shape: AbstractSurface, surface: AbstractSurface) -> Joint | None:
    """Parts made for a pair that rolls, with fewer operations."""
    if isinstance(shape, Sphere) and shape.touching(ca.SX([0, 0, 1])) is not None:
        return RollingBall(shape.radius) if isinstance(surface, Plane) else RollingBallOnSurface(shape.radius, surface)
    if not isinstance(surface, Plane):
        return None
    if isinstance(shape, Ellipsoid):
        return RollingEllipsoid(shape.semi_axes)
    if isinstance(shape, Disk):
        return RollingDisk(shape.radius, "z")
    return RollingTorus(shape.radius, shape.tube, "z") if isinstance(shape, Torus) else None
