"""An exporter: a function of a model and a folder that writes files. A model hands out everything that one may want to write."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, World

LIMIT = 1e-14


def export_state_space(model: ac.Model, folder: str | Path) -> Path:
    """Write A, B and the names of states and inputs, about the rest position nearest to the sketch, as state_space.json; returns the folder."""
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    linear = model.linearize()
    matrices = {"A": linear.A.tolist(), "B": linear.B.tolist()}
    names = {"states": list(linear.states), "inputs": list(linear.inputs)}
    (target / "state_space.json").write_text(json.dumps(matrices | names, indent=2), encoding="utf-8")
    (target / "README.txt").write_text("state_space.json: x' = A x + B u about rest.\n", encoding="utf-8")
    return target


def main() -> float:
    """Writes a pendulum and reads it again; returns the largest difference from [[0, 1], [-3 g / 2, 0]]."""
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World(), Revolute("y"), RigidBody.rod(1.0, (0, 0, -1.0))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    with TemporaryDirectory() as folder:
        file = export_state_space(ac.build(scene), folder) / "state_space.json"
        written = json.loads(file.read_text(encoding="utf-8"))
    return float(np.max(np.abs(np.array(written["A"]) - [[0, 1], [-1.5 * 9.81, 0]])))


if __name__ == "__main__":
    print(main())
