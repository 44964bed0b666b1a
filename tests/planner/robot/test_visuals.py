"""Visuals are for pictures alone: with any fault in them, the robot is planned, and a note names what is not drawn."""

from __future__ import annotations

from pathlib import Path

import pytest

from hdplan import InputError, RobotSpec, load_robot
from hdplan.planner.robot.loads import with_loads
from hdplan.planner.view.drawing.skins import visual_skins

ARM = """<robot name="a"><material name="m"><color rgba="0 0 1 1"/></material>{top}<link name="b">
<visual><geometry><box size="1 1 1"/></geometry><material name="m"/></visual></link><link name="l">
{visual}<collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision>{inertial}</link>
<joint name="j" type="revolute"><parent link="b"/><child link="l"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def arm(folder: Path, visual: str = "", top: str = "", inertial: str = "") -> RobotSpec:
    (folder / "arm.urdf").write_text(ARM.format(visual=visual, top=top, inertial=inertial))
    return RobotSpec(urdf=folder / "arm.urdf")


@pytest.mark.parametrize(
    ("visual", "drawn"),
    [
        ('<visual><geometry><capsule radius="0.1" length="0.2"/></geometry></visual>', True),
        ('<visual><geometry><sphere radius="0.1"/></geometry><material/></visual>', True),
        ('<visual><geometry><sphere radius="0.1"/></geometry><material name="none"/></visual>', True),
        ('<visual><geometry><sphere radius="0.1"/></geometry><material name="t"><texture/></material></visual>', True),
        ('<visual frob="1"><geometry><sphere radius="0.1"/></geometry></visual>', True),
        ('<visual><geometry><mesh filename="package://none/a.dae"/></geometry></visual>', False),
        ('<visual><geometry><mesh filename="gone.stl" scale="1 1"/></geometry></visual>', False),
        ('<visual><origin xyz="0 0 x"/><geometry><sphere radius="0.1"/></geometry></visual>', False),
        ('<visual><geometry><torus radius="0.1"/></geometry></visual>', False),
        ('<visual><geometry><sphere radius="-1"/></geometry></visual>', False),
        ("<visual/>", False),
    ],
)
def test_a_robot_is_planned_whatever_its_visuals_are(tmp_path: Path, visual: str, drawn: bool) -> None:
    spec = arm(tmp_path, visual)
    robot = load_robot(spec)
    assert robot.links == ("l",)
    skins, left_out = visual_skins(robot, spec)
    assert {skin.link for skin in skins} == {"b", "l"}
    assert next(skin.color for skin in skins if skin.link == "b") == (0, 0, 255)
    assert (left_out == ()) == drawn
    if not drawn:
        assert left_out[0].startswith("link 'l': ")
        assert left_out[1:] == ("drawn by their collision geometry: l",)


def test_a_material_that_is_there_twice_is_no_concern(tmp_path: Path) -> None:
    spec = arm(tmp_path, top='<material name="m"><color rgba="1 0 0 1"/></material>')
    assert load_robot(spec).n == 1
    assert len(visual_skins(load_robot(spec), spec)[0]) == 1


def test_an_inertia_that_no_body_has_gives_no_torques(tmp_path: Path) -> None:
    inertia = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="{}"/></inertial>'
    robot = load_robot(arm(tmp_path, inertial=inertia.format(3)))
    assert robot.impossible == ("l",)
    with pytest.raises(InputError, match=r"limits\.torque: no body has the inertia of link 'l' of arm: "):
        with_loads(robot, None, ())
    robot = load_robot(arm(tmp_path, inertial=inertia.format(2)))
    assert robot.impossible == ()
    assert with_loads(robot, None, ()).inertias[1].mass == 1.0
