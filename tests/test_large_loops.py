"""Many loops that hang together: sparse matrices decide and solve as singular values do, and the work grows with the size only."""

from __future__ import annotations

import numpy as np
import pytest

import acausal as ac
from acausal.numerics import assembly, independent
from acausal.numerics.independent import Independent, free_directions, rank_of
from tests.large_scenes import CrankRow, RodNet


def grid_rows(count, rng):
    """Directions of the rods of a crumpled net (m, n): rows of its constraints."""
    place = {(i, j): np.array([j, 0.0, -i]) + 0.2 * rng.normal(size=3) for i in range(-1, count) for j in range(count)}
    rods = [((i - 1, j), (i, j)) for i in range(count) for j in range(count)]
    rods += [((i, j - 1), (i, j)) for i in range(count) for j in range(1, count)]
    J = np.zeros((len(rods), 3 * count**2))
    for row, (one, other) in zip(J, rods, strict=True):
        for (i, j), sign in ((one, -1.0), (other, 1.0)):
            if i >= 0:
                row[3 * (count * i + j) :][:3] = sign * (place[other] - place[one])
    return J


@pytest.mark.parametrize("seed", range(3))
def test_plain_rows_say_what_singular_values_say(seed):
    rng = np.random.default_rng(seed)
    J = grid_rows(6 + seed, rng)
    J = J[rng.permutation(len(J))]
    _, s, Vt = np.linalg.svd(J)
    found, c = Independent.of(J), rng.normal(size=len(J))
    assert found is not None
    assert abs(found.smallest - s[-1]) < 1e-9 * s[-1]
    assert np.allclose(found.least(c), np.linalg.pinv(J) @ c, rtol=0, atol=1e-10)
    free, freedoms = free_directions(J, 1e-9)
    assert freedoms == J.shape[1] - len(J) == found.basis.shape[1]
    x, rest = rng.normal(size=J.shape[1]), Vt[len(J) :]
    assert np.allclose(free(x), (rest @ x) @ rest, rtol=0, atol=1e-10)
    assert np.allclose(found.basis @ found.basis.T, rest.T @ rest, rtol=0, atol=1e-10)
    weight = found.softest(1)[2][0]
    assert np.linalg.norm(weight @ J) < s[-1] * (1 + 1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_rows_that_follow_are_told_from_others_or_left_to_singular_values(seed):
    rng = np.random.default_rng(seed)
    J = grid_rows(6, rng)
    again = np.vstack([J, J[3] + 2 * J[5], np.zeros(J.shape[1])])[rng.permutation(len(J) + 2)]
    found = Independent.of(again)
    assert found is not None
    assert len(found.rows) == len(J) == rank_of(again, 1e-9)
    c = again @ rng.normal(size=J.shape[1])
    assert np.allclose(found.least(c), np.linalg.pinv(again, rcond=1e-9) @ c, rtol=0, atol=1e-10)
    for off in (1e-5, 1e-6, 1e-8, 1e-10):
        nearly = np.vstack([J, J[3] + off * rng.normal(size=J.shape[1])])
        assert Independent.of(nearly) is None
        assert rank_of(nearly, 1e-9) == len(J) + (off > 1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_least_squares_along_what_is_free_are_those_of_its_basis(seed):
    rng = np.random.default_rng(seed)
    J = grid_rows(6, rng)
    found, n = Independent.of(J), J.shape[1]
    assert found is not None
    for W in (np.diag(rng.uniform(0.1, 1.0, n)), rng.normal(size=(5, n)), np.eye(n)[:7]):
        r = rng.normal(size=len(W))
        step = found.least_along(r, W, np.inf, assembly._DAMPING)
        assert step is not None
        exact = -found.basis @ (np.linalg.pinv(W @ found.basis) @ r)
        assert np.max(np.abs(step - exact)) < 1e-5 * np.max(np.abs(exact))  # damped by 1e-8
        short = found.least_along(r, W, 0.01, assembly._DAMPING)
        assert short is not None
        assert np.max(np.abs(short)) <= 0.01
        assert np.max(np.abs(J @ short)) < 1e-9
        assert np.linalg.norm(r + W @ short) < np.linalg.norm(r)


@pytest.mark.parametrize("make", [lambda: CrankRow(5), lambda: RodNet(3)], ids=["cranks", "net"])
def test_large_loops_close_as_with_singular_values(make, monkeypatch):
    scene = make()
    start = {scene.feet[0].q: 0.5} if isinstance(scene, CrankRow) else {scene.knots[-1].point.velocity: ac.near((0, 0.3, 0))}
    exact = ac.build(scene)
    monkeypatch.setattr(independent, "LARGE", 0)
    sparse = ac.build(scene)
    assert exact.system.constraints.choice == sparse.system.constraints.choice
    assert np.max(np.abs(exact.system.constraints.q_start - sparse.system.constraints.q_start)) < 1e-6
    assert np.max(np.abs(exact.initial_state(start).x - sparse.initial_state(start).x)) < 1e-6


@pytest.mark.parametrize("count", [2, 3, 6, pytest.param(9, marks=pytest.mark.slow)])
def test_nets_of_rods_of_any_size_move(count):
    """None is locked, whatever its size: a rod takes one freedom, and its coordinates go as far as it is long."""
    scene = RodNet(count)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 3 * count**2 - len(scene.rods)
    assert np.max(np.abs(np.array(model.functions.invariants(0, model.initial_state().x, [], [])))) < 1e-13


def test_a_large_net_in_other_units_goes_through_the_same_numbers(monkeypatch):
    monkeypatch.setattr(independent, "LARGE", 0)
    one, other = (ac.build(RodNet(3, length)).initial_state().x for length in (0.1, 0.1 * 4.0**5))
    assert np.array_equal(4.0**5 * one, other)


def test_many_rows_that_follow_leave_as_many_steps(monkeypatch):
    """More rows than unknowns: least squares where columns are independent, and as many rows as are needed where they are not."""
    rng = np.random.default_rng(3)
    J = grid_rows(6, rng)
    wide = rng.normal(size=(2 * J.shape[1], len(J))) @ J
    tall = np.vstack([J, rng.normal(size=(J.shape[1], J.shape[1]))])
    for rows, c in ((wide, wide @ rng.normal(size=J.shape[1])), (tall, rng.normal(size=len(tall)))):
        for radius in (np.inf, 0.05):
            monkeypatch.setattr(independent, "LARGE", 0)
            assert assembly._plain_step(c, rows, radius, 1e-9) is not None
            step = assembly._step(c, rows, radius)
            monkeypatch.setattr(independent, "LARGE", 1e9)
            exact = assembly._step(c, rows, radius)
            assert np.max(np.abs(step)) <= radius
            if radius == np.inf:
                assert np.max(np.abs(step - exact)) < 1e-8 * np.max(np.abs(exact))


@pytest.mark.parametrize("count", [3, 4])
def test_a_flat_net_moves_in_its_plane_and_out_of_it(count):
    """All rods lie in one plane: rows hold across it to second order only, and are independent all the same."""
    scene = RodNet(count, rough=0.0)
    model = ac.build(scene)
    last = scene.knots[-1].point
    for velocity in ((0.3, 0.0, 0.0), (0.0, 0.3, 0.0)):
        run = model.simulate(0.5, {last.velocity: ac.near(velocity)}, rtol=1e-9, samples=7)
        assert run.energy_error() < 1e-11 and run.constraint_error() < 1e-13
        across = np.abs(run[last.position][:, 1])
        assert np.max(across) > 0.01 if velocity[1] else np.max(across) == 0.0
