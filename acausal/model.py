"""The model: one object that answers everything about a scene, and `build`, which makes it."""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca

from acausal.abstract_model import AbstractModel
from acausal.arguments import listed
from acausal.dynamics.system import mechanical_system
from acausal.errors import LockedError, ModelError, OptionError, OverdeterminedError
from acausal.language.component import System
from acausal.language.expression import Derivative, Expression, Variable, time
from acausal.language.flatten import FlatSystem, flatten
from acausal.numerics.one_thread import on_one_thread
from acausal.outputs.functions import Functions
from acausal.parts.part_check import check_parts
from acausal.reduce.modes import refuse_modes
from acausal.reduce.reduce import ReducedSystem, reduce_system
from acausal.start.anew import AbstractDecided, Decided
from acausal.start.situation import InputValues, ParameterValues, Situation, StartValues, situation
from acausal.topology.build_mechanism import build_mechanism
from acausal.topology.fields import with_field_forces
from acausal.topology.sockets import with_sockets
from acausal.wording import compact, counted

if TYPE_CHECKING:
    from acausal.explain.constraint_table import ConstraintTable
    from acausal.explain.decision_table import DecisionTable
    from acausal.minimal.model import MinimalModel
    from acausal.simulate.simulation import Options
    from acausal.simulate.trajectory import Trajectory
    from acausal.start.branches import Branches


@dataclass(frozen=True, repr=False)
class Model(AbstractModel):
    """A reduced scene with its CasADi functions. Made by `build`; never changes."""

    system: ReducedSystem

    @property
    def functions(self) -> Functions:
        """Named CasADi functions of the states: dynamics, energies, constraints, outputs."""
        return self._decided.functions

    @property
    def _decided(self) -> Decided:
        return self._known

    @functools.cached_property
    def _known(self) -> Decided:
        return Decided(self.system)

    def _situation(
        self,
        start: StartValues | None,
        t0: float | None,
        inputs: InputValues | None,
        parameters: ParameterValues | None,
        clock: str = "start t0",
    ) -> Situation:
        return situation(self.functions.outputs, start, 0.0 if t0 is None else t0, inputs, parameters, clock=clock)

    def _motion(self, here: AbstractDecided, at: Situation, end: float, options: Options) -> Trajectory:
        from acausal.simulate.simulation import simulate

        return simulate(here.functions, at, end, options)

    def branches(
        self,
        start: StartValues | None = None,
        *,
        by: Expression | Sequence[Expression] = (),
        t0: float = 0.0,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
        searches: int = 300,
        seed: int = 0,
    ) -> Branches:
        """All ways found to assemble the scene under the same start values, e.g. elbow up and elbow down, nearest to the sketch first.

        Closed from up to `searches` beginnings: joints anywhere, and known branches with some joints turned round. Two are the same
        when their coordinates are, up to full turns; with `by`, when these expressions of positions are. Where freedom is left, the
        point nearest to the sketch is taken. There is no proof that all are found; printing says how often each was. Errors as for
        `initial_state`, `OptionError`.
        """
        from acausal.start.branch_search import branches

        at = self._situation(start, t0, inputs, parameters)
        return branches(self._decided.at(at.p).functions, at, self._named(by), searches, seed)

    def assembly_function(
        self,
        outputs: Expression | ca.SX | None,
        wrt: Expression | Sequence[Expression],
        start: StartValues | None = None,
        *,
        t0: float = 0.0,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
        steps: int = 8,
        name: str = "assembly",
    ) -> ca.Function:
        """`outputs` (the states x where None) at the consistent start, as a CasADi function of the values of `wrt` (n,).

        `wrt`: parameters, inputs, and variables that have a value in `start`. For geometry in `ca.nlpsol` and `ca.Opti`: derivatives
        are exact in any order, redundant constraints allowed. The branch is that of `initial_state` with these arguments, followed
        to the values asked for in steps as short as it takes, the first a part in `steps` of the way (1: all at once); what start values
        leave free changes as little as it can from there. NaN where something cannot close there or on the way, where a hinge's axes
        would point against one another, or where no step is short enough for angles to change by less than 1 rad. Outputs that forces
        enter are by the equations for these arguments (see `decisions`). Errors as for `initial_state`, `OptionError`.
        """
        from acausal.start.assembly_function import assembly_function

        at = self._situation(start, t0, inputs, parameters)
        single = isinstance(wrt, Expression | str)
        by = self._named([wrt] if single else listed(wrt, "assembly_function: `wrt`", "wrt=[scene.length]"))
        if outputs is None:
            return assembly_function(self._decided.with_loops_at(at.p).functions, at, None, by, steps, name)
        return self._decided.answer(
            at.p, lambda here: assembly_function(here.functions, at, self._named(outputs), by, steps, name)
        )

    def minimal(
        self,
        start: StartValues | None = None,
        *,
        prefer: Sequence[Variable] = (),
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
        t0: float = 0.0,
        steps: int = 8,
    ) -> MinimalModel:
        """The equations of motion in independent coordinates around a start state: the fewest states, no invariants.

        `prefer`: variables that are to be independent where that is well conditioned; never needed. `steps`: at least 4, Newton steps from
        the start to a state of a loop: each reaches about 0.4 rad of its motion farther. Others as for `simulate`. Raises `StartValueError`
        at singular positions, `OptionError` for a preference that is no state.
        """
        from acausal.minimal.model import minimal_model

        refuse_modes(self.system.mechanics.modes, "minimal")
        if self.system.led:
            names = compact((self.system.flat.names[entry] for entry in self.system.led), 4)
            raise OptionError(
                f"minimal: states follow from nonlinear equations in which inputs stand, {names}, and jump with them; minimal coordinates do not yet. "
                "Use the model itself."
            )
        if self.functions.modes is not None:
            raise OptionError(
                f"minimal does not go with what events set yet: {compact(self.functions.modes.all_words, 4) or self.system.flat.name}."
            )
        at = self._situation(start, t0, inputs, parameters)
        return self._decided.answer(at.p, lambda here: minimal_model(here.whole, at, self._named(prefer), steps))

    def graph(self) -> Any:
        """The mechanism as a networkx multigraph: nodes are rigid groups, edges joints, cut joints and forces."""
        return self.system.mechanics.mechanism.graph

    def draw_graph(self, path: str | Path | None = None) -> Any:
        """A picture of `graph()`; returns the matplotlib figure, and writes it to `path` if given."""
        from acausal.visual.graph import draw_graph

        return draw_graph(self.graph(), path)

    def report(self) -> str:
        """In words: freedoms by component, states, operations, what was merged, cut and dropped, and why."""
        from acausal.explain.report import report

        return report(str(self), self.functions)

    def constraints(self) -> ConstraintTable:
        """Every constraint: what it forbids, holonomic or not, kept or dropped; and what velocity constraints keep constant."""
        from acausal.explain.constraint_table import constraint_table

        return constraint_table(self.system)

    @functools.cached_property
    def decisions(self) -> DecisionTable:
        """What was decided by numbers, at which values and by which margin: rows of loops that follow from others, singular positions, branches,
        coordinates in closed form, coefficients that were divided by. Every call looks at its own parameters, start and time again; it is
        refused, or answered by a model decided anew, where one does not hold.
        """
        from acausal.explain.decision_table import decision_table

        return decision_table(self.functions)

    def equations(self) -> Any:
        """The equations of motion as sympy equations, for small scenes; see `acausal.export.sympy_equations`."""
        from acausal.export.sympy_equations import equations

        return equations(self.functions)

    def __reduce__(self) -> tuple[Any, ...]:
        return Model, (self.system,)

    def __deepcopy__(self, memo: dict[int, Any]) -> Model:
        """Itself, since it never changes; that of the copied scene where the scene is copied along with it, and before it."""
        system = copy.deepcopy(self.system, memo)
        return self if system is self.system else Model(system)

    def __repr__(self) -> str:
        return f"<Model {self}>"

    def __str__(self) -> str:
        s = self.system
        m = s.constraints.jacobian.shape[0]
        constraints = counted(m, "constraint") if m else "no constraints"
        dropped = len(s.constraints.redundant) + len(s.constraints.vanishing)
        if s.constraints.damped:  # these are used, too: alone, the others allow more branches
            constraints += f", {len(s.constraints.redundant)} of them redundant when assembled"
            dropped = len(s.constraints.vanishing)
        constraints += f" ({counted(dropped, 'redundant row')} dropped)" if dropped else ""
        changing = len({row.part.path for row in s.mechanics.modes})
        modes = f", {counted(changing, 'part')} with modes" if changing else ""
        return (
            f"{s.flat.name}: {counted(self.degrees_of_freedom, 'degree')} of freedom, {counted(len(self.state_names), 'state')}, {constraints}, "
            f"{self.operations} operations, {counted(s.u.numel() - len(s.flat.modes), 'input')}, {counted(s.p.numel(), 'parameter')}{modes}"
        )


