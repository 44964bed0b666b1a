"""A motion that does not begin or end at rest: a motion from rest to rest, and what brakes the robot, added up.

At its start the robot brakes as fast as it can (`braking`), to where it would come to stand; from there a path is
planned and timed from rest to rest; and it comes to its goal's rates as it would brake, backwards. With p the motion
along the path, which begins λ later, and b and r what brakes and what speeds up, seen from where the robot stands,

    q(t) = p(t − λ) + b(t) + r(t).

With λ as long as the braking, the robot stands before it goes on; with less, its way is rounded off there. The least
time is taken at which all limits hold, for the sum of polynomials between two rows is the one between their sums.
"""

from __future__ import annotations

import numpy as np

from hdplan.planner.motion.curve import Curve, row_count
from hdplan.planner.robot.end_rates import EndRates
from hdplan.planner.robot.setup import Query, Setup
from hdplan.planner.timing.braking import Braking, brake
from hdplan.planner.timing.limits import TimingLimit
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import UnsolvableError
from hdplan.scenes.timing import Timing

Rows = tuple[Array, Array, Array]  # positions, velocities, accelerations (rows, n)

OVERLAPS = 5  # of the path's motion with braking, and with speeding up, that are tried
SOFTER = (1.0, 0.8, 0.6, 0.4, 0.2)  # shares of the acceleration with which braking is tried, for the torques' sake
SLACK = 1e-9  # [rad] or [m] beyond a joint's range, from rounding


class MovingEnds:
    """How the robot of a scene brakes from its start, and comes to its goal's rates."""

    def __init__(self, setup: Setup, limits: tuple[TimingLimit, ...]) -> None:
        """Find it. Raises UnsolvableError for a start that cannot be braked within the limits, and a goal that cannot
        be reached."""
        self.setup, self.limits = setup, limits
        timing = setup.scene.timing or Timing()
        self.count = None if timing.duration is None else row_count(timing.duration, timing.rate) - 1
        self.rate = timing.rate if self.count is None or timing.duration is None else self.count / timing.duration
        none = Braking(*np.zeros((3, 1, setup.robot.n)))
        start, goal = setup.rates
        self.head = none if start is None else self._braking(start, 1.0)
        self.tail = none if goal is None else self._braking(goal, -1.0).backwards
        if self.count is not None and max(len(self.head), len(self.tail)) > self.count:
            least = max(len(self.head), len(self.tail)) / self.rate
            raise UnsolvableError(
                f"{setup.scene.source}: timing.duration: {timing.duration:g} s, but the robot needs {least:.3g} s to "
                "brake, or to speed up",
                "too_hurried",
            )

    def standing(self, query: Query) -> Query:
        """Return where the robot stands before it goes to a goal, and after."""
        return Query(query.start - self.head.away[0], query.goal - self.tail.away[-1])

    def overlaps(self) -> list[tuple[int, int]]:
        """Return by how many rows the path's motion may begin after the start and end before the end; those with the
        least time first, and last the one without any overlap."""
        leads, trails = (
            np.unique(np.rint(np.linspace(0, len(each), OVERLAPS)).astype(np.int64)).tolist()
            for each in (self.head, self.tail)
        )
        return sorted(((lead, trail) for lead in leads for trail in trails), key=sum)

    def joined(self, rows: Rows, lead: int, trail: int) -> Rows:
        """Return the rows of the whole motion, of those from rest to rest (m, n) each."""
        count = len(rows[0])
        trail = max(trail, max(len(self.head), len(self.tail)) + 1 - count - lead)
        found = []
        for own, first, last in zip(rows, self._parts(self.head), self._parts(self.tail), strict=True):
            whole = np.pad(own, ((lead, trail), (0, 0)), mode="edge")
            whole[: len(first)] += first
            whole[len(whole) - len(last) :] += last
            found.append(whole)
        return found[0], found[1], found[2]

    def keeps(self, rows: Rows) -> bool:
        """Whether a motion (rows, n) keeps all limits along its whole curve."""
        curve = self._curve(rows)
        return self._beyond(curve) is None and all(limit.stretch(curve) <= 1.0 for limit in self.limits)

    @staticmethod
    def _parts(each: Braking) -> Rows:
        return each.away, each.velocity, each.acceleration

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

    def _braking(self, rates: EndRates, way: float) -> Braking:
        """Return how the robot brakes from an end's rates; from those of a goal backwards, `way` −1."""
        setup, limits = self.setup, self.setup.limits
        scene, names = setup.scene, setup.robot.joint_names
        for rate, value in (("velocity", rates.velocity), ("acceleration", rates.acceleration)):
            shares = np.abs(value) / limits[rate]
            if (joint := int(shares.argmax())) is not None and shares[joint] > 1.0 + SLACK:
                raise self._refused(
                    rates.field,
                    rate,
                    f"joint '{names[joint]}' at {value[joint]:g}, its limit is {limits[rate][joint]:g} (limits.{rate})",
                )
        where = "start" if way > 0.0 else "goal"
        target = scene.start if way > 0.0 else scene.goal
        at = setup.robot.configuration(target, scene.from_request)  # type: ignore[arg-type]
        what = "to stand" if way > 0.0 else f"from standing to the {where}'s velocity"
        for share in SOFTER:
            softer = {**limits, "acceleration": np.maximum(share * limits["acceleration"], np.abs(rates.acceleration))}
            found = brake(way * rates.velocity, rates.acceleration, softer, 1.0 / self.rate)
            if isinstance(found, int):
                raise self._refused(
                    rates.field, "acceleration", f"joint '{names[found]}' passes its limit of velocity before it slows down"
                )
            rows = found if way > 0.0 else found.backwards
            curve = self._curve((at - found.away[0] + rows.away, rows.velocity, rows.acceleration))
            if (beyond := self._beyond(curve)) is not None:
                joint, reached = beyond
                span = f"[{setup.robot.lower[joint]:g}, {setup.robot.upper[joint]:g}]"
                raise self._refused(
                    rates.field,
                    "velocity",
                    f"joint '{names[joint]}' at {rates.velocity[joint]:g} needs {abs(found.away[0][joint]):.3g} {what} "
                    f"within the limits, by way of {reached:.4g}, outside its range {span}",
                )
            if all(limit.stretch(curve) <= 1.0 for limit in self.limits):
                return found
        raise self._refused(rates.field, "velocity", f"no braking {what} was found within the limits of torque")

    def _refused(self, field: str, rate: str, why: str) -> UnsolvableError:
        return UnsolvableError(f"{self.setup.scene.source}: {field}.{rate}: {why}", "end_too_fast")
