"""The mechanism's graph as a picture."""

from __future__ import annotations

import textwrap
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from acausal.visual.pyplot import new_figure, plain, saved

if TYPE_CHECKING:
    import networkx as nx


_FILL = {"ground": "#5b6774", "body": "#4C78A8", "point": "#3f8a3d", "massless": "#c4ccd6"}
_LINE: dict[str, tuple[str, Any, str]] = {
    "joint": ("#3d4957", "-", "joint"),
    "cut": ("#d62f32", "--", "joint that closes a loop"),
    "force": ("#8a5a9e", ":", "force"),
    "contact": ("#b5701b", "-.", "contact"),
}
_LAYER, _ROW, _COLUMN = 1.5, 0.85, 1.55  # inches between layers, between rows of one layer, and between columns
_MOST_COLUMNS = 14


def draw_graph(graph: nx.MultiGraph[int], path: str | Path | None = None) -> Any:
    """Nodes in layers by their distance from the ground, in the order that crosses few lines.

    Node attributes `label`, `kind` ('ground', 'body', 'massless', 'point'); edge attributes `label`, `kind` ('joint', 'cut': red and
    dashed, 'force': dotted, 'contact': dash-dotted). Without a node of kind 'ground', node 0 is the top. A layer of many nodes is broken into rows. Returns the matplotlib figure, written to `path` if given.
    """
    places = layout(graph)
    figure, axes = _canvas(places)
    pairs: dict[tuple[int, int], list[dict[str, Any]]] = defaultdict(list)
    for a, b, data in graph.edges(data=True):
        pairs[min(a, b), max(a, b)].append(data)
    taken: list[tuple[float, float]] = []
    for (a, b), edges in pairs.items():
        upper, lower = sorted((places[a], places[b]), key=lambda place: -place[1])
        _draw_edges(axes, np.array(upper), np.array(lower), edges, places, taken)
    for node, (x, y) in places.items():
        data = graph.nodes[node]
        kind = data.get("kind", "body")
        text = plain(textwrap.fill(str(data.get("label", node)), 18, break_long_words=True))
        ink = "#1d2733" if kind == "massless" else "white"
        box = {"boxstyle": "round,pad=0.35", "facecolor": _FILL.get(kind, "#4C78A8"), "edgecolor": "white", "linewidth": 1.0}
        axes.text(x, y, text, fontsize=8, ha="center", va="center", color=ink, bbox=box, zorder=5)
    _add_legend(axes, graph)
    return saved(figure, path)


def layout(graph: nx.MultiGraph[int]) -> dict[int, tuple[float, float]]:
    """Places [inches] of the nodes: a breadth-first tree of the joints from the ground, then of everything else, parents above children.

    Children stand side by side in the tree's order; a layer wider than 14 nodes is broken into rows.
    """
    import networkx as nx

    tree = _tree(graph)
    depth: dict[int, int] = {}
    leaves: dict[int, float] = {}
    column = 0.0
    for root in [node for node in tree if tree.in_degree(node) == 0]:
        depth.update(nx.single_source_shortest_path_length(tree, root))
        for node in nx.dfs_postorder_nodes(tree, root):
            children = [leaves[c] for c in tree.successors(node)]
            leaves[node] = sum(children) / len(children) if children else column
            column += 0.0 if children else 1.0
    if column <= _MOST_COLUMNS:
        return {node: (_COLUMN * leaves[node], -_LAYER * depth[node]) for node in tree}
    return _in_rows(leaves, depth)


def _tree(graph: nx.MultiGraph[int]) -> nx.DiGraph[int]:
    """Breadth-first forest: joints first; what they do not reach hangs on its cuts and forces, else stands beside the ground."""
    import networkx as nx

    tree: nx.DiGraph[int] = nx.DiGraph()
    grounds = [node for node, data in graph.nodes(data=True) if data.get("kind") == "ground"] or [n for n in graph if n == 0]
    order = sorted(graph.nodes, key=lambda node: (node not in grounds, node))
    for kinds in (("joint",), ("joint", "cut", "force", "contact")):
        near = nx.Graph([(a, b) for a, b, data in graph.edges(data=True) if data.get("kind", "joint") in kinds and a != b])
        queue = list(tree) or sorted(grounds)
        tree.add_nodes_from(queue)
        for node in queue:
            for other in sorted(near[node]) if node in near else ():
                if other not in tree:
                    tree.add_edge(node, other)
                    queue.append(other)
    tree.add_nodes_from(order)
    return tree


