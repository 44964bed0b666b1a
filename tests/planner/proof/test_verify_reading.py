"""The checker reads scenes, robots and meshes as hdplan does, or refuses them; and takes no more than it may."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

import hdplan
from hdplan.scenes.robot_files.library import data_folder, library_package_dirs
from hdplan.verify import RejectedError
from hdplan.verify.balls import Ball
from hdplan.verify.kernel import Motion
from hdplan.verify.reading import read_world
from hdplan.verify.semantics import Semantics
from hdplan.verify.turns import rotation
from hdplan.verify.verdict import statement
from hdplan.verify.world import World

from ..urdf import joint_text, link_text, robot_text
from .worlds import read, read_and_planned, rejects_unless, saved, scene_files, words_of

HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
WEIGHED = {  # a scene in which masses matter
    "robot": {"urdf": "r.urdf"}, "start": {"joints": [0]}, "goal": {"joints": [0]},
    "limits": {"torque": 9, "velocity": 1},
}  # fmt: skip


def files(scene: hdplan.Scene, folder: Path, change: Callable[[str], str] = str) -> tuple[Path, Path]:
    """Write a scene and a short motion, after a change to the scene's text."""
    file, motion, _, _ = saved(scene, folder, to=0.01)
    text = file.read_text()
    file.write_text(change(text))
    assert (change(text) == text) == (change is str)
    return file, motion


def world(scene: hdplan.Scene, folder: Path) -> World:
    """Scene and a short motion as the checker reads them, equal to hdplan's."""
    file, motion, setup, _ = saved(scene, folder, to=0.01)
    return read_and_planned(setup, file, motion)


def test_a_mobile_base_carries_the_robot(tmp_path: Path) -> None:
    base = hdplan.PlanarBase(x=(-2, 2), y=(-1, 3), yaw=(-3, 3))
    spec = hdplan.RobotSpec(name="panda", base=hdplan.Pose((1.0, 0.0, 0.2)), base_joints=base)
    start = [0.3, -0.2, 1.1, *HOME]
    scene = hdplan.Scene(robot=spec, start=start, goal=start)
    found = world(scene, tmp_path)
    robot = hdplan.load_robot(spec)
    assert tuple(joint.name for joint in found.joints) == robot.joint_names
    assert found.limits["position"][:3] == [[-2, 2], [-1, 3], [-3, 3]]
    motion = Motion(found, np.array([[0.0, 1.0]]))
    turn = rotation(Ball([0.0, 0.0, 1.0]), 1.105).mid
    assert np.allclose(motion.at.mid[0, 2], [1.305, -0.195, 0.2], atol=1e-12)
    assert np.allclose(motion.turn.mid[0, 2], turn, atol=1e-12)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("locked: {", "locked: {on: 1, ", "not a word"),
        ('name: "panda"', 'name: "panda"\n  urdf: other.urdf', "either a name or a file"),
        ('name: "panda"', 'name: "panda"\n  name: panda', "appears twice"),
        ("hdplan: 1", "hdplan: 1\npayload: {mass: 1, mass: 2}", "appears twice"),
    ],
)
def test_hidden_requirements_of_a_scene_are_refused(before: str, after: str, words: str, tmp_path: Path) -> None:
    robot = hdplan.RobotSpec(name="panda", locked={"panda_finger_joint1": 0.01})
    scene = hdplan.Scene(robot=robot, start=HOME, goal=HOME)
    with pytest.raises(RejectedError, match=words):
        read(*files(scene, tmp_path, lambda text: text.replace(before, after, 1)))


def test_a_motion_with_a_key_twice_or_without_positions_is_refused(tmp_path: Path) -> None:
    """Its velocities do not stand for positions."""
    scene, motion = files(hdplan.Scene(robot="panda", start=HOME, goal=HOME), tmp_path)
    text = motion.read_text()
    content = json.loads(text)
    rates = {**content, "times": [0, 1], "velocities": content["positions"], "positions": None}
    twice = text.replace("{", '{"joint_names": [], ', 1)
    for changed, words in ((twice, "appears twice"), (json.dumps(rates), "has no positions")):
        motion.write_text(changed)
        with pytest.raises(RejectedError, match=words):
            read(scene, motion)


