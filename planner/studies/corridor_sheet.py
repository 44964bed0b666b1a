"""The picture of the corridor: the last joint's command in the critical phase, the clearance, and its cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from hdplan.planner.pictures.style import CONTACT, CURVES, FIXED, GREY, RC
from hdplan.planner.studies.corridor_experiment import AS_SAFE, CRITICAL, EXACT_EVERY, Outcome

SHOWN = ("Euclidean", "GDF", "HD-SDF, code", AS_SAFE)  # each in a panel of its own


def corridor_sheet(outcomes: Sequence[Outcome]) -> Figure:
    """Return the figure: commands of the last joint one above the other on one scale, and the exact clearances."""
    styles = {outcome.variant.name: CURVES[k % len(CURVES)] for k, outcome in enumerate(outcomes)}
    shown = [outcome for outcome in outcomes if outcome.variant.name in SHOWN]
    with rc_context(RC):
        figure = Figure(figsize=(8.6, 2.4 + 1.35 * len(shown) + 2.6), dpi=150, facecolor="white")
        heights = [1.0] * len(shown) + [1.9]
        rows = figure.add_gridspec(
            len(heights), 1, height_ratios=heights, left=0.085, right=0.985, bottom=0.05, top=0.895, hspace=0.45
        )
        figure.text(0.02, 0.965, "A Panda of boxes enters a corridor", fontsize=15, weight="bold", va="center")
        figure.text(
            0.02, 0.938, "Velocity of the last joint in the critical phase, commanded by the same controller with the "
            "same target;\nonly the distance of its barriers differs.", va="center",
        )  # fmt: skip
        speeds = [outcome.run.velocities[: round(CRITICAL / outcome.run.period), -1] for outcome in shown]
        largest = 1.05 * max(float(np.abs(speed).max()) for speed in speeds)
        for row, (outcome, speed) in enumerate(zip(shown, speeds, strict=True)):
            axis = figure.add_subplot(rows[row])
            axis.plot(outcome.run.period * np.arange(len(speed)), speed, color=CURVES[0]["color"], linewidth=0.8)
            axis.set_ylim(-largest, largest)
            axis.set_xlim(0.0, CRITICAL)
            axis.set_ylabel("[rad/s]")
            axis.tick_params(labelbottom=row == len(shown) - 1)
            variation = outcome.variation(CRITICAL, -1)
            axis.set_title(f"{outcome.variant.name}   total variation {variation:.3g} rad/s")
        axis.set_xlabel("time [s]", labelpad=1)
        axis = figure.add_subplot(rows[-1])
        for outcome in outcomes:
            times = EXACT_EVERY * np.arange(len(outcome.clearances))
            axis.plot(times, 1e3 * outcome.clearances, label=outcome.variant.name, linewidth=1.1,
                      **styles[outcome.variant.name])  # fmt: skip
        axis.axhspan(-10.0, 0.0, color=GREY, zorder=0)
        axis.axhline(0.0, color=CONTACT, linewidth=0.8)
        axis.text(0.3, -5.0, "contact", va="center", color=FIXED)
        axis.set_ylim(-10.0, 100.0)
        axis.set_xlim(0.0, max(float(outcome.run.times[-1]) for outcome in outcomes))
        axis.set_ylabel("exact clearance [mm]")
        axis.set_xlabel("time [s]")
        axis.set_title("Clearance of the boxes to the walls as they are")
        axis.legend(loc="upper right", ncols=3)
        return figure
