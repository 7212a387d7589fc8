"""Kernels that are interpreted give the bits of compiled ones, for every operation and model, and may change places with them."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import product
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

import acausal as ac
from acausal.emit.compiler import cached_library, compiler
from acausal.emit.emit import Source, translation_units
from acausal.emit.library import SOURCES
from acausal.emit.program_source import emit_program
from acausal.errors import ExportError
from acausal.numerics.instructions import BINARY, UNARY
from acausal.runtime import native as problems
from acausal.runtime.kernels import Compilation, How, Kernel, Kernels, Wanted
from acausal.runtime.kernels import interpreted as as_program
from acausal.runtime.load import Runtime, runtime
from acausal.runtime.native import NativeProblem
from components import Coulomb, PointOnPlane, RigidBody, World
from tests.scenes import FourBar, Pendulum, chain

Array = NDArray[np.float64]
X, Y = ca.SX.sym("x"), ca.SX.sym("y")
SPECIAL = np.array([0.0, -0.0, 1.0, -1.0, 0.3, -2.7, 5.0, 1e-310, -3e200, np.inf, -np.inf, np.nan])


@pytest.fixture(scope="module")
def library() -> Runtime:
    found = runtime()
    assert found is not None
    return found


EVALUATION = """
#include <string.h>
#include "runtime.h"
#include "interpreter.h"

