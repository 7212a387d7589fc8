"""All constraints of a model as a table: what each forbids, of what kind it is, and whether it was needed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.explain.integrability.classification import Block, Integrability
from acausal.explain.integrability.integral import Integral
from acausal.explain.integrability.scene import scene_integrability
from acausal.explain.integrability.velocity_forms import contact_rows, is_linear, rates_only
from acausal.explain.row_meaning import row_meanings
from acausal.numerics.vanishing import equilibrated_rank
from acausal.parts.unit_quaternions import unit_quaternions
from acausal.reduce.reduce import ReducedSystem
from acausal.scalar.coupling import Held
from acausal.wording import compact, counted, entry_names

_MOST_NAMES = 4


@dataclass(frozen=True)
class ConstraintEntry:
    """One constraint.

    `name`: component path and number. `forbids`: in words. `kind`: "holonomic" (a relation of positions, also when it is given in velocities),
    "rheonomic" (one that the time enters), "nonholonomic", "redundant" (it follows from the others), "vanishing" (it asks nothing here), or
    "normalisation" (of a quaternion). `kept`: whether the equations of motion need it. `known`: how this is known. `integrals`: functions of
    position in which it has a share and that stay constant.
    """

    name: str
    forbids: str
    kind: str
    kept: bool
    known: str
    integrals: tuple[Integral, ...] = ()


@dataclass(frozen=True, repr=False)
class ConstraintTable:
    """`entries` of all constraints; freedoms in configuration and velocity that they leave; `velocity`: which velocity constraints can be integrated."""

    name: str
    entries: tuple[ConstraintEntry, ...]
    configuration_freedom: int
    velocity_freedom: int
    velocity: Integrability

    @property
    def hidden(self) -> int:
        """Functions of position that velocity constraints keep constant: so many freedoms in configuration are none during a motion."""
        return self.velocity.hidden

    def __iter__(self) -> Iterator[ConstraintEntry]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    def __repr__(self) -> str:
        return f"<ConstraintTable {self.name}: {len(self)} constraints>"

    def __str__(self) -> str:
        lines = [
            f"{self.name}: {counted(len(self), 'constraint')}, {counted(self.configuration_freedom, 'freedom')} in configuration, "
            f"{self.velocity_freedom} in velocity, {counted(self.hidden, 'hidden integral')}"
        ]
        groups: dict[tuple[str, str, bool, str], list[str]] = {}
        for entry in self.entries:
            groups.setdefault((entry.kind, entry.forbids, entry.kept, entry.known), []).append(entry.name)
        lines += [
            f"  {kind:<13} {'kept' if kept else 'dropped':<8} {compact(names, _MOST_NAMES)}: {forbids} ({known})"
            for (kind, forbids, kept, known), names in groups.items()
        ]
        lines += _hidden_lines(self.velocity.blocks)
        return "\n".join(lines)


def _hidden_lines(blocks: Sequence[Block]) -> list[str]:
    """Integrals one by one; growth of the admissible velocities of blocks that are alike together."""
    lines = [
        f"  constant: {integral.text}, from {compact(integral.names, _MOST_NAMES)}"
        for block in blocks
        for integral in block.integrals
    ]
    missing = sum(block.hidden - len(block.integrals) for block in blocks)
    if missing:
        lines.append(
            f"  {missing} more {'function stays' if missing == 1 else 'functions stay'} constant: integrable, closed form not found"
        )
    alike: dict[tuple[tuple[int, ...], int, int, str], list[Block]] = {}
    for block in blocks:
        if not block.holonomic:
            alike.setdefault((block.growth, block.manifold, len(block.names), block.method), []).append(block)
    for (growth, manifold, *_), same in alike.items():
        whose = compact(same[0].names, _MOST_NAMES)
        times = f" and {len(same) - 1} more like it" if len(same) > 1 else ""
        steps = " -> ".join(str(g) for g in growth)
        more = ", and perhaps more: undecided" if same[0].method == "undecided" else ""
        lines.append(f"  reach of {whose}{times}: {steps} of {manifold} dimensions, with brackets of velocities{more}")
    return lines


def constraint_table(system: ReducedSystem) -> ConstraintTable:
    """Every constraint of a scene: of joints in the tree, of loops, of rolling contacts, of gears and sources on joints.

    Costs milliseconds; up to about a second for each kind of rolling contact, where sympy proves what it can.
    """
    velocity = scene_integrability(system)
    judge = _Judge(system, velocity)
    entries = [*_invariants(system), *_loops(system, judge), *_in_tree(system, judge), *_scalar(system, judge)]
    return ConstraintTable(
        system.flat.name, tuple(entries), _configuration_freedom(system), system.degrees_of_freedom, velocity
    )  # fmt: skip


@dataclass(frozen=True)
class _Judge:
    """The kind of a velocity constraint, from what is known of its block."""

    system: ReducedSystem
    velocity: Integrability

    def entry(self, name: str, forbids: str, timed: bool, kept: bool = True) -> ConstraintEntry:
        if name in self.velocity.vanishing:
            return ConstraintEntry(name, forbids, "vanishing", False, "by structure")
        block = next(b for b in self.velocity.blocks if name in b.names)
        integrals = tuple(i for i in block.integrals if name in i.names)
        if block.alone[block.names.index(name)] or block.holonomic:
            return ConstraintEntry(
                name, forbids, "rheonomic" if timed else "holonomic", kept, f"integrable, {block.method}", integrals
            )
        part = f", a part of {len(integrals)} integrals" if len(integrals) > 1 else ", a part of an integral" if integrals else ""
        return ConstraintEntry(name, forbids, "nonholonomic", kept, f"not integrable alone, {block.method}{part}", integrals)


def _configuration_freedom(system: ReducedSystem) -> int:
    """nq less the rank of all functions of position, at some assembled configurations."""
    if not system.nq:
        return 0
    q = system.x[: system.nq, :]
    function = ca.Function("slope", [q, system.t, system.p], [ca.densify(ca.jacobian(system.closing, q))])
    ranks = [equilibrated_rank(np.array(function(q, 0.0, system.p_values))) for q in system.closed_positions]
    return system.nq - max(ranks)


def _invariants(system: ReducedSystem) -> Iterator[ConstraintEntry]:
    q, t = system.mechanics.tree.q, system.t
    for item in system.tree_joints:
        rows = item.edge.joint.invariants(q[item.q], t)
        units = unit_quaternions(rows, q[item.q])
        for i, name in enumerate(entry_names(f"{item.edge.name}.invariant", rows.numel())):
            kind, words = "holonomic", "what the joint's coordinates cannot reach"
            if i in units:
                kind, words = "normalisation", "a quaternion of a length other than 1"
            yield ConstraintEntry(name, words, kind, True, "by structure")


def _loops(system: ReducedSystem, judge: _Judge) -> Iterator[ConstraintEntry]:
    constraints = system.constraints
    rank = f"rank at {counted(len(constraints.samples), 'assembled configuration')}"
    for rows in constraints.loops:
        means = row_meanings(system, rows)
        count = rows.position.numel()
        for k, name in enumerate(rows.names):
            kept = name in constraints.kept
            timed = ca.depends_on(rows.velocity[k], system.t)
            if not kept and not (k >= count and name in judge.velocity.vanishing):
                yield ConstraintEntry(name, means[name], "redundant", False, rank)
            elif k >= count:
                yield judge.entry(name, means[name], timed)
            else:
                yield ConstraintEntry(name, means[name], "rheonomic" if timed else "holonomic", True, "given in positions")
        for name in rows.dropped:
            yield ConstraintEntry(
                name, "nothing: it holds by itself in this plane or direction", "vanishing", False, "by structure"
            )


def _in_tree(system: ReducedSystem, judge: _Judge) -> Iterator[ConstraintEntry]:
    """Rolling contacts that cost no multiplier: their velocities do not slip."""
    for row in contact_rows(system.mechanics, ()):
        drift = ca.substitute(row.drift, system.p, ca.SX(ca.DM(system.p_values)))
        yield judge.entry(row.name, "slip", not drift.is_zero())


def _scalar(system: ReducedSystem, judge: _Judge) -> Iterator[ConstraintEntry]:
    """Gears, sources, and equations of one's own between flanges of joints, and what they tie to them."""
    told = set[int]()
    for held in system.scalar.held:
        if held.depth > 1 and held.number not in told:
            told.add(held.number)
            kind = "rheonomic" if held.of_inputs or ca.depends_on(held.residual, system.t) else "holonomic"
            yield ConstraintEntry(held.name, f"other positions of {_whose(held)}", kind, True, "given in positions")
    for held in system.scalar.redundant:
        yield ConstraintEntry(
            held.name, "other positions of flanges", "redundant", False, "it follows from others; the smallest efforts are given"
        )
    for held in system.scalar.looped:
        yield ConstraintEntry(
            held.name, "other positions of flanges", "redundant", False, "loops hold it already; it transmits nothing"
        )
    for held in rates_only(system):
        if held.of_inputs:
            yield ConstraintEntry(held.name, f"other velocities of {_whose(held)}", "rheonomic", True, "given by an input")
        elif held.of_joints and is_linear(held.residual, system.mechanics.tree.v):
            yield judge.entry(held.name, "other velocities of flanges", ca.depends_on(held.residual, system.t))
        else:
            why = "with scalar states" if not held.of_joints else "not linear in velocities"
            words = f"other velocities of {_whose(held)}"
            yield ConstraintEntry(held.name, words, "nonholonomic", True, f"{why}, not examined")


def _whose(held: Held) -> str:
    return "flanges" if held.of_joints else "flanges and scalar parts"
