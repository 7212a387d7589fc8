"""What is set at zeros of expressions, as functions of numbers: states, and what parts remember."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.collocation.modes import SetFunctions
from acausal.errors import ExpressionError, ModelError, UnknownVariableError
from acausal.language.expression import Discrete, Expression, Input, InputRate, Parameter, Scalar, Symbol, Time, leaves, sx
from acausal.language.when import when
from acausal.numerics.elimination import solved_by_qr
from acausal.numerics.folding import folded_function
from acausal.numerics.vanishing import vanish
from acausal.outputs.outputs import Outputs
from acausal.reduce.state_space import StateSpace
from acausal.wording import compact


@dataclass(frozen=True)
class Setting:
    """An event at which something is set, and who says so."""

    event: when
    who: str


def settings(outputs: Outputs, events: Iterable[when] = ()) -> tuple[Setting, ...]:
    """Of all parts, then of `events` of a run."""
    flat = outputs.system.flat
    found = [Setting(law, part.where) for part in flat.parts for law in part.laws if isinstance(law, when)]
    return (*found, *(Setting(event, f"ac.when ({event.line})") for event in events if event.set is not None))


def set_functions(outputs: Outputs, space: StateSpace, events: Iterable[when] = ()) -> SetFunctions | None:
    """Of all parts, and of `events`; None where nothing is set and nothing is remembered. Raises `ModelError` for what cannot be set, and guards that are always zero."""
    found, discretes = settings(outputs, events), outputs.system.flat.discretes
    if not found and not discretes:
        return None
    setter = _Setter(outputs, space)
    guards = [setter.guard(setting) for setting in found]
    values, targets, first, words = list[ca.SX](), list[int](), [0], list[str]()
    for setting in found:
        for target, value, word in setter.assigned(setting):
            values.append(value)
            targets.append(target)
            words.append(word)
        first.append(len(targets))
    starts = [setter.start(discrete) for discrete in discretes]
    locks = outputs.system.locks
    meeting = [] if locks is None else [space.put(locks.meeting)]

    def function(name: str, column: list[ca.SX]) -> ca.Function:
        rows = ca.densify(ca.vertcat(ca.SX(0, 1), *column))
        return folded_function(name, space.arguments, [rows], ["t", "x", "u", "p"], [name])

    return SetFunctions(
        function("set_guards", guards), function("set", [*starts, *values, *meeting, *(setter.slope(guard) for guard in guards)]), tuple(setting.event.sign for setting in found),
        tuple(first), tuple(targets), tuple(setting.who for setting in found), tuple(words),
        tuple(map(outputs.name, discretes)),
        () if locks is None else locks.words,
    )  # fmt: skip


@dataclass(frozen=True)
class _Setter:
    outputs: Outputs
    space: StateSpace

    def guard(self, setting: Setting) -> ca.SX:
        """(1, 1)."""
        event = setting.event
        guard = self._read(event.expression, setting, "its expression")
        if guard.numel() != 1:
            raise ModelError(f"{setting.who}: {event.expression!r} is not a scalar; give one event for each entry.")
        _, _, _, p = self.space.arguments
        if guard.is_zero() or vanish(guard, p, self.space.p_values):
            raise ModelError(
                f"{setting.who}: {event.expression!r} is zero at all times, so it never passes through zero. Compare what moves with something else."
            )
        if not ca.symvar(guard):
            raise ModelError(
                f"{setting.who}: {event.expression!r} does not change. Give an expression of the scene's variables or of ac.time."
            )
        return guard

    def slope(self, guard: ca.SX) -> ca.SX:
        """The rate of a guard along the motion; 0 where that is not known, since inputs change, too."""
        t, x, u, _ = self.space.arguments
        own = u.numel() - len(self.outputs.system.flat.modes)
        if own and ca.depends_on(guard, u[:own]):
            return ca.SX(0)
        return ca.jtimes(guard, t, ca.SX(1)) + ca.jtimes(guard, x, self.space.kept(self.outputs.system.x_dot))

    def start(self, discrete: Discrete) -> ca.SX:
        """The value that it begins with."""
        setting = Setting(when(discrete), self.outputs.name(discrete))
        return self._read(discrete.start, setting, "its start")

    def assigned(self, setting: Setting) -> Iterator[tuple[int, ca.SX, str]]:
        """Number of a target, new value, and what it is called."""
        flat, x = self.outputs.system.flat, self.space.x
        if setting.event.set is None:
            raise ModelError(
                f"{setting.who}: laws() give ac.when(...) that sets nothing. Give set={{self.state: value}}, or look for it with `events` of a run."
            )
        numbers = {x[i].element_hash(): i for i in range(x.numel())}
        met: dict[int, str] = {}
        for key, new in setting.event.set.items():
            wanted = flat.named(key) if isinstance(key, str) else key
            self._check(wanted, setting)
            name = self._name(wanted)
            value = self._read(new, setting, f"the new value of {name}")
            if isinstance(wanted, Discrete):
                if value.numel() != 1:
                    raise ModelError(f"{setting.who}: the new value of {name} has {value.numel()} entries. Give one number.")
                found = [(x.numel() + flat.discretes.index(wanted), value, name)]
            else:
                found = list(self._state(wanted, value, setting, name, numbers))
            for target, one, word in found:
                if target in met:
                    raise ModelError(f"{setting.who}: {word} is set twice, as {met[target]} and as {name}.")
                met[target] = name
                yield target, one, word

    def _state(
        self, wanted: Expression, value: ca.SX, setting: Setting, name: str, numbers: dict[int, int]
    ) -> Iterator[tuple[int, ca.SX, str]]:
        """Of states themselves, or of what is linear in as many of them, velocities first."""
        column = ca.vec(ca.densify(self.space.put(self.outputs.resolve(wanted))))
        if value.numel() not in (1, column.numel()):
            raise ModelError(f"{setting.who}: {name} has {column.numel()} entries, its new value {value.numel()}.")
        value = ca.repmat(value, column.numel(), 1) if value.numel() == 1 else value
        whole = self.outputs.name(wanted) if isinstance(wanted, Symbol) else name
        entries = ca.vertsplit(column)
        places = [numbers.get(entry.element_hash()) if entry.is_symbolic() else None for entry in entries]
        if None in places:
            places, value = self._solved(column, value, setting, name)
        for k, place in enumerate(places):
            assert place is not None
            yield place, value[k], whole + (f"[{k}]" if len(places) > 1 else "")

    def _solved(self, column: ca.SX, value: ca.SX, setting: Setting, name: str) -> tuple[list[int | None], ca.SX]:
        x, nq = self.space.x, self.space.nq
        slopes = ca.jacobian(column, x)
        known = sorted(set(slopes.sparsity().get_col()))
        places = [i for i in known if i >= nq] or known
        own = x[places] if places else ca.SX(0, 1)
        J = ca.densify(slopes[:, places]) if places else ca.SX(column.numel(), 0)
        if len(places) != column.numel() or ca.depends_on(J, own):
            states = compact(self.outputs.system.flat.names[s] for s in self._settable())
            raise ModelError(
                f"{setting.who}: {name} cannot be set: it is no state, and does not tell which states would change. Set coordinates q or velocities v of "
                f"joints, states of scalar parts, or an ac.Discrete. This scene has: {states}."
            )
        return list(places), own + solved_by_qr(J, value - column)

    def _settable(self) -> list[Symbol]:
        s = self.outputs.system
        joints = [symbol for item in s.tree_joints for symbol in (item.edge.joint.q, item.edge.joint.v) if symbol.size]
        return [symbol for symbol in (*joints, *s.scalar_states, *s.flat.discretes) if symbol in s.flat.names]

    def _check(self, wanted: object, setting: Setting) -> None:
        """Raises `ModelError` for what is never set."""
        if isinstance(wanted, Parameter):
            what = f"{self.outputs.name(wanted)} is a parameter, which does not change along a motion. Use an ac.Discrete in its place"
        elif isinstance(wanted, Input) and not isinstance(wanted, Discrete):
            kind = "the rate of an input" if isinstance(wanted, InputRate) else "an input, which is given from outside"
            what = f"{self.outputs.name(wanted)} is {kind}. Use an ac.Discrete in its place"
        elif isinstance(wanted, Time):
            what = "time goes on by itself"
        elif isinstance(wanted, Discrete) and wanted not in self.outputs.system.flat.discretes:
            what = f"{wanted!r} belongs to no part of the scene. Keep it as an attribute: self.on = ac.Discrete()"
        elif not isinstance(wanted, Expression):
            what = f"{wanted!r} is no variable"
        else:
            return
        raise ModelError(f"{setting.who}: {what}.")

    def _read(self, value: Scalar | str, setting: Setting, what: str) -> ca.SX:
        try:
            given = self.outputs.system.flat.named(value) if isinstance(value, str) else value
            found = self.outputs.resolve(Expression(sx(given), leaves(given)))
        except (UnknownVariableError, ExpressionError) as error:
            raise ModelError(f"{setting.who}: {what} cannot be read. {error}") from error
        column = ca.vec(ca.densify(self.space.put(found)))
        constant = [float(entry) for entry in ca.vertsplit(column) if entry.is_constant()]
        if not np.isfinite(constant).all():
            raise ModelError(f"{setting.who}: {what} is {constant[0]:g}. Give a finite number.")
        return column

    def _name(self, wanted: Expression) -> str:
        return self.outputs.name(wanted) if isinstance(wanted, Symbol) else repr(wanted)
