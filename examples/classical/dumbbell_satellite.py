"""A dumbbell satellite: two masses on a massless rod circle the earth, one below the other, and swing about that like a pendulum.

The lower mass is pulled too much for its orbit, the upper one too little: the rod is in tension, 3 m n^2 a for a short one. Small swings in the plane
of the orbit have sqrt(3) of its rate n, across it twice. O'Reilly, Intermediate Dynamics for Engineers, 5.3; Beletskii, Motion of an Artificial
Satellite about its Center of Mass (1966).
"""

import numpy as np

import acausal as ac
from components import CentralField, Particle, Rod, World

LIMIT = 1e-5  # of what main returns

MU, RADIUS = 3.986004418e14, 7.0e6


def satellite(half: float) -> ac.System:
    """Two masses of 100 kg, 2 half [m] apart."""
    scene = ac.System()
    scene.world, scene.earth = World(gravity=None), CentralField(MU)
    scene.low, scene.high, scene.rod = Particle(100.0), Particle(100.0), Rod(2 * half)
    scene.connect(scene.low.point, scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, scene.high.point)
    return scene


def upright(half: float) -> float:
    """Rate [rad/s] of the circular motion with the rod upright: n^2 (r_1 + r_2) = mu (1 / r_1^2 + 1 / r_2^2)."""
    return np.sqrt(MU * (1 / (RADIUS - half) ** 2 + 1 / (RADIUS + half) ** 2) / (2 * RADIUS))


def swing(in_plane: bool) -> float:
    """Rate of small swings of a short dumbbell, by that of its orbit."""
    half, small = 20.0, 0.002
    scene, n = satellite(half), upright(half)
    up = np.array([np.cos(small), np.sin(small), 0.0] if in_plane else [np.cos(small), 0.0, np.sin(small)])
    low, high = scene.low.point, scene.high.point
    begin = {}
    for end, side in ((low, -1), (high, 1)):
        place = np.array([RADIUS, 0, 0]) + side * half * up
        begin |= {end.position: place, end.velocity: ac.near(np.cross([0, 0, n], place))}
    rod = high.position - low.position
    aside = low.position[0] * rod[1] - low.position[1] * rod[0] if in_plane else rod[2]
    run = ac.build(scene).simulate(3 * 2 * np.pi / n, begin, rtol=1e-12, events=[ac.when(aside)])
    return np.pi / np.mean(np.diff([event.time for event in run.events])) / n


def main(folder: str = "out") -> float:
    """One orbit upright, and swings; returns the largest difference from the closed forms, relative."""
    half = 1.5e6  # a very long one, to be seen
    scene, n = satellite(half), upright(half)
    model = ac.build(scene)
    print(model)
    low, high = scene.low.point, scene.high.point
    ends = [(low, RADIUS - half), (high, RADIUS + half)]
    begin = {end.position: (r, 0, 0) for end, r in ends} | {end.velocity: (0, n * r, 0) for end, r in ends}
    run = model.simulate(2 * np.pi / n, begin, rtol=1e-12)
    turn = np.column_stack([np.cos(n * run.t), np.sin(n * run.t), 0 * run.t])
    off = max(float(np.max(np.abs(run[end.position] / r - turn))) for end, r in ends)
    tension = np.sum(run[scene.rod.frame_b.force] * turn, axis=1)
    exact = 100.0 * (MU / (RADIUS + half) ** 2 - n**2 * (RADIUS + half))
    off = max(off, float(np.max(np.abs(np.abs(tension) / abs(exact) - 1))))
    rates = swing(True), swing(False)
    missed = max(off, abs(rates[0] / np.sqrt(3) - 1), abs(rates[1] / 2 - 1))
    print(run)
    print(
        f"upright to {off:.0e}, the rod pulls with {abs(exact):.1f} N; short ones swing {rates[0]:.6f} times an orbit in its plane, {rates[1]:.6f} times across it"
    )
    run.picture(f"{folder}/dumbbell_satellite.png", times=tuple(np.linspace(0, 1.5, 7) * np.pi / n))
    run.animate(f"{folder}/dumbbell_satellite.html", speed=1000.0)
    return missed


if __name__ == "__main__":
    main()
