"""Robots of URDF files: their energies are those of their links by SciPy's rotations, so are the motions; what they lack or contradict is said by name."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import acausal as ac
from acausal.errors import InertiaWarning, MasslessError, ParameterError
from acausal.visual import shapes as drawn
from components import Mimic, Prismatic, Revolute, RigidBody, Robot, RotationalGround, TranslationalGround, World

G = 9.81


@dataclass
class Drawn:
    """A robot of random joints and links: its text, and energies of its own."""

    text: str = ""
    links: dict[str, tuple[float, np.ndarray, np.ndarray]] = field(default_factory=dict[str, Any])
    """Mass, centre and inertia about it, in the link's axes."""
    joints: list[tuple[str, str, str, str, np.ndarray, Rotation, np.ndarray]] = field(default_factory=list[Any])
    """Name, kind, parent, child, place, rotation, axis."""

    def energies(self, q: dict[str, float], v: dict[str, float]) -> tuple[float, float]:
        """Kinetic and potential, rates by differences of poses."""

        def poses(at: float) -> dict[str, tuple[np.ndarray, Rotation]]:
            found = {"base": (np.zeros(3), Rotation.identity())}
            for name, kind, parent, child, place, turned, axis in self.joints:
                x, R = found[parent]
                x, R, moved = x + R.apply(place), R * turned, q.get(name, 0.0) + at * v.get(name, 0.0)
                found[child] = (
                    (x, R * Rotation.from_rotvec(moved * axis)) if kind == "revolute" else (x + R.apply(moved * axis), R)
                )
            return found

        h = 1e-5
        here, before, after = poses(0.0), poses(-h), poses(h)
        kinetic = potential = 0.0
        for link, (mass, centre, inertia) in self.links.items():
            at = [x + R.apply(centre) for x, R in (before[link], here[link], after[link])]
            speed = (at[2] - at[0]) / (2 * h)
            turning = here[link][1].inv().apply((after[link][1] * before[link][1].inv()).as_rotvec()) / (2 * h)
            kinetic += 0.5 * mass * speed @ speed + 0.5 * turning @ inertia @ turning
            potential += mass * G * at[1][2]
        return kinetic, potential


def numbers(values: Any) -> str:
    return " ".join(repr(float(v)) for v in values)


def draw(seed: int, size: float) -> Drawn:
    """A tree of eight links, some without mass, joints of three kinds; lengths in `size`."""
    g, robot = np.random.default_rng(seed), Drawn()
    names, lines = ["base"], ['<link name="base"/>']
    for k in range(8):
        link = f"link-{k}/{seed}"
        mass, centre, rpy = g.uniform(0.5, 2), size * g.normal(size=3) * 0.1, g.uniform(-3, 3, 3)
        sides = size * g.uniform(0.1, 0.4, 3)
        xx, yy, zz = (float(mass / 12 * m) for m in sides @ sides - sides**2)
        R = Rotation.from_euler("xyz", rpy).as_matrix()
        moves = k > 5 or g.random() < 0.7
        heavy = moves or g.random() < 0.5
        if heavy:
            robot.links[link] = mass, centre, R @ np.diag([xx, yy, zz]) @ R.T
        body = (
            f'<inertial><origin xyz="{numbers(centre)}" rpy="{numbers(rpy)}"/><mass value="{mass!r}"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0"/></inertial>'
            if heavy
            else ""
        )
        lines.append(f'<link name="{link}">{body}</link>')
        parent, kind = str(g.choice(names)), str(g.choice(["revolute", "prismatic"])) if moves else "fixed"
        place, rpy, axis = size * g.normal(size=3) * 0.3, g.uniform(-3, 3, 3), g.normal(size=3)
        lines.append(
            f'<joint name="joint {k}" type="{kind}"><parent link="{parent}"/><child link="{link}"/><origin xyz="{numbers(place)}" rpy="{numbers(rpy)}"/><axis xyz="{numbers(axis)}"/></joint>'
        )
        robot.joints.append(
            (f"joint {k}", kind, parent, link, place, Rotation.from_euler("xyz", rpy), axis / np.linalg.norm(axis))
        )
        names.append(link)
    g.shuffle(lines)
    robot.text = f'<?xml version="1.0"?><robot name="drawn">{"".join(lines)}</robot>'
    return robot


