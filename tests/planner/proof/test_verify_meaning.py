"""Scene, robot and motion mean to the checker what they mean to hdplan: what contradicts itself is rejected, and what
hdplan certifies is accepted whole."""

from __future__ import annotations

import dataclasses
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.verify import RejectedError
from hdplan.verify.kernel import least_distances
from hdplan.verify.reading import read_world
from hdplan.verify.scene import PLANNER
from hdplan.verify.verdict import statement

from .worlds import packed, read, rejects_unless, scene_files, unpacked, words_of

LINK = """<link name="{0}">
<collision><origin xyz="0 0 0.3"/><geometry><box size="0.05 0.05 0.4"/></geometry></collision></link>"""
LIMIT = '<limit lower="{0}" upper="{1}" velocity="1" effort="30"/>'
URDF = f"""<robot name="r">
<link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
{LINK.format("up")}{LINK.format("fore")}
<link name="finger"><collision><origin xyz="0 0 0.15"/><geometry><sphere radius="0.02"/></geometry></collision></link>
<joint name="a" type="revolute"><parent link="base"/><child link="up"/><axis xyz="0 1 0"/>{LIMIT.format(-2, 2)}</joint>
<joint name="b" type="continuous"><origin xyz="0 0 0.6"/><parent link="up"/><child link="fore"/><axis xyz="0 1 0"/>
{LIMIT.format(0, 0)}</joint>
<joint name="grip" type="prismatic"><origin xyz="0 0 0.5"/><parent link="fore"/><child link="finger"/>
<axis xyz="0 0 1"/>{LIMIT.format(0, 0.1)}</joint></robot>"""
SCENE: dict[str, Any] = {
    "robot": {"urdf": "r.urdf", "group": ["a", "b"], "locked": {"grip": 0.02}},
    "obstacles": [{"name": "o", "shape": {"type": "sphere", "radius": 0.1}, "pose": {"position": [1.5, 0, 0.3]}}],
    "start": {"joints": [0, 0.1]},
    "goal": {"joints": [0.5, 0.5]},
}
MOTION: dict[str, Any] = {"joint_names": ["a", "b"], "positions": [[0, 0.1], [0.5, 0.5]]}


def files(
    folder: Path, scene: dict[str, Any], motion: dict[str, Any] = MOTION, urdf: str = URDF, name: str = "r.urdf"
) -> tuple[Path, Path]:
    """Write a scene, with some keys changed, its robot and a motion."""
    return scene_files(folder, {**SCENE, **scene}, motion, {name: urdf})


def claimed(scene: Path, motion: Path, *claims: str) -> str:
    """Verdict of the checker on a proof that claims this, beside clearances."""
    head = {"clearance": 1e-3, "self_clearance": 1e-3, "claims": [*claims]}
    return statement(read(scene, motion), head)[0]


ELSEWHERE = {
    "start and locked": ({"start": {"joints": {"a": 0, "b": 0.1, "grip": 0.05}}}, {}),
    "goal and locked": ({"goal": {"joints": {"a": 0.5, "b": 0.5, "grip": 0.05}}}, {}),
    "one of the goals": ({"goal": {"joints": [{"a": 0.5, "b": 0.5, "grip": 0.05}]}}, {}),
    "motion and locked": ({}, {"locked": {"grip": 0.05}}),
    "a moving joint that is locked": (
        {"start": {"joints": {"a": 0, "b": 0.1}}, "goal": {"joints": {"a": 0.5, "b": 0.5}}},
        {"joint_names": ["a", "b", "grip"], "positions": [[0, 0.1, 0.02], [0.5, 0.5, 0.05]]},
    ),
    "a moving joint that the motion locks": ({}, {"locked": {"b": 0.1}}),
    "a joint of the motion that is none": ({}, {"locked": {"grip": 0.02, "gripp": 0.05}}),
    "a joint that does not get to its goal": (
        {"start": {"joints": {"a": 0, "b": 0.1}}, "goal": {"joints": {"a": 0.5, "b": 0.5}}},
        {"joint_names": ["a"], "positions": [[0], [0.5]]},
    ),
}


