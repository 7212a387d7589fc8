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

from acausal.emit.statements import ANSWER, LEAVES, SYSTEM, Statements, statements
from acausal.numerics import instructions, staged

EMITTER = (
    *(Path(__file__).with_name(f"{name}.py") for name in ("emit", "statements", "program", "program_source")),
    *map(Path, (instructions.__file__, staged.__file__)),
)
"""The files that make C: whoever keeps it depends on their content."""

UNARY = {
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
BINARY = {
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
} | {
    getattr(ca, f"OP_{name.upper()}"): f"v_{name}({{0}}, {{1}})"
    for name in ("fmin", "fmax", "fmod", "remainder", "copysign", "atan2", "hypot")
}
ARGUMENTS = "(const V *restrict in, const V *restrict c, V *restrict out, V *restrict w)"
CHUNK = 400
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


def emit(function: staged.Function, name: str, *, parameters: tuple[int, ...] = (), chunk: int = CHUNK) -> Source:
    """C of an `SX` function. `parameters`: numbers of the arguments that seldom change; what depends on them only is computed once.

    Raises `ExportError` for an operation that has no C, and for functions that cannot be expanded to `SX`.
    """
    found = statements(function, name, parameters)
    slots = {v: k for k, v in enumerate(found.kept)}
    first, work_a = _body(f"{name}_prepare", found, found.rare, {}, [(slots[v], v) for v in found.kept], chunk)
    second, work_b = _body(name, found, found.often, slots, found.results, chunk)
    sizes = (found.inputs, found.outputs, len(found.kept), max(work_a, work_b))
    last = f"{first[-1]}{second[-1]}EXPORT const long {name}_sizes[4] = {{{', '.join(map(str, sizes))}}};\n"
    return Source(name, (*first[:-1], *second[:-1], last), *sizes)


def translation_units(sources: Sequence[Source], parts: int) -> list[str]:
    """C files with all functions, of about the same length, at most `parts`; few where there is little."""
    head = '#include "lanes.h"\n#include "systems.h"\n#include "vector_math.h"\n'
    pieces = sorted((piece for source in sources for piece in source.pieces[:-1]), key=len, reverse=True)
    total = sum(map(len, pieces))
    units = [[head] for _ in range(max(1, min(parts, total // 80_000)))]
    units[0].append("EXPORT const long kernel_lanes = LANES;\n")
    for source in sources:
        units[0].append(source.pieces[-1])
    for piece in pieces:
        min(units, key=lambda unit: sum(map(len, unit))).append(piece)
    return ["".join(unit) for unit in units]


def literal(number: float) -> str:
    if math.isfinite(number):
        return f"v_all({number.hex()})"
    return 'v_all(__builtin_nan(""))' if math.isnan(number) else f"v_all({'-' if number < 0 else ''}__builtin_inf())"


def _body(
    name: str, found: Statements, order: Sequence[int], slots: dict[int, int], results: Sequence[tuple[int, int]], chunk: int
) -> tuple[list[str], int]:
    """C of one function, in pieces of which the last one calls the others, and the size of its work array. `slots`: values found in c."""
    codes, args, places = found.values.codes, found.values.args, found.values.places
    inside = [i for i in order if codes[i] not in LEAVES]
    chunks = [inside[k : k + chunk] for k in range(0, len(inside), chunk)] or [[]]
    home = {i: k for k, part in enumerate(chunks) for i in part}
    last: dict[int, int] = {}
    for i in inside:
        for a in args[i]:
            if a in home:
                last[a] = home[i]
    writes: list[list[tuple[int, int]]] = [[] for _ in chunks]
    for place, v in results:
        writes[home.get(v, 0)].append((place, v))
    work, size = _work_slots(chunks, home, last)
    rooms: dict[int, int] = {}
    for i in inside:
        if codes[i] == SYSTEM:
            rooms[i] = size
            size += found.systems[places[i]].room
    pieces: list[str] = []
    for k, part in enumerate(chunks):
        title = f"HIDDEN void {name}_{k}{ARGUMENTS}" if len(chunks) > 1 else f"EXPORT void {name}{ARGUMENTS}"
        body = _lines(found, part, k, slots, work, rooms, last, writes[k])
        pieces.append("".join([f"{title} {{\n(void)in; (void)c; (void)out; (void)w;\n", *body, "}\n"]))
    if len(chunks) > 1:
        declared = "".join(f"HIDDEN void {name}_{k}{ARGUMENTS};\n" for k in range(len(chunks)))
        calls = "".join(f"{name}_{k}(in, c, out, w);\n" for k in range(len(chunks)))
        pieces.append(f"{declared}EXPORT void {name}{ARGUMENTS} {{\n{calls}}}\n")
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


def _lines(
    found: Statements,
    part: list[int],
    here: int,
    slots: dict[int, int],
    work: dict[int, int],
    rooms: dict[int, int],
    last: dict[int, int],
    writes: list[tuple[int, int]],
) -> list[str]:
    values = found.values
    codes, args, numbers, places = values.codes, values.args, values.numbers, values.places
    lines: list[str] = []
    loaded: dict[int, str] = {}

    def name_of(i: int) -> str:
        known = loaded.get(i)
        if known is None:
            if codes[i] == ca.OP_CONST:
                return literal(numbers[i])
            known = f"x{i}"
            if codes[i] == ca.OP_INPUT:
                lines.append(f"const V {known} = in[{places[i]}];\n")
            elif i in slots:
                lines.append(f"const V {known} = c[{slots[i]}];\n")
            else:
                lines.append(f"const V {known} = w[{work[i]}];\n")
            loaded[i] = known
        return known

    turns = found.pairs(part)
    for i in part:
        if i not in loaded:
            code = codes[i]
            if code == SYSTEM:
                shape, room = found.systems[places[i]], rooms[i]
                lines += [f"w[{room + k}] = {name_of(a)};\n" for k, a in enumerate(args[i])]
                lines.append(f"solve_system(w + {room}, {shape.rows}, {shape.columns}, {int(shape.damped)});\n")
                loaded[i] = ""
                continue
            if code == ANSWER:
                system = args[i][0]
                place = rooms[system] + found.systems[places[system]].operands + places[i]
                lines.append(f"const V x{i} = w[{place}];\n")
                loaded[i] = f"x{i}"
                if last.get(i, -1) > here:
                    lines.append(f"w[{work[i]}] = x{i};\n")
                continue
            arguments = [name_of(a) for a in args[i]]
            pair = turns.get(args[i][0]) if code in (ca.OP_SIN, ca.OP_COS) else None
            if pair is not None:
                sine, cosine = pair
                lines.append(f"V x{sine}, x{cosine}; v_sincos({arguments[0]}, &x{sine}, &x{cosine});\n")
                loaded[sine], loaded[cosine] = f"x{sine}", f"x{cosine}"
            else:
                lines.append(f"const V x{i} = {(UNARY.get(code) or BINARY[code]).format(*arguments)};\n")
                loaded[i] = f"x{i}"
        if last.get(i, -1) > here:
            lines.append(f"w[{work[i]}] = x{i};\n")
    lines += [f"out[{place}] = {name_of(v)};\n" for place, v in writes]
    return lines