def held_up(text: str, **options: Any) -> tuple[ac.System, Robot]:
    scene = ac.System()
    scene.world, scene.robot = World(gravity=(0, 0, -G)), Robot(text, **options)
    scene.connect(scene.world.frame, scene.robot.root)
    return scene, scene.robot


@pytest.mark.parametrize(("seed", "size"), [(0, 1.0), (1, 1e-3), (2, 1e3), (3, 1.0), (4, 1.0)])
def test_energies_are_those_of_the_links_in_the_file(seed: int, size: float) -> None:
    """At random places and speeds, so by Lagrange's equations the motion is theirs, too; it keeps them, and joints that are held are no joints."""
    drawn_robot, g = draw(seed, size), np.random.default_rng(100 + seed)
    kinds = {name: kind for name, kind, *_ in drawn_robot.joints if kind != "fixed"}
    stays = list(kinds)[1]
    held = {stays: 0.3 * (size if kinds[stays] == "prismatic" else 1.0)}
    scene, robot = held_up(drawn_robot.text, held=held)
    assert set(robot.joints) == set(kinds) - {stays} and set(robot.links) == set(drawn_robot.links)
    model = ac.build(scene)
    assert len(model.state_names) == 2 * len(robot.joints)
    q, v = ({n: g.uniform(-1, 1) * (size if kinds[n] == "prismatic" else 1.0) for n in robot.joints} for _ in range(2))
    start = {robot.joints[n].q: q[n] for n in q} | {robot.joints[n].v: v[n] for n in v}
    run = model.simulate(0.1 * np.sqrt(size), start=start, rtol=1e-10)
    kinetic, potential = drawn_robot.energies({**q, **held}, v)
    assert run.kinetic_energy[0] == pytest.approx(kinetic, rel=1e-8)
    end = {n: run[f"robot.joints.{n}.q"][-1].item() for n in q}, {n: run[robot.joints[n].v][-1].item() for n in v}
    after, fallen = drawn_robot.energies({**end[0], **held}, end[1])
    assert run.potential_energy[-1] - run.potential_energy[0] == pytest.approx(
        fallen - potential, abs=1e-11 * abs(kinetic + potential)
    )
    assert after + fallen == pytest.approx(kinetic + potential, rel=1e-8)


TWO_SLIDES = """<robot name="slides"><link name="ground"/>
<link name="a"><inertial><mass value="2"/></inertial></link><link name="b"><inertial><mass value="0.5"/></inertial></link>
<joint name="one" type="prismatic"><parent link="ground"/><child link="a"/><dynamics damping="{damping}" friction="{friction}"/>
  <limit lower="-1" upper="3" effort="7"/></joint>
<joint name="two" type="prismatic"><parent link="ground"/><child link="b"/><mimic joint="one" multiplier="-3" offset="0.4"/></joint>
</robot>"""


def test_what_mimics_follows_without_a_state_and_its_inertia_is_felt() -> None:
    """2 kg, and 0.5 kg three times as fast, are 6.5 kg: damped by 1.3 N s/m exp(-t / 5); rubbing with 1.3 N they stop after 5 s v."""
    scene, robot = held_up(TWO_SLIDES.format(damping=1.3, friction=0))
    one, two = robot.joints["one"], robot.joints["two"]
    model = ac.build(scene)
    assert len(model.state_names) == 2 and robot.limits["one"].lower == -1 and robot.limits["one"].effort == 7
    run = model.simulate(4.0, start={one.q: 0.5, one.v: 1.0}, rtol=1e-11)
    np.testing.assert_allclose(run[one.q].ravel(), 0.5 + 5 * (1 - np.exp(-run.t / 5)), rtol=1e-9)
    np.testing.assert_allclose(run[two.q], 0.4 - 3 * run[one.q], atol=1e-12)
    scene, robot = held_up(TWO_SLIDES.format(damping=0, friction=1.3))
    one = robot.joints["one"]
    run = ac.build(scene).simulate(4.0, start={one.q: 0.0, one.v: 0.6}, rtol=1e-11)
    assert run[one.q][-1].item() == pytest.approx(0.6**2 * 6.5 / (2 * 1.3), rel=1e-11) and abs(run[one.v][-1].item()) < 1e-15
    scene, robot = held_up(TWO_SLIDES.format(damping=0, friction=1.3), friction=False)
    one = robot.joints["one"]
    assert ac.build(scene).simulate(4.0, start={one.v: 0.6})[one.v][-1].item() == pytest.approx(0.6)


