"""A motion that does not begin or end at rest: the sum of a motion from rest to rest and of braking.

At its start the robot brakes as fast as it can (`braking`), to where it would come to stand; from there a path is
planned and timed from rest to rest; and it comes to its goal's rates as it would brake, backwards. With p the motion
along the path, which begins λ later, and b and r what brakes and what speeds up, seen from where the robot stands,

    q(t) = p(t − λ) + b(t) + r(t).

With λ as long as the braking, the robot stands before it continues; with less, its way is rounded off there. The least
time is taken at which all limits hold, for the sum of polynomials between two rows is the one between their sums.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from hdplan.planner.motion.curve import Curve, row_count
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.end_rates import EndRates
from hdplan.planner.robot.setup import Query, Setup
from hdplan.planner.timing.braking import Braking, brake
from hdplan.planner.timing.limits import RateLimit, TimingLimit
from hdplan.planner.timing.time_laws import MinimumJerk
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import UnsolvableError
from hdplan.scenes.targets import Goals
from hdplan.scenes.timing import Timing

Rows = tuple[Array, Array, Array]  # positions, velocities, accelerations (rows, n)

OVERLAPS = 5  # of the path's motion with braking, and with speeding up, that are tried
DURATION_FACTORS = (1.0, 1.05, 1.1, 1.2, 1.3, 1.5, 1.75, 2.0)  # times the least duration of the path's motion, likewise
SHARES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2)  # of the limits with which braking is tried
PEAKS = {"velocity": 1.875, "acceleration": 5.7736, "jerk": 60.0}  # of the law of minimum jerk, in unit time
SLACK = 1e-9  # [rad] or [m] beyond a joint's range, from rounding


class MovingEnds:
    """Braking from a scene's start, and the way to its goal's rates."""

    def __init__(
        self, setup: Setup, limits: tuple[TimingLimit, ...], meets: Callable[[Trajectory], str] = lambda _: ""
    ) -> None:
        """Find it; `meets` says what a motion that brakes, or speeds up, meets on its way, or nothing. Raises
        UnsolvableError for a start from which the robot cannot brake, and a goal to which it cannot come."""
        self.setup, self.limits, self.meets = setup, limits, meets
        timing = setup.scene.timing or Timing()
        self.count = None if timing.duration is None else row_count(timing.duration, timing.rate) - 1
        self.rate = timing.rate if self.count is None or timing.duration is None else self.count / timing.duration
        none = self._none = Braking(*np.zeros((3, 1, setup.robot.n)))
        start, goal = (None if each is None or not each.moving else each for each in setup.rates)
        ends = None if isinstance(setup.scene.goal, Goals) else setup.query
        self.head = none if start is None else self._braking(start, "start", None if ends is None else ends.goal)
        self.tail = none
        if goal is not None and ends is not None:
            self.tail = self._braking(goal, "goal", ends.start - self.head.away[0]).backwards
        if self.count is not None and max(len(self.head), len(self.tail)) > self.count:
            least = max(len(self.head), len(self.tail)) / self.rate
            raise UnsolvableError(
                f"{setup.scene.source}: timing.duration: {timing.duration:g} s, but the robot needs {least:.3g} s to "
                "brake, or to speed up",
                "too_hurried",
            )

    def standing(self, query: Query) -> Query:
        """Return the configurations at which the robot stands before and after it goes to a goal."""
        return Query(query.start - self.head.away[0], query.goal - self.tail.away[-1])

    def overlaps(self, least: int) -> list[tuple[int, int, int]]:
        """Return the ways in which the path's motion may be joined to the ends (`overlaps_of`), with at least so many
        rows where the scene's duration does not say how many there are."""
        head, tail = len(self.head), len(self.tail)
        if self.count is None:
            return overlaps_of(head, least, tail)
        pairs = [(lead, trail) for lead in _parts(head) for trail in _parts(tail) if lead + trail < self.count]
        return [(lead, self.count - lead - trail, trail) for lead, trail in sorted(pairs, key=sum)]

    def joined(self, rows: Rows, lead: int, trail: int) -> Rows:
        """Return the rows of the whole motion; see `joined`."""
        return joined(rows, self.head, self.tail, lead, trail)

    def keeps(self, rows: Rows) -> bool:
        """True if a motion (rows, n) keeps all limits along its whole curve."""
        curve = self._curve(rows)
        return self._beyond(curve) is None and all(limit.stretch(curve) <= 1.0 for limit in self.limits)

    def _curve(self, rows: Rows) -> Curve:
        return Curve.through(rows[0], np.arange(len(rows[0])) / self.rate, rows[1], rows[2])

    def _beyond(self, curve: Curve) -> tuple[int, float] | None:
        """Return a joint that leaves its range on a curve, and how far it goes; None if none does."""
        low, high = (each(bound, axis=0) for each, bound in zip((np.min, np.max), curve.bounds(), strict=True))
        robot = self.setup.robot
        over = np.maximum(robot.lower - low, high - robot.upper)
        joint = int(over.argmax())
        if over[joint] <= SLACK:
            return None
        return joint, float(high[joint] if high[joint] > robot.upper[joint] else low[joint])

    def _braking(self, rates: EndRates, end: str, other: Array | None) -> Braking:
        """Return the motion that brakes the robot from the start's rates, or, backwards, from those of the goal. Of
        those that meet nothing, the one is taken from which the straight line to the `other` end (n,) takes the least
        time."""
        self._check_rates(rates)
        setup, reasons, found = self.setup, list[str](), list[tuple[float, Braking]]()
        scene, way = setup.scene, 1.0 if end == "start" else -1.0
        at = setup.robot.configuration(getattr(scene, end), scene.from_request)
        swings = [(share, 1.0) for share in SHARES]
        swings += [(share, 1.0 / share) for share in SHARES if share != 1.0 and rates.acceleration.any()]
        for share, swing in swings:
            limits = {name: most if name == "velocity" else share * most for name, most in setup.limits.items()}
            limits["acceleration"] = np.maximum(limits["acceleration"], np.abs(rates.acceleration))
            braking = brake(way * rates.velocity, rates.acceleration, limits, 1.0 / self.rate, swing)
            if isinstance(braking, int):
                joint = setup.robot.joint_names[braking]
                reasons.append(f"joint '{joint}' passes its limit of velocity before its acceleration has changed")
                continue
            part, stands = (braking if end == "start" else braking.backwards), at - braking.away[0]
            if why := self._hindrance(stands + part.away, part, rates):
                reasons.append(why)
            else:
                found.append((self._estimate(braking, stands, stands if other is None else other), braking))
        for _, braking in sorted(found, key=lambda each: each[0]):
            part = braking if end == "start" else braking.backwards
            rows = at - braking.away[0] + part.away
            later = max(0, (self.count or 0) - len(part)) if end == "goal" else 0  # obstacles are where they are then
            times = (later + np.arange(len(part) + 1)) / self.rate
            joints, locked = setup.robot.joint_names, setup.robot.locked
            if not (why := self.meets(Trajectory(joints, rows, locked, times, part.velocity, part.acceleration))):
                return braking
            reasons.append(why)
        what = "the robot cannot brake from it" if end == "start" else "the robot cannot come to it from standing"
        raise UnsolvableError(
            f"{scene.source}: {rates.field}.velocity: {what}: {reasons[-1] if found else reasons[0]}", "end_too_fast"
        )

    def _estimate(self, braking: Braking, stands: Array, other: Array) -> float:
        """Return the rows that it takes to brake and to continue, straight from where the robot stands to another
        configuration (n,), with minimum jerk."""
        way, limits = other - stands, self.setup.limits
        kinds = enumerate((limits.get(name, np.inf) for name in PEAKS), 1)
        peaks = zip(kinds, PEAKS.values(), strict=True)
        least = max(float(np.max((peak * np.abs(way) / most) ** (1 / order))) for (order, most), peak in peaks)
        shortest = max(1, math.ceil(least * self.rate))
        for lead, count, _ in overlaps_of(len(braking), shortest, 0):
            law = MinimumJerk(count / self.rate)(np.arange(count + 1) / self.rate)
            own = tuple(np.outer(each, way) for each in law[:3])
            rows = joined((stands + own[0], own[1], own[2]), braking, self._none, lead, 0)
            if self.keeps(rows):
                break
        return max(lead + count, len(braking))

    def _hindrance(self, rows: Array, part: Braking, rates: EndRates) -> str:
        """Return the reason why a robot cannot brake, or speed up, along positions (rows, n) so; nothing if it can."""
        robot = self.setup.robot
        curve = self._curve((rows, part.velocity, part.acceleration))
        if (beyond := self._beyond(curve)) is not None:
            joint, reached = beyond
            return (
                f"joint '{robot.joint_names[joint]}' at {rates.velocity[joint]:.4g} needs "
                f"{np.ptp(rows[:, joint]):.3g} for it within its limits, which leads to {reached:.4g}; its range is "
                f"[{robot.lower[joint]:g}, {robot.upper[joint]:g}]"
            )
        # limits of rates hold as it is made, and to the last bit where a rate that is given is at its limit
        others = (limit for limit in self.limits if not isinstance(limit, RateLimit))
        exceeded = any(limit.stretch(curve) > 1.0 for limit in others)
        return "it would exceed a limit of torque, or of its tool" if exceeded else ""

    def _check_rates(self, rates: EndRates) -> None:
        """Refuse rates beyond the joints' limits."""
        setup, given = self.setup, {"velocity": rates.velocity, "acceleration": rates.acceleration}
        for name, values in given.items():
            joint = int((np.abs(values) / setup.limits[name]).argmax())
            if abs(values[joint]) > (1.0 + SLACK) * setup.limits[name][joint]:
                raise UnsolvableError(
                    f"{setup.scene.source}: {rates.field}.{name}: joint '{setup.robot.joint_names[joint]}' is at "
                    f"{values[joint]:g}, its limit is {setup.limits[name][joint]:g} (limits.{name})",
                    "end_too_fast",
                )


