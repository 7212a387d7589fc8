"""Functions of time and states at many points at once: what is read of a motion, and looked at after it."""

from __future__ import annotations

import ctypes
import functools
import time

import numpy as np

from acausal.errors import ExportError
from acausal.numerics.bound import BoundFunction, dense
from acausal.numerics.staged import Function, Staged, plain, systems_of
from acausal.runtime.kernels import How, Kernels, Wanted
from acausal.runtime.load import Runtime, runtime

_GLANCES, _SHORT = 2000, 300
"""Points at which CasADi has evaluated a function for what its program costs; instructions of functions whose program costs nothing much."""


class Series:
    """`function` (t, x, u, p) -> one column, at many points at once: by kernels of the runtime, or by CasADi where there is no runtime.

    The same bits for a point whichever others are asked for along with it. May be called by several threads.
    """

    def __init__(self, function: Function) -> None:
        self.function: Function = function if isinstance(function, Staged) else dense(function)
        self.rows = systems_of(function)[0].numel_out(0)
        self._sizes = tuple(function.size1_in(i) for i in (1, 2, 3))
        self._glanced = 0

    def __call__(self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Results (rows, n) at times (n,), states (nx, n), inputs (nu, n) and parameters (np,)."""
        found = np.empty((self.rows, t.size))
        if not found.size:
            return found
        if self._kernel is None:
            return self.by_casadi(t, x, u, p)
        library, kernels = self._kernel
        t, x, u, p = (np.ascontiguousarray(part, dtype=float) for part in (t, x, u, p))
        nx, nu, np_ = self._sizes
        if (x.size, u.size, p.size) != (nx * t.size, nu * t.size, np_):
            raise ValueError(f"series: {x.shape} states, {u.shape} inputs and {p.size} parameters do not fit {self.function}.")
        at = [part.ctypes.data for part in (p, t, x, u, found)]
        begun = time.thread_time()
        if library.columns(ctypes.byref(kernels.current[0]), nx, nu, np_, at[0], t.size, *at[1:]):
            raise MemoryError(f"{self.function.name()} at {t.size} points: not enough memory.")
        kernels.spent(time.thread_time() - begun)
        return found

    def glance(self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        """The same to rounding: long functions are left to CasADi until that has cost as much as making a program of them."""
        if self._glanced < 0:
            return self(t, x, u, p)
        self._glanced += t.size
        if isinstance(self.function, Staged) or self._glanced > _GLANCES or self.function.n_instructions() < _SHORT:
            self._glanced = -1
            return self(t, x, u, p)
        one = tuple(np.zeros(size) for size in (1, *self._sizes[:2]))
        bound = BoundFunction(self.function, (*one, np.ascontiguousarray(p, dtype=float)), np.empty(self.rows))
        found = np.empty((self.rows, t.size))
        for k in range(t.size):
            one[0][0], one[1][:], one[2][:] = t[k], x[:, k], u[:, k]
            found[:, k] = bound()
        return found

    def by_casadi(self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        """The same by CasADi's virtual machine."""
        repeated = np.repeat(p[:, None], t.size, axis=1)
        return np.array(plain(self.function)(t[None, :], x, u, repeated)).reshape(-1, t.size)

    @functools.cached_property
    def _kernel(self) -> tuple[ctypes.CDLL, Kernels] | None:
        try:
            library: Runtime | None = runtime()
            if library is None:
                return None
            return library.library, Kernels([Wanted("series", self.function, (3,))], library, How.AUTO, look=False)
        except ExportError:  # whoever integrates says what is wrong
            return None
