"""The scene as it is edited in the browser: a value that is replaced by every change.

Of a goal that leaves a choice, the scene keeps the whole (tolerances, free axes, alternatives); one configuration of it
is shown, and planned to while something is dragged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.end_check import SAME_END
from hdplan.planner.certificate.pose_goals import miss_of
from hdplan.planner.certificate.verdict import Contact
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import settled
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget

Target = JointTarget | PoseTarget | AllOf


@dataclass(frozen=True, eq=False)
class Edited:
    """A scene with its robot, and a configuration for each end."""

    setup: Setup
    start: Array  # (n,) [rad or m]
    goal: Array  # (n,) in which the goal is shown; it misses a pose that is out of reach
    alternative: int = 0  # which of several goals that is

    @classmethod
    def of(cls, setup: Setup, motion: Trajectory | None = None) -> Edited:
        """Take a scene; its goal is shown where `motion` ends, if it is met there, or else in the most promising
        configuration. Raises InputError as `settled`, and for a start or goal with a velocity, which no edit keeps."""
        setup.refuse_moving_ends("the viewer edits scenes that begin and end at rest")
        query = settled(setup, motion).query
        return cls(setup, query.start, query.goal).shown_at(query.goal)

    @property
    def scene(self) -> Scene:
        """The scene, with its goal and its files on request."""
        return self.setup.requested

    @property
    def read(self) -> Scene:
        """This scene with its files read, to be drawn."""
        return self.setup.scene

    @property
    def robot(self) -> Robot:
        """The scene's robot."""
        return self.setup.robot

    def obstacle(self, name: str) -> Obstacle:
        """Return the obstacle of a name. Raises InputError if it is gone."""
        for obstacle in self.scene.obstacles:
            if obstacle.name == name:
                return obstacle
        raise InputError(f"obstacle {name}: is no longer in the scene")

    @cached_property
    def certifier(self) -> Certifier:
        """The certifier of motions in this scene."""
        return Certifier(self.setup)

    def left(self) -> None:
        """Drop large data that can be made again, as another scene is shown by now."""
        vars(self).pop("certifier", None)

    @cached_property
    def contacts(self) -> tuple[tuple[Contact, ...], tuple[Contact, ...]]:
        """Contacts at the start and at the goal, the deepest first."""
        return self.certifier.contacts(self.start), self.certifier.contacts(self.goal, self.scene.end_time)

    @cached_property
    def missed(self) -> str | None:
        """The miss of the configuration shown at the goal, in words; None if it meets it."""
        return self.certifier.ends.off_goal(self.goal)

    @property
    def aimed(self) -> Scene:
        """The scene with the configuration shown as its goal."""
        goal = self.scene.goal
        if isinstance(goal, JointTarget):
            return self.scene
        return replace(self.scene, goal=JointTarget(goal.field, tuple(self.goal.tolist())))

    def changed(self, **fields: Any) -> Edited:
        """The scene with other obstacles or settings: fields of `Scene`. Raises InputError as `Scene`."""
        return replace(self, setup=self.setup.changed(**fields))

    def starting_at(self, q: Array) -> Edited:
        """The scene with another start (n,). Raises InputError for values beyond the joint limits."""
        start = JointTarget("start", tuple(q.tolist()))
        self.robot.configuration(start)
        return replace(self.changed(start=start), start=q)

    def ending_at(self, q: Array, goal: Goals | None = None) -> Edited:
        """The scene with another goal: the configuration `q` (n,), or, shown there, a goal with a choice. Raises
        InputError for values beyond the joint limits."""
        target = JointTarget("goal", tuple(q.tolist()))
        self.robot.configuration(target)
        return replace(self.changed(goal=goal or target), goal=q)

    def shown_at(self, q: Array) -> Edited:
        """Return this scene with its goal shown in another configuration (n,), and the alternative that this
        meets."""
        goal = self.scene.goal
        targets: Sequence[Target] = () if isinstance(goal, JointTarget) else goal.targets
        met = (i for i, target in enumerate(targets) if _meets(self.robot, q, target))
        return replace(self, goal=q, alternative=next(met, self.alternative))

    @property
    def target(self) -> Target:
        """The goal, or the alternative of it that is shown."""
        goal = self.scene.goal
        return goal if isinstance(goal, JointTarget) else goal.targets[self.alternative]


def _meets(robot: Robot, q: Array, target: Target) -> bool:
    if isinstance(target, JointTarget):
        return bool(np.abs(robot.configuration(target) - q).max() <= SAME_END)
    return all(miss_of(robot, pose, q).within(pose) for pose in target.poses)
