"""What was decided by numbers: printed with its margin, and the same answer, or a refusal in words, wherever a call goes.

The law: a model built with some values of parameters and asked with others answers as one that is built with these, or refuses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

import acausal as ac
from acausal.errors import (
    AcausalError,
    AccuracyWarning,
    AssemblyError,
    LockedError,
    MasslessError,
    ParameterError,
    StartValueError,
)
from components import Gear, PrescribedMotion, Revolute, RigidBody, World
from tests.assembly_scenes import closed, five_bar
from tests.scenes import DoublePendulum, bennett_linkage


@dataclass(frozen=True)
class Asked:
    """A scene with the parameters to be changed, start values, what is looked at, and the joint that is driven."""

    scene: ac.System
    parameters: list[ac.Parameter]
    start: dict[ac.Expression, float | ac.near]
    seen: list[ac.Expression]
    driven: Revolute


def by_points(values: tuple[float, ...], others: tuple[float, ...]) -> Asked:
    """Rods between hinges through points about axes as they are at the sketch, first and last on the ground. Parameters where others have
    another value."""
    scene, n = ac.System(), len(values) // 6
    scene.world = World((0, 0, -9.81))
    scene.changed = [ac.Parameter(v) for v, w in zip(values, others, strict=True) if v != w]
    changed = iter(scene.changed)
    entries = [v if v == w else next(changed) for v, w in zip(values, others, strict=True)]
    triples = [tuple(entries[k : k + 3]) for k in range(0, 6 * n, 3)]
    at, along = triples[:n], triples[n:]
    scene.hinges = [Revolute(axis) for axis in along]
    scene.links = [
        RigidBody.rod(1.0 + 0.3 * k, tuple(b - a for a, b in zip(at[k], at[k + 1], strict=True)), radius=0.05)
        for k in range(n - 1)
    ]
    ends = [scene.world.at(at[0]), *(link.tip for link in scene.links)]
    begins = [*(link.frame for link in scene.links), scene.world.at(at[-1])]
    closed(scene, *zip(ends, scene.hinges, begins, strict=True))
    first = scene.hinges[0]
    return Asked(scene, scene.changed, {first.q: 0.2, first.v: 0.5}, [link.centre.position for link in scene.links], first)


def of_points(points: np.ndarray, axes: np.ndarray) -> tuple[float, ...]:
    return (*np.ravel(points).tolist(), *np.ravel(axes).tolist())


def four_bar(values: tuple[float, ...], _: object = None) -> Asked:
    """Crank, coupler, rocker, distance of the pivots [m], mass of the coupler [kg]."""
    scene = ac.System()
    sizes = [ac.Parameter(v, "m") for v in values[:4]]
    mass = ac.Parameter(values[4], "kg")
    scene.sizes, scene.mass, scene.world = sizes, mass, World((0, 0, -9.81))
    bodies = zip((1.0, mass, 1.5), sizes, strict=False)
    scene.crank, scene.bar, scene.rocker = (RigidBody.rod(m, (x, 0, 0)) for m, x in bodies)
    scene.a, scene.b, scene.c, scene.d = (Revolute("y") for _ in range(4))
    closed(
        scene,
        (scene.world.frame, scene.a, scene.crank.frame),
        (scene.crank.tip, scene.b, scene.bar.frame),
        (scene.bar.tip, scene.c, scene.rocker.tip),
        (scene.world.at((sizes[3], 0, 0)), scene.d, scene.rocker.frame),
    )
    start = {scene.a.q: -0.6, scene.a.v: 2.0, scene.d.q: ac.near(-0.6)}
    return Asked(scene, [*sizes, mass], start, [scene.bar.centre.position, scene.rocker.centre.position], scene.a)


def two_gears(values: tuple[float, ...], _: object = None) -> Asked:
    """Two gears beside one another between the same hinges."""
    scene = ac.System()
    scene.world, scene.ratios = World((0, 0, -9.81)), [ac.Parameter(v) for v in values]
    scene.a, scene.b = Revolute("y"), Revolute("y")
    scene.one, scene.two = RigidBody.rod(1.0, (0, 0, -1.0)), RigidBody.rod(1.0, (0, 0, -0.7))
    closed(scene, (scene.world.frame, scene.a, scene.one.frame), (scene.world.at((2, 0, 0)), scene.b, scene.two.frame))
    scene.gears = [Gear(ratio) for ratio in scene.ratios]
    for gear in scene.gears:
        scene.connect(scene.a.flange, gear.flange_a)
        scene.connect(scene.b.flange, gear.flange_b)
    return Asked(scene, scene.ratios, {scene.a.q: 0.3, scene.a.v: 0.4}, [scene.one.tip.position, scene.two.tip.position], scene.a)


Y = np.array([(0.0, 1.0, 0.0)] * 6)
SARRUS_AT = np.array([(0, 0, 0), (1, 0, 0.6), (0, 0, 1.2), (0, 0.1, 1.2), (0, 1.1, 0.6), (0, 0.1, 0)])
SARRUS = of_points(SARRUS_AT, np.array([(0, 1, 0)] * 3 + [(1, 0, 0)] * 3))
PLANAR = of_points(np.array([(0, 0, 0), (1, 0, 0.6), (0, 0, 1.2), (0.1, 0, 1.2), (1.1, 0, 0.6), (0.1, 0, 0)]), Y)
BENNETT_AT = np.array([(0, 0, 0), (0.5, np.sqrt(3) / 2, 0), (-1.2, 0, 0.6), (-2.0, 0, 0)])
BENNETT_ALONG = np.array([(0, 0, 1), (np.sqrt(3) / 4, -0.25, np.sqrt(3) / 2), (-0.3, np.sqrt(3) / 2, 0.4), (0, 1, 0)])
BENNETT = of_points(BENNETT_AT, BENNETT_ALONG)
WRONG = of_points(BENNETT_AT, BENNETT_ALONG + np.outer([0, 1, 0, 0], [0.1, 0, 0]))
FLAT = of_points(BENNETT_AT * [1, 0, 1], Y[:4])
GENERAL, EQUAL, LIGHT = (0.4, 0.95, 0.5, 0.9, 2.0), (0.4, 0.9, 0.4, 0.9, 2.0), (0.4, 0.9, 0.4, 0.9, 2e-5)

CASES: dict[str, tuple[Callable[..., Asked], tuple[float, ...], tuple[float, ...]]] = {
    "four-bar as parallelogram": (four_bar, GENERAL, EQUAL),
    "parallelogram as four-bar": (four_bar, EQUAL, GENERAL),
    "parallelogram with a light coupler": (four_bar, EQUAL, LIGHT),
    "four-bar in kilometres": (four_bar, GENERAL, (400.0, 900.0, 400.0, 900.0, 2.0)),
    "four-bar that cannot close": (four_bar, GENERAL, (0.4, 0.95, 0.5, 9.0, 2.0)),
    "four-bar that lies flat": (four_bar, GENERAL, (0.4, 0.4, 0.1, 0.9, 2.0)),
    "six hinges in a plane, as those of Sarrus": (by_points, PLANAR, SARRUS),
    "Bennett's linkage with a wrong twist": (by_points, BENNETT, WRONG),
    "Bennett's linkage in a plane": (by_points, BENNETT, FLAT),
    "a plane as Bennett's linkage": (by_points, FLAT, BENNETT),
    "Bennett's linkage, 1e5 times as large": (by_points, BENNETT, of_points(1e5 * BENNETT_AT, BENNETT_ALONG)),
    "equal gears that contradict": (two_gears, (2.0, 2.0), (2.0, 3.0)),
    "equal gears of another ratio": (two_gears, (2.0, 2.0), (-3.0, -3.0)),
}


def changed(asked: Asked, built: tuple[float, ...], wanted: tuple[float, ...]) -> dict[ac.Parameter, float]:
    """New values of all parameters, or of those that differ."""
    every = len(asked.parameters) == len(wanted)
    return dict(zip(asked.parameters, [w for v, w in zip(built, wanted, strict=True) if every or v != w], strict=True))


def joined(values: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.ravel(v) for v in values])


def answers(model: ac.Model, asked: Asked, parameters: dict[ac.Parameter, float]) -> dict[str, Callable[[], np.ndarray]]:
    """All questions that take parameters, as numbers to be compared."""
    start, seen, first = asked.start, asked.seen, next(iter(asked.start))
    given = {"parameters": parameters}
    soft = {key: value for key, value in start.items() if key is first}
    rest = {key: value for key, value in start.items() if isinstance(value, ac.near)}
    moved = lambda run: joined([run[e][-1] for e in seen])  # noqa: E731
    force = lambda: model.inverse_dynamics([0.0, 0.05], {asked.driven.q: 0.2 + ac.time}, [asked.driven], rest, **given)  # noqa: E731
    options = {"rtol": 1e-9, "compiled": False}
    return {
        "simulate": lambda: moved(model.simulate(0.05, start, samples=2, **options, **given)),
        "linearize": lambda: np.sort_complex(model.linearize(start, **given).eigenvalues),
        "equilibrium": lambda: joined([model.equilibrium(soft, **given)[e] for e in seen]),
        "inverse dynamics": lambda: force().series,
        "minimal": lambda: moved(model.minimal(start, **given).simulate(0.02, samples=2, **options)),
        "assembly": lambda: np.array(model.assembly_function(seen[0], first, start, **given)(start[first] + 0.01)),
        "reactions": lambda: np.array(model.assembly_function(asked.driven.frame_b.force, first, start, **given)(start[first])),
        "sensitivities": lambda: model.sensitivities([0, 0.02], [first], start, **options, **given).total_derivative(seen[0])[1],
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_other_parameters_answer_as_a_model_built_with_them_or_are_refused(name):
    make, built, wanted = CASES[name]
    here, there = make(built, wanted), make(wanted, built)
    model = ac.build(here.scene)
    try:
        other = answers(ac.build(there.scene), there, {})
    except AcausalError as refused:
        other = dict[str, Callable[[], np.ndarray]]()
        print(refused)
    right = 0
    long = {"minimal", "sensitivities", "reactions"} if make is by_points and len(here.parameters) > 1 else set[str]()
    for question, answer in answers(model, here, changed(here, built, wanted)).items():
        if question in long:
            continue
        try:
            want = other[question]()
        except (KeyError, AcausalError):
            with pytest.raises(AcausalError):
                answer()
            continue
        found = answer()
        np.testing.assert_allclose(found, want, atol=1e-6 * np.max(np.abs(want)), err_msg=question)
        right += 1
    assert right > 3 or not other


def test_a_refusal_names_the_parameter():
    gears = two_gears((2.0, 2.0))
    for question, answer in answers(ac.build(gears.scene), gears, {gears.parameters[1]: 3.0}).items():
        with pytest.raises(ParameterError, match=r"ratio = 3.*built with 2"):
            answer()
        assert question
    bennett = by_points(BENNETT, WRONG)
    wrong = changed(bennett, BENNETT, WRONG)
    with pytest.raises(LockedError, match=r"With other values of .*is locked"):
        ac.build(bennett.scene).linearize(bennett.start, parameters=wrong)


def test_a_value_at_which_a_motion_meets_no_inertia_is_refused_by_name():
    """A thin rod of length zero is a point on its hinge."""
    asked = four_bar(GENERAL)
    model = ac.build(asked.scene)
    with pytest.raises(MasslessError):
        ac.build(four_bar((0.0, *GENERAL[1:])).scene)
    for answer in answers(model, asked, {asked.parameters[0]: 0.0}).values():
        with pytest.raises(ParameterError, match=r"= 0 m \(built with 0\.4\) no inertia resists .*joint 'a'"):
            answer()


def test_the_table_tells_rows_singular_positions_branches_and_pivots_with_their_margins():
    general, equal = (ac.build(four_bar(values).scene).decisions for values in (GENERAL, EQUAL))
    assert "2 of 2 constraints independent, 1 freedom left" in str(general) and "rocker" in str(general)
    assert "no singular position was met" in str(general) and "of 2 branches" in str(general)
    assert "passes singular positions, one of them at" in str(equal) and "a.q = 0" in str(equal)
    bennett = ac.build(bennett_linkage()).decisions
    assert "2 of 5 constraints independent" in str(bennett)
    assert "joints[2][0] (a shift across the axis), joints[2][3...4]" in str(bennett)
    follows = next(entry for entry in bennett if "follow" in entry.decided)
    assert follows.margin is not None and follows.margin < 1e-12 and follows.sure > 1e4
    gears = ac.build(two_gears((2.0, 2.0)).scene).decisions
    pivot = next(entry for entry in gears if "closed form" in entry.decided)
    assert pivot.about in ("a.q", "b.q") and pivot.margin in (0.5, 1.0, 2.0)
    assert "equation 1 of g" in str(gears) and "follows from other equations" in str(gears)
    assert "the structure alone determines everything" in str(ac.build(DoublePendulum()).decisions)


def test_margins_are_those_of_a_singular_value_decomposition():
    """Of a parallelogram's rows the smallest singular value grows from zero with its angle; away from it nothing is singular."""
    asked = four_bar(EQUAL)
    model = ac.build(asked.scene)
    c, values = model.system.constraints, model.system.p_values
    margins: list[float] = []
    for angle in (0.0, 1e-3, 1e-2):
        x = model.initial_state({asked.scene.a.q: -angle, asked.scene.d.q: ac.near(-angle)}).x
        margins.append(c.margins(x[: c.q_start.size], 0.0, values)[0].independent)
    assert margins[0] < 1e-9
    assert np.isclose(margins[2] / margins[1], 10.0, rtol=0.01)


