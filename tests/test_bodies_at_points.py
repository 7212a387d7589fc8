"""Bodies with a point that stays on one side of something: they turn about it, and it pushes on that point alone."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from components import ParametricCurve, ParametricSurface, PointOnCurve, PointOnSurface, RigidBody, World

G = 9.81
END = 0.25


def rotation(q: np.ndarray) -> np.ndarray:
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def turning(q: np.ndarray, w: np.ndarray) -> np.ndarray:
    return 0.5 * np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))])


def with_foot(guide, foot: np.ndarray, mass: float, moments: np.ndarray) -> ac.System:
    scene = ac.System()
    scene.world, scene.body, scene.guide = World(gravity=(0, 0, -G)), RigidBody(mass, moments), guide
    scene.connect(scene.world.frame, scene.guide.frame_a)
    scene.connect(scene.guide.frame_b, scene.body.at(foot))
    return scene


@pytest.mark.parametrize(("slope", "foot"), [((0.2, -0.1), (0.05, 0.1, -0.15)), ((-0.3, 0.4), (-0.2, 0.02, -0.1))])
def test_body_strikes_a_slope_with_a_foot_and_slides_on_it_as_newton_and_euler_say(slope, foot):
    """One that is flat, and given so that nearest points have no closed form."""
    m, J, r = 1.3, np.array([0.03, 0.02, 0.035]), np.array(foot)
    n = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
    plane = ParametricSurface(lambda a, b: (a, b, slope[0] * a + slope[1] * b), unit="m")
    scene = with_foot(PointOnSurface(plane, unilateral=True, restitution=0.0), r, m, J)
    model, frame = ac.build(scene), scene.body.frame
    assert model.system.x.numel() == 13
    height = n[2] * 0.3  # of the foot over the slope
    p0, v0, w0 = height * n - r, np.array([0.2, -0.1, -0.5]), np.array([0.5, -0.8, 1.2])
    start = {frame.position: p0, frame.velocity: v0, frame.rotation: np.eye(3), frame.angular_velocity: w0}
    run = model.simulate(END, start, rtol=1e-11)

    def arm(R: np.ndarray) -> np.ndarray:
        """Of the normal about the centre, in the body."""
        return np.cross(r, R.T @ n)

    def rates(y: np.ndarray, push: float) -> np.ndarray:
        q, v, w = y[3:7], y[7:10], y[10:]
        force = push / m * n - [0, 0, G]
        return np.concatenate([v, turning(q, w), force, (np.cross(J * w, w) + push * arm(rotation(q))) / J])

    def push(y: np.ndarray) -> float:
        """That holds the foot's velocity along the normal."""
        q, w = y[3:7], y[10:]
        R = rotation(q)
        bias = n @ R @ np.cross(w, np.cross(w, r)) - G * n[2] + arm(R) @ (np.cross(J * w, w) / J)
        return -bias / (1 / m + arm(R) @ (arm(R) / J))

    def gap(_t: float, y: np.ndarray) -> float:
        return n @ (y[:3] + rotation(y[3:7]) @ r)

    gap.terminal, gap.direction = True, -1
    t, y, struck, closed = 0.0, np.concatenate([p0, [1, 0, 0, 0], v0, w0]), [], False
    options = {"rtol": 1e-12, "atol": 1e-13, "method": "DOP853"}
    while t < END and not closed:
        flight = solve_ivp(lambda _t, y: rates(y, 0.0), (t, END), y, events=gap, **options)
        t, y = flight.t[-1], flight.y[:, -1].copy()
        if t < END:
            a = arm(rotation(y[3:7]))
            impulse = -(n @ y[7:10] + a @ y[10:]) / (1 / m + a @ (a / J))
            y[7:10] += impulse / m * n
            y[10:] += impulse * a / J
            struck.append(t)
            closed = push(y) > 0
    y = solve_ivp(lambda _t, y: rates(y, push(y)), (t, END), y, **options).y[:, -1] if closed else y

    assert len(struck) >= 1 and push(y) > 0
    assert [passed.time for passed in run.transitions] == pytest.approx(struck, abs=1e-9)
    assert run[scene.guide.normal_force][-1] == pytest.approx(push(y) if closed else 0.0, rel=1e-6)
    R = rotation(y[3:7])
    np.testing.assert_allclose(run[frame.position][-1], y[:3], atol=1e-8)
    np.testing.assert_allclose(run[frame.rotation][-1].reshape(3, 3), R, atol=1e-8)
    np.testing.assert_allclose(run[frame.angular_velocity][-1], R @ y[10:], rtol=1e-7)


def test_body_held_sideways_over_a_curve_turns_as_a_free_one():
    """By its centre: nothing but the curve's side holds that, and no torque acts."""
    J, w0 = np.array([0.2, 0.5, 0.6]), np.array([0.3, 2.0, -0.1])
    rail = ParametricCurve(lambda s: (s, 0.3 * s, 0.1 * s**2), unit="m")
    scene = with_foot(PointOnCurve(rail, unilateral=True), np.zeros(3), 1.0, J)
    frame = scene.body.frame
    start = {frame.position: (0.0, 0.0, 1.0), frame.velocity: (0, 0, 0), frame.rotation: np.eye(3), frame.angular_velocity: w0}
    run = ac.build(scene).simulate(0.4, start, rtol=1e-11)

    def rates(_t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([turning(y[:4], y[4:]), np.cross(J * y[4:], y[4:]) / J])

    y = solve_ivp(rates, (0, 0.4), [1, 0, 0, 0, *w0], rtol=1e-12, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(run[frame.rotation][-1].reshape(3, 3), rotation(y[:4]), atol=1e-9)
    assert abs(run[frame.position][-1, 2] - (1 - G * 0.08)) < 1e-9
