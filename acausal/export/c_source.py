"""C source of a model's functions, and the way back: compile and load it in another process."""

from __future__ import annotations

import json
import os
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import casadi as ca

from acausal.arguments import path_of
from acausal.emit.compiler import compiler, run_compiler
from acausal.emit.library import suffix
from acausal.errors import ExportError
from acausal.outputs.functions import Functions

_README = """\
{title}: C code of a reduced mechanical model
==============================================

    {build}

Functions (see model.h), each called as `int f(const double** arg, double** res, long long int* iw, double* w, int mem)`:

{functions}

Arguments: t [s]; x, the {nx} states; u, the {nu} inputs; p, the {np} parameters, in the order given in model.json.
Work space: `f_work(&sz_arg, &sz_res, &sz_iw, &sz_w)`. A NULL result is not computed.

derivatives.c has for each function f its derivative along one direction, fwd1_f, backwards, adj1_f, and the first of the second, as CasADi
calls them: with these `ca.external` differentiates f twice. It may be left out. Two models in one program: compile each with a prefix of its own,
-DMODEL_PREFIX=arm_, and define the same before its headers are included.
"""
_PREFIX = """\
#ifdef MODEL_PREFIX
#ifndef MODEL_NAME
#define MODEL_PASTE(prefix, name) prefix##name
#define MODEL_JOIN(prefix, name) MODEL_PASTE(prefix, name)
#define MODEL_NAME(name) MODEL_JOIN(MODEL_PREFIX, name)
#endif
"""


def export_c(model: Functions, folder: str | Path) -> Path:
    """Write model.c and model.h, their derivatives, model.json (names, sizes, parameter values) and README.txt with a build line.

    The C is plain C99 with libm and needs nothing of acausal or CasADi. Raises `ExportError` when a file cannot be written.
    """
    target = path_of(folder, "export_c: the folder")
    functions = _exported(model)
    try:
        target.mkdir(parents=True, exist_ok=True)
        _generate(target, "model", functions)
        _generate(target, "derivatives", [d for f in functions for d in _derivatives(f)])
        facts = {
            "title": model.outputs.system.flat.name,
            "functions": [f.name() for f in functions],
            "states": list(model.state_names),
            "inputs": list(model.input_names),
            "parameters": list(model.parameter_names),
            "parameter_values": model.space.p_values.tolist(),
        }
        (target / "model.json").write_text(json.dumps(facts, indent=2), encoding="utf-8")
        text = _README.format(
            title=facts["title"], build=build_line("model.c derivatives.c", "model" + suffix()),
            functions="\n".join(f"    {f}" for f in functions), nx=len(model.state_names), nu=len(model.input_names), np=len(model.parameter_names),
        )  # fmt: skip
        (target / "README.txt").write_text(text, encoding="utf-8")
    except OSError as error:
        raise ExportError(f"export_c: cannot write to '{target}': {error}.") from error
    return target


def _exported(f: Functions) -> list[ca.Function]:
    found = [
        f.explicit_dynamics,
        f.residual_dynamics,
        f.kinetic_energy,
        f.potential_energy,
        f.constraint_position,
        f.constraint_velocity,
    ]
    return found + [extra for extra in (f.invariants, f.projection, f.holds) if extra is not None]


def _derivatives(function: ca.Function) -> list[ca.Function]:
    """Along one direction, backwards, and backwards along one direction: with these CasADi makes Jacobians and Hessians."""
    backwards = function.reverse(1)
    return [function.forward(1), backwards, backwards.forward(1)]


def _generate(target: Path, name: str, functions: list[ca.Function]) -> None:
    """C and header of functions. With MODEL_PREFIX defined, all that other files see begins with it."""
    generator = ca.CodeGenerator(name, {"with_header": True, "casadi_int": "long long int"})
    for function in functions:
        generator.add(function)
    with tempfile.TemporaryDirectory() as scratch:
        generator.generate(scratch + os.sep)
        source, header = ((Path(scratch) / f"{name}.{kind}").read_text(encoding="utf-8") for kind in "ch")
    seen = sorted(set(re.findall(r"^(?:CASADI_SYMBOL_EXPORT|extern) .*?(\w+)\(", source, re.MULTILINE)))
    renamed = "\n".join(f"#define {symbol} MODEL_NAME({symbol})" for symbol in seen)
    prefix = f"{_PREFIX}{renamed}\n#endif\n"
    # CasADi's helpers: it looks for the first name and takes the second
    own = f"#ifdef MODEL_PREFIX\n#define CASADI_CODEGEN_PREFIX\n#define CODEGEN_PREFIX MODEL_NAME({name}_)\n#endif\n"
    (target / f"{name}.c").write_text(prefix + own + source, encoding="utf-8")
    (target / f"{name}.h").write_text(prefix + header, encoding="utf-8")


def build_line(source: str, library: str) -> str:
    """A command that makes a shared library of the exported C."""
    return f"cc -O2 -fPIC -shared -o {library} {source} -lm"


@dataclass(frozen=True)
class LoadedModel:
    """Functions of an exported model, compiled and loaded: `loaded["explicit_dynamics"](t, x, u, p)`; differentiable twice."""

    folder: Path
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    parameter_values: tuple[float, ...]
    names: tuple[str, ...]

    def __getitem__(self, name: str) -> ca.Function:
        if name not in self.names:
            raise ExportError(f"The exported model in '{self.folder}' has no function '{name}'. It has: {', '.join(self.names)}.")
        return ca.external(name, str(self.folder / ("model" + suffix())))


def load_c(folder: str | Path) -> LoadedModel:
    """Compile (where that was not done) and load an exported model. Raises `ExportError` without a C compiler, or if it fails."""
    target = Path(folder).resolve()
    library = target / ("model" + suffix())
    sources = [target / "model.c", *target.glob("derivatives.c")]
    if not sources[0].exists():
        raise ExportError(f"'{target}' holds no exported model: there is no model.c. Write one with model.export_c(folder).")
    if not library.exists() or any(library.stat().st_mtime < source.stat().st_mtime for source in sources):
        _compile(sources, library)
    facts = json.loads((target / "model.json").read_text(encoding="utf-8"))
    return LoadedModel(target, *(tuple(facts[k]) for k in ("states", "inputs", "parameters", "parameter_values", "functions")))


def _compile(sources: list[Path], library: Path) -> None:
    found = compiler()
    if found is None:
        raise ExportError("No C compiler was found (cc, gcc, clang). Install one, or ziglang from PyPI: pip install ziglang.")
    with tempfile.TemporaryDirectory(dir=library.parent) as scratch:
        parts: list[str] = []
        for source in sources:
            parts.append(str(Path(scratch) / f"{source.stem}.o"))
            # derivatives are long, and optimising compilers take more than linear time
            run_compiler([*found, "-O2" if source.stem == "model" else "-O0", "-fPIC", "-c", "-o", parts[-1], str(source)])
        made = Path(scratch) / library.name
        run_compiler([*found, "-shared", "-o", str(made), *parts, "-lm"])
        os.replace(made, library)
