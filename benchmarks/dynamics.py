"""Forward dynamics, one evaluation: our C with one lane and in all lanes, beside Pinocchio and MuJoCo; chains and robots.

python -m benchmarks.dynamics

The C runs in a loop in C. The others are called from Python; `pin` is given as called, and less what a call of a model with
one joint takes, so that their binding is left out. Accelerations are compared in the same run.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

import acausal as ac
from acausal.emit.compiler import cached_library, compiler
from acausal.emit.emit import emit, translation_units
from acausal.outputs.functions import operations
from acausal.runtime.load import runtime
from benchmarks.chains import chain, mujoco_time, pinocchio_chain
from benchmarks.one_core import one_core
from benchmarks.timing import median_time
from components import Prismatic, Revolute, RigidBody, World

CHAINS = (1, 2, 5, 10, 20, 50, 100)
ASKEW = (10, 20, 50)
ROBOTS = (
    ("Panda", "panda_description/urdf/panda.urdf", False),
    ("ANYmal", "anymal_b_simple_description/robots/anymal.urdf", True),
    ("Talos", "talos_data/robots/talos_reduced.urdf", True),
)
_LOOP = """
EXPORT void repeat(const double *a, double *b, long n) {
    static V in[4096], c[16384], out[4096], w[65536];
    for (long i = 0; i < rhs_sizes[0]; i++) in[i] = v_all(a[i]);
    rhs_prepare(in, c, c, w);
    for (long k = 0; k < n; k++) {
        rhs(in, c, out, w);
        __asm__ volatile("" ::: "memory");
    }
    for (long i = 0; i < rhs_sizes[1]; i++) b[i] = out[i][0];
}
"""


class Compiled:
    """A model's accelerations as C for a number of lanes; seconds to emit and compile it."""

    def __init__(self, model: ac.Model, lanes: int | None) -> None:
        command = compiler()
        assert command is not None
        start = time.perf_counter()
        units = translation_units([emit(model.functions.explicit_dynamics, "rhs", parameters=(3,))], os.cpu_count() or 1)
        head = f"#define LANES {lanes}\n" if lanes else ""
        sources = [head + unit + (_LOOP if k == 0 else "") for k, unit in enumerate(units)]
        path = cached_library(f"benchmark {time.time_ns()}", sources, command=command)
        assert path is not None
        self.seconds = time.perf_counter() - start
        self._library = ctypes.CDLL(str(path))
        Path(path).unlink()
        self._x = np.zeros(4096)
        self._out = np.zeros(4096)

    def run(self, x: np.ndarray, count: int = 1) -> np.ndarray:
        """x' (nx,) at t = 0, `count` times."""
        self._x[1 : 1 + x.size] = x
        pointers = [a.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for a in (self._x, self._out)]
        self._library.repeat(*pointers, ctypes.c_long(count))
        return self._out[: x.size].copy()

    def time(self, x: np.ndarray) -> float:
        """Seconds of one evaluation of all lanes."""
        return median_time(lambda: self.run(x, 1000)) / 1000


def robot(path: Path, floating: bool) -> tuple[ac.System, Any]:
    """A scene with the links and joints that Pinocchio reads from a URDF file, and Pinocchio's model."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer()) if floating else pin.buildModelFromUrdf(str(path))
    scene = ac.System()
    scene.world = World()
    scene.links, scene.joints = [], []
    frames: dict[int, Any] = {0: scene.world}
    for i in range(1, model.njoints):
        name, inertia = model.joints[i].shortname(), model.inertias[i]
        matrix, mass = inertia.inertia, inertia.mass
        link = RigidBody(mass, matrix, inertia.lever)
        scene.links = [*scene.links, link]
        frames[i] = link
        if name == "JointModelFreeFlyer":
            continue
        placement = model.jointPlacements[i]
        axis = name[-1].lower() if name[-1] in "XYZ" else tuple(model.joints[i].extract().axis)
        joint = Prismatic(axis) if "JointModelP" in name else Revolute(axis)
        scene.joints = [*scene.joints, joint]
        scene.connect(frames[model.parents[i]].at(placement.translation, placement.rotation), joint.frame_a)
        scene.connect(joint.frame_b, link.frame)
    return scene, model


def pinocchio_robot(
    ours: ac.Model, scene: Any, model: Any, q: np.ndarray, v: np.ndarray, floating: bool
) -> tuple[float, np.ndarray]:
    """Seconds of a call of Pinocchio's articulated-body algorithm, and the accelerations of the joints.

    Another link than Pinocchio's base may carry our free coordinates, so the base is put where ours is.
    """
    import pinocchio as pin

    data, tau = model.createData(), np.zeros(model.nv)
    whole, rates = q, v
    if floating:
        x = state(ours, q, v)[0]
        place, speed, R, w = (np.array(y) for y in ours.functions.frame_kinematics(scene.links[0].frame)(0, x, [], []))
        whole = np.concatenate([place.ravel(), pin.Quaternion(R).coeffs(), q])
        rates = np.concatenate([R.T @ speed.ravel(), R.T @ w.ravel(), v])
    base = 6 if floating else 0
    return median_time(lambda: pin.aba(model, data, whole, rates, tau)), pin.aba(model, data, whole, rates, tau)[base:].copy()


def state(model: ac.Model, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """x for joint angles and rates, bases at rest in the origin; and where the accelerations of the joints are in x'."""
    x = np.zeros(len(model.state_names))
    rows: list[int] = []
    for i, name in enumerate(model.state_names):
        if name.endswith("free.q[0]"):
            x[i] = 1.0
        if name.startswith("joints["):
            k = int(name[7 : name.index("]")])
            x[i] = (q if name.endswith(".q") else v)[k]
    for k in range(q.size):
        rows.append(model.state_names.index(f"joints[{k}].v"))
    return x, rows


