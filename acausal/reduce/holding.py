"""How much freedom scalar equations take from a mechanism: gears, sources, cams, in any mixture of joints and scalar states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np

from acausal.dynamics.system import MechanicalSystem
from acausal.loops.constraints import Constraints
from acausal.numerics.assembly import assemble
from acausal.numerics.sizes import Drawn, Sizes, row_sizes, unknown_sizes
from acausal.numerics.terms import finite, rounded
from acausal.numerics.thresholds import CLOSED, RANK
from acausal.numerics.vanishing import equilibrated_rank
from acausal.scalar.coupling import ScalarPart

_POINTS = 4
_SPREAD = 0.3
_TIMES = 1.3 * 4.0 ** np.arange(-16, 17, 4)
"""Of which some belong to any motion that is given [s]."""


class Reduced(Protocol):
    """What is asked of a reduced system."""

    @property
    def mechanics(self) -> MechanicalSystem: ...
    @property
    def constraints(self) -> Constraints: ...
    @property
    def scalar(self) -> ScalarPart: ...
    @property
    def t(self) -> ca.SX: ...
    @property
    def x(self) -> ca.SX: ...
    @property
    def u(self) -> ca.SX: ...
    @property
    def p(self) -> ca.SX: ...
    @property
    def nq(self) -> int: ...
    @property
    def p_values(self) -> np.ndarray: ...
    @property
    def u_defaults(self) -> np.ndarray: ...
    @property
    def rate_start(self) -> np.ndarray: ...
    @property
    def closing(self) -> ca.SX: ...
    @property
    def samples(self) -> list[np.ndarray]: ...


@dataclass(frozen=True)
class Holding:
    """Freedoms of the joints that scalar equations take, after scalar states have given way: in `velocities`, and in `positions`.

    `again`: how many of the velocity equations say what loops say already.
    """

    velocities: int
    positions: int
    again: int = 0


def holding(system: Reduced, positions: list[np.ndarray]) -> Holding:
    """Ranks at some `positions` (nq,) where everything is closed, velocities and other scalar states at random.

    Equations that only say what scalar states are take nothing: with rows R, and L of the loops, that is
    rank (L, R by joints and scalar states) - rank L - rank (R by scalar states).
    """
    scalar = system.scalar
    if not scalar.held:
        return Holding(0, 0)
    found = [_ranks(*blocks[:3]) + _ranks(*blocks[3:6]) for blocks in _rows(system, positions)]
    if not found:
        return Holding(sum(h.depth == 1 for h in scalar.held), scalar.position.numel())
    both, loop, states_alone, alone, both_q, loop_q, states_q, _ = np.max(found, axis=0)
    return Holding(int(both - loop - states_alone), int(both_q - loop_q - states_q), int(loop + alone - both))


def looped(system: Reduced, positions: list[np.ndarray]) -> list[int]:
    """Places of scalar equations between positions that closed loops hold already, wherever these are assembled. As few as leave all others independent."""
    scalar = system.scalar
    velocities = [h for h in scalar.held if h.depth == 1]
    rates = {h.number for h in scalar.held if h.depth > 1 and not ca.depends_on(h.residual, system.t)}
    points = _rows(system, positions)
    kept, found = list(range(len(velocities))), list[int]()

    def together(rows: list[int]) -> list[int]:
        return [_ranks(loops, joints[rows], states[rows])[0] for loops, joints, states, *_ in points]

    def agree(rows: list[int]) -> bool:
        """Whether they, with loops, are met by some speeds, whatever is given by the time."""
        n = system.constraints.velocity.numel()
        for loops, joints, states, *_, speeds in points:
            both = np.block([[loops, np.zeros((len(loops), states.shape[1]))], [joints[rows], states[rows]]])
            asked = speeds[[*range(n), *(n + k for k in rows)]]
            if any(equilibrated_rank(np.column_stack([both, one])) > equilibrated_rank(both) for one in asked.T):
                return False
        return True

    whole = together(kept)
    for k in reversed(range(len(velocities))):
        rest = [i for i in kept if i != k]
        alone = [_ranks(loops, joints[kept], states[kept])[1::2] for loops, joints, states, *_ in points]
        if all(loop + own <= both for (loop, own), both in zip(alone, whole, strict=True)):
            break
        if velocities[k].number in rates and together(rest) == whole and (agree(kept) or not agree(rest)):
            kept = rest
            found.append(velocities[k].equation)
    return found


def _rows(system: Reduced, positions: list[np.ndarray]) -> list[list[np.ndarray]]:
    """Slopes of the velocity equations of loops by velocities, of scalar equations by those and by scalar states that they move, then the same of positions; where
    finite, and nothing for what rounding leaves of none. And what is asked of speeds by the time.
    """
    scalar, tree = system.scalar, system.mechanics.tree
    n = scalar.positions
    states = ca.vertcat(ca.SX(0, 1), *(s.sx for s in scalar.states))
    velocity = ca.vertcat(ca.SX(0, 1), *(h.residual for h in scalar.held if h.depth == 1))
    loops = ca.vertcat(ca.SX(0, 1), *(rows.position for rows in system.constraints.loops))
    yields = [k for k in range(n, states.numel()) if scalar.correction is None or not scalar.correction[2][k].is_zero()]
    parts = [
        ca.jacobian(system.constraints.velocity, tree.v), ca.jacobian(velocity, tree.v), ca.jacobian(velocity, states)[:, yields],
        ca.jacobian(loops, tree.q), ca.jacobian(scalar.position, tree.q), ca.jacobian(scalar.position, states[:n]),
    ]  # fmt: skip
    given = [system.t, system.x, system.u, system.p]
    function = ca.Function("rows", given, [ca.densify(part) for part in parts])
    terms = ca.Function("terms", given, [ca.densify(rounded(velocity)), ca.densify(rounded(scalar.position))])
    (q_much, v_much), (closed, moving) = system.constraints.much, system.constraints.row_sizes
    moved = np.zeros(system.rate_start.size)
    moved[: v_much.size] = v_much
    rng = np.random.default_rng(6)
    speeds = _speeds(system)
    found: list[list[np.ndarray]] = []
    for q in positions:
        rates = system.rate_start + rng.uniform(-1, 1, system.rate_start.size)
        x = np.concatenate([q, rates])
        blocks = [
            np.array(part)
            for part in function(0.0, x, system.u_defaults + rng.uniform(size=system.u_defaults.shape), system.p_values)
        ]
        if all(np.isfinite(block).all() for block in blocks):
            by_v, by_q = (
                finite(np.array(part)[:, 0])
                for part in terms(0.0, np.concatenate([q, moved]), system.u_defaults, system.p_values)
            )
            blocks[0] = _heard(blocks[0], RANK * moving, v_much)
            blocks[1] = _heard(blocks[1], CLOSED * by_v, v_much)
            blocks[3] = _heard(blocks[3], RANK * closed, q_much)
            blocks[4] = _heard(blocks[4], CLOSED * by_q, q_much)
            found.append([*blocks, speeds(q)])
    return found


def _speeds(system: Reduced) -> Callable[[np.ndarray], np.ndarray]:
    """What the velocity equations of loops and the scalar ones (n, m) ask for at positions q (nq,) where nothing moves, at some times."""
    velocity = ca.vertcat(system.constraints.velocity, *(h.residual for h in system.scalar.held if h.depth == 1))
    if not ca.depends_on(velocity, system.t):
        return lambda q: np.zeros((velocity.numel(), 0))
    at_rest = ca.Function("at_rest", [system.t, system.x, system.u, system.p], [ca.densify(velocity)])

    def asked(q: np.ndarray) -> np.ndarray:
        x = np.concatenate([q, np.zeros(system.rate_start.size)])
        return np.column_stack([finite(np.array(at_rest(t, x, system.u_defaults, system.p_values)).ravel()) for t in _TIMES])

    return asked


def _heard(slopes: np.ndarray, least: np.ndarray, much: np.ndarray) -> np.ndarray:
    """Slopes (m, n) of rows by coordinates of which so `much` (n,) is much, 0 where that is not known, without those that make no more than `least` (m,) of
    them: equilibrated, rows of rounding errors would look like others.
    """
    return np.where((np.abs(slopes) * much > least[:, None]) | (much == 0), slopes, 0.0)


def closed_positions(system: Reduced) -> list[np.ndarray]:
    """Configurations (nq,) at which loops and scalar equations are closed, from here and there; if there is none, where the search began."""
    rng = np.random.default_rng(7)
    q = system.x[: system.nq, :]
    closing, none = system.closing, Drawn.exact(system.closing.numel())
    given = [q, system.t, system.u, system.p]
    rows = ca.Function("closing", given, [ca.densify(closing), ca.densify(ca.jacobian(closing, q))])
    terms = ca.Function("terms", given, [ca.densify(rounded(closing))])

    def residual(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, J = rows(y, 0.0, system.u_defaults, system.p_values)
        return np.array(c).ravel(), np.array(J).reshape(-1, y.size)

    def rounding(y: np.ndarray) -> np.ndarray:
        return finite(np.array(terms(y, 0.0, system.u_defaults, system.p_values)).ravel())

    scalar, starts = system.scalar, system.samples
    turns = np.append(system.mechanics.tree.turning[0], [s.is_angle for s in scalar.states[: scalar.positions]]).astype(bool)
    J = np.max([np.abs(np.nan_to_num(residual(y)[1])) for y in starts], axis=0)
    unit = unknown_sizes(J, turns, rounding(starts[0]), none)
    sizes = Sizes(unit, row_sizes(J, unit, rounding(starts[0])), rounding)
    guesses = [starts[k % len(starts)] + _SPREAD * (k > 0) * unit * rng.uniform(-1, 1, q.numel()) for k in range(_POINTS)]
    found = [assemble(residual, guess, sizes=sizes, limit=40) for guess in guesses] if closing.numel() else []
    return [a.y for a in found if a.converged] or guesses


def _ranks(loops: np.ndarray, by_joints: np.ndarray, by_states: np.ndarray) -> list[int]:
    """Of (L, R by joints and scalar states), of L, of R by scalar states, and of R by both."""
    both = np.block([[loops, np.zeros((loops.shape[0], by_states.shape[1]))], [by_joints, by_states]])
    return [
        equilibrated_rank(both),
        equilibrated_rank(loops),
        equilibrated_rank(by_states),
        equilibrated_rank(both[loops.shape[0] :]),
    ]
