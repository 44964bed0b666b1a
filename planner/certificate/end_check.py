"""The certificate's check of the ends: whether a motion begins and ends where its scene says."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.errors import naming
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import AllOf, JointTarget, PoseTarget

Array = NDArray[np.float64]

SAME_END = 1e-6  # [rad] or [m] between an end of the trajectory and the scene's


@dataclass(frozen=True, eq=False)
class EndCheck:
    """The ends of one scene."""

    scene: Scene
    robot: Robot

    def wrong(self, curve: Curve) -> str | None:
        """Say how a motion misses the start, or else the goal; None if it reaches both."""
        waypoints = curve.rows
        with naming(self.scene.source):
            start = self.robot.configuration(self.scene.start, self.scene.from_request)
            at_start, at_goal = self._off("first", waypoints[0], start, "start"), self.off_goal(waypoints[-1])
        return at_start or at_goal

    def placed(self, curve: Curve) -> Iterator[tuple[str, Array, float]]:
        """Yield the scene's ends: field, configuration (n,), time [s]. If the scene leaves a choice of goals, the goal
        is the motion's last row, if it reaches one of them."""
        goal, scene = self.scene.goal, self.scene
        with naming(scene.source):
            yield scene.start.field, self.robot.configuration(scene.start, scene.from_request), 0.0
            if isinstance(goal, JointTarget):
                yield goal.field, self.robot.configuration(goal, scene.from_request), scene.end_time
                return
            reached = next((target for target in goal.targets if not self._missing(curve.rows[-1], target)), None)
            if reached is not None:
                yield reached.field, curve.rows[-1], scene.end_time

    def off_goal(self, q: Array) -> str | None:
        """Say how configuration q (n,) as the last waypoint misses the scene's goal, or the first of several; None if
        it reaches one."""
        goal = self.scene.goal
        if isinstance(goal, JointTarget):
            return self._off("last", q, self.robot.configuration(goal, self.scene.from_request), "goal")
        misses = [self._missing(q, target) for target in goal.targets]
        return misses[0] if all(misses) else None

    def _missing(self, q: Array, target: JointTarget | PoseTarget | AllOf) -> str | None:
        if isinstance(target, JointTarget):
            return self._off("last", q, self.robot.configuration(target), target.field)
        from hdplan.planner.certificate.pose_goals import miss_of  # only for a pose

        for pose in target.poses:  # together: each of them counts
            miss = miss_of(self.robot, pose, q)
            if not miss.within(pose):
                return f"the last waypoint has {pose.link} {miss} away from {pose.field}"
        return None

    def _off(self, which: str, row: Array, target: Array, field: str) -> str | None:
        """Say how the first or last waypoint differs from the configuration of a field; None if it does not."""
        error = row - target
        error = np.where(self.robot.endless, np.angle(np.exp(1j * error)), error)  # equal up to whole turns
        joint = int(np.abs(error).argmax())
        if abs(error[joint]) <= SAME_END:
            return None
        return (
            f"the {which} waypoint has joint '{self.robot.joint_names[joint]}' at {row[joint]:g}, "
            f"the scene's {field} at {target[joint]:g}"
        )
