"""A motion read at times, for its execution: positions, velocities, accelerations, poses of a link.

The values are those of the curve itself (`curve`), evaluated piece by piece, up to rounding; at a row of the trajectory
they are the row's, to the bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.once import ReadOnly
from hdplan.scenes.values import instance

if TYPE_CHECKING:
    from hdplan.planner.robot.robot import Robot


SAME_HELD = 1e-6  # [rad] or [m] between a joint's value here and the one at which a robot holds it


@dataclass(frozen=True, eq=False)
class Samples(ReadOnly):
    """A motion at one time or at several; the shape (…) of `times` leads every array."""

    joint_names: tuple[str, ...]  # (n,) the columns
    times: Array  # (…) [s]
    positions: Array  # (…, n) [rad] or [m]
    velocities: Array  # (…, n) [rad/s] or [m/s]
    accelerations: Array  # (…, n) [rad/s²] or [m/s²]; at a row where they jump, those after it
    locked: Mapping[str, float]  # joints that are held -> value [rad] or [m]

    def __len__(self) -> int:
        """The number of samples."""
        return self.times.size

    def poses(self, robot: Robot, link: str | None = None) -> Array:
        """Return the poses (…, 4, 4) of a link of `robot` in the world, by default of the end effector: homogeneous
        matrices, by Pinocchio.

        Raises InputError for a link that the robot does not have or does not move, and for a motion of other joints.
        """
        from hdplan.planner.robot.link_frame import link_frame, link_poses
        from hdplan.planner.robot.robot import Robot

        instance(robot, Robot, "robot")
        frame = link_frame(robot, link, "")
        q = self._of(robot, frame).reshape(-1, robot.n)
        return link_poses(robot, q, frame).reshape(*self.times.shape, 4, 4)

    def _of(self, robot: Robot, frame: int) -> Array:
        """Return the positions (…, n) of the robot's planned joints. Where held joints carry the frame, all that are
        held must be where the robot holds them."""
        names = self.joint_names
        if missing := [name for name in robot.joint_names if name not in names]:
            raise InputError(f"robot: the motion has no joint '{missing[0]}'{nearest(missing[0], names)}")
        frames = robot.model.frames
        while frame and frames[frame].parentFrame != frame:  # Pinocchio makes a held joint's frame its own parent
            frame = frames[frame].parentFrame
        for name, held in robot.locked.items() if frame else ():  # one of them carries the link, and maybe others
            values = self.positions[..., names.index(name)] if name in names else self.locked.get(name)
            if values is not None and np.abs(values - held).max() > SAME_HELD:
                raise InputError(f"robot: joint '{name}' carries the link, and is held at {held:g}: it moves here")
        return self.positions[..., [names.index(name) for name in robot.joint_names]]
