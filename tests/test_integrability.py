"""Integrability of velocity constraints: growth vectors from textbooks, hidden integrals, and what a model says of its constraints."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal import errors
from acausal.explain.constraint_table import ConstraintTable
from acausal.explain.integrability.classification import integrability
from acausal.explain.integrability.derived import derived_system
from acausal.explain.integrability.frobenius import growth, integrable_alone
from acausal.explain.integrability.integral import Integral
from acausal.explain.integrability.pfaffian import PfaffianSystem
from acausal.explain.integrability.scene import integrals
from acausal.explain.integrability.velocity_forms import velocity_system
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, rotation_about_z
from components import (
    Brake,
    Gear,
    Prismatic,
    Revolute,
    RigidBody,
    RollingBall,
    RollingDisk,
    RollingEllipsoid,
    RollingTorus,
    SlidingMass,
    SpeedSource,
    World,
)
from tests.scenes import FourBar

Forms = Callable[..., Sequence[Sequence[ca.SX | float]]]
sin, cos = ca.sin, ca.cos


def pfaffian(names: str, forms: Forms, holonomic: Callable[..., ca.SX] | None = None, start: Sequence[float] | None = None):
    y = [ca.SX.sym(name) for name in names.split()]
    rows = ca.vertcat(*(ca.horzcat(*row) for row in forms(*y)))
    closing = ca.SX(0, 1) if holonomic is None else holonomic(*y)
    begin = np.zeros(len(y)) if start is None else np.array(start, dtype=float)
    labels = tuple(f"row {i + 1}" for i in range(rows.shape[0]))
    return PfaffianSystem(ca.vertcat(*y), closing, rows, tuple(names.split()), labels, begin)


def car(trailers: int) -> PfaffianSystem:
    """Hooked at the middle of the axle before, at distance 1; every axle's wheels do not slip sideways (Laumond, 1993)."""

    def forms(x: ca.SX, y: ca.SX, *o: ca.SX) -> list[list[ca.SX | float]]:
        rows: list[list[ca.SX | float]] = []
        for i in range(len(o)):
            along = [cos(o[i]) * cos(o[j]) + sin(o[i]) * sin(o[j]) if 0 < j <= i else 0.0 for j in range(len(o))]
            rows.append([sin(o[i]), -cos(o[i]), *along])
        return rows

    return pfaffian("x y " + " ".join(f"o{i}" for i in range(trailers + 1)), forms)


def knife(x, y, o):
    return [[sin(o), -cos(o), 0]]


def upright_disk(x, y, yaw, spin):
    return [[1, 0, 0, -0.3 * cos(yaw)], [0, 1, 0, -0.3 * sin(yaw)]]


def snakeboard(x, y, o, rotor, steer):
    return [[-sin(o + steer), cos(o + steer), -cos(steer), 0, 0], [-sin(o - steer), cos(o - steer), cos(steer), 0, 0]]


def axle(x, y, o, a, b):
    return [[sin(o), -cos(o), 0, 0, 0], [cos(o), sin(o), 0.5, -0.25, 0], [cos(o), sin(o), -0.5, 0, -0.25]]


TEXTBOOK = {
    "knife edge": (lambda: pfaffian("x y o", knife), (2, 3)),
    "upright disk": (lambda: pfaffian("x y yaw spin", upright_disk), (2, 3, 4)),
    "Heisenberg's system": (lambda: pfaffian("x y z", lambda x, y, z: [[-y, x, 1]]), (2, 3)),
    "Martinet's flat system": (lambda: pfaffian("x y z", lambda x, y, z: [[y * y, 0, -1]], start=[0, 1, 0]), (2, 3)),
    "Engel's system": (lambda: pfaffian("x y z w", lambda x, y, z, w: [[z, -1, 0, 0], [w, 0, -1, 0]]), (2, 3, 4)),
    # Ostrowski and others, 1994: steering and rotor free, three constraints' worth of brackets
    "snakeboard": (lambda: pfaffian("x y o rotor steer", snakeboard, start=[0, 0, 0, 0, 0.3]), (3, 4, 5)),
    "two wheels on one axle": (lambda: pfaffian("x y o a b", axle), (2, 3, 4)),
} | {f"car with {n} trailers": ((lambda n=n: car(n)), tuple(range(2, n + 4))) for n in range(6)}


