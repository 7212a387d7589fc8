"""Symbols that say at once that they are no numbers: CasADi gives what it gave, and looks for numbers in them no longer."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

import acausal as ac

ASKED = """
import sys
{first}
import casadi as ca, json, numpy as np
found = []
for kind in (ca.SX, ca.MX):
    x, y = kind.sym("x", 3), kind.sym("y")
    f = ca.Function("f", [x, y], [x * y, ca.sin(x)])
    for made in (
        lambda: x + y, lambda: 2 * x, lambda: x - np.arange(3.0), lambda: np.eye(3) @ x, lambda: x.T @ x, lambda: ca.vertcat(x, 1.0, y), lambda: ca.horzcat(x, np.ones(3)),
        lambda: ca.jacobian(x * y, x), lambda: ca.substitute(x * y, y, 2.0), lambda: ca.if_else(y > 0, x, 0), lambda: f(x, 1.0), lambda: f(np.ones(3), 2.0),
        lambda: f(kind([1, 2, 3]), kind(2)), lambda: f.call([x, y]), lambda: ca.DM(kind(3)), lambda: ca.DM(x), lambda: ca.DM([x, y]), lambda: float(kind(3)), lambda: np.array(kind(3)),
        lambda: kind([[1.0, 2.0]]), lambda: ca.sum1(x), lambda: ca.solve(kind.eye(3) * y, x), lambda: ca.Function("g", [x], [y]), lambda: ca.vertcat("x", y),
        lambda: x[0] + x[np.array([1])], lambda: ca.mtimes([x.T, np.eye(3), x]), lambda: ca.evalf(kind(3) + 1), lambda: ca.diag(x), lambda: ca.norm_2(x),
        lambda: ca.bilin(np.eye(3), x, x), lambda: x == y, lambda: f({{"i0": x, "i1": y}}), lambda: kind(ca.DM.eye(2)) + x[:2], lambda: ca.vertsplit(x), lambda: None + x,
    ):
        try:
            given = made()
            found.append([type(given).__name__, str(given)])
        except Exception as error:
            found.append([type(error).__name__, str(error).split("\\n")[0]])
print(json.dumps(found))
"""


def test_casadi_gives_what_it_gave() -> None:
    """Kinds, formulas, numbers and errors of what is made of symbols, beside numbers, arrays and lists: in a process that has the package, and in one that has not."""
    with_it, without = (
        json.loads(
            subprocess.run([sys.executable, "-c", ASKED.format(first=first)], capture_output=True, text=True, check=True).stdout
        )
        for first in ("import acausal", "")
    )
    assert with_it == without
    assert len({kind for kind, _ in with_it}) > 5


@pytest.mark.parametrize(
    "make",
    [
        lambda x: x + x,
        lambda x: 2.0 * x,
        lambda x: ca.vertcat(x, x),
        lambda x: ca.mtimes(x, x),
        lambda x: ca.substitute(x, x, x),
        lambda x: ca.Function("f", [x], [x]).call([x]),
    ],
)
@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_no_numbers_are_looked_for_in_symbols(kind: type, make: Callable[[ca.SX], object]) -> None:
    """CasADi asks its own functions that read arrays, dense and sparse, for nothing."""
    assert ac.time.sx is not None
    x, asked = kind.sym("x"), list[str]()

    def seen(frame: object, event: str, _: object) -> None:
        name = frame.f_code.co_name  # pyright: ignore
        if event == "call" and name.startswith(("DM_from", "IM_from")):
            asked.append(name)

    sys.setprofile(seen)
    try:
        make(x)
    finally:
        sys.setprofile(None)
    assert not asked


def test_numbers_are_found_in_all_else() -> None:
    """Lists, arrays and sparse matrices are numbers as before."""
    import scipy.sparse as sp

    for given in ([1.0, 2.0], np.array([1.0, 2.0]), sp.csc_matrix(np.array([[1.0], [2.0]])), ca.DM([1.0, 2.0])):
        assert np.array(ca.vec(ca.SX.sym("x", 2) * 0 + given).is_constant())
        assert np.array_equal(np.array(ca.DM(given)).ravel(), [1.0, 2.0])
