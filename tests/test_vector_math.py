"""vector_math.h against mpmath: ulp bounds over the whole range of doubles, special values, the same bits for every width."""

from __future__ import annotations

import ctypes
import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal.export.c_source import compiler

Array = NDArray[np.float64]


RUNTIME = Path(acausal.__file__).parent / "runtime"
FLAGS = ["-std=gnu11", "-fno-math-errno", "-ffp-contract=off", "-fPIC", "-shared", "-Wall", "-Wextra", "-Wno-psabi", "-Werror"]
NATIVE = "-march=native"
LANES = (1, 2, 4, 8)
# fmt: off
UNARY = [
    "sin", "cos", "sincos_s", "sincos_c", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh",
    "exp", "expm1", "log", "log1p", "floor", "ceil", "sign", "erf", "erfinv",
]
BINARY = ["atan2", "pow", "hypot", "fmod", "remainder", "fmin", "fmax"]
# fmt: on

SOURCE = """
#include <math.h>
#include "lanes.h"
#include "vector_math.h"
#include "scalar_math.h"
static V v_total(V x) { return v_all(v_sum(x)); }
static V v_most(V x) { return v_all(v_largest(x)); }
static V v_power(V x, V y) { for (int i = 0; i < LANES; i++) x[i] = power(x[i], y[i]); return x; }
static V v_sincos_s(V x) { V s, c; v_sincos(x, &s, &c); return s; }
static V v_sincos_c(V x) { V s, c; v_sincos(x, &s, &c); return c; }
#define LOAD(v, p) __builtin_memcpy(&v, p + i, sizeof v)
#define STORE(p, v) __builtin_memcpy(p + i, &v, sizeof v)
#define UNARY(f) void f(long long n, const double *x, double *r) { \\
    for (long long i = 0; i < n; i += LANES) { V a, b; LOAD(a, x); b = v_##f(a); STORE(r, b); } }
#define BINARY(f) void f(long long n, const double *x, const double *y, double *r) { \\
    for (long long i = 0; i < n; i += LANES) { V a, b, c; LOAD(a, x); LOAD(b, y); c = v_##f(a, b); STORE(r, c); } }
"""


@dataclass(frozen=True)
class Build:
    """A shared library of all functions at one width."""

    functions: ctypes.CDLL

    def __call__(self, name: str, *args: Array) -> Array:
        pad = -args[0].size % 8
        padded = [np.ascontiguousarray(np.pad(a, (0, pad), constant_values=1.0)) for a in args]
        result = np.empty_like(padded[0])
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (*padded, result)]
        getattr(self.functions, f"t_{name}")(ctypes.c_longlong(result.size), *pointers)
        return result[: args[0].size]


def _source(folder: Path) -> Path:
    path = folder / "functions.c"
    renamed = SOURCE.replace("void f(", "void t_##f(")
    path.write_text(
        renamed
        + "".join(f"UNARY({f})\n" for f in [*UNARY, "total", "most"])
        + "".join(f"BINARY({f})\n" for f in [*BINARY, "power"])
    )
    return path


def _start(command: list[str], lanes: int, extra: list[str], source: Path, library: Path) -> subprocess.Popen[str]:
    line = [*command, *FLAGS, *extra, f"-DLANES={lanes}", f"-I{RUNTIME}", "-o", str(library), str(source)]
    return subprocess.Popen(line, stderr=subprocess.PIPE, text=True)


def _finish(process: subprocess.Popen[str], library: Path) -> Build:
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    return Build(ctypes.CDLL(str(library)))


