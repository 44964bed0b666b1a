"""A warm start: any motion of the robot becomes the first guess of a problem."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.motion.robot_curve import beyond_limits, curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.arrays import as_numbers
from hdplan.scenes.errors import FieldError, InputError, naming
from hdplan.scenes.values import describe

if TYPE_CHECKING:
    from hdplan.planner.problem.problem import Problem

MOVED = 1e-6  # [rad] or [m] above which a note says that the guess's ends were moved


def rows_of(guess: Trajectory | ArrayLike, robot: Robot) -> Array:
    """Return the waypoints (R, n) of a guess in the order of the robot's joints, which those of an array have. Raises
    InputError for joints that are missing, unknown or locked elsewhere, or leave their limits, and for anything but a
    motion or rows of numbers."""
    motion = guess if isinstance(guess, Trajectory) else _motion_of(guess, robot)
    with naming("guess"):
        curve = curve_of(robot, motion)
        if beyond := beyond_limits(curve, robot):
            raise InputError(f"trajectory: {beyond}")
    return curve.rows


def _motion_of(guess: ArrayLike, robot: Robot) -> Trajectory:
    rows = as_numbers(guess)
    if rows is None or rows.ndim != 2 or rows.shape[1] != robot.n or len(rows) < 2:
        wanted = f"a Trajectory, or waypoints by joints of {robot.name} (two or more, {robot.n})"
        raise FieldError(f"must be {wanted}, found {describe(guess)}", "guess")
    with naming("guess"):
        return Trajectory(robot.joint_names, rows, robot.locked)


def begun_at(rows: Array, start: Array, robot: Robot) -> Array:
    """Return the waypoints (R, n) with joints without limits turned whole, so that they begin nearest to a start."""
    moved: Array = rows + (robot.nearest_turn(rows[0], start) - rows[0])
    return moved


def warm_start(problem: Problem, rows: Array, timed: bool) -> tuple[Array, float]:
    """Return the guess (N, n) that a motion of `rows` (R, n) makes, and how far its ends were moved [rad or m].

    The waypoints of a path are taken as they are if the problem has as many, or else at equal steps of the path
    parameter; those of a timed motion, which crowd where it is slow, at equal steps of length. Then both ends are moved
    to the problem's, and the waypoints between along with them, the less the farther away.
    """
    count = problem.waypoints
    if timed:
        at = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(rows, axis=0), axis=1)))
    else:
        at = np.linspace(0.0, 1.0, len(rows))
    if len(rows) != count or timed:
        wanted = np.linspace(0.0, at[-1], count)
        rows = np.stack([np.interp(wanted, at, column) for column in rows.T], axis=1)
    to_start, to_goal = problem.start - rows[0], problem.goal - rows[-1]
    share = np.linspace(0.0, 1.0, count)[:, None]
    moved = rows + (1.0 - share) * to_start + share * to_goal
    return problem.clip(moved), float(max(np.abs(to_start).max(), np.abs(to_goal).max()))


def waypoints_of(problem: Problem, guess: Trajectory) -> Array:
    """Return the waypoints (N, n) that a motion gives a problem. Raises InputError as `rows_of`."""
    rows = begun_at(rows_of(guess, problem.robot), problem.start, problem.robot)
    return warm_start(problem, rows, guess.times is not None)[0]
