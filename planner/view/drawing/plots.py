"""The plots beside the scene, zoomed together: clearances of the motions, joints or their rates, shares of limits."""

from __future__ import annotations

import html
import os
from collections.abc import Callable, Sequence

import numpy as np
import viser

from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.colors import CONTACT, INK, LINES, LINKS, SHARES, START, hex_of
from hdplan.planner.view.drawing.mesh_parts import Color
from hdplan.planner.view.drawing.motion import Share, ShownMotion, moments_of, rates_of
from hdplan.planner.view.drawing.plot import SPAN, Line, Plot
from hdplan.planner.view.drawing.timeline import Timeline
from hdplan.scenes.array_types import Array

LIMIT: Color = (215, 48, 39)  # of what is required or allowed
SHOWN = 0.3  # [m] largest clearance that the plot shows: what is farther away matters little
NARROWEST = 0.01  # of the timeline that a plot shows at least
NEAR_LIMIT = 0.2  # of the range of all joints, from a joint to a limit of it that is drawn
POSITION = "position"
UNITS = {"velocity": "rad/s", "acceleration": "rad/s²", "jerk": "rad/s³", "torque": "N m"}  # or with m, N


class MotionPlots:
    """Clearances of several motions; joints, or one of their rates, of one or two; how much of its limits one uses."""

    def __init__(self, server: viser.ViserServer, robot: Robot, changed: Callable[[], object]) -> None:
        """Set the plots up; `changed` is called when another quantity is chosen."""
        joint_names, self._bounds = robot.joint_names, (robot.lower, robot.upper)
        prefix = os.path.commonprefix(list(joint_names)) if len(joint_names) > 1 else ""  # noqa: RUF071
        self._names = [name.removeprefix(prefix) for name in joint_names]
        self.clearance = Plot(server, "clearance [mm]", _of_clearance((), stages=False))
        self.quantity = server.gui.add_dropdown(
            "plot",
            (POSITION, *UNITS),
            initial_value=POSITION,
            hint="of the joints: position; rates where a motion has times, jerk and torque where the scene limits them",
        )
        self.lanes = server.gui.add_checkbox("lanes", False, hint="each joint in a lane of its own, with its own scale")
        for choice in (self.quantity, self.lanes):
            choice.on_update(lambda _: changed())
        self.joints = Plot(server, "joints", ())
        share_lines = [Line(name, color) for name, color in SHARES.items()]
        self.shares = Plot(server, "share of the limits [%]", [*share_lines, Line("limit", LIMIT, dashed=True)])
        self._all = (self.clearance, self.joints, self.shares)
        self._timeline, self._view = Timeline(), (0.0, 1.0)

    @property
    def view(self) -> SPAN:
        """The part of the timeline that is shown."""
        return self._view

    def zoom(self, first: float, last: float) -> None:
        """Show the part between two shares of what is shown; all of the timeline again for an empty part."""
        begin, end = self._view
        low, high = sorted(begin + min(max(share, 0.0), 1.0) * (end - begin) for share in (first, last))
        whole = (self._timeline.begin, self._timeline.end)
        self._view = (low, high) if high - low >= NARROWEST * (whole[1] - whole[0]) else whole
        for plot in self._all:
            plot.zoom(self._view)

    def set(
        self,
        active: ShownMotion,
        motions: Sequence[tuple[ShownMotion, Color]],
        required: float,
        setup: Setup,
        timeline: Timeline,
        now: float,
    ) -> None:
        """Show the joints of the active motion, beside them dashed those of the first other one; the clearance of all
        in their colours, each from its start to its goal, the clearance `required` [m] and the one proven of the active
        motion; and its shares of limits, if it has any. Limits of rates are those of `setup`."""
        if timeline != self._timeline:
            self._timeline, self._view = timeline, (timeline.begin, timeline.end)
        self._show_clearance(active, motions, required, now)
        others = [motion for motion, _ in motions if motion is not active]
        self._show_joints(active, others[:1], setup, now)
        self._show_shares(active, now)

    def _show_clearance(
        self, active: ShownMotion, motions: Sequence[tuple[ShownMotion, Color]], required: float, now: float
    ) -> None:
        timeline, stages = self._timeline, stage_moments(active, self._timeline)
        lines = _of_clearance([(motion.name, color) for motion, color in motions], stages=len(stages) > 0)
        self.clearance.name("clearance [mm]", lines)
        when = [timeline.moments(motion.curve, motion.parameter) for motion, _ in motions]
        own = timeline.moments(active.curve, active.parameter)
        nearest = np.minimum(active.clearance, active.self_clearance)
        times = np.unique(np.concatenate([own, *when, stages, [timeline.begin, timeline.end]]))
        curves = [
            _within(times, at, within_sight(motion.clearance)) for at, (motion, _) in zip(when, motions, strict=True)
        ]
        curves.append(_within(times, own, within_sight(active.self_clearance)))
        proven = active.certificate.clearance
        for bound in (required, np.nan if proven is None else proven):
            curves.append(np.full(len(times), bound))
        closest = np.full(len(times), np.nan)
        if active.measured and np.isfinite(nearest).any():
            place = int(nearest.argmin())
            closest[np.searchsorted(times, own[place])] = min(float(nearest[place]), SHOWN)
        curves.append(closest)
        if len(stages):
            begins = np.full(len(times), np.nan)
            begins[np.searchsorted(times, stages)] = 0.0
            curves.append(begins)
        millimetres = [1e3 * curve for curve in curves]
        known = [curve[np.isfinite(curve)] for curve in millimetres]
        top = max(float(curve.max(initial=0.0)) for curve in known)
        bottom = min(float(curve.min(initial=0.0)) for curve in known)
        self.clearance.set(timeline, times, millimetres, 1.05 * bottom, 1.05 * max(top, 10.0), now, self._view)
        if not active.measured:
            self.clearance.remark(", measured when you let go")
        elif any(np.nanmax(curve, initial=0.0) >= 1e3 * SHOWN for curve in millimetres):
            self.clearance.remark(f", cut at {1e3 * SHOWN:g}")

    def _show_joints(self, active: ShownMotion, others: Sequence[ShownMotion], setup: Setup, now: float) -> None:
        """Show the chosen quantity, of the motions that have it, with its limits."""
        timeline, wanted = self._timeline, str(self.quantity.value)
        found = [(each, _values(each, wanted, setup, timeline)) for each in (active, *others)]
        known = [(motion.name, *values) for motion, values in found if values is not None]
        lanes = bool(self.lanes.value) and len(self._names) > 1
        limits = [] if lanes or not known or known[0][3] is None else sorted({*known[0][3].tolist()})
        lines = [
            Line(
                name + (f" of {whose}" if number else ""), LINES[i % len(LINES)], number > 0, lane=i if lanes else None
            )
            for number, (whose, *_) in enumerate(known)
            for i, name in enumerate(self._names)
        ]
        lines += [Line(name, LIMIT, dashed=True) for _ in limits for name in ("limit", "−limit")]
        if wanted == POSITION:
            near = _near(active.joints, *self._bounds)
        else:
            near = _near_rates(known[0][2], known[0][3]) if lanes and known else []
        lines += [Line("", LINES[i % len(LINES)], dotted=True, lane=i if lanes else None) for i, _ in near]
        title = "joints [rad or m]" if wanted == POSITION else f"{wanted} of the joints [{UNITS.get(wanted, '')}]"
        self.joints.name(title if known else f"{title}: none known", lines)
        if not known:
            nothing = np.array([timeline.begin, timeline.end])
            self.joints.set(timeline, nothing, [], 0.0, 1.0, now, self._view)
            return
        times = np.unique(np.concatenate([[timeline.begin, timeline.end], *(at for _, at, _, _ in known)]))
        curves = [_within(times, at, column) for _, at, values, _ in known for column in values.T]
        every = np.concatenate([values.ravel() for _, _, values, _ in known])
        spread = float(np.ptp(every)) or 1.0
        low, high = float(every.min()) - 0.05 * spread, float(every.max()) + 0.05 * spread
        for _, bound in near:
            curves.append(np.full(len(times), bound))
            low, high = min(low, bound - 0.02 * spread), max(high, bound + 0.02 * spread)
        for limit in limits:
            curves += [np.full(len(times), limit), np.full(len(times), -limit)]
        reach = max([abs(low), abs(high)])
        if any(limit <= 2.0 * reach for limit in limits):  # close enough to be of interest
            low, high = -1.05 * max(reach, limits[0]), 1.05 * max(reach, limits[0])
        spans = _lanes([values for _, _, values, _ in known], near) if lanes else ()
        self.joints.set(timeline, times, curves, low, high, now, self._view, spans)
        if near:
            self.joints.remark(", limits dotted")

    def _show_shares(self, active: ShownMotion, now: float) -> None:
        if active.shares is None:
            return
        shares = {share.quantity: share for share in active.shares}
        if not shares:
            self.shares.handle.visible = False
        else:
            times = np.unique(np.concatenate([share.times for share in shares.values()]))
            known = (shares.get(name, Share(name, times, np.full(len(times), np.nan))) for name in SHARES)
            curves = [100.0 * _within(times, share.times, share.values) for share in known]
            top = max(float(100.0 * share.values.max()) for share in shares.values())
            every = [*curves, np.full(len(times), 100.0)]
            self.shares.set(self._timeline, times, every, 0.0, 1.08 * max(top, 100.0), now, self._view)

    def outdate(self) -> None:
        """Say that the clearances are of an earlier scene."""
        self.clearance.remark(", of an earlier scene")

    def clear(self) -> None:
        """Show nothing, as there is no motion."""
        for plot in self._all:
            plot.handle.visible = False

    def follow(self, now: float) -> None:
        """Move the bars."""
        for plot in self._all:
            if plot.handle.visible:
                plot.follow(now)


