"""The path of overlapping motions, timed again.

Two motions that add up keep their own laws: limits then hold on the sum only where both are slow, so that they can
overlap for a while alone. Here nothing of them is kept but their path, and that is driven as quickly as the limits
allow, along all of it. The path is the smooth one (`timing.retiming`) of a few configurations evenly along it: the
fewer, the rounder it is and the sooner it is driven, and the farther from the curves that it is to follow, of which the
certificate is the judge.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.path_spline import smooth
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError

COUNTS = (30, 60, 120)  # configurations on a path when it is drawn
PLACES_PER_INTERVAL = 8  # places where each interval between rows is measured


def retimed_path(
    setup: Setup,
    motions: Sequence[tuple[Trajectory, Sequence[float]]],
    speeds: Array,
    in_time: Callable[[], None] = lambda: None,
) -> list[tuple[Trajectory, list[float]]]:
    """Return motions from time 0 on along the paths of others, each given with the times [s] on it at which its stages
    begin, and the times at which theirs do; the quickest first. Each stage has a speed, a share of what the limits
    allow. What raises once time is up, `in_time`, is called before each."""
    retimer, found = Retimer(setup), []
    for motion, marks in motions:
        curve, places = motion.curve, np.linspace(0.0, 1.0, PLACES_PER_INTERVAL * len(motion))
        steps = np.linalg.norm(np.diff(curve.at_parameter(places), axis=0), axis=1)
        length = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
        shares = np.interp(curve.parameter_of(np.asarray(marks)), places, length)
        for count in COUNTS:
            in_time()
            rows = curve.at_parameter(np.interp(np.linspace(0.0, 1.0, count), length, places))
            rows[0], rows[-1] = motion.positions[0], motion.positions[-1]
            if (
                timed := _along(retimer, Trajectory(motion.joint_names, rows, motion.locked), shares, speeds)
            ) is not None:
                found.append(timed)
    return sorted(found, key=lambda each: each[0].duration or 0.0)


def _along(retimer: Retimer, path: Trajectory, shares: Array, speeds: Array) -> tuple[Trajectory, list[float]] | None:
    """Return the quickest motion along a path, and the times of those of its rows that are nearest to shares of it, at
    which stages with these speeds begin; None where there is none, or no row for each stage."""
    paced = retimer.with_speeds(speeds, shares[1:])
    try:
        timed = paced.along(path, smooth(path.positions))
    except HdplanError:
        return None
    times = timed.trajectory.times
    assert times is not None
    nearest = np.abs(timed.parameter[:, None] - shares).argmin(axis=0)
    if not np.diff(nearest, append=len(times) - 1).all():  # a stage is over before the next row
        return None
    return timed.trajectory, times[nearest].tolist()