def _what_holds(system: ReducedSystem) -> str:
    """Why a scene of scalar parts alone has no states."""
    held = [system.flat.names[s.of] for s in system.solved if isinstance(s, Derivative) and s.of in system.flat.names]
    if not held:
        return "Without inertia and mass everything is where its springs balance: add an Inertia, a SlidingMass, or a motion that is given."
    return (
        f"Equations leave no freedom to {compact(held, 4)}: two gears of different ratios between the same shafts, or a shaft that is held. Remove one of them, "
        "or put a spring between."
    )


_TURNED = 30
"""Ways of turning laws round that are tried, at most."""


def _reduced(flat: FlatSystem, tried: set[tuple[str, ...]] | None = None) -> ReducedSystem:
    """With laws turned round where something else decides their flow, see `OneWay`."""
    tried = set() if tried is None else tried
    try:
        return reduce_system(mechanical_system(build_mechanism(flat), time.sx))
    except ModelError as error:
        asked = error.reactions or (flat.reactions if isinstance(error, OverdeterminedError) else ())
        for turned in filter(None, map(flat.with_turned, asked)):
            these = tuple(sorted(part.path for part in turned.parts if part.turned))
            if these in tried or len(tried) > _TURNED:
                continue
            tried.add(these)
            try:
                return _reduced(turned, tried)
            except ModelError:
                continue
        raise


@on_one_thread
def build(scene: System) -> Model:
    """From a scene to its model: flatten, topology, mechanics, reduce. Errors from the tree in `acausal.errors`."""
    if not isinstance(scene, System):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
        what = (
            f"the class {scene.__name__}, not one of it: write build({scene.__name__}())"
            if isinstance(scene, type)
            else repr(scene)
        )
        raise ModelError(
            f"build() takes a System of parts, e.g. scene = ac.System(); scene.world = World(); it was given {what}."
        )
    flat = flatten(scene)
    if not flat.parts:
        raise ModelError(
            f"The scene '{flat.name}' has no parts. Assign some: scene.world = World(), scene.rod = RigidBody.rod(...)."
        )
    flat = with_sockets(with_field_forces(flat))
    check_parts(flat)
    model = Model(_reduced(flat))
    if model.system.x.numel() == 0 and not model.system.moves_as_given:
        hint = _what_holds(model.system) if model.system.solved else "Add a joint or a free body."
        raise LockedError(f"Nothing in the scene '{flat.name}' can move: {', '.join(p.path for p in flat.parts[:8])}. {hint}")
    return model
