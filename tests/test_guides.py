"""Points, bodies and balls along curves and over surfaces: closed forms of the classical systems, and what they cost."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal import errors
from components import (
    AlongCurve,
    CentralField,
    Circle,
    Cone,
    Cylinder,
    HeightField,
    Helix,
    KnifeEdge,
    Line,
    MutualGravitation,
    ParametricCurve,
    ParametricSurface,
    Particle,
    Planar,
    Plane,
    PointOnCurve,
    PointOnSurface,
    PrescribedMotion,
    RigidBody,
    RollingBall,
    RollingBallOnSurface,
    Sphere,
    Spherical,
    SplineCurve,
    Torus,
    World,
)
from tests.pairings import each_value

G = 9.81


def on(joint, body, gravity=(0.0, 0.0, -G)) -> ac.System:
    """A particle or body on a joint on the ground."""
    scene = ac.System()
    scene.world, scene.guide, scene.body = World(gravity), joint, body
    scene.connect(scene.world.frame, joint.frame_a)
    scene.connect(joint.frame_b, body.point if isinstance(body, Particle) else body.frame)
    return scene


@pytest.mark.parametrize("size", [1e-6, 0.2, 1e6])
def test_a_bead_on_a_helix_falls_at_constant_rate(size):
    scene = on(PointOnCurve(Helix(size, 0.25 * size)), Particle(2.0))
    model = ac.build(scene)
    assert len(model.state_names) == 2
    time = np.sqrt(size)
    run = model.simulate(2 * time, {scene.guide.q: 0.3, scene.guide.v: 1 / time}, rtol=1e-12)
    assert abs(run[scene.guide.q][-1] - (0.3 + 2 - 2 * G * 0.25 / (1 + 0.25**2))) < 1e-13


@pytest.mark.parametrize("begin", [0.1, 1.0, 2.5, 3.0])
def test_a_cycloid_is_a_tautochrone(begin):
    curve = ParametricCurve(lambda a: (a + ca.sin(a), 0, -ca.cos(a)), unit="rad")
    scene = on(PointOnCurve(curve), Particle(2.0))
    run = ac.build(scene).simulate(4 * np.pi / np.sqrt(G), {scene.guide.q: begin}, rtol=1e-12)
    assert abs(run[scene.guide.q][-1] - begin) < 1e-12


def test_a_bead_on_a_hoop_that_turns_stands_where_gravity_and_turning_agree():
    """cos(theta) = g / (omega^2 R) from the bottom; O'Reilly, 11.4."""
    scene = ac.System()
    scene.world, scene.drive = World(), PrescribedMotion(axis="z", angle=6.0 * ac.time)
    scene.hoop, scene.bead = PointOnCurve(Circle(0.5)), Particle(0.1)
    scene.connect(scene.world.frame, scene.drive.frame_a)
    upright = RigidBody(1.0, (1.0, 1.0, 1.0))
    scene.carrier = upright
    scene.connect(scene.drive.frame_b, upright.frame)
    scene.connect(upright.at((0, 0, 0), ("x", np.pi / 2)), scene.hoop.frame_a)
    scene.connect(scene.hoop.frame_b, scene.bead.point)
    angle = np.arccos(G / (36 * 0.5))
    run = ac.build(scene).simulate(3.0, {scene.hoop.q: angle - np.pi / 2}, rtol=1e-12)
    assert np.max(np.abs(run[scene.hoop.q] - (angle - np.pi / 2))) < 1e-11


def test_a_track_of_points_keeps_the_energy():
    scene = on(PointOnCurve(SplineCurve([(0, 0, 1), (1, 0, 0.2), (2, 0, 0.6), (2.5, 0.5, 0)])), Particle(1.0))
    assert ac.build(scene).simulate(0.5, {scene.guide.q: 0.5}, rtol=1e-10).energy_error() < 1e-11


