"""Acausal 3-D mechanics: compose a mechanism from parts, get reduced equations, simulations and CasADi functions."""

from acausal import errors
from acausal.export.c_source import LoadedModel, load_c
from acausal.language.component import Component, System
from acausal.language.connector import Electrical, Frame, Point, Rotational, Signal, Translational
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Expression, Input, Parameter, Variable, time
from acausal.language.pieces import samples, with_knots
from acausal.language.vectors import cross, dot, norm
from acausal.model import Model, build
from acausal.moved import answer_to_old_names
from acausal.optimal_control.estimation import Recording, estimate
from acausal.optimal_control.language import at_end, at_start, average, free, integral
from acausal.optimal_control.problem import OptimalControl
from acausal.parts import curvilinear, rotations
from acausal.simulate.events import Event, when
from acausal.start.initial import exactly, near

__all__ = [
    "Component",
    "Electrical",
    "Equation",
    "Event",
    "Expression",
    "Frame",
    "Input",
    "LoadedModel",
    "Model",
    "OptimalControl",
    "Parameter",
    "Point",
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
    "load_c",
    "near",
    "norm",
    "rotations",
    "samples",
    "time",
    "when",
    "with_knots",
]  # fmt: skip

answer_to_old_names()
