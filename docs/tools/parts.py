"""One page for each part, from its docstring, its code and a script that is run while the page is made."""

from __future__ import annotations

import inspect
import os
import re
import shutil
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import groupby
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from tools.catalogue import Kind, catalogue
from tools.executed import executed
from tools.formulas import energies_of, formulas_of, with_symbols
from tools.scenes import own_script, script_of

import acausal as ac
import components
from acausal.language.component import Component, declared
from acausal.language.connector import Connector
from acausal.language.expression import Variable
from acausal.parts.joint import AbstractJoint


@dataclass(frozen=True)
class Shown:
    """What running a part's script gave: what it printed, states and operations of its model."""

    name: str
    script: str
    printed: str
    states: int
    operations: int


def write_pages(folder: Path) -> int:
    """Write `folder`/NAME.md for every kind and `folder`/index.md; returns how many. Raises `RuntimeError` where a script of `docs/scenes` fails."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    kinds = catalogue()
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        runs = {shown.name: shown for shown in pool.map(_run, kinds, [folder] * len(kinds), chunksize=4)}
    for kind in kinds:
        (folder / f"{kind.name}.md").write_text(_page(kind, runs[kind.name]), encoding="utf-8")
    (folder / "index.md").write_text(_index(kinds, runs), encoding="utf-8")
    return len(kinds)


def _run(kind: Kind, folder: Path) -> Shown:
    """A script that was written for it must run; one that a template made may not suit, and the index of the pages says so."""
    space: dict[str, Any] = {}
    try:
        script = script_of(kind)
        if not script:
            return Shown(kind.name, "", "", 0, 0)
        printed = executed(script, space, "picture.png", folder / f"{kind.name}.png")
    except Exception as error:
        if own_script(kind):
            raise RuntimeError(f"The script on the page of {kind.name} fails: {error}") from None
        return Shown(kind.name, "", str(error), 0, 0)
    model = space["model"]
    return Shown(kind.name, script, printed, len(model.state_names), model.operations)


def _page(kind: Kind, shown: Shown) -> str:
    lines = [f"# {kind.name}", "", markdown(kind.text), ""]
    if shown.script:
        lines += [f"```{{image}} {kind.name}.png", f":alt: the example below: {kind.name}", ":width: 60%", "```", ""]
    lines += [*_signature(kind), *_variables(kind.cls), *_laws(kind)]
    if shown.script:
        lines += [
            "## Example",
            "",
            f"```python\n{shown.script.strip()}\n```",
            "",
            "It prints:",
            "",
            f"```text\n{shown.printed.strip()}\n```",
            "",
        ]
        lines += [f"This scene has {shown.states} states and its accelerations take {shown.operations} operations.", ""]
    elif kind.example:
        lines += ["## Example", "", f"```python\n{kind.example}\n```", ""]
    users = _users(kind.name)
    if users:
        lines += [f"Seen at work in: {', '.join(users)}.", ""]
    module = kind.cls.__module__.replace(".", "/")
    return "\n".join([*lines, f"Its code: `{module}.py`. In Python: `help({kind.name})`.", ""])


def markdown(text: str) -> str:
    """A docstring as Markdown: what stands between backticks is code, everything else is as it is; indented lines are code."""
    paragraphs: list[str] = []
    for paragraph in filter(None, text.split("\n\n")):
        if all(line.startswith("    ") for line in paragraph.splitlines()):
            paragraphs.append(f"```python\n{inspect.cleandoc(paragraph)}\n```")
        else:
            pieces = paragraph.split("`")
            pieces[::2] = [re.sub(r"([\\*_<>\[\]#|])", r"\\\1", piece) for piece in pieces[::2]]
            paragraphs.append("`".join(pieces))
    return "\n\n".join(paragraphs)


def _signature(kind: Kind) -> list[str]:
    cls = kind.cls
    lines: list[str] = []
    if issubclass(cls, Component) and (ends := declared(cls, Connector)):
        rows = [(f"`{name}`", type(getattr(cls, name)).__name__, _first_line(type(getattr(cls, name)))) for name in ends]
        lines += ["## Connectors", "", *_table(("name", "kind", "what it is"), rows), ""]
    if cls.__init__ is not object.__init__:
        parameters = [p for p in list(inspect.signature(cls).parameters.values()) if p.kind is not p.VAR_KEYWORD]
        rows = [
            (f"`{p.name}`", _unit(p.name, kind), "needed" if p.default is p.empty else f"`{p.default!r}`") for p in parameters
        ]
        lines += ["## Parameters", "", *_table(("name", "unit", "default"), rows), ""] if rows else []
    makers = [
        (name, value)
        for name, value in inspect.getmembers(cls, inspect.ismethod)
        if not name.startswith("_") and name != "between"
    ]
    rows = [(f"`{kind.name}.{name}{_arguments(value)}`", markdown(_first_line(value))) for name, value in makers]
    lines += ["## Other ways to make one", "", *_table(("call", "what it makes"), rows), ""] if rows else []
    return lines


def _variables(cls: type) -> list[str]:
    if not issubclass(cls, Component) or not (names := declared(cls, Variable)):
        return []
    variables = [(name, getattr(cls, name)) for name in names]
    rows = [
        (f"`{name}`", v.description, v.unit or "1", "by its arguments" if not v.size else str(v.size)) for name, v in variables
    ]
    lines = ["## Variables", "", *_table(("name", "meaning", "unit", "size"), [tuple(map(_cell, row)) for row in rows]), ""]
    if issubclass(cls, AbstractJoint):
        lines += [
            f"Freedoms: {cls.v.size}. As a joint it transmits {6 - cls.v.size} of the six components of force and torque.",
            "",
        ]
    return lines


def _laws(kind: Kind) -> list[str]:
    part = _made(kind)
    if part is None:
        return []
    symbolic, _ = with_symbols(kind.cls, kind.text, part)
    lines: list[str] = []
    for title, found in (("Equations", formulas_of(symbolic)), ("Energy", energies_of(symbolic))):
        if found:
            lines += [f"## {title}", ""]
            for words, formula in found:
                lines += [f"{words}:", ""] if words else []
                lines += [f"$$\n{formula}\n$$", ""]
    return lines


def _made(kind: Kind) -> Component | None:
    """The part of the example in its docstring."""
    line = kind.example.splitlines()[0].split(";")[0] if kind.example else f"{kind.name}()"
    scene = ac.System()
    space = {"ac": ac, "np": np, "ca": ca, "scene": scene} | {name: getattr(components, name) for name in components.__all__}
    try:
        exec(line if line.startswith("scene.") else f"scene.part = {line}", space)
    except Exception:  # an example may name things that only its script has
        return None
    return next((value for value in vars(scene).values() if isinstance(value, kind.cls) and isinstance(value, Component)), None)


def _index(kinds: list[Kind], runs: dict[str, Shown]) -> str:
    lines = [
        "# Parts",
        "",
        "Every part of the catalogue. Each page is made from the part's own code, and its example was run when the page was made.",
        "",
    ]
    for group, members in groupby(kinds, lambda kind: kind.group):
        lines += [f"## {group}", ""]
        rows = [(f"[{k.name}]({k.name}.md)", _cell(markdown(k.summary)), _cost(runs[k.name])) for k in members]
        lines += [*_table(("part", "what it is", "states, operations of its example"), rows), ""]
    without = [kind.name for kind in kinds if kind.is_part and not runs[kind.name].script]
    if without:
        lines += [f"Without an example that runs: {', '.join(without)}.", ""]
    pages = "\n".join(kind.name for kind in kinds)
    return "\n".join([*lines, f"```{{toctree}}\n:hidden:\n\n{pages}\n```", ""])


def _cost(shown: Shown) -> str:
    return f"{shown.states}, {shown.operations}" if shown.script else ""


def _users(name: str) -> list[str]:
    """Gallery pages whose script names this part."""
    examples = Path(__file__).parents[2] / "examples"
    found = [
        path.stem
        for path in sorted(examples.rglob("*.py"))
        if re.search(rf"\b{name}\(|\b{name}\.", path.read_text(encoding="utf-8"))
    ]
    return [f"[{stem.replace('_', ' ')}](../gallery/{stem}.md)" for stem in found]


def _unit(name: str, kind: Kind) -> str:
    """What the docstring says in brackets, else what the constructor asks for."""
    found = re.search(rf"`{name}` (?:\([\w, ]*\) )?\[([^\]]+)\]", kind.text)
    found = found or re.search(
        rf'(?:scalar|vector)\((?:of_time\()?{name}\)?, "[^"]*"[^()]*unit="([^"]+)"', inspect.getsource(kind.cls)
    )
    return found[1].replace("*", r"\*") if found else ""


def _arguments(method: Any) -> str:
    return (
        "("
        + ", ".join(
            str(p).split(":")[0].replace("**", "") for p in inspect.signature(method).parameters.values() if p.name != "sketch"
        )
        + ")"
    )


def _first_line(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").split("\n")[0]


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", r"\|") if "\\|" not in text else " ".join(text.split())


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ("---",) * len(head), *rows)]
