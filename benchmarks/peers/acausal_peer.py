"""This package: the whole call of `simulate`, and the C driver alone."""

from __future__ import annotations

import ctypes
from typing import ClassVar, final

import numpy as np

from acausal.collocation.problem import Accuracy, Newton, Problem
from acausal.collocation.tableau import gauss_legendre
from acausal.integrators.gauss import Gauss
from acausal.runtime.kernels import How
from acausal.runtime.native import Choice, Code, Run
from benchmarks.peers.base import AbstractPeer, Prepared
from benchmarks.scenes import Built


@final
class Acausal(AbstractPeer):
    """`simulate`: from start values to the last state, in Python. `driver`: memory, steps and nothing else, in C, Gauss."""

    name: ClassVar[str] = "acausal"
    module: ClassVar[str] = "acausal"

    def methods(self, scene: str) -> tuple[str, ...]:
        return ("driver", "simulate")  # in this order: both with compiled kernels, as the others are

    def refusal(self, scene: str) -> str:
        return ""

    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        return (_simulate if method == "simulate" else _driver)(built, setting)


def _simulate(built: Built, setting: float) -> Prepared:
    def run() -> np.ndarray:
        return built.model.simulate(built.scene.end, built.start, rtol=setting, samples=2, progress=False).solution.x[:, -1]

    return Prepared(run, built.observe)


def _driver(built: Built, setting: float) -> Prepared:
    f, x0 = built.model.functions, built.model.initial_state(built.start).x
    compiled = f.native(How.COMPILED)
    assert compiled is not None
    problem = Problem(f.explicit_dynamics, f.invariants, f.projection, lambda t: np.zeros((0, t.size)), built.model.system.p_values, np.zeros(0), compiled)  # fmt: skip
    choice = Choice((gauss_legendre(Gauss.order // 2),), Newton.WHERE_SLOW)
    first, made = (Run(compiled, problem, x0, 0.0, built.scene.end, Accuracy(setting, setting), choice) for _ in range(2))
    first.advance(built.scene.end)
    fresh = type(made.core).from_buffer_copy(made.core)
    fresh.end, fresh.jvp = built.scene.end, first.core.jvp
    compiled.library.finish(ctypes.byref(made.core))
    library, slice_ = compiled.library, 1e9

    def run() -> np.ndarray | None:
        core = made.core
        ctypes.pointer(core)[0] = fresh
        core.memory, core.state, core.slice = None, None, slice_
        made.x[:] = x0
        library.begin(ctypes.byref(core))
        code = library.advance(ctypes.byref(core))
        library.finish(ctypes.byref(core))
        return made.x.copy() if code == Code.REACHED_END else None

    return Prepared(run, built.observe)
