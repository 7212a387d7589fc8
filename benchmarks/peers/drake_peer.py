"""Drake's MultibodyPlant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, final

import numpy as np

from benchmarks.peers.base import TOLERANCES, AbstractPeer, Prepared
from benchmarks.peers.equations import equations
from benchmarks.scenes import Built

_CONTINUOUS = ("runge_kutta3", "runge_kutta5", "radau3")
_LONGEST_STEP = 0.1  # Drake's default; with 10 s, runge_kutta5 does not come back
_CLOSED = ("four_bar", "andrews")
_STEPS = (1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000)


@final
class Drake(AbstractPeer):
    """Trees: continuous plants with Drake's error-controlled integrators. Loops: ball constraints, which only its discrete solver
    (SAP, fixed steps) takes. Its convex integrator (cenic) is of low order without contacts and takes no ball constraints."""

    name: ClassVar[str] = "drake"
    module: ClassVar[str] = "pydrake"

    def methods(self, scene: str) -> tuple[str, ...]:
        return ("discrete",) if scene in _CLOSED else _CONTINUOUS

    def refusal(self, scene: str) -> str:
        return "no rolling without slipping (no nonholonomic constraints)" if scene == "disk" else ""

    def settings(self, scene: str, method: str) -> tuple[float, ...]:
        end = 0.05 if scene == "andrews" else 10.0
        return tuple(end / n for n in _STEPS) if method == "discrete" else TOLERANCES

    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig

        name, end = built.scene.name, built.scene.end
        plant = MultibodyPlant(setting if method == "discrete" else 0.0)
        plant.mutable_gravity_field().set_gravity_vector([0, 0, 0 if name == "andrews" else -9.81])
        _MODELS[name](plant)
        plant.Finalize()
        simulator = Simulator(plant)
        if method != "discrete":
            config = SimulatorConfig(
                integration_scheme=method, max_step_size=_LONGEST_STEP, accuracy=setting, use_error_control=True
            )
            ApplySimulatorConfig(config, simulator)
        q, v = _starts(name)
        context = simulator.get_mutable_context()
        if name == "andrews":
            plant.get_actuation_input_port().FixValue(context, [0.033])

        def run() -> Any:
            context.SetTime(0.0)
            plant.SetPositionsAndVelocities(context, np.concatenate([q, v]))
            simulator.Initialize()
            simulator.AdvanceTo(end)
            return plant

        return Prepared(run, lambda _: _OBSERVED[name](plant, context))


def _link(plant: Any, name: str, mass: float, centre: tuple[float, ...], inertia: tuple[float, ...]) -> Any:
    """A body with its central principal moments."""
    from pydrake.multibody.tree import RotationalInertia, SpatialInertia

    about_centre = RotationalInertia(*inertia)
    return plant.AddRigidBody(name, SpatialInertia.MakeFromCentralInertia(mass, list(centre), about_centre))


def _hinge(plant: Any, parent: Any, place: tuple[float, float, float], child: Any, axis: str) -> Any:
    from pydrake.math import RigidTransform
    from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint

    direction = [float(axis == a) for a in "xyz"]
    frame = plant.AddFrame(FixedOffsetFrame(f"for {child.name()}", parent.body_frame(), RigidTransform(list(place))))
    return plant.AddJoint(RevoluteJoint(f"to {child.name()}", frame, child.body_frame(), direction))


def _double_pendulum(plant: Any) -> None:
    upper, lower = (_link(plant, n, 1.0, (0, 0, -0.5), (1 / 12, 1 / 12, 1e-9)) for n in ("upper", "lower"))
    _hinge(plant, plant.world_body(), (0, 0, 0), upper, "y")
    _hinge(plant, upper, (0, 0, -1), lower, "y")


def _top(plant: Any) -> None:
    from pydrake.multibody.tree import BallRpyJoint

    top = _link(plant, "top", 0.5, (0, 0, 0.05), (8e-4, 8e-4, 1e-3))
    plant.AddJoint(BallRpyJoint("socket", plant.world_frame(), top.body_frame()))


def _chain(plant: Any) -> None:
    parent, place = plant.world_body(), (0, 0, 0)
    for k in range(10):
        link = _link(plant, f"link{k}", 1.0, (0, 0, -0.5), (0.1, 0.2, 0.25))
        _hinge(plant, parent, place, link, "yx"[k % 2])
        parent, place = link, (0, 0, -1)


def _four_bar(plant: Any) -> None:
    crank, coupler, rocker = (
        _link(plant, name, mass, (length / 2, 0, 0), (1e-9, mass * length**2 / 12, mass * length**2 / 12))
        for name, mass, length in (("crank", 1.0, 0.4), ("coupler", 2.0, 1.2), ("rocker", 1.5, 0.8))
    )
    _hinge(plant, plant.world_body(), (0, 0, 0), crank, "y")
    _hinge(plant, crank, (0.4, 0, 0), coupler, "y")
    _hinge(plant, plant.world_body(), (1, 0, 0), rocker, "y")
    plant.AddBallConstraint(coupler, [1.2, 0, 0], rocker, [0.8, 0, 0])


def _andrews(plant: Any) -> None:
    from pydrake.multibody.tree import LinearSpringDamper

    data = (
        (0.04325, 2.194e-6, (0.00092, 0)), (0.00365, 4.41e-7, (-0.0115, 0)), (0.02373, 5.255e-6, (0.01043, -0.01874)),
        (0.00706, 5.667e-7, (0, 0.01421 - 0.02)), (0.0705, 1.169e-5, (0.02308, -0.00916)), (0.00706, 5.667e-7, (0.02 - 0.01421, 0)),
        (0.05498, 1.912e-5, (-0.00449, -0.01228)),
    )  # fmt: skip
    K1, K2, K3, K4, K5, K6, K7 = (
        _link(plant, f"K{k + 1}", mass, (*centre, 0), (moment / 2, moment / 2, moment))
        for k, (mass, moment, centre) in enumerate(data)
    )
    world, A = plant.world_body(), (-0.06934, -0.00227, 0)
    motor = _hinge(plant, world, (0, 0, 0), K1, "z")
    _hinge(plant, K1, (0.007, 0, 0), K2, "z")
    _hinge(plant, world, (-0.03635, 0.03273, 0), K3, "z")
    _hinge(plant, world, A, K5, "z")
    _hinge(plant, K5, (0.04, 0, 0), K4, "z")
    _hinge(plant, world, A, K7, "z")
    _hinge(plant, K7, (0, -0.04, 0), K6, "z")
    for body, point in ((K2, [-0.028, 0, 0]), (K4, [0, -0.02, 0]), (K6, [0.02, 0, 0])):
        plant.AddBallConstraint(K3, [0, -0.035, 0], body, point)
    plant.AddForceElement(LinearSpringDamper(K3, [0.02, -0.018, 0], world, [0.014, 0.072, 0], 0.07785, 4530.0, 0.0))
    plant.AddJointActuator("motor", motor)


def _spring_pendulum(plant: Any) -> None:
    from pydrake.multibody.tree import LinearSpringDamper, PrismaticJoint, SpatialInertia

    slider = plant.AddRigidBody("slider", SpatialInertia.Zero())
    bob = _link(plant, "bob", 1.0, (0, 0, 0), (1.0, 1.0, 1.0))
    plant.AddJoint(PrismaticJoint("x", plant.world_frame(), slider.body_frame(), [1, 0, 0]))
    plant.AddJoint(PrismaticJoint("z", slider.body_frame(), bob.body_frame(), [0, 0, 1]))
    plant.AddForceElement(LinearSpringDamper(plant.world_body(), [0, 0, 0], bob, [0, 0, 0], 1.0, 10000.0, 0.0))


_MODELS: dict[str, Callable[[Any], None]] = {
    "double_pendulum": _double_pendulum,
    "top": _top,
    "chain": _chain,
    "four_bar": _four_bar,
    "andrews": _andrews,
    "spring_pendulum": _spring_pendulum,
}


def _starts(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities in the order of the joints."""
    y = equations(name, np.float64).start().astype(float)
    if name == "double_pendulum":
        return np.array([0.6, 0.0]), np.zeros(2)
    if name == "top":  # roll, pitch, yaw; angular velocity in the world
        return np.array([0.4, 0.0, 0.0]), 60 * np.array([0.0, -np.sin(0.4), np.cos(0.4)])
    if name == "four_bar":  # angles lead from x to z, turns about y from z to x
        a, b, c, u, v, w = -y
        return np.array([a, b - a, c]), np.array([u, v - u, w])
    if name == "andrews":
        a = y[:7]
        return np.array([a[0], a[1] - a[0], a[2], a[4], a[3] - a[4], a[6], a[5] - a[6]]), np.zeros(7)
    if name == "spring_pendulum":
        return np.array([1.0, 0.0]), np.zeros(2)
    return y[:10], y[10:]


