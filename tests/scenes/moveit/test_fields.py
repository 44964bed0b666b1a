"""MoveIt's message definitions, field by field: each is understood, noted or refused, as the reader's table says."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hdplan.scenes.errors import InputError
from hdplan.scenes.moveit.fields import MESSAGES, UNDERSTOOD, Noted, Refused, Zero
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene

# Message -> its fields with their types, of ROS 1 (Noetic) and ROS 2 (to Rolling); of moveit_msgs, geometry_msgs,
# sensor_msgs, shape_msgs, octomap_msgs, object_recognition_msgs, trajectory_msgs and std_msgs.
DEFINITIONS = """
PlanningScene: string name, RobotState robot_state, string robot_model_name, TransformStamped[] fixed_frame_transforms,
  AllowedCollisionMatrix allowed_collision_matrix, LinkPadding[] link_padding, LinkScale[] link_scale,
  ObjectColor[] object_colors, PlanningSceneWorld world, bool is_diff
RobotState: JointState joint_state, MultiDOFJointState multi_dof_joint_state,
  AttachedCollisionObject[] attached_collision_objects, bool is_diff
JointState: Header header, string[] name, float64[] position, float64[] velocity, float64[] effort
MultiDOFJointState: Header header, string[] joint_names, Transform[] transforms, Twist[] twist, Wrench[] wrench
AttachedCollisionObject: string link_name, CollisionObject object, string[] touch_links, JointTrajectory detach_posture,
  float64 weight
CollisionObject: Header header, Pose pose, string id, ObjectType type, SolidPrimitive[] primitives,
  Pose[] primitive_poses, Mesh[] meshes, Pose[] mesh_poses, Plane[] planes, Pose[] plane_poses,
  string[] subframe_names, Pose[] subframe_poses, byte operation
SolidPrimitive: uint8 type, float64[] dimensions, Polygon polygon
AllowedCollisionMatrix: string[] entry_names, AllowedCollisionEntry[] entry_values, string[] default_entry_names,
  bool[] default_entry_values
AllowedCollisionEntry: bool[] enabled
LinkPadding: string link_name, float64 padding
LinkScale: string link_name, float64 scale
PlanningSceneWorld: CollisionObject[] collision_objects, OctomapWithPose octomap
OctomapWithPose: Header header, Pose origin, Octomap octomap
Octomap: Header header, bool binary, string id, float64 resolution, int8[] data
MotionPlanRequest: WorkspaceParameters workspace_parameters, RobotState start_state, Constraints[] goal_constraints,
  Constraints path_constraints, TrajectoryConstraints trajectory_constraints,
  GenericTrajectory[] reference_trajectories, string pipeline_id, string planner_id, string group_name,
  int32 num_planning_attempts, float64 allowed_planning_time, float64 max_velocity_scaling_factor,
  float64 max_acceleration_scaling_factor, string cartesian_speed_end_effector_link,
  string cartesian_speed_limited_link, float64 max_cartesian_speed
Constraints: string name, JointConstraint[] joint_constraints, PositionConstraint[] position_constraints,
  OrientationConstraint[] orientation_constraints, VisibilityConstraint[] visibility_constraints
JointConstraint: string joint_name, float64 position, float64 tolerance_above, float64 tolerance_below, float64 weight
PositionConstraint: Header header, string link_name, Vector3 target_point_offset, BoundingVolume constraint_region,
  float64 weight
BoundingVolume: SolidPrimitive[] primitives, Pose[] primitive_poses, Mesh[] meshes, Pose[] mesh_poses
OrientationConstraint: Header header, Quaternion orientation, string link_name, float64 absolute_x_axis_tolerance,
  float64 absolute_y_axis_tolerance, float64 absolute_z_axis_tolerance, uint8 parameterization, float64 weight
