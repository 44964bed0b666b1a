"""The sheet of a motion: its panels beside the scene from two sides, under a title with the verdict.

Only known quantities have a panel: velocities and accelerations if the trajectory has times, torques if the scene
limits them, the solver's progress if its steps are known.
"""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from hdplan.planner.pictures.panels import draw_clearance, draw_convergence, draw_joints
from hdplan.planner.pictures.plot import Subject
from hdplan.planner.pictures.quantities import rates
from hdplan.planner.pictures.rates import draw_rate
from hdplan.planner.pictures.scene import DRIFTING_PAINTS, STANDING_PAINT, Picture, draw_scene
from hdplan.planner.pictures.style import BETWEEN, CONTACT, FIXED, GOAL, GOOD, INK, OBSTACLE, RC, START, plain

WIDTH, HEIGHT, PANEL_HEIGHT = (
    11.7,
    8.3,
    1.35,
)  # [in] A4 landscape, plus the extra height for each panel of a rate or torque
HEAD, LINE, FOOT = 0.93, 0.17, 0.5  # [in] above the panels, and more for each line of the verdict; below them
GAP = 0.75  # [in] between two panels: the upper one's axis, the lower one's title
TITLE_WIDTH = 132  # characters
SIDES = ((0.0, 18.0), (62.0, 48.0))  # azimuth relative to the best side, and elevation, of the two views [deg]

Draw = Callable[[Any, Subject], None]


def sheet(subject: Subject) -> Figure:
    """Return the figure; see plot.plot."""
    panels = [*motion_panels(subject), (1.1, draw_clearance)]
    return sheet_of(subject, panels + [(0.9, draw_convergence)] * bool(subject.steps))


def motion_panels(subject: Subject) -> list[tuple[float, Draw]]:
    """Return panels of the joints and their rates, each with its share of the height."""
    found = rates(subject.trajectory, subject.certifier.limits)
    return [(1.35, draw_joints), *((0.8, functools.partial(draw_rate, rate=rate)) for rate in found)]


def sheet_of(subject: Subject, panels: Sequence[tuple[float, Draw]]) -> Figure:
    """Return a figure with these panels beside the scene."""
    height = HEIGHT + PANEL_HEIGHT * max(0, len(panels) - 2 - bool(subject.steps))
    verdict = textwrap.wrap(plain(subject.certificate.text, 3 * TITLE_WIDTH - 30), TITLE_WIDTH)
    head = HEAD + LINE * len(verdict)
    band = {"bottom": FOOT / height, "top": 1.0 - head / height}
    with rc_context(RC):
        figure = Figure(figsize=(WIDTH, height), facecolor="white")
        room = (height - head - FOOT + GAP) / len(panels)  # [in] for a panel and what is below it
        _title(figure, subject, verdict, height)
        shares = [share for share, _ in panels]
        left = figure.add_gridspec(
            len(panels), 1, height_ratios=shares, left=0.085, right=0.425, **band, hspace=GAP / (room - GAP)
        )
        right = figure.add_gridspec(2, 1, left=0.525, right=0.985, **band, hspace=0.05)
        for row, (_, draw) in enumerate(panels):
            draw(figure.add_subplot(left[row]), subject)
        picture = Picture.of(subject.certifier.setup, subject.trajectory)
        views = [figure.add_subplot(right[row]) for row in range(len(SIDES))]
        for axis, (turn, elevation) in zip(views, SIDES, strict=True):
            draw_scene(axis, picture, picture.azimuth() + np.radians(turn), float(np.radians(elevation)))
        _key(views[0], picture)
        return figure


def _title(figure: Figure, subject: Subject, verdict: list[str], height: float) -> None:
    certificate, scene, robot = subject.certificate, subject.certifier.scene, subject.certifier.robot
    top = 1.0 - 0.29 / height
    figure.text(0.02, top, plain(f"{scene.name} · {robot.name}", 44), fontsize=15, weight="bold", va="center")
    figure.text(0.985, top, plain(subject.origin, 80), ha="right", va="center")
    color = GOOD if certificate.certified else CONTACT
    figure.text(0.02, 1.0 - 0.47 / height, "\n".join(verdict), color=color, fontsize=10, weight="bold", va="top")


def _key(axis: Any, picture: Picture) -> None:
    """Draw the legend of the scene's colours, with a line of its own for moving obstacles."""
    handles: list[Any] = [Patch(color=START, label="start"), Patch(color=BETWEEN, alpha=0.5, label="on the way")]
    handles += [Patch(color=GOAL, label="goal"), Patch(color=FIXED, label="base")]
    if any(paint is STANDING_PAINT for _, paint in picture.solids):
        handles.append(Patch(color=OBSTACLE, alpha=0.5, label="obstacles"))
    handles.append(Line2D([], [], color=INK, linewidth=1.3, label=f"path of {plain(picture.tip_link, 24)}"))
    (_, begins), (_, ghost), *_, (_, ends) = DRIFTING_PAINTS
    labels = ("moving obstacles at the start", "on the way, as the robot", "at the end")
    shown = zip((begins, ghost, ends), labels, strict=True)
    moving = [Patch(color=paint.color, alpha=paint.alpha, label=label) for paint, label in shown]
    for line, height in ((moving, 0.99), (handles, 1.02)) if picture.moves else ((handles, 0.99),):
        style: dict[str, Any] = {"columnspacing": 1.2, "handlelength": 1.4, "ncols": len(line)}
        texts = [str(handle.get_label()) for handle in line]
        axis.add_artist(Legend(axis, line, texts, loc="lower right", bbox_to_anchor=(1.0, height), **style))
