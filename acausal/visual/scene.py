"""From a trajectory to drawable data: where every body, joint and spring is at every frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import casadi as ca
import numpy as np

from acausal.arguments import finite
from acausal.errors import OptionError
from acausal.language.component import System
from acausal.language.connector import Point
from acausal.language.expression import Expression
from acausal.numerics.thresholds import EDGE
from acausal.outputs.outputs import Outputs
from acausal.parts.contact import AbstractTouch
from acausal.parts.force import AbstractLineForce
from acausal.parts.joint import AbstractJoint, AbstractStepJoint
from acausal.parts.pose import Pose, symbolic
from acausal.parts.rigid import AbstractGround, AbstractRigidPart
from acausal.parts.seen import AbstractSeenAlong
from acausal.parts.span import AbstractSpan
from acausal.parts.steps import Ball, Shift, Slide
from acausal.visual.animation import Animation, JointMarker, MovingBody, MovingLink, Trail, rotated
from acausal.visual.geometry import outside, support_points, turned_back, vector_of
from acausal.visual.shapes import Plane, PointMass, Polygon, Rod, Shape, Wire
from acausal.wording import compact

_MOST_FRAMES = 3000
_BESIDE = 0.02
"""Of a body's size: how far outside of its shapes a place is that an arm leads to."""
_ARROW = 0.25
"""Of the scene's size: the longest arrow of a force."""


class Motion(Protocol):
    """What is drawn of: expressions of one scene, `outputs`, at times `t` (n,) [s]."""

    @property
    def outputs(self) -> Outputs:
        """Translates expressions."""
        ...

    @property
    def t(self) -> np.ndarray:
        """Times (n,) [s]."""
        ...

    def at(self, times: np.ndarray) -> Motion:
        """The same motion at other times."""
        ...

    def __getitem__(self, wanted: Expression | ca.SX) -> np.ndarray: ...


def animation_of(run: Motion, *, speed: float | None = None) -> Animation:
    """Bodies by their shapes, joints, line forces and the longest trails of a motion.

    `speed`: shown against real time; by default 1, slower for motions of less than two seconds, faster for those of more than a minute. 60 frames a
    shown second.
    """
    begin, end = float(run.t[0]), float(run.t[-1])
    span = end - begin
    pace = max(1.0, span / 60) if span >= 2 else (span or 1.0) / 8
    if speed is not None and not (pace := finite(speed, "animate: the speed")) > 0:
        raise OptionError(f"animate: the speed is {speed!r}. Give a positive number; 1 is real time.")
    frames = int(np.clip(60 * span / pace, 2, _MOST_FRAMES))
    moving = run.at(np.linspace(begin, end, frames))
    bodies = (*_bodies(moving), *_massless_rods(moving))
    springs = (
        _link(moving, part.path, part.component)
        for part in run.outputs.system.mechanics.mechanism.forces
        if isinstance(part.component, AbstractLineForce)
    )
    links = (*springs, *_strings(moving))
    gravity = (
        np.array(
            ca.DM(ca.evalf(symbolic(run.outputs.system.mechanics.tree.world) @ run.outputs.system.mechanics.tree.gravity))
        ).ravel()
        if run.outputs.system.mechanics.tree.gravity.is_constant()
        else np.zeros(3)
    )
    size = float(np.linalg.norm(gravity))
    up = (0.0, 0.0, 1.0) if size == 0 else tuple(float(-g / size) for g in gravity)
    # a scene that was written as a script has no name of its own
    name = run.outputs.system.flat.name
    moved = [body.name for body in bodies if not any(isinstance(shape, Wire) for shape in body.shapes)]
    title = name if name != System.__name__ or not moved else compact(dict.fromkeys(part.split(".")[0] for part in moved), 3)
    drawn = (*bodies, *_moved_along(moving))
    shown = Animation(title, moving.t, drawn, links, _joints(moving), _trails(bodies), up, pace)  # pyright: ignore[reportArgumentType]
    return replace(shown, links=(*links, *_pushes(moving, _ARROW * shown.size())), bodies=_large_enough(shown))


