"""The octomap of a planning scene: octomap_msgs/Octomap, as the file that it would be."""

from __future__ import annotations

import base64

from hdplan.scenes.fields import Field
from hdplan.scenes.moveit.fields import MESSAGES
from hdplan.scenes.moveit.frames import Frames
from hdplan.scenes.moveit.messages import read_message_pose
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import compose
from hdplan.scenes.voxel_grids import OctoMap

NAME = "<octomap>"  # by which MoveIt calls it, as in the allowed collision matrix
HEADS = {True: b"# Octomap OcTree binary file", False: b"# Octomap OcTree file"}


def read_octomap(section: Field, frames: Frames) -> Obstacle | None:
    """Return the map as an obstacle, what it does not know being free; None if it holds nothing. Raises InputError for
    another kind of tree, and for data that are no bytes."""
    placed = section.mapping(MESSAGES["OctomapWithPose"])
    message = placed["octomap"].mapping(MESSAGES["Octomap"]) if "octomap" in placed else {}
    data = _bytes(message["data"]) if "data" in message else b""
    if not data:
        return None
    if "id" not in message or message["id"].value != "OcTree":
        raise message.get("id", section).error("must be OcTree, the kind of octomap that is read")
    if "resolution" not in message:
        raise section.error("the key 'octomap.resolution' is missing")
    resolution = message["resolution"].number(above=0.0, unit="m")
    binary = message["binary"].boolean() if "binary" in message else False
    content = HEADS[binary] + f"\nid OcTree\nsize 0\nres {resolution!r}\ndata\n".encode() + data
    frame = frames.of_header(placed.get("header"))
    own = message["header"].mapping(MESSAGES["Header"]).get("frame_id") if "header" in message else None
    if own is not None and own.value and frames.of_header(message["header"]) != frame:
        raise own.error("is another frame than that of world.octomap.header, in which MoveIt places the map")
    return Obstacle(NAME, OctoMap(content), compose(frame, read_message_pose(placed.get("origin"))))


def _bytes(field: Field) -> bytes:
    """Return bytes that are given as numbers (signed or not), as YAML's binary, or as a text in base64."""
    value = field.value
    if isinstance(value, bytes):
        return value
    if isinstance(value, list) and all(type(each) is int and -128 <= each <= 255 for each in value):
        return bytes(each & 255 for each in value)
    if isinstance(value, str):
        try:
            return base64.b64decode(value, validate=True)
        except ValueError:
            pass
    raise field.wrong("a list of bytes, -128 to 255, or a text in base64")
