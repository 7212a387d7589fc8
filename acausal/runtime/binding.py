"""The C runtime seen from Python: structures, and one integration at a time."""

from __future__ import annotations

import ctypes
import enum
from dataclasses import dataclass

import numpy as np

from acausal.collocation.tableau import Tableau, eigenvectors
from acausal.runtime.kernels import Kernel
from acausal.runtime.pattern import Pattern

_Double = ctypes.POINTER(ctypes.c_double)
_Long = ctypes.POINTER(ctypes.c_long)
InputFunction = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, _Double)
LackingFunction = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_long)


class Code(enum.IntEnum):
    """`enum Code` of runtime.h."""

    REACHED_END = 0
    PAUSED = 1
    NEEDS_JACOBIAN = 2
    EVENT = 3
    STEP_UNDERFLOW = 4
    NON_FINITE = 5
    NOT_CONVERGED = 6
    TOO_MANY_STEPS = 7
    INPUT_FAILED = 8
    OUT_OF_MEMORY = 9
    NOT_KEPT = 10
    SLIDES = 11
    OVERLAPS = 12
    NO_MODE = 13
    CHATTERS = 14
    NO_DERIVATIVES = 15
    SETS_NO_NUMBER = 16
    SETS_TWICE = 17
    SETS_BOUND = 18
    TIED = 19
    GAINS = 20
    SETS_APART = 21
    FALLS = 22
    BEGINS_NO_NUMBER = 23
    BRANCHES_TOUCH = 24


class Method(ctypes.Structure):
    """`Method` of runtime.h."""

    _fields_ = [
        ("stages", ctypes.c_long),
        ("order", ctypes.c_long),
        ("kind", ctypes.c_long),
        ("c", _Double),
        ("b", _Double),
        ("A", _Double),
        ("mu", _Double),
        ("to_legendre", _Double),
        ("eigenvalues", ctypes.c_long),
        ("eigen_re", _Double),
        ("eigen_im", _Double),
        ("V_re", _Double),
        ("V_im", _Double),
        ("W_re", _Double),
        ("W_im", _Double),
    ]


class Table(ctypes.Structure):
    """`Table` of runtime.h."""

    _fields_ = [
        *((name, ctypes.c_long) for name in ("input", "pieces", "terms")),
        *((name, ctypes.c_double) for name in ("first", "period")),
        *((name, _Double) for name in ("begins", "coefficients")),
    ]


class Clock(ctypes.Structure):
    """`Clock` of runtime.h."""

    _fields_ = [("value", ctypes.c_double), ("slope", ctypes.c_double), ("counts", ctypes.c_long)]


class JacobianPattern(ctypes.Structure):
    """`Pattern` of runtime.h."""

    _fields_ = [
        *((name, _Long) for name in ("start", "row", "colour", "order")),
        ("colours", ctypes.c_long),
        ("fill", ctypes.c_double),
        ("work", ctypes.c_double),
        ("most", ctypes.c_long),  # for integrations in a block of memory
    ]

    @staticmethod
    def of(pattern: Pattern) -> JacobianPattern:
        """Of arrays that must live as long as it."""
        arrays = (a.ctypes.data_as(_Long) for a in (pattern.start, pattern.row, pattern.colour, pattern.order))
        return JacobianPattern(*arrays, pattern.colours, pattern.fill, pattern.work)


KERNELS = (
    "rhs",
    "jvp",
    "projection",
    "guard",
    "variation",
    "projected",
    "clearance",
    "formula",
    "rows",
    "sides",
    "row_change",
    "decision",
    "decision_change",
    "set",
    "set_change",
    "exact_rhs",
    "exact_projection",
    "disturbed_rhs",
    "disturbed_guard",
    "disturbed_projection",
    "rhs_program",
    "rows_program",
    "projection_program",
    "jvp_program",
)
"""Kernels of an integration, in the order of runtime.h."""


