"""Symbols of CasADi that stay the same symbols among themselves when what they are part of is pickled or copied.

CasADi pickles functions, not expressions, and its symbols are the same only as the same node. Here each symbol has an `Atom`, which is
pickled, or copied, once, however many expressions it is in; they are made anew from those of the atoms.
"""

from __future__ import annotations

import copy
import copyreg
from typing import Any
from weakref import WeakValueDictionary

import casadi as ca


class Atom:
    """A symbol (or a matrix of them); a copy of it is another symbol of the same name. `lasting`: what every copy is the same as, if anything."""

    __slots__ = ("__weakref__", "lasting", "name", "sx")

    def __init__(self, name: str, sx: ca.SX, lasting: str = "") -> None:
        self.name, self.sx, self.lasting = name, sx, lasting
        for i in range(sx.numel()):
            _ATOMS[sx[i].element_hash()] = self

    def __reduce__(self) -> tuple[Any, ...]:
        return (_lasting, (self.lasting,)) if self.lasting else (_new, (self.name, *self.sx.shape))


_ATOMS: WeakValueDictionary[int, Atom] = WeakValueDictionary()
"""By the entries of their symbols, which live as long."""


def _new(name: str, rows: int, columns: int) -> Atom:
    return Atom(name, ca.SX.sym(name, rows, columns))


def _lasting(name: str) -> Atom:
    return next(atom for atom in list(_ATOMS.values()) if atom.lasting == name)


def _atoms(expression: ca.SX) -> list[Atom]:
    """Of all symbols in an expression, those made by nobody here included."""
    found: dict[int, Atom] = {}
    for symbol in ca.symvar(expression):
        atom = _ATOMS.get(symbol.element_hash()) or Atom(symbol.name(), symbol)
        found[id(atom)] = atom
    return list(found.values())


def _put(function: ca.Function, atoms: list[Atom]) -> ca.SX:
    """What a function is at the symbols of atoms; a symbol itself stays one node with its atom's."""
    return function.call([atom.sx for atom in atoms])[0]


def _function(expression: ca.SX, atoms: list[Atom]) -> ca.Function:
    return ca.Function("expression", [atom.sx for atom in atoms], [expression], {"cse": False})


def _restored(text: str, *atoms: Atom) -> ca.SX:
    return _put(ca.Function.deserialize(text), list(atoms))


def _pickled(expression: ca.SX) -> tuple[Any, ...]:
    atoms = _atoms(expression)
    return _restored, (_function(expression, atoms).serialize(), *atoms)


def _copied(expression: ca.SX, memo: dict[int, Any]) -> ca.SX:
    known = [atom for atom in (_ATOMS.get(s.element_hash()) for s in ca.symvar(expression)) if atom is not None]
    if not known:
        return ca.SX(expression)
    atoms = _atoms(expression)
    return _put(_function(expression, atoms), [copy.deepcopy(a, memo) if a in known else a for a in atoms])


copyreg.pickle(ca.SX, _pickled)
# CasADi copies expressions with the symbols that they have, so that a copied scene would share those of the original
copy._deepcopy_dispatch[ca.SX] = _copied  # type: ignore[attr-defined]  # pyright: ignore
