"""The searches for positions and velocities, from the names of start values and what has to close in any case."""

from __future__ import annotations

import copy
import functools
import itertools
import threading
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from acausal.errors import StartValueError
from acausal.language.expression import Derivative, Discrete, Expression, Symbol, sx
from acausal.loops.loop_groups import drawn
from acausal.numerics.bound import BoundFunction
from acausal.numerics.folding import folded_function
from acausal.numerics.sizes import Drawn
from acausal.numerics.vanishing import vanish
from acausal.outputs.expression_names import expression_name
from acausal.parts.free import FreeJoint
from acausal.parts.joint_coordinates import Coordinate
from acausal.start.coordinates import Coordinates, coordinates, turning_states
from acausal.start.start_search import Search, start_search
from acausal.start.start_values import Start, check_settable, near, start_numbers
from acausal.start.unknowns import Closing, Target, Unknowns

if TYPE_CHECKING:
    from acausal.outputs.outputs import Outputs
    from acausal.reduce.reduce import ReducedSystem

_KEPT = 64
_ALIKE = 100
"""Operations deep, to which expressions are compared as they are written."""


@dataclass(frozen=True)
class StartProblem:
    """Searches for positions, then velocities, from values of the `targets`; made once for their names, used often."""

    outputs: Outputs
    targets: tuple[Target, ...]
    positions: Search
    velocities: Search
    got: BoundFunction | None
    asked: tuple[tuple[Expression, bool], ...] = ()
    """Variables, and whether their values are met exactly."""
    held: tuple[int, ...] = ()
    """Which of the locks are closed, too."""
    lock: threading.Lock = field(default_factory=threading.Lock)
    """Bound functions serve one thread at a time."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _start_problem, (self.outputs, self.asked, self.held)

    def __deepcopy__(self, memo: dict[int, Any]) -> StartProblem:
        outputs = copy.deepcopy(self.outputs, memo)
        return self if outputs is self.outputs else _start_problem(outputs, copy.deepcopy(self.asked, memo), self.held)

    @functools.cached_property
    def size(self) -> int:
        """How many numbers the start values are."""
        return self.targets[-1].place.stop if self.targets else 0

    @functools.cached_property
    def scalars(self) -> bool:
        """Whether each is one number."""
        return self.size == len(self.targets)

    @functools.cached_property
    def coordinates(self) -> Coordinates:
        """Kinds and names of the entries of q, lengths measured by the whole mechanism as built."""
        r = self.outputs.system
        joints = coordinates(r.mechanics, r.p, r.p_values, r.constraints.q_start, r.scalar.position)
        scalars = zip(r.scalar_places[: r.scalar.positions], r.scalar_states, strict=False)
        others = tuple(
            Coordinate(self.outputs.name(s), slice(k, k + 1), s.unit, s.is_angle, s.is_angle and _turns_fully(r, k))
            for k, s in scalars
        )
        return replace(joints, all=(*joints.all, *others), scale=np.concatenate([joints.scale, np.ones(len(others))]))

    def measured(self, data: np.ndarray) -> Coordinates:
        """The same, measured by what each has to do with at the values `data`."""
        search = self.positions
        if search.whole is None:
            return self.coordinates
        return self.coordinates.measured(search.sizes(data, search.first(data)).unknowns, search.places)


def _turns_fully(r: ReducedSystem, k: int) -> bool:
    """Whether a full turn of entry k of x leaves all equations between positions as they are."""
    rows = r.scalar.closing
    turned = ca.substitute(rows, r.x[k], r.x[k] + 2 * np.pi)
    return vanish(turned - rows, r.p, r.p_values)


def start_problem(outputs: Outputs, start: Start, held: tuple[int, ...] = ()) -> StartProblem:
    """The searches for start values of these variables, with these locks closed; made when first asked for. Raises `StartValueError`."""
    known, same = outputs.start_problems, (tuple(start), tuple(map(type, start.values())), held)
    if same in known:
        return known[same]
    for key in start:
        if not isinstance(key, Expression):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass names and indices
            own = [n for n in ("q", "v", "position", "velocity") if isinstance(getattr(key, n, None), Expression)]
            hint = f"one of its variables: .{', .'.join(own)}" if own else "the variable itself"
            raise StartValueError(f"start: the key {key!r} is not a variable. Use {hint}, e.g. start={{scene.hinge.q: 0.3}}.")
    what = tuple((key, not isinstance(value, near)) for key, value in start.items())
    asked = (*((_identity(key), exact) for key, exact in what), held)
    problem = known.get(asked)
    if problem is None:
        if len(known) >= _KEPT:
            known.clear()
        problem = known[asked] = known[same] = _start_problem(outputs, what, held)
    return problem


def places_in_start(item: object, start: Start) -> list[int]:
    """Where the entries of an expression are among all numbers of start values, key by key and column by column: as a whole, or one by one, be they written anew. None where one
    of them is missing.
    """
    if not isinstance(item, Expression):
        return []
    given = [(key, entry) for key in start for entry in _entries(key)]
    whole = [k for k, (key, _) in enumerate(given) if key is item]
    if whole:
        return whole
    found = [[k for k, (_, entry) in enumerate(given) if ca.is_equal(entry, own, _ALIKE)][:1] for own in _entries(item)]
    return [k for places in found for k in places] if all(found) else []


def with_numbers(outputs: Outputs, start: Start, places: Sequence[int], numbers: np.ndarray) -> Start:
    """Start values with other numbers at these places, see `places_in_start`."""
    found, changed = dict(start), dict(zip(places, numbers.tolist(), strict=True))
    for target, (key, value) in zip(start_problem(outputs, start).targets, start.items(), strict=True):
        at = range(target.place.start, target.place.stop)
        if any(k in changed for k in at):
            found[key] = np.array([changed.get(k, old) for k, old in zip(at, start_numbers(target, value), strict=True)])
    return found


def _entries(written: Expression) -> list[ca.SX]:
    return ca.vertsplit(ca.vec(ca.densify(written.sx)))


def _identity(key: Expression) -> Hashable:
    """The same for expressions that are written alike: `frame.rotation[2, 0]` is another object each time it is written."""
    if isinstance(key, Symbol):
        return key
    symbols = ca.symvar(key.sx)
    f = folded_function("key", [ca.vertcat(ca.SX(0, 1), *symbols)], [key.sx])
    steps = tuple(
        (
            f.instruction_id(k),
            *f.instruction_input(k),
            *f.instruction_output(k),
            f.instruction_constant(k) if f.instruction_id(k) == ca.OP_CONST else 0.0,
        )
        for k in range(f.n_instructions())
    )
    return key.sx.shape, tuple(key.sx.sparsity().find()), tuple(s.element_hash() for s in symbols), key.leaves, steps


def _start_problem(outputs: Outputs, what: tuple[tuple[Expression, bool], ...], held: tuple[int, ...] = ()) -> StartProblem:
    r = outputs.system
    q, v = r.x[: r.nq, :], r.x[r.nq :, :]
    targets = _targets(outputs, what)
    size = sum(t.size for t in targets)
    moving = [bool(v.numel()) and ca.depends_on(t.expression, v) for t in targets]
    for target, at_velocity in zip(targets, moving, strict=True):
        if not at_velocity and not (q.numel() and ca.depends_on(target.expression, q)):
            raise StartValueError(f"{target.name} does not depend on the state: it is not free, so it cannot have a start value.")
    wanted = ca.SX.sym("wanted", size)
    data = ca.vertcat(wanted, r.t, r.u, r.p)
    free_q, free_v = _free_orientations(outputs)
    at_q, at_v = ([t for t, m in zip(targets, moving, strict=True) if m is kind] for kind in (False, True))
    position, velocity = _closing(outputs, held)
    turns, rates = turning_states(r)
    at = range(data.numel(), data.numel() + q.numel())
    positions = start_search("position", Unknowns(q, data, turns), wanted, position, at_q, r.q_start, free_q, r)
    moving_q = Unknowns(v, ca.vertcat(data, q), rates, True, at, turns)
    velocities = start_search("velocity", moving_q, wanted, velocity, at_v, r.rate_start, free_v, r)
    got = None
    if targets:
        results = ca.densify(ca.vertcat(*(t.expression for t in targets)))
        got = BoundFunction.of(ca.Function("got", [ca.vertcat(r.x, data)], [results]))
    return StartProblem(outputs, tuple(targets), positions, velocities, got, what, held)


def _targets(outputs: Outputs, what: tuple[tuple[Expression, bool], ...]) -> list[Target]:
    targets: list[Target] = []
    size = 0
    for key, exact in what:
        for leaf in key.leaves:
            if not _is_velocity(outputs, leaf):
                check_settable(leaf)
        expression = ca.vec(outputs.resolve(key))
        name, unit = expression_name(outputs, key), key.unit if isinstance(key, Symbol) else ""
        targets.append(Target(name, unit, expression, exact, outputs.is_angle(key), slice(size, size + expression.numel())))
        size += expression.numel()
    return targets


def _is_velocity(outputs: Outputs, leaf: Symbol) -> bool:
    """Whether it is the rate of what positions of joints determine: that of an Euler angle, say."""
    if not isinstance(leaf, Derivative) or isinstance(leaf.of, Derivative):
        return False
    r = outputs.system
    free = {s.element_hash() for s in ca.symvar(ca.vertcat(r.mechanics.tree.q, r.t, r.p))}
    return all(s.element_hash() in free for s in ca.symvar(outputs.resolve(leaf.of)))


def _closing(outputs: Outputs, held: tuple[int, ...]) -> tuple[Closing, Closing]:
    """What positions and velocities must meet in any case: joints' invariants, loops, scalar equations, in the order of `closing`; then what locks hold."""
    r = outputs.system
    loops = r.constraints.loops
    joints = [(f"the loop closed by joint '{rows.edge.name}' ({rows.edge.joint.created_at})", rows) for rows in loops]
    free = {s.element_hash() for s in ca.symvar(ca.vertcat(r.x[: r.nq, :], r.t, r.u, r.p))}
    signs = [rows.sign for rows in loops if rows.sign is not None and not rows.sign.is_constant()]
    signs = [s for s in signs if {a.element_hash() for a in ca.symvar(s)} <= free]
    meant: list[tuple[tuple[str, str] | None, int]] = [(None, sign.numel()) for sign in signs]
    for item in r.tree_joints:
        joint = item.edge.joint
        signs.append(joint.domain(r.x[item.q, :]))
        who = f"joint '{item.edge.name}' ({joint.created_at})"
        meant += [((who, why), 1) for why in joint.why_outside(signs[-1].numel())]
    locks = [] if r.locks is None else [(r.locks.rows[k], r.locks.places(k), r.locks.remembered(k)) for k in held]
    names = [(f"what {row.part.where} holds", own.stop - own.start) for row, own, _ in locks]
    standing = [not remembered for _, _, remembered in locks]
    signs += [0.5 - row.apart for row, _, remembered in locks if not remembered]
    meant += [(None, row.apart.numel()) for row, _, remembered in locks if not remembered]
    places = [r.locks.held_places[own] for _, own, remembered in locks if r.locks is not None and not remembered]
    speeds = [_now(outputs, r.locks.held_speeds[own], remembered) for _, own, remembered in locks if r.locks is not None]
    position = (
        ("the joints' own conditions (lengths of quaternions, contacts)", r.constraints.joint_invariants.numel()),
        *((words, rows.position.numel()) for words, rows in joints),
        ("the equations of gears and sources", r.scalar.closing.numel()),
        *itertools.compress(names, standing),
    )
    velocity = (
        *((words, rows.velocity.numel()) for words, rows in joints),
        ("the equations of scalar parts", r.scalar.velocity.numel()),
        *names,
    )
    none = ca.SX(0, 1)
    more, kept = (ca.vertcat(none, *rows).numel() for rows in (speeds, places))
    known = drawn(r.constraints.joint_invariants.numel(), loops, r.scalar.closing.numel() + kept)
    known_rates = Drawn.joined([*(rows.drawn for rows in loops), Drawn.exact(r.scalar.velocity.numel() + more)])
    return (
        Closing(ca.vertcat(r.closing, *places), position, ca.vertcat(none, *signs), tuple(meant), known),
        Closing(ca.vertcat(r.velocity_closing, *speeds), velocity, none, (), known_rates),
    )


def _now(outputs: Outputs, speeds: ca.SX, remembered: Sequence[Discrete]) -> ca.SX:
    """Speeds of what is held where it stands: what is remembered of that is as at the start."""
    starts = [outputs.resolve(sx(d.start)) for d in remembered]
    return ca.substitute(speeds, ca.vertcat(*(d.sx for d in remembered)), ca.vertcat(*starts)) if remembered else speeds


def _free_orientations(outputs: Outputs) -> tuple[list[int], list[int]]:
    """Entries of q and v that are quaternions and angular velocities of free bodies: a body told where to be need not turn."""
    q: list[int] = []
    v: list[int] = []
    for item in outputs.system.tree_joints:
        if isinstance(item.edge.joint, FreeJoint):
            q += range(item.q.start, item.q.start + 4)
            v += range(item.v.start, item.v.start + 3)
    return q, v
