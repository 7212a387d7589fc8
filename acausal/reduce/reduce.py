"""Reduction: a scene becomes x' = f(t, x, u, p) with the least states, its invariants, and a way to express anything else."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import functools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.dynamics.forward_dynamics import articulated_inertias, forward_dynamics
from acausal.dynamics.mode_rows import LockRows, ModeRow
from acausal.dynamics.system import MechanicalSystem, mechanical_system
from acausal.dynamics.tree import JointSymbols, Tree
from acausal.errors import AssemblyError, LockedError, ModelError, OverdeterminedError
from acausal.language.connector import Electrical
from acausal.language.equation import input_rates
from acausal.language.expression import Input, InputRate, Mode, Reaction, Symbol, Variable, stacked, time
from acausal.language.flatten import FlatSystem, Part
from acausal.loops.constraints import Constraints, analyse_constraints, closed_sketch
from acausal.loops.loop_forces import loop_forces, on_branch, projection
from acausal.parts.pose import symbolic
from acausal.reduce.geared_rotors import geared_rotors
from acausal.reduce.holding import Holding, closed_positions, holding, looped
from acausal.reduce.implicit import with_reactions
from acausal.reduce.locks import Locks, locks_of
from acausal.reduce.modes import Modes, modes_of
from acausal.reduce.motion import Motion
from acausal.reduce.places import places
from acausal.reduce.signals import with_signals
from acausal.scalar.coupling import Held, ScalarPart, add_scalar_domains
from acausal.topology.build_mechanism import build_mechanism
from acausal.wording import compact, counted, grouped

_KEPT = 16
"""Values of parameters for which the closed sketch is kept."""


@dataclass(frozen=True, repr=False)
class ReducedSystem:
    """States x = (q, scalar positions, v, other scalar states), their rates, constraint multipliers and invariants, as `SX` in t, x, u and p.

    Scalar positions are those that equations tie to coordinates of joints or to one another. `projection`: one Newton step towards the
    invariants, in the mass metric.
    """

    flat: FlatSystem
    mechanics: MechanicalSystem
    constraints: Constraints
    t: ca.SX
    x: ca.SX
    u: ca.SX
    p: ca.SX
    p_values: np.ndarray
    u_defaults: np.ndarray
    x_dot: ca.SX
    v_dot: ca.SX
    multipliers: ca.SX
    tau: ca.SX
    position_invariants: ca.SX
    velocity_invariants: ca.SX
    projection: ca.SX | None
    delassus: ca.SX
    """A M^-1 A' of the kept rows: loses rank where a loop is singular."""
    clearance: ca.SX | None
    """Zero where branches of the motion cross, see `LoopForces.clearance`; None where they never do."""
    scalar: ScalarPart
    extra: ca.SX | None = None
    """More joint forces, by which an analysis has extended the scene."""
    modes: Modes | None = None
    """Which reactions hold, by masks that are the last inputs."""
    locks: Locks | None = None
    """What is imposed and released, by what is remembered."""
    unmasked: ReducedSystem | None = None
    """With modes, the same where reactions are inputs still."""
    exact: tuple[ca.SX, ca.SX] | None = None
    """`x_dot` and `projection` once more for arithmetic with twice as many digits, where loops come close to singular positions."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Made again from its parts, where and with the values where it was decided: the same expressions, other symbols."""
        if self.extra is not None:
            raise TypeError("A system that inverse dynamics has extended by forces cannot be pickled; pickle the model.")
        return _made_again, (self.mechanics.flat, *self._decided_at)

    def __deepcopy__(self, memo: dict[int, Any]) -> ReducedSystem:
        """Itself, since it never changes; that of the copied scene where the scene is copied along with it, and before it."""
        flat = self.mechanics.flat
        return (
            _made_again(copy.deepcopy(flat, memo), *self._decided_at)
            if any(id(p.component) in memo for p in flat.parts)
            else self
        )

    @property
    def _decided_at(self) -> tuple[np.ndarray, np.ndarray | None, float]:
        """Values of parameters, and the configuration and time from which loops were examined."""
        return self.p_values, self.constraints.near, self.constraints.time

    def __str__(self) -> str:
        c = self.constraints
        rows = [
            f"{self.flat.name}: {self.x.numel()} states, {c.jacobian.shape[0]} constraints, {self.degrees_of_freedom} degrees of freedom"
        ]
        edges = [item.edge for item in self.tree_joints]
        rows += grouped([(e.name, f"q {e.joint.q.size}, v {e.joint.v.size}") for e in edges])
        rows += grouped([(self.flat.names.get(s, s.name), f"scalar state [{s.unit}]") for s in self.scalar_states])
        rows += [f"  kept: {compact(c.kept) or 'none'}; redundant: {compact((*c.redundant, *c.vanishing)) or 'none'}"]
        return "\n".join(rows)

    def forces_at(self, v_dot: ca.SX) -> ca.SX:
        """Joint forces (nv, 1), less those of constraints, of motions with accelerations v_dot (nv, 1): where these alone tell what rotors take,
        they do, and not the equations of motion.
        """
        led = self.scalar.led
        if led is None or not self._finite(led):
            return self.tau
        return led(v_dot) if self.extra is None else led(v_dot) + self.extra

    def _finite(self, led: Callable[[ca.SX], ca.SX]) -> bool:
        """Whether forces by accelerations are numbers, at some point; they are not where efforts follow from what yields."""
        v_dot, rng = ca.SX.sym("v_dot", self.tree_velocities), np.random.default_rng(0)
        arguments = [v_dot, self.t, self.x, self.u]
        found = ca.Function("led", [*arguments, self.p], [led(v_dot)])
        return bool(np.isfinite(np.array(found(*(rng.normal(size=a.numel()) for a in arguments), self.p_values))).all())

    @property
    def scalar_states(self) -> tuple[Symbol, ...]:
        """The states of scalar domains, in the order of x."""
        return self.scalar.states

    @property
    def scalar_places(self) -> tuple[int, ...]:
        """Of the scalar states in x."""
        nq, nv, n = self.mechanics.tree.q.numel(), self.tree_velocities, self.scalar.positions
        return (*range(nq, nq + n), *range(nq + n + nv, self.x.numel()))

    @property
    def solved(self) -> dict[Symbol, ca.SX]:
        """Variables of scalar domains, by t, x, u and p."""
        return self.scalar.solved

    @property
    def nq(self) -> int:
        """Number of configuration variables, of joints and then of scalar positions; they come first in x."""
        return self.mechanics.tree.q.numel() + self.scalar.positions

    @property
    def tree_joints(self) -> tuple[JointSymbols, ...]:
        """The joints whose coordinates are states."""
        return self.mechanics.tree.joints

    @property
    def tree_velocities(self) -> int:
        """Number of velocity variables, before loops are closed."""
        return self.mechanics.tree.v.numel()

    @property
    def samples(self) -> list[np.ndarray]:
        """Some configurations (nq,) with closed loops; scalar positions at their `start`."""
        return [np.concatenate([q, self.scalar.start[: self.scalar.positions]]) for q in self.constraints.samples]

    @property
    def q_start(self) -> np.ndarray:
        """A configuration (nq,) with closed loops, where the search for initial values begins."""
        return self.samples[0]

    def q_start_at(self, values: np.ndarray) -> np.ndarray:
        """The same had the scene been built with these values of the parameters (np,): a start depends on what they are, not on what they were."""
        c = self.constraints
        key = values[list(c.places)].tobytes()
        if key == c.values[list(c.places)].tobytes():
            return self.q_start
        if key not in self._closed_sketches:
            if len(self._closed_sketches) >= _KEPT:
                self._closed_sketches.clear()
            q = self.q_start.copy()
            with contextlib.suppress(AssemblyError):  # the search for a start says what does not close
                q[: self.mechanics.tree.q.numel()] = closed_sketch(self.mechanics, c, values)
            self._closed_sketches[key] = q
        return self._closed_sketches[key]

    @functools.cached_property
    def _closed_sketches(self) -> dict[bytes, np.ndarray]:
        return {}

    @property
    def rate_start(self) -> np.ndarray:
        """Where the search for velocities (zeros) and other scalar states (their `start`) begins."""
        return np.concatenate([np.zeros(self.tree_velocities), self.scalar.start[self.scalar.positions :]])

    @property
    def closing(self) -> ca.SX:
        """All constraints of positions and joint invariants, redundant ones too, for assembly."""
        loops = [rows.position for rows in self.constraints.loops]
        return ca.vertcat(self.constraints.joint_invariants, *loops, self.scalar.closing)

    @property
    def velocity_closing(self) -> ca.SX:
        """All velocity constraints, redundant ones too, and those of scalar states."""
        return ca.vertcat(ca.SX(0, 1), *(rows.velocity for rows in self.constraints.loops), self.scalar.velocity)

    @property
    def degrees_of_freedom(self) -> int:
        """Independent velocities of the mechanism."""
        return self.mechanics.tree.v.numel() - self.constraints.rank.rank - self.holding.velocities

    @functools.cached_property
    def closed_positions(self) -> list[np.ndarray]:
        """Some configurations (nq,) at which loops and scalar equations are closed."""
        return closed_positions(self) if any(h.depth > 1 for h in self.scalar.held) else self.samples

    @property
    def moves_as_given(self) -> bool:
        """Whether there is something to compute though there is no state: motions that are prescribed, in time or by inputs, circuits without stores."""
        links = [link.motion.pose for link in self.mechanics.tree.links]
        values = [symbolic(part) for pose in links for part in (pose.position, pose.rotation)] + list(self.scalar.solved.values())
        circuits = any(isinstance(connector, Electrical) for connector in self.flat.connector_paths)
        return circuits or any(ca.depends_on(value, ca.vertcat(self.t, self.u)) for value in values)

    @functools.cached_property
    def _closed_at_start(self) -> ca.Function:
        assert self.locks is not None
        return ca.Function("closed", [self.u, self.p], [ca.densify(self.locks.closed_at_start)])

    def locks_at_start(self, u: np.ndarray, p: np.ndarray) -> tuple[int, ...]:
        """Those that are closed at a start with these inputs (nu,) and parameters (np,)."""
        if self.locks is None:
            return ()
        return tuple(np.flatnonzero(np.array(self._closed_at_start(u, p)).ravel() == 1).tolist())

    @functools.cached_property
    def led(self) -> tuple[Input, ...]:
        """Inputs that nonlinear equations give states by: these jump when they do."""
        used = {s.element_hash() for s in ca.symvar(self.scalar.residuals)}
        return tuple(entry for entry in self.flat.inputs if entry.sx.element_hash() in used and not isinstance(entry, Mode))

    @functools.cached_property
    def holding(self) -> Holding:
        """What scalar equations take of the freedom that loops leave."""
        return holding(self, self.closed_positions)


