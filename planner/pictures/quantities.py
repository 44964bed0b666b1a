"""The joints' quantities over time along a motion: velocities, accelerations, jerks and torques, beside their limits.

The executed curve itself is evaluated, with both sides where it jumps. For a file with times only, finite differences:
a constant velocity between two waypoints, and its change at each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdplan.planner.certificate.limit_checks import LimitCheck
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.limits import QUANTITIES

ALWAYS = ("velocity", "acceleration")  # drawn for every motion with times
POINTS = 800  # at least, of a curve that is not straight between its waypoints


@dataclass(frozen=True, eq=False)
class Rate:
    """A quantity of n joints along a motion."""

    quantity: str  # "velocity", "acceleration", "jerk", "torque"
    where: str  # for the title: "" if it is known everywhere, or else " at waypoints" or " between waypoints"
    times: Array  # (k,) [s]; one more than the values if each of these holds from one time to the next
    values: Array  # (k, n)
    limits: Array | None  # (n,), if the scene has any


def rates(trajectory: Trajectory, checks: Sequence[LimitCheck]) -> tuple[Rate, ...]:
    """Return velocities, accelerations, and the other quantities that the scene limits, by the certifier's `checks`;
    nothing for a path without times. The trajectory's joints are the robot's, in its order."""
    if trajectory.times is None:
        return ()
    limits = {quantity: limit for check in checks for quantity, limit in check.limits.items()}
    velocity, acceleration = ALWAYS
    if trajectory.velocities is None:
        velocities, accelerations = differences(trajectory)
        return (
            Rate(velocity, " between waypoints", trajectory.times, velocities, limits.get(velocity)),
            Rate(acceleration, " at waypoints", trajectory.times[1:-1], accelerations, limits.get(acceleration)),
        )
    curve = trajectory.curve
    interval, fraction = sampled(curve)
    times = curve.time_of((interval + fraction) / (len(curve) - 1))
    found = {name: curve.over_time(DERIVATIVES[name]).at(interval, fraction) for name in ALWAYS}
    for check in checks:
        for name in check.limits.keys() - found.keys():
            found[name] = check.values(name, curve, interval, fraction)
    return tuple(Rate(name, "", times, found[name], limits.get(name)) for name in QUANTITIES if name in found)


def differences(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return the velocities (N − 1, n) between the waypoints and the accelerations (N − 2, n) at the inner ones, each
    over the time from one interval's middle to the next's."""
    assert trajectory.times is not None
    widths = np.diff(trajectory.times)[:, None]
    velocities = np.diff(trajectory.positions, axis=0) / widths
    return velocities, np.diff(velocities, axis=0) / (0.5 * (widths[1:] + widths[:-1]))


def sampled(curve: Curve) -> tuple[Rows, Array]:
    """Return the intervals (k,) and fractions within them (k,) at which a curve is drawn, including both sides of each
    waypoint."""
    intervals = len(curve) - 1
    fractions = np.linspace(0.0, 1.0, max(2, -(-POINTS // intervals) + 1))
    return np.repeat(np.arange(intervals), len(fractions)), np.tile(fractions, intervals)
