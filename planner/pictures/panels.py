"""Panels of a motion's sheet: joints, clearance and the solver's progress; `rates` has the others."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from matplotlib.markers import CARETDOWN
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from hdplan.planner.certificate.verdict import Certificate, Place, proven_length
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.pictures.clearances import Clearances
from hdplan.planner.pictures.plot import Subject
from hdplan.planner.pictures.quantities import sampled
from hdplan.planner.pictures.style import (
    BETWEEN_LINKS,
    CONTACT,
    DEPTH,
    GOAL,
    GREY,
    INK,
    OBSTACLE,
    OUTER,
    ROBOT_TO_OBSTACLES,
    START,
    plain,
)
from hdplan.planner.robot.robot import Robot

CLEARANCE_STEPS = 128  # intervals of the motion at whose ends distances are computed
LANE = 0.84  # height of a joint's lane over the distance between two lanes
WIDE_COST_RATIO = 30.0  # ratio of costs above which their axis is logarithmic
BELOW_ZERO = "planner’s below 0: its outer bodies overlap, not the robot"
LEGEND = 0.62  # [in] for the legend above the clearance curves
DISTANCE_WORDS = {"hdsdf": "HD-SDF’s D̃", "fcl": "FCL"}  # of the planner's bodies


# --- along the motion -------------------------------------------------------------------------------------------------


def draw_joints(axis: Any, subject: Subject) -> None:
    """Draw each joint in a lane of its own, all to one scale; the range within the joint's limits is grey."""
    robot, curve = subject.certifier.robot, subject.trajectory.curve
    units, (interval, fraction) = units_of(robot), sampled(curve)
    when, joints = curve.time_of((interval + fraction) / (len(curve) - 1)), curve.at(interval, fraction)
    travel = np.ptp(joints, axis=0)
    height = {unit: 1.15 * max(travel[[u == unit for u in units]].max(), 1e-3) for unit in set(units)}
    labels = []
    for row, (values, low, high, unit) in enumerate(zip(joints.T, robot.lower, robot.upper, units, strict=True)):
        middle = 0.5 * (values.min() + values.max())

        def lane(x: Any, row: int = row, middle: float = middle, scale: float = height[unit]) -> Any:
            return -row + LANE * np.clip((x - middle) / scale, -0.5, 0.5)

        axis.axhspan(lane(-np.inf), lane(np.inf), color=CONTACT, alpha=0.15, linewidth=0)
        axis.axhspan(lane(low), lane(high), color=GREY, linewidth=0)
        axis.plot(when, lane(values), color=INK, linewidth=1.4)
        axis.plot(when[0], lane(values[0]), "o", color=START, markersize=4, clip_on=False)
        axis.plot(when[-1], lane(values[-1]), "s", color=GOAL, markersize=4, clip_on=False)
        labels.append(
            f"{low:.2f} … {high:.2f} {unit}".replace("-", "−")
            if np.isfinite([low, high]).all()
            else f"no limits, {unit}"
        )
    rows = -np.arange(robot.n)
    axis.set(ylim=(rows[-1] - 0.5, 0.5), yticks=rows, yticklabels=short_names(robot.joint_names))
    scale = ", ".join(f"{value:.2g} {unit}" for unit, value in sorted(height.items(), reverse=True))
    axis.set_title(f"joints, in lanes {scale} high, with their limits")
    right = axis.twinx()
    right.set(ylim=axis.get_ylim(), yticks=rows, yticklabels=labels)
    for side in (axis, right):
        side.tick_params(axis="y", length=0, labelsize=7)
        side.spines[:].set_visible(False)
    lay_along(axis, subject.trajectory)


