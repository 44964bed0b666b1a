"""Braking: the quickest way from a state of motion to standstill, within limits of velocity, acceleration and jerk.

Each joint for itself, in three phases: its acceleration goes evenly from a to α, stays there, and goes evenly to 0,

    α = −(v + a t₁/2) / (t₁/2 + t₂ + t₃/2),

so that the velocity ends at 0. The phases take whole numbers of rows: between two rows the jerk is constant, and the
quintic through them is this motion itself, without rounding of its corners. Of all phases within the limits the
shortest time is taken, and then the shortest way. Beginning at a goal's rates, it is, backwards, how a joint comes to
move like that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdplan.scenes.array_types import Array
from hdplan.scenes.once import ReadOnly

MOST_TRIED = 200  # numbers of rows of the first phase, and of the last
UNUSED_SHARE, VELOCITY_ROUNDING = 1e-6, 1e-9  # [–] of a limit that is left unused; by which a velocity may exceed one


@dataclass(frozen=True, eq=False)
class Braking(ReadOnly):
    """Rows h apart, from a state of motion to standstill: where the joints are, seen from where they come to stand."""

    away: Array  # (rows, n) [rad] or [m]
    velocity: Array  # (rows, n)
    acceleration: Array  # (rows, n)

    def __len__(self) -> int:
        """Number of intervals between rows."""
        return len(self.away) - 1

    @property
    def backwards(self) -> Braking:
        """This motion, run backwards."""
        return Braking(self.away[::-1], -self.velocity[::-1], self.acceleration[::-1])


def brake(
    velocity: Array, acceleration: Array, limits: Mapping[str, Array], h: float, swing: float = 1.0
) -> Braking | int:
    """Return the braking motion of joints (n,) with rows h [s] apart, within limits (n,) by name, in the first phase
    within `swing` times that of jerk; or a joint that cannot."""
    most = [limits.get(name, np.full(len(velocity), np.inf)) for name in ("velocity", "acceleration", "jerk")]
    jerks = []
    for joint, (v, a) in enumerate(zip(velocity.tolist(), acceleration.tolist(), strict=True)):
        fastest, strongest, jerkiest = (float(each[joint]) for each in most)
        jerkiest *= 1 - UNUSED_SHARE
        found = _jerks(
            v, a, (1 + VELOCITY_ROUNDING) * fastest, (1 - UNUSED_SHARE) * strongest, (swing * jerkiest, jerkiest), h
        )
        if found is None:
            return joint
        jerks.append(found)
    rows = max(map(len, jerks))
    jerk = np.stack([np.pad(each, (0, rows - len(each))) for each in jerks], axis=1)
    ends = np.array([len(each) for each in jerks])
    a, v, q = [acceleration], [velocity], [np.zeros_like(velocity)]
    for step in jerk:
        q.append(q[-1] + h * (v[-1] + h * (a[-1] / 2 + h * step / 6)))
        v.append(v[-1] + h * (a[-1] + h * step / 2))
        a.append(a[-1] + h * step)
    over = np.arange(rows + 1)[:, None] >= ends  # to the bit
    way = np.where(over, np.array(q)[ends, range(len(ends))], np.array(q))
    return Braking(way - way[-1], np.where(over, 0.0, np.array(v)), np.where(over, 0.0, np.array(a)))


def _jerks(
    v: float, a: float, fastest: float, strongest: float, jerkiest: tuple[float, float], h: float
) -> Array | None:
    """Return the jerk of each row in which one joint brakes, within limits of jerk in the first phase and after it;
    None if it cannot."""
    if v == a == 0.0:
        return np.zeros(0)
    at_first, after = jerkiest
    reach = 1.0 if np.isinf(after) else np.ceil((abs(a) + strongest) / min(jerkiest) / h) + 1.0
    tried = np.unique(np.ceil(np.linspace(1.0, reach, int(min(reach, MOST_TRIED)))))
    first, last = h * tried[:, None], h * tried[None, :]
    left = v + a * first / 2  # to be taken away, over (t₁ + t₃)/2 + t₂
    toward = at_first * first + np.where(left > 0.0, -a, a)  # as far as α may be from 0, on its side
    with np.errstate(divide="ignore", invalid="ignore"):
        taken = np.abs(left) / np.minimum(np.minimum(strongest, after * last), np.maximum(toward, 0.0))
        taken = np.where(left == 0.0, 0.0, taken)
        between = h * np.ceil(np.maximum(taken - (first + last) / 2, 0.0) / h - 1e-9)
        peak = -left / ((first + last) / 2 + between)  # α
        # the velocity where the acceleration passes 0 in the first phase
        crest = v - a * a * first / (2.0 * (peak - a))
    then = v + (a + peak) * first / 2
    good = np.isfinite(peak) & (np.abs(peak) <= strongest) & (np.abs(peak) <= after * last)
    good &= (np.abs(peak - a) <= at_first * first) & (np.abs(then) <= fastest)
    good &= (a * peak >= 0.0) | (np.abs(crest) <= fastest)
    if not good.any():
        return None
    peak, between = np.where(good, peak, 0.0), np.where(good, between, 0.0)
    way = v * first + (2 * a + peak) * first**2 / 6 + then * (between + last)
    way += peak * (between**2 / 2 + between * last + last**2 / 3)
    rows = np.where(good, np.rint((first + between + last) / h), np.inf)
    row, column = np.unravel_index(int(np.where(rows == rows.min(), np.abs(way), np.inf).argmin()), rows.shape)
    counts = [int(tried[row]), round(float(between[row, column]) / h), int(tried[column])]
    alpha = float(peak[row, column])
    return np.repeat([(alpha - a) / (counts[0] * h), 0.0, -alpha / (counts[2] * h)], counts)
