"""All states of a scene, those that are left when others follow, and coordinates of a chart: the same questions, the same answers."""

from __future__ import annotations

import functools
import inspect
import pickle
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

import acausal as ac
from acausal.abstract_model import AbstractModel
from acausal.start.initial import InitialState
from components import Gear, Particle, Revolute, RigidBody, Spherical, TorqueSource
from tests.exported import compile_quickly, program
from tests.scenes import DoublePendulum, FourBar, Pendulum, bennett_linkage, chain


def ball() -> ac.System:
    """Two bodies on ball joints."""
    return chain(2, lambda _: Spherical())


STARTS = {
    DoublePendulum: {"shoulder.q": 0.6, "elbow.v": 0.5},
    FourBar: {"a.v": 1.0},
    bennett_linkage: {},
    ball: {"joints[0].v": (0.3, 0.2, 0.1), "joints[1].v": (0.1, -0.4, 0.3)},
}


@pytest.mark.parametrize("make", STARTS)
def test_a_chart_answers_as_the_whole_does(make, tmp_path):
    model = ac.build(make())
    minimal = model.minimal(STARTS[make])
    f, whole, y, x, p = minimal.functions, minimal.atlas.functions, minimal.start, minimal.chart.x, minimal.chart.p
    y_dot, x_dot = (np.array(g.explicit_dynamics(0, s, [], p)).ravel() for g, s in ((f, y), (whole, x)))
    assert f.invariants is None and f.projection is None and f.state_names == minimal.state_names
    for energy in ("kinetic_energy", "potential_energy", "power_loss"):
        np.testing.assert_allclose(getattr(f, energy)(0, y, [], p), getattr(whole, energy)(0, x, [], p), rtol=1e-12, atol=1e-12)
    assert np.max(np.abs(np.array(f.residual_dynamics(0, y, y_dot, [], [], p))), initial=0.0) < 1e-10 * (
        1 + np.max(np.abs(x_dot))
    )
    h = 1e-2
    y_next, left = minimal.step("gauss", 6, h)(0, y, [], p)
    assert float(left) < 1e-12
    run = model.simulate(h, STARTS[make], rtol=1e-13, samples=2)
    names = whole.state_names
    np.testing.assert_allclose(
        np.array(minimal.expand(0, y_next, [], p)).ravel(), [run[name][-1] for name in names], rtol=1e-9, atol=1e-9
    )
    for other in (pickle.loads(pickle.dumps(minimal)), pickle.loads(pickle.dumps(f))):
        assert np.array_equal(np.array(other.explicit_dynamics(0, y, [], p)).ravel(), y_dot)
    if (
        make is bennett_linkage
    ):  # it takes thirty times as long to compile as all of the above, and the four-bar has a chart of loops, too
        return
    folder = minimal.export_c(tmp_path)
    if make not in (DoublePendulum, FourBar):  # derivatives of larger scenes take five times as long to compile, and say no more
        (folder / "derivatives.c").unlink()
    assert np.allclose(np.array(ac.load_c(folder)["explicit_dynamics"](0, y, [], p)).ravel(), y_dot, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("make", [DoublePendulum, FourBar])
def test_a_chart_is_linearized_and_led_as_the_whole_is(make):
    model = ac.build(make())
    minimal = model.minimal(STARTS[make])
    first = minimal.state_names[0]
    eigenvalues = [np.sort_complex(m.linearize(*given).eigenvalues) for m, given in ((minimal, ()), (model, (STARTS[make],)))]
    np.testing.assert_allclose(*eigenvalues, rtol=1e-9, atol=1e-9)
    joints = [name.removesuffix(".q") for name in minimal.state_names if name.endswith(".q")]
    motions = {f"{joint}.q": float(q) + 0.1 * ac.time**2 for joint, q in zip(joints, minimal.start, strict=False)}
    found = minimal.inverse_dynamics([0.0, 0.1], motions, joints)
    np.testing.assert_allclose(found.forces, model.inverse_dynamics([0.0, 0.1], motions, joints, STARTS[make]).forces, rtol=1e-9)
    asked = [f"{joint}.q" for joint in joints]
    still = minimal.start * ([1.0] * len(joints) + [0.0] * len(joints))
    direct = minimal.inverse_dynamics_function(asked, joints)(0, still, [0.2] * len(joints), [], minimal.chart.p)
    np.testing.assert_allclose(np.array(direct).ravel(), found.forces[:, 0], rtol=1e-9, err_msg=first)


@pytest.mark.parametrize("make", [FourBar, bennett_linkage, ball, Pendulum])
def test_a_step_ends_on_the_invariants(make):
    model = ac.build(make())
    f, state = model.functions, model.initial_state(STARTS.get(make, {}))
    x_next, _ = model.step("gauss", 2, 0.05)(0, state.x, [], state.p)
    if f.invariants is None or f.projection is None:
        assert f.invariants is None and f.projection is None
        return
    assert np.max(np.abs(np.array(f.invariants(0.05, x_next, [], state.p)))) < 1e-12
    again = np.array(f.projection(0.05, x_next, [], state.p))
    np.testing.assert_allclose(again, np.array(x_next), rtol=1e-12, atol=1e-12)  # it is there to rounding


class GearedArms(Pendulum):
    """Two arms that a gear holds together, one of which a motor drives: `pivot.q` follows from `hinge.q`."""

    def __init__(self) -> None:
        self.mass, self.push = ac.Parameter(1.0, "kg"), ac.Input("N*m")
        super().__init__(mass=self.mass)
        self.pivot, self.arm, self.gear = Revolute("y"), RigidBody.rod(2.0, (0, 0, -0.5)), Gear(-2.0)
        self.connect(self.world.at((1, 0, 0)), self.pivot.frame_a)
        self.connect(self.pivot.frame_b, self.arm.frame)
        self.connect(self.hinge.flange, self.gear.flange_a)
        self.connect(self.pivot.flange, self.gear.flange_b)
        self.motor = TorqueSource(self.push)
        self.connect(self.motor.flange, self.hinge.flange)


class DrivenFourBar(FourBar):
    """With a motor at the crank, and a weight on it that stays adjustable."""

    def __init__(self) -> None:
        super().__init__()
        self.mass, self.push = ac.Parameter(0.5, "kg"), ac.Input("N*m")
        self.motor, self.weight = TorqueSource(self.push), Particle(self.mass)
        self.connect(self.motor.flange, self.a.flange)
        self.connect(self.crank.tip, self.weight.point)


@dataclass(frozen=True)
class Asked:
    """A model, the place that it is asked about, a variable that tells where it is, and a folder to write to."""

    model: AbstractModel
    start: dict[str, float] | None
    follower: str
    folder: Path

    @property
    def begin(self) -> InitialState:
        return self.model.initial_state(self.start)

    def read(self, x: Any) -> float:
        """The follower at states x."""
        f, begin = self.model.functions, self.begin
        return float(f.output(f.outputs.system.flat.named(self.follower))(0, x, 0.1, begin.p))

    def stepped(self) -> float:
        return self.read(self.model.step("gauss", 6, 1e-2)(0, self.begin.x, 0.1, self.begin.p)[0])

    def exported(self) -> float:
        """What an exported program prints last."""
        follower = self.model.functions.outputs.system.flat.named(self.follower)
        self.model.export_simulator(self.folder, self.start, outputs={"follower": follower})
        words = [str(program(self.folder)), "0.3", "2", "1e-11"]
        return float(subprocess.run(words, check=True, capture_output=True, text=True).stdout.split(",")[-1])

    def unit(self) -> float:
        """What a unit for other programs gives last."""
        follower = self.model.functions.outputs.system.flat.named(self.follower)
        unit = self.model.export_fmu(self.folder / "unit", self.start, outputs={"follower": follower})
        found = fmpy.simulate_fmu(
            str(unit), stop_time=0.3, output_interval=0.3, relative_tolerance=1e-11, start_values={"push": 0.1}
        )
        return found["follower"][-1]

    def energy_in_c(self) -> float:
        return float(ac.load_c(self.model.export_c(self.folder))["kinetic_energy"](0, self.begin.x, 0.1, self.begin.p))


TIMES, FORCE = [0.0, 0.2], {"push": 0.2}
ANSWERS: dict[str, Callable[[Asked], Any]] = {
    "initial_state": lambda a: a.read(a.begin.x),
    "simulate": lambda a: a.model.simulate(0.3, a.start, inputs=FORCE, rtol=1e-11, samples=4)[a.follower],
    "sensitivities": lambda a: a.model.sensitivities(TIMES, ["mass"], a.start, rtol=1e-11)[a.follower],
    "trajectory_function": lambda a: np.array(a.model.trajectory_function(TIMES, a.follower, ["mass"], a.start, rtol=1e-11)(0.8)),
    "linearize": lambda a: a.model.linearize(a.begin.x, states=[a.follower, a.follower.replace("q", "v")], inputs=FORCE).A,
    "equilibrium": lambda a: [a.model.equilibrium(a.start)[a.follower], *a.model.linearize(a.model.equilibrium(a.start).x).frequencies],
    "inverse_dynamics": lambda a: a.model.inverse_dynamics(TIMES, {a.follower: 0.1 * ac.time**2 + a.read(a.begin.x)}, ["push"], a.start).forces,
    "inverse_dynamics_function": lambda a: float(a.model.inverse_dynamics_function([a.follower], ["push"])(0, a.begin.x, 0.3, 0, a.begin.p)),
    "step": Asked.stepped,
    "export_c": Asked.energy_in_c,
    "export_simulator": Asked.exported,
    "export_fmu": Asked.unit,
}  # fmt: skip


def test_every_question_is_asked_here():
    assert set(ANSWERS) == {name for name, _ in inspect.getmembers(AbstractModel, inspect.isfunction) if name[0] != "_"}


SCENES = {GearedArms: "pivot.q", DrivenFourBar: "d.q"}
EXPORTS = [
    pytest.param(GearedArms, "export_c", marks=pytest.mark.slow),
    pytest.param(DrivenFourBar, "export_simulator", marks=pytest.mark.slow),
    pytest.param(GearedArms, "export_fmu", marks=pytest.mark.slow),
]


@functools.cache
def _both(make: type[ac.System]) -> tuple[ac.Model, dict[str, float], AbstractModel]:
    """A scene's model, values that it starts from, and its chart there."""
    joint = "hinge" if make is GearedArms else "a"
    model, start = ac.build(make()), {f"{joint}.q": 0.4, f"{joint}.v": 0.5}
    return model, start, model.minimal(start, prefer=list(start))


@pytest.mark.parametrize(("make", "question"), [*((m, q) for m in SCENES for q in ANSWERS if q[:6] != "export"), *EXPORTS])
def test_a_model_and_its_charts_answer_every_question_alike(make, question, tmp_path, monkeypatch):
    """States of the first scene are those that do not follow in closed form; of the second, all of a loop; a chart has the fewest."""
    compile_quickly(monkeypatch)
    model, start, minimal = _both(make)
    assert minimal.state_names == tuple(start)
    asked = Asked(model, start, SCENES[make], tmp_path / "whole"), Asked(minimal, None, SCENES[make], tmp_path / "chart")
    np.testing.assert_allclose(ANSWERS[question](asked[1]), ANSWERS[question](asked[0]), rtol=1e-8, atol=1e-9)