def _points(
    *points: tuple[str, tuple[float, float, float]], rows: tuple[int, ...] = (0, 1, 2)
) -> Callable[[Any, Any], np.ndarray]:
    def observed(plant: Any, context: Any) -> np.ndarray:
        poses = [plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name)) for name, _ in points]
        return np.concatenate([(X @ np.array(place))[list(rows)] for X, (_, place) in zip(poses, points, strict=True)])

    return observed


def _rotation(plant: Any, context: Any, name: str) -> np.ndarray:
    return plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name)).rotation().matrix()


def _andrews_directions(plant: Any, context: Any) -> np.ndarray:
    turned = [_rotation(plant, context, f"K{k}")[:2, 0] for k in range(1, 8)]
    return np.array(turned).T.ravel()


_OBSERVED: dict[str, Callable[[Any, Any], np.ndarray]] = {
    "double_pendulum": _points(("upper", (0, 0, -1)), ("lower", (0, 0, -1)), rows=(0, 2)),
    "top": lambda plant, context: _rotation(plant, context, "top").ravel(),
    "chain": _points(("link4", (0, 0, -1)), ("link9", (0, 0, -1))),
    "four_bar": _points(("crank", (0.4, 0, 0)), ("rocker", (0.8, 0, 0)), rows=(0, 2)),
    "andrews": _andrews_directions,
    "spring_pendulum": _points(("bob", (0, 0, 0)), rows=(0, 2)),
}
