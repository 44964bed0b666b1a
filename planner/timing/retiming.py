"""Retiming: a smooth curve along a planned path, and a time law on it.

Waypoints and the scene's limits -> a `Trajectory` with times, velocities and accelerations; the quintics between its
rows are executed and certified.

*The path.* A polyline has corners, at which a robot has to stop. The path is the cubic B-spline with as many control
points as waypoints, each on the polyline at its Greville abscissa (Schoenberg's variation diminishing approximation):
twice differentiable, with the polyline's ends, and within its hull, so within the joint limits.

*The time law* (`time_laws`). The fastest one within the limits but jerk (`time_optimal`) is averaged over a window,
then stretched in time until every limit holds on the executed curve (`limits`). Of several windows the one with the
shortest motion is chosen. With `timing.duration` it is the minimum-jerk law; only if that violates a limit and no
obstacle moves, it is the fastest law, stretched to the duration.

*Ends.* All of this is from rest to rest; a start or a goal through which the robot moves is joined to it
(`moving_ends`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple, cast, overload

import numpy as np

from hdplan.planner.motion.curve import Curve, row_count
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Query, Setup
from hdplan.planner.timing.least_time import least_time, least_times
from hdplan.planner.timing.limits import PathSamples, timing_limits
from hdplan.planner.timing.path_spline import PathSpline
from hdplan.planner.timing.time_laws import Averaged, MinimumJerk, Stepwise, TimeLaw
from hdplan.planner.timing.time_optimal import time_optimal
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.timing import MOST_ROWS, Timing

if TYPE_CHECKING:
    from hdplan.planner.timing.moving_ends import MovingEnds


WINDOWS = 20  # lengths of the averaging window that are tried
FIRST_TRIED = 3  # the first of so many are tried at first
LEAST_WINDOW, MOST_WINDOW = 0.01, 1.0  # [–] of the fastest motion's duration
FEWEST_ROWS = 2  # in a window
SAMPLES = 400  # of a law, to compare windows
STRETCHES = 20  # at most, each a little longer than needed
TRIED = 8  # shorter durations that are tried
TIGHT_STRETCH = 0.99  # [–] a motion that needs a greater stretch than this is not shortened further
INSET = 1e-4  # [rad] or [m] from the joint limits
STANDS = 1e-9  # [rad] or [m] a path with less travel leads nowhere


class Timed(NamedTuple):
    """A motion with times."""

    trajectory: Trajectory
    parameter: Array  # (rows,) where each row is on the planned path, 0 to 1

    def place_of(self, wanted: float) -> tuple[int, float]:
        """Return the interval between rows that holds a place on the planned path, and the fraction of it."""
        row = int(np.clip(np.searchsorted(self.parameter, wanted, side="right") - 1, 0, len(self.parameter) - 2))
        begins, ends = self.parameter[row : row + 2]
        return row, float((wanted - begins) / (ends - begins))


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
        self.ends: MovingEnds | None = None
        if setup.moving_ends:
            from hdplan.planner.timing.moving_ends import MovingEnds

            self.ends = MovingEnds(setup, self.limits, meets)
            self.rate = self.ends.rate

    def standing(self, query: Query) -> Query:
        """Return the ends of the path that is timed: where the robot would stand, if it does not at the scene's."""
        return query if self.ends is None else self.ends.standing(query)

    def shortest(self, start: Array, goal: Array) -> float:
        """A time [s] that no motion between two configurations (n,) undercuts, within limits of rates."""
        return least_time(goal - start, self.rates)

    def quickest_along(self, path: Array) -> float:
        """The time [s] of the fastest law along waypoints (N, n), whatever its jerk; ∞ where there is none."""
        if np.ptp(path, axis=0).max() < STANDS:
            return 0.0
        try:
            return float(self._time_optimal(smooth(self._inset(path))).knots[-1]) / self.timing.scale
        except HdplanError:
            return math.inf

    def too_short(self, start: Array, goal: Array) -> str | None:
        """Say why no motion between two configurations (n,) at rest is as short as the scene's duration; None if one
        may."""
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
        law, duration = self._quickest(path, spline)
        return self._timed(path, spline, law, duration)

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
        """Return what times a path, from rest to rest, in so many intervals between rows, and the least number of them;
        0 where the scene's duration says how many there are."""
        if self.timing.duration is not None:
            return lambda count: cast(Timed, self._from_rest(path, count / self.rate)), 0
        spline = smooth(self._inset(path.positions))
        law, duration = self._quickest(path, spline)
        return lambda count: self._timed(path, spline, law, count / self.rate), row_count(duration, self.rate) - 1

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
                return self._timed(path, spline, self._laws(spline, math.inf)[0][1], duration)
        law, duration = self._quickest(path, spline, than)
        return None if law is None else self._timed(path, spline, law, duration)

    @overload
    def _quickest(self, path: Trajectory, spline: PathSpline) -> tuple[TimeLaw, float]: ...

    @overload
    def _quickest(self, path: Trajectory, spline: PathSpline, than: float) -> tuple[TimeLaw | None, float]: ...

    def _quickest(self, path: Trajectory, spline: PathSpline, than: float = math.inf) -> tuple[TimeLaw | None, float]:
        """Return the law of the quickest motion along a path, from rest to rest, and its duration; no law if it takes
        `than` [s] or longer."""
        if _stands(path):
            return MinimumJerk(1.0 / self.rate), 1.0 / self.rate
        most = than * self.timing.scale
        law, duration = self._fastest(spline, self._laws(spline, most), most)
        return law if duration < most else None, duration / self.timing.scale

    def _inset(self, waypoints: Array) -> Array:
        """Keep the inner waypoints INSET away from the joint limits: between rows, quintics deviate from the path by
        less."""
        result = np.clip(waypoints, self.robot.inner[0] + INSET, self.robot.inner[1] - INSET)
        result[0], result[-1] = waypoints[0], waypoints[-1]
        return result

    def _timed(self, path: Trajectory, spline: PathSpline, law: TimeLaw, duration: float) -> Timed:
        """Return the motion with a law stretched to a duration."""
        self._check_rows(duration)
        times, parameter, rows = _rows(spline, law, duration, self.rate)
        return Timed(Trajectory(path.joint_names, rows[0], path.locked, times, rows[1], rows[2]), parameter)

    def _fastest(
        self, spline: PathSpline, laws: list[tuple[float, Averaged]], most: float
    ) -> tuple[Averaged | None, float]:
        """Return the law that is shortest on the executed curve, and its duration there; no law if at samples all take
        `most` or longer.

        The quintics between rows exceed a jerk that changes within a row, by more or less as the rows happen to lie: a
        longer window may make a shorter motion, and so may a few rows less.
        """
        fastest, least, best = None, 0.0, np.inf
        for shortest, law in laws:
            if shortest >= min(best, most):
                break
            duration = self._allowed(spline, law, shortest)
            if duration < best:
                fastest, least, best = law, shortest, duration
        if fastest is None:
            return None, best
        tried = np.unique(np.ceil(np.linspace(least, best, TRIED, endpoint=False) * self.rate)) / self.rate
        shorter = (time for time in tried.tolist() if time < best and self._executed(spline, fastest, time) <= 1.0)
        return fastest, next(shorter, best)

    def _laws(self, spline: PathSpline, most: float) -> list[tuple[float, Averaged]]:
        """Return laws with windows of several lengths, each with its duration once it is stretched to the limits; the
        shortest first. Empty where the fastest law of all takes `most` or longer."""
        law, shortest = self._time_optimal(spline), FEWEST_ROWS / self.rate
        if law.knots[-1] + shortest >= most:
            return []
        tried = np.maximum(law.knots[-1] * np.geomspace(LEAST_WINDOW, MOST_WINDOW, WINDOWS), shortest)
        laws = [Averaged(law, float(window)) for window in np.unique(tried)]
        found: dict[int, float] = {}
        chosen = set(range(0, len(laws), FIRST_TRIED))
        while missing := sorted(chosen - set(found)):  # few of them at first, then those between the best ones
            found |= zip(missing, self._durations_at_samples(spline, [laws[i] for i in missing]), strict=True)
            best = min(found, key=found.__getitem__)
            chosen = set(range(max(best - FIRST_TRIED + 1, 0), min(best + FIRST_TRIED, len(laws))))
        return [(found[i], laws[i]) for i in sorted(found, key=found.__getitem__)]

    def _time_optimal(self, spline: PathSpline) -> Stepwise:
        """Return the fastest law within the limits that it knows."""
        asked = [limit.rows(spline) for limit in self.limits]
        return time_optimal([rows for rows in asked if rows is not None])

    def _durations_at_samples(self, spline: PathSpline, laws: list[Averaged]) -> list[float]:
        """Return the duration to which each law must be stretched for the limits to hold at SAMPLES times."""
        share = np.linspace(0.0, 1.0, SAMPLES)
        u, *rates = np.concatenate([law(law.duration * share) for law in laws], axis=1)
        first, second, third = (rate[:, None] for rate in rates)
        slope, bend, twist = (spline(u, order) for order in (1, 2, 3))
        samples = PathSamples(spline, u, (slope, bend, twist), (first, second, third))
        stretch = np.max([limit.stretch_of_law(samples) for limit in self.limits], axis=0)
        longest = stretch.reshape(len(laws), SAMPLES).max(axis=1).tolist()
        return [law.duration * most for law, most in zip(laws, longest, strict=True)]

    def _allowed(self, spline: PathSpline, law: TimeLaw, duration: float) -> float:
        """Return a duration, in whole rows, for which the limits hold all along the executed curve, and hardly longer
        than needed; from one at which they hold at samples."""
        best = np.inf
        for _ in range(STRETCHES):
            self._check_rows(duration)
            duration = (row_count(duration, self.rate) - 1) / self.rate
            if duration >= best:
                break
            stretch = self._executed(spline, law, duration)
            if stretch <= 1.0:
                best = duration
                if stretch > TIGHT_STRETCH:
                    break
            duration *= stretch
        if not np.isfinite(best):
            raise HdplanError("no time law was found within the limits on the executed curve")
        return best

    def _executed(self, spline: PathSpline, law: TimeLaw, duration: float) -> float:
        """Return by how much a law stretched to a duration must be stretched further for its limits to hold."""
        times, _, rows = _rows(spline, law, duration, self.rate)
        return self._stretch(Curve.through(rows[0], times, rows[1], rows[2]))

    def _check_rows(self, duration: float) -> None:
        """Refuse a motion with more rows than are allowed, before computing them."""
        rate = self.rate
        if not duration * rate <= MOST_ROWS:
            raise InputError(
                f"{self.source}: limits: within them this motion takes {duration:.4g} s, which at a rate of {rate:g} "
                f"1/s (timing.rate) makes {duration * rate:.4g} rows; at most {MOST_ROWS} are allowed: give a lower "
                "rate, or wider limits"
            )

    def _stretch(self, curve: Curve) -> float:
        """Return by how much an executed curve must be stretched for its limits to hold; at most 1 if they do."""
        return max(limit.stretch(curve) for limit in self.limits)


