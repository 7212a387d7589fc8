"""Forward dynamics of spatial chains (alternating y and x hinges, general inertia): one evaluation, beside Pinocchio and MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np

import acausal as ac
from benchmarks.timing import median_time
from components import Revolute, RigidBody, World

OFFSET = np.array([0.3, -0.2, -0.9])


def chain(count: int, askew: bool = False) -> ac.System:
    """Bodies of 1 kg, a metre apart; `askew`: mounted in random directions, with full inertia matrices."""
    scene = ac.System()
    scene.world = World()
    scene.joints = [Revolute("yx"[k % 2]) for k in range(count)]
    principal = np.diag([0.1, 0.2, 0.25])
    turned = [rotation(100 + k) if askew else np.eye(3) for k in range(count)]
    scene.links = [RigidBody(1.0, R @ principal @ R.T, OFFSET / 2 if askew else (0, 0, -0.5)) for R in turned]
    end: Any = scene.world.at((0, 0, 0), rotation(0)) if askew else scene.world.frame
    for k, (joint, link) in enumerate(zip(scene.joints, scene.links, strict=True)):
        scene.connect(end, joint.frame_a)
        scene.connect(joint.frame_b, link.frame)
        end = link.at(OFFSET, rotation(k + 1)) if askew else link.at((0, 0, -1))
    return scene


def rotation(seed: int) -> np.ndarray:
    """A random rotation matrix."""
    Q, R = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q if np.linalg.det(Q) > 0 else -Q


def pinocchio_chain(count: int, q: np.ndarray, v: np.ndarray, askew: bool = False) -> tuple[float, np.ndarray]:
    """Seconds of a call of Pinocchio's articulated-body algorithm, and its accelerations."""
    import pinocchio as pin

    model = pin.Model()
    parent = 0
    for k in range(count):
        place = pin.SE3(
            rotation(k) if askew else np.eye(3), np.zeros(3) if k == 0 else OFFSET if askew else np.array([0, 0, -1.0])
        )
        parent = model.addJoint(parent, pin.JointModelRY() if k % 2 == 0 else pin.JointModelRX(), place, f"j{k}")
        turned = rotation(100 + k) if askew else np.eye(3)
        lever = OFFSET / 2 if askew else np.array([0, 0, -0.5])
        model.appendBodyToJoint(
            parent, pin.Inertia(1.0, lever, turned @ np.diag([0.1, 0.2, 0.25]) @ turned.T), pin.SE3.Identity()
        )
    data, tau = model.createData(), np.zeros(count)
    return median_time(lambda: pin.aba(model, data, q, v, tau)), pin.aba(model, data, q, v, tau).copy()


def mujoco_time(count: int, q: np.ndarray, v: np.ndarray) -> tuple[float, np.ndarray]:
    """MuJoCo's mj_forward, and its accelerations."""
    import mujoco

    text = (
        "".join(
            f'<body pos="0 0 {0 if k == 0 else -1}"><joint axis="{"0 1 0" if k % 2 == 0 else "1 0 0"}"/>'
            '<inertial pos="0 0 -0.5" mass="1" diaginertia="0.1 0.2 0.25"/>'
            for k in range(count)
        )
        + "</body>" * count
    )
    model = mujoco.MjModel.from_xml_string(f'<mujoco><option gravity="0 0 -9.81"/><worldbody>{text}</worldbody></mujoco>')
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q, v
    seconds = median_time(lambda: mujoco.mj_forward(model, data))
    return seconds, np.array(data.qacc)
