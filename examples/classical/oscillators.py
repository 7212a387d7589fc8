"""Ten particles in a row between springs: their modes are sine waves.

The frequencies are 2 sqrt(k / m) sin(n pi / 22), n from 1 to 10. The beginning is a pluck: one particle aside, which is the sum of all modes.
O'Reilly, Intermediate Dynamics for Engineers, 5.2.
"""

import numpy as np

import acausal as ac
from components import Prismatic, RigidBody, TranslationalGround, TranslationalSpring, World

LIMIT = 1e-9  # of what main returns

COUNT, MASS, STIFFNESS, GAP = 10, 0.1, 40.0, 0.2


def main(folder: str = "out") -> float:
    """Returns how far the frequencies are off, relative, and the motion from the sum of its modes [m]."""
    scene = ac.System()
    scene.world, scene.walls = World(gravity=None), [TranslationalGround(), TranslationalGround()]
    scene.carts = [RigidBody.box(MASS, (0.1, 0.06, 0.06)) for _ in range(COUNT)]
    scene.rails = [Prismatic(axis="x") for _ in range(COUNT)]
    scene.springs = [TranslationalSpring(STIFFNESS) for _ in range(COUNT + 1)]
    for k, (cart, rail) in enumerate(zip(scene.carts, scene.rails, strict=True)):
        scene.connect(scene.world.at(((k + 1) * GAP, 0, 0)), rail.frame_a)
        scene.connect(rail.frame_b, cart.frame)
    ends = [scene.walls[0], *scene.rails, scene.walls[1]]
    for spring, a, b in zip(scene.springs, ends, ends[1:], strict=False):
        scene.connect(a.flange, spring.flange_a)
        scene.connect(spring.flange_b, b.flange)
    model = ac.build(scene)
    print(model)
    n = np.arange(1, COUNT + 1)
    exact = 2 * np.sqrt(STIFFNESS / MASS) * np.sin(n * np.pi / (2 * COUNT + 2))
    found = np.sort([mode.angular_frequency for mode in model.linearize().modes()])
    off = float(np.max(np.abs(found / exact - 1)))

    run = model.simulate(4.0, {scene.rails[2].q: 0.08}, rtol=1e-12)
    shapes = np.sqrt(2 / (COUNT + 1)) * np.sin(np.outer(n, n) * np.pi / (COUNT + 1))
    motion = (shapes[2] * 0.08 * np.cos(run.t[:, None] * exact)) @ shapes
    away = float(np.max(np.abs(np.stack([run[rail.q] for rail in scene.rails], axis=1) - motion)))
    print(run)
    print(
        f"{COUNT} frequencies from {found[0]:.3f} to {found[-1]:.3f} rad/s, off by {off:.0e}; the motion is the sum of its modes to {away:.0e} m"
    )
    run.picture(f"{folder}/oscillators.png", times=(0.0, 0.1, 0.2))
    run.animate(f"{folder}/oscillators.html", speed=0.5)
    return max(off, away)


if __name__ == "__main__":
    main()