def test_who_mimics_what_is_held_is_held() -> None:
    robot = Robot(TWO_SLIDES.format(damping=1, friction=1), held={"one": 0.2})
    assert not robot.joints and not robot.mimics
    scene = ac.System()
    scene.world, scene.robot, scene.hinge = World(), robot, Revolute("y")
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, robot.root)
    run = ac.build(scene).simulate(0.1)
    assert run[robot.frame("b").position][0] == pytest.approx([0.4 - 0.6, 0, 0])


@pytest.mark.parametrize("of", ["turn", "slide"])
def test_flanges_of_any_kind_follow_one_another(of: str) -> None:
    """Weights on a hinge and a slide of a mixed pair: one equation of motion, (I + m ratio^2) a = - m g ratio."""
    scene, ratio, offset = ac.System(), 0.3, 0.1
    scene.world, scene.hinge, scene.rail = World(gravity=(0, 0, -G)), Revolute("z"), Prismatic("z")
    scene.wheel, scene.weight = RigidBody(1.0, (0.02,) * 3), RigidBody(0.7, (1e-3,) * 3)
    for joint, body in ((scene.hinge, scene.wheel), (scene.rail, scene.weight)):
        scene.connect(scene.world.frame, joint.frame_a)
        scene.connect(joint.frame_b, body.frame)
    lead, follow = (scene.hinge, scene.rail) if of == "turn" else (scene.rail, scene.hinge)
    scene.pair = Mimic(
        lead.flange, follow.flange, ratio if of == "turn" else 1 / ratio, offset if of == "turn" else -offset / ratio
    )
    run = ac.build(scene).simulate(1.0, rtol=1e-11)
    acceleration = -0.7 * G * ratio / (0.02 + 0.7 * ratio**2)
    turned = run[scene.hinge.q].ravel()
    np.testing.assert_allclose(turned - turned[0], acceleration * run.t**2 / 2, atol=1e-10)
    np.testing.assert_allclose(run[scene.rail.q].ravel(), ratio * turned + offset, atol=1e-12)


