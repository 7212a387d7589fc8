"""Where numbers decide, they decide on the right side well before rounding, and not at what is merely small."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.errors import JumpWarning
from components import AngleSource, CartesianTranslation, Particle, Revolute, RigidBody, Rod, World
from tests.scenes import Pendulum


@pytest.mark.parametrize("apart", [1e-4, 1e-3, 0.1])
def test_two_rods_that_are_nearly_one_hold_two_freedoms(apart: float):
    """A bead on two rods from neighbouring points turns about the line through these, however near they are."""
    scene = ac.System()
    scene.world, scene.move, scene.bead = World(), CartesianTranslation(), Particle(1.0)
    scene.near, scene.far = Rod(1.0), Rod(float(np.hypot(1.0, apart)))
    scene.move.q.start = (0.0, 0.0, -1.0)
    scene.connect(scene.world.frame, scene.move.frame_a, scene.near.frame_a)
    scene.connect(scene.world.at((apart, 0, 0)), scene.far.frame_a)
    scene.connect(scene.move.frame_b, scene.bead.point, scene.near.frame_b, scene.far.frame_b)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1 and all(entry.kept for entry in model.constraints())
    run = model.simulate(1.0, {scene.bead.point.position[1]: 0.6}, rtol=1e-9)
    assert np.max(np.abs(run[scene.bead.point.position][:, 0])) < 1e-9 / apart


@pytest.mark.parametrize("longer", [0.0, 1e-8, 1e-5, 1e-3])
def test_only_an_exact_parallelogram_passes_singular_positions(longer: float):
    scene = ac.System()
    scene.world, scene.hinges = World(), [Revolute("y") for _ in range(4)]
    bars = [RigidBody.rod(1.0, (length, 0, 0)) for length in (0.4, 1.0, 0.4)]
    scene.crank, scene.coupler, scene.rocker = bars
    ends = [
        (scene.world.frame, scene.crank.frame),
        (scene.crank.tip, scene.coupler.frame),
        (scene.coupler.tip, scene.rocker.tip),
        (scene.world.at((1.0 + longer, 0, 0)), scene.rocker.frame),
    ]
    for joint, (one, two) in zip(scene.hinges, ends, strict=True):
        scene.connect(one, joint.frame_a)
        scene.connect(joint.frame_b, two)
    assert ac.build(scene).system.constraints.singular is (longer == 0.0)


@pytest.mark.parametrize(("jump", "said"), [(0.0, False), (1e-5, True), (0.1, True)])
def test_a_small_jump_of_a_prescribed_motion_is_said_too(jump: float, said: bool):
    scene = Pendulum()
    scene.drive = AngleSource(lambda t: t + ca.if_else(t > 0.5, jump, 0.0))
    scene.connect(scene.drive.flange, scene.hinge.flange)
    model = ac.build(scene)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.simulate(1.0)
    found = [w for w in caught if w.category is JumpWarning]
    assert bool(found) is said and all(w.filename == __file__ for w in found)