def at_borders(size: float) -> dict[str, tuple[ac.System, dict, str]]:
    """Scenes that run to where a part has no meaning, all lengths times `size`, with what is said of it."""
    G_ = (0.0, 0.0, -G * size)
    track = SplineCurve(size * np.array([(0, 0, 1), (1, 0, 0.2), (2, 0, 0.6), (2.5, 0.5, 0)]))
    bead, car = on(PointOnCurve(track), Particle(1.0), G_), on(AlongCurve(track), RigidBody(1.0, (size**2,) * 3), G_)
    cycloid = ParametricCurve(lambda a: (size * (a + ca.sin(a)), 0, -size * ca.cos(a)), unit="rad")
    cusp, askew = on(PointOnCurve(cycloid), Particle(1.0), G_), on(AlongCurve(Circle(size), "y"), RigidBody(1.0, (size**2,) * 3))
    apex = on(PointOnSurface(Cone(0.7)), Particle(1.0), G_)
    field = ParametricSurface(lambda a, b: (size * a, size * b, size * (a + 0.1 * b**2)), ends=((-1, 1), (-1, 1)))
    slope = on(PointOnSurface(field), Particle(1.0), G_)
    ball = on(RollingBallOnSurface(0.05 * size, field), RigidBody.ball(1.0, 0.05 * size), G_)
    track_start = 2.5 * size, 3.0 * size
    return {
        "bead": (bead, dict(zip((bead.guide.q, bead.guide.v), track_start, strict=True)), "The curve ends there"),
        "car": (car, dict(zip((car.guide.q, car.guide.v), track_start, strict=True)), "The curve ends there"),
        "cusp": (cusp, {cusp.guide.q: 1.0, cusp.guide.v: 40.0}, "cusp"),
        "side": (askew, {askew.guide.q: 0.5, askew.guide.v: 3.0}, "runs along `side`"),
        "apex": (apex, {apex.guide.q: (0.5 * size, 0.2 * size), apex.guide.v: (0, 0)}, "apex"),
        "surface": (slope, {slope.guide.q: (0.5, 0.2), slope.guide.v: (0, 0)}, "The surface ends there"),
        "ball": (ball, {ball.guide.q[4:]: (0.5, 0.2), ball.guide.v: (0, 0, 0)}, "the surface ends there"),
    }


@pytest.mark.parametrize("name", at_borders(1.0))
def test_a_motion_ends_by_name_where_a_part_has_no_meaning_any_more(name):
    """In any unit of length at the same instant, with other events; what comes before is right."""
    instants: list[float] = []
    for size in (1e-6, 1.0, 1e5):
        scene, start, words = at_borders(size)[name]
        model = ac.build(scene)
        with pytest.raises(errors.SimulationError, match=words) as caught:
            model.simulate(4.0, start, rtol=1e-10, events=[ac.when(ac.time - 0.01)])
        assert "'guide' (" in str(caught.value) and (
            name == "ball" or "guide.q" in str(caught.value)
        )  # six coordinates are too many to tell
        run = caught.value.trajectory
        assert [event.time for event in run.events] == pytest.approx([0.01])
        assert name in ("side", "cusp", "apex") or run.energy_error() < 1e-8  # the last step is singular
        instants.append(run.t[-1])
    assert np.ptp(instants) < 1e-7 * instants[0]


def test_fewest_states_and_derivatives_end_where_the_motion_does():
    scene, start, words = at_borders(1.0)["bead"]
    model = ac.build(scene)
    minimal = model.minimal(start).simulate(2.0, raise_on_failure=False)
    assert minimal.status.kind.name == "OUTSIDE"
    assert minimal.t[-1] == pytest.approx(model.simulate(2.0, start, raise_on_failure=False).t[-1], rel=1e-9)
    with pytest.raises(errors.SimulationError, match=words):
        model.sensitivities([0.1, 2.0], wrt=[scene.guide.q], start=start)
    model.sensitivities([0.1, 0.2], wrt=[scene.guide.q], start=start)


def test_a_curve_may_cross_itself():
    """A figure of eight, passed at constant speed: each time around takes as long."""
    curve = ParametricCurve(lambda a: (ca.sin(a), 0.5 * ca.sin(2 * a), 0), unit="rad")
    scene = on(PointOnCurve(curve), Particle(1.0))
    run = ac.build(scene).simulate(
        8.0, {scene.guide.v: 3.0}, rtol=1e-12, events=[ac.when(scene.body.point.position[0], "rising")]
    )
    assert np.ptp(np.diff([event.time for event in run.events])) < 1e-10
    speed = np.linalg.norm(run[scene.body.point.velocity], axis=1)
    assert np.ptp(speed) < 1e-11


