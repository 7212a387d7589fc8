"""A robot on four legs: described by a URDF file and dropped to a floor, its motors hold a posture like springs with dampers, its feet strike, slip and stick.

At the end it stands: the floor carries its weight. All the while the balance of energy is closed, through impacts, friction and motors.
"""

import numpy as np

import acausal as ac
from components import Contact, Coulomb, Hard, Plane, Robot, Sphere, TorqueSource, World

LIMIT = 1e-8  # of what main returns

FOOT, G = 0.02, 9.81
POSTURE = {"hip": 0.0, "thigh": 0.8, "knee": -1.6}  # rad
STIFFNESS, DAMPING = 80.0, 2.0  # N*m/rad, N*m*s/rad

LEG = """
<link name="{leg}_hip"><inertial><mass value="0.6"/><inertia ixx="5e-4" iyy="6e-4" izz="5e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{leg}_hip" type="revolute"><parent link="trunk"/><child link="{leg}_hip"/><origin xyz="{x} {y} 0"/><axis xyz="1 0 0"/>
  <limit lower="-0.8" upper="0.8" effort="24" velocity="30"/></joint>
<link name="{leg}_thigh"><inertial><origin xyz="0 0 -0.08"/><mass value="0.9"/><inertia ixx="3e-3" iyy="3e-3" izz="6e-4" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><origin xyz="0 0 -0.1"/><geometry><box size="0.04 0.03 0.2"/></geometry></visual></link>
<joint name="{leg}_thigh" type="revolute"><parent link="{leg}_hip"/><child link="{leg}_thigh"/><origin xyz="0 {out} 0"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="3" effort="24" velocity="30"/></joint>
<link name="{leg}_shank"><inertial><origin xyz="0 0 -0.1"/><mass value="0.2"/><inertia ixx="9e-4" iyy="9e-4" izz="3e-5" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><origin xyz="0 0 -0.1"/><geometry><cylinder radius="0.012" length="0.2"/></geometry></visual></link>
<joint name="{leg}_knee" type="revolute"><parent link="{leg}_thigh"/><child link="{leg}_shank"/><origin xyz="0 0 -0.2"/><axis xyz="0 1 0"/>
  <limit lower="-2.7" upper="-0.6" effort="36" velocity="20"/></joint>
<link name="{leg}_foot"/>
<joint name="{leg}_foot" type="fixed"><parent link="{leg}_shank"/><child link="{leg}_foot"/><origin xyz="0 0 -0.2"/></joint>
"""
TRUNK = """
<robot name="quadruped"><link name="trunk"><inertial><mass value="5"/><inertia ixx="0.02" iyy="0.06" izz="0.07" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><box size="0.4 0.2 0.1"/></geometry></visual></link>{legs}</robot>
"""
LEGS = {"front_left": (0.19, 0.05), "front_right": (0.19, -0.05), "hind_left": (-0.19, 0.05), "hind_right": (-0.19, -0.05)}


def main(folder: str = "out") -> float:
    """Nine seconds; returns what is missing in the balance of energy and between what the floor carries and the weight, the larger part."""
    scene = ac.System()
    scene.world = World(gravity=(0, 0, -G))
    legs = "".join(LEG.format(leg=leg, x=x, y=y, out=0.08 * np.sign(y)) for leg, (x, y) in LEGS.items())
    scene.dog = Robot(TRUNK.format(legs=legs))
    scene.feet = {leg: Contact(Sphere(FOOT), Plane(), Hard(0.0, Coulomb(0.6))) for leg in LEGS}
    for leg, foot in scene.feet.items():
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(scene.dog.frame(f"{leg}_foot"), foot.frame_b)
    wanted = {name: POSTURE[name.split("_")[-1]] for name in scene.dog.joints}
    scene.motors = {
        name: TorqueSource(STIFFNESS * (wanted[name] - joint.q) - DAMPING * joint.v) for name, joint in scene.dog.joints.items()
    }
    for name, motor in scene.motors.items():
        scene.connect(motor.flange, scene.dog.joints[name].flange)

    model = ac.build(scene)
    print(model)
    trunk = scene.dog.root
    start = {scene.dog.joints[name].q: angle for name, angle in wanted.items()}
    start |= {trunk.position: (0, 0, 0.45), trunk.velocity: (0.5, 0.2, 0), trunk.rotation: ("y", 0.1)}
    run = model.simulate(9.0, start, rtol=1e-10)
    carried = sum(run[foot.normal_force] for foot in scene.feet.values())
    weight = G * sum(float(link.mass) for link in scene.dog.links.values())
    off = max(run.energy_error(), abs(carried[-1] - weight) / weight)
    print(run)
    print(
        f"{len(run.transitions)} transitions; lands at {run.transitions[0].time:.3f} s, stands from {run.transitions[-1].time:.2f} s on"
    )
    print(
        f"energy and the weight that is carried are {off:.0e} off; pushes of the feet {[f'{run[foot.normal_force][-1]:.1f} N' for foot in scene.feet.values()]}"
    )
    run.picture(f"{folder}/quadruped.png", times=(0.0, 0.15, 0.25, 9.0))
    run.animate(f"{folder}/quadruped.html")
    return off


if __name__ == "__main__":
    main()
