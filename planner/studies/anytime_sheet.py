"""The picture of what quality costs in time: motion time, path and acceleration of the best motion so far, over the
time spent."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from hdplan.planner.pictures.style import FIXED, GOOD, INK, RC
from hdplan.planner.studies.anytime import AnytimeCurve, Moment

PANELS: dict[str, Callable[[Moment], float]] = {
    "motion time": lambda moment: moment.duration,
    "path in joint space": lambda moment: moment.length,
    "∫acceleration² over time": lambda moment: moment.acceleration,
}
POINTS = 200  # of the mean
NAMED = 3  # curves with a name: those that gain most
NAME = 7  # [pt] the size of a name
TICKS = (1, 2, 5, 10, 20, 50, 100)


def anytime_sheet(curves: Sequence[AnytimeCurve], complete: bool = True) -> Figure:
    """Return the figure for the curves of at least one scene."""
    with rc_context(RC):
        figure = Figure(figsize=(12.6, 4.6), dpi=150, facecolor="white")
        figure.text(0.02, 0.94, "What quality costs in time", fontsize=15, weight="bold", va="center")
        part = "" if complete else ", interrupted: what was measured until then"
        figure.text(0.985, 0.94, f"{len(curves)} scenes{part}", ha="right", va="center", color=FIXED)
        first = np.median([curve.moments[0].seconds for curve in curves])
        words = (
            f"the best certified motion so far; the first one took {1e3 * first:.0f} ms of processor time in the "
            "median. Thin: each scene; bold: their geometric mean"
        )
        figure.text(0.02, 0.88, words, va="center", color=FIXED)
        grid = figure.add_gridspec(1, len(PANELS), left=0.06, right=0.985, bottom=0.13, top=0.78, wspace=0.2)
        for column, (title, measure) in enumerate(PANELS.items()):
            _panel(figure.add_subplot(grid[column]), curves, title, measure)
        return figure


def _panel(axis: Any, curves: Sequence[AnytimeCurve], title: str, measure: Callable[[Moment], float]) -> None:
    last = max(curve.moments[-1].seconds / curve.moments[0].seconds for curve in curves) * 1.3 + 1.0
    gains = sorted(curves, key=lambda curve: measure(curve.moments[-1]) / measure(curve.moments[0]))
    for curve in curves:
        spent = [moment.seconds / curve.moments[0].seconds for moment in curve.moments]
        shares = [100 * measure(moment) / measure(curve.moments[0]) for moment in curve.moments]
        axis.step([*spent, last], [*shares, shares[-1]], where="post", color=FIXED, alpha=0.35, linewidth=1, zorder=1)
    times = np.geomspace(1.0, last, POINTS)
    ratios = [
        [measure(curve.best_at(time * curve.moments[0].seconds)) / measure(curve.moments[0]) for curve in curves]
        for time in times
    ]
    axis.plot(times, 100 * np.exp(np.log(ratios).mean(axis=1)), color=GOOD, linewidth=2.6, zorder=2)
    axis.axhline(100, color=INK, linewidth=0.6, zorder=0)
    axis.set(xscale="log", xlim=(1.0, last), xticks=[tick for tick in TICKS if tick < last], title=title)
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_xlabel("time spent, that until the first certified motion = 1")
    axis.set_ylabel("of the first certified motion's [%]")
    ends = {curve.scene: 100 * measure(curve.moments[-1]) / measure(curve.moments[0]) for curve in gains[:NAMED]}
    _name_ends(axis, last, {scene: share for scene, share in ends.items() if share < 100})


def _name_ends(axis: Any, last: float, ends: Mapping[str, float]) -> None:
    """Write names above the ends of curves, each above the one below it too."""
    axis.autoscale_view()
    top = -np.inf
    for scene, share in sorted(ends.items(), key=lambda end: end[1]):
        at = axis.transData.transform((last, share))[1] * 72 / axis.figure.dpi
        bottom = max(at + 2, top)
        axis.annotate(
            scene, (last, share), (-2, bottom - at), textcoords="offset points", ha="right", fontsize=NAME, color=FIXED
        )
        top = bottom + 1.3 * NAME
