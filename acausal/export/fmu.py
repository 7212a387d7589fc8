"""A motion as a Functional Mock-up Unit: what other simulation programs take for co-simulation (FMI 2.0, fmi-standard.org)."""

from __future__ import annotations

import hashlib
import json
import platform
import re
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from acausal.arguments import path_of
from acausal.emit.compiler import compiler, run_compiler, run_compilers
from acausal.emit.library import FLAGS, suffix, variants
from acausal.errors import ExportError
from acausal.export.simulator import Beginning, export_simulator
from acausal.language.expression import Expression
from acausal.language.when import when

GLUE = Path(__file__).resolve().parent / "unit" / "fmi2.c"
"""The interface around instances of an exported simulator."""
_STRUCTURED = re.compile(r"[A-Za-z_]\w*(\[\d+(,\d+)*\])?(\.[A-Za-z_]\w*(\[\d+(,\d+)*\])?)*")
_DATE = (1980, 1, 1, 0, 0, 0)
"""Of all files within: the same model gives the same unit."""


def export_fmu(
    path: str | Path, motion: Beginning, *, outputs: Mapping[str, Expression] | None = None, events: Sequence[when] = ()
) -> Path:
    """Write a unit, with its sources, compiled for the kind of machine that it is written on; see `export_simulator`.

    Its outputs are `outputs`, or the states where none are named. Raises `ExportError` for what `export_simulator` cannot write, a file whose
    name is no identifier, variables that are called the same, and where there is no C compiler.
    """
    target = path_of(path, "export_fmu: the file")
    target = target if target.suffix == ".fmu" else target.with_name(f"{target.name}.fmu")
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", target.stem):
        raise ExportError(f"export_fmu: '{target.name}' cannot name a unit. Give a word of letters and digits: 'arm.fmu'.")
    if compiler() is None:
        raise ExportError(
            "export_fmu: there is no C compiler. Install gcc or clang, or `pip install ziglang`; `export_simulator` writes sources without one."
        )
    with tempfile.TemporaryDirectory(prefix="acausal-") as scratch:
        sources = Path(scratch) / "sources"
        export_simulator(sources, motion, name=target.stem, outputs=outputs, events=events)
        guid = _guid(sources)
        glue = GLUE.read_text(encoding="utf-8").replace("simulator", target.stem).replace("SIMULATOR", target.stem.upper())
        (sources / GLUE.name).write_text(glue.replace("{guid}", guid), encoding="utf-8")
        given = [name for name, course in zip(motion.model.input_names, motion.inputs.courses, strict=True) if callable(course)]
        found = len(motion.model.outputs.system.flat.parameters)
        description = _description(
            target.stem, guid, json.loads((sources / "model.json").read_text(encoding="utf-8")), given, found
        )
        library = _compiled(sources, target.stem)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            with zipfile.ZipFile(target, "w") as unit:
                _put(unit, "modelDescription.xml", description)
                _put(unit, f"binaries/{_platform()}/{target.stem}{suffix()}", library.read_bytes())
                for file in sorted(sources.iterdir()):
                    if (
                        file.suffix != ".o"
                        and file != library
                        and file.name not in ("main.c", "Makefile", "CMakeLists.txt", "README.txt")
                    ):
                        _put(unit, f"sources/{file.name}", file.read_bytes())
        except OSError as error:
            raise ExportError(f"export_fmu: cannot write '{target}': {error}.") from error
    return target


def _put(unit: zipfile.ZipFile, name: str, content: bytes) -> None:
    entry = zipfile.ZipInfo(name, _DATE)
    entry.external_attr = 0o755 << 16 if name.startswith("binaries") else 0o644 << 16
    unit.writestr(entry, content, zipfile.ZIP_DEFLATED)


def _guid(sources: Path) -> str:
    """Of what has been written, in the form of such numbers."""
    content = hashlib.sha256()
    for file in sorted(sources.iterdir()):
        content.update(file.name.encode() + b"\0" + file.read_bytes())
    d = content.hexdigest()
    return f"{{{d[:8]}-{d[8:12]}-{d[12:16]}-{d[16:20]}-{d[20:32]}}}"


def _platform() -> str:
    """The folder of binaries for this kind of machine, by the names of FMI 2.0; by those of FMI 3.0 where it has none."""
    system = {"linux": "linux", "darwin": "darwin", "win32": "win"}.get(sys.platform, sys.platform)
    machine = platform.machine().lower()
    return f"{system}64" if machine in ("x86_64", "amd64") else f"{machine}-{sys.platform}"


