"""Slider-crank with an elastic rod at 150 rad/s: the published model of Simeon (1996), and the same mechanism with a consistent mass matrix.

python examples/flexible_slider_crank.py

The problem "crank" of the Test Set for IVP Solvers: a rigid crank turns at a constant rate, the rod between crank and slider bends (two sine
modes) and stretches (two quadratic shapes). Its stiff axial vibrations are 20 times as quick as bending. The published mass matrix of
the axial shapes, rho A L [[8, 1], [1, 2]], lacks the factor 1 / 15 of the integrals of their products; other numbers follow from the shapes.
`PublishedRod` takes the published integrals as they are, and its motion is compared with numbers computed in quadruple precision from the
published equations; `FlexibleBeam` computes its own integrals.
"""

import numpy as np

import acausal as ac
from acausal.simulate.trajectory import Trajectory
from components import AngleSource, FlexibleBeam, FlexibleBody, Prismatic, Revolute, RigidBody, Section, ShapeIntegrals, World

LIMIT = 1e-12  # of what main returns

CRANK, ROD = 0.15, 0.3  # m
SPEED = 150.0  # rad/s
EDGE, MODULUS, DENSITY = 0.008, 2e11, 7870.0
MASS = DENSITY * EDGE * EDGE * ROD
PI = 3.1415927  # as published

START_Q = (0.0, 0.0, 0.103339863e-4, 0.169327969e-4)
START_V = (0.444896105, 0.463434311e-2, -0.178591076e-5, -0.268938672e-5)
"""Amplitudes and their rates, as published."""
REFERENCE = np.array([
    -0.331173498825644666885474, 0.1697373326399585495591797, 0.0001893192843020042631716763, 0.00002375751320488572357994091,
    -0.00000532389677819238227797433, -0.000008363313291666579287043979,
])  # fmt: skip
"""Angle of the rod [rad], place of the slider [m] and amplitudes [m] after 0.1 s."""
Rod = FlexibleBody | FlexibleBeam


def published_integrals() -> ShapeIntegrals:
    """Of Simeon's shapes sin(pi s), sin(2 pi s) across, 4 s (1 - s), s (2 s - 1) along the rod, with the published numbers."""
    first_shapes, mixed, both = np.zeros((3, 4)), np.zeros((3, 3, 4)), np.zeros((3, 3, 4, 4))
    first_shapes[0, 2:], first_shapes[1, 0] = (2 / 3, 1 / 6), 2 / PI
    mixed[0, 0, 2:], mixed[0, 1, :2] = (1 / 3, 1 / 6), (1 / PI, -0.5 / PI)
    both[0, 0, 2:, 2:] = ((8, 1), (1, 2))
    both[1, 1, :2, :2] = 0.5 * np.eye(2)
    both[0, 1, 2:, :2] = (16 / PI**3, 0), (1 / PI - 8 / PI**3, -0.5 / PI)
    both[1, 0] = both[0, 1].T
    return ShapeIntegrals(np.array([0.5, 0, 0]), first_shapes, np.diag([1 / 3, 0, 0]), mixed, both)


def published_rod() -> FlexibleBody:
    """The rod as published; 0.0045339259 kg m^2 is its moment of inertia about the crank's pin."""
    bending = PI**4 / 24 * (EDGE / ROD) ** 2
    stiffness = np.zeros((4, 4))
    stiffness[0, 0], stiffness[1, 1], stiffness[2:, 2:] = bending, 16 * bending, np.array([[16, -8], [-8, 7]]) / 3
    about_z = 0.0045339259 - MASS * ROD**2 / 3
    return FlexibleBody(
        published_integrals(), MASS, MODULUS * EDGE * EDGE / ROD * stiffness, length=ROD, turning_inertia=np.diag([about_z, about_z, about_z]),
        tip=(ROD, 0, 0), tip_shapes=[[0, 0, 0, 1], [0, 0, 0, 0], [0, 0, 0, 0]],
    )  # fmt: skip


def beam_rod() -> FlexibleBeam:
    """The same rod from its dimensions and material."""
    section = Section.rectangle(EDGE, EDGE)
    return FlexibleBeam(ROD, section, youngs_modulus=MODULUS, density=DENSITY, bending=(2, 0), axial=2)


class SliderCrank(ac.System):
    """Crank, elastic rod and slider in the plane z = 0, without gravity."""

    def __init__(self, rod: Rod) -> None:
        self.world = World(gravity=(0, 0, 0))
        self.crank = RigidBody.rod(0.36, (CRANK, 0, 0))  # its turning is given, so that its inertia does not matter
        self.rod = rod
        self.slider = RigidBody.box(0.075552, (0.05, 0.03, 0.03))
        self.main, self.pin, self.wrist, self.guide = Revolute("z"), Revolute("z"), Revolute("z"), Prismatic("x")
        self.drive = AngleSource(SPEED * ac.time)
        for joint, one, two in (
            (self.main, self.world.frame, self.crank.frame),
            (self.pin, self.crank.tip, self.rod.frame_a),
            (self.wrist, self.rod.frame_b, self.slider.frame),
            (self.guide, self.world.frame, self.slider.frame),
        ):
            self.connect(one, joint.frame_a)
            self.connect(joint.frame_b, two)
        self.connect(self.main.flange, self.drive.flange)

    def simulate(self) -> Trajectory:
        """A tenth of a second from the published initial values: crank and rod along x."""
        return ac.build(self).simulate(
            0.1, {self.main.q: 0.0, self.pin.q: 0.0, self.rod.q: START_Q, self.rod.v: START_V}, rtol=1e-10
        )


def main(folder: str = "out") -> float:
    """Returns the largest error of the rod's angle [rad], the slider's place [m] and the amplitudes [m] at the end."""
    scene, real = SliderCrank(published_rod()), SliderCrank(beam_rod())
    run, other = scene.simulate(), real.simulate()
    print(run)
    found = np.column_stack([run[scene.main.q] + run[scene.pin.q], run[scene.guide.q], run[scene.rod.q]])[-1]
    error = np.abs(found - REFERENCE)
    print("errors of rod angle, slider and amplitudes:", np.array2string(error, precision=1))
    largest = 1e3 * np.max(np.abs(run[scene.rod.q]), axis=0)
    print(f"the rod bends by {largest[0]:.2f} mm and stretches by {largest[3]:.4f} mm")
    change = 1e3 * np.max(np.abs(other[real.rod.q] - run[scene.rod.q]), axis=0)
    print(f"the consistent mass matrix changes bending by {change[0]:.1e} mm and stretching by {change[3]:.1e} mm")
    run.plot(scene.rod.q, path=f"{folder}/flexible_slider_crank_amplitudes.png")
    run.picture(f"{folder}/flexible_slider_crank.png")
    run.animate(f"{folder}/flexible_slider_crank.html")
    return float(np.max(error))


if __name__ == "__main__":
    main()
