"""Laws of impact: one after the other or all at once, with friction along the path of the impulse, slips that come back; against closed forms and independent integration."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear

import acausal as ac
from acausal.collocation.problem import StatusKind
from acausal.simulate.trajectory import Trajectory
from components import (
    Contact,
    Coulomb,
    ForceSource,
    Hard,
    Plane,
    PointOnPlane,
    RigidBody,
    SlidingMass,
    Sphere,
    TranslationalGround,
    World,
)
from tests.drawn import SEEDS, Drawn


def row_of_balls(restitution: object, order: list[int], speeds: list[float], apart: float = 0.0) -> list[float]:
    """Speeds of equal balls that touch but for the first gap, some time after they have met; declared in an order."""
    scene = ac.System()
    scene.world = World(None)
    balls = [RigidBody.ball(1.0, 0.5) for _ in speeds]
    scene.balls = [balls[k] for k in order]
    pairs = [Contact(Sphere(0.5), Sphere(0.5), Hard(restitution)) for _ in speeds[1:]]  # pyright: ignore[reportArgumentType]
    scene.pairs = [pairs[k] for k in order if k < len(pairs)]
    start: dict[object, object] = {}
    for k, ball in enumerate(balls):
        start |= {
            ball.frame.position: (k + (k > 0) * 0.25 + (k == len(balls) - 1) * apart, 0, 0),
            ball.frame.velocity: (speeds[k], 0, 0),
        }
    for k, pair in enumerate(pairs):
        scene.connect(balls[k].frame, pair.frame_a)
        scene.connect(pair.frame_b, balls[k + 1].frame)
    run = ac.build(scene).simulate(0.5, start, rtol=1e-10)  # pyright: ignore[reportArgumentType]
    return [run[ball.frame.velocity][-1, 0] for ball in balls]


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [2, 0, 3, 1]])
def test_a_cradle_hands_on_in_sequence_and_shares_at_once(order: list[int]) -> None:
    for law in (ac.Poisson(1.0, in_sequence=True), ac.Newton(1.0, in_sequence=True), ac.Energetic(1.0)):
        assert row_of_balls(law, order, [1.0, 0, 0, 0]) == pytest.approx([0, 0, 0, 1], abs=1e-13)
    # one impulse with v' = -v at the first gap and none that closes: momentum and the least change of the others share alike
    for law in (1.0, ac.Newton(1.0)):
        assert row_of_balls(law, order, [1.0, 0, 0, 0]) == pytest.approx([-0.5, 0.5, 0.5, 0.5], abs=1e-13)


def test_two_balls_on_two_send_off_two() -> None:
    assert row_of_balls(ac.Newton(1.0, in_sequence=True), [1, 0, 3, 2], [1.0, 0, 0, -1.0], 0.25) == pytest.approx(
        [-1, 0, 0, 1], abs=1e-13
    )


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0]])
def test_one_ball_between_two_that_strike_it_in_one_instant_is_named(order: list[int]) -> None:
    with pytest.raises(ac.errors.SimulationError, match=r"pairs\[\d\].* and pairs\[\d\].* strike in the same instant") as raised:
        row_of_balls(ac.Poisson(0.5, in_sequence=True), order, [1.0, 0.0, -1.0], 0.25)
    run = raised.value.trajectory
    assert run is not None and run.status.kind is StatusKind.TIED


class Meets(ac.Component):
    """Keeps flange_b in front of flange_a."""

    flange_a, flange_b = ac.Translational.port(must_connect=True), ac.Translational.port(must_connect=True)

    def __init__(self, law: object, width: float = 0.1) -> None:
        self.law, self.width, self.push = law, width, ac.Reaction("N", "how hard it pushes")

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.flange_a.f, 1.0 * self.push)
        yield ac.equal(self.flange_b.f, -1.0 * self.push)

    def laws(self) -> Iterable[ac.OneSided]:
        yield ac.OneSided(self.push, self.flange_b.s - self.flange_a.s - self.width, self.law)  # pyright: ignore[reportArgumentType]


def blows(masses: np.ndarray, speeds: np.ndarray, restitution: float) -> np.ndarray:
    """Speeds after blows one after the other, as long as any two close by more than 1e-11."""
    v = speeds.copy()
    while True:
        closing = np.flatnonzero(v[:-1] - v[1:] > 1e-11)
        if not closing.size:
            return v
        for k in closing:
            blow = (1 + restitution) * masses[k] * masses[k + 1] / (masses[k] + masses[k + 1]) * (v[k] - v[k + 1])
            v[k : k + 2] += blow * np.array([-1, 1]) / masses[k : k + 2]


def struck(masses: np.ndarray, speeds: np.ndarray, restitution: float, poisson: bool) -> np.ndarray:
    """Speeds after all have struck at once: least of a quadratic form of impulses that push."""
    rates = np.diff(np.eye(masses.size), axis=0)
    factor, u = np.linalg.cholesky(rates @ np.diag(1 / masses) @ rates.T), rates @ speeds

    def impulses(u: np.ndarray, floor: np.ndarray) -> np.ndarray:
        return lsq_linear(factor.T, -np.linalg.solve(factor, u), (floor, np.full(u.size, np.inf)), method="bvls", tol=1e-15).x

    none = np.full(u.size, -1e-300)
    first = impulses(u, none) if poisson else impulses(u + restitution * np.minimum(u, 0), none)
    if poisson:
        first = first + impulses(u + factor @ factor.T @ first, restitution * first - 1e-300)
    return speeds + rates.T @ first / masses


@pytest.mark.parametrize("seed", range(6))
def test_ten_in_a_row_strike_as_sequences_of_blows_and_quadratic_programs_say(seed: int) -> None:
    """Equal masses, or up to 1 : 1000. Of blows that lose much there is no end: then they go on together."""
    g = np.random.default_rng(seed)
    n, restitution = 10, [0.0, 0.05, 0.3][seed % 3]
    masses = 10 ** g.uniform(-1.5, 1.5, n) if seed % 2 else np.ones(n)
    speeds = np.array([1.0, *np.zeros(n - 1)])
    laws = (
        (ac.Newton(restitution, in_sequence=True), blows(masses, speeds, restitution)),
        (ac.Newton(restitution), struck(masses, speeds, restitution, False)),
        (ac.Poisson(restitution), struck(masses, speeds, restitution, True)),
    )
    for law, exact in laws:
        scene: Any = ac.System()
        sliders, meets = [SlidingMass(float(mass)) for mass in masses], [Meets(law) for _ in masses[1:]]
        order = g.permutation(n)
        scene.sliders, scene.meets = [sliders[k] for k in order], [meets[k] for k in order if k < n - 1]
        for one, other, meet in zip(sliders[:-1], sliders[1:], meets, strict=True):
            scene.connect(one.flange_b, meet.flange_a)
            scene.connect(meet.flange_b, other.flange_a)
        start = {slider.s: 0.1 * k for k, slider in enumerate(sliders)}
        start |= {slider.v: float(v) for slider, v in zip(sliders, speeds, strict=True)}
        run = ac.build(scene).simulate(0.5, start, rtol=1e-10, samples=2)
        assert [run[slider.v].ravel()[-1] for slider in sliders] == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 22, 114])
def test_stacks_that_are_dropped_come_to_rest_on_one_another_without_going_through(seed: int) -> None:
    """Three to five, apart from one another, of masses up to 1 : 1000, of sizes from 1e-3 to 1e3: all of what they were higher by is lost, some of it at once where bounces end, however much that is.
    Where nothing presses yet, low bounces of those above
    have speeds that are known no better than their impulses are."""
    g = np.random.default_rng(seed)
    n, size, restitution = int(g.integers(3, 6)), 10 ** g.uniform(-3, 3), [0.05, 0.3][seed // 2 % 2]
    law = ac.Newton(restitution) if seed % 2 else ac.Poisson(restitution)
    masses, gaps = 10 ** g.uniform(-1.5, 1.5, n), g.uniform(0.001, 0.3, n) * size
    scene: Any = ac.System()
    scene.sliders, scene.weights = [SlidingMass(float(m)) for m in masses], [ForceSource(-9.81 * float(m)) for m in masses]
    scene.ground, scene.meets = TranslationalGround(), [Meets(law, 0.1 * size) for _ in masses]
    below = [scene.ground.flange, *(slider.flange_b for slider in scene.sliders)]
    for meet, weight, slider, flange in zip(scene.meets, scene.weights, scene.sliders, below, strict=False):
        scene.connect(flange, meet.flange_a)
        scene.connect(meet.flange_b, slider.flange_a, weight.flange)
    rest = 0.1 * size * np.arange(1, n + 1)
    start = {slider.s: float(s) for slider, s in zip(scene.sliders, rest + np.cumsum(gaps), strict=True)}
    run = ac.build(scene).simulate(20 * np.sqrt(size / 9.81), start | {slider.v: 0.0 for slider in scene.sliders}, rtol=1e-10)
    s = np.stack([np.zeros(run.t.size), *(run[slider.s].ravel() for slider in scene.sliders)])
    assert np.min(np.diff(s, axis=0)) >= (0.1 - 1e-14) * size and s[1:, -1] == pytest.approx(rest, rel=1e-13)
    assert run.energy_error() <= 1e-11
    assert sum(passed.energy_lost for passed in run.transitions) == pytest.approx(9.81 * masses @ np.cumsum(gaps), rel=1e-11)


def dropped(body: RigidBody, at: np.ndarray, law: object, friction: Coulomb, v: np.ndarray, w: np.ndarray) -> Trajectory:
    """A body without gravity whose point `at` comes down on the plane at t = 0.1; w: about its axes, which are those of the world then."""
    scene = ac.System()
    scene.world, scene.body = World(None), body
    scene.floor = PointOnPlane(unilateral=True, restitution=law, friction=friction)  # pyright: ignore[reportArgumentType, reportCallIssue]
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, body.at(tuple(at)))
    start = {body.frame.position: -at, body.frame.velocity: v, body.frame.rotation: np.eye(3), body.frame.angular_velocity: w}
    return ac.build(scene).simulate(0.0, start, rtol=1e-12)


INERTIA = np.array([0.4, 0.9, 0.7])
TIP = np.array([0.5, -0.3, -0.8])


def compliance(mass: float) -> np.ndarray:
    """Of the tip (3, 3)."""
    cross = np.cross(np.eye(3), TIP)
    return np.eye(3) / mass + cross @ np.diag(1 / INERTIA) @ cross.T


@pytest.mark.parametrize("mu", [0.1, 0.4])
def test_friction_bends_the_slip_in_an_impact_by_energy(mu: float) -> None:
    """du/dP = W (n - mu s / |s|), to where the work of the normal force is 1 - e^2 times that at the end of compression."""
    v, w, e = np.array([0.7, -0.5, -2.0]), np.array([0.3, 0.5, -0.2]), 0.6
    W = compliance(1.5)
    rate = lambda _, y: np.append(W @ [*(-mu * y[:2] / np.hypot(*y[:2])), 1.0], y[2])  # noqa: E731
    compressed = lambda _, y: y[2]  # noqa: E731
    compressed.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    before = np.append(v + np.cross(w, TIP), 0.0)
    first = solve_ivp(rate, (0, 100), before, "DOP853", events=compressed, rtol=1e-13, atol=1e-14)
    target = (1 - e**2) * first.y[3, -1]
    restored = lambda _, y: y[3] - target  # noqa: E731
    restored.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    after = solve_ivp(rate, (0, 100), first.y[:, -1] + [0, 0, 1e-12, 0], "DOP853", events=restored, rtol=1e-13, atol=1e-14)
    body = RigidBody(mass=1.5, inertia=tuple(INERTIA))
    run = dropped(body, TIP, ac.Energetic(e), Coulomb(mu), v, w)
    frame = body.frame
    found = run[frame.velocity][-1] + np.cross(run[frame.angular_velocity][-1], TIP)
    assert abs(before[0] * after.y[1, -1] - before[1] * after.y[0, -1]) > 1e-2  # it has turned
    assert found == pytest.approx(after.y[:3, -1], abs=1e-9)


def test_slip_stops_and_turns_round_in_an_impact_by_energy() -> None:
    """In a plane, piece by piece: slips, stops, and slips back, since friction does not hold it."""
    mu, e, mass, I = 0.2, 0.5, 1.0, 0.05  # noqa: E741
    x, z = 0.3, -0.4
    n, c, t = 1 / mass + x * x / I, -x * z / I, 1 / mass + z * z / I
    u, s = -2.0, -0.3  # rate of the gap, slip
    stop = -s / (c + mu * t)
    assert c / t > mu
    u_stop, work = u + (n + mu * c) * stop, u * stop + (n + mu * c) * stop**2 / 2
    slope, turned = n - mu * c, c - mu * t
    P = -u_stop / slope
    total = work + u_stop * P + slope * P * P / 2
    more = np.sqrt(2 * (-(e**2) * total) / slope)
    rate, slip = slope * more, turned * (P + more)
    body = RigidBody(mass=mass, inertia=(1.0, I, 1.0))
    run = dropped(body, np.array([x, 0, z]), ac.Energetic(e), Coulomb(mu), np.array([s, 0, u]), np.zeros(3))
    frame = body.frame
    found = run[frame.velocity][-1] + np.cross(run[frame.angular_velocity][-1], [x, 0, z])
    assert found == pytest.approx([slip, 0, rate], abs=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_superball_gives_back_its_spin(seed: int) -> None:
    """Garwin, Am. J. Phys. 37 (1969): the slip u comes back as -e u by an impulse m (1 + e) u / (1 + 1 / c), of an inertia c m r^2; with e = 1 to and fro without a loss."""
    of = Drawn(seed)
    m, r, c, Q = of.M, of.L * of.within(0.1, 1), of.within(0.2, 0.66), of.turn()
    v, w = of.speed * of.rng.normal(size=3), of.speed / r * of.rng.normal(size=3)
    v[2] = -abs(v[2])
    slip = (v + np.cross(w, [0, 0, -r])) * [1, 1, 0]
    fast = np.linalg.norm(v) + r * np.linalg.norm(w)
    for back in (0.0, of.within(0.1, 0.9), 1.0):
        grip = (1 + back) * np.linalg.norm(slip) / (1 + 1 / c) / (2 * -v[2])  # the coefficient that this takes
        scene = ac.System()
        scene.world, scene.ball = World(None), RigidBody(m, (c * m * r * r,) * 3)
        scene.floor = Contact(Sphere(r), Plane(), Hard(1.0, Coulomb(1.01 * grip, restitution=back)))
        scene.connect(scene.world.at((0, 0, 0), rotation=Q), scene.floor.frame_a)
        scene.connect(scene.floor.frame_b, scene.ball.frame)
        frame = scene.ball.frame
        start = {
            frame.position: Q @ (0, 0, r),
            frame.velocity: Q @ v,
            frame.angular_velocity: Q @ w,
            frame.rotation: np.eye(3),
        }
        run = ac.build(scene).simulate(0.0, start, rtol=1e-12)
        blow = -(1 + back) * slip / (1 + 1 / c)
        after, turns = v * [1, 1, -1] + blow, w + np.cross([0, 0, -r], blow) / (c * r * r)
        assert run[frame.velocity][-1] @ Q == pytest.approx(after, abs=1e-12 * fast)
        assert run[frame.angular_velocity][-1] @ Q == pytest.approx(turns, abs=1e-12 * fast / r)
    assert v @ v + c * r * r * (w @ w) == pytest.approx(after @ after + c * r * r * (turns @ turns), rel=1e-13)


def test_newtons_law_with_friction_that_gains_energy_is_named_and_energy_is_not_gained_by_others() -> None:
    """A rod that slides into its corner: Kane's puzzle."""
    body = RigidBody(mass=1.0, inertia=(1.0, 0.05, 1.0))
    at, friction, v, w = np.array([0.3, 0, -0.4]), Coulomb(0.2), np.array([-4.0, 0, -4.0]), np.zeros(3)

    def energy(run: Trajectory) -> float:
        v, w = run[body.frame.velocity][-1], run[body.frame.angular_velocity][-1]
        return v @ v / 2 + 0.05 * w[1] ** 2 / 2

    with pytest.raises(ac.errors.SimulationError, match=r"An impact of .* gains energy") as raised:
        dropped(body, at, ac.Newton(0.9), friction, v, w)
    assert raised.value.trajectory is not None
    for law in (0.9, ac.Energetic(0.9)):
        assert energy(dropped(body, at, law, friction, v, w)) < (v @ v) / 2


