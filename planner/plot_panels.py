"""The sheet of a result: curves over the motion and over the iterations, beside the scene from two sides."""

from __future__ import annotations

import itertools
import textwrap
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import CARETDOWN
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from hdplan.planner.certificate import Certifier, Place, waypoints_of
from hdplan.planner.plot_scene import Picture, draw_scene
from hdplan.planner.plot_style import (
    BETWEEN,
    BETWEEN_LINKS,
    CONTACT,
    DEPTH,
    FIXED,
    GOAL,
    GOOD,
    GREY,
    INK,
    OBSTACLE,
    RC,
    ROBOT_TO_OBSTACLES,
    START,
)
from hdplan.planner.result import PlanResult
from hdplan.planner.robot import Robot
from hdplan.planner.solvers.solution import Step
from hdplan.planner.trajectory import Trajectory
from hdplan.scenes.model import Scene

Array = NDArray[np.float64]

CLEARANCE_STEPS = 96  # pieces of the motion between which exact distances are computed
LANE = 0.84  # of the distance between two joints' lanes: a joint's range
WIDE = 30.0  # ratio of costs from which on their axis is logarithmic
TITLE_WIDTH = 132  # characters
BAND = {"bottom": 0.06, "top": 0.862}  # of the sheet, for the panels
SIDES = ((0.0, 18.0), (62.0, 48.0))  # azimuth from the best side and elevation of the two views [deg]


def sheet(scene: Scene, robot: Robot, result: PlanResult) -> Figure:
    """Return the figure; see plot.plot_result."""
    with rc_context(RC):
        figure = Figure(figsize=(11.7, 8.3), dpi=150, facecolor="white")
        left = figure.add_gridspec(3, 1, height_ratios=(1.35, 1.1, 0.9), left=0.085, right=0.425, **BAND, hspace=0.45)
        right = figure.add_gridspec(2, 1, left=0.525, right=0.985, **BAND, hspace=0.05)
        _title(figure, scene, result)
        _joints(figure.add_subplot(left[0]), robot, result.trajectory)
        _clearance(figure.add_subplot(left[1]), Certifier(scene, robot), result)
        _convergence(figure.add_subplot(left[2]), result.steps)
        picture = Picture.of(scene, robot, result.trajectory)
        views = [figure.add_subplot(right[row]) for row in range(len(SIDES))]
        for axis, (turn, elevation) in zip(views, SIDES, strict=True):
            draw_scene(axis, picture, picture.azimuth() + np.radians(turn), float(np.radians(elevation)))
        _key(views[0], picture)
        return figure


def _title(figure: Figure, scene: Scene, result: PlanResult) -> None:
    certificate, seconds = result.certificate, sum(vars(result.times).values())
    figure.text(0.02, 0.965, f"{scene.name} · {result.robot}", fontsize=15, weight="bold", va="center")
    effort = (
        f"{len(result.trajectory)} waypoints, {result.solver}, {result.iterations} iterations, "
        f"{seconds:.2f} s from scene to verdict"
    )
    figure.text(0.985, 0.965, effort, ha="right", va="center")
    color = GOOD if certificate.certified else CONTACT
    text = textwrap.fill(certificate.text, TITLE_WIDTH)
    figure.text(0.02, 0.943, text, color=color, fontsize=10, weight="bold", va="top")


# --- over the motion --------------------------------------------------------------------------------------------------


def _joints(axis: Any, robot: Robot, trajectory: Trajectory) -> None:
    """Draw each joint in a lane of its own, all to one scale; what lies within the joint's limits is grey."""
    waypoints = waypoints_of(robot, trajectory)
    times = np.linspace(0.0, 1.0, len(waypoints))
    units = ["m" if "JointModelP" in joint.shortname() else "rad" for joint in list(robot.model.joints)[1:]]
    travel = np.ptp(waypoints, axis=0)
    height = {unit: 1.15 * max(travel[[u == unit for u in units]].max(), 1e-3) for unit in set(units)}
    labels = []
    for row, (values, low, high, unit) in enumerate(zip(waypoints.T, robot.lower, robot.upper, units, strict=True)):
        middle = 0.5 * (values.min() + values.max())

        def lane(x: Any, row: int = row, middle: float = middle, scale: float = height[unit]) -> Any:
            return -row + LANE * np.clip((x - middle) / scale, -0.5, 0.5)

        axis.axhspan(lane(-np.inf), lane(np.inf), color=CONTACT, alpha=0.15, linewidth=0)
        axis.axhspan(lane(low), lane(high), color=GREY, linewidth=0)
        axis.plot(times, lane(values), color=INK, linewidth=1.4)
        axis.plot(0.0, lane(values[0]), "o", color=START, markersize=4, clip_on=False)
        axis.plot(1.0, lane(values[-1]), "o", color=GOAL, markersize=4, clip_on=False)
        labels.append(
            f"{low:.2f} … {high:.2f} {unit}".replace("-", "−")
            if np.isfinite([low, high]).all()
            else f"no limits, {unit}"
        )
    rows = -np.arange(robot.n)
    axis.set(xlim=(0, 1), ylim=(rows[-1] - 0.5, 0.5), yticks=rows, yticklabels=_short(robot.joint_names))
    scale = ", ".join(f"{value:.2g} {unit}" for unit, value in sorted(height.items(), reverse=True))
    axis.set_title(f"joints, in lanes {scale} high, with their limits")
    right = axis.twinx()
    right.set(ylim=axis.get_ylim(), yticks=rows, yticklabels=labels)
    for side in (axis, right):
        side.tick_params(axis="y", length=0, labelsize=7)
        side.spines[:].set_visible(False)
    axis.set_xlabel("path parameter, 0 start to 1 goal [–]")


