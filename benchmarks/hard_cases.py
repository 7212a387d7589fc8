"""Does the error follow the tolerance? Tables in Markdown for the motions of `tests/hard_cases.py`.

python -m benchmarks.hard_cases [name ...] [--long]
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass

from acausal.errors import AcausalError, SingularWarning
from benchmarks.one_core import one_core
from tests.hard_cases import CASES, HardCase, long_double_pendulum, long_kepler

TOLERANCES = tuple(float(f"1e-{n}") for n in range(4, 14))


@dataclass(frozen=True)
class Entry:
    """One run: error, steps, milliseconds; `method` as the integrator named it."""

    error: float
    steps: int
    milliseconds: float
    method: str


def entry(case: HardCase, rtol: float) -> Entry | None:
    """None if the run failed, or said that it went through a singular position and was far off."""
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            run = case.simulate(rtol, max_steps=100_000)
    except AcausalError:
        return None
    error, note = case.error(run), ""
    if any(issubclass(w.category, SingularWarning) for w in said):
        if not error < 1e-3:
            return None
        note = ", with a SingularWarning"
    return Entry(error, run.statistics.steps, 1e3 * run.statistics.seconds, run.statistics.method + note)


def number(value: float) -> str:
    """Two significant digits, short."""
    return f"{value:.2g}" if 0.01 <= value < 100 else f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")


def table(title: str, rows: dict[str, list[str]]) -> None:
    """Rows by name, a column for each tolerance."""
    print(f"\n{title}\n")
    print("| | " + " | ".join(f"{rtol:.0e}" for rtol in TOLERANCES) + " |")
    print("|---" * (len(TOLERANCES) + 1) + "|")
    for name, cells in rows.items():
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def short_runs(names: list[str]) -> None:
    """Three tables over all tolerances, and what each case is."""
    ratios: dict[str, list[str]] = {}
    errors: dict[str, list[str]] = {}
    costs: dict[str, list[str]] = {}
    print("| case | what is compared | magnification | methods |\n|---|---|---|---|")
    for name in names:
        case = CASES[name]()
        about = (CASES[name].__doc__ or "").strip()
        entries = [entry(case, rtol) for rtol in TOLERANCES]
        if None in entries:
            print(f"| {name} | {about} | not possible yet | |", flush=True)
            continue
        done = [e for e in entries if e is not None]
        methods = ", ".join(dict.fromkeys(e.method for e in done))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SingularWarning)
            factor = case.magnification
        print(f"| {name} | {about} | {number(factor)} | {methods} |", flush=True)
        ratios[name] = [number(e.error / (rtol * factor)) for e, rtol in zip(done, TOLERANCES, strict=True)]
        errors[name] = [number(e.error) for e in done]
        costs[name] = [f"{e.steps}, {e.milliseconds:.2g}" for e in done]
    table("error / (rtol * magnification); 1e-16 in place of rtol would be rounding", ratios)
    table("error", errors)
    table("steps, milliseconds", costs)


def long_runs(duration: float, revolutions: float) -> None:
    """Energy of fixed steps over a long time."""
    print("\n| long run | steps | s | largest change of energy | trend over the run | scatter | error of position |")
    print("|---|---|---|---|---|---|---|")
    began = time.perf_counter()
    d = long_double_pendulum(duration)
    print(
        f"| double pendulum, {duration:g} s | {d.steps} | {d.seconds:.1f} | {d.largest:.1e} | {d.trend:.1e} | {d.scatter:.1e} | |"
    )
    case, run, d = long_kepler(revolutions)
    print(
        f"| Kepler, eccentricity 0.9, {revolutions:g} revolutions | {d.steps} | {d.seconds:.1f} | {d.largest:.1e} | {d.trend:.1e} "
        f"| {d.scatter:.1e} | {case.error(run):.1e} |"
    )
    print(f"\n{time.perf_counter() - began:.0f} s in all")


def main() -> None:
    """Read the command line; measure on one core."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(CASES)}; all by default")
    parser.add_argument("--long", action="store_true", help="only the long runs, at full length")
    parser.add_argument("--duration", type=float, default=1e4, help="of the double pendulum [s]")
    parser.add_argument("--revolutions", type=float, default=1000, help="of the orbit")
    given = parser.parse_args()
    one_core()
    if given.long:
        long_runs(given.duration, given.revolutions)
    else:
        short_runs(given.names or list(CASES))


if __name__ == "__main__":
    main()
