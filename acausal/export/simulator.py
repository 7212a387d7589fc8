"""Simulation of one model in C that stands by itself: its kernels, the integrators, instances of its motion, and a program that prints one."""

from __future__ import annotations

import importlib.metadata
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca

from acausal.collocation.tableau import Tableau, gauss_legendre, radau_iia
from acausal.emit.emit import Source, emit, translation_units
from acausal.emit.library import SOURCES
from acausal.errors import ExportError
from acausal.export.start_functions import StartFunctions, start_c, start_functions
from acausal.language.expression import Expression
from acausal.numerics.bound import copied_states
from acausal.outputs.expression_names import expression_name, expression_unit
from acausal.outputs.functions import Functions
from acausal.outputs.state_units import state_units
from acausal.runtime.binding import Method, method_table
from acausal.runtime.native import directional_derivative, projection_with_invariants
from acausal.runtime.pattern import jacobian_pattern
from acausal.simulate.events import when
from acausal.start.initial import InitialState

PROGRAM = Path(__file__).resolve().parent / "program"
"""Folder of the C sources that are the same for all models but for a name."""
_GAUSS = tuple(gauss_legendre(s) for s in (4, 6, 8))
_RADAU = tuple(radau_iia(s) for s in (3, 5, 7))
_MODEL_HEAD = """\
/* The model: functions, names, values. Only what model.h declares is seen by other files. */
#include "model.h"
#include "assembly.h"
#undef EXPORT
#undef HIDDEN
#define EXPORT static __attribute__((unused))
#define HIDDEN static
"""
_README = """\
{heading}
{line}

    cc -O2 -march=native -ffp-contract=off -fno-math-errno -o simulator main.c simulator.c model.c runtime.c -lm
    ./simulator 10 > motion.csv

or `make`, or CMake. It needs a C99 compiler with vector extensions (GCC, Clang) and libm, nothing else. Leave out -march=native for a
program that runs on other processors too. All files must be compiled with the same flags; with -Wall, add -Wno-psabi.

    ./simulator end [samples] [rtol] [method]

prints states and outputs at equally spaced times from 0 to `end` seconds, separated by commas; events go to the other stream. `method`:
gauss, or radau for stiff models.

{nx} states, {nu} inputs, {np} parameters; names, units and values are in simulator.h and model.json. To simulate from a program of your own:
instances, see simulator.h. `make` also builds the shared library that Python's ctypes can load; main.c may be left out.

main.c                    the program
simulator.h, simulator.c  instances
model.h, model.c          the model
assembly.h                its start, assembled for other values
methods.h                 coefficients of the integrators
names.h                   who sees which names
runtime.h, runtime.c      the integrators; the other headers belong to them
Makefile, CMakeLists.txt  program and library
"""