@pytest.mark.parametrize("field", [CentralField(1.0), MutualGravitation(1.0)])
def test_a_field_in_whose_centre_a_body_falls_is_named(field):
    scene = ac.System()
    scene.world, scene.field, scene.body, scene.other = World((0, 0, 0)), field, Particle(1.0), Particle(2.0)
    at = {scene.body.point.position: (1.0, 0.3, 0), scene.other.point.position: (0, 0, 5), scene.other.point.velocity: (0, 0, 0)}
    if isinstance(field, MutualGravitation):
        at[scene.other.point.position] = (0, 0, 0)
    with pytest.raises(errors.SimulationError, match=r"The energy of 'field.*' \(.*test_guides.py:\d+\) grows without end"):
        ac.build(scene).simulate(5.0, {**at, scene.body.point.velocity: (0, 0, 0)})


def test_a_car_passes_a_looping():
    """As a bead, plus the turning of the car: v = 6 m/s at the bottom of a circle of 1 m."""
    car = RigidBody.box(2.0, (0.3, 0.2, 0.1))
    scene = on(AlongCurve(ParametricCurve(lambda a: (ca.sin(a), 0, 1 - ca.cos(a)), unit="rad")), car)
    run = ac.build(scene).simulate(3.0, {scene.guide.v: 7.0}, rtol=1e-12)
    inertia = 2.0 + float(np.asarray(car.central_inertia)[1, 1])
    a, w = run[scene.guide.q].ravel(), run[scene.guide.v].ravel()
    assert np.max(np.abs(0.5 * inertia * (w**2 - 49.0) + 2.0 * G * (1 - np.cos(a)))) < 1e-11
    assert a[-1] > 2 * np.pi
    assert np.max(np.abs(run[car.frame.rotation][:, 0, 0] - np.cos(a))) < 1e-12


def test_a_rod_slides_with_both_ends_on_wires():
    """Ends on the axes x and z of a plane: with the rod's middle at sin and cos of one angle, it is a pendulum of length 2 l / 3."""
    scene = ac.System()
    scene.world, scene.floor, scene.wall = World(), PointOnCurve(Line((1, 0, 0))), PointOnCurve(Line((0, 0, 1)))
    scene.one, scene.two, scene.rod = Spherical(), Spherical(), RigidBody.rod(1.0, (1.0, 0, 0), radius=0.01)
    for begin, end in ((scene.world.frame, scene.floor.frame_a), (scene.world.frame, scene.wall.frame_a)):
        scene.connect(begin, end)
    scene.connect(scene.floor.frame_b, scene.one.frame_a)
    scene.connect(scene.one.frame_b, scene.rod.frame)
    scene.connect(scene.wall.frame_b, scene.two.frame_a)
    scene.connect(scene.two.frame_b, scene.rod.tip)
    run = ac.build(scene).simulate(0.5, {scene.floor.q: 0.6, scene.wall.q: 0.8}, rtol=1e-11)
    across = 0.25 + 1 / 12 + 0.01**2 / 4
    angle = np.arctan2(0.6, 0.8)
    found = solve_ivp(lambda t, y: [y[1], 0.5 * G * np.sin(y[0]) / across], (0, 0.5), [angle, 0], rtol=1e-12, atol=1e-14).y[0, -1]
    assert abs(run[scene.floor.q][-1].item() - np.sin(found)) < 1e-9
    assert run.constraint_error() < 1e-13


SURFACES = {
    "plane": Plane(),
    "sphere": Sphere(1.0),
    "cylinder": Cylinder(0.5),
    "torus": Torus(1.0, 0.3),
    "cone": Cone(0.5),
    "heights": HeightField(lambda x, y: x**2 + 0.5 * y**2 - x * y**2),
    "helicoid": ParametricSurface(lambda a, b: (a * ca.cos(b), a * ca.sin(b), 0.1 * b), start=(1.0, 0.0)),
}


@pytest.mark.parametrize("name", SURFACES)
def test_no_force_along_a_smooth_surface_and_no_multiplier(name):
    """Newton's law in the directions of the surface, at random states; the normal is across the slopes and turns as its curvature says."""
    surface = SURFACES[name]
    scene = on(PointOnSurface(surface), Particle(2.0))
    model = ac.build(scene)
    s, q, v = model.system, scene.guide.q.sx, scene.guide.v.sx
    slopes, normal = surface.slopes(q), surface.normal(q)
    push = model.functions.outputs.resolve(scene.body.point.acceleration) - ca.vertcat(0, 0, -G)
    turning = ca.jtimes(normal, q, surface.rates(q, v)) - slopes @ surface.curvature(q) @ v
    rows = ca.vertcat(slopes.T @ push, slopes.T @ normal, ca.vec(surface.metric(q) - slopes.T @ slopes), turning)
    f = ca.Function("f", [s.x], [rows])
    rng = np.random.default_rng(1)
    for _ in range(5):
        x = rng.uniform(0.3, 1.0, s.x.numel())
        if q.numel() == 4:
            x[:4] /= np.linalg.norm(x[:4])
        assert np.max(np.abs(np.array(f(x)))) < 1e-12
    assert model.degrees_of_freedom == 2
    assert s.constraints.jacobian.shape[0] == 0