def _compiled(sources: Path, name: str) -> Path:
    """The shared library, for all processors of the kind that have fused multiply-adds: half of the newest ones' lanes, and the same numbers."""
    command = compiler()
    assert command is not None
    usual = variants()[min(1, len(variants()) - 1)].flags(command)
    units = [sources / f"{part}.c" for part in (GLUE.stem, name, "model", "runtime")]
    objects = [unit.with_suffix(".o") for unit in units]
    flags = [*FLAGS, *usual, "-I", str(sources)]
    run_compilers([[*command, *flags, "-c", "-o", str(o), str(u)] for o, u in zip(objects, units, strict=True)])
    made = sources / (name + suffix())
    run_compiler([*command, "-shared", "-o", str(made), *map(str, objects), "-lm"])
    return made


def _description(name: str, guid: str, facts: Mapping[str, Any], given: Sequence[str], parameters: int) -> bytes:
    """modelDescription.xml. `given`: inputs that are tables and formulas; `parameters`: how many are no constants of integration."""
    start = "start"
    taken = {*facts["states"], *facts["inputs"], *facts["parameters"], *facts["outputs"]}
    while any(f"{start}.{condition}" in taken for condition in facts["conditions"]):
        start += "_"
    fixed = {"causality": "local", "variability": "fixed", "initial": "calculated"}
    local = {"causality": "local", "variability": "continuous", "initial": "calculated"}
    shown = {**local, "causality": "output"}
    variables: list[tuple[str, str, dict[str, str], float | None]] = []
    for state, unit in zip(facts["states"], facts["state_units"], strict=True):
        variables.append((state, unit, local if facts["outputs"] else shown, None))
    for entry, unit, value in zip(facts["inputs"], facts["input_units"], facts["input_values"], strict=True):
        free = {"causality": "input", "variability": "continuous"}
        variables.append((entry, unit, local, None) if entry in given else (entry, unit, free, value))
    for k, (entry, unit, value) in enumerate(
        zip(facts["parameters"], facts["parameter_units"], facts["parameter_values"], strict=True)
    ):
        tuned = {"causality": "parameter", "variability": "tunable", "initial": "exact"}
        variables.append((entry, unit, tuned, value) if k < parameters else (entry, unit, fixed, None))
    for entry, unit, value in zip(facts["conditions"], facts["condition_units"], facts["condition_values"], strict=True):
        first = {"causality": "parameter", "variability": "fixed", "initial": "exact"}
        variables.append((f"{start}.{entry}", unit, first, value))
    variables += [(output, unit, shown, None) for output, unit in zip(facts["outputs"], facts["output_units"], strict=True)]
    _check_names(entry for entry, *_ in variables)

    structured = all(_STRUCTURED.fullmatch(entry) for entry, *_ in variables)
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=str(facts["title"]),
        guid=guid,
        generationTool="acausal",
        variableNamingConvention="structured" if structured else "flat",
        numberOfEventIndicators="0",
    )
    unit = ElementTree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=name,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true",
    )
    files = ElementTree.SubElement(unit, "SourceFiles")
    for file in (GLUE.name, f"{name}.c", "model.c", "runtime.c"):
        ElementTree.SubElement(files, "File", name=file)
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for word in sorted({word for _, word, *_ in variables if word}):
        ElementTree.SubElement(units, "Unit", name=word)
    if not len(units):
        root.remove(units)
    categories = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(categories, "Category", name="logStatusError")
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0", tolerance="1e-8")
    listed = ElementTree.SubElement(root, "ModelVariables")
    structure = ElementTree.SubElement(root, "ModelStructure")
    results = [k for k, (_, _, kind, _) in enumerate(variables) if kind is shown]
    for k, (entry, word, kind, value) in enumerate(variables):
        variable = ElementTree.SubElement(listed, "ScalarVariable", {"name": entry, "valueReference": str(k), **kind})
        number = ElementTree.SubElement(variable, "Real", {"unit": word} if word else {})
        if value is not None:
            number.set("start", repr(float(value)))
    for place in ("Outputs", "InitialUnknowns"):
        if results:
            group = ElementTree.SubElement(structure, place)
            for k in results:
                ElementTree.SubElement(group, "Unknown", index=str(k + 1))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _check_names(names: Iterable[str]) -> None:
    """Raises `ExportError` where one occurs twice."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ExportError(f"export_fmu: there are two variables '{name}'. Give the output another name.")
        seen.add(name)