@pytest.mark.parametrize("kind", ELSEWHERE)
def test_a_joint_is_not_at_two_places(kind: str, tmp_path: Path) -> None:
    scene, motion = files(tmp_path, ELSEWHERE[kind][0], {**MOTION, **ELSEWHERE[kind][1]})
    with pytest.raises(hdplan.InputError):
        hdplan.certify(hdplan.load_scene(scene), hdplan.Trajectory.load(motion))
    with pytest.raises(RejectedError, match=r"'(grip|b|gripp)'|start|goal"):
        claimed(scene, motion, "start", "goal")


def test_a_joint_that_is_held_may_be_named_where_it_is(tmp_path: Path) -> None:
    named = {"joints": {"a": 0, "b": 0.1, "grip": 0.02}}, {"joints": {"a": 0.5, "b": 0.5, "grip": 0.02 + 5e-7}}
    rows = {"joint_names": ["grip", "a", "b"], "positions": [[0.02, 0, 0.1], [0.02 + 1e-7, 0.5, 0.5]]}
    for motion in (MOTION, {**MOTION, "locked": {"grip": 0.02}}, {**MOTION, **rows}):
        two = files(tmp_path, {"start": named[0], "goal": named[1]}, motion)
        assert hdplan.certify(hdplan.load_scene(two[0]), hdplan.Trajectory.load(two[1])).certified
        assert claimed(*two, "limits", "start", "goal").startswith("accepted:")


def test_words_for_links_excuse_no_held_object_of_that_name(tmp_path: Path) -> None:
    """Such as an SRDF with a tool that the URDF does not have."""
    (tmp_path / "r.srdf").write_text('<robot name="r"><disable_collisions link1="base" link2="tool"/></robot>')
    held = {"name": "tool", "link": "fore", "shape": {"type": "sphere", "radius": 0.1}, "touch_links": ["up"]}
    robot = {**SCENE["robot"], "srdf": "r.srdf"}
    scene, motion = files(tmp_path, {"robot": robot, "attached": [held]})
    world = read(scene, motion)
    pairs = {frozenset(world.pieces[i].name for i in pair) for pair in world.pairs.tolist()}
    assert frozenset(("base", "tool")) in pairs
    assert world.left_out["up", "tool"] == "touch_links"


XACRO = '<xacro:if value="1"><link name="spear"/></xacro:if>'


@pytest.mark.parametrize(
    ("before", "after"),
    [('name="r">', f'name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{XACRO}'), ("robot", "mujoco")],
)
def test_recipes_for_robots_are_not_taken_for_urdfs(before: str, after: str, tmp_path: Path) -> None:
    scene, motion = files(tmp_path, {}, MOTION, URDF.replace(before, after))
    with pytest.raises(RejectedError, match=r"not a URDF|xacro"):
        read_world(scene, motion)


@pytest.mark.parametrize("name", ["r.xml", "r.urdf.xacro"])
def test_a_robot_that_the_checker_does_not_read_needs_a_proof_that_has_it(name: str, tmp_path: Path) -> None:
    scene, motion = files(tmp_path, {"robot": {**SCENE["robot"], "urdf": name}}, MOTION, URDF, name)
    with pytest.raises(RejectedError, match="no proof that has it"):
        read_world(scene, motion)
    proof = hdplan.prove(scene, motion)
    taken = f"NOT read by the checker, but taken from the proof: the robot ({name})"
    assert proof.text.startswith(f"accepted in part; {taken}")
    assert words_of(scene, motion, proof.data) == proof.text


