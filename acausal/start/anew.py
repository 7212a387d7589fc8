"""Deciding anew: the reduction of a scene that holds for the parameters, the start and the time of a call."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from acausal.errors import AssemblyError, LockedError, MasslessError, ModelError
from acausal.loops.constraints import Constraints, analyse_constraints
from acausal.numerics.one_thread import on_one_thread
from acausal.outputs.functions import Functions
from acausal.outputs.outputs import Outputs
from acausal.reduce.reduce import ReducedSystem, reduce_system
from acausal.reduce.state_space import state_space, whole_state_space
from acausal.start.decided import OtherCircuit, OtherDecisions, OtherFreedoms
from acausal.wording import compact

T = TypeVar("T")
_KEPT = 32
"""Values of parameters for which a scene stays decided."""


class AbstractDecided(ABC):
    """Functions of a scene that hold for the values of its `system`, and what holds for others."""

    @property
    @abstractmethod
    def system(self) -> ReducedSystem:
        """As it was decided."""

    @property
    @abstractmethod
    def functions(self) -> Functions:
        """Of the states that are integrated."""

    @property
    @abstractmethod
    def whole(self) -> Functions:
        """The same functions of all coordinates of the tree, for analysis that chooses its own states."""

    @abstractmethod
    def at(self, p: np.ndarray) -> AbstractDecided:
        """For these values of all parameters (np,). Raises `LockedError`, `ParameterError`."""

    @abstractmethod
    def with_loops_at(self, p: np.ndarray) -> AbstractDecided:
        """The same, with the same states."""

    @abstractmethod
    def answer(self, p: np.ndarray, ask: Callable[[AbstractDecided], T]) -> T:
        """What `ask` says of the scene at these values."""


@dataclass(frozen=True, repr=False, eq=False)
class Decided(AbstractDecided):
    """A scene as it was decided when it was `reduced`; knows what holds for other values."""

    reduced: ReducedSystem

    def __reduce__(self) -> tuple[Any, ...]:
        return Decided, (self.reduced,)

    @property
    def system(self) -> ReducedSystem:
        """As it was decided."""
        return self.reduced

    @property
    def functions(self) -> Functions:
        """Of the states that a simulation carries."""
        return self._functions

    @functools.cached_property
    def _functions(self) -> Functions:
        return Functions(Outputs(self.system), state_space(self.system))

    @property
    def whole(self) -> Functions:
        """The same functions of all coordinates of the tree, for analysis that chooses its own states."""
        return self._whole

    @functools.cached_property
    def _whole(self) -> Functions:
        found = self.functions
        return found if not found.space.elimination.symbols else Functions(found.outputs, whole_state_space(self.system))

    def at(self, p: np.ndarray) -> Decided:
        """For these values of all parameters (np,): itself, unless what was decided at its own values does not hold at these.

        That are independent rows and singular positions of loops, pivots of scalar equations, what follows from what, and what is much
        for each unknown, where a value is many times another one. Raises `LockedError` where nothing can move with them, `ParameterError`
        where deciding anew does not help.
        """
        key = p.tobytes()
        found = self._last.get(key)
        if found is None:
            found = self._at(p)
            self._last.clear()
            self._last[key] = found
        return found

    @functools.cached_property
    def _last(self) -> dict[bytes, Decided]:
        """Of the values that were asked for last, what holds for them."""
        return {}

    def _at(self, p: np.ndarray) -> Decided:
        here = self._with_loops_at(p)
        decisions = here.functions.decisions
        if decisions.near(p) and decisions.hold(p):
            return here
        other = self._once("all", p, here._decided_at)
        other.functions.decisions.check(p)
        return other

    def with_loops_at(self, p: np.ndarray) -> Decided:
        """Itself, unless its loops have other independent rows or singular positions for these values: with the same states. Errors as for `at`.

        Costs a search for singular positions where the loops depend on parameters with values that are new.
        """
        here = self._with_loops_at(p)
        here.functions.decisions.check(p)
        return here

    def answer(self, p: np.ndarray, ask: Callable[[AbstractDecided], T]) -> T:
        """What `ask` says of the scene decided for these values. Where its loops are not what they were taken for at the call's own time and
        place, they are examined there, and asked again. Raises `OtherDecisions` where that does not help.
        """
        here = self.at(p)
        try:
            return ask(here)
        except OtherDecisions as found:
            place = found
        return ask(here._examined_near(place))

    def _with_loops_at(self, p: np.ndarray) -> Decided:
        constraints = self.system.constraints
        if constraints.unchanged(p):
            return self
        places = list(constraints.parameters)
        values = self.system.p_values.copy()
        values[places] = p[places]
        return self._once("loops", values, self._examined)

    @on_one_thread
    def _once(self, what: str, values: np.ndarray, make: Callable[[np.ndarray], Decided]) -> Decided:
        key = what, values.tobytes()
        if key not in self._others:
            if len(self._others) >= _KEPT:
                self._others.clear()
            self._others[key] = make(values)
        return self._others[key]

    @functools.cached_property
    def _others(self) -> dict[tuple[str, bytes], Decided]:
        """By what was decided, and for which values."""
        return {}

    def _examined(self, values: np.ndarray) -> Decided:
        s = self.system
        if s.constraints.hold(values):
            return self
        try:
            found = analyse_constraints(s.mechanics, s.p, values, known=s.constraints)
            return self if found.decides_as(s.constraints) else self._with(found, values)
        except AssemblyError:
            return self  # the search for a start says what does not close
        except (LockedError, MasslessError) as error:
            names = [self.functions.parameter_names[i] for i in s.constraints.parameters]
            raise type(error)(f"With other values of {compact(names)}: {error}") from None

    def _examined_near(self, place: OtherDecisions) -> Decided:
        s = self.system
        beside = place.beside if isinstance(place, OtherFreedoms) else None
        for other in self._circuits:
            c = other.system.constraints
            met = c.met(place.q) if beside is None else c.usual_at(beside, place.time, place.values)
            if c.unchanged(place.values) and met:
                return other
        try:
            found = analyse_constraints(s.mechanics, s.p, place.values, place.q, place.time, s.constraints, beside)
        except (AssemblyError, LockedError) as error:
            if isinstance(place, OtherCircuit):  # a start that is singular itself is told where it is judged
                s.constraints.learn(None)
                return self
            if isinstance(error, AssemblyError):
                raise place from None
            raise LockedError(f"At t = {place.time:.6g} s, where this begins: {error}") from None
        if found.decides_as(s.constraints) and not s.constraints.met(place.q):
            s.constraints.learn(found)
            return self
        other = self._once(f"loops {found.choice}", place.values, functools.partial(self._with, found))
        if not other.system.constraints.met(place.q):
            other.system.constraints.learn(found)
        if other not in self._circuits:
            self._circuits.append(other)
        return other

    @functools.cached_property
    def _circuits(self) -> list[Decided]:
        """Of motions that begin elsewhere."""
        return []

    def _with(self, constraints: Constraints, values: np.ndarray) -> Decided:
        return Decided(reduce_system(self.system.mechanics, at=values, constraints=constraints))

    def _decided_at(self, values: np.ndarray) -> Decided:
        """Itself, which says what does not hold, where reducing again does not help or leaves other freedoms."""
        s = self.system
        try:
            other = Decided(reduce_system(s.mechanics, at=values))
        except ModelError:
            return self
        same = other.system.x.numel() == s.x.numel() and other.system.degrees_of_freedom == s.degrees_of_freedom
        return other if same and not other.functions.decisions.complaint(values) else self
