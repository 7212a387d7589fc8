"""An orbit: a particle in an inverse-square field, told in cylindrical coordinates, runs around an ellipse and sweeps equal areas.

The states are its Cartesian coordinates, which are singular nowhere; radius, angle and their rates are read of them and give the start. O'Reilly,
Intermediate Dynamics for Engineers (2nd ed.), 1.6, 2.8.
"""

import numpy as np

import acausal as ac
from acausal import curvilinear
from components import CentralField, Particle, World

LIMIT = 1e-10  # of what main returns

ECCENTRICITY = 0.6


def main(folder: str = "out") -> float:
    """Two times around, from the nearest point; returns the largest error of the ellipse, of the areas and of the period."""
    scene = ac.System()
    scene.world, scene.sun, scene.planet = World(None), CentralField(mu=4 * np.pi**2), Particle(1.0)
    place = scene.planet.point.position
    r, angle, z = curvilinear.cylindrical(place)
    model = ac.build(scene)
    print(model)
    nearest = 1 - ECCENTRICITY
    turning = 2 * np.pi * np.sqrt((1 + ECCENTRICITY) / nearest) / nearest
    start = {place: curvilinear.at_cylindrical(nearest, 0.0, 0.0), ac.der(r): 0.0, ac.der(angle): turning, ac.der(z): 0.0}
    run = model.simulate(2.0, start, rtol=1e-13)
    ellipse = np.abs(run[r] * (1 + ECCENTRICITY * np.cos(run[angle])) - (1 - ECCENTRICITY**2))
    areas = np.abs(run[r] ** 2 * run[ac.der(angle)] / (nearest**2 * turning) - 1)
    back = np.abs(run[place][-1] - run[place][0])
    print(run)
    print(f"on the ellipse to {ellipse.max():.0e}, equal areas to {areas.max():.0e}, back after a year to {back.max():.0e}")
    run.picture(f"{folder}/kepler_orbit.png", times=tuple(np.linspace(0, 0.95, 20)))
    run.animate(f"{folder}/kepler_orbit.html")
    return float(max(ellipse.max(), areas.max(), back.max()))


if __name__ == "__main__":
    main()
