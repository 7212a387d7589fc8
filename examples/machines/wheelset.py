"""A railway wheelset on two rails: cones that roll, and an axle that winds its way along. The contact is a part of one's own, in this file.

Klingel (1883) found the wavelength 2 pi sqrt(r s / gamma) from the cones alone: r their radius, s half the gauge, gamma their slope.
"""

import casadi as ca
import numpy as np

import acausal as ac
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose, symbolic
from acausal.visual.shapes import Cylinder
from components import RigidBody, World

LIMIT = 1e-3  # of what main returns

RADIUS, HALF_GAUGE, SLOPE = 0.46, 0.75, 0.05


class ConeOnRail(AbstractConstraint):
    """A cone about y of frame_b rolls on the thin rail along x of frame_a; it is `radius` [m] thick at its frame, and thinner by `slope` along y.

    The point that touches is that of the rail which lies deepest in the cone, in closed form. `guided`: it does not slip sideways either.
    """

    def __init__(self, radius: float, slope: float, guided: bool) -> None:
        self.radius, self.slope, self.guided = radius, slope, guided

    def _touching(self, X_ab: Pose) -> tuple[ca.SX, ca.SX]:
        """Gap [m], and the point of the rail in frame_b."""
        R, p = symbolic(X_ab.rotation), symbolic(X_ab.position)
        # the rail in frame_b: start + c along, from its point abreast of frame_b's origin, so that no large numbers cancel far away
        along, start = R[0, :].T, -R[1:, :].T @ p[1:]
        a, b, c = along[0] ** 2 + along[2] ** 2, along[0] * start[0] + along[2] * start[2], start[0] ** 2 + start[2] ** 2
        rise = -self.slope * along[1]  # of the cone's radius along the rail
        rest = ca.sqrt((a * c - b**2) / (a - rise**2))
        where = (rise * rest - b) / a
        point = start + where * along
        return ca.sqrt(point[0] ** 2 + point[2] ** 2) - self.radius + self.slope * point[1], point

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        return self._touching(X_ab)[0]

    def closure_rates(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> ca.SX:
        slip = symbolic(X_ab.rotation) @ (v_ab_b + ca.cross(w_ab_b, self._touching(X_ab)[1]))
        return slip[:2] if self.guided else slip[0]


def main(folder: str = "out") -> float:
    """Ten seconds, 2 mm aside; returns the difference of the wavelength from Klingel's, relative."""
    scene = ac.System()
    scene.world = World()
    scene.wheelset = RigidBody(1200.0, (700.0, 120.0, 700.0), position=(0, 0.002, RADIUS), shapes=_shapes())
    scene.left, scene.right = ConeOnRail(RADIUS, SLOPE, guided=True), ConeOnRail(RADIUS, SLOPE, guided=False)
    for contact, side, turn in ((scene.left, HALF_GAUGE, None), (scene.right, -HALF_GAUGE, ("z", np.pi))):
        scene.connect(scene.world.at((0, side, 0), rotation=turn), contact.frame_a)
        scene.connect(contact.frame_b, scene.wheelset.at((0, side, 0), rotation=turn))

    model = ac.build(scene)
    print(model)
    place = scene.wheelset.frame.position
    middle = ac.when(place[1])
    run = model.simulate(12.0, {scene.wheelset.frame.velocity[0]: 5.0, place[1]: 0.002}, rtol=1e-8, events=[middle])
    crossed = run.at([event.time for event in run.events])[place[0]].ravel()
    wavelength = 2 * np.mean(np.diff(crossed))
    klingel = 2 * np.pi * np.sqrt(RADIUS * HALF_GAUGE / SLOPE)
    print(run)
    print(
        f"it winds along with a wavelength of {wavelength:.4f} m; Klingel: {klingel:.4f} m; energy kept to {run.energy_error():.0e}"
    )
    begin = run.at(np.linspace(0.0, 1.5, 300))
    begin.picture(f"{folder}/wheelset.png", times=(0.0, 0.6, 1.2))
    begin.animate(f"{folder}/wheelset.html")
    return float(abs(wavelength / klingel - 1))


def _shapes() -> tuple[Cylinder, ...]:
    """Two wheels and their axle, to look at."""
    wheels = [Cylinder(radius=RADIUS, length=0.1, axis=(0, 1, 0), position=(0, side, 0)) for side in (HALF_GAUGE, -HALF_GAUGE)]
    return (*wheels, Cylinder(radius=0.08, length=2 * HALF_GAUGE, axis=(0, 1, 0)))


if __name__ == "__main__":
    main()
