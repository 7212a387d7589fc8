"""Joints and constraints looked at by themselves, in numbers: what their methods say must agree at configurations of no special kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.language.expression import Parameter, declared_in, time
from acausal.numerics.thresholds import EDGE, RANK
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.joint import AbstractJoint
from acausal.parts.motion import motion_from_pose
from acausal.parts.pose import Pose, symbolic

_TIME = 0.3
_SPREADS = (1.0, 1e-3, 1e-6, 1e-9)
_ITERATIONS = 60
_FLAT = 1e-6
_BESIDE = 2.0 ** -np.arange(1, 40)

Values = Callable[..., list[np.ndarray]]


def rotated(g: ca.SX) -> ca.SX:
    """The rotation by half-angles g (3, 1): Rodrigues parameters."""
    G = ca.skew(g)
    return ca.SX.eye(3) + 2 / (1 + ca.sumsqr(g)) * (G + G @ G)


def _function(arguments: Sequence[ca.SX], results: Sequence[ca.SX]) -> Values:
    """With time and parameters as they are now."""
    dense = [ca.densify(r) for r in results]
    parameters = [s for s in declared_in(ca.vertcat(*(ca.vec(r) for r in dense))) if isinstance(s, Parameter)]
    known = [time.sx, ca.vertcat(ca.SX(0, 1), *(p.sx for p in parameters))]
    function, values = ca.Function("looked", [*arguments, *known], dense), [p.value for p in parameters]
    return lambda *at: [np.array(part).reshape(part.shape) for part in function.call([*at, _TIME, values])]


@dataclass(frozen=True)
class LookedJoint:
    """A joint of rigid frames, and two configurations of no special kind that meet its invariants; none where no such are found."""

    joint: AbstractJoint
    at: tuple[np.ndarray, ...]

    @staticmethod
    def at_random(joint: AbstractJoint) -> LookedJoint:
        q = ca.SX.sym("q", joint.q.size)
        rows = joint.invariants(q, time.sx)
        X, domain = joint.pose(q, time.sx), joint.domain(q)
        look = _function(
            [q], [rows, ca.jacobian(rows, q), ca.vertcat(ca.vec(symbolic(X.rotation)), symbolic(X.position)), domain]
        )
        rng, start = np.random.default_rng(0), np.array(joint.start_q(), dtype=float)
        for spread in _SPREADS:
            found = [_met(look, start + spread * rng.uniform(0.1, 0.9, start.size)) for _ in range(2)]
            good = tuple(one for one in found if one is not None)
            if good:
                return LookedJoint(joint, good)
        return LookedJoint(joint, ())

    def faults(self) -> Iterator[tuple[str, str]]:
        """Methods, and what is wrong with what they give."""
        if not self.at or isinstance(self.joint, AbstractElasticBody):
            return
        yield from self._velocities()
        yield from self._closure()
        yield from self._coordinates()
        yield from self._motions()

    @property
    def _symbols(self) -> tuple[ca.SX, ca.SX]:
        return ca.SX.sym("q", self.joint.q.size), ca.SX.sym("v", self.joint.v.size)

    def _each(self, look: Values) -> Iterator[list[np.ndarray]]:
        rng = np.random.default_rng(1)
        for q in self.at:
            found = look(q, rng.uniform(0.5, 1.0, self.joint.v.size))
            if all(np.isfinite(part).all() for part in found):
                yield found

    def _velocities(self) -> Iterator[tuple[str, str]]:
        joint, (q, v) = self.joint, self._symbols
        rates, rows = joint.rates(q, v, time.sx), joint.invariants(q, time.sx)
        slope = ca.jacobian(rows, q)
        change = slope @ rates + ca.jtimes(rows, time.sx, ca.SX(1))
        S = motion_from_pose(joint.pose, joint.rates, q, v, time.sx).subspace
        for moving, off, terms in self._each(_function([q, v], [S, change, ca.fabs(slope) @ ca.fabs(rates)])):
            if _rank(moving) < joint.v.size:
                yield (
                    "pose(q, t)",
                    f"moves frame_b in {_rank(moving)} ways with the {joint.v.size} velocities of v. Each must move it by itself: give q and v "
                    "fewer entries, or use them all in `pose` and `rates`.",
                )
            if (np.abs(off) > EDGE * terms).any():
                yield (
                    "invariants(q, t)",
                    "do not stay zero along q' = rates(q, v, t). They are what follows from the rates; what is to be forbidden is a constraint.",
                )

    def _closure(self) -> Iterator[tuple[str, str]]:
        joint, (q, v) = self.joint, self._symbols
        R, p, w, u = ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3), ca.SX.sym("w", 3), ca.SX.sym("u", 3)
        rows = joint.closure(Pose(R, p), time.sx)
        if rows is None:
            return
        rates = joint.closure_rates(Pose(R, p), w, u, time.sx)
        by_R, by_p = ca.jacobian(rows, ca.vec(R)), ca.jacobian(rows, p)
        turn = ca.jacobian(ca.vec(R @ ca.skew(w)), w)
        A = ca.vertcat(ca.horzcat(by_R @ turn, by_p @ R), ca.jacobian(rates, ca.vertcat(w, u)))
        terms = ca.fabs(by_R) @ ca.fabs(ca.vec(R)) + ca.fabs(by_p) @ ca.fabs(p)
        motion = motion_from_pose(self._turned, joint.rates, q, v, time.sx)
        X = [symbolic(motion.pose.rotation), symbolic(motion.pose.position)]
        there = _function([R, p, w, u], [rows, terms, A, rates])
        for rotation, position, twist in self._each(_function([q, v], [*X, motion.twist])):
            off, size, slopes, slips = there(rotation, position, twist[:3], twist[3:])
            if not np.isfinite(slopes).all():
                continue
            sizes = np.abs(slopes) @ np.abs(twist)
            if (np.abs(off) > EDGE * size).any() or (np.abs(slips) > EDGE * sizes[off.size :]).any():
                yield (
                    "closure(X_ab, t)",
                    "does not vanish at the poses of pose(q, t). X_ab is that pose, of frames turned by `mounting`: both say what the joint allows.",
                )
            elif _rank(slopes.T) < 6 - joint.v.size:
                yield (
                    "closure(X_ab, t)",
                    f"and closure_rates forbid {_rank(slopes.T)} motions, where {joint.v.size} velocities leave {6 - joint.v.size} to forbid. Add "
                    "rows, with independent slopes wherever they vanish; or leave `closure` out.",
                )

    def _coordinates(self) -> Iterator[tuple[str, str]]:
        joint, (q, v) = self.joint, self._symbols
        X = self._turned(q, time.sx)
        found = joint.coordinates(X)
        if found is None:
            return
        back = ca.SX.sym("back", joint.q.size)
        Y = self._turned(back, time.sx)
        gap = ca.vertcat(
            ca.vec(symbolic(Y.rotation) - symbolic(X.rotation)), (symbolic(Y.position) - symbolic(X.position)) / _length(X)
        )
        gap = ca.substitute(gap, back, found)
        for (off,) in self._each(_function([q, v], [gap])):
            if (np.abs(off) > EDGE).any():
                yield (
                    "coordinates(X_ab)",
                    "are not those of the pose: pose(q, t) gives another one with them. They are the inverse of `pose`, of frames turned by "
                    "`mounting`.",
                )

    def _motions(self) -> Iterator[tuple[str, str]]:
        joint, (q, v) = self.joint, self._symbols
        meant = motion_from_pose(joint.pose, joint.rates, q, v, time.sx)
        X, twist = Pose.identity(), ca.SX.zeros(6)
        for motion in joint.motions(q, v, time.sx):
            M, spin, at_rest = Pose(motion.mounting, np.zeros(3)), Pose(motion.spin, np.zeros(3)), ca.SX.zeros(6)
            for pose, own in ((M, at_rest), (motion.pose, motion.twist), (spin, at_rest), (M.inverse(), at_rest)):
                R, p = symbolic(pose.rotation), symbolic(pose.position)
                carried = ca.vertcat(R.T @ twist[:3], R.T @ (twist[3:] + ca.cross(twist[:3], p)))
                X, twist = X @ pose, carried + own
        length = _length(meant.pose)
        speed = ca.norm_2(meant.twist[3:]) + ca.norm_2(meant.twist[:3]) * length
        gap = ca.vertcat(
            ca.vec(symbolic(X.rotation) - meant.pose.rotation),
            (symbolic(X.position) - meant.pose.position) / length,
            (twist[:3] - meant.twist[:3]) / ca.fmax(ca.norm_2(meant.twist[:3]), speed / length),
            (twist[3:] - meant.twist[3:]) / speed,
        )
        for (off,) in self._each(_function([q, v], [gap])):
            if (np.abs(off) > EDGE).any():
                yield (
                    "motions(q, v, t)",
                    "have another pose, or twist, than pose(q, t) and rates(q, v, t). Leave the method out: motions follow from these.",
                )

    def _turned(self, q: ca.SX, t: ca.SX) -> Pose:
        """The pose of frames turned by `mounting`."""
        M = Pose(self.joint.mounting(), np.zeros(3))
        return M.inverse() @ self.joint.pose(q, t) @ M


def one_sided_rows(constraint: AbstractConstraint) -> list[int]:
    """Rows of its closure that have one sign to both sides of where they vanish, as squares and distances have, or no slope: they hold nothing.

    Looks at each by itself, from a pose of no special kind along its slope. Rows that vanish nowhere near are not among them.
    """
    y = ca.SX.sym("y", 6)
    rows = constraint.closure(Pose(rotated(y[:3]), y[3:]), time.sx)
    if rows is None:
        return []
    found: list[int] = []
    for k in range(rows.numel()):
        look = _function([y], [rows[k], ca.jacobian(rows[k], y)])
        starts = np.random.default_rng(0).uniform(-0.7, 0.7, (4, 6))
        way = next((way for z in starts if (way := _to_zero(look, z)) is not None), None)
        usual = max(float(np.linalg.norm(np.nan_to_num(look(z)[1]))) for z in starts)
        if usual == 0 or (way is not None and (_is_flat(look, way[0], usual) or not _changes_sign(look, *way))):
            found.append(k)
    return found


def _to_zero(look: Values, first: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """From a pose to where the row vanishes, and how far it was; None where it is not found."""
    z, begun = first, abs(look(first)[0].item())
    for _ in range(_ITERATIONS):
        value, slope = look(z)
        square = float(np.sum(slope**2))
        if abs(value.item()) <= 1e-15 * begun or not (square > 0 and np.isfinite(square)):
            break
        z = z - slope[0] * (value.item() / square)
    return (z, z - first) if 0 < begun < np.inf and abs(look(z)[0].item()) <= 1e-9 * begun else None


def _is_flat(look: Values, z: np.ndarray, usual: float) -> bool:
    """Whether a row has next to nothing of its `usual` slope at z."""
    return float(np.linalg.norm(look(z)[1])) <= _FLAT * usual


def _changes_sign(look: Values, z: np.ndarray, way: np.ndarray) -> bool:
    """Whether a row has other signs before and behind z, at some distance on this way or along the slopes there."""
    for h in _BESIDE:
        ahead, behind = look(z + h * way)[0].item(), look(z - h * way)[0].item()
        if ahead * behind < 0 or not np.isfinite(ahead * behind):
            return True
    return False


def _met(look: Values, q: np.ndarray) -> np.ndarray | None:
    """The configuration near q with invariants zero; None where there is none, outside of the domain, or where the pose is no number."""
    first = float(np.max(np.abs(look(q)[0]), initial=0.0))
    for _ in range(_ITERATIONS):
        rows, slope, pose, domain = look(q)
        if not all(np.isfinite(part).all() for part in (rows, slope, pose)):
            return None
        if np.max(np.abs(rows), initial=0.0) <= 1e-13 * first:
            return q if (domain > 0).all() else None
        q = q - np.linalg.lstsq(slope, rows[:, 0], rcond=None)[0]
    return None


def _rank(S: np.ndarray) -> int:
    """Of columns (6, n), angular first: lengths are measured by the longest of them, and columns have length 1."""
    S = S[:, np.any(S != 0, axis=0)]
    turn, shift = (float(np.max(np.abs(part), initial=0.0)) for part in (S[:3], S[3:]))
    if turn and shift:
        S = np.vstack([S[:3] / turn, S[3:] / shift])
    length = np.linalg.norm(S, axis=0)
    return int(np.sum(np.linalg.svd(S / length, compute_uv=False) > RANK)) if S.size else 0


def _length(X: Pose) -> ca.SX:
    """Of a position, or 1 where that is zero."""
    p = ca.norm_2(symbolic(X.position))
    return ca.if_else(p > 0, p, 1)
