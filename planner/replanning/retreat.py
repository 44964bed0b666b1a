"""Retreats: ways of a robot that would otherwise be shut in, from what may come closer.

The room d_i of a link and an obstacle that may move is their distance, less all that is unknown of it when a motion
that begins now could stand (`Certifier.room`). Where it is small, no motion can soon be proven. To the motion that is
held, q_H, which brakes or stands, a straight way is then added in the direction in which the rooms grow, those the most
that are the smallest, by as much as q_H leaves of the limits a_j of the joints' accelerations:

    q(t) = q_H(t) + p σ(t),    p_j = a_j clip(SHARP u_j / max |u|, −1, 1),    u_j = a_j Σ_i exp(−d_i / FALLS) ∂d_i/∂q_j.

σ goes from rest to rest with |σ̈| ≤ 1, so quickly as the joints' limits allow. Nothing of this is trusted: what is
driven is proven by the step (`replanner`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.curve import Curve
from hdplan.planner.replanning.nominal import Rows
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.planner.timing.braking import brake
from hdplan.scenes.array_types import Array

SHUT_IN = 0.1  # [m] of room, below which a robot that goes nowhere else retreats
FALLS = 0.05  # [m] of room, in which the weight of an obstacle falls by e
SHARP = 3.0  # times the share of its limit with which a joint takes part
LASTS = (0.35, 0.25)  # [s] of a retreat, about
UNUSED = 0.1  # share of its limits, and [rad or m] of its range: a joint with less left takes no part
ROUNDING = 1e-6  # [–] of limits that is left unused


class Retreats:
    """The retreats of one robot."""

    def __init__(self, limits: Mapping[str, Array], h: float) -> None:
        """Take the greatest rates (n,) by name, and the width of the grid [s]."""
        self.limits, self.h = {name: limits[name] for name in DERIVATIVES if name in limits}, h

    def of(self, certifier: Certifier, held: Rows, time: float) -> Iterator[Rows]:
        """Yield motions that begin as the one that is held, and lead from where there would be too little room at a
        time [s] of the certifier's scene; none if there is enough where it ends."""
        robot, stop = certifier.robot, held[0][-1]
        room, slopes = certifier.room(stop, time, SHUT_IN)
        if not len(room):
            return
        left = self._left(held)
        uphill = left["acceleration"] * (np.exp(-room / FALLS) @ slopes)
        range_left = np.where(uphill > 0.0, robot.upper - stop, stop - robot.lower)
        takes_part = range_left > UNUSED
        for name, most in self.limits.items():
            takes_part &= left[name] > UNUSED * most
        uphill = np.where(takes_part, uphill, 0.0)
        if not uphill.any():
            return
        way = left["acceleration"] * np.clip(SHARP * uphill / np.abs(uphill).max(), -1.0, 1.0)
        moves = way != 0.0
        limits = {name: (rates[moves] / np.abs(way[moves])).min(keepdims=True) for name, rates in left.items()}
        farthest = float((range_left[moves] / np.abs(way[moves])).min())
        for seconds in LASTS:
            if (law := _law(seconds, farthest, limits, self.h)) is not None:
                position, velocity, acceleration = (
                    _sum(own, along[:, None] * way) for own, along in zip(held, law, strict=True)
                )
                yield position, velocity, acceleration

    def _left(self, held: Rows) -> dict[str, Array]:
        """Return what a motion leaves of the limits (n,), by name."""
        used = dict.fromkeys(self.limits, np.zeros(held[0].shape[1]))
        if len(held[0]) > 1:
            curve = Curve.through(held[0], self.h * np.arange(len(held[0]), dtype=np.float64), held[1], held[2])
            used = {name: curve.over_time(DERIVATIVES[name]).largest() for name in self.limits}
        return {name: np.maximum((1.0 - ROUNDING) * most - used[name], 0.0) for name, most in self.limits.items()}


def _law(seconds: float, farthest: float, limits: Mapping[str, Array], h: float) -> tuple[Array, Array, Array] | None:
    """Return σ, σ̇ and σ̈ (k,) from rest to rest in some seconds, but no farther than that; None if there is none."""
    speed = min(seconds / 2.0, float(limits["velocity"][0]), float(np.sqrt(farthest)))
    stops = brake(np.array([speed]), np.zeros(1), limits, h)
    if isinstance(stops, int):
        return None
    away, velocity, acceleration = stops.away[:, 0], stops.velocity[:, 0], stops.acceleration[:, 0]
    even = max(min(round(seconds / h) - 2 * len(stops), int(min((farthest + 2.0 * away[0]) / (speed * h), 1e6))), 0)
    cruise = speed * h * np.arange(1, even + 1) - away[0]
    position = np.concatenate([-away[::-1], cruise, away[1:] + even * speed * h - 2.0 * away[0]])
    if position[-1] > farthest:
        return None
    still = np.zeros(even)
    return (
        position,
        np.concatenate([velocity[::-1], still + speed, velocity[1:]]),
        np.concatenate([-acceleration[::-1], still, acceleration[1:]]),
    )


def _sum(one: Array, other: Array) -> Array:
    """Return the sum of rows; after its end, each keeps its last row."""
    count = max(len(one), len(other))
    longer = (np.concatenate([each, np.repeat(each[-1:], count - len(each), axis=0)]) for each in (one, other))
    return np.asarray(sum(longer))
