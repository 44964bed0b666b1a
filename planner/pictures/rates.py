"""Panels of velocities, accelerations and torques along a motion, each joint's as a share of its limit."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from hdplan.planner.certificate.verdict import share_of_limit
from hdplan.planner.pictures.panels import lay_along, short_names, units_of
from hdplan.planner.pictures.plot import Subject
from hdplan.planner.pictures.quantities import Rate
from hdplan.planner.pictures.style import CONTACT, CURVES, GREY
from hdplan.scenes.limits import QUANTITIES

MOST_NAMES = 8  # joint names in one column
DRAWN_LIMIT_SHARE = 0.6  # share of a limit above which the limit itself is drawn


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


def _limit(axis: Any, peak: float) -> None:
    """Shade the ranges beyond the limits, if the curves come near them."""
    top = 115.0 * max(peak, 1.0) if peak > DRAWN_LIMIT_SHARE else 115.0 * max(peak, 1e-6)
    for side in (-1.0, 1.0):
        axis.axhspan(side * 100.0, side * max(top, 100.0), color=CONTACT, alpha=0.15, linewidth=0)
    axis.set_ylim(-top, top)


def _proven(axis: Any, subject: Subject, rate: Rate) -> None:
    """Write the certificate's verdict on the limit."""
    use = next((use for use in subject.certificate.uses if use.quantity == rate.quantity), None)
    if use is not None:
        name = dict(zip(subject.trajectory.joint_names, short_names(subject.trajectory.joint_names), strict=True))
        text = f"proven ≤ {share_of_limit(use.share, 1)} ({name[use.joint]})" if np.isfinite(use.share) else "jumps"
        style: dict[str, Any] = {} if use.within else {"color": CONTACT}
        axis.set_title(text, loc="right", fontsize=7.5, weight="normal", **style)
