"""The search for consistent positions, or velocities, from start values of certain variables, whatever the values."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from acausal.graphs import Graph
from acausal.numerics.assembly import Assembled, Residual, assemble, freedom
from acausal.numerics.double_roots import where_solutions_meet
from acausal.numerics.sizes import Drawn, Sizes
from acausal.numerics.thresholds import DEPENDENT, EDGE, STRIDE
from acausal.outputs.state_units import rate_units
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.reduce.reduce import ReducedSystem
from acausal.start.apart import Apart, Moving
from acausal.start.block import Block, alternatives
from acausal.start.block_search import solve_block
from acausal.start.unknowns import Closing, Found, Target, Unknowns
from acausal.start.untorn import UntornBlock, untorn_blocks

_KEPT = 16
_STAY = 1e-3
"""Weight of the orientation of free bodies, which rather stays, against values wished for."""


@dataclass(frozen=True)
class Search:
    """Looks for y with `constraints(y, data)` = 0 that keeps to wishes and to the start `guess`.

    `plain`: pairs of a place in y and a place among the start values that is its value. `settled`: the values say it all.
    `data` are the start values, time, inputs, parameters, and q in the search for velocities.
    """

    what: str
    guess: np.ndarray
    plain: tuple[tuple[int, int], ...]
    exact: tuple[Target, ...] = ()
    wished: tuple[Target, ...] = ()
    closing: tuple[tuple[str, int], ...] = ()
    blocks: tuple[Block, ...] = ()
    whole: Block | None = None
    """All blocks as one."""
    residual: ca.Function | None = None
    """(y, data) -> all rows of the constraints: closing, then exact values."""
    wish: ca.Function | None = None
    """(y, data, first) -> all rows of the wishes: free orientations that stay, then near values."""
    side: ca.Function | None = None
    """(y, data) -> what is positive on the branch that is meant."""
    meant: tuple[tuple[tuple[str, str] | None, int], ...] = ()
    """What that belongs to, see `Closing`."""
    drawn: Apart | None = None
    """Of positions: the sketch."""
    said: bool = False
    """Whether the values say it all, so that only the signs are left to look at."""
    untorn: tuple[UntornBlock, ...] = ()
    """Nonlinear blocks of scalar parts, of velocities."""
    known: dict[bytes, tuple[np.ndarray, Found]] = field(default_factory=dict[bytes, tuple[np.ndarray, Found]], compare=False)
    """Some data of before, and what was found for them."""

    @property
    def settled(self) -> bool:
        """Whether the values leave nothing to search."""
        return self.whole is None

    @property
    def places(self) -> list[int]:
        """Unknowns that constraints or wishes hold."""
        return [i for block in self.blocks for i in block.places]

    @property
    def leading(self) -> list[int]:
        """Unknowns that are states of scalar parts by which nonlinear equations give others."""
        return [block.places[k] for block in self.blocks for k in block.leading]

    @property
    def elastic(self) -> list[int]:
        """Unknowns that deform bodies, or are rates of that."""
        return [block.places[k] for block in self.blocks for k in block.elastic]

    @property
    def staying(self) -> tuple[tuple[int, ...], ...]:
        """Unknowns that stay where the others suffice: what others follow from and what deforms bodies, or else some of these."""
        return alternatives(self.leading, self.elastic)

    @property
    def stride(self) -> float:
        """Velocities enter linearly, so the search may go anywhere at once."""
        return np.inf if self.what == "velocity" else STRIDE

    @property
    def closing_rows(self) -> int:
        """Rows that hold whatever the start values are."""
        return sum(size for _, size in self.closing)

    def first(self, data: np.ndarray, wished: bool = True) -> np.ndarray:
        """Where the search begins: the guess, of positions that for the parameters in the data, with the start values of coordinates put in,
        also those `wished` for.
        """
        first = self._sketch(data).copy()
        exact = {k for target in self.exact for k in range(target.place.start, target.place.stop)}
        for i, k in self.plain:
            if wished or k in exact:
                first[i] = data[k]
        return first

    def solve(self, data: np.ndarray, weights: np.ndarray) -> Found:
        """y (n,) for the data and the weights of all start values; for those of before, or data that differ in nothing that counts here, as it was found then."""
        key = weights.tobytes() + data.tobytes()
        if key not in self.known:
            found = self._found_before(data, weights) or self._solve(data, weights)
            if len(self.known) >= _KEPT:
                self.known.clear()
            self.known[key] = data.copy(), found
        return self.known[key][1]

    def _found_before(self, data: np.ndarray, weights: np.ndarray) -> Found | None:
        if self.whole is None or self.untorn or not self.known:
            return None
        counts, sketch, weighed = self._counting, self._sketch(data), weights.tobytes()
        for key, (before, found) in self.known.items():
            same = key.startswith(weighed) and np.array_equal(before[counts], data[counts])
            if same and np.array_equal(self._sketch(before), sketch):
                return found
        return None

    def _sketch(self, data: np.ndarray) -> np.ndarray:
        return self.guess if self.drawn is None else self.drawn.closed(data)

    @functools.cached_property
    def _counting(self) -> np.ndarray:
        """Places of data that have to do with these unknowns, beside those by which loops of the sketch close: masses have nothing to do with places."""
        assert self.whole is not None
        apart = ca.SX(0, 1) if self.whole.apart is None else self.whole.apart.all.rows
        heard = {s.element_hash() for s in ca.symvar(ca.vertcat(self.whole.hard, self.whole.soft, self.whole.signs, apart))}
        own = {k for target in (*self.exact, *self.wished) for k in range(target.place.start, target.place.stop)}
        places = range(self.whole.whole.numel() - len(self.guess))
        return np.array([k for k in places if k in own or self.whole.whole[k].element_hash() in heard], dtype=int)

    def _solve(self, data: np.ndarray, weights: np.ndarray) -> Found:
        """Block by block."""
        first = self.first(data)
        if self.whole is None or (self.said and self.is_meant(first, data)):
            return Found(first, first, 0.0, 0.0, True)
        factors = self.wish_factors(weights)
        y, closer, informed = first.copy(), self.first(data, wished=False), first.copy()
        for untorn in self.untorn:
            untorn.informed(informed, data, {i for i, _ in self.plain})
        parts: list[Found] = []
        for block, fastest in zip(self.blocks, self._fastest(data, first, factors), strict=True):
            found = solve_block(block, data, first, closer[block.places], factors[block.wished], fastest, informed[block.places])
            y[block.places] = found.y
            parts.append(found)
        worst = max(parts, key=lambda f: (not f.converged, f.part))
        return Found(
            y, first, worst.gap, worst.part, worst.converged, sum(f.iterations for f in parts), sum(f.restarts for f in parts)
        )  # fmt: skip

    def _fastest(self, data: np.ndarray, first: np.ndarray, factors: np.ndarray) -> list[float]:
        """For each block, among velocities, the rate that it would have if it were as fast as the fastest of the others, by what turns or else by what
        shifts, or its own.
        """
        if self.whole is None or not self.whole.units:
            return [0.0] * len(self.blocks)
        off = self.whole.constraints(first, np.concatenate([data, first]))[0]
        sizes = [block.sizes(np.concatenate([data, first]), first, factors[block.wished])[0] for block in self.blocks]
        paces = np.array([block.paces(own) for block, own in zip(self.blocks, sizes, strict=True)])
        moving = np.array([first[block.places].any() or off[block.rows].any() for block in self.blocks])
        found: list[float] = []
        for k, own in enumerate(sizes):
            others = np.max(paces[moving & (np.arange(len(sizes)) != k)], axis=0, initial=0.0)
            times = [most / pace for most, pace in zip(others, paces[k], strict=True) if most > 0 and pace > 0]
            turns = self.blocks[k].unknowns.turning.any()  # what else is much has no other measure than itself
            found.append(own.rate * max([float(turns), *times[:1]]))
        return found

    def at_meeting(self, found: Found, data: np.ndarray) -> Found | None:
        """The same, at the place where two solutions meet if it is next to one, as where loops lie flat."""
        if self.whole is None or not found.iterations:
            return None
        rows, sizes = self.rows(data, found.first), self.sizes(data, found.first)
        y = where_solutions_meet(rows, found.y, sizes)
        if y is None or not self.is_meant(y, data):
            return None
        left = np.abs(rows(y)[0])
        return replace(found, y=y, gap=float(np.max(left)), part=float(np.max(left / sizes.rows)))

    def sizes(self, data: np.ndarray, first: np.ndarray) -> Sizes:
        """What is much for all unknowns and constraints: for unknowns in no constraint 1."""
        assert self.whole is not None
        unknowns, rows = np.ones(first.size), np.ones(len(self.whole.rows))
        whole = np.concatenate([data, first])
        for block in self.blocks:
            found, _ = block.sizes(whole, first, np.ones(len(block.wished)))
            unknowns[block.places], rows[block.rows] = found.unknowns, found.rows
        found, _ = self.whole.sizes(whole, first, np.ones(len(self.whole.wished)))
        return replace(found, unknowns=unknowns, rows=rows)

    def rows(self, data: np.ndarray, first: np.ndarray, kept: Sequence[int] | None = None) -> Residual:
        """The constraints at `data`; only the rows `kept`, if given."""
        assert self.whole is not None
        residual = self.whole.constraints.at(np.concatenate([data, first]))

        def rows(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            c, J = residual(y)
            return (c, J) if kept is None else (c[kept], J[kept])

        return rows

    def apart(self, data: np.ndarray, first: np.ndarray) -> Residual:
        """How far positions are from the sketch, y -> (k,) and its Jacobian, in parts of what is much."""
        found = None if self.whole is None else self.whole.apart_at(np.concatenate([data, first]), self.sizes(data, first))
        return found or (lambda y: (y - first, np.eye(first.size)))

    def wish_rows(self, data: np.ndarray, first: np.ndarray, weights: np.ndarray) -> Residual | None:
        """The wishes at `data`, near values weighted, as parts of their sizes; None without any."""
        if self.whole is None or self.whole.wishes is None:
            return None
        residual = self.whole.wishes.at(np.concatenate([data, first]))
        factors = self.wish_weights(data, first, weights)

        def rows(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            r, J = residual(y)
            return factors * r, factors[:, None] * J

        return rows

    def wish_factors(self, weights: np.ndarray) -> np.ndarray:
        """What each row of the wishes is multiplied by: roots of the weights."""
        near = np.concatenate([np.zeros(0), *(weights[t.place] for t in self.wished)])
        rows = 0 if self.whole is None else len(self.whole.wished)
        return np.concatenate([np.full(rows - near.size, _STAY), np.sqrt(near)])

    def wish_weights(self, data: np.ndarray, first: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """The same, divided by what is much in the row."""
        factors = self.wish_factors(weights)
        if self.whole is None:
            return factors
        return factors / self.whole.sizes(np.concatenate([data, first]), first, factors)[1]

    def is_meant(self, y: np.ndarray, data: np.ndarray) -> bool:
        """Whether hinges that close loops turn the way that is meant, their axes not opposite, and wheels roll the right side up."""
        return self.whole is None or self.whole.is_meant(y, np.concatenate([data, y]))

    def outside(self, y: np.ndarray, data: np.ndarray) -> tuple[str, str] | None:
        """A joint that is outside of its domain, with its line, and why it must not be; None where none is."""
        signs = np.zeros(0) if self.side is None else np.array(self.side(y, data)).ravel()
        for joint, size in self.meant:
            if joint is not None and not np.all(signs[:size] > EDGE):
                return joint
            signs = signs[size:]
        return None

    def jacobian(self, y: np.ndarray, data: np.ndarray) -> np.ndarray:
        """d residual / dy, (m, n), for searches with constraints. Unlike `rows` for many threads at once."""
        return np.array(self._slopes(y, data)[0]).reshape(-1, y.size)

    @functools.cached_property
    def _slopes(self) -> ca.Function:
        """(y, data) -> d residual / dy, d residual / d data."""
        assert self.residual is not None
        return self.residual.factory("slopes", ["y", "data"], ["jac:c:y", "jac:c:data"])

    def wish_jacobian(self, y: np.ndarray, data: np.ndarray, first: np.ndarray) -> np.ndarray:
        """d wish / dy, (m, n), for searches with wishes, without weights."""
        assert self.wish is not None
        return np.array(self.wish.factory("J", ["y", "data", "first"], ["jac:r:y"])(y, data, first)).reshape(-1, y.size)

    def close(self, guess: np.ndarray, data: np.ndarray, kept: Sequence[int], sizes: Sizes) -> Assembled:
        """One search from `guess` that meets the rows `kept` of the constraints only."""
        return assemble(self.rows(data, guess, kept), guess, sizes=sizes.of(kept), stride=self.stride)

    def left_open(self, y: np.ndarray, data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions dy (n, k) that keep the constraints and the start values that y repeats, none where nothing ties unknowns to one another; and
        what is much for each unknown (n,).
        """
        if self.residual is None or self.whole is None:
            return np.zeros((y.size, 0)), np.ones(y.size)
        sizes, repeated = self.sizes(data, self.first(data)), np.eye(y.size)[[i for i, _ in self.plain]]
        held = np.vstack([sizes.scaled(self.jacobian(y, data)), repeated])
        return sizes.unknowns[:, None] * freedom(held, sizes.dependent), sizes.unknowns

    def derivative(self, y: np.ndarray, data: np.ndarray, change: np.ndarray) -> np.ndarray:
        """dy (n, k) when the data change by the columns of `change` (size of data, k): the start values that y repeats, and then the
        least change that keeps the constraints.
        """
        first = np.zeros((y.size, change.shape[1]))
        for i, k in self.plain:
            first[i] = change[k]
        if self.residual is None:
            return first
        J, by_data = (np.array(part) for part in self._slopes(y, data))
        sizes = self.sizes(data, self.first(data))
        scaled = sizes.scaled(J)
        off = (J @ first + by_data @ change) / sizes.rows[:, None]
        for still in (*self.staying, ()):
            kept = scaled.copy()
            kept[:, list(still)] = 0.0
            step = np.linalg.pinv(kept, rcond=sizes.dependent) @ off
            if not still or np.abs(kept @ step - off).max(initial=0.0) <= DEPENDENT * np.abs(off).max(initial=0.0):
                return first - sizes.unknowns[:, None] * step
        return first


