"""Common subexpressions are eliminated without mixing up symbols that share a name."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.numerics.folding import folded, folded_function
from components import Capacitor, Ground, Resistor, VoltageSource


@pytest.mark.parametrize("name", ["p", "q"])
def test_symbols_of_one_name_stay_apart_where_something_folds(name):
    a, b, c, e = (ca.SX.sym(name) for _ in range(4))
    x1, x2 = a + b / c, a + b / c
    value = (x1 / x2) * b + e
    function = folded_function("f", [a, b, c, e], [value], ["a", "b", "c", "e"], ["y"])
    assert float(function(1.1, 1.2, 1.3, 1.5)) == pytest.approx(2.7, abs=1e-15)
    assert function.name_in() == ["a", "b", "c", "e"] and function.name_out() == ["y"]
    assert float(ca.Function("f", [a, b, c, e], [folded(value)])(1.1, 1.2, 1.3, 1.5)) == pytest.approx(2.7, abs=1e-15)
    assert function.n_instructions() < ca.Function("f", [a, b, c, e], [value]).n_instructions()


def test_functions_of_a_scene_with_many_parameters_agree_with_its_expressions():
    """A ladder of resistors that are parameters, all of one name inside."""
    rng = np.random.default_rng(2)
    scene = ac.System()
    scene.source, scene.ground, scene.load = VoltageSource(1.0), Ground(), Capacitor(1.0)
    scene.values = [ac.Parameter(v, "Ohm") for v in rng.uniform(0.5, 2, 6)]
    scene.parts_ = [Resistor(v) for v in scene.values]
    before = scene.source.pin_a
    scene.connect(scene.source.pin_b, scene.ground.pin)
    for k in range(0, 6, 2):
        rail, rung = scene.parts_[k : k + 2]
        scene.connect(before, rail.pin_a)
        scene.connect(rail.pin_b, rung.pin_a)
        scene.connect(rung.pin_b, scene.ground.pin)
        before = rung.pin_a
    scene.connect(before, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.ground.pin)
    model = ac.build(scene)
    s, values = model.system, rng.uniform(0.5, 2, 6)
    currents = [part.i for part in scene.parts_]
    plain = ca.Function("plain", [s.x, s.p], [ca.vertcat(*(s.solved[i] for i in currents))])
    found = np.array([float(y) for y in model.functions.output(*currents)(0.0, [0.3], [], values)])
    np.testing.assert_allclose(found, np.array(plain([0.3], values)).ravel(), rtol=1e-13)
