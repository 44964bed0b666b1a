"""Labels of points in a plot, placed so that none covers another label or a point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.transforms import Bbox

from hdplan.planner.pictures.style import FIXED, INK
from hdplan.scenes.once import read_only

REACHES = (9, 15, 24, 36, 50)  # [pt] from a point to its label, the nearest free place first
TURNS = read_only(np.radians([0, 180, 40, -40, 140, -140, 90, -90, 65, -65, 115, -115]))
DOT = 5  # [pt] around a point that stays free
LEADER_LENGTH = 12  # [pt] beyond which a line connects the label with its point


def name_points(axis: Any, points: Sequence[tuple[float, float]], names: Sequence[str], bold: int = 0) -> None:
    """Write a name beside each point (x, y) of an axis whose limits are final, the first ``bold`` of them in bold.

    Names are placed in this order; one without a free place is left out.
    """
    figure = axis.figure
    figure.draw_without_rendering()
    frame, dot = axis.get_window_extent(), DOT * figure.dpi / 72
    taken = [Bbox([place - dot, place + dot]) for place in axis.transData.transform(points)]
    for k, (point, name) in enumerate(zip(points, names, strict=True)):
        for reach, turn in ((reach, turn) for reach in REACHES for turn in TURNS):
            right, up = np.cos(turn), np.sin(turn)
            written = axis.annotate(
                name, point, (reach * right, reach * up), textcoords="offset points", va="center",
                ha="left" if right > 0.1 else "right" if right < -0.1 else "center",
                fontsize=7.5, weight="bold" if k < bold else "normal", color=INK, zorder=6,
            )  # fmt: skip
            box = written.get_window_extent()
            if not any(box.overlaps(other) for other in taken) and _within(frame, box):
                taken.append(box)
                if reach > LEADER_LENGTH:
                    style = {"arrowstyle": "-", "color": FIXED, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 3}
                    axis.annotate("", point, written.get_position(), textcoords="offset points", arrowprops=style)
                break
            written.remove()


def _within(frame: Bbox, box: Bbox) -> bool:
    return bool(np.all(frame.min <= box.min) and np.all(box.max <= frame.max))