Header: uint32 seq, time stamp, string frame_id
TransformStamped: Header header, string child_frame_id, Transform transform
Transform: Vector3 translation, Quaternion rotation
Pose: Point position, Quaternion orientation
Point: float64 x, float64 y, float64 z
Vector3: float64 x, float64 y, float64 z
Quaternion: float64 x, float64 y, float64 z, float64 w
"""
BELOW = """
ObjectColor: string id, ColorRGBA color
ObjectType: string key, string db
Mesh: MeshTriangle[] triangles, Point[] vertices
Plane: float64[4] coef
Polygon: Point32[] points
Twist: Vector3 linear, Vector3 angular
Wrench: Vector3 force, Vector3 torque
JointTrajectory: Header header, string[] joint_names, JointTrajectoryPoint[] points
WorkspaceParameters: Header header, Vector3 min_corner, Vector3 max_corner
TrajectoryConstraints: Constraints[] constraints
GenericTrajectory: Header header, JointTrajectory[] joint_trajectory, CartesianTrajectory[] cartesian_trajectory
VisibilityConstraint: float64 target_radius, PoseStamped target_pose, int32 cone_sides, PoseStamped sensor_pose,
  float64 max_view_angle, float64 max_range_angle, uint8 sensor_view_direction, float64 weight
