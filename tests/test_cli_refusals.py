"""Bad input on the command line: one line, exit code 2, nothing written."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.commands import ARM, Command, arm_scene, obstacle, refused

BAD_ARGUMENTS = {
    "no such command": (["pln"], "'pln'", "'plan'"),
    "no scene": (["plan"], "SCENE", "hdplan plan --help"),
    "too many": (["plan", "a", "b"], "(b)"),
    "no such option": (["plan", "planar_arm", "--sede", "1"], "--sede", "--seed"),
    "option without value": (["plan", "planar_arm", "-o"], "-o"),
    "no such scene": (["plan", "panda_cag"], "panda_cag: no such file", "'panda_cage'"),
    "no such file": (["explain", "nowhere/x.yaml"], "nowhere/x.yaml: no such file"),
    "a folder": (["plan", "."], "is a directory"),
    "a very long name": (["plan", "x" * 300], "no such file"),
    "a name with a line end": (["plan", "a\nb"], "no such file"),
    "a robot for a scene": (["plan", str(ARM / "planar_arm.urdf")], "is a robot's description, not a scene", "--robot"),
    "no such proof": (["verify", "planar_arm", __file__, "no.proof"], "no.proof: no such file"),
    "fewer than one": (["sample", "planar_arm", "-n", "-3", "-o", "x.csv"], "--count", "at least 1", "'-3'"),
    "no such robot": (["robots", "pandda"], "'pandda'", "'panda'"),
    "nothing like it": (["robots", "xyzzy"], "'xyzzy'", "`hdplan robots` lists them"),
    "robot misspelt": (["plan", "planar_arm", "--robot", "pandda"], "--robot: ", "'pandda'", "'panda'"),
    "no such robot file": (["plan", "planar_arm", "--robot", "no.yaml"], "no.yaml: no such file"),
    "request without need": (["plan", "planar_arm", "--request", "r.yaml"], "not a MoveIt planning scene"),
    "solver misspelt": (["plan", "planar_arm", "--solver", "ipop"], "'ipop'", "'ipopt'"),
    "seed negative": (["plan", "planar_arm", "--seed", "-1"], "--seed", "at least 0", "'-1'"),
    "seed broken": (["plan", "planar_arm", "--seed", "1.5"], "--seed", "whole number", "'1.5'"),
    "no time": (["plan", "planar_arm", "--time-limit", "0"], "--time-limit", "greater than 0", "'0'"),
    "time nan": (["plan", "planar_arm", "--time-limit", "nan"], "--time-limit", "finite", "'nan'"),
    "time text": (["plan", "planar_arm", "--time-limit", "soon"], "--time-limit", "'soon'"),
    "time underscore": (["plan", "planar_arm", "--time-limit", "1_0"], "--time-limit", "'1_0'"),
    "seed of other digits": (["plan", "planar_arm", "--seed", "٣"], "--seed", "'٣'"),
    "jitter underscore": (["sample", "planar_arm", "-o", "t.csv", "--jitter", "1_0"], "--jitter", "'1_0'"),
    "output ending": (["plan", "planar_arm", "-o", "x.txt"], "x.txt", "'.txt'", ".json, .csv, .npz"),
    "output a folder": (["plan", "planar_arm", "-o", "folder.json"], "folder.json: is a folder"),
    "output nowhere": (["plan", "planar_arm", "-o", "no/x.json"], "the folder no does not exist"),
    "output too long": (["plan", "planar_arm", "-o", f"{'x' * 250}.json"], "cannot be written"),
    "no picture": (["plot", "planar_arm", "x.json"], "--output"),
    "plot ending": (["plot", "planar_arm", "x.json", "-o", "x.jpg"], "x.jpg", "'.jpg'", ".png, .pdf, .svg"),
    "plot of nothing": (["plot", "planar_arm", "no.json", "-o", "x.png"], "no.json: no such file"),
    "picture ending": (["plan", "planar_arm", "--plot", "x.jpg"], "x.jpg", "'.jpg'", ".png, .pdf, .svg"),
    "no trajectory": (["check", "planar_arm", "no.json"], "no.json: no such file"),
    "trajectory ending": (["check", "planar_arm", "no.txt"], "no.txt", "'.txt'", ".json, .csv, .npz"),
    "trajectory a folder": (["check", "planar_arm", "folder.json"], "folder.json: is a directory, not a file"),
}


@pytest.mark.parametrize("case", BAD_ARGUMENTS)
def test_bad_arguments(hdplan: Command, case: str) -> None:
    Path("folder.json").mkdir()
    arguments, *words = BAD_ARGUMENTS[case]
    refused(hdplan(*arguments), *words)
    assert [file.name for file in Path().iterdir()] == ["folder.json"]


def test_a_motion_that_its_file_cannot_hold_is_refused_before_it_is_planned(
    hdplan: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = arm_scene(tmp_path, timing={"duration": 90, "rate": 1000})
    monkeypatch.setattr("hdplan.planner.commands.plan.plan", lambda *_, **__: pytest.fail("planned"))
    refused(hdplan("plan", scene, "-o", "m.robot_trajectory.yaml"), "90001 waypoints", "write .mcap")


def ball(position: str) -> list[object]:
    return obstacle("type: sphere, radius: 0.1", position)


def panda(**keys: object) -> dict[str, object]:
    return {"robot": {"name": "panda", **keys}}


BAD_SCENES = {
    "syntax": ("hdplan: 1\nrobot: [\n", "line 3", "YAML syntax"),
    "not text": (b"\x00\xff\xfe", "scene.yaml"),
    "section misspelt": ({"obstacls": []}, "'obstacls'", "'obstacles'"),
    "robot misspelt": ({"robot": {"name": "pandda"}}, "robot.name", "'pandda'", "'panda'"),
    "state misspelt": ({"start": {"state": "rigth"}}, "start", "'rigth'", "'right'"),
    "joint misspelt": ({"start": {"joints": {"shoulder": 0, "elbw": 0}}}, "start", "'elbw'", "'elbow'"),
    "joint missing": ({"start": {"joints": {"shoulder": 0}}}, "start", "no value for elbow"),
    "too many joints": ({"goal": {"joints": [0, 0, 0]}}, "goal", "3 values", "2 joints: shoulder, elbow"),
    "outside limits": ({"goal": {"joints": [0, 2.7]}}, "goal", "'elbow' is 2.7", "[-2.6, 2.6]"),
    "start in collision": ({"obstacles": ball("[0.35, -0.35, 0.1]")}, "start: in collision: upper_arm and thing", "mm"),
    "goal in collision": ({"obstacles": ball("[0.35, 0.5, 0.1]")}, "goal: in collision: ", "thing overlap by "),
    "a joint to lock misspelt": (panda(locked={"panda_finger_joint3": 0}), "robot.locked", "'panda_finger_joint2'"),
    "a link to ignore misspelt": (panda(ignore_pairs=[["panda_link1", "a_link2"]]), ".ignore_pairs", "'panda_link2'"),
}


@pytest.mark.parametrize("case", BAD_SCENES)
def test_bad_scenes(hdplan: Command, tmp_path: Path, case: str) -> None:
    content, *words = BAD_SCENES[case]
    if isinstance(content, dict):
        arm_scene(tmp_path, **content)
    else:
        Path("scene.yaml").write_bytes(content if isinstance(content, bytes) else str(content).encode())
    refused(hdplan("plan", "scene.yaml", "-o", "motion.json"), "scene.yaml: ", *words)
    assert [file.name for file in Path().iterdir()] == ["scene.yaml"]


BAD_TRAJECTORIES = {  # what Trajectory refuses otherwise is in tests/planner/motion
    "x.json": {
        "{": "not JSON",
        '{"hdplan_trajectory": 1, "joint_names": ["shoulder", "elbow"]}': "positions: missing",
        '{"hdplan_trajectory": 1, "joint_names": ["shoulder", "elbow"], "positions": [[0, "1"], [2, 3]]}': "numbers",
        f'{{"hdplan_trajectory": 1, "joint_names": ["a", "b"], "positions": [[0, {10**400}], [2, 3]]}}': "numbers",
        '{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[0], [1]], "locked": {"b": "c"}}': "locked",
        '{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[0], [1]], "times": [0]}': "each of the 2",
        '{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[0], [1]], "times": 3}': "each of the 2",
        '{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[0], [1]], "times": [1, 1]}': "must increase",
    },
    "x.csv": {
        "": "empty",
        "shoulder;elbow\n0,1;0\n0;1\n": "line 1: has semicolons between its values; commas are expected",
        "shoulder,elbow\n0,0\n\n1,x\n": "line 4: 'x' is not a number",
        "time,shoulder,elbow\n0,0,0\n-1,1,1\n": "-1 s at waypoint 1 comes after 0 s",
        "time,shoulder,elbow\n0,0,0\ninf,1,1\n": "times: inf",
        "shoulder,elbw\n0,0\n1,1\n": "joint 'elbow' of planar_arm is missing (did you mean 'elbw'?)",
        "shoulder,elbow,wrist\n0,0,0\n1,1,1\n": "joint 'wrist' is not one of planar_arm",
        "shoulder,elbow\n0,0\n1,1e308\n": "waypoint 1, joint 'elbow': 1e+308 exceeds 1e+06",
    },
    "x.npz": {"": "not an NPZ", "PK\x03\x04 rubbish": "not an NPZ"},
}


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [(name, content, words) for name, cases in BAD_TRAJECTORIES.items() for content, words in cases.items()],
    ids=[f"{name}-{i}" for name, cases in BAD_TRAJECTORIES.items() for i in range(len(cases))],
)
def test_bad_trajectories(hdplan: Command, name: str, content: str, words: str) -> None:
    Path(name).write_text(content, encoding="utf-8")
    refused(hdplan("check", "planar_arm", name), f"{name}: ", words)
    refused(hdplan("plot", "planar_arm", name, "-o", "x.png"), f"{name}: ", words)
    assert not Path("x.png").exists()