@pytest.fixture(scope="module")
def builds(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Build]]:
    """The compiler's libraries: native8, ..., and plain1, ... without what this processor has beyond its base."""
    folder = tmp_path_factory.mktemp("vector_math")
    source, command = _source(folder), compiler() or []
    kinds = {f"native{n}": (n, ["-O2", NATIVE]) for n in LANES} | {f"plain{n}": (n, ["-O1"]) for n in (1, 8)}
    found: dict[str, Build] = {}
    for pair in (list(kinds)[i : i + 2] for i in range(0, len(kinds), 2)):
        running = {k: _start(command, *kinds[k], source, folder / f"{k}.so") for k in pair}
        found |= {k: _finish(p, folder / f"{k}.so") for k, p in running.items()}
    yield found


# ---- samples ----


def _powers(rng: np.random.Generator, low: float, high: float, n: int = 300, signed: bool = True) -> Array:
    """Magnitudes spread evenly in the exponent."""
    exponent = rng.uniform(low, high, n)
    whole = np.floor(exponent)
    values = np.ldexp(np.exp2(exponent - whole), whole.astype(int))
    return values * rng.choice([-1.0, 1.0], n) if signed else values


def _around(*points: float, steps: int = 3) -> Array:
    """Doubles next to the points, and the points."""
    base = np.array(points)
    found = [base]
    up = down = base
    for _ in range(steps):
        up, down = np.nextafter(up, np.inf), np.nextafter(down, -np.inf)
        found += [up, down]
    return np.concatenate(found)


def _quarter_turns(rng: np.random.Generator) -> Array:
    """Doubles next to multiples of pi/2, small and huge, and the one nearest of all to a multiple."""
    with mpmath.workprec(1300):
        small = [float(k * mpmath.pi / 2) for k in range(1, 120)]
        huge = [float(mpmath.floor(mpmath.mpf(2) ** float(e)) * mpmath.pi / 2) for e in rng.uniform(7, 1022, 120)]
    odd = [float(k * mpmath.pi / 4) for k in range(1, 60, 2)]
    return np.concatenate(
        [_around(*small, *odd, steps=1), huge, [math.ldexp(6381956970095103, 797), -math.ldexp(6381956970095103, 797)]]
    )


def _turns(rng: np.random.Generator) -> Array:
    parts = [rng.uniform(-1, 1, 200), rng.uniform(-1e4, 1e4, 300), _powers(rng, -1074, 1024), _powers(rng, 20, 70)]
    return np.concatenate([*parts, _quarter_turns(rng), _around(2.0**29, 2.0**30, -(2.0**30), 2.0**31), [1.7976931348623157e308]])


def _unit(rng: np.random.Generator) -> Array:
    near = _around(0.5, -0.5, 0.1715, 0.85, 0.75, -1 + 1e-15, 1 - 1e-15)
    ends = 1 - _powers(rng, -53, -1, signed=False)
    return np.concatenate([rng.uniform(-1, 1, 400), _powers(rng, -1074, 0), near, ends, -ends])


def _exponents(rng: np.random.Generator) -> Array:
    near = _around(
        *(k * math.log(2) / 2 for k in range(-9, 10, 2)), 1.0, 22.0, 26 * math.log(2), 40.0, -40.0, 708.0, -708.0, 709.78
    )
    parts = [rng.uniform(-1, 1, 200), rng.uniform(-40, 40, 200), rng.uniform(-708, 709, 100), _powers(rng, -1074, 3)]
    return np.concatenate([*parts, near, [709.782712893384, 709.7827128933841, 710.4, -745.1, -745.13, -745.14, -720.0, 710.475]])


def _positive(rng: np.random.Generator) -> Array:
    near = _around(*(2.0**k * math.sqrt(0.5) for k in range(-3, 4)), 1.0, 2.0, 2.0**-1022, 5e-324 * 4)
    parts = [rng.uniform(0.5, 2, 300), _powers(rng, -1074, 1024, 400, signed=False), 1 + _powers(rng, -52, -3)]
    return np.concatenate([*parts, near[near > 0], [1.7976931348623157e308, 5e-324]])


