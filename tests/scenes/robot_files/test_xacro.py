"""Robots described in xacro: read by ROS's library, with arguments and packages, each load for itself."""

from __future__ import annotations

import math
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.yaml_format.reader import load_scene

NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
ARM = f"""<robot name="x" {NAMESPACE}><xacro:include filename="sizes.xacro"/><link name="l0"/>
<xacro:macro name="segment" params="i"><link name="l${{i}}"><collision><geometry><sphere radius="${{r}}"/></geometry>
</collision></link><joint name="j${{i}}" type="revolute"><parent link="l${{i-1}}"/><child link="l${{i}}"/>
<origin xyz="0 0 0.5"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></xacro:macro>
<xacro:segment i="1"/><xacro:segment i="2"/></robot>"""
# of one joint, with a ball whose radius comes from wherever `{radius}` says
BALL = f"""<robot name="x" {NAMESPACE}>{{before}}<link name="l0"/><link name="l1"><collision><geometry>
<sphere radius="{{radius}}"/></geometry></collision></link><joint name="j" type="revolute"><parent link="l0"/>
<child link="l1"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture
def arm(tmp_path: Path) -> RobotSpec:
    (tmp_path / "arm.urdf.xacro").write_text(ARM)
    (tmp_path / "sizes.xacro").write_text(f'<robot {NAMESPACE}><xacro:property name="r" value="0.1"/></robot>')
    return RobotSpec(urdf=tmp_path / "arm.urdf.xacro")


def package(folder: Path, name: str, radius: float = 0.1) -> Path:
    """A package with a robot whose size stands in another file of the package."""
    (folder / "urdf").mkdir(parents=True)
    (folder / "package.xml").write_text(f"<package><name>{name}</name></package>")
    (folder / "urdf" / "size.xacro").write_text(
        f'<robot {NAMESPACE}><xacro:property name="r" value="{radius}"/></robot>'
    )
    include = f'<xacro:include filename="$(find {name})/urdf/size.xacro"/>'
    (folder / "urdf" / "arm.xacro").write_text(BALL.format(before=include, radius="${r}"))
    return folder / "urdf" / "arm.xacro"


def radius(robot: Robot) -> float:
    (ball,) = (item.geometry for item in robot.collision.geometryObjects)
    return float(ball.radius)


def test_without_the_library_the_message_tells_how_to_get_it(arm: RobotSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(InputError, match=r"arm\.urdf\.xacro: xacro files need xacro, .*: pip install xacro$"):
        load_robot(arm)


def test_macros_properties_and_includes_are_read(arm: RobotSpec) -> None:
    robot = load_robot(arm)
    assert robot.name == "arm"
    assert robot.joint_names == ("j1", "j2")
    assert robot.links == ("l1", "l2")
    assert [Path(file).name for file, *_ in robot.files] == ["arm.urdf.xacro", "sizes.xacro"]


def test_faults_in_a_xacro_are_reported_in_one_line(arm: RobotSpec, capfd: pytest.CaptureFixture[str]) -> None:
    assert arm.urdf is not None
    for text, message in (
        (ARM.replace("${r}", "${radius}"), "xacro: name 'radius' is not defined"),
        (ARM.replace("${r}", "$(arg size)"), r"xacro: the argument 'size' has no value; robot\.xacro_args: \{size: "),
        (ARM.replace("${r}", "$(env NO_SUCH)"), "xacro: .*'NO_SUCH' is not set"),
        (ARM.replace("sizes.xacro", "size.xacro"), r"xacro: .*size\.xacro"),
        (ARM.replace("sizes.xacro", "$(find none)/a"), r"xacro: package 'none' is not found in .*robot\.package_dirs"),
        (ARM.replace("<xacro:segment", "<xacro:segmnt"), r"xacro: .*segmnt"),
        (f'<robot name="x" {NAMESPACE}><xacro:macro name="m"/></robot>', "holds no <link>"),
        (ARM[:-20], "xacro: "),
    ):
        arm.urdf.write_text(text)
        with pytest.raises(InputError, match=rf"arm\.urdf\.xacro: {message}") as caught:
            load_robot(arm)
        assert "\n" not in str(caught.value)
    arm.urdf.write_text(ARM.replace('value="', 'whatever="').replace("<xacro:segment i", '<xacro:segment extra="1" i'))
    with pytest.raises(InputError):
        load_robot(arm)
    assert capfd.readouterr() == ("", "")


def test_arguments_are_kept_and_unknown_ones_refused(tmp_path: Path) -> None:
    file = tmp_path / "arm.xacro"
    before = '<xacro:arg name="r" default="0.1"/><xacro:property name="s" value="$(arg r)"/>'
    file.write_text(BALL.format(before=before, radius="${s}"))
    assert radius(load_robot(RobotSpec(urdf=file))) == 0.1
    assert radius(load_robot(RobotSpec(urdf=file, xacro_args={"r": 0.25}))) == 0.25
    assert radius(load_robot(RobotSpec(urdf=file, xacro_args={"r": "0.5"}))) == 0.5
    assert radius(load_robot(RobotSpec(urdf=file))) == 0.1  # no argument outlives its load
    with pytest.raises(InputError, match=r"the file does not use the argument 'R' \(did you mean 'r'\?\)"):
        load_robot(RobotSpec(urdf=file, xacro_args={"R": 0.2}))
    (tmp_path / "arm.urdf").write_text(BALL.format(before="", radius="1"))
    with pytest.raises(InputError, match=r"robot\.xacro_args: the file is not xacro"):
        load_robot(RobotSpec(urdf=tmp_path / "arm.urdf", xacro_args={"r": 0.2}))
    with pytest.raises(InputError, match=r"xacro_args\.r: must be a text, a number, true or false"):
        RobotSpec(urdf=file, xacro_args={"r": [1]})
    with pytest.raises(InputError, match="xacro_args: goes with 'urdf'"):
        RobotSpec(name="panda", xacro_args={"r": 1})
    assert RobotSpec(urdf=file, xacro_args={"a": True, "b": 1, "c": ""}).xacro_args == {"a": "true", "b": "1", "c": ""}


def test_a_scene_says_the_arguments(tmp_path: Path) -> None:
    before = '<xacro:arg name="r" default="0.1"/>'
    (tmp_path / "arm.xacro").write_text(BALL.format(before=before, radius="$(arg r)"))
    for size in (0.2, 0.3):
        (tmp_path / "scene.yaml").write_text(
            f"hdplan: 1\nrobot: {{urdf: arm.xacro, xacro_args: {{r: {size}}}}}\nstart: {{joints: [0]}}\n"
            "goal: {joints: [1]}\n"
        )
        assert radius(load_scene_robot(load_scene(tmp_path / "scene.yaml"))) == size


def test_each_checkout_of_a_package_has_its_own_files(tmp_path: Path) -> None:
    files = [package(tmp_path / str(k) / "pkg", "pkg", 0.1 * (k + 1)) for k in range(4)]
    for order in ([0, 1, 2, 3], [3, 0, 2, 1]):
        for k in order:
            assert radius(load_robot(RobotSpec(urdf=files[k]))) == pytest.approx(0.1 * (k + 1))
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda k: radius(load_robot(RobotSpec(urdf=files[k % 4]))), range(16)))
    assert found == pytest.approx([0.1 * (k % 4 + 1) for k in range(16)])


def test_a_file_changes_nothing_in_the_library(tmp_path: Path) -> None:
    spoilt, plain = tmp_path / "spoilt.xacro", tmp_path / "plain.xacro"
    spoilt.write_text(BALL.format(before="<!-- a --> ${math.update(tau=3)}", radius="${math.tau}"))
    plain.write_text(BALL.format(before="", radius="${math.tau}"))
    assert radius(load_robot(RobotSpec(urdf=spoilt))) == 3.0
    assert radius(load_robot(RobotSpec(urdf=plain))) == pytest.approx(2 * math.pi)


def test_files_and_environment_are_read_again_when_they_change(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "size.yaml").write_text("r: 0.25")
    yaml = '<xacro:property name="d" value="${xacro.load_yaml(\'size.yaml\')}"/>'
    file = tmp_path / "arm.xacro"
    file.write_text(BALL.format(before=yaml, radius="${d['r'] * float('$(optenv FACTOR 1)')}"))
    (tmp_path / "s.yaml").write_text("hdplan: 1\nrobot: {urdf: arm.xacro}\nstart: {joints: [0]}\ngoal: {joints: [1]}\n")
    scene = load_scene(tmp_path / "s.yaml")
    assert radius(load_scene_robot(scene)) == 0.25
    assert load_scene_robot(scene) is load_scene_robot(scene)
    (tmp_path / "size.yaml").write_text("r: 0.125")
    assert radius(load_scene_robot(scene)) == 0.125
    monkeypatch.setenv("FACTOR", "4")
    assert radius(load_scene_robot(scene)) == 0.5


def test_packages_are_found_as_ros_finds_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Named folders first, then above, ROS, and the neighbours of a workspace."""
    arm = package(tmp_path / "ws" / "src" / "repo" / "arm_description", "arm_description")
    arm.write_text(arm.read_text().replace("$(find arm_description)", "$(find sizes)"))

    def found(*folders: Path) -> float:
        return radius(load_robot(RobotSpec(urdf=arm, package_dirs=folders)))

    with pytest.raises(InputError, match=r"package 'sizes' is not found in above and beside .*arm_description;"):
        found()
    package(tmp_path / "ws" / "src" / "other" / "named_otherwise", "sizes", 0.2)
    assert found() == 0.2
    package(tmp_path / "ws" / "src" / "third", "sizes", 0.3)
    with pytest.raises(InputError, match=r"package 'sizes' is in two folders, .* says which"):
        found()
    (tmp_path / "ws" / "src" / "third" / "COLCON_IGNORE").touch()
    assert found() == 0.2
    package(tmp_path / "ament" / "share" / "sizes", "sizes", 0.4)
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(["/none", str(tmp_path / "ament")]))
    assert found() == 0.4
    package(tmp_path / "catkin" / "sizes", "sizes", 0.5)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "catkin"))
    assert found() == 0.5
    package(tmp_path / "ws" / "sizes", "sizes", 0.6)
    assert found() == 0.6
    assert found(tmp_path / "ament" / "share") == 0.4  # named: the folder that holds it,
    assert found(tmp_path / "catkin" / "sizes") == 0.5  # or the package itself
    within = arm.parent / "sizes" / "urdf"  # a folder of that name within the package is none
    within.mkdir(parents=True)
    (within / "size.xacro").write_text("<robot/>")
    assert found() == 0.6


def test_meshes_are_found_where_xacro_finds_them(tmp_path: Path) -> None:
    import trimesh

    arm = package(tmp_path / "src" / "arm", "arm_description")
    package(tmp_path / "src" / "repo" / "shapes", "arm_shapes")
    mesh = tmp_path / "src" / "repo" / "shapes" / "ball.stl"
    trimesh.creation.icosphere(1, 0.05).export(mesh)
    for address, text in (("package://arm_shapes/ball.stl", ""), ("file://$(find arm_shapes)/ball.stl", "")):
        arm.write_text(
            BALL.format(before=text, radius="1").replace('<sphere radius="1"/>', f'<mesh filename="{address}"/>')
        )
        (item,) = load_robot(RobotSpec(urdf=arm)).collision.geometryObjects
        assert item.meshPath == str(mesh)
    arm.write_text(arm.read_text().replace("ball.stl", "box.stl").replace("file://$(find arm_shapes)", "package://x"))
    with pytest.raises(InputError, match=r"mesh 'package://x/box\.stl': package 'x' is not found in"):
        load_robot(RobotSpec(urdf=arm))