def start_search(
    what: str,
    unknowns: Unknowns,
    wanted: ca.SX,
    closing: Closing,
    targets: list[Target],
    guess: np.ndarray,
    kept: list[int],
    system: ReducedSystem,
) -> Search:
    """`kept`: entries of y that rather stay as they are than make up for others."""
    y, data = unknowns.y, unknowns.data
    exact = tuple(t for t in targets if t.exact)
    wished = tuple(t for t in targets if not t.exact)
    plain = tuple(_plain(y, wished + exact))
    entries = sum(t.size for t in exact)
    settled = not closing.residual.numel() and not wished and len({i for i, _ in plain}) == len(plain) == entries
    first = ca.SX.sym("first", y.numel())
    apart = None if unknowns.linear else Apart(system, y, first, ca.SX.sym("drawn", y.numel()))
    if y.numel() == 0 or (settled and not closing.signs.numel()):
        return Search(what, guess, plain, exact, wished, drawn=apart)
    whole = ca.vertcat(data, first)
    hard = ca.vertcat(closing.residual, *(_difference(t, wanted) for t in exact))
    stay = y[kept] - first[kept] if kept and targets else ca.SX(0, 1)
    soft = ca.vertcat(stay, *(_difference(t, wanted) for t in wished))
    units = [t.unit or t.name for t in wished for _ in range(t.size)]
    names = ["", *dict.fromkeys(units)]
    alike = np.array([0] * stay.numel() + [names.index(unit) for unit in units], dtype=int)
    rest = hard.numel() - closing.residual.numel()
    drawn = Drawn.joined([closing.drawn, Drawn.exact(rest)])
    n, m, k = y.numel(), hard.numel(), soft.numel()
    all = list(range(n)), list(range(m)), list(range(k))
    moving = Moving(system, y, first) if unknowns.linear and system.constraints.loops else None
    winding = () if unknowns.linear else tuple(k for k in range(closing.residual.numel()) if hard[k].op() == ca.OP_ATAN2)
    asked = [t.unit for t in exact for _ in range(t.size)]
    units = (*rate_units(system), *[""] * closing.residual.numel(), *asked) if unknowns.linear else ()
    everything = Block(
        unknowns, *all, whole, hard, soft, closing.signs, alike, drawn, apart or moving, winding=winding, units=units
    )
    side = ca.Function("side", [y, data], [ca.densify(closing.signs)]) if closing.signs.numel() else None
    return Search(
        what,
        guess,
        plain,
        exact,
        wished,
        closing.owners,
        tuple(_led(block, y, system) for block in _blocks(everything)),
        everything,
        ca.Function("residual", [y, data], [hard], ["y", "data"], ["c"]),
        ca.Function("wishes", [y, data, first], [soft], ["y", "data", "first"], ["r"]) if soft.numel() else None,
        side,
        closing.meant,
        apart,
        settled,
        untorn_blocks(unknowns, system) if unknowns.linear else (),
    )


