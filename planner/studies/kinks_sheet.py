"""The picture of the two squares: distance and its derivatives over time, with snapshots at the kinks."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from hdplan.distance.studies.kinks import Curve, Kinks, pose, square
from hdplan.planner.pictures.style import CONTACT, FIXED, GREY, INK, RC, ROBOT_TO_OBSTACLES, START

SMOOTH = (START, ROBOT_TO_OBSTACLES)  # colours of the HD-SDF's curves
QUANTITIES = (("value", "distance [m]"), ("rate", "first derivative [m/s]"), ("second", "second derivative [m/s²]"))
SNAPSHOT_SIZE = (1.5, 1.2)  # [m] shown of a snapshot, from its middle
STEEPEST_SHOWN = 11.0  # [m/s²] shown of the second derivative: the rest belongs to the flat spot at contact


def kinks_sheet(found: Kinks) -> Figure:
    """Return the figure: a row of snapshots, then one panel per derivative over the same time."""
    with rc_context(RC):
        figure = Figure(figsize=(8.6, 9.2), dpi=150, facecolor="white")
        figure.text(0.02, 0.977, "A square moves and turns past another", fontsize=15, weight="bold", va="center")
        figure.text(
            0.02, 0.953, "The Euclidean distance has a kink where closest points or separating normals are not unique; "
            "the HD-SDF (gamma 2) has none.", va="center",
        )  # fmt: skip
        rows = figure.add_gridspec(
            4, 1, height_ratios=(0.92, 1.3, 1.3, 1.3), left=0.085, right=0.985, bottom=0.055, top=0.92, hspace=0.16
        )
        shots = rows[0].subgridspec(1, max(len(found.kinks), 1), wspace=0.03)
        for number, kink in enumerate(found.kinks):
            _snapshot(figure.add_subplot(shots[number]), kink.time, f"{number + 1}   t = {kink.time:.2f} s")
        panels = [figure.add_subplot(rows[row + 1]) for row in range(3)]
        for axis, (name, label) in zip(panels, QUANTITIES, strict=True):
            _panel(axis, found, name)
            axis.set(ylabel=label, xlim=(found.times[0], found.times[-1]))
            axis.tick_params(labelbottom=name == "second")
        low = min(curve.value.min() for curve in (found.euclidean, *found.smooth))
        panels[0].axhspan(low - 0.05, 0.0, color=GREY, zorder=0)
        panels[0].set_ylim(low - 0.05)
        panels[0].text(0.03, low - 0.03, "overlapping", va="bottom", color=FIXED)
        for number, kink in enumerate(found.kinks):
            panels[0].annotate(
                str(number + 1), (kink.time, kink.distance), (0, 12), textcoords="offset points", ha="center",
                color=CONTACT, weight="bold",
            )  # fmt: skip
        panels[0].legend(loc="upper center", frameon=True, edgecolor="none", framealpha=1.0)
        panels[2].set(xlabel="time [s]", ylim=(-STEEPEST_SHOWN, STEEPEST_SHOWN))
        peaks = " and ".join(f"{np.abs(curve.second).max():.0f}" for curve in found.smooth)
        panels[2].text(
            0.008, 0.03, f"cut off: the HD-SDF's,\nup to {peaks} m/s²\nwhere its flat spot is passed",
            transform=panels[2].transAxes, color=FIXED, fontsize=7.5,
        )  # fmt: skip
        return figure


def _snapshot(axis: Any, time: float, title: str) -> None:
    corners = square().vertices
    placed = corners @ pose(time)[:3, :3].T + pose(time)[:3, 3]
    axis.add_patch(Polygon(corners[:, :2], facecolor=GREY, edgecolor=INK, linewidth=1.0))
    axis.add_patch(Polygon(placed[:, :2], facecolor=to_rgba(START, 0.25), edgecolor=START, linewidth=1.0))
    axis.set_title(title, fontsize=8.5, color=CONTACT)
    middle = 0.5 * pose(time)[:2, 3]
    (left, low), (right, high) = middle - SNAPSHOT_SIZE, middle + SNAPSHOT_SIZE
    axis.set(aspect="equal", xlim=(left, right), ylim=(low, high))
    axis.set_axis_off()


def _panel(axis: Any, found: Kinks, name: str) -> None:
    for kink in found.kinks:
        axis.axvline(kink.time, color=CONTACT, linewidth=0.6, linestyle=(0, (4, 3)), zorder=1)
    _curve(axis, found, found.euclidean, name, color=INK, linewidth=1.6, zorder=2)
    for curve, color, width in zip(found.smooth, SMOOTH, (1.3, 1.3), strict=True):
        _curve(axis, found, curve, name, color=color, linewidth=width, zorder=3)
    if name == "rate":
        for kink in found.kinks:
            axis.plot([kink.time] * 2, [kink.before, kink.after], "o", color=INK, markersize=3, zorder=4)
    axis.axhline(0.0, color=FIXED, linewidth=0.6, zorder=1)


def _curve(axis: Any, found: Kinks, curve: Curve, name: str, **style: Any) -> None:
    """Draw one quantity of a curve; the Euclidean rate is broken at its jumps."""
    y = np.array(getattr(curve, name))
    if curve is found.euclidean and name == "rate":
        for kink in found.kinks:
            y[np.searchsorted(found.times, kink.time)] = np.nan
    axis.plot(found.times, y, label=curve.name, **style)
