"""The shortest time in which a joint can get from rest to rest, within its limits of velocity, acceleration and jerk: a
bound for every motion between two configurations, as it begins and ends without acceleration.

A joint that has to go d, with limits v, a, j: with α = min(a, √(v j)) the acceleration that it can reach on the way to
v, and ρ = v/α + α/j the time to v,

    T = d/v + ρ                             if it gets to v: d ≥ v ρ,
    T = α/j + √((α/j)² + 4 d/α)             else if it gets to α: d ≥ 2 α³/j²,
    T = 4 (d / (2 j))^(1/3)                 else

(Biagiotti & Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, section 3.4: the double S).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdplan.scenes.array_types import Array

MISSING_LIMIT = 1e12  # in place of a missing limit, in its unit, to the power of the order of the derivative


def least_times(way: Array, limits: Mapping[str, Array]) -> Array:
    """Return the least time [s] of each joint for ways (..., n) within limits (n,) by name; those that are not there,
    and those of other quantities, bound nothing. A lower bound, exact for one joint alone."""
    distance = np.abs(way)
    v, a, j = (
        np.minimum(limits.get(name, np.inf), MISSING_LIMIT**order) * np.ones(way.shape[-1])
        for order, name in enumerate(("velocity", "acceleration", "jerk"), 1)
    )
    a = np.minimum(a, np.sqrt(v * j))
    ramp = v / a + a / j
    to_velocity = distance / v + ramp
    to_acceleration = a / j + np.sqrt((a / j) ** 2 + 4 * distance / a)
    neither = 4 * np.cbrt(distance / (2 * j))
    times: Array = np.where(
        distance >= v * ramp, to_velocity, np.where(distance >= 2 * a**3 / j**2, to_acceleration, neither)
    )
    return times


def least_time(way: Array, limits: Mapping[str, Array]) -> float:
    """Return the least time [s] of the slowest joint, 0 without joints: a lower bound."""
    return float(least_times(way, limits).max(initial=0.0))
