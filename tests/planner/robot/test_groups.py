"""Joints that are planned: those of the group that is named; the others are held where the request has them."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hdplan import Attached, Box, InputError, RobotSpec, Scene, Trajectory, Within, load_robot, load_scene, plan
from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.poses import Pose, compose, from_rpy
from hdplan.scenes.targets import JointTarget, PoseTarget

from ..urdf import joint_text, link_text, write_robot

LIFT = ("root", "lift", "column", "prismatic", (0.0, 0.0, 0.2))
JOINTS = [  # parent, joint, child, kind, place in the parent
    ("root", "mount", "shelf_foot", "fixed", (1.0, 2.0, 0.0)),
    ("shelf_foot", "bracket", "camera", "fixed", (0.0, 0.0, 1.5)),
    LIFT,
    ("column", "left_a", "left_1", "revolute", (0.0, 0.3, 0.3)),
    ("left_1", "left_b", "left_2", "revolute", (0.4, 0.0, 0.0)),
    ("left_2", "left_tool", "left_tip", "fixed", (0.4, 0.0, 0.0)),
    ("column", "right_a", "right_1", "revolute", (0.0, -0.3, 0.3)),
    ("right_1", "right_b", "right_2", "revolute", (0.4, 0.0, 0.0)),
    ("right_2", "right_tool", "right_tip", "fixed", (0.4, 0.0, 0.0)),
    ("left_tip", "thumb", "left_thumb", "prismatic", (0.1, 0.0, 0.0)),
]
GROUPS = """
<group name="left"><joint name="left_a"/><joint name="left_b"/></group>
<group name="right"><link name="right_1"/><link name="right_2"/></group>
<group name="left_chain"><chain base_link="column" tip_link="left_tip"/></group>
<group name="left_lifted"><chain base_link="root" tip_link="left_tip"/></group>
<group name="across"><chain base_link="right_tip" tip_link="left_tip"/></group>
<group name="both"><group name="left"/><group name="right"/></group>
<group name="all_of_it"><group name="both"/><joint name="lift"/><joint name="thumb"/></group>
<group name="tools"><joint name="left_tool"/></group>
<group_state name="down" group="all_of_it"><joint name="lift" value="0.2"/></group_state>
<group_state name="up" group="all_of_it"><joint name="left_a" value="0.3"/><joint name="left_b" value="0.1"/>
<joint name="lift" value="0.5"/></group_state>
"""
MEMBERS = {
    "left": {"left_a", "left_b"},
    "right": {"right_a", "right_b"},
    "left_chain": {"left_a", "left_b"},
    "left_lifted": {"lift", "left_a", "left_b"},
    "across": {"lift", "left_a", "left_b", "right_a", "right_b"},  # MoveIt takes the joint above the common link too
    "both": {"left_a", "left_b", "right_a", "right_b"},
    "all_of_it": {"lift", "left_a", "left_b", "right_a", "right_b", "thumb"},
}
MOVABLE = [joint for _, joint, _, kind, _ in JOINTS if kind != "fixed"]
START = {joint: 0.05 + 0.02 * i for i, joint in enumerate(MOVABLE)}


@pytest.fixture
def two_arms(tmp_path: Path) -> RobotSpec:
    """Two arms on a lift."""
    links = sorted({"root", *(child for _, _, child, _, _ in JOINTS)})
    parts = [link_text(name, box="0.3 0.05 0.05" if name.endswith(("1", "2")) else "") for name in links]
    for parent, name, child, kind, place in JOINTS:
        turn = "0.1 0.2 0.3" if kind == "fixed" else "0 0 0"
        parts.append(joint_text(name, parent, child, kind=kind, at=" ".join(map(str, place)), rpy=turn))
    write_robot(tmp_path / "pair.urdf", *parts)
    (tmp_path / "pair.srdf").write_text(f'<robot name="pair">{GROUPS}</robot>')
    return RobotSpec(urdf=tmp_path / "pair.urdf", srdf=tmp_path / "pair.srdf")


Loading = Callable[..., Scene]


@pytest.fixture
def moveit(two_arms: RobotSpec, tmp_path: Path) -> Loading:
    """Load a MoveIt problem of that robot: the goal's joints, the group, objects and whatever else is given."""

    def load(
        goal: dict[str, float] | None = None,
        group: str = "",
        objects: list[Any] | None = None,
        constraints: dict[str, Any] | None = None,
        base: dict[str, Any] | None = None,
        start: dict[str, float] | None = None,
        path: dict[str, Any] | None = None,
        **section: Any,
    ) -> Scene:
        start = START | (start or {})
        joints = [{"joint_name": joint, "position": value} for joint, value in (goal or {}).items()]
        scene = {"robot_model_name": "pair", "world": {"collision_objects": objects or []}}
        request = {
            "group_name": group,
            "start_state": {"joint_state": {"name": list(start), "position": list(start.values())}},
            "goal_constraints": [constraints or {"joint_constraints": joints}],
            "path_constraints": path or {},
        }
        robot = {"urdf": str(two_arms.urdf), "srdf": str(two_arms.srdf), "base": base or {}, **section}
        robot = {key.removeprefix("own_"): value for key, value in robot.items()}
        for name, content in (("scene", scene), ("request", request), ("robot", {"robot": robot})):
            (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(content))
        return load_scene(tmp_path / "scene.yaml", tmp_path / "request.yaml", tmp_path / "robot.yaml")

    return load


