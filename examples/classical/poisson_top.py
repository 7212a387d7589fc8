"""Poisson's top: a spinning top whose tip slides on a smooth table, so that its centre of mass only rises and falls.

Nothing pushes sideways: seen from above the centre moves on with constant speed. Two angular momenta and the energy then give the rate of its tilt u,
(I + m l^2 sin(u)^2) u'^2 = 2 (E - m g l cos u) - p_axis^2 / C - (p_up - p_axis cos u)^2 / (I sin(u)^2), and where it turns back: at the zeros of the right side.
O'Reilly, Intermediate Dynamics for Engineers, 10.9.
"""

import numpy as np
from scipy.optimize import brentq

import acausal as ac
from acausal import rotations
from acausal.visual.shapes import Disk, Rod
from components import PointOnPlane, RigidBody, World

LIMIT = 1e-9  # of what main returns

MASS, ARM, ACROSS, ALONG, G = 0.5, 0.08, 8e-4, 5e-4, 9.81  # inertias about the centre of mass
TILT, PRECESSION, SPIN = 0.5, 3.0, 150.0


def main(folder: str = "out") -> float:
    """Two seconds; returns how far the rate of the tilt, the angles at which it turns back, and the way of the centre are off, relative."""
    scene = ac.System()
    shapes = (Rod((0, 0, 0), (0, 0, 1.4 * ARM)), Disk(radius=0.05, thickness=0.01, position=(0, 0, ARM)))
    scene.world, scene.tip = World(gravity=(0, 0, -G)), PointOnPlane()
    scene.top = RigidBody(MASS, (ACROSS, ACROSS, ALONG), (0, 0, ARM), shapes=shapes)
    scene.connect(scene.world.frame, scene.tip.frame_a)
    scene.connect(scene.tip.frame_b, scene.top.frame)
    model = ac.build(scene)
    print(model)
    angles = rotations.euler_angles(scene.top.frame.rotation, "intrinsic zxz")  # precession, tilt, spin
    drift = np.array([0.1, 0.0])
    start = {angles: (0, TILT, 0), ac.der(angles): (PRECESSION, 0, SPIN), scene.top.centre.velocity[:2]: drift}
    run = model.simulate(2.0, start, rtol=1e-12)

    own = ALONG * (PRECESSION * np.cos(TILT) + SPIN)
    upright = ACROSS * np.sin(TILT) ** 2 * PRECESSION + own * np.cos(TILT)

    def right_side(u: np.ndarray | float, energy: float = 0.0) -> np.ndarray | float:
        about = (upright - own * np.cos(u)) ** 2 / (ACROSS * np.sin(u) ** 2)
        return 2 * (energy - MASS * G * ARM * np.cos(u)) - about

    energy = -0.5 * right_side(TILT)  # its part that the axis does not have for itself
    u, rate = run[angles[1]], run[ac.der(angles[1])]
    square = right_side(u, energy) / (ACROSS + MASS * ARM**2 * np.sin(u) ** 2)
    back = float(brentq(lambda x: right_side(x, energy), TILT + 0.01, TILT + 0.5))
    highest = run.t[np.argmax(u)]
    seen = run.at(np.linspace(highest - 0.01, highest + 0.01, 20001))[angles[1]].max()
    centre = run[scene.top.centre.position][:, :2]
    tip = run[scene.top.frame.position][:, :2]
    off = [
        float(np.max(np.abs(rate**2 - square)) / np.max(square)),
        abs(float(seen) - back),
        float(np.max(np.abs(centre - centre[0] - np.outer(run.t, drift)))),
    ]
    print(run)
    print(f"it nods between {TILT} and {back:.6f} rad; seen to {seen:.6f}. Squares of the rate are met to {off[0]:.0e}")
    print(
        f"the centre goes straight on to {off[2]:.0e} m, and its tip goes around it within {np.max(np.linalg.norm(tip - centre, axis=1)):.4f} m"
    )
    run.picture(f"{folder}/poisson_top.png", times=(0.0, 0.15, 0.3))
    run.animate(f"{folder}/poisson_top.html", speed=0.25)
    return max(off)


if __name__ == "__main__":
    main()
