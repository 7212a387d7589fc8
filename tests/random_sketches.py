"""Random sketches of mechanisms: trees of bodies on all kinds of joints, grown by loops that fit, redundant ones too."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from tests.formulations import (
    FREEDOMS,
    HELD,
    WHEELS,
    Action,
    Body,
    Joint,
    Place,
    Sketch,
    after,
    between,
    constraint,
    flipped,
    free_columns,
    inverse,
    moving,
    quaternion,
    turned,
)  # fmt: skip

Rng = np.random.Generator
TREE = [kind for kind in FREEDOMS if kind != "Fixed"]
"""Kinds of joints."""
CLOSING = [
    "Revolute",
    "Prismatic",
    "Cylindrical",
    "Universal",
    "Spherical",
    "Planar",
    "Screw",
    "CartesianTranslation",
    "RollingBall",
    "RollingTorus",
]
WELL_CONDITIONED = 3e-3


def direction(rng: Rng) -> np.ndarray:
    u = rng.normal(size=3)
    return u / np.linalg.norm(u)


def orientation(rng: Rng) -> np.ndarray:
    return turned(direction(rng), rng.uniform(-3, 3))


def random_body(rng: Rng) -> Body:
    """Masses and sizes over three decades and one."""
    mass, R = 10 ** rng.uniform(-1.5, 1.5), orientation(rng)
    second = rng.uniform(0.2, 1, 3) * (0.1 * 10 ** rng.uniform(-0.5, 0.5))
    inertia = mass * R @ np.diag(np.sum(second) - second) @ R.T
    return Body((orientation(rng), rng.normal(size=3)), mass, 0.3 * rng.normal(size=3), 0.5 * (inertia + inertia.T))


def options(kind: str, rng: Rng) -> dict:
    """For the constructor."""
    if kind in ("Revolute", "Prismatic", "Cylindrical"):
        return {"axis": direction(rng)}
    if kind == "Screw":
        return {"axis": direction(rng), "pitch": rng.choice([-1, 1]) * rng.uniform(0.1, 2)}
    if kind == "Universal":
        R = orientation(rng)
        return {"axis_a": R[0], "axis_b": R[1]}
    if kind == "Planar":
        return {"normal": "xyz"[rng.integers(3)]}
    if kind == "RollingEllipsoid":
        return {"semi_axes": rng.uniform(0.2, 1, 3)}
    if kind.startswith("Rolling"):
        made = {"radius": rng.uniform(0.2, 1)}
        made |= {"tube": rng.uniform(0.02, 0.2)} if kind == "RollingTorus" else {}
        return made if kind == "RollingBall" else made | {"axis": "y"}
    return {}


def coordinates(kind: str, rng: Rng) -> np.ndarray:
    """Of a joint."""
    R, p = orientation(rng), rng.uniform(-1, 1, 3)
    if kind in WHEELS:
        return rng.uniform(-1, 1, 5)
    if kind == "Spherical":
        return quaternion(R)
    if kind == "Free":
        return np.concatenate([quaternion(R), p])
    if kind.startswith("Rolling"):
        return np.concatenate([quaternion(R), p[:2]])
    return p[: FREEDOMS[kind]]


def joined(sketch: Sketch, kind: str, a: int, b: int, rng: Rng, world: Place | None = None, **given) -> Joint:
    """A joint of random options at a random place, or at the place `world` of its frame_a."""
    world = world or (orientation(rng), rng.normal(size=3))
    return between(kind, sketch, a, b, world, coordinates(kind, rng), **(given or options(kind, rng)))


def with_joints(sketch: Sketch, *joints: Joint) -> Sketch:
    return replace(sketch, joints=(*sketch.joints, *joints))


def random_tree(kinds: list[str], rng: Rng, floating: bool) -> Sketch:
    """A body for each kind, held by an earlier body or the world; if `floating`, nothing is held by the world.

    Behind sliders there are particles sometimes.
    """
    bodies = [random_body(rng) for _ in kinds]
    sketch = Sketch(np.array([0.3, -9.0, 2.0]), tuple(bodies), ())
    for k, kind in enumerate(kinds):
        if floating and k == 0:
            continue
        a = int(rng.integers(0 if floating else -1, k))
        while a >= 0 and sketch.bodies[a].kind == "particle":
            a -= 1
        if kind in ("Prismatic", "CartesianTranslation") and rng.random() < 0.4:
            own = Body((np.eye(3), sketch.bodies[k].place[1]), sketch.bodies[k].mass, kind="particle")
            sketch = replace(sketch, bodies=(*sketch.bodies[:k], own, *sketch.bodies[k + 1 :]))
            sketch = with_joints(sketch, particle_joint(sketch, kind, a, k, rng))
        else:
            joint = joined(sketch, kind, a, k, rng)
            swap = rng.random() < 0.5 and not kind.startswith("Rolling")
            sketch = with_joints(sketch, flipped(joint) if swap else joint)
    return sketch


def particle_joint(sketch: Sketch, kind: str, a: int, b: int, rng: Rng) -> Joint:
    """A joint whose far frame is at a particle, which has the orientation that the joint gives it."""
    frame_a = (sketch.place(a)[0].T @ orientation(rng), rng.normal(size=3))
    given = options(kind, rng)
    R, p = after(sketch.place(a), frame_a)
    gap = R.T @ (sketch.place(b)[1] - p)
    if kind == "CartesianTranslation":
        return Joint(kind, a, b, frame_a, HELD, given, gap)
    turn = turned(np.cross([0, 0, 1.0], gap), np.arccos(gap[2] / np.linalg.norm(gap)))  # the axis towards the particle
    return Joint(
        kind, a, b, (frame_a[0] @ turn, frame_a[1]), HELD, {"axis": np.array([0, 0, 1.0])}, np.array([np.linalg.norm(gap)])
    )


def floats(sketch: Sketch) -> bool:
    """Whether no joint is at the world."""
    return all(min(joint.a, joint.b) >= 0 for joint in sketch.joints)


def rigid(sketch: Sketch) -> list[int]:
    """Numbers of bodies that have frames; the world's too, unless the sketch floats."""
    return [-1] * (not floats(sketch)) + [k for k, body in enumerate(sketch.bodies) if body.kind == "body"]


