"""CasADi's integrators, called once over the whole interval."""

from __future__ import annotations

from typing import ClassVar, final

import casadi as ca
import numpy as np

from benchmarks.peers.base import AbstractPeer, Prepared
from benchmarks.scenes import Built


@final
class Casadi(AbstractPeer):
    """SUNDIALS through CasADi, and CasADi's Rosenbrock method, on the model's functions in CasADi's virtual machine."""

    name: ClassVar[str] = "casadi"
    module: ClassVar[str] = "casadi"

    def methods(self, scene: str) -> tuple[str, ...]:
        return ("cvodes", "idas", "rosenbrock")

    def refusal(self, scene: str) -> str:
        return ""

    def prepare(self, built: Built, method: str, setting: float) -> Prepared:
        f = built.model.functions.explicit_dynamics
        x = ca.SX.sym("x", f.size1_in(1))
        options: dict[str, object] = {"reltol": setting, "abstol": setting}
        if method != "rosenbrock":
            options |= {"max_num_steps": 50_000, "show_eval_warnings": False}
        dae = {"x": x, "ode": f(0, x, [], built.model.system.p_values)}
        integrator = ca.integrator("peer", method, dae, 0.0, built.scene.end, options)
        x0 = ca.DM(built.model.initial_state(built.start).x)

        def run() -> np.ndarray | None:
            try:
                return np.array(integrator(x0=x0)["xf"]).ravel()
            except RuntimeError:  # CasADi's way to say that the integrator gave up
                return None

        return Prepared(run, built.observe)