def _large_enough(shown: Animation) -> tuple[MovingBody, ...]:
    """Bodies too small to be seen, as on orbits, are shown as points."""
    least, ways = shown.thickness(), np.vstack([np.eye(3), -np.eye(3)])

    def extent(body: MovingBody) -> float:
        reach = [np.linalg.norm(support_points(shape, ways), axis=1) for shape in body.shapes]
        return float(np.max(reach, initial=0.0))

    small = [0 < extent(body) < least for body in shown.bodies]
    return tuple(
        replace(body, shapes=(*body.shapes, PointMass())) if is_small else body
        for body, is_small in zip(shown.bodies, small, strict=True)
    )


def _poses(run: Motion, poses: list[Pose]) -> tuple[np.ndarray, np.ndarray]:
    """Positions (k, n, 3) and rotations (k, n, 3, 3) of symbolic poses along a motion, in one evaluation."""
    columns = [ca.vertcat(symbolic(X.position), ca.vec(symbolic(X.rotation))) for X in poses]
    values = run[ca.vertcat(*columns)] if columns else np.zeros((run.t.size, 0))
    stacked = values.reshape(run.t.size, len(poses), 12).transpose(1, 0, 2)
    return stacked[..., :3], stacked[..., 3:].reshape(len(poses), run.t.size, 3, 3).transpose(0, 1, 3, 2)


def _quaternions(R: np.ndarray) -> np.ndarray:
    """(n, 4), scalar first, continuous in time, of rotations (n, 3, 3)."""
    squares = np.stack([
        1 + R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2], 1 + R[:, 0, 0] - R[:, 1, 1] - R[:, 2, 2],
        1 - R[:, 0, 0] + R[:, 1, 1] - R[:, 2, 2], 1 - R[:, 0, 0] - R[:, 1, 1] + R[:, 2, 2],
    ], axis=1)  # fmt: skip
    wx, wy, wz = R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]
    xy, xz, yz = R[:, 1, 0] + R[:, 0, 1], R[:, 0, 2] + R[:, 2, 0], R[:, 2, 1] + R[:, 1, 2]
    w4, x4, y4, z4 = squares.T
    cases = np.stack(
        [np.stack(c, axis=1) for c in ((w4, wx, wy, wz), (wx, x4, xy, xz), (wy, xy, y4, yz), (wz, xz, yz, z4))], axis=1
    )
    q = cases[np.arange(len(R)), np.argmax(squares, axis=1)]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    flips = np.concatenate([[1.0], np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0)])
    return q * np.cumprod(flips)[:, None]


def _bodies(run: Motion) -> tuple[MovingBody, ...]:
    mechanics = run.outputs.system.mechanics
    names: list[str] = []
    shapes: list[tuple[Shape, ...]] = []
    poses: list[Pose] = []
    for group, (link, place) in zip(mechanics.mechanism.groups, mechanics.tree.places, strict=True):
        for part, pose in zip(group.parts, group.part_poses, strict=True):
            component = part.component
            if isinstance(component, AbstractGround) or not isinstance(component, AbstractRigidPart):
                continue
            names.append(part.path)
            own = component.shapes()
            shapes.append((*own, *_arms(component, own, run.outputs)) if own else _skeleton(component, run.outputs))
            poses.append(mechanics.kinematics.pose(link) @ place @ pose)
    edges = [item.edge for item in mechanics.tree.joints]
    for edge in (*edges, *mechanics.mechanism.cuts):
        if edge.joint.shapes():
            link, place = mechanics.placement.ends(edge)[0]
            names.append(edge.name)
            shapes.append(edge.joint.shapes())
            poses.append(mechanics.kinematics.pose(link) @ place)
    positions, rotations = _poses(run, poses)
    return tuple(MovingBody(n, s, p, _quaternions(R)) for n, s, p, R in zip(names, shapes, positions, rotations, strict=True))


