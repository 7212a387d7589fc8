"""What the README prints works as printed, and what the page of abilities makes of it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

BLOCKS = [
    block
    for name in ("README.md", "docs/abilities.md")
    for block in re.findall(r"```python\n(.*?)```", (Path(__file__).parents[1] / name).read_text(encoding="utf-8"), re.DOTALL)
]


def test_first_scene(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    space: dict[str, object] = {}
    exec(BLOCKS[0], space)
    assert "2 degrees of freedom, 4 states, no constraints, 41 operations" in capsys.readouterr().out
    run = space["run"]
    assert run.energy_error() < 1e-9
    assert (tmp_path / "double_pendulum.html").exists()
    assert (tmp_path / "angles.png").exists()


def test_events_and_derivatives(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    space: dict[str, object] = {}
    exec(BLOCKS[0], space)
    exec(BLOCKS[1].replace("model.simulate(", "going_over = model.simulate(", 1), space)
    scene, model, change = space["scene"], space["model"], space["change"]
    going_over = space["going_over"]
    assert len(going_over) == 1 and going_over[0].direction == "rising"
    slope = change[scene.lower.tip.position]
    assert slope.shape == (3, 3, 1)
    h = 1e-5
    ends = [model.simulate(1.0, {scene.shoulder.q: 0.6 + d}, rtol=1e-12)[scene.lower.tip.position][-1] for d in (-h, h)]
    assert np.max(np.abs(slope[1, :, 0] - (ends[1] - ends[0]) / (2 * h))) < 1e-6
    expected = model.simulate(1.0, {scene.shoulder.q: 0.7}, rtol=1e-12)[scene.lower.tip.position][-1]
    assert np.max(np.abs(np.array(space["reach"]([0.7]))[:, 1] - expected)) < 1e-6
