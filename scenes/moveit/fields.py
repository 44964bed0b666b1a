"""The treatment of every field of MoveIt's messages: understood, noted because it is not used, or refused by name.

The table follows moveit_msgs/PlanningScene and MotionPlanRequest with all their parts, in ROS 1 and ROS 2. A field that
is not in it is misspelt, and refused too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from hdplan.scenes.fields import Field


@dataclass(frozen=True)
class Noted:
    """The field has no effect here, or cannot be honoured; where it is filled, a note says so."""

    why: str


@dataclass(frozen=True)
class Refused:
    """The field would change the problem and cannot be honoured: where it is filled, it is an error."""

    why: str


@dataclass(frozen=True)
class Zero:
    """The field may hold zeros alone: anything else would change the problem, and is an error."""

    why: str


UNDERSTOOD: Final = ""  # a field without fields of its own; one that has some is understood by the name of its message
Use = str | Noted | Refused | Zero

PLANNERS = Noted("configures MoveIt's planners, and is not used")
OF_A_SPEED = Noted("says nothing without max_cartesian_speed")
AT_REST = Zero("is not 0: a base that moves is not supported")
EFFORT = Noted("does not affect where the robot is, and is not used")
ASIDE = Noted("does not affect where bodies are, and is not used")
SHAPES = "in MoveIt scenes are not supported yet (box, cylinder and sphere are)"
REGIONS = Refused("meshes are not supported (a box or a sphere is)")

MESSAGES: Mapping[str, Mapping[str, Use]] = {
    "PlanningScene": {
        "name": UNDERSTOOD,
        "robot_state": "RobotState",
        "robot_model_name": UNDERSTOOD,
        "fixed_frame_transforms": "TransformStamped",
        "allowed_collision_matrix": "AllowedCollisionMatrix",
        "link_padding": "LinkPadding",
        "link_scale": "LinkScale",
        "object_colors": ASIDE,
        "world": "PlanningSceneWorld",
        "is_diff": Refused(
            "true: it holds only the differences from another scene, which is not in the file; a whole scene is needed"
        ),
    },
    "PlanningSceneWorld": {"collision_objects": "CollisionObject", "octomap": "OctomapWithPose"},
    "OctomapWithPose": {"header": "Header", "origin": "Pose", "octomap": "Octomap"},
    "Octomap": {
        "header": "Header",
        "binary": UNDERSTOOD,
        "id": UNDERSTOOD,
        "resolution": UNDERSTOOD,
        "data": UNDERSTOOD,
    },
    "CollisionObject": {
        "header": "Header",
        "pose": "Pose",
        "id": UNDERSTOOD,
        "type": ASIDE,
        "primitives": "SolidPrimitive",
        "primitive_poses": "Pose",
        "meshes": Refused(f"meshes {SHAPES}"),
        "mesh_poses": Refused(f"meshes {SHAPES}"),
        "planes": Refused(f"planes {SHAPES}"),
        "plane_poses": Refused(f"planes {SHAPES}"),
        "subframe_names": ASIDE,
        "subframe_poses": ASIDE,
        "operation": UNDERSTOOD,
    },
    "SolidPrimitive": {
        "type": UNDERSTOOD,
        "dimensions": UNDERSTOOD,
        "polygon": Refused("prisms are not supported yet (box, cylinder and sphere are)"),
    },
    "LinkPadding": {"link_name": UNDERSTOOD, "padding": UNDERSTOOD},
    "LinkScale": {"link_name": UNDERSTOOD, "scale": UNDERSTOOD},
    "AllowedCollisionMatrix": {
        "entry_names": UNDERSTOOD,
        "entry_values": "AllowedCollisionEntry",
        "default_entry_names": UNDERSTOOD,
        "default_entry_values": UNDERSTOOD,
    },
    "AllowedCollisionEntry": {"enabled": UNDERSTOOD},
    "RobotState": {
        "joint_state": "JointState",
        "multi_dof_joint_state": "MultiDOFJointState",
        "attached_collision_objects": "AttachedCollisionObject",
        "is_diff": UNDERSTOOD,
    },
    "JointState": {
        "header": "Header",
        "name": UNDERSTOOD,
        "position": UNDERSTOOD,
        "velocity": UNDERSTOOD,
        "effort": EFFORT,
    },
    "MultiDOFJointState": {
        "header": "Header",
        "joint_names": UNDERSTOOD,
        "transforms": "Transform",
        "twist": AT_REST,
        "wrench": EFFORT,
    },
    "AttachedCollisionObject": {
        "link_name": UNDERSTOOD,
        "object": "CollisionObject",
        "touch_links": UNDERSTOOD,
        "detach_posture": ASIDE,
        "weight": Noted("is not used, as its unit is unknown: use attached[].mass [kg] in a hdplan scene"),
    },
    "MotionPlanRequest": {
        "workspace_parameters": Noted("bounds the motion of mobile bases, and is not used: the base is fixed"),
        "start_state": "RobotState",
        "goal_constraints": "Constraints",
        "path_constraints": "Constraints",
        "trajectory_constraints": Refused("is not supported: only path_constraints are"),
        "reference_trajectories": Refused("is not supported: only path_constraints are"),
        "pipeline_id": PLANNERS,
        "planner_id": PLANNERS,
        "group_name": UNDERSTOOD,
        "num_planning_attempts": PLANNERS,
        "allowed_planning_time": PLANNERS,
        "max_velocity_scaling_factor": UNDERSTOOD,
        "max_acceleration_scaling_factor": UNDERSTOOD,
        "cartesian_speed_end_effector_link": OF_A_SPEED,
        "cartesian_speed_limited_link": OF_A_SPEED,
        "max_cartesian_speed": Refused("limits the speed of a link, which is not supported: only joints have limits"),
    },
    "Constraints": {
        "name": UNDERSTOOD,
        "joint_constraints": "JointConstraint",
        "position_constraints": "PositionConstraint",
        "orientation_constraints": "OrientationConstraint",
        "visibility_constraints": Refused("is not supported"),
    },
    "JointConstraint": {  # the position itself is met, and every constraint, whatever its weight
        "joint_name": UNDERSTOOD,
        "position": UNDERSTOOD,
        "tolerance_above": UNDERSTOOD,
        "tolerance_below": UNDERSTOOD,
        "weight": UNDERSTOOD,
    },
    "PositionConstraint": {
        "header": "Header",
        "link_name": UNDERSTOOD,
        "target_point_offset": "Vector3",
        "constraint_region": "BoundingVolume",
        "weight": UNDERSTOOD,
    },
    "BoundingVolume": {
        "primitives": "SolidPrimitive",
        "primitive_poses": "Pose",
        "meshes": REGIONS,
        "mesh_poses": REGIONS,
    },
    "OrientationConstraint": {
        "header": "Header",
        "orientation": "Quaternion",
        "link_name": UNDERSTOOD,
        "absolute_x_axis_tolerance": UNDERSTOOD,
        "absolute_y_axis_tolerance": UNDERSTOOD,
        "absolute_z_axis_tolerance": UNDERSTOOD,
        "parameterization": UNDERSTOOD,
        "weight": UNDERSTOOD,
    },
    "Header": {"seq": UNDERSTOOD, "stamp": UNDERSTOOD, "frame_id": UNDERSTOOD},
    "TransformStamped": {"header": "Header", "child_frame_id": UNDERSTOOD, "transform": "Transform"},
    "Transform": {"translation": "Vector3", "rotation": "Quaternion"},
    "Pose": {"position": "Point", "orientation": "Quaternion"},
    "Point": {"x": UNDERSTOOD, "y": UNDERSTOOD, "z": UNDERSTOOD},
    "Vector3": {"x": UNDERSTOOD, "y": UNDERSTOOD, "z": UNDERSTOOD},
    "Quaternion": {"x": UNDERSTOOD, "y": UNDERSTOOD, "z": UNDERSTOOD, "w": UNDERSTOOD},
}
"""Message -> field -> what is done with it. Lists of messages go by the message's name."""

