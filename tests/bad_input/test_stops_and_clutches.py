"""Stops, clutches, freewheels and valves, made or connected wrongly."""

from __future__ import annotations

from typing import Any

import pytest

import acausal as ac
from acausal import errors
from components import (
    Backlash,
    Brake,
    Clutch,
    EndStop,
    Freewheel,
    IdealDiode,
    Inertia,
    Revolute,
    SlidingMass,
    TranslationalDamper,
    TranslationalGround,
    TranslationalSpring,
    World,
)
from tests.bad_input.messages import Wrong

HERE = "test_stops_and_clutches.py:"


def mass() -> Any:
    return SlidingMass(1.0).flange_a


def started(restitution: float = 0.0, **limits: float) -> object:
    scene = ac.System()
    scene.ball = SlidingMass(1.0)
    scene.stop = EndStop(scene.ball.flange_a, restitution=restitution, **limits)
    return ac.build(scene).simulate(1.0, {scene.ball.s: 0.0, scene.ball.v: 1.0})


def on_a_spring_alone(what: str) -> object:
    scene = ac.System()
    scene.wall, scene.ball = TranslationalGround(), SlidingMass(1.0)
    scene.link = TranslationalDamper(2.0) if what == "damper" else TranslationalSpring(2.0)
    if what == "stop":
        scene.stop = EndStop(scene.link.flange_b, lower=-1.0)
    else:
        scene.rub = Brake(scene.link.flange_b, 1.0)
    scene.connect(scene.ball.flange_b if what == "damper" else scene.wall.flange, scene.link.flange_a)
    return ac.build(scene)


class Lawless(ac.Component):
    """Forgets to give its laws."""

    def laws(self) -> Any:
        return None


def lawless() -> object:
    scene = ac.System()
    scene.ball, scene.own = SlidingMass(1.0), Lawless()
    return ac.build(scene)


def jumping() -> object:
    scene = ac.System()
    scene.ball, scene.place = SlidingMass(1.0), ac.Input("m")
    scene.stop = EndStop(scene.ball.flange_a, lower=scene.place)
    start = {scene.ball.s: 0.0, scene.ball.v: 0.0}
    return ac.build(scene).simulate(2.0, start, inputs={scene.place: ac.samples([0, 1], [-1, 1], kind="constant")})


CASES = [
    Wrong("stop whose ends are exchanged", lambda: EndStop(mass(), lower=0.3, upper=-0.2), errors.ParameterError, ("upper is 0.5 below its lower", HERE, "Exchange")),
    Wrong("stop without room", lambda: EndStop(mass(), lower=0.3, upper=0.3), errors.ParameterError, ("upper is at its lower", HERE)),
    Wrong("stop without ends", lambda: EndStop(mass()), errors.ParameterError, ("neither 'lower' nor 'upper'", HERE)),
    Wrong("stop that gains energy", lambda: EndStop(mass(), lower=0, restitution=1.1), errors.ParameterError, ("EndStop's restitution is 1.1", HERE, "no loss")),
    Wrong("stop that bounces the wrong way", lambda: EndStop(mass(), lower=0, restitution=-0.1), errors.ParameterError, ("EndStop's restitution is -0.1", HERE)),
    Wrong("stop on a part", lambda: EndStop(SlidingMass(1.0), lower=0), errors.IncompatibleError, ("EndStop(...)", "SlidingMass", HERE, "scene.hinge.flange")),  # type: ignore[arg-type]
    Wrong("stop on a frame", lambda: EndStop(World().frame, lower=0), errors.IncompatibleError, ("EndStop(...)", "Frame", HERE)),  # type: ignore[arg-type]
    Wrong("stop with an angle for a place", lambda: EndStop(mass(), lower=ac.Parameter(0.1, "s")), errors.ParameterError, ("EndStop's lower", "in s", "in m")),
    Wrong("play of no width", lambda: Backlash(mass(), mass(), 0.0), errors.ParameterError, ("Backlash's width is 0", HERE, "positive")),
    Wrong("play between a shaft and a rod", lambda: Backlash(mass(), Inertia(1.0).flange_a, 0.1), errors.IncompatibleError, ("translational", "rotational", HERE)),
    Wrong("clutch on one flange", lambda: Clutch(f := mass(), f, 1.0), errors.IncompatibleError, ("itself", HERE)),
    Wrong("clutch of negative capacity", lambda: Clutch(mass(), mass(), -1.0), errors.ParameterError, ("Clutch's capacity is -1", HERE)),
    Wrong("brake that slides with more than it holds", lambda: Brake(Revolute("x").flange, 2.0, holding=1.5), errors.ParameterError, ("holding is 0.5 below its capacity", HERE)),
    Wrong("brake by a pressure", lambda: Brake(Revolute("x").flange, ac.Input("Pa")), errors.ParameterError, ("Brake's capacity", "Pa", "N*m")),
    Wrong("freewheel to a joint's frame", lambda: Freewheel(mass(), Revolute("x").frame_a), errors.IncompatibleError, ("Freewheel(...)", "Frame", HERE)),  # type: ignore[arg-type]
    Wrong("diode of negative leakage", lambda: IdealDiode(-1e-6), errors.ParameterError, ("IdealDiode's leakage", HERE)),
    Wrong("diode of negative resistance", lambda: IdealDiode(0.0, -1e-3), errors.ParameterError, ("IdealDiode's resistance", HERE)),
    Wrong("stop that is violated at the start", lambda: started(lower=0.1), errors.SimulationError, ("The gap of stop", "negative at the start")),
    Wrong("stop on a spring alone", lambda: on_a_spring_alone("stop"), errors.ModelError, ("gap of stop", HERE, "mass or an inertia")),
    Wrong("brake on a spring alone", lambda: on_a_spring_alone("spring"), errors.ModelError, ("rub", HERE)),
    Wrong("brake on a damper alone", lambda: on_a_spring_alone("damper"), errors.ModelError, ("slip of rub", HERE, "mass or an inertia")),
    Wrong("part that gives no laws", lawless, errors.ModelError, ("own (", HERE, "laws() of Lawless gives None", "ac.OneSided")),
    Wrong("stop that an input puts elsewhere", jumping, errors.ParameterError, ("jump at t = 1 s", HERE)),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.title)
def test_message(case: Wrong) -> None:
    case.check()
