"""MoveIt files: a planning scene (obstacles, robot state) and a motion plan request (start, goal) become a `Scene`.

The keys are the fields of the ROS messages moveit_msgs/PlanningScene and MotionPlanRequest; `fields` says what
is done with each. Whatever would change the problem and is not supported is refused by name.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Mapping
from pathlib import Path

from hdplan.scenes.attached import Attached
from hdplan.scenes.errors import naming
from hdplan.scenes.fields import Field, read_document
from hdplan.scenes.moveit.allowed_collisions import read_allowed
from hdplan.scenes.moveit.constraints import read_goal_constraints, read_path_constraints
from hdplan.scenes.moveit.fields import MESSAGES, check_message, is_filled
from hdplan.scenes.moveit.frames import Frames, same_place
from hdplan.scenes.moveit.messages import read_message_pose, read_primitive, read_transform
from hdplan.scenes.moveit.octomap import read_octomap
from hdplan.scenes.moveit.padding import read_padding
from hdplan.scenes.moveit.speed import read_speed
from hdplan.scenes.obstacles import Obstacle, Seen
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.poses import Pose, compose
from hdplan.scenes.robot_files.description import Semantics, read_words
from hdplan.scenes.robot_files.library import description_of, source_of
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import JointTarget

PRESCRIBED = re.compile(r"pilz|\b(LIN|CIRC|PTP)\b", re.IGNORECASE)  # planners of one shape of motion


def is_moveit_scene(keys: Collection[str]) -> bool:
    """Tell whether top-level keys are those of a planning scene."""
    return not {"world", "robot_model_name", "allowed_collision_matrix", "fixed_frame_transforms"}.isdisjoint(keys)


def is_moveit_request(keys: Collection[str]) -> bool:
    """Tell whether top-level keys are those of a motion plan request."""
    return not {"goal_constraints", "start_state", "group_name"}.isdisjoint(keys)


def read_moveit(scene: Field, request_file: Path, robot: RobotSpec) -> Scene:
    """Read a planning scene, whose document is read already, and its request.

    The robot is planned for the group that the request names. Obstacles are the scene's collision objects, given in the
    world or in the frame of the robot's root link, of a link fixed to it or of `fixed_frame_transforms`; the primitives
    of an object after its first are called ``id/1``, ``id/2`` and so forth. The start is the scene's robot state,
    overridden by the request's start state; the goal is the request's, by joints or by a link's pose. Start and goal
    hold every joint that the files name; which of them the robot has is checked when it is loaded. Objects attached in
    the scene's robot state or the request's start state are attached, a later one replacing an earlier one of the same
    name.

    Raises:
        InputError: a bad file or field, an unknown group, or a request beyond hdplan's abilities: see `fields`
            and `constraints`; objects attached in a frame other than their link's, moved bases, several goals.
    """
    scene, request = scene.with_text_numbers(), read_document(request_file).with_text_numbers()
    if is_moveit_scene(request.mapping()):
        raise request.error("is a MoveIt planning scene, but a motion plan request is needed here (--request)")
    check_message(scene, "PlanningScene")
    check_message(request, "MotionPlanRequest")
    scene_keys = scene.mapping(MESSAGES["PlanningScene"])
    request_keys = request.mapping(MESSAGES["MotionPlanRequest"], required=["goal_constraints"])
    _check_planner(request_keys, robot)
    with naming(robot.source or scene.document.file):
        name, _, srdf, _ = description_of(robot)
        tree, semantics = read_words(source_of(robot), srdf)
    model = scene_keys.get("robot_model_name")
    another = model is not None and model.value != "" and model.text() not in (name, tree.name)
    if model and another:
        model.note(f"names the robot {model.value!r}, not {name}")
    if "group_name" in request_keys:
        robot = _of_group(robot, request_keys["group_name"], semantics, (name, tree.name))
    transforms = scene_keys["fixed_frame_transforms"].items() if "fixed_frame_transforms" in scene_keys else ()
    frames = Frames.of(tree, robot.base).with_transforms(transforms)
    states = [keys[key] for keys, key in ((scene_keys, "robot_state"), (request_keys, "start_state")) if key in keys]
    read = [_state(state, frames, robot.base) for state in states]
    start = {joint: value for positions, _ in read for joint, value in positions.items()}
    speeds = {joint: value for _, velocities in read for joint, value in velocities.items() if joint in start}
    moving = states[-1] if any(speeds.values()) else None
    if not start:
        raise request.error(
            "start_state.joint_state: is missing or empty, and the scene's robot_state too: there is no start"
        )
    attached = _all_attached(scene_keys.get("robot_state"), request_keys.get("start_state"))
    frames = frames.beside(part.name for part in attached)
    obstacles = _world(scene_keys["world"], frames) if "world" in scene_keys else {}
    frames = frames.beside(obstacles)
    if "allowed_collision_matrix" in scene_keys:
        matrix = scene_keys["allowed_collision_matrix"]
        added = read_allowed(matrix, tree, semantics, robot, obstacles, attached, another)
        robot = dataclasses.replace(robot, check_pairs=tuple(dict.fromkeys((*robot.check_pairs, *added))))
    if clearance := read_padding(scene_keys, tree):
        obstacles = {name: dataclasses.replace(each, clearance=clearance) for name, each in obstacles.items()}
    constraints = request_keys.get("path_constraints")
    return scene.make(
        Scene,
        name=scene.document.file.stem,
        source=scene.document.file,
        robot=robot,
        obstacles=tuple(obstacles.values()),
        attached=attached,
        start=JointTarget(f"start ({request_file})", by_name=start, velocity=speeds if moving else None),
        limits=read_speed(request_keys, tree, semantics, robot, moving),
        goal=read_goal_constraints(request_keys["goal_constraints"], f"goal ({request_file})", frames),
        path=read_path_constraints(constraints, frames) if constraints else PathConstraints(),
        from_request=True,
        notes=(*scene.document.notes, *request.document.notes),
    )


def _of_group(robot: RobotSpec, group_name: Field, semantics: Semantics, names: Collection[str]) -> RobotSpec:
    """Return the robot planned for the group that the request names; unchanged, with a note, if it names none or no
    SRDF says which joints it has."""
    if group_name.value == "":
        return robot
    group, own = group_name.text(), robot.group
    if not semantics.groups:
        if own is None:
            group_name.note(f"is {group!r}, whose joints no SRDF lists: all joints that can be planned are planned")
        return robot
    with naming(f"{robot.source}: robot.group"):
        own = semantics.group(own, names) if isinstance(own, str) else own
    with naming(f"{group_name.document.file}: {group_name.key}"):
        group = semantics.group(group, names)
    if own not in (None, group):
        raise group_name.error(f"is {group!r}, but the robot's own section says {own!r} (robot.group)")
    return dataclasses.replace(robot, group=group)


def _check_planner(keys: Mapping[str, Field], robot: RobotSpec) -> None:
    """Refuse planners that prescribe the motion's shape, and bounds of a base that can move."""
    for key in ("pipeline_id", "planner_id"):
        if key in keys and PRESCRIBED.search(str(keys[key].value)):
            raise keys[key].error(
                f"{keys[key].value!r} prescribes the shape of the motion (Pilz's LIN, CIRC, PTP), which is not "
                "supported: leave it empty for any free motion"
            )
    space = keys.get("workspace_parameters")
    if robot.base_joints is not None and space is not None and is_filled(space.value):
        raise space.error("bounds the mobile base, as robot.base_joints do here: leave one of them out")


