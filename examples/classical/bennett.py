"""Bennett's linkage: four hinges whose axes are neither parallel nor meet in a point, and yet it moves. Counting freedoms says that it cannot.

Opposite bars are alike, and sin(twist) / length is the same for all, here 30 degrees on 1 m and 90 degrees on 2 m. Half the angles at neighbouring hinges
then have tangents with a constant product, sin((b + a) / 2) / sin((b - a) / 2) with the twists a and b. G. T. Bennett, A new mechanism,
Engineering 76 (1903).
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, World

LIMIT = 1e-10  # of what main returns

CORNERS = np.array([(0, 0, 0), (0.5, np.sqrt(3) / 2, 0), (-1.2, 0, 0.6), (-2.0, 0, 0)])
AXES = np.array([(0, 0, 1), (np.sqrt(3) / 4, -0.25, np.sqrt(3) / 2), (-0.3, np.sqrt(3) / 2, 0.4), (0, 1, 0)])
SHORT, LONG = np.pi / 6, np.pi / 2  # twists


def turn(axis: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Angles [rad] about axes from one direction to another, (n, 3) each."""
    return np.arctan2(np.sum(axis * np.cross(before, after), axis=1), np.sum(before * after, axis=1))


def main(folder: str = "out") -> float:
    """Ten seconds under gravity; returns how far the product of the tangents is from Bennett's, relative."""
    scene = ac.System()
    scene.world = World()
    scene.bars = [RigidBody.rod(1.0, CORNERS[k + 1] - CORNERS[k], radius=0.03, position=CORNERS[k]) for k in range(3)]
    parts = [scene.world, *scene.bars, scene.world]
    scene.hinges = [Revolute.between(parts[k], parts[k + 1], at=CORNERS[k], axis=AXES[k]) for k in range(4)]
    model = ac.build(scene)
    print(model)
    print(model.report())
    run = model.simulate(10.0, {scene.hinges[0].q: 0.0}, rtol=1e-11)

    places = [np.tile(CORNERS[0], (run.t.size, 1)), run[scene.bars[0].tip.position], run[scene.bars[1].tip.position]]
    axis = run[scene.bars[0].frame.rotation] @ AXES[1]
    first = turn(np.tile(AXES[0], (run.t.size, 1)), CORNERS[0] - np.tile(CORNERS[3], (run.t.size, 1)), places[1] - places[0])
    second = turn(axis, places[1] - places[0], places[2] - places[1])
    product = np.tan(first / 2) * np.tan(second / 2)
    exact = np.sin((LONG + SHORT) / 2) / np.sin((LONG - SHORT) / 2)
    off = float(np.max(np.abs(np.abs(product) / exact - 1)))
    print(run)
    print(
        f"the product of the tangents is {product[0]:.6f}, Bennett's {exact:.6f}: met to {off:.0e}; energy kept to {run.energy_error():.0e}"
    )
    run.picture(f"{folder}/bennett.png", times=(0.0, 0.5, 1.0, 1.5))
    run.animate(f"{folder}/bennett.html")
    return off


if __name__ == "__main__":
    main()
