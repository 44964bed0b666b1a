"""The pose of a moving obstacle at a given time: its motion is a sequence of segments of constant velocity and spin.

    p(t) = p_0 + v (t − t_0),   R(t) = exp([ω]ₓ (t − t_0)) R_0    for t in a segment from t_0 to t_1

with v [m/s] and ω [rad/s] in the world: those of a `SteadyMotion`, or between two timed poses those that lead from one
to the other by the shortest turn (exact).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.obstacles import Obstacle, SteadyMotion, TimedPoses


@dataclass(frozen=True, eq=False)
class ObstacleMotion:
    """The motion of one obstacle over all time: the first segment has no beginning and the last has no end."""

    begins: Array  # (m,) [s] increasing; the first is −inf
    anchors: Array  # (m,) [s] a time t_0 in each segment
    poses: Array  # (m, 4, 4) where the obstacle is at that time, in the world
    velocity: Array  # (m, 3) of its origin [m/s]
    spin: Array  # (m, 3) about its origin [rad/s]

    @classmethod
    def of(cls, obstacle: Obstacle) -> ObstacleMotion:
        """Return the motion of an obstacle; for one that stands still, a single segment at rest."""
        rest = np.zeros((1, 3))
        match motion := obstacle.motion:
            case None:
                return cls._steady(obstacle, rest, rest)
            case SteadyMotion():
                return cls._steady(obstacle, np.array([motion.velocity]), np.array([motion.spin]))
            case TimedPoses():
                times, poses = np.array(motion.times), np.array([pose.matrix for pose in motion.poses])
            case _:
                assert_never(motion)
        widths = np.diff(times)[:, None]
        turns = scipy.spatial.transform.Rotation.from_matrix(
            poses[1:, :3, :3] @ poses[:-1, :3, :3].transpose(0, 2, 1)
        ).as_rotvec()
        with np.errstate(over="ignore"):  # the certificate refuses what moves too fast
            velocity, spin = np.diff(poses[:, :3, 3], axis=0) / widths, turns / widths
        return cls(
            np.concatenate([[-np.inf], times]),
            np.concatenate([times[:1], times]),
            np.concatenate([poses[:1], poses]),
            np.concatenate([rest, velocity, rest]),
            np.concatenate([rest, spin, rest]),
        )

    @classmethod
    def _steady(cls, obstacle: Obstacle, velocity: Array, spin: Array) -> ObstacleMotion:
        return cls(np.array([-np.inf]), np.zeros(1), obstacle.pose.matrix[None].copy(), velocity, spin)

    def at(self, times: Array) -> Array:
        """Return the obstacle's poses (k, 4, 4) at times (k,) [s]."""
        row = self.segment(times)
        elapsed = (times - self.anchors[row])[:, None]
        placements = self.poses[row].copy()
        if self.spin.any():
            turned = scipy.spatial.transform.Rotation.from_rotvec(elapsed * self.spin[row]).as_matrix()
            placements[:, :3, :3] = turned @ placements[:, :3, :3]
        placements[:, :3, 3] += elapsed * self.velocity[row]
        return placements

    def segment(self, times: Array) -> NDArray[np.int64]:
        """Return the index of the segment in which each time (k,) lies."""
        return np.searchsorted(self.begins, times, side="right") - 1