@pytest.mark.parametrize("name", list(TEXTBOOK))
def test_growth_vectors_are_those_of_the_textbooks(name):
    make, wanted = TEXTBOOK[name]
    system = make()
    found = growth(system)
    assert found.growth == wanted
    assert found.clear
    assert found.hidden == system.y.numel() - wanted[-1]


@pytest.mark.parametrize("name", [name for name in TEXTBOOK if name[-10:] not in ("4 trailers", "5 trailers")])
def test_the_exact_and_the_numerical_test_agree(name):
    system = TEXTBOOK[name][0]()
    exact = derived_system(system)
    assert exact is not None
    assert (exact.hidden, exact.alone) == (growth(system).hidden, integrable_alone(system, system.points()))
    # one bracket is the same in both flags; growth by one dimension at a time makes all the others the same
    assert exact.growth == TEXTBOOK[name][1]


TOGETHER = {
    "w, 2 w": (lambda x, y, z: [[1, z, 0], [1, 2 * z, 0]], 2),
    "three in space": (lambda x, y, z: [[1, z, 0], [0, 1, x], [y, 0, 1]], 3),
    "gradients mixed by their coordinates": (lambda x, y, z: [[y + z, x, x], [y - x * z, x - x * z, -x * x]], 2),
}


@pytest.mark.parametrize("name", list(TOGETHER))
def test_constraints_that_are_nonholonomic_alone_can_be_holonomic_together(name):
    forms, hidden = TOGETHER[name]
    system = pfaffian("x y z", forms, start=[1, 1.3, 0.7])
    found = integrability(system).blocks[0]
    assert not all(found.alone)
    assert found.holonomic
    assert found.hidden == hidden
    assert found.method == "exact"


def test_constraints_that_are_holonomic_alone_are_so_together():
    found = integrability(pfaffian("x y z", lambda x, y, z: [[y, -x, 0], [0, z, y]], start=[1, 1, 1])).blocks[0]
    assert found.alone == (True, True)
    assert found.holonomic


@pytest.mark.parametrize("seed", range(6))
def test_what_is_hidden_among_random_combinations_is_found(seed):
    """Gradients of k random functions and, for odd seeds, the form of a knife edge, mixed by a matrix that changes from place to place."""
    rng = np.random.default_rng(seed)
    print("seed", seed)
    n, k = 6, int(rng.integers(1, 3))
    y = ca.SX.sym("y", n)
    M = rng.normal(size=(k, n, n))
    functions = ca.vertcat(*(ca.dot(rng.normal(size=n), y) + 0.2 * ca.sin(y.T @ M[i] @ y) for i in range(k)))
    rows = ca.jacobian(functions, y)
    if seed % 2:
        rows = ca.vertcat(rows, ca.horzcat(sin(y[2]), -cos(y[2]), 0, 0, 0, 0))
    m = rows.shape[0]
    mix = rng.normal(size=(m, m)) + 0.5 * ca.diag(ca.sin(y[:m] + y[m - 1]))
    system = PfaffianSystem(
        y, ca.SX(0, 1), mix @ rows, tuple(f"y{i}" for i in range(n)), tuple(f"w{i}" for i in range(m)), np.zeros(n)
    )
    found = growth(system)
    assert found.hidden == k
    assert found.integrable == (seed % 2 == 0)
    assert found.clear


def test_redundant_rows_and_the_order_of_rows_do_not_matter():
    def doubled(x, y, o, a, b):
        rows = [list(map(ca.SX, row)) for row in axle(x, y, o, a, b)]
        return [[p - ca.sin(y) * q for p, q in zip(rows[2], rows[0], strict=True)], rows[1], rows[0], rows[2]]

    found = growth(pfaffian("x y o a b", doubled))
    assert found.growth == (2, 3, 4)
    assert len(found.independent) == 3