/* Results of a kernel for LANES points; in, c, out, w: room for it. */
EXPORT void evaluate(const Kernel *k, const V *in, V *c, V *out, V *w) {
    prepare_kernel(k, in, c, w);
    run_kernel(k, in, c, out, w);
}
"""


@functools.cache
def _evaluation(options: tuple[str, ...]) -> ctypes.CDLL:
    headers = b"".join(
        (SOURCES / name).read_bytes() for name in ("runtime.h", "lanes.h", "interpreter.h", "twofold.h", "vector_math.h")
    )
    command = compiler()
    assert command is not None
    path = cached_library(
        hashlib.sha256(EVALUATION.encode() + headers).hexdigest(), [EVALUATION], command=command, options=options
    )
    return ctypes.CDLL(str(path))


def _room(values: int, lanes: int) -> Array:
    """(values, lanes), aligned."""
    whole = np.zeros((values + 1) * lanes + 8)
    first = -whole.ctypes.data % 64 // 8
    return whole[first : first + values * lanes].reshape(values, lanes)


def kernel_values(kernel: Kernel, points: Array, library: Runtime, *, of_program: bool = False) -> Array:
    """Results (outputs, n) at points (inputs, n), as the runtime runs kernels. `of_program`: the work is done in the frame of a program."""
    lanes, n = library.lanes, points.shape[1]
    x, c, y, w = (_room(size, lanes) for size in (kernel.inputs, kernel.constants, kernel.outputs, kernel.work))
    if of_program:
        w = c
    found = np.empty((kernel.outputs, n))
    for k in range(0, n, lanes):
        part = points[:, k : k + lanes]
        x[:] = np.pad(part, ((0, 0), (0, lanes - part.shape[1])), mode="edge")
        _evaluation(library.options).evaluate(ctypes.byref(kernel), *(ctypes.c_void_p(a.ctypes.data) for a in (x, c, y, w)))
        found[:, k : k + lanes] = y[:, : part.shape[1]]
    return found


def _bits(x: Array) -> NDArray[np.uint64]:
    """Bits, with one NaN for all."""
    return np.where(np.isnan(x), np.nan, x).view(np.uint64)


def _same(functions: Sequence[Wanted], points: Array, library: Runtime) -> None:
    ways = [Kernels(functions, library, how) for how in (How.INTERPRETED, How.COMPILED)]
    for wanted, interpreted, compiled in zip(functions, *(way.current for way in ways), strict=True):
        one, other = (kernel_values(kernel, points[: kernel.inputs], library) for kernel in (interpreted, compiled))
        assert np.array_equal(_bits(one), _bits(other)), wanted.name


def test_every_operation_has_the_bits_of_compiled_code(library: Runtime) -> None:
    """Those of one operand and of two, at numbers where anything may go wrong."""
    unary = [Wanted(f"one{code}", ca.Function("f", [X], [ca.SX.unary(code, X)])) for code in UNARY]
    _same(unary, np.concatenate([SPECIAL, np.random.default_rng(1).normal(0, 2, 50)])[None, :], library)
    binary = [Wanted(f"two{code}", ca.Function("f", [X, Y], [ca.SX.binary(code, X, Y)])) for code in BINARY]
    _same(binary, np.array([*product(SPECIAL, SPECIAL)]).T, library)


def test_powers_and_merged_operations_have_the_bits_of_compiled_code(library: Runtime) -> None:
    """Products inside sums, differences and products are one statement of the interpreter; rounding stays that of two."""
    z, w = ca.SX.sym("z"), ca.SX.sym("w")
    forms = [
        X * Y + z,
        z + X * Y,
        X * Y - z,
        z - X * Y,
        X * Y * z,
        X**2 - z * w,
        (X * Y) * (z * w),
        X * Y + z * w,
        X**2 + X**2 * Y,
    ]
    forms += [X**k for k in (-2.5, -1, -0.5, 0.5, 1.5, 3, 8, 9, 0.3)] + [ca.sin(X) * ca.cos(X) + X, ca.cos(X), ca.SX(2.5), X]
    wanted = [Wanted(f"f{k}", ca.Function("f", [X, Y, z, w], [ca.vertcat(form, X)])) for k, form in enumerate(forms)]
    _same(wanted, np.random.default_rng(2).normal(0, 2, (4, 64)), library)


def _all_at_once() -> Wanted:
    """Every operation, on values that are needed long before and after, and systems whose answers others need."""
    values = [ca.SX.sym(f"x{k}") for k in range(6)]
    p = ca.SX.sym("p", 2)
    random = np.random.default_rng(5)
    for code in (*UNARY, *BINARY, *BINARY):
        one, other = (values[random.integers(len(values))] for _ in range(2))
        values.append(ca.SX.unary(code, one) if code in UNARY else ca.SX.binary(code, one, other) * p[0] + values[-1])
    return Wanted("all", ca.Function("f", [ca.vertcat(*values[:6]), p], [ca.vertcat(*values, ca.sin(p[1]))]), (1,))


@pytest.mark.parametrize("chunk", [20, 400])
def test_c_of_programs_has_the_bits_of_the_interpreter(chunk: int, library: Runtime) -> None:
    """However it is cut: every operation, and the systems of a box that slides on two feet."""
    scene = ac.System()
    scene.world, scene.box = World(), RigidBody.box(2.0, (0.4, 0.3, 0.2))
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(0.3)) for _ in range(2)]
    for k, foot in enumerate(scene.feet):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((0.2 - 0.4 * k, 0, -0.1)))
    rates = ac.build(scene).functions.integrand.wanted[0]
    command = compiler()
    assert command is not None
    for wanted in (_all_at_once(), rates):
        made = as_program(wanted.function, wanted.name, library.lanes, parameters=wanted.parameters)
        source = Source("f", tuple(emit_program(made.program.run, "f", library.lanes, chunk=chunk)), 0, 0, 0, 0)
        key = hashlib.sha256("".join(source.pieces).encode()).hexdigest()
        path = cached_library(key, translation_units([source], 1), command=command, options=library.options)
        kernel = Kernel.from_buffer_copy(made.kernel)
        kernel.run = ctypes.cast(ctypes.CDLL(str(path)).f, ctypes.c_void_p).value
        points = np.random.default_rng(6).normal(0, 1, (kernel.inputs, 8 * library.lanes))
        points[::2] = np.round(points[::2])  # masks are whole numbers, but for some
        one, other = kernel_values(made.kernel, points, library), kernel_values(kernel, points, library, of_program=True)
        assert np.array_equal(_bits(one), _bits(other))
        assert np.isfinite(one).any()


def test_what_depends_on_parameters_only_is_prepared(library: Runtime) -> None:
    p = ca.SX.sym("p", 2)
    heavy = ca.exp(ca.sin(p[0]) ** 2) / p[1]
    f = ca.Function("f", [X, p], [ca.vertcat(heavy * X + ca.cos(p[1]), heavy, p[0], 3.0)])
    _same([Wanted("prepared", f, (1,))], np.random.default_rng(3).uniform(0.2, 2, (3, 1)), library)


def _problems(model: ac.Model, library: Runtime) -> Iterator[NativeProblem]:
    f = model.functions
    for how in (How.INTERPRETED, How.COMPILED):
        yield NativeProblem(f.integrand, how, library)


@pytest.mark.parametrize("scene", [Pendulum, FourBar, lambda: chain(6)], ids=["pendulum", "four-bar", "chain"])
def test_kernels_of_models_have_the_bits_of_compiled_ones(scene: type[ac.System], library: Runtime) -> None:
    """Dynamics, projection, clearance, and derivatives of the first two."""
    one, other = _problems(ac.build(scene()), library)
    for ours, theirs in ((one.kernels, other.kernels), (one.jvp, other.jvp), (one.variation, other.variation)):
        for interpreted, compiled in zip(ours.current, theirs.current, strict=True):
            points = np.random.default_rng(4).normal(0, 1, (interpreted.inputs, 24))
            points = np.repeat(points[:, :1], 24, axis=1) if one.integrand.numbers["np"] else points
            assert np.array_equal(*(_bits(kernel_values(kernel, points, library)) for kernel in (interpreted, compiled)))


def test_kernels_for_other_lanes_than_those_of_the_runtime_are_never_run(
    library: Runtime, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever asks for compiled ones is told; a run goes on with the interpreter. Options of a runtime make a compiler give as many."""
    x = ca.SX.sym("x")
    wanted = [Wanted("f", ca.Function("f", [x], [ca.sin(x) + 1]))]
    other = replace(library, lanes=2 if library.lanes > 2 else 4)
    with pytest.raises(ExportError, match=f"compiled for {library.lanes} lanes and the runtime for {other.lanes}"):
        Kernels(wanted, other, How.COMPILED)
    kernels = Kernels(wanted, other, How.AUTO)
    monkeypatch.setattr(kernels, "_cost", 0.0)
    assert kernels.kind == "interpreted"
    kernels.spent(1.0)
    assert (kernels.kind, kernels.version) == ("interpreted", 0)
    told = replace(other, options=(*library.options, f"-DLANES={other.lanes}"))
    assert Kernels(wanted, told, How.COMPILED).kind == "compiled"