def _in_rows(leaves: dict[int, float], depth: dict[int, int]) -> dict[int, tuple[float, float]]:
    """Wide graphs: each layer centred, in the tree's order, broken into rows of 14, every second row shifted by half a column."""
    places: dict[int, tuple[float, float]] = {}
    y = 0.0
    for level in range(max(depth.values()) + 1):
        layer = sorted((node for node in leaves if depth[node] == level), key=lambda node: leaves[node])
        rows = -(-len(layer) // _MOST_COLUMNS)
        for r in range(rows):
            row = layer[r::rows]  # neighbours in the tree stay neighbours in the picture
            shift = (len(row) - 1) / 2 - (r - (rows - 1) / 2) / max(rows, 1)
            places.update({node: (_COLUMN * (k - shift), y) for k, node in enumerate(row)})
            y -= _ROW
        y -= _LAYER - _ROW
    return places


def _canvas(places: dict[int, tuple[float, float]]) -> tuple[Any, Any]:
    spots = np.array(list(places.values())) if places else np.zeros((1, 2))
    low, high = spots.min(axis=0) - np.array([1.2, 0.7]), spots.max(axis=0) + np.array([1.2, 0.8])
    wide, tall = np.clip(high - low, (5.0, 2.4), 60.0)
    figure, axes = new_figure(float(wide), float(tall))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.axis("off")
    return figure, axes


def _draw_edges(axes: Any, start: np.ndarray, end: np.ndarray, edges: list[dict[str, Any]], places: dict[int, tuple[float, float]], taken: list[tuple[float, float]]) -> None:  # fmt: skip
    """All edges between two nodes, as quadratic curves side by side; a lone one is straight unless it would cross another node."""
    along = end - start
    length = float(np.linalg.norm(along))
    loop = length == 0
    normal = np.array([0.0, 1.0]) if loop else np.array([-along[1], along[0]]) / length
    blocked = not loop and any(_near(np.array(p), start, end) for p in places.values())
    for k, data in enumerate(edges):
        offset = 0.75 * (k - (len(edges) - 1) / 2) + (
            0.42 * length if blocked and abs(along[1]) < 1e-9 else 0.9 if blocked else 0.0
        )
        colour, style, _ = _LINE.get(data.get("kind", "joint"), _LINE["joint"])
        s = np.linspace(0, 1, 60)[:, None]
        if loop:
            size = 0.5 + 0.25 * k
            curve = start + size * np.hstack([np.sin(2 * np.pi * s), 1 - np.cos(2 * np.pi * s)])
        else:
            curve = start + s * along + 4 * s * (1 - s) * offset * 0.5 * normal
        axes.plot(curve[:, 0], curve[:, 1], color=colour, linestyle=style, linewidth=1.6, zorder=1)
        # the first place along the curve that is clear of other labels and nodes
        stations = [curve[int(60 * f)] for f in (0.5, 0.58, 0.42, 0.66, 0.74, 0.82, 0.34, 0.26)]
        others = [*taken, *places.values()]
        spot = next((p for p in stations if all(abs(p[0] - q[0]) > 0.7 or abs(p[1] - q[1]) > 0.2 for q in others)), stations[0])
        taken.append((float(spot[0]), float(spot[1])))
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85}
        text = textwrap.shorten(str(data.get("label", "")), 24, placeholder="…")
        axes.text(*spot, plain(text), fontsize=7, color=colour, ha="center", va="center", bbox=box, zorder=3)


def _near(p: np.ndarray, start: np.ndarray, end: np.ndarray) -> bool:
    """Whether a straight line passes through the box of another node at p."""
    along = end - start
    s = float((p - start) @ along / (along @ along))
    gap = np.abs(start + s * along - p)
    return 0.02 < s < 0.98 and gap[0] < 0.45 and gap[1] < 0.22


def _add_legend(axes: Any, graph: nx.MultiGraph[int]) -> None:
    from matplotlib.lines import Line2D

    kinds = {data.get("kind", "joint") for *_, data in graph.edges(data=True)}
    handles = [Line2D([], [], color=c, linestyle=s, label=name) for kind, (c, s, name) in _LINE.items() if kind in kinds]
    if handles:
        axes.legend(handles=handles, frameon=False, fontsize=8, loc="upper left", ncols=3, borderaxespad=0.0)
