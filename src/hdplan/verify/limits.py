"""Limits of the joints: their ranges, and what else a scene limits."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import scene as scenes
from .balls import need
from .joints import LIMIT_ROOM, Joints
from .other_robot import OtherRobot
from .targets import Targets
from .text import mapping, values

RATES = ("velocity", "acceleration", "jerk", "torque")


def limits(top: dict[str, Any], joints: Joints, targets: Targets) -> dict[str, Any]:
    """Ranges of all joints that move, and what else the scene limits, one entry for each of them."""
    section = mapping(top.get("limits", {}), "limits", f"position {' '.join(RATES)}")
    ranges = section.pop("position", {})
    need(isinstance(ranges, dict) and {*ranges} <= {*joints.lead}, "limits.position: of a joint that does not lead")
    spans, ends = [], targets.beyond(top)
    for name in joints.moving:
        joint = joints.tree.joints[name]
        low, high = joint.low, joint.high
        if name in ranges:
            least, most = values(ranges[name], 2, f"limits.position.{name}").tolist()
            low, high = max(low, least), min(high, most)
        for x in ends.get(name, []):
            low, high = (x if 0 < low - x <= LIMIT_ROOM else low), (x if 0 < x - high <= LIMIT_ROOM else high)
        spans.append([None if abs(x) == np.inf else float(x) for x in (low, high)])
    timed = bool(section) or "timing" in top
    found: dict[str, Any] = {"position": spans}
    for name in RATES:
        if (value := section.get(name, "urdf" if name == "velocity" and timed else None)) is not None:
            found[name] = [_limit(name, value, x, joints, targets.from_request) for x in joints.moving]
    return found


def limits_of_other(top: dict[str, Any], robot: OtherRobot) -> dict[str, Any]:
    """The limits that a proof claims for a robot whose description is not read, by what the scene says in numbers."""
    section, claimed = mapping(top.get("limits", {}), "limits", f"position {' '.join(RATES)}"), robot.claimed["limits"]
    ranges, timed = section.pop("position", {}), bool(section) or "timing" in top
    given = {x: section.get(x, "urdf" if x == "velocity" and timed else None) for x in RATES}
    found = {x: claimed[x] for x in ("position", *RATES) if x == "position" or given[x] is not None}
    for i, name in enumerate(robot.moving):
        if name in ranges:
            least, most = values(ranges[name], 2, f"limits.position.{name}").tolist()
            low, high = claimed["position"][i]
            within = None not in (low, high) and least - LIMIT_ROOM <= low and high <= most + LIMIT_ROOM
            need(within, f"limits.position.{name}: the proof has another range")
        for rate in RATES:
            most = _in_numbers(given[rate], name, robot)
            if most is not None:
                found[rate] = [*found[rate][:i], most, *found[rate][i + 1 :]]
    return found


def _in_numbers(value: Any, joint: str, robot: OtherRobot) -> float | None:
    """A limit of one joint, where the scene has its number."""
    if isinstance(value, list) and joint in robot.lead:
        return float(values(value, len(robot.lead), "limits")[robot.lead.index(joint)])
    value = value.get(joint) if isinstance(value, dict) else value
    return scenes.one(value, "limits") if type(value) in (int, float) else None


def _limit(name: str, value: Any, joint: str, joints: Joints, from_request: bool) -> float | None:
    """The limit of a rate or torque of one joint; what follows is within one number for all, or the URDF's."""
    where, each = f"limits.{name}", joints.tree.joints[joint]
    own = {"velocity": each.velocity, "torque": each.effort}.get(name)
    if type(value) in (int, float):
        return scenes.one(value, where)
    if joint in joints.rules:
        return own if name == "velocity" and own else None
    if isinstance(value, list):
        return float(values(value, len(joints.lead), where)[joints.lead.index(joint)])
    if isinstance(value, dict):
        need({*value} <= {*joints.lead} or from_request, f"{where}: of a joint that does not lead")
        if joint in value:
            return scenes.one(value[joint], where)
    need(isinstance(value, dict) or value == "urdf", f"{where}: '{value}'")
    need(own and own > 0, f"{where}: nothing limits '{joint}'")
    return own
