"""Parts that MoveIt's messages share: poses, transforms and primitives.

The keys are those of geometry_msgs/Pose and Transform and shape_msgs/SolidPrimitive; vectors and quaternions are lists,
as in MotionBenchMaker's files, or mappings with the keys x, y, z and w, as ROS prints them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from hdplan.scenes.fields import Field
from hdplan.scenes.moveit.fields import MESSAGES
from hdplan.scenes.pose_fields import read_quaternion, read_vector
from hdplan.scenes.poses import Pose, Quaternion, Vector3
from hdplan.scenes.shapes import Box, Cylinder, Shape, Sphere

PRIMITIVES = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone", 5: "prism"}  # numbers of shape_msgs/SolidPrimitive


def read_message_pose(entry: Field | None) -> Pose:
    """Read ``{position, orientation}``; what is missing is zero."""
    keys = entry.mapping(MESSAGES["Pose"]) if entry else {}
    return _pose(keys.get("position"), keys.get("orientation"))


def read_transform(entry: Field | None) -> Pose:
    """Read ``{translation, rotation}``; what is missing is zero."""
    keys = entry.mapping(MESSAGES["Transform"]) if entry else {}
    return _pose(keys.get("translation"), keys.get("rotation"))


def _pose(position: Field | None, orientation: Field | None) -> Pose:
    return Pose(
        read_point(position) if position else (0.0, 0.0, 0.0),
        read_orientation(orientation) if orientation else (0.0, 0.0, 0.0, 1.0),
    )


def read_point(entry: Field) -> Vector3:
    """Read a point or vector [m]; of a mapping, what is missing is zero, as in ROS."""
    return read_vector(_as_list(entry, ("x", "y", "z")), unit="m")


def read_orientation(entry: Field) -> Quaternion:
    """Read a unit quaternion; of a mapping, x, y and z that are missing are zero, as in ROS. A missing w is 0 in ROS 1
    and 1 in ROS 2, and so refused."""
    return read_quaternion(_as_list(entry, ("x", "y", "z", "w"), required=("w",)))


def _as_list(entry: Field, names: tuple[str, ...], required: tuple[str, ...] = ()) -> Field:
    """Return a vector as a list if it is written as a mapping."""
    if not isinstance(entry.value, Mapping):
        return entry
    keys = entry.mapping(names, required=required)
    return replace(entry, value=[keys[name].value if name in keys else 0.0 for name in names])


def read_primitive(entry: Field) -> Shape:
    """Read a box, a sphere or a cylinder; cones and prisms are refused."""
    keys = entry.mapping(MESSAGES["SolidPrimitive"], required=["type", "dimensions"])
    kind, sizes = keys["type"], keys["dimensions"]
    number = isinstance(kind.value, int) and not isinstance(kind.value, bool)
    word = PRIMITIVES.get(kind.value) if number else kind.value  # type: ignore[call-overload]
    match word:
        case "box":
            x, y, z = sizes.numbers(3, above=0.0, unit="m")
            return Box((x, y, z))
        case "sphere":
            (radius,) = sizes.numbers(1, above=0.0, unit="m")
            return Sphere(radius)
        case "cylinder":
            height, radius = sizes.numbers(2, above=0.0, unit="m")
            return Cylinder(radius, height)
        case "cone" | "prism":
            raise kind.error(f"the primitive '{word}' is not supported yet (box, cylinder and sphere are)")
        case _:
            raise kind.wrong("box, cylinder or sphere")