@pytest.mark.parametrize("group", MEMBERS)
def test_a_group_is_its_joints_links_chains_and_groups(two_arms: RobotSpec, group: str) -> None:
    for name in (group, f"pair_{group}"):  # MoveIt's own configurations put the robot's name before it
        robot = load_robot(replace(two_arms, group=name))
        assert set(robot.joint_names) == MEMBERS[group]
        assert list(robot.joint_names) == [joint for joint in robot.joint_names if joint in MOVABLE]
        assert set(robot.locked) == set(MOVABLE) - MEMBERS[group]
        assert f"planned joints: those of the SRDF's group '{group}'" in robot.notes


def test_a_group_that_is_not_there_is_refused_with_the_nearest(two_arms: RobotSpec, moveit: Loading) -> None:
    for name, near in (("lift_chain", "left_chain"), ("pair_bth", "both")):
        with pytest.raises(InputError, match=rf"robot\.group: unknown group '{name}' \(did you mean '{near}'\?\)"):
            load_robot(replace(two_arms, group=name))
        with pytest.raises(InputError, match=rf"request\.yaml: group_name: unknown group '{name}' .*'{near}'"):
            moveit({"left_a": 0.0}, name)
    with pytest.raises(InputError, match=r"robot\.group: the group 'tools' has no joint that can be planned"):
        load_robot(replace(two_arms, group="tools"))


def test_a_group_that_no_srdf_defines_is_refused() -> None:
    """An unknown group is never planned as all joints of the robot: tiago's 42, fingers and head, are not its arm."""
    for name in ("ur5", "tiago"):
        with pytest.raises(InputError, match=rf"robot\.group: no SRDF of {name} says which joints the group 'arm' has"):
            load_robot(RobotSpec(name=name, group="arm"))


@pytest.mark.parametrize("group", MEMBERS)
def test_the_group_is_planned_and_the_rest_held_at_the_start(moveit: Loading, group: str) -> None:
    goal = {joint: START[joint] + 0.1 for joint in MEMBERS[group]}
    scene = moveit(goal, group)
    robot = load_scene_robot(scene)
    assert set(robot.joint_names) == MEMBERS[group]
    assert robot.locked == {joint: START[joint] for joint in MOVABLE if joint not in MEMBERS[group]}
    query = Setup.of(scene, robot).query
    np.testing.assert_array_equal(query.start, [START[joint] for joint in robot.joint_names])
    np.testing.assert_array_equal(query.goal, [goal[joint] for joint in robot.joint_names])


