"""C of CasADi functions against CasADi's virtual machine, the same bits for every width and compiler, and the cache of compiled code."""

from __future__ import annotations

import ctypes
import importlib.util
import itertools
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import erfinv

import acausal as ac
from acausal.emit import compiler, library
from acausal.emit.emit import Source, emit, translation_units
from acausal.errors import ExportError, NoCompilerWarning, NoRuntimeError
from acausal.integrators import automatic
from acausal.numerics import instructions
from acausal.numerics.instructions import BINARY, UNARY
from acausal.outputs import functions as lower
from acausal.runtime import kernels, load
from acausal.runtime.integrand import Integrand
from acausal.runtime.kernels import Compilation, How, Kernel, Wanted
from acausal.runtime.load import Runtime
from acausal.runtime.native import NativeProblem
from components import Spherical, TorqueSource
from tests.exported import made_once
from tests.scenes import FourBar, Pendulum, chain

Array = NDArray[np.float64]
Command = tuple[str, ...]

ROOT = Path(__file__).resolve().parent.parent
PLAIN = [(name,) for name in ("cc", "gcc", "clang") if shutil.which(name)][:1]
ZIG = [(sys.executable, "-m", "ziglang", "cc")] if importlib.util.find_spec("ziglang") else []
COMMANDS: list[Command] = PLAIN + ZIG
assert COMMANDS, "these tests need a C compiler"
COMMAND = COMMANDS[0]
every_compiler = pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[-2 if len(command) > 1 else 0])
EPS = 2.0**-52


@pytest.fixture(scope="module", autouse=True)
def common_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One cache for this file; the user's is not touched."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ACAUSAL_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache."""
    monkeypatch.setenv("ACAUSAL_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


# ---- calling ----


def _room(size: int) -> tuple[Array, Array]:
    """Aligned memory, and what lies behind it."""
    whole = np.full(size + 24, 7.25)
    start = -whole.ctypes.data % 64 // 8
    return whole[start : start + size], whole[start + size :]


def _evaluate(kernel: Kernel, points: Array, lanes: int) -> Array:
    """Results (outputs, n) at points (inputs, n); the constants are prepared for each group of lanes. n is a multiple of `lanes`."""
    sizes = (kernel.inputs, kernel.constants, kernel.outputs, kernel.work)
    (x, c, out, w), behind = zip(*(_room(size * lanes) for size in sizes), strict=True)
    assert points.shape[0] == kernel.inputs
    prepare, run = (ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(address) for address in (kernel.prepare, kernel.run))
    result = np.empty((kernel.outputs, points.shape[1]))
    for k in range(0, points.shape[1], lanes):
        x[:] = points[:, k : k + lanes].ravel()
        out[:], w[:] = np.nan, np.nan
        prepare(x.ctypes.data, c.ctypes.data, c.ctypes.data, w.ctypes.data)
        w[:] = np.nan
        run(x.ctypes.data, c.ctypes.data, out.ctypes.data, w.ctypes.data)
        result[:, k : k + lanes] = out.reshape(-1, lanes)
    assert all((b == 7.25).all() for b in behind), "a kernel wrote beyond the sizes it announces"
    return result


def _load(sources: Sequence[Source], lanes: int, command: Command = COMMAND, parts: int = 1) -> Callable[[str, Array], Array]:
    """(name, points) -> results of the sources at one width."""
    units = [f"#define LANES {lanes}\n{unit}" for unit in translation_units(sources, parts)]
    path = compiler.cached_library("\0".join(units), units, command=command)
    library = ctypes.CDLL(str(path))
    return lambda name, points: _evaluate(kernels._kernel(library, name), points, lanes)


def _machine(function: ca.Function, points: Array) -> Array:
    """The same by CasADi's virtual machine."""
    ends = np.cumsum([function.nnz_in(i) for i in range(function.n_in())])
    columns: list[Array] = []
    for point in points.T:
        parts = np.split(point, ends[:-1]) if ends.size else []
        arguments = [ca.DM(function.sparsity_in(i), part.tolist()) for i, part in enumerate(parts)]
        columns.append(np.array([v for result in function.call(arguments) for v in result.nonzeros()]))
    return np.array(columns).T


def _bits(x: Array) -> NDArray[np.uint64]:
    """Bits, with one NaN for all."""
    return np.where(np.isnan(x), np.nan, x).view(np.uint64)


def _ulps(got: Array, expected: Array) -> Array:
    with np.errstate(all="ignore"):
        unit = np.abs(np.spacing(np.where(np.isfinite(expected), expected, 1.0)))
        distance = np.abs(got - expected) / unit
    same = (got == expected) | (np.isnan(got) & np.isnan(expected))
    return np.where(same, 0.0, np.where(np.isnan(distance), np.inf, distance))


# ---- operations ----

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
SYNTAX = {ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_PARAMETER, ca.OP_CALL}


def _codes(expression: ca.SX) -> list[int]:
    f = ca.Function("f", [X, Y], [expression])
    return [f.instruction_id(k) for k in range(f.n_instructions())]


def _operations() -> dict[str, ca.SX]:
    """An expression of X and Y for each operation that stands in SX functions, by its name."""
    names = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}
    made = {name: ca.SX.binary(code, X, Y) for code, name in names.items() if code not in SYNTAX}
    return {name: e for name, e in made.items() if getattr(ca, f"OP_{name.upper()}") in _codes(e)}


