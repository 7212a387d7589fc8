"""Compass gait: two telescopic legs that walk, each step as the one before with legs swapped.

The swinging foot strikes, sticks, and the other foot is let go; friction and pushes stay within what the ground can give. The plan is then simulated, where
the ground decides by itself what sticks.

    python examples/control/compass_gait.py
"""

from typing import Any

import acausal as ac
from components import Coulomb, ForceSource, Particle, PointOnPlane, Prismatic, Revolute, RigidBody, TorqueSource, World

LIMIT = 1e-8  # of what main returns


class Walker(ac.System):
    """A body on two legs in a vertical plane: a torque between the legs, a force along each, and feet that are points."""

    def __init__(self, gravity: tuple[float, float, float] = (0, 0, -9.81)) -> None:
        self.torque = ac.Input("N m")
        self.world, self.along, self.up = World(gravity=gravity), Prismatic("x"), Prismatic("z")
        self.trunk = RigidBody.box(10.0, (0.1, 0.2, 0.1))
        self.lean, self.hip, self.motor = Revolute("y"), Revolute("y"), TorqueSource(self.torque)
        self.left, self.right = Leg(), Leg()
        self.connect(self.world.frame, self.along.frame_a)
        self.connect(self.along.frame_b, self.up.frame_a)
        self.connect(self.up.frame_b, self.trunk.frame)
        self.connect(self.trunk.frame, self.lean.frame_a)
        self.connect(self.lean.frame_b, self.left.frame)
        self.connect(self.left.frame, self.hip.frame_a)
        self.connect(self.hip.frame_b, self.right.frame)
        self.connect(self.motor.flange, self.hip.flange)
        for leg in (self.left, self.right):
            self.connect(self.world.frame, leg.floor)


class Leg(ac.System):
    """A thigh, and a foot that is pushed along it, above a floor."""

    frame, floor = ac.Frame.port(), ac.Frame.port()

    def __init__(self) -> None:
        self.push = ac.Input("N")
        self.thigh, self.slide, self.foot = (
            RigidBody(2.0, (0.03, 0.03, 0.001), (0, 0, -0.3)),
            Prismatic((0, 0, -1)),
            Particle(0.5),
        )
        self.motor, self.ground = ForceSource(self.push), PointOnPlane(unilateral=True, friction=Coulomb(0.8))
        self.connect(self.frame, self.thigh.frame)
        self.connect(self.thigh.frame, self.slide.frame_a)
        self.connect(self.slide.frame_b, self.foot.point)
        self.connect(self.motor.flange, self.slide.flange)
        self.connect(self.floor, self.ground.frame_a)
        self.connect(self.ground.frame_b, self.foot.point)

    @property
    def place(self) -> ac.Expression:
        """Of the foot [m]."""
        return self.foot.point.position


def steps(walker: Walker, time: float, far: float) -> ac.Phases:
    """Of least effort, one like the other: each takes a `time` [s] and leads so `far` [m]."""
    model = ac.build(walker)
    left, right, lean, hip = walker.left, walker.right, walker.lean, walker.hip
    step = ac.OptimalControl(model, time, modes={left.ground: "sticks"})
    anything: dict[Any, Any] = {one.v: ac.free(-5, 5) for one in (walker.along, walker.up, lean, hip, left.slide, right.slide)}
    places = {
        walker.along.q: ac.free(-1, 1, -0.2),
        walker.up.q: ac.free(0.5, 1.2, 0.9),
        lean.q: ac.free(-1, 1, 0.25),
        hip.q: ac.free(-1.5, 1.5, -0.5),
    }
    lengths = {one.slide.q: ac.free(0.75, 1.0, 0.95) for one in (left, right)}
    step.start({left.place[0]: 0.0, **places, **lengths, **anything, walker.along.v: ac.free(0, 3, 0.8)})
    step.at(0.5, {right.place[2]: (0.03, 0.3)})
    step.end({right.place[0]: far, right.place[2]: 0.0})
    for leg in (left, right):
        step.bound(leg.slide.q, 0.75, 1.0)
        step.bound(leg.slide.v, -2, 2)
        step.bound(leg.push, -400, 400)
    step.bound(walker.torque, -50, 50)
    step.minimise(ac.integral(walker.torque**2 + 0.01 * (left.push**2 + right.push**2)))
    gait = ac.phases(step)
    swapped: dict[Any, Any] = {
        lean.q: lean.q + hip.q, hip.q: -hip.q, lean.v: lean.v + hip.v, hip.v: -hip.v, left.slide.q: right.slide.q, right.slide.q: left.slide.q,
        left.slide.v: right.slide.v, right.slide.v: left.slide.v, walker.up.q: walker.up.q, walker.up.v: walker.up.v, walker.along.v: walker.along.v,
    }  # fmt: skip
    gait.link(step, step, swapped, impact={right.ground: "sticks"})
    return gait


def main(folder: str = "out") -> float:
    """Find a step of least effort; returns by how much it is off when it is simulated, relative to what each state varies by."""
    best = steps(Walker(), 0.55, 0.45).solve(16, tolerance=1e-9)
    print(best)
    print(best.run.transitions)
    best.run.picture(f"{folder}/compass_gait.png", times=[part * best.duration for part in (0.0, 0.33, 0.67, 1.0)])
    best.run.animate(f"{folder}/compass_gait.html", speed=0.25)
    return best.replay_error


if __name__ == "__main__":
    main()