def test_a_particle_passes_both_poles_of_a_sphere():
    """The spherical pendulum has no singular position here: a vertical circle at 7 m/s, energy and plane kept."""
    scene = on(PointOnSurface(Sphere(1.0)), Particle(2.0))
    run = ac.build(scene).simulate(
        5.0, {scene.body.point.position: (0, 0, -1), scene.body.point.velocity: (7.0, 0, 0)}, rtol=1e-12
    )
    assert run.energy_error() < 1e-12
    assert np.max(np.abs(run[scene.body.point.position][:, 1])) < 1e-12
    assert np.max(run[scene.body.point.position][:, 2]) > 0.99


def test_a_particle_circles_in_a_cone():
    """v^2 = g z, whatever the cone."""
    scene = on(PointOnSurface(Cone(0.7)), Particle(2.0))
    height = 0.5 / np.tan(0.7)
    run = ac.build(scene).simulate(
        3.0, {scene.guide.q: (0.5, 0), scene.body.point.velocity[1]: np.sqrt(G * height), scene.guide.v[0]: 0.0}, rtol=1e-12
    )
    assert np.max(np.abs(run[scene.body.point.position][:, 2] - height)) < 1e-11


def test_a_sleigh_turns_as_chaplygin_says():
    """Along the blade u and turning w: m u^2 + (J + m a^2) w^2 is constant, and w decays to nothing; no other motion is left."""
    scene = on(Planar(), RigidBody(2.0, (0.2, 0.2, 0.3), (0.4, 0, 0)), None)
    scene.blade = KnifeEdge()
    scene.connect(scene.world.frame, scene.blade.frame_a)
    scene.connect(scene.blade.frame_b, scene.body.frame)
    frame = scene.body.frame
    run = ac.build(scene).simulate(20.0, {frame.angular_velocity[2]: 1.0, frame.velocity[0]: 0.3}, rtol=1e-13)
    x = run[frame.rotation][:, :, 0]
    u, w = np.einsum("ni,ni->n", x, run[frame.velocity]), run[frame.angular_velocity][:, 2]
    whole = 0.3 + 2.0 * 0.4**2
    rate = np.sqrt((2.0 * 0.3**2 + whole) / 2.0)  # u tends to it: u' = a w^2, (J + m a^2) w' = -m a u w
    begin, k = np.arctanh(0.3 / rate), 2.0 * 0.4 * rate / whole
    assert np.max(np.abs(u - rate * np.tanh(k * run.t + begin))) < 1e-11
    assert np.max(np.abs(w - rate * np.sqrt(2.0 / whole) / np.cosh(k * run.t + begin))) < 1e-11


def test_a_ball_rolls_in_a_bowl_as_a_longer_pendulum():
    """theta'' = -5/7 g / (R - r) sin(theta)."""
    scene = on(RollingBallOnSurface(0.1, Sphere(1.0, inside_out=True)), RigidBody.ball(2.0, 0.1))
    model = ac.build(scene)
    assert len(model.state_names) == 11
    run = model.simulate(5.0, {scene.body.frame.position: (0.9 * np.sin(0.5), 0, -0.9 * np.cos(0.5))}, rtol=1e-12)
    found = solve_ivp(
        lambda t, y: [y[1], -5 / 7 * G / 0.9 * np.sin(y[0])], (0, 5.0), [0.5, 0], method="DOP853", rtol=1e-13, atol=1e-14
    ).y[0, -1]
    assert abs(run[scene.body.frame.position][-1, 0] - 0.9 * np.sin(found)) < 1e-11


