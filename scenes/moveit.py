"""MoveIt files: a planning scene (what stands around) and a motion plan request (from where to where) become a `Scene`.

The keys are the fields of the ROS messages moveit_msgs/PlanningScene and MotionPlanRequest. Whatever would change the
problem and is not supported is refused by name; only what does not touch a geometric path (times, planner names,
colours) is passed over.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path

from hdplan.scenes.fields import Field, read_document
from hdplan.scenes.model import Attached, JointTarget, Obstacle, PathConstraints, Pose, RobotSpec, Scene
from hdplan.scenes.moveit_constraints import read_goal_constraints, read_path_constraints
from hdplan.scenes.moveit_messages import is_filled, read_message_pose, read_primitive, refuse_other_frame
from hdplan.scenes.poses import compose, read_quaternion, read_vector

SCENE_KEYS = (
    "name",
    "robot_state",
    "robot_model_name",
    "fixed_frame_transforms",
    "allowed_collision_matrix",
    "link_padding",
    "link_scale",
    "object_colors",
    "world",
    "is_diff",
)
REQUEST_KEYS = (
    "workspace_parameters",
    "start_state",
    "goal_constraints",
    "path_constraints",
    "trajectory_constraints",
    "reference_trajectories",
    "pipeline_id",
    "planner_id",
    "group_name",
    "num_planning_attempts",
    "allowed_planning_time",
    "max_velocity_scaling_factor",
    "max_acceleration_scaling_factor",
    "cartesian_speed_end_effector_link",
    "cartesian_speed_limited_link",
    "max_cartesian_speed",
)
STATE_KEYS = ("joint_state", "multi_dof_joint_state", "attached_collision_objects", "is_diff")
ATTACHED_KEYS = ("link_name", "object", "touch_links", "detach_posture", "weight")
OBJECT_KEYS = (
    "header",
    "pose",
    "id",
    "type",
    "primitives",
    "primitive_poses",
    "meshes",
    "mesh_poses",
    "planes",
    "plane_poses",
    "subframe_names",
    "subframe_poses",
    "operation",
)
IDENTITY = 1e-9  # largest entry by which a transform may differ from the identity


def is_moveit_scene(keys: Collection[str]) -> bool:
    """Tell a planning scene by its top-level keys."""
    return not {"world", "robot_model_name", "allowed_collision_matrix", "fixed_frame_transforms"}.isdisjoint(keys)


def is_moveit_request(keys: Collection[str]) -> bool:
    """Tell a motion plan request by its top-level keys."""
    return not {"goal_constraints", "start_state", "group_name"}.isdisjoint(keys)


def read_moveit(scene: Field, request_file: Path, robot: RobotSpec) -> Scene:
    """Read a planning scene, whose document is read already, and its request.

    Obstacles are the scene's collision objects; the primitives of an object after its first are called ``id/1``,
    ``id/2`` and so on. The start is the request's start state over the scene's robot state; the goal is the request's,
    by joints or by a link's pose. Start and goal hold every joint that the files name: which of them the robot has is
    known when it is loaded.
    Objects attached in the scene's robot state or the request's start state are held, a later one in place of an
    earlier one of the same name.

    Raises:
        InputError: a bad file or field, or something that hdplan cannot plan for: meshes, planes, cones, octomaps,
            objects attached in another frame than their link's, moved frames, several goals, and constraints that a
            scene cannot say (see `moveit_constraints`).
    """
    scene, request = scene.with_text_numbers(), read_document(request_file).with_text_numbers()
    if is_moveit_scene(request.mapping()):
        raise request.error("is a MoveIt planning scene, but a motion plan request is wanted here (--request)")
    scene_keys = scene.mapping(SCENE_KEYS)
    request_keys = request.mapping(REQUEST_KEYS, required=["goal_constraints"])
    obstacles = _world(scene_keys["world"]) if "world" in scene_keys else {}
    for transform in scene_keys["fixed_frame_transforms"].items() if "fixed_frame_transforms" in scene_keys else ():
        keys = transform.mapping(("header", "child_frame_id", "transform"))
        _refuse_moved(keys.get("transform"), "a fixed frame")
    for key in ("link_padding", "link_scale"):
        if key in scene_keys and is_filled(scene_keys[key].value):
            scene_keys[key].note("is not applied: links keep their size; the planner's clearance pads them all")
    if "allowed_collision_matrix" in scene_keys:
        _note_allowed_objects(scene_keys["allowed_collision_matrix"], obstacles)
    for key in ("trajectory_constraints", "reference_trajectories"):
        if key in request_keys and is_filled(request_keys[key].value):
            raise request_keys[key].error("is not supported: a motion is bound by path_constraints alone")
    start = _state(scene_keys.get("robot_state")) | _state(request_keys.get("start_state"))
    if not start:
        raise request.error(
            "start_state.joint_state: is missing or empty, and the scene's robot_state too: there is no start"
        )
    attached = _attached(scene_keys.get("robot_state"), obstacles) | _attached(
        request_keys.get("start_state"), obstacles
    )
    constraints = request_keys.get("path_constraints")
    return scene.make(
        Scene,
        name=scene.document.file.stem,
        source=scene.document.file,
        robot=robot,
        obstacles=tuple(obstacles.values()),
        attached=tuple(attached.values()),
        start=JointTarget(f"start ({request_file})", by_name=start),
        goal=read_goal_constraints(request_keys["goal_constraints"], f"goal ({request_file})"),
        path=read_path_constraints(constraints) if constraints else PathConstraints(),
        from_request=True,
        notes=(*scene.document.notes, *request.document.notes),
    )


# What stands around


def _world(section: Field) -> dict[str, Obstacle]:
    keys = section.mapping(("collision_objects", "octomap"))
    if "octomap" in keys and is_filled(keys["octomap"].value):
        raise keys["octomap"].error("octomaps are not supported yet")
    obstacles: dict[str, Obstacle] = {}
    for i, entry in enumerate(keys["collision_objects"].items() if "collision_objects" in keys else ()):
        for obstacle in _collision_object(entry, default_name=f"obstacle{i}"):
            if obstacle.name in obstacles:
                raise entry.error(f"the name {obstacle.name!r} is taken by an earlier object; names must differ")
            obstacles[obstacle.name] = obstacle
    return obstacles


def _collision_object(entry: Field, default_name: str, link: str = "") -> list[Obstacle]:
    """Return an object's primitives, each by a name of its own, in the world's frame or that of the link named."""
    keys = entry.mapping(OBJECT_KEYS)
    for key in ("meshes", "planes"):
        if key in keys and is_filled(keys[key].value):
            raise keys[key].error(f"{key} in MoveIt scenes are not supported yet (box, cylinder and sphere are)")
    if "operation" in keys and keys["operation"].value != 0:
        raise keys["operation"].wrong("0 (ADD)")
    refuse_other_frame(entry, keys.get("header"), link)
    name = keys["id"].text() if "id" in keys and keys["id"].value != "" else default_name
    primitives = keys["primitives"].items() if "primitives" in keys else []
    if not primitives:
        raise entry.error(f"the object {name!r} has no primitives, so it has no shape")
    placed = keys["primitive_poses"].items() if "primitive_poses" in keys else []
    if placed and len(placed) != len(primitives):
        raise keys["primitive_poses"].error(f"must be as many as the {len(primitives)} primitives, found {len(placed)}")
    outer = read_message_pose(keys["pose"]) if "pose" in keys else Pose()
    inner = [read_message_pose(pose) for pose in placed] or [Pose()] * len(primitives)
    names = [name, *(f"{name}/{i}" for i in range(1, len(primitives)))]
    return [
        Obstacle(name, read_primitive(shape), compose(outer, pose))
        for name, shape, pose in zip(names, primitives, inner, strict=True)
    ]


def _attached(state: Field | None, standing: Collection[str]) -> dict[str, Attached]:
    """Return what a robot state attaches to its links, each primitive by a name of its own."""
    keys = state.mapping(STATE_KEYS) if state is not None else {}
    attached: dict[str, Attached] = {}
    entries = keys["attached_collision_objects"].items() if "attached_collision_objects" in keys else []
    for entry in entries:
        said = entry.mapping(ATTACHED_KEYS, required=["link_name", "object"])
        link = said["link_name"].text()
        touching = tuple(name.text() for name in said["touch_links"].items()) if "touch_links" in said else ()
        for part in _collision_object(said["object"], entry.key, link):
            if part.name in attached or part.name in standing:
                raise entry.error(f"the name {part.name!r} is taken by an earlier object; names must differ")
            attached[part.name] = Attached(part.name, link, part.shape, part.pose, touching)
    return attached


def _note_allowed_objects(section: Field, obstacles: Collection[str]) -> None:
    """Leave a word where the scene lets a link touch an object: hdplan keeps them apart all the same.

    Pairs of links are left to the robot's SRDF, which is stricter.
    """
    keys = section.mapping(("entry_names", "entry_values", "default_entry_names", "default_entry_values"))
    names = [item.text() for item in keys["entry_names"].items()] if "entry_names" in keys else []
    rows = keys["entry_values"].items(len(names)) if "entry_values" in keys else []
    defaults = [item.text() for item in keys["default_entry_names"].items()] if "default_entry_names" in keys else []
    objects = {name.partition("/")[0] for name in obstacles}
    touching = [f"{name} (with anything)" for name in defaults if name in objects]
    for name, row in zip(names, rows, strict=False):
        if name in objects:
            # In ROS 2 messages a row is a mapping {enabled: [...]}.
            values = row.mapping(("enabled",), ["enabled"])["enabled"] if isinstance(row.value, dict) else row
            allowed = zip(names, values.items(len(names), "truth values"), strict=True)
            touching += [f"{link}-{name}" for link, entry in allowed if link not in objects and entry.boolean()]
    if touching:
        more = f" and {len(touching) - 3} more" if len(touching) > 3 else ""
        section.note(f"allows contact of {', '.join(touching[:3])}{more}; hdplan still keeps them apart")


# From where to where


def _state(section: Field | None) -> dict[str, float]:
    """Return joint name -> value [rad or m] of a robot state."""
    if section is None:
        return {}
    keys = section.mapping(STATE_KEYS)
    if "multi_dof_joint_state" in keys:
        multi = keys["multi_dof_joint_state"].mapping(("header", "joint_names", "transforms", "twist", "wrench"))
        for transform in multi["transforms"].items() if "transforms" in multi else ():
            _refuse_moved(transform, "the robot's base")
    if "joint_state" not in keys:
        return {}
    joints = keys["joint_state"].mapping(("header", "name", "position", "velocity", "effort"))
    names = [item.text() for item in joints["name"].items()] if "name" in joints else []
    if len(set(names)) != len(names):
        raise joints["name"].error(f"names a joint twice: {next(name for name in names if names.count(name) > 1)!r}")
    values = joints["position"].items() if "position" in joints else []
    if len(values) != len(names):
        raise keys["joint_state"].error(f"must have as many positions as names, found {len(values)} and {len(names)}")
    return {name: value.number(unit="rad or m") for name, value in zip(names, values, strict=True)}


def _refuse_moved(transform: Field | None, what: str) -> None:
    keys = transform.mapping(("translation", "rotation")) if transform else {}
    shift = read_vector(keys["translation"], unit="m") if "translation" in keys else (0.0, 0.0, 0.0)
    turn = read_quaternion(keys["rotation"]) if "rotation" in keys else (0.0, 0.0, 0.0, 1.0)
    if transform and math.hypot(*shift, *turn[:3]) > IDENTITY:
        raise transform.error(
            f"moves {what}, which is not supported: place the robot with `base` in the robot section (--robot FILE)"
        )
