"""The motion of a job as ROS messages, stage by stage, each at the time at which it begins.

The arm's stages are `trajectory_msgs/JointTrajectory`, with times from their own beginning; what the fingers do is an
event, a `control_msgs/GripperCommand` with the position at which a finger's joint ends. Every stage is announced by its
name, a `std_msgs/String`. Whose a joint is follows from the motion: those that move together in some stage are one
group; the largest is the arm's, with the joints that never move, and all others are fingers'.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from hdplan.planner.motion.ros_message import NANOSECONDS, UNITS, joint_trajectory
from hdplan.scenes.errors import InputError

if TYPE_CHECKING:
    from hdplan.planner.motion.trajectory import Trajectory

ARM, GRIPPER, STAGE = "/joint_trajectory", "/gripper_command", "/stage"


def stage_messages(trajectory: Trajectory) -> Iterator[tuple[int, str, dict[str, Any]]]:
    """Yield when each message of a job is sent [ns], from its beginning on, its topic, and the message. Raises
    InputError for times that ROS cannot hold."""
    assert trajectory.times is not None
    names, parts = trajectory.joint_names, _parts(trajectory)
    arm = _arm([moving for _, _, moving in parts], names)
    for begin, stage, moving in parts:
        now = round((begin - float(trajectory.times[0])) * NANOSECONDS)
        yield now, STAGE, {"data": next(mark.name for mark in stage.stages)}
        if moving & arm:
            message = joint_trajectory(stage.of_joints(tuple(x for x in names if x in arm), {}))
            stamp = dict(zip(UNITS[0], divmod(now, NANOSECONDS), strict=True))
            yield now, ARM, {**message, "header": {**message["header"], "stamp": stamp}}
        fingers = [x for x in names if x in moving - arm]
        for finger in fingers:
            at = float(stage.positions[-1, names.index(finger)])
            topic = GRIPPER if len(fingers) == 1 else f"{GRIPPER}/{finger}"
            yield now, topic, {"position": at, "max_effort": 0.0}


def _parts(trajectory: Trajectory) -> list[tuple[float, Trajectory, set[str]]]:
    """Return when each stage begins [s], its motion from 0 s on, and the joints that move in it."""
    from hdplan.planner.motion.trajectory import StageMark

    assert trajectory.times is not None
    found, rows = [], [*(mark.row for mark in trajectory.stages), len(trajectory) - 1]
    for mark, first, last in zip(trajectory.stages, rows[:-1], rows[1:], strict=True):
        part = trajectory.between(first, last)
        assert part.times is not None
        changes = (part.positions != part.positions[0]).any(axis=0)
        for each in (part.velocities, part.accelerations):
            changes = changes if each is None else changes | each.any(axis=0)
        moving = {x for x, y in zip(part.joint_names, changes, strict=True) if y}
        begins, own = float(part.times[0]), (StageMark(mark.name, 0),)
        found.append((begins, replace(part, locked={}, times=part.times - part.times[0], stages=own), moving))
    return found


def _arm(moving: list[set[str]], names: tuple[str, ...]) -> set[str]:
    """Return the joints of the arm, by those that move in each stage."""
    groups: list[set[str]] = []
    for some in moving:
        met = [group for group in groups if group & some]
        groups = [group for group in groups if not group & some] + [some.union(*met)]
    groups.sort(key=lambda group: min(map(names.index, group), default=0))
    largest = max(groups, key=len, default=set())  # of equals that with the first column
    return set(names) - set().union(*(group for group in groups if group is not largest))


def refuse_stages(trajectory: Trajectory) -> None:
    """Raise InputError for the motion of a job, which no single message can hold."""
    if trajectory.stages:
        count = len(trajectory.stages)
        raise InputError(f"one message holds one motion, and this job has {count} stages: write .mcap, .json or .csv")
