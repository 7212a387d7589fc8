"""What a message must have: the kind of error, words, and no more than a newcomer reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest

import acausal as ac
from components import Revolute, RigidBody, World
from tests.scenes import DoublePendulum, Pendulum

_LONGEST = 750


@dataclass(frozen=True)
class Wrong:
    """Something wrong, said in `title`; the call raises `kind` with all `words` in its message."""

    title: str
    call: Callable[[], object]
    kind: type[Exception]
    words: tuple[str, ...]

    def message(self) -> str:
        """The message that a user gets."""
        with pytest.raises(self.kind) as caught:
            self.call()
        return str(caught.value)

    def check(self) -> None:
        """The message has all words, and is short."""
        message = self.message()
        print(f"{self.kind.__name__}: {message}")
        assert all(word in message for word in self.words), [word for word in self.words if word not in message]
        assert len(message) < _LONGEST


def pendulum_with(*parts: ac.Component) -> ac.System:
    """A pendulum whose hinge's flange is connected to the first (or only) flange of each part."""
    scene = Pendulum()
    scene.extra = list(parts)
    for part in parts:
        scene.connect(scene.hinge.flange, next(c for c in part.connectors() if isinstance(c, ac.Rotational)))
    return scene


def double() -> tuple[DoublePendulum, ac.Model]:
    """A double pendulum and its model."""
    scene = DoublePendulum()
    return scene, ac.build(scene)


def four_bar(
    crank: float = 0.4, coupler: float = 1.2, rocker: float = 0.8, base: float = 1.0, last_but_one: object = "y"
) -> ac.System:
    """A four-bar with hinges a, b, c, d; `last_but_one` is the axis of hinge c."""
    scene = ac.System()
    scene.world, scene.crank, scene.coupler, scene.rocker = (
        World(),
        *(RigidBody.rod(1.0, (length, 0, 0)) for length in (crank, coupler, rocker)),
    )
    scene.a, scene.b, scene.c, scene.d = (Revolute(axis) for axis in ("y", "y", last_but_one, "y"))
    for joint, one, two in (
        (scene.a, scene.world.frame, scene.crank.frame),
        (scene.b, scene.crank.tip, scene.coupler.frame),
        (scene.c, scene.coupler.tip, scene.rocker.tip),
        (scene.d, scene.world.at((base, 0, 0)), scene.rocker.frame),
    ):
        scene.connect(one, joint.frame_a)
        scene.connect(joint.frame_b, two)
    return scene
