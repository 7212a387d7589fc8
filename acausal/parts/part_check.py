"""Parts are looked at before anything is made of them: constant shapes and masses, and what users write themselves."""

from __future__ import annotations

from acausal.errors import ParameterError
from acausal.language.expression import Parameter, Symbol
from acausal.language.flatten import FlatSystem, Part, leaves_inside
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.own_parts import OwnPart
from acausal.parts.rigid import AbstractRigidPart

_OWN = ("acausal", "components")


def check_parts(flat: FlatSystem) -> None:
    """Raises `ParameterError` for bodies and joints whose dimensions change, and what `OwnPart.check` raises for users' own classes."""
    for part in flat.parts:
        _check_constant(part)
        if type(part.component).__module__.split(".")[0] not in _OWN:
            OwnPart(part, flat).check()


def _check_constant(part: Part) -> None:
    """Rates of lengths, axes and masses are taken to be zero. Gravity may change; what moves as it is told says so by `given_motions`."""
    component = part.component
    own = type(component).__module__.split(".")[0] in _OWN
    if not isinstance(component, AbstractRigidPart) and not (isinstance(component, AbstractConstraint) and own):
        return
    if component.given_motions():
        return
    for name, value in component.__dict__.items():
        if name == "gravity" or (isinstance(value, Symbol) and value in component.variables()):
            continue
        for leaf in leaves_inside(value):
            if not isinstance(leaf, Parameter):
                raise ParameterError(
                    f"{part.where}: {name} depends on the {leaf.kind} {leaf.name}, but masses and dimensions of bodies and joints are constant. Use "
                    "numbers or ac.Parameter; what moves needs a joint, e.g. PrescribedMotion or Prismatic."
                )