# What stands around


def _world(section: Field, frames: Frames) -> dict[str, Obstacle]:
    keys = section.mapping(MESSAGES["PlanningSceneWorld"])
    obstacles: dict[str, Obstacle] = {}
    for i, entry in enumerate(keys["collision_objects"].items() if "collision_objects" in keys else ()):
        message = entry.mapping(MESSAGES["CollisionObject"])
        place = frames.beside(obstacles).of_header(message.get("header"))
        for obstacle in _collision_object(entry, message, place, default_name=f"obstacle{i}"):
            if obstacle.name in obstacles or obstacle.name in frames.objects:
                raise entry.error(f"the name {obstacle.name!r} is taken by an earlier object; names must differ")
            obstacles[obstacle.name] = obstacle
    if "octomap" in keys and (found := read_octomap(keys["octomap"], frames.beside(obstacles))):
        if found.name in obstacles or found.name in frames.objects:
            raise keys["octomap"].error(f"its name {found.name!r} is taken by an object; names must differ")
        obstacles[found.name] = found
    return obstacles


def _collision_object(entry: Field, keys: Mapping[str, Field], frame: Pose, default_name: str) -> list[Obstacle]:
    """Return an object's primitives as obstacles, each with its own name; the object is given in `frame`."""
    if "operation" in keys and keys["operation"].value != 0:
        raise keys["operation"].wrong("0 (ADD)")
    name = keys["id"].text() if "id" in keys and keys["id"].value != "" else default_name
    primitives = keys["primitives"].items() if "primitives" in keys else []
    if not primitives:
        raise entry.error(f"the object {name!r} has no primitives, so it has no shape")
    placed = keys["primitive_poses"].items() if "primitive_poses" in keys else []
    if placed and len(placed) != len(primitives):
        raise keys["primitive_poses"].error(f"must be as many as the {len(primitives)} primitives, found {len(placed)}")
    outer = compose(frame, read_message_pose(keys.get("pose")))
    inner = [read_message_pose(pose) for pose in placed] or [Pose()] * len(primitives)
    names = [name, *(f"{name}/{i}" for i in range(1, len(primitives)))]
    return [
        Obstacle(name, read_primitive(shape), compose(outer, pose))
        for name, shape, pose in zip(names, primitives, inner, strict=True)
    ]