def overlaps_of(head: int, least: int, tail: int) -> list[tuple[int, int, int]]:
    """Return the ways in which a motion of at least so many rows may be joined to braking and speeding up: after how
    many rows it begins, how many it takes, and how many are left at its end. Those with the least time come first, and
    last the one that overlaps with nothing."""
    slower = sorted({math.ceil(least * factor) for factor in DURATION_FACTORS})
    found = [(lead, count, trail) for lead in _parts(head) for count in slower for trail in _parts(tail)]
    apart = head, least, tail
    return [*(each for each in sorted(found, key=sum) if sum(each) < sum(apart)), apart]


def _parts(count: int) -> list[int]:
    return [int(each) for each in np.unique(np.rint(np.linspace(0, count, OVERLAPS)))]


def joined(rows: Rows, head: Braking, tail: Braking, lead: int, trail: int) -> Rows:
    """Return the rows of a whole motion, of those from rest to rest (m, n) each, which begin `lead` rows after the
    start and end `trail` rows before the goal, or more, where braking takes longer."""
    trail = max(trail, max(len(head), len(tail)) + 1 - len(rows[0]) - lead)
    parts = [(each.away, each.velocity, each.acceleration) for each in (head, tail)]
    found = []
    for own, first, last in zip(rows, *parts, strict=True):
        whole = np.pad(own, ((lead, trail), (0, 0)), mode="edge")
        whole[: len(first)] += first
        whole[len(whole) - len(last) :] += last
        found.append(whole)
    return found[0], found[1], found[2]