SHOWN_FIELDS = 4  # fields that one note names


def check_message(top: Field, kind: str) -> None:
    """Go through a message of the kind named, and add a note for each field that is ignored.

    Raises:
        InputError: a field that the message does not have, or one that is filled in and refused.
    """
    noted: dict[str, list[str]] = {}
    _walk(top, kind, noted)
    for why, keys in noted.items():
        more = f" and {len(keys) - SHOWN_FIELDS} more" if len(keys) > SHOWN_FIELDS else ""
        Field(None, f"{', '.join(keys[:SHOWN_FIELDS])}{more}", top.document).note(why)


def _walk(entry: Field, kind: str, noted: dict[str, list[str]]) -> None:
    uses = MESSAGES[kind]
    for name, field in entry.mapping(uses).items():
        match uses[name]:
            case Refused(why):
                if is_filled(field.value):
                    raise field.error(why)
            case Zero(why):
                if not _is_zero(field.value):
                    raise field.error(why)
            case Noted(why):
                if not _is_zero(field.value):
                    noted.setdefault(why, []).append(field.key)
            case str(message) if message:
                parts = field.items() if isinstance(field.value, list) else [field]
                for part in parts:
                    if isinstance(part.value, Mapping):  # vectors may be lists; other forms the reader refuses
                        _walk(part, message, noted)


def is_filled(value: object) -> bool:
    """Tell whether a message has content: a text, a number other than 0, or a list with entries, at any depth."""
    if isinstance(value, Mapping):
        return any(is_filled(entry) for entry in value.values())
    return bool(value)


def _is_zero(value: object) -> bool:
    """Tell whether nothing in a value, at any depth, is a text or a number other than 0."""
    if isinstance(value, Mapping):
        return all(_is_zero(entry) for entry in value.values())
    if isinstance(value, list):
        return all(_is_zero(entry) for entry in value)
    return not value