CLOSED = {
    "a ratio": ("x y", lambda x, y: [[y, -x]], lambda x, y: x / y),
    "a cam": ("s o", lambda s, o: [[1, -(1 + 0.5 * cos(o))]], lambda s, o: s - o - 0.5 * sin(o)),
    "a factor exp(x y)": ("x y z", lambda x, y, z: [[y * z, x * z, 1]], lambda x, y, z: x * y + ca.log(z)),
    "a product": ("x y z", lambda x, y, z: [[y * z, x * z, x * y]], lambda x, y, z: x * y * z),
    "a string on a cone": ("r o", lambda r, o: [[sin(o), r * cos(o)]], lambda r, o: r * sin(o)),
    "a turn in cosine and sine": (
        "c s x", lambda c, s, x: [[-0.3 * s, 0.3 * c, -1]], lambda c, s, x: x - 0.3 * ca.atan2(s, c)
    ),
    "straight on at a constant heading": ("x o s", lambda x, o, s: [[0, 1, 0], [1, sin(o), -cos(o)]], lambda x, o, s: x - s * cos(o)),
    "straight on at a sum that stays": (
        "x y s w", lambda x, y, s, w: [[1, 1, 0, 0], [0, 0, -sin(x + y), 1]], lambda x, y, s, w: w - s * sin(x + y)
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", list(CLOSED))
def test_closed_forms_of_integrals(name):
    """The wanted function and those found have dependent gradients."""
    names, forms, wanted = CLOSED[name]
    circle = (lambda c, s, x: 0.5 * (c * c + s * s - 1)) if name.startswith("a turn") else None
    system = pfaffian(names, forms, circle, [1.0, 0.0, 0.4] if circle else [1.0, 1.2, 0.7, 0.4][: len(names.split())])
    found = integrability(system)
    assert len(found.integrals) == found.hidden
    y = system.y
    expressions = ca.vertcat(*(i.expression for i in found.integrals), system.holonomic)
    both = ca.Function("both", [y], [ca.densify(ca.jacobian(expressions, y)), ca.jacobian(wanted(*ca.vertsplit(y)), y)])
    for point in system.points(5, seed=11):
        own, reference = (np.array(part) for part in both(point))
        weights = np.linalg.lstsq(own.T, reference[0], rcond=None)[0]
        assert np.max(np.abs(own.T @ weights - reference[0])) < 1e-12 * np.max(np.abs(reference))


def test_where_no_closed_form_is_found_that_is_said():
    found = integrability(pfaffian("x o", lambda x, o: [[1, ca.sqrt(1 + 0.5 * sin(o) ** 2)]])).blocks[0]
    assert (found.holonomic, found.hidden, found.integrals, found.method) == (True, 1, (), "numerical")
    assert "1 without a closed form" in str(found)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda y: PfaffianSystem(y, ca.SX(0, 1), ca.SX(1, 3), ("a", "b"), ("w",), np.zeros(2)), ("shape (1, 2)", "(1, 3)")),
        (lambda y: PfaffianSystem(y, ca.SX(0, 1), ca.SX.sym("k", 1, 2), ("a", "b"), ("w",), np.zeros(2)), ("k_0", "w", "a, b")),
    ],
)
def test_messages(make, words):
    with pytest.raises(errors.ModelError) as caught:
        make(ca.SX.sym("y", 2))
    assert all(word in str(caught.value) for word in words)


def test_a_manifold_without_points_is_said():
    system = pfaffian("x y", lambda x, y: [[y, -1]], lambda x, y: x * x + y * y + 1)
    with pytest.raises(errors.AssemblyError, match="x, y"):
        integrability(system)


# scenes


def rolling(contact: AbstractJoint, body: RigidBody) -> ac.System:
    scene = ac.System()
    scene.world, scene.body, scene.contact = World(), body, contact
    scene.connect(scene.world.frame, contact.frame_a)
    scene.connect(body.frame, contact.frame_b)
    return scene


@pytest.mark.parametrize(
    ("contact", "reach", "method"),
    [
        (lambda: RollingDisk(0.3, "y"), (3, 4, 5), "exact"),
        (lambda: RollingBall(0.1), (3, 5), "exact"),
        (lambda: RollingTorus(0.3, 0.02, "y"), (3, 5), "exact"),
        (lambda: RollingEllipsoid((0.2, 0.1, 0.12)), (3, 5), "numerical"),
    ],
)
def test_bodies_that_roll_on_a_plane_are_nonholonomic(contact, reach, method):
    """Two constraints on five freedoms; every position can be reached (ball: 3, 5, Brockett and Dai 1993)."""
    table = ac.build(rolling(contact(), RigidBody(1.0, (0.1, 0.1, 0.1)))).constraints()
    (block,) = table.velocity.blocks
    assert (table.configuration_freedom, table.velocity_freedom, table.hidden) == (5, 3, 0)
    assert (block.growth, block.manifold, block.method) == (reach, 5, method)
    slips = [entry for entry in table if "rolling" in entry.name]
    assert [entry.kind for entry in slips] == ["nonholonomic"] * 2
    assert all(entry.kept for entry in slips)


