"""MuJoCo on models written for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, final

import numpy as np

from benchmarks.peers.base import AbstractPeer, Prepared
from benchmarks.peers.equations import equations
from benchmarks.scenes import Built

_STEPS = (100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000)


@final
class Mujoco(AbstractPeer):
    """Fixed steps, all in one call. Loops are closed by its soft equality constraints, set as hard as they go."""

    name: ClassVar[str] = "mujoco"
    module: ClassVar[str] = "mujoco"

    def methods(self, scene: str) -> tuple[str, ...]:
        return ("RK4", "implicit")

    def refusal(self, scene: str) -> str:
        return "no rolling without slipping (contacts are soft, friction is regularised)" if scene == "disk" else ""

    def settings(self, scene: str, method: str) -> tuple[float, ...]:
        end = 0.05 if scene == "andrews" else 5.0 if scene == "chain" else 10.0
        return tuple(end / n for n in _STEPS)

    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        import mujoco

        mujoco.set_mju_user_warning(lambda text: None)  # else it writes a file here
        name, end = built.scene.name, built.scene.end
        text, (qpos, qvel) = _MODELS[name](setting), _starts(name)
        options = f'<option gravity="0 0 {0 if name == "andrews" else -9.81}" integrator="{method}" timestep="{setting!r}" iterations="100" tolerance="1e-12">'
        head = f'<mujoco><compiler angle="radian" autolimits="false"/>{options}<flag contact="disable" autoreset="disable"/></option>'
        model = mujoco.MjModel.from_xml_string(f"{head}{text}</mujoco>")
        data = mujoco.MjData(model)
        count = round(end / setting)

        def run() -> Any:
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:] = qpos, qvel
            if name == "andrews":
                data.qfrc_applied[0] = 0.033
            mujoco.mj_step(model, data, count)
            return data

        def values(result: Any) -> np.ndarray:
            mujoco.mj_kinematics(model, data)
            return _OBSERVED[name](data)

        return Prepared(run, values)


def _body(
    joint: str, mass: float, centre: tuple[float, ...], inertia: tuple[float, ...], inside: str = "", place: str = "0 0 0"
) -> str:
    numbers = f'pos="{_text(centre)}" mass="{mass!r}" diaginertia="{_text(inertia)}"'
    return f'<body pos="{place}">{joint}<inertial {numbers}/>{inside}</body>'


def _text(vector: tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in vector)


def _site(name: str, place: str) -> str:
    return f'<site name="{name}" pos="{place}"/>'


_HINGE_Y, _HINGE_Z = '<joint axis="0 1 0"/>', '<joint axis="0 0 1"/>'


def _double_pendulum(step: float) -> str:
    rod = (_HINGE_Y, 1.0, (0.0, 0.0, -0.5), (1 / 12, 1 / 12, 1e-9))
    lower = _body(*rod, _site("tip", "0 0 -1"), "0 0 -1")
    return f"<worldbody>{_body(*rod, _site('elbow', '0 0 -1') + lower)}</worldbody>"


def _top(step: float) -> str:
    body = _body('<joint type="ball"/>', 0.5, (0.0, 0.0, 0.05), (8e-4, 8e-4, 1e-3))
    return f"<worldbody>{body}</worldbody>"


def _chain(step: float) -> str:
    text = ""
    for k in reversed(range(10)):
        joint = _HINGE_Y if k % 2 == 0 else '<joint axis="1 0 0"/>'
        text = _body(joint, 1.0, (0.0, 0.0, -0.5), (0.1, 0.2, 0.25), _site(f"end{k}", "0 0 -1") + text, f"0 0 {-1 if k else 0}")
    return f"<worldbody>{text}</worldbody>"


def _closed(pairs: tuple[tuple[str, str], ...], step: float) -> str:
    """Pairs of sites that stay together: the stiffest that the step allows."""
    hard = f'solref="{2 * step!r} 1" solimp="0.9999 0.9999 0.001 0.5 2"'
    return "<equality>" + "".join(f'<connect site1="{a}" site2="{b}" {hard}/>' for a, b in pairs) + "</equality>"


def _four_bar(step: float) -> str:
    def rod(mass: float, length: float, inside: str, place: str) -> str:
        moment = mass * length**2 / 12
        return _body(_HINGE_Y, mass, (length / 2, 0.0, 0.0), (1e-9, moment, moment), inside, place)

    coupler = rod(2.0, 1.2, _site("c", "1.2 0 0"), "0.4 0 0")
    crank = rod(1.0, 0.4, _site("crank", "0.4 0 0") + coupler, "0 0 0")
    rocker = rod(1.5, 0.8, _site("rocker", "0.8 0 0"), "1 0 0")
    return f"<worldbody>{crank}{rocker}</worldbody>{_closed((('c', 'rocker'),), step)}"


def _andrews(step: float) -> str:
    def link(mass: float, inertia: float, centre: tuple[float, float], inside: str, place: str) -> str:
        return _body(_HINGE_Z, mass, (*centre, 0.0), (inertia / 2, inertia / 2, inertia), inside, place)

    A, B = "-0.06934 -0.00227 0", "-0.03635 0.03273 0"
    K2 = link(0.00365, 4.41e-7, (-0.0115, 0.0), _site("E2", "-0.028 0 0"), "0.007 0 0")
    K1 = link(0.04325, 2.194e-6, (0.00092, 0.0), K2, "0 0 0")
    K3 = link(0.02373, 5.255e-6, (0.01043, -0.01874), _site("E3", "0 -0.035 0") + _site("D", "0.02 -0.018 0"), B)
    K4 = link(0.00706, 5.667e-7, (0.0, 0.01421 - 0.02), _site("E4", "0 -0.02 0"), "0.04 0 0")
    K5 = link(0.0705, 1.169e-5, (0.02308, -0.00916), K4, A)
    K6 = link(0.00706, 5.667e-7, (0.02 - 0.01421, 0.0), _site("E6", "0.02 0 0"), "0 -0.04 0")
    K7 = link(0.05498, 1.912e-5, (-0.00449, -0.01228), K6, A)
    tendon = '<spatial stiffness="4530" springlength="0.07785"><site site="C"/><site site="D"/></spatial>'
    loops = _closed((("E3", "E2"), ("E3", "E4"), ("E3", "E6")), step)
    return f"<worldbody>{_site('C', '0.014 0.072 0')}{K1}{K3}{K5}{K7}</worldbody>{loops}<tendon>{tendon}</tendon>"


def _spring_pendulum(step: float) -> str:
    slides = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
    bob = _body(slides, 1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), _site("bob", "0 0 0"), "1 0 0")
    tendon = '<spatial stiffness="10000" springlength="1"><site site="origin"/><site site="bob"/></spatial>'
    return f"<worldbody>{_site('origin', '0 0 0')}{bob}</worldbody><tendon>{tendon}</tendon>"


_MODELS: dict[str, Callable[[float], str]] = {
    "double_pendulum": _double_pendulum,
    "top": _top,
    "chain": _chain,
    "four_bar": _four_bar,
    "andrews": _andrews,
    "spring_pendulum": _spring_pendulum,
}


def _starts(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities in the order of the model's joints."""
    y = equations(name, np.float64).start().astype(float)
    if name == "double_pendulum":
        return np.array([0.6, 0.0]), np.zeros(2)
    if name == "four_bar":  # angles lead from x to z, turns about y from z to x
        a, b, c, u, v, w = -y
        return np.array([a, b - a, c]), np.array([u, v - u, w])
    if name == "andrews":
        a = y[:7]
        return np.array([a[0], a[1] - a[0], a[2], a[4], a[3] - a[4], a[6], a[5] - a[6]]), np.zeros(7)
    if name == "spring_pendulum":
        return np.zeros(2), np.zeros(2)
    half = 4 if name == "top" else 10
    return y[:half], y[half:]


def _sites(*names: str, rows: tuple[int, ...] = (0, 1, 2)) -> Callable[[Any], np.ndarray]:
    return lambda data: np.concatenate([data.site(name).xpos[list(rows)] for name in names])


def _andrews_directions(data: Any) -> np.ndarray:
    order = [1, 2, 3, 5, 4, 7, 6]  # K4 hangs on K5, K6 on K7
    turned = data.xmat[order]
    return np.concatenate([turned[:, 0], turned[:, 3]])


_OBSERVED: dict[str, Callable[[Any], np.ndarray]] = {
    "double_pendulum": _sites("elbow", "tip", rows=(0, 2)),
    "top": lambda data: data.xmat[1].copy(),
    "chain": _sites("end4", "end9"),
    "four_bar": _sites("crank", "rocker", rows=(0, 2)),
    "andrews": _andrews_directions,
    "spring_pendulum": _sites("bob", rows=(0, 2)),
}