def _moved_along(run: Motion) -> tuple[MovingBody, ...]:
    """What touches and guides, as far as the motion comes, where the bodies that it belongs to have no shapes of their own."""
    mechanics = run.outputs.system.mechanics
    shaped = {
        link
        for group, (link, _) in zip(mechanics.mechanism.groups, mechanics.tree.places, strict=True)
        for part in group.parts
        if isinstance(part.component, AbstractRigidPart)
        and not isinstance(part.component, AbstractGround)
        and part.component.shapes()
    }
    edges = [item.edge for item in mechanics.tree.joints]
    parts = [(edge.name, edge.joint) for edge in (*edges, *mechanics.mechanism.cuts)]
    parts += [(force.path, force.component) for force in mechanics.mechanism.forces]
    names: list[str] = []
    shapes: list[tuple[Shape, ...]] = []
    poses: list[Pose] = []
    for name, part in parts:
        ends = [c for c in part.connectors() if isinstance(c, Point)]
        if not isinstance(part, AbstractSeenAlong) or len(ends) != 2:
            continue
        a, b = (mechanics.placement.pose(frame) for frame in ends)
        places = run[symbolic(a.rotation).T @ (symbolic(b.position) - symbolic(a.position))]
        for frame, pose, own in zip(ends, (a, b), part.seen_along(places), strict=True):
            if own and mechanics.placement.place(frame)[0] not in shaped:
                names.append(name)
                shapes.append(own)
                poses.append(pose)
    positions, rotations = _poses(run, poses)
    found = (MovingBody(n, s, p, _quaternions(R)) for n, s, p, R in zip(names, shapes, positions, rotations, strict=True))
    return _as_one_plane(tuple(found))


def _as_one_plane(bodies: tuple[MovingBody, ...]) -> tuple[MovingBody, ...]:
    """Planes that lie in one another, as of all wheels of a cart, are one that is as large as all."""
    found: list[MovingBody] = []
    for body in bodies:
        plane = body.shapes[0]
        if not isinstance(plane, Plane):
            found.append(body)
            continue
        for k, other in enumerate(found):
            one = other.shapes[0]
            if not isinstance(one, Plane):
                continue
            back = turned_back(
                other.quaternions, body.positions + rotated(body.quaternions, np.array(plane.point)) - other.positions
            )
            along = turned_back(other.quaternions, rotated(body.quaternions, np.array(plane.normal)))
            away, size = back - np.array(one.point), plane.size + one.size
            if (
                np.abs(away @ one.normal).max() + size * (1 - along @ one.normal).max() < EDGE * size
                and np.ptp(back, axis=0).max() < EDGE * size
            ):
                reach = 2 * np.abs(away[0]).max() + plane.size
                found[k] = replace(other, shapes=(replace(one, size=max(one.size, float(reach))),))
                break
        else:
            found.append(body)
    return tuple(found)


def _massless_rods(run: Motion) -> tuple[MovingBody, ...]:
    """Constraints between two points, as bars from one to the other."""
    mechanics = run.outputs.system.mechanics
    edges = [edge for edge in mechanics.mechanism.cuts if edge.joint.between_points and not isinstance(edge.joint, AbstractSpan)]
    ends = [mechanics.kinematics.pose(link) @ place for edge in edges for link, place in mechanics.placement.ends(edge)]
    places, _ = _poses(run, ends)
    return tuple(_bar(edge.name, places[2 * k], places[2 * k + 1]) for k, edge in enumerate(edges))


