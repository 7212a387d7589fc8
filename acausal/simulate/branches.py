"""A start where branches of the motion cross: whether its velocities lie on one of them."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.collocation.problem import Problem
from acausal.errors import StartValueError
from acausal.integrators.passage import Passage, passage_of
from acausal.outputs.functions import Functions
from acausal.start.decided import OtherFreedoms
from acausal.wording import compact

_OFF = 1e-6
_BENT, _NEAR = 1e-4, 30.0
"""What constraints without a slope may ask of accelerations, in units of velocities squared; the same for the slope that they have."""
_SHOWN = 6


def check_branch(functions: Functions, problem: Problem, t0: float, t1: float, x: np.ndarray) -> None:
    """Raise `StartValueError` where the velocities of a start x (nx,) at a singular position belong to no motion that goes on from there.

    A little ahead and back along the velocities the loops are closed; the motion through these places has the velocities that are asked
    for, or others. From rest accelerations say where it goes.
    """
    passage = passage_of(problem) if functions.outputs.system.constraints.singular else None
    if passage is None or not t1 > t0 or not passage.is_crossing(t0, x):
        return
    joints = ", ".join(f"'{rows.edge.name}'" for rows in functions.outputs.system.constraints.loops)
    if _stops(functions, problem, t0, x):
        raise StartValueError(
            f"The start is a singular position of the loops closed by {joints}, and so are all those that it leads to: more is free there than "
            "elsewhere, and what stops it, stops it to second order only, by forces that nothing determines. Leave out what holds nothing that the "
            "others do not hold along this motion, a fourth parallel rod for instance, or start beside it."
        )
    begun = _begun(passage, t0, x)
    rests = _rests(functions, t0, t1, x, begun, problem.parameters)
    ahead, what = (begun, "what it accelerates with from rest lies") if rests else (x, "the velocities lie")
    _check_freedoms(functions, passage, t0, ahead)
    told = _off(functions, passage, t0, t1, ahead)
    if not told:
        return
    raise StartValueError(
        f"The start is a singular position of the loops closed by {joints}: branches of the motion cross there, and {what} on none "
        f"of them: {told}. Give velocities of more joints, such that they are those of one branch, or start a little beside the position."
    )


def _check_freedoms(functions: Functions, passage: Passage, t: float, x: np.ndarray) -> None:
    """Raise `OtherFreedoms` where motions of other freedoms meet in a state x (nx,), and the loops were examined along others than it goes on with.

    That is where its velocities lead to: as a rod on a Cardan joint one axis of which is the rod itself turns about that, or swings about the other.
    """
    system, space, p = functions.outputs.system, functions.space, passage.problem.parameters
    values, ahead = p[: system.p_values.size], _rates(functions, t, x, p)
    q = space.expanded(t, x, p)[: system.nq]
    for part in system.constraints.examined:
        places = list(part.group.q_places)
        there = part.beside(q[places], ahead[places], t, values)
        if there is None or (rank := part.margin(there, t, values).rank) == part.rank.rank:
            continue
        near, n = q.copy(), part.group.v.numel()
        near[places] = there
        joints = compact((f"'{rows.edge.name}'" for rows in part.group.loops), 4)
        raise OtherFreedoms(
            f"At t = {t:.6g} s, where this begins, motions of {n - rank} and of {n - part.rank.rank} freedoms of the loops closed by {joints} meet, and it is "
            f"not known how those of {n - rank} go on. Begin a little beside this position, or build the scene there: give bodies a rough position or "
            "joints a start.", t, q, values, near,
        )  # fmt: skip


def _off(functions: Functions, passage: Passage, t0: float, t1: float, x: np.ndarray) -> str:
    """What of the velocities of a state x (nx,) lies on no branch, in words; nothing if all do."""
    n, names = passage.problem.positions, functions.state_names[passage.problem.positions :]
    start = np.array([t0]), x[None, :]
    found = passage.between(*start, passage.crossing(*start, np.array([t1 - t0])))[0]
    if not np.isfinite(found).all():
        if not _tears(functions, passage.problem, t0, x):
            return ""
        largest = np.argsort(-np.abs(x[n:]), kind="stable")[:_SHOWN]
        return ", ".join(f"{names[i]} = {x[n + i]:.4g}" for i in sorted(int(i) for i in largest))
    off, here = (_energy(functions, passage.problem, t0, x, v) for v in (found[n:] - x[n:], x[n:]))
    if off <= _OFF**2 * here:
        return ""
    largest = np.argsort(-np.abs(found[n:] - x[n:]), kind="stable")[:_SHOWN]
    return ", ".join(f"{names[i]} = {x[n + i]:.4g} (near by: {found[n + i]:.4g})" for i in sorted(int(i) for i in largest))


def _begun(passage: Passage, t: float, x: np.ndarray) -> np.ndarray:
    """A state x (nx,) with accelerations in the place of velocities: it leads the way that a motion goes from rest."""
    n = passage.problem.positions
    return np.concatenate([x[:n], passage.rates(np.array([t]), x[None, :])[0, n:]])


def _rests(functions: Functions, t0: float, t1: float, x: np.ndarray, begun: np.ndarray, p: np.ndarray) -> bool:
    """Whether loops in a state x (nx,) move by rounding only until t1, or until they have accelerated to as much."""
    much = functions.outputs.system.constraints.much[0]
    speed, more = (float(np.max(np.abs(_rates(functions, t0, y, p))[much > 0] / much[much > 0])) for y in (x, begun))
    return speed * min(t1 - t0, speed / (2 * more) if more > 0 else np.inf) <= np.finfo(float).eps


def _rates(functions: Functions, t: float, x: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Those of the tree's coordinates (nq,)."""
    system, space = functions.outputs.system, functions.space
    rates = ca.Function("rates", [system.t, space.x, space.p], [ca.densify(space.put(system.mechanics.tree.rates))])
    return np.array(rates(t, x, p))[:, 0]


