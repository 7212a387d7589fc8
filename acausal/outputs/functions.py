"""Lower: named CasADi functions of a reduced system. Each is made when first asked for."""

from __future__ import annotations

import copy
import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from acausal.collocation.modes import ModeFunctions
from acausal.collocation.problem import Exact, Through
from acausal.dynamics.newton_euler import newton_euler
from acausal.errors import ExportError, UnknownVariableError
from acausal.language.component import energy_unknown
from acausal.language.connector import Frame, Point
from acausal.language.expression import Expression, Symbol
from acausal.language.flatten import Part
from acausal.language.when import when
from acausal.numerics.folding import folded_function
from acausal.numerics.instructions import instructions
from acausal.numerics.staged import Function, Staged, operations_of, operations_of_systems, systems_of
from acausal.numerics.switching import has_switches, switching
from acausal.numerics.terms import rounded
from acausal.outputs.borders import Border, borders
from acausal.outputs.given_motion import GivenMotion, given_motions
from acausal.outputs.guided import Guide, guides
from acausal.outputs.mode_functions import mode_functions
from acausal.outputs.outputs import Outputs
from acausal.outputs.set_functions import set_functions
from acausal.parts.contact import AbstractContact
from acausal.parts.unit_quaternions import unit_quaternions
from acausal.reduce.decisions import Decisions
from acausal.reduce.holds import holds
from acausal.reduce.state_space import StateSpace
from acausal.runtime.integrand import Integrand
from acausal.runtime.series import Series
from acausal.wording import counted, nearest

if TYPE_CHECKING:
    from acausal.runtime.kernels import How
    from acausal.runtime.native import NativeProblem, SharedProblems


_SETTINGS = 16
"""Lists of events whose kernels are kept."""
_KEPT, _DEPTH = 512, 100
"""Expressions whose readings are kept, and operations on top of one another up to which two of them are compared."""


@dataclass(frozen=True)
class Reading:
    """How an expression is read of a motion: `series` gives its column, `shape` says what it is. `of_dynamics`: its inputs are followed by what
    the dynamics give; `of_loops`: and then by what redundant loops bear. `of_forces`: not by rates of states alone. `angle`: known up to full turns.
    """

    series: Series
    shape: tuple[int, int]
    of_dynamics: bool
    of_loops: bool
    of_forces: bool
    angle: bool