def _short(names: tuple[str, ...]) -> list[str]:
    """Drop the words that all names begin or end with: the robot's name, "joint"."""
    words = [name.split("_") for name in names]
    while min(map(len, words)) > 1 and len({parts[0] for parts in words}) == 1:
        words = [parts[1:] for parts in words]
    while min(map(len, words)) > 1 and len({parts[-1] for parts in words}) == 1:
        words = [parts[:-1] for parts in words]
    return ["_".join(parts) for parts in words]


def _clearance(axis: Any, certifier: Certifier, result: PlanResult) -> None:
    """Draw the exact distances along the motion and what is proven."""
    certificate, robot = result.certificate, certifier.robot
    worst = [place for place in (certificate.worst, certificate.self_worst) if place]
    times = np.unique([*np.linspace(0.0, 1.0, CLEARANCE_STEPS + 1), *(place.time for place in worst)])
    path = Trajectory(robot.joint_names, waypoints_of(robot, result.trajectory)).at(times)
    places = [certifier.nearest(q) for q in path]
    curves = (
        ("robot to obstacles", ROBOT_TO_OBSTACLES, "-", certificate.clearance),
        ("between links", BETWEEN_LINKS, "--", certificate.self_clearance),
    )
    lowest = highest = 0.0
    for group, (name, color, style, proven) in enumerate(curves):
        found = [place[group] for place in places]
        if not all(found):
            continue
        distances = np.array([place.distance for place in found if place]) * 1e3
        lowest, highest = min(lowest, float(distances.min())), max(highest, float(distances.max()))
        label = f"{name}, " + ("not proven" if proven is None else f"proven ≥ {proven * 1e3:.3g} mm (dotted)")
        axis.plot(times, distances, color=color, linestyle=style, linewidth=1.6, label=label)
        if proven is not None:
            axis.axhline(proven * 1e3, color=color, linestyle=":", linewidth=1.2)
    if certificate.clearance is not None:
        axis.axhspan(0.0, certificate.clearance * 1e3, color=ROBOT_TO_OBSTACLES, alpha=0.15, linewidth=0)
    top = 1.45 * highest if highest > 0.0 else 1.0
    bottom = 1.3 * lowest if lowest < 0.0 else -0.06 * top
    axis.axhspan(bottom, 0.0, color=CONTACT, alpha=0.2, linewidth=0)
    axis.set(xlim=(0, 1), ylim=(bottom, top), xlabel="path parameter [–]", ylabel="distance [mm]")
    axis.text(0.995, 0.5 * bottom, "contact", color=CONTACT, fontsize=7, ha="right", va="center")
    axis.set_title("exact clearance")
    to_obstacles = [(time, place) for time, (place, _) in zip(times.tolist(), places, strict=True) if place]
    if to_obstacles:
        _mark(axis, *min(to_obstacles, key=lambda found: found[1].distance))
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="upper left", borderpad=0.1)


def _mark(axis: Any, time: float, place: Place) -> None:
    """Mark the worst place, with its names above the panel."""
    value = place.distance * 1e3
    axis.plot(time, value, marker=CARETDOWN, color=INK, markersize=7, clip_on=False)
    said = f"{value:.3g}".replace("-", "−")
    axis.set_title(f"▼ {place.link} – {place.other}: {said} mm", loc="right", fontsize=7.5, weight="normal")


# --- over the iterations ----------------------------------------------------------------------------------------------


def _convergence(axis: Any, steps: tuple[Step, ...]) -> None:
    """Draw cost, smoothness and depth; a grey line wherever the penalty's weight was raised."""
    axis.set_title("solver")
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.set(xlabel="iteration", ylabel="cost [–]")
    if not steps:
        axis.text(0.5, 0.5, "no iterations recorded", transform=axis.transAxes, ha="center", va="center")
        axis.set(xticks=[], yticks=[])
        return
    iteration = [step.iteration for step in steps]
    cost, smoothness = np.array([[step.cost, step.smoothness] for step in steps]).T
    axis.plot(iteration, cost, color=INK, marker=".", markersize=4, linewidth=1.4, label="cost")
    axis.plot(iteration, smoothness, color=START, linestyle="--", linewidth=1.4, label="of it smoothness")
    if smoothness.min() > 0.0 and cost.max() > WIDE * smoothness.min():
        axis.set_yscale("log")
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


def _key(axis: Any, picture: Picture) -> None:
    """Say what the colours of the scene mean."""
    handles: list[Any] = [Patch(color=START, label="start"), Patch(color=BETWEEN, alpha=0.5, label="on the way")]
    handles += [Patch(color=GOAL, label="goal"), Patch(color=FIXED, label="base")]
    if picture.obstacle_points:
        handles.append(Patch(color=OBSTACLE, alpha=0.5, label="obstacles"))
    handles.append(Line2D([], [], color=INK, linewidth=1.3, label=f"path of {picture.tip_link}"))
    place = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.99)}
    axis.legend(handles=handles, ncols=len(handles), columnspacing=1.2, handlelength=1.4, **place)
