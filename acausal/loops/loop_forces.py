"""Forces that keep loops closed, and the way back to closed loops; with rows that depend on one another too.

Everywhere: rows of a linkage such as Bennett's depend on one another where its loop is closed, but not beside it, where a step's stages
are. Rates are taken at the nearest point with closed loops; there damping along the eigenvectors of A M^-1 A' with eigenvalue zero
changes nothing.

At a singular position: branches of the motion cross, like the lines of x y = 0, whose gradient (y, x) vanishes there. A motion along y = 0
stays on its branch, the one that its momentum selects. On the branch the acceleration has no singularity. Beside it it is wrong by about
2 y (x'/x)^2, and no step across x = 0 would converge; at the nearest point with closed loops it is smooth where y < x. That point is
found to rounding errors of 1e-16 / x, and accelerations to 1e-16 / x^3, across the branch; `clearance`, about x^2, tells the integrators
where this matters, and what they do there is in acausal/integrators/passage.py. Nearer than 3e-5 the forces fade out. How far a motion goes in the time
in which its rates change is another matter than this distance: with several loops, or bars that turn fast there, rates are continued from
nearer places, and are found in twice as many digits (below) where the tolerance leaves no other way.

Where a motion misses such a position by d, as with lengths that nearly fit (x y = d^2), it turns onto the other branch within d, and nothing can be
continued. There rates are found as they are, in twice as many digits (`LoopForces.exact`, acausal/runtime/twofold.h): what is lost is d^-3 of
1e-32, and 1e-16 / d by the rounding of states themselves. Positions are brought to closed loops within these digits first. A step whose polynomial
comes much nearer to a singular position than its stages is refused, unless it leads straight through: the stages would be on two branches.

Damping is Bayo's penalty, and refinement his augmented Lagrangian (Bayo and Ledesma, Nonlinear Dynamics 9, 1996; Gonzalez and
Kovecses, Multibody System Dynamics 29, 2013). It is in each row's own unit. Refinement of accelerations takes out what rounding of the
matrix has done, by the ratio of masses times as much.
"""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from acausal.dynamics.formulas import damped_solver, pivots, positive_solver, solve_positive
from acausal.dynamics.forward_dynamics import ArticulatedInertias, articulated_inertias, mass_solve, massless
from acausal.dynamics.system import MechanicalSystem
from acausal.dynamics.virtual_inertia import LoopMotions, check_tree_inertia, virtual_rotors
from acausal.loops.constraints import Constraints
from acausal.numerics.bound import Columns
from acausal.numerics.sizes import power_of_four

_DAMPING, _EXACT_DAMPING = 1e-9, 1e-24
_FITTING = 1e-8
"""Part of its size by which a row that depends on others may miss these where loops are closed, at which it is damped as it is beside: what is
missed acts on the motion by its square over the damping."""
_SEEN = 1e-15
_FAINT = 1e-2
"""Margin by which rows are independent wherever loops are closed that leaves rates too few digits everywhere."""
_CORRECTIONS = 2
_NEWTON_STEPS = 3
_MASSLESS = 1e-9
_ROUNDING = 1e-12
_APART = 1e-5
"""Of rows that depend on one another where they are assembled: eigenvalues in their own units that are told apart when several are small at once."""


