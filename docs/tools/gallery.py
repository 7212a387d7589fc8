"""One page for each script in `examples`: run while the page is made, its numbers checked, its motion shown."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import shutil
import tempfile
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from tools.parts import markdown

_CHAPTERS = {".": "Examples", "machines": "Machines", "control": "Optimal control", "classical": "Classical systems"}
_WORDS = (
    "Each picture is a script of the folder `examples`, which was run when its page was made. Its page has the script, the motion to look at from all sides, "
    "and the numbers by which it was checked: closed forms, references, conserved quantities."
)
EXAMPLES = Path(__file__).parents[2] / "examples"


@dataclass(frozen=True)
class Machine:
    """A `script` that ran: its folder's chapter, name, title and text, what it printed, the number that it returned, and its own bound of that."""

    script: Path
    title: str
    text: str
    printed: str
    error: float
    limit: float

    @property
    def name(self) -> str:
        """Of the file."""
        return self.script.stem

    @property
    def place(self) -> str:
        """Path of the file in the repository."""
        return self.script.relative_to(EXAMPLES.parent).as_posix()


def write_pages(folder: Path, motions: Path) -> list[Machine]:
    """Write `folder`/NAME.md and pictures, motions into `motions`; returns what ran. Raises `RuntimeError` where a number is larger than its bound."""
    for place in (folder, motions):
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
    scripts = sorted(EXAMPLES.rglob("*.py"))
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        machines = list(pool.map(_run, scripts, [folder] * len(scripts), [motions] * len(scripts)))
    for machine in machines:
        (folder / f"{machine.name}.md").write_text(_page(machine), encoding="utf-8")
    (folder / "index.md").write_text(_index(machines), encoding="utf-8")
    return machines


def _run(script: Path, folder: Path, motions: Path) -> Machine:
    name, printed = script.stem, io.StringIO()
    specification = importlib.util.spec_from_file_location(name, script)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    with tempfile.TemporaryDirectory() as place, contextlib.redirect_stdout(printed), warnings.catch_warnings():
        warnings.simplefilter("error")
        specification.loader.exec_module(module)
        error = float(module.main(place))
        shutil.copy(Path(place) / f"{name}.png", folder)
        shutil.copy(Path(place) / f"{name}.html", motions)
        told = printed.getvalue().replace(f"{place}/", "out/")
    if not error < module.LIMIT:
        raise RuntimeError(f"{script} returns {error:.1e}, which must be below {module.LIMIT:.0e}.")
    title, _, text = (module.__doc__ or name).partition("\n")
    return Machine(script, title, text.strip(), told.strip(), error, module.LIMIT)


def _page(machine: Machine) -> str:
    script = machine.script.read_text(encoding="utf-8")
    heading, _, more = machine.title.rstrip(".").partition(": ")
    text = machine.text.replace(f"python {machine.place}", "").strip()
    return "\n".join([
        f"# {markdown(heading)}", "",
        markdown(f"{more[:1].upper()}{more[1:]}.") if more else "", "", markdown(text), "",
        "```{raw} html", f'<iframe class="motion" src="../_static/gallery/{machine.name}.html" title="{machine.name}"></iframe>', "```", "",
        "Drag to turn, scroll to come nearer.", "",
        "## Script", "", f"`{machine.place}`", "", f"```python\n{script.strip()}\n```", "",
        "## Numbers", "",
        f"When this page was made the script printed what follows and returned {machine.error:.1e}; at {machine.limit:.0e} or more there would be no page.", "",
        f"```text\n{machine.printed}\n```", "",
        f"```{{image}} {machine.name}.png", f":alt: {machine.name}", ":width: 70%", "```", "",
    ])  # fmt: skip


def _index(machines: list[Machine]) -> str:
    lines = ["# Gallery", "", _WORDS, ""]
    for folder, title in _CHAPTERS.items():
        members = [m for m in machines if m.script.parent.relative_to(EXAMPLES).as_posix() == folder]
        if members:
            cards = "\n".join(_card(m) for m in members)
            lines += [f"## {title}", "", f"::::{{grid}} 2 3 3 3\n:gutter: 2\n\n{cards}\n::::", ""]
    pages = "\n".join(m.name for m in machines)
    return "\n".join([*lines, f"```{{toctree}}\n:hidden:\n\n{pages}\n```", ""])


def _card(machine: Machine) -> str:
    title = markdown(machine.title.rstrip(".").partition(": ")[0])
    return f":::{{grid-item-card}} {title}\n:img-top: {machine.name}.png\n:link: {machine.name}\n:link-type: doc\n:::\n"