def test_a_ball_in_a_standing_cylinder_does_not_fall_out_of_it():
    """Its height swings with sqrt(2/7) of the rate of its turns about the axis; Routh."""
    scene = on(RollingBallOnSurface(0.1, Cylinder(1.0, inside_out=True)), RigidBody.ball(2.0, 0.1))
    start = {scene.body.frame.position: (0.9, 0, 0), scene.body.frame.velocity: (0, 0.9 * 3.0, 0)}
    run = ac.build(scene).simulate(6.0, start, rtol=1e-12)
    rate = np.sqrt(2 / 7) * 3.0
    assert np.max(np.abs(run[scene.body.frame.position][:, 2] + 5 / 7 * G / rate**2 * (1 - np.cos(rate * run.t)))) < 1e-11


@pytest.mark.filterwarnings("ignore:.*pulls:acausal.errors.ContactWarning")  # held on both sides
@pytest.mark.parametrize("name", ["plane", "torus", "heights", "sphere"])
def test_a_ball_that_rolls_does_not_slip_and_keeps_its_energy(name):
    surface = SURFACES[name]
    scene = on(RollingBallOnSurface(0.1, surface), RigidBody(2.0, (0.005, 0.006, 0.007), (0.01, 0, 0.02)))
    model = ac.build(scene)
    run = model.simulate(1.0, {scene.guide.v: (1.0, 0.5, -2)}, rtol=1e-12)
    assert run.energy_error() < 1e-12
    q = scene.guide.q.sx[4:]
    slip = run[scene.body.frame.velocity] - 0.1 * np.cross(
        run[scene.body.frame.angular_velocity], run[ac.Expression(surface.normal(q), frozenset((scene.guide.q,)))]
    )
    assert np.max(np.abs(slip)) < 1e-13


def test_a_ball_on_a_plane_rolls_as_the_contact_with_a_plane_says():
    body = {"mass": 2.0, "inertia": (0.005, 0.006, 0.007), "centre_of_mass": (0.01, 0, 0.02)}
    ends: list[np.ndarray] = []
    for contact in (RollingBallOnSurface(0.1, Plane()), RollingBall(0.1)):
        scene = on(contact, RigidBody(**body))
        frame = scene.body.frame
        run = ac.build(scene).simulate(1.0, {frame.angular_velocity: (1.0, 0.5, -2), frame.rotation[0, 0]: 1.0}, rtol=1e-12)
        ends.append(run[frame.position][-1])
    assert np.max(np.abs(ends[0] - ends[1])) < 1e-12


def test_a_ball_too_large_for_its_bowl_is_refused():
    scene = on(RollingBallOnSurface(0.2, Sphere(0.1, inside_out=True)), RigidBody.ball(2.0, 0.2))
    with pytest.raises(errors.AssemblyError, match="larger than the hollow"):
        ac.build(scene)


@each_value(
    ("size", [1e-7, 1e-3, 1.0, 1e4]),
    (
        "curve",
        [
            lambda size: SplineCurve([(0, 0, size), (size, 0.3 * size, 0.2 * size), (2 * size, 0, 0.6 * size)]),
            lambda size: ParametricCurve(lambda s: (size * s, size * ca.sin(s), 0), ends=(2.0, 2.001), unit="rad"),
            lambda size: ParametricCurve(lambda s: (s, size * ca.sin(s / size), 0), ends=(-9 * size, -8 * size), unit="m"),
        ],
    ),
)
def test_points_begin_between_the_ends_of_a_curve_of_any_size(curve, size):
    """And at the same place of it."""
    places: list[np.ndarray] = []
    for one in (size, 1.0):
        scene = on(PointOnCurve(curve(one)), Particle(1.0))
        x = ac.build(scene).initial_state().x[0]
        ends = scene.guide.curve.ends
        places.append((x - ends[0]) / (ends[1] - ends[0]))
    assert 0 < places[0] < 1 and abs(places[0] - places[1]) < 1e-9


@pytest.mark.parametrize("size", [1e-7, 1.0, 1e4])
def test_a_ball_begins_where_its_bowl_is_wide_enough_at_any_radius(size):
    """It is too large for the bottom, where a search begins; also with other parameters than at build."""
    scene = ac.System()
    scene.world, scene.size, scene.factor = World((0, 0, -G)), ac.Parameter(size, "m"), ac.Parameter(0.55)
    radius = scene.factor * scene.size
    scene.guide = RollingBallOnSurface(radius, HeightField(lambda x, y: (x * x + y * y) / scene.size.sx))
    scene.body = RigidBody.ball(2.0, radius)
    scene.connect(scene.world.frame, scene.guide.frame_a)
    scene.connect(scene.guide.frame_b, scene.body.frame)
    model = ac.build(scene)
    for values in ({}, {scene.factor: 0.9}, {scene.size: 1.5 * size}):
        state = model.initial_state(parameters=values)
        u, v = state.x[4:6] / values.get(scene.size, size)
        slopes = np.array([1, 2 * u, 2 * v])
        stretch = 1 - values.get(scene.factor, 0.55) * 2 / np.linalg.norm(slopes)  # at most, across the slope
        assert 0 < stretch < 1


