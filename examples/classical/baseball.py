"""A baseball: gravity, drag and the lift of its spin bend its path; without drag it is a cycloid, as that of a charge in crossed fields.

The lift is c w x v. With the spin w constant and no drag, m v' = m g + c w x v has the closed form that Newton's apple does not: a drift at right angles
to gravity and spin, and circles about it. Falling without spin, the speed tends to sqrt(m g / k) like tanh. O'Reilly, Intermediate Dynamics for
Engineers, 9.6; Alaways and Hubbard, Experimental determination of baseball spin and lift, J. Sports Sciences 19 (2001).
"""

import numpy as np
from scipy.integrate import solve_ivp

import acausal as ac
from components import Drag, MagnusForce, RigidBody, World

LIMIT = 1e-9  # of what main returns

MASS, RADIUS, LIFT, RESISTANCE, G = 0.145, 0.0366, 1.2e-4, 0.5 * 1.2 * 0.35 * np.pi * 0.0366**2, 9.81


def flight(
    lift: float, resistance: float, velocity: tuple[float, float, float], spin: tuple[float, float, float], seconds: float
):
    """Of a ball from the origin: the scene and its motion."""
    scene = ac.System()
    scene.world, scene.ball = (
        World(),
        RigidBody(MASS, (0.4 * MASS * RADIUS**2,) * 3, shapes=RigidBody.ball(1.0, 8 * RADIUS).shapes()),
    )
    if lift:
        scene.lift = MagnusForce(lift)
        scene.connect(scene.ball.frame, scene.lift.point)
    if resistance:
        scene.drag = Drag(quadratic=resistance)
        scene.connect(scene.ball.frame, scene.drag.point)
    ball = scene.ball.frame
    start = {ball.position: (0, 0, 0), ball.velocity: velocity, ball.angular_velocity: spin}
    return scene, ac.build(scene).simulate(seconds, start, rtol=1e-12)


def cycloid(t: np.ndarray, velocity: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """Place (n, 3) without drag: v = d + R(t) (v_0 - d), where m g + c w x d is along w, and that part falls freely."""
    rate = LIFT / MASS * np.linalg.norm(spin)
    axis, g = spin / np.linalg.norm(spin), np.array([0, 0, -G])
    along = g @ axis
    drift = np.cross(g, axis) * -1.0 / rate
    free = (velocity - drift) - ((velocity - drift) @ axis) * axis
    circle = np.outer(np.sin(rate * t), free) / rate + np.outer(1 - np.cos(rate * t), np.cross(axis, free)) / rate
    return np.outer(t, drift + (velocity - drift) @ axis * axis) + circle + np.outer(0.5 * along * t**2, axis)


def main(folder: str = "out") -> float:
    """A pitch, and its parts alone, the ball drawn eight times as large; returns the largest difference from closed forms and from an independent integrator [m]."""
    velocity, spin = np.array([38.0, 0.5, 1.5]), np.array([60.0, -150.0, 80.0])
    scene, bent = flight(LIFT, 0.0, tuple(velocity), tuple(spin), 5.0)
    off = float(np.max(np.abs(bent[scene.ball.frame.position] - cycloid(bent.t, velocity, spin))))
    scene, fallen = flight(0.0, RESISTANCE, (0, 0, 0), (0, 0, 0), 10.0)
    last = np.sqrt(MASS * G / RESISTANCE)
    deep = last**2 / G * np.log(np.cosh(G * fallen.t / last))
    off = max(off, float(np.max(np.abs(fallen[scene.ball.frame.position][:, 2] + deep))))

    scene, run = flight(LIFT, RESISTANCE, tuple(velocity), tuple(spin), 1.0)
    place = run[scene.ball.frame.position]

    def newton(t: float, y: np.ndarray) -> np.ndarray:
        v = y[3:]
        return np.concatenate([v, np.array([0, 0, -G]) + (LIFT * np.cross(spin, v) - RESISTANCE * np.linalg.norm(v) * v) / MASS])

    other = solve_ivp(newton, (0, 1.0), [0, 0, 0, *velocity], "DOP853", run.t, rtol=1e-13, atol=1e-13).y[:3].T
    off = max(off, float(np.max(np.abs(place - other))))
    print(run)
    plate = float(np.interp(18.44, place[:, 0], run.t))
    aside, deep = (
        float(np.interp(plate, run.t, place[:, k] - (velocity[k] * run.t - (0.5 * G * run.t**2 if k == 2 else 0))))
        for k in (1, 2)
    )
    print(
        f"after {plate:.3f} s at the plate, {aside:+.2f} m to the left and {deep:+.2f} m up of where a stone would be; closed forms met to {off:.0e} m"
    )
    run.picture(f"{folder}/baseball.png", times=tuple(np.linspace(0, 0.5, 6)))
    run.animate(f"{folder}/baseball.html", speed=0.25)
    return off


if __name__ == "__main__":
    main()