def _above_minus_one(rng: np.random.Generator) -> Array:
    near = _around(math.sqrt(2) - 1, math.sqrt(0.5) - 1, 1.0, 2.0**53, 2.0**60)
    parts = [
        rng.uniform(-1, 1, 300),
        _powers(rng, -1074, 0),
        _powers(rng, -3, 1024, signed=False),
        -1 + _powers(rng, -53, -1, signed=False),
    ]
    return np.concatenate([*parts, near])


def _above_one(rng: np.random.Generator) -> Array:
    near = _around(1.0625, 1.0606601717798212, 2.0**28, 2.0**26)
    parts = [
        rng.uniform(1, 1.1, 200),
        rng.uniform(1, 4, 200),
        _powers(rng, 0, 1024, signed=False),
        1 + _powers(rng, -52, -1, signed=False),
    ]
    return np.concatenate([*parts, near])


def _any_line(rng: np.random.Generator) -> Array:
    near = _around(0.25, 0.35355339059327373, 0.5, 1.0, 2.0, 2.0**-28, 2.0**28, 6.0, 0.85, 1.25)
    parts = [rng.uniform(-1, 1, 200), rng.uniform(-7, 7, 300), _powers(rng, -1074, 1024), _powers(rng, -10, 10)]
    return np.concatenate([*parts, near, -near])


def _plane(rng: np.random.Generator) -> tuple[Array, Array]:
    """Pairs: of like size, of every size, tiny and huge ones, on the borders between branches."""
    pairs = [(rng.uniform(-1, 1, 300), rng.uniform(-1, 1, 300))]
    for low, high in ((-1074, 1024), (-5, 5), (-1074, -1060), (-1074, -1000), (1000, 1024), (-420, -380), (380, 420)):
        pairs.append((_powers(rng, low, high, 100), _powers(rng, low, high, 100)))
    pairs.append((_powers(rng, -1074, -990, 100), _powers(rng, -40, 40, 100)))
    x = _powers(rng, -3, 3, 100)
    pairs += [(0.5 * x, x), (np.nextafter(0.5 * x, 9), -x), (x, -x), (x, np.nextafter(x, 9))]
    return np.concatenate([p for p, _ in pairs]), np.concatenate([q for _, q in pairs])


def _power_pairs(rng: np.random.Generator) -> tuple[Array, Array]:
    """Bases and exponents whose power is mostly in range, whole ones of negative bases among them."""
    x = np.concatenate([_powers(rng, -1074, 1024, 200, False), _powers(rng, -1, 1, 200, False), 1 + _powers(rng, -50, -2, 200)])
    y = rng.uniform(-745, 710, x.size) / np.where(x == 1, 1, np.log(x))
    whole = rng.integers(-40, 40, 200).astype(float)
    more = [
        (rng.uniform(-9, 9, 200), whole),
        (_powers(rng, -9, 9, 100, False), _powers(rng, -1074, 2, 100)),
        (_around(2.0, 0.5), _around(52.0, 53.0)),
    ]
    edge = (_around(math.sqrt(2), math.sqrt(0.5), steps=9), np.linspace(-2000, 2000, 38))
    return np.concatenate([x, *(p for p, _ in more), edge[0]]), np.concatenate([y, *(q for _, q in more), edge[1]])


# ---- accuracy ----

Reference = Callable[..., mpmath.mpf]


@dataclass(frozen=True)
class Case:
    reference: Reference
    samples: Callable[[np.random.Generator], Array | tuple[Array, Array]]
    bound: float