def test_a_start_at_a_singular_position_beside_the_walk_is_looked_at():
    """Five bars stretched along a line: the velocities of more than two hinges are free there, and those given belong to no branch."""
    scene = five_bar()
    model = ac.build(scene)
    assert model.system.constraints.singular
    flat = {scene.hinges[0].q: 0.0, scene.hinges[1].q: 0.0}
    with pytest.raises(StartValueError, match="singular position"):
        model.simulate(0.5, {**flat, scene.hinges[0].v: 1.0, scene.hinges[1].v: 0.5}, compiled=False)
    beside = {scene.hinges[0].q: 0.1, scene.hinges[1].q: 0.1}
    assert model.simulate(0.1, beside, compiled=False, samples=2).functions is model.functions


def tilting(rate: float) -> ac.System:
    """A four-bar in a plane, whose far bearing tilts out of it with the time."""
    scene = ac.System()
    scene.world = World((0, 0, -9.81))
    scene.drive = PrescribedMotion(position=(0.9, 0, 0), angle=rate * ac.time**2, axis="x")
    scene.hinges = [Revolute("y") for _ in range(4)]
    points = np.array([(0, 0, 0), (0.1, 0, 0.4), (0.9, 0, 0.5), (0.9, 0, 0)])
    scene.links = [RigidBody.rod(1.0 + k, tuple(points[k + 1] - points[k]), radius=0.02) for k in range(3)]
    scene.connect(scene.world.frame, scene.drive.frame_a)
    ends = [scene.world.frame, *(link.tip for link in scene.links)]
    begins = [*(link.frame for link in scene.links), scene.drive.frame_b]
    return closed(scene, *zip(ends, scene.hinges, begins, strict=True))


