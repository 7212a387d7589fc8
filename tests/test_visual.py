"""The drawing layer: pages that need nothing else, numbers that survive, pictures that show something."""

from __future__ import annotations

import base64
import dataclasses
import html.parser
import json
import math
import re
import subprocess
import sys
import typing
from pathlib import Path

import numpy as np
import pytest

from acausal.errors import OptionError
from acausal.visual import shapes
from acausal.visual.animation import PALETTE, PLANE_COLOUR, Animation, JointMarker, MovingBody, MovingLink, Trail, write_html
from acausal.visual.geometry import rotated, support_points
from acausal.visual.picture import write_png
from acausal.visual.plot import plot_series
from acausal.visual.view import view_of

N = 41
TIMES = np.linspace(0.0, 2.0, N)
STILL = np.tile([1.0, 0.0, 0.0, 0.0], (N, 1))
ALL_SHAPES: tuple[shapes.Shape, ...] = (
    shapes.Box((0.6, 0.4, 0.2)),
    shapes.Sphere(0.3),
    shapes.Cylinder(0.2, 0.7, (1.0, 0.0, 0.0)),
    shapes.Disk(0.35, 0.08, (0.0, 1.0, 0.0)),
    shapes.Torus(0.3, 0.08, (0.0, 1.0, 0.0)),
    shapes.Ellipsoid((0.4, 0.25, 0.15)),
    shapes.Rod((-0.3, 0.0, 0.0), (0.3, 0.1, 0.0), 0.06),
    shapes.Arrow((-0.2, 0.1, 0.0), (0.4, 0.2, 0.1), 0.03),
    shapes.PointMass(),
    shapes.Polygon(((-0.3, -0.3, 0.0), (0.4, -0.2, 0.0), (0.0, 0.4, 0.0))),
    shapes.Plane((0.3, 0.0, 1.0), (0.5, 0.0, 0.0), 1.5),
    shapes.Wire(((-0.3, -0.3, 0.0), (0.4, -0.2, 0.0), (0.0, 0.4, 0.2))),
)


def turning(axis: tuple[float, float, float], angle: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4), scalar first."""
    return np.hstack([np.cos(angle / 2)[:, None], np.sin(angle / 2)[:, None] * np.array(axis)])


def pendulum(title: str = "Pendulum", name: str = "rod", scale: float = 1.0) -> Animation:
    """A rod that turns about y, with a ball, a spring, a joint and a trail."""
    q = turning((0.0, 1.0, 0.0), 0.8 * np.cos(3 * TIMES))
    origin = np.zeros((N, 3))
    tip = rotated(q, np.array([0.0, 0.0, -scale]))
    anchor = np.tile([1.2 * scale, 0.0, -0.4 * scale], (N, 1))
    return Animation(
        title, TIMES,
        (MovingBody(name, (shapes.Rod((0, 0, 0), (0, 0, -scale)),), origin, q), MovingBody("bob", (shapes.Sphere(0.1 * scale),), tip, q)),
        (MovingLink("spring", "spring", anchor, tip), MovingLink("damper", "damper", anchor, tip), MovingLink("string", "string", anchor, tip), MovingLink("force", "force", tip, tip + anchor)),
        (JointMarker("hinge", "hinge", origin, q, (0.0, 1.0, 0.0)),),
        (Trail("bob", tip),),
    )  # fmt: skip


def everything() -> Animation:
    """Every shape, each turning about a skew axis."""
    q = turning((1 / math.sqrt(3),) * 3, TIMES)
    placed = (
        dataclasses.replace(s, colour="crimson", position=(0.0, 0.0, 0.1), rotation=((0, -1, 0), (1, 0, 0), (0, 0, 1)))
        for s in ALL_SHAPES
    )
    bodies = [
        MovingBody(("Placed " if k >= len(ALL_SHAPES) else "") + type(s).__name__, (s,), np.tile([k % 4, k // 4, 1.0], (N, 1)), q)
        for k, s in enumerate((*ALL_SHAPES, *placed))
    ]
    return Animation("Everything", TIMES, tuple(bodies))


class Reader(html.parser.HTMLParser):
    """What a page loads, what it says, its ids and its scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.ids: set[str] = set()
        self.tags: list[str] = []
        self.scripts: list[str] = []
        self.texts: dict[str, str] = {}
        self.policy = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        named = dict(attrs)
        self.loads += [f"{tag} {k}" for k in ("src", "href", "srcset", "data", "action", "poster") if k in named]
        self.ids |= {named["id"] or ""} if "id" in named else set()
        if named.get("http-equiv") == "Content-Security-Policy":
            self.policy = named["content"] or ""

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1] == "script":
            self.scripts.append(data)
        elif self.tags:
            self.texts[self.tags[-1]] = self.texts.get(self.tags[-1], "") + data.strip()