@pytest.mark.parametrize("group", ["left", "right", "across"])
def test_a_goal_for_a_joint_that_is_held_is_met_or_refused(moveit: Loading, group: str) -> None:
    """Plan and certificate refuse it alike; it is never left out."""
    goal = {joint: START[joint] + 0.1 for joint in MEMBERS[group]}
    for joint in set(MOVABLE) - MEMBERS[group]:
        scene = moveit({**goal, joint: START[joint]}, group)
        robot = load_scene_robot(scene)
        query = Setup.of(scene, robot).query
        motion = Trajectory(robot.joint_names, np.array([query.start, query.goal]), robot.locked)
        certify(scene, motion, robot)
        for off in (1e-5, -0.3):
            request = moveit({**goal, joint: START[joint] + off}, group)
            message = rf"goal \(.*request\.yaml\): joint '{joint}' is given .*, but is not planned and held at "
            with pytest.raises(InputError, match=message):
                plan(request, time_limit=1.0)
            with pytest.raises(InputError, match=message):
                certify(request, motion, load_scene_robot(request))


def test_a_start_that_the_robots_own_section_contradicts_is_refused(moveit: Loading) -> None:
    scene = moveit({"left_a": 0.2, "left_b": 0.2}, "left", locked={"lift": 0.4})
    with pytest.raises(InputError, match=r"start .*: joint 'lift' is given the value 0.05, but is not .* held at 0.4"):
        plan(scene)
    goal = {"right_a": 0.2, "right_b": 0.2}
    with pytest.raises(InputError, match=r"group_name: is 'left', but the robot's own section says 'right'"):
        moveit(goal, "left", own_group="right")
    for group in ("", "right", "pair_right"):
        assert moveit(goal, group, own_group="right").robot.group == "right"


def test_a_value_for_a_joint_that_the_robot_lacks_is_left_out_with_a_note(moveit: Loading) -> None:
    scene = moveit({"left_a": 0.2, "left_b": 0.2, "wheel": 3.0}, "left", start={"caster": 1.0})
    (note,) = Setup.of(scene).left_out
    assert "wheel" in note
    assert "caster" in note


def test_a_named_state_that_speaks_of_joints_held_elsewhere_says_so(two_arms: RobotSpec) -> None:
    for locked, notes in (({}, ("goal: state 'up' has lift at 0.5, held at 0.2",)), ({"lift": 0.1}, ())):
        scene = Scene(robot=replace(two_arms, group="left", locked=locked), start=[0.0, 0.0], goal="up")
        assert Setup.of(scene).left_out == notes


# --- frames -----------------------------------------------------------------------------------------------------------

BASE = {"position": [0.3, -0.2, 0.9], "rpy": [0.4, -0.3, 1.57]}
GOAL = {"left_a": 0.2, "left_b": 0.2}
PLACED = {"position": [0.6, -0.1, 0.4], "orientation": [0.5, 0.5, -0.5, 0.5]}


def thing(frame: str | None, pose: dict[str, Any] = PLACED) -> dict[str, Any]:
    header = {} if frame is None else {"header": {"frame_id": frame, "stamp": {"secs": 0, "nsecs": 0}}}
    return {"id": "thing", **header, "pose": pose, "primitives": [{"type": "box", "dimensions": [0.1, 0.2, 0.3]}]}


def as_pose(pose: dict[str, Any]) -> Pose:
    return Pose(tuple(pose["position"]), tuple(pose["orientation"]))


