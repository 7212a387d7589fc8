"""Branches: all ways found to assemble a mechanism under the same start values, such as elbow up and elbow down."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import overload

from acausal.start.initial import InitialState


@dataclass(frozen=True)
class Branch:
    """One way to assemble: its state, distance from the sketch (root mean square over the coordinates of all joints, in rad and
    sizes of the loops), how many searches ended in it, freedoms that the start values leave, and how it differs from the first branch.
    """

    state: InitialState
    distance: float
    count: int
    freedoms: int
    words: str


@dataclass(frozen=True)
class Branches(Sequence[InitialState]):
    """The branches found, nearest to the sketch first; a sequence of `InitialState`. Printing it shows a table."""

    all: tuple[Branch, ...]
    searches: int
    closed: int
    """Searches that ended with everything closed on the side that is meant."""
    stopped: int = field(default=0)
    """Branches left out since the velocity start values cannot be met there."""

    @overload
    def __getitem__(self, index: int) -> InitialState: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[InitialState, ...]: ...
    def __getitem__(self, index: int | slice) -> InitialState | tuple[InitialState, ...]:
        if isinstance(index, slice):
            return tuple(branch.state for branch in self.all[index])
        return self.all[index].state

    def __len__(self) -> int:
        return len(self.all)

    def __iter__(self) -> Iterator[InitialState]:
        return (branch.state for branch in self.all)

    def __str__(self) -> str:
        if not self.searches:
            return "1 branch: no loop has to close, and the start values are coordinates"
        single = sum(branch.count == 1 for branch in self.all)
        count = "1 branch" if len(self) == 1 else f"{len(self)} branches"
        lines = [f"{count}, from {self.searches} searches of which {self.closed} closed"]
        lines.append("  no  distance  found  differs from the first most in")
        for k, b in enumerate(self.all):
            lines.append(f"  {k:<3} {b.distance:<9.3g} {b.count:<6} {b.words}")
        freedoms = max((b.freedoms for b in self.all), default=0)
        if freedoms:
            left = "1 freedom is" if freedoms == 1 else f"{freedoms} freedoms are"
            lines.append(f"{left} left by the start values: of each branch the point nearest to the sketch is given.")
        if single:
            lines.append(f"{single} of them found only once: there may be more, raise `searches`.")
        if self.stopped:
            lines.append(f"{self.stopped} more cannot meet the velocity start values.")
        return "\n".join(lines)

    __repr__ = __str__