def _bar(name: str, start: np.ndarray, end: np.ndarray) -> MovingBody:
    """Of constant length, along z of a frame that turns with it; ends (n, 3)."""
    along = end - start
    length = np.linalg.norm(along, axis=1)
    z = along / np.where(length > 0, length, 1.0)[:, None]
    x = np.cross(np.eye(3)[np.argmin(np.max(np.abs(z), axis=0))], z)
    size = np.linalg.norm(x, axis=1)
    x = np.where(size[:, None] > 0, x / np.where(size > 0, size, 1.0)[:, None], np.eye(3)[0])
    R = np.stack([x, np.cross(z, x), z], axis=2)
    return MovingBody(name, (Rod((0.0, 0.0, 0.0), (0.0, 0.0, float(np.max(length)))),), start, _quaternions(R))


def _connected(part: AbstractRigidPart, outputs: Outputs) -> list[np.ndarray]:
    """Places where a part is connected, of those that no parameter moves."""
    used = {c for group in outputs.system.flat.connection_sets if len(group) > 1 for c in group}
    return [np.asarray(a.pose.position, dtype=float) for a in part.attachments() if a.connector in used and a.pose.is_constant]


def _arms(part: AbstractRigidPart, shapes: tuple[Shape, ...], outputs: Outputs) -> tuple[Shape, ...]:
    """Bars to the places outside of its shapes where a part is connected, each from the shape that is nearest."""
    found: list[Shape] = []
    for place in _connected(part, outputs):
        reach = [outside(shape, place) for shape in shapes]
        near, start = min(reach, key=lambda item: item[0])
        size = max(float(np.max(np.abs(start))), float(np.max(np.abs(place))))
        if near > _BESIDE * size:
            found.append(Rod(vector_of(start), vector_of(place)))
    return tuple(dict.fromkeys(found))


def _skeleton(part: AbstractRigidPart, outputs: Outputs) -> tuple[Shape, ...]:
    """Lines between the places where a part without a shape is connected."""
    points = _connected(part, outputs)
    extent, unique = float(np.max(np.abs(points), initial=0.0)), list[tuple[float, float, float]]()
    for p in points:
        if not any(np.allclose(p, u, rtol=EDGE, atol=EDGE * extent) for u in unique):
            unique.append((float(p[0]), float(p[1]), float(p[2])))
    if len(unique) == 1:  # to where its mass is
        inertia = part.inertia()
        known = isinstance(inertia.mass, float) and inertia.mass > 0 and isinstance(inertia.moment, np.ndarray)
        centre = np.asarray(inertia.moment, dtype=float) / float(inertia.mass) if known else np.zeros(3)
        if not np.allclose(centre, unique[0], rtol=EDGE, atol=EDGE * extent):
            unique.append(vector_of(centre))
    return (Polygon(tuple(unique)),) if unique else ()


def _link(run: Motion, name: str, force: AbstractLineForce) -> MovingLink:
    kind = "damper" if force.potential(ca.SX.sym("length")).is_zero() else "spring"
    return MovingLink(name, kind, run[force.point_a.position], run[force.point_b.position])


def _pushes(run: Motion, longest: float) -> tuple[MovingLink, ...]:
    """Arrows, the largest of them so long [m], where parts push that open or slide: as long as they push; and the cones that friction keeps them in."""
    system = run.outputs.system
    if system.modes is None:
        return ()
    acting, cones = {row.part.path for row in system.modes.rows}, list[tuple[str, np.ndarray, np.ndarray, float]]()
    mechanics, found = system.mechanics, list[tuple[str, np.ndarray, np.ndarray]]()
    for part, actions in zip(mechanics.mechanism.forces, mechanics.actions, strict=True):
        if part.path not in acting:
            continue
        if isinstance(part.component, AbstractTouch):
            touch = part.component
            found.append((part.path, run[touch.point_b], run[touch.force]))
            if touch.roughness is not None:
                slope = run[1.0 * touch.roughness][0] if isinstance(touch.roughness, Expression) else touch.roughness
                cones.append((part.path, found[-1][1], run[touch.normal_force * touch.normal], float(slope)))
            continue
        for action in actions:
            X = mechanics.placement.pose(action.connector)
            if mechanics.placement.place(action.connector)[0] >= 0:  # the ground does not need to be told
                force = run[symbolic(X.rotation) @ action.force]
                found.append((part.path, run[symbolic(X.position)], force))
    largest = max((float(np.max(np.linalg.norm(force, axis=1))) for _, _, force in found), default=0.0)
    per_force = longest / largest if largest > 0 else 0.0
    arrows = (MovingLink(name, "force", point, point + per_force * force) for name, point, force in found)
    kept_in = (
        MovingLink(name, "cone", point, point + per_force * push, slope) for name, point, push, slope in cones if slope > 0
    )
    return (*arrows, *kept_in)


