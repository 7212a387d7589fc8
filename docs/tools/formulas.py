"""The laws of a part as formulas, read off its own code."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from typing import Any

import casadi as ca
import sympy

from acausal.export.sympy_bridge import to_sympy
from acausal.language.component import Component, declared
from acausal.language.connector import Signal
from acausal.language.expression import Derivative, Expression, Input, Parameter, Symbol, Time, Variable
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.force import AbstractLineForce
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, symbolic

_Known = list[tuple[ca.SX, Sequence[Any]]]
_LONGEST = 420


def formulas_of(part: Component) -> list[tuple[str, str]]:
    """What each says in words, and the formula in LaTeX; long ones are left to the text."""
    kinds = (
        (AbstractJoint, _joint),
        (AbstractConstraint, _constraint),
        (AbstractLineForce, _line_force),
        (Component, _equations),
    )
    found = next(of for kind, of in kinds if isinstance(part, kind))(part)
    return [(words, line) for words, line in found if len(line) < _LONGEST and "cases" not in line]


def with_symbols(cls: type, text: str, part: Component) -> tuple[Component, dict[Symbol, str]]:
    """The part once more, with symbols for those of its numbers that the docstring gives a unit, and their names; else as it is."""
    given: dict[str, Any] = {}
    for name in inspect.signature(cls).parameters:
        value = part.__dict__.get(name)
        unit = re.search(rf"`{name}` (?:\(\w+,?\) )?\[([^\]]+)\]", text)
        if isinstance(value, int | float) and not isinstance(value, bool):
            given[name] = Parameter(float(value), unit[1]) if unit else Parameter(float(value))
        elif value is not None:
            given[name] = value
    try:
        made = cls(**given)
    except Exception:  # a part that takes numbers only, or keeps them under other names, is shown with its numbers
        return part, {}
    return made, {value: name for name, value in given.items() if isinstance(value, Parameter)}


def energies_of(part: Component) -> list[tuple[str, str]]:
    """Of a part that says its energies as equations: what it stores, turns into heat, and brings in."""
    names, known = _names(part), []
    for words, letter, value in (
        ("Energy stored", "E", part.stored_energy()), ("Power turned into heat", "P", part.dissipated_power()), ("Power brought in", "P", part.supplied_power()),
    ):  # fmt: skip
        if isinstance(value, Expression) and not value.sx.is_zero():
            known.append((words, f"{letter} = {_of_leaves(value, names)}"))
    return [(words, line) for words, line in known if not line.endswith("= ")]


def _joint(joint: AbstractJoint) -> list[tuple[str, str]]:
    q, v, t = ca.SX.sym("q", joint.q.size), ca.SX.sym("v", joint.v.size), ca.SX.sym("t")
    X = joint.pose(q, t)
    R, p = symbolic(X.rotation), symbolic(X.position)
    known = [(q, _numbered("q", joint.q.size)), (v, _numbered("v", joint.v.size)), (t, [sympy.Symbol("t")]), *_parameters(joint)]
    found: list[tuple[str, str]] = []
    for words, name, value in (
        ("Orientation of frame_b in frame_a", "R_{ab}", R),
        ("Position of frame_b in frame_a", "p_{ab}", p),
    ):
        found.append((words, f"{name} = {_latex(value, known)}"))
    rates = joint.rates(q, v, t)
    if joint.v.size and not (joint.q.size == joint.v.size and ca.is_equal(rates, v, 1)):
        found.append(("Rates of q", rf"\dot q = {_latex(rates, known)}"))
    return found


def _constraint(part: AbstractConstraint) -> list[tuple[str, str]]:
    R, p, w, v, t = ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3), ca.SX.sym("w", 3), ca.SX.sym("v", 3), ca.SX.sym("t")
    entries = [sympy.Symbol(f"R_{{{i}{j}}}") for j in "123" for i in "123"]
    known: _Known = [(ca.vec(R), entries), (t, [sympy.Symbol("t")]), *_parameters(part)]
    known += [(x, _numbered(n, 3)) for x, n in ((p, "p"), (w, "\\omega"), (v, "v"))]
    X = Pose(R, p)
    found = [
        ("Vanishes for the pose of frame_b in frame_a", part.closure(X, t)),
        ("Vanishes for the velocities of frame_b against frame_a, in frame_b", part.closure_rates(X, w, v, t)),
    ]
    return [(words, f"0 = {_latex(value, known)}") for words, value in found if value is not None and value.numel()]


def _line_force(force: AbstractLineForce) -> list[tuple[str, str]]:
    length, rate = ca.SX.sym("length"), ca.SX.sym("rate")
    known = [(length, [sympy.Symbol("l")]), (rate, [sympy.Symbol(r"\dot l")]), *_parameters(force)]
    laws = (
        ("Tension by the length and its rate", "F", force.tension(length, rate)),
        ("Energy stored", "V", force.potential(length)),
    )
    return [(words, f"{name} = {_latex(ca.SX(law), known)}") for words, name, law in laws]


def _parameters(part: Component) -> _Known:
    return [(value.sx, [sympy.Symbol(_text(name))]) for name, value in vars(part).items() if isinstance(value, Parameter)]


def _equations(part: Component) -> list[tuple[str, str]]:
    names = _names(part)
    lines = [_of_leaves(equation.residual, names) for equation in part.equations()]
    return [("", f"0 = {line}") for line in lines if line]


def _names(part: Component) -> dict[Symbol, str]:
    """What stands for the symbols of a part of scalar equations."""
    names: dict[Symbol, str] = {value: _text(name) for name, value in vars(part).items() if isinstance(value, Parameter)}
    names |= {variable: _greek(variable.name) for variable in part.variables()}
    for end in part.connectors():
        for name in declared(type(end), Variable):
            suffix = "" if end.name in ("flange", "pin") else end.name.removeprefix("flange_").removeprefix("pin_")
            letter = _greek(name) if not isinstance(end, Signal) else _text(end.name)
            names[getattr(end, name)] = f"{letter}_{{{_text(suffix)}}}" if suffix and not isinstance(end, Signal) else letter
    return names


def _of_leaves(value: Expression, names: dict[Symbol, str]) -> str:
    """Empty where it is long, or no scalar."""
    leaves = list(value.leaves)
    if value.sx.numel() > 1 or any(leaf.sx.numel() > 1 for leaf in leaves):
        return ""
    return _latex(value.sx, [(leaf.sx, [sympy.Symbol(_name(leaf, names))]) for leaf in leaves])


def _name(leaf: Symbol, names: dict[Symbol, str]) -> str:
    if isinstance(leaf, Derivative):
        inner = _name(leaf.of, names)
        return rf"\ddot{inner.removeprefix(chr(92) + 'dot')}" if inner.startswith(r"\dot") else rf"\dot{{{inner}}}"
    if isinstance(leaf, Time):
        return "t"
    return names.get(leaf, "u" if isinstance(leaf, Input) else _text(leaf.name))


def _latex(value: ca.SX, known: _Known) -> str:
    if value.shape == (3, 3) and ca.sparsify(value).is_eye():
        return "1"
    if value.is_zero():
        return "0"
    entries = to_sympy(ca.densify(value), known)
    if len(entries) == 1:
        return sympy.latex(entries[0], mul_symbol=r" \, ")
    rows, columns = value.shape
    return sympy.latex(sympy.Matrix(rows, columns, lambda i, j: entries[j * rows + i]), mat_delim="", mul_symbol=r" \, ")


def _numbered(name: str, size: int) -> list[Any]:
    return [sympy.Symbol(name if size == 1 else f"{name}_{{{k + 1}}}") for k in range(size)]


def _text(name: str) -> str:
    return r"\mathrm{" + name.replace("_", r"\ ") + "}"


def _greek(name: str) -> str:
    return "\\" + name if name in ("phi", "tau") else name