class Integrator(ctypes.Structure):
    """`Integrator` of runtime.h."""

    _fields_ = [
        *((name, ctypes.c_long) for name in ("nx", "nu", "np", "ng", "led", "methods", "method", "newton", "adapt_order", "max_steps", "copies", "guards", "positions", "operations", "through")),
        *((name, Kernel) for name in KERNELS),
        ("lacking", LackingFunction),
        ("held", ctypes.c_long),
        ("row_count", ctypes.c_long),
        ("row_switch", _Long),
        ("row_factor", _Double),
        ("row_plus", _Double),
        *((name, ctypes.c_long) for name in ("masks", "mode_rows", "one_sided", "lines", "planes", "patches", "magnitudes", "redundant", "valves", "discretes", "set_count")),
        *((name, _Long) for name in ("set_direction", "set_first", "set_target")),
        ("followers", ctypes.c_long),
        ("follower", _Long),
        ("discrete_start", ctypes.c_void_p),
        ("usual", ctypes.c_void_p),
        ("method_list", ctypes.POINTER(Method)),
        ("parameters", ctypes.c_void_p),
        ("input", InputFunction),
        ("tables", ctypes.c_long),
        ("formulas", ctypes.c_long),
        ("table_list", ctypes.POINTER(Table)),
        ("formula_input", _Long),
        ("u", ctypes.c_void_p),
        ("before", ctypes.c_void_p),
        ("copy_to", _Long),
        ("copy_from", _Long),
        ("x", ctypes.c_void_p),
        *((name, ctypes.c_double) for name in ("t", "end", "rtol", "atol", "step", "max_step", "slice")),
        ("clocks", ctypes.c_long),
        ("knot_count", ctypes.c_long),
        ("clock_list", ctypes.POINTER(Clock)),
        ("knots", ctypes.c_void_p),
        ("pattern", JacobianPattern),
        *((name, ctypes.c_long) for name in ("steps", "rejected", "evaluations", "iterations", "factorisations", "newton_steps", "radau_steps", "worst", "passages", "switched")),
        ("size", _Double),
        *((name, ctypes.c_double) for name in ("h", "error", "contraction", "work")),
        ("guard_direction", _Long),
        ("guard_stops", _Long),
        ("fine", ctypes.POINTER(Method)),
        ("events", ctypes.c_long),
        ("event_times", _Double),
        ("event_guards", _Long),
        ("event_directions", _Long),
        ("memory", ctypes.c_void_p),
        ("state", ctypes.c_void_p),
        ("times", _Double),
        ("states", _Double),
        ("coefficients", _Double),
        ("step_sides", _Double),
        ("stage_count", _Long),
        ("offset", _Long),
        ("kinds", _Long),
        ("directions", ctypes.c_long),
        ("S", ctypes.c_void_p),
        ("du", ctypes.c_void_p),
        ("dp", ctypes.c_void_p),
        ("discrete_S", ctypes.c_void_p),
        ("asked", ctypes.c_long),
        ("given", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("asked_t", "asked_x", "asked_S", "asked_discrete")),
        ("user", ctypes.c_void_p),
        ("budget", ctypes.c_size_t),
        ("read", ctypes.c_void_p),
        ("read_count", ctypes.c_long),
        ("block", ctypes.c_void_p),
        ("room", ctypes.c_size_t),
        ("used", ctypes.c_size_t),
        *((name, ctypes.c_long) for name in ("counted", "first", "event_room", "promised", "transitions")),
        ("transition_steps", _Long),
        ("transition_rows", _Long),
        ("impulses", _Double),
        ("transition_masks", _Double),
        *((name, ctypes.c_long) for name in ("grazed", "coincides", "other")),
        ("apart", ctypes.c_double),
        ("programs", ctypes.c_void_p),
    ]  # fmt: skip


@dataclass(frozen=True)
class MethodTable:
    """Methods as an array for C, with the arrays that it points to."""

    array: ctypes.Array[Method]
    alive: tuple[np.ndarray, ...]


def method_table(tableaus: tuple[Tableau, ...]) -> MethodTable:
    """Tableaus in the form of the C runtime, eigenvectors of A and the error formula of Radau included."""
    alive: list[np.ndarray] = []

    def pointer(values: np.ndarray) -> ctypes._Pointer[ctypes.c_double]:  # pyright: ignore[reportPrivateUsage]  # the type has no public name
        array = np.ascontiguousarray(values, dtype=float)
        alive.append(array)
        return array.ctypes.data_as(_Double)

    methods: list[Method] = []
    for tableau in tableaus:
        values, V, W = eigenvectors(tableau)
        methods.append(
            Method(
                tableau.stages, tableau.order, int(tableau.name == "radau"),
                pointer(tableau.c), pointer(tableau.b), pointer(tableau.A), pointer(tableau.mu), pointer(tableau.to_legendre), values.size,
                pointer(np.real(values)), pointer(np.imag(values)), pointer(np.real(V)), pointer(np.imag(V)),
                pointer(np.real(W)), pointer(np.imag(W)),
            )
        )  # fmt: skip
    return MethodTable((Method * len(methods))(*methods), tuple(alive))
