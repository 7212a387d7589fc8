"""Random mechanisms with loops: every choice of tree and cuts, every order of declaration, and maximal coordinates move them alike."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st

from acausal.codegen.lower import Functions
from acausal.language.expression import time
from acausal.language.flatten import flatten
from acausal.mechanics.energy import angular_momentum, linear_momentum
from acausal.mechanics.free import FreeJoint, FreePoint
from acausal.mechanics.joint import AbstractJoint
from acausal.mechanics.system import mechanical_system
from acausal.model import Model
from acausal.reduction.outputs import Outputs
from acausal.reduction.reduce import reduce_system
from acausal.topology.build_mechanism import build_mechanism
from acausal.topology.mechanism import Edge, Mechanism, TreeEdge
from tests.formulations import (
    FREEDOMS,
    HELD,
    WHEELS,
    Action,
    Body,
    Joint,
    Maximal,
    Place,
    Sketch,
    after,
    applied,
    between,
    composed,
    constraint,
    displaced,
    flipped,
    free_columns,
    inverse,
    kinetic_energy,
    momenta,
    moving,
    newton_euler,
    quaternion,
    relabelled,
    script,
    turned,
    velocities,
)

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


# random sketches ------------------------------------------------------------------------------------------------------


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
        if freedom > 0 and condition > WELL_CONDITIONED:
            sketch = grown
    return moving(with_actions(sketch, actions, rng), rng)


def mobility(sketch: Sketch) -> tuple[int, float]:
    """Freedoms, and the conditioning of the constraints."""
    still = replace(sketch, twists=np.zeros((len(sketch.bodies), 6)))
    free = free_columns(sketch)
    G = np.vstack([constraint(still, j).rows for j in still.joints] or [np.zeros((0, free.size))])[:, free]
    s = np.linalg.svd(G, compute_uv=False) if G.size else np.zeros(0)
    kept = s[s > 1e-8 * np.max(s, initial=1.0)]
    return int(np.sum(free)) - kept.size, float(kept[-1] / kept[0]) if kept.size else 1.0


def seeded(seed: int) -> Sketch:
    """A random sketch from a number alone."""
    rng = np.random.default_rng(seed)
    kinds = [str(k) for k in rng.choice(TREE, rng.integers(1, 5))]
    growth = [str(k) for k in rng.choice(list(GROWTH), rng.integers(0, 3))]
    return random_sketch(kinds, growth, int(rng.integers(0, 4)), bool(rng.random() < 0.2), seed)


def sketches(floating: bool) -> st.SearchStrategy[Sketch]:
    """With up to eight bodies and three loops."""
    kinds = st.lists(st.sampled_from(TREE), min_size=1 + floating, max_size=3)
    growth = st.lists(st.sampled_from(list(GROWTH)), max_size=2)
    return st.builds(random_sketch, kinds, growth, st.integers(0, 3), st.just(floating), st.integers(0, 2**32 - 1))


FLOATING = sketches(True)
SKETCHES = sketches(False) | FLOATING


# formulations of the package ------------------------------------------------------------------------------------------


def chosen_tree(mechanism: Mechanism, rng: Rng) -> Mechanism:
    return mechanism


def random_spanning_tree(mechanism: Mechanism, rng: Rng) -> Mechanism:
    """Another tree, by drawing edges in random order; massless groups are no leaves of it."""
    edges = [item.edge for item in mechanism.tree] + [cut for cut in mechanism.cuts if isinstance(cut.joint, AbstractJoint)]
    held = tuple(cut for cut in mechanism.cuts if not isinstance(cut.joint, AbstractJoint))
    massless = {i for i, group in enumerate(mechanism.groups) if group.kind == "massless"}
    for _ in range(100):
        known, tree, rest = {0}, [], [edges[i] for i in rng.permutation(len(edges))]
        while len(known) < len(mechanism.groups):
            edge = next(e for e in rest if (e.a in known) != (e.b in known))
            parent, child = (edge.a, edge.b) if edge.a in known else (edge.b, edge.a)
            tree.append(TreeEdge(edge, parent, child))
            known.add(child)
            rest.remove(edge)
            rest = [rest[i] for i in rng.permutation(len(rest))]
        if massless <= {item.parent for item in tree}:
            return replace(mechanism, tree=tuple(tree), cuts=(*rest, *held))
    raise AssertionError("no tree found")


def all_joints_cut(mechanism: Mechanism, rng: Rng) -> Mechanism:
    """Every group free, every joint a constraint; only particles and massless groups hang on a joint of theirs."""
    edges = [item.edge for item in mechanism.tree if not item.edge.implicit] + list(mechanism.cuts)
    tree: list[TreeEdge] = []
    hanging: list[TreeEdge] = []
    for i, group in enumerate(mechanism.groups[1:], 1):
        if group.kind == "massless":
            continue
        tree.append(TreeEdge(Edge(f"free{i}", FreePoint() if group.kind == "point" else FreeJoint(), 0, i, True), 0, i))
    for i, group in enumerate(mechanism.groups):
        if group.kind == "point":
            for one in [e for e in edges if i in (e.a, e.b)]:
                hanging.append(TreeEdge(one, one.a if one.b == i else one.b, i))
                tree = [item for item in tree if item.child != i]
                edges = [e for e in edges if e is not one]
        if group.kind == "massless":  # a massless cross: hinge to one side, its body behind it
            one, two = [e for e in edges if i in (e.a, e.b)][:2]
            near, far = (e.a if e.b == i else e.b for e in (one, two))
            hanging += [TreeEdge(one, near, i), TreeEdge(two, i, far)]
            tree = [item for item in tree if item.child != far]
            edges = [e for e in edges if e is not one and e is not two]
    return replace(mechanism, tree=_parents_first([*tree, *hanging]), cuts=tuple(edges))


def _parents_first(tree: list[TreeEdge]) -> tuple[TreeEdge, ...]:
    known, ordered, rest = {0}, [], list(tree)
    while rest:
        item = next(item for item in rest if item.parent in known)
        known.add(item.child)
        ordered.append(item)
        rest.remove(item)
    return tuple(ordered)


CHOICES = (chosen_tree, random_spanning_tree, all_joints_cut)


class Composed:
    """A sketch from the package's parts."""

    def __init__(self, sketch: Sketch, source: str, choose=chosen_tree, rng: Rng | None = None) -> None:
        self.sketch, self.scene = sketch, composed(source)
        mechanism = build_mechanism(flatten(self.scene))
        self.mechanism = choose(mechanism, rng or np.random.default_rng(0))
        self.outputs = Outputs(reduce_system(mechanical_system(self.mechanism, time.sx)))
        self.functions = Functions(self.outputs)

    def part(self, name: str, k: int):
        return getattr(self.scene, f"{name}{k}")

    @property
    def start(self) -> dict:
        """q and v of the joints in the tree."""
        own = {self.part("j", k): joint for k, joint in enumerate(self.sketch.joints) if joint.kind != "Fixed"}
        values: dict = {}
        for item in self.mechanism.tree:
            joint = item.edge.joint
            if joint in own:
                values[joint.q], values[joint.v] = own[joint].q, velocities(self.sketch, own[joint])
            else:
                values[joint.q], values[joint.v] = self._free(item)
        return values

    def _free(self, item: TreeEdge) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of a free joint from the pose and twist of the first body in the group."""
        group = self.mechanism.groups[item.child]
        part, place = next((p, X) for p, X in zip(group.parts, group.part_poses, strict=True) if p.path[0] == "b")
        k = int(part.path[1:].split("_")[0])
        back = inverse((np.asarray(place.rotation), np.asarray(place.position)))
        local = after(back, (np.asarray(item.edge.pose_b.rotation), np.asarray(item.edge.pose_b.position)))
        R, p = after(self.sketch.place(k), local)
        w, v = self.sketch.twist(k)
        v = v + np.cross(w, p - self.sketch.place(k)[1])
        if isinstance(item.edge.joint, FreePoint):
            return p, v
        return np.concatenate([quaternion(R), p]), np.concatenate([R.T @ w, v])

    @property
    def state(self) -> np.ndarray:
        start = self.start
        joints = [item.edge.joint for item in self.mechanism.tree]
        return np.concatenate([np.zeros(0), *(start[j.q] for j in joints), *(start[j.v] for j in joints)])

    @functools.cached_property
    def values(self) -> dict[str, np.ndarray]:
        """Everything that is compared, at the sketch; one function, since making functions takes most of the time."""
        outputs, s = self.outputs, self.outputs.system
        held = ca.vertcat(angular_momentum(s.mechanics.kinematics), linear_momentum(s.mechanics.kinematics))
        energies = [outputs.kinetic_energy, outputs.potential_energy]
        wanted = {
            "kinetic": outputs.kinetic_energy,
            "powers": ca.vertcat(*(ca.jtimes(e, s.x, s.x_dot) for e in energies), outputs.power_loss),
            "momenta": held,
            "momentum_rates": ca.jtimes(held, s.x, s.x_dot),
            "x_dot": s.x_dot,
            "multipliers": s.multipliers,
            "gap": ca.vertcat(s.position_invariants, s.velocity_invariants),
        }
        for k, body in enumerate(self.sketch.bodies):
            if body.kind != "massless":
                frame = self.part("b", k).point if body.kind == "particle" else self.part("b", k).frame
                turning = ca.SX.zeros(3) if body.kind == "particle" else outputs.resolve(frame.angular_acceleration)
                wanted[f"b{k}"] = ca.vertcat(turning, outputs.resolve(frame.acceleration))
        for k, joint in enumerate(self.sketch.joints):
            if joint.kind != "Fixed":
                end = self.part("j", k).frame_b
                wanted[f"j{k}"] = -ca.vertcat(outputs.resolve(end.torque), outputs.resolve(end.force))
        f = ca.Function("values", [s.t, s.x, s.u, s.p], [ca.densify(e) for e in wanted.values()], {"cse": True})
        found = f.call([ca.DM(0.0), ca.DM(self.state), ca.DM(0, 1), ca.DM(0, 1)])
        return {name: np.array(value).ravel() for name, value in zip(wanted, found, strict=True)}

    def accelerations(self) -> np.ndarray:
        """(bodies, 6); zeros for what has no mass, and for the turning of particles."""
        return np.array([self.values.get(f"b{k}", np.zeros(6)) for k in range(len(self.sketch.bodies))])

    def wrenches(self) -> np.ndarray:
        """(joints, 6) on b at frame_b; zeros for rigid connections."""
        found = [self.values.get(f"j{k}", np.zeros(6)) for k in range(len(self.sketch.joints))]
        return np.array(found).reshape(-1, 6)

    def residual(self) -> float:
        """What is left of Newton-Euler's equations with the accelerations of the explicit form."""
        none, v = ca.DM(0, 1), self.values
        left = self.functions.residual_dynamics(0.0, self.state, v["x_dot"], v["multipliers"], none, none)
        return float(np.max(np.abs(np.array(left))))


