"""What has a name is the same by its name: in start values, parameters, inputs, and wherever a variable is asked for."""

from __future__ import annotations

import json

import numpy as np
import pytest

import acausal as ac
from components import Spherical, TorqueSource
from tests.scenes import FourBar, Pendulum, chain


class Driven(Pendulum):
    """A pendulum with a mass that stays adjustable, and a motor."""

    def __init__(self) -> None:
        self.mass, self.push = ac.Parameter(1.0, "kg"), ac.Input("N*m")
        super().__init__(mass=self.mass)
        self.motor = TorqueSource(self.push)
        self.connect(self.motor.flange, self.hinge.flange)


def ball() -> ac.System:
    """A chain on ball joints."""
    return chain(2, lambda _: Spherical())


@pytest.mark.parametrize("make", [Driven, FourBar, ball])
def test_states_are_read_and_set_by_their_names(make):
    model = ac.build(make())
    speeds = [n for n in model.state_names if ".v" in n][:1]
    begun = model.initial_state(dict.fromkeys(speeds, 0.3))
    again = model.initial_state(json.loads(json.dumps(dict(zip(model.state_names, begun.x.tolist(), strict=True)))))
    assert np.max(np.abs(again.x - begun.x)) < 1e-12
    run = model.simulate(0.1, dict.fromkeys(speeds, 0.3), samples=5)
    for name, row in zip(model.state_names, run.x, strict=True):
        assert np.array_equal(run[name], row)


def test_names_give_the_bits_of_what_they_name():
    scene = Driven()
    model = ac.build(scene)

    def answers(q, mass, push, tip):
        given = {"start": {q: 0.4}, "parameters": {mass: 2.0}, "inputs": {push: 0.3}}
        yield model.simulate(1.0, **given)[tip]
        yield model.sensitivities([0.0, 1.0], [mass, push, q], **given)[tip]
        yield np.array(model.trajectory_function([0.0, 1.0], tip, [mass, q], **given)([2.0, 0.4]))
        yield model.linearize(**given, states=[q, "hinge.v"], outputs=[tip]).C
        yield model.equilibrium({q: 0.1}, free=[push], parameters={mass: 3.0}, steady=[q]).x
        yield np.array(model.assembly_function(tip, q, {q: 0.1})(0.2))
        yield model.minimal(prefer=[q], **given).start
        yield model.inverse_dynamics([0.0, 1.0], {q: 0.1 * ac.time}, [push], parameters={mass: 2.0}).force(push)

    by_symbol = answers(scene.hinge.q, scene.mass, scene.push, scene.rod.tip.position)
    by_name = answers("hinge.q", "mass", "push", "rod.tip.position")
    for a, b in zip(by_symbol, by_name, strict=True):
        assert a.size and np.array_equal(a, b)


def test_joints_are_unknowns_by_their_paths():
    scene = Driven()
    model = ac.build(scene)
    times, motion = np.linspace(0, 1, 4), {"hinge.q": 0.1 * ac.time}
    assert np.array_equal(
        model.inverse_dynamics(times, motion, ["hinge"]).force("hinge"),
        model.inverse_dynamics(times, motion, [scene.hinge]).force(scene.hinge),
    )
