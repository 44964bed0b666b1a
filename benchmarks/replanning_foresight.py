"""A planner that knows the future, beside `replanning.py`: the same goals, in the world that a run has recorded.

From goal to goal, at rest in each. Among motions that take ever longer, the first that is certified against everything
that will move, where it will be: the quickest one of the empty world, and then the planner's own of a given duration
(`timing.duration`), which sees obstacles at their times. Where there is none, the robot waits; who comes to it then is
not its contact, as for the replanner.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from replanning_world import Walker

import hdplan

KNOTS = 0.02  # [s] between two recorded poses
INTERPOLATED = 0.005  # [m] kept from what moves, as between two knots it may have turned
FAR = 2.0  # [m] from the base, out of the robot's reach
LONGER = (1.3, 1.8, 2.6)  # times the quickest motion's duration
WAITS = 0.2  # [s] until another one is sought
LIMIT = 0.3  # [s] of the processor for one motion


class Past:
    """Where everything was in a run."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, dict[str, np.ndarray]]] = []
        self.shapes: dict[str, hdplan.Box | hdplan.Sphere | hdplan.Capsule] = {}

    def note(self, t: float, walkers: list[Walker]) -> None:
        """Note where all are at a time [s], if it is one of the knots."""
        if self.rows and t < self.rows[-1][0] + KNOTS - 1e-9:
            return
        self.shapes.update({each.name: each.shape for each in walkers})
        turns = {each.name: pin.Quaternion(each.turn).normalized().coeffs() for each in walkers}
        self.rows.append((t, {each.name: np.append(each.at, turns[each.name]) for each in walkers}))

    @cached_property
    def times(self) -> np.ndarray:
        """The knots (k,) [s]."""
        return np.array([t for t, _ in self.rows])

    @cached_property
    def poses(self) -> Mapping[str, np.ndarray]:
        """Positions and turns (k, 7) of each."""
        return {name: np.array([row[name] for _, row in self.rows]) for name in self.shapes}

    def from_now(self, t: float, seconds: float) -> list[hdplan.Obstacle]:
        """Return what will move within some seconds, and where, with times relative to now."""
        first = max(int(np.searchsorted(self.times, t, side="right")) - 1, 0)
        rows = slice(first, int(np.searchsorted(self.times, t + seconds)) + 2)
        found, times = list[hdplan.Obstacle](), np.maximum(self.times[rows] - t, 0.0)
        if len(times) < 2:
            return found
        passed = (t - self.times[first]) / (self.times[first + 1] - self.times[first])
        for name, poses in self.poses.items():
            along = poses[rows].copy()
            along[0, :3] += passed * (along[1, :3] - along[0, :3])
            if np.linalg.norm(along[:, :3], axis=1).min() > FAR:
                continue
            known = hdplan.TimedPoses(times.tolist(), [hdplan.Pose(each[:3], each[3:]) for each in along])
            found.append(hdplan.Obstacle(name, self.shapes[name], known.poses[0], INTERPOLATED, known))
        return found


def goals_of_who_knows(past: Past, scene: hdplan.Scene, goals: list[np.ndarray], seconds: float) -> tuple[int, float]:
    """Return the number of goals that a planner with knowledge of the future reaches, and the time of the first [s]."""
    robot = hdplan.build(scene).robot
    at, t, reached, first, tries = robot.configuration(scene.start), 0.0, 0, float("inf"), 0
    while t < seconds:
        goal = goals[reached % len(goals)]
        alone = scene.with_start(at.tolist()).with_goal(goal.tolist())
        quickest = hdplan.plan(alone, robot=robot).trajectory
        took = _certified(past, alone, robot, quickest, t, tries)
        if took is None:
            t, tries = t + WAITS, tries + 1
            continue
        t += took
        if t <= seconds:
            at, reached, first, tries = goal, reached + 1, min(first, t), 0
    return reached, first


def _certified(
    past: Past, alone: hdplan.Scene, robot: hdplan.Robot, quickest: hdplan.Trajectory, t: float, tries: int
) -> float | None:
    """Return the duration of a motion that is certified as free and begins at a given time; None without one: the
    quickest, or one of the longer ones, which take turns."""
    assert quickest.duration is not None
    duration = LONGER[tries % len(LONGER)] * quickest.duration
    scene = replace(alone, obstacles=(*alone.obstacles, *past.from_now(t, duration)))
    try:
        if hdplan.certify(scene, quickest, robot).certified:
            return quickest.duration
        timed = replace(scene, timing=hdplan.Timing(duration=duration))
        found = hdplan.plan(timed, robot=robot, guess=quickest, time_limit=LIMIT)
    except hdplan.HdplanError:
        return None
    return duration if found.certificate.certified else None
