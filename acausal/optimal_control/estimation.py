"""Values of parameters, inputs and start values from recordings of a motion."""

from __future__ import annotations

import copy
import functools
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from acausal.arguments import dictionary, listed
from acausal.errors import AccuracyWarning, AssemblyError, OptionError, ParameterError, SimulationError, StartValueError
from acausal.language.expression import Expression, Input, Parameter
from acausal.optimal_control.language import free
from acausal.optimal_control.least_squares import LEFT, Fit, Noise, Seen
from acausal.outputs.expression_names import expression_name
from acausal.outputs.functions import Functions
from acausal.simulate.sensitivity import Sensitivities
from acausal.start.initial import exactly, near
from acausal.wording import counted

_LOST = (SimulationError, AssemblyError, StartValueError, ParameterError)
_FAR = 20
"""Standard deviations of chi squared, beyond which the model or the search is wrong and not the luck bad."""
_LITTLE, _HALVES, _MANY = 0.1, 6, 2
"""Of what data vary by: what is left of them where the search has not lost its way; how often recordings are halved to begin with; and values for each unknown, that a beginning has at least."""
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
    """One experiment. `data`: {expression: (times (m,) [s], values (m,) or (m, size), standard deviation of their noise)}; the last one is a number, or one for each
    entry, each time, or each value; without it the noise of that expression is estimated from what is left over of it in all recordings. NaN: missing.
    `start` and `inputs` as for `simulate`; what is not said there is that of `estimate`.
    """

    data: Mapping[Any, Any]
    start: Mapping[Any, Any] | None = None
    inputs: Mapping[Any, Any] | None = None