def _stands(path: Trajectory) -> bool:
    """True if a path leads nowhere."""
    return bool(np.ptp(path.positions, axis=0).max() < STANDS)


def _rows_of(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    assert trajectory.velocities is not None
    assert trajectory.accelerations is not None
    return trajectory.positions, trajectory.velocities, trajectory.accelerations


def smooth(waypoints: Array) -> PathSpline:
    """Return the B-spline over [0, 1] with control points on the polyline of waypoints (N, n); see the module's
    docstring."""
    count, degree = len(waypoints), min(3, len(waypoints) - 1)
    inner = np.linspace(0.0, 1.0, count - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.ones(degree)])
    greville = np.array([knots[i + 1 : i + degree + 1].mean() for i in range(count)])
    even = np.linspace(0.0, 1.0, count)
    control = np.stack([np.interp(greville, even, column) for column in waypoints.T], axis=1)
    return PathSpline(knots, control, degree)


def _rows(
    spline: PathSpline, law: TimeLaw, duration: float, rate: float
) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Return times, parameters (rows,) and positions, velocities, accelerations (rows, n) of a law stretched to a
    duration."""
    count = row_count(duration, rate)
    share = np.linspace(0.0, 1.0, count)
    stretch = duration / law.duration
    u, first, second, _ = law(share * law.duration)
    u = np.clip(u, 0.0, 1.0)
    u[0], u[-1] = 0.0, 1.0  # to the last bit: the motion ends where its path does
    first, second = first[:, None] / stretch, second[:, None] / stretch**2
    slope, bend = spline(u, 1), spline(u, 2)
    return share * duration, u, (spline(u), slope * first, bend * first**2 + slope * second)
