"""The house: which room may know which. An import goes down or sideways, also those for types only, and no two files need one another."""

from __future__ import annotations

import ast
import functools
import importlib
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import networkx as nx
import pytest

import acausal
from acausal.graphs import Graph, least_tree

FLOORS = (
    ("errors", "wording", "graphs", "moved"),
    ("language",),
    ("arguments",),
    ("numerics",),
    ("emit",),
    ("collocation",),
    ("runtime",),
    ("parts",),
    ("topology",),
    ("dynamics",),
    ("loops",),
    ("scalar",),
    ("reduce",),
    ("outputs",),
    ("start",),
    ("integrators",),
    ("visual",),
    ("charts",),
    ("simulate",),
    ("analysis", "optimal_control", "export", "explain"),
    ("abstract_model",),
    ("minimal",),
    ("model",),
    ("__init__",),
)
"""From the ground up: a file knows its own room and those on floors below."""

ROOT = Path(acausal.__file__).parent
FILES = {".".join(path.with_suffix("").relative_to(ROOT).parts): path for path in sorted(ROOT.rglob("*.py"))}


@functools.cache
def parsed(path: Path) -> ast.Module:
    """Source as a tree."""
    return ast.parse(path.read_text(encoding="utf-8"))


def floor(file: str) -> int:
    """Number of the floor that a file stands on."""
    room = file.split(".")[0]
    return next(k for k, rooms in enumerate(FLOORS) if room in rooms)


def imports(file: str, *, late: bool = True) -> Iterator[str]:
    """Files of the package that a file imports anywhere, for types too; `late`: also within functions, when they are called."""
    tree = parsed(FILES[file])
    inside = {id(n) for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) for n in ast.walk(f)}
    for node in ast.walk(tree):
        if not late and id(node) in inside:
            continue
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "acausal":
            for alias in node.names:
                names = [".".join([*node.module.split(".")[1:], *last]) for last in ([alias.name], [], ["__init__"])]
                yield next(name for name in names if name in FILES)
        elif isinstance(node, ast.Import):
            assert not [alias.name for alias in node.names if alias.name.startswith("acausal.")], (
                f"{file}: write `from ... import`"
            )


@pytest.mark.parametrize("file", FILES)
def test_imports_go_down_or_sideways(file: str) -> None:
    if file != "__init__" and not (file.endswith("__init__") and not list(imports(file))):
        above = [
            name
            for name in imports(file)
            if floor(name) > floor(file) or (floor(name) == floor(file) and not same_room(name, file))
        ]
        assert not above, f"{file} knows {above}, which stand above it or in another room of its floor"


def same_room(a: str, b: str) -> bool:
    """Whether two files of one floor stand in one folder, or are files of the ground floor."""
    return a.split(".")[0] == b.split(".")[0] or floor(a) == 0


def test_no_two_files_need_one_another() -> None:
    graph = nx.DiGraph([(file, name) for file in FILES for name in imports(file, late=False) if name != file])
    circles = [sorted(c) for c in nx.strongly_connected_components(graph) if len(c) > 1]
    assert not circles, circles


def test_components_know_authors_rooms_only() -> None:
    """`components` needs nothing that a user's own parts could not have: no reduction, no integrators; and no room knows `components`."""
    folder = ROOT.parent / "components"
    allowed = {"errors", "language", "arguments", "parts", "visual", "wording"}
    for path in folder.rglob("*.py"):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("acausal."):
                assert node.module.split(".")[1] in allowed, f"{path.name} imports {node.module}"
    for file, path in FILES.items():
        assert "components" not in {
            (node.module or "").split(".")[0] for node in ast.walk(parsed(path)) if isinstance(node, ast.ImportFrom)
        }, f"{file} imports components"


@pytest.mark.parametrize(
    ("old", "name"),
    [("acausal.mechanics.joint", "AbstractJoint"), ("acausal.mechanics.pose", "Pose"), ("acausal.trajectory", "Trajectory")],
)
def test_old_module_names_answer_with_a_warning(old: str, name: str) -> None:
    sys.modules.pop(old, None)
    with pytest.warns(DeprecationWarning, match=f"{old} is acausal."):
        found = importlib.import_module(old)
    assert vars(found)[name].__name__ == name


@pytest.mark.parametrize("scene", ["DoublePendulum", "FourBar", "Pendulum"])
def test_a_first_result_needs_no_large_library(scene: str) -> None:
    """A fresh process builds and simulates with numpy and CasADi alone: others cost as much to import as all of the run, or a good part of it."""
    large = {
        "scipy",
        "sympy",
        "networkx",
        "matplotlib",
        "pandas",
        "numpy.ma",
        "importlib.metadata",
        "acausal.optimal_control",
        "acausal.export",
        "acausal.simulate.sensitivity",
    }
    lines = f"import sys, acausal as ac; from tests.scenes import {scene}; run = ac.build({scene}()).simulate(1.0); run.energy_error()"
    before = set(_loaded("import sys, numpy, casadi")) & large  # some versions of these do
    assert set(_loaded(lines)) & large <= before


def _loaded(lines: str) -> list[str]:
    """Modules in a fresh process after these lines."""
    found = subprocess.run(
        [sys.executable, "-c", f"{lines}; print(*sys.modules)"], capture_output=True, text=True, check=True, cwd=ROOT.parent
    )
    return found.stdout.split()


@pytest.mark.parametrize("seed", range(5))
def test_graphs_are_walked_as_networkx_does(seed: int) -> None:
    rng = random.Random(seed)
    n = rng.randint(1, 30)
    edges = [(rng.randrange(n), rng.randrange(n)) for _ in range(rng.randint(0, 2 * n))]
    own, whole = Graph(range(n), edges), nx.MultiGraph()
    whole.add_nodes_from(range(n))
    whole.add_edges_from((a, b, k, {"weight": k}) for k, (a, b) in enumerate(edges))
    assert [set(part) for part in own.parts()] == list(nx.connected_components(whole))
    assert [edge[:2] for edge in own.tree(0)] == list(nx.bfs_edges(whole, 0))
    assert all(set(edges[k]) == {a, b} for a, b, k in own.tree(0))
    assert set(least_tree(edges)) == {k for _, _, k in nx.minimum_spanning_edges(whole, keys=True, data=False)}