@dataclass(frozen=True, eq=False)
class Estimate:
    """What recordings say of `unknowns`: `values` (n,), their `covariance` (n, n), and of the fit `chi2` with `freedom` (measured values less unknowns):
    about equal where noise is as said and the model is right. `residuals` (m,): model less data, in standard deviations. `noise`: those that nobody said, by
    names of what was measured.
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
    noise: Mapping[str, float]

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
        lines += [
            f"noise of {name}: {value:.3g}, by what is left of it" for name, value in self.noise.items() if np.isfinite(value)
        ]
        if self.noise and not self.freedom:
            lines.append("no value is left to tell the noise: give standard deviations, (times, values, standard deviation)")
        for direction in self.unseen:
            parts = [f"{share:+.2g} of {name}" for share, name in zip(direction, self.names, strict=True) if abs(share) > 1e-3]
            lines.append(f"no data sees this change: {', '.join(parts)}, each relative to its value")
        return "\n".join(lines)


def estimate(
    model: Sensitive,
    recordings: Mapping[Any, Any] | Recording | Sequence[Mapping[Any, Any] | Recording],
    unknowns: Sequence[Expression | str] | Expression | str,
    start: Mapping[Any, Any] | None = None,
    *,
    inputs: Mapping[Any, Any] | None = None,
    parameters: Mapping[Any, float] | None = None,
    t0: float = 0.0,
    rtol: float = 1e-9,
) -> Estimate:
    """The values of `unknowns` with which the motion is nearest to what was recorded, by least squares in standard deviations of the noise.

    `recordings`: data of one experiment (see `Recording`), one or several. `unknowns`: parameters, constant inputs, and variables with a value in
    `start`, where the search begins too. Gauss-Newton with exact sensitivities in trust regions, from beginnings of the recordings on where all of them at once lead nowhere; noise that was not said by restricted maximum likelihood, of each measured
    expression by itself. Raises `OptionError`, and the errors of `simulate` where not even the first motion can be made.
    """
    symbols = model.functions.outputs.system.flat.symbols
    wanted = [symbols({one: 0.0}) for one in ([unknowns] if isinstance(unknowns, Expression | str) else unknowns)]
    keys: list[Expression] = [next(iter(one)) for one in wanted]
    if not keys:
        raise OptionError(
            "estimate: nothing is unknown. Name parameters, inputs or start values: estimate(model, data, [scene.mass])."
        )
    if len(set(map(id, keys))) < len(keys):
        raise OptionError(f"estimate: something is unknown twice among {list(unknowns)}. Name each once.")
    single = isinstance(recordings, Mapping | Recording)
    all_runs = (
        [recordings]
        if single
        else listed(recordings, "estimate: the recordings", "[ac.Recording({scene.hinge.q: (times, values, 0.01)})]")
    )
    runs = [_Run(model, _recording(one, start, inputs), keys, parameters or {}, t0, rtol) for one in all_runs]
    first = np.array([_begin(runs, key, parameters or {}, model.functions) for key in keys])
    if not any(np.isfinite(one.values).any() for run in runs for one in run.series):
        raise OptionError(
            "estimate: the recordings hold no finite value. Give data={scene.hinge.q: (times, values, standard deviation)}."
        )
    fit, found, series, groups = _fitted(runs, first, rtol)
    if _is_lost(fit, series):
        fit, found, series, groups = _from_beginnings(runs, (fit, found, series, groups), rtol)
    names = tuple(expression_name(model.functions.outputs, k) for k in keys)
    return _estimate(fit, found, tuple(keys), names, series, groups)


_Fitted = tuple[Fit, np.ndarray, list["_Series"], list[str]]


def _fitted(runs: Sequence[_Run], first: np.ndarray, rtol: float, known: bool = False) -> _Fitted:
    """The nearest motions from these values on, noise of groups of data, all series, and the groups: names of what nobody said the noise of. `known`: the first values, to as much as they
    are, where data hardly tell.
    """
    series = [one for run in runs for one in run.series]
    groups = list(dict.fromkeys(one.name for one in series if not one.noise_known))
    noise, sized = _noise(series, groups, rtol), np.flatnonzero(first) if known else np.array([], dtype=int)
    if sized.size:
        more = np.ones(sized.size)
        noise = replace(noise, said=np.append(noise.said, more), groups=np.append(noise.groups, -more.astype(int)))
    fit = Fit(_Runs(runs, sized, first), first, noise)
    return fit, fit.solved(), series, groups


def _is_lost(fit: Fit, series: Sequence[_Series]) -> bool:
    """Whether what is left of something measured is much of what it varies by."""
    at = 0
    for one in series:
        values = one.values[np.isfinite(one.values)]
        rows, at = fit.seen[0][at : at + values.size], at + values.size
        if values.size and np.linalg.norm(rows) > _LITTLE * np.linalg.norm(values - values.mean()):
            return True
    return False


def _from_beginnings(runs: Sequence[_Run], lost: _Fitted, rtol: float) -> _Fitted:
    """The same, if that is nearer: from what beginnings of the recordings say, each twice as long as the one before and from its values. A motion that small errors change much is
    followed so from its start on, where all of it at once leads nowhere.
    """
    first, found = lost[0], lost[1]
    values, motions = first.first, first.evaluations
    for share in 0.5 ** np.arange(_HALVES, 0, -1):
        begun = [run.until(share) for run in runs]
        if sum(int(np.isfinite(one.values).sum()) for run in begun for one in run.series) < _MANY * values.size:
            continue
        try:
            fit = _fitted(begun, values, rtol, known=True)[0]
        except _LOST:
            return lost
        values, motions = fit.values, motions + fit.evaluations
    try:
        again = _fitted(runs, values, rtol)
    except _LOST:
        return lost
    fit, noise = again[0], first.noise.of(found)
    motions += fit.evaluations
    nearer = again if np.linalg.norm(fit.seen[0] / noise) < np.linalg.norm(first.seen[0] / noise) else lost
    nearer[0].evaluations = motions
    return nearer


def _recording(given: Any, start: Mapping[Any, Any] | None, inputs: Mapping[Any, Any] | None) -> Recording:
    """With what is said for all of them, where it says nothing itself."""
    if isinstance(given, Mapping):
        return Recording(given, start, inputs)  # pyright: ignore[reportUnknownArgumentType]
    if not isinstance(given, Recording):
        raise OptionError(
            f"estimate: {given!r} is no recording. Give ac.Recording({{scene.hinge.q: (times, values, 0.01)}}, start, inputs)."
        )
    return replace(given, start={**(start or {}), **(given.start or {})}, inputs={**(inputs or {}), **(given.inputs or {})})


def _noise(series: Sequence[_Series], groups: Sequence[str], rtol: float) -> Noise:
    """Of all values that are not missing; what nobody said is no less than what the motion is off by."""
    number = {name: k for k, name in enumerate(groups)}
    known = [np.isfinite(one.values) for one in series]
    said = [one.noise[there] for one, there in zip(series, known, strict=True)]
    of = [
        np.full(int(there.sum()), -1 if one.noise_known else number[one.name]) for one, there in zip(series, known, strict=True)
    ]
    least = np.zeros(len(groups))
    for one, there in zip(series, known, strict=True):
        if not one.noise_known:
            least[number[one.name]] = max(least[number[one.name]], rtol * np.max(np.abs(one.values[there]), initial=0.0))
    return Noise(np.concatenate(said), np.concatenate(of), np.where(least > 0, least, np.finfo(float).tiny ** 0.5))


def _estimate(
    fit: Fit,
    found: np.ndarray,
    keys: tuple[Expression, ...],
    names: tuple[str, ...],
    series: Sequence[_Series],
    groups: Sequence[str],
) -> Estimate:
    """What is told of a fit with this noise of groups (groups,). Raises `OptionError` where noise cannot be told; warns where the model is not near."""
    rows, noise, used = fit.seen[0], fit.noise, fit.used(found)
    covariance, unseen = fit.covariance(found)
    freedom = rows.size - (len(keys) - len(unseen))
    _, left = noise.left(rows, used)
    if freedom > 0 and len(groups) + (np.min(noise.groups) < 0) > 1 and np.any(left < LEFT):
        k = int(np.argmin(left))
        raise OptionError(
            f"The noise of {groups[k]} cannot be told: the unknowns use up all but {max(left[k], 0.0):.2g} of its {int(np.sum(noise.groups == k))} values. "
            "Give its standard deviation: (times, values, standard deviation)."
        )
    if freedom <= 0 and groups:
        covariance = np.full_like(covariance, np.inf)
    off = rows / noise.of(found)
    chi2, missing = float(off @ off), sum(int(np.isnan(one.values).sum()) for one in series)
    told = dict(zip(groups, found.tolist(), strict=True)) if freedom > 0 else dict.fromkeys(groups, float("nan"))
    said = noise.groups < 0
    sure, rest = float(off[said] @ off[said]), float(np.sum(1.0 - used[said]))
    if said.any() and sure > rest + _FAR * np.sqrt(2 * max(rest, 1)):
        warnings.warn(
            f"The model is not near the data: chi2 is {sure:.4g} with {rest:.4g} degrees of freedom, where the noise that was said allows about "
            f"{rest:.4g} +- {np.sqrt(2 * max(rest, 1)):.2g}. Standard errors mean nothing then. Begin nearer, free what else is not known, or look at residuals.",
            AccuracyWarning,
            stacklevel=3,
        )
    return Estimate(keys, names, fit.values, covariance, chi2, freedom, off, unseen, missing, fit.evaluations, told)


def _begin(runs: list[_Run], key: Expression, parameters: Mapping[Any, float], functions: Functions) -> float:
    system = functions.outputs.system
    if isinstance(key, Parameter):
        given = system.flat.symbols(parameters)
        return float(given.get(key, system.p_values[system.flat.parameters.index(key)]))
    values: list[Any] = [run.inputs.get(key, 0.0) if isinstance(key, Input) else run.start.get(key) for run in runs]
    found: Any = next((v.value if isinstance(v, near | exactly) else v for v in values if v is not None), None)
    if isinstance(found, free):
        raise OptionError(
            f"estimate: the start value of {key!r} is {found!r}. Give the number where the search begins; that it is unknown is said already."
        )
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

    def until(self, share: float) -> _Run:
        """The same, of the beginning alone."""
        end = self.t0 + share * (self.times[-1] - self.t0)
        begun = copy.copy(self)
        cut = [(one, one.times <= end) for one in self.series]
        begun.series = [
            replace(one, times=one.times[there], values=one.values[there], noise=one.noise[there])
            for one, there in cut
            if there.any()
        ]
        begun.times = np.unique(np.concatenate([[self.t0], *(one.times for one in begun.series)]))
        return begun

    def residuals(self, values: np.ndarray) -> Seen:
        """Model less data, and its slopes."""
        start, inputs, parameters = dict(self.start), dict(self.inputs), dict(self.parameters)
        for key, value in zip(self.keys, values.tolist(), strict=True):
            (parameters if isinstance(key, Parameter) else inputs if isinstance(key, Input) else start)[key] = value
        found = self.model.sensitivities(self.times, self.keys, start, inputs=inputs, parameters=parameters, rtol=self.rtol)
        rows: list[np.ndarray] = []
        slopes: list[np.ndarray] = []
        for one in self.series:
            y, total = found.total_derivative(one.wanted)
            at = np.searchsorted(self.times, one.times)
            known = np.isfinite(one.values)
            rows.append((y.T[at] - one.values)[known])
            slopes.append(total[at][known])
        return np.concatenate(rows), np.concatenate(slopes)


@dataclass(frozen=True, eq=False)
class _Series:
    """Of one expression, by its name: `times` (m,), `values` and `noise` (m, size)."""

    wanted: Expression
    name: str
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
    m = times.size
    fits = values.size == m * size and (values.ndim < 2 or values.shape == (m, size) or 1 in (m, size))
    if not fits:
        turned = " They stand in columns: turn them, values.T." if values.shape == (size, m) else ""
        raise OptionError(
            f"The data of {name}: {m} times need {m * size} values, an array {(m, size) if size > 1 else (m,)}, not {values.shape}.{turned}"
        )
    if not np.all(np.isfinite(times)) or np.any(times < t0):
        raise OptionError(f"The data of {name} have times that are not finite, or before the start at {t0:g} s.")
    _check_gaps(name, times)
    values = values.reshape(m, size)
    noise = parts[2] if len(parts) == 3 else np.array(1.0)
    if np.isinf(values).any():
        raise OptionError(f"The data of {name} are infinite somewhere. What is missing is NaN.")
    if not np.all((noise > 0) & np.isfinite(noise)):
        raise OptionError(f"The standard deviation of {name} must be positive and finite. What is missing is NaN in the values.")
    return _Series(wanted, name, times, values, _spread(name, noise, m, size), len(parts) == 3)


def _spread(name: str, noise: np.ndarray, m: int, size: int) -> np.ndarray:
    """(m, size), of a number, one for each entry, one for each time, or one for each value."""
    for shape in ((m, size), (1, size), (m, 1)):
        if noise.size == 1 or noise.shape == shape or (noise.ndim == 1 and noise.size == np.prod(shape)):
            return np.array(np.broadcast_to(noise if noise.size == 1 else noise.reshape(shape), (m, size)))
    raise OptionError(
        f"The standard deviation of {name} is an array {noise.shape}. Give a number, one for each of its {size} entries, or one for each of its {m} times."
    )


def _check_gaps(name: str, times: np.ndarray) -> None:
    """Of times (m,) those that are far from all others: no motion goes on for so long."""
    apart = np.diff(np.unique(times))
    if apart.size > 1 and np.max(apart) > _PAUSE * np.median(apart):
        k = int(np.argmax(apart))
        raise OptionError(
            f"The data of {name} come {np.median(apart):.3g} s apart, but then {apart[k]:.3g} s, after {np.unique(times)[k]:.6g} s. Is one of the times in another unit? "
            "Recordings with such a pause are two: estimate(model, [ac.Recording(...), ac.Recording(...)], ...)."
        )


class _Runs:
    """All recordings together; None where there is no such motion, but for the first values."""

    def __init__(self, runs: Sequence[_Run], sized: np.ndarray, first: np.ndarray) -> None:
        """`sized`: which values are `first` as well, to as much as these are."""
        self._runs, self._begun = runs, False
        self._sized, self._first = sized, first

    def __call__(self, values: np.ndarray) -> Seen | None:
        try:
            pairs = [run.residuals(values) for run in self._runs]
        except _LOST:
            if not self._begun:
                raise
            return None
        self._begun = True
        near, own = self._first[self._sized], np.eye(values.size)[self._sized]
        pairs.append((values[self._sized] / near - 1, own / near[:, None]))
        return np.concatenate([r for r, _ in pairs]), np.concatenate([s for _, s in pairs])
