"""C source of `SX` functions, one statement an operation, for values in lanes (see `acausal/runtime/lanes.h`).

The same text is compiled for one lane or for many, and rounds alike. Products and sums are not contracted: where a factor of 1 is folded
away and one of 4 is not, contractions would round a scene in other units differently, though powers of two are exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca

from acausal.errors import ExportError

EMITTER = Path(__file__)
"""This file: whoever keeps its results depends on its content."""

_UNARY = {
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "v_all(1.0) / {0}",
    ca.OP_SQRT: "v_sqrt({0})",
    ca.OP_FABS: "v_abs({0})",
    ca.OP_NOT: "v_truth({0} == v_all(0.0))",
    ca.OP_SIGN: "v_copysign(v_sign({0}), {0})",  # CasADi's sign of -0 is -0
} | {
    getattr(ca, f"OP_{name.upper()}"): f"v_{name}({{0}})"
    for name in (
        "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh",
        "floor", "ceil", "erf", "erfinv", "log1p", "expm1",
    )
}  # fmt: skip
_BINARY = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_LT: "v_truth({0} < {1})",
    ca.OP_LE: "v_truth({0} <= {1})",
    ca.OP_EQ: "v_truth({0} == {1})",
    ca.OP_NE: "v_truth({0} != {1})",
    ca.OP_AND: "v_truth(({0} != v_all(0.0)) & ({1} != v_all(0.0)))",
    ca.OP_OR: "v_truth(({0} != v_all(0.0)) | ({1} != v_all(0.0)))",
    ca.OP_IF_ELSE_ZERO: "v_select({0} != v_all(0.0), {1}, v_all(0.0))",
    ca.OP_POW: "v_pow({0}, {1})",
    ca.OP_CONSTPOW: "v_pow({0}, {1})",
} | {
    getattr(ca, f"OP_{name.upper()}"): f"v_{name}({{0}}, {{1}})"
    for name in ("fmin", "fmax", "fmod", "remainder", "copysign", "atan2", "hypot")
}
_COPY = {ca.OP_ASSIGN, ca.OP_LIFT}
_ARGUMENTS = "(const V *restrict in, const V *restrict c, V *restrict out, V *restrict w)"
_CHUNK = 400
"""Statements in one C function: compilers take more than linear time in this."""


@dataclass(frozen=True)
class Source:
    """C of one function `void name(const V *in, const V *c, V *out, V *w)`, and `long name_sizes[4]` with the four sizes.

    in: stored entries of all arguments, one after the other; out: of all results. `c` (`constants` values) holds what depends on
    parameters only, filled by `name_prepare(in, c, c, w)`. `w`: scratch for `work` values. Nothing else may overlap.
    """

    name: str
    pieces: tuple[str, ...]
    """Functions that may be compiled apart from each other; the last one calls them."""
    inputs: int
    outputs: int
    constants: int
    work: int


@dataclass(frozen=True)
class _Value:
    """A value in static single assignment: how it is made from others (`code`, `args`), or a constant `number`, or an input `place`."""

    code: int
    args: tuple[int, ...] = ()
    number: float = 0.0
    place: int = 0


def emit(function: ca.Function, name: str, *, parameters: tuple[int, ...] = (), chunk: int = _CHUNK) -> Source:
    """C of an `SX` function. `parameters`: numbers of the arguments that seldom change; what depends on them only is computed once.

    Raises `ExportError` for an operation that has no C, and for functions that cannot be expanded to `SX`.
    """
    values, results = _read(function, name)
    offsets = [sum(function.nnz_in(k) for k in range(i)) for i in range(function.n_in() + 1)]
    seldom = {place for i in parameters for place in range(offsets[i], offsets[i + 1])}
    needed = _needed(values, results)
    fixed = _fixed(values, seldom)
    wanted = {a for i, v in enumerate(values) if needed[i] and not fixed[i] for a in v.args} | {v for _, v in results}
    kept = sorted(i for i in wanted if fixed[i] and values[i].code not in (ca.OP_INPUT, ca.OP_CONST))
    slots = {v: k for k, v in enumerate(kept)}
    rare, often = ([i for i in range(len(values)) if needed[i] and fixed[i] is kind] for kind in (True, False))
    first, work_a = _body(f"{name}_prepare", values, rare, {}, [(slots[v], v) for v in kept], chunk)
    second, work_b = _body(name, values, often, slots, results, chunk)
    outputs = sum(function.nnz_out(i) for i in range(function.n_out()))
    sizes = (offsets[-1], outputs, len(kept), max(work_a, work_b))
    last = f"{first[-1]}{second[-1]}EXPORT const long {name}_sizes[4] = {{{', '.join(map(str, sizes))}}};\n"
    return Source(name, (*first[:-1], *second[:-1], last), *sizes)


def translation_units(sources: Sequence[Source], parts: int) -> list[str]:
    """C files with all functions, of about the same length, at most `parts`; few where there is little."""
    head = '#include "lanes.h"\n#include "vector_math.h"\n'
    pieces = sorted((piece for source in sources for piece in source.pieces[:-1]), key=len, reverse=True)
    total = sum(map(len, pieces))
    units = [[head] for _ in range(max(1, min(parts, total // 80_000)))]
    for source in sources:
        units[0].append(source.pieces[-1])
    for piece in pieces:
        min(units, key=lambda unit: sum(map(len, unit))).append(piece)
    return ["".join(unit) for unit in units]


def _read(function: ca.Function, name: str) -> tuple[list[_Value], list[tuple[int, int]]]:
    """All values in order, each once, and (output position, value)."""
    if not function.is_a("SXFunction"):
        try:
            function = function.expand()
        except RuntimeError as error:
            raise ExportError(
                f"'{name}' cannot be written as C: it does not expand to SX ({str(error).splitlines()[-1]})."
            ) from error
    places_in = [sum(function.nnz_in(k) for k in range(i)) for i in range(function.n_in())]
    places_out = [sum(function.nnz_out(k) for k in range(i)) for i in range(function.n_out())]
    values: list[_Value] = []
    results: list[tuple[int, int]] = []
    now: dict[int, int] = {}  # work vector position -> value
    known: dict[tuple[int, tuple[int, ...], float, int], int] = {}
    code_of, input_of, output_of = function.instruction_id, function.instruction_input, function.instruction_output
    for k in range(function.n_instructions()):
        code = code_of(k)
        if code == ca.OP_OUTPUT:
            which, entry = output_of(k)
            results.append((places_out[which] + entry, now[input_of(k)[0]]))
            continue
        to = output_of(k)[0]
        if code == ca.OP_INPUT:
            which, entry = input_of(k)
            value = _Value(code, place=places_in[which] + entry)
        elif code == ca.OP_CONST:
            value = _Value(code, number=function.instruction_constant(k))
        elif code in _COPY:
            now[to] = now[input_of(k)[0]]
            continue
        elif code in _UNARY or code in _BINARY:
            value = _Value(code, tuple(now[i] for i in input_of(k)))
        else:
            raise ExportError(f"'{name}' cannot be written as C: {_name(code)} has no C here.")
        now[to] = known.setdefault((value.code, value.args, value.number, value.place), len(values))
        if now[to] == len(values):
            values.append(value)
    return values, results


def _name(code: int) -> str:
    found = [n for n in dir(ca) if n.startswith("OP_") and getattr(ca, n) == code]
    return f"the operation {found[0][3:].lower()}" if found else f"operation number {code}"


def _needed(values: list[_Value], results: list[tuple[int, int]]) -> list[bool]:
    needed = [False] * len(values)
    for _, v in results:
        needed[v] = True
    for i in range(len(values) - 1, -1, -1):
        if needed[i]:
            for a in values[i].args:
                needed[a] = True
    return needed


def _fixed(values: list[_Value], seldom: set[int]) -> list[bool]:
    """Which values depend on seldom changing inputs and constants only."""
    fixed: list[bool] = []
    for value in values:
        fixed.append(value.place in seldom if value.code == ca.OP_INPUT else all(fixed[a] for a in value.args))
    return fixed


def _literal(number: float) -> str:
    if math.isfinite(number):
        return f"v_all({number.hex()})"
    return 'v_all(__builtin_nan(""))' if math.isnan(number) else f"v_all({'-' if number < 0 else ''}__builtin_inf())"


def _body(
    name: str, values: list[_Value], order: list[int], slots: dict[int, int], results: list[tuple[int, int]], chunk: int
) -> tuple[list[str], int]:
    """C of one function, in pieces of which the last one calls the others, and the size of its work array. `slots`: values found in c."""
    inside = [i for i in order if values[i].code not in (ca.OP_INPUT, ca.OP_CONST)]
    chunks = [inside[k : k + chunk] for k in range(0, len(inside), chunk)] or [[]]
    home = {i: k for k, part in enumerate(chunks) for i in part}
    last: dict[int, int] = {}
    for i in inside:
        for a in values[i].args:
            if a in home:
                last[a] = home[i]
    writes: list[list[tuple[int, int]]] = [[] for _ in chunks]
    for place, v in results:
        writes[home.get(v, 0)].append((place, v))
    work, size = _work_slots(chunks, home, last)
    pieces: list[str] = []
    for k, part in enumerate(chunks):
        title = f"HIDDEN void {name}_{k}{_ARGUMENTS}" if len(chunks) > 1 else f"EXPORT void {name}{_ARGUMENTS}"
        body = _statements(values, part, home, k, slots, work, last, writes[k])
        pieces.append("".join([f"{title} {{\n(void)in; (void)c; (void)out; (void)w;\n", *body, "}\n"]))
    if len(chunks) > 1:
        declared = "".join(f"HIDDEN void {name}_{k}{_ARGUMENTS};\n" for k in range(len(chunks)))
        calls = "".join(f"{name}_{k}(in, c, out, w);\n" for k in range(len(chunks)))
        pieces.append(f"{declared}EXPORT void {name}{_ARGUMENTS} {{\n{calls}}}\n")
    return pieces, size


def _work_slots(chunks: list[list[int]], home: dict[int, int], last: dict[int, int]) -> tuple[dict[int, int], int]:
    """Places in w for values that live beyond their chunk; a place is used again once its value is dead."""
    work: dict[int, int] = {}
    free: list[int] = []
    size = 0
    expiring: list[list[int]] = [[] for _ in chunks]
    for k, part in enumerate(chunks):
        for i in part:
            if last.get(i, -1) > k:
                if free:
                    work[i] = free.pop()
                else:
                    work[i] = size
                    size += 1
                expiring[last[i]].append(work[i])
        free += expiring[k]
    return work, size


def _statements(
    values: list[_Value],
    part: list[int],
    home: dict[int, int],
    here: int,
    slots: dict[int, int],
    work: dict[int, int],
    last: dict[int, int],
    writes: list[tuple[int, int]],
) -> list[str]:
    lines: list[str] = []
    loaded: dict[int, str] = {}

    def name_of(i: int) -> str:
        found = loaded.get(i)
        if found is None:
            value = values[i]
            if value.code == ca.OP_CONST:
                return _literal(value.number)
            found = f"x{i}"
            if value.code == ca.OP_INPUT:
                lines.append(f"const V {found} = in[{value.place}];\n")
            elif i in slots:
                lines.append(f"const V {found} = c[{slots[i]}];\n")
            else:
                lines.append(f"const V {found} = w[{work[i]}];\n")
            loaded[i] = found
        return found

    turns = _sines_and_cosines(values, part)
    for i in part:
        if i not in loaded:
            value = values[i]
            arguments = [name_of(a) for a in value.args]
            pair = turns.get(value.args[0]) if value.code in (ca.OP_SIN, ca.OP_COS) else None
            if pair is not None:
                sine, cosine = pair
                lines.append(f"V x{sine}, x{cosine}; v_sincos({arguments[0]}, &x{sine}, &x{cosine});\n")
                loaded[sine], loaded[cosine] = f"x{sine}", f"x{cosine}"
            else:
                lines.append(f"const V x{i} = {_formula(values, value, arguments)};\n")
                loaded[i] = f"x{i}"
        if last.get(i, -1) > here:
            lines.append(f"w[{work[i]}] = x{i};\n")
    lines += [f"out[{place}] = {name_of(v)};\n" for place, v in writes]
    return lines


def _sines_and_cosines(values: list[_Value], part: list[int]) -> dict[int, tuple[int, int]]:
    """Arguments of which both sine and cosine are made in this part."""
    sines = {values[i].args[0]: i for i in part if values[i].code == ca.OP_SIN}
    return {
        values[i].args[0]: (sines[values[i].args[0]], i)
        for i in part
        if values[i].code == ca.OP_COS and values[i].args[0] in sines
    }


def _formula(values: list[_Value], value: _Value, arguments: list[str]) -> str:
    if value.code == ca.OP_CONSTPOW:
        short = _power(arguments[0], values[value.args[1]].number)
        if short is not None:
            return short
    return (_UNARY.get(value.code) or _BINARY[value.code]).format(*arguments)


def _power(base: str, exponent: float) -> str | None:
    """x^n for small integers and halves as products and roots; None for any other exponent. NaN for halves of x = -inf."""
    if not 0 < abs(exponent) <= 8 or (2 * exponent) % 1:
        return None
    whole = int(abs(exponent))
    if abs(exponent) % 1:
        base = f"({base} + v_all(0.0))"  # powers of -0 are those of 0
    factors = [f"v_sqrt({base})"] if abs(exponent) % 1 else []
    product = " * ".join(factors + [base] * whole)
    return product if exponent > 0 else f"v_all(1.0) / ({product})"