# laws -----------------------------------------------------------------------------------------------------------------


def difference(a: np.ndarray, b: np.ndarray, size: float = 0.0) -> float:
    """Largest difference, against the largest entry or `size`."""
    return float(np.max(np.abs(a - b), initial=0.0) / max(np.max(np.abs(b), initial=0.0), size, 1e-300))


def heavy(sketch: Sketch) -> np.ndarray:
    return np.array([body.kind != "massless" for body in sketch.bodies], dtype=bool)


def agrees(model: Composed, maximal: Maximal) -> None:
    """Freedoms, accelerations, reactions where they are unique, and energy, against maximal coordinates."""
    sketch, with_mass = model.sketch, heavy(model.sketch)
    assert np.max(np.abs(model.values["gap"]), initial=0.0) < 1e-12
    assert model.outputs.system.degrees_of_freedom == maximal.freedoms
    assert difference(model.accelerations()[with_mass], maximal.accelerations[with_mass]) < BOUND
    force = float(np.max(np.abs(applied(sketch)), initial=0.0))
    unique = maximal.unique & np.array([joint.kind != "Fixed" for joint in sketch.joints], dtype=bool)
    assert difference(model.wrenches()[unique], maximal.wrenches[unique], force) < BOUND
    assert model.residual() < BOUND * (force + float(np.max(np.abs(maximal.wrenches), initial=0.0)))
    assert difference(model.values["kinetic"], np.array([kinetic_energy(sketch)])) < BOUND
    assert abs(np.sum(model.values["powers"])) < BOUND * np.sum(np.abs(model.values["powers"]))
    if floats(sketch):
        agree_momenta(model)


