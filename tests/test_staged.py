"""Functions that solve linear systems on their way: in numbers, by programs and by compiled kernels with the same bits, and in symbols."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from acausal.numerics.staged import Staged, Systems, composed
from acausal.runtime.kernels import How, Kernels, Wanted
from acausal.runtime.load import Runtime, runtime
from tests.test_interpreter import _bits, kernel_values


def staged(n: int, m: int, damped: bool, seed: int) -> Staged:
    """(masks, x, p) -> x with answers of two systems, the second one of the first one's answers."""
    rng = np.random.default_rng(seed)
    masks, x, p = ca.SX.sym("masks", n), ca.SX.sym("x", n), ca.SX.sym("p", 2)
    G = rng.normal(size=(n, n - 1 if damped else n + 2))
    W = ca.SX(G @ G.T) + ca.diag(0.1 * ca.sin(x) ** 2) * (0 if damped else 1)
    keep = [
        [masks[i] * W[i, j] * (p[0] if i == j and not damped else 1) + (1 - masks[i] if i == j else 0) for j in range(n)]
        for i in range(n)
    ]
    M = ca.vertcat(*(ca.horzcat(*row) for row in keep))
    damping = 1e-6 * masks * ca.diag(W) if damped else None
    B = ca.horzcat(*(ca.SX(G @ rng.normal(size=G.shape[1])) * (p[1] + k) + ca.SX.zeros(n) for k in range(m)))
    B = ca.vertcat(*((masks[i] * B[i, :] + (1 - masks[i]) * (0.5 if i % 2 else 0)) for i in range(n)))
    systems, X = Systems().with_one(masks, M, B, damping)
    systems, Y = systems.with_one(masks, M, masks * (W @ X[:, 0]), damping)
    found = Staged.of("staged", [masks, x, p], [ca.vertcat(x * ca.sumsqr(Y), ca.vec(X), Y)], systems)
    assert isinstance(found, Staged)
    return found


@pytest.fixture(scope="module")
def library() -> Runtime:
    """The runtime."""
    found = runtime()
    assert found is not None
    return found


@pytest.mark.parametrize("n, m, damped", [(4, 1, False), (7, 2, False), (2, 1, True), (9, 2, True)])
def test_programs_and_kernels_solve_with_the_same_bits_what_symbols_solve(n: int, m: int, damped: bool, library: Runtime) -> None:
    """Whatever is active, also where lanes differ in that."""
    function = staged(n, m, damped, 10 * n + m)
    rng = np.random.default_rng(n)
    points = np.vstack([rng.integers(0, 2, (n, 40)), rng.normal(size=(n, 40)), 1.5 + 0 * rng.uniform(1, 2, (2, 40))])
    points[:n, :2] = [[0, 1]] * n
    ways = [Kernels((Wanted("staged", function, (2,)),), library, how) for how in (How.INTERPRETED, How.COMPILED)]
    found = [kernel_values(way.current[0], points, library) for way in ways]
    assert np.array_equal(_bits(found[0]), _bits(found[1]))
    alone = [kernel_values(ways[0].current[0], points[:, [k]], library) for k in range(40)]
    assert np.array_equal(np.hstack(alone), found[0])  # but for signs of zeros
    a, b, c = np.vsplit(points, [n, 2 * n])
    plain = np.array(function.plain(a, b, c))
    if damped:  # answers are least ones
        M = np.array([np.linalg.norm(plain, axis=0), np.linalg.norm(found[0], axis=0)])
        assert np.max(np.abs(M[0] - M[1]) / M[0].max()) < 1e-9
    assert np.max(np.abs(plain - found[0])) < 1e-9 * np.max(np.abs(plain))


@pytest.mark.parametrize(("n", "prepared"), [(4, 0), (4, 1), (5, 2), (8, 1)])
def test_systems_of_parameters_alone_and_of_answers_as_they_stand(n: int, prepared: int, library: Runtime) -> None:
    """Three of them in a row, each one's right side being the answers of that before; the first ones need nothing but parameters. By numpy."""
    t, x, p = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("p", n)
    systems, X, results = Systems(), ca.sin(p), list[ca.SX]()
    for k in range(3):
        y = p if k < prepared else x
        systems, X = systems.with_one(ca.SX.ones(n), (k + 3) * ca.SX.eye(n) + y @ y.T, X)
        results.append(X)
    turns = [ca.sin(p[0]) * x[0], ca.cos(p[0]) - x[0]]
    function = Staged.of("row", [t, x, p], [ca.vertcat(*results, *turns)], systems)
    assert isinstance(function, Staged)
    points, expected = np.random.default_rng(n).normal(size=(1 + 2 * n, 16)), []
    points[-n:] = points[-n:, :1]
    for point in points.T:
        right, found = np.sin(point[-n:]), list[float]()
        for k in range(3):
            y = point[-n:] if k < prepared else point[1 : n + 1]
            right = np.linalg.solve((k + 3) * np.eye(n) + np.outer(y, y), right)
            found += right.tolist()
        expected.append([*found, np.sin(point[-n]) * point[1], np.cos(point[-n]) - point[1]])
    for how in (How.INTERPRETED, How.COMPILED) if n == 5 else (How.INTERPRETED,):
        way = Kernels((Wanted("row", function, (2,)),), library, how)
        assert np.max(np.abs(kernel_values(way.current[0], points, library) - np.array(expected).T)) < 1e-14


def test_what_is_composed_needs_only_the_systems_of_its_results() -> None:
    """Of two functions."""
    one, other = staged(5, 1, False, 1), staged(5, 1, False, 2)
    both = composed("both", [one, other], lambda _, results: [results[1][0][:5]])
    assert isinstance(both, Staged)
    assert len(both.shapes) == 2
    given = [np.ones(5), 0.1 * np.arange(5), np.array([1.2, 0.4])]
    assert np.allclose(np.array(both.plain(*given)), np.array(other.plain(*given))[:5], rtol=1e-13)