CASES = {
    "sin": Case(mpmath.sin, _turns, 0.85),
    "cos": Case(mpmath.cos, _turns, 0.85),
    "sincos_s": Case(mpmath.sin, _turns, 0.85),
    "sincos_c": Case(mpmath.cos, _turns, 0.85),
    "tan": Case(mpmath.tan, _turns, 1.1),
    "asin": Case(mpmath.asin, _unit, 0.7),
    "acos": Case(mpmath.acos, _unit, 0.7),
    "atan": Case(mpmath.atan, _any_line, 0.8),
    "sinh": Case(mpmath.sinh, _exponents, 0.75),
    "cosh": Case(mpmath.cosh, _exponents, 0.75),
    "tanh": Case(mpmath.tanh, _exponents, 0.8),
    "asinh": Case(mpmath.asinh, _any_line, 0.8),
    "acosh": Case(mpmath.acosh, _above_one, 0.7),
    "atanh": Case(mpmath.atanh, _unit, 0.7),
    "exp": Case(mpmath.exp, _exponents, 0.85),
    "expm1": Case(mpmath.expm1, _exponents, 1.3),
    "log": Case(mpmath.log, _positive, 0.75),
    "log1p": Case(mpmath.log1p, _above_minus_one, 0.75),
    "erf": Case(mpmath.erf, _any_line, 1.2),
    "erfinv": Case(mpmath.erfinv, _unit, 1.9),
    "atan2": Case(mpmath.atan2, _plane, 0.95),
    "pow": Case(mpmath.power, _power_pairs, 0.85),
    "hypot": Case(mpmath.hypot, _plane, 0.75),
}


def _ulps(got: float, exact: mpmath.mpf) -> float:
    """The error in units of the last place of the exact value; an overflow rounded to infinity counts as none."""
    if abs(exact) >= mpmath.ldexp(2**54 - 1, 970):
        return 0.0 if math.isinf(got) and (got > 0) == (exact > 0) else math.inf
    if not math.isfinite(got):
        return math.inf
    unit = math.ulp(min(abs(float(exact)), sys.float_info.max))
    if unit > 5e-324 and abs(exact) < mpmath.ldexp(unit, 52):
        unit /= 2  # float() rounded up to a power of two
    return float(abs(mpmath.mpf(got) - exact) / unit)


def _exact(name: str, args: list[float]) -> mpmath.mpf:
    if name == "erfinv":
        return _erfinv(args[0])
    return CASES[name].reference(*args)


def _erfinv(y: float) -> mpmath.mpf:
    """Newton from a double, for mpmath's own is slow: erfc near one, erf elsewhere."""
    a, x = abs(mpmath.mpf(y)), mpmath.mpf(0)
    w = -mpmath.log1p(-a * a)
    x = mpmath.sqrt(mpmath.sqrt((4.33 + w / 2) ** 2 - w / 0.147) - (4.33 - w / 2)) if a > 0.01 else a * mpmath.sqrt(mpmath.pi) / 2
    for _ in range(7):
        miss = mpmath.erf(x) - a if a < 0.5 else (1 - a) - mpmath.erfc(x)
        step = miss * mpmath.sqrt(mpmath.pi) / 2 * mpmath.exp(x * x)
        x -= step / (1 + x * step)
    return x if y > 0 else -x


@pytest.mark.parametrize("name", CASES)
def test_accuracy(builds: dict[str, Build], name: str) -> None:
    """Every width has the same bits (below), so one of each kind is compared."""
    case = CASES[name]
    drawn = case.samples(np.random.default_rng(20))
    args = list(drawn) if isinstance(drawn, tuple) else [drawn]
    results = [builds[k](name, *args) for k in ("native8", "plain1")]
    worst = [(0.0, "")] * len(results)
    with mpmath.workprec(140):
        for i, point in enumerate(zip(*(a.tolist() for a in args), strict=True)):
            if 0.0 in point:
                continue
            exact = _exact(name, list(point))
            for k, result in enumerate(results):
                error = _ulps(float(result[i]), exact)
                if error > worst[k][0]:
                    worst[k] = (error, f"{[v.hex() for v in point]}: {float(result[i])!r}")
    assert max(worst)[0] <= case.bound, worst


