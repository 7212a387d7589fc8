"""How the time to reduce a scene grows with its number of parts: links, shafts, ladders of resistors, loops side by side.

python -m benchmarks.growth
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import acausal as ac
from benchmarks.chains import chain
from components import Capacitor, Gear, Ground, Inertia, Resistor, Revolute, RigidBody, RotationalSpring, VoltageSource, World

COUNTS = (10, 30, 100, 300, 1000)
LONG = 60.0  # s; a family ends where its next one would take about as long


def shafts(count: int) -> ac.System:
    """Rotors in a row: between them springs and gears in turn."""
    scene = ac.System()
    scene.rotors = [Inertia(0.01 + 0.001 * (k % 7)) for k in range(count)]
    scene.between = [Gear(1.5 if k % 4 else -0.6) if k % 2 else RotationalSpring(5.0) for k in range(count - 1)]
    for k, part in enumerate(scene.between):
        scene.connect(scene.rotors[k].flange_b, part.flange_a)
        scene.connect(part.flange_b, scene.rotors[k + 1].flange_a)
    return scene


def ladder(count: int) -> ac.System:
    """Resistors in a row, from each joint of two a capacitor to ground."""
    scene = ac.System()
    scene.source, scene.ground = VoltageSource(1.0), Ground()
    scene.resistors, scene.capacitors = [Resistor(10.0) for _ in range(count)], [Capacitor(1e-3) for _ in range(count)]
    scene.connect(scene.source.pin_b, scene.ground.pin)
    pin = scene.source.pin_a
    for resistor, capacitor in zip(scene.resistors, scene.capacitors, strict=True):
        scene.connect(pin, resistor.pin_a)
        scene.connect(resistor.pin_b, capacitor.pin_a)
        scene.connect(capacitor.pin_b, scene.ground.pin)
        pin = resistor.pin_b
    return scene


def four_bars(count: int) -> ac.System:
    """Plane four-bars beside one another."""
    scene = ac.System()
    scene.world = World()
    scene.bars = [RigidBody.rod(mass, (mass, 0, 0)) for _ in range(count) for mass in (0.4, 1.2, 0.8)]
    scene.hinges = [Revolute("y") for _ in range(4 * count)]
    for k in range(count):
        crank, coupler, rocker = scene.bars[3 * k : 3 * k + 3]
        a, b, c, d = scene.hinges[4 * k : 4 * k + 4]
        for hinge, one, two in (
            (a, scene.world.at((0, float(k), 0)), crank.frame),
            (b, crank.tip, coupler.frame),
            (c, coupler.tip, rocker.tip),
            (d, scene.world.at((1.0, float(k), 0)), rocker.frame),
        ):
            scene.connect(one, hinge.frame_a)
            scene.connect(hinge.frame_b, two)
    return scene


FAMILIES: dict[str, Callable[[int], Any]] = {
    "links in a chain": chain,
    "rotors, springs, gears": shafts,
    "resistors, capacitors": ladder,
    "four-bars": four_bars,
}


def seconds(make: Callable[[int], Any], count: int) -> float:
    """Of the processor, to build the scene's model; the best of three where that is quick."""
    times: list[float] = []
    while not times or (len(times) < 3 and times[-1] < 1.0):
        scene = make(count)
        begin = time.process_time()
        ac.build(scene)
        times.append(time.process_time() - begin)
    return min(times)


def run(counts: tuple[int, ...] = COUNTS) -> None:
    """Print the table: seconds, and the exponent between the two largest."""
    print("\nSeconds to reduce, without compiling; exponent: of the number of parts, between the two largest")
    print(f"{'':24}" + "".join(f"{count:>9}" for count in counts) + f"{'exponent':>10}")
    for name, make in FAMILIES.items():
        make_once = make(counts[0])
        ac.build(make_once)  # imports
        times: list[float] = []
        for count in counts:
            if times and times[-1] > LONG / 4:
                break
            times.append(seconds(make, count))
        exponent = np.log(times[-1] / times[-2]) / np.log(counts[len(times) - 1] / counts[len(times) - 2])
        cells = [f"{t:>9.3f}" for t in times] + ["        -"] * (len(counts) - len(times))
        print(f"{name:24}" + "".join(cells) + f"{exponent:>10.2f}", flush=True)


if __name__ == "__main__":
    run()
