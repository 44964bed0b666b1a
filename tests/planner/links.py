"""Places of links by Pinocchio alone: a witness that shares nothing with the planner's kinematics."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from hdplan import Pose, Robot, Trajectory
from hdplan.scenes.array_types import Array


def places_of(robot: Robot, link: str, rows: Iterable[ArrayLike]) -> list[pin.SE3]:
    data, frame, found = robot.model.createData(), robot.model.getFrameId(link, pin.FrameType.BODY), []
    for q in rows:
        pin.framesForwardKinematics(robot.model, data, robot.pin_q(np.asarray(q)))
        found.append(data.oMf[frame].copy())
    return found


def place_of(robot: Robot, link: str, q: ArrayLike) -> pin.SE3:
    return places_of(robot, link, [q])[0]


def pose_at(place: pin.SE3) -> Pose:
    return Pose(place.translation, pin.Quaternion(place.rotation).normalized().coeffs())


def pose_of(robot: Robot, link: str, q: ArrayLike) -> Pose:
    return pose_at(place_of(robot, link, q))


def places_at(robot: Robot, link: str, motion: Trajectory, times: Array) -> tuple[Array, Rotation]:
    """Positions (k, 3) and rotations of a link at times (k,) of a motion, which may move other joints, too."""
    columns = [motion.joint_names.index(joint) for joint in robot.joint_names]
    rows = motion.at_time(times).positions[:, columns]
    poses = np.array([place.homogeneous for place in places_of(robot, link, rows)])
    return poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3])


def along(robot: Robot, link: str, motion: Trajectory, step: float = 1e-3) -> tuple[Array, Array, Rotation]:
    """Times, positions and rotations of a link over a whole motion."""
    assert motion.times is not None
    times = np.append(np.arange(motion.times[0], motion.times[-1], step), motion.times[-1])
    return times, *places_at(robot, link, motion, times)
