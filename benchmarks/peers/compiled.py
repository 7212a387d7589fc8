"""The explicit dynamics of a model and their Jacobian as C, for integrators that call back into Python."""

from __future__ import annotations

import functools
import os
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np

from acausal.export.c_source import compiler
from benchmarks.scenes import Built

Rate = Callable[[float, np.ndarray], np.ndarray]


@functools.lru_cache(maxsize=2)
def dynamics(built: Built) -> tuple[Rate, Rate]:
    """x' (nx,) and d x' / d x (nx, nx) as functions of (t, x): compiled C, or CasADi's virtual machine without a compiler.

    The arrays returned are overwritten by the next call.
    """
    f = built.model.functions.explicit_dynamics
    t, x = ca.SX.sym("t"), ca.SX.sym("x", f.size1_in(1))
    rate = f(t, x, [], built.model.system.p_values)
    wanted = [
        ca.Function("rate", [t, x], [ca.densify(rate)], {"cse": True}),
        ca.Function("slope", [t, x], [ca.densify(ca.jacobian(rate, x))], {"cse": True}),
    ]
    if compiler() is not None:
        wanted = compiled(wanted)
    return _called(wanted[0]), _called(wanted[1])


def compiled(functions: list[ca.Function], optimise: str = "-O2") -> list[ca.Function]:
    """The same functions, as C."""
    generator = ca.CodeGenerator("peer.c")
    for function in functions:
        generator.add(function)
    with tempfile.TemporaryDirectory(
        ignore_cleanup_errors=True
    ) as name:  # what is loaded stays so without its file, where systems allow it
        folder = Path(name)
        generator.generate(f"{folder}{os.sep}")
        library = folder / "peer.so"
        subprocess.run([*(compiler() or []), optimise, "-fPIC", "-shared", "-o", library, folder / "peer.c", "-lm"], check=True)
        return [ca.external(function.name(), str(library)) for function in functions]


def _called(function: ca.Function) -> Rate:
    """Without CasADi's conversion of arguments, which costs more than a small function itself."""
    buffer, run = function.buffer()
    t, x = np.zeros(1), np.zeros(function.size1_in(1))
    out = np.zeros(function.size_out(0), order="F")
    buffer.set_arg(0, memoryview(t))
    buffer.set_arg(1, memoryview(x))
    buffer.set_res(0, memoryview(out.ravel(order="K")))
    result = out[:, 0] if out.shape[1] == 1 else out

    def call(time: float, state: np.ndarray, held: object = buffer) -> np.ndarray:
        t[0] = time
        x[:] = state
        run()
        return result

    return call
