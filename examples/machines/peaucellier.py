"""Peaucellier's straight line: seven bars, ten hinges, and a point that moves along an exact line.

Lipkin and Peaucellier's cell is an inversion in a circle: the products of the distances from the pivot to the two opposite corners of the rhombus
stay long^2 - short^2. The crank keeps one corner on a circle through the pivot, so the other one runs along a straight line.
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, World

LIMIT = 1e-12  # of what main returns

LONG, SHORT, CRANK = 1.0, 0.4, 0.35


def main(folder: str = "out") -> float:
    """Two seconds under gravity along x; returns the largest distance from the line [m]."""
    centre, inner = np.array([CRANK, 0, 0]), np.array([2 * CRANK * np.cos(0.3), 0, 2 * CRANK * np.sin(0.3)]) * np.cos(0.3)
    outer = inner * (LONG**2 - SHORT**2) / (inner @ inner)
    middle, across = (inner + outer) / 2, np.cross([0, 1.0, 0], inner / np.linalg.norm(inner))
    side = across * np.sqrt(SHORT**2 - np.sum((outer - inner) ** 2) / 4)
    ends = {"long_up": (0 * side, middle + side), "long_down": (0 * side, middle - side), "crank": (centre, inner)}
    ends |= {
        "in_up": (inner, middle + side),
        "in_down": (inner, middle - side),
        "out_up": (outer, middle + side),
        "out_down": (outer, middle - side),
    }

    scene = ac.System()
    scene.world = World(gravity=(0, 0, -9.81))
    bar = {name: RigidBody.rod(np.linalg.norm(b - a), b - a, position=a) for name, (a, b) in ends.items()}
    for name, body in bar.items():
        setattr(scene, name, body)
    pins = [("world", "long_up", 0 * side), ("world", "long_down", 0 * side), ("world", "crank", centre), ("crank", "in_up", inner), ("crank", "in_down", inner),
            ("long_up", "in_up", middle + side), ("long_up", "out_up", middle + side), ("long_down", "in_down", middle - side),
            ("long_down", "out_down", middle - side), ("out_up", "out_down", outer)]  # fmt: skip
    scene.pins = [Revolute.between(getattr(scene, a), getattr(scene, b), at=at, axis="y") for a, b, at in pins]

    model = ac.build(scene)
    print(model)
    run = model.simulate(2.0, rtol=1e-10)
    tip = run[scene.out_up.frame.position]
    line = (LONG**2 - SHORT**2) / (2 * CRANK)
    off = float(np.max(np.abs(tip[:, 0] - line)))
    print(run)
    print(
        f"the tip moves {np.ptp(tip[:, 2]):.3f} m along x = {line:.3f} m, and {off:.1e} m off it; energy kept to {run.energy_error():.0e}"
    )
    run.picture(f"{folder}/peaucellier.png", times=(0.0, 0.3, 0.6))
    run.animate(f"{folder}/peaucellier.html")
    return off


if __name__ == "__main__":
    main()