@pytest.mark.parametrize(
    ("mass", "moments", "words"),
    [
        ("1", (1, 1, 1), ""),
        ("0", (0, 0, 0), "joint 'j' moves no mass"),
        ("0", (1, 1, 1), "no body has the inertia of link 'b'"),
        ("1", (1, 1, 3), "no body has the inertia of link 'b'"),
        ("1", (-1, 1, 1), "no body has the inertia of link 'b'"),
    ],
)
def test_torques_of_masses_that_no_body_has_are_not_proven(
    mass: str, moments: tuple[int, ...], words: str, tmp_path: Path
) -> None:
    """They would be those of another robot; hdplan refuses such a scene, too."""
    inertia = '<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/>'.format(*moments)
    body = link_text("b", inertial=f'<inertial><mass value="{mass}"/>{inertia}</inertial>')
    urdf = robot_text(link_text("a"), body, joint_text("j", "a", "b", kind="continuous"))
    motion = {"joint_names": ["j"], "times": [0, 1], "positions": [[0], [0.1]], "velocities": [[0], [0]]}
    files = scene_files(tmp_path, WEIGHED, motion, {"r.urdf": urdf})
    with rejects_unless(not words, words):
        assert read(*files).loads[0]["mass"] == 1


@pytest.mark.parametrize(
    "words",
    [
        '<group_state name="s" group="g"><joint name="j" value="0"/><joint name="j" value="1"/></group_state>',
        '<group_state name="s" group="g"><joint name="j" value="0"/></group_state>' * 2,
        '<group_state name="s" group="g"><joint name="j"/></group_state>',
    ],
)
def test_a_named_state_of_two_values_or_none_is_refused(words: str) -> None:
    with pytest.raises(RejectedError, match=r"appears twice|'None' is not a number"):
        Semantics(f"<robot>{words}</robot>".encode(), {"b": ("j", "a")}, ["a", "b"])


@pytest.mark.parametrize("words", ["pose: 0", "pose: []", "motion: {velocity: 1}", "shape: {type: box, size: 1}"])
def test_numbers_that_could_stand_for_others_are_refused(words: str, tmp_path: Path) -> None:
    scene = hdplan.Scene(robot="panda", start=HOME, goal=HOME)
    more = {"name": "a", "shape": {"type": "box", "size": [1, 1, 1]}, **yaml.safe_load(words)}
    two = files(scene, tmp_path, lambda text: json.dumps({**yaml.safe_load(text), "obstacles": [more]}))
    with pytest.raises(RejectedError, match=r"(is|are) expected"):
        read(*two)


PAIRS = ("enable_collisions", "disable_collisions")


@pytest.mark.parametrize("seed", range(4))
def test_an_srdf_that_turns_pairs_on_and_off_at_large_is_read_as_hdplan_reads_it(seed: int, tmp_path: Path) -> None:
    rng, links = np.random.default_rng(seed), [f"panda_link{i}" for i in range(8)]
    words = [f'<disable_default_collisions link="{x}"/>' for x in rng.choice(links, 2)]
    for _ in range(8):
        one, two = rng.choice(links, 2, replace=False)
        words.append(f'<{rng.choice(PAIRS)} link1="{one}" link2="{two}" reason="x"/>')
    (tmp_path / "r.srdf").write_text(f'<robot name="panda">{"".join(rng.permutation(words))}</robot>')
    (tmp_path / "r.urdf").write_bytes((data_folder() / "panda_description/urdf/panda.urdf").read_bytes())
    robot = hdplan.RobotSpec(urdf=tmp_path / "r.urdf", srdf=tmp_path / "r.srdf", package_dirs=library_package_dirs())
    found = world(hdplan.Scene(robot=robot, start=HOME, goal=HOME), tmp_path)
    assert "the SRDF" in found.left_out.values()


def test_an_srdf_s_words_that_are_not_known_are_refused() -> None:
    for words in ('<enable_colisions link1="a" link2="b"/>', '<disable_collisions link1="a" lnk2="b"/>'):
        with pytest.raises(RejectedError, match="not known"):
            Semantics(f"<robot>{words}</robot>".encode(), {"b": ("j", "a")}, ["a", "b"])


def test_limits_of_a_scene_do_not_widen_those_of_the_robot(tmp_path: Path) -> None:
    """The motion ends 10 mrad beyond its start, where the URDF's limit is."""
    head = {"clearance": None, "self_clearance": 1e-3, "claims": ["limits"]}
    for room, good in ((0.0101, True), (0.0099, False)):
        start = [2.8973 - room, *HOME[1:]]
        scene = hdplan.Scene(robot="panda", start=start, goal=start)
        for limits, fine in (({}, good), ({"panda_joint1": [-9, 9]}, good), ({"panda_joint1": [0, start[0]]}, False)):
            more = f"{json.dumps({'limits': {'position': limits}})[1:-1]}\n"
            found = read(*files(scene, tmp_path, lambda text, more=more: text + more))
            with rejects_unless(fine, "'panda_joint1' is beyond it"):
                statement(found, head)