def export_simulator(
    model: Functions,
    folder: str | Path,
    initial: InitialState,
    *,
    name: str = "simulator",
    outputs: Mapping[str, Expression] | None = None,
    events: Sequence[when] = (),
) -> Path:
    """Write a simulator in C (main.c, simulator.h, model.c, ...), model.json and README.txt with a build line into a folder of its own.

    `initial`: what it starts from, with the values of its parameters. `name`: an identifier that all its names begin with, and its header.
    `outputs`: expressions of the scene's variables that it computes, by names. `events`: zeros that it looks for. The numbers are those of
    `model.simulate` with method "gauss" or "radau", to the bit where compiler and processor are the same; only where the dynamics switch at times
    (pulses, ramps) does `simulate` know when, and end steps there, and where loops come close to singular positions it has twice as many digits.
    Raises `ExportError` for functions that have no C, for a name that is no identifier, and when a file cannot be written.
    """
    target = Path(folder)
    start = start_functions(model, initial)
    kinds = _kinds(model, initial, start, {} if outputs is None else outputs, events)
    title = model.outputs.system.flat.name
    heading = f"{title}: simulation in C"

    templates = {
        path.name: path.read_text(encoding="utf-8")
        for folder in (SOURCES, PROGRAM)
        for path in sorted(folder.iterdir())
        if _is_template(path)
    }
    _check_name(name, templates)

    def named(text: str) -> str:
        return text.replace("simulator", name).replace("SIMULATOR", name.upper())

    texts = {named(file): named(text) for file, text in templates.items()}
    texts |= {
        "model.c": _model_c(model, title, kinds, start, {} if outputs is None else outputs, events),
        "assembly.h": start_c(start, f"{name}_hidden_"),
        "methods.h": _methods_h(),
        "model.json": json.dumps(_facts(title, kinds), indent=2),
        "README.txt": named(_README).format(
            heading=heading,
            line="=" * len(heading),
            nx=kinds["state"].count,
            nu=kinds["input"].count,
            np=kinds["parameter"].count,
        ),
    }
    filled = {
        "{title}": title.replace("*/", "* /"),
        "{version}": _string(f"acausal {importlib.metadata.version('acausal')}"),
        "{indices}": "".join(_indices(kind, name.upper()) for kind in kinds.values()),
    }
    for placeholder, text in filled.items():
        texts[f"{name}.h"] = texts[f"{name}.h"].replace(placeholder, text)
    try:
        target.mkdir(parents=True, exist_ok=True)
        for file, text in texts.items():
            (target / file).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ExportError(f"export_simulator: cannot write to '{target}': {error}.") from error
    return target


def _is_template(path: Path) -> bool:
    return path.suffix in (".c", ".h") or path.name in ("Makefile", "CMakeLists.txt")


def _check_name(name: str, templates: Mapping[str, str]) -> None:
    """Raises `ExportError` for what is no identifier of C, or makes names that are in the files already."""
    words = set(re.findall(r"[A-Za-z_]\w*(?:\.[ch]\b)?", "\n".join([*templates, *templates.values()])))
    own = {word for word in words if re.match("simulator[_.]", word.lower())}
    made = {word.replace("simulator", name).replace("SIMULATOR", name.upper()) for word in own}
    taken = sorted(made & (words - own))
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or taken:
        raise ExportError(
            f"export_simulator: name={name!r} cannot be what the names of C functions begin with"
            + (f", since there is a '{taken[0]}' already" if taken else "")
            + ". Give another word of letters and digits: 'arm'."
        )


@dataclass(frozen=True)
class _Kind:
    """Numbers of one kind: names, units, values when exported."""

    word: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]

    @property
    def count(self) -> int:
        return len(self.names)


def _kinds(
    model: Functions, initial: InitialState, start: StartFunctions, outputs: Mapping[str, Expression], events: Sequence[when]
) -> dict[str, _Kind]:
    """In the order of `simulator_kind`."""
    for event in events:
        if model.outputs.resolve(event.expression).numel() != 1:
            raise ExportError(
                f"export_simulator: {event.expression!r} in `events` is not a scalar; give one event for each entry."
            )
    flat = model.outputs.system.flat
    constants = model.space.elimination.constants.numel()
    entries = {key: model.outputs.resolve(value).numel() for key, value in outputs.items()}
    shown = [(key + (f"[{k}]" if n > 1 else ""), expression_unit(outputs[key])) for key, n in entries.items() for k in range(n)]
    found = [
        _Kind("state", model.state_names, state_units(model), tuple(initial.x.tolist())),
        _Kind(
            "input",
            model.input_names,
            tuple(i.unit for i in flat.inputs),
            tuple(model.outputs.system.u_defaults.tolist()),
        ),
        _Kind(
            "parameter", model.parameter_names, (*(p.unit for p in flat.parameters), *[""] * constants), tuple(initial.p.tolist())
        ),
        _Kind("condition", start.names, start.units, start.values),
        _Kind("output", tuple(n for n, _ in shown), tuple(u for _, u in shown), (float("nan"),) * len(shown)),
        _Kind(
            "event",
            tuple(expression_name(model.outputs, e.expression) for e in events),
            tuple(expression_unit(e.expression) for e in events),
            (float("nan"),) * len(events),
        ),
    ]
    return {kind.word: kind for kind in found}