def reduce_system(
    mechanics: MechanicalSystem,
    extra: ca.SX | None = None,
    at: np.ndarray | None = None,
    constraints: Constraints | None = None,
    without: Collection[int] = (),
) -> ReducedSystem:
    """Accelerations, multipliers, scalar states and invariants of a scene. `extra`: more joint forces (nv, 1), by q, t and inputs.
    `at`: values of the parameters at which everything is decided, those of the scene unless given. `constraints`: of loops, where these have been
    examined for the same values. `without`: places of scalar equations that loops hold already.

    Errors of `analyse_constraints` and `add_scalar_domains`, `MasslessError`.
    """
    mechanics = mechanics.unsolved or mechanics
    unread, flat, tree = mechanics, mechanics.flat, mechanics.tree
    p = stacked([parameter.sx for parameter in flat.parameters])
    values = np.array([parameter.value for parameter in flat.parameters]) if at is None else at
    constraints = analyse_constraints(mechanics, p, values) if constraints is None else constraints
    tau = ca.SX.sym("tau", tree.v.numel())
    forces = loop_forces(mechanics, constraints, p, values)
    free = forward_dynamics(
        mechanics.kinematics, tau if extra is None else tau + extra, list(mechanics.wrenches), inertias=forces.inertias
    )
    v_dot, multipliers = forces.closed(free)
    step = projection(forces, ca.SX(0, 1))
    nq, nv = tree.q.numel(), tree.v.numel()
    closing = None if step is None else (_split(step, nq)[0] - tree.q, _split(step, nq)[1] - tree.v)
    scalar = add_scalar_domains(mechanics, tau, v_dot, values, closing, without)
    scalar = dataclasses.replace(scalar, held=(*_followed(tree), *scalar.held))
    read: list[tuple[ca.SX, ca.SX]] = []
    geared = (
        None
        if constraints.loops or mechanics.readings.borrowed or mechanics.readings.implicit
        else geared_rotors(scalar, tree, p, values)
    )
    if geared is not None:
        rest = geared.forces if extra is None else geared.forces + extra
        inertias = articulated_inertias(tree, geared.rotors)
        v_dot = forward_dynamics(mechanics.kinematics, rest, list(mechanics.wrenches), inertias=inertias)
        scalar = dataclasses.replace(scalar, tau=geared.forces - geared.resistance * v_dot)
    left: dict[Symbol, Part] = {}
    if mechanics.readings.borrowed:
        mechanics, scalar, read, left = with_signals(mechanics, scalar)
    steps = [[(tau, scalar.tau), *read]]
    if mechanics.readings.implicit or left:
        closed = _put(steps, v_dot), _put(steps, multipliers)
        mechanics, scalar, read = with_reactions(mechanics, constraints, *closed, scalar, left)
        steps.append(read)
    names = {**flat.names, **scalar.names}
    rates = _input_rates(
        flat, [v_dot, tree.rates, scalar.tau, scalar.rates, *scalar.solved.values(), *(h.residual for h in scalar.held)]
    )
    act = [rate.of for rate in rates if isinstance(rate.of, Reaction)]
    if act:
        error = ModelError(_rate_acts(mechanics, act[0]))
        error.reactions = tuple(act)
        raise error
    for rate in rates:
        names[rate] = f"der({names[rate.of]})"
    flat = dataclasses.replace(flat, names=names)
    u = stacked([entry.sx for entry in flat.inputs])
    v_dot, multipliers = _put(steps, v_dot), _put(steps, multipliers)
    states = stacked([s.sx for s in scalar.states])
    n = scalar.positions
    first, last = _split(states, n)
    x, second = ca.vertcat(tree.q, first, tree.v, last), ca.vertcat(v_dot, scalar.rates)
    arguments = [time.sx, tree.q, tree.v, states, u, p]
    exact = None
    if constraints.narrow or (constraints.singular and not constraints.damped):
        more = forces.exact()
        v_dot_more = more.closed(free)[0]
        rates = on_branch(ca.vertcat(_put(steps, v_dot_more), scalar.rates), more, arguments, exact=True)
        step_more = _corrected(projection(more, ca.SX(0, 1)), x, nq, scalar)
        exact = None if step_more is None else (_rates(tree, rates, nv, n), step_more)
    if constraints.dependent:
        second = on_branch(second, forces, arguments)
    clearance = forces.clearance if constraints.singular or constraints.narrow else None
    if clearance is not None and constraints.damped:
        clearance = on_branch(clearance, forces, arguments)
    x_dot = _rates(tree, second, nv, n)
    system = ReducedSystem(
        flat, mechanics, constraints, time.sx, x, u, p, values,
        np.array([entry.default for entry in flat.inputs]), x_dot, v_dot, multipliers, scalar.tau if extra is None else scalar.tau + extra,
        ca.vertcat(constraints.joint_invariants, constraints.position, scalar.position),
        ca.vertcat(constraints.velocity, scalar.velocity), _corrected(step, x, tree.q.numel(), scalar), forces.delassus, clearance, scalar, extra, exact=exact,
    )  # fmt: skip
    again = looped(system, system.closed_positions) if system.holding.again and not without else []
    if again:
        return reduce_system(unread, extra, at, constraints, again)
    _check_free(system)
    _check_known(system)
    system = _with_locks(system) if mechanics.locks else system
    return _with_modes(system) if mechanics.modes else system


