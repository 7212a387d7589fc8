"""Exudyn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, final

import numpy as np

from benchmarks.peers.base import TOLERANCES, AbstractPeer, Prepared
from benchmarks.peers.equations import equations, rotation
from benchmarks.scenes import Built

_ADAPTIVE, _EXPLICIT, _IMPLICIT = ("DOPRI5",), ("RK67",), ("GeneralizedAlpha", "TrapezoidalIndex2")
_STEPS = (100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000)


@final
class Exudyn(AbstractPeer):
    """Trees as its kinematic tree, with explicit methods; loops and rolling as redundant coordinates, with the implicit ones.
    Tolerances below 1e-11 are left out: its step control can stand still there."""

    name: ClassVar[str] = "exudyn"
    module: ClassVar[str] = "exudyn"

    def methods(self, scene: str) -> tuple[str, ...]:
        return _IMPLICIT if scene in ("four_bar", "andrews", "disk") else _ADAPTIVE + _EXPLICIT + _IMPLICIT[:1]

    def refusal(self, scene: str) -> str:
        return ""

    def settings(self, scene: str, method: str) -> tuple[float, ...]:
        end = 0.05 if scene == "andrews" else 5.0 if scene == "chain" else 10.0
        return TOLERANCES[:-2] if method in _ADAPTIVE else tuple(end / n for n in _STEPS)

    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        import exudyn as exu

        container = exu.SystemContainer()
        system = container.AddSystem()
        observed = _MODELS[built.scene.name](exu, system)
        system.Assemble()
        settings = _settings(exu, built.scene.end, method, setting)
        solver = getattr(exu.DynamicSolverType, method)

        def run() -> Any:
            try:  # from the initial values each time
                return container if system.SolveDynamic(settings, solverType=solver, storeSolver=False) else None
            except (RuntimeError, ValueError):  # Exudyn's ways to say that the integrator gave up
                return None

        return Prepared(run, lambda _: observed())


def _settings(exu: Any, end: float, method: str, setting: float) -> Any:
    settings = exu.SimulationSettings()
    settings.solutionSettings.writeSolutionToFile = False
    settings.parallel.numberOfThreads = 1
    steps = settings.timeIntegration
    steps.endTime = end
    steps.verboseMode = 0
    if method in _ADAPTIVE:
        steps.numberOfSteps = 100  # the longest step
        steps.initialStepSize = 1e-4 * end
        steps.absoluteTolerance = steps.relativeTolerance = setting
        steps.minimumStepSize = 1e-7 * end  # once there, it stays there
    else:
        steps.numberOfSteps = round(end / setting)
        steps.automaticStepSize = steps.adaptiveStep = False
        steps.newton.relativeTolerance = 1e-10
        steps.newton.absoluteTolerance = 1e-12
    return settings


Observed = Callable[[], np.ndarray]


def _tree(
    exu: Any, system: Any, types: list[Any], offsets: list[Any], bodies: list[Any], start: tuple[np.ndarray, np.ndarray]
) -> Any:
    """A serial kinematic tree; bodies as (mass, centre, principal moments). Returns a function that gives its coordinates."""
    from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree

    n = len(types)
    q, v = start
    node = system.AddNode(
        NodeGenericODE2(referenceCoordinates=[0.0] * n, initialCoordinates=q, initialCoordinates_t=v, numberOfODE2Coordinates=n)
    )
    inertias, centres = exu.Matrix3DList(), exu.Vector3DList()
    places, turns = exu.Vector3DList(), exu.Matrix3DList()
    for offset, (_, centre, moments) in zip(offsets, bodies, strict=True):
        inertias.Append(np.diag(moments))
        centres.Append(centre)
        places.Append(offset)
        turns.Append(np.eye(3))
    system.AddObject(
        ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=types,
            linkParents=list(range(-1, n - 1)),
            jointTransformations=turns,
            jointOffsets=places,
            linkInertiasCOM=inertias,
            linkCOMs=centres,
            linkMasses=[mass for mass, _, _ in bodies],
            gravity=[0, 0, -9.81],
        )
    )
    return lambda: np.array(system.GetNodeOutput(node, exu.OutputVariableType.Coordinates))


def _double_pendulum(exu: Any, system: Any) -> Observed:
    rod = (1.0, [0, 0, -0.5], [1 / 12, 1 / 12, 0.0])
    y = exu.JointType.RevoluteY
    angles = _tree(exu, system, [y, y], [[0, 0, 0], [0, 0, -1]], [rod, rod], (np.array([0.6, 0.0]), np.zeros(2)))

    def observed() -> np.ndarray:
        upper, lower = np.cumsum(angles())
        elbow = -np.array([np.sin(upper), np.cos(upper)])
        return np.concatenate([elbow, elbow - np.array([np.sin(lower), np.cos(lower)])])

    return observed


def _top(exu: Any, system: Any) -> Observed:
    types = [exu.JointType.RevoluteX, exu.JointType.RevoluteY, exu.JointType.RevoluteZ]
    nothing, body = (0.0, [0, 0, 0], [0, 0, 0]), (0.5, [0, 0, 0.05], [8e-4, 8e-4, 1e-3])
    start = (np.array([0.4, 0.0, 0.0]), np.array([0.0, 0.0, 60.0]))
    angles = _tree(exu, system, types, [[0, 0, 0]] * 3, [nothing, nothing, body], start)

    def observed() -> np.ndarray:
        R = np.eye(3)
        for axis, angle in zip(np.eye(3), angles(), strict=True):
            R = R @ rotation(np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)]), np)
        return R.ravel()

    return observed


def _chain(exu: Any, system: Any) -> Observed:
    by_hand = equations("chain", np.float64)
    start = by_hand.start()
    types = [exu.JointType.RevoluteX if k % 2 else exu.JointType.RevoluteY for k in range(10)]
    offsets = [[0, 0, -1 if k else 0] for k in range(10)]
    angles = _tree(exu, system, types, offsets, [(1.0, [0, 0, -0.5], [0.1, 0.2, 0.25])] * 10, (start[:10], start[10:]))
    return lambda: by_hand.observed(angles())


def _planar(
    system: Any, mass: float, moment: float, centre: complex, angle: float, velocity: complex = 0.0, rate: float = 0.0
) -> int:
    """A body in x and y, its node at its centre of mass."""
    from exudyn.itemInterface import NodeRigidBody2D, ObjectRigidBody2D

    node = system.AddNode(
        NodeRigidBody2D(
            initialCoordinates=[centre.real, centre.imag, angle], initialVelocities=[velocity.real, velocity.imag, rate]
        )
    )
    return system.AddObject(ObjectRigidBody2D(mass=mass, inertia=moment, nodeNumber=node))


def _marker(system: Any, body: int, place: tuple[float, ...]) -> int:
    from exudyn.itemInterface import MarkerBodyPosition

    return system.AddMarker(MarkerBodyPosition(bodyNumber=body, localPosition=[place[0], place[1], 0]))


def _pin(system: Any, body_a: int, place_a: tuple[float, ...], body_b: int, place_b: tuple[float, ...]) -> None:
    from exudyn.itemInterface import ObjectJointRevolute2D

    markers = [_marker(system, body_a, place_a), _marker(system, body_b, place_b)]
    system.AddObject(ObjectJointRevolute2D(markerNumbers=markers))


def _four_bar(exu: Any, system: Any) -> Observed:
    """In x and y, instead of x and z."""
    from exudyn.itemInterface import LoadMassProportional, MarkerBodyMass, ObjectGround

    a, b, c, u, v, w = equations("four_bar", np.float64).start().astype(float)
    crank_tip, crank_speed = 0.4 * np.exp(1j * a), 0.4j * u * np.exp(1j * a)
    half = 0.6 * np.exp(1j * b)
    crank = _planar(system, 1.0, 0.16 / 12, crank_tip / 2, a, crank_speed / 2, u)
    coupler = _planar(system, 2.0, 2.88 / 12, crank_tip + half, b, crank_speed + 1j * v * half, v)
    rocker = _planar(system, 1.5, 0.96 / 12, 1 + 0.4 * np.exp(1j * c), c, 0.4j * w * np.exp(1j * c), w)
    ground = system.AddObject(ObjectGround())
    for body in (crank, coupler, rocker):
        marker = system.AddMarker(MarkerBodyMass(bodyNumber=body))
        system.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=[0, -9.81, 0]))
    _pin(system, ground, (0, 0), crank, (-0.2, 0))
    _pin(system, crank, (0.2, 0), coupler, (-0.6, 0))
    _pin(system, coupler, (0.6, 0), rocker, (0.4, 0))
    _pin(system, ground, (1, 0), rocker, (-0.4, 0))

    def observed() -> np.ndarray:
        place = exu.OutputVariableType.Position
        tips = (system.GetObjectOutputBody(body, place, [x, 0, 0]) for body, x in ((crank, 0.2), (rocker, 0.4)))
        return np.concatenate([tip[:2] for tip in tips])

    return observed


_LINKS = (  # of Andrews' mechanism: mass, moment, centre of mass from the first hinge
    (0.04325, 2.194e-6, 0.00092), (0.00365, 4.41e-7, -0.0115), (0.02373, 5.255e-6, 0.01043 - 0.01874j), (0.00706, 5.667e-7, -0.00579j),
    (0.0705, 1.169e-5, 0.02308 - 0.00916j), (0.00706, 5.667e-7, 0.00579), (0.05498, 1.912e-5, -0.00449 - 0.01228j),
)  # fmt: skip


def _andrews(exu: Any, system: Any) -> Observed:
    from exudyn.itemInterface import LoadTorqueVector, MarkerBodyRigid, ObjectConnectorSpringDamper, ObjectGround

    angles = equations("andrews", np.float64).start().astype(float)[:7]
    turn = np.exp(1j * angles)
    A, B = -0.06934 - 0.00227j, -0.03635 + 0.03273j
    hinges = (0j, 0.007 * turn[0], B, A + 0.04 * turn[4], A, A - 0.04j * turn[6], A)
    K = [
        _planar(system, mass, moment, hinge + centre * t, angle)
        for (mass, moment, centre), hinge, t, angle in zip(_LINKS, hinges, turn, angles, strict=True)
    ]
    ground = system.AddObject(ObjectGround())

    def at(k: int, place: complex) -> tuple[int, tuple[float, float]]:
        """A point of body k (from 1) given from its first hinge."""
        from_centre = place - _LINKS[k - 1][2]
        return K[k - 1], (from_centre.real, from_centre.imag)

    def fixed(place: complex) -> tuple[int, tuple[float, float]]:
        return ground, (place.real, place.imag)

    E = at(3, -0.035j)
    for one, two in (
        (fixed(0j), at(1, 0)), (at(1, 0.007), at(2, 0)), (fixed(B), at(3, 0)), (fixed(A), at(5, 0)), (fixed(A), at(7, 0)),
        (at(5, 0.04), at(4, 0)), (at(7, -0.04j), at(6, 0)), (E, at(2, -0.028)), (E, at(4, -0.02j)), (E, at(6, 0.02)),
    ):  # fmt: skip
        _pin(system, *one, *two)
    ends = [_marker(system, *at(3, 0.02 - 0.018j)), _marker(system, *fixed(0.014 + 0.072j))]
    system.AddObject(ObjectConnectorSpringDamper(markerNumbers=ends, referenceLength=0.07785, stiffness=4530.0))
    motor = system.AddMarker(MarkerBodyRigid(bodyNumber=K[0], localPosition=[0, 0, 0]))
    system.AddLoad(LoadTorqueVector(markerNumber=motor, loadVector=[0, 0, 0.033]))

    def observed() -> np.ndarray:
        turned = (system.GetObjectOutputBody(body, exu.OutputVariableType.RotationMatrix, [0, 0, 0]) for body in K)
        return np.array([[R[0], R[3]] for R in turned]).T.ravel()

    return observed


def _disk(exu: Any, system: Any) -> Observed:
    """Its axis is x of the body here: a quarter turn about z from the scene's frame."""
    from exudyn.itemInterface import (
        LoadMassProportional,
        MarkerBodyMass,
        MarkerBodyRigid,
        NodeRigidBodyEP,
        ObjectGround,
        ObjectJointRollingDisc,
        ObjectRigidBody,
    )  # fmt: skip
    from exudyn.utilities import AngularVelocity2EulerParameters_t, RotationMatrix2EulerParameters

    y = equations("disk", np.float64).start().astype(float)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    R = rotation(y[:4], np)
    w = R @ y[4:7]
    centre = 0.05 * R[:, 2]  # upright but for the lean: the contact is opposite to z of the disk
    parameters = RotationMatrix2EulerParameters(R @ quarter)
    node = system.AddNode(
        NodeRigidBodyEP(
            referenceCoordinates=[0, 0, centre[2], *parameters],
            initialVelocities=[*np.cross(w, centre), *AngularVelocity2EulerParameters_t(w, parameters)],
        )
    )
    m, r = 0.01, 0.05
    moments = m * r * r * np.array([0.5, 0.25, 0.25])
    body = system.AddObject(ObjectRigidBody(mass=m, inertia=[*moments, 0, 0, 0], nodeNumber=node))
    system.AddLoad(LoadMassProportional(markerNumber=system.AddMarker(MarkerBodyMass(bodyNumber=body)), loadVector=[0, 0, -9.81]))
    ground = system.AddObject(ObjectGround())
    markers = [system.AddMarker(MarkerBodyRigid(bodyNumber=number, localPosition=[0, 0, 0])) for number in (ground, body)]
    system.AddObject(ObjectJointRollingDisc(markerNumbers=markers, discRadius=r, discAxis=[1, 0, 0]))

    def observed() -> np.ndarray:
        place = system.GetNodeOutput(node, exu.OutputVariableType.Position)
        turned = np.array(system.GetNodeOutput(node, exu.OutputVariableType.RotationMatrix)).reshape(3, 3)
        return np.concatenate([place, (turned @ quarter.T).ravel()])

    return observed