def _all_attached(state: Field | None, start: Field | None) -> tuple[Attached, ...]:
    """Return the attached objects: the scene's, each replaced by the request's of the same name."""
    held, more = (_attached(each) for each in (state, start))
    whole = start is not None and not _is_diff(start)
    if state is not None and _is_diff(state):
        state.note("is_diff is true: joints and attached objects that it leaves out are unknown, and not changed")
    if start is not None and whole and held.keys() - more.keys():
        start.note("is_diff is not true, but objects attached in the scene's state stay attached")
    return tuple(part for parts in (held | more).values() for part in parts)


def _is_diff(state: Field) -> bool:
    keys = state.mapping(MESSAGES["RobotState"])
    return keys["is_diff"].boolean() if "is_diff" in keys else False


def _attached(state: Field | None) -> dict[str, list[Attached]]:
    """Return the objects that a robot state attaches to its links: object -> its primitives, each with its own name."""
    keys = state.mapping(MESSAGES["RobotState"]) if state is not None else {}
    attached: dict[str, list[Attached]] = {}
    taken = set[str]()
    entries = keys["attached_collision_objects"].items() if "attached_collision_objects" in keys else []
    for entry in entries:
        message = entry.mapping(MESSAGES["AttachedCollisionObject"], required=["link_name", "object"])
        link = message["link_name"].text()
        touching = message["touch_links"].texts() if "touch_links" in message else ()
        body = message["object"].mapping(MESSAGES["CollisionObject"])
        header = body["header"].mapping(MESSAGES["Header"]) if "header" in body else {}
        frame = header["frame_id"].value if "frame_id" in header else ""
        if frame != link:
            where = header.get("frame_id", message["object"])
            raise where.error(f"must be given in the frame of its link '{link}' (frame_id), found {frame!r}")
        parts = _collision_object(message["object"], body, Pose(), entry.key)
        if again := [part.name for part in parts if part.name in taken]:
            raise entry.error(f"the name {again[0]!r} is taken by an earlier object; names must differ")
        taken |= {part.name for part in parts}
        attached[parts[0].name] = [
            Attached(part.name, link, part.shape, part.pose, touching)
            for part in parts
            if not isinstance(part.shape, Seen)  # MoveIt's objects are solids
        ]
    return attached


# Start


def _state(section: Field, frames: Frames, base: Pose) -> tuple[dict[str, float], dict[str, float]]:
    """Return joint name -> value [rad or m], and joint name -> velocity [rad/s or m/s], 0 where it has none, of a robot
    state whose base is at the world's origin, or at `base`."""
    keys = section.mapping(MESSAGES["RobotState"])
    if "multi_dof_joint_state" in keys:
        multi = keys["multi_dof_joint_state"].mapping(MESSAGES["MultiDOFJointState"])
        for transform in multi["transforms"].items() if "transforms" in multi else ():
            place = compose(frames.of_header(multi.get("header")), read_transform(transform))
            if not any(same_place(place, allowed) for allowed in (Pose(), base)):
                raise transform.error(
                    "moves the robot's base, which is not supported: place the robot with `base` in the robot section "
                    "(--robot FILE)"
                )
    if "joint_state" not in keys:
        return {}, {}
    joints = keys["joint_state"].mapping(MESSAGES["JointState"])
    names = joints["name"].texts() if "name" in joints else ()
    if len(set(names)) != len(names):
        raise joints["name"].error(f"names a joint twice: {next(name for name in names if names.count(name) > 1)!r}")
    values = joints["position"].numbers(unit="rad or m") if "position" in joints else ()
    if len(values) != len(names):
        raise keys["joint_state"].error(f"must have as many positions as names, found {len(values)} and {len(names)}")
    speeds = joints["velocity"].numbers(unit="rad/s or m/s") if "velocity" in joints else ()
    if speeds and len(speeds) != len(names):
        raise keys["joint_state"].error(f"must have as many velocities as names, found {len(speeds)} and {len(names)}")
    found = dict(zip(names, values, strict=True))
    for joint, value in found.items():
        frames.check_base(joint, value, section)
    return found, dict(zip(names, speeds or [0.0] * len(names), strict=True))