@pytest.mark.skipif(sys.platform != "linux", reason="limits of processes are those of Linux")
@pytest.mark.parametrize(
    ("attack", "wait", "words"),
    [
        ("bytearray(3 << 30)", 15, "rejected: needs more memory than it may take"),
        ("while True: pass", 15, "rejected: needs more than 1 s of a processor"),  # longer on a busy machine
        ("import time; time.sleep(60)", 2, "rejected: needs more than 2 s"),
    ],
)
def test_the_process_of_the_checker_is_limited(attack: str, wait: int, words: str) -> None:
    """Memory and time that files may cost are bounded, whatever they say, by the clock as well."""
    code = f"""from hdplan.verify import balls, bounds, __main__
bounds.MOST_TIME, bounds.MOST_WAIT = 1, {wait}
def check(*_):
    with balls.rejecting():
        exec({attack!r})
__main__.check = check
sys.exit(__main__.main([{__file__!r}] * 3))"""
    run = [sys.executable, "-c", f"import sys\n{code}"]
    done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=20)
    assert (done.returncode, done.stdout, done.stderr) == (1, f"{words}\n", "")


def test_the_kernel_alone_is_limited_too(tmp_path: Path) -> None:
    code = """import runpy, sys
from hdplan.verify import bounds
bounds.bounded = lambda: print("bounded")
sys.argv = ["kernel", "none.json", "none.proof"]
runpy.run_module("hdplan.verify.kernel", run_name="__main__")"""
    run = [sys.executable, "-W", "ignore", "-c", code]
    done = subprocess.run(run, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (2, "bounded\n", "none.json: no such file\n")


def test_the_statement_names_the_files_that_were_read(tmp_path: Path) -> None:
    two = files(hdplan.Scene(robot="panda", start=HOME, goal=[HOME[0] + 0.01, *[x + 0.01 for x in HOME[1:]]]), tmp_path)
    proof = hdplan.prove(*two)
    lines = words_of(*two, proof.data).splitlines()
    hashes = read_world(*two).hashes
    assert {"scene", "urdf", "srdf"} < {*hashes}
    for key, digest in hashes.items():
        assert (f"  {key}: SHA-256 {digest[:16]}" in lines) == (key != "motion")


@pytest.mark.parametrize(("least", "whole"), [(0.02, True), (0.019, False), (None, True)])
def test_a_clearance_between_links_that_is_not_reached_is_reported(
    least: float | None, whole: bool, tmp_path: Path
) -> None:
    """None: there are no two links to be kept apart."""
    required = hdplan.SelfCollision(clearance=0.02)
    found = world(hdplan.Scene(robot="panda", start=HOME, goal=HOME, self_collision=required), tmp_path)
    text, _ = statement(found, {"clearance": None, "self_clearance": least, "claims": ["limits", "start"]})
    assert ("a clearance of 20 mm (links)" not in text.splitlines()[0]) == whole


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('<mass value="1"/>', '<mass value="1"/><mass value="2"/>'),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><axis xyz="0 1 0"/>'),
        ('<origin xyz="0 0 1"/>', '<origin xyz="0 0 1"/><origin xyz="0 0 2"/>'),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><limit uper="1"/>'),
        ('<axis xyz="0 0 1"/>', "<axis/>"),
        ('<link name="a"/>', '<link name="a"><collision_checking><capsule name="x"/></collision_checking></link>'),
        ('<link name="a"/>', '<link name="a"><origin xyz="0 0 1"/></link>'),
    ],
)
def test_a_urdf_with_a_repeated_or_unknown_element_is_refused(before: str, after: str, tmp_path: Path) -> None:
    text = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="continuous">
<origin xyz="0 0 1"/><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>"""
    assert before in text
    motion = {"joint_names": ["j"], "positions": [[0], [1]], "times": [0, 2]}
    for urdf in (text, text.replace(before, after)):
        with rejects_unless(urdf == text, r"twice|origin|not known|axis: 3"):
            assert len(read(*scene_files(tmp_path, WEIGHED, motion, {"r.urdf": urdf})).joints) == 1
