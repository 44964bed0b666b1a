"""MoveIt's files on the command line: planned, proven, refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.commands import ARM, Command, refused

MOVEIT_BOX = {"type": "box", "dimensions": [0.1, 0.1, 0.1]}
MOVEIT_OBJECT = {"id": "box", "primitives": [MOVEIT_BOX], "pose": {"position": [0, 0, 3]}}
MOVEIT_SCENE = {"robot_model_name": "planar_arm", "world": {"collision_objects": [MOVEIT_OBJECT]}}
GOAL = {"elbow": 0.4, "shoulder": 1.0}
ROBOT, REQUEST = ("--robot", "robot.yaml"), ("--request", "request.yaml")


def moveit_request(goal: dict[str, float] | None) -> dict[str, object]:
    joints = [{"joint_name": name, "position": value} for name, value in (goal or {}).items()]
    state = {"joint_state": {"name": ["gripper", "elbow", "shoulder"], "position": [0.1, 0.3, -0.8]}}
    return {"start_state": state, **({} if goal is None else {"goal_constraints": [{"joint_constraints": joints}]})}


def write_moveit(goal: dict[str, float] | None) -> list[str]:
    Path("scene.yaml").write_text(yaml.safe_dump(MOVEIT_SCENE), encoding="utf-8")
    Path("request.yaml").write_text(yaml.safe_dump(moveit_request(goal)), encoding="utf-8")
    robot = {"urdf": str(ARM / "planar_arm.urdf"), "srdf": str(ARM / "planar_arm.srdf")}
    Path("robot.yaml").write_text(yaml.safe_dump({"robot": robot}), encoding="utf-8")
    return ["plan", "scene.yaml", "--request", "request.yaml", "--robot", "robot.yaml"]


def test_moveit_files(hdplan: Command) -> None:
    done = hdplan(*write_moveit(GOAL))
    assert (done.code, done.err) == (0, "")
    assert "left out, as planar_arm has no such joints: gripper" in done.out


BAD_INPUT: dict[str, tuple[Any, ...]] = {  # the goal, the arguments left out, and parts of the message
    "no goal": (None, (), "request.yaml", "'goal_constraints' is missing"),
    "empty goal": ({}, (), "request.yaml", "no goal"),
    "joint missing": ({"elbow": 0.4}, (), "goal (request.yaml)", "no value for shoulder"),
    "outside": ({**GOAL, "elbow": 3.4}, (), "goal (request.yaml)", "'elbow' is 3.4", "[-2.6, 2.6]"),
    "no request": (GOAL, REQUEST, "scene.yaml", "--request"),
    "no robot": (GOAL, ROBOT, "scene.yaml", "--robot"),
    "neither": (
        GOAL,
        (*REQUEST, *ROBOT),
        "scene.yaml: is a MoveIt planning scene",
        "--request FILE",
        "--robot NAME or",
    ),
    "request alone": (
        GOAL,
        ("scene.yaml", "--request", *ROBOT),
        "is a MoveIt motion plan request",
        "--robot NAME or FILE",
    ),
    "no scene": (GOAL, ("scene.yaml",), "Missing argument"),
}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_moveit_input(hdplan: Command, case: str) -> None:
    goal, left_out, *words = BAD_INPUT[case]
    arguments = [argument for argument in write_moveit(goal) if argument not in left_out]
    refused(hdplan(*arguments), *words)


def test_a_proof_of_moveits_files(hdplan: Command) -> None:
    """The same from plan, prove and verify, for which a request is as much as its scene."""
    _, scene, *beside = write_moveit(GOAL)
    assert hdplan("plan", scene, *beside, "-o", "m.json", "--proof", "m.proof").code == 0
    assert hdplan("prove", scene, "m.json", *beside, "-o", "n.proof").code == 0
    assert Path("m.proof").read_bytes() == Path("n.proof").read_bytes()
    accepted = hdplan("verify", scene, "m.json", "m.proof", *beside)
    assert (accepted.code, accepted.out.split(":")[0]) == (0, "accepted")
    refused(hdplan("verify", scene, "m.json", "m.proof", *beside[:2], "--robot", "no.yaml"), "no.yaml: no such file")
    refused(hdplan("verify", scene, "m.json", "m.proof", "--request", "no", *beside[2:]), "no: no such file")
    refused(hdplan("prove", scene, "m.json", "-o", "n.proof"), "--request FILE", "--robot NAME or FILE")
    Path("a.xacro").write_text("<robot/>", encoding="utf-8")
    with_argument = ("--robot", "a.xacro", "--xacro-arg", "a:=1")
    refused(hdplan("plan", scene, *beside[:2], *with_argument, "-o", "m.json", "--proof", "m.proof"), "--xacro-arg")
    write_moveit({"elbow": 0.5, "shoulder": 1.0})
    other = hdplan("verify", scene, "m.json", "m.proof", *beside)
    assert (other.code, other.out.split(":")[1]) == (1, " request")
