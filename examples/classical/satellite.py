"""A satellite in gravity's gradient: a long body in orbit points to the earth, and swings about that.

Small swings in the plane of the orbit have the rate sqrt(3 (I_y - I_x) / I_z) of the orbit's, x along the vertical, z across the orbit. The field acts
on the extended body: forces and moments follow from its potential to second order. O'Reilly, Intermediate Dynamics for Engineers, 10.5.
"""

import numpy as np

import acausal as ac
from components import CentralField, RigidBody, World

LIMIT = 1e-4  # of what main returns

MU, RADIUS = 3.986004418e14, 7.0e6
INERTIA = np.array([400.0, 2000.0, 2200.0])


def main(folder: str = "out") -> float:
    """Three orbits; returns the difference of the swing's rate from the closed form, relative."""
    scene = ac.System()
    scene.world, scene.earth = World(gravity=None), CentralField(MU)
    scene.satellite = RigidBody(500.0, tuple(INERTIA), shapes=RigidBody.box(1.0, (6e5, 2e5, 2e5)).shapes())
    model = ac.build(scene)
    print(model)
    orbit, small, body = np.sqrt(MU / RADIUS**3), 0.002, scene.satellite.frame
    start = {
        body.position: (RADIUS, 0, 0),
        body.velocity: (0, orbit * RADIUS, 0),
        body.rotation[1, 0]: np.sin(small),
        body.rotation[2, 0]: 0.0,
        body.rotation[2, 1]: 0.0,
        body.angular_velocity: (0, 0, orbit),
    }
    upright = ac.when(body.position[0] * body.rotation[1, 0] - body.position[1] * body.rotation[0, 0])
    run = model.simulate(3 * 2 * np.pi / orbit, start, rtol=1e-12, events=[upright])
    rate = np.pi / np.mean(np.diff([event.time for event in run.events]))
    exact = orbit * np.sqrt(3 * (INERTIA[1] - INERTIA[0]) / INERTIA[2])
    print(run)
    print(
        f"swings {rate / orbit:.5f} times an orbit, small swings {exact / orbit:.5f} times; energy kept to {run.energy_error():.0e}"
    )
    quarter = run.at(np.linspace(0.0, np.pi / orbit, 300))
    quarter.picture(f"{folder}/satellite.png", times=(0.0, 0.5 / orbit, 1.0 / orbit, 1.5 / orbit))
    quarter.animate(f"{folder}/satellite.html", speed=300.0)
    return float(abs(rate / exact - 1))


if __name__ == "__main__":
    main()
