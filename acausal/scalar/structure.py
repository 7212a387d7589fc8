"""Incidence and linearity of expressions, by one walk over CasADi's instructions.

Each intermediate result is represented by an abstract value: numeric coefficients of the symbols that enter linearly, and
the set of those that enter in any other way. One walk serves all equations, so the cost is proportional to the number of
operations (times the length of sums). It is an abstract interpretation in the sense of Cousot & Cousot (1977).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from acausal.language.expression import stacked


@dataclass
class Form:
    """sum of linear[i] x_i + constant + g, where g depends on the symbols in `other`, and on constants if `opaque`."""

    linear: dict[int, float] = field(default_factory=dict)
    constant: float = 0.0
    other: set[int] = field(default_factory=set)
    opaque: bool = False

    @property
    def affine(self) -> bool:
        """Whether this is a sum of symbols with numeric coefficients and a number."""
        return not self.other and not self.opaque

    @property
    def number(self) -> bool:
        """Whether this is a number."""
        return self.affine and not self.linear

    @property
    def symbols(self) -> set[int]:
        """All symbols in the expression but for constants."""
        return self.other.union(self.linear)

    def scaled(self, factor: float) -> Form:
        """This times a number; `g` stays what it is, as only its symbols are known."""
        return Form({i: factor * a for i, a in self.linear.items()}, factor * self.constant, set(self.other), self.opaque)


def forms(expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], constants: Sequence[ca.SX] = ()) -> list[Form]:
    """The form of each scalar expression; indices count in `symbols`, and `constants` only make a form opaque."""
    if not expressions:
        return []
    function = ca.Function("structure", [stacked(symbols), stacked(constants)], [ca.vertcat(*expressions)])
    results = [Form() for _ in expressions]
    registers: list[Form] = [Form() for _ in range(function.sz_w())]
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        if operation == ca.OP_CONST:
            registers[function.instruction_output(k)[0]] = Form(constant=float(function.instruction_constant(k)))
        elif operation == ca.OP_INPUT:
            argument, index = function.instruction_input(k)
            leaf = Form({index: 1.0}) if argument == 0 else Form(opaque=True)
            registers[function.instruction_output(k)[0]] = leaf
        elif operation == ca.OP_OUTPUT:
            results[_row(function, k)] = registers[function.instruction_input(k)[0]]
        else:
            value = _value(operation, [registers[i] for i in function.instruction_input(k)])
            for i in function.instruction_output(k):
                registers[i] = value
    return [_disjoint(form) for form in results]


def _row(function: ca.Function, k: int) -> int:
    """Row of a result: CasADi numbers the structural nonzeros of an output."""
    return function.sparsity_out(0).row(function.instruction_output(k)[1])


def _value(operation: int, arguments: list[Form]) -> Form:
    a = arguments[0]
    b = arguments[-1]
    if operation == ca.OP_ADD:
        return _sum(a, b, 1.0)
    if operation == ca.OP_SUB:
        return _sum(a, b, -1.0)
    if operation == ca.OP_NEG:
        return a.scaled(-1.0)
    if operation == ca.OP_TWICE:
        return a.scaled(2.0)
    if operation == ca.OP_ASSIGN:
        return a
    if operation == ca.OP_MUL and (a.number or b.number):
        return b.scaled(a.constant) if a.number else a.scaled(b.constant)
    if operation == ca.OP_DIV and b.number and b.constant != 0:
        return a.scaled(1.0 / b.constant)
    everything: set[int] = set()
    for argument in arguments:
        everything |= argument.symbols
    # a number that only folds at run time, such as sqrt(2) kept as an operation, counts as a constant of unknown value
    return Form(other=everything, opaque=any(argument.opaque for argument in arguments) or not everything)


def _sum(a: Form, b: Form, sign: float) -> Form:
    linear = dict(a.linear)
    for i, coefficient in b.linear.items():
        total = linear.get(i, 0.0) + sign * coefficient
        if abs(total) <= 1e-14 * abs(coefficient):
            linear.pop(i, None)
        else:
            linear[i] = total
    return Form(linear, a.constant + sign * b.constant, a.other | b.other, a.opaque or b.opaque)


def _disjoint(form: Form) -> Form:
    """With symbols that enter in two ways only in `other`."""
    return Form({i: a for i, a in form.linear.items() if i not in form.other}, form.constant, form.other, form.opaque)
