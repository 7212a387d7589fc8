"""Elimination of aliases and constants: a = b, a = -b, a = k b + c, a = c, with numbers k and c; also of a = k der(b).

Only where k is a number of the user's: not where it is a sum, since going on like that is elimination without choice of pivots.

Equations with numeric coefficients are kept as dictionaries over chain levels. Whenever one shrinks to two unknowns or one, a
chain is merged or becomes a constant, and the equations that contain it are looked at again. Numbers put into the other
equations may make them linear in turn, so this is repeated until nothing changes. Near-linear in size: each merge touches only
the equations of the chain that goes. Tearing apart what is trivial first is usual in Modelica compilers (Cellier & Kofman,
Continuous System Simulation, 2006, 7.2).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import casadi as ca

from acausal.errors import OverdeterminedError
from acausal.scalar.affine import Affine
from acausal.scalar.chains import Chains, Level
from acausal.scalar.dependent import replace_dependent
from acausal.scalar.diagnosis import named, reactions_in
from acausal.scalar.equations import EquationSet, ScalarEquation, symbols_in
from acausal.scalar.naming import Names
from acausal.scalar.structure import Form, forms

_ROUNDS = 10
"""Numbers found after so many passes are left to the block lower triangular form, which finds them too."""


@dataclass(frozen=True)
class Simplified:
    """The equations that remain: with numeric coefficients, or as expressions in the user's symbols; and what was dropped."""

    chains: Chains
    affine: dict[int, Affine]
    general: dict[int, ca.SX]
    dropped: tuple[ScalarEquation, ...]


def eliminate_aliases(system: EquationSet) -> Simplified:
    """Merges chains, finds constants and hidden constraints. Raises OverdeterminedError for an equation that has become 0 = number."""
    elimination = _Elimination(system, Chains(system))
    elimination.run()
    return Simplified(elimination.chains, elimination.affine, elimination.general, tuple(elimination.dropped))


