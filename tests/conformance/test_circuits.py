"""Random circuits against nodal analysis: E x' = A x + b + c t in all potentials and currents, by its own integrator, at any values of parameters.

The law holds for networks of resistors, coils, capacitors, sources, ideal transformers and gyrators, whatever loops and cut sets they form: the
number of states is the degree of det(s E - A), the motion is that of the equations, and what has no solution is refused.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import acausal as ac
from acausal.errors import AcausalError
from components import Capacitor, CurrentSource, Ground, Inductor, Resistor, VoltageSource
from tests.pairings import each_value

_SLOPES = {"V": 0.3, "I": 0.2}


class TwoPort(ac.Component):
    """Ideal transformer, v1 = ratio v2 and i2 = -ratio i1, or gyrator, v1 = ratio i2 and v2 = -ratio i1."""

    a, b, c, d = (ac.Electrical.port() for _ in range(4))
    i1, i2, v1, v2 = ac.Variable("A"), ac.Variable("A"), ac.Variable("V"), ac.Variable("V")

    def __init__(self, ratio: ac.Parameter, gyrates: bool) -> None:
        self.ratio, self.gyrates = ratio, gyrates

    def equations(self):
        yield ac.equal(self.v1, self.a.v - self.b.v)
        yield ac.equal(self.v2, self.c.v - self.d.v)
        for pin, current in ((self.a, self.i1), (self.b, -self.i1), (self.c, self.i2), (self.d, -self.i2)):
            yield ac.equal(pin.i, current)
        yield ac.equal(self.v1, self.ratio * (self.i2 if self.gyrates else self.v2))
        yield ac.equal(self.v2 if self.gyrates else self.i2, -self.ratio * self.i1)


@dataclass(frozen=True)
class Circuit:
    """Parts by their letters, with the nodes of their pins, two or four each; node 0 is the ground."""

    kinds: str
    pins: tuple[tuple[int, ...], ...]
    nodes: int

    @staticmethod
    def random(rng: np.random.Generator) -> Circuit:
        """Every pin is connected to another."""
        while True:
            nodes = int(rng.integers(2, 6))
            kinds = "".join(rng.choice(list("RRRLLCCVITG"), int(rng.integers(nodes, nodes + 5))))
            pins = tuple(
                tuple(int(n) for k in range(1 + (kind in "TG")) for n in rng.choice(nodes, 2, replace=False)) for kind in kinds
            )
            uses = Counter(n for own in pins for n in own)
            if all(uses[n] + (n == 0) > 1 for n in range(nodes)):
                return Circuit(kinds, pins, nodes)

    def scene(self, values: np.ndarray, changing: bool = True) -> tuple[ac.System, list[ac.Parameter], list[ac.Expression]]:
        """The scene, its parameters, and the expressions of x."""
        scene, p = ac.System(), [ac.Parameter(float(v)) for v in values]
        groups: list[list[ac.Connector]] = [[] for _ in range(self.nodes)]
        scene.ground, scene.elements, currents = Ground(), [], []
        groups[0].append(scene.ground.pin)
        for kind, pins, size in zip(self.kinds, self.pins, p, strict=True):
            if kind in "TG":
                part = TwoPort(size, kind == "G")
                ends, own = (part.a, part.b, part.c, part.d), [part.i1, part.i2]
            else:
                given = size * (1 + _SLOPES[kind] * ac.time) if kind in "VI" and changing else size
                part = {"R": Resistor, "L": Inductor, "C": Capacitor, "V": VoltageSource, "I": CurrentSource}[kind](given)
                ends, own = (part.pin_a, part.pin_b), [part.i]
            scene.elements.append(part)
            currents += own
            for end, node in zip(ends, pins, strict=True):
                groups[node].append(end)
        for group in groups:
            scene.connect(*group)
        return scene, p, [group[0].v for group in groups[1:]] + currents

    def descriptor(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """E, A, b, c."""
        first, n = np.cumsum([0, *(len(own) // 2 for own in self.pins)]), self.nodes - 1
        size = n + int(first[-1])
        E, A, b, c = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size), np.zeros(size)
        for kind, pins, k, value in zip(self.kinds, self.pins, first[:-1] + n, values, strict=True):
            U = np.zeros((len(pins) // 2, size))
            for j, (plus, minus) in enumerate(zip(pins[::2], pins[1::2], strict=True)):
                U[j, :n] = np.eye(self.nodes)[plus, 1:] - np.eye(self.nodes)[minus, 1:]
                A[:n, k + j] = U[j, :n]
            I = np.eye(size)[k : k + 2]  # noqa: E741
            if kind == "C":
                E[k], A[k] = value * U[0], I[0]
            elif kind == "L":
                E[k], A[k] = value * I[0], U[0]
            elif kind in "VI":
                A[k], b[k] = (U[0], -value) if kind == "V" else (I[0], value)
                c[k] = _SLOPES[kind] * b[k]
            elif kind == "R":
                A[k] = U[0] - value * I[0]
            else:
                A[k] = U[0] - value * (U[1] if kind == "T" else I[1])
                A[k + 1] = (I[1] if kind == "T" else U[1]) + value * I[0]
        return E, A, b, c


def degree(E: np.ndarray, A: np.ndarray) -> int | None:
    """Of det(s E - A) in s; None where it is zero."""
    for s in (0.7 + 0.3j, 1.3 - 0.8j):
        M = s * E - A
        M = M / np.maximum(np.abs(M).max(axis=1, keepdims=True), 1e-300)
        M = M / np.maximum(np.abs(M).max(axis=0, keepdims=True), 1e-300)
        if np.linalg.matrix_rank(M, tol=1e-10) < len(M):
            return None
    small, large = (np.linalg.slogdet(s * E - A)[1] for s in (1e4, 1e5))
    return round((large - small) / np.log(10))


def integrated(E: np.ndarray, A: np.ndarray, b: np.ndarray, c: np.ndarray, x: np.ndarray, end: float, steps: int) -> np.ndarray:
    """x(end) by Radau IIA of order 5 in equal steps, for the descriptor system itself."""
    r, h = np.sqrt(6), end / steps
    R = np.array([
        [(88 - 7 * r) / 360, (296 - 169 * r) / 1800, (-2 + 3 * r) / 225],
        [(296 + 169 * r) / 1800, (88 + 7 * r) / 360, (-2 - 3 * r) / 225],
        [(16 - r) / 36, (16 + r) / 36, 1 / 9],
    ])  # fmt: skip
    K = np.linalg.inv(np.kron(np.eye(3), E) - h * np.kron(R, A))
    for k in range(steps):
        rates = K @ np.concatenate([A @ x + b + c * h * (k + node) for node in R.sum(axis=1)])
        x = x + h * R[2] @ rates.reshape(3, -1)
    return x


def values_of(rng: np.random.Generator, kinds: str) -> np.ndarray:
    """Some resistors are shorted, some large; ratios of any sign."""
    usual = rng.uniform(0.3, 3, len(kinds))
    resistors = np.array([kind == "R" for kind in kinds])
    ratios = np.array([kind in "TG" for kind in kinds])
    usual[ratios] *= rng.choice([-1.0, 1.0], int(ratios.sum()))
    kind = rng.uniform(size=len(kinds))
    return np.where(resistors & (kind < 0.15), 0.0, np.where(resistors & (kind > 0.85), 1e3 * usual, usual))


@pytest.mark.parametrize("group", range(3))
def test_circuits_move_as_their_nodal_equations_at_the_values_of_the_build_and_at_others(group):
    right = 0
    for seed in range(15 * group, 15 * group + 15):
        rng = np.random.default_rng(seed)
        circuit = Circuit.random(rng)
        sizes = [values_of(rng, circuit.kinds) for _ in range(2)]
        print("seed", seed, circuit, sizes)
        degrees = [degree(*circuit.descriptor(values)[:2]) for values in sizes]
        scene, p, x = circuit.scene(sizes[0])
        try:
            model = ac.build(scene)
        except AcausalError as error:
            # a resistor of 0 may change what is a state: then it is named
            assert degrees[0] is None or "resistance is 0" in str(error) or "resistance are 0" in str(error)
            continue
        assert len(model.state_names) == degrees[0]
        for values, wanted in zip(sizes, degrees, strict=True):
            parameters = dict(zip(p, values, strict=True))
            if wanted != degrees[0]:
                with pytest.raises(AcausalError):
                    model.simulate(0.5, parameters=parameters)
                continue
            run = model.simulate(0.5, parameters=parameters, rtol=1e-10, samples=2)
            found = np.array([run[entry] for entry in x])
            exact = [integrated(*circuit.descriptor(values), found[:, 0], 0.5, steps) for steps in (100, 200)]
            gap = np.max(np.abs(exact[1] - exact[0]))  # of fast decays
            np.testing.assert_allclose(found[:, 1], exact[1], atol=1e-7 * np.max(np.abs(exact[1])) + gap)
            right += 1
    assert right > 10


def test_short_circuits_are_named_however_little_of_the_equations_is_left():
    """A capacitor in a network in which every second resistor is a parameter of 0: it is refused by their names, or right where no ring is closed."""
    refused = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        nodes = int(rng.integers(3, 6))
        pins = [(k, k + 1) for k in range(nodes - 1)] + [(a, b) for a in range(nodes) for b in range(a + 2, nodes)]
        values = np.where(rng.uniform(size=len(pins)) < 0.5, 0.0, rng.uniform(1, 5, len(pins)))
        circuit = Circuit(
            "R" * len(pins) + "CVR", (*pins, pins[int(rng.integers(len(pins)))], (nodes, 0), (nodes, nodes - 1)), nodes + 1
        )
        sizes = np.array([*values, 1e-3, 10.0, 1.0])
        try:
            model = ac.build(circuit.scene(sizes)[0])
        except AcausalError as error:
            assert "resistance is 0" in str(error) or "resistance are 0" in str(error), (seed, str(error))
            refused += 1
            continue
        assert len(model.state_names) == degree(*circuit.descriptor(sizes)[:2])
    assert 2 < refused < 12


@each_value(("unit", [1e-8, 1.0, 1e8]), ("seed", [2, 17, 109, 153, 163, 181]))
def test_eigenvalues_and_operating_points_are_those_of_the_nodal_equations(seed, unit):
    """Linear systems and equilibria at the values of the build and at others, of circuits that begin at nothing but rounding."""
    rng = np.random.default_rng(seed)
    circuit = Circuit.random(rng)
    values = values_of(rng, circuit.kinds)
    values = np.where(values == 0, 1.0, values) * [unit if kind in "LC" else 1.0 for kind in circuit.kinds]
    scene, parameters, wanted = circuit.scene(values, changing=False)
    model = ac.build(scene)
    for now in (values, values * rng.uniform(0.5, 2.0, values.size)):
        E, A, b, _ = circuit.descriptor(now)
        given = dict(zip(parameters, now, strict=True))
        above, below = scipy.linalg.eig(A, E / unit, right=False, homogeneous_eigvals=True)
        finite = np.abs(below) > 1e-11
        expected = above[finite] / below[finite] / unit
        found = model.linearize(parameters=given).eigenvalues
        assert found.size == expected.size
        off = np.abs(expected[:, None] - found)
        assert off[scipy.optimize.linear_sum_assignment(off)].max(initial=0.0) <= 1e-7 * np.abs(expected).max(initial=0.0)
        if np.linalg.cond(A) < 1e8:
            rests = model.equilibrium(parameters=given)
            exact = np.linalg.solve(A, -b)
            assert [float(np.ravel(rests[x])[0]) for x in wanted] == pytest.approx(
                exact, rel=1e-9, abs=1e-9 * np.abs(exact).max()
            )


@pytest.mark.parametrize("rtol", [1e-6, 1e-10])
def test_what_a_source_does_not_reach_has_no_derivative_by_it(rtol):
    """A source of voltage with a resistor, beside a network at rest: currents by it are sums that cancel, in no more steps than the motion takes."""
    rng = np.random.default_rng(80)
    circuit = Circuit.random(rng)
    values = values_of(rng, circuit.kinds) * [1e-6 if kind in "LC" else 1.0 for kind in circuit.kinds]
    scene, parameters, _ = circuit.scene(values, changing=False)
    source = parameters[circuit.kinds.index("V")]
    found = ac.build(scene).sensitivities([0.0, 5e-7], [source], rtol=rtol, max_steps=100)
    assert np.max(np.abs(found.S)) < 1e-13
