"""The moving obstacles of a controller, all at once: where they are, and with which twist they move there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.obstacle_motion import ObstacleMotion


class Movers:
    """The motions of m obstacles; their s segments follow one another in the same arrays."""

    def __init__(self, motions: Sequence[ObstacleMotion]) -> None:
        """Stack the segments of motions."""
        counts = np.array([len(motion.begins) for motion in motions], dtype=np.int64)
        self._first = counts.cumsum() - counts  # (m,) of each motion's segments
        self._of = np.repeat(np.arange(len(motions)), counts)  # (s,) whose segment it is
        self._parted = [(index, motion) for index, motion in enumerate(motions) if len(motion.begins) > 1]
        self._anchors = _stacked([motion.anchors for motion in motions], ())  # (s,) [s]
        self._poses = _stacked([motion.poses for motion in motions], (4, 4))
        self._velocity = _stacked([motion.velocity for motion in motions], (3,))  # [m/s]
        self._spin = _stacked([motion.spin for motion in motions], (3,))  # [rad/s]

    def __len__(self) -> int:
        """The number of moving obstacles."""
        return len(self._first)

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return at times (k,) [s] the placements (k, m, 12) as `KinematicsBatch` has them, and the twists (k, m, 6):
        velocity of the world's origin [m/s], angular velocity [rad/s]."""
        segments = np.tile(self._first, (len(times), 1))
        for index, motion in self._parted:
            segments[:, index] += motion.segment(times)
        speed, spin, poses = self._velocity[segments], self._spin[segments], self._poses[segments]
        elapsed = (times[:, None] - self._anchors[segments])[..., None]
        turns = scipy.spatial.transform.Rotation.from_rotvec((elapsed * spin).reshape(-1, 3)).as_matrix()
        turned = turns.reshape(*segments.shape, 3, 3) @ poses[..., :3, :3]
        origins = poses[..., :3, 3] + elapsed * speed
        placements = np.concatenate([turned.reshape(*segments.shape, 9), origins], axis=-1)
        return placements, np.concatenate([speed - np.cross(spin, origins), spin], axis=-1)

    def fastest(self, owners: Rows, sizes: Array) -> float:
        """Return a bound of the speed [m/s] of every point of bodies that obstacles (b,) carry and that reach as far
        (b,) [m] from their origins."""
        farthest = np.zeros(len(self))
        np.maximum.at(farthest, owners, sizes)
        speed, spin = (np.linalg.norm(each, axis=1) for each in (self._velocity, self._spin))
        return float((speed + farthest[self._of] * spin).max(initial=0.0))


def _stacked(parts: Sequence[Array], shape: tuple[int, ...]) -> Array:
    return np.concatenate([np.empty((0, *shape)), *parts])
