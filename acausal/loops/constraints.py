"""Constraints of all loops together, which of their rows are independent, and what freedom is left."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.dynamics.system import MechanicalSystem
from acausal.loops.close_loops import close_loops
from acausal.loops.crossing import Trail
from acausal.loops.descent import singular_values_down
from acausal.loops.examined import Examined, Margin
from acausal.loops.loop_groups import LoopGroup, loop_groups
from acausal.loops.loops import LoopRows, loop_rows
from acausal.loops.mobility import locked, nearly_fitting, shaky, stopped
from acausal.loops.nearest_loops import distance_from_sketch
from acausal.loops.redundancy import RankReport, independent_rows, needed_rows, undecided
from acausal.loops.second_order import held_to_second_order
from acausal.loops.singular import row_scale, singular_values_along
from acausal.loops.sketch import sketch_configuration
from acausal.loops.walk import Walk, WalkFunctions

_SAMPLES = 8
_OPENED = 3
_OPENING = 0.2


@dataclass(frozen=True)
class Loops:
    """Rows of all loops, and functions for walks of each group of joints, whatever the parameters are."""

    loops: tuple[LoopRows, ...]
    walks: tuple[WalkFunctions, ...]


def _symbolic(system: MechanicalSystem, parameters: ca.SX) -> Loops:
    loops = tuple(loop_rows(edge, system.placement) for edge in system.mechanism.cuts)
    return Loops(loops, tuple(WalkFunctions(group, system.tree.t, parameters) for group in loop_groups(system, loops)))


@dataclass(frozen=True, repr=False)
class Constraints:
    """Independent rows of all cut joints, and the freedom that they leave.

    `position` (np, 1) and `velocity` (m, 1) residuals of the kept rows; `jacobian` A (m, nv) of `velocity` in v; `bias` (m, 1) so
    that A v' + bias = 0. `damped`: rows depend on one another in a way that only holds when assembled. The kept
    ones alone may then be met on other branches too, so these are used as well, with a rank-tolerant solve.
    `singular`: fewer rows are independent at some positions than elsewhere. `samples`: some assembled configurations (nq,).
    `joint_invariants`: of the tree's joints (quaternion norms, gaps). `kept` and `redundant` are names.
    """

    loops: tuple[LoopRows, ...]
    position: ca.SX
    velocity: ca.SX
    jacobian: ca.SX
    bias: ca.SX
    joint_invariants: ca.SX
    kept: tuple[str, ...]
    kept_index: tuple[int, ...]
    redundant: tuple[str, ...]
    vanishing: tuple[str, ...]
    rank: RankReport
    damped: bool
    singular: bool
    samples: tuple[np.ndarray, ...]
    opened: tuple[np.ndarray, ...]
    """Some configurations beside assembled ones, where loops are open by a share of their own size."""
    rates: np.ndarray
    """How much each velocity (nv,) is: what changes the configuration by its own size in a second."""
    parameters: tuple[int, ...]
    """Places of the parameters on which the loops depend."""
    values: np.ndarray
    """All parameters where the above was found."""
    examined: tuple[Examined, ...]
    """Groups of loops, each on its own."""
    symbolic: Loops
    near: np.ndarray | None
    """The configuration (nq,) from which was looked; None where it is that of the sketch."""
    time: float
    """When it was looked [s]."""

    def unchanged(self, values: np.ndarray) -> bool:
        """Whether the loops are the same for these values of the parameters (np,)."""
        places = list(self.parameters)
        return np.array_equal(self.values[places], values[places])

    def hold(self, values: np.ndarray) -> bool:
        """Whether the same rows are independent for these values of the parameters (np,), and none nearly depend on others, as far as some
        looks along a walk can tell. Costs milliseconds.
        """
        return all(part.holds(values) for part in self.examined)

    def margins(self, q: np.ndarray, time: float, values: np.ndarray) -> list[Margin]:
        """Of each group of loops, at a configuration (nq,) with closed loops and for these values of the parameters."""
        key = q.tobytes() + np.array(time).tobytes() + values.tobytes()
        found = self._margins.get(key)
        if found is None:
            found = [part.margin(q[list(part.group.q_places)], time, values) for part in self.examined]
            self._margins.clear()
            self._margins[key] = found
        return found

    @functools.cached_property
    def _margins(self) -> dict[bytes, list[Margin]]:
        """What was found last."""
        return {}

    def decides_as(self, other: Constraints) -> bool:
        """Whether the same rows are kept, and singular positions are met or not."""
        return self.choice == other.choice

    @property
    def choice(self) -> tuple[int, ...]:
        """What was decided, in numbers."""
        return self.rank.rank, self.damped, self.singular, self.narrow, *self.kept_index

    def met(self, q: np.ndarray) -> bool:
        """Whether the loops were looked at along the motions from a configuration (nq,), as far as is known."""
        key = q.tobytes()
        found = key in self._met or all(part.met(q[list(part.group.q_places)]) for part in self.examined)
        if found:
            self._met[:] = [key]
        return found

    @functools.cached_property
    def _met(self) -> list[bytes]:
        """Where this was found last: what is known only grows."""
        return []

    def usual_at(self, q: np.ndarray, time: float, values: np.ndarray) -> bool:
        """Whether as many rows as usual are independent at a configuration (nq,) with closed loops."""
        return all(
            part.rank.rank == margin.rank for part, margin in zip(self.examined, self.margins(q, time, values), strict=True)
        )

    def learn(self, other: Constraints | None) -> None:
        """What was decided alike along the motions from another configuration; None where nothing can be decided."""
        for part, there in zip(self.examined, self.examined if other is None else other.examined, strict=True):
            part.learn(None if other is None else there)

    @property
    def dropped(self) -> ca.SX:
        """Positions (n, 1) of rows that are not used, since they follow from the others."""
        positions, first, used = list[ca.SX](), 0, set(self.kept_index)
        for rows in self.loops:
            positions += [rows.position[k] for k in range(rows.position.numel()) if first + k not in used]
            first += rows.velocity.numel()
        return ca.vertcat(ca.SX(0, 1), *positions)

    @property
    def dependent(self) -> bool:
        """Whether the rows used depend on one another, everywhere or at some positions."""
        return self.damped or self.singular

    @property
    def follows(self) -> float:
        """By which part of its size a row that depends on others may miss these where loops are closed, as far as their drawing is known."""
        return max((part.walk.follows for part in self.examined if part.damped and part.walk is not None), default=0.0)

    @property
    def narrow(self) -> bool:
        """Whether motions may pass so closely by a singular position that rates lose digits there."""
        return not self.damped and any(part.narrow for part in self.examined)

    @functools.cached_property
    def places(self) -> tuple[int, ...]:
        """Of the parameters on which a configuration with closed loops depends, where joints also are in their domains."""
        return tuple(sorted({i for walk in self.symbolic.walks for i in walk.influences}))

    @property
    def drawn(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sizes of what met in the constants of `position` (np,), of `velocity` (m,) and of `dropped` (n,), which are known to rounding of these only."""
        every = np.concatenate([np.zeros(0), *(rows.drawn.sizes for rows in self.loops)])
        held = np.array([k < rows.position.numel() for rows in self.loops for k in range(len(rows.names))], dtype=bool)
        used = np.isin(np.arange(every.size), self.kept_index)
        return every[used & held], every[used], every[~used & held]

    @functools.cached_property
    def much(self) -> tuple[np.ndarray, np.ndarray]:
        """How much positions (nq,) and velocities (nv,) that loops hold are beside others; 0 for those that they do not."""
        positions, velocities = np.zeros(self.q_start.size), np.zeros(self.rates.size)
        for part in self.examined:
            assert part.walk is not None
            positions[list(part.group.q_places)] = part.walk.unit
            velocities[list(part.group.v_places)] = part.rates
        return positions, velocities

    @functools.cached_property
    def row_sizes(self) -> tuple[np.ndarray, np.ndarray]:
        """What is much in the positions of all rows of the loops (k,), and in the rows of `velocity` (m,), wherever loops are closed or open."""
        positions, velocities = dict[str, float](), dict[str, float]()
        for part in self.examined:
            assert part.walk is not None
            names = [name for rows in part.group.loops for name in rows.names[: rows.position.numel()]]
            positions |= dict(zip(names, part.walk.row_sizes[part.group.invariants.numel() :].tolist(), strict=True))
            velocities |= dict(zip(part.group.names, part.walk.sizes_of_velocities[1].tolist(), strict=True))
        every = [name for rows in self.loops for name in rows.names]
        closed = [name for rows in self.loops for name in rows.names[: rows.position.numel()]]
        return np.array([positions[name] for name in closed]), np.array([velocities[every[k]] for k in self.kept_index])

    @property
    def slips(self) -> tuple[int, ...]:
        """Places in `velocity` of rows that are not rates of position rows: rolling without slip."""
        slip = [k >= rows.position.numel() for rows in self.loops for k in range(rows.velocity.numel())]
        return tuple(k for k, i in enumerate(self.kept_index) if slip[i])

    @property
    def q_start(self) -> np.ndarray:
        """An assembled configuration (nq,), where searches begin."""
        return self.samples[0]


