"""The picture of a replayed motion: rates and torques over time, as shares of their limits, and the tracking error."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from hdplan.planner.control.simulation import Simulation
from hdplan.planner.pictures.style import CONTACT, CURVES, FIXED, GOOD, RC, plain
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.limits import QUANTITIES

PANEL, HEAD = 1.35, 0.9  # [in] height of a panel, and of the head above them
LINE_LENGTH = 110  # characters of the verdict in a line
SHOWN = 1.25  # times a limit: the axis ends there if the limit is exceeded by more


def simulation_sheet(simulation: Simulation, title: str) -> Figure:
    """Return the figure: a panel for each rate and each other limited quantity, and with dynamics also for torques and
    tracking errors.

    Raises InputError for a path without times, which has no rates.
    """
    if simulation.duration is None:
        raise InputError("times: missing, so there are no rates to draw; `hdplan plot` draws a path")
    count = len(DERIVATIVES) + len(simulation.others) + 2 * (simulation.execution is not None)
    height = HEAD + PANEL * count + 0.35
    with rc_context(RC):
        figure = Figure(figsize=(8.6, height), dpi=150, facecolor="white")
        top = 1 - HEAD / height
        figure.text(0.02, 1 - 0.22 / height, plain(title, LINE_LENGTH), fontsize=13, weight="bold", va="center")
        colour = GOOD if simulation.succeeded else CONTACT
        figure.text(0.02, 1 - 0.46 / height, plain(simulation.text, LINE_LENGTH), color=colour, va="center")
        rows = figure.add_gridspec(count, 1, left=0.1, right=0.8, bottom=0.42 / height, top=top, hspace=0.32)
        panels = [figure.add_subplot(rows[row]) for row in range(count)]
        free = iter(panels)
        first, last = (float(time) for time in simulation.curve.time_of([0.0, 1.0]))
        times = np.linspace(first, last, 1001)
        for what, order in DERIVATIVES.items():
            _draw(next(free), simulation, what, times, simulation.curve.at_time(times, order))
        for what, values in simulation.others.items():
            _draw(next(free), simulation, what, simulation.times, values)
        if simulation.execution is not None:
            done = simulation.execution
            _draw(next(free), simulation, "torque", done.times[: len(done.commanded)], done.commanded)
            errors = next(free)
            for curve, style in zip(done.errors.T, itertools.cycle(CURVES), strict=False):
                errors.plot(done.times, curve * 1e3, linewidth=1.2, **style)
            errors.set(title="tracking error", ylabel="mrad")
        for axis in panels:
            axis.set_xlim(first, last)
            axis.tick_params(labelbottom=axis is panels[-1])
            axis.axhline(0.0, color=FIXED, linewidth=0.5, zorder=0)
        panels[-1].set_xlabel("time [s]")
        panels[0].legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), handlelength=2.2)
        return figure


def _draw(axis: Any, simulation: Simulation, what: str, times: Array, values: Array) -> None:
    """Draw one quantity of every joint, as a share of its limit if there are limits."""
    limits = [joint.peaks[what].limit for joint in simulation.joints]
    for joint, curve, limit, style in zip(simulation.joints, values.T, limits, itertools.cycle(CURVES), strict=False):
        shown = curve if limit is None else 100 * curve / limit
        axis.plot(times, shown, linewidth=1.2, label=plain(joint.name, 22), **style)
    if None in limits:
        axis.set(title=what, ylabel=QUANTITIES[what].units[0])
        return
    largest = max(joint.peaks[what].share or 0.0 for joint in simulation.joints)
    room = 100 * min(max(1.12, 1.05 * largest), SHOWN)
    for side in (-1, 1):
        axis.axhspan(side * 100, side * room, color=CONTACT, alpha=0.15, linewidth=0)
    axis.set(title=what, ylabel="% of limit", ylim=(-room, room))
