"""From points of `python -m benchmarks.peers --out points.json`: error against time as a picture, and ratios at equal error as a table.

python -m benchmarks.plot points.json docs/speed.png
"""

from __future__ import annotations

import json
import math
import sys
from collections import defaultdict
from pathlib import Path

from benchmarks.peers.measure import ERRORS, Point, time_at_error
from benchmarks.scenes import SCENES

OURS = "acausal"


def read(path: Path) -> list[Point]:
    """Points as they were measured; an error of None is infinite."""
    rows = json.loads(path.read_text(encoding="utf-8"))
    return [Point(**(row | {"error": math.inf if row["error"] is None else row["error"]})) for row in rows]


def grouped(points: list[Point]) -> dict[tuple[str, str, str], list[Point]]:
    """By scene, peer and method."""
    groups: dict[tuple[str, str, str], list[Point]] = defaultdict(list)
    for point in points:
        groups[point.scene, point.peer, point.method].append(point)
    return groups


def table(points: list[Point]) -> str:
    """Markdown: for each scene and error our time, heyoka's, and that of the best of all others with its ratio to ours."""
    groups = grouped(points)
    lines = [
        "| scene | error | driver ms | `simulate` ms | heyoka ms | best of the others | ms | times driver | times `simulate` |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for scene in SCENES:
        for error in ERRORS:
            times = {key[1:]: time_at_error(found, error) for key, found in groups.items() if key[0] == scene.name}
            ours = [times.get((OURS, method)) for method in ("driver", "simulate")]
            taylor = times.get(("heyoka", "Taylor"))
            others = {key: t for key, t in times.items() if key[0] not in (OURS, "heyoka") and t is not None}
            best = min(others, key=lambda key: others[key], default=None)
            cells = [f"{t:.2f}" if t else "-" for t in (*ours, taylor)]
            if best is None:
                cells += ["none reaches it", "", "", ""]
            else:
                cells += [" ".join(best), f"{others[best]:.2f}", *(f"{others[best] / t:.1f}" if t else "" for t in ours)]
            lines.append(f"| {scene.name} | {error:.0e} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def draw(points: list[Point], path: Path) -> None:
    """One panel a scene: error at the end against milliseconds."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    scenes = [s for s in SCENES if any(p.scene == s.name for p in points)]
    rows = math.ceil(len(scenes) / 2)
    figure, axes = plt.subplots(rows, 2, figsize=(12, 3.6 * rows), squeeze=False)
    names = sorted({(p.peer, p.method) for p in points if p.peer != OURS})
    colours = {name: plt.get_cmap("tab20")(k % 20) for k, name in enumerate(names)}
    for axis, scene in zip(axes.ravel(), scenes, strict=False):
        for (where, peer, method), found in grouped(points).items():
            shown = [p for p in found if p.error < 1]
            if where == scene.name and shown:
                style = (
                    {"color": "black", "lw": 2.2, "ls": "-" if method == "driver" else "--", "zorder": 5}
                    if peer == OURS
                    else {"color": "crimson", "lw": 1.8}
                    if peer == "heyoka"
                    else {"color": colours[peer, method], "lw": 1.0}
                )
                axis.loglog(
                    [p.milliseconds for p in shown],
                    [max(p.error, 1e-15) for p in shown],
                    marker=".",
                    label=f"{peer} {method}",
                    **style,
                )
        axis.set_title(scene.title, fontsize=9)
        axis.set_xlabel("milliseconds")
        axis.set_ylabel("error")
        axis.grid(True, which="major", alpha=0.3)
    for axis in axes.ravel()[len(scenes) :]:
        axis.axis("off")
    handles: dict[str, object] = {}
    for axis in axes.ravel():
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    axes.ravel()[-1].legend(list(handles.values()), list(handles), loc="center", ncols=2, fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    """Arguments as in the command."""
    points = read(Path(sys.argv[1]))
    draw(points, Path(sys.argv[2]))
    print(table(points))


if __name__ == "__main__":
    main()
