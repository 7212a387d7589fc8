"""A rod that is caught at one end: a constraint that is imposed suddenly.

No impulse acts about the pivot: m v l / 2 = J w with J = m (l^2 / 3 + r^2 / 4), and 1 - m l^2 / 4 J of the energy is lost, a quarter where it is thin. Later it
is let go, and flies off without a jump. O'Reilly, 2.10.
"""

import acausal as ac
from components import PointLatch, RigidBody, World

LIMIT = 1e-10  # of what main returns
LENGTH, RADIUS, SPEED = 1.2, 0.03, 2.0


def main(folder: str = "out") -> float:
    """Three seconds; returns how far angular velocity and loss are from the closed form, relative."""
    scene = ac.System()
    scene.world, scene.rod = World(None), RigidBody.rod(mass=1.5, tip=(0, LENGTH, 0), radius=RADIUS)
    scene.pivot = PointLatch(closes=1.0 * scene.rod.tip.position[0], opens=ac.time - 1.75)
    scene.connect(scene.world.frame, scene.pivot.frame_a)
    scene.connect(scene.pivot.frame_b, scene.rod.frame)
    model = ac.build(scene)
    print(model)
    run = model.simulate(3.0, {scene.rod.frame.position: (-2.0, 0, 0), scene.rod.frame.velocity: (SPEED, 0, 0)}, rtol=1e-12)
    print(run)
    print(run.transitions)
    w = run.at([1.5])[scene.rod.frame.angular_velocity][0, 2]
    lost = (run.energy[0] - run.energy[-1]) / run.energy[0]
    print(f"turns with {w:.12f} rad/s; loses {lost:.12f} of its energy")
    run.picture(f"{folder}/caught_rod.png", times=(0.0, 0.5, 1.0, 1.2, 1.4, 1.6, 2.0, 2.5))
    run.animate(f"{folder}/caught_rod.html")
    square = LENGTH**2 / 3 + RADIUS**2 / 4
    return float(max(abs(w / (-SPEED * LENGTH / 2 / square) - 1), abs(lost - 1 + LENGTH**2 / 4 / square)))


if __name__ == "__main__":
    main()
