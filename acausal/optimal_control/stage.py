"""One point of a motion with everything that belongs to it: states, accelerations, multipliers of loops, inputs, all as unknowns.

The equations of motion stand in residual form, since recursive Newton-Euler with the accelerations as unknowns has a fraction of the operations of the
explicit dynamics, above all in second derivatives.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.charts.independent import independent_entries
from acausal.language.expression import Expression, Parameter
from acausal.numerics.folding import folded_function
from acausal.optimal_control.mode import PhaseMode
from acausal.outputs.functions import Functions

_GLANCES, _BESIDE = 6, 0.5
"""At how many places beside a point it is looked up what changes there, and how far that is, in what is much for each state."""


@dataclass(frozen=True, eq=False)
class Stage:
    """A model in a `mode`, whose time runs from `t0` [s]; `p` (np,): values of parameters; `free`: those that are found with the motion."""

    mode: PhaseMode
    t0: float
    p: np.ndarray
    free: tuple[Parameter, ...]

    @property
    def functions(self) -> Functions:
        """Of the model."""
        return self.mode.functions

    @functools.cached_property
    def sizes(self) -> tuple[int, int, int, int]:
        """Of states, accelerations, multipliers (of loops, then reactions, then those that stretch quaternions) and inputs."""
        space = self.functions.space
        return space.x.numel(), space.velocities, self.reacting + len(self.quaternions), len(self.mode.inputs)

    @functools.cached_property
    def reacting(self) -> int:
        """Number of multipliers of loops and of reactions."""
        return self.functions.outputs.system.constraints.jacobian.shape[0] + self.mode.reactions.numel()

    @functools.cached_property
    def quaternions(self) -> list[list[int]]:
        """Numbers of the states of each."""
        found = self.functions.quaternion_states
        return [found[k : k + 4] for k in range(0, len(found), 4)]

    @property
    def width(self) -> int:
        """Number of unknowns at a point."""
        return sum(self.sizes)

    @functools.cached_property
    def unknowns(self) -> ca.SX:
        """States, accelerations, multipliers, inputs, then the duration of the motion [s] and free parameters."""
        reactions, velocities = self.mode.reactions, self.sizes[1]
        self_made = ca.SX.sym("acceleration", velocities), ca.SX.sym("multipliers", self.reacting - reactions.numel())
        given = (ca.SX.sym("stretch", len(self.quaternions)), *(entry.sx for entry in self.mode.inputs))
        geometry = ca.SX.sym("free", len(self.free))
        return ca.vertcat(self.functions.space.x, *self_made, reactions, *given, ca.SX.sym("duration"), geometry)

    @functools.cached_property
    def bounds(self) -> list[tuple[ca.SX, str]]:
        """What must not be negative for its mode to go on, and what that is called."""
        space = self.functions.space
        found = [pair for law in self.mode.laws for pair in self.mode.bounds(law)]
        return [(space.put(self._alive(value)), name) for value, name in found]

    @functools.cached_property
    def open_gaps(self) -> ca.Function:
        """See `slopes`: of what is open."""
        return self.slopes(self.functions.space.put(self.mode.open_gaps))

    @functools.cached_property
    def data(self) -> ca.SX:
        """When: as a part of the duration; and the length of the interval, likewise."""
        return ca.SX.sym("when", 2)

    @functools.cached_property
    def _parts(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
        ends = np.cumsum([*self.sizes, 1, len(self.free)]).tolist()
        w = self.unknowns
        x, a, loops, u, duration, geometry = (w[b:e, :] for b, e in zip([0, *ends[:-1]], ends, strict=True))
        return x, a, loops, u, duration, geometry

    @property
    def duration(self) -> ca.SX:
        """Of the whole motion [s]."""
        return self._parts[4]

    @property
    def geometry(self) -> ca.SX:
        """Free parameters, as unknowns (free, 1)."""
        return self._parts[5]

    def put(self, expression: ca.SX) -> ca.SX:
        """An expression in t, x, u, p as one of `unknowns` and `data`."""
        space, system = self.functions.space, self.functions.outputs.system
        p = ca.SX(self.p)
        known = list(system.flat.parameters)
        for k, parameter in enumerate(self.free):
            p[known.index(parameter)] = self._parts[5][k]
        found = ca.substitute([expression], [system.t, space.p], [self.t0 + self.data[0] * self.duration, p])
        return found[0]

    @functools.cached_property
    def rates(self) -> ca.SX:
        """x' (nx, 1): of positions by velocities, of velocities the unknown accelerations, of other states as they are."""
        space = self.mode.free.space
        given = space.put(space.kept(self._alive(space.system.x_dot)))
        first, last = space.nq, space.nq + space.velocities
        return ca.vertcat(given[:first, :], self._parts[1], given[last:, :])

    @functools.cached_property
    def collocated(self) -> ca.SX:
        """`rates`, with quaternions stretched by multipliers of their own, by so much that they keep their length: all four entries are collocated,
        since none of them follows from the others all the way round.
        """
        rates = ca.SX(self.rates)
        for k, places in enumerate(self.quaternions):
            rates[places] += self._parts[2][self.reacting + k] * self.functions.space.x[places]
        return rates

    @functools.cached_property
    def balance(self) -> ca.SX:
        """What is off of the equations of motion: of forces, then of accelerations of loops, and what each reaction is given by."""
        return ca.vertcat(self.balance_at(self.rates, self._parts[2]), *self._by_laws(self.rates))

    def balance_at(self, rates: ca.SX, multipliers: ca.SX) -> ca.SX:
        """What is off of forces, then of accelerations of loops, for rates of states (nx, 1) and these multipliers."""
        f = self.mode.free
        space, loops = f.space, f.outputs.system.constraints.jacobian.shape[0]
        everything = ca.substitute(space.system.u, self.mode.reactions, multipliers[loops : self.reacting, :])
        residual = f.residual_dynamics(space.system.t, space.x, rates, multipliers[:loops, :], self._alive(everything), space.p)
        first, last, end = space.nq, space.nq + space.velocities, space.x.numel()
        return ca.vertcat(residual[first:last, :], residual[end:, :])

    def _by_laws(self, rates: ca.SX) -> list[ca.SX]:
        space = self.functions.space
        return [self.mode.row(law, space.x, rates, lambda v: space.put(self._alive(v))) for law in self.mode.laws]

    def _alive(self, value: ca.SX) -> ca.SX:
        """Without reactions that move nothing."""
        known = {s.element_hash() for s in ca.symvar(self.mode.reactions)}
        dead = [r.sx for r in self.mode.free.outputs.system.flat.reactions if r.sx.element_hash() not in known]
        return ca.substitute(value, ca.vertcat(*dead), ca.SX.zeros(len(dead))) if dead else value

    @functools.cached_property
    def acting(self) -> np.ndarray:
        """(reacting,): which multipliers are given by what acts, and not by accelerations that are held."""
        held = [self.mode.holds(law) and not self.mode.rate(law).is_constant() for law in self.mode.laws]
        loops = self.reacting - self.mode.reactions.numel()
        of_laws = [not hold for law, hold in zip(self.mode.laws, held, strict=True) for _ in law.row.reactions]
        return np.array([False] * loops + of_laws, dtype=bool)

    @functools.cached_property
    def invariants(self) -> tuple[ca.SX, int]:
        """What is off of loops and of lengths of quaternions, and how many of these rows are of positions; the first ones."""
        f, mode = self.functions, self.mode
        positions = 0 if f.invariants is None else f.constraint_position.numel_out(0)
        rows = ca.SX(0, 1) if f.invariants is None else f.invariants(*f.space.arguments)
        gaps, speeds = f.space.put(mode.gaps), f.space.put(mode.speeds)
        return ca.vertcat(rows[:positions, :], gaps, rows[positions:, :], speeds), positions + gaps.numel()

    @functools.cached_property
    def closing(self) -> ca.Function:
        """(unknowns, data) -> invariants, and their slopes by the states (rows, nx)."""
        return self.slopes(self.invariants[0])

    def slopes(self, column: ca.SX) -> ca.Function:
        """(unknowns, data) -> a column, and its slopes by the states (rows, nx)."""
        return self._with_slopes(column, 0, self.sizes[0])

    @functools.cached_property
    def indifferent(self) -> np.ndarray:
        """(nq,): positions on which nothing about the motion depends, as of what flies or drives: it goes on there as it goes."""
        nq = self.functions.space.nq
        everything = self.put(ca.veccat(self.rates, self.balance, self.invariants[0]))
        return ~np.array(ca.which_depends(everything, self.unknowns[:nq], 1, False), dtype=bool)

    def drift(self, x: np.ndarray, at: float, more: np.ndarray) -> np.ndarray:
        """(nq,): rates of positions in states (nx,) at a part of the duration; `more`: this and free parameters."""
        nq, nv = self.functions.space.nq, self.sizes[1]
        still = np.concatenate([x[:nq], np.zeros(nv), x[nq + nv :], np.zeros(self.width - x.size), more])
        constant, matrix = (np.array(part) for part in self.moving(still, [at, 0.0]))
        return constant[:, 0] + matrix @ x[nq : nq + nv]

    @functools.cached_property
    def moving(self) -> ca.Function:
        """(unknowns, data) -> rates of positions, and their slopes by the velocities (nq, velocities)."""
        nq, nv = self.functions.space.nq, self.sizes[1]
        return self._with_slopes(self.rates[:nq, :], nq, nq + nv)

    @functools.cached_property
    def driving(self) -> ca.Function:
        """(unknowns, data) -> `balance`, and its slopes by accelerations, multipliers and inputs."""
        return self._with_slopes(self.balance, self.sizes[0], self.width)

    def _with_slopes(self, column: ca.SX, first: int, last: int) -> ca.Function:
        inside = self.put(column)
        slopes = ca.densify(ca.jacobian(inside, self.unknowns)[:, first:last])
        return folded_function("with_slopes", [self.unknowns, self.data], [inside, slopes])

    def opened(self, wanted: Expression | float) -> ca.SX:
        """A user's expression (n, 1) in t, x, u, p and the other unknowns: reactions by accelerations and multipliers, not by solving for them."""
        if not isinstance(wanted, Expression):
            return ca.SX(float(wanted))
        f = self.mode.free
        s = f.outputs.system
        given = f.outputs.rates_and_multipliers
        found = ca.vec(ca.densify(f.outputs.opened(wanted)))
        if ca.depends_on(found, given):
            everything = f.space.put(s.x)
            full = ca.jacobian(everything, f.space.x) @ self.rates + ca.jtimes(everything, s.t, ca.SX(1))
            found = ca.substitute(found, given, ca.vertcat(full, self._parts[2][: s.multipliers.numel(), :]))
        return f.space.put(self._alive(found))

    @staticmethod
    def slopes_of(f: ca.Function, z: np.ndarray, at: float) -> np.ndarray:
        """Of one of these functions at a part of the duration."""
        return np.array(f(z, [at, 0.0])[1])

    def ruling(self, z: np.ndarray, at: float, units: np.ndarray) -> list[int]:
        """Numbers of the multipliers that are not idle: given by what acts, or holding what others do not."""
        nx, nv, _, _ = self.sizes
        slopes = self.slopes_of(self.driving, z, at)[nv:, :nv] * units[nx : nx + nv]
        held = np.flatnonzero(~self.acting)
        ruled = {int(held[r]) for r in independent_rows(slopes[held])}
        ruled |= {r for r in range(self.reacting) if self.acting[r] and not self.silent[r]}
        return sorted(ruled)

    @functools.cached_property
    def silent(self) -> np.ndarray:
        """(reacting,): which multipliers are reactions of what is open, and zero."""
        loops = self.reacting - self.mode.reactions.numel()
        pairs = zip(self.mode.laws, self.mode.words, strict=True)
        return np.array([False] * loops + [word in ("open", "off") for law, word in pairs for _ in law.row.reactions], dtype=bool)

    @functools.cached_property
    def equation_names(self) -> list[str]:
        """Of each row of `balance`, for messages."""
        loops, nv = self.reacting - self.mode.reactions.numel(), self.sizes[1]
        first = self.functions.space.nq
        moving = [f"the equations of motion of {self.functions.state_names[first + i]}" for i in range(nv)]
        ruled = [f"the law of {law.name}" for law in self.mode.laws for _ in law.row.reactions]
        return [*moving, *(["the equations of motion of loops"] * loops), *ruled]

    def told(self, u: np.ndarray) -> np.ndarray:
        """Inputs of the model (nu,) or (nu, n): with its masks."""
        masks = np.broadcast_to(self.mode.masks.reshape(-1, *(1,) * (u.ndim - 1)), (self.mode.masks.size, *u.shape[1:]))
        return np.concatenate([u, masks])

    def used(self, expressions: Sequence[ca.SX]) -> list[int]:
        """Numbers of the `unknowns` that stand in expressions that have been `put`."""
        inside = {s.element_hash() for e in expressions for s in ca.symvar(e)}
        return [k for k in range(self.unknowns.numel()) if self.unknowns[k].element_hash() in inside]


