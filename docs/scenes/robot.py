# Shows Robot, Mimic
import acausal as ac
from components import Robot, World

HAND = """
<robot name="hand">
  <link name="palm"/>
  <link name="wrist"><inertial><mass value="0.8"/><origin xyz="0 0 0.05"/><inertia ixx="1e-3" iyy="1e-3" izz="8e-4"/></inertial>
    <visual><origin xyz="0 0 0.05"/><geometry><box size="0.12 0.06 0.08"/></geometry></visual></link>
  <link name="left"><inertial><mass value="0.1"/><origin xyz="0 0 0.03"/><inertia ixx="4e-5" iyy="4e-5" izz="4e-6"/></inertial>
    <visual><origin xyz="0 0 0.03"/><geometry><box size="0.01 0.02 0.06"/></geometry></visual></link>
  <link name="right"><inertial><mass value="0.1"/><origin xyz="0 0 0.03"/><inertia ixx="4e-5" iyy="4e-5" izz="4e-6"/></inertial>
    <visual><origin xyz="0 0 0.03"/><geometry><box size="0.01 0.02 0.06"/></geometry></visual></link>
  <link name="tool"/>
  <joint name="turn" type="revolute"><parent link="palm"/><child link="wrist"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="10" velocity="4"/><dynamics damping="0.02"/></joint>
  <joint name="open" type="prismatic"><parent link="wrist"/><child link="left"/><origin xyz="0 0 0.09"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" effort="20" velocity="0.2"/></joint>
  <joint name="close" type="prismatic"><parent link="wrist"/><child link="right"/><origin xyz="0 0 0.09"/><axis xyz="1 0 0"/>
    <mimic joint="open" multiplier="-1"/></joint>
  <joint name="end" type="fixed"><parent link="wrist"/><child link="tool"/><origin xyz="0 0 0.15"/></joint>
</robot>
"""

scene = ac.System()
scene.world = World(gravity=(0, 0, -9.81))
scene.hand = Robot(HAND)
scene.connect(scene.world.frame, scene.hand.root)

model = ac.build(scene)
print(model)
run = model.simulate(0.6, start={scene.hand.joints["turn"].q: 2.0, scene.hand.joints["open"].q: 0.02})
print(run)
print(scene.hand.limits["turn"], run[scene.hand.frame("tool").position][-1])
run.picture("picture.png", times=(0.0, 0.3, 0.6))
