"""Configurations along the poses of a link: inverse kinematics from each place to the next."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hdplan.planner.geometry.rotations import matrices_of, vectors_of
from hdplan.planner.job.places import poses_of
from hdplan.planner.kinematics.inverse import DAMPING, LONGEST_STEP, Aim, LinkPose, damped_step
from hdplan.planner.robot.robot import Robot
from hdplan.planner.timing.path_spline import smooth
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.path_constraints import Follow
from hdplan.scenes.targets import PoseTarget

SOLVER_STEPS = 60  # of damped least squares at a place, at most
POSE_ERROR = 1e-7  # [m] and [rad]
# [rad] or [m] that a joint may move between two places, or be away from a guide; beyond it, the curve runs through a
# singularity.
LARGEST_STEP = 0.5
TURN_RADIUS = 0.3  # [m] by which turns count as lengths, where places are spread over a curve
UNDAMPED, LEAST_DAMPING = 0.05, 1e-6  # error below which steps are damped less, and what is left of it at last
TURNED_OVER = "the arm would have to turn over at {:.0%} of the way, near a singularity"
CORNER_ANGLE = 0.2  # [rad] between two directions: there the link stops


class NotFollowedError(Exception):
    """A curve that the arm cannot follow from where it begins, and where it ends to do so."""


@dataclass(frozen=True, eq=False)
class Places:
    """Poses along a curve, one for each row of some joint values, within bounds of these."""

    link: LinkPose
    poses: Array  # (N, 4, 4)
    quick: Array  # (n,) speeds of joints, as shares of the greatest: of several steps to a pose it is the quickest
    low: Array  # (n,)
    high: Array  # (n,)

    @classmethod
    def of(cls, robot: Robot, follow: Follow, poses: Array, quick: Array, low: Array, high: Array) -> Places:
        """Take poses (N, 4, 4) of the link that follows a curve."""
        target = PoseTarget(follow.link, follow.poses[0], free_rotation=follow.free_rotation)
        return cls(LinkPose.of(robot, target), poses, quick, low, high)

    def every(self, which: slice) -> Places:
        """Return some of them."""
        return replace(self, poses=self.poses[which])

    @property
    def free(self) -> str:
        """The axis about which the link may turn as it likes."""
        return self.link.target.free_rotation

    def linearized(self, rows: Array) -> tuple[Array, Array]:
        """The errors (N, 6) of rows (N, n), each at its own pose, and their Jacobians (N, 6, n)."""
        return self.link.towards(rows, self.poses)

    def back(self, rows: Array, steps: int = SOLVER_STEPS) -> Array:
        """Return rows (N, n) brought to their poses, as far as that goes in some steps. Where joints would go beyond
        their bounds, the others do what they can."""
        rows = np.clip(rows, self.low, self.high)
        for _ in range(steps):
            error, jacobian = self.linearized(rows)
            if _arrived(error).all():
                break
            scaled = jacobian * self.quick
            moved = rows + _least(scaled, error) * self.quick
            stopped = (moved < self.low) | (moved > self.high)
            if stopped.any():
                moved = np.where(stopped, rows, rows + _least(scaled * ~stopped[:, None, :], error) * self.quick)
            rows = np.clip(moved, self.low, self.high)
        return rows

    def reached(self, rows: Array) -> Mask:
        """True (N,) where rows (N, n) reach their poses."""
        return _arrived(self.linearized(rows)[0])


def _least(jacobian: Array, error: Array) -> Array:
    """Return the least steps (N, n) that take away errors (N, 6), damped the less the smaller these are; none is longer
    than LONGEST_STEP."""
    damping = DAMPING * np.minimum(1.0, np.linalg.norm(error, axis=1) / UNDAMPED) + LEAST_DAMPING
    square = jacobian @ jacobian.transpose(0, 2, 1) + damping[:, None, None] ** 2 * np.eye(6)
    step = (jacobian.transpose(0, 2, 1) @ np.linalg.solve(square, error[..., None]))[..., 0]
    longest = np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12)
    return np.asarray(step * np.minimum(1.0, LONGEST_STEP / longest))


def _arrived(error: Array) -> Mask:
    sizes = np.linalg.norm(error.reshape(len(error), 2, 3), axis=2)
    return np.asarray((sizes <= POSE_ERROR).all(axis=1))


def smooth_parts(follow: Follow) -> list[Follow]:
    """Return a curve cut where its direction changes abruptly: what a link can follow without a stop."""
    poses = np.array([pose.matrix for pose in follow.poses])
    steps = np.concatenate(
        [np.diff(poses[:, :3, 3], axis=0), TURN_RADIUS * turns_between(poses, follow.free_rotation)], axis=1
    )
    lengths = np.linalg.norm(steps, axis=1)
    moving = np.flatnonzero(lengths > 0.0)
    ways = steps[moving] / lengths[moving, None]
    sharp = (ways[1:] * ways[:-1]).sum(axis=1) < np.cos(CORNER_ANGLE)
    cuts = [0, *moving[1:][sharp].tolist(), len(poses) - 1]
    return [_cut(follow, begin, end) for begin, end in itertools.pairwise(cuts)]


def _cut(follow: Follow, begin: int, end: int) -> Follow:
    return Follow(follow.link, follow.poses[begin : end + 1], free_rotation=follow.free_rotation)


def along_poses(robot: Robot, start: Array, follow: Follow, count: int) -> Array:
    """Return configurations (count, n) that bring a link from where it is at `start` (n,) along a curve, evenly and as
    steadily as they go. Raises NotFollowedError."""
    rows = [start]
    aim = Aim.at(robot, PoseTarget(follow.link, follow.poses[0], free_rotation=follow.free_rotation))
    poses = poses_of(spread(follow, count)[1:])
    for share, pose in zip(np.linspace(0.0, 1.0, count)[1:].tolist(), poses, strict=True):
        aim = aim.elsewhere(PoseTarget(follow.link, pose, free_rotation=follow.free_rotation))
        steady = 2.0 * rows[-1] - rows[-2] if len(rows) > 1 else start
        reached = brought(robot, aim, np.clip(steady, robot.lower, robot.upper))
        if isinstance(reached, str):
            raise NotFollowedError(f"{follow.link} cannot follow the curve beyond {share:.0%} of the way: {reached}")
        if np.abs(reached - rows[-1]).max() > LARGEST_STEP:
            raise NotFollowedError(TURNED_OVER.format(share))
        rows.append(reached)
    return np.array(rows)


def near_guide(robot: Robot, start: Array, follow: Follow, count: int, guide: Callable[[Array], Array]) -> Array:
    """Return configurations (count, n) that bring a link along a curve, evenly, near a `guide`, which gives joint
    values (k, n) at shares (k,) of the way; the first is `start` (n,). Raises NotFollowedError."""
    shares, poses = np.linspace(0.0, 1.0, count), spread(follow, count)
    places = Places.of(robot, follow, poses, np.ones(robot.n), robot.lower, robot.upper)
    guided = guide(shares)
    rows = places.back(guided)
    rows[0] = start
    if not (reached := places.reached(rows)[1:]).all():
        share = float(shares[1 + int((~reached).argmax())])
        raise NotFollowedError(f"{follow.link} cannot follow the curve beyond {share:.0%} of the way")
    if (far := np.abs(rows - guided).max(axis=1) > LARGEST_STEP).any():
        raise NotFollowedError(TURNED_OVER.format(float(shares[int(far.argmax())])))
    return rows


def drawn_off(robot: Robot, follow: Follow, rows: Array) -> tuple[float, float]:
    """Return a link's greatest distance from a curve [m], and turn from it [rad], in the middle between rows (N, n)
    evenly along it, where a smooth path is drawn through these."""
    path, poses = smooth(drawn_through(rows)), spread(follow, 2 * len(rows) - 1)[1::2]
    places = Places.of(robot, follow, poses, np.ones(robot.n), robot.lower, robot.upper)
    error, _ = places.linearized(path((np.arange(len(poses)) + 0.5) / len(poses)))
    off, turned = np.linalg.norm(error.reshape(-1, 2, 3), axis=2).max(axis=0).tolist()
    return off, turned


def brought(robot: Robot, aim: Aim, q: Array) -> Array | str:
    """Return joint values (n,) that reach an aim, from some close to it; or say what keeps the robot from it."""
    rows = q[None]
    for _ in range(SOLVER_STEPS):
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


def is_along(follow: Follow, other: Follow) -> bool:
    """True if two curves of one stage, from two configurations, are the same."""
    mine, others = (np.array([pose.matrix for pose in each.poses]) for each in (follow, other))
    if follow.free_rotation != "none":
        kept = ["xyz".index(follow.free_rotation), 3]
        mine, others = mine[..., kept], others[..., kept]
    return mine.shape == others.shape and np.allclose(mine, others, rtol=0.0, atol=POSE_ERROR)


def length_of(follow: Follow) -> float:
    """Return the length of a curve [m], turns counted as lengths."""
    return float(lengths_of(np.array([pose.matrix for pose in follow.poses]), follow.free_rotation)[0].sum())


def spread(follow: Follow, count: int) -> Array:
    """Return poses (count, 4, 4) that are spread evenly over a curve."""
    poses = np.array([pose.matrix for pose in follow.poses])
    steps, turns = lengths_of(poses, follow.free_rotation)
    along = np.interp(
        np.linspace(0.0, steps.sum(), count), np.concatenate([[0.0], np.cumsum(steps)]), np.arange(len(poses))
    )
    segment = np.minimum(along.astype(np.int64), len(poses) - 2)
    share = (along - segment)[:, None]
    found = np.tile(np.eye(4), (count, 1, 1))
    found[:, :3, :3] = matrices_of(share * turns[segment]) @ poses[segment, :3, :3]
    found[:, :3, 3] = (1.0 - share) * poses[segment, :3, 3] + share * poses[segment + 1, :3, 3]
    return found


def lengths_of(poses: Array, free: str) -> tuple[Array, Array]:
    """Return the distances (N − 1,) from each of some poses (N, 4, 4) to the next, and the turns (N − 1, 3)."""
    turns = turns_between(poses, free)
    return np.hypot(
        np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1), TURN_RADIUS * np.linalg.norm(turns, axis=1)
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