def _blocks(whole: Block) -> tuple[Block, ...]:
    """Parts of y that no row connects, in the order of their first unknown; unknowns in no row are in none."""
    nodes: list[tuple[str, int]] = []
    edges: list[tuple[tuple[str, int], tuple[str, int]]] = []
    for kind, rows in (("hard", whole.hard), ("soft", whole.soft), ("sign", whole.signs)):
        nodes += [(kind, i) for i in range(rows.numel())]
        i, j = ca.jacobian_sparsity(rows, whole.unknowns.y).get_triplet() if rows.numel() else ([], [])
        edges += [((kind, a), ("y", b)) for a, b in zip(i, j, strict=True)]
    together = Graph(nodes, edges).parts()
    lost = [part[0] for part in together if len(part) == 1]  # rows without unknowns
    parts = [sorted(part) for part in together if len(part) > 1]
    parts.sort(key=lambda part: min(k for kind, k in part if kind == "y"))
    if len(parts) <= 1:
        return (whole,)
    parts[0] = sorted([*parts[0], *lost])  # they hold or not, whatever y is
    found: list[Block] = []
    for part in parts:
        places, hard, soft, signs = ([k for kind, k in part if kind == wanted] for wanted in ("y", "hard", "soft", "sign"))
        found.append(
            Block(
                whole.unknowns.only(places), places, hard, soft, whole.whole, whole.hard[hard, :], whole.soft[soft, :],
                whole.signs[signs, :] if signs else ca.SX(0, 1), whole.alike[soft], whole.drawn.of(hard), whole.apart,
                winding=tuple(i for i, k in enumerate(hard) if k in whole.winding),
                units=tuple(whole.units[k] for k in (*places, *(whole.unknowns.y.numel() + k for k in hard))) if whole.units else (),
            )
        )  # fmt: skip
    return tuple(found)


