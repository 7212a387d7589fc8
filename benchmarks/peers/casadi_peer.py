"""CasADi's integrators, called once over the whole interval."""

from __future__ import annotations

from typing import ClassVar, final

import casadi as ca
import numpy as np

from acausal.export.c_source import compiler
from benchmarks.peers.base import TOLERANCES, AbstractPeer, Prepared
from benchmarks.peers.compiled import compiled
from benchmarks.scenes import Built


@final
class Casadi(AbstractPeer):
    """SUNDIALS through CasADi, and CasADi's Rosenbrock method, on the model's functions in CasADi's virtual machine; the Rosenbrock
    method, functions and all, also as compiled C, which the others cannot be made into."""

    name: ClassVar[str] = "casadi"
    module: ClassVar[str] = "casadi"

    def methods(self, scene: str) -> tuple[str, ...]:
        return ("cvodes", "idas", "rosenbrock") + (("rosenbrock C",) if compiler() is not None else ())

    def refusal(self, scene: str) -> str:
        return ""

    def settings(self, scene: str, method: str) -> tuple[float, ...]:
        return (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13) if method == "rosenbrock C" else TOLERANCES  # each is compiled

    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        f = built.model.functions.explicit_dynamics
        x = ca.SX.sym("x", f.size1_in(1))
        plugin = method.split()[0]
        options: dict[str, object] = {"reltol": setting, "abstol": setting}
        if plugin != "rosenbrock":
            options |= {"max_num_steps": 50_000, "show_eval_warnings": False}
        dae = {"x": x, "ode": f(0, x, [], built.model.system.p_values)}
        integrator = ca.integrator("peer", plugin, dae, 0.0, built.scene.end, options)
        start = ca.MX.sym("start", x.numel())
        whole = ca.Function("whole", [start], [integrator(x0=start)["xf"]])
        if method == "rosenbrock C":
            whole = compiled([whole], "-O1")[0]
        x0 = ca.DM(built.model.initial_state(built.start).x)

        def run() -> np.ndarray | None:
            try:
                return np.array(whole(x0)).ravel()
            except RuntimeError:  # CasADi's way to say that the integrator gave up
                return None

        return Prepared(run, built.observe)
