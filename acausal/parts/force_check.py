"""Forces looked at by themselves, at connectors that move freely: what their laws read, and whether energies and forces agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from acausal.language.connector import Point
from acausal.language.expression import Parameter, Symbol, Time, declared_in, time
from acausal.parts.force import AbstractForce, Action
from acausal.parts.pose import Pose, symbolic, vee


@dataclass(frozen=True)
class FreePlacement:
    """A `Placement` where each connector moves by itself: its position p and half-angles g (Rodrigues parameters) are `y`, with rates `y_dot`."""

    _places: dict[Point, ca.SX] = field(default_factory=dict[Point, ca.SX])

    @property
    def t(self) -> ca.SX:
        """Time [s]."""
        return time.sx

    @property
    def y(self) -> ca.SX:
        """Coordinates (6 n, 1) of the n connectors asked for, in the order of asking."""
        return ca.vertcat(ca.SX(0, 1), *(place[:6] for place in self._places.values()))

    @property
    def y_dot(self) -> ca.SX:
        """Their rates."""
        return ca.vertcat(ca.SX(0, 1), *(place[6:] for place in self._places.values()))

    def pose(self, connector: Point) -> Pose:
        """X_WC."""
        if connector not in self._places:
            self._places[connector] = ca.SX.sym(connector.name, 12)
        place = self._places[connector]
        g = place[3:6]
        G = ca.skew(g)
        return Pose(ca.SX.eye(3) + 2 / (1 + ca.sumsqr(g)) * (G + G @ G), place[:3])

    def relative_pose(self, a: Point, b: Point) -> Pose:
        """X_ab."""
        return self.pose(a).inverse() @ self.pose(b)

    def velocity(self, connector: Point) -> ca.SX:
        """In the connector's own axes."""
        X = self.pose(connector)
        return symbolic(X.rotation).T @ self.rate(symbolic(X.position))

    def angular_velocity(self, connector: Point) -> ca.SX:
        """In the connector's own axes."""
        R = symbolic(self.pose(connector).rotation)
        return vee(R.T @ self.rate(R))

    def rate(self, expression: ca.SX) -> ca.SX:
        """Time derivative of an expression in poses and time."""
        column = ca.vec(ca.SX(expression))
        change = ca.jtimes(column, self.t, ca.SX(1))
        if self.y.numel():
            change += ca.jtimes(column, self.y, self.y_dot)
        return ca.reshape(change, *ca.SX(expression).shape)

    def power(self, actions: Sequence[Action]) -> ca.SX:
        """Of forces and torques on what they act on [W]."""
        return ca.sum1(self.powers(actions))

    def powers(self, actions: Sequence[Action]) -> ca.SX:
        """The terms of `power`, component by component (6 n, 1) [W]."""
        terms = [ca.SX(0, 1)]
        for action in actions:
            terms += [action.force * self.velocity(action.connector), action.torque * self.angular_velocity(action.connector)]
        return ca.vertcat(*terms)


def symbols_read(force: AbstractForce) -> frozenset[Symbol]:
    """Declared symbols in a force's law that are neither time nor parameters."""
    placement = FreePlacement()
    columns = [column for a in force.actions(placement) for column in (a.force, a.torque)]
    law = ca.vertcat(*columns, ca.SX(force.potential_energy(placement)), ca.SX(force.power_loss(placement)))
    return frozenset(symbol for symbol in declared_in(law) if not isinstance(symbol, Parameter | Time))


def unbalanced_power(force: AbstractForce, samples: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """(power of the force, rate of its potential, its power loss) [W] for each of some random motions, (samples, 3); they add to zero.

    And how large the terms of these are that may cancel (samples,): a force across the velocity has no power but rounding.
    Not for forces that read more than their own connectors, time and parameters, which stand at their present values.
    """
    placement = FreePlacement()
    powers = placement.powers(force.actions(placement))
    change = placement.rate(ca.SX(force.potential_energy(placement)))
    lost = ca.SX(force.power_loss(placement))
    size = ca.sum1(ca.fabs(powers)) + ca.fabs(change) + ca.fabs(lost)
    row = ca.densify(ca.horzcat(ca.sum1(powers), change, lost, size))
    parameters = [s for s in declared_in(row) if isinstance(s, Parameter)]
    arguments = [placement.y, placement.y_dot, placement.t, ca.vertcat(ca.SX(0, 1), *(p.sx for p in parameters))]
    function = ca.Function("balance", arguments, [row])
    rng, n = np.random.default_rng(0), placement.y.numel()
    values = [p.value for p in parameters]
    found = np.array(
        [np.array(function(rng.uniform(0.2, 1.0, n), rng.normal(size=n), 0.3, values)).ravel() for _ in range(samples)]
    )
    return found[:, :3], found[:, 3]
