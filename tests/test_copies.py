"""Scenes, models and motions that are pickled and copied: other symbols, the same scene, the same bits."""

from __future__ import annotations

import copy
import inspect
import multiprocessing
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
import components
from acausal.errors import AcausalError, SimulationError, UnknownVariableError
from acausal.loops.constraints import analyse_constraints
from acausal.reduce.reduce import reduce_system
from components import Prismatic, Revolute, RigidBody, Spring, World
from examples.bicycle import Bicycle
from tests.scenes import DoublePendulum, FourBar, bennett_linkage, chain
from tests.test_minimal import geared_motor, vehicle
from tests.test_one_dynamics import GearedArms
from tests.test_sensitivity import AdjustableFourBar, Oscillator

SCENES: tuple[Callable[[], ac.System], ...] = (
    DoublePendulum, FourBar, bennett_linkage, AdjustableFourBar, Oscillator, vehicle, geared_motor, Bicycle, lambda: chain(30)
)  # fmt: skip


def motion(model: ac.Model) -> np.ndarray:
    """Pushed at its last velocity."""
    last = next(name for name in reversed(model.state_names) if re.search(r"\.v\b", name))
    return model.simulate(0.2, {last: ac.near(0.3)}, rtol=1e-9, samples=5, compiled=False).x


@pytest.mark.parametrize("make", SCENES)
def test_copies_of_a_scene_and_its_model_give_the_same_bits(make):
    scene = make()
    model = ac.build(scene)
    expected = motion(model)
    again, model_again = pickle.loads(pickle.dumps((scene, model)))
    copied, model_copied = copy.deepcopy((scene, model))
    built = ac.build(copied)
    for other in (model_again, ac.build(again), model_copied, built):
        assert other.functions.explicit_dynamics.serialize() == model.functions.explicit_dynamics.serialize()
        assert other.state_names == model.state_names
    assert np.array_equal(motion(model_again), expected)
    assert np.array_equal(motion(built), expected)


def test_a_system_that_was_examined_elsewhere_is_made_again_there():
    scene = FourBar()
    usual = ac.build(scene).system
    values, place = usual.p_values, usual.samples[-1]
    elsewhere = analyse_constraints(usual.mechanics, usual.p, values, place, 0.5, usual.constraints)
    system = reduce_system(usual.mechanics, at=values, constraints=elsewhere)
    assert not np.array_equal(system.q_start, usual.q_start)
    for other in (pickle.loads(pickle.dumps(system)), copy.deepcopy((scene, system))[1]):
        assert other is not system and other.constraints.time == 0.5
        assert np.array_equal(other.q_start, system.q_start)


def test_a_copy_has_symbols_of_its_own_and_its_model_knows_them():
    scene = AdjustableFourBar()
    model = ac.build(scene)
    for other, its_model in (pickle.loads(pickle.dumps((scene, model))), copy.deepcopy((scene, model))):
        assert other.length is other.__dict__["length"] and other.length is not scene.length
        run = its_model.simulate(0.1, {other.a.q: 1.0}, parameters={other.length: 1.1})
        assert np.array_equal(run.x, model.simulate(0.1, {scene.a.q: 1.0}, parameters={scene.length: 1.1}).x)
        with pytest.raises(UnknownVariableError):
            its_model.simulate(0.1, {scene.a.q: 1.0})
    assert copy.deepcopy(model) is model


def test_two_copies_stand_in_one_scene():
    """Symbols would be the same if they were only copied as CasADi copies them."""

    class Pair(ac.System):
        def __init__(self) -> None:
            self.world = World()
            length = ac.Parameter(1.0, "m")
            self.length = length
            self.left = self._arm(length)
            self.right = copy.deepcopy(self.left)
            for arm in (self.left, self.right):
                self.connect(self.world.frame, arm.hinge.frame_a)

        @staticmethod
        def _arm(length: ac.Parameter) -> ac.System:
            arm = ac.System()
            arm.hinge, arm.rod = Revolute("y"), RigidBody.rod(1.0, (0, 0, -1.0 * length))
            arm.connect(arm.hinge.frame_b, arm.rod.frame)
            return arm

    model = ac.build(Pair())
    assert len(model.parameter_names) == 2 and model.degrees_of_freedom == 2
    assert ca.sprank(model.functions.explicit_dynamics.jac_sparsity(0, 1)) == 4


def test_symbols_in_formulas_and_time_are_kept():
    scene = ac.System()
    scene.world, scene.stiffness = World(), ac.Parameter(30.0, "N/m")
    scene.rail, scene.body = Prismatic("x"), RigidBody(1.0, (1, 1, 1))
    scene.spring = Spring(2 * scene.stiffness + ca.sin(ac.time), 0.3)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.body.frame)
    scene.connect(scene.world.at((0, 0, 1)), scene.spring.point_a)
    scene.connect(scene.body.frame, scene.spring.point_b)
    expected = motion(ac.build(scene))
    for other in (pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene)):
        model = ac.build(other)
        assert np.array_equal(motion(model), expected)
        changed = model.simulate(0.2, {other.rail.q: 0.1}, parameters={other.stiffness: 10.0}, samples=5, compiled=False).x
        assert np.max(np.abs(changed - expected)) > 1e-3


