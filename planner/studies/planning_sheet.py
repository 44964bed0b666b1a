"""The picture of what accuracy costs a plan in time: clearance lost to conservativeness, and smoothness, over the time
of a plan, with the Pareto fronts. The study's table shows the effect of each setting by itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hdplan.distance.studies.accuracy import pareto_front
from hdplan.planner.pictures.labels import name_points
from hdplan.planner.pictures.style import (
    BETWEEN,
    BETWEEN_LINKS,
    DEPTH,
    FIXED,
    GOAL,
    GOOD,
    INK,
    OBSTACLE,
    RC,
    START,
)
from hdplan.planner.studies.distance_sheet import plain
from hdplan.planner.studies.planning import Summary, label

STYLES = {  # of each setting: colour, marker, name
    "link_bodies": (START, "o", "link bodies"),
    "normals": (GOAL, "^", "normals"),
    "gamma": (DEPTH, "D", "gamma"),
    "shaping_length": (BETWEEN, "v", "shaping length"),
    "waypoints": (BETWEEN_LINKS, "s", "waypoints"),
    "swept": (OBSTACLE, "X", "swept"),
    "solver": (GOOD, "P", "solver"),
}
Measure = Callable[[Summary], float]


def _acceleration(row: Summary) -> float:
    return 100 * row.acceleration if row.acceleration else np.nan


def planning_sheet(rows: Sequence[Summary], complete: bool = True) -> Figure:
    """Return the figure for the variants, the defaults first."""
    with rc_context(RC):
        figure = Figure(figsize=(12.6, 5.6), dpi=150, facecolor="white")
        _title(figure, rows[0], complete)
        _key(figure, rows)
        above = figure.add_gridspec(1, 2, left=0.06, right=0.985, bottom=0.1, top=0.73, wspace=0.16)
        _against_time(
            figure.add_subplot(above[0]), rows, ("link_bodies", "normals"), lambda row: 1e3 * row.lost[0],
            "How much narrower does the world look?", "clearance lost near contact, median [mm]",
        )  # fmt: skip
        _against_time(
            figure.add_subplot(above[1]), rows, tuple(STYLES), _acceleration,
            "How smooth is the motion?", "integrated squared acceleration [% of the defaults']",
        )  # fmt: skip
        return figure


def _title(figure: Figure, default: Summary, complete: bool) -> None:
    title = "What accuracy costs a plan in time: only the settings on the green line pay off"
    figure.text(0.02, 0.95, title, fontsize=14, weight="bold", va="center")
    part = "" if complete else ", interrupted: what was measured until then"
    about = f"{default.scenes} scenes, one setting changed at a time{part}"
    figure.text(0.985, 0.95, about, ha="right", va="center", color=FIXED)
    words = (
        f"defaults: {default.certified} of {default.scenes} certified, {1e3 * default.lost[0]:.1f} mm of clearance "
        f"lost near contact (95 %: {1e3 * default.lost[1]:.0f} mm), a plan takes "
        f"{1e3 * default.seconds:.0f} ms"
    )
    figure.text(0.02, 0.893, words, fontsize=11, weight="bold", va="center")


def _against_time(
    axis: Any, rows: Sequence[Summary], factors: Sequence[str], loss: Measure, title: str, words: str
) -> None:
    """Draw the variants of these settings at their time and loss; hollow where fewer scenes are certified than by the
    defaults."""
    shown = [row for row in rows if row.variant.factor in ("", *factors) and np.isfinite(loss(row))]
    good = [row for row in shown if row.certified >= rows[0].certified]
    front = [good[k] for k in pareto_front([row.seconds for row in good], [loss(row) for row in good])]
    axis.step(
        [1e3 * row.seconds for row in front], [loss(row) for row in front], where="post", color=GOOD, linewidth=6,
        alpha=0.25, solid_capstyle="round", zorder=1,
    )  # fmt: skip
    for row in shown:
        _mark(axis, row, 1e3 * row.seconds, loss(row), row in good)
    axis.margins(0.13, 0.13)
    axis.set(xscale="log", yscale="log", title=title, xlabel="processor time of a plan, median [ms]", ylabel=words)
    plain(axis)
    if len(factors) < len(STYLES):
        axis.text(
            0.01, 0.02, "the other settings do not change it", transform=axis.transAxes, color=FIXED, fontsize=7.5
        )
    ordered = sorted(shown, key=lambda row: (row.variant.factor != "", row not in front))
    bold = sum(row in front or not row.variant.factor for row in ordered)
    points = [(1e3 * row.seconds, loss(row)) for row in ordered]
    name_points(axis, points, [label(row.variant) for row in ordered], bold)


def _mark(axis: Any, row: Summary, x: float, y: float, good: bool) -> None:
    """Draw one variant: the defaults as a star."""
    if not row.variant.factor:
        axis.plot(x, y, "*", color=INK, markersize=13, zorder=5)
        return
    color, marker, _ = STYLES[row.variant.factor]
    fill, edge, width = (color, INK, 0.6) if good else ("white", color, 1.3)
    axis.plot(x, y, marker, mfc=fill, mec=edge, mew=width, markersize=7, zorder=4)


def _key(figure: Figure, rows: Sequence[Summary]) -> None:
    """One key for both panels."""
    of: dict[str, Any] = {"linestyle": "", "markersize": 7, "mec": INK}
    handles: list[Any] = [Line2D([], [], linestyle="", marker="*", markersize=12, color=INK, label="defaults")]
    for factor, (color, marker, name) in STYLES.items():
        if any(row.variant.factor == factor for row in rows):
            handles.append(Line2D([], [], marker=marker, mfc=color, mew=0.6, label=name, **of))
    fewer = "fewer certified than by the defaults"
    handles.append(Line2D([], [], marker="o", mfc="white", mew=1.3, label=fewer, **of))
    handles.append(Line2D([], [], color=GOOD, linewidth=6, alpha=0.25, label="Pareto front"))
    row = {"loc": "upper left", "columnspacing": 1.6, "handletextpad": 0.6}
    figure.legend(handles=handles, bbox_to_anchor=(0.012, 0.865), ncols=len(handles), **row)
