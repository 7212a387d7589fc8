"""Throw over a wall: an arm lets a ball go so that it clears a wall and lands where it should.

Three problems in a row: the arm with the ball, the ball up to the wall, the ball down to its aim. Flight in closed form is the check.

    python examples/control/throw_over_wall.py
"""

import acausal as ac
from components import Fixed, Particle, Revolute, RigidBody, TorqueSource, World

LIMIT = 1e-6  # of what main returns

WALL, AIM, G = (2.0, 1.5), (4.0, -0.5), 9.81


class Arm(ac.System):
    """A rod with a motor, and a ball at its end."""

    def __init__(self) -> None:
        self.torque = ac.Input("N m")
        self.world, self.shoulder, self.motor = World(gravity=(0, 0, -G)), Revolute("y"), TorqueSource(self.torque)
        self.rod, self.reach, self.ball = RigidBody.rod(1.0, (0.8, 0, 0)), Fixed((0.8, 0, 0)), Particle(0.5)
        self.connect(self.world.frame, self.shoulder.frame_a)
        self.connect(self.shoulder.frame_b, self.rod.frame)
        self.connect(self.rod.frame, self.reach.frame_a)
        self.connect(self.reach.frame_b, self.ball.point)
        self.connect(self.motor.flange, self.shoulder.flange)


class Flying(ac.System):
    """The ball in the air."""

    def __init__(self) -> None:
        self.world, self.ball = World(gravity=(0, 0, -G)), Particle(0.5)


def main(folder: str = "out") -> float:
    """Find the throw; returns by how far the parabola from the hand misses wall and aim [m]."""
    arm, air = Arm(), Flying()
    swing = ac.OptimalControl(ac.build(arm), ac.free(0.2, 1.5))
    swing.start({arm.shoulder.q: -3.5})
    swing.end({arm.shoulder.q: (-2.9, -1.6)})
    swing.bound(arm.torque, -40, 40)
    swing.minimise(ac.integral(arm.torque**2))
    model, place, hand = ac.build(air), air.ball.point.position, arm.reach.frame_b
    up, down = ac.OptimalControl(model, ac.free(0.1, 3)), ac.OptimalControl(model, ac.free(0.1, 3))
    up.end({place[0]: WALL[0], place[2]: (WALL[1], 5.0)})
    down.end({place[0]: AIM[0], place[2]: AIM[1]})
    throw = ac.phases(swing, up, down)
    throw.link(swing, up, {place: hand.position, air.ball.point.velocity: hand.velocity})
    best = throw.solve([16, 3, 3], tolerance=1e-8)
    print(best)
    run = best[0].run
    (x, _, z), (vx, _, vz) = run[hand.position][-1], run[hand.velocity][-1]
    print(f"let go at ({x:.3f}, {z:.3f}) m with ({vx:.3f}, {vz:.3f}) m/s")
    heights = [z + vz * t - G / 2 * t**2 for t in ((WALL[0] - x) / vx, (AIM[0] - x) / vx)]
    run.picture(f"{folder}/throw_over_wall.png", times=(0.0, 0.6 * run.t[-1], run.t[-1]))
    run.animate(f"{folder}/throw_over_wall.html", speed=0.25)
    return abs(heights[0] - WALL[1]) + abs(heights[1] - AIM[1])


if __name__ == "__main__":
    main()
