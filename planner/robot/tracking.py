"""Largest deviations of joints from a motion during its execution: a scene's `robot.tracking`, one value for each
joint."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import naming
from hdplan.scenes.scene import Scene
from hdplan.scenes.sizes import Tracking


def tracking(scene: Scene, robot: Robot, name: str = "position") -> Array:
    """Return the tracking errors of the planned joints (n,), or of their velocities [rad or m, per second]; held joints
    are at their values.

    Raises InputError, naming the file that specifies the robot, for a wrong number of values and unknown names.
    """
    given = getattr(scene.robot.tracking or Tracking(), name)
    where = f"robot.tracking.{name}"
    with naming(scene.robot.source or scene.source):
        if isinstance(given, float):
            return np.full(robot.n, given)
        if not isinstance(given, Mapping):
            return robot.one_each(given, where)
        found = np.zeros(robot.n)
        for joint, value in given.items():
            found[robot.index_of(joint, where)] = value
        return found


def tracking_of_all(scene: Scene, robot: Robot, name: str = "position") -> Array:
    """Return the tracking errors of all joints of the model (m,): a follower's is its leader's, times its factor."""
    own = tracking(scene, robot, name)
    return own if robot.linkage is None else np.abs(robot.linkage.matrix) @ own
