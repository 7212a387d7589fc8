"""Benchmarks are run by hand: here each is imported, and a small share of it runs, so that it is known to run when it is wanted."""

from __future__ import annotations

import cProfile
import importlib
import pkgutil
from collections.abc import Callable
from pathlib import Path

import pytest

import acausal as ac
import benchmarks
from acausal.emit.compiler import cache_folder
from benchmarks import (
    bits,
    calls,
    compiler_flags,
    dynamics,
    growth,
    hard_cases,
    loops,
    modes,
    optimal_control,
    plot,
    scene_sizes,
    sizes,
    stiff,
)
from benchmarks.mode_scenes import scenes as mode_scenes
from benchmarks.peers import PEERS, reference, table
from benchmarks.peers.equations import equations
from benchmarks.peers.measure import Budget
from benchmarks.scenes import SCENES

MODULES = [module.name for module in pkgutil.walk_packages(benchmarks.__path__, "benchmarks.")]
DOUBLE_PENDULUM = next(scene for scene in SCENES if scene.name == "double_pendulum")


@pytest.mark.parametrize("name", MODULES)
def test_a_benchmark_is_imported_whatever_peers_there_are(name: str) -> None:
    assert importlib.import_module(name).__doc__


def _peers(folder: Path) -> None:
    budget = Budget(repeats=1, short=0.0, sweep=0.0)
    points = table.measure(DOUBLE_PENDULUM, [peer for peer in PEERS if peer.name in ("acausal", "scipy")], budget)
    plot.draw(points, folder / "speed.png")
    assert "double_pendulum" in plot.table(points)


def _driver() -> None:
    """Of a stiff scene, where it asks for derivatives on the way."""
    built = next(scene for scene in SCENES if scene.name == "spring_pendulum").build()
    own = next(peer for peer in PEERS if peer.name == "acausal").prepare(built, "driver", 1e-9)
    assert built.scene.error(own.values(own.run())) < 1e-8


def _flags(_: Path) -> None:
    assert compiler_flags.driver_time("double_pendulum") > 0
    assert compiler_flags.compile_time(2) > 0


def _modes(_: Path) -> None:
    scene = mode_scenes()[0]
    times = [modes.least_time(one.run, 1) for one, _ in modes.own_tries(scene)]
    assert all(abs(values - scene.reference).max() < 1e-3 for _, values in times)
    modes.untouched((1,))
    modes.collisions((2,))


def _hard_case(_: Path) -> None:
    entry = hard_cases.entry(hard_cases.CASES["simple_pendulum"](), 1e-6)
    assert entry is not None
    assert entry.error < 1e-4


def _optimal_control(_: Path) -> None:
    row, part = optimal_control.ours(optimal_control.cart_pole, 25)
    hand = optimal_control.by_hand(optimal_control.cart_pole_by_hand(), part, 0.0)
    assert row.cost == pytest.approx(hand.cost, rel=1e-8)
    assert row.iterations <= hand.iterations + 2


def _bits(_: Path) -> None:
    found = bits.column(["simple_pendulum"], False)
    assert len(set(found["simple_pendulum"].values())) == 1


SHARES: dict[str, Callable[[Path], object]] = {
    "sizes": lambda _: sizes.measure(2, str(cache_folder()), compiled=False),
    "dynamics": lambda _: dynamics.run((1,), ()),
    "scene_sizes": lambda _: scene_sizes.run(scene_sizes.SCENES[:1]),
    "growth": lambda _: [growth.seconds(make, 2) for make in growth.FAMILIES.values()],
    "loops": lambda _: [loops.row(make, size) for (_, make, _), size in zip(loops.FAMILIES, (1, 3, 1), strict=True)],
    "calls": lambda _: calls.run(("double_pendulum",), (1e-6,)),
    "stiff": lambda _: stiff.compare("a row", stiff.row_of_masses(3, 1e3, 1.0), (1e-3,), 0.0, False),
    "reference": lambda _: reference.solution(equations("double_pendulum"), 0.1, 2),
    "peers": _peers,
    "driver": lambda _: _driver(),
    "compiler_flags": _flags,
    "modes": _modes,
    "hard_cases": _hard_case,
    "bits": _bits,
    "optimal_control": _optimal_control,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SHARES)
def test_a_share_of_a_benchmark_runs(name: str, tmp_path: Path) -> None:
    SHARES[name](tmp_path)


LONG: dict[str, Callable[[int], ac.System]] = {
    "rotors, springs, gears": growth.shafts,
    "resistors, capacitors": growth.ladder,
    "masses, springs, dampers": lambda count: stiff.row_of_masses(count, 1e3, 1.0)[0],
}


def calls_to_build(scene: ac.System) -> int:
    """Calls of functions, those in C too: they count what time only hints at."""
    profile = cProfile.Profile()
    profile.runcall(ac.build, scene)
    return sum(entry.callcount for entry in profile.getstats())


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_building_takes_work_in_proportion_to_the_parts(name: str) -> None:
    ac.build(LONG[name](2))
    few, more, most = (calls_to_build(LONG[name](count)) for count in (15, 30, 60))
    assert most - more < 2.3 * (more - few)
