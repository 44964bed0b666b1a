"""The picture of the query times: every method over the paper's measure of a pair's complexity."""

from __future__ import annotations

from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from hdplan.distance.studies.query_time import BATCH, EPSILON, GAMMA, POSES, QueryTimes
from hdplan.planner.pictures.style import BETWEEN, BETWEEN_LINKS, CONTACT, FIXED, GOOD, GREY, INK, RC, START

# name of the method: words, colour, marker, dashes
STYLES = {
    "GDF": ("GDF, our NumPy", BETWEEN_LINKS, "v", (0, (2, 2))),
    "GDF uaibot": ("GDF, its authors' C++", BETWEEN_LINKS, "v", "-"),
    "FCL": ("exact, FCL", INK, "s", "-"),
    "coal": ("exact, coal", FIXED, "D", "-"),
    "interpreter": ("HD-SDF, interpreter", BETWEEN, "o", (0, (2, 2))),
    "compiled, one pose a call": ("HD-SDF, compiled, one pose a call", START, "o", (0, (4, 2))),
    "compiled": ("HD-SDF, compiled, a table of poses", START, "o", "-"),
    "JAX batch": ("HD-SDF, JAX batch", GOOD, "P", "-"),
}
LINE = 0.036  # height of a line of text, of the axis'
PAPER_AT = 16_000  # complexity of the paper's slowest pair, two dodecahedra
PAPER = (
    (5e-3, "the paper's HD-SDF, one core: 5 ms"),
    (1e-4, "its GDF: 50 × less"),
    (1e-5, "its FCL: 500 × less"),
)  # [s]


def time_sheet(found: QueryTimes) -> Figure:
    """Return the figure: time per query [s] over complexity, both logarithmic."""
    with rc_context(RC):
        figure = Figure(figsize=(8.6, 6.0), dpi=150, facecolor="white")
        figure.text(0.02, 0.962, "What a distance costs", fontsize=15, weight="bold", va="center")
        pairs = f"{len(found.pairs)} pairs of Platonic solids" + ("" if found.complete else " (interrupted)")
        figure.text(
            0.02, 0.92, f"{pairs}; {POSES} random poses of each, {BATCH} in tables and batches. Gamma {GAMMA}, epsilon "
            f"{EPSILON:g}, the paper's normals.", va="center",
        )  # fmt: skip
        axis = figure.add_axes((0.085, 0.09, 0.625, 0.79))
        complexity = [pair.complexity for pair in found.pairs]
        ends: list[tuple[float, str, str]] = []
        for name, (words, color, marker, dashes) in STYLES.items():
            if found.pairs and name in found.pairs[0].seconds:
                seconds = [pair.seconds[name] for pair in found.pairs]
                axis.plot(complexity, seconds, color=color, marker=marker, markersize=4, linestyle=dashes, lw=1.3)
                ends.append((seconds[-1], words, color))
        axis.set(xscale="log", yscale="log")
        for worst, words in PAPER:
            axis.plot(PAPER_AT, worst, "o", markersize=10, mfc="none", mec=CONTACT)
            ends.append((worst, words, CONTACT))
        axis.set(xlim=(complexity[0] / 1.25, PAPER_AT * 1.25), ylabel="time per query")
        axis.set_xlabel("complexity  |V(A)|²|V(B)| + |V(A)||V(B)|²")
        axis.yaxis.set_major_formatter(FuncFormatter(_time))
        axis.grid(color=GREY, linewidth=0.6)
        _beside(axis, ends)
        return figure


def _beside(axis: Any, ends: list[tuple[float, str, str]]) -> None:
    """Write labels at the right edge, near the ends of their curves and without overlap."""
    to_axis = axis.transData + axis.transAxes.inverted()
    wanted = sorted((float(to_axis.transform((1.0, value))[1]), words, color) for value, words, color in ends)
    heights = [height for height, _, _ in wanted]
    for _ in range(200):  # neighbours push each other apart until none overlap
        for k in range(len(heights) - 1):
            overlap = max(LINE - (heights[k + 1] - heights[k]), 0.0)
            heights[k] -= overlap / 2
            heights[k + 1] += overlap / 2
    for height, (_, words, color) in zip(heights, wanted, strict=True):
        axis.text(1.02, height, words, color=color, transform=axis.transAxes, va="center")


def _time(seconds: float, _: object) -> str:
    if seconds < 1e-6:
        return f"{seconds * 1e9:g} ns"
    return f"{seconds * 1e6:g} µs" if seconds < 1e-3 else f"{seconds * 1e3:g} ms"
