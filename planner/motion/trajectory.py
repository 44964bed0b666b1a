"""A joint trajectory: rows of positions, and optionally of times, velocities and accelerations.

They define a curve (`curve`): straight lines between rows of positions; cubics if each row also has its time and
velocities; quintics with accelerations too. The certificate is about this curve, so it is also what must be executed.
Its files, hdplan's or another planner's, are those of `trajectory_files`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.planner.motion.curve import FARTHEST_VALUE, LONGEST, ROW_RATES, SHORTEST, Curve
from hdplan.planner.motion.samples import Samples
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.files import read_file
from hdplan.scenes.job import outputs_of
from hdplan.scenes.output import write_output
from hdplan.scenes.timing import MOST_ROWS
from hdplan.scenes.values import Named, Number, Row, Whole, checked, path_of, text

PARAMETER_ROUNDING = 1e-9  # by which a path parameter may lie beyond its range, for rounding errors
TIMES = "times"
MOST_SAMPLES = 1e7


@dataclass(frozen=True)
class StageMark:
    """The row at which a stage of a job begins."""

    name: str
    row: int  # of the trajectory
    outputs: Mapping[str, bool | float | str] = field(default_factory=dict)  # outputs that are set there, by name


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Waypoints in joint space, and the curve through them; a job's has marks where its stages begin.

    Raises InputError if the shapes do not match, a joint name appears twice, a number is not finite, there are fewer
    than 2 rows, the times do not increase, or there are velocities without times or accelerations without velocities.
    """

    joint_names: tuple[str, ...]  # (n,) the columns
    positions: NDArray[np.float64]  # (N, n) one row per waypoint [rad] or [m]
    locked: Mapping[str, float] = field(default_factory=dict)  # joints that are held -> value [rad] or [m]
    times: NDArray[np.float64] | None = None  # (N,) of the waypoints, increasing [s]; None for a path without times
    velocities: NDArray[np.float64] | None = None  # (N, n) there [rad/s] or [m/s]
    accelerations: NDArray[np.float64] | None = None  # (N, n) there [rad/s²] or [m/s²]
    stages: tuple[StageMark, ...] = ()  # of a job, in order, the first at row 0; each ends where the next one begins

    def __post_init__(self) -> None:
        """Check and freeze."""
        names = checked(Row(text, of="joint names"), self.joint_names, "joint_names")
        positions = _numbers(self.positions, "positions")
        if positions.ndim != 2 or positions.shape[1] != len(names):
            raise InputError(
                f"positions: shape {positions.shape}, expected one row of {len(names)} values per waypoint"
            )
        if len(positions) > MOST_ROWS:
            raise InputError(f"positions: {len(positions)} waypoints, a trajectory has at most {MOST_ROWS}")
        if len(positions) < 2:
            raise InputError(f"positions: {len(positions)} waypoint(s), a trajectory has at least 2")
        if not names:
            raise InputError("joint_names: empty, a trajectory moves at least one joint")
        if repeated := [name for i, name in enumerate(names) if name in names[:i]]:
            raise InputError(f"joint_names: '{repeated[0]}' appears twice")
        _check_finite(positions, "positions", names)
        locked = checked(Named(Number(unit="rad or m")), self.locked, "locked")
        positions.setflags(write=False)
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "locked", locked)
        if self.times is not None:
            object.__setattr__(self, "times", _rising(self.times, len(positions)))
        for key, needed in zip(ROW_RATES, (TIMES, ROW_RATES[0]), strict=True):
            if (values := getattr(self, key)) is None:
                continue
            if getattr(self, needed) is None:
                raise InputError(f"{key}: need {needed}, which are missing")
            values = _numbers(values, key)
            if values.shape != positions.shape:
                raise InputError(f"{key}: shape {values.shape}, expected {positions.shape} as the positions have")
            _check_finite(values, key, names)
            self._check_small(values, key)
            values.setflags(write=False)
            object.__setattr__(self, key, values)

        if self.stages:
            object.__setattr__(self, "stages", _marks(self.stages, len(positions), self.times is not None))

    def _check_small(self, rates: NDArray[np.float64], key: str) -> None:
        """Refuse rates that lead farther than FARTHEST_VALUE within the interval before or after their row."""
        assert self.times is not None
        widths = np.diff(self.times)
        widest = np.maximum(np.r_[widths, 0.0], np.r_[0.0, widths])[:, None]  # on both sides of each row
        most = FARTHEST_VALUE / widest ** (1 + ROW_RATES.index(key))
        if (np.abs(rates) > most).any():
            row, column = (int(i) for i in np.argwhere(np.abs(rates) > most)[0])
            raise InputError(
                f"{key}: waypoint {row}, joint '{self.joint_names[column]}': {rates[row, column]:g} leads too far in "
                f"{widest[row, 0]:g} s; at most {most[row, 0]:.3g} is allowed"
            )

    def __repr__(self) -> str:
        """Return its duration and joints, for display."""
        return f"<Trajectory: {self.extent} of {', '.join(self.joint_names)}>"

    @cached_property
    def curve(self) -> Curve:
        """The motion through the waypoints."""
        return Curve.through(self.positions, self.times, self.velocities, self.accelerations)

    def of_joints(self, names: tuple[str, ...], locked: Mapping[str, float]) -> Trajectory:
        """Return this motion with the columns of these joints only, in that order; raises InputError for a joint
        that it does not have."""
        for name in names:
            if name not in self.joint_names:
                raise InputError(f"joint_names: unknown joint '{name}'{nearest(name, self.joint_names)}")
        chosen = [self.joint_names.index(name) for name in names]
        rates = (None if values is None else values[:, chosen] for values in (self.velocities, self.accelerations))
        velocities, accelerations = rates
        return Trajectory(names, self.positions[:, chosen], locked, self.times, velocities, accelerations, self.stages)

    def between(self, first: int, last: int) -> Trajectory:
        """Return the motion from one row to another, at its own times, without marks of stages."""
        rows = slice(first, last + 1)
        given = (self.times, self.velocities, self.accelerations)
        times, velocities, accelerations = (None if each is None else each[rows] for each in given)
        return Trajectory(self.joint_names, self.positions[rows], self.locked, times, velocities, accelerations)

    @property
    def duration(self) -> float | None:
        """Duration of the motion [s]; None for a path without times."""
        return None if self.times is None else float(self.times[-1] - self.times[0])

    @property
    def extent(self) -> str:
        """Duration or number of waypoints, as text."""
        return f"{len(self)} waypoints" if self.duration is None else f"{self.duration:.3f} s in {len(self)} rows"

    def __len__(self) -> int:
        """Return the number of waypoints."""
        return len(self.positions)

    def at(self, parameter: ArrayLike) -> NDArray[np.float64]:
        """Return the configurations (…, n) at path parameters in [0, 1], over which the waypoints are evenly spaced.

        Raises InputError for other parameters.
        """
        parameters = _numbers(parameter, "parameter")
        within = np.clip(parameters, 0.0, 1.0)
        if not (np.abs(parameters - within) <= PARAMETER_ROUNDING).all():
            raise InputError("parameter: path parameters lie in [0, 1], from the first waypoint to the last")
        return self.curve.at_parameter(within)

    def at_time(self, time: ArrayLike) -> Samples:
        """Return positions, velocities and accelerations at a time [s], or at an array of times (…), counted as `times`
        are. They are those of the executed curve up to rounding, and at a row the row's own to the bit.

        Raises InputError for a path without times, and for times before its first row or after its last.
        """
        if self.times is None:
            raise InputError("trajectory: a path without times has no place at a time; `at` takes path parameters")
        times = _numbers(time, "time")
        first, last = float(self.times[0]), float(self.times[-1])
        within = np.asarray(np.clip(times, first, last))
        if not (np.abs(times - within) <= PARAMETER_ROUNDING).all():
            raise InputError(f"time: must be {first:g} to {last:g} [s], from the first waypoint to the last")
        interval, fraction = self.curve.place_of(within)
        found = (self.curve.over_time(order).at(interval.ravel(), fraction.ravel()) for order in range(3))
        shape = (*within.shape, len(self.joint_names))
        position, velocity, acceleration = (values.reshape(shape) for values in found)
        return Samples(self.joint_names, within, position, velocity, acceleration, self.locked)

    def sampled(self, rate: float) -> Samples:
        """Return the motion at every 1/rate [s] from its beginning on, and at its end: the references of a controller
        that takes `rate` samples a second. Raises InputError as `at_time`, and for more than 10 million samples."""
        rate = checked(Number(above=0.0, unit="1/s"), rate, "rate")
        if self.times is None or self.duration is None:
            return self.at_time(0.0)  # refused
        if not self.duration * rate <= MOST_SAMPLES:
            raise InputError(f"rate: {self.duration * rate:.4g} samples, at most {MOST_SAMPLES:g} are made at once")
        steps = np.arange(math.ceil(self.duration * rate * (1.0 - PARAMETER_ROUNDING)))
        return self.at_time(np.append(self.times[0] + steps / rate, self.times[-1]))

    def stage_at(self, time: float) -> str:
        """Return the name of the stage of a job at a time [s]; where two meet, of the one that begins. Raises
        InputError as `at_time`, and for a motion without stages."""
        if not self.stages or self.times is None:
            raise InputError("trajectory: has no stages, which the motion of a job has")
        now = float(self.at_time(checked(Number(unit="s"), time, "time")).times)
        return [mark.name for mark in self.stages if self.times[mark.row] <= now][-1]

    @property
    def stage_names(self) -> list[str | None]:
        """The stage of a job to which each row belongs; where two meet, the one that begins. None for other motions."""
        if not self.stages:
            return [None] * len(self)
        ends = [*(mark.row for mark in self.stages[1:]), len(self)]
        return [mark.name for mark, end in zip(self.stages, ends, strict=True) for _ in range(mark.row, end)]

    def save(
        self,
        path: str | Path,
        verdict: Mapping[str, Any] | None = None,
        steps: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        """Write to `path`; the file's extension selects the format (`trajectory_files`). The file is written whole or
        not at all.

        JSON also holds the `verdict` and the solver's `steps`. Raises InputError for another extension, a path that
        cannot be written, or a motion that the format cannot hold.
        """
        path = path_of(path)
        about = {key: content for key, content in (("verdict", verdict), ("steps", steps)) if content}
        from hdplan.planner.motion.trajectory_files import WRITERS, format_of

        write = format_of(path, WRITERS)
        with naming(path):
            data = write(self, about)
        write_output(path, data)

    @staticmethod
    def load(path: str | Path) -> Trajectory:
        """Read a trajectory file of any format (`trajectory_files`); raises InputError naming the file and what is
        wrong."""
        path = path_of(path)
        from hdplan.planner.motion.trajectory_files import READERS, format_of

        read = format_of(path, READERS)
        with naming(path):
            return Trajectory(**read(read_file(path)))


def _numbers(values: object, name: str) -> NDArray[np.float64]:
    try:
        numbers = np.array(values)
        if numbers.dtype.kind in "iuf" or not numbers.size:
            return numbers.astype(np.float64)
    except (TypeError, ValueError):  # rows of different lengths
        pass
    raise InputError(f"{name}: numbers are expected, the same number of them in each row")


def _marks(value: object, rows: int, timed: bool) -> tuple[StageMark, ...]:
    """Return the marks of stages, if each begins at a later row than the one before."""
    if not timed:
        raise InputError("stages: need times, which are missing")
    found: list[StageMark] = []
    for i, mark in enumerate(value if isinstance(value, list | tuple) else (None,)):
        if isinstance(mark, Mapping) and {"name", "row"} <= mark.keys() <= {"name", "row", "outputs"}:
            mark = StageMark(mark["name"], mark["row"], mark.get("outputs", {}))
        if not isinstance(mark, StageMark):
            raise InputError(f"stages[{i}]: a name and a row are expected, and maybe outputs")
        name = checked(text, mark.name, f"stages[{i}].name")
        row = checked(Whole(found[-1].row + 1 if found else 0, rows - 2 if found else 0), mark.row, f"stages[{i}].row")
        outputs = checked(outputs_of, mark.outputs, f"stages[{i}].outputs") if mark.outputs != {} else {}
        found.append(StageMark(name, row, outputs))
    return tuple(found)


def _check_finite(values: NDArray[np.float64], key: str, names: tuple[str, ...]) -> None:
    if not np.isfinite(values).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
        raise InputError(
            f"{key}: waypoint {row}, joint '{names[column]}': {values[row, column]} is not a finite number"
        )


def _rising(values: object, count: int) -> NDArray[np.float64]:
    """Return the times (count,), frozen, if there are that many and they increase."""
    times = _numbers(values, "times")
    if times.shape != (count,):
        raise InputError(f"times: shape {times.shape}, expected one for each of the {count} waypoints")
    if not np.isfinite(times).all():
        raise InputError(f"times: {times[~np.isfinite(times)][0]} is not a finite number")
    if not np.abs(times).max() <= LONGEST:
        raise InputError(
            f"times: {times[np.abs(times).argmax()]:g} s is too far from 0; at most {LONGEST:g} s are allowed"
        )
    if (np.diff(times) <= 0.0).any():
        row = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise InputError(
            f"times: {times[row]:g} s at waypoint {row} comes after {times[row - 1]:g} s, times must increase"
        )
    if not np.diff(times).min() >= SHORTEST:
        row = int(np.diff(times).argmin())
        raise InputError(
            f"times: {np.diff(times)[row]:g} s between waypoints {row} and {row + 1} is too short; "
            f"at least {SHORTEST:g} s are needed"
        )
    times.setflags(write=False)
    return times
