"""Readable equations say what the compiled dynamics compute, at once, and without leftovers of rounding."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp

import acausal as ac
from acausal.parts.unit_quaternions import unit_quaternions
from components import (
    Force,
    Free,
    NonlinearSpring,
    Particle,
    Prismatic,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    TorqueSource,
    World,
)
from tests.analysis_scenes import Motor, Top
from tests.scenes import DoublePendulum, FourBar, Pendulum, chain
from tests.test_elimination import slider_crank, upright_disk
from tests.test_minimal import rolling_ball

T = sp.Symbol("t")


def triple_pendulum() -> ac.System:
    return chain(3, lambda k: Revolute("y"), (0, 0, -0.7), lambda k: RigidBody.rod(1.3, (0, 0, -0.7)))


def spatial_arm() -> ac.System:
    return chain(3, lambda k: Revolute("zyx"[k]), (0.1, 0.2, -0.7))


def driven_pendulums() -> ac.System:
    """Two pendulums in a list, each with a torque and a damper of its own."""
    scene = ac.System()
    scene.world = World()
    scene.hinges, scene.rods = [Revolute("y"), Revolute("y")], [RigidBody.rod(1.0, (0, 0, -1.0)) for _ in range(2)]
    scene.torques = [ac.Input("N*m"), ac.Input("N*m")]
    scene.motors = [TorqueSource(u) for u in scene.torques]
    scene.dampers, scene.still = [RotationalDamper(0.3), RotationalDamper(0.4)], RotationalGround()
    end = scene.world.frame
    for hinge, rod, motor, damper in zip(scene.hinges, scene.rods, scene.motors, scene.dampers, strict=True):
        scene.connect(end, hinge.frame_a)
        scene.connect(hinge.frame_b, rod.frame)
        scene.connect(motor.flange, hinge.flange)
        scene.connect(damper.flange_a, hinge.flange)
        scene.connect(damper.flange_b, scene.still.flange)
        end = rod.tip
    return scene


def dumbbell_in_orbit() -> ac.System:
    """Two ends of a free body are drawn to a centre: the gradient of gravity turns it."""
    scene = ac.System()
    scene.world, scene.free, scene.body = World(None), Free(), RigidBody(1.0, (0.2, 0.3, 0.4))
    scene.pulls = [NonlinearSpring(lambda r: -1.0 / r) for _ in range(2)]
    scene.connect(scene.world.frame, scene.free.frame_a)
    scene.connect(scene.free.frame_b, scene.body.frame)
    for pull, place in zip(scene.pulls, (0.3, -0.2), strict=True):
        scene.connect(scene.world.frame, pull.point_a)
        scene.connect(pull.point_b, scene.body.at((place, 0.1, 0)))
    return scene


def spring_beside(aside: float = -0.5) -> ac.System:
    """A slide beside the anchor of a spring, `aside` [m] from it to either side, and a push by how far that is."""
    scene = ac.System()
    scene.world, scene.slide, scene.bead = World((0, 0, 0)), Prismatic("x"), Particle(1.3)
    scene.aside, scene.spring = ac.Parameter(aside, "m"), NonlinearSpring(lambda r: 30 * (r - 1) ** 2)
    scene.push = Force((2 * np.abs(scene.aside) + 3 * np.sqrt(scene.aside**2), 0, 0))
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.bead.point)
    scene.connect(scene.world.at((0, scene.aside, 0)), scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.bead.point)
    scene.connect(scene.push.point, scene.bead.point)
    return scene


def motor() -> ac.System:
    return Motor(12.0, 1.5, 2e-3, 0.04, 1e-4, 2e-4)


SCENES: list[Callable[[], ac.System]] = [
    Pendulum, DoublePendulum, triple_pendulum, spatial_arm, Top, FourBar, slider_crank, driven_pendulums, dumbbell_in_orbit, rolling_ball,
    upright_disk, motor, spring_beside,
]  # fmt: skip


def identifier(path: str) -> str:
    return re.sub(r"\W+", "_", path).strip("_")


def numbers(model: ac.Model) -> dict[Any, float]:
    """What each symbol is at a state of the model, taken from its compiled functions."""
    s, rng = model.system, np.random.default_rng(3)
    first = model.initial_state()
    q = model.functions.space.expanded(0.0, first.x, first.p)[: s.nq] + (0.0 if s.constraints.loops else 0.3) * rng.normal(
        size=s.nq
    )
    x = np.concatenate([q, rng.normal(size=s.x.numel() - s.nq)])
    for item in s.tree_joints:  # quaternions of length 1
        rows = item.edge.joint.invariants(s.mechanics.tree.q[item.q], s.t)
        for k in unit_quaternions(rows, s.mechanics.tree.q[item.q]).values():
            x[item.q][k : k + 4] /= np.linalg.norm(x[item.q][k : k + 4])
    u = rng.normal(size=s.u.numel())
    at = ca.Function("at", [s.t, s.x, s.u, s.p], [s.x_dot, s.multipliers])
    x_dot, multipliers = (np.array(part).ravel() for part in at(0.0, x, u, s.p_values))
    found: dict[Any, float] = {T: 0.0} | {sp.Symbol(f"lambda_{k + 1}"): v for k, v in enumerate(multipliers)}
    for item in s.tree_joints:
        joint, name = item.edge.joint, identifier(item.edge.name)
        for kind, part in (("q", item.q), ("v", slice(s.nq + item.v.start, s.nq + item.v.stop))):
            size = part.stop - part.start
            for i, k in enumerate(range(part.start, part.stop)):
                symbol = sp.Function(f"{kind}_{name}" + (f"_{i + 1}" if size > 1 else ""))(T)
                found |= {symbol: x[k], symbol.diff(T): x_dot[k]}
                if kind == "q" and joint.q.size == joint.v.size:
                    found[symbol.diff(T, 2)] = x_dot[s.nq + item.v.start + i]
    for i, state in enumerate(s.scalar_states):
        symbol = sp.Function(identifier(model.functions.outputs.name(state)))(T)
        k = s.nq + s.tree_velocities + i
        found |= {symbol: x[k], symbol.diff(T): x_dot[k]}
    found |= {
        sp.Symbol(identifier(model.functions.outputs.name(p)), **{"positive" if p.value > 0 else "real": True}): p.value
        for p in s.flat.parameters
    }
    return found | {sp.Function(identifier(n))(T): v for n, v in zip(model.input_names, u, strict=True)}


def values(expressions: Sequence[Any], at: dict[Any, float]) -> np.ndarray:
    """The largest parts first: derivatives are replaced before what they are derivatives of. All at once, since making a function takes most of the time."""
    names = {symbol: sp.Symbol(f"n{i}") for i, symbol in enumerate(at)}
    plain = [sp.sympify(expression).xreplace(names) for expression in expressions]
    return np.array(sp.lambdify(list(names.values()), plain)(*at.values()), dtype=float)


def holds(left: Sequence[Any], right: Sequence[Any], at: dict[Any, float]) -> None:
    """Both sides are the same, to rounding of the terms of their differences."""
    terms = [sp.Add.make_args(a - b) for a, b in zip(left, right, strict=True)]
    found = values([*left, *right, *itertools.chain.from_iterable(terms)], at)
    n, ends = len(left), np.cumsum([0, *map(len, terms)])
    for k in range(n):
        size = np.abs(found[2 * n + ends[k] : 2 * n + ends[k + 1]]).sum()
        assert abs(found[k] - found[n + k]) < 1e-10 * size, (left[k], right[k])


@pytest.mark.parametrize("make", SCENES)
def test_the_compiled_dynamics_meet_them(make: Callable[[], ac.System]):
    model = ac.build(make())
    equations = model.equations()
    if model.functions.space.elimination.symbols:
        return  # the constants of integration have values for a motion only; another test has these
    at = numbers(model)
    both = (*equations.motion, *equations.kinematics)
    holds([equation.lhs for equation in both], [equation.rhs for equation in both], at)
    form = equations.matrices
    left = form.mass * form.velocities.diff(T) + form.coriolis * form.velocities + form.potential - form.forces
    holds(list(left), [sp.Integer(0)] * len(left), at)


@pytest.mark.parametrize("make", [DoublePendulum, triple_pendulum, spatial_arm, Top, FourBar])
def test_no_number_is_a_rounding_error(make: Callable[[], ac.System]):
    equations = ac.build(make()).equations()
    floats = {abs(float(n)) for e in equations.all for n in (e.lhs - e.rhs).atoms(sp.Float)}
    assert all(1e-9 < number < 1e9 and number != 1.0 for number in floats)


@pytest.mark.parametrize("make", [DoublePendulum, triple_pendulum, Top])
def test_mass_rate_less_twice_coriolis_is_skew(make: Callable[[], ac.System]):
    model = ac.build(make())
    form, at = model.equations().matrices, numbers(model)
    skew = values(list(form.mass.diff(T) - 2 * form.coriolis), at).reshape(form.mass.shape)
    assert np.max(np.abs(skew)) > 1e-3 and np.max(np.abs(skew + skew.T)) < 1e-13


def test_names_are_those_of_parts_in_a_form_that_programs_take():
    equations = ac.build(driven_pendulums()).equations()
    names = {str(f.func) for e in equations.all for f in (e.lhs - e.rhs).atoms(sp.Function) if f.args == (T,)}
    assert {"motors_0_torque", "q_hinges_0", "q_hinges_1"} <= names and all(name.isidentifier() for name in names)


def test_quaternions_have_their_kinematics():
    equations = ac.build(dumbbell_in_orbit()).equations()
    assert len(equations.kinematics) == 7 and "v_{free" in equations.latex()
    assert equations._repr_latex_().startswith("$")
