"""The plots beside the scene: joints and clearance along the motion, with a bar at the time that is shown.

uPlot knows no bar that a server could move, so one more series runs along the lower edge and rises at that time; all
other series have their true values there.
"""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np
import viser

from hdplan.planner.view.drawing.colors import CONTACT, LINES, LINKS, SHARES, START, hex_of
from hdplan.planner.view.drawing.motion import ShownMotion, shortened
from hdplan.planner.view.drawing.skins import Color
from hdplan.planner.view.drawing.timeline import Timeline
from hdplan.scenes.array_types import Array

Rows = tuple[Array, ...]

HEIGHT = 165  # [px]
BAR: Color = (128, 128, 128)
LIMIT: Color = (215, 48, 39)  # of what is required or allowed
SHOWN = 0.3  # [m] largest clearance that the plot shows: what is farther away matters little


class Plot:
    """Curves over the timeline, and the bar."""

    def __init__(self, server: viser.ViserServer, title: str, names: Sequence[str], colors: Sequence[Color]) -> None:
        """Set an empty plot up, which is not seen before it has curves."""
        self._server = server
        self._times: Array = np.array([0.0, 1.0])
        self._title, self._timeline = title, Timeline()
        self._low, self._high = 0.0, 1.0
        self._remark = ""
        self._name(names, colors)
        self.handle = server.gui.add_uplot(
            self._rows(0.0),
            ({"label": self._timeline.name}, *self._lines),
            title=self._words,
            scales=self._scales(),
            axes=({"size": 28}, {"size": 46}),
            legend={"show": False},  # uPlot's own takes three lines
            cursor={"drag": {"x": False, "y": False, "setScale": False}},  # a click seeks
            height=HEIGHT,
            visible=False,
        )
        self.legend = server.gui.add_html(_legend(names, colors), visible=False)

    def name(self, names: Sequence[str], colors: Sequence[Color]) -> None:
        """Have curves of other names and colours, without values before they are set."""
        if self._named != (tuple(names), tuple(colors)):
            self._name(names, colors)
            with self._server.atomic():
                self.handle.series = ({"label": self._timeline.name}, *self._lines)
                self.handle.data = self._rows(0.0)
                self.legend.content = _legend(names, colors)

    def _name(self, names: Sequence[str], colors: Sequence[Color]) -> None:
        self._named = tuple(names), tuple(colors)
        self._curves: Rows = tuple(np.zeros(len(self._times)) for _ in names)
        lines = [
            {"label": name, "stroke": hex_of(color), "width": 1.5} for name, color in zip(names, colors, strict=True)
        ]
        bar = {"label": "now", "stroke": hex_of(BAR), "width": 1, "points": {"show": False}}
        self._lines = (*lines, bar)

    @property
    def visible(self) -> bool:
        """True if the object is shown."""
        return bool(self.handle.visible)

    @visible.setter
    def visible(self, value: bool) -> None:
        if self.handle.visible != value:
            self.handle.visible = self.legend.visible = value

    def set(
        self, timeline: Timeline, times: Array, curves: Sequence[Array], low: float, high: float, now: float
    ) -> None:
        """Show curves (K,) over moments (K,) of the timeline, between `low` and `high`; NaN where there is nothing."""
        self._times, self._curves, self._low, self._high, self._remark = times, tuple(curves), low, high, ""
        if timeline.timed != self._timeline.timed:
            self.handle.series = ({"label": timeline.name}, *self._lines)
        self._timeline = timeline
        self.handle.title = self._words
        self.handle.scales = self._scales()
        self.follow(now)
        self.visible = True

    def remark(self, words: str) -> None:
        """Add a remark to the title, until other curves are set."""
        if self._remark != words:
            self._remark = words
            self.handle.title = self._words

    def follow(self, now: float) -> None:
        """Move the bar."""
        self.handle.data = self._rows(now)

    @property
    def _words(self) -> str:
        return f"{self._title} over {'time [s]' if self._timeline.timed else 'the path'}{self._remark}"

    def _scales(self) -> dict[str, dict[str, object]]:
        extent = (self._timeline.begin, self._timeline.end)
        return {"x": {"time": False, "range": extent}, "y": {"range": (self._low, self._high)}}

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


