"""The picture of what accuracy costs a plan in time: which settings pay off, and what each of them does by itself.

Above, the benefits over the time of a plan: clearance lost to conservativeness and smoothness, with the Pareto fronts.
Below, one column for each setting: its time, and its purpose.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from hdplan.distance.studies.accuracy import pareto_front
from hdplan.planner.pictures.labels import name_points
from hdplan.planner.pictures.style import (
    BETWEEN,
    BETWEEN_LINKS,
    DEPTH,
    FIXED,
    GOAL,
    GOOD,
    GREY,
    INK,
    OBSTACLE,
    RC,
    START,
)
from hdplan.planner.studies.planning import Summary, label
from hdplan.planner.studies.planning_runs import DEFAULTS, VALUES, Value

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


GIVES: dict[str, tuple[str, Measure]] = {  # the purpose of a setting: label and measure
    "link_bodies": ("clearance lost [mm]", lambda row: 1e3 * row.lost[0]),
    "normals": ("clearance lost [mm]", lambda row: 1e3 * row.lost[0]),
    "gamma": ("D off from D̃ [mm]", lambda row: 1e3 * row.off),
    "shaping_length": ("D off from D̃ [mm]", lambda row: 1e3 * row.off),
    "waypoints": ("acceleration [%]", _acceleration),
    "swept": ("acceleration [%]", _acceleration),
    "solver": ("acceleration [%]", _acceleration),
}


def planning_sheet(rows: Sequence[Summary], complete: bool = True) -> Figure:
    """Return the figure for the variants, the defaults first."""
    with rc_context(RC):
        figure = Figure(figsize=(12.6, 10.4), dpi=150, facecolor="white")
        _title(figure, rows[0], complete)
        _key(figure, rows)
        above = figure.add_gridspec(1, 2, left=0.06, right=0.985, bottom=0.565, top=0.86, wspace=0.16)
        _against_time(
            figure.add_subplot(above[0]), rows, ("link_bodies", "normals"), lambda row: 1e3 * row.lost[0],
            "How much narrower does the world look?", "clearance lost near contact, median [mm]",
        )  # fmt: skip
        _against_time(
            figure.add_subplot(above[1]), rows, tuple(STYLES), _acceleration,
            "How smooth is the motion?", "integrated squared acceleration [% of the defaults']",
        )  # fmt: skip
        below = figure.add_gridspec(
            3, len(VALUES), left=0.06, right=0.985, bottom=0.065, top=0.472, wspace=0.38, hspace=0.42
        )
        sharing: dict[str, Any] = {}
        for column, factor in enumerate(VALUES):
            _by_setting(figure, [below[line, column] for line in range(3)], factor, rows, sharing)
        return figure


def _title(figure: Figure, default: Summary, complete: bool) -> None:
    figure.text(0.02, 0.974, "What accuracy costs in time, for planning", fontsize=15, weight="bold", va="center")
    part = "" if complete else ", interrupted: what was measured until then"
    about = f"{default.scenes} scenes, one setting changed at a time{part}"
    figure.text(0.985, 0.974, about, ha="right", va="center", color=FIXED)
    words = (
        f"defaults: {default.certified} of {default.scenes} certified, {1e3 * default.lost[0]:.1f} mm of clearance "
        f"lost near contact (95 %: {1e3 * default.lost[1]:.0f} mm), a plan takes "
        f"{1e3 * default.seconds:.0f} ms"
    )
    figure.text(0.02, 0.944, words, fontsize=11, weight="bold", va="center")


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
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.margins(0.13, 0.13)
    axis.set_title(title)
    axis.set_xlabel("processor time of a plan, median [ms]")
    axis.set_ylabel(words)
    _plain(axis)
    if len(factors) < len(STYLES):
        axis.text(
            0.01, 0.02, "the other settings do not change it", transform=axis.transAxes, color=FIXED, fontsize=7.5
        )
    ordered = sorted(shown, key=lambda row: (row.variant.factor != "", row not in front))
    bold = sum(row in front or not row.variant.factor for row in ordered)
    name_points(
        axis, [(1e3 * row.seconds, loss(row)) for row in ordered], [label(row.variant) for row in ordered], bold
    )


def _mark(axis: Any, row: Summary, x: float, y: float, good: bool) -> None:
    """Draw one variant: the defaults as a star."""
    if not row.variant.factor:
        axis.plot(x, y, "*", color=INK, markersize=13, zorder=5)
        return
    color, marker, _ = STYLES[row.variant.factor]
    fill, edge, width = (color, INK, 0.6) if good else ("white", color, 1.3)
    axis.plot(x, y, marker, mfc=fill, mec=edge, mew=width, markersize=7, zorder=4)


def _by_setting(
    figure: Figure, places: Sequence[Any], factor: str, rows: Sequence[Summary], sharing: dict[str, Any]
) -> None:
    """Draw what one setting costs, what it gives and what it certifies, over its values, one below the other.

    ``sharing`` keeps the first axis of each measure: all others of it have its scale.
    """
    values, chosen = _chosen(factor, rows)
    words, measure = GIVES[factor]
    axes = []
    for place, what in zip(places, ("time", words, "scenes certified"), strict=True):
        axes.append(figure.add_subplot(place, sharey=sharing.get(what)))
        sharing.setdefault(what, axes[-1])
    _curve(axes[0], factor, chosen, lambda row: 1e3 * row.seconds, f"{STYLES[factor][2]}\ntime [ms]")
    _curve(axes[1], factor, chosen, measure, words)
    _rates(axes[2], factor, chosen)
    axes[0].set_yscale("log")
    for axis in axes:
        _plain(axis)
        axis.grid(visible=False, axis="x")
        axis.set_xlim(-0.5, len(values) - 0.5)
        axis.set_xticks(range(len(values)), [""] * len(values))
    texts = [_short(factor, value) for value in values]
    slanted: dict[str, Any] = {"rotation": 35, "ha": "right", "rotation_mode": "anchor"}
    axes[2].set_xticks(range(len(values)), texts, fontsize=7.5, **(slanted if len("".join(texts)) > 15 else {}))


def _chosen(factor: str, rows: Sequence[Summary]) -> tuple[list[Value], list[Summary]]:
    """The values of a setting that were measured, in their order, and what came of them."""
    found = {row.variant.value: row for row in rows if row.variant.factor == factor} | {DEFAULTS[factor]: rows[0]}
    values = [value for value in VALUES[factor] if value in found]
    return values, [found[value] for value in values]


def _curve(axis: Any, factor: str, rows: Sequence[Summary], what: Measure, title: str) -> None:
    """Draw what one setting costs or gives, over its values."""
    most = max(row.certified for row in rows if not row.variant.factor)
    axis.plot(range(len(rows)), [what(row) for row in rows], color=STYLES[factor][0], linewidth=1.3)
    for k, row in enumerate(rows):
        _mark(axis, row, k, what(row), row.certified >= most)
    axis.margins(y=0.2)
    axis.set_title(title, fontsize=8.5)


def _rates(axis: Any, factor: str, rows: Sequence[Summary]) -> None:
    """Draw how many scenes each value certifies, and how many from the first guess."""
    color = STYLES[factor][0]
    places = range(len(rows))
    axis.bar(places, [row.certified for row in rows], 0.62, color=color, alpha=0.3)
    axis.bar(places, [row.first for row in rows], 0.62, color=color, alpha=0.9)
    axis.axhline(rows[0].scenes, color=FIXED, linewidth=0.8, linestyle=(0, (3, 3)))
    axis.set_ylim(0, 1.08 * rows[0].scenes)
    axis.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    axis.set_title("scenes certified", fontsize=8.5)


def _short(factor: str, value: Value) -> str:
    """Return a value as it stands under a small panel."""
    if factor == "shaping_length":
        return f"{1e3 * float(value):g} mm"
    if factor == "swept":
        return "swept" if value else "sampled"
    return str(value).replace("gauss_newton", "Gauss-N.")


def _key(figure: Figure, rows: Sequence[Summary]) -> None:
    """One key for all panels."""
    handles: list[Any] = [Line2D([], [], linestyle="", marker="*", markersize=12, color=INK, label="defaults")]
    for factor, (color, marker, name) in STYLES.items():
        if any(row.variant.factor == factor for row in rows):
            handles.append(
                Line2D([], [], linestyle="", marker=marker, markersize=7, mfc=color, mec=INK, mew=0.6, label=name)
            )
    fewer = "fewer certified than by the defaults"
    handles.append(Line2D([], [], linestyle="", marker="o", markersize=7, mfc="white", mec=INK, mew=1.3, label=fewer))
    handles.append(Line2D([], [], color=GOOD, linewidth=6, alpha=0.25, label="Pareto front"))
    handles.append(Patch(color=INK, alpha=0.9, label="certified from the first guess"))
    handles.append(Patch(color=INK, alpha=0.3, label="certified from another guess"))
    row = {"loc": "upper left", "columnspacing": 1.6, "handletextpad": 0.6}
    figure.legend(handles=handles[:-4], bbox_to_anchor=(0.012, 0.934), ncols=len(handles), **row)
    figure.legend(handles=handles[-4:], bbox_to_anchor=(0.012, 0.914), ncols=4, **row)


def _plain(axis: Any) -> None:
    """Numbers as numbers, a light grid."""
    for one in (axis.xaxis, axis.yaxis):
        if one.get_scale() == "log":
            low, high = one.get_view_interval()
            one.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 200 * low else (1,)))
            one.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            one.set_minor_formatter(NullFormatter())
    axis.grid(color=GREY, linewidth=0.6)
    axis.set_axisbelow(True)
