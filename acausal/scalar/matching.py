"""Maximum matching of equations and unknowns, and what it leaves over.

Augmenting paths with cheap assignment (Duff, On algorithms for obtaining a maximum transversal, 1981, MC21); the parts that are
over- and underdetermined by Dulmage & Mendelsohn (1958). networkx's Hopcroft-Karp searches recursively and cannot be used for
long chains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

Incidence = Sequence[Sequence[int]]
"""For each equation the numbers of its unknowns."""


@dataclass(frozen=True)
class Parts:
    """Unmatched parts of a structure: equations and unknowns that are too many for one another."""

    equations: tuple[int, ...]
    unknowns: tuple[int, ...]
    excess: int
    """How many equations (overdetermined) or unknowns (underdetermined) are left over."""


def match(incidence: Incidence, count: int) -> list[int]:
    """The equation matched to each of `count` unknowns, or -1; as many as possible. Each equation costs at most one search."""
    owner = [-1] * count
    for start in range(len(incidence)):
        augment(start, incidence, owner)
    return owner


def augment(start: int, incidence: Incidence, owner: list[int]) -> tuple[set[int], set[int]] | None:
    """Matches one more equation along an alternating path; None if that worked, else the equations and unknowns reached.

    `owner`: unknown -> equation or -1, changed in place.
    """
    for unknown in incidence[start]:
        if owner[unknown] < 0:
            owner[unknown] = start
            return None
    equations, unknowns = {start}, set[int]()
    path = [(start, iter(incidence[start]))]
    entered: list[int] = []
    while path:
        _, candidates = path[-1]
        for unknown in candidates:
            if unknown in unknowns:
                continue
            unknowns.add(unknown)
            entered.append(unknown)
            following = owner[unknown]
            if following >= 0:
                free = next((u for u in incidence[following] if owner[u] < 0), None)
                equations.add(following)
                if free is None:
                    path.append((following, iter(incidence[following])))
                    break
                owner[free] = following
            for (equation, _), via in zip(path, entered, strict=True):
                owner[via] = equation
            return None
        else:
            path.pop()
            if entered:
                entered.pop()
    return equations, unknowns


def overdetermined(incidence: Incidence, owner: Sequence[int]) -> Parts | None:
    """Equations that share too few unknowns; None if there are none."""
    matched = set(owner)
    left = [e for e in range(len(incidence)) if e not in matched]
    equations, unknowns, todo = set(left), set[int](), list(left)
    while todo:
        for unknown in incidence[todo.pop()]:
            unknowns.add(unknown)
            following = owner[unknown]
            if following >= 0 and following not in equations:
                equations.add(following)
                todo.append(following)
    return Parts(tuple(sorted(equations)), tuple(sorted(unknowns)), len(left)) if left else None


def underdetermined(incidence: Incidence, owner: Sequence[int]) -> Parts | None:
    """Unknowns that share too few equations; None if there are none."""
    users: list[list[int]] = [[] for _ in owner]
    for equation, row in enumerate(incidence):
        for unknown in row:
            users[unknown].append(equation)
    held = {equation: unknown for unknown, equation in enumerate(owner) if equation >= 0}
    left = [u for u, equation in enumerate(owner) if equation < 0]
    equations, unknowns, todo = set[int](), set(left), list(left)
    while todo:
        for equation in users[todo.pop()]:
            equations.add(equation)
            following = held[equation]
            if following not in unknowns:
                unknowns.add(following)
                todo.append(following)
    return Parts(tuple(sorted(equations)), tuple(sorted(unknowns)), len(left)) if left else None


def blocks(incidence: Incidence, owner: Sequence[int]) -> list[list[int]]:
    """Equations in block lower triangular order: strongly connected components, each after those that it needs.

    Every unknown is matched. Linear in the size (Tarjan 1972, as in networkx).
    """
    import networkx as nx

    graph: nx.DiGraph[int] = nx.DiGraph()
    graph.add_nodes_from(range(len(incidence)))
    for equation, row in enumerate(incidence):
        graph.add_edges_from((owner[unknown], equation) for unknown in row if owner[unknown] != equation)
    condensed = nx.condensation(graph)
    first = {node: min(members) for node, members in condensed.nodes(data="members")}
    order = nx.lexicographical_topological_sort(condensed, key=first.__getitem__)
    return [sorted(condensed.nodes[node]["members"]) for node in order]
