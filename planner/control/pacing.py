"""The speed of a followed motion: as fast as the joints' limits of velocity, acceleration and jerk allow.

A motion in time exceeds a robot's limits where these are lower than the limits of its planning. Over
s times its duration, velocities are 1/s of theirs, accelerations 1/s², jerks 1/s³, and its curve stays the same. One
that begins or ends at a speed, as straight lines between rows do, is brought there and to rest by halves of a motion of
minimum jerk, each along one interval.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from hdplan.planner.control.braking import Rates
from hdplan.planner.motion.curve import Curve
from hdplan.planner.timing.time_laws import MinimumJerk
from hdplan.scenes.array_types import Array

SPEED_SHARE = 0.5  # of the speed limits, at which a path without times is followed
PEAK_TO_MEAN = 1.875  # speed of a motion of minimum jerk, times its mean
LIMIT_SHARE = 0.8  # share of the other limits for its own, the rest for what it rounds
SMOOTH_DEGREE = 5  # degree of motions whose accelerations do not jump
EXTRA_ROWS = 64  # beside the waypoints, so that it slows down evenly at its ends
ROW_GAP = 1e-9  # share of the way between rows, at least
NOTICED_EXCESS = 1e-3  # relative, by which a motion may require more than the limits before it is slowed


def paced(path: Curve, rates: Rates, duration: float = 0.0) -> Curve:
    """Return a path with times, from rest to rest, within SPEED_SHARE of the speeds and the other rates, over
    `duration` [s] or as long as that takes."""
    limits = SPEED_SHARE * rates.velocity, LIMIT_SHARE * rates.acceleration, LIMIT_SHARE * rates.jerk
    needed = np.maximum(np.abs(np.diff(path.rows, axis=0) / limits[0]).max(axis=1), 1e-6)
    places = np.concatenate([[0.0], np.cumsum(needed)]) / needed.sum()
    law = MinimumJerk(max(duration, PEAK_TO_MEAN * float(needed.sum())))
    even = law(np.linspace(0.0, law.duration, EXTRA_ROWS))
    law = MinimumJerk(law.duration * max(1.0, _times_as_long(_along(path.rows, places, even), limits)))
    after = np.searchsorted(places, even[0]).clip(1, len(places) - 1)
    apart = np.minimum(np.abs(even[0] - places[after]), np.abs(even[0] - places[after - 1])) > ROW_GAP
    shares = np.sort(np.concatenate([places, even[0][apart]]))
    rows = np.stack([np.interp(shares, places, joint) for joint in path.rows.T], axis=1)
    return Curve.through(rows, law.time_at(shares))


def _along(rows: Array, places: Array, law: Array) -> tuple[Array, Array, Array]:
    """Return the greatest velocity, acceleration and jerk (n,) on waypoints (N, n) at places s (N,), by a law s(t) and
    its derivatives (4, k): corners count as if they were spread over the intervals beside them."""
    middles, slope, found = 0.5 * (places[1:] + places[:-1]), np.diff(rows, axis=0) / np.diff(places)[:, None], []
    for _ in range(3):
        found.append(np.stack([np.interp(law[0], middles, joint) for joint in slope.T], axis=1))
        slope = np.gradient(slope, middles, axis=0) if len(middles) > 1 else np.zeros_like(slope)
    first, second, third = found
    speed, rise, jerk = law[1:, :, None]
    rates = first * speed, first * rise + second * speed**2
    both = *rates, first * jerk + 3.0 * second * speed * rise + third * speed**3
    velocity, acceleration, jerks = (np.abs(each).max(axis=0) for each in both)
    return velocity, acceleration, jerks


def slowness(motion: Curve, rates: Rates) -> float:
    """Return the factor by which a motion with times must be slowed to keep the rates; less than 1 if it may be
    faster."""
    return _times_as_long(_largest(motion), (rates.velocity, rates.acceleration, rates.jerk))


def feasible(motion: Curve, rates: Rates) -> Curve:
    """Return a motion with times as it is, or slowed, if it requires more than the rates."""
    longer = slowness(motion, rates)
    if longer > 1.0 + NOTICED_EXCESS and motion.degree < SMOOTH_DEGREE:
        longer = slowness(motion, rates.scaled(LIMIT_SHARE))
    return motion if longer <= 1.0 + NOTICED_EXCESS else _eased(slowed(motion, longer))


def slowed(motion: Curve, by: float) -> Curve:
    """Return this curve over so many times its duration, with the same beginning."""
    assert motion.times is not None
    times = motion.times[0] + by * (motion.times - motion.times[0])
    return replace(motion, times=times, given=tuple(each / by**order for order, each in enumerate(motion.given, 1)))


def _eased(motion: Curve) -> Curve:
    """Return a motion whose velocities jump, from rest to rest."""
    if motion.degree > 1 or motion.times is None:
        return motion
    rows, times = motion.rows, motion.times
    if len(rows) == 2:
        rows, times = (np.stack([each[0], 0.5 * (each[0] + each[1]), each[1]]) for each in (rows, times))
    ramp = np.linspace(0.0, 1.0, EXTRA_ROWS)
    way, duration = 2.0 * MinimumJerk(2.0)(1.0 + ramp)[0] - 1.0, PEAK_TO_MEAN * ramp  # the second half, from full speed
    first, last = np.diff(rows[:2], axis=0), np.diff(rows[-2:], axis=0)
    into, out = (1.0 - way[::-1])[:, None] * first, way[:, None] * last
    inner, width = times[1:-1] - times[1] + times[0] + PEAK_TO_MEAN * (times[1] - times[0]), times[-1] - times[-2]
    return Curve.through(
        np.concatenate([rows[0] + into[:-1], rows[1:-1], rows[-2] + out[1:]]),
        np.concatenate([times[0] + (times[1] - times[0]) * duration[:-1], inner, inner[-1] + width * duration[1:]]),
    )


def _times_as_long(largest: Iterable[Array], limits: Sequence[Array]) -> float:
    """Return the least factor of the duration at which the first, second and third derivatives (n,) are in limits."""
    orders = enumerate(zip(largest, limits, strict=True), 1)
    return max(float(np.max(most / limit) ** (1.0 / order)) for order, (most, limit) in orders)


def _largest(motion: Curve) -> Iterator[Array]:
    """Yield the greatest velocity, acceleration and jerk of each joint (n,): proven bounds of what changes without a
    jump; of the rest, means from the middle of an interval to that of the next, and to the ends, at rest."""
    known = (motion.degree + 1) // 2
    for order in range(1, known + 1):
        yield motion.over_time(order).largest()
    widths = motion.widths
    middles = np.concatenate([[0.0], widths.cumsum() - 0.5 * widths, [widths.sum()]])
    values, places = motion.over_time(known).at(np.arange(len(widths)), np.full(len(widths), 0.5)), middles
    values = np.concatenate([np.zeros_like(values[:1]), values, np.zeros_like(values[:1])])
    for _ in range(known + 1, 4):
        values = np.diff(values, axis=0) / np.diff(places)[:, None]
        places = np.concatenate([middles[:1], 0.5 * (places[1:] + places[:-1]), middles[-1:]])
        yield np.abs(values).max(axis=0)
        values = np.concatenate([np.zeros_like(values[:1]), values, np.zeros_like(values[:1])])
