"""What is integrated, as the functions and numbers that the runtime needs, whether they go into memory of this process or into C that stands by itself."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.collocation.modes import ModeFunctions
from acausal.collocation.problem import Exact
from acausal.numerics.bound import copied_states
from acausal.numerics.staged import Function, Staged, Systems, called, composed, operations_of, symbols_of, systems_of
from acausal.numerics.switching import Switching
from acausal.runtime.kernels import Wanted
from acausal.runtime.pattern import Pattern, jacobian_pattern


@dataclass(frozen=True, eq=False)
class Integrand:
    """x' = function(t, x, u, p), and what `Problem` has besides; `switching`: of `function`, whose switches then end steps.

    With switches the runtime has one more input for each, its side: that is meant by `nu`, and by functions of held inputs. `modes`: masks are the last
    inputs of `function`, and held, too.
    """

    function: Function
    invariants: ca.Function | None = None
    project: ca.Function | None = None
    clearance: ca.Function | None = None
    unheld_exact: Exact | None = None
    positions: int = 0
    switching: Switching | None = None
    modes: ModeFunctions | None = None
    standing: np.ndarray | None = None
    """(nx,): what `Exact` says is usual, below 0 for states that loops do not hold for good; None where they hold none."""

    followers: tuple[int, ...] = ()
    """Numbers of the states that nonlinear equations give by the others."""

    @property
    def rates(self) -> Function:
        """(t, x, u, p) -> x', switches held."""
        return self.function if self.switching is None else self.switching.rates

    @property
    def held(self) -> int:
        """Number of masks and switches."""
        return self.masks + self.sides

    @property
    def masks(self) -> int:
        """Number of masks."""
        return 0 if self.modes is None else self.modes.masks

    @property
    def sides(self) -> int:
        """Number of switches."""
        return 0 if self.switching is None else len(self.switching.looked_at)

    @property
    def mode_rows(self) -> int:
        """Guards of masks, which come before those of switches."""
        return 0 if self.modes is None else sum(guards.size1_out(0) for guards in self.modes.rows)

    @functools.cached_property
    def row_switch(self) -> np.ndarray:
        """Of which held input each row is; of what is set, numbers behind those."""
        found = [] if self.switching is None else [self.masks + self.switching.switch]
        if self.modes is not None:
            m = self.modes
            first = m.one_sided + 2 * m.lines
            parts = [
                np.arange(m.one_sided),
                m.one_sided + 2 * np.arange(m.lines).repeat(2),
                first + 6 * np.arange(m.planes).repeat(2),
                first + 6 * m.planes + 8 * np.arange(m.patches).repeat(2),
                first + 6 * m.planes + 8 * m.patches + 3 * np.arange(m.magnitudes).repeat(2),
                self.held + np.arange(m.set_count),
            ]
            found.insert(0, np.concatenate(parts))
        return np.concatenate([np.zeros(0), *found]).astype(int)

    @property
    def row_steps(self) -> tuple[np.ndarray, np.ndarray]:
        """What a switch goes over to where a row becomes negative: factor and summand; of masks it is decided otherwise."""
        none = np.zeros(self.mode_rows)
        own = (np.zeros(0), np.zeros(0)) if self.switching is None else (self.switching.factor, self.switching.plus)
        return np.concatenate([none, own[0]]), np.concatenate([none, own[1]])

    @property
    def projects(self) -> bool:
        """Whether there are invariants that states are brought back to."""
        return self.invariants_and_projection is not None

    @property
    def invariants_and_projection(self) -> tuple[Function, Function] | None:
        """Functions of t, x, u and p."""
        if self.modes is not None:
            return self.modes.invariants, self.modes.projection
        return None if self.invariants is None or self.project is None else (self.invariants, self.project)

    @functools.cached_property
    def led(self) -> bool:
        """Whether inputs other than masks stand in the invariants, or in what corrects them."""
        if self.invariants_and_projection is None:
            return False
        symbols = symbols_of(self.invariants_and_projection[0])
        return any(ca.depends_on(called(f, symbols)[0][0], self._own(symbols)) for f in self.invariants_and_projection)

    @functools.cached_property
    def led_places(self) -> bool:
        """Whether they stand in invariants of positions: what inputs prescribe of places."""
        if self.invariants_and_projection is None:
            return False
        symbols = symbols_of(self.invariants_and_projection[0])
        rows, others = called(self.invariants_and_projection[0], symbols)[0][0], symbols[1][self.positions :]
        return any(
            ca.depends_on(row, self._own(symbols)) and not ca.depends_on(row, others) for row in ca.vertsplit(ca.densify(rows))
        )

    def _own(self, symbols: Sequence[ca.SX]) -> ca.SX:
        """Inputs other than masks."""
        return symbols[2][: symbols[2].numel() - self.masks]

    @functools.cached_property
    def copies(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """x'[first] = x[second]."""
        pairs = copied_states(systems_of(self.rates)[0])
        return tuple(i for i, _ in pairs), tuple(j for _, j in pairs)

    @functools.cached_property
    def numbers(self) -> dict[str, int]:
        """Those of `Integrator` in runtime.h that belong to the functions."""
        nx, nu, np = (self.rates.size1_in(i) for i in (1, 2, 3))
        return {
            "nx": nx, "nu": nu, "np": np,
            "ng": self.invariants_and_projection[0].size1_out(0) if self.invariants_and_projection is not None else 0,
            "led": 2 if self.led and self.led_places else int(self.led), "followers": len(self.followers), "copies": len(self.copies[0]), "positions": self.positions,
            "operations": operations_of(self.function),
            "promised": int(self.unheld_exact is not None),
            "through": 0 if self.unheld_exact is None else self.unheld_exact.through.value,
            "held": self.held, "row_count": self.row_switch.size, "masks": self.masks, "mode_rows": self.mode_rows,
            **{name: 0 if self.modes is None else int(getattr(self.modes, name)) for name in ("one_sided", "lines", "planes", "patches", "magnitudes", "redundant", "valves", "discretes", "set_count")},
        }  # fmt: skip

    @functools.cached_property
    def wanted(self) -> tuple[Wanted, ...]:
        """Kernels that every integration has."""
        found = [Wanted("rhs", self.rates, (3,))]
        if self.invariants_and_projection is not None:
            together = _projection_with_invariants(*self.invariants_and_projection)
            found.append(Wanted("projection", together, (3,)))
        if self.clearance is not None:
            found.append(Wanted("clearance", self.clearance, (2,)))
        if self.row_switch.size:
            found.append(Wanted("rows", self.rows, (3,)))
        if self.switching is not None:
            found.append(Wanted("sides", self.switching.sides, (3,)))
        if self.modes is not None and self.modes.laws:
            found.append(Wanted("decision", self.decision, (3,)))
        if self.modes is not None and self.modes.set is not None:
            found.append(Wanted("set", self.with_sides(self.modes.set.values), (3,)))
        return tuple(found)

    @property
    def correction(self) -> Wanted:
        """(t, x, u, p) -> x after projection, alone."""
        assert self.invariants_and_projection is not None
        return Wanted("correction", self.invariants_and_projection[1], (3,))

    @property
    def lists(self) -> dict[str, tuple[int, ...]]:
        """Of `Integrator` in runtime.h: what follows others at once, and what is set."""
        found = None if self.modes is None else self.modes.set
        own = {"follower": self.followers} if self.followers else {}
        return (
            own
            if found is None
            else {**own, "set_direction": found.directions, "set_first": found.first, "set_target": found.targets}
        )

    @functools.cached_property
    def rows(self) -> Function:
        """(t, x, u, p) -> values that are positive as long as masks, and then sides, are the true ones."""
        if self.modes is None:
            assert self.switching is not None
            return self.switching.rows
        first, *rest = (self.with_sides(function) for function in self.modes.rows)
        parts = [first, *rest] if self.switching is None else [self.switching.others[0], *rest, self.switching.rows]
        return composed("rows", parts, lambda _, results: [ca.vertcat(*(result[0] for result in results))])

    @functools.cached_property
    def decision(self) -> Function:
        """(t, x, u, p) -> what modes are decided by, switches held."""
        assert self.modes is not None
        decided = self.modes.decision if self.switching is None else self.switching.others[1]
        parts = [decided, self.with_sides(self.modes.terms)]
        return composed("decision", parts, lambda _, results: [ca.vertcat(results[0][0], results[1][0])])

    @functools.cached_property
    def jvp(self) -> Wanted:
        """(t, x, u, p, dx) -> df/dx dx."""
        return Wanted("jvp", _directional_derivative(self.rates, (1,)), (3,))

    @functools.cached_property
    def variation(self) -> tuple[Wanted, ...]:
        """(t, x, u, p, dx, du, dp) -> change of x', and of x after projection, there with du only where it matters, and (t, x, u, p, dt, dx, du, dp) -> those of rows of switches, of what modes are decided by, and of what is set."""
        found = [Wanted("variation", _directional_derivative(self.rates, (1, 2, 3)), (3,))]
        if self.invariants_and_projection is not None:
            project = self.invariants_and_projection[1]
            given = (2,) if self.led or self.numbers["discretes"] else ()  # what holds may be held where that says
            found.append(Wanted("projected", _directional_derivative(project, (1, *given, 3)), (3,)))
        if self.row_switch.size:
            found.append(Wanted("row_change", _directional_derivative(self.rows, (0, 1, 2, 3)), (3,)))
        if self.modes is not None and self.modes.laws:
            found.append(Wanted("decision_change", _directional_derivative(self.decision, (0, 1, 2, 3)), (3,)))
        if self.modes is not None and self.modes.set is not None:
            found.append(
                Wanted("set_change", _directional_derivative(self.with_sides(self.modes.set.values), (0, 1, 2, 3)), (3,))
            )
        return tuple(found)

    @functools.cached_property
    def pattern(self) -> Pattern:
        """Of df/dx."""
        return jacobian_pattern(self.rates)

    @functools.cached_property
    def exact_rates(self) -> Wanted | None:
        """Of held inputs, for arithmetic with twice as many digits; None where nothing needs it."""
        exact = self.unheld_exact
        return None if exact is None else Wanted("exact_rhs", self.with_sides(exact.rhs()), (3,))

    @functools.cached_property
    def exact_projection(self) -> Wanted | None:
        """For the same."""
        exact = self.unheld_exact
        return None if exact is None else Wanted("exact_projection", exact.project(), (3,))

    @property
    def exact(self) -> tuple[Wanted, ...]:
        """Both; none where nothing needs them."""
        return tuple(wanted for wanted in (self.exact_rates, self.exact_projection) if wanted is not None)

    @property
    def usual(self) -> np.ndarray | None:
        """See `Exact` and `standing`."""
        return self.standing if self.unheld_exact is None else self.unheld_exact.usual

    def guard(self, function: ca.Function) -> Wanted:
        """Guards (t, x, u, p) -> values."""
        return Wanted("guard", self.with_sides(function), (3,))

    def with_sides(self, function: Function) -> Function:
        """A function (t, x, u, p) as one that is given the sides of switches too."""
        if not self.sides:
            return function
        nx, nu, np = (self.rates.size1_in(i) for i in (1, 2, 3))
        t, x, u, p = (ca.SX.sym(name, n) for name, n in zip("txup", (1, nx, nu, np), strict=True))
        found, systems = called(function, [t, x, u[: nu - self.sides], p])
        return Staged.of(function.name(), [t, x, u, p], [found[0]], systems, fold=False)


def _directional_derivative(function: Function, arguments: tuple[int, ...]) -> Function:
    """(all arguments, directions of those named) -> derivative of the first result in these directions, exact."""
    symbols = symbols_of(function)
    directions = [ca.SX.sym(f"d{i}", function.size1_in(i)) for i in arguments]
    (result, *_), systems = called(function, symbols)
    along, by, change = [symbols[i] for i in arguments], list(directions), Systems()
    for shape, operands, answers in zip(systems.shapes, systems.operands, systems.answers, strict=True):
        active, M, damping, B = shape.parts(operands)
        X = ca.reshape(answers, shape.columns, shape.rows).T
        rest = ca.jtimes(ca.vec(B - M @ X), ca.vertcat(*along), ca.vertcat(*by))  # M dX = dB - dM X
        change = change + Systems((shape,), (operands,), (answers,))
        change, dX = change.with_one(active, M, ca.reshape(rest, shape.rows, shape.columns), damping if shape.damped else None)
        along.append(answers)
        by.append(ca.vec(dX.T))
    product = ca.jtimes(ca.densify(result), ca.vertcat(*along), ca.vertcat(*by))
    return Staged.of("product", [*symbols, *directions], [ca.densify(product)], change, fold=False)


def _projection_with_invariants(invariants: Function, project: Function) -> Function:
    """(t, x, u, p) -> x nearer to the invariants, and the invariants at the given x."""
    return composed("projection", [project, invariants], lambda _, results: [results[0][0], results[1][0]])