def _spring_pendulum(exu: Any, system: Any) -> Observed:
    """In x and y, instead of x and z."""
    from exudyn.itemInterface import (
        LoadForceVector,
        MarkerNodePosition,
        NodePoint2D,
        NodePointGround,
        ObjectConnectorSpringDamper,
        ObjectMassPoint2D,
    )  # fmt: skip

    node = system.AddNode(NodePoint2D(referenceCoordinates=[1, 0]))
    system.AddObject(ObjectMassPoint2D(mass=1.0, nodeNumber=node))
    bob = system.AddMarker(MarkerNodePosition(nodeNumber=node))
    origin = system.AddMarker(MarkerNodePosition(nodeNumber=system.AddNode(NodePointGround())))
    system.AddLoad(LoadForceVector(markerNumber=bob, loadVector=[0, -9.81, 0]))
    system.AddObject(ObjectConnectorSpringDamper(markerNumbers=[origin, bob], referenceLength=1.0, stiffness=10000.0))
    return lambda: np.array(system.GetNodeOutput(node, exu.OutputVariableType.Position))[:2]


_MODELS: dict[str, Callable[[Any, Any], Observed]] = {
    "double_pendulum": _double_pendulum,
    "top": _top,
    "chain": _chain,
    "four_bar": _four_bar,
    "andrews": _andrews,
    "disk": _disk,
    "spring_pendulum": _spring_pendulum,
}
