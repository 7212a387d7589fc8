"""The report: in plain words, what the reduction found and did."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from acausal.codegen.lower import operations

if TYPE_CHECKING:
    from acausal.model import Model


def report(model: Model) -> str:
    """Freedoms by component, states, operations; what was merged, cut and dropped, and why."""
    system = model.system
    mechanism = system.mechanics.mechanism
    lines = [str(model), ""]
    lines += _freedoms(model)
    merged = [g for g in mechanism.groups if len(g.parts) > 1]
    if merged:
        lines.append("Merged, because they cannot move against one another:")
        lines += [f"  {', '.join(part.path for part in group.parts)}" for group in merged]
    free = [item.edge for item in system.tree_joints if item.edge.implicit]
    if free:
        lines.append("Held by nothing, so given a free joint of their own:")
        lines += [f"  {mechanism.groups[e.b].name}: {e.joint.v.size} freedoms" for e in free]
    lines += _loops(model)
    invariants = system.position_invariants.numel() + system.velocity_invariants.numel()
    if invariants:
        lines.append(
            f"Kept to rounding after every step: {invariants} invariants (loops, their rates, lengths of quaternions, nonlinear equations)."
        )
    lines.append(f"States: {', '.join(model.state_names) or 'none'}")
    lines.append(f"Operations: {operations(model.functions.explicit_dynamics)} for the rates of all states.")
    return "\n".join(lines)


def _freedoms(model: Model) -> list[str]:
    system = model.system
    held = f" and {system.scalar.rows} by sources or gears on their flanges" if system.scalar.rows else ""
    rows = [
        f"Freedoms: {system.tree_velocities} of the joints in the tree, less {system.constraints.rank.rank} by loops{held}, are {model.degrees_of_freedom}."
    ]
    configuration = int(
        system.nq - sum(item.edge.joint.invariants(system.x[item.q], system.t).numel() for item in system.tree_joints)
    )
    holonomic = sum(".rolling[" not in name for name in system.constraints.kept)
    configuration -= system.scalar.position.numel()
    if configuration - holonomic != model.degrees_of_freedom:
        rows.append(f"  In configuration there are {configuration - holonomic}: rolling limits velocities, not positions.")
    rows += [
        f"  {item.edge.name:<24} {type(item.edge.joint).__name__:<20} {item.edge.joint.v.size} in velocity, {item.edge.joint.q.size} coordinates"
        for item in system.tree_joints
    ]
    return rows


def _loops(model: Model) -> list[str]:
    system = model.system
    constraints = system.constraints
    if not constraints.loops:
        return []
    lines = ["Loops, cut at these joints:"]
    for rows in constraints.loops:
        kept = [name for name in rows.names if name in constraints.kept]
        lines.append(
            f"  {rows.edge.name:<24} {type(rows.edge.joint).__name__:<20} {len(kept)} of {len(rows.names) + len(rows.dropped)} rows are needed"
        )
        for name in rows.dropped:
            lines.append(
                f"    {name}: {_meaning(rows.edge.joint, name)} is redundant: it holds by itself in this plane or direction"
            )
        for name in rows.names:
            if name in constraints.redundant:
                lines.append(
                    f"    {name}: {_meaning(rows.edge.joint, name)} is redundant: it follows from the other joints of the loop"
                )
    if constraints.redundant or constraints.vanishing:
        where = sorted({name.rsplit("[", 1)[0] for name in (*constraints.redundant, *constraints.vanishing)})
        lines.append(
            f"  Reactions along redundant directions are not determined by rigid bodies; one possible set is given at {', '.join(where)}."
        )
    if constraints.rank.singular_at_start:
        lines.append("  The first configuration is singular: nearby, more constraints are independent than there.")
    if planar_normal(model) is not None:
        normal = planar_normal(model)
        lines.append(
            f"  The loops are planar: all their hinges are parallel to {np.array2string(np.asarray(normal), precision=4, suppress_small=True)}."
        )
    return lines


def _meaning(joint: object, name: str) -> str:
    """What a row of a hinge forbids; other joints give the number only."""
    words = {
        "Revolute": (
            "a shift across the axis",
            "a shift across the axis",
            "a shift along the axis",
            "a tilt of the axis",
            "a tilt of the axis",
        ),
        "Prismatic": ("a shift across the axis", "a shift across the axis", "a turn", "a turn", "a turn about the axis"),
        "Cylindrical": ("a shift across the axis", "a shift across the axis", "a tilt of the axis", "a tilt of the axis"),
        "Spherical": ("a shift along x", "a shift along y", "a shift along z"),
    }.get(type(joint).__name__, ())
    index = int(name.split("[")[-1].rstrip("]"))
    return words[index] if index < len(words) else "this row"


def planar_normal(model: Model) -> np.ndarray | None:
    """Unit vector (3,) in the world to which all joints in the loops are parallel hinges at the start; None if there is none."""
    import casadi as ca

    from acausal.mechanics.pose import symbolic

    system = model.system
    if not system.constraints.loops:
        return None
    joints = [item.edge.joint for item in system.tree_joints] + [rows.edge.joint for rows in system.constraints.loops]
    if any(type(joint).__name__ != "Revolute" for joint in joints):
        return None
    axes: list[ca.SX] = []
    for joint in joints:
        link, place = system.mechanics.placement.place(joint.frame_a)
        X = system.mechanics.kinematics.pose(link) @ place
        axes.append(symbolic(X.rotation) @ symbolic(joint.mounting())[:, 2])
    function = ca.Function("axes", [system.t, system.x, system.p], [ca.horzcat(*axes)])
    x = np.concatenate([system.q_start, np.zeros(system.x.numel() - system.nq)])
    values = np.array(function(0.0, x, system.p_values))
    return values[:, 0] if np.max(np.abs(np.abs(values[:, 0] @ values) - 1)) < 1e-9 else None