def _motions(taken: list[Kernels], eager: bool, patch: pytest.MonkeyPatch) -> list[Array]:
    """Of a four-bar by two methods; `eager`: compiled at once, when kernels have been in use for a slice."""
    if eager:
        patch.setattr(Compilation, "begin", Compilation._work)
    take = Kernels._take_compiled
    patch.setattr(Kernels, "_take_compiled", lambda own: (taken.append(own), take(own)))
    scene = FourBar()
    model = ac.build(scene)
    native = model.functions.native(How.AUTO)
    assert native is not None
    for kernels in (native.kernels, native.jvp):
        kernels._cost = 1e-9 if eager else math.inf
    start = {scene.a.q: -0.5, scene.a.v: 3.0}
    return [model.simulate(5.0, start, rtol=1e-10, method=method).solution.x for method in ("gauss", "radau")]


def test_compiled_kernels_take_over_unseen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the middle of a run, with loops and with Newton: not a bit changes."""
    monkeypatch.setenv("ACAUSAL_CACHE", str(tmp_path))
    monkeypatch.setattr(problems, "_SLICE", 1e-4)
    runs: list[list[Array]] = []
    for eager in (False, True):
        taken: list[Kernels] = []
        with monkeypatch.context() as patch:
            runs.append(_motions(taken, eager, patch))
        assert len(taken) == (2 if eager else 0)
    assert all(np.array_equal(one, other) for one, other in zip(*runs, strict=True))


def test_runs_by_the_virtual_machine_do_not_disturb_one_another() -> None:
    """Its functions have arrays of their own: side by side in threads each motion is that of a run alone."""
    scene = FourBar()
    model = ac.build(scene)

    def end(speed: float) -> Array:
        start = {scene.a.q: -0.5, scene.a.v: speed}
        return model.simulate(1.0, start, rtol=1e-9, compiled=False).solution.x[:, -1]

    speeds = [1.0, 2.0, 3.0, 4.0]
    alone = [end(speed) for speed in speeds]
    with ThreadPoolExecutor(len(speeds)) as pool:
        together = list(pool.map(end, speeds))
    assert np.array_equal(alone, together)
