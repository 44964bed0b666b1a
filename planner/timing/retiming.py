"""Retiming: a smooth curve along a planned path, and a time law on it.

Waypoints and the scene's limits -> a `Trajectory` with times, velocities and accelerations; the quintics between its
rows are executed and certified.

*The path.* A polyline has corners, at which a robot has to stop. The path is the cubic B-spline with as many control
points as waypoints, each on the polyline at its Greville abscissa (Schoenberg's variation diminishing approximation):
twice differentiable, with the polyline's ends, and within its hull, so within the joint limits.

*The time law* (`time_laws`). The fastest one within the limits but jerk (`time_optimal`) is averaged over a window of
whole rows, then stretched in time until every limit holds on the executed curve (`limits`), which takes one look, as a
stretch changes no shape, except for the rounding of its rows: that is examined last. Of several windows the one with
the shortest motion is chosen. With `timing.duration` it is the minimum-jerk law; only if that violates a limit and no
obstacle moves, it is the fastest law, stretched to the duration.

*Ends.* All of this is from rest to rest; a start or a goal through which the robot moves is joined to it
(`moving_ends`).
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from hdplan.planner.motion.curve import Curve, row_count
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Query, Setup
from hdplan.planner.timing.duration_slope import SlopedLimit, duration_slope
from hdplan.planner.timing.least_time import least_time, least_times
from hdplan.planner.timing.limits import MARGIN, RateLimit, TimingLimit, timing_limits
from hdplan.planner.timing.path_spline import PathSpline, smooth
from hdplan.planner.timing.time_laws import Averaged, MinimumJerk, Stepwise, TimeLaw
from hdplan.planner.timing.time_optimal import GRID, OnGrid, grid, time_optimal
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.timing import MOST_ROWS, Timing

if TYPE_CHECKING:
    from hdplan.planner.timing.moving_ends import MovingEnds


FEWEST_ROWS, FEWEST_PARTS = 1, 4  # in the narrowest window; beside the window
WINDOWS, GAIN = 8, 3e-3  # that are tried at most; relative gain for which one is
SMALL_STRETCH = 1e-3  # relative stretch of a motion for which its window is wide enough
LARGE_STRETCH = 0.1  # relative stretch of a motion that has other causes than its window
REFINEMENTS = 5  # times that a motion, stretched, gets more rows
ROUNDINGS = 8  # stretches at most, for the rounding of rows
LIMIT_INSET = 1e-4  # [rad] or [m] from the joint limits
LEAST_TRAVEL = 1e-9  # [rad] or [m] a path with less travel leads nowhere


Rows = tuple[Array, Array, Array]  # positions, velocities and accelerations (rows, n)


class Timed(NamedTuple):
    """A motion with times."""

    trajectory: Trajectory
    parameter: Array  # (rows,) where each row is on the planned path, 0 to 1

    def place_of(self, wanted: float) -> tuple[int, float]:
        """Return the interval between rows that holds a place on the planned path, and the fraction of it."""
        row = int(np.clip(np.searchsorted(self.parameter, wanted, side="right") - 1, 0, len(self.parameter) - 2))
        begins, ends = self.parameter[row : row + 2]
        return row, float((wanted - begins) / (ends - begins)) if ends > begins else 0.0


class Quickest(NamedTuple):
    """A law along a path, how long it takes [s], and in how many rows."""

    law: TimeLaw
    duration: float
    rows: int
    stretch: float = 1.0  # of the law, which the duration includes


class Retimer:
    """Gives times to the paths of one scene."""

    def __init__(self, setup: Setup, meets: Callable[[Trajectory], str] = lambda _: "") -> None:
        """Resolve the limits; `meets` says what a motion meets on its way, or nothing, where a robot that moves has to
        brake. Raises InputError for limits that do not match the robot, and a robot that cannot brake within them."""
        scene = setup.scene
        self.robot, self.timing, self.source = setup.robot, scene.timing or Timing(), scene.source
        self.fixed = bool(scene.moving)  # the planner assumed the minimum-jerk law to avoid them
        self.limits = timing_limits(setup)
        self.rates = setup.limits
        self.unbounded = scene.limits.acceleration is None  # so that there is no fastest motion
        self.rate = self.timing.rate
        self.shares = np.ones(GRID + 1)  # of the speed, along a path
        self.ends: MovingEnds | None = None
        if setup.moving_ends:
            from hdplan.planner.timing.moving_ends import MovingEnds

            self.ends = MovingEnds(setup, self.limits, meets)
            self.rate = self.ends.rate

    def with_limit(self, limit: TimingLimit) -> Retimer:
        """Return a copy with one more limit."""
        found = copy.copy(self)
        found.limits = (*self.limits, limit)
        return found

    def with_speeds(self, speeds: Array, changes: Array, first: float = 0.0, last: float = 1.0) -> Retimer:
        """Return a copy for the part from `first` to `last` of a path on which stages (k,) are driven at shares of
        the speed; at `changes` (k - 1,) of the path the next one begins. Accelerations are less by the squares of the
        shares, as in a motion that is slowed."""
        found = copy.copy(self)
        found.shares = speeds[np.searchsorted(changes, first + grid() * (last - first), side="right")]
        return found

    def standing(self, query: Query) -> Query:
        """Return the ends of the path that is timed: where the robot would stand, if it does not at the scene's."""
        return query if self.ends is None else self.ends.standing(query)

    def shortest(self, start: Array, goal: Array) -> float:
        """A time [s] that no motion between two configurations (n,) undercuts, within limits of rates."""
        return least_time(goal - start, self.rates)

    def quickest_along(self, path: Array) -> float:
        """The time [s] of the fastest law along waypoints (N, n), regardless of its jerk; ∞ where there is none."""
        if np.ptp(path, axis=0).max() < LEAST_TRAVEL:
            return 0.0
        try:
            return float(self._time_optimal(smooth(self._inset(path))).knots[-1]) / self.timing.scale
        except HdplanError:
            return math.inf

    @property
    def slopes_known(self) -> bool:
        """True if it is known how the fastest law's limits change with a path."""
        return all(isinstance(limit, SlopedLimit) for limit in self.limits)

    def slope_along(self, path: Array) -> tuple[float, Array]:
        """The time of `quickest_along`, but ∞ where gravity alone is too much, and its derivative (N, n) by the
        waypoints. Only where `slopes_known`."""
        within = self._inset(path)
        known = [limit for limit in self.limits if isinstance(limit, SlopedLimit) and limit.in_law]
        try:
            duration, slope = duration_slope(within, known)
        except HdplanError:
            return math.inf, np.zeros_like(path)
        return duration / self.timing.scale, slope * (within == path) / self.timing.scale

    def too_short(self, start: Array, goal: Array) -> str | None:
        """Return the reason why no motion between two configurations (n,) at rest is as short as the scene's duration;
        None if one may."""
        if self.timing.duration is None or self.ends is not None:
            return None
        least = least_times(goal - start, self.rates)
        joint = int(least.argmax())
        if least[joint] <= self.timing.duration:
            return None
        return (
            f"timing.duration: {self.timing.duration:g} s, but joint '{self.robot.joint_names[joint]}' alone needs at "
            f"least {least[joint]:.3g} s from start to goal"
        )

    def __call__(self, path: Trajectory) -> Timed:
        """Return the timed motion along a path; with a fixed duration even if the limits do not hold."""
        return next(self.ways(path))

    def along(self, path: Trajectory, spline: PathSpline) -> Timed:
        """Return the quickest motion from rest to rest along a spline over [0, 1] that is drawn through a path."""
        return self._rounded(path, spline, self._quickest(path, spline))

    def ways(self, path: Trajectory, than: float = math.inf) -> Iterator[Timed]:
        """Yield the timed motion along a path, unless it takes `than` [s] or longer; where the robot does not begin and
        end at rest, the path leads from where it would stand, and the motion, however long, is first the quickest, and
        then the one that does stand there."""
        if self.ends is None:
            timed = self._from_rest(path, self.timing.duration, than)
            if timed is not None:
                yield timed
            return
        of_rows, least = self._of_rows(path)
        *overlaps, apart = self.ends.overlaps(least)
        joined = (self._joined(of_rows(count), lead, trail) for lead, count, trail in overlaps)
        yield from itertools.islice((each for each in joined if self.ends.keeps(_rows_of(each.trajectory))), 1)
        lead, count, trail = apart
        yield self._joined(of_rows(count), lead, trail)

    def _of_rows(self, path: Trajectory) -> tuple[Callable[[int], Timed], int]:
        """Return the timing of a path, from rest to rest, in so many intervals between rows, and the least number of
        them; 0 where the scene's duration says how many there are."""
        if self.timing.duration is not None:
            return lambda count: cast(Timed, self._from_rest(path, count / self.rate)), 0
        spline = smooth(self._inset(path.positions))
        law, duration, *_ = self._quickest(path, spline)
        least = row_count(duration, self.rate) - 1
        while self._stretch(self._curve(spline, law, least / self.rate, least + 1)) > 1.0:
            least += 1
            self._check_rows(least / self.rate)
        return lambda count: self._timed(path, spline, law, count / self.rate), least

    def _joined(self, own: Timed, lead: int, trail: int) -> Timed:
        """Return a motion from rest to rest, joined to the scene's ends with so many rows before and after."""
        assert self.ends is not None
        rows, path = self.ends.joined(_rows_of(own.trajectory), lead, trail), own.trajectory
        count = len(rows[0])
        self._check_rows((count - 1) / self.rate)
        parameter = np.pad(own.parameter, (lead, count - lead - len(own.parameter)), mode="edge")
        times = np.arange(count) / self.rate
        return Timed(Trajectory(path.joint_names, rows[0], path.locked, times, rows[1], rows[2]), parameter)

    def _from_rest(self, path: Trajectory, duration: float | None, than: float = math.inf) -> Timed | None:
        """Return the timed motion along a path from rest to rest; None, most often sooner, if it takes `than` [s] or
        longer, where it has no duration."""
        spline = smooth(self._inset(path.positions))
        if duration is not None:
            even = self._timed(path, spline, MinimumJerk(duration), duration)
            if self.fixed or self.unbounded or self._stretch(even.trajectory.curve) <= 1.0:
                return even
            if not _stands(path):
                fastest = self._quickest(path, spline)
                return self._timed(path, spline, fastest.law, duration, fastest.rows)
        quickest = self._quickest(path, spline, than)
        return None if quickest.duration >= than else self._rounded(path, spline, quickest)

    def _quickest(self, path: Trajectory, spline: PathSpline, than: float = math.inf) -> Quickest:
        """Return the law of the quickest motion along a path, from rest to rest, with its duration and its rows; an
        infinite duration where its fastest law alone takes `than` [s] or longer."""
        if _stands(path):
            return Quickest(MinimumJerk(1.0 / self.rate), 1.0 / self.rate, 2)
        law, most = self._time_optimal(spline), than * self.timing.scale
        if law.duration + FEWEST_ROWS / self.rate >= most:
            return Quickest(MinimumJerk(math.inf), math.inf, 0)
        found = self._windowed(spline, law)
        if not math.isfinite(found.duration):
            raise HdplanError("no time law was found within the limits on the executed curve")
        duration = found.duration / self.timing.scale
        self._check_rows(duration)
        return found._replace(duration=duration)

    def _inset(self, waypoints: Array) -> Array:
        """Keep the inner waypoints LIMIT_INSET away from the joint limits: between rows, quintics deviate from the path
        by less."""
        result = np.clip(waypoints, self.robot.inner[0] + LIMIT_INSET, self.robot.inner[1] - LIMIT_INSET)
        result[0], result[-1] = waypoints[0], waypoints[-1]
        return result

    def _timed(
        self, path: Trajectory, spline: PathSpline, law: TimeLaw, duration: float, count: int | None = None
    ) -> Timed:
        """Return the motion with a law stretched to a duration, in as few rows as the rate allows; or as the curve that
        is executed in `count` rows, in these or, where they are too few, whole parts of what is between them."""
        self._check_rows(duration)
        fewest = row_count(duration, self.rate)
        count = fewest if count is None else count
        parameter, rows = _rows(spline, law, duration, count)
        parts = -(-(fewest - 1) // (count - 1))
        self._check_rows(duration, parts * (count - 1.0))
        if parts > 1:
            parameter, rows = _divided(parameter, rows, duration, parts)
        times = duration * np.linspace(0.0, 1.0, len(parameter))
        return Timed(Trajectory(path.joint_names, rows[0], path.locked, times, rows[1], rows[2]), parameter)

    def _rounded(self, path: Trajectory, spline: PathSpline, quickest: Quickest) -> Timed:
        """Return the motion with a law, stretched a little further where its rows, as they are rounded, exceed a limit
        of rates: a rounding e of a position makes a jerk of some 60 e/h³ between rows h apart, which no stretch takes
        away."""
        law, duration, count, _ = quickest
        for _ in range(ROUNDINGS):
            timed = self._timed(path, spline, law, duration, count)
            over = max(each.stretch(timed.trajectory.curve) for each in self.limits if isinstance(each, RateLimit))
            if over <= 1.0 + 0.1 * MARGIN:
                return timed
            duration *= over
        raise HdplanError(
            f"{self.source}: timing.rate: {self.rate:g} rows a second are so close that their rounding alone exceeds "
            "the scene's limits: give a lower rate"
        )

    def _windowed(self, spline: PathSpline, law: Stepwise) -> Quickest:
        """Return the shortest motion of those with a few windows. The stretch that the narrowest needs calls for a
        wider one, if it is for the law's jerk, which falls with the window. What follows is wider, where the motion is
        stretched, or else narrower, as long as that may gain much: no motion is shorter than its law and its window.
        Where it is stretched much, and a wider window does not help, it was too wide. At last a window lies between two
        numbers of rows, with more rows to it."""
        parts, row = math.ceil(law.duration * self.rate - 1e-9), 1.0 / self.rate
        self._check_rows(law.duration)
        narrow, stretch = self._stretched(spline, law, FEWEST_ROWS, max(parts, FEWEST_PARTS))
        widest = (narrow.duration - law.duration) * self.rate
        if not math.isfinite(widest):
            raise HdplanError("no time law was found within the limits on the executed curve")
        window = max(round(min(FEWEST_ROWS * stretch**3, widest)), FEWEST_ROWS)
        found, turned = self._averaged(spline, law, window, row), False
        for _ in range(WINDOWS):
            wider = found.stretch > 1.0 + SMALL_STRETCH and not turned
            step = max(window // (2 if turned else 4), 1)
            other = window + (step if wider else -step)
            least = law.duration + (window + (0.25 if wider else -0.75) * step) * row
            if other < FEWEST_ROWS or found.duration <= (1.0 + GAIN) * least:
                break
            next_ = self._averaged(spline, law, other, row)
            if next_.duration < found.duration or math.isinf(found.duration):
                window, found = other, next_
            elif wider and found.stretch > 1.0 + LARGE_STRETCH:
                turned = True
            else:
                between = 0.5 * (window + other) / max(window, other) * row
                next_ = self._averaged(spline, law, max(window, other), between)
                found = next_ if next_.duration <= (1.0 - GAIN) * found.duration else found
                break
        return min(found, narrow, key=lambda each: each.duration)

    def _averaged(self, spline: PathSpline, law: Stepwise, window: int, row: float) -> Quickest:
        """Return the motion with a law averaged over a window, in rows of it, stretched as far as the limits on the
        executed curve need; rows lie `row` apart, or closer, so that they still do where they are stretched, if that
        has an end: a law that is quick where the path turns back is stretched more, the closer its rows lie."""
        parts, shortest = max(math.ceil(law.duration / row - 1e-9), FEWEST_PARTS), None
        for _ in range(REFINEMENTS):
            if parts + window > MOST_ROWS:
                break
            found, stretch = self._stretched(spline, law, window, parts)
            if stretch * law.duration <= (1.0 + 1e-12) * parts * row:
                return found
            if not math.isfinite(stretch):
                break
            if shortest is None or found.duration < shortest.duration:
                shortest = found
            parts = max(math.ceil(stretch * law.duration / row - 1e-9), parts + 1)
        return Quickest(Averaged(law, 0.5), math.inf, 0) if shortest is None else shortest

    def _stretched(self, spline: PathSpline, law: Stepwise, window: int, parts: int) -> tuple[Quickest, float]:
        """Return the motion with a law of so many parts averaged over a window of so many more, and its stretch."""
        count, whole = parts + window + 1, law.duration * (parts + window) / parts
        averaged = Averaged(law, window / (count - 1))
        stretch = max(self._stretch(self._curve(spline, averaged, whole, count)), law.duration / whole)
        return Quickest(averaged, stretch * whole, count, stretch), stretch

    def _curve(self, spline: PathSpline, law: TimeLaw, duration: float, count: int) -> Curve:
        """Return the executed curve of a law stretched to a duration, in so many rows."""
        _, values = _rows(spline, law, duration, count)
        return Curve.through(values[0], duration * np.linspace(0.0, 1.0, count), values[1], values[2])

    def _time_optimal(self, spline: PathSpline) -> Stepwise:
        """Return the fastest law within the limits that it knows."""
        path = OnGrid.of(spline)
        parts = [rows for limit in self.limits if (rows := limit.rows(path)) is not None]
        squares = self.shares[:, None] ** 2  # a ü + b u̇² ≤ s² c: u̇/s and ü/s² keep the limit
        return time_optimal([rows._replace(c=squares * rows.c) for rows in parts])

    def _check_rows(self, duration: float, rows: float = 0.0) -> None:
        """Refuse a motion with more rows than are allowed, those that the rate requires or more, before computing
        them."""
        rate, rows = self.rate, max(rows, duration * self.rate)
        if not rows < MOST_ROWS:
            raise InputError(
                f"{self.source}: limits: within them this motion takes {duration:.4g} s, which at a rate of {rate:g} "
                f"1/s (timing.rate) makes {rows:.4g} rows; at most {MOST_ROWS} are allowed: give a lower "
                "rate, or wider limits"
            )

    def _stretch(self, curve: Curve) -> float:
        """Return by how much an executed curve must be stretched for its limits to hold; at most 1 if they do."""
        return max(limit.stretch(curve) for limit in self.limits)


def _stands(path: Trajectory) -> bool:
    """True if a path leads nowhere."""
    return bool(np.ptp(path.positions, axis=0).max() < LEAST_TRAVEL)


def _rows_of(trajectory: Trajectory) -> Rows:
    assert trajectory.velocities is not None
    assert trajectory.accelerations is not None
    return trajectory.positions, trajectory.velocities, trajectory.accelerations


def _rows(spline: PathSpline, law: TimeLaw, duration: float, count: int) -> tuple[Array, Rows]:
    """Return parameters (count,) and positions, velocities, accelerations (count, n) of a law stretched to a
    duration."""
    u, first, second = law.rows(count)
    u = np.maximum.accumulate(np.clip(u, 0.0, 1.0))
    u[0], u[-1] = 0.0, 1.0  # to the last bit: the motion ends where its path does, at rest
    first[[0, -1]] = second[[0, -1]] = 0.0
    first, second = first[:, None] / duration, second[:, None] / duration**2
    slope, curvature = spline(u, 1), spline(u, 2)
    return u, (spline(u), slope * first, curvature * first**2 + slope * second)


def _divided(parameter: Array, rows: Rows, duration: float, parts: int) -> tuple[Array, Rows]:
    """Return more rows of the same curve, which divide each interval into so many parts."""
    count = len(parameter) - 1
    curve = Curve.through(rows[0], duration * np.linspace(0.0, 1.0, count + 1), *rows[1:])
    interval, fraction = np.repeat(np.arange(count), parts), np.tile(np.arange(parts) / parts, count)
    within = (curve.over_time(order).at(interval, fraction) for order in range(3))
    first, second, third = (np.vstack([new, old[-1:]]) for new, old in zip(within, rows, strict=True))
    places = np.interp(np.linspace(0.0, count, count * parts + 1), np.arange(count + 1), parameter)
    return places, (first, second, third)