ColorRGBA: float32 r, float32 g, float32 b, float32 a
"""
"""Messages that stand below fields that are noted or refused whole."""


def parsed(text: str) -> dict[str, dict[str, str]]:
    entries = text.strip().replace("\n  ", " ").splitlines()
    found = {}
    for entry in entries:
        message, _, fields = entry.partition(": ")
        found[message] = {name: kind for kind, name in (field.split() for field in fields.split(", "))}
    return found


KNOWN, WHOLE = parsed(DEFINITIONS), parsed(BELOW)

# What asks for nothing: names and stamps, weights of constraints that are all kept, tolerances of values that are met.
LABELS = {
    *("PlanningScene.name", "Constraints.name", "Header.seq", "Header.stamp", "MultiDOFJointState.joint_names"),
    *("JointConstraint.weight", "PositionConstraint.weight", "OrientationConstraint.weight"),
    *("Octomap.binary", "Octomap.id", "Octomap.resolution"),  # of a map that holds nothing
    "LinkScale.link_name",  # of a scale that is 1
}
ASIDE = (
    "robot_state.joint_state.header",  # joint values have no frame
    "start_state.joint_state.header",
    "world.octomap.header",  # of a map that holds nothing
    "world.octomap.origin",
    "world.octomap.octomap.header",
)


def test_the_table_has_every_field_of_every_message_and_no_other() -> None:
    assert set(MESSAGES) == set(KNOWN)
    for message, fields in KNOWN.items():
        assert set(MESSAGES[message]) == set(fields), message
        for name, kind in fields.items():
            use, of = MESSAGES[message][name], kind.removesuffix("[]")
            if isinstance(use, str) and use != UNDERSTOOD:
                assert use == of, f"{message}.{name}"
            elif of in KNOWN:  # a message that can be understood is not, here
                assert isinstance(use, Noted | Refused | Zero), f"{message}.{name}"
            elif of in WHOLE:
                assert isinstance(use, Noted | Refused | Zero), f"{message}.{name}: {of} is understood nowhere"


HEADER = {"seq": 1, "stamp": {"secs": 1, "nsecs": 2}, "frame_id": "panda_link0"}
TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
POSE = {"position": {"x": 0.9, "y": 0.8, "z": 0.7}, "orientation": TURN}
BALL = {"type": 2, "dimensions": [0.05], "polygon": {"points": []}}
BOX = {"type": 1, "dimensions": [0.5, 0.5, 0.5], "polygon": {"points": []}}
ORIGIN = {"x": 0.0, "y": 0.0, "z": 0.0}
NO_MOVE = {"translation": ORIGIN, "rotation": TURN}
JOINTS = [f"panda_joint{i}" for i in range(1, 8)]


def body(name: str, frame: str) -> dict[str, Any]:
    keys = ("meshes", "mesh_poses", "planes", "plane_poses", "subframe_names", "subframe_poses")
    own = {"header": {**HEADER, "frame_id": frame}, "pose": POSE, "id": name, "type": {"key": "", "db": ""}}
    return {**own, "primitives": [BALL], "primitive_poses": [POSE], **{key: [] for key in keys}, "operation": 0}


def state() -> dict[str, Any]:
    rates = {"velocity": [0.0] * 7, "effort": [0.0] * 7}
    several = {"header": {**HEADER, "frame_id": ""}, "joint_names": ["virtual"], "transforms": [NO_MOVE]}
    held = {"link_name": "panda_hand", "object": body("cup", "panda_hand"), "touch_links": ["panda_leftfinger"]}
    return {
        "joint_state": {"header": HEADER, "name": JOINTS, "position": [0, -0.7, 0, -2, 0, 1.5, 0.7], **rates},
        "multi_dof_joint_state": {**several, "twist": [], "wrench": []},
        "attached_collision_objects": [{**held, "detach_posture": {"joint_names": [], "points": []}, "weight": 0.0}],
        "is_diff": False,
    }


def place() -> dict[str, Any]:
    region = {"primitives": [BOX], "primitive_poses": [POSE], "meshes": [], "mesh_poses": []}
    head = {"header": HEADER, "link_name": "panda_hand", "target_point_offset": ORIGIN}
    return {**head, "constraint_region": region, "weight": 1.0}


def turn() -> dict[str, Any]:
    limits = {"absolute_x_axis_tolerance": 0.2, "absolute_y_axis_tolerance": 0.2, "absolute_z_axis_tolerance": 3.2}
    head = {"header": HEADER, "orientation": TURN, "link_name": "panda_hand"}
    return {**head, **limits, "parameterization": 0, "weight": 1.0}


def files(by_joints: bool) -> dict[str, dict[str, Any]]:
    """A scene and a request that hold every message that is understood."""
    octomap = {"header": HEADER, "binary": False, "id": "", "resolution": 0.0, "data": []}
    joint = {"position": 0.3, "tolerance_above": 0.01, "tolerance_below": 0.01, "weight": 1.0}
    no_goal = {"joint_constraints": [], "position_constraints": [], "orientation_constraints": []}
    goal = {"joint_constraints": [{"joint_name": name, **joint} for name in JOINTS]}
    if not by_joints:
        goal = {"position_constraints": [place()], "orientation_constraints": [turn()]}
    path = {"joint_constraints": [], "position_constraints": [place()], "orientation_constraints": [turn()]}
    scene = {
        "name": "a scene",
        "robot_state": state(),
        "robot_model_name": "panda",
        "fixed_frame_transforms": [{"header": HEADER, "child_frame_id": "marker", "transform": NO_MOVE}],
        "allowed_collision_matrix": {
            "entry_names": ["panda_link0", "other"],
            "entry_values": [{"enabled": [False, True]}, {"enabled": [True, False]}],
            "default_entry_names": ["other"],
            "default_entry_values": [False],
        },
        "link_padding": [{"link_name": "panda_hand", "padding": 0.0}],
        "link_scale": [{"link_name": "panda_hand", "scale": 1.0}],
        "object_colors": [],
        "world": {
            "collision_objects": [body("thing", "panda_link0")],
            "octomap": {"header": HEADER, "origin": POSE, "octomap": octomap},
        },
        "is_diff": False,
    }
    empty = ("pipeline_id", "planner_id", "cartesian_speed_end_effector_link", "cartesian_speed_limited_link")
    zero = ("num_planning_attempts", "allowed_planning_time", "max_acceleration_scaling_factor", "max_cartesian_speed")
    header = {"seq": 0, "stamp": {"secs": 0}, "frame_id": ""}
    request = {
        "workspace_parameters": {"header": header, "min_corner": ORIGIN, "max_corner": ORIGIN},
        "start_state": state(),
        "goal_constraints": [{"name": "goal", **no_goal, **goal, "visibility_constraints": []}],
        "path_constraints": {"name": "path", **path, "visibility_constraints": []},
        "trajectory_constraints": {"constraints": []},
        "reference_trajectories": [],
        "group_name": "panda_arm",
        "max_velocity_scaling_factor": 1.0,
        **dict.fromkeys(empty, ""),
        **dict.fromkeys(zero, 0),
    }
    messages: dict[str, dict[str, Any]] = json.loads(json.dumps({"scene": scene, "request": request}))
    return messages  # in which nothing stands in two places


def load(messages: dict[str, dict[str, Any]], folder: Path) -> Scene:
    for name, content in messages.items():
        (folder / f"{name}.yaml").write_text(json.dumps(content), encoding="utf-8")
    return load_scene(folder / "scene.yaml", folder / "request.yaml", "panda")


def fields(message: str, content: Any, key: str = "") -> Iterator[tuple[str, str, str, dict[str, Any]]]:
    """Yield message, field, its key in the file, and the mapping that holds it, through all that is understood."""
    for name, use in MESSAGES[message].items():
        path = f"{key}.{name}" if key else name
        yield message, name, path, content
        if isinstance(use, str) and use != UNDERSTOOD and content.get(name):
            value = content[name]
            parts = [(f"{path}[0]", value[0])] if isinstance(value, list) else [(path, value)]
            for where, part in parts:
                yield from fields(use, part, where)


def every_field(messages: dict[str, dict[str, Any]]) -> list[tuple[str, str, str, dict[str, Any]]]:
    """All of both messages; of the second problem what it has otherwise, the goal."""
    found = [*fields("PlanningScene", messages["scene"]), *fields("MotionPlanRequest", messages["request"])]
    whole = messages["request"]["goal_constraints"][0]["joint_constraints"]
    return [each for each in found if whole or each[2].startswith("goal_constraints")]


@pytest.fixture(params=[True, False], ids=["goal by joints", "goal by pose"])
def problem(request: pytest.FixtureRequest) -> dict[str, dict[str, Any]]:
    return files(request.param)


def test_every_message_is_in_the_problem(tmp_path: Path, problem: dict[str, dict[str, Any]]) -> None:
    seen = {(message, field) for by_joints in (True, False) for message, field, _, _ in every_field(files(by_joints))}
    assert seen == {(message, field) for message, entries in KNOWN.items() for field in entries}
    assert load(problem, tmp_path).notes == load(problem, tmp_path).notes


RUBBISH = {"rubbish": ["rubbish", {"more": 1}]}
FILLED = {"string": "word", "float64": 0.37, "int32": 3, "bool": True, "float64[]": [0.1] * 7, "int8[]": [1, 2]}


def test_every_unused_field_is_noted_or_refused_by_its_key(tmp_path: Path, problem: dict[str, dict[str, Any]]) -> None:
    """A field with a value is named by its whole key; an empty one has no meaning."""
    quiet = load(problem, tmp_path)
    checked = 0
    for message, field, key, content in every_field(problem):
        use = MESSAGES[message][field]
        if isinstance(use, str):
            continue
        kind = KNOWN[message][field]
        filled = FILLED.get(kind, [RUBBISH] if kind.endswith("[]") else {"rubbish": [1.0]})
        before = content[field]
        content[field] = filled
        if isinstance(use, Refused | Zero):
            with pytest.raises(InputError, match=r"^\S+\.yaml: ") as caught:
                load(problem, tmp_path)
            assert f": {key}: {use.why}" in str(caught.value)
        else:
            scene = load(problem, tmp_path)
            new = [note for note in scene.notes if note not in quiet.notes]
            assert [note for note in new if key in note and note.endswith(use.why)], key
            assert scene == quiet
        content[field] = before
        checked += 1
    assert checked > 2
    assert load(problem, tmp_path).notes == quiet.notes


def test_every_understood_field_is_read(tmp_path: Path, problem: dict[str, dict[str, Any]]) -> None:
    """Rubbish in its place is refused by its key; what asks for nothing may hold anything, and changes nothing."""
    plain = load(problem, tmp_path)
    for message, field, key, content in every_field(problem):
        if MESSAGES[message][field] != UNDERSTOOD:
            continue
        before = content[field]
        content[field] = RUBBISH
        if f"{message}.{field}" in LABELS or key.startswith(ASIDE):
            assert load(problem, tmp_path) == plain, key
        else:
            with pytest.raises(InputError) as caught:
                load(problem, tmp_path)
            owner = key.rpartition(".")[0]
            assert f": {key}" in str(caught.value) or f": {owner}" in str(caught.value), (key, str(caught.value))
        content[field] = before


def test_a_field_that_a_message_does_not_have_is_refused_everywhere(
    tmp_path: Path, problem: dict[str, dict[str, Any]]
) -> None:
    for _, field, key, content in every_field(problem):
        content[f"{field}x"] = 1
        with pytest.raises(InputError, match="unknown key") as caught:
            load(problem, tmp_path)
        assert f"'{field}x'" in str(caught.value), key
        del content[f"{field}x"]
