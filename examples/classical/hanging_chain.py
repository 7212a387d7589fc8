"""A hanging chain: beads on massless links, whose modes Bernoulli found with a new kind of polynomials.

Squares of the frequencies are g / l times the zeros of Laguerre's polynomial of as many beads; with many of them the slowest comes near to that of a rope,
j_0 / 2 sqrt(g / L) with the first zero of Bessel's function. Let go sideways, it whips.
"""

import numpy as np
from scipy.special import jn_zeros, roots_laguerre

import acausal as ac
from acausal.visual.shapes import PointMass, Rod
from components import Revolute, RigidBody, World

LIMIT = 1e-9  # of what main returns

BEADS, LENGTH, MASS, G = 12, 1.2, 0.05, 9.81


def main(folder: str = "out") -> float:
    """Modes, and two seconds from a horizontal start; returns how far frequencies and energy are off, as part of what they are."""
    link = LENGTH / BEADS
    shapes = (Rod((0, 0, 0), (0, 0, -link)), PointMass(radius=0.15 * link, position=(0, 0, -link)))
    scene = ac.System()
    scene.world = World(gravity=(0, 0, -G))
    scene.pins = [Revolute("y") for _ in range(BEADS)]
    scene.links = [RigidBody(MASS, (0, 0, 0), centre_of_mass=(0, 0, -link), shapes=shapes) for _ in range(BEADS)]
    end = scene.world.frame
    for pin, body in zip(scene.pins, scene.links, strict=True):
        scene.connect(end, pin.frame_a)
        scene.connect(pin.frame_b, body.frame)
        end = body.at((0, 0, -link))
    model = ac.build(scene)
    print(model)
    found = np.sort(np.abs(np.imag(np.linalg.eigvals(model.linearize().A))))[::2]
    known = np.sqrt(G / link * np.sort(roots_laguerre(BEADS)[0]))
    off = float(np.max(np.abs(found / known - 1)))
    rope = 0.5 * jn_zeros(0, 1)[0] * np.sqrt(G / LENGTH)
    print(f"slowest mode {found[0]:.6f} rad/s, of a rope {rope:.6f}; all {BEADS} are Laguerre's to {off:.0e}")
    run = model.simulate(2.0, {scene.pins[0].q: -0.5 * np.pi}, rtol=1e-11)
    fast = np.linalg.norm(run[end.velocity], axis=1).max()
    print(run)
    print(
        f"let go sideways its end reaches {fast:.1f} m/s, where a fall through its length gives {np.sqrt(2 * G * LENGTH):.1f}; energy kept to {run.energy_error():.0e}"
    )
    run.picture(f"{folder}/hanging_chain.png", times=(0.0, 0.3, 0.6))
    run.animate(f"{folder}/hanging_chain.html", speed=0.3)
    return max(off, run.energy_error())


if __name__ == "__main__":
    main()
