"""A Stewart platform: six legs that change their length carry a plate in all six directions.

The legs follow given lengths, those of a plate that heaves, sways and rolls. To find them from the plate's motion is easy; the simulation goes the other
way, from the lengths to the plate, and meets the motion that they were made from. D. Stewart, Proc. Institution of Mechanical Engineers 180 (1965).
"""

from functools import partial

import casadi as ca
import numpy as np

import acausal as ac
from components import PositionSource, Prismatic, RigidBody, Spherical, Universal, World

LIMIT = 1e-9  # of what main returns

FEET = [(np.cos(a), np.sin(a), 0.0) for a in np.radians([-10, 10, 110, 130, 230, 250])]
CORNERS = [(0.6 * np.cos(a), 0.6 * np.sin(a), 0.0) for a in np.radians([-50, 50, 70, 170, 190, 290])]


def plate(t: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The place (3,) and the rotation (3, 3) of the plate that the legs are made for."""
    roll = 0.15 * ca.sin(2 * t)
    R = ca.vertcat(ca.horzcat(1, 0, 0), ca.horzcat(0, ca.cos(roll), -ca.sin(roll)), ca.horzcat(0, ca.sin(roll), ca.cos(roll)))
    return ca.vertcat(0.1 * ca.sin(t), 0, 1.0 + 0.1 * ca.cos(2 * t)), R


def main(folder: str = "out") -> float:
    """Six seconds; returns the largest difference from the plate's motion."""
    p0, _ = (np.array(ca.DM(ca.evalf(x))) for x in plate(ca.SX(0)))
    scene = ac.System()
    scene.world = World()
    scene.plate = RigidBody.cylinder(20.0, 0.6, 0.05, position=p0.ravel())
    scene.cylinders, scene.pistons, scene.feet, scene.guides, scene.balls, scene.drives = [], [], [], [], [], []
    for foot, corner in zip(FEET, CORNERS, strict=True):
        a, b = np.array(foot), p0.ravel() + corner
        along = (b - a) / np.linalg.norm(b - a)
        side = np.cross(along, (0, 0, 1.0)) / np.linalg.norm(np.cross(along, (0, 0, 1.0)))
        cylinder = RigidBody.rod(3.0, 0.5 * along, 0.04, position=a)
        piston = RigidBody.rod(1.0, -0.85 * along, 0.02, position=b)
        guide = Prismatic.between(cylinder, piston, at=b, axis=along)
        drive = PositionSource(partial(_stroke, a, np.array(corner)))
        scene.cylinders.append(cylinder)
        scene.pistons.append(piston)
        scene.guides.append(guide)
        scene.drives.append(drive)
        scene.feet.append(Universal.between(scene.world, cylinder, at=a, axis_a=side, axis_b=np.cross(side, along)))
        scene.balls.append(Spherical.between(scene.plate, piston, at=b))
        scene.connect(guide.flange, drive.flange)

    model = ac.build(scene)
    print(model)
    run = model.simulate(6.0, rtol=1e-10)
    t = ca.SX.sym("t")
    p, R = (np.array(f) for f in ca.Function("plate", [t], plate(t)).map(run.t.size)(run.t))
    off = float(np.max(np.abs(run[scene.plate.frame.position] - p.T)))
    turned = float(np.max(np.abs(run[scene.plate.frame.rotation] - R.reshape(3, -1, 3).transpose(1, 0, 2))))
    push = np.stack([run[drive.flange.f] for drive in scene.drives])
    print(run)
    print(
        f"plate where the lengths put it to {off:.0e} m and {turned:.0e}; the legs push with {-push.max():.0f} to {-push.min():.0f} N"
    )
    run.picture(f"{folder}/stewart_platform.png", times=(0.0, 0.8))
    run.animate(f"{folder}/stewart_platform.html")
    return max(off, turned)


def _stroke(foot: np.ndarray, corner: np.ndarray, t: ca.SX) -> ca.SX:
    """How much longer the leg is than at the start [m]."""
    lengths = [ca.norm_2(p + R @ corner - foot) for p, R in (plate(t), plate(ca.SX(0)))]
    return lengths[0] - lengths[1]


if __name__ == "__main__":
    main()