@pytest.mark.parametrize("base", [{}, BASE])
@pytest.mark.parametrize("frame", ["root", "/root", "shelf_foot", "camera"])
def test_an_object_in_a_still_frame_is_where_that_frame_is(moveit: Loading, frame: str, base: dict[str, Any]) -> None:
    """Objects, regions, orientations and boxes along the way; the frame's place by Pinocchio's own reading."""
    region = {"primitives": [{"type": "box", "dimensions": [0.2, 0.2, 0.2]}], "primitive_poses": [PLACED]}
    header = {"header": {"frame_id": frame}}
    place = {"link_name": "left_tip", "constraint_region": region, **header}
    turn = {"link_name": "left_tip", "orientation": PLACED["orientation"], **header}
    turn |= {f"absolute_{axis}_axis_tolerance": 0.1 for axis in "xyz"}
    goal = {"position_constraints": [place], "orientation_constraints": [turn]}
    path = {"position_constraints": [place]}
    scene = moveit(group="left", objects=[thing(frame)], constraints=goal, base=base, path=path)
    robot = load_scene_robot(scene)
    link = robot.model.frames[robot.model.getFrameId(frame.removeprefix("/"))]
    assert link.parentJoint == 0
    expected = link.placement.homogeneous @ as_pose(PLACED).matrix
    (obstacle,) = scene.obstacles
    np.testing.assert_allclose(obstacle.pose.matrix, expected, atol=1e-12)
    assert obstacle.shape == Box((0.1, 0.2, 0.3))
    (target,) = scene.goal.targets
    assert isinstance(target, PoseTarget)
    np.testing.assert_allclose(target.pose.matrix, expected, atol=1e-12)
    assert isinstance(scene.path.position, Within)
    np.testing.assert_allclose(scene.path.position.pose.matrix, expected, atol=1e-12)


def test_the_robot_and_what_stands_on_it_move_together(moveit: Loading) -> None:
    """The same distances wherever the base stands, for objects in the frame of the root; for others not."""
    found = []
    for frame, base in (("root", {}), ("root", BASE), ("world", {}), ("world", BASE), (None, BASE)):
        scene = moveit(GOAL, "left", objects=[thing(frame)], base=base)
        robot = load_scene_robot(scene)
        place, _ = Certifier(Setup.of(scene, robot)).nearest(Setup.of(scene, robot).query.start)
        found.append(place.distance if place else None)
    moved_along, fixed = found[:2], found[2:]
    np.testing.assert_allclose(moved_along, found[0], atol=1e-9)
    assert fixed[0] == pytest.approx(found[0], abs=1e-9)
    assert fixed[1] == fixed[2] != pytest.approx(found[0], abs=1e-3)


@pytest.mark.parametrize(
    ("frame", "message"), [("column", "'column' moves"), ("left_tip", "moves"), ("cameras", "'camera'")]
)
def test_a_frame_that_moves_or_is_not_known_is_refused(moveit: Loading, frame: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"collision_objects\[0\]\.header\.frame_id: .*{message}"):
        moveit(GOAL, "left", objects=[thing(frame)])


def test_frames_of_the_scene_hang_on_others(moveit: Loading, tmp_path: Path) -> None:
    base = Pose(tuple(BASE["position"]), from_rpy(*BASE["rpy"]))
    with pytest.raises(InputError, match="unknown frame 'marker'"):
        moveit(GOAL, "left", objects=[thing("marker")], base=BASE)
    content = yaml.safe_load((tmp_path / "scene.yaml").read_text())
    shift = {"translation": {"x": 1.0, "y": 0.0, "z": 0.0}, "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    content["fixed_frame_transforms"] = [
        {"header": {"frame_id": "root"}, "child_frame_id": "root", "transform": {}},
        {"header": {"frame_id": "root"}, "child_frame_id": "marker", "transform": shift},
    ]
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content))
    (obstacle,) = load_scene(tmp_path / "scene.yaml", tmp_path / "request.yaml", tmp_path / "robot.yaml").obstacles
    expected = compose(compose(base, Pose((1.0, 0.0, 0.0))), as_pose(PLACED))
    np.testing.assert_allclose(obstacle.pose.matrix, expected.matrix, atol=1e-12)


# --- joints by their names, states of a group, what the start says of joints that are held ----------------------------