def agree_momenta(model: Composed) -> None:
    """Only gravity changes the momenta of what floats."""
    sketch = model.sketch
    assert difference(model.values["momenta"], momenta(sketch)) < BOUND
    weights = [(body.mass * sketch.gravity, body.place[1] + body.place[0] @ body.centre) for body in sketch.bodies]
    want = np.concatenate([sum(np.cross(c, f) for f, c in weights), sum(f for f, _ in weights)])
    assert difference(model.values["momentum_rates"], want) < BOUND


def begins_at_the_sketch(model: Composed) -> None:
    """Bodies have their places in the sketch, where all loops are closed: the search has nothing to move."""
    start, found = model.start, model.outputs.system.q_start
    for item in model.outputs.system.tree_joints:
        groups = [model.mechanism.groups[k] for k in (item.edge.a, item.edge.b)]
        if all(group.kind in ("ground", "body") for group in groups):
            q, want = found[item.q].copy(), start[item.edge.joint.q]
            if item.edge.joint.q.start is not None and q[:4] @ want[:4] < 0:
                q[:4] *= -1  # the same orientation
            assert np.max(np.abs(q - want)) < 1e-9


BOUND = 1e-10


def closing_rows(sketch: Sketch) -> int:
    return sum(6 - FREEDOMS[joint.kind] for joint in sketch.joints if joint.kind != "Fixed")


