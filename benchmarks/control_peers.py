"""Optimal control beside other tools: rockit (the same collocation, of textbook equations) and crocoddyl (differential dynamic programming, with Pinocchio's).

python -m benchmarks.control_peers

Rows are those of `benchmarks.optimal_control`, of the same problems, but that the arm has no bounds of speed, which crocoddyl's solver for bounded inputs does not
know. It has no conditions at the end either, but a cost of what is left of the way; and its torques are constant in each interval (Runge-Kutta, order 4), which costs
a little more. (Its release 3.2.1 computes without gravity beside Pinocchio 4.1: the extra asks for an older one.)
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

import acausal as ac
from benchmarks.optimal_control import (
    ASIDE,
    HEAD,
    Row,
    Textbook,
    arm,
    by_hand_options,
    cart_pole,
    cart_pole_by_hand,
    functions_of,
    least,
    ours,
    timed,
)
from examples.control.robot_arm import AXES, END, LINKS, START, TORQUES, Arm

_WEIGHT, _STOP = 1e4, 1e-6
"""Of crocoddyl: what a squared unit of the way that is left costs, and where it stops."""


def by_rockit(textbook: Textbook, part: Any, intervals: int) -> Row:
    """Forces are rockit's algebraic variables: free at each point of collocation, as everywhere here."""
    import rockit

    n, nu = textbook.start.size, textbook.most.size
    ocp = rockit.Ocp(T=textbook.time)
    x, u, begin = ocp.state(n), ocp.algebraic(nu), ocp.parameter(n)
    ocp.set_der(x, textbook.rate(x, u))
    ocp.subject_to(ocp.at_t0(x) == begin)
    ocp.subject_to(ocp.at_tf(x) == textbook.end)
    ocp.subject_to((-textbook.most <= u) <= textbook.most, grid="integrator_roots")
    ocp.add_objective(ocp.integral(ca.sumsqr(u / textbook.weights)))
    times = np.linspace(0, textbook.time, 4 * intervals + 1)
    values = part.guess.at(times)
    guessed = [ca.interpolant("guess", "linear", [times.tolist()], one.tolist())(ocp.t) for one in values.T]
    ocp.set_initial(x, ca.vertcat(*guessed[:n]))
    ocp.set_initial(u, ca.vertcat(*guessed[-nu:]))
    ocp.set_value(begin, textbook.start)
    ocp.solver("ipopt", {"print_time": False, **{f"ipopt.{key}": value for key, value in by_hand_options(warm=False).items()}})
    ocp.method(rockit.DirectCollocation(N=intervals, degree=3, scheme="radau"))
    _, build = timed(ocp.transcribe)
    found, first = timed(ocp.solve)
    opti = ocp._method.opti
    cost, iterations = float(found.sol.value(opti.f)), int(opti.stats()["iter_count"])
    for one in (opti.x, opti.lam_g):
        opti.set_initial(one, found.sol.value(one))
    opti.set_value(opti.p, textbook.start + np.where(np.arange(n) < n // 2, ASIDE, 0.0))
    opti.solver("ipopt", {"print_time": False}, by_hand_options(warm=True, monotone=True))
    opti.solve()  # makes its functions
    seconds, stats = least(opti.solve)[1], opti.stats()
    return Row("rockit", cost, build, first, iterations, seconds, int(stats["iter_count"]), functions_of(stats))


def quick_arm() -> ac.OptimalControl:
    """As fast as its torques make it."""
    return arm(speed=np.inf)


def by_crocoddyl(intervals: int) -> tuple[Row, float]:
    """And how far from the end the last state is."""
    import crocoddyl
    import pinocchio as pin

    turns = {"x": pin.JointModelRX, "y": pin.JointModelRY, "z": pin.JointModelRZ}
    most, first, last = np.array(TORQUES), np.append(START, np.zeros(6)), np.append(END, np.zeros(6))

    def built() -> tuple[Any, Any, list[np.ndarray], list[np.ndarray]]:
        model, parent, place = pin.Model(), 0, np.zeros(3)
        for k, (axis, tip, link) in enumerate(zip(AXES, LINKS, Arm().links, strict=True)):
            parent = model.addJoint(parent, turns[axis](), pin.SE3(np.eye(3), place), f"r{k}")
            inertia = pin.Inertia(link.mass, np.array(link.centre_of_mass, dtype=float), np.array(link.central_inertia))
            model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
            place = np.array(tip, dtype=float)
        state = crocoddyl.StateMultibody(model)
        motors = crocoddyl.ActuationModelFull(state)
        effort, way = crocoddyl.CostModelSum(state, 6), crocoddyl.CostModelSum(state, 6)
        squares = crocoddyl.ActivationModelWeightedQuad(2 / most**2)  # it halves them
        effort.addCost("effort", crocoddyl.CostModelResidual(state, squares, crocoddyl.ResidualModelControl(state, 6)), 1.0)
        way.addCost("way", crocoddyl.CostModelResidual(state, crocoddyl.ResidualModelState(state, last, 6)), _WEIGHT)
        moves, ends = (crocoddyl.DifferentialActionModelFreeFwdDynamics(state, motors, cost) for cost in (effort, way))
        step = crocoddyl.IntegratedActionModelRK(moves, crocoddyl.RKType.four, 0.5 / intervals)
        step.u_lb, step.u_ub = -most, most
        problem = crocoddyl.ShootingProblem(first, [step] * intervals, crocoddyl.IntegratedActionModelEuler(ends, 0.0))
        solver = crocoddyl.SolverBoxFDDP(problem)
        solver.th_stop = _STOP
        begin = [(1 - share) * first + share * last for share in np.linspace(0, 1, intervals + 1)]
        data = model.createData()
        torques = [pin.rnea(model, data, x[:6], np.zeros(6), np.zeros(6)) for x in begin[:-1]]
        return solver, problem, begin, torques

    (solver, problem, xs, us), build = timed(built)
    _, seconds = timed(lambda: solver.solve(xs, us, 1000, False))
    iterations, h = int(solver.iter), 0.5 / intervals
    cost = sum(h * float(np.sum((u / most) ** 2)) for u in solver.us)
    aside = float(np.max(np.abs(solver.xs[-1] - last)))
    xs, us = [x.copy() for x in solver.xs], [u.copy() for u in solver.us]
    problem.x0 = first + np.append(np.full(6, ASIDE), np.zeros(6))
    _, warm = least(lambda: solver.solve([problem.x0, *xs[1:]], us, 1000, False))
    return Row("crocoddyl", cost, build, seconds, iterations, warm, int(solver.iter), float("nan")), aside


def main() -> None:
    """Prints tables."""
    print(f"cart-pole, 25 intervals\n\n{HEAD}")
    row, part = ours(cart_pole, 25)
    print(row)
    print(by_rockit(cart_pole_by_hand(), part, 25))
    print(f"\nsix axes without bounds of speed, 50 intervals\n\n{HEAD}")
    print(ours(quick_arm, 50)[0])
    row, aside = by_crocoddyl(50)
    held = quick_arm().solve(50, controls="constant", refinements=0, guesses=0).cost
    print(
        f"{row}\n\ncrocoddyl ends {aside:.1g} rad and rad/s aside; with torques that are held here, too, its cost is off by {abs(row.cost / held - 1):.1g}"
    )


if __name__ == "__main__":
    main()
