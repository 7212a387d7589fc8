"""The Whipple bicycle out of components, against published eigenvalues and an independent program."""

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from examples.bicycle import REFERENCE, Bicycle

# Meijaard, Papadopoulos, Ruina and Schwab (2007), table 2: weave, capsize and castering eigenvalues [1/s] by speed [m/s]
EIGENVALUES = {
    0.0: (3.131643247906, -3.131643247906, 5.530943717654, -5.530943717654),
    2.0: (2.682345175127 + 1.680662965907j, 2.682345175127 - 1.680662965907j, -3.071586456415, -8.673879848317),
    4.0: (0.413253315211 + 3.079108186032j, 0.413253315211 - 3.079108186032j, -1.429444273613, -12.158614265764),
    5.0: (-0.775341882196 + 4.464867713788j, -0.775341882196 - 4.464867713788j, -0.322866429004, -14.078389692798),
    8.0: (-2.693486835811 + 8.460379713969j, -2.693486835811 - 8.460379713969j, 0.143278797657, -20.279408943945),
}


@pytest.fixture(scope="module")
def bicycle() -> tuple[Bicycle, ac.Model]:
    scene = Bicycle()
    return scene, ac.build(scene)


def test_bicycle_has_three_freedoms_and_no_redundant_row(bicycle):
    _, model = bicycle
    assert model.degrees_of_freedom == 3
    assert model.system.x.numel() == 14
    assert model.system.constraints.redundant == ()
    assert not model.system.constraints.singular


def test_uncontrolled_bicycle_follows_the_reference(bicycle):
    """Manoeuvre M1: nonlinear, slightly unstable; the reference's digits end at 1e-12."""
    scene, model = bicycle
    run = model.simulate(5.0, scene.start(4.0, 0.05), rtol=1e-12)
    assert np.max(np.abs(scene.seen(run.at(list(REFERENCE))) - np.array(list(REFERENCE.values())))) < 1e-11
    assert run.energy_error() < 1e-12
    assert run.constraint_error() < 1e-12
    heights = run[scene.front_wheel.frame.position][:, 2], run[scene.front_wheel.frame.rotation][:, 2, 1]
    assert np.max(np.abs(heights[0] - 0.35 * np.sqrt(1 - heights[1] ** 2))) < 1e-13


@pytest.mark.parametrize("speed", EIGENVALUES)
def test_small_motions_have_the_published_eigenvalues(bicycle, speed):
    scene, model = bicycle
    linear = model.linearize(start=scene.start(speed))
    moving = np.sort_complex(np.array([value for value in linear.eigenvalues if abs(value) > 1e-3]))
    assert np.max(np.abs(moving - np.sort_complex(np.array(EIGENVALUES[speed])))) < 1e-10
    assert linear.constant


def test_rates_depend_neither_on_place_nor_on_heading(bicycle):
    _, model = bicycle
    s = model.system
    names = model.state_names
    absolute = [names.index(f"rear_contact.q[{k}]") for k in (0, 3, 4)]
    slopes = ca.Function("slopes", [s.t, s.x], [ca.jacobian(s.v_dot, s.x[absolute])])
    rng = np.random.default_rng(0)
    assert np.max(np.abs(np.array(slopes(0.0, 0.3 * rng.normal(size=14))))) == 0.0


def test_pushed_bicycle_settles_at_a_speed_between_weave_and_capsize(bicycle):
    """Stable between 4.29 and 6.02 m/s: at 5 m/s the wobble dies out, and its energy goes into forward motion."""
    scene, model = bicycle
    run = model.simulate(10.0, scene.start(5.0, 0.05), rtol=1e-10)
    lean = np.abs(run[scene.rear_contact.q][:, 1])
    assert np.max(lean[run.t > 9]) < 0.1 * np.max(lean)
    assert run[scene.rear_contact.v][-1, 1] > 5.0 / 0.3