@settings(max_examples=12, deadline=None, derandomize=True)
@given(SKETCHES)
def test_every_tree_and_maximal_coordinates_agree(sketch):
    """With all joints cut only where this gives no more than 20 rows, for the sake of time."""
    source = script(sketch)
    note(source)
    maximal = newton_euler(sketch)
    for choose in CHOICES[: 3 if closing_rows(sketch) <= 20 else 2]:
        model = Composed(sketch, source, choose)
        agrees(model, maximal)
        begins_at_the_sketch(model)


@settings(max_examples=6, deadline=None, derandomize=True)
@given(SKETCHES, st.integers(0, 2**32 - 1))
def test_names_order_ends_and_place_do_not_matter(sketch, seed):
    """Renamed, declared in another order, joints put in backwards, connections made from the other end, all turned and shifted."""
    rng = np.random.default_rng(seed)
    bodies, joints, X = (
        rng.permutation(len(sketch.bodies)),
        rng.permutation(len(sketch.joints)),
        (orientation(rng), rng.normal(size=3)),
    )
    other = displaced(relabelled(sketch, bodies, joints), X)
    particles = {k for k, body in enumerate(other.bodies) if body.kind == "particle"}
    held = tuple(j if j.kind.startswith("Rolling") or j.b in particles else flipped(j) for j in other.joints)
    source, other_source = script(sketch), script(replace(other, joints=held), backwards=True)
    note(source)
    note(other_source)
    want = Composed(sketch, source).accelerations()[bodies]
    got = Composed(replace(other, joints=held), other_source).accelerations()
    assert difference(np.hstack([got[:, :3] @ X[0], got[:, 3:] @ X[0]]), want) < BOUND


TRAJECTORIES = [
    (["Revolute", "Spherical"], ["loop"], 2, 1),
    (["Universal", "RollingBall"], ["loop"], 1, 2),
    (["Cylindrical"], ["planar"], 1, 3),
    (["Prismatic", "Planar"], ["twin", "loop"], 3, 4),
    (["RollingTorus", "Screw"], ["weld"], 2, 5),
]


@pytest.mark.parametrize(("kinds", "growth", "actions", "seed"), TRAJECTORIES)
def test_formulations_move_alike_for_half_a_second(kinds, growth, actions, seed):
    sketch = random_sketch(kinds, growth, actions, False, seed)
    source = script(sketch)
    print(source)
    ends = []
    for choose in CHOICES:
        model = Composed(sketch, source, choose)
        run = Model(model.outputs.system).simulate(0.5, model.start, rtol=1e-12, samples=11, compiled=False, progress=False)
        parts = [model.part("b", k) for k in range(len(sketch.bodies))]
        places = [part.point if body.kind == "particle" else part.frame for part, body in zip(parts, sketch.bodies, strict=True)]
        ends.append(np.hstack([run[place.position] for place in places]))
    for other in ends[1:]:
        assert difference(other, ends[0]) < 1e-9
