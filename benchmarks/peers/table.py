"""The command: measure, print a table (a dash where an error was not reached), write the points."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from benchmarks.peers import PEERS
from benchmarks.peers.base import AbstractPeer
from benchmarks.peers.measure import ERRORS, Budget, Point, sweep, time_at_error
from benchmarks.peers.quiet import quiet
from benchmarks.scenes import SCENES, Scene


def main(arguments: Sequence[str] | None = None) -> None:
    """Arguments as in the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument(
        "scenes", nargs="*", metavar="scene", choices=[[], *(s.name for s in SCENES)], help="all if none is named"
    )
    parser.add_argument("--peer", action="append", choices=[p.name for p in PEERS], help="may be repeated; all if none is named")
    parser.add_argument("--out", type=Path, help="where to write the points as JSON")
    given = parser.parse_args(arguments)
    peers = [p for p in PEERS if not given.peer or p.name in given.peer]
    points: list[Point] = []
    for scene in SCENES:
        if not given.scenes or scene.name in given.scenes:
            points += measure(scene, peers)
    if given.out:
        given.out.write_text(json.dumps([asdict(p) | {"error": finite(p.error)} for p in points], indent=1), encoding="utf-8")


def finite(error: float) -> float | None:
    """JSON has no infinity: None where an integrator gave up."""
    return error if math.isfinite(error) else None


def measure(scene: Scene, peers: Sequence[AbstractPeer], budget: Budget | None = None) -> list[Point]:
    """Sweep all methods of all peers on a scene; prints its table."""
    built = scene.build()
    print(f"\n{scene.title}: milliseconds of a run at an error of the {scene.error_kind}; - not reached")
    print(f"{'':<32}" + "".join(f"{e:>10.0e}" for e in ERRORS) + f"{'best error':>14}{'ms':>9}{'setting':>10}")
    points: list[Point] = []
    for peer in peers:
        if not peer.available():
            print(f"  {peer.name:<30}not installed")
        elif peer.refusal(scene.name):
            print(f"  {peer.name:<30}{peer.refusal(scene.name)}")
        else:
            for method in peer.methods(scene.name):
                with quiet():
                    found = sweep(peer, built, method, budget or Budget())
                print(line(found), flush=True)
                points += found
    return points


def line(points: Sequence[Point]) -> str:
    """One row of the table."""
    best = min(points, key=lambda p: p.error)
    times = (time_at_error(points, e) for e in ERRORS)
    cells = "".join(f"{'-' if t is None else f'{t:.2f}':>10}" for t in times)
    return f"  {best.peer + ' ' + best.method:<30}{cells}{best.error:>14.1e}{best.milliseconds:>9.2f}{best.setting:>10.1e}"