def joint_invariants(system: MechanicalSystem) -> ca.SX:
    """Invariants of the joints in the tree, (n, 1)."""
    tree = system.tree
    rows = [j.edge.joint.invariants(tree.q[j.q], tree.t) for j in tree.joints]
    return ca.vertcat(*rows) if rows else ca.SX(0, 1)


def analyse_constraints(
    system: MechanicalSystem,
    parameters: ca.SX,
    values: np.ndarray,
    near: np.ndarray | None = None,
    time: float = 0.0,
    known: Constraints | None = None,
    onward: np.ndarray | None = None,
) -> Constraints:
    """Close the loops numerically, find the redundant rows, keep the others.

    Looks from the configuration `near` (nq,), that of the sketch unless given, at this `time` [s]. `known`: of the same system, with other
    values; what does not depend on them is taken from there. `onward` (nq,), with closed loops: where motions go on to that are looked along; those
    from a singular configuration may have one freedom or another.
    Raises `AssemblyError` when a loop cannot close, `LockedError` when no freedom is left.
    """
    tree = system.tree
    symbolic = _symbolic(system, parameters) if known is None else known.symbolic
    loops = symbolic.loops
    sketch = sketch_configuration(system, parameters, values) if near is None else near
    found: list[Examined] = []
    for asked in symbolic.walks:
        group = asked.group
        guess = sketch[list(group.q_places)]
        if not group.is_bound:
            found.append(_unbound(group, guess))
            continue
        walk, start = _closed(system, asked, values, sketch, time)
        ahead = start if onward is None else onward[list(group.q_places)] / walk.unit
        found.append(_examined(walk, start, ahead, values) if group.names else _unbound(group, start * walk.unit))
    _check_locked(found, tree.v.numel())
    empty = {name for part in found for name in part.empty}
    loops = tuple(rows.without(empty) for rows in loops)
    rank = sum(part.rank.rank for part in found)
    samples = _together([(part.group, part.samples) for part in found], tree.q.numel())
    beside = _together([(part.group, part.opened) for part in found], tree.q.numel())
    rates = np.ones(tree.v.numel())
    for part in found:
        rates[list(part.group.v_places)] = part.rates
    kept = {part.group.names[i] for part in found for i in part.rank.kept}
    chosen_names = {part.group.names[i] for part in found for i in part.chosen}
    names = [name for rows in loops for name in rows.names]
    is_position = [k < rows.position.numel() for rows in loops for k in range(rows.velocity.numel())]
    chosen = [i for i, name in enumerate(names) if name in chosen_names]
    position_index = np.cumsum(is_position) - 1
    position = ca.vertcat(ca.SX(0, 1), *(rows.position for rows in loops))[
        [int(position_index[i]) for i in chosen if is_position[i]], :
    ]
    velocity = ca.vertcat(ca.SX(0, 1), *(rows.velocity for rows in loops))[chosen, :]
    report = RankReport(
        tuple(i for i, name in enumerate(names) if name in kept), rank, sum(part.rank.rank_at_start for part in found)
    )
    return Constraints(
        loops, position, velocity, ca.densify(ca.jacobian(velocity, tree.v)), system.kinematics.rate(velocity), joint_invariants(system),
        tuple(name for name in names if name in kept), tuple(chosen), tuple(name for name in names if name not in kept),
        tuple(name for rows in loops for name in rows.dropped), report, any(part.damped for part in found),
        any(part.singular for part in found), samples, beside, rates, _influences(loops, parameters), np.array(values, dtype=float),
        tuple(part for part in found if part.walk is not None), symbolic, near, time,
    )  # fmt: skip


