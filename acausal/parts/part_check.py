"""Parts are looked at before anything is made of them: constant shapes and masses, and joints that users write."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import ModelError, ParameterError
from acausal.language.expression import Parameter, Symbol, Variable
from acausal.language.flatten import FlatSystem, Part, leaves_inside
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, symbolic
from acausal.parts.rigid import AbstractRigidPart

_OWN = ("acausal", "components")
_TOLERANCE = 1e-9


def check_parts(flat: FlatSystem) -> None:
    """Raises `ParameterError` for bodies and joints whose dimensions change, `ModelError` for a joint without q or v, whose pose is none, or
    whose rotation is none at some configuration.
    """
    for part in flat.parts:
        _check_constant(part)
        if isinstance(part.component, AbstractJoint) and type(part.component).__module__.split(".")[0] not in _OWN:
            _check(part, part.component)


def _check_constant(part: Part) -> None:
    """Rates of lengths, axes and masses are taken to be zero. Gravity may change; what moves as it is told says so by `given_motions`."""
    component = part.component
    own = type(component).__module__.split(".")[0] in _OWN
    if not isinstance(component, AbstractRigidPart) and not (isinstance(component, AbstractConstraint) and own):
        return
    if component.given_motions():
        return
    for name, value in component.__dict__.items():
        if name == "gravity" or (isinstance(value, Symbol) and value in component.variables()):
            continue
        for leaf in leaves_inside(value):
            if not isinstance(leaf, Parameter):
                raise ParameterError(
                    f"{part.where}: {name} depends on the {leaf.kind} {leaf.name}, but masses and dimensions of bodies and joints are constant. Use "
                    "numbers or ac.Parameter; what moves needs a joint, e.g. PrescribedMotion or Prismatic."
                )


def _check(part: Part, joint: AbstractJoint) -> None:
    kind = type(joint).__name__
    for name, meaning in (("q", "configuration"), ("v", "velocity")):
        if not isinstance(getattr(type(joint), name, None), Variable):
            raise ModelError(f'{part.where}: a joint declares its {meaning} in the class body: {name} = ac.Variable("rad").')
    q, v, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("v", joint.v.size), ca.SX.sym("t")
    found: Any = joint.pose(q, t)
    if not isinstance(found, Pose):
        raise ModelError(f"{part.where}: {kind}.pose(q, t) gives {found!r}. Return Pose(rotation, position).")
    rates: Any = ca.SX(joint.rates(q, v, t))
    if rates.shape != q.shape:
        raise ModelError(
            f"{part.where}: {kind} has {q.numel()} configuration variables (q) and {rates.numel()} rates of them. Without rates(q, v, t), q and v "
            f"have the same size; v has {v.numel()}."
        )
    R, p = symbolic(found.rotation), symbolic(found.position)
    if R.shape != (3, 3) or p.shape != (3, 1):
        raise ModelError(
            f"{part.where}: {kind}.pose(q, t) gives a rotation {R.shape} and a position {p.shape}, not (3, 3) and (3, 1)."
        )
    _check_rotation(part, joint, R, q, t)
    if q.numel() and not ca.depends_on(ca.vertcat(ca.vec(R), p), q):
        raise ModelError(f"{part.where}: {kind}.pose(q, t) does not depend on q, so the joint cannot move. Use q in it.")


def _check_rotation(part: Part, joint: AbstractJoint, R: ca.SX, q: ca.SX, t: ca.SX) -> None:
    """At a configuration of no special kind that meets the joint's own invariants; joints with invariants are not tried."""
    if joint.invariants(q, t).numel():
        return
    numbers = np.random.default_rng(0)
    others = [s for s in ca.symvar(R) if not any(ca.is_equal(s, known) for known in [*ca.vertsplit(q), t])]
    gap = ca.Function("gap", [q, t, ca.vertcat(ca.SX(0, 1), *others)], [ca.densify(R.T @ R - ca.SX.eye(3)), ca.det(R)])
    off, det = (
        np.array(ca.DM(m)) for m in gap(numbers.uniform(0.1, 0.9, q.numel()), 0.3, numbers.uniform(0.1, 0.9, len(others)))
    )
    if np.isfinite(off).all() and (np.max(np.abs(off)) > _TOLERANCE or det.item() < 0):
        raise ModelError(
            f"{part.where}: {type(joint).__name__}.pose(q, t) gives a matrix that is no rotation (its columns are not unit vectors at right angles, "
            "right-handed). Build it from rotation_about_z(...) and products of rotations."
        )