def test_an_impact_is_named_from_where_it_begins_to_gain_energy() -> None:
    """Of the restitutions that Kane's rod may have by Newton's law, the largest one keeps all energy."""
    restitution, rod, at = ac.Parameter(0.5), RigidBody(mass=1.0, inertia=(1.0, 0.05, 1.0)), np.array([0.3, 0, -0.4])
    scene = ac.System()
    scene.world, scene.rod = World(None), rod
    scene.floor = PointOnPlane(unilateral=True, restitution=ac.Newton(restitution), friction=Coulomb(0.2))
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, rod.at(tuple(at)))
    model, start = ac.build(scene), {rod.frame.position: -at, rod.frame.velocity: (-4.0, 0, -4.0), rod.frame.rotation: np.eye(3)}

    def kept(e: float) -> float:
        """None of it where it is more than all."""
        try:
            run = model.simulate(0.0, start, parameters={restitution: e}, rtol=1e-12)
        except ac.errors.SimulationError:
            return 0.0
        return float(np.sum(run[rod.frame.velocity][-1] ** 2) + 0.05 * run[rod.frame.angular_velocity][-1][1] ** 2) / 32

    low, high = 0.5, 0.9
    for _ in range(32):
        middle = (low + high) / 2
        low, high = (middle, high) if kept(middle) else (low, middle)
    assert 0.5 < low < 0.9
    assert kept(low) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("law", [ac.Poisson, ac.Newton, ac.Energetic])
