"""An integrator: one step after the other from x' = f(t, x, u, p). It is found by its `name` as soon as its class exists."""

import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import acausal as ac
from acausal.collocation.problem import Accuracy, Problem, Progress, Solution, Statistics, Status, StatusKind
from acausal.integrators.base import AbstractIntegrator
from components import Revolute, RigidBody, World

LIMIT = 0.05


@dataclass(frozen=True)
class Heun(AbstractIntegrator):
    """Heun's method of order 2 with steps of `step` [s]; without one, the cube root of the tolerance times the whole time."""

    name: ClassVar[str] = "heun"
    step: float | None = None

    def integrate(
        self, problem: Problem, x0: np.ndarray, t0: float, t1: float, accuracy: Accuracy, progress: Progress | None = None
    ) -> Solution:
        """See `AbstractIntegrator`."""
        began = time.perf_counter()
        count = int(np.ceil((t1 - t0) / (self.step or accuracy.rtol ** (1 / 3) * (t1 - t0))))
        t, h = np.linspace(t0, t1, count + 1), (t1 - t0) / count
        x = np.empty((x0.size, count + 1))
        x[:, 0] = x0

        def slope(moment: float, state: np.ndarray) -> np.ndarray:
            given = problem.inputs(np.array([moment]))[:, 0]
            return np.array(problem.rhs(moment, state, given, problem.parameters)).ravel()

        for k in range(count):
            first = slope(t[k], x[:, k])
            new = x[:, k] + h / 2 * (first + slope(t[k + 1], x[:, k] + h * first))
            if not np.all(np.isfinite(new)):
                status = Status(StatusKind.NON_FINITE, float(t[k]), "A rate is not finite.", int(np.argmin(np.isfinite(new))))
                return _solution(t[: k + 1], x[:, : k + 1], time.perf_counter() - began, status)
            if problem.project is not None:  # loops, quaternions: back onto the invariants
                new = np.array(problem.project(t[k + 1], new, problem.inputs(t[[k + 1]])[:, 0], problem.parameters)).ravel()
            x[:, k + 1] = new
        return _solution(t, x, time.perf_counter() - began, Status(StatusKind.SUCCESS, t1))


def _solution(t: np.ndarray, x: np.ndarray, took: float, status: Status) -> Solution:
    def dense(wanted: np.ndarray) -> np.ndarray:
        return np.array([np.interp(wanted, t, row) for row in x])

    return Solution(t, x, dense, Statistics("heun", 2, t.size - 1, 0, 2 * (t.size - 1), 0, took), status)


def main() -> float:
    """Of a pendulum: how far the error's fall at half the step is from a factor of four, relative."""
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World(), Revolute("y"), RigidBody.rod(1.0, (0, 0, -1.0))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    model, start = ac.build(scene), {scene.hinge.q: 1.0}
    exact = model.simulate(1.0, start, rtol=1e-12)[scene.hinge.q][-1]
    one, two = (abs(model.simulate(1.0, start, method="heun", step=h)[scene.hinge.q][-1] - exact) for h in (2e-3, 1e-3))
    return float(abs(one / two / 4 - 1))


if __name__ == "__main__":
    print(main())
