"""A block on a belt sticks and slips: what makes brakes squeal and violins sound.

The belt carries the block along until the spring pulls harder than friction can hold; then it slips back, as an oscillation about the force of sliding,
until it is as fast as the belt again. Both are known in closed form (Den Hartog, Trans. ASME 53, 1931): with s = (holding - sliding) / stiffness it
slips for 2 (pi - atan(omega s / belt)) / omega and sticks for 2 s / belt.
"""

import numpy as np

import acausal as ac
from components import Clutch, Prismatic, RigidBody, TranslationalGround, TranslationalSpring, VelocitySource, World

LIMIT = 1e-10  # of what main returns

MASS, STIFFNESS, SLIDING, HOLDING, BELT = 1.0, 25.0, 4.0, 7.0, 0.4


def main(folder: str = "out") -> float:
    """Ten seconds; returns the largest error of a period [s]."""
    scene = ac.System()
    scene.world, scene.rail, scene.block = World(gravity=None), Prismatic(axis="x"), RigidBody.box(MASS, (0.2, 0.15, 0.1))
    scene.wall, scene.spring, scene.belt = TranslationalGround(), TranslationalSpring(STIFFNESS), VelocitySource(BELT)
    scene.friction = Clutch(scene.belt.flange, scene.rail.flange, capacity=SLIDING, holding=HOLDING)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.block.frame)
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.rail.flange)
    model = ac.build(scene)
    print(model)
    run = model.simulate(10.0, {scene.rail.q: 0.0, scene.rail.v: BELT}, rtol=1e-12)

    slips = run.transitions.times[::2]
    omega, ahead = np.sqrt(STIFFNESS / MASS), (HOLDING - SLIDING) / STIFFNESS
    slip, stick = 2 * (np.pi - np.arctan(omega * ahead / BELT)) / omega, 2 * ahead / BELT
    off = float(np.max(np.abs(np.diff(slips) - slip - stick)))
    print(run)
    print(
        f"slips {slips.size} times, first at {slips[0]:.6f} s; each time for {slip:.6f} s, then sticks for {stick:.6f} s; to {off:.0e} s"
    )
    print(
        f"the spring pulls with at most {STIFFNESS * run[scene.rail.q].max():.12f} N; energy lost or gained: {run.energy_error():.0e}"
    )
    run.picture(f"{folder}/stick_slip.png", times=(0.0, 0.6, 0.8, 1.0))
    run.animate(f"{folder}/stick_slip.html")
    return off


if __name__ == "__main__":
    main()
