"""Joints: one function `pose(q, t)`; everything else follows by differentiation, or from steps with closed forms."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, final

import casadi as ca

from acausal.language.connector import Rotational, Translational
from acausal.language.expression import Variable
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.motion import Motion, motion_from_pose
from acausal.parts.pose import Pose, symbolic
from acausal.parts.steps import AbstractStep, Turn, chained_pose


class AbstractJoint(AbstractConstraint, ABC):
    """Two frames and how one may move against the other.

    Must declare the variables `q` (configuration, nq entries) and `v` (velocity, nv entries) and provide `pose`.
    With nq = nv and q' = v nothing else is needed; otherwise `rates` gives q' = N(q) v.
    """

    q: Variable
    v: Variable
    if_outside: ClassVar[str] = "They name no pose there, or one twice."
    """What it means, for the user, that q is outside of `domain`: a whole sentence."""
    if_singular: ClassVar[str] = "Its pose has no meaning there."
    """The same where `regular` is zero."""
    socket: AbstractJoint | None = None
    """Where it ends in a point: the ball joint by which a body hangs there, in turns of its own. None: frame_b is a frame, and holds a body's turns."""

    @abstractmethod
    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        """X_ab, the pose of frame_b in frame_a, from the configuration (nq, 1) and time [s]."""

    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        """q' (nq, 1) from the velocity (nv, 1): N(q) v. The identity unless said otherwise."""
        return v

    def invariants(self, q: ca.SX, t: ca.SX) -> ca.SX:
        """What stays zero along every motion because of how q' is made: a quaternion's norm, a gap. (n, 1), empty by default."""
        return ca.SX(0, 1)

    def followed(self, q: ca.SX) -> ca.SX:
        """What stays zero in a motion because coordinates are the values and rates of inputs: q less these. (n, 1), empty by default."""
        return ca.SX(0, 1)

    def domain(self, q: ca.SX) -> ca.SX:
        """Positive where q is meant to be, (n, 1): a wheel's lean within a right angle. Empty by default.

        For coordinates that name a pose twice, or end at its border: starts are looked for inside, and a run that leaves ends there. Positive
        at `start_q`, without unit, of size 1 well inside. It is no stop: nothing holds q there.
        """
        return ca.SX(0, 1)

    def why_outside(self, rows: int) -> tuple[str, ...]:
        """What is said where each of the rows of `domain` is not positive: `if_outside`, unless they have causes of their own."""
        return (self.if_outside,) * rows

    def regular(self, q: ca.SX) -> ca.SX:
        """Zero where the pose has no slope, or none that is continuous: at a cusp, an apex; else positive, of any unit. (n, 1), empty by default.

        A run that comes there ends.
        """
        return ca.SX(0, 1)

    def turns(self) -> tuple[bool, ...] | None:
        """Which entries of q are angles, quaternions, or numbers of no unit, and no lengths; None: what the unit of q says, or the pose."""
        return None

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX | None:
        """Residuals (at least 6 - nq rows) that vanish when frame_b may have the pose X_ab; None if there is no closed form: then the
        joint keeps its coordinates also where it closes a loop.
        """
        return None

    def coordinates(self, X_ab: Pose) -> ca.SX | None:
        """The configuration (nq, 1) that gives the pose X_ab (of frames turned by `mounting`), angles in (-pi, pi]; None if there is no
        closed form. The inverse of `pose`, also a little off the poses that the joint allows.
        """
        return None

    def velocities(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        """The velocity v (nv, 1) that gives this twist (in frame_b); only asked where nv differs from nq. Least squares by default."""
        q, v, t = ca.SX.sym("q", self.q.size), ca.SX.sym("v", self.v.size), ca.SX.sym("t")
        found = self.coordinates(X_ab)
        if found is None:
            raise NotImplementedError(f"{type(self).__name__}.coordinates")
        motion = motion_from_pose(self.pose, self.rates, q, v, t)
        S = ca.substitute(motion.subspace, q, found)
        return ca.solve(S.T @ S, S.T @ ca.vertcat(w_ab_b, v_ab_b))

    def motions(self, q: ca.SX, v: ca.SX, t: ca.SX) -> tuple[Motion, ...]:
        """The joint as a chain of motions, outermost last; a single one by default, by differentiation of `pose`.

        Closed forms are an offer of speed, not of physics: the chain has the pose of `pose` and its twist (`Motion` says what `mounting`,
        `axes` and `spin` oblige to).
        """
        return (motion_from_pose(self.pose, self.rates, q, v, t),)

    def _declare(self, name: str, unit: str, size: int | None = None, start: tuple[float, ...] | None = None) -> None:
        """Give the variable `name` of this joint a unit, size and start of its own, where these depend on what the joint is made with."""
        declared = getattr(type(self), name)
        vars(self)[name] = Variable(
            unit, declared.description, size=size or declared.size, start=declared.start if start is None else start, name=name
        )

    @property
    def flanges(self) -> tuple[Rotational | Translational, ...]:
        """Its scalar ends, whatever they are called: at most one, and only where q is one number; other parts drive q there."""
        return tuple(end for end in self.connectors() if isinstance(end, Rotational | Translational))

    @property
    def moves_by_itself(self) -> bool:
        t = ca.SX.sym("t")
        X = self.pose(self.q.sx, t)
        moves = ca.depends_on(ca.vertcat(ca.vec(symbolic(X.rotation)), symbolic(X.position)), t)
        return moves or not self.rates(self.q.sx, ca.SX.zeros(self.v.size), t).is_zero()

    def start_q(self) -> tuple[float, ...]:
        """Configuration in which a search for initial values begins; zeros unless `q.start` says otherwise."""
        start: Any = self.q.start
        if start is None:
            return (0.0,) * self.q.size
        return tuple(float(s) for s in start) if isinstance(start, list | tuple) else (float(start),) * self.q.size


class AbstractStepJoint(AbstractJoint, ABC):
    """A joint made of elementary steps with closed forms: turn about an axis, slide along one, and so on.

    Must provide `steps()`.
    """

    @abstractmethod
    def steps(self) -> tuple[AbstractStep, ...]:
        """The steps from frame_a to frame_b; each takes its share of q and v in turn."""

    @property
    def is_hinge(self) -> bool:
        """Whether it only turns about one axis, z of its mounting."""
        steps = self.steps()
        return len(steps) == 1 and isinstance(steps[0], Turn)

    @final
    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        return chained_pose(self.steps(), q)

    @final
    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        return ca.vertcat(*(step.rates(q[step.q], v[step.v]) for step in sorted(self.steps(), key=lambda s: s.q.start)))

    @final
    def invariants(self, q: ca.SX, t: ca.SX) -> ca.SX:
        return ca.vertcat(*(step.invariants(q[step.q]) for step in self.steps()))

    @final
    def motions(self, q: ca.SX, v: ca.SX, t: ca.SX) -> tuple[Motion, ...]:
        return tuple(step.motion(q[step.q], v[step.v]) for step in self.steps())
