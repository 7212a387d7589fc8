"""Forward dynamics of spatial chains (alternating y and x hinges, general inertia): one evaluation, beside Pinocchio and MuJoCo."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable

import casadi as ca
import numpy as np

import acausal as ac
from acausal.codegen.lower import operations
from acausal.export.c_source import build_line
from components import Revolute, RigidBody, World

COUNTS = (1, 2, 5, 10, 20, 50, 100)


def chain(count: int) -> ac.System:
    """Bodies of 1 kg, a metre apart."""
    scene = ac.System()
    scene.world = World()
    scene.joints = [Revolute("yx"[k % 2]) for k in range(count)]
    scene.links = [RigidBody(1.0, (0.1, 0.2, 0.25), (0, 0, -0.5)) for _ in range(count)]
    end = scene.world.frame
    for joint, link in zip(scene.joints, scene.links, strict=True):
        scene.connect(end, joint.frame_a)
        scene.connect(joint.frame_b, link.frame)
        end = link.at((0, 0, -1))
    return scene


def median_time(call: Callable[[], object], budget: float = 0.2) -> float:
    """Median seconds of one call, over batches."""
    call()
    once = time.perf_counter()
    call()
    batch = max(1, int(0.01 / max(time.perf_counter() - once, 1e-7)))
    times: list[float] = []
    end = time.perf_counter() + budget
    while time.perf_counter() < end or len(times) < 3:
        start = time.perf_counter()
        for _ in range(batch):
            call()
        times.append((time.perf_counter() - start) / batch)
    return statistics.median(times)


def repeated(function: ca.Function, count: int, x: np.ndarray) -> float:
    """Seconds of one evaluation without Python: a thousand in one call."""
    n = 1000
    many = function.map(n)
    buffer, run = many.buffer()
    arrays = [np.zeros(n), np.tile(x, n), np.zeros(1), np.zeros(1)]
    out = np.empty(2 * count * n)
    for i, array in enumerate(arrays):
        buffer.set_arg(i, memoryview(array))
    buffer.set_res(0, memoryview(out))
    return median_time(run) / n


def compiled(model: ac.Model) -> tuple[ca.Function | None, float]:
    """The dynamics as C, and the time to compile it; None without a compiler."""
    folder = tempfile.mkdtemp()
    model.export_c(folder)
    start = time.perf_counter()
    try:
        loaded = ac.load_c(folder)
    except ac.errors.ExportError:
        return None, 0.0
    return loaded["explicit_dynamics"], time.perf_counter() - start


def pinocchio_time(count: int, q: np.ndarray, v: np.ndarray) -> tuple[float, np.ndarray]:
    """Pinocchio's articulated-body algorithm, and its accelerations."""
    import pinocchio as pin

    model = pin.Model()
    parent = 0
    for k in range(count):
        joint = pin.JointModelRY() if k % 2 == 0 else pin.JointModelRX()
        place = pin.SE3.Identity() if k == 0 else pin.SE3(np.eye(3), np.array([0, 0, -1.0]))
        parent = model.addJoint(parent, joint, place, f"j{k}")
        model.appendBodyToJoint(parent, pin.Inertia(1.0, np.array([0, 0, -0.5]), np.diag([0.1, 0.2, 0.25])), pin.SE3.Identity())
    data, tau = model.createData(), np.zeros(count)
    return median_time(lambda: pin.aba(model, data, q, v, tau)), pin.aba(model, data, q, v, tau)


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


def run() -> None:
    """Print the table."""
    print(
        "Forward dynamics of a chain, microseconds an evaluation (medians, one thread; pin and mujoco include their Python call)"
    )
    print(f"{build_line('model.c', 'model.so')}")
    print(
        f"{'links':>6}{'operations':>12}{'build ms':>10}{'compile s':>11}{'machine':>9}{'C':>8}{'pin':>8}{'mujoco':>8}{'difference':>12}"
    )
    for count in COUNTS:
        rng = np.random.default_rng(0)
        q, v = rng.uniform(-1, 1, count), rng.uniform(-1, 1, count)
        scene = chain(count)
        start = time.perf_counter()
        model = ac.build(scene)
        built = time.perf_counter() - start
        f = model.functions.explicit_dynamics
        x = np.concatenate([q, v])
        virtual = repeated(f, count, x)
        code, seconds = compiled(model)
        native = repeated(code, count, x) if code is not None else float("nan")
        pin_time, reference = pinocchio_time(count, q, v)
        mj_time, other = mujoco_time(count, q, v)
        ours = np.array(f(0, x, [], [])).ravel()[count:]
        gap = max(np.max(np.abs(ours - reference)), np.max(np.abs(ours - other))) / np.max(np.abs(ours))
        print(
            f"{count:>6}{operations(f):>12}{1e3 * built:>10.1f}{seconds:>11.2f}{1e6 * virtual:>9.2f}{1e6 * native:>8.2f}{1e6 * pin_time:>8.2f}{1e6 * mj_time:>8.2f}{gap:>12.1e}"
        )