def independent_rows(matrix: np.ndarray) -> tuple[int, ...]:
    """Numbers of rows that do not follow from others, as many as can be."""
    return independent_entries(matrix.T).dependent if matrix.size else ()


def independent_states(
    stage: Stage, z: np.ndarray, at: float, units: np.ndarray, preferred: Sequence[int] = (), *, whole: bool = False
) -> tuple[list[int], list[int]]:
    """Which states (of all but those that follow) are collocated, with `whole` quaternions, as far as loops do not hold these; and which invariants hold the others: rows
    that do not follow from others.
    """
    n = stage.invariants[1]
    nx, nv, _, _ = stage.sizes
    nq = stage.functions.space.nq
    J = stage.slopes_of(stage.closing, z, at) * units[:nx]
    kept = list(range(nx))
    used: list[int] = []
    for block, columns in (((0, n), range(nq)), ((n, len(J)), range(nq, nq + nv))):
        own = J[slice(*block)][:, list(columns)]
        length = np.linalg.norm(own, axis=1)
        own = own / np.where(length > 0, length, 1.0)[:, None]
        gone = independent_entries(own, [k - columns.start for k in preferred if k in columns]).dependent
        gone = _unfolded(stage, z, at, units, own, gone) if columns.start == 0 and gone and not preferred else gone
        dependent = {k + columns.start for k in gone}
        dependent -= _turning(stage, dependent, z) if whole else set()
        kept = [k for k in kept if k not in dependent]
        used += [block[0] + r for r in independent_rows(own)]
    return kept, used


