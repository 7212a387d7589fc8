"""Acausal 3-D mechanics: compose a mechanism from parts, get reduced equations, simulations and CasADi functions."""

import importlib
from typing import TYPE_CHECKING, Any

from acausal import errors
from acausal.language.component import Component, System
from acausal.language.connector import Electrical, Frame, Point, Rotational, Signal, Translational
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Discrete, Expression, Input, Magnitude, Parameter, Reaction, Variable, time
from acausal.language.impact_laws import Energetic, Newton, Poisson
from acausal.language.lookup import lookup
from acausal.language.mode_laws import DryFriction, Lock, OneSided, OneWay, Pressure
from acausal.language.pieces import samples, with_knots
from acausal.language.vectors import cross, dot, norm
from acausal.language.when import when
from acausal.model import Model, build
from acausal.moved import answer_to_old_names
from acausal.parts import curvilinear, rotations
from acausal.simulate.events import Event
from acausal.start.initial import exactly, near
from acausal.wording import nearest

if TYPE_CHECKING:
    from acausal.analysis.feedback import kalman, lqr
    from acausal.export.c_source import LoadedModel, load_c
    from acausal.optimal_control.estimation import Recording, estimate
    from acausal.optimal_control.language import at_end, at_start, average, free, integral
    from acausal.optimal_control.phases import Phases, phases
    from acausal.optimal_control.problem import OptimalControl

__all__ = [
    "Component",
    "Discrete",
    "DryFriction",
    "Electrical",
    "Energetic",
    "Equation",
    "Event",
    "Expression",
    "Frame",
    "Input",
    "LoadedModel",
    "Lock",
    "Magnitude",
    "Model",
    "Newton",
    "OneSided",
    "OneWay",
    "OptimalControl",
    "Parameter",
    "Phases",
    "Point",
    "Poisson",
    "Pressure",
    "Reaction",
    "Recording",
    "Rotational",
    "Signal",
    "System",
    "Translational",
    "Variable",
    "at_end",
    "at_start",
    "average",
    "build",
    "cross",
    "curvilinear",
    "der",
    "dot",
    "equal",
    "errors",
    "estimate",
    "exactly",
    "free",
    "integral",
    "kalman",
    "load_c",
    "lookup",
    "lqr",
    "near",
    "norm",
    "phases",
    "rotations",
    "samples",
    "time",
    "when",
    "with_knots",
]  # fmt: skip

_LATER = {
    **dict.fromkeys(("kalman", "lqr"), "acausal.analysis.feedback"),
    **dict.fromkeys(("LoadedModel", "load_c"), "acausal.export.c_source"),
    **dict.fromkeys(("Recording", "estimate"), "acausal.optimal_control.estimation"),
    **dict.fromkeys(("at_end", "at_start", "average", "free", "integral"), "acausal.optimal_control.language"),
    **dict.fromkeys(("Phases", "phases"), "acausal.optimal_control.phases"),
    "OptimalControl": "acausal.optimal_control.problem",
}
"""Where names live that a first result does not need: imported when they are asked for."""


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        import numpy

        hint = f" That of numpy takes expressions: np.{name}(...)." if hasattr(numpy, name) else nearest(name, __all__)
        raise AttributeError(f"module 'acausal' has no attribute '{name}'.{hint}", name=None, obj=None)  # Python adds no hint
    found = globals()[name] = getattr(importlib.import_module(_LATER[name]), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})


answer_to_old_names()
