"""A bead on a spinning cone: in a groove of the cone it is thrown out, or falls to the apex, and only one height is at rest between the two.

In the groove s'' = w^2 sin^2(a) s - g cos(a), w the spin of the cone, a its half angle. O'Reilly, Intermediate Dynamics for Engineers (2nd ed.), 2.9.
"""

import numpy as np

import acausal as ac
from components import Line, Particle, PointOnCurve, PrescribedMotion, World

LIMIT = 1e-10  # of what main returns

HALF_ANGLE, SPIN, GRAVITY = 0.4, 7.0, 9.81


def main(folder: str = "out") -> float:
    """A second from a little above the height of rest; returns the largest difference from the closed form [m]."""
    scene = ac.System()
    scene.world, scene.spin = World((0, 0, -GRAVITY)), PrescribedMotion(axis="z", angle=SPIN * ac.time)
    scene.groove = PointOnCurve(Line((np.sin(HALF_ANGLE), 0, np.cos(HALF_ANGLE))))
    scene.bead = Particle(0.2)
    scene.connect(scene.world.frame, scene.spin.frame_a)
    scene.connect(scene.spin.frame_b, scene.groove.frame_a)
    scene.connect(scene.groove.frame_b, scene.bead.point)
    model = ac.build(scene)
    print(model)
    rate = SPIN * np.sin(HALF_ANGLE)
    rest = GRAVITY * np.cos(HALF_ANGLE) / rate**2
    run = model.simulate(1.0, {scene.groove.q: 1.1 * rest}, rtol=1e-12)
    off = float(np.max(np.abs(run[scene.groove.q] - rest * (1 + 0.1 * np.cosh(rate * run.t)))))
    print(run)
    print(
        f"at rest {rest:.3f} m up the groove; from 10 % above thrown out to {run[scene.groove.q][-1]:.2f} m, closed form to {off:.0e} m"
    )
    run.picture(f"{folder}/spinning_cone.png", times=(0.0, 0.25, 0.5, 0.75, 1.0))
    run.animate(f"{folder}/spinning_cone.html")
    return off


if __name__ == "__main__":
    main()
