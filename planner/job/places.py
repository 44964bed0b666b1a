"""Placements of links, as matrices and as poses."""

from __future__ import annotations

import functools

import numpy as np

from hdplan.planner.geometry.rotations import quaternions_of
from hdplan.planner.robot.link_frame import frames_of, link_poses, links_of
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.poses import Pose


def link_pose(robot: Robot, q: Array, link: str) -> Array:
    """Return the pose (4, 4) of a link, or an object that is held, in the world at joint values q (n,), by Pinocchio.
    Raises InputError."""
    links = frames_of(robot)
    if link not in links:
        raise InputError(f"unknown link '{link}'{nearest(link, links)}")
    (pose,) = link_poses(robot, q[None], links[link])
    return np.asarray(pose)


def fixed_link(robot: Robot) -> tuple[str, Array]:
    """Return a link that stands fast in the world, and its pose (4, 4) there."""
    for link, index in links_of(robot).items():
        if robot.model.frames[index].parentJoint == 0:
            return link, np.asarray(robot.model.frames[index].placement.homogeneous)
    raise InputError(f"{robot.name} has no link that stands fast in the world, which `touch` needs")


def pose_of(matrix: Array) -> Pose:
    """Return a homogeneous matrix (4, 4) as a pose."""
    return poses_of(matrix[None])[0]


def poses_of(matrices: Array) -> tuple[Pose, ...]:
    """Return homogeneous matrices (k, 4, 4) as poses: the same objects for the same matrices, as one curve is followed
    from many beginnings."""
    return _poses(np.ascontiguousarray(matrices).tobytes())


@functools.lru_cache(maxsize=64)
def _poses(numbers: bytes) -> tuple[Pose, ...]:
    matrices = np.frombuffer(numbers).reshape(-1, 4, 4)
    turns = quaternions_of(matrices[:, :3, :3])
    return tuple(Pose(place, turn) for place, turn in zip(matrices[:, :3, 3].tolist(), turns.tolist(), strict=True))
