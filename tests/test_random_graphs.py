"""Random mechanisms with loops: every choice of tree and cuts, every order of declaration, and maximal coordinates move them alike."""

from __future__ import annotations

import functools
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st

import acausal as ac
from acausal.dynamics.system import mechanical_system
from acausal.language.expression import time
from acausal.language.flatten import flatten
from acausal.model import Model
from acausal.outputs.functions import Functions
from acausal.outputs.outputs import Outputs
from acausal.parts.free import FreeJoint, FreePoint
from acausal.parts.joint import AbstractJoint
from acausal.reduce.reduce import reduce_system
from acausal.reduce.state_space import whole_state_space
from acausal.topology.build_mechanism import build_mechanism
from acausal.topology.mechanism import Edge, Mechanism, TreeEdge
from tests.formulations import (
    FREEDOMS,
    Maximal,
    Sketch,
    after,
    applied,
    composed,
    displaced,
    flipped,
    inverse,
    kinetic_energy,
    momenta,
    newton_euler,
    quaternion,
    relabelled,
    script,
    velocities,
)
from tests.momentum import angular_momentum, linear_momentum
from tests.pairings import each_value
from tests.random_sketches import SKETCHES, floats, orientation, random_sketch

Rng = np.random.Generator
BOUND = 1e-10


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
        self.functions = Functions(self.outputs, whole_state_space(self.outputs.system))

    def part(self, name: str, k: int):
        return getattr(self.scene, f"{name}{k}")

    @functools.cached_property
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
        """Coordinates of a free joint from the pose and twist of a body in the group."""
        group = self.mechanism.groups[item.child]
        known = [
            (int(part.path[1:].split("_")[0]), X)
            for part, X in zip(group.parts, group.part_poses, strict=True)
            if part.path[0] == "b"
        ]
        k, place = min(known, key=lambda item: self.sketch.bodies[item[0]].kind == "particle")  # which has no orientation
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
    """Bodies have their places in the sketch, where all loops are closed: the search has nothing to move. Other parts have none."""
    if any(body.kind != "body" for body in model.sketch.bodies):
        return
    start, found = model.start, model.outputs.system.q_start
    for item in model.outputs.system.tree_joints:
        q, want = found[item.q].copy(), start[item.edge.joint.q]
        if item.edge.joint.q.start is not None and q[:4] @ want[:4] < 0:
            q[:4] *= -1  # the same orientation
        assert np.max(np.abs(q - want)) < 1e-9


def closing_rows(sketch: Sketch) -> int:
    return sum(6 - FREEDOMS[joint.kind] for joint in sketch.joints if joint.kind != "Fixed")


@settings(max_examples=9, deadline=None, derandomize=True)
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
    bodies, joints = rng.permutation(len(sketch.bodies)), rng.permutation(len(sketch.joints))
    X = orientation(rng), rng.normal(size=3)
    other = displaced(relabelled(sketch, bodies, joints), X)
    other = replace(other, joints=tuple(j if j.kind.startswith("Rolling") else flipped(j) for j in other.joints))
    source, other_source = script(sketch), script(other, backwards=True)
    note(source)
    note(other_source)
    want = Composed(sketch, source).accelerations()[bodies]
    got = Composed(other, other_source).accelerations()
    assert difference(np.hstack([got[:, :3] @ X[0], got[:, 3:] @ X[0]]), want) < BOUND


TRAJECTORIES = [
    (["Revolute", "Spherical"], ["loop"], 2, 1),
    (["Universal", "RollingBall"], ["loop"], 1, 2),
    (["Cylindrical"], ["planar"], 1, 3),
    (["Prismatic", "Planar"], ["twin", "loop"], 3, 4),
    (["RollingTorus", "Screw"], ["weld"], 2, 5),
]


@pytest.mark.filterwarnings("ignore::acausal.errors.ContactWarning")  # forces at random pull wheels off, too
@pytest.mark.parametrize(("kinds", "growth", "actions", "seed"), TRAJECTORIES)
def test_formulations_move_alike_for_half_a_second(kinds, growth, actions, seed):
    sketch = random_sketch(kinds, growth, actions, False, seed)
    source = script(sketch)
    print(source)
    ends = []
    for choose in CHOICES[: 3 if closing_rows(sketch) <= 20 else 2]:
        model = Composed(sketch, source, choose)
        run = Model(model.outputs.system).simulate(0.5, model.start, rtol=1e-12, samples=11, compiled=False, progress=False)
        parts = [model.part("b", k) for k in range(len(sketch.bodies))]
        places = [part.point if body.kind == "particle" else part.frame for part, body in zip(parts, sketch.bodies, strict=True)]
        ends.append(np.hstack([run[place.position] for place in places]))
    for other in ends[1:]:
        assert difference(other, ends[0]) < 1e-9


FOUND = [
    pytest.param(["Cylindrical"], ["twin"], 0, 15, id="a doubled joint, whose constraints are rounding errors"),
    pytest.param(["Universal", "Prismatic"], ["twin", "twin"], 1, 3, id="two doubles"),
    pytest.param(["Spherical", "Planar"], ["weld", "spherical", "loop"], 2, 48, id="redundant constraints beside others"),
    pytest.param(
        ["RollingDisk", "Spherical", "Revolute"], ["cardan", "spherical", "weld", "loop"], 2, 56, id="with a massless cross"
    ),
    pytest.param(
        ["CartesianTranslation", "Spherical", "RollingBall"], ["loop", "loop"], 1, 4, id="ball joints that begin at a sketch"
    ),
]


@pytest.mark.parametrize(("kinds", "growth", "actions", "seed"), FOUND)
def test_what_longer_searches_found(kinds, growth, actions, seed):
    sketch = random_sketch(kinds, growth, actions, False, seed)
    source = script(sketch)
    print(source)
    for choose in CHOICES[:2]:
        model = Composed(sketch, source, choose, np.random.default_rng(seed))
        agrees(model, newton_euler(sketch))
        begins_at_the_sketch(model)


@each_value(("seed", [0, 4, 8]), ("kind", ["Revolute", "Prismatic", "Spherical", "Cylindrical", "Screw"]))
def test_a_body_on_two_joints_that_are_one_moves_as_on_one(kind, seed):
    """A door on two hinges, drawn askew: what the second asks for is rounding errors alone, and decides nothing."""
    sketch = random_sketch([kind], ["twin"], 0, False, seed)
    places: list[np.ndarray] = []
    for joints in (sketch.joints, sketch.joints[:1]):
        scene = composed(script(replace(sketch, joints=joints)))
        start = {scene.j0.v: ac.near(velocities(sketch, joints[0]))}
        run = ac.build(scene).simulate(0.5, start, rtol=1e-10, samples=5, progress=False)
        places.append(run[scene.b0.frame.position])
    assert difference(*places) < 1e-8
