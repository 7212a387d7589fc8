"""C of programs: what the interpreter carries out, for a compiler."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from acausal.emit.emit import ARGUMENTS, BINARY, CHUNK, UNARY, literal
from acausal.emit.program import CODES, LOAD, MOVE, MUL_ADD, MUL_MUL, MUL_SUB, NUMBER, SINCOS, STORE, SUB_MUL, SYSTEM
from acausal.numerics.staged import LinearSystem

_FORMULAS = {CODES[code]: text for code, text in (UNARY | BINARY).items()} | {
    MUL_ADD: "{0} * {1} + {2}",
    MUL_SUB: "{0} * {1} - {2}",
    SUB_MUL: "{2} - {0} * {1}",
    MUL_MUL: "{0} * {1} * {2}",
    MOVE: "{0}",
}
_OPERANDS = {
    code: 3 if code in (MUL_ADD, MUL_SUB, SUB_MUL, MUL_MUL) else 2 if "{1}" in text else 1 for code, text in _FORMULAS.items()
}
_Statement = tuple[int, int, int, int, int]
"""An operation, and places in values; of a number its two halves, of a system its rows, right sides, and whether it is damped."""


def emit_program(program: np.ndarray, name: str, lanes: int, *, chunk: int = CHUNK) -> list[str]:
    """C of `void name(in, c, out, w)`, in pieces of which the last one calls the others: what the interpreter does with the
    statements (n, 5) of a program for so many lanes and its frame, which is `w`. Bits are the same.
    """
    statements = _in_values(program, lanes)
    parts = [_Part(statements[k : k + chunk]) for k in range(0, len(statements), chunk)] or [_Part([])]
    wanted: set[int] = set()
    for part in reversed(parts):
        part.kept = part.written & wanted
        wanted = part.read | (wanted - part.written)
    if len(parts) == 1:
        return [f"EXPORT void {name}{ARGUMENTS} {{\n{parts[0].text()}}}\n"]
    pieces = [f"HIDDEN void {name}_{k}{ARGUMENTS} {{\n{part.text()}}}\n" for k, part in enumerate(parts)]
    declared = "".join(f"HIDDEN void {name}_{k}{ARGUMENTS};\n" for k in range(len(parts)))
    calls = "".join(f"{name}_{k}(in, c, out, w);\n" for k in range(len(parts)))
    return [*pieces, f"{declared}EXPORT void {name}{ARGUMENTS} {{\n{calls}}}\n"]


def _in_values(program: np.ndarray, lanes: int) -> list[_Statement]:
    """The statements before their end, with places that count values instead of bytes."""
    table = program[: int(np.argmax(program[:, 0] == 0))].astype(np.int64)
    table[:, 1] //= 8 * lanes
    table[(table[:, 0] != NUMBER) & (table[:, 0] != SYSTEM), 2:] //= 8 * lanes
    return [(a, b, c, d, e) for a, b, c, d, e in table.tolist()]


def _needs(statement: _Statement) -> Sequence[int]:
    """Places of the frame that are read."""
    code, to, *of = statement
    if code == SYSTEM:
        return range(to, to + _system(of).operands)
    return of[: 1 if code in (STORE, SINCOS) else _OPERANDS.get(code, 0)]


def _makes(statement: _Statement) -> Sequence[int]:
    """Places of the frame that are written."""
    code, to, *of = statement
    if code == SYSTEM:
        system = _system(of)
        return range(to + system.operands, to + system.operands + system.answers)
    return () if code == STORE else (to, of[1]) if code == SINCOS else (to,)


def _system(of: Sequence[int]) -> LinearSystem:
    rows, columns, damped = of
    return LinearSystem(rows, columns, bool(damped))


@dataclass
class _Part:
    """Statements of one C function: the places that they read before they write them, and those they write; of these `kept` are read later."""

    statements: list[_Statement]
    read: set[int] = field(default_factory=set[int])
    written: set[int] = field(default_factory=set[int])
    kept: set[int] = field(default_factory=set[int])

    def __post_init__(self) -> None:
        for statement in self.statements:
            self.read.update(place for place in _needs(statement) if place not in self.written)
            self.written.update(_makes(statement))

    def text(self) -> str:
        """Values that nothing else needs have names of their own; others are put to their places when these are looked at from elsewhere."""
        lines = ["(void)in; (void)c; (void)out; (void)w;\n"]
        names: dict[int, str] = {}
        unsaved: dict[int, str] = {}

        def value(place: int) -> str:
            if place not in names:
                names[place] = f"x{len(lines)}"
                lines.append(f"const V {names[place]} = w[{place}];\n")
            return names[place]

        def make(place: int, formula: str) -> None:
            name = f"x{len(lines)}"
            lines.append(f"const V {name} = {formula};\n")
            names[place] = unsaved[place] = name

        for statement in self.statements:
            code, to, *of = statement
            if code == SYSTEM:
                lines += [f"w[{place}] = {unsaved.pop(place)};\n" for place in _needs(statement) if place in unsaved]
                lines.append(f"solve_system(w + {to}, {of[0]}, {of[1]}, {of[2]});\n")
                for place in _makes(statement):
                    names.pop(place, None)
                    unsaved.pop(place, None)
            elif code == STORE:
                lines.append(f"out[{to}] = {value(of[0])};\n")
            elif code == LOAD:
                make(to, f"in[{of[0]}]")
            elif code == NUMBER:
                make(to, literal(struct.unpack("=d", struct.pack("=ii", of[0], of[1]))[0]))
            elif code == SINCOS:
                angle = value(of[0])
                sine, cosine = f"x{len(lines)}", f"y{len(lines)}"
                lines.append(f"V {sine}, {cosine}; v_sincos({angle}, &{sine}, &{cosine});\n")
                names[to] = unsaved[to] = sine
                names[of[1]] = unsaved[of[1]] = cosine
            else:
                make(to, _FORMULAS[code].format(*[value(place) for place in of[: _OPERANDS[code]]]))
        lines += [f"w[{place}] = {name};\n" for place, name in sorted(unsaved.items()) if place in self.kept]
        return "".join(lines)