Peer = tuple[float, np.ndarray]
"""Seconds of an evaluation, and accelerations."""


def line(name: str, model: ac.Model, q: np.ndarray, v: np.ndarray, peer: Peer | None, binding: float) -> str:
    """One row of the table; no number where there is no peer, and no ratio where its time is its binding's: one joint."""
    x, rows = state(model, q, v)
    one, many = Compiled(model, 1), Compiled(model, None)
    lanes, found = _lanes(), [c.run(x)[rows] for c in (one, many)]
    seconds, theirs = peer or (np.nan, np.full(len(rows), np.nan))
    gap = max(np.max(np.abs(values - theirs)) for values in found) / np.max(np.abs(theirs))
    alone = seconds - binding if len(rows) > 1 else np.nan
    times = 1e6 * np.array([one.time(x), many.time(x) / lanes, seconds, alone])
    ratios = times[3] / times[:2]
    numbers = "".join(f"{t:>10.3f}" for t in times) + "".join(f"{r:>8.1f}" for r in ratios)
    return f"{name:>10}{operations(model.functions.explicit_dynamics):>8}{many.seconds:>9.2f}{numbers}{gap:>10.0e}"


def _lanes() -> int:
    found = runtime()
    assert found is not None
    return found.lanes


def python_call() -> float:
    """Seconds of Pinocchio's call of a model with one joint."""
    import pinocchio as pin

    single = pin.Model()
    joint = single.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "j")
    single.appendBodyToJoint(joint, pin.Inertia.Identity(), pin.SE3.Identity())
    data, zero = single.createData(), np.zeros(1)
    return median_time(lambda: pin.aba(single, data, zero, zero, zero))


def installed(module: str) -> bool:
    """Whether a peer can be imported."""
    return importlib.util.find_spec(module) is not None


def run(chains: tuple[int, ...] = CHAINS, askew: tuple[int, ...] = ASKEW) -> None:
    """Print the tables."""
    peer = installed("pinocchio")
    binding = python_call() if peer else np.nan
    print(
        f"\nForward dynamics, microseconds an evaluation; {_lanes()} lanes; a Python call of pin with one joint: {1e6 * binding:.2f}"
    )
    print(
        f"{'':>10}{'ops':>8}{'make s':>9}{'scalar':>10}{'a lane':>10}{'pin call':>10}{'pin':>10}{'times':>8}{'times':>8}{'differ':>10}"
    )
    rng = np.random.default_rng(0)
    for count, turned in [(count, False) for count in chains] + [(count, True) for count in askew]:
        q, v = rng.uniform(-1, 1, count), rng.uniform(-1, 1, count)
        theirs = pinocchio_chain(count, q, v, turned) if peer else None
        print(
            line(f"{count} {'askew' if turned else 'links'}", ac.build(chain(count, turned)), q, v, theirs, binding), flush=True
        )
    folder = robots_folder() if peer else None
    for name, path, floating in ROBOTS if folder else ():
        scene, model = robot(folder / path, floating)
        n = len(scene.joints)
        q, v = rng.uniform(-0.5, 0.5, n), rng.uniform(-1, 1, n)
        ours = ac.build(scene)
        print(line(name, ours, q, v, pinocchio_robot(ours, scene, model, q, v, floating), binding), flush=True)
    if not installed("mujoco"):
        return
    print("\nMuJoCo's mj_forward on the same chains, microseconds with its Python call")
    for count in chains:
        q, v = rng.uniform(-1, 1, count), rng.uniform(-1, 1, count)
        print(f"{count:>6} links{1e6 * mujoco_time(count, q, v)[0]:>10.2f}")


def robots_folder() -> Path | None:
    """Where example-robot-data keeps its robots; None if it is not installed."""
    import pinocchio

    for parent in Path(pinocchio.__file__).parents:
        folder = parent / "share" / "example-robot-data" / "robots"
        if folder.is_dir():
            return folder
    return None


if __name__ == "__main__":
    one_core()
    run()
