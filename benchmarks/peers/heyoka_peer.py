"""Heyoka's Taylor method, compiled by LLVM, on the model's dynamics."""

from __future__ import annotations

from typing import Any, ClassVar, final

import casadi as ca
import numpy as np

from benchmarks.peers.base import AbstractPeer, Prepared
from benchmarks.scenes import Built


@final
class Heyoka(AbstractPeer):
    """Taylor series of an order that fits the tolerance, adaptive steps; the operations of the model's dynamics as its expressions."""

    name: ClassVar[str] = "heyoka"
    module: ClassVar[str] = "heyoka"

    def methods(self, scene: str) -> tuple[str, ...]:
        return ("Taylor",)

    def refusal(self, scene: str) -> str:
        return ""

    def settings(self, scene: str, method: str) -> tuple[float, ...]:
        return (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13, 1e-15)  # each is compiled

    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        import heyoka

        x0 = built.model.initial_state(built.start).x
        names = [f"x{i}" for i in range(x0.size)]
        variables = heyoka.make_vars(*names)
        rates = expressions(heyoka, built.model.functions.explicit_dynamics, variables, built.model.system.p_values)
        system = list(zip(variables, rates, strict=True))
        integrator = heyoka.taylor_adaptive(system, x0.copy(), tol=setting, compact_mode=len(rates) > 10)

        def run() -> np.ndarray | None:
            integrator.time = 0.0
            integrator.state[:] = x0
            outcome = integrator.propagate_until(built.scene.end)[0]
            return integrator.state.copy() if outcome == heyoka.taylor_outcome.time_limit else None

        return Prepared(run, built.observe)


def expressions(heyoka: Any, f: ca.Function, x: list[Any], p: np.ndarray) -> list[Any]:
    """The outputs of f(t, x, u, p), instruction by instruction, at t = 0."""
    known = {
        ca.OP_ADD: lambda a, b: a + b,
        ca.OP_SUB: lambda a, b: a - b,
        ca.OP_MUL: lambda a, b: a * b,
        ca.OP_DIV: lambda a, b: a / b,
        ca.OP_NEG: lambda a: -a,
        ca.OP_SQ: lambda a: a * a,
        ca.OP_TWICE: lambda a: 2.0 * a,
        ca.OP_INV: lambda a: 1.0 / a,
        ca.OP_ASSIGN: lambda a: a,
        ca.OP_SQRT: heyoka.sqrt,
        ca.OP_SIN: heyoka.sin,
        ca.OP_COS: heyoka.cos,
    }
    arguments = {0: [heyoka.expression(0.0)], 1: x, 3: [heyoka.expression(float(value)) for value in p]}
    work: dict[int, Any] = {}
    results: dict[int, Any] = {}
    for k in range(f.n_instructions()):
        code, taken, given = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if code == ca.OP_OUTPUT:
            results[given[1]] = work[taken[0]]
        elif code == ca.OP_INPUT:
            work[given[0]] = arguments[taken[0]][taken[1]]
        elif code == ca.OP_CONST:
            work[given[0]] = heyoka.expression(f.instruction_constant(k))
        else:
            work[given[0]] = known[code](*(work[i] for i in taken))
    return [results[i] for i in range(len(x))]