def _with_locks(system: ReducedSystem) -> ReducedSystem:
    """With the reactions of what is imposed as it is held. Raises `ModelError`."""
    rows = system.mechanics.locks
    locks = locks_of(rows, _motion(system))
    r, found = locks.reactions, locks.found
    x_dot = ca.substitute(system.x_dot, r, ca.SX.zeros(r.numel())) + locks.response @ found
    mechanics = dataclasses.replace(system.mechanics.with_values([(r, found)]), locks=rows, unsolved=system.mechanics)
    alone = not mechanics.modes
    flat = dataclasses.replace(system.flat, solved=True) if alone else system.flat
    return dataclasses.replace(
        _with_found(system, rows, r, found), flat=flat, u=stacked([entry.sx for entry in flat.inputs]),
        u_defaults=np.array([entry.default for entry in flat.inputs]), x_dot=x_dot, locks=locks, mechanics=mechanics,
    )  # fmt: skip


def _with_modes(system: ReducedSystem) -> ReducedSystem:
    """With the reactions of parts that hold as long as they can as masks make them. Raises `ModelError`."""
    rows = system.mechanics.modes
    if not system.x.numel():
        system = _with_passages(system, rows)
    motion, names = _motion(system), system.flat.names
    modes, dead = modes_of(rows, names, motion)
    r, found, masks = dead, ca.SX.zeros(dead.numel()), tuple[Mode, ...](system.flat.modes)
    if modes is not None:
        modes = dataclasses.replace(modes, masks=(*modes.masks, *masks))
        r, found, masks = modes.symbols, modes.with_dead(modes.found), modes.masks
    moving = [] if modes is None else [modes.rate, modes.free]
    given = {rate: f"der({system.flat.names.get(rate.of, rate.of.name)})" for rate in _input_rates(system.flat, moving)}
    names = {**system.flat.names, **given, **{mask: mask.name for mask in masks if mask not in system.flat.names}}
    flat = dataclasses.replace(system.flat, names=names, modes=masks, solved=True)
    return dataclasses.replace(
        _with_found(system, rows, r, found), flat=flat, u=stacked([entry.sx for entry in flat.inputs]),
        u_defaults=np.array([entry.default for entry in flat.inputs]), modes=modes, unmasked=system, mechanics=system.mechanics.with_reactions(r, found),
    )  # fmt: skip


