"""The start of an exported simulator: assembled anew for other values, and checked where it is given."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from acausal.numerics.folding import folded_function
from acausal.outputs.functions import Functions
from acausal.reduce.holds import clearance
from acausal.start.assembly_function import assembled, row_lengths, start_units
from acausal.start.initial import InitialState

_HEAD = """\
/* Assembly of the start, in plain numbers, as CasADi writes it: compilers are to spare it their warnings. */
#pragma GCC system_header
#include <math.h>
#define CASADI_SYMBOL_EXPORT static __attribute__((unused))
#define CASADI_CODEGEN_PREFIX
#define CODEGEN_PREFIX {prefix}
#pragma GCC visibility push(hidden)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdangling-pointer"
"""
_TAIL = "\n#pragma GCC diagnostic pop\n#pragma GCC visibility pop\n"


@dataclass(frozen=True)
class StartFunctions:
    """`assembly`: data (start values, t0, u, p without constants) -> (x, constants of integration), NaN where there is no such start; `depends`:
    on which of the data. `gaps`: (t, x, u, p) -> how far positions and velocities are from closing, and how large the velocities are, without
    unit; None without constraints. `holds`: (t, x, u, p) -> not negative where what was decided holds. `clear`: (t, x, u, p) -> how far loops are from
    singular positions, of which they have none with the values that are exported; None where no parameter can bring them to any. `names`, `units`, `values`: of the start values.
    """

    assembly: ca.Function
    depends: tuple[bool, ...]
    gaps: ca.Function | None
    holds: ca.Function | None
    clear: ca.Function | None
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]


def start_functions(functions: Functions, initial: InitialState) -> StartFunctions:
    """Around the start that is exported."""
    account, space, s = initial.account, functions.space, functions.outputs.system
    data = ca.MX.sym("data", account.data.size)
    end = _places(functions, initial)[3]
    modes = slice(end - len(s.flat.modes), end)  # what is held at the start is what is so in the exported one
    remembered = ca.vertcat(data[: modes.start, :], ca.DM(account.data[modes]), data[end:, :])
    whole = assembled(initial, remembered)
    sources = ca.Function("constants", [s.t, s.x, s.p], [ca.densify(space.elimination.sources)])
    _, t, _, p = ca.vertsplit(data, _places(functions, initial))
    constants = sources(t, whole, p)
    x = space.restriction(whole)
    names = tuple(met.name + (f"[{k}]" if met.wanted.size > 1 else "") for met in initial.met for k in range(met.wanted.size))
    return StartFunctions(
        ca.Function("assembly", [data], [ca.densify(x), ca.densify(constants)]),
        _depends(functions, initial),
        _gaps(functions, initial),
        functions.holds,
        None if (clear := clearance(space)) is None else folded_function("clear", space.arguments, [ca.densify(clear)]),
        names,
        tuple(met.unit for met in initial.met for _ in range(met.wanted.size)),
        tuple(account.data[: len(names)].tolist()),
    )


def _depends(functions: Functions, initial: InitialState) -> tuple[bool, ...]:
    """Whether the start depends on each of the data: by what its searches are made of."""
    account, s = initial.account, functions.outputs.system
    places = _places(functions, initial)
    d = ca.SX.sym("data", places[-1])
    _, t, _, p = ca.vertsplit(d, places)
    found = np.arange(places[-1]) < places[1]
    used = [ca.substitute(functions.space.elimination.sources, ca.vertcat(s.t, s.p), ca.vertcat(t, p))]
    for search, moving in ((account.problem.positions, d), (account.problem.velocities, ca.vertcat(d, ca.SX.sym("q", s.nq)))):
        y, first = ca.SX.sym("y", search.guess.size), ca.SX.sym("first", search.guess.size)
        used += [] if search.residual is None else [search.residual(y, moving)]
        used += [] if search.wish is None else [search.wish(y, moving, first)]
        used += [] if search.side is None else [search.side(y, moving)]
    by = ca.jacobian_sparsity(ca.densify(ca.vertcat(*used)), d)
    found[sorted(set(by.get_col()))] = True
    return tuple(found.tolist())


def _places(functions: Functions, initial: InitialState) -> list[int]:
    """Where start values, t0, inputs and parameters begin among the data, and where they end."""
    s, end = functions.outputs.system, initial.account.data.size
    inputs = end - s.p.numel() - s.u.numel()
    return [0, inputs - 1, inputs, end - s.p.numel(), end]


def _gaps(functions: Functions, initial: InitialState) -> ca.Function | None:
    s, space, account = functions.outputs.system, functions.space, initial.account
    if not s.closing.numel() and not s.velocity_closing.numel():
        return None
    scale, scale_v = start_units(initial)
    q, v = s.x[: s.nq], s.x[s.nq :]
    slopes = ca.Function(
        "slopes", [s.t, s.x, s.u, s.p], [ca.densify(ca.jacobian(s.closing, q)), ca.densify(ca.jacobian(s.velocity_closing, v))]
    )
    whole = np.concatenate([account.positions.y, account.velocities.y])
    _, t, u, p = np.split(account.data, _places(functions, initial)[1:4])
    J, K = (np.array(part) for part in slopes(t, whole, u, p))
    positions = s.closing / ca.DM(row_lengths(J.reshape(s.closing.numel(), q.numel()) * scale, account.problem.positions))
    velocities = s.velocity_closing / ca.DM(
        row_lengths(K.reshape(s.velocity_closing.numel(), v.numel()) * scale_v, account.problem.velocities)
    )
    sizes = [ca.norm_2(ca.vertcat(ca.SX(0), column)) for column in (positions, velocities, v / ca.DM(scale_v))]
    result = space.put(ca.vertcat(*sizes)) if space.elimination.symbols else ca.vertcat(*sizes)
    return folded_function("gaps", space.arguments, [ca.densify(result)])


def start_c(start: StartFunctions, prefix: str) -> str:
    """A header with C of the functions; `prefix`: what names begin with that might be taken for those of others."""
    generator = ca.CodeGenerator("start", {"casadi_int": "long long int"})
    for function in (start.assembly, start.gaps, start.holds, start.clear):
        if function is not None:
            generator.add(function)
    with tempfile.TemporaryDirectory() as folder:
        made = generator.generate(f"{folder}/")
        return _HEAD.replace("{prefix}", prefix) + Path(made).read_text(encoding="utf-8") + _TAIL
