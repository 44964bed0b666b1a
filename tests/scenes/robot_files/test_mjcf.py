"""MJCF as URDF: bodies are where MuJoCo has them, and models that URDF cannot express are refused by name."""

from __future__ import annotations

import math
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.yaml_format.reader import read_robot


def load(folder: Path, text: str, head: str = "") -> Robot:
    (folder / "robot.xml").write_text(f"<mujoco model='m'>{head}{text}</mujoco>")
    return load_robot(RobotSpec(urdf=folder / "robot.xml"))


def placements(model: pin.Model, geometry: pin.GeometryModel, q: np.ndarray) -> list[np.ndarray]:
    data, placed = model.createData(), pin.GeometryData(geometry)
    pin.updateGeometryPlacements(model, data, geometry, placed, q)
    return [pose.homogeneous for pose in placed.oMg]


def sizes(geometry: object) -> tuple[float, ...]:
    match geometry:
        case coal.Box():
            return tuple(geometry.halfSide)
        case coal.Ellipsoid():
            return tuple(geometry.radii)
        case coal.Sphere():
            return (geometry.radius,)
        case coal.Capsule() | coal.Cylinder():
            return geometry.radius, geometry.halfLength
    raise AssertionError(geometry)


TURNED = """<worldbody><body name='a' pos='.1 .2 .3' euler='10 20 30'>
<joint name='s' type='slide' axis='1 2 2' range='-.2 .3'/><joint name='h' axis='0 3 4' pos='.1 .2 .3' range='-90 45'/>
<geom size='.1' pos='.1 .2 .3'/><body name='b' pos='1 0 0' zaxis='1 2 -.5'><joint name='t' axis='1 1 0'/>
<geom type='box' size='.1 .2 .3' pos='.3 .2 .1' euler='-40 50 60'/><body name='c' axisangle='1 2 3 70' pos='0 .5 0'>
<geom size='.1' pos='.1 .2 .3'/></body></body></body></worldbody>"""
MUJOCO = {  # geom_xpos of TURNED, and the diagonal of the box's geom_xmat, by MuJoCo 3.3.7 at qpos = (0.1, 0.2, 0.3)
    "xyz": "0.208621394 0.43219337 0.697015069 0.852186417 1.02160212 -0.237992808 "
    "0.338780955 1.208562448 -0.41536436 -0.092999865 0.167090156 -0.861704409",
    "ZYX": "0.305282687 0.289741908 0.716099437 1.029117068 0.873390297 -0.162101389 "
    "0.588312958 1.236859127 -0.221952423 -0.121381706 0.667267154 -0.284627837",
    "xYz": "0.22439139 0.42941446 0.69399127 0.896639408 0.969886399 -0.250355609 "
    "0.394263599 1.185169233 -0.427194088 -0.605027059 0.501986614 -0.879052551",
    "zxz": "0.055622611 0.348806151 0.746341473 0.883559454 1.151195999 0.192708508 "
    "0.431208638 1.346315074 -0.102769555 0.492594626 0.348883214 0.846432981",
}


@pytest.mark.core
@pytest.mark.parametrize("order", MUJOCO)
def test_bodies_are_where_mujoco_has_them(order: str, tmp_path: Path) -> None:
    """Axes of any length, every way to turn, several joints on a body, ranges of hinges in degrees."""
    robot = load(tmp_path, TURNED, f"<compiler eulerseq='{order}'/>")
    assert robot.joint_names == ("s", "h", "t")
    np.testing.assert_allclose(robot.lower, [-0.2, -math.pi / 2, -np.inf])
    np.testing.assert_allclose(robot.upper, [0.3, math.pi / 4, np.inf])
    placed = placements(robot.model, robot.collision, robot.pin_q([0.1, 0.2, 0.3]))
    *expected, diagonal = np.array(MUJOCO[order].split(), float).reshape(4, 3)
    np.testing.assert_allclose([pose[:3, 3] for pose in placed], expected, atol=2e-9)
    np.testing.assert_allclose(np.diag(placed[1])[:3], diagonal, atol=2e-9)


