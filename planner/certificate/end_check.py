"""The certificate's check of the ends: whether a motion begins and ends where its scene says."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.end_rates import EndRates
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import naming
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget

UNITS = {"velocity": "per second", "acceleration": "per second squared"}
SAME_END = 1e-6  # [rad] or [m] between an end of the trajectory and the scene's; of its rates per second


@dataclass(frozen=True, eq=False)
class EndCheck:
    """The ends of one scene."""

    scene: Scene
    robot: Robot
    rates: tuple[EndRates | None, EndRates | None] = (None, None)  # at start and goal; None: none required

    def misses(self, curve: Curve) -> dict[str, str | None]:
        """Say for each field about the ends how a motion misses it, the start first; None for one that it meets."""
        with naming(self.scene.source):
            start = self.robot.configuration(self.scene.start, self.scene.from_request)
            return {
                "start": self._off("first", curve.rows[0], start, "start", 0.0),
                "goal": self.off_goal(curve.rows[-1]),
                **self._rates_missed(curve, "start", "first", 0, self.rates[0]),
                **self._rates_missed(curve, "goal", "last", -1, self.rates[1]),
            }

    def _rates_missed(
        self, curve: Curve, end: str, which: str, row: int, required: EndRates | None
    ) -> dict[str, str | None]:
        """Say for each rate that the scene gives an end how a motion misses it. A path without times has none, and is
        refused only where the robot is to move."""
        if required is None:
            return {}
        found: dict[str, str | None] = {}
        for order, (rate, wanted) in enumerate(required.given.items(), 1):
            found[f"{end}.{rate}"] = None
            if curve.times is None:
                if wanted.any():
                    found[f"{end}.{rate}"] = f"the motion has no times, and the {rate} at the scene's {end} is not 0"
                continue
            there = curve.over_time(order).rows[row]
            joint = int(np.abs(there - wanted).argmax())
            if not abs(there[joint] - wanted[joint]) <= SAME_END:
                name, unit = self.robot.joint_names[joint], UNITS[rate]
                found[f"{end}.{rate}"] = (
                    f"the {which} waypoint has joint '{name}' at {there[joint]:g} {unit}, the scene's {end} at "
                    f"{wanted[joint]:g}"
                )
        return found

    def placed(self, curve: Curve) -> Iterator[tuple[str, Array, float]]:
        """Yield the scene's ends: field, configuration (n,), time [s]. If the scene leaves a choice of goals, the goal
        is the motion's last row, if it reaches one of them."""
        goal, scene = self.scene.goal, self.scene
        with naming(scene.source):
            yield scene.start.field, self.robot.configuration(scene.start, scene.from_request), 0.0
            match goal:
                case JointTarget():
                    yield goal.field, self.robot.configuration(goal, scene.from_request), scene.end_time
                case Goals(targets):
                    reached = next((target for target in targets if not self._missing(curve.rows[-1], target)), None)
                    if reached is not None:
                        yield reached.field, curve.rows[-1], scene.end_time
                case _:
                    assert_never(goal)

    def off_goal(self, q: Array) -> str | None:
        """Return the error, in words, of configuration q (n,) as the last waypoint from the scene's goal, or the first
        of several; None if it reaches one."""
        match goal := self.scene.goal:
            case JointTarget():
                return self._off("last", q, self.robot.configuration(goal, self.scene.from_request), "goal")
            case Goals(targets):
                misses = [self._missing(q, target) for target in targets]
                return misses[0] if all(misses) else None
            case _:
                assert_never(goal)

    def _missing(self, q: Array, target: JointTarget | PoseTarget | AllOf) -> str | None:
        match target:
            case JointTarget():
                return self._off("last", q, self.robot.configuration(target), target.field)
            case PoseTarget() | AllOf():
                from hdplan.planner.certificate.pose_goals import miss_of  # only for a pose

                for pose in target.poses:  # together: each of them counts
                    miss = miss_of(self.robot, pose, q)
                    if not miss.within(pose):
                        return f"the last waypoint has {pose.link} {miss} away from {pose.field}"
                return None
            case _:
                assert_never(target)

    def _off(self, which: str, row: Array, target: Array, field: str, turn: float = 2 * np.pi) -> str | None:
        """Return the difference, in words, of the first or last waypoint from the configuration of a field; None if it
        does not. A goal may be reached a whole `turn` away by joints without limits; a robot that stands elsewhere than
        where its motion begins would jump there."""
        error = row - target
        error = error - turn * np.round(error / (2 * np.pi)) * self.robot.endless
        joint = int(np.abs(error).argmax())
        if abs(error[joint]) <= SAME_END:
            return None
        return (
            f"the {which} waypoint has joint '{self.robot.joint_names[joint]}' at {row[joint]:g}, "
            f"the scene's {field} at {target[joint]:g}"
        )
