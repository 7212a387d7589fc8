"""The mode of a phase: what parts that open, stick and slide do in it, as rows that hold and bounds by which they go on doing so."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import OptionError
from acausal.language.component import Component, System
from acausal.language.expression import Input, Mode, Reaction
from acausal.outputs.functions import Functions
from acausal.outputs.outputs import Outputs
from acausal.reduce.modes import DAMPING, refuse_modes
from acausal.simulate.transitions import Law, laws_of
from acausal.wording import compact

_WORDS = ("open", "closed", "sticks", "slides", "slides +", "slides -", "bounces")


@dataclass(frozen=True, eq=False)
class PhaseMode:
    """What each of the `laws` does, in `words` (as many): "open", "closed", "bounces"; "off", "sticks", "slides", "slides +", "slides -".

    `functions` of the model, and the `free` ones of the same model whose reactions are inputs still.
    """

    functions: Functions
    free: Functions
    laws: tuple[Law, ...]
    words: tuple[str, ...]

    @functools.cached_property
    def reactions(self) -> ca.SX:
        """Symbols (n, 1), in the order of the laws."""
        modes = self.functions.outputs.system.modes
        return ca.SX(0, 1) if modes is None else modes.reactions

    @functools.cached_property
    def inputs(self) -> tuple[Input, ...]:
        """Those that users give."""
        return tuple(i for i in self.functions.outputs.system.flat.inputs if not isinstance(i, Mode))

    @property
    def changes(self) -> bool:
        """Whether anything in the scene opens, sticks or slides."""
        return bool(self.laws)

    def word(self, law: Law) -> str:
        """What a law does."""
        return self.words[self.laws.index(law)]

    @functools.cached_property
    def _rates(self) -> list[ca.SX]:
        """Of gaps, and slips, by laws."""
        modes = self.functions.outputs.system.modes
        return [] if modes is None else [modes.rate[law.reactions] for law in self.laws]

    @functools.cached_property
    def gaps(self) -> ca.SX:
        """What is closed (n, 1), positions."""
        rows = [law.row.gap for law, word in zip(self.laws, self.words, strict=True) if word == "closed" and not law.row.one_way]
        return ca.vertcat(ca.SX(0, 1), *rows)

    @functools.cached_property
    def open_gaps(self) -> ca.SX:
        """Of what is open (n, 1), positions."""
        pairs = zip(self.laws, self.words, strict=True)
        rows = [law.row.gap for law, word in pairs if law.row.one_sided and word == "open" and not law.row.one_way]
        return ca.vertcat(ca.SX(0, 1), *rows)

    @functools.cached_property
    def speeds(self) -> ca.SX:
        """Rates of what is closed, and slips that stick (n, 1)."""
        return ca.vertcat(ca.SX(0, 1), *(self.rate(law) for law in self.laws if self.holds(law)))

    def holds(self, law: Law) -> bool:
        """Whether it is closed, or sticks."""
        return law.holds(self.word(law))

    def rate(self, law: Law) -> ca.SX:
        """Of a gap, or the slip (n, 1)."""
        return self._rates[self.laws.index(law)]

    def of(self, law: Law) -> ca.SX:
        """The reactions (n, 1) of a law."""
        return self.reactions[law.reactions]

    def acting(self, law: Law, slip: ca.SX) -> ca.SX:
        """What is off of its reactions where these are given: nothing, or the limit against the slip (n, 1)."""
        own, word = self.of(law), self.word(law)
        if word in ("open", "off") or law.row.sliding is None:
            return own
        if word == "slides":
            return own + law.row.sliding * slip / ca.norm_2(slip)
        return own + (law.row.sliding if word == "slides +" else -law.row.sliding)

    def bounds(self, law: Law) -> list[tuple[ca.SX, str]]:
        """What must not be negative (k, 1) for this mode to go on, and what that is called."""
        row, own, word, rate = law.row, self.of(law), self.word(law), self.rate(law)
        if row.one_sided:
            if law.holds(word):
                return [(own, f"{law.name} pushes")]
            apart = row.moved if row.one_way else row.gap
            return [] if row.gate is not None else [(apart, f"{law.name} stays apart")]
        if word == "sticks" and row.holding is not None:
            if row.size == 1:
                return [(ca.vertcat(row.holding - own, row.holding + own), f"{law.name} sticks")]
            return [(row.holding**2 - ca.sumsqr(own), f"{law.name} sticks")]
        return [(rate if word == "slides +" else -rate, f"{law.name} slides")] if word in ("slides +", "slides -") else []

    @functools.cached_property
    def masks(self) -> np.ndarray:
        """(masks,): the last inputs of the model in this mode."""
        modes = self.functions.outputs.system.modes
        if modes is None:
            return np.zeros(0)
        found: list[float] = []
        for law, word in zip(self.laws, self.words, strict=True):
            if law.row.one_sided:
                found.append(float(law.holds(word)))
            elif law.row.size == 1:
                found += [float(word == "sticks"), {"slides +": 1.0, "slides -": -1.0}.get(word, 0.0)]
            else:
                found += [float(word == "sticks"), float(word == "slides"), 0.0, 0.0, 0.0, 0.0]
        masks = np.array([*found, *[0.0] * (len(modes.masks) - len(found))])  # nothing is carried on
        if modes.index is not None:  # what holds, by values: as it is
            first = modes.masks.index(modes.index.later) + 1
            masks[first : first + modes.valves**2] = np.diag(found[: modes.valves]).ravel()
        if modes.damped is not None:
            masks[modes.damped] = DAMPING
        return masks

    def row(self, law: Law, x: ca.SX, rates: ca.SX, put: Callable[[ca.SX], ca.SX]) -> ca.SX:
        """What is off (n, 1): of accelerations where a law holds, of its reactions where not; by rates of states x, which are as they are `put`."""
        if not self.holds(law):
            return put(self.acting(law, self.rate(law)))
        rate, t = put(self.rate(law)), self.functions.outputs.system.t
        if rate.is_constant():  # what follows from reactions at once
            return put(law.row.moved)
        return ca.jtimes(rate, x, rates) + ca.jtimes(rate, t, ca.SX(1))


def phase_mode(functions: Functions, said: Mapping[Any, str]) -> PhaseMode:
    """As users say it: {part: word}; parts that are not named are open. Raises `OptionError`."""
    system = functions.outputs.system
    refuse_modes(system.mechanics.locks, "OptimalControl")
    if system.modes is None or system.unmasked is None:
        if said:
            raise OptionError("OptimalControl: modes are given, but no part of the scene opens, sticks or slides.")
        return PhaseMode(functions, functions, (), ())
    refuse_modes([row for row in system.modes.rows if row.turned], "OptimalControl")
    free = Functions(Outputs(system.unmasked), replace(functions.space, system=system.unmasked))
    laws = laws_of(functions.outputs)
    found = PhaseMode(functions, free, laws, tuple("open" if law.row.one_sided else "off" for law in laws))
    for law in laws:
        needed = {s.element_hash() for s in ca.symvar(ca.veccat(found.rate(law), law.row.moved))}
        if any(entry.sx.element_hash() in needed for entry in found.inputs):
            raise OptionError(f"OptimalControl: {law.name} is moved by an input itself. Let the input be a force.")
        if law.row.sizes:
            raise OptionError(
                f"OptimalControl: {law.name} rubs by how hard its joint is loaded, which this does not go with yet. Leave that friction out, or drive the joint's flange with a friction of your own, "
                "ForceSource(scene.force - 2.0 * np.tanh(scene.rail.v / 0.01))."
            )
        if law.row.pressure is not None:
            raise OptionError(f"OptimalControl: {law.name} is the friction of a patch, which this does not go with yet.")
    return replace_words(found, said, "OptimalControl")


def replace_words(mode: PhaseMode, said: Mapping[Any, str], what: str) -> PhaseMode:
    """With other words for these parts; all others open. Raises `OptionError`."""
    words: dict[int, str] = {}
    for part, word in said.items():
        own = [k for k, law in enumerate(mode.laws) if _belongs(law, part, mode.functions.outputs)]
        known = compact(dict.fromkeys(law.row.part.path for law in mode.laws), 8)
        if not own:
            raise OptionError(f"{what}: {part!r} has no laws by which it opens, sticks or slides; these have: {known}.")
        if word not in _WORDS:
            raise OptionError(f"{what}: {_name(part, mode)} cannot be {word!r}. Say one of {', '.join(map(repr, _WORDS))}.")
        for k in own:
            words[k] = _own_word(mode.laws[k], word, [mode.laws[j] for j in own], what)
    silent = [law.name for k, law in enumerate(mode.laws) if k not in words and not law.row.one_sided and not law.needs]
    if silent and what == "OptimalControl":
        raise OptionError(
            f"{what}: say what {compact(silent, 4)} does, modes={{scene.{silent[0]}: 'sticks'}} ('slides +', 'slides -')."
        )
    usual = ("open" if law.row.one_sided else "off" for law in mode.laws)
    return PhaseMode(mode.functions, mode.free, mode.laws, tuple(words.get(k, w) for k, w in enumerate(usual)))


def _own_word(law: Law, word: str, all_laws: Sequence[Law], what: str) -> str:
    """What a word for a part says of one of its laws. Raises `OptionError`."""
    rubs = any(not one.row.one_sided for one in all_laws)
    if law.row.one_sided:
        if word in ("open", "bounces"):
            if word == "bounces" and rubs:
                raise OptionError(
                    f"{what}: {law.row.part.path} bounces and rubs: what friction does in between is not known here. Leave its friction out."
                )
            return word
        if word == "closed" and rubs:
            raise OptionError(f"{what}: {law.row.part.path} is closed and has friction: say whether it 'sticks' or 'slides'.")
        return "closed"
    if word in ("open", "closed", "bounces"):
        if not law.needs:
            raise OptionError(
                f"{what}: {law.row.part.path} has friction of its own: it 'sticks' or 'slides', and is not {word!r}."
            )
        return "off"
    if word == "slides" and law.row.size == 1:
        raise OptionError(f"{what}: {law.row.part.path} slides one way or the other: say 'slides +' or 'slides -'.")
    return "slides" if word.startswith("slides") and law.row.size == 2 else word


def _belongs(law: Law, part: Any, outputs: Outputs) -> bool:
    own = law.row.part
    if isinstance(part, str):
        return part in (own.path, law.name) or own.path.startswith(f"{part}.")
    if isinstance(part, Reaction):
        return any(part is one for one in law.row.reactions)
    return own.component is part or (isinstance(part, System) and any(own.component is inner for inner in _inside(part)))


def _inside(system: System) -> list[Component]:
    found: list[Component] = []
    for _, part in system.parts():
        found += [part, *(_inside(part) if isinstance(part, System) else [])]
    return found


def _name(part: Any, mode: PhaseMode) -> str:
    paths = [law.row.part.path for law in mode.laws if _belongs(law, part, mode.functions.outputs)]
    return compact(dict.fromkeys(paths), 2)
