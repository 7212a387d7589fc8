"""Expressions in a form that needs no simplification: sums of products of symbols with one sine or cosine of a whole combination of angles.

Products of sines and cosines become sums as they are made (cos a cos b = (cos(a - b) + cos(a + b)) / 2), so that what is equal looks equal:
cos(a) cos(b) - sin(a) sin(b) is cos(a + b) at once. Each number carries its rounding error, and is dropped when it is nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from acausal.errors import ExportError

_EPS = 2.0**-52
_MARGIN = 8.0
_HIGHEST = 8
_SHORT = 1000

Powers = tuple[tuple[int, Fraction], ...]
"""(atom, exponent), by atom."""
Angle = tuple[tuple[int, int], ...]
"""(atom, whole factor), by atom; the first factor is positive."""
Term = tuple[Powers, str, Angle]
"""Powers times the sine ("s") or cosine ("c") of an angle; ("", ()) for neither."""
Sum = dict[Term, tuple[float, float]]
"""Coefficient and bound of its rounding error, of each term."""

NONE: Term = ((), "", ())


class TooLarge(ExportError):
    """More terms than one cares to read."""


@dataclass
class Algebra:
    """Sums over `atoms`: symbols, and functions of sums that have no simpler form. `budget`: products of terms that may
    still be made, `shown`: terms that may be.
    """

    budget: int
    shown: int
    atoms: list[Any] = field(default_factory=list)
    units: dict[int, Sum] = field(default_factory=dict)
    """Atoms whose squares are sums of others: the first entry of a unit quaternion."""
    _known: dict[Any, int] = field(default_factory=dict)
    _bases: dict[int, Sum] = field(default_factory=dict)

    def symbol(self, name: Any) -> Sum:
        """A symbol of its own, of either sign."""
        k = self._atom(("symbol", name), name)
        return {(((k, Fraction(1)),), "", ()): (1.0, 0.0)}

    def number(self, value: float) -> Sum:
        """A constant."""
        return {NONE: (value, 0.0 if value == round(value) else _EPS * abs(value))} if value else {}

    def add(self, a: Sum, b: Sum, sign: float = 1.0) -> Sum:
        """a + sign b."""
        found = dict(a)
        for term, (value, error) in b.items():
            self._put(found, term, sign * value, error)
        return found

    def scale(self, a: Sum, factor: float) -> Sum:
        """a times a number."""
        return {term: (factor * value, abs(factor) * error) for term, (value, error) in a.items()}

    def multiply(self, a: Sum, b: Sum) -> Sum:
        """a b."""
        self.budget -= len(a) * len(b)
        if self.budget < 0:
            raise TooLarge("too large")
        found: Sum = {}
        whole: list[tuple[Term, int, float, float]] = []
        for (p, kind_a, angle_a), (x, dx) in a.items():
            for (q, kind_b, angle_b), (y, dy) in b.items():
                value, error = x * y, abs(x) * dy + abs(y) * dx + _EPS * abs(x * y)
                powers = _merged(p, q)
                for sign, kind, angle in _product(kind_a, angle_a, kind_b, angle_b):
                    term = (powers, kind, angle)
                    ready = next((i for i, n in powers if self._expands(i, n)), None)
                    if ready is None:
                        self._put(found, term, sign * value, abs(sign) * error)
                    else:
                        whole.append((term, ready, sign * value, abs(sign) * error))
        for (powers, kind, angle), i, value, error in whole:
            n = dict(powers)[i]
            left, times, base = (n % 2, n // 2, self.units[i]) if i in self.units else (Fraction(0), n, self._bases[i])
            others = tuple((j, left if j == i else m) for j, m in powers if j != i or left)
            rest: Sum = {(others, kind, angle): (value, error)}
            found = self.add(found, self.multiply(rest, self.power(base, Fraction(times))))
        return found

    def _expands(self, atom: int, exponent: Fraction) -> bool:
        """Whether a power of an atom is a sum."""
        if exponent.denominator > 1 or exponent <= 0:
            return False
        return atom in self._bases or (atom in self.units and exponent >= 2)

    def unit(self, entries: Sequence[Sum]) -> None:
        """The squares of these symbols add up to 1."""
        ((powers, _, _),) = entries[0]
        rest = self.number(1.0)
        for entry in entries[1:]:
            rest = self.add(rest, self.multiply(entry, entry), -1.0)
        self.units[powers[0][0]] = rest

    def power(self, a: Sum, exponent: Fraction) -> Sum:
        """a^exponent; what has no expansion becomes an atom, without the number in front."""
        if exponent.denominator == 1 and 0 <= exponent <= _HIGHEST:
            found = self.number(1.0)
            for _ in range(int(exponent)):
                found = self.multiply(found, a)
            return found
        if not a:
            raise ExportError("A division by zero has no readable form.")
        if len(a) == 1:
            ((powers, kind, _), (value, error)) = next(iter(a.items()))
            split = exponent.denominator == 1 or (value > 0 and not powers)
            if not kind and split:
                number = float(value) ** float(exponent)
                error = abs(number) * (abs(float(exponent)) * error / abs(value) + _EPS)
                return {(tuple((i, n * exponent) for i, n in powers), "", ()): (number, error)}
        lead = abs(next(iter(sorted(a.items(), key=lambda item: _order(item[0]))))[1][0])
        base = self.scale(a, 1.0 / lead)
        k = self._atom(("base", _frozen(base)), None)
        self._bases[k] = base
        number = lead ** float(exponent)
        return {(((k, exponent),), "", ()): (number, 2 * _EPS * number)}

    def sine_cosine(self, a: Sum) -> tuple[Sum, Sum]:
        """sin a and cos a."""
        phase, factors = 0.0, dict[int, int]()
        for (powers, kind, _), (value, _) in a.items():
            if not powers and not kind:
                phase = value
            elif kind or len(powers) != 1 or powers[0][1] != 1 or abs(value - round(value)) > 1e-12 or abs(value) > _HIGHEST:
                factors = {}
                break
            else:
                factors[powers[0][0]] = round(value)
        if not factors and set(a) <= {NONE}:
            return self.number(math.sin(phase)), self.number(math.cos(phase))
        if not factors:
            rest = {term: value for term, value in a.items() if term != NONE}
            sign = 1.0 if not rest or min(rest.items(), key=lambda item: _order(item[0]))[1][0] > 0 else -1.0
            rest = self.scale(rest, sign)
            k = self._atom(("angle", _frozen(rest)), None)
            self._bases.setdefault(k, rest)
            factors = {k: round(sign)}
            phase = a.get(NONE, (0.0, 0.0))[0]
        sign, angle = _signed(factors)
        sine: Sum = {((), "s", angle): (float(sign), 0.0)}
        cosine: Sum = {((), "c", angle): (1.0, 0.0)}
        if not phase:
            return sine, cosine
        s, c = self.number(math.sin(phase)), self.number(math.cos(phase))
        return (
            self.add(self.multiply(sine, c), self.multiply(cosine, s)),
            self.add(self.multiply(cosine, c), self.multiply(sine, s), -1.0),
        )

    def function(self, operation: Any, *arguments: Sum) -> Sum:
        """An operation that is left as it is: `operation` makes its sympy form."""
        from_arguments = [self.to_sympy(a) for a in arguments]
        value = operation(*from_arguments)
        if value.is_Number:
            return self.number(float(value))
        return {(((self._atom(("symbol", value), value), Fraction(1)),), "", ()): (1.0, 0.0)}

    def to_sympy(self, a: Sum) -> Any:
        """As a sympy expression, terms with the same symbols next to one another."""
        import sympy

        self.shown -= len(a)
        if self.shown < 0:
            raise TooLarge("too large")
        shared: dict[Powers, dict[Powers, dict[tuple[str, Angle], tuple[float, float]]]] = {}
        for (powers, kind, angle), value in a.items():
            outside = tuple(pair for pair in powers if pair[0] in self._bases)
            inside = tuple(pair for pair in powers if pair[0] not in self._bases)
            shared.setdefault(outside, {}).setdefault(inside, {})[kind, angle] = value
        return sympy.Add(*(self._product(outside) * self._terms(classes) for outside, classes in shared.items()))

    def _terms(self, classes: Mapping[Powers, Mapping[tuple[str, Angle], tuple[float, float]]]) -> Any:
        import sympy

        terms: list[Any] = []
        for powers, parts in classes.items():
            product = self._product(powers)
            terms += [number * wave * product for number, wave in self._waves(parts)]
        return sympy.Add(*terms)

    def _product(self, powers: Powers) -> Any:
        import sympy

        return sympy.Mul(*(self._atom_form(i) ** _rational(n) for i, n in powers))

    def _waves(self, parts: Mapping[tuple[str, Angle], tuple[float, float]]) -> list[tuple[Any, Any]]:
        """Numbers and sines or cosines; (1 - cos 2a) / 2 as a square."""
        import sympy

        (mean, error), rest = parts.get(("", ()), (0.0, 0.0)), {key: value for key, value in parts.items() if key[0]}
        if mean and len(rest) == 1:
            ((kind, angle), (value, more)) = next(iter(rest.items()))
            if kind == "c" and all(n % 2 == 0 for _, n in angle) and abs(abs(value) - abs(mean)) <= _MARGIN * (error + more):
                half = self._angle_form(tuple((i, n // 2) for i, n in angle))
                wave = sympy.cos(half) if value * mean > 0 else sympy.sin(half)
                return [(_clean(2 * mean, 2 * error), wave**2)]
        found: list[tuple[Any, Any]] = [(_clean(mean, error), sympy.Integer(1))] if mean else []
        for (kind, angle), (value, more) in rest.items():
            argument = self._angle_form(angle)
            found.append((_clean(value, more), sympy.sin(argument) if kind == "s" else sympy.cos(argument)))
        return found

    def _angle_form(self, angle: Angle) -> Any:
        import sympy

        return sympy.Add(*(n * self._atom_form(i) for i, n in angle))

    def _atom_form(self, k: int) -> Any:
        if self.atoms[k] is None:
            self.atoms[k] = self.to_sympy(self._bases[k])
        return self.atoms[k]

    def _atom(self, key: Any, form: Any) -> int:
        if key not in self._known:
            self._known[key] = len(self.atoms)
            self.atoms.append(form)
        return self._known[key]

    def _put(self, found: Sum, term: Term, value: float, error: float) -> None:
        before, slack = found.get(term, (0.0, 0.0))
        total, error = before + value, error + slack + (_EPS * abs(before + value) if before else 0.0)
        if abs(total) <= _MARGIN * error or total == 0:
            found.pop(term, None)
        else:
            found[term] = (total, error)


def _merged(p: Powers, q: Powers) -> Powers:
    if not p or not q:
        return p or q
    found = dict(p)
    for i, n in q:
        found[i] = found.get(i, Fraction(0)) + n
    return tuple(sorted((i, n) for i, n in found.items() if n))


def _product(kind_a: str, a: Angle, kind_b: str, b: Angle) -> list[tuple[float, str, Angle]]:
    """Of two sines or cosines, as a sum of (factor, kind, angle)."""
    if not kind_a or not kind_b:
        return [(1.0, kind_a or kind_b, a or b)]
    sum_of, difference = dict(a), dict(a)
    for i, n in b:
        sum_of[i] = sum_of.get(i, 0) + n
        difference[i] = difference.get(i, 0) - n
    (sign_s, angle_s), (sign_d, angle_d) = _signed(sum_of), _signed(difference)
    if kind_a == kind_b:
        both = -0.5 if kind_a == "s" else 0.5
        pair = [(0.5, "c", angle_d), (both, "c", angle_s)]
    else:  # sin a cos b; for cos a sin b the sign of the difference turns
        turned = 0.5 if kind_a == "s" else -0.5
        pair = [(turned * sign_d, "s", angle_d), (0.5 * sign_s, "s", angle_s)]
    return [(x, kind if angle else "", angle) for x, kind, angle in pair if angle or kind == "c"]


def _signed(factors: Mapping[int, int]) -> tuple[int, Angle]:
    """The sign that makes the first factor positive, and the angle with it."""
    angle = tuple(sorted((i, n) for i, n in factors.items() if n))
    sign = -1 if angle and angle[0][1] < 0 else 1
    return sign, tuple((i, sign * n) for i, n in angle)


def _order(term: Term) -> tuple[Any, ...]:
    return len(term[0]), term


def _frozen(a: Sum) -> tuple[Any, ...]:
    """The same for sums that are equal to rounding."""
    return tuple(sorted((term, float(f"{value:.11g}")) for term, (value, _) in a.items()))


def _rational(n: Fraction) -> Any:
    import sympy

    return sympy.Rational(n.numerator, n.denominator)


def _clean(value: float, error: float) -> Any:
    """The shortest number within the rounding error: a fraction where one is short, else the fewest digits."""
    import sympy

    allowed = max(_MARGIN * error, 2 * _EPS * abs(value))
    short = Fraction(value).limit_denominator(_SHORT - 1)
    if abs(float(short) - value) <= allowed:
        return _rational(short)
    digits = next((d for d in range(1, 17) if abs(float(f"{value:.{d}g}") - value) <= allowed), 17)
    return sympy.Float(float(f"{value:.{digits}g}"), 15)