@dataclass(frozen=True, repr=False)
class Functions:
    """CasADi `Function`s of a model. Arguments: t [s], x = (q, v), u (inputs), p (parameters), in the order of the model's names.

    All are `SX` functions, so they can be differentiated, mapped, used in `ca.Opti` and turned into C.
    """

    outputs: Outputs
    space: StateSpace

    def __repr__(self) -> str:
        return f"<Functions of {self.outputs.system.flat.name}: {counted(len(self.state_names), 'state')}, {counted(len(self.input_names), 'input')}, {counted(len(self.parameter_names), 'parameter')}>"

    def __reduce__(self) -> tuple[Any, ...]:
        return _functions, (self.outputs, self.space, self._events)

    def __deepcopy__(self, memo: dict[int, Any]) -> Functions:
        """Itself, unless the scene is copied along with it."""
        system = copy.deepcopy(self.outputs.system, memo)
        if system is self.outputs.system:
            return self
        return _functions(Outputs(system), copy.deepcopy(self.space, memo), copy.deepcopy(self._events, memo))

    @property
    def _events(self) -> tuple[when, ...]:
        """At which something is set, beside those of parts."""
        return vars(self).get("_set_at", ())

    @functools.cached_property
    def decisions(self) -> Decisions:
        """What the reduction decided by the values of parameters."""
        return Decisions(self.space)

    @functools.cached_property
    def holds(self) -> ca.Function | None:
        """(t, x, u, p) -> margin, not negative where what was decided by numbers holds: which rows of loops are independent, what follows from what,
        pivots. NaN counts as negative. None where no parameter and no time can change it.
        """
        margin = holds(self.space)
        return None if margin is None else self._function("holds", [margin], ["margin"])

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states in x, e.g. `hinge.q`, `ball.q[2]`."""
        return self.space.names(self.tree_state_names)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs u, in order."""
        return tuple(self.outputs.name(entry) for entry in self.outputs.system.flat.inputs)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters p, in order; constants of integrated velocity constraints last."""
        constants = self.space.elimination.constants
        own = tuple(self.outputs.name(entry) for entry in self.outputs.system.flat.parameters)
        return own + tuple(constants[i].name() for i in range(constants.numel()))

    @property
    def tree_state_names(self) -> tuple[str, ...]:
        """Names of all states of the reduced system, also of those that follow from x."""
        names: list[str] = []
        scalars, n = self.outputs.system.scalar_states, self.outputs.system.scalar.positions
        for kind in ("q", "v"):
            for item in self.outputs.system.mechanics.tree.joints:
                size = (item.edge.joint.q if kind == "q" else item.edge.joint.v).size
                names += [f"{item.edge.name}.{kind}" + (f"[{i}]" if size > 1 else "") for i in range(size)]
            names += [self.outputs.name(s) for s in (scalars[:n] if kind == "q" else scalars[n:])]
        return tuple(names)

    @functools.cached_property
    def explicit_dynamics(self) -> ca.Function:
        """(t, x, u, p) -> x'."""
        return self._function("explicit_dynamics", [self.space.kept(self.outputs.system.x_dot)], ["x_dot"])

    @functools.cached_property
    def residual_dynamics(self) -> ca.Function:
        """(t, x, x_dot, multipliers, u, p) -> residual, zero along motions: q' - N v, Newton-Euler, A v' + bias.

        Recursive Newton-Euler; its Jacobians are cheaper than those of `explicit_dynamics`.
        """
        s, space = self.outputs.system, self.space
        # in a chart nothing is held, so nothing holds it
        A = s.constraints.jacobian if space.coordinates is None else ca.SX(0, s.tree_velocities)
        rate, force = ca.SX.sym("x_dot", space.x.numel()), ca.SX.sym("multipliers", A.shape[0])
        everything = space.put(s.x)
        L = ca.jacobian(everything, space.x)  # rates of all states by those of x
        rows = slice(s.nq, s.nq + s.tree_velocities)
        v_dot = (L @ rate + ca.jtimes(everything, s.t, ca.SX(1)))[rows, :]
        balance = newton_euler(s.mechanics.kinematics, v_dot, list(s.mechanics.wrenches)).tau - s.forces_at(v_dot)
        if A.shape[0]:
            balance -= A.T @ force
        # what holds eliminated coordinates does no work
        first, last = space.nq, space.nq + space.velocities
        difference = rate - space.kept(s.x_dot)
        found = [difference[:first, :], L[rows, first:last].T @ balance, difference[last:, :]]
        if A.shape[0]:
            found.append(A @ v_dot + s.constraints.bias)
        names = ["t", "x", "x_dot", "multipliers", "u", "p"]
        return folded_function(
            "residual_dynamics", [s.t, space.x, rate, force, s.u, space.p], [space.put(ca.vertcat(*found))], names, ["residual"]
        )

    @functools.cached_property
    def multipliers(self) -> ca.Function:
        """(t, x, u, p) -> multipliers of the kept constraint rows."""
        return self._function("multipliers", [self.outputs.system.multipliers], ["multipliers"])

    @functools.cached_property
    def mass_matrix(self) -> ca.Function:
        """(t, x, u, p) -> M(q), symmetric (nv, nv), of the tree's velocities."""
        s = self.outputs.system
        v_dot = ca.SX.sym("v_dot", s.mechanics.tree.v.numel())
        tau = newton_euler(s.mechanics.kinematics, v_dot, list(s.mechanics.wrenches)).tau
        return self._function("mass_matrix", [ca.densify(ca.jacobian(tau, v_dot))], ["M"])

    @functools.cached_property
    def kinetic_energy(self) -> ca.Function:
        """(t, x, u, p) -> [J]."""
        return self._function("kinetic_energy", [self.outputs.kinetic_energy], ["T"])

    @functools.cached_property
    def potential_energy(self) -> ca.Function:
        """(t, x, u, p) -> [J]."""
        return self._function("potential_energy", [self.outputs.potential_energy], ["V"])

    @functools.cached_property
    def energies(self) -> ca.Function:
        """(t, x, u, p) -> both, one above the other [J]."""
        both = ca.vertcat(self.outputs.kinetic_energy, self.outputs.potential_energy)
        return self._function("energies", [both], ["T_and_V"], fold=False)

    @functools.cached_property
    def power_loss(self) -> Function:
        """(t, x, u, p) -> power that leaves the mechanical energy: dissipated less supplied [W]."""
        return self._staged("power_loss", lambda outputs: outputs.power_loss)

    @functools.cached_property
    def impacts(self) -> ca.Function | None:
        """(t, x, u, p) -> rates that reactions which hold as long as they can work along, then what is lost by each; None without such reactions."""
        m = self.outputs.system.modes
        return (
            None
            if m is None
            else self._function("impacts", [ca.vertcat(m.rate, self.outputs.loss_by_reactions)], ["rates_and_losses"])
        )

    @functools.cached_property
    def watched(self) -> ca.Function:
        """(t, x, u, p) -> kinetic energy, potential energy [J], all invariants, and loop rows that follow from these."""
        space = self.space
        energies = space.put(ca.vertcat(self.outputs.kinetic_energy, self.outputs.potential_energy))
        rows = ca.SX(0, 1) if self.invariants is None else self.invariants(*space.arguments)
        following = space.put(self.outputs.system.constraints.dropped)
        return ca.Function("watched", space.arguments, [ca.densify(ca.vertcat(energies, rows, following))])

    @functools.cached_property
    def drawn(self) -> tuple[np.ndarray, np.ndarray]:
        """Sizes (rows,) of what met in the constants of what is `watched`, which are known to rounding of these only: of positions; of rates, where what is
        much changes by its own size in a second.
        """
        s = self.outputs.system
        places, rates, dropped = s.constraints.drawn
        first, rows = s.position_invariants.numel(), ca.vertcat(s.position_invariants, s.velocity_invariants)
        known, own = np.zeros((2, rows.numel())), s.constraints.joint_invariants.numel()
        known[0, own : own + places.size], known[1, first : first + rates.size] = places, rates
        at_rest, moving = (known + self._brought(rows, known))[:, self.space.left(rows)]
        return np.concatenate([np.zeros(2), at_rest, dropped]), np.concatenate([np.zeros(2), moving, np.zeros(dropped.size)])

    def _brought(self, rows: ca.SX, known: np.ndarray) -> np.ndarray:
        """What coordinates that follow from some `rows` (n, 1) in closed form bring into others of what these are `known` to, (2, n)."""
        s, gone = self.outputs.system, ca.vertcat(ca.SX(0, 1), *self.space.elimination.symbols)
        left, slopes = self.space.left(rows), ca.Function("slopes", [s.t, s.x, s.p], [ca.densify(ca.jacobian(rows, gone))])
        A = np.abs(np.array(slopes(s.constraints.time, np.concatenate([s.q_start, s.rate_start]), s.p_values)))
        A = A.reshape(rows.numel(), gone.numel())
        by = [k for k in range(rows.numel()) if k not in left]
        each = np.divide(known[:, by, None], A[by], out=np.zeros((2, len(by), gone.numel())), where=A[by] > 0)
        return np.where(np.isin(np.arange(rows.numel()), left), each.max(axis=1, initial=0.0) @ A.T, 0.0)

    @functools.cached_property
    def kept_invariants(self) -> int:
        """How many invariants there are."""
        return 0 if self.invariants is None else self.invariants.numel_out(0)

    @functools.cached_property
    def quaternion_states(self) -> list[int]:
        """Numbers in x of the entries of unit quaternions."""
        s = self.outputs.system
        first = unit_quaternions(s.position_invariants, s.x[: s.nq, :]).values()
        return [k for k, place in enumerate(self.space.places) if any(0 <= place - i < 4 for i in first)]

    @functools.cached_property
    def energy_told(self) -> bool:
        """Whether every part says what energy it stores, loses and brings in, or it follows from mechanics."""
        return self.outputs.knows_powers and not any(energy_unknown(part.component) for part in self.outputs.system.flat.parts)

    @functools.cached_property
    def operations_of_power_and_rates(self) -> tuple[int, int]:
        """Of `power_loss` and of `staged_dynamics`, once."""
        return operations_of(self.power_loss), operations_of(self.staged_dynamics)

    @functools.cached_property
    def constraint_position(self) -> ca.Function:
        """(t, x, u, p) -> residuals of joint invariants and kept loop rows; zero when assembled."""
        return self._function("constraint_position", [self.space.constraints(self.outputs.system.position_invariants)], ["g"])

    @functools.cached_property
    def constraint_velocity(self) -> ca.Function:
        """(t, x, u, p) -> residuals of the kept velocity rows."""
        return self._function("constraint_velocity", [self.space.constraints(self.outputs.system.velocity_invariants)], ["g_dot"])

    @functools.cached_property
    def constraint_jacobian(self) -> ca.Function:
        """(t, x, u, p) -> A (m, nv): the velocity rows are A v + drift."""
        return self._function("constraint_jacobian", [self.outputs.system.constraints.jacobian], ["A"])

    @functools.cached_property
    def invariants(self) -> ca.Function | None:
        """(t, x, u, p) -> everything that stays zero along a motion; None if there is nothing."""
        s = self.outputs.system
        rows = self.space.constraints(ca.vertcat(s.position_invariants, s.velocity_invariants))
        if not rows.numel():
            return None
        return folded_function("invariants", self.space.arguments, [ca.densify(rows)], [*"txup"], ["g"])

    @functools.cached_property
    def projection(self) -> ca.Function | None:
        """(t, x, u, p) -> x, one Newton step towards zero invariants in the mass metric; None if there is nothing to project."""
        s = self.outputs.system
        if s.projection is None or self.invariants is None:
            return None
        result = ca.densify(self.space.kept(s.projection))
        return ca.Function("projection", self.space.arguments, [result], [*"txup"], ["x_next"])

    @functools.cached_property
    def clearance(self) -> ca.Function | None:
        """(t, x, p) -> about the square of the distance from the next singular position of a loop, 1 far away; None if there is none."""
        s = self.outputs.system
        if s.clearance is None or self.space.coordinates is not None:
            return None
        found = ca.densify(self.space.put(s.clearance))
        return ca.Function("clearance", [s.t, self.space.x, self.space.p], [found], ["t", "x", "p"], ["clearance"])

    @functools.cached_property
    def exact(self) -> Exact | None:
        """`explicit_dynamics` and `projection` once more for arithmetic with twice as many digits; None where loops need none."""
        s = self.outputs.system
        if s.exact is None:
            return None
        through = Through.NEVER if not s.constraints.singular else Through.SOMETIMES if s.constraints.narrow else Through.ALWAYS
        return Exact(self.exact_dynamics, self.exact_projection, through, self.space.restricted(self._usual))

    @functools.cached_property
    def much(self) -> np.ndarray:
        """How much a position or velocity of loops is, beside others; 0 for other states of the system."""
        s = self.outputs.system
        positions, velocities = s.constraints.much
        much = np.zeros(s.x.numel())
        much[: positions.size], much[s.nq : s.nq + velocities.size] = positions, velocities
        return much

    @property
    def _usual(self) -> np.ndarray:
        """1 / these, 0 for other states."""
        return np.divide(1.0, self.much, out=np.zeros(self.much.size), where=self.much > 0)

    @property
    def _standing(self) -> np.ndarray | None:
        """The same, below 0 where loops do not hold a state for good, nor lead it through singular positions; None where there is none else. Only rounding
        moves what they hold, and next to singular positions it moves all.
        """
        s = self.outputs.system
        if self.space.coordinates is not None:
            return None
        usual, signs = self._usual, np.full(s.x.numel(), 1.0 if s.constraints.singular else -1.0)
        for part in s.constraints.examined:
            positions, velocities = part.standing
            signs[np.array(part.group.q_places, dtype=int)[positions]] = 1.0
            signs[s.nq + np.array(part.group.v_places, dtype=int)[velocities]] = 1.0
        return self.space.restricted(usual * signs) if (usual * signs > 0).any() else None

    def exact_dynamics(self) -> ca.Function:
        """(t, x, u, p) -> x' for arithmetic with twice as many digits, where there is such a function: long, and needed near singular positions only."""
        return self._exact_dynamics

    def exact_projection(self) -> ca.Function:
        """(t, x, u, p) -> x for the same."""
        return self._exact_projection

    @functools.cached_property
    def _exact_dynamics(self) -> ca.Function:
        assert self.outputs.system.exact is not None
        return self._function("exact_dynamics", [self.space.kept(self.outputs.system.exact[0])], ["x_dot"])

    @functools.cached_property
    def _exact_projection(self) -> ca.Function:
        s = self.outputs.system
        assert s.exact is not None
        step = ca.densify(self.space.kept(s.exact[1]))
        return folded_function("exact_projection", self.space.arguments, [step], [*"txup"], ["x_next"])

    def native(self, how: How) -> NativeProblem | None:
        """Dynamics, invariants, projection and clearance as kernels; None where there is no runtime, or a compiler fails."""
        from acausal.runtime.native import native_problem

        try:
            return self._native.of(how, lambda: native_problem(self.integrand, how))
        except ExportError:  # whoever integrates tries again, and says what is wrong
            return None

    @functools.cached_property
    def integrand(self) -> Integrand:
        """Dynamics, what keeps them on their invariants, and their switches, for the runtime."""
        return self._integrand(self.modes)

    def _integrand(self, modes: ModeFunctions | None) -> Integrand:
        rates = self.staged_dynamics
        held = () if modes is None else (modes.guards, modes.decision)
        if self.invariants is not None and has_switches(self.invariants):
            held += (self.invariants,)
        return Integrand(
            rates, self.invariants, self.projection, self.clearance, self.exact, self.space.nq, switching(rates, *held), modes,
            self._standing, self._followers,
        )  # fmt: skip

    @property
    def _followers(self) -> tuple[int, ...]:
        s = self.outputs.system
        return (
            ()
            if self.space.coordinates is not None
            else tuple(self.space.places.index(s.scalar_places[k]) for k in sorted(s.scalar.followers))
        )

    @functools.cached_property
    def staged_dynamics(self) -> Function:
        """`explicit_dynamics`; with modes, where reactions are answers of systems that are solved in numbers."""
        return (
            self.explicit_dynamics
            if self.outputs.system.modes is None
            else self._staged("explicit_dynamics", lambda outputs: self.space.kept(outputs.system.x_dot))
        )

    def _staged(self, name: str, said: Callable[[Outputs], ca.SX], fold: bool = True) -> Function:
        """(t, x, u, p) -> what outputs say; with modes, where reactions are answers of systems that are solved in numbers. `fold`: no, where kernels alone are made of it, which do."""
        modes, space = self.outputs.system.modes, self.space
        result = said(self.outputs.unmasked)
        if modes is None:
            return self._function(name, [result], [name], fold)
        found = ca.densify(space.put(modes.with_answers(result)))
        return Staged.of(name, space.arguments, [found], modes.systems.with_operands(space.put), fold)

    @functools.cached_property
    def led_gaps(self) -> list[int]:
        """Rows that may hold the same as others do, and depend on time: all that may be closed, if one of them does."""
        modes = self.outputs.system.modes
        rows = [] if modes is None or not modes.redundant else list(enumerate(modes.rows))
        found = [(k, row.moved) for k, row in rows if row.one_sided and not row.one_way]
        led = bool(found) and ca.depends_on(ca.vertcat(*(moved for _, moved in found)), self.outputs.system.t)
        return [k for k, _ in found] if led else []

    @functools.cached_property
    def modes(self) -> ModeFunctions | None:
        """What decides which reactions hold, and what is set when; None where all of them hold at all times, and nothing is set."""
        found = set_functions(self.outputs, self.space)
        if self.outputs.system.modes is None and found is None:
            return None
        return replace(self._modes, set=found)

    @functools.cached_property
    def _modes(self) -> ModeFunctions:
        s = self.outputs.system
        return mode_functions(s.modes, s, self.space, self.invariants, self.projection)

    def setting(self, events: tuple[when, ...]) -> Functions:
        """With what is set at these events, too. Raises `ModelError` for what cannot be set."""
        if not events:
            return self
        if events not in self._setting:
            if len(self._setting) >= _SETTINGS:
                self._setting.clear()
            found = Functions(self.outputs, self.space)
            kept = {
                name: value for name, value in vars(self).items() if name not in ("modes", "integrand", "_native", "_setting")
            }
            modes = replace(self._modes, set=set_functions(self.outputs, self.space, events))
            vars(found).update(kept, modes=modes, _set_at=events)
            self._setting[events] = found
        return self._setting[events]

    @functools.cached_property
    def _setting(self) -> dict[tuple[when, ...], Functions]:
        return {}

    @functools.cached_property
    def _native(self) -> SharedProblems:
        from acausal.runtime.native import SharedProblems

        return SharedProblems()

    @functools.cached_property
    def loop_matrix(self) -> ca.Function:
        """(t, x, u, p) -> A M^-1 A' of the kept rows; its rank falls where a loop is singular."""
        return self._function("loop_matrix", [self.outputs.system.delassus], ["D"])

    @functools.cached_property
    def given_motions(self) -> tuple[GivenMotion, ...]:
        """Positions and angles that parts prescribe as functions of time."""
        return given_motions(self.outputs)

    @functools.cached_property
    def borders(self) -> tuple[Border, ...]:
        """Where parts have a meaning."""
        return borders(self.outputs)

    @functools.cached_property
    def guides(self) -> tuple[Guide, ...]:
        """Where what slides may come to a corner."""
        return guides(self.outputs)

    @functools.cached_property
    def along_guides(self) -> ca.Function:
        """(t, x, u, p) -> velocity (3) and coordinates of all `guides`."""
        return self.output(
            ca.vertcat(*(ca.vertcat(guide.velocity, guide.coordinates) for guide in self.guides)), name="along_guides"
        )

    @functools.cached_property
    def inside(self) -> ca.Function:
        """(t, x, u, p) -> values of all `borders`, positive inside."""
        return self.output(ca.vertcat(ca.SX(0, 1), *(border.values for border in self.borders)), name="inside")

    def beyond(
        self, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray, near: float = 0.0
    ) -> tuple[Border, np.ndarray] | None:
        """The first border that a state (nx,) is on, as `near` as this, or beyond, with inputs u (nu,), or those that are no masks of modes, and its values there; None inside all."""
        if not self.borders:
            return None
        given = np.append(u, np.zeros(self.inside.size1_in(2) - u.size))
        values = np.array(self.inside(t, x, given, p))[:, 0]
        each = np.split(values, np.cumsum([border.values.numel() for border in self.borders])[:-1])
        return next(((border, own) for border, own in zip(self.borders, each, strict=True) if not np.all(own > near)), None)

    def border_of(self, row: int) -> tuple[Border, str]:
        """The one that a row of `inside` belongs to, and what is said where this row is zero."""
        ends = itertools.accumulate(border.values.numel() for border in self.borders)
        border, end = next((border, end) for border, end in zip(self.borders, ends, strict=True) if row < end)
        return border, border.whys[row - end]

    @functools.cached_property
    def contacts(self) -> tuple[tuple[Part, ...], ca.Function | None]:
        """Parts that in nature only push, and (t, x, u, p) -> how much each pushes [N], negative where it pulls; None without such parts."""
        found: list[tuple[Part, ca.SX]] = []
        for part in self.outputs.system.flat.parts:
            contact = part.component
            if isinstance(contact, AbstractContact) and contact.holds:
                found.append((part, self.outputs.resolve(contact.normal_force)))
        pushes = ca.vertcat(*(push for _, push in found))
        return tuple(part for part, _ in found), self._function("contacts", [pushes], ["pushes"], fold=False) if found else None

    @functools.cached_property
    def followed(self) -> tuple[ca.Function | None, ca.Function | None]:
        """(t, x, u, p) -> what is off of what loops hold of gears, the sums of their terms' sizes by states and inputs, then of all that is rounded in them
        and in the coordinates that loops hold; the same of gaps that inputs move. None where there is nothing of a kind.
        """
        s, none = self.outputs.system, ca.SX(0, 1)
        gaps = ca.vertcat(none, *(() if s.modes is None else s.modes.followed.values()))
        masks = ca.vertcat(none, *(mask.sx for mask in s.flat.modes))
        by_inputs = ca.substitute(s.u, masks, ca.SX.zeros(masks.numel())) if masks.numel() else s.u
        looped = ca.vertcat(none, *(h.residual for h in s.scalar.looped))
        return self._with_terms(looped, s.x, s.u), self._with_terms(gaps, none, by_inputs)

    def _with_terms(self, rows: ca.SX, x: ca.SX, u: ca.SX) -> ca.Function | None:
        if not rows.numel():
            return None
        s = self.outputs.system
        slopes = ca.fabs(ca.jacobian(rows, s.x))
        terms = (slopes @ ca.fabs(x) if x.numel() else 0) + ca.fabs(ca.jacobian(rows, s.u)) @ ca.fabs(u)
        return self._function(
            "followed", [ca.vertcat(rows, terms, rounded(rows) + slopes @ ca.DM(self.much))], ["rows_and_terms"]
        )

    @functools.cached_property
    def guard_functions(self) -> dict[tuple[Expression, ...], ca.Function]:
        """Functions (t, x, u, p) -> values of the expressions of events, as far as they have been asked for."""
        return {}

    def value_and_slopes(self, wanted: Expression | ca.SX) -> ca.Function:
        """(t, x, u, p) -> an expression as a column, and its derivatives by (x, u, p); that of a declared symbol is made once."""
        known = self._with_slopes.get(wanted) if isinstance(wanted, Symbol) else None
        if known is None:
            _, x, u, p = self.space.arguments
            y = ca.vec(ca.densify(self.space.put(self.outputs.resolve(wanted))))
            slopes = ca.densify(ca.jacobian(y, ca.vertcat(x, u, p)))
            known = folded_function("output", self.space.arguments, [y, slopes])
        if isinstance(wanted, Symbol):
            self._with_slopes[wanted] = known
        return known

    @functools.cached_property
    def _with_slopes(self) -> dict[Symbol, ca.Function]:
        return {}

    def reading(self, wanted: Expression | ca.SX) -> Reading:
        """How an expression is read of a motion; made once for expressions that are written alike. Raises `UnknownVariableError`."""
        if isinstance(wanted, Symbol):
            key: Any = wanted
        elif isinstance(wanted, Expression):
            key = wanted.sx.shape, wanted.leaves
        else:
            return self._reading(wanted)
        for expression, found in self._readings.get(key, ()):
            if expression is wanted or ca.is_equal(ca.vec(expression.sx), ca.vec(wanted.sx), _DEPTH):
                return found
        if sum(map(len, self._readings.values())) >= _KEPT:
            self._readings.clear()
        found = self._reading(wanted)
        self._readings.setdefault(key, []).append((wanted, found))
        return found

    def _reading(self, wanted: Expression | ca.SX) -> Reading:
        shared = self.outputs.shared(wanted)
        given, _ = self.outputs.given_by_dynamics
        borne = self.outputs.borne
        column = ca.vec(ca.densify(self.space.put(shared)))
        of_loops = borne.numel() > 0 and ca.depends_on(column, borne)
        of_dynamics = of_loops or ca.depends_on(column, given)
        of_forces = of_loops or (of_dynamics and ca.depends_on(column, given[self.outputs.system.x_dot.numel() :]))
        t, x, u, p = self.space.arguments
        inputs = ca.vertcat(u, *(given,) * of_dynamics, *(borne,) * of_loops)
        angle = isinstance(wanted, Expression) and self.outputs.is_angle(wanted)
        series = Series(ca.Function("series", [t, x, inputs, p], [column]))
        return Reading(series, shared.shape, of_dynamics, of_loops, of_forces, angle)

    @functools.cached_property
    def _readings(self) -> dict[Any, list[tuple[Expression, Reading]]]:
        return {}

    @functools.cached_property
    def given_by_dynamics(self) -> Function:
        """(t, x, u, p) -> rates of all states of the reduced system, multipliers, reactions that hold as long as they can, and what scalar parts have of these."""
        reactions, _ = self.outputs.by_modes

        def given(outputs: Outputs) -> ca.SX:
            return ca.vertcat(outputs.system.x_dot, outputs.system.multipliers, reactions, outputs.yielding)

        return self._staged("given_by_dynamics", given, fold=False)

    @functools.cached_property
    def given_by_loops(self) -> ca.Function:
        """(t, x, (u, what the dynamics give), p) -> what redundant loops bear."""
        t, x, u, p = self.space.arguments
        found = self.space.put(self.outputs.given_by_loops)
        return folded_function("given_by_loops", [t, x, ca.vertcat(u, self.outputs.given_by_dynamics[0]), p], [found])

    def series(self, function: Function) -> Series:
        """One of these functions (t, x, u, p), at many points at once."""
        if function not in self._series:
            self._series[function] = Series(function)
        return self._series[function]

    @functools.cached_property
    def _series(self) -> dict[Function, Series]:
        return {}

    def output(self, *expressions: Expression | ca.SX, name: str = "output") -> ca.Function:
        """(t, x, u, p) -> the values of any expressions of the scene's variables. Raises `UnknownVariableError`."""
        return self._function(name, [self.outputs.resolve(e) for e in expressions], [f"y{i}" for i in range(len(expressions))])

    def frame_kinematics(self, connector: Point | str) -> ca.Function:
        """(t, x, u, p) -> position (3), velocity (3), and for a frame rotation (3, 3) and angular velocity (3), all in the world frame.

        `connector`: itself or its path, "rod.tip". Raises `UnknownVariableError`.
        """
        if isinstance(connector, str):
            flat, path = self.outputs.system.flat, connector
            found = flat.connector(path)
            if not isinstance(found, Point):
                places = [own for c, own in flat.connector_paths.items() if isinstance(c, Point)]
                raise UnknownVariableError(
                    f"There is no frame or point '{path}' in the scene '{flat.name}'.{nearest(path, places)}"
                )
            connector = found
        wanted: list[Expression] = [connector.position, connector.velocity]
        names = ["position", "velocity"]
        if isinstance(connector, Frame):
            wanted += [connector.rotation, connector.angular_velocity]
            names += ["rotation", "angular_velocity"]
        return self._function("frame_kinematics", [self.outputs.resolve(e) for e in wanted], names)

    def _function(self, name: str, results: list[ca.SX], names: list[str], fold: bool = True) -> ca.Function:
        """`fold`: no, for what is looked at a few times, and for what kernels alone are made of."""
        found = [ca.densify(self.space.put(r)) for r in results]
        make = folded_function if fold else ca.Function
        return make(name, self.space.arguments, found, ["t", "x", "u", "p"], names)


def _functions(outputs: Outputs, space: StateSpace, events: tuple[when, ...]) -> Functions:
    return Functions(outputs, space).setting(events)


_NOT_WORK = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_PARAMETER}


def operations(function: Function) -> int:
    """Arithmetic operations of an `SX` function: its instructions less loads, stores and constants; about those of systems that are solved in numbers."""
    core, shapes = systems_of(function)
    return sum(row[0] not in _NOT_WORK for row in instructions(core)[0]) + operations_of_systems(shapes)