def _facts(title: str, kinds: Mapping[str, _Kind]) -> dict[str, Any]:
    """What model.json holds."""
    facts: dict[str, Any] = {"title": title}
    for kind in kinds.values():
        facts |= {f"{kind.word}s": kind.names, f"{kind.word}_units": kind.units}
    return facts | {
        "start": kinds["state"].values,
        **{f"{word}_values": kinds[word].values for word in ("input", "parameter", "condition")},
    }


def _indices(kind: _Kind, prefix: str) -> str:
    """Constants for the numbers of a kind, with names and units, and how many there are."""
    lines: list[str] = []
    used: set[str] = set()
    for name, unit, value in zip(kind.names, kind.units, kind.values, strict=True):
        word = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
        while word in used:
            word += "_"
        used.add(word)
        told = (
            name.replace("*/", "* /")
            + (f" [{unit}]" if unit else "")
            + ("" if math.isnan(value) or kind.word == "state" else f" = {value:g}")
        )
        lines.append(f"    {prefix}_{kind.word.upper()}_{word}, /* {told} */\n")
    return f"enum {{\n{''.join(lines)}    {prefix}_{kind.word.upper()}S\n}};\n"


def _model_c(
    f: Functions,
    title: str,
    kinds: Mapping[str, _Kind],
    start: StartFunctions,
    outputs: Mapping[str, Expression],
    events: Sequence[when],
) -> str:
    """Kernels, names and values of a model; what model.h declares."""
    rhs = f.explicit_dynamics
    shown = [f.outputs.resolve(e) for e in outputs.values()]
    sources = [
        emit(rhs, "model_rhs", parameters=(3,)),
        emit(directional_derivative(rhs, (1,)), "model_jvp", parameters=(3,)),
        emit(f.output(ca.vertcat(ca.SX(0, 1), *map(ca.vec, shown)), name="outputs"), "model_outputs", parameters=(3,)),
    ]
    invariants = 0
    if f.invariants is not None and f.projection is not None:
        invariants = f.invariants.size1_out(0)
        sources.append(emit(projection_with_invariants(f.invariants, f.projection), "model_projection", parameters=(2,)))
    if f.clearance is not None and f.outputs.system.constraints.singular:
        sources.append(emit(f.clearance, "model_clearance", parameters=(2,)))
    if events:
        guards = f.output(ca.vertcat(*(f.outputs.resolve(e.expression) for e in events)), name="guards")
        sources.append(emit(guards, "model_guard", parameters=(3,)))
    copies = copied_states(rhs)
    numbers = {f"copy_{word}": [str(pair[k]) for pair in copies] for k, word in enumerate(("to", "from"))}
    numbers |= {"guard_direction": [str(e.sign) for e in events], "guard_stops": [str(int(e.stop)) for e in events]}
    pattern = jacobian_pattern(rhs)
    entries = {"start": pattern.start, "row": pattern.row, "colour": pattern.colour, "order": pattern.order}
    patterns = {f"pattern_{word}": [*map(str, of)] for word, of in entries.items()}
    fields = [
        *(f".{source.name.removeprefix('model_')} = {_kernel(source)}" for source in sources),
        f".quantities = {_array([_quantities(kind) for kind in kinds.values()])}",
        f".title = {_string(title)}, .width = LANES, .invariants = {invariants}, .copies = {len(copies)}, .positions = {f.space.nq}",
        *(f".{name} = {name}" for name in numbers),
        f".constants = {start.assembly.numel_out(1)}, .depends = depends, .assembly = {_plain(start.assembly)}",
        *([] if start.gaps is None else [f".gaps = {_plain(start.gaps)}"]),
        *([] if start.holds is None else [f".holds = {_plain(start.holds)}"]),
        f".operations = {rhs.n_instructions()}",
        f".pattern = {{{', '.join(patterns)}, {pattern.colours}, {pattern.fill}, {pattern.work.hex()}}}",
    ]
    lines = [
        *(line for kind in kinds.values() for line in _quantity_arrays(kind)),
        *(f"static const long {name}[] = {_array(entries or ['0'])};" for name, entries in (numbers | patterns).items()),
        f"static const char depends[] = {_array([str(int(d)) for d in start.depends])};",
        "const Model model = {\n    " + ",\n    ".join(fields) + "\n};",
    ]
    return "\n".join([_MODEL_HEAD, *translation_units(sources, 1), *lines, ""])


