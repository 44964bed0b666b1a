"""Parts that MoveIt's messages share: poses, primitives, frames.

The keys are those of geometry_msgs/Pose, shape_msgs/SolidPrimitive and std_msgs/Header; vectors and quaternions are
lists, as in MotionBenchMaker's files.
"""

from __future__ import annotations

from collections.abc import Mapping

from hdplan.scenes.fields import Field
from hdplan.scenes.model import Box, Cylinder, Pose, Shape, Sphere
from hdplan.scenes.poses import read_quaternion, read_vector

PRIMITIVES = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone", 5: "prism"}  # numbers of shape_msgs/SolidPrimitive
WORLD_FRAMES = ("", "world", "/world")


def read_message_pose(entry: Field) -> Pose:
    """Read ``{position, orientation}``; what is not said is zero."""
    keys = entry.mapping(("position", "orientation"))
    return Pose(
        read_vector(keys["position"], unit="m") if "position" in keys else (0.0, 0.0, 0.0),
        read_quaternion(keys["orientation"]) if "orientation" in keys else (0.0, 0.0, 0.0, 1.0),
    )


def read_primitive(entry: Field) -> Shape:
    """Read a box, a sphere or a cylinder; cones and prisms are refused."""
    keys = entry.mapping(("type", "dimensions", "polygon"), required=["type", "dimensions"])
    kind, sizes = keys["type"], keys["dimensions"]
    word = PRIMITIVES.get(kind.value) if isinstance(kind.value, int) else kind.value
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


def refuse_other_frame(entry: Field, header: Field | None, link: str = "", what: str = "objects") -> None:
    """Refuse a header that names another frame than the world's, or than that of `link`."""
    frame = header.mapping(("frame_id", "stamp", "seq")).get("frame_id") if header else None
    if link and (frame is None or frame.value != link):
        found = frame.value if frame else ""
        raise (frame or entry).error(f"must be given in the frame of its link '{link}' (frame_id), found {found!r}")
    if not link and frame and frame.value not in WORLD_FRAMES:
        raise frame.error(f"{what} must be given in the world frame ('' or 'world'), found {frame.value!r}")


def is_filled(value: object) -> bool:
    """Tell whether a message holds anything: a list with entries, at any depth. Names and zeros alone say nothing."""
    if isinstance(value, Mapping):
        return any(is_filled(entry) for entry in value.values())
    return isinstance(value, list) and len(value) > 0