HALVES = (-7.5, -2.5, -1.5, -0.5, 1.5, 2.5, 7.5)
POWERS = {f"power {n}": X**n for n in (*HALVES, -101, -8, -3, -1, 0, 0.5, 1, 2, 3, 8, 8.5, 9, 100, 101, 0.3, -0.3)}
MORE = {
    "two to the": 2**X,
    "minus two to the": ca.SX(-2.0) ** Y,
    "if_else": ca.if_else(X < Y, X, Y),
    "if_else of a number": ca.if_else(X, Y, -1),
    "exclusive or": ca.logic_or(ca.logic_and(X, ca.logic_not(Y)), ca.logic_and(ca.logic_not(X), Y)),
    "sine and cosine": ca.sin(X) * ca.cos(X),
}
ROUNDED = {
    "exp", "log", "pow", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "atan2",
    "erf", "erfinv", "log1p", "expm1", "hypot", *POWERS, "two to the", "minus two to the", "sine and cosine",
}  # fmt: skip
ZERO_OF_ANY_SIGN = ("fmin", "fmax")  # C leaves it open
# fmt: off
SPECIAL = [
    0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -5e-324, 2.0**-1022, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 0.5, -0.5, 1.5, -2.5,
    2.0**52, 2.0**53, -(2.0**53), 1e308, -1e308, 709.9, -745.2, 1 - 2.0**-53, -1 + 2.0**-53,
]
# fmt: on


