"""Elements of a URDF, written: numbers, origins, the two ends of a joint. Lengths [m], angles [rad]."""

from __future__ import annotations

import math
from collections.abc import Iterable
from xml.etree.ElementTree import Element, SubElement

from hdplan.scenes.poses import Pose


def words(values: Iterable[float]) -> str:
    """Return numbers as text that reads back bit for bit."""
    return " ".join(repr(float(value)) for value in values)


def origin(pose: Pose) -> Element:
    """Return a pose as URDF has it; yaw is what is left of the turn once roll is taken out, so that it is accurate
    where pitch is a right angle too."""
    r = pose.matrix[:3, :3]
    roll = math.atan2(r[2, 1], r[2, 2])
    pitch = math.atan2(-r[2, 0], math.hypot(r[0, 0], r[1, 0]))
    s, c = math.sin(roll), math.cos(roll)
    yaw = math.atan2(s * r[0, 2] - c * r[0, 1], c * r[1, 1] - s * r[1, 2])
    return Element("origin", xyz=words(pose.position), rpy=words([roll, pitch, yaw]))


def add_joint(robot: Element, name: str, kind: str, ends: tuple[str, str], place: Pose) -> Element:
    """Add a joint between a parent and a child link to a robot, and return it."""
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=ends[0])
    SubElement(joint, "child", link=ends[1])
    joint.append(origin(place))
    return joint