def read(path: Path) -> tuple[Reader, dict[str, typing.Any]]:
    reader = Reader(path.read_text(encoding="utf-8"))
    return reader, json.loads(re.search(r"const DATA = (.*);\n", "\n".join(reader.scripts))[1])


def unpacked(text: str, width: int) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4").reshape(-1, width)


def assert_not_blank(path: Path) -> None:
    from matplotlib.image import imread

    pixels = imread(path)[..., :3]
    assert min(pixels.shape[:2]) > 100
    assert np.mean(np.any(np.abs(pixels - pixels[0, 0]) > 0.02, axis=2)) > 0.004


# ---- geometry


def test_support_points_reach_as_far_as_any_point_of_the_shape():
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for shape in ALL_SHAPES:
        points = support_points(shape, directions, 0.05)
        assert np.all(np.isfinite(points))
        # each support point reaches further along its own direction than all others do
        reach = points @ directions.T
        assert np.all(np.diag(reach) >= reach.max(axis=0) - 1e-12), shape
    ball = support_points(shapes.Ellipsoid((2.0, 2.0, 2.0)), directions)
    assert np.allclose(ball, support_points(shapes.Sphere(2.0), directions))


def test_support_points_turn_with_the_shape_of_an_offset():
    quarter = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    box = shapes.Box((4.0, 2.0, 2.0), position=(10.0, 0.0, 0.0), rotation=quarter)
    assert np.allclose((support_points(box, np.eye(3)) * np.eye(3)).sum(axis=1), [11.0, 2.0, 1.0])


@pytest.mark.parametrize("scale", [1e-3, 0.05, 1.0, 100.0])
def test_bounds_scale_with_the_mechanism(scale):
    low, high = pendulum(scale=scale).bounds()
    unit_low, unit_high = pendulum().bounds()
    # the arrow ends at tip + anchor: its length scales too
    assert np.allclose(low, scale * unit_low) and np.allclose(high, scale * unit_high)
    assert pendulum(scale=scale).thickness() == pytest.approx(scale * pendulum().thickness())
    assert pendulum(scale=scale).floor() <= low[2] + 1e-12


def test_planes_do_not_make_the_rest_small():
    floor = MovingBody("floor", (shapes.Plane((0, 0, 1), (0, 0, 0), 1e4),), np.zeros((N, 3)), STILL)
    with_floor = dataclasses.replace(pendulum(), bodies=(*pendulum().bodies, floor))
    assert with_floor.size() == pytest.approx(pendulum().size())


def test_planes_are_grey_and_take_no_colour_from_the_palette():
    floor = MovingBody("floor", (shapes.Plane((0, 0, 1), (0, 0, 0), 3.0),), np.zeros((N, 3)), STILL)
    own = MovingBody("own", (shapes.Box((1, 1, 1), colour="gold"),), np.zeros((N, 3)), STILL)
    plain, mixed = pendulum(), dataclasses.replace(pendulum(), bodies=(floor, own, *pendulum().bodies))
    assert mixed.colours()[0] == PLANE_COLOUR and mixed.colours()[1] == "gold"
    assert plain.colours() == PALETTE[:2] and mixed.colours()[2:] == PALETTE[1:3]


def test_only_a_plane_that_is_not_the_ground_has_squares_of_its_own(tmp_path):
    ball = MovingBody("ball", (shapes.Sphere(0.5),), np.tile([0.0, 0.0, 0.5], (N, 1)), STILL)
    for normal, height, squares in (((0, 0, 1), 0.0, False), ((0, 0, 1), 0.4, True), ((0.3, 0, 1), 0.0, True)):
        plane = MovingBody("plane", (shapes.Plane(normal, (0, 0, 0), 1.0),), np.tile([0.0, 0.0, height], (N, 1)), STILL)
        _, data = read(write_html(Animation("plane", TIMES, (ball, plane)), tmp_path / "p.html"))
        assert data["bodies"][1]["shapes"][0]["squares"] is squares


@pytest.mark.parametrize("make", [pendulum, everything])
def test_box_that_the_camera_is_fitted_to_holds_the_whole_motion(tmp_path, make):
    animation = make()
    _, data = read(write_html(animation, tmp_path / "p.html"))
    view = data["view"]
    for axis, low, high in zip(("right", "up", "towards"), view["low"], view["high"], strict=True):
        for path in [b.positions for b in animation.bodies] + [t.points for t in animation.trails]:
            along = path @ np.array(view[axis])
            assert low - 1e-9 <= along.min() and along.max() <= high + 1e-9