@pytest.mark.parametrize("make", [DoublePendulum, AdjustableFourBar, Oscillator, geared_motor])
def test_motions_starts_and_functions_are_read_elsewhere_with_the_same_bits(make):
    scene = make()
    run = ac.build(scene).simulate(0.2, rtol=1e-9, samples=5)
    watched = [joint.edge.joint.q for joint in run.outputs.system.tree_joints][:2]
    again, names = pickle.loads(pickle.dumps((run, watched)))
    copied = copy.deepcopy(run)
    for other, variables in ((again, names), (copied, watched)):
        assert np.array_equal(other.x, run.x) and np.array_equal(other.initial.x, run.initial.x)
        for mine, its in zip(watched, variables, strict=True):
            assert np.array_equal(other[its], run[mine])
        np.testing.assert_allclose(other.at(0.13).x, run.at(0.13).x, rtol=1e-12, atol=1e-14)
        assert (str(other), str(other.initial), other.constraint_error()) == (str(run), str(run.initial), run.constraint_error())
    assert again.functions.explicit_dynamics.serialize() == run.functions.explicit_dynamics.serialize()
    start = pickle.loads(pickle.dumps(run.initial))
    assert np.array_equal(start.x, run.initial.x) and str(start) == str(run.initial)


def test_a_motion_copied_with_its_scene_is_read_by_the_copy():
    scene = FourBar()
    run = ac.build(scene).simulate(0.2, rtol=1e-9, samples=5, events=[ac.when(scene.a.q - 0.05)])
    other, its_run = copy.deepcopy((scene, run))
    assert np.array_equal(its_run[other.d.q], run[scene.d.q])
    assert [event.time for event in its_run.events] == [event.time for event in run.events]
    with pytest.raises(UnknownVariableError):
        its_run[scene.d.q]  # pyright: ignore[reportUnusedExpression]  # it raises


def test_a_motion_as_a_function_gives_the_same_elsewhere():
    scene = AdjustableFourBar()
    f = ac.build(scene).trajectory_function([0.0, 0.1, 0.2], scene.a.q, [scene.length], {scene.a.q: 1.0})
    for other in (pickle.loads(pickle.dumps(f)), copy.deepcopy(f)):
        assert float(other(1.05)[2]) == float(f(1.05)[2])
        assert np.array_equal(np.array(other.jacobian()(1.05, 0)), np.array(f.jacobian()(1.05, 0)))


def test_a_motion_is_read_in_another_process_with_the_same_bits(tmp_path):
    scene = FourBar()
    run = ac.build(scene).simulate(0.2, {scene.a.q: 1.0}, rtol=1e-9, samples=5)
    (tmp_path / "run.pickle").write_bytes(pickle.dumps((scene, run)))
    code = f"import pickle; s, r = pickle.load(open({str(tmp_path / 'run.pickle')!r}, 'rb')); print(r[s.d.q].tobytes().hex())"
    out = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert out.strip() == run[scene.d.q].tobytes().hex()


def test_a_model_comes_out_of_another_process(tmp_path):
    scene = FourBar()
    (tmp_path / "model.pickle").write_bytes(pickle.dumps((scene, ac.build(scene))))
    code = f"import pickle; s, m = pickle.load(open({str(tmp_path / 'model.pickle')!r}, 'rb')); print(m.simulate(0.2, {{s.a.q: 1.0}}, rtol=1e-9)[s.d.q][-1].hex())"
    out = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert float.fromhex(out.strip()) == ac.build(scene).simulate(0.2, {scene.a.q: 1.0}, rtol=1e-9)[scene.d.q][-1]


