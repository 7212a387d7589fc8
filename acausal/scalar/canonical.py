"""An order of parts that does not depend on the order in which they were declared, nor, where they differ in anything else, on their names.

Choices among equals (which of two inertias on a gear keeps the state) follow this order. Colour refinement (Weisfeiler and Leman 1968) of the
graph of parts and connections: a part's first colour is its class and the numbers in its equations, one after another as they are written: so they
keep their order in any units; then colours of neighbours are taken in, until nothing new is told apart. What is left alike is ordered by name.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from acausal.language.connector import Connector
from acausal.language.flatten import FlatSystem, Part

_ROUNDS = 16
_DIGITS = 2.0**40
"""Numbers count as the same to this part, in a way that powers of two have no influence on."""
_AT = 0.7
"""Where slopes of equations are taken: any value of all symbols."""


def canonical_parts(flat: FlatSystem, residuals: Sequence[Sequence[ca.SX]]) -> list[int]:
    """Numbers of the parts in their order. `residuals`: of the equations of each part."""
    sets = [group for group in flat.connection_sets if len(group) > 1]
    owner = {part.component: k for k, part in enumerate(flat.parts)}
    edges = [
        [(owner[c.owner], attribute(flat, flat.parts[owner[c.owner]], c)) for c in group if c.owner in owner] for group in sets
    ]
    numbers = _numbers(flat, residuals)
    parts = _ranks([(type(part.component).__qualname__, numbers[k]) for k, part in enumerate(flat.parts)])
    groups = _ranks([(type(group[0]).__qualname__, len(group)) for group in sets])
    users: list[list[tuple[str, int]]] = [[] for _ in flat.parts]
    for s, group in enumerate(edges):
        for k, name in group:
            users[k].append((name, s))
    told = -1
    for _ in range(_ROUNDS):
        if len(set(parts)) in (told, len(parts)):
            break
        told = len(set(parts))
        groups = _ranks([(groups[s], sorted((name, parts[k]) for k, name in group)) for s, group in enumerate(edges)])
        parts = _ranks([(parts[k], sorted((name, groups[s]) for name, s in own)) for k, own in enumerate(users)])
    return sorted(range(len(parts)), key=lambda k: (parts[k], flat.parts[k].path))


def attribute(flat: FlatSystem, part: Part, connector: Connector) -> str:
    """What a connector is called in its part."""
    return flat.connector_paths[connector].removeprefix(part.path)


def row_number(slopes: np.ndarray, value: float) -> tuple[float, ...]:
    """What is told of an equation by numbers; of laws like v = 2.0 the one with the smaller number comes first."""
    mantissas, exponents = np.frexp(np.nan_to_num(np.append(slopes, value), posinf=0.0, neginf=0.0))
    return tuple((-np.ldexp(np.round(mantissas * _DIGITS) / _DIGITS, exponents) + 0.0).tolist())


def _numbers(flat: FlatSystem, residuals: Sequence[Sequence[ca.SX]]) -> list[tuple[tuple[float, ...], ...]]:
    """For each part its equations by numbers, in their order; parameters count as alike."""
    rows = [(k, residual) for k, own in enumerate(residuals) for residual in own]
    if not rows:
        return [() for _ in flat.parts]
    column = ca.vertcat(*(ca.vec(residual) for _, residual in rows))
    owners = [k for k, residual in rows for _ in range(residual.numel())]
    held = {p.sx.element_hash() for p in flat.parameters}
    symbols = [s for s in ca.symvar(column) if s.element_hash() not in held]
    own = ca.vertcat(ca.SX(0, 1), *symbols)
    slopes = ca.jacobian(column, own)
    everything = ca.vertcat(own, *(p.sx for p in flat.parameters))
    function = ca.Function("slopes", [everything], [slopes, ca.densify(column)])
    found, values = function(np.full(everything.numel(), _AT))
    matrix, values = found.sparse().tocsr(), np.array(values).ravel()
    result: list[list[tuple[float, ...]]] = [[] for _ in flat.parts]
    for i, k in enumerate(owners):
        result[k].append(row_number(matrix.data[matrix.indptr[i] : matrix.indptr[i + 1]], float(values[i])))
    return [tuple(own) for own in result]


def _ranks(keys: Sequence[object]) -> list[int]:
    """Each key's place among all different ones."""
    place = {key: k for k, key in enumerate(sorted({_frozen(key) for key in keys}))}
    return [place[_frozen(key)] for key in keys]


def _frozen(key: object) -> tuple[object, ...]:
    return tuple(tuple(part) if isinstance(part, list) else part for part in key) if isinstance(key, tuple) else (key,)
