"""Simulation of one model in C that stands by itself: its kernels, the integrators, instances of its motion, and a program that prints one."""

from __future__ import annotations

import functools
import importlib.metadata
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from acausal.arguments import dictionary, path_of
from acausal.collocation.inputs import Formula, Inputs
from acausal.emit.library import SOURCES
from acausal.errors import ExportError
from acausal.export.model_c import Kind, methods_c, model_c, string
from acausal.export.start_functions import StartFunctions, start_c, start_functions
from acausal.language.expression import Expression
from acausal.language.pieces import PiecewisePolynomial
from acausal.language.when import when
from acausal.outputs.clocks import clocks
from acausal.outputs.expression_names import expression_name, expression_unit
from acausal.outputs.functions import Functions
from acausal.outputs.state_units import state_units
from acausal.simulate.events import events_asked
from acausal.start.initial import InitialState

PROGRAM = Path(__file__).resolve().parent / "program"
"""Folder of the C sources that are the same for all models but for a name."""
_README = """\
{heading}
{line}

    cc -O2 -march=native -ffp-contract=off -fno-math-errno -o simulator main.c simulator.c model.c runtime.c -lm
    ./simulator 10 > motion.csv

or `make`, or CMake. It needs a C99 compiler with vector extensions (GCC, Clang) and libm, nothing else. Leave out -march=native for a
program that runs on other processors too. All files must be compiled with the same flags; with -Wall, add -Wno-psabi.

    ./simulator end [samples] [rtol] [method]

prints states and outputs at equally spaced times from 0 to `end` seconds, separated by commas; events go to the other stream. `method`:
auto, gauss, or radau.

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


@dataclass(frozen=True, eq=False)
class Beginning:
    """A motion of a `model` from `initial` on, with the values of its parameters. `inputs`: numbers, tables and formulas of time. `discretes`: values that what parts remember begins with;
    no number where they follow from the start.
    """

    model: Functions
    initial: InitialState
    inputs: Inputs
    discretes: np.ndarray | None = None


def export_simulator(
    folder: str | Path,
    motion: Beginning,
    *,
    name: str = "simulator",
    outputs: Mapping[str, Expression] | None = None,
    events: Sequence[when] = (),
) -> Path:
    """Write a simulator in C (main.c, simulator.h, model.c, ...), model.json and README.txt with a build line into a folder of its own.

    `name`: an identifier that all its names begin with, and its header. `outputs`: expressions of the scene's variables that it computes, by names. `events`: zeros that it looks for; places
    where a part has no meaning any more follow them, and end the motion. The numbers are those of `model.simulate`, to the bit where lanes are the same. Raises `ExportError` for functions that have no C, inputs that
    are functions of Python, a name that is no identifier, and when a file cannot be written.
    """
    model, initial, inputs = motion.model, motion.initial, motion.inputs
    target, named_by = path_of(folder, "export_simulator: the folder"), model.outputs.system.flat.symbols
    known = dictionary({} if outputs is None else outputs, "outputs", '{"angle": scene.hinge.q}')
    outputs = {key: named_by(value) for key, value in known.items()}
    events = [replace(event, expression=named_by(event.expression)) for event in events_asked(events, "export_simulator")]
    _check_inputs(model, inputs)
    model = model.setting(tuple(event for event in events if event.set is not None))
    start = start_functions(model, initial)
    kinds = _kinds(model, initial, start, outputs, events, inputs)
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
        "model.c": model_c(model, title, kinds, start, outputs, events, inputs, motion.discretes),
        "assembly.h": start_c(start, f"{name}_hidden_"),
        "methods.h": methods_c(),
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
        "{version}": string(f"acausal {importlib.metadata.version('acausal')}"),
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


def _check_inputs(model: Functions, inputs: Inputs) -> None:
    """Raises `ExportError` for inputs that cannot be written as data."""
    for name, course in zip(model.input_names, inputs.courses, strict=True):
        if isinstance(course, Formula):
            found = clocks(course.function)
            if found is not None and found.others.any():
                raise ExportError(
                    f"export_simulator: the input {name} is an expression of ac.time that switches at times which do not follow one another regularly. "
                    f"Give its knots: ac.samples(times, values); write it into the scene; or set it on the way, by `options.input`."
                )
        elif callable(course) and not isinstance(course, PiecewisePolynomial):
            raise ExportError(
                f"export_simulator: the input {name} is a function of Python. Give a number, ac.samples(times, values), a spline or an expression of "
                "ac.time; or leave it out, and write it as the function `options.input` in C."
            )


def _is_template(path: Path) -> bool:
    return path.suffix in (".c", ".h") or path.name in ("Makefile", "CMakeLists.txt")


def _check_name(name: str, templates: Mapping[str, str]) -> None:
    """Raises `ExportError` for what is no identifier of C, or makes names that are in the files already."""
    name = name if isinstance(name, str) else ""  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
    words = _words("\n".join([*templates, *templates.values()]))
    own = {word for word in words if re.match("simulator[_.]", word.lower())}
    made = {word.replace("simulator", name).replace("SIMULATOR", name.upper()) for word in own}
    taken = sorted(made & (words - own))
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or taken:
        raise ExportError(
            f"export_simulator: name={name!r} cannot be what the names of C functions begin with"
            + (f", since there is a '{taken[0]}' already" if taken else "")
            + ". Give another word of letters and digits: 'arm'."
        )


@functools.lru_cache(maxsize=1)
def _words(text: str) -> frozenset[str]:
    """Of the files, which are the same for all models."""
    return frozenset(re.findall(r"[A-Za-z_]\w*(?:\.[ch]\b)?", text))


def _kinds(
    model: Functions, initial: InitialState, start: StartFunctions, outputs: Mapping[str, Expression], events: Sequence[when], inputs: Inputs
) -> dict[str, Kind]:  # fmt: skip
    """In the order of `simulator_kind`."""
    for event in events:
        if model.outputs.resolve(event.expression).numel() != 1:
            raise ExportError(
                f"export_simulator: {event.expression!r} in `events` is not a scalar; give one event for each entry."
            )
    flat = model.outputs.system.flat
    own = len(flat.inputs) - model.integrand.masks
    watched = flat.symbols([event.expression for event in events])
    borders = [row for border in model.borders for row in border.rows]
    constants = model.space.elimination.constants.numel()
    entries = {key: model.outputs.resolve(value).numel() for key, value in outputs.items()}
    shown = [(key + (f"[{k}]" if n > 1 else ""), expression_unit(outputs[key])) for key, n in entries.items() for k in range(n)]
    found = [
        Kind("state", model.state_names, state_units(model), tuple(initial.x.tolist())),
        Kind(
            "input",
            model.input_names[:own],
            tuple(i.unit for i in flat.inputs[:own]),
            tuple(inputs(np.zeros(1))[:own, 0].tolist()),
        ),
        Kind(
            "parameter", model.parameter_names, (*(p.unit for p in flat.parameters), *[""] * constants), tuple(initial.p.tolist())
        ),
        Kind("condition", start.names, start.units, start.values),
        Kind("output", tuple(n for n, _ in shown), tuple(u for _, u in shown), (float("nan"),) * len(shown)),
        Kind(
            "event",
            (*(expression_name(model.outputs, e) for e in watched), *borders),
            (*(expression_unit(e) for e in watched), *("" for _ in borders)),
            (float("nan"),) * (len(events) + len(borders)),
        ),
    ]
    return {kind.word: kind for kind in found}


def _facts(title: str, kinds: Mapping[str, Kind]) -> dict[str, Any]:
    """What model.json holds."""
    facts: dict[str, Any] = {"title": title}
    for kind in kinds.values():
        facts |= {f"{kind.word}s": kind.names, f"{kind.word}_units": kind.units}
    return facts | {
        "start": kinds["state"].values,
        **{f"{word}_values": kinds[word].values for word in ("input", "parameter", "condition")},
    }


def _indices(kind: Kind, prefix: str) -> str:
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