def test_solids_are_drawn_where_they_stand() -> None:
    text = """<robot name="r"><material name="red"><color rgba="1 0 0 1"/></material><link name="a"><inertial><mass value="1"/></inertial>
    <visual><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><geometry><box size="1 2 3"/></geometry><material name="red"/></visual>
    <visual><geometry><cylinder radius="0.1" length="2"/></geometry></visual><visual><geometry><sphere radius="0.3"/></geometry></visual>
    <visual><geometry><mesh filename="package://a.stl"/></geometry></visual></link></robot>"""
    box, cylinder, ball = Robot(text).links["a"].shapes()
    assert isinstance(box, drawn.Box) and box.size == (1, 2, 3) and box.position == (1, 2, 3) and box.colour == "#ff0000"
    np.testing.assert_allclose(box.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert isinstance(cylinder, drawn.Cylinder) and isinstance(ball, drawn.Sphere) and ball.radius == 0.3


def test_parts_in_a_dictionary_have_its_names(tmp_path: Any) -> None:
    (tmp_path / "two.urdf").write_text(TWO_SLIDES.format(damping=1, friction=1))
    scene, robot = held_up(tmp_path / "two.urdf")
    run = ac.build(scene).simulate(0.01, start={"robot.joints.one.q": 0.25})
    assert run[robot.joints["one"].q][0].item() == 0.25


LINK = '<link name="{}"/>'
JOINT = '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/>{}</joint>'


def said_of(inner: str) -> str:
    return f'<robot name="r">{inner}</robot>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot", "is no XML"),
        ("<sdf/>", "first element is <sdf>"),
        ('<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro/></robot>', "have xacro write"),
        (said_of(""), "it has no links"),
        (said_of(LINK.format("a") * 2), "two links are called 'a'"),
        (said_of("<link/>"), "a link has no name"),
        (said_of(LINK.format("a") + LINK.format("b")), "no joint holds 'a', 'b'"),
        (said_of(LINK.format("arm") + JOINT.format("j", "arm", "hand", "")), "joint 'j': There is no link 'hand'"),
        (
            said_of(LINK.format("a") + LINK.format("b") + JOINT.format("j", "a", "b", "") + JOINT.format("k", "a", "b", "")),
            "held by 'j' too",
        ),
        (
            said_of(LINK.format("a") + LINK.format("b") + JOINT.format("j", "a", "b", "") + JOINT.format("k", "b", "a", "")),
            "in a circle",
        ),
        (
            said_of(LINK.format("a") + LINK.format("b") + JOINT.format("j", "a", "b", '<origin xyz="1 x 2"/>')),
            'xyz="1 x 2" is not 3 numbers',
        ),
        (said_of(LINK.format("a") + LINK.format("b") + JOINT.format("j", "a", "b", '<axis xyz="0 0 0"/>')), "joint 'j'.*axis"),
        (
            said_of(LINK.format("a") + LINK.format("b") + JOINT.format("j", "a", "b", '<mimic joint="i"/>')),
            "mimics 'i', which is no joint",
        ),
        (said_of(LINK.format("a") + LINK.format("b") + JOINT.format("j", "a", "b", '<mimic joint="j"/>')), "mimics itself"),
        (
            said_of(LINK.format("a") + LINK.format("b") + JOINT.format("j", "a", "b", "").replace("revolute", "hinge")),
            "type is 'hinge'",
        ),
        (said_of('<link name="a"><inertial><mass value="-1"/></inertial></link>'), "link 'a': its mass is -1 kg"),
        (said_of('<link name="a"><inertial><mass value="nan"/></inertial></link>'), 'value="nan" is not 1 number'),
    ],
)
def test_what_cannot_be_is_said_by_name(text: str, words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        Robot(text)


def test_other_mistakes_are_said() -> None:
    robot = Robot(said_of('<link name="base"/>' + LINK.format("arm") + JOINT.format("elbow", "base", "arm", "")))
    with pytest.raises(ParameterError, match=r"no joint that moves 'elbw' .*Did you mean 'elbow'"):
        robot.joints["elbw"]
    with pytest.raises(ParameterError, match=r"no link with mass 'base' .*frame\(name\)"):
        robot.links["base"]
    good = TWO_SLIDES.format(damping=0, friction=0)
    for wrong, words in (
        ({"held": {"onee": 1.0}}, "Did you mean 'one'"),
        ({"held": ["one"]}, "Give names of joints"),
        ({"held": {"one": "x"}}, "place of 'one'"),
    ):
        with pytest.raises(ParameterError, match=words):
            Robot(good, **wrong)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ParameterError, match="cannot be read"):
        Robot("nowhere.urdf")
    scene, _ = held_up(said_of(LINK.format("a") + LINK.format("b") + JOINT.format("j", "a", "b", "")))
    with pytest.raises(MasslessError, match=r"robot\.joints\.j"):
        ac.build(scene)
    rod = '<link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="3"/></inertial></link>'
    with pytest.warns(InertiaWarning, match=r"link 'a': inertia has principal moments.*as it is written") as found:
        Robot(said_of(rod))
    assert found[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Robot(good)
    for flange in (3.0, RotationalGround(), None):
        with pytest.raises(ParameterError, match="Give the flange of a joint"):
            Mimic(flange, TranslationalGround().flange)  # pyright: ignore[reportArgumentType]
