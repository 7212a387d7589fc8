"""A tippe top: spun upright, it slips, rises, and ends on its stem, heavier side up.

Friction at its foot turns it over, whatever its law: the momentum about the centre of mass along the way from there to the foot stays (Jellett), and the spin pays
for the height. It has one rim of a ball here, and no stem. O'Reilly, Intermediate Dynamics for Engineers, 10.9 and its references.
"""

import numpy as np

import acausal as ac
from acausal.visual.shapes import Rod, Sphere
from components import Coulomb, Plane, RigidBody, RoughContact, World
from components import Sphere as Ball

LIMIT = 1e-8  # of what main returns

MASS, RADIUS, BELOW, ACROSS, ALONG, FRICTION, TILT, SPIN = 0.02, 0.02, 0.004, 3.0e-6, 2.8e-6, 0.3, 0.1, 200.0


def main(folder: str = "out") -> float:
    """Until it stands on its head; returns how much Jellett's number and the energy balance change, as part of what they are."""
    scene = ac.System()
    shapes = (Sphere(RADIUS), Rod((0, 0, 0), (0, 0, 1.7 * RADIUS), 0.15 * RADIUS))
    scene.world, scene.top = World(), RigidBody(MASS, (ACROSS, ACROSS, ALONG), centre_of_mass=(0, 0, -BELOW), shapes=shapes)
    scene.foot = RoughContact(Ball(RADIUS), Plane(), Coulomb(FRICTION))
    scene.connect(scene.world.frame, scene.foot.frame_a)
    scene.connect(scene.foot.frame_b, scene.top.frame)
    model = ac.build(scene)
    print(model)
    f, c, s = scene.top.frame, np.cos(TILT), np.sin(TILT)
    start = {
        f.position[:2]: (0, 0),
        f.rotation: ((c, 0, s), (0, 1, 0), (-s, 0, c)),
        f.velocity[:2]: (0, 0),
        f.angular_velocity: (0, 0, SPIN),
    }
    run = model.simulate(3.0, start, rtol=1e-11)
    R, w = run[f.rotation], run[f.angular_velocity]
    momentum = np.einsum("nij,j,nkj,nk->ni", R, [ACROSS, ACROSS, ALONG], R, w)
    jellett = np.einsum("ni,ni->n", momentum, BELOW * R[:, :, 2] - RADIUS * np.array([0, 0, 1.0]))
    change = float(np.ptp(jellett) / abs(jellett[0]))
    print(run)
    print(
        f"its axis turns from {TILT:g} rad off the vertical to {np.arccos(R[-1, 2, 2]):.3f} rad, its spin from {SPIN:g} to {w[-1, 2]:.1f} rad/s"
    )
    print(f"Jellett's number is kept to {change:.0e}, energy and what friction takes to {run.energy_error():.0e}")
    run.picture(f"{folder}/tippe_top.png", times=(0.0, 1.0, 3.0))
    run.animate(f"{folder}/tippe_top.html", speed=0.2)
    return max(change, run.energy_error())


if __name__ == "__main__":
    main()