def _with_passages(system: ReducedSystem, rows: Sequence[ModeRow]) -> ReducedSystem:
    """With states that nothing depends on, where there are no others: what has passed each valve, and what it has held back; steps are chosen by these. Raises `ModelError`."""
    states, rates, names = list[Variable](), list[ca.SX](), dict[Symbol, str]()
    for row in rows:
        if not row.one_way:
            raise ModelError(
                f"{row.part.where} changes its mode as the motion goes on, but nothing in the scene has a state. Add what stores energy: an inertia, a mass, a capacitor."
            )
        for word, rate in (("passed by", row.reactions[0].sx), ("held back by", row.moved)):
            states.append(Variable())
            rates.append(rate)
            names[states[-1]] = f"{word} {row.part.path}"
    scalar = dataclasses.replace(
        system.scalar, states=tuple(states), rates=ca.vertcat(*rates), names={**system.scalar.names, **names}
    )
    flat = dataclasses.replace(system.flat, names={**system.flat.names, **names})
    return dataclasses.replace(system, flat=flat, x=stacked([state.sx for state in states]), x_dot=scalar.rates, scalar=scalar)


def _motion(system: ReducedSystem) -> Motion:
    """Rates by reactions, which are inputs still; looked at with all locks let go, too: what one holds at the start may move later."""
    found = places(system)
    if system.locks is not None:
        held = ca.vertcat(*(row.held for row in system.locks.rows))
        holds = np.diff(ca.jacobian(held, system.u).sparsity().colind()) > 0
        let_go = tuple((t, x, np.where(holds, 0.0, u), p) for t, x, u, p in found)
        found = (*found, *let_go)
    return Motion(system.t, system.x, system.u, system.p, system.x_dot, system.nq, found)