def _led(block: Block, y: ca.SX, system: ReducedSystem) -> Block:
    """The same, with the states of scalar parts in it that others follow, and what deforms elastic bodies."""
    here = {y[i].element_hash(): k for k, i in enumerate(block.places)}
    own = [(here.get(system.x[i].element_hash()), k in system.scalar.followers) for k, i in enumerate(system.scalar_places)]
    follow = any(place is not None and follows for place, follows in own)
    leading = tuple(place for place, follows in own if place is not None and not follows) if follow else ()
    bodies = [item for item in system.tree_joints if isinstance(item.edge.joint, AbstractElasticBody)]
    tree = system.mechanics.tree
    deforming = [
        entry.element_hash() for item in bodies for entry in (*ca.vertsplit(tree.q[item.q]), *ca.vertsplit(tree.v[item.v]))
    ]
    return replace(block, leading=leading, elastic=tuple(sorted(here[k] for k in deforming if k in here)))


def _plain(y: ca.SX, targets: Sequence[Target]) -> list[tuple[int, int]]:
    """Places in y and among the start values, of targets that are entries of y."""
    place = {y[i].element_hash(): i for i in range(y.numel())}
    pairs: list[tuple[int, int]] = []
    for target in targets:
        for k in range(target.size):
            entry = target.expression[k]
            if entry.is_symbolic() and entry.element_hash() in place:
                pairs.append((place[entry.element_hash()], target.place.start + k))
    return pairs


def _difference(t: Target, wanted: ca.SX) -> ca.SX:
    difference = t.expression - wanted[t.place]
    return ca.atan2(ca.sin(difference), ca.cos(difference)) if t.periodic else difference