def stage_moments(motion: ShownMotion, timeline: Timeline) -> Array:
    """Return when the stages of a job's motion begin; none of any other."""
    rows = np.array([stage.row for stage in motion.trajectory.stages], dtype=np.float64)
    return timeline.moments(motion.curve, rows / (len(motion.curve) - 1))


def _values(
    motion: ShownMotion, wanted: str, setup: Setup, timeline: Timeline
) -> tuple[Array, Array, Array | None] | None:
    """Return the moments (K,) and values (K, n) of a quantity of the joints, and its limits (n,) if the scene has any;
    None for a motion of which it is not known."""
    if wanted == POSITION:
        return timeline.moments(motion.curve, motion.parameter), motion.joints, None
    found = (rate for rate in rates_of(motion.trajectory, setup) if rate.quantity == wanted and len(rate.values))
    rate = next(found, None)
    if rate is None:
        return None
    times = moments_of(rate)
    rising = np.concatenate([[True], np.diff(times) > 0.0])  # of two values at a jump, the first
    return times[rising], rate.values[rising], rate.limits


def _near(joints: Array, lower: Array, upper: Array) -> list[tuple[int, float]]:
    """Return the limits of joints to which a motion (K, n) comes near, each with the number of its joint: others would
    leave the curves no room."""
    reach = NEAR_LIMIT * max(float(np.ptp(joints)), 1.0)
    found = [(i, float(low)) for i, low in enumerate(lower) if joints[:, i].min() - low < reach]
    return found + [(i, float(high)) for i, high in enumerate(upper) if high - joints[:, i].max() < reach]


