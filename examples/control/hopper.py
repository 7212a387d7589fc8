"""Hopper: one leg that hops over and over, with least effort.

In mid-flight the foot is 30 cm above the ground. Stance and flight are phases of one model; landing is an impact of the foot. The plan is repeated and simulated over three hops, in which the model finds by
itself when the foot leaves the ground and when it strikes.

    python examples/control/hopper.py
"""

import numpy as np

import acausal as ac
from acausal.language.pieces import PiecewisePolynomial
from components import ForceSource, Particle, PointOnPlane, Prismatic, World

LIMIT = 1e-5  # of what main returns


class Hopper(ac.System):
    """A body on a leg that pushes, above the ground."""

    def __init__(self) -> None:
        self.force = ac.Input("N")
        self.world, self.rail, self.leg = World(gravity=(0, 0, -9.81)), Prismatic("z"), Prismatic("z")
        self.body, self.foot = Particle(2.0), Particle(0.2)
        self.motor, self.ground = ForceSource(self.force), PointOnPlane(unilateral=True)
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.foot.point)
        self.connect(self.rail.frame_b, self.leg.frame_a)
        self.connect(self.leg.frame_b, self.body.point)
        self.connect(self.motor.flange, self.leg.flange)
        self.connect(self.world.frame, self.ground.frame_a)
        self.connect(self.ground.frame_b, self.foot.point)


def main(folder: str = "out") -> float:
    """Find the hop; returns by how much the body is off after three hops, relative to its height."""
    scene = Hopper()
    model = ac.build(scene)
    stance = ac.OptimalControl(model, ac.free(0.1, 1), modes={scene.ground: "closed"})
    flight = ac.OptimalControl(model, ac.free(0.1, 1))
    for phase in (stance, flight):
        phase.bound(scene.force, -15, 200)
        phase.bound(scene.leg.q, 0.4, 0.8)
        phase.minimise(ac.integral(scene.force**2))
    stance.start({scene.rail.q: 0, scene.leg.q: ac.free(0.4, 0.8), scene.leg.v: ac.free(-5, 5)})
    flight.at(0.5, {scene.rail.q: 0.3})
    hop = ac.phases(stance, flight)
    hop.link(flight, stance)
    best = hop.solve(10)
    print(best)
    pieces, period = [one.inputs[scene.force] for one in best.phases], best.duration
    again = PiecewisePolynomial(
        np.concatenate([pieces[0].begins, pieces[1].begins + best[0].duration]),
        np.vstack([one.coefficients for one in pieces]),
        0.0,
        period,
    )
    start = {scene.rail.q: 0.0, scene.leg.q: float(best[0].x[1, 0]), scene.leg.v: float(best[0].x[3, 0])}
    run = model.simulate(3 * period - 1e-3, start, inputs={scene.force: again})
    print(run.transitions)
    height = scene.body.point.position[2]
    times = np.linspace(0.05, 0.95, 9) * period
    off = float(np.max(np.abs(run.at(times + 2 * period)[height] - run.at(times)[height])) / np.ptp(run[height]))
    run.picture(f"{folder}/hopper.png", times=(0.0, best[0].duration, best[0].duration + best[1].duration / 2))
    run.animate(f"{folder}/hopper.html", speed=0.3)
    return off


if __name__ == "__main__":
    main()