@pytest.mark.parametrize(
    ("limit", "path", "wrong"),
    [
        ({"velocity": 0.9}, ("velocity", 0), 1.0),
        ({"velocity": {"b": 0.9}}, ("velocity", 1), 1.0),
        ({"acceleration": [2, 3]}, ("acceleration", 1), 4.0),
        ({"position": {"b": [0, 0.6]}}, ("position", 1), [-1.0, 1.0]),
        ({"position": {"b": [0, 0.6]}}, ("position", 1), [None, 0.6]),
        ({"jerk": 9}, ("jerk", 0), None),
    ],
)
def test_limits_in_numbers_are_not_taken_from_a_proof(limit: Any, path: Any, wrong: Any, tmp_path: Path) -> None:
    robot = {**SCENE["robot"], "urdf": "r.urdf.xacro"}
    timed = {**MOTION, "times": [0, 9], "velocities": [[0, 0]] * 2, "accelerations": [[0, 0]] * 2}
    content = {"robot": robot, "limits": limit, "timing": {"duration": 9}}
    scene, motion = files(tmp_path, content, timed, URDF, "r.urdf.xacro")
    head, world, rest = unpacked(hdplan.prove(scene, motion).data)
    assert words_of(scene, motion, packed(head, world, rest)).startswith("accepted in part")
    rate, joint = path
    world["limits"][rate][joint] = wrong
    with pytest.raises(RejectedError, match=rf"limits\.{rate}"):
        words_of(scene, motion, packed(head, world, rest))


@pytest.mark.parametrize("between", ["\x0b", "\x0c", "\x1c", "\x85", "\u2028", "\r", ",\u00a00,0\n", '"\n"', "\x00"])
def test_rows_of_a_csv_file_end_where_every_reader_ends_them(between: str, tmp_path: Path) -> None:
    """Python knows more line ends and spaces than others, to whom there is another motion."""
    scene, _ = files(tmp_path, {}, MOTION)
    for rows, good in ((f"0,0.1{between}0.5,0.5\n", False), ("0,0.1\n0.5,0.5\n", True), ("0, 0.1\r\n0.5,.5\r\n", True)):
        (tmp_path / "m.csv").write_text(f"a,b\n{rows}", newline="")
        if good:
            assert len(read(scene, tmp_path / "m.csv").rows) == 2
            continue
        with pytest.raises(RejectedError):
            read_world(scene, tmp_path / "m.csv")
        with pytest.raises(hdplan.HdplanError):
            hdplan.Trajectory.load(tmp_path / "m.csv")


@pytest.mark.parametrize("space", ["\u00a0", "\u2003", "\u3000", "\u0660", "_"])
def test_numbers_of_a_urdf_stand_between_spaces_of_ascii(space: str, tmp_path: Path) -> None:
    assert URDF.count('xyz="0 0 0.3"')
    scene, motion = files(tmp_path, {}, MOTION, URDF.replace('xyz="0 0 0.3"', f'xyz="0 0{space}0.3"'))
    with pytest.raises(RejectedError, match=r"numbers are expected|is not a number"):
        read_world(scene, motion)


TURN = {"joints": [0.5, 0.5 + 4 * np.pi]}
WHOLE = {
    "whole turns": ({"goal": TURN}, {}),
    "several goals": ({"goal": {"joints": [[1, 1], {"a": 0.5, "b": 0.5}]}}, {}),
    "lines in time": ({"timing": {"duration": 2}}, {"times": [0, 2]}),
    "a limit that is none": (
        {"limits": {"velocity": None, "acceleration": 5, "position": None}},
        {"times": [0, 2], "velocities": [[0, 0], [0, 0]]},
    ),
}


@pytest.mark.parametrize("kind", WHOLE)
def test_certified_motions_are_proven_in_full(kind: str, tmp_path: Path) -> None:
    two = files(tmp_path, WHOLE[kind][0], {**MOTION, **WHOLE[kind][1]})
    assert hdplan.prove(*two).text.startswith("accepted:")


def test_rows_farther_apart_than_the_scene_says_are_named(tmp_path: Path) -> None:
    for rate, rows, message in ((2, 5, ""), (2, 4, "up to 0.6666666666666667 s apart, 2 in a second"), (None, 2, "")):
        timing = {"duration": 2} | ({} if rate is None else {"rate": rate})
        share = np.linspace(0, 1, rows)[:, None]
        way = (1 - share) * np.array(MOTION["positions"][:1]) + share * np.array(MOTION["positions"][1:])
        motion = {**MOTION, "times": (2 * share[:, 0]).tolist(), "positions": way.tolist()}
        proof = hdplan.prove(*files(tmp_path, {"timing": timing}, motion))
        assert proof.text.startswith("accepted:")
        assert ("timing.rate" in proof.text) == bool(message)
        assert message in proof.text


