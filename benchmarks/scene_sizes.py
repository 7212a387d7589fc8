"""Sizes of scenes after reduction: states, rows of loops, operations, time to build; beside what others publish for the same ones.

python -m benchmarks.scene_sizes
"""

from __future__ import annotations

import importlib.util
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import acausal as ac
from benchmarks.chains import chain
from benchmarks.growth import four_bars
from components import TorqueSource
from examples.andrews import Andrews
from examples.bicycle import Bicycle
from examples.engine import Engine
from examples.four_bar import FourBar
from examples.gyroscopic import SpinningRotor
from examples.robot_r3 import Arm, Robot
from tests import modelica_scenes as modelica


@dataclass(frozen=True)
class Sized:
    """A scene, and what was published of it elsewhere."""

    name: str
    make: Callable[[], Any]
    published: str = ""


SCENES = (
    Sized("double pendulum", lambda: chain(2)),
    Sized("engine, one cylinder", lambda: Engine(gas=False)),
    Sized("engine, one cylinder, gas", Engine),
    Sized("engine V6", modelica.engine_v6, "6 nonlinear systems of 5, a linear one of about 40 [1]"),
    Sized("planar four-bar", lambda: four_bars(1), "2 states OpenModelica, 13 ModelingToolkit [2]"),
    Sized("planar four-bar, damper", modelica.planar_fourbar),
    Sized("four-bar, skewed plane", FourBar),
    Sized("spatial Fourbar1", modelica.fourbar1, "2 states + 7 Dymola [3]; 8 or 17 Multibody.jl [4]; 10 ModelingToolkit [5]"),
    Sized("spatial Fourbar2", modelica.fourbar2, "2 states + 1 Modelica [6]; 3 Multibody.jl [4]"),
    Sized("bar on a damped strut", modelica.line_force_with_two_masses),
    Sized("Andrews' mechanism", Andrews),
    Sized("rolling wheel", modelica.rolling_wheel, "8 OpenModelica, 14 ModelingToolkit [7]"),
    Sized("wheel set", modelica.rolling_wheel_set, "7 Modelica's own joint for it"),
    Sized("bicycle", Bicycle),
    Sized("rotor on a ball joint", SpinningRotor),
    Sized("bevel gear on a free body", modelica.bevel_gear),
    Sized("free body on springs", modelica.free_body, "13 Multibody.jl, a body on one spring [8]"),
    Sized("robot arm, 6 axes", Arm),
    Sized("robot with drives", Robot, "36 states Multibody.jl, of some 2000 equations [9]"),
)
SOURCES = """[1] Modelica Standard Library, documentation of Loops.EngineV6_analytic  [2] Multibody.jl, pull request 34
[3] its user's guide, cited in issue 2323 of ModelicaStandardLibrary (57 equations, 7 after tearing)  [4] Multibody.jl, docs, kinematic loops
(which joint is cut by hand decides)  [5] ModelingToolkit.jl, issue 4117  [6] documentation of Loops.Fourbar2  [7] ModelingToolkit.jl, issue 4237
[8] Multibody.jl, its tests  [9] Multibody.jl, docs, robot"""


def build_time(make: Callable[[], Any], repeat: int = 3) -> tuple[ac.Model, float]:
    """The model, and the median of the seconds of the processor to build it."""
    times: list[float] = []
    while True:
        scene = make()
        begin = time.process_time()
        model = ac.build(scene)
        times.append(time.process_time() - begin)
        if len(times) == repeat:
            return model, statistics.median(times)


def arm_against_pinocchio(samples: int = 50) -> tuple[float, float]:
    """Largest relative difference of the robot arm's accelerations, and of the torques for them, at random states."""
    import pinocchio as pin

    scene = Arm()
    scene.motors = [TorqueSource(ac.Input("N*m")) for _ in range(6)]
    for motor, joint in zip(scene.motors, scene.joints, strict=True):
        scene.connect(motor.flange, joint.flange)
    rates = ac.build(scene).functions.explicit_dynamics
    model, parent = pin.Model(), 0
    model.gravity.linear = np.array([0, -9.81, 0])
    places = ((0, 0.351, 0), (0, 0.324, 0.3), (0, 0.65, 0), (0, 0.414, -0.155), (0, 0.186, 0), (0, 0.125, 0))
    turns = {"x": pin.JointModelRX, "y": pin.JointModelRY}
    for k, (axis, place) in enumerate(zip("yxxyxy", places, strict=True)):
        parent = model.addJoint(parent, turns[axis](), pin.SE3(np.eye(3), np.array(place, dtype=float)), f"r{k}")
        for body in [scene.links[k]] + ([scene.load] if k == 5 else []):
            inertia = pin.Inertia(body.mass, np.array(body.centre_of_mass, dtype=float), np.array(body.central_inertia))
            model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    data, rng, worst = model.createData(), np.random.default_rng(1), [0.0, 0.0]
    for _ in range(samples):
        q, v, torque = rng.uniform(-3, 3, 6), rng.normal(size=6), 100 * rng.normal(size=6)
        ours = np.array(rates(0, np.concatenate([q, v]), torque, [])).ravel()[6:]
        theirs = pin.aba(model, data, q, v, torque)
        worst[0] = max(worst[0], float(np.max(np.abs(ours - theirs)) / np.max(np.abs(theirs))))
        worst[1] = max(worst[1], float(np.max(np.abs(pin.rnea(model, data, q, v, ours) - torque)) / np.max(np.abs(torque))))
    return worst[0], worst[1]


def run(scenes: Sequence[Sized] = SCENES) -> None:
    """Print the table."""
    print(
        "\nSizes after reduction; least: states of model.minimal(); rows: of loops, kept as invariants; published: unknowns of others"
    )
    print(f"{'':28}{'freedoms':>9}{'states':>7}{'least':>6}{'rows':>5}{'operations':>11}{'build ms':>9}  published")
    ac.build(chain(1))  # imports
    for scene in scenes:
        model, seconds = build_time(scene.make)
        rows = len(model.system.constraints.kept)
        least = len(model.minimal().state_names)
        counts = f"{model.degrees_of_freedom:>9}{model.system.x.numel():>7}{least:>6}{rows:>5}{model.operations:>11}"
        print(f"{scene.name:28}{counts}{1e3 * seconds:>9.1f}  {scene.published}".rstrip(), flush=True)
    print(SOURCES)
    if importlib.util.find_spec("pinocchio") is None:
        return
    accelerations, torques = arm_against_pinocchio()
    print(f"robot arm against Pinocchio at 50 random states: accelerations {accelerations:.0e}, torques {torques:.0e} (relative)")


if __name__ == "__main__":
    run()