def plain_loop(sketch: Sketch, rng: Rng) -> Sketch:
    """One more joint of any kind between two random parts, placed where it fits."""
    ends = rigid(sketch)
    if len(ends) < 2:
        return sketch
    a, b = rng.choice(ends, 2, replace=False)
    return with_joints(sketch, joined(sketch, CLOSING[rng.integers(len(CLOSING))], int(a), int(b), rng))


def twin(sketch: Sketch, rng: Rng) -> Sketch:
    """A joint doubled: all the twin's constraints are redundant."""
    bodies = {-1, *rigid(sketch)}
    able = [j for j in sketch.joints if j.kind in ("Revolute", "Prismatic", "Cylindrical") and {j.a, j.b} <= bodies]
    if not able:
        return sketch
    joint = able[rng.integers(len(able))]
    axis = joint.options["axis"]
    aside = rng.normal() * axis if joint.kind != "Prismatic" else rng.normal(size=3)
    offset = (turned(axis, rng.uniform(-1, 1)) if joint.kind != "Prismatic" else np.eye(3), aside)
    return with_joints(sketch, replace(joint, frame_a=after(joint.frame_a, offset), frame_b=after(joint.frame_b, offset)))


def hinge_loop(sketch: Sketch, rng: Rng, spherical: bool) -> Sketch:
    """Four or five new bars whose hinges are parallel in a skewed plane, or meet in a point, both ends on one earlier part."""
    base, count = int(rng.choice(rigid(sketch))), int(rng.integers(4, 6))
    first = len(sketch.bodies)
    sketch = replace(sketch, bodies=(*sketch.bodies, *(random_body(rng) for _ in range(count - 1))))
    chain = [base, *range(first, first + count - 1), base]
    common, centre = direction(rng), rng.normal(size=3)
    for a, b in itertools.pairwise(chain):
        axis = direction(rng) if spherical else common * rng.choice([-1, 1])
        where = centre if spherical else centre + rng.normal(size=3)
        R = orientation(rng)
        sketch = with_joints(sketch, joined(sketch, "Revolute", a, b, rng, (R, where), axis=R.T @ axis))
    return sketch


def planar_loop(sketch: Sketch, rng: Rng) -> Sketch:
    return hinge_loop(sketch, rng, False)


def spherical_loop(sketch: Sketch, rng: Rng) -> Sketch:
    return hinge_loop(sketch, rng, True)


def welded(sketch: Sketch, rng: Rng) -> Sketch:
    """One more body or particle, rigidly fixed to a part."""
    a, k = int(rng.choice(rigid(sketch))), len(sketch.bodies)
    body = random_body(rng)
    if rng.random() < 0.5:
        body = Body((np.eye(3), body.place[1]), body.mass, kind="particle")
    sketch = replace(sketch, bodies=(*sketch.bodies, body))
    at_a, at_b = (
        (orientation(rng), rng.normal(size=3)),
        HELD if body.kind == "particle" else (orientation(rng), rng.normal(size=3)),
    )
    R, p = after(inverse(after(sketch.place(a), at_a)), after(body.place, at_b))
    return with_joints(sketch, Joint("Fixed", a, k, at_a, at_b, {"position": p, "rotation": R}, np.zeros(0)))