def disk_on_a_line() -> ac.System:
    scene = ac.System()
    scene.world, scene.carriage, scene.disk = World(), RigidBody(1.0, (1, 1, 1)), RigidBody.disk(1.0, 0.3, axis="y")
    scene.rail, scene.hub, scene.contact = Prismatic("x"), Revolute("y"), RollingDisk(0.3, "y")
    scene.connect(scene.world.at((0, 0, 0.3)), scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.carriage.frame, scene.hub.frame_a)
    scene.connect(scene.hub.frame_b, scene.disk.frame, scene.contact.frame_b)
    scene.connect(scene.world.frame, scene.contact.frame_a)
    return scene


def test_a_disk_that_rolls_along_a_line_is_holonomic():
    model = ac.build(disk_on_a_line())
    table = model.constraints()
    (integral,) = integrals(model.system)
    assert str(integral) == "rail.q - 0.3 hub.q = constant"
    assert np.allclose(integral.coefficients, [1, -0.3], atol=1e-14)
    kept = [entry for entry in table if entry.kept]
    assert [entry.kind for entry in kept] == ["holonomic"]
    assert sorted(entry.kind for entry in table if "rolling" in entry.name) == ["holonomic", "vanishing"]
    assert [str(i) for i in kept[0].integrals] == [str(integral)]
    assert (table.configuration_freedom, table.velocity_freedom, table.hidden) == (2, 1, 1)


def wheeled(axles: int) -> ac.System:
    """A box on pairs of wheels of radius 0.2 m, 0.6 m apart."""
    scene = ac.System()
    scene.world, scene.body = World(), RigidBody.box(5.0, (1.0, 0.6, 0.2))
    places = [(0.5 - i, 0.3 * side, 0.0) for i in range(axles) for side in (1, -1)]
    scene.hubs = [Revolute("y") for _ in places]
    scene.wheels = [RigidBody.disk(0.5, 0.2, axis="y") for _ in places]
    scene.contacts = [RollingDisk(0.2, "y") for _ in places]
    for place, hub, wheel, contact in zip(places, scene.hubs, scene.wheels, scene.contacts, strict=True):
        scene.connect(scene.body.at(place), hub.frame_a)
        scene.connect(hub.frame_b, wheel.frame, contact.frame_b)
        scene.connect(scene.world.frame, contact.frame_a)
    return scene


@functools.cache
def one_axle() -> tuple[ac.System, ac.Model, ConstraintTable]:
    """One pair of wheels."""
    scene = wheeled(1)
    model = ac.build(scene)
    return scene, model, model.constraints()


def drift(model: ac.Model, found: Iterable[Integral], start: dict[ac.Variable, float]) -> tuple[list[float], list[float]]:
    """How much each integral found changes along a motion, and each coordinate."""
    run = model.simulate(1.0, start, rtol=1e-10, samples=21, compiled=False, progress=False)
    constants = [float(np.ptp(run[i.expression])) for i in found]
    return constants, [float(np.ptp(run[q])) for q in ca.vertsplit(model.system.mechanics.tree.q)]


def test_two_wheels_on_an_axle_turn_it_by_the_difference_of_their_angles():
    """Yaw + r (a - b) / (2 half track): hidden among four constraints none of which is integrable alone."""
    scene, model, table = one_axle()
    assert (table.configuration_freedom, table.velocity_freedom, table.hidden) == (6, 3, 1)
    assert {entry.kind for entry in table if "rolling" in entry.name} == {"nonholonomic", "redundant"}
    (integral,) = table.velocity.integrals
    ratios = sorted(np.abs(integral.coefficients[np.abs(integral.coefficients) > 1e-12]))
    assert np.allclose(ratios, [0.2 / 0.6, 0.2 / 0.6, 1.0], rtol=1e-12)
    constants, coordinates = drift(model, table.velocity.integrals, {scene.hubs[0].v: 3.0, scene.hubs[1].v: 1.0})
    assert max(constants) < 1e-9 < 0.1 < max(coordinates)


def test_a_cart_on_fixed_axles_goes_straight_on():
    """Heading, three angles between wheels, and the place along the heading: seven freedoms of position, one of motion, six integrals."""
    scene = wheeled(2)
    model = ac.build(scene)
    table = model.constraints()
    assert (table.configuration_freedom, table.velocity_freedom, table.hidden) == (7, 1, 6)
    assert len(table.velocity.integrals) == 6
    assert len(integrals(model.system, exact=False)) == 4
    constants, coordinates = drift(model, table.velocity.integrals, {scene.hubs[0].v: 3.0})
    assert max(constants) < 1e-9 < 0.1 < max(coordinates)