def test_joints_may_be_named_instead_of_a_group(two_arms: RobotSpec) -> None:
    """They are in the robot's order, not the list's, with or without an SRDF; an unknown name is refused."""
    for spec in (two_arms, replace(two_arms, srdf=None)):
        for group in (("left_a", "right_b"), ["right_b", "left_a"]):
            robot = load_robot(replace(spec, group=group))
            assert robot.joint_names == ("left_a", "right_b")
            assert set(robot.locked) == set(MOVABLE) - {"left_a", "right_b"}
        with pytest.raises(InputError, match=r"robot\.group\[1\]: unknown joint 'left_c' \(did you mean 'left_"):
            load_robot(replace(spec, group=("left_a", "left_c")))
        with pytest.raises(InputError, match=r"robot\.group\[0\]: joint 'left_tool' cannot be planned: it is fixed"):
            load_robot(replace(spec, group=("left_tool",)))
        with pytest.raises(InputError, match=r"robot\.group\[0\]: joint 'lift' is held by robot\.locked"):
            load_robot(replace(spec, group=("lift",), locked={"lift": 0.1}))
    for names, message in (((), "not be empty"), (("lift", "lift"), r"\[1\]: the joint 'lift' appears twice")):
        with pytest.raises(InputError, match=message):
            replace(two_arms, group=names)
    fingers = tuple(load_robot(RobotSpec(name="panda")).locked)
    with pytest.raises(InputError, match=r"\[1\].*it is a mimic joint, which follows 'panda_finger_joint1'"):
        load_robot(RobotSpec(name="panda", group=fingers))
    hand = load_robot(RobotSpec(name="panda", group=fingers[:1]))
    assert (hand.joint_names, hand.followers) == (fingers[:1], fingers[1:])


def test_a_group_of_joints_is_read_and_written(two_arms: RobotSpec, tmp_path: Path) -> None:
    scene = Scene(robot=replace(two_arms, group=("left_a", "lift")), start=[0.0, 0.0], goal=[0.1, 0.1])
    scene.save(tmp_path / "pair.yaml")
    assert load_scene(tmp_path / "pair.yaml") == scene
    text = (tmp_path / "pair.yaml").read_text()
    (tmp_path / "pair.yaml").write_text(text.replace('"lift"]', "3]"))
    with pytest.raises(InputError, match=r"pair\.yaml: robot\.group\[1\]: must be a text"):
        load_scene(tmp_path / "pair.yaml")


def circular(spec: RobotSpec, groups: str) -> RobotSpec:
    spec.urdf.with_name("circle.srdf").write_text(f'<robot name="pair">{groups}</robot>')
    return replace(spec, srdf=spec.urdf.with_name("circle.srdf"))


def test_groups_that_contain_themselves_are_refused(two_arms: RobotSpec) -> None:
    one = '<group name="a"><joint name="lift"/><group name="b"/></group>'
    for back in ("a", "b"):
        spec = circular(two_arms, f'{one}<group name="b"><group name="{back}"/></group>')
        with pytest.raises(InputError, match=r"circle\.srdf: group '(a|b)': contains itself: '(a|b)' contains '"):
            load_robot(spec)


def test_groups_within_groups_without_end(two_arms: RobotSpec) -> None:
    """Each holds the next one twice, which is the same as once; too many levels are refused."""
    names = [f"g{i}" for i in range(60)]
    twice = '<group name="{0}"><group name="{1}"/><group name="{1}"/></group>'
    text = "".join(twice.format(*each) for each in itertools.pairwise(names))
    robot = load_robot(replace(circular(two_arms, f'{text}<group name="g59"><joint name="lift"/></group>'), group="g0"))
    assert robot.joint_names == ("lift",)
    deep = "".join(f'<group name="g{i}"><group name="g{i + 1}"/></group>' for i in range(2000))
    with pytest.raises(InputError, match=r"group 'g0': groups within groups, more than 64 levels deep"):
        load_robot(circular(two_arms, deep))