def test_powers_that_choose_steps_are_right_to_five_digits(builds: dict[str, Build]) -> None:
    rng = np.random.default_rng(5)
    x, y = (a.ravel() for a in np.meshgrid(_powers(rng, -1074, 1024, 200, False), rng.uniform(-20, 20, 20)))
    usual = np.abs(np.log2(x) * y) < 1020
    found = builds["native8"]("power", x, y)
    assert np.all(np.abs(found[usual] / x[usual] ** y[usual] - 1) < 1e-5)
    assert np.all(found[~usual & (np.log2(x) * y > 1024)] == np.inf)
    assert np.all(found[~usual & (np.log2(x) * y < -1074)] == 0)
    edges = {(0.0, 2.0): 0, (0.0, -2.0): np.inf, (np.inf, 2.0): np.inf, (np.inf, -2.0): 0, (0.0, 0.0): 1, (-1.0, 2.0): np.nan, (2.0, np.nan): np.nan, (np.nan, 1.0): np.nan}  # fmt: skip
    got = builds["native8"]("power", *(np.array(a) for a in zip(*edges, strict=True)))
    np.testing.assert_array_equal(got, list(edges.values()))


def test_lanes_come_together_in_pairs_and_no_nan_is_lost(builds: dict[str, Build]) -> None:
    x = _powers(np.random.default_rng(6), -30, 30, 64)
    for name, build in builds.items():
        lanes = int(name[-1])
        sums, most = x.reshape(-1, lanes), x.reshape(-1, lanes).max(axis=1)
        while sums.shape[1] > 1:
            sums = sums[:, ::2] + sums[:, 1::2]
        np.testing.assert_array_equal(build("total", x), np.repeat(sums[:, 0], lanes))
        np.testing.assert_array_equal(build("most", x), np.repeat(most, lanes))
        for place in range(lanes):
            with_one = x.copy()
            with_one[place] = np.nan
            assert np.isnan(build("most", with_one)[:lanes]).all()


# ---- exact functions and special values ----


def _bits(x: Array) -> NDArray[np.uint64]:
    """Bits, with one NaN for all: which NaN comes out of two is the compiler's choice."""
    return np.where(np.isnan(x), np.nan, x).view(np.uint64)


def _any_double(rng: np.random.Generator, n: int) -> Array:
    return rng.integers(0, 2**64, n, dtype=np.uint64).view(np.float64)


# fmt: off
SPECIAL = np.array([
    0.0, -0.0, math.inf, -math.inf, math.nan, 5e-324, -5e-324, 2.0**-1022, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 0.5, -0.5, 1.5, -2.5,
    2.0**52, 2.0**52 + 1, 2.0**53, -(2.0**53), 2.0**30, 1e308, -1e308, 1.7976931348623157e308, 709.9, -745.2, 1 - 2.0**-53,
])
# fmt: on


def _pairs(rng: np.random.Generator) -> tuple[Array, Array]:
    x, y = (a.ravel() for a in np.meshgrid(SPECIAL, SPECIAL))
    like = _powers(rng, -4, 4, 1000)
    a, b = (
        [x, _any_double(rng, 1000), like, _powers(rng, 0, 70, 1000)],
        [y, _any_double(rng, 1000), like[::-1], _powers(rng, -5, 5, 1000)],
    )
    c = _powers(rng, -1074, -1000, 1000)
    whole = rng.integers(-40, 40, 1000).astype(float)
    x, y = np.concatenate([*a, c, whole, 0.5 * whole]), np.concatenate([*b, c[::-1], np.ones(1000) * 4, whole[::-1]])
    ties, unit = np.repeat([0.5, 1.0, 1.5, 1.75, -1.5, 2.5], 3), np.tile([2.0**1023, 2.0**1021, 5e-324], 6)
    return np.concatenate([x, np.where(np.abs(ties) < 2, ties, 1) * unit]), np.concatenate([y, unit])


def _fmod(x: float, y: float) -> float:
    return math.nan if math.isinf(x) or y == 0 or math.isnan(x + y) else math.fmod(x, y)