def _with_found(system: ReducedSystem, rows: Sequence[ModeRow] | Sequence[LockRows], r: ca.SX, found: ca.SX) -> ReducedSystem:
    """With the reactions `r` of some rows as they are found."""

    def put(value: ca.SX) -> ca.SX:
        return ca.substitute(value, r, found) if value.numel() and ca.depends_on(value, r) else value

    solved = {symbol: put(value) for symbol, value in system.scalar.solved.items()}
    scalar = dataclasses.replace(
        system.scalar, rates=put(system.scalar.rates), tau=put(system.scalar.tau), led=None,
        solved=solved | {reaction: put(reaction.sx) for row in rows for reaction in row.reactions},
    )  # fmt: skip
    exact = None if system.exact is None else (put(system.exact[0]), system.exact[1])
    return dataclasses.replace(
        system, x_dot=put(system.x_dot), v_dot=put(system.v_dot), multipliers=put(system.multipliers), tau=put(system.tau), scalar=scalar, exact=exact,
    )  # fmt: skip


def _followed(tree: Tree) -> list[Held]:
    """What joints say of coordinates that are values and rates of inputs."""
    found: list[Held] = []
    for item in tree.joints:
        for row in ca.vertsplit(item.edge.joint.followed(item.edge.joint.q.sx)):
            found.append(
                Held(
                    row,
                    2,
                    -2 - len(found),
                    True,
                    True,
                    f"the course that '{item.edge.name}' follows ({item.edge.joint.created_at})",
                )
            )
    return found


