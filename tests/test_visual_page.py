"""The page that plays a motion: it loads nothing, keeps numbers and names, and runs in a browser."""

from __future__ import annotations

import dataclasses
import html
import json
import math
import re
import shutil
import subprocess
import typing
from pathlib import Path

import numpy as np
import pytest

from acausal.visual import shapes
from acausal.visual.animation import Animation, MovingBody, write_html
from acausal.visual.geometry import rotated, support_points
from tests.test_visual import ALL_SHAPES, TIMES, N, everything, pendulum, read, turning, unpacked


def test_page_loads_nothing_and_forbids_the_browser_to(tmp_path):
    reader, _ = read(write_html(pendulum(), tmp_path / "deep" / "p.html"))
    assert reader.loads == []
    assert "default-src 'none'" in reader.policy
    own = "\n".join(script for script in reader.scripts if "WebGLProgram" not in script)
    for word in ("http:", "https:", "fetch(", "XMLHttpRequest", "import(", "import ", "WebSocket", "url("):
        assert word not in own


def test_numbers_survive_the_way_into_the_page(tmp_path):
    animation = pendulum()
    _, data = read(write_html(animation, tmp_path / "p.html"))
    assert np.array_equal(unpacked(data["times"], 1)[:, 0], TIMES.astype("f4"))
    for body, stored in zip(animation.bodies, data["bodies"], strict=True):
        assert stored["name"] == body.name
        assert np.array_equal(unpacked(stored["p"], 3), body.positions.astype("f4"))
        assert np.array_equal(unpacked(stored["q"], 4), body.quaternions.astype("f4"))
    for link, stored in zip(animation.links, data["links"], strict=True):
        assert stored["kind"] == link.kind
        assert np.array_equal(unpacked(stored["a"], 3), link.starts.astype("f4"))
        assert np.array_equal(unpacked(stored["b"], 3), link.ends.astype("f4"))
    assert np.array_equal(unpacked(data["trails"][0]["p"], 3), animation.trails[0].points.astype("f4"))
    assert data["joints"][0]["axis"] == [0, 1, 0]


@pytest.mark.parametrize(
    "nasty",
    [
        "</script><img src=x onerror=alert(1)>",
        "<!--<script>",
        "/*DATA*/null <!--TITLE--> /*THREE*/",
        "a & b \"c\" 'd' \\1 \u2028 ü",
    ],
)
def test_names_and_titles_stay_text(tmp_path, nasty):
    plain, _ = read(write_html(pendulum(), tmp_path / "plain.html"))
    reader, data = read(write_html(pendulum(nasty, nasty), tmp_path / "nasty.html"))
    assert reader.tags == plain.tags
    assert len(reader.scripts) == len(plain.scripts)
    assert reader.texts["title"] == nasty and nasty in reader.texts["b"]
    assert data["title"] == nasty and data["bodies"][0]["name"] == nasty


def test_scripts_use_only_what_the_bundle_and_the_page_offer(tmp_path):
    folder = Path(shapes.__file__).parent
    own = (folder / "viewer.js").read_text() + (folder / "solids.js").read_text()
    reader, _ = read(write_html(pendulum(), tmp_path / "p.html"))
    assert {type(shape) for shape in ALL_SHAPES} == set(typing.get_args(shapes.Shape))
    exported = set(re.findall(r"(\w+):\(\)=>", (folder / "three.bundle.min.js").read_text()))
    assert set(re.findall(r"THREE\.(\w+)", own)) <= exported
    assert set(re.findall(r'byId\("(\w+)"\)', own)) <= reader.ids
    for kind in typing.get_args(shapes.Shape):
        assert re.search(rf"\b{kind.__name__}:", own), f"solids.js does not draw {kind.__name__}"
    for opening, closing in ("()", "[]", "{}"):
        assert own.count(opening) == own.count(closing)


def run_browser(browser: str, page: Path) -> str:
    """The page's document after its scripts ran."""
    flags = [
        "--headless",
        "--no-sandbox",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--disable-background-networking",
        "--disable-dev-shm-usage",
    ]
    profile = page.parent / "profile"
    command = [
        browser,
        *flags,
        f"--user-data-dir={profile}",
        "--timeout=20000",
        "--virtual-time-budget=3000",
        "--dump-dom",
        page.as_uri(),
    ]
    return subprocess.run(command, capture_output=True, text=True, timeout=110, check=True).stdout


def browser_path() -> str | None:
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