HAND = """<compiler meshdir="parts"/><default><default class="big"><geom size=".2"/></default></default>
<asset><mesh name="ball" file="ball.stl" scale="2 2 2"/></asset><worldbody><geom type="box" size="1 1 .1" pos="0 0 -1"/>
<body name="base" pos="1 2 3"><geom type="mesh" mesh="ball"/><geom contype="0" conaffinity="0" type="plane"/>
<body name="arm" childclass="big" pos="0 0 1"><joint name="slide" type="slide" range="-.2 .3"/>
<joint name="turn" pos=".1 0 0"/><geom/><body name="left"><joint name="l" axis="1 0 0" range="0 90"/><geom size=".1"/>
</body><body name="right"><joint name="r" type="slide" axis="1 0 0" range="0 1"/></body></body></body></worldbody>
<contact><exclude body1="base" body2="left"/></contact>
<equality><joint joint1="r" joint2="l" polycoef="0.1 -0.5 0 0 0"/></equality>"""


def test_a_model_of_joints_masks_defaults_and_pairs_is_read(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    trimesh.creation.icosphere(2, 0.1).export(tmp_path / "parts" / "ball.stl")
    robot = load(tmp_path, HAND)
    assert robot.joint_names == ("slide", "turn")
    assert robot.locked == {"l": 0.0, "r": 0.1}
    np.testing.assert_array_equal(robot.lower, [-0.2, -np.inf])
    np.testing.assert_array_equal(robot.upper, [0.3, np.inf])
    assert set(robot.links) == {"world", "base", "arm", "left"}
    assert robot.unchecked["base", "left"] == "the MJCF"
    (arm,), (left,), (base,) = (robot.link_geometry[link] for link in ("arm", "left", "base"))
    items = robot.collision.geometryObjects
    assert (items[arm].geometry.radius, items[left].geometry.radius) == (0.2, 0.1)
    items[base].geometry.computeLocalAABB()
    assert items[base].geometry.aabb_radius == pytest.approx(0.2, rel=0.01)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.pin_q([0.25, math.pi]))
    at = data.oMf[robot.model.getFrameId("arm")].translation
    np.testing.assert_allclose(at, [1.2, 2.0, 4.25], atol=1e-12)  # turned about (0.1, 0, 0)
    assert any("no masses: body 'base' has no inertial" in note for note in robot.notes)
    spec, _ = read_robot(tmp_path / "robot.xml")
    assert spec.urdf == tmp_path / "robot.xml"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('conaffinity="0" type="plane"', 'type="plane"', "body 'base': geom '1': type 'plane' is not supported"),
        ('<geom size=".1"/>', '<geom type="hfield" name="h"/>', "geom 'h': type 'hfield' is not supported"),
        ('type="mesh" mesh="ball"', 'type="box" mesh="ball"', "geom '0': type 'box fitted to a mesh' is not"),
        ('<geom size=".1"/>', '<geom size="-1"/>', r"geom '0': size must be a number greater than 0 .*'-1'"),
        ('<geom size=".1"/>', '<geom size="x"/>', "geom: size must be finite numbers, found 'x'"),
        ('mesh="ball"/>', 'mesh="bal"/>', "unknown mesh 'bal'"),
        ('name="l" axis', 'name="l" type="ball" axis', r"joint 'l': type 'ball' is not .*: hinge, slide"),
        ('name="l" axis', 'name="l" ref="x" axis', "joint 'l': ref must be finite numbers, found 'x'"),
        ('<joint name="turn"', '<freejoint/><joint name="turn"', "body 'arm': a free joint must be the only joint"),
        ('<joint name="l"', '<freejoint name="l"', r"freejoint 'l': attribute 'axis' is not known"),
        ('<joint name="turn"', '<composite/><joint name="turn"', "body 'arm': <composite> is not supported"),
        ("<contact>", "<include file='x'/><contact>", "include: .*x: no such file"),
        ('polycoef="0.1 -0.5 0', 'polycoef="0.1 -0.5 1', "equality: joint: not supported"),
        ('<joint joint1="r"', '<connect body1="base"/><joint joint1="r"', "equality: connect: not supported"),
        ('body2="left"', 'body2="lft"', "contact: exclude: unknown body 'lft'"),
        ('childclass="big"', 'childclass="bigg"', "unknown class 'bigg'"),
        ('name="left"', 'name="arm"', "body 'arm': the name is taken"),
        ('name="turn"', 'name="slide"', "joint 'slide': the name is taken"),
        ('<geom size=".1"/>', '<geom typ="box" size=".1 .1 .1"/>', r"'typ' is not known \(did you mean 'type'"),
        ('range="0 90"', 'rnage="0 90"', r"joint 'l': attribute 'rnage' is not known \(did you mean 'range'"),
        ('pos="0 0 1"', 'pso="0 0 1"', r"body 'arm': attribute 'pso' is not known \(did you mean 'pos'"),
        ('<geom size=".2"/>', '<goem size=".2"/>', r"default: element 'goem' is not known \(did you mean 'geom'"),
        ("<asset>", '<default><default class="big"/></default><asset>', "the class 'big' is defined twice"),
        ('pos="0 0 1"', 'pos="0 0"', "body 'arm': pos must be 3 finite numbers, found '0 0'"),
        ('pos="0 0 1"', 'quat="0 0 0 0"', "body 'arm': a direction must not be 0"),
        ('pos="0 0 1"', 'quat="1 0 0 0" zaxis="0 0 1"', "body 'arm': quat and zaxis say the same"),
    ],
)
def test_models_that_urdf_cannot_express_are_refused_by_name(old: str, new: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    trimesh.creation.icosphere(1, 0.1).export(tmp_path / "parts" / "ball.stl")
    assert HAND.count(old) == 1
    with pytest.raises(InputError, match=rf"^robot\.urdf: .*robot\.xml: .*{message}"):
        load(tmp_path, HAND.replace(old, new))


PLAIN = """<worldbody><geom name="floor" type="box" size="1 1 .1"/><body name="arm" pos="0 0 2"><joint name="j"/>
<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><geom name="g" class="own" {}/></body></worldbody>"""


def shape_of(robot: Robot, link: str) -> tuple[str, tuple[float, ...]]:
    (index,) = robot.link_geometry[link]
    geometry = robot.collision.geometryObjects[index].geometry
    return type(geometry).__name__, sizes(geometry)


def test_default_sections_are_merged_and_the_first_class_may_have_a_name(tmp_path: Path) -> None:
    """A class of a later section inherits the values of earlier ones, as in MuJoCo."""
    first = "<default class='all'><geom type='box' size='.1 .2 .3'/></default>"
    robot = load(
        tmp_path, PLAIN.format(""), first + "<default><default class='own'><geom rgba='1 0 0 1'/></default></default>"
    )
    assert shape_of(robot, "arm") == ("Box", (0.1, 0.2, 0.3))
    robot = load(tmp_path, PLAIN.replace("own", "all").format(""), first)
    assert shape_of(robot, "arm") == ("Box", (0.1, 0.2, 0.3))


def test_geoms_of_a_contact_pair_collide_whatever_their_masks(tmp_path: Path) -> None:
    head = "<default><default class='own'/></default>"
    text = PLAIN.format("contype='0' conaffinity='0' size='.2'")
    assert set(load(tmp_path, text, head).links) == {"world"}
    robot = load(tmp_path, text, head + "<contact><pair geom1='g' geom2='floor'/></contact>")
    assert shape_of(robot, "arm") == ("Sphere", (0.2,))


@pytest.mark.parametrize(
    "setting", ["inertiafromgeom='true'", "settotalmass='5'", "boundmass='2'", "balanceinertia='true'"]
)
def test_masses_that_the_compiler_changes_are_not_known(setting: str, tmp_path: Path) -> None:
    text, head = PLAIN.format("size='.2'"), "<default><default class='own'/></default>"
    assert load(tmp_path, text, head).model.inertias[1].mass == 1.0
    robot = load(tmp_path, text, f"<compiler {setting}/>{head}")
    assert robot.model.inertias[1].mass == 0.0
    assert any(note.startswith(f"no masses: compiler: {setting.partition('=')[0]} changes") for note in robot.notes)


def test_attributes_that_are_not_mujocos_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="geom 'g': attribute 'zzz' is not known"):
        load(tmp_path, PLAIN.format("size='.2' zzz='1'"), "<default><default class='own'/></default>")
