"""Forces to be found: inputs of the scene, or forces along joints and coordinates that the scene itself does not have."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from acausal.arguments import listed
from acausal.errors import OptionError
from acausal.language.expression import Expression, Input
from acausal.language.flatten import FlatSystem
from acausal.outputs.expression_names import labels
from acausal.outputs.functions import Functions
from acausal.outputs.outputs import Outputs
from acausal.parts.joint import AbstractJoint
from acausal.reduce.reduce import reduce_system
from acausal.reduce.state_space import whole_state_space
from acausal.wording import entry_names

Unknown = Input | AbstractJoint | Expression


@dataclass(frozen=True, repr=False)
class Actuation:
    """A scene in which all forces to be found are inputs: `places` (in u) of those of each unknown, their `names`. `whole`: as it was before."""

    whole: Functions
    functions: Functions
    places: dict[Unknown, tuple[int, ...]]
    names: tuple[str, ...]

    def __reduce__(self) -> tuple[Any, ...]:
        return actuated, (self.whole, list(self.places))

    def __deepcopy__(self, memo: dict[int, Any]) -> Actuation:
        """Itself, unless the scene is copied along with it."""
        whole = copy.deepcopy(self.whole, memo)
        return self if whole is self.whole else actuated(whole, copy.deepcopy(list(self.places), memo))

    @property
    def entries(self) -> list[int]:
        """Places in u of all forces to be found."""
        return [i for places in self.places.values() for i in places]


def actuated(functions: Functions, unknowns: Sequence[Unknown]) -> Actuation:
    """`unknowns`: inputs; joints, for the forces along all their velocities; expressions of positions, for a force [N, N*m] that does
    the work force * rate.

    The scene is reduced again with the new forces as further inputs, so that loops, gears and circuits see them as they see any other
    force. Raises `OptionError` for anything else.
    """
    whole, outputs = functions, functions.outputs
    flat = outputs.system.flat
    unknowns = [
        named(flat, u) for u in listed(unknowns, "inverse_dynamics: `unknowns`", "unknowns=[scene.shoulder, scene.elbow]")
    ]
    if not unknowns:
        raise OptionError("inverse_dynamics: `unknowns` is empty. Name the inputs or joints whose forces are to be found.")
    added: dict[Unknown, list[tuple[Input, str]]] = {}
    extra = ca.SX.zeros(outputs.system.tree_velocities)
    for unknown in unknowns:
        if isinstance(unknown, Input) and unknown in flat.inputs:
            continue
        rows, names = _rows(outputs, unknown)
        made = [(Input(), name) for name in names]
        added[unknown] = made
        for k, (force, _) in enumerate(made):
            extra += rows[k, :].T * force.sx
    if added:
        new = {force: name for made in added.values() for force, name in made}
        mechanics = outputs.system.mechanics.unsolved or outputs.system.mechanics
        mechanism = replace(mechanics.mechanism, flat=replace(mechanics.flat, names={**mechanics.flat.names, **new}))
        decided = outputs.system.p_values, outputs.system.constraints
        system = reduce_system(replace(mechanics, mechanism=mechanism), extra, *decided)
        functions = Functions(Outputs(system), whole_state_space(system))
    inputs = functions.outputs.system.flat.inputs
    places = {
        u: (inputs.index(u),) if isinstance(u, Input) else tuple(inputs.index(force) for force, _ in added[u]) for u in unknowns
    }
    if sum(map(len, places.values())) > len({i for own in places.values() for i in own}) or len(places) < len(unknowns):
        raise OptionError("inverse_dynamics: something stands twice in `unknowns`.")
    names = tuple(functions.outputs.name(inputs[i]) for own in places.values() for i in own)
    return Actuation(whole, functions, places, names)


def named(flat: FlatSystem, unknown: Any) -> Any:
    """What a name stands for: a joint, an input or a variable."""
    if not isinstance(unknown, str):
        return unknown
    return next((part.component for part in flat.parts if part.path == unknown), None) or flat.named(unknown)


def _rows(outputs: Outputs, unknown: Unknown) -> tuple[ca.SX, list[str]]:
    """Rates that the forces work on, as rows (n, nv) in the tree's velocities, and names of the forces."""
    s = outputs.system
    v = s.x[s.nq : s.nq + s.tree_velocities, :]
    if isinstance(unknown, AbstractJoint):
        rate = outputs.resolve(unknown.v)
        path = next((part.path for part in s.flat.parts if part.component is unknown), "joint")
        names = list(entry_names(f"{path}.force", rate.numel()))
    elif isinstance(unknown, Input) or not isinstance(unknown, Expression):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass names
        known = ", ".join(outputs.name(entry) for entry in s.flat.inputs) or "none"
        raise OptionError(
            f"inverse_dynamics: {unknown!r} in `unknowns` is not an input of '{s.flat.name}' ({known}), a joint or an expression."
        )
    else:
        value = ca.vec(outputs.resolve(unknown))
        names = [f"force on {name}" for name in labels(outputs, unknown)]
        if ca.depends_on(value, ca.vertcat(s.x[s.nq :, :], s.u)):
            raise OptionError(
                f"inverse_dynamics: {names[0]}: it must be a position or an angle, so that the force has a rate to work on."
            )
        rate = outputs.rate(value)
    rows = ca.jacobian(ca.vec(rate), v)
    if not rows.nnz():
        raise OptionError(f"inverse_dynamics: {', '.join(names)} has nothing to work on: it does not move.")
    return rows, names