def test_parameters_that_only_a_curve_knows_are_parameters_of_the_scene():
    radius = ac.Parameter(0.5, "m")
    scene = on(PointOnCurve(Circle(2 * radius)), Particle(1.0), gravity=(0, -G, 0))
    model = ac.build(scene)
    for value in (0.5, 0.8):
        run = model.simulate(1.0, {scene.guide.q: -1.4}, parameters={radius: value}, rtol=1e-10, samples=2)
        fixed = on(PointOnCurve(Circle(2 * value)), Particle(1.0), gravity=(0, -G, 0))
        expected = ac.build(fixed).simulate(1.0, {fixed.guide.q: -1.4}, rtol=1e-10, samples=2)
        assert abs(run[scene.guide.q][-1] - expected[fixed.guide.q][-1]) < 1e-8


@pytest.mark.parametrize(
    "make",
    [
        lambda: Line((0, 0, 0)),
        lambda: ParametricCurve(lambda s: (s, 0)),
        lambda: ParametricCurve(3.0),
        lambda: ParametricCurve(lambda s: (1, 2, 3)),
        lambda: ParametricSurface(lambda a, b: (a, a * a, 0)),
        lambda: SplineCurve([(0, 0, 0), (1, 0, 0)]),
        lambda: SplineCurve([(0, 0, 0), (1, 0, 0), (1, 0, 0)]),
        lambda: HeightField(lambda x: x),
        lambda: PointOnCurve(Plane()),
        lambda: PointOnSurface(Circle(1.0)),
        lambda: Circle(-1.0),
    ],
)
def test_what_is_no_curve_or_surface_is_refused_with_the_line(make):
    with pytest.raises(errors.ParameterError, match=r"test_guides.py:\d+"):
        make()


def test_tracks_and_wires_are_drawn_where_their_curves_are():
    """Of plain numbers, and where they end or are closed; those that change with time or parameters, or have no end, are not."""
    rail = SplineCurve([(0, 0, 1), (1, 0, 0.2), (2, 0, 0.6), (2.5, 0.5, 0)])
    for guide, curve, whole in (
        (PointOnCurve(Circle(0.4)), Circle(0.4), (0, 2 * np.pi)),
        (PointOnCurve(rail, unilateral=True).joint, rail, (rail.spline.x[0], rail.spline.x[-1])),
        (AlongCurve(rail), rail, (rail.spline.x[0], rail.spline.x[-1])),
    ):
        (wire,) = guide.shapes()
        at = np.linspace(*whole, len(wire.points))
        s = ca.SX.sym("s")
        expected = np.array(ca.Function("place", [s], [curve.point(s)]).map(at.size)(at[None, :])).T
        assert np.array(wire.points) == pytest.approx(expected, abs=1e-12)
    assert not PointOnCurve(Circle(ac.Parameter(0.4, "m"))).shapes() and not PointOnCurve(Line((1, 0, 0))).shapes()
    assert not PointOnCurve(Circle(0.4 + 0.1 * np.sin(ac.time))).shapes()


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e5])
def test_a_curve_without_a_value_is_not_called_a_cusp(size):
    """Where its function is no number, or its slope is infinite."""
    curve = ParametricCurve(lambda s: (size * ca.sqrt(s - 5), 0, size * s))
    for part, body in ((PointOnCurve(curve), Particle(1.0)), (AlongCurve(curve), RigidBody(1.0, (size**2,) * 3))):
        scene = on(part, body, (0, 0, -G * size))
        model = ac.build(scene)
        with pytest.raises(
            errors.StartValueError,
            match=r"at guide\.q = 1\. What it is given by, or its slope, is infinite or not a number there",
        ):
            model.simulate(1.0, {scene.guide.q: 1.0})
        with pytest.raises(errors.AcausalError, match="infinite or not a number there") as told:
            model.simulate(1.0, {scene.guide.q: 5.0})
        assert "cusp" not in str(told.value)