def _rate_acts(mechanics: MechanicalSystem, reaction: Reaction) -> str:
    row = next(row for row in (*mechanics.modes, *mechanics.locks) if reaction in row.reactions)
    return (
        f"{mechanics.flat.names[reaction]} of {row.part.where} is decided by other states too, so that its rate would act: a clutch or a stop on a spring alone. "
        "Put a mass or an inertia where a force acts, a resistance or a leakage where a current flows."
    )


def _input_rates(flat: FlatSystem, used: Sequence[ca.SX]) -> list[InputRate]:
    """Rates of inputs that stand in what is `used`; who needs the second one has the first one too."""
    symbols = {s.element_hash() for s in ca.symvar(ca.veccat(ca.SX(0, 1), *used))}
    found: list[InputRate] = []
    for entry in flat.inputs:
        first, second = input_rates(entry)
        needed = [s.sx.element_hash() in symbols for s in (first, second)]
        found += [first] * any(needed) + [second] * needed[1]
    return found


def _made_again(flat: FlatSystem, values: np.ndarray, near: np.ndarray | None, t: float) -> ReducedSystem:
    mechanics = mechanical_system(build_mechanism(flat), time.sx)
    p = stacked([parameter.sx for parameter in flat.parameters])
    return reduce_system(mechanics, at=values, constraints=analyse_constraints(mechanics, p, values, near, t))


def _check_known(system: ReducedSystem) -> None:
    """Nothing stands in the equations of motion that they do not determine."""
    known = {s.element_hash() for s in ca.symvar(ca.vertcat(system.t, system.x, system.u, system.p))}
    known |= set() if system.extra is None else {s.element_hash() for s in ca.symvar(system.extra)}
    left = [s for s in ca.symvar(ca.vertcat(system.x_dot, system.multipliers)) if s.element_hash() not in known]
    if left:
        names = {s.sx.element_hash(): name for s, name in system.flat.names.items() if s.sx.is_scalar()}
        raise OverdeterminedError(
            f"{compact(names.get(s.element_hash(), s.name()) for s in left)} would be needed, which follows from forces, before the equations that it stands in "
            "are solved. A given speed or a gear follows something with inertia here: put an element that stores (a small inertia, a spring) between."
        )


