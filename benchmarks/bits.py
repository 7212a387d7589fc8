"""Which bits are the same? Hashes of motions by lanes, compilers and ways to carry them out, into docs/bits.md.

python -m benchmarks.bits [--lanes 1 2 4 8] [--exported] [--only NAME ...]

Each column is a process of its own, told by $CC which compiler is used and with how many lanes. `--exported`: exported simulators, too, which are
compiled one by one (minutes).
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.util
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import acausal as ac
from acausal.runtime import load
from acausal.runtime.kernels import How
from acausal.runtime.native import native_problem
from tests.hard_cases import CASES, HardCase
from tests.test_export_switches import END, METHODS, Machine

PAGE = Path(__file__).parents[1] / "docs" / "bits.md"
LONG = ("kepler_1000_turns",)
SAMPLES = 41
Hashes = dict[str, str]


def short(*arrays: np.ndarray) -> str:
    """Six digits of a hash of all bits."""
    return hashlib.sha256(b"\0".join(np.ascontiguousarray(a, dtype=float).tobytes() for a in arrays)).hexdigest()[:6]


@contextlib.contextmanager
def carried_out(model: ac.Model, how: How) -> Iterator[None]:
    """Kernels of a model by the interpreter, or compiled."""
    kept = model.functions._native._kept
    kept[How.AUTO] = native_problem(model.functions.integrand, how)
    try:
        yield
    finally:
        kept.clear()


def started(case: HardCase) -> dict[ac.Expression, object]:
    return {**case.rough, **case.start}


class Scenes:
    """Motions by name, each with its model: hard cases by auto and radau; a machine with switches, inputs of all kinds and stiffness; sensitivities."""

    def __init__(self, only: list[str]) -> None:
        self.machine = Machine()
        self.model = ac.build(self.machine)
        self.start = {self.machine.rail.q: 0.3, self.machine.rail.v: 0.5}
        self.names = [
            n
            for n in [*CASES, "switches and inputs", "switches and inputs, stiff", "fixed steps", "events", "sensitivities"]
            if n not in LONG
        ]
        self.names = [n for n in self.names if not only or n in only]

    def model_of(self, name: str) -> ac.Model:
        """Of a scene."""
        return CASES[name]().model if name in CASES else self.model

    def hash(self, name: str) -> str:
        """Of states at the ends of all steps and between."""
        scene = self.machine
        if name == "sensitivities":
            wrt = [scene.damping, scene.relay, scene.plain]
            found = self.model.sensitivities(np.linspace(0, END, SAMPLES), wrt, self.start, rtol=1e-9).found
            return short(found.x, found.S)
        runs = [self.run(name, method) for method in ("auto", "radau")]
        times = [np.array([event.time for event in run.events]) for run in runs]
        return short(*times, *(part for run in runs for part in (run.solution.t, run.solution.x, run.x)))

    def run(self, name: str, method: str) -> ac.Trajectory:
        """A motion of a scene."""
        if name in CASES:
            case = CASES[name]()
            return case.model.simulate(case.end, started(case), rtol=1e-9, method=method, samples=SAMPLES, raise_on_failure=False)
        options: dict[str, object] = {"rtol": 1e-9}
        if name == "fixed steps":
            options = {"step": 0.01}
        damping = 1e5 if "stiff" in name else 0.1
        events = [ac.when(self.machine.rail.v)] if name == "events" else []
        return self.model.simulate(
            END, self.start, parameters={self.machine.damping: damping, self.machine.relay: 0.5}, inputs=self.machine.inputs(), method=method,
            events=events, samples=SAMPLES, **options,
        )  # fmt: skip

    def exported(self, name: str, lanes: int) -> str:
        """The same of exported simulators: a scene's samples alone."""
        from tests.exported import Library

        model = self.model_of(name)
        case = CASES[name]() if name in CASES else None
        with tempfile.TemporaryDirectory() as folder:
            start, inputs = (started(case), None) if case else (self.start, self.machine.inputs())
            library = Library(model.export_simulator(Path(folder) / "x", start, inputs=inputs), lanes=lanes)
            times = np.linspace(0, case.end if case else END, SAMPLES)
            values: dict[str, object] = {"step": 0.01} if name == "fixed steps" else {"rtol": 1e-9}
            p = None if case else [1e5 if "stiff" in name else 0.1, 0.5, 0.0]
            found = [
                library.simulate(times, p=p, options=library.options(method=METHODS[m], **values))[1] for m in ("auto", "radau")
            ]
        expected = [self.run(name, method).at(times).x for method in ("auto", "radau")]
        return "" if all(map(np.array_equal, found, expected)) else short(*found)