def _unfolded(stage: Stage, z: np.ndarray, at: float, units: np.ndarray, J: np.ndarray, gone: tuple[int, ...]) -> tuple[int, ...]:
    """These positions that depend on others, or others where these fold beside: two of their values go with the same others, as of a leg that leans one way or the other below a hip, and a
    motion that followed them would leap from one to the other. `J` (rows, nq): of the conditions.
    """
    n, nq, rng, aside = len(J), J.shape[1], np.random.default_rng(2), np.zeros(z.size)
    rows, near = list(independent_rows(J)), [J]
    for _ in range(_GLANCES):
        aside[:nq] = _BESIDE * units[:nq] * rng.uniform(-1, 1, nq)
        near.append(stage.slopes_of(stage.closing, z + aside, at)[:n, :nq] * units[:nq])
    changing = np.flatnonzero(np.any([there * J < 0 for there in near], axis=(0, 1)))
    others = independent_entries(J, changing.tolist()).dependent
    if others == gone or len(rows) != len(gone):
        return gone

    def least(chosen: tuple[int, ...]) -> float:
        """Of their smallest singular value; 0 where they fold."""
        blocks = np.array([there[np.ix_(rows, chosen)] for there in near])
        signs = np.sign(np.linalg.det(blocks))
        return float(np.min(np.linalg.svd(blocks, compute_uv=False))) if np.all(signs == signs[0]) else 0.0

    return others if least(others) > least(gone) else gone


def _turning(stage: Stage, dependent: set[int], z: np.ndarray) -> set[int]:
    """Of each quaternion that can turn the largest of the entries that depend on others: this one follows from its length, which a multiplier keeps."""
    held = [[k for k in places if k in dependent] for places in stage.quaternions]
    return {max(own, key=lambda k: abs(z[k])) for own in held if 0 < len(own) < 4}
