"""What leaves the model: C, readable equations, CasADi functions for optimisation."""

from __future__ import annotations

import json
import subprocess
import sys

import casadi as ca
import numpy as np
import pytest
import sympy as sp

import acausal as ac
from acausal.export.c_source import compiler
from components import Particle, Prismatic, Revolute, RigidBody, Rod, Spring, World
from tests.scenes import DoublePendulum, FourBar, PointPendulum

MAIN = """
#include <stdio.h>
#include "model.h"
int main(void) {
  double t = 0.0, x[] = {X}, out[N];
  double none[1] = {0};
  const double* arg[64] = {&t, x, none, none};
  double* res[64] = {out};
  long long int iw[IW];
  double w[WW];
  if (explicit_dynamics(arg, res, iw, w, 0)) return 1;
  for (int i = 0; i < N; ++i) printf("%.17g\\n", out[i]);
  return 0;
}
"""


def test_exported_c_runs_without_python_and_agrees(tmp_path):
    """Compiled by a plain C compiler into a program of its own, it prints the numbers of the model."""
    scene = FourBar()
    model = ac.build(scene)
    folder = model.export_c(tmp_path / "fourbar")
    x = model.initial_state({scene.a.q: -0.5, scene.a.v: 3.0}).x
    f = model.functions.explicit_dynamics
    text = MAIN.replace("X", ", ".join(repr(float(v)) for v in x), 1).replace("N]", f"{x.size}]").replace("< N", f"< {x.size}")
    text = text.replace("IW", str(f.sz_iw() + 1)).replace("WW", str(f.sz_w() + 1))
    (folder / "main.c").write_text(text)
    found = compiler()
    assert found is not None
    subprocess.run(
        [*found, "-O1", "-std=c99", "-o", str(folder / "main"), str(folder / "main.c"), str(folder / "model.c"), "-lm"],
        check=True,
    )
    printed = subprocess.run([str(folder / "main")], check=True, capture_output=True, text=True).stdout
    assert np.max(np.abs(np.array(printed.split(), dtype=float) - np.array(f(0, x, [], [])).ravel())) < 1e-12
    assert json.loads((folder / "model.json").read_text())["states"] == list(model.state_names)
    assert "cc -O2" in (folder / "README.txt").read_text()


def test_exported_model_is_loaded_in_another_process(tmp_path):
    scene = DoublePendulum()
    model = ac.build(scene)
    model.export_c(tmp_path)
    code = f"import acausal as ac; m = ac.load_c({str(tmp_path)!r}); print(m.states, *m['explicit_dynamics'](0, [0.6, 0.3, 0.1, 0.2], [], []).full().ravel())"
    out = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    expected = np.array(model.functions.explicit_dynamics(0, [0.6, 0.3, 0.1, 0.2], [], [])).ravel()
    assert "shoulder.q" in out
    assert np.max(np.abs(np.array(out.split(")")[1].split(), dtype=float) - expected)) < 1e-14


@pytest.mark.parametrize("scene", [FourBar, DoublePendulum])
def test_loaded_functions_are_differentiable_twice(tmp_path, scene):
    model = ac.build(scene())
    loaded = ac.load_c(model.export_c(tmp_path))
    rng = np.random.default_rng(0)
    for name in ("explicit_dynamics", "residual_dynamics", "kinetic_energy", "constraint_position"):
        ours, theirs = getattr(model.functions, name), loaded[name]
        points = [ca.MX.sym(f"a{i}", ours.size1_in(i)) for i in range(ours.n_in())]
        w = ca.vertcat(*points)
        results = []
        for function in (ours, theirs):
            value = function(*points)
            total = ca.sumsqr(ca.sin(value))
            slopes = [ca.jacobian(value, w), ca.jtimes(value, w, w), ca.gradient(total, w), ca.hessian(total, w)[0]]
            results.append(ca.Function("all", points, slopes))
        at = [rng.normal(size=point.numel()) for point in points]
        for expected, found in zip(results[0](*at), results[1](*at), strict=True):
            assert np.max(np.abs(np.array(expected - found)), initial=0.0) < 1e-9 * (
                1 + np.max(np.abs(np.array(expected)), initial=0.0)
            )


def test_functions_of_two_models_stand_in_one_program(tmp_path):
    found = compiler()
    assert found is not None
    objects = []
    for name, scene in (("one", PointPendulum()), ("two", DoublePendulum())):
        folder = ac.build(scene).export_c(tmp_path / name)
        for source in ("model", "derivatives"):
            objects.append(str(folder / f"{source}.o"))
            command = [
                *found,
                "-Wall",
                "-Werror",
                f"-DMODEL_PREFIX={name}_",
                "-c",
                "-o",
                objects[-1],
                str(folder / f"{source}.c"),
            ]
            subprocess.run(command, check=True)
    (tmp_path / "main.cpp").write_text("""
        #define MODEL_PREFIX one_
        #include "one/model.h"
        #undef MODEL_PREFIX
        #define MODEL_PREFIX two_
        #include "two/model.h"
        int main() { return one_explicit_dynamics_n_in() + two_kinetic_energy_n_in() + (one_kinetic_energy_n_in == two_kinetic_energy_n_in); }
    """)
    program = tmp_path / "both"
    subprocess.run(["g++", "-Wall", "-Werror", "-o", str(program), str(tmp_path / "main.cpp"), *objects, "-lm"], check=True)
    model = ac.build(DoublePendulum())
    inputs = model.functions.explicit_dynamics.n_in() + model.functions.kinetic_energy.n_in()
    assert subprocess.run([str(program)], check=False).returncode == inputs


