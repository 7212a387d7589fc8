"""Charts: which coordinates and velocities are independent, chosen at a reference state."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from acausal.charts.independent import Independent, independent_entries
from acausal.charts.manifold import Manifold
from acausal.charts.singular_state import singular_loops
from acausal.errors import StartValueError

_KEEP = 0.05


@dataclass(frozen=True)
class Choice:
    """Independent entries of c and of w = (v, scalar states), in ascending order; all others are dependent."""

    positions: tuple[int, ...]
    rates: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Chart:
    """Independent coordinates around the state `x` (nx,) at time `t` [s] with parameters `p` (np,).

    `independent` and `dependent` are names; unit quaternions count as three `rodrigues`, zero at the reference. `conditioning` in (0, 1]:
    1 / sqrt(1 + sum of squares of the derivatives of dependent by independent entries), of positions or of velocities, whichever is
    less; it goes to zero where the chart ends. `preferred`: whether all entries asked for are independent.
    """

    choice: Choice
    t: float
    x: np.ndarray
    p: np.ndarray
    independent: tuple[str, ...]
    dependent: tuple[str, ...]
    conditioning: float
    preferred: bool

    @property
    def reference(self) -> np.ndarray:
        """(t, x, p), which the chart's functions take as one argument."""
        return np.concatenate([[self.t], self.x, self.p])

    def __str__(self) -> str:
        return (
            f"chart at t = {self.t:g} s: independent {', '.join(self.independent) or 'none'}; dependent {', '.join(self.dependent) or 'none'}; "
            f"conditioning {self.conditioning:.3g}"
        )


def choose_chart(manifold: Manifold, t: float, x: np.ndarray, p: np.ndarray, preferred: Iterable[int] = ()) -> Chart:
    """The chart at an assembled state. Entries of (c, w) that are `preferred` are independent, if the chart is then not much worse than
    the best one; the rates of independent coordinates rather than other velocities.

    Raises `StartValueError` where the state is singular: where branches of the motion cross.
    """
    nc = manifold.coordinates.count
    singular = singular_loops(manifold.functions, t, x, p)
    if singular:
        raise StartValueError(f"{singular} Start beside this position; model.simulate passes it.")
    slopes = manifold.slopes(t, x, p)
    wanted = set(preferred)
    asked = wanted | {i for i, j in manifold.twins if nc + j in wanted}
    positions = _chosen(slopes.position, [i for i in asked if i < nc])
    twins = [j for i, j in manifold.twins if i in positions.free]
    rates = _chosen(slopes.rate, twins, [i - nc for i in wanted if i >= nc])
    conditioning = min(_conditioning(positions), _conditioning(rates))
    names = manifold.names
    free = [*positions.free, *(nc + i for i in rates.free)]
    dependent = tuple(names[i] for i in (*positions.dependent, *(nc + i for i in rates.dependent)))
    return Chart(
        Choice(positions.free, rates.free), t, x, p, tuple(names[i] for i in free), dependent, conditioning, wanted <= set(free)
    )


def _chosen(J: np.ndarray, *preferred: Sequence[int]) -> Independent:
    """What is preferred most is given up last, all of it together where the chart is too much worse than the best one."""
    best = independent_entries(J)
    for count in range(len(preferred), 0, -1):
        if not preferred[count - 1]:
            continue
        asked = independent_entries(J, *preferred[:count])
        if _conditioning(asked) >= _KEEP * _conditioning(best):
            return asked
    return best


def _conditioning(entries: Independent) -> float:
    Z = entries.tangent[list(entries.dependent)]
    return float(1 / np.sqrt(1 + np.sum(Z**2)))