@dataclass(frozen=True, repr=False)
class LoopForces:
    """What forces along the constraint rows do: `flexibility` M^-1 A' (nv, m) and `delassus` A M^-1 A' (m, m).

    `sizes` (m,): of the diagonal of `delassus`, a row's own unit; of its pivots `pivot_sizes`, of what
    is small at singular positions `least_size`, and of the product of all `product_size`.
    `rotors`: on links whose motion meets no inertia in the tree; M, whose factors are `inertias`, includes them (see `virtual_inertia`).
    """

    mechanics: MechanicalSystem
    constraints: Constraints
    flexibility: ca.SX
    delassus: ca.SX
    sizes: np.ndarray
    pivot_sizes: np.ndarray
    rotors: Mapping[int, float]
    inertias: ArticulatedInertias
    product_size: float = 1.0
    least_size: float = 1.0
    light: np.ndarray = field(default_factory=lambda: np.ones(1))
    """How light links were where the sizes were taken."""
    damping: float = _DAMPING

    def exact(self) -> LoopForces:
        """The same for arithmetic with twice as many digits."""
        return dataclasses.replace(self, damping=_EXACT_DAMPING)

    def closed(self, free: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Accelerations (nv, 1) with closed loops, and multipliers of the rows (m, 1), for accelerations `free` (nv, 1) without them:
        (A M^-1 A') lambda = -bias - A v'_free, and rotors taken away.
        """
        c = self.constraints
        if not c.jacobian.shape[0]:
            return free, ca.SX(0, 1)
        free, multipliers = self._held(free, c.bias)
        mu = self._rotor_forces(free)
        if mu is None:
            return free, multipliers
        W, held = self._rotor_response
        return free + W @ mu, multipliers + held @ mu

    def _rotor_forces(self, moved: ca.SX) -> ca.SX | None:
        """What has to be added to the forces on the joints with rotors (k, 1) where these are to be taken away; they are `moved` (nv, 1)."""
        return solve_positive(self._rotor_inertia, moved[self._rotor_places]) if self.rotors else None

    def _without_rotors(self, moved: ca.SX) -> ca.SX:
        """A change (nv, 1) that closes loops, in the mass metric, from the same with rotors."""
        mu = self._rotor_forces(moved)
        return moved if mu is None else moved + self._rotor_response[0] @ mu

    def _held(self, free: ca.SX, bias: ca.SX | None = None) -> tuple[ca.SX, ca.SX]:
        """Accelerations (nv, k) with closed loops, rotors included, and multipliers (m, k), for those without loops."""
        c = self.constraints
        multipliers = ca.SX.zeros(c.jacobian.shape[0], free.shape[1])
        for _ in range(2 if c.dependent else 1):  # what rounding of the matrix has left is divided by a small eigenvalue
            open_ = c.jacobian @ free
            change = self._solver(-open_ if bias is None else -bias - open_)
            multipliers, free = multipliers + change, free + self.flexibility @ change
        return free, multipliers

    def check_inertia(self, parameters: ca.SX, values: np.ndarray) -> None:
        """Raise `MasslessError` where a motion meets no inertia in spite of closed loops."""
        if not self.rotors:
            return
        tree = self.mechanics.tree
        function = ca.Function("left", [tree.q, tree.t, parameters], [self._rotor_inertia])
        link_of = [i for i in self.rotors for _ in range(tree.links[i].motion.nv)]
        size = np.sqrt([self.rotors[i] for i in link_of])
        least: list[tuple[float, int]] = []
        for q in self.constraints.samples:
            levels, axes = np.linalg.eigh(np.array(function(q, self.constraints.time, values)) * np.outer(size, size))
            k = int(np.argmin(np.abs(levels)))
            least.append((float(np.abs(levels[k])), link_of[int(np.argmax(np.abs(axes[:, k])))]))
        # a singular position lets go of more than the loops do elsewhere
        level, link = max(least) if self.constraints.singular else min(least)
        if level < _MASSLESS:
            raise massless(tree.links[link])

    @functools.cached_property
    def _solver(self) -> Callable[[ca.SX], ca.SX]:
        """(m, k) -> multipliers (m, k) that make these changes of the rows' rates."""
        # where loops are closed, rows that depend on one another everywhere do so to rounding
        damping = 1.0 if self.constraints.singular else min(self.constraints.follows / _FITTING, 1.0)
        return self._solver_of(list(range(self.delassus.shape[0])), damping)

    def _solver_of(self, rows: list[int], damping: float, refinements: int = 1) -> Callable[[ca.SX], ca.SX]:
        """The same for some rows."""
        D = self.delassus[rows, rows]
        if not self.constraints.dependent:
            return positive_solver(D)
        return damped_solver(D, damping * self._damping[rows], refinements)

    @functools.cached_property
    def clearance(self) -> ca.SX:
        """(2, 1): 0 at a singular position, about the square of the distance from it near by, of the size of 1 elsewhere; and a product of these
        where motions come close to several at once. Without unit.

        Beside light bodies a pivot is small too where another row has the large one of their directions: the product of all is not.
        """
        least, product = self._least / self.least_size, self._product / self.product_size
        return ca.vertcat(ca.fmax(ca.fmin(least, 1.0), product), product)

    @property
    def _least(self) -> ca.SX:
        """What is small where one row less is independent.

        Which rows follow from the others where they are assembled is another at any place, and so are the pivots that are small for this: there
        it is the harmonic sum of all eigenvalues but those that are nothing.
        """
        if not self.constraints.damped:
            return functools.reduce(ca.fmin, ca.vertsplit(self._pivots))
        return _APART * self._product / (self._determinant(_APART) - self._product)

    @functools.cached_property
    def _product(self) -> ca.SX:
        """Of the pivots, or of all eigenvalues but those that are nothing."""
        if not self.constraints.damped:
            return functools.reduce(operator.mul, ca.vertsplit(self._pivots))
        return self._determinant(self.damping)

    def _determinant(self, damping: float) -> ca.SX:
        """Of `delassus` in the rows' own units, with a little on its diagonal: product of all its eigenvalues, of which those that are nothing have become
        this little, and are left out.
        """
        of_all = self._level * ca.SX(self.sizes)
        found = pivots(self.delassus + ca.diag(damping * of_all)) / of_all
        redundant = 1 - self.constraints.rank.rank / found.numel()
        return functools.reduce(operator.mul, ca.vertsplit(found / damping**redundant))

    @functools.cached_property
    def _pivots(self) -> ca.SX:
        """Of `delassus` (m, 1), as part of their sizes and at most 1."""
        return ca.fmin(self._own_pivots / self.pivot_sizes / self._level, 1.0)

    @property
    def _own_pivots(self) -> ca.SX:
        """As far as rounding lets them be seen where rates are exact; else damped as they are solved."""
        if not self.constraints.narrow:
            return pivots(self.delassus + ca.diag(self._damping))
        return pivots(self.delassus + ca.diag(_SEEN * self._level * ca.SX(self.sizes)))

    @property
    def _rotor_places(self) -> list[int]:
        """In v."""
        links = self.mechanics.tree.links
        return [k for i in self.rotors for k in range(links[i].v.start, links[i].v.stop)]

    @functools.cached_property
    def _rotor_response(self) -> tuple[ca.SX, ca.SX]:
        """Accelerations (nv, k) by unit forces of the k rotors with closed loops, and how the multipliers (m, k) then change."""
        n = self.mechanics.tree.v.numel()
        return self._held(ca.horzcat(*(mass_solve(self.inertias, ca.SX.eye(n)[:, k]) for k in self._rotor_places)))

    @functools.cached_property
    def _rotor_inertia(self) -> ca.SX:
        """1 / d less the rotors' response (k, k): positive where the constrained motion meets inertia."""
        links = self.mechanics.tree.links
        lightness = ca.diag(ca.SX(ca.DM([1 / d for i, d in self.rotors.items() for _ in range(links[i].motion.nv)])))
        return ca.densify(lightness - self._rotor_response[0][self._rotor_places, :])

    def position_correction(self, gap: ca.SX) -> ca.SX:
        """Change of q (nq, 1) that closes position residuals `gap`, to first order and in the mass metric."""
        tree, slips = self.mechanics.tree, set(self.constraints.slips)
        rows = [k for k in range(self.delassus.shape[0]) if k not in slips]
        if not rows:
            return ca.SX.zeros(tree.q.numel())
        moved = self._without_rotors(self.flexibility[:, rows] @ self._corrected(gap, rows))
        return -(ca.jacobian(tree.rates, tree.v) @ moved)

    def velocity_correction(self) -> ca.SX:
        """Change of v (nv, 1) that closes the velocity residuals, in the mass metric."""
        c = self.constraints
        if not c.jacobian.shape[0]:
            return ca.SX.zeros(self.mechanics.tree.v.numel())
        return -self._without_rotors(self.flexibility @ self._corrected(c.velocity, list(range(c.velocity.numel()))))

    def _corrected(self, gap: ca.SX, rows: list[int]) -> ca.SX:
        """Multipliers of some rows that close `gap`."""
        if len(rows) == self.delassus.shape[0] and not self.constraints.dependent:
            return self._solver(gap)
        return self._solver_of(rows, 1.0, 0 if self.constraints.singular else 1)(gap)

    @property
    def _damping(self) -> ca.SX:
        """(m, 1), each in its row's own unit: no entry vanishes where a row does."""
        return self.damping * self._level * ca.SX(self.sizes)

    @functools.cached_property
    def _level(self) -> ca.SX:
        """How light the links are that loops move, beside how light they were when `sizes` were taken; no position changes that much."""
        lightness = _lightness(self.inertias, self.constraints)
        return ca.sum1(lightness / self.light) / lightness.numel()


def _lightness(inertias: ArticulatedInertias, constraints: Constraints) -> ca.SX:
    """(n, 1) of the links that loops move: unit forces on their joints, times the accelerations by them."""
    moved = {i for k, i in inertias.owners.items() if constraints.jacobian[:, k].nnz()}
    return ca.vertcat(*(ca.trace(inertias.D_inverse[i]) for i in sorted(moved)))


def loop_forces(mechanics: MechanicalSystem, constraints: Constraints, parameters: ca.SX, values: np.ndarray) -> LoopForces:
    """For the `parameters` of a model, near these `values`. Cost: for each row, a walk over the links that it moves."""
    A, tree = ca.sparsify(constraints.jacobian), mechanics.tree
    m = A.shape[0]
    if m == 0:
        check_tree_inertia(tree, parameters, constraints.q_start, values)
        none = ca.SX(tree.v.numel(), 0)
        return LoopForces(mechanics, constraints, none, ca.SX(0, 0), np.zeros(0), np.zeros(0), {}, articulated_inertias(tree))
    samples = constraints.samples[:: max(1, len(constraints.samples) // 2)]
    rows = ca.Function("rows", [tree.q, tree.t, parameters], [ca.densify(A)])
    loops = LoopMotions(
        tuple(np.array(rows(q, constraints.time, values)) for q in samples), constraints.rates, constraints.singular
    )
    rotors = virtual_rotors(tree, parameters, samples, loops, values)
    inertias = articulated_inertias(tree, rotors)
    flexibility = ca.horzcat(*(mass_solve(inertias, A[i, :].T) for i in range(m)))
    delassus = ca.tril2symm(ca.tril(A @ flexibility))
    forces = LoopForces(mechanics, constraints, flexibility, delassus, np.ones(m), np.ones(m), rotors, inertias)
    if constraints.dependent or constraints.narrow:
        sizes, light = (
            _sizes(forces, column, parameters, values) for column in (ca.diag(delassus), _lightness(inertias, constraints))
        )
        forces = dataclasses.replace(forces, sizes=sizes, light=light)
    if constraints.damped and constraints.singular:
        columns = ca.vertcat(forces._least, forces._product)  # pyright: ignore[reportPrivateUsage]
        least_size, product_size = power_of_four(_largest(forces, columns, constraints.samples, parameters, values))
        forces = dataclasses.replace(forces, least_size=float(least_size), product_size=float(product_size))
    elif constraints.singular or constraints.narrow:
        usual = forces._own_pivots  # pyright: ignore[reportPrivateUsage]
        usually = _sizes(forces, usual, parameters, values)
        faint = (usually < _FAINT**2 * forces.sizes) & any(part.usual.independent < _FAINT for part in constraints.examined)
        forces = dataclasses.replace(forces, pivot_sizes=np.where(faint, forces.sizes, usually))
        product = forces._product  # pyright: ignore[reportPrivateUsage]
        size = float(_sizes(forces, product, parameters, values)[0]) / float(np.prod((usually / forces.sizes)[faint]))
        forces = dataclasses.replace(forces, product_size=size)
    forces.check_inertia(parameters, values)
    return forces


def _sizes(forces: LoopForces, column: ca.SX, parameters: ca.SX, values: np.ndarray) -> np.ndarray:
    """The largest values (m,) of a positive `column` in q where loops are closed; where they are open, if there is only rounding.

    Rounded to powers of four.
    """
    constraints = forces.constraints
    closed, beside = (
        _largest(forces, column, places, parameters, values) for places in (constraints.samples, constraints.opened)
    )
    return power_of_four(np.where(closed > _ROUNDING * beside, closed, beside))


def _largest(
    forces: LoopForces, column: ca.SX, places: Sequence[np.ndarray], parameters: ca.SX, values: np.ndarray
) -> np.ndarray:
    """The largest values (m,) of a `column` in q at these configurations (nq,)."""
    tree = forces.mechanics.tree
    sizes = Columns(ca.Function("sizes", [tree.q, tree.t, parameters], [column]))
    return np.max([sizes(q, forces.constraints.time, values) for q in places], axis=0)


def projection(forces: LoopForces, states: ca.SX) -> ca.SX | None:
    """(q, v, states) one Newton step nearer to the invariants, in the mass metric; None without invariants."""
    tree, constraints = forces.mechanics.tree, forces.constraints
    if constraints.joint_invariants.numel() == 0 and constraints.jacobian.shape[0] == 0:
        return None
    q, v = tree.q, tree.v
    dq = ca.SX.zeros(q.numel())
    for joint in tree.joints:
        own = joint.edge.joint.invariants(q[joint.q], tree.t)
        if own.numel():
            G = ca.jacobian(own, q[joint.q])
            dq[joint.q] -= G.T @ solve_positive(ca.densify(G @ G.T), own)
    return ca.vertcat(
        q + dq + forces.position_correction(constraints.position),
        v + forces.velocity_correction(),
        states,
    )


def on_branch(rates: ca.SX, forces: LoopForces, arguments: list[ca.SX], exact: bool = False) -> ca.SX:
    """`rates`, which depend on `arguments` (t, q, v, states, u, p), at the nearest q and v with closed loops.

    Positions first, all corrections with the matrix of the first one, then velocities. `exact`: each with a matrix of its own, as often as
    twice as many digits need.
    """
    t, q, v, states, u, p = arguments
    position = ca.Function("position", [t, q, p], [ca.densify(forces.constraints.position)])
    gap = ca.SX.sym("gap", forces.constraints.position.numel())
    correction = ca.Function("correction", [t, q, p, gap], [ca.densify(forces.position_correction(gap))])
    velocity = ca.Function("velocity", [t, q, v, p], [ca.densify(v + forces.velocity_correction())])
    q_on = q
    for _ in range(_NEWTON_STEPS if exact else _CORRECTIONS):
        q_on = q_on + correction(t, q_on if exact else q, p, position(t, q_on, p))
    v_on = velocity(t, q_on, v, p)
    return ca.Function("rates", arguments, [ca.densify(rates)])(t, q_on, v_on, states, u, p)
