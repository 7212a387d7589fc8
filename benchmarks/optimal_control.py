"""Optimal control beside the same collocation written by hand for `casadi.Opti`.

python -m benchmarks.optimal_control

The same problem, mesh (Radau, order 5), solver and tolerance. Seconds of the processor: `build` from the scene, or the equations, to the solver; `first` from
the guess; `warm` again from the solution found, begun a hundredth aside, with its multipliers. Of the warm solution: what functions take, and what is left
for linear algebra and the rest of the solver.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

import acausal as ac
from acausal.optimal_control.mesh import Mesher
from acausal.optimal_control.near_by import NearBy
from acausal.optimal_control.search import ipopt_options
from acausal.optimal_control.whole import Part, whole
from components import (
    ForceSource,
    Prismatic,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    TranslationalDamper,
    TranslationalGround,
    World,
)
from examples.control.robot_arm import END, START, TORQUES, Arm

ASIDE, _REPEAT = 0.01, 5
_RADAU = ca.collocation_points(3, "radau")


@dataclass(frozen=True)
class Row:
    """What was measured of one tool; seconds."""

    name: str
    cost: float
    build: float
    first: float
    iterations: int
    warm: float
    again: int
    functions: float

    def __str__(self) -> str:
        ms = (1e3 * one for one in (self.build, self.first, self.warm, self.functions, self.warm - self.functions))
        build, first, warm, functions, rest = (f"{one:.3g}" for one in ms)
        return f"| {self.name} | {self.cost:.9g} | {build} | {first} | {self.iterations} | {warm} | {self.again} | {functions} | {rest} |"


HEAD = "| | cost | build | first [ms] | iterations | warm [ms] | iterations | functions [ms] | rest [ms] |\n" + "|---" * 9 + "|"


class CartPole(ac.System):
    """A cart with a rod on a hinge, both with friction; the force on the cart is an input."""

    def __init__(self) -> None:
        self.force = ac.Input("N")
        self.mass, self.load = ac.Parameter(1.0, "kg"), ac.Parameter(0.3, "kg")
        self.length = ac.Parameter(0.6, "m")
        self.drag, self.rub = ac.Parameter(0.0, "N*s/m"), ac.Parameter(0.0, "N*m*s/rad")
        self.world, self.rail, self.hinge = World(gravity=(0, 0, -9.81)), Prismatic("x"), Revolute("y")
        self.cart, self.rod = RigidBody(self.mass, (1, 1, 1)), RigidBody.rod(self.load, (0, 0, -self.length))
        self.motor, self.ground, self.still = ForceSource(self.force), TranslationalGround(), RotationalGround()
        self.slide, self.bearing = TranslationalDamper(self.drag), RotationalDamper(self.rub)
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.cart.frame)
        self.connect(self.cart.frame, self.hinge.frame_a)
        self.connect(self.hinge.frame_b, self.rod.frame)
        self.connect(self.motor.flange, self.slide.flange_b, self.rail.flange)
        self.connect(self.ground.flange, self.slide.flange_a)
        self.connect(self.still.flange, self.bearing.flange_a)
        self.connect(self.hinge.flange, self.bearing.flange_b)


@dataclass(frozen=True)
class Textbook:
    """x' = `rate` (x, u), from `start` to `end` in a `time`, |u| <= `most`, |x| <= `bound`, least integral of sum (u / `weights`)^2."""

    rate: ca.Function
    time: float
    start: np.ndarray
    end: np.ndarray
    most: np.ndarray
    bound: np.ndarray
    weights: np.ndarray


def cart_pole() -> ac.OptimalControl:
    """Swings up."""
    scene = CartPole()
    ocp = ac.OptimalControl(ac.build(scene), 2.0)
    ocp.start({scene.rail.q: 0.0, scene.hinge.q: 0.0})
    ocp.end({scene.rail.q: 0.0, scene.hinge.q: np.pi, scene.rail.v: 0.0, scene.hinge.v: 0.0})
    ocp.bound(scene.force, -20, 20)
    ocp.minimise(ac.integral(scene.force**2))
    return ocp


def cart_pole_by_hand() -> Textbook:
    """Of textbooks: thin rod of 0.3 kg and 0.6 m on a cart of 1 kg, angle from hanging."""
    m, half, g = 0.3, 0.3, 9.81
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    s, k = ca.sin(x[1]), ca.cos(x[1])
    M = ca.vertcat(ca.horzcat(1 + m, -m * half * k), ca.horzcat(-m * half * k, 4 / 3 * m * half**2))
    f = ca.vertcat(u - m * half * s * x[3] ** 2, -m * g * half * s)
    rate = ca.Function("rate", [x, u], [ca.vertcat(x[2:], ca.solve(M, f))])
    return Textbook(rate, 2.0, np.zeros(4), np.array([0, np.pi, 0, 0]), np.array([20.0]), np.full(4, np.inf), np.ones(1))