def test_loading_what_is_not_there(tmp_path):
    with pytest.raises(ac.errors.ExportError, match=r"no model\.c"):
        ac.load_c(tmp_path)
    model = ac.build(PointPendulum())
    loaded = ac.load_c(model.export_c(tmp_path / "p"))
    with pytest.raises(ac.errors.ExportError, match="explicit_dynamics"):
        _ = loaded["dynamics"]


def test_equation_of_the_planar_pendulum_is_that_of_the_textbook():
    scene = ac.System()
    scene.m, scene.L, scene.g = ac.Parameter(1.0, "kg"), ac.Parameter(1.0, "m"), ac.Parameter(9.81, "m/s^2")
    scene.world, scene.theta, scene.rod = World((0, 0, -scene.g)), Revolute("y"), RigidBody.rod(scene.m, (0, 0, -scene.L))
    scene.connect(scene.world.frame, scene.theta.frame_a)
    scene.connect(scene.theta.frame_b, scene.rod.frame)
    equations = ac.build(scene).equations()
    t, g, L = sp.Symbol("t"), sp.Symbol("g", positive=True), sp.Symbol("L", positive=True)
    q = sp.Function("q_theta")(t)
    assert equations.motion == (sp.Eq(q.diff(t, 2), -3 * g * sp.sin(q) / (2 * L)),)
    assert r"\sin" in equations.latex()


def test_equations_of_a_loop_are_lagranges_of_the_first_kind():
    """A bead with the coordinates x and z, held by a rod: m x'' = lambda x / L, m z'' = lambda z / L - m g."""
    scene = ac.System()
    scene.m, scene.L, scene.g = ac.Parameter(1.0, "kg"), ac.Parameter(1.0, "m"), ac.Parameter(9.81, "m/s^2")
    scene.world, scene.x, scene.z = World((0, 0, -scene.g)), Prismatic("x"), Prismatic("z")
    scene.bead, scene.rod = Particle(scene.m), Rod(scene.L)
    scene.connect(scene.world.frame, scene.x.frame_a)
    scene.connect(scene.x.frame_b, scene.z.frame_a)
    scene.connect(scene.z.frame_b, scene.bead.point)
    scene.connect(scene.world.frame, scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, scene.bead.point)
    equations = ac.build(scene).equations()
    t, (m, L, g) = sp.Symbol("t"), sp.symbols("m L g", positive=True)
    x, z, force = sp.Function("q_x")(t), sp.Function("q_z")(t), sp.Symbol("lambda_1")
    exact = m * x.diff(t, 2) - force * x / L, m * z.diff(t, 2) - force * z / L + m * g
    assert [sp.simplify(e.lhs - want) for e, want in zip(equations.motion, exact, strict=True)] == [0, 0]
    (closed,) = equations.constraints
    assert sp.simplify(closed.lhs - (x**2 + z**2 - L**2) / (2 * L)) == 0
    assert "lambda_1" in str(equations)


def test_too_large_a_scene_is_not_printed():
    from tests.scenes import chain

    with pytest.raises(ac.errors.ExportError, match="too large"):
        ac.build(chain(12)).equations()


def test_functions_by_name():
    """Mass matrix, energies and Jacobians are consistent with the dynamics; frames can be asked for."""
    scene = FourBar()
    model = ac.build(scene)
    f = model.functions
    x = model.initial_state({scene.a.q: -0.5, scene.a.v: 3.0}).x
    v = x[3:]
    M = np.array(f.mass_matrix(0, x, [], []))
    assert np.max(np.abs(M - M.T)) < 1e-14
    assert abs(0.5 * v @ M @ v - float(f.kinetic_energy(0, x, [], []))) < 1e-13
    A = np.array(f.constraint_jacobian(0, x, [], []))
    assert np.max(np.abs(A @ v - np.array(f.constraint_velocity(0, x, [], [])).ravel())) < 1e-14
    position, velocity, rotation, angular = f.frame_kinematics(scene.coupler.tip)(0, x, [], [])
    assert rotation.shape == (3, 3)
    assert abs(float(ca.norm_2(position - f.output(scene.rocker.tip.position)(0, x, [], [])))) < 1e-14
    assert velocity.shape == angular.shape == (3, 1)


def test_gradients_through_a_whole_model_agree_with_differences():
    """d(energy)/d(parameter), through geometry and mass."""
    scene = ac.System()
    scene.k, scene.l0 = ac.Parameter(40.0), ac.Parameter(0.5)
    scene.world, scene.bob, scene.spring = World(), Particle(1.0), Spring(scene.k, scene.l0)
    scene.connect(scene.world.frame, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.bob.point)
    f = ac.build(scene).functions.explicit_dynamics
    p = ca.SX.sym("p", 2)
    x = [0.3, 0.4, -0.5, 0, 0, 0]
    J = np.array(ca.Function("J", [p], [ca.jacobian(f(0, x, [], p), p)])([40.0, 0.5]))
    h = 1e-6
    for i in range(2):
        d = h * np.eye(2)[i]
        central = (np.array(f(0, x, [], np.array([40, 0.5]) + d)) - np.array(f(0, x, [], np.array([40, 0.5]) - d))).ravel() / (
            2 * h
        )
        assert np.max(np.abs(J[:, i] - central)) < 1e-7
