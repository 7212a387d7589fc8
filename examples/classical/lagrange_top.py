"""Lagrange's top: a spinning body on a fixed point, which goes around instead of falling.

With the right start it precesses steadily, at a slow or a fast rate; both solve a quadratic equation. Any other motion nods, and keeps energy and two angular
momenta. Upright it sleeps where C^2 W^2 > 4 I m g a, else it falls as exp(sqrt(4 I m g a - C^2 W^2) t / (2 I)). O'Reilly, Intermediate Dynamics for Engineers, 10.2.
"""

import numpy as np

import acausal as ac
from acausal.visual.shapes import Disk, Rod
from components import RigidBody, Spherical, World

LIMIT = 1e-9  # of what main returns

MASS, ARM, ACROSS, ALONG, TILT, SPIN = 0.5, 0.1, 7e-3, 1e-3, 0.5, 120.0


def main(folder: str = "out") -> float:
    """Three seconds, steady and let go; returns how far tilt, momenta and energy are off."""
    scene = ac.System()
    scene.world, scene.ball = World(), Spherical()
    inertia = ACROSS - MASS * ARM**2
    shapes = (Rod((0, 0, 0), (0, 0, 1.4 * ARM)), Disk(radius=0.07, thickness=0.01, position=(0, 0, ARM)))
    scene.top = RigidBody(MASS, (inertia, inertia, ALONG), (0, 0, ARM), shapes=shapes)
    scene.connect(scene.world.frame, scene.ball.frame_a)
    scene.connect(scene.ball.frame_b, scene.top.frame)
    model = ac.build(scene)
    print(model)
    tilted = np.array([np.cos(TILT / 2), np.sin(TILT / 2), 0, 0])

    # I cos(tilt) p^2 - L p + m g a = 0, L the momentum along the axis
    momentum = ALONG * SPIN
    roots = np.roots([ACROSS * np.cos(TILT), -momentum, MASS * 9.81 * ARM])
    off = 0.0
    for rate in roots:
        w = rate * np.array([0, np.sin(TILT), 0]) + np.array([0, 0, SPIN])
        steady = model.simulate(3.0, {scene.ball.q: tilted, scene.ball.v: w}, rtol=1e-12)
        off = max(off, float(np.max(np.abs(steady[scene.top.frame.rotation][:, 2, 2] - np.cos(TILT)))))
        print(f"steady at {rate:.3f} rad/s: the tilt is kept to {off:.0e}")
    slowest = 2 * np.sqrt(ACROSS * MASS * 9.81 * ARM) / ALONG
    for spin in (0.9 * slowest, 1.1 * slowest):
        grows = max(mode.eigenvalue.real for mode in model.linearize({scene.ball.v: (0, 0, spin)}).modes())
        exact = np.sqrt(max(4 * ACROSS * MASS * 9.81 * ARM - (ALONG * spin) ** 2, 0.0)) / (2 * ACROSS)
        off = max(off, float(abs(grows - exact)) / spin)
        print(
            f"upright at {spin:.1f} rad/s it {'falls' if exact > 0 else 'sleeps'}: what grows does so at {exact:.4f}/s, met to {off:.0e}"
        )
    run = model.simulate(3.0, {scene.ball.q: tilted, scene.ball.v: (0, 0, SPIN)}, rtol=1e-12)
    R, w = run[scene.top.frame.rotation], run[scene.top.frame.angular_velocity]
    own = np.einsum("nji,nj->ni", R, w)
    upright = np.einsum("ni,ni->n", R[:, 2, :], own * [ACROSS, ACROSS, ALONG])
    change = float(max(np.ptp(own[:, 2]) / SPIN, np.ptp(upright) / abs(upright[0])))
    print(run)
    print(f"let go it nods; momenta about its axis and the vertical are kept to {change:.0e}, energy to {run.energy_error():.0e}")
    run.picture(f"{folder}/lagrange_top.png", times=(0.0, 0.2, 0.4))
    run.animate(f"{folder}/lagrange_top.html", speed=0.25)
    return max(off, change, run.energy_error())


if __name__ == "__main__":
    main()
