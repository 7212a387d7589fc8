"""model.c of an exported simulator: its kernels, and all that the runtime knows of them, as static data."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.collocation.inputs import Inputs
from acausal.collocation.tableau import Tableau, gauss_legendre, radau_iia, refining
from acausal.emit.emit import Source, emit, translation_units
from acausal.emit.program import NUMBER
from acausal.export.start_functions import StartFunctions
from acausal.integrators.radau import ADAPTIVE
from acausal.language.expression import Expression, InputRate
from acausal.language.when import when
from acausal.numerics.staged import plain
from acausal.outputs.functions import Functions
from acausal.runtime.binding import Method, method_table
from acausal.runtime.kernels import Wanted
from acausal.runtime.program import program
from acausal.simulate.simulation import guards_of

_HEAD = """\
/* The model: functions, names, values. Only what model.h declares is seen by other files. */
#include "model.h"
#include "assembly.h"
#undef EXPORT
#undef HIDDEN
#define EXPORT static __attribute__((unused))
#define HIDDEN static
"""
_PLACES = """
/* Programs on pairs of values: statements of an operation and four places; of a number: a place and its two halves. */
#define PLACE(k) ((k) * (int)sizeof(V) * 2)
#define S(o, a, b, c, d) o, PLACE(a), PLACE(b), PLACE(c), PLACE(d)
#define N(a, low, high) 3, PLACE(a), (int)low, (int)high, 0
#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "Numbers in programs are written low half first."
#endif
"""
_Values = Sequence[Any] | np.ndarray
_GAUSS = tuple(gauss_legendre(s) for s in range(1, 9))
_RADAU = tuple(radau_iia(s) for s in range(1, 8))


@dataclass(frozen=True)
class Kind:
    """Numbers of one kind: names, units, values when exported."""

    word: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.names)


def model_c(
    f: Functions, title: str, kinds: Mapping[str, Kind], start: StartFunctions, outputs: Mapping[str, Expression], events: Sequence[when], inputs: Inputs,
    discretes: np.ndarray | None,
) -> str:  # fmt: skip
    """What model.h declares."""
    integrand = f.integrand
    shown = [f.outputs.resolve(e) for e in outputs.values()]
    wanted = [*integrand.wanted, integrand.jvp]
    paired = [*integrand.exact, Wanted("disturbed_rhs", plain(integrand.rates), (3,))]
    if integrand.numbers["led"] == 2:
        paired.append(Wanted("disturbed_projection", plain(integrand.correction.function), (3,)))
    guards = guards_of(f, events)
    if guards is not None:
        wanted.append(guard := integrand.guard(guards.function))
        paired.append(Wanted("disturbed_guard", guard.function, (3,)))
    if inputs.formulas:
        wanted.append(Wanted("formula", inputs.formula))
    shown_function = f.output(ca.vertcat(ca.SX(0, 1), *map(ca.vec, shown)), name="outputs")
    sources = {
        w.name: emit(w.function, f"model_{w.name}", parameters=w.parameters)
        for w in (*wanted, Wanted("outputs", shown_function, (3,)))
    }
    pattern, switching = integrand.pattern, integrand.switching
    longs: dict[str, _Values] = {
        "copy_to": integrand.copies[0], "copy_from": integrand.copies[1], "formula_input": [i for i, _ in inputs.formulas],
        "guard_direction": guards.directions if guards else (), "guard_stops": [*map(int, guards.stops)] if guards else (),
        "start": pattern.start, "row": pattern.row, "colour": pattern.colour, "order": pattern.order,
    }  # fmt: skip
    doubles: dict[str, _Values] = {}
    longs |= integrand.lists
    if integrand.row_switch.size:
        longs["row_switch"] = integrand.row_switch
        doubles |= dict(zip(("row_factor", "row_plus"), integrand.row_steps, strict=True))
    if discretes is not None:
        doubles["discrete_start"] = discretes
    if integrand.usual is not None:
        doubles["usual"] = integrand.usual
    tables = [_table(k, i, course) for k, (i, course) in enumerate(inputs.tables)]
    data = [
        *(_longs(name, values) for name, values in longs.items()),
        *(_doubles(name, values) for name, values in doubles.items()),
        *(line for lines, _ in tables for line in lines),
        f"static const Table table_list[] = {array([entry for _, entry in tables] or ['{0}'])};",
        f"static const Clock clock_list[] = {array([f'{{{hex_of(v)}, {hex_of(s)}, {c}}}' for v, s, c in inputs.clocks] or ['{0}'])};",
        f"static const char *const switch_words[] = {array([*map(string, switching.words if switching else ()), '0'])};",
        f"static const char *const law_words[] = {array([*map(string, integrand.modes.all_words if integrand.modes else ()), '0'])};",
        _longs("rates", _rates(f, inputs)),
        f"static const char given[] = {array([*(str(int(callable(c))) for c in inputs.courses), '0'])};",
        f"static const char depends[] = {array([str(int(d)) for d in start.depends] or ['0'])};",
    ]
    programs, kernels = zip(*(_program(w) for w in paired), strict=True)
    in_pattern = ("start", "row", "colour", "order")
    motion = [
        *(f".{name} = {number}" for name, number in integrand.numbers.items()),
        *(f".{name} = {_kernel(source)}" for name, source in sources.items() if name != "outputs"),
        *kernels,
        *(f".{name} = {name}" for name in (*longs, *doubles) if name not in in_pattern),
        f".guards = {len(guards.directions) if guards else 0}",
        f".tables = {len(inputs.tables)}, .table_list = table_list, .clocks = {len(inputs.clocks)}, .clock_list = clock_list",
        f".formulas = {len(inputs.formulas)}",
        f".pattern = {{{', '.join(in_pattern)}, {pattern.colours}, {pattern.fill}, {hex_of(pattern.work)}, {pattern.most}}}",
    ]
    fields = [
        f".title = {string(title)}, .width = LANES, .constants = {start.assembly.numel_out(1)}",
        f".outputs = {_kernel(sources['outputs'])}",
        f".quantities = {array([_quantities(kind) for kind in kinds.values()])}",
        f".depends = depends, .given = given, .rate = rates, .switches = switch_words, .laws = law_words, .assembly = {_plain(start.assembly)}",
        *([] if start.gaps is None else [f".gaps = {_plain(start.gaps)}"]),
        *([] if start.holds is None else [f".holds = {_plain(start.holds)}"]),
        *([] if start.clear is None else [f".clear = {_plain(start.clear)}"]),
        f".motion = {{\n        {(',' + chr(10) + ' ' * 8).join(motion)}}}",
    ]
    lines = [
        _PLACES, *programs, *data, *(line for kind in kinds.values() for line in _quantity_arrays(kind)),
        "const Model model = {\n    " + ",\n    ".join(fields) + "\n};",
    ]  # fmt: skip
    return "\n".join([_HEAD, *translation_units([*sources.values()], 1), *lines, ""])


def methods_c() -> str:
    """methods.h: each Gauss method with the Radau methods for where a motion is stiff, and the one that refines its dense output; Radau methods."""
    refined = tuple(map(refining, _GAUSS))
    known = {(t.name, t.order): t for t in (*_GAUSS, *refined, *_RADAU)}
    made = {key: _method(tableau) for key, tableau in known.items()}

    def rows(tableaus: Sequence[Tableau]) -> str:
        return array([made[t.name, t.order][1] for t in tableaus])

    return (
        "/* Coefficients of collocation methods. */\n"
        + "".join(arrays for arrays, _ in made.values())
        + f"/* with those for where a motion is stiff */\nstatic const Method gauss_methods[][{1 + len(ADAPTIVE)}] = "
        + array([rows((t, *ADAPTIVE)) for t in _GAUSS])
        + f";\n/* of their dense output */\nstatic const Method gauss_refining[] = {rows(refined)};\n"
        + f"static const Method radau_methods[] = {rows(_RADAU)};\n"
    )


def _rates(f: Functions, inputs: Inputs) -> list[int]:
    """Of each input the place of its rate among them; -1 where there is none, and where it is a function of time."""
    entries = f.outputs.system.flat.inputs
    place = {entry.of: k for k, entry in enumerate(entries) if isinstance(entry, InputRate)}
    return [-1 if callable(course) else place.get(entry, -1) for entry, course in zip(entries, inputs.courses, strict=True)]


def array(entries: Sequence[str]) -> str:
    """An initialiser of C."""
    return "{" + ", ".join(entries) + "}"


def string(text: str) -> str:
    """A string literal of C."""
    return json.dumps(text, ensure_ascii=False)


def hex_of(value: float) -> str:
    """A number of C, to the last bit."""
    if math.isfinite(value):
        return float(value).hex()
    return '__builtin_nan("")' if math.isnan(value) else f"{'-' if value < 0 else ''}__builtin_inf()"


def _longs(name: str, values: _Values) -> str:
    return f"static const long {name}[] = {array([*map(str, values)] or ['0'])};"


def _doubles(name: str, values: _Values) -> str:
    return f"static const double {name}[] = {array([*map(hex_of, values)] or ['0'])};"


def _table(k: int, number: int, course: Any) -> tuple[list[str], str]:
    """Arrays of a table, and its entry in the list of tables."""
    arrays = [_doubles(f"table_{k}_begins", course.begins), _doubles(f"table_{k}_coefficients", course.coefficients.ravel())]
    pieces, terms = course.coefficients.shape
    sizes = f"{number}, {pieces}, {terms}, {hex_of(course.first)}, {hex_of(course.period)}"
    return arrays, f"{{{sizes}, table_{k}_begins, table_{k}_coefficients}}"


def _program(wanted: Wanted) -> tuple[str, str]:
    """A function as a program on pairs of values: its statements, and the field of `Integrator` that holds it. Raises `ExportError`."""
    made = program(wanted.function, wanted.name, 1, parameters=wanted.parameters)
    texts = [
        f"static const int {wanted.name}_{of}[] = {array([_statement(row) for row in rows.tolist()])};"
        for of, rows in (("program", made.run), ("preparation", made.preparation))
    ]
    sizes = f".inputs = {made.inputs}, .outputs = {made.outputs}, .constants = {2 * made.frame}, .twofold = 1"
    programs = f".program = {wanted.name}_program, .preparation = {wanted.name}_preparation"
    return "\n".join(texts), f".{wanted.name} = {{{programs}, {sizes}}}"


def _statement(row: Sequence[int]) -> str:
    """Five integers."""
    places = [place // 8 for place in row[1:]]
    if row[0] == NUMBER:
        low, high = (f"0x{half & 0xFFFFFFFF:x}" for half in row[2:4])
        return f"N({places[0]}, {low}, {high})"
    return f"S({row[0]}, {', '.join(map(str, places))})"


def _quantity_arrays(kind: Kind) -> list[str]:
    texts = {"names": kind.names, "units": kind.units}
    words = [
        f"static const char *const {kind.word}_{of}[] = {array([*map(string, entries), '0'])};" for of, entries in texts.items()
    ]
    return [*words, _doubles(f"{kind.word}_values", kind.values)]


def _quantities(kind: Kind) -> str:
    """`Quantities` of model.h."""
    return f"{{{kind.count}, {kind.word}_names, {kind.word}_units, {kind.word}_values}}"


def _kernel(source: Source) -> str:
    """A `Kernel` of runtime.h."""
    sizes = f".inputs = {source.inputs}, .outputs = {source.outputs}, .constants = {source.constants}, .work = {source.work}"
    return f"{{.run = {source.name}, .prepare = {source.name}_prepare, {sizes}}}"


def _plain(function: ca.Function) -> str:
    """A `PlainFunction` of model.h."""
    return f"{{{function.name()}, {function.sz_arg()}, {function.sz_res()}, {function.sz_iw()}, {function.sz_w()}}}"


def _method(tableau: Tableau) -> tuple[str, str]:
    """Arrays of a method, and its `Method` of runtime.h, as `method_table` makes it."""
    arrays: list[str] = []
    fields: list[str] = []
    table = method_table((tableau,))  # holds what its pointers point to
    method = table.array[0]
    s, m = method.stages, method.eigenvalues
    sizes = {"A": s * s, "mu": s * s, "to_legendre": s * s, "eigen_re": m, "eigen_im": m}
    sizes |= dict.fromkeys(("V_re", "V_im", "W_re", "W_im"), s * m)
    for field in (entry[0] for entry in Method._fields_):
        value: Any = getattr(method, field)
        if isinstance(value, int):
            fields.append(str(value))
        else:
            fields.append(f"{tableau.name}_{method.order}_{field}")
            arrays.append(f"{_doubles(fields[-1], value[: sizes.get(field, s)])}\n")
    return "".join(arrays), array(fields)