def column(only: list[str], exported: bool) -> dict[str, Hashes]:
    """Hashes of all scenes in this process, by scene and way."""
    scenes, found = Scenes(only), dict[str, Hashes]()
    load.variants = tuple  # not those that the installation has made: $CC says by what, and for how many lanes
    library = load.runtime()
    assert library is not None
    for name in scenes.names:
        model = scenes.model_of(name)
        found[name] = {}
        for how in (How.INTERPRETED, How.COMPILED):
            with carried_out(model, how):
                found[name][how.value] = scenes.hash(name)
        if exported and name not in ("events", "sensitivities"):
            other = scenes.exported(name, library.lanes)
            found[name]["exported"] = other or found[name]["compiled"]
        print(name, found[name], file=sys.stderr, flush=True)
    return found


def compilers() -> dict[str, str]:
    """Those at hand, by name."""
    found = {"gcc": "gcc"} if shutil.which("gcc") else {}
    if shutil.which("clang"):
        found["clang"] = "clang"
    elif importlib.util.find_spec("ziglang") is not None:
        found["clang (zig)"] = f"{sys.executable} -m ziglang cc"
    return found


def page(columns: dict[str, dict[str, Hashes]]) -> str:
    """Markdown: a row for each scene, its hash, and where another one came out."""
    names = list(next(iter(columns.values())))
    lines = [HEAD.format(machine=f"{platform.machine()}, {platform.system()}, {platform.libc_ver()[0]} {platform.libc_ver()[1]}")]
    lines += ["| | hash | " + " | ".join(columns) + " |", "|---" * (len(columns) + 2) + "|"]
    different = 0
    for name in names:
        hashes = [columns[c][name] for c in columns]
        first = hashes[0]["interpreted"]
        cells = []
        for by in hashes:
            others = [f"{how}: {value}" for how, value in by.items() if value != first]
            different += len(others)
            cells.append("; ".join(others) or "=" * len(by))
        lines.append(f"| {name} | {first} | " + " | ".join(cells) + " |")
    lines.append(
        f"\n{len(names)} scenes, {sum(len(by) for c in columns.values() for by in c.values())} hashes, {different} of them others.\n"
    )
    return "\n".join(lines)


HEAD = """\
# The same bits

`python -m benchmarks.bits --exported` writes this page. A row is a scene: those of tests/hard_cases.py, a machine with switches of states and of
time, tables and formulas as inputs, stiffness, events and sensitivities (tests/test_export_switches.py), by methods auto and radau. The hash is that of
all bits of the states, at the ends of steps and between, and of their times. A column is a compiler and a number of lanes, for the runtime and the
kernels; each = in it is a way to carry the motion out: the interpreter, compiled kernels, exported simulator (compiled with less optimisation).

What holds, and what tests/test_export_hard_cases.py and tests/test_export_switches.py hold:

- Interpreted and compiled kernels give the same bits, always, and so does an exported simulator: whether there is a compiler, and when it is ready, does
  not matter.
- The number of lanes does not matter, where the processor has fused multiply-adds (x86 since 2013, all of ARM's 64 bits). Costs are counted, samples
  are taken and sums are ordered as for eight lanes, whatever there is. Without fused multiply-adds bits are others.
- Compilers and C libraries do not matter: nothing that rounds is left to them.
- Threads, the cache, and the order of runs in a process do not matter.

{machine}
"""


def main() -> None:
    """Prints the page, and writes it where everything was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanes", type=int, nargs="*", default=[1, 2, 4, 8])
    parser.add_argument("--exported", action="store_true")
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--column", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.column:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            print(json.dumps(column(asked.only, asked.exported)))
        return
    columns: dict[str, dict[str, Hashes]] = {}
    for name, command in compilers().items():
        for lanes in asked.lanes:
            environment = {**os.environ, "CC": f"{command} -DLANES={lanes}"}
            line = [
                sys.executable,
                "-m",
                "benchmarks.bits",
                "--column",
                *(["--exported"] if asked.exported and name == "gcc" else []),
            ]
            made = subprocess.run(
                [*line, *(["--only", *asked.only] if asked.only else [])], env=environment, stdout=subprocess.PIPE, check=True
            )
            columns[f"{name}, {lanes}"] = json.loads(made.stdout)
    text = page(columns)
    print(text)
    if not asked.only:
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