@pytest.mark.parametrize("word", ["<<: {radius: 0.2}, <<: {radius: 0.1}", "<<: {radius: 0.2}, '<<': {radius: 0.1}"])
def test_two_merges_of_one_mapping_are_refused_by_both(word: str, tmp_path: Path) -> None:
    """Some readers take the first value, and others the last."""
    scene, motion = files(tmp_path, {}, MOTION)
    scene.write_text(scene.read_text().replace('"radius": 0.1', word))
    assert word in scene.read_text()
    with pytest.raises(RejectedError, match="appears twice"):
        read_world(scene, motion)
    with pytest.raises(hdplan.HdplanError, match="<<"):
        hdplan.load_scene(scene)


def test_other_goals_and_speeds_are_not_proven(tmp_path: Path) -> None:
    """They are just beyond those that are proven."""
    for goal in ([0.5 + 2 * np.pi, 0.5], [0.5, 0.5 + 3.14], [0.5, 0.5 + 2 * np.pi + 2e-6], [[0.5, 0.51], [0.51, 0.5]]):
        with pytest.raises(RejectedError, match="goal"):
            claimed(*files(tmp_path, {"goal": {"joints": goal}}), "goal")
    with pytest.raises(RejectedError, match="start"):  # whole turns are for goals
        claimed(*files(tmp_path, {"start": {"joints": [0, 0.1 + 2 * np.pi]}}), "start")
    for seconds, good in ((0.501, True), (0.499, False)):
        two = files(tmp_path, {"timing": {"duration": seconds}}, {**MOTION, "times": [0, seconds]})
        with rejects_unless(good, "'a' is beyond it"):
            assert "velocity" in claimed(*two, "velocity")


@pytest.mark.parametrize(("own", "usual"), [(0.001, 0.3), (0.02, 0.01), (0.001, 0.01)])
def test_an_obstacle_may_require_less_than_the_others(own: float, usual: float, tmp_path: Path) -> None:
    """One is 76 mm away, the other one farther than required; a proof that claims so must keep it."""
    near = {**SCENE["obstacles"][0], "name": "near", "pose": {"position": [0.85, 0, 1.15]}, "clearance": own}
    content = {"obstacles": [*SCENE["obstacles"], near], "planner": {"clearance": usual}}
    two = files(tmp_path, content)
    proof = hdplan.prove(*two)
    assert proof.text.startswith("accepted:")
    assert ("; 299.999999 mm from obstacle o\n" in proof.text) == (usual == 0.3)  # the double 0.3 is below 0.3
    world = read(*two)
    least = least_distances(world, {"clearance": 1e-4, "self_clearance": 1e-4, "claims": ["clearance"]})
    for name, wanted in (("o", usual), ("near", own)):
        assert {x for x, (_, b) in zip(least, world.pairs, strict=True) if world.pieces[b].name == name} == {wanted}