def draw_clearance(axis: Any, subject: Subject) -> None:
    """Draw the exact distances along the motion, the planner's lower bound, and what is proven."""
    certificate, certifier = subject.certificate, subject.certifier
    worst = [place for place in (certificate.worst, certificate.self_worst) if place]
    times = np.unique([*np.linspace(0.0, 1.0, CLEARANCE_STEPS + 1), *(place.parameter for place in worst)])
    curve = subject.trajectory.curve
    found = Clearances.along(certifier, curve, times)
    when = curve.time_of(times)
    curves = [
        ("to obstacles, exact", found.to_obstacles, {"color": ROBOT_TO_OBSTACLES, "linewidth": 1.6}),
        (
            f"to obstacles, planner’s ({DISTANCE_WORDS[certifier.scene.planner.distance]})",
            np.where(np.isfinite(found.outer), found.outer, np.nan),
            {"color": OUTER, "linewidth": 1.2, "linestyle": "-."},
        ),
        ("between links, exact", found.between_links, {"color": BETWEEN_LINKS, "linewidth": 1.6, "linestyle": "--"}),
    ]
    shown = [np.zeros(1)]
    for label, values, style in curves:
        if len(values):
            axis.plot(when, values * 1e3, label=label, **style)
            shown.append(values * 1e3)
    lowest, highest = (float(f(np.concatenate(shown))) for f in (np.nanmin, np.nanmax))
    _proven(axis, certificate)
    highest = highest if highest > 0.0 else 1.0
    bottom = 1.3 * lowest if lowest < -0.1 * highest else -0.13 * highest
    top = above(axis, bottom, highest)
    axis.axhspan(bottom, 0.0, color=CONTACT, alpha=0.2, linewidth=0)
    axis.axhline(0.0, color=INK, linewidth=0.8)
    axis.set(ylim=(bottom, top), ylabel="distance [mm]", title="clearance")
    _unproven(axis, subject, (highest - bottom) / (top - bottom))
    if found.outer.min(initial=0.0) < 0.0:
        axis.text(
            0.005, 0.01, BELOW_ZERO, transform=axis.transAxes, color=OUTER, fontsize=6.5, ha="left", va="bottom",
            path_effects=[withStroke(linewidth=2.6, foreground="white")],
        )  # fmt: skip
    axis.text(
        0.995, 0.01, "contact", transform=axis.transAxes, color=CONTACT, fontsize=7, ha="right", va="bottom",
        path_effects=[withStroke(linewidth=2.6, foreground="white")],
    )  # fmt: skip
    lay_along(axis, subject.trajectory)
    if found.closest:
        row = int(found.to_obstacles.argmin())
        _mark(axis, float(when[row]), found.closest[row])
    handles = axis.get_legend_handles_labels()[0]
    if handles:
        axis.legend(ncols=2, loc="upper left", borderpad=0.1, columnspacing=1.2, handlelength=2.2)


def above(axis: Any, bottom: float, highest: float) -> float:
    """Return the upper end of a panel whose curves end below its legend."""
    legend = min(LEGEND / (axis.get_position().height * axis.figure.get_figheight()), 0.6)  # share of the panel
    return float(highest + (highest - bottom) * legend / (1.0 - legend))


def _proven(axis: Any, certificate: Certificate) -> None:
    """Draw the proven bound on the distance to obstacles as a band, and the one between links as a line."""
    if certificate.clearance is not None:
        bound, label = certificate.clearance * 1e3, f"proven ≥ {proven_length(certificate.clearance)}"
        axis.axhspan(0.0, bound, color=ROBOT_TO_OBSTACLES, alpha=0.22, linewidth=0, label=label)
        axis.axhline(bound, color=ROBOT_TO_OBSTACLES, linestyle=":", linewidth=1.0)
    if certificate.self_clearance is not None:
        bound, label = certificate.self_clearance * 1e3, f"proven ≥ {proven_length(certificate.self_clearance)}"
        axis.axhline(bound, color=BETWEEN_LINKS, linestyle=":", linewidth=1.2, label=label)


