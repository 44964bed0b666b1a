"""Goals that the slowest joint reaches sooner: configurations that reach a pose, moved along the arm's self-motion.

An arm with a joint to spare, or a goal with a free axis, reaches a pose in families of configurations. Of each, inverse
kinematics gives a member that is near the start in joint space. Where the motion's time counts, another may be better:
all joints take as long as the slowest, so the others may go farther for nothing. In place of the largest of the joints'
least times stands their p-norm, whose gradient, projected on the self-motion, is the way; a few steps back to the pose
follow each step of it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdplan.planner.kinematics.inverse import Aim, damped_step, self_motion
from hdplan.planner.timing.least_time import least_times
from hdplan.scenes.array_types import Array

SLIDING_STEPS, BACK_STEPS = 16, 2  # along the self-motion, at most; back to the pose after each
LONGEST, SHORTEST = 0.2, 0.01  # [rad] or [m] of a step, at first, and below which none follows
TOLERANCE_SHARE = 0.75  # of the tolerance that may be used up
P = 12  # of the norm
DIFFERENCE = 1e-4  # [rad] or [m] of a way


def sooner(aim: Aim, q: Array, start: Array, limits: Mapping[str, Array]) -> Array:
    """Return configurations (B, n) from which no step along the self-motion leads to one that the slowest joint reaches
    sooner from `start`, within limits of rates; each from one that reaches the aim, and reaching it, too."""
    robot, q = aim.robot, q.copy()
    time, longest = least_times(q - start, limits).max(axis=1, initial=0.0), np.full(len(q), LONGEST)
    for _ in range(SLIDING_STEPS):
        going = np.flatnonzero(longest >= SHORTEST)
        if not len(going):
            break
        here = q[going]
        _, jacobian = aim.linearized(here)
        way = self_motion(-_slope(here - start, limits), jacobian)
        size = np.abs(way).max(axis=1, keepdims=True)
        there = np.clip(here + way * (longest[going, None] / np.maximum(size, 1e-12)), robot.lower, robot.upper)
        for _ in range(BACK_STEPS):
            there = damped_step(robot, there, *aim.linearized(there))
        found = least_times(there - start, limits).max(axis=1, initial=0.0)
        better = aim.within(aim.linearized(there)[0], TOLERANCE_SHARE) & (found < time[going])
        q[going[better]], time[going[better]] = there[better], found[better]
        longest[going[~better]] *= 0.5
    return q


def _slope(way: Array, limits: Mapping[str, Array]) -> Array:
    """Return the derivative (B, n) of the p-norm of the joints' least times for ways (B, n), but for a factor."""
    times = least_times(way, limits)
    rise = (least_times(np.abs(way) + DIFFERENCE, limits) - times) / DIFFERENCE
    share = times / np.maximum(times.max(axis=1, keepdims=True), 1e-12)
    return np.asarray(np.sign(way) * share ** (P - 1) * rise)
