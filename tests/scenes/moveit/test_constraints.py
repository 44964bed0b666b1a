"""Constraints of MoveIt requests: what a scene makes of them MoveIt allows too, the rest is refused by name."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.path_constraints import PathConstraints, Upright, Within
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget
from hdplan.scenes.yaml_format.reader import load_scene
from hdplan.scenes.yaml_format.writer import scene_text

HALF = math.sqrt(0.5)
DOWN = [1.0, 0.0, 0.0, 0.0]  # turned about x: z points down
BALL = {
    "link_name": "hand",
    "constraint_region": {
        "primitives": [{"type": "sphere", "dimensions": [0.01]}],
        "primitive_poses": [{"position": [0.5, 0.1, 0.4], "orientation": [0, 0, 0, 1]}],
    },
    "weight": 1,
}
BOX = {
    "header": {"frame_id": "world"},
    "link_name": "hand",
    "target_point_offset": [0, 0, 0.1],
    "constraint_region": {
        "primitives": [{"type": "box", "dimensions": [2, 0.2, 0.4]}],
        "primitive_poses": [{"position": [0.5, 0, 0.4], "orientation": [0, 0, HALF, HALF]}],
    },
}


def turn(quaternion: Sequence[float], *tolerances: float, **more: object) -> dict[str, Any]:
    named = {f"absolute_{axis}_axis_tolerance": t for axis, t in zip("xyz", tolerances, strict=True)}
    return {"link_name": "hand", "orientation": list(quaternion), **named, "weight": 1, **more}


def request(folder: Path, goal: dict[str, Any] | None = None, path: dict[str, Any] | None = None) -> Scene:
    scene, request_file = folder / "scene.yaml", folder / "request.yaml"
    scene.write_text("robot_model_name: panda\n", encoding="utf-8")
    joints = {"joint_constraints": [{"joint_name": "j1", "position": 1.0}]}
    message = {
        "start_state": {"joint_state": {"name": ["j1"], "position": [0.0]}},
        "goal_constraints": [goal or joints],
        "path_constraints": path or {},
    }
    request_file.write_text(yaml.safe_dump(copy.deepcopy(message)), encoding="utf-8")  # no aliases
    return load_scene(scene, request_file, "panda")


def pose_goal(scene: Scene) -> PoseTarget:
    assert isinstance(scene.goal, Goals)
    (target,) = scene.goal.targets
    assert isinstance(target, PoseTarget)
    return target


# --- goals ------------------------------------------------------------------------------------------------------------


def test_a_ball_and_an_orientation_are_a_pose(tmp_path: Path) -> None:
    goal = {"position_constraints": [BALL], "orientation_constraints": [turn(DOWN, 0.1, 0.1, 0.1)]}
    scene = request(tmp_path, goal)
    target = pose_goal(scene)
    assert target.field == f"goal ({tmp_path / 'request.yaml'})"
    assert (target.link, target.pose) == ("hand", Pose((0.5, 0.1, 0.4), (1.0, 0.0, 0.0, 0.0)))
    assert (target.position_tolerance, target.orientation_tolerance, target.free_rotation) == (0.01, 0.1, "none")
    assert scene.notes == ()
    assert isinstance(scene.start, JointTarget)


def test_no_orientation_or_all_free_is_any_turn(tmp_path: Path) -> None:
    alone = pose_goal(request(tmp_path, {"position_constraints": [BALL]}))
    free = turn([0, 0, 0, 1], math.pi, 4.0, 3.14)
    goal = pose_goal(request(tmp_path, {"position_constraints": [BALL], "orientation_constraints": [free]}))
    assert alone == goal
    assert alone.free_rotation == "all"


def test_poses_of_several_links_are_reached_together(tmp_path: Path) -> None:
    """One for each of two hands, whatever the order of their constraints, written and read the same."""
    other = {**BALL, "link_name": "other"}
    turns = [{**turn(DOWN, 0.2, 0.2, 0.2), "link_name": "other"}, turn(DOWN, 0.1, 0.1, 0.1)]
    scene = request(tmp_path, {"position_constraints": [BALL, other], "orientation_constraints": turns})
    assert isinstance(scene.goal, Goals)
    (both,) = scene.goal.targets
    assert isinstance(both, AllOf)
    assert [(pose.link, pose.orientation_tolerance) for pose in both.poses] == [("hand", 0.1), ("other", 0.2)]
    for pose in both.poses:
        assert pose.pose == Pose((0.5, 0.1, 0.4), (1.0, 0.0, 0.0, 0.0))
    (tmp_path / "written.yaml").write_text(scene_text(scene), encoding="utf-8")
    assert load_scene(tmp_path / "written.yaml").goal == scene.goal


def test_a_free_axis_and_a_box_are_taken_with_a_note(tmp_path: Path) -> None:
    box = {**BOX, "target_point_offset": [0, 0, 0]}
    goal = {"position_constraints": [box], "orientation_constraints": [turn(DOWN, 0.3, 0.1, 3.2)]}
    scene = request(tmp_path, goal)
    target = pose_goal(scene)
    assert (target.position_tolerance, target.orientation_tolerance, target.free_rotation) == (0.1, 0.1, "z")
    ball, smaller = sorted(scene.notes)
    assert "its inscribed sphere of radius 0.1 m is used" in smaller
    assert "allows up to 0.3 rad about one axis; 0.1 rad is used about all" in ball


def test_scenes_from_requests_are_written_and_read(tmp_path: Path) -> None:
    goal = {"position_constraints": [BALL], "orientation_constraints": [turn(DOWN, 0.1, 0.1, 4)]}
    path = {"orientation_constraints": [turn(DOWN, 0.1, 0.1, 4)], "position_constraints": [BOX]}
    scene = request(tmp_path, goal, path)
    file = tmp_path / "written.yaml"
    file.write_text(scene_text(scene), encoding="utf-8")
    again = load_scene(file)
    assert again.path == scene.path
    assert pose_goal(again).pose == pose_goal(scene).pose


# --- along the way ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("quaternion", "tolerances", "axis"),
    [
        ([0, 0, 0, 1], (0.2, 0.2, math.pi), (0.0, 0.0, 1.0)),
        (DOWN, (0.2, 0.2, 2 * math.pi), (0.0, 0.0, -1.0)),
        ([0, -HALF, 0, HALF], (3.14, 0.2, 0.2), (1.0, 0.0, 0.0)),
        ([0, HALF, 0, HALF], (3.14, 0.2, 0.2), (-1.0, 0.0, 0.0)),
        ([0, 0, 0.6, 0.8], (0.2, 0.2, 4), (0.0, 0.0, 1.0)),
    ],
)
def test_a_free_axis_that_points_up_or_down_is_upright(
    tmp_path: Path, quaternion: list[float], tolerances: tuple[float, ...], axis: tuple[float, ...]
) -> None:
    upright = request(tmp_path, path={"orientation_constraints": [turn(quaternion, *tolerances)]}).path.upright
    assert upright is not None
    assert (upright.link, upright.axis) == ("hand", axis)
    assert upright.tolerance == pytest.approx(0.2, abs=1e-12)


def test_an_axis_a_little_off_costs_tolerance(tmp_path: Path) -> None:
    slanted = Rotation.from_euler("x", 0.005).as_quat().tolist()
    upright = request(tmp_path, path={"orientation_constraints": [turn(slanted, 0.2, 0.2, 4)]}).path.upright
    assert upright is not None
    assert upright == Upright("hand", (0.0, 0.0, 1.0), upright.tolerance)
    assert upright.tolerance == pytest.approx(0.195, abs=1e-9)


def test_a_box_along_the_way(tmp_path: Path) -> None:
    within = request(tmp_path, path={"position_constraints": [BOX]}).path.position
    assert within == Within("hand", (2.0, 0.2, 0.4), Pose((0.5, 0.0, 0.4), (0.0, 0.0, HALF, HALF)), (0.0, 0.0, 0.1))


def test_no_constraint_is_none(tmp_path: Path) -> None:
    empty = {"name": "", "joint_constraints": [], "position_constraints": [], "orientation_constraints": []}
    assert request(tmp_path, path=empty).path == PathConstraints()


# --- what a scene allows, MoveIt allows -------------------------------------------------------------------------------


def euler_angles(turns: Rotation) -> Array:
    return np.abs(turns.as_euler("XYZ"))


def test_turns_by_less_than_the_tolerance_are_within_moveits() -> None:
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(50_000, 3))
    angles = rng.uniform(0.0, 1.5, 50_000)
    turns = Rotation.from_rotvec(angles[:, None] * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    assert np.all(euler_angles(turns).max(axis=1) <= angles + 1e-12)


@pytest.mark.parametrize(("free", "bounded"), [(2, (0, 1)), (0, (1, 2))])
def test_a_cone_about_a_free_axis_is_within_moveits(free: int, bounded: tuple[int, int]) -> None:
    """The link's axis within t of the wanted direction, turned about it at will: both other angles are below t."""
    rng = np.random.default_rng(1)
    count = 50_000
    tilt, around, spin = rng.uniform(0.0, 1.5, count), rng.uniform(0, 2 * np.pi, count), rng.uniform(-4, 4, count)
    axis = np.zeros((count, 3))
    axis[:, (free + 1) % 3], axis[:, (free + 2) % 3] = np.cos(around), np.sin(around)
    own = np.zeros((count, 3))
    own[:, free] = spin
    turns = Rotation.from_rotvec(tilt[:, None] * axis) * Rotation.from_rotvec(own)
    assert np.all(euler_angles(turns)[:, bounded].max(axis=1) <= tilt + 1e-9)


