"""Frames of a motion, drawn by matplotlib: the scene from one side, its verdict, and the time."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.pictures.scene import Picture, draw_scene
from hdplan.planner.pictures.style import CONTACT, GOOD, RC, plain
from hdplan.planner.robot.setup import Setup

DOTS = 100  # per inch
ELEVATION = np.radians(20.0)
TITLE_WIDTH = 110  # characters


def drawn_frames(
    setup: Setup,
    trajectory: Trajectory,
    certificate: Certificate,
    moments: Sequence[tuple[float, str]],
    size: tuple[int, int],
) -> Iterator[NDArray[np.uint8]]:
    """Yield pictures (height, width, 3) of `size` [px] at moments: a path parameter, and what is written of it. The
    trajectory's joints are the robot's planned ones, in its order."""
    whole = Picture.of(setup, trajectory)  # whose window all frames have
    azimuth = whole.azimuth()
    for parameter, words in moments:
        with rc_context(RC):
            figure = Figure(figsize=(size[0] / DOTS, size[1] / DOTS), dpi=DOTS, facecolor="white")
            canvas = FigureCanvasAgg(figure)
            picture = replace(
                Picture.of(setup, trajectory, parameter),
                robot_points=whole.robot_points,
                obstacle_points=whole.obstacle_points,
            )
            draw_scene(figure.add_axes((0.01, 0.01, 0.98, 0.85)), picture, azimuth, ELEVATION)
            title = f"{setup.scene.name} · {setup.robot.name}"
            figure.text(0.015, 0.965, plain(title, 60), fontsize=14, weight="bold", va="center")
            figure.text(0.985, 0.965, words, fontsize=12, ha="right", va="center")
            color = GOOD if certificate.certified else CONTACT
            text = textwrap.fill(plain(certificate.text, 2 * TITLE_WIDTH), TITLE_WIDTH)
            figure.text(0.015, 0.93, text, fontsize=10, color=color, va="top")
            canvas.draw()
            yield np.asarray(canvas.buffer_rgba())[..., :3].copy()
