"""The picture of the corridor: the last joint's command in the critical phase, with the Euclidean distance and with
the HD-SDF at the same safety."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from hdplan.planner.pictures.style import GOAL, RC, START
from hdplan.planner.studies.corridor_experiment import AS_SAFE, CRITICAL_PHASE, Outcome

SHOWN = {  # name: words, colour
    "Euclidean": ("Euclidean distance", GOAL),
    AS_SAFE: ("HD-SDF at the same safety", START),
}


def corridor_sheet(outcomes: Sequence[Outcome]) -> Figure:
    """Return the figure: commands of the last joint one above the other on one scale, those of SHOWN that there are."""
    shown = [outcome for outcome in outcomes if outcome.variant.name in SHOWN] or list(outcomes[:1])
    variations = [outcome.variation(CRITICAL_PHASE, -1) for outcome in shown]
    with rc_context(RC):
        figure = Figure(figsize=(8.6, 0.95 + 1.75 * len(shown)), dpi=150, facecolor="white", layout="constrained")
        message = "A controller’s command in a corridor"
        if len(shown) == len(SHOWN):
            message = f"The Euclidean distance makes the command vary {variations[0] / variations[1]:.3g} times as much"
        figure.suptitle(message, fontsize=12, weight="bold", x=0.01, ha="left")
        panels = figure.subplots(len(shown), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        for axis, outcome, variation in zip(panels, shown, variations, strict=True):
            words, color = SHOWN.get(outcome.variant.name, (outcome.variant.name, START))
            speed = outcome.run.velocities[: round(CRITICAL_PHASE / outcome.run.period), -1]
            axis.plot(outcome.run.period * np.arange(len(speed)), speed, color=color, linewidth=0.9)
            axis.set(xlim=(0.0, CRITICAL_PHASE), ylabel="last joint [rad/s]")
            axis.set_title(f"{words}: total variation {variation:.3g} rad/s", color=color)
        panels[-1].set_xlabel("time [s]")
        return figure