class MotionPlots:
    """Joints of one motion, clearances of several, and how much of its limits the one uses."""

    def __init__(self, server: viser.ViserServer, joint_names: Sequence[str]) -> None:
        """Set the plots up."""
        lines = [LINES[i % len(LINES)] for i in range(len(joint_names))]
        self.clearance = Plot(server, "clearance [mm]", *_of_clearance(()))
        self.joints = Plot(server, "joints [rad or m]", joint_names, lines)
        self.shares = Plot(server, "share of the limits [%]", [*SHARES, "limit"], [*SHARES.values(), LIMIT])
        self._all = (self.clearance, self.joints, self.shares)

    def set(
        self,
        active: ShownMotion,
        motions: Sequence[tuple[ShownMotion, Color]],
        required: float,
        timeline: Timeline,
        now: float,
    ) -> None:
        """Show the joints of the active motion, the clearance of all in their colours, each from its start to its goal,
        the clearance `required` [m] and the one proven of the active motion, and its shares of limits, if it has
        any."""
        self.clearance.name(*_of_clearance([(motion.name, color) for motion, color in motions]))
        spread = float(np.ptp(active.joints)) or 1.0
        low, high = float(active.joints.min()) - 0.05 * spread, float(active.joints.max()) + 0.05 * spread
        when = [timeline.moments(motion.curve, motion.parameter) for motion, _ in motions]
        own = timeline.moments(active.curve, active.parameter)
        times = np.unique(np.concatenate([own, *when, [timeline.begin, timeline.end]]))
        self.joints.set(timeline, times, [_within(times, own, values) for values in active.joints.T], low, high, now)
        curves = [
            _within(times, at, within_sight(motion.clearance)) for at, (motion, _) in zip(when, motions, strict=True)
        ]
        curves.append(_within(times, own, within_sight(active.self_clearance)))
        proven = active.certificate.clearance
        for bound in (required, np.nan if proven is None else proven):
            curves.append(np.full(len(times), bound))
        millimetres = [1e3 * curve for curve in curves]
        known = [curve[np.isfinite(curve)] for curve in millimetres]
        top = max(float(curve.max(initial=0.0)) for curve in known)
        bottom = min(float(curve.min(initial=0.0)) for curve in known)
        self.clearance.set(timeline, times, millimetres, 1.05 * bottom, 1.05 * max(top, 10.0), now)
        if not active.measured:
            self.clearance.remark(", measured when you let go")
        elif any(np.nanmax(curve, initial=0.0) >= 1e3 * SHOWN for curve in millimetres):
            self.clearance.remark(f", cut at {1e3 * SHOWN:g}")
        self._show_shares(active, timeline, now)

    def _show_shares(self, active: ShownMotion, timeline: Timeline, now: float) -> None:
        if active.shares is None:
            return
        shares = {share.quantity: share for share in active.shares}
        if not shares:
            self.shares.visible = False
        else:
            times = np.unique(np.concatenate([share.times for share in shares.values()]))
            nothing = np.full(len(times), np.nan)
            curves = [100.0 * shares[name].over(times) if name in shares else nothing for name in SHARES]
            top = max(float(100.0 * share.values.max()) for share in shares.values())
            self.shares.set(timeline, times, [*curves, np.full(len(times), 100.0)], 0.0, 1.08 * max(top, 100.0), now)

    def outdate(self) -> None:
        """Say that the clearances are of an earlier scene."""
        self.clearance.remark(", of an earlier scene")

    def clear(self) -> None:
        """Show nothing, as there is no motion."""
        for plot in self._all:
            plot.visible = False

    def follow(self, now: float) -> None:
        """Move the bars."""
        for plot in self._all:
            if plot.visible:
                plot.follow(now)


def _of_clearance(motions: Sequence[tuple[str, Color]]) -> tuple[list[str], list[Color]]:
    """Return the names and colours of the clearance plot's curves for motions of these."""
    names, colors = [name for name, _ in motions], [color for _, color in motions]
    return [*names, "own links", "required", "proven"], [*colors, LINKS, LIMIT, START]


def _legend(names: Sequence[str], colors: Sequence[Color]) -> str:
    lines = (
        f'<span style="white-space:nowrap;padding-right:0.8em"><span style="color:{hex_of(color)}">▬</span> '
        f"{html.escape(shortened(name, 40))}</span>"
        for name, color in zip(names, colors, strict=True)
    )
    return f'<div class="hd" style="line-height:1.3">{" ".join(lines)}</div>'


def _within(times: Array, own: Array, values: Array) -> Array:
    """Return values (K,) that are known at moments `own` (K,) at other moments; NaN before the first and after the
    last."""
    return np.asarray(np.interp(times, own, values, left=np.nan, right=np.nan))


def within_sight(clearance: Array) -> Array:
    """Return what of a clearance the plot shows: nothing where there is nothing to be clear of."""
    return np.where(np.isinf(clearance), np.nan, np.minimum(clearance, SHOWN))


def joint_table(names: Sequence[str], q: Array, lower: Array, upper: Array) -> str:
    """Return joint values as an HTML table, each with a mark between its limits."""
    rows = []
    for name, value, low, high in zip(names, q.tolist(), lower.tolist(), upper.tolist(), strict=True):
        bounded = np.isfinite(low) and np.isfinite(high)
        share = 100.0 * min(max((value - low) / (high - low), 0.0), 1.0) if bounded else 50.0
        near = bounded and min(value - low, high - value) < 0.02 * (high - low)
        mark = hex_of(CONTACT if near else START)
        limits = f"{low:.2f} … {high:.2f}" if bounded else "turns freely"
        rows.append(
            f"<tr><td>{html.escape(name)}</td>"
            f'<td style="text-align:right;font-variant-numeric:tabular-nums">{value:+.3f}</td>'
            f'<td style="width:34%"><div style="position:relative;height:0.5em;background:#ddd;border-radius:3px">'
            f'<div style="position:absolute;left:calc({share:.1f}% - 2px);width:4px;height:0.5em;background:{mark}">'
            f'</div></div></td><td style="color:#777;white-space:nowrap">{limits}</td></tr>'
        )
    return f'<table style="font-size:0.75em;width:100%;padding:0 0.9em;border-spacing:4px 1px">{"".join(rows)}</table>'
