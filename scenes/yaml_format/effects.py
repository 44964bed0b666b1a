"""The sections that enable effects: motions of obstacles, sizes of what is unknown, self_collision, limits,
payload, path, timing.

An empty section is refused. Names of joints and links are checked when the robot is loaded; `Scene` and its parts check
values, and what one section needs of another.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TypeVar

from hdplan.scenes.fields import Field
from hdplan.scenes.limits import QUANTITIES, Limits
from hdplan.scenes.obstacles import SelfCollision, SteadyMotion, TimedPoses
from hdplan.scenes.path_constraints import Follow, PathConstraints, Relative, Upright, Within
from hdplan.scenes.pose_fields import pose_of, read_pose, read_poses
from hdplan.scenes.sizes import Calibration, Tracking, Uncertainty
from hdplan.scenes.timing import Timing

T = TypeVar("T", Uncertainty, Tracking, Calibration)


def read_motion(section: Field) -> SteadyMotion | TimedPoses:
    """Read how an obstacle moves: ``{velocity, spin}``, or ``{times, poses}``."""
    keys = _filled(section, ("velocity", "spin", "times", "poses"))
    if "times" not in keys and "poses" not in keys:
        return section.make(SteadyMotion, **keys)
    if len(keys) != 2 or "times" not in keys or "poses" not in keys:
        raise section.error(f"must have either velocity and spin, or times and poses, found {', '.join(keys)}")
    poses = read_poses(keys["poses"])
    return section.make(TimedPoses, times=keys["times"], poses=poses)


def sizes_of(kind: type[T], section: Field) -> T:
    """Read sizes of what is unknown, some of them."""
    _filled(section, tuple(each.name for each in fields(kind)))
    return section.read(kind)


def read_uncertainty(section: Field) -> Uncertainty:
    """Read the greatest deviation of an obstacle from its nominal pose: ``{position, orientation, speed}``."""
    return sizes_of(Uncertainty, section)


def read_self_collision(section: Field) -> SelfCollision:
    """Read ``true``, ``false`` or ``{clearance}``."""
    if isinstance(section.value, bool):
        return SelfCollision(checked=section.value)
    if not isinstance(section.value, dict):
        raise section.wrong("true, false or a mapping with the key clearance")
    return section.make(SelfCollision, **_filled(section, ("clearance",)))


def read_limits(section: Field) -> Limits:
    """Read limits of joints: position ranges by joint name, and ``velocity``, ``acceleration``, ``jerk`` and
    ``torque``, each in one of the forms of `JointValues`."""
    keys = _filled(section, ("position", *QUANTITIES))
    if "position" in keys:
        _filled(keys["position"])
    return section.make(Limits, **keys)


def read_path(section: Field) -> PathConstraints:
    """Read path constraints: ``upright``, ``position``, ``relative`` and ``follow``."""
    _filled(section, tuple(each.name for each in fields(PathConstraints)))
    return section.read(
        PathConstraints,
        upright=lambda each: each.read(Upright),
        position=_within,
        relative=lambda each: each.read(Relative, pose=read_pose),
        follow=lambda each: each.read(Follow, poses=read_poses),
    )


def _within(section: Field) -> Within:
    keys = section.mapping(("link", "size", "position", "rpy", "quaternion_xyzw", "point"), required=["link", "size"])
    values = {name: keys[name] for name in ("link", "size", "point") if name in keys}
    return section.make(Within, **values, pose=pose_of(section, keys))


def read_timing(section: Field) -> Timing:
    """Read the timing: ``duration`` or ``scale``, and the sampling ``rate`` of the result."""
    keys = _filled(section, ("duration", "scale", "rate"))
    if "duration" in keys and "scale" in keys:
        raise section.error("has both 'duration' and 'scale', which contradict each other: give one of them")
    return section.make(Timing, **keys)


def _filled(section: Field, allowed: tuple[str, ...] | None = None) -> dict[str, Field]:
    """Return the fields of a mapping that is not empty."""
    keys = section.mapping(allowed)
    if not keys:
        expected = f"some of {', '.join(allowed)}" if allowed else "joints with their ranges"
        raise section.error(f"is empty: leave it out, or give {expected}")
    return keys
