"""Bricard's linkage: six hinges in a ring of six equal bars, each at right angles to the next. Counting freedoms says that it is stiff, and it turns inside out.

Neighbouring angles a and b keep cos(a) + cos(b) + cos(a) cos(b) = 0, three of each around the ring. R. Bricard, Journal de mathematiques 3 (1897);
Y. Chen, Z. You and T. Tarnai, Int. J. Solids and Structures 42 (2005), for any twist.
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, World

LIMIT = 1e-10  # of what main returns

BAR, ANGLE = 0.5, 1.2


def ring() -> tuple[np.ndarray, np.ndarray]:
    """Places and axes of the hinges, (6, 3) each: bars of the same length along x, axes turned by right angles about them to and fro."""
    angles = (ANGLE, np.arccos(-np.cos(ANGLE) / (1 + np.cos(ANGLE)))) * 3
    R, p, places, axes = np.eye(3), np.zeros(3), [], []
    for k, angle in enumerate(angles):
        places.append(p)
        axes.append(R[:, 2])
        c, s, twist = np.cos(angle), np.sin(angle), (-1) ** k
        R = R @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        p = p + BAR * R[:, 0]
        R = R @ np.array([[1, 0, 0], [0, 0, -twist], [0, twist, 0]])
    assert np.linalg.norm(p) < 1e-12, "the ring is closed"
    return np.array(places), np.array(axes)


def main(folder: str = "out") -> float:
    """Ten seconds under gravity; returns how far neighbouring angles are from the closed form."""
    places, axes = ring()
    scene = ac.System()
    scene.world = World()
    ends = np.roll(places, -1, axis=0)
    scene.bars = [RigidBody.rod(1.0, ends[k] - places[k], radius=0.02, position=places[k]) for k in range(5)]
    parts = [scene.world, *scene.bars, scene.world]  # the last bar is held
    scene.hinges = [Revolute.between(parts[k], parts[k + 1], at=places[k], axis=axes[k]) for k in range(6)]
    model = ac.build(scene)
    print(model)
    print(model.report())
    run = model.simulate(10.0, {scene.hinges[0].q: 0.0}, rtol=1e-11)

    first, second = run[scene.hinges[0].q] + ANGLE, run[scene.hinges[1].q] + np.arccos(-np.cos(ANGLE) / (1 + np.cos(ANGLE)))
    cosines = np.cos(first), np.cos(second)
    off = float(np.max(np.abs(cosines[0] + cosines[1] + cosines[0] * cosines[1])))
    print(run)
    print(
        f"angles go from {np.degrees(first.min()):.1f} to {np.degrees(first.max()):.1f} degrees, their cosines meet the closed form to {off:.0e}"
    )
    print(f"energy kept to {run.energy_error():.0e}")
    run.picture(f"{folder}/bricard.png", times=(0.0, 0.3, 0.6))
    run.animate(f"{folder}/bricard.html")
    return max(off, run.energy_error())


if __name__ == "__main__":
    main()