def test_a_group_or_chain_of_what_is_not_there_is_named_in_a_note(two_arms: RobotSpec) -> None:
    inside = '<joint name="lift"/><group name="bb"/><chain base_link="root" tip_link="left_tipp"/>'
    hand = '<end_effector name="e" parent_link="left_2" group="aa"/>'
    spec = circular(two_arms, f'<group name="a">{inside}</group>{hand}')
    robot = load_robot(replace(spec, group="a"))
    assert robot.joint_names == ("lift",)
    notes = "\n".join(robot.notes)
    assert "groups that nothing defines: 'aa' (did you mean 'a'?), 'bb'" in notes
    assert "'left_tipp' (did you mean 'left_tip'?)" in notes


STATES = """<group_state name="home" group="left"><joint name="left_a" value="0.1"/><joint name="left_b" value="0.2"/>
</group_state><group_state name="home" group="both"><joint name="left_a" value="0.3"/><joint name="left_b" value="0.4"/>
<joint name="right_a" value="0.5"/><joint name="right_b" value="0.6"/></group_state>"""


def test_pairs_of_a_link_are_disabled_by_default_and_enabled_again_as_moveit_reads_them(two_arms: RobotSpec) -> None:
    """Each later one of `disable_default_collisions`, `enable_collisions` and `disable_collisions` overrides."""
    links = {"left_1", "left_2", "right_1", "right_2"}
    _with(
        two_arms,
        '<disable_default_collisions link="left_2"/><enable_collisions link1="left_2" link2="right_1"/>'
        '<enable_collisions link1="left_2" link2="right_2"/><disable_collisions link1="right_2" link2="left_2"/>',
    )
    robot = load_robot(two_arms)
    disabled = {pair for pair, reason in robot.unchecked.items() if reason == "the SRDF"}
    assert {pair for pair in disabled if {*pair} <= links} == {("left_2", "right_2")}  # and left_1, its neighbour
    assert ("left_2", "right_1") in robot.self_pairs
    assert ("left_1", "right_2") in robot.self_pairs


def test_passive_joints_are_never_planned(two_arms: RobotSpec) -> None:
    _with(two_arms, '<passive_joint name="left_b"/>')
    for group in (None, "left", "both"):
        robot = load_robot(replace(two_arms, group=group))
        assert "left_b" not in robot.joint_names
        assert robot.locked["left_b"] == 0.1  # the state's
    with pytest.raises(InputError, match=r"robot\.group\[0\]: joint 'left_b' cannot be planned: .*passive"):
        load_robot(replace(two_arms, group=("left_b",)))


def test_a_mimic_joint_held_elsewhere_than_it_would_follow_is_named(two_arms: RobotSpec) -> None:
    """A follower of a fixed joint stands at its offset; one of a joint that is not there is held, with a word."""
    text = two_arms.urdf.read_text() if two_arms.urdf else ""

    def follow(joint: str, followed: str) -> None:
        head = f'<joint name="{joint}" type="prismatic">'
        mimic = f'<mimic joint="{followed}" multiplier="2" offset="0.1"/>'
        two_arms.urdf.write_text(text.replace(head, head + mimic))

    follow("thumb", "left_b")
    robot = load_robot(replace(two_arms, locked={"left_b": 0.2}))
    assert robot.locked["thumb"] == 0.5
    assert not any("following" in note for note in robot.notes)
    off = load_robot(replace(two_arms, locked={"left_b": 0.2, "thumb": 0.0}))
    assert "joint 'thumb' is held at 0; following 'left_b' it would be at 0.5" in off.notes
    follow("thumb", "left_tool")
    assert load_robot(two_arms).locked["thumb"] == 0.1
    follow("thumb", "left_c")
    lost = load_robot(two_arms)
    assert lost.locked["thumb"] == 0.0
    assert "joints that mimic one that pair does not have, held: thumb" in lost.notes


