"""Navigation equations: where a vehicle is, from nothing but its accelerometers and gyros.

The vehicle is simulated in the inertial frame, over an earth that turns; what its sensors read goes into the equations of strapdown navigation in
north, east and down, which know nothing of the vehicle: v' = R f + g - (2 w_e + w_n) x v, latitude' = v_n / r, longitude' = v_e / (r cos(latitude)),
height' = -v_d, and the attitude against a frame that turns with w_e + w_n. Both must agree. Titterton and Weston, Strapdown Inertial Navigation
Technology (2004), 3; O'Reilly, Intermediate Dynamics for Engineers, chapter 12.
"""

import numpy as np
from scipy.spatial.transform import Rotation

import acausal as ac
from components import Accelerometer, Force, Gyro, RigidBody, RotatingEarth, Torque

LIMIT = 1e-6  # of what main returns

MU, RADIUS, RATE = 3.986004418e14, 6371000.0, 7.292115e-5
LATITUDE, LONGITUDE, SECONDS, STEPS = 0.8, 0.2, 300.0, 3000


def cross(w: np.ndarray) -> np.ndarray:
    """The matrix of w x."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def rates(
    place: np.ndarray, v: np.ndarray, R: np.ndarray, force: np.ndarray, turning: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of latitude, longitude and height, velocity and R_nb (body in north, east, down), for readings of the sensors."""
    latitude, _, height = place
    r = RADIUS + height
    earth = RATE * np.array([np.cos(latitude), 0, -np.sin(latitude)])
    over = np.array([v[1], -v[0], -v[1] * np.tan(latitude)]) / r
    fall = (
        R @ force
        + np.array([0, 0, MU / r**2])
        - np.cross(2 * earth + over, v)
        - np.cross(earth, np.cross(earth, np.array([0, 0, -r])))
    )
    return np.array([v[0] / r, v[1] / (r * np.cos(latitude)), -v[2]]), fall, R @ cross(turning) - cross(earth + over) @ R


def main(folder: str = "out") -> float:
    """Five minutes of a rocket that turns; returns how far both are apart, of the way that it went."""
    scene = ac.System()
    scene.earth = RotatingEarth(MU, RADIUS, RATE)
    scene.rocket = RigidBody(1000.0, (300.0, 2000.0, 2000.0), shapes=RigidBody.cylinder(1.0, 4e3, 4e4, "x").shapes())
    scene.pad = scene.earth.level(LATITUDE, LONGITUDE)
    frame = scene.rocket.frame
    scene.accelerometer, scene.gyro = Accelerometer(), Gyro()
    scene.connect(frame, scene.accelerometer.frame, scene.gyro.frame)
    axes = frame.rotation
    thrust = 14000.0 + 1500.0 * np.sin(0.1 * ac.time)
    scene.thrust = Force(tuple(thrust * axes[k, 0] for k in range(3)))
    about_y, about_z = 0.2 * np.sin(0.05 * ac.time), 0.3 * np.cos(0.07 * ac.time)
    scene.torque = Torque(tuple(about_y * axes[k, 1] + about_z * axes[k, 2] for k in range(3)))
    scene.connect(frame, scene.thrust.point, scene.torque.frame)
    model = ac.build(scene)
    print(model)

    sl, cl, sa, c = np.sin(LONGITUDE), np.cos(LONGITUDE), np.sin(LATITUDE), np.cos(LATITUDE)
    down = np.column_stack([[-sa * cl, -sa * sl, c], [-sl, cl, 0], [-c * cl, -c * sl, -sa]])  # north, east and down as columns
    attitude = Rotation.from_euler("ZYX", (0.5, 1.2, 0.0)).as_matrix()
    start = {
        frame.position: scene.earth.place(LATITUDE, LONGITUDE, 1000.0),
        frame.velocity: np.cross([0, 0, RATE], scene.earth.place(LATITUDE, LONGITUDE, 1000.0)) + down @ [20.0, 30.0, -10.0],
        frame.rotation: down @ attitude,
        frame.angular_velocity: (0, 0, RATE),
    }
    run = model.simulate(SECONDS, start, rtol=1e-12, samples=2 * STEPS + 1)
    forces, turnings = run[scene.accelerometer.reading].reshape(-1, 3), run[scene.gyro.reading].reshape(-1, 3)

    h = SECONDS / STEPS
    y = np.array([LATITUDE, LONGITUDE, 1000.0]), np.array([20.0, 30.0, -10.0]), attitude
    for k in range(STEPS):  # Runge and Kutta's method on samples at both ends and in the middle
        found = [rates(*y, forces[2 * k], turnings[2 * k])]
        for at, part in ((2 * k + 1, 0.5), (2 * k + 1, 0.5), (2 * k + 2, 1.0)):
            moved = [a + part * h * b for a, b in zip(y, found[-1], strict=True)]
            found.append(rates(*moved, forces[at], turnings[at]))
        y = tuple(a + h / 6 * (s1 + 2 * s2 + 2 * s3 + s4) for a, s1, s2, s3, s4 in zip(y, *found, strict=True))

    there = scene.earth.whereabouts(frame)
    latitude, longitude, height, velocity = (
        np.ravel(run[e][-1]) for e in (there.latitude, there.longitude, there.height, there.velocity)
    )
    r = RADIUS + height[0]
    apart = np.array([r * (y[0][0] - latitude[0]), r * np.cos(latitude[0]) * (y[0][1] - longitude[0]), y[0][2] - height[0]])
    way = float(np.sum(np.linalg.norm(np.diff(run[frame.position] - run[scene.pad.position], axis=0), axis=1)))
    off = max(float(np.max(np.abs(apart))) / way, float(np.max(np.abs(y[1] - velocity)) / np.linalg.norm(velocity)))
    print(run)
    print(
        f"{way / 1000:.0f} km in five minutes, {height[0] / 1000:.1f} km up; by its sensors it is {np.linalg.norm(apart):.1e} m beside, {off:.0e} of the way"
    )
    run.picture(f"{folder}/navigation.png", times=(0.0, 100.0, 200.0, 300.0))
    run.at(np.linspace(0, SECONDS, 400)).animate(f"{folder}/navigation.html", speed=30.0)
    return off


if __name__ == "__main__":
    main()
