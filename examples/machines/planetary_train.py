"""A planetary gear train with three planets as bodies: a sun, a carrier, planets that roll between the sun and a fixed ring.

Hinges on the carrier, gears between their flanges: their angles are those against the carrier, as Willis counted them (1841). The ratio of the speeds and the
acceleration under a constant torque have closed forms.
"""

import numpy as np

import acausal as ac
from components import Gear, Revolute, RigidBody, Torque, World

LIMIT = 1e-10  # of what main returns

SUN, PLANET = 0.05, 0.03  # pitch radii [m]
RING, ARM = SUN + 2 * PLANET, SUN + PLANET


def main(folder: str = "out") -> float:
    """Two seconds with 0.02 Nm on the sun; returns the largest difference from Willis' speeds and the acceleration, relative."""
    scene = ac.System()
    scene.world = World(gravity=None)
    scene.carrier = RigidBody.box(0.3, (ARM, ARM, 0.005), position=(0, 0, 0))
    scene.sun = RigidBody.cylinder(0.4, SUN, 0.02, position=(0, 0, 0))
    scene.planets = [
        RigidBody.cylinder(0.15, PLANET, 0.02, position=(ARM * np.cos(a), ARM * np.sin(a), 0))
        for a in 2 * np.pi / 3 * np.arange(3)
    ]
    scene.main = Revolute.between(scene.world, scene.carrier, at=(0, 0, 0), axis="z")
    scene.shaft = Revolute.between(scene.carrier, scene.sun, at=(0, 0, 0), axis="z")
    scene.axles = [Revolute.between(scene.carrier, p, at=p.sketch_pose().position, axis="z") for p in scene.planets]
    # against the carrier the ring turns by minus the carrier's angle
    scene.inside = [Gear(-PLANET / SUN) for _ in scene.planets]
    scene.outside = Gear(-PLANET / RING)
    for axle, teeth in zip(scene.axles, scene.inside, strict=True):
        scene.connect(scene.shaft.flange, teeth.flange_a)
        scene.connect(teeth.flange_b, axle.flange)
    scene.connect(scene.main.flange, scene.outside.flange_a)
    scene.connect(scene.outside.flange_b, scene.axles[0].flange)
    scene.motor = Torque((0, 0, 0.02))
    scene.connect(scene.motor.frame, scene.sun.frame)

    model = ac.build(scene)
    print(model)
    run = model.simulate(2.0, rtol=1e-11)
    sun, carrier = (run[body.frame.angular_velocity][:, 2] for body in (scene.sun, scene.carrier))
    willis = 1 + RING / SUN
    planet = 1 - RING / PLANET  # speed of a planet for one of the carrier
    inertia = 0.4 * SUN**2 / 2 * willis**2 + 0.3 * 2 * ARM**2 / 12 + 3 * 0.15 * (ARM**2 + PLANET**2 / 2 * planet**2)
    exact = 0.02 * willis / inertia * run.t
    off = float(max(np.max(np.abs(sun - willis * carrier)) / sun[-1], np.max(np.abs(carrier - exact)) / exact[-1]))
    print(run)
    print(
        f"the sun turns {sun[-1] / carrier[-1]:.3f} times as fast as the carrier (Willis: {willis:.3f}); speeds on the closed form to {off:.0e}"
    )
    run.picture(f"{folder}/planetary_train.png", times=(0.0, 0.6))
    run.animate(f"{folder}/planetary_train.html")
    return off


if __name__ == "__main__":
    main()
