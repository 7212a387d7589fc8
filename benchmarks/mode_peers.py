"""Other programs on the scenes of `mode_scenes`: SciPy begun anew at every change, with textbook equations; MuJoCo and Drake, which step over changes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.mode_scenes import (
    BALL,
    BELT,
    HOLDING,
    MU,
    RESTITUTION,
    ROUGH,
    SLIDING,
    SLOPE,
    SPEED,
    STIFFNESS,
    THROWN,
    G,
    restarted_rocking,
)


@dataclass(frozen=True)
class Try:
    """One setting: `run()` gives the compared values; None if it gave up."""

    peer: str
    setting: str
    run: Callable[[], np.ndarray | None]


def _until(rates: Any, t: float, end: float, y: Any, event: Any, direction: float, method: str, rtol: float) -> Any:
    """To the event, or the end."""
    when = lambda t, y: event(y)  # noqa: E731
    when.terminal, when.direction = True, direction  # pyright: ignore[reportFunctionMemberAccess]
    return solve_ivp(rates, (t, end), y, method=method, rtol=rtol, atol=1e-3 * rtol, events=when)


def _scipy_bounce(end: float, method: str, rtol: float) -> np.ndarray:
    t, y = 0.0, np.array([1.0, 0.0])
    while t < end:
        run = _until(lambda t, y: (y[1], -G), t, end, y, lambda y: y[0], -1, method, rtol)
        t, y = run.t[-1], run.y[:, -1]
        if run.status == 1:
            y = np.array([0.0, -RESTITUTION * y[1]])
    return y[:1]


def _scipy_belt(end: float, method: str, rtol: float) -> np.ndarray:
    t, y, sticks = 0.0, np.array([0.0, BELT]), True
    while t < end:
        if sticks:
            run = _until(lambda t, y: (BELT, 0.0), t, end, y, lambda y: STIFFNESS * y[0] - HOLDING, 1, method, rtol)
        else:
            run = _until(lambda t, y: (y[1], SLIDING - STIFFNESS * y[0]), t, end, y, lambda y: y[1] - BELT, 1, method, rtol)
        t, y = run.t[-1], run.y[:, -1]
        if run.status == 1:
            y[1], sticks = BELT, not sticks
    return y[:1]


def _scipy_incline(end: float, method: str, rtol: float) -> np.ndarray:
    """Until the slip is as small as the tolerance: at zero its direction is none."""

    def rates(_: float, y: np.ndarray) -> tuple[float, ...]:
        s = math.hypot(y[2], y[3])
        rub = ROUGH * G * math.cos(SLOPE) / s
        return y[2], y[3], G * math.sin(SLOPE) - rub * y[2], -rub * y[3]

    run = _until(rates, 0.0, end, (0, 0, *SPEED), lambda y: math.hypot(y[2], y[3]) - rtol, -1, method, rtol)
    return np.array([*run.y[:2, -1], 0.0])


def _scipy_roll(end: float, method: str, rtol: float) -> np.ndarray:
    """Along its straight line: place, speed, turning."""
    slips = _until(lambda t, y: (y[1], -MU * G, 2.5 * MU * G / BALL), 0.0, end, (0, THROWN, 0), lambda y: y[1] - BALL * y[2], -1, method, rtol)  # fmt: skip
    far = slips.y[0, -1] + slips.y[1, -1] * (end - slips.t[-1])
    return np.array([0.6 * far, 0.8 * far, BALL])


_SCIPY: dict[str, Callable[[float, str, float], np.ndarray]] = {
    "bounce": _scipy_bounce,
    "belt": _scipy_belt,
    "incline": _scipy_incline,
    "roll": _scipy_roll,
    "rock": lambda end, method, rtol: np.array([restarted_rocking(end, method, rtol)]),
}


def scipy_tries(name: str, end: float) -> Iterator[Try]:
    """Loosest first."""
    if name in _SCIPY:
        methods = ("DOP853",) if name in ("bounce", "belt") else ("DOP853", "LSODA", "Radau")
        for method in methods:
            for rtol in (1e-6, 1e-9, 1e-12) if name not in ("bounce", "belt") else (1e-9,):
                yield Try("SciPy " + method, f"{rtol:.0e}", lambda m=method, r=rtol: _SCIPY[name](end, m, r))


_MUJOCO = {
    "incline": (
        f"{G * math.sin(SLOPE)!r} 0 {-G * math.cos(SLOPE)!r}", ROUGH,
        '<body pos="0 0 0.01"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>'
        '<geom type="sphere" size="0.01" mass="1"/></body>',
        lambda d: (np.array([0.0, 0, 0]), np.array([*SPEED, 0.0])), lambda d: d.qpos.copy(),
    ),
    "roll": (
        f"0 0 {-G!r}", MU, f'<body pos="0 0 {BALL}"><freejoint/><geom type="sphere" size="{BALL}" mass="0.7"/></body>',
        lambda d: (np.array([0, 0, BALL, 1, 0, 0, 0]), np.array([0.6 * THROWN, 0.8 * THROWN, 0, 0, 0, 0])), lambda d: d.qpos[:3].copy(),
    ),
    "box": (
        f"0 0 {-G!r}", 0.3, '<body pos="0 0 0.3"><freejoint/><geom type="box" size="0.2 0.15 0.1" mass="2"/></body>',
        lambda d: (np.array([0, 0, 0.3, 1, 0, 0, 0]), np.array([1, 0, 0, 0.5, 0.2, 1])), lambda d: d.qvel[:3].copy(),
    ),
}  # fmt: skip


def mujoco_tries(name: str, end: float) -> Iterator[Try]:
    """Elliptic cones, as hard as a step allows; with and without its iteration against slip."""
    import mujoco

    if name not in _MUJOCO:
        return
    gravity, mu, body, start, seen = _MUJOCO[name]
    for noslip in (0, 20):
        for count in (1000, 10_000, 100_000, 1_000_000):
            step = end / count
            text = (
                f'<mujoco><option gravity="{gravity}" timestep="{step!r}" cone="elliptic" impratio="100" noslip_iterations="{noslip}" iterations="100" tolerance="1e-14"'
                f' integrator="implicitfast"/><default><geom condim="3" friction="{mu} 0 0" solref="{2 * step!r} 1" solimp="0.9999 0.9999 1e-6"/></default>'
                f'<worldbody><geom type="plane" size="9 9 1"/>{body}</worldbody></mujoco>'
            )
            model = mujoco.MjModel.from_xml_string(text)
            data = mujoco.MjData(model)

            def run(model: Any = model, data: Any = data, count: int = count) -> np.ndarray:
                mujoco.mj_resetData(model, data)
                data.qpos[:], data.qvel[:] = start(data)
                mujoco.mj_step(model, data, count)
                return seen(data)

            yield Try("MuJoCo" + (" noslip" if noslip else ""), f"{step:.0e} s", run)


def drake_tries(name: str, end: float) -> Iterator[Try]:
    """Discrete steps, both of its contact solvers, contacts of 1e8 N/m."""
    from pydrake.geometry import AddContactMaterial, Box, HalfSpace, ProximityProperties, Sphere
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, DiscreteContactApproximation
    from pydrake.multibody.tree import SpatialInertia, UnitInertia
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder

    if name not in _MUJOCO:
        return
    shape: Any = {"incline": Sphere(0.01), "roll": Sphere(BALL), "box": Box(0.4, 0.3, 0.2)}[name]
    mass = {"incline": 1.0, "roll": 0.7, "box": 2.0}[name]
    unit = {
        "incline": UnitInertia(1e6, 1e6, 1e6),
        "roll": UnitInertia.SolidSphere(BALL),
        "box": UnitInertia.SolidBox(0.4, 0.3, 0.2),
    }[name]
    mu = {"incline": ROUGH, "roll": MU, "box": 0.3}[name]
    height = {"incline": 0.01, "roll": BALL, "box": 0.3}[name]
    for solver in (DiscreteContactApproximation.kSap, DiscreteContactApproximation.kSimilar):
        for count in (300, 3000, 30_000):
            builder = DiagramBuilder()
            plant, _ = AddMultibodyPlantSceneGraph(builder, end / count)
            plant.set_discrete_contact_approximation(solver)
            body = plant.AddRigidBody("body", SpatialInertia(mass, np.zeros(3), unit))
            material = ProximityProperties()
            AddContactMaterial(0.0, 1e8, CoulombFriction(mu, mu), material)
            plant.RegisterCollisionGeometry(body, RigidTransform(), shape, "shape", material)
            plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "floor", material)
            tilt = SLOPE if name == "incline" else 0.0
            plant.mutable_gravity_field().set_gravity_vector([G * math.sin(tilt), 0, -G * math.cos(tilt)])
            plant.Finalize()
            simulator = Simulator(builder.Build())
            context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
            v = {
                "incline": (0, 0, 0, *SPEED, 0),
                "roll": (0, 0, 0, 0.6 * THROWN, 0.8 * THROWN, 0),
                "box": (0.5, 0.2, 1, 1, 0, 0),
            }[name]

            def run(simulator: Any = simulator, plant: Any = plant, context: Any = context, v: Any = v) -> np.ndarray:
                plant.SetPositions(context, [1, 0, 0, 0, 0, 0, height])
                plant.SetVelocities(context, v)
                simulator.get_mutable_context().SetTime(0.0)
                simulator.Initialize()
                simulator.AdvanceTo(end)
                if name == "box":
                    return plant.GetVelocities(context)[3:].copy()
                place = plant.GetPositions(context)[4:].copy()
                return place - [0, 0, height] if name == "incline" else place

            yield Try(f"Drake {'SAP' if solver == DiscreteContactApproximation.kSap else 'similar'}", f"{end / count:.0e} s", run)
