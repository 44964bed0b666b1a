"""Start and goal at other configurations, as pure functions: jogged by the joints, at a named state, at a random free
configuration, or in another posture that holds the hand in the same place.

A goal given by poses follows its joints: each pose is where the configuration has its link, with the same tolerances
and free axis. A state or a random configuration replaces it, as they are joint values.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from hdplan.planner.robot.link_frame import end_effector, link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.planner.search.inverse_kinematics import reaching
from hdplan.planner.view.drawing.motion import as_pose
from hdplan.planner.view.edited_scene import Edited
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.poses import Pose
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget

TRIED_CONFIGURATIONS = 2000  # random configurations
CHECKED_AT_ONCE = 50  # of them
SAME_CONFIGURATION = 1e-6  # [rad] or [m] between configurations that are one


def jogged(edited: Edited, end: str, q: Array) -> Edited:
    """The scene with its "start" or "goal" at a configuration (n,), a goal with its poses there. Raises InputError for
    values beyond the joint limits."""
    if end == "start":
        return edited.starting_at(q)
    goal, target = edited.scene.goal, edited.target
    if isinstance(goal, JointTarget):
        return edited.ending_at(q)
    if isinstance(target, JointTarget):
        return edited.ending_at(q, with_target(goal, target, JointTarget(target.field, tuple(q.tolist()))))
    poses = [_at(edited.robot, pose, q) for pose in target.poses]
    whole = poses[0] if isinstance(target, PoseTarget) else AllOf(poses, target.field)
    return edited.ending_at(q, with_target(goal, target, whole))


def fixed(edited: Edited, end: str, q: Array) -> Edited:
    """The scene with its "start" or "goal" at a configuration (n,) and nothing else. Raises InputError for values
    beyond the joint limits."""
    return edited.starting_at(q) if end == "start" else edited.ending_at(q)


def states(robot: Robot) -> dict[str, Array]:
    """Return the named states that say where all planned joints are, within their limits (n,)."""
    found = {}
    for name, values in robot.named_states.items():
        if all(joint in values for joint in robot.joint_names):
            q = np.array([values[joint] for joint in robot.joint_names])
            if ((q >= robot.lower) & (q <= robot.upper)).all():
                found[name] = q
    return found


def random_free(edited: Edited, end: str, rng: np.random.Generator) -> Array:
    """Return a random configuration (n,) in which a motion may start, or end. Raises InputError if none is found."""
    for _ in range(TRIED_CONFIGURATIONS // CHECKED_AT_ONCE):
        for q in edited.robot.draw(rng, CHECKED_AT_ONCE):
            if is_free(edited, end, q):
                return np.asarray(q)
    path = " and keeps the path constraints" if edited.scene.path != PathConstraints() else ""
    raise InputError(f"{end}: none of {TRIED_CONFIGURATIONS} random configurations is free{path}")


def postures(edited: Edited, end: str) -> tuple[Array, ...]:
    """Return the free configurations (n,) that hold the hand where it is at an end, or that reach the goal pose, the
    present one first and others from near to far. Raises InputError where the hand is not one link."""
    q = edited.start if end == "start" else edited.goal
    target = edited.target if end == "goal" else None
    if target is None or isinstance(target, JointTarget):
        robot = edited.robot
        target = _at(robot, PoseTarget(end_effector(robot, end), Pose(), field=end), q)
    found, _ = reaching(edited.robot, target, q, np.random.default_rng(0))
    others = [each for each in found if np.abs(each - q).max() > SAME_CONFIGURATION and is_free(edited, end, each)]
    return (q, *others)


def is_free(edited: Edited, end: str, q: Array) -> bool:
    """True if a motion may start, or end, in a configuration (n,): without contact or undercutting the clearance
    required, and on the path constraints."""
    when = edited.scene.end_time if end == "goal" else 0.0
    certifier = edited.certifier
    return not (certifier.too_close(q, edited.scene.planner.clearance, when) or certifier.off_path(q))


def with_target(goal: Goals, old: object, new: Any) -> Goals:
    """Return a goal with one of its alternatives exchanged."""
    return replace(goal, targets=tuple(new if target is old else target for target in goal.targets))  # type: ignore[misc]


def _at(robot: Robot, target: PoseTarget, q: Array) -> PoseTarget:
    """Return a pose of a link where a configuration (n,) has it."""
    frame, data = link_frame(robot, target.link, target.field), robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
    pose = as_pose(data.oMf[frame])
    return replace(target, pose=Pose(pose.position) if target.free_rotation == "all" else pose)
