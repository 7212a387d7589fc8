"""Braking: a bicycle stops as soon as it can while its rear wheel still carries 30 N.

Braking with the deceleration a unloads the rear wheel of m a h / l; so the best is a = (g c - 30 N l / m) / h, all the time, where c is how far the front
wheel stands before the centre of mass, h how high that is, and l the wheelbase. Brakes rub no more than tyres can.

    python examples/control/braking.py
"""

import acausal as ac
from components import Force, PointOnPlane, Prismatic, Revolute, RigidBody, World

LIMIT = 1e-6  # of what main returns

MASS, HEIGHT, FRONT, REAR, SPEED, FRICTION, G = 90.0, 1.1, 0.6, 0.5, 10.0, 0.8, 9.81


class Bicycle(ac.System):
    """Frame and rider in a vertical plane; tyres are points with brakes."""

    def __init__(self) -> None:
        self.world = World(gravity=(0, 0, -G))
        self.along, self.up, self.pitch = Prismatic("x"), Prismatic("z"), Revolute("y")
        self.frame = RigidBody(MASS, (10.0, 12.0, 4.0), shapes=RigidBody.box(1.0, (0.8, 0.2, 0.6)).shapes())
        self.connect(self.world.frame, self.along.frame_a)
        self.connect(self.along.frame_b, self.up.frame_a)
        self.connect(self.up.frame_b, self.pitch.frame_a)
        self.connect(self.pitch.frame_b, self.frame.frame)
        self.brakes = [ac.Input("N"), ac.Input("N")]
        self.tyres = [PointOnPlane(unilateral=True), PointOnPlane(unilateral=True)]
        self.forces = [Force((-brake, 0, 0)) for brake in self.brakes]
        for tyre, force, x in zip(self.tyres, self.forces, (FRONT, -REAR), strict=True):
            place = self.frame.at((x, 0, -HEIGHT))
            self.connect(self.world.frame, tyre.frame_a)
            self.connect(tyre.frame_b, place)
            self.connect(force.point, place)


def main(folder: str = "out") -> float:
    """Find the motion; returns by how much its time differs from the closed form, relative, and the replay's error."""
    scene = Bicycle()
    model = ac.build(scene)
    print(model)
    ocp = ac.OptimalControl(model, ac.free(0.5, 10), modes=dict.fromkeys(scene.tyres, "closed"))
    ocp.start({scene.along.q: 0, scene.up.q: HEIGHT, scene.pitch.q: 0, scene.along.v: SPEED})
    ocp.end({scene.along.v: 0})
    for brake, tyre in zip(scene.brakes, scene.tyres, strict=True):
        ocp.bound(brake, 0, 1000)
        ocp.bound(FRICTION * tyre.normal_force - brake, lower=0)
    ocp.bound(scene.tyres[1].normal_force, lower=30)
    ocp.minimise(ocp.duration + 1e-9 * (ac.integral(scene.brakes[0] ** 2) + ac.integral(scene.brakes[1] ** 2)))
    best = ocp.solve(5)
    print(best)
    exact = SPEED * HEIGHT / (G * FRONT - 30 * (FRONT + REAR) / MASS)
    print(f"stops in {best.duration:.6f} s and {best.run[scene.along.q][-1]:.4f} m; the closed form says {exact:.6f} s")
    best.run.picture(f"{folder}/braking.png", times=(0.0, 0.3, 0.7, best.duration))
    best.run.animate(f"{folder}/braking.html")
    return abs(best.duration / exact - 1) + best.replay_error


if __name__ == "__main__":
    main()