def _quantity_arrays(kind: _Kind) -> list[str]:
    texts = {"names": kind.names, "units": kind.units}
    words = [
        f"static const char *const {kind.word}_{of}[] = {_array([*map(_string, entries), '0'])};" for of, entries in texts.items()
    ]
    return [*words, f"static const double {kind.word}_values[] = {_array([_hex(v) for v in kind.values] or ['0'])};"]


def _quantities(kind: _Kind) -> str:
    """`Quantities` of model.h."""
    return f"{{{kind.count}, {kind.word}_names, {kind.word}_units, {kind.word}_values}}"


def _hex(value: float) -> str:
    return value.hex() if math.isfinite(value) else '__builtin_nan("")'


def _kernel(source: Source) -> str:
    """A `Kernel` of runtime.h."""
    return f"{{{source.name}, {source.name}_prepare, 0, 0, 0, 0, 0, 0, {source.inputs}, {source.outputs}, {source.constants}, {source.work}}}"


def _plain(function: ca.Function) -> str:
    """A `PlainFunction` of model.h."""
    return f"{{{function.name()}, {function.sz_arg()}, {function.sz_res()}, {function.sz_iw()}, {function.sz_w()}}}"


def _methods_h() -> str:
    refining = tuple(gauss_legendre(max(t.stages + 1, round(1.75 * t.stages))) for t in _GAUSS)
    return (
        "/* Coefficients of collocation methods, and for each Gauss method the one that refines its dense output. */\n"
        + _methods("gauss_methods", _GAUSS)
        + _methods("gauss_refining", refining)
        + _methods("radau_methods", _RADAU)
    )


def _methods(name: str, tableaus: tuple[Tableau, ...]) -> str:
    """An array of `Method` of runtime.h, as `method_table` makes it."""
    arrays: list[str] = []
    rows: list[str] = []
    table = method_table(tableaus)  # holds what its pointers point to
    for method in table.array:
        s, m = method.stages, method.eigenvalues
        sizes = {"A": s * s, "mu": s * s, "to_legendre": s * s, "eigen_re": m, "eigen_im": m}
        sizes |= dict.fromkeys(("V_re", "V_im", "W_re", "W_im"), s * m)
        fields: list[str] = []
        for field in (entry[0] for entry in Method._fields_):
            value: Any = getattr(method, field)
            if isinstance(value, int):
                fields.append(str(value))
            elif isinstance(value, float):
                fields.append(value.hex())
            else:
                fields.append(f"{name}_{len(rows)}_{field}")
                numbers = _array([v.hex() for v in value[: sizes.get(field, s)]])
                arrays.append(f"static const double {fields[-1]}[] = {numbers};\n")
        rows.append(f"{{{', '.join(fields)}}}")
    return f"{''.join(arrays)}static const Method {name}[] = {_array(rows)};\n"


def _array(entries: Sequence[str]) -> str:
    return "{" + ", ".join(entries) + "}"


def _string(text: str) -> str:
    """A string literal of C."""
    return json.dumps(text, ensure_ascii=False)
