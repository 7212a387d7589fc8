"""Values of parameters, inputs and start values from recordings of a motion."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from acausal.arguments import dictionary
from acausal.errors import AccuracyWarning, AssemblyError, OptionError, ParameterError, SimulationError, StartValueError
from acausal.language.expression import Expression, Input, Parameter
from acausal.outputs.expression_names import expression_name
from acausal.outputs.functions import Functions
from acausal.simulate.sensitivity import Sensitivities
from acausal.start.initial import exactly, near
from acausal.wording import counted

_LOST = (SimulationError, AssemblyError, StartValueError, ParameterError)
_FAR = 20
"""Standard deviations of chi squared, beyond which the model or the search is wrong and not the luck bad."""
_UNSEEN = 1e-6
"""Singular values of the data's slopes, each of length one, below which these depend on one another, beside the tolerance of the motion."""
_UNFELT = 1e-12
"""Of what others do to the data: less is rounding."""

_SETTLED = 1e-12
"""Of what chi squared is for each measured value that is left: what a step would gain, where no step is worth a motion; a millionth of standard errors."""
_PAUSE = 1e5
"""Times what data usually come apart: a pause that nobody means."""


class Sensitive(Protocol):
    """What is asked of a model."""

    @property
    def functions(self) -> Functions:
        """CasADi functions of the model."""
        ...

    @property
    def sensitivities(self) -> Callable[..., Sensitivities]:
        """Derivatives of its motion."""
        ...


@dataclass(frozen=True, eq=False)
class Recording:
    """One experiment. `data`: {expression: (times (m,) [s], values (m,) or (m, size), standard deviation of their noise)}; without the last one the noise
    is estimated from what is left over. NaN: missing. `start` and `inputs` as for `simulate`.
    """

    data: Mapping[Any, Any]
    start: Mapping[Any, Any] | None = None
    inputs: Mapping[Any, Any] | None = None


@dataclass(frozen=True, eq=False)
class Estimate:
    """What recordings say of `unknowns`: `values` (n,), their `covariance` (n, n), and of the fit `chi2` with `freedom` (measured values less unknowns):
    about equal where noise is as said and the model is right. `residuals` (m,): model less data, in standard deviations.
    `unseen` (k, n): changes of the unknowns, each of length 1 relative to the values, that no data sees. `missing`: values that were NaN.
    """

    unknowns: tuple[Expression, ...]
    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    chi2: float
    freedom: int
    residuals: np.ndarray
    unseen: np.ndarray
    missing: int
    evaluations: int

    def __getitem__(self, unknown: Expression | str) -> float:
        """The value of one unknown, by itself or its name."""
        return float(self.values[self._number(unknown)])

    def standard_error(self, unknown: Expression | str) -> float:
        """Of one unknown, in its own unit; infinite where the data do not see it."""
        k = self._number(unknown)
        return float(np.sqrt(self.covariance[k, k]))

    def _number(self, unknown: Expression | str) -> int:
        for k, (own, name) in enumerate(zip(self.unknowns, self.names, strict=True)):
            if own is unknown or name == unknown:
                return k
        raise OptionError(f"{unknown!r} was not estimated. Estimated were: {', '.join(self.names)}.")

    @functools.cached_property
    def correlation(self) -> np.ndarray:
        """(n, n), between -1 and 1."""
        size = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore"):
            return self.covariance / size / size[:, None]

    def __str__(self) -> str:
        errors = np.sqrt(np.diag(self.covariance))
        lines = [
            f"{name} = {value:.8g} +- {error:.2g}" for name, value, error in zip(self.names, self.values, errors, strict=True)
        ]
        lines.append(f"chi2 = {self.chi2:.4g} with {self.freedom} degrees of freedom")
        if self.missing:
            lines[-1] += f"; {counted(self.missing, 'value')} of {self.missing + self.residuals.size} missing"
        for direction in self.unseen:
            parts = [f"{share:+.2g} of {name}" for share, name in zip(direction, self.names, strict=True) if abs(share) > 1e-3]
            lines.append(f"no data sees this change: {', '.join(parts)}, each relative to its value")
        return "\n".join(lines)