@dataclass
class _Elimination:
    system: EquationSet
    chains: Chains
    affine: dict[int, Affine] = field(default_factory=dict)
    general: dict[int, ca.SX] = field(default_factory=dict)
    dropped: list[ScalarEquation] = field(default_factory=list)
    occurrences: dict[int, set[int]] = field(default_factory=dict)
    """Root -> equations of `affine` it is in."""
    top: int = 0
    """Highest derivative that any equation of `affine` has held."""

    def run(self) -> None:
        self.general = dict(enumerate(equation.residual for equation in self.system.equations))
        for _ in range(_ROUNDS):
            found = self._find_affine()
            self._work(deque(found))
            self.general = Names(self.chains).rename(self.general)
            hidden = self._find_hidden()
            self._work(deque(hidden))
            if not found and not hidden:
                break
        self.general = Names(self.chains).rename(self.general)

    def _find_affine(self) -> list[int]:
        """Moves general equations that are linear with numeric coefficients to `affine`; returns their numbers."""
        symbols = symbols_in(self.general.values())
        members = [(key, s) for key, s in symbols.items() if key in self.chains.members]
        known = [s for key, s in symbols.items() if key not in self.chains.members]
        variables, keys = [s for _, s in members], [key for key, _ in members]
        found: list[int] = []
        for k, form in zip(list(self.general), forms(list(self.general.values()), variables, known), strict=True):
            if not form.other:
                residual = self.general.pop(k)
                self.affine[k] = self._in_levels(form, keys)
                if form.opaque:
                    own = [variables[i] for i in form.linear]
                    self.affine[k].rest = ca.substitute([residual], own, [ca.SX(0)] * len(own))[0] - form.constant
                found.append(k)
        for k in found:
            for root, _ in self.affine[k].coefficients:
                self.occurrences.setdefault(root, set()).add(k)
        return found

    def _find_hidden(self) -> list[int]:
        """Replaces equations by combinations without highest derivatives; returns their numbers."""
        highest: dict[int, int] = {}
        for equation in self.affine.values():
            for root, order in equation.coefficients:
                highest[root] = max(highest.get(root, 0), order)
        for residual in self.general.values():
            for symbol in ca.symvar(residual):
                member = self.chains.members.get(symbol.element_hash())
                if member is not None:
                    relation = self.chains.level(member.base, member.order)
                    highest[relation.root] = max(highest.get(relation.root, 0), relation.order)
        replaced = replace_dependent(self.affine, highest)
        for k, equation in replaced.items():
            self.affine[k] = equation
            equation.combined = False
            for root, _ in equation.coefficients:
                self.occurrences.setdefault(root, set()).add(k)
        return sorted(replaced)

    def _in_levels(self, form: Form, keys: list[int]) -> Affine:
        equation = Affine({}, form.constant, abs(form.constant))
        for i, coefficient in form.linear.items():
            member = self.chains.members[keys[i]]
            relation = self.chains.level(member.base, member.order)
            equation.add_number(coefficient * relation.offset)
            self._add(equation, (relation.root, relation.order), coefficient * relation.factor)
        return equation

    def _add(self, equation: Affine, level: Level, coefficient: float) -> None:
        number = self.chains.value(level)
        if number is None:
            self.top = max(self.top, level[1])
            equation.add(level, coefficient)
        else:
            equation.add_number(coefficient * number)

    def _work(self, queue: deque[int]) -> None:
        divisions: deque[int] = deque()  # come last: others may make them needless
        while queue or divisions:
            last = not queue
            k = divisions.popleft() if last else queue.popleft()
            equation = self.affine.get(k)
            if equation is None:
                continue
            if not last and self._divides(equation):
                divisions.append(k)
                continue
            changed = self._eliminate(k, equation)
            if changed is not None:
                queue.extend(sorted(self._renewed(changed)))

    def _divides(self, equation: Affine) -> bool:
        """Whether one of two unknowns can be eliminated only by a division."""
        able = [a for (root, order), a in equation.coefficients.items() if order == 0 and root not in self.chains.outer]
        return len(equation.coefficients) == 2 and all(abs(a) != 1.0 for a in able)

    def _eliminate(self, k: int, equation: Affine) -> int | None:
        """Uses an equation with at most two levels; returns the root that is gone, if one is."""
        count = len(equation.coefficients)
        if not count:
            self._drop(k, equation)
            return None
        if count > 2 or equation.open or (count == 2 and equation.combined):
            return None
        # without a division where that is possible; where a number is between, what nonlinear equations are written in is kept: with it they begin at zero
        curved = self._curved() if equation.constant and count == 2 else set[int]()
        levels = sorted(
            equation.coefficients.items(),
            key=lambda item: (item[0][1], abs(item[1]) != 1.0, item[0][0] in curved, self._size(item[0][0])),
        )
        if levels[0][0][0] in self.chains.outer:
            levels.reverse()
        (root, order), a = levels[0]
        if order > 0 or root in self.chains.outer or (count == 2 and levels[1][0][0] == root):
            return None
        del self.affine[k]
        if count == 1:
            self.chains.constants[root] = -equation.constant / a
        else:
            other, b = levels[1]
            self.chains.merge(root, other, -b / a, -equation.constant / a)
        return root

    def _curved(self) -> set[int]:
        """Roots of what stands in equations that are not linear."""
        members = [self.chains.members.get(key) for key in symbols_in(self.general.values())]
        return {self.chains.level(member.base, member.order).root for member in members if member is not None}

    def _size(self, root: int) -> int:
        return len(self.occurrences.get(root, ()))

    def _drop(self, k: int, equation: Affine) -> None:
        del self.affine[k]
        source = self.system.equations[k]
        if not equation.consistent:
            members = [self.chains.members.get(s.element_hash()) for s in ca.symvar(source.residual)]
            names = named(m.unknown for m in members if m is not None)
            error = OverdeterminedError(
                f"Equation {source}{f' of {names}' if names else ''} contradicts the others: with what they say it reads 0 = {self._told(equation.remainder)}. "
                f"A value or a motion is given twice: remove a source, or another equation of the same variables"
                f"{'' if equation.remainder.is_constant() else ', or let something between yield (a leakage, a resistance, a spring)'}. {self.system.totals}"
            )
            error.reactions = reactions_in(equation.remainder)
            raise error
        self.dropped.append(source)

    def _told(self, remainder: ca.SX) -> str:
        if remainder.is_constant():
            return f"{float(remainder):.6g}"
        known = [(symbol, name) for symbol, name in self.system.names if ca.depends_on(remainder, symbol)]
        named = ca.substitute(remainder, ca.vertcat(*(s for s, _ in known)), ca.vertcat(*(ca.SX.sym(name) for _, name in known)))
        return str(named)[:60]

    def _renewed(self, gone: int) -> set[int]:
        """Rewrites the equations of a root that is gone; returns their numbers."""
        touched = {k for k in self.occurrences.pop(gone, set()) if k in self.affine}
        for k in touched:
            equation = self.affine[k]
            for level in [(gone, k) for k in range(self.top + 1) if (gone, k) in equation.coefficients]:
                coefficient = equation.coefficients.pop(level)
                number = self.chains.value(level)
                if number is not None:
                    equation.add_number(coefficient * number)
                    continue
                relation = self.chains.level(*level)
                equation.add_number(coefficient * relation.offset)
                self._add(equation, (relation.root, relation.order), coefficient * relation.factor)
                self.occurrences.setdefault(relation.root, set()).add(k)
        return touched
