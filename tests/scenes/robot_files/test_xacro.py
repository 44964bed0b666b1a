"""Robots described in xacro: read by the xacrodoc library, or refused in one line without it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from hdplan.planner.robot.robot import load_robot
from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_spec import RobotSpec

NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
ARM = f"""<robot name="x" {NAMESPACE}><xacro:include filename="sizes.xacro"/><link name="l0"/>
<xacro:macro name="segment" params="i"><link name="l${{i}}"><collision><geometry><sphere radius="${{r}}"/></geometry>
</collision></link><joint name="j${{i}}" type="revolute"><parent link="l${{i-1}}"/><child link="l${{i}}"/>
<origin xyz="0 0 0.5"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></xacro:macro>
<xacro:segment i="1"/><xacro:segment i="2"/></robot>"""


@pytest.fixture
def arm(tmp_path: Path) -> RobotSpec:
    (tmp_path / "arm.urdf.xacro").write_text(ARM)
    (tmp_path / "sizes.xacro").write_text(f'<robot {NAMESPACE}><xacro:property name="r" value="0.1"/></robot>')
    return RobotSpec(urdf=tmp_path / "arm.urdf.xacro")


def test_without_the_library_it_is_said_how_to_get_it(arm: RobotSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(InputError, match=r"arm\.urdf\.xacro: xacro files need xacrodoc, .*: pip install xacrodoc$"):
        load_robot(arm)


def test_macros_properties_and_includes_are_read(arm: RobotSpec) -> None:
    pytest.importorskip("xacrodoc")
    robot = load_robot(arm)
    assert robot.name == "arm"
    assert robot.joint_names == ("j1", "j2")
    assert robot.links == ("l1", "l2")
    assert [Path(file).name for file, _, _ in robot.files] == ["arm.urdf.xacro", "sizes.xacro"]


def test_what_goes_wrong_in_it_is_said_in_one_line(arm: RobotSpec) -> None:
    pytest.importorskip("xacrodoc")
    assert arm.urdf is not None
    for text, said in (
        (ARM.replace("${r}", "${radius}"), "xacro: name 'radius' is not defined"),
        (ARM.replace("sizes.xacro", "size.xacro"), r"xacro: .*size\.xacro"),
        (ARM[:-20], "xacro: "),
    ):
        arm.urdf.write_text(text)
        with pytest.raises(InputError, match=rf"arm\.urdf\.xacro: {said}") as caught:
            load_robot(arm)
        assert "\n" not in str(caught.value)
