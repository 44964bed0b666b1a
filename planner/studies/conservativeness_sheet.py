"""The picture of the false positives: how many there are above every gap, for each set of normals."""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from hdplan.distance.studies.conservativeness import EPSILON, GAMMA, Conservativeness
from hdplan.planner.pictures.style import CONTACT, GREY, OTHER_RUNG, RC, RUNG_STYLES
from hdplan.planner.studies.report import length_text

PAPER = (  # gap [m], false positives [%], words and where they stand
    (1e-4, 0.7, "the paper: around 0.7 % at 0.1 mm", (3, 22), "left"),
    (0.1, 0.2, "the paper:\nbelow 0.2 %\nat 10 cm", (9, 4), "left"),
)


def conservativeness_sheet(found: Conservativeness, tolerances: np.ndarray) -> Figure:
    """Return the figure: false positives [%] over the tolerance [m], both logarithmic."""
    with rc_context(RC):
        figure = Figure(figsize=(8.6, 5.6), dpi=150, facecolor="white")
        figure.text(0.02, 0.962, "How often a gap is taken for contact", fontsize=15, weight="bold", va="center")
        counted = f"{len(found.distances):,}".replace(",", " ")
        part = "" if found.complete else f" of {found.planned} (interrupted)"
        safe = "no contact is called free" if found.missed == 0 else f"{found.missed} contacts are called free"
        figure.text(
            0.02, 0.918, f"{counted}{part} random configurations of the 15 pairs of Platonic solids, gamma {GAMMA}, "
            f"epsilon {EPSILON:g}: {safe}.", va="center",
        )  # fmt: skip
        axis = figure.add_axes((0.085, 0.095, 0.895, 0.775))
        floor = 100.0 / len(found.distances)
        for rung in found.rungs:
            color, marker = RUNG_STYLES.get(rung.normals, OTHER_RUNG)
            percent = 100.0 * found.rates(rung, tolerances)
            percent[percent < floor] = np.nan
            worst = f"up to {rung.gaps[-1] * 100:.1f} cm" if len(rung.gaps) else "none"
            axis.plot(
                tolerances, percent, color=color, linewidth=1.7, marker=marker, markevery=6, markersize=5.5,
                label=f"{rung.normals}: {worst}",
            )  # fmt: skip
        for gap, published, words, place, align in PAPER:
            axis.plot(gap, published, "o", markersize=11, markerfacecolor="none", markeredgecolor=CONTACT)
            axis.annotate(words, (gap, published), place, textcoords="offset points", color=CONTACT, ha=align)
        axis.set(xscale="log", yscale="log", xlim=(tolerances[0] * 0.85, tolerances[-1] * 1.05), ylim=(floor, 2.0))
        axis.set_xlabel("gap between the bodies")
        axis.set_ylabel("false positives beyond that gap [% of the configurations so far apart]")
        axis.xaxis.set_major_formatter(FuncFormatter(length_text))
        axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.grid(color=GREY, linewidth=0.6)
        axis.legend(loc="lower left", title="candidate normals, and their widest false gap", alignment="left")
        return figure
