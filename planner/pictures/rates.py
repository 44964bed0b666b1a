"""Panels of velocities, accelerations and torques along a motion, each joint's as a share of its limit.

The executed curve itself is drawn, with both sides where it jumps. For a file with times only, finite differences are
drawn: a constant velocity between two waypoints, and its change at each.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.pictures.panels import lay_along, sampled, short_names, units_of
from hdplan.planner.pictures.plot import Subject
from hdplan.planner.pictures.style import CONTACT, CURVES, GREY
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.scenes.limits import QUANTITIES

Array = NDArray[np.float64]

ALWAYS = ("velocity", "acceleration")  # drawn for every motion with times
MOST_NAMES = 8  # joint names in one column
NEAR = 0.6  # share of a limit above which the limit itself is drawn


@dataclass(frozen=True, eq=False)
class Rate:
    """A quantity of n joints along a motion."""

    quantity: str  # "velocity", "acceleration", "jerk", "torque"
    where: str  # for the title: "" if it is known everywhere, or else " at waypoints" or " between waypoints"
    times: Array  # (k,) [s]; one more than the values if each of these holds from one time to the next
    values: Array  # (k, n)
    limits: Array | None  # (n,), if the scene has any


def rates(subject: Subject) -> tuple[Rate, ...]:
    """Return velocities, accelerations, and the other quantities that the scene limits; nothing for a path without
    times."""
    trajectory, checks = subject.trajectory, subject.certifier.limits
    if trajectory.times is None:
        return ()
    limits = {quantity: limit for check in checks for quantity, limit in check.limits.items()}
    velocity, acceleration = ALWAYS
    if trajectory.velocities is None:
        velocities, accelerations = differences(trajectory)
        return (
            Rate(velocity, " between waypoints", trajectory.times, velocities, limits.get(velocity)),
            Rate(acceleration, " at waypoints", trajectory.times[1:-1], accelerations, limits.get(acceleration)),
        )
    curve = trajectory.curve
    interval, fraction = sampled(curve)
    times = curve.time_of((interval + fraction) / (len(curve) - 1))
    found = {name: curve.over_time(DERIVATIVES[name]).at(interval, fraction) for name in ALWAYS}
    for check in checks:
        for name in check.limits.keys() - found.keys():
            found[name] = check.values(name, curve, interval, fraction)
    return tuple(Rate(name, "", times, found[name], limits.get(name)) for name in QUANTITIES if name in found)


def draw_rate(axis: Any, subject: Subject, rate: Rate) -> None:
    """Draw a rate as shares of the joints' limits, or in its unit if there are none."""
    shares = rate.values if rate.limits is None else rate.values / rate.limits
    lines = zip(shares.T, itertools.cycle(CURVES), short_names(subject.trajectory.joint_names), strict=False)
    for values, style, name in lines:
        values = values if rate.limits is None else 100.0 * values
        if len(rate.times) > len(values):
            axis.stairs(values, rate.times, baseline=None, linewidth=1.2, label=name, **style)
        else:
            axis.plot(rate.times, values, linewidth=1.2, label=name, **style)
    axis.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
    axis.set_title(f"{rate.quantity}{rate.where}")
    if rate.limits is None:
        slide = {unit == "m" for unit in units_of(subject.certifier.robot)}
        units = " or ".join(QUANTITIES[rate.quantity].units[slides] for slides in sorted(slide))
        axis.set(ylabel=f"{rate.quantity} [{units}]")
    else:
        axis.set(ylabel="share of limit [%]")
        _limit(axis, float(np.abs(shares).max(initial=0.0)))
        _proven(axis, subject, rate)
    if rate.quantity == "velocity":  # this panel has the legend for all
        columns = -(-len(shares.T) // MOST_NAMES)
        axis.legend(ncols=columns, loc="center left", bbox_to_anchor=(1.0, 0.5), columnspacing=0.9, handlelength=2.2)
    lay_along(axis, subject.trajectory)


def differences(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return the velocities (N − 1, n) between the waypoints and the accelerations (N − 2, n) at the inner ones, each
    over the time from one interval's middle to the next's."""
    assert trajectory.times is not None
    widths = np.diff(trajectory.times)[:, None]
    velocities = np.diff(trajectory.positions, axis=0) / widths
    return velocities, np.diff(velocities, axis=0) / (0.5 * (widths[1:] + widths[:-1]))


def _limit(axis: Any, peak: float) -> None:
    """Shade the ranges beyond the limits, if the curves come near them."""
    top = 115.0 * max(peak, 1.0) if peak > NEAR else 115.0 * max(peak, 1e-6)
    for side in (-1.0, 1.0):
        axis.axhspan(side * 100.0, side * max(top, 100.0), color=CONTACT, alpha=0.15, linewidth=0)
    axis.set_ylim(-top, top)


def _proven(axis: Any, subject: Subject, rate: Rate) -> None:
    """Write what the certificate says about the limit."""
    use = next((use for use in subject.certificate.uses if use.quantity == rate.quantity), None)
    if use is not None:
        name = dict(zip(subject.trajectory.joint_names, short_names(subject.trajectory.joint_names), strict=True))
        said = f"proven ≤ {use.share:.1%} ({name[use.joint]})" if np.isfinite(use.share) else "jumps"
        style: dict[str, Any] = {} if use.within else {"color": CONTACT}
        axis.set_title(said, loc="right", fontsize=7.5, weight="normal", **style)
