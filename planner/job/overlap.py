"""Two motions from rest to rest, of which the second begins a while τ before the first has ended; in the meantime both
add up:

    q(t) = q₁(t) + q₂(t − T₁ + τ) − q,    q where the first ends and the second begins.

Their rows are those of both, so that the sum is a quintic between them, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hdplan.planner.job.blends import UnblendedError
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.link_frame import frames_of, link_poses
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError

TIME_DIGITS = 9  # of times [s]: rows that are closer are one
GRID = 64  # times in an interval between rows at which other rows may lie
RADIUS_SHARE = 0.95  # of a radius, to which both motions keep
OVERLAP_FACTOR = 0.85  # from one overlap to the next one that is tried


def columns_of(motion: Trajectory) -> tuple[Array, Array, Array, Array]:
    """Return positions, times, velocities and accelerations of a motion that has them all."""
    assert motion.times is not None
    assert motion.velocities is not None
    assert motion.accelerations is not None
    return motion.positions, motion.times, motion.velocities, motion.accelerations


def overlapped(first: Trajectory, second: Trajectory, overlap: float) -> Trajectory:
    """Return both as one motion that begins at time 0; `overlap` [s] is shorter than each of them."""
    of_first, of_second = columns_of(first)[1], columns_of(second)[1]
    ends, begins = of_first - of_first[0], of_second - of_second[0]
    later = float(ends[-1]) - overlap
    times = np.unique(np.round(np.concatenate([ends, later + begins]), TIME_DIGITS))
    one = first.at_time(of_first[0] + np.clip(times, 0.0, ends[-1]))
    other = second.at_time(of_second[0] + np.clip(times - later, 0.0, begins[-1]))
    positions = one.positions + (other.positions - second.positions[0])
    velocities, accelerations = one.velocities + other.velocities, one.accelerations + other.accelerations
    return Trajectory(first.joint_names, positions, first.locked, times, velocities, accelerations)


def slowed(motion: Trajectory, factor: float) -> Trajectory:
    """Return the motion slowed by a factor, beginning at time 0."""
    _, times, velocities, accelerations = columns_of(motion)
    times, velocities, accelerations = factor * (times - times[0]), velocities / factor, accelerations / factor**2
    return replace(motion, times=times, velocities=velocities, accelerations=accelerations)


def in_step(motion: Trajectory, rate: float) -> Trajectory:
    """Return this motion a little slower, with rows that lie a multiple of 1 / (GRID rate) apart: rows of two
    motions are then together or well apart, and jerk between them is no rounding."""
    interval = float(motion.duration or 0.0) / (len(motion) - 1)
    grid = 1.0 / (GRID * rate)
    return slowed(motion, grid * np.ceil(interval / grid * (1.0 - 1e-9)) / interval)


def longest_overlap(
    robot: Robot,
    link: str,
    radius: float,
    first: Trajectory,
    second: Trajectory,
    rate: float,
    allowed: Callable[[Curve], bool],
) -> float:
    """Return the longest overlap [s], in rows at a `rate`, for which a link stays within a radius of where it would
    stop, and the curve is `allowed`. Raises UnblendedError for a motion that is within the radius all along,
    HdplanError where no overlap is allowed."""
    rooms = []
    for motion, at_end, which in ((first, True, "itself"), (second, False, "that follows")):
        assert motion.times is not None
        places = link_poses(robot, motion.positions, frames_of(robot)[link])[:, :3, 3]
        far = np.linalg.norm(places - places[-1 if at_end else 0], axis=1) > RADIUS_SHARE * radius
        if not far.any():
            raise UnblendedError(f"{radius:g} m is larger than the stage {which}: {link} is within it all along")
        beyond = np.flatnonzero(far)
        times = motion.times
        room = times[-1] - times[beyond[-1] + 1] if at_end else times[beyond[0] - 1] - times[0]
        rooms += [float(room), 0.5 * float(times[-1] - times[0])]
    rows = int(min(rooms) * rate * (1.0 + 1e-9))
    while rows >= 1:
        if allowed(overlapped(first, second, rows / rate).curve):
            return rows / rate
        rows = int(OVERLAP_FACTOR * rows)
    raise HdplanError("the limits leave no room for the two motions to overlap")
