"""CasADi's symbols say at once that they are no matrices of numbers, by CasADi's own hook for that.

Whatever takes both is offered each symbol as numbers first: without the hook CasADi looks for arrays, sparse ones and sequences in it in turn,
by calls back into Python, which takes as long as all the rest of adding two symbols.
"""

from __future__ import annotations

import casadi as ca


def symbols_say_that_they_are_no_numbers() -> None:
    """From now on; what is made of them stays what it is."""
    for kind in (ca.SX, ca.MX):
        if not hasattr(kind, "__DM__"):
            setattr(kind, "__DM__", _none)  # noqa: B010  # stubs know it of numbers only


def _none(_: ca.SX | ca.MX) -> None:
    """What `__DM__` gives of what is no matrix of numbers."""
