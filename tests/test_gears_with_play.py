"""An elastic gear and teeth with play between three wheels that rub, driven by a torque that is switched: against a program that goes from event to event by matrix exponentials."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import acausal as ac
from components import Brake, ElasticBacklash, ElasticGear, HuntCrossley, Inertia, TorqueSource
from tests.drawn import Drawn


class Train:
    """Numbers of it, in kg m^2 = 1 and s = 1: wheels, ratio, stiffness and damping of the gear, stiffness and play of the teeth, torques that slide and hold, the drive from 0, 3, 6 s on."""

    def __init__(self, of: Drawn) -> None:
        self.J, self.ratio = 10 ** of.rng.uniform(-0.5, 0.5, 3), float(of.rng.choice([-2, -1, 0.5, 2]))
        self.k, self.c, self.teeth, self.play = of.within(20, 300), of.within(0, 0.5), of.within(20, 300), of.within(0.05, 0.4)
        self.slides = of.rng.uniform(0.02, 0.3, 2)
        self.holds = self.slides * of.rng.choice([1.0, 1.4], 2)
        self.drive, self.speeds = of.within(-2, 2) * np.array([1, -0.5, 0.05]), of.rng.uniform(-1, 1, 3)

    def torques(self, drive: float, side: int) -> np.ndarray:
        """On the wheels but for friction (3, 7), by angles, speeds and 1; side: of the teeth that touch, or 0."""
        on = np.zeros((3, 7))
        twist = self.k * np.array([1, -self.ratio, 0, 0, 0, 0, 0]) + self.c * np.array([0, 0, 0, 1, -self.ratio, 0, 0])
        on[0] -= twist
        on[1] += self.ratio * twist
        on[0, 6] += drive
        bent = self.teeth * np.array([0, -1, 1, 0, 0, 0, -side * self.play / 2])
        on[1] += abs(side) * bent
        on[2] -= abs(side) * bent
        return on

    def ends(self, z: np.ndarray) -> tuple[int, np.ndarray]:
        """How often something changes until 9 s, and angles, speeds and 1 then (7,)."""
        events, signs, side = 0, [int(np.sign(v)) for v in z[4:6]], 0
        for drive, (t, end) in zip(self.drive, pairwise((0, 3, 6, 9)), strict=True):
            undecided = [k for k in (0, 1) if z[4 + k] == 0]
            while t < end:
                on = self.torques(drive, side)
                for k in undecided:
                    load = on[1 + k] @ z
                    signs[k] = 0 if abs(load) <= self.holds[k] else int(np.sign(load))
                A, left, gap = np.zeros((7, 7)), [], np.array([0, -1.0, 1, 0, 0, 0, 0])
                A[:3, 3:6], A[3:6] = np.eye(3), on / self.J[:, None]
                for k, sign in enumerate(signs):  # what has to stay positive
                    if sign:
                        A[4 + k, 6] -= sign * self.slides[k] / self.J[1 + k]
                        left.append((sign * np.eye(7)[4 + k], k))
                    else:
                        A[[1 + k, 4 + k]] = 0
                        left += [(s * on[1 + k] + self.holds[k] * np.eye(7)[6], k) for s in (1, -1)]
                touches = [(side * gap, -self.play / 2)] if side else [(gap, self.play / 2), (-gap, self.play / 2)]
                left += [(g + more * np.eye(7)[6], 2) for g, more in touches]
                step = min(end - t, 5e-3)
                flow, begin, first = expm(A * step), 1e-6 * step, True
                while True:
                    step = min(step, end - t)
                    later = (flow if step == 5e-3 else expm(A * step)) @ z
                    over = [
                        (brentq(lambda s, c=c, A=A, z=z: c @ expm(A * s) @ z, begin if first else 0, step, xtol=1e-16), k)
                        for c, k in left
                        if c @ later < 0
                    ]
                    if over or t + step >= end:
                        break
                    z, t, first = later, t + step, False
                past, k = min(over, default=(end - t, -1))
                z, t, undecided = expm(A * past) @ z, t + past if over else end, [k] if k in (0, 1) else []
                events += k >= 0
                if k == 2:
                    side = 0 if side else int(np.sign(gap @ z))
                elif k >= 0 and signs[k]:
                    z[4 + k] = 0.0
                elif k >= 0:
                    signs[k], undecided = int(np.sign(on[1 + k] @ z)), []
        return events, z


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_gears_with_play_run_as_a_program_from_event_to_event_says(seed: int) -> None:
    of = Drawn(seed)
    train = Train(of)
    unit = of.M * of.L**2  # of inertias
    torque = unit / of.T**2
    wheels = [Inertia(float(j * unit)) for j in train.J]
    brakes = [
        Brake(wheel.flange_b, float(slides * torque), holding=float(holds * torque))
        for wheel, slides, holds in zip(wheels[1:], train.slides, train.holds, strict=True)
    ]
    scene = ac.System()
    scene.wheels, scene.brakes = [wheels[k] for k in of.order(3)], [brakes[k] for k in of.order(2)]
    scene.gear = ElasticGear(train.ratio, train.k * torque, train.c * torque * of.T)
    law = HuntCrossley(train.teeth * torque, 0.0, exponent=1)
    scene.teeth = ElasticBacklash(wheels[1].flange_b, wheels[2].flange_a, width=train.play, law=law)
    a, b, c = (float(value * torque) for value in train.drive)
    scene.drive = TorqueSource(np.where(ac.time < 3 * of.T, a, np.where(ac.time < 6 * of.T, b, c)))
    scene.connect(scene.drive.flange, wheels[0].flange_a)
    scene.connect(wheels[0].flange_b, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, wheels[1].flange_a)
    start = {wheel.w: float(v / of.T) for wheel, v in zip(wheels, train.speeds, strict=True)}
    run = ac.build(scene).simulate(9 * of.T, start | {wheel.phi: 0.0 for wheel in wheels}, rtol=1e-12)
    found = np.array([run[wheel.phi][-1].item() for wheel in wheels] + [run[wheel.w][-1].item() * of.T for wheel in wheels])
    begin = np.array([0, 0, 0, *train.speeds, 1])
    events, z = train.ends(begin)
    growth = np.max(np.abs(train.ends(begin + 1e-9 * np.array([0, 0, 0, 1, -1, 1, 0]))[1] - z)) / 1e-9
    assert events > 10
    assert found == pytest.approx(z[:6], abs=1e-10 * max(1, growth) * max(1, np.max(np.abs(z))))
    assert run.energy_error() < 1e-11
