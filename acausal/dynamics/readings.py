"""What forces read of the scene besides their own connectors: other parts' positions, velocities, joints' coordinates, signals."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import casadi as ca

from acausal.dynamics.placement import TreePlacement
from acausal.errors import ModelError, UnknownVariableError
from acausal.language.connector import FLOWS, Point, Quantity
from acausal.language.expression import Derivative, Input, Magnitude, Parameter, Symbol, declared
from acausal.language.flatten import FlatSystem, Part
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, symbolic

_INSTEAD = (
    "Rates are known of positions, rotations, joints' q, variables of scalar parts and time. For anything else put a delay between: a signal behind "
    "an Integrator is a state."
)
_DYNAMIC = ("force", "torque", "acceleration", "angular_acceleration", "specific_force")


@dataclass(frozen=True)
class Readings:
    """Turns declared symbols in forces into expressions of q, v, t, inputs and parameters.

    What stays as it is: `borrowed`, variables of scalar domains, and `implicit`, accelerations and reactions, whose values are found later, with
    the part that reads each.
    """

    flat: FlatSystem
    placement: TreePlacement
    borrowed: dict[Symbol, Part] = field(default_factory=dict[Symbol, Part])
    implicit: dict[Symbol, Part] = field(default_factory=dict[Symbol, Part])
    _known: set[int] = field(default_factory=set[int])
    _values: dict[Symbol, ca.SX] = field(default_factory=dict[Symbol, ca.SX])

    def __post_init__(self) -> None:
        tree = self.placement.kinematics.tree
        own = [tree.t, *ca.vertsplit(tree.q), *ca.vertsplit(tree.v), *(p.sx for p in (*self.flat.parameters, *self.flat.inputs))]
        self._known.update(s.element_hash() for s in own)

    def foreign(self, value: ca.SX) -> list[ca.SX]:
        """Scalars in an expression that are neither states, nor time, inputs or parameters of the scene."""
        return [s for s in ca.symvar(value) if s.element_hash() not in self._known]

    def resolved(self, value: ca.SX, part: Part) -> ca.SX:
        """What `part` says, with all that can be known put in. Raises `UnknownVariableError` and `ModelError` with the part and its line."""
        symbols: dict[Symbol, None] = {}
        for scalar in self.foreign(value):
            symbol = declared(scalar)
            if symbol is None:
                raise ModelError(
                    f"The law of {part.where} contains the symbol '{scalar.name()}', which is declared nowhere. Use ac.Parameter, ac.Input, ac.time "
                    "or variables of parts, and keep each as an attribute of a part or of the scene: scene.k = ac.Parameter(1.0)."
                )
            symbols[symbol] = None
        found = [(symbol, self._value(symbol, part)) for symbol in symbols]
        found = [(symbol, new) for symbol, new in found if new is not symbol.sx]
        return ca.substitute([value], [symbol.sx for symbol, _ in found], [new for _, new in found])[0] if found else value

    def rate(self, value: ca.SX, part: Part) -> ca.SX:
        """Time derivative of an expression of positions and time. Raises `ModelError` where velocities or signals are in it."""
        known, tree = self.resolved(value, part), self.placement.kinematics.tree
        moving = ca.depends_on(known, tree.v) if tree.v.numel() else False
        if moving or self.foreign(known):
            raise ModelError(
                f"{part.where} asks for the rate of an expression that holds velocities or signals: it would follow from accelerations, and these "
                f"from all forces. {_INSTEAD}"
            )
        return self.placement.kinematics.rate(known)

    def _value(self, symbol: Symbol, part: Part) -> ca.SX:
        if symbol not in self._values:
            self._values[symbol] = self._read(symbol, part)
        return self._values[symbol]

    def _read(self, symbol: Symbol, part: Part) -> ca.SX:
        if isinstance(symbol, Magnitude) or not self.foreign(symbol.sx):
            return symbol.sx
        at_parts = self.flat.at_parts(symbol)
        if at_parts is not None:
            return self.resolved(at_parts.sx, part)
        if isinstance(symbol, Quantity):
            return self._at_connector(symbol, part)
        if isinstance(symbol, Derivative):
            return self._rate(symbol, part)
        if isinstance(symbol, Parameter | Input):
            raise self._foreign(symbol, part, f"Keep it as an attribute: scene.name = ac.{type(symbol).__name__}(...).")
        if symbol in self.free_flanges:
            return self.free_flanges[symbol]
        cuts = self.placement.kinematics.tree.mechanism.cuts
        cut = next((c for c in cuts if isinstance(c.joint, AbstractJoint) and symbol in (c.joint.q, c.joint.v)), None)
        if cut is not None:
            raise ModelError(
                f"{part.where} depends on {cut.name}.{symbol.name}. {cut.name} closes a loop, where angles are known up to full turns only, unless "
                f"it is seen that something acts on them: keep the variable as an attribute of the part, self.angle = {cut.name}.q."
            )
        if symbol not in self.flat.names:
            raise self._foreign(symbol, part, "Assign its part: scene.name = ...")
        self.borrowed.setdefault(symbol, part)
        return symbol.sx

    def _at_connector(self, symbol: Quantity, part: Part) -> ca.SX:
        connector = symbol.connector
        if not isinstance(connector, Point) or not any(p.component is connector.owner for p in self.flat.parts):
            raise self._foreign(symbol, part, "Assign its part: scene.name = ...")
        if symbol.name in _DYNAMIC:
            self.implicit.setdefault(symbol, part)
            return symbol.sx
        X = self.placement.pose(connector)
        R = symbolic(X.rotation)
        if symbol.name == "position":
            return symbolic(X.position)
        if symbol.name == "rotation":
            return R
        return R @ (
            self.placement.velocity(connector) if symbol.name == "velocity" else self.placement.angular_velocity(connector)
        )

    def _rate(self, symbol: Derivative, part: Part) -> ca.SX:
        of = self._read(symbol.of, part)
        if any(declared(s) in self.implicit for s in self.foreign(of)):
            raise ModelError(
                f"{part.where} depends on {symbol.name}, the rate of an acceleration or of a reaction, which is not known. {_INSTEAD}"
            )
        if self.foreign(of):
            self.borrowed.setdefault(symbol, part)
            return symbol.sx
        tree = self.placement.kinematics.tree
        if ca.depends_on(of, tree.v):
            self.implicit.setdefault(symbol, part)
            return symbol.sx
        return self.placement.kinematics.rate(of)

    @functools.cached_property
    def free_flanges(self) -> dict[Symbol, ca.SX]:
        """Angles or positions, and efforts, at joints' flanges that nothing is connected to."""
        alone = {members[0] for members in self.flat.connection_sets if len(members) == 1}
        found: dict[Symbol, ca.SX] = {}
        for item in self.placement.kinematics.tree.joints:
            for flange in item.edge.joint.flanges:
                if flange in alone:
                    potential, flow = FLOWS[type(flange)]
                    found |= {getattr(flange, potential): item.edge.joint.q.sx, getattr(flange, flow): ca.SX(0)}
        return found

    def _foreign(self, symbol: Symbol, part: Part, hint: str) -> UnknownVariableError:
        what = repr(symbol) if isinstance(symbol, Quantity) else f"the {symbol.kind} '{symbol.name}' [{symbol.unit}]"
        return UnknownVariableError(f"{part.where} depends on {what}, which belongs to no part of the scene. {hint}")


@dataclass(frozen=True)
class ReadingPlacement:
    """The `Placement` that one force is given: rates know what it reads besides its own connectors."""

    placement: TreePlacement
    readings: Readings
    part: Part

    @property
    def t(self) -> ca.SX:
        """Time [s]."""
        return self.placement.t

    def pose(self, connector: Point) -> Pose:
        """X_WC: the connector's frame in the world."""
        return self.placement.pose(connector)

    def relative_pose(self, a: Point, b: Point) -> Pose:
        """X_ab: the frame of b in the frame of a."""
        return self.placement.relative_pose(a, b)

    def velocity(self, connector: Point) -> ca.SX:
        """Of the connector's origin against the world, in the connector's own axes [m/s]."""
        return self.placement.velocity(connector)

    def angular_velocity(self, connector: Point) -> ca.SX:
        """Against the world, in the connector's own axes [rad/s]."""
        return self.placement.angular_velocity(connector)

    def rate(self, expression: ca.SX) -> ca.SX:
        """Time derivative of an expression in poses and time, and of what else is read."""
        return self.readings.rate(expression, self.part)
