"""Pictures of mechanism graphs: layers, kinds of edges, room for a hundred nodes."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest

from acausal.visual.graph import draw_graph, layout
from tests.test_visual import assert_not_blank


def graph_of(edges: list[tuple[int, int, str]]) -> nx.MultiGraph:
    graph = nx.MultiGraph()
    for node in range(1 + max((max(a, b) for a, b, _ in edges), default=0)):
        graph.add_node(node, label=f"_part_{node} $", kind=("ground", "body", "massless", "point")[min(node, 1 + node % 3)])
    for k, (a, b, kind) in enumerate(edges):
        graph.add_edge(a, b, label=f"edge_{k}", kind=kind)
    return graph


def test_graph_is_layered_and_drawn(tmp_path):
    graph = graph_of(
        [
            (0, 1, "joint"),
            (1, 2, "joint"),
            (2, 3, "joint"),
            (3, 0, "cut"),
            (0, 3, "force"),
            (0, 3, "force"),
            (2, 2, "force"),
            (3, 4, "contact"),
        ]
    )
    places = layout(graph)
    heights = [places[node][1] for node in range(5)]
    assert heights == sorted(heights, reverse=True) and len(set(heights)) == 5
    figure = draw_graph(graph, tmp_path / "g.png")
    assert_not_blank(tmp_path / "g.png")
    styles = [line.get_linestyle() for line in figure.axes[0].lines]
    assert [styles.count(style) for style in ("-", "--", ":", "-.")] == [3, 1, 3, 1]
    double = [line.get_xydata()[30] for line in figure.axes[0].lines if line.get_linestyle() == ":"][:2]
    assert np.linalg.norm(double[0] - double[1]) > 0.2


@pytest.mark.parametrize(
    "parent",
    [
        lambda rng, k: 0,
        lambda rng, k: k - 1,
        lambda rng, k: int(rng.integers(max(0, k - 12), k)),
        lambda rng, k: int(rng.integers(0, k)),
    ],
)
def test_boxes_of_a_hundred_nodes_do_not_overlap(parent):
    rng = np.random.default_rng(5)
    places = np.array(list(layout(graph_of([(parent(rng, k), k, "joint") for k in range(1, 100)])).values()))
    gap = np.abs(places[:, None] - places[None])
    apart = (gap[..., 0] > 1.2) | (gap[..., 1] > 0.5) | np.eye(len(places), dtype=bool)
    assert np.all(apart)


def test_every_ground_is_on_top():
    graph = graph_of([(0, 1, "joint"), (1, 2, "joint"), (2, 3, "joint")])
    graph.nodes[0]["kind"] = "body"
    graph.nodes[3]["kind"] = "ground"
    places = layout(graph)
    assert [places[node][1] for node in (3, 2, 1, 0)] == sorted((y for _, y in places.values()), reverse=True)


def test_graph_of_one_node_is_drawn(tmp_path):
    draw_graph(graph_of([]), tmp_path / "g.png")
    assert_not_blank(tmp_path / "g.png")
