"""MoveIt's messages, field by field, and what they share: poses, frames, primitives.

The table follows moveit_msgs/PlanningScene and MotionPlanRequest with their parts, in ROS 1 and ROS 2. What is not in
it is rejected, and so is what a scene of hdplan's could not hold, if it is there.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from .balls import HERE, Pose, compose, need
from .scene import one, pose_of, word
from .text import DECIMAL, listing, mapping, yaml_of

# field! must be empty, field~ may hold zeros alone
MESSAGES = {
    "PlanningScene": "name robot_state robot_model_name fixed_frame_transforms allowed_collision_matrix link_padding "
    "link_scale object_colors world is_diff!",
    "PlanningSceneWorld": "collision_objects octomap",
    "OctomapWithPose": "header origin octomap",
    "Octomap": "header binary id resolution data",
    "CollisionObject": "header pose id type primitives primitive_poses meshes! mesh_poses! planes! plane_poses! "
    "subframe_names subframe_poses operation",
    "SolidPrimitive": "type dimensions polygon!",
    "LinkPadding": "link_name padding",
    "LinkScale": "link_name scale",
    "AllowedCollisionMatrix": "entry_names entry_values default_entry_names default_entry_values",
    "AllowedCollisionEntry": "enabled",
    "RobotState": "joint_state multi_dof_joint_state attached_collision_objects is_diff",
    "JointState": "header name position velocity effort",
    "MultiDOFJointState": "header joint_names transforms twist~ wrench",
    "AttachedCollisionObject": "link_name object touch_links detach_posture weight",
    "MotionPlanRequest": "workspace_parameters start_state goal_constraints path_constraints trajectory_constraints! "
    "reference_trajectories! pipeline_id planner_id group_name num_planning_attempts allowed_planning_time "
    "max_velocity_scaling_factor max_acceleration_scaling_factor cartesian_speed_end_effector_link "
    "cartesian_speed_limited_link max_cartesian_speed!",
    "Constraints": "name joint_constraints position_constraints orientation_constraints visibility_constraints!",
    "JointConstraint": "joint_name position tolerance_above tolerance_below weight",
    "PositionConstraint": "header link_name target_point_offset constraint_region weight",
    "BoundingVolume": "primitives primitive_poses meshes! mesh_poses!",
    "OrientationConstraint": "header orientation link_name absolute_x_axis_tolerance absolute_y_axis_tolerance "
    "absolute_z_axis_tolerance parameterization weight",
    "Header": "seq stamp frame_id",
    "TransformStamped": "header child_frame_id transform",
    "Transform": "translation rotation",
    "Pose": "position orientation",
}
SOLIDS = {1: "box", 2: "sphere", 3: "cylinder"}  # shape_msgs/SolidPrimitive
SAME_POSE = 1e-9  # by which two poses of one frame may differ
VARIABLE = re.compile(r"/(x|y|theta|trans_[xyz]|rot_[xyzw])$")  # of a joint that carries a robot's base


def message_of(data: bytes) -> Any:
    """A message that a file holds as YAML; ROS prints `---` after it."""
    return yaml_of(re.sub(rb"^---\s*\Z", b"", data, flags=re.MULTILINE))


def fields(value: Any, message: str, what: str) -> dict[str, Any]:
    """The fields of a message that are given."""
    marked = MESSAGES[message]
    section = mapping(value, what, marked.replace("!", "").replace("~", ""))
    for mark in [x for x in marked.split() if x[-1] in "!~"]:
        item = section.get(mark[:-1])
        need(mark[-1] == "~" or not filled(item), f"{what}.{mark[:-1]}: cannot be checked")
        need(mark[-1] == "!" or zero(item), f"{what}.{mark[:-1]}: is not 0")
    return section


def filled(value: Any) -> bool:
    """True if there is anything in a value: a list with entries, a text, a number that is not 0."""
    return any(map(filled, value.values())) if isinstance(value, dict) else bool(value)


def zero(value: Any) -> bool:
    """True if there are only zeros in a value."""
    inner = value.values() if isinstance(value, dict) else value
    return all(map(zero, inner)) if isinstance(value, (dict, list)) else not value


def number(value: Any, what: str, low: float = -np.inf, high: float = np.inf) -> float:
    """A number, which may be a text: YAML takes 1e-05 for one."""
    found = one(float(value) if type(value) is str and DECIMAL.fullmatch(value) else value, what)
    need(low <= found <= high, f"{what}: {found:g} is not from {low:g} to {high:g}")
    return found


def numbers(value: Any, count: int | None, what: str) -> list[float]:
    """A list of as many numbers."""
    found = [number(x, what) for x in listing(value, what)]
    need(count in (None, len(found)), f"{what}: {count} numbers are expected, found {len(found)}")
    return found


def words(value: Any, what: str) -> list[str]:
    """A list of names."""
    return [word(x, what) for x in listing(value, what)]


def vector(value: Any, what: str, parts: str = "x y z") -> list[float]:
    """A vector or quaternion, as a list or as a mapping of its parts, of which x, y and z are 0 if they are missing."""
    if isinstance(value, dict):
        section = mapping(value, what, parts)
        need("w" in section or "w" not in parts, f"{what}: has no w, which is 0 in ROS 1 and 1 in ROS 2")
        value = [section.get(x, 0.0) for x in parts.split()]
    return numbers(value, len(parts.split()), what)


def pose(value: Any, what: str, message: str = "Pose") -> Pose:
    """The pose of a message, or a Transform; what is missing is 0."""
    section = fields({} if value is None else value, message, what)
    place, turn = (section.get(x) for x in MESSAGES[message].split())
    found: dict[str, Any] = {} if place is None else {"position": vector(place, what)}
    return pose_of(found | ({} if turn is None else {"quaternion_xyzw": vector(turn, what, "x y z w")}), what)


def solid(value: Any, what: str) -> dict[str, Any]:
    """A primitive as a scene has it."""
    section = fields(value, "SolidPrimitive", what)
    kind, sizes = section.get("type"), numbers(section.get("dimensions"), None, what)
    kind = SOLIDS.get(kind) if type(kind) is int else kind
    need((kind, len(sizes)) in (("box", 3), ("sphere", 1), ("cylinder", 2)), f"{what}: no box, sphere or cylinder")
    need(min(sizes) > 0, f"{what}: a size is not above 0")
    if kind == "box":
        return {"type": kind, "size": sizes}
    return {"type": kind, "radius": sizes[-1], **({"length": sizes[0]} if kind == "cylinder" else {})}


def solids(section: dict[str, Any], what: str) -> list[tuple[dict[str, Any], Pose]]:
    """Primitives with their poses, of which there are as many, or none."""
    shapes = [solid(x, what) for x in listing(section.get("primitives"), what)]
    poses = [pose(x, what) for x in listing(section.get("primitive_poses"), what)]
    need(len(poses) in (0, len(shapes)), f"{what}: has other poses than primitives")
    return list(zip(shapes, poses or [HERE] * len(shapes), strict=True))


def same(one_: Pose, two: Pose) -> bool:
    """True if two poses are equal, but for rounding."""
    return all(np.abs(a.mid - b.mid).max() <= SAME_POSE for a, b in zip(one_, two, strict=True))


class Frames:
    """Frames in which poses may be given: the world, the robot's root link, links fixed to it, and frames that the
    scene fixes to them. Where an object, one of the `things`, has the name of such a frame, or a frame of its own has,
    MoveIt takes the object's."""

    def __init__(self, at: dict[str, tuple[int, Pose]], joints: Iterable[str], transforms: Any) -> None:
        """Take the links, each with the joint that moves it (-1: none) and its frame there, and the joints' names."""
        self.things, self.joints, self.links = set[str](), {*joints}, {*at}
        self.moving = {link for link, (joint, _) in at.items() if joint >= 0}
        self.poses: dict[str, Pose] = {link: place for link, (joint, place) in at.items() if joint < 0} | {"": HERE}
        if "world" in self.moving or not same(self.poses.setdefault("world", HERE), HERE):
            self.poses.pop("world", None)  # a link of this name is elsewhere
        for i, entry in enumerate(listing(transforms, "fixed_frame_transforms")):
            what = f"fixed_frame_transforms[{i}]"
            section = fields(entry, "TransformStamped", what)
            place = compose(self.of(section.get("header"), what), pose(section.get("transform"), what, "Transform"))
            name = str(section.get("child_frame_id", "")).removeprefix("/")
            need(name not in self.moving, f"{what}: '{name}' moves with the robot")
            need(same(self.poses.setdefault(name, place), place), f"{what}: '{name}' has another pose already")

    def of(self, header: Any, what: str) -> Pose:
        """The pose of the frame that a header names."""
        name = str(fields({} if header is None else header, "Header", what).get("frame_id", "")).removeprefix("/")
        need(name in self.poses, f"{what}: the frame '{name}' is not known, or moves")
        own = name in self.links or not any(f"{name}/".startswith(f"{x}/") for x in self.things)
        need(own, f"{what}: the frame '{name}' has the name of an object, or of a part of one")
        return self.poses[name]

    def check_base(self, values: dict[str, float], what: str) -> None:
        """Reject values of joints that would move the robot's base."""
        for name, at in values.items():
            there = name in self.joints or not VARIABLE.search(name) or at == float(name.endswith("w"))
            need(there, f"{what}: '{name}' moves the robot's base")
