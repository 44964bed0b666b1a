"""Configurations along the poses of a link: inverse kinematics from each place to the next."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from hdplan.planner.geometry.rotations import matrices_of, quaternions_of, vectors_of
from hdplan.planner.kinematics.inverse import Aim, damped_step
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.path_constraints import Follow
from hdplan.scenes.poses import Pose
from hdplan.scenes.targets import PoseTarget

STEPS = 60  # of damped least squares at a place, at most
POSE_ERROR = 1e-7  # [m] and [rad]
FARTHEST = 0.5  # [rad] or [m] that a joint may move between two places: beyond it the curve runs through a singularity
ARM = 0.3  # [m] by which turns count as lengths, where places are spread over a curve
CORNER = 0.2  # [rad] between two directions: there the link stops


class NotFollowedError(Exception):
    """A curve that the arm cannot follow from where it begins, and where it ends to do so."""


def smooth_parts(follow: Follow) -> list[Follow]:
    """Return a curve cut where its direction changes abruptly: what a link can follow without a stop."""
    poses = np.array([pose.matrix for pose in follow.poses])
    steps = np.concatenate([np.diff(poses[:, :3, 3], axis=0), ARM * turns_between(poses, follow.free_rotation)], axis=1)
    lengths = np.linalg.norm(steps, axis=1)
    moving = np.flatnonzero(lengths > 0.0)
    ways = steps[moving] / lengths[moving, None]
    sharp = (ways[1:] * ways[:-1]).sum(axis=1) < np.cos(CORNER)
    cuts = [0, *moving[1:][sharp].tolist(), len(poses) - 1]
    return [_cut(follow, begin, end) for begin, end in itertools.pairwise(cuts)]


def _cut(follow: Follow, begin: int, end: int) -> Follow:
    return Follow(follow.link, follow.poses[begin : end + 1], free_rotation=follow.free_rotation)


def along_poses(
    robot: Robot, start: Array, follow: Follow, count: int, guide: Callable[[float], Array] | None = None
) -> Array:
    """Return configurations (count, n) that bring a link from where it is at `start` (n,) along a curve, evenly: near a
    `guide`, which gives joint values (n,) at shares of the way, or else as steadily as they go. Raises
    NotFollowedError."""
    rows = [start]
    for share, pose in zip(np.linspace(0.0, 1.0, count)[1:].tolist(), spread(follow, count)[1:], strict=True):
        aim = Aim.at(robot, PoseTarget(follow.link, pose, free_rotation=follow.free_rotation))
        steady = 2.0 * rows[-1] - rows[-2] if len(rows) > 1 else start
        q = np.clip(steady if guide is None else guide(share), robot.lower, robot.upper)
        reached = brought(robot, aim, q)
        if isinstance(reached, str):
            raise NotFollowedError(f"{follow.link} cannot be brought along beyond {share:.0%} of the way: {reached}")
        if np.abs(reached - rows[-1]).max() > FARTHEST:
            raise NotFollowedError(f"the arm would have to turn over at {share:.0%} of the way, near a singularity")
        rows.append(reached)
    return np.array(rows)


def brought(robot: Robot, aim: Aim, q: Array) -> Array | str:
    """Return joint values (n,) that reach an aim, from some close to it; or say what keeps the robot from it."""
    rows = q[None]
    for _ in range(STEPS):
        error, jacobian = aim.linearized(rows)
        if (aim.sizes(error) <= POSE_ERROR).all():
            return np.asarray(rows[0])
        rows = damped_step(robot, rows, error, jacobian)
    at_limit = np.flatnonzero((rows[0] <= robot.lower + 1e-9) | (rows[0] >= robot.upper - 1e-9))
    return f"'{robot.joint_names[int(at_limit[0])]}' is at its limit" if len(at_limit) else "no joints reach farther"


def drawn_through(rows: Array) -> Array:
    """Return waypoints (N, n) whose smooth path (`timing.retiming`), which passes its control points by, leads through
    rows (N, n) evenly along a curve but for terms of fourth order: at a knot a cubic B-spline is (c₋ + 4 c + c₊)/6."""
    found = rows.copy()
    found[1:-1] -= (rows[:-2] - 2.0 * rows[1:-1] + rows[2:]) / 6.0
    return found


def length_of(follow: Follow) -> float:
    """Return the length of a curve [m], turns counted as lengths."""
    return float(lengths_of(np.array([pose.matrix for pose in follow.poses]), follow.free_rotation)[0].sum())


def spread(follow: Follow, count: int) -> list[Pose]:
    """Return poses that are spread evenly over a curve."""
    poses = np.array([pose.matrix for pose in follow.poses])
    steps, turns = lengths_of(poses, follow.free_rotation)
    along = np.interp(
        np.linspace(0.0, steps.sum(), count), np.concatenate([[0.0], np.cumsum(steps)]), np.arange(len(poses))
    )
    segment = np.minimum(along.astype(np.int64), len(poses) - 2)
    share = (along - segment)[:, None]
    turned = quaternions_of(matrices_of(share * turns[segment]) @ poses[segment, :3, :3])
    places = (1.0 - share) * poses[segment, :3, 3] + share * poses[segment + 1, :3, 3]
    return [Pose(place, turn) for place, turn in zip(places.tolist(), turned.tolist(), strict=True)]


def lengths_of(poses: Array, free: str) -> tuple[Array, Array]:
    """Return how far it is from each of some poses (N, 4, 4) to the next (N − 1,), and the turns (N − 1, 3)."""
    turns = turns_between(poses, free)
    return np.hypot(
        np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1), ARM * np.linalg.norm(turns, axis=1)
    ), turns


def turns_between(poses: Array, free: str) -> Array:
    """Return the rotation vectors (N − 1, 3) from each of some poses (N, 4, 4) to the next; of a free axis, the
    shortest ones that take it along."""
    if free == "none":
        between = poses[1:, :3, :3] @ poses[:-1, :3, :3].transpose(0, 2, 1)
        return vectors_of(between)
    axes = poses[:, :3, "xyz".index(free)]
    about = np.cross(axes[:-1], axes[1:])
    sine = np.linalg.norm(about, axis=1)
    angle = np.arctan2(sine, (axes[:-1] * axes[1:]).sum(axis=1))
    return np.asarray(about * (angle / np.maximum(sine, 1e-300))[:, None])
