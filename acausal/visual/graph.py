"""The mechanism's graph as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import networkx as nx

from acausal.visual.pyplot import new_figure, saved

_FILL = {"ground": "#5b6774", "body": "#4C78A8", "point": "#54A24B", "massless": "#c4ccd6"}
_LINE: dict[str, tuple[str, Any]] = {"joint": ("#3d4957", "-"), "cut": ("#E45756", "--"), "force": ("#B279A2", ":")}


def draw_graph(graph: nx.MultiGraph[int], path: str | Path | None = None) -> Any:
    """Groups in layers by their distance from the ground (node 0), joints as lines: cut ones dashed, forces dotted.

    Node attributes `label`, `kind`; edge attributes `label`, `kind`. Returns the matplotlib figure.
    """
    places = _layered(graph)
    wide = max((x for x, _ in places.values()), default=0) - min((x for x, _ in places.values()), default=0)
    deep = -min((y for _, y in places.values()), default=0)
    figure, axes = new_figure(min(40.0, 3.5 + 1.9 * wide), min(40.0, 2.2 + 1.35 * deep))
    seen: dict[tuple[int, int], int] = {}
    for a, b, data in graph.edges(data=True):
        pair = (min(a, b), max(a, b))
        count = seen.get(pair, 0)
        seen[pair] = count + 1
        colour, style = _LINE[data["kind"]]
        skips = abs(places[a][1] - places[b][1]) != 1
        bend = 0.0 if count == 0 and not skips else 0.22 * ((count + 1) if count % 2 == 0 else -count)
        (xa, ya), (xb, yb) = places[a], places[b]
        axes.annotate("", (xb, yb), (xa, ya), arrowprops={
            "arrowstyle": "-", "color": colour, "linestyle": style, "linewidth": 1.7, "connectionstyle": f"arc3,rad={bend}", "shrinkA": 17, "shrinkB": 17,
        })  # fmt: skip
        middle = ((xa + xb) / 2 - bend * (ya - yb) / 2, (ya + yb) / 2 + bend * (xa - xb) / 2)
        axes.text(
            *middle,
            data["label"],
            fontsize=8,
            color=colour,
            ha="center",
            va="center",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85},
        )
    for node, (x, y) in places.items():
        data = graph.nodes[node]
        dark = data["kind"] != "massless"
        axes.text(
            x,
            y,
            data["label"],
            fontsize=9,
            ha="center",
            va="center",
            color="white" if dark else "#1d2733",
            bbox={"boxstyle": "round,pad=0.45", "facecolor": _FILL[data["kind"]], "edgecolor": "none"},
        )
    from matplotlib.lines import Line2D

    kinds = [k for k in _LINE if any(data["kind"] == k for *_, data in graph.edges(data=True))]
    names = {"joint": "joint", "cut": "joint that closes a loop", "force": "force"}
    if kinds:
        axes.legend(
            handles=[Line2D([], [], color=_LINE[k][0], linestyle=_LINE[k][1], label=names[k]) for k in kinds],
            frameon=False,
            fontsize=8,
            loc="upper left",
        )
    axes.set_xlim(min(x for x, _ in places.values()) - 0.8, max(x for x, _ in places.values()) + 0.8)
    axes.set_ylim(-deep - 0.5, 0.6)
    axes.axis("off")
    return saved(figure, path)


def _layered(graph: nx.MultiGraph[int]) -> dict[int, tuple[float, float]]:
    """Breadth-first tree of the joints, leaves side by side, parents above the middle of their children."""
    solid = nx.MultiGraph()
    solid.add_nodes_from(graph.nodes)
    solid.add_edges_from((a, b) for a, b, data in graph.edges(data=True) if data["kind"] == "joint")
    tree = nx.bfs_tree(solid, 0)
    depth = nx.single_source_shortest_path_length(tree, 0)
    x: dict[int, float] = {}
    column = 0.0
    for node in nx.dfs_postorder_nodes(tree, 0):
        children = list(tree.successors(node))
        if children:
            x[node] = sum(x[c] for c in children) / len(children)
        else:
            x[node] = column
            column += 1.0
    for node in graph.nodes:
        if node not in x:
            x[node], depth[node] = column, 0
            column += 1.0
    return {node: (x[node], -float(depth[node])) for node in graph.nodes}