def _remainder(x: float, y: float) -> float:
    return math.nan if math.isinf(x) or y == 0 or math.isnan(x + y) else math.remainder(x, y)


@pytest.mark.parametrize("kind", ["native8", "plain1"])
def test_remainders_are_exact(builds: dict[str, Build], kind: str) -> None:
    x, y = _pairs(np.random.default_rng(3))
    for name, reference in (("fmod", _fmod), ("remainder", _remainder)):
        expected = np.array([reference(a, b) for a, b in zip(x.tolist(), y.tolist(), strict=True)])
        wrong = np.flatnonzero(_bits(builds[kind](name, x, y)) != _bits(expected))
        assert wrong.size == 0, (name, x[wrong[0]].hex(), y[wrong[0]].hex())


def test_rounding_sign_and_extremes(builds: dict[str, Build]) -> None:
    rng, call = np.random.default_rng(4), builds["native8"]
    x = np.concatenate(
        [SPECIAL, _any_double(rng, 1000), _powers(rng, -3, 54, 1000), np.arange(-9, 9, 0.5), _around(0.5, 1.0, -1.0)]
    )
    assert (_bits(call("floor", x)) == _bits(np.floor(x))).all()
    assert (_bits(call("ceil", x)) == _bits(np.ceil(x))).all()
    sign = call("sign", x)
    assert (_bits(sign) == _bits(np.sign(x))).all()
    a, b = _pairs(rng)
    different = a != b
    assert (_bits(call("fmin", a, b)) == _bits(np.fmin(a, b)))[different].all()
    assert (_bits(call("fmax", a, b)) == _bits(np.fmax(a, b)))[different].all()
    zeros, swapped = np.array([0.0, -0.0, 0.0, -0.0]), np.array([-0.0, 0.0, 0.0, -0.0])
    assert np.signbit(call("fmin", zeros, swapped)).tolist() == [True, True, False, True]
    assert np.signbit(call("fmax", zeros, swapped)).tolist() == [False, False, False, True]


