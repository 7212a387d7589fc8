"""What is wrong with equations that do not determine their unknowns, in the user's words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import casadi as ca

from acausal.errors import ModelError, OverdeterminedError, UnderdeterminedError
from acausal.language.expression import Reaction, declared
from acausal.scalar.chains import Chains
from acausal.scalar.equations import EquationSet, ScalarEquation, Unknown
from acausal.scalar.matching import Incidence, Parts, match, overdetermined, underdetermined
from acausal.wording import compact

_NAMED = 5


def check_regular(
    system: EquationSet,
    chains: Chains,
    sources: Sequence[ScalarEquation],
    incidence: Incidence,
    roots: Sequence[int],
    dropped: Sequence[ScalarEquation],
) -> None:
    """Raises UnderdeterminedError or OverdeterminedError unless each equation can be matched to an unknown (a chain) and vice versa."""
    owner = match(incidence, len(roots))
    under = underdetermined(incidence, owner)
    over = overdetermined(incidence, owner)
    members = [] if under is None else [chains.of_root(roots[u]) for u in under.unknowns]
    missing = None if under is None else _missing(under, members)
    if over is not None:
        least = named(u for k in over.unknowns for u in chains.of_root(roots[k])[:1])
        more = f" In return {missing}." if missing else ""
        error = OverdeterminedError(
            f"{_too_many(over, sources)} They leave no freedom for: {least}. A value or a motion may be given twice: remove a source or a "
            f"connection.{more} {system.totals}"
        )
        error.reactions = reactions_in(ca.vertcat(*(sources[e].residual for e in over.equations)))
        raise error
    if missing is not None:
        empty = f" Say nothing new: {', '.join(str(e) for e in dropped[:3])}." if dropped else ""
        hints = " ".join(dict.fromkeys(u.hint for chain in members for u in chain if u.hint))
        raise UnderdeterminedError(f"{missing}. {hints or 'A component or a connection may be missing.'}{empty} {system.totals}")


def reactions_in(value: ca.SX) -> tuple[Reaction, ...]:
    """Those that it depends on."""
    return tuple(s for s in map(declared, ca.symvar(value)) if isinstance(s, Reaction))


def _missing(under: Parts, members: Sequence[Sequence[Unknown]]) -> str:
    n, total = under.excess, len(members)
    shown = named(u for chain in members for u in _spread(chain, total))
    count = "1 variable has" if n == 1 else f"{n} variables have"
    among = "" if total == n and sum(len(chain) for chain in members) == n else ", among"
    return f"{count} no equation{among}: {shown}"


def _spread(chain: Sequence[Unknown], total: int) -> Sequence[Unknown]:
    """Several names of one unknown where there is room."""
    return chain[: max(1, _NAMED // total)]


def _too_many(over: Parts, sources: Sequence[ScalarEquation]) -> str:
    n = over.excess
    return f"{n} equation{' is' if n == 1 else 's are'} too many, among: {compact((str(sources[e]) for e in over.equations), _NAMED)}."


def named(unknowns: Iterable[Unknown]) -> str:
    """The first few unknowns in words, each once."""
    return compact(map(str, unknowns), _NAMED)


def singular(system: EquationSet, sources: Iterable[ScalarEquation], unknowns: Iterable[Unknown]) -> UnderdeterminedError:
    """A block whose matrix has no inverse: some of its equations follow from the others."""
    sources, unknowns = list(sources), list(unknowns)
    labels = list(dict.fromkeys(str(e) for e in sources))
    hints = _of_zeros(system, sources) or " ".join(dict.fromkeys(u.hint for u in unknowns if u.hint))
    return UnderdeterminedError(
        f"The equations {', '.join(labels[:_NAMED])} depend on one another and do not determine {named(unknowns)}. "
        f"{hints or 'Two parts may fix the same thing; put an element with compliance or resistance between, or remove one.'} {system.totals}"
    )


def _of_zeros(system: EquationSet, sources: Sequence[ScalarEquation]) -> str:
    """What parameters with the value 0 have to do with it."""
    used = {s.element_hash() for source in sources for s in ca.symvar(source.residual)}
    zeros = [system.name(s) for s, value in system.values if value == 0 and s.element_hash() in used]
    if not zeros:
        return ""
    return f"In them {compact(zeros, _NAMED)} {'is' if len(zeros) == 1 else 'are'} 0: give another value, or the number 0 in the parameter's place, with which the equation has another form."


def no_rate(system: EquationSet, symbol: ca.SX, source: ScalarEquation) -> ModelError:
    """A known symbol without a rate would have to be differentiated."""
    of = {rate.element_hash(): known.element_hash() for known, rate in system.known_rates}
    order, key = 0, symbol.element_hash()
    while key in of and order < 2:
        order, key = order + 1, of[key]
    twice, which = (("", ""), (" twice", "second "), (" three times", "third "))[order]
    return OverdeterminedError(
        f"Equation {source} fixes a quantity whose rate is needed, so '{system.name(symbol)}' would have to be differentiated{twice}, and its {which}rate "
        "is not known. Put an element that stores (a small inertia, spring, capacitor) between, or give it as a function of time."
    )


def no_jerk(unknown: Unknown, needed_for: Iterable[Unknown]) -> ModelError:
    """The derivative of a joint's acceleration would be needed."""
    return OverdeterminedError(
        f"The acceleration {unknown} would have to be differentiated, for {named(needed_for) or 'another variable'}. It follows from forces, "
        "whose rates are not known. Put an element that stores (a small inertia, spring, capacitor) or a filter between."
    )