def _near_rates(values: Array, limits: Array | None) -> list[tuple[int, float]]:
    """Return the limits (n,) of rates (K, n), both ways, that are no more than twice the greatest value of their joint,
    each with the number of the joint."""
    if limits is None:
        return []
    near = np.flatnonzero(limits <= 2.0 * np.abs(values).max(axis=0)).tolist()
    return [(i, sign * float(limits[i])) for i in near for sign in (-1.0, 1.0)]


def _lanes(values: Sequence[Array], near: Sequence[tuple[int, float]]) -> list[SPAN]:
    """Return the least and the greatest value of each joint's lane, of several motions' values (K, n) and of the limits
    that are drawn, with room around them."""
    every = np.vstack(values)
    low, high = every.min(axis=0), every.max(axis=0)
    for i, bound in near:
        low[i], high[i] = min(low[i], bound), max(high[i], bound)
    room = 0.1 * np.where(high > low, high - low, 1.0)
    return list(zip((low - room).tolist(), (high + room).tolist(), strict=True))


def _of_clearance(motions: Sequence[tuple[str, Color]], stages: bool) -> list[Line]:
    """Return the curves of the clearance plot for motions of these names and colours, and for one with `stages`."""
    lines = [Line(name, color) for name, color in motions]
    lines += [Line("own links", LINKS), Line("required", LIMIT, dashed=True), Line("proven", START, dashed=True)]
    lines.append(Line("closest", CONTACT, dots=True))
    return lines + ([Line("stages", INK, dots=True)] if stages else [])


def _within(times: Array, own: Array, values: Array) -> Array:
    """Return values (K,) that are known at moments `own` (K,) at other moments; NaN before the first and after the
    last."""
    return np.asarray(np.interp(times, own, values, left=np.nan, right=np.nan))


def within_sight(clearance: Array) -> Array:
    """Return the part of a clearance that the plot shows: nothing where there are no obstacles."""
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
            '<td style="width:34%"><div style="position:relative;height:0.5em;border-radius:3px;'
            'background:light-dark(#ddd,#4a4d52)">'
            f'<div style="position:absolute;left:calc({share:.1f}% - 2px);width:4px;height:0.5em;background:{mark}">'
            f'</div></div></td><td style="color:light-dark(#5f6368,#b5b5b5);white-space:nowrap">{limits}</td></tr>'
        )
    style = "font-size:max(0.8em,11px);width:100%;padding:0 0.9em;border-spacing:4px 1px"
    return f'<table style="{style}">{"".join(rows)}</table>'