def _arguments() -> Array:
    """Pairs (2, n): special ones, of like size, with a whole second, of all sizes."""
    rng, n = np.random.default_rng(1), 600
    special = np.array(list(itertools.product(SPECIAL, SPECIAL))).T
    wide = np.ldexp(rng.uniform(-1, 1, (2, n)), rng.integers(-300, 300, (2, n)))
    whole = np.array([rng.uniform(-3, 3, n), rng.integers(-9, 9, n)])
    points = np.hstack([special, rng.uniform(-3, 3, (2, n)), rng.uniform(-1, 1, (2, n)), whole, whole[::-1], wide])
    return points[:, : points.shape[1] // 8 * 8]


def _tolerance(name: str, x: Array, expected: Array) -> Array:
    """Units of the last place; infinite for products that stand for powers, of -inf and where they underflow."""
    if name not in ROUNDED:
        return np.zeros(x.size)
    exponent = float(name.split()[1]) if name in POWERS else 0.0
    bound = np.full(x.size, 4.0 if name == "sine and cosine" else 2.0 + (abs(exponent) if abs(exponent) <= 8 else 0.0))
    if exponent in HALVES:
        bound[(x == -np.inf) | ((expected > 0) & (expected < 2.0**-1022))] = np.inf
    return bound


@every_compiler
def test_operations_agree_with_the_virtual_machine(command: Command) -> None:
    """To two units of the last place, on any doubles; where both are zero, in sign too."""
    rows = {**_operations(), **POWERS, **MORE}
    del rows["printme"]
    f = ca.Function("f", [X, Y], [ca.vertcat(*rows.values())])
    points = _arguments()
    got, expected = _load([emit(f, "f")], 8, command)("f", points), np.array(f(points[:1], points[1:]))
    names = list(rows)
    x, y = points
    expected[names.index("erfinv")] = np.copysign(erfinv(x), x)  # the virtual machine's has four digits near one
    for i, name in enumerate(names):
        wrong = _ulps(got[i], expected[i]) > _tolerance(name, x, expected[i])
        if name not in ZERO_OF_ANY_SIGN:
            wrong |= (got[i] == 0) & (expected[i] == 0) & (np.signbit(got[i]) != np.signbit(expected[i]))
        at = np.flatnonzero(wrong)
        assert at.size == 0, (name, [(x[k], y[k], got[i, k], expected[i, k]) for k in at[:3]])


def test_printing_is_the_only_operation_of_sx_without_c() -> None:
    found, without = _operations(), set[str]()
    for name, expression in found.items():
        try:
            emit(ca.Function("f", [X, Y], [expression]), "f")
        except ExportError as error:
            assert name in str(error)
            without.add(name)
    assert len(found) > 40
    assert without == {"printme"}


def _calls() -> ca.Function:
    return ca.Function("f", [X], [ca.Function("g", [X], [ca.sin(X)], {"never_inline": True})(X)])


def _solves() -> ca.Function:
    x = ca.MX.sym("x", 2)
    return ca.Function("f", [x], [ca.solve(ca.diag(x) + 1, x, "qr")])


@pytest.mark.parametrize(
    ("function", "named"),
    [
        (_calls, "the operation call"),
        (_solves, "does not expand to SX .*LinsolQr"),
        (lambda: ca.Function("f", [X], [X * Y], {"allow_free": True}), "the operation parameter"),
        (lambda: ca.interpolant("table", "linear", [[0, 1]], [0, 1]), "the operation call"),
    ],
)
def test_what_has_no_c_is_refused_by_name(function: Callable[[], ca.Function], named: str) -> None:
    with pytest.raises(ExportError, match=f"'rhs' cannot be written as C: .*{named}"):
        emit(function(), "rhs")


@every_compiler
def test_mx_functions_are_expanded(command: Command) -> None:
    """Matrix products, norms, maps, a switch, sparse arguments and results."""
    A, x = ca.MX.sym("A", ca.Sparsity.lower(3)), ca.MX.sym("x", 3)
    square = ca.Function("square", [X], [X * X])
    choice = ca.Function.if_else("choice", ca.Function("one", [X], [ca.sin(X)]), ca.Function("other", [X], [-X]))
    results = [ca.mtimes(A, x), ca.norm_2(x), ca.mtimes(A, A.T), square.map(3)(x.T), choice(x[0] > 0, x[1]), 2 * A]
    f = ca.Function("f", [A, x], results)
    points = np.random.default_rng(2).normal(size=(9, 8))
    assert np.max(np.abs(_load([emit(f, "f")], 8, command)("f", points) - _machine(f, points))) < 1e-14


@pytest.mark.parametrize("seed", range(4))
def test_instructions_are_read_all_at_once_as_one_by_one(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of functions with several arguments and results, numbers of all kinds and operations drawn at random."""
    rng = np.random.default_rng(seed)
    arguments = [ca.SX.sym("x", int(size)) for size in rng.integers(1, 5, 3)]
    values = [*ca.vertsplit(ca.vertcat(*arguments)), ca.SX(0.0), ca.SX(-0.0), ca.SX(1e-310), ca.SX(np.inf), ca.SX(np.pi)]
    for code in rng.permutation([*UNARY, *BINARY, *BINARY, ca.OP_CONSTPOW]).tolist():
        one, other = (values[int(k)] for k in rng.integers(len(values), size=2))
        values.append(
            one**3.5 if code == ca.OP_CONSTPOW else ca.SX.unary(code, one) if code in UNARY else ca.SX.binary(code, one, other)
        )
    function = ca.Function("drawn", arguments, [ca.vertcat(*values[:9]), values[-1], ca.vertcat(*values[9:-1])])
    expected = instructions.one_by_one(function)
    monkeypatch.setattr(instructions, "one_by_one", None)
    found = instructions.instructions(function)
    assert found[0] == expected[0]
    numbers = [k for k, row in enumerate(found[0]) if row[0] == ca.OP_CONST]
    assert [found[1][k].hex() for k in numbers] == [function.instruction_constant(k).hex() for k in numbers]
    assert len(numbers) > 3


def test_equal_values_are_computed_once() -> None:
    """Sines and cosines of one argument that were made more than once share one call."""
    f = ca.Function("f", [X, Y], [ca.sin(X) + ca.sin(X) * ca.cos(X), ca.cos(X) - ca.sin(Y), Y * 2.0, 2.0 * ca.cos(X), ca.sin(X)])
    source = emit(f, "f")
    assert [source.pieces[-1].count(name) for name in ("v_sincos(", "v_sin(", "v_cos(")] == [1, 1, 0]
    points = np.random.default_rng(3).normal(size=(2, 8))
    assert np.max(np.abs(_load([source], 8)("f", points) - _machine(f, points))) < 4 * EPS


def test_constants_keep_their_bits() -> None:
    values = [0.0, np.inf, -np.inf, np.nan, 0.1, 5e-324, -5e-324, 1.7976931348623157e308]
    f = ca.Function("f", [X], [ca.vertcat(*values), ca.vertcat(*(ca.copysign(X, value) for value in values))])
    points = np.ones((1, 1))
    assert (_bits(_load([emit(f, "f")], 1)("f", points)) == _bits(_machine(f, points))).all()


# ---- graphs ----

Rounding = Callable[[ca.SX], ca.SX]
STEPS: dict[str, Callable[..., ca.SX]] = {
    "sum": lambda r, a, b, c: r(a + b),
    "difference": lambda r, a, b, c: r(a - b),
    "product": lambda r, a, b, c: r(a * b),
    "product and sum": lambda r, a, b, c: r(r(a * b) + c),
    "product less": lambda r, a, b, c: r(r(a * b) - c),
    "less a product": lambda r, a, b, c: r(c - r(a * b)),
    "less a square": lambda r, a, b, c: r(c - r(a * a)),
    "quotient": lambda r, a, b, c: r(a / r(1.5 + r(b * b))),
    "root": lambda r, a, b, c: r(ca.sqrt(r(1 + r(a * a)))),
    "power": lambda r, a, b, c: r(r(1 + r(a * a)) ** -1.5),
    "bell": lambda r, a, b, c: r(ca.exp(-r(a * a))),
    "sine and cosine": lambda r, a, b, c: r(r(ca.sin(a)) + r(ca.cos(a))),
    "sine": lambda r, a, b, c: r(ca.sin(a)),
    "cosine": lambda r, a, b, c: r(ca.cos(a)),
    "angle": lambda r, a, b, c: r(ca.atan2(a, r(1.5 + r(b * b)))),
    "choice": lambda r, a, b, c: ca.if_else(a < b, a, c),
    "least": lambda r, a, b, c: ca.fmin(a, ca.fmax(b, c)),
    "steps": lambda r, a, b, c: r(ca.floor(3 * a) + b),
    "twice": lambda r, a, b, c: 2 * a,
}


@dataclass(frozen=True)
class Graph:
    """A function, and the first-order bound of what an error of one unit in each of its operations does to its results."""

    function: ca.Function
    rounding: ca.Function


def _graph(seed: int, steps: int = 150) -> Graph:
    """Random operations on a vector, a sparse matrix and parameters; sparse, constant, empty and unchanged results."""
    rng = np.random.default_rng(seed)
    x, A, p = ca.SX.sym("x", 4), ca.SX.sym("A", ca.Sparsity.lower(3)), ca.SX.sym("p", 3)
    arguments = [x, ca.SX.sym("none", 0), A, ca.SX.sym("unused", 2), p]
    leaves = [*ca.vertsplit(ca.veccat(x, *A.nonzeros(), p)), ca.SX(0.7), ca.SX(-1.3)]
    exact, rough, deltas = list(leaves), list(leaves), list[ca.SX]()

    def disturbed(value: ca.SX) -> ca.SX:
        deltas.append(ca.SX.sym("d"))
        return value * (1 + deltas[-1])

    for k in range(steps):
        chosen = STEPS[str(rng.choice(list(STEPS)))]
        at = [int(i) for i in rng.integers(max(0, len(exact) - 40) if k % 3 else 0, len(exact), 3)]
        for values, rounding in ((exact, lambda value: value), (rough, disturbed)):
            made = chosen(rounding, *(values[i] for i in at))
            values.append(rounding(ca.sin(made)) if k % 2 else made)
    pattern = ca.Sparsity.upper(3)
    ends = [-1, -2, -3, -7, -20, -60]
    results = [
        ca.SX(pattern, ca.vertcat(*(exact[i] for i in ends))), x, ca.SX(0, 1), ca.sparsify(ca.vertcat(1, 0, -2.5)),
        ca.vertcat(exact[-1], p[1], *(exact[len(leaves) + i] for i in range(6))),
    ]  # fmt: skip
    unmoved = [ca.SX(0)]
    loose = [*(rough[i] for i in ends), *unmoved * 6, rough[-1], *unmoved, *(rough[len(leaves) + i] for i in range(6))]
    d = ca.vertcat(*deltas)
    slope = ca.substitute(ca.jacobian(ca.vertcat(*loose), d), d, ca.DM.zeros(d.shape))
    bound = ca.Function("bound", arguments, [EPS * ca.densify(ca.sum2(ca.fabs(slope)))])
    return Graph(ca.Function("graph", arguments, results), bound)


@every_compiler
def test_random_graphs_agree_with_the_virtual_machine_however_they_are_cut(command: Command) -> None:
    """Up to rounding with the virtual machine; to the bit for all lengths of chunks, with and without hoisted parameters."""
    graphs = {f"g{seed}": _graph(seed) for seed in range(2 if command == COMMAND else 1)}
    ways = [(1, ()), (7, (0, 4)), (200, ()), (200, (0, 4))]
    sources = [
        emit(graph.function, f"{name}_{k}", parameters=parameters, chunk=chunk)
        for name, graph in graphs.items()
        for k, (chunk, parameters) in enumerate(ways)
    ]
    assert {source.constants > 0 for source in sources} == {True, False}
    run = _load(sources, 8, command, parts=2)
    for name, graph in graphs.items():
        points = np.random.default_rng(5).uniform(-2, 2, (15, 16))
        first, expected = run(f"{name}_0", points), _machine(graph.function, points)
        off = np.abs(first - expected) / (2 * _machine(graph.rounding, points) + 1e-300)
        assert np.max(off) < 1, f"{name}: result {np.unravel_index(np.argmax(off), off.shape)} is {np.max(off)} bounds off"
        for k, way in enumerate(ways):
            assert (_bits(run(f"{name}_{k}", points)) == _bits(first)).all(), (name, way)


EDGES: dict[str, tuple[list[ca.SX], list[ca.SX]]] = {
    "no operations": ([X], [X, ca.SX(3.0), X]),
    "no arguments": ([], [ca.vertcat(2.0, ca.sin(1.0))]),
    "no results": ([X], []),
    "empty results": ([X], [ca.SX(0, 1), ca.SX(3, 0), ca.SX(2, 2)]),
    "empty arguments": ([ca.SX.sym("n", 0), X, ca.SX.sym("m", 0, 3)], [ca.sqrt(X)]),
    "unused arguments": ([Y, X], [2 * X]),
    "a result of parameters only": ([X, Y], [ca.sin(Y), Y, X]),
}


@pytest.mark.parametrize("name", EDGES)
def test_functions_on_the_edge_agree(name: str) -> None:
    f = ca.Function("f", *EDGES[name])
    last = tuple(range(f.n_in()))[-1:]
    points = np.random.default_rng(6).uniform(1, 2, (sum(f.nnz_in(i) for i in range(f.n_in())), 4))
    run = _load([emit(f, "plain"), emit(f, "hoisted", parameters=last)], 4)
    expected = _machine(f, points).reshape(-1, 4)
    for kind in ("plain", "hoisted"):
        assert np.max(np.abs(run(kind, points) - expected), initial=0.0) < 2 * EPS


def test_work_on_parameters_is_hoisted() -> None:
    """What depends on parameters only is computed by `prepare`, what does not is computed by the function."""
    f = ca.Function("f", [X, Y], [ca.exp(ca.tan(Y)) * ca.sinh(X)])
    often, rare = emit(f, "f", parameters=(1,)), emit(f, "f", parameters=(0,))
    for source, inside in ((often, ["v_tan", "v_exp"]), (rare, ["v_sinh"])):
        prepare, run = source.pieces[-1].split("EXPORT void f(")
        assert source.constants == 1
        assert all((name in prepare) == (name in inside) for name in ("v_tan", "v_exp", "v_sinh"))
        assert all((name in run) != (name in inside) for name in ("v_tan", "v_exp", "v_sinh"))


# ---- models ----


def _motor(length: float = 1.2) -> ac.System:
    """A pendulum with parameters and an input."""
    mass = ac.Parameter(0.7, "kg")
    scene = Pendulum(ac.Parameter(length, "m"), mass)
    scene.mass = mass
    scene.torque = ac.Input("N*m")
    scene.motor = TorqueSource(scene.torque)
    scene.connect(scene.motor.flange, scene.hinge.flange)
    return scene


SCENES: dict[str, Callable[[], ac.System]] = {
    "motor": _motor, "four-bar": FourBar, "chain": lambda: chain(6), "balls": lambda: chain(3, lambda k: Spherical()),
}  # fmt: skip


@pytest.fixture(scope="module")
def models() -> dict[str, ac.Model]:
    return {name: ac.build(scene()) for name, scene in SCENES.items()}


def _points(function: ca.Function, n: int = 16) -> Array:
    return np.random.default_rng(7).uniform(0.2, 1.4, (sum(function.nnz_in(i) for i in range(function.n_in())), n))


@pytest.fixture(scope="module")
def bits_of_one_lane(models: dict[str, ac.Model]) -> dict[str, Array]:
    run = _load(_model_sources(models), 1)
    return {
        source.name: run(source.name, _points(f))
        for source, f in zip(_model_sources(models), _model_functions(models), strict=True)
    }


def _model_functions(models: dict[str, ac.Model]) -> list[ca.Function]:
    four = models["four-bar"].functions
    return [four.explicit_dynamics, four.projection, models["chain"].functions.explicit_dynamics]


def _model_sources(models: dict[str, ac.Model]) -> list[Source]:
    return [emit(f, f"f{i}") for i, f in enumerate(_model_functions(models))]


@pytest.mark.parametrize(
    ("command", "lanes"), [*((COMMAND, n) for n in (2, 4, 8)), *((other, 8) for other in COMMANDS[1:])], ids=str
)
def test_widths_and_compilers_give_the_same_bits(
    models: dict[str, ac.Model], bits_of_one_lane: dict[str, Array], command: Command, lanes: int
) -> None:
    run = _load(_model_sources(models), lanes, command)
    for (name, expected), function in zip(bits_of_one_lane.items(), _model_functions(models), strict=True):
        assert np.isfinite(expected).all()
        assert (_bits(run(name, _points(function))) == _bits(expected)).all(), name


def _product(function: ca.Function, arguments: Sequence[int]) -> ca.Function:
    """(all arguments, directions of some) -> derivative of the first result, by CasADi's forward mode."""
    at = [ca.MX.sym("a", function.sparsity_in(i)) for i in range(function.n_in())]
    along = {i: ca.MX.sym("d", function.sparsity_in(i)) for i in arguments}
    seeds = [along.get(i, ca.MX.zeros(function.sparsity_in(i))) for i in range(function.n_in())]
    value = function.call(at)
    return ca.Function("product", [*at, *along.values()], [ca.densify(function.forward(1).call([*at, *value, *seeds])[0])])


def _runtime() -> Runtime:
    """As it came with the package: compiling it takes longer than all of this file."""
    found = load.runtime()
    assert found is not None
    return found


def _kernels(model: ac.Model, how: How) -> Iterator[tuple[str, Kernel, ca.Function, int]]:
    """(name, kernel, the same function for the virtual machine, lanes) of all kernels of a model."""
    f = model.functions
    problem = NativeProblem(replace(f.integrand, clearance=None, unheld_exact=None), how, _runtime())
    yield "rhs", problem.kernels.current[0], f.explicit_dynamics, problem.lanes
    yield "jvp", problem.jvp.current[0], _product(f.explicit_dynamics, [1]), problem.lanes
    yield "variation", problem.variation.current[0], _product(f.explicit_dynamics, [1, 2, 3]), problem.lanes
    if f.projection is not None and f.invariants is not None:
        symbols = [ca.SX.sym("a", f.invariants.sparsity_in(i)) for i in range(4)]
        both = ca.Function("both", symbols, [f.projection(*symbols), f.invariants(*symbols)])
        yield "projection", problem.kernels.current[1], both, problem.lanes
        yield "projected", problem.variation.current[1], _product(f.projection, [1, 3]), problem.lanes


@pytest.mark.parametrize("name", SCENES)
def test_kernels_of_models_agree_with_the_virtual_machine(models: dict[str, ac.Model], name: str) -> None:
    """Dynamics, projection with invariants, and their derivatives."""
    for kind, kernel, function, lanes in _kernels(models[name], How.COMPILED):
        points = _points(function)
        expected = _machine(function, points)
        error = np.max(np.abs(_evaluate(kernel, points, lanes) - expected) / np.max(np.abs(expected), axis=0))
        assert error < 1e-12, (kind, error)


def _longest(source: Source) -> int:
    """Statements in the longest C function."""
    bodies = re.findall(r"\{\n(.*?)\n\}", "".join(source.pieces), re.DOTALL)
    return max(body.count(";\n") + 1 for body in bodies)


def test_source_grows_as_the_model_and_functions_do_not() -> None:
    """Chains of 10, 20, 40 links: as much text for each link, and no C function is long, so compiling takes linear time."""
    functions = [ac.build(chain(n)).functions.explicit_dynamics for n in (10, 20, 40)]
    sources = [emit(f, "rhs", parameters=(3,)) for f in functions]
    for sizes in ([lower.operations(f) for f in functions], [sum(map(len, source.pieces)) for source in sources]):
        assert abs((sizes[2] - sizes[1]) / (sizes[1] - sizes[0]) - 2) < 0.05, sizes
    assert max(map(_longest, sources)) < 1500
    assert sources[2].work < 0.1 * lower.operations(functions[2])
    units = translation_units(sources[2:], 4)
    assert len(units) > 1
    assert max(map(len, units)) < 1.5 * min(map(len, units))


# ---- the cache ----

SIMPLE = Wanted("simple", ca.Function("f", [X, Y], [X * X + Y]))


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[Sequence[str]]:
    """The commands of the compiler that are run from now on."""
    found: list[Sequence[str]] = []
    run = compiler.run_compiler

    def counted(command: Sequence[str], *patience: float) -> None:
        found.append(command)
        run(command, *patience)

    monkeypatch.setattr(compiler, "run_compiler", counted)
    return found


def _script(path: Path, *lines: str) -> Command:
    """A compiler that is a shell script; $COMPILE stands for a true one."""
    path.write_text("\n".join(["#!/bin/sh", *lines, ""]).replace("$COMPILE", f'exec {shlex.join(COMMAND)} "$@"'))
    path.chmod(0o755)
    return (str(path),)


def _files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def _value(command: Command = COMMAND) -> float:
    """3^2 + 1 by a kernel made by this compiler."""
    made = Compilation((SIMPLE,), command).result()
    assert made is not None
    return float(_evaluate(made[1][0], np.repeat([[3.0], [1.0]], 8, axis=1), _lanes(command))[0, 0])


def _lanes(command: Command) -> int:
    """Lanes of libraries that this compiler makes."""
    source = '#include "lanes.h"\nEXPORT const long lanes = LANES;\n'
    path = compiler.cached_library("lanes", [source], command=command)
    return ctypes.c_long.in_dll(ctypes.CDLL(str(path)), "lanes").value


def _process(code: str, cache: Path, **environment: str) -> subprocess.Popen[str]:
    """Python, in another process."""
    everything = {**os.environ, "ACAUSAL_CACHE": str(cache), "PYTHONPATH": str(ROOT), **environment}
    return subprocess.Popen(
        [sys.executable, "-c", code], env=everything, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def _printed(process: subprocess.Popen[str]) -> str:
    out, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    return out.strip()


def test_a_library_is_compiled_once(cache: Path, runs: list[Sequence[str]]) -> None:
    first, again = (Compilation((SIMPLE,), COMMAND).result() for _ in range(2))
    assert first is not None and again is not None
    assert len(runs) == len(_files(cache)) == 1
    assert bytes(first[1][0]) == bytes(again[1][0])


FOUR_BAR = """
import acausal as ac
from acausal.emit import compiler

from acausal.runtime.kernels import Compilation, Wanted
from tests.scenes import FourBar
f = ac.build(FourBar()).functions
wanted = [Wanted("rhs", f.explicit_dynamics, (3,)), Wanted("projection", f.projection, (3,))]
run = compiler.run_compiler
compiler.run_compiler = lambda *asked: (print("compiles"), run(*asked))
print(Compilation(tuple(wanted), compiler.compiler()).result()[1][0].outputs)
"""


def test_another_process_finds_the_library_of_an_equal_model(cache: Path) -> None:
    """Whatever the order of its sets."""
    found = [_printed(_process(FOUR_BAR, cache, PYTHONHASHSEED=seed)) for seed in ("1", "2")]
    assert found == ["compiles\n6", "6"]


def test_values_of_parameters_do_not_compile_again(cache: Path, runs: list[Sequence[str]]) -> None:
    """Of another scene that differs in them only, the kernels are the same."""
    library = _runtime()
    made = len(runs)
    for length in (1.2, 0.4, 1.2):
        f = ac.build(_motor(length)).functions
        NativeProblem(Integrand(f.explicit_dynamics), How.COMPILED, library)
    assert len(runs) == made + 1


def test_whatever_code_depends_on_compiles_again(
    cache: Path, runs: list[Sequence[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Function, hoisted arguments, name, headers, flags, compiler, its time of change; each once."""

    def grows(wanted: Wanted = SIMPLE, command: Command = COMMAND) -> bool:
        before = len(runs)
        for _ in range(2):
            Compilation((wanted,), command).result()
        return len(runs) == before + 1 == len(_files(cache))

    assert grows()
    assert grows(Wanted("simple", ca.Function("f", [X, Y], [X * X - Y])))
    assert grows(Wanted("simple", SIMPLE.function, (0,)))
    assert grows(Wanted("other", SIMPLE.function))
    wrapper = _script(tmp_path / "wrapper", "$COMPILE")
    assert grows(command=wrapper)
    os.utime(wrapper[0], ns=(1, 1))
    compiler.machine.cache_clear()
    assert grows(command=wrapper)
    with monkeypatch.context() as patch:
        patch.setattr(compiler, "FLAGS", (*compiler.FLAGS, "-DUNUSED"))
        assert grows()
    with monkeypatch.context() as patch:
        headers = Path(shutil.copytree(library.SOURCES, tmp_path / "runtime"))
        patch.setattr(library, "SOURCES", headers)
        for name in ("lanes.h", "vector_math.h"):
            with (headers / name).open("a") as file:
                file.write("/* changed */\n")
            assert not grows()  # this process has read them
            _read_again()
            assert grows()
    _read_again()
    assert not grows()


def _read_again() -> None:
    library.sources.cache_clear()
    kernels.made_with.cache_clear()


def test_a_header_that_is_edited_while_a_compiler_runs_does_no_harm(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was hashed is what is compiled: the library of the one text never stands under the name of the other."""
    headers = Path(shutil.copytree(library.SOURCES, tmp_path / "runtime"))
    monkeypatch.setattr(library, "SOURCES", headers)
    _read_again()
    command = _script(tmp_path / "editing", f"echo '#error edited' > {headers / 'lanes.h'}", "$COMPILE")
    try:
        assert _value(command) == 10.0
        _read_again()
        with pytest.raises(ExportError, match="edited"):
            Compilation((SIMPLE,), command).result()
    finally:
        monkeypatch.undo()
        _read_again()


SIMPLE_ALONE = """
import os, pathlib, time
import casadi as ca
from acausal.runtime.kernels import Compilation, Wanted
x, y = ca.SX.sym("x"), ca.SX.sym("y")
wanted = Wanted("simple", ca.Function("f", [x, y], [x * x + y]))
meeting = pathlib.Path(os.environ["MEETING"])
(meeting / str(os.getpid())).touch()
while len(list(meeting.iterdir())) < int(os.environ["CROWD"]):
    time.sleep(0.005)
print(Compilation((wanted,), (os.environ["CC"],)).result()[1][0].outputs)
"""


def _crowd(count: int, cache: Path, command: Command) -> list[subprocess.Popen[str]]:
    """Processes that wait for each other and then ask for `SIMPLE`."""
    meeting = cache.parent / "meeting"
    meeting.mkdir()
    return [_process(SIMPLE_ALONE, cache, CC=command[0], CROWD=str(count), MEETING=str(meeting)) for _ in range(count)]


def test_processes_may_compile_the_same_at_once(cache: Path, tmp_path: Path) -> None:
    """Four of them, and a slow compiler: all get a library, and one is left and nothing else."""
    slow = _script(tmp_path / "slow", f'echo "$*" >> {tmp_path / "log"}', "sleep 0.5", "$COMPILE")
    assert [_printed(process) for process in _crowd(4, cache, slow)] == ["1"] * 4
    assert len((tmp_path / "log").read_text().splitlines()) > 1, "nobody raced"
    assert len(_files(cache)) == 1
    assert _value(slow) == 10.0


def test_a_process_killed_while_it_compiles_does_no_harm(cache: Path, tmp_path: Path) -> None:
    """It leaves half a library in a folder of its own; the next one compiles again, by the same compiler."""
    halfway = ['while [ "$1" != -o ]; do shift; done', 'echo half > "$2"', "kill -9 $PPID"]
    command = _script(tmp_path / "compiler", *halfway)
    os.utime(command[0], ns=(1, 1))
    (killed,) = _crowd(1, cache, command)
    killed.communicate(timeout=60)
    assert killed.returncode == -9
    left = _files(cache)
    assert any("/library." in name for name in left)
    _script(tmp_path / "compiler", "$COMPILE")
    os.utime(command[0], ns=(1, 1))
    assert _value(command) == 10.0
    assert set(left) < set(_files(cache))


def test_what_compilers_write_on_the_way_goes_with_their_folder(cache: Path, tmp_path: Path) -> None:
    """Killed, they do not remove it."""
    command = _script(tmp_path / "compiler", f'echo "$TMPDIR" >> {tmp_path / "log"}', "$COMPILE")
    assert _value(command) == 10.0
    places = (tmp_path / "log").read_text().split()
    assert places and all(Path(place).parent == cache and not Path(place).exists() for place in places)


@pytest.mark.parametrize("place", ["file", "file/below"])
def test_a_cache_that_cannot_be_written_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("ACAUSAL_CACHE", str(tmp_path / place))
    with pytest.raises(ExportError, match=f"'{tmp_path / place}'.*ACAUSAL_CACHE"):
        Compilation((SIMPLE,), COMMAND).result()


def test_a_full_disk_leaves_nothing_behind(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(ExportError, match=r"No space left.*ACAUSAL_CACHE"):
        Compilation((SIMPLE,), COMMAND).result()
    assert _files(cache) == []


@pytest.mark.parametrize("damage", ["cut off", "one bit", "empty", "text", "folder"])
def test_a_damaged_library_is_made_anew(cache: Path, runs: list[Sequence[str]], damage: str) -> None:
    """Loaded, one that is cut off would end the process by a signal."""
    Compilation((SIMPLE,), COMMAND).result()
    (name,) = _files(cache)
    content = (cache / name).read_bytes()
    (cache / name).unlink()  # never changed in place: somebody may use it
    if damage == "folder":
        (cache / name).mkdir()
        with pytest.raises(ExportError, match="ACAUSAL_CACHE"):
            Compilation((SIMPLE,), COMMAND).result()
        return
    middle = len(content) // 2
    flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    (cache / name).write_bytes({"cut off": content[:middle], "one bit": flipped, "empty": b"", "text": b"not a library"}[damage])
    assert _value() == 10.0 and len(runs) == 3  # the other one is that of the lanes
    assert (cache / name).read_bytes() == content


def test_what_killed_processes_left_is_removed_a_day_later(cache: Path) -> None:
    for name, age in (("build-old", 2 * 86400), ("build-new", 60), ("mine", 2 * 86400)):
        (cache / name).mkdir(parents=True)
        os.utime(cache / name, (time.time() - age,) * 2)
    assert _value() == 10.0
    assert {"build-new", "mine"} <= set(_files(cache)) and "build-old" not in _files(cache)


def test_a_compiler_that_hangs_is_ended_with_what_it_started(cache: Path, tmp_path: Path) -> None:
    command = _script(tmp_path / "hanging", f"(sleep 1; touch {tmp_path / 'still there'}) & wait")
    with pytest.raises(ExportError, match=r"has not ended after 0\.2 s: .*hanging"):
        compiler.cached_library("hanging", [""], command=command, patience=0.2)
    assert _files(cache) == []
    time.sleep(1.2)
    assert not (tmp_path / "still there").exists()


def test_the_cache_may_be_named_from_here_or_from_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("ACAUSAL_CACHE", ".")
    assert _value() == 10.0
    monkeypatch.setenv("ACAUSAL_CACHE", "~/below")
    assert compiler.cache_folder() == tmp_path / "below"


# ---- compilers ----


def test_a_compiler_that_fails_is_quoted(cache: Path, tmp_path: Path) -> None:
    failing = _script(tmp_path / "failing", "echo licence expired >&2", "exit 3")
    with pytest.raises(ExportError, match=r"(?s)The C compiler failed: .*failing.*licence expired"):
        Compilation((SIMPLE,), failing).result()
    assert _files(cache) == []


@every_compiler
def test_wrong_c_is_reported_with_its_place(cache: Path, command: Command) -> None:
    with pytest.raises(ExportError, match=r"(?s)part0\.c:2.*error"):
        compiler.cached_library("wrong", ["\nint f( {\n"], command=command)
    assert _files(cache) == []


def test_a_compiler_that_does_not_know_the_processor_will_do(cache: Path, tmp_path: Path) -> None:
    old = _script(tmp_path / "old", 'case "$*" in *-march=native*) echo "unknown value native" >&2; exit 1;; esac', "$COMPILE")
    assert _value(old) == 10.0


def test_a_compiler_that_fails_once_does_not_change_the_number_of_lanes(cache: Path, tmp_path: Path) -> None:
    """Two libraries of different widths in one process would read each other's lanes."""
    mark = tmp_path / "mark"
    command = _script(tmp_path / "weak", f"if [ ! -e {mark} ]; then touch {mark}; echo out of memory >&2; exit 1; fi", "$COMPILE")
    with pytest.raises(ExportError, match="out of memory"):
        Compilation((SIMPLE,), command).result()
    assert _value(command) == 10.0


def test_no_mathematical_function_that_rounds_is_the_c_librarys() -> None:
    """C libraries differ in last bits, and some compilers bring their own."""
    texts = {name: re.sub(r"/\*.*?\*/", "", text.decode(), flags=re.S) for name, text in library.sources().items()}
    own = set(re.findall(r"#define (\w+)", texts["scalar_math.h"]))
    rounding = "sin cos tan asin acos atan atan2 exp exp2 expm1 log log2 log10 log1p pow cbrt hypot sinh cosh tanh fma erf tgamma"
    called = set(re.findall(rf"(?<![\w.])({'|'.join(rounding.split())})\(", "".join(texts.values())))
    assert {"hypot", "cos"} <= called <= own


_KEPT = (compiler.compiler, load.runtime, load._tried, load.compiled_runtime, automatic.warn_no_compiler)
"""What a process remembers of compilers."""


@pytest.fixture
def no_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A machine without any."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setitem(sys.modules, "ziglang", None)
    for function in _KEPT:
        function.cache_clear()
    yield
    for function in _KEPT:
        function.cache_clear()


@pytest.fixture
def nothing_built(monkeypatch: pytest.MonkeyPatch) -> None:
    """An installation without libraries of its own."""
    monkeypatch.setattr(load, "variants", lambda: ())


def _built(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Libraries of the package for all processors, those of this installation, or as one makes them."""
    known = [variant.file for variant in library.variants()]
    monkeypatch.setattr(library, "BUILT", folder)
    for variant, installed in zip(library.variants(), known, strict=True):
        if installed.exists():
            shutil.copyfile(installed, variant.file)
            continue
        options = (*variant.flags(COMMAND), *library.FLAGS, f"-DLANES={variant.lanes}", "-shared")
        line = [*COMMAND, *options, str(library.SOURCES / "runtime.c"), "-lm"]
        made = made_once(
            library.sources().values(), lambda made, line=line: compiler.run_compiler([*line, "-o", str(made)]), *options
        )
        shutil.copyfile(made, variant.file)


@pytest.mark.slow
def test_without_a_compiler_the_libraries_of_the_package_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """The one for this processor, with the bits of one that is compiled here; an edited source makes them strangers."""
    scene = FourBar()
    compiled = ac.build(scene).simulate(0.2, {scene.a.q: -0.5, scene.a.v: 3.0})
    lanes = _runtime().library.widest()
    _built(tmp_path, monkeypatch)
    request.getfixturevalue("no_compiler")
    assert compiler.compiler() is None
    found = load.runtime()
    assert found is not None and found.lanes == lanes
    run = ac.build(scene).simulate(0.2, {scene.a.q: -0.5, scene.a.v: 3.0})
    assert (run[scene.c.q] == compiled[scene.c.q]).all()
    monkeypatch.setattr(library, "sources_hash", lambda: "edited")
    load.runtime.cache_clear()
    assert load.runtime() is None


def test_without_compiler_and_libraries_casadis_integrators_run(no_compiler: None, nothing_built: None, tmp_path: Path) -> None:
    """It is said once; what needs the runtime says what is missing."""
    scene, other = FourBar(), Pendulum()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        run = ac.build(scene).simulate(0.2, {scene.a.q: -0.5, scene.a.v: 3.0}, rtol=1e-7)
        ac.build(other).simulate(0.2, {other.hinge.q: 0.3})
    assert [warning.category for warning in said] == [NoCompilerWarning]
    assert "ziglang" in str(said[0].message) and run.statistics.method == "cvodes"
    assert run.energy_error() < 1e-4
    with pytest.raises(NoRuntimeError, match=r"no C compiler was found.*method='cvodes'"):
        ac.build(other).simulate(0.2, {other.hinge.q: 0.3}, method="gauss")
    with pytest.raises(NoRuntimeError, match="ziglang"):
        ac.build(other).sensitivities([0.0, 0.1], [other.hinge.q], {other.hinge.q: 0.3})
    with pytest.raises(NoRuntimeError, match="ziglang"):
        ac.build(other).export_simulator(tmp_path / "motion", {other.hinge.q: 0.3})
    ac.build(other).export_c(tmp_path / "functions")


def test_the_compiler_is_the_one_that_is_asked_for(no_compiler: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """$CC before cc, and ziglang where there is nothing else."""
    _script(tmp_path / "cc", "$COMPILE")
    (mine,) = _script(tmp_path / "mine", "$COMPILE")
    for given, expected in ((None, "cc"), (mine, mine), ("missing", "cc")):
        compiler.compiler.cache_clear()
        monkeypatch.setenv("CC", given or "")
        assert compiler.compiler() == (expected,)
    (tmp_path / "cc").unlink()
    monkeypatch.setitem(sys.modules, "ziglang", sys)
    compiler.compiler.cache_clear()
    assert compiler.compiler() == (sys.executable, "-m", "ziglang", "cc")


def test_a_compiler_that_cannot_build_the_runtime_is_quoted(
    cache: Path, nothing_built: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For example without the C library's headers: the warning says what the compiler said, and CasADi integrates."""
    broken = tmp_path / "broken-cc"
    broken.write_text("#!/bin/sh\necho 'fatal error: math.h: No such file' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CC", f"{broken} -some -option")
    for function in _KEPT:
        function.cache_clear()
    try:
        assert compiler.compiler() == (str(broken), "-some", "-option")
        scene = Pendulum()
        with pytest.warns(NoCompilerWarning, match=r"math\.h: No such file"):
            run = ac.build(scene).simulate(0.2, {scene.hinge.q: 0.3})
        assert run.t[-1] == 0.2
    finally:
        for function in _KEPT:
            function.cache_clear()
