"""A simulator of one model in C that stands by itself: its kernels, the integrators, and a program that prints its motion."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import casadi as ca

from acausal.collocation.tableau import Tableau, gauss_legendre, radau_iia
from acausal.emit.emit import Source, emit, translation_units
from acausal.emit.library import SOURCES
from acausal.errors import ExportError
from acausal.export.start_functions import StartFunctions, start_c, start_functions
from acausal.numerics.bound import copied_states
from acausal.outputs.functions import Functions
from acausal.runtime.binding import Method, method_table
from acausal.runtime.native import directional_derivative, projection_with_invariants
from acausal.start.initial import InitialState

PROGRAM = Path(__file__).resolve().parent / "program"
"""Folder of the C sources that are the same for all models."""
_GAUSS = tuple(gauss_legendre(s) for s in (4, 6, 8))
_RADAU = tuple(radau_iia(s) for s in (3, 5, 7))
_MODEL_HEAD = """\
/* The model: functions, names, values. Only what model.h and simulator.h declare is seen by other files. */
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

It needs a C99 compiler with vector extensions (GCC, Clang) and libm, nothing else. Leave out -march=native for a program that runs on
other processors too. All files must be compiled with the same flags; with -Wall, add -Wno-psabi.

    ./simulator end [samples] [rtol] [method]

prints the states at equally spaced times from 0 to `end` seconds, separated by commas. `method`: gauss, or radau for stiff models.

{nx} states, {nu} inputs, {np} parameters; names and values are in model.json. To simulate from a program of your own, see `simulate`
in simulator.h: other start values, parameters and inputs, fixed steps, what to do when a run fails.

As a shared library: leave main.c out and add -fPIC -shared. Two models in one program: give the files of each a prefix of their own, e.g.
-DSIMULATOR_PREFIX=arm_; simulator.h says more.

main.c                    the program
simulator.h, simulator.c  one run
model.h, model.c          the model
assembly.h                its start, assembled for other values
methods.h                 coefficients of the integrators
names.h                   who sees which names
runtime.h, runtime.c      the integrators; the other headers belong to them
"""


def export_simulator(model: Functions, folder: str | Path, initial: InitialState) -> Path:
    """Write a simulator in C (main.c, simulator.h, model.c, ...), model.json and README.txt with a build line into a folder of its own.

    `initial`: what it starts from, with the values of its parameters. The numbers are those of `model.simulate` with method "gauss" or
    "radau", to the bit where compiler and processor are the same; only where the dynamics switch at times (pulses, ramps) does `simulate` know
    when, and end steps there, and where loops come close to singular positions it has twice as many digits. Raises
    `ExportError` for functions that have no C, and when a file cannot be written.
    """
    target = Path(folder)
    start = start_functions(model, initial)
    facts = _Facts(
        title=model.outputs.system.flat.name,
        states=model.state_names,
        inputs=model.input_names,
        parameters=model.parameter_names,
        start=tuple(initial.x.tolist()),
        input_values=tuple(model.outputs.system.u_defaults.tolist()),
        parameter_values=tuple(initial.p.tolist()),
        conditions=start.names,
        condition_values=start.values,
    )
    heading = f"{facts.title}: a simulator in C"
    texts = {
        "model.c": _model_c(model, facts, start),
        "assembly.h": start_c(start),
        "methods.h": _methods_h(),
        "model.json": json.dumps({"functions": ["simulate"], **asdict(facts)}, indent=2),
        "README.txt": _README.format(
            heading=heading, line="=" * len(heading), nx=len(facts.states), nu=len(facts.inputs), np=len(facts.parameters)
        ),
    }
    try:
        target.mkdir(parents=True, exist_ok=True)
        for source in [*SOURCES.glob("*.[ch]"), *PROGRAM.glob("*.[ch]")]:  # names.h is in both: that of the program
            shutil.copyfile(source, target / source.name)
        for name, text in texts.items():
            (target / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ExportError(f"export_simulator: cannot write to '{target}': {error}.") from error
    return target


@dataclass(frozen=True)
class _Facts:
    title: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    start: tuple[float, ...]
    input_values: tuple[float, ...]
    parameter_values: tuple[float, ...]
    conditions: tuple[str, ...]
    condition_values: tuple[float, ...]


def _model_c(f: Functions, facts: _Facts, start: StartFunctions) -> str:
    """Kernels, names and values of a model; what model.h and simulator.h declare."""
    rhs = f.explicit_dynamics
    sources = [
        emit(rhs, "model_rhs", parameters=(3,)),
        emit(directional_derivative(rhs, (1,)), "model_jvp", parameters=(3,)),
    ]
    invariants = 0
    if f.invariants is not None and f.projection is not None:
        invariants = f.invariants.size1_out(0)
        sources.append(emit(projection_with_invariants(f.invariants, f.projection), "model_projection", parameters=(2,)))
    if f.clearance is not None and f.outputs.system.constraints.singular:
        sources.append(emit(f.clearance, "model_clearance", parameters=(2,)))
    kernels = {source.name: source for source in sources}
    copies = copied_states(rhs)
    names = {"state": facts.states, "input": facts.inputs, "parameter": facts.parameters, "condition": facts.conditions}
    shared = {f"{kind}_names": ("char *const", [*map(_string, of), "0"]) for kind, of in names.items()}
    values = {"start": facts.start, "input_values": facts.input_values, "parameter_values": facts.parameter_values}
    values["condition_values"] = facts.condition_values
    shared |= {name: ("double", [v.hex() for v in of] or ["0"]) for name, of in values.items()}
    copies = copied_states(rhs)
    own = {f"copy_{word}": [str(pair[k]) for pair in copies] or ["0"] for k, word in enumerate(("to", "from"))}
    sizes = {f"{kind}s": len(of) for kind, of in names.items()}
    fields = [
        *(
            f".{word} = {_kernel(kernels[f'model_{word}'])}"
            for word in ("rhs", "jvp", "projection", "clearance")
            if f"model_{word}" in kernels
        ),
        *(f".{name} = {size}" for name, size in sizes.items()),
        f".constants = {start.assembly.numel_out(1)}, .depends = depends, .assembly = {_plain(start.assembly)}",
        *([] if start.gaps is None else [f".gaps = {_plain(start.gaps)}"]),
        *([] if start.holds is None else [f".holds = {_plain(start.holds)}"]),
        f".width = LANES, .invariants = {invariants}, .copies = {len(copies)}, .positions = {f.space.nq}",
        *(f".{name} = {name}" for name in ("state_names", *values, *own)),
    ]
    lines = [
        *(f"#define {name.upper()} {_array(entries)}" for name, (_, entries) in shared.items()),
        *(
            f"static const {kind} {name}[] = {name.upper()};"
            for name, (kind, _) in shared.items()
            if name in ("state_names", *values)
        ),
        *(f"static const long {name}[] = {_array(entries)};" for name, entries in own.items()),
        f"static const char depends[] = {_array([str(int(d)) for d in start.depends])};",
        f"const Model model = {{{', '.join(fields)}}};",
        "/* The same once more for other programs, which may put their own in its place. */",
        f"const char model_title[] = {_string(facts.title)};",
        *(f"const long model_{name} = {size};" for name, size in sizes.items()),
        *(f"const {kind} model_{name}[] = {name.upper()};" for name, (kind, _) in shared.items()),
    ]
    return "\n".join([_MODEL_HEAD, *translation_units(sources, 1), *lines, ""])


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
