"""Units for co-simulation, by FMPy, which is not ours: they are valid, and move as a closed form says, whatever is set and however often they go back."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

import acausal as ac
from acausal.errors import ExportError
from acausal.export import fmu
from components import ForceSource, SlidingMass, TranslationalGround, TranslationalSpring
from tests.exported import compile_quickly

STIFFNESS, LIMIT = 8.0, 0.9


def oscillator() -> ac.System:
    """A mass on a spring, pushed by an input."""
    scene = ac.System()
    scene.m, scene.push = ac.Parameter(2.0, "kg"), ac.Input("N")
    scene.ground, scene.mass = TranslationalGround(), SlidingMass(scene.m)
    scene.spring, scene.force = TranslationalSpring(STIFFNESS), ForceSource(scene.push)
    scene.connect(scene.ground.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.mass.flange_a)
    scene.connect(scene.mass.flange_b, scene.force.flange)
    return scene


def moved(x: float, v: float, push: float, mass: float, h: float) -> tuple[float, float]:
    """Place and speed after so long."""
    rate, middle = np.sqrt(STIFFNESS / mass), push / STIFFNESS
    c, s = np.cos(rate * h), np.sin(rate * h)
    return middle + (x - middle) * c + v / rate * s, v * c - (x - middle) * rate * s


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = oscillator()
    events = [ac.when(scene.mass.s - LIMIT, "rising", stop=True), ac.when(scene.mass.v)]
    model, folder = ac.build(scene), tmp_path_factory.mktemp("units")
    with pytest.MonkeyPatch.context() as patch:
        compile_quickly(patch)
        return model.export_fmu(
            folder / "oscillator", {scene.mass.s: 0.3}, outputs={"pull": scene.spring.flange_b.f}, events=events
        )


class Slave:
    """A unit in FMPy, its variables by name. `told`: what it has logged."""

    def __init__(self, unit: Path, folder: Path, guid: str | None = None) -> None:
        self.description = fmpy.read_model_description(unit)
        self.reference = {variable.name: variable.valueReference for variable in self.description.modelVariables}
        self.told: list[str] = []
        self.fmu = FMU2Slave(
            guid=guid or self.description.guid, unzipDirectory=fmpy.extract(str(unit), str(folder)), modelIdentifier="oscillator", instanceName="one"
        )  # fmt: skip

    def make(self) -> None:
        callbacks = fmpy.fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(lambda *given: self.told.append(given[4].decode()))
        callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.fmi2.calloc)
        callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.fmi2.free)
        self.callbacks = callbacks
        self.fmu.instantiate(callbacks=callbacks)

    def begin(self, tolerance: float | None = None, end: float | None = None, values: Mapping[str, float] | None = None) -> None:
        self.make()
        self.start(tolerance, end, values)

    def start(self, tolerance: float | None = None, end: float | None = None, values: Mapping[str, float] | None = None) -> None:
        self.fmu.setupExperiment(tolerance=tolerance, startTime=0.0, stopTime=end)
        for name, value in (values or {}).items():
            self[name] = value
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def __getitem__(self, name: str) -> float:
        return self.fmu.getReal([self.reference[name]])[0]

    def __setitem__(self, name: str, value: float) -> None:
        self.fmu.setReal([self.reference[name]], [value])

    @property
    def state(self) -> np.ndarray:
        return np.array([self["mass.s"], self["mass.v"]])


@pytest.fixture
def slave(unit: Path, tmp_path: Path) -> Iterator[Slave]:
    found = Slave(unit, tmp_path)
    yield found
    if getattr(found.fmu, "component", None):
        found.fmu.freeInstance()


def test_it_is_valid_and_says_what_can_be_set(unit: Path):
    assert validate_fmu(str(unit)) == []
    variables = {v.name: v for v in fmpy.read_model_description(unit).modelVariables}
    assert {name: (v.causality, v.unit, v.start) for name, v in variables.items()} == {
        "mass.s": ("local", "m", None), "mass.v": ("local", "m/s", None), "push": ("input", "N", "0.0"), "m": ("parameter", "kg", "2.0"),
        "start.mass.s": ("parameter", "m", "0.3"), "pull": ("output", "N", None),
    }  # fmt: skip
    found = fmpy.simulate_fmu(
        str(unit), stop_time=1.0, output_interval=0.1, start_values={"start.mass.s": 0.2}, relative_tolerance=1e-11
    )
    expected = [STIFFNESS * moved(0.2, 0, 0, 2.0, t)[0] for t in found["time"]]
    np.testing.assert_allclose(np.abs(found["pull"]), np.abs(expected), atol=1e-10)


@pytest.mark.parametrize("end", [None, 4.0])
def test_it_moves_as_said_between_points_of_any_distance(slave: Slave, end: float | None):
    slave.begin(1e-12, end, {"m": 0.5, "start.mass.s": 0.1})
    x, v, t, rng = 0.1, 0.0, 0.0, np.random.default_rng(1)
    for k in range(20):
        push, h = rng.uniform(-2, 2), rng.uniform(0.01, 0.3)
        slave["push"] = push
        slave.fmu.doStep(t, h)
        x, v = moved(x, v, push, 0.5, h)
        t += h
        np.testing.assert_allclose(slave.state, [x, v], atol=1e-11, err_msg=str(k))
        assert abs(abs(slave["pull"]) - abs(STIFFNESS * x)) < 1e-10


def test_what_is_set_before_the_experiment_and_while_it_begins_counts(slave: Slave):
    slave.make()
    slave["m"], slave["start.mass.s"] = 0.5, 0.1
    slave.fmu.setupExperiment(tolerance=1e-12, startTime=0.0)
    slave.fmu.enterInitializationMode()
    for place in (0.1, 0.2):
        slave["start.mass.s"] = place
        assert slave["mass.s"] == place and abs(slave["pull"]) == pytest.approx(STIFFNESS * place, rel=1e-15)
    slave.fmu.exitInitializationMode()
    slave.fmu.doStep(0.0, 0.5)
    np.testing.assert_allclose(slave.state, moved(0.2, 0.0, 0.0, 0.5, 0.5), atol=1e-11)


def test_points_between_and_values_that_are_set_again_change_no_bit(slave: Slave):
    ends: list[np.ndarray] = []
    for points, again in ((1, False), (10, False), (10, True)):
        if not ends:
            slave.make()
        else:
            slave.fmu.reset()
        slave.start(1e-8, 1.0, {"push": 1.0})
        for k in range(points):
            if again:
                slave["push"], slave["m"] = 1.0, 2.0
            slave.fmu.doStep(k / points, 1 / points)
        ends.append(slave.state)
        slave.fmu.doStep(1.0, 0.5)  # beyond the end of the experiment, as masters do
        np.testing.assert_allclose(slave.state, moved(0.3, 0.0, 1.0, 2.0, 1.5), atol=1e-7)
    assert ends[0].tobytes() == ends[1].tobytes() == ends[2].tobytes()


def test_it_goes_back_and_moves_alike(slave: Slave):
    slave.begin(1e-10, None, {"push": 1.0})
    slave.fmu.doStep(0.0, 0.25)
    kept = slave.fmu.getFMUState()
    slave.fmu.doStep(0.25, 0.5)
    there = slave.state
    for step in (0.1, 0.5):
        slave.fmu.setFMUState(kept)
        slave.fmu.doStep(0.25, step)
    assert np.array_equal(slave.state, there)
    slave["push"] = 50.0
    with pytest.raises(FMICallException, match="discard"):
        slave.fmu.doStep(0.75, 3.0)
    slave.fmu.setFMUState(kept)  # also from where an event has ended the motion
    slave.fmu.doStep(0.25, 0.5)
    assert np.array_equal(slave.state, there)
    slave.fmu.freeFMUState(kept)
    slave.fmu.reset()
    slave.start()
    np.testing.assert_allclose(slave.state, [0.3, 0.0])


def test_an_event_that_stops_discards_the_rest_of_its_step(slave: Slave):
    slave.begin(1e-12, None, {"push": 5.0})
    middle, rate = 5.0 / STIFFNESS, np.sqrt(STIFFNESS / 2.0)
    with pytest.raises(FMICallException, match="discard"):
        slave.fmu.doStep(0.0, 3.0)
    assert slave.fmu.getBooleanStatus(fmpy.fmi2.fmi2Terminated) == 1
    reached = slave.fmu.getRealStatus(fmpy.fmi2.fmi2LastSuccessfulTime)
    assert abs(reached - np.arccos((LIMIT - middle) / (0.3 - middle)) / rate) < 1e-11
    assert abs(slave["mass.s"] - LIMIT) < 1e-11
    slave["push"] = 0.0
    with pytest.raises(FMICallException, match="discard"):  # it has ended, whatever is set
        slave.fmu.doStep(3.0, 1.0)
    assert abs(slave["mass.s"] - LIMIT) < 1e-11


def test_what_makes_no_sense_is_told(slave: Slave, unit: Path, tmp_path: Path):
    slave.begin()
    for wrong, words in (
        (lambda: slave.fmu.setReal([slave.reference["mass.s"]], [1.0]), "mass.s cannot be set to 1 now"),
        (lambda: slave.fmu.setReal([slave.reference["start.mass.s"]], [1.0]), "cannot be set to 1 now"),
        (lambda: slave.fmu.setReal([slave.reference["m"]], [np.inf]), "m cannot be set to inf"),
        (lambda: slave.fmu.getReal([99]), "no variable"),
        (lambda: slave.fmu.doStep(0.0, -0.1), "cannot go back"),
        (lambda: slave.fmu.getInteger([0]), "real numbers"),
        (lambda: slave.start(), "before it is initialised"),
        (lambda: slave.fmu.enterInitializationMode(), "initialised before"),
    ):
        with pytest.raises(FMICallException):
            wrong()
        assert words in slave.told[-1], slave.told
    slave.fmu.reset()
    with pytest.raises(FMICallException):
        slave.fmu.setupExperiment(startTime=1.0, stopTime=1.0)
    assert "ends before it starts" in slave.told[-1]
    other = Slave(unit, tmp_path / "other", guid="{0}")
    with pytest.raises(Exception, match="instantiate"):
        other.fmu.instantiate()


def test_what_cannot_be_written_is_said_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    scene = oscillator()
    model = ac.build(scene)
    with pytest.raises(ExportError, match="letters and digits"):
        model.export_fmu(tmp_path / "1 unit.fmu")
    with pytest.raises(ExportError, match=r"two variables 'mass\.s'"):
        model.export_fmu(tmp_path / "unit.fmu", outputs={"mass.s": scene.mass.s})
    monkeypatch.setattr(fmu, "compiler", lambda: None)
    with pytest.raises(ExportError, match="no C compiler"):
        model.export_fmu(tmp_path / "unit.fmu")
    assert not list(tmp_path.iterdir())


def test_all_that_the_standard_asks_for_is_there(unit: Path, tmp_path: Path):
    """FMI 2.0.5, 2.3 and 4.2."""
    shutil.unpack_archive(unit, tmp_path, "zip")
    library = ctypes.CDLL(str(next(tmp_path.glob("binaries/*/*"))))
    types = [f"{way}{kind}" for way in ("Get", "Set") for kind in ("Real", "Integer", "Boolean", "String")]
    states = ["GetFMUstate", "SetFMUstate", "FreeFMUstate", "SerializedFMUstateSize", "SerializeFMUstate", "DeSerializeFMUstate"]
    course = [
        "Instantiate",
        "FreeInstance",
        "SetupExperiment",
        "EnterInitializationMode",
        "ExitInitializationMode",
        "Terminate",
        "Reset",
    ]
    steps = ["SetRealInputDerivatives", "GetRealOutputDerivatives", "DoStep", "CancelStep", "GetStatus"]
    told = [f"Get{kind}Status" for kind in ("Real", "Integer", "Boolean", "String")]
    rest = ["GetTypesPlatform", "GetVersion", "SetDebugLogging", "GetDirectionalDerivative"]
    assert all(hasattr(library, f"fmi2{name}") for name in (*types, *states, *course, *steps, *told, *rest))
