"""A bead on a rotating hoop: above a certain speed it leaves the bottom.

The hoop turns about its upright diameter with a given speed. Energy is not kept, since the drive does work, but Jacobi's integral is. At rest against the hoop the
bead sits where the cosine of its angle is g / (R W^2).
"""

import numpy as np

import acausal as ac
from components import Circle, Fixed, Particle, PointOnCurve, PrescribedMotion, World

LIMIT = 1e-9  # of what main returns

R, W, G = 0.5, 7.0, 9.81


def main(folder: str = "out") -> float:
    """Five seconds from near the bottom; returns how far Jacobi's integral and the rest position are off, relative."""
    scene = ac.System()
    scene.world, scene.spin, scene.bead = World(gravity=(0, 0, -G)), PrescribedMotion(angle=W * ac.time), Particle(0.1)
    scene.upright, scene.hoop = Fixed(rotation=("x", np.pi / 2)), PointOnCurve(Circle(R))
    scene.connect(scene.world.frame, scene.spin.frame_a)
    scene.connect(scene.spin.frame_b, scene.upright.frame_a)
    scene.connect(scene.upright.frame_b, scene.hoop.frame_a)
    scene.connect(scene.hoop.frame_b, scene.bead.point)
    model = ac.build(scene)
    print(model)
    run = model.simulate(5.0, {scene.hoop.q: -np.pi / 2 + 0.1}, rtol=1e-11)
    angle, rate = run[scene.hoop.q] + np.pi / 2, run[scene.hoop.v]
    jacobi = (R * rate) ** 2 / 2 - (W * R * np.sin(angle)) ** 2 / 2 - G * R * np.cos(angle)
    change = float(np.ptp(jacobi) / (G * R))
    rest = model.equilibrium({scene.hoop.q: -0.8})[scene.hoop.q] + np.pi / 2
    off = float(abs(rest - np.arccos(G / (R * W**2))))
    print(run)
    print(f"up to {np.degrees(angle.max()):.1f} degrees and back; rests at {np.degrees(rest):.4f} degrees, off by {off:.0e} rad")
    print(f"Jacobi's integral is kept to {change:.0e}; energy and the work of the drive balance to {run.energy_error():.0e}")
    run.picture(f"{folder}/rotating_hoop.png", times=(0.0, 0.6, 0.9))
    run.animate(f"{folder}/rotating_hoop.html")
    return max(change, off)


if __name__ == "__main__":
    main()
