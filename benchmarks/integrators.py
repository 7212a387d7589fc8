"""Error against time for the planar double pendulum, 10 s, with every integrator; and from scene to first second."""

from __future__ import annotations

import statistics
import time

import acausal as ac
from benchmarks.chains import chain
from components import Revolute, RigidBody, World


def double_pendulum() -> ac.System:
    """Two uniform rods."""
    scene = ac.System()
    scene.world, scene.shoulder, scene.elbow = World(), Revolute("y"), Revolute("y")
    scene.upper, scene.lower = RigidBody.rod(1.0, (0, 0, -1)), RigidBody.rod(1.0, (0, 0, -1))
    scene.connect(scene.world.frame, scene.shoulder.frame_a)
    scene.connect(scene.shoulder.frame_b, scene.upper.frame)
    scene.connect(scene.upper.tip, scene.elbow.frame_a)
    scene.connect(scene.elbow.frame_b, scene.lower.frame)
    return scene


def mujoco_run(step: float) -> tuple[float, float]:
    """MuJoCo with its Runge-Kutta of order 4: angles at 10 s and the time it took."""
    import mujoco

    rod = '<body pos="0 0 {z}"><joint axis="0 1 0"/><inertial pos="0 0 -0.5" mass="1" diaginertia="0.0833333333333333 0.0833333333333333 1e-9"/>'
    text = rod.format(z=0) + rod.format(z=-1) + "</body></body>"
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler balanceinertia="true"/><option gravity="0 0 -9.81" integrator="RK4" timestep="{step}"><flag contact="disable"/></option><worldbody>{text}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qpos[:] = 0.6, 0.0
    start = time.perf_counter()
    for _ in range(round(10 / step)):
        mujoco.mj_step(model, data)
    return float(data.qpos[1]), time.perf_counter() - start


def run() -> None:
    """Print both tables."""
    scene = double_pendulum()
    model = ac.build(scene)
    start = {scene.shoulder.q: 0.6, scene.elbow.q: 0.0}
    exact = model.simulate(10.0, start, rtol=1e-14, atol=1e-14, method="gauss").solution.x[1, -1]
    print("\nPlanar double pendulum, 10 s: error of the elbow at the end [rad], and milliseconds (median of 5 runs, whole call)")
    for method, tolerances in (
        ("gauss", (1e-3, 1e-6, 1e-9, 1e-12)), ("radau", (1e-6, 1e-9, 1e-12)), ("cvodes", (1e-6, 1e-9, 1e-12)), ("idas", (1e-6, 1e-9)), ("rosenbrock", (1e-6, 1e-9)),
    ):  # fmt: skip
        for rtol in tolerances:
            seconds: list[float] = []
            for _ in range(5):
                began = time.perf_counter()
                run_ = model.simulate(10.0, start, rtol=rtol, method=method, samples=2)
                seconds.append(time.perf_counter() - began)
            error = abs(run_.solution.x[1, -1] - exact)
            print(f"  {method:<12} rtol {rtol:.0e}   error {error:.1e}   {1e3 * statistics.median(seconds):8.1f} ms")
    for step in (1e-3, 1e-4):
        angle, seconds_ = mujoco_run(step)
        print(f"  {'mujoco RK4':<12} step {step:.0e}   error {abs(angle - exact):.1e}   {1e3 * seconds_:8.1f} ms")
    print("\nFrom scene to the first simulated second (build, start values, one second at rtol 1e-6), milliseconds, no compiler")
    for count in (2, 20, 100):
        times: list[float] = []
        for _ in range(3):
            began = time.perf_counter()
            scene = double_pendulum() if count == 2 else chain(count)
            ac.build(scene).simulate(1.0, rtol=1e-6, samples=2)
            times.append(time.perf_counter() - began)
        print(f"  {count:>4} links {1e3 * statistics.median(times):8.1f} ms")