def _strings(run: Motion) -> tuple[MovingLink, ...]:
    """Lengths between two places that scalar parts act along: ropes, lines of action."""
    mechanics = run.outputs.system.mechanics
    names: list[str] = []
    ends: list[Pose] = []
    for edge in mechanics.mechanism.cuts:
        if not isinstance(edge.joint, AbstractSpan):
            continue
        a, b = (mechanics.kinematics.pose(link) @ place for link, place in mechanics.placement.ends(edge))
        if found := edge.joint.line(a.inverse() @ b):
            names.append(edge.name)
            ends += [a @ Pose(np.eye(3), place) for place in found]
    places, _ = _poses(run, ends)
    return tuple(MovingLink(name, "string", places[2 * k], places[2 * k + 1]) for k, name in enumerate(names))


def _joints(run: Motion) -> tuple[JointMarker, ...]:
    mechanics = run.outputs.system.mechanics
    joints = [(item.edge.name, item.edge.joint) for item in mechanics.tree.joints if not item.edge.implicit]
    joints += [(cut.name, cut.joint) for cut in mechanics.mechanism.cuts if isinstance(cut.joint, AbstractJoint)]
    shown = [(name, joint, kind) for name, joint in joints if (kind := _joint_kind(joint)) is not None]
    poses: list[Pose] = []
    for _, joint, _ in shown:
        link, place = mechanics.placement.place(joint.frame_b)
        X = mechanics.kinematics.pose(link) @ place
        poses.append(Pose(symbolic(X.rotation) @ symbolic(joint.mounting()), X.position))
    positions, rotations = _poses(run, poses)
    return tuple(
        JointMarker(name, kind, p, _quaternions(R)) for (name, _, kind), p, R in zip(shown, positions, rotations, strict=True)
    )


def _joint_kind(joint: AbstractJoint) -> str | None:
    if not isinstance(joint, AbstractStepJoint):
        return None
    steps = joint.steps()
    if any(isinstance(step, Shift) for step in steps):
        return None
    if len(steps) != 1:
        return "other"
    return "slider" if isinstance(steps[0], Slide) else "ball" if isinstance(steps[0], Ball) else "hinge"


def _trails(bodies: tuple[MovingBody, ...]) -> tuple[Trail, ...]:
    """Different paths of the three points that travel furthest: ends of rods, corners of skeletons, else origins."""
    found: list[tuple[float, Trail]] = []
    for body in bodies:
        ends = [np.array(s.end) for s in body.shapes if isinstance(s, Rod)]
        ends += [np.array(p) for s in body.shapes if isinstance(s, Polygon) for p in s.points]
        best: tuple[float, Trail] | None = None
        for end in ends or [np.zeros(3)]:
            points = body.positions + rotated(body.quaternions, end)
            length = float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
            if best is None or length > best[0]:
                best = (length, Trail(body.name, points))
        if best is not None:
            found.append(best)
    found.sort(key=lambda item: -item[0])
    chosen: list[Trail] = []
    for length, trail in found:
        # two bodies that share a hinge share its path
        if length > 0 and not any(np.allclose(trail.points, other.points, rtol=0, atol=1e-3 * length) for other in chosen):
            chosen.append(trail)
    return tuple(chosen[:3])