def estimate(
    model: Sensitive,
    recordings: Mapping[Any, Any] | Recording | Sequence[Recording],
    unknowns: Sequence[Expression | str],
    start: Mapping[Any, Any] | None = None,
    *,
    inputs: Mapping[Any, Any] | None = None,
    parameters: Mapping[Any, float] | None = None,
    t0: float = 0.0,
    rtol: float = 1e-9,
) -> Estimate:
    """The values of `unknowns` with which the motion is nearest to what was recorded, by least squares in standard deviations of the noise.

    `recordings`: data of one experiment (see `Recording`), one or several. `unknowns`: parameters, constant inputs, and variables with a value in
    `start`, where the search begins too. Gauss-Newton with exact sensitivities in trust regions (scipy's `least_squares`). Raises `OptionError`, and the
    errors of `simulate` where not even the first motion can be made.
    """
    symbols = model.functions.outputs.system.flat.symbols
    wanted = [symbols({one: 0.0}) for one in unknowns]
    keys: list[Expression] = [next(iter(one)) for one in wanted]
    if not keys:
        raise OptionError(
            "estimate: nothing is unknown. Name parameters, inputs or start values: estimate(model, data, [scene.mass])."
        )
    if len(set(map(id, keys))) < len(keys):
        raise OptionError(f"estimate: something is unknown twice among {list(unknowns)}. Name each once.")
    if isinstance(recordings, Mapping):
        recordings = Recording(recordings, start, inputs)
    all_runs = [recordings] if isinstance(recordings, Recording) else list(recordings)
    runs = [_Run(model, one, keys, parameters or {}, t0, rtol) for one in all_runs]
    first = np.array([_begin(runs, key, parameters or {}, model.functions) for key in keys])
    if not any(np.isfinite(one.values).any() for run in runs for one in run.series):
        raise OptionError(
            "estimate: the recordings hold no finite value. Give data={scene.hinge.q: (times, values, standard deviation)}."
        )
    problem = _Fit(runs, first)
    names = tuple(expression_name(model.functions.outputs, k) for k in keys)
    found = problem.solved(tuple(keys), names)
    if all(run.noise_known for run in runs) and found.chi2 > found.freedom + _FAR * np.sqrt(2 * max(found.freedom, 1)):
        warnings.warn(
            f"The model is not near the data: chi2 is {found.chi2:.4g} with {found.freedom} degrees of freedom, where the noise that was said allows about "
            f"{found.freedom} +- {np.sqrt(2 * max(found.freedom, 1)):.2g}. Standard errors mean nothing then. Begin nearer, free what else is not known, or look at residuals.",
            AccuracyWarning,
            stacklevel=2,
        )
    return found


def _begin(runs: list[_Run], key: Expression, parameters: Mapping[Any, float], functions: Functions) -> float:
    system = functions.outputs.system
    if isinstance(key, Parameter):
        given = system.flat.symbols(parameters)
        return float(given.get(key, system.p_values[system.flat.parameters.index(key)]))
    values: list[Any] = [run.inputs.get(key, 0.0) if isinstance(key, Input) else run.start.get(key) for run in runs]
    found: Any = next((v.value if isinstance(v, near | exactly) else v for v in values if v is not None), None)
    if found is None or np.size(found) != 1:
        raise OptionError(
            f"estimate: {key!r} is no parameter and no input, and has no single start value; give one where the search begins."
        )
    return float(np.asarray(found).item())