def test_a_ball_in_a_groove_is_holonomic():
    """It can only go on, or back: one velocity is always integrable."""
    scene = ac.System()
    scene.world, scene.ball, scene.contacts = World(), RigidBody.ball(1.0, 0.1), [RollingBall(0.1), RollingBall(0.1)]
    for contact, side in zip(scene.contacts, (1, -1), strict=True):
        R = np.array([[1, 0, 0], [0, 0.8, -0.6 * side], [0, 0.6 * side, 0.8]])
        scene.connect(scene.world.at((0, 0, 0), rotation=R), contact.frame_a)
        scene.connect(scene.ball.frame, contact.frame_b)
    table = ac.build(scene).constraints()
    assert (table.configuration_freedom, table.velocity_freedom, table.hidden) == (4, 1, 3)
    assert {entry.kind for entry in table if "rolling" in entry.name and entry.kept} == {"holonomic"}


class Rack(ac.Component):
    """The rack moves with the pinion's rim: der(s) = radius der(phi)."""

    pinion = ac.Rotational.port()
    rack = ac.Translational.port()

    def __init__(self, radius: float | ac.Parameter) -> None:
        self.radius = radius

    def equations(self):
        yield ac.equal(ac.der(self.rack.s), self.radius * ac.der(self.pinion.phi))
        yield ac.equal(self.pinion.tau, -1.0 * self.radius * self.rack.f)


class Fast(ac.Component):
    """Not linear in velocities: der(s)^2 = 1 + der(phi)^2."""

    pinion = ac.Rotational.port()
    rack = ac.Translational.port()

    def equations(self):
        yield ac.equal(ac.der(self.rack.s) * ac.der(self.rack.s), 1 + ac.der(self.pinion.phi) * ac.der(self.pinion.phi))
        yield ac.equal(self.pinion.tau, -0.3 * self.rack.f)


def slide_and_hinge(between: ac.Component) -> ac.System:
    scene = ac.System()
    scene.world, scene.slide, scene.hinge = World(), Prismatic("x"), Revolute("y")
    scene.a, scene.b, scene.between = RigidBody(1.0, (1, 1, 1)), RigidBody(1.0, (1, 1, 1)), between
    scene.connect(scene.world.frame, scene.slide.frame_a, scene.hinge.frame_a)
    scene.connect(scene.slide.frame_b, scene.a.frame)
    scene.connect(scene.hinge.frame_b, scene.b.frame)
    scene.connect(scene.hinge.flange, between.pinion)
    scene.connect(scene.slide.flange, between.rack)
    return scene


def test_rack_and_pinion_are_holonomic_for_every_radius():
    radius = ac.Parameter(0.3, "m")
    model = ac.build(slide_and_hinge(Rack(radius)))
    (integral,) = integrals(model.system)
    assert integral.text == "slide.q - 0.3 hinge.q"
    assert not integral.fixed_parameters
    slope = ca.Function("slope", [radius.sx], [ca.densify(ca.jacobian(integral.expression, model.system.mechanics.tree.q))])
    assert np.allclose(slope(0.7).full(), [[1, -0.7]], atol=1e-14)
    assert [entry.kind for entry in model.constraints()] == ["holonomic"]


def test_integrals_of_combinations_say_that_they_hold_for_present_parameters():
    radius = ac.Parameter(0.2, "m")
    other = ac.System()
    other.world, other.body = World(), RigidBody.box(5.0, (1.0, 0.6, 0.2))
    other.hubs, other.wheels = [Revolute("y"), Revolute("y")], [RigidBody.disk(0.5, 0.2, axis="y") for _ in range(2)]
    other.contacts = [RollingDisk(radius, "y") for _ in range(2)]
    for side, hub, wheel, contact in zip((1, -1), other.hubs, other.wheels, other.contacts, strict=True):
        other.connect(other.body.at((0.5, 0.3 * side, 0)), hub.frame_a)
        other.connect(hub.frame_b, wheel.frame, contact.frame_b)
        other.connect(other.world.frame, contact.frame_a)
    assert [i.fixed_parameters for i in integrals(ac.build(other).system)] == [True]
    assert [i.fixed_parameters for i in one_axle()[2].velocity.integrals] == [False]


