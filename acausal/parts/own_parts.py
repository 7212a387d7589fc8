"""Parts that users write, looked at by themselves: each method is called once with symbols, and what it gives is what it should be."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import AcausalError, ModelError, ParameterError
from acausal.language.component import Component
from acausal.language.equation import Equation
from acausal.language.expression import Expression, Parameter, Time, Variable, check_formula, declared, sx, time
from acausal.language.flatten import FlatSystem, Part
from acausal.language.origin import is_users, shortened
from acausal.numerics.thresholds import EDGE
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.contact import AbstractTouch
from acausal.parts.field import AbstractField
from acausal.parts.force import AbstractForce, AbstractLineForce, Action
from acausal.parts.force_check import FreePlacement, symbols_read, unbalanced_power
from acausal.parts.inertia import Inertia
from acausal.parts.joint import AbstractJoint
from acausal.parts.motion import Motion
from acausal.parts.pose import Pose, symbolic
from acausal.parts.pose_check import LookedJoint, one_sided_rows
from acausal.parts.potential import AbstractPotential
from acausal.parts.rigid import AbstractRigidPart, Attachment

_CHOICE = " In place of Python's `if`, max and min write ca.if_else, ca.fmax and ca.fmin."


@dataclass(frozen=True)
class OwnPart:
    """A part of a user's own class, and the scene that it stands in."""

    part: Part
    flat: FlatSystem

    def check(self) -> None:
        """Raises `ModelError` or `ParameterError` with the part, its line, the method, and what it gives."""
        component = self.part.component
        if type(component).equations is not Component.equations:
            for k, equation in enumerate(self._called("equations()", lambda: _listed(component.equations())), start=1):
                if isinstance(equation, Equation):
                    check_formula(equation.residual.sx, f"Equation {k} of {self.part.where}")
            self._check_energies(component)
        if isinstance(component, AbstractJoint):
            self._check_joint(component)
        if isinstance(component, AbstractConstraint):
            self._check_constraint(component)
        if isinstance(component, AbstractTouch):
            found = self._called("touch()", component.touch)
            if not (
                isinstance(found, tuple)
                and len(found) == 2
                and all(isinstance(e, Expression) and e.shape == (3, 1) for e in found)
            ):
                raise self._error(
                    "touch()",
                    f"gives {shown(found)}. Return the point and the normal in the world frame, expressions (3, 1) of frames.",
                )
        if isinstance(component, AbstractForce):
            self._check_force(component)
        if isinstance(component, AbstractField):
            place = ca.SX.sym("p", 3)
            self._scalar("potential(p, t)", lambda: component.potential(place, time.sx), (place,))
        if isinstance(component, AbstractRigidPart):
            self._check_rigid(component)

    def _error(self, call: str, what: str) -> ModelError:
        return ModelError(f"{self.part.where}: {type(self.part.component).__name__}.{call} {what}")

    def _called(self, call: str, method: Callable[[], Any]) -> Any:
        """What a method gives. Errors in it are told with its line."""
        try:
            return method()
        except AcausalError:
            raise
        except Exception as error:
            lines = [frame for frame in traceback.extract_tb(error.__traceback__) if is_users(frame.filename)]
            inside = f" at {shortened(lines[-1].filename)}:{lines[-1].lineno}" if lines else ""
            text = " ".join(str(error).split("\n\n")[0].split())
            text = text if len(text) < 160 else text[:158] + " …"
            raise self._error(
                call,
                f"fails{inside}: {type(error).__name__}: {text.rstrip('.')}. It is called as {call}, with CasADi's symbols as arguments."
                f"{_CHOICE if 'truth value' in text else ''}",
            ) from error

    def _column(self, call: str, method: Callable[[], Any], known: Sequence[ca.SX], rows: int | None = None) -> ca.SX:
        """An `SX` column of these symbols and parameters."""
        found = self._called(call, method)
        if not isinstance(found, ca.SX):
            hint = " Write .sx behind parameters, or sx(self.k)." if isinstance(found, Expression) else ""
            raise self._error(
                call, f"gives {shown(found)}. Return a column of CasADi's SX: ca.vertcat(...), or ca.SX(0, 1) for none.{hint}"
            )
        if found.shape[1] != 1 or (rows is not None and found.shape[0] != rows):
            raise self._error(call, f"gives a matrix {found.shape}, not a column{'' if rows is None else f' of {rows}'}.")
        self._check_symbols(call, found, known)
        return found

    def _check_symbols(self, call: str, value: ca.SX, known: Sequence[ca.SX]) -> None:
        check_formula(value, f"{self.part.where}: {call}")
        own = {s.element_hash() for column in known for s in ca.vertsplit(ca.vec(column))}
        for scalar in ca.symvar(value):
            symbol = declared(scalar)
            if scalar.element_hash() in own or isinstance(symbol, Time):
                continue
            if symbol is None:
                raise self._error(call, f"contains the symbol '{scalar.name()}', which is declared nowhere.")
            if symbol not in self.flat.names:
                raise self._error(
                    call,
                    f"contains {symbol!r}, which belongs to no part of the scene. Keep it as an attribute: self.name = ... or scene.name = ...",
                )
            if not isinstance(symbol, Parameter):
                raise self._error(
                    call, f"contains {self.flat.names[symbol]}. Only its own arguments, time and parameters may stand in it."
                )

    def _check_joint(self, joint: AbstractJoint) -> None:
        for name, meaning in (("q", "configuration"), ("v", "velocity")):
            if not isinstance(getattr(type(joint), name, None), Variable):
                raise ModelError(
                    f'{self.part.where}: a joint declares its {meaning} in the class body: {name} = ac.Variable("rad").'
                )
        allowed = 1 if joint.q.size == joint.v.size == 1 else 0
        if len(joint.flanges) > allowed:
            raise ModelError(
                f"{self.part.where} has {joint.q.size} coordinates and the flanges {', '.join(f.name for f in joint.flanges)}. A joint of one coordinate "
                "may have one flange, through which other parts drive q; a joint of more has none: compose it of joints that have one."
            )
        q, v, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("v", joint.v.size), time.sx
        R, p = self._pose("pose(q, t)", lambda: joint.pose(q, t), (q,))
        rates = self._column("rates(q, v, t)", lambda: joint.rates(q, v, t), (q, v))
        if rates.numel() != q.numel():
            raise ModelError(
                f"{self.part.where}: {type(joint).__name__} has {q.numel()} configuration variables (q) and {rates.numel()} rates of them. Without "
                f"rates(q, v, t), q and v have the same size; v has {v.numel()}."
            )
        if v.numel() and ca.depends_on(ca.jacobian(rates, v), v):
            raise self._error(
                "rates(q, v, t)", "is not linear in v. q' = N(q) v: each rate is a sum of velocities with factors of q."
            )
        kept = self._column("invariants(q, t)", lambda: joint.invariants(q, t), (q,))
        for k in range(kept.numel()):
            if not ca.depends_on(kept[k], q):
                raise self._error(
                    "invariants(q, t)",
                    f"has a row {k} that does not depend on q. They are what stays zero, because of how q' is made.",
                )
        self._column("domain(q)", lambda: joint.domain(q), (q,))
        self._column("regular(q)", lambda: joint.regular(q), (q,))
        self._check_rotation(joint, R, q)
        if q.numel() and not ca.depends_on(ca.vertcat(ca.vec(R), p), q):
            raise self._error("pose(q, t)", "does not depend on q, so the joint cannot move. Use q in it.")
        motions = self._called("motions(q, v, t)", lambda: joint.motions(q, v, t))
        if not (isinstance(motions, tuple) and all(isinstance(m, Motion) for m in motions)):
            raise self._error("motions(q, v, t)", f"gives {shown(motions)}. Return a tuple of Motion, or leave the method out.")
        if not motions or sum(m.nv for m in motions) != v.numel():
            raise self._error("motions(q, v, t)", f"have {sum(m.nv for m in motions)} velocities together; v has {v.numel()}.")
        self._column("followed(q)", lambda: joint.followed(q), (q,))
        turns = self._called("turns()", joint.turns)
        if turns is not None and not (isinstance(turns, list | tuple) and len(turns) == q.numel()):
            raise self._error("turns()", f"gives {shown(turns)}. Return a tuple of {q.numel()} truths, one for each entry of q.")
        start = self._called("start_q()", joint.start_q)
        if not (isinstance(start, list | tuple) and len(start) == q.numel() and np.isfinite(start).all()):
            raise self._error("start_q()", f"gives {shown(start)}. Return a tuple of {q.numel()} finite numbers.")
        self._check_slope(joint, ca.vertcat(ca.vec(R), p), q)

    def _pose(self, call: str, method: Callable[[], Any], known: Sequence[ca.SX]) -> tuple[ca.SX, ca.SX]:
        found = self._called(call, method)
        if not isinstance(found, Pose):
            raise self._error(call, f"gives {shown(found)}. Return Pose(rotation, position).")
        self._check_matrix(call, "rotation", found.rotation)
        self._check_matrix(call, "position", found.position)
        R, p = symbolic(found.rotation), symbolic(found.position)
        if R.shape != (3, 3) or p.shape != (3, 1):
            raise self._error(call, f"gives a rotation {R.shape} and a position {p.shape}, not (3, 3) and (3, 1).")
        self._check_symbols(call, ca.vertcat(ca.vec(R), p), known)
        return R, p

    def _check_matrix(self, call: str, name: str, value: Any) -> None:
        if not isinstance(value, np.ndarray | ca.SX) or (isinstance(value, np.ndarray) and value.dtype.kind not in "fiu"):
            raise self._error(
                call, f"gives {shown(value)} as {name}. It must be CasADi's SX or an array of numpy; write .sx behind parameters."
            )

    def _check_rotation(self, joint: AbstractJoint, R: ca.SX, q: ca.SX) -> None:
        """At a configuration of no special kind that meets the joint's own invariants; joints with invariants are not tried."""
        if joint.invariants(q, time.sx).numel():
            return
        self._check_orthogonal("pose(q, t)", R, q, np.random.default_rng(0).uniform(0.1, 0.9, q.numel()))

    def _check_orthogonal(self, call: str, R: ca.SX, q: ca.SX, at: np.ndarray) -> None:
        gap = ca.densify(ca.vertcat(ca.vec(R.T @ R - ca.SX.eye(3)), ca.det(R)))
        *off, det = self._at(gap, q, at)
        if np.isfinite(off).all() and (np.max(np.abs(off)) > EDGE or det < 0):
            raise self._error(
                call,
                "gives a matrix that is no rotation (its columns are not unit vectors at right angles, right-handed). Build it from "
                "rotation_about_z(...) and products of rotations.",
            )

    def _check_slope(self, joint: AbstractJoint, entries: ca.SX, q: ca.SX) -> None:
        """Two derivatives of the pose exist where the search for start values begins, unless rough poses of bodies say where that is."""
        bodies = [p.component for p in self.flat.parts if isinstance(p.component, AbstractRigidPart)]
        if not q.numel() or any(body.sketch_pose() is not None for body in bodies):
            return
        start = np.array(joint.start_q())
        slope = ca.jacobian(entries, q)
        both = ca.vertcat(ca.vec(slope), ca.vec(ca.jacobian(ca.vec(slope), q)))
        if not np.isfinite(self._at(ca.densify(both), q, start)).all():
            raise self._error(
                "pose(q, t)",
                f"has no two derivatives at q = {start.tolist()}, where the search for start values begins. Write it so that it has, or begin "
                "elsewhere: q = ac.Variable(..., start=...).",
            )

    def _at(self, column: ca.SX, q: ca.SX, values: np.ndarray) -> np.ndarray:
        """Values of a column by q at t = 0.3 s, with parameters as they are."""
        parameters = self.flat.parameters
        p = ca.vertcat(ca.SX(0, 1), *(entry.sx for entry in parameters))
        return np.array(
            ca.Function("value", [q, time.sx, p], [column])(values, 0.3, [entry.value for entry in parameters])
        ).ravel()

    def _check_constraint(self, constraint: AbstractConstraint) -> None:
        R, p, w, v, t = ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3), ca.SX.sym("w", 3), ca.SX.sym("v", 3), time.sx
        X = Pose(R, p)
        call = "closure(X_ab, t)"
        is_joint = isinstance(constraint, AbstractJoint)
        if self._called(call, lambda: constraint.closure(X, t)) is not None or not is_joint:
            rows = self._column(call, lambda: constraint.closure(X, t), (R, p))
            for k in range(rows.numel()):
                if not ca.depends_on(rows[k], ca.vertcat(ca.vec(R), p)):
                    raise self._error(call, f"has a row {k} that does not depend on X_ab, so that it forbids nothing.")
        call = "closure_rates(X_ab, w_ab_b, v_ab_b, t)"
        rates = self._column(call, lambda: constraint.closure_rates(X, w, v, t), (R, p, w, v))
        twist = ca.vertcat(w, v)
        if ca.depends_on(ca.jacobian(rates, twist), twist):
            raise self._error(
                call, "is not linear in w_ab_b and v_ab_b. Rows are sums of their entries, with factors of the pose."
            )
        if self._called("closure_sign(X_ab)", lambda: constraint.closure_sign(X)) is not None:
            self._column("closure_sign(X_ab)", lambda: constraint.closure_sign(X), (R, p), 1)
        mounting = self._called("mounting()", constraint.mounting)
        if not isinstance(mounting, np.ndarray | ca.SX) or mounting.shape != (3, 3):
            raise self._error("mounting()", f"gives {shown(mounting)}. Return a rotation (3, 3) of numbers or SX.")
        self._check_orthogonal("mounting()", symbolic(mounting), ca.SX(0, 1), np.zeros(0))
        if not isinstance(constraint, AbstractJoint):
            self._check_signs(constraint)
        if (
            isinstance(constraint, AbstractJoint)
            and self._called("coordinates(X_ab)", lambda: constraint.coordinates(X)) is not None
        ):
            self._column("coordinates(X_ab)", lambda: constraint.coordinates(X), (R, p), constraint.q.size)
        if isinstance(constraint, AbstractJoint):
            fault = next(LookedJoint.at_random(constraint).faults(), None)
            if fault is not None:
                raise self._error(*fault)

    def _check_signs(self, constraint: AbstractConstraint) -> None:
        """Rows pass through zero where they hold."""
        rows = one_sided_rows(constraint)
        if rows:
            raise self._error(
                "closure(X_ab, t)",
                f"has a row {rows[0]} that does not pass through zero: it has no slope, or one sign to both sides of where it vanishes, as a square, a "
                "distance that is to be zero, or an absolute value. So it forbids nothing to first order. Give a row for each direction, with its sign.",
            )

    def _check_force(self, force: AbstractForce) -> None:
        placement = FreePlacement()
        if isinstance(force, AbstractLineForce):
            length, rate = ca.SX.sym("length"), ca.SX.sym("rate")
            for call, law in (
                ("tension(length, rate)", lambda: force.tension(length, rate)), ("potential(length)", lambda: force.potential(length)),
            ):  # fmt: skip
                self._scalar(call, law)
        else:
            if isinstance(force, AbstractPotential):
                self._check_potential(force)
            self._check_actions(force, placement)
            self._scalar("potential_energy(placement)", lambda: force.potential_energy(placement))
            self._scalar("power_loss(placement)", lambda: force.power_loss(placement))
        if not self._called("actions(placement)", lambda: symbols_read(force)):
            self._check_balance(force)

    def _check_potential(self, force: AbstractPotential) -> None:
        X, w, v = Pose(ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3)), ca.SX.sym("w", 3), ca.SX.sym("v", 3)
        self._scalar("potential(X_ab, t)", lambda: force.potential(X, time.sx))
        call = "damping(X_ab, w_ab_b, v_ab_b, t)"
        found = self._called(call, lambda: force.damping(X, w, v, time.sx))
        if not (isinstance(found, tuple) and len(found) == 2 and all(isinstance(e, ca.SX) and e.shape == (3, 1) for e in found)):
            raise self._error(
                call,
                f"gives {shown(found)}. Return the torque and the force on frame_b, two columns of three: ca.SX(3, 1) for none.",
            )

    def _check_actions(self, force: AbstractForce, placement: FreePlacement) -> None:
        call = "actions(placement)"
        actions = self._called(call, lambda: force.actions(placement))
        if not (isinstance(actions, list | tuple) and all(isinstance(a, Action) for a in actions)):
            one = " (one Action stands in a tuple with a comma behind it)" if isinstance(actions, Action) else ""
            raise self._error(
                call, f"gives {shown(actions)}. Return a tuple of them{one}: return (Action(self.point, force, torque),)."
            )
        for action in actions:
            check_formula(ca.vertcat(action.force, action.torque), f"{self.part.where}: {call}")
            for scalar in ca.symvar(ca.vertcat(action.force, action.torque)):
                if declared(scalar) is None and not ca.depends_on(ca.vertcat(placement.y, placement.y_dot), scalar):
                    raise self._error(call, f"contains the symbol '{scalar.name()}', which is declared nowhere.")
            if action.connector not in force.connectors():
                raise self._error(
                    call, f"acts on {action.connector!r}, which is no connector of its own. Give it one, and connect it there."
                )

    def _scalar(self, call: str, method: Callable[[], Any], known: Sequence[ca.SX] | None = None) -> None:
        """`known`: of what it may be made, beside time and parameters; None: also of what it declares, read from others."""
        found = self._called(call, method)
        value = found if isinstance(found, ca.SX | Expression | int | float) else None
        if value is None or (not isinstance(value, int | float) and tuple(value.shape) != (1, 1)):
            raise self._error(call, f"gives {shown(found)}. Return one number or SX; ca.SX(0) for none.")
        check_formula(sx(value), f"{self.part.where}: {call}")
        if known is not None and not isinstance(value, int | float):
            self._check_symbols(call, sx(value), known)

    def _check_energies(self, component: Component) -> None:
        for name in ("stored_energy", "dissipated_power", "supplied_power"):
            self._scalar(f"{name}()", getattr(component, name))

    def _check_balance(self, force: AbstractForce) -> None:
        """What the forces do to the bodies comes from the potential energy, or is the power that is said to be lost or supplied."""
        balance, sizes = self._called("actions(placement)", lambda: unbalanced_power(force))
        for (done, change, lost), size in zip(balance, sizes, strict=True):
            gap = done + change + lost
            if np.isfinite(gap) and abs(gap) > EDGE * size:
                told = (
                    "tension and potential"
                    if isinstance(force, AbstractLineForce)
                    else "actions, potential_energy and power_loss"
                )
                raise ModelError(
                    f"{self.part.where}: {told} of {type(force).__name__} contradict each other. In a trial motion its forces do {done:.4g} W, its stored "
                    f"energy changes by {change:.4g} W and it loses {lost:.4g} W; the three must add to zero. A force is minus the slope of its potential "
                    "(a tension the slope), and power_loss is what else it takes from the bodies."
                )

    def _check_rigid(self, body: AbstractRigidPart) -> None:
        attached = self._called("attachments()", body.attachments)
        if not (isinstance(attached, list | tuple) and all(isinstance(a, Attachment) for a in attached)):
            raise self._error(
                "attachments()", f"gives {shown(attached)}. Return a tuple: return (Attachment(self.frame, Pose.identity()),)."
            )
        for attachment in attached:
            self._pose("attachments()", lambda pose=attachment.pose: pose, ())
        missing = [c.name for c in body.connectors() if c not in {a.connector for a in attached}]
        if missing:
            raise self._error(
                "attachments()", f"does not say where {', '.join(missing)} is. Give an Attachment for each connector."
            )
        inertia = self._called("inertia()", body.inertia)
        if not isinstance(inertia, Inertia):
            raise self._error(
                "inertia()",
                f"gives {shown(inertia)}. Return Inertia(mass, first moment, second moment); Inertia.zero() for none.",
            )
        for name, value, shape in (
            ("first moment", inertia.moment, ((3,), (3, 1))),
            ("second moment", inertia.second_moment, ((3, 3),)),
        ):
            if not _is_matrix(value) or value.shape not in shape:
                raise self._error("inertia()", f"gives {shown(value)} as {name}. It must be an array or SX of shape {shape[0]}.")
        numbers = [x for x in (inertia.mass, inertia.moment, inertia.second_moment) if not isinstance(x, ca.SX)]
        if not all(np.isfinite(x).all() for x in numbers) or (not isinstance(inertia.mass, ca.SX) and inertia.mass < 0):
            raise ParameterError(
                f"{self.part.where}: inertia() gives a mass of {inertia.mass} kg, moments {shown(inertia.moment)} and {shown(inertia.second_moment)}. They must be "
                "finite, and the mass not negative."
            )
        if len(numbers) == 3 and not inertia.is_physical:
            raise ParameterError(
                f"{self.part.where}: inertia() gives a mass of {inertia.mass} kg, moments {shown(inertia.moment)} and {shown(inertia.second_moment)} about "
                "the origin of its frame: no distribution of mass has them. About the centre c the second moment is smaller by m (c' c - c c'), symmetric, and "
                "none of its principal values larger than the sum of the others."
            )
        sketch = self._called("sketch_pose()", body.sketch_pose)
        if sketch is not None and not (isinstance(sketch, Pose) and sketch.is_constant):
            raise self._error("sketch_pose()", f"gives {shown(sketch)}. Return Pose(rotation, position) of numbers, or None.")


def _is_matrix(value: Any) -> bool:
    return isinstance(value, np.ndarray | ca.SX)


def _listed(found: Any) -> list[Any]:
    """What there is to go through; what else `equations` may give is told where they are collected."""
    return list(cast("Iterable[Any]", found)) if isinstance(found, Iterable) and not isinstance(found, Expression) else []
