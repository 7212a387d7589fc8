"""Slider-crank over a cycle: the torque of least effort that keeps a press turning.

Every turn is like the one before. The loop is closed at each node, and the mean speed is given; the slider works against a damper.

    python examples/control/slider_crank_cycle.py
"""

import numpy as np

import acausal as ac
from components import Prismatic, Revolute, RigidBody, TorqueSource, TranslationalDamper, TranslationalGround, World

LIMIT = 1e-6  # of what main returns


def main(folder: str = "out") -> float:
    """Find the cycle; returns by how much it is off when simulated, relative to what each state varies by."""
    scene = ac.System()
    scene.torque = ac.Input("N m")
    scene.world = World(gravity=(0, 0, -9.81))
    scene.crank, scene.pin, scene.wrist, scene.guide = Revolute("y"), Revolute("y"), Revolute("y"), Prismatic("x")
    scene.arm, scene.rod, scene.slider = (
        RigidBody.rod(1.0, (0.15, 0, 0)),
        RigidBody.rod(1.0, (0.5, 0, 0)),
        RigidBody.box(2.0, (0.1, 0.1, 0.08)),
    )
    scene.motor, scene.work, scene.ground = TorqueSource(scene.torque), TranslationalDamper(40.0), TranslationalGround()
    scene.connect(scene.world.frame, scene.crank.frame_a, scene.guide.frame_a)
    scene.connect(scene.crank.frame_b, scene.arm.frame)
    scene.connect(scene.arm.tip, scene.pin.frame_a)
    scene.connect(scene.pin.frame_b, scene.rod.frame)
    scene.connect(scene.rod.tip, scene.wrist.frame_a)
    scene.connect(scene.wrist.frame_b, scene.slider.frame)
    scene.connect(scene.guide.frame_b, scene.slider.frame)
    scene.connect(scene.motor.flange, scene.crank.flange)
    scene.connect(scene.ground.flange, scene.work.flange_a)
    scene.connect(scene.work.flange_b, scene.guide.flange)
    model = ac.build(scene)
    print(model)
    turn = ac.OptimalControl(model, time=0.5)
    turn.start({scene.crank.q: 0.0, scene.crank.v: ac.free(2, 40, 12)})
    turn.periodic(turns={scene.crank.q: 1})
    turn.bound(ac.norm(scene.wrist.frame_b.force), upper=120.0)
    turn.minimise(ac.integral(scene.torque**2))
    best = turn.solve(24, tolerance=1e-9)
    print(best)
    invariants = model.functions.invariants
    assert invariants is not None
    gap = max(float(np.max(np.abs(np.array(invariants(t, x, 0, []))))) for t, x in zip(best.t, best.x.T, strict=True))
    print(
        f"the loop is closed to {gap:.0e} m; the wrist pin carries up to {np.max(np.linalg.norm(best.run[scene.wrist.frame_b.force], axis=1)):.1f} N"
    )
    best.run.picture(f"{folder}/slider_crank_cycle.png", times=(0.0, 0.17, 0.33))
    best.run.animate(f"{folder}/slider_crank_cycle.html", speed=0.5)
    return best.replay_error + gap


if __name__ == "__main__":
    main()