def test_planar_motion_is_seen_squarely_with_up_on_top():
    view = view_of(pendulum())
    assert np.allclose(view.towards, [0, -1, 0], atol=1e-9)  # x to the right, z up
    assert np.allclose(view.up, [0, 0, 1]) and np.allclose(view.right, [1, 0, 0], atol=1e-9)


@pytest.mark.parametrize("normal", [(1.0, 2.0, 2.0), (-1.0, -2.0, -2.0), (0.3, 1.0, -0.1), (0.0, 0.1, 1.0)])
def test_motion_in_a_tilted_plane_is_seen_squarely_from_above_the_ground(normal):
    n = np.array(normal) / np.linalg.norm(normal)
    arm = np.cross(n, [1.0, 0.0, 0.0])
    q = turning(tuple(n), TIMES)
    rod = MovingBody("rod", (shapes.Rod((0, 0, 0), tuple(arm)),), np.zeros((N, 3)), q)
    view = view_of(Animation("tilted", TIMES, (rod,)))
    assert view.planar and abs(view.towards @ n) == pytest.approx(1.0)
    assert view.towards[2] > 0 and view.up[2] >= 0


def test_rolling_on_a_line_is_seen_along_the_axle():
    angle = 2 * np.sin(TIMES)
    q = turning((0.0, 1.0, 0.0), angle)
    wheel = MovingBody(
        "wheel", (shapes.Disk(0.3, 0.05, (0, 1, 0)),), np.stack([0.3 * angle, 0 * angle, 0.3 + 0 * angle], axis=1), q
    )
    assert np.allclose(np.abs(view_of(Animation("roll", TIMES, (wheel,))).towards), [0, 1, 0], atol=1e-6)


def test_spatial_motion_is_seen_from_above_and_aside():
    view = view_of(everything())
    assert not view.planar
    assert np.allclose(np.cross(view.right, view.up), view.towards)
    assert 0.2 < view.towards[2] < 0.9


def test_wrong_arrays_are_named():
    with pytest.raises(OptionError, match="positions of body 'rod'"):
        Animation("x", TIMES, (MovingBody("rod", (), np.zeros((3, 3)), STILL),))
    with pytest.raises(OptionError, match="not finite from frame 7"):
        broken = STILL.copy()
        broken[7] = np.nan
        Animation("x", TIMES, (MovingBody("rod", (), np.zeros((N, 3)), broken),))
    with pytest.raises(OptionError, match="one of spring"):
        Animation("x", TIMES, (), (MovingLink("k", "sprung", np.zeros((N, 3)), np.zeros((N, 3))),))
    with pytest.raises(OptionError, match="increase"):
        Animation("x", TIMES[::-1], ())


# ---- pictures


@pytest.mark.parametrize("make", [pendulum, everything])
def test_picture_is_not_blank(tmp_path, make):
    assert_not_blank(write_png(make(), tmp_path / "p.png", times=(0.0, 1.0, 2.0)))


def test_empty_and_single_frame_scenes_are_drawn(tmp_path):
    write_png(Animation("nothing", TIMES, ()), tmp_path / "p.png")
    one = Animation(
        "one",
        TIMES[:1],
        (MovingBody("ball", (shapes.PointMass(),), np.zeros((1, 3)), STILL[:1]),),
        trails=(Trail("t", np.zeros((1, 3))),),
    )
    assert_not_blank(write_png(one, tmp_path / "q.png"))
    for animation in (one, Animation("nothing", TIMES, ())):
        _, data = read(write_html(animation, tmp_path / "p.html"))
        assert math.isfinite(data["floor"]) and data["size"] > 0


def test_picture_outside_of_the_motion_is_refused(tmp_path):
    with pytest.raises(OptionError, match="from 0 s to 2 s"):
        write_png(pendulum(), tmp_path / "p.png", times=(3.0,))


def test_plot_shows_every_series_with_its_label(tmp_path):
    figure = plot_series(TIMES, [("_angle $x$", TIMES), ("tip", np.zeros((N, 3)))], path=tmp_path / "p.png", title="50 $ and $")
    assert_not_blank(tmp_path / "p.png")
    assert len(figure.axes[0].lines) == 4
    assert len(figure.axes[0].get_legend().get_texts()) == 4
    with pytest.raises(OptionError, match="Series 'tip'"):
        plot_series(TIMES, [("tip", np.zeros((3, N)))])


def test_matplotlib_is_loaded_late_and_missed_in_words():
    code = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "matplotlib":
            raise ImportError(name)
sys.meta_path.insert(0, Missing())
import acausal.visual.animation, acausal.visual.picture, acausal.visual.graph, acausal.visual.page
from acausal.visual.plot import plot_series
import numpy as np
try:
    plot_series(np.zeros(2), [])
except ImportError as error:
    print(error)
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert "pip install" in result.stdout