# --- refused ----------------------------------------------------------------------------------------------------------

CYLINDER = {"primitives": [{"type": "cylinder", "dimensions": [1, 1]}]}
TWO = {"primitives": [{"type": "sphere", "dimensions": [1]}] * 2}
UP = turn([0, 0, 0, 1], 0.1, 0.1, 4)
GOAL, PATH = "goal_constraints[0]", "path_constraints"
AWAY = {"header": {"frame_id": "camera"}}

REFUSED: list[tuple[Any, ...]] = [
    (GOAL, {"orientation_constraints": [UP]}, "has no position_constraints beside it"),
    (GOAL, {"position_constraints": [BALL, BALL]}, "position_constraints[1]: is about 'hand' again"),
    (
        GOAL,
        {"position_constraints": [BOX]},
        "position_constraints[0]: ",
        "target_point_offset",
        "its pose is the link's",
    ),
    (GOAL, {"position_constraints": [{**BALL, "constraint_region": CYLINDER}]}, "neither a box nor a sphere"),
    (GOAL, {"position_constraints": [{**BALL, "constraint_region": TWO}]}, "constraint_region: ", "one primitive"),
    (GOAL, {"position_constraints": [{"link_name": "a"}]}, "'constraint_region' is missing"),
    (GOAL, {"position_constraints": [{**BALL, **AWAY}]}, "frame_id: unknown frame", "'camera'"),
    (
        GOAL,
        {"position_constraints": [BALL], "orientation_constraints": [{**UP, "link_name": "arm"}]},
        "orientation_constraints[0]: turns 'arm', which has no position_constraints",
    ),
    (
        GOAL,
        {"position_constraints": [BALL], "orientation_constraints": [turn(DOWN, 0.1, 4, 0.1)]},
        "orientation_constraints[0]: leaves y free by Euler angles",
        "x or z alone",
    ),
    (GOAL, {"visibility_constraints": [{"weight": 1}]}, "visibility_constraints: is not supported"),
    (PATH, {"joint_constraints": [{"joint_name": "a"}]}, "joint_constraints: ", "limits.position"),
    (PATH, {"orientation_constraints": [UP, UP]}, "orientation_constraints: ", "one constraint, found 2"),
    (PATH, {"orientation_constraints": [turn(DOWN, 0.1, 0.1, 0.1)]}, "x or z axis free"),
    (PATH, {"orientation_constraints": [turn(DOWN, 4, 4, 0.1)]}, "leaves x and y free"),
    (PATH, {"orientation_constraints": [turn(DOWN, 0.1, 0.1, 4, parameterization=1)]}, "by a rotation vector"),
    (PATH, {"orientation_constraints": [turn(DOWN, 0.1, 0, 4)]}, "absolute_y_axis_tolerance: ", "greater than 0"),
    (PATH, {"orientation_constraints": [turn(DOWN, 0.1, 0.1, 4, tolerance=1)]}, "unknown key 'tolerance'"),
    (
        PATH,
        {"orientation_constraints": [turn([HALF, 0, 0, HALF], 0.1, 0.1, 4)]},
        "keeps the link's z axis along (0, -1, 0)",
        "only up or down",
    ),
    (PATH, {"orientation_constraints": [{**UP, **AWAY}]}, "frame_id: unknown frame 'camera'"),
    (PATH, {"position_constraints": [BALL]}, "position_constraints[0]: ", "not a box"),
    (PATH, {"visibility_constraints": [{"weight": 1}]}, "visibility_constraints: is not supported"),
    (PATH, {"orientation_constraint": [UP]}, "unknown key 'orientation_constraint'", "'orientation_constraints'"),
]


@pytest.mark.parametrize("case", REFUSED)
def test_refused_by_name(tmp_path: Path, case: tuple[Any, ...]) -> None:
    where, constraints, *fragments = case
    with pytest.raises(InputError) as caught:
        request(tmp_path, **{"goal" if where == GOAL else "path": constraints})
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'request.yaml'}: {where}")
    assert "\n" not in message
    for fragment in fragments:
        assert fragment in message


@pytest.mark.parametrize("key", ["tolerance_above", "tolerance_below"])
def test_tolerances_of_joints_are_numbers_that_can_be_met(tmp_path: Path, key: str) -> None:
    goal = {"joint_name": "j1", "position": 1.0}
    for value in (-1e-3, math.nan, "wide", True, [0.1]):
        with pytest.raises(InputError, match=rf"joint_constraints\[0\]\.{key}: must be a finite number at least 0"):
            request(tmp_path, {"joint_constraints": [{**goal, key: value}]})
    assert isinstance(request(tmp_path, {"joint_constraints": [{**goal, key: 0.5}]}).goal, JointTarget)
