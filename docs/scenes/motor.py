# Shows ElectromotiveForce, Inductor, CurrentSensor
import acausal as ac
from components import (
    CurrentSensor,
    ElectromotiveForce,
    Ground,
    Inductor,
    Inertia,
    Resistor,
    RotationalDamper,
    RotationalGround,
    VoltageSource,
)

scene = ac.System()
scene.battery, scene.ground = VoltageSource(12.0), Ground()
scene.coil, scene.winding, scene.hall, scene.emf = Resistor(0.5), Inductor(2e-3), CurrentSensor(), ElectromotiveForce(0.05)
scene.rotor, scene.bearing, scene.housing = Inertia(1e-4), RotationalDamper(damping=1e-4), RotationalGround()
scene.connect(scene.battery.pin_a, scene.coil.pin_a)
scene.connect(scene.coil.pin_b, scene.winding.pin_a)
scene.connect(scene.winding.pin_b, scene.hall.pin_a)
scene.connect(scene.hall.pin_b, scene.emf.pin_a)
scene.connect(scene.emf.pin_b, scene.battery.pin_b, scene.ground.pin)
scene.connect(scene.emf.flange, scene.rotor.flange_a)
scene.connect(scene.rotor.flange_b, scene.bearing.flange_a)
scene.connect(scene.bearing.flange_b, scene.housing.flange)

model = ac.build(scene)
print(model)
run = model.simulate(0.15)
print(run)
run.plot(scene.rotor.w, scene.hall.current.value, path="picture.png")
