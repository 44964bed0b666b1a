"""Trajectories as a ROS 2 bag: an MCAP file with one `trajectory_msgs/JointTrajectory`, or MoveIt's `RobotTrajectory`;
of a job with the messages of its stages (`ros_stages`), which are not read.

Written and read by the libraries mcap and mcap-ros2-support (the extra `ros`), which are imported only when used.
"""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from hdplan.planner.motion.ros_message import joint_trajectory, read_message
from hdplan.planner.motion.ros_stages import ARM, GRIPPER, STAGE, stage_messages
from hdplan.scenes.errors import InputError
from hdplan.scenes.files import MOST_BYTES

if TYPE_CHECKING:
    from hdplan.planner.motion.trajectory import Trajectory

TYPE = "trajectory_msgs/msg/JointTrajectory"
READ = (TYPE, "moveit_msgs/msg/RobotTrajectory")
PARTS = {  # of the message definition; the first is the message itself
    "trajectory_msgs/JointTrajectory": "std_msgs/Header header\nstring[] joint_names\n"
    "trajectory_msgs/JointTrajectoryPoint[] points",
    "trajectory_msgs/JointTrajectoryPoint": "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\n"
    "float64[] effort\nbuiltin_interfaces/Duration time_from_start",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
}
EVENTS = {  # types of a job's other messages, by topic
    GRIPPER: ("control_msgs/msg/GripperCommand", "float64 position\nfloat64 max_effort"),
    STAGE: ("std_msgs/msg/String", "string data"),
}
DEFINITION = f"\n{'=' * 80}\nMSG: ".join(f"{name}\n{text}" for name, text in PARTS.items()).partition("\n")[2]


def check_installed() -> None:
    """Raise InputError, saying what to install, if the libraries are missing."""
    if any(importlib.util.find_spec(name) is None for name in ("mcap", "mcap_ros2")):
        raise InputError("ROS 2 bags need mcap, which is not installed: pip install mcap mcap-ros2-support")


def write_bag(trajectory: Trajectory, _: Mapping[str, Mapping[str, Any]]) -> bytes:
    """Return a bag with the trajectory at time 0, or with the messages of a job's stages, each at its time. Raises
    InputError for a trajectory that it cannot hold."""
    check_installed()
    from mcap_ros2.writer import Writer

    file = io.BytesIO()
    with Writer(file) as bag:
        schemas = {ARM: bag.register_msgdef(TYPE, DEFINITION)}
        if not trajectory.stages:
            messages: Iterable[tuple[int, str, dict[str, Any]]] = [(0, ARM, joint_trajectory(trajectory))]
        else:
            schemas |= {topic: bag.register_msgdef(*kind) for topic, kind in EVENTS.items()}
            messages = stage_messages(trajectory)
        for now, topic, message in messages:
            schema = next(schemas[x] for x in schemas if topic == x or topic.startswith(f"{x}/"))
            bag.write_message(topic, schema, message, log_time=now, publish_time=now)
    return file.getvalue()


def read_bag(data: bytes) -> dict[str, Any]:
    """Return the fields of the only trajectory in a bag. Raises InputError saying what is wrong."""
    check_installed()
    try:
        messages, types = _messages(data)
    except InputError:
        raise
    except Exception as error:  # the format, its compressions, its messages: each raises exceptions of its own
        raise InputError(f"not a whole ROS 2 bag ({' '.join(str(error).split()) or type(error).__name__})") from error
    if EVENTS[STAGE][0] in types:
        raise InputError("holds the stages of a job, one message each: read the JSON or CSV file of its motion")
    if len(messages) != 1:
        found = f"{len(messages)}" if messages else f"messages of {', '.join(sorted(types)) or 'no type'}"
        raise InputError(f"one message of {' or '.join(READ)} is expected, found {found}")
    return read_message(messages[0])


def _messages(data: bytes) -> tuple[list[dict[str, Any]], set[str]]:
    """Return the trajectories of a bag as plain values, and the types of all messages in it."""
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import StreamReader, breakup_chunk
    from mcap_ros2.decoder import DecoderFactory

    decoders, schemas, channels = DecoderFactory(), dict[int, Schema](), dict[int, Channel]()
    messages, types, size = [], set[str](), 0
    for outer in StreamReader(io.BytesIO(data), emit_chunks=True, validate_crcs=True).records:
        if isinstance(outer, Chunk):
            size += outer.uncompressed_size
            if size > MOST_BYTES:
                raise InputError(f"is more than {MOST_BYTES / 1e6:.0f} MB when unpacked")
        for record in breakup_chunk(outer, validate_crc=True) if isinstance(outer, Chunk) else [outer]:
            match record:
                case Schema():
                    schemas[record.id] = record
                case Channel():
                    channels[record.id] = record
                case Message():
                    channel = channels[record.channel_id]
                    schema = schemas[channel.schema_id]
                    types.add(schema.name)
                    if schema.name not in READ:
                        continue
                    decode = decoders.decoder_for(channel.message_encoding, schema)
                    if decode is None:
                        raise InputError(f"{channel.topic}: is not encoded as ROS 2 messages are (cdr, ros2msg)")
                    messages.append(_plain(decode(record.data)))
    return messages, types


def _plain(value: Any) -> Any:
    """Return a decoded message as mappings and lists."""
    if hasattr(value, "__slots__"):
        return {name: _plain(getattr(value, name)) for name in value.__slots__}
    return [_plain(item) for item in value] if isinstance(value, list) else value