def _check_free(system: ReducedSystem) -> None:
    """Gears between joints may leave nothing free; a source may take the last freedom, since it moves."""
    scalar, constraints, tree = system.scalar, system.constraints, system.mechanics.tree
    held = system.holding.velocities
    rows = ca.vertcat(scalar.velocity, constraints.velocity)
    at_rest = ca.substitute(rows, tree.v, ca.SX.zeros(tree.v.numel()))
    moved = ca.depends_on(ca.vertcat(scalar.position, rows), tree.t) or not at_rest.is_zero()
    if system.holding.again:
        names = compact(dict.fromkeys(h.name for h in scalar.held if h.depth == 1), 4)
        raise LockedError(
            f"Of the equations {names}, {system.holding.again} hold joints that loops hold already. Remove a gear or a source, or put a spring "
            "between."
        )
    if held and (system.degrees_of_freedom < 0 or (system.degrees_of_freedom == 0 and not moved)):
        names = list(dict.fromkeys(h.name for h in scalar.held if h.depth == 1))
        paths, flanges = system.flat.connector_paths, {end for item in tree.joints for end in item.edge.joint.flanges}
        sets = [group for group in system.flat.connection_sets if len(group) > 1 and not flanges.isdisjoint(group)]
        places = f" at {compact((' and '.join(paths[c] for c in group[:3]) for group in sets), 3)}" if sets else ""
        raise LockedError(
            f"Joints cannot move: against their {counted(tree.v.numel(), 'freedom')} stand {constraints.rank.rank} constraints of loops "
            f"and {held} of gears, cables and sources{places}, from {', '.join(names[:4])}. Remove one of them, or put a spring between."
        )


def _rates(tree: Tree, second: ca.SX, nv: int, n: int) -> ca.SX:
    """Rates of all states, for the accelerations and rates of scalar states in `second`, n of them of positions."""
    accelerations, positions, others = _split(second, nv, n)
    return ca.vertcat(tree.rates, positions, accelerations, others)


def _corrected(step: ca.SX | None, x: ca.SX, nq: int, scalar: ScalarPart) -> ca.SX | None:
    """The projection onto loops and joints' invariants, `step` of (q, v), and onto those of scalar domains."""
    followed = ca.vertcat(ca.SX(0, 1), *(h.residual for h in scalar.held if h.is_coordinate))
    if step is None and scalar.correction is None and not followed.numel():
        return None
    n, nv = scalar.positions, x.numel() - nq - len(scalar.states)
    dq, dv, ds = scalar.correction or (ca.SX.zeros(nq), ca.SX.zeros(nv), ca.SX.zeros(len(scalar.states)))
    q, s, v, rest = _split(x, nq, n, nv)
    if step is not None:
        q, v = _split(step, nq)
    first, last = _split(ds, n)
    result = ca.vertcat(q + dq, s + first, v + dv, rest + last)
    return ca.substitute(result, x, x - ca.jacobian(followed, x).T @ followed) if followed.numel() else result


def _split(column: ca.SX, *sizes: int) -> list[ca.SX]:
    """Parts of these sizes one after another, and the rest."""
    ends = np.cumsum([0, *sizes]).tolist()
    return ca.vertsplit(column, [*ends, column.numel()])


def _put(steps: Sequence[Sequence[tuple[ca.SX, ca.SX]]], expression: ca.SX) -> ca.SX:
    """With values put in for symbols, one step after another."""
    for pairs in steps:
        known = [(symbol, value) for symbol, value in pairs if symbol.numel()]
        if known:
            expression = ca.substitute([expression], [symbol for symbol, _ in known], [value for _, value in known])[0]
    return expression