def arm(speed: float = 6.0) -> ac.OptimalControl:
    """Moves its tool in half a second, no axis faster than that [rad/s]."""
    scene = Arm()
    ocp = ac.OptimalControl(ac.build(scene), 0.5)
    ocp.start({hinge.q: q for hinge, q in zip(scene.hinges, START, strict=True)})
    ocp.end({hinge.q: q for hinge, q in zip(scene.hinges, END, strict=True)} | {hinge.v: 0 for hinge in scene.hinges})
    for hinge, torque, most in zip(scene.hinges, scene.torques, TORQUES, strict=True):
        ocp.bound(torque, -most, most)
        ocp.bound(hinge.v, -speed, speed)
    ocp.minimise(ac.integral(sum((torque / most) ** 2 for torque, most in zip(scene.torques, TORQUES, strict=True))))
    return ocp


def arm_by_hand() -> Textbook:
    """Nobody writes six axes by hand: the model's explicit dynamics, as users give them to Opti."""
    f = ac.build(Arm()).functions.explicit_dynamics
    x, u = ca.SX.sym("x", 12), ca.SX.sym("u", 6)
    rate = ca.Function("rate", [x, u], [f(0, x, u, ca.SX(0, 1))], {"cse": True})
    most = np.array(TORQUES)
    bound = np.array([np.inf] * 6 + [6.0] * 6)
    return Textbook(rate, 0.5, np.append(START, np.zeros(6)), np.append(END, np.zeros(6)), most, bound, most)


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What it gives, and its seconds of the processor."""
    begin = time.process_time()
    return call(), time.process_time() - begin


def least(call: Callable[[], Any]) -> tuple[Any, float]:
    """Of several calls the quickest."""
    return min((timed(call) for _ in range(_REPEAT)), key=lambda pair: pair[1])


def functions_of(stats: Mapping[str, Any]) -> float:
    """Seconds of the processor in functions."""
    return sum(float(value) for key, value in stats.items() if key.startswith("t_proc_nlp_"))


def ours(make: Callable[[], ac.OptimalControl], intervals: int) -> tuple[Row, Part]:
    """By this package."""

    def built() -> tuple[Any, Any, Any]:
        part = make().part(Mesher(intervals, 5, "free", "ipopt"))
        program = whole([part], []).program
        return part, program, program.solver("ipopt", {**ipopt_options(warm=False), "error_on_fail": False})

    (part, program, solver), build = timed(built)
    (low, high), (lower, upper) = program.bounds, program.limits
    begin = np.clip(program.guess, low, high)
    found, first = timed(lambda: solver(x0=begin, lbx=low, ubx=high, lbg=lower, ubg=upper))
    iterations = int(solver.stats()["iter_count"])
    near, bounds = NearBy(program), program.bounds.copy()
    nq = part.asked.stage.functions.space.nq
    bounds[:, :nq] += ASIDE / part.units[:nq]
    w, of_bounds, of_rows = (np.array(found[name]).ravel() for name in ("x", "lam_x", "lam_g"))
    solved, seconds = least(lambda: near(np.clip(w, *bounds), of_bounds, of_rows, bounds))
    steps, once = solved[3], least(near.look)[1]
    cost = float(found["f"]) * program.unit
    row = Row("acausal", cost, build, first, iterations, seconds, steps, (steps + 1) * once)
    return row, part


def by_hand(textbook: Textbook, part: Part, build_before: float) -> Row:
    """The same mesh and guess for `casadi.Opti`."""
    intervals, n, nu = part.mesh.intervals, textbook.start.size, textbook.most.size

    def built() -> tuple[ca.Opti, Any, Any, Any]:
        opti = ca.Opti()
        X, U, begin = opti.variable(n, 3 * intervals + 1), opti.variable(nu, 3 * intervals), opti.parameter(n)
        C, _, b = ca.collocation_coeff(_RADAU)
        h, cost = textbook.time / intervals, ca.MX(0)
        rates = textbook.rate.map(3)
        for i in range(intervals):
            block, own = X[:, 3 * i : 3 * i + 4], U[:, 3 * i : 3 * i + 3]
            opti.subject_to(ca.vec(block @ C - h * rates(block[:, 1:], own)) == 0)
            cost += h * ca.dot(ca.repmat(b.T, nu, 1), (own / ca.repmat(ca.DM(textbook.weights), 1, 3)) ** 2)
        opti.subject_to(X[:, 0] == begin)
        opti.subject_to(X[:, -1] == ca.DM(textbook.end))
        opti.subject_to(
            opti.bounded(-ca.repmat(ca.DM(textbook.most), 1, 3 * intervals), U, ca.repmat(ca.DM(textbook.most), 1, 3 * intervals))
        )
        for k in np.flatnonzero(np.isfinite(textbook.bound)).tolist():
            opti.subject_to(opti.bounded(-textbook.bound[k], X[k, :], textbook.bound[k]))
        opti.minimize(cost)
        opti.set_value(begin, textbook.start)
        values = part.guess.at(np.append(0.0, part.mesh.points.ravel()))
        opti.set_initial(X, values[:, :n].T)
        opti.set_initial(U, values[1:, values.shape[1] - nu :].T)
        opti.solver("ipopt", {"print_time": False}, by_hand_options(warm=False))
        return opti, X, U, begin

    (opti, X, U, begin), build = timed(built)
    found, first = timed(opti.solve)
    iterations, cost = int(opti.stats()["iter_count"]), float(found.value(opti.f))
    for one in (X, U, opti.lam_g):
        opti.set_initial(one, found.value(one))
    aside = np.where(np.arange(n) < n // 2, ASIDE, 0.0)
    opti.set_value(begin, textbook.start + aside)
    tries: list[tuple[float, dict[str, Any]]] = []
    for monotone in (False, True):  # either is the quicker one of some problem
        opti.solver("ipopt", {"print_time": False}, by_hand_options(warm=True, monotone=monotone))
        opti.solve()  # makes its functions
        tries.append((least(opti.solve)[1], opti.stats()))
    seconds, stats = min(tries, key=lambda one: one[0])
    return Row(
        "casadi.Opti, by hand",
        cost,
        build_before + build,
        first,
        iterations,
        seconds,
        int(stats["iter_count"]),
        functions_of(stats),
    )


def by_hand_options(*, warm: bool, monotone: bool = False) -> dict[str, Any]:
    """The same tolerances and start; the scaling and linear algebra of ipopt as they are usually."""
    found = ipopt_options(warm=warm, known=warm)
    if monotone:
        found |= {"ipopt.mu_strategy": "monotone", "ipopt.mu_init": 1e-8}
        found |= {key: 1e-9 for key in found if key.startswith("ipopt.warm_start_") and key.endswith(("push", "frac"))}
    ours_alone = ("nlp_scaling_method", "mumps_pivot_order", "fast_step_computation", "min_refinement_steps")
    own = {key.removeprefix("ipopt."): value for key, value in found.items() if key.startswith("ipopt.")}
    return {key: value for key, value in own.items() if key not in ours_alone}


def horizon() -> None:
    """A step of a receding horizon of the cart-pole with 25 intervals, by one step of a quadratic program and by ipopt."""
    scene = CartPole()
    ocp = ac.OptimalControl(ac.build(scene), 1.0)
    ocp.start({scene.rail.q: 0.3, scene.hinge.q: np.pi - 0.2})
    ocp.bound(scene.force, -30, 30)
    ocp.minimise(
        ac.integral(10 * scene.rail.q**2 + 50 * (scene.hinge.q - np.pi) ** 2 + 0.01 * scene.force**2 + 0.1 * scene.rail.v**2)
    )
    for solver in ("piqp", "ipopt"):
        control, build = timed(lambda solver=solver: ocp.controller(0.04, 25, order=3, controls="constant", solver=solver))
        control([0.3, np.pi - 0.2, 0, 0])
        x, times = np.array([0.3, np.pi - 0.2, 0, 0]), list[float]()
        for _ in range(30):
            times.append(timed(lambda control=control, x=x: control(x))[1])
            x = control.best.x[:, 1]
        print(
            f"receding horizon, 25 intervals, {solver}: build {1e3 * build:.0f} ms, a step {1e3 * float(np.median(times)):.2f} ms, {control.best.iterations} iterations"
        )


def recordings() -> None:
    """Five parameters of the cart-pole from two outputs at a hundred instants."""
    scene = CartPole()
    model = ac.build(scene)
    unknowns = [scene.mass, scene.load, scene.length, scene.drag, scene.rub]
    t = np.linspace(0.03, 3.0, 100)
    push = ac.samples(np.linspace(0, 3, 61), 4 * np.sin(2.1 * np.linspace(0, 3, 61)))
    start: Any = {scene.rail.q: 0.0, scene.hinge.q: 1.0}
    true = dict(zip(unknowns, (1.1, 0.33, 0.55, 0.4, 0.02), strict=True))
    run = model.simulate(3.0, start, inputs={scene.force: push}, parameters=true, rtol=1e-10).at(t)
    rng = np.random.default_rng(0)
    data: Any = {one: (t, run[one] + 0.002 * rng.normal(size=t.size), 0.002) for one in (scene.rail.q, scene.hinge.q)}
    first = {scene.drag: 0.2, scene.rub: 0.01}

    def fitted() -> Any:
        return ac.estimate(model, data, unknowns, start, inputs={scene.force: push}, parameters=first)

    fitted()
    found, seconds = least(fitted)
    print(f"five parameters from 200 samples: {1e3 * seconds:.1f} ms, {found.evaluations} motions with slopes\n{found}")


def main() -> None:
    """Prints tables."""
    for name, make, hand, intervals in (
        ("cart-pole, 25 intervals", cart_pole, cart_pole_by_hand, 25),
        ("six axes, 50 intervals", arm, arm_by_hand, 50),
    ):
        print(f"\n{name}\n\n{HEAD}")
        row, part = ours(make, intervals)
        print(row)
        textbook, build = timed(hand)
        print(by_hand(textbook, part, build))
    print()
    horizon()
    recordings()


if __name__ == "__main__":
    main()
