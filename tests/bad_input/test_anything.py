"""Anything at all as an argument of anything public, found by discovery: it is taken, or refused in words of ours; never a bare error."""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from fractions import Fraction
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
import components
from acausal.errors import AcausalError
from components import Contact as OneContact
from components import Coulomb, Ellipsoid, Force, Hard, Plane, Revolute, RigidBody, TorqueSource, World
from tests.bad_input.test_constructors import PARTS, USUAL, arguments, names
from tests.exported import compile_quickly
from tests.scenes import Pendulum

ANYTHING: dict[str, Any] = {
    "nothing": None, "complex": 1 + 2j, "objects": np.array([object(), object()]), "dictionary": {"nobody.q": 1.0}, "empty": [], "no name": "",
    "word": "nonsense", "ragged": [[1], [2, 3]], "truth": True, "class": int, "bytes": b"x", "cube": np.ones((3, 3, 3)), "large": 10**400,
    "NaNs": [math.nan] * 3, "infinite": math.inf, "denormal": 1e-320, "function": lambda: 1, "fails": lambda *_: 1 / 0, "gives words": lambda *_: "x",
    "gives nothing": lambda *_: None, "SX": ca.SX.sym("z", 2), "MX": ca.MX.sym("z"), "DM": ca.DM([1, 2]), "foreign": Revolute("y").q, "part": World(),
    "frame": World().frame, "day": datetime(2020, 1, 1), "fraction": Fraction(1, 3), "negative": -1, "falling": [1.0, 0.0],
}  # fmt: skip


def answers(call: Callable[[], object], what: str) -> None:
    """Raises anything but an error of ours."""
    try:
        call()
    except AcausalError as error:
        assert len(str(error)) < 1200, what
    except Exception as error:
        raise AssertionError(what) from error


def wrong(usual: Mapping[str, Any], taken: list[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The usual arguments with one replaced."""
    for name in taken:
        for kind, value in ANYTHING.items():
            yield f"{name}={kind}", {**usual, name: value}


@pytest.mark.parametrize(
    "cls", [cls for cls in PARTS if cls.__name__ not in ("ConstantSum", "LimitedSum")], ids=lambda cls: cls.__name__
)
def test_parts_take_or_refuse_it(cls: type[ac.Component]):
    for what, given in wrong(arguments(cls), names(cls)):
        answers(lambda given=given: cls(**given), what)


OTHERS = [getattr(components, name) for name in components.__all__ if getattr(components, name) not in PARTS]


@pytest.mark.parametrize("cls", OTHERS, ids=lambda cls: cls.__name__)
def test_shapes_curves_surfaces_and_laws_take_or_refuse_it(cls: type):
    taken = [p for p in inspect.signature(cls).parameters.values() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    usual = {p.name: USUAL.get(f"{cls.__name__}.{p.name}", USUAL.get(p.name, 1.0)) for p in taken if p.default is p.empty}
    for what, given in wrong(usual, [p.name for p in taken]):
        answers(lambda given=given: cls(**given), what)


def pendulum() -> tuple[ac.System, Any]:
    scene = Pendulum()
    scene.push = TorqueSource(ac.Input("N*m"))
    scene.connect(scene.push.flange, scene.hinge.flange)
    return scene, scene.hinge.q


def ball() -> tuple[ac.System, Any]:
    scene = ac.System()
    scene.world, scene.ball, scene.wind = World(), RigidBody.ball(1.0, 0.1, position=(0, 0, 0.2)), Force((ac.Input("N"), 0, 0))
    scene.floor = OneContact(Ellipsoid((0.1, 0.1, 0.1)), Plane(), Hard(0.5, Coulomb(0.3)))
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame, scene.wind.point)
    return scene, scene.ball.frame.position[2]


@pytest.mark.slow
@pytest.mark.parametrize(("asked", "scene"), [("model", pendulum), ("run", pendulum), ("run", ball)])
def test_questions_take_or_refuse_it(
    scene: Callable[[], tuple[ac.System, Any]], asked: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    compile_quickly(monkeypatch)
    made, q = scene()
    model = ac.build(made)
    usual = {
        "end": 0.01,
        "times": [0.0, 0.01],
        "outputs": q,
        "wrt": [q],
        "motion": {q: ac.time},
        "folder": tmp_path,
        "path": tmp_path / "motion.html",
    }
    usual |= {"expression": q, "start": {q: 0.3}, "t": 0.01, "wanted": q}
    of: Any = model if asked == "model" else model.simulate(0.02)
    skipped = {"draw_graph"} if asked == "model" else {"plot", "picture"}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=UserWarning, module=__name__)
        for name, _ in inspect.getmembers(type(of), inspect.isfunction):
            if name.startswith("_") or name in skipped:
                continue
            question = getattr(of, name)
            taken = [
                p for p in inspect.signature(question).parameters.values() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)
            ]
            needed = {p.name: usual.get(p.name) for p in taken if p.default is p.empty}
            for what, given in wrong(needed, [p.name for p in taken if p.name != "step"]):
                answers(lambda given=given, question=question: question(**given), f"{name}({what})")
        if asked == "run":
            for what, value in ANYTHING.items():
                answers(lambda value=value: of[value], f"run[{what}]")