def test_a_given_speed_is_a_rheonomic_constraint():
    scene = slide_and_hinge(Rack(0.5))
    scene.motor = SpeedSource(lambda t: 1 + t * t)
    scene.connect(scene.hinge.flange, scene.motor.flange)
    model = ac.build(scene)
    table = model.constraints()
    assert sorted(entry.kind for entry in table) == ["holonomic", "rheonomic"]
    q, t = model.system.mechanics.tree.q, model.system.t
    names = velocity_system(model.system).coordinate_names
    hinge = q[names.index("hinge.q")]
    drifting = next(i.expression for i in integrals(model.system) if ca.depends_on(i.expression, t))
    both = ca.Function("both", [q, t], [ca.jacobian(drifting, t) / ca.jacobian(drifting, hinge)])
    assert np.isclose(float(both(np.zeros(2), 0.7)), -(1 + 0.7**2), rtol=1e-13)


def test_equations_that_are_not_linear_in_velocities_are_not_judged():
    (entry,) = ac.build(slide_and_hinge(Fast())).constraints()
    assert entry.kind == "nonholonomic"
    assert "not examined" in entry.known


class Skate(AbstractJoint):
    """A blade on ice: x, y and heading; it goes along itself and turns."""

    q = ac.Variable("", "x [m], y [m], heading [rad]", size=3)
    v = ac.Variable("", "speed [m/s], rate of turn [rad/s]", size=2)

    def pose(self, q, t):
        return Pose(rotation_about_z(q[2]), ca.vertcat(q[0], q[1], 0))

    def rates(self, q, v, t):
        return ca.vertcat(v[0] * cos(q[2]), v[0] * sin(q[2]), v[1])


def test_a_joint_that_only_says_what_its_velocities_do_is_examined_too():
    """Chaplygin's sleigh: growth (2, 3)."""
    table = ac.build(rolling(Skate(), RigidBody(1.0, (1, 1, 1)))).constraints()
    (block,) = table.velocity.blocks
    assert (block.growth, block.alone, block.method) == ((2, 3), (False,), "exact")
    assert [entry.kind for entry in table] == ["nonholonomic"]


def test_a_four_bar_has_holonomic_and_vanishing_constraints_only():
    table = ac.build(FourBar()).constraints()
    assert [entry.kind for entry in table] == ["holonomic"] * 2 + ["vanishing"] * 3
    assert (table.configuration_freedom, table.velocity_freedom, table.hidden) == (1, 1, 0)
    assert "a shift" in str(table)


def test_gears_are_holonomic_and_named():
    scene = ac.System()
    scene.world, scene.joints, scene.gear = World(), [Revolute("y"), Revolute("y")], Gear(3.0)
    scene.bodies = [RigidBody(1.0, (1, 1, 1)) for _ in range(2)]
    for joint, body, flange in zip(scene.joints, scene.bodies, (scene.gear.flange_a, scene.gear.flange_b), strict=True):
        scene.connect(scene.world.frame, joint.frame_a)
        scene.connect(joint.frame_b, body.frame)
        scene.connect(joint.flange, flange)
    (entry,) = ac.build(scene).constraints()
    assert entry.kind == "holonomic"
    assert "gear" in entry.name


def test_a_hundred_constraints_are_told_in_a_few_lines():
    scene = ac.System()
    scene.world = World()
    scene.balls, scene.contacts = [RigidBody.ball(1.0, 0.1) for _ in range(34)], [RollingBall(0.1) for _ in range(34)]
    for ball, contact in zip(scene.balls, scene.contacts, strict=True):
        scene.connect(scene.world.frame, contact.frame_a)
        scene.connect(ball.frame, contact.frame_b)
    table = ac.build(scene).constraints()
    assert len(table) == 3 * 34
    assert (table.configuration_freedom, table.velocity_freedom) == (5 * 34, 3 * 34)
    assert len(str(table).splitlines()) < 6
    assert "33 more like it" in str(table)


def test_a_pendulum_has_no_constraints():
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World(), Revolute("y"), RigidBody.rod(1.0, (0, 0, -1))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    table = ac.build(scene).constraints()
    assert len(table) == 0
    assert str(table) == "System: 0 constraints, 1 freedom in configuration, 1 in velocity, 0 hidden integrals"


def test_scenes_without_joints_have_no_rows():
    """Mass and friction on a line: nothing to examine, and no error for it."""
    scene = ac.System()
    scene.mass = SlidingMass(1.0)
    scene.brake = Brake(scene.mass.flange_a, capacity=0.5)
    assert str(ac.build(scene).constraints()).startswith("System: 0 constraints")
