"""Robots as their makers describe them: links and joints of a URDF file."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from typing import Any, Generic, TypeVar, final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from acausal.arguments import path_of, shown
from acausal.errors import AcausalError, InertiaWarning, OptionError, ParameterError
from acausal.language.component import Component, System, add_connection
from acausal.language.connector import FLOWS, Connector, Frame, Rotational, Translational
from acausal.language.equation import Equation, equal
from acausal.language.expression import Scalar, flag, number, scalar
from acausal.language.origin import origin
from acausal.visual import shapes as drawn
from acausal.wording import callers_level, compact, nearest
from components.bodies import Fixed, RigidBody, check_physical
from components.clutches import Brake
from components.joints.free import Free
from components.joints.planar import Planar
from components.joints.prismatic import Prismatic
from components.joints.revolute import Revolute
from components.orientation import axis_vector, rotation_about
from components.rotational import RotationalDamper, RotationalGround, not_zero
from components.translational import TranslationalDamper, TranslationalGround

T = TypeVar("T")
Joint = Revolute | Prismatic | Planar | Free
_KINDS: Mapping[str, Callable[[tuple[float, ...]], Joint]] = {
    "revolute": Revolute,
    "continuous": Revolute,
    "prismatic": Prismatic,
    "planar": Planar,
    "floating": lambda axis: Free(),
}


@dataclass(frozen=True)
class Limits:
    """What a joint is made for: from `lower` to `upper` [rad or m], up to `speed` [rad/s or m/s] and `effort` [N*m or N]; infinite where nothing is said."""

    lower: float = -math.inf
    upper: float = math.inf
    speed: float = math.inf
    effort: float = math.inf


class _ByName(dict[str, T], Generic[T]):
    """What a robot has of a kind, by its names in the file; `otherwise`: what else a name may be that is none of these."""

    def __init__(self, kind: str, otherwise: str = "") -> None:
        super().__init__()
        self.kind, self.otherwise = kind, otherwise

    def __missing__(self, name: str) -> T:
        raise ParameterError(
            f"The robot has no {self.kind} {shown(name)} ({origin()}).{nearest(str(name), self)}{self.otherwise} It has: {compact(self) or 'none'}."
        )


@final
class Mimic(Component):
    """A joint that follows another one: place_b = ratio place_a + offset and effort_a + ratio effort_b = 0, without mass or loss.

    The flanges are given: of joints, shafts or sliding masses, in any mixture. `ratio` is not zero; it and `offset` have the units of the flanges
    [rad], [m]. It costs no state: flange_b has none of its own any more.

        scene.grip = Mimic(scene.left.flange, scene.right.flange, ratio=-1)
    """

    def __init__(
        self,
        flange_a: Rotational | Translational,
        flange_b: Rotational | Translational,
        ratio: Scalar = 1.0,
        offset: Scalar = 0.0,
    ) -> None:
        ends: list[Connector] = []
        for name, flange in (("flange_a", flange_a), ("flange_b", flange_b)):
            if not isinstance(flange, Rotational | Translational):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise ParameterError(
                    f"Mimic's {name} is {shown(flange)} ({origin()}). Give the flange of a joint: scene.hinge.flange."
                )
            ends.append(type(flange)(self, name))
            setattr(self, name, ends[-1])
            add_connection(self, flange, ends[-1])
        self._ends = tuple(ends)
        unit_a, unit_b = ("rad" if isinstance(end, Rotational) else "m" for end in ends)
        self.ratio = not_zero(
            scalar(ratio, "Mimic's ratio", unit="1" if unit_a == unit_b else f"{unit_b}/{unit_a}"), "Mimic's ratio"
        )
        self.offset = scalar(offset, "Mimic's offset", unit=unit_b)

    def equations(self) -> Iterable[Equation]:
        (place_a, effort_a), (place_b, effort_b) = (tuple(getattr(end, name) for name in FLOWS[type(end)]) for end in self._ends)
        yield equal(place_b, self.ratio * place_a + self.offset)
        yield equal(effort_a + self.ratio * effort_b, 0.0)


@final
class Robot(System):
    """Links and joints of a URDF file (https://wiki.ros.org/urdf/XML): a part of a scene, to be held by its `root`, or left free.

    `description`: the file's path, or its text. `links["hand"]`: its bodies; `joints["elbow"]`: what moves; `limits["elbow"]`: what that is made for,
    which nothing stops it from leaving; all by their names in the file. `frame("tool")`: of any link, of one without mass, too. `held`: joints that
    do not move, and where [rad or m]; nor does what mimics them. Joints are damped as the file says, and rub unless `friction` is False; those that
    mimic others cost no state. Boxes, cylinders and spheres are drawn, meshes are not; nothing touches anything.

    Raises `ParameterError` for what is no tree of links, by the name of the link or joint. Warns (`InertiaWarning`) of inertias that no body has.

        scene.arm = Robot("arm.urdf", held={"finger": 0.02})
        scene.connect(scene.world.frame, scene.arm.root)
    """

    def __init__(
        self, description: str | PathLike[str], *, held: Mapping[str, float] | None = None, friction: bool = True
    ) -> None:
        robot, self._source = _read(description)
        rubs, still = flag(friction, "Robot's friction"), _places(held)
        self.links: dict[str, RigidBody] = _ByName("link with mass", " Of one without mass say frame(name).")
        self.massless: dict[str, Fixed] = {}
        self.joints: dict[str, Joint] = _ByName("joint that moves")
        self.limits: dict[str, Limits] = _ByName("limit of a joint")
        self.mounts: dict[str, Fixed] = {}
        self.dampers: dict[str, RotationalDamper | TranslationalDamper] = {}
        self.grounds: dict[str, RotationalGround | TranslationalGround] = {}
        self.brakes: dict[str, Brake] = {}
        self.mimics: dict[str, Mimic] = {}
        self._held: dict[str, str] = {}
        colours = {m.get("name", ""): _colour(m) for m in robot.findall("material")}
        joints = self._named(robot, "joint")
        for name, link in self._named(robot, "link").items():
            with self._saying(f"link '{name}'"):
                body = _body(link, colours)
                if body is None:
                    self.massless[name] = Fixed()
                else:
                    self.links[name] = body
        self._warn_of_inertias()
        for name in still:
            if name not in joints:
                raise ParameterError(
                    f"{self._source} has no joint {shown(name)} to be held ({origin()}).{nearest(str(name), joints)}"
                )
        for name, joint in joints.items():
            with self._saying(f"joint '{name}'"):
                self._join(name, joint, _place_of(name, joints, still))
                self._resist(name, joint.find("dynamics"), rubs)
        for name, joint in joints.items():
            with self._saying(f"joint '{name}'"):
                self._follow(name, joint.find("mimic"))
        self._root = self._only_root()

    @property
    def root(self) -> Frame:
        """The frame of the link that no joint holds."""
        return self.frame(self._root)

    def frame(self, link: str) -> Frame:
        """The frame of a link. Raises `ParameterError` for a name that is none."""
        if link in self.links:
            return self.links[link].frame
        if link in self.massless:
            return self.massless[link].frame_a
        raise ParameterError(f"There is no link {shown(link)} ({origin()}).{nearest(str(link), (*self.links, *self.massless))}")

    def _named(self, robot: Element, kind: str) -> dict[str, Element]:
        """Elements of a kind by their names."""
        found: dict[str, Element] = {}
        for element in robot.findall(kind):
            name = element.get("name", "")
            if not name or name in found:
                said = f"two {kind}s are called '{name}'" if name else f"a {kind} has no name"
                raise ParameterError(f"{self._source}: {said} ({origin()}).")
            found[name] = element
        return found

    @contextmanager
    def _saying(self, where: str) -> Generator[None]:
        """Errors say in which file they are, and where."""
        try:
            yield
        except AcausalError as error:
            raise ParameterError(f"{self._source}, {where}: {error}") from None

    def _warn_of_inertias(self) -> None:
        """Files are full of these, and others take them."""
        said: dict[str, str] = {}
        for name, body in self.links.items():
            assert isinstance(body.central_inertia, np.ndarray)
            try:
                check_physical(body.central_inertia)
            except ParameterError as error:
                said[name] = str(error)
        if said:
            name, more = next(iter(said)), f" (and {len(said) - 1} more)" if len(said) > 1 else ""
            warnings.warn(
                f"{self._source}, link '{name}'{more}: {said[name]} It is taken as it is written.",
                InertiaWarning,
                stacklevel=callers_level(),
            )

    def _join(self, name: str, joint: Element, held: float | None) -> None:
        """Connect what a joint holds."""
        parent, child = (_said(joint.find(end), "link", f"no {end}") for end in ("parent", "child"))
        inner, kind = self.frame(child), joint.get("type", "")
        if child in self._held:
            raise ParameterError(f"'{child}' is held by '{self._held[child]}' too. Close loops by joints of the scene.")
        self._held[child] = name
        position, turned = _origin(joint)
        axis = _numbers(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
        if held is not None:
            moved, rotated = _displacement(kind, axis, held)
            position, turned, kind = tuple(np.array(position) + turned @ moved), turned @ rotated, "fixed"
        outer = self._place(name, parent, position, turned)
        if kind == "fixed":
            self.connect(outer, inner)
            return
        if kind not in _KINDS:
            raise ParameterError(f"its type is '{kind}'. Known are {', '.join(_KINDS)} and fixed ({origin()}).")
        moves = self.joints[name] = _KINDS[kind](axis)
        self.connect(outer, moves.frame_a)
        self.connect(moves.frame_b, inner)
        self.limits[name] = _limits(joint.find("limit"), bounded=kind in ("revolute", "prismatic"))

    def _place(self, joint: str, link: str, position: tuple[float, ...], rotation: np.ndarray) -> Frame:
        """Where a joint sits on a link."""
        if link in self.links:
            return self.links[link].at(position, rotation)
        mount = self.mounts[joint] = Fixed(position, rotation)
        self.connect(self.frame(link), mount.frame_a)
        return mount.frame_b

    def _resist(self, name: str, dynamics: Element | None, rubs: bool) -> None:
        """Damping and dry friction of a joint with one freedom."""
        moves = self.joints.get(name)
        if dynamics is None or not isinstance(moves, Revolute | Prismatic):
            return
        damping, friction = (_numbers(dynamics, what, (0.0,))[0] for what in ("damping", "friction"))
        if damping:
            damper, still = (
                (RotationalDamper(damping), RotationalGround())
                if isinstance(moves, Revolute)
                else (TranslationalDamper(damping), TranslationalGround())
            )
            self.dampers[name], self.grounds[name] = damper, still
            self.connect(moves.flange, damper.flange_a)
            self.connect(damper.flange_b, still.flange)
        if friction and rubs:
            self.brakes[name] = Brake(moves.flange, friction)

    def _follow(self, name: str, mimic: Element | None) -> None:
        """Have a joint move as another one does."""
        if mimic is None or name not in self.joints:
            return
        leader = _said(mimic, "joint", "no joint that it mimics")
        if leader not in self.joints:
            raise ParameterError(f"it mimics '{leader}', which is no joint that moves ({origin()}).")
        leads, follows = self.joints[leader], self.joints[name]
        if not (isinstance(leads, Revolute | Prismatic) and isinstance(follows, Revolute | Prismatic)):
            raise ParameterError(f"it mimics '{leader}', and only joints of one freedom can ({origin()}).")
        ratio, offset = _numbers(mimic, "multiplier", (1.0,))[0], _numbers(mimic, "offset", (0.0,))[0]
        self.mimics[name] = Mimic(leads.flange, follows.flange, ratio, offset)

    def _only_root(self) -> str:
        roots = [name for name in (*self.links, *self.massless) if name not in self._held]
        if len(roots) == 1:
            return roots[0]
        what = "its links hold one another in a circle" if self._held else "it has no links"
        if roots:
            what = "no joint holds " + ", ".join(f"'{name}'" for name in roots[:3])
        raise ParameterError(f"{self._source} is no tree of links: {what} ({origin()}).")


def _read(description: str | PathLike[str]) -> tuple[Element, str]:
    """The element of the robot, and what the file is called."""
    if isinstance(description, str) and description.lstrip().startswith("<"):
        text, source = description, "The text"
    else:
        try:
            path = path_of(description, "Robot's description")
        except OptionError:
            raise ParameterError(
                f"Robot's description is {shown(description)} ({origin()}). Give the path of a URDF file, or its text."
            ) from None
        source = path.name
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ParameterError(f"Robot's description '{path}' cannot be read: {error} ({origin()}).") from None
    try:
        robot = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ParameterError(f"{source} is no XML: {error} ({origin()}).") from None
    if "xacro" in text and any("xacro" in element.tag for element in robot.iter()):
        raise ParameterError(f"{source} is a template: have xacro write the URDF file from it ({origin()}).")
    if robot.tag != "robot":
        raise ParameterError(f"{source} describes no robot: its first element is <{robot.tag}>, not <robot> ({origin()}).")
    return robot, source


def _places(held: Any) -> Mapping[str, float]:
    if held is not None and not isinstance(held, Mapping):
        raise ParameterError(
            f"Robot's held is {shown(held)} ({origin()}). Give names of joints and their places, {{'finger': 0.02}}."
        )
    return {name: number(place, f"Robot's held: the place of {shown(name)}") for name, place in (held or {}).items()}


def _place_of(name: str, joints: Mapping[str, Element], held: Mapping[str, float]) -> float | None:
    """Where a joint stays that is held, or mimics one that is; None where it moves."""
    ratio, offset = 1.0, 0.0
    for _ in joints:
        if name in held:
            return ratio * held[name] + offset
        mimic = joints[name].find("mimic")
        if mimic is None or mimic.get("joint") not in joints:
            return None
        offset += ratio * _numbers(mimic, "offset", (0.0,))[0]
        ratio *= _numbers(mimic, "multiplier", (1.0,))[0]
        name = mimic.get("joint", "")
    raise ParameterError(f"it mimics itself ({origin()}).")


def _displacement(kind: str, axis: tuple[float, ...], place: float) -> tuple[np.ndarray, np.ndarray]:
    """Of a joint of one freedom that is held: how far it has shifted [m] and turned."""
    along = np.array(axis_vector(axis, "axis"))
    if kind == "prismatic":
        return place * along, np.eye(3)
    if kind in ("revolute", "continuous"):
        return np.zeros(3), rotation_about(along, place)
    raise ParameterError(f"it is {kind}, and only joints of one freedom can be held ({origin()}).")


def _said(element: Element | None, attribute: str, lacks: str) -> str:
    """What an attribute says that must be there."""
    found = None if element is None else element.get(attribute)
    if not found:
        raise ParameterError(f"it has {lacks} ({origin()}).")
    return found


def _numbers(element: Element | None, attribute: str, usual: tuple[float, ...]) -> tuple[float, ...]:
    """As many finite numbers as usual."""
    text = None if element is None else element.get(attribute)
    if text is None:
        return usual
    try:
        found = tuple(float(word) for word in text.split())
    except ValueError:
        found = ()
    if len(found) != len(usual) or not all(math.isfinite(n) for n in found):
        raise ParameterError(f'{attribute}="{text}" is not {len(usual)} number{"s" * (len(usual) > 1)} ({origin()}).')
    return found


def _origin(element: Element | None) -> tuple[tuple[float, ...], np.ndarray]:
    """Place [m] and rotation (3, 3) of what has an <origin>: turned by roll, pitch and yaw about the axes x, y and z that stay."""
    found = None if element is None else element.find("origin")
    roll, pitch, yaw = (
        rotation_about(axis, angle) for axis, angle in zip(np.eye(3), _numbers(found, "rpy", (0.0,) * 3), strict=True)
    )
    return _numbers(found, "xyz", (0.0,) * 3), yaw @ pitch @ roll


def _body(link: Element, colours: Mapping[str, str | None]) -> RigidBody | None:
    """None where it has no mass."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    mass, written = _numbers(inertial.find("mass"), "value", (0.0,))[0], inertial.find("inertia")
    xx, yy, zz, xy, xz, yz = (_numbers(written, f"i{name}", (0.0,))[0] for name in ("xx", "yy", "zz", "xy", "xz", "yz"))
    if mass < 0:
        raise ParameterError(f"its mass is {mass:g} kg ({origin()}).")
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if mass == 0 and not inertia.any():
        return None
    centre, turned = _origin(inertial)
    inertia = turned @ inertia @ turned.T
    body = RigidBody(1.0, (1.0, 1.0, 1.0), centre, shapes=tuple(_shapes(link, colours)))
    body.mass, body.central_inertia = mass, (inertia + inertia.T) / 2  # as written, whether there is such a body or not
    return body


def _shapes(link: Element, colours: Mapping[str, str | None]) -> Iterator[drawn.AbstractShape]:
    for visual in link.findall("visual"):
        shape = _shape(visual, colours)
        if shape is not None:
            yield shape


def _shape(visual: Element, colours: Mapping[str, str | None]) -> drawn.AbstractShape | None:
    """None for meshes."""
    place, turned = _origin(visual)
    x, y, z = place
    rows = turned.tolist()
    material = visual.find("material")
    colour = None if material is None else _colour(material) or colours.get(material.get("name", ""))
    geometry = visual.find("geometry")
    for solid in () if geometry is None else geometry:
        size = functools.partial(_numbers, solid)
        own: dict[str, Any] = {"position": (x, y, z), "rotation": tuple(map(tuple, rows)), "colour": colour}
        if solid.tag == "box":
            return drawn.Box(size("size", (0.0,) * 3), **own)  # pyright: ignore[reportArgumentType]
        if solid.tag == "cylinder":
            return drawn.Cylinder(size("radius", (0.0,))[0], size("length", (0.0,))[0], **own)
        if solid.tag == "sphere":
            return drawn.Sphere(size("radius", (0.0,))[0], **own)
    return None


def _colour(material: Element) -> str | None:
    found = material.find("color")
    if found is None:
        return None
    red, green, blue, _ = (round(255 * min(max(part, 0.0), 1.0)) for part in _numbers(found, "rgba", (0.0,) * 4))
    return f"#{red:02x}{green:02x}{blue:02x}"


def _limits(limit: Element | None, *, bounded: bool) -> Limits:
    speed, effort = (_numbers(limit, name, (math.inf,))[0] for name in ("velocity", "effort"))
    if not bounded or limit is None:
        return Limits(speed=speed, effort=effort)
    lower, upper = (_numbers(limit, name, (0.0,))[0] for name in ("lower", "upper"))
    return Limits(lower, upper, speed, effort)
