"""One plot beside the scene: curves over a part of the timeline, and a bar at the time that is shown.

uPlot knows no bar that a server could move, so one more series runs along the lower edge and rises at that time; all
other series have their true values there. Its legend says the values under the mouse.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import viser

from hdplan.planner.view.drawing.colors import hex_of
from hdplan.planner.view.drawing.mesh_parts import Color
from hdplan.planner.view.drawing.motion import shortened
from hdplan.planner.view.drawing.timeline import Timeline
from hdplan.scenes.array_types import Array

Rows = tuple[Array, ...]

HEIGHT = 165  # [px]
BAR: Color = (128, 128, 128)
PADDING = (8, 8, 0, 0)  # [px] above, right, below, left: room for half a number at the end of an axis
DASH, DOTTED, DOT = [6.0, 4.0], [1.5, 3.0], 7.0  # [px]
LONGEST_LABEL = 24  # characters of a curve's name
SPAN = tuple[float, float]  # of the timeline, or of values
LANE_HEIGHT = 34  # [px] at least, where curves have lanes
AXES = ({"size": 28}, {"size": 46})
UNSEEN = {"size": 46, "stroke": "transparent", "ticks": {"show": False}, "grid": {"show": False}}  # no scale for all


class Line(NamedTuple):
    """Name and look of a curve."""

    name: str  # "" for one of which the legend says nothing
    color: Color
    dashed: bool = False
    dots: bool = False  # its points alone
    dotted: bool = False
    lane: int | None = None  # from the top, in which the curve has a scale of its own


class Plot:
    """Curves over the timeline, and the bar."""

    def __init__(self, server: viser.ViserServer, title: str, lines: Sequence[Line]) -> None:
        """Set an empty plot up, which is not seen before it has curves."""
        self._server = server
        self._times: Array = np.array([0.0, 1.0])
        self._title, self._timeline, self._view = title, Timeline(), (0.0, 1.0)
        self._low, self._high = 0.0, 1.0
        self._lanes: tuple[SPAN, ...] = ()
        self._remark = ""
        self._take(lines)
        self.handle = server.gui.add_uplot(
            self._rows(0.0),
            self._series(),
            title=self._words,
            scales=self._scales(),
            axes=AXES,
            legend={"show": True, "live": True},
            cursor={"points": {"show": False}, "drag": {"x": False, "y": False, "setScale": False}},  # see page_script
            height=HEIGHT,
            padding=PADDING,
            visible=False,
        )

    def name(self, title: str, lines: Sequence[Line]) -> None:
        """Replace the curves, without values before they are set."""
        self._title = title
        if self._lines != tuple(lines):
            self._take(lines)
            with self._server.atomic():
                self.handle.series = self._series()
                self.handle.data = self._rows(0.0)

    def _take(self, lines: Sequence[Line]) -> None:
        self._lines = tuple(lines)
        self._curves: Rows = tuple(np.zeros(len(self._times)) for _ in lines)

    def _series(self) -> tuple[Any, ...]:
        lines: list[dict[str, Any]] = []
        for each in self._lines:
            stroke = hex_of(each.color)
            line: dict[str, Any] = {"label": shortened(each.name, LONGEST_LABEL), "stroke": stroke, "width": 1.5}
            if each.dashed or each.dotted:
                line |= {"dash": DASH if each.dashed else DOTTED, "width": 1.2}
            if each.lane is not None:
                line["scale"] = f"lane{each.lane}"
            if each.dots:
                line |= {"points": {"show": True, "size": DOT, "fill": stroke}}
            lines.append(line)
        bar = {"label": "now", "stroke": hex_of(BAR), "width": 1, "points": {"show": False}}
        return {"label": self._timeline.name}, *lines, bar

    def set(
        self,
        timeline: Timeline,
        times: Array,
        curves: Sequence[Array],
        low: float,
        high: float,
        now: float,
        view: SPAN,
        lanes: Sequence[SPAN] = (),
    ) -> None:
        """Show curves (K,) over moments (K,) of the timeline, between `low` and `high`, NaN where there is nothing; of
        the timeline what is in `view`. `lanes`: the least and the greatest value of each, from the top."""
        self._times, self._curves, self._low, self._high, self._remark = times, tuple(curves), low, high, ""
        if self._lanes != (wide := tuple(lanes)):
            if len(wide) != len(self._lanes):
                self.handle.axes = AXES if not wide else (AXES[0], UNSEEN)
                self.handle.height = max(HEIGHT, LANE_HEIGHT * len(wide))
            self._lanes = wide
        if timeline.timed != self._timeline.timed:
            self._timeline = timeline
            self.handle.series = self._series()
        self._timeline = timeline
        self.handle.title = self._words
        self.zoom(view)
        self.follow(now)
        self.handle.visible = True

    def zoom(self, view: SPAN) -> None:
        """Show this part of the timeline."""
        self._view = view
        if self.handle.scales != (scales := self._scales()):
            self.handle.scales = scales

    def remark(self, words: str) -> None:
        """Add a remark to the title, until other curves are set."""
        self._remark = words
        self.handle.title = self._words

    def follow(self, now: float) -> None:
        """Move the bar."""
        self.handle.data = self._rows(now)

    @property
    def _words(self) -> str:
        return f"{self._title} over {'time [s]' if self._timeline.timed else 'the path'}{self._remark}"

    def _scales(self) -> dict[str, dict[str, object]]:
        scales: dict[str, dict[str, object]] = {"x": {"time": False, "range": self._view}}
        scales["y"] = {"range": (self._low, self._high)}
        for lane, (low, high) in enumerate(self._lanes):  # values keep their numbers; the scale puts them into the lane
            bottom = low - (len(self._lanes) - 1 - lane) * (high - low)
            scales[f"lane{lane}"] = {"range": (bottom, bottom + len(self._lanes) * (high - low))}
        return scales

    def _rows(self, now: float) -> Rows:
        return with_bar(self._times, self._curves, now, self._low, self._high)


def with_bar(times: Array, curves: Sequence[Array], now: float, low: float, high: float) -> Rows:
    """Return times and curves with three more points at `now`, and the series of the bar last."""
    place = int(np.searchsorted(times, now))
    inserted = np.insert(times, [place] * 3, now)
    rows = [np.insert(curve, [place] * 3, np.interp(now, times, curve)) for curve in curves]
    bar = np.full(len(inserted), low)
    bar[place + 1] = high
    return (inserted, *rows, bar)
