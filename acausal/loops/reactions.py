"""Wrenches at connectors: what joints, forces and bodies exert on one another, found only when asked for."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import casadi as ca

from acausal.dynamics import formulas
from acausal.dynamics.kinematics import Place
from acausal.dynamics.newton_euler import NewtonEuler, newton_euler
from acausal.dynamics.system import MechanicalSystem
from acausal.errors import UnknownVariableError
from acausal.language.component import Component
from acausal.language.connector import FLOWS, Point, Quantity
from acausal.language.expression import Symbol
from acausal.language.flatten import Part
from acausal.loops.constraints import Constraints
from acausal.loops.loops import mounted_places
from acausal.loops.self_stress import loop_reactions, wrench_on_b
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.field import AbstractField, AbstractMutualField, FieldForce, PairForce
from acausal.parts.force import AbstractForce
from acausal.parts.inertia import Inertia, skew
from acausal.parts.pose import Pose, symbolic
from acausal.parts.rigid import AbstractRigidPart
from acausal.parts.span import AbstractSpan

if TYPE_CHECKING:
    import networkx as nx


Wrench = tuple[ca.SX, ca.SX]
CutWrenches = dict[str, tuple[tuple[Place, Wrench], tuple[Place, Wrench]]]


@dataclass(frozen=True)
class Reactions:
    """Flows at connectors for accelerations `v_dot` and constraint `multipliers`, as `SX`.

    Where constraints are redundant, rigid bodies do not determine all reactions: these are the smallest ones (see `self_stress`).
    """

    system: MechanicalSystem
    constraints: Constraints
    v_dot: ca.SX
    multipliers: ca.SX
    solved: Mapping[Symbol, ca.SX] = field(default_factory=dict[Symbol, ca.SX])
    """Values of scalar variables, among them the efforts at flanges of spans."""
    borne: ca.SX | None = None
    """Symbols for the multipliers of all rows, which many reactions share; None where `balanced` is to stand in them itself."""

    @functools.cached_property
    def motion(self) -> NewtonEuler:
        """Accelerations of links and the wrenches across the joints of the tree."""
        return self._motion(self.cut_wrenches)

    def _motion(self, cut_wrenches: CutWrenches) -> NewtonEuler:
        wrenches = list(self.system.wrenches)
        for edge_wrenches in cut_wrenches.values():
            for place, (torque, force) in edge_wrenches:
                link, pose = place
                if link >= 0:
                    moved = formulas.move_wrench(symbolic(pose.rotation), symbolic(pose.position), torque, force)
                    wrenches[link] = (wrenches[link][0] + moved[0], wrenches[link][1] + moved[1])
        return newton_euler(self.system.kinematics, self.v_dot, wrenches)

    @functools.cached_property
    def cut_wrenches(self) -> CutWrenches:
        """For each cut joint: the places of frame_a and frame_b and the wrench that the joint exerts there, in those axes."""
        return self._cut_wrenches(self.balanced if self.borne is None else self.borne)

    @functools.cached_property
    def balanced(self) -> ca.SX:
        """Multipliers of all rows, with the smallest reactions where rigid bodies do not determine them."""
        multipliers = self.all_multipliers
        if not (self.constraints.redundant or self.constraints.vanishing):
            return multipliers
        loops = loop_reactions(self.system, self.constraints)
        motion = self._motion(self._cut_wrenches(multipliers))
        joints = {item.edge.name: item for item in self.system.tree.joints}
        felt = [ca.vertcat(*motion.transmitted[joints[e.name].link]) for e in loops.edges if e.name in joints]
        felt = [wrench_on_b(self.system, joints[e.name], w) for e, w in zip(loops.edges, felt, strict=False)]
        felt.append(loops.change[6 * len(felt) :, :] @ multipliers)
        return loops.balanced(multipliers, ca.vertcat(*felt))

    @property
    def all_multipliers(self) -> ca.SX:
        """Of all rows of the cut joints, zero for those that are not used; vanishing rows come last in each joint."""
        kept = {row: k for k, row in enumerate(self.constraints.kept_index)}
        entries: list[ca.SX] = []
        first = 0
        for rows in self.constraints.loops:
            count = len(rows.names)
            entries += [self.multipliers[kept[i]] if i in kept else ca.SX(0) for i in range(first, first + count)]
            entries += [ca.SX(0)] * len(rows.dropped)
            first += count
        return ca.vertcat(ca.SX(0, 1), *entries)

    def _cut_wrenches(self, multipliers: ca.SX) -> CutWrenches:
        result: CutWrenches = {}
        first = 0
        for rows in self.constraints.loops:
            basis = ca.horzcat(rows.wrench_basis, rows.dropped_basis)
            on_b = basis @ multipliers[first : first + basis.shape[1], :]
            first += basis.shape[1]
            if isinstance(rows.edge.joint, AbstractSpan):
                on_b = on_b + rows.edge.joint.wrench_on_b(rows.pose) * self._effort(rows.edge.joint)
            a, b = mounted_places(rows.edge, self.system.placement)
            R, p = symbolic(rows.pose.rotation), symbolic(rows.pose.position)
            torque, force = formulas.move_wrench(R, p, on_b[:3], on_b[3:])
            result[rows.edge.name] = ((a, (-torque, -force)), (b, (on_b[:3], on_b[3:])))
        return result

    def _effort(self, span: AbstractSpan) -> ca.SX:
        """Into the flange of a span; nothing where nothing is connected to it."""
        symbol: Symbol = getattr(span.flange, FLOWS[type(span.flange)][1])
        return self.solved.get(symbol, ca.SX(0))

    def quantity(self, symbol: Quantity) -> ca.SX:
        """A force, torque, acceleration, angular acceleration or specific force at a connector, in the world frame."""
        connector, name = symbol.connector, symbol.name
        assert isinstance(connector, Point)
        if name in ("force", "torque"):
            torque, force = self.flow(connector)
            return force if name == "force" else torque
        link, place = self.system.placement.place(connector)
        if name == "specific_force":
            return self.quantity(connector.acceleration) - self._gravity(connector)
        if link < 0:
            return ca.SX.zeros(3)
        w_dot, a = self.motion.accelerations[link]
        R, p, tree = symbolic(self.system.kinematics.pose(link).rotation), symbolic(place.position), self.system.tree
        if name == "angular_acceleration":
            return R @ w_dot
        w = self.system.kinematics.angular_velocity(link)
        gravity = symbolic(tree.world) @ tree.gravity
        return R @ (a + ca.cross(w_dot, p) + ca.cross(w, ca.cross(w, p))) + gravity

    def _gravity(self, connector: Point) -> ca.SX:
        """Acceleration by the world's gravity and by all fields at a connector, in the world frame [m/s^2]."""
        system = self.system
        total = symbolic(system.tree.world) @ system.tree.gravity
        for part in system.flat.parts:
            field = part.component
            if isinstance(field, AbstractMutualField):
                raise UnknownVariableError(
                    f"The specific force at {system.flat.connector_paths[connector]} is not known beside {part.where}, of which the body there is itself a "
                    "source. Read `acceleration`, or use a CentralField that a body carries."
                )
            if isinstance(field, AbstractField):
                X = system.placement.pose(self._seat(field))
                R, p = symbolic(X.rotation), ca.SX.sym("p", 3)
                pull = -ca.gradient(ca.SX(field.potential(p, system.placement.t)), p)
                at = R.T @ (symbolic(system.placement.pose(connector).position) - symbolic(X.position))
                total += R @ ca.substitute(pull, p, at)
        return total

    def _seat(self, field: AbstractField) -> Point:
        """Where a field stands: in what its frame is connected to."""
        members = next(members for members in self.system.flat.connection_sets if field.frame in members)
        return next(c for c in members if isinstance(c, Point) and isinstance(c.owner, AbstractRigidPart | AbstractConstraint))

    def flow(self, connector: Point) -> Wrench:
        """Torque about the connector's origin and force into its component, in the world frame, (3, 1) each.

        Raises `UnknownVariableError` where rigid parts form a loop, so that the reaction is not determined.
        """
        part = self.system.flat.part_of(connector)
        link, _ = place = self.system.placement.place(connector)
        torque, force = self._into(part, connector)
        R = symbolic(self.system.kinematics.pose(link).rotation) @ symbolic(place[1].rotation)
        return R @ torque, R @ force

    def _into(self, part: Part, connector: Point) -> Wrench:
        """The flow in the connector's own axes."""
        if isinstance(part.component, AbstractForce):
            return _negated(self._force_on(part.component, connector))
        if isinstance(part.component, AbstractConstraint):
            return self._into_joint(part.component, connector)
        if isinstance(part.component, AbstractField):  # it only says where it stands
            return ca.SX.zeros(3), ca.SX.zeros(3)
        return self._into_rigid(part, connector)

    def _force_on(self, force: AbstractForce, connector: Point) -> Wrench:
        torque, push = ca.SX.zeros(3), ca.SX.zeros(3)
        for action in self.system.actions[self.system.forces.index(force)]:
            if action.connector is connector:
                torque, push = torque + action.torque, push + action.force
        return torque, push

    def _into_joint(self, joint: AbstractConstraint, connector: Point) -> Wrench:
        for item in self.system.tree.joints:
            if item.edge.joint is joint:
                own = self.system.placement.ends(item.edge)[connector is joint.frame_b]
                links = self.system.tree.links
                near_side = (connector is joint.frame_a) != item.reversed
                if not near_side:
                    return _negated(_seen_from(own[1], *self.motion.transmitted[item.link]))
                first = next(i for i, link in enumerate(links) if link.name == item.edge.name)
                torque, force = self.motion.transmitted[first]
                for pose in (links[first].motion.pose, links[first].offset):
                    torque, force = formulas.move_wrench(symbolic(pose.rotation), symbolic(pose.position), torque, force)
                return _seen_from(own[1], torque, force)
        on_a, on_b = self.cut_wrenches[self._name(joint)]
        (_, pose), wrench = on_a if connector is joint.frame_a else on_b
        own = self.system.placement.place(connector)
        turn = own[1].inverse() @ pose
        torque, force = formulas.move_wrench(symbolic(turn.rotation), symbolic(turn.position), *wrench)
        return -torque, -force

    def _name(self, joint: AbstractConstraint) -> str:
        return next(part.path for part in self.system.flat.parts if part.component is joint)

    def _into_rigid(self, part: Part, connector: Point) -> Wrench:
        """Cut the rigid group at the connector: what its side needs to move as it does, less what acts on that side."""
        import networkx as nx

        graph = self._rigid_graph(connector)
        own_set = next(n for n in graph if isinstance(n, frozenset) and connector in n)
        graph.remove_edge(part.path, own_set)
        side = nx.node_connected_component(graph, part.path)
        if own_set in side:
            raise UnknownVariableError(
                f"The wrench at {self.system.flat.connector_paths[connector]} is not determined: the rigid parts around it form a loop. "
                "Ask for it at a joint, or remove one rigid connection."
            )
        own = self.system.placement.place(connector)
        if self._is_ground(side):
            return _negated(self._needed(nx.node_connected_component(graph, own_set), own))
        return self._needed(side, own)

    def _rigid_graph(self, connector: Point) -> nx.Graph[str | frozenset[Point]]:
        import networkx as nx

        group = self.system.mechanism.groups[self.system.mechanism.group_of(connector)]
        graph: nx.Graph[str | frozenset[Point]] = nx.Graph()
        for members in self.system.flat.connection_sets:
            if members[0] in group.poses:
                node = frozenset(c for c in members if isinstance(c, Point))
                graph.add_node(node)
                graph.add_edges_from((p.path, node) for p in group.parts for c in members if c.owner is p.component)
        return graph

    def _is_ground(self, side: set[str | frozenset[Point]]) -> bool:
        ground = self.system.mechanism.groups[0]
        return any(
            part.path in side and not part.component.inertia().mass and hasattr(part.component, "gravity")
            for part in ground.parts
            if isinstance(part.component, AbstractRigidPart)
        )

    def _needed(self, side: set[str | frozenset[Point]], own: Place) -> Wrench:
        """Torque and force in the axes of `own` and about its origin."""
        link, place = own
        torque, force = ca.SX.zeros(3), ca.SX.zeros(3)
        group = next(
            g
            for g in self.system.mechanism.groups
            if any(p.path in side for p in g.parts) or any(isinstance(n, frozenset) and n & set(g.poses) for n in side)
        )
        index = self.system.mechanism.groups.index(group)
        group_pose = self.system.tree.places[index][1]
        for part, pose in zip(group.parts, group.part_poses, strict=True):
            if part.path in side and isinstance(part.component, AbstractRigidPart):
                inertia = part.component.inertia().seen_from(group_pose @ pose)
                if not inertia.is_zero:
                    moved = self._inertial(link, inertia)
                    torque, force = torque + moved[0], force + moved[1]
        for members in self.system.flat.connection_sets:
            node = frozenset(c for c in members if isinstance(c, Point))
            for other in node if members[0] in group.poses else ():
                part = self.system.flat.part_of(other)
                holder = self._pulled(part.component, other)
                inside = node in side if holder is None else holder in side
                if inside and not isinstance(part.component, AbstractRigidPart):
                    flow = self._into(part, other)
                    pose = self.system.placement.place(other)[1]
                    moved = formulas.move_wrench(symbolic(pose.rotation), symbolic(pose.position), *flow)
                    torque, force = torque + moved[0], force + moved[1]
        return _seen_from(place, torque, force)

    def _pulled(self, component: Component, end: Point) -> str | None:
        """Of what a field does: the path of the part that it acts on, as gravity does, wherever that part is held; None of all else."""
        if isinstance(component, PairForce):
            body = component.one if end is component.frame_a else component.other
        elif isinstance(component, FieldForce):
            body = component.body if end is component.frame_b else self._seat(component.field).owner
        else:
            return None
        return next((p.path for p in self.system.flat.parts if p.component is body and isinstance(body, AbstractRigidPart)), None)

    def _inertial(self, link: int, inertia: Inertia) -> Wrench:
        """What an inertia given in a link's frame needs to move with the link, or to rest on the ground (-1), gravity included."""
        second, moment = ca.densify(symbolic(inertia.second_moment)), symbolic(inertia.moment)
        if link < 0:
            weight = ca.SX(self.system.tree.gravity)
            return -ca.cross(moment, weight), -ca.SX(inertia.mass) * weight
        w_dot, a = self.motion.accelerations[link]
        torque, force = formulas.bias_wrench(second, moment, self.system.kinematics.angular_velocity(link))
        H = symbolic(skew(inertia.moment))
        return torque + second @ w_dot + H @ a, force + H.T @ w_dot + ca.SX(inertia.mass) * a


def _negated(wrench: Wrench) -> Wrench:
    return -wrench[0], -wrench[1]


def _seen_from(place: Pose, torque: ca.SX, force: ca.SX) -> Wrench:
    """A wrench in and about a link's frame, in and about a place in it."""
    back = place.inverse()
    moved = formulas.move_wrench(symbolic(back.rotation), symbolic(back.position), torque, force)
    return moved[0], moved[1]
