"""All states of a scene, those that are left when others follow, and coordinates of a chart: the same questions, the same answers."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import acausal as ac
from components import Spherical
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
    ac.load_c(minimal.export_c(tmp_path))


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
    assert np.max(np.abs(np.array(f.invariants(0.05, x_next, state.p)))) < 1e-12
    again = np.array(f.projection(0.05, x_next, state.p))
    np.testing.assert_allclose(again, np.array(x_next), rtol=1e-12, atol=1e-12)  # it is there to rounding
