"""A run on one sheet: success by group, causes of failures, and how times, clearances and durations are spread."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from hdplan.planner.batch.report import PHASES, Rows, groups_of
from hdplan.planner.causes import CAUSES
from hdplan.planner.pictures.style import BETWEEN, GOAL, GOOD, GREY, INK, RC, START, plain

MOST_GROUPS = 16  # bars; the groups with the most failures are shown
BINS = 40
LONGEST_NAME = 24


def run_sheet(rows: Rows, title: str) -> Figure:
    """Return the figure of the results of a run."""
    certified = [row for row in rows if row["status"] == "certified"]
    with rc_context(RC):
        figure = Figure(figsize=(11.5, 6.6), dpi=150, facecolor="white")
        figure.text(0.02, 0.96, plain(title, 100), fontsize=12, weight="bold", color=INK, va="center")
        text = f"{len(certified)} of {len(rows)} problems certified"
        figure.text(0.02, 0.925, text, fontsize=9.5, color=INK, va="center")
        grid = figure.add_gridspec(
            2, 3, left=0.14, right=0.98, bottom=0.08, top=0.86, wspace=0.3, hspace=0.42, width_ratios=(1.2, 1, 1)
        )
        _groups(figure.add_subplot(grid[0, 0]), rows)
        _causes(figure.add_subplot(grid[1, 0]), rows)
        took = [sum(row[f"time_{phase}"] or 0.0 for phase in PHASES) for row in rows]
        _spread(figure.add_subplot(grid[0, 1]), "Time of a problem", "[ms]", 1e3 * np.array(took), START, log=True)
        for place, name, unit, key, scale in (
            (grid[0, 2], "Proven clearance", "[mm]", "clearance", 1e3),
            (grid[1, 1], "Motion time", "[s]", "motion_time", 1.0),
            (grid[1, 2], "Length", "[rad]", "length", 1.0),
        ):
            values = [scale * row[key] for row in certified if row[key] is not None]
            _spread(figure.add_subplot(place), name, unit, np.array(values), GOOD)
    return figure


def _groups(axes: Axes, rows: Rows) -> None:
    found: list[dict[str, Any]] = [dict(each) for each in groups_of(rows)]
    named = [each for each in found if each["group"] != "all" or len(found) == 1]
    shown = sorted(named, key=lambda each: each["certified"] / each["problems"])[:MOST_GROUPS]
    share = [100 * each["certified"] / each["problems"] for each in shown]
    axes.barh(range(len(shown)), 100.0, color=GREY)
    axes.barh(range(len(shown)), share, color=GOOD)
    _names(axes, [each["group"] for each in shown])
    axes.set(title="Certified by group [%]", xlim=(0, 100))
    if len(shown) < len(named):
        axes.set_xlabel(f"the {len(shown)} of {len(named)} groups with the most failures")


def _causes(axes: Axes, rows: Rows) -> None:
    counts = Counter(row["cause"] for row in rows if row["status"] != "certified").most_common()
    axes.set_title("Failures by cause")
    if not counts:
        _nothing(axes, "none failed")
        return
    axes.barh(range(len(counts)), [count for _, count in counts], color=GOAL)
    _names(axes, [cause for cause, _ in counts if cause in CAUSES])
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _spread(axes: Axes, name: str, unit: str, values: Any, color: str, log: bool = False) -> None:
    axes.set_title(f"{name} {unit}")
    if not len(values):
        _nothing(axes, "no motion has any")
        return
    if log and values.min() > 0.0:
        edges = np.geomspace(values.min() * 0.99, values.max() * 1.01, BINS)
        axes.set_xscale("log")
    else:
        edges = np.linspace(values.min() - 1e-9, values.max() + 1e-9, BINS)
    axes.hist(values, edges.tolist(), color=color)
    middle = float(np.median(values))
    axes.axvline(middle, color=INK, linewidth=1.0)
    axes.set_title(f"{name} {unit}, median {middle:.4g}")
    axes.set_ylabel("problems")


def _names(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(range(len(names)), [plain(name, LONGEST_NAME) for name in names])
    axes.invert_yaxis()


def _nothing(axes: Axes, words: str) -> None:
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", color=BETWEEN)
    axes.set(xticks=[], yticks=[])