def _closed(
    system: MechanicalSystem, asked: WalkFunctions, values: np.ndarray, sketch: np.ndarray, time: float
) -> tuple[Walk, np.ndarray]:
    """A walk of a group, and the closed configuration z of it that is nearest to the sketch q (nq,)."""
    group, guess = asked.group, sketch[list(asked.group.q_places)]
    walk = Walk(asked, values, guess, time)
    return walk, close_loops(walk, guess, functools.partial(distance_from_sketch, system, group, walk, sketch))


def closed_sketch(system: MechanicalSystem, constraints: Constraints, values: np.ndarray) -> np.ndarray:
    """The `q_start` (nq,) that `constraints` would have, had the scene been built with these values of the parameters. Raises `AssemblyError`."""
    q, walks = constraints.q_start.copy(), constraints.symbolic.walks
    if not walks:
        return q
    sketch = sketch_configuration(system, walks[0].parameters, values) if constraints.near is None else constraints.near
    for asked in walks:
        places, own = list(asked.influences), list(asked.group.q_places)
        if np.array_equal(values[places], constraints.values[places]):
            continue
        if not asked.group.is_bound:
            q[own] = sketch[own]
        else:
            walk, z = _closed(system, asked, values, sketch, constraints.time)
            q[own] = z * walk.unit
    return q