def _stops(functions: Functions, problem: Problem, t: float, x: np.ndarray) -> bool:
    """Whether more is free of some loops in a state x (nx,) at time t than can move, and wherever they can move to."""
    system = functions.outputs.system
    q = functions.space.expanded(t, x, problem.parameters)[: system.nq]
    return any(part.stopped(q[list(part.group.q_places)], t, problem.parameters) for part in system.constraints.examined)


def _tears(functions: Functions, problem: Problem, t: float, x: np.ndarray) -> bool:
    """Whether no accelerations keep the loops closed to second order: A v' = -bias has no solution where rows of A depend on one another."""
    system, space = functions.outputs.system, functions.space
    c, tree = system.constraints, system.mechanics.tree
    if ca.depends_on(c.velocity, tree.t):
        return False
    there = ca.Function(
        "there", [system.t, space.x, space.p], [space.put(ca.densify(part)) for part in (c.jacobian, c.bias, tree.v)]
    )
    rows = ca.Function("rows", [system.t, tree.q, system.p], [c.jacobian])
    size = np.max([np.linalg.norm(np.array(rows(t, q, c.values)) * c.rates, axis=1) for q in c.samples], axis=0)
    A, bias, v = (np.array(part) for part in there(t, x, problem.parameters))
    A, bias = (part / np.where(size > 0, size, 1.0)[:, None] for part in (A, bias))
    speed = float(np.max(np.abs(v[:, 0] / c.rates), initial=0.0))
    U, s, _ = np.linalg.svd(A * c.rates)
    s = np.concatenate([s, np.zeros(U.shape[1] - s.size)])
    flat = s < _OFF**0.5
    return bool(np.any(np.abs(U.T @ bias)[flat, 0] > np.maximum(_BENT, _NEAR * s[flat]) * speed**2))


def _energy(functions: Functions, problem: Problem, t: float, x: np.ndarray, v: np.ndarray) -> float:
    """Kinetic energy of velocities v, also where some are prescribed."""
    n, u, p = problem.positions, problem.inputs(np.array([t]))[:, 0], problem.parameters
    one, other, rest = (float(functions.kinetic_energy(t, np.concatenate([x[:n], f * v]), u, p)) for f in (1.0, -1.0, 0.0))
    return 0.5 * (one + other) - rest
