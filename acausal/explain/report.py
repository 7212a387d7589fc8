"""The report: in plain words, what the reduction found and did."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.explain.row_meaning import row_meanings
from acausal.loops.self_stress import undetermined_reactions
from acausal.outputs.functions import Functions, operations
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import symbolic
from acausal.wording import compact, grouped

_MOST_STATICS = 3_000
_MOST_LINES = 10


def report(headline: str, model: Functions) -> str:
    """Freedoms by component, states, operations; what was merged, cut and dropped, and why. Parts alike share a line."""
    system = model.outputs.system
    mechanism = system.mechanics.mechanism
    lines = [headline, ""]
    lines += _freedoms(model)
    merged = [g for g in mechanism.groups if len(g.parts) > 1]
    if merged:
        lines.append("Merged, because they cannot move against one another:")
        lines += [f"  {compact(part.path for part in group.parts)}" for group in merged[:_MOST_LINES]]
        lines += [f"  and {len(merged) - _MOST_LINES} more groups"] if len(merged) > _MOST_LINES else []
    free = [item.edge for item in system.tree_joints if item.edge.implicit]
    if free:
        lines.append("Held by nothing, so given a free joint of their own:")
        lines += grouped([(mechanism.groups[e.b].name, f"{e.joint.v.size} freedoms") for e in free])
    lines += _loops(model)
    space = model.space
    if space.places != tuple(range(system.x.numel())):
        names = model.tree_state_names
        gone = [names[i] for i in range(len(names)) if i not in space.places]
        lines.append(f"In closed form from the others, so no states: {compact(gone, 12)}")
    invariants = 0 if model.invariants is None else model.invariants.numel_out()
    if invariants:
        lines.append(
            f"Kept to rounding after every step: {invariants} invariants (loops, their rates, lengths of quaternions, nonlinear equations)."
        )
    lines += _modes(model)
    lines.append(f"States: {compact(model.state_names, 12) or 'none'}")
    lines.append(f"Operations: {operations(model.explicit_dynamics)} for the rates of all states.")
    return "\n".join(lines)


def _freedoms(model: Functions) -> list[str]:
    system = model.outputs.system
    held = f" and {system.holding.velocities} by sources or gears on their flanges" if system.holding.velocities else ""
    rows = [
        f"Freedoms: {system.tree_velocities} of the joints in the tree, less {system.constraints.rank.rank} by loops{held}, are {model.outputs.system.degrees_of_freedom}."
    ]
    configuration = int(
        system.nq - sum(item.edge.joint.invariants(system.x[item.q], system.t).numel() for item in system.tree_joints)
    )
    rolling = {row.name for rows in system.constraints.loops for row in rows.rows if row.rolls}
    holonomic = sum(name not in rolling for name in system.constraints.kept)
    configuration -= system.scalar.positions + system.holding.positions
    if configuration - holonomic != model.outputs.system.degrees_of_freedom:
        rows.append(
            f"  In configuration there are {configuration - holonomic}: what rolls, a blade or a given speed limits velocities, not positions."
        )
    return rows + grouped(
        [
            (e.name, f"{type(e.joint).__name__:<20} {e.joint.v.size} in velocity, {e.joint.q.size} coordinates")
            for e in (item.edge for item in system.tree_joints)
        ]
    )


def _modes(model: Functions) -> list[str]:
    """Parts whose reactions hold as long as they can."""
    system = model.outputs.system
    laws = [(row.part.path, "one-sided" if row.one_sided else "dry friction") for row in system.mechanics.modes]
    told = {path: ", ".join(dict.fromkeys(kind for own, kind in laws if own == path)) for path, _ in laws}
    if not told:
        return []
    masks = compact((mask.name for mask in system.flat.modes), 12)
    return [
        "Open, stick, slide or strike, each as its laws say; in functions of the model the last inputs say which:",
        *(f"  {line}" for line in grouped(list(told.items()))),
        f"  These inputs, which nobody gives: {masks}",
    ]


def _loops(model: Functions) -> list[str]:
    system = model.outputs.system
    constraints = system.constraints
    if not constraints.loops:
        return []
    lines = ["Loops, cut at these joints:"]
    needed: list[tuple[str, str]] = []
    dropped: list[tuple[str, str]] = []
    kept = set(constraints.kept)
    for rows in constraints.loops:
        means = row_meanings(system, rows)
        count, total = sum(name in kept for name in rows.names), len(rows.names) + len(rows.dropped)
        needed.append((rows.edge.name, f"{type(rows.edge.joint).__name__:<20} {count} of {total} rows are needed"))
        dropped += [(name, f"{means[name]} is redundant: it holds by itself in this plane or direction") for name in rows.dropped]
        dropped += [
            (n, f"{means[n]} is redundant: it follows from the other joints of the loop") for n in rows.names if n not in kept
        ]
    lines += grouped(needed) + [f"  {line}" for line in grouped(dropped)]
    if dropped:
        lines += _overconstrained(model, len(dropped)) + _undetermined(model)
    if constraints.rank.singular_at_start:
        lines.append("  The first configuration is singular: nearby, more constraints are independent than there.")
    elif constraints.singular:
        lines.append(
            "  On its way a loop passes singular positions, where motions branch; the one that momentum selects is followed."
        )
    normal = planar_normal(model)
    if normal is not None:
        shown = np.array2string(normal, precision=4, suppress_small=True)
        lines.append(f"  The loops are planar: all their hinges are parallel to {shown}.")
    return lines


def _overconstrained(model: Functions, dropped: int) -> list[str]:
    """How much of the freedom is owed to exact dimensions."""
    system = model.outputs.system
    rows = sum(len(r.names) + len(r.dropped) for r in system.constraints.loops)
    counted = system.tree_velocities - rows
    return [
        f"  Counting joints alone (Gruebler, Kutzbach) gives {counted} freedoms; {dropped} constraints hold only because the dimensions are exact."
    ]


def _undetermined(model: Functions) -> list[str]:
    """Which reactions the motion of rigid bodies leaves open."""
    system = model.outputs.system
    rows = sum(len(r.names) + len(r.dropped) for r in system.constraints.loops)
    if rows * len(system.mechanics.tree.links) > _MOST_STATICS:
        return ["  Reactions along redundant directions are not determined by rigid bodies; the smallest set is given."]
    found = undetermined_reactions(system.mechanics, system.constraints, system.p, system.p_values)
    axes = [f"{kind} {axis}" for kind in ("torque", "force") for axis in "xyz"]
    words = [(name, ", ".join(axis for axis, loose in zip(axes, row, strict=True) if loose)) for name, row in found.items()]
    return [
        "  Reactions that rigid bodies do not determine (the smallest set is given), in frame_b with z along a joint's axis:",
        *(f"  {line}" for line in grouped(words)),
    ]


def planar_normal(model: Functions) -> np.ndarray | None:
    """Unit vector (3,) in the world to which all joints in the loops are parallel hinges at the start; None if there is none."""
    system = model.outputs.system
    if not system.constraints.loops:
        return None
    joints = [item.edge.joint for item in system.tree_joints] + [rows.edge.joint for rows in system.constraints.loops]
    if not all(isinstance(joint, AbstractStepJoint) and joint.is_hinge for joint in joints):
        return None
    axes: list[ca.SX] = []
    for joint in joints:
        link, place = system.mechanics.placement.place(joint.frame_a)
        X = system.mechanics.kinematics.pose(link) @ place
        axes.append(symbolic(X.rotation) @ symbolic(joint.mounting())[:, 2])
    function = ca.Function("axes", [system.t, system.x, system.p], [ca.horzcat(*axes)])
    x = np.concatenate([system.q_start, system.rate_start])
    values = np.array(function(0.0, x, system.p_values))
    return values[:, 0] if np.max(np.abs(np.abs(values[:, 0] @ values) - 1)) < 1e-9 else None
