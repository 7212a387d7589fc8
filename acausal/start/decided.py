"""Whether what was decided about loops holds at the time and place of a call."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from acausal.errors import StartValueError
from acausal.wording import compact

if TYPE_CHECKING:
    from acausal.reduce.reduce import ReducedSystem


class OtherDecisions(StartValueError):
    """The loops have other independent constraints at this time [s] and configuration `q`, for these `values` of parameters, than the model
    was made for."""

    def __init__(self, message: str, time: float, q: np.ndarray, values: np.ndarray) -> None:
        super().__init__(message)
        self.time, self.q, self.values = time, q, values

    def __reduce__(self) -> tuple[Any, ...]:
        return OtherDecisions, (self.args[0], self.time, self.q, self.values)


class OtherFreedoms(OtherDecisions):
    """The motion begins where motions of other freedoms meet, and leads to a configuration `beside` with other independent constraints."""

    def __init__(self, message: str, time: float, q: np.ndarray, values: np.ndarray, beside: np.ndarray) -> None:
        super().__init__(message, time, q, values)
        self.beside = beside

    def __reduce__(self) -> tuple[Any, ...]:
        return OtherFreedoms, (self.args[0], self.time, self.q, self.values, self.beside)


class OtherCircuit(OtherDecisions):
    """The motion begins where those along which loops were examined do not come by."""

    def __reduce__(self) -> tuple[Any, ...]:
        return OtherCircuit, (self.args[0], self.time, self.q, self.values)


def check_decided(system: ReducedSystem, time: float, x: np.ndarray, p: np.ndarray) -> None:
    """Raises `OtherDecisions` where, at states x (nx,) of the system, other rows of loops are independent than elsewhere; microseconds."""
    c = system.constraints
    if not c.examined:
        return
    q, values = x[: system.mechanics.tree.q.numel()], p[: system.p_values.size]
    for part, margin in zip(c.examined, c.margins(q, time, values), strict=True):
        if not part.decided(margin):
            joints = compact((f"'{rows.edge.name}'" for rows in part.group.loops), 4)
            raise OtherDecisions(
                f"At t = {time:.6g} s, where this begins, {margin.rank} constraints of the loops closed by {joints} are independent, by a margin of "
                f"{margin.independent:.2g}; elsewhere {part.rank.rank} are, by {part.least:.2g}. Begin elsewhere, or build the scene "
                "in a position like this one: give bodies a rough position or joints a start.", time, q, values,
            )  # fmt: skip


def check_circuit(system: ReducedSystem, time: float, x: np.ndarray, p: np.ndarray) -> None:
    """Raises `OtherCircuit` where the motions from states x (nx,) of the system are others than those along which its loops were looked at."""
    c, q = system.constraints, x[: system.mechanics.tree.q.numel()]
    if c.examined and not c.met(q):
        values = p[: system.p_values.size]
        raise OtherDecisions(
            f"At t = {time:.6g} s this begins on another circuit than that on which loops were examined.", time, q, values
        )