def _unproven(axis: Any, subject: Subject, height: float) -> None:
    """Shade the waypoint intervals whose proof fails, merging adjacent ones, up to a share of the panel's height."""
    intervals = np.array(subject.certificate.unproven, dtype=np.int64)
    if not len(intervals):
        return
    style = {"facecolor": "none", "edgecolor": CONTACT, "alpha": 0.5, "hatch": "////", "linewidth": 0.5}
    for run in np.split(intervals, np.flatnonzero(np.diff(intervals) > 1) + 1):
        first, last = subject.trajectory.curve.time_of(np.array([run[0], run[-1] + 1]) / (len(subject.trajectory) - 1))
        axis.axvspan(first, last, ymax=height, **style)
    axis.fill([], [], label="not proven", **style)


def _mark(axis: Any, when: float, place: Place) -> None:
    """Mark the worst place, and name its bodies above the panel."""
    value = place.distance * 1e3
    axis.plot(when, value, marker=CARETDOWN, color=INK, markersize=7, clip_on=False)
    text = f"{value:.3g}".replace("-", "−")
    axis.set_title(
        f"▼ {plain(place.link, 20)} – {plain(place.other, 20)}: {text} mm", loc="right", fontsize=7.5, weight="normal"
    )


# --- over the iterations ----------------------------------------------------------------------------------------------


def draw_convergence(axis: Any, subject: Subject) -> None:
    """Draw cost, smoothness and depth, with a dotted line wherever the penalty's weight was raised."""
    steps = subject.steps
    axis.set_title("solver")
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.set(xlabel="iteration", ylabel="cost [–]")
    iteration = [step.iteration for step in steps]
    cost, smoothness = np.array([[step.cost, step.smoothness] for step in steps]).T
    axis.plot(iteration, cost, color=INK, marker=".", markersize=4, linewidth=1.4, label="cost")
    axis.plot(iteration, smoothness, color=START, linestyle="--", linewidth=1.4, label="smoothness part")
    if smoothness.min() > 0.0 and cost.max() > WIDE_COST_RATIO * smoothness.min():
        axis.set_yscale("log")
    else:
        axis.set_ylim(0.0, 1.1 * max(cost.max(), smoothness.max()) or 1.0)
    right = axis.twinx()
    right.plot(iteration, [step.depth * 1e3 for step in steps], color=DEPTH, linewidth=1.4, label="depth (right)")
    right.set_ylabel("depth [mm]")
    right.set_ylim(0.0, max(1.0, 1.1e3 * max(step.depth for step in steps)))
    raised = [step.iteration - 0.5 for before, step in itertools.pairwise(steps) if step.weight > before.weight]
    for number, where in enumerate(raised):
        axis.axvline(where, color=OBSTACLE, linewidth=0.9, linestyle=":", label="" if number else "weight raised")
    handles = [*axis.get_legend_handles_labels()[0], *right.get_legend_handles_labels()[0]]
    axis.legend(
        handles=handles, ncols=4, loc="lower right", bbox_to_anchor=(1.14, 0.99), columnspacing=0.9, handlelength=1.5
    )


# --- small parts ------------------------------------------------------------------------------------------------------


def lay_along(axis: Any, trajectory: Trajectory) -> None:
    """Scale and label the horizontal axis along the motion."""
    first, last = trajectory.curve.time_of([0.0, 1.0])
    label = "path parameter, 0 start to 1 goal [–]" if trajectory.times is None else "time [s]"
    axis.set(xlim=(first, last), xlabel=label)


def units_of(robot: Robot) -> list[str]:
    """Return each planned joint's unit."""
    return ["rad" if turns else "m" for turns in robot.turning]


def short_names(names: tuple[str, ...]) -> list[str]:
    """Drop the parts with which all names begin or end, such as the robot's name or "joint"."""
    words = [name.split("_") for name in names]
    while min(map(len, words)) > 1 and len({parts[0] for parts in words}) == 1:
        words = [parts[1:] for parts in words]
    while min(map(len, words)) > 1 and len({parts[-1] for parts in words}) == 1:
        words = [parts[:-1] for parts in words]
    return [plain("_".join(parts), 17) for parts in words]