def cardan(sketch: Sketch, rng: Rng) -> Sketch:
    """One more body on two hinges with a massless cross between."""
    a, k = int(rng.choice(rigid(sketch))), len(sketch.bodies)
    sketch = replace(
        sketch, bodies=(*sketch.bodies, Body((orientation(rng), rng.normal(size=3)), kind="massless"), random_body(rng))
    )
    return with_joints(sketch, joined(sketch, "Revolute", a, k, rng), joined(sketch, "Revolute", k, k + 1, rng))


GROWTH: dict[str, Callable[[Sketch, Rng], Sketch]] = {
    "loop": plain_loop, "twin": twin, "planar": planar_loop, "spherical": spherical_loop, "weld": welded, "cardan": cardan,
}  # fmt: skip


def with_actions(sketch: Sketch, count: int, rng: Rng) -> Sketch:
    """Springs and dampers between random points, forces and torques; between bodies only if the sketch floats."""
    actions = []
    able = [-1] * (not floats(sketch)) + [k for k, body in enumerate(sketch.bodies) if body.kind != "massless"]
    for _ in range(count if len(able) > 1 else 0):
        kind = ["Spring", "Damper", "SpringDamper", "Force", "Torque"][rng.integers(3 if floats(sketch) else 5)]
        a, b = (int(k) for k in rng.choice(able, 2, replace=False))
        ends = [(k, np.zeros(3) if k >= 0 and sketch.bodies[k].kind == "particle" else rng.normal(size=3)) for k in (a, b)]
        made = {"stiffness": rng.uniform(1, 50)} if "Spring" in kind else {}
        made |= {"natural_length": rng.uniform(0.1, 1)} if "Spring" in kind else {}
        made |= {"damping": rng.uniform(0.1, 5)} if "Damper" in kind else {}
        if kind in ("Force", "Torque"):
            ends = [end for end in ends if end[0] >= 0][:1]
            point = sketch.bodies[ends[0][0]].kind == "particle"
            kind = "Force" if point else kind
            made = {kind.lower(): rng.normal(size=3), "resolved_in": "world" if point else ["world", "body"][rng.integers(2)]}
        actions.append(Action(kind, made, tuple(ends)))
    return replace(sketch, actions=tuple(actions))


def random_sketch(kinds: list[str], growth: list[str], actions: int, floating: bool, seed: int) -> Sketch:
    """A tree grown by loops and other things, in motion. What would lock it or is nearly singular is left out: constraints whose
    least singular value is below 3e-3 of the largest multiply rounding errors by more than accelerations are compared to."""
    rng = np.random.default_rng(seed)
    sketch = random_tree(kinds, rng, floating)
    for name in growth:
        grown = GROWTH[name](sketch, rng)
        freedom, condition = mobility(grown)
        if freedom > 0 and condition > WELL_CONDITIONED and not holds_itself(grown):
            sketch = grown
    return moving(with_actions(sketch, actions, rng), rng)


def holds_itself(sketch: Sketch) -> bool:
    """Whether a joint is between bodies that are rigidly connected."""
    groups = list(range(len(sketch.bodies) + 1))  # the world is the last
    for joint in sketch.joints:
        if joint.kind == "Fixed":
            old, new = groups[joint.b], groups[joint.a]
            groups = [new if group == old else group for group in groups]
    return any(joint.kind != "Fixed" and groups[joint.a] == groups[joint.b] for joint in sketch.joints)


def mobility(sketch: Sketch) -> tuple[int, float]:
    """Freedoms, and the conditioning of the constraints."""
    still = replace(sketch, twists=np.zeros((len(sketch.bodies), 6)))
    free = free_columns(sketch)
    G = np.vstack([constraint(still, j).rows for j in still.joints] or [np.zeros((0, free.size))])[:, free]
    s = np.linalg.svd(G, compute_uv=False) if G.size else np.zeros(0)
    kept = s[s > 1e-8 * np.max(s, initial=1.0)]
    return int(np.sum(free)) - kept.size, float(kept[-1] / kept[0]) if kept.size else 1.0


def seeded(seed: int) -> Sketch:
    """One of up to 20 bodies, from a number alone: for searches that take longer than a test may."""
    rng = np.random.default_rng(seed)
    kinds = [str(kind) for kind in rng.choice(TREE, rng.integers(2, 6))]
    growth = [str(name) for name in rng.choice(list(GROWTH), rng.integers(1, 5))]
    return random_sketch(kinds, growth, int(rng.integers(0, 4)), bool(rng.random() < 0.2), seed)


def sketches(floating: bool) -> st.SearchStrategy[Sketch]:
    """With up to eight bodies and three loops."""
    kinds = st.lists(st.sampled_from(TREE), min_size=1 + floating, max_size=3)
    growth = st.lists(st.sampled_from(list(GROWTH)), max_size=2)
    return st.builds(random_sketch, kinds, growth, st.integers(0, 3), st.just(floating), st.integers(0, 2**32 - 1))


FLOATING = sketches(True)
SKETCHES = sketches(False) | FLOATING