PI = math.pi
# function, argument(s), value: ISO C99, Annex F.9
SPECIAL_VALUES = f"""
sin 0 0; sin -0 -0; sin inf nan; sin -inf nan; sin nan nan; cos 0 1; cos -0 1; cos inf nan; cos nan nan
sincos_s -0 -0; sincos_c -0 1; sincos_s inf nan; sincos_c -inf nan; tan 0 0; tan -0 -0; tan inf nan; tan nan nan
asin 0 0; asin -0 -0; asin 1 {PI / 2}; asin -1 {-PI / 2}; asin 1.1 nan; asin -inf nan; asin nan nan
acos 1 0; acos -1 {PI}; acos 0 {PI / 2}; acos -0 {PI / 2}; acos -1.1 nan; acos inf nan; acos nan nan
atan 0 0; atan -0 -0; atan inf {PI / 2}; atan -inf {-PI / 2}; atan 1 {PI / 4}; atan nan nan
sinh 0 0; sinh -0 -0; sinh inf inf; sinh -inf -inf; sinh 711 inf; sinh -1e300 -inf; sinh nan nan
cosh 0 1; cosh -0 1; cosh inf inf; cosh -inf inf; cosh -711 inf; cosh nan nan
tanh 0 0; tanh -0 -0; tanh inf 1; tanh -inf -1; tanh 1e300 1; tanh nan nan
asinh 0 0; asinh -0 -0; asinh inf inf; asinh -inf -inf; asinh nan nan
acosh 1 0; acosh inf inf; acosh 0.9 nan; acosh -inf nan; acosh nan nan
atanh 0 0; atanh -0 -0; atanh 1 inf; atanh -1 -inf; atanh 1.1 nan; atanh inf nan; atanh nan nan
exp 0 1; exp -0 1; exp inf inf; exp -inf 0; exp 710 inf; exp -746 0; exp 1e300 inf; exp -1e300 0; exp nan nan; exp 5e-324 1
expm1 0 0; expm1 -0 -0; expm1 inf inf; expm1 -inf -1; expm1 -1e300 -1; expm1 710 inf; expm1 nan nan
log 1 0; log 0 -inf; log -0 -inf; log inf inf; log -1 nan; log -5e-324 nan; log -inf nan; log nan nan
log1p 0 0; log1p -0 -0; log1p -1 -inf; log1p -1.1 nan; log1p inf inf; log1p -inf nan; log1p nan nan
erf 0 0; erf -0 -0; erf inf 1; erf -inf -1; erf 7 1; erf nan nan
erfinv 0 0; erfinv -0 -0; erfinv 1 inf; erfinv -1 -inf; erfinv 1.1 nan; erfinv -inf nan; erfinv nan nan
atan2 0 1 0; atan2 -0 1 -0; atan2 0 -1 {PI}; atan2 -0 -1 {-PI}; atan2 0 0 0; atan2 -0 0 -0; atan2 0 -0 {PI}; atan2 -0 -0 {-PI}
atan2 1 0 {PI / 2}; atan2 -1 0 {-PI / 2}; atan2 1 -0 {PI / 2}; atan2 -1 -0 {-PI / 2}; atan2 5e-324 0 {PI / 2}; atan2 5e-324 5e-324 {PI / 4}
atan2 1 inf 0; atan2 -1 inf -0; atan2 1 -inf {PI}; atan2 -1 -inf {-PI}; atan2 inf 1 {PI / 2}; atan2 -inf -1 {-PI / 2}
atan2 inf inf {PI / 4}; atan2 -inf inf {-PI / 4}; atan2 inf -inf {3 * PI / 4}; atan2 -inf -inf {-3 * PI / 4}
atan2 0 inf 0; atan2 0 -inf {PI}; atan2 nan 1 nan; atan2 1 nan nan; atan2 nan inf nan; atan2 inf nan nan; atan2 1e300 -1e-300 {PI / 2}
hypot 0 0 0; hypot -0 -0 0; hypot -3 4 5; hypot inf nan inf; hypot nan -inf inf; hypot nan 1 nan; hypot 1e-320 0 1e-320; hypot 0 -1e308 1e308
hypot 1.7e308 1.7e308 inf; hypot inf 1 inf; hypot -inf -inf inf; hypot 3e-320 4e-320 5e-320
pow 0 3 0; pow -0 3 -0; pow 0 2.5 0; pow -0 2 0; pow -0 2.5 0; pow 0 -3 inf; pow -0 -3 -inf; pow 0 -2 inf; pow -0 -2 inf; pow -0 -0.5 inf
pow 0 inf 0; pow -0 -inf inf; pow 0 0 1; pow nan 0 1; pow inf -0 1; pow 1 nan 1; pow 1 inf 1; pow 1 -inf 1; pow -1 inf 1; pow -1 -inf 1
pow 2 inf inf; pow 2 -inf 0; pow 0.5 inf 0; pow -0.5 -inf inf; pow -2 inf inf; pow 0.5 -inf inf; pow inf 1 inf; pow inf -1 0
pow -inf 3 -inf; pow -inf 2 inf; pow -inf 2.5 inf; pow -inf -3 -0; pow -inf -2 0; pow -inf -2.5 0; pow inf inf inf; pow inf -inf 0
pow -8 0.3333333333333333 nan; pow -8 3 -512; pow -2 -3 -0.125; pow nan 1 nan; pow 2 nan nan; pow nan nan nan; pow -1 1e300 1; pow 2 1e300 inf
pow -2 9007199254740991 -inf; pow -2 -9007199254740991 -0; pow -1 9007199254740991 -1; pow -1 4503599627370497 -1; pow -1 9007199254740992 1
pow 2 1023 8.98846567431158e307; pow 2 1024 inf; pow 2 -1074 5e-324; pow 2 -1076 0; pow 5e-324 1 5e-324; pow 5e-324 -1 inf; pow 10 2 100
pow 3 5 243; pow 1.0000000000000002 1e300 inf; pow 0.9999999999999999 1e300 0; pow -5e-324 1 -5e-324; pow 7 5e-324 1; pow 5e-324 -5e-324 1
fmod 5 3 2; fmod -5 3 -2; fmod -6 3 -0; fmod 5 inf 5; fmod -0 1 -0; fmod inf 1 nan; fmod 1 0 nan; fmod 1 nan nan; fmod nan 1 nan
remainder 5 3 -1; remainder 5 2 1; remainder 7 2 -1; remainder -6 3 -0; remainder 5 -inf 5; remainder inf 1 nan; remainder 1 -0 nan
sign -0 0; sign 5e-324 1; sign -inf -1; sign nan nan; fmin nan 1 1; fmax 1 nan 1; fmin nan nan nan
"""


