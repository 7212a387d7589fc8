"""The solution of a problem of optimal control, proven by replay."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from acausal.collocation.modes import WithModes
from acausal.collocation.problem import Accuracy, StatusKind
from acausal.integrators.integrate import integrate
from acausal.language.expression import Expression, Input, Parameter
from acausal.language.pieces import PiecewisePolynomial
from acausal.optimal_control.guess import Guess, closed
from acausal.optimal_control.mesh import Mesh, through
from acausal.optimal_control.transcription import Transcribed
from acausal.start.initial import near
from acausal.start.states import start_values

if TYPE_CHECKING:
    from acausal.simulate.trajectory import Trajectory

_REPLAYED = 1e-10
_DIGITS = 1e-8
"""Of what a state is: it does not vary by less, beside rounding."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best motion found: its `cost`, and how it was found (`iterations` and `seconds` of the solver on all meshes).

    `run` is the motion that `simulate` makes of the inputs found, from the start on: independent of the collocation. `replay_error`: by how much it is
    off at the nodes, relative to what each state varies by; `defect`: the same for runs that begin anew at each node; `growth`: how
    much the motion magnifies a small error on its way. A good solution of an unstable motion has a small defect, a large growth and a replay error of
    about their product.
    """

    model: Any
    transcribed: Transcribed
    unknowns: np.ndarray
    cost: float
    iterations: int
    seconds: float
    given: Mapping[str, Any]

    @property
    def mesh(self) -> Mesh:
        """Where the unknowns stand."""
        return self.transcribed.mesh

    def again(self, unknowns: np.ndarray, cost: float, iterations: int) -> Optimum:
        """Another solution of the same program."""
        return replace(self, unknowns=unknowns, cost=cost, iterations=iterations)

    @functools.cached_property
    def motion(self) -> Guess:
        """All unknowns at the points of the mesh; loops, which an interior point leaves open by its last digits, closed to rounding."""
        found, stage = self.transcribed.motion(self.unknowns), self.transcribed.asked.stage
        nx = stage.sizes[0]
        x = closed(stage, found.values[:, :nx], found.times, found.duration, found.free, np.ones(nx), fresh=False)
        return replace(found, values=np.column_stack([x, found.values[:, nx:]]))

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        return self.motion.duration

    @property
    def t(self) -> np.ndarray:
        """Times of the nodes (intervals + 1,) [s]."""
        return self.transcribed.asked.stage.t0 + self.mesh.nodes * self.duration

    @functools.cached_property
    def x(self) -> np.ndarray:
        """States at the nodes (nx, intervals + 1)."""
        stage = self.transcribed.asked.stage
        return self.motion.values[:: self.mesh.tableau.stages, : stage.sizes[0]].T

    @functools.cached_property
    def parameters(self) -> dict[Parameter, float]:
        """Values of the parameters that were found, and of those that were given."""
        found = dict(zip(self.transcribed.asked.stage.free, self.motion.free.tolist(), strict=True))
        return {**self.given["parameters"], **found}

    @functools.cached_property
    def inputs(self) -> dict[Input, PiecewisePolynomial]:
        """What was found, for `simulate`: a polynomial in each interval."""
        stage, mesh = self.transcribed.asked.stage, self.mesh
        s, nu = mesh.tableau.stages, stage.sizes[3]
        u = self.motion.values[1:, stage.width - nu :].reshape(mesh.intervals, s, nu)
        lengths = mesh.lengths * self.duration
        found: dict[Input, PiecewisePolynomial] = {}
        for k, entry in enumerate(stage.mode.inputs):
            pieces = through(mesh.tableau.c, u[:, :, k].T).T / lengths[:, None] ** np.arange(s - 1, -1, -1)
            found[entry] = PiecewisePolynomial(self.t[:-1], pieces)
        return found

    def __getitem__(self, wanted: Expression | str) -> np.ndarray:
        """Values of a variable or expression along the replayed motion, see `Trajectory`."""
        return self.run[wanted]

    @functools.cached_property
    def run(self) -> Trajectory:
        """The motion from the start by the inputs found; it may end early where it is unstable."""
        return self.replayed(float(self.t[-1]), self.inputs)

    def replayed(self, end: float, inputs: Mapping[Input, PiecewisePolynomial]) -> Trajectory:
        """The motion from the start by these inputs."""
        stage = self.transcribed.asked.stage
        space, t0 = stage.functions.space, float(self.t[0])
        # closed to rounding: what is open by an interior point's last digits would have to strike first
        first = closed(stage, self.x[:, :1].T, np.zeros(1), self.duration, self.motion.free, np.ones(self.x.shape[0]))[0]
        whole = space.expanded(t0, first, space.extended(t0, first, self._p(stage.functions)))
        start = {key: near(value) for key, value in start_values(stage.functions, whole).items()}
        return self.model.simulate(
            end, start, t0=t0, inputs=inputs, parameters=self.parameters, rtol=_REPLAYED, progress=False, raise_on_failure=False
        )  # fmt: skip

    @functools.cached_property
    def replay_error(self) -> float:
        """Largest difference of `run` at the nodes, relative to what each state varies by; infinite where it ends early."""
        last = self.run.t[-1]
        if last < self.t[-1] * (1 - 1e-9):
            return float("inf")
        return float(np.max(np.abs(self.run.at(np.clip(self.t, self.run.t[0], last)).x - self.x) / self.spread[:, None]))

    @functools.cached_property
    def defects(self) -> np.ndarray:
        """Of each interval (intervals,), integrated from the node where it begins."""
        found, accuracy = np.zeros(self.mesh.intervals), Accuracy.asked(_REPLAYED)
        inputs = self.run.problem.inputs
        given = inputs.inputs if isinstance(inputs, WithModes) else inputs  # modes are decided anew at each node
        for k in range(self.mesh.intervals):
            t0, t1 = float(self.t[k]), float(self.t[k + 1])
            problem = replace(self.run.problem, inputs=given, read=np.array([t1]))
            solution = integrate(problem, self.x[:, k].copy(), t0, t1, accuracy)
            off = np.abs(solution.x[:, -1] - self.x[:, k + 1]) / self.spread
            found[k] = np.max(off) if solution.status.kind is StatusKind.SUCCESS else np.inf
        return found

    @property
    def defect(self) -> float:
        """The largest of `defects`."""
        return float(np.max(self.defects))

    @functools.cached_property
    def growth(self) -> float:
        """By how much a small error of the states on the way is magnified until a later node, at most; relative to what each state varies by."""
        maps = [self._map(k) / self.spread[:, None] * self.spread for k in range(self.mesh.intervals)]
        largest = 1.0
        carried = np.zeros((0, *maps[0].shape))
        for one in maps:
            carried = np.concatenate([one @ carried, one[None]])
            largest = max(largest, float(np.max(np.linalg.norm(carried, 2, axis=(1, 2)))))
        return largest

    def _map(self, k: int) -> np.ndarray:
        """Derivative (nx, nx) of the states at the end of an interval by those at its beginning, by the collocation itself."""
        stage, mesh = self.transcribed.asked.stage, self.mesh
        nx, s, f = stage.sizes[0], mesh.tableau.stages, stage.functions
        h = mesh.lengths[k] * self.duration
        slopes = np.zeros((s, nx, nx))
        for j in range(s):
            z = self.motion.values[1 + k * s + j]
            u = stage.told(z[stage.width - stage.sizes[3] :])
            slopes[j] = np.array(self._slope(self.t[0] + mesh.points[k, j] * self.duration, z[:nx], u, self._p(f)))
        A = mesh.tableau.A
        block = np.eye(s * nx) - h * np.einsum("ij,jab->iajb", A, slopes).reshape(s * nx, s * nx)
        stages = np.linalg.solve(block, np.tile(np.eye(nx), (s, 1)))
        return stages[-nx:]

    @functools.cached_property
    def _slope(self) -> ca.Function:
        f = self.transcribed.asked.stage.functions.explicit_dynamics
        t, x, u, p = (f.sx_in(i) for i in range(4))
        return ca.Function("slope", [t, x, u, p], [ca.densify(ca.jacobian(f(t, x, u, p), x))], {"cse": True})

    def _p(self, f: Any) -> np.ndarray:
        p = self.transcribed.asked.stage.p.copy()
        known = list(f.outputs.system.flat.parameters)
        for parameter, value in self.parameters.items():
            p[known.index(parameter)] = value
        return p

    @functools.cached_property
    def spread(self) -> np.ndarray:
        """(nx,): what each state varies by; where it does not, what states of its kind do."""
        found = np.maximum(np.ptp(self.x, axis=1), _DIGITS * np.max(np.abs(self.x), axis=1))
        nq = self.transcribed.asked.stage.functions.space.nq
        for block in (slice(0, nq), slice(nq, None)):
            own = found[block]
            own[own < 1e-3 * np.max(own, initial=0.0)] = np.max(own, initial=0.0)
            own[own == 0.0] = 1.0
        return found

    def __str__(self) -> str:
        found = "".join(
            f", {p.name} = {value:g}" for p, value in self.parameters.items() if p in self.transcribed.asked.stage.free
        )
        return (
            f"cost {self.cost:.10g} in {self.duration:g} s{found}: {self.iterations} iterations, {self.seconds:.2f} s, {self.mesh.intervals} intervals; "
            f"replayed to {self.replay_error:.1e} (each interval to {self.defect:.1e}, errors grow {self.growth:.1e} times)"
        )