class _Run:
    """One recording: its residuals and their slopes for values of the unknowns."""

    def __init__(
        self,
        model: Sensitive,
        recording: Recording,
        keys: list[Expression],
        parameters: Mapping[Any, float],
        t0: float,
        rtol: float,
    ) -> None:
        symbols = model.functions.outputs.system.flat.symbols
        self.model, self.keys, self.t0, self.rtol = model, keys, t0, rtol
        self.start = dict(symbols(dictionary(recording.start or {}, "start", "{scene.hinge.q: 0.3}")))
        self.inputs = dict(symbols(dictionary(recording.inputs or {}, "inputs", "{scene.force: 1.0}")))
        self.parameters = dict(symbols(parameters))
        self.series = [
            _series(model.functions, key, value, t0)
            for key, value in symbols(dictionary(recording.data, "data", "{scene.hinge.q: (times, values, 0.01)}")).items()
        ]
        self.times = np.unique(np.concatenate([[t0], *(one.times for one in self.series)]))
        self.noise_known = all(one.noise_known for one in self.series)

    def residuals(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(m,) and (m, n)."""
        start, inputs, parameters = dict(self.start), dict(self.inputs), dict(self.parameters)
        for key, value in zip(self.keys, values.tolist(), strict=True):
            (parameters if isinstance(key, Parameter) else inputs if isinstance(key, Input) else start)[key] = value
        found = self.model.sensitivities(self.times, self.keys, start, inputs=inputs, parameters=parameters, rtol=self.rtol)
        rows: list[np.ndarray] = []
        slopes: list[np.ndarray] = []
        for one in self.series:
            y, total = found.total_derivative(one.wanted)
            at = np.searchsorted(self.times, one.times)
            off, known = (y.T[at] - one.values) / one.noise, np.isfinite(one.values)
            rows.append(off[known])
            slopes.append((total[at] / one.noise[:, :, None])[known])
        return np.concatenate(rows), np.concatenate(slopes)


@dataclass(frozen=True, eq=False)
class _Series:
    """Of one expression: `times` (m,), `values` and `noise` (m, size)."""

    wanted: Expression
    times: np.ndarray
    values: np.ndarray
    noise: np.ndarray
    noise_known: bool


def _series(functions: Functions, wanted: Expression, given: Any, t0: float) -> _Series:
    name = expression_name(functions.outputs, wanted)
    if not isinstance(given, tuple) or len(given) not in (2, 3):  # pyright: ignore[reportUnknownArgumentType]
        raise OptionError(f"The data of {name} must be (times, values) or (times, values, standard deviation).")
    try:
        parts = [np.asarray(part, dtype=float) for part in given]  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
    except (TypeError, ValueError, OverflowError):
        raise OptionError(f"The data of {name} are not numbers.") from None
    times, values = parts[0].ravel(), parts[1]
    size = functions.outputs.resolve(wanted).numel()
    if values.size != times.size * size:
        raise OptionError(f"The data of {name}: {times.size} times need {times.size * size} values, not {values.size}.")
    if not np.all(np.isfinite(times)) or np.any(times < t0):
        raise OptionError(f"The data of {name} have times that are not finite, or before the start at {t0:g} s.")
    _check_gaps(name, times)
    values = values.reshape(times.size, size)
    noise = parts[2] if len(parts) == 3 else np.array(1.0)
    if np.isinf(values).any():
        raise OptionError(f"The data of {name} are infinite somewhere. What is missing is NaN.")
    if not np.all((noise > 0) & np.isfinite(noise)):
        raise OptionError(f"The standard deviation of {name} must be positive and finite. What is missing is NaN in the values.")
    whole = np.broadcast_to(noise.reshape(times.size, -1) if noise.size > 1 else noise, values.shape)
    return _Series(wanted, times, values, np.array(whole), len(parts) == 3)


def _check_gaps(name: str, times: np.ndarray) -> None:
    """Of times (m,) those that are far from all others: no motion goes on for so long."""
    apart = np.diff(np.unique(times))
    if apart.size > 1 and np.max(apart) > _PAUSE * np.median(apart):
        k = int(np.argmax(apart))
        raise OptionError(
            f"The data of {name} come {np.median(apart):.3g} s apart, but then {apart[k]:.3g} s, after {np.unique(times)[k]:.6g} s. Is one of the times in another unit? "
            "Recordings with such a pause are two: estimate(model, [ac.Recording(...), ac.Recording(...)], ...)."
        )


class _SettledAt(Exception):
    """The search is at its end, with these `values`."""

    def __init__(self, values: np.ndarray) -> None:
        super().__init__()
        self.values = values


class _Fit:
    """All recordings together."""

    def __init__(self, runs: list[_Run], first: np.ndarray) -> None:
        self.runs, self.first = runs, first
        self.evaluations, self._least = 0, np.inf
        self._known: tuple[bytes, np.ndarray, np.ndarray] | None = None

    def _both(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._known is None or self._known[0] != values.tobytes():
            self.evaluations += 1
            before = self._known
            try:
                pairs = [run.residuals(values) for run in self.runs]
                self._known = values.tobytes(), np.concatenate([r for r, _ in pairs]), np.concatenate([s for _, s in pairs])
            except _LOST:
                if before is None:
                    raise
                self._known = values.tobytes(), 10 * before[1], before[2]  # no motion there: the step is refused
        return self._known[1], self._known[2]

    def _rows(self, values: np.ndarray) -> np.ndarray:
        """Residuals. Raises `_SettledAt` where no step would gain anything: steps that are refused by rounding alone cost a motion each."""
        rows, slopes = self._both(values)
        chi2, freedom = float(rows @ rows), max(1, rows.size - values.size)
        if chi2 <= self._least:
            self._least = chi2
            effect = np.linalg.norm(slopes, axis=0)
            U, s, _ = np.linalg.svd(slopes / np.where(effect > 0, effect, 1.0), full_matrices=False)
            gain = float(np.sum((U[:, s > _UNSEEN].T @ rows) ** 2))
            if gain <= _SETTLED * chi2 / freedom:
                raise _SettledAt(values.copy())
        return rows

    def solved(self, unknowns: tuple[Expression, ...], names: tuple[str, ...]) -> Estimate:
        """The least squares."""
        import scipy.optimize

        fit: Any = scipy.optimize.least_squares  # its stub knows no slopes as a function
        try:
            found = fit(self._rows, self.first, lambda v: self._both(v)[1], x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-14)
            values = np.asarray(found.x)
        except _SettledAt as settled:
            values = settled.values
        rows, slopes = self._both(values)
        size, felt = self._sizes(values, slopes)
        _, s, V = np.linalg.svd(np.linalg.qr(np.where(felt, slopes * size, 0.0), mode="r"))
        s = np.append(s, np.zeros(values.size - s.size))
        seen = s > _UNSEEN
        chi2, freedom = float(rows @ rows), rows.size - int(seen.sum())
        spread = 1.0 if all(run.noise_known for run in self.runs) else chi2 / max(1, freedom)
        weights = np.where(seen, 1.0 / np.where(seen, s, 1.0) ** 2, 0.0)
        covariance = spread * (V.T * weights) @ V * size * size[:, None]
        touched = np.any(np.abs(V[~seen]) > 1e-3, axis=0)
        covariance[touched, touched] = np.inf
        unseen = V[~seen] * size / np.fmax(np.abs(values), size)
        unseen /= np.linalg.norm(unseen, axis=1, keepdims=True)
        missing = sum(int(np.isnan(one.values).sum()) for run in self.runs for one in run.series)
        return Estimate(unknowns, names, values, covariance, chi2, freedom, rows, unseen, missing, self.evaluations)

    def _sizes(self, values: np.ndarray, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By how much each unknown changes all data together by one standard deviation (n,), also one that is zero; and which do so at all, beside what
        others do: the sizes of the rest are their values."""
        effect, own = np.linalg.norm(slopes, axis=0), np.fmax(np.abs(values), np.abs(self.first))
        felt = (effect > 0) & ((own == 0) | (effect * own > _UNFELT * np.max(effect * own, initial=0.0)))
        return np.where(felt, 1.0 / np.where(felt, effect, 1.0), np.where(own > 0, own, 1.0)), felt