def _special_values() -> dict[str, list[tuple[list[float], float]]]:
    found: dict[str, list[tuple[list[float], float]]] = {}
    for entry in SPECIAL_VALUES.replace("\n", ";").split(";"):
        if words := entry.split():
            found.setdefault(words[0], []).append(([float(w) for w in words[1:-1]], float(words[-1])))
    return found


@pytest.mark.parametrize("kind", ["native8", "plain1"])
def test_special_values(builds: dict[str, Build], kind: str) -> None:
    for name, rows in _special_values().items():
        got = builds[kind](name, *(np.array(column) for column in zip(*(args for args, _ in rows), strict=True)))
        expected = np.array([value for _, value in rows])
        wrong = np.flatnonzero(_bits(got) != _bits(expected))
        assert wrong.size == 0, (name, [(rows[i], float(got[i])) for i in wrong])


# ---- the same bits everywhere ----


def _mixture(rng: np.random.Generator) -> tuple[Array, Array]:
    n = 4000
    x, y = _pairs(rng)
    raw, moderate, even = _any_double(rng, n), rng.uniform(-40, 40, n), _powers(rng, -40, 40, n)
    order = rng.permutation(x.size + 4 * n)
    a = np.concatenate([x, raw, moderate, even, rng.uniform(-1, 1, n)])[order]
    b = np.concatenate([y, raw[::-1], moderate[::-1], even[::-1], rng.uniform(-1, 1, n)])[order]
    return a, b


def _differences(one: Build, other: Build) -> list[str]:
    x, y = _mixture(np.random.default_rng(5))
    found: list[str] = []
    for name in UNARY + BINARY:
        args = (x,) if name in UNARY else (x, y)
        wrong = np.flatnonzero(_bits(one(name, *args)) != _bits(other(name, *args)))
        found += [f"{name} {x[i].hex()} {y[i].hex()}" for i in wrong[:1]]
    return found


@pytest.mark.parametrize(("kind", "other"), [("native1", f"native{n}") for n in (2, 4, 8)] + [("plain1", "plain8")])
def test_widths_give_the_same_bits(builds: dict[str, Build], kind: str, other: str) -> None:
    assert _differences(builds[kind], builds[other]) == []


def test_neighbours_do_not_matter(builds: dict[str, Build]) -> None:
    rng = np.random.default_rng(6)
    x, y = _mixture(rng)
    order = rng.permutation(x.size)
    for name in UNARY + BINARY:
        args = (x,) if name in UNARY else (x, y)
        shuffled = builds["native8"](name, *(a[order] for a in args))
        assert (_bits(shuffled) == _bits(builds["native8"](name, *args))[order]).all(), name


def test_another_compiler_gives_the_same_bits(builds: dict[str, Build], tmp_path: Path) -> None:
    process = _start([sys.executable, "-m", "ziglang", "cc"], 8, ["-O2", NATIVE], _source(tmp_path), tmp_path / "zig.so")
    assert _differences(builds["native8"], _finish(process, tmp_path / "zig.so")) == []