def _unbound(group: LoopGroup, start: np.ndarray) -> Examined:
    """Joints without rows of loops."""
    n = group.v.numel()
    return Examined(group, [start], [start], RankReport((), 0, 0), (), False, False, np.zeros((0, n)), np.ones(n), False)


def _examined(walk: Walk, start: np.ndarray, ahead: np.ndarray, values: np.ndarray) -> Examined:
    """Looked along motions through `start`, on the side of it where `ahead` is."""
    group, t, parameters = walk.symbolic.group, walk.symbolic.t, walk.symbolic.parameters
    first = [] if ahead is start else [start]
    samples: list[np.ndarray] = []
    jacobians: list[np.ndarray] = []
    rank = RankReport((), 0, 0)
    # a look nearby is enough where all rows are independent; where some are redundant, look along the whole motion
    for reach in (1, _SAMPLES):
        samples = [*first, *walk.samples(ahead, reach)]
        jacobians = [walk.at(z)[2] for z in samples]
        rank = independent_rows(jacobians, walk.rank, walk.dependent)
        if rank.rank == len(group.names):
            break
    # what is driven by time or inputs moves though no joint does
    at_rest = ca.substitute(group.velocity, group.v, ca.SX.zeros(group.v.numel()))
    timed = ca.depends_on(ca.vertcat(group.closing, group.velocity), t) or not at_rest.is_zero()
    between = undecided([walk.at(walk.polished(z))[2] for z in samples], rank.rank, walk.follows, walk.dependent)
    stuck = len(samples) == 1 and rank.rank < group.v.numel() and not timed
    scale = row_scale(jacobians)
    if (between or stuck) and held_to_second_order(walk, start, scale):
        raise stopped(group.loops)
    if between:
        raise nearly_fitting(group.loops, walk.rows(start), between)
    if stuck:
        raise shaky(group.loops, group.v.numel(), rank.rank)
    trail = singular_values_along(walk, ahead, scale, rank.rank, rank.kept) if rank.rank else Trail()
    if 0 < rank.rank < group.v.numel() - 1 and not trail.singular:
        trail = trail.and_then(singular_values_down(walk, samples, scale, rank.rank, rank.kept))
    singular = trail.singular
    if singular:  # what is usual away from singular positions is seen from afar
        samples = [*first, *walk.samples(ahead, _SAMPLES)]
        jacobians = [walk.at(z)[2] for z in samples]
    beside = _opened(samples)
    chosen = needed_rows(rank.kept, [*jacobians, *(walk.at(z)[2] for z in beside)], walk.rank)
    return Examined(
        group,
        [z * walk.unit for z in samples],
        [z * walk.unit for z in beside],
        rank,
        chosen,
        len(chosen) > rank.rank,
        singular,
        walk.rows(start),
        walk.rate,
        timed,
        _empty(walk),
        walk,
        scale,
        tuple((smallest, z * walk.unit) for smallest, z in trail.places),
        trail.crossings,
        trail.back,
        _influences(group.loops, parameters),
        values,
    )


