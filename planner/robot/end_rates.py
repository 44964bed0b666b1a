"""Motion through start or goal: the rates that a scene gives, of the planned joints in their
order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdplan.planner.robot.robot import SAME_PLACE, Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.once import ReadOnly
from hdplan.scenes.targets import Goals, JointRates, JointTarget


@dataclass(frozen=True, eq=False)
class EndRates(ReadOnly):
    """Velocity and acceleration at an end of a motion."""

    field: str  # of the scene
    velocity: Array  # (n,) [rad/s or m/s]
    acceleration: Array  # (n,) [rad/s² or m/s²]
    whole: bool  # whether the scene gives the acceleration, too, which is 0 otherwise

    @property
    def given(self) -> dict[str, Array]:
        """The rates that the scene gives, by name: velocity, acceleration."""
        return {"velocity": self.velocity, **({"acceleration": self.acceleration} if self.whole else {})}

    @property
    def moving(self) -> bool:
        """True if the robot is not at rest."""
        return bool(self.velocity.any() or self.acceleration.any())


def end_rates(robot: Robot, target: JointTarget | Goals, from_request: bool) -> EndRates | None:
    """Return the rates of a scene's start or goal; None for an end at rest.

    Rates of joints that are held must be 0, and those of joints that follow others must agree with theirs; those that
    are not named are 0. Raises InputError for these, for a wrong number of values, and for unknown names; with
    `from_request`, of joints that the robot does not have nothing is reported.
    """
    if isinstance(target, Goals) or target.velocity is None:
        return None
    velocity = _resolved(robot, target.velocity, f"{target.field}.velocity", from_request)
    if target.acceleration is None:
        return EndRates(target.field, velocity, np.zeros(robot.n), whole=False)
    acceleration = _resolved(robot, target.acceleration, f"{target.field}.acceleration", from_request)
    return EndRates(target.field, velocity, acceleration, whole=True)


def _resolved(robot: Robot, given: JointRates, where: str, from_request: bool) -> Array:
    if not isinstance(given, Mapping):
        return robot.one_each(given, where)
    found = np.zeros(robot.n)
    for joint, value in given.items():
        if joint in robot.joint_names:
            found[robot.joint_names.index(joint)] = value
        elif joint in robot.locked:
            if value != 0.0:
                raise InputError(
                    f"{where}: joint '{joint}' is held at {robot.locked[joint]:g}: must be 0, found {value:g}"
                )
        elif joint not in robot.followers and not from_request:
            robot.index_of(joint, where)  # raises
    if robot.linkage is not None:
        for joint, value in zip(robot.linkage.names, (robot.linkage.matrix @ found).tolist(), strict=True):
            if abs(given.get(joint, value) - value) > SAME_PLACE:
                raise InputError(f"{where}: joint '{joint}' at {given[joint]:g}, but {robot.linkage.rule(joint)}")
    return found