def test_rows_that_vanish_at_the_time_of_the_build_only_are_not_forgotten():
    scene = tilting(0.3)
    model = ac.build(scene)
    with pytest.raises(AssemblyError, match="cannot close"):
        model.simulate(0.7, {scene.hinges[0].q: 0.01}, t0=0.5, compiled=False)
    with pytest.warns(AccuracyWarning, match="leaves its constraints.*It followed from the others where the loop was examined"):
        model.simulate(0.5, {scene.hinges[0].q: 0.01}, compiled=False)
    still = tilting(0.0)
    assert ac.build(still).simulate(0.6, {still.hinges[0].q: 0.01}, t0=0.5, compiled=False).constraint_error() < 1e-12


def test_functions_that_cannot_decide_again_say_that_what_they_hold_does_not():
    flat, bennett = by_points(FLAT, BENNETT), by_points(BENNETT, FLAT)
    model, other = ac.build(flat.scene), ac.build(bennett.scene)
    holds, step = model.functions.holds, model.step(h=1e-3)
    assert holds is not None
    for source, asked, good in ((model, flat, True), (other, bennett, False)):
        state = source.initial_state(asked.start)
        joints = dict(zip(source.state_names, state.x, strict=True))
        values = dict(zip(asked.parameters, (p.value for p in asked.parameters), strict=True))
        p = [values[asked.parameters[flat.parameters.index(parameter)]] for parameter in model.system.flat.parameters]
        x = [joints[name] for name in model.state_names]
        assert (float(holds(0, x, [], p)) >= 0) is good
        assert np.isfinite(float(step(0, x, [], p)[1])) == good