def _answered(question: str) -> Any:
    """In another process, which gets the model and gives the answer back."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_ask, (ac.build(DoublePendulum()), question))


def _ask(model: ac.Model, question: str) -> Any:
    start = {"shoulder.q": 0.3, "elbow.q": -0.1}
    return {
        "run": lambda: model.simulate(0.1, start, samples=3),
        "minimal": lambda: model.minimal(start),
        "failure": lambda: model.simulate(10.0, start, max_steps=2),
        "forces": lambda: model.inverse_dynamics([0.0, 0.1], {"shoulder.q": ac.time, "elbow.q": 0.1}, ["shoulder", "elbow"]),
    }[question]()


@pytest.mark.slow
def test_other_processes_are_asked_by_name_and_answer_with_all_they_have():
    model = ac.build(DoublePendulum())
    assert np.array_equal(_answered("run")["elbow.q"], _ask(model, "run")["elbow.q"])
    forces = [found.force("elbow") for found in (_answered("forces"), _ask(model, "forces"))]
    assert np.array_equal(*forces)


ANSWERS: dict[str, Callable[[ac.Model], Any]] = {
    "run": lambda m: m.simulate(0.1, START, samples=3, events=[ac.when(ac.time - 0.05)]),
    "minimal": lambda m: m.minimal(START),
    "charts": lambda m: m.minimal(START).simulate(0.1, samples=3),
    "sensitivities": lambda m: m.sensitivities([0.0, 0.1], ["mass"], START)["pivot.q"],
    "start": lambda m: m.initial_state(START),
    "linearization": lambda m: m.linearize(START),
    "equilibrium": lambda m: m.equilibrium(START),
    "forces": lambda m: m.inverse_dynamics([0.0, 0.1], {"hinge.q": 0.4}, ["push"], START),
    "joint forces": lambda m: m.inverse_dynamics([0.0, 0.1], {"hinge.q": 0.4}, ["hinge"], START),
    "branches": lambda m: m.branches(START, searches=5),
    "step": lambda m: m.step(),
    "assembly": lambda m: m.assembly_function(None, "hinge.q", START),
    "constraints": lambda m: m.constraints(),
    "decisions": lambda m: m.decisions,
    "equations": lambda m: m.equations(),
    "report": lambda m: m.report(),
}
START = {"hinge.q": 0.4}


@pytest.mark.parametrize("question", ANSWERS)
def test_answers_are_pickled_and_copied(question):
    found = ANSWERS[question](ac.build(GearedArms()))
    for other in (pickle.loads(pickle.dumps(found)), copy.deepcopy(found)):
        assert str(other) == str(found)


def test_motions_with_functions_that_cannot_be_pickled_are_read_elsewhere():
    bias, model = 0.1, ac.build(GearedArms())
    run, charts = (
        m.simulate(1.0, START, inputs={"push": lambda t: np.sin(7 * t) + bias}, samples=9) for m in (model, model.minimal(START))
    )
    for one in (run, charts):
        other = pickle.loads(pickle.dumps(one))
        for name in ("push", "pivot.v", "motor.flange.tau"):
            assert np.array_equal(other[name], one[name])
            np.testing.assert_allclose(other.at(0.123)[name], one.at(0.123)[name], rtol=1e-10)
        assert other.energy_error() == pytest.approx(one.energy_error(), abs=1e-9)


def test_failures_are_pickled_with_what_was_computed():
    with pytest.raises(SimulationError) as caught:
        _ask(ac.build(DoublePendulum()), "failure")
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value)
    assert np.array_equal(again.trajectory["elbow.q"], caught.value.trajectory["elbow.q"])


@pytest.mark.parametrize("make", [DoublePendulum, bennett_linkage, Bicycle])
def test_frames_that_were_asked_for_after_the_build_stand_in_no_way_of_copies(make: Callable[[], ac.System]):
    """A model knows the frames that it was built with; others are read of it, here and elsewhere."""
    scene = make()
    model = ac.build(scene)
    bodies = [part.component for part in model.system.flat.parts if isinstance(part.component, RigidBody)]
    start = {next(name for name in reversed(model.state_names) if re.search(r"\.v\b", name)): ac.near(0.3)}
    run = model.simulate(0.1, start, samples=3)
    places = [frame.position for body in bodies for frame in (body.centre, body.at((0.1, -0.2, 0.3)))]
    expected = [run[place] for place in places]
    model_again, run_again, places_again = pickle.loads(pickle.dumps((model, run, places)))
    for other in (
        run_again,
        model_again.simulate(0.1, start, samples=3),
        copy.deepcopy(model_again).simulate(0.1, start, samples=3),
    ):
        assert np.array_equal(other.x, run.x)
    for place, again, values in zip(places, places_again, expected, strict=True):
        assert np.array_equal(run[place], values) and np.array_equal(run_again[again], values)


FITTING = {"lower": -1.0, "static": 0.9, "mu": 0.5, "restitution": 0.4, "half_angle": 0.5, "tube": 0.3, "holding": 3.0}
"""Arguments of parts that cannot be one."""


def with_a_parameter(cls: type, name: str) -> tuple[Any, ac.Parameter] | None:
    """A part with a parameter in one argument, in the shape that it takes there; None where it takes none."""
    names = [n for n, p in inspect.signature(cls).parameters.items() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    needed = [n for n in names if inspect.signature(cls).parameters[n].default is inspect.Parameter.empty]
    for count in (1, 3, 6):
        parameter = ac.Parameter(FITTING.get(name, 1.0))
        given = {n: FITTING.get(n, 1.0) for n in needed} | {name: parameter if count == 1 else (parameter,) * count}
        try:
            return cls(**given), parameter
        except (AcausalError, TypeError, AttributeError, ValueError):
            continue
    return None


def test_parts_with_parameters_in_them_are_pickled_whatever_is_asked_of_these():
    count = 0
    for name in components.__all__:
        cls = getattr(components, name)
        for argument in inspect.signature(cls).parameters:
            made = with_a_parameter(cls, argument)
            if made is not None:
                part, parameter = pickle.loads(pickle.dumps(made))
                assert type(part) is cls and parameter.value == made[1].value
                count += 1
    assert count > 120