def check_in_browser(browser: str, folder: Path) -> None:
    """The page draws, and puts a body where the data says."""
    animation = everything()
    animation = dataclasses.replace(animation, links=pendulum().links, joints=pendulum().joints, trails=pendulum().trails)
    page = write_html(animation, folder / "p.html")
    probe = """<script>try {
        acausal.seek(1.03);
        const gl = document.querySelector("canvas").getContext("webgl2"), w = gl.drawingBufferWidth, h = gl.drawingBufferHeight, seen = new Uint8Array(4 * w * h);
        gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, seen);
        let coloured = 0;
        for (let i = 0; i < seen.length; i += 4) if (Math.max(seen[i], seen[i + 1], seen[i + 2]) - Math.min(seen[i], seen[i + 1], seen[i + 2]) > 60) coloured++;
        const extents = Object.fromEntries(acausal.bodies.map((name) => [name, acausal.extentOf(name)])), still = acausal.camera();
        acausal.follow("Torus");
        document.body.dataset.probe = JSON.stringify({ ...acausal.poseOf("Box"), coloured: coloured / (w * h), still, extents, following: acausal.camera(), torus: acausal.poseOf("Torus").position });
    } catch (e) { if (!acausal.error) showError(String(e)); }</script>"""
    page.write_text(page.read_text(encoding="utf-8").replace("</body>", probe + "</body>"), encoding="utf-8")
    document = run_browser(browser, page)
    problem = re.search(r'id="error"[^>]*>([^<]*)<', document)[1]
    if "WebGL" in problem:  # a browser without 3-D must say so, in words, and nothing else may be wrong
        assert "switched off" in problem
        return
    assert problem == ""
    assert 'data-ready="true"' in document
    pose = json.loads(html.unescape(re.search(r'data-probe="([^"]*)"', document)[1]))
    # quaternions about a fixed axis are interpolated exactly
    assert np.allclose(pose["quaternion"], turning((1 / math.sqrt(3),) * 3, np.array([1.03]))[0], atol=1e-6)
    assert np.allclose(pose["position"], [0, 0, 1], atol=1e-6)
    assert pose["coloured"] > 0.01
    # the camera that follows a body looks at it, from where it looked before
    assert np.allclose(pose["following"]["target"], pose["torus"], atol=1e-6)
    for body in animation.bodies:
        assert_drawn_as_far_as_it_reaches(animation, body, np.array(pose["quaternion"]), pose["extents"][body.name])
    sight = [np.subtract(pose[k]["position"], pose[k]["target"]) for k in ("still", "following")]
    assert np.allclose(sight[0], sight[1], atol=1e-6)


def assert_drawn_as_far_as_it_reaches(
    animation: Animation, body: MovingBody, quaternion: np.ndarray, extent: list[list[float]]
) -> None:
    """The mesh in the page has the bounds that the camera and the ground's height were chosen by."""
    directions = np.vstack([-np.eye(3), np.eye(3)])
    back = rotated(np.tile(quaternion * [1, -1, -1, -1], (6, 1)), directions)
    points = support_points(body.shapes[0], back, animation.thickness())
    expected = np.sum(points * back, axis=1) + directions @ body.positions[0]
    drawn = np.array([*np.negative(extent[0]), *extent[1]])
    # round things are polyhedra in the page, and balls have bands that stand out
    assert np.allclose(drawn, expected, rtol=0, atol=0.03 * np.ptp(points) + 1e-6), body.name


def check_without_browser(folder: Path) -> None:
    """Scripts parse (by node, if there is one), and the data are complete."""
    page = write_html(everything(), folder / "p.html")
    reader, data = read(page)
    assert all(len(unpacked(body["q"], 4)) == N for body in data["bodies"])
    assert all(math.isfinite(data[k]) for k in ("size", "floor", "thickness", "speed"))
    node = shutil.which("node")
    for k, script in enumerate(reader.scripts):
        if node is not None:
            (folder / f"{k}.js").write_text(script, encoding="utf-8")
            subprocess.run([node, "--check", str(folder / f"{k}.js")], check=True, capture_output=True, timeout=60)
        else:
            assert script.count("`") % 2 == 0


@pytest.mark.slow
def test_page_runs_where_there_is_a_browser_and_is_complete_anyway(tmp_path):
    browser = browser_path()
    if browser is not None:
        check_in_browser(browser, tmp_path)
    check_without_browser(tmp_path)