def test_restitution_of_a_law_is_from_0_to_1(law: type[ac.Poisson]) -> None:
    with pytest.raises(ac.errors.ParameterError, match=rf"{law.__name__}'s restitution is 1\.5 .*test_impact_laws"):
        law(1.5)


@pytest.mark.parametrize(("e", "u"), [(0.3, 0.2), (0.5, 0.5), (0.6, 0.9)])
def test_what_touches_and_leaves_is_met_by_newtons_law_only_where_it_would_close(e: float, u: float) -> None:
    """Three equal balls in contact with speeds 1, 0, u: rates after it are at least e at the first gap and zero at the second one, impulses P, Q >= 0."""
    scene = ac.System()
    scene.world, scene.balls = World(None), [RigidBody.ball(1.0, 0.5) for _ in range(3)]
    scene.pairs = [Contact(Sphere(0.5), Sphere(0.5), Hard(ac.Newton(e))) for _ in range(2)]
    start: dict[object, object] = {}
    for k, (ball, speed) in enumerate(zip(scene.balls, (1.0, 0.0, u), strict=True)):
        start |= {ball.frame.position: (k, 0, 0), ball.frame.velocity: (speed, 0, 0)}
    for pair, a, b in zip(scene.pairs, scene.balls, scene.balls[1:], strict=False):
        scene.connect(a.frame, pair.frame_a)
        scene.connect(pair.frame_b, b.frame)
    run = ac.build(scene).simulate(0.1, start, rtol=1e-10)  # pyright: ignore[reportArgumentType]
    P = (1 + e) / 2 if u > (1 + e) / 2 else (1 + e - u / 2) / 1.5
    Q = max((P - u) / 2, 0.0)
    assert [run[ball.frame.velocity][-1, 0] for ball in scene.balls] == pytest.approx([1 - P, P - Q, u + Q], abs=1e-13)