def _influences(loops: Sequence[LoopRows], parameters: ca.SX) -> tuple[int, ...]:
    rows = ca.vertcat(ca.SX(0, 1), *(ca.vertcat(rows.position, rows.velocity) for rows in loops))
    used = {s.element_hash() for s in ca.symvar(rows)}
    return tuple(i for i in range(parameters.numel()) if parameters[i].element_hash() in used)


def _empty(walk: Walk) -> tuple[str, ...]:
    group, t, parameters = walk.symbolic.group, walk.symbolic.t, walk.symbolic.parameters
    rows = [rows.velocity[k] for rows in group.loops for k in range(len(rows.names))]
    places = [rows.position[k] if k < rows.position.numel() else ca.SX(0) for rows in group.loops for k in range(len(rows.names))]
    return tuple(
        name
        for name, row, place, empty in zip(group.names, rows, places, walk.empty, strict=True)
        if empty and not ca.depends_on(ca.vertcat(row, place), ca.vertcat(t, parameters))
    )


def _opened(samples: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Configurations z beside assembled ones, where loops are open."""
    rng = np.random.default_rng(2)
    return [z + _OPENING * rng.uniform(-1, 1, z.size) for z in samples[:_OPENED]]


def _check_locked(found: Sequence[Examined], freedoms: int) -> None:
    """Locked loops may be carried by what moves; nothing moves where all joints are in such loops. Raises `LockedError`."""
    stuck = [part for part in found if part.rank.rank >= part.group.v.numel() > 0 and not part.timed]
    if stuck and sum(part.group.v.numel() for part in stuck) == freedoms:
        raise locked(stuck[0].group.loops, stuck[0].group.v.numel(), stuck[0].A)


def _together(found: Sequence[tuple[LoopGroup, list[np.ndarray]]], size: int) -> tuple[np.ndarray, ...]:
    """Configurations (size,) from the first, second, ... one of each group, or its last."""
    result = [np.zeros(size) for _ in range(max((len(own) for _, own in found), default=1))]
    for group, own in found:
        for k, q in enumerate(result):
            q[list(group.q_places)] = own[min(k, len(own) - 1)]
    return tuple(result)
