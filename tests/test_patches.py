"""Round patches that slide and spin at once: forces against integrals over rings, motions against an independent integration, what holds against the dual of what is lost."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.special import ellipe, ellipkm1

import acausal as ac
from acausal.errors import ModelError, ParameterError
from acausal.numerics.patches import against, size, spinning
from components import (
    Contact,
    Coulomb,
    Force,
    Hard,
    JointFriction,
    Patch,
    Planar,
    Plane,
    PointOnPlane,
    RigidBody,
    Sphere,
    Spring,
    Torque,
    World,
)
from tests.drawn import SEEDS, Drawn

G = 9.81
UNIFORM, HERTZ, RING = ac.Pressure.UNIFORM, ac.Pressure.HERTZ, ac.Pressure.RING
WEIGHT = {UNIFORM: lambda r: 2 * r, HERTZ: lambda r: 3 * r * np.sqrt(1 - r * r)}


def of_ring(v: float, w: float) -> np.ndarray:
    """Force and torque of a ring that slides with v and whose edge turns with w, by K and E."""
    large, small = max(v, w), min(v, w)
    m = (small / large) ** 2
    first, rest = ellipe(m), (1 - m) * ellipkm1(1 - m) if m < 1 else 0.0
    second = 2 / np.pi * (first - rest) / np.sqrt(m)
    first *= 2 / np.pi
    return np.array([first, second] if v >= w else [second, first])


def of_rings(pressure: ac.Pressure, v: float, w: float) -> np.ndarray:
    """The same of a patch, ring by ring."""
    if pressure is RING:
        return of_ring(v, w)
    ends = (0.0, 1.0) if v >= w else (0.0, v / w, 1.0)

    def part(r: float, k: int) -> float:
        return WEIGHT[pressure](r) * of_ring(v, w * r)[k] * (r if k else 1)

    return np.array(
        [sum(quad(part, a, b, (k,), epsabs=1e-13, epsrel=1e-13)[0] for a, b in itertools.pairwise(ends)) for k in (0, 1)]
    )


def function(what: ca.SX, u: ca.SX) -> ca.Function:
    return ca.Function("f", [u], [what])


@pytest.mark.parametrize("pressure", list(ac.Pressure))
def test_forces_are_those_of_all_rings_and_what_holds_is_what_nothing_is_lost_beyond(pressure: ac.Pressure) -> None:
    u = ca.SX.sym("u", 3)
    force, needs = function(against(pressure, u), u), function(size(pressure, u, 0), u)
    change = function(ca.jacobian(against(pressure, u), u), u)
    for v, w in ((1, 0.02), (1, 0.3), (1, 0.5477), (1, 0.9), (1, 0.999), (0.7, 1), (0.1, 1), (3e-5, 2e-5)):
        found = np.array(force([0.6 * v, -0.8 * v, -w])).ravel()
        assert [np.hypot(*found[:2]), -found[2]] == pytest.approx(of_rings(pressure, v, w), rel=3e-12)
        assert found[:2] == pytest.approx(np.hypot(*found[:2]) * np.array([0.6, -0.8]), rel=1e-14)
        assert float(needs(7.0 * found)) == pytest.approx(7.0, rel=1e-13)
    for alone, expected in (([1e-9, 0, 0], [1, 0, 0]), ([0, 0, -5], [0, 0, -spinning(pressure)]), ([1, 0, 1e-12], [1, 0, 0])):
        assert np.array(force(alone)).ravel() == pytest.approx(expected, abs=1e-11)
        assert np.isfinite(np.array(change(alone))).all()
    assert np.isfinite(np.array(change([0.6, 0.8, 1.0]))).all()


def puck(
    pressure: ac.Pressure, inertia: float, unit: float = 1.0, tilt: float = 0.0, mu: float = 0.3, mass: float = 2.0, g: float = G
) -> ac.System:
    """A disk of radius 0.1 on a table, lengths in so many metres, with `inertia` m R^2 about its axis."""
    scene = ac.System()
    scene.world = World((unit * g * np.sin(tilt), 0, -unit * g * np.cos(tilt)))
    scene.body, scene.table = RigidBody(mass, inertia * mass * 0.01 * unit**2 * np.eye(3)), Planar()
    scene.connect(scene.world.frame, scene.table.frame_a)
    scene.connect(scene.table.frame_b, scene.body.frame)
    scene.rub = JointFriction(scene.table, Coulomb(mu, patch=Patch(0.1 * unit, pressure)))
    return scene


def by_itself(pressure: ac.Pressure, inertia: float, v: float, w: float) -> tuple[float, float, float]:
    """Time and way until it stops, and the ratio of speeds then: by dt = speed dtau, in which the stop is infinitely far, in two parts where forces bend."""
    u = ca.SX.sym("u", 3)
    force = function(against(pressure, u), u)

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        speed, g = np.hypot(y[0], y[1]), np.array(force([y[0], 0, y[1]])).ravel()
        return speed * np.array([-0.3 * G * g[0], -0.3 * G * g[2] / inertia, 1, y[0]])

    def alike(_: float, y: np.ndarray) -> float:
        return y[0] - y[1]

    alike.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    y, tau = np.array([v, w, 0, 0]), 0.0
    for events in ((alike,), ()):
        run = solve_ivp(rates, (tau, 24.0), y, "DOP853", rtol=3e-14, atol=1e-16, events=events, first_step=1e-8)
        y, tau = run.y[:, -1], run.t[-1]
        if tau == 24.0:
            break
    return y[2], y[3], y[0] / y[1]


@pytest.mark.parametrize("pressure", list(ac.Pressure))
@pytest.mark.parametrize("seed", SEEDS)
def test_a_disk_that_slides_and_spins_ends_both_together_as_another_program_says(seed: int, pressure: ac.Pressure) -> None:
    of = Drawn(seed)
    inertia, w = 0.5 if pressure is UNIFORM else of.within(0.3, 1), 10 ** of.within(-1.7, 0.5)
    mass, mu, direction = of.M, of.within(0.05, 1), of.within(0, 7)
    # by T of 0.3 g T = 1 at a speed of 1 m/s in the other program
    unit, T = of.L, of.T
    scene = puck(pressure, inertia, unit, 0.0, mu, mass, 0.3 / mu * G / T**2)
    along = np.array([np.cos(direction), np.sin(direction)])
    model = ac.build(scene)
    start = {scene.table.q: (0, 0, 0), scene.table.v: (*(unit / T * along), 10 * w / T)}
    stops, way, _ = by_itself(pressure, inertia, 1.0, w)
    run = model.simulate(1.5 * stops * T, start, rtol=1e-12)
    assert [t.time for t in run.transitions if t.changes] == pytest.approx([stops * T], rel=1e-11)
    assert run[scene.table.q][-1][:2] == pytest.approx(way * unit * along, abs=1e-10 * way * unit)
    just = run.at([stops * T * (1 - 1e-7)])[scene.table.v].ravel()
    assert np.abs(run[scene.table.v][-1] * [1, 1, 0.1 * unit]).max() < 1e-13 * unit / T
    if pressure is UNIFORM:
        assert np.hypot(*just[:2]) / (0.1 * unit * just[2]) == pytest.approx(0.653, abs=2e-3)  # in the limit: Farkas et al. 2003
    lost = mass * (unit / T) ** 2 * (1 + inertia * w**2) / 2
    assert run.energy_loss[-1] == pytest.approx(lost, rel=1e-8)


@pytest.mark.parametrize("pressure", list(ac.Pressure))
def test_what_only_spins_and_what_only_slides_stop_when_they_must(pressure: ac.Pressure) -> None:
    scene = puck(pressure, 0.5)
    model = ac.build(scene)
    for v, w, stops in (((0, 0), -6.0, 0.5 * 0.6 / (0.3 * G * spinning(pressure))), ((0.6, 0.8), 0.0, 1 / (0.3 * G))):
        run = model.simulate(1.0, {scene.table.q: (0, 0, 0), scene.table.v: (*v, w)}, rtol=1e-12)
        assert [t.time for t in run.transitions if t.changes] == pytest.approx([stops], rel=1e-12)
        way = np.array([*v, w]) * stops / 2
        assert run[scene.table.q][-1] == pytest.approx(way, abs=1e-12)


@pytest.mark.parametrize(("pressure", "part"), [(UNIFORM, 0.7), (HERTZ, 0.3), (RING, 1.2)])
def test_a_disk_that_is_pushed_and_twisted_slips_on_the_exact_limit_and_no_sooner(pressure: ac.Pressure, part: float) -> None:
    """The force by which it goes is normal to the limit: f . slip = limit * loss(slip), for the direction in which it begins."""
    scene = puck(pressure, 0.5)
    along = np.array([0.6 * np.cos(part), 0.8 * np.cos(part), np.sin(part)])
    scene.push, scene.twist = (
        Force(lambda t: (3 * along[0] * t, 3 * along[1] * t, 0)),
        Torque(lambda t: (0, 0, 0.3 * along[2] * t)),
    )
    scene.connect(scene.push.point, scene.body.at((0, 0, 0)))
    scene.connect(scene.twist.frame, scene.body.frame)
    u = ca.SX.sym("u", 3)
    slips = 0.3 * 2.0 * G / (3 * float(function(size(pressure, u, 0), u)(along)))
    run = ac.build(scene).simulate(1.02 * slips, {scene.table.q: (0, 0, 0), scene.table.v: (0, 0, 0)}, rtol=1e-9)
    assert [t.time for t in run.transitions if t.changes] == pytest.approx([slips], rel=1e-12)
    assert np.abs(run.at([0.999 * slips])[scene.table.q]).max() < 1e-14
    slip = run[scene.table.v][-1] * [1, 1, 0.1]
    force = np.array(function(against(pressure, u), u)(slip)).ravel()
    assert force @ along > 0.99 * np.linalg.norm(force)  # it moves nearly normal to the limit


def test_a_disk_that_spins_on_an_incline_creeps_down_though_it_would_stick_without_spin() -> None:
    """As much force as it takes along the slope, by the slip that goes with it; it goes on down until the spin is over, and then it sticks."""
    scene = puck(UNIFORM, 0.5, tilt=0.2)
    run = ac.build(scene).simulate(4.0, {scene.table.q: (0, 0, 0), scene.table.v: (0, 0, 20.0)}, rtol=1e-11)
    (end,) = [t for t in run.transitions if t.changes]
    x, v = run[scene.table.q], run[scene.table.v]
    assert x[-1, 0] > 0.01
    assert np.all(np.diff(x[:, 0]) >= 0)
    assert abs(x[-1, 1]) < 1e-14
    assert np.all(v[run.t > end.time] == 0)
    assert abs(run.energy + run.energy_loss - run.energy[0]).max() < 1e-8 * run.energy_loss[-1]


def test_a_ball_on_a_patch_slips_rolls_and_pivots_until_it_no_longer_does() -> None:
    """A ball of 1 kg and radius 0.2 that rolls by itself: the spin about the normal ends by itself, I w / (mu m g R 3 pi / 16); rolling goes on."""
    scene = ac.System()
    scene.world, scene.ball = World((0, 0, -G)), RigidBody(1.0, 0.016 * np.eye(3))
    scene.floor = Contact(Sphere(0.2), Plane(), Hard(friction=Coulomb(0.3, patch=Patch(0.01, HERTZ))))
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame)
    f = scene.ball.frame
    inertia, torque = 0.4 * 0.04, 0.3 * G * 0.01 * 3 * np.pi / 16
    run = ac.build(scene).simulate(
        4.0, {f.position: (0, 0, 0.2), f.rotation: np.eye(3), f.velocity: (0, 0, 0), f.angular_velocity: (0, 0, 3.0)}, rtol=1e-11
    )
    assert [t.time for t in run.transitions if t.changes] == pytest.approx([3.0 * inertia / torque], rel=1e-10)
    run = ac.build(scene).simulate(
        1.0,
        {f.position: (0, 0, 0.2), f.rotation: np.eye(3), f.velocity: (1.0, 0, 0), f.angular_velocity: (0, 5.0, 0)},
        rtol=1e-11,
    )
    assert run[f.velocity][-1] == pytest.approx([1.0, 0, 0], abs=1e-12)  # no spin, no slip: nothing rubs


def test_patches_where_there_are_none_are_refused_in_words() -> None:
    with pytest.raises(ParameterError, match="a point has none"):
        PointOnPlane(unilateral=True, friction=Coulomb(0.3, patch=Patch(0.1)))
    with pytest.raises(ParameterError, match="rubs as a patch"):
        JointFriction(Planar(), Coulomb(0.3))
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(0.5, 0.1)
    scene.floor = Contact(Sphere(0.1), Plane(), Hard(ac.Energetic(0.5), Coulomb(0.3, patch=Patch(0.01))))
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame)
    with pytest.raises(ModelError, match="not there yet"):
        ac.build(scene)
    with pytest.raises(ParameterError, match="Patch's radius"):
        Patch(0.0)
    with pytest.raises(ModelError, match="Three of them are those of a patch"):
        ac.DryFriction((ac.Reaction("N"), ac.Reaction("N"), ac.Reaction("N")), Planar().v, 1.0)


@pytest.mark.parametrize("turned", [False, True], ids=["a on b", "b on a"])
def test_bodies_that_rub_and_spin_on_one_another_keep_their_momentum(turned: bool) -> None:
    """What a patch does to one body it does to the other: no angular momentum comes from anywhere, through impacts too."""
    scene = ac.System()
    scene.world, scene.pull = World(None), Spring(40.0, 0.1)
    inertias, masses = (np.diag((0.2, 0.3, 0.25)), np.diag((0.05, 0.06, 0.07))), (1.3, 0.7)
    scene.bodies = [RigidBody(m, tuple(np.diag(inertia))) for m, inertia in zip(masses, inertias, strict=True)]
    radii = (0.15, 0.2) if turned else (0.2, 0.15)
    scene.touch = Contact(Sphere(radii[0]), Sphere(radii[1]), Hard(0.3, Coulomb(0.4, patch=Patch(0.03))))
    a, b = scene.bodies
    first, second = (b, a) if turned else (a, b)
    scene.connect(first.frame, scene.touch.frame_a)
    scene.connect(scene.touch.frame_b, second.frame)
    scene.connect(a.frame, scene.pull.point_a)
    scene.connect(scene.pull.point_b, b.frame)
    start = {
        b.frame.position: np.array([0.02, 0.01, 0.36]),
        b.frame.velocity: np.array([0.2, -0.1, -0.3]),
        a.frame.angular_velocity: np.array([1.0, 2.0, 9.0]),
        b.frame.angular_velocity: np.array([-1.0, 0.5, -7.0]),
    }
    run = ac.build(scene).simulate(1.0, start, rtol=1e-11, samples=101)
    total = np.zeros((101, 3))
    for body, m, inertia in zip(scene.bodies, masses, inertias, strict=True):
        R, w = run[body.frame.rotation], run[body.frame.angular_velocity]
        total += np.einsum("tij,jk,tlk,tl->ti", R, inertia, R, w)
        total += m * np.cross(run[body.frame.position], run[body.frame.velocity])
    assert len(run.transitions) > 5
    assert np.max(np.abs(run[scene.touch.pivoting])) > 1.0
    np.testing.assert_allclose(total, np.broadcast_to(total[0], total.shape), atol=1e-10)