def _with(spec: RobotSpec, more: str) -> None:
    spec.srdf.write_text(spec.srdf.read_text().replace("</robot>", f"{more}</robot>"))


@pytest.mark.parametrize("turned", [False, True])
def test_a_state_is_looked_up_in_its_group_first(two_arms: RobotSpec, turned: bool) -> None:
    """The SRDF's order does not matter."""
    first, second = (f"{part}</group_state>" for part in STATES.split("</group_state>")[:2])
    both = GROUPS + (second + first if turned else first + second)
    two_arms.srdf.write_text(f'<robot name="pair">{both}</robot>')
    home = JointTarget("goal", state="home")
    for group, q in (("left", [0.1, 0.2]), ("both", [0.3, 0.4, 0.5, 0.6]), ("right", [0.5, 0.6])):
        robot = load_robot(replace(two_arms, group=group))
        np.testing.assert_array_equal(robot.configuration(home), q)


def test_joints_that_the_start_names_beside_the_group_are_held_there(two_arms: RobotSpec) -> None:
    spec = replace(two_arms, group="left")
    start = {joint: START[joint] for joint in MOVABLE}
    scene = Scene(robot=spec, start=start, goal={"left_a": 0.2, "left_b": 0.3})
    robot = load_scene_robot(scene)
    assert robot.locked == {joint: START[joint] for joint in MOVABLE if joint not in MEMBERS["left"]}
    np.testing.assert_array_equal(Setup.of(scene).query.start, [START["left_a"], START["left_b"]])
    same = scene.with_goal({"left_a": 0.2, "left_b": 0.3, "lift": START["lift"]})
    np.testing.assert_array_equal(Setup.of(same).query.goal, [0.2, 0.3])
    for goal, locked, message in (
        ({"left_a": 0.2, "left_b": 0.3, "lift": 0.5}, {}, "goal: joint 'lift' is given the value 0.5, but is not"),
        ({"left_a": 0.2, "left_b": 0.3}, {"lift": 0.5}, "start: joint 'lift' is given the value 0.05, but is"),
        ({"left_a": 0.2, "left_b": 0.3, "lft": 0.5}, {}, r"goal: unknown joint 'lft' \(did you mean 'lift'"),
    ):
        with pytest.raises(InputError, match=message):
            _ = Setup.of(Scene(robot=replace(spec, locked=locked), start=start, goal=goal)).query


@pytest.mark.core
def test_links_of_joints_beside_the_group_count_in_the_certificate(two_arms: RobotSpec) -> None:
    """The right arm, held: where the start has it, it is in the left one's way or not."""
    spec = replace(two_arms, group="left", ignore_pairs=(("left_1", "left_2"), ("right_1", "right_2")))
    ends = {"left_a": -0.9, "left_b": 0.0}, {"left_a": 0.5, "left_b": 0.0}
    motion = Trajectory(("left_a", "left_b"), np.array([[each["left_a"], 0.0] for each in ends]))
    for right, free in ((-1.0, True), (0.9, False)):
        scene = Scene(robot=spec, start={**ends[0], "right_a": right, "right_b": 0.0}, goal=ends[1])
        judged = certify(scene, motion)
        assert judged.certified is free, judged.text
        stick = Attached("stick", "right_2", Box((1.5, 0.05, 0.05)), [0.0, 0.3, 0.0])
        assert not certify(replace(scene, attached=[stick]), motion).certified


def test_many_missing_joints_are_not_all_listed() -> None:
    spec = RobotSpec(name="talos_full_v2_box", group=tuple(load_robot("talos_full_v2_box").joint_names))
    robot = load_robot(spec)
    assert robot.n > 20
    for target in (JointTarget("start", by_name={robot.joint_names[0]: 0.0}), JointTarget("start", (0.0,))):
        with pytest.raises(InputError, match=r"^start: .* more; robot\.group .* robot\.locked holds others$") as caught:
            robot.configuration(target)
        assert sum(joint in str(caught.value) for joint in robot.joint_names) < 12
