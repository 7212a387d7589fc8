"""Programs of `SX` functions, made by the runtime (program.h)."""

from __future__ import annotations

import ctypes
from itertools import accumulate, chain

import casadi as ca
import numpy as np

from acausal.emit.program import CODES, LOAD, NUMBER, SYSTEM, WIDTH, Program
from acausal.emit.statements import ANSWER, statements
from acausal.emit.statements import SYSTEM as SYSTEM_VALUE
from acausal.errors import NoRuntimeError
from acausal.numerics.staged import Function
from acausal.numerics.uncollected import uncollected
from acausal.runtime.load import runtime

_SIZES = ("values", "rare_count", "often_count", "kept_count", "results", "systems", "unit")
_COLUMNS = ("code", "begin", "of", "place", "rare", "often", "kept", "result", "system")


class _Definition(ctypes.Structure):
    """`Definition` of program.h."""

    _fields_ = [*((n, ctypes.c_long) for n in _SIZES), *((n, ctypes.c_void_p) for n in _COLUMNS), ("number", ctypes.c_void_p)]


_ANSWER = SYSTEM + 3
"""As thin.h numbers it."""
_CODES = np.zeros(256, np.int32)
"""By operations of CasADi, and of systems from behind."""
for _code, _own in {**CODES, ca.OP_INPUT: LOAD, ca.OP_CONST: NUMBER, SYSTEM_VALUE: SYSTEM, ANSWER: _ANSWER}.items():
    _CODES[_code] = _own


@uncollected
def program(function: Function, name: str, lanes: int, *, parameters: tuple[int, ...] = ()) -> Program:
    """The program of a function. `parameters`: numbers of the arguments that seldom change.

    Raises `ExportError` for functions that cannot be expanded to `SX`, and `NoRuntimeError` where there is no runtime.
    """
    found, library = statements(function, name, parameters), runtime()
    if library is None:
        raise NoRuntimeError(
            f"'{name}' is made ready for an interpreter by the integrators in C, which were not built with this installation, and no C compiler was found to build them now (cc, gcc, "
            "clang, or ziglang from PyPI; `pip install ziglang` is enough)."
        )
    values, count = found.values, len(found.values.codes)
    code = _CODES[np.array(values.codes, np.int_)]
    begin = np.fromiter(accumulate(map(len, values.args), initial=0), np.int32, count + 1)
    of = np.fromiter(chain.from_iterable(values.args), np.int32, begin[-1])
    rare, often, kept = (np.array(part, np.int32) for part in (found.rare, found.often, found.kept))
    result = np.fromiter(chain.from_iterable(found.results), np.int32, 2 * len(found.results))
    place, number = np.zeros(count, np.int32), np.zeros(count)
    for column, own in ((place, values.places), (number, values.numbers)):
        column[list(own)] = list(own.values())
    system = np.array([(s.rows, s.columns, s.damped) for s in found.systems], np.int32)
    columns = (code, begin, of, place, rare, often, kept, result, system, number)
    sizes = (count, rare.size, often.size, kept.size, len(found.results), len(system), 8 * lanes)
    preparation, run = np.empty((2, 2 * count + len(found.results) + of.size + 2, WIDTH), np.int32)
    length, definition = np.zeros(2, np.int_), _Definition(*sizes, *[column.ctypes.data for column in columns])
    frame = library.library.make_program(ctypes.byref(definition), *(a.ctypes.data for a in (preparation, run, length)))
    if frame < 0:
        raise MemoryError(f"The program of '{name}', {count} values: not enough memory.")
    return Program(preparation[: length[0]].copy(), run[: length[1]].copy(), found.inputs, found.outputs, frame)