def test_meshes_of_one_name_in_two_folders_are_two_files(tmp_path: Path) -> None:
    for folder, size in (("one", 0.1), ("two", 0.2)):
        (tmp_path / folder / "meshes").mkdir(parents=True)
        corners = "".join(f"v {x} {y} {z}\n" for x, y, z in (np.eye(4)[:, :3] * size).tolist())
        (tmp_path / folder / "meshes" / "m.obj").write_text(f"{corners}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    shape = {"type": "mesh", "file": "two/meshes/m.obj"}
    urdf = URDF.replace('<box size="0.1 0.1 0.1"/>', '<mesh filename="one/meshes/m.obj"/>')
    two = files(tmp_path, {"obstacles": [{**SCENE["obstacles"][0], "shape": shape}]}, MOTION, urdf)
    proof = hdplan.prove(*two)
    assert words_of(*two, proof.data) == proof.text
    (tmp_path / "two" / "meshes" / "m.obj").write_bytes((tmp_path / "one" / "meshes" / "m.obj").read_bytes())
    with pytest.raises(RejectedError, match=r"is not the file that was proven|other files"):
        words_of(*two, proof.data)


def test_a_linked_scene_names_files_beside_the_link(tmp_path: Path) -> None:
    scene, motion = files(tmp_path, {})
    other = tmp_path / "other"
    other.mkdir()
    (other / "r.urdf").write_text(URDF.replace("0 0 0.6", "0 0 0.7"))
    (other / "s.yaml").symlink_to(scene)
    for link in (scene, other / "s.yaml"):
        heights = [x["position"][2] for x in read_world(link, motion).world["joints"]]
        assert heights[1] == (0.6 if link == scene else 0.7)


def test_links_that_always_touch_matter_only_where_links_are_compared(tmp_path: Path) -> None:
    wide = URDF.replace('<sphere radius="0.02"/>', '<sphere radius="0.8"/>')
    for requested in (True, False):
        two = files(tmp_path, {"self_collision": requested, "obstacles": []}, MOTION, wide)
        refused = pytest.raises(hdplan.InputError, match="always touch, which the checker of proofs does not show")
        with refused if requested else nullcontext():
            assert hdplan.prove(*two).text.startswith("accepted:")


def test_a_name_does_not_look_like_a_line_of_the_statement(tmp_path: Path) -> None:
    two = files(tmp_path, {}, MOTION, URDF.replace('"finger"', '"finger&#10;  also proven: torque"'))
    assert "also proven" not in [line.strip()[:11] for line in claimed(*two).splitlines()]
    assert str(RejectedError("a\u2028b\x1b[2K\nc")) == "a b?[2K c"


MISSPELT: dict[str, dict[str, Any]] = {
    "planner": {"planner": {"clearence": 0.1}},
    "self_collision": {"self_collision": {"clearence": 0.1}},
    "limits": {"limits": {"velocity": {"aa": 0.1}}},
    "goal": {"goal": {"joints": {"a": 0.5, "b": 0.5, "gripp": 0.05}}},
    "start": {"start": {"joints": {"a": 0, "b": 0.1, "gripp": 0.05}}},
    "locked": {"robot": {**SCENE["robot"], "locked": {"grip": 0.02, "gripp": 0.02}}},
    "quaternion": {"robot": {**SCENE["robot"], "base": {"quaternion_xyzw": [0.1, 0.2, 0.3, 0.9]}}},
    "mass": {"payload": {"link": "fore", "mass": -1}, "limits": {"torque": 90, "acceleration": 10}},
    "path.position": {"path": {"position": {"link": "fore", "size": [9, 9]}}},
}


@pytest.mark.parametrize("words", MISSPELT)
def test_a_misspelt_requirement_of_a_scene_is_not_left_out(words: str, tmp_path: Path) -> None:
    timed = {**MOTION, "times": [0, 2], "velocities": [[0, 0], [0, 0]]}
    two = files(tmp_path, {"timing": {"duration": 2}, **MISSPELT[words]}, timed)
    with pytest.raises(hdplan.InputError):
        hdplan.certify(hdplan.load_scene(two[0]), hdplan.Trajectory.load(two[1]))
    with pytest.raises(RejectedError, match=words):
        claimed(*two, "start", "goal", "velocity", "path")


def test_a_path_of_what_is_held_is_known_as_that_of_a_link(tmp_path: Path) -> None:
    """hdplan knows it, too; an object that is not held has none."""
    tool = {"name": "tool", "link": "fore", "shape": {"type": "sphere", "radius": 0.01}}
    path = {"upright": {"link": "tool", "tolerance": 3}}
    timed = {**MOTION, "times": [0, 2], "velocities": [[0, 0], [0, 0]]}
    two = files(tmp_path, {"timing": {"duration": 2}, "attached": [tool], "path": path}, timed)
    assert hdplan.certify(hdplan.load_scene(two[0]), hdplan.Trajectory.load(two[1])).path
    assert "path" in claimed(*two, "start", "goal", "velocity", "path")
    two = files(tmp_path, {"timing": {"duration": 2}, "path": path}, timed)
    with pytest.raises(RejectedError, match="'tool' is not a link of the world, and not held"):
        claimed(*two, "start", "goal", "velocity", "path")


def test_the_planner_s_keys_are_those_of_the_planner() -> None:
    assert PLANNER.split() == [each.name for each in dataclasses.fields(hdplan.PlannerSettings)]


def test_a_pose_at_the_start_is_one_at_the_scene_s_start(tmp_path: Path) -> None:
    """The link keeps it where no pose is given."""
    path = {"path": {"relative": {"link": "fore", "to": "base", "position_tolerance": 1, "orientation_tolerance": 3}}}
    for start, good in (([0, 0.1], True), ([0, 0.2], False)):
        two = files(tmp_path, {**path, "start": {"joints": start}})
        with rejects_unless(good, "does not begin at the start"):
            assert "path" in claimed(*two, "path")


def test_a_joint_without_the_limits_that_it_needs_is_within_none(tmp_path: Path) -> None:
    for kind, good in (("continuous", True), ("revolute", False)):
        urdf = URDF.replace('name="a" type="revolute"', f'name="a" type="{kind}"').replace(LIMIT.format(-2, 2), "")
        two = files(tmp_path, {}, MOTION, urdf)
        with rejects_unless(good, r"'a'(: has no limit| is beyond it)"):
            assert "limits" in claimed(*two, "limits")


def test_check_pairs_are_kept_apart_whatever_the_srdf_says(tmp_path: Path) -> None:
    words = '<robot name="r"><disable_collisions link1="base" link2="finger"/></robot>'
    (tmp_path / "r.srdf").write_text(words)
    far, near = frozenset(("base", "finger")), frozenset(("base", "up"))  # neighbours
    for checked in ([], [["finger", "base"]], [["base", "up"]], [["base", "finger"], ["up", "base"]]):
        robot = {**SCENE["robot"], "srdf": "r.srdf", "check_pairs": checked}
        scene, motion = files(tmp_path, {"robot": robot})
        world = read(scene, motion)
        pairs = {frozenset(world.pieces[i].name for i in pair) for pair in world.pairs.tolist()}
        wanted = {frozenset(pair) for pair in checked}
        assert pairs & {far, near} == wanted
        assert {*map(frozenset, world.left_out)} & {far, near} == {far, near} - wanted
        ours = hdplan.build(hdplan.load_scene(scene)).robot
        assert {frozenset(pair) for pair in ours.self_pairs} & {far, near} == wanted


def test_a_goal_of_several_kinds_is_met_by_any_of_them(tmp_path: Path) -> None:
    pose = {"link": "fore", "position": [3.0, 0.0, 0.0], "free_rotation": "all"}  # beyond its reach
    met, missed = {"joints": [0.5, 0.5]}, {"joints": {"a": 0.5, "b": 0.51}}
    for goals, good in (([{"pose": pose}, met], True), ([missed, met], True), ([{"pose": pose}, missed], False)):
        two = files(tmp_path, {"goal": {"any": goals}})
        assert hdplan.certify(hdplan.load_scene(two[0]), hdplan.Trajectory.load(two[1])).certified is good
        if good:
            assert hdplan.prove(*two).text.startswith("accepted:")
        else:
            with pytest.raises(RejectedError, match="goal"):
                claimed(*two, "goal")
    for bad in ({"start": {"any": [{"joints": [0, 0.1]}]}}, {"goal": {"any": [{"any": [met]}]}}, {"goal": {"any": []}}):
        with pytest.raises(hdplan.InputError, match="any"):
            hdplan.load_scene(files(tmp_path, bad)[0])
        with pytest.raises(RejectedError):
            claimed(*files(tmp_path, bad), "start", "goal")
